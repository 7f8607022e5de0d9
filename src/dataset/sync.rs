//! The offset and the skew between the voltage clock and the motion clock, from what both recorded: events,
//! or a channel that was logged beside the motion and shows a voltage of the other log.
//!
//! ```text
//! t_voltage = t_motion + offset + skew (t_motion - t_middle)
//! ```
//!
//! The offset is that in the middle of the recording, where it is known best. A shared channel is cut into
//! windows; in each the shift is sought at which gain and level times the voltage fit the channel best. The
//! windows' shifts are then events, each with a weight. Standard errors come from how far the events scatter
//! about the line, never from less than their own: that of the channel's noise and that of jumps, which a log
//! that is linear between its samples knows to a sampling step only.

use super::voltage::Voltage;

/// One event on both clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// On the motion clock, s.
    pub motion_s: f64,
    /// On the voltage clock, s.
    pub voltage_s: f64,
    /// Standard error of their difference where it is known, s.
    pub std_error_s: Option<f64>,
}

/// Offset and skew between two clocks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clocks {
    /// Voltage clock minus motion clock at `middle_s`, s.
    pub offset_s: f64,
    /// Its standard error, s; `None` where one event alone tells it.
    pub offset_std_error_s: Option<f64>,
    /// How much faster the voltage clock runs, a pure number; 0 where the data do not tell it from 0.
    pub skew: f64,
    /// Its standard error; `None` where there are fewer than three events.
    pub skew_std_error: Option<f64>,
    /// Where the offset is that, on the motion clock, s.
    pub middle_s: f64,
    /// Events, or windows, that were used.
    pub events: usize,
    /// Half the width of the 95 % interval of the offset, in standard errors.
    pub quantile: f64,
}

/// A skew is taken for one when it is this many standard errors from none.
const SIGNIFICANT: f64 = 3.0;

impl Clocks {
    /// The line through events: `None` when there is none.
    #[must_use]
    pub fn from_events(events: &[Event]) -> Option<Self> {
        let n = events.len();
        if n == 0 {
            return None;
        }
        let weight = |e: &Event| e.std_error_s.map_or(1.0, |s| s.powi(-2));
        let total: f64 = events.iter().map(weight).sum();
        let mean = |f: &dyn Fn(&Event) -> f64| {
            events.iter().map(|e| weight(e) * f(e)).sum::<f64>() / total
        };
        let middle_s = mean(&|e| e.motion_s);
        let level = mean(&|e| e.voltage_s - e.motion_s);
        let spread: f64 = events
            .iter()
            .map(|e| weight(e) * (e.motion_s - middle_s).powi(2))
            .sum();
        let known = events.iter().all(|e| e.std_error_s.is_some());
        // the scatter about a line of so many parameters, in units of the weights
        let scatter = |slope: f64, parameters: usize| -> Option<f64> {
            let free = n.checked_sub(parameters).filter(|f| *f > 0)?;
            let sum: f64 = events
                .iter()
                .map(|e| {
                    let line = level + slope * (e.motion_s - middle_s);
                    weight(e) * (e.voltage_s - e.motion_s - line).powi(2)
                })
                .sum();
            let found = sum / free as f64;
            Some(if known { found.max(1.0) } else { found })
        };
        let mut skew = 0.0;
        let mut skew_std_error = None;
        let mut parameters = 1;
        if n >= 3 && spread > 0.0 {
            let slope = events
                .iter()
                .map(|e| weight(e) * (e.motion_s - middle_s) * (e.voltage_s - e.motion_s - level))
                .sum::<f64>()
                / spread;
            let error = scatter(slope, 2).map(|s| (s / spread).sqrt());
            skew_std_error = error;
            if error.is_some_and(|e| slope.abs() > SIGNIFICANT * e) {
                skew = slope;
                parameters = 2;
            }
        }
        let offset_std_error_s = scatter(skew, parameters)
            .map(|s| (s / total).sqrt())
            .or_else(|| known.then(|| total.powf(-0.5)));
        let free = n.saturating_sub(parameters);
        Some(Clocks {
            offset_s: level,
            offset_std_error_s,
            skew,
            skew_std_error,
            middle_s,
            events: n,
            quantile: student(free),
        })
    }

