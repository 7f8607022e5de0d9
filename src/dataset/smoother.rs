//! Position, velocity and acceleration from a noisy capture, with their uncertainty.
//!
//! The motion of one axis is modelled as an m-fold integrated Wiener process seen through white noise: the
//! smoothing spline of degree 2m - 1 in state-space form (Wahba 1978; Kohn and Ansley 1987). Its half-power
//! frequency f_c and the noise of the capture are those of largest likelihood (the criterion), the order m
//! too where it is not given. A missing sample is simply not observed, so that a gap needs no filling and
//! widens the uncertainty by what it must.
//!
//! ```text
//! x_{i+1} = F x_i + w_i,  y_i = x_i[0] + e_i,  e ~ N(0, sigma^2),  w ~ N(0, rho sigma^2 Q)
//! F_jk = 1/(k-j)!,  Q_jk = 1/((m-1-j)! (m-1-k)! (2m-1-j-k)),  rho = (2 pi f_c h)^(2m)       (time in samples h)
//! ```
//!
//! The posterior of the whole track can be sampled: deviations d_i = G_i d_{i+1} + L_i z_i from the smoothed
//! track, which carry noise and smoothing error alike into whatever is computed from the motion.
//!
//! An axis that hardly moves beside another may follow that one: [`Lead`].

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use super::SmoothingPlan;
use super::stretches::Stretch;
use super::thin::pick;

/// Orders m that are offered: quintic and septic splines; both have a continuous acceleration.
pub const ORDERS: [usize; 2] = [3, 4];

/// Gains of one time step, shared by all steps at which the covariance is the same.
#[derive(Debug, Clone)]
struct Gains<const M: usize> {
    /// Kalman gain, zero where nothing was observed.
    gain: [f64; M],
    /// Innovation variance over sigma^2 (of an observed sample).
    innovation: f64,
    /// Smoother gain G.
    back: [[f64; M]; M],
    /// L with L L' = P_filtered - G P_predicted G', lower triangular, over sigma.
    draw: [[f64; M]; M],
    /// P_filtered over sigma^2.
    filtered: [[f64; M]; M],
}

/// The covariance recursion of one mask and one rho: for each sample the number of its gains.
struct Recursion<const M: usize> {
    transition: [[f64; M]; M],
    gains: Vec<Gains<M>>,
    of_sample: Vec<u32>,
}

type Matrix<const M: usize> = [[f64; M]; M];

fn multiply<const M: usize>(a: &Matrix<M>, b: &Matrix<M>) -> Matrix<M> {
    let mut out = [[0.0; M]; M];
    for i in 0..M {
        for j in 0..M {
            out[i][j] = (0..M).map(|k| a[i][k] * b[k][j]).sum();
        }
    }
    out
}

fn transpose<const M: usize>(a: &Matrix<M>) -> Matrix<M> {
    let mut out = [[0.0; M]; M];
    for i in 0..M {
        for j in 0..M {
            out[i][j] = a[j][i];
        }
    }
    out
}

/// Lower Cholesky factor; a pivot that rounding made negative counts as zero.
fn cholesky<const M: usize>(a: &Matrix<M>) -> Matrix<M> {
    let mut l = [[0.0; M]; M];
    for j in 0..M {
        let pivot = a[j][j] - (0..j).map(|k| l[j][k] * l[j][k]).sum::<f64>();
        l[j][j] = pivot.max(0.0).sqrt();
        for i in j + 1..M {
            let rest = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = if l[j][j] > 0.0 { rest / l[j][j] } else { 0.0 };
        }
    }
    l
}

/// X with X A = B for symmetric positive A: rows of B solved by the Cholesky factor of A.
fn divide<const M: usize>(b: &Matrix<M>, a: &Matrix<M>) -> Matrix<M> {
    let l = cholesky(a);
    let mut out = *b;
    for row in &mut out {
        for i in 0..M {
            row[i] = (row[i] - (0..i).map(|k| l[i][k] * row[k]).sum::<f64>()) / l[i][i];
        }
        for i in (0..M).rev() {
            row[i] = (row[i] - (i + 1..M).map(|k| l[k][i] * row[k]).sum::<f64>()) / l[i][i];
        }
    }
    out
}

fn factorial(n: usize) -> f64 {
    (1..=n).map(|i| i as f64).product()
}

