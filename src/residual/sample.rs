//! The hanging film sample (section 5 of the model) as a residual: predicted minus captured x, over the
//! capture's noise.
//!
//! The noise of a recording is in x alone; the voltage is known. So the model is run forward from the voltage
//! and held against x as it was captured, frames averaged over one step of the integration at a time. Each
//! row has variance one where the model is right: no smoothing, and the weight is exact.
//!
//! # Equations
//! Unstretched side strips and end strips begin alike across width and thickness and carry no field: s_2 = 0
//! holds in each of their springs, with e_2 = -e_1/2 (see `residual::coupon`). Unknown are u = ln lambda_1, v
//! = ln lambda_2 of the active part and w = ln lambda_1 of the end strips:
//!
//! ```text
//! (sigma_1 - sigma_2)/lambda_1 S_active + sigma_side/lambda_1 S_side = M (g - x'')       (sigma_2 = X put in)
//! sigma_end/lambda_e S_end                                           = M (g - x'')
//! sigma_2 = X = eps/L3^2 phi^2 c,   c = (lambda_1 lambda_2)^2
//! x = L_active lambda_1 + L_end lambda_e - rest length
//! ```
//!
//! # Scheme
//! One step h, second order throughout, stable for any stiffness:
//!
//! ```text
//! branch     e' = u' - (e + N(e))/T,  N = g(e) - e of second order in e
//!            e_+ = alpha e + beta (u_+ - u) - (1 - alpha) N - (1 - beta)(N - N_-)     alpha = exp(-h/T), beta = (1 - alpha) T/h
//! inertia    x_+ = x + h x' + h^2 ((1/2 - b) a + b a_+),  x'_+ = x' + h ((1 - g) a + g a_+)  (Newmark 1959)
//!            b = 1/12, g = 1/2, x''_+ = a_+ where a step is short for the bounce of the mass (Fox and Goodwin
//!            1949: of fourth order, stable below 2.4/omega); else b = 1, g = 3/2, x''_+ = 2 a_+ - a, which
//!            takes what is not resolved away (Houbolt 1950; Chung and Hulbert 1993 with rho = 0)
//! electrode  (c phi)' tau = phi_c - phi: exponential over the step with c' and the mean of c, phi_c linear
//! ```
//!
//! which leaves three equations in u, v, w a step for Newton; the derivatives with respect to all parameters
//! are those of the scheme, solved for with the same matrix. `tests/fit/sample.rs` holds it against
//! `simulate::sample_motion`, which shares nothing with it.

use pulp::Arch;

use crate::dataset::HangingDataset;
use crate::film::{Film, Locked, gent_stress};
use crate::model::HangingSample;

/// Branches that the scheme has place for.
pub const MOST_BRANCHES: usize = 8;
const LANES: usize = MOST_BRANCHES;
type Lanes = [f64; LANES];
/// Elastic log stretches: active 1 and 2, side strips, end strips.
const KINDS: usize = 4;
type Strains = [Lanes; KINDS];
/// Each kind, and which of u, v, w drives it.
const DRIVEN_BY: [(usize, usize); KINDS] = [(0, 0), (1, 1), (2, 0), (3, 2)];

/// Shortest R C of the scheme, s; below it R acts as if it were this. 2 ns on a film that answers in
/// milliseconds.
const LEAST_TIME_CONSTANT_S: f64 = 2e-9;
const NEWTON_ITERATIONS: usize = 25;
/// Newton's increment after which the next would move x by less than 0.1 nm.
const QUADRATIC: f64 = 2e-6;

/// What x is differentiated by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleKnob {
    /// Modulus of spring n, from 0, Pa.
    Modulus(usize),
    /// ln of the relaxation time of branch n, from 0.
    LogTime(usize),
    /// Modulus of the electrode's layer, Pa.
    ElectrodeModulus,
    /// Series resistance, ohm.
    Resistance,
    /// Share of the active area in contact (or of the permittivity: both scale C and the Maxwell stress).
    ActiveFraction,
    /// Mass on the free end, kg.
    Mass,
}

/// Why a hanging sample could not be run, and where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SampleTrouble {
    /// A spring at its locking stretch.
    #[error("{0}")]
    Locked(Locked),
    /// The film gives way, or no stretch carries the load.
    #[error(
        "at {at_s:.3} s the sample finds no equilibrium: the film gives way under voltage and load"
    )]
    GivesWay {
        /// Time on the motion clock, s.
        at_s: f64,
    },
}

/// A run of the model on a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleRun {
    /// Length at rest, m.
    pub rest_length_m: f64,
    /// x, downwards, m.
    pub x_m: Vec<f64>,
    /// Voltage on the film, V.
    pub phi_v: Vec<f64>,
    /// d x / d knob, one column a knob.
    pub columns: Vec<Vec<f64>>,
    /// d rest length / d knob.
    pub rest_columns: Vec<f64>,
}

/// Springs of one part at one state: stresses over their moduli and derivatives by ln A, ln B.
struct Gent {
    s1: Lanes,
    s2: Lanes,
    s11: Lanes,
    s12: Lanes,
    s22: Lanes,
    least: f64,
}

/// exp of eight small numbers; beyond 0.35 by the library.
#[inline(always)]
fn exp(x: &Lanes) -> Lanes {
    let mut large = false;
    for v in x {
        large |= v.abs() > 0.35 || v.is_nan();
    }
    if large {
        return x.map(f64::exp);
    }
    // Taylor to the eleventh order: the rest is below 0.35^12/12! = 7e-15 relative.
    let mut out = [1.0; LANES];
    for n in (1..12).rev() {
        let inverse = 1.0 / n as f64;
        for l in 0..LANES {
            out[l] = 1.0 + x[l] * inverse * out[l];
        }
    }
    out
}

#[inline(always)]
fn gent(a: &Lanes, b: &Lanes, inverse_locking: f64) -> Gent {
    let mut g = Gent {
        s1: [0.0; LANES],
        s2: [0.0; LANES],
        s11: [0.0; LANES],
        s12: [0.0; LANES],
        s22: [0.0; LANES],
        least: f64::INFINITY,
    };
    let mut d_all = [0.0; LANES];
    for l in 0..LANES {
        let c = 1.0 / (a[l] * b[l]);
        let d = 1.0 - (a[l] + b[l] + c - 3.0) * inverse_locking;
        let i = 1.0 / d;
        let (s1, s2) = ((a[l] - c) * i, (b[l] - c) * i);
        g.s1[l] = s1;
        g.s2[l] = s2;
        g.s11[l] = (a[l] + c) * i + s1 * s1 * inverse_locking;
        g.s12[l] = c * i + s1 * s2 * inverse_locking;
        g.s22[l] = (b[l] + c) * i + s2 * s2 * inverse_locking;
        d_all[l] = d;
    }
    for d in d_all {
        g.least = if d > g.least { g.least } else { d };
    }
    g
}

/// One spring (the equilibrium spring) at ln stretches.
#[inline(always)]
fn spring(u: f64, v: f64, inverse_locking: f64) -> [f64; 6] {
    let (a, b) = ((2.0 * u).exp(), (2.0 * v).exp());
    let c = 1.0 / (a * b);
    let d = 1.0 - (a + b + c - 3.0) * inverse_locking;
    let i = 1.0 / d;
    let (s1, s2) = ((a - c) * i, (b - c) * i);
    [
        s1,
        s2,
        (a + c) * i + s1 * s1 * inverse_locking,
        c * i + s1 * s2 * inverse_locking,
        (b + c) * i + s2 * s2 * inverse_locking,
        d,
    ]
}