    /// From a channel on the motion clock that shows channel `chain` (from 0) of `voltage` with any gain and
    /// level. `None` when no part of it resembles the voltage.
    #[must_use]
    pub fn from_shared(
        time_s: &[f64],
        values: &[f64],
        voltage: &Voltage,
        chain: usize,
    ) -> Option<Self> {
        let seen: Vec<(f64, f64)> = time_s
            .iter()
            .zip(values)
            .filter(|(t, v)| t.is_finite() && v.is_finite())
            .map(|(t, v)| (*t, *v))
            .collect();
        let coarse = coarse_shift(&seen, voltage, chain)?;
        let per_window = (seen.len() / WINDOWS).max(MIN_WINDOW);
        let events: Vec<Event> = seen
            .chunks(per_window)
            .filter(|w| w.len() >= MIN_WINDOW / 2)
            .filter_map(|w| window_shift(w, voltage, chain, coarse))
            .collect();
        Clocks::from_events(&events)
    }

    /// A voltage on the clock that has the offset and no skew.
    #[must_use]
    pub fn without_skew(&self, voltage: &Voltage) -> Voltage {
        if self.skew == 0.0 {
            return voltage.clone();
        }
        voltage.retimed(|t| {
            let motion = self.middle_s + (t - self.middle_s - self.offset_s) / (1.0 + self.skew);
            motion + self.offset_s
        })
    }
}

/// Windows that a shared channel is cut into, and the fewest samples of one.
const WINDOWS: usize = 16;
const MIN_WINDOW: usize = 64;
/// How far a window's shift may lie from the whole channel's, s.
const REACH_S: f64 = 0.05;

/// The two-sided 95 % quantile of Student's distribution.
fn student(free: usize) -> f64 {
    use statrs::distribution::{ContinuousCDF, StudentsT};
    if free == 0 {
        return f64::INFINITY;
    }
    StudentsT::new(0.0, 1.0, free as f64).map_or(1.96, |t| t.inverse_cdf(0.975))
}

/// Sum of squares that is left of the channel, the gain's square times the drive's, both by least squares of
/// level and gain.
fn left_over(window: &[(f64, f64)], voltage: &Voltage, chain: usize, shift: f64) -> (f64, f64) {
    let n = window.len() as f64;
    let drive: Vec<f64> = window
        .iter()
        .map(|(t, _)| voltage.at(chain, t + shift))
        .collect();
    let mean_y = window.iter().map(|w| w.1).sum::<f64>() / n;
    let mean_v = drive.iter().sum::<f64>() / n;
    let (mut yy, mut vv, mut yv) = (0.0, 0.0, 0.0);
    for ((_, y), v) in window.iter().zip(&drive) {
        let (y, v) = (y - mean_y, v - mean_v);
        yy += y * y;
        vv += v * v;
        yv += y * v;
    }
    let explained = if vv > 0.0 { yv * yv / vv } else { 0.0 };
    (yy - explained, explained)
}

/// The shift of the whole channel to a few milliseconds.
fn coarse_shift(seen: &[(f64, f64)], voltage: &Voltage, chain: usize) -> Option<f64> {
    let (first, last) = (seen.first()?.0, seen.last()?.0);
    let (v_first, _) = voltage.span_s();
    // a thousand points of the channel tell the lag to 5 ms; their distance need not be even finer
    let stride = (seen.len() / 1000).max(1);
    let thin: Vec<(f64, f64)> = seen.iter().step_by(stride).copied().collect();
    if last <= first {
        return None;
    }
    let mut best: Option<(f64, f64)> = None;
    let reach = (super::OFFSET_SEARCH_S / LAG_S) as i64;
    for base in [0.0, v_first - first] {
        for lag in -reach..=reach {
            let shift = base + lag as f64 * LAG_S;
            let (left, explained) = left_over(&thin, voltage, chain, shift);
            let share = explained / (left + explained);
            if share.is_finite() && best.is_none_or(|b| share > b.0) {
                best = Some((share, shift));
            }
        }
    }
    best.filter(|b| b.0 > 0.25).map(|b| b.1)
}

