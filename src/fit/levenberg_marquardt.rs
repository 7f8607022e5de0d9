//! Levenberg-Marquardt for dense nonlinear least squares, with box bounds.
//!
//! Given residuals `r(p)` (m values) of parameters `p` (n values), find
//!
//! ```text
//!     minimise  F(p) = 1/2 sum_i r_i(p)^2     subject to  lower_j <= p_j <= upper_j
//! ```
//!
//! | name in the code | symbol | shape | meaning |
//! |---|---|---|---|
//! | `residuals` | r | m | predicted minus recorded, weighted |
//! | `jacobian` | J | m x n | `J[(i, j)] = d r_i / d p_j` |
//! | `factor` | S | n x n | `S^T S = J^T J`, the triangular factor of `J = Q S` |
//! | `projected` | z | n | `Q^T r` |
//! | `gradient` | g | n | `J^T r = S^T z` |
//! | `scale` | D | n | column norms of J, never falling (More 1978) |
//! | `damping` | mu | 1 | weight of the step length in the step equation |
//! | `cost` | F | 1 | half the sum of squares |
//!
//! One iteration solves the damped linear problem
//!
//! ```text
//!     minimise over s   |S s + z|^2 + mu |D s|^2      (Marquardt 1963; More 1978)
//! ```
//!
//! by Householder reflections with column pivoting of the stacked matrix `[S D^-1; sqrt(mu) I]`, never
//! through the normal equations, whose condition number is the square. mu is the one that gives the step the
//! length `|D s|` of the trust region, or 0 where the full step is shorter; how much of the predicted saving
//! came true moves that radius. Parameters that the step would carry through a bound are put on it and the
//! rest is solved again. An evaluation that fails, or that gives a number that is not finite, is a rejected
//! step.
//!
//! A minimiser that compares costs cannot place the parameters better than about the square root of the
//! machine precision, because the cost is flat at its minimum. Therefore a converged search is followed by a
//! *polish*: full Gauss-Newton steps, each kept only if the next one is shorter, until rounding stops them.
//!
//! Converged, failed and misused are three things: [`minimise`] returns `Err` only for a [`Misuse`]; a search
//! that does not converge is an [`Outcome`] whose [`StopReason`] says so.
//!
//! # Example
//!
//! ```
//! use deacal::fit::levenberg_marquardt::{minimise, LeastSquares, Matrix, Options};
//!
//! /// Rosenbrock's valley as two residuals.
//! struct Valley;
//!
//! impl LeastSquares for Valley {
//!     type Error = std::convert::Infallible;
//!     fn parameter_count(&self) -> usize { 2 }
//!     fn residual_count(&self) -> usize { 2 }
//!     fn residuals(&self, p: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
//!         out[0] = 10.0 * (p[1] - p[0] * p[0]);
//!         out[1] = 1.0 - p[0];
//!         Ok(())
//!     }
//!     fn jacobian(&self, p: &[f64], out: &mut Matrix) -> Result<(), Self::Error> {
//!         out[(0, 0)] = -20.0 * p[0];
//!         out[(0, 1)] = 10.0;
//!         out[(1, 0)] = -1.0;
//!         out[(1, 1)] = 0.0;
//!         Ok(())
//!     }
//! }
//!
//! let outcome = minimise(&Valley, &[-1.2, 1.0], &Options::default()).unwrap();
//! assert!(outcome.reason.converged(), "{}", outcome.reason);
//! assert_eq!(outcome.parameters, [1.0, 1.0]);
//! ```
//!
//! # Sources
//!
//! - J. J. More, The Levenberg-Marquardt algorithm: implementation and theory, Lecture Notes in Mathematics
//!   630 (1978) 105: scaling, radius.
//! - J. Nocedal, S. J. Wright, Numerical Optimization, 2nd ed. (2006), chapters 4, 10 and 16.7: trust
//!   regions, least squares, projection on a box.
//! - D. M. Bates, D. G. Watts, A relative offset orthogonality convergence criterion for nonlinear least
//!   squares, Technometrics 23 (1981) 179: the test of convergence.
//! - G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed. (2013), 5.1 and 5.4: reflections, column
//!   pivoting.
//! - C. J. F. Ridders, Accurate computation of F'(x) and F'(x) F''(x), Advances in Engineering Software 4
//!   (1982) 75.

use std::fmt;
use std::ops::ControlFlow;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// A dense matrix, column after column.
pub type Matrix = DMatrix<f64>;

/// A nonlinear least-squares problem: residuals and their derivatives as functions of the parameters.
///
/// Both functions write into the caller's memory. They may fail; a failure is counted and survived. A number
/// that is not finite counts as a failure too, so that a model may let its own overflow pass. Equal
/// parameters must give equal numbers.
pub trait LeastSquares {
    /// Why the model could not be evaluated. Its words are kept in [`Failure`].
    type Error: fmt::Display;

    /// The number of parameters, n.
    fn parameter_count(&self) -> usize;

    /// The number of residuals, m. It may be smaller than n: the damping then picks a solution.
    fn residual_count(&self) -> usize;

    /// Writes the m residuals at `parameters` into `out`.
    ///
    /// # Errors
    ///
    /// When the model cannot be evaluated at these parameters.
    fn residuals(&self, parameters: &[f64], out: &mut [f64]) -> Result<(), Self::Error>;

    /// Writes the m x n derivatives at `parameters`, `out[(i, j)] = d r_i / d p_j`. Every element must be
    /// written: `out` holds old numbers.
    ///
    /// # Errors
    ///
    /// When the model cannot be evaluated at these parameters.
    fn jacobian(&self, parameters: &[f64], out: &mut Matrix) -> Result<(), Self::Error>;
}

impl<P: LeastSquares + ?Sized> LeastSquares for &P {
    type Error = P::Error;

    fn parameter_count(&self) -> usize {
        (**self).parameter_count()
    }

    fn residual_count(&self) -> usize {
        (**self).residual_count()
    }

    fn residuals(&self, parameters: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
        (**self).residuals(parameters, out)
    }

    fn jacobian(&self, parameters: &[f64], out: &mut Matrix) -> Result<(), Self::Error> {
        (**self).jacobian(parameters, out)
    }
}

/// What a search may be told. The defaults suit exact derivatives.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// One `[lower, upper]` a parameter; empty for none. An open side is infinite; equal sides hold the
    /// parameter fixed.
    pub bounds: Vec<[f64; 2]>,
    /// Search iterations (trial steps, kept or rejected) before giving up; polishing is not counted.
    pub iteration_limit: usize,
    /// Converged when the relative offset of Bates and Watts, the share of `|r|` that lies in the plane of
    /// the free columns of J, is at most this. The cost that a Gauss-Newton step would still save is its
    /// square times the cost.
    pub gradient_tolerance: f64,
    /// Converged when the undamped step is at most this share of the parameters, `|D s| <= tolerance |D p|`.
    pub step_tolerance: f64,
    /// Converged when a step was expected to save, and saved, at most this share of the cost.
    pub cost_tolerance: f64,
    /// The longest first step, as a share of the scaled length `|D p|` of the start (of one, where that is
    /// zero).
    pub initial_radius: f64,
    /// The most Gauss-Newton steps of the polish; 0 leaves it out.
    pub polish_limit: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            bounds: Vec::new(),
            iteration_limit: 2000,
            gradient_tolerance: 1e-10,
            step_tolerance: 1e-12,
            cost_tolerance: 1e-15,
            initial_radius: 1.0,
            polish_limit: 60,
        }
    }
}

