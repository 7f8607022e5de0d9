//! Separable nonlinear least squares: variable projection (Golub and Pereyra 1973, SIAM J. Numer. Anal.
//! 10:413) with Kaufman's Jacobian, from Gram matrices alone.
//!
//! ```text
//! minimise over eta, beta:  |B(eta) beta - d(eta)|^2 + priors,   within bounds
//! ```
//!
//! At each eta the linear beta is the exact minimiser within its bounds; the reduced problem in eta is solved
//! by Gauss-Newton steps on J'PJ within a trust region (More and Sorensen 1983), where P projects out the
//! free columns of B. One evaluation a step.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::bounded::bounded_least_squares;
use crate::residual::{Normal, SeparableResidual};

/// What is known of a parameter beforehand: a normal density, as one more residual.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// Its middle.
    pub mean: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// One unknown of the fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Unknown {
    /// Where it starts (linear unknowns: only where the data do not tell).
    pub start: f64,
    /// Smallest value.
    pub lower: f64,
    /// Largest value; equal to `lower` when it is fixed.
    pub upper: f64,
    /// What is known beforehand.
    pub prior: Option<Prior>,
}

impl Unknown {
    /// Free between bounds, nothing known beforehand.
    pub fn free(start: f64, lower: f64, upper: f64) -> Self {
        Unknown {
            start,
            lower,
            upper,
            prior: None,
        }
    }

    /// Fixed at a value.
    pub fn fixed(value: f64) -> Self {
        Self::free(value, value, value)
    }

    /// Whether it cannot move.
    pub fn is_fixed(&self) -> bool {
        self.lower == self.upper
    }

    /// A natural step: the width of what is known beforehand, or a twelfth of the range.
    fn natural_step(&self) -> f64 {
        self.prior
            .map_or((self.upper - self.lower) / 12.0, |p| p.sd)
    }

    /// What the prior adds to the sum of squares at x.
    pub(crate) fn penalty(&self, x: f64) -> f64 {
        self.prior.map_or(0.0, |p| ((x - p.mean) / p.sd).powi(2))
    }

    /// Weight of the prior as a residual row, and its gradient at x.
    fn pull(&self, x: f64) -> (f64, f64) {
        self.prior.map_or((0.0, 0.0), |p| {
            let weight = 1.0 / (p.sd * p.sd);
            (weight, weight * (x - p.mean))
        })
    }
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Evaluations that are allowed.
    pub evaluations: usize,
    /// Converged when a step promises less than this share of the cost.
    pub cost_tolerance: f64,
    /// Converged when no unknown moves more than this in a step.
    pub step_tolerance: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            evaluations: 100,
            cost_tolerance: 1e-6,
            step_tolerance: 1e-7,
        }
    }
}

/// Why a separable fit ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Ended {
    /// No step promises a relevant improvement.
    Converged,
    /// No parameter moves any more.
    StepTooSmall,
    /// Every trial was worse, down to tiny steps.
    Stalled,
    /// The allowed evaluations were used.
    EvaluationLimit,
    /// The start itself could not be evaluated.
    StartFailed,
    /// The caller asked to stop.
    Stopped,
}

impl Ended {
    /// Whether the result is a minimum as far as the fit can tell.
    pub fn converged(self) -> bool {
        matches!(self, Ended::Converged | Ended::StepTooSmall)
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Ended::Converged => "converged: no step promises a relevant improvement",
            Ended::StepTooSmall => "converged: no parameter moves any more",
            Ended::Stalled => "stalled: every trial step was worse, down to tiny ones",
            Ended::EvaluationLimit => "not converged: the allowed number of evaluations was used",
            Ended::StartFailed => "failed: the model has no value at the start",
            Ended::Stopped => "stopped on request",
        }
    }
}

