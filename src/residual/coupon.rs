//! The residual of film coupons: predicted minus measured nominal stress, of several coupons that share one
//! film.
//!
//! # Why it is separable, the uniaxial test included
//! A coupon prescribes lambda_1. Equibiaxial lambda_2 = lambda_1 and pure shear lambda_2 = 1 are prescribed
//! too. In a uniaxial test lambda_2 follows from sigma_2 = sum s_n2 = 0, which looks as if it depended on the
//! moduli. It does not, when the film begins alike across width and thickness (virgin, xi_n1 = xi_n2 = 1; or
//! relaxed at the first stretch, xi_n2 = xi_n1^(-1/2)):
//!
//! ```text
//! suppose    lambda_2 = lambda_1^(-1/2)  and  xi_n2 = xi_n1^(-1/2)              for every branch n
//! then       A = (lambda_1/xi_n1)^2,  B = (lambda_2/xi_n2)^2 = A^(-1/2),  C = 1/(A B) = A^(-1/2) = B
//! so         s_n2 = mu_n (B - C)/D = 0                                          in every spring by itself
//! and        d ln xi_n1/dt = s_n1/(3 eta_n),   d ln xi_n2/dt = -s_n1/(6 eta_n) = -1/2 d ln xi_n1/dt
//! ```
//!
//! so that xi_n2 = xi_n1^(-1/2) stays, sigma_2 = 0 holds whatever the moduli, and by the uniqueness of the
//! solution there is no other. (`tests/fit/coupon.rs` solves sigma_2 = 0 with lambda_2 free and finds it.)
//! Hence a coupon of any mode is one known stretch history, and its nominal stress
//!
//! ```text
//! P = sigma_1/lambda_1 = sum_n mu_n [ (A_n - C_n)/(D_n lambda_1) ](T_n, J)
//! ```
//!
//! is linear in the moduli given relaxation times and J: one kernel pass with the lever (1/lambda_1, 0).
//!
//! # Every row counts, at the price of the grid
//! The kernel gives P at the nodes of the grid, a row reads it between two nodes by a straight line. The rows
//! within one step ask for the sum over (1 - f_i) p_k + f_i p_(k+1) - d_i squared, a quadratic form in (p_k,
//! p_(k+1), 1): two pseudo-rows (mean, slope) and a constant have the same sum for every p, so that they
//! stand for all rows exactly.
//!
//! # Weights
//! Models of real film err by far more than the noise, so that weighing by the noise alone would let a hold
//! of 1800 s at 50 Hz rule out a ramp of 20 s. What is judged is each coupon's root mean square error over
//! its stress range (NRMSE), so each coupon counts with that: a row of coupon c is divided by
//!
//! ```text
//! scale_c = kappa range_c sqrt(rows_c),     kappa = max over coupons of noise_c/(range_c sqrt(rows_c))
//! ```
//!
//! and the cost is sum_c NRMSE_c^2/kappa^2. With this kappa no row counts for more than its noise allows: a
//! single coupon is weighed by its noise, of several the one that its noise limits most, the others for less.
//! The uncertainty knows the true noise (see [`CouponResidual::score_covariance`]).

use nalgebra::DMatrix;
use pulp::Arch;
use rayon::prelude::*;

use super::gram::{PAD, add_rows};
use super::{Normal, SeparableResidual, Slope};
use crate::dataset::Coupon;
use crate::film::kernel::{History, LANES, Node, Pass, ROW, Segment, Shape};
use crate::film::{Film, Locked};

/// Nodes of one kernel block.
const BLOCK: usize = 128;

/// A coupon on which the film reaches its locking stretch.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("coupon `{coupon}`, time from its first row: {locked}")]
pub struct CouponLocked {
    /// Coupon.
    pub coupon: String,
    /// Spring, invariant and time.
    pub locked: Locked,
}

/// a p_node + b p_(node + 1) - measured: what stands for the rows of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PseudoRow {
    node: usize,
    a: f64,
    b: f64,
    measured_pa: f64,
}

