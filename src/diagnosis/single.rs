//! Doubts on a single coordinate: axis, hinge bench, film coupon.
//!
//! Fit, choose and report are three things. The models (plain, with one cause, with several) are fitted to
//! the training recordings; which of them is believed is told by blocks of these that each fit left out
//! (`blocks`); what is reported as not fitted took no part in either.
//!
//! 1. The plain model, and every cause beside it; series of causes grow from the best, and lose again what
//!    does not pay.
//! 2. The odds of all these models against each other; a cause's own odds are those of all models that have
//!    it.
//! 3. A flexible model of every site where physics may act (`LineResidual::sites`): where it foretells much
//!    that the causes do not, something is at work that nobody listed.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::blocks::{Blocks, Foretold, Forms, form_leaves, odds};
use super::outcome::*;
use super::problem::{Fitted, Problem, Tangent};
use super::scan::{Group, Scanned, fingerprints, scan};
use super::sizes::{unknown_values, value_estimates};
use super::subject::{Subject, Words};
use super::words::values;
use super::{
    POLISH, RIVALS, baseline, chance, choose, gain, hidden, in_unit, judge, law, locate,
    next_experiment,
};
use super::{polish, refit, rising, rivals, spots};
use crate::effects::{Acting, plain_name};
use crate::residual::line::LineResidual;

/// Hypotheses that are fitted, of one cause at most so many (`choose`), and beside causes that are there.
const FITTED: usize = 14;
const BESIDE: usize = 6;
/// Best causes from which series grow, and causes at once.
const STARTS: usize = 3;
const MOST: usize = 4;
/// Causes that are at work in a rig beforehand, of all that the catalogue lists together.
const EXPECTED: f64 = 0.5;
/// Rigs beforehand in which something unlisted is at work, of those in which anything is.
const UNLISTED: f64 = 0.25;
/// Largest mean square over the promised noise that may still be noise: what is read from a recording may be
/// a third of what there is.
const MAY_BE_NOISE: f64 = 9.0;
/// Largest mean square over the promised noise that noise makes (of 400 clean simulated coordinates two left
/// more).
const NOISE_AT_MOST: f64 = 2.5;
/// Share of what noise does not make that a named model may leave.
const LEFT_AT_MOST: f64 = 0.5;
/// A named model is loud where it leaves more than this share where it was fitted, which is where it does
/// best, and more than so many times the noise, which is more than the form of a right cause makes.
const LEFT_IF_LOUD: f64 = 0.2;
const LOUD: f64 = 4.0;
/// Mean square of a model, over that of noise or of the best flexible model, below which it cannot be.
const TOO_GOOD: f64 = 0.25;
/// Mean square, over the noise and over what could be foretold, from which it is worth saying that something
/// is at work which nobody names: below it the error is less than a quarter above what it could be.
const WORTH_SAYING: f64 = 1.5;
/// Mean square to which a cause must bring what is not foretold, of the model's without: an error that falls
/// by less than 5 % is of no use.
const MATTERS: f64 = 0.9;
/// Largest odds of a cause that is not named: it failed a test beside its odds (too small to matter, within
/// one sample, not told from off), and is less likely than not to be at work in a way that matters.
const NOT_NAMED: f64 = 0.49;
/// Student's t from which one model foretells better than another, block by block.
const BETTER: f64 = 2.5;
/// Share of the plain fit's mass, damping or stiffness below which a drive stands in for it.
const CANCELLED: f64 = 0.1;
/// Ridges of flexible columns, over their squared length.
const RIDGES: [f64; 4] = [1e-4, 1e-3, 1e-2, 1e-1];

/// A fitted model with what it foretells.
struct Model {
    fitted: Fitted,
    foretold: Foretold,
    /// Mean squares over the noise, of what it foretells and of what it was fitted to.
    raw: f64,
    fits: f64,
}

impl Model {
    fn ids(&self) -> Vec<&'static str> {
        self.fitted.effects.iter().map(|a| a.effect.id()).collect()
    }

    fn has(&self, id: &str) -> bool {
        self.fitted.effects.iter().any(|a| a.effect.id() == id)
    }
}

/// What all models of a diagnosis share.
struct Bench<'a, 'b> {
    problem: &'a Problem<LineResidual<'b>>,
    blocks: Blocks,
    plain_values: Vec<(String, f64)>,
    /// Logarithm of the prior odds of one more cause.
    prior: f64,
}

impl Bench<'_, '_> {
    /// What a fitted model foretells; `None` where it cannot be, or where a drive takes the place of the
    /// plant.
    fn judge(&self, fitted: Fitted) -> Option<Model> {
        let tangent = Tangent::new(self.problem, &fitted).ok()?;
        if self.cancels(&fitted) {
            return None;
        }
        let foretold = self.blocks.foretell(&tangent, None);
        let log = self.problem.residual(&fitted).log_slope(&fitted.effects);
        let over_noise = (2.0 * log).exp();
        let n = tangent.residual.len() as f64;
        Some(Model {
            raw: over_noise * foretold.mean_square(),
            fits: over_noise * tangent.residual.norm_squared() / n,
            foretold,
            fitted,
        })
    }

