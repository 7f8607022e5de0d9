//! Learnt terms to `[[effect]]` of a parameter file and back.
//!
//! ```text
//! [[effect]]
//! id = "learnt"
//! actuators, site, form, variables, unit
//! spline      knots, values
//! ridge       direction, knots, values
//! presliding  formula, coefficients, widths (in the variable's unit)
//! lag         formula, coefficients, times_s
//! wave        formula, coefficients, frequency_Hz
//! potential   formula, coefficients, centres_m, width_m
//! affine      formula, coefficients, about_m
//! oscillator  formula, coefficients, frequency_Hz, damping
//! neighbours, drag  formula, coefficients
//! covariance  of the values or coefficients; may be left out
//! range       [low, high] of each of the variables in the recordings; may be left out
//! ```
//!
//! The formula is for readers: it says what the form computes, and another one is refused.

use std::path::Path;

use nalgebra::{DMatrix, SymmetricEigen};
use toml::Value;

use super::effect_entries::actuators;
use super::parameter_file::{Effect, Lines, Values};
use crate::effects::Acting;
use crate::effects::learnt::{Form, ID, Learnt, Place, Variable};
use crate::recording::{Error, ErrorKind, suggestion};

impl Effect {
    /// The entry of a learnt term with its coefficients and their covariance (row by row; empty where it is
    /// not known, and left out where it is not a finite number for each pair). `None` for a cause of the
    /// catalogue.
    #[must_use]
    pub fn learnt(acting: &Acting, covariance: &[Vec<f64>]) -> Option<Self> {
        let term = acting.effect.learnt()?;
        let n = term.form.count();
        let mut values = Values::new();
        let mut put = |key: &str, value: Value| values.push((key.to_owned(), value));
        put("site", word(term.place.name()));
        put("form", word(term.form.name()));
        let variables = term.form.variables();
        put("variables", list(variables.iter().map(|v| word(v))));
        put("unit", word(term.place.unit()));
        let coefficients = numbers(&acting.values);
        match &term.form {
            Form::Spline { knots, .. } => {
                put("knots", numbers(knots));
                put("values", coefficients);
            }
            Form::Ridge { along, knots } => {
                put("direction", numbers(along));
                put("knots", numbers(knots));
                put("values", coefficients);
            }
            other => {
                put("formula", word(other.formula()));
                put("coefficients", coefficients);
            }
        }
        match &term.form {
            Form::Presliding { ranges, .. } => put("widths", numbers(ranges)),
            Form::Lag { times_s, .. } => put("times_s", numbers(times_s)),
            Form::Wave { frequency_hz, .. } => put("frequency_Hz", (*frequency_hz).into()),
            Form::Potential { centres_m, width_m } => {
                put("centres_m", list(centres_m.iter().map(|c| numbers(c))));
                put("width_m", (*width_m).into());
            }
            Form::Affine { about_m } => put("about_m", numbers(about_m)),
            Form::Oscillator {
                frequency_hz,
                damping,
            } => {
                put("frequency_Hz", (*frequency_hz).into());
                put("damping", (*damping).into());
            }
            Form::Spline { .. } | Form::Ridge { .. } | Form::Neighbours | Form::Drag => {}
        }
        let whole = covariance.len() == n && covariance.iter().all(|row| row.len() == n);
        if whole && covariance.iter().flatten().all(|v| v.is_finite()) {
            // rounding makes both halves of an inverse differ
            let mean = |i: usize, j: usize| 0.5 * covariance[i][j] + 0.5 * covariance[j][i];
            let row = |i: usize| list((0..n).map(|j| mean(i, j).into()));
            put("covariance", list((0..n).map(row)));
        }
        let known = |r: &[f64; 2]| r.iter().all(|v| v.is_finite());
        if term.range.len() == variables.len() && term.range.iter().all(known) {
            put("range", list(term.range.iter().map(|r| numbers(r))));
        }
        Some(Effect {
            id: ID.into(),
            actuators: actuators(acting.on),
            values,
            lines: Lines::default(),
        })
    }
}

