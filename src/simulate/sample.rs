//! Forward and inverse dynamics of the hanging film sample (section 5 of the model).
//!
//! Forward: M x'' = M g - F with the force F through the film. The stretches lambda_1, lambda_2 of the active
//! part, lambda_2 of the side strips and lambda_1, lambda_2 of the end strips are algebraic: they are solved
//! for within each stage, each part's lambda_2 eliminated from sigma_2 = eps E^2 (active) or 0.
//!
//! ```text
//! part:   sigma_2 - X = 0,  X = eps E^2 = (eps/L3^2) (phi lambda_1 lambda_2)^2,  F = (sigma_1 - X)/lambda_1 width L3
//! parts:  F_active + F_side = F_end = M (g - x''),   L_a lambda_1a + L_e lambda_1e = rest length + x
//! ```
//!
//! A stiff electrode adds to the equilibrium spring of the active part. Behind a series resistance the charge
//! is a state: with c = (lambda_1 lambda_2)^2 and z = c phi, z' = (phi_c - phi)/(R C_0), so that a stage is
//! linear in z: z = (z* + kappa phi_c)/(1 + kappa/c), kappa = h gamma/(R C_0).

use super::Error;
use super::branches::{Elimination, LANES, Pack, Response, Springs};
use super::effects::EffectClock;
use super::integrator::{
    Control, Effort, Integrator, QUADRATURES, Rates, Scale, Side, Stage, State, System, Trouble,
};
use super::voltage::Voltage;
use crate::effects::{Acting, Site, When};
use crate::film::Film;
use crate::model::{HangingSample, Linear, SampleCourse, SampleLoad, sample_loads};
use crate::units::GRAVITY_M_S2;

/// Places of the algebraic unknowns.
const ACTIVE_1: usize = 0;
const ACTIVE_2: usize = 1;
const SIDE_2: usize = 2;
const END_1: usize = 3;
const END_2: usize = 4;
const ITERATIONS: usize = 15;
/// Distance of the moments at which causes are told along a course, s; passes along it at most, and how far it
/// may move in the last one, m.
const CAUSES_STEP_S: f64 = 0.0025;
const PASSES: usize = 20;
const STANDS_STILL_M: f64 = 1e-7;
/// Increment of ln lambda below which one more Newton iteration would change nothing of note.
const QUADRATIC: f64 = 1e-8;

/// Stretches of the parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretches {
    /// lambda_1, lambda_2 of the active part; the side strips share lambda_1.
    pub active: [f64; 2],
    /// lambda_2 of the side strips.
    pub side_2: f64,
    /// lambda_1, lambda_2 of the end strips.
    pub end: [f64; 2],
}

/// A sample at rest, every branch relaxed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleRest {
    /// Length of the sample, m.
    pub length_m: f64,
    /// Stretches of its parts.
    pub stretches: Stretches,
}

/// What is asked for beside the sample and its drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleOptions {
    /// Distance of the samples of the result, s.
    pub sample_step_s: f64,
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Length of the motion, s.
    pub duration_s: f64,
    /// Tolerance of one step for x, m.
    pub tolerance_m: f64,
    /// Longest step, s.
    pub longest_step_s: f64,
}

impl Default for SampleOptions {
    fn default() -> Self {
        SampleOptions {
            sample_step_s: 0.01,
            start_s: 0.0,
            duration_s: 10.0,
            tolerance_m: 1e-9,
            longest_step_s: 0.1,
        }
    }
}

/// The motion of a hanging sample at equal distances in time.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleMotion {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Distance of the samples, s.
    pub step_s: f64,
    /// Length at rest under the first voltage, m; x = 0 there.
    pub rest_length_m: f64,
    /// x, downwards, m.
    pub x_m: Vec<f64>,
    /// x', m/s.
    pub velocity_m_s: Vec<f64>,
    /// x'', m/s^2.
    pub acceleration_m_s2: Vec<f64>,
    /// Stretches of the parts.
    pub stretches: Vec<Stretches>,
    /// Voltage on the film, V (just before a jump of the command).
    pub phi_v: Vec<f64>,
    /// sigma_1 - eps E^2 of the active part, as its springs have it, Pa.
    pub net_pa: Vec<f64>,
    /// Steps taken.
    pub effort: Effort,
}

/// x(t) of a hanging sample at equal distances in time, for the inverse dynamics.
#[derive(Debug, Clone, Copy)]
pub struct SampleTrack<'a> {
    /// Distance of the samples, s.
    pub step_s: f64,
    /// x, m.
    pub x_m: &'a [f64],
    /// x', m/s.
    pub velocity_m_s: &'a [f64],
    /// x'', m/s^2.
    pub acceleration_m_s2: &'a [f64],
    /// Voltage under which the sample hung at rest at x = 0, V.
    pub rest_phi_v: f64,
}

/// Linearised force of a part with lambda_2 eliminated: F + stiffness d ln lambda_1, and
/// d ln lambda_2 = free + follow d ln lambda_1.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    force: f64,
    stiffness: f64,
    free: f64,
    follow: f64,
}

