//! deacal for Python: a thin layer over the jobs of the library, which the command line calls too.

mod arguments;
mod arrays;
mod jobs;
mod json;
mod library;
mod recording;
mod results;
mod table;
mod work;

/// Calibrates dielectric-elastomer actuators, and says which physics the model leaves out.
#[pyo3::pymodule]
mod _deacal {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::jobs::{
        Prediction, Simulated, ageing, diagnose, fit_axis, fit_coupon, fit_film, fit_forearm,
        fit_hinge, fit_robot, fit_sample, predict, read, simulate, validate,
    };
    #[pymodule_export]
    use crate::library::{Library, ParameterSet};
    #[pymodule_export]
    use crate::recording::Recording;
    #[pymodule_export]
    use crate::results::{Ageing, Diagnosis, Fit, Parameter, ParameterFile, Result, Validation};
    #[pymodule_export]
    use crate::table::Table;
    #[pymodule_export]
    use crate::work::DeacalError;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("library", Library)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
