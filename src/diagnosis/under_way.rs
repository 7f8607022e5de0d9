//! Causes with a memory that were under way when a recording began: a film that had been stretched before, a
//! drift that had begun. What the memory held then is fitted, of recordings that were held out to the first
//! half of each; what is told of those is told of the second.

use super::outcome::Error;
use super::problem::{Effort, Fitted, Problem, first_halves};
use super::subject::Subject;
use super::words::in_unit;
use crate::effects::line::UnderWay;
use crate::effects::{Acting, When, plain_name};
use crate::residual::line::LineResidual;

/// Steps in which the range of what a memory may have held is searched, for recordings that were held out.
const STEPS: i32 = 20;

/// A fitted model with what its memories held where recordings begin; `None` where none of its causes
/// remembers.
pub(super) fn fit(
    problem: &Problem<LineResidual>,
    fitted: &Fitted,
    effort: Effort,
) -> Option<Fitted> {
    let numbers: Vec<usize> = problem.train_when.iter().map(|w| w.recording).collect();
    let with = |a: &Acting| {
        let off = UnderWay::held(a)?.off;
        UnderWay::beside(a, &numbers, &vec![off; numbers.len()])
    };
    let found: Vec<Option<Acting>> = fitted.effects.iter().map(with).collect();
    found.iter().flatten().next()?;
    let effects: Vec<Acting> = (found.into_iter().zip(&fitted.effects))
        .map(|(with, alone)| with.unwrap_or_else(|| alone.clone()))
        .collect();
    Some(problem.fit_near(fitted, &effects, effort))
}

/// The recordings that were held out whole: a part of one that is fitted has its history.
fn new_ones<'a>(problem: &'a Problem<LineResidual>) -> impl Iterator<Item = &'a When> {
    let fitted = |w: &When| (problem.train_when.iter()).any(|t| t.recording == w.recording);
    problem.holdout_when.iter().filter(move |w| !fitted(w))
}

/// A fitted model with what its memories held where recordings begin that were held out, by the first half of
/// each.
///
/// # Errors
/// [`Error`] where the model makes no number of them.
pub(super) fn of_held_out(
    problem: &Problem<LineResidual>,
    mut fitted: Fitted,
) -> Result<Fitted, Error> {
    let (Some(holdout), Some(eta)) = (&problem.holdout, problem.holdout_eta(&fitted)) else {
        return Ok(fitted);
    };
    let when = &problem.holdout_when;
    let numbers: Vec<usize> = new_ones(problem).map(|w| w.recording).collect();
    if numbers.is_empty() {
        return Ok(fitted);
    }
    let noise = (fitted.cost() / fitted.state.rows as f64).max(1.0);
    for e in 0..fitted.effects.len() {
        let Some(q) = UnderWay::held(&fitted.effects[e]) else {
            continue;
        };
        let (alone, known) = UnderWay::apart(&fitted.effects[e]);
        let new = numbers.iter().map(|number| (*number, q.off));
        let (all, values): (Vec<_>, Vec<_>) = known.iter().copied().chain(new).unzip();
        let Some(mut begun) = UnderWay::beside(&alone, &all, &values) else {
            continue;
        };
        let first = begun.values.len() - numbers.len();
        // sum of squares of the first half of each recording, and what is known beforehand
        let squares = |held: f64| -> Result<Vec<f64>, Error> {
            let mut effects = fitted.effects.clone();
            effects[e].clone_from(&begun);
            effects[e].values[first..].fill(held);
            let residual = holdout.with_effects(effects, Vec::new(), when);
            let halves = first_halves(&residual, when.len(), &eta, &fitted.state.beta)?;
            let known = ((held - q.off) / q.spread).powi(2);
            let new = when.iter().zip(halves);
            let new = new.filter(|(w, _)| numbers.contains(&w.recording));
            Ok(new.map(|(_, half)| half / noise + known).collect())
        };
        let at = |i: i32| q.lower + (q.upper - q.lower) * f64::from(i) / f64::from(STEPS);
        let tried = (0..=STEPS).map(|i| Ok((at(i), squares(at(i))?)));
        let tried: Vec<(f64, Vec<f64>)> = tried.collect::<Result<_, Error>>()?;
        let afresh = squares(q.off)?;
        // one number more has to pay for itself (Schwarz 1978)
        let pays = (holdout.rows() as f64).ln();
        for (number, afresh) in afresh.iter().enumerate() {
            let least = (tried.iter()).min_by(|a, b| a.1[number].total_cmp(&b.1[number]));
            if let Some((held, _)) = least.filter(|t| t.1[number] + pays < *afresh) {
                begun.values[first + number] = *held;
            }
        }
        if begun.values[first..].iter().any(|held| *held != q.off) {
            fitted.effects[e] = begun;
        }
    }
    Ok(fitted)
}

/// What memories held where recordings begin, in words; `None` where nothing was held.
pub(super) fn remark(problem: &Problem<LineResidual>, fitted: &Fitted) -> Option<String> {
    let held = problem.holdout.iter().flat_map(|h| h.whereabouts());
    let ids: Vec<String> = (problem.train.whereabouts().into_iter().chain(held))
        .map(|w| w.id)
        .collect();
    let when: Vec<&When> = problem
        .train_when
        .iter()
        .chain(&problem.holdout_when)
        .collect();
    let mut out = Vec::new();
    for acting in &fitted.effects {
        let (Some(q), (_, held)) = (UnderWay::held(acting), UnderWay::apart(acting)) else {
            continue;
        };
        let (factor, unit) = problem.train.unit_of(q.unit);
        let unit = if unit == "1" { "" } else { &unit };
        let each =
            held.iter()
                .filter(|(_, value)| *value != q.off)
                .filter_map(|(number, value)| {
                    let at = when.iter().position(|w| w.recording == *number)?;
                    Some(format!(
                        "{} {}",
                        ids[at],
                        in_unit(factor * value, unit).trim_end()
                    ))
                });
        let each: Vec<String> = each.collect();
        if !each.is_empty() {
            out.push(format!(
                "{} was under way when recordings began; {}: {}.",
                plain_name(acting.effect.id()),
                q.name.replace('_', " "),
                each.join(", ")
            ));
        }
    }
    if !out.is_empty() && new_ones(problem).next().is_some() {
        out.push(
            "Of recordings that were held out their first half says it, and errors are told of the second."
                .into(),
        );
    }
    (!out.is_empty()).then(|| out.join(" "))
}
