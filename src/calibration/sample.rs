//! The film from hanging samples: x follows from the voltage, and moduli and relaxation times are those that
//! make it the captured one.
//!
//! Not separable (lambda_2 of the active part depends on the moduli), so all unknowns are searched at once
//! with exact derivatives. The residual is in x and weighed with the noise of the capture, which is where the
//! noise is (`residual::sample`); errors are reported in volts as everywhere.
//!
//! # What a sample can tell
//! A sample that hangs under one mass shows the ratio of the Maxwell stress to the stiffness, and the weight
//! sets the stretch about which it works. With the mass and the permittivity of the rig file, the moduli
//! follow; multiply moduli, permittivity and mass by one factor and x is the same. [`SampleOutcome::scale`]
//! says by how much the moduli would be off if either stated number were.

use std::ops::ControlFlow;

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;

use super::aged::Slot;
use super::coupon::correlation_rows;
use super::outcome::*;
use super::robot::{apply, locking, modulus, relaxation_time, spread_evenly, unknown};
use super::sample_problem::{
    Hung, Prior, SampleProblem, errors_m, fits, hang, hang_at_first, hang_within, most_left_m,
    room_of,
};
use super::solution::Solution;
use super::{Error, Request, Stage, Uncertainty};
use crate::dataset::{HangingDataset, OffsetSource, Plan, SmoothedAxis, repeats};
use crate::film::Film;
use crate::fit::levenberg_marquardt::{self as lm, Resting, StopReason};
use crate::fit::memory::Memory;
use crate::fit::separable;
use crate::model::{Electrode, HangingSample};
use crate::parameter::{Parameter, Transform};
use crate::residual::{
    MOST_BRANCHES, OFFSET_REACH_S, SampleInverse, SampleKnob, SampleTrouble, film_voltage_v,
    inverse_sample, root_v, run_sample,
};

/// What is known of a relaxation time beforehand: its order of magnitude (half a decade).
const LOG_PRIOR_SD: f64 = 1.15;
/// What is known of the position at rest beyond the mean of the first frames, m: nothing that matters.
const SHIFT_PRIOR_M: f64 = 1e-3;
/// Locking constant where none is given: a sample stretches to some tenths, far from locking, and cannot tell
/// it.
const HELD_LOCKING: f64 = 80.0;
/// The race of the starts ends where a step saves less than this, in squared standard errors (the sum of
/// squares over its mean square): a tenth of a standard error in one direction.
const LITTLE: f64 = 0.01;
/// Steps of the race: well-posed fits take 10 to 40 from afar, and one that crawls shows it by then.
const RACE_LIMIT: usize = 60;
/// From the race a start goes on if it lies less than this above where the best ended, in squared standard
/// errors: three of them. What lies higher is not what the data ask for; what is nearer may still come below.
const REACH: f64 = 9.0;
/// All moduli together at a start, Pa, of the order of silicone.
const START_MODULUS_PA: f64 = 5e5;
/// Of these the share of the branches.
const START_VISCOUS: f64 = 0.2;
/// Ranges of x over the sample's length that can be worked with: less no capture sees, more no film
/// stretches.
const STROKES: std::ops::RangeInclusive<f64> = 1e-5..=20.0;
/// A gap is bridged by the smoother while the smoothed position stays this well known, relative to its median
/// uncertainty.
const BRIDGE_LIMIT: f64 = 5.0;
/// Left out at both ends, s: derivatives there rest on one side.
const EDGE_S: f64 = 0.3;
/// Tracks that are drawn for the noise of the predicted voltage.
const DRAWS: u64 = 8;

/// What a calibration on hanging samples is asked to do.
#[derive(Debug, Clone)]
pub struct SampleRequest {
    /// Viscoelastic branches, 0 to 8.
    pub branches: usize,
    /// Where to begin: a film of an earlier run (its branches count, not `branches`); its J is held.
    pub start: Option<Film>,
    /// Parameters held at a value, in the parameter's unit.
    pub fix: Vec<(String, f64)>,
    /// Bounds, in the parameter's unit.
    pub bound: Vec<(String, [f64; 2])>,
    /// Number of starts: the given or evenly spread one, then random ones.
    pub starts: usize,
    /// Seed of the random starts.
    pub seed: u64,
    /// What was found before the run was stopped.
    pub memory: Memory,
}

impl SampleRequest {
    /// A request with `branches` branches, three starts and nothing fixed.
    pub fn new(branches: usize) -> Self {
        SampleRequest {
            branches,
            start: None,
            fix: Vec::new(),
            bound: Vec::new(),
            starts: 3,
            seed: 1,
            memory: Memory::default(),
        }
    }
}

/// One recording of a hanging sample against the model.
#[derive(Debug, Clone)]
pub struct SampleFit {
    /// Identity.
    pub id: String,
    /// Error of the predicted voltage.
    pub error: ChainError,
    /// Root mean square of predicted minus captured x, m, frames averaged over a step of the grid.
    pub rmse_m: f64,
    /// What the noise makes of that, m.
    pub noise_rmse_m: f64,
    /// Largest magnitude of predicted minus captured x, m, of the same averages.
    pub max_error_m: f64,
    /// Noise of one frame, m.
    pub noise_m: f64,
    /// Largest minus smallest x of the smoothed capture, and of the prediction, m.
    pub stroke_m: [f64; 2],
    /// Length at rest by the model, m.
    pub rest_length_m: f64,
    /// Step of the integration, s.
    pub step_s: f64,
    /// Clock offset, s, and its standard error where it was estimated.
    pub offset_s: f64,
    /// Standard error of the offset; `None` where it was stated.
    pub offset_std_error_s: Option<f64>,
    /// What the electrode does beside conducting.
    pub electrode: Electrode,
    /// Choices made for it.
    pub plan: Plan,
    /// Time of each frame, s.
    pub time_s: Vec<f64>,
    /// Captured x, m; NaN in gaps.
    pub captured_m: Vec<f64>,
    /// Smoothed x, m.
    pub smoothed_m: Vec<f64>,
    /// Predicted x, m.
    pub predicted_m: Vec<f64>,
    /// Command, V; NaN where the log has none.
    pub command_v: Vec<f64>,
    /// Voltage that the command makes on the film, V.
    pub film_v: Vec<f64>,
    /// phi^2 on the film that the motion needs, V^2.
    pub needed_squared_v2: Vec<f64>,
    /// (lambda_1 lambda_2)^2 of the active part along the motion.
    pub area: Vec<f64>,
    /// Standard deviation of the needed voltage from the capture noise, V.
    pub sd_v: Vec<f64>,
    /// Frames that count in the errors.
    pub counts: Vec<bool>,
    /// Gaps of the capture: first frame and length.
    pub gaps: Vec<(usize, usize)>,
    /// Where the cycles of the drive begin, and where the last one ends, s; empty where it does not repeat.
    pub cycles_s: Vec<f64>,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// By how much all moduli would be off if a stated number were 1 % larger, %.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Relative permittivity.
    pub by_permittivity: f64,
    /// Mass on the free end.
    pub by_mass: f64,
}

