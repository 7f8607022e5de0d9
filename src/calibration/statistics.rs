//! How sure: covariance of the estimates under correlated noise, and the combinations that the data leave
//! open.

use nalgebra::{DMatrix, DVector};

/// Covariance of all unknowns in the search's scale; zero rows for what was held or rests on a bound.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// Covariance.
    pub covariance: DMatrix<f64>,
    /// Which unknowns are free.
    pub free: Vec<bool>,
    /// Information that the data alone give: the inverse of their covariance without priors, free unknowns
    /// only (zero elsewhere).
    pub information: DMatrix<f64>,
}

impl Uncertainty {
    /// The covariance of a weighted least-squares estimate whose residual noise is correlated,
    ///
    /// ```text
    /// V = H^-1 (S + P) H^-1,   H = X'X + P
    /// ```
    ///
    /// with the whitened columns' Gram matrix X'X, the covariance S of the scores X'e under the noise (Huber
    /// 1967; equal to X'X when the noise is white), and the prior precisions P. With P the estimate is pulled
    /// towards the prior's middle; S + P accounts for that pull as one more noise, so the interval also holds
    /// where the prior speaks. A free unknown that neither data nor prior say anything of has an infinite
    /// variance.
    pub fn new(
        gram: &DMatrix<f64>,
        scores: &DMatrix<f64>,
        prior_precision: &[f64],
        free: &[bool],
    ) -> Self {
        let size = free.len();
        let index = told(gram, prior_precision, free);
        let k = index.len();
        let mut covariance = DMatrix::zeros(size, size);
        let mut information = DMatrix::zeros(size, size);
        for i in (0..size).filter(|i| free[*i] && !index.contains(i)) {
            covariance[(i, i)] = f64::INFINITY;
        }
        if k == 0 {
            return Uncertainty {
                covariance,
                free: free.to_vec(),
                information,
            };
        }
        let (scale, inverse) = scaled_inverse(gram, prior_precision, &index);
        let pick = |m: &DMatrix<f64>| {
            DMatrix::from_fn(k, k, |a, b| scale[a] * scale[b] * m[(index[a], index[b])])
        };
        let (data, noise) = (pick(gram), pick(scores));
        let prior = DMatrix::from_diagonal(&DVector::from_fn(k, |a, _| {
            scale[a] * scale[a] * prior_precision[index[a]]
        }));
        let v = &inverse * (&noise + &prior) * &inverse;
        // Information of the data: X'X S^-1 X'X, by the same scales; where S is poor, X'X itself.
        let mut s = noise.clone();
        for a in 0..k {
            s[(a, a)] += 1e-9 * noise[(a, a)].max(1e-12);
        }
        let i_data = s
            .cholesky()
            .map_or_else(|| data.clone(), |c| &data * c.solve(&data));
        for a in 0..k {
            for b in 0..k {
                covariance[(index[a], index[b])] = v[(a, b)] * scale[a] * scale[b];
                information[(index[a], index[b])] = i_data[(a, b)] / (scale[a] * scale[b]);
            }
        }
        Uncertainty {
            covariance,
            free: free.to_vec(),
            information,
        }
    }

    /// Standard error of an unknown in the search's scale; NaN where it is not free.
    pub fn std_error(&self, unknown: usize) -> f64 {
        if self.free[unknown] {
            self.covariance[(unknown, unknown)].max(0.0).sqrt()
        } else {
            f64::NAN
        }
    }

    /// Correlation of two unknowns; NaN where one is not free.
    pub fn correlation(&self, a: usize, b: usize) -> f64 {
        self.covariance[(a, b)] / (self.covariance[(a, a)] * self.covariance[(b, b)]).sqrt()
    }

    /// Directions of the free unknowns, in units of `size` each, along which the data alone leave a standard
    /// deviation above `limit`: (standard deviation, direction), worst first. From the singular values of the
    /// scaled information.
    pub fn weak_directions(&self, size: &[f64], limit: f64) -> Vec<(f64, Vec<f64>)> {
        let index: Vec<usize> = (0..self.free.len()).filter(|&i| self.free[i]).collect();
        let k = index.len();
        if k == 0 {
            return Vec::new();
        }
        let scaled = DMatrix::from_fn(k, k, |a, b| {
            size[index[a]] * size[index[b]] * self.information[(index[a], index[b])]
        });
        if scaled.iter().any(|v| !v.is_finite()) {
            return Vec::new();
        }
        let eigen = ((&scaled + scaled.transpose()) * 0.5).symmetric_eigen();
        let mut out: Vec<(f64, Vec<f64>)> = (0..k)
            .map(|c| {
                let sd = 1.0 / eigen.eigenvalues[c].max(1e-12).sqrt();
                let mut direction = vec![0.0; self.free.len()];
                for (a, &i) in index.iter().enumerate() {
                    direction[i] = eigen.eigenvectors[(a, c)];
                }
                (sd, direction)
            })
            .filter(|(sd, _)| *sd > limit)
            .collect();
        out.sort_by(|a, b| b.0.total_cmp(&a.0));
        out
    }
}

