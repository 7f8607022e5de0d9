//! The chain of a doubt on a robot, in rounds: the plain fit, a scan of the catalogue, fits of the leading
//! causes, a second one, the verdict. A round that finds parts in the place of a cause, or leaning towards
//! one, begins another with them. Each step gives a value to the next: [`Ground`], [`Seen`], [`Field`],
//! [`Choice`].

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::blocks::typical_form;
use super::chance::{self, Chance};
use super::errors::{above_noise, beyond_noise, lowers_error, taken_away};
use super::fits::{
    baseline, choose, of_the_rare, or_nominal, ordinary, plainest, polish, refit, with_partner,
};
use super::judge::{Judged, Odds, alike};
use super::outcome::*;
use super::parts::Causes;
use super::problem::{Fitted, Problem, Tangent, over_series};
use super::scan::{Group, Scanned, Unit, fingerprints, scan, units};
use super::subject::Subject;
use super::tolerance::{self, Built, FAR};
use super::verdict::{
    earns, foretells, ids, joins, leaves_far_more, leaves_too_much, never_adequate, unexplained,
};
use super::words::in_unit;
use super::{
    BASE_RATES, BASELINE, FIRST, FITTED, FITTED_IF_QUIET, LEADING, PAIR_ABOVE, POLISH, QUIET,
    RIVALS, SMOOTHED_BELOW, SURPRISES_TOO, SURPRISING, WEAK_BELOW, rewhiten, rivals,
};
use crate::effects::{Acting, is_rare, plain_name};

/// Recordings under doubt.
pub(super) struct Case<'a, S> {
    pub problem: Problem<S>,
    /// What was held out until all is chosen: it chooses nothing, and can only keep a name from being said.
    pub holdout: Option<S>,
    pub remarks: Vec<String>,
    pub request: &'a Request,
    pub watch: &'a (dyn Fn(&str) + Sync),
}

/// Parts that differ within their tolerances, and the fit in which they were told.
type Parts = (Built, Fitted);

/// What a round ends with.
enum Round {
    /// Another one is needed, with these parts.
    Again(Box<Parts>),
    Told(Box<(Field, Choice)>),
}

impl Round {
    fn again(parts: Parts) -> Round {
        Round::Again(Box::new(parts))
    }
}

/// The plain model before anything else was looked at.
pub(super) struct Ground {
    /// Parts that differ.
    built: Option<Built>,
    /// The fit with causes beside which they were told.
    start: Option<Fitted>,
    pub plain: Fitted,
    /// Noise of an ordinary film ([`Problem::log_noise`]).
    ordinary: [f64; 2],
}

/// What a scan of the catalogue shows.
pub(super) struct Seen {
    pub groups: Vec<Group>,
    pub units: Vec<Unit>,
    pub scanned: Vec<Scanned>,
    pub chance: Chance,
    /// What simpler methods name, and the models that they end with.
    pub rivals: Vec<(&'static str, bool, Option<&'static str>)>,
    pub rival_models: Vec<RivalModel>,
}

/// The plain model and those of one cause, judged.
pub(super) struct Field {
    pub built: Option<Built>,
    start: Option<Fitted>,
    pub seen: Seen,
    pub plain: Judged,
    /// Those that foretell better first; among them, the best score first.
    pub singles: Vec<Judged>,
    /// By how much the leader's score overstates the evidence.
    overstated: f64,
    /// Logarithm of the prior odds of one cause.
    pub each: f64,
    /// Largest fall of the sum of squares with one cause, and what chance makes of it.
    pub fall: f64,
    pub by_chance: f64,
    /// Whether the plain model leaves more than any noise does.
    pub beyond_noise: bool,
}

/// What is chosen among one cause and several.
pub(super) struct Choice {
    pub partners: Vec<Judged>,
    pub pair: Option<Judged>,
    pub best: Judged,
    pub odds: Odds,
    pub verdict: Verdict,
    /// Whether what is named acts at the edge of the range, where angles do not tell what it does.
    pub at_edge: bool,
}

impl<'a, S: Subject> Case<'a, S> {
    pub fn new(
        mut problem: Problem<S>,
        remarks: Vec<String>,
        request: &'a Request,
        watch: &'a (dyn Fn(&str) + Sync),
    ) -> Self {
        let undated = request.undated;
        problem.assumed =
            undated.then(|| [problem.train_when.clone(), problem.holdout_when.clone()]);
        Case {
            holdout: problem.holdout.take(),
            problem,
            remarks,
            request,
            watch,
        }
    }

    /// Round after round until no parts ask for another.
    pub fn rounds(&mut self) -> Result<(Field, Choice), Error> {
        let ground = self.ground(None)?;
        self.rounds_from(ground)
    }

