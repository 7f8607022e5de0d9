//! What jobs find: numbers, and the files that the program leaves.

use std::path::PathBuf;

use deacal::jobs::Files;
use deacal::jobs::diagnose::Diagnosed;
use deacal::jobs::fit::Fitted;
use deacal::jobs::load;
use deacal::jobs::validate::Validated;
use deacal::report::json::{Named, ParameterJson};
use deacal::report::output::{Overwrite, write_atomic};
use deacal::report::parameter_file::ParameterFile as File;
use numpy::{PyArray1, PyArray2, PyArrayMethods as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;

use crate::json::to_python;
use crate::work::raised;

/// What may be overwritten.
pub fn overwrite(force: bool) -> Overwrite {
    match force {
        true => Overwrite::Any,
        false => Overwrite::Own,
    }
}

/// What a job found: its numbers as the program's JSON file has them, its report, and all of its files.
#[pyclass(frozen, subclass, module = "deacal")]
pub struct Result {
    json: Value,
    files: Files,
}

impl Result {
    pub fn new(json: Value, files: Files) -> Self {
        Result { json, files }
    }

    fn words(&self, key: &str) -> Option<String> {
        self.json.get(key)?.as_str().map(String::from)
    }
}

#[pymethods]
impl Result {
    /// All numbers and words, in the keys of the JSON file that the program writes.
    #[getter]
    fn json<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &self.json)
    }

    /// What a reader should know beside.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        let list = self.json.get("remarks").and_then(Value::as_array);
        let each = list.into_iter().flatten().filter_map(Value::as_str);
        each.map(String::from).collect()
    }

    /// Names of the files that `save` writes.
    #[getter]
    fn files(&self) -> Vec<&str> {
        self.files.names().collect()
    }

    /// The report: a page of HTML that needs nothing else.
    fn report(&self) -> &str {
        self.files.text("report.html").unwrap_or_default()
    }

    /// Writes what the program writes into a folder, all files or none, and gives their paths. Files that are
    /// not the program's own are overwritten only with `force`.
    #[pyo3(signature = (folder, *, force=false))]
    fn save(&self, py: Python<'_>, folder: PathBuf, force: bool) -> PyResult<Vec<PathBuf>> {
        let written = py.detach(|| {
            let set = self.files.stage(&folder, overwrite(force))?;
            set.commit()
        });
        written.map_err(|e| raised(&e.into()))
    }

    /// The report within a notebook, in a frame of its own.
    fn _repr_html_(&self) -> String {
        let page = self.report().replace('&', "&amp;").replace('"', "&quot;");
        format!(
            "<iframe srcdoc=\"{page}\" style=\"width: 100%; height: 46em; border: 0\" \
             sandbox=\"allow-scripts\"></iframe>"
        )
    }
}

/// An estimated or held parameter. `float(parameter)` is its value.
#[pyclass(frozen, module = "deacal")]
pub struct Parameter {
    name: String,
    of: ParameterJson,
}

#[pymethods]
impl Parameter {
    /// Name, as `fix` and `bound` take it.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// Value, in `unit`.
    #[getter]
    fn value(&self) -> f64 {
        self.of.value.unwrap_or(f64::NAN)
    }

    /// Unit of value, standard error and interval.
    #[getter]
    fn unit(&self) -> &str {
        &self.of.unit
    }

    /// Standard error; None where it was held, rests on a bound or is not determined.
    #[getter]
    fn std_error(&self) -> Option<f64> {
        self.of.std_error
    }

    /// 95 % interval; None where there is none. An open end is infinite.
    #[getter]
    fn ci95(&self) -> Option<(f64, f64)> {
        let [low, high] = self.of.ci95?;
        Some((
            low.unwrap_or(f64::NEG_INFINITY),
            high.unwrap_or(f64::INFINITY),
        ))
    }

    /// The bound on which it rests: "lower", "upper" or None.
    #[getter]
    fn at_bound(&self) -> Option<&str> {
        self.of.bound.as_deref()
    }

