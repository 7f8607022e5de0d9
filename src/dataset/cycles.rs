//! The cycles of a periodic drive, from the voltage alone.

use super::Voltage;

/// Departure of one period from the median, relative, at which a drive no longer counts as periodic.
const REGULAR: f64 = 0.1;
/// Levels, between the smallest and the largest squared voltage, whose crossing makes a rise.
const LEVELS: [f64; 2] = [0.35, 0.65];
/// Samples of the voltage a period at which it is looked at, at least.
const FINE: f64 = 200.0;
/// Cycles of a drive that repeats, at least.
const LEAST: usize = 3;
/// Times at which the range of a squared voltage is looked at.
const LOOKS: usize = 2000;

/// Cycles of a drive on the motion clock.
#[derive(Debug, Clone, PartialEq)]
pub struct Cycles {
    /// Length of one, s.
    pub period_s: f64,
    /// Beginning of each, where the voltage is smallest, s.
    pub starts_s: Vec<f64>,
    /// Where the drive stopped being periodic before its end, s.
    pub broken_s: Option<f64>,
}

/// The cycles of sum_k phi_k^2 with the clock offset `offset_s`, between `from_s` and `to_s` of the motion
/// clock.
///
/// A rise is a crossing from below a third to above two thirds of the range. The period is the mean distance
/// of the rises up to the first that comes too early or late; a cycle begins where the fundamental of phi^2
/// is smallest.
///
/// # Errors
/// A sentence, where the voltage does not rise twice at equal distances.
pub fn cycles(voltage: &Voltage, offset_s: f64, from_s: f64, to_s: f64) -> Result<Cycles, String> {
    let (first, last) = voltage.span_s();
    let (from, to) = (from_s.max(first - offset_s), to_s.min(last - offset_s));
    if to.is_nan() || to <= from {
        return Err("voltage and motion share no time".into());
    }
    let channels = voltage.channels_v().len();
    let square = |t: f64| -> f64 {
        (0..channels)
            .map(|k| voltage.at(k, t + offset_s).powi(2))
            .sum()
    };
    cycles_of(square, from, to)
}

/// Where the cycles of a drive begin that repeats to its end, and where the last one ends, s of the motion
/// clock with the clock offset `offset_s`, between `from_s` and `to_s`; empty where it does not repeat at
/// least `LEAST` times. The channel whose square varies most tells: of three that circle the sum stays level.
#[must_use]
pub fn repeats(voltage: &Voltage, offset_s: f64, from_s: f64, to_s: f64) -> Vec<f64> {
    let (first, last) = voltage.span_s();
    let (from, to) = (from_s.max(first - offset_s), to_s.min(last - offset_s));
    if to.is_nan() || to <= from {
        return Vec::new();
    }
    let square = |k: usize, t: f64| voltage.at(k, t + offset_s).powi(2);
    let swing = |k: &usize| {
        let [low, high] = (0..LOOKS).fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], i| {
            let v = square(*k, from + (to - from) * i as f64 / LOOKS as f64);
            [low.min(v), high.max(v)]
        });
        high - low
    };
    let channels = 0..voltage.channels_v().len();
    let Some(k) = channels.max_by(|a, b| swing(a).total_cmp(&swing(b))) else {
        return Vec::new();
    };
    let Ok(found) = cycles_of(|t| square(k, t), from, to) else {
        return Vec::new();
    };
    let (period, starts) = (found.period_s, found.starts_s);
    if found.broken_s.is_some() || starts.len() < LEAST {
        return Vec::new();
    }
    // from one to the next the voltage has to be the same
    let moved = |pair: &[f64]| -> f64 {
        let at = |i: usize| period * (i as f64 + 0.5) / FINE;
        let step = |i: usize| square(k, pair[0] + at(i)) - square(k, pair[1] + at(i));
        (0..FINE as usize).map(|i| step(i).powi(2)).sum::<f64>() / FINE
    };
    let most = starts.windows(2).map(moved).fold(0.0, f64::max);
    if most.sqrt() > REGULAR * swing(&k) {
        return Vec::new();
    }
    let end = starts.last().map(|s| s + period);
    starts.into_iter().chain(end).collect()
}

