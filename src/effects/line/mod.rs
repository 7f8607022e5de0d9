//! What the plain model of a single coordinate leaves out: a hinge bench, an axis, a film coupon. One cause a
//! file.
//!
//! Values are in units of the recordings, so that one form serves a hinge of millinewton metres and a slide
//! of kilonewtons: `coordinate` is the largest excursion from rest, `force` the largest measured force
//! (torque, stress), `input` the largest input. Reports and files give them in the units of the rig.

mod backlash;
mod branch_stretch;
mod clock_offset;
mod creep;
mod damping;
mod deadband;
mod direction_damping;
mod drift;
mod drive_lag;
mod drive_power;
mod drive_second_order;
mod drive_stroke;
mod end_stop;
mod friction;
mod grip;
mod law;
mod load_friction;
mod mean_drift;
mod nonlinear_stiffness;
mod permanent_set;
mod quadratic_damping;
mod rate_friction;
mod saturation;
mod second_invariant;
mod slack;
mod softening;
mod stribeck;
mod stroke_damping;
mod stroke_inertia;
mod under_way;

use super::{Effect, Quantity};
pub use law::{At, Dual, Forward, LANES, Law, Memory, Moment, Point, Real};
pub(crate) use under_way::UnderWay;

/// What was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Angle and torque of a flexure.
    Bench,
    /// One drive, one coordinate.
    Axis,
    /// Stretch and stress of a film.
    Coupon,
}

/// A recording, as a cause sees it.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// Number in the series.
    pub recording: usize,
    /// What the memory of a cause held where the recording begins, beyond what the beginning makes.
    pub held: f64,
    /// Whether times are times, or numbers of rows.
    pub timed: bool,
    /// Time of each sample, s.
    pub time_s: &'a [f64],
    /// Distance of the samples, s.
    pub step_s: f64,
    /// From the first sample to the last, s.
    pub duration_s: f64,
    /// The first sample in the time of the series, s.
    pub series_s: f64,
    /// Whether springs are known to be without strain where the excursion is 0: those of a coupon.
    pub unstrained: bool,
    /// Whether springs are straight lines: those of an axis.
    pub straight: bool,
    /// Excursion from rest, over the largest one.
    pub xi: &'a [f64],
    /// The excursion as far as its noise does not make it: what holds still goes no way.
    pub way: &'a [f64],
    /// Rate of the excursion, 1/s.
    pub rate: &'a [f64],
    /// The fastest rate, 1/s.
    pub speed: f64,
    /// Second derivative of the excursion, 1/s^2 (axis; otherwise empty).
    pub acceleration: &'a [f64],
    /// Whether it has a mass.
    pub inertial: bool,
    /// Force of the springs at the current model, over the largest measured force.
    pub elastic: &'a [f64],
    /// Stress of the second invariant for a unit of its modulus (coupon; otherwise 0).
    pub second: &'a [f64],
}

impl View<'_> {
    /// The least and the largest excursion, rest among them.
    fn range(&self) -> [f64; 2] {
        let wider = |all: [f64; 2], x: &f64| [all[0].min(*x), all[1].max(*x)];
        self.xi.iter().fold([0.0; 2], wider)
    }
}

/// What a cause may change.
#[derive(Debug)]
pub struct Terms {
    /// The excursion that springs see.
    pub xi: Vec<f64>,
    /// Multiplies the force of [equilibrium spring, branches].
    pub factor: Vec<[f64; 2]>,
    /// Force that the model asks for beside that of the plain model, over the largest measured one.
    pub force: Vec<f64>,
    /// The input over its largest value, on its own clock.
    pub input: Vec<f64>,
    /// Distance of the input's samples, s.
    pub input_step_s: f64,
    /// Multiplies the input at the samples of the motion.
    pub gain: Vec<f64>,
    /// The input is read this much later, s.
    pub shift_s: f64,
}

/// The input that a cause was given, worked out backwards from what it made of it.
#[derive(Debug)]
pub struct Undone {
    /// Distance of the samples, s.
    pub step_s: f64,
    /// The input over its largest value.
    pub input: Vec<f64>,
    /// Whether what the cause made of it tells the input: a ceiling says no more than "at least".
    pub told: Vec<bool>,
    /// Standard deviation of what the cause made of it, over the largest input.
    pub noise: f64,
}

impl Undone {
    /// Adds `first` times the derivative and `second` times the second one, s and s^2, by central
    /// differences; samples without both neighbours are not told.
    fn add_derivatives(&mut self, first: f64, second: f64) {
        let n = self.input.len();
        let before = self.input.clone();
        let known = self.told.clone();
        let h = self.step_s;
        for i in 0..n {
            if i == 0 || i + 1 >= n || !(known[i - 1] && known[i] && known[i + 1]) {
                self.told[i] = false;
                continue;
            }
            let (a, b, c) = (before[i - 1], before[i], before[i + 1]);
            self.input[i] += first * (c - a) / (2.0 * h) + second * (c - 2.0 * b + a) / (h * h);
        }
    }
}

