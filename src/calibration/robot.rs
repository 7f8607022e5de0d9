//! Film and forearm of a robot.

use std::ops::ControlFlow;

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use super::outcome::*;
use super::solution::{Solution, Starts, gram, is_offset, precision, resting};
use super::statistics::moved_by;
use super::{Error, Uncertainty};
use crate::dataset::{Dataset, OffsetSource, repeats};
use crate::effects::{Acting, Along, Site, When, command_for};
use crate::fit::memory::Memory;
use crate::fit::profile::{Candidate, TWO_SIDED_95, profile};
use crate::fit::separable::{Ended, Options, Prior, State, Unknown, minimise};
use crate::model::{Contribution, ForearmTorque, Mechanics, Parameters, Robot, others};
use crate::parameter::{Parameter, Transform};
use crate::recording::nearest;
use crate::residual::{OFFSET_REACH_S, RobotResidual, VoltageError, root_v};

/// Which parameters are free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Film; the forearm curve is held (at zero, or at the start's).
    Film,
    /// Forearm curve; the film is held at the start's.
    Forearm,
    /// Both.
    Robot,
}

impl Stage {
    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Film => "film",
            Stage::Forearm => "forearm",
            Stage::Robot => "robot",
        }
    }
}

/// What a calibration is asked to do.
#[derive(Debug, Clone)]
pub struct Request {
    /// Which parameters are free.
    pub stage: Stage,
    /// Viscoelastic branches, 0 to 8.
    pub branches: usize,
    /// Where to begin, and what is held: parameters of an earlier run.
    pub start: Option<Parameters>,
    /// Parameters held at a value, in the parameter's unit.
    pub fix: Vec<(String, f64)>,
    /// Bounds, in the parameter's unit.
    pub bound: Vec<(String, [f64; 2])>,
    /// Number of starts, the data-driven ones included.
    pub starts: usize,
    /// Huber limit in standard deviations, where outliers shall count less.
    pub robust: Option<f64>,
    /// Seed of the random starts.
    pub seed: u64,
    /// What was found before the run was stopped.
    pub memory: Memory,
}

impl Request {
    /// A request with six branches, five starts and nothing fixed.
    pub fn new(stage: Stage) -> Self {
        Request {
            stage,
            branches: 6,
            start: None,
            fix: Vec::new(),
            bound: Vec::new(),
            starts: 5,
            robust: None,
            seed: 1,
            memory: Memory::default(),
        }
    }
}

/// Shortest and longest relaxation time between which a start spreads its branches, s.
const START_TIMES_S: [f64; 2] = [0.03, 100.0];
/// Locking constant of a start, of the order of silicone and acrylic films.
const START_LOCKING: f64 = 50.0;
/// What is known of 1/J beforehand: films lock at an invariant of ten or more.
const RECIPROCAL_LOCKING_SD: f64 = 0.05;
/// What is known of a relaxation time or the locking constant beforehand: its order of magnitude (half a
/// decade).
const LOG_PRIOR_SD: f64 = 1.15;
/// What is known of a nodal torque beforehand: a few mN m, N m.
const TORQUE_PRIOR_N_M: f64 = 5e-3;
/// Rounds of weights: the noise gain depends on the film that is being fitted.
const ROUNDS: usize = 2;
/// Pairs of tracks from which the pull of noise in the columns is told.
const NOISE_PAIRS: usize = 8;
/// Relative standard error of a relaxation time beyond which its modulus does not count as determined either.
const HARDLY_KNOWN: f64 = 0.5;
/// Relative standard errors at which a film parameter is profiled: below, the curvature suffices; above, it
/// counts as open anyway.
const PROFILED: std::ops::Range<f64> = 0.05..0.35;
/// Free clock offsets up to which each is profiled: more recordings know the film better, and each profile
/// takes them all.
const FEW_OFFSETS: usize = 3;

/// A start of `branches` relaxation times, s: evenly spread between two logarithms.
pub(super) fn spread_evenly(branches: usize, [low, high]: [f64; 2]) -> Vec<f64> {
    match branches {
        1 => vec![(0.5 * (low + high)).exp()],
        n => (0..n)
            .map(|i| (low + (high - low) * i as f64 / (n - 1) as f64).exp())
            .collect(),
    }
}

/// The relaxation time of branch `i`, s.
pub(super) fn relaxation_time(
    i: usize,
    start: f64,
    [lower, upper]: [f64; 2],
    prior_sd: f64,
) -> Parameter {
    Parameter {
        name: format!("T_{}", i + 1),
        meaning: format!("relaxation time of branch {}", i + 1),
        unit: "s",
        transform: Transform::Log,
        start,
        lower,
        upper,
        prior_sd: Some(prior_sd),
        fixed: false,
    }
}

/// J, searched by its reciprocal or its logarithm.
pub(super) fn locking(
    transform: Transform,
    start: f64,
    [lower, upper]: [f64; 2],
    prior_sd: Option<f64>,
) -> Parameter {
    Parameter {
        name: "J".into(),
        meaning: "locking constant of the Gent springs".into(),
        unit: "1",
        transform,
        start,
        lower,
        upper,
        prior_sd,
        fixed: false,
    }
}

