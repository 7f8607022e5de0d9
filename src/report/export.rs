//! Parameters for a controller: JSON, a MATLAB script, a Python module, a C header. Every number reads back
//! to the same bits: it is written with the shortest digits that do.

use std::fmt::Write;

use super::parameter_file::{ParameterFile, Quantity, Values};

/// What to export to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// The tables of `parameters.toml` as JSON.
    Json,
    /// A MATLAB (or Octave) script that makes the struct `deacal`.
    Matlab,
    /// A Python module of constants, and the dictionary `PARAMETERS`.
    Python,
    /// A C header of `static const double`, for firmware too: no includes, no floating-point environment.
    C,
}

impl Format {
    /// All of them.
    pub const ALL: [Format; 4] = [Format::Json, Format::Matlab, Format::Python, Format::C];

    /// What the command line calls it; the file extension except for C.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Format::Json => "json",
            Format::Matlab => "m",
            Format::Python => "py",
            Format::C => "c",
        }
    }

    /// Extension of its files.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Format::C => "h",
            other => other.name(),
        }
    }

    /// The format of that name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// The text of a parameter file in another format.
#[must_use]
pub fn export(file: &ParameterFile, format: Format) -> String {
    match format {
        Format::Json => super::json::to_text(&file.to_json()),
        Format::Matlab => render(file, &mut Matlab::default()),
        Format::Python => render(file, &mut Python::default()),
        Format::C => render(file, &mut C::default()),
    }
}

/// A language that constants are written in. A name is given as its table and key.
trait Exporter {
    fn begin(&mut self);
    fn comment(&mut self, text: &str);
    fn scalar(&mut self, table: &str, key: &str, value: f64);
    fn list(&mut self, table: &str, key: &str, values: &[f64]);
    fn effect(&mut self, number: usize, id: &str, actuators: &[usize], values: &Values);
    fn values(&mut self, table: &str, values: &Values);
    fn finish(&mut self) -> String;
}

fn render(file: &ParameterFile, to: &mut dyn Exporter) -> String {
    to.begin();
    to.comment("Calibrated parameters of a dielectric-elastomer robot. Do not edit: export again.");
    for line in head(file) {
        to.comment(&line);
    }
    if let Some(film) = &file.film {
        to.comment("Moduli of the Gent springs, Pa: the equilibrium spring, then one a branch.");
        quantities(to, "film", "mu_Pa", &film.mu_pa);
        to.comment("Relaxation times of the branches, s.");
        quantities(to, "film", "T_s", &film.relaxation_time_s);
        to.comment("Locking constant of the springs, dimensionless.");
        quantity(to, "film", "J", &film.locking);
        if let Some(eps_r) = &film.eps_r {
            to.comment("Relative permittivity of the film, dimensionless.");
            quantity(to, "film", "eps_r", eps_r);
        }
    }
    if let Some(forearm) = &file.forearm {
        to.comment("Spring-back torque of a forearm: natural cubic spline through the nodes, linear beyond them.");
        to.comment("Forearm swing at the nodes, deg.");
        to.list("forearm", "nodes_deg", &forearm.nodes_deg);
        to.comment("Torque at the nodes, N m.");
        quantities(to, "forearm", "torque_N_m", &forearm.torque_n_m);
    }
    if !file.axis.is_empty() {
        to.comment("A single axis; each name ends in its unit.");
        to.values("axis", &file.axis);
    }
    for (i, effect) in file.effects.iter().enumerate() {
        to.comment(&format!("Effect {}: {}", i + 1, effect.id));
        if let Some(says) = effect.about_learnt() {
            to.comment(&says);
        }
        if let Some(says) = effect.about_estimates() {
            to.comment(says);
        }
        to.effect(i + 1, &effect.id, &effect.actuators, &effect.values);
    }
    to.finish()
}

/// Where the parameters come from, a line each.
pub(super) fn head(file: &ParameterFile) -> Vec<String> {
    let p = &file.provenance;
    let mut out = Vec::new();
    if !p.program.is_empty() {
        out.push(format!("Calibrated by {}: {}", p.program, p.command));
    }
    if let Some(rig) = &p.rig {
        out.push(format!("rig {}, SHA-256 {}", rig.file, rig.sha256));
    }
    for r in &p.recordings {
        for f in &r.files {
            out.push(format!(
                "recording {}: {} {}, SHA-256 {}",
                r.id, f.role, f.file, f.sha256
            ));
        }
    }
    out.iter().map(|line| one_line(line)).collect()
}

