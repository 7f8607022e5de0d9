//! What a diagnosis finds: plain data.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::verdict::MATTERS;
use crate::effects::Acting;
use crate::effects::learnt::wider;
use crate::fit::memory::Memory;
use crate::kinematics::Vec3;
use crate::model::{Parameters, Robot};

/// What is to be said of model and recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The plain model suffices: what is left is noise.
    Adequate,
    /// At least one cause of the catalogue is named.
    MissingPhysics,
    /// More than noise is left, and no cause of the catalogue accounts for it; or only a part beyond its
    /// tolerance does.
    Unexplained,
}

impl Verdict {
    /// As files write it.
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Adequate => "adequate",
            Verdict::MissingPhysics => "missing_physics",
            Verdict::Unexplained => "unexplained",
        }
    }
}

/// A place where model and recordings differ.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// voltage, voltage_rate, direction, time, height, position, actuator, recording, frequency, cycle,
    /// largest_stretch.
    pub dimension: &'static str,
    /// What that is on this rig, in words.
    pub called: &'static str,
    /// From and to, in `unit`.
    pub range: Option<[f64; 2]>,
    /// Unit of the range.
    pub unit: String,
    /// A place that is a word.
    pub value: Option<String>,
    /// The recording, where it is in one only.
    pub recording: Option<String>,
    /// The actuators, 1 to 3, where it is not in all.
    pub actuators: Vec<usize>,
    /// Share of the excess (of the squares beyond noise) that lies here.
    pub share_of_excess: f64,
    /// Share of the samples that lie here.
    pub share_of_samples: f64,
    /// Probability of as much excess here by chance, over the whole search.
    pub p_value: f64,
    /// One sentence.
    pub says: String,
}

/// The estimate of one value of an effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Value {
    /// Its name in the catalogue.
    pub name: &'static str,
    /// Its unit.
    pub unit: String,
    /// Its value, freed of what the noise of the motion makes of it; a word for what picks a form or names a
    /// recording.
    pub value: f64,
    /// The value with which the model predicts best from motion that is as noisy.
    pub fitted: f64,
    /// The word, where the value stands for one.
    pub word: Option<String>,
    /// Standard error; NaN where it was not estimated.
    pub std_error: f64,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// Whether it rests on a physical bound.
    pub at_bound: bool,
}

/// A cause that was judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The effect with its fitted values.
    pub acting: Acting,
    /// Probability that it is at work.
    pub probability: f64,
    /// Change of the Bayesian information criterion with it against without; negative speaks for it.
    pub delta_bic: f64,
    /// Weighted mean square (1: noise) on the training recordings with it.
    pub mean_square: f64,
    /// Weighted mean square on the held-out recordings; NaN without any.
    pub holdout_mean_square: f64,
    /// Whether the augmented model contains it.
    pub in_model: bool,
    /// Its values.
    pub values: Vec<Value>,
    /// One sentence: the physics, and how it did.
    pub says: String,
}

/// An effect that these recordings could not have shown.
#[derive(Debug, Clone, PartialEq)]
pub struct Hidden {
    /// Id of the effect.
    pub effect: &'static str,
    /// Share of its trace that a refit of the plain model absorbs.
    pub hidden_share: f64,
    /// Smallest size that would have been seen, in `unit`.
    pub smallest_detectable: f64,
    /// The size's name.
    pub name: &'static str,
    /// Its unit.
    pub unit: String,
}

/// Error of the predicted voltage, V, above 1 kV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Of the plain model, refitted.
    pub before_v: f64,
    /// Of the augmented model.
    pub after_v: f64,
    /// What the noise of the capture alone makes.
    pub noise_floor_v: f64,
    /// The same three over all samples.
    pub all_v: [f64; 3],
}

/// Whether errors are told over all samples, because they do not fall over the basis: the same ones wherever
/// what a model takes away is told.
pub(super) fn over_all(train: &Gain, holdout: Option<&Gain>) -> bool {
    holdout.unwrap_or(train).falls_over_all_alone()
}

/// What errors over all samples are called in a sentence.
pub(super) const OVER_ALL: &str = " over all samples";

/// Mean square over the noise's that a model takes away, from errors before and after and the noise's.
fn taken([before, after, noise]: [f64; 3]) -> f64 {
    (before.powi(2) - after.powi(2)) / noise.powi(2)
}

/// Error over what noise makes of it from which on there is a gap between them.
const GAP: f64 = 1.05;

