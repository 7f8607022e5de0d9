//! The amplifier's gain or offset is wrong:  phi = (1 + e) phi_c + offset. The offset fades out below 50 V:
//! an amplifier that is told zero gives zero.

use super::{Along, Effect, Quantity, Reach, Seen, Site, size};

pub struct AmplifierGain;

/// Command at which half of the offset is there, V.
const FADE_V: f64 = 50.0;

impl Effect for AmplifierGain {
    fn id(&self) -> &'static str {
        "amplifier_gain"
    }
    fn says(&self) -> &'static str {
        "the amplifier gives another voltage than it is told: its gain or its offset is off"
    }
    fn source(&self) -> &'static str {
        "definition of gain and offset error"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("gain_error", "1", -0.4, 0.4, 0.06),
                size("offset", "V", -400.0, 400.0, 60.0),
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
        vec![vec![vec![0.01, 0.0], vec![0.0, 10.0]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "a known payload on and off under the same voltages, and the amplifier's own monitor output"
    }
    fn voltage(&self, v: &[f64], _: &Along, phi_v: &mut [f64]) {
        for phi in phi_v {
            let fade = 1.0 - (-(*phi / FADE_V).powi(2)).exp();
            *phi += v[0] * *phi + v[1] * fade * phi.signum();
        }
    }
}
