//! The springs of one film inside an implicit integrator: each branch's own 2 x 2 block is solved for and
//! eliminated, so that the film shows the balance nothing but a stress and a tangent (Eqs 18 to 23).
//!
//! State w_i = xi_i^-2. With A = lambda_1^2 w_1, B = lambda_2^2 w_2 and the Gent stress s = s(A, B) over its
//! modulus, the flow rule is
//!
//! ```text
//! w_1' = -w_1 (2 s_1 - s_2)/(3 T),    w_2' = -w_2 (2 s_2 - s_1)/(3 T)
//! ```
//!
//! without an exponential or a logarithm. The equilibrium spring is a lane with 1/T = 0.

use pulp::{Arch, Simd, WithSimd};

use crate::film::{Film, Locked, gent_stress};

/// Springs that one pack holds.
pub const LANES: usize = 8;
/// One number for each spring of a pack.
pub type Lanes = [f64; LANES];
/// w_1 and w_2 (or their rates) of the springs of one pack.
pub type Pack = [Lanes; 2];

/// Constants of the springs of one pack; a lane that is not used has modulus 0 and repeats the equilibrium
/// spring.
#[derive(Debug, Clone, Copy)]
struct Constants {
    mu: Lanes,
    /// 1/(3 T).
    third_rate: Lanes,
}

/// What a film answers to stretches and their logarithmic increments.
#[derive(Debug, Clone, Copy, Default)]
pub struct Response {
    /// Cauchy stress, Pa; in an implicit stage with the branches' own residual eliminated.
    pub sigma: [f64; 2],
    /// d sigma / d ln lambda, Pa: (11, 12, 21, 22).
    pub tangent: [f64; 4],
    /// Power that the branches turn into heat, W/m^3: sum mu/(3 T) (s_1^2 - s_1 s_2 + s_2^2).
    pub dissipation: f64,
    /// Smallest A B D of the springs: at or below zero a spring is locked.
    pub least: f64,
}

/// What an implicit stage keeps of a pack until the increments of the stretches are known:
/// d ln w = free + follow . d ln lambda.
#[derive(Debug, Clone, Copy)]
pub struct Elimination {
    free: [Lanes; 2],
    follow: [Lanes; 4],
}

impl Elimination {
    /// Nothing eliminated yet.
    pub const ZERO: Elimination = Elimination {
        free: [[0.0; LANES]; 2],
        follow: [[0.0; LANES]; 4],
    };
}

/// The springs of a film, packed in lanes.
#[derive(Debug, Clone)]
pub struct Springs {
    packs: Vec<Constants>,
    springs: usize,
    locking: f64,
    arch: Arch,
}

#[inline(always)]
fn load<S: Simd>(lanes: &Lanes, at: usize) -> S::f64s {
    S::as_simd_f64s(&lanes[at..at + S::F64_LANES]).0[0]
}

#[inline(always)]
fn store<S: Simd>(lanes: &mut Lanes, at: usize, value: S::f64s) {
    S::as_mut_simd_f64s(&mut lanes[at..at + S::F64_LANES]).0[0] = value;
}

/// Gent stress of a lane group and its derivatives.
struct Gent<V> {
    s1: V,
    s2: V,
    s11: V,
    s12: V,
    s22: V,
    /// A B D.
    q: V,
}

/// s_1 = (A - C)/D and so on, and S_ij = d s_i / d ln(A, B):
/// S_11 = (A + C)/D + s_1^2/J, S_12 = C/D + s_1 s_2/J, S_22 = (B + C)/D + s_2^2/J. One division.
#[inline(always)]
fn gent<S: Simd>(simd: S, a: S::f64s, b: S::f64s, inverse_locking: f64) -> Gent<S::f64s> {
    let mul = |a, b| simd.mul_f64s(a, b);
    let fma = |a, b, c| simd.mul_add_e_f64s(a, b, c);
    let one = simd.splat_f64s(1.0);
    let inverse_j = simd.splat_f64s(inverse_locking);
    let ab = mul(a, b);
    // A B D = A B (1 + 3/J) - (A B (A + B) + 1)/J
    let q = simd.negate_mul_add_e_f64s(
        inverse_j,
        fma(ab, simd.add_f64s(a, b), one),
        mul(ab, simd.splat_f64s(1.0 + 3.0 * inverse_locking)),
    );
    let inverse = simd.div_f64s(one, mul(ab, q));
    let c = mul(q, inverse);
    let inverse_d = mul(mul(ab, ab), inverse);
    let s1 = mul(simd.sub_f64s(a, c), inverse_d);
    let s2 = mul(simd.sub_f64s(b, c), inverse_d);
    let (j1, j2) = (mul(s1, inverse_j), mul(s2, inverse_j));
    Gent {
        s1,
        s2,
        s11: fma(simd.add_f64s(a, c), inverse_d, mul(s1, j1)),
        s12: fma(c, inverse_d, mul(s1, j2)),
        s22: fma(simd.add_f64s(b, c), inverse_d, mul(s2, j2)),
        q,
    }
}

