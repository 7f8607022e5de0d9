//! Adaptive integration of x'' = a(t, x, x', w, z) with the branch states w of the films and further states
//! z: the stiffly accurate, L-stable ESDIRK5(4)7L[2]SA2 of Kennedy and Carpenter (2019, Appl. Numer. Math.
//! 146:221), fifth order with a fourth-order estimate of the error.
//!
//! A stage is the set of implicit equations
//!
//! ```text
//! v = v* + h gamma a,   x = x* + h gamma v,   w = w* + h gamma w'(w, x),   z = z* + h gamma z'(t, x, v, z),   balance(t, x, v, a, w, z) = 0
//! ```
//!
//! whose unknown is the acceleration itself; each branch is solved for by its own 2 x 2 block, so that the
//! system left is as large as x and z together. The mass matrix is never inverted.

use super::branches::{LANES, Pack};

/// The limit of the input that a time stands for, where the input jumps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Just before.
    Before,
    /// Just after.
    After,
}

const STAGES: usize = 7;
/// Quadratures that are carried along: Maxwell work, heat in the films, work of additions (J).
pub const QUADRATURES: usize = 3;
const GAMMA: f64 = 23.0 / 125.0;
const C: [f64; STAGES] = [
    0.0,
    46.0 / 125.0,
    7121331996143.0 / 11335814405378.0,
    49.0 / 353.0,
    3706679970760.0 / 5295570149437.0,
    347.0 / 382.0,
    1.0,
];
const B: [f64; STAGES] = first_from_sum(
    [
        0.0,
        -188593204321.0 / 4778616380481.0,
        2809310203510.0 / 10304234040467.0,
        1021729336898.0 / 2364210264653.0,
        870612361811.0 / 2470410392208.0,
        -1307970675534.0 / 8059683598661.0,
        GAMMA,
    ],
    1.0,
);
const B_HAT: [f64; STAGES] = first_from_sum(
    [
        0.0,
        -582099335757.0 / 7214068459310.0,
        615023338567.0 / 3362626566945.0,
        3192122436311.0 / 6174152374399.0,
        6156034052041.0 / 14430468657929.0,
        -1011318518279.0 / 9693750372484.0,
        1914490192573.0 / 13754262428401.0,
    ],
    1.0,
);
const A: [[f64; STAGES]; STAGES] = [
    [0.0; STAGES],
    first_from_sum([0.0, GAMMA, 0.0, 0.0, 0.0, 0.0, 0.0], C[1]),
    first_from_sum(
        [
            0.0,
            791020047304.0 / 3561426431547.0,
            GAMMA,
            0.0,
            0.0,
            0.0,
            0.0,
        ],
        C[2],
    ),
    first_from_sum(
        [
            0.0,
            -158159076358.0 / 11257294102345.0,
            -85517644447.0 / 5003708988389.0,
            GAMMA,
            0.0,
            0.0,
            0.0,
        ],
        C[3],
    ),
    first_from_sum(
        [
            0.0,
            -1653327111580.0 / 4048416487981.0,
            1514767744496.0 / 9099671765375.0,
            14283835447591.0 / 12247432691556.0,
            GAMMA,
            0.0,
            0.0,
        ],
        C[4],
    ),
    first_from_sum(
        [
            0.0,
            -4540011970825.0 / 8418487046959.0,
            -1790937573418.0 / 7393406387169.0,
            10819093665085.0 / 7266595846747.0,
            4109463131231.0 / 7386972500302.0,
            GAMMA,
            0.0,
        ],
        C[5],
    ),
    B,
];

/// Completes a row whose sum is known with its first number.
const fn first_from_sum(mut row: [f64; STAGES], sum: f64) -> [f64; STAGES] {
    let mut first = sum;
    let mut i = 1;
    while i < STAGES {
        first -= row[i];
        i += 1;
    }
    row[0] = first;
    row
}

/// Weights that extrapolate the values at `nodes` to `at` (Lagrange).
fn lagrange(nodes: &[f64], at: f64, weights: &mut [f64]) {
    for i in 0..nodes.len() {
        weights[i] = 1.0;
        for j in 0..nodes.len() {
            if i != j {
                weights[i] *= (at - nodes[j]) / (nodes[i] - nodes[j]);
            }
        }
    }
}