/// A call that cannot be meant. Not converging is no misuse.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Misuse {
    /// The problem has no parameters or no residuals.
    #[error(
        "a problem with {parameters} parameters and {residuals} residuals leaves nothing to fit"
    )]
    Empty {
        /// The number of parameters.
        parameters: usize,
        /// The number of residuals.
        residuals: usize,
    },
    /// A list has not one entry a parameter.
    #[error("{what}: {found} values for {expected} parameters")]
    Length {
        /// Which list.
        what: &'static str,
        /// The number of parameters.
        expected: usize,
        /// The entries found.
        found: usize,
    },
    /// A start that is not a number.
    #[error("parameter {index} starts at {value}, which is not finite")]
    StartNotFinite {
        /// Which parameter, from 0.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A start outside its bounds.
    #[error("parameter {index} starts at {value}, outside its bounds {lower} to {upper}")]
    StartOutsideBounds {
        /// Which parameter, from 0.
        index: usize,
        /// Its value.
        value: f64,
        /// Its lower bound.
        lower: f64,
        /// Its upper bound.
        upper: f64,
    },
    /// Bounds that leave no number between them.
    #[error("the bounds of parameter {index} are {lower} to {upper}, which leaves nothing")]
    Bounds {
        /// Which parameter, from 0.
        index: usize,
        /// The lower bound.
        lower: f64,
        /// The upper bound.
        upper: f64,
    },
    /// An option out of its range.
    #[error("option {name} is {value}; it must be {must}")]
    OptionRange {
        /// Its name in [`Options`].
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        must: &'static str,
    },
    /// A saved state that belongs to another problem.
    #[error("the saved state has {found} parameters and the problem has {expected}")]
    OtherProblem {
        /// Parameters of the problem.
        expected: usize,
        /// Parameters of the state.
        found: usize,
    },
}

/// Why a search stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum StopReason {
    /// Converged: what is left of the residuals is orthogonal to the columns of the Jacobian.
    ConvergedByGradient,
    /// Converged: the undamped step is negligible beside the parameters.
    ConvergedByStep,
    /// Converged: steps no longer lower the cost, or the cost is zero.
    ConvergedByCost,
    /// Not converged: the iterations ran out.
    IterationLimit,
    /// Not converged: no step, however short, lowers the cost.
    Stalled,
    /// Not converged: the caller asked for a stop.
    StoppedByUser,
    /// Not begun: the model cannot be evaluated at the start.
    InitialPointFailed,
}

impl StopReason {
    /// Whether the search ended at a minimum, as far as it can tell.
    pub fn converged(self) -> bool {
        matches!(
            self,
            StopReason::ConvergedByGradient
                | StopReason::ConvergedByStep
                | StopReason::ConvergedByCost
        )
    }

    /// The reason in words.
    pub fn words(self) -> &'static str {
        match self {
            StopReason::ConvergedByGradient => {
                "converged: the residuals are orthogonal to every free direction"
            }
            StopReason::ConvergedByStep => "converged: the next full step is negligible",
            StopReason::ConvergedByCost => "converged: no step lowers the cost any more",
            StopReason::IterationLimit => "not converged: the iteration limit was reached",
            StopReason::Stalled => {
                "not converged: no step lowers the cost, and this is not a minimum"
            }
            StopReason::StoppedByUser => "not converged: stopped on request",
            StopReason::InitialPointFailed => {
                "not begun: the model cannot be evaluated at the start"
            }
        }
    }
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.words())
    }
}

/// An evaluation that failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// The words of the model's error, or which number was not finite.
    pub message: String,
    /// Where it failed.
    pub parameters: Vec<f64>,
}

/// Where a parameter stands between its bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resting {
    /// Between its bounds, or on one that the cost pushes it away from.
    Free,
    /// On its lower bound: the cost would fall beyond it.
    Lower,
    /// On its upper bound: the cost would fall beyond it.
    Upper,
    /// Both bounds are the same number.
    Fixed,
}

/// Which part of the work a state is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Damped steps that lower the cost.
    Search,
    /// Full Gauss-Newton steps that grow shorter.
    Polish,
}

/// Everything that one iteration needs and leaves: plain data of size n^2 that can be written down and taken
/// up again, to the bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    parameters: Vec<f64>,
    cost: f64,
    /// S, n x n, column after column.
    factor: Vec<f64>,
    /// z.
    projected: Vec<f64>,
    /// D.
    scale: Vec<f64>,
    damping: f64,
    /// The longest step, `|D s|`, that the linear model is trusted with.
    radius: f64,
    phase: Phase,
    /// What the search would say if the polish adds nothing.
    search_reason: StopReason,
    resting: Vec<Resting>,
    /// The undamped step of the free parameters, 0 for those at rest.
    newton_step: Vec<f64>,
    newton_length: f64,
    relative_offset: f64,
    gradient_norm: f64,
    iterations: usize,
    accepted_steps: usize,
    polish_steps: usize,
    evaluations: usize,
    jacobian_evaluations: usize,
    failed_evaluations: usize,
    last_failure: Option<Failure>,
    stop: Option<StopReason>,
}

impl State {
    /// The current parameters, n.
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Half the sum of squares at the current parameters; infinite if the start could not be evaluated.
    pub fn cost(&self) -> f64 {
        self.cost
    }

    /// mu of the last step, relative to scaled columns; 0 for a full Gauss-Newton step.
    pub fn damping(&self) -> f64 {
        self.damping
    }

    /// The longest step, `|D s|`, that the linear model is trusted with.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The largest `|g_j|` of the free parameters.
    pub fn gradient_norm(&self) -> f64 {
        self.gradient_norm
    }

    /// The share of `|r|` that lies in the plane of the free columns of J.
    pub fn relative_offset(&self) -> f64 {
        self.relative_offset
    }

    /// Search iterations so far.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Gauss-Newton steps of the polish so far.
    pub fn polish_steps(&self) -> usize {
        self.polish_steps
    }

    /// Evaluations of the residuals so far, those that failed included.
    pub fn evaluations(&self) -> usize {
        self.evaluations
    }

    /// Evaluations of the Jacobian so far, those that failed included.
    pub fn jacobian_evaluations(&self) -> usize {
        self.jacobian_evaluations
    }

    /// Evaluations of either kind that failed.
    pub fn failed_evaluations(&self) -> usize {
        self.failed_evaluations
    }

    /// Searching or polishing.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Why the work ended; `None` while it goes on.
    pub fn stop(&self) -> Option<StopReason> {
        self.stop
    }

    /// Whether the arrays of the state fit a problem of `n` parameters and these options.
    pub(crate) fn fits(&self, n: usize, options: &Options) -> bool {
        self.parameters.len() == n
            && self.factor.len() == n * n
            && self.projected.len() == n
            && self.scale.len() == n
            && self.resting.len() == n
            && self.newton_step.len() == n
            && (options.bounds.is_empty() || options.bounds.len() == n)
    }

    fn fail(&mut self, parameters: &[f64], message: String) {
        self.failed_evaluations += 1;
        self.last_failure = Some(Failure {
            message,
            parameters: parameters.to_vec(),
        });
    }
}

/// Memory of size m n, taken once and used by every iteration. Holds no result.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    residuals: Vec<f64>,
    jacobian: Matrix,
}

