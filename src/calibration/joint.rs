//! One film over all days of a sample or a robot, and what has to differ between the days: which cause moved,
//! and on which days it stood still. How their recordings are fitted is theirs (`Aged`).
//!
//! All recordings are fitted at once with one film (of a sample: moduli of a fixed set of relaxation times, a
//! Prony series; J held). A *model* is a set of at most two causes, each with a *shape* over the levels
//! (days, batches): a partition into groups that share its value ("day 1 = day 3" is one like any other; days
//! only into runs, because what has aged does not come back), or in step with the loss of stroke or with a
//! power of the days, which takes one number for all; two causes may share theirs. Pairwise differences are
//! thus penalised by their number, not their size (field of Hauber et al. 2023, here with L0 for L1, because
//! the partitions of a handful of days can be counted out). Values and intervals come from a fit without
//! penalty, with a value of its own on every level.
//!
//! Models are compared by their evidence (Laplace's approximation, which is exact for a quadratic form):
//! chi^2/f + |q|^2 + ln det(1 + F), q the unknowns of the causes in units of what is expected beforehand
//! ([`Cause::range`]), F their information with all else solved for; and -2 ln of the probability beforehand
//! of the set (each number of causes alike likely, [`Cause::odds`]) and of the shape; over days also of the
//! way in which an electrode ages ([`Cause::way`]). So a second cause that the first could nearly stand for
//! costs little where it is told little of, which one price a number (BIC) overlooks. f is the mean square of
//! what the best fit leaves times the rows over which that says the same thing, so that a misfit weakens
//! every verdict.
//!
//! Every single cause is fitted with a value on each level. Pairs are foretold from these fits, linearised;
//! the likeliest are fitted two at a time until none is foretold to come near the best, by a margin that
//! grows with what the fits saved beyond what was foretold.
//!
//! The position at rest of a hanging sample shows stiffening plainly and holds how it was hung. It joins the
//! evidence as one more number a recording, whose scatter is known where the user states it and else one of
//! nine from 0.02 to 1 mm, alike likely, plus 5 % of the shift for the model. Where mounts scatter it decides
//! nothing. Values and intervals do not rest on it.
//!
//! The first level is the reference: a layer, a lost area or a load that it already had is part of the film.
//! Only the resistance is told absolutely, because the film has nothing like it.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;
use statrs::function::erf::erfc;

use super::Error;
use super::aged::{Aged, Cause, LevelModel, Minimum, Normal, Place, Slot};
use super::sample::marginal;
use super::stroke::Value;
use crate::film::Film;
use crate::model::ForearmTorque;

/// Levels up to which all partitions are tried, not only those into runs.
const FEW_LEVELS: usize = 5;
/// Difference of the criterion up to which a rival model counts as not told apart: odds of 20.
const RIVAL: f64 = 6.0;
/// Difference of the criterion up to which a model that was only foretold is fitted.
const NEAR: f64 = 12.0;
/// Fits at once, after which what is foretold is weighed again.
const AT_ONCE: usize = 2;
/// Exponents of the days since the first with which a change is thought to go: from diffusion's to one that
/// gathers speed.
const POWERS: [f64; 4] = [0.5, 0.75, 1.0, 1.35];
/// Share of an electrode's changes over days that are thought to go the other way: a better contact, a layer
/// that cracks.
const BACKWARDS: f64 = 0.05;
/// Inflation of the noise below which a fit counts as down to the noise.
const MISFIT: f64 = 1.5;
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

/// A sample, or a robot, fitted over its levels.
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
    /// The forearms of a robot.
    pub forearm: Option<ForearmTorque>,
    /// Each level by the chosen model.
    pub levels: Vec<LevelModel>,
    /// Mean square of (predicted minus captured)/noise: x of a sample, torques of a robot.
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

/// The rows linearised at a solution, by every cause on every level and all else.
struct Linear {
    place: Place,
    /// Of unknowns that rest on a bound nothing is known.
    free: Vec<bool>,
    normal: Normal,
}

/// -2 ln of the likelihood of a set of causes over the noise's inflation as a quadratic form in their values
/// on every level, all else solved for.
struct Form {
    place: Place,
    /// By the scatter of the mounting, one of [`Aged::mounts`].
    by_mount: Vec<Quadratic>,
}