impl<const M: usize> Recursion<M> {
    /// Runs the covariances along `observed` for half-power frequency `cutoff` (per sample). With `smooth`
    /// the backward part is worked out as well.
    fn new(observed: &[bool], cutoff: f64, smooth: bool) -> Self {
        let rho = (2.0 * std::f64::consts::PI * cutoff).powi(2 * M as i32);
        let mut transition = [[0.0; M]; M];
        let mut process = [[0.0; M]; M];
        for j in 0..M {
            for k in 0..M {
                if k >= j {
                    transition[j][k] = 1.0 / factorial(k - j);
                }
                let (a, b) = (M - 1 - j, M - 1 - k);
                process[j][k] = rho / (factorial(a) * factorial(b) * (a + b + 1) as f64);
            }
        }
        let back_transition = transpose(&transition);
        // Diffuse start: far wider than any motion in units of the noise.
        let mut predicted = [[0.0; M]; M];
        for (j, row) in predicted.iter_mut().enumerate() {
            row[j] = 1e12 * cutoff.min(1.0).powi(2 * j as i32);
        }
        let mut gains: Vec<Gains<M>> = Vec::new();
        let mut of_sample = Vec::with_capacity(observed.len());
        let mut steady: Option<(Matrix<M>, u32)> = None;
        for &seen in observed {
            if let (true, Some((_, number))) = (seen, &steady) {
                of_sample.push(*number);
                continue;
            }
            if let (false, Some((p, _))) = (seen, &steady) {
                predicted = *p;
                steady = None;
            }
            let innovation = predicted[0][0] + 1.0;
            let mut gain = [0.0; M];
            let mut filtered = predicted;
            if seen {
                for j in 0..M {
                    gain[j] = predicted[j][0] / innovation;
                }
                for j in 0..M {
                    for k in 0..M {
                        filtered[j][k] = predicted[j][k] - gain[j] * predicted[0][k];
                    }
                }
                // Joseph's correction of the first row and column, where the cancellation is.
                for j in 0..M {
                    let value = gain[j];
                    filtered[j][0] = value;
                    filtered[0][j] = value;
                }
            }
            let half = multiply(&transition, &filtered);
            let mut next = multiply(&half, &back_transition);
            for j in 0..M {
                for k in 0..M {
                    next[j][k] += process[j][k];
                }
            }
            for j in 0..M {
                for k in 0..j {
                    let mean = 0.5 * (next[j][k] + next[k][j]);
                    next[j][k] = mean;
                    next[k][j] = mean;
                }
            }
            let (mut back, mut draw) = ([[0.0; M]; M], [[0.0; M]; M]);
            if smooth {
                back = divide(&transpose(&half), &next);
                let explained = multiply(&back, &half);
                let mut rest = filtered;
                for j in 0..M {
                    for k in 0..M {
                        rest[j][k] -= explained[j][k];
                    }
                }
                draw = cholesky(&rest);
            }
            let number = gains.len() as u32;
            gains.push(Gains {
                gain,
                innovation,
                back,
                draw,
                filtered,
            });
            of_sample.push(number);
            let settled =
                (0..M).all(|j| (next[j][j] - predicted[j][j]).abs() <= 1e-11 * next[j][j]);
            if seen && settled {
                steady = Some((next, number));
            }
            predicted = next;
        }
        Recursion {
            transition,
            gains,
            of_sample,
        }
    }

    fn of(&self, sample: usize) -> &Gains<M> {
        &self.gains[self.of_sample[sample] as usize]
    }

    fn predict(&self, x: &[f64; M]) -> [f64; M] {
        let mut out = [0.0; M];
        for j in 0..M {
            out[j] = (j..M).map(|k| self.transition[j][k] * x[k]).sum();
        }
        out
    }

    /// Filters `y`; gives the sum of squared innovations over their variance, the sum of log variances, the
    /// number of innovations counted (the first M observed samples settle the diffuse start), and calls
    /// `keep` with each state.
    fn filter(&self, y: &[f64], mut keep: impl FnMut([f64; M])) -> (f64, f64, usize) {
        let first = y.iter().copied().find(|v| !v.is_nan()).unwrap_or(0.0);
        let mut x = [0.0; M];
        x[0] = first;
        let (mut squares, mut logs, mut count, mut seen) = (0.0, 0.0, 0, 0);
        for (i, &value) in y.iter().enumerate() {
            let g = self.of(i);
            if !value.is_nan() {
                let e = value - x[0];
                seen += 1;
                if seen > M {
                    squares += e * e / g.innovation;
                    logs += g.innovation.ln();
                    count += 1;
                }
                for j in 0..M {
                    x[j] += g.gain[j] * e;
                }
            }
            keep(x);
            x = self.predict(&x);
        }
        (squares, logs, count)
    }
}

