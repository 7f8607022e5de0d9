//! Causes of the catalogue in forward dynamics, in the catalogue's own form, so that the inverse model with
//! the same cause finds its way back.
//!
//! | the cause acts on | becomes |
//! |---|---|
//! | voltage, capacitance, stress, torques, forces | an [`Addition`]: [`effect_addition`] |
//! | lengths | another robot: [`effect_robot`] |
//! | what the capture reads of the motion | another motion: [`effect_reading`] |
//! | the clock | another drive: [`EffectClock`] |
//!
//! [`motion_with_effects`] puts all of them together. Where a cause without memory is concerned the addition
//! calls the catalogue's own formula, one sample at a time; a cause with memory has states here, and its
//! formula is the differential equation that the catalogue solves in steps. A term that was learnt from
//! recordings brings both along ([`Learnt::rates`], [`Learnt::added`], [`Learnt::pull`]).

use std::ops::Range;

use super::Error;
use super::addition::{Action, Addition, Situation};
use super::robot::{Motion, Options, motion_as_far};
use super::voltage::{Side, Voltage};
use crate::effects::learnt::{Learnt, Place};
use crate::effects::{
    self, Acting, Along, Memory, Reading, Site, When, creep, flow, leak, resistance_ohm,
};
use crate::film::Film;
use crate::kinematics::Vec3;
use crate::model::{Parameters, Robot, others};
use crate::units::{GRAVITY_M_S2, VACUUM_PERMITTIVITY_F_M};

/// Charge of which a state counts one, C.
const NANOCOULOMB: f64 = 1e-9;
/// Times within which what has no inertia of its own follows, s: a clamped rate, a largest energy, an
/// acceleration.
const SLEW_S: f64 = 2e-4;
const LARGEST_S: f64 = 2e-4;
const PLAY_S: f64 = 2e-4;
const INERTIA_S: f64 = 2e-3;
/// The slow share's time over the fast one's, as in the catalogue.
const SLOWER: f64 = 15.0;
/// Steps in which a slow branch is followed from the assembly to the first sample, s.
const REST_STEP_S: f64 = 5.0;

/// What an addition remembers of a cause.
fn memory(acting: &Acting) -> Memory<'static> {
    match acting.effect.memory() {
        // without a wire the film is charged at once
        Memory::Charge if acting.value("resistance").is_none_or(|r| r <= 0.0) => Memory::None,
        memory => memory,
    }
}

/// Typical sizes of the states of a chain.
fn sizes(memory: Memory) -> Vec<f64> {
    match memory {
        Memory::None => Vec::new(),
        Memory::Charge => vec![3000.0],
        Memory::Polarisation => vec![1000.0; 2],
        Memory::Output => vec![1000.0],
        Memory::Presliding => vec![1.0],
        Memory::LargestEnergy => vec![1e5],
        Memory::Branch | Memory::Flow | Memory::Play => vec![1.0; 2],
        Memory::HeldOff => vec![100.0],
        Memory::Rest => vec![1e6],
        Memory::BicepRate | Memory::Velocity => vec![1.0],
        Memory::Learnt(learnt) => learnt.form.state_sizes(),
    }
}

/// A cause at work in forward dynamics.
struct Part {
    acting: Acting,
    memory: Memory<'static>,
    /// Typical sizes of the states of a chain.
    sizes: Vec<f64>,
    /// Every size at its off value.
    off: bool,
}

impl Part {
    fn new(acting: &Acting) -> Self {
        let off = is_off(acting);
        let memory = if off { Memory::None } else { memory(acting) };
        Part {
            acting: acting.clone(),
            memory,
            sizes: sizes(memory),
            off,
        }
    }
}

/// Causes at work in forward dynamics, together: the electrical ones one after the other from the amplifier
/// to the film, then what they change of the capacitance, of the film's stress and of the balance.
struct EffectAddition {
    parts: Vec<Part>,
    robot: Robot,
    film: Film,
    when: When,
}

