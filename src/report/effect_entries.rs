//! Causes of the catalogue to `[[effect]]` of a parameter file and back, under the names and units that the
//! catalogue promises.

use std::path::Path;

use super::learnt_entry;
use super::parameter_file::{Effect, FilmEntry, Lines, ParameterFile, SeriesEntry, Values};
use crate::calibration::{AxisCause, LineModel};
use crate::diagnosis::{Candidate, Value};
use crate::effects::{Acting, CATALOGUE, Quantity, Reach, by_id, learnt, line};
use crate::recording::{Error, ErrorKind, suggestion};

/// Number of a recording that is in no series: what happens there never happens.
const NEVER: f64 = 1e6;

/// The values of a candidate under one name of the file: one, or the three of a vector.
pub struct Named<'a> {
    /// Name, as files write it.
    pub name: &'static str,
    /// Its one value, or three.
    pub values: Vec<&'a Value>,
}

/// The values of a candidate by the names of the file, in the catalogue's order.
#[must_use]
pub fn named(candidate: &Candidate) -> Vec<Named<'_>> {
    let quantities = candidate.acting.effect.parameters();
    let mut out: Vec<Named> = Vec::new();
    for value in &candidate.values {
        let known = quantities.iter().find(|q| q.name == value.name);
        let (name, place) = known.map_or((value.name, None), |q| q.part());
        match out.iter_mut().find(|n| place.is_some() && n.name == name) {
            Some(vector) => vector.values.push(value),
            None => out.push(Named {
                name,
                values: vec![value],
            }),
        }
    }
    out
}

/// Actuators 1 to 3.
#[must_use]
pub fn actuators(on: [bool; 3]) -> Vec<usize> {
    (1..=3).filter(|k| on[k - 1]).collect()
}

/// The word that a value stands for: a form, or the recording of that number in the series (the number itself
/// where none has it).
#[must_use]
pub fn word(value: &Value, series: &[SeriesEntry]) -> Option<String> {
    let named = || {
        let entry = series.iter().find(|e| e.number as f64 == value.value);
        entry.map_or_else(|| value.value.to_string(), |e| e.id.clone())
    };
    let recording = (value.name == "recording").then(named);
    value.word.clone().or(recording)
}

/// Splits at commas that stand outside brackets.
fn parts(text: &str) -> Vec<&str> {
    let (mut out, mut first, mut depth) = (Vec::new(), 0, 0_usize);
    for (i, c) in text.char_indices() {
        match c {
            '[' => depth += 1,
            ']' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => {
                out.push(&text[first..i]);
                first = i + 1;
            }
            _ => {}
        }
    }
    out.push(&text[first..]);
    out
}

/// A number, a list (`[1,2,3]` or `1/2/3`) or a word.
fn value_of(name: &str, text: &str) -> toml::Value {
    let word = || toml::Value::String(text.to_owned());
    if name == "recording" {
        return word();
    }
    let numbers = |list: &str, comma: char| {
        let parse = |part: &str| part.trim().parse().map(toml::Value::Float);
        list.split(comma).map(parse).collect::<Result<Vec<_>, _>>()
    };
    let inside = text.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
    let list = match inside {
        Some(list) => numbers(list, ','),
        None => numbers(text, '/'),
    };
    match list {
        Ok(mut one) if one.len() == 1 && inside.is_none() => one.remove(0),
        Ok(list) => toml::Value::Array(list),
        Err(_) => word(),
    }
}

impl std::str::FromStr for Effect {
    type Err = String;

    /// `ID:NAME=VALUE[,NAME=VALUE...][@ACTUATOR[,ACTUATOR]]`, as `--effect` takes it; all actuators where
    /// none is named. Vectors are lists, `offset=1e-3/0/0` or `offset=[1e-3,0,0]`, or go by their parts,
    /// `offset_x=1e-3`. Whether there is such a cause with such names, [`Effect::check`] says.
    fn from_str(text: &str) -> Result<Self, String> {
        let (text, place) = match text.rsplit_once('@') {
            Some((text, place)) => (text, Some(place)),
            None => (text, None),
        };
        let (id, list) = text
            .split_once(':')
            .ok_or("expected ID:NAME=VALUE, such as series_resistance:resistance=1e7")?;
        let mut values = Values::new();
        for pair in parts(list) {
            let (name, value) = pair
                .split_once('=')
                .ok_or_else(|| format!("`{pair}` is not NAME=VALUE"))?;
            let (name, value) = (name.trim(), value.trim());
            if values.iter().any(|(n, _)| n == name) {
                return Err(format!("`{name}` stands twice"));
            }
            values.push((name.to_owned(), value_of(name, value)));
        }
        let actuators = match place {
            None => vec![1, 2, 3],
            Some(list) => list
                .split(',')
                .map(|k| match k.trim().parse() {
                    Ok(k @ 1..=3) => Ok(k),
                    _ => Err(format!("`{k}` is no actuator: 1, 2 or 3")),
                })
                .collect::<Result<_, String>>()?,
        };
        Ok(Effect {
            id: id.trim().to_owned(),
            actuators,
            values,
            lines: Lines::default(),
        })
    }
}

