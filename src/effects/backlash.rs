//! Something elastic (a loom, a worn hinge) follows the bicep with play:  -k (s - s_0) on theta_b, where s is
//! theta_b moved only where one end of the play pushes it, |theta_b - s| <= play, and s_0 its first value.

use super::{Along, Effect, Memory, Quantity, Reach, Seen, Site, shape, size};

pub struct Backlash;

impl Effect for Backlash {
    fn id(&self) -> &'static str {
        "x_backlash"
    }
    fn says(&self) -> &'static str {
        "something elastic follows the bicep with play, and rests at each reversal"
    }
    fn source(&self) -> &'static str {
        "play operator (Krasnosel'skii and Pokrovskii 1989)"
    }
    fn equation(&self) -> &'static str {
        "torque on theta_b: -stiffness (s - s_0), s moves only where |theta_b - s| would exceed play"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("stiffness", "N m/rad", 0.0, 1.0, 2e-2),
                shape("play", "rad", 0.03, 1e-3, 0.3, 0.03),
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
        [0.01, 0.04, 0.1]
            .iter()
            .map(|play| vec![vec![1e-3, *play]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "reversals at several amplitudes, without and with a pre-load"
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Play
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        let Some(first) = along.theta_b.first().map(|t| t[0]) else {
            return;
        };
        let mut s = first;
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            let theta = along.theta_b[i][0];
            s = s.max(theta - v[1]).min(theta + v[1]);
            *t -= v[0] * (s - first) / along.bicep_lever[i];
        }
    }
}
