//! Groups of columns at a site, whitened, with a normal prior of their coefficients.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::Subject;
use crate::effects::learnt::{Form, Learnt, Place};

/// Columns at one site that join together.
#[derive(Clone)]
pub(in crate::diagnosis) struct Group {
    pub place: Place,
    pub forms: Vec<Form>,
    /// Whether neighbouring coefficients are alike: values at knots.
    pub smooth: bool,
}

/// A group with its columns.
#[derive(Clone)]
pub(super) struct Known {
    pub group: Group,
    pub terms: Vec<&'static Learnt>,
    /// The actuators of each part.
    pub on: Vec<[bool; 3]>,
    /// Whitened columns of standard normal unknowns.
    pub columns: Arc<DMatrix<f64>>,
    /// From those unknowns to coefficients, for each part.
    pub roots: Vec<DMatrix<f64>>,
    /// What the unknowns change of the slope of the squared voltage; nothing where they do not act on it.
    pub slopes: Option<Arc<DMatrix<f64>>>,
}

/// What a term does along recordings.
#[derive(Default)]
pub(in crate::diagnosis) struct Made {
    /// Range of each of its variables.
    pub range: Vec<[f64; 2]>,
    /// The largest that it makes, in the unit of its place.
    pub largest: f64,
    /// Net work, and the sum of what is exchanged, in units that are alike.
    pub work: f64,
    pub exchanged: f64,
}

/// Lower root of the prior covariance of a group's coefficients, each of unit variance.
pub(super) fn prior_root(group: &Group, lengths: &[f64]) -> DMatrix<f64> {
    let n = lengths.len();
    if group.smooth {
        let near = |i: usize, j: usize| {
            let d = i.abs_diff(j) as f64 / SMOOTH;
            (-0.5 * d * d).exp() + if i == j { 1e-4 } else { 0.0 }
        };
        let k = DMatrix::from_fn(n, n, near);
        return k
            .cholesky()
            .map_or_else(|| DMatrix::identity(n, n), |c| c.l());
    }
    // of unlike units: each column counts alike
    let mean = lengths.iter().sum::<f64>() / n as f64;
    let each = lengths
        .iter()
        .map(|l| if *l > 1e-9 * mean { mean / l } else { 0.0 });
    DMatrix::from_diagonal(&DVector::from_iterator(n, each))
}

/// Knots over which values at knots are alike.
const SMOOTH: f64 = 1.2;

/// The columns of a group, shared by all actuators and one set for each: they do not depend on the film.
pub(super) fn known<S: Subject>(residual: &S, group: &Group) -> Vec<Known> {
    let term = |f: &Form| Learnt::new(group.place, f.clone(), Vec::new());
    let terms: Vec<&'static Learnt> = group.forms.iter().map(term).collect();
    let n = group.forms.iter().map(Form::count).sum::<usize>();
    let electrical = terms.iter().any(|t| t.electrical());
    let mut raw = [(); 3].map(|()| DMatrix::zeros(0, n));
    let mut slopes = raw.clone();
    let mut from = 0;
    for term in &terms {
        let (columns, slope) = residual.term_columns(term);
        let count = term.form.count();
        let put = |all: &mut [DMatrix<f64>; 3], own: [DMatrix<f64>; 3]| {
            for (all, own) in all.iter_mut().zip(own) {
                if all.nrows() == 0 {
                    *all = DMatrix::zeros(own.nrows(), n);
                }
                all.columns_mut(from, count).copy_from(&own);
            }
        };
        put(&mut raw, columns);
        if let Some(slope) = slope {
            put(&mut slopes, slope);
        }
        from += count;
    }
    let finite = |m: &DMatrix<f64>| m.iter().all(|x| x.is_finite());
    if !raw.iter().chain(&slopes).all(finite) {
        return Vec::new();
    }
    let lengths: Vec<f64> = (0..n)
        .map(|j| {
            raw.iter()
                .map(|m| m.column(j).norm_squared())
                .sum::<f64>()
                .sqrt()
        })
        .collect();
    if lengths.iter().all(|l| *l < 1e-9) {
        return Vec::new();
    }
    let root = prior_root(group, &lengths);
    let on: Vec<[bool; 3]> = (0..3).map(|k| [0, 1, 2].map(|j| j == k)).collect();
    let of = |sets: &[bool]| -> Vec<Known> {
        sets.iter()
            .map(|each| {
                let put = |all: &[DMatrix<f64>; 3]| match each {
                    false => (&all[0] + &all[1] + &all[2]) * &root,
                    true => {
                        let mut out = DMatrix::zeros(all[0].nrows(), 3 * n);
                        for (k, own) in all.iter().enumerate() {
                            out.columns_mut(k * n, n).copy_from(&(own * &root));
                        }
                        out
                    }
                };
                let on = if *each { on.clone() } else { vec![[true; 3]] };
                Known {
                    columns: Arc::new(put(&raw)),
                    slopes: electrical.then(|| Arc::new(put(&slopes))),
                    group: group.clone(),
                    terms: terms.clone(),
                    roots: vec![root.clone(); on.len()],
                    on,
                }
            })
            .collect()
    };
    of(match group.place {
        Place::Force => &[false],
        _ => &[false, true],
    })
}
