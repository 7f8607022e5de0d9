//! From a time on part of the active area has lost contact:  C, C' -> (1 - fraction) C, C' of one actuator;
//! lasting.

use super::{Along, Effect, Exercise, Part, Quantity, Reach, Seen, Site, shape, size};

pub struct ElectrodeFailure;

impl Effect for ElectrodeFailure {
    fn id(&self) -> &'static str {
        "electrode_failure"
    }
    fn says(&self) -> &'static str {
        "at one moment part of an electrode has lost contact, and with it Maxwell torque"
    }
    fn source(&self) -> &'static str {
        "capacitance in proportion to the contacted area"
    }
    fn equation(&self) -> &'static str {
        "C -> (1 - fraction) C of one actuator, from the time on"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["payload_change", "actuator_asymmetry"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("fraction", "1", 0.0, 1.0, 0.2),
                shape("time", "s", 0.0, -1e6, 1e6, 1e4),
                shape("recording", "1", 0.0, 0.0, 1e6, 1e4),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Electrical
    }
    fn reach(&self) -> Reach {
        Reach::One
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        Vec::new() // looked for over all times
    }
    fn brought_out_by(&self) -> &'static str {
        "a repeat of the first recording"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn capacitance(&self, v: &[f64], along: &Along, half_slope: &mut [f64]) {
        for (i, half) in half_slope.iter_mut().enumerate() {
            if along.after(i, v[2], v[1]) {
                *half *= 1.0 - v[0];
            }
        }
    }
}
