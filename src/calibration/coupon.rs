//! The film from coupons: tensile, relaxation and cyclic tests of bare film, several at a time.
//!
//! The same separable fit as the robot's, without forearms, voltages or clocks: relaxation times and J are
//! searched, moduli follow. Each coupon counts with its own NRMSE (see `residual::coupon`), which is also how
//! each is judged.
//!
//! # How far to trust the intervals
//! The standard errors of [`Estimate`] are what the *noise* of the stress leaves open. On real film the
//! misfit exceeds the noise and is correlated from row to row, because something is left out of the model;
//! then these intervals are too narrow, and the outcome says so. [`CouponOutcome::misfit_std_error`] is the
//! second number: as if each coupon's misfit were noise of its own size and correlation length tau (rows),
//! variance rmse^2 tau. It is an order of magnitude, not a proof: a misfit is not noise, and a parameter can
//! be wrong by more because it stands in for what is left out.

use std::ops::ControlFlow;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use super::outcome::*;
use super::robot::{apply, locking, modulus, relaxation_time, unknown};
use super::solution::{Solution, Starts, gram, precision, resting};
use super::{Error, Request, Stage, Uncertainty};
use crate::dataset::{Coupon, CouponMode, CouponPlan};
use crate::film::{Film, InitialState};
use crate::fit::memory::Memory;
use crate::fit::separable::{Ended, Options, State, Unknown};
use crate::parameter::{Parameter, Transform};
use crate::residual::CouponResidual;

/// What is known of a relaxation time or J beforehand: a decade. On the scale of the noise weights it decides
/// only what the coupons say nothing about.
const LOG_PRIOR_SD: f64 = 2.3;
/// Largest number of branches.
const MOST_BRANCHES: usize = 8;
/// Upper bound of a relaxation time over the longest coupon: beyond it a branch is an equilibrium spring.
const LONGEST_SHARE: f64 = 3.0;
/// Lower bound of a relaxation time over the finest recorded step.
const SHORTEST_SHARE: f64 = 0.5;
/// J begins at this many times the largest invariant that a coupon reaches.
const START_LOCKING_SHARE: f64 = 3.0;
/// Upper bound of J: a film that is neo-Hookean as far as a coupon can tell.
const LARGEST_LOCKING: f64 = 1e4;
/// Error over the stress range, %, that the grid itself may make (measured in `tests/fit/coupon.rs`): less is
/// not a misfit.
const GRID_ERROR_PERCENT: f64 = 0.01;

/// Places of the largest excess over the noise that are kept, and the share of all rows below which one is
/// not judged by itself.
const WORST: usize = 4;
const LEAST_SHARE: f64 = 0.01;
/// A stretch between two corners is a hold when it changes less than this share of the range of the stretch,
/// and is slower than this share of the fastest.
const HOLD: f64 = 0.01;

/// Relative difference of cost up to which two starts found the same minimum.
const SAME_COST: f64 = 1e-6;
/// What is said of the relaxation time of a branch without a modulus.
const MEANINGLESS: &str = "of no meaning";

