//! Cases in which an effect acts in the very form that the catalogue gives it: what tells whether intervals
//! hold what they promise.

use serde_json::Value;

use crate::cases::{Case, Detail, Planted, Spec, generate_as};
use crate::effects::{Acting, When, by_id};
use crate::simulate::{Motion, Options, motion_with_effects};

/// Makes a case whose effects have the catalogue's own form, at the equivalent values of the case's own.
///
/// # Errors
/// As [`crate::cases::generate`].
pub fn own_form(spec: &Spec) -> Result<Case, String> {
    generate_as(spec, &simulate)
}

fn simulate(planted: &Planted, options: &Options) -> Result<Motion, String> {
    let recording = |word: &str| {
        let last = |name: &str| name.rsplit('/').next().map(str::to_owned);
        planted.names.iter().position(|n| last(n) == last(word))
    };
    let effects: Option<Vec<Acting>> = planted
        .details
        .iter()
        .map(|d| acting(&d.effect, d, &recording))
        .collect();
    let when = When {
        recording: planted.number,
        series_s: planted.series_s,
        start_s: options.start_s,
    };
    let (motion, ended) = motion_with_effects(
        planted.robot,
        planted.parameters,
        planted.drive,
        options,
        &effects.ok_or("the catalogue has no form of its own for this effect")?,
        when,
        planted.pivot_m,
    )
    .map_err(|e| e.to_string())?;
    match ended {
        Some(error) => Err(error.to_string()),
        None => Ok(motion),
    }
}

/// The effect `id` of an answer as the catalogue has it, at the equivalent values; `None` for what is in no
/// catalogue. `recording` says the number of a recording by its name.
pub(super) fn acting(
    id: &str,
    detail: &Detail,
    recording: &dyn Fn(&str) -> Option<usize>,
) -> Option<Acting> {
    let effect = by_id(id)?;
    let on = [1, 2, 3].map(|k| detail.actuators.contains(&k));
    let mut out = Acting::off(effect, on);
    for (i, q) in effect.parameters().iter().enumerate() {
        let (name, part) = q.part();
        let Some(value) = detail.parameters.get(name) else {
            continue;
        };
        let number = match (value, part) {
            (Value::Number(v), None) => v.as_f64(),
            (Value::Array(list), Some(p)) => list.get(p).and_then(Value::as_f64),
            (Value::String(word), None) => {
                let form = effect.variants().iter().position(|w| w == word);
                form.or_else(|| recording(word)).map(|n| n as f64)
            }
            _ => None,
        };
        if let Some(number) = number {
            out.values[i] = number.clamp(q.lower, q.upper);
        }
    }
    Some(out)
}
