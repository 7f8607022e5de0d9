//! Doubts: is the plain model adequate; if not, where it fails, which physics was left out, and how much better the model is with it.
//!
//! 1. The plain model is fitted with all of its own parameters free, weighted by what the noise of the capture makes of the residual.
//! 2. Every effect of the catalogue, on all actuators and on one, is scanned by its fingerprint with everything projected out that a
//!    refit could absorb (`scan`).
//! 3. The leading ones are fitted together with film and forearm, at the weights of the best of them, and scored (`judge`).
//! 4. Pairs are tried where the best single one leaves more than noise.
//! 5. The verdict: adequate, a named cause, or unexplained; where it lives (`locate`); what could not have been seen.
//!
//! Residuals are torques: linear in the squared voltage, without a special case near 0 V.

mod blocks;
mod chance;
mod experiment;
mod forms;
mod judge;
mod law;
mod likeness;
mod line;
mod locate;
mod outcome;
mod problem;
mod rewhiten;
mod rivals;
mod robot;
mod scan;
mod single;
mod sizes;
mod subject;
mod tolerance;

pub use experiment::{STEP_S as NEXT_DRIVE_STEP_S, next_drive};
pub use likeness::{Likeness, alike_at};
pub use line::{COUPON_BRANCHES, LineEntry, diagnose_lines};
pub use outcome::*;
pub use robot::diagnose;

use rayon::prelude::*;

use crate::effects::{Acting, Effect, When, is_rare};
use judge::{INDEPENDENT, Judged, NEVER_ADEQUATE, alike, beside_smoothing};
use locate::{Spot, locate};
use problem::{Effort, Fitted, Problem, Tangent};
use scan::{Group, Scanned, Unit, fingerprints, scan, units};
use sizes::{Estimate, unknown_values, value_estimates};
use subject::Subject;
use tolerance::Built;

/// Tracks that are drawn to see what the capture's noise does.
const DRAWN: usize = 6;
/// Hypotheses that are fitted in full, and of one effect at most.
const FITTED: usize = 10;
const OF_ONE: usize = 2;
/// Best causes from which series of causes grow on a single coordinate.
const STARTS: usize = 2;
/// Causes at once on a single coordinate, and in the model of a rival, at most.
const MOST: usize = 6;
/// Causes that may join a series unconfirmed before one that what was held out confirms.
const AHEAD: usize = 1;
/// Hypotheses of rare causes that are fitted.
const RARE: usize = 4;
/// Hypotheses that are fitted where no score comes near what noise makes, and what near is.
const FITTED_IF_QUIET: usize = 3;
const QUIET: f64 = 0.6;
/// Hypotheses that are fitted because their scores surprise most, beside those that promise most, where a cause is weak.
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
/// Share of what causes explain that parts within their tolerances may miss in linear theory for a fit of them to be worth while.
const WORTH_A_FIT: f64 = 0.5;
/// Leading effects that are fitted again at the leader's weights.
const LEADING: usize = 6;
/// Mean square above which a partner of the best single effect is looked for.
const PAIR_ABOVE: f64 = 1.15;
/// Mean square of the plain model below which a cause is weak: slow noise, which the weights do not have, matters beside it.
const WEAK_BELOW: f64 = 2.0;
/// Mean square of the plain model below which what capture and smoothing make of its own motion is taken out before a scan is judged.
const SMOOTHED_BELOW: f64 = 4.0;
/// Mean square of the plain model below which no cause is named where nothing was held out: weights are no better known than by a quarter.
const UNCONFIRMED_BELOW: f64 = 1.25;
/// Share of the largest surprise that a weak cause's own must have.
const SURPRISES_TOO: f64 = 0.4;
/// Score differences of this size make odds of e to 1 in probabilities: textbook forms are wrong in detail, so scores say less than
/// their face value.
const TEMPERATURE: f64 = 12.0;

/// Whether so many independent samples can judge a model of so many free parameters: what a fit refuses, a diagnosis refuses.
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
    chain(problem, remarks, request, watch, None)
}

