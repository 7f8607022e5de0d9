//! Rows that are missing without a trace: a leap of time stamps that are otherwise even.

use super::view::View;
use super::{Findings, Grade};

/// Share of the steps that have to be alike, and how alike, for a log to be even.
const EVEN: f64 = 0.98;
const ALIKE: f64 = 0.25;
/// A step so many times as long as the others is a hole.
const HOLE: f64 = 5.0;
/// Share of the range by which the voltage usually changes within the hole, from which on a straight line
/// across it is not the drive.
const MATTERS: f64 = 0.02;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let r = view.recording;
    if let Some(v) = &r.voltage {
        for (at, length) in holes(&v.time_s) {
            // how much the drive changes in as long a time, elsewhere
            let rows = (length / median_step(&v.time_s)).round() as usize;
            let mut matters: f64 = 0.0;
            for c in &v.channels {
                let finite = || c.iter().copied().filter(|x| x.is_finite());
                let range = finite().fold(f64::NEG_INFINITY, f64::max)
                    - finite().fold(f64::INFINITY, f64::min);
                let changes = c
                    .windows(rows.max(1) + 1)
                    .map(|w| (w[rows.max(1)] - w[0]).abs());
                let usual = super::linear::quantile(changes, 0.75);
                if range > 0.0 && usual.is_finite() {
                    matters = matters.max(usual / range);
                }
            }
            let grade = if matters > MATTERS && !v.hold_previous {
                Grade::Wrong
            } else {
                Grade::Doubtful
            };
            found.add(
                "rows_lost",
                grade,
                format!(
                    "the voltage log leaps over {length:.3} s at {at:.3} s, where its samples lie {:.4} s apart: rows are lost, and the drive there is not known",
                    median_step(&v.time_s)
                ),
                "get the whole log; or cut the recording there and use the longer part",
            );
        }
    }
    let others: [(&str, Option<&Vec<f64>>); 4] = [
        ("the axis's table", r.axis.as_ref().map(|a| &a.time_s)),
        (
            "the input's table",
            r.axis.as_ref().and_then(|a| a.input_time_s.as_ref()),
        ),
        (
            "the bench's table",
            r.bench.as_ref().and_then(|b| b.time_s.as_ref()),
        ),
        ("the motion's table", r.motion.as_ref().map(|m| &m.time_s)),
    ];
    for (what, times) in others {
        for (at, length) in times.map(|t| holes(t)).unwrap_or_default() {
            found.add(
                "rows_lost",
                Grade::Doubtful,
                format!("{what} leaps over {length:.3} s at {at:.3} s: rows are lost; they are taken as a gap"),
                "get the whole file, if there is one",
            );
        }
    }
}

fn median_step(times: &[f64]) -> f64 {
    super::linear::quantile(times.windows(2).map(|w| w[1] - w[0]), 0.5)
}

/// Holes of an otherwise even log: when, and how long, s. None where the log is not even, and at most three.
fn holes(times: &[f64]) -> Vec<(f64, f64)> {
    let step = median_step(times);
    let steps = || times.windows(2).map(|w| w[1] - w[0]);
    let even = steps().filter(|d| (d - step).abs() < ALIKE * step).count();
    if times.len() < 50 || (even as f64) < EVEN * (times.len() - 1) as f64 {
        return Vec::new();
    }
    let mut out: Vec<(f64, f64)> = times
        .windows(2)
        .filter(|w| w[1] - w[0] > HOLE * step)
        .map(|w| (w[0], w[1] - w[0]))
        .collect();
    out.truncate(3);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_in_an_even_log_is_found() {
        let mut t: Vec<f64> = (0..200).map(|i| 0.01 * f64::from(i)).collect();
        assert!(holes(&t).is_empty());
        for t in &mut t[120..] {
            *t += 1.0;
        }
        let found = holes(&t);
        assert_eq!(found.len(), 1);
        assert!((found[0].1 - 1.01).abs() < 1e-9);
    }
}
