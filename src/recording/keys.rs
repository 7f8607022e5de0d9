//! Typed access to the keys of a `.toml` file: every error names the file, the line, the key, and the nearest
//! known one.

use std::io::{self, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::capture::{ColumnRef, HEAD_BYTES, is_foreign, recognised};
use super::error::{Error, ErrorKind, nearest, quote};

/// No manifest is larger than this, bytes.
const MAX_TOML_BYTES: u64 = 1 << 20;

/// A `recording.toml`.
pub(crate) const RECORDING: Wanted = Wanted {
    what: "a recording.toml",
    name: "name the folder of a recording, or its recording.toml",
};
/// A rig file.
pub(crate) const RIG: Wanted = Wanted {
    what: "a rig file",
    name: "name the rig.toml, which begins with [rig]",
};
/// A parameter file.
pub(crate) const PARAMETERS: Wanted = Wanted {
    what: "a parameter file",
    name: "name the parameters.toml that `deacal fit` or `deacal diagnose` left",
};
/// A `plan.toml`.
pub(crate) const PLAN: Wanted = Wanted {
    what: "a plan.toml",
    name: "name the plan.toml that an earlier run left",
};

/// The plan of a batch.
pub(crate) const BATCH: Wanted = Wanted {
    what: "the plan of a batch",
    name: "name a plan with a [[set]] for each recording set, or a folder of them",
};

/// What a `.toml` file is asked to be.
pub(crate) struct Wanted {
    /// `a rig file`.
    pub what: &'static str,
    /// What to name instead of a file that is something else.
    pub name: &'static str,
}

/// A `.toml` file: its path, its text, and what it is asked to be.
pub(crate) struct Document {
    pub path: PathBuf,
    pub text: String,
    wanted: &'static Wanted,
}

impl Document {
    /// Reads a file of at most a mebibyte.
    pub fn read(path: &Path, wanted: &'static Wanted) -> Result<Self, Error> {
        let mut bytes = Vec::new();
        super::opened::open(path)
            .and_then(|f| f.take(MAX_TOML_BYTES + 1).read_to_end(&mut bytes))
            .map_err(|e| match e.kind() {
                io::ErrorKind::IsADirectory => other(path, "is a folder".into(), wanted),
                _ => Error::io(path, e),
            })?;
        let odd = bytes.len() as u64 > MAX_TOML_BYTES || str::from_utf8(&bytes).is_err();
        if odd && let Some(what) = no_toml(&bytes, path) {
            return Err(other(path, what, wanted));
        }
        if bytes.len() as u64 > MAX_TOML_BYTES {
            return Err(
                Error::new(ErrorKind::Toml, path, "the file is larger than a mebibyte")
                    .expected("a short TOML file")
                    .action("name the .toml file that describes the data, not the data"),
            );
        }
        let text = String::from_utf8(bytes).map_err(|e| {
            let good = e.utf8_error().valid_up_to();
            let line = 1 + e.as_bytes()[..good].iter().filter(|b| **b == b'\n').count() as u64;
            Error::new(ErrorKind::Toml, path, "the text is not UTF-8")
                .at_line(line)
                .action("save the file as UTF-8")
        })?;
        Ok(Document::new(path, text, wanted))
    }

    pub fn new(path: &Path, text: String, wanted: &'static Wanted) -> Self {
        let text = match text.strip_prefix('\u{feff}') {
            Some(rest) => rest.to_owned(),
            None => text,
        };
        Document {
            path: path.to_owned(),
            text,
            wanted,
        }
    }

    /// The tables of the file.
    pub fn parse(&self) -> Result<Spanned<DeTable<'_>>, Error> {
        if self.text.trim().is_empty() {
            let empty = "the file is empty".into();
            return Err(other(&self.path, empty, self.wanted).at_line(1));
        }
        let root = DeTable::parse(&self.text).map_err(|e| {
            if let Some(what) = no_toml(self.text.as_bytes(), &self.path) {
                return other(&self.path, what, self.wanted);
            }
            let line = e.span().map_or(1, |s| self.line(s));
            let message = e.message().trim().replace('\n', ", ");
            Error::new(ErrorKind::Toml, &self.path, message)
                .at_line(line)
                .action("correct the TOML")
        })?;
        match kind(root.get_ref()) {
            Some((what, span)) if what != self.wanted.what => {
                let found = format!("this is {what}");
                Err(other(&self.path, found, self.wanted).at_line(self.line(span)))
            }
            _ => Ok(root),
        }
    }

    fn line(&self, span: Range<usize>) -> u64 {
        let before = self.text.get(..span.start).unwrap_or(&self.text);
        1 + before.bytes().filter(|b| *b == b'\n').count() as u64
    }
}