impl Gain {
    /// Errors of the plain and the augmented model, and the noise's: over all samples, or over the basis.
    pub(crate) fn told(&self, over_all: bool) -> [f64; 3] {
        match over_all {
            true => self.all_v,
            false => self.of_basis(),
        }
    }

    /// Whether the error falls over all samples and not over the basis: by what acts at low voltage.
    fn falls_over_all_alone(&self) -> bool {
        taken(self.all_v) > MATTERS && taken(self.of_basis()).max(0.0) <= MATTERS
    }

    /// Whether the augmented model's error is larger: by less than what matters only where that over all
    /// samples is not smaller by as much.
    pub(super) fn rises(&self) -> bool {
        let taken_away = taken(self.of_basis());
        taken_away < 0.0 && (taken_away < -MATTERS || taken(self.all_v) <= MATTERS)
    }

    /// Whether the augmented model's error is smaller by what matters, over the basis or over all samples.
    pub(super) fn falls(&self) -> bool {
        taken(self.of_basis()) > MATTERS || taken(self.all_v) > MATTERS
    }

    /// Error of the plain model beyond noise, as a root of the difference of squares, and what noise makes: over
    /// the samples of the basis, and over all.
    pub(super) fn left(&self) -> [[f64; 2]; 2] {
        let left = |[before, _, noise]: [f64; 3]| {
            let squares = before.powi(2) - noise.powi(2);
            // none is none, not 0
            let beyond = if squares < 0.0 { 0.0 } else { squares.sqrt() };
            [beyond, noise]
        };
        [self.of_basis(), self.all_v].map(left)
    }

    fn of_basis(&self) -> [f64; 3] {
        [self.before_v, self.after_v, self.noise_floor_v]
    }

    /// Share of the way from the plain model's error to what noise makes that the augmented one goes; NaN
    /// where there is no way to go. At most 1: what is below what noise makes is noise.
    #[must_use]
    pub fn gap_closed(&self) -> f64 {
        match self.before_v > GAP * self.noise_floor_v {
            true => {
                let way = self.before_v - self.noise_floor_v;
                ((self.before_v - self.after_v) / way).min(1.0)
            }
            false => f64::NAN,
        }
    }
}

/// Predicted against film voltage of one recording, before and after.
#[derive(Debug, Clone, PartialEq)]
pub struct Traces {
    /// Identity of the recording.
    pub id: String,
    /// Whether it was held out.
    pub held_out: bool,
    /// Time, s.
    pub time_s: Vec<f64>,
    /// Commanded voltage, V.
    pub command_v: Vec<[f64; 3]>,
    /// Error of the plain model: needed minus made voltage at the film, V; NaN where nothing counts.
    pub before_v: Vec<[f64; 3]>,
    /// Error of the augmented model, V.
    pub after_v: Vec<[f64; 3]>,
    /// Torque error of the plain model, N m (filtered, at the kept samples): time, three chains.
    pub torque_before: Vec<[f64; 4]>,
    /// Torque error of the augmented model, N m.
    pub torque_after: Vec<[f64; 4]>,
    /// Height of the end effector, mm.
    pub height_mm: Vec<f64>,
}

/// What the recordings say of a part that may differ from its drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Departed {
    /// What may be off.
    pub what: String,
    /// By how much it is, most probably, in `unit`.
    pub found: f64,
    /// One standard deviation of what is built, in `unit`.
    pub tolerance: f64,
    /// Unit; `1` is a share.
    pub unit: &'static str,
    /// Whether the rig states the tolerance; else it is a default.
    pub stated: bool,
}

impl Departed {
    /// How many times its tolerance it is off.
    pub fn times(&self) -> f64 {
        (self.found / self.tolerance).abs()
    }

    /// What is off, by how much and how many times its tolerance.
    pub fn says(&self) -> String {
        let (found, unit) = match self.unit {
            "1" => (100.0 * self.found, "%"),
            unit => (self.found, unit),
        };
        let (what, times) = (&self.what, self.times());
        format!("{what} by {found:+.2} {unit}, {times:.1} times its tolerance")
    }
}

/// A law over physical variables for what no cause explains: a hypothesis, never a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    /// Terms: what, coefficient in N m per standard deviation of the variable, share of the excess that it
    /// alone takes away.
    pub terms: Vec<(String, f64, f64)>,
    /// Share of the excess that all of them take away.
    pub share: f64,
}

