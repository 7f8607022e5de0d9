//! Simpler methods: what each would name at a glance, and, taken to their end, which model each builds and
//! how that does on recordings that were not fitted.
//!
//! Forward selection adds the cause of the catalogue whose refit lowers Akaike's criterion most, until none
//! does. Sparse regression (LASSO, penalty by the Bayesian information criterion) picks columns among the
//! fingerprints at once; the causes that it picks are then fitted without penalty (the relaxed LASSO,
//! Meinshausen 2007). Neither knows chance, rivals or held-out recordings.

use nalgebra::{DMatrix, DVector};

use super::errors::{holdout_gain, train_gain};
use super::fits::{choose, refit};
use super::outcome::{Error, RivalModel};
use super::problem::{Fitted, Problem, Tangent};
use super::scan::{Group, Scanned, Unit, scan};
use super::subject::Subject;
use super::{FIRST, MOST, POLISH};
use crate::effects::Acting;

const FORWARD: &str = "forward selection (AIC)";
const SPARSE: &str = "sparse regression (LASSO)";
/// Hypotheses that are fitted in full in each step of the forward selection.
const TRIED: usize = 6;
/// Columns that the sparse regression may choose from.
const COLUMNS: usize = 60;

/// The models of forward selection and of sparse regression; `tangent` is that of the plain fit.
///
/// # Errors
/// [`Error`] where a model cannot be evaluated.
pub(super) fn rival_models<S: Subject>(
    problem: &Problem<S>,
    holdout: Option<&S>,
    plain: &Fitted,
    tangent: &Tangent,
    groups: &[Group],
    units: &[Unit],
    wanted: &(dyn Fn(&str) -> bool + Sync),
) -> Result<Vec<RivalModel>, Error> {
    [
        (FORWARD, forward(problem, plain, groups, units, wanted)?),
        (SPARSE, sparse(problem, plain, tangent, groups)),
    ]
    .into_iter()
    .map(|(method, fitted)| {
        let (train, _) = train_gain(problem, plain, &fitted)?;
        let holdout = holdout_gain(problem, holdout, plain, &fitted)?.map(|g| g.0);
        Ok(RivalModel {
            method,
            effects: fitted.effects.iter().map(|a| a.effect.id()).collect(),
            train,
            holdout,
        })
    })
    .collect()
}

/// Akaike's criterion where the size of the noise is known: squares over their variance, and twice the number
/// of values.
fn criterion(f: &Fitted) -> f64 {
    f.cost() + 2.0 * f.free.len() as f64
}

fn forward<S: Subject>(
    problem: &Problem<S>,
    plain: &Fitted,
    groups: &[Group],
    units: &[Unit],
    wanted: &(dyn Fn(&str) -> bool + Sync),
) -> Result<Fitted, Error> {
    let mut best = plain.clone();
    while best.effects.len() < MOST {
        let tangent = Tangent::new(problem, &best)?;
        let scanned: Vec<Scanned> = scan(problem, &tangent, groups, units, wanted)
            .into_iter()
            .filter(|s| {
                let known = |a: &Acting| a.effect.id() == s.acting.effect.id();
                !best.effects.iter().any(known)
                    && s.promised > 2.0 * s.acting.free_values().len() as f64
            })
            .collect();
        let chosen = choose(&scanned, TRIED);
        let next = refit(problem, &best, &chosen, &best.effects)
            .into_iter()
            .min_by(|a, b| criterion(a).total_cmp(&criterion(b)))
            .filter(|n| criterion(n) < criterion(&best));
        match next {
            Some(n) => best = n,
            None => break,
        }
    }
    if best.effects.is_empty() {
        return Ok(best);
    }
    Ok(problem.fit_near(&best, &best.effects, POLISH))
}

fn sparse<S: Subject>(
    problem: &Problem<S>,
    plain: &Fitted,
    tangent: &Tangent,
    groups: &[Group],
) -> Fitted {
    let columns = columns(groups);
    let mut effects: Vec<Acting> = Vec::new();
    for (i, _) in lasso(tangent, &columns) {
        let own = &columns[i].0;
        if effects.len() < MOST && !effects.iter().any(|a| a.is(own)) {
            effects.push(own.clone());
        }
    }
    if effects.is_empty() {
        return plain.clone();
    }
    let first = problem.fit_near(plain, &effects, FIRST);
    problem.fit_near(&first, &first.effects, POLISH)
}

/// Every fingerprint, with the effect and the actuators that it belongs to.
fn columns(groups: &[Group]) -> Vec<(Acting, DVector<f64>)> {
    let mut out = Vec::new();
    for g in groups {
        for &on in g.effect.reach().sets() {
            for (values, column) in g.values.iter().zip(g.columns_on(on)) {
                let values = values.clone();
                let acting = Acting {
                    effect: g.effect,
                    values,
                    on,
                };
                out.push((acting, column));
            }
        }
    }
    out
}