/// The modulus of spring `i` (0: the equilibrium spring), Pa, beginning at `start`.
pub(super) fn modulus(i: usize, start: f64, fixed: bool) -> Parameter {
    Parameter {
        name: format!("mu_{}", i + 1),
        meaning: match i {
            0 => "modulus of the equilibrium spring".into(),
            i => format!("modulus of branch {i}"),
        },
        unit: "Pa",
        transform: Transform::Linear,
        start,
        lower: 0.0,
        upper: 1e9,
        prior_sd: None,
        fixed,
    }
}

/// All parameters of a robot calibration: nonlinear ones first, then linear ones, as the residual wants them.
pub(super) fn parameters(
    request: &Request,
    datasets: &[&Dataset],
) -> Result<(Vec<Parameter>, usize), Error> {
    let start = request.start.as_ref();
    let branches = start.map_or(request.branches, |p| p.film.branches());
    let hold_film = request.stage == Stage::Forearm;
    let hold_forearm = request.stage == Stage::Film;
    let shortest = datasets
        .iter()
        .map(|d| d.step_s)
        .fold(f64::INFINITY, f64::min)
        / 2.0;
    let times = start.map_or_else(
        || spread_evenly(branches, START_TIMES_S.map(f64::ln)),
        |p| p.film.relaxation_time_s.clone(),
    );
    let mut out: Vec<Parameter> = times
        .iter()
        .enumerate()
        .map(|(i, &t)| relaxation_time(i, t, [shortest, 3000.0], LOG_PRIOR_SD))
        .collect();
    let first = start.map_or(START_LOCKING, |p| p.film.locking);
    let known = Some(RECIPROCAL_LOCKING_SD);
    out.push(locking(Transform::Reciprocal, first, [0.05, 1e4], known));
    for p in &mut out {
        p.fixed = hold_film;
    }
    for d in datasets
        .iter()
        .filter(|d| d.offset_source == OffsetSource::Free)
    {
        out.push(Parameter {
            name: format!("offset_s/{}", d.id),
            meaning: format!("clock offset of {} (voltage minus motion clock)", d.id),
            unit: "s",
            transform: Transform::Linear,
            start: d.offset_s,
            lower: d.offset_s - OFFSET_REACH_S,
            upper: d.offset_s + OFFSET_REACH_S,
            prior_sd: None,
            fixed: false,
        });
    }
    let nonlinear = out.len();
    for i in 0..=branches {
        let first = start.map_or(if i == 0 { 1e6 } else { 5e4 }, |p| p.film.mu_pa[i]);
        out.push(modulus(i, first, hold_film));
    }
    let forearm = start.map_or_else(ForearmTorque::zero, |p| p.forearm.clone());
    for (node, torque) in forearm.nodes_rad().iter().zip(forearm.torque_n_m()) {
        let degrees = (node.to_degrees() * 1e6).round() / 1e6;
        out.push(Parameter {
            name: format!("torque_{degrees}deg"),
            meaning: format!("spring-back torque of a forearm at {degrees} deg"),
            unit: "N m",
            transform: Transform::Linear,
            start: *torque,
            lower: -1.0,
            upper: 1.0,
            prior_sd: Some(TORQUE_PRIOR_N_M),
            fixed: hold_forearm,
        });
    }
    apply(request, &mut out)?;
    Ok((out, nonlinear))
}

/// `--fix` and `--bound`.
pub(super) fn apply(request: &Request, parameters: &mut [Parameter]) -> Result<(), Error> {
    let names: Vec<String> = parameters.iter().map(|p| p.name.clone()).collect();
    let find = |name: &str| {
        names
            .iter()
            .position(|n| n == name)
            .ok_or_else(|| Error::UnknownParameter {
                name: name.into(),
                nearest: nearest(name, &names).map(Into::into),
                known: names.join(", "),
            })
    };
    let unit = |p: &Parameter| match p.unit {
        "1" => String::new(),
        unit => format!(" {unit}"),
    };
    let check = |p: &Parameter, value: f64| {
        if value.is_nan() || (p.transform != Transform::Linear && value <= 0.0) {
            let what = format!("{value}{} is not possible: it must be above 0", unit(p));
            return Err(Error::BadValue {
                name: p.name.clone(),
                what,
            });
        }
        Ok(())
    };
    for (name, value) in &request.fix {
        let p = &mut parameters[find(name)?];
        check(p, *value)?;
        (p.start, p.fixed) = (*value, true);
    }
    for (name, [low, high]) in &request.bound {
        let p = &mut parameters[find(name)?];
        check(p, *low)?;
        check(p, *high)?;
        if low >= high {
            let what = format!(
                "bounds {low} .. {high}{} are empty: the lower one must be smaller",
                unit(p)
            );
            return Err(Error::BadValue {
                name: p.name.clone(),
                what,
            });
        }
        (p.lower, p.upper) = (*low, *high);
        p.start = p.start.clamp(*low, *high);
    }
    Ok(())
}

pub(super) fn unknown(p: &Parameter) -> Unknown {
    let start = p.transform.to_search(p.start);
    if p.fixed {
        return Unknown::fixed(start);
    }
    let (a, b) = (
        p.transform.to_search(p.lower),
        p.transform.to_search(p.upper),
    );
    Unknown {
        start,
        lower: a.min(b),
        upper: a.max(b),
        prior: p.prior_sd.map(|sd| Prior { mean: start, sd }),
    }
}