/// All springs at one state.
struct Springs {
    /// Equilibrium: active, side, end.
    rest: [[f64; 6]; 3],
    active: Gent,
    side: Gent,
    end: Gent,
}

/// Constants of a run.
struct Constants {
    branches: usize,
    inverse_locking: f64,
    mu0: f64,
    layer: f64,
    mu: Lanes,
    alpha: Lanes,
    beta: Lanes,
    /// h/T.
    ratio: Lanes,
    lengths: [f64; 2],
    sections: [f64; 3],
    maxwell: f64,
    mass: f64,
    weight: f64,
    time_constant: f64,
    inertia: Inertia,
}

/// x, its rate, and its acceleration as the scheme averages it.
type Moving = [f64; 3];

/// How steps carry the bounce of the mass on the film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bounce {
    /// Short steps follow it, to fourth order.
    Followed,
    /// Long steps take it away.
    Damped,
}

/// Equal steps of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// First moment, on the motion clock, s.
    pub start_s: f64,
    /// Length of a step, s.
    pub step_s: f64,
    /// What they make of the bounce of the mass.
    pub bounce: Bounce,
}

/// Angle of the bounce within a step, rad, up to which it is followed. The scheme is stable up to 2.4: a film
/// that a fit tries may be five times as stiff.
const FOLLOWED_RAD: f64 = 1.0;

impl Steps {
    /// Steps that follow the bounce of `sample` where they are short enough for it.
    #[must_use]
    pub fn of(sample: &HangingSample, film: &Film, start_s: f64, step_s: f64) -> Self {
        let angle = bounce_rad_s(sample, film).map(|rate| rate * step_s);
        let bounce = match angle {
            Some(angle) if angle < FOLLOWED_RAD => Bounce::Followed,
            _ => Bounce::Damped,
        };
        Steps {
            start_s,
            step_s,
            bounce,
        }
    }
}

/// Angular frequency with which the mass bounces on the film at rest, before any branch relaxes, rad/s.
fn bounce_rad_s(sample: &HangingSample, film: &Film) -> Option<f64> {
    let steps = Steps {
        start_s: 0.0,
        step_s: 1.0,
        bounce: Bounce::Damped,
    };
    let c = Constants::new(sample, film, &steps);
    let (y, _) = rest(&c, 0.0, 0.0).ok()?;
    let s = c.springs(&y, &[[0.0; LANES]; KINDS]);
    let still = Loads::still(0.0, c.weight);
    let (b, _) = linearise(&c, &y, &s, &[1.0; LANES], &still);
    let moved = b.solve([1.0, 1.0, 0.0]);
    let [active, end] = c.lengths_at(&y);
    Some((c.mass * (active * moved[0] + end * moved[2])).powf(-0.5))
}

/// How the acceleration follows from x over a step.
#[derive(Clone, Copy)]
struct Inertia {
    h: f64,
    /// x''_+ by x_+, 1/s^2, and by a.
    by_x: f64,
    by_mean: f64,
    beta: f64,
    gamma: f64,
}

impl Inertia {
    fn new(steps: &Steps) -> Self {
        let h = steps.step_s;
        // x''_+ = (1 - m) a_+ + m a
        let (beta, gamma, m) = match steps.bounce {
            Bounce::Followed => (1.0 / 12.0, 0.5, 0.0),
            Bounce::Damped => (1.0, 1.5, -1.0),
        };
        Inertia {
            h,
            by_x: (1.0 - m) / (beta * h * h),
            by_mean: m - (1.0 - m) * (0.5 / beta - 1.0),
            beta,
            gamma,
        }
    }

    /// x''_+ where x_+ is 0.
    #[inline(always)]
    fn past(&self, [x, rate, mean]: &Moving) -> f64 {
        self.by_mean * mean - self.by_x * (x + self.h * rate)
    }

    /// x''_+ at x_+ = `x`.
    #[inline(always)]
    fn acceleration(&self, before: &Moving, x: f64) -> f64 {
        self.by_x * x + self.past(before)
    }

    /// The end of a step at `x`.
    #[inline(always)]
    fn on(&self, [before, rate, mean]: &Moving, x: f64) -> Moving {
        let h = self.h;
        let next = (x - before - h * rate) / (self.beta * h * h) - (0.5 / self.beta - 1.0) * mean;
        let mixed = (1.0 - self.gamma) * mean + self.gamma * next;
        [x, rate + h * mixed, next]
    }
}

impl Constants {
    fn new(sample: &HangingSample, film: &Film, steps: &Steps) -> Self {
        let h = steps.step_s;
        let branches = film.branches().min(LANES);
        let mut c = Constants {
            branches,
            inverse_locking: 1.0 / film.locking,
            mu0: film.mu_pa[0],
            layer: sample.electrode.modulus_pa,
            mu: [0.0; LANES],
            alpha: [0.0; LANES],
            beta: [0.0; LANES],
            ratio: [1.0; LANES],
            lengths: sample.lengths_m(),
            sections: sample.sections_m2(),
            maxwell: sample.maxwell_f_m3(),
            mass: sample.mass_kg,
            weight: sample.weight_n(),
            time_constant: sample.time_constant_s().max(LEAST_TIME_CONSTANT_S),
            inertia: Inertia::new(steps),
        };
        for n in 0..branches {
            c.mu[n] = film.mu_pa[n + 1];
            let ratio = h / film.relaxation_time_s[n];
            c.ratio[n] = ratio;
            c.alpha[n] = (-ratio).exp();
            c.beta[n] = -(-ratio).exp_m1() / ratio;
        }
        c
    }

    /// The springs at ln stretches `y` = (u, v, w) and elastic strains `e`.
    #[inline(always)]
    fn springs(&self, y: &[f64; 3], e: &Strains) -> Springs {
        let j = self.inverse_locking;
        let double = |x: &Lanes| {
            let mut out = *x;
            for v in &mut out {
                *v *= 2.0;
            }
            out
        };
        let minus = |x: &Lanes| {
            let mut out = *x;
            for v in &mut out {
                *v = -*v;
            }
            out
        };
        Springs {
            rest: [
                spring(y[0], y[1], j),
                spring(y[0], -0.5 * y[0], j),
                spring(y[2], -0.5 * y[2], j),
            ],
            active: gent(&exp(&double(&e[0])), &exp(&double(&e[1])), j),
            side: gent(&exp(&double(&e[2])), &exp(&minus(&e[2])), j),
            end: gent(&exp(&double(&e[3])), &exp(&minus(&e[3])), j),
        }
    }

    /// sigma_1, sigma_2 of the active part, sigma of side and end strips.
    #[inline(always)]
    fn stresses(&self, s: &Springs) -> [f64; 4] {
        let stiff = self.mu0 + self.layer;
        let mut out = [
            stiff * s.rest[0][0],
            stiff * s.rest[0][1],
            self.mu0 * s.rest[1][0],
            self.mu0 * s.rest[2][0],
        ];
        for l in 0..LANES {
            out[0] += self.mu[l] * s.active.s1[l];
            out[1] += self.mu[l] * s.active.s2[l];
            out[2] += self.mu[l] * s.side.s1[l];
            out[3] += self.mu[l] * s.end.s1[l];
        }
        out
    }

