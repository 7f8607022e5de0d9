//! The capture system filters and delays positions: a second-order low-pass of damping 0.7 and a pure delay
//! of rho tau, whose inverse is u(t) = (u_m + 1.4 tau u_m' + tau^2 u_m'')(t + rho tau). `delay` is what slow
//! motion lags by, (1.4 + rho) tau; `pure` is rho, at most 1: a delay that were free would take the place of
//! every clock offset.

use super::{Effect, Exercise, Part, Quantity, Reach, Reading, Seen, Site, shape, size};
use crate::kinematics::Vec3;

pub struct MocapLag;

/// Damping of the low-pass, twice: delay over tau.
const DELAY_PER_TAU: f64 = 1.4;

/// The time constant of a lag with these values, s.
fn tau_s(v: &[f64]) -> f64 {
    v[0] / (DELAY_PER_TAU + v[1])
}

/// u_m + 1.4 tau u_m' + tau^2 u_m'' = u, from rest at the first position, then read rho tau earlier; u is a
/// straight line between samples, and the step is split until tau is many of them.
fn lagged(v: &[f64], motion: &mut Reading) {
    if v[0] == 0.0 {
        return;
    }
    let tau = tau_s(v);
    let (delay_s, square) = (DELAY_PER_TAU * tau, tau * tau);
    let parts = (40.0 * motion.step_s / delay_s).ceil().max(4.0);
    let h = motion.step_s / parts;
    for axis in 0..3 {
        let truth: Vec<f64> = motion.position_m.iter().map(|u| u[axis]).collect();
        let mut state = [truth[0], 0.0];
        let rates = |s: [f64; 2], u: f64| [s[1], (u - s[0] - delay_s * s[1]) / square];
        for i in 0..truth.len() {
            if i > 0 {
                let (a, b) = (truth[i - 1], truth[i]);
                for p in 0..parts as usize {
                    let u = |x: f64| a + (b - a) * (p as f64 + x) / parts;
                    let add = |s: [f64; 2], k: [f64; 2], x: f64| [s[0] + x * k[0], s[1] + x * k[1]];
                    let k1 = rates(state, u(0.0));
                    let k2 = rates(add(state, k1, 0.5 * h), u(0.5));
                    let k3 = rates(add(state, k2, 0.5 * h), u(0.5));
                    let k4 = rates(add(state, k3, h), u(1.0));
                    for c in 0..2 {
                        state[c] += h / 6.0 * (k1[c] + 2.0 * k2[c] + 2.0 * k3[c] + k4[c]);
                    }
                }
            }
            motion.position_m[i][axis] = state[0];
            motion.velocity_m_s[i][axis] = state[1];
            motion.acceleration_m_s2[i][axis] = rates(state, truth[i])[1];
        }
    }
    let by = v[1] * tau / motion.step_s;
    if by == 0.0 {
        return;
    }
    let n = motion.position_m.len();
    for series in [
        &mut *motion.position_m,
        &mut *motion.velocity_m_s,
        &mut *motion.acceleration_m_s2,
    ] {
        let old = series.to_vec();
        for (i, x) in series.iter_mut().enumerate() {
            let place = (i as f64 - by).max(0.0);
            let a = (place as usize).min(n - 1);
            let b = (a + 1).min(n - 1);
            let s = place - a as f64;
            *x = [0, 1, 2].map(|k| old[a][k] + s * (old[b][k] - old[a][k]));
        }
    }
}

/// A series and its derivative read a time later: cubics between samples; beyond the last sample the last
/// value.
fn later(x: &mut [Vec3], rate: &[Vec3], by_samples: f64, step_s: f64) {
    let n = x.len();
    let old = x.to_vec();
    for (i, x) in x.iter_mut().enumerate() {
        let place = (i as f64 + by_samples).clamp(0.0, (n - 1) as f64);
        let a = (place as usize).min(n.saturating_sub(2));
        let b = (a + 1).min(n - 1);
        let s = place - a as f64;
        for k in 0..3 {
            let (h00, h10) = (
                (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s),
                s * (1.0 - s) * (1.0 - s),
            );
            x[k] = h00 * old[a][k]
                + (1.0 - h00) * old[b][k]
                + step_s * (h10 * rate[a][k] + s * s * (s - 1.0) * rate[b][k]);
        }
    }
}

/// The derivative of a sampled series by central differences.
fn derivative(x: &[Vec3], step_s: f64) -> Vec<Vec3> {
    let n = x.len();
    (0..n)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            let h = step_s * (b - a).max(1) as f64;
            [0, 1, 2].map(|k| (x[b][k] - x[a][k]) / h)
        })
        .collect()
}

impl Effect for MocapLag {
    fn id(&self) -> &'static str {
        "mocap_lag"
    }
    fn says(&self) -> &'static str {
        "the capture system smooths and delays the motion"
    }
    fn source(&self) -> &'static str {
        "second-order low-pass, inverted"
    }
    fn equation(&self) -> &'static str {
        "u(t) = (u_m + 1.4 tau u_m' + tau^2 u_m'')(t + pure tau), tau = delay/(1.4 + pure)"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["time_offset of the other sign", "series_resistance"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Marker
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("delay", "s", 0.0, 0.4, 0.05),
                shape("pure", "1", 0.0, 0.0, 1.0, 0.5),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Motion
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [[0.005, 0.0], [0.03, 0.0], [0.03, 0.7], [0.08, 0.3]]
            .iter()
            .map(|d| vec![d.to_vec()])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "fast drives above 2 Hz: a filter rounds the motion, an offset does not"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Rates, Exercise::Staircase]
    }
    fn captured(&self, v: &[f64], motion: &mut Reading) {
        lagged(v, motion);
    }
    fn looks_ahead(&self) -> bool {
        true
    }
    fn reads_otherwise(&self) -> bool {
        true
    }
    fn reading(&self, v: &[f64], motion: &mut Reading) {
        if v[0] == 0.0 {
            return;
        }
        let tau = tau_s(v);
        let (first, square) = (DELAY_PER_TAU * tau, tau * tau);
        let jerk = derivative(motion.acceleration_m_s2, motion.step_s);
        let snap = derivative(&jerk, motion.step_s);
        for i in 0..motion.position_m.len() {
            for k in 0..3 {
                motion.position_m[i][k] +=
                    first * motion.velocity_m_s[i][k] + square * motion.acceleration_m_s2[i][k];
                motion.velocity_m_s[i][k] +=
                    first * motion.acceleration_m_s2[i][k] + square * jerk[i][k];
                motion.acceleration_m_s2[i][k] += first * jerk[i][k] + square * snap[i][k];
            }
        }
        let by = v[1] * tau / motion.step_s;
        if by != 0.0 {
            let change = derivative(motion.acceleration_m_s2, motion.step_s);
            later(motion.position_m, motion.velocity_m_s, by, motion.step_s);
            later(
                motion.velocity_m_s,
                motion.acceleration_m_s2,
                by,
                motion.step_s,
            );
            later(motion.acceleration_m_s2, &change, by, motion.step_s);
        }
    }
}
