//! Causes of the catalogue to `[[effect]]` of a parameter file and back, under the names and units that the catalogue promises.

use super::parameter_file::{Effect, ParameterFile, SeriesEntry, Values};
use crate::diagnosis::{Candidate, Value};
use crate::effects::{Acting, CATALOGUE, by_id};
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

/// The word that a value stands for: a form, or the recording of that number in the series (the number itself where none has it).
#[must_use]
pub fn word(value: &Value, series: &[SeriesEntry]) -> Option<String> {
    let named = || {
        let entry = series.iter().find(|e| e.number as f64 == value.value);
        entry.map_or_else(|| value.value.to_string(), |e| e.id.clone())
    };
    let recording = (value.name == "recording").then(named);
    value.word.clone().or(recording)
}

impl std::str::FromStr for Effect {
    type Err = String;

    /// `ID:NAME=VALUE[,NAME=VALUE...][@ACTUATOR[,ACTUATOR]]`, as `--effect` takes it; all actuators where none is named. Vectors go by
    /// their parts: `marker_offset:offset_x=1e-3`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (text, place) = match text.split_once('@') {
            Some((text, place)) => (text, Some(place)),
            None => (text, None),
        };
        let (id, list) = text
            .split_once(':')
            .ok_or("expected ID:NAME=VALUE, such as series_resistance:resistance=1e7")?;
        let values = list
            .split(',')
            .map(|pair| {
                let (name, value) = pair
                    .split_once('=')
                    .ok_or_else(|| format!("`{pair}` is not NAME=VALUE"))?;
                let value = match value.trim().parse::<f64>() {
                    Ok(number) => toml::Value::Float(number),
                    Err(_) => toml::Value::String(value.trim().to_owned()),
                };
                Ok((name.trim().to_owned(), value))
            })
            .collect::<Result<_, String>>()?;
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
        })
    }
}

impl Effect {
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
                if !value.value.is_finite() {
                    continue; // off, as when it is not there
                }
            }
            let numbers = |of: &dyn Fn(&Value) -> toml::Value| match &own[..] {
                [one] => of(one),
                many => toml::Value::Array(many.iter().map(|v| of(v)).collect()),
            };
            let float = toml::Value::Float;
            values.push((name.into(), numbers(&|v| float(v.value))));
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
        }
    }
}

impl ParameterFile {
    /// The causes of the file as the model applies them. `number_of` gives the number of a recording in the series of what is to be
    /// predicted; `None` when it belongs to another series: a change at a moment there never happens.
    ///
    /// # Errors
    /// An id or a name that is not in the catalogue (the nearest is named), or a value that cannot be.
    pub fn acting(&self, number_of: &dyn Fn(&str) -> Option<usize>) -> Result<Vec<Acting>, Error> {
        self.effects
            .iter()
            .map(|e| self.one(e, number_of))
            .collect()
    }

    fn one(
        &self,
        entry: &Effect,
        number_of: &dyn Fn(&str) -> Option<usize>,
    ) -> Result<Acting, Error> {
        let bad = |key: String, what: String| {
            Error::new(ErrorKind::BadValue, &self.path, what).at_key(key)
        };
        let Some(effect) = by_id(&entry.id) else {
            let ids: Vec<&str> = CATALOGUE.iter().map(|e| e.id()).collect();
            return Err(bad(
                "[[effect]] id".into(),
                format!("no cause of the catalogue is called `{}`", entry.id),
            )
            .action(suggestion(&entry.id, &ids)));
        };
        let on = [1, 2, 3].map(|k| entry.actuators.contains(&k));
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
            let place = format!("[[effect]] {} {key}", entry.id);
            let plain = key
                .strip_suffix("_std_error")
                .or_else(|| key.strip_suffix("_ci95"));
            if plain.is_some_and(|p| names.contains(&p)) {
                continue;
            }
            let places: Vec<usize> = (0..quantities.len())
                .filter(|&i| quantities[i].part().0 == key || quantities[i].name == key)
                .collect();
            if places.is_empty() {
                return Err(
                    Error::new(ErrorKind::UnknownKey, &self.path, "unknown name")
                        .at_key(place)
                        .action(suggestion(key, &names)),
                );
            }
            let given: Vec<&toml::Value> = match value {
                toml::Value::Array(list) => list.iter().collect(),
                one => vec![one],
            };
            if given.len() != places.len() {
                return Err(
                    bad(place, format!("found {} value(s)", given.len())).expected(format!(
                        "{} in {}",
                        places.len(),
                        quantities[places[0]].unit
                    )),
                );
            }
            for (&at, value) in places.iter().zip(given) {
                let q = &quantities[at];
                #[allow(clippy::cast_precision_loss)]
                let number = match value {
                    toml::Value::Integer(v) if q.name == "recording" => {
                        number_of(&v.to_string()).map_or(NEVER, |n| n as f64)
                    }
                    toml::Value::Float(v) => *v,
                    toml::Value::Integer(v) => *v as f64,
                    toml::Value::String(word) if q.name == "recording" => {
                        number_of(word).map_or(NEVER, |n| n as f64)
                    }
                    toml::Value::String(word) if at == 0 && !effect.variants().is_empty() => {
                        let forms = effect.variants();
                        let Some(form) = forms.iter().position(|f| f == word) else {
                            return Err(bad(place, format!("found \"{word}\""))
                                .action(suggestion(word, forms)));
                        };
                        form as f64
                    }
                    other => {
                        return Err(bad(place, format!("found {other}"))
                            .expected(format!("a number in {}", q.unit)));
                    }
                };
                if !number.is_finite() || (q.lower >= 0.0 && number < 0.0) {
                    return Err(bad(place, format!("found {number}"))
                        .expected(format!("a number in {}, from {} up", q.unit, q.lower)));
                }
                acting.values[at] = number;
            }
        }
        Ok(acting)
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
        assert_eq!((a.values, a.on), (vec![9.8e6], [false, true, false]));
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
        let acting = file.acting(&|_| None).unwrap().remove(0);
        assert_eq!(acting.values, [5e3, 4e3]);
        assert_eq!(acting.on, [false, true, false]);
        let e: Effect = "marker_offset:offset_z=1e-3".parse().unwrap();
        assert_eq!(e.actuators, [1, 2, 3]);
        for wrong in ["slew_limit", "slew_limit:rate_up", "slew_limit:rate_up=1@4"] {
            assert!(wrong.parse::<Effect>().is_err(), "{wrong}");
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
