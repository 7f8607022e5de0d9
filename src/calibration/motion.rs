//! An axis fitted by its motion (output error): the parameters whose forward model comes closest to what was
//! measured, and which causes of the catalogue that takes.
//!
//! The balance of an axis needs an acceleration, and noise in the motion then stands among the regressors: it
//! shortens mass and damping (errors in variables). The motion that the model makes of the input has no
//! noise in it, so this fit stays straight where the other bends; the price is that it has to be searched
//! for. It begins at the balance's answer, in pieces that begin anew (16, then 4, then one a recording), and
//! every step has exact derivatives ([`crate::residual::motion`]).
//!
//! # Intervals
//! What is left follows itself: noise of the plant is coloured by it, and so is what the model lacks. With X
//! the derivatives, the covariance is the sandwich (X'X)^-1 X'RX (X'X)^-1 (Huber 1967), R that of an
//! autoregression through what is left, its order by BIC (Schwarz 1978): R = s^2 L L', L the filter that
//! makes the residual of white innovations, so that X'RX = s^2 |L'X|^2.
//!
//! Where two ways of the input between its samples leave nearly the same, the intervals count that it may be
//! the other (Bayesian model averaging: Hoeting et al. 1999): with likelihoods p of the ways and d from the
//! model that was taken to each, p dd' joins the covariance.
//!
//! # Which causes
//! All of it on the recordings given. A cause is foretold by what it would change of the motion ([`near`] its
//! off value, all that the others can absorb projected out), which also tells its size to first order and
//! drops those that would need a sign that they cannot have. Those that promise most (three at most, none
//! below half of the best) are fitted from there; and the best is taken if it lowers the error on blocks that
//! were left out: of 24 blocks each is foretold by a fit to the others (to first order, which is exact for
//! what is linear), and the fall has to be beyond three of its standard errors and half a percent. So on,
//! until none is. That is done in 16 pieces a recording, on 10,000 samples at most; what was chosen is then
//! fitted to all.
//!
//! [`near`]: crate::effects::line::LineEffect::near

use std::ops::ControlFlow;

use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector, DVectorView, Dyn};
use rayon::prelude::*;

use super::line::{
    AxisCause, Forward, LineFit, LineModel, LineOutcome, LineRequest, Plainly, hold, judge,
    plainly, say,
};
use super::{Error, Estimate};
use crate::dataset::line::{Line, Measured};
use crate::effects::Acting;
use crate::effects::line::{Kind, LineEffect, by_id, every, runs_forward};
use crate::fit::separable::{Options, State, Unknown, minimise};
use crate::recording::nearest;
use crate::residual::OFFSET_REACH_S;
use crate::residual::line::LineResidual;
use crate::residual::motion::{Between, MotionResidual};

/// Which causes are fitted.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Causes {
    /// None: the plain model.
    #[default]
    None,
    /// These, by their ids.
    These(Vec<String>),
    /// Those that the recordings call for, but none of these.
    Choose {
        /// Not thought of.
        without: Vec<String>,
    },
}

/// What a fit of the motion is asked to do.
#[derive(Debug, Clone, Default)]
pub struct MotionRequest {
    /// Held parameters and bounds.
    pub line: LineRequest,
    /// Causes.
    pub causes: Causes,
    /// What the input does between samples; none: what leaves least.
    pub between: Option<Between>,
}

/// A step of the choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Tried {
    /// The cause.
    pub id: &'static str,
    /// Root mean square error on blocks that were left out, without and with it, in the unit of the outcome.
    pub left_out: [f64; 2],
    /// The mean fall of its square over its standard error.
    pub surety: f64,
    /// Whether it was taken.
    pub taken: bool,
}

/// Everything that a fit of the motion found.
#[derive(Debug, Clone)]
pub struct AxisMotion {
    /// As of any fit of an axis; errors are those of the motion.
    pub outcome: LineOutcome,
    /// What the input does between samples.
    pub between: Between,
    /// Root mean square of what each of them left, where they were compared.
    pub compared: Vec<(Between, f64)>,
    /// How causes were chosen.
    pub tried: Vec<Tried>,
    /// Steps of the integration a sample.
    pub steps: usize,
}

/// Key under which a parameter file holds what the input does between samples: its place in
/// [`Between::ALL`].
pub const BETWEEN: &str = "input_between";

/// Pieces of a recording, and samples over all recordings at most: where a search begins and causes are
/// chosen, and on the way from there to all.
const PARTS: [(usize, usize); 2] = [(16, 10_000), (4, 20_000)];
/// One piece, all samples.
const WHOLE: (usize, usize) = (1, usize::MAX);
/// How far unknowns may go in one search, in their own units.
const REACH: f64 = 6.0;
/// The same of values of causes, in their spreads.
const FAR: f64 = 20.0;
/// Change by half the step, over what is left, up to which steps are short enough while causes are chosen,
/// and at the end times the root of the rows.
const COARSE: f64 = 0.02;
const FINE: f64 = 0.3;
/// Steps a sample at most.
const MOST_STEPS: usize = 128;
/// Turns of the last correction.
const POLISH: usize = 3;
/// Causes that are fitted in each round, share of the best promise below which none is, and rounds.
const FITTED: usize = 3;
const PROMISING: f64 = 0.5;
const ROUNDS: usize = 6;
/// Blocks that are left out, over all recordings.
const BLOCKS: usize = 24;
/// Standard errors, and share of the square, by which a cause has to lower the error on what was left out.
const SURE: f64 = 3.0;
const WORTH: f64 = 0.005;
/// Orders of the autoregression through what is left.
const MOST_ORDER: usize = 60;
/// First samples of a recording that may tell where it begins when a model is held against it.
pub const BEGINNING: usize = 50;

/// A model of the motion at its best, so far.
#[derive(Clone)]
struct Best<'a> {
    residual: MotionResidual<'a>,
    unknowns: Vec<f64>,
    design: DMatrix<f64>,
    evaluations: usize,
    converged: bool,
    reason: &'static str,
}

impl Best<'_> {
    fn mean_square(&self) -> f64 {
        let r = self.design.column(self.design.ncols() - 1);
        r.norm_squared() / r.len() as f64
    }
}

/// What is known of the search beside the residual.
struct Search<'a> {
    inverse: LineResidual<'a>,
    linear: Vec<Unknown>,
    names: Vec<String>,
    /// Least unit of each linear unknown.
    least: Vec<f64>,
}

