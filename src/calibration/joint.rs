//! One film over all days of a sample, and what has to differ between the days: which cause moved, and on which days it stood still.
//!
//! All recordings of a sample are fitted at once with one film (moduli of a fixed set of relaxation times: a Prony series; J held). A
//! *model* is a set of causes, each with a partition of the levels (days, batches) into groups that share its value: "day 1 = day 3" is a
//! partition like any other, and one group for all levels is the cause that did nothing. Pairwise differences are thus penalised by
//! their number, not their size, and what survives is fitted without penalty (field of Hauber et al. 2023, here with L0 for L1, because the
//! partitions of a handful of days can be counted out).
//!
//! Models are compared by the extended BIC (Chen, Chen 2008, Biometrika 95:759): chi^2/f + k ln N + 2 ln(number of partitions with as
//! many groups). f is the mean square of what the best fit leaves times the rows over which that says the same thing, so that a misfit
//! weakens every verdict. Every set of at most two causes is fitted in full with its own value on each level; partitions of it are
//! weighed by the quadratic form of that fit, and the winner is fitted again.
//!
//! The position at rest is no part of the fits, because it holds how the sample was hung as well as how long it is. It speaks for or against a
//! model all the same: how far the mounting is reproducible is unknown, and with every order of magnitude of that scatter alike likely
//! beforehand the likelihood of the rest positions left over, e_l less their mean, is |e|^-(L - 1). Where mounts scatter, every model leaves
//! much the same |e| and nothing is decided; where they do not, the model that foretells them wins. Errors of the foretelling itself (10 % of the shift, 0.02
//! mm) bound what that can weigh.
//!
//! The first level is the reference: a layer, a lost area or a load that it already had is part of the film. Only the resistance is told
//! absolutely, because the film has nothing like it.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Error;
use super::sample::{marginal, noise_of, spread_times, start_film};
use super::sample_problem::{Cause, Hung, Levels, Prior, SampleProblem, Slot, hang};
use super::stroke::Value;
use crate::dataset::{HangingDataset, OffsetSource};
use crate::film::Film;
use crate::fit::levenberg_marquardt::{self as lm, Resting};
use crate::model::{Electrode, HangingSample};

/// Branches of the film.
const BRANCHES: usize = 6;
/// Locking constant that is held.
const LOCKING: f64 = 80.0;
/// A resistance to begin with, ohm.
const START_RESISTANCE_OHM: f64 = 5e6;
/// Levels up to which all partitions are tried, not only those into runs.
const FEW_LEVELS: usize = 5;
/// Difference of the criterion up to which a rival model counts as not told apart: odds of 20.
const RIVAL: f64 = 6.0;
/// Accuracy of a predicted shift at rest: share of the shift, and m.
const REST_ACCURACY: (f64, f64) = (0.1, 2e-5);
/// An aged electrode, on which the step of the integration is settled: a lag asks for a finer one than a film alone.
const AGED: Electrode = Electrode {
    modulus_pa: 2e5,
    resistance_ohm: 3e8,
    active_fraction: 1.0,
};
/// Position at rest beyond the mean of the first frames, m.
const SHIFT_PRIOR_M: f64 = 1e-3;

/// A cause over the levels.
#[derive(Debug, Clone, PartialEq)]
pub struct CauseFound {
    /// Which.
    pub cause: Cause,
    /// Probability that it changed.
    pub probability: f64,
    /// Whether the chosen model has it.
    pub in_model: bool,
    /// Group of each level; levels of one group share the value. Empty unless in the model.
    pub groups: Vec<usize>,
    /// Value on each level; the first is the reference. Empty unless in the model.
    pub by_level: Vec<Value>,
    /// Change of each level against the first.
    pub change: Vec<Value>,
    /// Whether the value rests on a bound somewhere.
    pub at_bound: bool,
}