/// The error for a file that is something else.
fn other(path: &Path, found: String, wanted: &Wanted) -> Error {
    Error::new(ErrorKind::Toml, path, found)
        .expected(wanted.what)
        .action(wanted.name)
}

/// What a file is that is no TOML, as it begins; nothing where it may be TOML with a mistake.
fn no_toml(bytes: &[u8], path: &Path) -> Option<String> {
    let head = &bytes[..bytes.len().min(HEAD_BYTES)];
    let begins = head.trim_ascii_start();
    if begins.starts_with(b"{") {
        return Some("this is JSON".to_owned());
    }
    let first = begins.split(|b| *b == b'\n').next().unwrap_or_default();
    if first.starts_with(b"[") || first.starts_with(b"#") || first.contains(&b'=') {
        return None;
    }
    match recognised(head, path) {
        Some(importer) => Some(format!("these are data ({})", importer.name())),
        None if is_foreign(head) => Some("these are data".to_owned()),
        None => None,
    }
}

/// Which of the program's files this is, and where that is seen.
fn kind(root: &DeTable<'_>) -> Option<(&'static str, Range<usize>)> {
    let of = |name: &str| root.iter().find(|(key, _)| key.get_ref() == name);
    let table = |name: &str| of(name).filter(|(_, v)| v.get_ref().is_table());
    let film = table("film").filter(|(_, v)| {
        let keys = v.get_ref().as_table();
        keys.is_some_and(|t| t.keys().any(|key| key.get_ref() == "mu_Pa"))
    });
    let list = |name: &str| of(name).filter(|(_, v)| v.get_ref().is_array());
    let found = [
        (table("recording"), RECORDING.what),
        (table("rig"), RIG.what),
        (table("provenance").or(film), PARAMETERS.what),
        (list("recording"), PLAN.what),
        (list("set"), BATCH.what),
    ];
    found
        .into_iter()
        .find_map(|(found, what)| Some((what, found?.0.span())))
}

/// A value that a key can have.
pub(crate) trait Value: Sized {
    /// What it has to be, for the message.
    const EXPECTED: &'static str;
    /// The value, if it is that.
    fn from_toml(value: &DeValue<'_>) -> Option<Self>;
}

impl Value for String {
    const EXPECTED: &'static str = "a string";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        value.as_str().map(ToOwned::to_owned)
    }
}

impl Value for f64 {
    const EXPECTED: &'static str = "a finite number";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        let number: f64 = match value {
            DeValue::Float(f) => f.as_str().parse().ok()?,
            #[allow(clippy::cast_precision_loss)]
            DeValue::Integer(_) => i64::from_toml(value)? as f64,
            _ => return None,
        };
        number.is_finite().then_some(number)
    }
}

impl Value for i64 {
    const EXPECTED: &'static str = "a whole number";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        match value {
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok(),
            _ => None,
        }
    }
}

impl Value for bool {
    const EXPECTED: &'static str = "true or false";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        value.as_bool()
    }
}

impl Value for [f64; 3] {
    const EXPECTED: &'static str = "three numbers [x, y, z]";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        let list: Vec<f64> = numbers(value)?;
        list.try_into().ok()
    }
}

/// A list of numbers.
pub(crate) fn numbers(value: &DeValue<'_>) -> Option<Vec<f64>> {
    value
        .as_array()?
        .iter()
        .map(|v| f64::from_toml(v.get_ref()))
        .collect()
}