impl Workspace {
    fn fit(&mut self, m: usize, n: usize) {
        if self.residuals.len() != m || self.jacobian.shape() != (m, n) {
            self.residuals = vec![0.0; m];
            self.jacobian = Matrix::zeros(m, n);
        }
    }
}

/// What a fit gave. Where the start could not be evaluated, cost, gradient and offset are infinite; formats
/// without infinities (JSON) write them as null.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The parameters, n: the best that were found, whatever the reason.
    pub parameters: Vec<f64>,
    /// Where each parameter stands between its bounds.
    pub resting: Vec<Resting>,
    /// Why it stopped.
    pub reason: StopReason,
    /// Half the sum of squares.
    pub cost: f64,
    /// The largest `|g_j|` of the free parameters.
    pub gradient_norm: f64,
    /// The share of `|r|` that lies in the plane of the free columns of J (Bates, Watts 1981).
    pub relative_offset: f64,
    /// `|D s| / |D p|` of the undamped step from here: the relative distance to the minimum, to first order.
    pub newton_step_relative: f64,
    /// Trial steps of the search.
    pub iterations: usize,
    /// Trial steps that were kept.
    pub accepted_steps: usize,
    /// Gauss-Newton steps that the polish kept.
    pub polish_steps: usize,
    /// Evaluations of the residuals, those that failed included.
    pub evaluations: usize,
    /// Evaluations of the Jacobian, those that failed included.
    pub jacobian_evaluations: usize,
    /// Evaluations of either kind that failed and were survived.
    pub failed_evaluations: usize,
    /// The last of them.
    pub last_failure: Option<Failure>,
    /// The number of residuals, m.
    pub residual_count: usize,
    /// S at the parameters, n x n, column after column: `S^T S = J^T J`.
    factor: Vec<f64>,
}

/// Why there is no covariance.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoCovariance {
    /// The start could not be evaluated.
    #[error("there is no Jacobian: the model was never evaluated")]
    NoJacobian,
    /// The data do not determine the free parameters.
    #[error(
        "the residuals determine {rank} of {free} free parameters; undetermined with the rest held: {undetermined:?}"
    )]
    RankDeficient {
        /// Directions that are determined.
        rank: usize,
        /// Free parameters.
        free: usize,
        /// The parameters, from 0, that depend on those pivoted before them.
        undetermined: Vec<usize>,
    },
    /// No residual is left to tell the noise from.
    #[error("{residuals} residuals for {free} free parameters leave no degree of freedom")]
    NoFreedom {
        /// The number of residuals.
        residuals: usize,
        /// Free parameters.
        free: usize,
    },
}

impl Outcome {
    /// `sum r_i^2`, twice the cost.
    pub fn residual_sum_of_squares(&self) -> f64 {
        2.0 * self.cost
    }

    /// Which parameters are neither on a bound nor fixed.
    pub fn free(&self) -> Vec<usize> {
        free_of(&self.resting)
    }

    /// `sum r_i^2 / (m - free parameters)`: the variance of the residuals about the fit.
    ///
    /// # Errors
    ///
    /// [`NoCovariance::NoFreedom`] when there are no more residuals than free parameters.
    pub fn residual_variance(&self) -> Result<f64, NoCovariance> {
        let free = self.free().len();
        if self.residual_count <= free {
            return Err(NoCovariance::NoFreedom {
                residuals: self.residual_count,
                free,
            });
        }
        Ok(self.residual_sum_of_squares() / (self.residual_count - free) as f64)
    }

    /// `(J^T J)^-1` over the free parameters, n x n: the covariance if every residual has variance one, as
    /// residuals divided by their noise have. From the triangular factor, `R^-1 R^-T`, not from `J^T J`. Rows
    /// and columns of parameters at rest on a bound are NaN: to first order the residuals say nothing of
    /// their spread, and 0 would claim that they do.
    ///
    /// # Errors
    ///
    /// [`NoCovariance`], when there is no Jacobian or it does not determine the free parameters.
    pub fn covariance_unscaled(&self) -> Result<Matrix, NoCovariance> {
        let n = self.parameters.len();
        if !self.cost.is_finite() {
            return Err(NoCovariance::NoJacobian);
        }
        let free = self.free();
        let k = free.len();
        let norms = column_norms(&self.factor, n);
        // J_F diag(1/norm) P = Q R
        let mut a = scaled_columns(&self.factor, n, &free, &norms);
        let pivots = triangularise(&mut a, n, k, &mut [], true);
        let rank = rank_of(&a, n, k);
        if rank < k {
            let mut undetermined: Vec<usize> = pivots[rank..].iter().map(|&c| free[c]).collect();
            undetermined.sort_unstable();
            return Err(NoCovariance::RankDeficient {
                rank,
                free: k,
                undetermined,
            });
        }
        // the rows of R^-1, upper triangular
        let mut inverse = Matrix::zeros(k, k);
        for c in 0..k {
            inverse[(c, c)] = 1.0 / a[c + c * n];
            for i in (0..c).rev() {
                let sum: f64 = (i + 1..=c).map(|l| a[i + l * n] * inverse[(l, c)]).sum();
                inverse[(i, c)] = -sum / a[i + i * n];
            }
        }
        let mut covariance = Matrix::from_element(n, n, f64::NAN);
        for i in 0..k {
            for j in 0..k {
                let sum: f64 = (i.max(j)..k)
                    .map(|l| inverse[(i, l)] * inverse[(j, l)])
                    .sum();
                let (pi, pj) = (free[pivots[i]], free[pivots[j]]);
                covariance[(pi, pj)] = sum / norms[pi] / norms[pj];
            }
        }
        Ok(covariance)
    }

    /// [`Self::covariance_unscaled`] times [`Self::residual_variance`]: the covariance if the noise is white,
    /// of one unknown size, and all that the residuals hold. Where physics is missing it is none of these,
    /// and this is too small.
    ///
    /// # Errors
    ///
    /// [`NoCovariance`], when there is no Jacobian, it does not determine the free parameters, or no freedom
    /// is left.
    pub fn covariance_scaled_by_residual_variance(&self) -> Result<Matrix, NoCovariance> {
        Ok(self.covariance_unscaled()? * self.residual_variance()?)
    }

    /// Square roots of the diagonal of [`Self::covariance_unscaled`], n; NaN at a bound.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn standard_errors_unscaled(&self) -> Result<Vec<f64>, NoCovariance> {
        let covariance = self.covariance_unscaled()?;
        Ok(covariance.diagonal().iter().map(|v| v.sqrt()).collect())
    }

    /// Square roots of the diagonal of [`Self::covariance_scaled_by_residual_variance`], n; NaN at a bound.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn standard_errors_scaled_by_residual_variance(&self) -> Result<Vec<f64>, NoCovariance> {
        let deviation = self.residual_variance()?.sqrt();
        let unscaled = self.standard_errors_unscaled()?;
        Ok(unscaled.iter().map(|v| v * deviation).collect())
    }

    /// Singular values of J with each free column scaled to length one (a zero column stays zero), falling.
    /// Their quotient, first to last, is the condition of the fit whatever the units; a last one near 0 is a
    /// combination of parameters that the residuals do not see. Empty if the start could not be evaluated or
    /// nothing is free.
    pub fn scaled_singular_values(&self) -> Vec<f64> {
        let n = self.parameters.len();
        let free = self.free();
        if !self.cost.is_finite() || free.is_empty() {
            return Vec::new();
        }
        let norms = column_norms(&self.factor, n);
        let a = Matrix::from_vec(
            n,
            free.len(),
            scaled_columns(&self.factor, n, &free, &norms),
        );
        let Some(svd) = a.try_svd(false, false, f64::EPSILON, 10_000) else {
            return Vec::new();
        };
        let mut values: Vec<f64> = svd.singular_values.iter().copied().collect();
        values.sort_by(|a, b| b.total_cmp(a));
        values
    }
}