/// A sample fitted over its levels.
#[derive(Debug, Clone)]
pub struct Joint {
    /// The film of the first level.
    pub film: Film,
    /// Every cause, most probable first.
    pub causes: Vec<CauseFound>,
    /// Pairs of causes of which one could stand for the other.
    pub confused: Vec<[Cause; 2]>,
    /// Probability that nothing changed.
    pub nothing: f64,
    /// What each level's sample is by the chosen model.
    pub samples: Vec<HangingSample>,
    /// Factor on the film's moduli on each level.
    pub film_factor: Vec<f64>,
    /// Length at rest on each level, m.
    pub rest_length_m: Vec<f64>,
    /// Mean square of (predicted minus captured x)/noise.
    pub weighted_mean_square: f64,
    /// The same with one set of values for all levels.
    pub unchanged_mean_square: f64,
    /// Factor on variances for what the residuals say twice.
    pub inflation: f64,
    /// Whether the last fit converged.
    pub converged: bool,
    /// Evaluations of all fits.
    pub evaluations: usize,
}

/// Groups of the levels, one list a cause of a model.
type Partition = Vec<usize>;

/// A fitted model.
struct Solution {
    causes: Vec<Cause>,
    partitions: Vec<Partition>,
    slots: Vec<Slot>,
    outcome: lm::Outcome,
    /// Sum of squares of the data, unweighted by f.
    square: f64,
}

impl Solution {
    /// Value of a cause on a level.
    fn value(&self, cause: Cause, level: usize) -> f64 {
        let group = match self.causes.iter().position(|c| *c == cause) {
            Some(i) => self.partitions[i][level],
            None => 0,
        };
        self.slots
            .iter()
            .position(|s| *s == Slot::Cause(cause, group))
            .map_or(cause.off(), |j| self.outcome.parameters[j])
    }
}

/// All partitions of `levels` things as group numbers by first appearance; into runs only where there are many.
fn partitions(levels: usize) -> Vec<Partition> {
    let mut out = vec![vec![0]];
    for at in 1..levels {
        out = out
            .into_iter()
            .flat_map(|p: Partition| {
                let groups = p.iter().max().map_or(0, |m| m + 1);
                let last = p[at - 1];
                (0..=groups)
                    .filter(move |g| levels <= FEW_LEVELS || *g == groups || *g == last)
                    .map(move |g| {
                        let mut q = p.clone();
                        q.push(g);
                        q
                    })
                    .collect::<Vec<_>>()
            })
            .collect();
    }
    out
}

fn groups(p: &Partition) -> usize {
    p.iter().max().map_or(1, |m| m + 1)
}

/// The data of a sample.
struct Data<'a> {
    hung: &'a [Hung<'a>],
    level: &'a [usize],
    levels: usize,
    film: Film,
    free_offset: Vec<usize>,
}

