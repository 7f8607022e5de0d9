//! The residual's own low-pass: one symmetric (zero-phase) filter for the recorded and the predicted side
//! alike, kept at every few samples, so that what is kept is nearly independent. Filtering both sides alike
//! leaves no bias, which filtering the motion alone would.

/// Filter and kept samples for one sampling step.
#[derive(Debug, Clone, PartialEq)]
pub struct Decimation {
    /// Taps on one side of the middle one.
    pub half: usize,
    /// Samples left out at both ends.
    pub edge: usize,
    /// One sample in so many is kept.
    pub every: usize,
    /// 2 half + 1 weights that sum to one.
    pub weights: Vec<f64>,
}

/// Lowest cutoff, Hz: slow robots move below it, and the capture noise above it says nothing.
const LOWEST_CUTOFF_HZ: f64 = 5.0;
/// Half length of the filter in periods of the cutoff; with the lowest cutoff 0.32 s, which is also left out
/// at both ends.
const HALF_PERIODS: f64 = 1.6;
/// Distance of the kept samples in periods of the cutoff: 80 ms with the lowest.
const KEEP_PERIODS: f64 = 0.4;
/// What is left out at both ends at least, s.
const EDGE_S: f64 = 0.3;

impl Decimation {
    /// Where the filter for samples `step_s` apart has its half amplitude, Hz.
    pub fn cutoff_hz(step_s: f64, band_hz: f64) -> f64 {
        band_hz.max(LOWEST_CUTOFF_HZ).min(0.2 / step_s)
    }

    /// The filter for samples `step_s` apart: a Hamming-windowed sinc with its half amplitude at `band_hz`,
    /// or at 5 Hz if that is more; none where the rate is too low for one. Where it is longer than the
    /// `samples` that there are, none is kept.
    pub fn new(step_s: f64, band_hz: f64, samples: usize) -> Self {
        let cutoff_hz = Self::cutoff_hz(step_s, band_hz);
        let half = (HALF_PERIODS / (cutoff_hz * step_s)).round() as usize;
        let every = ((KEEP_PERIODS / (cutoff_hz * step_s)).round() as usize).max(1);
        let edge = (EDGE_S / step_s).round() as usize;
        if every == 1 {
            return Decimation {
                half: 0,
                edge,
                every,
                weights: vec![1.0],
            };
        }
        if half >= samples {
            return Decimation {
                half: samples,
                edge,
                every,
                weights: Vec::new(),
            };
        }
        let pi = std::f64::consts::PI;
        let mut weights: Vec<f64> = (0..=2 * half)
            .map(|i| {
                let x = i as f64 - half as f64;
                let window = 0.54 + 0.46 * (pi * x / (half as f64 + 1.0)).cos();
                let angle = 2.0 * pi * cutoff_hz * step_s * x;
                let sinc = if x == 0.0 { 1.0 } else { angle.sin() / angle };
                window * sinc
            })
            .collect();
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Decimation {
            half,
            edge,
            every,
            weights,
        }
    }

    /// Middles of the kept windows among `samples`: those in which every sample is `usable`.
    pub fn centres(&self, usable: &[bool]) -> Vec<usize> {
        let n = usable.len();
        let mut bad = vec![0usize; n + 1];
        for i in 0..n {
            bad[i + 1] = bad[i] + usize::from(!usable[i]);
        }
        (self.half.max(self.edge)..n.saturating_sub(self.half.max(self.edge)))
            .step_by(self.every)
            .filter(|&c| bad[c + self.half + 1] == bad[c - self.half])
            .collect()
    }

    /// The filtered values of `signal` at `centres`: several sums at a time, each in the order of
    /// [`Decimation::apply`], hide each other's latency.
    pub fn apply_all(&self, centres: &[usize], signal: &[f64]) -> Vec<f64> {
        const AT_ONCE: usize = 8;
        // what acts on one chain leaves the others at rest
        if signal.iter().all(|x| *x == 0.0) {
            return vec![0.0; centres.len()];
        }
        let taps = self.weights.len();
        let mut out = Vec::with_capacity(centres.len());
        let (several, rest) = centres.as_chunks::<AT_ONCE>();
        for centres in several {
            let windows = centres.map(|c| &signal[c - self.half..][..taps]);
            let mut sums = [0.0; AT_ONCE];
            for (t, w) in self.weights.iter().enumerate() {
                for (sum, window) in sums.iter_mut().zip(&windows) {
                    *sum += w * window[t];
                }
            }
            out.extend(sums);
        }
        out.extend(rest.iter().map(|&c| self.apply(c, |i| signal[i])));
        out
    }

    /// The filtered value of `signal` at `centre`.
    pub fn apply(&self, centre: usize, signal: impl Fn(usize) -> f64) -> f64 {
        let first = centre - self.half;
        self.weights
            .iter()
            .enumerate()
            .map(|(t, w)| w * signal(first + t))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_slow_motion_and_stops_fast_noise() {
        let d = Decimation::new(0.01, 3.0, 1000);
        let gain = |f: f64| {
            d.apply(500, |i| {
                (2.0 * std::f64::consts::PI * f * (i as f64 - 500.0) * 0.01).cos()
            })
        };
        assert!((gain(0.0) - 1.0).abs() < 1e-12);
        assert!((gain(1.0) - 1.0).abs() < 3e-3, "{}", gain(1.0));
        assert!((gain(5.0) - 0.5).abs() < 0.02, "{}", gain(5.0));
        assert!(gain(8.0).abs() < 0.02 && gain(20.0).abs() < 5e-3);
    }

    #[test]
    fn several_centres_are_filtered_as_each_by_itself() {
        let d = Decimation::new(0.01, 3.0, 1000);
        let signal: Vec<f64> = (0..400).map(|i| ((i * 7919) % 101) as f64 - 50.0).collect();
        let centres: Vec<usize> = (40..=340).step_by(13).collect();
        let each = centres.iter().map(|&c| d.apply(c, |i| signal[i]));
        assert_eq!(d.apply_all(&centres, &signal), each.collect::<Vec<f64>>());
    }

    #[test]
    fn windows_with_an_unusable_sample_are_left_out() {
        let d = Decimation::new(0.01, 3.0, 1000);
        let mut usable = vec![true; 400];
        assert_eq!(d.centres(&usable)[0], 32);
        usable[200] = false;
        assert!(d.centres(&usable).iter().all(|&c| c.abs_diff(200) > 32));
    }
}
