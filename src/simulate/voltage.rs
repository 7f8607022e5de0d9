//! Inputs over time: voltages and payload, with the times at which they jump.

pub use super::integrator::Side;

/// Voltages of the three chains as functions of time (a film sample uses the first). Between two breaks they
/// are smooth enough for the error control to see everything.
pub trait Voltage {
    /// Voltages at `t_s`, V; at a break the limit from the given side.
    fn phi_v(&self, t_s: f64, side: Side) -> [f64; 3];
    /// The first break after `t_s` (infinity where there is none): a jump or a kink that no step may cross.
    fn next_break_s(&self, t_s: f64) -> f64;
    /// The same voltages with their small regular jumps made smooth, where there are any: those of at most
    /// `jump_v2_s2` in phi^2 times the square of the time between them. What is driven moves alike but for a
    /// ripple of that size.
    fn softened(&self, _jump_v2_s2: f64) -> Option<Softened> {
        None
    }
}

/// Smooth voltages given by a function of time.
#[derive(Debug, Clone, Copy)]
pub struct Smooth<F>(pub F);

impl<F: Fn(f64) -> [f64; 3]> Voltage for Smooth<F> {
    fn phi_v(&self, t_s: f64, _side: Side) -> [f64; 3] {
        (self.0)(t_s)
    }

    fn next_break_s(&self, _t_s: f64) -> f64 {
        f64::INFINITY
    }
}

/// What the amplifier does between two samples of its command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Hold {
    /// A straight line.
    #[default]
    Linear,
    /// The last value until the next sample.
    Previous,
}

/// A kink of a piecewise linear voltage above which no step crosses it, V: a sample whose second difference
/// departs by more from its neighbours' mean. Sampled smooth curves and 0.1 V of quantisation stay below.
const KINK_V: f64 = 1.0;

/// How far the times of an even log may differ, of a step: what rounding leaves.
const EVEN: f64 = 1e-3;
/// Step at which an uneven log is read, s.
const UNEVEN_STEP_S: f64 = 1e-3;

/// Sampled voltages; before the first and after the last sample their values are held.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampled {
    start_s: f64,
    step_s: f64,
    phi_v: Vec<[f64; 3]>,
    hold: Hold,
    breaks_s: Vec<f64>,
}

impl Sampled {
    /// Samples every `step_s` from `start_s` on, V.
    ///
    /// # Errors
    /// A sentence when there is no sample, a sample is not finite or the step is not positive.
    pub fn new(
        start_s: f64,
        step_s: f64,
        phi_v: Vec<[f64; 3]>,
        hold: Hold,
    ) -> Result<Self, String> {
        if phi_v.is_empty() {
            return Err("a sampled voltage needs at least one sample".into());
        }
        if !(step_s > 0.0 && step_s.is_finite() && start_s.is_finite()) {
            return Err(format!(
                "a sampled voltage needs a positive step, got {step_s} s from {start_s} s"
            ));
        }
        for (i, phi) in phi_v.iter().enumerate() {
            for (k, phi) in phi.iter().enumerate() {
                if !phi.is_finite() {
                    let chain = k + 1;
                    return Err(format!(
                        "sample {i} of the voltage of chain {chain} is {phi}"
                    ));
                }
            }
        }
        let n = phi_v.len();
        let is_break = |i: usize| match hold {
            Hold::Previous => i > 0 && phi_v[i] != phi_v[i - 1],
            Hold::Linear => Sampled::kinks(&phi_v, i),
        };
        let breaks_s = (0..n)
            .filter(|&i| is_break(i))
            .map(|i| start_s + i as f64 * step_s)
            .collect();
        Ok(Sampled {
            start_s,
            step_s,
            phi_v,
            hold,
            breaks_s,
        })
    }