struct Quadratic {
    /// The least.
    least: f64,
    /// Where, in units of the causes' ranges.
    at: DVector<f64>,
    curvature: DMatrix<f64>,
}

/// All partitions of `levels` things as group numbers by first appearance; into runs only where they are
/// `ordered` or many.
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

/// Every partition with a value a group; in step with the `loss` of stroke, a number for all levels; and
/// where `days` are known as a power of the time since the first, a number too.
fn shapes(days: Option<&[f64]>, loss: &[f64]) -> Vec<Shape> {
    let (levels, ordered) = (loss.len(), days.is_some());
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
    // One number more, one for all levels.
    let mut alone = |course: Vec<f64>, beside: usize| {
        let most = course.iter().fold(0.0_f64, |m, c| m.max(c.abs()));
        if levels > 2 && most > 0.0 {
            out.push(Shape {
                groups: (0..levels).collect(),
                columns: vec![course.iter().map(|c| c / most).collect()],
                price: 2.0 * (alike(2) * beside as f64).ln(),
            });
        }
    };
    alone(loss.to_vec(), 1);
    if let Some(days) = days {
        for power in POWERS {
            let course = days.iter().map(|d| (d - days[0]).max(0.0).powf(power));
            alone(course.collect(), POWERS.len());
        }
    }
    out
}

fn groups(p: &Partition) -> usize {
    p.iter().max().map_or(1, |m| m + 1)
}

/// Fits a model, beginning at `from`.
fn solve<A: Aged>(aged: &A, causes: &[Cause], from: &Place, fine: bool) -> Result<Minimum, Error> {
    let Place { slots, values, .. } = aged.place(causes, from);
    let within = |(slot, value): (&Slot, &f64)| {
        let [low, high] = aged.bounds(slot);
        value.clamp(low, high)
    };
    let start: Vec<f64> = slots.iter().zip(&values).map(within).collect();
    aged.minimise(causes, slots, &start, fine)
}

/// The problem with every cause on every level linearised at `place`; unknowns that rest on a bound by
/// `found` stay there.
fn linear<A: Aged>(aged: &A, place: &Place, found: Option<&Minimum>) -> Result<Linear, Error> {
    let wide = aged.place(&Cause::ALL, place);
    let free = |s: &Slot| {
        let rests = || {
            let found = found?;
            let j = found.place.slots.iter().position(|q| q == s)?;
            Some(found.resting[j])
        };
        matches!(s, Slot::Cause(..)) || !rests().unwrap_or(false)
    };
    Ok(Linear {
        normal: aged.normal(&wide)?,
        free: wide.slots.iter().map(free).collect(),
        place: wide,
    })
}

/// What `linear` says of a model with `causes`, each with a value on every level; `None` where that is
/// nothing.
fn form<A: Aged>(aged: &A, linear: &Linear, causes: &[Cause], inflation: f64) -> Option<Form> {
    let slots = aged.slots(causes);
    let shared = !causes.contains(&Cause::SeriesResistance);
    // The unknowns of the small model by those of the wide one: one resistance for all levels is the sum of
    // its columns.
    let resistance = |s: &Slot| matches!(s, Slot::Cause(Cause::SeriesResistance, _));
    let tie = DMatrix::from_fn(linear.place.slots.len(), slots.len(), |i, j| {
        let (wide, own) = (&linear.place.slots[i], &slots[j]);
        let same = wide == own || (shared && resistance(wide) && resistance(own));
        f64::from(u8::from(same && linear.free[i]))
    });
    let n = slots.len();
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
    let known = slots
        .iter()
        .take_while(|s| matches!(s, Slot::Cause(c, _) if causes.contains(c)))
        .count();
    let from: Vec<f64> = slots
        .iter()
        .map(|s| linear.place.slots.iter().position(|w| w == s))
        .map(|i| i.map_or(0.0, |i| linear.place.values[i]))
        .collect();
    let range: Vec<f64> = slots[..known]
        .iter()
        .map(|s| match s {
            Slot::Cause(c, _) => c.range(),
            _ => 1.0,
        })
        .collect();
    let mut steps = Vec::new();
    let mut by_mount = Vec::new();
    for sd in aged.mounts() {
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
                + 2.0 * left.len().saturating_sub(1) as f64 * sd.ln(),
            at: DVector::from_fn(known, |i, _| (from[i] - step[i] / scale[i]) / range[i]),
            curvature: DMatrix::from_fn(known, known, |i, j| {
                own[(i, j)] * scale[i] * range[i] * scale[j] * range[j]
            }),
        });
        steps.push(step);
    }
    let step = &steps[steps.len() / 2];
    let moved = |share: f64| Place {
        causes: causes.to_vec(),
        slots: slots.clone(),
        values: (0..n)
            .map(|j| {
                let [low, high] = aged.bounds(&slots[j]);
                (from[j] - share * step[j] / scale[j]).clamp(low, high)
            })
            .collect(),
    };
    // A step to where a sample cannot even hang is not taken.
    let place = Some(moved(1.0))
        .filter(|p| aged.possible(p))
        .unwrap_or_else(|| moved(0.0));
    Some(Form { by_mount, place })
}