impl Part {
    /// `maxwell` is X = eps E^2, `slope` is d ln X / d ln(lambda_1 lambda_2): 2 under a voltage, -2 with a
    /// charge.
    fn new(film: &Response, lambda_1: f64, section: f64, maxwell: f64, slope: f64) -> Self {
        let two_x = slope * maxwell;
        let [t11, t12, t21, t22] = film.tangent.map(|t| t - two_x);
        let follow = -t21 / t22;
        let free = -(film.sigma[1] - maxwell) / t22;
        let net = film.sigma[0] - maxwell;
        let scale = section / lambda_1;
        Part {
            force: scale * (net + t12 * free),
            stiffness: scale * (t11 + t12 * follow - net),
            free,
            follow,
        }
    }
}

/// What causes make of a sample at equal distances in time; between them straight lines.
struct Loads {
    start_s: f64,
    step_s: f64,
    list: Vec<SampleLoad>,
}

impl Loads {
    fn at(&self, t_s: f64) -> SampleLoad {
        let last = self.list.len() - 1;
        let place = ((t_s - self.start_s) / self.step_s).clamp(0.0, last as f64);
        let i = (place as usize).min(last.saturating_sub(1));
        let s = place - i as f64;
        let (a, b) = (&self.list[i], &self.list[(i + 1).min(last)]);
        let mix = |a: f64, b: f64| a + s * (b - a);
        let both = |a: &Linear, b: &Linear| Linear {
            value: mix(a.value, b.value),
            slope: [0, 1].map(|k| mix(a.slope[k], b.slope[k])),
        };
        SampleLoad {
            about: [0, 1, 2].map(|k| mix(a.about[k], b.about[k])),
            squared_v2: both(&a.squared_v2, &b.squared_v2),
            factor: mix(a.factor, b.factor),
            active_pa: [0, 1].map(|k| both(&a.active_pa[k], &b.active_pa[k])),
            strips_pa: [0, 1].map(|k| both(&a.strips_pa[k], &b.strips_pa[k])),
            slack: [0, 1].map(|k| mix(a.slack[k], b.slack[k])),
            mass: mix(a.mass, b.mass),
        }
    }
}

/// Films of the three parts (active, side, end) and their constants.
struct Hanging {
    sample: HangingSample,
    springs: Springs,
    /// With the electrode's layer.
    active: Springs,
    packs: usize,
    lengths: [f64; 2],
    sections: [f64; 3],
    maxwell: f64,
    /// R C at lambda_1 lambda_2 = 1, s; 0 without a resistance.
    time_constant_s: f64,
    rest_length: f64,
    scale: Scale,
    elimination: Vec<Elimination>,
    scratch: Vec<Pack>,
    contraction: f64,
    /// What causes make of it, where there are some, and of the moment that is looked at.
    loads: Option<Loads>,
    here: Option<SampleLoad>,
    /// sigma_1 - sigma_2 of the active part there, Pa.
    net_pa: f64,
}

impl Hanging {
    fn new(sample: &HangingSample, film: &Film, tolerance_m: f64) -> Self {
        let springs = Springs::new(film);
        let mut painted = film.clone();
        painted.mu_pa[0] += sample.electrode.modulus_pa;
        let active = Springs::new(&painted);
        let packs = springs.packs();
        Hanging {
            sample: *sample,
            packs,
            springs,
            active,
            time_constant_s: sample.time_constant_s(),
            lengths: sample.lengths_m(),
            sections: sample.sections_m2(),
            maxwell: sample.maxwell_f_m3(),
            rest_length: 0.0,
            // The sample bounces at some Hz; x moves by half its length with ln w.
            scale: Scale {
                x: tolerance_m,
                v: 50.0 * tolerance_m,
                w: 0.2 * tolerance_m / sample.length_m,
            },
            elimination: vec![Elimination::ZERO; 3 * packs],
            scratch: vec![[[0.0; LANES]; 2]; 3 * packs],
            contraction: 0.1,
            loads: None,
            here: None,
            net_pa: 0.0,
        }
    }

    /// Mass that hangs on it at the moment that is looked at, kg.
    fn mass_kg(&self) -> f64 {
        self.sample.mass_kg * self.here.map_or(1.0, |l| l.mass)
    }

    /// Adds what causes make of the stresses of the parts.
    fn add_loads(&mut self, y: &[f64], films: &mut [Response; 3]) {
        if let Some(load) = &self.here {
            let d = [ACTIVE_1, ACTIVE_2, END_1].map(|k| y[k].ln());
            let d = [0, 1, 2].map(|k| d[k] - load.about[k]);
            for film in films.iter_mut() {
                film.sigma = film.sigma.map(|s| load.factor * s);
                film.tangent = film.tangent.map(|t| load.factor * t);
            }
            for (k, own) in load.active_pa.iter().enumerate() {
                films[0].sigma[k] += own.at([d[0], d[1]]);
                films[0].tangent[2 * k] += own.slope[0];
                films[0].tangent[2 * k + 1] += own.slope[1];
            }
            for (part, d) in [(0, d[0]), (1, d[2])] {
                let own = &load.strips_pa[part];
                films[1 + part].sigma[0] += own.at([d, 0.0]);
                films[1 + part].tangent[0] += own.slope[0];
            }
        }
        self.net_pa = films[0].sigma[0] - films[0].sigma[1];
    }

