//! The film of an actuator is thicker or thinner than drawn, as a part: the lozenge itself differs, so that a
//! mechanism that is taken as found has it exactly, where the cause `actuator_asymmetry` changes what a fixed
//! one makes.

use super::{Effect, Part, Quantity, Reach, Site, size};
use crate::kinematics::{Lozenge, Mechanism};

pub struct ThicknessError;

impl Effect for ThicknessError {
    fn id(&self) -> &'static str {
        "actuator_asymmetry"
    }
    fn says(&self) -> &'static str {
        "the film of an actuator is thicker or thinner than drawn"
    }
    fn source(&self) -> &'static str {
        "thickness in the energy balance (model, section 3)"
    }
    fn equation(&self) -> &'static str {
        "L3 -> thickness_factor L3"
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[Quantity {
                off: 1.0,
                ..size("thickness_factor", "1", 0.6, 1.6, 0.08)
            }]
        }
    }
    fn site(&self) -> Site {
        Site::Motion
    }
    fn reach(&self) -> Reach {
        Reach::One
    }
    fn share_of_made(&self, v: &[f64]) -> f64 {
        1.0 - v[0]
    }
    fn scales_made(&self) -> bool {
        true
    }
    fn brought_out_by(&self) -> &'static str {
        "the actuators driven one after the other with the same voltage"
    }
    fn geometry(&self, v: &[f64], on: [bool; 3], _: &mut Mechanism, lozenges: &mut [Lozenge; 3]) {
        for (lozenge, _) in lozenges.iter_mut().zip(on).filter(|(_, on)| *on) {
            lozenge.l3_m *= v[0];
        }
    }
}