/// Where a separable fit stands: everything that another step needs, so that it can be saved and resumed.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct State {
    /// Nonlinear unknowns.
    pub eta: Vec<f64>,
    /// Linear unknowns.
    pub beta: Vec<f64>,
    /// Which linear unknowns are off their bounds.
    pub beta_free: Vec<bool>,
    /// Sum of squares with the priors; infinite before the first evaluation.
    pub cost: f64,
    /// Sum of squares of the data alone.
    pub data_cost: f64,
    /// Number of residuals.
    pub rows: usize,
    /// Evaluations so far, failed ones included.
    pub evaluations: usize,
    /// Evaluations that failed.
    pub failed: usize,
    /// What the last failed one said.
    pub failure: Option<String>,
    /// Accepted steps.
    pub iterations: usize,
    /// Set when it has ended.
    pub ended: Option<Ended>,
    /// Longest step that is trusted, in natural steps of the unknowns.
    radius: f64,
    /// Gram matrix of [J | B | r] at (eta, beta), row by row.
    gram: Vec<f64>,
}

impl State {
    /// The state before the first evaluation, with the nonlinear unknowns at `eta`.
    pub fn at(eta: &[f64], nonlinear: &[Unknown], linear: &[Unknown]) -> Self {
        State {
            eta: eta
                .iter()
                .zip(nonlinear)
                .map(|(x, u)| x.clamp(u.lower, u.upper))
                .collect(),
            beta: linear.iter().map(|u| u.start).collect(),
            beta_free: linear.iter().map(|u| !u.is_fixed()).collect(),
            cost: f64::INFINITY,
            data_cost: f64::INFINITY,
            rows: 0,
            evaluations: 0,
            failed: 0,
            failure: None,
            iterations: 0,
            ended: None,
            radius: 1.0,
            gram: Vec::new(),
        }
    }

    /// The least cost that the linear model about the parameters promises, bounds and trust left aside; minus
    /// infinity where there is none.
    pub fn promised(&self, nonlinear: &[Unknown], linear: &[Unknown]) -> f64 {
        if self.gram.is_empty() {
            return f64::NEG_INFINITY;
        }
        let Some((reduced, gradient)) = reduced_system(&self.gram(), self, nonlinear, linear)
        else {
            return f64::NEG_INFINITY;
        };
        let local = Local::new(self, nonlinear, &reduced, &gradient);
        self.cost - local.map_or(0.0, |l| trusted_step(&l.h, &l.g, f64::INFINITY).2)
    }

    /// Gram matrix of [d r/d eta | B | r] at the parameters.
    pub fn gram(&self) -> DMatrix<f64> {
        let size = self.eta.len() + self.beta.len() + 1;
        DMatrix::from_row_slice(size, size, &self.gram)
    }
}

/// What an evaluation says at its own best beta.
struct Solved {
    beta: Vec<f64>,
    free: Vec<bool>,
    gram: DMatrix<f64>,
    data_cost: f64,
    cost: f64,
}

fn solve_linear(normal: &Normal, eta: &[f64], nonlinear: &[Unknown], linear: &[Unknown]) -> Solved {
    let m = linear.len();
    let last = normal.gram.nrows() - 1;
    let mut g = normal.gram.view((0, 0), (m, m)).into_owned();
    let reference = DVector::from_column_slice(&normal.reference);
    // r = r_ref + B (beta - beta_ref)
    let mut b = &g * &reference - normal.gram.view((0, last), (m, 1));
    for (i, u) in linear.iter().enumerate() {
        if let Some(p) = u.prior {
            let weight = 1.0 / (p.sd * p.sd);
            g[(i, i)] += weight;
            b[i] += weight * p.mean;
        }
    }
    let lower: Vec<f64> = linear.iter().map(|u| u.lower).collect();
    let upper: Vec<f64> = linear.iter().map(|u| u.upper).collect();
    let (beta, free) = bounded_least_squares(
        &g,
        &b.column(0).into_owned(),
        &lower,
        &upper,
        &normal.reference,
    );
    let beta = beta.as_slice().to_vec();
    let gram = normal.at(eta.len(), &beta);
    let data_cost = gram[(gram.nrows() - 1, gram.nrows() - 1)].max(0.0);
    let priors = eta
        .iter()
        .zip(nonlinear)
        .chain(beta.iter().zip(linear))
        .map(|(x, u)| u.penalty(*x))
        .sum::<f64>();
    Solved {
        beta,
        free,
        gram,
        data_cost,
        cost: data_cost + priors,
    }
}

