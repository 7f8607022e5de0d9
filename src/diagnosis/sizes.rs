//! The sizes of what was found: values of effects with their intervals, freed of what the capture's noise
//! makes of them.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};

use super::chance::BEYOND_DRAWN;
use super::problem::{Fitted, Problem, value_unknowns};
use super::subject::Subject;
use crate::film::Locked;
use crate::fit::profile::{Candidate, TWO_SIDED_95, profile};
use crate::fit::separable::{Options, State, Unknown};

/// The estimate of a free value of an effect, in its unit.
#[derive(Clone, Copy)]
pub(super) struct Estimate {
    pub value: f64,
    /// NaN where it is not known.
    pub std_error: f64,
    pub ci95: [f64; 2],
}

impl Estimate {
    /// With an interval of so many standard errors to both sides.
    pub fn new(value: f64, std_error: f64, times: f64) -> Self {
        Estimate {
            value,
            std_error,
            ci95: [value - times * std_error, value + times * std_error],
        }
    }
}

/// The free values of a fitted model's effects as they are, with no standard error.
pub(super) fn unknown_values(fitted: &Fitted) -> Vec<Estimate> {
    let of = |&(e, v): &(usize, usize)| Estimate::new(fitted.effects[e].values[v], f64::NAN, 1.0);
    fitted.free.iter().map(of).collect()
}

/// Whether a size of a fit's effect number `own` is told: its interval reaches neither off nor over all of its
/// range.
pub(super) fn is_told(fitted: &Fitted, own: usize, estimates: &[Estimate]) -> bool {
    let all = fitted.effects[own].effect.parameters();
    let mut sizes = (fitted.free.iter().zip(estimates))
        .filter(|(free, _)| free.0 == own && all[free.1].size)
        .map(|(free, estimate)| (&all[free.1], estimate.ci95));
    sizes.any(|(q, [low, high])| {
        let reaches_off = q.off.is_finite() && (low..=high).contains(&q.off);
        let anything = low <= q.lower && high >= q.upper;
        !reaches_off && !anything
    })
}

/// Rounds in which the values are looked for that make, on average, the scores that were found.
const ROUNDS: usize = 4;
/// A round that moves every value by less than so many standard errors is the last.
const SETTLED: f64 = 1.0;
/// Share of what the simulated recordings move a value by that counts as its standard error: all of it made
/// intervals of 80 own cases too wide (83 % within one standard error, 97.5 % within the interval), half of
/// it those of 235 a little too narrow (66 %, 92.8 %). With this share and the profile 94.7 % of 398 hold (69
/// %).
const UNSURE: f64 = 0.7;
/// Relative standard error of an effect's first value from which it is profiled: below, the curvature
/// suffices.
const PROFILED: f64 = 0.05;
/// Draws of noise that the covariance of the scores counts as, beside those of [`Subject::expected_score`].
const PRIOR_DRAWS: f64 = 4.0;

/// The free values of a fitted model's effects, in their units.
///
/// The covariance is H^-1 (S + P) H^-1: H the Gauss-Newton matrix with priors P, S that of the scores under
/// the noise of the capture. What a textbook form leaves beyond noise widens it by the root of the mean
/// square, and on robots what clean recordings make beyond the drawn noise ([`BEYOND_DRAWN`]).
///
/// With `freed`, the values are those under which simulated recordings, captured and smoothed alike, have
/// scores of mean 0 at the fitted ones (errors in variables, by the efficient method of moments of Gallant
/// and Tauchen 1996): the fitted ones predict best from motion that is as noisy, and are wrong by as much.
/// What the simulated noise does to each value then joins its variance, and the interval is Student's with as
/// many degrees of freedom (a moderated t, Smyth 2004). The first value of each effect, where it is of
/// middling certainty, is profiled: the interval goes as much further to a side as the sum of squares rises
/// more slowly there than the curvature says.
pub(super) fn value_estimates<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
    freed: bool,
) -> Result<Vec<Estimate>, Locked> {
    let mut residual = problem.residual(fitted);
    residual.linearise(&fitted.state.eta, &fitted.state.beta, true)?;
    let scores = residual.score_covariance(&fitted.state.eta, &fitted.state.beta)?;
    let Some(near) = Near::new(problem, fitted) else {
        return Ok(unknown_values(fitted));
    };
    let beyond = if S::CHAINS > 1 { BEYOND_DRAWN } else { 1.0 };
    let mut told = Told {
        truth: near.at.clone(),
        noise: near.noise(near.misfit * beyond, &scores),
        degrees: f64::INFINITY,
    };
    if freed && !fitted.free.is_empty() {
        told.free(&residual, fitted, &near);
    }
    let times = match StudentsT::new(0.0, 1.0, told.degrees) {
        Ok(t) if told.degrees.is_finite() => t.inverse_cdf(0.975),
        _ => TWO_SIDED_95,
    };
    let candidates = match freed {
        true => near.candidates(fitted, &told),
        false => Vec::new(),
    };
    let reach = near.reach(problem, &residual, fitted, &candidates);
    Ok((0..fitted.free.len())
        .map(|i| {
            let (e, v) = fitted.free[i];
            let q = &fitted.effects[e].effect.parameters()[v];
            let value = fitted.effects[e].values[v];
            let Some(a) = near.free.iter().position(|&f| f == near.first + i) else {
                return Estimate::new(value, f64::NAN, 1.0);
            };
            let by = (told.truth[near.free[a]] - near.at[near.free[a]]) * q.spread;
            let error = near.std_error(&told, a) * q.spread;
            let freed = (value + by).clamp(q.lower, q.upper);
            let mut estimate = Estimate::new(freed, error.hypot(UNSURE * by), times);
            if let Some(c) = candidates.iter().position(|c| c.unknown == near.free[a]) {
                // never surer than the curvature says, nor than the profile does
                let further =
                    reach[c].map(|d| (d / (TWO_SIDED_95 * candidates[c].std_error)).max(1.0));
                let [below, above] = further.map(|f| times * (f * error).hypot(UNSURE * by));
                estimate.ci95 = [freed - below, freed + above];
                estimate.std_error = (below + above) / (2.0 * times);
            }
            // nothing lies where physics has nothing
            estimate.ci95 = estimate.ci95.map(|end| end.clamp(q.lower, q.upper));
            estimate
        })
        .collect())
}