/// Fits `problem` from `start` (n values) and says what came of it.
///
/// # Errors
///
/// [`Misuse`], when the call cannot be meant. A search that does not converge is an outcome.
pub fn minimise<P: LeastSquares + ?Sized>(
    problem: &P,
    start: &[f64],
    options: &Options,
) -> Result<Outcome, Misuse> {
    minimise_watched(problem, start, options, |_| ControlFlow::Continue(()))
}

/// As [`minimise`], and shows `watch` the state before every iteration; [`ControlFlow::Break`] stops the work
/// ([`StopReason::StoppedByUser`]) and keeps what was found. To stop from a signal handler, let `watch` read
/// an `AtomicBool`.
///
/// # Errors
///
/// [`Misuse`], when the call cannot be meant.
pub fn minimise_watched<P: LeastSquares + ?Sized>(
    problem: &P,
    start: &[f64],
    options: &Options,
    mut watch: impl FnMut(&State) -> ControlFlow<()>,
) -> Result<Outcome, Misuse> {
    let mut workspace = Workspace::default();
    let mut state = begin(problem, start, options, &mut workspace)?;
    while state.stop.is_none() {
        if watch(&state).is_break() {
            state.stop = Some(StopReason::StoppedByUser);
            break;
        }
        advance(problem, options, &mut state, &mut workspace);
    }
    Ok(finish(problem, &state))
}

/// Checks the call and evaluates the start. If the model fails there, the state says
/// [`StopReason::InitialPointFailed`].
///
/// # Errors
///
/// [`Misuse`], when the call cannot be meant.
pub fn begin<P: LeastSquares + ?Sized>(
    problem: &P,
    start: &[f64],
    options: &Options,
    workspace: &mut Workspace,
) -> Result<State, Misuse> {
    let (n, m) = (problem.parameter_count(), problem.residual_count());
    check(n, m, start, options)?;
    workspace.fit(m, n);
    let mut state = State {
        parameters: start.to_vec(),
        cost: f64::INFINITY,
        factor: vec![0.0; n * n],
        projected: vec![0.0; n],
        scale: vec![0.0; n],
        damping: 0.0,
        radius: 0.0,
        phase: Phase::Search,
        search_reason: StopReason::Stalled,
        resting: vec![Resting::Free; n],
        newton_step: vec![0.0; n],
        newton_length: f64::INFINITY,
        relative_offset: f64::INFINITY,
        gradient_norm: f64::INFINITY,
        iterations: 0,
        accepted_steps: 0,
        polish_steps: 0,
        evaluations: 0,
        jacobian_evaluations: 0,
        failed_evaluations: 0,
        last_failure: None,
        stop: None,
    };
    let evaluated = evaluate_residuals(problem, start, &mut state, workspace)
        .and_then(|cost| Some((cost, linearise(problem, start, &mut state, workspace)?)));
    match evaluated {
        Some((cost, linear)) => {
            move_to(&mut state, start.to_vec(), cost, linear, options);
            let size = scaled_norm(&state.scale, start);
            state.radius = options.initial_radius * if size > 0.0 { size } else { 1.0 };
            search_ends(&mut state, options);
        }
        None => state.stop = Some(StopReason::InitialPointFailed),
    }
    Ok(state)
}

/// One iteration: one trial step, kept or rejected. Does nothing to a state that has stopped.
///
/// # Panics
///
/// When `state` belongs to a problem with another number of parameters.
pub fn advance<P: LeastSquares + ?Sized>(
    problem: &P,
    options: &Options,
    state: &mut State,
    workspace: &mut Workspace,
) {
    if state.stop.is_some() {
        return;
    }
    workspace.fit(problem.residual_count(), problem.parameter_count());
    match state.phase {
        Phase::Search => search_step(problem, options, state, workspace),
        Phase::Polish => polish_step(problem, options, state, workspace),
    }
}

/// What a state amounts to. A state that has not stopped counts as stopped by the user.
pub fn finish<P: LeastSquares + ?Sized>(problem: &P, state: &State) -> Outcome {
    Outcome {
        parameters: state.parameters.clone(),
        resting: state.resting.clone(),
        reason: state.stop.unwrap_or(StopReason::StoppedByUser),
        cost: state.cost,
        gradient_norm: state.gradient_norm,
        relative_offset: state.relative_offset,
        newton_step_relative: state.newton_length / scaled_norm(&state.scale, &state.parameters),
        iterations: state.iterations,
        accepted_steps: state.accepted_steps,
        polish_steps: state.polish_steps,
        evaluations: state.evaluations,
        jacobian_evaluations: state.jacobian_evaluations,
        failed_evaluations: state.failed_evaluations,
        last_failure: state.last_failure.clone(),
        residual_count: problem.residual_count(),
        factor: state.factor.clone(),
    }
}

pub(crate) fn check(n: usize, m: usize, start: &[f64], options: &Options) -> Result<(), Misuse> {
    if n == 0 || m == 0 {
        return Err(Misuse::Empty {
            parameters: n,
            residuals: m,
        });
    }
    if start.len() != n {
        return Err(Misuse::Length {
            what: "start",
            expected: n,
            found: start.len(),
        });
    }
    if !options.bounds.is_empty() && options.bounds.len() != n {
        return Err(Misuse::Length {
            what: "bounds",
            expected: n,
            found: options.bounds.len(),
        });
    }
    for (index, &value) in start.iter().enumerate() {
        if !value.is_finite() {
            return Err(Misuse::StartNotFinite { index, value });
        }
        let [lower, upper] = bound(options, index);
        // written so that a NaN is refused too
        let sound = lower <= upper && lower < f64::INFINITY && upper > f64::NEG_INFINITY;
        if !sound {
            return Err(Misuse::Bounds {
                index,
                lower,
                upper,
            });
        }
        if value < lower || value > upper {
            return Err(Misuse::StartOutsideBounds {
                index,
                value,
                lower,
                upper,
            });
        }
    }
    for (name, value) in [
        ("gradient_tolerance", options.gradient_tolerance),
        ("step_tolerance", options.step_tolerance),
        ("cost_tolerance", options.cost_tolerance),
    ] {
        if !(0.0..1.0).contains(&value) {
            return Err(Misuse::OptionRange {
                name,
                value,
                must: "at least 0 and below 1",
            });
        }
    }
    if !(options.initial_radius > 0.0 && options.initial_radius.is_finite()) {
        return Err(Misuse::OptionRange {
            name: "initial_radius",
            value: options.initial_radius,
            must: "above 0 and finite",
        });
    }
    Ok(())
}

fn bound(options: &Options, j: usize) -> [f64; 2] {
    options
        .bounds
        .get(j)
        .copied()
        .unwrap_or([f64::NEG_INFINITY, f64::INFINITY])
}