/// The fit of a robot under way.
struct RobotFit<'a> {
    residual: RobotResidual<'a>,
    /// Parameters that are searched come first, `split` of them.
    list: Vec<Parameter>,
    split: usize,
    unknowns: Vec<Unknown>,
    branches: usize,
    request: &'a Request,
    watch: &'a (dyn Fn(&State) -> ControlFlow<()> + Sync),
}

/// How sure a fit is.
struct Sureness {
    gram: DMatrix<f64>,
    precision: Vec<f64>,
    uncertainty: Uncertainty,
    /// How far a parameter's profile reaches to both sides.
    reaches: Vec<Option<[f64; 2]>>,
}

impl<'a> RobotFit<'a> {
    fn new(
        robot: &'a Robot,
        datasets: &[&'a Dataset],
        request: &'a Request,
        watch: &'a (dyn Fn(&State) -> ControlFlow<()> + Sync),
    ) -> Result<Self, Error> {
        if datasets.is_empty() {
            return Err(Error::NothingToFit("no recording was given".into()));
        }
        let start = request.start.as_ref();
        if request.stage == Stage::Forearm && start.is_none() {
            let what = "fitting the forearm needs the film's parameters: give --params";
            return Err(Error::NothingToFit(what.into()));
        }
        let (list, split) = parameters(request, datasets)?;
        let unknowns: Vec<Unknown> = list.iter().map(unknown).collect();
        let forearm = start.map_or_else(ForearmTorque::zero, |p| p.forearm.clone());
        let branches = start.map_or(request.branches, |p| p.film.branches());
        let residual = open(robot, datasets, branches, &forearm)?;
        let free = unknowns.iter().filter(|u| !u.is_fixed()).count();
        if residual.rows() < 2 * free {
            let what = format!(
                "the recordings give {} independent samples for {free} free parameters: record longer, or fix more",
                residual.rows()
            );
            return Err(Error::NothingToFit(what));
        }
        Ok(RobotFit {
            residual,
            list,
            split,
            unknowns,
            branches,
            request,
            watch,
        })
    }

    fn search(&self, eta: &[f64]) -> State {
        let (nonlinear, linear) = self.unknowns.split_at(self.split);
        let (memory, options) = (&self.request.memory, Options::default());
        memory.minimise(
            "the fit",
            &self.residual,
            nonlinear,
            linear,
            eta,
            &options,
            self.watch,
        )
    }

    /// On from `state` in rounds of weights that the noise makes at the film that was found.
    fn weighed(&mut self, mut state: State, spent: &mut Starts) -> Result<State, Error> {
        for round in 0..ROUNDS {
            self.residual.weigh(&state.eta, &state.beta)?;
            if let (Some(limit), true) = (self.request.robust, round > 0) {
                self.residual.robustify(&state.eta, &state.beta, limit)?;
            }
            let next = self.search(&state.eta);
            spent.evaluations += next.evaluations;
            spent.failed += next.failed;
            if !next.cost.is_finite() {
                break;
            }
            state = next;
            if state.ended == Some(Ended::Stopped) {
                break;
            }
        }
        Ok(state)
    }

    /// By the curvature, and by profiles where that may be wrong.
    fn sureness(&self, state: &State, spent: &mut Starts) -> Result<Sureness, Error> {
        let scores = self.residual.score_covariance(&state.eta, &state.beta)?;
        let (gram, precision) = (gram(state), precision(&self.unknowns));
        // What rests on a bound by chance moves the others all the same: it counts as free in the covariance.
        let is_free: Vec<bool> = self.unknowns.iter().map(|u| !u.is_fixed()).collect();
        let uncertainty = Uncertainty::new(&gram, &scores, &precision, &is_free);
        let white = Uncertainty::new(&gram, &gram, &precision, &is_free);
        let candidates = candidates(&self.list, state, &uncertainty, &white, self.split);
        let (nonlinear, linear) = self.unknowns.split_at(self.split);
        let (reach, evaluations) = profile(
            &self.residual,
            nonlinear,
            linear,
            state,
            &candidates,
            (&self.request.memory, "an interval"),
        );
        spent.evaluations += evaluations;
        let mut reaches = vec![None; self.unknowns.len()];
        for (candidate, reach) in candidates.iter().zip(reach) {
            reaches[candidate.unknown] = Some(reach);
        }
        Ok(Sureness {
            gram,
            precision,
            uncertainty,
            reaches,
        })
    }

    /// Takes back what noise in the columns pulls: where a clock offset is free the band is wide, and it
    /// pulls at all that fast motion tells.
    fn pull_back(
        &self,
        state: &mut State,
        resting: &[Option<AtBound>],
        sure: &mut Sureness,
    ) -> Result<(), Error> {
        if self.residual.layout().free_offsets.is_empty() {
            return Ok(());
        }
        let score = (self.residual).expected_score(None, &state.eta, &state.beta, NOISE_PAIRS)?;
        let Some(score) = score else {
            return Ok(());
        };
        let free = sure.uncertainty.free.iter().zip(resting);
        let moving: Vec<bool> = free.map(|(free, r)| *free && r.is_none()).collect();
        let pulled = moved_by(&sure.gram, &sure.precision, &moving, &score.mean);
        let (eta, beta) = (state.eta.iter_mut(), state.beta.iter_mut());
        for ((x, u), by) in eta.chain(beta).zip(&self.unknowns).zip(&pulled) {
            if *by != 0.0 {
                *x = (*x - by).clamp(u.lower, u.upper);
            }
        }
        // a correction of first order, and at the film that was pulled: as uncertain as it is large
        sure.uncertainty.covariance += &pulled * pulled.transpose();
        for (reach, by) in sure.reaches.iter_mut().zip(&pulled) {
            if let Some(reach) = reach {
                *reach = reach.map(|d| d.hypot(TWO_SIDED_95 * by));
            }
        }
        Ok(())
    }
}

/// Calibrates film and forearm on `datasets`. `watch` sees each evaluation and may stop the fit.
///
/// Several starts (spread evenly, then at random within the priors) run in parallel with equal weights; the
/// best goes on through rounds in which the weights are set to what the noise of capture and voltage makes of
/// the residual at the fitted film.
///
/// # Errors
/// [`Error`]; a fit that does not converge is not an error but is said in the outcome.
pub fn calibrate_robot(
    robot: &Robot,
    datasets: &[&Dataset],
    request: &Request,
    watch: &(dyn Fn(&State) -> ControlFlow<()> + Sync),
) -> Result<Outcome, Error> {
    let mut fit = RobotFit::new(robot, datasets, request, watch)?;
    let (split, branches) = (fit.split, fit.branches);
    // Several starts, equal weights.
    let begins = starts(&fit.unknowns[..split], request);
    let mut starts = Starts::run(begins, (&fit.list, branches), |eta| fit.search(eta));
    let first = starts.take(0)?;
    let mut state = fit.weighed(first, &mut starts)?;
    let mut sure = fit.sureness(&state, &mut starts)?;
    let resting = resting(&fit.unknowns, &state);
    fit.pull_back(&mut state, &resting, &mut sure)?;
    let (residual, uncertainty) = (&fit.residual, &sure.uncertainty);
    let solution = Solution::new(&fit.list, split, branches, &state, &resting);
    let mut estimates = solution.estimates(uncertainty, &sure.reaches);
    let longest_s = datasets.iter().map(|d| d.length_s()).fold(0.0, f64::max);
    doubt_slow_branches(&mut estimates, longest_s);
    let mut parameters = residual.parameters(&state.eta, &state.beta);
    parameters.film = solution.sorted(&parameters.film);
    let job = request.stage.name();
    let mut outcome = assemble(job, residual, &state.eta, &state.beta, parameters)?;
    outcome.eps_r = robot.eps_r;
    outcome.weak_directions = solution.weak_directions(uncertainty);
    outcome.correlation = solution.correlation(uncertainty);
    outcome.estimates = estimates;
    let ended = state.ended.unwrap_or(Ended::EvaluationLimit);
    outcome.converged = ended.converged();
    outcome.reason = ended.words().into();
    outcome.evaluations = starts.evaluations;
    outcome.failed_evaluations = starts.failed;
    outcome.weighted_mean_square = state.data_cost / state.rows.max(1) as f64;
    outcome.noise_mean_square = residual.noise_mean_square();
    torque_band(&mut outcome, uncertainty, split + branches + 1);
    say_open_level(&mut outcome);
    for (place, number) in residual.layout().free_offsets.iter().enumerate() {
        let error = outcome.estimates[branches + 1 + place].std_error;
        outcome.recordings[*number].offset_std_error_s = Some(error);
    }
    outcome.remarks.extend(starts.remark());
    outcome.starts = starts.waterfall;
    Ok(outcome)
}

/// Holds `parameters` against `datasets`: predicted against commanded voltage, nothing fitted but clock
/// offsets that a recording leaves to be estimated.
///
/// # Errors
/// [`Error`].
pub fn validate_robot(
    robot: &Robot,
    datasets: &[&Dataset],
    parameters: &Parameters,
) -> Result<Outcome, Error> {
    validate_robot_with(robot, datasets, parameters, &[], &[])
}

/// [`validate_robot`] with causes at work beside the plain model; `series` says when each recording was made.
/// The error is that at the film: the voltage that the measured motion needs minus the one that the command
/// makes there.
///
/// # Errors
/// Those of [`validate_robot`]; a mechanism that cannot follow.
pub fn validate_robot_with(
    robot: &Robot,
    datasets: &[&Dataset],
    parameters: &Parameters,
    effects: &[Acting],
    series: &[When],
) -> Result<Outcome, Error> {
    let request = Request {
        start: Some(parameters.clone()),
        ..Request::new(Stage::Film)
    };
    let (mut list, split) = self::parameters(&request, datasets)?;
    for p in &mut list {
        p.fixed |= !is_offset(p);
    }
    let unknowns: Vec<Unknown> = list.iter().map(unknown).collect();
    let (nonlinear, linear) = unknowns.split_at(split);
    let mut residual = open(
        robot,
        datasets,
        parameters.film.branches(),
        &parameters.forearm,
    )?;
    if !effects.is_empty() {
        residual = residual.with_effects(effects.to_vec(), Vec::new(), series);
    }
    let mut eta: Vec<f64> = nonlinear.iter().map(|u| u.start).collect();
    let beta: Vec<f64> = linear.iter().map(|u| u.start).collect();
    let mut errors = Vec::new();
    if !residual.layout().free_offsets.is_empty() {
        let watch = |_: &State| ControlFlow::Continue(());
        let mut state = minimise(
            &residual,
            nonlinear,
            linear,
            &eta,
            &Options::default(),
            watch,
        );
        residual.weigh(&state.eta, &beta)?;
        state = minimise(
            &residual,
            nonlinear,
            linear,
            &state.eta,
            &Options::default(),
            watch,
        );
        eta = state.eta.clone();
        let scores = residual.score_covariance(&eta, &beta)?;
        let free: Vec<bool> = unknowns.iter().map(|u| !u.is_fixed()).collect();
        let uncertainty = Uncertainty::new(&gram(&state), &scores, &vec![0.0; free.len()], &free);
        let first = parameters.film.branches() + 1;
        errors = (0..residual.layout().free_offsets.len())
            .map(|i| uncertainty.std_error(first + i))
            .collect();
    }
    let mut outcome = assemble("validate", &residual, &eta, &beta, parameters.clone())?;
    outcome.eps_r = robot.eps_r;
    outcome.converged = true;
    for (number, error) in residual.layout().free_offsets.iter().zip(errors) {
        outcome.recordings[*number].offset_std_error_s = Some(error);
    }
    Ok(outcome)
}

pub(super) fn open<'a>(
    robot: &'a Robot,
    datasets: &[&'a Dataset],
    branches: usize,
    forearm: &ForearmTorque,
) -> Result<RobotResidual<'a>, Error> {
    RobotResidual::new(robot, datasets, branches, forearm).map_err(|(number, sample, why)| {
        Error::Unreachable {
            recording: datasets[number].id.clone(),
            time_s: datasets[number].time_s(sample),
            why: why.to_string(),
        }
    })
}