/// A fitted model and what is near it: unknowns scaled so that the Gauss-Newton matrix with priors has a
/// diagonal of ones.
struct Near {
    /// All unknowns: plain nonlinear ones, values of effects from number `first` on, linear ones; and where
    /// the fit has them.
    unknowns: Vec<Unknown>,
    first: usize,
    at: Vec<f64>,
    /// Those that the recordings or a prior tell something of.
    free: Vec<usize>,
    /// One over the root of each free one's diagonal, and its prior's weight in that scale.
    scale: Vec<f64>,
    priors: DVector<f64>,
    /// Inverse of the scaled matrix, and what the priors add to its variances.
    inverse: DMatrix<f64>,
    of_priors: DMatrix<f64>,
    /// Mean square of what is left, 1 where it is less.
    misfit: f64,
}

impl Near {
    /// `None` where the recordings leave a direction entirely open.
    fn new<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Option<Self> {
        let gram = fitted.state.gram();
        let mut unknowns = problem.nonlinear.clone();
        let first = unknowns.len();
        unknowns.extend(value_unknowns(&fitted.effects, &fitted.free));
        unknowns.extend(problem.linear.iter().copied());
        let prior = |i: usize| unknowns[i].prior.map_or(0.0, |p| p.sd.powi(-2));
        let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
        let at: Vec<f64> = eta.iter().chain(beta).copied().collect();
        let free: Vec<usize> = (0..unknowns.len())
            .filter(|&i| at[i] > unknowns[i].lower && at[i] < unknowns[i].upper)
            .filter(|&i| gram[(i, i)] + prior(i) > 0.0)
            .collect();
        let n = free.len();
        let scale: Vec<f64> = (free.iter())
            .map(|&i| (gram[(i, i)] + prior(i)).sqrt().recip())
            .collect();
        let mut h = DMatrix::from_fn(n, n, |a, b| scale[a] * scale[b] * gram[(free[a], free[b])]);
        let priors = DVector::from_fn(n, |a, _| scale[a] * scale[a] * prior(free[a]));
        for a in 0..n {
            h[(a, a)] += priors[a] + 1e-12;
        }
        let inverse = h.cholesky()?.inverse();
        let of_priors = &inverse * DMatrix::from_diagonal(&priors) * &inverse;
        let misfit = (fitted.cost() / fitted.state.rows as f64).max(1.0);
        Some(Near {
            unknowns,
            first,
            at,
            free,
            scale,
            priors,
            inverse,
            of_priors,
            misfit,
        })
    }

    /// Variances of the scaled unknowns under noise whose scores have `times` the covariance `scores`.
    fn noise(&self, times: f64, scores: &DMatrix<f64>) -> Vec<f64> {
        let (n, free, scale) = (self.free.len(), &self.free, &self.scale);
        let s = DMatrix::from_fn(n, n, |a, b| {
            times * scale[a] * scale[b] * scores[(free[a], free[b])]
        });
        let covariance = &self.inverse * s * &self.inverse;
        covariance.diagonal().iter().copied().collect()
    }

    fn scaled(&self, score: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(self.free.len(), |a, _| self.scale[a] * score[self.free[a]])
    }

    /// The free values of effects.
    fn own(&self, fitted: &Fitted) -> Vec<usize> {
        let values = self.first..self.first + fitted.free.len();
        (0..self.free.len())
            .filter(|&a| values.contains(&self.free[a]))
            .collect()
    }

    /// Variance of a scaled unknown, with what the priors leave open.
    fn variance(&self, told: &Told, a: usize) -> f64 {
        told.noise[a].max(0.0) + self.of_priors[(a, a)].max(0.0)
    }

