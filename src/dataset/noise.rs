//! Noise of a measured column. Its size is told from differences of neighbours, in which a smooth course
//! leaves nothing, or from the top of its spectrum; both take it for white. How neighbours correlate is told
//! from the shape of the spectrum, for noise that is a little coloured is larger where the motion is.

/// Median magnitude of a standard normal deviate.
pub(super) const MEDIAN: f64 = 0.674_489_75;

/// Difference of the highest order that so many neighbours at equal distances have.
#[must_use]
pub fn difference(neighbours: &[f64]) -> f64 {
    let order = neighbours.len() - 1;
    let mut binomial = 1.0;
    let mut sum = 0.0;
    for (i, v) in neighbours.iter().rev().enumerate() {
        sum += binomial * v;
        binomial *= -((order - i) as f64) / (i + 1) as f64;
    }
    sum
}

/// Standard deviation of white noise in values of which these are the differences of one order, by the median
/// of their magnitudes, which a leap does not move; no less than what rounding to `digit` (0: to none) makes.
/// Rounded values have differences on a ladder of digits, whose median is a rung: each is spread over its
/// rung before.
#[must_use]
pub fn of_differences(mut differences: Vec<f64>, order: usize, digit: f64) -> f64 {
    /// A share of one that no multiple of it comes near again soon (golden ratio).
    const TURN: f64 = 0.618_033_988_749_894_9;
    differences.retain(|d| d.is_finite());
    if differences.is_empty() {
        return 0.0;
    }
    for (i, d) in differences.iter_mut().enumerate() {
        *d = (*d + digit * ((i as f64 * TURN).fract() - 0.5)).abs();
    }
    differences.sort_by(f64::total_cmp);
    let median = differences[differences.len() / 2];
    (median / MEDIAN / variance(order).sqrt()).max(digit / 12f64.sqrt())
}

/// Variance of a difference of independent values, over theirs: the sum of the squared binomial coefficients,
/// (2 n)! / n!^2.
fn variance(order: usize) -> f64 {
    (1..=order).map(|i| (order + i) as f64 / i as f64).product()
}

/// Standard deviation of white noise in evenly taken values, from their differences of an order.
#[must_use]
pub fn white(values: &[f64], order: usize) -> f64 {
    let differences = values.windows(order + 1).map(difference).collect();
    of_differences(differences, order, digit(values.iter().copied()))
}

/// The digit to which values were rounded: all distances of neighbours in size are multiples of the smallest.
/// 0 where they are not.
#[must_use]
pub fn digit(values: impl Iterator<Item = f64>) -> f64 {
    /// How near to whole a multiple is, in digits, and the share of them that is.
    const NEAR: f64 = 0.02;
    const MOST: f64 = 0.99;
    let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else {
        return 0.0;
    };
    let least = 1e-9 * (last - first);
    let gaps = sorted.windows(2).map(|w| w[1] - w[0]);
    let gaps: Vec<f64> = gaps.filter(|d| *d > least).collect();
    let smallest = gaps.iter().copied().fold(f64::INFINITY, f64::min);
    let whole = |d: &&f64| (**d / smallest - (**d / smallest).round()).abs() < NEAR;
    let rounded = gaps.iter().filter(whole).count() as f64 > MOST * gaps.len() as f64;
    if rounded { smallest } else { 0.0 }
}

/// Samples of a piece of the spectrum, and pieces at most.
const PIECE: usize = 512;
const PIECES: usize = 48;

/// Power of evenly taken values by frequency, from 0 to half the sampling rate: Welch's averaged periodogram
/// with a Hann window. White noise has its variance everywhere.
#[must_use]
pub fn spectrum(values: &[f64]) -> Vec<f64> {
    let size = PIECE.min(values.len() / 2 * 2).max(8);
    let count = (2 * values.len() / size).saturating_sub(1).clamp(1, PIECES);
    let stride = if count > 1 {
        (values.len() - size) / (count - 1)
    } else {
        0
    };
    let window: Vec<f64> = (0..size)
        .map(|i| 0.5 - 0.5 * (std::f64::consts::TAU * (i as f64 + 0.5) / size as f64).cos())
        .collect();
    let energy: f64 = window.iter().map(|w| w * w).sum();
    let mut power = vec![0.0; size / 2];
    for piece in 0..count {
        let part = &values[piece * stride..piece * stride + size];
        // without its line: a slope would leak over all frequencies
        let (a, b) = (part[0], part[size - 1]);
        let flat: Vec<f64> = part
            .iter()
            .enumerate()
            .map(|(i, v)| window[i] * (v - a - (b - a) * i as f64 / (size - 1) as f64))
            .collect();
        for (k, p) in power.iter_mut().enumerate() {
            let (s, c) = (std::f64::consts::TAU * k as f64 / size as f64).sin_cos();
            let (mut re, mut im) = (1.0, 0.0);
            let (mut x, mut y) = (0.0, 0.0);
            for v in &flat {
                x += v * re;
                y += v * im;
                (re, im) = (re * c - im * s, re * s + im * c);
            }
            *p += (x * x + y * y) / energy / count as f64;
        }
    }
    power
}

