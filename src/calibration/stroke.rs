//! Stroke of each cycle, as free of the capture's noise as the frames allow.
//!
//! Largest minus smallest captured x is too large by several standard deviations of the noise: the extremes
//! pick it. Here the frames of a cycle (and an eighth of a cycle to each side) are fitted by a cubic and
//! harmonics of the drive, by linear least squares, and the stroke is read from that curve. What noise is
//! left in the curve still raises its extremes, to second order by
//!
//! ```text
//! E max(f + n) - max f = var(n')/(2 |f''|)      at an extremum inside the cycle, and alike for the minimum
//! ```
//!
//! which is subtracted. The number of harmonics is the one of smallest AIC over all cycles of the recording,
//! and two more. The mean over the cycles is a linear functional of the frames near the solution, so that its
//! variance follows from the weights, frames that two windows share included.

use nalgebra::{DMatrix, DVector};

use super::coupon::correlation_rows;
use crate::dataset::Cycles;
use crate::fit::profile::TWO_SIDED_95;

/// Window of a cycle: this share of a period to each side.
const MARGIN: f64 = 0.125;
/// Harmonics that are tried.
const MOST_HARMONICS: usize = 9;
/// Polynomial beside them, number of terms.
const POLYNOMIAL: usize = 4;
/// Points a cycle at which the curve is looked at before an extremum is refined.
const LOOKS: usize = 240;
/// Share of a cycle's frames that must have been captured.
const CAPTURED: f64 = 0.6;
/// Longest gap in a cycle, share of a period.
const LONGEST_GAP: f64 = 0.1;
/// A cycle whose stroke falls below this share of the median of those before it, or exceeds its reciprocal,
/// is a failure.
const FAILED: f64 = 0.5;
/// A cycle that is fitted this many times worse than the median cycle of the recording is one, too.
const BROKEN: f64 = 4.0;
/// And off by more than this share of its stroke: without noise a first cycle is fitted worse than those
/// after it.
const TORN: f64 = 0.03;
/// Correlation of what the curve leaves, frames, up to which it counts as white.
const WHITE: f64 = 1.5;

/// A number with its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// The number.
    pub value: f64,
    /// Its standard error.
    pub std_error: f64,
}

impl Value {
    /// 95 % interval.
    #[must_use]
    pub fn ci95(&self) -> [f64; 2] {
        let half = TWO_SIDED_95 * self.std_error;
        [self.value - half, self.value + half]
    }
}

/// One cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleStroke {
    /// Its number in the recording, from 1.
    pub number: usize,
    /// Where it begins, s.
    pub start_s: f64,
    /// Stroke, m.
    pub stroke: Value,
    /// Largest minus smallest captured x, m: biased by the noise, for comparison.
    pub raw_m: f64,
}

/// Strokes of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Strokes {
    /// Cycles that count, in order.
    pub cycles: Vec<CycleStroke>,
    /// Mean over them, m.
    pub mean: Value,
    /// Change of the stroke from cycle to cycle within the run, m a cycle; NaN with fewer than three cycles.
    pub drift: Value,
    /// Noise of a frame, m: what the curves leave.
    pub noise_m: f64,
    /// Harmonics used.
    pub harmonics: usize,
    /// Length of a cycle, s.
    pub period_s: f64,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

/// Frames of one cycle's window and their fit.
struct Window {
    number: usize,
    start_s: f64,
    /// Index of each frame in the recording, and its place in the cycle, 0 to 1 between the ends.
    frames: Vec<(usize, f64)>,
    values: DVector<f64>,
}

fn basis(place: f64, harmonics: usize) -> DVector<f64> {
    let n = POLYNOMIAL + 2 * harmonics;
    let mut out = DVector::zeros(n);
    let t = 2.0 * place - 1.0;
    let mut power = 1.0;
    for i in 0..POLYNOMIAL {
        out[i] = power;
        power *= t;
    }
    for k in 1..=harmonics {
        let (s, c) = (2.0 * std::f64::consts::PI * k as f64 * place).sin_cos();
        out[POLYNOMIAL + 2 * k - 2] = c;
        out[POLYNOMIAL + 2 * k - 1] = s;
    }
    out
}