    /// Standard error of an unknown as the search has it.
    fn std_error(&self, told: &Told, a: usize) -> f64 {
        self.variance(told, a).sqrt() * self.scale[a]
    }

    /// The first value of each effect that is of middling certainty.
    fn candidates(&self, fitted: &Fitted, told: &Told) -> Vec<Candidate> {
        self.own(fitted)
            .into_iter()
            .filter(|&a| {
                let number = self.free[a] - self.first;
                let first_of_its_effect =
                    number == 0 || fitted.free[number - 1].0 != fitted.free[number].0;
                let least = PROFILED * self.at[self.free[a]].abs();
                first_of_its_effect && self.std_error(told, a) > least
            })
            .map(|a| Candidate {
                unknown: self.free[a],
                std_error: self.std_error(told, a),
                inflation: (self.variance(told, a) / self.inverse[(a, a)]).max(1.0),
            })
            .collect()
    }

    /// Distances to the ends of the profiled intervals of `candidates`, below and above, from where the fit
    /// ends on this residual.
    fn reach<S: Subject>(
        &self,
        problem: &Problem<S>,
        residual: &S,
        fitted: &Fitted,
        candidates: &[Candidate],
    ) -> Vec<[f64; 2]> {
        if candidates.is_empty() {
            return Vec::new();
        }
        let (nonlinear, linear) = self
            .unknowns
            .split_at(self.unknowns.len() - problem.linear.len());
        let mut from = linear.to_vec();
        for (u, b) in from.iter_mut().zip(&fitted.state.beta) {
            u.start = *b;
        }
        let options = Options {
            evaluations: 10,
            ..Options::default()
        };
        let watch = |_: &State| ControlFlow::Continue(());
        let eta = &fitted.state.eta;
        let (memory, tag) = (&problem.memory, format!("{:?}", fitted.effects));
        let best = memory.minimise(&tag, residual, nonlinear, &from, eta, &options, watch);
        let kept = (memory, &tag[..]);
        profile(residual, nonlinear, linear, &best, candidates, kept).0
    }
}

/// What is told of the unknowns.
struct Told {
    /// Their values, noise and smoothing taken out.
    truth: Vec<f64>,
    /// Variances of the scaled free ones under noise, and the degrees of freedom that these have.
    noise: Vec<f64>,
    degrees: f64,
}

impl Told {
    /// Moves the unknowns to where simulated recordings have, on average, scores of 0 at the fitted ones.
    fn free<S: Subject>(&mut self, residual: &S, fitted: &Fitted, near: &Near) {
        let own = near.own(fitted);
        let mut before = f64::INFINITY;
        for _ in 0..if own.is_empty() { 0 } else { ROUNDS } {
            // a film that these values would lock tells nothing, nor does the pull of noise alone a second
            // time
            let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
            let score = match residual.expected_score(eta, beta, &self.truth) {
                Ok(Some(s)) if s.simulated || before.is_infinite() => s,
                _ => break,
            };
            if score.mean.iter().any(|x| x.is_nan()) {
                break;
            }
            if self.degrees.is_infinite() {
                self.pool(&score.draws, near);
            }
            // the priors hold what moves where they held what was fitted
            let held = DVector::from_fn(near.free.len(), |a, _| {
                let i = near.free[a];
                near.priors[a] / near.scale[a] * (self.truth[i] - near.at[i])
            });
            let step = &near.inverse * (near.scaled(&score.mean) - held);
            // a step that takes a size out of its range is longer than linear theory holds
            let leaves = |&a: &usize| {
                let (u, number) = (&near.unknowns[near.free[a]], near.free[a] - near.first);
                let (e, v) = fitted.free[number];
                let to = self.truth[near.free[a]] + near.scale[a] * step[a];
                fitted.effects[e].effect.parameters()[v].size && !(u.lower..=u.upper).contains(&to)
            };
            if own.iter().any(leaves) {
                break;
            }
            let largest = (own.iter())
                .map(|&a| step[a].abs() / near.variance(self, a).sqrt())
                .fold(0.0, f64::max);
            if largest >= before {
                break;
            }
            before = largest;
            for (a, &i) in near.free.iter().enumerate() {
                let u = &near.unknowns[i];
                self.truth[i] = (self.truth[i] + near.scale[a] * step[a]).clamp(u.lower, u.upper);
            }
            if largest < SETTLED || !score.simulated {
                break;
            }
        }
    }

    /// Pools the variances with what draws of the scores make of each unknown.
    fn pool(&mut self, draws: &[DVector<f64>], near: &Near) {
        self.degrees = PRIOR_DRAWS + draws.len() as f64;
        for v in &mut self.noise {
            *v *= PRIOR_DRAWS;
        }
        for draw in draws {
            let moved = &near.inverse * near.scaled(draw);
            for (v, m) in self.noise.iter_mut().zip(&moved) {
                *v += near.misfit * m * m;
            }
        }
        for v in &mut self.noise {
            *v /= self.degrees;
        }
    }
}