impl<'a> Search<'a> {
    fn residual(
        &self,
        (effects, free): (Vec<Acting>, Vec<(usize, usize)>),
        between: Between,
        steps: usize,
        pieces: (usize, usize),
        beta: &[f64],
    ) -> Result<MotionResidual<'a>, Error> {
        let series = self.inverse.series();
        let inverse = self.inverse.with_effects(effects, free, &series);
        let unit = beta.iter().zip(&self.least).map(|(b, l)| b.abs().max(*l));
        Ok(MotionResidual::new(
            inverse,
            between,
            steps,
            pieces,
            unit.collect(),
        )?)
    }

    /// Unknowns of a search that begins at `start`.
    fn unknowns(&self, residual: &MotionResidual, start: &[f64]) -> Vec<Unknown> {
        let inverse = residual.inverse();
        let linear = inverse.linear();
        let (beta, _) = residual.model(start);
        (0..start.len())
            .map(|i| {
                let at = start[i];
                if i < linear {
                    let u = &self.linear[i];
                    if u.is_fixed() {
                        return Unknown::fixed(at);
                    }
                    let unit = if at == 0.0 {
                        self.least[i]
                    } else {
                        beta[i] / at
                    };
                    let low = u.lower / unit;
                    // what holds the motion back never vanishes altogether
                    let low = if self.names[i] == "mass" {
                        low.max(1e-6)
                    } else {
                        low
                    };
                    return Unknown::free(
                        at.clamp(low, (u.upper / unit).max(low)),
                        (at - REACH).max(low),
                        (at + REACH).min(u.upper / unit),
                    );
                }
                if i < residual.shared() {
                    let place = i - linear;
                    if place < inverse.free_offsets().len() {
                        return Unknown::free(at, -OFFSET_REACH_S, OFFSET_REACH_S);
                    }
                    let [low, high] = inverse.bounds(place);
                    return Unknown::free(at, (at - FAR).max(low), (at + FAR).min(high));
                }
                Unknown::free(at, at - 0.5 * REACH, at + 0.5 * REACH)
            })
            .collect()
    }

    /// The best point from `start` on. Where an unknown went as far as it may, once more from there.
    fn go(
        &self,
        mut residual: MotionResidual<'a>,
        start: &[f64],
        (searches, options): (usize, &Options),
    ) -> Result<Best<'a>, Error> {
        let mut at = start.to_vec();
        let mut evaluations = 0;
        let mut last = None;
        for _ in 0..searches {
            let unknowns = self.unknowns(&residual, &at);
            let state = minimise(&residual, &unknowns, &[], &at, options, |_: &State| {
                ControlFlow::Continue(())
            });
            evaluations += state.evaluations;
            at.clone_from(&state.eta);
            let stuck = at.iter().zip(&unknowns).enumerate().any(|(i, (x, u))| {
                let far = (x - u.lower).abs() < 1e-6 || (x - u.upper).abs() < 1e-6;
                far && !u.is_fixed() && !self.at_true_bound(&residual, i, *x)
            });
            last = Some(state);
            if !stuck {
                break;
            }
            let (beta, eta) = residual.model(&at);
            let states = at[residual.shared()..].to_vec();
            residual = residual.with_unit(
                beta.iter()
                    .zip(&self.least)
                    .map(|(b, l)| b.abs().max(*l))
                    .collect(),
            );
            at = residual.at(&beta, &eta);
            at.truncate(residual.shared());
            at.extend(states);
        }
        let state = last.ok_or_else(|| Error::NothingToFit("no search".into()))?;
        if !state.cost.is_finite() {
            return Err(Error::AllStartsFailed {
                tried: 1,
                last: state.failure.unwrap_or_default(),
            });
        }
        let design = residual.design(&at)?;
        Ok(Best {
            residual,
            unknowns: at,
            design,
            evaluations,
            converged: state
                .ended
                .is_some_and(crate::fit::separable::Ended::converged),
            reason: state.ended.map_or("", |e| e.words()),
        })
    }

    fn at_true_bound(&self, residual: &MotionResidual, i: usize, x: f64) -> bool {
        let inverse = residual.inverse();
        let linear = inverse.linear();
        if i < linear {
            let physical = self.linear[i].lower == 0.0;
            return physical && x < 1e-5;
        }
        if i >= residual.shared() {
            return false;
        }
        let place = i - linear;
        if place < inverse.free_offsets().len() {
            return true;
        }
        inverse.bounds(place).iter().any(|b| (b - x).abs() < 1e-6)
    }

    /// From the balance's answer, in pieces; of long recordings in some of them.
    fn begun(&self, between: Between, beta: &[f64], eta: &[f64]) -> Result<Best<'a>, Error> {
        let mut beta = beta.to_vec();
        // a start that hardly lives is no start
        for ((b, l), name) in beta.iter_mut().zip(&self.least).zip(&self.names) {
            if name == "mass" || name == "damping" {
                *b = b.max(*l);
            }
        }
        let none = (Vec::new(), Vec::new());
        let residual = self.residual(none, between, 1, PARTS[0], &beta)?;
        let at = residual.at(&beta, eta);
        self.go(settled(&residual, &at, COARSE)?, &at, (WELL.0, ROUGHLY.1))
    }

    /// The plain model by each way of the input between its samples, or by the one that is asked for; an
    /// error where none goes anywhere.
    fn ways(&self, asked: Option<Between>, state: &State) -> Result<Vec<Best<'a>>, Error> {
        let ways: Vec<Between> = asked.map_or(Between::ALL.to_vec(), |b| vec![b]);
        let found: Vec<Result<Best, Error>> = ways
            .par_iter()
            .map(|&w| self.begun(w, &state.beta, &state.eta))
            .collect();
        let mut out = Vec::new();
        let mut trouble = None;
        for one in found {
            match one {
                Ok(b) => out.push(b),
                Err(e) => trouble = Some(e),
            }
        }
        match out.is_empty() {
            true => Err(trouble.unwrap_or_else(|| Error::NothingToFit("no search".into()))),
            false => Ok(out),
        }
    }

    /// The model `from` with the cause of an id.
    fn with_named(
        &self,
        from: &Best<'a>,
        id: &str,
        evaluations: &mut usize,
    ) -> Result<Best<'a>, Error> {
        let cause = named(id)?;
        // from every place where a scan would look: a wrong shape has minima of its own
        let fits: Vec<Best> = promises(self, from, &starts(from, cause))
            .par_iter()
            .filter_map(|p| self.with(from, p, ROUGHLY).ok())
            .collect();
        *evaluations += fits.iter().map(|b| b.evaluations).sum::<usize>();
        fits.into_iter().min_by(by_mean_square).ok_or_else(|| {
            Error::NothingToFit(format!("the cause `{id}` changes nothing of this motion"))
        })
    }

    /// A model again: in so many pieces, of samples at most, with another input between samples. States begin
    /// where they were measured.
    fn again(
        &self,
        from: &Best<'a>,
        between: Between,
        pieces: (usize, usize),
        effort: (usize, &Options),
    ) -> Result<Best<'a>, Error> {
        let inverse = from.residual.inverse();
        let (beta, eta) = from.residual.model(&from.unknowns);
        let causes = (inverse.effects(&eta), inverse.free().to_vec());
        let steps = from.residual.steps();
        let residual = self.residual(causes, between, steps, pieces, &beta)?;
        let at = residual.at(&beta, &eta);
        self.go(settled(&residual, &at, COARSE)?, &at, effort)
    }

    /// The best point with shorter steps: they hardly change the derivatives, so that these serve again, and
    /// only the residual is worked out anew.
    fn polished(&self, mut best: Best<'a>, fine: MotionResidual<'a>) -> Result<Best<'a>, Error> {
        let width = best.design.ncols() - 1;
        let free = free(
            &best.unknowns,
            &self.unknowns(&best.residual, &best.unknowns),
        );
        let (x, scale, gram) = scaled(&best, &free);
        let factor = gram.cholesky();
        for turn in 0..POLISH {
            let r = DVector::from_vec(fine.residual(&best.unknowns)?);
            if let Some(factor) = factor.as_ref().filter(|_| turn + 1 < POLISH) {
                let step = factor.solve(&x.tr_mul(&r));
                for (k, &i) in free.iter().enumerate() {
                    best.unknowns[i] -= scale[k] * step[k];
                }
            }
            best.design.set_column(width, &r);
        }
        best.residual = fine;
        Ok(best)
    }

    /// The model `from` with one more cause, that begins at `values`.
    fn joined(
        &self,
        from: &Best<'a>,
        cause: &'static dyn LineEffect,
        values: &[f64],
    ) -> Result<(MotionResidual<'a>, Vec<f64>), Error> {
        let inverse = from.residual.inverse();
        let (beta, eta) = from.residual.model(&from.unknowns);
        let (mut effects, mut free) = (inverse.effects(&eta), inverse.free().to_vec());
        let number = effects.len();
        let acting = Acting {
            effect: cause,
            values: values.to_vec(),
            on: [true; 3],
        };
        let own_free = acting.free_values();
        effects.push(acting);
        free.extend(own_free.iter().map(|&v| (number, v)));
        let inverse = inverse.with_effects(effects, free, &inverse.series());
        let residual = from.residual.with_inverse(inverse)?;
        let quantities = cause.parameters();
        let own = own_free.iter().map(|&v| values[v] / quantities[v].spread);
        let eta: Vec<f64> = eta.into_iter().chain(own).collect();
        let states = from.unknowns[from.residual.shared()..].to_vec();
        let mut at = residual.at(&beta, &eta);
        at.truncate(residual.shared());
        at.extend(states);
        Ok((residual, at))
    }

    /// The best model with one more cause, from the better of the places where it may begin.
    fn with(
        &self,
        from: &Best<'a>,
        promise: &Promise,
        effort: (usize, &Options),
    ) -> Result<Best<'a>, Error> {
        let square = |values: &Vec<f64>| -> Option<f64> {
            let (residual, at) = self.joined(from, promise.cause, values).ok()?;
            let made = residual.residual(&at).ok()?;
            Some(made.iter().map(|r| r * r).sum())
        };
        let [large, near] = promise
            .values
            .each_ref()
            .map(|v| square(v).unwrap_or(f64::INFINITY));
        let values = &promise.values[usize::from(near < large)];
        let (residual, at) = self.joined(from, promise.cause, values)?;
        self.go(residual, &at, effort)
    }
}