/// Derivatives of [`basis`] by the place, first and second.
fn basis_slopes(place: f64, harmonics: usize) -> [DVector<f64>; 2] {
    let n = POLYNOMIAL + 2 * harmonics;
    let (mut first, mut second) = (DVector::zeros(n), DVector::zeros(n));
    let t = 2.0 * place - 1.0;
    for i in 1..POLYNOMIAL {
        first[i] = 2.0 * i as f64 * t.powi(i as i32 - 1);
        if i > 1 {
            second[i] = 4.0 * (i * (i - 1)) as f64 * t.powi(i as i32 - 2);
        }
    }
    for k in 1..=harmonics {
        let w = 2.0 * std::f64::consts::PI * k as f64;
        let (s, c) = (w * place).sin_cos();
        let (a, b) = (POLYNOMIAL + 2 * k - 2, POLYNOMIAL + 2 * k - 1);
        (first[a], first[b]) = (-w * s, w * c);
        (second[a], second[b]) = (-w * w * c, -w * w * s);
    }
    [first, second]
}

impl Window {
    /// Frames within the cycle.
    fn inside(&self) -> impl Iterator<Item = &(usize, f64)> {
        self.frames.iter().filter(|f| (0.0..=1.0).contains(&f.1))
    }
}

/// A window's fit.
struct Curve {
    harmonics: usize,
    coefficients: DVector<f64>,
    inverse: DMatrix<f64>,
    design: DMatrix<f64>,
    residual: DVector<f64>,
}

fn fit(window: &Window, harmonics: usize) -> Option<Curve> {
    let n = POLYNOMIAL + 2 * harmonics;
    let m = window.frames.len();
    if m < 2 * n {
        return None;
    }
    let mut design = DMatrix::zeros(m, n);
    for (i, (_, place)) in window.frames.iter().enumerate() {
        design.set_row(i, &basis(*place, harmonics).transpose());
    }
    let inverse = design.tr_mul(&design).cholesky()?.inverse();
    let coefficients = &inverse * design.tr_mul(&window.values);
    let residual = &window.values - &design * &coefficients;
    Some(Curve {
        harmonics,
        coefficients,
        inverse,
        design,
        residual,
    })
}

/// An extremum of the curve within the cycle: place, and whether it is inside.
fn extremum(c: &DVector<f64>, harmonics: usize, sign: f64) -> (f64, bool) {
    let value = |place: f64| sign * basis(place, harmonics).dot(c);
    let best = (0..=LOOKS)
        .map(|i| i as f64 / LOOKS as f64)
        .max_by(|a, b| value(*a).total_cmp(&value(*b)))
        .unwrap_or(0.0);
    let mut place = best;
    for _ in 0..20 {
        let [first, second] = basis_slopes(place, harmonics);
        let (d1, d2) = (sign * first.dot(c), sign * second.dot(c));
        if d2 >= 0.0 {
            break;
        }
        let step = (-d1 / d2).clamp(-1.0 / LOOKS as f64, 1.0 / LOOKS as f64);
        place += step;
        if step.abs() < 1e-10 {
            break;
        }
    }
    let inside = place > 0.0 && place < 1.0;
    if value(place) < value(best) || !inside {
        return (best.clamp(0.0, 1.0), best > 0.0 && best < 1.0);
    }
    (place, true)
}

impl Curve {
    fn degrees(&self) -> usize {
        self.residual.len() - self.coefficients.len()
    }

    /// Largest minus smallest value less what noise of so much `variance` raises it by, and its derivative by
    /// the coefficients.
    fn stroke(&self, variance: f64) -> (f64, DVector<f64>) {
        let (top, top_inside) = extremum(&self.coefficients, self.harmonics, 1.0);
        let (bottom, bottom_inside) = extremum(&self.coefficients, self.harmonics, -1.0);
        let g = basis(top, self.harmonics) - basis(bottom, self.harmonics);
        let lift = |place: f64, inside: bool| {
            if !inside {
                return 0.0;
            }
            let [first, second] = basis_slopes(place, self.harmonics);
            let slope = variance * (first.transpose() * &self.inverse * &first)[(0, 0)];
            let bend = second.dot(&self.coefficients).abs();
            let error = (variance * (g.transpose() * &self.inverse * &g)[(0, 0)]).sqrt();
            (slope / (2.0 * bend)).min(3.0 * error)
        };
        let raised = lift(top, top_inside) + lift(bottom, bottom_inside);
        (g.dot(&self.coefficients) - raised, g)
    }
}