/// Everything that a calibration on hanging samples found.
#[derive(Debug, Clone)]
pub struct SampleOutcome {
    /// What was done: `sample` or `validate`.
    pub job: &'static str,
    /// The film.
    pub film: Film,
    /// Relative permittivity used.
    pub eps_r: f64,
    /// Every parameter, in order. Empty when nothing was fitted.
    pub estimates: Vec<Estimate>,
    /// Correlation of the free estimates (names, rows).
    pub correlation: (Vec<String>, Vec<Vec<f64>>),
    /// Combinations that the recordings leave open, worst first.
    pub weak_directions: Vec<WeakDirection>,
    /// How the moduli hang on what the rig file states; `None` when nothing was fitted.
    pub scale: Option<Scale>,
    /// The recordings.
    pub recordings: Vec<SampleFit>,
    /// Errors over all recordings.
    pub total: ChainError,
    /// The starts, best first.
    pub starts: Vec<StartOutcome>,
    /// Whether the fit converged.
    pub converged: bool,
    /// Why it stopped.
    pub reason: String,
    /// Evaluations of all starts.
    pub evaluations: usize,
    /// Failed evaluations.
    pub failed_evaluations: usize,
    /// Mean square of (predicted minus captured x)/noise: 1 where the model is right.
    pub weighted_mean_square: f64,
    /// First sentence: does it fit?
    pub verdict: String,
    /// Further sentences a reader should see.
    pub remarks: Vec<String>,
}

impl From<SampleTrouble> for Error {
    fn from(trouble: SampleTrouble) -> Self {
        Error::NothingToFit(trouble.to_string())
    }
}

fn check(
    datasets: &[&HangingDataset],
    samples: &[HangingSample],
    branches: usize,
) -> Result<(), Error> {
    if datasets.is_empty() || datasets.len() != samples.len() {
        return Err(Error::NothingToFit("no hanging sample was given".into()));
    }
    if branches > MOST_BRANCHES {
        return Err(Error::NothingToFit(format!(
            "{branches} branches were asked for: at most {MOST_BRANCHES} are known"
        )));
    }
    for (d, sample) in datasets.iter().zip(samples) {
        let known = || d.x_m.iter().copied().filter(|x| !x.is_nan());
        let range_m =
            known().fold(f64::NEG_INFINITY, f64::max) - known().fold(f64::INFINITY, f64::min);
        let share = range_m / sample.length_m;
        if !STROKES.contains(&share) {
            return Err(Error::NothingToFit(format!(
                "recording `{}`: the free end ranges over {:.3e} mm, and the sample is {:.3e} mm long: check the unit of the motion, and \
                 length_mm of the rig",
                d.id,
                1e3 * range_m,
                1e3 * sample.length_m
            )));
        }
    }
    Ok(())
}

/// Relaxation times spread evenly in their logarithm, from two frames to the length of the longest recording.
pub(super) fn spread_times(branches: usize, datasets: &[&HangingDataset]) -> Vec<f64> {
    let finest = datasets
        .iter()
        .map(|d| d.step_s)
        .fold(f64::INFINITY, f64::min);
    let longest = datasets
        .iter()
        .map(|d| d.step_s * (d.samples() - 1) as f64)
        .fold(0.0, f64::max);
    spread_evenly(branches, [(3.0 * finest).ln(), (2.0 * longest).ln()])
}

/// A film of the right order: what the branches carry spread evenly.
pub(super) fn start_film(times_s: Vec<f64>, locking: f64) -> Film {
    let n = times_s.len();
    let mut mu_pa = vec![START_MODULUS_PA * if n > 0 { 1.0 - START_VISCOUS } else { 1.0 }];
    mu_pa.extend(std::iter::repeat_n(
        START_MODULUS_PA * START_VISCOUS / n.max(1) as f64,
        n,
    ));
    Film {
        mu_pa,
        relaxation_time_s: times_s,
        locking,
    }
}

/// Relaxation times and J, then moduli, then free offsets; and how many come before the moduli.
fn parameters(
    request: &SampleRequest,
    datasets: &[&HangingDataset],
    film: &Film,
) -> Result<(Vec<Parameter>, usize), Error> {
    let finest = datasets
        .iter()
        .map(|d| d.step_s)
        .fold(f64::INFINITY, f64::min);
    let mut out: Vec<Parameter> = film
        .relaxation_time_s
        .iter()
        .enumerate()
        .map(|(i, &start)| {
            let bounds = [(0.5 * finest).min(start), 3000_f64.max(start)];
            relaxation_time(i, start, bounds, LOG_PRIOR_SD)
        })
        .collect();
    out.push(Parameter {
        fixed: true,
        ..locking(Transform::Log, film.locking, [1e-3, 1e9], None)
    });
    let split = out.len();
    let longest = datasets
        .iter()
        .map(|d| d.step_s * d.samples() as f64)
        .fold(0.0, f64::max);
    for (i, mu) in film.mu_pa.iter().enumerate() {
        let mut p = modulus(i, *mu, false);
        if i == 0 {
            p.meaning += &format!(", with whatever relaxes slower than {longest:.0} s");
        }
        out.push(p);
    }
    for d in datasets {
        if d.offset_source == OffsetSource::Free {
            out.push(Parameter {
                name: format!("offset_{}", d.id),
                meaning: format!("clock offset of recording {}", d.id),
                unit: "s",
                transform: Transform::Linear,
                start: d.offset_s,
                lower: d.offset_s - OFFSET_REACH_S,
                upper: d.offset_s + OFFSET_REACH_S,
                prior_sd: None,
                fixed: false,
            });
        }
    }
    let mut names = Request::new(Stage::Film);
    (names.fix, names.bound) = (request.fix.clone(), request.bound.clone());
    apply(&names, &mut out)?;
    if let Some(j) = out.iter().find(|p| p.name == "J" && !p.fixed) {
        return Err(Error::BadValue {
            name: j.name.clone(),
            what: "a hanging sample does not tell it: hold it with --fix".into(),
        });
    }
    Ok((out, split))
}