/// A term that was learnt, with what the recordings leave open of it.
#[derive(Debug, Clone, PartialEq)]
pub struct LearntTerm {
    /// The term with its coefficients; [`crate::effects::Effect::learnt`] says what it is.
    pub acting: Acting,
    /// Covariance of the coefficients, row by row.
    pub covariance: Vec<Vec<f64>>,
    /// Probability that it is part of what is at this place, against the place without it.
    pub inclusion: f64,
    /// The largest that it makes on the fitted recordings, in the unit of its place.
    pub largest: f64,
}

/// Physics that stands in no catalogue, learnt from the recordings.
#[derive(Debug, Clone, PartialEq)]
pub struct LearntPhysics {
    /// Where it acts.
    pub place: crate::effects::learnt::Place,
    /// Its terms: what they make adds up.
    pub terms: Vec<LearntTerm>,
    /// Net work over what is exchanged, of what acts on the mechanism: -1 where it only takes energy, 1 where
    /// it only gives; NaN where it is none.
    pub net_work: f64,
    /// Causes of the catalogue whose traces are nearest, with the cosine.
    pub resembles: Vec<(&'static str, f64)>,
    /// Share of the way from the error without it, of the plain model or of that with the named causes, to
    /// the noise that it closes on recordings that were held out; NaN without any.
    pub gap_closed: f64,
    /// Whether it was learnt beside named causes.
    pub beside: bool,
    /// Logarithm of the squares that it leaves of fitted recordings, were the others alone fitted, over those
    /// that are left without it: mean of that of each and of that of all.
    pub left_out: f64,
    /// One sentence.
    pub says: String,
}

/// Share of the energy that is exchanged from which on a term takes it, or gives it.
const WORKS: f64 = 0.2;

impl LearntPhysics {
    /// Actuators on which any of its terms acts.
    pub fn on(&self) -> [bool; 3] {
        [0, 1, 2].map(|k| self.terms.iter().any(|t| t.acting.on[k]))
    }

    /// Whether it takes energy, on the whole.
    pub fn takes_energy(&self) -> bool {
        self.net_work < -WORKS
    }

    /// Whether it gives energy, on the whole: something drives it.
    pub fn gives_energy(&self) -> bool {
        self.net_work > WORKS
    }

    /// What it depends on, with the probability and the range that the recordings show, in its unit.
    pub fn variables(&self) -> Vec<(&'static str, f64, [f64; 2])> {
        let mut out: Vec<(&'static str, f64, [f64; 2])> = Vec::new();
        for t in &self.terms {
            let Some(term) = t.acting.effect.learnt() else {
                continue;
            };
            for (name, range) in term.form.variables().into_iter().zip(&term.range) {
                match out.iter_mut().find(|o| o.0 == name) {
                    Some(o) => *o = (name, o.1.max(t.inclusion), wider(o.2, *range)),
                    None => out.push((name, t.inclusion, *range)),
                }
            }
        }
        out
    }
}

/// The model that a simpler method ends with.
#[derive(Debug, Clone, PartialEq)]
pub struct RivalModel {
    /// Its name.
    pub method: &'static str,
    /// Ids of its causes, in the order in which it took them.
    pub effects: Vec<&'static str>,
    /// Errors on the recordings that were fitted.
    pub train: Gain,
    /// Errors on those that were not.
    pub holdout: Option<Gain>,
}

/// A robot in the middle of what was recorded, for a drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct Pose {
    /// Its lengths.
    pub robot: Robot,
    /// Position of the end effector, m.
    pub position_m: Vec3,
}

/// What a diagnosis finds.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// The verdict.
    pub verdict: Verdict,
    /// Its probability.
    pub confidence: f64,
    /// Probabilities that nothing is left out, that it is in the catalogue, and that it is something else.
    pub probabilities: [f64; 3],
    /// Where, most telling first.
    pub places: Vec<Place>,
    /// Causes, most probable first.
    pub candidates: Vec<Candidate>,
    /// Groups of ids that these recordings cannot tell apart.
    pub groups: Vec<Vec<&'static str>>,
    /// One sentence: the drive that would separate them.
    pub next_experiment: String,
    /// What could not have been seen.
    pub hidden: Vec<Hidden>,
    /// Training recordings.
    pub train: Gain,
    /// Held-out recordings.
    pub holdout: Option<Gain>,
    /// Film and forearm of the plain model.
    pub plain: Parameters,
    /// Film and forearm of the augmented model (the plain one's where nothing was added).
    pub parameters: Parameters,
    /// Relative permittivity used; NaN where there is none.
    pub eps_r: f64,
    /// The robot, to be drawn; none of other kinds.
    pub pose: Option<Pose>,
    /// What was diagnosed, and so which of the parameters mean something.
    pub rig: RigKind,
    /// Numbers of the augmented model that is neither film nor forearm (an axis): name with its unit, value.
    pub values: Vec<(String, f64)>,
    /// Unit of the errors.
    pub unit: String,
    /// Samples over which the errors are taken, as files write it.
    pub basis: &'static str,
    /// The same in a sentence: " above 1 kV", or nothing.
    pub over: &'static str,
    /// Weighted mean square of the plain model on the training recordings (1: noise).
    pub plain_mean_square: f64,
    /// The same on the held-out ones.
    pub plain_holdout_mean_square: f64,
    /// The law, when more than noise is left, no cause accounts for it and nothing was learnt.
    pub law: Option<Law>,
    /// What was learnt, when more than noise is left and no cause accounts for it; in the augmented model.
    pub learnt: Option<LearntPhysics>,
    /// Voltages before and after.
    pub traces: Vec<Traces>,
    /// What may differ from the drawing, and by how much it does; empty where the model as drawn suffices.
    pub departed: Vec<Departed>,
    /// The part that is farthest beyond what tolerances make, where the plain model leaves only noise with
    /// it, and more without.
    pub beyond: Option<Departed>,
    /// What the defaults among those tolerances are multiplied by: how well this robot was built; NaN where
    /// the model as drawn suffices.
    pub built: f64,
    /// When recordings were made about which nobody says it, where a cause over the series tells: number in
    /// the series, and first sample in its time, s.
    pub dated: Vec<(usize, f64)>,
    /// What weakens the verdict, in words.
    pub remarks: Vec<String>,
    /// The verdict in one or two sentences.
    pub says: String,
    /// What simpler methods say of the same recordings: their name, whether they see anything, and the effect
    /// that they name.
    pub rivals: Vec<(&'static str, bool, Option<&'static str>)>,
    /// The models that simpler methods end with; empty unless asked for.
    pub rival_models: Vec<RivalModel>,
    /// What the verdict rests on: how far the scan stands out of noise.
    pub evidence: Evidence,
}