/// The first column that holds a number that is not finite: decompositions of such a matrix need not end.
fn not_finite(m: &DMatrix<f64>) -> Option<usize> {
    (0..m.ncols()).find(|&c| m.column(c).iter().any(|v| !v.is_finite()))
}

fn evaluate<P: SeparableResidual>(
    problem: &P,
    eta: &[f64],
    state: &mut State,
    nonlinear: &[Unknown],
    linear: &[Unknown],
) -> Option<Solved> {
    state.evaluations += 1;
    match problem.evaluate(eta, &state.beta) {
        Ok(normal) => {
            state.rows = normal.rows;
            if let Some(column) = not_finite(&normal.gram) {
                state.failure = Some(format!(
                    "column {} of the normal equations ({} numbers that are not finite) has no value at these parameters",
                    column + 1,
                    normal.gram.iter().filter(|v| !v.is_finite()).count()
                ));
                state.failed += 1;
                return None;
            }
            let solved = solve_linear(&normal, eta, nonlinear, linear);
            if solved.cost.is_finite() {
                return Some(solved);
            }
            state.failure = Some("the sum of squares is not a finite number".into());
        }
        Err(error) => state.failure = Some(error.to_string()),
    }
    state.failed += 1;
    None
}

fn accept(state: &mut State, eta: Vec<f64>, solved: Solved) {
    state.eta = eta;
    state.beta = solved.beta;
    state.beta_free = solved.free;
    state.cost = solved.cost;
    state.data_cost = solved.data_cost;
    state.gram = solved.gram.transpose().as_slice().to_vec();
}

/// A step that is proposed; lengths are in natural units of the unknowns.
struct Proposal {
    eta: Vec<f64>,
    length: f64,
    /// Largest part of it.
    largest: f64,
    /// Change of the cost by its slope alone.
    slope: f64,
    /// Fall of the cost that it promises.
    promised: f64,
    /// Fall that the whole step promises, bounds and the trusted radius left aside.
    at_most: f64,
    /// Whether the trusted radius did not matter.
    whole: bool,
}

/// The linear model of the cost about a state, in those nonlinear unknowns that can move, in their natural
/// steps.
struct Local {
    moving: Vec<usize>,
    natural: Vec<f64>,
    h: DMatrix<f64>,
    g: DVector<f64>,
}

impl Local {
    /// `None` where nothing can move.
    fn new(
        state: &State,
        nonlinear: &[Unknown],
        reduced: &DMatrix<f64>,
        gradient: &DVector<f64>,
    ) -> Option<Self> {
        // An unknown at a bound that wants to go further out stays there.
        let moving: Vec<usize> = (0..nonlinear.len())
            .filter(|&i| {
                let u = &nonlinear[i];
                let outwards = (state.eta[i] <= u.lower && gradient[i] > 0.0)
                    || (state.eta[i] >= u.upper && gradient[i] < 0.0);
                !u.is_fixed() && !outwards
            })
            .collect();
        let k = moving.len();
        let natural: Vec<f64> = moving
            .iter()
            .map(|&i| nonlinear[i].natural_step())
            .collect();
        let h = DMatrix::from_fn(k, k, |i, j| {
            natural[i] * natural[j] * reduced[(moving[i], moving[j])]
        });
        let g = DVector::from_fn(k, |i, _| natural[i] * gradient[moving[i]]);
        (k > 0).then_some(Local {
            moving,
            natural,
            h,
            g,
        })
    }
}

/// The step to the least cost within the trusted radius; `None` where nothing can move.
fn proposed(
    state: &State,
    nonlinear: &[Unknown],
    reduced: &DMatrix<f64>,
    gradient: &DVector<f64>,
) -> Option<Proposal> {
    let Local {
        moving,
        natural,
        h,
        g,
    } = Local::new(state, nonlinear, reduced, gradient)?;
    let (step, whole, at_most) = trusted_step(&h, &g, state.radius);
    let mut eta = state.eta.clone();
    let mut taken = DVector::zeros(moving.len());
    for (j, &i) in moving.iter().enumerate() {
        eta[i] = (eta[i] + natural[j] * step[j]).clamp(nonlinear[i].lower, nonlinear[i].upper);
        taken[j] = (eta[i] - state.eta[i]) / natural[j];
    }
    let slope = 2.0 * g.dot(&taken);
    Some(Proposal {
        eta,
        length: taken.norm(),
        largest: taken.amax(),
        slope,
        promised: -(slope + (taken.transpose() * &h * &taken)[(0, 0)]),
        at_most,
        whole,
    })
}