    /// d sigma / d (u, v) of the active part (11, 12, 21, 22), d sigma/du of the side strips, d sigma/dw of
    /// the end strips, where a branch follows with `beta`.
    #[inline(always)]
    fn tangents(&self, s: &Springs, beta: &Lanes) -> [f64; 6] {
        let stiff = 2.0 * (self.mu0 + self.layer);
        let r = &s.rest;
        let uniaxial = |g: &[f64; 6]| 2.0 * g[2] - g[3];
        let mut t = [
            stiff * r[0][2],
            stiff * r[0][3],
            stiff * r[0][3],
            stiff * r[0][4],
            self.mu0 * uniaxial(&r[1]),
            self.mu0 * uniaxial(&r[2]),
        ];
        for l in 0..LANES {
            let m = self.mu[l] * beta[l];
            t[0] += 2.0 * m * s.active.s11[l];
            t[1] += 2.0 * m * s.active.s12[l];
            t[2] += 2.0 * m * s.active.s12[l];
            t[3] += 2.0 * m * s.active.s22[l];
            t[4] += m * (2.0 * s.side.s11[l] - s.side.s12[l]);
            t[5] += m * (2.0 * s.end.s11[l] - s.end.s12[l]);
        }
        t
    }

    /// Stresses by strains `p` of the branches, in the order of [`Constants::stresses`].
    #[inline(always)]
    fn stresses_by(&self, s: &Springs, p: &Strains) -> [f64; 4] {
        let mut r = [0.0; 4];
        for l in 0..LANES {
            let m = self.mu[l];
            let (p1, p2) = (2.0 * p[0][l], 2.0 * p[1][l]);
            r[0] += m * (s.active.s11[l] * p1 + s.active.s12[l] * p2);
            r[1] += m * (s.active.s12[l] * p1 + s.active.s22[l] * p2);
            r[2] += m * (2.0 * s.side.s11[l] - s.side.s12[l]) * p[2][l];
            r[3] += m * (2.0 * s.end.s11[l] - s.end.s12[l]) * p[3][l];
        }
        r
    }

    /// Lengths of the active part and of the end strips, m.
    #[inline(always)]
    fn lengths_at(&self, y: &[f64; 3]) -> [f64; 2] {
        [self.lengths[0] * y[0].exp(), self.lengths[1] * y[2].exp()]
    }

    /// Length of the sample, m.
    #[inline(always)]
    fn length(&self, y: &[f64; 3]) -> f64 {
        let [active, end] = self.lengths_at(y);
        active + end
    }

    /// Sections over their stretch: active, side, end.
    #[inline(always)]
    fn true_sections(&self, y: &[f64; 3]) -> [f64; 3] {
        [
            self.sections[0] * (-y[0]).exp(),
            self.sections[1] * (-y[0]).exp(),
            self.sections[2] * (-y[2]).exp(),
        ]
    }

    fn locked(&self, y: &[f64; 3], e: &Strains, at_s: f64) -> SampleTrouble {
        let mut candidates = vec![
            (1, (2.0 * y[0]).exp(), (2.0 * y[1]).exp()),
            (1, (2.0 * y[2]).exp(), (-y[2]).exp()),
        ];
        for n in 0..self.branches {
            candidates.push((n + 2, (2.0 * e[0][n]).exp(), (2.0 * e[1][n]).exp()));
            candidates.push((n + 2, (2.0 * e[2][n]).exp(), (-e[2][n]).exp()));
            candidates.push((n + 2, (2.0 * e[3][n]).exp(), (-e[3][n]).exp()));
        }
        let locking = 1.0 / self.inverse_locking;
        for (spring, a, b) in candidates {
            if let Err(invariant) = gent_stress(a, b, locking)
                && invariant.is_finite()
            {
                return SampleTrouble::Locked(Locked {
                    spring,
                    invariant,
                    locking,
                    at_s: Some(at_s),
                });
            }
        }
        SampleTrouble::GivesWay { at_s }
    }
}

/// The three balances, linearised: values and the matrix.
struct Balance {
    g: [f64; 3],
    m: [[f64; 3]; 3],
}

impl Balance {
    /// Solves m d = r by elimination of v, then u and w.
    #[inline(always)]
    fn solve(&self, r: [f64; 3]) -> [f64; 3] {
        let m = &self.m;
        // third row: m30 du + m31 dv = r2 (no w in it)
        let i = 1.0 / m[2][1];
        let (k, q) = (m[2][0] * i, r[2] * i);
        let a = m[0][0] - m[0][1] * k;
        let b = m[0][2];
        let c = m[1][0];
        let d = m[1][2];
        let r0 = r[0] - m[0][1] * q;
        let r1 = r[1];
        let det = 1.0 / (a * d - b * c);
        let du = (r0 * d - b * r1) * det;
        let dw = (a * r1 - c * r0) * det;
        [du, q - k * du, dw]
    }

    /// Whether the film holds: sigma_2 gives way to nothing, and both series parts are stiff.
    fn holds(&self) -> bool {
        let m = &self.m;
        let stiff = m[0][0] - m[0][1] * m[2][0] / m[2][1];
        m[2][1] > 0.0 && stiff > 0.0 && m[1][2] > 0.0
    }
}

/// The voltage on the film at the end of a step, and its derivatives.
#[derive(Clone, Copy, Default)]
struct Charge {
    phi: f64,
    by_area: f64,
    by_area_before: f64,
    by_phi_before: f64,
    by_time_constant: f64,
}

/// (c phi)' tau = phi_c - phi over a step h, from `phi`, with c from `area[0]` to `area[1]` and phi_c from
/// `command[0]` to `command[1]`.
#[inline(always)]
fn charge(tau: f64, h: f64, phi: f64, area: [f64; 2], command: [f64; 2]) -> Charge {
    let mean = 0.5 * (area[0] + area[1]);
    let rate = (area[1] - area[0]) / h;
    let rho = (1.0 / tau + rate) / mean;
    let rise = command[1] - command[0];
    let x = rho * h;
    let decay = (-x).exp();
    let lost = -(-x).exp_m1();
    // (1 - exp(-x))/x
    let f = lost / x;
    let k = 1.0 / (1.0 + tau * rate);
    let drive = lost * command[0] + (1.0 - f) * rise;
    let value = decay * phi + k * drive;
    // d f/d rho = h (exp(-x) - f)/x
    let drive_by_rho = h * decay * command[0] - rise * h * (decay - f) / x;
    let by_rho = -h * decay * phi + k * drive_by_rho;
    let by_k = drive;
    let k_by_rate = -k * k * tau;
    let rho_by_area = 1.0 / (h * mean) - 0.5 * rho / mean;
    let rho_by_before = -1.0 / (h * mean) - 0.5 * rho / mean;
    Charge {
        phi: value,
        by_area: by_rho * rho_by_area + by_k * k_by_rate / h,
        by_area_before: by_rho * rho_by_before - by_k * k_by_rate / h,
        by_phi_before: decay,
        by_time_constant: -by_rho / (tau * tau * mean) - by_k * k * k * rate,
    }
}

/// History of one knob's derivatives.
#[derive(Clone, Default)]
struct Derivative {
    e: Strains,
    nonlinear: Strains,
    nonlinear_before: Strains,
    y: [f64; 3],
    x: Moving,
    phi: f64,
    rest: f64,
}