    /// Whether the recordings determine it.
    #[getter]
    fn identifiable(&self) -> bool {
        self.of.identifiable
    }

    /// Whether it was held.
    #[getter]
    fn fixed(&self) -> bool {
        self.of.fixed
    }

    /// What it is.
    #[getter]
    fn meaning(&self) -> &str {
        &self.of.meaning
    }

    /// How far to trust it, in words.
    #[getter]
    fn says(&self) -> &str {
        &self.of.says
    }

    fn __float__(&self) -> f64 {
        self.value()
    }

    fn __repr__(&self) -> String {
        let interval = self
            .ci95()
            .map(|(low, high)| format!(", 95 % in [{low}, {high}]"));
        let interval = interval.unwrap_or_default();
        format!(
            "<{} = {} {}{interval}>",
            self.name,
            self.value(),
            self.of.unit
        )
    }
}

/// A parameter file: what predictions, simulations and further fits begin from.
#[pyclass(frozen, subclass, module = "deacal")]
pub struct ParameterFile {
    /// What it is called in words: its path, or what it is of.
    pub name: String,
    pub text: String,
}

#[pymethods]
impl ParameterFile {
    /// Reads a parameters.toml, or "library:NAME". Numbers that cannot be are an error.
    #[staticmethod]
    pub fn read(path: PathBuf) -> PyResult<Self> {
        let file = load::parameters(&path).map_err(|e| raised(&e))?;
        Ok(ParameterFile {
            name: path.display().to_string(),
            text: file.to_toml().map_err(|e| raised(&e.into()))?,
        })
    }

    /// The file as TOML; it reads back to the same bits.
    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    /// Film, forearm and causes as plain Python, as `deacal export --format json` writes them.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let file = File::parse(self.name.as_ref(), &self.text);
        let file = file.map_err(|e| raised(&e.into()))?;
        let json = serde_json::to_value(file.to_json()).map_err(|e| raised(&e.into()))?;
        to_python(py, &json)
    }

    /// Writes it. A file that is not the program's own is overwritten only with `force`.
    #[pyo3(signature = (path, *, force=false))]
    fn save(&self, path: PathBuf, force: bool) -> PyResult<()> {
        let written = write_atomic(&path, overwrite(force), &self.text);
        written.map(drop).map_err(|e| raised(&e.into()))
    }

    fn __repr__(&self) -> String {
        format!("<deacal.ParameterFile {}>", self.name)
    }
}

/// The parameter file among the files of a result.
fn parameter_file(of: &Result) -> Option<ParameterFile> {
    Some(ParameterFile {
        name: format!(
            "parameters of this {}",
            of.words("job").as_deref().unwrap_or("diagnosis")
        ),
        text: of.files.text("parameters.toml")?.to_owned(),
    })
}

/// What a fit found.
#[pyclass(frozen, extends = Result, module = "deacal")]
pub struct Fit {
    parameters: Named<ParameterJson>,
    says: String,
    /// Names of the free parameters, and their correlation.
    names: Vec<String>,
    correlation: Vec<Vec<f64>>,
}

impl Fit {
    pub fn init(fitted: Fitted) -> PyResult<PyClassInitializer<Self>> {
        let json = serde_json::to_value(&fitted.fit).map_err(|e| raised(&e.into()))?;
        let known = |row: Vec<Option<f64>>| row.into_iter().map(|v| v.unwrap_or(f64::NAN));
        let rows = fitted.fit.correlation.rows.into_iter();
        let fit = Fit {
            parameters: fitted.fit.parameters,
            says: fitted.answer.says,
            names: fitted.fit.correlation.names,
            correlation: rows.map(|row| known(row).collect()).collect(),
        };
        Ok(PyClassInitializer::from(Result::new(json, fitted.files)).add_subclass(fit))
    }

    fn matrix<'py>(
        &self,
        py: Python<'py>,
        value: impl Fn(usize, usize) -> f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.names.len();
        let all = (0..n).flat_map(|i| (0..n).map(move |k| (i, k)));
        let flat: Vec<f64> = all.map(|(i, k)| value(i, k)).collect();
        PyArray1::from_vec(py, flat).reshape([n, n])
    }
}

