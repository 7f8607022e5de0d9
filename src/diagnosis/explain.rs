//! From a choice to a diagnosis: parts beyond their tolerances, what is learnt, candidates, places, gains,
//! words.

use super::chain::{Case, Choice, Field};
use super::errors::{holdout_gain, spots, train_gain};
use super::fits::rising;
use super::judge::{INDEPENDENT, Judged};
use super::learn::Taught;
use super::locate::locate;
use super::outcome::*;
use super::problem::{Fitted, Problem, over_series};
use super::subject::Subject;
use super::verdict::{fails_held_out, ids};
use super::words::{
    How, candidates, confidence, hidden, in_unit, measure, next_experiment, probabilities, says,
    says_of_part,
};
use super::{forms, law, learn, tolerance};
use crate::effects::Acting;
use crate::model::Parameters;

/// Share of what the plain model leaves beyond noise up to which what a cause leaves is a detail.
const DETAIL: f64 = 0.1;

/// Odds of a cause beside a part beyond its tolerance, over what they are beside parts within, and those of a
/// cause that was such a part: on seeds for development four of either kind were all right (Laplace's rule of
/// succession).
const WITH_A_PART: f64 = 5.0 / 6.0;

/// What a verdict is with the parts that it goes with.
struct Ruled {
    verdict: Verdict,
    /// The part beyond its tolerance with which alone the plain model would suffice.
    beyond: Option<Departed>,
    /// Odds of what is named over what they are beside parts within their tolerances.
    trust: f64,
}

/// A model suffices only with parts that are within their tolerances. One beyond may be what is off, or stand
/// in for what is: it is said, and no cause is named beside it but one that takes nearly all away, to which
/// it can only be a detail, and that only where the part can be believed.
fn ruled(field: &Field, choice: &Choice) -> Ruled {
    let (plain, best) = (&field.plain, &choice.best);
    let detail =
        |part: &Departed| part.times() < tolerance::FAR && best.excess() < DETAIL * plain.excess();
    let beside = field.beyond(best);
    let stands = beside.as_ref().is_none_or(detail) && !fails_held_out(plain, best);
    let verdict = match choice.verdict {
        Verdict::MissingPhysics if !stands => Verdict::Unexplained,
        other => other,
    };
    let suffices = verdict == Verdict::Adequate;
    let beyond = field.beyond(plain).filter(|_| suffices);
    let named = verdict == Verdict::MissingPhysics;
    let of_a_part = field.built.as_ref().is_some_and(|b| b.released);
    Ruled {
        verdict: match beyond {
            Some(_) => Verdict::Unexplained,
            None => verdict,
        },
        beyond,
        trust: match named && (of_a_part || beside.is_some()) {
            true => WITH_A_PART,
            false => 1.0,
        },
    }
}

