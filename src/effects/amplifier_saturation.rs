//! The output does not exceed a ceiling (soft knee):  phi = phi_c - w ln(1 + exp((phi_c - ceiling)/w)).

use super::{Along, Effect, Exercise, Part, Quantity, Reach, Seen, Site, shape, soft_plus};

pub struct AmplifierSaturation;

impl Effect for AmplifierSaturation {
    fn id(&self) -> &'static str {
        "amplifier_saturation"
    }
    fn says(&self) -> &'static str {
        "the amplifier's output does not rise above a ceiling"
    }
    fn source(&self) -> &'static str {
        "limit of the converter's output with a soft knee"
    }
    fn equation(&self) -> &'static str {
        "phi = sign(phi_c) (|phi_c| - knee ln(1 + e^((|phi_c| - ceiling)/knee)))"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["leakage", "loss_of_tension"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Amplifier
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                Quantity {
                    name: "ceiling",
                    unit: "V",
                    off: f64::INFINITY,
                    lower: 500.0,
                    upper: 2e4,
                    spread: 1500.0,
                    size: true,
                },
                shape("knee", "V", 80.0, 5.0, 500.0, 80.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Electrical
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, seen: &Seen) -> Vec<Vec<Vec<f64>>> {
        [0.98, 0.93, 0.86, 0.76]
            .iter()
            .map(|s| vec![vec![s * seen.voltage_v, 80.0]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "a slow ramp to the highest voltage"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn voltage(&self, v: &[f64], _: &Along, phi_v: &mut [f64]) {
        if v[0].is_infinite() {
            return;
        }
        for phi in phi_v {
            let size = phi.abs() - v[1] * soft_plus((phi.abs() - v[0]) / v[1]);
            *phi = size * phi.signum();
        }
    }
}
