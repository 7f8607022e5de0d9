//! `parameters.toml`: every value that a prediction needs, beside the rig. It is written for people too
//! (units in the names, a comment over each block), and every number reads back to the same bits.
//!
//! ```text
//! [film]        mu_Pa (n + 1, the equilibrium spring first), T_s (n, rising), J, eps_r
//! [forearm]     nodes_deg, torque_N_m
//! [axis]        values of a single axis
//! [[effect]]    id, actuators, and the effect's own values; id = "learnt": those of `learnt_entry.rs`
//! [[series]]    id, number, begins_s, clock_s: when the recordings of a diagnosis were made
//! [provenance]  program, command, rig and recordings with their SHA-256
//! ```
//!
//! Each number `X` has its standard error in `X_std_error` and its 95 % interval in `X_ci95`, `nan` where
//! there is none; where noise in the motion pulls at a number of a cause, both belong to `X_estimate`, the
//! one freed of that.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;
use toml::de::DeValue;

use super::provenance::{FileSum, Provenance, RecordingSum};
use crate::calibration::{
    CouponOutcome, Estimate, Joint, LONG_AGO_S, LineOutcome, Outcome, SampleOutcome,
};
use crate::diagnosis::{Diagnosis, RigKind};
use crate::effects::{
    self, Effect as _, ElectrodeFailure, ElectrodeStiffness, PayloadChange, SeriesResistance,
};
use crate::film::Film;
use crate::model::{Electrode, ForearmTorque, Parameters};
use crate::recording::keys::{Document, Keys, PARAMETERS, Value, describe};
use crate::recording::{Error, ErrorKind, Note};

/// A value with its standard error and its 95 % interval, both NaN where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// In the unit that the field names.
    pub value: f64,
    /// In the same unit.
    pub std_error: f64,
    /// Lower and upper end, in the same unit.
    pub ci95: [f64; 2],
}

impl Quantity {
    /// A value of which no error is known.
    #[must_use]
    pub fn exact(value: f64) -> Self {
        Quantity {
            value,
            std_error: f64::NAN,
            ci95: [f64::NAN; 2],
        }
    }

    fn of(value: f64, estimate: Option<&Estimate>) -> Self {
        match estimate {
            Some(e) if !e.fixed => Quantity {
                value,
                std_error: e.std_error,
                ci95: e.ci95,
            },
            _ => Quantity::exact(value),
        }
    }
}

/// `[film]`.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmEntry {
    /// Moduli of the n + 1 springs, Pa, the equilibrium spring first.
    pub mu_pa: Vec<Quantity>,
    /// Relaxation times of the n branches, s, rising.
    pub relaxation_time_s: Vec<Quantity>,
    /// Locking constant J.
    pub locking: Quantity,
    /// Relative permittivity; wins over the rig's.
    pub eps_r: Option<Quantity>,
}

impl FilmEntry {
    /// A film with the errors of those of its parameters that are among `estimates`.
    #[must_use]
    pub fn of(film: &Film, eps_r: Option<f64>, estimates: &[Estimate]) -> Self {
        let quantity =
            |name: &str, value: f64| Quantity::of(value, estimates.iter().find(|e| e.name == name));
        let list = |letter: &str, values: &[f64]| {
            let numbered = values.iter().enumerate();
            numbered
                .map(|(i, &v)| quantity(&format!("{letter}_{}", i + 1), v))
                .collect()
        };
        FilmEntry {
            mu_pa: list("mu", &film.mu_pa),
            relaxation_time_s: list("T", &film.relaxation_time_s),
            locking: quantity("J", film.locking),
            eps_r: eps_r.filter(|e| e.is_finite()).map(Quantity::exact),
        }
    }
}

impl FilmEntry {
    /// Its values.
    #[must_use]
    pub fn film(&self) -> Film {
        let values = |list: &[Quantity]| list.iter().map(|q| q.value).collect();
        Film {
            mu_pa: values(&self.mu_pa),
            relaxation_time_s: values(&self.relaxation_time_s),
            locking: self.locking.value,
        }
    }
}

/// `[forearm]`.
#[derive(Debug, Clone, PartialEq)]
pub struct ForearmEntry {
    /// Node angles, deg, rising.
    pub nodes_deg: Vec<f64>,
    /// Nodal torques, N m.
    pub torque_n_m: Vec<Quantity>,
}

/// Named values in the order of the file.
pub type Values = Vec<(String, toml::Value)>;

/// `[[effect]]`: a cause that the plain model leaves out, with its own values.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// Which: `series_resistance`.
    pub id: String,
    /// Actuators (1 to 3) on which it acts.
    pub actuators: Vec<usize>,
    /// Its numbers (and words), in the units of the effect.
    pub values: Values,
    /// Where it stands in the file.
    pub lines: Lines,
}

/// The lines of a file on which keys stand; none where there is no file. What a block says is the same
/// wherever it stands.
#[derive(Debug, Clone, Default)]
pub struct Lines(Vec<(String, u64)>);

impl PartialEq for Lines {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Effect {
    /// A number of the effect.
    #[must_use]
    pub fn number(&self, name: &str) -> Option<f64> {
        match self.values.iter().find(|(n, _)| n == name)?.1 {
            toml::Value::Float(v) => Some(v),
            #[allow(clippy::cast_precision_loss)]
            toml::Value::Integer(v) => Some(v as f64),
            _ => None,
        }
    }

    /// An error about a key of the block, with the line of the key; with that of the block where it has none.
    pub(super) fn at_line(&self, error: Error) -> Error {
        let key = error.key().rsplit(' ').next().unwrap_or_default();
        let Lines(lines) = &self.lines;
        let line = lines.iter().find(|(name, _)| name == key).or(lines.first());
        let line = line.map_or(0, |(_, line)| *line);
        error.at_line(line)
    }
}

/// `[[series]]`: when a recording was made.
#[derive(Debug, Clone, PartialEq, Serialize, serde::Deserialize, JsonSchema)]
pub struct SeriesEntry {
    /// The recording.
    pub id: String,
    /// Its number in the series.
    pub number: usize,
    /// Its beginning after that of the first, s; assumed where no beginning was stated.
    pub begins_s: f64,
    /// Its beginning on the clock that `start` of its manifest states, s since 1970.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock_s: Option<f64>,
}

/// A parameter file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ParameterFile {
    /// The file it was read from; empty for one that was made here.
    pub path: PathBuf,
    /// `[film]`; a hinge bench or an axis gives none.
    pub film: Option<FilmEntry>,
    /// `[forearm]`.
    pub forearm: Option<ForearmEntry>,
    /// `[axis]`.
    pub axis: Values,
    /// `[[effect]]`.
    pub effects: Vec<Effect>,
    /// `[[series]]`: the recordings of a diagnosis; what happens at a moment refers to it.
    pub series: Vec<SeriesEntry>,
    /// `[provenance]`.
    pub provenance: Provenance,
    /// What a reader should know: defaults that were taken.
    pub notes: Vec<Note>,
}

