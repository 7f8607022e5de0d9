//! The next drive: what would bring out, or tell apart, the effects that a diagnosis leaves open. Made of
//! exercises, each of which brings out one kind of effect; every one begins and ends at 0 V.

use super::{Diagnosis, Verdict};
use crate::effects::{Effect, Exercise, by_id};

/// Distance of the samples, s.
pub const STEP_S: f64 = 0.01;
/// Share of the highest voltage that was recorded to which a drive goes.
const SHARE: f64 = 0.97;
/// Length of a ramp between levels, s.
const RAMP_S: f64 = 0.4;

fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Voltages that move from level to level, each held for `hold_s`, ramps included; they begin at 0 V.
fn levels(out: &mut Vec<[f64; 3]>, list: &[[f64; 3]], hold_s: f64) {
    let mut from = [0.0; 3];
    let count = (hold_s / STEP_S).round() as usize;
    for to in list {
        for i in 0..count {
            let f = smooth(i as f64 * STEP_S / RAMP_S);
            out.push([0, 1, 2].map(|k| from[k] + f * (to[k] - from[k])));
        }
        from = *to;
    }
}

fn append(block: Exercise, peak_v: f64, out: &mut Vec<[f64; 3]>) {
    let turn = std::f64::consts::TAU;
    match block {
        Exercise::Rates => {
            for (rate_hz, cycles, share) in [(0.2, 2.0, 1.0), (0.7, 5.0, 1.0), (2.2, 12.0, 0.85)] {
                let count = (cycles / rate_hz / STEP_S).round() as usize;
                for i in 0..count {
                    let phase = turn * rate_hz * i as f64 * STEP_S;
                    out.push([0.5 * share * peak_v * (1.0 - phase.cos()); 3]);
                }
                out.push([0.0; 3]);
            }
        }
        Exercise::Staircase => {
            for sign in [1.0, -1.0] {
                let steps: Vec<[f64; 3]> = [0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0]
                    .map(|s| [sign * s * peak_v; 3])
                    .to_vec();
                levels(out, &steps, 1.6);
            }
        }
        Exercise::Corners => {
            let corner = |high: [bool; 3]| high.map(|h| peak_v * if h { 0.88 } else { 0.4 });
            let mut list: Vec<[f64; 3]> = Vec::new();
            for k in 0..3 {
                list.push(corner([0, 1, 2].map(|j| j == k)));
                list.push(corner([0, 1, 2].map(|j| j != k)));
            }
            list.push([0.9 * peak_v; 3]);
            list.push([0.0; 3]);
            levels(out, &list, 2.6);
        }
        Exercise::Reversals => {
            let mut list: Vec<[f64; 3]> = Vec::new();
            for s in [
                0.3, 0.6, 0.45, 0.75, 0.6, 1.0, 0.7, 0.85, 0.5, 0.65, 0.3, 0.0,
            ] {
                list.push([s * peak_v; 3]);
            }
            levels(out, &list, 1.8);
        }
        Exercise::Again => {
            let list = [1.0, 0.0, 0.7, 0.0, 0.7, 0.0, 0.0, 0.0, 1.0, 0.0].map(|s| [s * peak_v; 3]);
            levels(out, &list, 2.5);
        }
    }
}

/// The voltages to record next, [`STEP_S`] apart, V: what would tell the first group that the recordings
/// cannot tell apart, else what would confirm the first candidate, else everything that could hide.
pub fn next_drive(d: &Diagnosis) -> Vec<[f64; 3]> {
    let highest = d
        .traces
        .iter()
        .flat_map(|t| t.command_v.iter().flatten())
        .fold(0.0_f64, |a, v| a.max(v.abs()));
    let effects: Vec<&dyn Effect> = match (d.verdict, d.groups.first()) {
        (Verdict::MissingPhysics, Some(g)) => g.iter().take(3).filter_map(|id| by_id(id)).collect(),
        (Verdict::MissingPhysics, None) => d
            .candidates
            .iter()
            .take(2)
            .map(|c| c.acting.effect)
            .collect(),
        _ => Vec::new(),
    };
    let mut wanted: Vec<Exercise> = Vec::new();
    for block in effects.iter().flat_map(|e| e.exercises()) {
        if !wanted.contains(block) {
            wanted.push(*block);
        }
    }
    if wanted.is_empty() {
        use Exercise::*;
        wanted = vec![Rates, Staircase, Corners, Reversals, Again];
    }
    let rest = vec![[0.0; 3]; (0.5 / STEP_S) as usize];
    let mut out = rest.clone();
    for block in wanted {
        append(block, SHARE * highest, &mut out);
        out.extend(&rest);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_block_begins_and_ends_at_rest_and_stays_below_its_peak() {
        use Exercise::*;
        for block in [Rates, Staircase, Corners, Reversals, Again] {
            let mut out = Vec::new();
            append(block, 5000.0, &mut out);
            assert!(out.iter().flatten().all(|v| v.abs() <= 5000.0 + 1e-9));
            assert_eq!(out[0], [0.0; 3], "{block:?}");
            assert!(
                out[out.len() - 1].iter().all(|v| v.abs() < 30.0),
                "{block:?}"
            );
        }
    }
}
