//! The permittivity falls with the area stretch a = lambda_1 lambda_2:  eps = eps(1) g(a), g = 1 - slope (a -
//! 1). The capacitance is C g, so  d(C g)/d theta = C' (g + a g'/2), because C ~ a^2.

use super::{Along, Effect, Exercise, Part, Quantity, Reach, Seen, Site, shape, size};

pub struct PermittivityStretch;

impl Effect for PermittivityStretch {
    fn id(&self) -> &'static str {
        "permittivity_stretch"
    }
    fn says(&self) -> &'static str {
        "the film's permittivity falls as it is stretched, so the Maxwell stress is smaller than thought"
    }
    fn source(&self) -> &'static str {
        "first order in the area stretch; electrostriction of elastomers"
    }
    fn equation(&self) -> &'static str {
        "eps = eps(1) (1 - slope (x - curvature x^2)), x = lambda_1 lambda_2 - 1"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["amplifier_gain", "leakage"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("slope", "1", -0.3, 1.2, 0.25),
                shape("curvature", "1", 0.0, -0.5, 0.5, 0.2),
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
        vec![vec![vec![0.02, 0.0]]]
    }
    fn scales_made(&self) -> bool {
        true
    }
    fn brought_out_by(&self) -> &'static str {
        "the same pose at several voltages: payload steps under held voltages"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn capacitance(&self, v: &[f64], along: &Along, half_slope: &mut [f64]) {
        for (i, half) in half_slope.iter_mut().enumerate() {
            let a = along.area_stretch[i];
            let x = a - 1.0;
            *half *= 1.0 - v[0] * (x - v[1] * x * x) - 0.5 * v[0] * (1.0 - 2.0 * v[1] * x) * a;
        }
    }
}
