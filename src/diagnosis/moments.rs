//! What comes at a moment: an instrument that was knocked, counts that an encoder lost, a film that tore.
//!
//! A leap is a step of the balance, and one of its springs, from a moment on to the end of the recording.
//! The best moment of all is found, everything else that is fitted projected out of steps and residual alike;
//! then the next one beside it, as long as it pays for having been looked for.

use nalgebra::{DMatrix, DMatrixView, DVector};

use super::blocks::{Blocks, Foretold};
use super::problem::Tangent;
use super::subject::Subject;
use crate::residual::line::LineResidual;

/// Most leaps, of each recording: what goes on steadily is made of steps without number.
const MOST: usize = 10;
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
    let steps = steps(residual, tangent);
    let mut at: Vec<(usize, usize)> = Vec::new();
    let most = MOST * steps.len();
    // what is fitted, then the leaps found so far, orthonormal
    let own = tangent.columns.clone().qr().q();
    let mut known = own.ncols();
    let mut base = own.resize_horizontally(known + 2 * most, 0.0);
    let mut left = tangent.residual.clone();
    let independent = loop {
        let so_far = base.columns(0, known);
        left -= so_far * so_far.tr_mul(&left);
        let pays = |b: &(f64, usize, usize)| b.0 > PAYS * (rows as f64).ln() * least;
        let Some((_, recording, row)) = best(&steps, so_far, &left).filter(pays) else {
            break residual.independent(left.as_slice());
        };
        if at.len() == most {
            return None;
        }
        at.push((recording, row));
        for mut column in columns(&steps, &at[at.len() - 1..], leapt)
            .column_iter()
            .map(|c| c.into_owned())
        {
            // twice is enough (Parlett 1980)
            for _ in 0..2 {
                let so_far = base.columns(0, known);
                column -= so_far * so_far.tr_mul(&column);
            }
            let norm = column.norm().max(f64::MIN_POSITIVE);
            base.set_column(known, &(column / norm));
            known += 1;
        }
    };
    if at.is_empty() {
        return None;
    }
    let foretell = |share: fn(usize, usize) -> f64| {
        let columns = columns(&steps, &at, share);
        let ridge = DVector::from_element(columns.ncols(), RIDGE);
        blocks.foretell(tangent, Some((&columns, &ridge)))
    };
    let foretold = foretell(leapt);
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

/// The share of a leap at a row that has come by row `i`.
fn leapt(i: usize, row: usize) -> f64 {
    f64::from(u8::from(i >= row))
}

/// Whitened columns of leaps at rows of recordings, one of the balance and one of its springs each; `share`
/// of row i is what has leapt by then.
fn columns(
    steps: &[Vec<[f64; 2]>],
    at: &[(usize, usize)],
    share: impl Fn(usize, usize) -> f64,
) -> DMatrix<f64> {
    let rows = steps.iter().map(Vec::len).sum();
    let mut out = DMatrix::zeros(rows, 2 * at.len());
    for (j, &(recording, row)) in at.iter().enumerate() {
        let first: usize = steps[..recording].iter().map(Vec::len).sum();
        for (i, s) in steps[recording].iter().enumerate() {
            for (k, s) in s.iter().enumerate() {
                out[(first + i, 2 * j + k)] = share(i, row) * s;
            }
        }
    }
    out
}

/// Whitened rows of each recording under a step of the balance, and under one of its springs: of an axis of
/// its stiffness, of the others of all that the model holds against what was measured.
fn steps(residual: &LineResidual, tangent: &Tangent) -> Vec<Vec<[f64; 2]>> {
    let mut first = 0;
    let of = |recording: usize| {
        let (_, xi, _) = residual.course(recording);
        let (kept, measured) = (residual.kept(recording), residual.measured(recording));
        let left = tangent.residual.rows(first, kept.len());
        first += kept.len();
        let rows = residual.weights(recording).iter().enumerate();
        let step = |(i, w): (usize, &f64)| match measured.get(i) {
            Some(measured) => [*w, w * measured + left[i]],
            None => [*w, w * xi[kept[i]]],
        };
        rows.map(step).collect()
    };
    (0..residual.lines().count()).map(of).collect()
}

/// What the best leap takes away of the squares that are left, its recording and its row there. `base` are
/// orthonormal columns, out of which `left` is projected.
fn best(
    steps: &[Vec<[f64; 2]>],
    base: DMatrixView<f64>,
    left: &DVector<f64>,
) -> Option<(f64, usize, usize)> {
    let mut out: Option<(f64, usize, usize)> = None;
    let mut first = 0;
    for (recording, steps) in steps.iter().enumerate() {
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