/// The catalogue's cause as an addition to the forward dynamics of `robot` with `parameters`, in a recording
/// made at `when`, whose `start_s` is the time of the first sample. Several causes go together through
/// [`motion_with_effects`].
///
/// # Errors
/// A sentence for causes that act on lengths, the reading or the clock, saying which function does them.
pub fn effect_addition(
    acting: &Acting,
    robot: &Robot,
    parameters: &Parameters,
    when: When,
) -> Result<Box<dyn Addition>, String> {
    let id = acting.effect.id();
    match acting.effect.site() {
        Site::Motion if acting.is_of_capture() => Err(format!(
            "{id} changes what is read of the motion, not the motion: see effect_reading"
        )),
        Site::Motion => Err(format!(
            "{id} changes the robot, not what acts on it: see effect_robot"
        )),
        Site::Clock => Err(format!(
            "{id} changes the clock of the drive: see EffectClock"
        )),
        _ => Ok(Box::new(EffectAddition {
            parts: vec![Part::new(acting)],
            robot: robot.clone(),
            film: parameters.film.clone(),
            when,
        })),
    }
}

/// What a capture reads of `robot`, whose log of voltages says `logged`, while `effects` are at work in a
/// recording made at `when` (its `start_s` is that of `options`): as [`motion_as_far`], and without effects
/// the same to the bit. Electrical causes act in their order, from the amplifier to the film; `pivot_m` is
/// the point about which the capture's axes turn.
///
/// # Errors
/// Those of [`motion_as_far`].
pub fn motion_with_effects(
    robot: &Robot,
    parameters: &Parameters,
    logged: &dyn Voltage,
    options: &Options,
    effects: &[Acting],
    when: When,
    pivot_m: Vec3,
) -> Result<(Motion, Option<Error>), Error> {
    let of = |sites: &'static [Site]| {
        let at = move |a: &&Acting| sites.contains(&a.effect.site());
        effects.iter().filter(at)
    };
    let robot = of(&[Site::Motion]).fold(robot.clone(), |r, a| effect_robot(a, &r));
    let parts: Vec<Part> = of(&[Site::Electrical, Site::Film, Site::Balance])
        .map(Part::new)
        .collect();
    let together = EffectAddition {
        parts,
        robot: robot.clone(),
        film: parameters.film.clone(),
        when,
    };
    let mut additions: Vec<&dyn Addition> = Vec::new();
    if !together.parts.is_empty() {
        additions.push(&together);
    }
    let clocks: Vec<Acting> = of(&[Site::Clock]).cloned().collect();
    let told = EffectClock::new(logged, &clocks, options.start_s);
    let voltage: &dyn Voltage = if clocks.is_empty() { logged } else { &told };
    let (motion, ended) = motion_as_far(&robot, parameters, voltage, options, &additions)?;
    let read = of(&[Site::Motion]).fold(motion, |m, a| effect_reading(a, &m, pivot_m));
    Ok((read, ended))
}

fn is_off(acting: &Acting) -> bool {
    let quantities = acting.effect.parameters().iter();
    quantities
        .zip(&acting.values)
        .all(|(q, v)| !q.size || *v == q.off)
}

/// The robot with the lengths that a cause gives it; the same robot where it gives none.
pub fn effect_robot(acting: &Acting, robot: &Robot) -> Robot {
    let mut out = robot.clone();
    acting.effect.geometry(
        &acting.values,
        acting.on,
        &mut out.mechanism,
        &mut out.lozenges,
    );
    out
}

/// What a capture with the cause reads of `motion`, such that the catalogue's correction gives the motion
/// back. `pivot_m` is the point about which the capture's axes turn.
pub fn effect_reading(acting: &Acting, motion: &Motion, pivot_m: Vec3) -> Motion {
    let mut out = motion.clone();
    acting.effect.captured(
        &acting.values,
        &mut Reading {
            step_s: motion.step_s,
            pivot_m,
            position_m: &mut out.position_m,
            velocity_m_s: &mut out.velocity_m_s,
            acceleration_m_s2: &mut out.acceleration_m_s2,
        },
    );
    out
}

/// The drive that the robot really gets when `logged` is what the log says and causes on the clock are at
/// work: the log at the time that the catalogue would read.
pub struct EffectClock<'a> {
    logged: &'a dyn Voltage,
    start_s: f64,
    shift_s: f64,
    rate: f64,
}

impl<'a> EffectClock<'a> {
    /// The drive of a recording whose first sample is at `start_s`.
    pub fn new(logged: &'a dyn Voltage, effects: &[Acting], start_s: f64) -> Self {
        let read = |t: f64| effects.iter().fold(t, |t, a| a.effect.clock(&a.values, t));
        EffectClock {
            logged,
            start_s,
            shift_s: read(0.0),
            rate: read(1.0) - read(0.0),
        }
    }
}