/// The chain of a doubt; with `built` of a robot whose parts differ within their tolerances, from its plain fit on.
fn chain<S: Subject>(
    mut problem: Problem<S>,
    mut remarks: Vec<String>,
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
    built: Option<(Built, Fitted)>,
) -> Result<Diagnosis, Error> {
    let words = problem.train.words();
    let rare = |id: &str| S::CHAINS > 1 && is_rare(id);
    let wanted = |id: &str| match &request.only[..] {
        [] => !rare(id),
        only => only.iter().any(|o| o == id),
    };
    watch("fitting the plain model");
    let (built, mut plain, ordinary) = match built {
        Some((built, plain)) => {
            let ordinary = ordinary(&mut problem)?;
            problem.weigh_if_believed(&plain, ordinary)?;
            let plain = problem.fit(&[], &plain.state.eta, &plain.state.beta, BASELINE);
            (Some(built), plain, ordinary)
        }
        None => {
            let (plain, ordinary) = baseline(&mut problem)?;
            (None, plain, ordinary)
        }
    };
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
    // What capture and smoothing make of the plain model's own motion does not shrink as recordings grow, but their evidence does.
    let rows = plain.state.rows as f64;
    if S::CHAINS > 1 && alarmed(&chance, &plain) && plain.cost() < SMOOTHED_BELOW * rows {
        let (eta, beta) = (&plain.state.eta, &plain.state.beta);
        if let Some(expected) = problem.train.expected_residual(eta, beta) {
            tangent.take_out(&expected);
            scanned = scan(&problem, &tangent, &groups, &units, &wanted);
            chance = chance::chance(&problem, &plain, &tangent, &groups, &units)?;
        }
    }
    let noise = chance.scale.max(1.0) * chance.colour.max(1.0);
    let named_by_rivals = rivals::named(&tangent, &groups, &scanned);
    let rival_models = if request.rivals {
        watch("fitting what simpler methods say");
        rivals::rival_models(&problem, &plain, &tangent, &groups, &units, &wanted)?
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
    if let Some(leader) = fits.first().filter(|f| f.cost() < 0.8 * plain.cost()) {
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
        // The best of each hypothesis: those that fit best, and those that surprise most, which a film that bends to others outdoes.
        let mut leading: Vec<&Fitted> = Vec::new();
        for f in &fits {
            let own = &f.effects[0];
            let known = leading.iter().any(|l| l.effects[0].is(own));
            let surprising = by_surprise.iter().any(|s| s.acting.is(own));
            if !known && (leading.len() < LEADING || surprising) {
                leading.push(f);
            }
        }
        fits = leading
            .into_par_iter()
            .map(|f| polish(&problem, f))
            .collect();
    }
    if S::CHAINS == 1 {
        let best = fits
            .iter()
            .min_by(|a, b| a.cost().total_cmp(&b.cost()))
            .unwrap_or(&plain);
        let design = problem
            .residual(best)
            .design(&best.state.eta, &best.state.beta)?;
        let residual = design.column(design.ncols() - 1);
        problem.independent = problem.train.independent(residual.as_slice());
    }
    let plain = Judged::new(&problem, plain);
    let mut singles: Vec<Judged> = fits
        .into_par_iter()
        .map(|f| Judged::new(&problem, f))
        .collect();
    // A weak cause is told from slow noise by how its score scatters: what surprises little beside the most surprising one only takes
    // up slow noise, and what is left over counts for less by as much as the leader's score overstates the evidence.
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
    if S::CHAINS > 1 {
        // what raises the error on what was not fitted is not named
        singles.sort_by_key(|j| !holds_out(&plain, j));
    }
    let drop = |j: &Judged| plain.fitted.cost() - j.fitted.cost();
    let largest_drop = singles.iter().map(drop).fold(0.0, f64::max);
    let allowed = chance.fall(rate);
    let (surprise, limit) = (chance.largest, chance.limit(rate));
    let adequate =
        (surprise < limit || largest_drop < allowed) && !never_adequate(&plain.fitted, &chance);
    // A cause of a weak misfit must be supported, and matter; and nothing confirms one where nothing was held out.
    let unconfirmed =
        problem.holdout.is_none() && plain.mean_square < UNCONFIRMED_BELOW * chance.scale.max(1.0);
    let unsupported = |j: &Judged| {
        S::CHAINS > 1
            && !(!unconfirmed
                && j.score < plain.score - DECISIVE
                && holds_out(&plain, j)
                && plain.mean_square - j.mean_square > MATTERS)
    };
    let adequate =
        adequate || (singles.first().is_some_and(unsupported) && plain.mean_square < WEAK_BELOW);
    // More than one
    let mut pair: Option<Judged> = None;
    let mut partners: Vec<Judged> = Vec::new();
    if let (false, Some(first)) = (adequate, singles.first())
        && left::<S>(first) > PAIR_ABOVE
    {
        watch("looking for a second effect");
        let beside = |base: &Judged| {
            let mut both = with_partner(&problem, base, &groups, &units, &wanted)?;
            weigh_down(&mut both);
            both.sort_by(|a, b| a.score.total_cmp(&b.score));
            Ok::<_, Error>(both)
        };
        if S::CHAINS == 1 {
            // Rigs that nobody simulated have several causes, and the best single one may stand in for others: from each of the best a
            // series grows as long as one more pays. The best series goes on though none pays at once: it may take a few until
            // what was held out says so.
            let mut known: Vec<Vec<&str>> = Vec::new();
            let mut grow = |start: &Judged, ahead: usize| {
                let (mut grown, mut kept) = (start.clone(), start.clone());
                while grown.fitted.effects.len() < MOST
                    && grown.fitted.effects.len() <= kept.fitted.effects.len() + ahead
                    && left::<S>(&grown) > PAIR_ABOVE
                {
                    let mut set: Vec<&str> = ids(&grown).collect();
                    set.sort_unstable();
                    if ahead == 0 && known.contains(&set) {
                        break;
                    }
                    known.push(set);
                    let both = beside(&grown)?;
                    let confirmed = both.iter().find(|n| joins::<S>(&kept, n, allowed));
                    let likely = both.first().filter(|n| ahead > 0 && fits_better(&grown, n));
                    let next = confirmed.or(likely).cloned();
                    if grown.fitted.effects.len() == 1 && ahead == 0 {
                        partners.extend(both);
                    }
                    let Some(next) = next else { break };
                    if joins::<S>(&kept, &next, allowed) {
                        kept = next.clone();
                    }
                    grown = next;
                }
                Ok::<_, Error>(kept)
            };
            let mut ends: Vec<Judged> = Vec::new();
            for start in starts(&singles) {
                ends.push(grow(start, 0)?);
            }
            let best = ends.iter().min_by(|a, b| a.score.total_cmp(&b.score));
            if let Some(best) = best.cloned() {
                ends.push(grow(&best, AHEAD)?);
            }
            pair = ends
                .into_iter()
                .filter(|p| p.fitted.effects.len() > 1 && joins::<S>(first, p, allowed))
                .min_by(|a, b| a.score.total_cmp(&b.score));
            partners.sort_by(|a, b| a.score.total_cmp(&b.score));
        } else {
            let second = singles
                .get(1)
                .filter(|s| s.excess() < 4.0 * first.excess() && left::<S>(s) > PAIR_ABOVE);
            for base in std::iter::once(first).chain(second) {
                partners.extend(beside(base)?);
            }
            partners.sort_by(|a, b| a.score.total_cmp(&b.score));
            // The best partner of the best partner: a first choice may have stood in for two others.
            if let Some(other) = partners.first().map(|p| p.fitted.effects[1].clone()) {
                let tried = |j: &Judged| j.fitted.effects[0].effect.id() == other.effect.id();
                if !tried(first) && !second.is_some_and(tried) {
                    let alone = problem.nominal(std::slice::from_ref(&other), POLISH);
                    partners.extend(beside(&Judged::new(&problem, alone))?);
                }
            }
            partners.sort_by(|a, b| a.score.total_cmp(&b.score));
            pair = partners
                .iter()
                .find(|p| joins::<S>(first, p, 3.0 * allowed))
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
    }
    if let (false, Some(named)) = (adequate, pair.as_mut().or(singles.first_mut())) {
        *named = plainest(&problem, named, allowed);
    }
    let mut best = pair.as_ref().or(singles.first()).unwrap_or(&plain).clone();
    // On a single coordinate what was held out has to say so too.
    let lowers = |to: f64| best.holdout.is_nan() || best.holdout < to * plain.holdout;
    let confirmed = S::CHAINS > 1 || lowers(CONFIRMED);
    let untold = S::CHAINS == 1 && !lowers(TELLS);
    let mut verdict = if adequate || singles.is_empty() {
        Verdict::Adequate
    } else if untold && law::law(&problem, &plain.fitted)?.share < 1.0 - TELLS {
        remarks.push("Model and recordings differ by more than the noise that is read above the band of the signal, but no cause takes away 15 % of it on what was held out, and position, rate, direction, history and time predict less than 15 % of it: it is taken for noise within the band.".into());
        Verdict::Adequate
    } else if !confirmed || unsupported(&best) || leaves_too_much(&problem, &plain, &best)? {
        Verdict::Unexplained
    } else {
        Verdict::MissingPhysics
    };
    // Parts that differ within their tolerances may do it better than any cause.
    if verdict != Verdict::Adequate && built.is_none() {
        watch("looking at tolerances");
        let rows = INDEPENDENT * plain.fitted.state.rows as f64;
        let causes = best.fitted.cost() / noise + best.fitted.free.len() as f64 * rows.ln();
        let most = causes + WORTH_A_FIT * (plain.fitted.cost() / noise - causes).max(0.0);
        let as_built = Built::fit(&mut problem, &plain.fitted, noise, most);
        if let Ok(Some((built, fit))) = as_built
            && built.likelihood(&fit, noise) < causes - allowed / noise
            && built.within(&fit)
        {
            return chain(problem, remarks, request, watch, Some((built, fit)));
        }
        Built::leave(&mut problem)?;
    }
    if verdict == Verdict::Unexplained && request.only.is_empty() {
        watch("trying rare causes");
        let explains = |r: &Judged| {
            !S::unexplained(plain.mean_square, r.mean_square)
                && (r.holdout.is_nan() || r.holdout < best.holdout)
        };
        if let Some(r) = of_the_rare(&problem, &plain, &rare)?.filter(explains) {
            best = r.clone();
            singles.insert(0, r);
            pair = None;
            verdict = Verdict::MissingPhysics;
        }
    }
    if let (Verdict::MissingPhysics, true, Some(relevant)) =
        (verdict, S::CHAINS > 1, request.relevant)
    {
        let taken = taken_away(&problem, &plain.fitted, &best.fitted)?;
        if taken < relevant {
            let names: Vec<&str> = ids(&best).collect();
            remarks.push(format!(
                "{} takes {} of error away: it may be there, but matters less than the {} that were asked for.",
                names.join(" and "),
                in_unit(taken, &words.unit),
                in_unit(relevant, &words.unit)
            ));
            verdict = Verdict::Adequate;
        }
    }
    watch("judging");
    let in_model = verdict == Verdict::MissingPhysics;
    if in_model {
        remarks.extend(forms::others(&problem, &plain, &best));
    }
    let augmented = if in_model { &best } else { &plain };
    let mut candidates = candidates(
        &problem,
        &plain,
        &singles,
        pair.as_ref(),
        &partners,
        verdict,
        surprise / limit,
    );
    if let Some(built) = &built {
        for c in &mut candidates {
            if let Some(times) = built.times(&c.acting) {
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
    let spots = spots(&problem, &plain.fitted, &augmented.fitted)?;
    let named: &[Acting] = if in_model { &best.fitted.effects } else { &[] };
    let places = locate(
        &spots,
        &problem.train.whereabouts(),
        &problem.train.coordinates(),
        S::CHAINS,
        &words,
        named,
    );
    let law = (verdict == Verdict::Unexplained)
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
    let confidence = confidence(verdict, surprise / limit, &plain, &best);
    let departed = built
        .as_ref()
        .map_or_else(Vec::new, |b| b.departed(&augmented.fitted));
    remarks.extend(tolerance::remark(&departed));
    let next_experiment = next_experiment(verdict, &groups_alike, &candidates, &words);
    let says = says(
        verdict,
        &candidates,
        &train_gain,
        holdout_gain.as_ref(),
        &places,
        &words,
        built.is_some(),
    );
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
        eps_r: f64::NAN,
        rig: problem.train.rig(),
        values,
        unit: words.unit,
        basis: words.basis,
        over: words.over,
        plain_mean_square: plain.mean_square,
        plain_holdout_mean_square: plain.holdout,
        law,
        traces,
        departed,
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

/// Whether a plain fit leaves more than any noise does.
fn never_adequate(plain: &Fitted, chance: &chance::Chance) -> bool {
    plain.cost() >= NEVER_ADEQUATE * chance.scale.max(1.0) * plain.state.rows as f64
}

/// Mean square that a further cause could take away. The floor that a single coordinate promises is rough: what was held out counts too.
fn left<S: Subject>(j: &Judged) -> f64 {
    match S::CHAINS {
        1 => j.mean_square.max(j.holdout),
        _ => j.mean_square,
    }
}

/// Whether a cause does no worse than the plain model on what was not fitted, where there is such.
fn holds_out(plain: &Judged, judged: &Judged) -> bool {
    judged.holdout.is_nan() || judged.holdout < plain.holdout
}

/// Error that a model takes away from another's, as a root of the difference of squares: on the held-out recordings, where there are any.
fn taken_away<S: Subject>(
    problem: &Problem<S>,
    before: &Fitted,
    after: &Fitted,
) -> Result<f64, Error> {
    let gain = match &problem.holdout {
        Some(h) => {
            let eta = |f: &Fitted| problem.holdout_eta(f);
            gain(h, &problem.holdout_when, before, after, true, eta)?.0
        }
        None => {
            let eta = |f: &Fitted| Some(f.state.eta[..problem.nonlinear.len()].to_vec());
            gain(
                &problem.train,
                &problem.train_when,
                before,
                after,
                false,
                eta,
            )?
            .0
        }
    };
    let squares = gain.before_v.powi(2) - gain.after_v.powi(2);
    Ok(squares.max(0.0).sqrt())
}

/// Probabilities that nothing is left out, that it is in the catalogue, and that it is something else, from that of a verdict; the rest goes to
/// the other two as [`BASE_RATES`] have it.
fn probabilities(verdict: Verdict, confidence: f64) -> [f64; 3] {
    let own = match verdict {
        Verdict::Adequate => 0,
        Verdict::MissingPhysics => 1,
        Verdict::Unexplained => 2,
    };
    let others: f64 = (0..3).filter(|&i| i != own).map(|i| BASE_RATES[i]).sum();
    [0, 1, 2].map(|i| match i == own {
        true => confidence,
        false => (1.0 - confidence) * BASE_RATES[i] / others,
    })
}

/// How often nothing, a cause of the catalogue, and something else is left out, before anything was recorded.
const BASE_RATES: [f64; 3] = [0.35, 0.5, 0.15];

/// Share of what the plain model leaves on held-out recordings up to which another one foretells them.
const FORETOLD: f64 = 0.5;

/// Whether what the best model leaves must be something that is in no entry.
fn leaves_too_much<S: Subject>(
    problem: &Problem<S>,
    plain: &Judged,
    best: &Judged,
) -> Result<bool, Error> {
    let too_much = |left: f64| S::unexplained(plain.mean_square, left);
    if !too_much(best.mean_square) {
        return Ok(false);
    }
    // a model that is right but for smoothing foretells what was held out
    if best.holdout - 1.0 > FORETOLD * (plain.holdout - 1.0) {
        return Ok(true);
    }
    Ok(beside_smoothing(problem, best)?.is_none_or(too_much))
}

/// The best fit of a cause that is thought of only where no other will do.
fn of_the_rare<S: Subject>(
    problem: &Problem<S>,
    plain: &Judged,
    rare: &(dyn Fn(&str) -> bool + Sync),
) -> Result<Option<Judged>, Error> {
    let tangent = Tangent::new(problem, &plain.fitted)?;
    let groups = fingerprints(problem, &plain.fitted, rare);
    let scanned = scan(problem, &tangent, &groups, &[], rare);
    let fits = refit(problem, &plain.fitted, &choose(&scanned, RARE), &[]);
    Ok(fits
        .iter()
        .map(|f| Judged::new(problem, polish(problem, f)))
        .min_by(|a, b| a.score.total_cmp(&b.score)))
}

/// Ids of the causes of a fit.
fn ids(j: &Judged) -> impl Iterator<Item = &'static str> {
    j.fitted.effects.iter().map(|a| a.effect.id())
}

/// The single causes from which series grow: the best by their score, and the one that fits best of what was not held out, which may
/// need others before it foretells anything.
fn starts(singles: &[Judged]) -> Vec<&Judged> {
    let mut out: Vec<&Judged> = Vec::new();
    for j in singles {
        if out.len() < STARTS && !out.iter().any(|o| ids(o).eq(ids(j))) {
            out.push(j);
        }
    }
    let fits = singles
        .iter()
        .min_by(|a, b| a.mean_square.total_cmp(&b.mean_square));
    out.extend(fits.filter(|f| !out.iter().any(|o| ids(o).eq(ids(f)))));
    out
}

/// Whether a further cause stays. On a robot the excess must fall by a quarter, and nearly vanish where it is no larger than what a
/// textbook form that is wrong in detail leaves. Rigs that nobody simulated have many small causes in inexact forms: there it must fit better,
/// and what was held out must say so too.
fn joins<S: Subject>(base: &Judged, next: &Judged, chance: f64) -> bool {
    if S::CHAINS == 1 && !next.holdout.is_nan() {
        let more = next.fitted.effects.len() - base.fitted.effects.len();
        let confirmed = CONFIRMED.powi(i32::try_from(more).unwrap_or(i32::MAX));
        return fits_better(base, next) && next.holdout < confirmed * base.holdout;
    }
    let left = if base.mean_square > FORM_LEAVES {
        0.75
    } else {
        0.25
    };
    base.fitted.cost() - next.fitted.cost() > 150.0_f64.max(chance)
        && next.excess() < left * base.excess()
        && (next.holdout.is_nan() || next.holdout <= base.holdout)
}

/// Whether a further cause on a single coordinate fits better. Slow misfits leave next to no independent samples, and then the criterion
/// alone never decides.
fn fits_better(base: &Judged, next: &Judged) -> bool {
    next.score < base.score - DECISIVE || next.mean_square < CONFIRMED * base.mean_square
}

/// Mean square up to which what one cause leaves may be its form.
const FORM_LEAVES: f64 = 2.25;
/// Mean square (noise makes 1) that a cause must take away to matter: a seventh of the noise as an error. What smoothing and numerics leave of
/// a right model is less, however long the recordings.
const MATTERS: f64 = 0.02;
/// Difference of the criterion that decides (Kass and Raftery 1995: very strong), and share to which a further cause must bring a mean
/// square.
const DECISIVE: f64 = 10.0;
const CONFIRMED: f64 = 0.95;
/// Share to which some cause must bring the mean square of what was held out, or a law that of the residual: else there is nothing to tell.
const TELLS: f64 = 0.85;

/// Relaxation times in rising order, their moduli with them.
fn rising(mut p: crate::model::Parameters) -> crate::model::Parameters {
    let mut pairs: Vec<(f64, f64)> = p
        .film
        .relaxation_time_s
        .iter()
        .copied()
        .zip(p.film.mu_pa[1..].iter().copied())
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (i, (t, mu)) in pairs.into_iter().enumerate() {
        p.film.relaxation_time_s[i] = t;
        p.film.mu_pa[i + 1] = mu;
    }
    p
}

/// The plain model, weighted by the noise of an ordinary film and then by that of its own, where that is believed; with that
/// of an ordinary film ([`Problem::log_noise`]).
fn baseline<S: Subject>(problem: &mut Problem<S>) -> Result<(Fitted, [f64; 2]), Error> {
    let ordinary = ordinary(problem)?;
    let first = problem.several(BASELINE);
    if !first.cost().is_finite() {
        return Err(Error::Baseline(first.state.failure.unwrap_or_default()));
    }
    if !problem.weigh_if_believed(&first, ordinary)? {
        return Ok((first, ordinary));
    }
    let (a, b) = rayon::join(
        || problem.fit(&[], &first.state.eta, &first.state.beta, BASELINE),
        || problem.nominal(&[], BASELINE),
    );
    Ok((if a.cost() < b.cost() { a } else { b }, ordinary))
}

/// Weighs by the noise of an ordinary film, and says how much that is ([`Problem::log_noise`]).
fn ordinary<S: Subject>(problem: &mut Problem<S>) -> Result<[f64; 2], Error> {
    problem.weigh(&problem.typical())?;
    Ok(problem.log_noise())
}

/// The most promising hypotheses, not too many of one effect.
fn choose(scanned: &[Scanned], count: usize) -> Vec<&Scanned> {
    let mut out: Vec<&Scanned> = Vec::new();
    for s in scanned {
        let same = |c: &&&Scanned| c.acting.effect.id() == s.acting.effect.id();
        let of = out.iter().filter(same).count();
        let known = out.iter().any(|c| c.acting.is(&s.acting));
        if out.len() < count
            && of < OF_ONE
            && !(known && of > 0 && s.promised < 0.5 * out[0].promised)
        {
            out.push(s);
        }
    }
    out
}

/// Fits the hypotheses, each beside the effects that are there already, best first.
fn refit<S: Subject>(
    problem: &Problem<S>,
    base: &Fitted,
    chosen: &[&Scanned],
    beside: &[Acting],
) -> Vec<Fitted> {
    let plain = problem.nonlinear.len();
    let mut fits: Vec<Fitted> = chosen
        .par_iter()
        .map(|s| {
            let mut effects = beside.to_vec();
            effects.push(s.acting.clone());
            let warm = problem.fit(&effects, &base.state.eta[..plain], &base.state.beta, FIRST);
            if warm.cost() > base.cost() - 0.5 * s.promised {
                // Worse than promised: the plain film may have run to its bounds.
                let cold = problem.nominal(&effects, FIRST);
                if cold.cost() < warm.cost() {
                    return cold;
                }
            }
            warm
        })
        .filter(|f: &Fitted| f.cost().is_finite())
        .collect();
    fits.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    fits
}

/// A fit with every effect read as plainly as it can be, where that fits as well within what `chance` makes of a sum of squares.
fn plainest<S: Subject>(problem: &Problem<S>, judged: &Judged, chance: f64) -> Judged {
    let fitted = &judged.fitted;
    let mut effects = fitted.effects.clone();
    let mut plainer = false;
    for a in &mut effects {
        if let Some(values) = a.effect.plainer(&a.values) {
            a.values = values;
            plainer = true;
        }
    }
    if !plainer {
        return judged.clone();
    }
    let plain = problem.nonlinear.len();
    let (eta, beta) = (&fitted.state.eta[..plain], &fitted.state.beta);
    let other = problem.fit(&effects, eta, beta, POLISH);
    // a shape that is usual for one reading need not be so for the other
    if other.state.data_cost < fitted.state.data_cost + chance {
        let score = judged.score;
        return Judged {
            score,
            ..Judged::new(problem, other)
        };
    }
    judged.clone()
}

/// A fit carried on to its end, thresholds also from either side.
fn polish<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Fitted {
    let plain = problem.nonlinear.len();
    let mut starts = vec![fitted.effects.clone()];
    for (e, a) in fitted.effects.iter().enumerate() {
        for (v, q) in a.effect.parameters().iter().enumerate() {
            let threshold = q.size && (q.off.is_infinite() || q.name == "threshold");
            if threshold && q.name != "rate_down" {
                for factor in [0.87, 1.13] {
                    let mut other = fitted.effects.clone();
                    let near = other[e].values[v];
                    other[e].values[v] = if q.name == "theta_stop" {
                        near + 0.1 * (factor - 1.0)
                    } else {
                        (near * factor).clamp(q.lower, q.upper)
                    };
                    starts.push(other);
                }
            }
        }
    }
    starts
        .into_iter()
        .map(|s| problem.fit(&s, &fitted.state.eta[..plain], &fitted.state.beta, POLISH))
        .filter(|f| f.cost().is_finite())
        .min_by(|a, b| a.cost().total_cmp(&b.cost()))
        .unwrap_or_else(|| fitted.clone())
}

/// The best partners of an effect.
fn with_partner<S: Subject>(
    problem: &Problem<S>,
    first: &Judged,
    groups: &[Group],
    units: &[Unit],
    wanted: &(dyn Fn(&str) -> bool + Sync),
) -> Result<Vec<Judged>, Error> {
    let tangent = Tangent::new(problem, &first.fitted)?;
    let own: Vec<&str> = first.fitted.effects.iter().map(|a| a.effect.id()).collect();
    let scanned: Vec<Scanned> = scan(problem, &tangent, groups, units, wanted)
        .into_iter()
        .filter(|s| !own.contains(&s.acting.effect.id()))
        .collect();
    // A single coordinate costs next to nothing, and its many small causes hide each other.
    let (count, judged) = match (S::CHAINS, first.mean_square > 3.0) {
        (1, _) => (6, 4),
        (_, true) => (6, 2),
        (_, false) => (3, 2),
    };
    let chosen: Vec<&Scanned> = choose(&scanned, count);
    let mut fits = refit(problem, &first.fitted, &chosen, &first.fitted.effects);
    fits.truncate(judged);
    Ok(fits
        .into_par_iter()
        .map(|f| Judged::new(problem, polish(problem, &f)))
        .collect())
}

fn candidates<S: Subject>(
    problem: &Problem<S>,
    plain: &Judged,
    singles: &[Judged],
    pair: Option<&Judged>,
    partners: &[Judged],
    verdict: Verdict,
    surprise: f64,
) -> Vec<Candidate> {
    let in_model = verdict == Verdict::MissingPhysics;
    // Each cause once, with the first model that names it.
    let mut chosen: Vec<(&Judged, usize, f64, bool)> = Vec::new();
    let id = |judged: &Judged, own: usize| judged.fitted.effects[own].effect.id();
    let mut add = |judged, own, probability, in_model| {
        if chosen.iter().all(|c| id(c.0, c.1) != id(judged, own)) {
            chosen.push((judged, own, probability, in_model));
        }
    };
    let Some(best) = pair.or(singles.first()) else {
        return Vec::new();
    };
    // Odds among rivals; each effect by its best variant.
    let known = match verdict {
        Verdict::MissingPhysics => catalogued(plain, best, surprise),
        Verdict::Adequate => 0.05,
        Verdict::Unexplained => 0.25,
    };
    if let Some(pair) = pair {
        // First the one that explains more alone.
        let rank = |own: usize| {
            let id = pair.fitted.effects[own].effect.id();
            let place = singles
                .iter()
                .position(|j| j.fitted.effects[0].effect.id() == id);
            place.unwrap_or(usize::MAX)
        };
        let mut members: Vec<usize> = (0..pair.fitted.effects.len()).collect();
        members.sort_by_key(|&own| rank(own));
        for own in members {
            // How sure each member is: against the best model that lacks it.
            let id = pair.fitted.effects[own].effect.id();
            let without = singles
                .iter()
                .chain(partners)
                .filter(|j| j.fitted.effects.iter().all(|a| a.effect.id() != id))
                .map(|j| j.score)
                .fold(f64::INFINITY, f64::min);
            let odds = ((without - pair.score) / (2.0 * S::TEMPERATURE))
                .clamp(-50.0, 50.0)
                .exp();
            add(pair, own, known * odds / (1.0 + odds), in_model);
        }
    }
    let mut by_effect: Vec<(usize, f64)> = Vec::new();
    for (i, j) in singles.iter().enumerate() {
        let id = j.fitted.effects[0].effect.id();
        if !by_effect
            .iter()
            .any(|(k, _)| singles[*k].fitted.effects[0].effect.id() == id)
        {
            by_effect.push((i, (-(j.score - best.score) / (2.0 * S::TEMPERATURE)).exp()));
        }
    }
    let sum: f64 = by_effect.iter().map(|b| b.1).sum();
    for (place, (i, weight)) in by_effect.iter().enumerate() {
        let probability = known * weight
            / if pair.is_some() {
                sum.max(1.0) + 1.0
            } else {
                sum
            };
        add(
            &singles[*i],
            0,
            probability,
            in_model && pair.is_none() && place == 0,
        );
    }
    // What almost joined as a second one comes after the first.
    if let (None, Some(almost)) = (pair, partners.first())
        && almost.fitted.effects.len() > 1
    {
        add(almost, 1, 0.02 * known, false);
    }
    let mut models: Vec<(&Judged, bool)> = Vec::new();
    for (judged, _, _, in_model) in &chosen {
        if !models.iter().any(|(m, _)| std::ptr::eq(*m, *judged)) {
            models.push((judged, *in_model));
        }
    }
    let estimates: Vec<Vec<Estimate>> = models
        .par_iter()
        .map(|(judged, in_model)| {
            value_estimates(problem, &judged.fitted, *in_model)
                .unwrap_or_else(|_| unknown_values(&judged.fitted))
        })
        .collect();
    let mut out: Vec<Candidate> = chosen
        .iter()
        .map(|&(judged, own, probability, in_model)| {
            let acting = &judged.fitted.effects[own];
            let of_model = models.iter().position(|(m, _)| std::ptr::eq(*m, judged));
            Candidate {
                acting: acting.clone(),
                probability,
                delta_bic: judged.score - plain.score,
                mean_square: judged.mean_square,
                holdout_mean_square: judged.holdout,
                in_model,
                values: of_model.map_or_else(Vec::new, |m| {
                    values(problem, &judged.fitted, own, &estimates[m])
                }),
                says: format!(
                    "{}{}; the weighted mean square falls from {:.2} to {:.2}",
                    acting.effect.says(),
                    if acting.on == [true; 3] {
                        String::new()
                    } else {
                        format!(
                            " (actuator {})",
                            1 + acting.on.iter().position(|o| *o).unwrap_or(0)
                        )
                    },
                    plain.mean_square,
                    judged.mean_square
                ),
            }
        })
        .collect();
    out.sort_by(|a, b| {
        b.in_model
            .cmp(&a.in_model)
            .then(b.probability.total_cmp(&a.probability))
    });
    out
}

/// Probability that a cause that is named is in the catalogue at all: noise may have made it, and something else may look like it, the
/// more likely the more of the excess is left.
fn catalogued(plain: &Judged, best: &Judged, surprise: f64) -> f64 {
    let left = best.excess() / plain.excess().max(1e-9);
    let real = 1.0 / (1.0 + (-(4.0 * (surprise - 1.0) + 1.0)).exp());
    real * (1.0 - (MIMICRY + 0.5 * left).min(0.5))
}

/// Share of what is named that something in no catalogue mimics, where nothing is left that would betray it.
const MIMICRY: f64 = 0.04;

fn values<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
    own: usize,
    estimates: &[Estimate],
) -> Vec<Value> {
    let acting = &fitted.effects[own];
    let name_of = |number: f64| {
        problem
            .train
            .whereabouts()
            .into_iter()
            .zip(&problem.train_when)
            .find(|(_, w)| w.recording as f64 == number)
            .map(|(w, _)| w.id)
    };
    acting
        .effect
        .parameters()
        .iter()
        .enumerate()
        .map(|(v, q)| {
            let free = fitted.free.iter().position(|f| *f == (own, v));
            let Estimate {
                value,
                std_error,
                ci95,
            } = match free {
                Some(i) => estimates[i],
                None => Estimate::new(acting.values[v], f64::NAN, 1.0),
            };
            let word = match q.name {
                "recording" => name_of(value),
                _ if v == 0 => acting
                    .effect
                    .variants()
                    .get(value as usize)
                    .map(|w| w.to_string()),
                _ => None,
            };
            let at_bound = std_error.is_nan() && (value <= q.lower || value >= q.upper);
            let (factor, unit) = problem.train.unit_of(q.unit);
            Value {
                name: q.name,
                unit,
                value: factor * value,
                fitted: factor * acting.values[v],
                word,
                std_error: factor * std_error,
                ci95: ci95.map(|end| factor * end),
                at_bound,
            }
        })
        .collect()
}

/// Torque error of the plain and the augmented model at every kept sample, in standard deviations of its own noise.
fn spots<S: Subject>(
    problem: &Problem<S>,
    before: &Fitted,
    after: &Fitted,
) -> Result<Vec<Spot>, Error> {
    let of = |f: &Fitted| -> Result<Vec<f64>, Error> {
        let residual = problem.residual(f);
        let design = residual.design(&f.state.eta, &f.state.beta)?;
        Ok(design.column(design.ncols() - 1).iter().copied().collect())
    };
    let (a, b) = rayon::join(|| of(before), || of(after));
    let (a, b) = (a?, b?);
    let same = after.effects.is_empty();
    let mut out = Vec::with_capacity(a.len());
    let mut row = 0;
    for number in 0..problem.train_when.len() {
        let places = problem.train.at(number);
        for (at, w) in places.iter().zip(problem.train.whitening(number)) {
            let of = |e: &[f64]| {
                let mut three = [0.0; 3];
                three[..S::CHAINS].copy_from_slice(&e[row..row + S::CHAINS]);
                unwhiten(&w, &three)
            };
            let (before, after) = (of(&a), of(&b));
            for k in 0..S::CHAINS {
                out.push(Spot {
                    recording: number,
                    actuator: k,
                    before: before[k],
                    after: if same { 1.0 } else { after[k] },
                    at: at[k],
                });
            }
            row += S::CHAINS;
        }
    }
    Ok(out)
}

/// Squares of the torque errors over their own standard deviations, from whitened ones.
fn unwhiten(w: &[f64; 6], e: &[f64]) -> [f64; 3] {
    // e = W r with W lower triangular; L = W^-1 has the covariance L L'.
    let l00 = 1.0 / w[0];
    let l11 = 1.0 / w[2];
    let l22 = 1.0 / w[5];
    let l10 = -w[1] * l00 * l11;
    let l21 = -w[4] * l11 * l22;
    let l20 = -(w[3] * l00 + w[4] * l10) * l22;
    let r = [
        l00 * e[0],
        l10 * e[0] + l11 * e[1],
        l20 * e[0] + l21 * e[1] + l22 * e[2],
    ];
    let v = [
        l00 * l00,
        l10 * l10 + l11 * l11,
        l20 * l20 + l21 * l21 + l22 * l22,
    ];
    [0, 1, 2].map(|k| r[k] * r[k] / v[k])
}

/// Errors before and after, and the traces that show them.
fn gain<S: Subject>(
    residual: &S,
    when: &[When],
    before: &Fitted,
    after: &Fitted,
    held_out: bool,
    plain_eta: impl Fn(&Fitted) -> Option<Vec<f64>>,
) -> Result<(Gain, Vec<Traces>), Error> {
    let eta = [before, after].map(|f| plain_eta(f).unwrap_or_default());
    let models =
        [before, after].map(|f| residual.with_effects(f.effects.clone(), Vec::new(), when));
    let fits = [before, after];
    let mut sums = [[0.0; 2]; 3]; // before, after, floor: of the basis, all
    let mut counts = [0.0; 2];
    let mut traces = Vec::new();
    for (number, place) in residual.whereabouts().into_iter().enumerate() {
        let [a, b] = [0, 1].map(|i| models[i].errors(number, &eta[i], &fits[i].state.beta));
        let (a, b) = (a?, b?);
        let n = a.time_s.len();
        let mut trace = Traces {
            id: place.id,
            held_out,
            before_v: vec![[f64::NAN; 3]; n],
            after_v: vec![[f64::NAN; 3]; n],
            torque_before: models[0].kept_errors(number, &eta[0], &fits[0].state.beta)?,
            torque_after: models[1].kept_errors(number, &eta[1], &fits[1].state.beta)?,
            time_s: a.time_s,
            command_v: a.command,
            height_mm: a.height,
        };
        for i in 0..n {
            for k in 0..S::CHAINS {
                if !(a.counts[i] && b.counts[i]) {
                    continue;
                }
                let e = [a.error[i][k], b.error[i][k]];
                trace.before_v[i][k] = e[0];
                trace.after_v[i][k] = e[1];
                let told = a.basis[i][k];
                let squares = [e[0] * e[0], e[1] * e[1], b.sd[i][k].powi(2)];
                for (sum, square) in sums.iter_mut().zip(squares) {
                    sum[1] += square;
                    if told {
                        sum[0] += square;
                    }
                }
                counts[1] += 1.0;
                counts[0] += f64::from(told);
            }
        }
        traces.push(trace);
    }
    let rms = |i: usize, j: usize| (sums[i][j] / counts[j]).sqrt();
    let finite = [0, 1, 2].iter().all(|&i| rms(i, 1).is_finite());
    if !finite {
        return Err(Error::NothingExcited(format!(
            "the errors of {} samples make no number ({}, {} and {} before, after and from noise): nothing can be judged; look for \
             numbers beyond all plausibility with `deacal import REC`, or give longer recordings",
            counts[1],
            rms(0, 1),
            rms(1, 1),
            rms(2, 1)
        )));
    }
    Ok((
        Gain {
            before_v: rms(0, 0),
            after_v: rms(1, 0),
            noise_floor_v: rms(2, 0),
            all_v: [rms(0, 1), rms(1, 1), rms(2, 1)],
        },
        traces,
    ))
}

/// The smallest size of each effect that would have been found.
fn hidden<S: Subject>(problem: &Problem<S>, scanned: &[Scanned], allowed: f64) -> Vec<Hidden> {
    let mut out: Vec<Hidden> = Vec::new();
    let mut effects: Vec<&'static dyn Effect> = Vec::new();
    for (effect, _) in problem.train.starts() {
        if effects.iter().all(|e| e.id() != effect.id()) {
            effects.push(effect);
        }
    }
    let moments = problem.train.moments().iter();
    for effect in moments.filter_map(|id| crate::effects::by_id(id)) {
        if effects.iter().all(|e| e.id() != effect.id()) {
            effects.push(effect);
        }
    }
    for effect in effects {
        let best = scanned
            .iter()
            .filter(|s| s.acting.effect.id() == effect.id() && s.strength.0 > 0.0)
            .max_by(|a, b| {
                (a.strength.0 / a.strength.1.powi(2))
                    .total_cmp(&(b.strength.0 / b.strength.1.powi(2)))
            });
        let Some(s) = best else { continue };
        let Some(q) = effect
            .parameters()
            .iter()
            .find(|q| q.size && q.off.is_finite())
        else {
            continue;
        };
        let (factor, unit) = problem.train.unit_of(q.unit);
        out.push(Hidden {
            effect: effect.id(),
            hidden_share: s.hidden_share,
            smallest_detectable: factor * (allowed / s.strength.0).sqrt() * s.strength.1 * q.spread,
            name: q.name,
            unit,
        });
    }
    out.sort_by(|a, b| b.hidden_share.total_cmp(&a.hidden_share));
    out
}

fn confidence(verdict: Verdict, surprise: f64, plain: &Judged, best: &Judged) -> f64 {
    let odds = |x: f64| 1.0 / (1.0 + (-x).exp());
    match verdict {
        Verdict::Adequate => odds(4.0 * (1.0 - surprise) + 1.0).max(0.5),
        Verdict::MissingPhysics => catalogued(plain, best, surprise),
        Verdict::Unexplained => {
            let left = best.excess() / plain.excess().max(1e-9);
            odds(3.0 * (best.mean_square.max(1.0) / 4.0).ln() + 2.0 * (left / 0.05).ln().min(2.0))
        }
    }
}

fn next_experiment(
    verdict: Verdict,
    groups: &[Vec<&'static str>],
    candidates: &[Candidate],
    words: &subject::Words,
) -> String {
    // what was fitted knows its own drive; others are looked up
    let by = |id: &str| {
        let own = candidates.iter().map(|c| c.acting.effect);
        let own = own.into_iter().find(|e| e.id() == id);
        let robot = || crate::effects::by_id(id).map(|e| e.brought_out_by());
        let line = || crate::effects::line::by_id(id).map(|e| e.brought_out_by());
        own.map(|e| e.brought_out_by())
            .or_else(robot)
            .or_else(line)
            .unwrap_or_default()
    };
    match (verdict, groups.first()) {
        (Verdict::MissingPhysics, Some(g)) => format!(
            "To tell {} from {}: {}; and {}.",
            g[0].replace('_', " "),
            g[1].replace('_', " "),
            by(g[0]),
            by(g[1])
        ),
        (Verdict::MissingPhysics, None) => format!(
            "To confirm {}: {}.",
            candidates
                .first()
                .map_or(String::new(), |c| c.acting.effect.id().replace('_', " ")),
            candidates.first().map_or(String::new(), |c| c
                .acting
                .effect
                .brought_out_by()
                .to_string())
        ),
        (Verdict::Unexplained, _) => words.repeat.into(),
        (Verdict::Adequate, _) => words.rich.into(),
    }
}

fn says(
    verdict: Verdict,
    candidates: &[Candidate],
    train: &Gain,
    holdout: Option<&Gain>,
    places: &[Place],
    words: &subject::Words,
    as_built: bool,
) -> String {
    let built = if as_built {
        " for a robot whose parts differ within their tolerances"
    } else {
        ""
    };
    let number = |x: f64| in_unit(x, &words.unit);
    let over = words.over;
    let on_new = holdout.map_or(String::new(), |h| {
        format!(
            " On recordings that were not fitted it goes from {} to {} (noise: {}).",
            number(h.before_v),
            number(h.after_v),
            number(h.noise_floor_v)
        )
    });
    match verdict {
        Verdict::Adequate => format!(
            "The plain model suffices{built}: what it leaves, {}{over}, is what noise leaves, and no effect of the catalogue takes away more than chance would.",
            number(train.before_v)
        ),
        Verdict::MissingPhysics => {
            let named: Vec<String> = candidates
                .iter()
                .filter(|c| c.in_model)
                .map(|c| format!("{} ({})", c.acting.effect.id(), c.acting.effect.says()))
                .collect();
            let left = if train.after_v > STRUCTURE_LEFT * train.noise_floor_v {
                " More than noise is still left: something else acts as well."
            } else {
                ""
            };
            let certain = candidates
                .iter()
                .filter(|c| c.in_model)
                .all(|c| c.probability >= NAMED);
            let what = if certain {
                "Left out"
            } else {
                "Something is left out, and no cause has odds above one half; most likely"
            };
            format!(
                "{what}: {}. With it the error{over} goes from {} to {}; noise alone makes {}.{on_new}{left}",
                named.join("; "),
                number(train.before_v),
                number(train.after_v),
                number(train.noise_floor_v)
            )
        }
        Verdict::Unexplained => format!(
            "Model and recordings differ by more than noise ({}{over} against {}), and no effect of the catalogue accounts for it.{}",
            number(train.before_v),
            number(train.noise_floor_v),
            places
                .first()
                .map_or(String::new(), |p| format!(" It lives here: {}.", p.says))
        ),
    }
}

/// Probability from which a cause is named as what is left out.
const NAMED: f64 = 0.5;
/// Error over the noise's, from which on a report says that something else acts as well.
const STRUCTURE_LEFT: f64 = 1.5;

/// An error with its unit: volts with one decimal, others with three digits; "n/a" where there is none.
pub fn in_unit(x: f64, unit: &str) -> String {
    if !x.is_finite() {
        return "n/a".into();
    }
    if unit == "V" && x.abs() >= 1.0 {
        return format!("{x:.1} V");
    }
    let digits = if x == 0.0 {
        0
    } else {
        (2 - x.abs().log10().floor() as i32).clamp(0, 9) as usize
    };
    format!("{x:.digits$} {unit}")
}
