//! The scan: every effect of the catalogue, on all actuators and on one, at several sizes and shapes, by its
//! fingerprint alone: the change of the whitened residual when it is switched on a little, with everything
//! that a refit could absorb projected out.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::problem::{Fitted, Problem, Tangent};
use super::subject::Subject;
use crate::effects::{Acting, Effect, Quantity, Reach, Site};
use crate::film::Locked;

/// How many times smaller than what is met the change is by whose column one at a moment is scanned.
const SMALL: f64 = 20.0;

/// A hypothesis that was scanned: an effect with values near those that the data ask for.
#[derive(Debug, Clone)]
pub(super) struct Scanned {
    /// The effect with starting values for a refit.
    pub acting: Acting,
    /// Fall of the sum of squares that the linear theory promises.
    pub promised: f64,
    /// Share of the fingerprint that a refit of the plain model absorbs.
    pub hidden_share: f64,
    /// Square of the projected fingerprint, and the size (over its spread, or 1) that it belongs to.
    pub strength: (f64, f64),
}

/// The hypotheses of one effect that share a start: its columns on each actuator.
pub(super) struct Group {
    pub effect: &'static dyn Effect,
    pub values: Vec<Vec<f64>>,
    /// Column: value vector, actuator.
    columns: Vec<[DVector<f64>; 3]>,
}

impl Group {
    /// Changes every column in place.
    pub fn change(&mut self, mut each: impl FnMut(&mut [f64])) {
        for column in self.columns.iter_mut().flatten() {
            each(column.as_mut_slice());
        }
    }

    /// The columns with the effect on these actuators.
    pub fn columns_on(&self, on: [bool; 3]) -> Vec<DVector<f64>> {
        self.columns
            .iter()
            .map(|by_actuator| {
                if self.effect.reach() == Reach::All {
                    return by_actuator[0].clone();
                }
                let mut sum = DVector::zeros(by_actuator[0].len());
                for k in (0..3).filter(|&k| on[k]) {
                    sum += &by_actuator[k];
                }
                sum
            })
            .collect()
    }
}

/// All fingerprints at a fitted model, of the effects that are `wanted`.
pub(super) fn fingerprints<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
    wanted: &(dyn Fn(&str) -> bool + Sync),
) -> Vec<Group> {
    let residual = problem.residual(fitted);
    let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
    let starts = problem.train.starts();
    starts
        .into_par_iter()
        .filter(|(e, _)| wanted(e.id()))
        .filter_map(|(effect, values)| {
            let columns = values
                .iter()
                .map(|v| {
                    let single = |on: [bool; 3]| {
                        let acting = Acting {
                            effect,
                            values: v.clone(),
                            on,
                        };
                        residual.fingerprint(eta, beta, &acting)
                    };
                    let on = |k: usize| [0, 1, 2].map(|j| j == k);
                    Ok(if effect.reach() == Reach::All {
                        let whole = single([true; 3])?;
                        let none = DVector::zeros(0);
                        [DVector::from_vec(whole), none.clone(), none]
                    } else if effect.site() == Site::Motion {
                        [
                            DVector::from_vec(single(on(0))?),
                            DVector::from_vec(single(on(1))?),
                            DVector::from_vec(single(on(2))?),
                        ]
                    } else {
                        residual
                            .fingerprint_by_actuator(eta, beta, effect, v)?
                            .map(DVector::from_vec)
                    })
                })
                .collect::<Result<Vec<_>, Locked>>()
                .ok()?; // a start that the mechanism cannot follow is no hypothesis
            Some(Group {
                effect,
                values,
                columns,
            })
        })
        .collect()
}

/// What every hypothesis promises at a fitted model, most promising first; `units` are changes that might
/// come at a moment.
pub(super) fn scan<S: Subject>(
    problem: &Problem<S>,
    tangent: &Tangent,
    groups: &[Group],
    units: &[Unit],
    wanted: &(dyn Fn(&str) -> bool + Sync),
) -> Vec<Scanned> {
    let mut out: Vec<Scanned> = groups
        .par_iter()
        .flat_map_iter(|g| hypotheses(g, tangent))
        .collect();
    out.extend(
        steps(problem, tangent, units)
            .into_iter()
            .filter(|s| wanted(s.acting.effect.id())),
    );
    out.sort_by(|a, b| b.promised.total_cmp(&a.promised));
    out
}