/// r into the workspace; F, or `None` with the failure noted.
fn evaluate_residuals<P: LeastSquares + ?Sized>(
    problem: &P,
    parameters: &[f64],
    state: &mut State,
    workspace: &mut Workspace,
) -> Option<f64> {
    state.evaluations += 1;
    if let Err(error) = problem.residuals(parameters, &mut workspace.residuals) {
        state.fail(parameters, error.to_string());
        return None;
    }
    // F = 1/2 r^T r
    let cost = 0.5 * dot(&workspace.residuals, &workspace.residuals);
    if !cost.is_finite() {
        let message = match workspace.residuals.iter().position(|r| !r.is_finite()) {
            Some(i) => format!("residual {i} is {}", workspace.residuals[i]),
            None => "the sum of squares overflows".to_string(),
        };
        state.fail(parameters, message);
        return None;
    }
    Some(cost)
}

/// S and z.
struct Linear {
    factor: Vec<f64>,
    projected: Vec<f64>,
}

/// J at the point whose residuals are in the workspace, and its factor; the residuals there are spent. `None`
/// with the failure noted.
fn linearise<P: LeastSquares + ?Sized>(
    problem: &P,
    parameters: &[f64],
    state: &mut State,
    workspace: &mut Workspace,
) -> Option<Linear> {
    state.jacobian_evaluations += 1;
    let (m, n) = workspace.jacobian.shape();
    if let Err(error) = problem.jacobian(parameters, &mut workspace.jacobian) {
        state.fail(parameters, error.to_string());
        return None;
    }
    if workspace.jacobian.shape() != (m, n) {
        state.fail(parameters, "the Jacobian has another shape".to_string());
        return None;
    }
    let j = workspace.jacobian.as_mut_slice();
    if let Some(at) = j.iter().position(|v| !v.is_finite()) {
        let message = format!(
            "the derivative of residual {} by parameter {} is {}",
            at % m,
            at / m,
            j[at]
        );
        state.fail(parameters, message);
        return None;
    }
    // J = Q S, z = Q^T r
    triangularise(j, m, n, &mut workspace.residuals, false);
    let mut factor = vec![0.0; n * n];
    let mut projected = vec![0.0; n];
    for c in 0..n {
        let rows = m.min(c + 1);
        factor[c * n..c * n + rows].copy_from_slice(&j[c * m..c * m + rows]);
    }
    let rows = m.min(n);
    projected[..rows].copy_from_slice(&workspace.residuals[..rows]);
    // the norms are squared once more by the model of the cost
    let sound = column_norms(&factor, n).iter().all(|v| *v < 1e150);
    if !sound || projected.iter().any(|v| !v.is_finite()) {
        state.fail(parameters, "the Jacobian overflows".to_string());
        return None;
    }
    Some(Linear { factor, projected })
}

/// Makes a linearised point the current one.
fn move_to(state: &mut State, parameters: Vec<f64>, cost: f64, linear: Linear, options: &Options) {
    let n = parameters.len();
    state.parameters = parameters;
    state.cost = cost;
    state.factor = linear.factor;
    state.projected = linear.projected;
    let norms = column_norms(&state.factor, n);
    for (scale, norm) in state.scale.iter_mut().zip(&norms) {
        // D_j never falls (More 1978)
        *scale = scale.max(*norm);
    }
    // g = S^T z
    let gradient: Vec<f64> = (0..n)
        .map(|j| dot(&state.factor[j * n..(j + 1) * n], &state.projected))
        .collect();
    for (j, g) in gradient.iter().enumerate() {
        let [lower, upper] = bound(options, j);
        let p = state.parameters[j];
        state.resting[j] = if lower == upper {
            Resting::Fixed
        } else if p <= lower && *g > 0.0 {
            Resting::Lower
        } else if p >= upper && *g < 0.0 {
            Resting::Upper
        } else {
            Resting::Free
        };
    }
    let free = free_of(&state.resting);
    state.gradient_norm = free
        .iter()
        .fold(0.0, |largest: f64, &j| largest.max(gradient[j].abs()));
    // the undamped step: minimise |S_F s_F + z|
    let (step, reach) = gauss_newton(&state.factor, n, &free, &norms, &state.projected);
    state.newton_length = scaled_norm(&state.scale, &step);
    state.newton_step = step;
    // |Q_F^T r| / |r|  (Bates, Watts 1981, without the degrees of freedom)
    let length = (2.0 * cost).sqrt();
    state.relative_offset = if length > 0.0 { reach / length } else { 0.0 };
}

fn search_step<P: LeastSquares + ?Sized>(
    problem: &P,
    options: &Options,
    state: &mut State,
    workspace: &mut Workspace,
) {
    if state.iterations >= options.iteration_limit {
        state.stop = Some(StopReason::IterationLimit);
        return;
    }
    state.iterations += 1;
    if state.radius < f64::MIN_POSITIVE {
        end_search(state, StopReason::Stalled, options);
        return;
    }
    state.damping = damping_for(state);
    let trial = damped_trial(state, options);
    let step: Vec<f64> = (trial.iter().zip(&state.parameters))
        .map(|(t, p)| t - p)
        .collect();
    // F(p) - F(p + s) by the linear model:  -z^T S s - 1/2 |S s|^2
    let moved = times(&state.factor, &step);
    let predicted = -dot(&state.projected, &moved) - 0.5 * dot(&moved, &moved);
    let length = scaled_norm(&state.scale, &step);
    let shortest = f64::EPSILON * scaled_norm(&state.scale, &state.parameters);
    if length <= shortest && state.accepted_steps + state.iterations > 1 || length == 0.0 {
        end_search(state, StopReason::Stalled, options);
        return;
    }
    // what a rejected step leaves of the radius
    let mut gain = 0.0;
    if predicted > 0.0
        && let Some(cost) = evaluate_residuals(problem, &trial, state, workspace)
    {
        let saved = state.cost - cost;
        gain = saved / predicted;
        let before = state.cost;
        if saved > 0.0
            && gain > 1e-4
            && let Some(linear) = linearise(problem, &trial, state, workspace)
        {
            state.accepted_steps += 1;
            state.radius = radius_after(gain, length, state);
            move_to(state, trial, cost, linear, options);
            let little = options.cost_tolerance * before;
            if !search_ends(state, options) && saved <= little && predicted <= little && gain <= 2.0
            {
                end_search(state, StopReason::ConvergedByCost, options);
            }
            return;
        } else if saved.abs() <= options.cost_tolerance * before
            && 0.5 * state.newton_reach_squared() <= options.cost_tolerance * before
        {
            end_search(state, StopReason::ConvergedByCost, options);
            return;
        }
    }
    state.radius = radius_after(gain.min(0.0), length, state);
}

/// The radius after a step of `length` that saved `gain` of what was predicted (More 1978; Nocedal, Wright
/// 2006, algorithm 4.1).
fn radius_after(gain: f64, length: f64, state: &State) -> f64 {
    if gain < 0.25 {
        (if gain <= 0.0 { 0.25 } else { 0.5 }) * length.min(state.radius)
    } else if gain > 0.75 || state.damping == 0.0 {
        state.radius.max(2.0 * length)
    } else {
        state.radius
    }
}