impl Data<'_> {
    fn each(&self) -> Partition {
        (0..self.levels).collect()
    }

    fn problem(&self, causes: &[Cause], partitions: &[Partition]) -> SampleProblem<'_> {
        let mut slots = Vec::new();
        for (cause, partition) in causes.iter().zip(partitions) {
            let first = usize::from(*cause != Cause::SeriesResistance);
            slots.extend((first..groups(partition)).map(|g| Slot::Cause(*cause, g)));
        }
        if !causes.contains(&Cause::SeriesResistance) {
            slots.push(Slot::Cause(Cause::SeriesResistance, 0));
        }
        slots.extend((0..self.film.mu_pa.len()).map(Slot::Modulus));
        slots.extend((0..self.hung.len()).map(Slot::Shift));
        slots.extend(self.free_offset.iter().map(|&r| Slot::Offset(r)));
        let priors: Vec<Prior> = slots
            .iter()
            .map(|s| matches!(s, Slot::Shift(_)).then_some((0.0, SHIFT_PRIOR_M)))
            .collect();
        let levels: Vec<Levels> = self
            .level
            .iter()
            .map(|&l| {
                let mut out = [0; 5];
                for (cause, partition) in causes.iter().zip(partitions) {
                    out[*cause as usize] = partition[l];
                }
                out
            })
            .collect();
        SampleProblem::new(self.hung, self.film.clone(), slots, priors, levels)
    }

    /// Fits a model, beginning at `from`.
    fn solve(
        &self,
        causes: &[Cause],
        partitions: &[Partition],
        from: Option<&Solution>,
        fine: bool,
    ) -> Result<Solution, Error> {
        let problem = self.problem(causes, partitions);
        let start: Vec<f64> = problem
            .slots
            .iter()
            .map(|slot| match *slot {
                Slot::Cause(cause, group) => {
                    let level = causes
                        .iter()
                        .position(|c| *c == cause)
                        .and_then(|i| partitions[i].iter().position(|g| *g == group))
                        .unwrap_or(0);
                    match from {
                        Some(f) => f.value(cause, level),
                        None if cause == Cause::SeriesResistance => START_RESISTANCE_OHM,
                        None => cause.off(),
                    }
                }
                other => from
                    .and_then(|f| {
                        let j = f.slots.iter().position(|s| *s == other)?;
                        Some(f.outcome.parameters[j])
                    })
                    .unwrap_or(match other {
                        Slot::Modulus(n) => self.film.mu_pa[n],
                        Slot::Offset(r) => self.hung[r].offset_s,
                        _ => 0.0,
                    }),
            })
            .collect();
        let bounds: Vec<[f64; 2]> = problem
            .slots
            .iter()
            .zip(&start)
            .map(|(slot, s)| match slot {
                Slot::Cause(cause, _) => cause.bounds(),
                Slot::Modulus(0) => [1e3, 1e9],
                Slot::Modulus(_) => [0.0, 1e9],
                Slot::Offset(_) => [s - 0.2, s + 0.2],
                _ => [f64::NEG_INFINITY, f64::INFINITY],
            })
            .collect();
        // A start on or beyond a bound of this model comes from a rival.
        let start: Vec<f64> = start
            .iter()
            .zip(&bounds)
            .map(|(s, [low, high])| s.clamp(*low, *high))
            .collect();
        let options = lm::Options {
            bounds,
            iteration_limit: 60,
            // The square of the first times the cost is what a step would still save: 0.004 of chi^2 in a thousand rows.
            gradient_tolerance: if fine { 1e-4 } else { 2e-3 },
            step_tolerance: 1e-8,
            cost_tolerance: if fine { 1e-9 } else { 1e-7 },
            polish_limit: 0,
            ..lm::Options::default()
        };
        let outcome = lm::minimise(&problem, &start, &options)
            .map_err(|misuse| Error::NothingToFit(misuse.to_string()))?;
        if !outcome.cost.is_finite() {
            return Err(Error::AllStartsFailed {
                tried: 1,
                last: outcome.last_failure.map(|f| f.message).unwrap_or_default(),
            });
        }
        Ok(Solution {
            causes: causes.to_vec(),
            partitions: partitions.to_vec(),
            square: 2.0 * outcome.cost,
            slots: problem.slots,
            outcome,
        })
    }
}

/// A set of causes with the best partition of each.
struct Judged {
    causes: Vec<Cause>,
    partitions: Vec<Partition>,
    criterion: f64,
    solution: usize,
}