impl Diagnosis {
    /// Whether errors before and after are told over all samples ([`Gain::told`]).
    pub(crate) fn over_all(&self) -> bool {
        over_all(&self.train, self.holdout.as_ref())
    }

    /// The samples over which they are told, in a sentence.
    pub(crate) fn told_over(&self) -> &'static str {
        if self.over_all() { OVER_ALL } else { self.over }
    }

    /// Whether there is a model beside the plain one: with causes that are named, with what was learnt, or
    /// with both.
    pub fn has_augmented(&self) -> bool {
        self.verdict == Verdict::MissingPhysics || self.learnt.is_some()
    }
}

/// How far the largest score of a scan stands out of what noise makes of the largest score.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Evidence {
    /// Largest surprise of a hypothesis: -ln of its p-value, taken alone.
    pub surprise: f64,
    /// Id of that effect.
    pub whose: &'static str,
    /// Surprise that noise exceeds at the asked rate of false alarms, over the whole scan.
    pub limit: f64,
    /// Probability that noise alone surprises as much, over the whole scan.
    pub p_value: f64,
    /// Variance of the noise that the residual shows over the one that the capture promises.
    pub noise_scale: f64,
    /// Largest surprise of each effect.
    pub each: Vec<(&'static str, f64)>,
    /// Models that were fitted in full: their effects, score less that of the plain model (lower is better),
    /// weighted mean square, that of the held-out recordings.
    pub tried: Vec<(Vec<&'static str>, f64, f64, f64)>,
    /// Largest fall of the sum of squares, priors included, by a refit with one effect.
    pub fall: f64,
    /// Fall that chance may bring about.
    pub fall_by_chance: f64,
}

/// What can be diagnosed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RigKind {
    /// The delta robot: film and forearms.
    Robot,
    /// A film coupon: a film.
    Coupon,
    /// A hinge bench: a torque curve.
    Bench,
    /// A single axis: values of its own.
    Axis,
}

/// Why a diagnosis could not be done.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// No recordings.
    #[error("no recording to diagnose")]
    Nothing,
    /// Recordings that excite nothing.
    #[error("{0}")]
    NothingExcited(String),
    /// A recording leaves the mechanism's reach.
    #[error("recording `{recording}` at {time_s:.3} s: {why}")]
    Unreachable {
        /// The recording.
        recording: String,
        /// Time, s.
        time_s: f64,
        /// What cannot follow.
        why: String,
    },
    /// The plain model cannot be fitted.
    #[error("the plain model cannot be fitted: {0}")]
    Baseline(String),
    /// The film locks.
    #[error(transparent)]
    Locked(#[from] crate::film::Locked),
}