/// How one axis was smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisChoice {
    /// Order m of the process.
    pub order: usize,
    /// Half-power frequency, Hz.
    pub cutoff_hz: f64,
    /// Standard deviation of the capture noise, in the unit of the values.
    pub noise: f64,
    /// Log likelihood (up to a constant shared by all choices for the same values).
    pub log_likelihood: f64,
    /// Whether it follows the axis that moves most.
    pub follows: bool,
}

/// One smoothed axis.
#[derive(Debug, Clone)]
pub struct SmoothedAxis {
    /// How it was smoothed.
    pub choice: AxisChoice,
    /// Position, in the unit of the values.
    pub position: Vec<f64>,
    /// Velocity, unit/s.
    pub velocity: Vec<f64>,
    /// Acceleration, unit/s^2.
    pub acceleration: Vec<f64>,
    /// Standard deviation of the smoothed position, in the unit of the values.
    pub position_sd: Vec<f64>,
    /// What it follows, where it follows another axis.
    pub lead: Option<Led>,
    posterior: Posterior,
    step_s: f64,
}

/// The motion of an axis, and its square, that another one may follow: a robot whose arms are not quite alike
/// moves a little to the side as it is driven up and down, by less than the noise of one frame, and by itself
/// that is smoothed away. A sum of both is taken off before what is left is smoothed, and added again.
#[derive(Debug, Clone)]
pub struct Lead {
    /// Position, velocity and acceleration, of the motion and of its square, over half its range.
    terms: [[Vec<f64>; 3]; 2],
}

/// An axis that follows another one.
#[derive(Debug, Clone)]
pub struct Led {
    /// What it follows.
    pub lead: Arc<Lead>,
    /// L with L L' the covariance of the shares that it has of both terms, over sigma^2.
    factor: [[f64; 2]; 2],
}

impl Led {
    /// What shares that are off by `off` make of a sample's position, velocity and acceleration.
    fn deviation(&self, off: [f64; 2], sample: usize) -> [f64; 3] {
        let [own, square] = &self.lead.terms;
        [0, 1, 2].map(|d| off[0] * own[d][sample] + off[1] * square[d][sample])
    }

    /// Shares off by what the noise makes of them.
    fn off(&self, noise: f64, generator: &mut impl Rng) -> [f64; 2] {
        let [a, b]: [f64; 2] = [(); 2].map(|()| StandardNormal.sample(generator));
        self.factor.map(|row| noise * (row[0] * a + row[1] * b))
    }

    /// Variance of the position that the shares' uncertainty makes at a sample, over sigma^2.
    fn variance(&self, sample: usize) -> f64 {
        let along = |column: usize| {
            let off = self.factor.map(|row| row[column]);
            self.deviation(off, sample)[0].powi(2)
        };
        along(0) + along(1)
    }
}

impl Lead {
    /// That of an axis.
    pub fn of(axis: &SmoothedAxis) -> Self {
        let [low, high] = extremes(&axis.position);
        let (middle, half) = (
            0.5 * (low + high),
            (0.5 * (high - low)).max(f64::MIN_POSITIVE),
        );
        let over = |values: &[f64], from: f64| -> Vec<f64> {
            values.iter().map(|v| (v - from) / half).collect()
        };
        let own = [
            over(&axis.position, middle),
            over(&axis.velocity, 0.0),
            over(&axis.acceleration, 0.0),
        ];
        let all = 0..own[0].len();
        let of = |f: fn(f64, f64, f64) -> f64| -> Vec<f64> {
            let at = |i: usize| f(own[0][i], own[1][i], own[2][i]);
            all.clone().map(at).collect()
        };
        let square = [
            of(|s, _, _| s * s),
            of(|s, v, _| 2.0 * s * v),
            of(|s, v, a| 2.0 * (v * v + s * a)),
        ];
        Lead {
            terms: [own, square],
        }
    }

