//! One film over all days of a sample, and what has to differ between the days: which cause moved, and on which days it stood still.
//!
//! All recordings of a sample are fitted at once with one film (moduli of a fixed set of relaxation times: a Prony series; J held). A
//! *model* is a set of at most two causes, each with a *shape* over the levels (days, batches): a partition into groups that share its value
//! ("day 1 = day 3" is one like any other; days only into runs, because what has aged does not come back), or in step with the loss of stroke, which
//! takes one number for all days. Pairwise differences are thus penalised by their number, not their size (field of Hauber et al. 2023, here with
//! L0 for L1, because the partitions of a handful of days can be counted out). Values and intervals come from a fit without penalty, with a
//! value of its own on every level.
//!
//! Models are compared by their evidence (Laplace's approximation, which is exact for a quadratic form): chi^2/f + |q|^2 + ln det(1 + F), q the
//! unknowns of the causes in units of what is expected beforehand ([`Cause::range`]), F their information with all else solved for; and -2 ln of the
//! probability beforehand of the set (each number of causes alike likely, [`Cause::odds`]) and of the shape. So a second cause that
//! the first could nearly stand for costs little where it is told little of, which one price a number (BIC) overlooks. f is the mean square of what the
//! best fit leaves times the rows over which that says the same thing, so that a misfit weakens every verdict.
//!
//! Every single cause is fitted with a value on each level. Pairs are foretold from these fits, linearised; the likeliest are fitted two
//! at a time until none is foretold to come near the best, by a margin that grows with what the fits saved beyond what was foretold.
//!
//! The position at rest shows stiffening plainly and holds how the sample was hung. It joins the evidence as one more number a recording,
//! whose scatter is known where the user states it and else one of nine from 0.02 to 1 mm, alike likely, plus 5 % of the shift for the
//! model. Where mounts scatter it decides nothing. Values and intervals do not rest on it.
//!
//! The first level is the reference: a layer, a lost area or a load that it already had is part of the film. Only the resistance is told
//! absolutely, because the film has nothing like it.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Error;
use super::sample::{marginal, noise_of, spread_times, start_film};
use super::sample_problem::{Cause, Hung, Levels, Normal, Prior, Rest, SampleProblem, Slot, hang};
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
/// Difference of the criterion up to which a model that was only foretold is fitted.
const NEAR: f64 = 12.0;
/// Fits at once, after which what is foretold is weighed again.
const AT_ONCE: usize = 2;
/// Scatter of the mounting that is thought of, m: from a marker's repeatability to a clamp set by eye.
const MOUNTS_M: [f64; 2] = [2e-5, 1e-3];
/// Values between these that are weighed.
const MOUNTS: usize = 9;
/// Accuracy of a predicted shift at rest, share of the shifts seen.
const REST_ACCURACY: f64 = 0.05;
/// Inflation of the noise below which a fit counts as down to the noise.
const MISFIT: f64 = 1.5;
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

/// A model at some values of its unknowns.
#[derive(Clone)]
struct Place {
    /// Causes with a value on every level.
    causes: Vec<Cause>,
    slots: Vec<Slot>,
    values: Vec<f64>,
}

impl Place {
    /// Value of an unknown, where it is one.
    fn get(&self, slot: Slot) -> Option<f64> {
        let j = self.slots.iter().position(|s| *s == slot)?;
        Some(self.values[j])
    }

    /// Value of a cause on a level.
    fn value(&self, cause: Cause, level: usize) -> f64 {
        let own = if self.causes.contains(&cause) {
            level
        } else {
            0
        };
        self.get(Slot::Cause(cause, own)).unwrap_or(cause.off())
    }
}

/// A fitted model.
struct Solution {
    place: Place,
    outcome: lm::Outcome,
}

/// The rows linearised at a solution, by every cause on every level and all else.
struct Linear {
    slots: Vec<Slot>,
    values: Vec<f64>,
    /// Of unknowns that rest on a bound nothing is known.
    free: Vec<bool>,
    normal: Normal,
}

