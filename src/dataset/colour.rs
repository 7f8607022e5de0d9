//! The colour of the capture's noise: whether it is white, or has a slow part besides, told from a marker
//! that stands still. (What smoothing leaves of a moving one, well above the motion's frequencies, does not
//! tell: the slow part is small there.)
//!
//! A slow part (a first-order autoregression) is larger within the motion's band than above it, so a floor
//! that takes the noise for white is too low there. Its spectrum over that of the white part, rho (1 -
//! a)^2/(1 - 2 a cos(w) + a^2) with a = e^(-step/tau), is fitted by Whittle's likelihood to averaged
//! periodograms of half-overlapping pieces (Welch 1967), all three axes together.

/// A slow part of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Colour {
    /// Its correlation time, s.
    pub correlation_s: f64,
    /// Its variance over that of the white part.
    pub variance: f64,
}

/// Length of a piece, samples; twice that where there are enough of them.
const PIECE: usize = 256;
const ENOUGH: usize = 2048;
/// Correlation times that are tried, s. Wander that is slower still lies below the frequencies that are
/// looked at.
pub(super) const TIMES_S: [f64; 12] = [
    0.015, 0.022, 0.032, 0.047, 0.068, 0.1, 0.15, 0.22, 0.32, 0.47, 0.68, 1.0,
];
/// Steps of the slow part's variance over the white part's that are tried, each a quarter more than the last,
/// from 1 %.
const VARIANCES: i32 = 40;
/// Those steps.
pub(super) fn variances() -> impl Iterator<Item = f64> {
    (0..VARIANCES).map(|i| 0.01 * 1.25_f64.powi(i))
}
/// Rise of the log likelihood from which a slow part is believed.
pub(super) const BELIEVED: f64 = 5.0;