    /// Samples at rising times, as a log has them. Times that are even but for their rounding are taken as
    /// even; an uneven log is read every millisecond.
    ///
    /// # Errors
    /// A sentence when times do not rise, beside those of [`Sampled::new`].
    pub fn from_log(time_s: &[f64], phi_v: Vec<[f64; 3]>, hold: Hold) -> Result<Self, String> {
        let n = time_s.len();
        if n != phi_v.len() {
            return Err(format!("{n} times for {} voltages", phi_v.len()));
        }
        if let Some(i) = (1..n).find(|&i| time_s[i].is_nan() || time_s[i] <= time_s[i - 1]) {
            return Err(format!(
                "sample {i} of the voltage is at {} s, after one at {} s: times must rise",
                time_s[i],
                time_s[i - 1]
            ));
        }
        if n < 2 {
            return Sampled::new(time_s.first().copied().unwrap_or(0.0), 1.0, phi_v, hold);
        }
        let (first, last) = (time_s[0], time_s[n - 1]);
        let step = (last - first) / (n - 1) as f64;
        if (0..n).all(|i| (time_s[i] - first - i as f64 * step).abs() < EVEN * step) {
            return Sampled::new(first, step, phi_v, hold);
        }
        let count = ((last - first) / UNEVEN_STEP_S).ceil();
        if count > 1e9 {
            return Err(format!(
                "an uneven voltage log of {} s is too long",
                last - first
            ));
        }
        let at = |t: f64| {
            let i = time_s.partition_point(|&x| x <= t).clamp(1, n) - 1;
            if hold == Hold::Previous || i + 1 == n {
                return phi_v[i];
            }
            let f = (t - time_s[i]) / (time_s[i + 1] - time_s[i]);
            [0, 1, 2].map(|k| phi_v[i][k] + f * (phi_v[i + 1][k] - phi_v[i][k]))
        };
        let samples = (0..=count as usize).map(|i| at(first + i as f64 * UNEVEN_STEP_S));
        Sampled::new(first, UNEVEN_STEP_S, samples.collect(), hold)
    }

    /// The samples, V.
    pub fn samples_v(&self) -> &[[f64; 3]] {
        &self.phi_v
    }

    /// Distance of the samples, s.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Time of the first sample, s.
    pub fn start_s(&self) -> f64 {
        self.start_s
    }

    /// Time from the first to the last sample, s.
    pub fn duration_s(&self) -> f64 {
        (self.phi_v.len() - 1) as f64 * self.step_s
    }

    /// What the amplifier does between samples.
    pub fn hold(&self) -> Hold {
        self.hold
    }
}

impl Sampled {
    /// Second difference of chain `k` at sample `i`, departing from the mean of its neighbours by more than a
    /// smooth curve's.
    fn kinks(phi_v: &[[f64; 3]], i: usize) -> bool {
        (0..3).any(|k| {
            let last = phi_v.len() as isize - 1;
            let at = |j: isize| phi_v[j.clamp(0, last) as usize][k];
            let bend = |j: isize| at(j + 1) - 2.0 * at(j) + at(j - 1);
            let i = i as isize;
            (bend(i) - 0.5 * (bend(i - 1) + bend(i + 1))).abs() > KINK_V
        })
    }
}

/// A held voltage without its small jumps. Between two jumps phi^2 is the parabola with the mean of the held
/// value there; at a jump that was made smooth, two parabolas meet at what a cubic through the integral of
/// phi^2 has as its slope. So the impulse of every interval stays, the half sample by which a held voltage
/// lags included.
#[derive(Debug, Clone, PartialEq)]
pub struct Softened {
    start_s: f64,
    step_s: f64,
    /// phi^2 of each held value, V^2.
    mean: Vec<[f64; 3]>,
    /// phi^2 at the beginning of each interval and at its end, V^2.
    ends: Vec<[[f64; 3]; 2]>,
    /// Largest phi^2 of each chain, which no parabola exceeds, V^2.
    most: [f64; 3],
    breaks_s: Vec<f64>,
}

impl Softened {
    fn new(held: &Sampled, jump_v2_s2: f64) -> Option<Self> {
        let phi = &held.phi_v;
        let n = phi.len();
        let mean: Vec<[f64; 3]> = phi.iter().map(|p| p.map(|p| p * p)).collect();
        let most = jump_v2_s2 / held.step_s.powi(2);
        let is_break = |i: usize| {
            let large = |k: usize| (mean[i][k] - mean[i - 1][k]).abs() > most;
            phi[i] != phi[i - 1] && ((0..3).any(large) || Sampled::kinks(phi, i))
        };
        // Runs of intervals between breaks; nothing is gained where every jump is one.
        let mut first = vec![0];
        first.extend((1..n).filter(|&i| is_break(i)));
        if 2 * (first.len() - 1) > held.breaks_s.len() || held.breaks_s.is_empty() {
            return None;
        }
        let mut ends: Vec<[[f64; 3]; 2]> = mean.iter().map(|m| [*m, *m]).collect();
        for (r, &begin) in first.iter().enumerate() {
            let end = first.get(r + 1).copied().unwrap_or(n);
            let f = &mean[begin..end];
            let m = f.len();
            // Value at the knot before interval j of the run: exact for a parabola, for a cubic where both
            // sides have two intervals.
            let knot = |j: usize, k: usize| {
                let g = |i: usize| f[i][k];
                match (j, m - j) {
                    (_, _) if m == 1 => g(0),
                    (0, 2) => 1.5 * g(0) - 0.5 * g(1),
                    (0, _) => (11.0 * g(0) - 7.0 * g(1) + 2.0 * g(2)) / 6.0,
                    (2, 0) => 1.5 * g(1) - 0.5 * g(0),
                    (_, 0) => (11.0 * g(m - 1) - 7.0 * g(m - 2) + 2.0 * g(m - 3)) / 6.0,
                    (1, _) | (_, 1) => 0.5 * (g(j - 1) + g(j)),
                    _ => (7.0 * (g(j - 1) + g(j)) - g(j - 2) - g(j + 1)) / 12.0,
                }
            };
            for j in 0..m {
                ends[begin + j] = [j, j + 1].map(|j| [0, 1, 2].map(|k| knot(j, k)));
            }
        }
        let breaks_s = first[1..].iter();
        let most = [0, 1, 2].map(|k| mean.iter().fold(0.0, |most: f64, m| most.max(m[k])));
        Some(Softened {
            most,
            start_s: held.start_s,
            step_s: held.step_s,
            breaks_s: breaks_s
                .map(|&i| held.start_s + i as f64 * held.step_s)
                .collect(),
            mean,
            ends,
        })
    }
}

