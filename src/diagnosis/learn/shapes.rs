//! What a group's columns do not hold linearly: frequencies, dampings, directions.

use rayon::prelude::*;

use super::columns::{Group, Known, known};
use super::evidence::{About, Products, SCALES};
use super::{Problem, Subject};
use crate::effects::learnt::Form;
use crate::kinematics::dot;

/// Groups like this one whose shape differs by a little more or less.
fn neighbours(group: &Group, by: f64) -> Vec<Group> {
    let like = |change: &dyn Fn(&Form) -> Form| Group {
        forms: group.forms.iter().map(change).collect(),
        ..group.clone()
    };
    match &group.forms[0] {
        Form::Oscillator { .. } => [(by, 0.0), (-by, 0.0), (0.0, 20.0 * by), (0.0, -20.0 * by)]
            .into_iter()
            .map(|(faster, damped)| like(&|form| faster_swing(form, faster, damped)))
            .collect(),
        Form::Wave { .. } => [0.1 * by, -0.1 * by]
            .into_iter()
            .map(|by| like(&|form| faster_wave(form, by)))
            .collect(),
        Form::Ridge { .. } => (0..3)
            .flat_map(|axis| [(axis, 5.0 * by), (axis, -5.0 * by)])
            .map(|(axis, by)| like(&|form| turned(form, axis, by)))
            .collect(),
        _ => Vec::new(),
    }
}

/// Frequencies (Hz) and dampings that a swing may be given.
const SWING_HZ: (f64, f64) = (0.2, 15.0);
const SWING_DAMPING: (f64, f64) = (0.004, 1.5);

fn faster_swing(form: &Form, faster: f64, damped: f64) -> Form {
    match form {
        Form::Oscillator {
            frequency_hz,
            damping,
        } => Form::Oscillator {
            frequency_hz: (frequency_hz * faster.exp()).clamp(SWING_HZ.0, SWING_HZ.1),
            damping: (damping * damped.exp()).clamp(SWING_DAMPING.0, SWING_DAMPING.1),
        },
        other => other.clone(),
    }
}

fn faster_wave(form: &Form, faster: f64) -> Form {
    match form {
        Form::Wave { frequency_hz, by } => Form::Wave {
            frequency_hz: frequency_hz * faster.exp(),
            by: *by,
        },
        other => other.clone(),
    }
}

fn turned(form: &Form, axis: usize, by: f64) -> Form {
    match form {
        Form::Ridge { along, knots } => {
            let mut along = *along;
            along[axis] += by;
            let length = dot(along, along).sqrt();
            Form::Ridge {
                along: along.map(|x| x / length),
                knots: knots.clone(),
            }
        }
        other => other.clone(),
    }
}

/// The best of each form whose shape can be refined, refined alone: what is a little off in frequency or
/// direction must not lose to what is merely flexible.
pub(super) fn sharpened<S: Subject>(
    problem: &Problem<S>,
    about: &About,
    list: &[Known],
) -> Vec<Known> {
    let products = Products::new(about, list);
    let kind = |k: &Known| std::mem::discriminant(&k.group.forms[0]);
    let mut best: Vec<(f64, (usize, f64))> = Vec::new();
    for (i, known) in list.iter().enumerate() {
        if neighbours(&known.group, REFINE.0).is_empty() {
            continue;
        }
        let scaled = SCALES.map(|s| (i, (s / products.unit(i)).sqrt()));
        let own = scaled.map(|m| (products.judge(&[m]).0, m));
        let own = own.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let own = own.expect("scales");
        match best.iter_mut().find(|b| kind(&list[b.1.0]) == kind(known)) {
            Some(b) if own.0 < b.0 => *b = own,
            Some(_) => {}
            None => best.push(own),
        }
    }
    let refine = |b: (f64, (usize, f64))| refined(problem, about, list, &[b.1]).0;
    best.into_iter().flat_map(refine).collect()
}

/// Chosen groups with shapes that do better, found by steps that halve; their scales.
pub(super) fn refined<S: Subject>(
    problem: &Problem<S>,
    about: &About,
    list: &[Known],
    members: &[(usize, f64)],
) -> (Vec<Known>, Vec<(usize, f64)>) {
    let mut own: Vec<Known> = members.iter().map(|m| list[m.0].clone()).collect();
    let scales: Vec<(usize, f64)> = members.iter().map(|m| m.1).enumerate().collect();
    let judge = |own: &[Known]| {
        let mut products = Products::new(about, own);
        (0..own.len()).for_each(|i| products.meet(i));
        products.judge(&scales).0
    };
    let mut score = judge(&own);
    for at in 0..own.len() {
        let mut by = REFINE.0;
        while by > REFINE.1 {
            let tried: Vec<(f64, Known)> = (neighbours(&own[at].group, by).into_par_iter())
                .filter_map(|group| {
                    let each = own[at].on.len() > 1;
                    let other = known(&problem.train, &group)
                        .into_iter()
                        .find(|k| (k.on.len() > 1) == each)?;
                    let mut with = own.clone();
                    with[at] = other.clone();
                    Some((judge(&with), other))
                })
                .collect();
            match tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
                Some((new, other)) if new < score => (score, own[at]) = (new, other),
                Some(_) => by *= 0.5,
                None => break,
            }
        }
    }
    (own, scales)
}

/// First and last step by which a shape is varied.
const REFINE: (f64, f64) = (0.04, 2e-3);
