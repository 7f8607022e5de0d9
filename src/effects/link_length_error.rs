//! A link differs from its drawing:  length (1 + relative_error), in all chains or in one.

use super::{Effect, Part, Quantity, Reach, Seen, Site, shape, size};
use crate::kinematics::{Lozenge, Mechanism};

pub struct LinkLengthError;

const LINKS: &[&str] = &["l_ch", "l_end", "q", "n0", "a", "b", "c", "d"];

impl Effect for LinkLengthError {
    fn id(&self) -> &'static str {
        "link_length_error"
    }
    fn says(&self) -> &'static str {
        "a link is longer or shorter than drawn"
    }
    fn source(&self) -> &'static str {
        "geometry (model, section 1)"
    }
    fn equation(&self) -> &'static str {
        "length -> length (1 + relative_error)"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["marker_offset", "actuator_mass", "hinge_stiffness"]
    }
    fn part(&self, v: &[f64]) -> Part {
        match LINKS[v[0] as usize % LINKS.len()] {
            "l_ch" => Part::Base,
            "l_end" => Part::Effector,
            "q" => Part::Bicep,
            "n0" => Part::Forearm,
            _ => Part::FourBar,
        }
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                shape("link", "1", 0.0, 0.0, 7.0, 1.0),
                size("relative_error", "1", -0.1, 0.1, 0.015),
            ]
        }
    }
    fn variants(&self) -> &'static [&'static str] {
        LINKS
    }
    fn site(&self) -> Site {
        Site::Motion
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        (0..LINKS.len())
            .map(|l| vec![vec![l as f64, 1e-3]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "poses far off the axis in all directions; or a calliper"
    }
    fn geometry(&self, v: &[f64], on: [bool; 3], mechanism: &mut Mechanism, _: &mut [Lozenge; 3]) {
        for (chain, _) in mechanism.chains.iter_mut().zip(on).filter(|(_, on)| *on) {
            if let Some(length) = chain.lengths_mut().into_iter().nth(v[0] as usize) {
                *length *= 1.0 + v[1];
            }
        }
    }
}
