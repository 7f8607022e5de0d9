//! Dry friction in the bicep joints with presliding (Dahl 1968):  z follows the direction of the motion over the angle x0,
//! dz = (sign(d theta) - z)(1 - e^(-|d theta|/x0)), torque -F z on theta_b. Increments of the angle, not the sign of a rate: the sign of
//! a noisy rate is noise.

use super::{Along, Effect, Quantity, Reach, Seen, Site, shape, size};

pub struct JointFriction;

impl Effect for JointFriction {
    fn id(&self) -> &'static str {
        "joint_friction"
    }
    fn says(&self) -> &'static str {
        "dry friction in the bicep joints resists the motion, whatever its rate"
    }
    fn source(&self) -> &'static str {
        "Dahl 1968, presliding"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("torque", "N m", 0.0, 1e-2, 5e-4),
                shape("presliding", "rad", 6e-3, 3e-4, 0.08, 6e-3),
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
        [2e-3, 1e-2].iter().map(|&x| vec![vec![1e-5, x]]).collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "slow triangles of several amplitudes"
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        if v[0] == 0.0 {
            return;
        }
        let mut z = 0.0;
        for i in 0..torque_n_m.len() {
            if i > 0 {
                let d = along.theta_b[i][0] - along.theta_b[i - 1][0];
                z += (d.signum() - z) * (1.0 - (-d.abs() / v[1]).exp());
            }
            torque_n_m[i] -= v[0] * z / along.bicep_lever[i];
        }
    }
}