/// Fits `datasets` of one sample; `level` numbers each recording's level, from 0 without a hole.
///
/// # Errors
/// [`Error`], when the model cannot be run at all.
pub(super) fn joint(
    datasets: &[&HangingDataset],
    samples: &[HangingSample],
    level: &[usize],
) -> Result<Joint, Error> {
    let levels = level.iter().max().map_or(0, |m| m + 1);
    let film = start_film(spread_times(BRANCHES, datasets), LOCKING);
    let aged: Vec<HangingSample> = samples
        .iter()
        .map(|s| HangingSample {
            electrode: AGED,
            ..*s
        })
        .collect();
    let mut hung = hang(datasets, &aged, &film)?;
    for (h, sample) in hung.iter_mut().zip(samples) {
        h.sample = *sample;
    }
    let data = Data {
        hung: &hung,
        level,
        levels,
        film,
        free_offset: (0..datasets.len())
            .filter(|&r| datasets[r].offset_source == OffsetSource::Free)
            .collect(),
    };
    let rows: usize = hung.iter().map(|h| h.residual.rows()).sum();

    let none = data.solve(&[], &[], None, false)?;
    let mut all = vec![none];
    let singles: Vec<Solution> = Cause::ALL
        .into_par_iter()
        .map(|c| data.solve(&[c], &[data.each()], Some(&all[0]), false))
        .collect::<Result<_, _>>()?;
    all.extend(singles);
    let mut pairs = Vec::new();
    for (i, a) in Cause::ALL.into_iter().enumerate() {
        for b in Cause::ALL.into_iter().skip(i + 1) {
            pairs.push([a, b]);
        }
    }
    let pairs: Vec<Solution> = pairs
        .into_par_iter()
        .map(|pair| {
            // From the better of its two halves.
            let half = pair
                .iter()
                .map(|c| &all[1 + *c as usize])
                .min_by(|a, b| a.square.total_cmp(&b.square));
            data.solve(&pair, &[data.each(), data.each()], half, false)
        })
        .collect::<Result<_, _>>()?;
    all.extend(pairs);
    let least = all
        .iter()
        .min_by(|a, b| a.square.total_cmp(&b.square))
        .unwrap_or(&all[0]);
    let problem = data.problem(&least.causes, &least.partitions);
    let ended = problem.evaluate(&least.outcome.parameters, false)?;
    let (_, inflation) = noise_of(
        ended.iter().map(|r| r.residuals.as_slice()),
        least.slots.len(),
    );

    let seen: Vec<f64> = (0..levels)
        .map(|l| {
            let own: Vec<f64> = (0..datasets.len())
                .filter(|&r| level[r] == l)
                .map(|r| datasets[r].rest_below_m)
                .collect();
            own.iter().sum::<f64>() / own.len().max(1) as f64
        })
        .collect();
    let at_rest: Vec<f64> = all
        .par_iter()
        .map(|s| rest_criterion(&data, s, &seen))
        .collect::<Result<_, _>>()?;

    let ln_n = (rows as f64 / (inflation.max(1.0))).ln();
    let choices = partitions(levels);
    let alike = |p: &Partition| {
        let g = groups(p);
        choices.iter().filter(|q| groups(q) == g).count() as f64
    };
    let price: Vec<f64> = choices
        .iter()
        .map(|p| (groups(p) - 1) as f64 * ln_n + 2.0 * alike(p).ln())
        .collect();
    let judged: Vec<Judged> = all
        .par_iter()
        .enumerate()
        .map(|(number, s)| {
            let mut judged = judge(&data, s, number, inflation, &choices, &price)?;
            judged.criterion += at_rest[number];
            Ok(judged)
        })
        .collect::<Result<_, Error>>()?;
    let key = |j: &Judged| -> Vec<(Cause, Partition)> {
        j.causes
            .iter()
            .copied()
            .zip(j.partitions.iter().cloned())
            .filter(|(_, p)| groups(p) > 1)
            .collect()
    };
    type Weighed = (Vec<(Cause, Partition)>, f64, usize);
    let mut models: Vec<Weighed> = Vec::new();
    for j in &judged {
        let k = key(j);
        // A set of which a cause came to rest is a smaller set, which was fitted itself.
        if k.len() == j.causes.len() {
            models.push((k, j.criterion, j.solution));
        }
    }
    models.sort_by(|a, b| a.1.total_cmp(&b.1));
    let best = models[0].1;
    let weight = |m: &(Vec<(Cause, Partition)>, f64, usize)| (-0.5 * (m.1 - best)).exp();
    let sum: f64 = models.iter().map(weight).sum();
    let probability = |cause: Cause| -> f64 {
        models
            .iter()
            .filter(|m| m.0.iter().any(|(c, _)| *c == cause))
            .map(weight)
            .fold(0.0, |a, b| a + b)
            / sum
    };
    let nothing = models
        .iter()
        .filter(|m| m.0.is_empty())
        .map(weight)
        .sum::<f64>()
        / sum;
    let chosen = &models[0].0;
    let causes: Vec<Cause> = chosen.iter().map(|c| c.0).collect();
    let parts: Vec<Partition> = chosen.iter().map(|c| c.1.clone()).collect();

    // Rivals that swap one cause for another at hardly any price.
    let mut confused = Vec::new();
    for (other, criterion, _) in &models[1..] {
        if criterion - best > RIVAL || other.len() != chosen.len() {
            continue;
        }
        let theirs: Vec<Cause> = other.iter().map(|c| c.0).collect();
        let lost: Vec<Cause> = causes
            .iter()
            .copied()
            .filter(|c| !theirs.contains(c))
            .collect();
        let won: Vec<Cause> = theirs
            .iter()
            .copied()
            .filter(|c| !causes.contains(c))
            .collect();
        if let ([a], [b]) = (lost.as_slice(), won.as_slice())
            && !confused.contains(&[*a, *b])
        {
            confused.push([*a, *b]);
        }
    }

    let last = data.solve(&causes, &parts, Some(&all[models[0].2]), true)?;
    let problem = data.problem(&causes, &parts);
    let p = &last.outcome.parameters;
    let ended = problem.evaluate(p, false)?;
    let (weighted_mean_square, inflation) = noise_of(
        ended.iter().map(|r| r.residuals.as_slice()),
        last.slots.len(),
    );
    let covariance = covariance(&problem, &last, inflation)?;
    let index = |cause: Cause, group: usize| {
        last.slots
            .iter()
            .position(|s| *s == Slot::Cause(cause, group))
    };
    let variance = |i: Option<usize>, j: Option<usize>| match (i, j) {
        (Some(i), Some(j)) => covariance[(i, j)],
        _ => 0.0,
    };
    let mut found: Vec<CauseFound> = Cause::ALL
        .into_iter()
        .map(|cause| {
            let place = causes.iter().position(|c| *c == cause);
            let partition = place.map(|i| parts[i].clone()).unwrap_or_default();
            let at = |level: usize| index(cause, partition[level]);
            let value = |level: usize| last.value(cause, level);
            let by_level = (0..partition.len())
                .map(|l| Value {
                    value: value(l),
                    std_error: variance(at(l), at(l)).max(0.0).sqrt(),
                })
                .collect();
            let change = (0..partition.len())
                .map(|l| {
                    let (i, o) = (at(l), at(0));
                    let square = variance(i, i) + variance(o, o) - 2.0 * variance(i, o);
                    Value {
                        value: value(l) - value(0),
                        std_error: square.max(0.0).sqrt(),
                    }
                })
                .collect();
            let at_bound = (0..partition.len())
                .filter_map(at)
                .any(|i| matches!(last.outcome.resting[i], Resting::Lower | Resting::Upper));
            CauseFound {
                cause,
                probability: probability(cause),
                in_model: place.is_some(),
                groups: partition,
                by_level,
                change,
                at_bound,
            }
        })
        .collect();
    found.sort_by(|a, b| {
        b.in_model
            .cmp(&a.in_model)
            .then(b.probability.total_cmp(&a.probability))
    });
    let first_of = |l: usize| level.iter().position(|x| *x == l).unwrap_or(0);
    let settings: Vec<_> = (0..levels)
        .map(|l| problem.setting(first_of(l), p))
        .collect();
    Ok(Joint {
        film: {
            let s = problem.setting(first_of(0), p);
            let mut film = s.film;
            for mu in &mut film.mu_pa {
                *mu /= s.film_factor;
            }
            film
        },
        causes: found,
        confused,
        nothing,
        samples: settings.iter().map(|s| s.sample).collect(),
        film_factor: settings.iter().map(|s| s.film_factor).collect(),
        rest_length_m: (0..levels)
            .map(|l| ended[first_of(l)].run.rest_length_m)
            .collect(),
        weighted_mean_square,
        unchanged_mean_square: all[0].square
            / rows.saturating_sub(all[0].slots.len()).max(1) as f64,
        inflation,
        converged: last.outcome.reason.converged(),
        evaluations: all
            .iter()
            .chain([&last])
            .map(|s| s.outcome.evaluations + s.outcome.jacobian_evaluations)
            .sum(),
    })
}

