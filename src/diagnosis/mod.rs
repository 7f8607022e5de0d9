//! Doubts: is the plain model adequate; if not, where it fails, which physics was left out, and how much
//! better the model is with it.
//!
//! 1. The plain model is fitted with all of its own parameters free, weighted by what the noise of the
//!    capture makes of the residual (`fits`).
//! 2. Every effect of the catalogue, on all actuators and on one, is scanned by its fingerprint with
//!    everything projected out that a refit could absorb (`scan`), and the scores are held against drawn
//!    noise (`chance`).
//! 3. The leading ones are fitted together with film and forearm, at the weights of the best of them, and
//!    judged: by what they fit, by what they foretell of blocks that were left out, at the plain model's
//!    noise and at their own (`judge`, `blocks`).
//! 4. Pairs are tried where the best single one leaves more than noise.
//! 5. Parts that differ within their tolerances are tried in the causes' place (`tolerance`).
//! 6. The verdict: adequate, a named cause, or unexplained; where it lives (`locate`); what could not have
//!    been seen (`words`).
//!
//! Single coordinates are doubted in `single`.
//!
//! Residuals are torques: linear in the squared voltage, without a special case near 0 V.

mod blocks;
mod chance;
mod errors;
mod experiment;
mod fits;
mod forms;
mod judge;
mod law;
mod learn;
mod likeness;
mod line;
mod locate;
mod outcome;
mod parts;
mod problem;
mod rewhiten;
mod rivals;
mod robot;
mod scan;
mod single;
mod sizes;
mod subject;
mod tolerance;
mod words;

pub use experiment::{STEP_S as NEXT_DRIVE_STEP_S, next_drive};
pub use likeness::{Likeness, alike_at};
pub use line::{COUPON_BRANCHES, LineEntry, diagnose_lines};
pub use outcome::*;
pub use robot::diagnose;
pub use words::in_unit;

use rayon::prelude::*;

use crate::effects::{Acting, by_id, is_rare};
use errors::{above_noise, gain, raises_error, spots, taken_away};
use fits::{
    baseline, choose, of_the_rare, ordinary, plainest, polish, refit, rising, with_partner,
};
use judge::{INDEPENDENT, Judged, NEVER_ADEQUATE, Odds, alike, beside_smoothing};
use locate::locate;
use problem::{Effort, Fitted, Problem, Tangent};
use scan::{Scanned, fingerprints, scan, units};
use subject::Subject;
use tolerance::Built;
use words::{
    candidates, confidence, hidden, measure, next_experiment, probabilities, says, says_of_part,
};

/// Tracks that are drawn to see what the capture's noise does.
const DRAWN: usize = 6;
/// Hypotheses that are fitted in full, and of one effect at most.
const FITTED: usize = 10;
const OF_ONE: usize = 2;
/// Causes at once in the model of a rival, at most.
const MOST: usize = 6;
/// Hypotheses of rare causes that are fitted.
const RARE: usize = 4;
/// Hypotheses that are fitted where no score comes near what noise makes, and what near is.
const FITTED_IF_QUIET: usize = 3;
const QUIET: f64 = 0.6;
/// Hypotheses that are fitted because their scores surprise most, beside those that promise most, where a
/// cause is weak.
const SURPRISING: usize = 4;
/// A first fit with an effect, which only has to rank it, and a polished one.
const FIRST: Effort = Effort {
    evaluations: 12,
    cost_tolerance: 1e-4,
    motion_rounds: 1,
};
const POLISH: Effort = Effort {
    evaluations: 25,
    cost_tolerance: 1e-5,
    motion_rounds: 3,
};
/// The plain model, which everything else is measured against.
const BASELINE: Effort = Effort {
    evaluations: 40,
    ..POLISH
};
/// Leading effects that are fitted again at the leader's weights.
const LEADING: usize = 6;
/// Mean square above which a partner of the best single effect is looked for.
const PAIR_ABOVE: f64 = 1.15;
/// Mean square of the plain model below which a cause is weak: slow noise, which the weights do not have,
/// matters beside it.
const WEAK_BELOW: f64 = 2.0;
/// Mean square of the plain model below which what capture and smoothing make of its own motion is taken out
/// before a scan is judged.
const SMOOTHED_BELOW: f64 = 4.0;
/// Share of the largest surprise that a weak cause's own must have.
const SURPRISES_TOO: f64 = 0.4;
/// Share of the odds of a named cause from which another is in its place, and which it has at least of any
/// other's.
const RIVALS: f64 = 0.1;
/// Largest odds of a cause that is not named.
const NOT_NAMED: f64 = 0.49;
/// Partners of a cause that are judged.
const PARTNERS: usize = 2;

