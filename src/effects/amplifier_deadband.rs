//! Below a threshold the output stays near zero, above it follows the command:  phi = phi_c s((|phi_c| -
//! threshold)/w), s a soft step.

use super::{Along, Effect, Exercise, Part, Quantity, Reach, Seen, Site, shape, size, soft_step};

pub struct AmplifierDeadband;

impl Effect for AmplifierDeadband {
    fn id(&self) -> &'static str {
        "amplifier_deadband"
    }
    fn says(&self) -> &'static str {
        "the amplifier gives nothing below a threshold of its command"
    }
    fn source(&self) -> &'static str {
        "dead band of high-voltage converters; soft edge"
    }
    fn equation(&self) -> &'static str {
        "phi = phi_c/(1 + e^(-(|phi_c| - threshold)/edge))"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["end_stop", "joint_friction near rest"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Amplifier
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("threshold", "V", 0.0, 3000.0, 500.0),
                shape("edge", "V", 40.0, 5.0, 300.0, 60.0),
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
        [250.0, 450.0, 700.0, 1000.0, 1400.0, 1900.0, 2400.0]
            .iter()
            .filter(|t| **t < 0.5 * seen.voltage_v)
            .map(|&t| vec![vec![t, 40.0]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "slow ramps from zero through the lowest voltages"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn voltage(&self, v: &[f64], _: &Along, phi_v: &mut [f64]) {
        if v[0] == 0.0 {
            return;
        }
        for phi in phi_v {
            *phi *= soft_step((phi.abs() - v[0]) / v[1]);
        }
    }
}
