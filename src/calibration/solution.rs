//! Where a fit of a film ended, and what it says of each parameter.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::outcome::*;
use super::{Error, Uncertainty};
use crate::film::Film;
use crate::fit::profile::TWO_SIDED_95;
use crate::fit::separable::{Ended, State, Unknown};
use crate::parameter::{Parameter, Transform};

/// Relative standard error up to which a parameter counts as determined.
const IDENTIFIABLE: f64 = 0.33;
/// Relative standard error up to which the locking constant counts as determined; it is searched by its
/// reciprocal.
const IDENTIFIABLE_LIMIT: f64 = 0.2;
/// Standard error up to which a nodal torque counts as determined, N m.
const IDENTIFIABLE_TORQUE_N_M: f64 = 2e-4;
/// Relative standard deviation above which a combination of parameters is reported as open.
const OPEN: f64 = 0.5;

/// The starts of a fit, and where each ended.
pub(super) struct Starts {
    states: Vec<State>,
    /// Best first.
    pub waterfall: Vec<StartOutcome>,
    /// Evaluations of all.
    pub evaluations: usize,
    /// How many failed.
    pub failed: usize,
}

impl Starts {
    /// Fits from all `starts` at once; the first of the `list` are `branches` relaxation times and J.
    pub fn run(
        starts: Vec<(String, Vec<f64>)>,
        (list, branches): (&[Parameter], usize),
        fit: impl Fn(&[f64]) -> State + Sync,
    ) -> Self {
        let mut states: Vec<(String, State)> = starts
            .into_par_iter()
            .map(|(origin, eta)| (origin, fit(&eta)))
            .collect();
        states.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        let reached = |s: &State| -> Vec<f64> {
            let searched = list[..=branches].iter().zip(&s.eta);
            searched.map(|(p, x)| p.transform.to_model(*x)).collect()
        };
        let (waterfall, states): (Vec<_>, Vec<_>) = states
            .into_iter()
            .map(|(origin, s)| {
                let outcome = StartOutcome {
                    origin,
                    cost: s.cost / s.rows.max(1) as f64,
                    evaluations: s.evaluations,
                    failed: s.failed,
                    ended: s.ended.map_or("", Ended::words).into(),
                    reached: reached(&s),
                };
                (outcome, s)
            })
            .unzip();
        Starts {
            evaluations: states.iter().map(|s| s.evaluations).sum(),
            failed: states.iter().map(|s| s.failed).sum(),
            waterfall,
            states,
        }
    }

    /// Of the starts whose cost is within `share` of the best one's, the first that says it converged; else
    /// the best.
    pub fn best_within(&self, share: f64) -> usize {
        let agrees = self.states[0].cost * (1.0 + share);
        self.states
            .iter()
            .take_while(|s| s.cost <= agrees)
            .position(|s| s.ended.is_some_and(Ended::converged))
            .unwrap_or(0)
    }

    /// Where one of them ended.
    pub fn take(&mut self, number: usize) -> Result<State, Error> {
        let state = self.states.swap_remove(number);
        if !state.cost.is_finite() {
            return Err(Error::AllStartsFailed {
                tried: self.waterfall.len(),
                last: state.failure.unwrap_or_default(),
            });
        }
        Ok(state)
    }

    /// What a reader should know of evaluations that failed.
    pub fn remark(&self) -> Option<String> {
        let (failed, evaluations) = (self.failed, self.evaluations);
        (failed > 0).then(|| {
            format!("{failed} of {evaluations} evaluations failed and were stepped back from.")
        })
    }
}

/// Where the unknowns rest on a bound.
pub(super) fn resting(unknowns: &[Unknown], state: &State) -> Vec<Option<AtBound>> {
    unknowns
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
        .collect()
}

