//! Small least squares: a few columns, many rows.

use nalgebra::{DMatrix, DVector};

/// Columns with their Gram matrix factorised, to be held against many right sides.
pub(super) struct Columns {
    columns: Vec<Vec<f64>>,
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    scale: Vec<f64>,
}

/// What a least-squares solution leaves.
#[derive(Debug, Clone)]
pub(super) struct Solved {
    /// Coefficients of the columns.
    pub beta: Vec<f64>,
    /// Sum of squares that is left.
    pub left: f64,
}

/// Noise of a signal from sample to sample, one standard deviation: the variance of a third difference is 20
/// times that of a value.
pub(super) fn noise(values: &[f64]) -> f64 {
    let third = values
        .windows(4)
        .map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs());
    quantile(third, 0.5) / 0.6745 / 20f64.sqrt()
}

/// Share of each column's own square that is added to the diagonal, so that columns that are alike share what
/// they explain.
const RIDGE: f64 = 1e-9;

impl Columns {
    /// `None` where the columns are not numbers.
    pub fn new(columns: Vec<Vec<f64>>) -> Option<Self> {
        let p = columns.len();
        let scale: Vec<f64> = columns
            .iter()
            .map(|c| match c.iter().map(|v| v * v).sum::<f64>().sqrt() {
                // a column of zeros takes no part
                0.0 => 1.0,
                size => size,
            })
            .collect();
        let mut gram = DMatrix::zeros(p, p);
        for a in 0..p {
            for b in 0..=a {
                let sum = dot(&columns[a], &columns[b]) / (scale[a] * scale[b]);
                gram[(a, b)] = sum;
                gram[(b, a)] = sum;
            }
            gram[(a, a)] += RIDGE;
        }
        let factor = gram.cholesky()?;
        Some(Columns {
            columns,
            factor,
            scale,
        })
    }

    /// As they were given.
    pub fn columns(&self) -> &[Vec<f64>] {
        &self.columns
    }

    /// The least-squares solution for the right side `y`.
    pub fn solve(&self, y: &[f64]) -> Solved {
        let right = DVector::from_iterator(
            self.columns.len(),
            self.columns
                .iter()
                .zip(&self.scale)
                .map(|(c, s)| dot(c, y) / s),
        );
        let scaled = self.factor.solve(&right);
        let left = dot(y, y) - scaled.dot(&right);
        Solved {
            beta: scaled.iter().zip(&self.scale).map(|(b, s)| b / s).collect(),
            left: left.max(0.0),
        }
    }

    /// The sum of the columns times `beta`.
    pub fn sum(&self, beta: &[f64]) -> Vec<f64> {
        let rows = self.columns.first().map_or(0, Vec::len);
        let mut out = vec![0.0; rows];
        for (c, b) in self.columns.iter().zip(beta) {
            for (o, v) in out.iter_mut().zip(c) {
                *o += b * v;
            }
        }
        out
    }
}

/// Sum of products.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Sum of squares about the mean.
pub(super) fn about_mean(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter().map(|v| (v - mean).powi(2)).sum()
}

/// The value below which a share of the finite values lies; NaN of none.
pub(super) fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    if sorted.is_empty() {
        return f64::NAN;
    }
    let at = ((sorted.len() - 1) as f64 * share).round() as usize;
    *sorted.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found() {
        let t: Vec<f64> = (0..50).map(f64::from).collect();
        let y: Vec<f64> = t.iter().map(|t| 3.0 + 0.5 * t).collect();
        let columns = Columns::new(vec![vec![1.0; 50], t]).unwrap();
        let solved = columns.solve(&y);
        assert!((solved.beta[0] - 3.0).abs() < 1e-5 && (solved.beta[1] - 0.5).abs() < 1e-6);
        assert!(solved.left < 1e-6 * dot(&y, &y));
    }

    #[test]
    fn quantiles_pass_over_what_is_missing() {
        assert_eq!(quantile([3.0, f64::NAN, 1.0, 2.0].into_iter(), 0.5), 2.0);
    }
}