    /// The same, from a plain model that is fitted already.
    pub fn rounds_from(&mut self, mut ground: Ground) -> Result<(Field, Choice), Error> {
        loop {
            match self.round(ground)? {
                Round::Again(parts) => ground = self.ground(Some(*parts))?,
                Round::Told(told) => return Ok(*told),
            }
        }
    }

    /// From the plain fit to a verdict, or to parts with which it is to be asked again.
    fn round(&mut self, mut ground: Ground) -> Result<Round, Error> {
        let mut seen = self.look(&mut ground)?;
        let fits = self.lead(&mut ground, &mut seen)?;
        let mut field = self.judge(ground, seen, fits);
        let adequate = self.is_adequate(&field)?;
        if !adequate && let Some(parts) = self.parts_beside_the_leader(&field)? {
            return Ok(Round::again(parts));
        }
        let mut choice = self.choose(&mut field, adequate)?;
        if !adequate && let Some(parts) = self.parts_beside_two(&field, &choice)? {
            return Ok(Round::again(parts));
        }
        let supported = !adequate && field.supports(&self.problem, &choice.best, &choice.odds);
        let holdout = self.holdout.take();
        self.problem.take_up(holdout, field.built.as_ref())?;
        if !adequate {
            self.problem.date_held_out(&choice.best.fitted)?;
            choice.verdict = self.verdict(&field, &choice, supported)?;
        }
        if choice.verdict != Verdict::Adequate
            && let Some(parts) = self.parts_in_the_place(&field, &choice)?
        {
            return Ok(Round::again(parts));
        }
        if choice.verdict == Verdict::Unexplained && self.request.only.is_empty() {
            self.ask_the_rare(&mut field, &mut choice)?;
        }
        let before = self.remarks.len();
        match choice.verdict {
            Verdict::MissingPhysics => self.ask_what_matters(&field, &mut choice)?,
            Verdict::Unexplained => self.ask_what_is_left(&field, &mut choice)?,
            Verdict::Adequate => {}
        }
        if choice.verdict == Verdict::Adequate
            && let Some(parts) = self.a_part_as_a_cause(&field)?
        {
            self.remarks.truncate(before); // of a cause that this one may account for
            return Ok(Round::again(parts));
        }
        Ok(Round::Told(Box::new((field, choice))))
    }

    /// The plain model, fitted from nothing or, with parts, from where they were told.
    pub fn ground(&mut self, parts: Option<Parts>) -> Result<Ground, Error> {
        (self.watch)("fitting the plain model");
        let problem = &mut self.problem;
        let Some((built, start)) = parts else {
            let (plain, ordinary) = baseline(problem)?;
            return Ok(Ground {
                built: None,
                start: None,
                plain,
                ordinary,
            });
        };
        // it was that of another mechanism
        problem.put_back_smoothing();
        let ordinary = ordinary(problem)?;
        problem.weigh_if_believed(&start, ordinary)?;
        // what was told at other weights is told once more where these show more than noise
        let mut start = problem.fit_near(&start, &start.effects, BASELINE);
        let mut built = built;
        if start.cost() > PAIR_ABOVE * start.state.rows as f64 {
            match built.settled(problem, &start) {
                Ok(Some(told))
                    if told.0.farthest(&told.1) < FAR && held(problem, &self.holdout, &told) =>
                {
                    (built, start) = told;
                }
                _ => built.restore(problem)?,
            }
        }
        let plain = match start.effects[..] {
            [] => start.clone(),
            _ => problem.fit_near(&start, &[], BASELINE),
        };
        Ok(Ground {
            built: Some(built),
            start: Some(start).filter(|s| !s.effects.is_empty()),
            plain,
            ordinary,
        })
    }