const TOP: &[&str] = &["film", "forearm", "axis", "effect", "series", "provenance"];
const FILM: &[&str] = &[
    "mu_Pa",
    "mu_Pa_std_error",
    "mu_Pa_ci95",
    "T_s",
    "T_s_std_error",
    "T_s_ci95",
    "J",
    "J_std_error",
    "J_ci95",
    "eps_r",
    "eps_r_std_error",
    "eps_r_ci95",
];
const FOREARM: &[&str] = &[
    "nodes_deg",
    "torque_N_m",
    "torque_N_m_std_error",
    "torque_N_m_ci95",
];
const EFFECT: &[&str] = &["id", "actuators"];
const SERIES: &[&str] = &["id", "number", "begins_s", "clock_s"];
const PROVENANCE: &[&str] = &["program", "command", "rig", "recording"];
const RECORDING: &[&str] = &["id", "files"];
const FILE: &[&str] = &["role", "file", "sha256"];

/// The degrees whose radians are `rad`, bit for bit where such degrees exist; the shortest of them.
fn degrees(rad: f64) -> f64 {
    let plain = rad.to_degrees();
    let rounded = (plain * 1e6).round() / 1e6;
    let near = [
        rounded,
        plain,
        plain.next_up(),
        plain.next_down(),
        plain.next_up().next_up(),
        plain.next_down().next_down(),
    ];
    near.into_iter()
        .find(|d| d.to_radians().to_bits() == rad.to_bits())
        .unwrap_or(plain)
}

impl ForearmEntry {
    /// A curve without errors. Nodes that were made of degrees come back to the bit; others to the last
    /// place.
    #[must_use]
    pub fn of(forearm: &ForearmTorque) -> Self {
        let torques = forearm.torque_n_m().iter();
        ForearmEntry {
            nodes_deg: forearm.nodes_rad().iter().map(|&r| degrees(r)).collect(),
            torque_n_m: torques.map(|&v| Quantity::exact(v)).collect(),
        }
    }
}

impl ParameterFile {
    /// Parameters without errors or provenance. Nodes of the forearm that were made of degrees come back to
    /// the bit; others to the last place.
    #[must_use]
    pub fn of(parameters: &Parameters, eps_r: Option<f64>) -> Self {
        ParameterFile {
            film: Some(FilmEntry::of(&parameters.film, eps_r, &[])),
            forearm: Some(ForearmEntry::of(&parameters.forearm)),
            ..ParameterFile::default()
        }
    }

    /// What a calibration found, with its errors.
    #[must_use]
    pub fn of_outcome(outcome: &Outcome, provenance: Provenance) -> Self {
        let mut file = ParameterFile::of(&outcome.parameters, Some(outcome.eps_r));
        file.film = Some(FilmEntry::of(
            &outcome.parameters.film,
            Some(outcome.eps_r),
            &outcome.estimates,
        ));
        if let Some(forearm) = &mut file.forearm {
            // nodes and torque estimates are in the same order
            let torques = outcome
                .estimates
                .iter()
                .filter(|e| e.name.starts_with("torque_"));
            for (q, estimate) in forearm.torque_n_m.iter_mut().zip(torques) {
                *q = Quantity::of(q.value, Some(estimate));
            }
        }
        file.provenance = provenance;
        file
    }

    /// The augmented model of a diagnosis: film, forearm and the causes that it contains.
    #[must_use]
    pub fn of_diagnosis(
        diagnosis: &Diagnosis,
        series: Vec<SeriesEntry>,
        provenance: Provenance,
    ) -> Self {
        let found = diagnosis.candidates.iter().filter(|c| c.in_model);
        let eps_r = Some(diagnosis.eps_r).filter(|e| e.is_finite());
        let mut plain = ParameterFile::of(&diagnosis.parameters, eps_r);
        let (film, forearm) = match diagnosis.rig {
            RigKind::Robot => (true, true),
            RigKind::Coupon => (true, false),
            RigKind::Bench => (false, true),
            RigKind::Axis => (false, false),
        };
        plain.film = plain.film.filter(|_| film);
        plain.forearm = plain.forearm.filter(|_| forearm);
        plain.axis = diagnosis
            .values
            .iter()
            .map(|(name, value)| (name.clone(), (*value).into()))
            .collect();
        let learnt = diagnosis.learnt.iter().flat_map(|l| &l.terms);
        let learnt = learnt.filter_map(|t| Effect::learnt(&t.acting, &t.covariance));
        ParameterFile {
            effects: found
                .map(|c| Effect::of(c, &series))
                .chain(learnt)
                .collect(),
            series,
            provenance,
            ..plain
        }
    }

    /// The film that a calibration on coupons found, with its errors: those of the noise of the stress alone,
    /// as in `fit.json`.
    #[must_use]
    pub fn of_coupons(outcome: &CouponOutcome, provenance: Provenance) -> Self {
        ParameterFile {
            film: Some(FilmEntry::of(&outcome.film, None, &outcome.estimates)),
            provenance,
            ..ParameterFile::default()
        }
    }

    /// The torque curve of a hinge, usable as the forearms', or the values of an axis.
    #[must_use]
    pub fn of_lines(outcome: &LineOutcome, provenance: Provenance) -> Self {
        let forearm = outcome.curve.as_ref().map(|curve| ForearmEntry {
            nodes_deg: curve.nodes_rad().iter().map(|&r| degrees(r)).collect(),
            torque_n_m: curve
                .torque_n_m()
                .iter()
                .zip(&outcome.estimates)
                .map(|(&t, e)| Quantity::of(t, Some(e)))
                .collect(),
        });
        let axis = outcome
            .values
            .iter()
            .map(|(name, value)| (name.clone(), (*value).into()))
            .collect();
        ParameterFile {
            forearm,
            axis,
            effects: outcome.causes.iter().map(Effect::of_line).collect(),
            provenance,
            ..ParameterFile::default()
        }
    }