/// Whether so many independent samples can judge a model of so many free parameters: what a fit refuses, a
/// diagnosis refuses.
fn enough(samples: usize, free: usize) -> Result<(), Error> {
    if samples < 2 * free {
        return Err(Error::NothingExcited(format!(
            "the recordings give {samples} independent samples for {free} free parameters: nothing can be judged; record longer"
        )));
    }
    Ok(())
}

/// Whether so many samples of what was held out can judge anything.
fn enough_held_out(samples: usize) -> Result<(), Error> {
    if samples == 0 {
        return Err(Error::NothingExcited(
            "the held-out recordings give no sample that counts: hold out longer ones, or none"
                .into(),
        ));
    }
    Ok(())
}

/// Doubts the plain model of `problem`. `watch` is told what is being done.
fn doubt<S: Subject>(
    problem: Problem<S>,
    remarks: Vec<String>,
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Error> {
    let mut problem = problem;
    let holdout = problem.holdout.take();
    chain(problem, holdout, remarks, request, watch, None)
}

/// The chain of a doubt; with `built` of a robot whose parts differ within their tolerances, from its plain
/// fit on. What was held out (`holdout`) chooses nothing: it is taken up when all is chosen, and can only keep
/// a name from being said.
fn chain<S: Subject>(
    mut problem: Problem<S>,
    holdout: Option<S>,
    mut remarks: Vec<String>,
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
    built: Option<(Built, Fitted)>,
) -> Result<Diagnosis, Error> {
    let words = problem.train.words();
    let rare = |id: &str| is_rare(id);
    // what scales all that voltages make shrinks all torques with parts, and the error with them
    let parts_differ = built.is_some();
    let scales = |id: &str| parts_differ && by_id(id).is_some_and(|e| e.scales_made());
    let wanted = |id: &str| match &request.only[..] {
        [] => !rare(id) && !scales(id),
        only => only.iter().any(|o| o == id),
    };
    watch("fitting the plain model");
    let own = problem.nonlinear.len();
    let (built, start, mut plain, ordinary) = match built {
        Some((built, start)) => {
            // it was that of another mechanism
            problem.put_back_smoothing();
            let ordinary = ordinary(&mut problem)?;
            problem.weigh_if_believed(&start, ordinary)?;
            let (eta, beta) = (&start.state.eta[..own], &start.state.beta);
            let plain = problem.fit(&[], eta, beta, BASELINE);
            let start = Some(start).filter(|s| !s.effects.is_empty());
            (Some(built), start, plain, ordinary)
        }
        None => {
            let (plain, ordinary) = baseline(&mut problem)?;
            (None, None, plain, ordinary)
        }
    };
    problem.begun = (problem.train).begun(&plain.state.eta, &plain.state.beta)?;
    watch("scanning the catalogue");
    let mut tangent = Tangent::new(&problem, &plain)?;
    let mut groups = fingerprints(&problem, &plain, &wanted);
    let mut units = units(&problem, &plain)?;
    let mut scanned = scan(&problem, &tangent, &groups, &units, &wanted);
    let mut chance = chance::chance(&problem, &plain, &tangent, &groups, &units)?;
    let rate = request.false_alarm_rate;
    let alarmed = |chance: &chance::Chance, plain: &Fitted| {
        chance.largest >= chance.limit(rate) || never_adequate(plain, chance)
    };
    // What capture and smoothing make of the plain model's own motion does not shrink as recordings grow, but
    // their evidence does.
    let rows = plain.state.rows as f64;
    if built.is_none()
        && alarmed(&chance, &plain)
        && plain.cost() < SMOOTHED_BELOW * rows
        && let Some(other) = problem.take_out_smoothing(&plain)
    {
        plain = other;
        tangent = Tangent::new(&problem, &plain)?;
        scanned = scan(&problem, &tangent, &groups, &units, &wanted);
        chance = chance::chance(&problem, &plain, &tangent, &groups, &units)?;
    }
    let noise = chance.scale.max(1.0) * chance.colour.max(1.0);
    let named_by_rivals = rivals::named(&tangent, &groups, &scanned);
    let rival_models = if request.rivals {
        watch("fitting what simpler methods say");
        let held = holdout.as_ref();
        rivals::rival_models(&problem, held, &plain, &tangent, &groups, &units, &wanted)?
    } else {
        Vec::new()
    };
    drop(tangent);
    watch("fitting the leading effects");
    let quiet = chance.largest < QUIET * chance.limit(request.false_alarm_rate)
        && plain.cost() < PAIR_ABOVE * chance.scale.max(1.0) * plain.state.rows as f64;
    let mut chosen = choose(&scanned, if quiet { FITTED_IF_QUIET } else { FITTED });
    let mut by_surprise: Vec<&Scanned> = Vec::new();
    if plain.cost() < WEAK_BELOW * plain.state.rows as f64 {
        by_surprise.extend(&scanned);
        let of = |s: &Scanned| chance.surprise(s.acting.effect.id(), s.acting.on);
        by_surprise.sort_by(|a, b| of(b).total_cmp(&of(a)));
        by_surprise.truncate(SURPRISING);
        let new = by_surprise
            .iter()
            .copied()
            .filter(|s| !chosen.iter().any(|c| std::ptr::eq(*c, *s)));
        let new: Vec<&Scanned> = new.collect();
        chosen.extend(new);
    }
    let mut fits = refit(&problem, &plain, &chosen, &[]);
    let given = start.as_ref().filter(|s| s.effects.len() > 1);
    if let (Some(start), None) = (&start, given) {
        let (eta, beta) = (&start.state.eta[..own], &start.state.beta);
        fits.push(problem.fit(&start.effects, eta, beta, FIRST));
        fits.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    }
    // a leader that gains by making less of the noise must not set the weights of all
    let leads = |f: &&Fitted| {
        let judged = || Judged::new(&problem, &chance.blocks, (*f).clone());
        f.cost() < 0.8 * plain.cost() && judged().mean_square * rows < 0.8 * plain.cost()
    };
    if let Some(leader) = fits.first().filter(leads) {
        // The noise gain depends on the film, and the plain refit of a wrong model runs to an extreme one.
        let before = rewhiten::Before::new(&problem);
        problem.weigh_if_believed(leader, ordinary)?;
        before.change(&problem).of(&mut groups, &mut units);
        let again = problem.fit(&[], &plain.state.eta, &plain.state.beta, POLISH);
        let nominal = problem.nominal(&[], POLISH);
        plain = if again.cost() < nominal.cost() {
            again
        } else {
            nominal
        };
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
        watch("fitting the best of them to the end");
        problem.tally.expect(leading.len());
        fits = leading
            .into_par_iter()
            .map(|f| {
                let polished = polish(&problem, f);
                problem.tally.done();
                polished
            })
            .collect();
    }
    let plain = Judged::new(&problem, &chance.blocks, plain);
    let mut singles: Vec<Judged> = fits
        .into_par_iter()
        .map(|f| Judged::new(&problem, &chance.blocks, f))
        .collect();
    // A weak cause is told from slow noise by how its score scatters: what surprises little beside the most
    // surprising one only takes up slow noise, and what is left over counts for less by as much as the
    // leader's score overstates the evidence.
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
    let overstated = singles
        .iter()
        .min_by(|a, b| a.score.total_cmp(&b.score))
        .filter(|_| weak)
        .map_or(1.0, |j| {
            let a = &j.fitted.effects[0];
            chance.design(a.effect.id(), a.on)
        });
    let weigh_down = |list: &mut [Judged]| {
        for j in list.iter_mut() {
            j.score = plain.score + (j.score - plain.score) / overstated;
        }
    };
    weigh_down(&mut singles);
    singles.sort_by(|a, b| a.score.total_cmp(&b.score));
    // what foretells no better is not named
    singles.sort_by_key(|j| !foretells(&plain, j));
    let drop = |j: &Judged| plain.fitted.cost() - j.fitted.cost();
    let largest_drop = singles.iter().map(drop).fold(0.0, f64::max);
    let allowed = chance.fall(rate);
    let (surprise, limit) = (chance.largest, chance.limit(rate));
    let adequate =
        (surprise < limit || largest_drop < allowed) && !never_adequate(&plain.fitted, &chance);
    let mut listed: Vec<&str> = groups.iter().map(|g| g.effect.id()).collect();
    listed.dedup();
    let each = (BASE_RATES[1] / BASE_RATES[0] / listed.len().max(1) as f64).ln();
    let told = |singles: &[Judged], partners: &[Judged]| {
        let models = std::iter::once(&plain).chain(singles).chain(partners);
        Odds::of(models, each)
    };
    // A cause that is named foretells more, and is likelier than not: itself, or with those that the
    // recordings cannot tell from it, of which none is far likelier.
    let beyond_noise = never_adequate(&plain.fitted, &chance);
    let supported = |problem: &Problem<S>, j: &Judged, odds: &Odds| {
        foretells(&plain, j)
            && (0..j.fitted.effects.len()).all(|own| {
                let id = j.fitted.effects[own].effect.id();
                let alone = odds.cause(id);
                if alone >= 0.5 {
                    return alone > odds.nothing();
                }
                let others = alike(problem, &j.fitted, own, &groups);
                let others = || others.iter().map(|o| odds.cause(o));
                alone + others().sum::<f64>() >= 0.5 && others().all(|o| alone >= RIVALS * o)
            })
    };
    let first_odds = told(&singles, &[]);
    let adequate = adequate
        || (!beyond_noise
            && singles
                .first()
                .is_some_and(|j| !supported(&problem, j, &first_odds)));
    // Nothing confirms a cause where nothing was held out: the error itself has to stand out of the noise
    // then.
    let adequate =
        adequate || (!beyond_noise && holdout.is_none() && !above_noise(&problem, &plain.fitted)?);
    // Parts that were told without a cause that matters lean towards it: they are told once more beside the one
    // that leads.
    if let (Some(built), None, false, Some(first)) = (&built, &start, adequate, singles.first())
        && supported(&problem, first, &first_odds)
        && let [taken, noise] = taken_away(&problem, &plain.fitted, &first.fitted)?
        && (beyond_noise || taken >= request.relevant.unwrap_or(noise))
    {
        watch("telling parts beside the leading cause");
        let first = first.fitted.clone();
        if let Some(beside) = built.settled(&mut problem, &first)? {
            beside.0.restore(&mut problem)?;
            return chain(problem, holdout, remarks, request, watch, Some(beside));
        }
        built.restore(&mut problem)?;
    }
    // A second cause for which parts had stood in; where more than noise is left, it may only be another form
    // of the first.
    let mends = |first: &Judged, p: &Judged| {
        let beyond = |j: &Judged| built.as_ref().and_then(|b| b.beyond(&j.fitted)).is_some();
        let noise = p.mean_square < PAIR_ABOVE;
        noise && beyond(first) && !beyond(p) && earns(first, p, 3.0 * allowed)
    };
    // More than one
    let mut pair: Option<Judged> = None;
    let mut partners: Vec<Judged> = Vec::new();
    if let (false, Some(first)) = (adequate, singles.first())
        && (first.mean_square > PAIR_ABOVE || given.is_some())
    {
        let beside = |base: &Judged| {
            let names: Vec<String> = ids(base).map(crate::effects::plain_name).collect();
            watch(&format!(
                "looking for a second effect beside {}",
                names.join(" and ")
            ));
            let mut both = with_partner(&problem, &chance.blocks, base, &groups, &units, &wanted)?;
            weigh_down(&mut both);
            both.sort_by(|a, b| a.score.total_cmp(&b.score));
            Ok::<_, Error>(both)
        };
        let second = singles
            .get(1)
            .filter(|s| s.excess() < 4.0 * first.excess() && s.mean_square > PAIR_ABOVE);
        for base in std::iter::once(first).chain(second) {
            partners.extend(beside(base)?);
        }
        if let Some(given) = given {
            let (eta, beta) = (&given.state.eta[..own], &given.state.beta);
            let both = problem.fit(&given.effects, eta, beta, POLISH);
            let mut both = [Judged::new(&problem, &chance.blocks, both)];
            weigh_down(&mut both);
            partners.extend(both);
        }
        partners.sort_by(|a, b| a.score.total_cmp(&b.score));
        // The best partner of the best partner: a first choice may have stood in for two others.
        if let Some(other) = partners.first().map(|p| p.fitted.effects[1].clone()) {
            let tried = |j: &Judged| j.fitted.effects[0].effect.id() == other.effect.id();
            if !tried(first) && !second.is_some_and(tried) {
                let alone = problem.nominal(std::slice::from_ref(&other), POLISH);
                partners.extend(beside(&Judged::new(&problem, &chance.blocks, alone))?);
            }
        }
        partners.sort_by(|a, b| a.score.total_cmp(&b.score));
        pair = partners
            .iter()
            .find(|p| joins(first, p, 3.0 * allowed) || mends(first, p))
            .cloned();
        // two that the recordings cannot tell apart are one, unless one alone leaves far more than noise
        if let Some(p) = &pair
            && !leaves_too_much(&problem, &plain, first)?
        {
            let same = alike(&problem, &first.fitted, 0, &groups);
            if ids(p).any(|id| same.contains(&id)) {
                pair = None;
            }
        }
    }
    let mut odds = told(&singles, &partners);
    // a second cause that is a part within its tolerance is none
    let list = problem.train.tolerances();
    let part = |p: &Judged| {
        let is_first = |a: &Acting| {
            let first = singles.first().map(|f| f.fitted.effects[0].effect.id());
            first == Some(a.effect.id())
        };
        let mut others = p.fitted.effects.iter().filter(|a| !is_first(a));
        others.any(|a| tolerance::holds(&list, a))
    };
    pair = pair.filter(|p| supported(&problem, p, &odds) && !part(p));
    if let (false, Some(named)) = (adequate, pair.as_mut().or(singles.first_mut())) {
        *named = plainest(&problem, &chance.blocks, named, allowed);
    }
    let mut best = pair.as_ref().or(singles.first()).unwrap_or(&plain).clone();
    // Parts far beyond their tolerances may stand in for a second cause: they are told once more beside the two
    // that do best.
    if let (Some(built), false, None) = (&built, adequate, given)
        && built.beyond(&best.fitted).is_some()
        && let Some(two) = partners.first().filter(|p| earns(&best, p, 3.0 * allowed))
    {
        watch("telling parts beside two causes");
        let two = two.fitted.clone();
        let most = PAIR_ABOVE * rows;
        let within = |(b, f): &(Built, Fitted)| b.beyond(f).is_none() && f.cost() < most;
        if let Some(told) = built
            .settled(&mut problem, &two)
            .ok()
            .flatten()
            .filter(within)
        {
            told.0.restore(&mut problem)?;
            return chain(problem, holdout, remarks, request, watch, Some(told));
        }
        built.restore(&mut problem)?;
    }
    let best_is_supported = supported(&problem, &best, &odds);
    problem.take_up(holdout, built.as_ref())?;
    let raises = !adequate && raises_error(&problem, &plain.fitted, &best.fitted)?;
    let mut verdict = if adequate || singles.is_empty() || (raises && !beyond_noise) {
        Verdict::Adequate
    } else if raises || !best_is_supported || leaves_too_much(&problem, &plain, &best)? {
        Verdict::Unexplained
    } else {
        Verdict::MissingPhysics
    };
    // Parts that differ within their tolerances may do it better than any cause.
    if verdict != Verdict::Adequate && built.is_none() {
        watch("looking at tolerances");
        let causes = parts::Causes {
            plain: &plain,
            singles: &singles,
            best: &best,
            unexplained: verdict == Verdict::Unexplained,
            allowed,
            noise,
            colour: chance.colour,
            each,
        };
        let scanned = |problem: &Problem<S>, fit: &Fitted| {
            let tangent = Tangent::new(problem, fit)?;
            Ok::<_, Error>(scan(problem, &tangent, &groups, &units, &wanted))
        };
        let holdout = problem.holdout.take();
        if let Some((built, fit)) = causes.outdone(&mut problem, &chance.blocks, scanned)? {
            built.restore(&mut problem)?;
            return chain(
                problem,
                holdout,
                remarks,
                request,
                watch,
                Some((built, fit)),
            );
        }
        problem.holdout = holdout;
    }
    if verdict == Verdict::Unexplained && request.only.is_empty() {
        watch("trying rare causes");
        let explains = |r: &Judged| {
            !unexplained(plain.mean_square, r.mean_square)
                && r.foretold.mean_square() < best.foretold.mean_square()
        };
        if let Some(r) = of_the_rare(&problem, &chance.blocks, &plain, &rare)?.filter(explains) {
            best = r.clone();
            singles.insert(0, r);
            odds = told(&singles, &partners);
            pair = None;
            verdict = Verdict::MissingPhysics;
        }
    }
    // Parts within their tolerances explain so much that what they leave of no size is no evidence of a cause;
    // what is more than any noise is.
    let small = built.is_some() && !beyond_noise;
    if verdict == Verdict::MissingPhysics && (small || request.relevant.is_some()) {
        let [taken, noise] = taken_away(&problem, &plain.fitted, &best.fitted)?;
        let (relevant, asked) = match request.relevant {
            Some(asked) => (asked, "that were asked for"),
            None => (noise, "that noise makes"),
        };
        if taken < relevant {
            let names: Vec<&str> = ids(&best).collect();
            remarks.push(format!(
                "{} takes {} of error away: it may be there, but matters less than the {} {asked}.",
                names.join(" and "),
                in_unit(taken, &words.unit),
                in_unit(relevant, &words.unit)
            ));
            verdict = Verdict::Adequate;
        }
    }
    watch("judging");
    let mut plain = plain;
    for judged in std::iter::once(&mut plain)
        .chain(&mut singles)
        .chain(&mut partners)
    {
        judged.hold(&problem);
    }
    for judged in pair.iter_mut().chain([&mut best]) {
        judged.hold(&problem);
    }
    // A model suffices only with parts that are within their tolerances. One beyond may be what is off, or
    // stand in for what is: it is said, and no cause is named beside it but one that takes nearly all away, to
    // which it can only be a detail, and that only where the part can be believed.
    let beside = built.as_ref().and_then(|b| b.beyond(&best.fitted));
    let detail =
        |part: &Departed| part.times() < parts::FAR && best.excess() < DETAIL * plain.excess();
    if verdict == Verdict::MissingPhysics && !beside.as_ref().is_none_or(detail) {
        verdict = Verdict::Unexplained;
    }
    let beyond = built
        .as_ref()
        .and_then(|b| b.beyond(&plain.fitted))
        .filter(|_| verdict == Verdict::Adequate);
    if beyond.is_some() {
        verdict = Verdict::Unexplained;
    }
    let in_model = verdict == Verdict::MissingPhysics;
    let trust = match in_model && beside.is_some() {
        true => BESIDE_BEYOND,
        false => 1.0,
    };
    if in_model {
        remarks.extend(forms::others(&problem, &plain, &best));
    }
    let taught = match verdict == Verdict::Unexplained && beyond.is_none() {
        true => {
            watch("learning what no cause accounts for");
            learn::learn(&problem, &plain.fitted)?
        }
        false => None,
    };
    let learnt = (taught.as_ref()).map(|t| Judged::new(&problem, &chance.blocks, t.fitted.clone()));
    let augmented = match &learnt {
        Some(learnt) => learnt,
        None if in_model => &best,
        None => &plain,
    };
    let departed = built
        .as_ref()
        .map_or_else(Vec::new, |b| b.departed(&augmented.fitted));
    let mut candidates = candidates(
        &problem,
        &plain,
        &singles,
        pair.as_ref(),
        &partners,
        verdict,
        &odds,
    );
    if let Some(built) = &built {
        for c in &mut candidates {
            if c.in_model {
                c.probability *= trust;
            }
            if let Some(times) = tolerance::times(&built.list, &c.acting) {
                c.says += &format!("; {times:.1} times its tolerance");
            }
        }
    }
    let groups_alike = if in_model {
        (0..best.fitted.effects.len())
            .filter_map(|own| {
                let mut ids = alike(&problem, &best.fitted, own, &groups);
                ids.insert(0, best.fitted.effects[own].effect.id());
                (ids.len() > 1).then_some(ids)
            })
            .collect()
    } else {
        Vec::new()
    };
    let seen = if in_model { &best } else { &plain };
    let spots = spots(&problem, &plain.fitted, &seen.fitted)?;
    let named: &[Acting] = if in_model { &best.fitted.effects } else { &[] };
    let places = locate(
        &spots,
        &problem.train.whereabouts(),
        &problem.train.coordinates(),
        S::CHAINS,
        &words,
        named,
    );
    let law = (verdict == Verdict::Unexplained && beyond.is_none() && taught.is_none())
        .then(|| law::law(&problem, &best.fitted))
        .transpose()?;
    let hidden = hidden(&problem, &scanned, allowed);
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
    } else {
        remarks.push("No recording was held out: the gain is that on the recordings that were fitted, and the verdict is the weaker for it.".into());
    }
    let learnt = match taught {
        Some(t) => {
            let gap = holdout_gain.as_ref().map_or(f64::NAN, gap_closed);
            Some(learn::physics(&problem, &t, &groups, gap)?)
        }
        None => None,
    };
    let (confidence, says, next_experiment) = match &beyond {
        Some(part) => {
            let rows = INDEPENDENT * plain.fitted.state.rows as f64;
            // what it costs to keep the part near the drawing, against what a cause of one value costs
            let gain = 0.5 * part.times().powi(2) - 0.5 * rows.ln() + each;
            let odds = 1.0 / (1.0 + (-gain).exp());
            let left = format!(
                "{}{}",
                in_unit(train_gain.before_v, &words.unit),
                words.over
            );
            (odds.max(0.5), says_of_part(part, &left), measure(part))
        }
        None => {
            remarks.extend(tolerance::remark(&departed));
            let of_catalogue = says(
                verdict,
                &candidates,
                &train_gain,
                holdout_gain.as_ref(),
                &places,
                &words,
                built.is_some(),
            );
            let of_catalogue = match &learnt {
                Some(l) => format!("{of_catalogue} Learnt from the recordings: {}", l.says),
                None => of_catalogue,
            };
            (
                trust * confidence(verdict, &odds, &plain, &best),
                of_catalogue,
                next_experiment(verdict, &groups_alike, &candidates, &words),
            )
        }
    };
    let values = problem
        .train
        .values(&augmented.fitted.state.eta, &augmented.fitted.state.beta);
    let model = |j: &Judged| {
        problem
            .train
            .parameters(&j.fitted.state.eta, &j.fitted.state.beta)
    };
    Ok(Diagnosis {
        verdict,
        confidence,
        probabilities: probabilities(verdict, confidence),
        places,
        candidates,
        groups: groups_alike,
        next_experiment,
        hidden,
        train: train_gain,
        holdout: holdout_gain,
        plain: rising(model(&plain)),
        parameters: rising(model(augmented)),
        pose: None,
        eps_r: f64::NAN,
        rig: problem.train.rig(),
        values,
        unit: words.unit,
        basis: words.basis,
        over: words.over,
        plain_mean_square: plain.mean_square,
        plain_holdout_mean_square: plain.holdout,
        law,
        learnt,
        traces,
        departed,
        beyond,
        built: built.as_ref().map_or(f64::NAN, |b| b.scale),
        remarks,
        says,
        rivals: named_by_rivals,
        rival_models,
        evidence: Evidence {
            surprise: chance.largest,
            whose: chance.whose,
            limit: chance.limit(request.false_alarm_rate),
            noise_scale: chance.scale,
            each: chance.each.clone(),
            tried: singles
                .iter()
                .chain(&partners)
                .map(|j| {
                    (
                        ids(j).collect(),
                        j.score - plain.score,
                        j.mean_square,
                        j.holdout,
                    )
                })
                .collect(),
            p_value: chance.p_value(),
            fall: largest_drop,
            fall_by_chance: allowed,
        },
    })
}

