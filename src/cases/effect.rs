//! What a left-out cause does to a series of recordings, and what is known when it is drawn.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::dice::Dice;
use super::truth::Detail;
use crate::kinematics::{ChainPose, Lozenge, Vec3};
use crate::model::{Parameters, Robot};
use crate::simulate::write::Placement;
use crate::simulate::{Action, Addition, Situation};
use crate::units::VACUUM_PERMITTIVITY_F_M;

/// One recording's place in its series.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// "01-symmetric".
    pub name: String,
    /// Whether it is for training.
    pub train: bool,
    /// Time since the series began, s.
    pub start_s: f64,
    /// Its length, s.
    pub duration_s: f64,
}

/// What is known when an effect is drawn.
pub struct Setting<'a> {
    /// The robot without the effect.
    pub robot: &'a Robot,
    /// Film and forearm.
    pub parameters: &'a Parameters,
    /// Where the robot rests at 0 V, m.
    pub rest_m: Vec3,
    /// Its chains there.
    pub rest: [ChainPose; 3],
    /// The series.
    pub slots: &'a [Slot],
    /// Highest voltage of the drives, V.
    pub peak_v: f64,
}

/// Draws an effect: its strength, and randomness for everything else.
pub struct Draw<'a> {
    /// Randomness.
    pub dice: Dice,
    /// 0 barely visible to 1 strong.
    pub strength: f64,
    /// Off: sizes are zero, whatever the strength.
    pub off: bool,
    /// The rest of the case.
    pub setting: Setting<'a>,
}

/// Where an addition stands in the chain of actions: the amplifier first, then wires, then film.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Order {
    /// Between command and output of the amplifier.
    Amplifier,
    /// Between amplifier and film.
    Wire,
    /// Anything that sees the voltage on the film.
    Film,
}

type Alter = dyn Fn(usize, &mut Robot, &mut Parameters) + Send + Sync;
type Act = dyn Fn(usize) -> Option<Hook> + Send + Sync;
type Mass = dyn Fn(usize) -> Steps + Send + Sync;

/// (time s, mass kg added to what is stated), from the first sample on; a value holds until the next.
pub type Steps = Vec<(f64, f64)>;

/// Second-order low-pass of the capture system and a pure delay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// Natural angular frequency, rad/s.
    pub omega_rad_s: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Pure delay, s.
    pub delay_s: f64,
}

/// One left-out cause. What it does in a recording is a function of the recording's index in the series.
pub struct Effect {
    /// What the answer says.
    pub detail: Detail,
    /// Where its addition stands.
    pub order: Order,
    /// Another robot, film or forearm.
    pub alter: Option<Box<Alter>>,
    /// Torques, forces and voltages.
    pub act: Option<Box<Act>>,
    /// A mass that is not stated.
    pub mass: Option<Box<Mass>>,
    /// Markers and axes that are not where they are stated to be.
    pub placement: Placement,
    /// Voltage-file time = offset + (1 + skew) true time.
    pub clock: (f64, f64),
    /// The capture's own dynamics.
    pub lag: Option<Lag>,
}

impl Effect {
    /// An effect that does nothing yet.
    pub fn new(id: &str, strength: f64, on: [bool; 3]) -> Self {
        let actuators = (1..=3).filter(|k| on[k - 1]).collect();
        let mut out = Effect {
            detail: Detail {
                effect: id.into(),
                strength,
                actuators,
                parameters: BTreeMap::new(),
                form: BTreeMap::new(),
                place: Vec::new(),
            },
            order: Order::Film,
            alter: None,
            act: None,
            mass: None,
            placement: Placement::default(),
            clock: (0.0, 0.0),
            lag: None,
        };
        if out.detail.actuators.len() == 3 {
            out.at(json!({"dimension": "actuator", "value": "all"}));
        } else {
            out.at(json!({"dimension": "actuator", "value": out.detail.actuators.clone()}));
        }
        out
    }

    /// Says where it shows.
    pub fn at(&mut self, place: Value) {
        self.detail.place.push(place);
    }

    /// Says where it shows, in words.
    pub fn note(&mut self, dimension: &str, note: &str) {
        self.at(json!({"dimension": dimension, "note": note}));
    }

    /// A parameter with the name that effects have in parameter files.
    pub fn parameter(&mut self, name: &str, value: impl Into<Value>) {
        self.detail.parameters.insert(name.into(), value.into());
    }

    /// A number of the form that was simulated.
    pub fn form(&mut self, name: &str, value: impl Into<Value>) {
        self.detail.form.insert(name.into(), value.into());
    }

    /// Acts alike in every recording.
    pub fn always(&mut self, make: impl Fn() -> Hook + Send + Sync + 'static) {
        self.act = Some(Box::new(move |_| Some(make())));
    }
}