/// One coupon, worked out as far as it does not depend on the parameters.
struct Prepared<'a> {
    coupon: &'a Coupon,
    history: History,
    rows: Vec<PseudoRow>,
    /// Sum of squares that no prediction on the grid can reach, Pa^2.
    scatter_pa2: f64,
    count: usize,
    range_pa: f64,
    scale_pa: f64,
}

/// Residual of several coupons that share a film; eta holds ln T_1 .. ln T_n, ln J; beta the n + 1 moduli,
/// Pa.
pub struct CouponResidual<'a> {
    coupons: Vec<Prepared<'a>>,
    branches: usize,
    arch: Arch,
}

/// The stretch history of a coupon, with the lever that turns stress into nominal stress.
fn history(coupon: &Coupon) -> History {
    stretch_history(coupon, &coupon.grid.stretch, &coupon.grid.mid_stretch)
}

/// The same for other stretches at the nodes of its grid, and in the middle of the steps that end there.
pub(super) fn stretch_history(coupon: &Coupon, stretch: &[f64], middle: &[f64]) -> History {
    let node = |lambda: f64, middle: f64| {
        let square = |l: f64| coupon.stretches(l).map(|v| v * v);
        Node {
            lambda_squared: square(lambda),
            rest: square(lambda).map(f64::recip),
            mid_rest: square(middle).map(f64::recip),
            lever: [1.0 / lambda, 0.0],
        }
    };
    let grid = &coupon.grid;
    let mut from = 1;
    let segments = grid
        .runs
        .iter()
        .map(|&(step_s, steps)| {
            let nodes = (from..from + steps)
                .map(|k| node(stretch[k], middle[k]))
                .collect();
            from += steps;
            Segment {
                step_s,
                through: Default::default(),
                stride: 1,
                nodes,
            }
        })
        .collect();
    History {
        initial: coupon.initial,
        first: node(stretch[0], stretch[0]),
        segments,
    }
}

/// Pseudo-rows and the scatter about them.
fn compress(coupon: &Coupon) -> (Vec<PseudoRow>, f64) {
    let mut rows: Vec<PseudoRow> = Vec::new();
    let mut scatter = 0.0;
    let mut held: Vec<(f64, f64)> = Vec::new();
    let mut close = |node: usize, held: &mut Vec<(f64, f64)>| {
        if held.is_empty() {
            return;
        }
        let n = held.len() as f64;
        let (f, d) = held
            .iter()
            .fold((0.0, 0.0), |s, (f, d)| (s.0 + f / n, s.1 + d / n));
        let (ff, fd, dd) = held.iter().fold((0.0, 0.0, 0.0), |s, (fi, di)| {
            let (u, v) = (fi - f, di - d);
            (s.0 + u * u, s.1 + u * v, s.2 + v * v)
        });
        // sum (p(f_i) - d_i)^2 = n (p(f) - d)^2 + ff (slope of p - fd/ff)^2 + dd - fd^2/ff
        let weight = n.sqrt();
        rows.push(PseudoRow {
            node,
            a: weight * (1.0 - f),
            b: weight * f,
            measured_pa: weight * d,
        });
        if ff > 1e-12 {
            let weight = ff.sqrt();
            rows.push(PseudoRow {
                node,
                a: -weight,
                b: weight,
                measured_pa: fd / weight,
            });
            scatter += (dd - fd * fd / ff).max(0.0);
        } else {
            scatter += dd;
        }
        held.clear();
    };
    let mut step = 0;
    for i in coupon.rows() {
        let (node, f) = coupon.grid.place(coupon.time_s[i]);
        if node != step {
            close(step, &mut held);
            step = node;
        }
        held.push((f, coupon.stress_pa[i]));
    }
    close(step, &mut held);
    (rows, scatter)
}