    /// Voltage on the film where no charge is a state, V, and d ln X / d ln(lambda_1 lambda_2).
    fn held(&self, y: &[f64], command_v: f64) -> (f64, f64) {
        let Some(load) = &self.here else {
            return (command_v, 2.0);
        };
        let d = [
            y[ACTIVE_1].ln() - load.about[0],
            y[ACTIVE_2].ln() - load.about[1],
        ];
        let square = load.squared_v2.at(d);
        match square > 0.0 {
            true => (square.sqrt(), 2.0 + load.squared_v2.slope[0] / square),
            false => (0.0, 2.0),
        }
    }

    /// Squared stretches of part `p` (0 active, 1 side, 2 end).
    fn squared(y: &[f64], p: usize) -> [f64; 2] {
        match p {
            0 => [y[ACTIVE_1] * y[ACTIVE_1], y[ACTIVE_2] * y[ACTIVE_2]],
            1 => [y[ACTIVE_1] * y[ACTIVE_1], y[SIDE_2] * y[SIDE_2]],
            _ => [y[END_1] * y[END_1], y[END_2] * y[END_2]],
        }
    }

    /// Films with branch states frozen (`weight_s` None) or followed implicitly from `star`.
    fn films(
        &mut self,
        t_s: f64,
        y: &[f64],
        w: &[Pack],
        implicit: Option<(&[Pack], f64)>,
    ) -> Result<[Response; 3], Error> {
        let n = self.packs;
        self.here = self.loads.as_ref().map(|l| l.at(t_s));
        let mut out = [Response::default(); 3];
        for p in 0..3 {
            let own = p * n..(p + 1) * n;
            let squared = Self::squared(y, p);
            let springs = if p == 0 { &self.active } else { &self.springs };
            out[p] = match implicit {
                Some((star, weight)) => springs.implicit(
                    squared,
                    weight,
                    &star[own.clone()],
                    &w[own.clone()],
                    &mut self.elimination[own.clone()],
                ),
                None => springs.explicit(squared, &w[own.clone()], &mut self.scratch[own.clone()]),
            };
            if out[p].least.is_nan() || out[p].least <= 0.0 {
                return Err(Error::LockedPart {
                    part: ["active part", "side strips", "end strips"][p],
                    place: springs.locked(squared, &w[own], t_s),
                });
            }
        }
        self.add_loads(y, &mut out);
        Ok(out)
    }

    /// The parts under the film's voltage; `slope` is d ln X / d ln(lambda_1 lambda_2).
    fn parts(&self, films: &[Response; 3], y: &[f64], phi: f64, slope: f64) -> [Part; 3] {
        let field = phi * y[ACTIVE_1] * y[ACTIVE_2];
        let maxwell = self.maxwell * field * field;
        let mut active = Part::new(&films[0], y[ACTIVE_1], self.sections[0], maxwell, slope);
        if let Some(load) = &self.here {
            let (kept, more) = (
                1.0 + load.slack[1],
                load.slack[0] * self.sections[0] / y[ACTIVE_1],
            );
            active.force = kept * active.force + more;
            active.stiffness = kept * active.stiffness - more;
        }
        [
            active,
            Part::new(&films[1], y[ACTIVE_1], self.sections[1], 0.0, 2.0),
            Part::new(&films[2], y[END_1], self.sections[2], 0.0, 2.0),
        ]
    }

    /// (lambda_1 lambda_2)^2 of the active part.
    fn area(y: &[f64]) -> f64 {
        (y[ACTIVE_1] * y[ACTIVE_2]).powi(2)
    }

    /// Moves `y` by d ln lambda_1 of the active and the end part; returns the increments of the parts' ln
    /// lambda and the largest.
    fn advance(parts: &[Part; 3], y: &mut [f64], active: f64, end: f64) -> ([[f64; 2]; 3], f64) {
        let second = |p: &Part, d: f64| p.free + p.follow * d;
        let increments = [
            [active, second(&parts[0], active)],
            [active, second(&parts[1], active)],
            [end, second(&parts[2], end)],
        ];
        y[ACTIVE_1] *= 1.0 + active;
        y[ACTIVE_2] *= 1.0 + increments[0][1];
        y[SIDE_2] *= 1.0 + increments[1][1];
        y[END_1] *= 1.0 + end;
        y[END_2] *= 1.0 + increments[2][1];
        let mut largest = 0.0_f64;
        for d in increments.iter().flatten() {
            largest = if d.abs() <= largest { largest } else { d.abs() };
        }
        (increments, largest)
    }

    /// The active part pulls in when its lambda_2 has no equilibrium or it gives way under its load.
    fn unstable(&self, t_s: f64, parts: &[Part; 3], y: &[f64]) -> Option<Error> {
        let active = (parts[0].stiffness + parts[1].stiffness) / (self.lengths[0] * y[ACTIVE_1]);
        let end = parts[2].stiffness / (self.lengths[1] * y[END_1]);
        let worst = active.min(end);
        (active.is_nan() || end.is_nan() || worst <= 0.0).then(|| Error::SampleUnstable {
            at_s: t_s,
            length_m: self.length(y),
            stiffness_n_m: worst,
        })
    }

    fn length(&self, y: &[f64]) -> f64 {
        self.lengths[0] * y[ACTIVE_1] + self.lengths[1] * y[END_1]
    }