/// Fewest values whose colour is told.
const COLOUR_FROM: usize = 256;
/// Largest correlation of neighbours that is told: beyond it motion that ends in steps looks alike.
const MOST_COLOUR: f64 = 0.4;
/// Power over that of the noise beyond which a frequency is signal.
const SIGNAL: f64 = 6.0;
/// By how much the lower half of the frequencies looked at may exceed what the upper half lets expect; motion
/// with steps exceeds it.
const SKIRT: f64 = 1.3;

/// Size of a leap beyond the slopes on both sides, in standard deviations of noise there.
const LEAP: f64 = 4.0;

/// The values with leaps between two neighbours closed: their spectrum falls slowly, as that of noise whose
/// neighbours correlate does. Leaps below nine standard deviations of the noise are mostly lost in it: forty
/// of ten among 4,000 samples still pass for a correlation of 0.09.
fn without_leaps(values: &[f64]) -> Vec<f64> {
    let n = values.len();
    // half a third difference is how far a step goes beyond the mean of its neighbours
    let most = LEAP * 0.5 * variance(3).sqrt() * white(values, 3);
    let beyond = |i: usize| match i > 1 && i + 1 < n {
        true => -0.5 * difference(&values[i - 2..i + 2]),
        false => 0.0,
    };
    let mut closed = 0.0;
    let each = values.iter().enumerate().map(|(i, v)| {
        let own = beyond(i);
        let largest = (i > 0).then(|| beyond(i - 1).abs().max(beyond(i + 1).abs()));
        if own.abs() > most && largest.is_some_and(|l| own.abs() > l) {
            closed += own;
        }
        v - closed
    });
    each.collect()
}

/// Correlation of neighbours in the noise of evenly taken values, less its standard error: the first-order
/// autoregression whose spectrum is likeliest (Whittle 1953) from an eighth to half of the sampling rate,
/// where a well-sampled motion has nothing. 0 where nothing is told: too few values, or motion at those
/// frequencies.
#[must_use]
pub fn colour(values: &[f64]) -> f64 {
    if values.len() < COLOUR_FROM || values.iter().any(|v| !v.is_finite()) {
        return 0.0;
    }
    let power = spectrum(&without_leaps(values));
    let bins = power.len();
    let looked_at = bins / 4..bins;
    let whitens = |rho: f64, k: usize| {
        let cosine = (std::f64::consts::PI * (k as f64 + 0.5) / bins as f64).cos();
        1.0 + rho * rho - 2.0 * rho * cosine
    };
    let over = |rho: f64, range: std::ops::Range<usize>| -> Vec<f64> {
        range.map(|k| power[k] * whitens(rho, k)).collect()
    };
    let middle = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let unlikely = |rho: f64| {
        let all = over(rho, looked_at.clone());
        let most = SIGNAL * middle(all.clone());
        let innovations = all.iter().map(|p| p.min(most)).sum::<f64>() / all.len() as f64;
        let shape: f64 = looked_at.clone().map(|k| whitens(rho, k).ln()).sum();
        all.len() as f64 * innovations.ln() - shape
    };
    let steps = (0..=100).map(|i| MOST_COLOUR * f64::from(i) / 100.0);
    let likeliest = steps.min_by(|a, b| unlikely(*a).total_cmp(&unlikely(*b)));
    let rho = likeliest.unwrap_or(0.0);
    let (lower, upper) = (bins / 4..bins / 2, bins / 2..bins);
    let told = rho < MOST_COLOUR && middle(over(rho, lower)) < SKIRT * middle(over(rho, upper));
    // Whittle's information in that band: three quarters of the frequencies, over which
    // d ln S/d rho = 2 cos w has the variance 1.216
    let error = (0.375 * 1.216 * values.len() as f64).sqrt().recip();
    if told { (rho - error).max(0.0) } else { 0.0 }
}

/// Power of noise at low frequencies over that at the top of its spectrum, from the correlation of
/// neighbours.
#[must_use]
pub fn in_band(correlation: f64) -> f64 {
    ((1.0 + correlation) / (1.0 - correlation)).powi(2)
}