/// Sums over the lanes of a pack.
#[derive(Clone, Copy)]
struct Sums<V> {
    sigma: [V; 2],
    tangent: [V; 4],
    dissipation: V,
    least: V,
}

impl<V: Copy> Sums<V> {
    #[inline(always)]
    fn zero<S: Simd<f64s = V>>(simd: S) -> Self {
        let zero = simd.splat_f64s(0.0);
        Sums {
            sigma: [zero; 2],
            tangent: [zero; 4],
            dissipation: zero,
            least: simd.splat_f64s(f64::INFINITY),
        }
    }

    #[inline(always)]
    fn total<S: Simd<f64s = V>>(self, simd: S) -> Response {
        // Written out: a closure handed to `map` would not be compiled for the vector unit.
        let [s1, s2] = self.sigma;
        let [t11, t12, t21, t22] = self.tangent;
        Response {
            sigma: [simd.reduce_sum_f64s(s1), simd.reduce_sum_f64s(s2)],
            tangent: [
                simd.reduce_sum_f64s(t11),
                simd.reduce_sum_f64s(t12),
                simd.reduce_sum_f64s(t21),
                simd.reduce_sum_f64s(t22),
            ],
            dissipation: simd.reduce_sum_f64s(self.dissipation),
            least: simd.reduce_min_f64s(self.least),
        }
    }
}

/// Stress and flow at given states.
struct Explicit<'a> {
    springs: &'a Springs,
    lambda_squared: [f64; 2],
    w: &'a [Pack],
    rate: &'a mut [Pack],
}

impl WithSimd for Explicit<'_> {
    type Output = Response;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Response {
        let inverse_locking = 1.0 / self.springs.locking;
        let mul = |a, b| simd.mul_f64s(a, b);
        let fma = |a, b, c| simd.mul_add_e_f64s(a, b, c);
        let l = [
            simd.splat_f64s(self.lambda_squared[0]),
            simd.splat_f64s(self.lambda_squared[1]),
        ];
        let two = simd.splat_f64s(2.0);
        let half = simd.splat_f64s(0.5);
        let mut sums = Sums::zero(simd);
        for ((k, w), rate) in self.springs.packs.iter().zip(self.w).zip(self.rate) {
            let mut at = 0;
            while at < LANES {
                let (w1, w2) = (load::<S>(&w[0], at), load::<S>(&w[1], at));
                let (mu, third) = (load::<S>(&k.mu, at), load::<S>(&k.third_rate, at));
                let g = gent(simd, mul(l[0], w1), mul(l[1], w2), inverse_locking);
                let f1 = simd.sub_f64s(mul(two, g.s1), g.s2);
                let f2 = simd.sub_f64s(mul(two, g.s2), g.s1);
                store::<S>(&mut rate[0], at, simd.neg_f64s(mul(mul(w1, third), f1)));
                store::<S>(&mut rate[1], at, simd.neg_f64s(mul(mul(w2, third), f2)));
                sums.sigma[0] = fma(mu, g.s1, sums.sigma[0]);
                sums.sigma[1] = fma(mu, g.s2, sums.sigma[1]);
                let mu2 = mul(mu, two);
                sums.tangent[0] = fma(mu2, g.s11, sums.tangent[0]);
                sums.tangent[1] = fma(mu2, g.s12, sums.tangent[1]);
                sums.tangent[2] = fma(mu2, g.s12, sums.tangent[2]);
                sums.tangent[3] = fma(mu2, g.s22, sums.tangent[3]);
                let heat = mul(mul(mu, half), mul(third, fma(g.s1, f1, mul(g.s2, f2))));
                sums.dissipation = simd.add_f64s(sums.dissipation, heat);
                sums.least = simd.min_f64s(sums.least, g.q);
                at += S::F64_LANES;
            }
        }
        sums.total(simd)
    }
}