/// What can be said of the starts, best first.
fn waterfall(ends: &[Runner], rows: f64, branches: usize) -> Vec<StartOutcome> {
    let times = |e: &Runner| {
        e.outcome.parameters[..branches]
            .iter()
            .map(|v| v.exp())
            .collect()
    };
    ends.iter()
        .map(|e| StartOutcome {
            origin: e.origin.clone(),
            cost: 2.0 * e.outcome.cost / rows,
            evaluations: e.evaluations,
            failed: e.failed,
            ended: e.words().into(),
            reached: times(e),
        })
        .collect()
}

/// Finds the film from recordings of hanging samples, all at once; `samples` states each one's geometry, mass
/// and electrode. `watch` is shown every step and may stop the work.
///
/// # Errors
/// [`Error`], where nothing can be done.
pub fn calibrate_samples(
    datasets: &[&HangingDataset],
    samples: &[HangingSample],
    request: &SampleRequest,
    watch: &(dyn Fn(f64) -> ControlFlow<()> + Sync),
) -> Result<SampleOutcome, Error> {
    let given = request.start.as_ref();
    let branches = given.map_or(request.branches, Film::branches);
    check(datasets, samples, branches)?;
    let first = given
        .cloned()
        .unwrap_or_else(|| start_film(spread_times(branches, datasets), HELD_LOCKING));
    let search = Search::new(datasets, request, &first, watch)?;
    let (hung, mut ends) = search.race(datasets, samples, search.starts(request))?;
    let waterfall = waterfall(&ends, rows_of(&hung), branches);
    let best = ends.swap_remove(0).outcome;
    if !best.cost.is_finite() {
        return Err(Error::AllStartsFailed {
            tried: waterfall.len(),
            last: best.last_failure.map(|f| f.message).unwrap_or_default(),
        });
    }

    // Where it ended, as the estimates want it.
    let p = &best.parameters;
    let problem = search.problem(&hung);
    let (state, resting, free) = search.ended(&best);
    let solution = Solution::new(&search.list, search.split, branches, &state, &resting);
    // What the noise leaves open: the shifts are solved for along with the rest.
    let ended = problem.evaluate(p, false)?;
    let (square, inflation) = noise_of(ended.iter().map(|r| r.residuals.as_slice()), free.len());
    let gram = marginal(&problem.gram(p)?, search.place.len());
    let uncertainty = search.uncertainty(&gram, inflation, &free);
    let film = solution.sorted(&problem.setting(0, p).film);
    let taken: Vec<Taken> = (0..datasets.len())
        .map(|r| {
            let setting = problem.setting(r, p);
            let offset = search.slots.iter().position(|s| *s == Slot::Offset(r));
            Taken {
                sample: setting.sample,
                shift_m: setting.shift_m,
                offset_s: setting.offset_s,
                offset_std_error_s: offset.map(|j| uncertainty.std_error(search.place[j])),
            }
        })
        .collect();
    let mut outcome = assemble("sample", &hung, &film, &taken).map_err(|why| {
        Error::NothingToFit(format!(
            "nothing fits: the film that comes nearest leaves {:.0} um rms of x, and no voltage moves it as captured ({why}); look at the \
             voltage, its clock and the stated numbers of the rig",
            1e6 * most_left_m(&hung, &ended)
        ))
    })?;
    outcome.weak_directions = solution.weak_directions(&uncertainty);
    outcome.correlation = solution.correlation(&uncertainty);
    outcome.estimates = solution.estimates(&uncertainty, &vec![None; search.list.len()]);
    outcome.scale = scale(&search, &problem, p, &gram);
    outcome.evaluations = waterfall.iter().map(|s| s.evaluations).sum();
    outcome.failed_evaluations = waterfall.iter().map(|s| s.failed).sum();
    outcome.starts = waterfall;
    outcome.converged = best.reason.converged();
    outcome.reason = best.reason.words().into();
    outcome.weighted_mean_square = square;
    outcome.verdict = verdict(&outcome);
    say_what_is_open(&mut outcome, inflation);
    Ok(outcome)
}

/// What the stated numbers, the held J and the correlation of what is left mean for the moduli.
fn say_what_is_open(outcome: &mut SampleOutcome, inflation: f64) {
    if let Some(scale) = outcome.scale {
        outcome.remarks.push(format!(
            "One mass fixes only combinations: were the permittivity 1 % larger than stated, all moduli would come out {:.2} % larger; were the mass 1 % larger, {:.2} %.",
            scale.by_permittivity, scale.by_mass
        ));
    }
    outcome.remarks.push(format!(
        "J is held at {}: at the stretches of a hanging sample it does nothing that could be seen. Take it from a coupon.",
        outcome.film.locking
    ));
    let square = outcome.weighted_mean_square;
    if inflation > 1.5 * square.max(1.0) {
        outcome.remarks.push(format!(
            "What the model leaves of x is correlated over {:.1} rows: the intervals are widened for it.",
            inflation / square
        ));
    }
}

/// Rows of all recordings.
fn rows_of(hung: &[Hung]) -> f64 {
    let rows: usize = hung.iter().map(|h| h.residual.rows()).sum();
    rows.max(1) as f64
}