/// A set of causes with the best partition of each.
struct Judged {
    partitions: Vec<Partition>,
    /// -2 ln of the evidence.
    criterion: f64,
}

/// A model that was weighed, and where it is thought to lie.
struct Model {
    causes: Vec<(Cause, Partition)>,
    /// -2 ln of the evidence.
    criterion: f64,
    place: Place,
}

impl Form {
    fn least(&self) -> f64 {
        let by_mount = self.by_mount.iter().map(|q| q.least);
        by_mount.fold(f64::INFINITY, f64::min)
    }
}

/// The search for the sets of causes that could be meant.
struct Search<'a, A> {
    aged: &'a A,
    shapes: Vec<Shape>,
    /// Whether the levels are days.
    ordered: bool,
    /// Where fits begin that lead nowhere from elsewhere.
    begin: Place,
    /// Nothing, every cause, every pair of them.
    sets: Vec<Vec<Cause>>,
    /// Those that were fitted; nothing is the first.
    fitted: Vec<(Minimum, Linear)>,
    /// Pairs that were linearised where they are foretold.
    looked: Vec<(Vec<Cause>, Linear)>,
}

impl<'a, A: Aged> Search<'a, A> {
    /// Every single cause fitted, every pair looked at; and the evaluations that came before.
    fn begun(aged: &'a A, shapes: Vec<Shape>, ordered: bool) -> Result<(Self, usize), Error> {
        let (begin, evaluations) = aged.first()?;
        let mut sets: Vec<Vec<Cause>> = vec![Vec::new()];
        sets.extend(Cause::ALL.map(|c| vec![c]));
        let singles = sets.len();
        for (i, a) in Cause::ALL.into_iter().enumerate() {
            sets.extend(Cause::ALL.into_iter().skip(i + 1).map(|b| vec![a, b]));
        }
        let mut out = Search {
            aged,
            shapes,
            ordered,
            begin,
            sets,
            fitted: Vec::new(),
            looked: Vec::new(),
        };
        out.fitted = out.sets[..singles]
            .par_iter()
            .map(|s| out.fit(s, &out.begin))
            .collect::<Result<_, _>>()?;
        out.looked = out.sets[singles..]
            .par_iter()
            .filter_map(|set| {
                let form = out.foretold(set)?;
                Some((set.clone(), linear(aged, &form.place, None).ok()?))
            })
            .collect();
        let evaluations = evaluations + out.looked.len();
        Ok((out, evaluations))
    }

    fn fit(&self, causes: &[Cause], from: &Place) -> Result<(Minimum, Linear), Error> {
        let aged = self.aged;
        let found = solve(aged, causes, from, false)
            .or_else(|_| solve(aged, causes, &self.begin, false))?;
        let linear = linear(aged, &found.place, Some(&found))?;
        Ok((found, linear))
    }

    fn fitted(&self, set: &[Cause]) -> Option<&(Minimum, Linear)> {
        self.fitted.iter().find(|f| f.0.place.causes == set)
    }

    /// A set of two is foretold by the half that promises more, and looked at there.
    fn foretold(&self, set: &[Cause]) -> Option<Form> {
        set.iter()
            .filter_map(|half| form(self.aged, &self.fitted(&[*half])?.1, set, 1.0))
            .min_by(|x, y| x.least().total_cmp(&y.least()))
    }