/// Stress, tangent and elimination of an implicit stage w = w* + h gamma w'(w, lambda).
struct Implicit<'a> {
    springs: &'a Springs,
    lambda_squared: [f64; 2],
    weight: f64,
    star: &'a [Pack],
    w: &'a [Pack],
    elimination: &'a mut [Elimination],
}

impl WithSimd for Implicit<'_> {
    type Output = Response;

    /// With k = h gamma/(3 T), f = (2 s_1 - s_2, 2 s_2 - s_1) and P = [[2, -1], [-1, 2]] S:
    ///
    /// ```text
    /// 0 = G_i = w_i (1 + k f_i) - w*_i
    /// dG_i    = w_i (1 + k f_i) d ln w_i + w_i k sum_j P_ij (d ln w_j + 2 d ln lambda_j)
    /// ```
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Response {
        let inverse_locking = 1.0 / self.springs.locking;
        let mul = |a, b| simd.mul_f64s(a, b);
        let add = |a, b| simd.add_f64s(a, b);
        let sub = |a, b| simd.sub_f64s(a, b);
        let fma = |a, b, c| simd.mul_add_e_f64s(a, b, c);
        let fnma = |a, b, c| simd.negate_mul_add_e_f64s(a, b, c); // c - a b
        let l = [
            simd.splat_f64s(self.lambda_squared[0]),
            simd.splat_f64s(self.lambda_squared[1]),
        ];
        let weight = simd.splat_f64s(self.weight);
        let (one, two) = (simd.splat_f64s(1.0), simd.splat_f64s(2.0));
        let half = simd.splat_f64s(0.5);
        let mut sums = Sums::zero(simd);
        for (((k, star), w), out) in self
            .springs
            .packs
            .iter()
            .zip(self.star)
            .zip(self.w)
            .zip(self.elimination)
        {
            let mut at = 0;
            while at < LANES {
                let (w1, w2) = (load::<S>(&w[0], at), load::<S>(&w[1], at));
                let (mu, third) = (load::<S>(&k.mu, at), load::<S>(&k.third_rate, at));
                let g = gent(simd, mul(l[0], w1), mul(l[1], w2), inverse_locking);
                let f1 = sub(mul(two, g.s1), g.s2);
                let f2 = sub(mul(two, g.s2), g.s1);
                let kappa = mul(weight, third);
                let (n1, n2) = (fma(kappa, f1, one), fma(kappa, f2, one));
                let g1 = fma(w1, n1, simd.neg_f64s(load::<S>(&star[0], at)));
                let g2 = fma(w2, n2, simd.neg_f64s(load::<S>(&star[1], at)));
                let (k1, k2) = (mul(w1, kappa), mul(w2, kappa));
                let p11 = mul(k1, sub(mul(two, g.s11), g.s12));
                let p12 = mul(k1, sub(mul(two, g.s12), g.s22));
                let p21 = mul(k2, sub(mul(two, g.s12), g.s11));
                let p22 = mul(k2, sub(mul(two, g.s22), g.s12));
                let (m11, m22) = (fma(w1, n1, p11), fma(w2, n2, p22));
                let inverse = simd.div_f64s(one, fnma(p12, p21, mul(m11, m22)));
                // d ln w = -M^-1 (G + 2 P d ln lambda)
                let minus = simd.neg_f64s(inverse);
                let solve = |r1, r2| {
                    (
                        mul(minus, fnma(p12, r2, mul(m22, r1))),
                        mul(minus, fnma(p21, r1, mul(m11, r2))),
                    )
                };
                let (free1, free2) = solve(g1, g2);
                let (q11, q21) = solve(add(p11, p11), add(p21, p21));
                let (q12, q22) = solve(add(p12, p12), add(p22, p22));
                store::<S>(&mut out.free[0], at, free1);
                store::<S>(&mut out.free[1], at, free2);
                store::<S>(&mut out.follow[0], at, q11);
                store::<S>(&mut out.follow[1], at, q12);
                store::<S>(&mut out.follow[2], at, q21);
                store::<S>(&mut out.follow[3], at, q22);
                let s1 = fma(g.s11, free1, fma(g.s12, free2, g.s1));
                let s2 = fma(g.s12, free1, fma(g.s22, free2, g.s2));
                sums.sigma[0] = fma(mu, s1, sums.sigma[0]);
                sums.sigma[1] = fma(mu, s2, sums.sigma[1]);
                let (e11, e22) = (add(two, q11), add(two, q22));
                let (t11, t12) = (
                    fma(g.s11, e11, mul(g.s12, q21)),
                    fma(g.s11, q12, mul(g.s12, e22)),
                );
                let (t21, t22) = (
                    fma(g.s12, e11, mul(g.s22, q21)),
                    fma(g.s12, q12, mul(g.s22, e22)),
                );
                sums.tangent[0] = fma(mu, t11, sums.tangent[0]);
                sums.tangent[1] = fma(mu, t12, sums.tangent[1]);
                sums.tangent[2] = fma(mu, t21, sums.tangent[2]);
                sums.tangent[3] = fma(mu, t22, sums.tangent[3]);
                let heat = mul(mul(mu, half), mul(third, fma(g.s1, f1, mul(g.s2, f2))));
                sums.dissipation = add(sums.dissipation, heat);
                sums.least = simd.min_f64s(sums.least, g.q);
                at += S::F64_LANES;
            }
        }
        sums.total(simd)
    }
}