impl Voltage for EffectClock<'_> {
    fn phi_v(&self, t_s: f64, side: Side) -> [f64; 3] {
        let t = self.start_s + self.shift_s + self.rate * (t_s - self.start_s);
        self.logged.phi_v(t, side)
    }
    fn next_break_s(&self, t_s: f64) -> f64 {
        let t = self.start_s + self.shift_s + self.rate * (t_s - self.start_s);
        let next = self.logged.next_break_s(t);
        let back = self.start_s + (next - self.start_s - self.shift_s) / self.rate;
        // Rounding must not give the same break again.
        if back > t_s {
            back
        } else {
            t_s + 1e-12 * t_s.abs().max(1.0)
        }
    }
}

impl EffectAddition {
    /// Chain `k` at this moment, as the catalogue sees it: one sample. The lever is 1, so that a torque on
    /// theta_b comes out as such.
    fn along<'a>(&'a self, s: &Situation, k: usize, sample: &'a Sample) -> Along<'a> {
        Along {
            step_s: 1.0,
            when: When {
                recording: self.when.recording,
                series_s: self.when.series_s + s.t_s - self.when.start_s,
                start_s: s.t_s,
            },
            lozenge: &self.robot.lozenges[k],
            eps_f_m: self.robot.eps_r * VACUUM_PERMITTIVITY_F_M,
            bicep_m: self.robot.mechanism.chains[k].bicep_m,
            theta_dea_rad: &sample.theta_dea,
            area_stretch: &sample.area_stretch,
            theta_b: &sample.theta_b,
            bicep_lever: &[1.0],
            force_lever: &[[0.0; 3]],
            acceleration_m_s2: &[[0.0; 3]],
            position_m: &sample.position,
            velocity_m_s: &sample.velocity,
            others_v: [&sample.others[..1], &sample.others[1..]],
        }
    }

    /// Stress of the equilibrium spring, Pa, and its energy density, J/m^3.
    fn equilibrium(&self, l: [f64; 2]) -> ([f64; 2], f64) {
        let [a, b] = l.map(|l| l * l);
        let c = 1.0 / (a * b);
        let d = (1.0 - (a + b + c - 3.0) / self.film.locking).max(1e-9);
        let mu = self.film.mu_pa[0];
        (
            [mu * (a - c) / d, mu * (b - c) / d],
            -0.5 * mu * self.film.locking * d.ln(),
        )
    }
}

/// lambda_1^2, lambda_2^2.
fn squared(stretch: [f64; 2]) -> [f64; 2] {
    stretch.map(|l| l * l)
}

/// What one chain has at one moment: theta_DEA, theta_b with its derivatives, the effector's position and
/// velocity, what the next and the previous actuator are told.
struct Sample {
    theta_dea: [f64; 1],
    area_stretch: [f64; 1],
    theta_b: [[f64; 3]; 1],
    position: [Vec3; 1],
    velocity: [Vec3; 1],
    others: [f64; 2],
}

impl Sample {
    fn of(s: &Situation, k: usize) -> Self {
        Sample {
            theta_dea: [s.theta_dea_rad[k]],
            area_stretch: [s.stretch[k][0] * s.stretch[k][1]],
            theta_b: [[s.theta_b_rad[k], s.theta_b_rate_rad_s[k], 0.0]],
            position: [s.position_m],
            velocity: [s.velocity_m_s],
            others: others(k, s.command_v),
        }
    }
}

impl EffectAddition {
    /// Each part with the place of its first state.
    fn places(&self) -> impl Iterator<Item = (usize, &Part)> {
        let mut next = 0;
        self.parts.iter().map(move |part| {
            let place = next;
            next += 3 * part.sizes.len();
            (place, part)
        })
    }

    /// What acts on a chain, with the range of its states.
    fn here(&self, k: usize) -> impl Iterator<Item = (&Part, Range<usize>)> {
        self.places()
            .filter(move |(_, part)| !part.off && part.acting.on[k])
            .map(move |(place, part)| {
                let n = part.sizes.len();
                let first = place + k * n;
                (part, first..first + n)
            })
    }

    /// What acts on a chain at one site.
    fn at_site(&self, k: usize, site: Site) -> impl Iterator<Item = (&Part, Range<usize>)> {
        self.here(k)
            .filter(move |(part, _)| part.acting.effect.site() == site)
    }