/// Why a system could not be evaluated or solved at a time.
#[derive(Debug, Clone, PartialEq)]
pub enum Trouble<E> {
    /// A shorter step may help: Newton's iteration does not converge.
    Diverged,
    /// A shorter step may help, but this is what stands in the way otherwise.
    Blocked(E),
    /// No shorter step helps.
    Fatal(E),
}

/// States at one time: D coordinates, packs of branch states, further states.
#[derive(Debug, Clone)]
pub struct State<const D: usize> {
    /// Coordinates, m.
    pub x: [f64; D],
    /// Velocities, m/s.
    pub v: [f64; D],
    /// w = xi^-2, one pack after another, film after film.
    pub w: Vec<Pack>,
    /// Further states.
    pub z: Vec<f64>,
    /// Algebraic unknowns, solved for afresh at each time; here as a guess.
    pub y: Vec<f64>,
}

/// Derivatives at one time.
#[derive(Debug, Clone)]
pub struct Rates<const D: usize> {
    /// Accelerations, m/s^2.
    pub a: [f64; D],
    /// w'.
    pub w: Vec<Pack>,
    /// z'.
    pub z: Vec<f64>,
    /// Algebraic unknowns: a guess on entry, the solution on return.
    pub y: Vec<f64>,
}

/// Where an implicit stage starts and how it is weighed.
#[derive(Debug)]
pub struct Stage<'a, const D: usize> {
    /// Time of the stage, s; inputs are taken just before it.
    pub t_s: f64,
    /// h gamma, s.
    pub weight_s: f64,
    /// The explicit part x*, v*, w*, z*.
    pub star: &'a State<D>,
    /// Size of a correction, over the tolerance of the step, at which the iteration ends.
    pub enough: f64,
}

/// Tolerances of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Of x, m.
    pub x: f64,
    /// Of v, m/s.
    pub v: f64,
    /// Of w, relative.
    pub w: f64,
}

/// A second-order system with films.
pub trait System<const D: usize> {
    /// What can go wrong.
    type Error;
    /// Accelerations and rates at a state, the inputs taken on the given side of `t_s`.
    ///
    /// # Errors
    /// As [`Trouble`] says.
    fn rates(
        &mut self,
        t_s: f64,
        side: Side,
        state: &State<D>,
        rates: &mut Rates<D>,
    ) -> Result<[f64; QUADRATURES], Trouble<Self::Error>>;
    /// Solves a stage: on entry `state.w`, `state.z`, `state.y` and `a` hold a guess, on return the solution.
    /// Returns the powers of the quadratures.
    ///
    /// # Errors
    /// As [`Trouble`] says.
    fn stage(
        &mut self,
        stage: &Stage<D>,
        state: &mut State<D>,
        a: &mut [f64; D],
    ) -> Result<[f64; QUADRATURES], Trouble<Self::Error>>;
    /// Looks at an accepted step's end.
    ///
    /// # Errors
    /// What ends the integration there.
    fn accept(&mut self, _t_s: f64, _state: &State<D>) -> Result<(), Self::Error> {
        Ok(())
    }
    /// The next time after `t_s` that no step may cross.
    fn next_break_s(&self, t_s: f64) -> f64;
    /// Scale of the further state `i`.
    fn z_scale(&self, _i: usize) -> f64 {
        1.0
    }
    /// The error that says that no step is short enough.
    fn stuck(&self, t_s: f64, state: &State<D>) -> Self::Error;
}

/// How the integration went.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effort {
    /// Steps that were kept.
    pub steps: usize,
    /// Steps that were repeated shorter.
    pub rejected: usize,
}

/// Steps, kept or not, in which a second has to be done: 10 us each on average, where what an actuator and
/// its causes do takes milliseconds. What takes more would take hours, and is no motion of anything.
const MOST_TRIES_A_SECOND: usize = 100_000;

/// Step control.
#[derive(Debug, Clone, Copy)]
pub struct Control {
    /// Tolerance of a step.
    pub scale: Scale,
    /// Longest step, s.
    pub longest_s: f64,
    /// Shortest step, s.
    pub shortest_s: f64,
    /// First step, s.
    pub first_s: f64,
}