/// w follows the increments of the stretches.
struct Follow<'a> {
    increment: [f64; 2],
    w: &'a mut [Pack],
    elimination: &'a [Elimination],
}

impl WithSimd for Follow<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let fma = |a, b, c| simd.mul_add_e_f64s(a, b, c);
        let d = [
            simd.splat_f64s(self.increment[0]),
            simd.splat_f64s(self.increment[1]),
        ];
        let mut largest = simd.splat_f64s(0.0);
        for (w, e) in self.w.iter_mut().zip(self.elimination) {
            let mut at = 0;
            while at < LANES {
                for i in 0..2 {
                    let (q1, q2) = (
                        load::<S>(&e.follow[2 * i], at),
                        load::<S>(&e.follow[2 * i + 1], at),
                    );
                    let step = fma(q1, d[0], fma(q2, d[1], load::<S>(&e.free[i], at)));
                    let old = load::<S>(&w[i], at);
                    store::<S>(&mut w[i], at, fma(old, step, old));
                    largest = simd.max_f64s(largest, simd.abs_f64s(step));
                }
                at += S::F64_LANES;
            }
        }
        simd.reduce_max_f64s(largest)
    }
}

impl Springs {
    /// Packs the springs of `film`.
    pub fn new(film: &Film) -> Self {
        let springs = 1 + film.branches();
        let packs = (0..springs.div_ceil(LANES))
            .map(|pack| {
                let mut c = Constants {
                    mu: [0.0; LANES],
                    third_rate: [0.0; LANES],
                };
                for lane in 0..LANES {
                    let n = pack * LANES + lane;
                    c.mu[lane] = film.mu_pa.get(n).copied().unwrap_or(0.0);
                    if n > 0 && n < springs {
                        c.third_rate[lane] = 1.0 / (3.0 * film.relaxation_time_s[n - 1]);
                    }
                }
                c
            })
            .collect();
        Springs {
            packs,
            springs,
            locking: film.locking,
            arch: Arch::new(),
        }
    }

    /// Number of packs.
    pub fn packs(&self) -> usize {
        self.packs.len()
    }

    /// Every branch relaxed at stretches with the squares `lambda_squared` (xi = lambda); 1 in the other
    /// lanes.
    pub fn relaxed(&self, lambda_squared: [f64; 2], w: &mut [Pack]) {
        self.virgin(w);
        for n in 1..self.springs {
            for i in 0..2 {
                w[n / LANES][i][n % LANES] = 1.0 / lambda_squared[i];
            }
        }
    }

    /// A film that was never stretched: xi = 1.
    pub fn virgin(&self, w: &mut [Pack]) {
        for w in w.iter_mut().take(self.packs.len()) {
            *w = [[1.0; LANES]; 2];
        }
    }

    /// Stress, instantaneous tangent (branches frozen) and heat at given states; the rates w' go to `rate`.
    #[inline]
    pub fn explicit(&self, lambda_squared: [f64; 2], w: &[Pack], rate: &mut [Pack]) -> Response {
        self.arch.dispatch(Explicit {
            springs: self,
            lambda_squared,
            w,
            rate,
        })
    }

    /// One Newton pass of the implicit stage w = `star` + `weight` w'(w, lambda) at the iterate `w`.
    #[inline]
    pub fn implicit(
        &self,
        lambda_squared: [f64; 2],
        weight: f64,
        star: &[Pack],
        w: &[Pack],
        elimination: &mut [Elimination],
    ) -> Response {
        self.arch.dispatch(Implicit {
            springs: self,
            lambda_squared,
            weight,
            star,
            w,
            elimination,
        })
    }