/// Error over what noise makes of it from which on there is a gap between them.
const GAP: f64 = 1.05;

/// Share of the way from the plain model's error to what noise makes that the augmented one goes; NaN where
/// there is no way to go.
fn gap_closed(gain: &Gain) -> f64 {
    let (before, noise) = (gain.before_v, gain.noise_floor_v);
    match before > GAP * noise {
        true => (before - gain.after_v) / (before - noise),
        false => f64::NAN,
    }
}

/// Whether a plain fit leaves more than any noise does.
fn never_adequate(plain: &Fitted, chance: &chance::Chance) -> bool {
    let most = chance.scale.max(1.0) * NEVER_ADEQUATE.max(chance.most);
    plain.cost() >= most * plain.state.rows as f64
}

/// Whether a cause does better than the plain model on blocks that the fits left out, by as much as matters.
fn foretells(plain: &Judged, judged: &Judged) -> bool {
    judged.foretold.mean_square() < plain.foretold.mean_square() - MATTERS
}

/// How often nothing, a cause of the catalogue, and something else is left out, before anything was recorded.
const BASE_RATES: [f64; 3] = [0.35, 0.5, 0.15];

/// Share of what the plain model leaves of blocks that were left out up to which another one foretells them.
const FORETOLD: f64 = 0.5;