    /// Scans the catalogue, and what simpler methods make of it.
    ///
    /// What capture and smoothing make of the plain model's own motion does not shrink as recordings grow,
    /// but their evidence does: it is taken out where that alone may have raised the alarm.
    fn look(&mut self, ground: &mut Ground) -> Result<Seen, Error> {
        let (problem, request) = (&mut self.problem, self.request);
        let state = &ground.plain.state;
        problem.begun = problem.train.begun(&state.eta, &state.beta)?;
        (self.watch)("scanning the catalogue");
        let wanted = wanted(request, ground.built.is_some());
        let mut tangent = Tangent::new(problem, &ground.plain)?;
        let groups = fingerprints(problem, &ground.plain, &wanted);
        let units = units(problem, &ground.plain)?;
        let mut scanned = scan(problem, &tangent, &groups, &units, &wanted);
        let mut chance = chance::chance(problem, &ground.plain, &tangent, &groups, &units)?;
        let alarmed = chance.largest >= chance.limit(request.false_alarm_rate)
            || never_adequate(&ground.plain, &chance);
        let rows = ground.plain.state.rows as f64;
        if ground.built.is_none()
            && alarmed
            && ground.plain.cost() < SMOOTHED_BELOW * rows
            && let Some(other) = problem.take_out_smoothing(&ground.plain)
        {
            ground.plain = other;
            tangent = Tangent::new(problem, &ground.plain)?;
            scanned = scan(problem, &tangent, &groups, &units, &wanted);
            chance = chance::chance(problem, &ground.plain, &tangent, &groups, &units)?;
        }
        let mut rival_models = Vec::new();
        if request.rivals {
            (self.watch)("fitting what simpler methods say");
            let (held, plain) = (self.holdout.as_ref(), &ground.plain);
            rival_models =
                rivals::rival_models(problem, held, plain, &tangent, &groups, &units, &wanted)?;
        }
        Ok(Seen {
            rivals: rivals::named(&tangent, &groups, &scanned),
            groups,
            units,
            scanned,
            chance,
            rival_models,
        })
    }

    /// Fits the causes that lead the scan, each alone, best first. Where one clearly does better than none,
    /// the weights become those of its noise, and the leading ones are fitted to their end.
    fn lead(&mut self, ground: &mut Ground, seen: &mut Seen) -> Result<Vec<Fitted>, Error> {
        (self.watch)("fitting the leading effects");
        let problem = &mut self.problem;
        let rate = self.request.false_alarm_rate;
        let (chosen, by_surprise) = shortlist(&seen.scanned, &seen.chance, &ground.plain, rate);
        let mut fits = refit(problem, &ground.plain, &chosen, &[]);
        if let Some(start) = ground.start.as_ref().filter(|s| s.effects.len() == 1) {
            fits.push(problem.fit_near(start, &start.effects, FIRST));
            fits.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        }
        // a leader that gains by making less of the noise must not set the weights of all
        let (least, rows) = (0.8 * ground.plain.cost(), ground.plain.state.rows as f64);
        let drifts = |f: &Fitted| over_series(&f.effects).is_some();
        if let Some(at) = fits.iter().position(drifts)
            && fits[at].cost() < least
            && let Some(dated) = problem.date(&fits[at], FIRST)
        {
            fits[at] = dated;
            for f in fits[at + 1..].iter_mut().filter(|f| drifts(f)) {
                *f = problem.fit_near(f, &f.effects, FIRST);
            }
            fits.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        }
        let leads = |f: &&Fitted| {
            let judged = || Judged::new(problem, &seen.chance.blocks, (*f).clone());
            f.cost() < least && judged().mean_square * rows < least
        };
        let Some(leader) = fits.first().filter(leads) else {
            return Ok(fits);
        };
        // The noise gain depends on the film, and the plain refit of a wrong model runs to an extreme one.
        let before = rewhiten::Before::new(problem);
        problem.weigh_if_believed(leader, ground.ordinary)?;
        before.change(problem).of(&mut seen.groups, &mut seen.units);
        let again = problem.fit_near(&ground.plain, &[], POLISH);
        ground.plain = or_nominal(problem, again, &[], POLISH);
        // The best of each hypothesis: those that fit best, and those that surprise most, which a film that
        // bends to others outdoes.
        let mut leading: Vec<&Fitted> = Vec::new();
        for f in &fits {
            let own = &f.effects[0];
            let known = leading.iter().any(|l| l.effects[0].is(own));
            let surprising = by_surprise.iter().any(|s| s.acting.is(own));
            if !known && (leading.len() < LEADING || surprising) {
                leading.push(f);
            }
        }
        (self.watch)("fitting the best of them to the end");
        let problem = &self.problem;
        problem.tally.expect(leading.len());
        let to_the_end = leading.into_par_iter().map(|f| {
            let polished = polish(problem, f);
            problem.tally.done();
            polished
        });
        Ok(to_the_end.collect())
    }

