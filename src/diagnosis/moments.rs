//! What comes at a moment: an instrument that was knocked, counts that an encoder lost, a film that tore.
//!
//! A leap is a step of the balance, and one of its stiffness, from a moment on to the end of the recording.
//! The best moment of all is found, everything else that is fitted projected out of steps and residual alike;
//! then the next one beside it, as long as it pays for having been looked for.

use nalgebra::{DMatrix, DVector};

use super::blocks::{Blocks, Foretold};
use super::problem::Tangent;
use super::subject::Subject;
use crate::residual::line::LineResidual;

/// Most leaps: what goes on steadily is made of steps without number.
const MOST: usize = 8;
/// What a leap takes away at least, over the squares that nobody foretells and the logarithm of the places
/// where it may be: the largest of so many squares of noise is twice that logarithm for either size, and rows
/// are not independent.
const PAYS: f64 = 8.0;
/// Rows at either end of a recording from which on a step is none.
const EDGE: usize = 6;
/// Rows on either side over which a slope takes a leap's place.
const SLOPE: usize = 12;
/// Ridge of a leap over its squared length.
const RIDGE: f64 = 1e-4;

/// A model with leaps at moments.
pub(super) struct Moments {
    /// What it foretells.
    pub foretold: Foretold,
    /// Recording and time of each leap, s.
    pub at: Vec<(usize, f64)>,
    /// Share of the rows that count as independent beside them.
    pub independent: f64,
}

/// The best model with leaps beside what is fitted; `least` is the mean square that nobody foretells. `None`
/// where no leap pays, and where leaps never end.
pub(super) fn moments(
    residual: &LineResidual,
    tangent: &Tangent,
    blocks: &Blocks,
    least: f64,
) -> Option<Moments> {
    let rows = tangent.residual.len();
    let mut at: Vec<(usize, usize)> = Vec::new();
    let independent = loop {
        let leaps = columns(residual, rows, &at, |i, row| f64::from(u8::from(i >= row)));
        let own = tangent.columns.ncols();
        let mut all = DMatrix::zeros(rows, own + leaps.ncols());
        for (j, c) in (tangent.columns.column_iter().chain(leaps.column_iter())).enumerate() {
            all.set_column(j, &(c / c.norm().max(f64::MIN_POSITIVE)));
        }
        let base = all.qr().q();
        let left = &tangent.residual - &base * base.tr_mul(&tangent.residual);
        let pays = |b: &(f64, usize, usize)| b.0 > PAYS * (rows as f64).ln() * least;
        let Some((_, recording, row)) = best(residual, &base, &left).filter(pays) else {
            break residual.independent(left.as_slice());
        };
        if at.len() == MOST {
            return None;
        }
        at.push((recording, row));
    };
    if at.is_empty() {
        return None;
    }
    let foretell = |share: fn(usize, usize) -> f64| {
        let columns = columns(residual, rows, &at, share);
        let ridge = DVector::from_element(columns.ncols(), RIDGE);
        blocks.foretell(tangent, Some((&columns, &ridge)))
    };
    let foretold = foretell(|i, row| f64::from(u8::from(i >= row)));
    // what goes on steadily is told as well by slopes
    let slope = |i: usize, row: usize| {
        ((i + SLOPE).saturating_sub(row) as f64 / (2 * SLOPE) as f64).min(1.0)
    };
    if foretell(slope).mean_square() <= foretold.mean_square() {
        return None;
    }
    at.sort_unstable();
    let moment = |&(recording, row): &(usize, usize)| {
        let (time, ..) = residual.course(recording);
        (recording, time[residual.kept(recording)[row]])
    };
    Some(Moments {
        foretold,
        at: at.iter().map(moment).collect(),
        independent,
    })
}

/// Whitened columns of leaps at rows of recordings, one of the balance and one of its stiffness each; `share`
/// of row i is what has leapt by then.
fn columns(
    residual: &LineResidual,
    rows: usize,
    at: &[(usize, usize)],
    share: impl Fn(usize, usize) -> f64,
) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(rows, 2 * at.len());
    for (j, &(recording, row)) in at.iter().enumerate() {
        let first: usize = (0..recording).map(|r| residual.kept(r).len()).sum();
        for (i, s) in step(residual, recording).iter().enumerate() {
            for (k, s) in s.iter().enumerate() {
                out[(first + i, 2 * j + k)] = share(i, row) * s;
            }
        }
    }
    out
}

/// Whitened rows of a recording under a step of the balance, and under one of its stiffness.
fn step(residual: &LineResidual, recording: usize) -> Vec<[f64; 2]> {
    let (_, xi, _) = residual.course(recording);
    let of = |(&c, w): (&usize, &f64)| [*w, w * xi[c]];
    (residual.kept(recording).iter())
        .zip(residual.weights(recording))
        .map(of)
        .collect()
}

/// What the best leap takes away of the squares that are left, its recording and its row there. `base` are
/// orthonormal columns, out of which `left` is projected.
fn best(
    residual: &LineResidual,
    base: &DMatrix<f64>,
    left: &DVector<f64>,
) -> Option<(f64, usize, usize)> {
    let mut out: Option<(f64, usize, usize)> = None;
    let mut first = 0;
    for recording in 0..residual.lines().count() {
        let steps = step(residual, recording);
        let n = steps.len();
        let mut along = [(); 2].map(|()| DVector::<f64>::zeros(base.ncols()));
        let (mut gram, mut product) = ([0.0; 3], [0.0; 2]);
        for i in (0..n).rev() {
            let [a, b] = steps[i];
            let row = base.row(first + i).transpose();
            along[0].axpy(a, &row, 1.0);
            along[1].axpy(b, &row, 1.0);
            gram = [gram[0] + a * a, gram[1] + a * b, gram[2] + b * b];
            product = [
                product[0] + a * left[first + i],
                product[1] + b * left[first + i],
            ];
            if i < EDGE || i + EDGE > n {
                continue;
            }
            let own = [
                gram[0] - along[0].norm_squared(),
                gram[1] - along[0].dot(&along[1]),
                gram[2] - along[1].norm_squared(),
            ];
            let det = own[0] * own[2] - own[1] * own[1];
            if own[0] <= 1e-6 * gram[0] || det <= 1e-6 * own[0] * gram[2] {
                continue;
            }
            let [p, q] = product;
            let gain = (own[2] * p * p - 2.0 * own[1] * p * q + own[0] * q * q) / det;
            if out.is_none_or(|o| gain > o.0) {
                out = Some((gain, recording, i));
            }
        }
        first += n;
    }
    out
}