impl Draw<'_> {
    /// A size between `weak` (strength 0) and `strong` (strength 1), uniform in the logarithm; 0 when off.
    pub fn size(&self, weak: f64, strong: f64) -> f64 {
        if self.off {
            0.0
        } else {
            weak * (strong / weak).powf(self.strength)
        }
    }

    /// All actuators, or one of them with probability `p`.
    pub fn actuators(&mut self, p: f64) -> [bool; 3] {
        if self.dice.chance(p) {
            self.one()
        } else {
            [true; 3]
        }
    }

    /// One actuator.
    pub fn one(&mut self) -> [bool; 3] {
        let k = self.dice.below(3);
        [0, 1, 2].map(|i| i == k)
    }

    /// Begins an effect.
    pub fn effect(&self, id: &str, on: [bool; 3]) -> Effect {
        Effect::new(id, self.strength, on)
    }

    /// Film of the first chain.
    pub fn lozenge(&self) -> Lozenge {
        self.setting.robot.lozenges[0]
    }

    /// eps, F/m.
    pub fn eps_f_m(&self) -> f64 {
        self.setting.robot.eps_r * VACUUM_PERMITTIVITY_F_M
    }

    /// An instant within the training recordings, not near an end: recording index, and time in it, s.
    pub fn instant(&mut self) -> (usize, f64) {
        let trained = self.setting.slots.iter().filter(|s| s.train).count();
        let index = self.dice.below(trained);
        let share = self.dice.range(0.2, 0.8);
        (index, share * self.setting.slots[index].duration_s)
    }
}

/// 1 where an actuator is meant, 0 elsewhere.
pub fn mask(on: [bool; 3]) -> [f64; 3] {
    on.map(|on| if on { 1.0 } else { 0.0 })
}

/// Smooth step from 0 to 1 within 0 to 1.
pub fn smooth(f: f64) -> f64 {
    let f = f.clamp(0.0, 1.0);
    f * f * f * (10.0 - 15.0 * f + 6.0 * f * f)
}

/// Smooth max(x, 0) with an edge of width `w`.
pub fn soft_positive(x: f64, w: f64) -> f64 {
    if x > 30.0 * w {
        x
    } else {
        w * (x / w).exp().ln_1p()
    }
}

/// Torque on theta_DEA of Cauchy stresses in the film, N m, positive where it opens the angle's work: n_f L1
/// L2 L3 sum sigma_i d ln lambda_i/d theta.
pub fn film_torque(lozenge: &Lozenge, theta_dea_rad: f64, sigma: [f64; 2]) -> f64 {
    let [g1, g2] = lozenge.log_stretch_slopes(theta_dea_rad);
    lozenge.volume_m3() * (sigma[0] * g1 + sigma[1] * g2)
}

/// 1/2 dC/d theta_DEA, N m/V^2: C goes as sin^2 theta.
pub fn half_slope(situation: &Situation, k: usize) -> f64 {
    situation.capacitance_f[k] / situation.theta_dea_rad[k].tan()
}

type StartState = dyn Fn(&Situation, &mut [f64]) + Send + Sync;
type ActState = dyn Fn(&Situation, &[f64], &mut Action, &mut [f64]) + Send + Sync;

/// An addition made of functions.
pub struct Hook {
    states: usize,
    scale: f64,
    start: Box<StartState>,
    act: Box<ActState>,
    breaks_s: Vec<f64>,
}

impl Hook {
    /// One without states.
    pub fn plain(act: impl Fn(&Situation, &mut Action) + Send + Sync + 'static) -> Self {
        Hook {
            states: 0,
            scale: 1.0,
            start: Box::new(|_, _| {}),
            act: Box::new(move |s, _, action, _| act(s, action)),
            breaks_s: Vec::new(),
        }
    }

    /// One with `states` states of typical size `scale`.
    pub fn with_states(
        states: usize,
        scale: f64,
        start: impl Fn(&Situation, &mut [f64]) + Send + Sync + 'static,
        act: impl Fn(&Situation, &[f64], &mut Action, &mut [f64]) + Send + Sync + 'static,
    ) -> Self {
        Hook {
            states,
            scale,
            start: Box::new(start),
            act: Box::new(act),
            breaks_s: Vec::new(),
        }
    }

    /// No step crosses these times.
    pub fn breaking_at(mut self, times_s: Vec<f64>) -> Self {
        self.breaks_s = times_s;
        self
    }
}

impl Addition for Hook {
    fn states(&self) -> usize {
        self.states
    }
    fn start(&self, situation: &Situation, states: &mut [f64]) {
        (self.start)(situation, states);
    }
    fn scale(&self, _i: usize) -> f64 {
        self.scale
    }
    fn act(&self, situation: &Situation, states: &[f64], action: &mut Action, rates: &mut [f64]) {
        (self.act)(situation, states, action, rates);
    }
    fn next_break_s(&self, t_s: f64) -> f64 {
        let later = self.breaks_s.iter().filter(|b| **b > t_s + 1e-9);
        later.fold(f64::INFINITY, |m, b| m.min(*b))
    }
}