/// Runs the model over `command_v` at `steps` (the sample hangs at rest under the first), with derivatives by
/// `knobs`.
///
/// # Errors
/// [`SampleTrouble`].
pub fn run_sample(
    sample: &HangingSample,
    film: &Film,
    command_v: &[f64],
    steps: &Steps,
    knobs: &[SampleKnob],
) -> Result<SampleRun, SampleTrouble> {
    Arch::new().dispatch(
        #[inline(always)]
        || run(sample, film, command_v, steps, knobs),
    )
}

/// At rest under `phi`, branches relaxed.
fn rest(c: &Constants, phi: f64, at_s: f64) -> Result<([f64; 3], Balance), SampleTrouble> {
    let mut y = [0.0; 3];
    const RAMP: usize = 16;
    let none: Strains = [[0.0; LANES]; KINDS];
    let full = if phi == 0.0 { RAMP } else { 2 * RAMP };
    for stage in 1..=full {
        let load = c.weight * (stage as f64 / RAMP as f64).min(1.0);
        let square = phi * phi * (stage as f64 / RAMP as f64 - 1.0).max(0.0);
        let mut done = false;
        for _ in 0..2 * NEWTON_ITERATIONS {
            let b = balance(c, &y, &none, square, load);
            let Some((b, least)) = b else {
                return Err(SampleTrouble::GivesWay { at_s });
            };
            if least <= 0.0 {
                return Err(c.locked(&y, &none, at_s));
            }
            if !b.holds() {
                return Err(SampleTrouble::GivesWay { at_s });
            }
            let d = b.solve(b.g.map(|g| -g));
            let size = d.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            if size.is_nan() || size > 2.0 {
                return Err(SampleTrouble::GivesWay { at_s });
            }
            for i in 0..3 {
                y[i] += d[i];
            }
            if size < 1e-13 {
                done = true;
                if stage == full {
                    return Ok((y, b));
                }
                break;
            }
        }
        if !done {
            return Err(SampleTrouble::GivesWay { at_s });
        }
    }
    Err(SampleTrouble::GivesWay { at_s })
}

/// phi^2 and its derivative by c; the tension, which falls by `inertia` (N/m) a metre of length.
struct Loads {
    square: f64,
    square_by_area: f64,
    load: f64,
    inertia: f64,
}

impl Loads {
    /// At rest: c does not feed back, and nothing accelerates.
    #[inline(always)]
    fn still(square: f64, load: f64) -> Self {
        Loads {
            square,
            square_by_area: 0.0,
            load,
            inertia: 0.0,
        }
    }
}

/// The balances of the sample at rest: strains `e` stay, and nothing accelerates.
#[inline(always)]
fn balance(
    c: &Constants,
    y: &[f64; 3],
    e: &Strains,
    square: f64,
    load: f64,
) -> Option<(Balance, f64)> {
    let s = c.springs(y, e);
    let (b, _) = linearise(c, y, &s, &[0.0; LANES], &Loads::still(square, load));
    let least = s.rest[0][5]
        .min(s.rest[1][5])
        .min(s.rest[2][5])
        .min(s.active.least)
        .min(s.side.least)
        .min(s.end.least);
    b.g.iter().all(|g| g.is_finite()).then_some((b, least))
}

/// The balances at `y`, where strains follow with `beta`, and c there.
#[inline(always)]
fn linearise(
    c: &Constants,
    y: &[f64; 3],
    s: &Springs,
    beta: &Lanes,
    loads: &Loads,
) -> (Balance, f64) {
    let Loads {
        square,
        square_by_area,
        load,
        inertia,
    } = *loads;
    let sigma = c.stresses(s);
    let t = c.tangents(s, beta);
    let (to_active, to_end) = ((-y[0]).exp(), (-y[2]).exp());
    let area = area_of(y);
    let maxwell = c.maxwell * square * area;
    // d X/du = d X/dv
    let slope = 2.0 * area * c.maxwell * (square + area * square_by_area);
    let (sa, ss, se) = (
        c.sections[0] * to_active,
        c.sections[1] * to_active,
        c.sections[2] * to_end,
    );
    let fa = (sigma[0] - sigma[1]) * sa;
    let fs = sigma[2] * ss;
    let fe = sigma[3] * se;
    let (la, le) = (
        inertia * c.lengths[0] / to_active,
        inertia * c.lengths[1] / to_end,
    );
    let b = Balance {
        g: [fa + fs - load, fe - load, sigma[1] - maxwell],
        m: [
            [
                (t[0] - t[2]) * sa - fa + t[4] * ss - fs + la,
                (t[1] - t[3]) * sa,
                le,
            ],
            [la, 0.0, t[5] * se - fe + le],
            [t[2] - slope, t[3] - slope, 0.0],
        ],
    };
    (b, area)
}

/// Elastic strains at the end of a step apart from beta (y_+ - y).
#[inline(always)]
fn carried(c: &Constants, e: &Lanes, n: &Lanes, before: &Lanes) -> Lanes {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        out[l] =
            c.alpha[l] * e[l] - (1.0 - c.alpha[l]) * n[l] - (1.0 - c.beta[l]) * (n[l] - before[l]);
    }
    out
}

/// Lets elastic strains follow log stretches that move.
#[inline(always)]
fn follow(strains: &mut Strains, beta: &Lanes, moved: [f64; 3]) {
    for (k, from) in DRIVEN_BY {
        for l in 0..LANES {
            strains[k][l] += beta[l] * moved[from];
        }
    }
}

/// c = (lambda_1 lambda_2)^2 of the active part.
#[inline(always)]
fn area_of(y: &[f64; 3]) -> f64 {
    (2.0 * (y[0] + y[1])).exp()
}

/// N = g(e) - e of the flow rule, and its derivatives: (active 1 and 2: 11, 12, 21, 22; side; end).
struct Flow {
    value: Strains,
    slope: [Lanes; 6],
}

#[inline(always)]
fn flow(s: &Springs, e: &Strains) -> Flow {
    let third = 1.0 / 3.0;
    let mut f = Flow {
        value: [[0.0; LANES]; KINDS],
        slope: [[0.0; LANES]; 6],
    };
    let a = &s.active;
    for l in 0..LANES {
        f.value[0][l] = (a.s1[l] - 0.5 * a.s2[l]) * third - e[0][l];
        f.value[1][l] = (a.s2[l] - 0.5 * a.s1[l]) * third - e[1][l];
        f.slope[0][l] = 2.0 * (a.s11[l] - 0.5 * a.s12[l]) * third - 1.0;
        f.slope[1][l] = 2.0 * (a.s12[l] - 0.5 * a.s22[l]) * third;
        f.slope[2][l] = 2.0 * (a.s12[l] - 0.5 * a.s11[l]) * third;
        f.slope[3][l] = 2.0 * (a.s22[l] - 0.5 * a.s12[l]) * third - 1.0;
        f.value[2][l] = s.side.s1[l] * third - e[2][l];
        f.slope[4][l] = (2.0 * s.side.s11[l] - s.side.s12[l]) * third - 1.0;
        f.value[3][l] = s.end.s1[l] * third - e[3][l];
        f.slope[5][l] = (2.0 * s.end.s11[l] - s.end.s12[l]) * third - 1.0;
    }
    f
}

/// What stays the same over the steps of a run.
struct Run<'a> {
    sample: &'a HangingSample,
    knobs: &'a [SampleKnob],
    h: f64,
    /// M x''_+ by x_+, N/m.
    inertia: f64,
    rest_length: f64,
    c: Constants,
}