    /// Whether a cause of the drive takes away mass, damping or stiffness: a lag can stand in for a plant,
    /// and the plain fit found that one.
    fn cancels(&self, fitted: &Fitted) -> bool {
        if !fitted.effects.iter().any(|a| a.effect.drives()) {
            return false;
        }
        let state = &fitted.state;
        let own = Subject::values(&self.problem.train, &state.eta, &state.beta);
        self.plain_values.iter().any(|(name, plain)| {
            let now = own.iter().find(|v| v.0 == *name).map_or(0.0, |v| v.1);
            now < CANCELLED * plain
        })
    }

    fn score(&self, m: &Model, independent: f64) -> f64 {
        let n = independent * *self.blocks.edges.last().unwrap_or(&0) as f64;
        self.prior * m.fitted.effects.len() as f64
            - 0.5 * n * m.foretold.mean_square().max(1e-300).ln()
    }

    /// The best models with one more cause.
    fn beside(
        &self,
        base: &Model,
        wanted: &(dyn Fn(&str) -> bool + Sync),
        count: usize,
    ) -> Vec<Model> {
        let Ok(tangent) = Tangent::new(self.problem, &base.fitted) else {
            return Vec::new();
        };
        let groups = fingerprints(self.problem, &base.fitted, wanted);
        let scanned: Vec<Scanned> = scan(self.problem, &tangent, &groups, &[], wanted)
            .into_iter()
            .filter(|s| !base.has(s.acting.effect.id()))
            .collect();
        let fits = refit(
            self.problem,
            &base.fitted,
            &choose(&scanned, count),
            &base.fitted.effects,
        );
        fits.into_par_iter()
            .filter_map(|f| self.judge(polish(self.problem, &f)))
            .collect()
    }

    /// The plain columns and `extra` ones: the best over the ridges.
    fn flexible(&self, tangent: &Tangent, extra: &DMatrix<f64>) -> Foretold {
        RIDGES
            .par_iter()
            .map(|r| {
                let ridge = DVector::from_element(extra.ncols(), *r);
                self.blocks.foretell(tangent, Some((extra, &ridge)))
            })
            .min_by(|a, b| a.mean_square().total_cmp(&b.mean_square()))
            .expect("there are ridges")
    }

    /// What a fitted model foretells if noise in the coordinate and clocks within a sample may do to it what
    /// they do.
    fn blurred(&self, model: &Model) -> Result<Foretold, Error> {
        let (eta, beta) = (&model.fitted.state.eta, &model.fitted.state.beta);
        let columns = self.problem.residual(&model.fitted).blur(eta, beta)?;
        let tangent = Tangent::new(self.problem, &model.fitted)?;
        // their coefficients are one, give or take one: a ridge of one over the squared length
        let lengths = columns.column_iter().map(|c| c.norm_squared().max(1e-12));
        let ridge = DVector::from_iterator(columns.ncols(), lengths.map(|l| 1.0 / l));
        let told = self.blocks.foretell(&tangent, Some((&columns, &ridge)));
        Ok(if told.mean_square() < model.foretold.mean_square() {
            told
        } else {
            model.foretold.clone()
        })
    }

    /// What the most telling flexible model beside a fitted one foretells: one site's, or that of all
    /// together.
    fn twin(&self, fitted: &Fitted) -> Option<Foretold> {
        let tangent = Tangent::new(self.problem, fitted).ok()?;
        let residual = self.problem.residual(fitted);
        let sites = residual.sites(&fitted.state.eta, &fitted.state.beta).ok()?;
        let width: usize = sites.iter().map(|s| s.1.ncols()).sum();
        let mut all = DMatrix::zeros(tangent.residual.len(), width);
        let mut at = 0;
        for (_, columns) in &sites {
            all.columns_mut(at, columns.ncols()).copy_from(columns);
            at += columns.ncols();
        }
        (sites.iter().map(|s| &s.1))
            .chain([&all])
            .map(|columns| self.flexible(&tangent, columns))
            .min_by(|a, b| a.mean_square().total_cmp(&b.mean_square()))
    }
}