/// A recording to diagnose: where it stands in its series.
#[derive(Debug, Clone, Copy)]
pub struct Entry<'a> {
    /// The recording.
    pub dataset: &'a crate::dataset::Dataset,
    /// When it was made.
    pub when: crate::effects::When,
}

/// What a diagnosis is asked.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Share of adequate models that may be called inadequate.
    pub false_alarm_rate: f64,
    /// Ids of the effects that are considered; all when empty.
    pub only: Vec<String>,
    /// Whether the models that simpler methods end with are built too.
    pub rivals: bool,
    /// Error, in the unit of the rig's errors, that a cause of a robot must take away to matter; without,
    /// what must be taken away is a share of the noise, or all of it beside parts that leave about as much.
    /// What nothing explains matters from as much error on, or from as much as noise makes.
    pub relevant: Option<f64>,
    /// Whether nobody states when in the series the recordings were made: they are then dated by a cause that
    /// acts over the series.
    pub undated: bool,
    /// What was found before the run was stopped.
    pub memory: Memory,
    /// How much of the step under way is done, for whom it is told.
    pub tally: Tally,
}

/// How many things a step has to do and how many of them are done, where that can be told. It changes no
/// result.
#[derive(Debug, Clone, Default)]
pub struct Tally(Arc<[AtomicUsize; 2]>);

/// Two are alike: how far a step is, is no part of what is asked.
impl PartialEq for Tally {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Tally {
    /// A step begins.
    pub fn begin(&self) {
        self.0.iter().for_each(|n| n.store(0, Ordering::Relaxed));
    }

    /// So many more things are to be done.
    pub(super) fn expect(&self, things: usize) {
        self.0[0].fetch_add(things, Ordering::Relaxed);
    }

    /// One of them is done.
    pub(super) fn done(&self) {
        self.0[1].fetch_add(1, Ordering::Relaxed);
    }

    /// Share that is done, 0 to 1; none where nothing is counted.
    pub fn share(&self) -> Option<f64> {
        let [all, done] = [0, 1].map(|i| self.0[i].load(Ordering::Relaxed));
        (all > 0).then(|| done.min(all) as f64 / all as f64)
    }
}

impl Default for Request {
    fn default() -> Self {
        Request {
            false_alarm_rate: 0.02,
            only: Vec::new(),
            rivals: false,
            relevant: None,
            undated: false,
            memory: Memory::default(),
            tally: Tally::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_told_where_it_falls() {
        let gain = |basis: [f64; 3], all_v| Gain {
            before_v: basis[0],
            after_v: basis[1],
            noise_floor_v: basis[2],
            all_v,
        };
        let low = gain([27.1, 27.2, 30.0], [130.0, 85.0, 80.0]);
        assert!(over_all(&low, None));
        assert_eq!(low.told(true), [130.0, 85.0, 80.0]);
        assert_eq!(low.told(false), [27.1, 27.2, 30.0]);
        let both = gain([40.0, 30.0, 30.0], [130.0, 85.0, 80.0]);
        let neither = gain([30.0, 30.0, 30.0], [80.0, 80.0, 80.0]);
        assert!(!over_all(&both, None) && !over_all(&neither, None));
        // what was held out decides, where anything was
        assert!(over_all(&both, Some(&low)) && !over_all(&low, Some(&both)));
        // a hair above 1 kV, which much at low voltage makes good; more, or nothing that does
        assert!(!low.rises() && !both.rises() && !neither.rises());
        assert!(low.falls() && both.falls() && !neither.falls());
        assert!(gain([27.1, 28.0, 30.0], [130.0, 85.0, 80.0]).rises());
        assert!(gain([27.1, 27.2, 30.0], [80.0, 80.0, 80.0]).rises());
        let nan = [f64::NAN; 3];
        let left = gain(nan, [50.0, 50.0, 30.0]).left();
        assert!(left[0][0].is_nan() && left[1] == [40.0, 30.0], "{left:?}");
        assert_eq!(neither.left(), [[0.0, 30.0], [0.0, 80.0]]);
    }

    #[test]
    fn a_tally_tells_what_is_done() {
        let tally = Tally::default();
        let other = tally.clone();
        assert_eq!(tally.share(), None);
        other.expect(4);
        other.done();
        assert_eq!(tally.share(), Some(0.25));
        tally.begin();
        assert_eq!(other.share(), None);
    }
}