    fn follow(&mut self, increments: &[[f64; 2]; 3], w: &mut [Pack]) -> f64 {
        let n = self.packs;
        let mut largest = 0.0_f64;
        for (p, increment) in increments.iter().enumerate() {
            let own = p * n..(p + 1) * n;
            let moved =
                self.springs
                    .follow(*increment, &mut w[own.clone()], &self.elimination[own]);
            largest = if moved <= largest { largest } else { moved };
        }
        largest
    }
}

/// The forward problem.
struct Forward<'a> {
    hanging: Hanging,
    voltage: &'a dyn Voltage,
}

impl Forward<'_> {
    /// Newton's increments: (d ln lambda_1 active, d ln lambda_1 end, d x'') with x free to move by
    /// `compliance` d x''.
    fn increments(
        &self,
        parts: &[Part; 3],
        y: &[f64],
        x: f64,
        a: f64,
        compliance: f64,
    ) -> [f64; 3] {
        let h = &self.hanging;
        let (ca, ce) = (h.lengths[0] * y[ACTIVE_1], h.lengths[1] * y[END_1]);
        let gap = h.rest_length + x - ca - ce;
        let (ka, ke) = (parts[0].stiffness + parts[1].stiffness, parts[2].stiffness);
        let fa = parts[0].force + parts[1].force;
        let mass = h.mass_kg();
        let tension = mass * (GRAVITY_M_S2 - a);
        // ca (T - M d - Fa)/ka + ce (T - M d - Fe)/ke = gap + compliance d
        let (na, ne) = (ca / ka, ce / ke);
        let d = (na * (tension - fa) + ne * (tension - parts[2].force) - gap)
            / (compliance + mass * (na + ne));
        [
            (tension - mass * d - fa) / ka,
            (tension - mass * d - parts[2].force) / ke,
            d,
        ]
    }
}

impl System<1> for Forward<'_> {
    type Error = Error;

    fn rates(
        &mut self,
        t_s: f64,
        side: Side,
        state: &State<1>,
        rates: &mut Rates<1>,
    ) -> Result<[f64; QUADRATURES], Trouble<Error>> {
        let command = self.voltage.phi_v(t_s, side)[0];
        for _ in 0..30 {
            let films = self
                .hanging
                .films(t_s, &rates.y, &state.w, None)
                .map_err(Trouble::Blocked)?;
            rates.w.copy_from_slice(&self.hanging.scratch);
            let (phi, slope) = match state.z.first() {
                Some(z) => (z / Hanging::area(&rates.y), -2.0),
                None => self.hanging.held(&rates.y, command),
            };
            if let Some(rate) = rates.z.first_mut() {
                *rate = (command - phi) / self.hanging.time_constant_s;
            }
            let parts = self.hanging.parts(&films, &rates.y, phi, slope);
            if let Some(error) = self.hanging.unstable(t_s, &parts, &rates.y) {
                return Err(Trouble::Blocked(error));
            }
            let [da, de, d] = self.increments(&parts, &rates.y, state.x[0], rates.a[0], 0.0);
            rates.a[0] += d;
            let (_, size) = Hanging::advance(&parts, &mut rates.y, da, de);
            // Newton's iteration converges quadratically: what is left is the square of this.
            if size < QUADRATIC {
                return Ok([0.0; QUADRATURES]);
            }
            if size.is_nan() || size > 0.5 {
                return Err(Trouble::Diverged);
            }
        }
        Err(Trouble::Diverged)
    }

    fn stage(
        &mut self,
        stage: &Stage<1>,
        state: &mut State<1>,
        a: &mut [f64; 1],
    ) -> Result<[f64; QUADRATURES], Trouble<Error>> {
        let (t_s, hg) = (stage.t_s, stage.weight_s);
        let command = self.voltage.phi_v(t_s, Side::Before)[0];
        let mut last = f64::INFINITY;
        for iteration in 0..ITERATIONS {
            let x = stage.star.x[0] + hg * (stage.star.v[0] + hg * a[0]);
            let films = self
                .hanging
                .films(t_s, &state.y, &state.w, Some((&stage.star.w, hg)))
                .map_err(Trouble::Blocked)?;
            let (phi, slope) = match state.z.first_mut() {
                Some(z) => {
                    let kappa = hg / self.hanging.time_constant_s;
                    let share = kappa / Hanging::area(&state.y);
                    *z = (stage.star.z[0] + kappa * command) / (1.0 + share);
                    let slope = 4.0 * share / (1.0 + share) - 2.0;
                    (*z / Hanging::area(&state.y), slope)
                }
                None => self.hanging.held(&state.y, command),
            };
            let parts = self.hanging.parts(&films, &state.y, phi, slope);
            if let Some(error) = self.hanging.unstable(t_s, &parts, &state.y) {
                return Err(Trouble::Blocked(error));
            }
            let [da, de, d] = self.increments(&parts, &state.y, x, a[0], hg * hg);
            a[0] += d;
            let (increments, moved) = Hanging::advance(&parts, &mut state.y, da, de);
            let followed = self.hanging.follow(&increments, &mut state.w);
            let scale = self.hanging.scale;
            let size = (hg * hg * d / scale.x)
                .abs()
                .max((hg * d / scale.v).abs())
                .max(moved / scale.w)
                .max(followed / scale.w);
            if size.is_nan() || moved > 0.5 || followed > 0.5 {
                return Err(Trouble::Diverged);
            }
            let contraction = &mut self.hanging.contraction;
            if iteration > 0 {
                *contraction = (size / last).clamp(1e-4, 0.9);
                if size > 2.0 * last {
                    return Err(Trouble::Diverged);
                }
            }
            last = size;
            if size * *contraction < stage.enough {
                state.v[0] = stage.star.v[0] + hg * a[0];
                state.x[0] = stage.star.x[0] + hg * state.v[0];
                return Ok([0.0; QUADRATURES]);
            }
        }
        Err(Trouble::Diverged)
    }

    fn next_break_s(&self, t_s: f64) -> f64 {
        self.voltage.next_break_s(t_s)
    }

    /// A film moves by less than 1 um a volt: a voltage to this accuracy is a position to the tolerance.
    fn z_scale(&self, _i: usize) -> f64 {
        1e6 * self.hanging.scale.x / self.hanging.scale.w
    }

    fn stuck(&self, t_s: f64, state: &State<1>) -> Error {
        Error::Stuck {
            at_s: t_s,
            position_m: [0.0, 0.0, -state.x[0]],
        }
    }
}