impl Voltage for Softened {
    fn phi_v(&self, t_s: f64, side: Side) -> [f64; 3] {
        let last = self.mean.len() - 1;
        let place = (t_s - self.start_s) / self.step_s;
        if place < 0.0 || place.is_nan() {
            return self.mean[0].map(f64::sqrt);
        }
        let near = place.round();
        let at_knot = (place - near).abs() < 1e-6;
        let (i, s) = match (at_knot, side) {
            (true, Side::Before) if near >= 1.0 => (near as usize - 1, 1.0),
            (true, _) => (near as usize, 0.0),
            (false, _) => (place as usize, place.fract()),
        };
        if i >= last {
            return self.mean[last].map(f64::sqrt);
        }
        let [a, b] = self.ends[i];
        // a + c1 s + c2 s^2 with value b at 1 and the mean m
        [0, 1, 2].map(|k| {
            let m = self.mean[i][k];
            let c1 = 6.0 * m - 4.0 * a[k] - 2.0 * b[k];
            let c2 = 3.0 * (a[k] + b[k] - 2.0 * m);
            (a[k] + s * (c1 + s * c2)).clamp(0.0, self.most[k]).sqrt()
        })
    }

    fn next_break_s(&self, t_s: f64) -> f64 {
        let passed = |&b: &f64| b <= t_s + 1e-6 * self.step_s;
        let next = self.breaks_s.partition_point(passed);
        self.breaks_s.get(next).copied().unwrap_or(f64::INFINITY)
    }
}

impl Voltage for Sampled {
    fn softened(&self, jump_v2_s2: f64) -> Option<Softened> {
        match self.hold {
            Hold::Linear => None,
            Hold::Previous => Softened::new(self, jump_v2_s2),
        }
    }

    fn phi_v(&self, t_s: f64, side: Side) -> [f64; 3] {
        let last = self.phi_v.len() - 1;
        let place = (t_s - self.start_s) / self.step_s;
        if place <= 0.0 || place.is_nan() {
            return self.phi_v[0];
        }
        if place > last as f64 + 0.5 {
            return self.phi_v[last];
        }
        match self.hold {
            Hold::Linear => {
                let i = (place as usize).min(last);
                let f = (place - i as f64).clamp(0.0, 1.0);
                let (from, to) = (self.phi_v[i], self.phi_v[(i + 1).min(last)]);
                [0, 1, 2].map(|k| from[k] + f * (to[k] - from[k]))
            }
            Hold::Previous => {
                let near = place.round();
                let i = if (place - near).abs() < 1e-6 {
                    match side {
                        Side::Before => (near as usize).saturating_sub(1),
                        Side::After => near as usize,
                    }
                } else {
                    place as usize
                };
                self.phi_v[i.min(last)]
            }
        }
    }

    fn next_break_s(&self, t_s: f64) -> f64 {
        let next = self
            .breaks_s
            .partition_point(|&b| b <= t_s + 1e-6 * self.step_s);
        self.breaks_s.get(next).copied().unwrap_or(f64::INFINITY)
    }
}

/// The mass on the end effector over time, kg: a value at the start and steps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Payload {
    start_kg: f64,
    steps: Vec<(f64, f64)>,
}

impl Payload {
    /// The same mass all the time.
    pub fn constant(mass_kg: f64) -> Self {
        Payload {
            start_kg: mass_kg,
            steps: Vec::new(),
        }
    }

