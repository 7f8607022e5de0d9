//! The capture system filters and delays positions: a second-order low-pass of damping 0.7, whose inverse is
//! u = u_m + 1.4 tau u_m' + tau^2 u_m''; `delay` is 1.4 tau.

use super::{Effect, Quantity, Reach, Reading, Seen, Site, size};
use crate::kinematics::Vec3;

pub struct MocapLag;

/// Damping of the low-pass, twice: delay over tau.
const DELAY_PER_TAU: f64 = 1.4;

/// The derivative of a sampled series by central differences.
fn derivative(x: &[Vec3], step_s: f64) -> Vec<Vec3> {
    let n = x.len();
    (0..n)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            let h = step_s * (b - a).max(1) as f64;
            [0, 1, 2].map(|k| (x[b][k] - x[a][k]) / h)
        })
        .collect()
}

impl Effect for MocapLag {
    fn id(&self) -> &'static str {
        "mocap_lag"
    }
    fn says(&self) -> &'static str {
        "the capture system smooths and delays the motion"
    }
    fn source(&self) -> &'static str {
        "second-order low-pass, inverted"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("delay", "s", 0.0, 0.4, 0.05)] }
    }
    fn site(&self) -> Site {
        Site::Motion
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [0.005, 0.03, 0.08].iter().map(|&d| vec![vec![d]]).collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "fast drives above 2 Hz: a filter rounds the motion, an offset does not"
    }
    fn reading(&self, v: &[f64], motion: &mut Reading) {
        if v[0] == 0.0 {
            return;
        }
        let square = (v[0] / DELAY_PER_TAU).powi(2);
        let jerk = derivative(motion.acceleration_m_s2, motion.step_s);
        let snap = derivative(&jerk, motion.step_s);
        for i in 0..motion.position_m.len() {
            for k in 0..3 {
                motion.position_m[i][k] +=
                    v[0] * motion.velocity_m_s[i][k] + square * motion.acceleration_m_s2[i][k];
                motion.velocity_m_s[i][k] +=
                    v[0] * motion.acceleration_m_s2[i][k] + square * jerk[i][k];
                motion.acceleration_m_s2[i][k] += v[0] * jerk[i][k] + square * snap[i][k];
            }
        }
    }
}
