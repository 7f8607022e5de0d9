//! The data before the fit: gaps, noise, smoothing, clock.

use minijinja::{Value, context};

use super::page::{Cell, Section, Table};
use super::{Provenance, number};
use crate::calibration::{Outcome, RecordingOutcome};

const TEMPLATE: &str = include_str!("quality.html");
/// Gaps and unreachable frames that are listed one by one.
const LISTED: usize = 6;

/// See the module.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    if outcome.recordings.is_empty() {
        return None;
    }
    let items: Vec<Value> = outcome.recordings.iter().map(item).collect();
    let context = context! { recordings => items };
    Some(Section::new(
        "quality",
        "Quality of the data",
        TEMPLATE,
        context,
    ))
}

fn item(r: &RecordingOutcome) -> Value {
    let head = vec![
        Cell::text("axis"),
        Cell::number("capture noise, mm rms"),
        Cell::number("order"),
        Cell::number("cutoff, Hz"),
    ];
    let caption = if r.plan.criterion.is_empty() {
        "Smoothing".to_string()
    } else {
        format!("Smoothing, chosen by: {}.", r.plan.criterion)
    };
    let mut table = Table::new(&caption, head);
    for (k, s) in r.plan.smoothing.iter().enumerate() {
        table.row(vec![
            Cell::text(match (["x", "y", "z"].get(k), s.follows) {
                (Some(axis), true) => format!("{axis}, beside the axis that moves most"),
                (axis, _) => (*axis.unwrap_or(&"further")).to_string(),
            }),
            Cell::number(number::significant(s.noise_mm, 2)),
            Cell::number(s.order.to_string()),
            Cell::number(number::significant(s.cutoff_hz, 3)),
        ]);
    }
    let frames = r.time_s.len();
    let time = |frame: usize| r.time_s.get(frame).copied().unwrap_or(f64::NAN);
    let mut facts = vec![match (r.time_s.first(), r.time_s.last()) {
        (Some(first), Some(last)) => format!(
            "{} frames from {} to {} s; {} count in the errors.",
            number::count(frames),
            number::fixed(*first, 2),
            number::fixed(*last, 2),
            number::count(r.counts.iter().filter(|c| **c).count())
        ),
        _ => "No frames.".to_string(),
    }];
    facts.push(if r.gaps.is_empty() {
        "No gap in the capture.".into()
    } else {
        let missing: usize = r.gaps.iter().map(|g| g.1).sum();
        let gap =
            |g: &(usize, usize)| format!("{} at {} s", frames_of(g.1), number::fixed(time(g.0), 2));
        format!(
            "{} in the capture, {} without position: {}.",
            plural(r.gaps.len(), "gap"),
            frames_of(missing),
            listed(r.gaps.len(), r.gaps.iter().map(gap))
        )
    });
    facts.push(match r.offset_std_error_s {
        Some(error) => {
            let (value, error) = number::with_error(r.offset_s * 1e3, error * 1e3);
            let error = error.map_or(String::new(), |e| format!(" \u{b1} {e}"));
            format!("Clock offset (voltage minus motion clock), estimated: {value}{error} ms.")
        }
        None => format!(
            "Clock offset (voltage minus motion clock), as stated: {} ms.",
            number::significant(r.offset_s * 1e3, 4)
        ),
    });
    if !r.unreachable.is_empty() {
        let frame = |(at, why): &(usize, String)| {
            format!("{} s ({})", number::fixed(time(*at), 2), number::words(why))
        };
        facts.push(format!(
            "{} cannot be reached by the mechanism: {}.",
            frames_of(r.unreachable.len()),
            listed(r.unreachable.len(), r.unreachable.iter().map(frame))
        ));
    }
    facts.extend(r.notes.iter().map(|n| number::words(n)));
    context! { id => r.id.clone(), facts => facts, table => table.html() }
}

/// `1 gap`, `2 gaps`.
pub fn plural(n: usize, thing: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{} {thing}{s}", number::count(n))
}

fn frames_of(n: usize) -> String {
    plural(n, "frame")
}

fn listed(number: usize, items: impl Iterator<Item = String>) -> String {
    let mut out = items.take(LISTED).collect::<Vec<_>>().join(", ");
    if number > LISTED {
        out += &format!(" and {} more", number - LISTED);
    }
    out
}