fn combine_packs(out: &mut [Pack], base: &[Pack], rates: &[Rates0], weights: &[f64]) {
    for (p, (out, base)) in out.iter_mut().zip(base).enumerate() {
        let mut sum = *base;
        for (rate, &weight) in rates.iter().zip(weights) {
            if weight == 0.0 {
                continue;
            }
            for i in 0..2 {
                for n in 0..LANES {
                    sum[i][n] += weight * rate[p][i][n];
                }
            }
        }
        *out = sum;
    }
}

type Rates0 = Vec<Pack>;

/// The integrator with its memory; nothing is allocated while it runs.
pub struct Integrator<const D: usize> {
    control: Control,
    t_s: f64,
    state: State<D>,
    /// State at the beginning of the last step.
    previous: State<D>,
    step_s: f64,
    a: [[f64; D]; STAGES],
    v: [[f64; D]; STAGES],
    w: Vec<Rates0>,
    z: Vec<Vec<f64>>,
    y: Vec<Vec<f64>>,
    power: [[f64; QUADRATURES]; STAGES],
    /// Integrals of the powers since the start.
    pub quadratures: [f64; QUADRATURES],
    star: State<D>,
    trial: State<D>,
    rates: Rates<D>,
    zero: Vec<Pack>,
    slope: [f64; D],
    /// Length of the last step, s.
    last_s: f64,
    /// The last step ended where an input jumps.
    broken: bool,
    /// When the tries were last counted, s, and how many there had been.
    counted: (f64, usize),
    /// Steps so far.
    pub effort: Effort,
}

impl<const D: usize> Integrator<D> {
    /// Starts at `t_s` with `state`.
    ///
    /// # Errors
    /// The system's own, at the start.
    pub fn start<S: System<D>>(
        system: &mut S,
        t_s: f64,
        state: State<D>,
        control: Control,
    ) -> Result<Self, S::Error> {
        let packs = state.w.len();
        let zero = vec![[[0.0; LANES]; 2]; packs];
        let nz = state.z.len();
        let mut out = Integrator {
            control,
            t_s,
            previous: state.clone(),
            star: state.clone(),
            trial: state.clone(),
            step_s: control.first_s,
            a: [[0.0; D]; STAGES],
            v: [[0.0; D]; STAGES],
            w: vec![zero.clone(); STAGES],
            z: vec![vec![0.0; nz]; STAGES],
            y: vec![state.y.clone(); STAGES],
            power: [[0.0; QUADRATURES]; STAGES],
            quadratures: [0.0; QUADRATURES],
            rates: Rates {
                a: [0.0; D],
                w: zero.clone(),
                z: vec![0.0; nz],
                y: state.y.clone(),
            },
            zero,
            slope: [0.0; D],
            last_s: 0.0,
            broken: false,
            counted: (t_s, 0),
            effort: Effort::default(),
            state,
        };
        out.restart(system)?;
        Ok(out)
    }

    /// Takes the rates at the current time, just after a jump of the inputs.
    fn restart<S: System<D>>(&mut self, system: &mut S) -> Result<(), S::Error> {
        self.rates.y.copy_from_slice(&self.state.y);
        let trouble = system.rates(self.t_s, Side::After, &self.state, &mut self.rates);
        let power = match trouble {
            Ok(power) => power,
            Err(Trouble::Blocked(e) | Trouble::Fatal(e)) => return Err(e),
            Err(Trouble::Diverged) => return Err(system.stuck(self.t_s, &self.state)),
        };
        self.a[0] = self.rates.a;
        self.v[0] = self.state.v;
        self.w[0].copy_from_slice(&self.rates.w);
        self.z[0].copy_from_slice(&self.rates.z);
        self.y[0].copy_from_slice(&self.rates.y);
        self.power[0] = power;
        self.slope = [0.0; D];
        Ok(())
    }

    /// Current time, s.
    pub fn time_s(&self) -> f64 {
        self.t_s
    }

    /// Time at which the last step began, s.
    pub fn last_start_s(&self) -> f64 {
        self.t_s - self.last_s
    }