fn best_first(runners: &mut [Runner]) {
    runners.sort_by(|a, b| a.outcome.cost.total_cmp(&b.outcome.cost));
}

/// What all starts of a calibration share.
struct Search<'s> {
    film: &'s Film,
    list: Vec<Parameter>,
    /// Relaxation times and J, which come first in the list.
    split: usize,
    /// Number in the list of each slot; the shifts, which come last, are not in it.
    place: Vec<usize>,
    slots: Vec<Slot>,
    priors: Vec<Prior>,
    bounds: Vec<[f64; 2]>,
    memory: &'s Memory,
    watch: &'s (dyn Fn(f64) -> ControlFlow<()> + Sync),
}

/// A start and how far it came.
struct Runner {
    origin: String,
    outcome: lm::Outcome,
    evaluations: usize,
    failed: usize,
    /// Whether it went no further than the race.
    behind: bool,
}

impl Runner {
    fn new(origin: String, outcome: lm::Outcome) -> Self {
        Runner {
            origin,
            evaluations: outcome.evaluations + outcome.jacobian_evaluations,
            failed: outcome.failed_evaluations,
            outcome,
            behind: true,
        }
    }

    /// After another leg of its way.
    fn after(self, outcome: lm::Outcome) -> Self {
        let leg = Runner::new(self.origin, outcome);
        Runner {
            evaluations: self.evaluations + leg.evaluations,
            failed: self.failed + leg.failed,
            ..leg
        }
    }

    /// How it ended.
    fn words(&self) -> &'static str {
        match self.outcome.reason {
            StopReason::InitialPointFailed => StopReason::InitialPointFailed.words(),
            _ if self.behind && !self.outcome.cost.is_finite() => {
                "left behind where the model cannot be run with the steps of the end"
            }
            StopReason::IterationLimit if self.behind => {
                "left behind on its way: out of reach of the best"
            }
            reason if self.behind && reason.converged() => {
                "left behind where steps save next to nothing: out of reach of the best"
            }
            reason => reason.words(),
        }
    }
}

impl<'s> Search<'s> {
    /// Slots in the order of the list, J left out, then the shifts.
    fn new(
        datasets: &[&HangingDataset],
        request: &'s SampleRequest,
        film: &'s Film,
        watch: &'s (dyn Fn(f64) -> ControlFlow<()> + Sync),
    ) -> Result<Self, Error> {
        let (list, split) = parameters(request, datasets, film)?;
        let (mut slots, mut place) = (Vec::new(), Vec::new());
        let mut free_offsets =
            (0..datasets.len()).filter(|&r| datasets[r].offset_source == OffsetSource::Free);
        for (i, p) in list.iter().enumerate() {
            let slot = if p.name == "J" {
                continue;
            } else if i < split {
                Slot::LogTime(i)
            } else if i <= split + film.branches() {
                Slot::Modulus(i - split)
            } else {
                match free_offsets.next() {
                    Some(r) => Slot::Offset(r),
                    None => continue,
                }
            };
            slots.push(slot);
            place.push(i);
        }
        slots.extend((0..datasets.len()).map(Slot::Shift));
        let prior = |p: &Parameter| {
            let sd = p.prior_sd.filter(|_| !p.fixed)?;
            Some((p.transform.to_search(p.start), sd))
        };
        let bound = |p: &Parameter| match p.fixed {
            true => [p.transform.to_search(p.start); 2],
            false => [p.lower, p.upper].map(|v| p.transform.to_search(v)),
        };
        let mut priors: Vec<Prior> = place.iter().map(|&i| prior(&list[i])).collect();
        priors.extend(datasets.iter().map(|_| Some((0.0, SHIFT_PRIOR_M))));
        let mut bounds: Vec<[f64; 2]> = place.iter().map(|&i| bound(&list[i])).collect();
        bounds.extend(datasets.iter().map(|_| [f64::NEG_INFINITY, f64::INFINITY]));
        Ok(Search {
            film,
            list,
            split,
            place,
            slots,
            priors,
            bounds,
            memory: &request.memory,
            watch,
        })
    }

    /// The given or evenly spread start, then random ones about it.
    fn starts(&self, request: &SampleRequest) -> Vec<(String, Vec<f64>)> {
        let own = self.place.iter().map(|&i| &self.list[i]);
        let mut begin: Vec<f64> = own.map(|p| p.transform.to_search(p.start)).collect();
        begin.resize(self.slots.len(), 0.0);
        let mut generator = ChaCha12Rng::seed_from_u64(request.seed);
        let mut random = |s: usize| {
            let mut p = begin.clone();
            for (j, slot) in self.slots.iter().enumerate() {
                let [low, high] = self.bounds[j];
                match slot {
                    Slot::LogTime(_) => {
                        p[j] = (p[j] + generator.random_range(-1.5..1.5)).clamp(low, high);
                    }
                    Slot::Modulus(_) => {
                        let factor: f64 = generator.random_range(-0.7_f64..0.7);
                        p[j] = (p[j] * factor.exp()).clamp(low, high);
                    }
                    _ => {}
                }
            }
            (format!("random {s}"), p)
        };
        let name = match request.start {
            Some(_) => "given film",
            None => "evenly spread",
        };
        let mut out = vec![(name.to_string(), begin.clone())];
        out.extend((1..request.starts.max(1)).map(&mut random));
        out
    }

    /// Values of the list where a search ended, which of them rest on a bound, and which are free.
    fn ended(&self, best: &lm::Outcome) -> (separable::State, Vec<Option<AtBound>>, Vec<bool>) {
        let searched = |p: &Parameter| p.transform.to_search(p.start);
        let mut values: Vec<f64> = self.list.iter().map(searched).collect();
        let mut resting = vec![None; self.list.len()];
        let mut free = vec![false; self.list.len()];
        for (j, &i) in self.place.iter().enumerate() {
            values[i] = best.parameters[j];
            resting[i] = match best.resting[j] {
                Resting::Lower => Some(AtBound::Lower),
                Resting::Upper => Some(AtBound::Upper),
                Resting::Free | Resting::Fixed => None,
            };
            free[i] = best.resting[j] == Resting::Free && !self.list[i].fixed;
        }
        let unknowns: Vec<_> = self.list.iter().map(unknown).collect();
        let (nonlinear, linear) = unknowns.split_at(self.split);
        let mut state = separable::State::at(&values[..self.split], nonlinear, linear);
        state.beta = values[self.split..].to_vec();
        (state, resting, free)
    }