/// The inverse problem: x(t) given, the voltage is what is left.
struct Inverse<'a> {
    hanging: Hanging,
    track: SampleTrack<'a>,
}

impl Inverse<'_> {
    /// x and x'' at a time: the quintic through x, x', x'' of the samples around it.
    fn at(&self, t_s: f64) -> [f64; 2] {
        let track = &self.track;
        let last = track.x_m.len() - 1;
        let place = (t_s / track.step_s).clamp(0.0, last as f64);
        let i = (place as usize).min(last.saturating_sub(1));
        let (s, h) = (place - i as f64, track.step_s);
        let j = (i + 1).min(last);
        let (x0, x1) = (track.x_m[i], track.x_m[j]);
        let (v0, v1) = (track.velocity_m_s[i] * h, track.velocity_m_s[j] * h);
        let (a0, a1) = (track.acceleration_m_s2[i], track.acceleration_m_s2[j]);
        let (c0, c1) = (0.5 * a0 * h * h, 0.5 * a1 * h * h);
        let (d, e, f) = (x1 - x0 - v0 - c0, v1 - v0 - 2.0 * c0, c1 - c0);
        let p = 10.0 * d - 4.0 * e + f;
        let q = -15.0 * d + 7.0 * e - 2.0 * f;
        let r = 6.0 * d - 3.0 * e + f;
        let x = x0 + s * (v0 + s * (c0 + s * (p + s * (q + s * r))));
        let a = (2.0 * c0 + s * (6.0 * p + s * (12.0 * q + 20.0 * s * r))) / (h * h);
        [x, a]
    }

    /// One Newton pass: increments of the parts' ln lambda.
    fn pass(&self, films: &[Response; 3], y: &mut [f64], x: f64, a: f64) -> ([[f64; 2]; 3], f64) {
        let h = &self.hanging;
        let tension = h.sample.mass_kg * (GRAVITY_M_S2 - a);
        let side = Part::new(&films[1], y[ACTIVE_1], h.sections[1], 0.0, 2.0);
        let end = Part::new(&films[2], y[END_1], h.sections[2], 0.0, 2.0);
        let de = (tension - end.force) / end.stiffness;
        let da = (h.rest_length + x - h.length(y) - h.lengths[1] * y[END_1] * de)
            / (h.lengths[0] * y[ACTIVE_1]);
        // Active part: (sigma_1 - sigma_2)/lambda_1 section + F_side = F, because X = sigma_2.
        let [t11, t12, t21, t22] = films[0].tangent;
        let scale = h.sections[0] / y[ACTIVE_1];
        let net = films[0].sigma[0] - films[0].sigma[1];
        let wanted = tension - side.force - side.stiffness * da;
        let d2 = (wanted / scale - net - (t11 - t21 - net) * da) / (t12 - t22);
        let parts = [
            Part {
                free: d2,
                ..Part::default()
            },
            side,
            end,
        ];
        Hanging::advance(&parts, y, da, de)
    }

    /// phi^2 from X = sigma_2 = (eps/L3^2) phi^2 (lambda_1 lambda_2)^2.
    fn phi_squared(&self, films: &[Response; 3], y: &[f64]) -> f64 {
        let area = y[ACTIVE_1] * y[ACTIVE_2];
        films[0].sigma[1] / (self.hanging.maxwell * area * area)
    }

    /// Stretches at fixed branch states; returns phi^2.
    fn solve(&mut self, t_s: f64, w: &[Pack], y: &mut [f64]) -> Result<f64, Trouble<Error>> {
        let [x, a] = self.at(t_s);
        for _ in 0..30 {
            let mut films = self
                .hanging
                .films(t_s, y, w, None)
                .map_err(Trouble::Blocked)?;
            let (increments, size) = self.pass(&films, y, x, a);
            if size.is_nan() || size > 0.5 {
                return Err(Trouble::Diverged);
            }
            if size < QUADRATIC {
                let [d1, d2] = increments[0];
                let [_, _, t21, t22] = films[0].tangent;
                films[0].sigma[1] += t21 * d1 + t22 * d2;
                return Ok(self.phi_squared(&films, y));
            }
        }
        Err(Trouble::Diverged)
    }
}