/// What a coupon calibration is asked to do.
#[derive(Debug, Clone)]
pub struct CouponRequest {
    /// Viscoelastic branches, 0 to 8.
    pub branches: usize,
    /// Where to begin: a film of an earlier run (its branches count, not `branches`).
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

impl CouponRequest {
    /// A request with `branches` branches, eight starts and nothing fixed.
    pub fn new(branches: usize) -> Self {
        CouponRequest {
            branches,
            start: None,
            fix: Vec::new(),
            bound: Vec::new(),
            starts: 8,
            seed: 1,
            memory: Memory::default(),
        }
    }
}

/// One coupon against the model.
#[derive(Debug, Clone, PartialEq)]
pub struct CouponFit {
    /// Identity.
    pub id: String,
    /// How it was pulled.
    pub mode: CouponMode,
    /// State of the film at the first row.
    pub initial: InitialState,
    /// Root mean square error of the nominal stress over all rows that count, Pa.
    pub rmse_pa: f64,
    /// Largest magnitude of the error, Pa.
    pub max_error_pa: f64,
    /// `rmse_pa` over the range (largest minus smallest) of the measured stress, %.
    pub nrmse_percent: f64,
    /// `rmse_pa` over the largest magnitude of the measured stress, %.
    pub nrmse_of_max_percent: f64,
    /// Rows that count.
    pub n_samples: usize,
    /// Standard deviation of the stress noise, Pa, from high frequencies.
    pub noise_pa: f64,
    /// Whether `noise_pa` is the noise, not only an upper bound.
    pub noise_known: bool,
    /// Correlation length of the misfit, rows.
    pub correlation_rows: f64,
    /// What a row was divided by in the fit, Pa.
    pub scale_pa: f64,
    /// Whether the file has a time.
    pub timed: bool,
    /// Time of each row that counts, s (row number where the file has no time).
    pub time_s: Vec<f64>,
    /// Its stretch.
    pub stretch: Vec<f64>,
    /// Measured nominal stress, Pa.
    pub measured_pa: Vec<f64>,
    /// Predicted nominal stress, Pa.
    pub predicted_pa: Vec<f64>,
    /// Choices made for it.
    pub plan: CouponPlan,
    /// Does it fit? In words.
    pub verdict: String,
    /// What a reader should know.
    pub notes: Vec<String>,
}

impl CouponFit {
    /// How the misfit stands against the noise; one that the grid makes fits.
    #[must_use]
    pub fn standing(&self) -> Standing {
        match self.noise_known {
            false => Standing::CannotBeJudged,
            true if self.nrmse_percent <= GRID_ERROR_PERCENT => Standing::Fits,
            true => Standing::of(self.rmse_pa / self.noise_pa),
        }
    }

    /// Whether the misfit is more than the noise, and more than the grid makes. False where the noise is not
    /// known.
    #[must_use]
    pub fn exceeds_noise(&self) -> bool {
        self.standing() > Standing::Fits
    }
}

/// Where the prediction of a coupon errs most.
#[derive(Debug, Clone, PartialEq)]
pub struct CouponPlace {
    /// Identity of the coupon.
    pub coupon: String,
    /// The place, in words.
    pub place: String,
    /// Root mean square error there over the noise; NaN where the noise is not known.
    pub ratio: f64,
    /// Root mean square error there, Pa.
    pub rmse_pa: f64,
    /// Mean error there (predicted minus measured), Pa.
    pub mean_pa: f64,
    /// Share of the whole excess over the noise, every coupon on its own stress range as in the fit.
    pub share: f64,
}

/// Errors of all rows of all coupons together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CouponTotal {
    /// Root mean square error of the nominal stress, Pa; NaN without a coupon.
    pub rmse_pa: f64,
    /// Largest magnitude of the error, Pa.
    pub max_error_pa: f64,
    /// Rows.
    pub n_samples: usize,
    /// Root mean square of the noise, Pa; NaN unless it is known of every coupon.
    pub noise_pa: f64,
}

impl CouponOutcome {
    /// That of the worst coupon.
    #[must_use]
    pub fn standing(&self) -> Standing {
        let each = self.coupons.iter().map(CouponFit::standing);
        each.max().unwrap_or(Standing::CannotBeJudged)
    }

    /// All coupons together.
    #[must_use]
    pub fn total(&self) -> CouponTotal {
        let n_samples = self.coupons.iter().map(|c| c.n_samples).sum();
        let mean = |f: &dyn Fn(&CouponFit) -> f64| {
            let sum: f64 = self.coupons.iter().map(|c| c.n_samples as f64 * f(c)).sum();
            (sum / n_samples as f64).sqrt()
        };
        CouponTotal {
            rmse_pa: mean(&|c| c.rmse_pa.powi(2)),
            max_error_pa: self.coupons.iter().fold(0.0, |m, c| m.max(c.max_error_pa)),
            n_samples,
            noise_pa: mean(&|c| match c.noise_known {
                true => c.noise_pa.powi(2),
                false => f64::NAN,
            }),
        }
    }
}