/// Where a run stands between two steps.
struct State {
    y: [f64; 3],
    e: Strains,
    n: Strains,
    n_before: Strains,
    x: Moving,
    phi: f64,
    /// y, and y one and two steps before.
    guess: [[f64; 3]; 3],
}

/// The end of a step: springs, balance and charge at Newton's last iterate, the rest after the increment
/// `last`.
struct End {
    s: Springs,
    b: Balance,
    q: Charge,
    f: Flow,
    y: [f64; 3],
    e: Strains,
    lengths: [f64; 2],
    x: f64,
    phi: f64,
    last: [f64; 3],
}

/// What the derivatives by all knobs share at the end of a step.
struct Shared {
    area: f64,
    area_before: f64,
    sections: [f64; 3],
    maxwell: f64,
    by_phi: f64,
    /// What the step moves the log stretch of each kind by.
    moved: [f64; KINDS],
    acceleration: f64,
}

/// What a knob makes of stresses, voltage, tension and Maxwell stress where y_+ is held.
struct Push {
    r: [f64; 4],
    phi: f64,
    load: f64,
    maxwell: f64,
}

#[inline(always)]
fn run(
    sample: &HangingSample,
    film: &Film,
    command: &[f64],
    steps: &Steps,
    knobs: &[SampleKnob],
) -> Result<SampleRun, SampleTrouble> {
    let (h, start_s) = (steps.step_s, steps.start_s);
    let c = Constants::new(sample, film, steps);
    let steps = command.len();
    let (y, at_rest) = rest(&c, command[0], start_s)?;
    let run = Run {
        sample,
        knobs,
        h,
        inertia: c.mass * c.inertia.by_x,
        rest_length: c.length(&y),
        c,
    };
    let mut derivatives = run.at_rest(&y, &at_rest, command[0]);
    let mut out = SampleRun {
        rest_length_m: run.rest_length,
        x_m: Vec::with_capacity(steps),
        phi_v: Vec::with_capacity(steps),
        columns: knobs.iter().map(|_| Vec::with_capacity(steps)).collect(),
        rest_columns: derivatives.iter().map(|d| d.rest).collect(),
    };
    out.x_m.push(0.0);
    out.phi_v.push(command[0]);
    for column in &mut out.columns {
        column.push(0.0);
    }
    let mut state = State::at_rest(y, command[0]);
    for i in 1..steps {
        let commands = [command[i - 1], command[i]];
        let end = run.step(&state, commands, start_s + i as f64 * h)?;
        if !knobs.is_empty() {
            let shared = run.shared(&state, &end);
            for (knob, (d, column)) in knobs
                .iter()
                .zip(derivatives.iter_mut().zip(&mut out.columns))
            {
                run.differentiate(*knob, d, &state, &end, &shared);
                column.push(d.x[0]);
            }
        }
        out.x_m.push(end.x);
        out.phi_v.push(end.phi);
        state.advance(&run.c, end);
    }
    Ok(out)
}

impl Run<'_> {
    /// Derivatives of the sample at rest under `phi`.
    #[inline(always)]
    fn at_rest(&self, y: &[f64; 3], balance: &Balance, phi: f64) -> Vec<Derivative> {
        let c = &self.c;
        let s = c.springs(y, &[[0.0; LANES]; KINDS]);
        let [sa, ss, se] = c.true_sections(y);
        let lengths = c.lengths_at(y);
        let maxwell = c.maxwell * phi * phi * area_of(y);
        let of = |knob: &SampleKnob| {
            let r = match knob {
                SampleKnob::Modulus(0) => [
                    (s.rest[0][0] - s.rest[0][1]) * sa + s.rest[1][0] * ss,
                    s.rest[2][0] * se,
                    s.rest[0][1],
                ],
                SampleKnob::ElectrodeModulus => {
                    [(s.rest[0][0] - s.rest[0][1]) * sa, 0.0, s.rest[0][1]]
                }
                SampleKnob::ActiveFraction => {
                    [0.0, 0.0, -maxwell / self.sample.electrode.active_fraction]
                }
                SampleKnob::Mass => [-c.weight / c.mass, -c.weight / c.mass, 0.0],
                _ => [0.0; 3],
            };
            let y = balance.solve(r.map(|r| -r));
            Derivative {
                y,
                rest: lengths[0] * y[0] + lengths[1] * y[2],
                ..Derivative::default()
            }
        };
        self.knobs.iter().map(of).collect()
    }

    /// One step by Newton's method, to `at_s`.
    #[inline(always)]
    fn step(&self, state: &State, commands: [f64; 2], at_s: f64) -> Result<End, SampleTrouble> {
        let (c, inertia) = (&self.c, self.inertia);
        let State { y, x, guess, .. } = state;
        let base = state.carried(c);
        let mut next = [0, 1, 2].map(|k| 3.0 * guess[0][k] - 3.0 * guess[1][k] + guess[2][k]);
        let area_before = area_of(y);
        // T = M (g - x''_+)
        let history = c.mass * c.inertia.past(x);
        for _ in 0..NEWTON_ITERATIONS {
            let mut e = base;
            follow(&mut e, &c.beta, [0, 1, 2].map(|k| next[k] - y[k]));
            let area = area_of(&next);
            let areas = [area_before, area];
            let q = charge(c.time_constant, self.h, state.phi, areas, commands);
            let loads = Loads {
                square: q.phi * q.phi,
                square_by_area: 2.0 * q.phi * q.by_area,
                load: c.weight - history - inertia * (c.length(&next) - self.rest_length),
                inertia,
            };
            let s = c.springs(&next, &e);
            let (b, _) = linearise(c, &next, &s, &c.beta, &loads);
            let least = s.rest[0][5]
                .min(s.rest[2][5])
                .min(s.active.least)
                .min(s.side.least)
                .min(s.end.least);
            if least.is_nan() || least <= 0.0 {
                return Err(c.locked(&next, &e, at_s));
            }
            let d = b.solve(b.g.map(|g| -g));
            let size = d[0].abs().max(d[1].abs()).max(d[2].abs());
            if size.is_nan() || size > 0.7 || !b.holds() {
                return Err(SampleTrouble::GivesWay { at_s });
            }
            for k in 0..3 {
                next[k] += d[k];
            }
            if size < QUADRATIC {
                follow(&mut e, &c.beta, d);
                let lengths = c.lengths_at(&next);
                return Ok(End {
                    f: flow(&s, &e),
                    s,
                    b,
                    q,
                    y: next,
                    e,
                    lengths,
                    x: lengths[0] + lengths[1] - self.rest_length,
                    phi: q.phi + q.by_area * 2.0 * area * (d[0] + d[1]),
                    last: d,
                });
            }
        }
        Err(SampleTrouble::GivesWay { at_s })
    }

    /// What the derivatives share where a step from `state` has come to its end.
    #[inline(always)]
    fn shared(&self, state: &State, end: &End) -> Shared {
        let (c, x) = (&self.c, &state.x);
        let area = area_of(&end.y);
        Shared {
            area,
            area_before: area_of(&state.y),
            sections: c.true_sections(&end.y),
            maxwell: c.maxwell * end.phi * end.phi * area,
            by_phi: 2.0 * c.maxwell * end.phi * area,
            moved: DRIVEN_BY.map(|(_, from)| end.y[from] - state.y[from]),
            acceleration: c.inertia.acceleration(x, end.x),
        }
    }

    /// Takes the derivatives by one knob over a step; `state` is that before it.
    #[inline(always)]
    fn differentiate(
        &self,
        knob: SampleKnob,
        d: &mut Derivative,
        state: &State,
        end: &End,
        shared: &Shared,
    ) {
        let c = &self.c;
        let End { b, q, f, .. } = end;
        let mut p = d.carried(c);
        if let SampleKnob::LogTime(l) = knob {
            let by_alpha = c.alpha[l] * c.ratio[l];
            let by_beta = c.beta[l] - c.alpha[l];
            let (e, n, n_before) = (&state.e, &state.n, &state.n_before);
            for k in 0..KINDS {
                p[k][l] += by_alpha * (e[k][l] + n[k][l])
                    + by_beta * (shared.moved[k] + n[k][l] - n_before[k][l]);
            }
        }
        let before = 2.0 * shared.area_before * (d.y[0] + d.y[1]);
        let mut push = Push {
            r: c.stresses_by(&end.s, &p),
            phi: q.by_area_before * before + q.by_phi_before * d.phi,
            load: -c.mass * c.inertia.acceleration(&d.x, -d.rest),
            maxwell: 0.0,
        };
        self.push(knob, end, shared, &mut push);
        let (r, [sa, ss, se]) = (&push.r, shared.sections);
        let right = [
            (r[0] - r[1]) * sa + r[2] * ss - push.load,
            r[3] * se - push.load,
            r[1] - push.maxwell - shared.by_phi * push.phi,
        ];
        let dy = b.solve(right.map(|r| -r));
        d.e = p;
        follow(&mut d.e, &c.beta, dy);
        d.nonlinear_before = d.nonlinear;
        for l in 0..LANES {
            let (e1, e2) = (d.e[0][l], d.e[1][l]);
            d.nonlinear[0][l] = f.slope[0][l] * e1 + f.slope[1][l] * e2;
            d.nonlinear[1][l] = f.slope[2][l] * e1 + f.slope[3][l] * e2;
            d.nonlinear[2][l] = f.slope[4][l] * d.e[2][l];
            d.nonlinear[3][l] = f.slope[5][l] * d.e[3][l];
        }
        d.phi = push.phi + q.by_area * 2.0 * shared.area * (dy[0] + dy[1]);
        let dx = end.lengths[0] * dy[0] + end.lengths[1] * dy[2] - d.rest;
        d.x = c.inertia.on(&d.x, dx);
        d.y = dy;
    }

    /// Adds what `knob` moves by itself.
    #[inline(always)]
    fn push(&self, knob: SampleKnob, end: &End, shared: &Shared, push: &mut Push) {
        let (s, q, r) = (&end.s, &end.q, &mut push.r);
        match knob {
            SampleKnob::Modulus(0) => {
                r[0] += s.rest[0][0];
                r[1] += s.rest[0][1];
                r[2] += s.rest[1][0];
                r[3] += s.rest[2][0];
            }
            SampleKnob::Modulus(n) => {
                r[0] += s.active.s1[n - 1];
                r[1] += s.active.s2[n - 1];
                r[2] += s.side.s1[n - 1];
                r[3] += s.end.s1[n - 1];
            }
            SampleKnob::LogTime(_) => {}
            SampleKnob::ElectrodeModulus => {
                r[0] += s.rest[0][0];
                r[1] += s.rest[0][1];
            }
            SampleKnob::Resistance => {
                push.phi += q.by_time_constant * self.sample.capacitance_f();
            }
            SampleKnob::ActiveFraction => {
                let a = self.sample.electrode.active_fraction;
                push.phi += q.by_time_constant * self.sample.time_constant_s() / a;
                push.maxwell = shared.maxwell / a;
            }
            SampleKnob::Mass => push.load += self.c.weight / self.c.mass - shared.acceleration,
        }
    }
}