/// -2 ln of the likelihood of the positions at rest, `seen` by level, under a model (see the module), up to a constant.
fn rest_criterion(data: &Data, solution: &Solution, seen: &[f64]) -> Result<f64, Error> {
    let problem = data.problem(&solution.causes, &solution.partitions);
    let rows = problem.evaluate(&solution.outcome.parameters, false)?;
    let left: Vec<f64> = (0..data.levels)
        .map(|l| {
            let own: Vec<f64> = (0..rows.len())
                .filter(|&r| data.level[r] == l)
                .map(|r| rows[r].run.rest_length_m)
                .collect();
            seen[l] - own.iter().sum::<f64>() / own.len().max(1) as f64
        })
        .collect();
    let n = seen.len() as f64;
    let spread = |v: &[f64]| {
        let mean = v.iter().sum::<f64>() / n;
        v.iter().map(|x| (x - mean).powi(2)).sum::<f64>()
    };
    let floor = (n - 1.0) * REST_ACCURACY.1.powi(2) + REST_ACCURACY.0.powi(2) * spread(seen);
    Ok((n - 1.0) * (spread(&left) + floor).ln())
}

/// Covariance of a solution's parameters, those at rest on a bound held.
fn covariance(
    problem: &SampleProblem,
    solution: &Solution,
    inflation: f64,
) -> Result<DMatrix<f64>, Error> {
    let mut gram = problem.gram(&solution.outcome.parameters)?;
    for (j, prior) in problem.priors.iter().enumerate() {
        if let Some((_, sd)) = prior {
            gram[(j, j)] += sd.powi(-2);
        }
    }
    let free: Vec<usize> = (0..gram.nrows())
        .filter(|&j| solution.outcome.resting[j] == Resting::Free && gram[(j, j)] > 0.0)
        .collect();
    let scale: Vec<f64> = free.iter().map(|&j| gram[(j, j)].sqrt()).collect();
    let k = free.len();
    let mut scaled = DMatrix::from_fn(k, k, |a, b| {
        gram[(free[a], free[b])] / (scale[a] * scale[b])
    });
    for a in 0..k {
        scaled[(a, a)] += 1e-12;
    }
    let inverse = match scaled.clone().cholesky() {
        Some(c) => c.inverse(),
        None => scaled
            .pseudo_inverse(1e-12)
            .map_err(|what| Error::NothingToFit(what.into()))?,
    };
    let mut out = DMatrix::zeros(gram.nrows(), gram.nrows());
    for a in 0..k {
        for b in 0..k {
            out[(free[a], free[b])] = inflation * inverse[(a, b)] / (scale[a] * scale[b]);
        }
    }
    Ok(out)
}

