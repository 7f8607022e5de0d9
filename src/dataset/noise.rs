//! White noise of a measured column, told from differences of neighbours, in which a smooth course leaves
//! nothing.

/// Median magnitude of a standard normal deviate.
const MEDIAN: f64 = 0.674_489_75;

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