    /// The torque of a changed capacitance.
    fn capacitance(&self, chain: &Chain, action: &mut Action) {
        let (k, along) = (chain.k, &chain.along);
        let theta = chain.s.theta_dea_rad[k];
        let plain = along.lozenge.half_capacitance_slope(theta, along.eps_f_m);
        let mut half = [plain];
        for (part, _) in self.here(k) {
            let v = &part.acting.values;
            part.acting.effect.capacitance(v, along, &mut half);
        }
        if half[0] != plain {
            let phi = action.phi_v[k];
            action.torque_dea_n_m[k] += (half[0] - plain) * phi * phi;
        }
    }

    /// What causes make of the film's stress.
    fn film(&self, chain: &Chain, states: &[f64], action: &mut Action, rates: &mut [f64]) {
        let (s, k, along) = (chain.s, chain.k, chain.along);
        let phi = action.phi_v[k];
        let mut factor = [[1.0; 2]];
        for (part, range) in self.at_site(k, Site::Film) {
            let (z, rate) = (&states[range.clone()], &mut rates[range]);
            let (v, effect) = (&part.acting.values[..], part.acting.effect);
            match part.memory {
                Memory::LargestEnergy => {
                    let energy = self.equilibrium(s.stretch[k]).1;
                    rate[0] = (energy - z[0]).max(0.0) / LARGEST_S;
                    factor[0][0] *= softened(v, energy, z[0].max(energy));
                }
                Memory::Rest => {
                    // The first value of the series is the one at rest.
                    let theta = [along.theta_dea_rad[0]; 2];
                    let area_stretch = [along.area_stretch[0]; 2];
                    let along = Along {
                        theta_dea_rad: &theta,
                        area_stretch: &area_stretch,
                        ..along
                    };
                    let sigma = [z[0], s.film_stress_pa[k][1]];
                    let mut change = [0.0; 2];
                    effect.slack(v, &along, &sigma, &[phi; 2], &mut change);
                    action.torque_dea_n_m[k] -= chain.volume * change[1] * chain.slopes[1];
                }
                _ => effect.stress(v, &along, &self.film, &mut factor),
            }
        }
        let [equilibrium, branches] = factor[0];
        if branches != 1.0 {
            action.torque_dea_n_m[k] += (1.0 - branches) * chain.torque(s.film_stress_pa[k]);
        }
        if equilibrium != branches {
            let own = chain.torque(self.equilibrium(s.stretch[k]).0);
            action.torque_dea_n_m[k] += (branches - equilibrium) * own;
        }
    }
}

/// One chain at one moment, as causes act on it.
struct Chain<'b> {
    s: &'b Situation,
    k: usize,
    along: Along<'b>,
    /// Slopes of ln lambda_1, ln lambda_2 by theta_DEA, and the film's volume, m^3.
    slopes: [f64; 2],
    volume: f64,
}