/// Everything that a coupon calibration found.
#[derive(Debug, Clone)]
pub struct CouponOutcome {
    /// What was done: `coupon` or `validate`.
    pub job: &'static str,
    /// The film.
    pub film: Film,
    /// Every parameter, in order; the errors are what the noise leaves open. Empty when nothing was fitted.
    pub estimates: Vec<Estimate>,
    /// Standard error of each estimate as if the misfit were noise (see the module); NaN where it was fixed
    /// or rests on a bound.
    pub misfit_std_error: Vec<f64>,
    /// Correlation of the free estimates (names, rows).
    pub correlation: (Vec<String>, Vec<Vec<f64>>),
    /// Combinations that the coupons leave open even if the model were right, worst first.
    pub weak_directions: Vec<WeakDirection>,
    /// The coupons.
    pub coupons: Vec<CouponFit>,
    /// Where the prediction errs most, largest share of the excess first.
    pub worst: Vec<CouponPlace>,
    /// Root of the mean squared NRMSE over the coupons, %: what the fit makes small.
    pub nrmse_percent: f64,
    /// The starts, best first.
    pub starts: Vec<StartOutcome>,
    /// Whether the fit converged.
    pub converged: bool,
    /// Why it stopped.
    pub reason: String,
    /// Evaluations of all starts, failed ones included.
    pub evaluations: usize,
    /// Failed evaluations.
    pub failed_evaluations: usize,
    /// First sentence: does it fit?
    pub verdict: String,
    /// Further sentences a reader should see.
    pub remarks: Vec<String>,
}

/// Largest A + B + C - 3 of the equilibrium spring over all coupons: J must lie above.
fn largest_invariant(coupons: &[&Coupon]) -> f64 {
    coupons
        .iter()
        .flat_map(|c| c.grid.stretch.iter().map(|&l| c.stretches(l)))
        .map(|[l1, l2]| {
            let (a, b) = (l1 * l1, l2 * l2);
            a + b + 1.0 / (a * b) - 3.0
        })
        .fold(0.0, f64::max)
}

/// Shortest and longest relaxation time that the coupons can tell, s.
fn time_bounds_s(coupons: &[&Coupon]) -> [f64; 2] {
    let finest = coupons
        .iter()
        .map(|c| c.step_s)
        .fold(f64::INFINITY, f64::min);
    let longest = coupons.iter().map(|c| c.duration_s()).fold(0.0, f64::max);
    [SHORTEST_SHARE * finest, LONGEST_SHARE * longest]
}

/// Between these a start spreads its branches, s: from a few steps to half of the longest coupon.
fn start_times_s(bounds: [f64; 2]) -> [f64; 2] {
    let low = 8.0 * bounds[0];
    [low, (bounds[1] / (2.0 * LONGEST_SHARE)).max(2.0 * low)]
}

fn spread(branches: usize, [low, high]: [f64; 2]) -> Vec<f64> {
    match branches {
        1 => vec![(low * high).sqrt()],
        n => (0..n)
            .map(|i| low * (high / low).powf(i as f64 / (n - 1) as f64))
            .collect(),
    }
}

/// All parameters, nonlinear ones first, as the residual wants them; and how many are nonlinear.
fn parameters(
    request: &CouponRequest,
    coupons: &[&Coupon],
) -> Result<(Vec<Parameter>, usize), Error> {
    let start = request.start.as_ref();
    let branches = start.map_or(request.branches, Film::branches);
    let bounds = time_bounds_s(coupons);
    let invariant = largest_invariant(coupons);
    let times = start.map_or_else(
        || spread(branches, start_times_s(bounds)),
        |f| f.relaxation_time_s.clone(),
    );
    // A start beyond the usual bounds widens them: a film from elsewhere is not cut short.
    let wide = |start: f64, [lower, upper]: [f64; 2]| [lower.min(start), upper.max(start)];
    let mut out: Vec<Parameter> = times
        .iter()
        .enumerate()
        .map(|(i, &t)| relaxation_time(i, t, wide(t, bounds), LOG_PRIOR_SD))
        .collect();
    let least = (invariant * 1.001).max(0.05);
    let first = start.map_or((START_LOCKING_SHARE * invariant).max(1.0), |f| f.locking);
    let within = wide(first, [least, LARGEST_LOCKING.max(10.0 * least)]);
    out.push(locking(Transform::Log, first, within, Some(LOG_PRIOR_SD)));
    let nonlinear = out.len();
    for i in 0..=branches {
        out.push(modulus(i, start.map_or(1e4, |f| f.mu_pa[i]), false));
    }
    let mut names = Request::new(Stage::Film);
    (names.fix, names.bound) = (request.fix.clone(), request.bound.clone());
    apply(&names, &mut out)?;
    Ok((out, nonlinear))
}