impl<'a> CouponResidual<'a> {
    /// Prepares `coupons` for films with `branches` branches.
    pub fn new(coupons: &[&'a Coupon], branches: usize) -> Self {
        let mut prepared: Vec<Prepared> = coupons
            .par_iter()
            .map(|coupon| {
                let (rows, scatter_pa2) = compress(coupon);
                Prepared {
                    coupon,
                    history: history(coupon),
                    rows,
                    scatter_pa2,
                    count: coupon.rows().count(),
                    range_pa: coupon.stress_range_pa(),
                    scale_pa: 1.0,
                }
            })
            .collect();
        let share = |p: &Prepared| p.range_pa * (p.count as f64).sqrt();
        let kappa = prepared
            .iter()
            .map(|p| p.coupon.noise_pa / share(p))
            .fold(0.0, f64::max);
        for p in &mut prepared {
            p.scale_pa = kappa * share(p);
        }
        CouponResidual {
            coupons: prepared,
            branches,
            arch: Arch::new(),
        }
    }

    /// The coupons.
    pub fn coupons(&self) -> impl Iterator<Item = &'a Coupon> + '_ {
        self.coupons.iter().map(|p| p.coupon)
    }

    /// What a row of a coupon is divided by, Pa.
    pub fn scale_pa(&self, coupon: usize) -> f64 {
        self.coupons[coupon].scale_pa
    }

    /// Rows of all coupons.
    pub fn rows(&self) -> usize {
        self.coupons.iter().map(|p| p.count).sum()
    }

    /// Length of eta.
    pub fn nonlinear(&self) -> usize {
        self.branches + 1
    }

    /// The film at eta, beta.
    pub fn film(&self, eta: &[f64], beta: &[f64]) -> Film {
        let n = self.branches;
        Film {
            mu_pa: beta[..=n].to_vec(),
            relaxation_time_s: eta[..n].iter().map(|t| t.exp()).collect(),
            locking: eta[n].exp(),
        }
    }

    /// Columns of a row: springs, d/d ln T, d/d ln J, residual; padded.
    fn width(&self) -> usize {
        (3 * self.branches + 3).next_multiple_of(PAD)
    }

    /// Calls `each` with blocks of kernel rows: number of the first node and rows; each block begins with the
    /// last node of the one before.
    fn for_each_block(
        &self,
        number: usize,
        shape: Shape,
        mut each: impl FnMut(usize, &[f64]),
    ) -> Result<(), CouponLocked> {
        let p = &self.coupons[number];
        let mut pass = Pass::new(&p.history, shape);
        let width = pass.row_width();
        let mut held = vec![0.0; (BLOCK + 1) * width];
        let (mut first, mut have) = (0, 0);
        loop {
            let at = have * width;
            let produced =
                pass.next_block(&mut held[at..at + BLOCK * width])
                    .map_err(|locked| CouponLocked {
                        coupon: p.coupon.id.clone(),
                        locked,
                    })?;
            if produced == 0 {
                return Ok(());
            }
            let end = have + produced;
            each(first, &held[..end * width]);
            held.copy_within((end - 1) * width..end * width, 0);
            first += end - 1;
            have = 1;
        }
    }

    /// Gram matrix of one coupon's weighted columns (springs, d/d ln T, d/d ln J, residual at `reference`).
    fn gram(
        &self,
        number: usize,
        eta: &[f64],
        reference: &[f64],
    ) -> Result<DMatrix<f64>, CouponLocked> {
        let p = &self.coupons[number];
        let n = self.branches;
        let springs = n + 1;
        let relaxation: Vec<f64> = eta[..n].iter().map(|t| t.exp()).collect();
        let shape = Shape {
            relaxation_time_s: &relaxation,
            locking: eta[n].exp(),
        };
        let film_width = ROW * shape.packs();
        let width = self.width();
        let last = 3 * n + 2;
        let mut gram = vec![0.0; width * width];
        let mut rows = Vec::with_capacity(2 * BLOCK * width);
        let mut next = 0;
        let inverse = 1.0 / p.scale_pa;
        self.for_each_block(number, shape, |first, film| {
            let nodes = film.len() / film_width;
            rows.clear();
            while let Some(line) = p.rows.get(next).filter(|l| l.node + 1 < first + nodes) {
                next += 1;
                let at = (line.node - first) * film_width;
                let (left, right) = film[at..at + 2 * film_width].split_at(film_width);
                let (a, b) = (line.a * inverse, line.b * inverse);
                let from = rows.len();
                rows.resize(from + width, 0.0);
                let row = &mut rows[from..];
                for pack in 0..shape.packs() {
                    let at = pack * LANES;
                    let here = (springs - at).min(LANES);
                    let skip = usize::from(pack == 0); // the equilibrium spring has no T
                    let mix = |k: usize| a * left[pack * ROW + k] + b * right[pack * ROW + k];
                    for k in 0..here {
                        row[at + k] = mix(k);
                        row[springs + n + at + k] = mix(2 * LANES + k);
                    }
                    for k in skip..here {
                        row[springs + at + k - 1] = mix(LANES + k);
                    }
                }
                let predicted: f64 = row[..springs]
                    .iter()
                    .zip(reference)
                    .map(|(b, x)| b * x)
                    .sum();
                row[last] = predicted - line.measured_pa * inverse;
            }
            add_rows(self.arch, &rows, width, &mut gram);
        })?;
        let size = last + 1;
        // The lower triangle is the one that was filled.
        let mut out = DMatrix::from_fn(size, size, |i, j| gram[i.max(j) * width + i.min(j)]);
        out[(last, last)] += p.scatter_pa2 * inverse * inverse;
        Ok(out)
    }

    fn slopes(&self) -> Vec<Slope> {
        let n = self.branches;
        let relaxation = (0..n).map(|i| (i, Some(i + 1)));
        let locking = (0..=n).map(|i| (n, Some(i)));
        relaxation
            .chain(locking)
            .map(|(nonlinear, linear)| Slope { nonlinear, linear })
            .collect()
    }

    fn normal(&self, gram: DMatrix<f64>, rows: usize, reference: &[f64]) -> Normal {
        Normal {
            gram,
            slopes: self.slopes(),
            reference: reference.to_vec(),
            rows,
        }
    }

    /// Covariance of the scores X'e of the weighted columns [d r/d eta | B], first under the noise of each
    /// coupon, then with `variance_pa2` a row in its place: white noise of variance v in the rows of coupon c
    /// gives v/scale_c^2 times its Gram matrix.
    ///
    /// # Errors
    /// [`CouponLocked`] when the film is past its locking stretch.
    pub fn score_covariance(
        &self,
        eta: &[f64],
        beta: &[f64],
        variance_pa2: &[f64],
    ) -> Result<[DMatrix<f64>; 2], CouponLocked> {
        let size = self.nonlinear() + beta.len();
        let mut out = [DMatrix::zeros(size, size), DMatrix::zeros(size, size)];
        for (number, p) in self.coupons.iter().enumerate() {
            let gram = self.gram(number, eta, beta)?;
            let gram = self
                .normal(gram, p.count, beta)
                .at(self.nonlinear(), beta)
                .view((0, 0), (size, size))
                .into_owned();
            let squared = p.scale_pa * p.scale_pa;
            out[0] += &gram * (p.coupon.noise_pa * p.coupon.noise_pa / squared);
            out[1] += gram * (variance_pa2[number] / squared);
        }
        Ok(out)
    }

    /// Predicted nominal stress at every row that counts ([`Coupon::rows`]) of one coupon, Pa, for any film.
    ///
    /// # Errors
    /// [`CouponLocked`] when the film is past its locking stretch.
    pub fn predicted_pa(&self, number: usize, film: &Film) -> Result<Vec<f64>, CouponLocked> {
        let shape = Shape {
            relaxation_time_s: &film.relaxation_time_s,
            locking: film.locking,
        };
        let width = ROW * shape.packs();
        let coupon = self.coupons[number].coupon;
        let mut at_node = vec![0.0; coupon.grid.time_s.len()];
        self.for_each_block(number, shape, |first, rows| {
            for (k, row) in rows.chunks_exact(width).enumerate() {
                at_node[first + k] = (film.mu_pa.iter().enumerate())
                    .map(|(n, mu)| mu * row[n / LANES * ROW + n % LANES])
                    .sum();
            }
        })?;
        Ok(coupon
            .rows()
            .map(|i| {
                let (k, f) = coupon.grid.place(coupon.time_s[i]);
                (1.0 - f) * at_node[k] + f * at_node[k + 1]
            })
            .collect())
    }
}

impl SeparableResidual for CouponResidual<'_> {
    type Error = CouponLocked;

    fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, CouponLocked> {
        let grams: Vec<DMatrix<f64>> = (0..self.coupons.len())
            .into_par_iter()
            .map(|number| self.gram(number, eta, reference))
            .collect::<Result<_, _>>()?;
        let size = 3 * self.branches + 3;
        let gram = grams
            .into_iter()
            .fold(DMatrix::zeros(size, size), |sum, gram| sum + gram);
        Ok(self.normal(gram, self.rows(), reference))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::{CouponMode, CouponParts, GridChoice};
    use crate::film::InitialState;

    fn coupon(mode: CouponMode) -> Coupon {
        let time: Vec<f64> = (0..3000).map(|i| 0.02 * f64::from(i)).collect();
        let stretch: Vec<f64> = time
            .iter()
            .map(|t| 1.0 + 0.1 * t.min(8.0) + 1e-5 * (37.0 * t).sin())
            .collect();
        let stress_pa = time
            .iter()
            .map(|t| 1e4 * t.min(8.0) * (1.0 + (3.1 * t).sin()))
            .collect();
        let parts = CouponParts {
            id: "c".into(),
            mode,
            initial: InitialState::Virgin,
            time_s: Some(time),
            stretch,
            stress_pa,
        };
        Coupon::new(parts, &GridChoice::default()).unwrap()
    }

    #[test]
    fn pseudo_rows_stand_for_all_rows() {
        let coupons = [
            coupon(CouponMode::Uniaxial),
            coupon(CouponMode::Equibiaxial),
            coupon(CouponMode::PureShear),
        ];
        let coupons: Vec<&Coupon> = coupons.iter().collect();
        // nine springs: two packs of lanes
        for branches in [0, 2, 8] {
            let residual = CouponResidual::new(&coupons, branches);
            assert!(residual.coupons[0].rows.len() < 2000);
            let mut eta: Vec<f64> = (0..branches).map(|i| i as f64 - 2.0).collect();
            eta.push(40f64.ln());
            let beta: Vec<f64> = (0..=branches).map(|i| 1e4 + 3e3 * i as f64).collect();
            let normal = residual.evaluate(&eta, &beta).unwrap();
            let film = residual.film(&eta, &beta);
            let mut want = 0.0;
            for (number, c) in coupons.iter().enumerate() {
                let predicted = residual.predicted_pa(number, &film).unwrap();
                for (i, p) in c.rows().zip(predicted) {
                    want += ((p - c.stress_pa[i]) / residual.scale_pa(number)).powi(2);
                }
            }
            let got = normal.gram[(3 * branches + 2, 3 * branches + 2)];
            assert!((got - want).abs() < 1e-9 * want, "{got} {want}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let (one, two) = (
            coupon(CouponMode::Uniaxial),
            coupon(CouponMode::Equibiaxial),
        );
        let residual = CouponResidual::new(&[&one, &two], 3);
        let eta = [0.1_f64.ln(), 1f64.ln(), 12f64.ln(), 30f64.ln()];
        let beta = [2e4, 3e4, 1e4, 2e4];
        let gram = residual.evaluate(&eta, &beta).unwrap().at(4, &beta);
        let size = gram.nrows();
        // d (r'r)/d eta = 2 r' dr/d eta
        let cost = |eta: &[f64]| {
            let g = residual.evaluate(eta, &beta).unwrap().gram;
            g[(g.nrows() - 1, g.nrows() - 1)]
        };
        for j in 0..4 {
            let h = 1e-5;
            let (mut up, mut down) = (eta, eta);
            up[j] += h;
            down[j] -= h;
            let difference = (cost(&up) - cost(&down)) / (2.0 * h);
            let exact = 2.0 * gram[(j, size - 1)];
            assert!(
                (difference - exact).abs() < 1e-6 * exact.abs(),
                "{j}: {difference} {exact}"
            );
        }
    }
}