/// Variance of noise over what third differences take it for where it is white, from the correlation of
/// neighbours.
#[must_use]
pub fn over_third_differences(correlation: f64) -> f64 {
    let r = correlation;
    (1.0 - 1.5 * r + 0.6 * r * r - 0.1 * r * r * r).recip()
}

/// Variance of the mean of so many neighbours over that of the mean of as many independent values.
#[must_use]
pub fn of_mean(count: f64, correlation: f64) -> f64 {
    // 1 + 2 sum_k (1 - k/n) r^k, summed up
    let (n, r) = (count.max(1.0), correlation);
    (1.0 + r) / (1.0 - r) - 2.0 * r * (1.0 - r.powf(n)) / (n * (1.0 - r).powi(2))
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// A slow sine with noise, read to a digit (0: to none).
    fn read(digit: f64, sd: f64) -> Vec<f64> {
        let mut generator = rand_chacha::ChaCha12Rng::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
        let value = |i: usize, z: f64| (i as f64 * 0.02).sin() + sd * z;
        (0..20_000)
            .map(|i| {
                let v = value(i, normal());
                if digit > 0.0 {
                    (v / digit).round() * digit
                } else {
                    v
                }
            })
            .collect()
    }

    /// A slow sine with noise whose neighbours correlate.
    fn coloured(correlation: f64, seed: u64) -> Vec<f64> {
        let mut generator = rand_chacha::ChaCha12Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
        let fresh = (1.0 - correlation * correlation).sqrt();
        let mut e = normal();
        (0..4_000)
            .map(|i| {
                e = correlation * e + fresh * normal();
                (f64::from(i) * 0.02).sin() + 0.01 * e
            })
            .collect()
    }

    #[test]
    fn colour_is_told_from_white_and_from_steps() {
        for seed in 0..8 {
            for told in [0.0, 0.15, 0.3] {
                let values = coloured(told, seed);
                let rho = colour(&values);
                // a standard error of 0.0234 below it, give or take three
                assert!((-0.094..0.047).contains(&(rho - told)), "{rho} for {told}");
                let sd = white(&values, 3) * over_third_differences(rho).sqrt();
                assert!((sd / 0.01 - 1.0).abs() < 0.08, "{sd} for {told}");
            }
        }
        // leaps of twenty standard deviations, and of ten, of which a third are lost in the noise
        for (size, most) in [(0.2, 0.05), (0.1, 0.1)] {
            let mut steps = coloured(0.0, 1);
            for (i, v) in steps.iter_mut().enumerate() {
                *v += size * f64::from(u8::from(i / 100 % 2 == 0));
            }
            assert!(colour(&steps) < most, "{size}: {}", colour(&steps));
        }
    }

    #[test]
    fn the_mean_of_neighbours_has_the_variance_that_they_give_it() {
        for correlation in [0.0, 0.3] {
            for n in [1_i32, 2, 5] {
                let pairs = (1..n)
                    .map(|k| 2.0 * (1.0 - f64::from(k) / f64::from(n)) * f64::powi(correlation, k));
                let sum = 1.0 + pairs.sum::<f64>();
                assert!((of_mean(n.into(), correlation) - sum).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn differences_are_those_of_the_triangle() {
        assert_eq!(difference(&[1.0, 4.0]), 3.0);
        assert_eq!(difference(&[1.0, 4.0, 9.0]), 2.0);
        assert_eq!(difference(&[1.0, 8.0, 27.0, 64.0]), 6.0);
        assert_eq!([variance(1), variance(3), variance(4)], [2.0, 20.0, 70.0]);
    }

    #[test]
    fn noise_is_told_under_a_sine_rounded_or_not() {
        for order in [3, 4] {
            for digit in [0.0, 0.3, 1.0, 2.5] {
                let sd = 0.003;
                let rounded = digit * sd;
                let truth = f64::hypot(sd, rounded / 12f64.sqrt());
                let found = white(&read(rounded, sd), order);
                assert!(
                    (found / truth - 1.0).abs() < 0.1,
                    "{order} {digit}: {found} {truth}"
                );
            }
        }
        assert_eq!(white(&[1.0; 9], 3), 0.0);
        assert_eq!(white(&[1.0, 2.0], 3), 0.0);
        assert_eq!(digit([0.0, 1.0, 1.7].into_iter()), 0.0);
        assert!((digit([0.1, 0.7, 0.3, 0.5].into_iter()) - 0.2).abs() < 1e-12);
    }
}