    /// How sure the list is, from the Gram matrix of its slots and the factor on what noise makes of it.
    fn uncertainty(&self, gram: &DMatrix<f64>, inflation: f64, free: &[bool]) -> Uncertainty {
        let n = self.list.len();
        let mut wide = DMatrix::zeros(n, n);
        for (a, &i) in self.place.iter().enumerate() {
            for (b, &k) in self.place.iter().enumerate() {
                wide[(i, k)] = gram[(a, b)];
            }
        }
        let priors = self.list.iter().map(|q| q.prior_sd);
        let precision: Vec<f64> = priors
            .map(|prior| prior.map_or(0.0, |sd| sd.powi(-2)))
            .collect();
        Uncertainty::new(&wide, &(&wide * inflation), &precision, free)
    }

    fn problem<'h>(&self, hung: &'h [Hung<'h>]) -> SampleProblem<'h> {
        let levels = vec![[0; 5]; hung.len()];
        let (film, slots) = (self.film.clone(), self.slots.clone());
        SampleProblem::new(hung, film, slots, self.priors.clone(), levels)
    }

    fn leg(
        &self,
        tag: &str,
        hung: &[Hung],
        start: &[f64],
        options: &lm::Options,
    ) -> Result<lm::Outcome, Error> {
        let watch = |s: &lm::State| (self.watch)(s.cost());
        (self.memory)
            .least_squares(tag, &self.problem(hung), start, options, watch)
            .map_err(|misuse| Error::NothingToFit(misuse.to_string()))
    }

    /// As far as steps save something that counts.
    fn loose(&self, hung: &[Hung]) -> lm::Options {
        let rows = rows_of(hung);
        lm::Options {
            bounds: self.bounds.clone(),
            iteration_limit: RACE_LIMIT,
            // the square of this times the cost is what a step would still save
            gradient_tolerance: (LITTLE / rows).sqrt().min(0.1),
            step_tolerance: 1e-9,
            cost_tolerance: (LITTLE / rows).min(0.01),
            polish_limit: 0,
            ..lm::Options::default()
        }
    }

    /// To the end.
    fn tight(&self) -> lm::Options {
        lm::Options {
            bounds: self.bounds.clone(),
            iteration_limit: 200,
            gradient_tolerance: 1e-7,
            step_tolerance: 1e-9,
            cost_tolerance: 1e-11,
            polish_limit: 3,
            ..lm::Options::default()
        }
    }

    /// All starts on coarse steps as far as steps save something that counts; then, on steps that are as fine
    /// as what the best leaves of x asks for, the best to its end and those in reach of it to theirs.
    fn race<'d>(
        &self,
        datasets: &[&'d HangingDataset],
        samples: &[HangingSample],
        starts: Vec<(String, Vec<f64>)>,
    ) -> Result<(Vec<Hung<'d>>, Vec<Runner>), Error> {
        let steps =
            |hung: &[Hung]| -> Vec<f64> { hung.iter().map(|h| h.residual.step_s()).collect() };
        let mut hung = hang_at_first(datasets, samples, self.film)?;
        let loose = self.loose(&hung);
        let mut runners = starts
            .into_par_iter()
            .map(|(origin, start)| {
                let outcome = self.leg("the race", &hung, &start, &loose)?;
                Ok(Runner::new(origin, outcome))
            })
            .collect::<Result<Vec<_>, Error>>()?;
        best_first(&mut runners);
        if !runners[0].outcome.cost.is_finite() {
            return Ok((hung, runners));
        }
        let place = &runners[0].outcome.parameters;
        let rows = self.problem(&hung).evaluate(place, false)?;
        let errors = errors_m(datasets, &room_of(&hung, &rows));
        // a film of a start that does not move as captured may ask for steps that the one found does not
        let found = self.problem(&hung).setting(0, place).film;
        let all_fit = hung.iter().zip(&rows).all(|(h, r)| fits(h, r));
        let next = match hang_within(datasets, samples, &found, &errors, 0.0) {
            Ok(next) if !all_fit => next,
            _ => hang_within(datasets, samples, self.film, &errors, 0.0)?,
        };
        if steps(&next) != steps(&hung) {
            let problem = self.problem(&next);
            let costs: Vec<f64> = runners
                .par_iter()
                .map(|r| problem.cost(&r.outcome.parameters).unwrap_or(f64::INFINITY))
                .collect();
            // steps on which nothing runs are no better ones
            if costs.iter().any(|c| c.is_finite()) {
                for (runner, cost) in runners.iter_mut().zip(costs) {
                    runner.outcome.cost = cost;
                    runner.evaluations += 1;
                }
                let finer = steps(&next).iter().zip(steps(&hung)).any(|(n, h)| *n < h);
                hung = next;
                if finer {
                    let loose = self.loose(&hung);
                    runners = runners
                        .into_par_iter()
                        .map(|r| {
                            let outcome =
                                self.leg("the race", &hung, &r.outcome.parameters, &loose)?;
                            Ok(r.after(outcome))
                        })
                        .collect::<Result<_, Error>>()?;
                }
                best_first(&mut runners);
            }
        }
        let tight = self.tight();
        let go_on = |r: Runner| -> Result<Runner, Error> {
            let outcome = self.leg("the fit", &hung, &r.outcome.parameters, &tight)?;
            Ok(Runner {
                behind: false,
                ..r.after(outcome)
            })
        };
        let others = runners.split_off(1);
        runners = runners
            .into_iter()
            .map(go_on)
            .collect::<Result<_, Error>>()?;
        let reach = runners[0].outcome.cost * (1.0 + REACH / rows_of(&hung));
        let others: Vec<Runner> = others
            .into_par_iter()
            .map(|r| match r.outcome.cost <= reach {
                true => go_on(r),
                false => Ok(r),
            })
            .collect::<Result<_, Error>>()?;
        runners.extend(others);
        best_first(&mut runners);
        Ok((hung, runners))
    }
}

/// Mean square of weighted residuals, and the factor by which the covariance grows: that mean square times
/// the length over which what is left says the same thing.
pub(super) fn noise_of<'r>(
    residuals: impl Iterator<Item = &'r [f64]>,
    parameters: usize,
) -> (f64, f64) {
    let (mut sum, mut count, mut length) = (0.0, 0, 0.0);
    for r in residuals {
        sum += r.iter().map(|v| v * v).sum::<f64>();
        count += r.len();
        length += r.len() as f64 * correlation_rows(r);
    }
    let square = sum / count.saturating_sub(parameters).max(1) as f64;
    (square, square * (length / count.max(1) as f64).max(1.0))
}