fn hypotheses(group: &Group, tangent: &Tangent) -> Vec<Scanned> {
    let sets = group.effect.reach().sets();
    sets.iter()
        .filter_map(|&on| {
            let columns = group.columns_on(on);
            solve(
                group.effect,
                &group.values,
                on,
                &columns,
                tangent,
                &tangent.residual,
            )
        })
        .collect()
}

/// The best sizes of a start's columns and what they promise.
fn solve(
    effect: &'static dyn Effect,
    values: &[Vec<f64>],
    on: [bool; 3],
    columns: &[DVector<f64>],
    tangent: &Tangent,
    residual: &DVector<f64>,
) -> Option<Scanned> {
    let n = columns.len();
    let along: Vec<DVector<f64>> = columns.iter().map(|c| tangent.columns.tr_mul(c)).collect();
    let gram = DMatrix::from_fn(n, n, |i, j| {
        tangent.projected(columns[i].dot(&columns[j]), &along[i], &along[j])
    });
    let slope = DVector::from_fn(n, |i, _| {
        -columns[i].dot(residual) + tangent.hidden_product(&along[i], residual)
    });
    let whole: Vec<f64> = columns.iter().map(|c| c.norm_squared()).collect();
    let q = effect.parameters();
    // A column is the effect at `values[i]`: which size it holds, and how far that may be scaled.
    let size_of = |v: &[f64]| {
        (0..q.len())
            .filter(|&i| q[i].size)
            .max_by(|&a, &b| {
                let far = |i: usize| {
                    if q[i].off.is_finite() {
                        ((v[i] - q[i].off) / q[i].spread).abs()
                    } else {
                        1.0
                    }
                };
                far(a).total_cmp(&far(b))
            })
            .unwrap_or(0)
    };
    let threshold = q.iter().any(Quantity::is_threshold);
    let range: Vec<[f64; 2]> = values
        .iter()
        .map(|v| {
            if threshold {
                return [0.0, f64::INFINITY];
            }
            let i = size_of(v);
            let one = v[i] - q[i].off;
            let (a, b) = ((q[i].lower - q[i].off) / one, (q[i].upper - q[i].off) / one);
            [a.min(b), a.max(b)]
        })
        .collect();
    // Every subset of columns: the best that stays within its ranges.
    let mut best: Option<(f64, Vec<f64>)> = None;
    for set in 1..1_usize << n {
        let used: Vec<usize> = (0..n).filter(|i| set >> i & 1 == 1).collect();
        let g = DMatrix::from_fn(used.len(), used.len(), |i, j| {
            gram[(used[i], used[j])]
                + if i == j {
                    1e-9 * whole[used[i]] + 1e-300
                } else {
                    0.0
                }
        });
        let s = DVector::from_fn(used.len(), |i, _| slope[used[i]]);
        let Some(c) = g.clone().cholesky().map(|f| f.solve(&s)) else {
            continue;
        };
        let promised = c.dot(&s);
        let fits = used
            .iter()
            .zip(c.iter())
            .all(|(&i, c)| (range[i][0]..=range[i][1]).contains(c));
        if fits && promised.is_finite() && best.as_ref().is_none_or(|b| promised > b.0) {
            let mut all = vec![0.0; n];
            for (&i, c) in used.iter().zip(c.iter()) {
                all[i] = *c;
            }
            best = Some((promised, all));
        }
    }
    let (promised, c) = best?;
    let mut start = values[0].clone();
    if !threshold {
        for (i, q) in q.iter().enumerate().filter(|(_, q)| q.size) {
            start[i] = q.off
                + values
                    .iter()
                    .zip(&c)
                    .map(|(v, c)| c * (v[i] - q.off))
                    .sum::<f64>();
            start[i] = start[i].clamp(q.lower, q.upper);
        }
    }
    let first = size_of(&values[0]);
    let one = if threshold || q[first].off.is_infinite() {
        1.0
    } else {
        ((values[0][first] - q[first].off) / q[first].spread).abs()
    };
    Some(Scanned {
        acting: Acting {
            effect,
            values: start,
            on,
        },
        promised,
        hidden_share: 1.0 - (gram[(0, 0)] / whole[0].max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
        strength: (gram[(0, 0)].max(0.0), one),
    })
}

/// A change that lasts, as if it had been there from the first sample on.
pub(super) struct Unit {
    /// The effect with the value that the column belongs to.
    pub acting: Acting,
    /// Its first value.
    pub size: f64,
    /// Whitened change of the residual.
    pub column: Vec<f64>,
}

/// The changes that might come at a moment, at a fitted model: an electrode that fails, a payload that comes
/// or goes.
///
/// # Errors
/// [`Locked`] when the film is past its locking stretch.
pub(super) fn units<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
) -> Result<Vec<Unit>, Locked> {
    let moments = problem.train.moments();
    if moments.is_empty() {
        return Ok(Vec::new());
    }
    let residual = problem.residual(fitted);
    let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
    let mut out = Vec::new();
    for effect in moments {
        let size = effect.parameters()[0].spread / SMALL;
        let acting = |on: [bool; 3]| Acting {
            effect,
            values: vec![size, -1e6, -1.0],
            on,
        };
        let all = acting([true; 3]);
        let columns = match effect.reach() {
            Reach::All => vec![(all.on, residual.fingerprint(eta, beta, &all)?)],
            _ => {
                let each = residual.fingerprint_by_actuator(eta, beta, effect, &all.values)?;
                let one = |(k, column)| ([0, 1, 2].map(|j| j == k), column);
                each.into_iter().enumerate().map(one).collect()
            }
        };
        out.extend(columns.into_iter().map(|(on, column)| Unit {
            acting: acting(on),
            size,
            column,
        }));
    }
    Ok(out)
}

