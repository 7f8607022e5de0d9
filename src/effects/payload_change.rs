//! A mass appears on (or leaves) the end effector:  mass (u'' + g Z) more from a time on; lasting.

use super::{Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site, shape, size};

pub struct PayloadChange;

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.80665;

impl Effect for PayloadChange {
    fn id(&self) -> &'static str {
        "payload_change"
    }
    fn says(&self) -> &'static str {
        "from one moment on the end effector carries another mass than stated"
    }
    fn source(&self) -> &'static str {
        "weight and inertia (model, section 4)"
    }
    fn equation(&self) -> &'static str {
        "force on the end effector: -mass (u'' + g Z), from the time on"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["electrode_failure", "temperature_drift"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Effector
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("mass", "kg", -0.05, 0.05, 2e-3),
                shape("time", "s", 0.0, -1e6, 1e6, 1e4),
                shape("recording", "1", 0.0, 0.0, 1e6, 1e4),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        Vec::new() // looked for over all times
    }
    fn brought_out_by(&self) -> &'static str {
        "a scale, and a repeat of the first recording"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Again, Exercise::Staircase]
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Velocity
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            if along.after(i, v[2], v[1]) {
                let (lever, a) = (along.force_lever[i], along.acceleration_m_s2[i]);
                *t -= v[0] * (lever[0] * a[0] + lever[1] * a[1] + lever[2] * (a[2] + GRAVITY_M_S2));
            }
        }
    }
}