/// The cycles of what `square` gives at a time, s.
fn cycles_of(square: impl Fn(f64) -> f64, from: f64, to: f64) -> Result<Cycles, String> {
    // A first look for the period, then a fine one.
    let rises = |step: f64| -> Vec<f64> {
        let count = ((to - from) / step) as usize + 1;
        let q: Vec<f64> = (0..count).map(|i| square(from + step * i as f64)).collect();
        let low = q.iter().copied().fold(f64::INFINITY, f64::min);
        let high = q.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let [down, up] = LEVELS.map(|l| low + l * (high - low));
        let middle = 0.5 * (low + high);
        let mut out = Vec::new();
        let (mut armed, mut crossed) = (true, None);
        for i in 1..count {
            if q[i] < down {
                (armed, crossed) = (true, None);
            }
            if armed && q[i - 1] < middle && q[i] >= middle {
                let share = (middle - q[i - 1]) / (q[i] - q[i - 1]);
                crossed = Some(from + step * (i as f64 - 1.0 + share));
            }
            if armed && q[i] > up {
                out.extend(crossed);
                armed = false;
            }
        }
        out
    };
    let coarse = rises((to - from) / 20_000.0);
    let flat = || {
        "the voltage does not rise and fall at equal distances: there are no cycles to measure a stroke of".to_string()
    };
    if coarse.len() < 2 {
        return Err(flat());
    }
    let mut gaps: Vec<f64> = coarse.windows(2).map(|w| w[1] - w[0]).collect();
    gaps.sort_by(f64::total_cmp);
    let fine = rises((gaps[gaps.len() / 2] / FINE).min((to - from) / 20_000.0));
    if fine.len() < 2 {
        return Err(flat());
    }
    let median = {
        let mut g: Vec<f64> = fine.windows(2).map(|w| w[1] - w[0]).collect();
        g.sort_by(f64::total_cmp);
        g[g.len() / 2]
    };
    let regular = fine
        .windows(2)
        .take_while(|w| ((w[1] - w[0]) / median - 1.0).abs() < REGULAR)
        .count();
    if regular == 0 {
        return Err(flat());
    }
    let broken_s = (regular + 1 < fine.len()).then(|| fine[regular]);
    let period_s = (fine[regular] - fine[0]) / regular as f64;
    // Whole cycles from rise to rise: the fundamental is a projection.
    let omega = 2.0 * std::f64::consts::PI / period_s;
    let count = (FINE as usize) * regular;
    let step = regular as f64 * period_s / count as f64;
    let (mut a, mut b) = (0.0, 0.0);
    for i in 0..count {
        let t = step * (i as f64 + 0.5);
        let q = square(fine[0] + t);
        a += q * (omega * t).cos();
        b += q * (omega * t).sin();
    }
    // q = - A cos(omega (t - t0)): smallest at t0, at most a period before the first rise.
    let mut t0 = (-b).atan2(-a) / omega;
    while t0 > 0.0 {
        t0 -= period_s;
    }
    while t0 <= -period_s {
        t0 += period_s;
    }
    let slack = 0.02 * period_s;
    let starts_s = (0..=regular)
        .map(|i| fine[0] + t0 + period_s * i as f64)
        .filter(|s| *s >= from - slack && s + period_s <= to + slack)
        .collect();
    Ok(Cycles {
        period_s,
        starts_s,
        broken_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn voltage(f: impl Fn(f64) -> f64, seconds: f64) -> Voltage {
        let n = (seconds * 1e3) as usize;
        let time: Vec<f64> = (0..n).map(|i| i as f64 * 1e-3).collect();
        let phi = time.iter().map(|&t| f(t)).collect();
        Voltage::new(time, vec![phi], false)
    }

    #[test]
    fn cycles_of_a_sine_from_rest_begin_where_it_is_smallest() {
        let w = 2.0 * std::f64::consts::PI / 3.0;
        let drive = |t: f64| 2500.0 * (1.0 - (w * (t - 1.0).clamp(0.0, 24.0)).cos());
        let c = cycles(&voltage(drive, 27.0), 0.0, 0.0, 27.0).unwrap();
        assert!((c.period_s - 3.0).abs() < 1e-4, "{}", c.period_s);
        assert_eq!(c.starts_s.len(), 8);
        for (i, s) in c.starts_s.iter().enumerate() {
            assert!((s - 1.0 - 3.0 * i as f64).abs() < 2e-3, "{s}");
        }
        assert_eq!(c.broken_s, None);
    }

    #[test]
    fn a_drive_that_stops_or_never_repeats_is_told() {
        let w = 2.0 * std::f64::consts::PI / 2.0;
        let stops = |t: f64| {
            if t < 9.0 {
                2000.0 * (1.0 - (w * t).cos())
            } else {
                0.0
            }
        };
        let c = cycles(&voltage(stops, 30.0), 0.0, 0.0, 30.0).unwrap();
        assert_eq!(c.starts_s.len(), 5);
        assert!(cycles(&voltage(|_| 3000.0, 10.0), 0.0, 0.0, 10.0).is_err());
        assert!(cycles(&voltage(|t| 100.0 * t, 10.0), 0.0, 0.0, 10.0).is_err());
    }

    #[test]
    fn three_voltages_that_circle_repeat_and_others_do_not() {
        let w = 2.0 * std::f64::consts::PI / 3.0;
        let circle = |t: f64, k: f64| 2000.0 * (1.0 + (w * (t + k)).cos()).sqrt();
        let time: Vec<f64> = (0..20_000).map(|i| f64::from(i) * 1e-3).collect();
        let phi = |k: f64| time.iter().map(|&t| circle(t, k)).collect();
        let three = Voltage::new(time.clone(), vec![phi(0.0), phi(1.0), phi(2.0)], false);
        let c = repeats(&three, 0.0, 0.0, 20.0);
        assert!(c.len() == 6 || c.len() == 7, "{c:?}");
        assert!(c.windows(2).all(|w| (w[1] - w[0] - 3.0).abs() < 0.01));
        let once = |t: f64| 2000.0 * (1.0 - (w * t.min(6.0)).cos());
        assert!(repeats(&voltage(once, 20.0), 0.0, 0.0, 20.0).is_empty());
        let grows = |t: f64| 100.0 * t * (1.0 - (w * t).cos());
        assert!(repeats(&voltage(grows, 20.0), 0.0, 0.0, 20.0).is_empty());
        assert!(repeats(&three, 0.0, 30.0, 40.0).is_empty());
    }
}