/// A film that a residual can take: as many moduli as branches and one, all numbers possible.
fn check(film: &Film) -> Result<(), Error> {
    let bad = |name: &str, what: String| {
        Err(Error::BadValue {
            name: name.into(),
            what,
        })
    };
    if film.mu_pa.len() != film.branches() + 1 {
        let what = format!(
            "{} moduli for {} branches: one a branch and one for the equilibrium spring are needed",
            film.mu_pa.len(),
            film.branches()
        );
        return bad("mu_1", what);
    }
    if let Some(mu) = film.mu_pa.iter().find(|mu| !mu.is_finite()) {
        return bad("mu_1", format!("{mu} Pa is not a modulus"));
    }
    for (i, t) in film.relaxation_time_s.iter().enumerate() {
        if !(t.is_finite() && *t > 0.0) {
            let what = format!("{t} s is not possible: it must be above 0");
            return bad(&format!("T_{}", i + 1), what);
        }
    }
    if !(film.locking.is_finite() && film.locking > 0.0) {
        let what = format!("{} is not possible: it must be above 0", film.locking);
        return bad("J", what);
    }
    Ok(())
}

/// Number of branches, after a look at what was asked.
fn branches_of(coupons: &[&Coupon], asked: usize, film: Option<&Film>) -> Result<usize, Error> {
    if coupons.is_empty() {
        return Err(Error::NothingToFit("no coupon was given".into()));
    }
    if let Some(film) = film {
        check(film)?;
    }
    let branches = film.map_or(asked, Film::branches);
    if branches > MOST_BRANCHES {
        let what = format!("{branches} branches were asked for: at most {MOST_BRANCHES} are known");
        return Err(Error::NothingToFit(what));
    }
    if let (true, Some(c)) = (branches > 0, coupons.iter().find(|c| !c.timed)) {
        let what = format!(
            "coupon `{}` has no time, so that it says nothing about relaxation: give its `time`, or ask for 0 branches",
            c.id
        );
        return Err(Error::NothingToFit(what));
    }
    Ok(branches)
}

/// The given or evenly spread start, then random ones: relaxation times log-uniform over the time scales that
/// the coupons tell, J over a decade above the largest invariant.
fn starts(
    list: &[Parameter],
    unknowns: &[Unknown],
    split: usize,
    coupons: &[&Coupon],
    request: &CouponRequest,
) -> Vec<(String, Vec<f64>)> {
    let nonlinear = &unknowns[..split];
    let first: Vec<f64> = nonlinear.iter().map(|u| u.start).collect();
    let name = match request.start {
        Some(_) => "given film",
        None => "evenly spread",
    };
    let mut out = vec![(name.to_string(), first.clone())];
    if nonlinear.iter().all(Unknown::is_fixed) {
        return out;
    }
    let [low, high] = start_times_s(time_bounds_s(coupons)).map(f64::ln);
    let [least, most] = {
        let invariant = largest_invariant(coupons).max(0.05);
        [1.3 * invariant, 13.0 * invariant].map(f64::ln)
    };
    let mut generator = ChaCha12Rng::seed_from_u64(request.seed);
    fn between(generator: &mut impl Rng, low: f64, high: f64) -> f64 {
        low + (high - low) * generator.random::<f64>()
    }
    for number in 1..request.starts.max(1) {
        let mut times: Vec<f64> = (0..split - 1)
            .map(|_| between(&mut generator, low, high))
            .collect();
        times.sort_by(f64::total_cmp);
        let locking = between(&mut generator, least, most);
        let eta = list[..split]
            .iter()
            .zip(nonlinear)
            .zip(times.into_iter().chain([locking]))
            .map(|((p, u), x)| match p.fixed {
                true => u.start,
                false => x.clamp(u.lower, u.upper),
            })
            .collect();
        out.push((format!("random {number}"), eta));
    }
    out
}