impl Chain<'_> {
    /// Torque of a stress of the film on the lozenge, N m.
    fn torque(&self, stress: [f64; 2]) -> f64 {
        self.volume * (stress[0] * self.slopes[0] + stress[1] * self.slopes[1])
    }

    /// What a cause makes of the voltage, and the rates of its states.
    fn electrical(&self, part: &Part, z: &[f64], rate: &mut [f64], action: &mut Action) {
        let (s, k, along) = (self.s, self.k, &self.along);
        let v = &part.acting.values[..];
        let told = action.phi_v[k];
        action.phi_v[k] = match part.memory {
            Memory::Charge => {
                let phi = z[0] * NANOCOULOMB / s.capacitance_f[k];
                let (ohm, leak) = match v {
                    [_, _, wire] => (*wire, leak(v, along, 0, phi)),
                    _ => (resistance_ohm(v, along.area_stretch[0]), 0.0),
                };
                rate[0] = (told - phi * (1.0 + leak)) / ohm / NANOCOULOMB;
                phi
            }
            Memory::Polarisation => {
                for (j, time) in [v[1], SLOWER * v[1]].into_iter().enumerate() {
                    rate[j] = (told - z[j]) / time;
                }
                let square =
                    (1.0 - v[0] - v[2]) * told * told + v[0] * z[0] * z[0] + v[2] * z[1] * z[1];
                square.max(0.0).sqrt()
            }
            Memory::HeldOff => {
                rate[0] = (v[0] * told - z[0]) / v[1];
                told - z[0]
            }
            Memory::Output => {
                let sign = if told == 0.0 {
                    z[0].signum()
                } else {
                    told.signum()
                };
                let wanted = sign * (told - z[0]) / SLEW_S;
                rate[0] = sign * wanted.clamp(-v[1], v[0]);
                z[0]
            }
            Memory::Learnt(learnt) => {
                learnt.rates(along, s.theta_dea_rate_rad_s[k], told, z, rate);
                Learnt::raised(told, learnt.added(v, along, told, z))
            }
            _ => {
                let mut phi = [told];
                part.acting.effect.voltage(v, along, &mut phi);
                phi[0]
            }
        };
    }

    /// Forces and torques of a cause, and the rates of its states.
    fn balance(&self, part: &Part, z: &[f64], rate: &mut [f64], action: &mut Action) {
        let (s, k, along) = (self.s, self.k, &self.along);
        let v = &part.acting.values[..];
        match part.memory {
            Memory::Presliding => {
                let omega = s.theta_b_rate_rad_s[k];
                let level = effects::friction_level(v[2], omega);
                rate[0] = (omega - z[0] * omega.abs() / level) / v[1];
                action.torque_b_n_m[k] -= v[0] * z[0];
            }
            Memory::BicepRate => {
                rate[0] = (s.theta_b_rate_rad_s[k] - z[0]) / INERTIA_S;
                let weight = GRAVITY_M_S2 * s.theta_b_rad[k].sin();
                action.torque_b_n_m[k] -= v[0] * (along.bicep_m * rate[0] - weight);
            }
            Memory::Velocity => {
                rate[0] = (s.velocity_m_s[k] - z[0]) / INERTIA_S;
                if along.after(0, v[2], v[1]) {
                    let weight = if k == 2 { GRAVITY_M_S2 } else { 0.0 };
                    action.force_n[k] -= v[0] * (rate[0] + weight);
                }
            }
            Memory::Branch => {
                let (own, stress) = creep(v[1], squared(s.stretch[k]), [z[0], z[1]]);
                rate.copy_from_slice(&own);
                action.torque_dea_n_m[k] -= v[0] * self.torque(stress);
            }
            Memory::Flow => {
                let (own, stress, _) = flow(v, squared(s.stretch[k]), [z[0], z[1]]);
                rate.copy_from_slice(&own);
                action.torque_dea_n_m[k] -= v[0] * self.torque(stress);
            }
            Memory::Play => {
                let ahead = s.theta_b_rad[k] - z[0];
                let pushed = (ahead - v[1]).max(0.0) + (ahead + v[1]).min(0.0);
                rate[0] = pushed / PLAY_S;
                action.torque_b_n_m[k] -= v[0] * (z[0] - z[1]);
            }
            Memory::Learnt(learnt) if learnt.form.is_force() => {
                let pull = learnt.pull(v, along, k, z, rate);
                action.force_n = [0, 1, 2].map(|i| action.force_n[i] + pull[i]);
            }
            Memory::Learnt(learnt) => {
                learnt.rates(along, s.theta_dea_rate_rad_s[k], 0.0, z, rate);
                let made = learnt.added(v, along, 0.0, z);
                let on_bicep = matches!(learnt.place, Place::Bicep | Place::Series);
                self.turn(on_bicep, made, action);
            }
            _ => self.without_memory(part, action),
        }
    }

    /// Adds a torque on the bicep, or else on the lozenge.
    fn turn(&self, on_bicep: bool, torque: f64, action: &mut Action) {
        if on_bicep {
            action.torque_b_n_m[self.k] += torque;
        } else {
            action.torque_dea_n_m[self.k] += torque;
        }
    }

    /// The torque of the catalogue's own formula.
    fn without_memory(&self, part: &Part, action: &mut Action) {
        let (s, k) = (self.s, self.k);
        let (v, effect) = (&part.acting.values, part.acting.effect);
        let on_bicep = effect.part(v) == effects::Part::BicepJoint;
        let mut made = [0.0];
        // The lever is 1 here: what turns the lozenge is given the rate of that one.
        let rate = [[s.theta_b_rad[k], s.theta_dea_rate_rad_s[k], 0.0]];
        let along = match on_bicep {
            true => self.along,
            false => Along {
                theta_b: &rate,
                ..self.along
            },
        };
        effect.torque(v, &along, &mut made);
        self.turn(on_bicep, made[0], action);
    }
}

impl Addition for EffectAddition {
    fn states(&self) -> usize {
        self.parts.iter().map(|p| 3 * p.sizes.len()).sum()
    }

