//! The marginal likelihood of groups about a film, and the choice among them.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rayon::prelude::*;

use super::columns::Known;
use super::{Fitted, Problem, Subject, Tangent};
use crate::film::Locked;

/// Groups of one site at most.
const GROUPS: usize = 3;
/// Scales that are tried: the square of one times the mean squared length of a group's columns.
pub(super) const SCALES: [f64; 9] = [1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8];
/// A direction in which one standard deviation of its prior changes the sum of squares by less is left out.
const VISIBLE: f64 = 0.05;
/// Times that the variance of what is left is told.
const NOISE_ROUNDS: usize = 4;
/// Share of what remains that a further group has to take away.
const WORTH: f64 = 0.05;

/// Chosen groups of a site with their scales (in standard normal unknowns).
#[derive(Clone, Default)]
pub(super) struct Choice {
    pub members: Vec<(usize, f64)>,
    pub score: f64,
}

/// A film without terms: its residual, and what of products a refit absorbs.
pub(super) struct About {
    pub tangent: Tangent,
    /// Sum of squares with priors, after the refit.
    pub base: f64,
    /// Rows that count as independent.
    pub count: f64,
}

impl About {
    /// Variance of what is left where the sum of squares is this.
    pub fn noise_of(&self, squares: f64) -> f64 {
        (squares / self.tangent.residual.len() as f64).max(1.0)
    }
}

impl About {
    /// The film of a fit, without its terms.
    pub fn new<S: Subject>(problem: &Problem<S>, film: &Fitted) -> Result<Self, Locked> {
        let tangent = Tangent::new(problem, film)?;
        let at = film.state.eta.iter().chain(&film.state.beta);
        let unknowns = problem.nonlinear.iter().chain(&problem.linear);
        let priors: f64 = (at.zip(unknowns))
            .filter_map(|(x, u)| u.prior.map(|p| ((x - p.mean) / p.sd).powi(2)))
            .sum();
        let slope = tangent.slope();
        Ok(About {
            base: tangent.residual.norm_squared() + priors - slope.dot(&tangent.absorbed(slope)),
            count: problem.independent * tangent.residual.len() as f64,
            tangent,
        })
    }
}

/// a'b: through the fast product, which the transposed one of nalgebra is not.
fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    a.transpose() * b
}

/// Projected products of the groups of one site: of each with itself, and of the chosen ones with all.
pub(super) struct Products<'a> {
    about: &'a About,
    groups: &'a [Known],
    along: Vec<DMatrix<f64>>,
    own: Vec<DMatrix<f64>>,
    across: BTreeMap<(usize, usize), DMatrix<f64>>,
    score: Vec<DVector<f64>>,
    /// Products of the slopes of each with themselves, their sums, and products across.
    slope_own: Vec<Option<DMatrix<f64>>>,
    slope_sum: Vec<Option<DVector<f64>>>,
    slope_across: BTreeMap<(usize, usize), DMatrix<f64>>,
}

impl<'a> Products<'a> {
    pub fn new(about: &'a About, groups: &'a [Known]) -> Self {
        let tangent = &about.tangent;
        let made: Vec<_> = (groups.par_iter())
            .map(|g| {
                let along = product(&tangent.columns, &g.columns);
                let absorbed = tangent.absorb(&along);
                let own = product(&g.columns, &g.columns) - product(&along, &absorbed);
                let score = g.columns.tr_mul(&tangent.residual) - absorbed.tr_mul(tangent.slope());
                (along, own, score)
            })
            .collect();
        let (mut along, mut own, mut score) = (Vec::new(), Vec::new(), Vec::new());
        for (a, o, s) in made {
            along.push(a);
            own.push(o);
            score.push(s);
        }
        let slope_own = |g: &Known| g.slopes.as_ref().map(|s| product(s, s));
        let slope_sum = |g: &Known| g.slopes.as_ref().map(|s| s.row_sum().transpose());
        Products {
            about,
            groups,
            along,
            own,
            across: BTreeMap::new(),
            score,
            slope_own: groups.iter().map(slope_own).collect(),
            slope_sum: groups.iter().map(slope_sum).collect(),
            slope_across: BTreeMap::new(),
        }
    }