    /// The film that a calibration on hanging samples found, with its errors; what their electrodes do, where
    /// all do the same.
    #[must_use]
    pub fn of_samples(outcome: &SampleOutcome, provenance: Provenance) -> Self {
        let first = outcome.recordings.first().map(|r| r.electrode);
        let same = outcome
            .recordings
            .iter()
            .all(|r| Some(r.electrode) == first);
        ParameterFile {
            film: Some(FilmEntry::of(
                &outcome.film,
                Some(outcome.eps_r),
                &outcome.estimates,
            )),
            effects: first
                .filter(|_| same)
                .map_or_else(Vec::new, |e| electrode_effects(&e, &[1], 0.0)),
            provenance,
            ..ParameterFile::default()
        }
    }

    /// What the electrode of a hanging sample does, from `[[effect]]`: `electrode_stiffness`,
    /// `series_resistance` and `electrode_failure` from the first sample on.
    ///
    /// # Errors
    /// An effect that a hanging sample has no place for, or one without its number.
    pub fn electrode(&self) -> Result<Electrode, Error> {
        let mut out = Electrode::IDEAL;
        for effect in &self.effects {
            self.add_to(&mut out, effect)
                .map_err(|e| effect.at_line(e))?;
        }
        Ok(out)
    }

    /// Adds what an effect does to an electrode.
    fn add_to(&self, out: &mut Electrode, effect: &Effect) -> Result<(), Error> {
        let need = |name: &str| {
            effect.number(name).ok_or_else(|| {
                Error::new(
                    ErrorKind::MissingKey,
                    &self.path,
                    format!("effect `{}` has no `{name}`", effect.id),
                )
                .at_key("[[effect]]")
                .action(format!("add `{name} = ...`"))
            })
        };
        let is = |cause: &dyn effects::Effect| effect.id == cause.id();
        if is(&ElectrodeFailure) && effect.number("time").is_some_and(|t| t > 0.0) {
            return Err(Error::new(
                ErrorKind::BadValue,
                &self.path,
                "the electrode of a hanging sample fails before its first sample, not during a recording",
            )
            .at_key(format!("[[effect]] {} time", effect.id))
            .action("state time = 0.0"));
        }
        let grows = effect.number("stretch_exponent").is_some_and(|n| n != 0.0);
        if is(&SeriesResistance) && grows {
            return Err(Error::new(
                ErrorKind::BadValue,
                &self.path,
                "the wire of a hanging sample has one resistance, at any stretch",
            )
            .at_key(format!("[[effect]] {} stretch_exponent", effect.id))
            .action("take `stretch_exponent` out"));
        }
        if is(&ElectrodeStiffness) {
            out.modulus_pa += need("modulus")?;
        } else if is(&SeriesResistance) {
            out.resistance_ohm += need("resistance")?;
        } else if is(&ElectrodeFailure) {
            out.active_fraction *= 1.0 - need("fraction")?;
        } else {
            let [a, b, c] = [
                ElectrodeStiffness.id(),
                SeriesResistance.id(),
                ElectrodeFailure.id(),
            ];
            return Err(Error::new(
                ErrorKind::BadValue,
                &self.path,
                format!("effect `{}` cannot act on a hanging sample", effect.id),
            )
            .at_key("[[effect]] id")
            .expected(format!("{a}, {b} or {c}"))
            .action("take the block out, or name a file of a sample"));
        }
        Ok(())
    }

    /// Film and forearm, as the model wants them. Without `[forearm]`: no torque, at the default nodes.
    ///
    /// # Errors
    /// There is no `[film]`; nodes that cannot be.
    pub fn parameters(&self) -> Result<Parameters, Error> {
        let Some(film) = &self.film else {
            return Err(
                Error::new(ErrorKind::MissingKey, &self.path, "the table is missing")
                    .at_key("[film]")
                    .action("name a file that `deacal fit film` or `deacal fit robot` wrote"),
            );
        };
        Ok(Parameters {
            film: film.film(),
            forearm: self.forearm_torque()?,
        })
    }

    /// The forearm's curve; without `[forearm]` no torque, at the default nodes.
    ///
    /// # Errors
    /// Nodes that cannot be.
    pub fn forearm_torque(&self) -> Result<ForearmTorque, Error> {
        let Some(forearm) = &self.forearm else {
            return Ok(ForearmTorque::zero());
        };
        let nodes = forearm.nodes_deg.iter().map(|d| d.to_radians()).collect();
        let torque = forearm.torque_n_m.iter().map(|q| q.value).collect();
        ForearmTorque::new(nodes, torque).map_err(|what| {
            Error::new(ErrorKind::BadValue, &self.path, what).at_key("[forearm] nodes_deg")
        })
    }

    /// Relative permittivity, where the file has it.
    #[must_use]
    pub fn eps_r(&self) -> Option<f64> {
        self.film.as_ref()?.eps_r.map(|q| q.value)
    }

    /// Reads a parameter file.
    ///
    /// # Errors
    /// The file cannot be read; a key is unknown (the nearest is named), missing or of the wrong type; a
    /// value that cannot be, with its line and what to do.
    pub fn read(path: &Path) -> Result<Self, Error> {
        read(&Document::read(path, &PARAMETERS)?)
    }

