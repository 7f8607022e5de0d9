//! Applied voltages on their own clock, V.

use std::sync::OnceLock;

/// Commanded (or measured) voltages of the channels of one recording.
#[derive(Debug, Clone)]
pub struct Voltage {
    time_s: Vec<f64>,
    channels_v: Vec<Vec<f64>>,
    hold_previous: bool,
    /// Integral of phi^2 of each channel from the first sample, V^2 s, once it has been asked for.
    integral_v2_s: Vec<OnceLock<Vec<f64>>>,
}

impl Voltage {
    /// Voltages `channels_v` (V) at rising times `time_s` (s, on the voltage clock). Between samples the
    /// voltage is linear, or the last value with `hold_previous`.
    ///
    /// # Panics
    /// When the lengths differ or there is no sample.
    pub fn new(time_s: Vec<f64>, channels_v: Vec<Vec<f64>>, hold_previous: bool) -> Self {
        assert!(!time_s.is_empty());
        assert!(channels_v.iter().all(|c| c.len() == time_s.len()));
        Voltage {
            integral_v2_s: channels_v.iter().map(|_| OnceLock::new()).collect(),
            time_s,
            channels_v,
            hold_previous,
        }
    }

    /// Integral of phi^2 of a channel from the first sample to each, V^2 s.
    fn integrals(&self, channel: usize) -> &[f64] {
        self.integral_v2_s[channel].get_or_init(|| {
            let (c, time_s) = (&self.channels_v[channel], &self.time_s);
            let mut sum = 0.0;
            let mut out = Vec::with_capacity(c.len());
            out.push(0.0);
            for i in 1..c.len() {
                let (a, b) = (c[i - 1], if self.hold_previous { c[i - 1] } else { c[i] });
                sum += (a * a + a * b + b * b) / 3.0 * (time_s[i] - time_s[i - 1]);
                out.push(sum);
            }
            out
        })
    }

    /// The same voltages at other times, which have to rise as well.
    ///
    /// # Panics
    /// See [`Voltage::new`].
    #[must_use]
    pub fn retimed(&self, time: impl Fn(f64) -> f64) -> Self {
        let time_s = self.time_s.iter().map(|t| time(*t)).collect();
        Voltage::new(time_s, self.channels_v.clone(), self.hold_previous)
    }

    /// The samples that tell the voltage in these ranges of time (s, rising), and the first and the last.
    pub(super) fn within(&self, ranges_s: &[[f64; 2]]) -> Self {
        let last = self.time_s.len() - 1;
        let mut keep = vec![0];
        for [from, to] in ranges_s {
            let first = self.time_s.partition_point(|t| t <= from).max(1) - 1;
            let end = self.time_s.partition_point(|t| t < to).min(last);
            keep.extend(
                (first..=end)
                    .filter(|i| *i > keep[keep.len() - 1])
                    .collect::<Vec<_>>(),
            );
        }
        if keep[keep.len() - 1] < last {
            keep.push(last);
        }
        let pick = |list: &[f64]| keep.iter().map(|&i| list[i]).collect();
        Voltage::new(
            pick(&self.time_s),
            self.channels_v.iter().map(|c| pick(c)).collect(),
            self.hold_previous,
        )
    }

    /// Times of the samples, s.
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// The channels, V.
    pub fn channels_v(&self) -> &[Vec<f64>] {
        &self.channels_v
    }

    /// Whether the last value holds until the next sample; otherwise the voltage is linear between samples.
    pub fn holds_previous(&self) -> bool {
        self.hold_previous
    }

    /// Times between which the voltage is known, s.
    pub fn span_s(&self) -> (f64, f64) {
        (self.time_s[0], self.time_s[self.time_s.len() - 1])
    }

    /// The sample at or before `t`, and how far `t` lies on the way to the next one.
    fn locate(&self, t: f64) -> (usize, f64) {
        let last = self.time_s.len() - 1;
        if t <= self.time_s[0] || last == 0 {
            return (0, 0.0);
        }
        if t >= self.time_s[last] {
            return (last, 0.0);
        }
        // logs are nearly equidistant: guess, then search where the guess fails
        let guess =
            ((t - self.time_s[0]) / (self.time_s[last] - self.time_s[0]) * last as f64) as usize;
        let i = if guess < last && self.time_s[guess] <= t && t < self.time_s[guess + 1] {
            guess
        } else {
            self.time_s.partition_point(|&x| x <= t) - 1
        };
        (
            i,
            (t - self.time_s[i]) / (self.time_s[i + 1] - self.time_s[i]),
        )
    }

    /// Voltage of `channel` at `t` (s, voltage clock), V; the end values hold outside the span.
    pub fn at(&self, channel: usize, t: f64) -> f64 {
        self.between(channel, self.locate(t))
    }

    /// Voltage of `channel` at a place of [`Voltage::locate`], V.
    fn between(&self, channel: usize, (i, f): (usize, f64)) -> f64 {
        let c = &self.channels_v[channel];
        if self.hold_previous || f == 0.0 {
            c[i]
        } else {
            c[i] + f * (c[i + 1] - c[i])
        }
    }