/// mu with `|D s(mu)| = radius` to a tenth, or 0 where the full step is shorter (More 1978).
///
/// With `S_F D^-1 = U diag(sigma) V^T` and `c = U^T z`,
/// `|D s(mu)|^2 = sum (sigma_i c_i / (sigma_i^2 + mu))^2`  falls in mu.
fn damping_for(state: &State) -> f64 {
    let n = state.parameters.len();
    let free = free_of(&state.resting);
    let radius = state.radius;
    if free.is_empty() || state.newton_length <= 1.1 * radius {
        return 0.0;
    }
    let scaled = scaled_columns(&state.factor, n, &free, &state.scale);
    let a = Matrix::from_vec(n, free.len(), scaled);
    let Some(svd) = a.try_svd(true, false, f64::EPSILON, 10_000) else {
        return state.damping.max(1e-3) * 4.0;
    };
    let Some(u) = &svd.u else {
        return state.damping.max(1e-3) * 4.0;
    };
    let parts: Vec<(f64, f64)> = (svd.singular_values.iter().enumerate())
        .map(|(i, sigma)| (*sigma, dot(u.column(i).as_slice(), &state.projected)))
        .collect();
    let length = |mu: f64| {
        let shares: Vec<f64> = parts.iter().map(|(s, c)| s * c / (s * s + mu)).collect();
        norm(&shares)
    };
    // |D s(mu)| <= |S_F^T z| / mu
    let steepest: Vec<f64> = parts.iter().map(|(s, c)| s * c).collect();
    let (mut low, mut high): (f64, f64) = (0.0, (norm(&steepest) / radius).min(f64::MAX));
    let mut mu = high;
    for _ in 0..200 {
        mu = if low > 0.0 {
            low.sqrt() * high.sqrt()
        } else {
            high * 1e-3
        };
        let here = length(mu);
        if (here - radius).abs() <= 0.1 * radius || mu < 1e-300 {
            break;
        }
        if here > radius {
            low = mu;
        } else {
            high = mu;
        }
    }
    mu
}

impl State {
    /// `|Q_F^T r|^2`, twice what an undamped step would save if the residuals were linear.
    fn newton_reach_squared(&self) -> f64 {
        self.relative_offset * self.relative_offset * 2.0 * self.cost
    }
}

/// The tests that need no step. True if the search has ended.
fn search_ends(state: &mut State, options: &Options) -> bool {
    match convergence(state, options) {
        Some(reason) => {
            end_search(state, reason, options);
            true
        }
        None => false,
    }
}

fn convergence(state: &State, options: &Options) -> Option<StopReason> {
    if state.cost == 0.0 {
        return Some(StopReason::ConvergedByCost);
    }
    if state.relative_offset <= options.gradient_tolerance {
        return Some(StopReason::ConvergedByGradient);
    }
    let size = scaled_norm(&state.scale, &state.parameters);
    (state.newton_length <= options.step_tolerance * size).then_some(StopReason::ConvergedByStep)
}

/// From search to polish, or to the end.
fn end_search(state: &mut State, reason: StopReason, options: &Options) {
    state.search_reason = reason;
    // a full step that is long, or longer than the model is trusted, leads along what the residuals hardly
    // see
    let near = 1e-2 * scaled_norm(&state.scale, &state.parameters);
    let trusted = state.newton_length <= near.max(state.radius);
    if options.polish_limit > 0 && trusted && state.newton_length > 0.0 && state.cost > 0.0 {
        state.phase = Phase::Polish;
    } else {
        state.stop = Some(reason);
    }
}

fn polish_step<P: LeastSquares + ?Sized>(
    problem: &P,
    options: &Options,
    state: &mut State,
    workspace: &mut Workspace,
) {
    let trial: Vec<f64> = (0..state.parameters.len())
        .map(|j| {
            let [lower, upper] = bound(options, j);
            (state.parameters[j] + state.newton_step[j])
                .max(lower)
                .min(upper)
        })
        .collect();
    let mut better = false;
    // near the minimum the cost is flat: it may move by its own rounding
    if trial != state.parameters
        && let Some(cost) = evaluate_residuals(problem, &trial, state, workspace)
        && cost <= state.cost * (1.0 + 1e-9)
        && let Some(linear) = linearise(problem, &trial, state, workspace)
    {
        let mut next = state.clone();
        move_to(&mut next, trial, cost, linear, options);
        // keep the step if the one that would follow is shorter
        if next.newton_length < state.newton_length {
            next.polish_steps += 1;
            *state = next;
            better = true;
        }
    }
    let shortest = 0.25 * f64::EPSILON * scaled_norm(&state.scale, &state.parameters);
    if !better
        || state.polish_steps >= options.polish_limit
        || state.newton_length <= shortest
        || state.cost == 0.0
    {
        let reason = state.search_reason;
        state.stop = Some(if reason.converged() {
            reason
        } else {
            convergence(state, options).unwrap_or(reason)
        });
    }
}

/// `p + s` with s from  `minimise |S s + z|^2 + mu |D s|^2`  over the free parameters; those that would pass
/// a bound are put on it and the others solved again, at most n times.
fn damped_trial(state: &State, options: &Options) -> Vec<f64> {
    let n = state.parameters.len();
    let mut free = free_of(&state.resting);
    let mut target = state.parameters.clone();
    // rhs = z + S_A s_A
    let mut rhs = state.projected.clone();
    while !free.is_empty() {
        let step = damped_solution(state, &free, &rhs);
        for &j in &free {
            target[j] = state.parameters[j] + step[j];
        }
        let passing: Vec<usize> = (free.iter().copied())
            .filter(|&j| {
                let [lower, upper] = bound(options, j);
                target[j] < lower || target[j] > upper
            })
            .collect();
        if passing.is_empty() {
            break;
        }
        for &j in &passing {
            let [lower, upper] = bound(options, j);
            target[j] = target[j].max(lower).min(upper);
            let s = target[j] - state.parameters[j];
            for (value, column) in rhs.iter_mut().zip(&state.factor[j * n..(j + 1) * n]) {
                *value += column * s;
            }
        }
        free.retain(|j| !passing.contains(j));
    }
    target
}

/// s of  `minimise |S_F s_F + rhs|^2 + mu |D s_F|^2`, n values, 0 for those that are not free.
fn damped_solution(state: &State, free: &[usize], rhs: &[f64]) -> Vec<f64> {
    let (n, k) = (state.parameters.len(), free.len());
    if state.damping == 0.0 {
        let norms = column_norms(&state.factor, n);
        return gauss_newton(&state.factor, n, free, &norms, rhs).0;
    }
    let rows = n + k;
    // [S_F D^-1; sqrt(mu) I] u = -[rhs; 0],  s = D^-1 u
    let scaled = scaled_columns(&state.factor, n, free, &state.scale);
    let mut a = vec![0.0; rows * k];
    for c in 0..k {
        a[c * rows..c * rows + n].copy_from_slice(&scaled[c * n..(c + 1) * n]);
        a[c * rows + n + c] = state.damping.sqrt();
    }
    let mut b = rhs.to_vec();
    b.resize(rows, 0.0);
    let pivots = triangularise(&mut a, rows, k, &mut b, true);
    let solved = back_substitute(&a, rows, k, &b);
    let mut step = vec![0.0; n];
    for (c, value) in pivots.iter().zip(&solved) {
        let j = free[*c];
        step[j] = -value / divisor(state.scale[j]);
    }
    step
}

/// The undamped step over the `free` parameters (0 elsewhere) and the length of z within their plane.
/// Directions lost in rounding get no step.
fn gauss_newton(
    factor: &[f64],
    n: usize,
    free: &[usize],
    norms: &[f64],
    projected: &[f64],
) -> (Vec<f64>, f64) {
    let k = free.len();
    let mut a = scaled_columns(factor, n, free, norms);
    let mut b = projected.to_vec();
    let pivots = triangularise(&mut a, n, k, &mut b, true);
    let rank = rank_of(&a, n, k);
    let solved = back_substitute(&a, n, rank, &b);
    let mut step = vec![0.0; n];
    for (c, value) in pivots.iter().zip(&solved) {
        let j = free[*c];
        step[j] = -value / divisor(norms[j]);
    }
    (step, norm(&b[..rank]))
}