/// The diagnosis that a choice comes to.
pub(super) fn explain<S: Subject>(
    case: &mut Case<S>,
    mut field: Field,
    mut choice: Choice,
) -> Result<Diagnosis, Error> {
    (case.watch)("judging");
    let (problem, remarks) = (&case.problem, &mut case.remarks);
    let models = std::iter::once(&mut field.plain).chain(&mut field.singles);
    let models = models.chain(&mut choice.partners);
    for judged in models.chain(&mut choice.pair).chain([&mut choice.best]) {
        judged.hold(problem);
    }
    let ruled = ruled(&field, &choice);
    let (verdict, plain, best) = (ruled.verdict, &field.plain, &choice.best);
    let in_model = verdict == Verdict::MissingPhysics;
    let nothing_known = verdict == Verdict::Unexplained && ruled.beyond.is_none();
    if in_model {
        remarks.extend(forms::others(problem, plain, best));
    }
    let mut taught = None;
    if nothing_known {
        (case.watch)("learning what no cause accounts for");
        let learnt = learn::learn(problem, &plain.fitted)?;
        taught = that_holds(problem, &plain.fitted, learnt, remarks)?;
    }
    let augmented: &Fitted = match &taught {
        Some(taught) => &taught.fitted,
        None if in_model => &best.fitted,
        None => &plain.fitted,
    };
    let built = field.built.as_ref();
    let departed = built.map_or_else(Vec::new, |b| b.departed(augmented));
    let candidates = listed(problem, &field, &choice, &ruled);
    let groups = if in_model {
        told_apart(problem, &field, best, &choice.partners)
    } else {
        Vec::new()
    };
    let named = if in_model {
        &best.fitted
    } else {
        &plain.fitted
    };
    let places = places(problem, &plain.fitted, named)?;
    let law = (nothing_known && taught.is_none())
        .then(|| law::law(problem, &best.fitted))
        .transpose()?;
    let (train, holdout, traces) = gains(problem, &plain.fitted, augmented)?;
    if holdout.is_none() {
        remarks.push("No recording was held out: the gain is that on the recordings that were fitted, and the verdict is the weaker for it.".into());
    }
    let learnt = match &taught {
        Some(t) => {
            let gap = holdout.map_or(f64::NAN, |h| h.gap_closed());
            Some(learn::physics(
                problem,
                &plain.fitted,
                t,
                &field.seen.groups,
                gap,
            )?)
        }
        None => None,
    };
    let words = problem.train.words();
    let (confidence, says, next_experiment) = match &ruled.beyond {
        Some(part) => of_part(&field, part, &train, problem),
        None => {
            remarks.extend(built.into_iter().flat_map(|b| b.remarks(augmented)));
            let held = holdout.as_ref();
            let how = How {
                as_built: built.is_some(),
                at_edge: choice.at_edge,
            };
            let mut says = says(verdict, &candidates, &train, held, &places, &words, how);
            if let Some(learnt) = &learnt {
                says += &format!(" Learnt from the recordings: {}", learnt.says);
            }
            (
                ruled.trust * confidence(verdict, &choice.odds, plain, best),
                says,
                next_experiment(verdict, &groups, &candidates, &places, &words),
            )
        }
    };
    let dated = dated(problem, augmented);
    if !dated.is_empty() {
        let each: Vec<String> = dated.iter().map(|d| format!("{:.0}", d.1)).collect();
        remarks.push(format!(
            "The drift fits best where the recordings were made {} s after the first; of those held out, their first halves say it. State `start` where it is known.",
            each.join(", ")
        ));
    }
    let state = &augmented.state;
    Ok(Diagnosis {
        verdict,
        confidence,
        probabilities: probabilities(verdict, confidence),
        places,
        candidates,
        groups,
        next_experiment,
        hidden: hidden(problem, &field.seen.scanned, field.by_chance),
        train,
        holdout,
        plain: parameters(problem, &plain.fitted),
        parameters: parameters(problem, augmented),
        pose: None,
        eps_r: f64::NAN,
        rig: problem.train.rig(),
        values: problem.train.values(&state.eta, &state.beta),
        unit: words.unit,
        basis: words.basis,
        over: words.over,
        plain_mean_square: plain.mean_square,
        plain_holdout_mean_square: plain.holdout,
        law,
        learnt,
        traces,
        departed,
        beyond: ruled.beyond,
        built: built.map_or(f64::NAN, |b| b.scales.parts),
        dated,
        remarks: std::mem::take(remarks),
        says,
        evidence: evidence(&field, &choice, case.request.false_alarm_rate),
        rivals: field.seen.rivals,
        rival_models: field.seen.rival_models,
    })
}

/// When the recordings were made by a cause over the series, where nobody states it: number in the series, and
/// first sample after the first of all, s; in their order.
fn dated<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Vec<(usize, f64)> {
    if problem.assumed.is_none() || over_series(&fitted.effects).is_none() {
        return Vec::new();
    }
    let all = problem.train_when.iter().chain(&problem.holdout_when);
    let mut all: Vec<(usize, f64)> = all.map(|w| (w.recording, w.series_s)).collect();
    all.sort_by_key(|w| w.0);
    let first_s = all[0].1;
    all.iter().map(|w| (w.0, w.1 - first_s)).collect()
}

/// The candidates of a choice, with the tolerances of those that are parts.
fn listed<S: Subject>(
    problem: &Problem<S>,
    field: &Field,
    choice: &Choice,
    ruled: &Ruled,
) -> Vec<Candidate> {
    let mut list = candidates(
        problem,
        &field.plain,
        &field.singles,
        choice.pair.as_ref(),
        &choice.partners,
        ruled.verdict,
        &choice.odds,
    );
    if field.built.is_none() {
        return list;
    }
    let tolerances = problem.train.tolerances();
    for c in &mut list {
        if c.in_model {
            c.probability *= ruled.trust;
        }
        if let Some(times) = tolerance::times(&tolerances, &c.acting) {
            c.says += &format!("; {times:.1} times its tolerance");
        }
    }
    list
}

