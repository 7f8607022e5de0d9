//! What users give: recordings, parameters, and numbers that have to lie somewhere.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use deacal::jobs::validate::Candidate;
use deacal::jobs::{Failure, Progress, load};
use deacal::recording::{Kind, Recording as Raw};
use deacal::report::parameter_file::ParameterFile as File;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::recording::Recording;
use crate::results::{Diagnosis, Fit, ParameterFile};

/// A recording: where it is, or as it was read.
#[derive(Clone)]
pub enum Source {
    Path(PathBuf),
    Read(Arc<Raw>),
}

impl Source {
    fn path(&self) -> &Path {
        match self {
            Source::Path(path) => path,
            Source::Read(raw) => &raw.path,
        }
    }
}

impl<'py> FromPyObject<'_, 'py> for Source {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(recording) = given.cast::<Recording>() {
            return Ok(Source::Read(Arc::clone(&recording.get().raw)));
        }
        match given.extract::<PathBuf>() {
            Ok(path) => Ok(Source::Path(path)),
            Err(_) => Err(PyTypeError::new_err(format!(
                "expected a path or a deacal.Recording, got {}",
                given.get_type().name()?
            ))),
        }
    }
}

/// One recording or several.
#[derive(Clone)]
pub struct Sources(pub Vec<Source>);

impl<'py> FromPyObject<'_, 'py> for Sources {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(one) = given.extract::<Source>() {
            return Ok(Sources(vec![one]));
        }
        let Ok(several) = given.try_iter() else {
            return given.extract::<Source>().map(|one| Sources(vec![one]));
        };
        let each = several.map(|one| one?.extract::<Source>());
        each.collect::<PyResult<Vec<_>>>().map(Sources)
    }
}

impl Sources {
    /// Opens what is not read yet, or everything where another rig is given. All are of one of `kinds`.
    ///
    /// # Errors
    /// None, files that cannot be read, kinds that do not go together.
    pub fn open(
        &self,
        rig: Option<&PathBuf>,
        kinds: &[Kind],
        progress: &Progress,
    ) -> Result<Vec<Raw>, Failure> {
        if self.0.is_empty() {
            return Err("no recording was given".into());
        }
        let read = |s: &&Source| matches!(s, Source::Read(_)) && rig.is_none();
        let paths: Vec<PathBuf> = self
            .0
            .iter()
            .filter(|s| !read(s))
            .map(|s| s.path().to_owned())
            .collect();
        let mut opened = match paths.is_empty() {
            true => Vec::new(),
            false => load::opened(&paths, rig, progress)?,
        }
        .into_iter();
        let each = self.0.iter().filter_map(|source| match source {
            Source::Read(raw) if rig.is_none() => Some(raw.as_ref().clone()),
            _ => opened.next(),
        });
        let all: Vec<Raw> = each.collect();
        load::of_one_kind(&all, kinds)?;
        Ok(all)
    }
}

/// Parameters: a file, or a result that has them.
#[derive(Clone)]
pub enum Parameters {
    Path(PathBuf),
    Text { name: String, text: String },
}

impl<'py> FromPyObject<'_, 'py> for Parameters {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let of = |file: &ParameterFile| Parameters::Text {
            name: file.name.clone(),
            text: file.text.clone(),
        };
        if let Ok(file) = given.cast::<ParameterFile>() {
            return Ok(of(file.get()));
        }
        if given.is_instance_of::<Fit>() || given.is_instance_of::<Diagnosis>() {
            let file = given.getattr("parameter_file")?;
            let Ok(file) = file.cast::<ParameterFile>() else {
                return Err(PyValueError::new_err(
                    "the diagnosis has no parameters: its recordings have to be mended first",
                ));
            };
            return Ok(of(file.get()));
        }
        match given.extract::<PathBuf>() {
            Ok(path) => Ok(Parameters::Path(path)),
            Err(_) => Err(PyTypeError::new_err(format!(
                "expected a path, a deacal.ParameterFile, a Fit or a Diagnosis, got {}",
                given.get_type().name()?
            ))),
        }
    }
}

impl Parameters {
    /// What they are called in words.
    pub fn name(&self) -> String {
        match self {
            Parameters::Path(path) => path.display().to_string(),
            Parameters::Text { name, .. } => name.clone(),
        }
    }

