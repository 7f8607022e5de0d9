//! What ages, and what the choice of causes (`joint`) asks of recordings over days, whatever hangs or moves:
//! [`Aged`].

use nalgebra::{DMatrix, DVector};

use super::Error;
use crate::effects::{
    Effect, ElectrodeFailure, ElectrodeStiffness, PayloadChange, SeriesResistance,
};
use crate::film::Film;
use crate::model::{Electrode, ForearmTorque};

/// What may differ between the days of a sample or a robot: a cause of ageing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Cause {
    /// The electrode is an elastic layer on the active part: its modulus, Pa.
    ElectrodeStiffness,
    /// Wire and electrode feed the film through a resistance, ohm.
    SeriesResistance,
    /// Share of the active area (or of the permittivity: the two do the same) that is left.
    ActiveArea,
    /// All moduli of the film over those of the first level.
    FilmModulus,
    /// Mass on the free end, or on the end effector and with it, over that stated.
    Load,
}

impl Cause {
    /// All of them.
    pub const ALL: [Cause; 5] = [
        Cause::ElectrodeStiffness,
        Cause::SeriesResistance,
        Cause::ActiveArea,
        Cause::FilmModulus,
        Cause::Load,
    ];

    /// The effect of the catalogue that it is, of which it moves the first value; none for a factor on the
    /// film.
    #[must_use]
    pub fn effect(self) -> Option<&'static dyn Effect> {
        match self {
            Cause::ElectrodeStiffness => Some(&ElectrodeStiffness),
            Cause::SeriesResistance => Some(&SeriesResistance),
            Cause::ActiveArea => Some(&ElectrodeFailure),
            Cause::FilmModulus => None,
            Cause::Load => Some(&PayloadChange),
        }
    }

    /// The first value of [`Cause::effect`], as factor times the cause plus a number; `mass_kg` as stated.
    #[must_use]
    pub fn first_value(self, mass_kg: f64) -> [f64; 2] {
        match self {
            Cause::ActiveArea => [-1.0, 1.0],
            Cause::Load => [mass_kg, -mass_kg],
            Cause::ElectrodeStiffness | Cause::SeriesResistance | Cause::FilmModulus => [1.0, 0.0],
        }
    }

    /// The value that changes nothing.
    #[must_use]
    pub fn off(self) -> f64 {
        match self {
            Cause::ElectrodeStiffness | Cause::SeriesResistance => 0.0,
            Cause::ActiveArea | Cause::FilmModulus | Cause::Load => 1.0,
        }
    }

    /// How far it goes where it changes: the standard deviation expected beforehand, for each about what
    /// takes a third to half of a stroke.
    #[must_use]
    pub fn range(self) -> f64 {
        match self {
            Cause::ElectrodeStiffness => 4e5,
            Cause::SeriesResistance => 4e8,
            Cause::ActiveArea => 0.3,
            Cause::FilmModulus => 0.8,
            Cause::Load => 0.5,
        }
    }

    /// How likely it is beforehand, against a cause in the electrode: silicone keeps for years what grease
    /// loses in days, and the load is a stated mass.
    #[must_use]
    pub fn odds(self) -> f64 {
        match self {
            Cause::ElectrodeStiffness | Cause::SeriesResistance | Cause::ActiveArea => 1.0,
            Cause::FilmModulus | Cause::Load => 0.1,
        }
    }

    /// The way in which an electrode ages by it, the sign of the change: what dries stiffens, resists and
    /// loses contact. Of the film and the load nothing is known.
    #[must_use]
    pub fn way(self) -> Option<f64> {
        match self {
            Cause::ElectrodeStiffness | Cause::SeriesResistance => Some(1.0),
            Cause::ActiveArea => Some(-1.0),
            Cause::FilmModulus | Cause::Load => None,
        }
    }

    /// What the search allows.
    #[must_use]
    pub fn bounds(self) -> [f64; 2] {
        match self {
            Cause::ElectrodeStiffness => [-3e6, 3e7],
            Cause::SeriesResistance => [0.0, 1e12],
            Cause::ActiveArea | Cause::FilmModulus | Cause::Load => [0.02, 20.0],
        }
    }
}

/// One unknown of the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Slot {
    /// ln of the relaxation time of a branch, s.
    LogTime(usize),
    /// Modulus of a spring, Pa.
    Modulus(usize),
    /// Shift of x of a recording, m: its zero is a noisy mean.
    Shift(usize),
    /// Clock offset of a recording, s.
    Offset(usize),
    /// 1/J of the springs.
    ReciprocalLocking,
    /// Torque of the forearms at a node, N m.
    Torque(usize),
    /// A cause, in the recordings of one level.
    Cause(Cause, usize),
}