impl Effect {
    /// What a learnt entry is, in a sentence; nothing for other entries, or where site or form are unknown.
    pub(super) fn about_learnt(&self) -> Option<String> {
        if self.id != ID {
            return None;
        }
        let text = |key: &str| {
            let found = self.values.iter().find(|(name, _)| name == key);
            found.and_then(|(_, v)| v.as_str())
        };
        let place = text("site").and_then(Place::named)?;
        // of a form the formula stands beside it, but for the two that have knots
        let computes = match text("form")? {
            "spline" => {
                ": the natural cubic spline through the values at the knots, held beyond them, times the second variable where there is one"
            }
            "ridge" => {
                ": along the direction, the natural cubic spline through the values at the knots, held beyond them"
            }
            _ => "",
        };
        Some(format!(
            "Learnt from recordings, where no cause of the catalogue accounts for what is left: {}, {}{computes}.",
            place.says(),
            place.unit()
        ))
    }
}

fn word(text: &str) -> Value {
    Value::String(text.to_owned())
}

fn list(entries: impl Iterator<Item = Value>) -> Value {
    Value::Array(entries.collect())
}

fn numbers(values: &[f64]) -> Value {
    list(values.iter().map(|v| Value::Float(*v)))
}

/// Keys that every form has.
const COMMON: [&str; 4] = ["site", "form", "variables", "unit"];
/// Keys that may be left out.
const OPTIONAL: [&str; 3] = ["formula", "covariance", "range"];
/// Frequencies above this are no file's, Hz: the robot moves below 5 Hz, captures end at some kilohertz.
const HIGHEST_HZ: f64 = 1e4;
/// A mass that is damped this many times its critical damping does not swing.
const HIGHEST_DAMPING: f64 = 10.0;
/// Widths in space below this are finer than any capture, m.
const FINEST_M: f64 = 1e-6;
/// Largest difference of a direction's length from 1.
const LENGTH: f64 = 1e-6;
/// Share of the largest eigenvalue, or of an entry, that rounding may make.
const ROUNDING: f64 = 1e-9;

/// Keys of a form beside those that all have.
fn own_keys(form: &str) -> &'static [&'static str] {
    match form {
        "spline" => &["knots", "values"],
        "ridge" => &["direction", "knots", "values"],
        "presliding" => &["formula", "coefficients", "widths"],
        "lag" => &["formula", "coefficients", "times_s"],
        "wave" => &["formula", "coefficients", "frequency_Hz"],
        "potential" => &["formula", "coefficients", "centres_m", "width_m"],
        "affine" => &["formula", "coefficients", "about_m"],
        "oscillator" => &["formula", "coefficients", "frequency_Hz", "damping"],
        _ => &["formula", "coefficients"],
    }
}

/// The term of an entry with its coefficients; its form stays for as long as the program runs. `name` tells
/// it from the file's other learnt terms; it is one along a single coordinate, or of a robot.
///
/// # Errors
/// A term of another kind of rig, a key that is unknown, missing or of the wrong kind, or a value that cannot
/// be: each with what was found, what may stand there, and what to do.
pub(super) fn acting(
    entry: &Effect,
    path: &Path,
    name: &str,
    along_coordinate: bool,
) -> Result<Acting, Error> {
    let block = Block { entry, path, name };
    let form = block.one_of("form", &Form::NAMES)?;
    let own = own_keys(form);
    let known: Vec<&str> = COMMON
        .iter()
        .chain(own)
        .chain(&OPTIONAL[1..])
        .copied()
        .collect();
    for (key, _) in &entry.values {
        if !known.contains(&key.as_str()) {
            let found = format!("a {form} has no such key");
            return Err(block
                .error(ErrorKind::UnknownKey, key, found)
                .action(suggestion(key, &known)));
        }
    }
    for key in COMMON.iter().chain(own) {
        if !OPTIONAL.contains(key) {
            block.need(key)?;
        }
    }
    let form = block.form(form)?;
    let place = block.place(&form)?;
    if (place == Place::Coordinate) != along_coordinate {
        let [own, other] = match along_coordinate {
            true => ["this bench, axis or coupon", "a robot"],
            false => ["this robot", "a bench, an axis or a coupon"],
        };
        return Err(block
            .bad(
                "site",
                format!("found {}, a term of {other}", word(place.name())),
            )
            .expected(format!("terms of {own}"))
            .action(format!("take the block out, or name a file of {own}")));
    }
    let coefficients = block.coefficients(&form)?;
    block.formula(&form)?;
    block.covariance(coefficients.len())?;
    let range = block.range(&form)?;
    let on = [1, 2, 3].map(|k| entry.actuators.contains(&k));
    if place == Place::Force && on != [true; 3] {
        let found = format!("found actuators {:?}", entry.actuators);
        return Err(block
            .bad("actuators", found)
            .expected("all three, because a force on the end effector knows no actuator")
            .action("leave `actuators` out"));
    }
    Ok(Acting {
        effect: Learnt::new(place, form, range),
        values: coefficients,
        on,
    })
}