    /// Reads the text of a parameter file; `path` is for messages.
    ///
    /// # Errors
    /// As [`ParameterFile::read`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        read(&Document::new(path, text.to_owned(), &PARAMETERS))
    }

    /// The text of the file.
    ///
    /// # Errors
    /// A parameter that is no finite number, by its name: no prediction can be made with it, so that it is
    /// not written.
    pub fn to_toml(&self) -> Result<String, NotFinite> {
        self.finite()?;
        Ok(self.text())
    }

    /// Whether every value, apart from what says how sure it is, is a finite number.
    fn finite(&self) -> Result<(), NotFinite> {
        let check = |name: String, value: f64| match value.is_finite() {
            true => Ok(()),
            false => Err(NotFinite { name, value }),
        };
        let list = |name: &str, list: &[Quantity]| -> Result<(), NotFinite> {
            list.iter()
                .enumerate()
                .try_for_each(|(i, q)| check(format!("{name}[{i}]"), q.value))
        };
        if let Some(film) = &self.film {
            list("film.mu_Pa", &film.mu_pa)?;
            list("film.T_s", &film.relaxation_time_s)?;
            check("film.J".into(), film.locking.value)?;
            if let Some(eps_r) = &film.eps_r {
                check("film.eps_r".into(), eps_r.value)?;
            }
        }
        if let Some(forearm) = &self.forearm {
            for (i, node) in forearm.nodes_deg.iter().enumerate() {
                check(format!("forearm.nodes_deg[{i}]"), *node)?;
            }
            list("forearm.torque_N_m", &forearm.torque_n_m)?;
        }
        let stated = |table: &str, values: &Values| -> Result<(), NotFinite> {
            let estimates = ["_std_error", "_ci95"];
            (values
                .iter()
                .filter(|(n, _)| !estimates.iter().any(|e| n.ends_with(e))))
            .try_for_each(|(name, value)| {
                floats(value)
                    .into_iter()
                    .try_for_each(|v| check(format!("{table}.{name}"), v))
            })
        };
        stated("axis", &self.axis)?;
        (self.effects.iter()).try_for_each(|e| stated(&format!("effect `{}`", e.id), &e.values))
    }

    fn text(&self) -> String {
        let mut out = String::with_capacity(8192);
        let program = match self.provenance.program.as_str() {
            "" => concat!("deacal ", env!("CARGO_PKG_VERSION")),
            program => program,
        };
        comment(
            &mut out,
            &format!("Calibrated parameters, written by {}.", one_line(program)),
        );
        comment(
            &mut out,
            "Give this file to --params or --start. Numbers read back exactly as written.",
        );
        comment(
            &mut out,
            "X_std_error is the standard error of X, X_ci95 its 95 % interval, both in the unit of X; nan: none.",
        );
        if let Some(film) = &self.film {
            out.push_str(
                "\n# The film: Gent springs, all but the first in series with a dashpot.\n[film]\n",
            );
            comment(
                &mut out,
                "Moduli of the springs, Pa: the equilibrium spring, then one a branch.",
            );
            quantities(&mut out, "mu_Pa", &film.mu_pa);
            comment(&mut out, "Relaxation times of the branches, s, rising.");
            quantities(&mut out, "T_s", &film.relaxation_time_s);
            comment(&mut out, "Locking constant of the springs, dimensionless.");
            quantity(&mut out, "J", &film.locking);
            if let Some(eps_r) = &film.eps_r {
                comment(
                    &mut out,
                    "Relative permittivity, dimensionless; wins over the rig's.",
                );
                quantity(&mut out, "eps_r", eps_r);
            }
        }
        if let Some(forearm) = &self.forearm {
            out.push_str(
                "\n# Spring-back torque of a forearm: natural cubic spline through the nodes, linear beyond them.\n[forearm]\n",
            );
            comment(&mut out, "Swing of the forearm, deg.");
            numbers(&mut out, "nodes_deg", &forearm.nodes_deg);
            comment(&mut out, "Torque at each node, N m.");
            quantities(&mut out, "torque_N_m", &forearm.torque_n_m);
        }
        if !self.axis.is_empty() {
            out.push_str(
                "\n# A single coordinate; names end in their units. Where the gain was to be found, largest_force is in the unit of the input.\n[axis]\n",
            );
            values(&mut out, &self.axis);
        }
        for effect in &self.effects {
            match effect.about_learnt() {
                None => out.push_str("\n# A cause that the plain model leaves out.\n"),
                Some(says) => {
                    out.push('\n');
                    comment(&mut out, &one_line(&says));
                }
            }
            out.push_str("[[effect]]\n");
            let _ = writeln!(out, "id = {}", string(&effect.id));
            let _ = writeln!(out, "actuators = {:?}", effect.actuators);
            if let Some(says) = effect.about_estimates() {
                comment(&mut out, says);
            }
            values(&mut out, &effect.values);
        }
        if !self.series.is_empty() {
            out.push('\n');
            comment(
                &mut out,
                "The recordings in the order in which they were made; begins_s is counted from the first.",
            );
        }
        for entry in &self.series {
            out.push_str("[[series]]\n");
            let _ = writeln!(out, "id = {}", string(&entry.id));
            let _ = writeln!(out, "number = {}", entry.number);
            let _ = writeln!(out, "begins_s = {}", number(entry.begins_s));
            if let Some(clock_s) = entry.clock_s {
                let _ = writeln!(out, "clock_s = {}", number(clock_s));
            }
        }
        provenance(&mut out, &self.provenance);
        out
    }

    /// The same content as plain data for JSON, NaN as null.
    #[must_use]
    pub fn to_json(&self) -> ParametersJson {
        ParametersJson::of(self)
    }
}

/// The numbers of a value, lists in lists included.
fn floats(value: &toml::Value) -> Vec<f64> {
    match value {
        toml::Value::Float(v) => vec![*v],
        toml::Value::Array(list) => list.iter().flat_map(floats).collect(),
        _ => Vec::new(),
    }
}

/// A parameter that is no finite number.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "{name} came out as {value}, which nothing can be predicted with: nothing is written; the recordings do not determine it, hold it with --fix or give more"
)]
pub struct NotFinite {
    /// Its place in the file.
    pub name: String,
    /// What it is.
    pub value: f64,
}

/// A block with its own values on `actuators`.
fn block(cause: &dyn effects::Effect, actuators: &[usize], values: &[(&str, f64)]) -> Effect {
    let values = values.iter();
    Effect {
        id: cause.id().to_owned(),
        actuators: actuators.to_vec(),
        values: values
            .map(|(n, v)| ((*n).to_owned(), toml::Value::Float(*v)))
            .collect(),
        lines: Lines::default(),
    }
}

/// The blocks of an electrode on `actuators`, its lost area lost since `since_s`; none for what it does not
/// do.
fn electrode_effects(electrode: &Electrode, actuators: &[usize], since_s: f64) -> Vec<Effect> {
    let ideal = Electrode::IDEAL;
    let mut out = Vec::new();
    if electrode.modulus_pa != ideal.modulus_pa {
        let values = [("modulus", electrode.modulus_pa)];
        out.push(block(&ElectrodeStiffness, actuators, &values));
    }
    if electrode.resistance_ohm != ideal.resistance_ohm {
        let values = [("resistance", electrode.resistance_ohm)];
        out.push(block(&SeriesResistance, actuators, &values));
    }
    if electrode.active_fraction != ideal.active_fraction {
        let lost = 1.0 - electrode.active_fraction;
        let values = [("fraction", lost), ("time", since_s)];
        out.push(block(&ElectrodeFailure, actuators, &values));
    }
    out
}

