//! One actuator's film has another thickness: L3 -> L3 thickness_factor in one chain (film torque ~ L3,
//! Maxwell torque ~ 1/L3).

use super::{Along, Effect, Part, Quantity, Reach, Seen, Site};
use crate::film::Film;

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
    fn equation(&self) -> &'static str {
        "L3 -> thickness_factor L3 of one actuator: film torque ~ L3, Maxwell torque ~ 1/L3"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "link_length_error of one chain",
            "frame_tilt",
            "amplifier_gain of one actuator",
        ]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
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
        Site::Film
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
    fn capacitance(&self, v: &[f64], _: &Along, half_slope: &mut [f64]) {
        half_slope.iter_mut().for_each(|h| *h /= v[0]);
    }
    fn stress(&self, v: &[f64], _: &Along, _: &Film, factor: &mut [[f64; 2]]) {
        for f in factor {
            *f = f.map(|f| f * v[0]);
        }
    }
}