/// Fall of a sum of squares over their variances that one standard error makes.
const STANDARD_ERROR: f64 = 1.0;

/// Why a fit ends with a proposal that is not tried.
fn ending(step: &Proposal, options: &Options, state: &State) -> Option<Ended> {
    // A short step promises little anywhere: only a whole or a long one tells that the minimum is here, or one
    // that were whole would fall by less than a standard error. A share of a large cost is no such fall: where
    // the radius is short the linear model is not to be believed.
    let tells = step.whole || state.radius > 0.1 || step.at_most <= STANDARD_ERROR;
    if step.promised <= options.cost_tolerance * state.cost && tells {
        return Some(Ended::Converged);
    }
    if step.largest <= options.step_tolerance {
        return Some(match step.whole {
            true => Ended::StepTooSmall,
            false => Ended::Stalled,
        });
    }
    (state.evaluations >= options.evaluations).then_some(Ended::EvaluationLimit)
}

/// One step: one evaluation, accepted or not. Sets [`State::ended`] when there is nothing left to do.
pub fn advance<P: SeparableResidual>(
    problem: &P,
    nonlinear: &[Unknown],
    linear: &[Unknown],
    options: &Options,
    state: &mut State,
) {
    if state.ended.is_some() {
        return;
    }
    if state.gram.is_empty() {
        let eta = state.eta.clone();
        match evaluate(problem, &eta, state, nonlinear, linear) {
            Some(solved) => accept(state, eta, solved),
            None => state.ended = Some(Ended::StartFailed),
        }
        return;
    }
    if nonlinear.is_empty() {
        // All is linear: the first evaluation solved it.
        state.ended = Some(Ended::Converged);
        return;
    }
    let gram = state.gram();
    let Some((reduced, gradient)) = reduced_system(&gram, state, nonlinear, linear) else {
        state.failure =
            Some("the reduced normal equations hold numbers that are not finite".into());
        state.ended = Some(Ended::Stalled);
        return;
    };
    let Some(step) = proposed(state, nonlinear, &reduced, &gradient) else {
        state.ended = Some(Ended::Converged);
        return;
    };
    state.ended = ending(&step, options, state);
    if state.ended.is_some() {
        return;
    }
    match evaluate(problem, &step.eta, state, nonlinear, linear) {
        Some(solved) if solved.cost < state.cost => {
            let kept = (state.cost - solved.cost) / step.promised.max(f64::MIN_POSITIVE);
            if kept > 0.7 {
                state.radius = state.radius.max(2.5 * step.length).min(20.0);
            } else if kept < 0.25 {
                state.radius = 0.5 * step.length;
            }
            state.iterations += 1;
            accept(state, step.eta, solved);
        }
        Some(solved) => {
            // The parabola through the cost here, its slope, and the cost there: where along the step its
            // lowest point lies.
            let rise = solved.cost - state.cost;
            let lowest = if rise > step.slope {
                -step.slope / (2.0 * (rise - step.slope))
            } else {
                0.5
            };
            state.radius = step.length * lowest.clamp(0.1, 0.5);
        }
        None => state.radius = 0.25 * step.length,
    }
}