/// An entry whose keys are read.
struct Block<'a> {
    entry: &'a Effect,
    path: &'a Path,
    name: &'a str,
}

/// A value in a sentence: itself where that is short.
fn describe(value: &Value) -> String {
    match value {
        Value::Array(list) if list.is_empty() => "an empty list".into(),
        Value::Array(list) => format!("a list of {}", list.len()),
        Value::Table(_) => "a table".into(),
        other => other.to_string(),
    }
}

/// Words as a list in a sentence.
fn quoted(words: &[&str], between: &str) -> String {
    let each: Vec<String> = words.iter().map(|w| word(w).to_string()).collect();
    each.join(between)
}

fn finite(value: &Value) -> Option<f64> {
    #[allow(clippy::cast_precision_loss)]
    let number = match value {
        Value::Float(v) => *v,
        Value::Integer(v) => *v as f64,
        _ => return None,
    };
    number.is_finite().then_some(number)
}

impl<'a> Block<'a> {
    fn error(&self, kind: ErrorKind, key: &str, found: impl Into<String>) -> Error {
        let place = format!("[[effect]] {} {key}", self.name);
        Error::new(kind, self.path, found).at_key(place)
    }

    fn bad(&self, key: &str, found: impl Into<String>) -> Error {
        self.error(ErrorKind::BadValue, key, found)
    }

    fn wrong(&self, key: &str, value: &Value, expected: impl Into<String>) -> Error {
        let found = format!("found {}", describe(value));
        self.error(ErrorKind::WrongType, key, found)
            .expected(expected)
    }