fn quantities(to: &mut dyn Exporter, table: &str, key: &str, list: &[Quantity]) {
    let values: Vec<f64> = list.iter().map(|q| q.value).collect();
    to.list(table, key, &values);
    let errors: Vec<f64> = list.iter().map(|q| q.std_error).collect();
    if errors.iter().any(|e| !e.is_nan()) {
        to.comment("Their standard errors, in the same unit.");
        to.list(table, &format!("{key}_std_error"), &errors);
    }
}

fn quantity(to: &mut dyn Exporter, table: &str, key: &str, q: &Quantity) {
    to.scalar(table, key, q.value);
    if !q.std_error.is_nan() {
        to.comment("Its standard error, in the same unit.");
        to.scalar(table, &format!("{key}_std_error"), q.std_error);
    }
}

fn one_line(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect()
}

/// The names that one text has given, so that none is given twice.
#[derive(Default)]
struct Names(std::collections::BTreeSet<String>);

impl Names {
    /// A name of letters, digits and `_` for the key `key` of `table`: another one where capitals are all
    /// that tells it from an earlier.
    fn of(&mut self, table: &str, key: &str) -> String {
        let mut name = identifier(key);
        let mut number = 1;
        while !self.0.insert(format!("{table}_{name}").to_uppercase()) {
            number += 1;
            name = format!("{}_{number}", identifier(key));
        }
        name
    }
}

/// A key as it can stand in a name of any of the languages: letters, digits and `_`.
fn identifier(key: &str) -> String {
    key.chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect()
}

/// Words that MATLAB and Octave keep for themselves.
const MATLAB_WORDS: &[&str] = &[
    "break",
    "case",
    "catch",
    "classdef",
    "continue",
    "do",
    "else",
    "elseif",
    "end",
    "endfor",
    "endfunction",
    "endif",
    "endswitch",
    "endwhile",
    "for",
    "function",
    "global",
    "if",
    "otherwise",
    "parfor",
    "persistent",
    "return",
    "spmd",
    "switch",
    "try",
    "until",
    "while",
];

/// A value of an effect in one of the languages.
enum Plain<'a> {
    Number(f64),
    Word(&'a str),
    Truth(bool),
    List(&'a [toml::Value]),
}

fn plain(value: &toml::Value) -> Option<Plain<'_>> {
    Some(match value {
        toml::Value::Float(v) => Plain::Number(*v),
        #[allow(clippy::cast_precision_loss)]
        toml::Value::Integer(v) => Plain::Number(*v as f64),
        toml::Value::String(v) => Plain::Word(v),
        toml::Value::Boolean(v) => Plain::Truth(*v),
        toml::Value::Array(list) => Plain::List(list),
        toml::Value::Datetime(_) | toml::Value::Table(_) => return None,
    })
}

/// All of a list, where all of it are numbers.
fn all_numbers(list: &[toml::Value]) -> Option<Vec<f64>> {
    list.iter()
        .map(|v| match plain(v) {
            Some(Plain::Number(n)) => Some(n),
            _ => None,
        })
        .collect()
}

/// The rows of a matrix, where all of a list are lists of numbers, as many in each; none of no rows or
/// columns.
fn matrix(list: &[toml::Value]) -> Option<Vec<Vec<f64>>> {
    let row = |v: &toml::Value| match plain(v) {
        Some(Plain::List(row)) => all_numbers(row),
        _ => None,
    };
    let rows: Vec<Vec<f64>> = list.iter().map(row).collect::<Option<_>>()?;
    let columns = rows.first()?.len();
    (columns > 0 && rows.iter().all(|r| r.len() == columns)).then_some(rows)
}

/// MATLAB and Octave.
#[derive(Default)]
struct Matlab(String, Names);

impl Matlab {
    fn number(v: f64) -> String {
        match v {
            v if v.is_nan() => "NaN".to_owned(),
            v if v.is_infinite() => if v > 0.0 { "Inf" } else { "-Inf" }.to_owned(),
            v => format!("{v:?}"),
        }
    }