/// What is known of the unknowns beforehand: reciprocal variances.
pub(super) fn precision(unknowns: &[Unknown]) -> Vec<f64> {
    let priors = unknowns.iter().map(|u| u.prior);
    priors
        .map(|prior| prior.map_or(0.0, |p| p.sd.powi(-2)))
        .collect()
}

/// Gram matrix of all unknowns.
pub(super) fn gram(state: &State) -> DMatrix<f64> {
    let size = state.eta.len() + state.beta.len();
    state.gram().view((0, 0), (size, size)).into_owned()
}

/// Whether it is a clock offset: a time that may be negative.
pub(super) fn is_offset(p: &Parameter) -> bool {
    p.unit == "s" && p.transform == Transform::Linear
}

/// Numbers of all parameters with the branches in the order of rising relaxation time; moduli follow their
/// branch.
fn rising(log_times: &[f64], list: &[Parameter], split: usize) -> Vec<usize> {
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

/// A solution: nonlinear parameters first, which are `split`, and of them the relaxation times.
pub(super) struct Solution<'f> {
    list: &'f [Parameter],
    split: usize,
    branches: usize,
    state: &'f State,
    resting: &'f [Option<AtBound>],
    /// Branches by rising relaxation time, whatever number they had in the search.
    order: Vec<usize>,
}

impl<'f> Solution<'f> {
    pub fn new(
        list: &'f [Parameter],
        split: usize,
        branches: usize,
        state: &'f State,
        resting: &'f [Option<AtBound>],
    ) -> Self {
        Solution {
            list,
            split,
            branches,
            state,
            resting,
            order: rising(&state.eta[..branches], list, split),
        }
    }

    /// Numbers of the branches by rising relaxation time.
    pub fn by_time(&self) -> &[usize] {
        &self.order[..self.branches]
    }

    /// A film of the search's order with its branches by rising relaxation time.
    pub fn sorted(&self, film: &Film) -> Film {
        let mut out = film.clone();
        for (place, &branch) in self.by_time().iter().enumerate() {
            out.relaxation_time_s[place] = film.relaxation_time_s[branch];
            out.mu_pa[place + 1] = film.mu_pa[branch + 1];
        }
        out
    }

    /// Every parameter; `profiled` is how far the profiles of some reach to both sides.
    pub fn estimates(
        &self,
        uncertainty: &Uncertainty,
        profiled: &[Option<[f64; 2]>],
    ) -> Vec<Estimate> {
        (0..self.order.len())
            .map(|place| {
                let i = self.order[place];
                self.estimate(place, uncertainty.std_error(i), profiled[i])
            })
            .collect()
    }

    fn estimate(&self, place: usize, local: f64, profiled: Option<[f64; 2]>) -> Estimate {
        let i = self.order[place];
        let (p, named, resting) = (&self.list[i], &self.list[place], self.resting[i]);
        let search = match i < self.split {
            true => self.state.eta[i],
            false => self.state.beta[i - self.split],
        };
        let value = p.transform.to_model(search);
        // Never surer than the curvature says, nor than the profile does.
        let reach = profiled
            .unwrap_or([0.0; 2])
            .map(|d| d.max(TWO_SIDED_95 * local));
        // `max` alone would make 0 of the NaN of a parameter that was fixed or rests on a bound.
        let search_error = match local.is_nan() {
            true => f64::NAN,
            false => local.max((reach[0] + reach[1]) / (2.0 * TWO_SIDED_95)),
        };
        let std_error = p.transform.std_error(value, search_error);
        let ci95 = if p.fixed {
            [value, value]
        } else if resting.is_some() || !search_error.is_finite() {
            [p.lower, p.upper]
        } else {
            let ends = [search - reach[0], search + reach[1]].map(|x| {
                match p.transform == Transform::Reciprocal && x <= 0.0 {
                    true => p.upper,
                    false => p.transform.to_model(x).clamp(p.lower, p.upper),
                }
            });
            [ends[0].min(ends[1]), ends[0].max(ends[1])]
        };
        let relative = std_error / value.abs();
        let identifiable = !p.fixed && resting.is_none() && determined(p, std_error, relative);
        Estimate {
            name: named.name.clone(),
            meaning: named.meaning.clone(),
            unit: p.unit.into(),
            value,
            std_error,
            ci95,
            at_bound: resting,
            identifiable,
            fixed: p.fixed,
            says: says(p, resting, identifiable, std_error, relative),
        }
    }