/// The blocks of what has aged on a level of a joint fit, beside the film; none for what has not. A sample
/// has one film, a robot three.
#[must_use]
pub fn ageing_effects(joint: &Joint, level: usize) -> Vec<Effect> {
    let own = &joint.levels[level];
    if joint.forearm.is_none() {
        return electrode_effects(&own.electrode, &[1], 0.0);
    }
    let all = [1, 2, 3];
    let mut out = electrode_effects(&own.electrode, &all, LONG_AGO_S);
    let heavier = own.mass_kg - joint.levels[0].mass_kg;
    if heavier != 0.0 {
        let values = [("mass", heavier), ("time", LONG_AGO_S)];
        out.push(block(&PayloadChange, &all, &values));
    }
    out
}

fn one_line(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

fn comment(out: &mut String, text: &str) {
    let _ = writeln!(out, "# {text}");
}

fn string(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// The shortest digits that read back to the same bits.
pub(super) fn number(value: f64) -> String {
    if value.is_nan() {
        "nan".to_owned()
    } else {
        format!("{value:?}")
    }
}

/// `key = [...]`, in one line where that is short.
fn array(out: &mut String, key: &str, entries: &[String]) {
    const WIDTH: usize = 100;
    let length = entries.iter().map(|e| e.len() + 2).sum::<usize>();
    if key.len() + length < WIDTH {
        let _ = writeln!(out, "{key} = [{}]", entries.join(", "));
        return;
    }
    let _ = writeln!(out, "{key} = [");
    for entry in entries {
        let _ = writeln!(out, "  {entry},");
    }
    out.push_str("]\n");
}

fn numbers(out: &mut String, key: &str, list: &[f64]) {
    let entries: Vec<String> = list.iter().map(|&v| number(v)).collect();
    array(out, key, &entries);
}

fn interval(ci95: [f64; 2]) -> String {
    format!("[{}, {}]", number(ci95[0]), number(ci95[1]))
}

fn quantities(out: &mut String, key: &str, list: &[Quantity]) {
    let column = |f: fn(&Quantity) -> f64| list.iter().map(f).collect::<Vec<_>>();
    numbers(out, key, &column(|q| q.value));
    if list.iter().any(|q| !q.std_error.is_nan()) {
        numbers(out, &format!("{key}_std_error"), &column(|q| q.std_error));
    }
    if list.iter().any(|q| q.ci95.iter().any(|v| !v.is_nan())) {
        let entries: Vec<String> = list.iter().map(|q| interval(q.ci95)).collect();
        array(out, &format!("{key}_ci95"), &entries);
    }
}

fn quantity(out: &mut String, key: &str, q: &Quantity) {
    let _ = writeln!(out, "{key} = {}", number(q.value));
    if !q.std_error.is_nan() {
        let _ = writeln!(out, "{key}_std_error = {}", number(q.std_error));
    }
    if q.ci95.iter().any(|v| !v.is_nan()) {
        let _ = writeln!(out, "{key}_ci95 = {}", interval(q.ci95));
    }
}

/// A key as it may stand in a TOML file.
fn key(name: &str) -> String {
    if is_name(name) {
        name.to_owned()
    } else {
        string(name)
    }
}

/// Numbers, words and lists of them; anything else has no place in the file.
fn value(v: &toml::Value) -> Option<String> {
    match v {
        toml::Value::Float(v) => Some(number(*v)),
        toml::Value::Integer(v) => Some(v.to_string()),
        toml::Value::Boolean(v) => Some(v.to_string()),
        toml::Value::String(v) => Some(string(v)),
        toml::Value::Array(list) => {
            let entries: Option<Vec<String>> = list.iter().map(value).collect();
            Some(format!("[{}]", entries?.join(", ")))
        }
        toml::Value::Datetime(_) | toml::Value::Table(_) => None,
    }
}

fn values(out: &mut String, values: &Values) {
    for (name, v) in values {
        let rows = match v {
            toml::Value::Array(list) if list.iter().any(toml::Value::is_array) => list,
            _ => &Vec::new(),
        };
        let rows: Option<Vec<String>> = rows.iter().map(value).collect();
        match rows.filter(|r| !r.is_empty()) {
            Some(rows) => array(out, &key(name), &rows),
            None => {
                if let Some(text) = value(v) {
                    let _ = writeln!(out, "{} = {text}", key(name));
                }
            }
        }
    }
}

fn provenance(out: &mut String, p: &Provenance) {
    if *p == Provenance::default() {
        return;
    }
    let file = |f: &FileSum| {
        format!(
            "{{ role = {}, file = {}, sha256 = {} }}",
            string(&f.role),
            string(&f.file),
            string(&f.sha256)
        )
    };
    out.push_str("\n# What these values were made of.\n[provenance]\n");
    let _ = writeln!(out, "program = {}", string(&p.program));
    let _ = writeln!(out, "command = {}", string(&p.command));
    if let Some(rig) = &p.rig {
        let _ = writeln!(out, "rig = {}", file(rig));
    }
    for recording in &p.recordings {
        let _ = writeln!(
            out,
            "[[provenance.recording]]\nid = {}",
            string(&recording.id)
        );
        let files: Vec<String> = recording.files.iter().map(file).collect();
        array(out, "files", &files);
    }
}

/// A name that is an identifier in every language of an export: a letter, then letters, digits and `_`, at
/// most 63.
fn is_name(name: &str) -> bool {
    name.len() <= 63
        && name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

fn read(document: &Document) -> Result<ParameterFile, Error> {
    let root = document.parse()?;
    let top = Keys::top(document, &root, TOP)?;
    let mut file = ParameterFile {
        path: document.path.clone(),
        ..ParameterFile::default()
    };
    if let Some(t) = top.table("film", FILM)? {
        file.film = Some(read_film(&t)?);
    }
    match top.table("forearm", FOREARM)? {
        Some(t) => file.forearm = Some(read_forearm(&t)?),
        None if file.film.is_some() => file.notes.push(Note::info(
            &document.path,
            "there is no [forearm]: its spring-back torque is taken as 0 N m from -30 to 30 deg",
        )),
        None => {}
    }
    if let Some(t) = top.open_table("axis")? {
        file.axis = read_values(&t, &[])?;
    }
    for t in top.open_tables("effect", EFFECT)? {
        file.effects.push(read_effect(&t)?);
    }
    for t in top.tables("series", SERIES)? {
        let number: i64 = t.need("number")?;
        let Ok(number) = usize::try_from(number) else {
            return Err(t
                .bad("number", format!("found {number}"))
                .expected("a whole number not below 0"));
        };
        file.series.push(SeriesEntry {
            id: t.need("id")?,
            number,
            begins_s: t.need("begins_s")?,
            clock_s: t.get("clock_s")?,
        });
    }
    if let Some(t) = top.table("provenance", PROVENANCE)? {
        file.provenance = read_provenance(&t)?;
    }
    if file.film.is_none() && file.forearm.is_none() && file.axis.is_empty() {
        return Err(top.missing(
            "film",
            "a parameter file has [film], [forearm] or [axis]; name a file that `deacal fit` wrote",
        ));
    }
    Ok(file)
}

/// Numbers with their lines. With `gaps` nan and inf may stand among them.
fn list(t: &Keys<'_>, key: &'static str, gaps: bool) -> Result<Option<Vec<(u64, f64)>>, Error> {
    let Some(entries) = t.list(key)? else {
        return Ok(None);
    };
    let read = |(line, v): (u64, &DeValue<'_>)| {
        let number = if gaps {
            any_number(v)
        } else {
            f64::from_toml(v)
        };
        number.map(|n| (line, n)).ok_or_else(|| {
            t.bad(key, format!("found {}", describe(v)))
                .at_line(line)
                .expected(if gaps {
                    "a number or nan"
                } else {
                    "a finite number"
                })
        })
    };
    entries
        .into_iter()
        .map(read)
        .collect::<Result<_, _>>()
        .map(Some)
}

fn need_list(t: &Keys<'_>, key: &'static str) -> Result<Vec<(u64, f64)>, Error> {
    list(t, key, false)?
        .ok_or_else(|| t.missing(key, &format!("add `{key} = [...]` (a list of numbers)")))
}

/// A number, nan and inf included.
fn any_number(v: &DeValue<'_>) -> Option<f64> {
    match v {
        DeValue::Float(f) => f.as_str().parse().ok(),
        v => f64::from_toml(v),
    }
}

fn any_interval(v: &DeValue<'_>) -> Option<[f64; 2]> {
    let ends: Option<Vec<f64>> = v
        .as_array()?
        .iter()
        .map(|e| any_number(e.get_ref()))
        .collect();
    let ends: [f64; 2] = ends?.try_into().ok()?;
    // nan stands for no interval
    let none = ends.iter().any(|v| v.is_nan());
    (none || ends[0] <= ends[1]).then_some(ends)
}

const INTERVAL: &str = "an interval [low, high]";

/// Values with the lists of their errors and intervals beside them.
fn with_errors(
    t: &Keys<'_>,
    values: &[(u64, f64)],
    [key, std_error, ci95]: [&'static str; 3],
) -> Result<Vec<Quantity>, Error> {
    let mut out: Vec<Quantity> = values.iter().map(|v| Quantity::exact(v.1)).collect();
    let fits = |other: &'static str, n: usize| {
        if n == values.len() {
            return Ok(());
        }
        Err(t
            .bad(
                other,
                format!("found {n} entries beside {} of {key}", values.len()),
            )
            .expected(values.len().to_string())
            .action("give one for each value, nan where there is none"))
    };
    if let Some(errors) = list(t, std_error, true)? {
        fits(std_error, errors.len())?;
        for (q, (line, e)) in out.iter_mut().zip(errors) {
            if e < 0.0 {
                return Err(t
                    .bad(std_error, format!("found {e}"))
                    .at_line(line)
                    .expected("a standard error not below 0, or nan"));
            }
            q.std_error = e;
        }
    }
    if let Some(intervals) = t.list(ci95)? {
        fits(ci95, intervals.len())?;
        for (q, (line, v)) in out.iter_mut().zip(intervals) {
            q.ci95 = any_interval(v).ok_or_else(|| {
                t.bad(ci95, format!("found {}", describe(v)))
                    .at_line(line)
                    .expected(INTERVAL)
            })?;
        }
    }
    Ok(out)
}

/// One value with its error and interval.
fn with_error(
    t: &Keys<'_>,
    value: f64,
    [std_error, ci95]: [&'static str; 2],
) -> Result<Quantity, Error> {
    let mut q = Quantity::exact(value);
    if let Some(e) = t.get_with(std_error, "a number not below 0, or nan", |v| {
        any_number(v).filter(|e| e.is_nan() || *e >= 0.0)
    })? {
        q.std_error = e;
    }
    if let Some(ends) = t.get_with(ci95, INTERVAL, any_interval)? {
        q.ci95 = ends;
    }
    Ok(q)
}

fn read_film(t: &Keys<'_>) -> Result<FilmEntry, Error> {
    let mu = need_list(t, "mu_Pa")?;
    let times = need_list(t, "T_s")?;
    if mu.len() != times.len() + 1 {
        return Err(t
            .bad(
                "mu_Pa",
                format!(
                    "found {} moduli and {} relaxation times",
                    mu.len(),
                    times.len()
                ),
            )
            .expected(format!(
                "{} moduli: the equilibrium spring and one a branch",
                times.len() + 1
            ))
            .action(
                "add or remove the modulus, or the time in T_s, of the branch that is not whole",
            ));
    }
    if let Some((line, mu)) = mu.iter().find(|(_, mu)| *mu < 0.0) {
        return Err(t
            .bad("mu_Pa", format!("found {mu}"))
            .at_line(*line)
            .expected("a modulus not below 0 Pa")
            .action("use 0 for a branch that shall do nothing"));
    }
    if let Some((line, time)) = times.iter().find(|(_, time)| *time <= 0.0) {
        return Err(t
            .bad("T_s", format!("found {time}"))
            .at_line(*line)
            .expected("a relaxation time above 0 s"));
    }
    if let Some(pair) = times.windows(2).find(|p| p[1].1 < p[0].1) {
        return Err(t
            .bad("T_s", format!("{} follows {}", pair[1].1, pair[0].1))
            .at_line(pair[1].0)
            .expected("relaxation times that rise")
            .action("put the branches in order, and their moduli in mu_Pa in the same order"));
    }
    let locking = t.need_positive("J")?;
    Ok(FilmEntry {
        mu_pa: with_errors(t, &mu, ["mu_Pa", "mu_Pa_std_error", "mu_Pa_ci95"])?,
        relaxation_time_s: with_errors(t, &times, ["T_s", "T_s_std_error", "T_s_ci95"])?,
        locking: with_error(t, locking, ["J_std_error", "J_ci95"])?,
        eps_r: match t.positive("eps_r")? {
            Some(eps_r) => Some(with_error(t, eps_r, ["eps_r_std_error", "eps_r_ci95"])?),
            None => None,
        },
    })
}

fn read_forearm(t: &Keys<'_>) -> Result<ForearmEntry, Error> {
    let torque = need_list(t, "torque_N_m")?;
    let nodes = match list(t, "nodes_deg", false)? {
        Some(nodes) => nodes,
        None => {
            return Err(t.missing(
                "nodes_deg",
                "add `nodes_deg = [...]` (angles of the torques)",
            ));
        }
    };
    if nodes.len() != torque.len() {
        return Err(t
            .bad(
                "torque_N_m",
                format!("found {} torques at {} nodes", torque.len(), nodes.len()),
            )
            .expected(format!("{} torques", nodes.len()))
            .action("give one torque for each angle in nodes_deg"));
    }
    if nodes.len() < 2 {
        return Err(t
            .bad("nodes_deg", format!("found {} nodes", nodes.len()))
            .expected("two nodes or more")
            .action("a torque that is the same everywhere has two nodes with the same torque"));
    }
    let falls = |p: &&[(u64, f64)]| p[1].1.to_radians() <= p[0].1.to_radians();
    if let Some(pair) = nodes.windows(2).find(falls) {
        return Err(t
            .bad("nodes_deg", format!("{} follows {}", pair[1].1, pair[0].1))
            .at_line(pair[1].0)
            .expected("angles that rise")
            .action("put the nodes in order, and their torques in torque_N_m in the same order"));
    }
    Ok(ForearmEntry {
        torque_n_m: with_errors(
            t,
            &torque,
            ["torque_N_m", "torque_N_m_std_error", "torque_N_m_ci95"],
        )?,
        nodes_deg: nodes.into_iter().map(|n| n.1).collect(),
    })
}

fn read_effect(t: &Keys<'_>) -> Result<Effect, Error> {
    let id: String = t.need("id")?;
    if !is_name(&id) {
        return Err(t
            .bad("id", format!("found \"{}\"", one_line(&id)))
            .expected(
                "the id of an effect, such as \"series_resistance\"; your own begin with x_",
            ));
    }
    let actuators = match t.list("actuators")? {
        None => vec![1, 2, 3],
        Some(entries) => {
            let mut out: Vec<usize> = Vec::new();
            for (line, v) in entries {
                let number = i64::from_toml(v).and_then(|n| usize::try_from(n).ok());
                match number {
                    Some(n @ 1..=3) if !out.contains(&n) => out.push(n),
                    _ => {
                        return Err(t
                            .bad("actuators", format!("found {}", describe(v)))
                            .at_line(line)
                            .expected("actuators 1, 2 or 3, each once"));
                    }
                }
            }
            if out.is_empty() {
                return Err(t
                    .bad("actuators", "found an empty list")
                    .expected("at least one of 1, 2, 3")
                    .action("remove the effect if it acts nowhere"));
            }
            out
        }
    };
    let lines = t.entries().into_iter();
    Ok(Effect {
        id,
        actuators,
        values: read_values(t, EFFECT)?,
        lines: Lines(lines.map(|(key, line, _)| (key.to_owned(), line)).collect()),
    })
}

/// Every key but those in `known`.
fn read_values(t: &Keys<'_>, known: &[&str]) -> Result<Values, Error> {
    let mut out = Values::new();
    for (name, line, v) in t.entries() {
        if known.contains(&name) {
            continue;
        }
        if !is_name(name) {
            return Err(t
                .bad_entry(
                    name,
                    line,
                    "found a name with other characters, or a long one",
                )
                .expected("a letter, then letters, digits and _, at most 63"));
        }
        let gaps = name.ends_with("_std_error") || name.ends_with("_ci95");
        let Some(value) = plain(v, gaps) else {
            return Err(t
                .bad_entry(name, line, format!("found {}", describe(odd(v, gaps))))
                .expected("a finite number, a word, true, false, or a list of them"));
        };
        out.push((name.to_owned(), value));
    }
    Ok(out)
}

/// The innermost entry that is not [`plain`].
fn odd<'a, 'b>(v: &'a DeValue<'b>, gaps: bool) -> &'a DeValue<'b> {
    let inner = v.as_array().and_then(|list| {
        let mut entries = list.iter().map(|e| e.get_ref());
        entries.find(|e| plain(e, gaps).is_none())
    });
    inner.map_or(v, |e| odd(e, gaps))
}

/// Numbers, words and lists of them.
fn plain(v: &DeValue<'_>, gaps: bool) -> Option<toml::Value> {
    Some(match v {
        DeValue::Integer(_) => toml::Value::Integer(i64::from_toml(v)?),
        DeValue::Float(_) => toml::Value::Float(any_number(v).filter(|n| gaps || n.is_finite())?),
        DeValue::String(s) => toml::Value::String(s.clone().into_owned()),
        DeValue::Boolean(b) => toml::Value::Boolean(*b),
        DeValue::Array(list) => toml::Value::Array(
            list.iter()
                .map(|e| plain(e.get_ref(), gaps))
                .collect::<Option<_>>()?,
        ),
        DeValue::Datetime(_) | DeValue::Table(_) => return None,
    })
}

fn read_file_sum(t: &Keys<'_>) -> Result<FileSum, Error> {
    Ok(FileSum {
        role: t.need("role")?,
        file: t.need("file")?,
        sha256: t.need("sha256")?,
    })
}

fn read_provenance(t: &Keys<'_>) -> Result<Provenance, Error> {
    let rig = match t.table("rig", FILE)? {
        Some(rig) => Some(read_file_sum(&rig)?),
        None => None,
    };
    let mut recordings = Vec::new();
    for r in t.tables("recording", RECORDING)? {
        recordings.push(RecordingSum {
            id: r.need("id")?,
            files: r
                .tables("files", FILE)?
                .iter()
                .map(read_file_sum)
                .collect::<Result<_, _>>()?,
        });
    }
    Ok(Provenance {
        program: t.get("program")?.unwrap_or_default(),
        command: t.get("command")?.unwrap_or_default(),
        rig,
        recordings,
        ..Provenance::default()
    })
}

/// A list in which NaN is null.
type Nullable = Vec<Option<f64>>;

fn finite(v: f64) -> Option<f64> {
    v.is_finite().then_some(v)
}

/// Parameters as JSON: the tables and keys of `parameters.toml`, NaN as null.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[schemars(title = "parameters.toml")]
pub struct ParametersJson {
    /// The film.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub film: Option<FilmJson>,
    /// Spring-back torque of the forearms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub forearm: Option<ForearmJson>,
    /// A single axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<serde_json::Map<String, serde_json::Value>>,
    /// Causes that the plain model leaves out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub effect: Vec<EffectJson>,
    /// When the recordings of a diagnosis were made.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub series: Vec<SeriesEntry>,
    /// What the values were made of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
}

/// `[film]`.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[allow(non_snake_case)]
pub struct FilmJson {
    /// Moduli of the n + 1 springs, Pa, the equilibrium spring first.
    pub mu_Pa: Vec<f64>,
    /// Their standard errors, Pa.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu_Pa_std_error: Option<Nullable>,
    /// Their 95 % intervals, Pa.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mu_Pa_ci95: Option<Vec<[Option<f64>; 2]>>,
    /// Relaxation times of the n branches, s, rising.
    pub T_s: Vec<f64>,
    /// Their standard errors, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub T_s_std_error: Option<Nullable>,
    /// Their 95 % intervals, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub T_s_ci95: Option<Vec<[Option<f64>; 2]>>,
    /// Locking constant.
    pub J: f64,
    /// Its standard error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub J_std_error: Option<f64>,
    /// Its 95 % interval.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub J_ci95: Option<[Option<f64>; 2]>,
    /// Relative permittivity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eps_r: Option<f64>,
    /// Its standard error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eps_r_std_error: Option<f64>,
    /// Its 95 % interval.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eps_r_ci95: Option<[Option<f64>; 2]>,
}

/// `[forearm]`.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
#[allow(non_snake_case)]
pub struct ForearmJson {
    /// Node angles, deg, rising.
    pub nodes_deg: Vec<f64>,
    /// Nodal torques, N m.
    pub torque_N_m: Vec<f64>,
    /// Their standard errors, N m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_N_m_std_error: Option<Nullable>,
    /// Their 95 % intervals, N m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torque_N_m_ci95: Option<Vec<[Option<f64>; 2]>>,
}

/// `[[effect]]`.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct EffectJson {
    /// Which.
    pub id: String,
    /// Actuators (1 to 3) on which it acts.
    pub actuators: Vec<usize>,
    /// Its own values; of one that was learnt, lists of numbers, words and rows.
    #[serde(flatten)]
    pub values: serde_json::Map<String, serde_json::Value>,
}

fn json_values(values: &Values) -> serde_json::Map<String, serde_json::Value> {
    fn one(v: &toml::Value) -> serde_json::Value {
        match v {
            toml::Value::Float(v) => (*v).into(),
            toml::Value::Integer(v) => (*v).into(),
            toml::Value::Boolean(v) => (*v).into(),
            toml::Value::String(v) => v.as_str().into(),
            toml::Value::Array(list) => list.iter().map(one).collect(),
            toml::Value::Datetime(_) | toml::Value::Table(_) => serde_json::Value::Null,
        }
    }
    values.iter().map(|(n, v)| (n.clone(), one(v))).collect()
}

impl ParametersJson {
    fn of(file: &ParameterFile) -> Self {
        let list = |l: &[Quantity]| l.iter().map(|q| q.value).collect::<Vec<f64>>();
        let errors = |l: &[Quantity]| {
            l.iter()
                .any(|q| !q.std_error.is_nan())
                .then(|| l.iter().map(|q| finite(q.std_error)).collect::<Nullable>())
        };
        let ends = |q: &Quantity| q.ci95.map(finite);
        let some = |q: &Quantity| q.ci95.iter().any(|v| !v.is_nan());
        let intervals = |l: &[Quantity]| {
            l.iter()
                .any(some)
                .then(|| l.iter().map(ends).collect::<Vec<_>>())
        };
        let one = |q: &Quantity| some(q).then(|| ends(q));
        ParametersJson {
            film: file.film.as_ref().map(|f| FilmJson {
                mu_Pa: list(&f.mu_pa),
                mu_Pa_std_error: errors(&f.mu_pa),
                mu_Pa_ci95: intervals(&f.mu_pa),
                T_s: list(&f.relaxation_time_s),
                T_s_std_error: errors(&f.relaxation_time_s),
                T_s_ci95: intervals(&f.relaxation_time_s),
                J: f.locking.value,
                J_std_error: finite(f.locking.std_error),
                J_ci95: one(&f.locking),
                eps_r: f.eps_r.map(|q| q.value),
                eps_r_std_error: f.eps_r.and_then(|q| finite(q.std_error)),
                eps_r_ci95: f.eps_r.and_then(|q| one(&q)),
            }),
            forearm: file.forearm.as_ref().map(|f| ForearmJson {
                nodes_deg: f.nodes_deg.clone(),
                torque_N_m: list(&f.torque_n_m),
                torque_N_m_std_error: errors(&f.torque_n_m),
                torque_N_m_ci95: intervals(&f.torque_n_m),
            }),
            axis: (!file.axis.is_empty()).then(|| json_values(&file.axis)),
            effect: file
                .effects
                .iter()
                .map(|e| EffectJson {
                    id: e.id.clone(),
                    actuators: e.actuators.clone(),
                    values: json_values(&e.values),
                })
                .collect(),
            series: file.series.clone(),
            provenance: (file.provenance != Provenance::default()).then(|| file.provenance.clone()),
        }
    }
}
