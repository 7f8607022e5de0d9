//! Dry friction in the bicep joints with presliding (Dahl 1968):  z follows the direction of the motion over
//! the angle x0, dz = (sign(d theta) g - z)(1 - e^(-|d theta|/(g x0))), g = 1 + s e^(-(theta'/0.1)^2)
//! (Stribeck; Canudas de Wit 1995), torque -F z on theta_b. Increments of the angle, not the sign of a rate:
//! the sign of a noisy rate is noise.

use super::{Along, Effect, Exercise, Memory, Quantity, Reach, Seen, Site, shape, size};

pub struct JointFriction;

/// Rate at which the additional torque of sticking has fallen to 1/e, rad/s.
const STRIBECK_RAD_S: f64 = 0.1;

/// Friction at a rate over that at a high one.
pub(crate) fn level(sticking: f64, rate_rad_s: f64) -> f64 {
    1.0 + sticking * (-(rate_rad_s / STRIBECK_RAD_S).powi(2)).exp()
}

impl Effect for JointFriction {
    fn id(&self) -> &'static str {
        "joint_friction"
    }
    fn says(&self) -> &'static str {
        "dry friction in the bicep joints resists the motion, whatever its rate"
    }
    fn source(&self) -> &'static str {
        "Dahl 1968, presliding; Stribeck"
    }
    fn equation(&self) -> &'static str {
        "torque on theta_b: -torque z, dz = (g sign(d theta_b) - z)(1 - e^(-|d theta_b|/(g \
         presliding))), g = 1 + sticking e^(-(theta_b'/0.1 rad/s)^2)"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "the film's hysteresis",
            "joint_damping",
            "amplifier_deadband",
        ]
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("torque", "N m", 0.0, 1e-2, 5e-4),
                shape("presliding", "rad", 6e-3, 3e-4, 0.08, 6e-3),
                shape("sticking", "1", 0.0, 0.0, 1.0, 0.3),
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
        [2e-3, 1e-2]
            .iter()
            .map(|&x| vec![vec![1e-5, x, 0.0]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "slow triangles of several amplitudes"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Reversals, Exercise::Rates]
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Presliding
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        if v[0] == 0.0 {
            return;
        }
        let mut z = 0.0;
        for i in 0..torque_n_m.len() {
            if i > 0 {
                let d = along.theta_b[i][0] - along.theta_b[i - 1][0];
                let level = level(v[2], d / along.step_s);
                z += (d.signum() * level - z) * (1.0 - (-d.abs() / (v[1] * level)).exp());
            }
            torque_n_m[i] -= v[0] * z / along.bicep_lever[i];
        }
    }
}
