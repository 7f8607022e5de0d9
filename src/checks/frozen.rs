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
        let coarse = usual as f64 > REPEATS * (finite - zeros + usual) as f64;
        let filled =
            || noisy(&s.values, &steps) && (rough(&s.values) || leaps(&steps[from + rows..]));
        if !long || coarse || !filled() {
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

/// Whether neighbours differ by more than the last digit: without noise a signal at rest repeats itself.
fn noisy(values: &[f64], steps: &[f64]) -> bool {
    let sizes = steps.iter().map(|d| d.abs());
    let digit = sizes.filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    // rounding alone makes third differences of one or two digits
    wiggle(values, &[-1.0, 3.0, -3.0, 1.0]) > 1.5 * digit
}

/// Whether what neighbours differ by is noise, which differences of a higher order tell alike; of a smooth
/// motion, a set point that is held and moves on, they tell next to nothing.
fn rough(values: &[f64]) -> bool {
    wiggle(values, &[-1.0, 5.0, -10.0, 10.0, -5.0, 1.0])
        > 0.5 * wiggle(values, &[-1.0, 3.0, -3.0, 1.0])
}

/// Standard deviation of white noise that makes such differences: their median, where something moves.
fn wiggle(values: &[f64], weights: &[f64]) -> f64 {
    let of = |w: &[f64]| w.iter().zip(weights).map(|(x, k)| k * x).sum::<f64>().abs();
    let moving = values.windows(weights.len()).map(of).filter(|d| *d > 0.0);
    let length = weights.iter().map(|k| k * k).sum::<f64>().sqrt();
    quantile(moving, 0.5) / length
}

/// Whether a signal that stood leaps to where it would be had it moved on: its first step is more than so
/// many times the largest of the next ones, and it moves on with these.
fn leaps(after: &[f64]) -> bool {
    const TIMES: f64 = 3.0;
    match after {
        [first, next @ ..] if next.len() >= 4 => {
            let largest = next[..4].iter().fold(0.0, |m: f64, d| m.max(d.abs()));
            largest > 0.0 && first.abs() > TIMES * largest
        }
        _ => false,
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_point_that_is_held_is_smooth_and_does_not_leap() {
        let held: Vec<f64> = (0..500)
            .map(|i: i32| 0.02 * f64::from(i.min(100) + (i - 300).max(0)))
            .map(|t| (1e8 * (t + 0.1 * t.sin())).round() / 1e8)
            .collect();
        let steps: Vec<f64> = held.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(!rough(&held));
        assert!(!leaps(&steps[300..]));
    }

    #[test]
    fn a_gap_that_was_filled_ends_in_a_leap() {
        let mut moved: Vec<f64> = (0..400).map(|i| (0.05 * f64::from(i)).sin()).collect();
        let held = moved[99];
        moved[100..140].fill(held);
        let steps: Vec<f64> = moved.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(leaps(&steps[139..]));
        assert!(!leaps(&steps[90..]));
    }
}