/// Calibrates a film on `coupons`. `watch` sees each evaluation (of any start) and may stop the fit.
///
/// Several starts run in parallel; the best is the outcome. Units: SI, moduli in Pa, times in s.
///
/// # Errors
/// [`Error`] when there is nothing to fit, a parameter is misnamed or impossible, or no start could be
/// evaluated. A fit that does not converge is not an error but is said in the outcome.
pub fn calibrate_coupons(
    coupons: &[&Coupon],
    request: &CouponRequest,
    watch: &(dyn Fn(&State) -> ControlFlow<()> + Sync),
) -> Result<CouponOutcome, Error> {
    let branches = branches_of(coupons, request.branches, request.start.as_ref())?;
    let (list, split) = parameters(request, coupons)?;
    let unknowns: Vec<Unknown> = list.iter().map(unknown).collect();
    let (nonlinear, linear) = unknowns.split_at(split);
    let residual = CouponResidual::new(coupons, branches);
    let free = unknowns.iter().filter(|u| !u.is_fixed()).count();
    if residual.rows() < free {
        let what = format!(
            "the coupons have {} rows for {free} free parameters: fewer branches, or fix more",
            residual.rows()
        );
        return Err(Error::NothingToFit(what));
    }
    let options = Options {
        evaluations: 150,
        cost_tolerance: 1e-7,
        ..Options::default()
    };
    let begins = starts(&list, &unknowns, split, coupons, request);
    let mut starts = Starts::run(begins, (&list, branches), |eta| {
        let memory = &request.memory;
        memory.minimise(
            "the fit", &residual, nonlinear, linear, eta, &options, watch,
        )
    });
    // Where branches merge or vanish the last digits of the cost are rough: of starts that agree, one that
    // says it converged.
    let state = starts.take(starts.best_within(SAME_COST))?;
    let resting = resting(&unknowns, &state);
    let solution = Solution::new(&list, split, branches, &state, &resting);
    let film = solution.sorted(&residual.film(&state.eta, &state.beta));
    let mut outcome = assemble("coupon", &residual, film)?;

    // What noise, and what the misfit, leave open.
    let variance: Vec<f64> = outcome
        .coupons
        .iter()
        .map(|c| c.rmse_pa * c.rmse_pa * c.correlation_rows)
        .collect();
    let scores = residual
        .score_covariance(&state.eta, &state.beta, &variance)
        .map_err(|e| e.locked)?;
    let (gram, precision) = (gram(&state), precision(&unknowns));
    let is_free: Vec<bool> = std::iter::zip(&unknowns, &resting)
        .map(|(u, r)| !u.is_fixed() && r.is_none())
        .collect();
    let [by_noise, by_misfit] =
        scores.map(|scores| Uncertainty::new(&gram, &scores, &precision, &is_free));
    let curved = vec![None; list.len()];
    outcome.estimates = solution.estimates(&by_noise, &curved);
    outcome.weak_directions = solution.weak_directions(&by_noise);
    outcome.correlation = solution.correlation(&by_noise);
    for (place, &branch) in solution.by_time().iter().enumerate() {
        let e = &mut outcome.estimates[place];
        if state.beta[branch + 1] == 0.0 && !e.fixed {
            e.identifiable = false;
            e.says = format!("{MEANINGLESS}: mu_{} is zero", place + 2);
        }
    }
    doubt(&mut outcome, &solution.estimates(&by_misfit, &curved));
    let ended = state.ended.unwrap_or(Ended::EvaluationLimit);
    outcome.converged = ended.converged();
    outcome.reason = ended.words().into();
    outcome.evaluations = starts.evaluations;
    outcome.failed_evaluations = starts.failed;
    outcome.remarks.extend(starts.remark());
    outcome.starts = starts.waterfall;
    if resting[split - 1] == Some(AtBound::Upper) {
        outcome
            .remarks
            .push("J rests on its upper bound: as far as these coupons tell, the springs are neo-Hookean.".into());
    }
    Ok(outcome)
}

