//! Film and forearm of a robot.

use std::ops::ControlFlow;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;

use super::outcome::*;
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
/// Relative standard error up to which a parameter counts as determined.
const IDENTIFIABLE: f64 = 0.33;
/// Relative standard error of a relaxation time beyond which its modulus does not count as determined either.
const HARDLY_KNOWN: f64 = 0.5;
/// Relative standard errors at which a film parameter is profiled: below, the curvature suffices; above, it
/// counts as open anyway.
const PROFILED: std::ops::Range<f64> = 0.05..0.35;
/// Free clock offsets up to which each is profiled: more recordings know the film better, and each profile
/// takes them all.
const FEW_OFFSETS: usize = 3;
/// Relative standard error up to which the locking constant counts as determined; it is searched by its
/// reciprocal.
const IDENTIFIABLE_LIMIT: f64 = 0.2;
/// Standard error up to which a nodal torque counts as determined, N m.
const IDENTIFIABLE_TORQUE_N_M: f64 = 2e-4;
/// Relative standard deviation above which a combination of parameters is reported as open.
const OPEN: f64 = 0.5;

/// Default start of `branches` relaxation times, s: evenly spread in their logarithm.
fn start_times(branches: usize) -> Vec<f64> {
    let [a, b] = START_TIMES_S.map(f64::ln);
    match branches {
        1 => vec![((a + b) / 2.0).exp()],
        n => (0..n)
            .map(|i| (a + (b - a) * i as f64 / (n - 1) as f64).exp())
            .collect(),
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
        || start_times(branches),
        |p| p.film.relaxation_time_s.clone(),
    );
    let mut out = Vec::new();
    for (i, &t) in times.iter().enumerate() {
        out.push(Parameter {
            name: format!("T_{}", i + 1),
            meaning: format!("relaxation time of branch {}", i + 1),
            unit: "s",
            transform: Transform::Log,
            start: t,
            lower: shortest,
            upper: 3000.0,
            prior_sd: Some(LOG_PRIOR_SD),
            fixed: hold_film,
        });
    }
    out.push(Parameter {
        name: "J".into(),
        meaning: "locking constant of the Gent springs".into(),
        unit: "1",
        transform: Transform::Reciprocal,
        start: start.map_or(START_LOCKING, |p| p.film.locking),
        lower: 0.05,
        upper: 1e4,
        prior_sd: Some(RECIPROCAL_LOCKING_SD),
        fixed: hold_film,
    });
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
    let check = |p: &Parameter, value: f64| {
        if value.is_nan() || (p.transform != Transform::Linear && value <= 0.0) {
            let what = format!("{value} {} is not possible: it must be above 0", p.unit);
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
                "bounds {low} .. {high} {} are empty: the lower one must be smaller",
                p.unit
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
    if datasets.is_empty() {
        return Err(Error::NothingToFit("no recording was given".into()));
    }
    if request.stage == Stage::Forearm && request.start.is_none() {
        let what = "fitting the forearm needs the film's parameters: give --params";
        return Err(Error::NothingToFit(what.into()));
    }
    let (list, split) = parameters(request, datasets)?;
    let unknowns: Vec<Unknown> = list.iter().map(unknown).collect();
    let (nonlinear, linear) = unknowns.split_at(split);
    let forearm = request
        .start
        .as_ref()
        .map_or_else(ForearmTorque::zero, |p| p.forearm.clone());
    let branches = request
        .start
        .as_ref()
        .map_or(request.branches, |p| p.film.branches());
    let mut residual = open(robot, datasets, branches, &forearm)?;
    let free = unknowns.iter().filter(|u| !u.is_fixed()).count();
    if residual.rows() < 2 * free {
        let what = format!(
            "the recordings give {} independent samples for {free} free parameters: record longer, or fix more",
            residual.rows()
        );
        return Err(Error::NothingToFit(what));
    }
    let options = Options::default();
    // Several starts, equal weights.
    let starts = starts(nonlinear, request);
    let search = |residual: &RobotResidual, eta: &[f64]| {
        let memory = &request.memory;
        memory.minimise("the fit", residual, nonlinear, linear, eta, &options, watch)
    };
    let mut states: Vec<(String, State)> = starts
        .into_par_iter()
        .map(|(origin, eta)| (origin, search(&residual, &eta)))
        .collect();
    states.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    let mut evaluations: usize = states.iter().map(|s| s.1.evaluations).sum();
    let mut failed: usize = states.iter().map(|s| s.1.failed).sum();
    let waterfall: Vec<StartOutcome> = states
        .iter()
        .map(|(origin, s)| StartOutcome {
            origin: origin.clone(),
            cost: s.cost / s.rows.max(1) as f64,
            evaluations: s.evaluations,
            failed: s.failed,
            ended: s.ended.map_or("", Ended::words).into(),
            reached: list[..=branches]
                .iter()
                .zip(&s.eta)
                .map(|(p, x)| p.transform.to_model(*x))
                .collect(),
        })
        .collect();
    let mut state = states.swap_remove(0).1;
    if !state.cost.is_finite() {
        return Err(Error::AllStartsFailed {
            tried: waterfall.len(),
            last: state.failure.unwrap_or_default(),
        });
    }
    // Weights from the noise, at the film that was found.
    for round in 0..ROUNDS {
        residual.weigh(&state.eta, &state.beta)?;
        if let (Some(limit), true) = (request.robust, round > 0) {
            residual.robustify(&state.eta, &state.beta, limit)?;
        }
        let next = search(&residual, &state.eta);
        evaluations += next.evaluations;
        failed += next.failed;
        if !next.cost.is_finite() {
            break;
        }
        state = next;
        if state.ended == Some(Ended::Stopped) {
            break;
        }
    }
    let scores = residual.score_covariance(&state.eta, &state.beta)?;
    let gram = state.gram();
    let precision: Vec<f64> = unknowns
        .iter()
        .map(|u| {
            u.prior
                .filter(|_| !u.is_fixed())
                .map_or(0.0, |p| p.sd.powi(-2))
        })
        .collect();
    let resting: Vec<Option<AtBound>> = unknowns
        .iter()
        .zip(state.eta.iter().chain(&state.beta))
        .map(|(u, &x)| {
            let near = 1e-9 * (u.upper - u.lower).min(1.0);
            match u {
                u if u.is_fixed() => None,
                u if x <= u.lower + near => Some(AtBound::Lower),
                u if x >= u.upper - near => Some(AtBound::Upper),
                _ => None,
            }
        })
        .collect();
    // What rests on a bound by chance moves the others all the same: it counts as free in the covariance.
    let is_free: Vec<bool> = unknowns.iter().map(|u| !u.is_fixed()).collect();
    let size = unknowns.len();
    let gram = gram.view((0, 0), (size, size)).into_owned();
    let mut uncertainty = Uncertainty::new(&gram, &scores, &precision, &is_free);
    let white = Uncertainty::new(&gram, &gram, &precision, &is_free);
    let candidates = candidates(&list, &state, &uncertainty, &white, split);
    let (reach, spent) = profile(
        &residual,
        nonlinear,
        linear,
        &state,
        &candidates,
        (&request.memory, "an interval"),
    );
    evaluations += spent;
    let mut ends: Vec<Option<[f64; 2]>> = vec![None; size];
    for (candidate, reach) in candidates.iter().zip(reach) {
        ends[candidate.unknown] = Some(reach);
    }
    // Where a clock offset is free the band is wide, and noise in the columns pulls at all that fast motion
    // tells.
    if !residual.layout().free_offsets.is_empty()
        && let Some(score) = residual.expected_score(None, &state.eta, &state.beta, NOISE_PAIRS)?
    {
        let moving: Vec<bool> = (0..size)
            .map(|i| is_free[i] && resting[i].is_none())
            .collect();
        let pulled = moved_by(&gram, &precision, &moving, &score.mean);
        let (eta, beta) = (state.eta.iter_mut(), state.beta.iter_mut());
        for ((x, u), by) in eta.chain(beta).zip(&unknowns).zip(&pulled) {
            if *by != 0.0 {
                *x = (*x - by).clamp(u.lower, u.upper);
            }
        }
        // a correction of first order, and at the film that was pulled: as uncertain as it is large
        uncertainty.covariance += &pulled * pulled.transpose();
        for (reach, by) in ends.iter_mut().zip(&pulled) {
            if let Some(reach) = reach {
                *reach = reach.map(|d| d.hypot(TWO_SIDED_95 * by));
            }
        }
    }
    let order = rising(&state.eta[..branches], &list, split);
    let mut estimates = estimates(&list, &state, &uncertainty, &ends, &resting, &order, split);
    let longest_s = datasets.iter().map(|d| d.length_s()).fold(0.0, f64::max);
    doubt_slow_branches(&mut estimates, longest_s);
    let parameters = sorted_parameters(&residual, &state, &order[..branches]);
    let stage = request.stage;
    let mut outcome = assemble(stage.name(), &residual, &state.eta, &state.beta, parameters)?;
    outcome.eps_r = robot.eps_r;
    outcome.weak_directions = weak_directions(&list, &state, &uncertainty, &order, split);
    outcome.correlation = correlation(&list, &uncertainty, &order);
    outcome.estimates = estimates;
    outcome.starts = waterfall;
    let ended = state.ended.unwrap_or(Ended::EvaluationLimit);
    outcome.converged = ended.converged();
    outcome.reason = ended.words().into();
    outcome.evaluations = evaluations;
    outcome.failed_evaluations = failed;
    outcome.weighted_mean_square = state.data_cost / state.rows.max(1) as f64;
    outcome.noise_mean_square = residual.noise_mean_square();
    torque_band(&mut outcome, &uncertainty, split + branches + 1);
    say_open_level(&mut outcome);
    for (place, number) in residual.layout().free_offsets.iter().enumerate() {
        let error = outcome.estimates[branches + 1 + place].std_error;
        outcome.recordings[*number].offset_std_error_s = Some(error);
    }
    if failed > 0 {
        outcome.remarks.push(format!(
            "{failed} of {evaluations} evaluations failed and were stepped back from."
        ));
    }
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
        let size = free.len();
        let gram = state.gram().view((0, 0), (size, size)).into_owned();
        let uncertainty = Uncertainty::new(&gram, &scores, &vec![0.0; size], &free);
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

/// Numbers of all parameters with the branches in the order of rising relaxation time; moduli follow their
/// branch.
pub(super) fn rising(log_times: &[f64], list: &[Parameter], split: usize) -> Vec<usize> {
    let branches = log_times.len();
    let mut by_time: Vec<usize> = (0..branches).collect();
    by_time.sort_by(|&a, &b| log_times[a].total_cmp(&log_times[b]));
    let mut order: Vec<usize> = (0..list.len()).collect();
    for (place, &branch) in by_time.iter().enumerate() {
        order[place] = branch;
        order[split + 1 + place] = split + 1 + branch;
    }
    order
}

fn sorted_parameters(residual: &RobotResidual, state: &State, by_time: &[usize]) -> Parameters {
    let mut p = residual.parameters(&state.eta, &state.beta);
    let film = p.film.clone();
    for (place, &branch) in by_time.iter().enumerate() {
        p.film.relaxation_time_s[place] = film.relaxation_time_s[branch];
        p.film.mu_pa[place + 1] = film.mu_pa[branch + 1];
    }
    p
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

/// Whether it is a clock offset: a time that may be negative.
fn is_offset(p: &Parameter) -> bool {
    p.unit == "s" && p.transform == Transform::Linear
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

pub(super) fn estimates(
    list: &[Parameter],
    state: &State,
    uncertainty: &Uncertainty,
    profiled: &[Option<[f64; 2]>],
    resting: &[Option<AtBound>],
    order: &[usize],
    split: usize,
) -> Vec<Estimate> {
    let value_of = |i: usize| {
        let search = if i < split {
            state.eta[i]
        } else {
            state.beta[i - split]
        };
        (search, list[i].transform.to_model(search))
    };
    order
        .iter()
        .enumerate()
        .map(|(place, &i)| {
            let p = &list[i];
            let (search, value) = value_of(i);
            let local = uncertainty.std_error(i);
            // Never surer than the curvature says, nor than the profile does.
            let reach = profiled[i]
                .unwrap_or([0.0; 2])
                .map(|d| d.max(TWO_SIDED_95 * local));
            // `max` alone would make 0 of the NaN of a parameter that was fixed or rests on a bound.
            let search_error = match local.is_nan() {
                true => f64::NAN,
                false => local.max((reach[0] + reach[1]) / (2.0 * TWO_SIDED_95)),
            };
            let std_error = p.transform.std_error(value, search_error);
            let ends = if p.fixed {
                [value, value]
            } else if resting[i].is_some() || !search_error.is_finite() {
                [p.lower, p.upper]
            } else {
                let ends = [search - reach[0], search + reach[1]].map(|x| {
                    let positive = p.transform == Transform::Reciprocal && x <= 0.0;
                    if positive {
                        p.upper
                    } else {
                        p.transform.to_model(x).clamp(p.lower, p.upper)
                    }
                });
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            };
            let torque = p.unit == "N m";
            let relative = std_error / value.abs();
            let limit = match p.transform {
                _ if torque => std_error <= IDENTIFIABLE_TORQUE_N_M,
                // A far limit that chance brings near looks better known than it is.
                Transform::Reciprocal => relative <= IDENTIFIABLE_LIMIT,
                _ => relative <= IDENTIFIABLE,
            };
            let offset = is_offset(p);
            // an offset is a place on a clock: near 0 its relative error says nothing, far from it as little
            let limit = if offset { std_error < 0.01 } else { limit };
            let identifiable = !p.fixed && resting[i].is_none() && limit;
            let says = match (p.fixed, resting[i]) {
                (true, _) => "held".to_string(),
                (_, Some(AtBound::Lower)) if p.unit == "Pa" => {
                    "at zero: the recordings ask for no such branch".into()
                }
                (_, Some(AtBound::Lower)) => {
                    format!("rests on its lower bound {}: do not trust", p.lower)
                }
                (_, Some(AtBound::Upper)) => {
                    format!("rests on its upper bound {}: do not trust", p.upper)
                }
                _ if torque && identifiable => format!("determined to {:.1} uN m", std_error * 1e6),
                _ if torque => "not determined: no recording swings a forearm there".into(),
                _ if offset && identifiable => {
                    format!("determined to {:.2} ms", std_error * 1e3)
                }
                _ if !std_error.is_finite() => {
                    "not determined: these recordings say nothing about it".into()
                }
                _ if offset => format!(
                    "not determined by these recordings (standard error {:.0} ms)",
                    std_error * 1e3
                ),
                _ if identifiable => format!("determined to {:.1} %", 100.0 * relative),
                _ => format!(
                    "not determined by these recordings (standard error {:.0} % of the value)",
                    100.0 * relative
                ),
            };
            // Branches are numbered by rising time, whatever number they had in the search.
            let named = &list[place];
            Estimate {
                name: named.name.clone(),
                meaning: named.meaning.clone(),
                unit: p.unit.into(),
                value,
                std_error,
                ci95: ends,
                at_bound: resting[i],
                identifiable,
                fixed: p.fixed,
                says,
            }
        })
        .collect()
}

pub(super) fn correlation(
    list: &[Parameter],
    uncertainty: &Uncertainty,
    order: &[usize],
) -> (Vec<String>, Vec<Vec<f64>>) {
    let free: Vec<usize> = (0..order.len())
        .filter(|&place| uncertainty.free[order[place]])
        .collect();
    let names = free.iter().map(|&place| list[place].name.clone()).collect();
    let rows = free
        .iter()
        .map(|&a| {
            free.iter()
                .map(|&b| uncertainty.correlation(order[a], order[b]))
                .collect()
        })
        .collect();
    (names, rows)
}

pub(super) fn weak_directions(
    list: &[Parameter],
    state: &State,
    uncertainty: &Uncertainty,
    order: &[usize],
    split: usize,
) -> Vec<WeakDirection> {
    let largest_torque = state
        .beta
        .iter()
        .zip(&list[split..])
        .filter(|(_, p)| p.unit == "N m");
    let torque_size = largest_torque.map(|(b, _)| b.abs()).fold(1e-3, f64::max);
    let size: Vec<f64> = list
        .iter()
        .enumerate()
        .map(|(i, p)| match (p.transform, p.unit) {
            (Transform::Log, _) => 1.0,
            (Transform::Reciprocal, _) => 0.05,
            (_, "N m") => torque_size,
            (_, "s") => 0.01,
            _ => state.beta[i - split].abs().max(1.0),
        })
        .collect();
    let mut place_of = vec![0; order.len()];
    for (place, &i) in order.iter().enumerate() {
        place_of[i] = place;
    }
    uncertainty
        .weak_directions(&size, OPEN)
        .into_iter()
        .map(|(relative_sd, direction)| {
            let mut parts: Vec<(String, f64)> = direction
                .iter()
                .enumerate()
                .filter(|(_, share)| share.abs() > 0.25)
                .map(|(i, share)| (list[place_of[i]].name.clone(), *share))
                .collect();
            parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
            let sign = parts.first().map_or(1.0, |p| p.1.signum());
            let list = |up: bool| {
                parts
                    .iter()
                    .filter(|p| (p.1 * sign > 0.0) == up)
                    .map(|p| p.0.clone())
                    .collect::<Vec<_>>()
                    .join(", ")
            };
            let (up, down) = (list(true), list(false));
            let how = if parts.len() == 1 {
                up
            } else if down.is_empty() {
                format!("{up} together")
            } else {
                format!("{up} up while {down} down")
            };
            let says = if relative_sd > 10.0 {
                format!("{how}: these recordings say nothing about it")
            } else {
                format!("{how}: open to about {:.0} %", 100.0 * relative_sd)
            };
            WeakDirection {
                relative_sd,
                parts,
                says,
            }
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

/// Sums of one chain, or of all.
#[derive(Default, Clone, Copy)]
struct Sums {
    squares: f64,
    largest: f64,
    count: usize,
    all: f64,
    count_all: usize,
    floor: f64,
    negative: usize,
}

impl Sums {
    fn add(&mut self, predicted_squared: f64, command: f64, sd: f64) {
        let error = root_v(predicted_squared) - command;
        self.all += error * error;
        self.count_all += 1;
        self.negative += usize::from(predicted_squared < 0.0);
        if command.abs() > JUDGED_ABOVE_V {
            self.squares += error * error;
            self.largest = self.largest.max(error.abs());
            self.floor += sd * sd;
            self.count += 1;
        }
    }

    fn merge(&mut self, other: &Sums) {
        self.squares += other.squares;
        self.largest = self.largest.max(other.largest);
        self.count += other.count;
        self.all += other.all;
        self.count_all += other.count_all;
        self.floor += other.floor;
        self.negative += other.negative;
    }

    fn error(&self) -> ChainError {
        let root = |sum: f64, n: usize| {
            if n == 0 {
                f64::NAN
            } else {
                (sum / n as f64).sqrt()
            }
        };
        ChainError {
            rmse_v: root(self.squares, self.count),
            max_error_v: self.largest,
            samples: self.count,
            rmse_all_v: root(self.all, self.count_all),
            samples_all: self.count_all,
            noise_floor_v: root(self.floor, self.count),
            negative: self.negative,
        }
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
        let mechanics = residual.mechanics(number);
        let e: VoltageError = residual.voltage_error(number, eta, beta)?;
        let mut chains = [Sums::default(); 3];
        let n = d.samples();
        for i in (0..n).filter(|&i| e.counts[i]) {
            for k in 0..3 {
                chains[k].add(
                    e.predicted_squared_v2[i][k],
                    e.command_v[i][k],
                    e.sd_v[i][k],
                );
                let swing = mechanics.chains[k].theta_fa_rad[i].to_degrees();
                swing_range_deg = [swing_range_deg[0].min(swing), swing_range_deg[1].max(swing)];
            }
        }
        places.add(&d.id, d, &e);
        let mut own = Sums::default();
        chains.iter().for_each(|c| own.merge(c));
        total.merge(&own);
        let needed = mechanics.needed_torque_n_m(&parameters)?;
        let contributions_n_m = Contribution::ALL
            .iter()
            .enumerate()
            .map(|(c, name)| {
                let rms = |k: usize| {
                    (needed[k].iter().map(|row| row[c] * row[c]).sum::<f64>() / n as f64).sqrt()
                };
                (name.name().to_string(), [rms(0), rms(1), rms(2)])
            })
            .collect();
        if own.negative > 0 {
            remarks.push(format!(
                "{}: at {} of {} samples phi^2 < 0: no voltage holds that pose; they count as 0 V.",
                d.id, own.negative, own.count_all
            ));
        }
        let offset_s = residual.offset_s(number, eta);
        let position = d.track().position_m;
        recordings.push(RecordingOutcome {
            id: d.id.clone(),
            chains: chains.map(|c| c.error()),
            total: own.error(),
            offset_s,
            offset_std_error_s: None,
            plan: d.plan.clone(),
            time_s: (0..n).map(|i| d.time_s(i)).collect(),
            position_mm: position.iter().map(|p| p.map(|v| v * 1e3)).collect(),
            predicted_v: e
                .predicted_squared_v2
                .iter()
                .map(|p| p.map(|v| if v.is_nan() { v } else { root_v(v) }))
                .collect(),
            predicted_squared_v2: e.predicted_squared_v2,
            command_v: e.command_v,
            sd_v: e.sd_v,
            monitor_v: d.monitor.as_ref().map(|m| {
                (0..n)
                    .map(|i| [0, 1, 2].map(|k| m.at(k, d.time_s(i) + offset_s)))
                    .collect()
            }),
            counts: e.counts,
            gap: (0..n).map(|i| !d.captured(i)).collect(),
            unreachable: mechanics
                .unreachable
                .iter()
                .map(|(i, why)| (*i, why.to_string()))
                .collect(),
            contributions_n_m,
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
        });
    }
    let total = total.error();
    let ratio = total.rmse_v / total.noise_floor_v;
    let standing = Standing::of(ratio);
    let verdict = if total.samples == 0 {
        "No sample has a command above 1 kV: the fit cannot be judged in volts.".to_string()
    } else if !total.noise_floor_v.is_finite() {
        "The fit cannot be judged: with these parameters the motion's noise moves the voltages beyond all numbers; check the parameters."
            .to_string()
    } else if !ratio.is_finite() {
        "The fit cannot be judged: at the poses of the motion its noise moves no voltage at all; check the rig's lengths and angles."
            .to_string()
    } else if standing == Standing::Fits {
        format!(
            "The model fits to the noise: {:.1} V rms above 1 kV, where the noise of the capture alone makes {:.1} V.",
            total.rmse_v, total.noise_floor_v
        )
    } else if standing == Standing::NearlyFits {
        format!(
            "The model nearly fits: {:.1} V rms above 1 kV, {ratio:.1} times the {:.1} V that the noise of the capture makes.",
            total.rmse_v, total.noise_floor_v
        )
    } else {
        format!(
            "The model does not fit: {:.1} V rms above 1 kV, {ratio:.1} times the {:.1} V that the noise of the capture makes. Something is left out.",
            total.rmse_v, total.noise_floor_v
        )
    };
    Ok(Outcome {
        job,
        parameters,
        eps_r: f64::NAN,
        estimates: Vec::new(),
        correlation: Default::default(),
        weak_directions: Vec::new(),
        recordings,
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
        verdict,
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
                let add = |bins: &mut std::collections::BTreeMap<String, Sums>, place: String| {
                    bins.entry(place).or_default().add(
                        e.predicted_squared_v2[i][k],
                        command,
                        e.sd_v[i][k],
                    );
                };
                add(&mut bins, format!("actuator {} of {id}", k + 1));
                add(
                    &mut bins,
                    format!("{:.1} to {:.1} kV in {id}", band, band + 1.5),
                );
                add(&mut bins, format!("voltage {direction} in {id}"));
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