/// Least squares linearised.
pub(super) struct Normal {
    /// J^T J of rows and priors.
    pub gram: DMatrix<f64>,
    /// J^T r of both.
    pub gradient: DVector<f64>,
    /// r^T r of both.
    pub square: f64,
    /// Derivatives of the lengths at rest, one row a recording, less their mean.
    pub rest: DMatrix<f64>,
    /// Lengths at rest less what was seen, m, less their mean.
    pub rest_left: DVector<f64>,
}

/// A model at some values of its unknowns.
#[derive(Clone)]
pub(super) struct Place {
    /// Causes with a value on every level.
    pub causes: Vec<Cause>,
    pub slots: Vec<Slot>,
    pub values: Vec<f64>,
}

impl Place {
    /// Value of an unknown, where it is one.
    pub fn get(&self, slot: Slot) -> Option<f64> {
        let j = self.slots.iter().position(|s| *s == slot)?;
        Some(self.values[j])
    }

    /// Value of a cause on a level.
    pub fn value(&self, cause: Cause, level: usize) -> f64 {
        let own = if self.causes.contains(&cause) {
            level
        } else {
            0
        };
        self.get(Slot::Cause(cause, own)).unwrap_or(cause.off())
    }
}

/// Where a fit ended.
pub(super) struct Minimum {
    /// Model and values.
    pub place: Place,
    /// Which unknowns rest on a bound.
    pub resting: Vec<bool>,
    /// Evaluations, with derivatives or without.
    pub evaluations: usize,
    /// Whether it converged.
    pub converged: bool,
}

/// A level by a model: what a prediction of its recordings needs beside the film and the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelModel {
    /// Factor on the film's moduli.
    pub film_factor: f64,
    /// The electrode.
    pub electrode: Electrode,
    /// The mass that hangs on the film or moves with the end effector, kg.
    pub mass_kg: f64,
    /// Relative permittivity, as stated.
    pub eps_r: f64,
    /// Length at rest of a hanging sample, m.
    pub rest_length_m: Option<f64>,
}

/// Recordings over levels (days, batches): fits and linearises a model with a set of causes on them.
pub(super) trait Aged: Sync {
    /// Number of levels.
    fn levels(&self) -> usize;
    /// Number of residuals.
    fn rows(&self) -> usize;
    /// What the levels share and what a recording has of its own, beside the causes.
    fn common(&self) -> Vec<Slot>;
    /// What the search allows.
    fn bounds(&self, slot: &Slot) -> [f64; 2];
    /// Where a search begins, of an unknown that no fit has found yet.
    fn start(&self, slot: &Slot) -> f64;
    /// Film and resistance of the first level by itself, where the fits begin, and the evaluations spent.
    fn first(&self) -> Result<(Place, usize), Error>;
    /// Fits a model from `start`, the values of `slots`; `fine` to the last digit.
    fn minimise(
        &self,
        causes: &[Cause],
        slots: Vec<Slot>,
        start: &[f64],
        fine: bool,
    ) -> Result<Minimum, Error>;
    /// The model of `place` linearised there, priors included.
    fn normal(&self, place: &Place) -> Result<Normal, Error>;
    /// Mean square of what `place` leaves over the noise's, and the same times the rows that say the same
    /// thing.
    fn noise(&self, place: &Place) -> Result<[f64; 2], Error>;
    /// Whether the model has a value at `place` at all.
    fn possible(&self, _place: &Place) -> bool {
        true
    }
    /// Standard deviations of a position at rest that are weighed, m; one that means nothing where no such
    /// positions count.
    fn mounts(&self) -> Vec<f64> {
        vec![1.0]
    }
    /// A level by a model.
    fn level(&self, place: &Place, level: usize) -> Result<LevelModel, Error>;
    /// The film of the first level, and the forearms where there are any.
    fn film(&self, place: &Place) -> (Film, Option<ForearmTorque>);

    /// Level from which a cause has values: all but the resistance count from the first.
    fn first_level(cause: Cause) -> usize {
        usize::from(cause != Cause::SeriesResistance)
    }

    /// Unknowns of a model with `causes`, each with a value on every level: those of the causes first.
    fn slots(&self, causes: &[Cause]) -> Vec<Slot> {
        let mut slots = Vec::new();
        for cause in causes {
            let first = Self::first_level(*cause);
            slots.extend((first..self.levels()).map(|l| Slot::Cause(*cause, l)));
        }
        if !causes.contains(&Cause::SeriesResistance) {
            slots.push(Slot::Cause(Cause::SeriesResistance, 0));
        }
        slots.extend(self.common());
        slots
    }

    /// The model with `causes` at the values of `from`; of unknowns that it does not have, where a search
    /// begins.
    fn place(&self, causes: &[Cause], from: &Place) -> Place {
        let slots = self.slots(causes);
        let value = |slot: &Slot| match *slot {
            Slot::Cause(cause, level) => from.value(cause, level),
            other => from.get(other).unwrap_or_else(|| self.start(slot)),
        };
        Place {
            causes: causes.to_vec(),
            values: slots.iter().map(value).collect(),
            slots,
        }
    }
}