impl State {
    /// Hanging at rest, branches relaxed.
    fn at_rest(y: [f64; 3], phi: f64) -> Self {
        let none: Strains = [[0.0; LANES]; KINDS];
        State {
            y,
            e: none,
            n: none,
            n_before: none,
            x: [0.0; 3],
            phi,
            guess: [y; 3],
        }
    }

    /// Elastic strains at the end of the next step apart from beta (y_+ - y).
    #[inline(always)]
    fn carried(&self, c: &Constants) -> Strains {
        [0, 1, 2, 3].map(|k| carried(c, &self.e[k], &self.n[k], &self.n_before[k]))
    }

    /// Goes on to the end of a step. The stresses stand at the last iterate; N at the solution to second
    /// order of the last increment.
    #[inline(always)]
    fn advance(&mut self, c: &Constants, end: End) {
        let (f, last) = (&end.f, &end.last);
        self.n_before = self.n;
        let n = &mut self.n;
        for l in 0..LANES {
            let b = c.beta[l];
            let (d1, d2, d3) = (b * last[0], b * last[1], b * last[2]);
            n[0][l] = f.value[0][l] + d1 * (f.slope[0][l] + 1.0) + d2 * f.slope[1][l];
            n[1][l] = f.value[1][l] + d1 * f.slope[2][l] + d2 * (f.slope[3][l] + 1.0);
            n[2][l] = f.value[2][l] + d1 * (f.slope[4][l] + 1.0);
            n[3][l] = f.value[3][l] + d3 * (f.slope[5][l] + 1.0);
        }
        self.e = end.e;
        self.x = c.inertia.on(&self.x, end.x);
        self.y = end.y;
        self.phi = end.phi;
        self.guess = [end.y, self.guess[0], self.guess[1]];
    }
}

impl Derivative {
    /// Elastic strains at the end of the next step where y_+ is held.
    #[inline(always)]
    fn carried(&self, c: &Constants) -> Strains {
        let mut p: Strains = [[0.0; LANES]; KINDS];
        for (k, from) in DRIVEN_BY {
            let (de, dn, db) = (&self.e[k], &self.nonlinear[k], &self.nonlinear_before[k]);
            let dy = self.y[from];
            for l in 0..LANES {
                p[k][l] =
                    c.alpha[l] * de[l] - c.beta[l] * dy - (2.0 - c.alpha[l] - c.beta[l]) * dn[l]
                        + (1.0 - c.beta[l]) * db[l];
            }
        }
        p
    }
}

/// Smallest number of steps of the grid in a recording, whatever its frames.
const FEWEST_STEPS: usize = 100;
/// The largest step, s.
const LONGEST_STEP_S: f64 = 0.1;
/// Frames over which a step may be split before the search for one ends.
const FINEST_SPLIT: usize = 16;

/// Grid points that tell x between them.
const AROUND: usize = 5;
const BESIDE: usize = AROUND / 2;

/// Weights with which the points from two before to two after tell what lies `s` steps after the middle one:
/// Lagrange's quartic.
fn around(s: f64) -> [f64; AROUND] {
    let points = [-2.0, -1.0, 0.0, 1.0, 2.0];
    points.map(|p| {
        let others = points.iter().filter(|q| **q != p);
        others.map(|q| (s - q) / (p - q)).product()
    })
}