/// Where the misfit exceeds the noise, what is known if it counts as noise: as `by_misfit` has it.
fn doubt(outcome: &mut CouponOutcome, by_misfit: &[Estimate]) {
    outcome.misfit_std_error = by_misfit.iter().map(|e| e.std_error).collect();
    if !outcome.coupons.iter().any(CouponFit::exceeds_noise) {
        return;
    }
    for (e, m) in outcome.estimates.iter_mut().zip(by_misfit) {
        if !e.fixed && e.at_bound.is_none() && !e.says.starts_with(MEANINGLESS) {
            e.identifiable &= m.identifiable;
            e.says = format!(
                "{:.2} % by the noise, about {:.0} % counting the misfit: do not trust the interval",
                100.0 * e.std_error / e.value.abs(),
                100.0 * m.std_error / e.value.abs()
            );
        }
    }
    outcome.remarks.push(
        "The misfit exceeds the noise of the stress: the intervals of the parameters are those of the noise alone and are not to be trusted; misfit_std_error counts the misfit as correlated noise."
            .into(),
    );
}

/// Holds a film against `coupons`: predicted against measured stress, nothing fitted.
///
/// # Errors
/// [`Error`]; [`Error::Locked`] when a coupon stretches the film to its locking stretch.
pub fn validate_coupons(coupons: &[&Coupon], film: &Film) -> Result<CouponOutcome, Error> {
    let branches = branches_of(coupons, film.branches(), Some(film))?;
    let residual = CouponResidual::new(coupons, branches);
    let mut outcome = assemble("validate", &residual, film.clone())?;
    outcome.converged = true;
    outcome.reason = "nothing was fitted".into();
    Ok(outcome)
}

/// 1 + 2 sum of the autocorrelation up to its first value that is not positive, rows: how many rows say the
/// same thing.
pub(super) fn correlation_rows(error: &[f64]) -> f64 {
    let n = error.len();
    let power: f64 = error.iter().map(|e| e * e).sum();
    if power <= 0.0 {
        return 1.0;
    }
    // Twice the integral over the lag by trapezoids, which is that sum; lags one by one at first, then ever
    // longer steps.
    let mut sum = 0.0_f64;
    let (mut lag, mut before) = (0, 1.0);
    loop {
        let next = lag + (lag / 16).max(1);
        if next >= n {
            return sum.max(1.0);
        }
        let product: f64 = error[..n - next]
            .iter()
            .zip(&error[next..])
            .map(|(a, b)| a * b)
            .sum();
        let rho = product / power;
        if rho <= 0.0 {
            return sum.max(1.0);
        }
        sum += (next - lag) as f64 * (before + rho);
        (lag, before) = (next, rho);
    }
}

fn assemble(
    job: &'static str,
    residual: &CouponResidual,
    film: Film,
) -> Result<CouponOutcome, Error> {
    let coupons = residual
        .coupons()
        .enumerate()
        .map(|(number, c)| {
            let predicted_pa = residual.predicted_pa(number, &film).map_err(|e| e.locked)?;
            let pick = |v: &[f64]| -> Vec<f64> { c.rows().map(|i| v[i]).collect() };
            let (time_s, stretch) = (pick(&c.time_s), pick(&c.stretch));
            let measured_pa = pick(&c.stress_pa);
            let error: Vec<f64> = predicted_pa
                .iter()
                .zip(&measured_pa)
                .map(|(p, m)| p - m)
                .collect();
            let n = error.len();
            let rmse_pa = (error.iter().map(|e| e * e).sum::<f64>() / n as f64).sqrt();
            let largest = measured_pa.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
            let mut fit = CouponFit {
                id: c.id.clone(),
                mode: c.mode,
                initial: c.initial,
                rmse_pa,
                max_error_pa: error.iter().fold(0.0_f64, |m, e| m.max(e.abs())),
                nrmse_percent: 100.0 * rmse_pa / c.stress_range_pa(),
                nrmse_of_max_percent: 100.0 * rmse_pa / largest,
                n_samples: n,
                noise_pa: c.noise_pa,
                noise_known: c.noise_known,
                correlation_rows: correlation_rows(&error),
                scale_pa: residual.scale_pa(number),
                timed: c.timed,
                time_s,
                stretch,
                measured_pa,
                predicted_pa,
                plan: c.plan.clone(),
                verdict: String::new(),
                notes: c.notes.clone(),
            };
            fit.verdict = verdict_of(&fit);
            Ok(fit)
        })
        .collect::<Result<Vec<CouponFit>, Error>>()?;
    let mean = coupons.iter().map(|c| c.nrmse_percent.powi(2)).sum::<f64>() / coupons.len() as f64;
    let nrmse_percent = mean.sqrt();
    let verdict = verdict(&coupons, nrmse_percent);
    let worst = worst(&coupons);
    Ok(CouponOutcome {
        job,
        film,
        estimates: Vec::new(),
        misfit_std_error: Vec::new(),
        correlation: Default::default(),
        weak_directions: Vec::new(),
        coupons,
        worst,
        nrmse_percent,
        starts: Vec::new(),
        converged: false,
        reason: String::new(),
        evaluations: 0,
        failed_evaluations: 0,
        verdict,
        remarks: Vec::new(),
    })
}