    /// State at the current time.
    pub fn state(&self) -> &State<D> {
        &self.state
    }

    /// State at `t_s` within the last step: x is the quintic through position, velocity and acceleration at
    /// both ends, v its derivative, w and z are cubics through value and rate.
    pub fn at(&self, t_s: f64, out: &mut State<D>) {
        let h = self.last_s;
        if h <= 0.0 || t_s >= self.t_s {
            out.x = self.state.x;
            out.v = self.state.v;
            out.w.copy_from_slice(&self.state.w);
            out.z.copy_from_slice(&self.state.z);
            out.y.copy_from_slice(&self.state.y);
            return;
        }
        let s = 1.0 - (self.t_s - t_s) / h;
        let (s2, s3) = (s * s, s * s * s);
        // After a step, the rates at its beginning are in the last place, those at its end in the first.
        let (a0, a1) = (&self.a[STAGES - 1], &self.a[0]);
        for i in 0..D {
            let (x0, x1) = (self.previous.x[i], self.state.x[i]);
            let (v0, v1) = (self.previous.v[i] * h, self.state.v[i] * h);
            let (c0, c1) = (0.5 * a0[i] * h * h, 0.5 * a1[i] * h * h);
            // x0 + v0 s + c0 s^2 + s^3 (p + q s + r s^2)
            let d = x1 - x0 - v0 - c0;
            let e = v1 - v0 - 2.0 * c0;
            let f = c1 - c0;
            let p = 10.0 * d - 4.0 * e + f;
            let q = -15.0 * d + 7.0 * e - 2.0 * f;
            let r = 6.0 * d - 3.0 * e + f;
            out.x[i] = x0 + v0 * s + c0 * s2 + s3 * (p + q * s + r * s2);
            out.v[i] = (v0 + 2.0 * c0 * s + s2 * (3.0 * p + 4.0 * q * s + 5.0 * r * s2)) / h;
        }
        let weights = [
            2.0 * s3 - 3.0 * s2 + 1.0,
            (s3 - 2.0 * s2 + s) * h,
            3.0 * s2 - 2.0 * s3,
            (s3 - s2) * h,
        ];
        for (p, out) in out.w.iter_mut().enumerate() {
            for i in 0..2 {
                for n in 0..LANES {
                    out[i][n] = weights[0] * self.previous.w[p][i][n]
                        + weights[1] * self.w[STAGES - 1][p][i][n]
                        + weights[2] * self.state.w[p][i][n]
                        + weights[3] * self.w[0][p][i][n];
                }
            }
        }
        for (i, out) in out.y.iter_mut().enumerate() {
            *out = (1.0 - s) * self.y[STAGES - 1][i] + s * self.y[0][i];
        }
        for (i, out) in out.z.iter_mut().enumerate() {
            *out = weights[0] * self.previous.z[i]
                + weights[1] * self.z[STAGES - 1][i]
                + weights[2] * self.state.z[i]
                + weights[3] * self.z[0][i];
        }
    }