fn free_of(resting: &[Resting]) -> Vec<usize> {
    (0..resting.len())
        .filter(|&j| resting[j] == Resting::Free)
        .collect()
}

/// A column without length is left as it is.
fn divisor(norm: f64) -> f64 {
    if norm > 0.0 { norm } else { 1.0 }
}

fn column_norms(a: &[f64], rows: usize) -> Vec<f64> {
    a.chunks_exact(rows).map(norm).collect()
}

/// The chosen columns of an n-row matrix, each over its norm.
fn scaled_columns(a: &[f64], n: usize, chosen: &[usize], norms: &[f64]) -> Vec<f64> {
    (chosen.iter())
        .flat_map(|&j| {
            let by = divisor(norms[j]);
            a[j * n..(j + 1) * n].iter().map(move |v| v / by)
        })
        .collect()
}

/// `|D p|`.
fn scaled_norm(scale: &[f64], p: &[f64]) -> f64 {
    let product: Vec<f64> = scale.iter().zip(p).map(|(d, v)| d * v).collect();
    norm(&product)
}

/// `S s`, n values.
fn times(factor: &[f64], s: &[f64]) -> Vec<f64> {
    let n = s.len();
    let mut out = vec![0.0; n];
    for (j, value) in s.iter().enumerate() {
        for (o, column) in out.iter_mut().zip(&factor[j * n..(j + 1) * n]) {
            *o += column * value;
        }
    }
    out
}

/// Eight partial sums: faster, and its rounding grows with m / 8 rather than m.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = (a8.remainder().iter().zip(b8.remainder()))
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a8.zip(b8) {
        for l in 0..8 {
            lanes[l] += x[l] * y[l];
        }
    }
    let [l0, l1, l2, l3, l4, l5, l6, l7] = lanes;
    ((l0 + l4) + (l1 + l5)) + ((l2 + l6) + (l3 + l7)) + tail
}

/// The Euclidean length, without overflow or underflow in between.
fn norm(a: &[f64]) -> f64 {
    let sum = dot(a, a);
    if (1e-280..1e280).contains(&sum) {
        return sum.sqrt();
    }
    let largest = a.iter().fold(0.0, |l: f64, v| l.max(v.abs()));
    if largest == 0.0 || !largest.is_finite() {
        return largest;
    }
    let sum: f64 = a.iter().map(|v| (v / largest) * (v / largest)).sum();
    largest * sum.sqrt()
}

/// Householder reflections (Golub, Van Loan 5.2.1; with `pivot` 5.4.1): `a` (rows x cols, column after
/// column) becomes R above and on the diagonal, `b` (rows, or empty) becomes `Q^T b`. Returns which column
/// stands where.
fn triangularise(
    a: &mut [f64],
    rows: usize,
    cols: usize,
    b: &mut [f64],
    pivot: bool,
) -> Vec<usize> {
    let mut order: Vec<usize> = (0..cols).collect();
    for k in 0..cols.min(rows) {
        if pivot {
            let mut longest = k;
            let mut length = -1.0;
            for c in k..cols {
                let here = norm(&a[c * rows + k..(c + 1) * rows]);
                if here > length {
                    (longest, length) = (c, here);
                }
            }
            if longest != k {
                order.swap(k, longest);
                for i in 0..rows {
                    a.swap(k * rows + i, longest * rows + i);
                }
            }
        }
        let (head, rest) = a.split_at_mut((k + 1) * rows);
        let column = &mut head[k * rows + k..];
        let length = norm(column);
        if length == 0.0 {
            continue;
        }
        // (I - tau v v^T) x = beta e_1,  v_1 = 1
        let beta = -length.copysign(column[0]);
        let tau = (beta - column[0]) / beta;
        let by = column[0] - beta;
        column[0] = 1.0;
        for v in &mut column[1..] {
            *v /= by;
        }
        for other in rest.chunks_exact_mut(rows) {
            reflect(column, tau, &mut other[k..]);
        }
        if !b.is_empty() {
            reflect(column, tau, &mut b[k..]);
        }
        column[0] = beta;
        // what lies below the diagonal is v; nobody reads it
    }
    order
}

/// `x - tau v (v^T x)`.
fn reflect(v: &[f64], tau: f64, x: &mut [f64]) {
    let w = tau * dot(v, x);
    for (x, v) in x.iter_mut().zip(v) {
        *x -= w * v;
    }
}

/// Diagonal elements of a pivoted R that stand above rounding.
fn rank_of(r: &[f64], rows: usize, cols: usize) -> usize {
    let diagonal = |c: usize| r[c + c * rows].abs();
    let count = cols.min(rows);
    if count == 0 {
        return 0;
    }
    // what the reflections of J leave in an empty place is a few roundings of its first column
    let least = 10.0 * f64::EPSILON * cols as f64 * diagonal(0);
    (0..count).take_while(|&c| diagonal(c) > least).count()
}

/// x of `R x = b`, `size` values. A zero on the diagonal gets no share.
fn back_substitute(r: &[f64], rows: usize, size: usize, b: &[f64]) -> Vec<f64> {
    let mut x = b[..size].to_vec();
    for c in (0..size).rev() {
        let diagonal = r[c + c * rows];
        x[c] = if diagonal == 0.0 {
            0.0
        } else {
            x[c] / diagonal
        };
        for i in 0..c {
            x[i] -= r[i + c * rows] * x[c];
        }
    }
    x
}

/// How [`Differenced`] finds its derivatives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Differences {
    /// `(r(p + h) - r(p - h)) / 2 h`: two evaluations a parameter, about 10 digits.
    Central,
    /// Central differences of falling h, extrapolated to h = 0 (Ridders 1982): 16 evaluations a parameter,
    /// about 12 digits.
    Ridders,
}

/// A problem without derivatives, given those by differences. Near a bound the steps turn inwards.
pub struct Differenced<F> {
    /// n.
    pub parameter_count: usize,
    /// m.
    pub residual_count: usize,
    /// Writes m residuals at n parameters.
    pub residuals: F,
    /// Which differences.
    pub differences: Differences,
    /// The bounds of the options, or empty: outside them the residuals are not asked for.
    pub bounds: Vec<[f64; 2]>,
}

impl<E, F> LeastSquares for Differenced<F>
where
    E: fmt::Display,
    F: Fn(&[f64], &mut [f64]) -> Result<(), E>,
{
    type Error = E;

    fn parameter_count(&self) -> usize {
        self.parameter_count
    }

    fn residual_count(&self) -> usize {
        self.residual_count
    }

    fn residuals(&self, parameters: &[f64], out: &mut [f64]) -> Result<(), E> {
        (self.residuals)(parameters, out)
    }

    fn jacobian(&self, parameters: &[f64], out: &mut Matrix) -> Result<(), E> {
        let mut at = parameters.to_vec();
        for (j, p) in parameters.iter().enumerate() {
            let [lower, upper] =
                (self.bounds.get(j).copied()).unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
            let column = match self.differences {
                Differences::Central => {
                    // eps^(1/3): rounding and curvature weigh the same
                    let h = f64::EPSILON.cbrt() * size_of_parameter(*p);
                    self.difference(&mut at, j, h, lower, upper)?
                }
                Differences::Ridders => self.ridders(&mut at, j, lower, upper)?,
            };
            out.column_mut(j).copy_from_slice(&column);
        }
        Ok(())
    }
}