/// Windows of the whole cycles that were captured, and of others why they are left out.
fn windows(
    x_m: &[f64],
    start_s: f64,
    step_s: f64,
    cycles: &Cycles,
    notes: &mut Vec<String>,
) -> Vec<Window> {
    let period = cycles.period_s;
    let end_s = start_s + step_s * x_m.len().saturating_sub(1) as f64;
    let mut windows = Vec::new();
    for (i, &begin) in cycles.starts_s.iter().enumerate() {
        if begin < start_s - 0.02 * period || begin + period > end_s + 0.02 * period {
            continue;
        }
        let place = |j: usize| (start_s + step_s * j as f64 - begin) / period;
        let low = ((begin - MARGIN * period - start_s) / step_s)
            .ceil()
            .max(0.0) as usize;
        let high = ((begin + (1.0 + MARGIN) * period - start_s) / step_s).floor() as usize;
        let frames: Vec<(usize, f64)> = (low..=high.min(x_m.len() - 1))
            .filter(|&j| !x_m[j].is_nan())
            .map(|j| (j, place(j)))
            .collect();
        let values = DVector::from_iterator(frames.len(), frames.iter().map(|f| x_m[f.0]));
        let window = Window {
            number: i + 1,
            start_s: begin,
            frames,
            values,
        };
        let inside: Vec<f64> = std::iter::once(0.0)
            .chain(window.inside().map(|f| f.1))
            .chain(std::iter::once(1.0))
            .collect();
        let gap = inside.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
        let captured = (inside.len() - 2) as f64 * step_s / period;
        if captured < CAPTURED || gap > LONGEST_GAP {
            notes.push(format!(
                "cycle {} is left out: {:.0} % of its frames were captured, its longest gap is {:.2} s",
                i + 1,
                100.0 * captured.min(1.0),
                gap * period
            ));
            continue;
        }
        windows.push(window);
    }
    windows
}

/// Of all harmonics those of smallest AIC over the recording, and two more where the frames carry them: AIC
/// weighs the error of the whole curve; what it truncates would bias every cycle alike.
fn harmonics_of(windows: &[Window]) -> Result<usize, String> {
    let rows: usize = windows.iter().map(|w| w.frames.len()).sum();
    let aic = |k: usize| -> Option<f64> {
        let sum: f64 = windows
            .iter()
            .map(|w| fit(w, k).map(|c| c.residual.norm_squared()))
            .sum::<Option<f64>>()?;
        let unknowns = windows.len() * (POLYNOMIAL + 2 * k);
        Some(rows as f64 * (sum.max(1e-30) / rows as f64).ln() + 2.0 * unknowns as f64)
    };
    let mut best: Option<(usize, f64)> = None;
    for k in 2..=MOST_HARMONICS {
        let Some(value) = aic(k) else { break };
        match best {
            Some((at, least)) if value >= least => {
                if k >= at + 2 {
                    break; // two more harmonics and no gain
                }
            }
            _ => best = Some((k, value)),
        }
    }
    let (chosen, _) = best.ok_or("a cycle has too few frames for a curve through it")?;
    let more = windows.iter().all(|w| fit(w, chosen + 2).is_some());
    Ok(if more { chosen + 2 } else { chosen })
}

fn median(values: &[f64]) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

/// Cycles before the first that is not like those before it: of a sample that fails half-way nothing counts
/// from there on.
fn intact(windows: &[Window], curves: &[Curve], notes: &mut Vec<String>) -> usize {
    let squares: Vec<f64> = curves
        .iter()
        .map(|c| c.residual.norm_squared() / c.degrees() as f64)
        .collect();
    let typical = median(&squares);
    let mut sizes: Vec<f64> = Vec::new();
    for (i, c) in curves.iter().enumerate() {
        let size = c.stroke(squares[i]).0;
        let unlike = !sizes.is_empty() && {
            let before = median(&sizes);
            size < FAILED * before || size > before / FAILED
        };
        let torn = curves.len() > 2
            && squares[i] > BROKEN * BROKEN * typical
            && squares[i].sqrt() > TORN * size;
        if unlike || torn {
            let why = match unlike {
                true => format!(
                    "its stroke is {:.3} mm after {:.3} mm",
                    size * 1e3,
                    median(&sizes) * 1e3
                ),
                false => "its motion is not that of a cycle".to_string(),
            };
            notes.push(format!(
                "the sample fails in cycle {} (at {:.1} s): {why}; it and later cycles are left out",
                windows[i].number, windows[i].start_s,
            ));
            return i;
        }
        sizes.push(size);
    }
    curves.len()
}