/// Whether what the best model leaves must be something that is in no entry, from the mean squares of the
/// plain and the best model.
fn unexplained(plain: f64, best: f64) -> bool {
    let left = (best - 1.0).max(0.0);
    let share = left / (plain - 1.0).max(1e-9);
    (best > 4.0 && share > 0.03) || (best > 1.8 && share > 0.08) || (best > 1.6 && share > 0.6)
}

/// Mean square that a model with a part that is off (a link, a tilt, a marker) may leave: a part has no form of
/// which a large misfit could leave a share.
const PART_LEAVES: f64 = 4.0;

/// Whether what the best model leaves must be something that is in no entry.
fn leaves_too_much<S: Subject>(
    problem: &Problem<S>,
    plain: &Judged,
    best: &Judged,
) -> Result<bool, Error> {
    let list = problem.train.tolerances();
    let is_part = |a: &Acting| tolerance::times(&list, a).is_some();
    let of_a_part = best.fitted.effects.iter().any(is_part);
    let too_much =
        |left: f64| unexplained(plain.mean_square, left) || (of_a_part && left > PART_LEAVES);
    if !too_much(best.mean_square) {
        return Ok(false);
    }
    // a model that is right but for smoothing foretells what its fit left out
    if best.foretold.mean_square() - 1.0 > FORETOLD * (plain.foretold.mean_square() - 1.0) {
        return Ok(true);
    }
    Ok(beside_smoothing(problem, best)?.is_none_or(too_much))
}