/// The minimiser of g's + s'Hs/2 with |s| <= `radius`, whether that bound did not matter, and by how much
/// 2 g's + s'Hs falls at most without it. H is positive semidefinite.
fn trusted_step(h: &DMatrix<f64>, g: &DVector<f64>, radius: f64) -> (DVector<f64>, bool, f64) {
    let eigen = h.clone().symmetric_eigen();
    let along = eigen.eigenvectors.tr_mul(g);
    let largest = eigen.eigenvalues.amax().max(f64::MIN_POSITIVE);
    let length = |shift: f64| -> f64 {
        along
            .iter()
            .zip(eigen.eigenvalues.iter())
            .map(|(a, l)| (a / (l.max(0.0) + shift)).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let floor = 1e-14 * largest;
    let whole = length(floor) <= radius;
    let at_most = along
        .iter()
        .zip(eigen.eigenvalues.iter())
        .map(|(a, l)| a * a / (l.max(0.0) + floor))
        .sum();
    let mut shift = floor;
    if !whole {
        // length falls with the shift: bracket, then halve in the logarithm
        let (mut low, mut high) = (floor.ln(), (g.norm() / radius + floor).ln());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if length(middle.exp()) > radius {
                low = middle
            } else {
                high = middle
            }
        }
        shift = high.exp();
    }
    let scaled = DVector::from_fn(along.len(), |i, _| {
        -along[i] / (eigen.eigenvalues[i].max(0.0) + shift)
    });
    (&eigen.eigenvectors * scaled, whole, at_most)
}

/// J'PJ and J'Pr with the priors, where P projects out the free columns of B; `None` where they hold numbers
/// that are not finite.
fn reduced_system(
    gram: &DMatrix<f64>,
    state: &State,
    nonlinear: &[Unknown],
    linear: &[Unknown],
) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let n = nonlinear.len();
    let last = gram.nrows() - 1;
    let free: Vec<usize> = (0..linear.len()).filter(|&i| state.beta_free[i]).collect();
    let mut h = gram.view((0, 0), (n, n)).into_owned();
    let mut g = DVector::from_fn(n, |i, _| gram[(i, last)]);
    if !free.is_empty() {
        let m = free.len();
        let scale: Vec<f64> = free
            .iter()
            .map(|&i| {
                1.0 / (gram[(n + i, n + i)] + linear[i].pull(0.0).0)
                    .sqrt()
                    .max(f64::MIN_POSITIVE)
            })
            .collect();
        let mut b = DMatrix::from_fn(m, m, |i, j| {
            scale[i] * scale[j] * gram[(n + free[i], n + free[j])]
        });
        for i in 0..m {
            b[(i, i)] += scale[i] * scale[i] * linear[free[i]].pull(0.0).0 + 1e-13;
        }
        let cross = DMatrix::from_fn(m, n, |i, j| scale[i] * gram[(n + free[i], j)]);
        let residual = DVector::from_fn(m, |i, _| {
            let pull = linear[free[i]].pull(state.beta[free[i]]).1;
            scale[i] * (gram[(n + free[i], last)] + pull)
        });
        if let Some(c) = b.cholesky() {
            h -= cross.tr_mul(&c.solve(&cross));
            g -= cross.tr_mul(&c.solve(&residual));
        }
    }
    // What the projection leaves is positive semidefinite; rounding may have left a negative direction, which
    // says nothing.
    let scale: Vec<f64> = (0..n)
        .map(|i| {
            if gram[(i, i)] > 0.0 {
                gram[(i, i)].sqrt()
            } else {
                1.0
            }
        })
        .collect();
    let scaled = DMatrix::from_fn(n, n, |i, j| {
        0.5 * (h[(i, j)] + h[(j, i)]) / (scale[i] * scale[j])
    });
    if not_finite(&scaled).is_some() || g.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let mut eigen = scaled.symmetric_eigen();
    eigen.eigenvalues.apply(|v| *v = v.max(0.0));
    let clean = eigen.recompose();
    for i in 0..n {
        for j in 0..n {
            h[(i, j)] = clean[(i, j)] * scale[i] * scale[j];
        }
    }
    for (i, u) in nonlinear.iter().enumerate() {
        let (weight, slope) = u.pull(state.eta[i]);
        h[(i, i)] += weight;
        g[i] += slope;
    }
    Some((h, g))
}

/// Runs a fit from `eta` to its end. `watch` is called after every evaluation and stops the fit when it says
/// so.
pub fn minimise<P: SeparableResidual>(
    problem: &P,
    nonlinear: &[Unknown],
    linear: &[Unknown],
    eta: &[f64],
    options: &Options,
    mut watch: impl FnMut(&State) -> std::ops::ControlFlow<()>,
) -> State {
    let mut state = State::at(eta, nonlinear, linear);
    while state.ended.is_none() {
        advance(problem, nonlinear, linear, options, &mut state);
        if state.ended.is_none() && watch(&state).is_break() {
            state.ended = Some(Ended::Stopped);
        }
    }
    state
}