/// A search that is taken to its end, begun again where an unknown went as far as it may: a standard error of
/// one of 1000 samples is a thousandth of the cost.
const WELL: (usize, &Options) = (
    4,
    &Options {
        evaluations: 60,
        cost_tolerance: 1e-7,
        step_tolerance: 1e-9,
    },
);
/// One that another will follow: half a percent of the cost, which makes a cause worth taking, shows five
/// hundred times over.
const ROUGHLY: (usize, &Options) = (
    1,
    &Options {
        evaluations: 15,
        cost_tolerance: 1e-5,
        step_tolerance: 1e-6,
    },
);

/// The residual with steps so short that they are off by no more than `share` of what is left.
fn settled<'a>(
    residual: &MotionResidual<'a>,
    at: &[f64],
    share: f64,
) -> Result<MotionResidual<'a>, Error> {
    let mut own = residual.clone();
    let mut coarse = own.residual(at);
    let mut before = None;
    while own.steps() < MOST_STEPS {
        let finer = own.with_steps(2 * own.steps());
        let fine = finer.residual(at);
        if let (Ok(coarse), Ok(fine)) = (&coarse, &fine) {
            let change: f64 = coarse.iter().zip(fine).map(|(a, b)| (a - b).powi(2)).sum();
            let left: f64 = fine.iter().map(|r| r * r).sum();
            let enough = share * left.max(fine.len() as f64).sqrt();
            let [here, half] = off(change.sqrt(), before);
            if here < enough {
                return Ok(own);
            }
            if half < enough {
                return Ok(finer);
            }
            before = Some(change.sqrt());
        }
        (own, coarse) = (finer, fine);
    }
    coarse?;
    Ok(own)
}

/// How far off a course is at some steps, and at half of them, from the change between the two and the one
/// before it: changes go on to fall by the same ratio, by half at worst (a motion with kinks).
fn off(change: f64, before: Option<f64>) -> [f64; 2] {
    let ratio = before.map_or(0.5, |b| (change / b).min(0.5));
    [change / (1.0 - ratio), change * ratio / (1.0 - ratio)]
}

