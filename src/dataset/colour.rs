//! The colour of the capture's noise: whether it is white, or has a slow part besides, told from a marker that stands still.
//! (What smoothing leaves of a moving one, well above the motion's frequencies, does not tell: the slow part is small there.)
//!
//! A slow part (a first-order autoregression) is larger within the motion's band than above it, so a floor that takes the noise
//! for white is too low there. Its spectrum over that of the white part,
//! rho (1 - a)^2/(1 - 2 a cos(w) + a^2) with a = e^(-step/tau), is fitted by Whittle's likelihood to
//! averaged periodograms of half-overlapping pieces (Welch 1967), all three axes together.

/// A slow part of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Colour {
    /// Its correlation time, s.
    pub correlation_s: f64,
    /// Its variance over that of the white part.
    pub variance: f64,
}

/// Length of a piece, samples.
const PIECE: usize = 256;
/// Correlation times that are tried, s.
const TIMES_S: [f64; 7] = [0.015, 0.022, 0.032, 0.047, 0.068, 0.1, 0.15];
/// Rise of the log likelihood from which a slow part is believed.
const BELIEVED: f64 = 5.0;

/// The slow part of the noise in `left` (what was measured of each axis less what moved; NaN where nothing was measured), where the
/// likelihood asks for one. Only frequencies above `lowest_hz` of each axis are looked at.
pub fn colour(left: &[Vec<f64>], lowest_hz: &[f64], step_s: f64) -> Option<Colour> {
    let pi = std::f64::consts::PI;
    let window: Vec<f64> = (0..PIECE)
        .map(|i| 0.5 - 0.5 * (2.0 * pi * (i as f64 + 0.5) / PIECE as f64).cos())
        .collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let turn: Vec<(f64, f64)> = (0..PIECE)
        .map(|i| (2.0 * pi * i as f64 / PIECE as f64).sin_cos())
        .collect();
    // Averaged periodograms: axis, bin, mean, pieces.
    let mut bins: Vec<(usize, f64, f64, f64)> = Vec::new();
    for (axis, (values, lowest)) in left.iter().zip(lowest_hz).enumerate() {
        let first = (lowest * step_s * PIECE as f64).ceil().max(1.0) as usize;
        let mut sums = vec![0.0; PIECE / 2];
        let mut pieces = 0.0;
        let mut at = 0;
        while at + PIECE <= values.len() {
            let piece = &values[at..at + PIECE];
            at += PIECE / 2;
            if piece.iter().any(|v| v.is_nan()) {
                continue;
            }
            pieces += 1.0;
            for (bin, sum) in sums.iter_mut().enumerate().skip(first) {
                let (mut re, mut im) = (0.0, 0.0);
                for (i, (v, w)) in piece.iter().zip(&window).enumerate() {
                    let (s, c) = turn[i * bin % PIECE];
                    re += v * w * c;
                    im += v * w * s;
                }
                *sum += (re * re + im * im) / energy;
            }
        }
        if pieces < 2.0 {
            return None;
        }
        for (bin, sum) in sums.into_iter().enumerate().skip(first) {
            let w = 2.0 * pi * bin as f64 / PIECE as f64;
            bins.push((axis, w, sum / pieces, pieces));
        }
    }
    if bins.len() < 60 {
        return None;
    }
    // Half-overlapping Hann pieces: about 0.7 independent ones each, and neighbouring bins share half.
    let independent = 0.5;
    let log_likelihood = |a: f64, variance: f64| {
        let shape = |w: f64| 1.0 + variance * (1.0 - a * a) / (1.0 - 2.0 * a * w.cos() + a * a);
        let mut total = 0.0;
        for axis in 0..left.len() {
            let own = || bins.iter().filter(move |b| b.0 == axis);
            let weight: f64 = own().map(|b| b.3).sum();
            let level = own().map(|b| b.3 * b.2 / shape(b.1)).sum::<f64>() / weight;
            total -= own()
                .map(|b| {
                    b.3 * independent * ((level * shape(b.1)).ln() + b.2 / (level * shape(b.1)))
                })
                .sum::<f64>();
        }
        total
    };
    let white = log_likelihood(0.0, 0.0);
    let mut best = (white + BELIEVED, None);
    for tau in TIMES_S {
        let a = (-step_s / tau).exp();
        for i in 0..24 {
            let variance = 0.01 * 1.25_f64.powi(i);
            let l = log_likelihood(a, variance);
            if l > best.0 {
                best = (
                    l,
                    Some(Colour {
                        correlation_s: tau,
                        variance,
                    }),
                );
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    fn noise(tau: f64, variance: f64, seed: u64) -> Vec<Vec<f64>> {
        let mut g = rand_chacha::ChaCha12Rng::seed_from_u64(seed);
        let a = (-0.01 / tau).exp();
        (0..3)
            .map(|_| {
                let mut slow = 0.0;
                (0..2500)
                    .map(|_| {
                        let (x, y): (f64, f64) =
                            (StandardNormal.sample(&mut g), StandardNormal.sample(&mut g));
                        slow = a * slow + (1.0 - a * a).sqrt() * y;
                        x + variance.sqrt() * slow
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn white_noise_is_white_and_a_slow_part_is_found() {
        let cutoff = [0.4; 3];
        let white = (0..10).filter(|&s| colour(&noise(0.05, 0.0, s), &cutoff, 0.01).is_some());
        assert!(white.count() <= 1);
        for seed in 0..5 {
            let found = colour(&noise(0.04, 0.3, 20 + seed), &cutoff, 0.01).unwrap();
            // What matters is the level within the motion's band: 2 tau variance.
            let level = found.variance * found.correlation_s / (0.3 * 0.04);
            assert!((0.4..2.5).contains(&level), "{found:?}");
        }
    }
}
