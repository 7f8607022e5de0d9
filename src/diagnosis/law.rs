//! For what no cause explains: which physical variables the residual depends on. A hypothesis, never a name.

use nalgebra::{DMatrix, DVector};

use super::Error;
use super::outcome::Law;
use super::problem::{Fitted, Problem, Tangent};
use super::subject::Subject;

/// Terms of a law at most.
const TERMS: usize = 4;
/// A term must take away this share of what is left.
const WORTH: f64 = 0.03;

/// Forward selection of terms over physical variables of each actuator, with everything projected out that a
/// refit could absorb.
pub(super) fn law<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Result<Law, Error> {
    let tangent = Tangent::new(problem, fitted)?;
    let mut names: Vec<&'static str> = Vec::new();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    // count, sum and sum of squares of each variable
    let mut moments: Vec<[f64; 3]> = Vec::new();
    for number in 0..problem.train_when.len() {
        let (own, values) = problem.train.features(number);
        if names.is_empty() {
            names = own;
            columns = vec![Vec::new(); names.len()];
            moments = vec![[0.0; 3]; names.len()];
        }
        let whitening = problem.train.whitening(number);
        for (m, values) in moments.iter_mut().zip(&values) {
            for x in values.iter().flat_map(|x| &x[..S::CHAINS]) {
                *m = [m[0] + 1.0, m[1] + x, m[2] + x * x];
            }
        }
        for (column, values) in columns.iter_mut().zip(values) {
            for (w, x) in whitening.iter().zip(values) {
                let white = [
                    w[0] * x[0],
                    w[1] * x[0] + w[2] * x[1],
                    w[3] * x[0] + w[4] * x[1] + w[5] * x[2],
                ];
                column.extend(&white[..S::CHAINS]);
            }
        }
    }
    let columns: Vec<DVector<f64>> = columns.into_iter().map(DVector::from_vec).collect();
    let r = &tangent.residual;
    let n = r.len() as f64;
    let total = (r.norm_squared() - n).max(1e-9);
    let along: Vec<DVector<f64>> = columns.iter().map(|c| tangent.columns.tr_mul(c)).collect();
    let gram = DMatrix::from_fn(columns.len(), columns.len(), |i, j| {
        tangent.projected(columns[i].dot(&columns[j]), &along[i], &along[j])
    });
    let slope = DVector::from_fn(columns.len(), |i, _| {
        tangent.hidden_product(&along[i], r) - columns[i].dot(r)
    });
    let explains = |set: &[usize]| -> Option<(f64, DVector<f64>)> {
        let g = DMatrix::from_fn(set.len(), set.len(), |i, j| {
            gram[(set[i], set[j])]
                + if i == j {
                    1e-6 * gram[(set[i], set[i])] + 1e-300
                } else {
                    0.0
                }
        });
        let s = DVector::from_fn(set.len(), |i, _| slope[set[i]]);
        let c = g.cholesky()?.solve(&s);
        Some((c.dot(&s), c))
    };
    let mut set: Vec<usize> = Vec::new();
    let mut taken = 0.0;
    while set.len() < TERMS {
        let best = (0..columns.len())
            .filter(|i| !set.contains(i))
            .filter_map(|i| {
                let mut with = set.clone();
                with.push(i);
                explains(&with).map(|e| (i, e.0))
            })
            .max_by(|a, b| a.1.total_cmp(&b.1));
        match best {
            Some((i, e)) if e - taken > WORTH * (total - taken).max(0.0) => {
                set.push(i);
                taken = e;
            }
            _ => break,
        }
    }
    let coefficients = explains(&set).map(|e| e.1);
    let terms = set
        .iter()
        .enumerate()
        .map(|(place, &i)| {
            let alone = explains(&[i]).map_or(0.0, |e| e.0) / total;
            let [count, sum, squares] = moments[i];
            let deviation = (squares / count - (sum / count).powi(2)).max(0.0).sqrt();
            let c = coefficients.as_ref().map_or(0.0, |c| c[place] * deviation);
            (names[i].to_owned(), c, alone.min(1.0))
        })
        .collect();
    Ok(Law {
        terms,
        share: (taken / total).min(1.0),
    })
}
