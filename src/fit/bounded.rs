//! Linear least squares within bounds, from the normal equations: the linear half of a separable fit.

use nalgebra::{DMatrix, DVector};

/// Minimises x'Gx/2 - b'x over lower <= x <= upper by the active-set method for bounded least squares (Stark
/// and Parker 1995, Comput. Stat. 10:129; Lawson and Hanson's NNLS where all bounds are 0 and infinity).
/// Equal bounds fix an unknown. G is symmetric, positive semidefinite; directions in which it is numerically
/// singular stay near `start`.
///
/// Gives the minimiser and, for each unknown, whether it is free.
///
/// # Panics
/// When the dimensions differ.
pub fn bounded_least_squares(
    g: &DMatrix<f64>,
    b: &DVector<f64>,
    lower: &[f64],
    upper: &[f64],
    start: &[f64],
) -> (DVector<f64>, Vec<bool>) {
    let n = b.len();
    assert!(g.nrows() == n && lower.len() == n && upper.len() == n && start.len() == n);
    // Columns scaled to unit norm.
    let scale: Vec<f64> = (0..n)
        .map(|i| {
            if g[(i, i)] > 0.0 {
                1.0 / g[(i, i)].sqrt()
            } else {
                1.0
            }
        })
        .collect();
    let mut x = DVector::from_fn(n, |i, _| start[i].clamp(lower[i], upper[i]));
    let mut free: Vec<bool> = (0..n).map(|i| lower[i] < x[i] && x[i] < upper[i]).collect();
    let gradient = |x: &DVector<f64>| g * x - b;
    let improving = |x: &DVector<f64>, i: usize, slope: f64| {
        let size = scale[i] * slope;
        (x[i] <= lower[i] && size < 0.0 && x[i] < upper[i])
            || (x[i] >= upper[i] && size > 0.0 && x[i] > lower[i])
    };
    let noise = 1e-13 * (0..n).map(|i| (b[i] * scale[i]).abs()).fold(0.0, f64::max);
    for _ in 0..10 * n + 10 {
        // Best point on the face of the free unknowns.
        let face: Vec<usize> = (0..n).filter(|&i| free[i]).collect();
        if !face.is_empty() {
            let m = face.len();
            let slope = gradient(&x);
            let mut a = DMatrix::from_fn(m, m, |i, j| {
                g[(face[i], face[j])] * scale[face[i]] * scale[face[j]]
            });
            for i in 0..m {
                a[(i, i)] += 1e-13;
            }
            let right = DVector::from_fn(m, |i, _| -slope[face[i]] * scale[face[i]]);
            let finite = a.iter().chain(&right).all(|v| v.is_finite());
            let step = match a.clone().cholesky() {
                Some(c) => c.solve(&right),
                // the singular values of such a matrix are sought without end
                None if !finite => break,
                None => a
                    .svd(true, true)
                    .solve(&right, 1e-12)
                    .expect("both factors were asked for"),
            };
            let mut length = 1.0;
            let mut hit = None;
            for (j, &i) in face.iter().enumerate() {
                let d = step[j] * scale[i];
                let room = if d < 0.0 {
                    lower[i] - x[i]
                } else {
                    upper[i] - x[i]
                };
                if d != 0.0 && room / d < length {
                    length = (room / d).max(0.0);
                    hit = Some(i);
                }
            }
            for (j, &i) in face.iter().enumerate() {
                x[i] = (x[i] + length * step[j] * scale[i]).clamp(lower[i], upper[i]);
            }
            if let Some(i) = hit {
                let to_lower = (x[i] - lower[i]).abs() < (x[i] - upper[i]).abs();
                x[i] = if to_lower { lower[i] } else { upper[i] };
                free[i] = false;
                continue;
            }
        }
        // Free the bound unknown that wants to leave its bound most.
        let slope = gradient(&x);
        let leaving = (0..n)
            .filter(|&i| {
                !free[i] && improving(&x, i, slope[i]) && (scale[i] * slope[i]).abs() > noise
            })
            .max_by(|&i, &j| {
                (scale[i] * slope[i])
                    .abs()
                    .total_cmp(&(scale[j] * slope[j]).abs())
            });
        match leaving {
            Some(i) => free[i] = true,
            None => break,
        }
    }
    (x, free)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_every_face_tried_in_turn() {
        let n = 5;
        for seed in 0..200u64 {
            let value = |i: usize| {
                (((seed * 131 + i as u64 * 7919) * 2_654_435_761) % 1000) as f64 / 500.0 - 1.0
            };
            let a = DMatrix::from_fn(9, n, |i, j| {
                value(i * n + j) + if i == j { 1.0 } else { 0.0 }
            });
            let y = DVector::from_fn(9, |i, _| value(100 + i));
            let (g, b) = (a.tr_mul(&a), a.tr_mul(&y));
            let (lower, upper) = ([0.0; 5], [0.4, f64::INFINITY, f64::INFINITY, 0.3, 0.2]);
            let cost = |x: &DVector<f64>| 0.5 * (x.transpose() * &g * x)[(0, 0)] - b.dot(x);
            let (x, _) = bounded_least_squares(&g, &b, &lower, &upper, &[0.1; 5]);
            // The minimiser over the box beats the best of a fine random cloud and of its own neighbours.
            for t in 0..400 {
                let other = DVector::from_fn(n, |i, _| {
                    (x[i] + value(1000 + 37 * t + i) * 0.1).clamp(lower[i], upper[i])
                });
                assert!(cost(&x) <= cost(&other) + 1e-12, "seed {seed}");
            }
        }
    }

    #[test]
    fn equal_bounds_fix_an_unknown() {
        let g = DMatrix::from_row_slice(2, 2, &[2.0, 1.0, 1.0, 2.0]);
        let b = DVector::from_column_slice(&[1.0, 1.0]);
        let (x, free) = bounded_least_squares(
            &g,
            &b,
            &[0.7, f64::NEG_INFINITY],
            &[0.7, f64::INFINITY],
            &[0.7, 0.0],
        );
        assert_eq!(x[0], 0.7);
        assert!((x[1] - 0.15).abs() < 1e-12);
        assert_eq!(free, [false, true]);
    }
}