    /// Mean square of what is left with one set of values for all levels.
    fn unchanged_mean_square(&self) -> f64 {
        let (found, linear) = &self.fitted[0];
        let degrees = self.aged.rows().saturating_sub(found.place.slots.len());
        linear.normal.square / degrees.max(1) as f64
    }

    /// Noise's inflation by the best fit so far.
    fn inflation(&self) -> Result<f64, Error> {
        let square = |f: &(Minimum, Linear)| f.1.normal.square;
        let best = self
            .fitted
            .iter()
            .min_by(|a, b| square(a).total_cmp(&square(b)))
            .unwrap_or(&self.fitted[0]);
        let [_, inflation] = self.aged.noise(&best.0.place)?;
        Ok(inflation.max(1.0))
    }

    /// All sets by what is known of them so far, and the models that they make, the likeliest first.
    fn weighed(&self, inflation: f64) -> (Vec<Form>, Vec<(usize, Judged)>) {
        let forms: Vec<Form> = self
            .sets
            .par_iter()
            .filter_map(|set| {
                let linear = match self.fitted(set) {
                    Some((_, linear)) => linear,
                    None => &self.looked.iter().find(|l| l.0 == *set)?.1,
                };
                form(self.aged, linear, set, inflation)
            })
            .collect();
        let judged = |form: &Form| judge(self.aged, form, &self.shapes, self.ordered);
        let mut models: Vec<(usize, Judged)> = forms
            .par_iter()
            .enumerate()
            .map(|(i, form)| (i, judged(form)))
            .collect();
        models.sort_by(|a, b| a.1.criterion.total_cmp(&b.1.criterion));
        (forms, models)
    }

    /// Fits pairs until none is foretold to come near the best; all models, the likeliest first.
    fn models(&mut self) -> Result<Vec<Model>, Error> {
        // What a refit saved beyond what was foretold: so far nothing else that is foretold is trusted.
        let mut surprise: f64 = 0.0;
        loop {
            let inflation = self.inflation()?;
            let (forms, models) = self.weighed(inflation);
            // As long as nothing fits to the noise, everything is tried.
            let limit = match inflation < MISFIT {
                true => models.first().map_or(0.0, |m| m.1.criterion) + NEAR + surprise,
                false => f64::INFINITY,
            };
            let open = |i: usize| self.fitted(&forms[i].place.causes).is_none();
            let near: Vec<usize> = models
                .iter()
                .filter(|(i, j)| open(*i) && j.criterion < limit)
                .map(|m| m.0)
                .take(AT_ONCE)
                .collect();
            if near.is_empty() {
                // A set of which a cause came to rest is a smaller set, which was fitted itself.
                let whole = |j: &Judged| j.partitions.iter().all(|p| groups(p) > 1);
                let models = models.into_iter().filter(|(_, j)| whole(j));
                let models = models.map(|(i, j)| Model {
                    causes: std::iter::zip(forms[i].place.causes.clone(), j.partitions).collect(),
                    criterion: j.criterion,
                    place: forms[i].place.clone(),
                });
                return Ok(models.collect());
            }
            let refits: Vec<(Minimum, Linear)> = near
                .par_iter()
                .map(|&i| self.fit(&forms[i].place.causes, &forms[i].place))
                .collect::<Result<_, _>>()?;
            for (i, refit) in near.into_iter().zip(refits) {
                if let Some(form) = form(self.aged, &refit.1, &refit.0.place.causes, inflation) {
                    surprise = surprise.max(forms[i].least() - form.least());
                }
                self.fitted.push(refit);
            }
        }
    }
}

/// Rivals of the likeliest model that swap one cause for another at hardly any price.
fn confused(models: &[Model]) -> Vec<[Cause; 2]> {
    let chosen = &models[0];
    let causes = |m: &Model| -> Vec<Cause> { m.causes.iter().map(|c| c.0).collect() };
    let without = |all: &[Cause], these: &[Cause]| -> Vec<Cause> {
        let others = all.iter().filter(|c| !these.contains(c));
        others.copied().collect()
    };
    let own = causes(chosen);
    let mut out = Vec::new();
    for other in &models[1..] {
        if other.criterion - chosen.criterion > RIVAL || other.causes.len() != own.len() {
            continue;
        }
        let theirs = causes(other);
        if let ([a], [b]) = (&without(&own, &theirs)[..], &without(&theirs, &own)[..])
            && !out.contains(&[*a, *b])
        {
            out.push([*a, *b]);
        }
    }
    out
}