/// What the film is made to do between two corners of its stretch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    Up,
    Hold,
    Down,
}

/// Phase of each row of a coupon, and in which third (of the range of the stretch, of the duration of a hold)
/// it lies.
fn phases(c: &CouponFit) -> Vec<(Phase, usize)> {
    let last = c.time_s.len() - 1;
    // Without a time there are no corners: up to the largest stretch, and back.
    let top = (0..=last).max_by(|&a, &b| c.stretch[a].total_cmp(&c.stretch[b]));
    let mut at: Vec<usize> = c
        .plan
        .corners_s
        .iter()
        .map(|&t| c.time_s.partition_point(|&x| x < t).min(last))
        .chain([0, last])
        .chain(top.filter(|_| !c.timed))
        .collect();
    at.sort_unstable();
    at.dedup();
    let [low, high] = c
        .stretch
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], &l| {
            [a.min(l), b.max(l)]
        });
    let change = |w: &[usize]| c.stretch[w[1]] - c.stretch[w[0]];
    let slope = |w: &[usize]| change(w) / (c.time_s[w[1]] - c.time_s[w[0]]);
    let fastest = at
        .windows(2)
        .map(|w| slope(w).abs())
        .fold(0.0_f64, f64::max);
    let third = |share: f64| ((3.0 * share) as usize).min(2);
    let mut out = Vec::with_capacity(last + 1);
    for w in at.windows(2) {
        let still = change(w).abs() < HOLD * (high - low) && slope(w).abs() < HOLD * fastest;
        let end = if w[1] == last { last + 1 } else { w[1] };
        out.extend((w[0]..end).map(|i| {
            if still {
                let share = (c.time_s[i] - c.time_s[w[0]]) / (c.time_s[w[1]] - c.time_s[w[0]]);
                return (Phase::Hold, third(share));
            }
            let share = (c.stretch[i] - low) / (high - low);
            match change(w) > 0.0 {
                true => (Phase::Up, third(share)),
                false => (Phase::Down, third(share)),
            }
        }));
    }
    out
}