    /// Tries one step of length `h`. Ok(error over tolerance) with the new state in `trial`.
    fn attempt<S: System<D>>(&mut self, system: &mut S, h: f64) -> Result<f64, Trouble<S::Error>> {
        let weight = h * GAMMA;
        let mut weights = [0.0; STAGES];
        let mut guess = [0.0; STAGES];
        for s in 1..STAGES {
            for j in 0..s {
                weights[j] = h * A[s][j];
            }
            for i in 0..D {
                let (mut x, mut v) = (self.state.x[i], self.state.v[i]);
                for j in 0..s {
                    x += weights[j] * self.v[j][i];
                    v += weights[j] * self.a[j][i];
                }
                (self.star.x[i], self.star.v[i]) = (x, v);
            }
            combine_packs(&mut self.star.w, &self.state.w, &self.w[..s], &weights[..s]);
            for i in 0..self.star.z.len() {
                self.star.z[i] =
                    self.state.z[i] + (0..s).map(|j| weights[j] * self.z[j][i]).sum::<f64>();
            }
            // Guess: the rates of the stages so far, extrapolated.
            let mut a = [0.0; D];
            if s == 1 {
                guess[0] = 1.0;
                for i in 0..D {
                    a[i] = self.a[0][i] + self.slope[i] * C[1] * h;
                }
            } else {
                lagrange(&C[..s], C[s], &mut guess[..s]);
                for i in 0..D {
                    a[i] = (0..s).map(|j| guess[j] * self.a[j][i]).sum();
                }
            }
            for i in 0..self.trial.y.len() {
                self.trial.y[i] = (0..s).map(|j| guess[j] * self.y[j][i]).sum();
            }
            for (g, gamma) in weights.iter_mut().zip(&guess[..s]) {
                *g = weight * gamma;
            }
            combine_packs(&mut self.trial.w, &self.star.w, &self.w[..s], &weights[..s]);
            for i in 0..self.star.z.len() {
                self.trial.z[i] =
                    self.star.z[i] + (0..s).map(|j| weights[j] * self.z[j][i]).sum::<f64>();
            }
            let stage = Stage {
                t_s: self.t_s + C[s] * h,
                weight_s: weight,
                star: &self.star,
                enough: 0.02,
            };
            self.power[s] = system.stage(&stage, &mut self.trial, &mut a)?;
            self.a[s] = a;
            self.v[s] = self.trial.v;
            self.y[s].copy_from_slice(&self.trial.y);
            let inverse = 1.0 / weight;
            for ((rate, w), star) in self.w[s].iter_mut().zip(&self.trial.w).zip(&self.star.w) {
                for i in 0..2 {
                    for n in 0..LANES {
                        rate[i][n] = (w[i][n] - star[i][n]) * inverse;
                    }
                }
            }
            for i in 0..self.star.z.len() {
                self.z[s][i] = (self.trial.z[i] - self.star.z[i]) * inverse;
            }
        }
        // Error estimate: the difference of the two sums.
        let mut e = [0.0; STAGES];
        for s in 0..STAGES {
            e[s] = h * (B[s] - B_HAT[s]);
        }
        let scale = self.control.scale;
        let mut error = 0.0_f64;
        for i in 0..D {
            let x: f64 = (0..STAGES).map(|s| e[s] * self.v[s][i]).sum();
            let v: f64 = (0..STAGES).map(|s| e[s] * self.a[s][i]).sum();
            error = error.max((x / scale.x).abs()).max((v / scale.v).abs());
        }
        combine_packs(&mut self.star.w, &self.zero, &self.w, &e);
        let mut worst = 0.0_f64;
        for (d, w) in self.star.w.iter().zip(&self.trial.w) {
            for i in 0..2 {
                for n in 0..LANES {
                    let relative = (d[i][n] / w[i][n]).abs();
                    worst = if relative > worst { relative } else { worst };
                }
            }
        }
        error = error.max(worst / scale.w);
        for i in 0..self.star.z.len() {
            let d: f64 = (0..STAGES).map(|s| e[s] * self.z[s][i]).sum();
            let size = system.z_scale(i).max(self.trial.z[i].abs());
            error = error.max((d / (scale.w * size)).abs());
        }
        Ok(if error.is_nan() { f64::INFINITY } else { error })
    }

