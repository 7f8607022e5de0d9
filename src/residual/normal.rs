//! What a separable least-squares fit needs of one evaluation: all inner products of the residual's columns.
//!
//! A separable residual is r(eta, beta) = B(eta) beta - d(eta): linear in beta, not in eta. With the columns
//! of B, their derivatives with respect to eta, and the residual itself, one Gram matrix holds cost, gradient
//! and Gauss-Newton matrix for *every* beta, so that the linear part can be solved again without another
//! pass.

use nalgebra::DMatrix;

/// One column d B_i/d eta_j, or -d d/d eta_j where `linear` is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slope {
    /// Number j of the nonlinear parameter.
    pub nonlinear: usize,
    /// Number i of the linear parameter that multiplies the column; `None`: the column counts by itself.
    pub linear: Option<usize>,
}

/// Inner products of all columns at one eta.
#[derive(Debug, Clone)]
pub struct Normal {
    /// Gram matrix of [B | slopes | residual at `reference`], symmetric.
    pub gram: DMatrix<f64>,
    /// Which slope each of the middle columns is.
    pub slopes: Vec<Slope>,
    /// The linear parameters at which the last column is the residual.
    pub reference: Vec<f64>,
    /// Number of residuals.
    pub rows: usize,
}

impl Normal {
    /// Number of linear parameters.
    pub fn linear(&self) -> usize {
        self.reference.len()
    }

    /// The inner products of [d r/d eta (one column a nonlinear parameter) | B | r], where the parameters are
    /// eta, `beta`: symmetric, `nonlinear` + linear + 1 wide.
    pub fn at(&self, nonlinear: usize, beta: &[f64]) -> DMatrix<f64> {
        let linear = self.linear();
        let last = nonlinear + linear;
        // Each new column is a combination of the old ones, and most are old ones as they are.
        let combined = |old: &DMatrix<f64>| {
            let mut new = DMatrix::zeros(old.nrows(), last + 1);
            for (s, slope) in self.slopes.iter().enumerate() {
                let share = slope.linear.map_or(1.0, |i| beta[i]);
                let mut column = new.column_mut(slope.nonlinear);
                column.axpy(share, &old.column(linear + s), 1.0);
            }
            new.columns_mut(nonlinear, linear)
                .copy_from(&old.columns(0, linear));
            let mut residual = old.column(old.ncols() - 1).into_owned();
            for i in 0..linear {
                residual.axpy(beta[i] - self.reference[i], &old.column(i), 1.0);
            }
            new.set_column(last, &residual);
            new
        };
        // C'GC = (GC)'C, because G is symmetric
        combined(&combined(&self.gram).transpose())
    }
}

/// A residual r = B(eta) beta - d(eta) that knows how to give its inner products.
pub trait SeparableResidual {
    /// Why an evaluation fails.
    type Error: std::fmt::Display;

    /// Evaluates all columns at `eta`; the last column is the residual at `reference`.
    ///
    /// # Errors
    /// When the residual does not exist at `eta` (a film at its locking stretch, say): the fit counts it and
    /// steps back.
    fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, Self::Error>;
}
