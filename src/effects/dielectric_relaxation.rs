//! Part of the polarisation follows the field slowly:  phi^2 -> (1 - x - y) phi^2 + x psi_1^2 + y psi_2^2,
//! tau_j psi_j' = phi - psi_j. Two shares, because one time leaves structure: `time_constant`, and fifteen
//! times that.

use super::{
    Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site, decays, shape, size,
};

pub struct DielectricRelaxation;

/// The slow share's time over the fast one's.
const SLOWER: f64 = 15.0;

impl Effect for DielectricRelaxation {
    fn id(&self) -> &'static str {
        "dielectric_relaxation"
    }
    fn says(&self) -> &'static str {
        "part of the film's polarisation follows the voltage slowly"
    }
    fn source(&self) -> &'static str {
        "Debye relaxation with two times"
    }
    fn equation(&self) -> &'static str {
        "phi^2 = (1 - x - y) phi_c^2 + x psi_1^2 + y psi_2^2, tau_j psi_j' = phi_c - psi_j, x = \
         fraction, y = slow_fraction, tau_1 = time_constant, tau_2 = 15 tau_1"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "slow branches of the film",
            "series_resistance",
            "slow_creep",
        ]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("fraction", "1", 0.0, 0.6, 0.1),
                shape("time_constant", "s", 0.4, 0.05, 75.0, 0.5),
                size("slow_fraction", "1", 0.0, 0.6, 0.1),
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
        vec![vec![vec![0.02, 0.4, 0.0], vec![0.0, 0.4, 0.02]]]
    }
    /// The slow share alone, where it is the larger one: what the fast one takes up may be noise.
    fn plainer(&self, v: &[f64]) -> Option<Vec<f64>> {
        (v[2] > v[0]).then(|| vec![v[2], SLOWER * v[1], 0.0])
    }
    fn brought_out_by(&self) -> &'static str {
        "voltage steps with holds of tens of seconds, and a load step under constant voltage"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn remembers(&self) -> bool {
        true
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Polarisation
    }
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        let (x, y) = (v[0], v[2]);
        if x == 0.0 && y == 0.0 {
            return;
        }
        let times = [v[1], SLOWER * v[1]];
        let mut psi = [phi_v[0]; 2];
        let mut before = phi_v[0];
        for phi in phi_v {
            let now = *phi;
            for (p, t) in psi.iter_mut().zip(times) {
                let (decay, mean) = decays(along.step_s / t);
                *p = *p * decay + before * (mean - decay) + now * (1.0 - mean);
            }
            before = now;
            let square = (1.0 - x - y) * now * now + x * psi[0] * psi[0] + y * psi[1] * psi[1];
            *phi = square.max(0.0).sqrt();
        }
    }
}