#[pymethods]
impl Fit {
    /// What was fitted: "film", "forearm", "robot", "sample", "coupon", "hinge" or "axis".
    #[getter]
    fn job(slf: &Bound<'_, Self>) -> Option<String> {
        slf.as_super().get().words("job")
    }

    /// The answer in one or two sentences.
    #[getter]
    fn says(&self) -> &str {
        &self.says
    }

    /// Every parameter by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for (name, of) in &self.parameters.0 {
            let parameter = Parameter {
                name: name.clone(),
                of: of.clone(),
            };
            out.set_item(name, Bound::new(py, parameter)?)?;
        }
        Ok(out)
    }

    /// Names of the free parameters: rows and columns of `covariance` and `correlation`.
    #[getter]
    fn free(&self) -> Vec<&str> {
        self.names.iter().map(String::as_str).collect()
    }

    /// Correlation of the free parameters, shape (n, n).
    #[getter]
    fn correlation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.matrix(py, |i, k| self.correlation[i][k])
    }

    /// Covariance of the free parameters, shape (n, n), in their units; NaN where one has no standard error.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let error = |name: &String| self.parameters.get(name).and_then(|p| p.std_error);
        let errors: Vec<f64> = self
            .names
            .iter()
            .map(|n| error(n).unwrap_or(f64::NAN))
            .collect();
        self.matrix(py, |i, k| self.correlation[i][k] * errors[i] * errors[k])
    }

    /// Whether the fit converged.
    #[getter]
    fn converged(slf: &Bound<'_, Self>) -> bool {
        slf.as_super().get().json["converged"] == Value::Bool(true)
    }

    /// Root mean square error, in `rmse_unit`, over the samples that count; None where none does.
    #[getter]
    fn rmse(slf: &Bound<'_, Self>) -> Option<f64> {
        slf.as_super().get().json["rmse_V"].as_f64()
    }

    /// Unit of the error.
    #[getter]
    fn rmse_unit(slf: &Bound<'_, Self>) -> Option<String> {
        slf.as_super().get().words("rmse_unit")
    }

    /// The parameter file, for predictions, simulations and further fits.
    #[getter]
    fn parameter_file(slf: &Bound<'_, Self>) -> Option<ParameterFile> {
        parameter_file(slf.as_super().get())
    }

    fn __repr__(slf: &Bound<'_, Self>) -> String {
        let job = Self::job(slf).unwrap_or_default();
        format!("<deacal.Fit ({job}): {}>", slf.get().says)
    }
}

/// What a validation found, of the first parameters where several were given.
#[pyclass(frozen, extends = Result, module = "deacal")]
pub struct Validation {
    answers: Vec<String>,
}

impl Validation {
    pub fn init(found: Validated) -> PyResult<PyClassInitializer<Self>> {
        let json = serde_json::to_value(&found.json).map_err(|e| raised(&e.into()))?;
        let answers = found.held.into_iter().map(|h| h.answer.says).collect();
        let result = PyClassInitializer::from(Result::new(json, found.files));
        Ok(result.add_subclass(Validation { answers }))
    }
}

#[pymethods]
impl Validation {
    /// Whether they predict, in a sentence.
    #[getter]
    fn says(&self) -> &str {
        self.answers.first().map_or("", String::as_str)
    }

    /// The sentence of each of the parameters, in the order in which they were given.
    #[getter]
    fn answers(&self) -> Vec<&str> {
        self.answers.iter().map(String::as_str).collect()
    }

    /// Root mean square error of the prediction, in `rmse_unit`; None where no sample counts.
    #[getter]
    fn rmse(slf: &Bound<'_, Self>) -> Option<f64> {
        slf.as_super().get().json["rmse_V"].as_f64()
    }

    /// Unit of the errors.
    #[getter]
    fn rmse_unit(slf: &Bound<'_, Self>) -> Option<String> {
        slf.as_super().get().words("rmse_unit")
    }