    /// Correlation of the free estimates: names, rows.
    pub fn correlation(&self, uncertainty: &Uncertainty) -> (Vec<String>, Vec<Vec<f64>>) {
        let order = &self.order;
        let free: Vec<usize> = (0..order.len())
            .filter(|&place| uncertainty.free[order[place]])
            .collect();
        let row = |a: usize| -> Vec<f64> {
            let others = free.iter().map(|&b| order[b]);
            others
                .map(|b| uncertainty.correlation(order[a], b))
                .collect()
        };
        let names = free.iter().map(|&place| self.list[place].name.clone());
        (names.collect(), free.iter().map(|&a| row(a)).collect())
    }

    /// Combinations of parameters that are left open, worst first.
    pub fn weak_directions(&self, uncertainty: &Uncertainty) -> Vec<WeakDirection> {
        let linear = self.state.beta.iter().zip(&self.list[self.split..]);
        let torques = linear.filter(|(_, p)| p.unit == "N m");
        let torque_size = torques.map(|(b, _)| b.abs()).fold(1e-3, f64::max);
        let size: Vec<f64> = self
            .list
            .iter()
            .enumerate()
            .map(|(i, p)| match (p.transform, p.unit) {
                (Transform::Log, _) => 1.0,
                (Transform::Reciprocal, _) => 0.05,
                (_, "N m") => torque_size,
                (_, "s") => 0.01,
                _ => self.state.beta[i - self.split].abs().max(1.0),
            })
            .collect();
        let mut names = vec![""; self.order.len()];
        for (place, &i) in self.order.iter().enumerate() {
            names[i] = &self.list[place].name;
        }
        uncertainty
            .weak_directions(&size, OPEN)
            .into_iter()
            .map(|(relative_sd, direction)| weak_direction(relative_sd, &direction, &names))
            .collect()
    }
}

/// Whether a parameter counts as determined.
fn determined(p: &Parameter, std_error: f64, relative: f64) -> bool {
    match p.transform {
        // an offset is a place on a clock: near 0 its relative error says nothing, far from it as little
        _ if is_offset(p) => std_error < 0.01,
        _ if p.unit == "N m" => std_error <= IDENTIFIABLE_TORQUE_N_M,
        // A far limit that chance brings near looks better known than it is.
        Transform::Reciprocal => relative <= IDENTIFIABLE_LIMIT,
        _ => relative <= IDENTIFIABLE,
    }
}

/// How far to trust an estimate, in words.
fn says(
    p: &Parameter,
    resting: Option<AtBound>,
    identifiable: bool,
    std_error: f64,
    relative: f64,
) -> String {
    let (torque, offset) = (p.unit == "N m", is_offset(p));
    match (p.fixed, resting) {
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
        _ if offset && identifiable => format!("determined to {:.2} ms", std_error * 1e3),
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
    }
}

/// A direction with the names of its parts.
fn weak_direction(relative_sd: f64, direction: &[f64], names: &[&str]) -> WeakDirection {
    let mut parts: Vec<(String, f64)> = direction
        .iter()
        .zip(names)
        .filter(|(share, _)| share.abs() > 0.25)
        .map(|(share, name)| (name.to_string(), *share))
        .collect();
    parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let sign = parts.first().map_or(1.0, |p| p.1.signum());
    let list = |up: bool| {
        let side = parts.iter().filter(|p| (p.1 * sign > 0.0) == up);
        side.map(|p| p.0.as_str()).collect::<Vec<_>>().join(", ")
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
}