/// The starts: the given or evenly spread one first, then random ones within the priors.
pub(super) fn starts(nonlinear: &[Unknown], request: &Request) -> Vec<(String, Vec<f64>)> {
    let first: Vec<f64> = nonlinear.iter().map(|u| u.start).collect();
    let name = if request.start.is_some() {
        "given parameters"
    } else {
        "evenly spread"
    };
    let mut out = vec![(name.to_string(), first.clone())];
    if nonlinear.iter().all(Unknown::is_fixed) {
        return out;
    }
    let mut generator = ChaCha12Rng::seed_from_u64(request.seed);
    for number in 1..request.starts.max(1) {
        let eta = nonlinear
            .iter()
            .map(|u| match u.prior {
                Some(p) => {
                    let shift = p.sd * (2.0 * generator.random::<f64>() - 1.0);
                    (p.mean + shift).clamp(u.lower, u.upper)
                }
                None => u.start,
            })
            .collect();
        out.push((format!("random {number}"), eta));
    }
    out
}

/// A branch whose relaxation time is longer than half the longest recording, or hardly known, is not called
/// determined, whatever the curvature says: it shows only its beginning, which the equilibrium spring and its
/// neighbours can imitate.
fn doubt_slow_branches(estimates: &mut [Estimate], longest_s: f64) {
    let times: Vec<(String, f64, f64)> = estimates
        .iter()
        .filter_map(|e| {
            let number = e.name.strip_prefix("T_")?;
            Some((number.to_string(), e.value, e.std_error / e.value))
        })
        .collect();
    for (number, time_s, relative) in times {
        let slow = time_s > 0.5 * longest_s;
        if !slow && relative < HARDLY_KNOWN {
            continue;
        }
        let modulus = number.parse::<usize>().map_or(0, |n| n + 1);
        for e in estimates.iter_mut() {
            let of_branch = e.name == format!("T_{number}") || e.name == format!("mu_{modulus}");
            if of_branch && e.identifiable {
                e.identifiable = false;
                e.says = if slow {
                    format!(
                        "not determined: {longest_s:.0} s of recording are too short for a branch of {time_s:.0} s"
                    )
                } else {
                    format!(
                        "not determined: the relaxation time of its branch is open to {:.0} %",
                        100.0 * relative
                    )
                };
            }
        }
    }
}

