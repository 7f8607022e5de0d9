//! Frames in which a marker sticks out of its own path: a reflection taken for it, or another marker, for one
//! frame or a few. One of them counts for more than a thousand others in the size of the noise.
//!
//! A frame is held against the cubic through the nearest frames on both sides. Of those farther away the two
//! that fit worst are left out, for they may stick out themselves. A path that bends, stops or leaps in truth
//! is off that cubic beside the frame too: the distance counts over what is left there, and over the noise.

use nalgebra::{Matrix4, Vector4};

use super::noise::{MEDIAN, digit};
use crate::kinematics::Vec3;

/// Frames in a row that stick out, at most.
const LONGEST: usize = 3;
/// Frames on each side that a path is told from, at least and at most, and how far away they may be.
const FEWEST: usize = 4;
const BESIDE: usize = 6;
const REACH: usize = 30;
/// Of those that are not among the nearest of a side, so many may be left out.
const NEAREST: usize = 2;
const DROPPED: usize = 2;
/// Distance over what the path leaves beside it from which a frame sticks out: noise never gets there, and
/// corners and leaps of a path stay below 5.
const STICKS_OUT: f64 = 10.0;
/// Frames from which the size of the noise is told.
const FRAMES: usize = 4000;
/// Distance from its neighbours, over the noise, below which no run that sticks out can be: a run of two or
/// three of its size has a third of it somewhere.
const LOOKED_AT: f64 = STICKS_OUT / 3.5;

