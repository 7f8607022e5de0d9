//! A conductance in parallel with the film, fed through a wire: the film sees less than the command, the more
//! the higher the field, and sees it later:  R d(C phi)/dt = phi_c - phi (1 + x (1 - n/m + n/m (E/E_0)^m)).
//! E_0 is the field at 3 kV on a film at area stretch 1.2, where x makes the loss at rest `loss_fraction`,
//! and where it grows with the power n of the field; m is 2, or n where that is larger: a conductance that
//! obeys Ohm's law at low fields. Without a resistance the loss is at once.

use super::series_resistance::charged;
use super::{Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site, shape, size};

pub struct Leakage;

/// Voltage at which the loss is stated, V.
const AT_V: f64 = 3000.0;
/// Area stretch at which the loss is stated.
const AT_AREA: f64 = 1.2;
/// Power of the field with which a conductance begins to grow.
const GROWS: f64 = 2.0;
/// Steps of the fixed point in which a film that is charged through a wire finds its loss.
const ROUNDS: usize = 3;

/// The values of a leak as the current through it asks for them.
struct Leak {
    /// The share of the current that does not grow, and the one that does at the stated field, over the
    /// current through the wire.
    constant: f64,
    growing: f64,
    power: f64,
}

impl Leak {
    fn new(v: &[f64]) -> Self {
        let power = v[1].max(GROWS);
        let share = v[1] / power;
        let x = v[0] / (1.0 - v[0]);
        Leak {
            constant: x * (1.0 - share),
            growing: x * share,
            power,
        }
    }

    /// The current through the leak over the one that the film's voltage `phi_v` would drive through the wire,
    /// and how much more that is for a voltage larger by a share of it.
    fn grown(&self, along: &Along, i: usize, phi_v: f64) -> [f64; 2] {
        let field = phi_v.abs() * along.area_stretch[i] * (1.0 / (AT_V * AT_AREA));
        let power = match self.power == GROWS {
            true => field * field,
            false => field.powf(self.power),
        };
        let growing = self.growing * power;
        [self.constant + growing, self.power * growing]
    }

    /// What is left of a command of `told_v` that is held: Newton on y (1 + leak(y)) = 1.
    fn at_rest(&self, along: &Along, i: usize, told_v: f64) -> f64 {
        let mut y = 1.0_f64;
        for _ in 0..4 {
            let [g, more] = self.grown(along, i, told_v * y);
            y = (y - (y * (1.0 + g) - 1.0) / (1.0 + g + more)).max(1e-3);
        }
        told_v * y
    }
}

/// The current through the leak over the one that the film's voltage `phi_v` would drive through the wire.
pub(crate) fn leak(v: &[f64], along: &Along, i: usize, phi_v: f64) -> f64 {
    Leak::new(v).grown(along, i, phi_v)[0]
}

impl Effect for Leakage {
    fn id(&self) -> &'static str {
        "leakage"
    }
    fn says(&self) -> &'static str {
        "a leakage current through the film or over its surface takes part of the voltage, more at a higher field"
    }
    fn source(&self) -> &'static str {
        "voltage divider with a conductance that grows with the field, Kirchhoff's law for the wire before it"
    }
    fn equation(&self) -> &'static str {
        "resistance (C phi)' = phi_c - phi (1 + x (1 - n/m + n/m (E/E_0)^m)), \
         x = loss_fraction/(1 - loss_fraction), n = field_exponent, m = max(n, 2), E_0 the field at 3 kV"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "amplifier_gain",
            "permittivity_stretch",
            "amplifier_saturation",
        ]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("loss_fraction", "1", 0.0, 0.5, 0.1),
                shape("field_exponent", "1", 1.5, 0.3, 4.0, 1.0),
                shape("resistance", "ohm", 0.0, 0.0, 1e8, 3e6),
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
        [[0.5, 0.0], [2.0, 0.0], [1.0, 2e6]]
            .iter()
            .map(|[exponent, wire]| vec![vec![0.01, *exponent, *wire]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "the same pose at several voltages: payload steps under held voltages"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn remembers(&self) -> bool {
        true
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Charge
    }
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        if v[0] == 0.0 {
            return;
        }
        let own = Leak::new(v);
        if v[2] > 0.0 {
            let first_v = own.at_rest(along, 0, phi_v[0]);
            let leak = |i: usize, phi: f64| own.grown(along, i, phi)[0];
            charged(|_| v[2], along, first_v, ROUNDS, leak, phi_v);
            return;
        }
        for (i, phi) in phi_v.iter_mut().enumerate() {
            *phi = own.at_rest(along, i, *phi);
        }
    }
}