    /// Judges the plain model and those of one cause.
    ///
    /// A weak cause is told from slow noise by how its score scatters: what surprises little beside the most
    /// surprising one only takes up slow noise, and what is left over counts for less by as much as the
    /// leader's score overstates the evidence.
    fn judge(&self, ground: Ground, seen: Seen, fits: Vec<Fitted>) -> Field {
        let (problem, chance) = (&self.problem, &seen.chance);
        let judged = |f: Fitted| Judged::new(problem, &chance.blocks, f);
        let plain = judged(ground.plain);
        let mut singles: Vec<Judged> = fits.into_par_iter().map(judged).collect();
        let weak = plain.mean_square < WEAK_BELOW;
        if weak {
            let least = SURPRISES_TOO * chance.largest;
            let surprises = |j: &Judged| {
                let own = |a: &Acting| chance.surprise_of(a.effect.id()) >= least;
                j.fitted.effects.iter().any(own)
            };
            if singles.iter().any(surprises) {
                singles.retain(surprises);
            }
        }
        let by_score = |a: &Judged, b: &Judged| a.score.total_cmp(&b.score);
        let overstated = match singles.iter().min_by(|a, b| by_score(a, b)) {
            Some(j) if weak => {
                let a = &j.fitted.effects[0];
                chance.design(a.effect.id(), a.on)
            }
            _ => 1.0,
        };
        weigh_down(&mut singles, &plain, overstated);
        best_first(&mut singles, &plain);
        let fall = |j: &Judged| plain.fitted.cost() - j.fitted.cost();
        let mut listed: Vec<&str> = seen.groups.iter().map(|g| g.effect.id()).collect();
        listed.dedup();
        Field {
            built: ground.built,
            start: ground.start,
            overstated,
            each: (BASE_RATES[1] / BASE_RATES[0] / listed.len().max(1) as f64).ln(),
            fall: singles.iter().map(fall).fold(0.0, f64::max),
            by_chance: chance.fall(self.request.false_alarm_rate),
            beyond_noise: never_adequate(&plain.fitted, chance),
            plain,
            singles,
            seen,
        }
    }

    /// Whether the plain model suffices before more than one cause was looked at. Nothing confirms a cause
    /// where nothing was held out: the error itself has to stand out of the noise then.
    fn is_adequate(&self, field: &Field) -> Result<bool, Error> {
        if field.beyond_noise {
            return Ok(false);
        }
        let chance = &field.seen.chance;
        let odds = field.odds(&[]);
        let unsupported = |first: &Judged| !field.supports(&self.problem, first, &odds);
        let quiet = chance.largest < chance.limit(self.request.false_alarm_rate)
            || field.fall < field.by_chance
            || field.singles.first().is_some_and(unsupported);
        Ok(quiet || (self.holdout.is_none() && !above_noise(&self.problem, &field.plain.fitted)?))
    }

    /// Parts that were told without a cause that matters lean towards it: they are told once more beside the
    /// one that leads.
    fn parts_beside_the_leader(&mut self, field: &Field) -> Result<Option<Parts>, Error> {
        let (Some(built), None, Some(first)) = (&field.built, &field.start, field.singles.first())
        else {
            return Ok(None);
        };
        if !field.supports(&self.problem, first, &field.odds(&[])) {
            return Ok(None);
        }
        let [taken, noise] = taken_away(&self.problem, &field.plain.fitted, &first.fitted)?;
        if !field.beyond_noise && taken < self.request.relevant.unwrap_or(noise) {
            return Ok(None);
        }
        (self.watch)("telling parts beside the leading cause");
        let told = built.settled(&mut self.problem, &first.fitted)?;
        let told = told.filter(|t| held(&self.problem, &self.holdout, t));
        (told.as_ref().map_or(built, |t| &t.0)).restore(&mut self.problem)?;
        Ok(told)
    }

    /// Looks for a second cause where the first leaves more than noise, and chooses.
    fn choose(&self, field: &mut Field, adequate: bool) -> Result<Choice, Error> {
        let (mut pair, mut partners) = (None, Vec::new());
        if let (false, Some(first)) = (adequate, field.singles.first())
            && (first.mean_square > PAIR_ABOVE || field.given().is_some())
        {
            partners = self.partners(field, first)?;
            self.lead_back(field, &partners);
            pair = match field.singles.first() {
                Some(first) => self.pair(field, first, &partners)?,
                None => None,
            };
            if let Some(alone) = pair.as_ref().and_then(|p| self.alone(field, p)) {
                pair = None;
                field.singles.insert(0, alone);
            }
        }
        let odds = field.odds(&partners);
        // a second cause that is a part within its tolerance is none
        let list = self.problem.train.tolerances();
        let first = (field.singles.first()).map(|f| f.fitted.effects[0].effect.id());
        let of_a_part = |p: &Judged| {
            let others = p.fitted.effects.iter();
            let mut others = others.filter(|a| Some(a.effect.id()) != first);
            others.any(|a| tolerance::holds(&list, a))
        };
        pair = pair.filter(|p| field.supports(&self.problem, p, &odds) && !of_a_part(p));
        let blocks = &field.seen.chance.blocks;
        if let (false, Some(named)) = (adequate, pair.as_mut().or(field.singles.first_mut())) {
            *named = plainest(&self.problem, blocks, named, field.by_chance);
        }
        let best = pair.as_ref().or(field.singles.first());
        Ok(Choice {
            best: best.unwrap_or(&field.plain).clone(),
            partners,
            pair,
            odds,
            verdict: Verdict::Adequate,
            at_edge: false,
        })
    }