    fn row(values: &[f64]) -> String {
        Self::rows(&[values.to_vec()])
    }

    fn rows(rows: &[Vec<f64>]) -> String {
        let row = |values: &Vec<f64>| {
            let all: Vec<String> = values.iter().map(|&v| Self::number(v)).collect();
            all.join(" ")
        };
        let all: Vec<String> = rows.iter().map(row).collect();
        format!("[{}]", all.join("; "))
    }

    fn word(text: &str) -> String {
        format!("'{}'", one_line(text).replace('\'', "''"))
    }

    fn any(value: &toml::Value) -> Option<String> {
        Some(match plain(value)? {
            Plain::Number(v) => Self::number(v),
            Plain::Word(v) => Self::word(v),
            Plain::Truth(v) => v.to_string(),
            Plain::List(list) => match (all_numbers(list), matrix(list)) {
                (Some(numbers), _) => Self::row(&numbers),
                (None, Some(rows)) => Self::rows(&rows),
                (None, None) => {
                    let all: Option<Vec<String>> = list.iter().map(Self::any).collect();
                    format!("{{{}}}", all?.join(", "))
                }
            },
        })
    }

    fn assign(&mut self, place: &str, text: &str) {
        let _ = writeln!(self.0, "{place} = {text};");
    }

    /// A field of a struct; a comment says where its name is not the key.
    fn field(&mut self, place: &str, key: &str, text: &str) {
        let mut name = identifier(key);
        if !name.starts_with(|c: char| c.is_ascii_alphabetic()) {
            name.insert(0, 'x');
        }
        if MATLAB_WORDS.contains(&name.as_str()) {
            name.push('_');
        }
        // MATLAB tells `a` from `A`
        while !self.1.0.insert(format!("{place}.{name}")) {
            name.push('_');
        }
        if name != key {
            self.comment(&format!("The key `{key}` is the field {name} here."));
        }
        self.assign(&format!("{place}.{name}"), text);
    }
}

impl Exporter for Matlab {
    fn begin(&mut self) {
        self.0
            .push_str("% Run this script: it makes the struct `deacal`.\ndeacal = struct();\n");
    }
    fn comment(&mut self, text: &str) {
        let _ = writeln!(self.0, "% {}", one_line(text));
    }
    fn scalar(&mut self, table: &str, key: &str, value: f64) {
        self.field(&format!("deacal.{table}"), key, &Self::number(value));
    }
    fn list(&mut self, table: &str, key: &str, values: &[f64]) {
        self.field(&format!("deacal.{table}"), key, &Self::row(values));
    }
    fn values(&mut self, table: &str, values: &Values) {
        for (name, value) in values {
            if let Some(text) = Self::any(value) {
                self.field(&format!("deacal.{table}"), name, &text);
            }
        }
    }
    fn effect(&mut self, number: usize, id: &str, actuators: &[usize], values: &Values) {
        let place = format!("deacal.effect{{{number}}}");
        let actuators: Vec<String> = actuators.iter().map(ToString::to_string).collect();
        self.assign(&format!("{place}.id"), &Self::word(id));
        self.assign(
            &format!("{place}.actuators"),
            &format!("[{}]", actuators.join(" ")),
        );
        for (name, value) in values {
            if let Some(text) = Self::any(value) {
                self.field(&place, name, &text);
            }
        }
    }
    fn finish(&mut self) -> String {
        std::mem::take(&mut self.0)
    }
}

/// Python 3.
#[derive(Default)]
struct Python {
    text: String,
    /// Tables, and the keys in them with their names, for the dictionary at the end.
    keys: Vec<(String, Vec<(String, String)>)>,
    names: Names,
    effects: Vec<String>,
}

impl Python {
    fn number(v: f64) -> String {
        if v.is_finite() {
            format!("{v:?}")
        } else {
            format!("float(\"{v}\")")
        }
    }

    /// A JSON string is a Python string.
    fn word(text: &str) -> String {
        serde_json::Value::from(text).to_string()
    }

    fn any(value: &toml::Value) -> Option<String> {
        Some(match plain(value)? {
            Plain::Number(v) => Self::number(v),
            Plain::Word(v) => Self::word(v),
            Plain::Truth(v) => if v { "True" } else { "False" }.to_owned(),
            Plain::List(list) => {
                let all: Option<Vec<String>> = list.iter().map(Self::any).collect();
                format!("[{}]", all?.join(", "))
            }
        })
    }