    fn get(&self, key: &str) -> Option<&'a Value> {
        let found = self.entry.values.iter().find(|(name, _)| name == key);
        found.map(|(_, value)| value)
    }

    fn need(&self, key: &str) -> Result<&'a Value, Error> {
        self.get(key).ok_or_else(|| {
            self.error(ErrorKind::MissingKey, key, "the key is missing")
                .action(format!("add `{key} = ...`"))
        })
    }

    /// A word.
    fn word(&self, key: &str) -> Result<&'a str, Error> {
        let value = self.need(key)?;
        value
            .as_str()
            .ok_or_else(|| self.wrong(key, value, "a word"))
    }

    /// One of some words.
    fn one_of(&self, key: &str, known: &[&'static str]) -> Result<&'static str, Error> {
        let found = self.word(key)?;
        let same = known.iter().find(|k| **k == found);
        same.copied().ok_or_else(|| {
            self.bad(key, format!("found {}", word(found)))
                .action(suggestion(found, known))
        })
    }

    /// A number of a list.
    fn finite(&self, key: &str, value: &Value) -> Result<f64, Error> {
        finite(value).ok_or_else(|| {
            self.wrong(key, value, "a finite number")
                .action("give numbers")
        })
    }

    /// One number between two, the lower of which is not allowed where it is 0.
    fn number(&self, key: &str, unit: &str, [low, high]: [f64; 2]) -> Result<f64, Error> {
        let value = self.need(key)?;
        let number = self.finite(key, value)?;
        let inside = number <= high && number >= low && (number > 0.0 || low < 0.0);
        if inside {
            return Ok(number);
        }
        let from = match low {
            0.0 => "above 0".to_owned(),
            low => format!("from {low}"),
        };
        let to = match high {
            f64::MAX => String::new(),
            high => format!(" to {high}"),
        };
        Err(self
            .bad(key, format!("found {number}"))
            .expected(format!("a number in {unit}, {from}{to}")))
    }

    fn entries(&self, key: &str, of: &str) -> Result<&'a [Value], Error> {
        match self.need(key)? {
            Value::Array(list) if !list.is_empty() => Ok(list),
            other => Err(self.wrong(key, other, format!("a list of {of}"))),
        }
    }

    fn numbers(&self, key: &str) -> Result<Vec<f64>, Error> {
        let entries = self.entries(key, "numbers")?;
        entries.iter().map(|v| self.finite(key, v)).collect()
    }

    /// Numbers above 0.
    fn positive(&self, key: &str, unit: &str) -> Result<Vec<f64>, Error> {
        let all = self.numbers(key)?;
        match all.iter().find(|v| **v <= 0.0) {
            None => Ok(all),
            Some(v) => Err(self
                .bad(key, format!("found {v}"))
                .expected(format!("numbers above 0 {unit}"))),
        }
    }

    fn vector(&self, key: &str, value: &Value) -> Result<[f64; 3], Error> {
        let list = value.as_array().map_or(&[][..], Vec::as_slice);
        let each: Vec<f64> = list
            .iter()
            .map(|v| self.finite(key, v))
            .collect::<Result<_, _>>()?;
        each.try_into()
            .map_err(|_| self.wrong(key, value, "three numbers [x, y, z]"))
    }

    /// Rows of numbers.
    fn rows(&self, key: &str) -> Result<Vec<Vec<f64>>, Error> {
        let row = |value: &'a Value| match value {
            Value::Array(list) => list.iter().map(|v| self.finite(key, v)).collect(),
            other => Err(self.wrong(key, other, "a list of numbers for each row")),
        };
        self.entries(key, "lists of numbers")?
            .iter()
            .map(row)
            .collect()
    }

    fn knots(&self, variable: &str) -> Result<Vec<f64>, Error> {
        let knots = self.numbers("knots")?;
        if knots.len() < 2 {
            return Err(self
                .bad("knots", format!("found {} knot", knots.len()))
                .expected("two knots or more")
                .action("what is the same everywhere has two knots with the same value"));
        }
        if let Some(pair) = knots.windows(2).find(|p| p[1] <= p[0]) {
            return Err(self
                .bad("knots", format!("{} follows {}", pair[1], pair[0]))
                .expected(format!("knots of the {variable} that rise"))
                .action(
                    "put them in order, and what belongs to them in `values` and `covariance`",
                ));
        }
        Ok(knots)
    }

    /// The variable at a place of the list, where there is one.
    fn variable(&self, at: usize) -> Result<Option<Variable>, Error> {
        let list = self.entries("variables", "words")?;
        let Some(value) = list.get(at) else {
            return Ok(None);
        };
        let Some(name) = value.as_str() else {
            return Err(self.wrong("variables", value, "a word"));
        };
        let names = Variable::ALL.map(Variable::name);
        let unknown = || {
            self.bad("variables", format!("found {}", word(name)))
                .action(suggestion(name, &names))
        };
        Variable::named(name).map(Some).ok_or_else(unknown)
    }

    /// The first variable.
    fn of(&self) -> Result<Variable, Error> {
        let first = self.variable(0)?;
        // the list is not empty
        Ok(first.expect("a list with entries has a first"))
    }

    fn form(&self, name: &str) -> Result<Form, Error> {
        let frequency = || self.number("frequency_Hz", "Hz", [0.0, HIGHEST_HZ]);
        let form = match name {
            "spline" => {
                let of = self.of()?;
                Form::Spline {
                    of,
                    by: self.variable(1)?,
                    knots: self.knots(of.name())?,
                }
            }
            "presliding" => {
                let of = self.of()?;
                let ranges = self.positive("widths", of.unit())?;
                Form::Presliding { of, ranges }
            }
            "lag" => Form::Lag {
                of: self.of()?,
                by: self.variable(1)?,
                times_s: self.positive("times_s", "s")?,
            },
            "wave" => Form::Wave {
                by: self.variable(1)?,
                frequency_hz: frequency()?,
            },
            "neighbours" => Form::Neighbours,
            "potential" => {
                let centres = self.entries("centres_m", "points [x, y, z]")?.iter();
                Form::Potential {
                    centres_m: centres
                        .map(|c| self.vector("centres_m", c))
                        .collect::<Result<_, _>>()?,
                    width_m: self.number("width_m", "m", [FINEST_M, f64::MAX])?,
                }
            }
            "ridge" => {
                let along = self.vector("direction", self.need("direction")?)?;
                let length = along.iter().map(|v| v * v).sum::<f64>().sqrt();
                if (length - 1.0).abs() > LENGTH {
                    return Err(self
                        .bad("direction", format!("found {along:?} of length {length}"))
                        .expected("a direction of length 1")
                        .action("divide it by its length"));
                }
                let knots = self.knots("position along the direction")?;
                Form::Ridge { along, knots }
            }
            "affine" => Form::Affine {
                about_m: self.vector("about_m", self.need("about_m")?)?,
            },
            "drag" => Form::Drag,
            _ => Form::Oscillator {
                frequency_hz: frequency()?,
                damping: self.damping()?,
            },
        };
        self.same_variables(&form)?;
        Ok(form)
    }

    fn damping(&self) -> Result<f64, Error> {
        let damping = self.finite("damping", self.need("damping")?)?;
        if (0.0..=HIGHEST_DAMPING).contains(&damping) {
            return Ok(damping);
        }
        Err(self
            .bad("damping", format!("found {damping}"))
            .expected(format!(
                "a share of the critical damping, from 0 to {HIGHEST_DAMPING}"
            )))
    }

    /// Whether the list of variables is that of the form.
    fn same_variables(&self, form: &Form) -> Result<(), Error> {
        let list = self.entries("variables", "words")?;
        let mut found = Vec::new();
        for value in list {
            let name = value.as_str();
            found.push(name.ok_or_else(|| self.wrong("variables", value, "a word"))?);
        }
        let expected = form.variables();
        if found == expected {
            return Ok(());
        }
        Err(self
            .bad("variables", format!("found {}", quoted(&found, ", ")))
            .expected(quoted(&expected, ", "))
            .action(format!("a {} has these", form.name())))
    }

    fn place(&self, form: &Form) -> Result<Place, Error> {
        let name = self.one_of("site", &Place::ALL.map(Place::name))?;
        let place = Place::named(name).expect("one of their names");
        let places = form.places();
        if !places.contains(&place) {
            let names: Vec<&str> = places.iter().map(|p| p.name()).collect();
            return Err(self
                .bad(
                    "site",
                    format!(
                        "found {} with a {} of {}",
                        word(name),
                        form.name(),
                        form.variables().join(", ")
                    ),
                )
                .expected(quoted(&names, " or "))
                .action("change the site or the form"));
        }
        let unit = self.word("unit")?;
        if unit != place.unit() {
            return Err(self
                .bad("unit", format!("found {}", word(unit)))
                .expected(format!(
                    "{}, the unit at the site {}",
                    word(place.unit()),
                    word(name)
                ))
                .action("state it, and what the coefficients make in it"));
        }
        Ok(place)
    }

    fn coefficients(&self, form: &Form) -> Result<Vec<f64>, Error> {
        let curve = matches!(form, Form::Spline { .. } | Form::Ridge { .. });
        let key = if curve { "values" } else { "coefficients" };
        let found = self.numbers(key)?;
        let n = form.count();
        if found.len() == n {
            return Ok(found);
        }
        let of = match form {
            Form::Spline { .. } | Form::Ridge { .. } => "one for each of `knots`".to_owned(),
            Form::Presliding { .. } => "one for each of `widths`".into(),
            Form::Lag { .. } => "one for each of `times_s`".into(),
            Form::Potential { .. } => "one for each of `centres_m`".into(),
            other => format!("as many as a {} has", other.name()),
        };
        Err(self
            .bad(key, format!("found {} numbers", found.len()))
            .expected(format!("{n}, {of}"))
            .action("add or remove what is not whole"))
    }

    /// Whether a formula is that of the form: no other is computed.
    fn formula(&self, form: &Form) -> Result<(), Error> {
        if self.get("formula").is_none() {
            return Ok(());
        }
        let found = self.word("formula")?;
        if found == form.formula() {
            return Ok(());
        }
        Err(self
            .bad("formula", format!("found {}", word(found)))
            .expected(word(form.formula()).to_string())
            .action(format!(
                "leave it out: what a {} computes does not follow the text",
                form.name()
            )))
    }

    fn covariance(&self, n: usize) -> Result<(), Error> {
        const KEY: &str = "covariance";
        if self.get(KEY).is_none() {
            return Ok(());
        }
        let rows = self.rows(KEY)?;
        let shape = |found: String| {
            Err(self
                .bad(KEY, found)
                .expected(format!("{n} rows of {n}"))
                .action("give a row and a column for each coefficient, or leave it out"))
        };
        if rows.len() != n {
            return shape(format!("found {} rows", rows.len()));
        }
        if let Some(i) = rows.iter().position(|row| row.len() != n) {
            return shape(format!("row {} has {}", i + 1, rows[i].len()));
        }
        for i in 0..n {
            for j in 0..i {
                let (a, b) = (rows[i][j], rows[j][i]);
                if (a - b).abs() > ROUNDING * a.abs().max(b.abs()) {
                    return Err(self
                        .bad(
                            KEY,
                            format!("{a} in row {}, column {}, and {b} mirrored", i + 1, j + 1),
                        )
                        .expected("a symmetric matrix")
                        .action("make both the same"));
                }
            }
        }
        let largest = rows.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
        if largest == 0.0 {
            return Ok(());
        }
        // divided, so that nothing overflows on the way
        let matrix = DMatrix::from_fn(n, n, |i, j| rows[i.max(j)][i.min(j)] / largest);
        let eigen = SymmetricEigen::try_new(matrix, f64::EPSILON, 1000 * n);
        let Some(values) = eigen.map(|e| e.eigenvalues) else {
            return Err(self
                .bad(KEY, "its eigenvalues cannot be found")
                .expected("a covariance")
                .action("leave it out"));
        };
        let (low, high) = (values.min(), values.max());
        if low < -ROUNDING * high.abs() {
            return Err(self
                .bad(
                    KEY,
                    format!(
                        "its smallest eigenvalue is {:e}, its largest {:e}",
                        low * largest,
                        high * largest
                    ),
                )
                .expected("none below 0")
                .action("no spread is below 0: correct it, or leave it out"));
        }
        Ok(())
    }

    fn range(&self, form: &Form) -> Result<Vec<[f64; 2]>, Error> {
        const KEY: &str = "range";
        if self.get(KEY).is_none() {
            return Ok(Vec::new());
        }
        let rows = self.rows(KEY)?;
        let variables = form.variables();
        if rows.len() != variables.len() {
            return Err(self
                .bad(KEY, format!("found {} of {}", rows.len(), variables.len()))
                .expected(format!("[low, high] of {}", quoted(&variables, ", ")))
                .action("give one for each variable, or leave it out"));
        }
        let mut out = Vec::with_capacity(rows.len());
        for (row, variable) in rows.iter().zip(variables) {
            let [low, high] = row[..] else {
                return Err(self
                    .bad(KEY, format!("found {} numbers of {variable}", row.len()))
                    .expected("two, [low, high]"));
            };
            if low > high {
                return Err(self
                    .bad(KEY, format!("{high} follows {low} of {variable}"))
                    .expected("[low, high], low not above high")
                    .action("exchange them"));
            }
            out.push([low, high]);
        }
        Ok(out)
    }
}
