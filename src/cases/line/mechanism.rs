//! What a left-out cause does to a single coordinate, and what is known when it is drawn.

use std::collections::BTreeMap;

use super::super::dice::Dice;
use super::super::truth::Detail;

/// Where the coordinate is.
#[derive(Debug, Clone, Copy)]
pub struct Now {
    /// Time since the simulation began, s.
    pub t: f64,
    /// Excursion from rest, m or rad.
    pub x: f64,
    /// Its rate.
    pub v: f64,
}

/// Rates of the states, and the force by which the cause resists +x.
type Push = dyn Fn(&Now, &[f64], &mut [f64]) -> f64 + Send + Sync;
/// Rates of the states, and the force that arrives of the force that was commanded.
type Drive = dyn Fn(f64, &Now, &[f64], &mut [f64]) -> f64 + Send + Sync;
/// What happens to the states after a step.
type After = dyn Fn(&Now, &mut [f64]) + Send + Sync;
/// What an instrument makes of what it should have written: its samples, with their noise.
type Reading = dyn Fn(&mut [f64]) + Send + Sync;
/// The stretch that a film sees, at the strain now.x.
type Seen = dyn Fn(&Now, &[f64]) -> f64 + Send + Sync;
/// What the stress of the equilibrium spring and of the branches is multiplied by.
type Factor = dyn Fn(&Now, &[f64]) -> [f64; 2] + Send + Sync;

/// The spring of a coordinate.
#[derive(Debug, Clone, Copy)]
pub enum Spring {
    /// Stiffness, N/m.
    Linear(f64),
    /// Of a flexure: a force at full stroke, the stroke, shares of a cubic and of a quadratic part.
    Curve([f64; 4]),
}

impl Default for Spring {
    fn default() -> Self {
        Spring::Linear(0.0)
    }
}

impl Spring {
    /// Its force at an excursion.
    pub fn force(self, x: f64) -> f64 {
        match self {
            Spring::Linear(k) => k * x,
            Spring::Curve([force, stroke, cubic, quadratic]) => {
                let s = x / stroke;
                force * s * (1.0 - cubic - quadratic + quadratic * s + cubic * s * s)
            }
        }
    }
}

/// One left-out cause.
pub struct Mechanism {
    /// What the answer says.
    pub detail: Detail,
    /// States at the beginning.
    pub states: Vec<f64>,
    /// A force.
    pub push: Option<Box<Push>>,
    /// Another drive.
    pub drive: Option<Box<Drive>>,
    /// A memory.
    pub after: Option<Box<After>>,
    /// A fault of the coordinate's instrument.
    pub reading: Option<Box<Reading>>,
    /// A fault of the force's instrument.
    pub cell: Option<Box<Reading>>,
    /// Another stretch.
    pub seen: Option<Box<Seen>>,
    /// Other moduli.
    pub factor: Option<Box<Factor>>,
    /// The input's log runs behind the motion by this much, s.
    pub late_s: f64,
}

impl Mechanism {
    /// A cause that does nothing yet.
    pub fn new(id: &str, strength: f64) -> Self {
        Mechanism {
            detail: Detail {
                effect: id.into(),
                strength,
                actuators: Vec::new(),
                parameters: BTreeMap::new(),
                form: BTreeMap::new(),
                place: Vec::new(),
            },
            states: Vec::new(),
            push: None,
            drive: None,
            after: None,
            reading: None,
            cell: None,
            seen: None,
            factor: None,
            late_s: 0.0,
        }
    }

    /// Writes a number of the simulated form into the answer.
    #[must_use]
    pub fn form(mut self, name: &str, value: f64) -> Self {
        self.detail.form.insert(name.into(), value.into());
        self
    }

    /// With states that begin so.
    #[must_use]
    pub fn with(mut self, states: Vec<f64>) -> Self {
        self.states = states;
        self
    }

    /// With a force.
    #[must_use]
    pub fn push(
        mut self,
        f: impl Fn(&Now, &[f64], &mut [f64]) -> f64 + Send + Sync + 'static,
    ) -> Self {
        self.push = Some(Box::new(f));
        self
    }

    /// With another drive.
    #[must_use]
    pub fn drive(
        mut self,
        f: impl Fn(f64, &Now, &[f64], &mut [f64]) -> f64 + Send + Sync + 'static,
    ) -> Self {
        self.drive = Some(Box::new(f));
        self
    }

    /// With a memory.
    #[must_use]
    pub fn after(mut self, f: impl Fn(&Now, &mut [f64]) + Send + Sync + 'static) -> Self {
        self.after = Some(Box::new(f));
        self
    }

    /// With a fault of the force's instrument.
    #[must_use]
    pub fn cell(mut self, f: impl Fn(&mut [f64]) + Send + Sync + 'static) -> Self {
        self.cell = Some(Box::new(f));
        self
    }

    /// With another stretch of the film.
    #[must_use]
    pub fn seen(mut self, f: impl Fn(&Now, &[f64]) -> f64 + Send + Sync + 'static) -> Self {
        self.seen = Some(Box::new(f));
        self
    }

    /// With other moduli of the film.
    #[must_use]
    pub fn factor(mut self, f: impl Fn(&Now, &[f64]) -> [f64; 2] + Send + Sync + 'static) -> Self {
        self.factor = Some(Box::new(f));
        self
    }

    /// With a fault of the instrument.
    #[must_use]
    pub fn reading(mut self, f: impl Fn(&mut [f64]) + Send + Sync + 'static) -> Self {
        self.reading = Some(Box::new(f));
        self
    }
}

/// What is known of the recordings when a cause is drawn.
#[derive(Debug, Clone, Copy, Default)]
pub struct Setting {
    /// The spring.
    pub spring: Spring,
    /// Mass, kg (or kg m^2).
    pub mass: f64,
    /// Force at rest, N.
    pub bias: f64,
    /// Largest excursion planned, m.
    pub stroke: f64,
    /// Lowest and highest excursion planned, m.
    pub ends: [f64; 2],
    /// Largest speed planned, m/s.
    pub speed: f64,
    /// Largest force planned, N.
    pub force: f64,
    /// Length of the longest recording, s.
    pub duration_s: f64,
    /// Frequency that the motion is made around, Hz.
    pub base_hz: f64,
    /// Distance of the samples, s.
    pub step_s: f64,
}

/// Draws a cause: its strength, and randomness for everything else.
pub struct Draw {
    /// Randomness.
    pub dice: Dice,
    /// 0 barely visible to 1 strong.
    pub strength: f64,
    /// The recordings.
    pub at: Setting,
}

impl Draw {
    /// A size between `low` and `high`, by the strength.
    pub fn size(&self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.strength)
    }

    /// A force between these shares of the largest one, by the strength.
    pub fn share(&self, low: f64, high: f64) -> f64 {
        self.at.force * self.size(low, high)
    }

    /// A cause of this name.
    pub fn cause(&self, id: &str) -> Mechanism {
        Mechanism::new(id, self.strength)
    }
}
