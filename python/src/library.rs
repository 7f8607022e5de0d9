//! The parameter sets that come with the package.

use deacal::report::html::page::escape;
use deacal::report::library::{Entry, entries, find};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use crate::results::ParameterFile;

/// A parameter set of the library: a parameter file, and what is said of it.
#[pyclass(frozen, extends = ParameterFile, module = "deacal")]
pub struct ParameterSet {
    of: Entry,
}

impl ParameterSet {
    fn new(py: Python<'_>, of: Entry) -> PyResult<Bound<'_, Self>> {
        let file = ParameterFile::read(format!("library:{}", of.name).into())?;
        let set = PyClassInitializer::from(file).add_subclass(ParameterSet { of });
        Bound::new(py, set)
    }
}

#[pymethods]
impl ParameterSet {
    /// Its name; "library:NAME" stands for it wherever parameters are taken.
    #[getter]
    fn name(&self) -> &str {
        &self.of.name
    }

    /// What it describes.
    #[getter]
    fn of(&self) -> &str {
        &self.of.of
    }

    /// The command that wrote it.
    #[getter]
    fn made_by(&self) -> &str {
        &self.of.made_by
    }

    /// The recordings that it was fitted to, and who took them.
    #[getter]
    fn source(&self) -> &str {
        &self.of.source
    }

    /// Licence of these recordings and of the numbers.
    #[getter]
    fn licence(&self) -> &str {
        &self.of.licence
    }

    /// What was covered: strokes, voltages, rates, lengths.
    #[getter]
    fn range(&self) -> &str {
        &self.of.range
    }

    /// What it does not tell.
    #[getter]
    fn beyond(&self) -> &str {
        &self.of.beyond
    }

    fn __repr__(&self) -> String {
        format!("<deacal.ParameterSet {}: {}>", self.of.name, self.of.of)
    }
}

/// The parameter sets that come with the package, by name: `deacal.library["twin2026_delta"]`. In a notebook
/// it shows what each is of, how far it goes, and its licence.
#[pyclass(frozen, mapping, module = "deacal")]
pub struct Library;

#[pymethods]
impl Library {
    /// Names of the sets.
    fn keys(&self) -> Vec<String> {
        entries().into_iter().map(|e| e.name).collect()
    }

    /// The sets.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, ParameterSet>>> {
        let all = entries().into_iter();
        all.map(|e| ParameterSet::new(py, e)).collect()
    }

    /// Names and sets.
    fn items<'py>(&self, py: Python<'py>) -> PyResult<Vec<(String, Bound<'py, ParameterSet>)>> {
        let all = entries().into_iter();
        all.map(|e| Ok((e.name.clone(), ParameterSet::new(py, e)?)))
            .collect()
    }

    fn __len__(&self) -> usize {
        entries().len()
    }

    fn __contains__(&self, name: &Bound<'_, PyAny>) -> bool {
        name.extract::<String>()
            .is_ok_and(|name| find(&name).is_ok())
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(PyList::new(py, self.keys())?.try_iter()?.into_any())
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, ParameterSet>> {
        ParameterSet::new(py, find(name).map_err(PyKeyError::new_err)?)
    }

    /// A table of the sets.
    fn _repr_html_(&self) -> String {
        let row = |e: Entry| {
            let cells = [&e.name, &e.of, &e.range, &e.licence].map(|c| escape(c));
            format!("<tr><td>{}</td></tr>", cells.join("</td><td>"))
        };
        let rows: String = entries().into_iter().map(row).collect();
        format!(
            "<table><thead><tr><th>name</th><th>of</th><th>holds for</th><th>licence</th></tr></thead>\
             <tbody>{rows}</tbody></table>"
        )
    }

    fn __repr__(&self) -> String {
        format!("<deacal.Library: {}>", self.keys().join(", "))
    }
}
