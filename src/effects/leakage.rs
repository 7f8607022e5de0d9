//! A conductance in parallel with the film, fed through the series resistance: the film sees less than the command, the more the higher
//! the field:  phi = phi_c / (1 + x (E/E_0)^n), with x set so that the loss is `loss_fraction` at 3 kV on a film at area stretch 1.2.

use super::{Along, Effect, Quantity, Reach, Seen, Site, shape, size};

pub struct Leakage;

/// Voltage at which the loss is stated, V.
const AT_V: f64 = 3000.0;
/// Area stretch at which the loss is stated.
const AT_AREA: f64 = 1.2;

impl Effect for Leakage {
    fn id(&self) -> &'static str {
        "leakage"
    }
    fn says(&self) -> &'static str {
        "a leakage current through the film or over its surface takes part of the voltage, more at a higher field"
    }
    fn source(&self) -> &'static str {
        "voltage divider with a conductance that grows with the field"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("loss_fraction", "1", 0.0, 0.5, 0.1),
                shape("field_exponent", "1", 1.5, 0.3, 4.0, 1.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Electrical
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.01, 0.7]], vec![vec![0.01, 2.0]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "the same pose at several voltages: payload steps under held voltages"
    }
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        if v[0] == 0.0 {
            return;
        }
        let x = v[0] / (1.0 - v[0]);
        for (i, phi) in phi_v.iter_mut().enumerate() {
            let field = phi.abs() / AT_V * along.area_stretch(i) / AT_AREA;
            // the field is that of the film's own voltage: Newton on y (1 + x (f y)^n) = 1
            let (mut y, n) = (1.0_f64, v[1]);
            for _ in 0..4 {
                let g = x * (field * y).powf(n);
                y = (y - (y * (1.0 + g) - 1.0) / (1.0 + (n + 1.0) * g)).max(1e-3);
            }
            *phi *= y;
        }
    }
}