    /// Moves on by one accepted step, not beyond `end_s`.
    ///
    /// # Errors
    /// The system's, at the last time that could be reached.
    pub fn step<S: System<D>>(&mut self, system: &mut S, end_s: f64) -> Result<(), S::Error> {
        if self.broken {
            self.restart(system)?;
            self.broken = false;
        }
        let limit = system.next_break_s(self.t_s).min(end_s);
        let mut blocked = None;
        let mut tries = 0;
        if self.t_s - self.counted.0 >= 1.0 {
            self.counted = (self.t_s, self.effort.steps + self.effort.rejected);
        }
        loop {
            if self.effort.steps + self.effort.rejected - self.counted.1 > MOST_TRIES_A_SECOND {
                return Err(system.stuck(self.t_s, &self.state));
            }
            let mut h = self.step_s.min(self.control.longest_s);
            let left = limit - self.t_s;
            let last = h >= left * (1.0 - 1e-9);
            if last {
                h = left;
            } else if 2.0 * h > left {
                h = 0.5 * left;
            }
            let outcome = self.attempt(system, h);
            match outcome {
                Ok(error) if error <= 1.0 => {
                    // The estimate is of fourth order.
                    let most = if tries == 0 { 5.0 } else { 1.0 };
                    let next = h * (0.9 * error.max(1e-5).powf(-0.2)).clamp(0.2, most);
                    // A step cut short by a limit does not shorten the next one.
                    self.step_s = if last { next.max(self.step_s) } else { next };
                    let t = if last { limit } else { self.t_s + h };
                    for q in 0..QUADRATURES {
                        self.quadratures[q] += (0..STAGES)
                            .map(|s| h * B[s] * self.power[s][q])
                            .sum::<f64>();
                    }
                    std::mem::swap(&mut self.previous, &mut self.state);
                    std::mem::swap(&mut self.state, &mut self.trial);
                    for i in 0..D {
                        self.slope[i] = (self.a[STAGES - 1][i] - self.a[5][i]) / ((1.0 - C[5]) * h);
                    }
                    self.t_s = t;
                    self.last_s = h;
                    self.w.swap(0, STAGES - 1);
                    self.z.swap(0, STAGES - 1);
                    self.y.swap(0, STAGES - 1);
                    self.a.swap(0, STAGES - 1);
                    self.v.swap(0, STAGES - 1);
                    self.power.swap(0, STAGES - 1);
                    self.effort.steps += 1;
                    system.accept(t, &self.state)?;
                    self.broken = last && t < end_s;
                    return Ok(());
                }
                Ok(error) => {
                    self.step_s = h * (0.9 * error.powf(-0.2)).clamp(0.1, 0.8);
                }
                Err(Trouble::Fatal(e)) => return Err(e),
                Err(Trouble::Blocked(e)) => {
                    blocked = Some(e);
                    self.step_s = 0.3 * h;
                }
                Err(Trouble::Diverged) => self.step_s = 0.3 * h,
            }
            self.effort.rejected += 1;
            tries += 1;
            if self.step_s < self.control.shortest_s {
                return Err(match blocked {
                    Some(e) => e,
                    None => system.stuck(self.t_s, &self.state),
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of all trees up to order five over the tableau; what b must give and what b^ must give up to
    /// order four.
    #[test]
    fn order_conditions() {
        type Tree = [f64; STAGES];
        let mul = |x: Tree, y: Tree| -> Tree { std::array::from_fn(|i| x[i] * y[i]) };
        let apply = |x: Tree| -> Tree {
            std::array::from_fn(|i| A[i].iter().zip(x).map(|(a, x)| a * x).sum())
        };
        let one = [1.0; STAGES];
        let c = apply(one);
        for i in 0..STAGES {
            assert!((c[i] - C[i]).abs() < 1e-13);
        }
        let c2 = mul(c, c);
        let c3 = mul(c2, c);
        let (ac, ac2) = (apply(c), apply(c2));
        let aac = apply(ac);
        let up_to_four = [
            (one, 1.0),
            (c, 1.0 / 2.0),
            (c2, 1.0 / 3.0),
            (ac, 1.0 / 6.0),
            (c3, 1.0 / 4.0),
            (mul(c, ac), 1.0 / 8.0),
            (ac2, 1.0 / 12.0),
            (aac, 1.0 / 24.0),
        ];
        let five = [
            (mul(c2, c2), 1.0 / 5.0),
            (mul(c2, ac), 1.0 / 10.0),
            (mul(c, ac2), 1.0 / 15.0),
            (mul(c, aac), 1.0 / 30.0),
            (mul(ac, ac), 1.0 / 20.0),
            (apply(c3), 1.0 / 20.0),
            (apply(mul(c, ac)), 1.0 / 40.0),
            (apply(ac2), 1.0 / 60.0),
            (apply(aac), 1.0 / 120.0),
        ];
        let sum = |b: Tree, x: Tree| mul(b, x).iter().sum::<f64>();
        for (i, (x, want)) in up_to_four.iter().chain(&five).enumerate() {
            let sum = sum(B, *x);
            assert!((sum - want).abs() < 1e-12, "tree {i}: {sum}, not {want}");
        }
        for (x, want) in &up_to_four {
            assert!((sum(B_HAT, *x) - want).abs() < 1e-11);
        }
    }
}
