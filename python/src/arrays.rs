//! Arrays for numpy, pandas and xarray.

use numpy::{PyArray1, PyArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Closes an array to writing: it is shown again as it is.
fn read_only<'py>(array: Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let flags = PyDict::new(array.py());
    flags.set_item("write", false)?;
    array.call_method("setflags", (), Some(&flags))?;
    Ok(array)
}

/// A list of numbers, shape (n,), float64, read-only.
pub fn one<'py>(py: Python<'py>, values: &[f64]) -> PyResult<Bound<'py, PyAny>> {
    read_only(PyArray1::from_slice(py, values).into_any())
}

/// A table of numbers, shape (n, columns), float64, read-only.
pub fn rows<'py>(
    py: Python<'py>,
    n: usize,
    columns: usize,
    value: impl Fn(usize, usize) -> f64,
) -> PyResult<Bound<'py, PyAny>> {
    let all = (0..n).flat_map(|i| (0..columns).map(move |k| (i, k)));
    let flat: Vec<f64> = all.map(|(i, k)| value(i, k)).collect();
    let table = PyArray1::from_vec(py, flat).reshape([n, columns])?;
    read_only(table.into_any())
}

/// A pandas.DataFrame of columns by name, with an index by name where there is one.
pub fn frame<'py>(
    py: Python<'py>,
    columns: &Bound<'py, PyDict>,
    index: Option<(&str, Bound<'py, PyAny>)>,
) -> PyResult<Bound<'py, PyAny>> {
    let pandas = py.import("pandas")?;
    let options = PyDict::new(py);
    if let Some((name, values)) = index {
        let named = PyDict::new(py);
        named.set_item("name", name)?;
        let index = pandas.getattr("Index")?.call((values,), Some(&named))?;
        options.set_item("index", index)?;
    }
    pandas
        .getattr("DataFrame")?
        .call((columns,), Some(&options))
}

/// An xarray.Dataset of variables and coordinates, each (dimensions, values, attributes).
pub fn xarray<'py>(
    py: Python<'py>,
    variables: &Bound<'py, PyDict>,
    coordinates: &Bound<'py, PyDict>,
    id: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let options = PyDict::new(py);
    options.set_item("data_vars", variables)?;
    options.set_item("coords", coordinates)?;
    let attributes = PyDict::new(py);
    attributes.set_item("id", id)?;
    options.set_item("attrs", attributes)?;
    py.import("xarray")?
        .getattr("Dataset")?
        .call((), Some(&options))
}