impl System<0> for Inverse<'_> {
    type Error = Error;

    fn rates(
        &mut self,
        t_s: f64,
        _side: Side,
        state: &State<0>,
        rates: &mut Rates<0>,
    ) -> Result<[f64; QUADRATURES], Trouble<Error>> {
        self.solve(t_s, &state.w, &mut rates.y)?;
        rates.w.copy_from_slice(&self.hanging.scratch);
        Ok([0.0; QUADRATURES])
    }

    fn stage(
        &mut self,
        stage: &Stage<0>,
        state: &mut State<0>,
        _a: &mut [f64; 0],
    ) -> Result<[f64; QUADRATURES], Trouble<Error>> {
        let (t_s, hg) = (stage.t_s, stage.weight_s);
        let [x, a] = self.at(t_s);
        let mut last = f64::INFINITY;
        for iteration in 0..ITERATIONS {
            let films = self
                .hanging
                .films(t_s, &state.y, &state.w, Some((&stage.star.w, hg)))
                .map_err(Trouble::Blocked)?;
            let (increments, moved) = self.pass(&films, &mut state.y, x, a);
            let followed = self.hanging.follow(&increments, &mut state.w);
            let size = moved.max(followed) / self.hanging.scale.w;
            if size.is_nan() || moved > 0.5 || followed > 0.5 {
                return Err(Trouble::Diverged);
            }
            let contraction = &mut self.hanging.contraction;
            if iteration > 0 {
                *contraction = (size / last).clamp(1e-4, 0.9);
                if size > 2.0 * last {
                    return Err(Trouble::Diverged);
                }
            }
            last = size;
            if size * *contraction < stage.enough {
                return Ok([0.0; QUADRATURES]);
            }
        }
        Err(Trouble::Diverged)
    }

    fn next_break_s(&self, _t_s: f64) -> f64 {
        f64::INFINITY
    }

    fn stuck(&self, t_s: f64, _state: &State<0>) -> Error {
        Error::Stuck {
            at_s: t_s,
            position_m: [0.0, 0.0, -self.at(t_s)[0]],
        }
    }
}

fn stretches(y: &[f64]) -> Stretches {
    Stretches {
        active: [y[ACTIVE_1], y[ACTIVE_2]],
        side_2: y[SIDE_2],
        end: [y[END_1], y[END_2]],
    }
}

fn static_rest(
    sample: &HangingSample,
    film: &Film,
    phi_v: f64,
    loads: Option<Loads>,
) -> Result<(SampleRest, Vec<f64>), Error> {
    sample.check().map_err(Error::Refused)?;
    super::robot::check_film(film)?;
    let relaxed = Film {
        mu_pa: vec![film.mu_pa[0]],
        relaxation_time_s: Vec::new(),
        locking: film.locking,
    };
    let mut hanging = Hanging::new(sample, &relaxed, 1e-9);
    let start_s = loads.as_ref().map_or(0.0, |l| l.start_s);
    hanging.loads = loads;
    let w = [[[1.0; LANES]; 2]; 3];
    let mut y = vec![1.0; 5];
    let steps = 20;
    // Weight first, then the voltage.
    for step in 1..=2 * steps {
        let share_of_weight = (step as f64 / steps as f64).min(1.0);
        let share = (step as f64 / steps as f64 - 1.0).max(0.0);
        let phi = phi_v * share.sqrt();
        if step > steps && phi_v == 0.0 {
            break;
        }
        let mut done = false;
        let mut last = f64::INFINITY;
        for _ in 0..40 {
            let films = hanging.films(start_s, &y, &w, None)?;
            let load = share_of_weight * hanging.mass_kg() * GRAVITY_M_S2;
            let parts = match hanging.here {
                Some(_) => {
                    let (phi, slope) = hanging.held(&y, phi);
                    hanging.parts(&films, &y, share.sqrt() * phi, slope)
                }
                None => hanging.parts(&films, &y, phi, 2.0),
            };
            if let Some(error) = hanging.unstable(0.0, &parts, &y) {
                return Err(error);
            }
            let active = (load - parts[0].force - parts[1].force)
                / (parts[0].stiffness + parts[1].stiffness);
            let end = (load - parts[2].force) / parts[2].stiffness;
            let (_, size) = Hanging::advance(&parts, &mut y, active, end);
            if size.is_nan() || size > 0.9 {
                break;
            }
            if size < 1e-14 || (size < 1e-11 && size >= 0.5 * last) {
                done = true;
                break;
            }
            last = size;
        }
        if !done {
            return Err(Error::SampleUnstable {
                at_s: 0.0,
                length_m: hanging.length(&y),
                stiffness_n_m: f64::NAN,
            });
        }
    }
    let rest = SampleRest {
        length_m: hanging.length(&y),
        stretches: stretches(&y),
    };
    Ok((rest, y))
}

