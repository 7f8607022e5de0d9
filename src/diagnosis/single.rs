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

use super::blocks::{
    self, BETTER, Blocks, Foretold, Forms, MADE_BY_NOISE, RIDGES, form_leaves, unlisted_leaves,
};
use super::chain::Seen;
use super::errors::{holdout_gain, train_gain};
use super::explain::{gains, parameters, places, that_holds};
use super::fits::{baseline, choose, polish, refit};
use super::learn::{learn_along, physics};
use super::moments::{Moments, moments};
use super::outcome::*;
use super::problem::{Fitted, Problem, Tangent};
use super::scan::{Group, Scanned, fingerprints, scan};
use super::sizes::{unknown_values, value_estimates};
use super::subject::{Subject, Words};
use super::words::{hidden, in_unit, next_experiment, values};
use super::{POLISH, RIVALS, chance, judge, law, rivals, under_way};
use crate::effects::line::UnderWay;
use crate::effects::plain_name;
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
/// Mean square of a model, over that of noise or of the best flexible model, below which it cannot be: what
/// is read from a recording may also be thrice what there is.
const TOO_GOOD: f64 = 1.0 / MAY_BE_NOISE;
/// Mean square, over the noise and over what could be foretold, from which it is worth saying that something
/// is at work which nobody names: below it the error is less than a quarter above what it could be.
const WORTH_SAYING: f64 = 1.5;
/// Mean square to which a cause must bring what is not foretold, of the model's without: an error that falls
/// by less than 5 % is of no use.
const MATTERS: f64 = 0.9;
/// Largest odds of a cause that is not named: it failed a test beside its odds (too small to matter, within
/// one sample, not told from off), and is less likely than not to be at work in a way that matters.
const NOT_NAMED: f64 = 0.49;
/// Share of the plain fit's mass, damping or stiffness below which a drive stands in for it.
const CANCELLED: f64 = 0.1;

/// A fitted model with what it foretells.
struct Model {
    fitted: Fitted,
    foretold: Foretold,
    /// Values of its causes that do anything.
    numbers: usize,
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
            numbers: self.numbers(&fitted)?,
            fitted,
        })
    }

    /// How many free values of causes change the residual; `None` where it cannot be worked out. A softening's
    /// centre does nothing on a coupon, whose film is not strained at rest.
    fn numbers(&self, fitted: &Fitted) -> Option<usize> {
        let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
        let design = self.problem.residual(fitted).design(eta, beta).ok()?;
        let first = self.problem.nonlinear.len();
        let all = first..first + fitted.free.len();
        Some(all.filter(|&j| design.column(j).norm() > 0.0).count())
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
        self.prior_of(m) + m.foretold.log_density(independent)
    }

    /// Logarithm of the prior odds of a model's causes against none: a further number halves them, so that
    /// what tells as little is the simpler one.
    fn prior_of(&self, m: &Model) -> f64 {
        let causes = m.fitted.effects.len() as f64;
        self.prior * causes - std::f64::consts::LN_2 * (m.numbers as f64 - causes).max(0.0)
    }

    /// The best models with one more cause, and those whose causes were under way when recordings began.
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
            .flat_map_iter(|f| {
                let fitted = polish(self.problem, &f);
                let begun = under_way::fit(self.problem, &fitted, POLISH);
                [Some(fitted), begun].into_iter().flatten()
            })
            .filter_map(|fitted| self.judge(fitted))
            .collect()
    }

    /// The plain columns and `extra` ones: the best over the ridges.
    fn flexible(&self, tangent: &Tangent, extra: &DMatrix<f64>, independent: f64) -> Foretold {
        RIDGES
            .par_iter()
            .map(|r| {
                let ridge = DVector::from_element(extra.ncols(), *r);
                self.blocks.foretell(tangent, Some((extra, &ridge)))
            })
            .max_by(|a, b| {
                a.log_density(independent)
                    .total_cmp(&b.log_density(independent))
            })
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
    fn twin(&self, fitted: &Fitted, independent: f64) -> Option<Foretold> {
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
            .map(|columns| self.flexible(&tangent, columns, independent))
            .max_by(|a, b| {
                a.log_density(independent)
                    .total_cmp(&b.log_density(independent))
            })
    }
}

/// What all models of a diagnosis are held against.
struct Field<'a, 'b> {
    bench: Bench<'a, 'b>,
    seen: Seen,
    plain: Model,
    /// With causes.
    models: Vec<Model>,
    /// Share of the rows that count as independent.
    independent: f64,
    /// What flexible models of a site foretell.
    twins: Vec<Foretold>,
    /// The plain model with leaps at moments.
    moments: Option<Moments>,
}

