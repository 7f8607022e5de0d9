//! Parameters across films, days and batches: who stands out, what drifts, which batch differs.
//!
//! Of each parameter, film i of batch b on day d has the estimate
//!
//! ```text
//! x_i = m_b + k d_i + u_i + e_i,   u_i ~ N(0, tau^2) between films,   e_i ~ N(0, s_i^2) of the estimate
//! ```
//!
//! in the logarithm where all values are positive, so that a spread is a share. Everything that a few films
//! could spoil is worked out from medians: m_b, the slope k (Theil 1950, Sen 1968, within batches), and tau,
//! which makes the median of |x_i - m_b - k d_i| / sqrt(tau^2 + s_i^2) that of a normal density (the moment
//! equation of Paule and Mandel 1982, with the median in place of the mean square). A film stands out where
//! that ratio is beyond what the largest of all of them, over all films and parameters, reaches by chance
//! (Bonferroni), in Student's density with the degrees of freedom that a scale from medians has. Drift and
//! batches are then compared by weighted least squares without the films that stand out.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Films of a batch from which the batch has a middle of its own.
const OWN_MIDDLE: usize = 8;
/// Films from which anything is said of a parameter.
const ENOUGH: usize = 6;
/// Median of the magnitude of a normal number of variance 1.
const MIDDLE: f64 = 0.674_489_750_196_081_7;
/// Efficiency of a scale from the median of magnitudes (that of the MAD, Rousseeuw and Croux 1993).
const EFFICIENCY: f64 = 0.37;

/// An estimate of a parameter from one film.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimated {
    /// Number of the film's recording set.
    pub set: usize,
    /// Batch, from 0; films without one share one.
    pub batch: usize,
    /// Day, where it is known.
    pub day: Option<f64>,
    /// Value.
    pub value: f64,
    /// Its standard error, in the same unit.
    pub std_error: f64,
}

/// A film that stands out.
#[derive(Debug, Clone, PartialEq)]
pub struct StandsOut {
    /// Number of its set.
    pub set: usize,
    /// What its batch and day would have it be.
    pub expected: f64,
    /// How far off it is, in standard deviations of a film of its certainty.
    pub deviations: f64,
    /// How likely one of all films and parameters were as far off by chance.
    pub p_value: f64,
}

/// Change over the days.
#[derive(Debug, Clone, PartialEq)]
pub struct Drift {
    /// Change a day, of the value or (where [`Across::logarithmic`]) as a share, with its 95 % interval.
    pub per_day: f64,
    /// Its 95 % interval.
    pub ci95: [f64; 2],
    /// How likely it, or one of the other parameters', were as far from 0 by chance.
    pub p_value: f64,
}

/// A batch against all others.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchMiddle {
    /// Batch.
    pub batch: usize,
    /// Films.
    pub films: usize,
    /// Middle of its values.
    pub middle: f64,
    /// 95 % interval of that.
    pub ci95: [f64; 2],
    /// How likely it, or another batch or parameter, were as far from the others by chance.
    pub p_value: f64,
}

/// What is seen of one parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Across {
    /// Whether spread and change are shares.
    pub logarithmic: bool,
    /// Middle over all films.
    pub middle: f64,
    /// Standard deviation between films of one batch, of the value or as a share.
    pub spread: f64,
    /// Those that stand out, furthest first.
    pub outliers: Vec<StandsOut>,
    /// Change over the days, where there are three or more.
    pub drift: Option<Drift>,
    /// The batches, where there are two or more of enough films.
    pub batches: Vec<BatchMiddle>,
}

fn median(mut list: Vec<f64>) -> f64 {
    let n = list.len();
    if n == 0 {
        return f64::NAN;
    }
    list.sort_by(f64::total_cmp);
    0.5 * (list[(n - 1) / 2] + list[n / 2])
}

/// Spread between films, beside the errors of their estimates: where the median of |r|/sqrt(tau^2 + s^2) is a
/// normal density's.
fn between(residuals: &[f64], errors: &[f64], middle: f64) -> f64 {
    let of = |tau: f64| {
        let all = residuals.iter().zip(errors);
        median(all.map(|(r, s)| r.abs() / tau.hypot(*s)).collect())
    };
    let (mut low, mut high) = (0.0, residuals.iter().fold(0.0_f64, |m, r| m.max(r.abs())));
    if of(low) <= middle {
        return 0.0;
    }
    high *= 2.0;
    for _ in 0..80 {
        let tau = 0.5 * (low + high);
        if of(tau) > middle {
            low = tau
        } else {
            high = tau
        }
    }
    0.5 * (low + high)
}