    /// Models of more than one cause, best first: the leading one and the next with their best partners, and
    /// the best partner with its own.
    fn partners(&self, field: &Field, first: &Judged) -> Result<Vec<Judged>, Error> {
        let problem = &self.problem;
        let Seen {
            groups,
            units,
            chance,
            ..
        } = &field.seen;
        let wanted = wanted(self.request, field.built.is_some());
        let by_score = |a: &Judged, b: &Judged| a.score.total_cmp(&b.score);
        let beside = |base: &Judged| {
            let names: Vec<String> = ids(base).map(plain_name).collect();
            let names = names.join(" and ");
            (self.watch)(&format!("looking for a second effect beside {names}"));
            let mut both = with_partner(problem, &chance.blocks, base, groups, units, &wanted)?;
            field.weigh_down(&mut both);
            both.sort_by(by_score);
            Ok::<_, Error>(both)
        };
        let second = field.singles.get(1);
        let near = |s: &&Judged| s.excess() < 4.0 * first.excess() && s.mean_square > PAIR_ABOVE;
        let second = second.filter(near);
        let mut partners: Vec<Judged> = Vec::new();
        for base in std::iter::once(first).chain(second) {
            partners.extend(beside(base)?);
        }
        if let Some(given) = field.given() {
            let both = problem.fit_near(given, &given.effects, POLISH);
            let mut both = [Judged::new(problem, &chance.blocks, both)];
            field.weigh_down(&mut both);
            partners.extend(both);
        }
        partners.sort_by(by_score);
        // The best partner of the best partner: a first choice may have stood in for two others.
        if let Some(other) = partners.first().map(|p| p.fitted.effects[1].clone()) {
            let tried = |j: &Judged| j.fitted.effects[0].effect.id() == other.effect.id();
            if !tried(first) && !second.is_some_and(tried) {
                let alone = problem.nominal(std::slice::from_ref(&other), POLISH);
                partners.extend(beside(&Judged::new(problem, &chance.blocks, alone))?);
            }
        }
        partners.sort_by(by_score);
        Ok(partners)
    }

    /// The best model of several causes that is to be preferred to the first alone. Two that the recordings
    /// cannot tell apart are one, unless one alone leaves far more than noise.
    fn pair(
        &self,
        field: &Field,
        first: &Judged,
        partners: &[Judged],
    ) -> Result<Option<Judged>, Error> {
        let chance = 3.0 * field.by_chance;
        // A second cause for which parts had stood in; where more than noise is left, it may only be another
        // form of the first.
        let beyond = |j: &Judged| field.beyond(j).is_some();
        let mends = |p: &Judged| {
            let noise = p.mean_square < PAIR_ABOVE;
            noise && beyond(first) && !beyond(p) && earns(first, p, chance)
        };
        let joining = |p: &&Judged| joins(first, p, chance) || mends(p);
        let Some(pair) = partners.iter().find(joining) else {
            return Ok(None);
        };
        if !leaves_too_much(&self.problem, &field.plain, first)? {
            let same = alike(&self.problem, &first.fitted, 0, &field.seen.groups);
            if ids(pair).any(|id| same.contains(&id)) {
                return Ok(None);
            }
        }
        Ok(Some(pair.clone()))
    }

    /// The causes of a pair, each alone, led from the values that it has there.
    fn each_alone(&self, field: &Field, pair: &Judged) -> Vec<Judged> {
        let problem = &self.problem;
        let alone = |own: &Acting| {
            let fit = problem.fit_near(&pair.fitted, std::slice::from_ref(own), POLISH);
            Judged::new(problem, &field.seen.chance.blocks, fit)
        };
        let mut each: Vec<Judged> = pair.fitted.effects.par_iter().map(alone).collect();
        field.weigh_down(&mut each);
        each
    }

    /// The cause of a pair that does as well alone: a slow creep whose time no start was near is found beside
    /// a drift.
    fn alone(&self, field: &Field, pair: &Judged) -> Option<Judged> {
        let suffices = |j: &Judged| !joins(j, pair, 3.0 * field.by_chance);
        let each = self.each_alone(field, pair).into_iter().filter(suffices);
        each.min_by(|a, b| a.score.total_cmp(&b.score))
    }