/// The places with the largest excess over the noise: coupon by coupon while stretching, holding and
/// releasing, by thirds.
fn worst(coupons: &[CouponFit]) -> Vec<CouponPlace> {
    let noise = |c: &CouponFit| if c.noise_known { c.noise_pa } else { 0.0 };
    let excess = |c: &CouponFit, sum: f64, n: f64| {
        (sum - n * noise(c).powi(2)) / (c.n_samples as f64 * (c.rmse_pa / c.nrmse_percent).powi(2))
    };
    let whole: f64 = coupons
        .iter()
        .map(|c| {
            excess(
                c,
                c.n_samples as f64 * c.rmse_pa.powi(2),
                c.n_samples as f64,
            )
            .max(0.0)
        })
        .sum();
    let mut out = Vec::new();
    for c in coupons.iter().filter(|c| c.rmse_pa > 0.0) {
        let phases = phases(c);
        let mut kinds = phases.clone();
        kinds.sort_unstable();
        kinds.dedup();
        for kind in kinds {
            let rows: Vec<usize> = (0..phases.len()).filter(|&i| phases[i] == kind).collect();
            let n = rows.len() as f64;
            if n < LEAST_SHARE * c.n_samples as f64 {
                continue;
            }
            let error = |i: &usize| c.predicted_pa[*i] - c.measured_pa[*i];
            let sum: f64 = rows.iter().map(|i| error(i).powi(2)).sum();
            let rmse_pa = (sum / n).sqrt();
            let among = |v: &[f64]| {
                let of = rows.iter().map(|&i| v[i]);
                of.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| {
                    [a.min(x), b.max(x)]
                })
            };
            let [low, high] = among(&c.stretch);
            let third = ["first", "second", "last"][kind.1];
            let place = match kind.0 {
                Phase::Up => format!("stretching from {low:.2} to {high:.2}"),
                Phase::Down => format!("releasing from {high:.2} to {low:.2}"),
                Phase::Hold => {
                    format!("{third} third of holding, stretch {low:.2} to {high:.2}")
                }
            };
            out.push(CouponPlace {
                coupon: c.id.clone(),
                place,
                ratio: match c.noise_known {
                    true => rmse_pa / c.noise_pa,
                    false => f64::NAN,
                },
                rmse_pa,
                mean_pa: rows.iter().map(error).sum::<f64>() / n,
                share: match whole > 0.0 {
                    true => (excess(c, sum, n).max(0.0) / whole).min(1.0),
                    false => 0.0,
                },
            });
        }
    }
    let descending = |a: f64, b: f64| b.total_cmp(&a);
    out.sort_by(|a, b| descending(a.share, b.share).then_with(|| descending(a.rmse_pa, b.rmse_pa)));
    out.truncate(WORST);
    out
}

fn verdict_of(c: &CouponFit) -> String {
    let error = format!(
        "{:.2} % of the stress range (rms {:.1} Pa over {} rows)",
        c.nrmse_percent, c.rmse_pa, c.n_samples
    );
    let times = c.rmse_pa / c.noise_pa;
    if !c.noise_known {
        format!("Off by {error}; too few rows to tell the noise.")
    } else if c.exceeds_noise() {
        format!(
            "Off by {error}, {times:.1} times the noise of {:.1} Pa.",
            c.noise_pa
        )
    } else {
        format!("Fits to the noise: {error}, noise {:.1} Pa.", c.noise_pa)
    }
}

fn verdict(coupons: &[CouponFit], nrmse_percent: f64) -> String {
    let Some(worst) = coupons
        .iter()
        .max_by(|a, b| a.nrmse_percent.total_cmp(&b.nrmse_percent))
    else {
        return String::new();
    };
    let exceed = coupons.iter().filter(|c| c.exceeds_noise()).count();
    let known = coupons.iter().filter(|c| c.noise_known).count();
    let size = format!(
        "NRMSE {nrmse_percent:.2} % of the stress range (worst: {:.2} % of {})",
        worst.nrmse_percent, worst.id
    );
    if known == 0 {
        format!("{size}; the coupons have too few rows to hold it against their noise.")
    } else if exceed == 0 {
        format!("The model fits to the noise: {size}.")
    } else {
        format!(
            "The model does not fit to the noise in {exceed} of {known} coupons: {size}. Something is left out."
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlation_length_of_known_noise() {
        let mut seed = 3_u64;
        let mut uniform = move || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1);
            (seed >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        let white: Vec<f64> = (0..50_000).map(|_| uniform()).collect();
        assert!((correlation_rows(&white) - 1.0).abs() < 0.1);
        // x_(i+1) = a x_i + e: (1 + a)/(1 - a) = 19 for a = 0.9
        let mut x = 0.0;
        let slow: Vec<f64> = white
            .iter()
            .map(|e| {
                x = 0.9 * x + e;
                x
            })
            .collect();
        let tau = correlation_rows(&slow);
        assert!((tau - 19.0).abs() < 3.0, "{tau}");
        assert_eq!(correlation_rows(&[0.0; 5]), 1.0);
    }
}