/// The best partitions for a set of causes that was fitted with a value on every level, by the quadratic form of that fit.
fn judge(
    data: &Data,
    solution: &Solution,
    number: usize,
    inflation: f64,
    choices: &[Partition],
    price: &[f64],
) -> Result<Judged, Error> {
    let base = solution.square / inflation;
    if solution.causes.is_empty() {
        return Ok(Judged {
            causes: Vec::new(),
            partitions: Vec::new(),
            criterion: base,
            solution: number,
        });
    }
    let problem = data.problem(&solution.causes, &solution.partitions);
    let known = problem
        .slots
        .iter()
        .take_while(|s| matches!(s, Slot::Cause(c, _) if solution.causes.contains(c)))
        .count();
    // In units of a change worth a look, so that the form is well scaled.
    let size: Vec<f64> = problem.slots[..known]
        .iter()
        .map(|s| match s {
            Slot::Cause(c, _) => c.size(),
            _ => 1.0,
        })
        .collect();
    let gram = problem.gram(&solution.outcome.parameters)?;
    let form = marginal(&gram, known);
    let form = DMatrix::from_fn(known, known, |a, b| {
        form[(a, b)] * size[a] * size[b] / inflation
    });
    let at = DVector::from_fn(known, |j, _| solution.outcome.parameters[j] / size[j]);
    // theta = fixed + tie q: the levels of a group share a value, the first level's group is the reference.
    let cost = |chosen: &[usize]| -> f64 {
        let mut fixed = DVector::zeros(known);
        let mut columns: Vec<DVector<f64>> = Vec::new();
        let mut offset = 0;
        for (c, cause) in solution.causes.iter().enumerate() {
            let partition = &choices[chosen[c]];
            let absolute = *cause == Cause::SeriesResistance;
            let first = usize::from(!absolute);
            for group in 0..groups(partition) {
                let mut column = DVector::zeros(known);
                for (level, g) in partition.iter().enumerate() {
                    if *g == group && level >= first {
                        column[offset + level - first] = 1.0;
                    }
                }
                if group == 0 && !absolute {
                    for (f, v) in fixed.iter_mut().zip(column.iter()) {
                        *f += v * cause.off() / cause.size();
                    }
                } else {
                    columns.push(column);
                }
            }
            offset += data.levels - first;
        }
        let gap = &at - &fixed;
        let left = if columns.is_empty() {
            gap
        } else {
            let tie = DMatrix::from_columns(&columns);
            let mut inner = tie.transpose() * &form * &tie;
            for i in 0..inner.nrows() {
                inner[(i, i)] *= 1.0 + 1e-12;
                inner[(i, i)] += 1e-12;
            }
            let right = tie.transpose() * &form * &gap;
            match inner.cholesky() {
                Some(c) => &gap - &tie * c.solve(&right),
                None => return f64::INFINITY,
            }
        };
        let rise = (left.transpose() * &form * &left)[(0, 0)];
        rise + chosen.iter().map(|&c| price[c]).sum::<f64>()
    };
    // Cause by cause until none changes, from every level its own value and from each cause in turn at rest.
    let finest = choices
        .iter()
        .position(|p| groups(p) == data.levels)
        .unwrap_or(0);
    let mut best: Option<(Vec<usize>, f64)> = None;
    let n = solution.causes.len();
    for begin in 0..=n {
        let mut chosen = vec![finest; n];
        if begin < n {
            chosen[begin] = 0;
        }
        let mut value = cost(&chosen);
        loop {
            let before = value;
            for c in 0..n {
                for option in 0..choices.len() {
                    let old = chosen[c];
                    chosen[c] = option;
                    let trial = cost(&chosen);
                    if trial < value {
                        value = trial;
                    } else {
                        chosen[c] = old;
                    }
                }
            }
            if value >= before {
                break;
            }
        }
        if best.as_ref().is_none_or(|b| value < b.1) {
            best = Some((chosen, value));
        }
    }
    let (chosen, value) = best.unwrap_or((vec![finest; n], f64::INFINITY));
    Ok(Judged {
        causes: solution.causes.clone(),
        partitions: chosen.iter().map(|&c| choices[c].clone()).collect(),
        criterion: base + value,
        solution: number,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partitions_are_counted_by_bell_and_into_runs_beyond() {
        let count = |n: usize| partitions(n).len();
        assert_eq!(
            [count(1), count(2), count(3), count(4), count(5)],
            [1, 2, 5, 15, 52]
        );
        assert_eq!(count(7), 64);
        assert!(partitions(4).contains(&vec![0, 1, 0, 2]));
    }
}