    /// A cause that a film bent to it hides alone may be found beside another one: those of the best two,
    /// where they explain far more than the first, are fitted alone from where they were found.
    fn lead_back(&self, field: &mut Field, partners: &[Judged]) {
        let (Some(first), Some(two)) = (field.singles.first(), partners.first()) else {
            return;
        };
        if !leaves_far_more(first, two) || !earns(first, two, 3.0 * field.by_chance) {
            return;
        }
        for led in self.each_alone(field, two) {
            let own = led.fitted.effects[0].effect.id();
            let known = field.singles.iter().filter(|s| ids(s).any(|id| id == own));
            let best = known.map(|s| s.score).fold(f64::INFINITY, f64::min);
            if led.score < best {
                field.singles.push(led);
            }
        }
        best_first(&mut field.singles, &field.plain);
    }

    /// Parts far beyond their tolerances may stand in for a second cause: they are told once more beside the
    /// two that do best, which counts where all are within then and noise alone is left.
    fn parts_beside_two(&mut self, field: &Field, choice: &Choice) -> Result<Option<Parts>, Error> {
        let (Some(built), None, Some(two)) = (&field.built, field.given(), choice.partners.first())
        else {
            return Ok(None);
        };
        let far = field.beyond(&choice.best).is_some();
        if !far || !earns(&choice.best, two, 3.0 * field.by_chance) {
            return Ok(None);
        }
        (self.watch)("telling parts beside two causes");
        let most = PAIR_ABOVE * field.plain.fitted.state.rows as f64;
        let within = |(b, f): &Parts| b.beyond(f).is_none() && f.cost() < most;
        let told = built.settled(&mut self.problem, &two.fitted);
        let told = told.ok().flatten().filter(within);
        let told = told.filter(|t| held(&self.problem, &self.holdout, t));
        (told.as_ref().map_or(built, |t| &t.0)).restore(&mut self.problem)?;
        Ok(told)
    }

    /// The verdict on a plain model that does not suffice by what was fitted; what was held out is heard now.
    fn verdict(&self, field: &Field, choice: &Choice, supported: bool) -> Result<Verdict, Error> {
        let (problem, plain, best) = (&self.problem, &field.plain, &choice.best);
        let lowers = lowers_error(problem, &plain.fitted, &best.fitted)?;
        if field.singles.is_empty() || (!lowers && !field.beyond_noise) {
            return Ok(Verdict::Adequate);
        }
        if !lowers || !supported || leaves_too_much(problem, plain, best)? {
            return Ok(Verdict::Unexplained);
        }
        Ok(Verdict::MissingPhysics)
    }

    /// Parts that differ within their tolerances may do better than any cause of a robot as drawn.
    fn parts_in_the_place(
        &mut self,
        field: &Field,
        choice: &Choice,
    ) -> Result<Option<Parts>, Error> {
        if field.built.is_some() {
            return Ok(None);
        }
        (self.watch)("looking at tolerances");
        let Seen {
            groups,
            units,
            chance,
            ..
        } = &field.seen;
        let causes = Causes {
            plain: &field.plain,
            singles: &field.singles,
            best: &choice.best,
            unexplained: choice.verdict == Verdict::Unexplained,
            allowed: field.by_chance,
            noises: chance.noises(),
            shown: chance::shown_noise(&self.problem, &choice.best.fitted)?,
            each: field.each,
        };
        let wanted = wanted(self.request, false);
        let scanned = |problem: &Problem<S>, fit: &Fitted| {
            let tangent = Tangent::new(problem, fit)?;
            Ok::<_, Error>(scan(problem, &tangent, groups, units, &wanted))
        };
        let told = causes.outdone(&self.problem, &chance.blocks, &scanned)?;
        let told = told.filter(|t| held(&self.problem, &self.problem.holdout, t));
        if let Some((built, _)) = &told {
            self.holdout = self.problem.holdout.take();
            built.restore(&mut self.problem)?;
        }
        Ok(told)
    }

    /// A model that suffices only with a place or an angle beyond its tolerance: that is a cause then, with
    /// odds of its own, beside the other parts.
    fn a_part_as_a_cause(&mut self, field: &Field) -> Result<Option<Parts>, Error> {
        let Some(built) = field.built.as_ref().filter(|b| !b.released) else {
            return Ok(None);
        };
        let cause = field.beyond(&field.plain).and_then(|part| {
            let departed = built.departed(&field.plain.fitted);
            tolerance::cause_of(&built.list, &departed, &part)
        });
        let wanted = wanted(self.request, true);
        let Some(cause) = cause.filter(|c| wanted(c.effect.id())) else {
            return Ok(None);
        };
        (self.watch)("telling the other parts beside it");
        let mut apart = self.problem.copy();
        let told = built.released(&mut apart, &field.plain.fitted, &cause);
        let told = told.ok().flatten().filter(|t| t.0.farthest(&t.1) < FAR);
        let told = told.filter(|t| held(&self.problem, &self.problem.holdout, t));
        if let Some((built, _)) = &told {
            self.holdout = self.problem.holdout.take();
            if let Some(holdout) = &mut self.holdout {
                holdout.allow(&Vec::new(), &DMatrix::zeros(0, 0));
            }
            built.restore(&mut self.problem)?;
        }
        Ok(told)
    }