    /// How much of both, beside a constant, fits values best, and the factor of [`Led`]; NaN is a missing one.
    fn shares(&self, values: &[f64]) -> ([f64; 2], [[f64; 2]; 2]) {
        let (mut gram, mut score) = (Matrix3::zeros(), Vector3::zeros());
        for (i, value) in values.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
            let row = Vector3::new(1.0, self.terms[0][0][i], self.terms[1][0][i]);
            gram += row * row.transpose();
            score += *value * row;
        }
        let Some(c) = gram.cholesky() else {
            return ([0.0; 2], [[0.0; 2]; 2]);
        };
        let (found, spread) = (c.solve(&score), c.inverse());
        let first = spread[(1, 1)].sqrt();
        let both = spread[(2, 1)] / first;
        let second = (spread[(2, 2)] - both * both).max(0.0).sqrt();
        ([found[1], found[2]], [[first, 0.0], [both, second]])
    }

    /// That of some stretches alone.
    fn stretches(&self, stretches: &[Stretch]) -> Self {
        let pick = |list: &Vec<f64>| Stretch::pick(stretches, list);
        Lead {
            terms: (self.terms.each_ref()).map(|term| term.each_ref().map(pick)),
        }
    }

    /// An axis that follows it, smoothed as [`smooth_axis`] does.
    ///
    /// # Errors
    /// Those of [`smooth_axis`].
    pub fn smooth(
        self: &Arc<Self>,
        values: &[f64],
        step_s: f64,
        order: Option<usize>,
        cutoff_hz: Option<f64>,
    ) -> Result<SmoothedAxis, String> {
        let (shares, factor) = self.shares(values);
        let made = |derivative: usize, i: usize| -> f64 {
            (self.terms.iter().zip(shares))
                .map(|(term, share)| share * term[derivative][i])
                .sum()
        };
        let rest: Vec<f64> = values
            .iter()
            .enumerate()
            .map(|(i, v)| v - made(0, i))
            .collect();
        let mut out = smooth_axis(&rest, step_s, order, cutoff_hz)?;
        let parts = [&mut out.position, &mut out.velocity, &mut out.acceleration];
        for (derivative, part) in parts.into_iter().enumerate() {
            for (i, p) in part.iter_mut().enumerate() {
                *p += made(derivative, i);
            }
        }
        let led = Led {
            lead: self.clone(),
            factor,
        };
        for (i, sd) in out.position_sd.iter_mut().enumerate() {
            *sd = sd.hypot(out.choice.noise * led.variance(i).sqrt());
        }
        out.choice.follows = true;
        out.lead = Some(led);
        Ok(out)
    }
}

/// Least and largest.
fn extremes(values: &[f64]) -> [f64; 2] {
    (values.iter()).fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| {
        [a.min(*v), b.max(*v)]
    })
}

/// Share of the half-power frequency of the axis that moves most below which another one may follow it.
const FAR_SLOWER: f64 = 0.25;

/// Lets axes follow the one that moves most ([`Lead`]): those of which a plan says so and, without one, those
/// that by themselves would be smoothed far more, where the likelihood grows by more than two values cost
/// (Schwarz 1978).
///
/// # Errors
/// Those of [`smooth_axis`].
pub(super) fn let_follow(
    axes: &mut [SmoothedAxis; 3],
    values: &[Vec<f64>; 3],
    plan: Option<&[SmoothingPlan]>,
) -> Result<(), String> {
    let range = |axis: usize| {
        let [low, high] = extremes(&axes[axis].position);
        high - low
    };
    let main = (0..3).max_by(|&a, &b| range(a).total_cmp(&range(b)));
    let main = main.expect("three axes");
    let slow = FAR_SLOWER * axes[main].choice.cutoff_hz;
    let follows = |k: usize, axis: &SmoothedAxis| match plan {
        Some(plan) => plan.get(k).is_some_and(|p| p.follows),
        None => axis.choice.cutoff_hz < slow,
    };
    let those: Vec<usize> = (0..3)
        .filter(|&k| k != main && follows(k, &axes[k]))
        .collect();
    if those.is_empty() {
        return Ok(());
    }
    let lead = Arc::new(Lead::of(&axes[main]));
    for k in those {
        let own = axes[k].choice;
        let fixed = plan.map(|_| (own.order, own.cutoff_hz)).unzip();
        let other = lead.smooth(&values[k], axes[k].step_s, fixed.0, fixed.1)?;
        let rows = values[k].iter().filter(|v| !v.is_nan()).count() as f64;
        if plan.is_some() || other.choice.log_likelihood > own.log_likelihood + rows.ln() {
            axes[k] = other;
        }
    }
    Ok(())
}

#[derive(Debug, Clone)]
enum Posterior {
    Three(PosteriorOf<3>),
    Four(PosteriorOf<4>),
}

#[derive(Debug, Clone)]
struct PosteriorOf<const M: usize> {
    gains: Vec<Gains<M>>,
    of_sample: Vec<u32>,
}

/// Half-power frequencies that are considered, Hz: one cycle in 20 s up to 0.4 of the rate.
const LOWEST_CUTOFF_HZ: f64 = 0.05;
const HIGHEST_CUTOFF_PER_RATE: f64 = 0.4;

