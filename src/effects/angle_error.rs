//! An angle of the drawing is off: theta_k1 = theta_b - omega - alpha, or theta_DEA = dea_offset - theta_SAM.
//! No cause of the catalogue (a wrong link does nearly the same), but a tolerance that every robot has.

use super::{Effect, Part, Quantity, Reach, Site, shape, size};
use crate::kinematics::{Lozenge, Mechanism};

pub struct AngleError;

/// omega + alpha (bicep to the amplifier's input link), dea_offset (amplifier's output to the lozenge).
const ANGLES: &[&str] = &["omega", "dea_offset"];

impl Effect for AngleError {
    fn id(&self) -> &'static str {
        "angle_error"
    }
    fn says(&self) -> &'static str {
        "an angle differs from the drawing"
    }
    fn source(&self) -> &'static str {
        "geometry (model, section 1)"
    }
    fn equation(&self) -> &'static str {
        "angle -> angle + error"
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::FourBar
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                shape("angle", "1", 0.0, 0.0, 1.0, 1.0),
                size("error", "rad", -0.1, 0.1, 0.01),
            ]
        }
    }
    fn variants(&self) -> &'static [&'static str] {
        ANGLES
    }
    fn site(&self) -> Site {
        Site::Motion
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn brought_out_by(&self) -> &'static str {
        "poses far off the axis in all directions; or a protractor"
    }
    fn geometry(&self, v: &[f64], on: [bool; 3], mechanism: &mut Mechanism, _: &mut [Lozenge; 3]) {
        for (chain, _) in mechanism.chains.iter_mut().zip(on).filter(|(_, on)| *on) {
            match v[0] as usize {
                0 => chain.input_offset_rad += v[1],
                _ => chain.dea_offset_rad += v[1],
            }
        }
    }
}