    /// Names a cause that is thought of only where no other will do.
    fn ask_the_rare(&self, field: &mut Field, choice: &mut Choice) -> Result<(), Error> {
        (self.watch)("trying rare causes");
        let (plain, best) = (&field.plain, &choice.best);
        let explains = |r: &Judged| {
            !unexplained(plain.mean_square, r.mean_square)
                && r.foretold.mean_square() < best.foretold.mean_square()
        };
        let blocks = &field.seen.chance.blocks;
        let rare = of_the_rare(&self.problem, blocks, plain, &is_rare)?;
        if let Some(rare) = rare.filter(explains) {
            choice.best = rare.clone();
            choice.pair = None;
            choice.verdict = Verdict::MissingPhysics;
            field.singles.insert(0, rare);
            choice.odds = field.odds(&choice.partners);
        }
        Ok(())
    }

    /// Names nothing that matters less than was asked for. Parts within their tolerances explain so much that
    /// what they leave of no size is no evidence of a cause; what is more than any noise is.
    fn ask_what_matters(&mut self, field: &Field, choice: &mut Choice) -> Result<(), Error> {
        let asked = self.request.relevant;
        let small = field.built.is_some() && !field.beyond_noise;
        if !small && asked.is_none() {
            return Ok(());
        }
        let best = &choice.best;
        let [taken, noise] = taken_away(&self.problem, &field.plain.fitted, &best.fitted)?;
        let (relevant, whose) = match asked {
            Some(asked) => (asked, "that were asked for"),
            None => (noise, "that noise makes"),
        };
        if taken < relevant {
            let unit = self.problem.train.words().unit;
            let names: Vec<&str> = ids(best).collect();
            self.remarks.push(format!(
                "{} takes {} of error away: it may be there, but matters less than the {} {whose}.",
                names.join(" and "),
                in_unit(taken, &unit),
                in_unit(relevant, &unit)
            ));
            choice.verdict = Verdict::Adequate;
        }
        Ok(())
    }

    /// What nothing explains raises no alarm where it makes less error than was asked for, or than noise.
    fn ask_what_is_left(&mut self, field: &Field, choice: &mut Choice) -> Result<(), Error> {
        let plain = &field.plain;
        let left = beyond_noise(&self.problem, &plain.fitted)?;
        let over = |[left, noise]: &[f64; 2]| *left >= self.request.relevant.unwrap_or(*noise);
        if left.is_empty() || left.iter().any(over) {
            return Ok(());
        }
        let most = left.iter().map(|l| l[0]).fold(0.0, f64::max);
        let unit = self.problem.train.words().unit;
        let relevant = match self.request.relevant {
            Some(asked) => format!("the {} that were asked for", in_unit(asked, &unit)),
            None => "noise does".into(),
        };
        self.remarks.push(format!(
            "More than noise is left, {:.1} times its mean square, which nothing in the catalogue explains; it \
             makes {} of error at most, less than {relevant}, and raises no alarm.",
            plain.mean_square,
            in_unit(most, &unit),
        ));
        choice.verdict = Verdict::Adequate;
        Ok(())
    }
}

impl Field {
    /// The fit of several causes beside which parts were told.
    fn given(&self) -> Option<&Fitted> {
        self.start.as_ref().filter(|s| s.effects.len() > 1)
    }

    /// The part that a model takes farthest beyond its tolerance.
    pub fn beyond(&self, judged: &Judged) -> Option<Departed> {
        let built = self.built.as_ref();
        built.and_then(|b| b.beyond(&judged.fitted))
    }

    fn weigh_down(&self, list: &mut [Judged]) {
        weigh_down(list, &self.plain, self.overstated);
    }

    /// The same recordings, where one model is known to be right of those of a robot with parts `built`.
    pub fn of_one(self, built: Option<Built>, plain: Judged, named: Judged) -> Self {
        Field {
            built,
            start: None,
            fall: plain.fitted.cost() - named.fitted.cost(),
            singles: vec![named],
            plain,
            ..self
        }
    }

    /// The odds of the plain model, those of one cause, and `partners`.
    fn odds(&self, partners: &[Judged]) -> Odds {
        let models = std::iter::once(&self.plain).chain(&self.singles);
        // what is foretold knows nothing of the priors: parts that nobody believes foretell well
        let strange = |j: &Judged| {
            let built = self.built.as_ref();
            let far = built.filter(|b| b.farthest(&j.fitted) >= FAR);
            far.map_or(0.0, |b| b.strange(&j.fitted))
        };
        let prior = |j: &Judged| j.prior(self.each) - strange(j);
        Odds::of(models.chain(partners), prior)
    }