/// Mean squares of blocks that were left out, each foretold by a fit to the others, to first order. Initial
/// states stay where they are.
fn left_out(best: &Best) -> Vec<f64> {
    let shared = best.residual.shared();
    let x = best.design.columns(0, shared);
    let r = best.design.column(best.design.ncols() - 1);
    let gram = x.tr_mul(&x);
    let scale: Vec<f64> = (0..shared)
        .map(|i| 1.0 / gram[(i, i)].sqrt().max(f64::MIN_POSITIVE))
        .collect();
    let mut edges = vec![0];
    let all = r.len();
    for rows in best.residual.rows_of_recordings() {
        let count = (BLOCKS * rows).div_ceil(all).clamp(2, BLOCKS);
        let first = edges[edges.len() - 1];
        edges.extend((1..=count).map(|i| first + i * rows / count));
    }
    edges.dedup();
    edges
        .par_windows(2)
        .map(|e| {
            let (from, n) = (e[0], e[1] - e[0]);
            let (xb, rb) = (x.rows(from, n), r.rows(from, n));
            let own = xb.tr_mul(&xb);
            let others = DMatrix::from_fn(shared, shared, |i, j| {
                let ridge = if i == j { 1e-10 } else { 0.0 };
                scale[i] * scale[j] * (gram[(i, j)] - own[(i, j)]) + ridge
            });
            let pull = xb.tr_mul(&rb);
            let pull = DVector::from_fn(shared, |i, _| scale[i] * pull[i]);
            let moved = match others.cholesky() {
                Some(c) => {
                    let d = c.solve(&pull);
                    rb + xb * DVector::from_fn(shared, |i, _| scale[i] * d[i])
                }
                None => rb.into_owned(),
            };
            moved.norm_squared() / n as f64
        })
        .collect()
}

/// What the unknowns of a model can absorb of a change of its motion.
struct Absorbed<'b> {
    x: DMatrixView<'b, f64>,
    r: DVectorView<'b, f64>,
    scale: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
}

impl<'b> Absorbed<'b> {
    fn of(best: &'b Best) -> Option<Self> {
        let width = best.design.ncols() - 1;
        let x = best.design.columns(0, width);
        let gram = x.tr_mul(&x);
        let scale = DVector::from_fn(width, |i, _| {
            1.0 / gram[(i, i)].sqrt().max(f64::MIN_POSITIVE)
        });
        let scaled = DMatrix::from_fn(width, width, |i, j| {
            gram[(i, j)] * scale[i] * scale[j] + if i == j { 1e-11 } else { 0.0 }
        });
        Some(Absorbed {
            x,
            r: best.design.column(width),
            scale,
            factor: scaled.cholesky()?,
        })
    }

    /// How much of the sum of squares columns take away beside the unknowns, and how much of each does.
    fn promised(&self, columns: &[Vec<f64>]) -> Option<(f64, DVector<f64>)> {
        let out = |c: &Vec<f64>| -> DVector<f64> {
            let v = DVector::from_column_slice(c);
            let pull = self.x.tr_mul(&v).component_mul(&self.scale);
            &v - self.x * self.factor.solve(&pull).component_mul(&self.scale)
        };
        let f: Vec<DVector<f64>> = columns.iter().map(out).collect();
        let f = DMatrix::from_columns(&f);
        let mut own = f.tr_mul(&f);
        for i in 0..own.nrows() {
            own[(i, i)] *= 1.0 + 1e-9;
            own[(i, i)] += f64::MIN_POSITIVE;
        }
        let pull = f.tr_mul(&self.r);
        let sizes = own.cholesky()?.solve(&pull);
        Some((pull.dot(&sizes), -sizes))
    }
}

/// Fits axes by their motion.
///
/// # Errors
/// [`Error`] as [`super::calibrate_lines`], and where the motion cannot be run forward.
pub fn calibrate_motion(lines: &[Line], request: &MotionRequest) -> Result<AxisMotion, Error> {
    let mut lines = lines.to_vec();
    hold(&mut lines, &request.line.fix)?;
    let refs: Vec<&Line> = lines.iter().collect();
    let Plainly {
        residual: inverse,
        state,
        linear,
        names,
    } = plainly(&refs, &request.line)?;
    let search = Search {
        least: least(&inverse, &names),
        inverse,
        linear,
        names,
    };
    let mut ways = search.ways(request.between, &state)?;
    let mut evaluations: usize = ways.iter().map(|b| b.evaluations).sum();
    let mut compared = compared(&ways);
    // causes join in pieces, and on a part of what is long: a strong one would run away at first
    ways.sort_by(by_mean_square);
    let mut best = ways[0].clone();
    let mut tried = Vec::new();
    match &request.causes {
        Causes::None => {}
        Causes::These(ids) => {
            for id in ids {
                best = search.with_named(&best, id, &mut evaluations)?;
            }
        }
        Causes::Choose { without } => {
            let known = without.iter().map(|id| named(id).map(|e| e.id()));
            let without: Vec<&str> = known.collect::<Result<_, _>>()?;
            let unit = unit_of_rows(&refs);
            for _ in 0..ROUNDS {
                let spent = &mut evaluations;
                match choose(&search, &best, &without, unit, &mut tried, spent)? {
                    Some(next) => best = next,
                    None => break,
                }
            }
        }
    }
    // the causes may have told what the input does between samples
    if request.between.is_none() && !best.residual.inverse().acting().is_empty() {
        ways = Between::ALL
            .into_par_iter()
            .filter_map(|w| search.again(&best, w, PARTS[0], ROUGHLY).ok())
            .collect();
        evaluations += ways.iter().map(|b| b.evaluations).sum::<usize>();
        compared = self::compared(&ways);
        if let Some(least) = ways.iter().min_by(|a, b| by_mean_square(a, b)) {
            best = least.clone();
        }
    }
    let others = others(&best, &ways);
    for (cut, effort) in [(PARTS[1], ROUGHLY), (WHOLE, WELL)] {
        best = search.again(&best, best.residual.between(), cut, effort)?;
        evaluations += best.evaluations;
    }
    // steps so short that they do not show in the values
    let rows = best.design.nrows() as f64;
    let fine = settled(&best.residual, &best.unknowns, FINE / rows.sqrt())?;
    if fine.steps() > best.residual.steps() {
        best = search.polished(best, fine)?;
    }
    best.evaluations = evaluations;
    let choice = Choice {
        tried,
        compared,
        others,
    };
    outcome(&search, &best, &refs, choice)
}

fn by_mean_square(a: &Best, b: &Best) -> std::cmp::Ordering {
    a.mean_square().total_cmp(&b.mean_square())
}

/// What ways of the input leave.
fn compared(ways: &[Best]) -> Vec<(Between, f64)> {
    let of = |b: &Best| (b.residual.between(), b.mean_square());
    ways.iter().map(of).collect()
}