/// Groups of ids that the recordings cannot tell apart, of which a model's causes are the first ones.
fn told_apart<S: Subject>(
    problem: &Problem<S>,
    field: &Field,
    named: &Judged,
    partners: &[Judged],
) -> Vec<Vec<&'static str>> {
    let group = |own: usize| {
        let mut ids = field.rivals_of(problem, named, own, partners);
        ids.insert(0, named.fitted.effects[own].effect.id());
        ids
    };
    let mut groups: Vec<_> = (0..named.fitted.effects.len()).map(group).collect();
    groups.retain(|ids| ids.len() > 1);
    groups.dedup(); // the same cause on one actuator after the other
    groups
}

/// Odds and words of a plain model that suffices with a part beyond its tolerance, and what would tell more.
fn of_part<S: Subject>(
    field: &Field,
    part: &Departed,
    train: &Gain,
    problem: &Problem<S>,
) -> (f64, String, String) {
    let words = problem.train.words();
    let rows = INDEPENDENT * field.plain.fitted.state.rows as f64;
    // what it costs to keep the part near the drawing, against what a cause of one value costs
    let gain = 0.5 * part.times().powi(2) - 0.5 * rows.ln() + field.each;
    let odds = 1.0 / (1.0 + (-gain).exp());
    let left = format!("{}{}", in_unit(train.before_v, &words.unit), words.over);
    (odds.max(0.5), says_of_part(part, &left), measure(part))
}

/// What the verdict rests on.
fn evidence(field: &Field, choice: &Choice, rate: f64) -> Evidence {
    let chance = &field.seen.chance;
    let tried = field.singles.iter().chain(&choice.partners).map(|j| {
        (
            ids(j).collect(),
            j.score - field.plain.score,
            j.mean_square,
            j.holdout,
        )
    });
    Evidence {
        surprise: chance.largest,
        whose: chance.whose,
        limit: chance.limit(rate),
        noise_scale: chance.scale,
        each: chance.each.clone(),
        tried: tried.collect(),
        p_value: chance.p_value(),
        fall: field.fall,
        fall_by_chance: field.by_chance,
    }
}

/// Where the plain model fails, and a model with causes (the same one where none is named) does not.
pub(super) fn places<S: Subject>(
    problem: &Problem<S>,
    plain: &Fitted,
    with: &Fitted,
) -> Result<Vec<Place>, Error> {
    let train = &problem.train;
    let spots = spots(problem, plain, with)?;
    let (entries, coordinates) = (train.whereabouts(), train.coordinates());
    let named: &[Acting] = &with.effects;
    Ok(locate(
        &spots,
        &entries,
        &coordinates,
        S::CHAINS,
        &train.words(),
        named,
    ))
}

/// Errors of the plain and the augmented model where they were fitted and on what was held out, and the
/// traces that show them.
pub(super) fn gains<S: Subject>(
    problem: &Problem<S>,
    plain: &Fitted,
    augmented: &Fitted,
) -> Result<(Gain, Option<Gain>, Vec<Traces>), Error> {
    let (train, mut traces) = train_gain(problem, plain, augmented)?;
    let held_out = holdout_gain(problem, problem.holdout.as_ref(), plain, augmented)?;
    let holdout = held_out.map(|(gain, of_these)| {
        traces.extend(of_these);
        gain
    });
    Ok((train, holdout, traces))
}

/// What was learnt of what `model` leaves, where it holds: a term that does not lower the error of what was
/// held out is dropped, and that is remarked.
pub(super) fn that_holds<S: Subject>(
    problem: &Problem<S>,
    model: &Fitted,
    taught: Option<Taught>,
    remarks: &mut Vec<String>,
) -> Result<Option<Taught>, Error> {
    let Some(term) = taught else {
        return Ok(None);
    };
    let held_out = holdout_gain(problem, problem.holdout.as_ref(), model, &term.fitted)?;
    let Some((gain, _)) = held_out.filter(|(gain, _)| gain.after_v >= gain.before_v) else {
        return Ok(Some(term));
    };
    let unit = problem.train.words().unit;
    remarks.push(format!(
        "What was learnt from the recordings does not hold where nothing was fitted, and was dropped: there the error goes from {} to {}.",
        in_unit(gain.before_v, &unit),
        in_unit(gain.after_v, &unit)
    ));
    Ok(None)
}

/// Film and forearm of a fitted model.
pub(super) fn parameters<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Parameters {
    let state = &fitted.state;
    rising(problem.train.parameters(&state.eta, &state.beta))
}