/// The sample at rest under its mass and `phi_v` (V), every branch relaxed.
///
/// # Errors
/// [`Error::SampleUnstable`] when the film gives way, [`Error::LockedPart`] at the locking stretch.
pub fn sample_rest(sample: &HangingSample, film: &Film, phi_v: f64) -> Result<SampleRest, Error> {
    static_rest(sample, film, phi_v, None).map(|r| r.0)
}

fn relaxed_state(hanging: &Hanging, y: &[f64]) -> Vec<Pack> {
    let n = hanging.packs;
    let mut w = vec![[[1.0; LANES]; 2]; 3 * n];
    for p in 0..3 {
        let squared = Hanging::squared(y, p);
        hanging.springs.relaxed(squared, &mut w[p * n..(p + 1) * n]);
    }
    w
}

/// Forward dynamics: x(t) of a sample that hangs at rest under the first voltage (channel 1 of `voltage`).
///
/// # Errors
/// [`Error`] says when: pull-in, a locked part, numbers that make no sense.
pub fn sample_motion(
    sample: &HangingSample,
    film: &Film,
    voltage: &dyn Voltage,
    options: &SampleOptions,
) -> Result<SampleMotion, Error> {
    motion_under(sample, film, voltage, options, None)
}

/// The same while `effects` are at work in a recording made at `when` (its `start_s` is that of `options`):
/// the laws of the catalogue along the course, which is run again with what they make of it until it stands
/// still.
///
/// # Errors
/// Those of [`sample_motion`]; a course that does not come to stand still.
pub fn sample_motion_with_effects(
    sample: &HangingSample,
    film: &Film,
    logged: &dyn Voltage,
    options: &SampleOptions,
    effects: &[Acting],
    when: When,
) -> Result<SampleMotion, Error> {
    let clocks = |a: &&Acting| a.effect.site() == Site::Clock;
    let (clocks, others): (Vec<&Acting>, Vec<&Acting>) = effects.iter().partition(clocks);
    let clocks: Vec<Acting> = clocks.into_iter().cloned().collect();
    let others: Vec<Acting> = others.into_iter().cloned().collect();
    let told = EffectClock::new(logged, &clocks, options.start_s);
    let voltage: &dyn Voltage = if clocks.is_empty() { logged } else { &told };
    if others.is_empty() {
        return sample_motion(sample, film, voltage, options);
    }
    let parts = (options.sample_step_s / CAUSES_STEP_S).ceil().max(1.0);
    let fine = SampleOptions {
        sample_step_s: options.sample_step_s / parts,
        ..*options
    };
    let mut motion = sample_motion(sample, film, voltage, &fine)?;
    let time_s = |i: usize| fine.start_s + i as f64 * fine.sample_step_s;
    let mut last = f64::NAN;
    for _ in 0..PASSES {
        let log = |s: &Stretches| [s.active[0].ln(), s.active[1].ln(), s.end[0].ln()];
        let course = SampleCourse {
            step_s: fine.sample_step_s,
            when,
            command_v: (0..motion.x_m.len())
                .map(|i| voltage.phi_v(time_s(i), Side::After)[0])
                .collect(),
            log_stretch: motion.stretches.iter().map(log).collect(),
            net_pa: std::mem::take(&mut motion.net_pa),
        };
        let loads = Loads {
            start_s: fine.start_s,
            step_s: fine.sample_step_s,
            list: sample_loads(sample, film, &others, &course),
        };
        let next = motion_under(sample, film, voltage, &fine, Some(loads))?;
        let moved = next.x_m.iter().zip(&motion.x_m).map(|(a, b)| (a - b).abs());
        let moved = moved.fold(0.0, f64::max);
        motion = next;
        if moved < STANDS_STILL_M {
            return Ok(every(motion, parts as usize, options.sample_step_s));
        }
        last = moved;
    }
    Err(Error::Refused(format!(
        "the course of the sample with these causes does not settle ({:.3} mm in the last pass): make them smaller",
        1e3 * last
    )))
}

/// Every `n`-th sample of a motion.
fn every(motion: SampleMotion, n: usize, sample_step_s: f64) -> SampleMotion {
    fn of<T>(list: Vec<T>, n: usize) -> Vec<T> {
        list.into_iter().step_by(n).collect()
    }
    SampleMotion {
        step_s: sample_step_s,
        x_m: of(motion.x_m, n),
        velocity_m_s: of(motion.velocity_m_s, n),
        acceleration_m_s2: of(motion.acceleration_m_s2, n),
        stretches: of(motion.stretches, n),
        phi_v: of(motion.phi_v, n),
        net_pa: of(motion.net_pa, n),
        ..motion
    }
}

