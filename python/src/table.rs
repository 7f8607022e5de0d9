//! Tables: columns of one length, by name.

use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyDict;

use crate::arrays::{frame, one, xarray};

/// Columns of one length, by name; the names end in the units. NaN where there is no value, and `flags` say
/// why.
#[pyclass(frozen, subclass, module = "deacal")]
pub struct Table {
    columns: Vec<(String, Vec<f64>)>,
    /// One a row; empty where the table has none.
    flags: Vec<String>,
    arrays: PyOnceLock<Py<PyDict>>,
}

impl Table {
    /// Of columns; `flags` has a word a row, or none at all.
    pub fn new(columns: Vec<(String, Vec<f64>)>, flags: Vec<String>) -> Self {
        Table {
            columns,
            flags,
            arrays: PyOnceLock::new(),
        }
    }

    fn all<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let made = self.arrays.get_or_try_init(py, || {
            let all = PyDict::new(py);
            for (name, values) in &self.columns {
                all.set_item(name, one(py, values)?)?;
            }
            Ok::<_, PyErr>(all.unbind())
        })?;
        Ok(made.bind(py).clone())
    }
}

#[pymethods]
impl Table {
    /// Names of the columns.
    fn keys(&self) -> Vec<&str> {
        self.columns.iter().map(|(name, _)| name.as_str()).collect()
    }

    /// Why a row has no value, or not all: one word or sentence a row, "" where nothing is missing; empty
    /// where the table has no flags.
    #[getter]
    fn flags(&self) -> Vec<&str> {
        self.flags.iter().map(String::as_str).collect()
    }

    fn __len__(&self) -> usize {
        self.columns.first().map_or(0, |(_, values)| values.len())
    }

    fn __contains__(&self, name: &str) -> bool {
        self.keys().contains(&name)
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.all(py)?.get_item(name)?.ok_or_else(|| {
            let known = self.keys().join(", ");
            PyKeyError::new_err(format!("there is no `{name}`; there are: {known}"))
        })
    }

    /// As a pandas.DataFrame with `time_s` as index, and a last column `flag` where there are flags.
    fn to_pandas<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let columns = self.all(py)?.copy()?;
        let time = columns.get_item("time_s")?;
        if time.is_some() {
            columns.del_item("time_s")?;
        }
        if !self.flags.is_empty() {
            columns.set_item("flag", self.flags())?;
        }
        frame(py, &columns, time.map(|t| ("time_s", t)))
    }

    /// As an xarray.Dataset along `time_s`, with the flags as a coordinate where there are any.
    fn to_xarray<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (variables, times) = (PyDict::new(py), PyDict::new(py));
        for (name, array) in self.all(py)? {
            let of = if name.eq("time_s")? {
                &times
            } else {
                &variables
            };
            of.set_item(name, ("time_s", array))?;
        }
        if !self.flags.is_empty() {
            times.set_item("flag", ("time_s", self.flags()))?;
        }
        xarray(py, &variables, &times, "")
    }

    fn __repr__(&self) -> String {
        format!(
            "<deacal.Table of {} rows: {}>",
            self.__len__(),
            self.keys().join(", ")
        )
    }
}
