//! One actuator's film has another thickness: L3 -> L3 thickness_factor in one chain (film torque ~ L3, Maxwell torque ~ 1/L3).

use super::{Effect, Quantity, Reach, Seen, Site};
use crate::kinematics::{Lozenge, Mechanism};

pub struct ActuatorAsymmetry;

impl Effect for ActuatorAsymmetry {
    fn id(&self) -> &'static str {
        "actuator_asymmetry"
    }
    fn says(&self) -> &'static str {
        "the film of one actuator is thicker or thinner than the others"
    }
    fn source(&self) -> &'static str {
        "thickness in the energy balance (model, section 3)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[Quantity {
                name: "thickness_factor",
                unit: "1",
                off: 1.0,
                lower: 0.6,
                upper: 1.6,
                spread: 0.08,
                size: true,
            }]
        }
    }
    fn site(&self) -> Site {
        Site::Motion
    }
    fn reach(&self) -> Reach {
        Reach::One
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1.01]]]
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
