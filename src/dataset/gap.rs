//! Gaps of a robot's capture that are too long for the smoother: what the voltages made of the motion
//! elsewhere is taken for the motion inside, and what that leaves open is drawn like the rest of the
//! capture's uncertainty.
//!
//! Left to itself the smoother runs out of a gap of seconds on polynomials, and the film's history with it.
//! Instead position is regressed, over the frames that were captured, on the squared voltages now, slowed by
//! 0.3, 3 and 30 s, and in products:
//!
//! ```text
//! u = w_0 + sum_k (w_k s_k + sum_T w_kT s_kT) + sum_kl w_kl s_k s_l,   s_k = phi_k^2,  s_kT' = (s_k - s_kT)/T
//! ```
//!
//! Inside the gap the path is that of the regression, shifted by a straight line in time so that it meets
//! what was captured on both sides. A draw adds a stretch of the regression's own error, from a place of the
//! recording chosen at random and pinned to 0 at the captured sides. Voltages that do not change tell
//! nothing: the path is then the straight line, and its error that of a hold.

use nalgebra::{DMatrix, DVector};
use rand::{Rng, RngExt};

use super::stretches::Stretch;
use super::{Track, Voltage};
use crate::kinematics::Vec3;

/// Times by which squared voltages are slowed, s: the film's, from the fast ones on.
const SLOWED_S: [f64; 3] = [0.3, 3.0, 30.0];
/// Features of the regression: 1, three squares, each slowed, and their products.
const FEATURES: usize = 1 + 3 + 3 * SLOWED_S.len() + 6;
/// Captured frames a feature below which only the mean is taken.
const FRAMES_A_FEATURE: usize = 10;
/// Ridge of the regression, of the features' own squares: directions in which the voltages hardly differ are
/// left alone.
const RIDGE: f64 = 1e-6;

/// Long gaps and what their motion was like.
#[derive(Debug, Clone)]
pub(super) struct Bridges {
    /// First frame and length.
    gaps: Vec<(usize, usize)>,
    /// The captured frames.
    seen: Vec<usize>,
    /// Smoothed minus regressed position at each captured frame, m.
    error_m: Vec<Vec3>,
}

/// Features of a frame.
fn features(voltage: &Voltage, start_s: f64, step_s: f64, frames: usize) -> Vec<[f64; FEATURES]> {
    let largest = (voltage.channels_v().iter().flatten()).fold(1.0_f64, |m, v| m.max(v.abs()));
    let mut slowed = [[f64::NAN; 3]; SLOWED_S.len()];
    (0..frames)
        .map(|i| {
            let t = start_s + step_s * i as f64;
            let s = [0, 1, 2].map(|k| (voltage.at(k, t) / largest).powi(2));
            let mut out = [0.0; FEATURES];
            out[0] = 1.0;
            out[1..4].copy_from_slice(&s);
            let mut at = 4;
            for (slow, time_s) in slowed.iter_mut().zip(SLOWED_S) {
                let keep = (-step_s / time_s).exp();
                for k in 0..3 {
                    // at rest under the first voltage
                    slow[k] = if i == 0 {
                        s[k]
                    } else {
                        keep * slow[k] + (1.0 - keep) * s[k]
                    };
                    out[at] = slow[k];
                    at += 1;
                }
            }
            for a in 0..3 {
                for b in a..3 {
                    out[at] = s[a] * s[b];
                    at += 1;
                }
            }
            out
        })
        .collect()
}

/// What the features make of a position: its mean where too few frames tell more.
fn regression(rows: &[[f64; FEATURES]], seen: &[usize], position: &[Vec3]) -> Vec<Vec3> {
    let used = if seen.len() < FRAMES_A_FEATURE * FEATURES {
        1
    } else {
        FEATURES
    };
    let mut gram = DMatrix::<f64>::zeros(used, used);
    let mut right = DMatrix::<f64>::zeros(used, 3);
    for &i in seen {
        let row = DVector::from_column_slice(&rows[i][..used]);
        gram.ger(1.0, &row, &row, 1.0);
        right.ger(1.0, &row, &DVector::from_column_slice(&position[i]), 1.0);
    }
    for j in 1..used {
        gram[(j, j)] += RIDGE * seen.len() as f64;
    }
    let weights = gram
        .cholesky()
        .map_or_else(|| DMatrix::zeros(used, 3), |c| c.solve(&right));
    rows.iter()
        .map(|row| [0, 1, 2].map(|k| (0..used).map(|j| row[j] * weights[(j, k)]).sum::<f64>()))
        .collect()
}