/// How far the free unknowns of a least-squares estimate move when `score` is added to its scores X'r: -H^-1
/// score with H = X'X + P; 0 for the others.
pub fn moved_by(
    gram: &DMatrix<f64>,
    prior_precision: &[f64],
    free: &[bool],
    score: &DVector<f64>,
) -> DVector<f64> {
    let index = told(gram, prior_precision, free);
    let (scale, inverse) = scaled_inverse(gram, prior_precision, &index);
    let step = inverse * DVector::from_fn(index.len(), |a, _| -scale[a] * score[index[a]]);
    let mut out = DVector::zeros(free.len());
    for (a, &i) in index.iter().enumerate() {
        out[i] = scale[a] * step[a];
    }
    out
}

/// The free unknowns of which data or prior say anything.
fn told(gram: &DMatrix<f64>, prior_precision: &[f64], free: &[bool]) -> Vec<usize> {
    let says = |i: &usize| gram[(*i, *i)] + prior_precision[*i] != 0.0;
    (0..free.len()).filter(|&i| free[i]).filter(says).collect()
}

/// The unknowns in `index` scaled so that the diagonal of H = X'X + P is 1: (scale, inverse of the scaled H).
fn scaled_inverse(
    gram: &DMatrix<f64>,
    prior_precision: &[f64],
    index: &[usize],
) -> (Vec<f64>, DMatrix<f64>) {
    let k = index.len();
    let scale: Vec<f64> = index
        .iter()
        .map(|&i| 1.0 / (gram[(i, i)] + prior_precision[i]).sqrt().max(1e-150))
        .collect();
    let mut h = DMatrix::from_fn(k, k, |a, b| {
        scale[a] * scale[b] * gram[(index[a], index[b])]
    });
    for (a, &i) in index.iter().enumerate() {
        h[(a, a)] += scale[a] * scale[a] * prior_precision[i] + 1e-12;
    }
    // the singular values of a matrix that is not finite are sought without end: nothing is known then
    let inverse = match h.clone().cholesky() {
        Some(c) => c.inverse(),
        None if h.iter().any(|v| !v.is_finite()) => DMatrix::from_element(k, k, f64::NAN),
        None => h.pseudo_inverse(1e-12).expect("the tolerance is positive"),
    };
    (scale, inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_noise_gives_the_textbook_covariance() {
        let x = DMatrix::from_fn(40, 3, |i, j| ((i * (j + 2)) as f64 * 0.37).sin());
        let g = x.tr_mul(&x);
        let u = Uncertainty::new(&g, &g, &[0.0; 3], &[true; 3]);
        let want = g.clone().try_inverse().unwrap();
        assert!((&u.covariance - &want).amax() < 1e-9 * want.amax());
        assert!((&u.information - &g).amax() < 1e-6 * g.amax());
    }

    #[test]
    fn a_direction_without_data_is_weak_and_kept_by_the_prior() {
        let g = DMatrix::from_row_slice(2, 2, &[100.0, 100.0, 100.0, 100.0]);
        let u = Uncertainty::new(&g, &g, &[1.0, 1.0], &[true, true]);
        // x - y is known from the prior only: variance of each is about 1/2.
        assert!(
            (u.covariance[(0, 0)] - 0.5).abs() < 0.01,
            "{}",
            u.covariance
        );
        let weak = u.weak_directions(&[1.0, 1.0], 0.5);
        assert_eq!(weak.len(), 1);
        assert!((weak[0].1[0] + weak[0].1[1]).abs() < 1e-6, "{weak:?}");
    }

    #[test]
    fn a_score_moves_the_estimate_as_a_refit_does() {
        let x = DMatrix::from_fn(40, 3, |i, j| ((i * (j + 2)) as f64 * 0.37).sin());
        let y = DVector::from_fn(40, |i, _| (i as f64 * 0.7).cos());
        let g = x.tr_mul(&x);
        // r = X theta - y at theta = 0: the step to the estimate of the first and last, the middle one held
        let step = moved_by(&g, &[0.0; 3], &[true, false, true], &-x.tr_mul(&y));
        let two = DMatrix::from_columns(&[x.column(0), x.column(2)]);
        let want = two.clone().svd(true, true).solve(&y, 1e-12).unwrap();
        assert!((step[0] - want[0]).abs() < 1e-9 && (step[2] - want[1]).abs() < 1e-9);
        assert_eq!(step[1], 0.0);
    }

    #[test]
    fn what_is_held_has_no_error() {
        let g = DMatrix::identity(2, 2);
        let u = Uncertainty::new(&g, &g, &[0.0; 2], &[true, false]);
        assert!(u.std_error(1).is_nan() && (u.std_error(0) - 1.0).abs() < 1e-9);
    }
}