/// Ids of the causes of a fit.
fn ids(j: &Judged) -> impl Iterator<Item = &'static str> {
    j.fitted.effects.iter().map(|a| a.effect.id())
}

/// Whether a further cause stays: the excess must fall by a quarter, and nearly vanish where it is no larger
/// than what a textbook form that is wrong in detail leaves.
fn joins(base: &Judged, next: &Judged, chance: f64) -> bool {
    let left = if base.mean_square > FORM_LEAVES {
        0.75
    } else {
        0.25
    };
    earns(base, next, chance) && next.excess() < left * base.excess()
}

/// Whether a further cause takes away more than chance does, and foretells no worse.
fn earns(base: &Judged, next: &Judged, chance: f64) -> bool {
    base.fitted.cost() - next.fitted.cost() > 150.0_f64.max(chance)
        && next.foretold.mean_square() <= base.foretold.mean_square()
}

/// Mean square up to which what one cause leaves may be its form.
const FORM_LEAVES: f64 = 2.25;

/// Share of what the plain model leaves beyond noise up to which what a cause leaves is a detail.
const DETAIL: f64 = 0.1;

/// Odds of a cause beside a part beyond its tolerance, over what they are beside parts within: on seeds for
/// development four such names of robots were all right (Laplace's rule of succession).
const BESIDE_BEYOND: f64 = 5.0 / 6.0;

/// Mean square (noise makes 1) that a cause must take away to matter: a seventh of the noise as an error.
/// What smoothing and numerics leave of a right model is less, however long the recordings.
const MATTERS: f64 = 0.02;