    fn constant(&mut self, table: &str, key: &str, text: &str) {
        let name = format!("{}_{}", table.to_uppercase(), self.names.of(table, key));
        let _ = writeln!(self.text, "{name} = {text}");
        let entry = (key.to_owned(), name);
        match self.keys.iter_mut().find(|(t, _)| t == table) {
            Some((_, keys)) => keys.push(entry),
            None => self.keys.push((table.to_owned(), vec![entry])),
        }
    }
}

impl Exporter for Python {
    fn begin(&mut self) {}
    fn comment(&mut self, text: &str) {
        let _ = writeln!(self.text, "# {}", one_line(text));
    }
    fn scalar(&mut self, table: &str, key: &str, value: f64) {
        self.constant(table, key, &Self::number(value));
    }
    fn list(&mut self, table: &str, key: &str, values: &[f64]) {
        let all: Vec<String> = values.iter().map(|&v| Self::number(v)).collect();
        self.constant(table, key, &format!("[{}]", all.join(", ")));
    }
    fn values(&mut self, table: &str, values: &Values) {
        for (name, value) in values {
            if let Some(text) = Self::any(value) {
                self.constant(table, name, &text);
            }
        }
    }
    fn effect(&mut self, number: usize, id: &str, actuators: &[usize], values: &Values) {
        let name = format!("EFFECT_{number}");
        let mut text = format!(
            "{name} = {{\"id\": {}, \"actuators\": {actuators:?}",
            Self::word(id)
        );
        for (key, value) in values {
            if let Some(value) = Self::any(value) {
                let _ = write!(text, ", {}: {value}", Self::word(key));
            }
        }
        let _ = writeln!(self.text, "{text}}}");
        self.effects.push(name);
    }
    fn finish(&mut self) -> String {
        let mut out = std::mem::take(&mut self.text);
        out.push_str("\n# The same as one dictionary, with the tables and keys of parameters.toml.\nPARAMETERS = {\n");
        for (table, keys) in &self.keys {
            let _ = writeln!(out, "    \"{table}\": {{");
            for (key, name) in keys {
                let _ = writeln!(out, "        {}: {name},", Self::word(key));
            }
            out.push_str("    },\n");
        }
        let _ = writeln!(out, "    \"effect\": [{}],\n}}", self.effects.join(", "));
        out
    }
}

/// C89 and later, and C++.
#[derive(Default)]
struct C(String, Names);

impl C {
    /// A number that is not finite has no literal in C: it is told in a comment.
    fn none(&mut self, name: &str, values: &[f64]) {
        let all: Vec<String> = values.iter().map(ToString::to_string).collect();
        self.comment(&format!("{name}: {}", all.join(", ")));
    }

    fn double(&mut self, name: &str, v: f64) {
        if v.is_finite() {
            let _ = writeln!(self.0, "static const double {name} = {v:?};");
        } else {
            self.none(name, &[v]);
        }
    }

    fn word(text: &str) -> String {
        let mut out = String::from("\"");
        for byte in one_line(text).bytes() {
            match byte {
                b'"' | b'\\' | b'?' => {
                    out.push('\\');
                    out.push(char::from(byte));
                }
                0x20..=0x7e => out.push(char::from(byte)),
                // three octal digits end an escape whatever follows
                other => {
                    let _ = write!(out, "\\{other:03o}");
                }
            }
        }
        out.push('"');
        out
    }

    /// The name of a constant; a comment says where it does not end in the key.
    fn name(&mut self, place: &str, key: &str) -> String {
        let name = self.1.of(place, key);
        if name != key {
            self.comment(&format!("The key `{key}` is called {name} here."));
        }
        format!("{place}_{name}")
    }