/// Doubts the plain model of recordings of one coordinate. `watch` is told what is being done.
pub(super) fn doubt(
    mut problem: Problem<LineResidual>,
    mut remarks: Vec<String>,
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Error> {
    let words = problem.train.words();
    let wanted = |id: &str| request.only.is_empty() || request.only.iter().any(|o| o == id);
    watch("fitting the plain model");
    let (plain, _) = baseline(&mut problem)?;
    watch("scanning the catalogue");
    let tangent = Tangent::new(&problem, &plain)?;
    let groups = fingerprints(&problem, &plain, &wanted);
    let scanned = scan(&problem, &tangent, &groups, &[], &wanted);
    let chance = chance::chance(&problem, &plain, &tangent, &groups, &[])?;
    let named_by_rivals = rivals::named(&tangent, &groups, &scanned);
    let rival_models = if request.rivals {
        watch("fitting what simpler methods say");
        let held = problem.holdout.as_ref();
        rivals::rival_models(&problem, held, &plain, &tangent, &groups, &[], &wanted)?
    } else {
        Vec::new()
    };
    let mut listed: Vec<&str> = groups.iter().map(|g| g.effect.id()).collect();
    listed.dedup();
    let each = EXPECTED / listed.len().max(1) as f64;
    let bench = Bench {
        blocks: Blocks::whole(problem.train.blocks()),
        plain_values: Vec::new(),
        prior: (each / (1.0 - each)).ln(),
        problem: &problem,
    };
    let Some(plain) = bench.judge(plain) else {
        return Err(Error::Baseline("it has no tangent".into()));
    };
    let state = &plain.fitted.state;
    let bench = Bench {
        plain_values: told_constants(&problem, &plain.fitted)?,
        ..bench
    };
    watch("fitting causes");
    let mut models: Vec<Model> = bench.beside(&plain, &wanted, FITTED);
    let independent = {
        let best = models.iter().min_by(|a, b| {
            a.foretold
                .mean_square()
                .total_cmp(&b.foretold.mean_square())
        });
        let best = best.unwrap_or(&plain);
        let design = problem
            .residual(&best.fitted)
            .design(&best.fitted.state.eta, &best.fitted.state.beta)?;
        problem
            .train
            .independent(design.column(design.ncols() - 1).as_slice())
    };
    let score = |m: &Model| bench.score(m, independent);
    let by_score = |a: &Model, b: &Model| score(b).total_cmp(&score(a));
    models.sort_by(by_score);
    let size = |m: &Model| m.fitted.effects.len();
    let pays = |m: &Model, base: &Model| {
        let to = MATTERS.powi(i32::try_from(size(m) - size(base)).unwrap_or(1));
        let lowers = |a: f64, b: f64| a < to * b;
        lowers(m.raw, base.raw)
            && lowers(m.foretold.mean_square(), base.foretold.mean_square())
            && score(m) > score(base)
    };
    watch("looking for several causes");
    let mut known: Vec<Vec<&str>> = Vec::new();
    let mut starts: Vec<usize> = Vec::new();
    for (i, m) in models.iter().enumerate() {
        if starts.len() < STARTS
            && !starts.iter().any(|&s| models[s].ids() == m.ids())
            && pays(m, &plain)
        {
            starts.push(i);
        }
    }
    for start in starts {
        let mut at = start;
        while models[at].fitted.effects.len() < MOST {
            let mut set = models[at].ids();
            set.sort_unstable();
            if known.contains(&set) {
                break;
            }
            known.push(set);
            let mut next = bench.beside(&models[at], &wanted, BESIDE);
            next.sort_by(by_score);
            let better = next.first().is_some_and(|n| pays(n, &models[at]));
            let first = models.len();
            models.extend(next);
            if !better {
                break;
            }
            at = first;
        }
    }
    // what a series no longer needs
    if let Some(best) = models.iter().max_by(|a, b| score(a).total_cmp(&score(b))) {
        let (effects, plain_eta) = (best.fitted.effects.clone(), state.eta.len());
        let (eta, beta) = (
            best.fitted.state.eta[..plain_eta].to_vec(),
            best.fitted.state.beta.clone(),
        );
        if effects.len() > 1 {
            let without: Vec<Model> = (0..effects.len())
                .into_par_iter()
                .filter_map(|i| {
                    let mut rest = effects.clone();
                    rest.remove(i);
                    bench.judge(problem.fit(&rest, &eta, &beta, POLISH))
                })
                .collect();
            models.extend(without);
        }
    }
    watch("judging");
    let mut twins: Vec<Foretold> = bench.twin(&plain.fitted).into_iter().collect();
    // what leaves far less than noise, and than any flexible model, has made the input told small, not the
    // error
    let possible = twins.first().map_or(1.0, Foretold::mean_square).min(1.0);
    models.retain(|m| m.raw > TOO_GOOD * possible);
    let left_of = |m: &Model| m.foretold.mean_square();
    let best = (models.iter()).min_by(|a, b| left_of(a).total_cmp(&left_of(b)));
    twins.extend(best.and_then(|m| bench.twin(&m.fitted)));
    let mut scored: Vec<(&Foretold, f64)> = std::iter::once(&plain)
        .chain(&models)
        .map(|m| (&m.foretold, bench.prior * m.fitted.effects.len() as f64))
        .collect();
    let mut probability = odds(&scored, Forms::Reach(&twins), independent);
    let nothing = probability[0];
    let of_cause = |probability: &[f64], id: &str| -> f64 {
        let sets = models.iter().zip(&probability[1..]);
        sets.filter(|(m, _)| m.has(id)).map(|(_, p)| p).sum()
    };
    let ordered = |probability: &[f64]| {
        let mut order: Vec<usize> = (0..models.len()).collect();
        order.sort_by(|&a, &b| {
            let odds = probability[1 + b].total_cmp(&probability[1 + a]);
            odds.then(by_score(&models[a], &models[b]))
        });
        order
    };
    let surprise = chance.largest / chance.limit(request.false_alarm_rate);
    let rate = request.false_alarm_rate;
    let allowed = chance.fall(rate);
    // the best model whose causes all stand on their own; what cannot be leaves its odds to the others
    let mut named: Option<(&Model, Vec<Vec<&'static str>>)> = None;
    let mut within_sample: Option<&Model> = None;
    let mut why_not: Vec<String> = Vec::new();
    let mut order = ordered(&probability);
    let mut at = 0;
    while at < order.len() {
        let i = order[at];
        at += 1;
        let m = &models[i];
        if scored[1 + i].1 == f64::NEG_INFINITY {
            continue; // was turned away
        }
        let part = |s: &&Model| size(s) < size(m) && s.ids().iter().all(|id| m.has(id));
        if !(pays(m, &plain) && models.iter().filter(part).all(|s| pays(m, s))) {
            continue;
        }
        let mut groups_alike = alike_sets(&bench, m, &groups);
        for set in &mut groups_alike {
            let own = set[0];
            let rivals = models.iter().zip(&probability[1..]).filter(|(r, p)| {
                size(r) == size(m)
                    && !r.has(own)
                    && r.ids().iter().filter(|id| !m.has(id)).count() == 1
                    && **p >= RIVALS * probability[1 + i]
            });
            for id in rivals.flat_map(|(r, _)| r.ids()) {
                if !m.has(id) && !set.contains(&id) {
                    set.push(id);
                }
            }
        }
        let sure = groups_alike.iter().all(|set| {
            let own = |id: &str| of_cause(&probability, id);
            let together: f64 = set.iter().map(|id| own(id)).sum();
            together >= 0.5 && set.iter().all(|id| own(id) <= own(set[0]))
        });
        if !sure {
            continue;
        }
        let size = size_is_nothing(&problem, &m.fitted);
        if within_sample.is_none() && size.as_ref().is_some_and(|s| s.within_sample) {
            within_sample = Some(m);
        }
        let no = || lowers_nothing(&problem, &plain.fitted, &m.fitted);
        let Some(reason) = size.map(|s| s.reason).or_else(no) else {
            named = Some((m, groups_alike));
            break;
        };
        if !why_not.contains(&reason) {
            why_not.push(reason);
        }
        scored[1 + i].1 = f64::NEG_INFINITY;
        probability = odds(&scored, Forms::Reach(&twins), independent);
        order = ordered(&probability);
        at = 0;
    }
    // what can be foretold at all
    let reach = twins
        .iter()
        .chain(models.iter().map(|m| &m.foretold))
        .min_by(|a, b| a.mean_square().total_cmp(&b.mean_square()));
    let base = plain.foretold.mean_square();
    // the share that is left of what could be foretold, or of what noise does not make
    let left = |m: &Model| {
        let reached = reach.map_or(0.0, |f| {
            let most = (base - f.mean_square()).max(1e-12 * base);
            (m.foretold.mean_square() - f.mean_square()) / most
        });
        let beyond = (m.raw - LOUD) / (plain.raw - LOUD).max(1e-9);
        reached.max(beyond).clamp(0.0, 1.0)
    };
    let beaten = |m: &Model| -> Result<bool, Error> {
        let own = bench.blurred(m)?;
        let raw = m.raw * own.mean_square() / m.foretold.mean_square().max(f64::MIN_POSITIVE);
        Ok(reach.is_some_and(|f| {
            f.beats(&own) > BETTER
                && WORTH_SAYING * f.mean_square() < own.mean_square()
                && raw.min(m.fits) > WORTH_SAYING
        }))
    };
    let significant = surprise > 1.0;
    let structured = |m: &Model| -> Result<bool, Error> {
        let design = problem
            .residual(&m.fitted)
            .design(&m.fitted.state.eta, &m.fitted.state.beta)?;
        let residual = design.column(design.ncols() - 1);
        let shape = |f| problem.train.noise_shape(&m.fitted.state.beta, f);
        let left = residual.as_slice();
        let happens = || {
            in_bursts(left, &bench.blocks, independent) || is_structured(left, &bench.blocks, shape)
        };
        Ok(m.raw > NOISE_AT_MOST && happens())
    };
    let share = |own: f64, plain: f64| (own - 1.0).max(0.0) / (plain - 1.0).max(1e-9);
    let says_enough = |m: &Model| share(m.raw, plain.raw) <= LEFT_AT_MOST;
    let loud = |m: &Model| m.fits > LOUD && share(m.fits, plain.fits) > LEFT_IF_LOUD;
    let verdict = match &named {
        Some((m, _))
            if significant
                && nothing < 0.5
                && says_enough(m)
                && unlisted(m, left(m)) <= 0.5
                && !(barely_foretells(&problem, &plain, m)
                    && (loud(m) || misses(&problem, m, independent)?)) =>
        {
            Verdict::MissingPhysics
        }
        _ => {
            // a clock that is a fraction of a sample off is no cause, and what it makes is none either
            let m = within_sample.unwrap_or(&plain);
            let more = beaten(m)? || structured(m)? || misses(&problem, m, independent)?;
            if more {
                Verdict::Unexplained
            } else {
                Verdict::Adequate
            }
        }
    };
    let in_model = verdict == Verdict::MissingPhysics;
    if !in_model {
        remarks.extend(why_not);
    }
    let something_else = match &named {
        Some((m, _)) => unlisted(m, left(m)),
        None if verdict == Verdict::Unexplained => unlisted(&plain, 1.0),
        None => unlisted(&plain, 0.0),
    };
    let augmented = match (&named, in_model) {
        (Some((m, _)), true) => *m,
        _ => &plain,
    };
    if augmented.raw < 0.25 {
        remarks.push(format!("What is left is {:.2} of the noise that was read from the recordings: the noise floor is too high, or the model is too free; look at the repeats.", augmented.raw.sqrt()));
    }
    if verdict == Verdict::Adequate && within_sample.unwrap_or(&plain).raw > MAY_BE_NOISE {
        remarks.push("Model and recordings differ by more than the noise that is read above the band of the signal, but neither a cause nor a flexible model of position, rate, direction, history, input and time foretells it, and it has the spectrum of noise: it is taken for noise within the band.".into());
    }
    let mut candidates: Vec<Candidate> = Vec::new();
    let listed: Vec<(&Model, usize)> = {
        let mut out: Vec<(&Model, usize)> = Vec::new();
        let own = in_model.then_some(augmented);
        for m in own.into_iter().chain(order.iter().map(|&i| &models[i])) {
            for e in 0..m.fitted.effects.len() {
                let id = m.fitted.effects[e].effect.id();
                if !out
                    .iter()
                    .any(|(m, e)| m.fitted.effects[*e].effect.id() == id)
                {
                    out.push((m, e));
                }
            }
        }
        out
    };
    for (m, own) in listed {
        let acting = &m.fitted.effects[own];
        let estimates = value_estimates(&problem, &m.fitted, false)
            .unwrap_or_else(|_| unknown_values(&m.fitted));
        let is_in = in_model && std::ptr::eq(m, augmented);
        let own_odds = (1.0 - something_else) * of_cause(&probability, acting.effect.id());
        candidates.push(Candidate {
            acting: acting.clone(),
            probability: if is_in { own_odds } else { own_odds.min(NOT_NAMED) },
            delta_bic: -2.0 * (score(m) - score(&plain)),
            mean_square: m.fits,
            holdout_mean_square: m.raw,
            in_model: is_in,
            values: values(&problem, &m.fitted, own, &estimates),
            says: format!(
                "{}; over blocks that took no part in the fit the weighted mean square falls from {} to {}",
                acting.effect.says(),
                short(plain.raw),
                short(m.raw)
            ),
        });
    }
    candidates.sort_by(|a, b| {
        b.in_model
            .cmp(&a.in_model)
            .then(b.probability.total_cmp(&a.probability))
    });
    let groups_alike: Vec<Vec<&'static str>> = match (&named, in_model) {
        (Some((_, sets)), true) => sets.iter().filter(|s| s.len() > 1).cloned().collect(),
        _ => Vec::new(),
    };
    let spots = spots(&problem, &plain.fitted, &augmented.fitted)?;
    let acting: &[Acting] = if in_model {
        &augmented.fitted.effects
    } else {
        &[]
    };
    let places = locate::locate(
        &spots,
        &problem.train.whereabouts(),
        &problem.train.coordinates(),
        1,
        &words,
        acting,
    );
    let law = (verdict == Verdict::Unexplained)
        .then(|| law::law(&problem, &plain.fitted))
        .transpose()?;
    let (train_gain, mut traces) = gain(
        &problem.train,
        &problem.train_when,
        &plain.fitted,
        &augmented.fitted,
        false,
        |f| Some(f.state.eta[..problem.nonlinear.len()].to_vec()),
    )?;
    let mut holdout_gain = None;
    if let Some(h) = &problem.holdout {
        let (g, t) = gain(
            h,
            &problem.holdout_when,
            &plain.fitted,
            &augmented.fitted,
            true,
            |f| problem.holdout_eta(f),
        )?;
        holdout_gain = Some(g);
        traces.extend(t);
    }
    let catalogue = (1.0 - nothing) * (1.0 - something_else);
    let confidence = match verdict {
        Verdict::Adequate => nothing.max(0.5),
        Verdict::MissingPhysics => catalogue,
        Verdict::Unexplained => something_else.max(0.5),
    };
    let mut tried: Vec<(Vec<&'static str>, f64, f64, f64)> = Vec::new();
    for &i in &order {
        let m = &models[i];
        tried.push((m.ids(), score(&plain) - score(m), m.fits, m.raw));
    }
    let hidden = hidden(&problem, &scanned, allowed);
    let next_experiment = next_experiment(verdict, &groups_alike, &candidates, &words);
    let apart = (within_sample.filter(|_| verdict == Verdict::Adequate))
        .map(|m| sample_apart(&problem, &plain.fitted, &m.fitted))
        .transpose()?;
    let says = apart.unwrap_or_else(|| {
        says(
            verdict,
            &candidates,
            &train_gain,
            holdout_gain.as_ref(),
            &places,
            &words,
            &groups_alike,
        )
    });
    let none = match verdict {
        Verdict::Adequate => nothing.max(0.5),
        _ => nothing,
    };
    Ok(Diagnosis {
        verdict,
        confidence,
        probabilities: [
            (1.0 - something_else) * none,
            (1.0 - something_else) * (1.0 - none),
            something_else,
        ],
        departed: Vec::new(),
        beyond: None,
        built: f64::NAN,
        places,
        groups: groups_alike,
        next_experiment,
        hidden,
        train: train_gain,
        holdout: holdout_gain,
        plain: rising(
            problem
                .train
                .parameters(&plain.fitted.state.eta, &plain.fitted.state.beta),
        ),
        parameters: rising(
            problem
                .train
                .parameters(&augmented.fitted.state.eta, &augmented.fitted.state.beta),
        ),
        pose: None,
        eps_r: f64::NAN,
        rig: problem.train.rig(),
        values: Subject::values(
            &problem.train,
            &augmented.fitted.state.eta,
            &augmented.fitted.state.beta,
        ),
        unit: words.unit,
        basis: words.basis,
        over: words.over,
        plain_mean_square: plain.fits,
        plain_holdout_mean_square: plain.raw,
        law,
        learnt: None,
        traces,
        remarks,
        says,
        rivals: named_by_rivals,
        rival_models,
        evidence: Evidence {
            surprise: chance.largest,
            whose: chance.whose,
            limit: chance.limit(rate),
            noise_scale: chance.scale,
            each: chance.each.clone(),
            tried,
            p_value: chance.p_value(),
            fall: candidates
                .iter()
                .map(|c| plain.fits - c.mean_square)
                .fold(0.0, f64::max),
            fall_by_chance: allowed,
        },
        candidates,
    })
}

/// Constants of the plain model that its recordings tell: mass, damping, stiffness, by name.
fn told_constants(
    problem: &Problem<LineResidual>,
    plain: &Fitted,
) -> Result<Vec<(String, f64)>, Error> {
    let (eta, beta) = (&plain.state.eta, &plain.state.beta);
    let design = problem.residual(plain).design(eta, beta)?;
    let all = Subject::values(&problem.train, eta, beta);
    let told = |name: &str| {
        let own = ["mass", "inertia", "damping", "stiffness"];
        own.iter().any(|o| name.starts_with(o))
    };
    // a term that makes no more than the noise is none to lose
    let seen = |place: usize| {
        let column = design.column(eta.len() + place);
        let rms = (column.norm_squared() / column.len() as f64).sqrt();
        beta[place].abs() * rms > TOLD
    };
    let places = problem.train.constants();
    Ok(all
        .into_iter()
        .filter(|(name, value)| {
            let place = places
                .iter()
                .position(|p| name.starts_with(p))
                .filter(|_| *value > 0.0);
            told(name) && place.is_some_and(seen)
        })
        .collect())
}

/// Root mean square over the noise from which a term of the plain model is seen.
const TOLD: f64 = 3.0;

/// Ids that the recordings cannot tell from each cause of a model, the cause's own first.
fn alike_sets(bench: &Bench, m: &Model, groups: &[Group]) -> Vec<Vec<&'static str>> {
    (0..m.fitted.effects.len())
        .map(|own| {
            let mut ids = judge::alike(bench.problem, &m.fitted, own, groups);
            ids.retain(|id| !m.has(id));
            ids.insert(0, m.fitted.effects[own].effect.id());
            ids
        })
        .collect()
}

/// Why a cause of a model is none.
struct NoSize {
    reason: String,
    /// It is a time within the distance of two samples.
    within_sample: bool,
}

/// Why a cause of a model is none: no size of it is told from off, or each rests at an end of its range.
fn size_is_nothing(problem: &Problem<LineResidual>, fitted: &Fitted) -> Option<NoSize> {
    let estimates = value_estimates(problem, fitted, false).ok()?;
    let step_s = problem.train.lines().map(|l| l.step_s).fold(0.0, f64::max);
    for (own, acting) in fitted.effects.iter().enumerate() {
        let mut why = Vec::new();
        let (mut told, mut within_sample) = (false, false);
        for (&(e, v), estimate) in fitted.free.iter().zip(&estimates) {
            if e != own {
                continue;
            }
            let q = &acting.effect.parameters()[v];
            if !q.size {
                continue;
            }
            let [low, high] = estimate.ci95;
            let at_end = |x: f64, end: f64| end.is_finite() && (x - end).abs() <= 1e-6 * q.spread;
            let reason = if q.unit == "s" && acting.values[v].abs() < step_s {
                within_sample = true;
                "is below the distance of two samples, within which no drive is held still and no two clocks agree"
            } else if at_end(acting.values[v], q.lower) || at_end(acting.values[v], q.upper) {
                "rests at an end of its range"
            } else if q.off.is_finite() && (low..=high).contains(&q.off) {
                "is not told from off"
            } else if low <= q.lower && high >= q.upper {
                "may be anything"
            } else {
                told = true;
                continue;
            };
            why.push(format!("its {} {reason}", q.name.replace('_', " ")));
        }
        if !told && !why.is_empty() {
            let name = plain_name(acting.effect.id());
            return Some(NoSize {
                reason: format!("{name} was not named: {}.", why.join(", ")),
                within_sample,
            });
        }
    }
    None
}

/// Whether a residual comes in bursts, and noise does not: the mean square of the tenth of all stretches in
/// which it is largest is more than [`PEAK`] times the median one. Stretches of so many independent rows that
/// noise does not go beyond 3 times in one of a thousand.
fn in_bursts(residual: &[f64], blocks: &Blocks, independent: f64) -> bool {
    const ROWS: f64 = 16.0;
    let length = (ROWS / independent).ceil() as usize;
    let parts = blocks.edges.windows(2).map(|e| &residual[e[0]..e[1]]);
    let mut squares: Vec<f64> = parts
        .flat_map(|part| part.chunks_exact(length))
        .map(|stretch| stretch.iter().map(|r| r * r).sum())
        .collect();
    squares.sort_by(f64::total_cmp);
    let largest = &squares[squares.len() - squares.len() / 10..];
    !largest.is_empty()
        && largest.iter().sum::<f64>() > PEAK * largest.len() as f64 * squares[squares.len() / 2]
}

/// Whether a residual has the spectrum of something that happens, not that of noise: more than half of its
/// power lies in frequencies whose density is more than [`PEAK`] times the median of what position noise and
/// input noise make of the balance (`shape`: their densities at a frequency in cycles a row,
/// [`LineResidual::noise_shape`]), their shares by Whittle's likelihood.
fn is_structured(residual: &[f64], blocks: &Blocks, shape: impl Fn(f64) -> [f64; 2]) -> bool {
    let mut power: Vec<(f64, [f64; 2])> = Vec::new();
    for e in blocks.edges.windows(2) {
        let part = &residual[e[0]..e[1]];
        let n = part.len();
        for k in 1..=n / 2 {
            let f = k as f64 / n as f64;
            let (mut re, mut im) = (0.0, 0.0);
            for (i, r) in part.iter().enumerate() {
                let (s, c) = (std::f64::consts::TAU * f * i as f64).sin_cos();
                re += r * c;
                im += r * s;
            }
            power.push(((re * re + im * im) / n as f64, shape(f)));
        }
    }
    if power.len() < 8 {
        return false;
    }
    let count = power.len() as f64;
    let fit = |share: f64| {
        let of = |p: &(f64, [f64; 2])| share * p.1[0] + (1.0 - share) * p.1[1];
        let scale = power.iter().map(|p| p.0 / of(p)).sum::<f64>() / count;
        count * scale.ln() + power.iter().map(|p| of(p).ln()).sum::<f64>()
    };
    let shares = (0..=24).map(|i| 1.0 / (1.0 + 10f64.powi(i - 12)));
    let share = shares
        .min_by(|a, b| fit(*a).total_cmp(&fit(*b)))
        .unwrap_or(0.5);
    let mut over: Vec<(f64, f64)> = power
        .iter()
        .map(|p| (p.0 / (share * p.1[0] + (1.0 - share) * p.1[1]), p.0))
        .collect();
    over.sort_by(|a, b| a.0.total_cmp(&b.0));
    let median = over[over.len() / 2].0;
    let all: f64 = over.iter().map(|o| o.1).sum();
    let peaks: f64 = over
        .iter()
        .filter(|o| o.0 > PEAK * median)
        .map(|o| o.1)
        .sum();
    peaks > 0.5 * all
}

/// Whether a model errs on the recordings that took no part as one that is right, named or plain, would not:
/// its mean square there is more than [`MAY_BE_NOISE`] times what it leaves where it was fitted and what its
/// parameters, uncertain as they are, make there.
fn misses(problem: &Problem<LineResidual>, model: &Model, independent: f64) -> Result<bool, Error> {
    let Some(holdout) = &problem.holdout else {
        return Ok(false);
    };
    let fitted = &model.fitted;
    let mut eta = problem.holdout_eta(fitted).unwrap_or_default();
    eta.extend_from_slice(&fitted.state.eta[problem.nonlinear.len()..]);
    let (effects, free) = (fitted.effects.clone(), fitted.free.clone());
    let held = holdout
        .with_effects(effects, free, &problem.holdout_when)
        .design(&eta, &fitted.state.beta)?;
    let own = problem
        .residual(fitted)
        .design(&fitted.state.eta, &fitted.state.beta)?;
    // clock offsets are each recording's own; the other unknowns are shared
    let shared = |residual: &LineResidual, design: &DMatrix<f64>| {
        let offsets = residual.free_offsets().len();
        let first = residual.plain_unknowns() - offsets;
        design.clone().remove_columns(first, offsets)
    };
    let (own, held) = (shared(&problem.train, &own), shared(holdout, &held));
    let last = own.ncols() - 1;
    let mut precision = own.columns(0, last).tr_mul(&own.columns(0, last)) * independent;
    for j in 0..last {
        let diagonal = precision[(j, j)];
        precision[(j, j)] = diagonal * (1.0 + 1e-9) + f64::MIN_POSITIVE.sqrt();
    }
    let told = held.columns(0, last);
    let uncertain = precision
        .cholesky()
        .map_or(0.0, |c| told.dot(&c.solve(&told.transpose()).transpose()));
    let rows = held.nrows() as f64;
    let fits = (own.column(last).norm_squared() / own.nrows() as f64).max(1.0);
    let expected = fits * (1.0 + uncertain / rows);
    Ok(held.column(last).norm_squared() / rows > MAY_BE_NOISE * expected)
}

/// Whether a named model leaves more than a quarter of the plain one's sum of squares on the recordings that
/// took no part.
fn barely_foretells(problem: &Problem<LineResidual>, plain: &Model, named: &Model) -> bool {
    let held = |m: &Model| problem.held_out(&m.fitted).map_or(0.0, |h| h.0);
    held(named) > 0.25 * held(plain)
}

/// Density or mean square over the median from which a frequency or a stretch stands out: noise of a
/// frequency goes beyond it in four of a thousand.
const PEAK: f64 = 8.0;

/// Why the causes of a model are none: the error of the stated quantity hardly falls with them, or rises
/// where nothing was fitted. This veto is all that the recordings which were held out have a say in.
fn lowers_nothing(
    problem: &Problem<LineResidual>,
    plain: &Fitted,
    fitted: &Fitted,
) -> Option<String> {
    let own = |f: &Fitted| Some(f.state.eta[..problem.nonlinear.len()].to_vec());
    let ids: Vec<String> = fitted
        .effects
        .iter()
        .map(|a| plain_name(a.effect.id()))
        .collect();
    let unit = problem.train.words().unit;
    let number = |x: f64| in_unit(x, &unit);
    let why = |where_: &str, g: &Gain| {
        let (names, before, after) = (ids.join(" with "), number(g.before_v), number(g.after_v));
        format!("{names} was not named: {where_} the error goes from {before} to {after}.")
    };
    let nothing_told = || {
        Some(format!(
            "{} was not named: it leaves next to nothing of the input told.",
            ids.join(" with ")
        ))
    };
    let when = &problem.train_when;
    let Ok((train, _)) = gain(&problem.train, when, plain, fitted, false, own) else {
        return nothing_told();
    };
    if train.after_v > MATTERS.sqrt() * train.before_v {
        return Some(why("where it was fitted", &train));
    }
    if let Some(h) = &problem.holdout {
        let eta = |f: &Fitted| problem.holdout_eta(f);
        let Ok((held, _)) = gain(h, &problem.holdout_when, plain, fitted, true, eta) else {
            return nothing_told();
        };
        if held.after_v > held.before_v {
            return Some(why("on what took no part", &held));
        }
    }
    None
}

/// Probability that something unlisted is at work where a model leaves this share of what can be foretold.
/// The shares that listed causes leave are those of their forms (`form_leaves`), those of unlisted ones are
/// even; each cause beyond the first has to be at work, too.
fn unlisted(m: &Model, share: f64) -> f64 {
    let more = m.fitted.effects.len().saturating_sub(1);
    let listed = (1.0 - UNLISTED) * EXPECTED.powi(more as i32) * form_leaves(share);
    UNLISTED / (UNLISTED + listed)
}

/// A mean square to three digits.
fn short(x: f64) -> String {
    in_unit(x, "").trim_end().to_owned()
}

/// What a clock that is less than a sample off, or a lag as short, makes.
fn sample_apart(
    problem: &Problem<LineResidual>,
    plain: &Fitted,
    fitted: &Fitted,
) -> Result<String, Error> {
    let own = |f: &Fitted| Some(f.state.eta[..problem.nonlinear.len()].to_vec());
    let (told, _) = gain(
        &problem.train,
        &problem.train_when,
        plain,
        fitted,
        false,
        own,
    )?;
    let unit = problem.train.words().unit;
    let times: Vec<String> = (fitted.effects.iter())
        .flat_map(|a| {
            let quantities = a.effect.parameters().iter().zip(&a.values);
            let times = quantities.filter(|(q, _)| q.unit == "s");
            times.map(|(_, v)| {
                format!(
                    "{} of {}",
                    plain_name(a.effect.id()),
                    in_unit(1e3 * v, "ms")
                )
            })
        })
        .collect();
    Ok(format!(
        "The plain model suffices once input and coordinate are on one clock: a {}, less than the distance of two samples, takes the error \
         from {} to {} (noise: {}). State the offset, or \"estimate\", as time_offset_s.",
        times.join(", "),
        in_unit(told.before_v, &unit),
        in_unit(told.after_v, &unit),
        in_unit(told.noise_floor_v, &unit)
    ))
}

fn says(
    verdict: Verdict,
    candidates: &[Candidate],
    train: &Gain,
    holdout: Option<&Gain>,
    places: &[Place],
    words: &Words,
    alike: &[Vec<&'static str>],
) -> String {
    let number = |x: f64| in_unit(x, &words.unit);
    let on_new = holdout.map_or(String::new(), |h| {
        format!(
            " On what took no part it goes from {} to {} (noise: {}).",
            number(h.before_v),
            number(h.after_v),
            number(h.noise_floor_v)
        )
    });
    match verdict {
        Verdict::MissingPhysics => {
            let name = |c: &Candidate| {
                let id = c.acting.effect.id();
                let others = alike.iter().find(|g| g[0] == id);
                let others = others.map_or(String::new(), |g| {
                    let list: Vec<String> = g[1..].iter().map(|o| plain_name(o)).collect();
                    format!(
                        ", or what these recordings cannot tell from it: {}",
                        list.join(", ")
                    )
                });
                format!("{} ({}{others})", plain_name(id), c.acting.effect.says())
            };
            let named: Vec<String> = candidates.iter().filter(|c| c.in_model).map(name).collect();
            format!(
                "Left out: {}. With it the error goes from {} to {}; noise alone makes {}.{on_new}",
                named.join("; "),
                number(train.before_v),
                number(train.after_v),
                number(train.noise_floor_v)
            )
        }
        Verdict::Adequate if train.before_v <= WORTH_SAYING * train.noise_floor_v => format!(
            "The plain model suffices: what it leaves, {}, is what noise leaves, and no cause of the catalogue foretells more than it does.",
            number(train.before_v)
        ),
        Verdict::Adequate => format!(
            "No cause stands out from the noise. The plain model leaves {}, {:.1} times the noise that was read from the recordings; that \
             noise may be read too low by as much.",
            number(train.before_v),
            train.before_v / train.noise_floor_v
        ),
        Verdict::Unexplained => format!(
            "Model and recordings differ by more than noise ({} against {}{}), and no cause of the catalogue accounts for it.{}",
            number(train.before_v),
            number(train.noise_floor_v),
            holdout.map_or(String::new(), |h| format!(
                "; on what took no part {} against {}",
                number(h.before_v),
                number(h.noise_floor_v)
            )),
            places
                .first()
                .map_or(String::new(), |p| format!(" It lives here: {}.", p.says))
        ),
    }
}