    /// As what is held against recordings.
    ///
    /// # Errors
    /// As [`Parameters::read`].
    pub fn candidate(&self) -> Result<Candidate, Failure> {
        match self {
            Parameters::Path(path) => Candidate::read(path),
            Parameters::Text { name, text } => Candidate::of_text(name, text),
        }
    }

    /// Reads them.
    ///
    /// # Errors
    /// The file cannot be read, or holds numbers that cannot be.
    pub fn read(&self) -> Result<File, Failure> {
        match self {
            Parameters::Path(path) => load::parameters(path),
            Parameters::Text { name, text } => load::parameters_of_text(Path::new(name), text),
        }
    }
}

/// Parameters that are held against recordings: one file or result, or several.
#[derive(Clone)]
pub struct Several(pub Vec<Parameters>);

impl<'py> FromPyObject<'_, 'py> for Several {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let one = given.extract::<Parameters>();
        match given.try_iter() {
            Ok(several) if one.is_err() => several
                .map(|one| one?.extract::<Parameters>())
                .collect::<PyResult<_>>()
                .map(Several),
            _ => one.map(|one| Several(vec![one])),
        }
    }
}

/// Held parameters by name.
#[derive(Clone, Default)]
pub struct Fixed(pub Vec<(String, f64)>);

impl<'py> FromPyObject<'_, 'py> for Fixed {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let each = given.cast::<PyDict>()?.iter();
        let each = each.map(|(name, value)| Ok((name.extract()?, value.extract()?)));
        each.collect::<PyResult<_>>().map(Fixed)
    }
}

/// Bounds of parameters by name.
#[derive(Clone, Default)]
pub struct Bounds(pub Vec<(String, [f64; 2])>);

impl<'py> FromPyObject<'_, 'py> for Bounds {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let each = given.cast::<PyDict>()?.iter();
        let each = each.map(|(name, value)| {
            let (low, high) = value.extract::<(f64, f64)>()?;
            Ok((name.extract()?, [low, high]))
        });
        each.collect::<PyResult<_>>().map(Bounds)
    }
}

/// A number within a range.
///
/// # Errors
/// `ValueError`: it is not.
pub fn within<T>(name: &str, value: T, range: RangeInclusive<T>) -> PyResult<T>
where
    T: PartialOrd + Display,
{
    match range.contains(&value) {
        true => Ok(value),
        false => Err(PyValueError::new_err(format!(
            "{name}: {value} is not in {}..={}",
            range.start(),
            range.end()
        ))),
    }
}

/// One of some words.
///
/// # Errors
/// `ValueError`: it is none of them.
pub fn one_of<T: Copy>(name: &str, word: &str, known: &[(&str, T)]) -> PyResult<T> {
    match known.iter().find(|(w, _)| *w == word) {
        Some((_, value)) => Ok(*value),
        None => {
            let words: Vec<&str> = known.iter().map(|(w, _)| *w).collect();
            Err(PyValueError::new_err(format!(
                "{name}: there is no `{word}`; there are: {}",
                words.join(", ")
            )))
        }
    }
}

/// Words of an argument, `ValueError`s with its name.
pub fn argument<T>(name: &str, checked: Result<T, String>) -> PyResult<T> {
    checked.map_err(|why| PyValueError::new_err(format!("{name}: {why}")))
}

/// A call as a result states it: the function, its recordings, and what else was asked for.
pub struct Call(String);

impl Call {
    pub fn new(function: &str, recordings: &Sources) -> Self {
        let paths = recordings
            .0
            .iter()
            .map(|s| format!("{:?}", s.path().display().to_string()));
        let paths: Vec<String> = paths.collect();
        Call(format!("deacal.{function}([{}]", paths.join(", ")))
    }

    /// Adds an argument, where it is not what it is by default.
    #[must_use]
    pub fn with(mut self, name: &str, given: bool, value: impl Display) -> Self {
        if given {
            self.0 += &format!(", {name}={value}");
        }
        self
    }

    /// Adds a path or a word.
    #[must_use]
    pub fn word(self, name: &str, value: Option<&str>) -> Self {
        self.with(
            name,
            value.is_some(),
            format!("{:?}", value.unwrap_or_default()),
        )
    }

    pub fn text(self) -> String {
        self.0 + ")"
    }
}