    /// Moves `w` with the increments of ln lambda; returns the largest relative change.
    #[inline]
    pub fn follow(&self, increment: [f64; 2], w: &mut [Pack], elimination: &[Elimination]) -> f64 {
        self.arch.dispatch(Follow {
            increment,
            w,
            elimination,
        })
    }

    /// Free energy density, J/m^3: - sum mu J/2 ln D.
    pub fn energy_j_m3(&self, lambda_squared: [f64; 2], w: &[Pack]) -> f64 {
        let mut energy = 0.0;
        for n in 0..self.springs {
            let (pack, lane) = (n / LANES, n % LANES);
            let a = lambda_squared[0] * w[pack][0][lane];
            let b = lambda_squared[1] * w[pack][1][lane];
            if let Ok((_, d)) = gent_stress(a, b, self.locking) {
                energy -= 0.5 * self.packs[pack].mu[lane] * self.locking * d.ln();
            }
        }
        energy
    }

    /// The spring that is locked, where one is.
    pub fn locked(&self, lambda_squared: [f64; 2], w: &[Pack], at_s: f64) -> Locked {
        let mut found = Locked {
            spring: 1,
            invariant: f64::NAN,
            locking: self.locking,
            at_s: Some(at_s),
        };
        for n in 0..self.springs {
            let a = lambda_squared[0] * w[n / LANES][0][n % LANES];
            let b = lambda_squared[1] * w[n / LANES][1][n % LANES];
            if let Err(invariant) = gent_stress(a, b, self.locking) {
                found.spring = n + 1;
                found.invariant = invariant;
                break;
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn film(branches: usize) -> Film {
        Film {
            mu_pa: (0..=branches).map(|n| 1e5 * (n + 1) as f64).collect(),
            relaxation_time_s: (0..branches).map(|n| 0.003 * 5f64.powi(n as i32)).collect(),
            locking: 60.0,
        }
    }

    #[test]
    fn agrees_with_the_constitutive_law() {
        for branches in [0, 3, 7, 9] {
            let film = film(branches);
            let springs = Springs::new(&film);
            let mut w = vec![[[0.0; LANES]; 2]; springs.packs()];
            springs.relaxed([1.9, 0.9], &mut w);
            let lambda = [1.5, 0.8];
            let mut rate = w.clone();
            let got = springs.explicit(lambda.map(|l: f64| l * l), &w, &mut rate);
            let xi = vec![[1.9f64.sqrt(), 0.9f64.sqrt()]; branches];
            let (sigma, energy) = film.stress_pa(lambda, &xi).unwrap();
            for i in 0..2 {
                assert!((got.sigma[i] / sigma[i] - 1.0).abs() < 1e-13);
            }
            let own = springs.energy_j_m3(lambda.map(|l| l * l), &w);
            assert!((own / energy - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn elimination_is_the_derivative_of_the_solved_stage() {
        let film = film(9);
        let springs = Springs::new(&film);
        let mut star = vec![[[0.0; LANES]; 2]; springs.packs()];
        springs.relaxed([2.0, 0.8], &mut star);
        let mut e = vec![Elimination::ZERO; springs.packs()];
        let mut solve = |lambda: [f64; 2]| {
            let mut w = star.clone();
            let squared = lambda.map(|l| l * l);
            let mut last = Response::default();
            for _ in 0..12 {
                last = springs.implicit(squared, 0.01, &star, &w, &mut e);
                springs.follow([0.0; 2], &mut w, &e);
            }
            let mut rate = w.clone();
            springs.explicit(squared, &w, &mut rate);
            for p in 0..w.len() {
                for i in 0..2 {
                    for n in 0..LANES {
                        let residual = w[p][i][n] - star[p][i][n] - 0.01 * rate[p][i][n];
                        assert!(residual.abs() < 1e-14, "{residual:e}");
                    }
                }
            }
            last
        };
        let at = [1.45, 0.95];
        let here = solve(at);
        for j in 0..2 {
            let h = 1e-5;
            let (mut up, mut down) = (at, at);
            up[j] *= 1.0 + h;
            down[j] *= 1.0 - h;
            let (up, down) = (solve(up), solve(down));
            for i in 0..2 {
                let slope = (up.sigma[i] - down.sigma[i]) / (2.0 * h);
                let scale = here.tangent[0].abs();
                assert!((slope - here.tangent[2 * i + j]).abs() < 1e-7 * scale);
            }
        }
    }
}
