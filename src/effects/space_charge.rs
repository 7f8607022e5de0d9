//! Charge creeps into the film and holds off part of the voltage:  phi = phi_c - s,  s' = (x phi_c - s)/tau,
//! none at the first sample.

use super::{Along, Effect, Memory, Part, Quantity, Reach, Seen, Site, decays, shape, size};

pub struct SpaceCharge;

impl Effect for SpaceCharge {
    fn id(&self) -> &'static str {
        "x_space_charge"
    }
    fn says(&self) -> &'static str {
        "charge that creeps into the film holds off part of the voltage, and decays in minutes"
    }
    fn source(&self) -> &'static str {
        "one trap level of first order"
    }
    fn equation(&self) -> &'static str {
        "phi = phi_c - s, s' = (fraction phi_c - s)/time_constant"
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("fraction", "1", 0.0, 0.5, 0.05),
                shape("time_constant", "s", 60.0, 5.0, 1000.0, 60.0),
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
        [15.0, 100.0]
            .iter()
            .map(|tau| vec![vec![0.01, *tau]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "the same drive with one polarity, with alternating ones, and after a rest of ten minutes"
    }
    fn remembers(&self) -> bool {
        true
    }
    fn memory(&self) -> Memory<'_> {
        Memory::HeldOff
    }
    fn voltage(&self, v: &[f64], along: &Along, phi_v: &mut [f64]) {
        if v[0] == 0.0 {
            return;
        }
        let (decay, mean) = decays(along.step_s / v[1]);
        let mut held = 0.0;
        let mut before = phi_v[0];
        for (i, phi) in phi_v.iter_mut().enumerate() {
            let now = *phi;
            if i > 0 {
                held = held * decay + v[0] * (before * (mean - decay) + now * (1.0 - mean));
            }
            before = now;
            *phi = now - held;
        }
    }
}