/// What simpler methods name: a whiteness test, forward selection by Akaike's criterion, the largest
/// correlation of the raw residual, and sparse regression (LASSO, penalty by the Bayesian information
/// criterion) on projected fingerprints.
pub(super) fn named(
    tangent: &Tangent,
    groups: &[Group],
    scanned: &[Scanned],
) -> Vec<(&'static str, bool, Option<&'static str>)> {
    let r = &tangent.residual;
    let n = r.len() as f64;
    let mean_square = r.norm_squared() / n;
    let seen = mean_square > 1.0 + 3.0 * (2.0 / n).sqrt();
    let free = |s: &Scanned| s.acting.free_values().len() as f64;
    let first = scanned
        .iter()
        .max_by(|a, b| (a.promised - 2.0 * free(a)).total_cmp(&(b.promised - 2.0 * free(b))));
    let akaike = first
        .filter(|s| s.promised > 2.0 * free(s))
        .map(|s| s.acting.effect.id());
    let columns = columns(groups);
    let id = |i: usize| columns[i].0.effect.id();
    let raw = columns
        .iter()
        .map(|(_, c)| c.dot(r).abs() / (c.norm() * r.norm()).max(f64::MIN_POSITIVE))
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(&b.1));
    let correlation = raw.filter(|c| c.1 > 3.0 / n.sqrt()).map(|c| id(c.0));
    let sparse = lasso(tangent, &columns).first().map(|c| id(c.0));
    vec![
        ("whiteness test", seen, None),
        (FORWARD, akaike.is_some(), akaike),
        (
            "largest raw correlation",
            correlation.is_some(),
            correlation,
        ),
        (SPARSE, sparse.is_some(), sparse),
    ]
}

/// The LASSO on fingerprints with everything projected out that a refit could absorb, standardised, at the
/// penalty whose Bayesian information criterion is smallest: the columns that it keeps and their
/// coefficients, largest first.
fn lasso(tangent: &Tangent, columns: &[(Acting, DVector<f64>)]) -> Vec<(usize, f64)> {
    let r = &tangent.residual;
    struct Own<'a> {
        index: usize,
        column: &'a DVector<f64>,
        along: DVector<f64>,
        norm: f64,
        product: f64,
    }
    let mut list: Vec<Own> = columns
        .iter()
        .enumerate()
        .filter_map(|(index, (_, column))| {
            let along = tangent.columns.tr_mul(column);
            let square = tangent.projected(column.norm_squared(), &along, &along);
            (square > 1e-9 * column.norm_squared()).then(|| Own {
                index,
                product: (tangent.hidden_product(&along, r) - column.dot(r)) / square.sqrt(),
                column,
                along,
                norm: square.sqrt(),
            })
        })
        .collect();
    list.sort_by(|a, b| b.product.abs().total_cmp(&a.product.abs()));
    list.truncate(COLUMNS);
    let m = list.len();
    let gram = DMatrix::from_fn(m, m, |i, j| {
        let (a, b) = (&list[i], &list[j]);
        tangent.projected(a.column.dot(b.column), &a.along, &b.along) / (a.norm * b.norm)
    });
    let target = DVector::from_fn(m, |i, _| list[i].product);
    let (n, total) = (r.len() as f64, r.norm_squared());
    let mut best = (n * (total / n).ln(), DVector::zeros(m));
    let mut c = DVector::zeros(m);
    let top = if m > 0 { target.amax() } else { 0.0 };
    for step in 0..25 {
        let penalty = top * 0.8_f64.powi(step);
        for _ in 0..60 {
            let mut moved = 0.0_f64;
            for i in 0..m {
                let pull = target[i] - gram.column(i).dot(&c) + c[i];
                let next: f64 = pull.signum() * (pull.abs() - penalty).max(0.0);
                moved = moved.max((next - c[i]).abs());
                c[i] = next;
            }
            if moved < 1e-4 * top {
                break;
            }
        }
        let left = total - 2.0 * c.dot(&target) + c.dot(&(&gram * &c));
        let used = c.iter().filter(|x| **x != 0.0).count() as f64;
        let score = n * (left.max(1e-9) / n).ln() + used * n.ln();
        if score < best.0 {
            best = (score, c.clone());
        }
    }
    let kept = best.1.iter().enumerate().filter(|(_, c)| **c != 0.0);
    let mut kept: Vec<(usize, f64)> = kept.map(|(i, c)| (list[i].index, *c)).collect();
    kept.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    kept
}