/// Clock offsets, with which the fastest branch goes along, where there are few, and film parameters of
/// middling certainty: those whose interval the curvature alone may get wrong, and that may still be called
/// determined.
fn candidates(
    list: &[Parameter],
    state: &State,
    uncertainty: &Uncertainty,
    white: &Uncertainty,
    split: usize,
) -> Vec<Candidate> {
    let free_offsets = list.iter().filter(|p| is_offset(p) && !p.fixed).count();
    let few = free_offsets <= FEW_OFFSETS;
    (0..list.len())
        .filter(|&i| uncertainty.free[i])
        .filter_map(|unknown| {
            let std_error = uncertainty.std_error(unknown);
            let curved = match (list[unknown].transform, list[unknown].unit) {
                (Transform::Log, _) => PROFILED.contains(&std_error),
                (_, "Pa") => PROFILED.contains(&(std_error / state.beta[unknown - split].abs())),
                _ => few && is_offset(&list[unknown]),
            };
            let own = white.covariance[(unknown, unknown)];
            curved.then(|| Candidate {
                unknown,
                std_error,
                inflation: (std_error * std_error / own).max(1.0),
            })
        })
        .collect()
}

/// Nodes that the recordings reach and yet do not determine: what is open there is the level of the whole
/// curve.
fn say_open_level(outcome: &mut Outcome) {
    let [low, high] = outcome.swing_range_deg;
    for e in outcome
        .estimates
        .iter_mut()
        .filter(|e| e.unit == "N m" && !e.fixed && !e.identifiable)
    {
        let angle = e
            .name
            .trim_start_matches("torque_")
            .trim_end_matches("deg")
            .parse::<f64>();
        if angle.is_ok_and(|a| (low - 1.0..=high + 1.0).contains(&a)) {
            e.says = "level open: a torque that is the same at every angle nearly cancels between the three chains; differences \
                      between the nodes within the swing are determined"
                .into();
        }
    }
}