    fn start(&self, s: &Situation, states: &mut [f64]) {
        // What the electrical chain makes of the command before this part.
        let mut told = s.command_v;
        for (place, part) in self.places() {
            let n = part.sizes.len();
            for k in 0..3 {
                let sample = Sample::of(s, k);
                let along = self.along(s, k, &sample);
                let z = &mut states[place + k * n..place + (k + 1) * n];
                match part.memory {
                    Memory::Charge => z[0] = s.capacitance_f[k] * told[k] / NANOCOULOMB,
                    Memory::Polarisation => z.fill(told[k]),
                    Memory::Output => z[0] = told[k],
                    Memory::LargestEnergy => z[0] = self.equilibrium(s.stretch[k]).1,
                    Memory::Rest => z[0] = s.film_stress_pa[k][1],
                    Memory::BicepRate => z[0] = s.theta_b_rate_rad_s[k],
                    Memory::Velocity => z[0] = s.velocity_m_s[k],
                    Memory::Branch => {
                        let v = &part.acting.values;
                        let rest_s = v[2] + self.when.series_s;
                        let steps = (rest_s / REST_STEP_S).ceil().max(1.0);
                        let mut x = [0.0; 2];
                        for _ in 0..steps as usize {
                            let rate = creep(v[1], squared(s.stretch[k]), x).0;
                            x = [0, 1].map(|i| x[i] + rate[i] * rest_s / steps);
                        }
                        z.copy_from_slice(&x);
                    }
                    Memory::Flow => z.copy_from_slice(&s.stretch[k].map(f64::ln)),
                    Memory::Play => z.fill(s.theta_b_rad[k]),
                    Memory::Learnt(learnt) => learnt.start(&along, told[k], z),
                    Memory::HeldOff | Memory::Presliding | Memory::None => z.fill(0.0),
                }
                if part.off || !part.acting.on[k] || part.acting.effect.site() != Site::Electrical {
                    continue;
                }
                let v = &part.acting.values;
                match part.memory {
                    Memory::Learnt(learnt) => {
                        told[k] = Learnt::raised(told[k], learnt.added(v, &along, told[k], z));
                    }
                    Memory::None => {
                        let mut phi = [told[k]];
                        part.acting.effect.voltage(v, &along, &mut phi);
                        told[k] = phi[0];
                    }
                    // At rest these give what they are told.
                    _ => {}
                }
            }
        }
    }

    fn scale(&self, i: usize) -> f64 {
        let last = self.places().filter(|(place, _)| *place <= i).last();
        last.map_or(1.0, |(place, part)| {
            part.sizes[(i - place) % part.sizes.len()]
        })
    }

    fn act(&self, s: &Situation, states: &[f64], action: &mut Action, rates: &mut [f64]) {
        rates.fill(0.0);
        if self.parts.iter().all(|p| p.off) {
            return;
        }
        for k in 0..3 {
            let sample = Sample::of(s, k);
            let along = self.along(s, k, &sample);
            let chain = Chain {
                s,
                k,
                along,
                slopes: along.lozenge.log_stretch_slopes(s.theta_dea_rad[k]),
                volume: along.lozenge.volume_m3(),
            };
            for (part, range) in self.at_site(k, Site::Electrical) {
                chain.electrical(part, &states[range.clone()], &mut rates[range], action);
            }
            self.capacitance(&chain, action);
            self.film(&chain, states, action, rates);
            for (part, range) in self.at_site(k, Site::Balance) {
                chain.balance(part, &states[range.clone()], &mut rates[range], action);
            }
        }
    }

    fn next_break_s(&self, t_s: f64) -> f64 {
        let moment = |part: &Part| {
            let (time, number) = (part.acting.value("time")?, part.acting.value("recording")?);
            (number == self.when.recording as f64 && time > t_s).then_some(time)
        };
        let moments = self.parts.iter().filter_map(moment);
        moments.fold(f64::INFINITY, f64::min)
    }
}

/// 1 - r erf((W_max - W)/m), with erf to rounding error (its series, and its continued fraction).
fn softened(v: &[f64], energy: f64, largest: f64) -> f64 {
    let x = (largest - energy) / v[1];
    let erf = if x < 2.5 {
        let (mut term, mut sum) = (x, x);
        for n in 1..60 {
            term *= -x * x / n as f64;
            sum += term / (2 * n + 1) as f64;
        }
        sum * std::f64::consts::FRAC_2_SQRT_PI
    } else {
        let mut tail = 0.0;
        for n in (1..60).rev() {
            tail = 0.5 * n as f64 / (x + tail);
        }
        1.0 - (-x * x).exp() / ((x + tail) * std::f64::consts::PI.sqrt())
    };
    1.0 - v[0] * erf
}