    /// What the noise of the capture alone makes of the prediction, in `rmse_unit`.
    #[getter]
    fn noise_floor(slf: &Bound<'_, Self>) -> Option<f64> {
        slf.as_super().get().json["noise_floor_V"].as_f64()
    }

    /// Each recording: one dict with its errors, and with those of path, force and stroke where they were
    /// predicted.
    #[getter]
    fn recordings<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        to_python(slf.py(), &slf.as_super().get().json["recordings"])
    }

    fn __repr__(&self) -> String {
        format!("<deacal.Validation: {}>", self.answers.join(" "))
    }
}

/// What a diagnosis found.
#[pyclass(frozen, extends = Result, module = "deacal")]
pub struct Diagnosis {}

impl Diagnosis {
    pub fn init(found: Diagnosed) -> PyResult<PyClassInitializer<Self>> {
        let json = serde_json::to_value(&found.json).map_err(|e| raised(&e.into()))?;
        Ok(PyClassInitializer::from(Result::new(json, found.files)).add_subclass(Diagnosis {}))
    }
}

#[pymethods]
impl Diagnosis {
    /// "adequate", "missing_physics", "unexplained", or "recording": first mend what `findings` say.
    #[getter]
    fn verdict(slf: &Bound<'_, Self>) -> Option<String> {
        slf.as_super().get().words("verdict")
    }

    /// Probability of the verdict; None where the recordings have to be mended first and no check has odds.
    #[getter]
    fn confidence(slf: &Bound<'_, Self>) -> Option<f64> {
        slf.as_super().get().json["confidence"].as_f64()
    }

    /// The verdict in one or two sentences.
    #[getter]
    fn says(slf: &Bound<'_, Self>) -> Option<String> {
        slf.as_super().get().words("says")
    }

    /// Causes, most probable first: one dict each, with `effect`, `probability`, `in_model`, `parameters`.
    #[getter]
    fn candidates<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        to_python(slf.py(), &slf.as_super().get().json["candidates"])
    }

    /// Where model and recordings differ, most telling first: one dict a place.
    #[getter]
    fn places<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        to_python(slf.py(), &slf.as_super().get().json["where"])
    }

    /// What is wrong with the recordings, or looks so: one dict a finding.
    #[getter]
    fn findings<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let none = Value::Array(Vec::new());
        let found = slf.as_super().get().json.get("findings");
        to_python(slf.py(), found.unwrap_or(&none))
    }

    /// What to record next.
    #[getter]
    fn next_experiment(slf: &Bound<'_, Self>) -> Option<String> {
        slf.as_super().get().words("next_experiment")
    }

    /// The model with what was missing; None where the recordings have to be mended first.
    #[getter]
    fn parameter_file(slf: &Bound<'_, Self>) -> Option<ParameterFile> {
        parameter_file(slf.as_super().get())
    }

    fn __repr__(slf: &Bound<'_, Self>) -> String {
        let verdict = Self::verdict(slf).unwrap_or_default();
        format!(
            "<deacal.Diagnosis: {verdict}. {}>",
            Self::says(slf).unwrap_or_default()
        )
    }
}

/// What a comparison of electrodes found.
#[pyclass(frozen, extends = Result, module = "deacal")]
pub struct Ageing {
    verdict: String,
}

impl Ageing {
    pub fn init(json: Value, verdict: String, files: Files) -> PyClassInitializer<Self> {
        PyClassInitializer::from(Result::new(json, files)).add_subclass(Ageing { verdict })
    }
}

#[pymethods]
impl Ageing {
    /// The verdict in a sentence.
    #[getter]
    fn says(&self) -> &str {
        &self.verdict
    }

    /// Stroke and its change with intervals, by electrode and by day or batch.
    #[getter]
    fn electrodes<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        to_python(slf.py(), &slf.as_super().get().json["electrodes"])
    }

    /// What moved, by electrode, most probable first.
    #[getter]
    fn causes<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        to_python(slf.py(), &slf.as_super().get().json["causes"])
    }

    fn __repr__(&self) -> String {
        format!("<deacal.Ageing: {}>", self.verdict)
    }
}