impl Effect {
    /// Whether the catalogue has such a cause with such names, and the values can be.
    ///
    /// # Errors
    /// The sentence that [`ParameterFile::acting`] has for it, without a file.
    pub fn check(&self) -> Result<(), String> {
        if self.id == learnt::ID {
            return Err(
                "`learnt` stands for a term that was learnt, with its form and its coefficients: it stands in a parameter file, under [[effect]]; name that file".into(),
            );
        }
        let text = match acting(self, Path::new(""), CATALOGUE, &|_| None) {
            Ok(_) => return Ok(()),
            Err(error) => error.to_string(),
        };
        Err(text.trim_start_matches(", [[effect]] ").to_owned())
    }

    /// Whether a moment is stated without its recording: the one that is simulated or predicted is meant.
    #[must_use]
    pub fn moment_here(&self) -> bool {
        let has = |name: &str| self.values.iter().any(|(n, _)| n == name);
        let quantities = by_id(&self.id).map_or(&[][..], |e| e.parameters());
        quantities.iter().any(|q| q.name == "recording") && !has("recording")
    }

    /// The entry of a cause that a diagnosis of the recordings `series` found.
    #[must_use]
    pub fn of(candidate: &Candidate, series: &[SeriesEntry]) -> Self {
        let mut values = Values::new();
        for Named { name, values: own } in named(candidate) {
            if let [value] = own[..] {
                if let Some(word) = word(value, series) {
                    values.push((name.into(), toml::Value::String(word)));
                    continue;
                }
                if !value.fitted.is_finite() {
                    continue; // off, as when it is not there
                }
            }
            let numbers = |of: &dyn Fn(&Value) -> toml::Value| match &own[..] {
                [one] => of(one),
                many => toml::Value::Array(many.iter().map(|v| of(v)).collect()),
            };
            let float = toml::Value::Float;
            values.push((name.into(), numbers(&|v| float(v.fitted))));
            if own.iter().any(|v| v.value != v.fitted) {
                values.push((format!("{name}_estimate"), numbers(&|v| float(v.value))));
            }
            if own.iter().any(|v| v.std_error.is_finite()) {
                let errors = numbers(&|v| float(v.std_error));
                values.push((format!("{name}_std_error"), errors));
                let ends = numbers(&|v| toml::Value::Array(v.ci95.map(float).to_vec()));
                values.push((format!("{name}_ci95"), ends));
            }
        }
        Effect {
            id: candidate.acting.effect.id().into(),
            actuators: actuators(candidate.acting.on),
            values,
            lines: Lines::default(),
        }
    }

    /// The entry of a cause that was fitted with the motion of an axis.
    #[must_use]
    pub fn of_line(cause: &AxisCause) -> Self {
        let float = toml::Value::Float;
        let mut values = Values::new();
        let quantities = cause.acting.effect.parameters().iter();
        for (q, e) in quantities.zip(&cause.estimates) {
            values.push((q.name.into(), float(e.value)));
            if e.std_error.is_finite() {
                values.push((format!("{}_std_error", q.name), float(e.std_error)));
                let ends = toml::Value::Array(e.ci95.map(float).to_vec());
                values.push((format!("{}_ci95", q.name), ends));
            }
        }
        Effect {
            id: cause.acting.effect.id().into(),
            actuators: actuators(cause.acting.on),
            values,
            lines: Lines::default(),
        }
    }

    /// What the estimates beside fitted values are, where there are any.
    pub(super) fn about_estimates(&self) -> Option<&'static str> {
        let estimated = |(name, _): &(String, toml::Value)| name.ends_with("_estimate");
        self.values.iter().any(estimated).then_some(
            "X predicts best from motion as noisy as this; X_estimate is freed of what the noise does to it: X_std_error and X_ci95 are its own.",
        )
    }
}

impl ParameterFile {
    /// The causes of the file, and what was learnt, as the model applies them. `number_of` gives the number
    /// of a recording in the series of what is to be predicted; `None` when it belongs to another series: a
    /// change at a moment there never happens.
    ///
    /// # Errors
    /// An id or a name that is not in the catalogue (the nearest is named), or a value that cannot be; of
    /// several learnt terms the key says which.
    pub fn acting(&self, number_of: &dyn Fn(&str) -> Option<usize>) -> Result<Vec<Acting>, Error> {
        self.of_rig(CATALOGUE, false, number_of)
    }