/// Odds of the models, and the one that is named.
struct Odds {
    /// Logarithms of the prior odds, of the plain model first; minus infinity where one was turned away.
    prior: Vec<f64>,
    probability: Vec<f64>,
    /// Places of the models, the likeliest first.
    order: Vec<usize>,
    /// The model whose causes are named, and with each those that the recordings cannot tell from it.
    named: Option<(usize, Vec<Vec<&'static str>>)>,
    /// The likeliest model of which a time is within the distance of two samples.
    within_sample: Option<usize>,
    /// Why others were not named.
    why_not: Vec<String>,
}

/// Doubts the plain model of recordings of one coordinate. `watch` is told what is being done.
pub(super) fn doubt(
    mut problem: Problem<LineResidual>,
    mut remarks: Vec<String>,
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Error> {
    let wanted = |id: &str| request.only.is_empty() || request.only.iter().any(|o| o == id);
    watch("fitting the plain model");
    let (plain, _) = baseline(&mut problem)?;
    watch("scanning the catalogue");
    let seen = look(&problem, &plain, request, &wanted, watch)?;
    watch("fitting causes");
    let mut field = Field::new(&problem, plain, seen, &wanted)?;
    watch("looking for several causes");
    field.grow(&wanted);
    field.without_each();
    field.once_each();
    field.begin_held_out()?;
    watch("judging");
    field.hold_against_flexible_ones();
    let odds = field.name();
    let verdict = field.verdict(&odds, request.false_alarm_rate)?;
    field.explain(odds, verdict, &mut remarks, request)
}

/// Scans the catalogue, and what simpler methods make of it.
fn look(
    problem: &Problem<LineResidual>,
    plain: &Fitted,
    request: &Request,
    wanted: &(dyn Fn(&str) -> bool + Sync),
    watch: &(dyn Fn(&str) + Sync),
) -> Result<Seen, Error> {
    let tangent = Tangent::new(problem, plain)?;
    let groups = fingerprints(problem, plain, wanted);
    let scanned = scan(problem, &tangent, &groups, &[], wanted);
    let chance = chance::chance(problem, plain, &tangent, &groups, &[])?;
    let mut rival_models = Vec::new();
    if request.rivals {
        watch("fitting what simpler methods say");
        let held = problem.holdout.as_ref();
        rival_models = rivals::rival_models(problem, held, plain, &tangent, &groups, &[], wanted)?;
    }
    Ok(Seen {
        rivals: rivals::named(&tangent, &groups, &scanned),
        groups,
        units: Vec::new(),
        scanned,
        chance,
        rival_models,
    })
}

impl<'a, 'b> Field<'a, 'b> {
    /// The plain model and those with one cause.
    fn new(
        problem: &'a Problem<LineResidual<'b>>,
        plain: Fitted,
        seen: Seen,
        wanted: &(dyn Fn(&str) -> bool + Sync),
    ) -> Result<Self, Error> {
        let mut listed: Vec<&str> = seen.groups.iter().map(|g| g.effect.id()).collect();
        listed.dedup();
        let each = EXPECTED / listed.len().max(1) as f64;
        let mut bench = Bench {
            blocks: Blocks::whole(problem.train.blocks()),
            plain_values: Vec::new(),
            prior: (each / (1.0 - each)).ln(),
            problem,
        };
        let plain = bench
            .judge(plain)
            .ok_or_else(|| Error::Baseline("it has no tangent".into()))?;
        bench.plain_values = told_constants(problem, &plain.fitted)?;
        let models = bench.beside(&plain, wanted, FITTED);
        let best = models.iter().min_by(|a, b| by_foretold(a, b));
        let best = &best.unwrap_or(&plain).fitted;
        let design = problem
            .residual(best)
            .design(&best.state.eta, &best.state.beta)?;
        let left = design.column(design.ncols() - 1);
        let mut field = Field {
            independent: problem.train.independent(left.as_slice()),
            bench,
            seen,
            plain,
            models,
            twins: Vec::new(),
            moments: None,
        };
        let mut models = std::mem::take(&mut field.models);
        field.sort(&mut models);
        field.models = models;
        Ok(field)
    }

    fn score(&self, m: &Model) -> f64 {
        self.bench.score(m, self.independent)
    }

    /// The best score first.
    fn sort(&self, models: &mut [Model]) {
        models.sort_by(|a, b| self.score(b).total_cmp(&self.score(a)));
    }

    /// Whether the causes that a model has beyond another's lower the error by as much as matters.
    fn pays(&self, m: &Model, base: &Model) -> bool {
        let more = m.fitted.effects.len() as i32 - base.fitted.effects.len() as i32;
        let to = MATTERS.powi(more);
        m.raw < to * base.raw
            && m.foretold.mean_square() < to * base.foretold.mean_square()
            && self.score(m) > self.score(base)
    }

    /// Series of causes that grow from the best single ones, as long as the next one pays.
    fn grow(&mut self, wanted: &(dyn Fn(&str) -> bool + Sync)) {
        let mut known: Vec<Vec<&str>> = Vec::new();
        let mut starts: Vec<usize> = Vec::new();
        for (i, m) in self.models.iter().enumerate() {
            if starts.len() < STARTS
                && !starts.iter().any(|&s| self.models[s].ids() == m.ids())
                && self.pays(m, &self.plain)
            {
                starts.push(i);
            }
        }
        for start in starts {
            let mut at = start;
            while self.models[at].fitted.effects.len() < MOST {
                let mut set = self.models[at].ids();
                set.sort_unstable();
                if known.contains(&set) {
                    break;
                }
                known.push(set);
                let mut next = self.bench.beside(&self.models[at], wanted, BESIDE);
                self.sort(&mut next);
                let pays = |n: &Model| self.pays(n, &self.models[at]);
                let better = next.first().is_some_and(pays);
                at = self.models.len();
                self.models.extend(next);
                if !better {
                    break;
                }
            }
        }
    }

    /// The best model without each of its causes: what a series may no longer need.
    fn without_each(&mut self) {
        let score = |m: &Model| self.score(m);
        let best = (self.models.iter()).max_by(|a, b| score(a).total_cmp(&score(b)));
        let Some(best) = best.filter(|m| m.fitted.effects.len() > 1) else {
            return;
        };
        let (bench, fitted) = (&self.bench, &best.fitted);
        let without: Vec<Model> = (0..fitted.effects.len())
            .into_par_iter()
            .filter_map(|i| {
                let mut rest = fitted.effects.clone();
                rest.remove(i);
                bench.judge(bench.problem.fit_near(fitted, &rest, POLISH))
            })
            .collect();
        self.models.extend(without);
    }

    /// Finds out what memories held where recordings begin that were held out.
    fn begin_held_out(&mut self) -> Result<(), Error> {
        let problem = self.bench.problem;
        self.models.par_iter_mut().try_for_each(|m| {
            m.fitted = under_way::of_held_out(problem, m.fitted.clone())?;
            Ok(())
        })
    }

    /// Of models with the same causes, which other starts came to, the best one stays.
    fn once_each(&mut self) {
        let mut models = std::mem::take(&mut self.models);
        self.sort(&mut models);
        let mut known: Vec<Vec<&str>> = Vec::new();
        models.retain(|m| {
            let mut set = m.ids();
            set.sort_unstable();
            let new = !known.contains(&set);
            known.push(set);
            new
        });
        self.models = models;
    }

    /// Flexible models of every site beside the plain model and beside the best; models that cannot be are
    /// dropped: what leaves far less than noise, and than any flexible model, has made the input told small,
    /// not the error.
    fn hold_against_flexible_ones(&mut self) {
        self.twins
            .extend(self.bench.twin(&self.plain.fitted, self.independent));
        let possible = self.twins.first().map_or(1.0, Foretold::mean_square);
        self.models.retain(|m| m.raw > TOO_GOOD * possible.min(1.0));
        let best = self.models.iter().min_by(|a, b| by_foretold(a, b));
        let beside = best.and_then(|m| self.bench.twin(&m.fitted, self.independent));
        self.twins.extend(beside);
        let problem = self.bench.problem;
        if let Ok(tangent) = Tangent::new(problem, &self.plain.fitted) {
            let residual = problem.residual(&self.plain.fitted);
            let least = self.least();
            self.moments = moments(&residual, &tangent, &self.bench.blocks, least);
        }
    }

    /// The plain model with leaps at moments, where it foretells more than a model and all that goes on without
    /// a leap do, by as much as matters: no cause of the catalogue comes at a moment.
    fn leaps_beyond(&self, m: &Model) -> Option<&Moments> {
        self.moments.as_ref().filter(|leaps| {
            let (own, independent) = (&leaps.foretold, leaps.independent);
            let others = self.twins.iter().chain([&m.foretold]);
            others.into_iter().all(|f| {
                own.mean_square() < MATTERS * f.mean_square()
                    && own.log_density(independent) > f.log_density(independent)
            })
        })
    }

    /// The plain model, then those with causes.
    fn all(&self) -> impl Iterator<Item = &Model> {
        std::iter::once(&self.plain).chain(&self.models)
    }

    /// Works out odds and order from what the models foretell.
    fn weigh(&self, odds: &mut Odds) {
        let others = self.models.iter().map(|m| &m.foretold);
        let told = std::iter::once(&self.plainest(odds).foretold).chain(others);
        let told: Vec<(&Foretold, f64)> = told.zip(odds.prior.iter().copied()).collect();
        let forms = Forms::Reach {
            more: &self.twins,
            from: &self.grown_from(),
        };
        odds.probability = blocks::odds(&told, forms, self.independent);
        let score = |i: usize| self.score(&self.models[i]);
        odds.order = (0..self.models.len()).collect();
        odds.order.sort_by(|&a, &b| {
            let likelier = odds.probability[1 + b].total_cmp(&odds.probability[1 + a]);
            likelier.then(score(b).total_cmp(&score(a)))
        });
    }

    /// Odds that no cause is at work, or one that hardly lowers the error.
    fn nothing_that_matters(&self, odds: &Odds) -> f64 {
        let plainest = self.plainest(odds);
        let causes = self.models.iter().zip(&odds.probability[1..]);
        let idle = causes.filter(|(m, _)| !self.pays(m, plainest));
        odds.probability[0] + idle.map(|(_, p)| p).sum::<f64>()
    }

    /// For each of [`Field::all`] the place of the best model that has all its causes but one; 0, the plain
    /// one, where there is none.
    fn grown_from(&self) -> Vec<usize> {
        let size = |m: &Model| m.fitted.effects.len();
        let without_one = |m: &Model| {
            let parts = self.all().enumerate().filter(|(_, s)| {
                size(s) > 0 && size(s) + 1 == size(m) && s.ids().iter().all(|id| m.has(id))
            });
            let best = parts.max_by(|a, b| self.score(a.1).total_cmp(&self.score(b.1)));
            best.map_or(0, |(place, _)| place)
        };
        self.all().map(without_one).collect()
    }

    /// Odds of all models that have a cause.
    fn of_cause(&self, odds: &Odds, id: &str) -> f64 {
        let sets = self.models.iter().zip(&odds.probability[1..]);
        sets.filter(|(m, _)| m.has(id)).map(|(_, p)| p).sum()
    }

    /// The likeliest model whose causes all stand on their own; what cannot be leaves its odds to the others.
    fn name(&self) -> Odds {
        let mut odds = Odds {
            prior: self.all().map(|m| self.bench.prior_of(m)).collect(),
            probability: Vec::new(),
            order: Vec::new(),
            named: None,
            within_sample: None,
            why_not: Vec::new(),
        };
        self.weigh(&mut odds);
        let mut at = 0;
        while at < odds.order.len() {
            let i = odds.order[at];
            at += 1;
            let Some(alike) = self.stands(&odds, i) else {
                continue;
            };
            let fitted = &self.models[i].fitted;
            let size = size_is_nothing(self.bench.problem, fitted);
            if size.as_ref().is_some_and(|s| s.within_sample) && fitted.effects.len() == 1 {
                odds.within_sample.get_or_insert(i);
            }
            let no = || lowers_nothing(self.bench.problem, &self.plain.fitted, fitted);
            let Some(reason) = size.map(|s| s.reason).or_else(no) else {
                odds.named = Some((i, alike));
                break;
            };
            if !odds.why_not.contains(&reason) {
                odds.why_not.push(reason);
            }
            odds.prior[1 + i] = f64::NEG_INFINITY;
            self.weigh(&mut odds);
            at = 0;
        }
        odds
    }

    /// For each cause of a model those that the recordings cannot tell from it, itself first, where the model
    /// was not turned away, pays, and every cause is likelier than not with those.
    fn stands(&self, odds: &Odds, i: usize) -> Option<Vec<Vec<&'static str>>> {
        let m = &self.models[i];
        let size = |m: &Model| m.fitted.effects.len();
        let part = |s: &&Model| size(s) < size(m) && s.ids().iter().all(|id| m.has(id));
        if odds.prior[1 + i] == f64::NEG_INFINITY
            || !self.pays(m, self.plainest(odds))
            || !self.models.iter().filter(part).all(|s| self.pays(m, s))
        {
            return None;
        }
        let mut groups = alike_sets(&self.bench, m, &self.seen.groups);
        let instead: Vec<Vec<(&'static str, bool)>> = (groups.iter())
            .map(|set| self.instead(odds, i, set[0]))
            .collect();
        for (set, instead) in groups.iter_mut().zip(&instead) {
            for (id, rivals) in instead {
                if *rivals && !set.contains(id) {
                    set.push(id);
                }
            }
        }
        let own = |id: &str| self.of_cause(odds, id);
        let sure = groups.iter().all(|set| {
            let together: f64 = set.iter().map(|id| own(id)).sum();
            together >= 0.5 && set.iter().all(|id| own(id) <= own(set[0]))
        });
        // what was fitted in a cause's place says better than traces what can be told from it
        for (set, instead) in groups.iter_mut().zip(&instead) {
            set.retain(|id| instead.contains(&(id, true)) || !instead.contains(&(id, false)));
        }
        sure.then_some(groups)
    }

    /// The causes that were fitted in the place of `own` in a model, and whether that is nearly as likely.
    fn instead(&self, odds: &Odds, i: usize, own: &str) -> Vec<(&'static str, bool)> {
        let m = &self.models[i];
        let cause = |r: &Model| {
            let others = r.ids().into_iter().filter(|id| !m.has(id));
            let others: Vec<&'static str> = others.collect();
            let swapped = r.fitted.effects.len() == m.fitted.effects.len() && !r.has(own);
            (swapped && others.len() == 1).then(|| others[0])
        };
        let least = RIVALS * odds.probability[1 + i];
        (self.models.iter().zip(&odds.probability[1..]))
            .filter_map(|(r, p)| Some((cause(r)?, *p >= least)))
            .collect()
    }

    /// What can be foretold at all.
    fn reach(&self) -> Option<&Foretold> {
        let models = self.models.iter().map(|m| &m.foretold);
        let all = self.twins.iter().chain(models);
        all.min_by(|a, b| a.mean_square().total_cmp(&b.mean_square()))
    }

    /// Mean square that is left where all is foretold that can be, and noise.
    fn least(&self) -> f64 {
        let flexible = self
            .twins
            .iter()
            .map(|f| f.mean_square().max(MADE_BY_NOISE));
        let models = self.all().map(|m| m.foretold.mean_square());
        models.chain(flexible).fold(f64::INFINITY, f64::min)
    }

    /// Share that a model leaves of what could be foretold, or of what noise does not make.
    fn left(&self, m: &Model) -> f64 {
        let (base, least) = (self.plain.foretold.mean_square(), self.least());
        let reached = (m.foretold.mean_square() - least) / (base - least).max(1e-12 * base);
        let beyond = (m.raw - LOUD) / (self.plain.raw - LOUD).max(1e-9);
        reached.max(beyond).clamp(0.0, 1.0)
    }

    /// Probability that something unlisted is at work where a model leaves this share of what can be
    /// foretold. The shares that listed causes leave are those of their forms ([`form_leaves`]); each cause
    /// beyond the first has to be at work, too.
    fn unlisted(&self, m: &Model, share: f64) -> f64 {
        let more = m.fitted.effects.len().saturating_sub(1);
        let least = self.least();
        let way = self.plain.foretold.mean_square() - least;
        let leaves = form_leaves(share, way, least);
        let listed = (1.0 - UNLISTED) * EXPECTED.powi(more as i32) * leaves;
        let other = UNLISTED * unlisted_leaves(share);
        other / (other + listed)
    }

    /// Whether another model foretells so much more that a model's own form, clock and noise of the
    /// coordinate do not account for it.
    fn is_beaten(&self, m: &Model) -> Result<bool, Error> {
        let own = self.bench.blurred(m)?;
        let raw = m.raw * own.mean_square() / m.foretold.mean_square().max(f64::MIN_POSITIVE);
        Ok(self.reach().is_some_and(|f| {
            f.beats(&own) > BETTER
                && WORTH_SAYING * f.mean_square() < own.mean_square()
                && raw.min(m.fits) > WORTH_SAYING
        }))
    }

    /// Whether what a model leaves is more than noise makes, and has a structure that noise has not.
    fn leaves_structure(&self, m: &Model) -> Result<bool, Error> {
        let (problem, state) = (self.bench.problem, &m.fitted.state);
        let design = problem
            .residual(&m.fitted)
            .design(&state.eta, &state.beta)?;
        let residual = design.column(design.ncols() - 1);
        let shape = |f| problem.train.noise_shape(&state.beta, f);
        let (left, blocks) = (residual.as_slice(), &self.bench.blocks);
        let happens =
            || in_bursts(left, blocks, self.independent) || is_structured(left, blocks, shape);
        Ok(m.raw > NOISE_AT_MOST && happens())
    }

    /// Whether the model that is named says enough of what there is.
    fn convinces(&self, m: &Model) -> Result<bool, Error> {
        let share = |own: f64, plain: f64| (own - 1.0).max(0.0) / (plain - 1.0).max(1e-9);
        let (problem, plain) = (self.bench.problem, &self.plain);
        if share(m.raw, plain.raw) > LEFT_AT_MOST
            || self.unlisted(m, self.left(m)) > 0.5
            || self.leaps_beyond(m).is_some()
        {
            return Ok(false);
        }
        if !barely_foretells(problem, plain, m) {
            return Ok(true);
        }
        let loud = m.fits > LOUD && share(m.fits, plain.fits) > LEFT_IF_LOUD;
        Ok(!loud && !misses(problem, m, self.independent)?)
    }

    fn verdict(&self, odds: &Odds, rate: f64) -> Result<Verdict, Error> {
        let chance = &self.seen.chance;
        let significant = chance.largest / chance.limit(rate) > 1.0;
        if let Some((named, _)) = &odds.named
            && significant
            && odds.probability[0] < 0.5
            && self.convinces(&self.models[*named])?
        {
            return Ok(Verdict::MissingPhysics);
        }
        let m = self.plainest(odds);
        let more = self.is_beaten(m)?
            || self.leaves_structure(m)?
            || misses(self.bench.problem, m, self.independent)?;
        Ok(match more {
            true => Verdict::Unexplained,
            false => Verdict::Adequate,
        })
    }

    /// The plain model, on one clock: one that is a fraction of a sample off is no cause, and what it makes
    /// is none either.
    fn plainest(&self, odds: &Odds) -> &Model {
        let apart = odds.within_sample.map(|i| &self.models[i]);
        apart.unwrap_or(&self.plain)
    }

    /// What a verdict comes to.
    fn explain(
        self,
        odds: Odds,
        verdict: Verdict,
        remarks: &mut Vec<String>,
        request: &Request,
    ) -> Result<Diagnosis, Error> {
        let (problem, plain) = (self.bench.problem, &self.plain);
        let in_model = verdict == Verdict::MissingPhysics;
        let named = odds.named.as_ref().map(|(i, _)| &self.models[*i]);
        let augmented = named.filter(|_| in_model).unwrap_or(plain);
        // what nothing listed accounts for, or what is left beside it
        let told = &augmented.fitted;
        let more = match verdict {
            Verdict::Adequate => false,
            Verdict::MissingPhysics => self.leaves_structure(augmented)?,
            Verdict::Unexplained => true,
        };
        let steady = self.leaps_beyond(augmented).is_none();
        let learnt = match more && steady && request.only.is_empty() {
            true => learn_along(problem, told, &self.bench.blocks, self.independent)?,
            false => None,
        };
        let taught = that_holds(problem, told, learnt, remarks)?;
        let with_it = taught.as_ref().map_or(told, |t| &t.fitted);
        let something_else = match (named, verdict) {
            (Some(m), _) => self.unlisted(m, self.left(m)),
            (None, Verdict::Unexplained) => self.unlisted(plain, 1.0),
            (None, _) => self.unlisted(plain, 0.0),
        };
        if !in_model {
            remarks.extend(odds.why_not.iter().cloned());
        }
        remarks.extend(self.remarks(verdict, augmented, self.plainest(&odds)));
        remarks.extend(under_way::remark(problem, &augmented.fitted));
        let candidates = self.candidates(&odds, in_model, augmented, something_else);
        let groups: Vec<Vec<&'static str>> = match (&odds.named, in_model) {
            (Some((_, sets)), true) => sets.iter().filter(|s| s.len() > 1).cloned().collect(),
            _ => Vec::new(),
        };
        let places = places(problem, &plain.fitted, &augmented.fitted)?;
        let law = (verdict == Verdict::Unexplained && taught.is_none())
            .then(|| law::law(problem, &plain.fitted))
            .transpose()?;
        let (train, holdout, traces) = gains(problem, &plain.fitted, with_it)?;
        let learnt = match &taught {
            Some(t) => {
                let (_, own, _) = gains(problem, told, with_it)?;
                let gap = own.map_or(f64::NAN, |h| h.gap_closed());
                Some(physics(problem, told, t, &self.seen.groups, gap)?)
            }
            None => None,
        };
        let words = problem.train.words();
        let apart = odds
            .within_sample
            .filter(|_| verdict == Verdict::Adequate)
            .map(|i| sample_apart(problem, &plain.fitted, &self.models[i].fitted))
            .transpose()?;
        // what named causes bring about alone
        let alone = match (&taught, in_model) {
            (Some(_), true) => Some(gains(problem, &plain.fitted, told)?),
            _ => None,
        };
        let (own, own_held) = alone
            .as_ref()
            .map_or((&train, &holdout), |(own, held, _)| (own, held));
        let said = || {
            says(
                verdict,
                &candidates,
                own,
                own_held.as_ref(),
                &places,
                &words,
                &groups,
            )
        };
        let mut says = apart.unwrap_or_else(said);
        if let Some(learnt) = &learnt {
            let beside = if learnt.beside { ", beside that" } else { "" };
            says += &format!(" Learnt from the recordings{beside}: {}", learnt.says);
        }
        let nothing = match verdict {
            Verdict::Adequate => self.nothing_that_matters(&odds).max(0.5),
            _ => odds.probability[0],
        };
        let listed = 1.0 - something_else;
        let probabilities = [listed * nothing, listed * (1.0 - nothing), something_else];
        let allowed = self.seen.chance.fall(request.false_alarm_rate);
        let state = &with_it.state;
        Ok(Diagnosis {
            verdict,
            confidence: match verdict {
                Verdict::Adequate => nothing,
                Verdict::MissingPhysics => probabilities[1],
                Verdict::Unexplained => something_else.max(0.5),
            },
            probabilities,
            departed: Vec::new(),
            beyond: None,
            built: f64::NAN,
            next_experiment: next_experiment(verdict, &groups, &candidates, &places, &words),
            places,
            groups,
            hidden: hidden(problem, &self.seen.scanned, allowed),
            train,
            holdout,
            plain: parameters(problem, &plain.fitted),
            parameters: parameters(problem, with_it),
            pose: None,
            eps_r: f64::NAN,
            rig: problem.train.rig(),
            values: Subject::values(&problem.train, &state.eta, &state.beta),
            unit: words.unit,
            basis: words.basis,
            over: words.over,
            plain_mean_square: plain.fits,
            plain_holdout_mean_square: plain.raw,
            law,
            learnt,
            traces,
            dated: Vec::new(),
            remarks: std::mem::take(remarks),
            says,
            evidence: self.evidence(&odds, &candidates, request.false_alarm_rate),
            rivals: self.seen.rivals,
            rival_models: self.seen.rival_models,
            candidates,
        })
    }

    /// What weakens a verdict: far less than noise is left, or far more.
    fn remarks(&self, verdict: Verdict, augmented: &Model, plainest: &Model) -> Vec<String> {
        let mut out = Vec::new();
        if augmented.raw < TOO_GOOD {
            out.push(format!("What is left is {:.2} of the noise that was read from the recordings: the noise floor is too high, or the model is too free; look at the repeats.", augmented.raw.sqrt()));
        }
        if verdict == Verdict::Unexplained
            && let Some(leaps) = self.leaps_beyond(&self.plain)
        {
            let lines: Vec<_> = self.bench.problem.train.lines().collect();
            let of = |number: usize| {
                let own = leaps.at.iter().filter(|a| a.0 == number);
                let each: Vec<String> = own
                    .map(|(_, t)| match lines[number].timed {
                        true => format!("{t:.3} s"),
                        false => format!("row {t:.0}"),
                    })
                    .collect();
                (!each.is_empty()).then(|| format!("{} ({})", lines[number].id, each.join(", ")))
            };
            let list: Vec<String> = (0..lines.len()).filter_map(of).collect();
            let left = leaps.foretold.mean_square() / self.plain.foretold.mean_square();
            out.push(format!(
                "It comes at moments: with leaps of zero or stiffness in {} the plain model leaves {} % of its mean \
                 square. Look what happened then: a knock, a slip, a tear, lost counts.",
                list.join(", "),
                short(100.0 * left)
            ));
        }
        if verdict == Verdict::Adequate && plainest.raw > MAY_BE_NOISE {
            out.push("Model and recordings differ by more than the noise that is read above the band of the signal, but neither a cause nor a flexible model of position, rate, direction, history, input and time foretells it, and it has the spectrum of noise: it is taken for noise within the band.".into());
        }
        out
    }

    /// Each cause once, with the likeliest model that has it; those of the augmented model first.
    fn candidates(
        &self,
        odds: &Odds,
        in_model: bool,
        augmented: &Model,
        something_else: f64,
    ) -> Vec<Candidate> {
        let problem = self.bench.problem;
        let own = in_model.then_some(augmented);
        let by_odds = odds.order.iter().map(|&i| &self.models[i]);
        let mut listed: Vec<(&Model, usize)> = Vec::new();
        for m in own.into_iter().chain(by_odds) {
            for e in 0..m.fitted.effects.len() {
                let id = |m: &Model, e: usize| m.fitted.effects[e].effect.id();
                if !listed.iter().any(|l| id(l.0, l.1) == id(m, e)) {
                    listed.push((m, e));
                }
            }
        }
        let candidate = |(m, own): (&Model, usize)| {
            let acting = &m.fitted.effects[own];
            let estimates = value_estimates(problem, &m.fitted, false)
                .unwrap_or_else(|_| unknown_values(&m.fitted));
            let is_in = in_model && std::ptr::eq(m, augmented);
            let likely = (1.0 - something_else) * self.of_cause(odds, acting.effect.id());
            let (alone, _) = UnderWay::apart(acting);
            let mut own_values = values(problem, &m.fitted, own, &estimates);
            own_values.truncate(alone.values.len());
            Candidate {
                acting: alone,
                probability: if is_in { likely } else { likely.min(NOT_NAMED) },
                delta_bic: -2.0 * (self.score(m) - self.score(&self.plain)),
                mean_square: m.fits,
                holdout_mean_square: m.raw,
                in_model: is_in,
                values: own_values,
                says: format!(
                    "{}; over blocks that took no part in the fit the weighted mean square {}",
                    acting.effect.says(),
                    goes(self.plain.raw, m.raw)
                ),
            }
        };
        let mut out: Vec<Candidate> = listed.into_iter().map(candidate).collect();
        out.sort_by(|a, b| {
            let likelier = b.probability.total_cmp(&a.probability);
            b.in_model.cmp(&a.in_model).then(likelier)
        });
        out
    }

    /// What the verdict rests on.
    fn evidence(&self, odds: &Odds, candidates: &[Candidate], rate: f64) -> Evidence {
        let chance = &self.seen.chance;
        let tried = odds.order.iter().map(|&i| {
            let m = &self.models[i];
            (
                m.ids(),
                self.score(&self.plain) - self.score(m),
                m.fits,
                m.raw,
            )
        });
        let fall = candidates.iter().map(|c| self.plain.fits - c.mean_square);
        Evidence {
            surprise: chance.largest,
            whose: chance.whose,
            limit: chance.limit(rate),
            noise_scale: chance.scale,
            each: chance.each.clone(),
            tried: tried.collect(),
            p_value: chance.p_value(),
            fall: fall.fold(0.0, f64::max),
            fall_by_chance: chance.fall(rate),
        }
    }
}

fn by_foretold(a: &Model, b: &Model) -> std::cmp::Ordering {
    (a.foretold.mean_square()).total_cmp(&b.foretold.mean_square())
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
    let Ok((train, traces)) = train_gain(problem, plain, fitted) else {
        return nothing_told();
    };
    let falls = |before: f64, after: f64| after <= MATTERS * before;
    // what one recording tells of, the noise of the others may hide
    let in_one = |t: &Traces| {
        let squares = |errors: &[[f64; 3]]| -> f64 {
            let counting = errors.iter().map(|e| e[0]).filter(|e| e.is_finite());
            counting.map(|e| e * e).sum()
        };
        falls(squares(&t.before_v), squares(&t.after_v))
    };
    if !falls(train.before_v.powi(2), train.after_v.powi(2)) && !traces.iter().any(in_one) {
        return Some(why("where it was fitted", &train));
    }
    match holdout_gain(problem, problem.holdout.as_ref(), plain, fitted) {
        Err(_) => nothing_told(),
        Ok(Some((held, _))) if held.after_v > held.before_v => {
            Some(why("on what took no part", &held))
        }
        Ok(_) => None,
    }
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
    let (told, _) = train_gain(problem, plain, fitted)?;
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

/// From one number to another, in words.
fn goes(before: f64, after: f64) -> String {
    match [before, after].map(short) {
        [before, after] if before == after => format!("stays at {before}"),
        [from, to] if after < before => format!("falls from {from} to {to}"),
        [from, to] => format!("rises from {from} to {to}"),
    }
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