/// Smooths one axis sampled every `step_s`; NaN is a missing sample. `order` and `cutoff_hz` are chosen by
/// likelihood where they are `None`.
///
/// # Errors
/// A sentence when fewer than 16 samples are there.
pub fn smooth_axis(
    values: &[f64],
    step_s: f64,
    order: Option<usize>,
    cutoff_hz: Option<f64>,
) -> Result<SmoothedAxis, String> {
    let observed: Vec<bool> = values.iter().map(|v| !v.is_nan()).collect();
    let count = observed.iter().filter(|o| **o).count();
    if count < 16 {
        return Err(format!(
            "its motion has {count} captured frame(s), too few to smooth: 16 are needed, record longer"
        ));
    }
    let orders: Vec<usize> = order.map_or(ORDERS.to_vec(), |m| vec![m]);
    let best = orders
        .iter()
        .map(|&m| match m {
            3 => choose::<3>(values, &observed, step_s, cutoff_hz),
            _ => choose::<4>(values, &observed, step_s, cutoff_hz),
        })
        .max_by(|a, b| a.log_likelihood.total_cmp(&b.log_likelihood))
        .expect("at least one order");
    Ok(match best.order {
        3 => run::<3>(values, &observed, step_s, best, Posterior::Three),
        _ => run::<4>(values, &observed, step_s, best, Posterior::Four),
    })
}

fn likelihood<const M: usize>(
    values: &[f64],
    observed: &[bool],
    step_s: f64,
    cutoff_hz: f64,
) -> AxisChoice {
    let recursion = Recursion::<M>::new(observed, cutoff_hz * step_s, false);
    let (squares, logs, count) = recursion.filter(values, |_| ());
    let n = count as f64;
    let variance = (squares / n).max(f64::MIN_POSITIVE);
    AxisChoice {
        order: M,
        cutoff_hz,
        noise: variance.sqrt(),
        log_likelihood: -0.5 * (logs + n * variance.ln()),
        follows: false,
    }
}

/// Largest likelihood over the half-power frequency: a coarse scan, then golden sections in its logarithm.
fn choose<const M: usize>(
    values: &[f64],
    observed: &[bool],
    step_s: f64,
    cutoff_hz: Option<f64>,
) -> AxisChoice {
    let at = |log: f64| likelihood::<M>(values, observed, step_s, log.exp());
    if let Some(cutoff) = cutoff_hz {
        return at(cutoff.ln());
    }
    let (low, high) = (
        LOWEST_CUTOFF_HZ.ln(),
        (HIGHEST_CUTOFF_PER_RATE / step_s).ln(),
    );
    let points = 12;
    let log = |i: usize| low + (high - low) * i as f64 / (points - 1) as f64;
    let scan: Vec<AxisChoice> = (0..points).map(|i| at(log(i))).collect();
    let top = (0..points)
        .max_by(|&a, &b| scan[a].log_likelihood.total_cmp(&scan[b].log_likelihood))
        .expect("points");
    let (mut a, mut b) = (log(top.saturating_sub(1)), log((top + 1).min(points - 1)));
    let golden = 0.618_033_988_749_894_9;
    let (mut c, mut d) = (b - golden * (b - a), a + golden * (b - a));
    let (mut at_c, mut at_d) = (at(c), at(d));
    while b - a > 0.02 {
        if at_c.log_likelihood > at_d.log_likelihood {
            (b, d, at_d) = (d, c, at_c);
            c = b - golden * (b - a);
            at_c = at(c);
        } else {
            (a, c, at_c) = (c, d, at_d);
            d = a + golden * (b - a);
            at_d = at(d);
        }
    }
    if at_c.log_likelihood > at_d.log_likelihood {
        at_c
    } else {
        at_d
    }
}