/// The Gram matrix of the first `known` unknowns with the others solved for.
pub(super) fn marginal(gram: &DMatrix<f64>, known: usize) -> DMatrix<f64> {
    let rest = gram.nrows() - known;
    let own = gram.view((0, 0), (known, known)).into_owned();
    if rest == 0 {
        return own;
    }
    let cross = gram.view((0, known), (known, rest));
    let mut inner = gram.view((known, known), (rest, rest)).into_owned();
    for i in 0..rest {
        inner[(i, i)] += 1e-12 * inner[(i, i)].max(1e-300);
    }
    match inner.cholesky() {
        Some(c) => own - cross * c.solve(&cross.transpose()),
        None => own,
    }
}

/// How the sum of the moduli answers to the stated permittivity and mass.
fn scale(
    search: &Search,
    problem: &SampleProblem,
    p: &[f64],
    gram: &DMatrix<f64>,
) -> Option<Scale> {
    let known = search.place.len();
    let free = |j: usize| !search.list[search.place[j]].fixed;
    let moduli: Vec<usize> = (0..known)
        .filter(|&j| matches!(problem.slots[j], Slot::Modulus(_)) && free(j))
        .filter(|&j| p[j] > 0.0)
        .collect();
    let sum: f64 = moduli.iter().map(|&j| p[j]).sum();
    // The whole film stiffer in proportion against the stated number larger: one unknown for one.
    let mut along = nalgebra::DVector::zeros(known);
    for &j in &moduli {
        along[j] = p[j];
    }
    let curvature = (along.transpose() * gram * &along)[(0, 0)];
    if sum <= 0.0 || curvature <= 0.0 {
        return None;
    }
    let knobs = [SampleKnob::ActiveFraction, SampleKnob::Mass];
    let mut found = [0.0; 2];
    for (number, recording) in problem.recordings.iter().enumerate() {
        let s = problem.setting(number, p);
        let all: Vec<SampleKnob> = (0..s.film.mu_pa.len())
            .map(SampleKnob::Modulus)
            .chain(knobs)
            .collect();
        let rows = recording
            .residual
            .rows_at(&s.sample, &s.film, s.shift_m, s.offset_s, &all)
            .ok()?;
        let n = rows.residuals.len();
        let springs = s.film.mu_pa.len();
        let centred = |v: Vec<f64>| -> Vec<f64> {
            let weights: f64 = rows.shift.iter().map(|w| w * w).sum();
            let mean = v.iter().zip(&rows.shift).map(|(a, w)| a * w).sum::<f64>() / weights;
            v.iter()
                .zip(&rows.shift)
                .map(|(a, w)| a - mean * w)
                .collect()
        };
        let film = centred(
            (0..n)
                .map(|i| {
                    (0..springs)
                        .map(|k| s.film.mu_pa[k] * rows.columns[k][i])
                        .sum()
                })
                .collect(),
        );
        let size = [s.sample.electrode.active_fraction, s.sample.mass_kg];
        for (k, f) in found.iter_mut().enumerate() {
            let stated = centred(
                rows.columns[springs + k]
                    .iter()
                    .map(|v| v * size[k])
                    .collect(),
            );
            *f -= film.iter().zip(&stated).map(|(a, b)| a * b).sum::<f64>();
        }
    }
    Some(Scale {
        by_permittivity: found[0] / curvature,
        by_mass: found[1] / curvature,
    })
}

/// Holds a film against recordings of hanging samples, nothing fitted.
///
/// # Errors
/// [`Error`], when the film gives way or locks.
pub fn validate_samples(
    datasets: &[&HangingDataset],
    samples: &[HangingSample],
    film: &Film,
) -> Result<SampleOutcome, Error> {
    check(datasets, samples, film.branches())?;
    let hung = hang(datasets, samples, film)?;
    let taken = datasets.iter().zip(samples).map(|(d, sample)| Taken {
        sample: *sample,
        shift_m: 0.0,
        offset_s: d.offset_s,
        offset_std_error_s: None,
    });
    let mut outcome = assemble("validate", &hung, film, &taken.collect::<Vec<_>>())?;
    outcome.converged = true;
    outcome.reason = "nothing was fitted".into();
    outcome.verdict = verdict(&outcome);
    Ok(outcome)
}

/// x of a sample at the frames of a recording, from its voltage alone, m.
///
/// # Errors
/// [`Error`], when the film gives way or locks.
pub fn predict_sample_motion(
    dataset: &HangingDataset,
    sample: &HangingSample,
    film: &Film,
) -> Result<Vec<f64>, Error> {
    check(&[dataset], std::slice::from_ref(sample), film.branches())?;
    let hung = hang(&[dataset], std::slice::from_ref(sample), film)?;
    Ok(motion(&hung[0], sample, film, dataset.offset_s)?.0)
}

/// x at the frames, and the length at rest.
fn motion(
    hung: &Hung,
    sample: &HangingSample,
    film: &Film,
    offset_s: f64,
) -> Result<(Vec<f64>, f64), Error> {
    let command = hung.residual.command_v(offset_s);
    let run = run_sample(sample, film, &command, &hung.residual.steps(), &[])?;
    Ok((hung.residual.at_frames(&run.x_m), run.rest_length_m))
}

