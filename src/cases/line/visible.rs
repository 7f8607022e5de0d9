//! How visible a cause is: what a refit of the plain model leaves over what the noise leaves, in the band in
//! which the balance stands
//! above its noise. Worked out from what is known here (courses with and without noise); it asks nothing of
//! the diagnosis.

use nalgebra::{DMatrix, DVector};

/// One recording: columns of the plain model and what they are to make up, without and with noise.
#[derive(Debug, Clone, Default)]
pub struct Balance {
    /// Columns that are free, without noise.
    pub columns: Vec<Vec<f64>>,
    /// What the model is to account for, without noise: the stated parts taken off.
    pub target: Vec<f64>,
    /// Noise of the balance.
    pub noise: Vec<f64>,
    /// Samples at each end that a low-pass has spoilt.
    pub edge: usize,
}

/// A low-pass without a shift: four passes of first order, two each way. `share` of a period goes by in a
/// sample at half amplitude.
pub fn low_pass(values: &[f64], share: f64) -> Vec<f64> {
    // each pass and its counterpart have power 1/(1 + (f/f1)^2); two pairs are at 1/2 where f = f1 (2^(1/2) -
    // 1)^(1/2)
    let f1 = share / (2f64.sqrt() - 1.0).sqrt();
    let keep = (-std::f64::consts::TAU * f1).exp();
    let mut out = values.to_vec();
    for _ in 0..2 {
        let mut y = out.first().copied().unwrap_or(0.0);
        for v in &mut out {
            y = keep * y + (1.0 - keep) * *v;
            *v = y;
        }
        let mut y = out.last().copied().unwrap_or(0.0);
        for v in out.iter_mut().rev() {
            y = keep * y + (1.0 - keep) * *v;
            *v = y;
        }
    }
    out
}

/// First and second derivative of even samples, with errors of the sixth order; nothing at three samples of
/// each end.
pub fn derivatives(x: &[f64], step_s: f64) -> (Vec<f64>, Vec<f64>) {
    let n = x.len();
    let (mut v, mut a) = (vec![0.0; n], vec![0.0; n]);
    for i in 3..n.saturating_sub(3) {
        let odd = |k: usize| x[i + k] - x[i - k];
        let even = |k: usize| x[i + k] + x[i - k];
        v[i] = (45.0 * odd(1) - 9.0 * odd(2) + odd(3)) / (60.0 * step_s);
        a[i] = (270.0 * even(1) - 27.0 * even(2) + 2.0 * even(3) - 490.0 * x[i])
            / (180.0 * step_s * step_s);
    }
    (v, a)
}

fn power(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64
}

/// Bands, as shares of a period that go by in a sample.
const BANDS: [f64; 10] = [
    0.000_25, 0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.1,
];

/// The highest band in which a balance without noise still brings more than its noise does.
pub fn band(signal: &[f64], noise: &[f64]) -> f64 {
    let mut best = BANDS[2];
    for w in BANDS.windows(2) {
        let of = |values: &[f64]| {
            let (low, high) = (low_pass(values, w[0]), low_pass(values, w[1]));
            let d: Vec<f64> = high.iter().zip(&low).map(|(a, b)| a - b).collect();
            power(&d)
        };
        if of(signal) > of(noise) {
            best = best.max(w[1]);
        }
    }
    best
}

/// Root mean square of what a joint refit of all recordings leaves, over that of the noise, each recording
/// weighted by its noise.
pub fn detectability(recordings: &[Balance]) -> f64 {
    let width = recordings.first().map_or(0, |r| r.columns.len());
    let mut rows: Vec<f64> = Vec::new();
    let mut sides: Vec<f64> = Vec::new();
    for r in recordings {
        let n = r.target.len();
        let edge = r.edge.clamp(n / 20, n / 5);
        let sd = power(&r.noise[edge..n - edge])
            .sqrt()
            .max(f64::MIN_POSITIVE);
        // ten thousand rows say as much as all
        let every = (n / 10_000).max(1);
        for i in (edge..n - edge).step_by(every) {
            rows.extend(r.columns.iter().map(|c| c[i] / sd));
            sides.push(r.target[i] / sd);
        }
    }
    let count = sides.len();
    let mut b = DMatrix::from_row_slice(count, width, &rows);
    for j in 0..width {
        let size = b.column(j).norm();
        if size > 0.0 {
            b.column_mut(j).scale_mut(1.0 / size);
        }
    }
    let y = DVector::from_vec(sides);
    let left = match b.clone().svd(true, true).solve(&y, 1e-10) {
        Ok(beta) => (&y - b * beta).norm_squared() / count as f64,
        Err(_) => y.norm_squared() / count as f64,
    };
    (1.0 + left).sqrt()
}