/// A cause in the last fit: `groups` are those of its levels, empty unless it is in the model.
fn found(
    cause: Cause,
    probability: f64,
    groups: Option<Partition>,
    last: &Minimum,
    covariance: &DMatrix<f64>,
) -> CauseFound {
    let in_model = groups.is_some();
    let groups = groups.unwrap_or_default();
    let at = |level: usize| {
        let slot = Slot::Cause(cause, level);
        last.place.slots.iter().position(|s| *s == slot)
    };
    let variance = |i: Option<usize>, j: Option<usize>| match (i, j) {
        (Some(i), Some(j)) => covariance[(i, j)],
        _ => 0.0,
    };
    let value = |level: usize| last.place.value(cause, level);
    let levels = 0..groups.len();
    CauseFound {
        cause,
        probability,
        in_model,
        by_level: levels
            .clone()
            .map(|l| Value {
                value: value(l),
                std_error: variance(at(l), at(l)).max(0.0).sqrt(),
            })
            .collect(),
        change: levels
            .clone()
            .map(|l| {
                let (i, o) = (at(l), at(0));
                let square = variance(i, i) + variance(o, o) - 2.0 * variance(i, o);
                Value {
                    value: value(l) - value(0),
                    std_error: square.max(0.0).sqrt(),
                }
            })
            .collect(),
        at_bound: levels.filter_map(at).any(|i| last.resting[i]),
        groups,
    }
}

/// Fits one film to all levels, and chooses what has to differ between them. `days` are those of the levels,
/// where they are days, `loss` is that of each level's stroke.
///
/// # Errors
/// [`Error`], when the model cannot be run at all.
pub(super) fn joint<A: Aged>(aged: &A, days: Option<&[f64]>, loss: &[f64]) -> Result<Joint, Error> {
    let (mut search, begun) = Search::begun(aged, shapes(days, loss), days.is_some())?;
    let models = search.models()?;
    let Some(chosen) = models.first() else {
        return Err(Error::NothingToFit(
            "no set of causes could be weighed".into(),
        ));
    };
    let weight = |m: &Model| (-0.5 * (m.criterion - chosen.criterion)).exp();
    let sum: f64 = models.iter().map(weight).sum();
    let probability = |cause: Cause| -> f64 {
        models
            .iter()
            .filter(|m| m.causes.iter().any(|(c, _)| *c == cause))
            .map(weight)
            .fold(0.0, |a, b| a + b)
            / sum
    };
    let nothing = models.iter().filter(|m| m.causes.is_empty()).map(weight);
    let nothing = nothing.sum::<f64>() / sum;

    // Which days are alike is a verdict; values and intervals do not rest on it.
    let causes: Vec<Cause> = chosen.causes.iter().map(|c| c.0).collect();
    let last = solve(aged, &causes, &chosen.place, true)?;
    let [weighted_mean_square, inflation] = aged.noise(&last.place)?;
    let covariance = covariance(aged, &last, inflation)?;
    let mut causes = Cause::ALL.map(|cause| {
        let own = chosen.causes.iter().find(|c| c.0 == cause);
        let groups = own.map(|c| c.1.clone());
        found(cause, probability(cause), groups, &last, &covariance)
    });
    causes.sort_by(|a, b| {
        b.in_model
            .cmp(&a.in_model)
            .then(b.probability.total_cmp(&a.probability))
    });
    let (film, forearm) = aged.film(&last.place);
    let by_level = (0..aged.levels()).map(|l| aged.level(&last.place, l));
    let fits = search.fitted.iter().map(|(s, _)| s.evaluations + 1);
    Ok(Joint {
        film,
        forearm,
        levels: by_level.collect::<Result<_, _>>()?,
        causes: causes.into(),
        confused: confused(&models),
        nothing,
        weighted_mean_square,
        unchanged_mean_square: search.unchanged_mean_square(),
        inflation,
        converged: last.converged,
        evaluations: begun + fits.sum::<usize>() + last.evaluations,
    })
}