/// Numbers of the films of each batch that has a middle of its own; the others together.
fn groups(list: &[Estimated]) -> Vec<Vec<usize>> {
    let count = list.iter().map(|e| e.batch + 1).max().unwrap_or(0);
    let mut groups: Vec<Vec<usize>> = vec![Vec::new(); count];
    for (i, e) in list.iter().enumerate() {
        groups[e.batch].push(i);
    }
    let (mut own, few): (Vec<_>, Vec<_>) = groups.into_iter().partition(|g| g.len() >= OWN_MIDDLE);
    let few = few.concat();
    if !few.is_empty() {
        own.push(few);
    }
    own
}

/// Slope over the days within groups, by medians; 0 where fewer than three days are known.
fn slope(x: &[f64], list: &[Estimated], groups: &[Vec<usize>]) -> f64 {
    let mut slopes = Vec::new();
    for group in groups {
        // of many films neighbours some way apart say as much as all pairs
        let stride = (group.len() * group.len() / 200_000).max(1);
        let mut number = 0;
        for (a, &i) in group.iter().enumerate() {
            for &j in &group[a + 1..] {
                number += 1;
                if number % stride == 0
                    && let (Some(s), Some(t)) = (list[i].day, list[j].day)
                    && s != t
                {
                    slopes.push((x[j] - x[i]) / (t - s));
                }
            }
        }
    }
    median(slopes)
}

/// The days that are known, each once.
fn days(list: &[Estimated]) -> Vec<f64> {
    let mut days: Vec<f64> = list.iter().filter_map(|e| e.day).collect();
    days.sort_by(f64::total_cmp);
    days.dedup();
    days
}

/// Compares one of `parameters` parameters over films. Over all films (and batches, and drifts) and
/// parameters one that does not stand out is said to with probability `false_alarms` at most. `None` where
/// there are fewer than six estimates that are told: without a finite value and a positive standard error
/// they are left out.
pub fn across(list: &[Estimated], parameters: usize, false_alarms: f64) -> Option<Across> {
    let told = |e: &&Estimated| e.value.is_finite() && e.std_error.is_finite() && e.std_error > 0.0;
    let list: Vec<Estimated> = list.iter().filter(told).cloned().collect();
    let n = list.len();
    if n < ENOUGH {
        return None;
    }
    let logarithmic = list.iter().all(|e| e.value > 0.0);
    let (x, s): (Vec<f64>, Vec<f64>) = list
        .iter()
        .map(|e| match logarithmic {
            true => (e.value.ln(), e.std_error / e.value),
            false => (e.value, e.std_error),
        })
        .unzip();
    let back = |v: f64| if logarithmic { v.exp() } else { v };
    let groups = groups(&list);
    let days = days(&list);
    let changes = days.len() >= 3 && list.iter().all(|e| e.day.is_some());
    let slope = match changes {
        true => slope(&x, &list, &groups),
        false => 0.0,
    };
    let slope = if slope.is_finite() { slope } else { 0.0 };
    let moved: Vec<f64> = (0..n)
        .map(|i| x[i] - slope * list[i].day.unwrap_or(0.0))
        .collect();
    // middles, and what is left; a film does not judge itself: m_b is the median of the others of its group
    let mut expected = vec![0.0; n];
    for group in &groups {
        let mut sorted: Vec<f64> = group.iter().map(|&i| moved[i]).collect();
        sorted.sort_by(f64::total_cmp);
        for &i in group {
            let own = sorted.partition_point(|v| *v < moved[i]);
            let others = |k: usize| sorted[k + usize::from(k >= own)];
            expected[i] = match sorted.len() - 1 {
                0 => moved[i],
                m => 0.5 * (others((m - 1) / 2) + others(m / 2)),
            };
        }
    }
    let left: Vec<f64> = (0..n).map(|i| moved[i] - expected[i]).collect();
    let tau = between(&left, &s, MIDDLE);
    let degrees = (EFFICIENCY * (n - groups.len()) as f64 - f64::from(u8::from(changes))).max(1.0);
    let student = StudentsT::new(0.0, 1.0, degrees).ok()?;
    let tests = (n * parameters.max(1)) as f64;
    let mut outliers: Vec<(usize, StandsOut)> = (0..n)
        .filter_map(|i| {
            let deviations = left[i] / tau.hypot(s[i]);
            let p_value = (2.0 * student.sf(deviations.abs()) * tests).min(1.0);
            (p_value < false_alarms).then(|| {
                let expected = back(expected[i] + slope * list[i].day.unwrap_or(0.0));
                let out = StandsOut {
                    set: list[i].set,
                    expected,
                    deviations,
                    p_value,
                };
                (i, out)
            })
        })
        .collect();
    outliers.sort_by(|a, b| b.1.deviations.abs().total_cmp(&a.1.deviations.abs()));
    let kept: Vec<usize> = (0..n)
        .filter(|i| !outliers.iter().any(|o| o.0 == *i))
        .collect();
    let middle_day = if changes { median(days) } else { 0.0 };
    let weight: Vec<f64> = s.iter().map(|s| 1.0 / (tau * tau + s * s)).collect();
    Some(Across {
        logarithmic,
        middle: back(median(kept.iter().map(|&i| x[i]).collect())),
        spread: tau,
        drift: changes
            .then(|| drift(&x, &list, &weight, &kept, parameters))
            .flatten(),
        batches: batches(&moved, &list, &weight, &kept, parameters, &|v| {
            back(v + slope * middle_day)
        }),
        outliers: outliers.into_iter().map(|o| o.1).collect(),
    })
}