    /// Works out the products of one group with all others.
    pub fn meet(&mut self, i: usize) {
        let tangent = &self.about.tangent;
        let absorbed = tangent.absorb(&self.along[i]);
        let (groups, along) = (self.groups, &self.along);
        let me = &groups[i];
        let made: Vec<_> = (0..groups.len())
            .into_par_iter()
            .filter(|&j| j != i)
            .map(|j| {
                let own = product(&me.columns, &groups[j].columns) - product(&absorbed, &along[j]);
                let slopes =
                    (me.slopes.as_ref().zip(groups[j].slopes.as_ref())).map(|(a, b)| product(a, b));
                (j, own, slopes)
            })
            .collect();
        for (j, own, slopes) in made {
            self.across.insert((i, j), own);
            if let Some(slopes) = slopes {
                self.slope_across.insert((i, j), slopes);
            }
        }
    }

    /// Products of two groups, of which one is a chosen one, where the noise has this variance.
    fn between(&self, i: usize, j: usize, noise: f64) -> DMatrix<f64> {
        let (product, slopes) = match () {
            () if i == j => (self.own[i].clone(), self.slope_own[i].clone()),
            () => match self.across.get(&(i, j)) {
                Some(known) => (known.clone(), self.slope_across.get(&(i, j)).cloned()),
                None => (
                    self.across[&(j, i)].transpose(),
                    self.slope_across.get(&(j, i)).map(DMatrix::transpose),
                ),
            },
        };
        match slopes {
            Some(slopes) => product + slopes * noise,
            None => product,
        }
    }

    /// Scaled products of chosen groups, and their products with the residual.
    ///
    /// What acts on the voltage changes how much of it a torque asks for, and the voltage is what was
    /// recorded: -2 ln L has -2 sum ln(1 + slope), here to second order. Without it a term that takes away
    /// what is made would leave a film that takes nothing nothing to explain.
    pub fn joined(&self, members: &[(usize, f64)], noise: f64) -> (DMatrix<f64>, DVector<f64>) {
        let size = members.iter().map(|m| self.score[m.0].len()).sum();
        let (mut g, mut b) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let mut row = 0;
        for &(i, s) in members {
            let n = self.score[i].len();
            b.rows_mut(row, n).copy_from(&(s * &self.score[i]));
            if let Some(sum) = &self.slope_sum[i] {
                b.rows_mut(row, n).axpy(-s * noise, sum, 1.0);
            }
            let mut column = 0;
            for &(j, t) in members {
                let m = self.score[j].len();
                g.view_mut((row, column), (n, m))
                    .copy_from(&(s * t * self.between(i, j, noise)));
                column += m;
            }
            row += n;
        }
        (g, b)
    }

    /// -2 ln L and Q of chosen groups.
    pub fn judge(&self, members: &[(usize, f64)]) -> (f64, f64) {
        let about = self.about;
        let mut noise = about.noise_of(about.base);
        let mut out = (f64::INFINITY, about.base);
        // the noise is that of what is left
        for _ in 0..NOISE_ROUNDS {
            let (g, b) = self.joined(members, noise);
            let Some((log_det, c)) = log_det(g, noise) else {
                return out;
            };
            let q = (about.base - b.dot(&c.solve(&b))).max(1e-6 * about.base);
            let before = out.0;
            out = (about.count * (q / about.count).ln() + log_det, q);
            noise = about.noise_of(q);
            if (out.0 - before).abs() < 1.0 {
                break;
            }
        }
        out
    }

