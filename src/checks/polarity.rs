//! Voltages below zero: a film feels their square, so signs change nothing; they are said.

use super::view::{Is, View, per_cent};
use super::{Findings, Grade};

/// Share of the largest voltage below zero from which on it is a polarity and not an offset of the log.
const OFFSET: f64 = 0.05;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    if found.wrong(&["sentinel"]) {
        return;
    }
    let mut negative = Vec::new();
    let mut share: f64 = 0.0;
    for s in view.signals.iter().filter(|s| s.is == Is::Voltage) {
        let Some([low, high]) = s.range() else {
            continue;
        };
        let limit = -OFFSET * high.abs().max(low.abs());
        if low < limit {
            let below = s.values.iter().filter(|v| **v < limit).count();
            share = share.max(below as f64 / s.values.len() as f64);
            negative.push(s.name.trim_start_matches("voltage ").to_owned());
        }
    }
    if !negative.is_empty() {
        found.add(
            "polarity",
            Grade::Doubtful,
            format!(
                "voltage {} is below zero in up to {} of the samples: the film feels the square, so the polarity changes nothing, and errors are those of the size",
                negative.join(", "),
                per_cent(share)
            ),
            "nothing needs to be done where the polarity was changed on purpose; else look at the sign of [voltage] scale",
        );
    }
}