/// Weighted regression on the day, within batches.
fn drift(
    x: &[f64],
    list: &[Estimated],
    weight: &[f64],
    kept: &[usize],
    parameters: usize,
) -> Option<Drift> {
    let count = list.iter().map(|e| e.batch + 1).max()?;
    let mut sums = vec![[0.0; 3]; count];
    for &i in kept {
        let own = &mut sums[list[i].batch];
        let day = list[i].day?;
        own[0] += weight[i];
        own[1] += weight[i] * day;
        own[2] += weight[i] * x[i];
    }
    let at = |i: usize| {
        let [w, d, v] = sums[list[i].batch];
        (list[i].day.unwrap_or(0.0) - d / w, x[i] - v / w)
    };
    let (mut dd, mut dx) = (0.0, 0.0);
    for &i in kept {
        let (d, v) = at(i);
        dd += weight[i] * d * d;
        dx += weight[i] * d * v;
    }
    let batches = sums.iter().filter(|s| s[0] > 0.0).count();
    let degrees = kept.len().checked_sub(batches + 1).filter(|d| *d > 0)? as f64;
    if dd <= 0.0 {
        return None;
    }
    let per_day = dx / dd;
    let square = |i: &usize| {
        let (d, v) = at(*i);
        weight[*i] * (v - per_day * d).powi(2)
    };
    // what scatters more than the films' own spread says widens the interval
    let scale = (kept.iter().map(square).sum::<f64>() / degrees).max(1.0);
    let error = (scale / dd).sqrt();
    let student = StudentsT::new(0.0, 1.0, degrees).ok()?;
    let reach = student.inverse_cdf(0.975) * error;
    let p = 2.0 * student.sf((per_day / error).abs());
    Some(Drift {
        per_day,
        ci95: [per_day - reach, per_day + reach],
        p_value: (p * parameters.max(1) as f64).min(1.0),
    })
}