    fn value(&mut self, name: &str, value: &toml::Value) {
        match plain(value) {
            Some(Plain::Number(v)) => self.double(name, v),
            Some(Plain::Word(v)) => {
                let _ = writeln!(self.0, "static const char {name}[] = {};", Self::word(v));
            }
            Some(Plain::Truth(v)) => {
                let _ = writeln!(self.0, "static const int {name} = {};", i32::from(v));
            }
            Some(Plain::List(list)) => {
                let words: Option<Vec<&str>> = list.iter().map(toml::Value::as_str).collect();
                match (all_numbers(list), matrix(list), words) {
                    (Some(numbers), ..) => self.array(name, &numbers),
                    (None, Some(rows), _) => self.rows(name, &rows),
                    (None, None, Some(words)) => self.words(name, &words),
                    (None, None, None) => self.comment(&format!(
                        "{name} is no list of numbers or words, and no matrix, and was left out"
                    )),
                }
            }
            None => {}
        }
    }

    /// An array, and its length as a macro; C has no array of length 0.
    fn array(&mut self, name: &str, values: &[f64]) {
        if values.iter().any(|v| !v.is_finite()) {
            self.none(name, values);
            return;
        }
        let _ = writeln!(
            self.0,
            "#define {}_COUNT {}",
            name.to_uppercase(),
            values.len()
        );
        if values.is_empty() {
            return;
        }
        let _ = writeln!(self.0, "static const double {name}[{}] = {{", values.len());
        for v in values {
            let _ = writeln!(self.0, "    {v:?},");
        }
        self.0.push_str("};\n");
    }

    /// The array of an array of rows, and the numbers of both as macros.
    fn rows(&mut self, name: &str, rows: &[Vec<f64>]) {
        if rows.iter().flatten().any(|v| !v.is_finite()) {
            self.none(name, &rows.concat());
            return;
        }
        let (upper, columns) = (name.to_uppercase(), rows[0].len());
        let _ = writeln!(
            self.0,
            "#define {upper}_COUNT {}\n#define {upper}_COLUMNS {columns}\nstatic const double {name}[{}][{columns}] = {{",
            rows.len(),
            rows.len()
        );
        for row in rows {
            let all: Vec<String> = row.iter().map(|v| format!("{v:?}")).collect();
            let _ = writeln!(self.0, "    {{ {} }},", all.join(", "));
        }
        self.0.push_str("};\n");
    }

    /// An array of texts, and its length as a macro.
    fn words(&mut self, name: &str, words: &[&str]) {
        let all: Vec<String> = words.iter().map(|w| Self::word(w)).collect();
        let _ = writeln!(
            self.0,
            "#define {}_COUNT {}\nstatic const char *const {name}[{}] = {{ {} }};",
            name.to_uppercase(),
            all.len(),
            all.len(),
            all.join(", ")
        );
    }
}

impl Exporter for C {
    fn begin(&mut self) {
        self.0
            .push_str("#ifndef DEACAL_PARAMETERS_H\n#define DEACAL_PARAMETERS_H\n\n");
    }
    fn comment(&mut self, text: &str) {
        let text = one_line(text).replace("*/", "* /").replace("/*", "/ *");
        let _ = writeln!(self.0, "/* {text} */");
    }
    fn scalar(&mut self, table: &str, key: &str, value: f64) {
        let name = self.name(&format!("deacal_{table}"), key);
        self.double(&name, value);
    }
    fn list(&mut self, table: &str, key: &str, values: &[f64]) {
        let name = self.name(&format!("deacal_{table}"), key);
        self.array(&name, values);
    }
    fn values(&mut self, table: &str, values: &Values) {
        for (name, value) in values {
            let name = self.name(&format!("deacal_{table}"), name);
            self.value(&name, value);
        }
    }
    fn effect(&mut self, number: usize, id: &str, actuators: &[usize], values: &Values) {
        let place = format!("deacal_effect_{number}");
        let _ = writeln!(
            self.0,
            "static const char {place}_id[] = {};",
            Self::word(id)
        );
        let list: Vec<String> = actuators.iter().map(ToString::to_string).collect();
        let _ = writeln!(
            self.0,
            "#define {}_ACTUATORS_COUNT {}\nstatic const int {place}_actuators[{}] = {{ {} }};",
            place.to_uppercase(),
            list.len(),
            list.len().max(1),
            if list.is_empty() {
                "0".to_owned()
            } else {
                list.join(", ")
            }
        );
        for (name, value) in values {
            let name = self.name(&place, name);
            self.value(&name, value);
        }
    }
    fn finish(&mut self) -> String {
        self.0.push_str("\n#endif\n");
        std::mem::take(&mut self.0)
    }
}