    /// `start_kg` and then (time s, mass kg) steps. A mass that arrives or leaves does so with the velocity
    /// of the end effector.
    ///
    /// # Errors
    /// A sentence when the times do not rise or a mass is not a number at or above zero.
    pub fn steps(start_kg: f64, steps: Vec<(f64, f64)>) -> Result<Self, String> {
        let mut last = f64::NEG_INFINITY;
        for &(t, m) in std::iter::once(&(last, start_kg)).chain(&steps) {
            if !(m >= 0.0 && m.is_finite()) {
                return Err(format!("a payload of {m} kg"));
            }
            if t.is_nan() || (t <= last && last > f64::NEG_INFINITY) {
                return Err(format!(
                    "payload steps must rise in time: {t} s follows {last} s"
                ));
            }
            last = t;
        }
        Ok(Payload { start_kg, steps })
    }

    /// Mass at `t_s`, kg; at a step the value on the given side.
    pub fn mass_kg(&self, t_s: f64, side: Side) -> f64 {
        let passed = self.steps.partition_point(|s| match side {
            Side::Before => s.0 < t_s,
            Side::After => s.0 <= t_s,
        });
        match passed {
            0 => self.start_kg,
            n => self.steps[n - 1].1,
        }
    }

    /// The first step after `t_s`, infinity where there is none.
    pub fn next_break_s(&self, t_s: f64) -> f64 {
        let next = self.steps.partition_point(|s| s.0 <= t_s);
        self.steps.get(next).map_or(f64::INFINITY, |s| s.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn breaks_are_jumps_and_kinks_only() {
        let sine: Vec<[f64; 3]> = (0..3000)
            .map(|i| [2500.0 * (1.0 - (2.0 * std::f64::consts::PI * i as f64 * 1e-3).cos()); 3])
            .collect();
        let smooth = Sampled::new(0.0, 1e-3, sine, Hold::Linear).unwrap();
        assert_eq!(smooth.next_break_s(0.0), f64::INFINITY);
        let step: Vec<[f64; 3]> = (0..100)
            .map(|i| [if i < 50 { 0.0 } else { 800.0 }; 3])
            .collect();
        let linear = Sampled::new(0.0, 1e-3, step.clone(), Hold::Linear).unwrap();
        assert!((linear.next_break_s(0.0) - 0.048).abs() < 1.1e-3);
        let held = Sampled::new(0.0, 1e-3, step, Hold::Previous).unwrap();
        let at = held.next_break_s(0.0);
        assert_eq!(at, 0.05);
        assert_eq!(held.phi_v(at, Side::Before)[0], 0.0);
        assert_eq!(held.phi_v(at, Side::After)[0], 800.0);
        assert_eq!(held.next_break_s(at), f64::INFINITY);
    }

    #[test]
    fn logs_are_even_but_for_rounding_or_read_every_millisecond() {
        let phi: Vec<[f64; 3]> = (0..7).map(|i| [100.0 * f64::from(i); 3]).collect();
        let rounded: Vec<f64> = (0..7)
            .map(|i| (1e6 * f64::from(i) / 300.0).round() / 1e6)
            .collect();
        let even = Sampled::from_log(&rounded, phi.clone(), Hold::Linear).unwrap();
        assert_eq!(even.samples_v(), phi);
        let mut jitter = rounded.clone();
        jitter[3] += 1.5e-3;
        let uneven = Sampled::from_log(&jitter, phi.clone(), Hold::Linear).unwrap();
        assert_eq!(uneven.step_s(), 1e-3);
        for t in [0.002, 0.0105, 0.0115, 0.0155] {
            let i = jitter.partition_point(|&x| x <= t) - 1;
            let want = 100.0 * (i as f64 + (t - jitter[i]) / (jitter[i + 1] - jitter[i]));
            // Within a millisecond of a knot the straight lines are cut.
            assert!(
                (uneven.phi_v(t, Side::Before)[0] - want).abs() < 15.0,
                "{t}"
            );
        }
        jitter[3] = jitter[2];
        let error = Sampled::from_log(&jitter, phi, Hold::Linear).unwrap_err();
        assert!(error.contains("must rise"), "{error}");
    }

    #[test]
    fn payload_steps() {
        let p = Payload::steps(0.001, vec![(1.0, 0.003), (2.0, 0.0)]).unwrap();
        assert_eq!(p.mass_kg(1.0, Side::Before), 0.001);
        assert_eq!(p.mass_kg(1.0, Side::After), 0.003);
        assert_eq!(p.next_break_s(1.0), 2.0);
        assert!(Payload::steps(0.0, vec![(1.0, 0.0), (1.0, 0.0)]).is_err());
        assert!(Payload::steps(-1.0, vec![]).is_err());
    }
}