/// Covariance of a solution's parameters, those at rest on a bound held.
fn covariance<A: Aged>(
    aged: &A,
    solution: &Minimum,
    inflation: f64,
) -> Result<DMatrix<f64>, Error> {
    let gram = aged.normal(&solution.place)?.gram;
    let free: Vec<usize> = (0..gram.nrows())
        .filter(|&j| !solution.resting[j] && gram[(j, j)] > 0.0)
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

/// What a set of causes is weighed by.
struct Weighing<'j, A> {
    aged: &'j A,
    causes: &'j [Cause],
    shapes: &'j [Shape],
    /// Whether the levels are days.
    ordered: bool,
    /// -2 ln of the probability of the set beforehand.
    rare: f64,
}

/// The causes' values on all levels, by unknowns one a column.
struct Tied {
    columns: Vec<DVector<f64>>,
    /// First (where it is free) and last level of each cause.
    ends: Vec<(Option<usize>, usize)>,
    /// Where the causes are less where they are off.
    gap: DVector<f64>,
}

impl<A: Aged> Weighing<'_, A> {
    /// What ages an electrode ages all of it: half of the pairs are thought to share their course over the
    /// days.
    fn course(&self, chosen: &[usize]) -> f64 {
        let shapes = self.shapes;
        match *chosen {
            [a, b] if a == b => shapes[a].price + 2.0 * 2.0_f64.ln(),
            [a, b] => shapes[a].price + shapes[b].price + 2.0 * 2.0_f64.ln(),
            _ => chosen.iter().map(|&c| shapes[c].price).sum(),
        }
    }

    /// Each cause in its shape: theta = off + tie q, q of standard deviation one beforehand.
    fn tied(&self, at: &DVector<f64>, chosen: &[usize]) -> Tied {
        let (known, levels) = (at.len(), self.aged.levels());
        let mut columns: Vec<DVector<f64>> = Vec::new();
        let mut ends = Vec::new();
        let mut gap = at.clone();
        let mut offset = 0;
        for (c, cause) in self.causes.iter().enumerate() {
            let first = A::first_level(*cause);
            let last = offset + levels - 1 - first;
            ends.push(((first == 0).then_some(offset), last));
            let mut add = |of: &dyn Fn(usize) -> f64| {
                let mut column = DVector::zeros(known);
                for level in first..levels {
                    column[offset + level - first] = of(level);
                }
                columns.push(column);
            };
            if first == 0 {
                add(&|_| 1.0);
            }
            for own in &self.shapes[chosen[c]].columns {
                add(&|level| own[level]);
            }
            for level in first..levels {
                gap[offset + level - first] -= cause.off() / cause.range();
            }
            offset += levels - first;
        }
        Tied { columns, ends, gap }
    }

    /// What the data say of the way of a change against an even chance.
    fn way(
        &self,
        tie: &DMatrix<f64>,
        ends: &[(Option<usize>, usize)],
        (c, q): (&Cholesky<f64, Dyn>, &DVector<f64>),
        chosen: &[usize],
    ) -> f64 {
        let mut way = 0.0;
        let changed = self.causes.iter().enumerate();
        for (i, cause) in changed.filter(|(i, _)| chosen[*i] > 0) {
            let Some(sign) = cause.way().filter(|_| self.ordered) else {
                continue;
            };
            let (first, last) = ends[i];
            let mut row = tie.row(last).transpose();
            if let Some(first) = first {
                row -= tie.row(first).transpose();
            }
            let sd = row.dot(&c.solve(&row)).max(f64::MIN_POSITIVE).sqrt();
            let on = 0.5 * erfc(-sign * row.dot(q) / (sd * std::f64::consts::SQRT_2));
            way -= 2.0 * (2.0 * (on * (1.0 - BACKWARDS) + (1.0 - on) * BACKWARDS)).ln();
        }
        way
    }

    /// -2 ln of the evidence of the set with a shape of each cause.
    fn cost(&self, q: &Quadratic, chosen: &[usize]) -> f64 {
        let (levels, curvature) = (self.aged.levels(), &q.curvature);
        let Tied { columns, ends, gap } = self.tied(&q.at, chosen);
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
            let way = self.way(&tie, &ends, (&c, &q), chosen);
            (gap - &tie * &q, 2.0 * volume + q.norm_squared() + way)
        };
        let rise = (left.transpose() * curvature * &left)[(0, 0)];
        // A resistance that all levels share is no cause.
        let resistance = |c: &Cause| *c == Cause::SeriesResistance;
        let shared = self.causes.iter().position(resistance).map_or(0.0, |i| {
            let before = i * (levels - 1);
            let own = curvature.view((before, before), (levels, levels));
            (1.0 + own.sum()).ln()
        });
        q.least + rise + occam - shared + self.rare + self.course(chosen)
    }

    /// Cause by cause until none changes.
    fn descend(&self, mount: &Quadratic, mut chosen: Vec<usize>) -> (Vec<usize>, f64) {
        let mut value = self.cost(mount, &chosen);
        loop {
            let before = value;
            for c in 0..chosen.len() {
                for option in 0..self.shapes.len() {
                    let old = chosen[c];
                    chosen[c] = option;
                    let trial = self.cost(mount, &chosen);
                    if trial < value {
                        value = trial;
                    } else {
                        chosen[c] = old;
                    }
                }
            }
            if value >= before {
                return (chosen, value);
            }
        }
    }

    /// The shapes of least cost: descents from every level its own value, from each cause in turn at rest,
    /// from the best course that all share.
    fn shapes(&self, by_mount: &[Quadratic]) -> Vec<usize> {
        let n = self.causes.len();
        let own = |s: &Shape| s.columns.len() + 1 == self.aged.levels();
        let all = vec![self.shapes.iter().position(own).unwrap_or(0); n];
        // Partitions are sought where the mounting's scatter is the likeliest.
        let mount = by_mount
            .iter()
            .min_by(|a, b| self.cost(a, &all).total_cmp(&self.cost(b, &all)))
            .unwrap_or(&by_mount[0]);
        let mut best = (all.clone(), self.cost(mount, &all));
        let mut begins = vec![all.clone()];
        begins.extend((0..n).map(|rests| {
            let mut begin = all.clone();
            begin[rests] = 0;
            begin
        }));
        let cost = |chosen: &Vec<usize>| self.cost(mount, chosen);
        let shared = (1..self.shapes.len()).map(|s| vec![s; n]);
        begins.extend(shared.min_by(|a, b| cost(a).total_cmp(&cost(b))));
        for begin in begins {
            let (chosen, value) = self.descend(mount, begin);
            if value < best.1 {
                best = (chosen, value);
            }
        }
        best.0
    }
}