    /// Integral of phi^2 of `channel` from the first sample to `t`, V^2 s, and the voltage there, V.
    fn integral(&self, channel: usize, t: f64) -> (f64, f64) {
        let c = &self.channels_v[channel];
        let last = c.len() - 1;
        if t < self.time_s[0] {
            return ((t - self.time_s[0]) * c[0] * c[0], c[0]);
        }
        if t > self.time_s[last] {
            let beyond = (t - self.time_s[last]) * c[last] * c[last];
            return (self.integrals(channel)[last] + beyond, c[last]);
        }
        let (i, f) = self.locate(t);
        let (a, b) = (c[i], self.between(channel, (i, f)));
        let since = (a * a + a * b + b * b) / 3.0 * (t - self.time_s[i]);
        (self.integrals(channel)[i] + since, b)
    }

    /// Root of the mean of phi^2 of `channel` over `step` around `t` (s, voltage clock), V, with the sign of phi
    /// there. Where the drive jumps between two steps the mean square has its area and its moment.
    pub fn mean(&self, channel: usize, t: f64, step: f64) -> f64 {
        let to = |t: f64| self.integral(channel, t).0;
        let square = (to(t + 0.5 * step) - to(t - 0.5 * step)) / step;
        square.max(0.0).sqrt().copysign(self.at(channel, t))
    }

    /// phi^2 of `channel` at `count` times from `start` in steps of `step` (s, voltage clock), V^2, and its
    /// derivative with respect to a shift of the clock, V^2/s.
    ///
    /// Each value is the mean over one step, sharpened by a 24th of its second difference: the point value to
    /// fourth order for a smooth drive, and right in area where the drive jumps between two captured frames.
    pub fn squared(
        &self,
        channel: usize,
        start: f64,
        step: f64,
        count: usize,
    ) -> (Vec<f64>, Vec<f64>) {
        let edge = |i: f64| start + (i - 0.5) * step;
        let mut integral = Vec::with_capacity(count + 3);
        let mut value = Vec::with_capacity(count + 3);
        for i in 0..count + 3 {
            let t = edge(i as f64 - 1.0);
            let (sum, volts) = self.integral(channel, t);
            integral.push(sum);
            value.push(volts * volts);
        }
        let mean = |v: &[f64], i: usize| (v[i + 1] - v[i]) / step;
        let sharpen = |v: &[f64]| -> Vec<f64> {
            (0..count)
                .map(|i| {
                    let (before, at, after) = (mean(v, i), mean(v, i + 1), mean(v, i + 2));
                    at - (before - 2.0 * at + after) / 24.0
                })
                .collect()
        };
        (sharpen(&integral), sharpen(&value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_keep_the_area_and_the_moment_of_a_jump() {
        // up at 1.0373 s, down at 3.0121 s
        let time = vec![0.0, 1.0373, 3.0121, 4.0];
        let v = Voltage::new(time, vec![vec![0.0, -2000.0, 0.0, 0.0]], true);
        let step = 0.05;
        let (mut area, mut moment) = (0.0, 0.0);
        for i in 1..80 {
            let t = i as f64 * step;
            let mean = v.mean(0, t, step);
            assert!(mean <= 0.0);
            area += mean * mean * step;
            moment += mean * mean * step * t;
        }
        let [from, to]: [f64; 2] = [1.0373, 3.0121];
        assert!((area / 4e6 - (to - from)).abs() < 1e-9);
        let middle = moment / area;
        assert!((middle - 0.5 * (from + to)).abs() < 1e-2 * step, "{middle}");
    }

    #[test]
    fn squared_is_the_point_value_of_a_smooth_drive_and_the_area_of_a_jump() {
        let time: Vec<f64> = (0..4000).map(|i| i as f64 * 1e-3).collect();
        let drive = |t: f64| 2000.0 + 1500.0 * (2.0 * std::f64::consts::PI * 2.0 * t).sin();
        let v = Voltage::new(
            time.clone(),
            vec![time.iter().map(|&t| drive(t)).collect()],
            false,
        );
        let (squared, slope) = v.squared(0, 0.5, 0.01, 200);
        for i in 0..200 {
            let t = 0.5 + 0.01 * i as f64;
            assert!((squared[i].sqrt() - drive(t)).abs() < 0.15, "{i}");
            let want = (drive(t + 1e-4).powi(2) - drive(t - 1e-4).powi(2)) / 2e-4;
            assert!(
                (slope[i] - want).abs() < 2e-3 * 1.2e8,
                "{i} {} {want}",
                slope[i]
            );
        }
        let step = Voltage::new(
            vec![0.0, 0.5034, 1.0],
            vec![vec![0.0, 1000.0, 1000.0]],
            true,
        );
        let (squared, _) = step.squared(0, 0.3, 0.01, 50);
        let area: f64 = squared.iter().sum::<f64>() * 0.01;
        assert!((area - 1e6 * (0.795 - 0.5034)).abs() < 1.0, "{area}");
    }
}
