//! The lozenge's torsion hinges push back:  tau = -k (x + c x^3),  x = theta_DEA - rest_angle.

use super::{Along, Effect, Part, Quantity, Reach, Seen, Site, shape, size};

pub struct HingeStiffness;

impl Effect for HingeStiffness {
    fn id(&self) -> &'static str {
        "hinge_stiffness"
    }
    fn says(&self) -> &'static str {
        "the hinges of the lozenge are springs"
    }
    fn source(&self) -> &'static str {
        "flexure hinge, linear and cubic"
    }
    fn equation(&self) -> &'static str {
        "torque on theta_DEA: -stiffness (x + cubic x^3), x = theta_DEA - rest_angle"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["electrode_stiffness", "actuator_mass", "marker_offset"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Hinges
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("stiffness", "N m/rad", 0.0, 2.0, 0.2),
                shape("rest_angle", "rad", 2.3, 1.7, 3.0, 0.25),
                shape("cubic", "1/rad^2", 3.0, 0.0, 40.0, 8.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [2.05, 2.3, 2.55]
            .iter()
            .map(|&r| vec![vec![0.01, r, 3.0]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "one chain driven and the others passive, over the whole range of the lozenge"
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        for (t, theta) in torque_n_m.iter_mut().zip(along.theta_dea_rad) {
            let x = theta - v[1];
            *t -= v[0] * (x + v[2] * x * x * x);
        }
    }
}