fn motion_under(
    sample: &HangingSample,
    film: &Film,
    voltage: &dyn Voltage,
    options: &SampleOptions,
    loads: Option<Loads>,
) -> Result<SampleMotion, Error> {
    let positive = [
        options.sample_step_s,
        options.tolerance_m,
        options.longest_step_s,
    ];
    let count = (options.duration_s / options.sample_step_s + 1e-9).floor();
    if !positive.iter().all(|v| *v > 0.0 && v.is_finite()) || !(0.0..1e9).contains(&count) {
        let text =
            "sample step, tolerance and longest step must be positive, the duration not negative";
        return Err(Error::Refused(text.into()));
    }
    let samples = 1 + count as usize;
    let t0 = options.start_s;
    let first = loads.as_ref().map(|l| Loads {
        list: l.list[..1].to_vec(),
        ..*l
    });
    let (rest, y) = static_rest(sample, film, voltage.phi_v(t0, Side::After)[0], first)?;
    let mut hanging = Hanging::new(sample, film, options.tolerance_m);
    hanging.loads = loads;
    hanging.rest_length = rest.length_m;
    let state = State {
        x: [0.0],
        v: [0.0],
        w: relaxed_state(&hanging, &y),
        z: if hanging.time_constant_s > 0.0 {
            vec![voltage.phi_v(t0, Side::After)[0] * Hanging::area(&y)]
        } else {
            Vec::new()
        },
        y,
    };
    let control = Control {
        scale: hanging.scale,
        longest_s: options.longest_step_s,
        shortest_s: 1e-9,
        first_s: 1e-4_f64.min(options.longest_step_s),
    };
    let mut forward = Forward { hanging, voltage };
    let mut here = state.clone();
    let mut rates = Rates {
        a: [0.0],
        w: state.w.clone(),
        z: state.z.clone(),
        y: state.y.clone(),
    };
    let mut out = SampleMotion {
        start_s: t0,
        step_s: options.sample_step_s,
        rest_length_m: rest.length_m,
        x_m: Vec::with_capacity(samples),
        velocity_m_s: Vec::with_capacity(samples),
        acceleration_m_s2: Vec::with_capacity(samples),
        stretches: Vec::with_capacity(samples),
        phi_v: Vec::with_capacity(samples),
        net_pa: Vec::with_capacity(samples),
        effort: Effort::default(),
    };
    let end = t0 + (samples - 1) as f64 * options.sample_step_s;
    let mut integrator = Integrator::start(&mut forward, t0, state, control)?;
    for i in 0..samples {
        let t = t0 + i as f64 * options.sample_step_s;
        while integrator.time_s() < t {
            integrator.step(&mut forward, end)?;
        }
        let side = if i == 0 { Side::After } else { Side::Before };
        integrator.at(t, &mut here);
        rates.y.copy_from_slice(&here.y);
        match forward.rates(t, side, &here, &mut rates) {
            Ok(_) => {}
            Err(Trouble::Blocked(e) | Trouble::Fatal(e)) => return Err(e),
            Err(Trouble::Diverged) => return Err(forward.stuck(t, &here)),
        }
        out.x_m.push(here.x[0]);
        out.velocity_m_s.push(here.v[0]);
        out.acceleration_m_s2.push(rates.a[0]);
        out.stretches.push(stretches(&rates.y));
        let hanging = &forward.hanging;
        out.net_pa.push(hanging.net_pa);
        out.phi_v.push(match here.z.first() {
            Some(z) => z / Hanging::area(&rates.y),
            None => hanging.held(&rates.y, voltage.phi_v(t, side)[0]).0,
        });
    }
    out.effort = integrator.effort;
    Ok(out)
}

/// Inverse dynamics f_ID of the sample: phi^2 (V^2) on the film at each sample of x(t); negative where no
/// voltage gives that x. Between samples x is the quintic through x, x' and x''.
///
/// # Errors
/// [`Error`] says when: a locked part, an x that no stretch gives, lists of different lengths.
pub fn sample_phi_squared_v2(
    sample: &HangingSample,
    film: &Film,
    track: SampleTrack,
    tolerance_m: f64,
) -> Result<Vec<f64>, Error> {
    let samples = track.x_m.len();
    let (v, a) = (track.velocity_m_s.len(), track.acceleration_m_s2.len());
    if samples == 0 || v != samples || a != samples {
        let text = format!("{samples} positions, {v} velocities and {a} accelerations");
        return Err(Error::Refused(text));
    }
    if !(track.step_s > 0.0 && tolerance_m > 0.0) {
        return Err(Error::Refused("step and tolerance must be positive".into()));
    }
    let (rest, y) = static_rest(sample, film, track.rest_phi_v, None)?;
    let mut hanging = Hanging::new(sample, film, tolerance_m);
    hanging.rest_length = rest.length_m;
    let state = State {
        x: [],
        v: [],
        w: relaxed_state(&hanging, &y),
        z: Vec::new(),
        y,
    };
    let control = Control {
        scale: hanging.scale,
        longest_s: 10.0 * track.step_s,
        shortest_s: 1e-9,
        first_s: 0.1 * track.step_s,
    };
    let mut inverse = Inverse { hanging, track };
    let mut here = state.clone();
    let end = (samples - 1) as f64 * track.step_s;
    let mut integrator = Integrator::start(&mut inverse, 0.0, state, control)?;
    let mut out = Vec::with_capacity(samples);
    for i in 0..samples {
        let t = i as f64 * track.step_s;
        while integrator.time_s() < t {
            integrator.step(&mut inverse, end)?;
        }
        integrator.at(t, &mut here);
        let mut y = [0.0; 5];
        y.copy_from_slice(&here.y);
        match inverse.solve(t, &here.w, &mut y) {
            Ok(phi_squared) => out.push(phi_squared),
            Err(Trouble::Blocked(e) | Trouble::Fatal(e)) => return Err(e),
            Err(Trouble::Diverged) => return Err(inverse.stuck(t, &here)),
        }
    }
    Ok(out)
}