    /// Directions (columns, in unknowns of the chosen groups one after the other) that recordings see, and
    /// the means of their priors of standard deviation 1.
    pub fn directions(&self, members: &[(usize, f64)], noise: f64) -> (DMatrix<f64>, Vec<f64>) {
        let (g, b) = self.joined(members, noise);
        let (plain, without) = self.joined(members, 0.0);
        let eigen = SymmetricEigen::new(g.clone());
        let seen: Vec<usize> = (0..eigen.eigenvalues.len())
            .filter(|&i| eigen.eigenvalues[i] > VISIBLE * noise)
            .collect();
        let seen = eigen.eigenvectors.select_columns(&seen);
        // what the slopes ask for is part of the prior
        let size = seen.ncols();
        let precision = seen.tr_mul(&((g - plain) * &seen)) + DMatrix::identity(size, size) * noise;
        let pull = seen.tr_mul(&(without - b));
        let Some(root) = precision.cholesky() else {
            return (seen, vec![0.0; pull.len()]);
        };
        let lower = root.l();
        let back = |m: &DMatrix<f64>| lower.tr_solve_lower_triangular(m);
        let turned = back(&DMatrix::identity(lower.nrows(), lower.nrows()));
        let means = lower.solve_lower_triangular(&pull);
        let (Some(turned), Some(means)) = (turned, means) else {
            return (seen, vec![0.0; pull.len()]);
        };
        let mut out = seen * turned;
        let mut row = 0;
        for &(i, scale) in members {
            for _ in 0..self.score[i].len() {
                out.row_mut(row).scale_mut(scale);
                row += 1;
            }
        }
        (out, means.iter().copied().collect())
    }

    /// Mean squared length of a group's columns.
    pub fn unit(&self, i: usize) -> f64 {
        let g = &self.own[i];
        (g.trace() / g.nrows() as f64).max(f64::MIN_POSITIVE)
    }

    /// Groups joined one after the other.
    pub fn choose(&mut self, price: f64) -> Choice {
        let about = self.about;
        let plain = about.count * (about.base / about.count).ln();
        let mut best = Choice {
            members: Vec::new(),
            score: plain,
        };
        let mut left = about.base;
        while best.members.len() < GROUPS {
            let tried: Vec<(Choice, f64)> = (0..self.score.len())
                .into_par_iter()
                .filter(|i| best.members.iter().all(|m| m.0 != *i))
                .flat_map_iter(|i| {
                    let best = &best;
                    let this = &*self;
                    SCALES.iter().map(move |s| {
                        let mut members = best.members.clone();
                        members.push((i, (s / this.unit(i)).sqrt()));
                        let (score, q) = this.judge(&members);
                        let score = score + price * members.len() as f64;
                        (Choice { members, score }, q)
                    })
                })
                .collect();
            let next = tried
                .into_iter()
                .min_by(|a, b| a.0.score.total_cmp(&b.0.score));
            let Some((next, q)) = next else { break };
            let excess = (left - about.count).max(0.0);
            if next.score >= best.score || left - q < WORTH * excess {
                break;
            }
            left = q;
            self.meet(next.members[next.members.len() - 1].0);
            best = next;
            // scales of those that were there are told again beside the new one
            for at in 0..best.members.len() {
                let (i, _) = best.members[at];
                for s in SCALES {
                    let mut members = best.members.clone();
                    members[at].1 = (s / self.unit(i)).sqrt();
                    let score = self.judge(&members).0 + price * members.len() as f64;
                    if score < best.score {
                        best = Choice { members, score };
                    }
                }
            }
        }
        best.score -= plain;
        best
    }
}

/// ln det(1 + G/noise) and the factor of noise + G.
pub(super) fn log_det(mut g: DMatrix<f64>, noise: f64) -> Option<(f64, Cholesky<f64, Dyn>)> {
    let size = g.nrows() as f64;
    for i in 0..g.nrows() {
        g[(i, i)] += noise;
    }
    let c = g.cholesky()?;
    let log = 2.0 * c.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
    Some((log - size * noise.ln(), c))
}
