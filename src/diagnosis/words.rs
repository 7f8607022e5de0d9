//! What a diagnosis lists and says: candidates with their odds and sizes, what could hide, sentences.

use rayon::prelude::*;

use super::judge::{Judged, Odds};
use super::outcome::*;
use super::problem::{Fitted, Problem};
use super::scan::Scanned;
use super::sizes::{Estimate, unknown_values, value_estimates};
use super::subject::{self, Subject};
use super::{BASE_RATES, NOT_NAMED};
use crate::effects::{Effect, plain_name};

/// Odds of a candidate of a model that suffices, over what blocks of the recordings give it: on a robot that is
/// only nearly its drawing the likeliest cause of nothing is often a part. Of three seeds for development the
/// odds of 0.1 and more promised 61 causes, and 17 were there (Laplace's rule of succession).
const BESIDE_ADEQUATE: f64 = 18.0 / 62.3;

pub(super) fn candidates<S: Subject>(
    problem: &Problem<S>,
    plain: &Judged,
    singles: &[Judged],
    pair: Option<&Judged>,
    partners: &[Judged],
    verdict: Verdict,
    odds: &Odds,
) -> Vec<Candidate> {
    let in_model = verdict == Verdict::MissingPhysics;
    // Each cause once, with the first model that names it.
    let mut chosen: Vec<(&Judged, usize, f64, bool)> = Vec::new();
    let id = |judged: &Judged, own: usize| judged.fitted.effects[own].effect.id();
    let said = |own: f64, named: bool| if named { own } else { own.min(NOT_NAMED) };
    let mut add = |judged, own, probability, in_model| {
        if chosen.iter().all(|c| id(c.0, c.1) != id(judged, own)) {
            chosen.push((judged, own, probability, in_model));
        }
    };
    let Some(best) = pair.or(singles.first()) else {
        return Vec::new();
    };
    let known = match verdict {
        Verdict::MissingPhysics => 1.0 - mimicked(plain, best),
        Verdict::Adequate => BESIDE_ADEQUATE,
        Verdict::Unexplained => 0.25,
    };
    if let Some(pair) = pair {
        // First the likelier one, of equals, as odds are said, the one that explains more alone.
        let rank = |own: usize| {
            let place = singles.iter().position(|j| id(j, 0) == id(pair, own));
            place.unwrap_or(usize::MAX)
        };
        let percent = |own: usize| (100.0 * odds.cause(id(pair, own))).round();
        let likelier = |a: usize, b: usize| percent(b).total_cmp(&percent(a));
        let mut members: Vec<usize> = (0..pair.fitted.effects.len()).collect();
        members.sort_by(|&a, &b| likelier(a, b).then(rank(a).cmp(&rank(b))));
        for own in members {
            let id = pair.fitted.effects[own].effect.id();
            add(pair, own, said(known * odds.cause(id), in_model), in_model);
        }
    }
    for (place, single) in singles.iter().enumerate() {
        let named = in_model && pair.is_none() && place == 0;
        let own = known * odds.cause(id(single, 0));
        add(single, 0, said(own, named), named);
    }
    // What almost joined as a second one comes after the first.
    if let (None, Some(almost)) = (pair, partners.first())
        && almost.fitted.effects.len() > 1
    {
        let own = known * odds.cause(id(almost, 1));
        add(almost, 1, said(own, false), false);
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
    // what is named stays in its order
    out.sort_by(|a, b| {
        let odds = match a.in_model {
            true => std::cmp::Ordering::Equal,
            false => b.probability.total_cmp(&a.probability),
        };
        b.in_model.cmp(&a.in_model).then(odds)
    });
    out
}

/// Probability that what looks like a cause of the catalogue is something else: the more likely the more of
/// the excess is left.
pub(super) fn mimicked(plain: &Judged, best: &Judged) -> f64 {
    let left = best.excess() / plain.excess().max(1e-9);
    (MIMICRY + 0.5 * left).min(0.5)
}

/// Share of what is named that something in no catalogue mimics, where nothing is left that would betray it.
pub(super) const MIMICRY: f64 = 0.04;

pub(super) fn values<S: Subject>(
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
            // a word has no bounds
            let at_end = value <= q.lower || value >= q.upper;
            let at_bound = word.is_none() && std_error.is_nan() && at_end;
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

pub(super) fn confidence(verdict: Verdict, odds: &Odds, plain: &Judged, best: &Judged) -> f64 {
    match verdict {
        Verdict::Adequate => odds.nothing().max(0.5),
        Verdict::MissingPhysics => (1.0 - odds.nothing()) * (1.0 - mimicked(plain, best)),
        Verdict::Unexplained => {
            let odds = |x: f64| 1.0 / (1.0 + (-x).exp());
            let left = best.excess() / plain.excess().max(1e-9);
            odds(3.0 * (best.mean_square.max(1.0) / 4.0).ln() + 2.0 * (left / 0.05).ln().min(2.0))
        }
    }
}

/// Probabilities that nothing is left out, that it is in the catalogue, and that it is something else, from
/// that of a verdict; the rest goes to the other two as [`BASE_RATES`] have it.
pub(super) fn probabilities(verdict: Verdict, confidence: f64) -> [f64; 3] {
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

/// The smallest size of each effect that would have been found.
pub(super) fn hidden<S: Subject>(
    problem: &Problem<S>,
    scanned: &[Scanned],
    allowed: f64,
) -> Vec<Hidden> {
    let mut out: Vec<Hidden> = Vec::new();
    let mut effects: Vec<&'static dyn Effect> = Vec::new();
    for (effect, _) in problem.train.starts() {
        if effects.iter().all(|e| e.id() != effect.id()) {
            effects.push(effect);
        }
    }
    for effect in problem.train.moments() {
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

/// What to record where something swings on its own.
const AT_REST: &str = "The rig at rest, with what runs beside it (pumps, fans, mains, other drives) switched \
    off one after the other: what swings on its own swings there, too, and stops with its source. What swings \
    only after a jolt is a part that hangs or is sprung: hold it.";

pub(super) fn next_experiment(
    verdict: Verdict,
    groups: &[Vec<&'static str>],
    candidates: &[Candidate],
    places: &[Place],
    words: &subject::Words,
) -> String {
    let swings = places.first().filter(|p| p.dimension == "frequency");
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
            plain_name(g[0]),
            plain_name(g[1]),
            by(g[0]),
            by(g[1])
        ),
        (Verdict::MissingPhysics, None) => format!(
            "To confirm {}: {}.",
            candidates
                .first()
                .map_or(String::new(), |c| plain_name(c.acting.effect.id())),
            candidates.first().map_or(String::new(), |c| c
                .acting
                .effect
                .brought_out_by()
                .to_string())
        ),
        (Verdict::Unexplained, _) if swings.is_some() => AT_REST.into(),
        (Verdict::Unexplained, _) => words.repeat.into(),
        (Verdict::Adequate, _) => words.rich.into(),
    }
}

/// How a verdict was come to: with parts that differ within their tolerances; with a cause at the edge of the
/// range.
#[derive(Clone, Copy)]
pub(super) struct How {
    pub as_built: bool,
    pub at_edge: bool,
}

pub(super) fn says(
    verdict: Verdict,
    candidates: &[Candidate],
    train: &Gain,
    holdout: Option<&Gain>,
    places: &[Place],
    words: &subject::Words,
    how: How,
) -> String {
    let built = if how.as_built {
        " for a robot whose parts differ within their tolerances"
    } else {
        ""
    };
    let number = |x: f64| in_unit(x, &words.unit);
    let all = over_all(train, holdout);
    let over = if all { OVER_ALL } else { words.over };
    let [before, after, noise] = train.told(all);
    let on_new = holdout.map_or(String::new(), |h| {
        let [before, after, noise] = h.told(all);
        format!(
            " On recordings that were not fitted it goes from {} to {} (noise: {}).",
            number(before),
            number(after),
            number(noise)
        )
    });
    match verdict {
        Verdict::Adequate => format!(
            "The plain model suffices{built}: what it leaves, {}{over}, is what noise leaves, and no effect of the catalogue takes away more than chance would.",
            number(before)
        ),
        Verdict::MissingPhysics => {
            let named: Vec<String> = candidates
                .iter()
                .filter(|c| c.in_model)
                .map(|c| format!("{} ({})", c.acting.effect.id(), c.acting.effect.says()))
                .collect();
            let left = if how.at_edge {
                " Away from the edge of the range noise alone is left; at it angles within their tolerances do not tell so stiff a torque."
            } else if train.after_v > STRUCTURE_LEFT * train.noise_floor_v {
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
                number(before),
                number(after),
                number(noise)
            )
        }
        Verdict::Unexplained => format!(
            "Model and recordings differ {} ({}{over} against {}), and no effect of the catalogue accounts for it.{}",
            if train.before_v > train.noise_floor_v {
                "by more than noise"
            } else {
                "in some stretches by more than noise, though not over all samples together"
            },
            number(train.before_v),
            number(train.noise_floor_v),
            places
                .first()
                .map_or(String::new(), |p| format!(" It lives here: {}.", p.says))
        ),
    }
}

/// The verdict of a plain model that leaves only noise, `left`, with a part that is beyond its tolerance.
pub(super) fn says_of_part(part: &Departed, left: &str) -> String {
    format!(
        "The plain model leaves what noise leaves, {left}, but only with a part farther off than tolerances make: {}. That part may be off, or stand in for something else; no cause is named.",
        part.says()
    )
}

/// What tells a part that is off from what it may stand in for.
pub(super) fn measure(part: &Departed) -> String {
    format!(
        "Measure the {}. Where it is as found, state it in rig.toml; where it is not, something else is off, and one actuator driven at a time shows where.",
        part.what
    )
}

/// Probability from which a cause is named as what is left out.
pub(super) const NAMED: f64 = 0.5;

/// Error over the noise's, from which on a report says that something else acts as well.
pub(super) const STRUCTURE_LEFT: f64 = 1.5;

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
    if x.abs() >= 1e6 {
        return format!("{x:.2e} {unit}");
    }
    format!("{x:.digits$} {unit}")
}