fn run<const M: usize>(
    values: &[f64],
    observed: &[bool],
    step_s: f64,
    choice: AxisChoice,
    wrap: fn(PosteriorOf<M>) -> Posterior,
) -> SmoothedAxis {
    let mut recursion = Recursion::<M>::new(observed, choice.cutoff_hz * step_s, true);
    let n = values.len();
    // a column for each part of the state: the first three are what is asked for
    let mut states: [Vec<f64>; M] = [(); M].map(|()| Vec::with_capacity(n));
    recursion.filter(values, |x| {
        for (column, x) in states.iter_mut().zip(x) {
            column.push(x);
        }
    });
    let mut next: [f64; M] = std::array::from_fn(|j| states[j][n - 1]);
    for i in (0..n - 1).rev() {
        let own = std::array::from_fn(|j| states[j][i]);
        let ahead = recursion.predict(&own);
        let g = recursion.of(i);
        let mut change = [0.0; M];
        for j in 0..M {
            change[j] = (0..M).map(|k| g.back[j][k] * (next[k] - ahead[k])).sum();
        }
        for j in 0..M {
            next[j] = own[j] + change[j];
            states[j][i] = next[j];
        }
    }
    // Nothing comes after the last sample: its draw has the filtered covariance itself.
    let mut end = recursion.of(n - 1).clone();
    end.back = [[0.0; M]; M];
    end.draw = cholesky(&end.filtered);
    recursion.of_sample[n - 1] = recursion.gains.len() as u32;
    recursion.gains.push(end);
    let posterior = PosteriorOf {
        gains: recursion.gains,
        of_sample: recursion.of_sample,
    };
    let mut states = states.into_iter();
    let mut column = |per: f64| {
        let mut values = states.next().expect("a state has three parts");
        values.iter_mut().for_each(|v| *v /= per);
        values
    };
    SmoothedAxis {
        choice,
        position: column(1.0),
        velocity: column(step_s),
        acceleration: column(step_s * step_s),
        position_sd: posterior.position_sd(choice.noise),
        lead: None,
        posterior: wrap(posterior),
        step_s,
    }
}

impl<const M: usize> PosteriorOf<M> {
    /// Standard deviation of the smoothed position: P_i = L L' + G P_{i+1} G', backwards.
    fn position_sd(&self, noise: f64) -> Vec<f64> {
        let mut p = [[0.0; M]; M];
        let mut out = vec![0.0; self.of_sample.len()];
        for (i, &number) in self.of_sample.iter().enumerate().rev() {
            let g = &self.gains[number as usize];
            let next = multiply(&multiply(&g.back, &p), &transpose(&g.back));
            for j in 0..M {
                for k in 0..M {
                    p[j][k] = next[j][k]
                        + (0..=j.min(k))
                            .map(|l| g.draw[j][l] * g.draw[k][l])
                            .sum::<f64>();
                }
            }
            out[i] = noise * p[0][0].max(0.0).sqrt();
        }
        out
    }

    fn draw(&self, scale: f64, generator: &mut impl Rng, mut each: impl FnMut(usize, [f64; M])) {
        let mut d = [0.0; M];
        for i in (0..self.of_sample.len()).rev() {
            let g = &self.gains[self.of_sample[i] as usize];
            let mut z = [0.0; M];
            for z in &mut z {
                let normal: f64 = StandardNormal.sample(generator);
                *z = scale * normal;
            }
            let mut next = [0.0; M];
            for j in 0..M {
                let mut sum = 0.0;
                for k in 0..M {
                    sum += g.back[j][k] * d[k] + g.draw[j][k] * z[k];
                }
                next[j] = sum;
            }
            d = next;
            each(i, d);
        }
    }
}

impl<const M: usize> PosteriorOf<M> {
    fn stretches(&self, stretches: &[Stretch]) -> Self {
        PosteriorOf {
            gains: self.gains.clone(),
            of_sample: Stretch::pick(stretches, &self.of_sample),
        }
    }
}

impl SmoothedAxis {
    /// The samples of some stretches alone, as they were smoothed among all. In draws the deviations of a
    /// stretch go on into the next one, which takes nothing from what they are within each.
    pub(super) fn stretches(&self, stretches: &[Stretch]) -> Self {
        let pick = |list: &[f64]| Stretch::pick(stretches, list);
        SmoothedAxis {
            choice: self.choice,
            position: pick(&self.position),
            velocity: pick(&self.velocity),
            acceleration: pick(&self.acceleration),
            position_sd: pick(&self.position_sd),
            lead: self.lead.as_ref().map(|led| Led {
                lead: Arc::new(led.lead.stretches(stretches)),
                factor: led.factor,
            }),
            posterior: match &self.posterior {
                Posterior::Three(p) => Posterior::Three(p.stretches(stretches)),
                Posterior::Four(p) => Posterior::Four(p.stretches(stretches)),
            },
            step_s: self.step_s,
        }
    }

    /// Every so many-th sample, as it was smoothed among all; deviations are drawn for all of them only.
    pub(super) fn thinned(&self, every: usize) -> Self {
        SmoothedAxis {
            position: pick(&self.position, every),
            velocity: pick(&self.velocity, every),
            acceleration: pick(&self.acceleration, every),
            position_sd: pick(&self.position_sd, every),
            ..self.clone()
        }
    }