/// How causes and the way of the input were chosen.
struct Choice {
    tried: Vec<Tried>,
    /// What each way of the input left.
    compared: Vec<(Between, f64)>,
    /// As [`others`] has them.
    others: Vec<(Between, f64, DVector<f64>)>,
}

/// How likely other ways of the input are beside the one that was taken, and how far away in beta and eta
/// they put the model.
fn others(best: &Best, ways: &[Best]) -> Vec<(Between, f64, DVector<f64>)> {
    let point = |b: &Best| {
        let (beta, eta) = b.residual.model(&b.unknowns);
        DVector::from_iterator(beta.len() + eta.len(), beta.into_iter().chain(eta))
    };
    let here = point(best);
    let likely = |b: &Best| {
        let rows = b.design.nrows() as f64;
        (b.mean_square() / best.mean_square()).powf(-0.5 * rows)
    };
    let sum: f64 = ways.iter().map(likely).sum();
    let way = |b: &Best| b.residual.between();
    ways.iter()
        .filter(|b| way(b) != way(best))
        .map(|b| (way(b), likely(b) / sum, point(b) - &here))
        .collect()
}

/// The cause of an id that can be run forward on an axis.
fn named(id: &str) -> Result<&'static dyn LineEffect, Error> {
    by_id(id).filter(|e| forward(*e)).ok_or_else(|| {
        let known: Vec<String> = every()
            .filter(|e| forward(*e))
            .map(|e| e.id().into())
            .collect();
        Error::UnknownParameter {
            name: id.into(),
            nearest: nearest(id, &known).map(Into::into),
            known: known.join(", "),
        }
    })
}

fn forward(effect: &dyn LineEffect) -> bool {
    effect.kinds().contains(&Kind::Axis) && runs_forward(effect)
}

/// Mean square of the noise over the rows: what a whitened square is multiplied by to be one in the unit.
fn unit_of_rows(lines: &[&Line]) -> f64 {
    let (mut sum, mut rows) = (0.0, 0.0);
    for l in lines {
        let n = l.usable.iter().filter(|u| **u).count() as f64;
        sum += n * l.x_noise.powi(2);
        rows += n;
    }
    sum / f64::max(rows, 1.0)
}

/// Least units of the linear unknowns: what would be a fiftieth of the largest force.
fn least(inverse: &LineResidual, names: &[String]) -> Vec<f64> {
    let s = inverse.scales();
    let speed = (0..inverse.lines().count())
        .flat_map(|n| inverse.course(n).2.iter())
        .fold(0.0_f64, |m, r| m.max(r.abs()))
        .max(f64::MIN_POSITIVE);
    let force = 0.02 * s.force;
    names
        .iter()
        .map(|name| match name.as_str() {
            "mass" => force / (s.coordinate * speed * speed),
            "damping" => force / (s.coordinate * speed),
            "stiffness" => force / s.coordinate,
            "bias" => force,
            _ => 1e-9,
        })
        .collect()
}

/// Where a cause is looked for: groups of values near off.
fn starts(
    best: &Best,
    cause: &'static dyn LineEffect,
) -> Vec<(&'static dyn LineEffect, Vec<Vec<f64>>)> {
    let inverse = best.residual.inverse();
    let n = inverse.course(0).0.len();
    let elastic = vec![0.0; n];
    let view = inverse.view(0, &elastic);
    cause.near(&view).into_iter().map(|g| (cause, g)).collect()
}

/// A start of a cause.
struct Promise {
    cause: &'static dyn LineEffect,
    /// What it promises to take off the sum of squares; nothing where its size would need another sign.
    fall: f64,
    /// Where its fit may begin: as large as it promises to be, and near off.
    values: [Vec<f64>; 2],
}

/// What starts promise, most first.
fn promises<'a>(
    search: &Search<'a>,
    best: &Best<'a>,
    starts: &[(&'static dyn LineEffect, Vec<Vec<f64>>)],
) -> Vec<Promise> {
    let last = best.design.ncols() - 1;
    let now: Vec<f64> = best.design.column(last).iter().copied().collect();
    let Some(absorbed) = Absorbed::of(best) else {
        return Vec::new();
    };
    let promise = |(cause, group): &(&'static dyn LineEffect, Vec<Vec<f64>>)| {
        let column = |values: &Vec<f64>| -> Option<Vec<f64>> {
            let (residual, at) = search.joined(best, *cause, values).ok()?;
            let with = residual.residual(&at).ok()?;
            Some(with.iter().zip(&now).map(|(a, b)| a - b).collect())
        };
        let columns = group.iter().map(column).collect::<Option<Vec<_>>>()?;
        let (fall, sizes) = absorbed.promised(&columns)?;
        let near = beginning(*cause, group);
        let sized = sized(*cause, group, sizes.as_slice());
        Some(Promise {
            cause: *cause,
            fall: if sized.is_some() { fall } else { 0.0 },
            values: [sized.unwrap_or_else(|| near.clone()), near],
        })
    };
    let mut found: Vec<Promise> = starts.par_iter().filter_map(promise).collect();
    found.sort_by(|a, b| b.fall.total_cmp(&a.fall));
    found
}

/// The values of a group, each size so many times as large; none where that is off or beyond it.
fn sized(cause: &dyn LineEffect, group: &[Vec<f64>], times: &[f64]) -> Option<Vec<f64>> {
    let mut out = beginning(cause, group);
    let mut moved = false;
    for (i, q) in cause.parameters().iter().enumerate() {
        let away: f64 = group
            .iter()
            .zip(times)
            .map(|(v, t)| t * (v[i] - q.off))
            .sum();
        if q.off.is_finite() && q.size {
            out[i] = (q.off + away).clamp(q.lower, q.upper);
            moved |= out[i] != q.off;
        } else if !q.off.is_finite() {
            moved |= times.iter().all(|t| *t > 0.0);
        }
    }
    moved.then_some(out)
}

/// Where the fit of a cause begins: of values that a group varies together, each near off.
fn beginning(cause: &dyn LineEffect, group: &[Vec<f64>]) -> Vec<f64> {
    let quantities = cause.parameters();
    (0..quantities.len())
        .map(|i| {
            let off = quantities[i].off;
            let away = group.iter().map(|v| v[i]).find(|v| *v != off);
            away.unwrap_or(off)
        })
        .collect()
}

/// One round of the choice: the model with the cause that foretells best, or none.
fn choose<'a>(
    search: &Search<'a>,
    best: &Best<'a>,
    without: &[&str],
    unit_square: f64,
    tried: &mut Vec<Tried>,
    evaluations: &mut usize,
) -> Result<Option<Best<'a>>, Error> {
    let acting = best.residual.inverse().acting();
    let new = |id: &str| !without.contains(&id) && acting.iter().all(|a| a.effect.id() != id);
    let all: Vec<_> = every()
        .filter(|e| forward(*e) && new(e.id()))
        .flat_map(|e| starts(best, e))
        .collect();
    let mut first = promises(search, best, &all);
    // the first start of each is its best
    let mut seen: Vec<&str> = Vec::new();
    let enough = first.first().map_or(0.0, |p| PROMISING * p.fall);
    let enough = enough.max(WORTH * best.mean_square() * best.design.nrows() as f64);
    first.retain(|p| {
        let new = !seen.contains(&p.cause.id());
        seen.push(p.cause.id());
        new && p.fall >= enough
    });
    first.truncate(FITTED);
    let before = left_out(best);
    let fits: Vec<(&'static str, Best)> = first
        .par_iter()
        .filter_map(|p| Some((p.cause.id(), search.with(best, p, ROUGHLY).ok()?)))
        .collect();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let rms = |square: f64| (square * unit_square).sqrt();
    let mut winner: Option<(f64, usize, Best)> = None;
    for (id, own) in fits {
        *evaluations += own.evaluations;
        let after = left_out(&own);
        let falls: Vec<f64> = before.iter().zip(&after).map(|(b, a)| b - a).collect();
        let (fall, n) = (mean(&falls), falls.len() as f64);
        let scatter: f64 = falls.iter().map(|f| (f - fall).powi(2)).sum();
        let surety = fall / (scatter / (n * (n - 1.0))).sqrt().max(f64::MIN_POSITIVE);
        tried.push(Tried {
            id,
            left_out: [rms(mean(&before)), rms(mean(&after))],
            surety,
            taken: false,
        });
        let good = surety > SURE && fall > WORTH * mean(&before);
        if good && winner.as_ref().is_none_or(|w| mean(&after) < w.0) {
            winner = Some((mean(&after), tried.len() - 1, own));
        }
    }
    Ok(winner.map(|(_, place, own)| {
        tried[place].taken = true;
        own
    }))
}

