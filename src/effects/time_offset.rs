//! Voltage and motion clocks differ by a constant: the command is read at t + offset.

use super::{Effect, Exercise, Part, Quantity, Reach, Seen, Site, size};

pub struct TimeOffset;

impl Effect for TimeOffset {
    fn id(&self) -> &'static str {
        "time_offset"
    }
    fn says(&self) -> &'static str {
        "the clocks of voltage and motion are a constant time apart"
    }
    fn source(&self) -> &'static str {
        "definition of the offset (voltage clock minus motion clock)"
    }
    fn equation(&self) -> &'static str {
        "phi_c is read at t + offset"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["series_resistance", "mocap_lag"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Clocks
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("offset", "s", -0.6, 0.6, 0.06)] }
    }
    fn site(&self) -> Site {
        Site::Clock
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [0.005, -0.03, 0.03, -0.1, 0.1]
            .iter()
            .map(|&d| vec![vec![d]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "fast drives above 2 Hz: an offset is the same time at every rate"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Rates, Exercise::Staircase]
    }
    fn clock(&self, v: &[f64], t_s: f64) -> f64 {
        t_s + v[0]
    }
}