/// A recording of a sample as it is held against a film.
struct Taken {
    sample: HangingSample,
    shift_m: f64,
    offset_s: f64,
    offset_std_error_s: Option<f64>,
}

fn assemble(
    job: &'static str,
    hung: &[Hung],
    film: &Film,
    taken: &[Taken],
) -> Result<SampleOutcome, Error> {
    let recordings = hung
        .par_iter()
        .zip(taken)
        .map(|(h, taken)| one(h, film, taken))
        .collect::<Result<Vec<_>, Error>>()?;
    let total = total(recordings.iter().map(|r| &r.error));
    let rows = |f: fn(&SampleFit) -> f64| -> f64 {
        let squares = recordings.iter().map(|r| f(r).powi(2));
        squares.sum::<f64>() / recordings.len() as f64
    };
    let weighted_mean_square = rows(|r| r.rmse_m / r.noise_rmse_m);
    let mut remarks = Vec::new();
    for r in &recordings {
        if r.error.negative > 0 {
            remarks.push(format!(
                "{}: {} samples need phi^2 < 0: no voltage gives that x.",
                r.id, r.error.negative
            ));
        }
    }
    Ok(SampleOutcome {
        job,
        film: film.clone(),
        eps_r: taken[0].sample.eps_r,
        estimates: Vec::new(),
        correlation: Default::default(),
        weak_directions: Vec::new(),
        scale: None,
        recordings,
        total,
        starts: Vec::new(),
        converged: false,
        reason: String::new(),
        evaluations: 0,
        failed_evaluations: 0,
        weighted_mean_square,
        verdict: String::new(),
        remarks,
    })
}

/// Errors of several recordings together.
fn total<'e>(errors: impl Iterator<Item = &'e ChainError>) -> ChainError {
    let mut t = ChainError::default();
    let (mut high, mut all, mut floor) = (0.0, 0.0, 0.0);
    for e in errors {
        let n = e.samples as f64;
        if e.samples > 0 {
            high += n * e.rmse_v.powi(2);
            floor += n * e.noise_floor_v.powi(2);
            t.max_error_v = t.max_error_v.max(e.max_error_v);
        }
        all += e.samples_all as f64 * e.rmse_all_v.powi(2);
        t.samples += e.samples;
        t.samples_all += e.samples_all;
        t.negative += e.negative;
    }
    t.rmse_v = root_mean(high, t.samples);
    t.noise_floor_v = root_mean(floor, t.samples);
    t.rmse_all_v = root_mean(all, t.samples_all);
    t
}

/// An error above 1 kV in words, where there is one.
fn in_volts(rmse_v: f64) -> String {
    match rmse_v.is_finite() {
        true => format!("{rmse_v:.1} V"),
        false => "no error in volts".into(),
    }
}

/// Frames in gaps over which the smoothed position is worse known than [`BRIDGE_LIMIT`] times its median.
fn long_gaps(d: &HangingDataset, sd_m: &[f64]) -> Vec<(usize, usize)> {
    let mut sorted = sd_m.to_vec();
    sorted.sort_by(f64::total_cmp);
    let limit = BRIDGE_LIMIT * sorted[sorted.len() / 2];
    let open = |&(start, length): &(usize, usize)| {
        let ends = start == 0 || start + length == sd_m.len();
        ends || sd_m[start..start + length].iter().any(|s| *s > limit)
    };
    d.gaps().into_iter().filter(open).collect()
}

/// The smoothed x, and in `gaps` that of the model under the same voltages, moved along a straight line so
/// that it meets what was captured.
fn bridge(x: &mut [f64], model: &[f64], gaps: &[(usize, usize)]) {
    for &(start, length) in gaps {
        let after = start + length;
        let off = |i: usize, x: &[f64]| x[i] - model[i];
        let before = (start > 0).then(|| off(start - 1, x));
        let behind = (after < x.len()).then(|| off(after, x));
        for i in start..after {
            let f = (i + 1 - start) as f64 / (length + 1) as f64;
            let shift = match (before, behind) {
                (Some(a), Some(b)) => a + f * (b - a),
                (Some(a), None) | (None, Some(a)) => a,
                (None, None) => 0.0,
            };
            x[i] = model[i] + shift;
        }
    }
}

/// The motion as captured and smoothed, its long gaps bridged.
struct Track {
    x_m: Vec<f64>,
    acceleration: Vec<f64>,
    bridged: Vec<bool>,
}

impl Track {
    fn new(d: &HangingDataset, axis: &SmoothedAxis, shift_m: f64, predicted_m: &[f64]) -> Self {
        let mut x_m: Vec<f64> = axis.position.iter().map(|x| x - shift_m).collect();
        let gaps = long_gaps(d, &axis.position_sd);
        bridge(&mut x_m, predicted_m, &gaps);
        let mut bridged = vec![false; x_m.len()];
        let mut acceleration = axis.acceleration.clone();
        for &(start, length) in &gaps {
            bridged[start..start + length].fill(true);
            acceleration[start..start + length].fill(0.0);
        }
        Track {
            x_m,
            acceleration,
            bridged,
        }
    }

    /// Another that the capture may as well have been of: x, acceleration.
    fn drawn(&self, axis: &SmoothedAxis, seed: u64) -> [Vec<f64>; 2] {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let (mut x, mut a) = (self.x_m.clone(), self.acceleration.clone());
        axis.draw_deviation(&mut generator, |i, d| {
            if !self.bridged[i] {
                x[i] += d[0];
                a[i] += d[2];
            }
        });
        [x, a]
    }
}

/// What the motion needs on the film, with what drawn motions need, and what is there.
struct Voltages {
    needed: Vec<f64>,
    draws: Vec<Vec<f64>>,
    film_v: Vec<f64>,
    /// Command; NaN where the log has none.
    command_v: Vec<f64>,
}

impl Voltages {
    /// Standard deviation of the needed voltage, V.
    fn sd_v(&self) -> Vec<f64> {
        let draws = &self.draws;
        let sd = |(i, needed): (usize, &f64)| {
            let square: f64 = draws.iter().map(|q| (q[i] - needed).powi(2)).sum();
            let sd = (square / draws.len().max(1) as f64).sqrt();
            sd / (2.0 * root_v(*needed).max(0.5 * sd.sqrt()))
        };
        self.needed.iter().enumerate().map(sd).collect()
    }