/// Frames that are averaged around one grid point.
#[derive(Debug, Clone, Copy)]
struct Bin {
    /// Grid point; those around it are there too.
    at: usize,
    /// Weights of x at the grid points around it: the quartic through them, averaged over the captured frames.
    weights: [f64; AROUND],
    /// Mean of the captured x, m.
    mean_m: f64,
    /// Frames.
    count: usize,
}

/// One recording of a hanging sample against the model.
#[derive(Debug, Clone)]
pub struct SampleResidual<'a> {
    dataset: &'a HangingDataset,
    h_s: f64,
    bounce: Bounce,
    steps: usize,
    bins: Vec<Bin>,
    noise_m: f64,
}

/// Residuals of a recording and their derivatives.
#[derive(Debug, Clone)]
pub struct SampleRows {
    /// (x predicted - x captured)/noise, one a bin.
    pub residuals: Vec<f64>,
    /// Derivatives, one column a knob.
    pub columns: Vec<Vec<f64>>,
    /// Derivative by a shift of x, m.
    pub shift: Vec<f64>,
    /// Derivative by the clock offset, s.
    pub offset: Vec<f64>,
    /// The run.
    pub run: SampleRun,
}

/// What the motion of a sample asks for, frame by frame.
#[derive(Debug, Clone)]
pub struct SampleInverse {
    /// phi^2 that the motion needs on the film, V^2.
    pub squared_v2: Vec<f64>,
    /// (lambda_1 lambda_2)^2 of the active part.
    pub area: Vec<f64>,
}