/// The value at frame i of the straight line through what is known on the two sides of a gap; the known one
/// where there is one.
fn between(sides: [Option<Vec3>; 2], i: usize, (start, length): (usize, usize)) -> Vec3 {
    let f = (i + 1 - start) as f64 / (length + 1) as f64;
    match sides {
        [Some(a), Some(b)] => [0, 1, 2].map(|k| a[k] + f * (b[k] - a[k])),
        [Some(a), None] | [None, Some(a)] => a,
        [None, None] => [0.0; 3],
    }
}

/// Velocities inside a gap from the path, up to the sides.
fn differentiate(track: &mut Track, (start, length): (usize, usize)) {
    let last = track.position_m.len() - 1;
    for i in start..start + length {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
        let span_s = track.step_s * (b - a) as f64;
        track.velocity_m_s[i] =
            [0, 1, 2].map(|k| (track.position_m[b][k] - track.position_m[a][k]) / span_s);
        track.acceleration_m_s2[i] = [0.0; 3];
    }
}

impl Bridges {
    /// What of the gaps lies within some stretches, with the errors there.
    pub(super) fn stretches(&self, stretches: &[Stretch]) -> Option<Self> {
        let mut gaps = Vec::new();
        for s in stretches {
            for &(start, length) in &self.gaps {
                let (a, b) = (start.max(s.first), (start + length).min(s.first + s.length));
                if a < b {
                    gaps.push((s.at + a - s.first, b - a));
                }
            }
        }
        let error_m = (self.seen.iter().zip(&self.error_m))
            .filter(|(i, _)| stretches.iter().any(|s| s.frames().contains(i)))
            .map(|(_, e)| *e)
            .collect();
        let seen = (self.seen.iter())
            .filter_map(|i| Stretch::place(stretches, *i))
            .collect();
        (!gaps.is_empty()).then_some(Bridges {
            gaps,
            seen,
            error_m,
        })
    }

    /// Bridges the `gaps` (first frame and length) of a smoothed track, read with the clock offset already in
    /// `start_s`; `None` without any.
    pub(super) fn over(
        gaps: Vec<(usize, usize)>,
        captured: &[bool],
        voltage: &Voltage,
        start_s: f64,
        track: &mut Track,
    ) -> Option<Self> {
        if gaps.is_empty() {
            return None;
        }
        let n = captured.len();
        let seen: Vec<usize> = (0..n).filter(|&i| captured[i]).collect();
        let rows = features(voltage, start_s, track.step_s, n);
        let path = regression(&rows, &seen, &track.position_m);
        let off = |i: usize| [0, 1, 2].map(|k| track.position_m[i][k] - path[i][k]);
        let error_m: Vec<Vec3> = seen.iter().map(|&i| off(i)).collect();
        let sides: Vec<[Option<Vec3>; 2]> = gaps
            .iter()
            .map(|&(start, length)| {
                let after = start + length;
                [
                    (start > 0).then(|| off(start - 1)),
                    (after < n).then(|| off(after)),
                ]
            })
            .collect();
        for (&gap, sides) in gaps.iter().zip(sides) {
            for i in gap.0..gap.0 + gap.1 {
                let shift = between(sides, i, gap);
                track.position_m[i] = [0, 1, 2].map(|k| path[i][k] + shift[k]);
            }
            differentiate(track, gap);
        }
        Some(Bridges {
            gaps,
            seen,
            error_m,
        })
    }

    /// Puts into the gaps of `track` the path of `own` (the bridged one), shifted so that it meets `track` on
    /// both sides; with a generator a draw of what is open is added.
    pub(super) fn carry(&self, own: &Track, track: &mut Track, generator: Option<&mut impl Rng>) {
        let n = track.position_m.len();
        let mut generator = generator;
        for &(start, length) in &self.gaps {
            let after = start + length;
            let apart = |track: &Track, i: usize| {
                [0, 1, 2].map(|k| track.position_m[i][k] - own.position_m[i][k])
            };
            let sides = [
                (start > 0).then(|| apart(track, start - 1)),
                (after < n).then(|| apart(track, after)),
            ];
            let first = generator
                .as_deref_mut()
                .map(|g| g.random_range(0..self.seen.len()));
            let error = |from: usize, j: usize| self.error_m[(from + j) % self.error_m.len()];
            for i in start..after {
                let shift = between(sides, i, (start, length));
                let open = first.map_or([0.0; 3], |from| {
                    let pins = [
                        (start > 0).then(|| error(from, 0)),
                        (after < n).then(|| error(from, length + 1)),
                    ];
                    let (e, pinned) = (
                        error(from, i + 1 - start),
                        between(pins, i, (start, length)),
                    );
                    [0, 1, 2].map(|k| e[k] - pinned[k])
                });
                track.position_m[i] = [0, 1, 2].map(|k| own.position_m[i][k] + shift[k] + open[k]);
            }
            differentiate(track, (start, length));
        }
    }
}