impl Value for ColumnRef {
    const EXPECTED: &'static str = "a column: its name, or its number from 1";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        if let Some(name) = value.as_str() {
            return (!name.is_empty()).then(|| ColumnRef::Name(name.trim().to_owned()));
        }
        let number = usize::try_from(i64::from_toml(value)?).ok()?;
        (number > 0).then_some(ColumnRef::Number(number))
    }
}

impl Value for Vec<ColumnRef> {
    const EXPECTED: &'static str = "a list of columns: names, or numbers from 1";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        value
            .as_array()?
            .iter()
            .map(|v| ColumnRef::from_toml(v.get_ref()))
            .collect()
    }
}

/// A table with the keys that it may have.
pub(crate) struct Keys<'a> {
    document: &'a Document,
    table: &'a DeTable<'a>,
    /// `[motion]`; empty at the top.
    name: String,
    line: u64,
    known: &'static [&'static str],
}

impl<'a> Keys<'a> {
    /// The top of a file. Keys that are not among `known` are errors that name the nearest.
    pub fn top(
        document: &'a Document,
        root: &'a Spanned<DeTable<'a>>,
        known: &'static [&'static str],
    ) -> Result<Self, Error> {
        Keys::any(document, root, known).checked()
    }

    /// The top of a file whose keys are not looked at yet.
    pub fn any(
        document: &'a Document,
        root: &'a Spanned<DeTable<'a>>,
        known: &'static [&'static str],
    ) -> Self {
        Keys {
            document,
            table: root.get_ref(),
            name: String::new(),
            line: 1,
            known,
        }
    }

    fn checked(self) -> Result<Self, Error> {
        // the first in the file
        let unknown = self
            .table
            .keys()
            .filter(|key| !self.known.contains(&key.get_ref().as_ref()))
            .min_by_key(|key| key.span().start);
        if let Some(key) = unknown {
            let line = self.document.line(key.span());
            let all = self.known.join(", ");
            return Err(Error::new(
                ErrorKind::UnknownKey,
                &self.document.path,
                format!("the key {} is not known", quote(key.get_ref())),
            )
            .at_line(line)
            .at_key(self.full(key.get_ref()))
            .action(match nearest(key.get_ref(), self.known) {
                Some(near) => format!("did you mean \"{near}\"? There are: {all}"),
                None => format!("there are: {all}"),
            }));
        }
        Ok(self)
    }

    fn full(&self, key: &str) -> String {
        if self.name.is_empty() {
            format!("[{key}]")
        } else {
            format!("{} {key}", self.name)
        }
    }

    fn entry(&self, key: &'static str) -> Option<(u64, &'a DeValue<'a>)> {
        debug_assert!(self.known.contains(&key), "{key} is read but not known");
        let (_, value) = self.table.iter().find(|(k, _)| k.get_ref() == key)?;
        Some((self.document.line(value.span()), value.get_ref()))
    }

    /// Whether the key is there.
    pub fn has(&self, key: &'static str) -> bool {
        self.entry(key).is_some()
    }

    /// A table inside this one.
    pub fn table(
        &self,
        key: &'static str,
        known: &'static [&'static str],
    ) -> Result<Option<Keys<'a>>, Error> {
        let Some((line, value)) = self.entry(key) else {
            return Ok(None);
        };
        let Some(table) = value.as_table() else {
            return Err(self.wrong_type(key, line, value, "a table"));
        };
        self.inner(key, line, table, known).checked().map(Some)
    }

    /// A table that has to be there; `why` ends the sentence "... is missing; ".
    pub fn need_table(
        &self,
        key: &'static str,
        known: &'static [&'static str],
        why: &str,
    ) -> Result<Keys<'a>, Error> {
        self.table(key, known)?
            .ok_or_else(|| self.missing(key, why))
    }

    /// The tables of a list of tables, `[[key]]`; none if the key is not there.
    pub fn tables(
        &self,
        key: &'static str,
        known: &'static [&'static str],
    ) -> Result<Vec<Keys<'a>>, Error> {
        self.list_of_tables(key)?
            .into_iter()
            .map(|(line, table)| self.inner(key, line, table, known).checked())
            .collect()
    }

    /// As [`Keys::tables`], for tables that may have any key: read them with [`Keys::entries`].
    pub fn open_tables(
        &self,
        key: &'static str,
        known: &'static [&'static str],
    ) -> Result<Vec<Keys<'a>>, Error> {
        let tables = self.list_of_tables(key)?;
        Ok(tables
            .into_iter()
            .map(|(line, table)| self.inner(key, line, table, known))
            .collect())
    }

    /// As [`Keys::table`], for a table that may have any key.
    pub fn open_table(&self, key: &'static str) -> Result<Option<Keys<'a>>, Error> {
        let Some((line, value)) = self.entry(key) else {
            return Ok(None);
        };
        match value.as_table() {
            Some(table) => Ok(Some(self.inner(key, line, table, &[]))),
            None => Err(self.wrong_type(key, line, value, "a table")),
        }
    }

    fn list_of_tables(&self, key: &'static str) -> Result<Vec<(u64, &'a DeTable<'a>)>, Error> {
        let Some((line, value)) = self.entry(key) else {
            return Ok(Vec::new());
        };
        let tables = value.as_array().and_then(|list| {
            list.iter()
                .map(|v| Some((self.document.line(v.span()), v.get_ref().as_table()?)))
                .collect()
        });
        tables.ok_or_else(|| {
            self.wrong_type(key, line, value, "a list of tables")
                .action(format!("begin each with [[{key}]], in two brackets"))
        })
    }

    fn inner(
        &self,
        key: &str,
        line: u64,
        table: &'a DeTable<'a>,
        known: &'static [&'static str],
    ) -> Keys<'a> {
        let name = match self.name.strip_suffix(']') {
            Some(outer) => format!("{outer}.{key}]"),
            None => format!("[{key}]"),
        };
        Keys {
            document: self.document,
            table,
            name,
            line,
            known,
        }
    }

    /// Every key with its line and value, in the order of the file.
    pub fn entries(&self) -> Vec<(&'a str, u64, &'a DeValue<'a>)> {
        let mut all: Vec<_> = self.table.iter().collect();
        all.sort_by_key(|(key, _)| key.span().start);
        all.into_iter()
            .map(|(key, value)| {
                let line = self.document.line(value.span());
                (key.get_ref().as_ref(), line, value.get_ref())
            })
            .collect()
    }

    /// The entries of a list, each with its line.
    pub fn list(&self, key: &'static str) -> Result<Option<Vec<(u64, &'a DeValue<'a>)>>, Error> {
        let Some((line, value)) = self.entry(key) else {
            return Ok(None);
        };
        let Some(list) = value.as_array() else {
            return Err(self.wrong_type(key, line, value, "a list"));
        };
        Ok(Some(
            list.iter()
                .map(|v| (self.document.line(v.span()), v.get_ref()))
                .collect(),
        ))
    }

    /// The value of a key that may be left out.
    pub fn get<T: Value>(&self, key: &'static str) -> Result<Option<T>, Error> {
        self.get_with(key, T::EXPECTED, T::from_toml)
    }

    /// The value of a key that has to be there.
    pub fn need<T: Value>(&self, key: &'static str) -> Result<T, Error> {
        self.get(key)?
            .ok_or_else(|| self.missing(key, &format!("add `{key} = ...` ({})", T::EXPECTED)))
    }

    /// The value of a key, read by a function.
    pub fn get_with<T>(
        &self,
        key: &'static str,
        expected: &str,
        read: impl FnOnce(&DeValue<'_>) -> Option<T>,
    ) -> Result<Option<T>, Error> {
        let Some((line, value)) = self.entry(key) else {
            return Ok(None);
        };
        match read(value) {
            Some(v) => Ok(Some(v)),
            None => Err(self.wrong_type(key, line, value, expected)),
        }
    }

    /// One of a few words.
    pub fn choice<T: Copy>(
        &self,
        key: &'static str,
        words: &[(&'static str, T)],
    ) -> Result<Option<T>, Error> {
        let Some(word) = self.get::<String>(key)? else {
            return Ok(None);
        };
        if let Some((_, value)) = words.iter().find(|(w, _)| *w == word) {
            return Ok(Some(*value));
        }
        let known: Vec<&str> = words.iter().map(|(w, _)| *w).collect();
        let mut error = self
            .bad(key, format!("found {}", quote(&word)))
            .expected(format!("one of {}", known.join(", ")));
        if let Some(near) = nearest(&word, &known) {
            error = error.action(format!("did you mean \"{near}\"?"));
        }
        Err(error)
    }

    /// A number above zero.
    pub fn positive(&self, key: &'static str) -> Result<Option<f64>, Error> {
        match self.get::<f64>(key)? {
            Some(value) if value <= 0.0 => Err(self
                .bad(key, format!("found {value}"))
                .expected("a number above 0")
                .action("give the measured value in the unit that the key names")),
            other => Ok(other),
        }
    }

    /// A number above zero that has to be there.
    pub fn need_positive(&self, key: &'static str) -> Result<f64, Error> {
        self.positive(key)?
            .ok_or_else(|| self.missing(key, &format!("add `{key} = ...` (a number above 0)")))
    }

    /// A number from one to another.
    pub fn between(
        &self,
        key: &'static str,
        [low, high]: [f64; 2],
        action: &str,
    ) -> Result<Option<f64>, Error> {
        match self.get::<f64>(key)? {
            Some(value) if !(low..=high).contains(&value) => Err(self
                .bad(key, format!("found {value}"))
                .expected(format!("a number from {low} to {high}"))
                .action(action)),
            other => Ok(other),
        }
    }

    /// A number not below zero that has to be there.
    pub fn need_not_negative(&self, key: &'static str) -> Result<f64, Error> {
        let value = self.need::<f64>(key)?;
        if value < 0.0 {
            return Err(self
                .bad(key, format!("found {value}"))
                .expected("a number not below 0"));
        }
        Ok(value)
    }

    /// The error for a key that is not there.
    pub fn missing(&self, key: &str, action: &str) -> Error {
        Error::new(
            ErrorKind::MissingKey,
            &self.document.path,
            if self.name.is_empty() {
                "the table is missing".to_owned()
            } else {
                "the key is missing".to_owned()
            },
        )
        .at_line(self.line)
        .at_key(self.full(key))
        .action(action)
    }

    /// The error for a value that cannot be.
    pub fn bad(&self, key: &'static str, found: impl Into<String>) -> Error {
        let line = self.entry(key).map_or(self.line, |(line, _)| line);
        Error::new(ErrorKind::BadValue, &self.document.path, found)
            .at_line(line)
            .at_key(self.full(key))
    }

    /// As [`Keys::bad`], for a key of [`Keys::entries`].
    pub fn bad_entry(&self, key: &str, line: u64, found: impl Into<String>) -> Error {
        Error::new(ErrorKind::BadValue, &self.document.path, found)
            .at_line(line)
            .at_key(self.full(key))
    }

    /// The error for a value of another type.
    pub fn wrong_type(&self, key: &str, line: u64, value: &DeValue<'_>, expected: &str) -> Error {
        Error::new(
            ErrorKind::WrongType,
            &self.document.path,
            format!("found {}", describe(value)),
        )
        .at_line(line)
        .at_key(self.full(key))
        .expected(expected)
    }
}

pub(crate) fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(s) => format!("the string {}", quote(s)),
        DeValue::Integer(i) => format!("the number {i}"),
        DeValue::Float(f) => format!("the number {f}"),
        DeValue::Boolean(b) => format!("{b}"),
        DeValue::Datetime(d) => format!("the date {d}"),
        DeValue::Array(a) => format!("a list of {}", a.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
