//! One clock runs fast: the command is read at (1 + skew) t, t from the first frame.

use super::{Effect, Exercise, Part, Quantity, Reach, Seen, Site, size};

pub struct ClockSkew;

impl Effect for ClockSkew {
    fn id(&self) -> &'static str {
        "clock_skew"
    }
    fn says(&self) -> &'static str {
        "one of the two clocks runs fast, so that they drift apart within a recording"
    }
    fn source(&self) -> &'static str {
        "definition of the skew"
    }
    fn equation(&self) -> &'static str {
        "phi_c is read at (1 + skew) t, t from the first frame"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["time_offset", "temperature_drift"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Clocks
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("skew", "1", -0.05, 0.05, 4e-3)] }
    }
    fn site(&self) -> Site {
        Site::Clock
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [3e-4, -3e-3, 3e-3].iter().map(|&s| vec![vec![s]]).collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "a long recording with the same fast drive at its beginning and end"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Rates, Exercise::Staircase]
    }
    fn clock(&self, v: &[f64], t_s: f64) -> f64 {
        t_s + v[0] * t_s
    }
}