const LAG_S: f64 = 0.005;

/// The shift of one window, with its standard error; `None` where the window does not tell it.
fn window_shift(
    window: &[(f64, f64)],
    voltage: &Voltage,
    chain: usize,
    coarse: f64,
) -> Option<Event> {
    let (first, last) = voltage.span_s();
    let known: Vec<(f64, f64)> = window
        .iter()
        .copied()
        .filter(|(t, _)| (first..=last).contains(&(t + coarse)))
        .collect();
    if known.len() < MIN_WINDOW / 2 {
        return None;
    }
    let whole = fitted_shift(&known, voltage, chain, coarse, REACH_S)?;
    let jumps = jump_variance_s2(
        voltage,
        chain,
        known[0].0 + whole.0,
        known[known.len() - 1].0 + whole.0,
    );
    // beside the jumps the log is exact: where enough moves there, that part alone tells more
    let smooth = beside_jumps(&known, voltage, chain, whole.0);
    let still = (smooth.len() < known.len() && smooth.len() >= MIN_WINDOW / 2)
        .then(|| fitted_shift(&smooth, voltage, chain, whole.0, 0.1 * REACH_S))
        .flatten();
    let (at, variance) = [Some((whole.0, whole.1 + jumps)), still]
        .into_iter()
        .flatten()
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let std_error = variance.sqrt();
    let centre = known.iter().map(|(t, _)| t).sum::<f64>() / known.len() as f64;
    (std_error.is_finite() && std_error < 5e-3).then_some(Event {
        motion_s: centre,
        voltage_s: centre + at,
        std_error_s: Some(std_error.max(1e-7)),
    })
}

/// The shift within `reach` of `near` at which the voltage explains the samples best, s, and its variance
/// from the noise that is left, s^2; `None` at the edge, and where less than half is explained.
fn fitted_shift(
    samples: &[(f64, f64)],
    voltage: &Voltage,
    chain: usize,
    near: f64,
    reach: f64,
) -> Option<(f64, f64)> {
    let cost = |shift: f64| left_over(samples, voltage, chain, shift).0;
    // the lowest of a comb, then ever finer ones around it
    let (mut at, mut step) = (near, 2e-3);
    let mut teeth = (reach / step) as i64;
    for _ in 0..5 {
        let best = (-teeth..=teeth)
            .map(|i| at + i as f64 * step)
            .min_by(|a, b| cost(*a).total_cmp(&cost(*b)))?;
        at = best;
        step /= 4.0;
        teeth = 5;
    }
    if (at - near).abs() > 0.98 * reach {
        return None;
    }
    let (left, explained) = left_over(samples, voltage, chain, at);
    if explained < 0.5 * (left + explained) {
        return None;
    }
    // Gauss-Newton: the variance of a shift is that of the rest over the squared slope of the fitted drive
    let n = samples.len() as f64;
    let (mut vv, mut ss) = (0.0, 0.0);
    let mean = samples
        .iter()
        .map(|(t, _)| voltage.at(chain, t + at))
        .sum::<f64>()
        / n;
    for (t, _) in samples {
        let v = |d: f64| voltage.at(chain, t + at + d);
        vv += (v(0.0) - mean).powi(2);
        ss += ((v(1e-3) - v(-1e-3)) / 2e-3).powi(2);
    }
    let gain_squared = explained / vv;
    Some((
        at,
        left.max(1e-12 * explained) / (n - 3.0) / (gain_squared * ss),
    ))
}