    /// A track drawn from the posterior: the smoothed one plus a deviation with its covariance. Calls `each`
    /// with the sample and its deviations of position, velocity and acceleration, from the last sample to the
    /// first.
    pub fn draw_deviation(&self, generator: &mut impl Rng, mut each: impl FnMut(usize, [f64; 3])) {
        let h = self.step_s;
        let off = (self.lead.as_ref()).map(|led| (led, led.off(self.choice.noise, generator)));
        let mut each = |i: usize, d: [f64; 3]| match off {
            Some((led, off)) => {
                let more = led.deviation(off, i);
                each(i, [0, 1, 2].map(|j| d[j] + more[j]));
            }
            None => each(i, d),
        };
        let scaled = |d: &[f64]| [d[0], d[1] / h, d[2] / (h * h)];
        match &self.posterior {
            Posterior::Three(p) => p.draw(self.choice.noise, generator, |i, d| each(i, scaled(&d))),
            Posterior::Four(p) => p.draw(self.choice.noise, generator, |i, d| each(i, scaled(&d))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha12Rng;

    fn noisy(n: usize, noise: f64, seed: u64) -> (Vec<[f64; 3]>, Vec<f64>) {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let w = 2.0 * std::f64::consts::PI / 3.0;
        let truth: Vec<[f64; 3]> = (0..n)
            .map(|i| {
                let t = i as f64 * 0.01;
                let (s, c) = (w * t).sin_cos();
                let (s3, c3) = (3.0 * w * t + 0.4).sin_cos();
                [
                    17.0 * s + 2.0 * s3,
                    w * (17.0 * c + 6.0 * c3),
                    -w * w * (17.0 * s + 18.0 * s3),
                ]
            })
            .collect();
        let seen = truth
            .iter()
            .map(|t| {
                let z: f64 = StandardNormal.sample(&mut generator);
                t[0] + noise * z
            })
            .collect();
        (truth, seen)
    }

    fn rms(v: impl Iterator<Item = f64>) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for v in v {
            sum += v * v;
            n += 1.0;
        }
        f64::sqrt(sum / n)
    }

    #[test]
    fn finds_the_noise_and_beats_it() {
        let (truth, seen) = noisy(3000, 0.03, 1);
        let axis = smooth_axis(&seen, 0.01, None, None).unwrap();
        assert!(
            (axis.choice.noise / 0.03 - 1.0).abs() < 0.05,
            "{:?}",
            axis.choice
        );
        let error = |k: usize, v: &[f64]| rms((50..2950).map(|i| v[i] - truth[i][k]));
        assert!(error(0, &axis.position) < 0.012, "{:?}", axis.choice);
        assert!(
            error(1, &axis.velocity) < 0.2,
            "{}",
            error(1, &axis.velocity)
        );
        assert!(
            error(2, &axis.acceleration) < 6.0,
            "{}",
            error(2, &axis.acceleration)
        );
    }

    #[test]
    fn the_stated_uncertainty_is_that_of_the_error_and_of_the_draws() {
        let (truth, mut seen) = noisy(3000, 0.03, 2);
        for v in &mut seen[1000..1012] {
            *v = f64::NAN;
        }
        let axis = smooth_axis(&seen, 0.01, Some(3), None).unwrap();
        let z = rms((0..3000).map(|i| (axis.position[i] - truth[i][0]) / axis.position_sd[i]));
        assert!((0.7..1.3).contains(&z), "{z}");
        assert!(axis.position_sd[1006] > 1.5 * axis.position_sd[500]);
        let mut generator = ChaCha12Rng::seed_from_u64(3);
        let mut sum = vec![0.0; 3000];
        for _ in 0..200 {
            axis.draw_deviation(&mut generator, |i, d| sum[i] += d[0] * d[0] / 200.0);
        }
        for i in [0, 500, 1006, 2999] {
            let ratio = (sum[i]).sqrt() / axis.position_sd[i];
            assert!((0.8..1.2).contains(&ratio), "{i} {ratio}");
        }
    }

    #[test]
    fn a_still_axis_is_smoothed_hard() {
        let mut generator = ChaCha12Rng::seed_from_u64(4);
        let seen: Vec<f64> = (0..3000)
            .map(|_| {
                let z: f64 = StandardNormal.sample(&mut generator);
                5.0 + 0.03 * z
            })
            .collect();
        let axis = smooth_axis(&seen, 0.01, None, None).unwrap();
        assert!(rms(axis.position.iter().map(|p| p - 5.0)) < 0.005);
    }

    /// Three axes: one that moves, one that follows it by so much, and one that stands still.
    fn three(sideways: f64) -> ([Vec<f64>; 3], Vec<f64>) {
        let (truth, main) = noisy(3000, 0.03, 5);
        let aside: Vec<f64> = (truth.iter())
            .map(|t| sideways * (t[0] / 20.0 + 0.3 * (t[0] / 20.0).powi(2)))
            .collect();
        let mut generator = ChaCha12Rng::seed_from_u64(6);
        let mut seen = |around: &dyn Fn(usize) -> f64| -> Vec<f64> {
            let mut at = |i: usize| {
                let z: f64 = StandardNormal.sample(&mut generator);
                around(i) + 0.03 * z
            };
            (0..3000).map(&mut at).collect()
        };
        let values = [main, seen(&|i| aside[i]), seen(&|_| 0.0)];
        (values, aside)
    }

    fn smoothed(values: &[Vec<f64>; 3], plan: Option<&[SmoothingPlan]>) -> [SmoothedAxis; 3] {
        let mut axes = [0, 1, 2].map(|k| {
            let fixed = plan.map(|p| (p[k].order, p[k].cutoff_hz)).unzip();
            smooth_axis(&values[k], 0.01, fixed.0, fixed.1).unwrap()
        });
        let_follow(&mut axes, values, plan).unwrap();
        axes
    }

    #[test]
    fn a_motion_below_the_noise_is_seen_beside_the_one_that_makes_it() {
        let (values, aside) = three(0.02);
        let alone = smooth_axis(&values[1], 0.01, None, None).unwrap();
        let axes = smoothed(&values, None);
        assert_eq!(
            axes.each_ref().map(|a| a.choice.follows),
            [false, true, false]
        );
        let error = |a: &SmoothedAxis| rms((50..2950).map(|i| a.position[i] - aside[i]));
        let [beside, by_itself] = [error(&axes[1]), error(&alone)];
        assert!(
            beside < 0.0025 && by_itself > 2.0 * beside,
            "{beside} {by_itself}"
        );
        // the derivatives are those of the sum
        let slope = |i: usize| (axes[1].position[i + 1] - axes[1].position[i - 1]) / 0.02;
        let missed = rms((50..2950).map(|i| axes[1].velocity[i] - slope(i)));
        assert!(
            missed < 0.01 * rms(axes[1].velocity.iter().copied()),
            "{missed}"
        );
        let bend = |i: usize| (axes[1].velocity[i + 1] - axes[1].velocity[i - 1]) / 0.02;
        let missed = rms((50..2950).map(|i| axes[1].acceleration[i] - bend(i)));
        assert!(
            missed < 0.02 * rms(axes[1].acceleration.iter().copied()),
            "{missed}"
        );
    }

    #[test]
    fn what_an_axis_has_of_another_is_as_uncertain_as_its_draws() {
        let axes = smoothed(&three(0.02).0, None);
        let axis = &axes[1];
        let mut generator = ChaCha12Rng::seed_from_u64(7);
        let mut sum = vec![0.0; 3000];
        for _ in 0..400 {
            axis.draw_deviation(&mut generator, |i, d| sum[i] += d[0] * d[0] / 400.0);
        }
        for i in (0..3000).step_by(300) {
            let ratio = sum[i].sqrt() / axis.position_sd[i];
            assert!((0.85..1.15).contains(&ratio), "{i} {ratio}");
        }
        // least squares of noise alone: over many, the shares scatter as stated
        let lead = axis.lead.as_ref().unwrap();
        let mut squares = [0.0; 2];
        for _ in 0..200 {
            let mut noise = || StandardNormal.sample(&mut generator);
            let white: Vec<f64> = (0..3000).map(|_| noise()).collect();
            let (shares, factor) = lead.lead.shares(&white);
            for j in 0..2 {
                let sd = factor[j][0].hypot(factor[j][1]);
                squares[j] += (shares[j] / sd).powi(2) / 200.0;
            }
        }
        assert!(
            squares.iter().all(|s| (0.7..1.35).contains(s)),
            "{squares:?}"
        );
    }

    #[test]
    fn a_plan_lets_the_same_axes_follow() {
        let (values, _) = three(0.02);
        let axes = smoothed(&values, None);
        let plan = axes.each_ref().map(|a| SmoothingPlan::of(&a.choice));
        let again = smoothed(&values, Some(&plan));
        for (a, b) in axes.iter().zip(&again) {
            assert_eq!(
                (&a.position, &a.acceleration),
                (&b.position, &b.acceleration)
            );
        }
        let none = plan.map(|p| SmoothingPlan {
            follows: false,
            ..p
        });
        assert!(smoothed(&values, Some(&none))[1].lead.is_none());
    }

    #[test]
    fn axes_that_stand_still_follow_nothing() {
        let axes = smoothed(&three(0.0).0, None);
        assert!(axes.iter().all(|a| a.lead.is_none()));
    }
}