/// Coefficients of an autoregression through a row of numbers and the variance of its innovations (Levinson
/// and Durbin), its order by BIC.
fn autoregression(r: &[f64]) -> (Vec<f64>, f64) {
    let n = r.len();
    let most = MOST_ORDER.min(n / 10);
    let lag = |k: usize| -> f64 {
        let products = r[k..].iter().zip(r).map(|(a, b)| a * b);
        products.sum::<f64>() / n as f64
    };
    let gamma: Vec<f64> = (0..=most).map(lag).collect();
    let (mut a, mut variance) = (Vec::new(), gamma[0]);
    let rows = n as f64;
    let mut best = (
        rows * variance.max(f64::MIN_POSITIVE).ln(),
        a.clone(),
        variance,
    );
    for order in 1..=most {
        let past: f64 = a
            .iter()
            .enumerate()
            .map(|(i, c)| c * gamma[order - 1 - i])
            .sum();
        if variance <= 0.0 {
            break;
        }
        let k = (gamma[order] - past) / variance;
        let old = a.clone();
        for (c, o) in a.iter_mut().zip(old.iter().rev()) {
            *c -= k * o;
        }
        a.push(k);
        variance *= 1.0 - k * k;
        let bic = rows * variance.max(f64::MIN_POSITIVE).ln() + order as f64 * rows.ln();
        if bic < best.0 {
            best = (bic, a.clone(), variance);
        }
    }
    (best.1, best.2)
}

/// Unknowns that are neither fixed nor at a bound.
fn free(at: &[f64], unknowns: &[Unknown]) -> Vec<usize> {
    let inside = |i: &usize| {
        let (u, x) = (&unknowns[*i], at[*i]);
        !u.is_fixed() && x > u.lower && x < u.upper
    };
    (0..at.len()).filter(inside).collect()
}

/// Derivatives by the free unknowns, each in a scale of its own that makes it one long; the scales, and their
/// Gram matrix.
fn scaled(best: &Best, free: &[usize]) -> (DMatrix<f64>, Vec<f64>, DMatrix<f64>) {
    let x = best.design.select_columns(free);
    let scale: Vec<f64> = (0..free.len())
        .map(|i| 1.0 / x.column(i).norm().max(f64::MIN_POSITIVE))
        .collect();
    let x = DMatrix::from_fn(x.nrows(), free.len(), |i, j| x[(i, j)] * scale[j]);
    let gram = x.tr_mul(&x) + DMatrix::identity(free.len(), free.len()) * 1e-13;
    (x, scale, gram)
}

/// Covariance of the unknowns: the sandwich with the colour of what is left (see the top). Fixed ones have
/// none.
fn covariance(best: &Best, unknowns: &[Unknown]) -> DMatrix<f64> {
    let width = best.design.ncols() - 1;
    let free = free(&best.unknowns, unknowns);
    let r = best.design.column(width);
    let (x, scale, gram) = scaled(best, &free);
    let mut out = DMatrix::zeros(width, width);
    let Some(factor) = gram.cholesky() else {
        out.fill(f64::NAN);
        return out;
    };
    let mut meat = DMatrix::zeros(free.len(), free.len());
    let mut from = 0;
    for rows in best.residual.rows_of_recordings() {
        let own: Vec<f64> = r.rows(from, rows).iter().copied().collect();
        let (a, variance) = autoregression(&own);
        // L' of the filter that makes the residual of its innovations runs backwards
        let columns: Vec<DVector<f64>> = (0..free.len())
            .into_par_iter()
            .map(|j| {
                let c = x.column(j);
                let mut z = DVector::zeros(rows);
                for t in (0..rows).rev() {
                    let past = a.iter().enumerate();
                    let ahead = past.filter(|(k, _)| t + k + 1 < rows);
                    let sum: f64 = ahead.map(|(k, a)| a * z[t + k + 1]).sum();
                    z[t] = c[from + t] + sum;
                }
                z
            })
            .collect();
        let z = DMatrix::from_columns(&columns);
        meat += z.tr_mul(&z) * variance;
        from += rows;
    }
    let n = best.design.nrows() as f64;
    let bread = factor.inverse();
    let own = &bread * meat * &bread * (n / (n - free.len() as f64).max(1.0));
    for (i, &a) in free.iter().enumerate() {
        for (j, &b) in free.iter().enumerate() {
            out[(a, b)] = own[(i, j)] * scale[i] * scale[j];
        }
    }
    out
}