/// A change between two samples of the log is a jump when its square is this many times the median's.
const JUMP: f64 = 100.0;

/// The samples that lie farther than two samples of the log from any jump; all where nothing moves between
/// the jumps.
fn beside_jumps(
    samples: &[(f64, f64)],
    voltage: &Voltage,
    chain: usize,
    shift: f64,
) -> Vec<(f64, f64)> {
    let (times, values) = (voltage.time_s(), &voltage.channels_v()[chain]);
    let from = times.partition_point(|t| *t < samples[0].0 + shift).max(1);
    let to = times.partition_point(|t| *t <= samples[samples.len() - 1].0 + shift);
    let changes: Vec<f64> = (from..to)
        .map(|i| (values[i] - values[i - 1]).powi(2))
        .collect();
    if changes.is_empty() {
        return samples.to_vec();
    }
    let mut sorted = changes.clone();
    sorted.sort_by(f64::total_cmp);
    let limit = JUMP * sorted[sorted.len() / 2];
    let jumps: Vec<(f64, f64)> = changes
        .iter()
        .zip(from..)
        .filter(|(c, _)| limit > 0.0 && **c > limit)
        .map(|(_, i)| {
            (
                times[i.saturating_sub(3)],
                times[(i + 2).min(times.len() - 1)],
            )
        })
        .collect();
    samples
        .iter()
        .filter(|(t, _)| !jumps.iter().any(|(a, b)| (*a..=*b).contains(&(t + shift))))
        .copied()
        .collect()
}

/// What the log's sampling leaves unknown of the shift, s^2: a jump lies anywhere between two samples,
/// evenly, and as many of them count as carry the squared changes (their participation number). A smooth
/// drive is carried by all its samples.
fn jump_variance_s2(voltage: &Voltage, chain: usize, first: f64, last: f64) -> f64 {
    if voltage.holds_previous() {
        return 0.0;
    }
    let (times, values) = (voltage.time_s(), &voltage.channels_v()[chain]);
    let from = times.partition_point(|t| *t < first);
    let to = times.partition_point(|t| *t <= last);
    let (mut second, mut fourth, mut weighted) = (0.0, 0.0, 0.0);
    for i in from + 1..to {
        let change = (values[i] - values[i - 1]).powi(2);
        second += change;
        fourth += change * change;
        weighted += change * (times[i] - times[i - 1]).powi(2);
    }
    if second > 0.0 {
        weighted / second / 12.0 * fourth / (second * second)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_through_events() {
        let event = |t: f64, d: f64| Event {
            motion_s: t,
            voltage_s: t + d,
            std_error_s: None,
        };
        assert_eq!(Clocks::from_events(&[]), None);
        let one = Clocks::from_events(&[event(3.0, 0.5)]).unwrap();
        assert_eq!((one.offset_s, one.offset_std_error_s), (0.5, None));
        let exact: Vec<Event> = (0..5)
            .map(|i| {
                event(
                    10.0 * f64::from(i),
                    0.25 + 1e-4 * (10.0 * f64::from(i) - 20.0),
                )
            })
            .collect();
        let c = Clocks::from_events(&exact).unwrap();
        assert!((c.skew - 1e-4).abs() < 1e-12 && (c.offset_s - 0.25).abs() < 1e-12);
        assert_eq!(c.middle_s, 20.0);
        // scatter without a trend is no skew
        let flat = [0.1, -0.1, 0.1, -0.1, 0.1, -0.1];
        let scattered: Vec<Event> = flat
            .iter()
            .zip(0..)
            .map(|(d, i)| event(f64::from(i), *d))
            .collect();
        let c = Clocks::from_events(&scattered).unwrap();
        assert_eq!(c.skew, 0.0);
        assert!((c.offset_std_error_s.unwrap() - (0.06f64 / 5.0 / 6.0).sqrt()).abs() < 1e-12);
    }
}