    /// Error over the frames that count.
    fn error(&self, counts: &[bool]) -> ChainError {
        let (needed, draws) = (&self.needed, &self.draws);
        let mut sums = Sums::default();
        for i in (0..needed.len()).filter(|&i| counts[i]) {
            let judged = self.command_v[i].abs() > JUDGED_ABOVE_V;
            let noise = || {
                let drawn = draws
                    .iter()
                    .map(|q| (root_v(q[i]) - root_v(needed[i])).powi(2));
                drawn.sum::<f64>() / draws.len().max(1) as f64
            };
            sums.add(
                root_v(needed[i]) - self.film_v[i].abs(),
                needed[i] < 0.0,
                judged.then(noise),
            );
        }
        sums.error()
    }
}

fn one(hung: &Hung, film: &Film, taken: &Taken) -> Result<SampleFit, Error> {
    let d = hung.residual.dataset();
    let &Taken {
        ref sample,
        shift_m,
        offset_s,
        ..
    } = taken;
    let too_short = |e: crate::dataset::Error| Error::NothingToFit(e.to_string());
    let rows = hung
        .residual
        .rows_at(sample, film, shift_m, offset_s, &[])?;
    let noise = hung.residual.row_noise_m();
    let mean = |f: &dyn Fn(usize) -> f64| {
        let n = rows.residuals.len();
        ((0..n).map(|i| f(i).powi(2)).sum::<f64>() / n as f64).sqrt()
    };
    let (predicted_m, rest_length_m) = motion(hung, sample, film, offset_s)?;
    let axis = d.smoothed(None).map_err(too_short)?;
    let (n, h) = (d.samples(), d.step_s);
    let applied: Vec<f64> = (0..n)
        .map(|i| d.voltage.at(0, d.time_s(i) + offset_s))
        .collect();
    let (first, last) = d.voltage.span_s();
    let logged = first - 0.5 * h..=last + 0.5 * h;
    let command = |i: usize| match logged.contains(&(d.time_s(i) + offset_s)) {
        true => applied[i],
        false => f64::NAN,
    };
    let track = Track::new(d, &axis, shift_m, &predicted_m);
    let inverse = |x: &[f64], a: &[f64]| inverse_sample(sample, film, x, a, h, applied[0]);
    let SampleInverse { squared_v2, area } = inverse(&track.x_m, &track.acceleration)?;
    let draws = (0..DRAWS).into_par_iter().filter_map(|seed| {
        let [x, a] = track.drawn(&axis, seed);
        // A drawn track that the model cannot follow says nothing of the noise.
        Some(inverse(&x, &a).ok()?.squared_v2)
    });
    let voltages = Voltages {
        draws: draws.collect(),
        film_v: film_voltage_v(sample, &applied, &area, h),
        command_v: (0..n).map(command).collect(),
        needed: squared_v2,
    };
    let edge = (EDGE_S / h).round() as usize;
    let counts: Vec<bool> = (0..n)
        .map(|i| i >= edge && i + edge < n && d.captured(i) && voltages.command_v[i].is_finite())
        .collect();
    let range = |v: &[f64]| {
        let low = v.iter().copied().fold(f64::INFINITY, f64::min);
        v.iter().copied().fold(f64::NEG_INFINITY, f64::max) - low
    };
    Ok(SampleFit {
        id: d.id.clone(),
        error: voltages.error(&counts),
        rmse_m: mean(&|i| rows.residuals[i] * noise[i]),
        noise_rmse_m: mean(&|i| noise[i]),
        max_error_m: (0..noise.len()).fold(0.0, |m, i| m.max((rows.residuals[i] * noise[i]).abs())),
        noise_m: d.noise_m,
        stroke_m: [range(&track.x_m), range(&predicted_m)],
        rest_length_m,
        step_s: hung.residual.step_s(),
        offset_s,
        offset_std_error_s: taken.offset_std_error_s,
        electrode: sample.electrode,
        plan: d.plan(&axis),
        time_s: (0..n).map(|i| d.time_s(i)).collect(),
        captured_m: d.x_m.iter().map(|x| x - shift_m).collect(),
        smoothed_m: track.x_m,
        predicted_m,
        sd_v: voltages.sd_v(),
        command_v: voltages.command_v,
        film_v: voltages.film_v,
        needed_squared_v2: voltages.needed,
        area,
        counts,
        gaps: d.gaps(),
        cycles_s: repeats(
            &d.voltage,
            offset_s,
            d.time_s(0),
            d.time_s(n.saturating_sub(1)),
        ),
        notes: d.notes.clone(),
    })
}

impl SampleOutcome {
    /// Error of x over its noise, of the recording where that is largest.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        let each = self.recordings.iter().map(|r| r.rmse_m / r.noise_rmse_m);
        each.fold(0.0, f64::max)
    }
}

fn verdict(outcome: &SampleOutcome) -> String {
    let rms = |f: fn(&SampleFit) -> f64| -> f64 {
        let squares: f64 = outcome.recordings.iter().map(|r| f(r).powi(2)).sum();
        1e6 * (squares / outcome.recordings.len() as f64).sqrt()
    };
    let (error, noise) = (rms(|r| r.rmse_m), rms(|r| r.noise_rmse_m));
    let size = format!(
        "x is {error:.2} um rms off, the noise of the same averages is {noise:.2} um; {} rms above 1 kV",
        in_volts(outcome.total.rmse_v)
    );
    let ratio = outcome.ratio();
    match Standing::of(ratio) {
        Standing::CannotBeJudged => format!("The fit cannot be judged: {size}."),
        Standing::Fits => format!("The model fits to the noise: {size}."),
        Standing::NearlyFits => {
            format!(
                "The model nearly fits: {size}; in the worst recording {ratio:.1} times the noise."
            )
        }
        Standing::DoesNotFit => format!(
            "The model does not fit: {size}; in the worst recording {ratio:.1} times the noise. Something is left out or a stated number is \
             wrong."
        ),
    }
}