/// A cause at its values in the units of the recordings, number `e` of the model; `own` is the covariance of
/// the unknowns.
fn estimated(inverse: &LineResidual, e: usize, a: &Acting, own: &DMatrix<f64>) -> AxisCause {
    let mut acting = a.clone();
    let mut estimates = Vec::new();
    for (v, q) in a.effect.parameters().iter().enumerate() {
        let (factor, unit) = inverse.unit_of(q.unit);
        acting.values[v] *= factor;
        let value = acting.values[v];
        let place = inverse.place_of(e, v).map(|p| inverse.linear() + p);
        let sd = place.map_or(f64::NAN, |p| {
            own[(p, p)].max(0.0).sqrt() * q.spread * factor.abs()
        });
        let off = if q.off.is_finite() {
            q.off * factor
        } else {
            0.0
        };
        let told = sd > 0.0 && 1.96 * sd < (value - off).abs();
        estimates.push(Estimate {
            name: format!("{}.{}", a.effect.id(), q.name),
            meaning: a.effect.says().to_owned(),
            unit: unit.into(),
            value,
            std_error: if sd > 0.0 { sd } else { f64::NAN },
            ci95: [value - 1.96 * sd, value + 1.96 * sd],
            at_bound: None,
            identifiable: told,
            fixed: place.is_none(),
            says: if told {
                "determined".into()
            } else {
                "not told from off by these recordings".into()
            },
        });
    }
    AxisCause { acting, estimates }
}

/// How the choice was made, in words.
fn say_choice(out: &mut LineOutcome, residual: &MotionResidual, choice: &Choice) {
    let others = (choice.compared.iter()).map(|(b, r)| format!("{} {r:.4e}", b.name()));
    let list: Vec<String> = others.collect();
    out.remarks.push(format!(
        "The input {}{}; the motion is run forward in {} steps a sample.",
        residual.between().says(),
        match list.len() > 1 {
            true => format!(" (what is left, {}: {})", out.unit, list.join(", ")),
            false => String::new(),
        },
        residual.steps()
    ));
    for (way, likely, _) in choice.others.iter().filter(|o| o.1 > 0.05) {
        out.remarks.push(format!(
            "That the input is {} between samples is as likely as {:.0} %: the intervals count it.",
            way.name(),
            100.0 * likely
        ));
    }
    for t in &choice.tried {
        out.remarks.push(format!(
            "{}: error on blocks that were left out {:.4e} to {:.4e} {} ({:.1} standard errors): {}.",
            t.id,
            t.left_out[0],
            t.left_out[1],
            out.unit,
            t.surety,
            if t.taken { "taken" } else { "not taken" }
        ));
    }
}

/// Recordings of which what is left follows from what came before it.
fn say_colour(out: &mut LineOutcome, best: &Best, refs: &[&Line]) {
    let rows = best.residual.rows_of_recordings();
    let r = best.design.column(best.design.ncols() - 1);
    let mut from = 0;
    for (line, n) in refs.iter().zip(rows) {
        let own: Vec<f64> = r.rows(from, n).iter().copied().collect();
        from += n;
        let (a, variance) = autoregression(&own);
        let whole = own.iter().map(|v| v * v).sum::<f64>() / n.max(1) as f64;
        let told = 1.0 - variance / whole.max(f64::MIN_POSITIVE);
        if told > 0.1 {
            out.remarks.push(format!(
                "{}: {:.0} % of what is left follows from what came before it (an autoregression of order {}): \
                 noise that moves the axis, or what the model lacks, not noise of the sensor; the intervals \
                 count it.",
                line.id,
                100.0 * told,
                a.len()
            ));
        }
    }
}

fn outcome(
    search: &Search,
    best: &Best,
    refs: &[&Line],
    mut choice: Choice,
) -> Result<AxisMotion, Error> {
    let residual = &best.residual;
    let inverse = residual.inverse();
    let linear = inverse.linear();
    let (beta, eta) = residual.model(&best.unknowns);
    let unknowns = search.unknowns(residual, &best.unknowns);
    let mut own = covariance(best, &unknowns);
    let offsets = inverse.free_offsets().len();
    // as the balance has them: offsets, then beta
    let unit = |i: usize| if i < linear { residual.unit()[i] } else { 1.0 };
    for (_, likely, away) in &choice.others {
        for i in 0..away.len() {
            for j in 0..away.len() {
                own[(i, j)] += likely * away[i] * away[j] / (unit(i) * unit(j));
            }
        }
    }
    let order: Vec<usize> = (linear..linear + offsets).chain(0..linear).collect();
    let covariance = DMatrix::from_fn(order.len(), order.len(), |i, j| {
        let (i, j) = (order[i], order[j]);
        own[(i, j)] * unit(i) * unit(j)
    });
    let (_, coordinate, _) = inverse.symbols();
    let courses = residual.courses(&best.unknowns)?;
    let recordings = refs.iter().zip(courses).map(|(l, c)| held(l, &c, 0));
    let effects = inverse.effects(&eta);
    let causes = effects.iter().enumerate();
    let mut out = LineOutcome {
        job: "axis",
        kind: Kind::Axis,
        verdict: String::new(),
        driven: "motion",
        unit: match residual.velocity() {
            true => format!("{coordinate}/s"),
            false => coordinate.to_owned(),
        },
        causes: causes
            .map(|(e, a)| estimated(inverse, e, a, &own))
            .collect(),
        estimates: Vec::new(),
        recordings: recordings.collect(),
        curve: None,
        values: inverse.values(&eta, &beta),
        converged: best.converged,
        reason: best.reason.to_owned(),
        evaluations: best.evaluations,
        weighted_mean_square: best.mean_square(),
        remarks: Vec::new(),
    };
    let place = Between::ALL.iter().position(|b| *b == residual.between());
    out.values.push((BETWEEN.into(), place.unwrap_or(0) as f64));
    judge(&mut out)?;
    let free = vec![Unknown::free(0.0, -OFFSET_REACH_S, OFFSET_REACH_S); offsets];
    let mut state = State::at(&eta[..offsets], &free, &[]);
    (state.beta, state.evaluations) = (beta, best.evaluations);
    let (linear, names) = (&search.linear, &search.names);
    say(&mut out, inverse, &state, linear, names, &covariance);
    (out.converged, out.reason) = (best.converged, best.reason.to_owned());
    for c in &out.causes {
        out.estimates.extend(c.estimates.clone());
        let (id, says) = (c.acting.effect.id(), c.acting.effect.says());
        out.remarks.push(format!("{id}: {says}."));
    }
    let unit_square = unit_of_rows(refs);
    for (_, left) in &mut choice.compared {
        *left = (*left * unit_square).sqrt();
    }
    say_choice(&mut out, residual, &choice);
    say_colour(&mut out, best, refs);
    Ok(AxisMotion {
        outcome: out,
        between: residual.between(),
        compared: choice.compared,
        tried: choice.tried,
        steps: residual.steps(),
    })
}