/// The best moment of each change: at every kept sample of the series and between recordings.
fn steps<S: Subject>(problem: &Problem<S>, tangent: &Tangent, units: &[Unit]) -> Vec<Scanned> {
    // Rows in the order of the series, latest first.
    let mut rows: Vec<(f64, f64, usize, usize)> = Vec::new(); // recording, time, first row, recording number
    let mut at = 0;
    for (number, when) in problem.train_when.iter().enumerate() {
        for t in problem.train.kept_times_s(number) {
            rows.push((when.recording as f64, t, at, number));
            at += S::CHAINS;
        }
    }
    rows.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.total_cmp(&a.1)));
    let p = tangent.columns.ncols();
    let mut out = Vec::new();
    for Unit {
        acting,
        size,
        column,
    } in units
    {
        let mut along = DVector::zeros(p);
        let (mut whole, mut product) = (0.0, 0.0);
        let mut best: Option<(f64, f64, usize)> = None; // promised, coefficient, row
        let q = &acting.effect.parameters()[0];
        for (i, row) in rows.iter().enumerate() {
            for a in row.2..row.2 + S::CHAINS {
                let m = column[a];
                whole += m * m;
                product += m * tangent.residual[a];
                along.axpy(m, &tangent.columns.row(a).transpose(), 1.0);
            }
            // Not at the edges of the series: a change before its beginning is no change.
            if i < 6 || i + 6 > rows.len() || i % 2 == 1 {
                continue;
            }
            let left = tangent.projected(whole, &along, &along);
            if left <= 1e-9 * whole {
                continue;
            }
            let score = product - tangent.hidden_product(&along, &tangent.residual);
            let c = -score / left;
            let value = c * size;
            if value < q.lower || value > q.upper {
                continue;
            }
            let promised = score * score / left;
            if best.is_none_or(|b| promised > b.0) {
                best = Some((promised, value, i));
            }
        }
        let Some((promised, value, i)) = best else {
            continue;
        };
        let (recording, time_s, ..) = rows[i];
        // Where the sample before is of an earlier recording the change lies between the two.
        let between = rows.get(i + 1).is_some_and(|b| b.0 < recording);
        let mut acting = acting.clone();
        acting.values = vec![value, if between { -1e6 } else { time_s }, recording];
        out.push(Scanned {
            acting,
            promised,
            hidden_share: 0.0,
            strength: (promised, (value / q.spread).abs()),
        });
    }
    out
}