    /// The causes of the file among those that are `known`, and what was learnt: of a robot, or along a single
    /// coordinate.
    fn of_rig(
        &self,
        known: &[&'static dyn crate::effects::Effect],
        along_coordinate: bool,
        number_of: &dyn Fn(&str) -> Option<usize>,
    ) -> Result<Vec<Acting>, Error> {
        let terms = self.effects.iter().filter(|e| e.id == learnt::ID).count();
        let mut number = 0;
        let mut one = |e: &Effect| {
            if e.id != learnt::ID {
                return acting(e, &self.path, known, number_of);
            }
            number += 1;
            let name = match terms {
                1 => e.id.clone(),
                _ => format!("{} {number}", e.id),
            };
            learnt_entry::acting(e, &self.path, &name, along_coordinate)
        };
        let mut acting = |e: &Effect| one(e).map_err(|error| e.at_line(error));
        self.effects.iter().map(&mut acting).collect()
    }

    /// Whether every cause of the file is one of a robot or of a single coordinate, or a user's own, whose id
    /// begins with `x_`.
    ///
    /// # Errors
    /// The first that is not, with its line and the nearest.
    pub fn known_causes(&self) -> Result<(), Error> {
        let mut known: Vec<&'static dyn crate::effects::Effect> = CATALOGUE.to_vec();
        let both = |e: &&dyn crate::effects::Effect| by_id(e.id()).is_some();
        known.extend(along_coordinate().filter(|e| !both(e)));
        let own = |e: &&Effect| e.id != learnt::ID && !e.id.starts_with("x_");
        let mut entries = self.effects.iter().filter(own);
        entries.try_for_each(|e| {
            let found = known_effect(e, &self.path, &known);
            found.map(drop).map_err(|error| e.at_line(error))
        })
    }

    /// The model of a single coordinate: constants, film, curve, and its causes in the units of the
    /// recordings.
    ///
    /// # Errors
    /// An id or a name that the catalogue of single coordinates does not have (the nearest is named), or a
    /// value that cannot be.
    pub fn line_model(&self) -> Result<LineModel, Error> {
        let known: Vec<_> = along_coordinate().collect();
        let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|i| i as f64));
        Ok(LineModel {
            values: self
                .axis
                .iter()
                .filter_map(|(name, v)| Some((name.clone(), number(v)?)))
                .collect(),
            film: self.film.as_ref().map(FilmEntry::film),
            curve: self
                .forearm
                .as_ref()
                .map(|_| self.forearm_torque())
                .transpose()?,
            effects: self.of_rig(&known, true, &|_| None)?,
            when: Vec::new(),
        })
    }
}

/// The causes of a single coordinate.
fn along_coordinate() -> impl Iterator<Item = &'static dyn crate::effects::Effect> {
    line::every().map(|e| e as &'static dyn crate::effects::Effect)
}