/// Each batch of enough films against all others of such batches.
fn batches(
    x: &[f64],
    list: &[Estimated],
    weight: &[f64],
    kept: &[usize],
    parameters: usize,
    back: &dyn Fn(f64) -> f64,
) -> Vec<BatchMiddle> {
    let count = list.iter().map(|e| e.batch + 1).max().unwrap_or(0);
    let mut own: Vec<(usize, Vec<usize>)> = (0..count).map(|b| (b, Vec::new())).collect();
    for &i in kept {
        own[list[i].batch].1.push(i);
    }
    own.retain(|b| b.1.len() >= 3);
    if own.len() < 2 {
        return Vec::new();
    }
    let (Ok(normal), films) = (
        Normal::new(0.0, 1.0),
        own.iter().map(|b| b.1.len()).sum::<usize>(),
    ) else {
        return Vec::new();
    };
    let degrees = (EFFICIENCY * (films - own.len()) as f64).max(1.0);
    let Ok(student) = StudentsT::new(0.0, 1.0, degrees) else {
        return Vec::new();
    };
    let told: Vec<(f64, f64)> = own
        .iter()
        .map(|(_, films)| {
            let w: f64 = films.iter().map(|&i| weight[i]).sum();
            let m = films.iter().map(|&i| weight[i] * x[i]).sum::<f64>() / w;
            (m, 1.0 / w)
        })
        .collect();
    let tests = (own.len() * parameters.max(1)) as f64;
    own.iter()
        .enumerate()
        .map(|(b, (batch, films))| {
            let (m, variance) = told[b];
            let others = told.iter().enumerate().filter(|o| o.0 != b);
            // the others' middle, each batch weighing alike: a batch more is no film more
            let (sum, sum_variance) = others.fold((0.0, 0.0), |a, (_, o)| (a.0 + o.0, a.1 + o.1));
            let count = (told.len() - 1) as f64;
            let apart = m - sum / count;
            let error = (variance + sum_variance / (count * count)).sqrt();
            let reach = normal.inverse_cdf(0.975) * variance.sqrt();
            BatchMiddle {
                batch: *batch,
                films: films.len(),
                middle: back(m),
                ci95: [back(m - reach), back(m + reach)],
                p_value: (2.0 * student.sf((apart / error).abs()) * tests).min(1.0),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha12Rng;
    use rand_distr::{Distribution, StandardNormal};

    const RATE: f64 = 0.05;

    /// `n` films in `batches` over `days`, with errors of several sizes; ln of the values scatters by 4 %.
    fn films(n: usize, batches: usize, days: usize, rng: &mut ChaCha12Rng) -> Vec<Estimated> {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        (0..n)
            .map(|set| {
                let error = [0.01, 0.02, 0.05][set % 3];
                let value = 8e5 * (0.04 * normal() + error * normal()).exp();
                Estimated {
                    set,
                    batch: set % batches,
                    day: (days > 0).then(|| ((set / batches) % days.max(1)) as f64),
                    value,
                    std_error: error * value,
                }
            })
            .collect()
    }

    #[test]
    fn false_alarms_are_as_rare_as_stated() {
        let mut rng = ChaCha12Rng::seed_from_u64(20_270_101);
        for (n, batches, days) in [(10, 1, 0), (30, 2, 5), (60, 4, 0), (200, 4, 10)] {
            let rounds = 400;
            let mut alarms = [0; 3];
            for _ in 0..rounds {
                let found = across(&films(n, batches, days, &mut rng), 1, RATE).unwrap();
                alarms[0] += usize::from(!found.outliers.is_empty());
                alarms[1] += usize::from(found.drift.is_some_and(|d| d.p_value < RATE));
                alarms[2] += usize::from(found.batches.iter().any(|b| b.p_value < RATE));
            }
            // 5 % of 400 are 20, with a standard deviation of 4.4
            for (what, count) in ["outliers", "drift", "batches"].iter().zip(alarms) {
                println!("{n} films, {batches} batches, {days} days: {what} {count} of {rounds}");
                assert!(count <= 34, "{n} films, {batches} batches: {what} {count}");
            }
        }
    }

    #[test]
    fn planted_films_batches_and_drift_are_found_and_no_other() {
        let mut rng = ChaCha12Rng::seed_from_u64(7);
        let mut list = films(200, 4, 10, &mut rng);
        for e in &mut list {
            let day = e.day.unwrap();
            let batch = if e.batch == 2 { 1.15 } else { 1.0 };
            e.value *= batch * (1.0 - 0.01 * day);
        }
        for set in [17, 130] {
            list[set].value *= 1.6;
        }
        let found = across(&list, 10, RATE).unwrap();
        let mut out: Vec<usize> = found.outliers.iter().map(|o| o.set).collect();
        out.sort_unstable();
        assert_eq!(out, [17, 130]);
        let drift = found.drift.unwrap();
        assert!(drift.p_value < 1e-3, "{drift:?}");
        assert!(
            drift.ci95[0] < -0.01 && -0.01 < drift.ci95[1] + 1e-3,
            "{drift:?}"
        );
        assert!((found.spread - 0.04).abs() < 0.01, "{}", found.spread);
        let differ: Vec<usize> = found
            .batches
            .iter()
            .filter(|b| b.p_value < RATE)
            .map(|b| b.batch)
            .collect();
        assert!(differ.contains(&2), "{:?}", found.batches);
        let furthest = found
            .batches
            .iter()
            .min_by(|a, b| a.p_value.total_cmp(&b.p_value));
        assert_eq!(furthest.unwrap().batch, 2);
    }

    #[test]
    fn few_films_say_nothing() {
        let mut rng = ChaCha12Rng::seed_from_u64(1);
        assert_eq!(across(&films(5, 1, 0, &mut rng), 1, RATE), None);
    }
}
