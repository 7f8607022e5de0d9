//! Every parameter, how far to trust it, and which combinations stay open.

use minijinja::{Value, context};

use super::page::{Cell, Section, Table, safe};
use super::{Provenance, number, plot};
use crate::calibration::{AtBound, Estimate, Outcome};

const TEMPLATE: &str = include_str!("parameters.html");

/// The unit in which a value reads well, and the factor to it.
fn shown(e: &Estimate) -> (&'static str, f64) {
    match e.unit {
        "Pa" => ("kPa", 1e-3),
        "N m" => ("mN m", 1e3),
        "s" if e.value.abs() < 1.0 => ("ms", 1e3),
        "1" => ("", 1.0),
        unit => (unit, 1.0),
    }
}

fn trust(e: &Estimate) -> Cell {
    match (e.fixed, e.at_bound, e.identifiable) {
        (true, _, _) => Cell::of("badge held", "held"),
        (_, Some(AtBound::Lower), _) => Cell::of("badge bound", "at lower bound"),
        (_, Some(AtBound::Upper), _) => Cell::of("badge bound", "at upper bound"),
        (_, None, true) => Cell::of("badge good", "determined"),
        (_, None, false) => Cell::of("badge open", "not determined"),
    }
}

fn interval(e: &Estimate, factor: f64) -> String {
    let [low, high] = e.ci95.map(|v| v * factor);
    if e.fixed || e.at_bound.is_some() || !low.is_finite() || !high.is_finite() {
        return number::MISSING.into();
    }
    let error = e.std_error * factor;
    // Both ends to the digits of the error where they lie symmetric, else each to its own.
    let middle = (low + high) / 2.0 - e.value * factor;
    if middle.abs() < 0.2 * error {
        let ends = [low, high].map(|v| number::with_error(v, error).0);
        return format!("{} to {}", ends[0], ends[1]);
    }
    let ends = [low, high].map(|v| number::significant(v, 3));
    format!("{} to {}", ends[0], ends[1])
}

fn row(e: &Estimate) -> Vec<Cell> {
    let (unit, factor) = shown(e);
    let (value, error) = number::with_error(e.value * factor, e.std_error * factor);
    let error = match error {
        Some(error) => format!("\u{b1} {error}"),
        None if e.fixed => "held".into(),
        None => number::MISSING.into(),
    };
    vec![
        Cell::text(&e.name),
        Cell::text(&e.meaning),
        Cell::number(value),
        Cell::number(error),
        Cell::number(interval(e, factor)),
        Cell::of("nowrap", unit),
        trust(e),
        Cell::of("quiet", number::words(&e.says)),
    ]
}

/// See the module.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    if outcome.estimates.is_empty() {
        return None;
    }
    let head = vec![
        Cell::text("name"),
        Cell::text("meaning"),
        Cell::number("value"),
        Cell::number("standard error"),
        Cell::number("95 % interval"),
        Cell::text("unit"),
        Cell::text("trust"),
        Cell::text("why"),
    ];
    let mut table = Table::new(
        "Every parameter. Intervals are of 95 %; where a parameter was held or rests on a bound there is none.",
        head,
    );
    for e in &outcome.estimates {
        table.row(row(e));
    }
    let (names, rows) = &outcome.correlation;
    let figure = if names.len() > 1 {
        let drawing = plot::heat_map("Correlation of the estimates", names, rows);
        let key = plot::colour_key(&[
            ("rise together", plot::Role::One),
            ("one rises, the other falls", plot::Role::Two),
        ]);
        let caption = "Correlation of each pair of free parameters. A strong colour means that the recordings fix a combination of the two better than either alone.";
        plot::figure(
            &[format!("<div class=\"scroll\">{drawing}</div>")],
            &key,
            caption,
        )
    } else {
        String::new()
    };
    let weak: Vec<Value> = outcome
        .weak_directions
        .iter()
        .map(|w| Value::from(number::words(&w.says)))
        .collect();
    let eps_r = if outcome.eps_r.is_finite() {
        number::significant(outcome.eps_r, 3)
    } else {
        String::new()
    };
    let context = context! {
        table => table.html(),
        eps_r => eps_r,
        weak => weak,
        correlated => names.len() > 1,
        figure => safe(figure),
    };
    Some(Section::new("parameters", "Parameters", TEMPLATE, context))
}