/// A course that was run forward, held against what was measured; its first `skip` samples do not count.
fn held(line: &Line, course: &[f64], skip: usize) -> LineFit {
    let shown = line.captured.clone();
    let measured: Vec<f64> = line.x[shown.clone()].to_vec();
    let errors: Vec<f64> = shown
        .clone()
        .zip(course.iter().zip(&measured))
        .skip(skip)
        .filter(|(i, _)| line.usable[*i])
        .map(|(_, (c, m))| c - m)
        .collect();
    let n = errors.len();
    LineFit {
        forward: None,
        id: line.id.clone(),
        rmse: (errors.iter().map(|e| e * e).sum::<f64>() / n.max(1) as f64).sqrt(),
        max_error: errors.iter().fold(0.0, |m: f64, e| m.max(e.abs())),
        n_samples: n,
        noise: line.x_noise,
        time_s: line.time_s[shown].to_vec(),
        coordinate: measured.clone(),
        measured,
        predicted: course.to_vec(),
        notes: line.notes.clone(),
    }
}

/// An axis at finished parameters, to be run forward, its steps settled.
fn ready<'a>(
    line: &'a Line,
    model: &LineModel,
    begin: usize,
) -> Result<(MotionResidual<'a>, Vec<f64>, Vec<f64>), Error> {
    let (inverse, eta, beta) = model.at(&[line], false)?;
    let code = model
        .values
        .iter()
        .find(|v| v.0 == BETWEEN)
        .map_or(0.0, |v| v.1);
    let between = Between::ALL
        .get(code as usize)
        .copied()
        .unwrap_or(Between::Straight);
    let unit = vec![1.0; beta.len()];
    let mut residual = MotionResidual::new(inverse, between, 1, WHOLE, unit)?.blind();
    let mut before: Option<Vec<f64>> = None;
    let mut last = None;
    loop {
        let mut at = beta.clone();
        at.extend(&eta);
        let states = if begin > 0 {
            residual.begun(0, &at, begin)
        } else {
            Ok(residual.rest(0, &at))
        };
        let made = states.and_then(|s| Ok((residual.predicted(0, &at, &s)?, s)));
        let most = residual.steps() >= MOST_STEPS;
        match (made, before.take()) {
            (Ok((course, states)), Some(coarse)) => {
                let size = course.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
                let change = course.iter().zip(&coarse).map(|(a, b)| (a - b).abs());
                let change = change.fold(0.0, f64::max);
                let [_, half] = off(change, last);
                if most || half < 1e-5 * size {
                    return Ok((residual, states, course));
                }
                (before, last) = (Some(course), Some(change));
            }
            (Ok((course, _)), None) => before = Some(course),
            (Err(e), _) if most => return Err(e.into()),
            (Err(_), _) => {}
        }
        residual = residual.with_steps(2 * residual.steps());
    }
}

/// The motion that a model makes of the input of an axis, at its captured samples: from rest under the first
/// input, or, with `begin` samples, from where those tell that it began. Nothing else of what was measured of
/// the motion is read.
///
/// # Errors
/// [`Error`] where the model lacks what the recording needs or cannot be run forward.
pub fn predict_line_motion(line: &Line, model: &LineModel, begin: usize) -> Result<LineFit, Error> {
    let (_, _, course) = ready(line, model, begin)?;
    Ok(held(line, &course, begin))
}

/// What a model makes of the motion of an axis, for a validation: none where it cannot be run forward.
pub(super) fn of_forward(line: &Line, model: &LineModel) -> Option<Forward> {
    let Measured::Axis(axis) = &line.measured else {
        return None;
    };
    let fit = predict_line_motion(line, model, BEGINNING).ok()?;
    let finite = || fit.measured.iter().copied().filter(|m| m.is_finite());
    Some(Forward {
        rmse: fit.rmse,
        max_error: fit.max_error,
        n_samples: fit.n_samples,
        unit: match (axis.turns, axis.velocity) {
            (false, false) => "m",
            (false, true) => "m/s",
            (true, false) => "rad",
            (true, true) => "rad/s",
        },
        range: finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_promise_sizes_a_cause_and_minds_its_sign() {
        let of =
            |id: &str, group: &[Vec<f64>], times: &[f64]| sized(by_id(id).unwrap(), group, times);
        let spring = [vec![0.0, 0.02], vec![0.02, 0.0]];
        let both = of("x_nonlinear_stiffness", &spring, &[10.0, -5.0]).unwrap();
        assert!((both[0] + 0.1).abs() < 1e-12 && (both[1] - 0.2).abs() < 1e-12);
        // friction pushes back, and keeps the shape that was looked for
        let friction = [vec![0.02, 0.05]];
        assert_eq!(
            of("joint_friction", &friction, &[2.0]),
            Some(vec![0.04, 0.05])
        );
        assert_eq!(of("joint_friction", &friction, &[-2.0]), None);
        // a ceiling has no size at which it does nothing
        let ceiling = [vec![0.8, 0.02]];
        assert_eq!(
            of("amplifier_saturation", &ceiling, &[2.0]),
            Some(vec![0.8, 0.02])
        );
        assert_eq!(of("amplifier_saturation", &ceiling, &[-2.0]), None);
    }

    #[test]
    fn an_autoregression_is_found() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut generator = rand_chacha::ChaCha12Rng::seed_from_u64(5);
        let mut r = vec![0.0, 0.0];
        for t in 2..40_000 {
            let w: f64 = StandardNormal.sample(&mut generator);
            r.push(1.2 * r[t - 1] - 0.5 * r[t - 2] + 0.1 * w);
        }
        let (a, variance) = autoregression(&r);
        assert!(
            a.len() <= 4 && (a[0] - 1.2).abs() < 0.02 && (a[1] + 0.5).abs() < 0.02,
            "{a:?}"
        );
        assert!((variance.sqrt() / 0.1 - 1.0).abs() < 0.02);
    }
}
