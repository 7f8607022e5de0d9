//! For what no cause explains: which physical variables the residual depends on. A hypothesis, never a name.

use nalgebra::{DMatrix, DVector};

use super::Error;
use super::outcome::{Entry, Law};
use super::problem::{Fitted, Problem, Tangent};

/// Terms of a law at most.
const TERMS: usize = 4;
/// A term must take away this share of what is left.
const WORTH: f64 = 0.03;

/// Forward selection of terms over physical variables of each actuator, with everything projected out that a refit could absorb.
pub(super) fn law(problem: &Problem, train: &[Entry], fitted: &Fitted) -> Result<Law, Error> {
    let tangent = Tangent::new(problem, fitted)?;
    let mut names: Vec<String> = Vec::new();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for (number, entry) in train.iter().enumerate() {
        let d = entry.dataset;
        let m = problem.train.mechanics(number);
        let mut largest = [0.0_f64; 3];
        let mut at = 0;
        for (&c, w) in problem
            .train
            .kept(number)
            .iter()
            .zip(problem.train.whitening(number))
        {
            let t = d.time_s(c);
            let features: [Vec<(&str, f64)>; 3] = [0, 1, 2].map(|k| {
                let [angle, rate, _] = m.chains[k].theta_b[c];
                let v = d.voltage.at(k, t + d.offset_s) / 1e3;
                let dv = (d.voltage.at(k, t + 0.02 + d.offset_s)
                    - d.voltage.at(k, t - 0.02 + d.offset_s))
                    / 40.0;
                while at <= c {
                    for (k, l) in largest.iter_mut().enumerate() {
                        *l = l.max(m.chains[k].theta_dea_rad[at]);
                    }
                    at += 1;
                }
                let others: f64 = (0..3)
                    .filter(|&j| j != k)
                    .map(|j| d.voltage.at(j, t + d.offset_s).powi(2) / 1e6)
                    .sum();
                vec![
                    ("voltage", v),
                    ("voltage squared", v * v),
                    ("voltage to the fourth", v.powi(4)),
                    ("voltage rate", dv),
                    ("voltage times its rate", v * dv),
                    ("bicep rate", rate),
                    ("direction of motion", (rate / 0.02).tanh()),
                    ("bicep rate times its size", rate * rate.abs()),
                    ("bicep angle", angle),
                    ("bicep angle squared", (angle - 3.9).powi(2)),
                    ("bicep angle cubed", (angle - 3.9).powi(3)),
                    ("forearm swing", m.chains[k].theta_fa_rad[c]),
                    ("time", t),
                    ("time in the series", entry.when.series_s + t),
                    ("largest lozenge angle so far", largest[k]),
                    ("squared voltages of the other actuators", others),
                    ("acceleration along Z", m.acceleration_m_s2[c][2]),
                ]
            });
            if names.is_empty() {
                names = features[0].iter().map(|f| f.0.to_string()).collect();
                columns = vec![Vec::new(); names.len()];
            }
            for (f, column) in columns.iter_mut().enumerate() {
                let x = [0, 1, 2].map(|k| features[k][f].1);
                column.extend([
                    w[0] * x[0],
                    w[1] * x[0] + w[2] * x[1],
                    w[3] * x[0] + w[4] * x[1] + w[5] * x[2],
                ]);
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
    let slope = DVector::from_fn(columns.len(), |i, _| -columns[i].dot(r));
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
            let c = coefficients.as_ref().map_or(0.0, |c| c[place]);
            (names[i].clone(), c, alone.min(1.0))
        })
        .collect();
    Ok(Law {
        terms,
        share: (taken / total).min(1.0),
    })
}