fn size_of_parameter(p: f64) -> f64 {
    if p == 0.0 { 1e-3 } else { p.abs() }
}

impl<E, F> Differenced<F>
where
    F: Fn(&[f64], &mut [f64]) -> Result<(), E>,
{
    /// The column by parameter j with step h: central, or from one side where a bound is nearer than h.
    fn difference(
        &self,
        at: &mut [f64],
        j: usize,
        h: f64,
        lower: f64,
        upper: f64,
    ) -> Result<Vec<f64>, E> {
        let p = at[j];
        let sample = |value: f64, at: &mut [f64]| -> Result<Vec<f64>, E> {
            let mut r = vec![0.0; self.residual_count];
            at[j] = value;
            let result = (self.residuals)(at, &mut r);
            at[j] = p;
            result.map(|()| r)
        };
        let h = h.min(0.5 * (upper - lower));
        if p - h >= lower && p + h <= upper {
            let (high, low) = (p + h, p - h);
            let (above, below) = (sample(high, at)?, sample(low, at)?);
            // (r(p + h) - r(p - h)) / 2 h
            return Ok((above.iter().zip(&below))
                .map(|(a, b)| (a - b) / (high - low))
                .collect());
        }
        let h = if upper - p >= p - lower {
            0.5 * h
        } else {
            -0.5 * h
        };
        if h == 0.0 {
            return Ok(vec![0.0; self.residual_count]);
        }
        let (r0, r1, r2) = (sample(p, at)?, sample(p + h, at)?, sample(p + 2.0 * h, at)?);
        // (-3 r(p) + 4 r(p + h) - r(p + 2 h)) / 2 h
        Ok((0..r0.len())
            .map(|i| (-3.0 * r0[i] + 4.0 * r1[i] - r2[i]) / (2.0 * h))
            .collect())
    }

    /// Ridders 1982: the tableau A(k, l) = (4^l A(k, l-1) - A(k-1, l-1)) / (4^l - 1), of which each residual
    /// takes the entry that differs least from its neighbours. One-sided differences have odd powers of h
    /// too: there the factor is 2^(l+1).
    fn ridders(&self, at: &mut [f64], j: usize, lower: f64, upper: f64) -> Result<Vec<f64>, E> {
        const ROWS: usize = 8;
        let p = at[j];
        let first = 0.02 * size_of_parameter(p);
        let room = (p - lower).min(upper - p);
        let central = room >= first;
        let mut best = vec![0.0; self.residual_count];
        let mut error = vec![f64::INFINITY; self.residual_count];
        let mut above: Vec<Vec<f64>> = Vec::new();
        for k in 0..ROWS {
            let h = first * 0.5_f64.powi(k as i32);
            let mut row = vec![self.one_kind(at, j, h, lower, upper, central)?];
            for l in 1..=k {
                let factor = 2.0_f64.powi(if central { 2 * l as i32 } else { l as i32 + 1 });
                let next: Vec<f64> = (0..self.residual_count)
                    .map(|i| (factor * row[l - 1][i] - above[l - 1][i]) / (factor - 1.0))
                    .collect();
                for i in 0..self.residual_count {
                    let differs = (next[i] - row[l - 1][i])
                        .abs()
                        .max((next[i] - above[l - 1][i]).abs());
                    if differs <= error[i] {
                        (error[i], best[i]) = (differs, next[i]);
                    }
                }
                row.push(next);
            }
            above = row;
        }
        Ok(best)
    }

    fn one_kind(
        &self,
        at: &mut [f64],
        j: usize,
        h: f64,
        lower: f64,
        upper: f64,
        central: bool,
    ) -> Result<Vec<f64>, E> {
        if central {
            return self.difference(at, j, h, f64::NEG_INFINITY, f64::INFINITY);
        }
        // all of one side: pretend that the bound is here
        let p = at[j];
        if upper - p >= p - lower {
            self.difference(at, j, h.min(upper - p), p, upper)
        } else {
            self.difference(at, j, h.min(p - lower), lower, p)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `[[1, 4], [2, 5], [3, 6], [4, 9]]`, column after column.
    const TALL: [f64; 8] = [1.0, 2.0, 3.0, 4.0, 4.0, 5.0, 6.0, 9.0];

    #[test]
    fn reflections_keep_the_gram_matrix_and_solve() {
        for pivot in [false, true] {
            let mut a = TALL;
            // b = A (2, -1), so that the solution is known
            let mut b = [-2.0, -1.0, 0.0, -1.0];
            let order = triangularise(&mut a, 4, 2, &mut b, pivot);
            assert_eq!(order, if pivot { [1, 0] } else { [0, 1] });
            // R^T R = A^T A
            assert!((a[0] * a[0] - if pivot { 158.0 } else { 30.0 }).abs() < 1e-12);
            assert!((a[0] * a[4] - 68.0).abs() < 1e-12);
            let x = back_substitute(&a, 4, 2, &b);
            assert!((x[order[0]] - 2.0).abs() < 1e-14);
            assert!((x[order[1]] + 1.0).abs() < 1e-14);
            assert!(norm(&b[2..]) < 1e-14);
        }
    }

    #[test]
    fn lengths_survive_the_ends_of_the_range() {
        assert!((norm(&[3e200, 4e200]) / 5e200 - 1.0).abs() < 1e-15);
        assert!((norm(&[3e-200, 4e-200]) / 5e-200 - 1.0).abs() < 1e-15);
        assert_eq!(norm(&[0.0, -0.0]), 0.0);
        assert_eq!(norm(&[]), 0.0);
        let many: Vec<f64> = (0..37).map(|i| i as f64).collect();
        assert_eq!(dot(&many, &many), 16206.0);
    }

    /// Differences against the derivative by hand, inside the bounds and on them, where one side is closed.
    #[test]
    fn differences_agree_with_the_derivative_and_stay_within_bounds() {
        for (differences, inside, on_bound) in [
            (Differences::Central, 1e-9, 1e-8),
            (Differences::Ridders, 1e-12, 1e-9),
        ] {
            let problem = Differenced {
                parameter_count: 2,
                residual_count: 2,
                residuals: |p: &[f64], out: &mut [f64]| {
                    if !(0.5..=2.0).contains(&p[0]) {
                        return Err(format!("{} is outside", p[0]));
                    }
                    out[0] = p[0].exp() * p[1].sin();
                    out[1] = p[0].ln();
                    Ok(())
                },
                differences,
                bounds: vec![[0.5, 2.0], [f64::NEG_INFINITY, f64::INFINITY]],
            };
            for (x, tolerance) in [(1.3, inside), (0.5, on_bound), (2.0, on_bound)] {
                for y in [0.7, 0.0, -4.0] {
                    let mut j = Matrix::zeros(2, 2);
                    problem.jacobian(&[x, y], &mut j).unwrap();
                    let exact = [[x.exp() * y.sin(), x.exp() * y.cos()], [1.0 / x, 0.0]];
                    for (row, values) in exact.iter().enumerate() {
                        for (column, value) in values.iter().enumerate() {
                            let error = (j[(row, column)] - value).abs();
                            assert!(
                                error <= tolerance * x.exp(),
                                "{differences:?} ({row}, {column}) at {x}, {y}: off by {error}"
                            );
                        }
                    }
                }
            }
        }
    }
}