/// Root mean square about the mean, of what is known.
pub(crate) fn deviation(x: &[f64]) -> f64 {
    let known = || x.iter().filter(|v| !v.is_nan());
    let n = known().count().max(1) as f64;
    let mean = known().sum::<f64>() / n;
    (known().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

impl Bin {
    /// What a course on the grid is for its frames.
    fn of(&self, x: &[f64]) -> f64 {
        let near = x[self.at - BESIDE..].iter();
        self.weights.iter().zip(near).map(|(w, x)| w * x).sum()
    }

    /// How much the course changes over a step there: the slope of the same quartic at its middle.
    fn rate(&self, x: &[f64]) -> f64 {
        let [far, near] = [2, 1].map(|k| x[self.at + k] - x[self.at - k]);
        (8.0 * near - far) / 12.0
    }
}

impl<'a> SampleResidual<'a> {
    /// On a grid of steps of `h_s` that make `bounce` of the mass, rows weighed by `noise_m` a frame.
    #[must_use]
    pub fn new(dataset: &'a HangingDataset, h_s: f64, bounce: Bounce, noise_m: f64) -> Self {
        let span = dataset.step_s * (dataset.samples() - 1) as f64;
        let steps = (span / h_s + 1e-9).floor() as usize + 1;
        let mut sums: Vec<(f64, [f64; AROUND], usize)> = vec![(0.0, [0.0; AROUND], 0); steps];
        for i in 0..dataset.samples() {
            if !dataset.captured(i) {
                continue;
            }
            let place = i as f64 * dataset.step_s / h_s;
            let at = place.round() as usize;
            if at < BESIDE || at + BESIDE >= steps {
                continue;
            }
            let bin = &mut sums[at];
            bin.0 += dataset.x_m[i];
            let own = around(place - at as f64);
            bin.1.iter_mut().zip(own).for_each(|(sum, w)| *sum += w);
            bin.2 += 1;
        }
        let bins = sums
            .into_iter()
            .enumerate()
            .filter(|(_, b)| b.2 > 0)
            .map(|(at, (sum, weights, count))| Bin {
                at,
                weights: weights.map(|w| w / count as f64),
                mean_m: sum / count as f64,
                count,
            })
            .collect();
        SampleResidual {
            dataset,
            h_s,
            bounce,
            steps,
            bins,
            noise_m,
        }
    }

    /// As [`SampleResidual::new`], rows weighed by the capture's noise, with the longest step that splits
    /// frames evenly at which halving the step moves x by less than `error_m`, or by less than `share` of the
    /// motion that the model makes, rms. The second number is what that halving moved, m.
    ///
    /// # Errors
    /// [`SampleTrouble`] when the model cannot be run with `film`.
    pub fn settled(
        dataset: &'a HangingDataset,
        sample: &HangingSample,
        film: &Film,
        error_m: f64,
        share: f64,
    ) -> Result<(Self, f64), SampleTrouble> {
        let noise_m = dataset.noise_m;
        let dt = dataset.step_s;
        let span = dt * (dataset.samples() - 1) as f64;
        let longest = LONGEST_STEP_S
            .min(span / FEWEST_STEPS as f64)
            .max(dt / FINEST_SPLIT as f64);
        let mut h = if longest >= dt {
            dt * (longest / dt).floor()
        } else {
            dt / (dt / longest).ceil()
        };
        let bounce_of = |h: f64| Steps::of(sample, film, dataset.start_s, h).bounce;
        let x_of = |h: f64| -> Result<Vec<f64>, SampleTrouble> {
            let grid = SampleResidual::new(dataset, h, bounce_of(h), noise_m);
            grid.x_m(sample, film)
        };
        let mut coarse = x_of(h)?;
        loop {
            let fine = x_of(0.5 * h)?;
            let count = coarse.len().min(fine.len().div_ceil(2));
            let square: f64 = (0..count)
                .map(|i| (coarse[i] - fine[2 * i]).powi(2))
                .sum::<f64>()
                / count as f64;
            let moved = square.sqrt();
            let enough = error_m.max(share * deviation(&fine));
            if moved < enough || 0.5 * h * (FINEST_SPLIT as f64) < dt {
                let grid = SampleResidual::new(dataset, h, bounce_of(h), noise_m);
                return Ok((grid, moved));
            }
            h *= 0.5;
            coarse = fine;
        }
    }

    /// The recording.
    pub fn dataset(&self) -> &'a HangingDataset {
        self.dataset
    }

    /// Step of the grid, s.
    pub fn step_s(&self) -> f64 {
        self.h_s
    }

    /// Its steps.
    pub fn steps(&self) -> Steps {
        Steps {
            start_s: self.dataset.start_s,
            step_s: self.h_s,
            bounce: self.bounce,
        }
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.bins.len()
    }

    /// Frames in the rows.
    pub fn frames(&self) -> usize {
        self.bins.iter().map(|b| b.count).sum()
    }

    /// Time of each row on the motion clock, s.
    pub fn times_s(&self) -> Vec<f64> {
        let at = |b: &Bin| self.dataset.start_s + self.h_s * b.at as f64;
        self.bins.iter().map(at).collect()
    }

    /// x of the plain model on the grid, m, at the clock offset that the recording begins with.
    fn x_m(&self, sample: &HangingSample, film: &Film) -> Result<Vec<f64>, SampleTrouble> {
        let command = self.command_v(self.dataset.offset_s);
        Ok(run_sample(sample, film, &command, &self.steps(), &[])?.x_m)
    }

    /// Standard deviation of a row's captured x, m.
    pub fn row_noise_m(&self) -> Vec<f64> {
        let sd = |b: &Bin| self.noise_m / (b.count as f64).sqrt();
        self.bins.iter().map(sd).collect()
    }

    /// Sum of the squares of the captured x about the bins' means adds nothing to a fit; what is left is
    /// this.
    pub fn captured_m(&self) -> Vec<f64> {
        self.bins.iter().map(|b| b.mean_m).collect()
    }

    /// The command on the grid, V: the root of its mean square over a step, but for the first.
    pub fn command_v(&self, offset_s: f64) -> Vec<f64> {
        let start = self.dataset.start_s + offset_s;
        (0..self.steps)
            .map(|i| match i {
                0 => self.dataset.voltage.at(0, start),
                _ => self
                    .dataset
                    .voltage
                    .mean(0, start + self.h_s * i as f64, self.h_s),
            })
            .collect()
    }

    /// Length of the sample at rest under the first command, m.
    ///
    /// # Errors
    /// [`SampleTrouble`].
    pub fn rest_length_m(
        &self,
        sample: &HangingSample,
        film: &Film,
        offset_s: f64,
    ) -> Result<f64, SampleTrouble> {
        let start_s = self.dataset.start_s;
        let c = Constants::new(sample, film, &self.steps());
        let phi = self.dataset.voltage.at(0, start_s + offset_s);
        let (y, _) = rest(&c, phi, start_s)?;
        Ok(c.length(&y))
    }

    /// What a course on the grid is at each frame: the quartic through the points around it.
    pub fn at_frames(&self, x: &[f64]) -> Vec<f64> {
        let last = x.len() - 1;
        let at = |i: usize| {
            let place = (i as f64 * self.dataset.step_s / self.h_s).min(last as f64);
            if last + 1 < AROUND {
                return x[place.round() as usize];
            }
            let middle = (place.round() as usize).clamp(BESIDE, last - BESIDE);
            let near = x[middle - BESIDE..].iter();
            let weights = around(place - middle as f64);
            weights.iter().zip(near).map(|(w, x)| w * x).sum()
        };
        (0..self.dataset.samples()).map(at).collect()
    }

    /// Residuals, and derivatives by `knobs`, shift and offset.
    ///
    /// # Errors
    /// [`SampleTrouble`].
    pub fn rows_at(
        &self,
        sample: &HangingSample,
        film: &Film,
        shift_m: f64,
        offset_s: f64,
        knobs: &[SampleKnob],
    ) -> Result<SampleRows, SampleTrouble> {
        let command = self.command_v(offset_s);
        let run = run_sample(sample, film, &command, &self.steps(), knobs)?;
        let weight = |b: &Bin| (b.count as f64).sqrt() / self.noise_m;
        let column =
            |x: &[f64]| -> Vec<f64> { self.bins.iter().map(|b| weight(b) * b.of(x)).collect() };
        Ok(SampleRows {
            residuals: self
                .bins
                .iter()
                .map(|b| weight(b) * (b.of(&run.x_m) + shift_m - b.mean_m))
                .collect(),
            columns: run.columns.iter().map(|c| column(c)).collect(),
            shift: self.bins.iter().map(weight).collect(),
            offset: self
                .bins
                .iter()
                .map(|b| weight(b) * b.rate(&run.x_m) / self.h_s)
                .collect(),
            run,
        })
    }
}

/// Inverse dynamics: phi^2 on the film that x(t) needs, with x'' given, at equal steps `h_s`; the sample hung
/// at rest under `rest_phi_v` at x = 0. Negative where no voltage gives that x.
///
/// # Errors
/// [`SampleTrouble`].
pub fn inverse_sample(
    sample: &HangingSample,
    film: &Film,
    x_m: &[f64],
    acceleration_m_s2: &[f64],
    h_s: f64,
    rest_phi_v: f64,
) -> Result<SampleInverse, SampleTrouble> {
    let steps = Steps {
        start_s: 0.0,
        step_s: h_s,
        bounce: Bounce::Damped,
    };
    let c = Constants::new(sample, film, &steps);
    let (mut y, _) = rest(&c, rest_phi_v, 0.0)?;
    let rest_length = c.length(&y);
    let none: Strains = [[0.0; LANES]; KINDS];
    let (mut e, mut n, mut n_before) = (none, none, none);
    let mut out = SampleInverse {
        squared_v2: Vec::with_capacity(x_m.len()),
        area: Vec::with_capacity(x_m.len()),
    };
    for i in 0..x_m.len() {
        let at_s = i as f64 * h_s;
        let base: Strains = [0, 1, 2, 3].map(|k| carried(&c, &e[k], &n[k], &n_before[k]));
        let mut next = y;
        // The first sample is where the branches are relaxed; from then on they follow.
        let beta = if i == 0 { [0.0; LANES] } else { c.beta };
        let tension = c.mass * (crate::units::GRAVITY_M_S2 - acceleration_m_s2[i]);
        let mut done = None;
        for _ in 0..2 * NEWTON_ITERATIONS {
            let mut strains = base;
            follow(&mut strains, &beta, [0, 1, 2].map(|k| next[k] - y[k]));
            let s = c.springs(&next, &strains);
            // phi^2 = 0 leaves sigma_2 itself in the third balance.
            let (b, area) = linearise(&c, &next, &s, &beta, &Loads::still(0.0, tension));
            let least = s.rest[0][5].min(s.rest[2][5]).min(s.active.least);
            if least.is_nan() || least <= 0.0 {
                return Err(c.locked(&next, &strains, at_s));
            }
            let dw = -b.g[1] / b.m[1][2];
            let lengths = c.lengths_at(&next);
            let du = (rest_length + x_m[i] - lengths[0] - lengths[1] * (1.0 + dw)) / lengths[0];
            let dv = (-b.g[0] - b.m[0][0] * du) / b.m[0][1];
            let size = du.abs().max(dv.abs()).max(dw.abs());
            if size.is_nan() || size > 0.9 {
                return Err(SampleTrouble::GivesWay { at_s });
            }
            next[0] += du;
            next[1] += dv;
            next[2] += dw;
            if size < 1e-10 {
                let sigma_2 = c.stresses(&s)[1] + b.m[2][0] * du + b.m[2][1] * dv;
                out.squared_v2.push(sigma_2 / (c.maxwell * area));
                out.area.push(area);
                done = Some((s, strains));
                break;
            }
        }
        let Some((s, strains)) = done else {
            return Err(SampleTrouble::GivesWay { at_s });
        };
        n_before = n;
        n = flow(&s, &strains).value;
        e = strains;
        y = next;
    }
    Ok(out)
}

/// The voltage that `command_v` makes on the film behind the sample's resistance, where the film's (lambda_1
/// lambda_2)^2 is `area`.
#[must_use]
pub fn film_voltage_v(
    sample: &HangingSample,
    command_v: &[f64],
    area: &[f64],
    h_s: f64,
) -> Vec<f64> {
    let tau = sample.time_constant_s();
    if tau <= LEAST_TIME_CONSTANT_S {
        return command_v.to_vec();
    }
    let mut out = vec![command_v[0]];
    for i in 1..command_v.len() {
        let before = out[i - 1];
        let commands = [command_v[i - 1], command_v[i]];
        out.push(charge(tau, h_s, before, [area[i - 1], area[i]], commands).phi);
    }
    out
}

/// The command that makes `phi_v` on the film: phi_c = phi + R d(C phi)/dt, by central differences.
#[must_use]
pub fn command_for_v(sample: &HangingSample, phi_v: &[f64], area: &[f64], h_s: f64) -> Vec<f64> {
    let tau = sample.time_constant_s();
    let last = phi_v.len() - 1;
    (0..phi_v.len())
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            let rise = (area[b] * phi_v[b] - area[a] * phi_v[a]) / ((b - a).max(1) as f64 * h_s);
            phi_v[i] + tau * rise
        })
        .collect()
}