/// The slow part of the noise in `left` (what was measured of each axis less what moved; NaN where nothing
/// was measured), where the likelihood asks for one. Only frequencies above `lowest_hz` of each axis are
/// looked at.
pub fn colour(left: &[Vec<f64>], lowest_hz: &[f64], step_s: f64) -> Option<Colour> {
    let pi = std::f64::consts::PI;
    let longest = left.iter().map(Vec::len).max().unwrap_or(0);
    let length = if longest >= ENOUGH { 2 * PIECE } else { PIECE };
    // Averaged periodograms: axis, bin, mean, pieces.
    let mut bins: Vec<(usize, f64, f64, f64)> = Vec::new();
    for (axis, (values, lowest)) in left.iter().zip(lowest_hz).enumerate() {
        let first = (lowest * step_s * length as f64).ceil().max(1.0) as usize;
        let (means, pieces) = periodogram(values, length);
        if pieces < 2.0 {
            return None;
        }
        for (bin, mean) in means.into_iter().enumerate().skip(first) {
            let w = 2.0 * pi * bin as f64 / length as f64;
            bins.push((axis, w, mean, pieces));
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
        for variance in variances() {
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

/// Mean periodogram of the half-overlapping pieces without a gap (a Hann window each; white noise makes its
/// variance in every bin), and their number.
fn periodogram(values: &[f64], length: usize) -> (Vec<f64>, f64) {
    let pi = std::f64::consts::PI;
    let window: Vec<f64> = (0..length)
        .map(|i| 0.5 - 0.5 * (2.0 * pi * (i as f64 + 0.5) / length as f64).cos())
        .collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let turn: Vec<(f64, f64)> = (0..length)
        .map(|i| (2.0 * pi * i as f64 / length as f64).sin_cos())
        .collect();
    let mut sums = vec![0.0; length / 2];
    let mut pieces = 0.0;
    let mut at = 0;
    while at + length <= values.len() {
        let piece = &values[at..at + length];
        at += length / 2;
        if piece.iter().any(|v| v.is_nan()) {
            continue;
        }
        pieces += 1.0;
        for (bin, sum) in sums.iter_mut().enumerate() {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, (v, w)) in piece.iter().zip(&window).enumerate() {
                let (s, c) = turn[i * bin % length];
                re += v * w * c;
                im += v * w * s;
            }
            *sum += (re * re + im * im) / energy;
        }
    }
    (
        sums.into_iter()
            .map(|s| s / f64::max(pieces, 1.0))
            .collect(),
        pieces,
    )
}

/// A capture that was low-pass filtered before it was exported, told from a marker that stands still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filtered {
    /// Frequency above which less than half of the noise is left, Hz.
    pub corner_hz: f64,
    /// Standard deviation of white noise with the level that is left below the corner, in the marker's unit.
    pub noise: f64,
}

/// Fall of the noise's spectrum over an octave from which it is a filter's: a slow part falls by 4 at most, a
/// filter of second order by 16.
const STEEP: f64 = 8.0;

/// The filter in `still` (each axis of a marker that stands still less its mean; NaN where nothing was
/// measured), where its spectrum falls more steeply than noise does.
pub fn filtered(still: &[Vec<f64>], step_s: f64) -> Option<Filtered> {
    let mut level = vec![0.0; PIECE / 2];
    for axis in still {
        let (means, pieces) = periodogram(axis, PIECE);
        if pieces < 2.0 {
            return None;
        }
        for (l, m) in level.iter_mut().zip(means) {
            *l += m / still.len() as f64;
        }
    }
    // half an octave each, so that sampling scatters them little
    let band = |from: f64| {
        let (a, b) = (from.round() as usize, (1.41 * from).round() as usize);
        let bins = &level[a.min(level.len())..b.min(level.len())];
        (!bins.is_empty()).then(|| bins.iter().sum::<f64>() / bins.len() as f64)
    };
    let falls = |from: f64| match (band(from), band(2.0 * from)) {
        (Some(here), Some(above)) => here > STEEP * above,
        _ => false,
    };
    let mut from = LOWEST_BIN;
    while 2.82 * from < level.len() as f64 && !falls(from) {
        from *= 1.19;
    }
    if 2.82 * from >= level.len() as f64 {
        return None;
    }
    let below = &level[2..(0.7 * from).ceil() as usize];
    let middle = {
        let mut sorted = below.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    };
    let corner = (2..level.len()).find(|&i| {
        let next = (i + 3).min(level.len());
        level[i..next].iter().sum::<f64>() < 0.5 * middle * (next - i) as f64
    })?;
    Some(Filtered {
        corner_hz: corner as f64 / (PIECE as f64 * step_s),
        noise: middle.sqrt(),
    })
}

/// Lowest bin at which a filter is looked for: 2.3 Hz of 100 Hz. Lower ones would take the motion with the
/// noise.
const LOWEST_BIN: f64 = 6.0;

impl Filtered {
    /// White noise of this size less what the filter would have left of it: with it the noise of a filtered
    /// capture is white again.
    pub fn missing(&self, count: usize, step_s: f64, generator: &mut impl rand::Rng) -> Vec<f64> {
        use rand_distr::Distribution;
        let pi = std::f64::consts::PI;
        let half = (1.5 / (self.corner_hz * step_s)).ceil() as usize;
        let cut = 2.0 * self.corner_hz * step_s;
        // a windowed sinc
        let mut taps: Vec<f64> = (0..=2 * half)
            .map(|i| {
                let x = i as f64 - half as f64;
                let sinc = if x == 0.0 {
                    cut
                } else {
                    (pi * cut * x).sin() / (pi * x)
                };
                sinc * (0.5 + 0.5 * (pi * x / (half as f64 + 1.0)).cos())
            })
            .collect();
        let sum: f64 = taps.iter().sum();
        taps.iter_mut().for_each(|t| *t /= sum);
        let white: Vec<f64> = (0..count + 2 * half)
            .map(|_| {
                let z: f64 = rand_distr::StandardNormal.sample(generator);
                self.noise * z
            })
            .collect();
        (0..count)
            .map(|i| {
                let low: f64 = taps.iter().zip(&white[i..]).map(|(t, w)| t * w).sum();
                white[i + half] - low
            })
            .collect()
    }
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
    fn a_filter_is_told_from_a_slow_part_and_its_noise_is_white_again() {
        // twice forward and back through y += 0.3 (x - y): 4th order, zero phase
        let filter = |x: &[f64]| {
            let mut y = x.to_vec();
            for _ in 0..2 {
                for _ in 0..2 {
                    let mut s = y[0];
                    for v in &mut y {
                        s += 0.3 * (*v - s);
                        *v = s;
                    }
                    y.reverse();
                }
            }
            y
        };
        for seed in 0..10 {
            for (tau, variance) in [(0.05, 0.0), (0.05, 0.3), (0.5, 3.0)] {
                assert_eq!(filtered(&noise(tau, variance, seed), 0.01), None);
            }
            let sharp: Vec<Vec<f64>> = noise(0.05, 0.0, seed).iter().map(|x| filter(x)).collect();
            let found = filtered(&sharp, 0.01).expect("a filter");
            assert!((1.0..6.0).contains(&found.corner_hz), "{found:?}");
            assert!((0.7..1.3).contains(&found.noise), "{found:?}");
            let mut g = rand_chacha::ChaCha12Rng::seed_from_u64(seed);
            let whole: Vec<Vec<f64>> = (sharp.iter())
                .map(|x| {
                    let missing = found.missing(x.len(), 0.01, &mut g);
                    x.iter().zip(missing).map(|(a, b)| a + b).collect()
                })
                .collect();
            assert_eq!(filtered(&whole, 0.01), None);
        }
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