/// A cause on a single coordinate.
pub trait LineEffect: Effect {
    /// Where it makes sense.
    fn kinds(&self) -> &'static [Kind];
    /// Where a scan looks: values near off, one group a start.
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>>;
    /// What its memory may hold where a recording begins while it is under way, beyond what the beginning
    /// makes; `None` where it has none, or forgets: friction, and creep, which is told from friction by nothing
    /// else where one loop is all there is.
    fn held(&self, _v: &[f64]) -> Option<Quantity> {
        None
    }
}

/// Every cause that is known on a single coordinate.
pub const CATALOGUE: &[&dyn LineEffect] = &[
    &friction::Friction,
    &load_friction::LoadFriction,
    &stribeck::Stribeck,
    &rate_friction::RateFriction,
    &quadratic_damping::QuadraticDamping,
    &direction_damping::DirectionDamping,
    &damping::Damping,
    &stroke_inertia::StrokeInertia,
    &nonlinear_stiffness::NonlinearStiffness,
    &end_stop::EndStop,
    &backlash::Backlash,
    &creep::Creep,
    &softening::Softening,
    &permanent_set::PermanentSet,
    &saturation::Saturation,
    &deadband::Deadband,
    &drive_power::DrivePower,
    &drive_lag::DriveLag,
    &drive_second_order::DriveSecondOrder,
    &drive_stroke::DriveStroke,
    &clock_offset::ClockOffset,
    &branch_stretch::BranchStretch,
    &second_invariant::SecondInvariant,
    &slack::Slack,
    &grip::Grip,
    &drift::Drift,
    &mean_drift::MeanDrift,
];

/// Causes that are told from others only where the motion is run forward: a diagnosis, which works out the
/// input that a motion needs, does not think of them.
pub const FORWARD_ONLY: &[&dyn LineEffect] = &[&stroke_damping::StrokeDamping];

/// Every cause of both lists.
pub fn every() -> impl Iterator<Item = &'static dyn LineEffect> {
    CATALOGUE.iter().chain(FORWARD_ONLY).copied()
}

/// The cause with this id.
#[must_use]
pub fn by_id(id: &str) -> Option<&'static dyn LineEffect> {
    every().find(|e| e.id() == id)
}

/// Whether the motion can be run forward with a cause: it has a law, or acts on the input or its clock alone.
#[must_use]
pub fn runs_forward(effect: &dyn Effect) -> bool {
    effect.law().is_some() || effect.drives() || effect.id() == clock_offset::ID
}

/// What holds within `noise` on either side of a course: a play, which follows the course once that has left
/// its width.
pub(crate) fn played(xi: &[f64], noise: f64) -> Vec<f64> {
    let mut at = xi.first().copied().unwrap_or(0.0);
    xi.iter()
        .map(|x| {
            at = at.clamp(x - noise, x + noise);
            at
        })
        .collect()
}

/// The state of sliding along a course without noise, from -1 to 1: it follows the direction over the
/// distance `presliding`.
pub(crate) fn sliding(way: &[f64], presliding: f64) -> Vec<f64> {
    let mut z = 0.0;
    let mut before = way.first().copied().unwrap_or(0.0);
    way.iter()
        .map(|&x| {
            z = law::slid(z, x - before, presliding);
            before = x;
            z
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_wears_no_friction_off_where_a_rig_holds_still() {
        // a way of 1 and a hold, with noise of up to half the presliding distance
        let (presliding, noise) = (0.02, 0.01);
        let mut seed = 1_u64;
        let mut course = Vec::new();
        for i in 0..3000 {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let white = 2.0 * (seed >> 11) as f64 / (1_u64 << 53) as f64 - 1.0;
            course.push((f64::from(i) / 1000.0).min(1.0) + noise * white);
        }
        // a play as wide as the noise follows the largest position so far, and never turns
        let state = sliding(&played(&course, noise), presliding);
        assert!(state.windows(2).all(|z| z[0] <= z[1]));
        let least = 1.0 - (-(1.0 - 3.0 * noise) / presliding).exp();
        assert!(state[1000] >= least - 1e-12, "{} < {least}", state[1000]);
        let raw = sliding(&course, presliding)[2000..].iter().sum::<f64>() / 1000.0;
        assert!(raw.abs() < 0.1, "{raw}");
        assert_eq!(played(&course, 0.0), course);
    }
}