/// The torque curve with its band over the nodes' range.
fn torque_band(outcome: &mut Outcome, uncertainty: &Uncertainty, first_node: usize) {
    let forearm = &outcome.parameters.forearm;
    let nodes = forearm.nodes_rad().len();
    let (low, high) = (forearm.nodes_rad()[0], forearm.nodes_rad()[nodes - 1]);
    let mut basis = vec![0.0; nodes];
    outcome.torque_band = (0..=120)
        .map(|i| {
            let theta = low + (high - low) * f64::from(i) / 120.0;
            forearm.basis(theta, &mut basis);
            let torque: f64 = basis
                .iter()
                .zip(forearm.torque_n_m())
                .map(|(b, t)| b * t)
                .sum();
            let mut variance = 0.0;
            for a in 0..nodes {
                for b in 0..nodes {
                    variance += basis[a]
                        * basis[b]
                        * uncertainty.covariance[(first_node + a, first_node + b)];
                }
            }
            [
                theta.to_degrees(),
                torque * 1e3,
                1.96 * variance.max(0.0).sqrt() * 1e3,
            ]
        })
        .collect();
}

/// Adds the error of chain `k` at frame `i`.
fn add(sums: &mut Sums, e: &VoltageError, i: usize, k: usize) {
    let (squared, command) = (e.predicted_squared_v2[i][k], e.command_v[i][k]);
    let noise = e.sd_v[i][k] * e.sd_v[i][k];
    let judged = command.abs() > JUDGED_ABOVE_V;
    sums.add(
        root_v(squared) - command,
        squared < 0.0,
        judged.then_some(noise),
    );
}