/// The cause of an entry among those that are known; `path` is for messages.
fn acting(
    entry: &Effect,
    path: &Path,
    known: &[&'static dyn crate::effects::Effect],
    number_of: &dyn Fn(&str) -> Option<usize>,
) -> Result<Acting, Error> {
    let effect = known_effect(entry, path, known)?;
    let on = [1, 2, 3].map(|k| entry.actuators.contains(&k));
    if effect.reach() == Reach::All && on != [true; 3] {
        let found = format!("found actuators {:?}", entry.actuators);
        return Err(bad(path, format!("[[effect]] {}", entry.id), found)
            .expected("all three, because this cause knows no actuator")
            .action("name no actuator"));
    }
    let mut acting = Acting::off(effect, on);
    let quantities = effect.parameters();
    let mut names: Vec<&str> = Vec::new();
    for q in quantities {
        let name = q.part().0;
        if !names.contains(&name) {
            names.push(name);
        }
    }
    for (key, value) in &entry.values {
        let plain = key
            .strip_suffix("_std_error")
            .or_else(|| key.strip_suffix("_estimate"))
            .or_else(|| key.strip_suffix("_ci95"));
        if plain.is_some_and(|p| names.contains(&p)) {
            continue;
        }
        let place = format!("[[effect]] {} {key}", entry.id);
        let places: Vec<usize> = (0..quantities.len())
            .filter(|&i| quantities[i].part().0 == key || quantities[i].name == key)
            .collect();
        if places.is_empty() {
            return Err(Error::new(ErrorKind::UnknownKey, path, "unknown name")
                .at_key(place)
                .action(suggestion(key, &names)));
        }
        let given: Vec<&toml::Value> = match value {
            toml::Value::Array(list) => list.iter().collect(),
            one => vec![one],
        };
        if given.len() != places.len() {
            let found = format!("found {} value(s)", given.len());
            return Err(bad(path, place, found).expected(format!(
                "{} in {}",
                places.len(),
                quantities[places[0]].unit
            )));
        }
        for (&at, value) in places.iter().zip(given) {
            let forms = if at == 0 { effect.variants() } else { &[] };
            let wrong = |found: String| bad(path, &place, found);
            let number = number(value, &quantities[at], forms, number_of, &wrong)?;
            acting.values[at] = in_range(number, &quantities[at], &wrong)?;
        }
    }
    if entry.values.is_empty() {
        let found = "found none of its values, and without it does nothing";
        return Err(bad(path, format!("[[effect]] {}", entry.id), found)
            .action(format!("state {}", names.join(", "))));
    }
    Ok(acting)
}

/// The error for a value that cannot be.
fn bad(path: &Path, key: impl Into<String>, what: impl Into<String>) -> Error {
    Error::new(ErrorKind::BadValue, path, what).at_key(key)
}

/// The cause of that id.
fn known_effect(
    entry: &Effect,
    path: &Path,
    known: &[&'static dyn crate::effects::Effect],
) -> Result<&'static dyn crate::effects::Effect, Error> {
    known
        .iter()
        .copied()
        .find(|e| e.id() == entry.id)
        .ok_or_else(|| {
            let ids: Vec<&str> = known.iter().map(|e| e.id()).collect();
            let found = format!("no cause of the catalogue is called `{}`", entry.id);
            bad(path, "[[effect]] id", found).action(suggestion(&entry.id, &ids))
        })
}

/// The number that a value stands for: of a recording in the series, of a form, or itself.
fn number(
    value: &toml::Value,
    q: &Quantity,
    forms: &[&str],
    number_of: &dyn Fn(&str) -> Option<usize>,
    wrong: &dyn Fn(String) -> Error,
) -> Result<f64, Error> {
    #[allow(clippy::cast_precision_loss)]
    Ok(match value {
        toml::Value::Integer(v) if q.name == "recording" => {
            number_of(&v.to_string()).map_or(NEVER, |n| n as f64)
        }
        toml::Value::Float(v) => *v,
        toml::Value::Integer(v) => *v as f64,
        toml::Value::String(word) if q.name == "recording" => {
            number_of(word).map_or(NEVER, |n| n as f64)
        }
        toml::Value::String(word) if !forms.is_empty() => {
            let form = forms.iter().position(|f| f == word);
            form.ok_or_else(|| wrong(format!("found \"{word}\"")).action(suggestion(word, forms)))?
                as f64
        }
        other => {
            return Err(wrong(format!("found {other}")).expected(a_number(q)));
        }
    })
}

/// A positive lower bound is a size that must not vanish: a time, an edge, a thickness.
fn in_range(number: f64, q: &Quantity, wrong: &dyn Fn(String) -> Error) -> Result<f64, Error> {
    let low = (q.lower >= 0.0 && number < 0.0) || (q.lower > 0.0 && number == 0.0);
    let high = q.unit == "1" && q.lower == 0.0 && q.size && number > 1.0;
    if number.is_finite() && !low && !high {
        return Ok(number);
    }
    let from = if q.lower > 0.0 {
        "above 0"
    } else if q.lower == 0.0 {
        "from 0 up"
    } else {
        "finite"
    };
    let to = if high { ", at most 1" } else { "" };
    Err(wrong(format!("found {number}")).expected(format!("{}, {from}{to}", a_number(q))))
}

/// What a value has to be.
fn a_number(q: &Quantity) -> String {
    match q.unit {
        "1" => "a number".to_owned(),
        unit => format!("a number in {unit}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(entry: &str) -> ParameterFile {
        let text = format!("[film]\nmu_Pa = [1e6]\nT_s = []\nJ = 80.0\n[[effect]]\n{entry}\n");
        ParameterFile::parse(std::path::Path::new("p.toml"), &text).unwrap()
    }

    fn read(entry: &str) -> Result<Acting, String> {
        let number = |id: &str| (id == "s/03-sine").then_some(3);
        let mut all = file(entry).acting(&number).map_err(|e| e.to_string())?;
        Ok(all.remove(0))
    }

    #[test]
    fn names_words_and_vectors_become_values() {
        let a = read("id = \"series_resistance\"\nactuators = [2]\nresistance = 9.8e6\nresistance_ci95 = [9e6, 1e7]").unwrap();
        assert_eq!((a.values, a.on), (vec![9.8e6, 0.0], [false, true, false]));
        let a = read("id = \"frame_tilt\"\nrotation = [0.0, 0.01, -0.02]").unwrap();
        assert_eq!(a.values, [0.0, 0.01, -0.02]);
        let a = read("id = \"link_length_error\"\nlink = \"q\"\nrelative_error = 0.01").unwrap();
        assert_eq!(a.values, [2.0, 0.01]);
        let a =
            read("id = \"payload_change\"\nmass = 0.002\ntime = 3.5\nrecording = \"s/03-sine\"");
        assert_eq!(a.unwrap().values, [0.002, 3.5, 3.0]);
        let a = read("id = \"payload_change\"\nmass = 0.002\ntime = 3.5\nrecording = \"other\"");
        assert_eq!(a.unwrap().values[2], NEVER);
        let a = read("id = \"slew_limit\"\nrate_up = 5000").unwrap();
        assert_eq!(a.values, [5000.0, f64::INFINITY]);
    }

    #[test]
    fn an_argument_becomes_an_entry() {
        let e: Effect = "slew_limit:rate_up=5e3,rate_down=4000@2".parse().unwrap();
        let file = ParameterFile {
            effects: vec![e],
            ..ParameterFile::default()
        };
        let limited = file.acting(&|_| None).unwrap().remove(0);
        assert_eq!(limited.values, [5e3, 4e3]);
        assert_eq!(limited.on, [false, true, false]);
        let values = |text: &str| {
            let entry: Effect = text.parse().unwrap();
            entry.check().unwrap();
            assert_eq!(entry.actuators, [1, 2, 3]);
            acting(&entry, Path::new(""), CATALOGUE, &|id| {
                (id == "s/3").then_some(3)
            })
            .map(|a| a.values)
        };
        for vector in [
            "offset=1e-3/0/-2e-3",
            "offset=[1e-3, 0, -2e-3]",
            "offset_x=1e-3,offset_z=-2e-3",
        ] {
            let values = values(&format!("marker_offset:{vector}")).unwrap();
            assert_eq!(values, [1e-3, 0.0, -2e-3], "{vector}");
        }
        let link = values("link_length_error:link=n0,relative_error=0.01").unwrap();
        assert_eq!(link, [3.0, 0.01]);
        let failed = values("electrode_failure:fraction=0.2,time=4,recording=s/3").unwrap();
        assert_eq!(failed, [0.2, 4.0, 3.0]);
        for wrong in [
            "slew_limit",
            "slew_limit:rate_up",
            "slew_limit:rate_up=1@4",
            "slew_limit:rate_up=1,rate_up=2",
        ] {
            assert!(wrong.parse::<Effect>().is_err(), "{wrong}");
        }
        for (wrong, words) in [
            (
                "slew_limits:rate_up=1",
                &["`slew_limits`", "slew_limit"][..],
            ),
            ("slew_limit:rateup=1", &["slew_limit rateup", "rate_up"]),
            ("slew_limit:rate_up=0", &["found 0", "V/s, above 0"]),
            (
                "electrode_failure:fraction=1.5",
                &["found 1.5", "at most 1"],
            ),
            ("frame_tilt:rotation=0.1", &["1 value", "3 in rad"]),
            ("time_offset:offset=soon", &["\"soon\"", "a number in s"]),
            ("time_offset:offset=0.1@2", &["[2]", "name no actuator"]),
        ] {
            let text = wrong.parse::<Effect>().unwrap().check().unwrap_err();
            for word in words {
                assert!(text.contains(word), "`{word}` is not in: {text}");
            }
        }
    }

    #[test]
    fn what_is_unknown_is_named_with_what_there_is() {
        for (entry, words) in [
            (
                "id = \"series_resistence\"\nresistance = 1.0",
                vec!["series_resistence", "series_resistance"],
            ),
            (
                "id = \"series_resistance\"\nresistence = 1.0",
                vec!["resistence", "resistance", "p.toml"],
            ),
            (
                "id = \"series_resistance\"\nresistance = -1.0",
                vec!["-1", "ohm"],
            ),
            (
                "id = \"link_length_error\"\nlink = \"z\"",
                vec!["\"z\"", "l_ch"],
            ),
            (
                "id = \"marker_offset\"\noffset = 0.1",
                vec!["1 value", "3 in m"],
            ),
        ] {
            let text = read(entry).unwrap_err();
            for word in words {
                assert!(text.contains(word), "`{word}` is not in: {text}");
            }
        }
    }
}
