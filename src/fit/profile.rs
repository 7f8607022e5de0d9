//! Intervals by profiling: where the local curvature cannot be trusted.
//!
//! A parameter that a recording just about shows can be traded against its neighbours along a curved valley,
//! and the curvature at the best point says little about how far that valley goes. For a parameter of
//! middling certainty the other parameters are fitted again with it held away from its best value, until the
//! sum of squares has risen by what the 95 % interval allows (profile likelihood; Venzon and Moolgavkar 1988,
//! Appl. Stat. 37:87). The rise is measured in units of the noise's own spread, which correlated noise makes
//! larger than one.

use std::ops::ControlFlow;

use rayon::prelude::*;

use super::memory::Memory;
use super::separable::{Options, State, Unknown};
use crate::residual::SeparableResidual;

/// 95 % of a normal density lie within so many standard deviations.
pub const TWO_SIDED_95: f64 = 1.96;
/// Refits on one side before the last estimate is taken.
const REFITS: usize = 4;

/// A parameter to profile, and what its interval would be without.
pub struct Candidate {
    /// Number of the unknown: nonlinear ones first.
    pub unknown: usize,
    /// Standard error from the curvature, in the search's scale.
    pub std_error: f64,
    /// Variance with the noise's correlation over variance without.
    pub inflation: f64,
}

/// Distances from the best value to the ends of the 95 % interval, below and above, for each candidate, and
/// the evaluations that it took. A side that the data never close ends at the bound. `memory` keeps the
/// refits, with what they are of.
pub fn profile<P: SeparableResidual + Sync>(
    problem: &P,
    nonlinear: &[Unknown],
    linear: &[Unknown],
    best: &State,
    candidates: &[Candidate],
    memory: (&Memory, &str),
) -> (Vec<[f64; 2]>, usize) {
    let sides: Vec<(f64, usize)> = (0..2 * candidates.len())
        .into_par_iter()
        .map(|job| {
            let sign = if job % 2 == 0 { -1.0 } else { 1.0 };
            let candidate = &candidates[job / 2];
            reach(
                problem,
                [nonlinear, linear],
                best,
                (candidate, sign),
                memory,
            )
        })
        .collect();
    let evaluations = sides.iter().map(|s| s.1).sum();
    let ends = sides.chunks(2).map(|pair| [pair[0].0, pair[1].0]).collect();
    (ends, evaluations)
}

/// How far the interval goes on one side.
fn reach<P: SeparableResidual>(
    problem: &P,
    [nonlinear, linear]: [&[Unknown]; 2],
    best: &State,
    (candidate, sign): (&Candidate, f64),
    (memory, tag): (&Memory, &str),
) -> (f64, usize) {
    let split = nonlinear.len();
    let number = candidate.unknown;
    let (bounds, at) = if number < split {
        (nonlinear[number], best.eta[number])
    } else {
        (linear[number - split], best.beta[number - split])
    };
    let room = if sign < 0.0 {
        at - bounds.lower
    } else {
        bounds.upper - at
    };
    let wanted = TWO_SIDED_95 * TWO_SIDED_95 * candidate.inflation;
    let options = Options {
        evaluations: 30,
        cost_tolerance: 1e-5,
        ..Options::default()
    };
    let mut distance = (TWO_SIDED_95 * candidate.std_error).min(room);
    let (mut nonlinear, mut linear) = (nonlinear.to_vec(), linear.to_vec());
    for (u, b) in linear.iter_mut().zip(&best.beta) {
        u.start = b.clamp(u.lower, u.upper);
    }
    let mut eta = best.eta.clone();
    let mut evaluations = 0;
    for _ in 0..REFITS {
        let held = at + sign * distance;
        if number < split {
            nonlinear[number] = Unknown {
                prior: nonlinear[number].prior,
                ..Unknown::fixed(held)
            };
            eta[number] = held;
        } else {
            linear[number - split] = Unknown::fixed(held);
        }
        let go_on = |_: &State| ControlFlow::Continue(());
        let state = memory.minimise(tag, problem, &nonlinear, &linear, &eta, &options, go_on);
        evaluations += state.evaluations;
        if !state.cost.is_finite() {
            return (distance, evaluations); // the model has no value out there
        }
        eta.clone_from(&state.eta);
        let rise = (state.cost - best.cost).max(1e-3 * wanted);
        let ratio = (wanted / rise).sqrt();
        if (0.9..1.15).contains(&ratio) {
            return (distance * ratio, evaluations);
        }
        if ratio > 1.0 && distance >= room {
            return (room, evaluations);
        }
        distance = (distance * ratio.clamp(0.4, 2.5)).min(room);
    }
    (distance, evaluations)
}