/// A recording against the model, without the sums of its errors.
fn recording(
    residual: &RobotResidual,
    number: usize,
    d: &Dataset,
    (eta, parameters): (&[f64], &Parameters),
    e: VoltageError,
) -> Result<RecordingOutcome, Error> {
    let mechanics = residual.mechanics(number);
    let n = d.samples();
    let needed = mechanics.needed_torque_n_m(parameters)?;
    let contributions = Contribution::ALL.iter().enumerate().map(|(c, name)| {
        let rms =
            |k: usize| (needed[k].iter().map(|row| row[c] * row[c]).sum::<f64>() / n as f64).sqrt();
        (name.name().to_string(), [rms(0), rms(1), rms(2)])
    });
    let offset_s = residual.offset_s(number, eta);
    let position = d.track().position_m;
    let volts = |v: f64| if v.is_nan() { v } else { root_v(v) };
    let monitor = d.monitor.as_ref();
    Ok(RecordingOutcome {
        id: d.id.clone(),
        chains: Default::default(),
        total: Default::default(),
        offset_s,
        offset_std_error_s: None,
        plan: d.plan.clone(),
        time_s: (0..n).map(|i| d.time_s(i)).collect(),
        position_mm: position.iter().map(|p| p.map(|v| v * 1e3)).collect(),
        predicted_v: (e.predicted_squared_v2.iter())
            .map(|p| p.map(volts))
            .collect(),
        predicted_squared_v2: e.predicted_squared_v2,
        command_v: e.command_v,
        sd_v: e.sd_v,
        monitor_v: monitor.map(|m| {
            (0..n)
                .map(|i| [0, 1, 2].map(|k| m.at(k, d.time_s(i) + offset_s)))
                .collect()
        }),
        counts: e.counts,
        gap: (0..n).map(|i| !d.captured(i)).collect(),
        unreachable: (mechanics.unreachable.iter())
            .map(|(i, why)| (*i, why.to_string()))
            .collect(),
        contributions_n_m: contributions.collect(),
        swing_deg: (0..n)
            .map(|i| [0, 1, 2].map(|k| mechanics.chains[k].theta_fa_rad[i].to_degrees()))
            .collect(),
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

/// Whether the model fits, in one sentence.
fn verdict(total: &ChainError) -> String {
    let (rmse_v, floor_v) = (total.rmse_v, total.noise_floor_v);
    let ratio = rmse_v / floor_v;
    if total.samples == 0 {
        return "No sample has a command above 1 kV: the fit cannot be judged in volts."
            .to_string();
    }
    if !floor_v.is_finite() {
        return "The fit cannot be judged: with these parameters the motion's noise moves the voltages beyond all numbers; check the parameters."
            .to_string();
    }
    match Standing::of(ratio) {
        Standing::CannotBeJudged => "The fit cannot be judged: at the poses of the motion its noise moves no voltage at all; check the rig's lengths and angles."
            .to_string(),
        Standing::Fits => format!(
            "The model fits to the noise: {rmse_v:.1} V rms above 1 kV, where the noise of the capture alone makes {floor_v:.1} V."
        ),
        Standing::NearlyFits => format!(
            "The model nearly fits: {rmse_v:.1} V rms above 1 kV, {ratio:.1} times the {floor_v:.1} V that the noise of the capture makes."
        ),
        Standing::DoesNotFit => format!(
            "The model does not fit: {rmse_v:.1} V rms above 1 kV, {ratio:.1} times the {floor_v:.1} V that the noise of the capture makes. Something is left out."
        ),
    }
}

fn assemble(
    job: &'static str,
    residual: &RobotResidual,
    eta: &[f64],
    beta: &[f64],
    parameters: Parameters,
) -> Result<Outcome, Error> {
    let mut recordings = Vec::new();
    let mut total = Sums::default();
    let mut swing_range_deg = [f64::INFINITY, f64::NEG_INFINITY];
    let mut places = Places::default();
    let mut remarks = Vec::new();
    for (number, d) in residual.datasets().enumerate() {
        let e: VoltageError = residual.voltage_error(number, eta, beta)?;
        let mut chains = [Sums::default(); 3];
        for i in (0..d.samples()).filter(|&i| e.counts[i]) {
            for (k, chain) in chains.iter_mut().enumerate() {
                add(chain, &e, i, k);
            }
        }
        places.add(&d.id, d, &e);
        let mut own = Sums::default();
        chains.iter().for_each(|c| own.merge(c));
        total.merge(&own);
        let mut r = recording(residual, number, d, (eta, &parameters), e)?;
        (r.chains, r.total) = (chains.map(|c| c.error()), own.error());
        let counted = r.swing_deg.iter().zip(&r.counts).filter(|(_, c)| **c);
        for swing in counted.flat_map(|(swing, _)| *swing) {
            swing_range_deg = [swing_range_deg[0].min(swing), swing_range_deg[1].max(swing)];
        }
        if r.total.negative > 0 {
            remarks.push(format!(
                "{}: at {} of {} samples phi^2 < 0: no voltage holds that pose; they count as 0 V.",
                d.id, r.total.negative, r.total.samples_all
            ));
        }
        recordings.push(r);
    }
    let total = total.error();
    Ok(Outcome {
        job,
        parameters,
        eps_r: f64::NAN,
        estimates: Vec::new(),
        correlation: Default::default(),
        weak_directions: Vec::new(),
        recordings,
        verdict: verdict(&total),
        total,
        starts: Vec::new(),
        converged: false,
        reason: String::new(),
        evaluations: 0,
        failed_evaluations: 0,
        weighted_mean_square: f64::NAN,
        noise_mean_square: f64::NAN,
        torque_band: Vec::new(),
        swing_range_deg,
        worst: places.worst(),
        remarks,
    })
}

/// Errors by place: recording and actuator, voltage band, direction of the voltage.
#[derive(Default)]
struct Places {
    bins: Vec<(String, Sums)>,
}

impl Places {
    fn add(&mut self, id: &str, d: &Dataset, e: &VoltageError) {
        let mut bins: std::collections::BTreeMap<String, Sums> = Default::default();
        for i in (1..d.samples()).filter(|&i| e.counts[i]) {
            for k in 0..3 {
                let command = e.command_v[i][k];
                if command.abs() <= JUDGED_ABOVE_V {
                    continue;
                }
                let band = (command.abs() / 1500.0).floor() * 1.5;
                let change = command - e.command_v[i - 1][k];
                let direction = if change > 0.0 {
                    "rising"
                } else if change < 0.0 {
                    "falling"
                } else {
                    "held"
                };
                for place in [
                    format!("actuator {} of {id}", k + 1),
                    format!("{:.1} to {:.1} kV in {id}", band, band + 1.5),
                    format!("voltage {direction} in {id}"),
                ] {
                    add(bins.entry(place).or_default(), e, i, k);
                }
            }
        }
        self.bins.extend(bins);
    }

    fn worst(&self) -> Vec<WorstPlace> {
        let excess = |s: &Sums| (s.squares - s.floor).max(0.0);
        // every sample is in three kinds of bins
        let whole: f64 = self.bins.iter().map(|b| excess(&b.1)).sum::<f64>() / 3.0;
        let mut out: Vec<WorstPlace> = self
            .bins
            .iter()
            .filter(|(_, s)| s.count >= 50)
            .map(|(place, s)| {
                let e = s.error();
                WorstPlace {
                    place: place.clone(),
                    ratio: e.rmse_v / e.noise_floor_v,
                    rmse_v: e.rmse_v,
                    share: if whole > 0.0 {
                        (excess(s) / whole).min(1.0)
                    } else {
                        0.0
                    },
                }
            })
            .collect();
        out.sort_by(|a, b| b.ratio.total_cmp(&a.ratio));
        out.truncate(5);
        out
    }
}

/// Times that commands are looked for where they depend on each other: each time what is left falls by the
/// share that one actuator hears of another.
const COMMAND_ROUNDS: usize = 8;

/// The commands at which the electrical causes make the voltages `film_v` on the films along the measured
/// motion, V; NaN where none does (above a ceiling, steeper than a limit). Without such causes these are the
/// voltages themselves.
///
/// # Errors
/// [`Error::Unreachable`] when no frame can be followed.
pub fn predict_command(
    robot: &Robot,
    dataset: &Dataset,
    film_v: &[[f64; 3]],
    effects: &[Acting],
    when: When,
) -> Result<Vec<[f64; 3]>, Error> {
    let mechanics = mechanics(robot, dataset, effects)?;
    let wanted = [0, 1, 2].map(|k| film_v.iter().map(|v| v[k]).collect::<Vec<f64>>());
    let mut told = wanted.clone();
    // what one actuator needs may depend on what the others are told
    let rounds = if effects.iter().any(|a| a.effect.hears_others()) {
        COMMAND_ROUNDS
    } else {
        1
    };
    for _ in 0..rounds {
        let before = told.clone();
        for k in 0..3 {
            let chain: Vec<&Acting> = effects
                .iter()
                .filter(|a| a.on[k] && a.effect.site() == Site::Electrical)
                .collect();
            if !chain.is_empty() {
                let along = Along {
                    others_v: others(k, [0, 1, 2].map(|j| &before[j][..])),
                    ..mechanics.along(k, when)
                };
                told[k] = command_for(&chain, &along, &wanted[k]);
            }
        }
    }
    let out = (0..film_v.len()).map(|i| [0, 1, 2].map(|k| told[k][i]));
    Ok(out.collect())
}

/// The balance along a recording, with the causes that move it.
fn mechanics(robot: &Robot, dataset: &Dataset, effects: &[Acting]) -> Result<Mechanics, Error> {
    Mechanics::with_effects(robot, &dataset.track(), effects, dataset.pivot_m, None).map_err(
        |(sample, why)| Error::Unreachable {
            recording: dataset.id.clone(),
            time_s: dataset.time_s(sample),
            why: why.to_string(),
        },
    )
}

/// Force prediction F_FP: the force of the surroundings on the end effector at each frame of `dataset` (N,
/// world axes; NaN out of reach or without a voltage), from its motion and its commanded voltages read with
/// the clock offset `offset_s`. With causes at work, in a recording made at `when`, their torques count as
/// the robot's own.
///
/// # Errors
/// [`Error::Unreachable`] when no frame can be followed, [`Error::Locked`] when the film is past its locking
/// stretch.
pub fn predict_force(
    robot: &Robot,
    dataset: &Dataset,
    parameters: &Parameters,
    offset_s: f64,
    effects: &[Acting],
    when: When,
) -> Result<Vec<[f64; 3]>, Error> {
    let mechanics = mechanics(robot, dataset, effects)?;
    let n = dataset.samples();
    let clock = |t: f64| {
        let on_clock = effects.iter().filter(|a| a.effect.site() == Site::Clock);
        on_clock.fold(t, |t, a| a.effect.clock(&a.values, t))
    };
    let (shift, rate) = (clock(0.0), clock(1.0) - clock(0.0));
    let (start_s, step_s) = (dataset.start_s + offset_s + shift, dataset.step_s * rate);
    let mut squared = [0, 1, 2].map(|k| dataset.voltage.squared(k, start_s, step_s, n).0);
    if !effects.is_empty() {
        let commands = [0, 1, 2].map(|k| -> Vec<f64> {
            (0..n)
                .map(|i| dataset.voltage.at(k, start_s + step_s * i as f64))
                .collect()
        });
        for (k, squared) in squared.iter_mut().enumerate() {
            let command = &commands[k];
            let told = [0, 1, 2].map(|k| &commands[k][..]);
            let film_v = mechanics.film_voltage_v(k, when, effects, told);
            let half = mechanics.half_capacitance_slope(k, when, effects);
            let torque = mechanics.effect_torque_n_m(k, when, effects);
            let slack = mechanics.slack_torque_n_m(k, when, effects, parameters, &film_v)?;
            let factor = mechanics.stress_factor(k, when, effects, &parameters.film);
            let film = match factor {
                Some(_) => mechanics.film_torque_n_m(k, parameters)?,
                None => Vec::new(),
            };
            for i in 0..n {
                // Everything that the causes change, as the squared voltage that would do the same in the
                // plain balance.
                let change = film_v[i] * film_v[i] - command[i] * command[i];
                let made = half[i] * (squared[i] + change);
                let missing = slack.as_ref().map_or(0.0, |s| s[i]);
                let softer = factor.as_ref().map_or(0.0, |f| {
                    film[i][0] * (1.0 - f[i][0]) + film[i][1] * (1.0 - f[i][1])
                });
                squared[i] = (made + torque[i] - missing + softer)
                    / mechanics.chains[k].half_capacitance_slope[i];
            }
        }
    }
    let phi: Vec<[f64; 3]> = (0..n).map(|i| [0, 1, 2].map(|k| squared[k][i])).collect();
    let mut force = mechanics.external_force_n(parameters, &phi)?;
    for (i, force) in force.iter_mut().enumerate() {
        if !dataset.has_voltage(i, offset_s) || !dataset.usable[i] {
            *force = [f64::NAN; 3];
        }
    }
    Ok(force)
}