/// Numbers of the frames that stick out, NaN where nothing was captured.
pub(super) fn spikes(path: &[Vec3]) -> Vec<usize> {
    let noise = [0, 1, 2].map(|axis| noise(path, axis));
    let mut out: Vec<usize> = Vec::new();
    for axis in 0..3 {
        for at in (0..path.len()).filter(|&i| !path[i][axis].is_nan()) {
            if !stands_off(path, axis, at, LOOKED_AT * noise[axis]) {
                continue;
            }
            for length in 1..=LONGEST.min(path.len() - at) {
                let run = at..at + length;
                let Some(way) = Way::beside(path, axis, run.clone()) else {
                    continue;
                };
                let least = STICKS_OUT * way.leaves.max(noise[axis]);
                out.extend(run.filter(|&i| (path[i][axis] - way.at(i)).abs() > least));
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Standard deviation with which a path foretells a frame: that of the frames' middle, and no less than the
/// digit in which positions are written.
fn noise(path: &[Vec3], axis: usize) -> f64 {
    let every = path.len().div_ceil(FRAMES).max(1);
    let off = |i: usize| Some((path[i][axis] - Way::beside(path, axis, i..i + 1)?.at(i)).abs());
    let mut off: Vec<f64> = (0..path.len())
        .step_by(every)
        .filter_map(off)
        .filter(|e| !e.is_nan())
        .collect();
    off.sort_by(f64::total_cmp);
    let middle = off.get(off.len() / 2).copied().unwrap_or(f64::INFINITY);
    (middle / MEDIAN).max(digit(path.iter().map(|p| p[axis])))
}

/// Whether a frame is farther than this from where its four neighbours put it, or lacks one of them.
fn stands_off(path: &[Vec3], axis: usize, at: usize, least: f64) -> bool {
    let near = |by: isize| {
        let i = at.checked_add_signed(by)?;
        Some(path.get(i)?[axis]).filter(|x| !x.is_nan())
    };
    match [-2, -1, 1, 2].map(near) {
        [Some(a), Some(b), Some(c), Some(d)] => {
            let from_both = (4.0 * (b + c) - (a + d)) / 6.0;
            (path[at][axis] - from_both).abs() > least
        }
        _ => true,
    }
}

/// The path past some frames.
struct Way {
    from: usize,
    cubic: Vector4<f64>,
    /// What it leaves of the frames that it was told from: root mean square.
    leaves: f64,
}

impl Way {
    /// The path of an axis past a run of frames, where there are enough beside it.
    fn beside(path: &[Vec3], axis: usize, run: std::ops::Range<usize>) -> Option<Way> {
        let from = run.start;
        let seen = |i: &usize| !path[*i][axis].is_nan();
        let before = (from.saturating_sub(REACH)..from).rev().filter(seen);
        let after = (run.end..(run.end + REACH).min(path.len())).filter(seen);
        let [before, after]: [Vec<usize>; 2] =
            [before.take(BESIDE).collect(), after.take(BESIDE).collect()];
        if before.len() < FEWEST || after.len() < FEWEST {
            return None;
        }
        let (near_b, far_b) = before.split_at(NEAREST);
        let (near_a, far_a) = after.split_at(NEAREST);
        let near = near_b.len() + near_a.len();
        let mut told: Vec<usize> = [near_b, near_a, far_b, far_a].concat();
        let mut way = Way {
            from,
            cubic: Vector4::zeros(),
            leaves: 0.0,
        };
        for dropped in 0..=DROPPED {
            let (mut gram, mut product) = (Matrix4::zeros(), Vector4::zeros());
            for &i in &told {
                let powers = way.powers(i);
                gram += powers * powers.transpose();
                product += powers * path[i][axis];
            }
            way.cubic = gram.cholesky()?.solve(&product);
            if dropped < DROPPED {
                let off = |i: usize| (path[i][axis] - way.at(i)).abs();
                let worst =
                    (near..told.len()).max_by(|&a, &b| off(told[a]).total_cmp(&off(told[b])));
                told.swap_remove(worst?);
            }
        }
        let squares = told.iter().map(|&i| (path[i][axis] - way.at(i)).powi(2));
        way.leaves = (squares.sum::<f64>() / (told.len() - 3) as f64).sqrt();
        Some(way)
    }

    fn powers(&self, frame: usize) -> Vector4<f64> {
        let t = (frame as f64 - self.from as f64) / BESIDE as f64;
        Vector4::new(1.0, t, t * t, t * t * t)
    }

    fn at(&self, frame: usize) -> f64 {
        self.cubic.dot(&self.powers(frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// A path with steps, swings, a kick at frame 900, a stop at 1200 and a leap at 1500, seen through noise.
    fn path(noise: f64, seed: u64) -> Vec<Vec3> {
        let mut g = rand_chacha::ChaCha12Rng::seed_from_u64(seed);
        (0..2000)
            .map(|i| {
                let t = i as f64 * 0.01;
                let kick = 2.0 * (t - 9.0).max(0.0).powi(2) * (9.5 - t).max(0.0);
                let stop = 0.1 * (12.0 - t).clamp(0.0, 0.1);
                let leap = if i >= 1500 { 4e-3 } else { 0.0 };
                let swing = 8e-3 * (2.0 * std::f64::consts::PI * 1.3 * t).sin();
                [swing + leap, kick + stop, 0.01 * t.cos() + stop].map(|x| {
                    let z: f64 = StandardNormal.sample(&mut g);
                    x + noise * z
                })
            })
            .collect()
    }

    #[test]
    fn a_path_that_bends_stops_and_leaps_sticks_out_nowhere() {
        for (noise, seed) in [(3e-5, 1), (1e-5, 2), (1e-4, 3), (1e-6, 4)] {
            assert_eq!(spikes(&path(noise, seed)), Vec::<usize>::new(), "{noise}");
        }
        let rounded = path(3e-6, 5);
        let rounded: Vec<Vec3> = (rounded.iter())
            .map(|p| p.map(|x| (x * 1e4).round() * 1e-4))
            .collect();
        assert_eq!(spikes(&rounded), Vec::<usize>::new());
    }

    #[test]
    fn frames_that_stick_out_are_found_and_no_others() {
        let mut seen = path(3e-5, 6);
        let mut planted = vec![40, 41, 300, 305, 700, 701, 702, 1100, 1801];
        for (n, &i) in planted.iter().enumerate() {
            let sign = if n < 5 { 1.0 } else { -1.0 };
            seen[i][n % 3] += sign * (6e-4 + 2e-4 * n as f64);
        }
        for i in [296, 297, 1103, 1104, 1105] {
            seen[i] = [f64::NAN; 3];
        }
        planted.sort_unstable();
        assert_eq!(spikes(&seen), planted);
    }
}