/// -2 ln of the likelihood of a set of causes over the noise's inflation as a quadratic form in their values on every level, all else solved for.
struct Form {
    place: Place,
    /// By the scatter of the mounting, one of [`Data::mounts`].
    by_mount: Vec<Quadratic>,
}

struct Quadratic {
    /// The least.
    least: f64,
    /// Where, in units of the causes' ranges.
    at: DVector<f64>,
    curvature: DMatrix<f64>,
}

/// All partitions of `levels` things as group numbers by first appearance; into runs only where they are `ordered` or many.
fn partitions(levels: usize, ordered: bool) -> Vec<Partition> {
    let mut out = vec![vec![0]];
    for at in 1..levels {
        out = out
            .into_iter()
            .flat_map(|p: Partition| {
                let groups = p.iter().max().map_or(0, |m| m + 1);
                let last = p[at - 1];
                (0..=groups)
                    .filter(move |g| {
                        (levels <= FEW_LEVELS && !ordered) || *g == groups || *g == last
                    })
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

/// How a cause may go over the levels.
struct Shape {
    /// Levels of one group share the value.
    groups: Partition,
    /// Change of each level against the first by each of the shape's unknowns.
    columns: Vec<Vec<f64>>,
    /// -2 ln of its probability among those with as many unknowns.
    price: f64,
}

/// Every partition with a value a group; and in step with the `loss` of stroke, a number for all levels.
fn shapes(levels: usize, ordered: bool, loss: &[f64]) -> Vec<Shape> {
    let all = partitions(levels, ordered);
    let alike = |g: usize| all.iter().filter(|q| groups(q) == g).count() as f64;
    let mut out: Vec<Shape> = all
        .iter()
        .map(|p| Shape {
            columns: (1..groups(p))
                .map(|g| p.iter().map(|own| f64::from(u8::from(*own == g))).collect())
                .collect(),
            price: 2.0 * alike(groups(p)).ln(),
            groups: p.clone(),
        })
        .collect();
    let most = loss.iter().fold(0.0_f64, |m, l| m.max(l.abs()));
    if levels > 2 && most > 0.0 {
        out.push(Shape {
            groups: (0..levels).collect(),
            columns: vec![loss.iter().map(|l| l / most).collect()],
            price: 2.0 * alike(2).ln(),
        });
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
    /// Positions at rest of the recordings, m.
    seen_m: Vec<f64>,
    /// Scatter of the mounting where it is known, m.
    mount_m: Option<f64>,
}

impl Data<'_> {
    /// Level from which a cause has values: all but the resistance count from the first.
    fn first_level(cause: Cause) -> usize {
        usize::from(cause != Cause::SeriesResistance)
    }

    /// Film and shifts, and `causes` with a value on every level.
    fn problem(&self, causes: &[Cause]) -> SampleProblem<'_> {
        let mut slots = Vec::new();
        for cause in causes {
            let first = Self::first_level(*cause);
            slots.extend((first..self.levels).map(|l| Slot::Cause(*cause, l)));
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
            .map(|&l| Cause::ALL.map(|c| if causes.contains(&c) { l } else { 0 }))
            .collect();
        SampleProblem::new(self.hung, self.film.clone(), slots, priors, levels)
    }

    /// Values of the unknowns of `problem` at `from`; what that does not have, where a search begins.
    fn values(&self, problem: &SampleProblem, from: &Place) -> Vec<f64> {
        let value = |slot: &Slot| match *slot {
            Slot::Cause(cause, level) => from.value(cause, level),
            other => from.get(other).unwrap_or(match other {
                Slot::Modulus(n) => self.film.mu_pa[n],
                Slot::Offset(r) => self.hung[r].offset_s,
                _ => 0.0,
            }),
        };
        problem.slots.iter().map(value).collect()
    }

    fn bounds(&self, slot: &Slot) -> [f64; 2] {
        match slot {
            Slot::Cause(cause, _) => cause.bounds(),
            Slot::Modulus(0) => [1e3, 1e9],
            Slot::Modulus(_) => [0.0, 1e9],
            Slot::Offset(r) => [-0.2, 0.2].map(|v| self.hung[*r].offset_s + v),
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        }
    }

    /// Fits a model, beginning at `from`.
    fn solve(&self, causes: &[Cause], from: &Place, fine: bool) -> Result<Solution, Error> {
        let mut problem = self.problem(causes);
        problem.rest = (!fine && self.seen_m.len() > 1).then(|| Rest {
            seen_m: self.seen_m.clone(),
            sd_m: self.middle_mount(),
        });
        let bounds: Vec<[f64; 2]> = problem.slots.iter().map(|s| self.bounds(s)).collect();
        let start: Vec<f64> = self
            .values(&problem, from)
            .iter()
            .zip(&bounds)
            .map(|(s, [low, high])| s.clamp(*low, *high))
            .collect();
        let options = lm::Options {
            bounds,
            iteration_limit: 60,
            // The square of the first times the cost is what a step would still save: 0.1 of chi^2 in a thousand rows, 1e-5 in the last fit.
            gradient_tolerance: if fine { 1e-4 } else { 1e-2 },
            step_tolerance: 1e-8,
            cost_tolerance: if fine { 1e-9 } else { 1e-6 },
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
            place: Place {
                causes: causes.to_vec(),
                slots: problem.slots,
                values: outcome.parameters.clone(),
            },
            outcome,
        })
    }

    /// The film and the resistance of the first level's recordings by themselves: where the fits begin.
    fn first(&self) -> Result<(Place, usize), Error> {
        let own: Vec<usize> = (0..self.hung.len())
            .filter(|&r| self.level[r] == 0)
            .collect();
        let hung: Vec<Hung> = own.iter().map(|&r| self.hung[r].clone()).collect();
        let data = Data {
            hung: &hung,
            level: &vec![0; own.len()],
            levels: 1,
            film: self.film.clone(),
            free_offset: (0..own.len())
                .filter(|&i| self.free_offset.contains(&own[i]))
                .collect(),
            seen_m: own.iter().map(|&r| self.seen_m[r]).collect(),
            mount_m: self.mount_m,
        };
        let begin = Place {
            causes: Vec::new(),
            slots: vec![Slot::Cause(Cause::SeriesResistance, 0)],
            values: vec![START_RESISTANCE_OHM],
        };
        let mut found = data.solve(&[], &begin, false)?;
        let kept = |s: &Slot| matches!(s, Slot::Cause(..) | Slot::Modulus(_));
        let place = &mut found.place;
        let (slots, values) = place
            .slots
            .iter()
            .zip(&place.values)
            .filter(|(s, _)| kept(s))
            .unzip();
        (place.slots, place.values) = (slots, values);
        Ok((found.place, found.outcome.evaluations))
    }

    /// The problem linearised at `place`; unknowns that rest on a bound by `outcome` stay there.
    fn linear(&self, place: &Place, outcome: Option<&lm::Outcome>) -> Result<Linear, Error> {
        let problem = self.problem(&Cause::ALL);
        let values = self.values(&problem, place);
        let free = |s: &Slot| {
            let rests = || {
                let j = place.slots.iter().position(|q| q == s)?;
                let resting = &outcome?.resting[j];
                Some(matches!(resting, Resting::Lower | Resting::Upper))
            };
            matches!(s, Slot::Cause(..)) || !rests().unwrap_or(false)
        };
        Ok(Linear {
            normal: problem.normal(&values, &self.seen_m)?,
            free: problem.slots.iter().map(free).collect(),
            slots: problem.slots,
            values,
        })
    }

    /// What `linear` says of a model with `causes`, each with a value on every level; `None` where that is nothing.
    fn form(&self, linear: &Linear, causes: &[Cause], inflation: f64) -> Option<Form> {
        let problem = self.problem(causes);
        let shared = !causes.contains(&Cause::SeriesResistance);
        // The unknowns of the small model by those of the wide one: one resistance for all levels is the sum of its columns.
        let resistance = |s: &Slot| matches!(s, Slot::Cause(Cause::SeriesResistance, _));
        let tie = DMatrix::from_fn(linear.slots.len(), problem.slots.len(), |i, j| {
            let (wide, own) = (&linear.slots[i], &problem.slots[j]);
            let same = wide == own || (shared && resistance(wide) && resistance(own));
            f64::from(u8::from(same && linear.free[i]))
        });
        let n = problem.slots.len();
        let gram = tie.tr_mul(&linear.normal.gram) * &tie / inflation;
        let gradient = tie.tr_mul(&linear.normal.gradient) / inflation;
        let rest = &linear.normal.rest * &tie;
        // Scaled, because ohms and metres stand side by side.
        let scale: Vec<f64> = (0..n)
            .map(|i| match gram[(i, i)] > 0.0 {
                true => gram[(i, i)].sqrt(),
                false => 1.0,
            })
            .collect();
        let known = problem
            .slots
            .iter()
            .take_while(|s| matches!(s, Slot::Cause(c, _) if causes.contains(c)))
            .count();
        let from: Vec<f64> = problem
            .slots
            .iter()
            .map(|s| linear.slots.iter().position(|w| w == s))
            .map(|i| i.map_or(0.0, |i| linear.values[i]))
            .collect();
        let range: Vec<f64> = problem.slots[..known]
            .iter()
            .map(|s| match s {
                Slot::Cause(c, _) => c.range(),
                _ => 1.0,
            })
            .collect();
        let mut steps = Vec::new();
        let mut by_mount = Vec::new();
        for sd in self.mounts() {
            let all = &gram + rest.tr_mul(&rest) / (sd * sd);
            let mut scaled = DMatrix::from_fn(n, n, |i, j| all[(i, j)] / (scale[i] * scale[j]));
            for i in 0..n {
                scaled[(i, i)] = scaled[(i, i)] * (1.0 + 1e-10) + 1e-10;
            }
            let left = &linear.normal.rest_left;
            let right = &gradient + rest.tr_mul(left) / (sd * sd);
            let right = DVector::from_fn(n, |i, _| right[i] / scale[i]);
            let step = scaled.clone().cholesky()?.solve(&right);
            let own = marginal(&scaled, known);
            by_mount.push(Quadratic {
                least: linear.normal.square / inflation + left.norm_squared() / (sd * sd)
                    - right.dot(&step)
                    + 2.0 * (self.hung.len() - 1) as f64 * sd.ln(),
                at: DVector::from_fn(known, |i, _| (from[i] - step[i] / scale[i]) / range[i]),
                curvature: DMatrix::from_fn(known, known, |i, j| {
                    own[(i, j)] * scale[i] * range[i] * scale[j] * range[j]
                }),
            });
            steps.push(step);
        }
        let step = &steps[steps.len() / 2];
        let moved = |share: f64| -> Vec<f64> {
            (0..n)
                .map(|j| {
                    let [low, high] = self.bounds(&problem.slots[j]);
                    (from[j] - share * step[j] / scale[j]).clamp(low, high)
                })
                .collect()
        };
        let hangs = |values: &Vec<f64>| {
            (0..self.hung.len()).all(|r| {
                let s = problem.setting(r, values);
                let residual = &self.hung[r].residual;
                let length = residual.rest_length_m(&s.sample, &s.film, s.offset_s);
                length.is_ok()
            })
        };
        // A step to where a sample cannot even hang is not taken.
        let values = Some(moved(1.0)).filter(hangs).unwrap_or_else(|| moved(0.0));
        Some(Form {
            by_mount,
            place: Place {
                causes: causes.to_vec(),
                slots: problem.slots,
                values,
            },
        })
    }

    fn middle_mount(&self) -> f64 {
        let mounts = self.mounts();
        mounts[mounts.len() / 2]
    }

    /// Standard deviations of a length at rest that are weighed, m: the mounting's scatter, from exact to loose, and the accuracy of the model.
    fn mounts(&self) -> Vec<f64> {
        let n = self.seen_m.len() as f64;
        let mean = self.seen_m.iter().sum::<f64>() / n;
        let spread = self.seen_m.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let model = REST_ACCURACY * spread.sqrt();
        if let Some(mount) = self.mount_m {
            return vec![mount.max(MOUNTS_M[0]).hypot(model)];
        }
        let ratio = (MOUNTS_M[1] / MOUNTS_M[0]).powf(1.0 / (MOUNTS - 1) as f64);
        (0..MOUNTS)
            .map(|i| (MOUNTS_M[0] * ratio.powi(i as i32)).hypot(model))
            .collect()
    }
}

/// A set of causes with the best partition of each.
struct Judged {
    partitions: Vec<Partition>,
    /// -2 ln of the evidence.
    criterion: f64,
}

/// Fits `datasets` of one sample; `level` numbers each recording's level, from 0 without a hole.
///
/// # Errors
/// [`Error`], when the model cannot be run at all.
pub(super) fn joint(
    datasets: &[&HangingDataset],
    samples: &[HangingSample],
    level: &[usize],
    ordered: bool,
    loss: &[f64],
    mount_m: Option<f64>,
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
        seen_m: datasets.iter().map(|d| d.rest_below_m).collect(),
        mount_m,
    };
    let rows: usize = hung.iter().map(|h| h.residual.rows()).sum();
    let shapes = shapes(levels, ordered, loss);

    let (begin, mut evaluations) = data.first()?;
    let mut sets: Vec<Vec<Cause>> = vec![Vec::new()];
    sets.extend(Cause::ALL.map(|c| vec![c]));
    let fit = |causes: &[Cause], from: &Place| -> Result<(Solution, Linear), Error> {
        let solution = data
            .solve(causes, from, false)
            .or_else(|_| data.solve(causes, &begin, false))?;
        let linear = data.linear(&solution.place, Some(&solution.outcome))?;
        Ok((solution, linear))
    };
    let mut fitted: Vec<(Solution, Linear)> = sets
        .par_iter()
        .map(|s| fit(s, &begin))
        .collect::<Result<_, _>>()?;
    let unchanged_mean_square = fitted[0].1.normal.square
        / rows.saturating_sub(fitted[0].0.place.slots.len()).max(1) as f64;
    for (i, a) in Cause::ALL.into_iter().enumerate() {
        sets.extend(Cause::ALL.into_iter().skip(i + 1).map(|b| vec![a, b]));
    }
    let least_of = |f: &Form| {
        let by_mount = f.by_mount.iter().map(|q| q.least);
        by_mount.fold(f64::INFINITY, f64::min)
    };
    // A set of two is foretold by the half that promises more, and looked at there.
    let foretold = |set: &[Cause], inflation: f64| -> Option<Form> {
        set.iter()
            .filter_map(|half| {
                let own = fitted.iter().find(|f| f.0.place.causes == [*half])?;
                data.form(&own.1, set, inflation)
            })
            .min_by(|x, y| least_of(x).total_cmp(&least_of(y)))
    };
    let looked: Vec<(Vec<Cause>, Linear)> = sets[1 + Cause::ALL.len()..]
        .par_iter()
        .filter_map(|set| {
            let form = foretold(set, 1.0)?;
            Some((set.clone(), data.linear(&form.place, None).ok()?))
        })
        .collect();
    evaluations += looked.len();
    // What a refit saved beyond what was foretold: so far nothing else that is foretold is trusted.
    let mut surprise: f64 = 0.0;
    let (models, forms) = loop {
        let best = fitted
            .iter()
            .min_by(|a, b| a.1.normal.square.total_cmp(&b.1.normal.square))
            .unwrap_or(&fitted[0]);
        let place = &best.0.place;
        let problem = data.problem(&place.causes);
        let ended = problem.evaluate(&place.values, false)?;
        let (_, inflation) = noise_of(
            ended.iter().map(|r| r.residuals.as_slice()),
            place.slots.len(),
        );
        let inflation = inflation.max(1.0);
        let is_fitted = |set: &[Cause]| fitted.iter().find(|f| f.0.place.causes == set);
        let forms: Vec<Form> = sets
            .par_iter()
            .filter_map(|set| match is_fitted(set) {
                Some((_, linear)) => data.form(linear, set, inflation),
                None => {
                    let (_, linear) = looked.iter().find(|l| l.0 == *set)?;
                    data.form(linear, set, inflation)
                }
            })
            .collect();
        let mut models: Vec<(usize, Judged)> = forms
            .par_iter()
            .enumerate()
            .map(|(i, form)| (i, judge(&data, form, &shapes)))
            .collect();
        models.sort_by(|a, b| a.1.criterion.total_cmp(&b.1.criterion));
        // As long as nothing fits to the noise, everything is tried.
        let limit = match inflation < MISFIT {
            true => models.first().map_or(0.0, |m| m.1.criterion) + NEAR + surprise,
            false => f64::INFINITY,
        };
        let near: Vec<usize> = models
            .iter()
            .filter(|(i, j)| is_fitted(&forms[*i].place.causes).is_none() && j.criterion < limit)
            .map(|m| m.0)
            .take(AT_ONCE)
            .collect();
        if near.is_empty() {
            // A set of which a cause came to rest is a smaller set, which was fitted itself.
            models.retain(|(_, j)| j.partitions.iter().all(|p| groups(p) > 1));
            break (models, forms);
        }
        let refits: Vec<(Solution, Linear)> = near
            .par_iter()
            .map(|&i| fit(&forms[i].place.causes, &forms[i].place))
            .collect::<Result<_, _>>()?;
        for (i, refit) in near.into_iter().zip(refits) {
            if let Some(form) = data.form(&refit.1, &refit.0.place.causes, inflation) {
                surprise = surprise.max(least_of(&forms[i]) - least_of(&form));
            }
            fitted.push(refit);
        }
    };
    evaluations += fitted
        .iter()
        .map(|(s, _)| s.outcome.evaluations + s.outcome.jacobian_evaluations + 1)
        .sum::<usize>();
    type Weighed = (Vec<(Cause, Partition)>, f64, usize);
    let models: Vec<Weighed> = models
        .into_iter()
        .map(|(i, j)| {
            let causes = forms[i].place.causes.iter().copied();
            (causes.zip(j.partitions).collect(), j.criterion, i)
        })
        .collect();
    let Some(&(_, best, _)) = models.first() else {
        return Err(Error::NothingToFit(
            "no set of causes could be weighed".into(),
        ));
    };
    let weight = |m: &Weighed| (-0.5 * (m.1 - best)).exp();
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

    // Which days are alike is a verdict; values and intervals do not rest on it.
    let last = data.solve(&causes, &forms[models[0].2].place, true)?;
    let problem = data.problem(&causes);
    let p = &last.outcome.parameters;
    let ended = problem.evaluate(p, false)?;
    let (weighted_mean_square, inflation) = noise_of(
        ended.iter().map(|r| r.residuals.as_slice()),
        last.place.slots.len(),
    );
    let covariance = covariance(&problem, &last, inflation)?;
    let index = |cause: Cause, group: usize| {
        last.place
            .slots
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
            let at = |level: usize| index(cause, level);
            let value = |level: usize| last.place.value(cause, level);
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
        unchanged_mean_square,
        inflation,
        converged: last.outcome.reason.converged(),
        evaluations: evaluations + last.outcome.evaluations + last.outcome.jacobian_evaluations,
    })
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

/// The best partitions for a set of causes, and -2 ln of the evidence of the set with them.
fn judge(data: &Data, form: &Form, shapes: &[Shape]) -> Judged {
    let causes = &form.place.causes;
    let over_mounts = |by_mount: &[f64]| {
        let least = by_mount.iter().copied().fold(f64::INFINITY, f64::min);
        let sum: f64 = by_mount.iter().map(|c| (-0.5 * (c - least)).exp()).sum();
        least - 2.0 * (sum / by_mount.len() as f64).ln()
    };
    if causes.is_empty() {
        let by_mount: Vec<f64> = form.by_mount.iter().map(|q| q.least).collect();
        return Judged {
            partitions: Vec::new(),
            criterion: over_mounts(&by_mount),
        };
    }
    let known = form.by_mount[0].at.len();
    // What is beforehand less likely costs more, and so does one set of many.
    let sets = match causes.len() {
        1 => Cause::ALL.len(),
        _ => Cause::ALL.len() * (Cause::ALL.len() - 1) / 2,
    };
    let rare = causes.iter().map(|c| -2.0 * c.odds().ln()).sum::<f64>() + 2.0 * (sets as f64).ln();
    // theta = off + tie q, q of standard deviation one beforehand.
    let cost = |q: &Quadratic, chosen: &[usize]| -> f64 {
        let (at, curvature) = (&q.at, &q.curvature);
        let mut columns: Vec<DVector<f64>> = Vec::new();
        let mut gap = at.clone();
        let mut offset = 0;
        for (c, cause) in causes.iter().enumerate() {
            let first = Data::first_level(*cause);
            let mut add = |of: &dyn Fn(usize) -> f64| {
                let mut column = DVector::zeros(known);
                for level in first..data.levels {
                    column[offset + level - first] = of(level);
                }
                columns.push(column);
            };
            if first == 0 {
                add(&|_| 1.0);
            }
            for own in &shapes[chosen[c]].columns {
                add(&|level| own[level]);
            }
            for level in first..data.levels {
                gap[offset + level - first] -= cause.off() / cause.range();
            }
            offset += data.levels - first;
        }
        let (left, occam) = if columns.is_empty() {
            (gap, 0.0)
        } else {
            let tie = DMatrix::from_columns(&columns);
            let mut inner = tie.tr_mul(curvature) * &tie;
            for i in 0..inner.nrows() {
                inner[(i, i)] += 1.0;
            }
            let Some(c) = inner.cholesky() else {
                return f64::INFINITY;
            };
            let q = c.solve(&(tie.tr_mul(curvature) * &gap));
            let volume: f64 = c.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
            (gap - &tie * &q, 2.0 * volume + q.norm_squared())
        };
        let rise = (left.transpose() * curvature * &left)[(0, 0)];
        // A resistance that all levels share is no cause.
        let shared = causes.iter().position(|c| *c == Cause::SeriesResistance);
        let shared = shared.map_or(0.0, |i| {
            let before = i * (data.levels - 1);
            let own = curvature.view((before, before), (data.levels, data.levels));
            (1.0 + own.sum()).ln()
        });
        q.least + rise + occam - shared
            + rare
            + chosen.iter().map(|&c| shapes[c].price).sum::<f64>()
    };
    // Cause by cause until none changes, from every level its own value and from each cause in turn at rest.
    let finest = shapes
        .iter()
        .position(|s| s.columns.len() + 1 == data.levels)
        .unwrap_or(0);
    let n = causes.len();
    // Partitions are sought where the mounting's scatter is the likeliest.
    let all = vec![finest; n];
    let mount = form
        .by_mount
        .iter()
        .min_by(|a, b| cost(a, &all).total_cmp(&cost(b, &all)))
        .unwrap_or(&form.by_mount[0]);
    let mut best = (all.clone(), cost(mount, &all));
    for begin in 0..=n {
        let mut chosen = all.clone();
        if begin < n {
            chosen[begin] = 0;
        }
        let mut value = cost(mount, &chosen);
        loop {
            let before = value;
            for c in 0..n {
                for option in 0..shapes.len() {
                    let old = chosen[c];
                    chosen[c] = option;
                    let trial = cost(mount, &chosen);
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
        if value < best.1 {
            best = (chosen, value);
        }
    }
    let chosen = best.0;
    let by_mount: Vec<f64> = form.by_mount.iter().map(|q| cost(q, &chosen)).collect();
    Judged {
        partitions: chosen.iter().map(|&c| shapes[c].groups.clone()).collect(),
        criterion: over_mounts(&by_mount),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partitions_are_counted_by_bell_and_into_runs_beyond() {
        let count = |n: usize| partitions(n, false).len();
        assert_eq!(
            [count(1), count(2), count(3), count(4), count(5)],
            [1, 2, 5, 15, 52]
        );
        assert_eq!(count(7), 64);
        assert_eq!(partitions(4, true).len(), 8);
        assert!(partitions(4, false).contains(&vec![0, 1, 0, 2]));
    }
}