/// Variance of a frame about the curves, and by how much variances grow because coloured noise says the same
/// thing over several frames.
fn noise_of(curves: &[Curve]) -> (f64, f64) {
    let squares = curves.iter().map(|c| c.residual.norm_squared());
    let degrees: usize = curves.iter().map(Curve::degrees).sum();
    let lengths = curves
        .iter()
        .map(|c| correlation_rows(c.residual.as_slice()));
    let length = lengths.sum::<f64>() / curves.len() as f64;
    let colour = if length > WHITE { length } else { 1.0 };
    (squares.sum::<f64>() / degrees as f64, colour)
}

/// Strokes of the first `most` whole cycles of x (m, NaN in gaps, frame i at `start_s` + i `step_s`).
///
/// # Errors
/// A sentence, where no cycle can be measured.
pub fn strokes(
    x_m: &[f64],
    start_s: f64,
    step_s: f64,
    cycles: &Cycles,
    most: usize,
) -> Result<Strokes, String> {
    let mut notes = Vec::new();
    if let Some(at) = cycles.broken_s {
        notes.push(format!(
            "the drive is no longer periodic from {at:.1} s on: later cycles are left out"
        ));
    }
    let windows = windows(x_m, start_s, step_s, cycles, &mut notes);
    if windows.is_empty() {
        return Err("no whole cycle was captured".into());
    }
    let harmonics = harmonics_of(&windows)?;
    let curves: Vec<Curve> = windows.iter().filter_map(|w| fit(w, harmonics)).collect();
    let count = intact(&windows, &curves, &mut notes).min(most);
    if count == 0 {
        return Err("the sample fails in its first cycle".into());
    }
    let (windows, curves) = (&windows[..count], &curves[..count]);
    let (variance, colour) = noise_of(curves);
    let mut weights = vec![0.0; x_m.len()];
    let mut trend_weights = vec![0.0; x_m.len()];
    let mut out = Vec::with_capacity(count);
    let middle = (count as f64 - 1.0) / 2.0;
    let spread: f64 = (0..count).map(|i| (i as f64 - middle).powi(2)).sum();
    for (i, (w, c)) in windows.iter().zip(curves).enumerate() {
        let (stroke, g) = c.stroke(variance);
        let linear = &c.design * (&c.inverse * &g);
        for (row, (frame, _)) in w.frames.iter().enumerate() {
            weights[*frame] += linear[row] / count as f64;
            trend_weights[*frame] += linear[row] * (i as f64 - middle) / spread.max(1e-300);
        }
        let inside = || w.inside().map(|f| x_m[f.0]);
        out.push(CycleStroke {
            number: w.number,
            start_s: w.start_s,
            stroke: Value {
                value: stroke,
                std_error: (variance * colour * linear.norm_squared()).sqrt(),
            },
            raw_m: inside().fold(f64::NEG_INFINITY, f64::max)
                - inside().fold(f64::INFINITY, f64::min),
        });
    }
    let of = |value: f64, weights: &[f64]| Value {
        value,
        std_error: (variance * colour * weights.iter().map(|w| w * w).sum::<f64>()).sqrt(),
    };
    let mean = out.iter().map(|c| c.stroke.value).sum::<f64>() / count as f64;
    let ahead = out.iter().enumerate();
    let trend = ahead.map(|(i, c)| (i as f64 - middle) * c.stroke.value);
    let drift = match count < 3 {
        true => Value {
            value: f64::NAN,
            std_error: f64::NAN,
        },
        false => of(trend.sum::<f64>() / spread, &trend_weights),
    };
    Ok(Strokes {
        mean: of(mean, &weights),
        cycles: out,
        drift,
        noise_m: variance.sqrt(),
        harmonics,
        period_s: cycles.period_s,
        notes,
    })
}