    /// Ids that the recordings cannot tell from the cause number `own` of a model: their traces are alike or,
    /// alone in its place, they leave no more than forms do.
    pub fn rivals_of<S: Subject>(
        &self,
        problem: &Problem<S>,
        j: &Judged,
        own: usize,
    ) -> Vec<&'static str> {
        let mut out = alike(problem, &j.fitted, own, &self.seen.groups);
        if j.fitted.effects.len() > 1 {
            return out;
        }
        let leaves = |j: &Judged| j.foretold.mean_square();
        let most = leaves(j) + typical_form(leaves(&self.plain) - leaves(j));
        for id in self
            .singles
            .iter()
            .filter(|s| leaves(s) < most)
            .flat_map(ids)
        {
            if id != j.fitted.effects[own].effect.id() && !out.contains(&id) {
                out.push(id);
            }
        }
        out
    }

    /// Whether a model's causes may be named: it foretells more, and each is likelier than not, itself or
    /// with those that the recordings cannot tell from it, of which none is far likelier.
    fn supports<S: Subject>(&self, problem: &Problem<S>, j: &Judged, odds: &Odds) -> bool {
        foretells(&self.plain, j)
            && (0..j.fitted.effects.len()).all(|own| {
                let alone = odds.cause(j.fitted.effects[own].effect.id());
                if alone >= 0.5 {
                    return alone > odds.nothing();
                }
                let others = self.rivals_of(problem, j, own);
                let others = || others.iter().map(|o| odds.cause(o));
                alone + others().sum::<f64>() >= 0.5 && others().all(|o| alone >= RIVALS * o)
            })
    }
}

/// Whether recordings that are held out, if there are, can have such parts.
fn held<S: Subject>(problem: &Problem<S>, holdout: &Option<S>, (built, _): &Parts) -> bool {
    holdout.as_ref().is_none_or(|h| built.is_held(problem, h))
}

/// Those that foretell better than the plain model first, among them the best score: what foretells no better
/// is not named.
fn best_first(singles: &mut [Judged], plain: &Judged) {
    singles.sort_by(|a, b| a.score.total_cmp(&b.score));
    singles.sort_by_key(|j| !foretells(plain, j));
}

/// Moves scores towards that of the plain model, by as much as they overstate the evidence.
fn weigh_down(list: &mut [Judged], plain: &Judged, overstated: f64) {
    for j in list {
        j.score = plain.score + (j.score - plain.score) / overstated;
    }
}

/// Whether a cause is looked for: one that does to all actuators what parts do to each shrinks all torques
/// with them, and the error too. (A permittivity that depends on the stretch scales what voltages make as
/// well, but as no part does; left out, it was taken for a loss of tension or a slow polarisation.)
fn wanted(request: &Request, parts_differ: bool) -> impl Fn(&str) -> bool + Sync {
    let parts_do = move |id: &str| parts_differ && tolerance::scales_as_parts(id);
    move |id: &str| match &request.only[..] {
        [] => !is_rare(id) && !parts_do(id),
        only => only.iter().any(|o| o == id),
    }
}

/// Hypotheses of a scan that are worth a fit: those that promise most and, where a cause is weak, those that
/// surprise most; and these apart.
fn shortlist<'a>(
    scanned: &'a [Scanned],
    chance: &Chance,
    plain: &Fitted,
    rate: f64,
) -> (Vec<&'a Scanned>, Vec<&'a Scanned>) {
    let rows = plain.state.rows as f64;
    let quiet = chance.largest < QUIET * chance.limit(rate)
        && plain.cost() < PAIR_ABOVE * chance.scale.max(1.0) * rows;
    let mut chosen = choose(scanned, if quiet { FITTED_IF_QUIET } else { FITTED });
    let mut by_surprise: Vec<&Scanned> = Vec::new();
    if plain.cost() < WEAK_BELOW * rows {
        by_surprise.extend(scanned);
        let of = |s: &Scanned| chance.surprise(s.acting.effect.id(), s.acting.on);
        by_surprise.sort_by(|a, b| of(b).total_cmp(&of(a)));
        by_surprise.truncate(SURPRISING);
        let known = |s: &&Scanned| !chosen.iter().any(|c| std::ptr::eq(*c, *s));
        let new: Vec<&Scanned> = by_surprise.iter().copied().filter(known).collect();
        chosen.extend(new);
    }
    (chosen, by_surprise)
}
