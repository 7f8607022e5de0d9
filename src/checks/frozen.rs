//! A signal that repeats one value while it is otherwise noisy: a gap that was filled with the last value.

use super::linear::quantile;
use super::view::{Is, View, short};
use super::{Findings, Grade};

/// Shortest run that is told, s (or rows, where there is no time).
const LEAST_S: f64 = 0.25;
const LEAST_ROWS: usize = 12;
/// Elsewhere at most this share of the steps is 0: the signal does not repeat itself by coarse digits or by
/// rest.
const REPEATS: f64 = 0.02;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let mut told: Vec<String> = Vec::new();
    for s in view
        .signals
        .iter()
        .filter(|s| matches!(s.is, Is::Marker | Is::Coordinate))
    {
        let steps = s.steps();
        let mut longest = (0, 0);
        let (mut run, mut zeros) = (0, 0);
        for (i, d) in steps.iter().enumerate() {
            if *d == 0.0 {
                run += 1;
                zeros += 1;
                if run > longest.1 {
                    longest = (i + 1 - run, run);
                }
            } else {
                run = 0;
            }
        }
        let (from, rows) = longest;
        let long = match s.time_s.get(from + rows).zip(s.time_s.get(from)) {
            Some((b, a)) => b - a >= LEAST_S && rows >= LEAST_ROWS,
            None => rows >= 4 * LEAST_ROWS,
        };
        // Runs as long as a tenth of the longest are of the same making.
        let usual = zeros_in_short_runs(&steps, rows / 10);
        let finite = steps.iter().filter(|d| d.is_finite()).count();
        if !long || usual as f64 > REPEATS * (finite - zeros + usual) as f64 || !noisy(&s.values) {
            continue;
        }
        let what = s.name.rsplit(" of ").next().unwrap_or(&s.name).to_owned();
        if told.contains(&what) {
            continue;
        }
        found.add(
            "frozen",
            Grade::Wrong,
            format!(
                "{what} stands at one value ({} {}) for {} rows from {} on, and never repeats itself otherwise: a gap was filled with the last value",
                short(s.values[from]),
                s.unit,
                rows + 1,
                s.at(from).trim_start_matches("at ")
            ),
            "leave these cells empty, so that they are a gap",
        );
        told.push(what);
    }
}

/// Whether neighbours differ by noise, not by the last digit: without noise a signal at rest repeats itself.
fn noisy(values: &[f64]) -> bool {
    let steps = values.windows(2).map(|w| (w[1] - w[0]).abs());
    let digit = steps.filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let third = values
        .windows(4)
        .map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs());
    let moving = third.filter(|d| *d > 0.0);
    // rounding alone makes third differences of one or two digits
    quantile(moving, 0.5) / 20f64.sqrt() > 1.5 * digit
}

/// Zero steps in runs of up to `most`.
fn zeros_in_short_runs(steps: &[f64], most: usize) -> usize {
    let mut sum = 0;
    for run in steps.chunk_by(|a, b| (*a == 0.0) == (*b == 0.0)) {
        if run[0] == 0.0 && run.len() <= most.max(2) {
            sum += run.len();
        }
    }
    sum
}