/// -2 ln of the mean evidence over scatters of the mounting, alike likely.
fn over_mounts(by_mount: impl Iterator<Item = f64>) -> f64 {
    let by_mount: Vec<f64> = by_mount.collect();
    let least = by_mount.iter().copied().fold(f64::INFINITY, f64::min);
    let sum: f64 = by_mount.iter().map(|c| (-0.5 * (c - least)).exp()).sum();
    least - 2.0 * (sum / by_mount.len() as f64).ln()
}

/// The best partitions for a set of causes, and -2 ln of the evidence of the set with them.
fn judge<A: Aged>(aged: &A, form: &Form, shapes: &[Shape], ordered: bool) -> Judged {
    let causes = &form.place.causes;
    if causes.is_empty() {
        return Judged {
            partitions: Vec::new(),
            criterion: over_mounts(form.by_mount.iter().map(|q| q.least)),
        };
    }
    // What is beforehand less likely costs more, and so does one set of many.
    let sets = match causes.len() {
        1 => Cause::ALL.len(),
        _ => Cause::ALL.len() * (Cause::ALL.len() - 1) / 2,
    };
    let weighing = Weighing {
        aged,
        causes,
        shapes,
        ordered,
        rare: causes.iter().map(|c| -2.0 * c.odds().ln()).sum::<f64>() + 2.0 * (sets as f64).ln(),
    };
    let chosen = weighing.shapes(&form.by_mount);
    Judged {
        partitions: chosen.iter().map(|&c| shapes[c].groups.clone()).collect(),
        criterion: over_mounts(form.by_mount.iter().map(|q| weighing.cost(q, &chosen))),
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
