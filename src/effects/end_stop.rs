//! Stiff one-sided contact of the bicep at the upper edge of the workspace:  -k w ln(1 + exp((theta_b -
//! theta_stop)/w)) on theta_b, with w = 1 mrad, and damping in proportion to the force.

use super::{Along, Effect, Quantity, Reach, Seen, Site, shape, soft_plus};

pub struct EndStop;

impl Effect for EndStop {
    fn id(&self) -> &'static str {
        "end_stop"
    }
    fn says(&self) -> &'static str {
        "at the upper edge of its range the bicep rests against a stop"
    }
    fn source(&self) -> &'static str {
        "one-sided elastic contact with an edge that gives, and damping in proportion to its depth (Hunt and Crossley 1975)"
    }
    fn equation(&self) -> &'static str {
        "torque on theta_b: -stiffness edge ln(1 + e^((theta_b - theta_stop)/edge)) max(1 + damping \
         theta_b', 0)"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["amplifier_deadband", "joint_friction", "marker_offset"]
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                Quantity {
                    name: "theta_stop",
                    unit: "rad",
                    off: f64::INFINITY,
                    lower: 2.0,
                    upper: 6.0,
                    spread: 0.3,
                    size: true,
                },
                shape("stiffness", "N m/rad", 3.0, 0.01, 200.0, 6.0),
                shape("edge", "rad", 1e-3, 1e-4, 2e-2, 1e-3),
                shape("damping", "s", 0.0, 0.0, 1.0, 0.1),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, seen: &Seen) -> Vec<Vec<Vec<f64>>> {
        let [low, high] = seen.theta_b_rad;
        [0.003, 0.01, 0.03, 0.08]
            .iter()
            .map(|below| (high - below).max(low))
            .map(|s| vec![vec![s, 1.0, 1e-3, 0.0]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "slow ramps from zero through the lowest voltages, with and without payload"
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        if v[0].is_infinite() {
            return;
        }
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            let depth = v[2] * soft_plus((along.theta_b[i][0] - v[0]) / v[2]);
            // the contact pushes, and never pulls
            let push = (1.0 + v[3] * along.theta_b[i][1]).max(0.0);
            *t -= v[1] * depth * push / along.bicep_lever[i];
        }
    }
}
