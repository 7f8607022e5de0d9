//! A recording as the instruments wrote it, as arrays.

use std::sync::Arc;

use deacal::checks::check_all;
use deacal::jobs::load;
use deacal::recording::{RawColumn, RawCoordinate, RawElongation, RawLoad, Recording as Raw, Rig};
use deacal::report::arrays::Arrays;
use deacal::report::json::FindingJson;
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};

use crate::arrays::{frame, one, rows, xarray};
use crate::json::to_python;
use crate::table::Table;
use crate::work::run;

/// One signal: its name, the clock that it is on, its unit, and how many columns it has.
struct Signal<'a> {
    name: &'static str,
    clock: Option<&'static str>,
    unit: String,
    values: Values<'a>,
}

enum Values<'a> {
    One(&'a [f64]),
    Points(&'a [[f64; 3]]),
    Channels(&'a [Vec<f64>]),
}

/// What an instrument wrote, in its own units, axes and clocks; NaN where a sample is missing.
///
/// Arrays are called by name, `recording["positions"]`, and read-only; `keys()` are the names, `units` their
/// units, `clocks` the array that has their times.
#[pyclass(frozen, module = "deacal")]
pub struct Recording {
    pub raw: Arc<Raw>,
    arrays: PyOnceLock<Py<PyDict>>,
}

impl Recording {
    pub fn new(raw: Raw) -> Self {
        Recording {
            raw: Arc::new(raw),
            arrays: PyOnceLock::new(),
        }
    }

    fn signals(&self) -> Vec<Signal<'_>> {
        let mut out = Vec::new();
        let mut add = |name, clock, unit: &str, values| {
            out.push(Signal {
                name,
                clock,
                unit: unit.to_owned(),
                values,
            });
        };
        let unit = |c: &RawColumn| c.unit.map_or("", |u| u.symbol);
        let raw = &self.raw;
        if let Some(m) = &raw.motion {
            add("time_s", None, "s", Values::One(&m.time_s));
            let points = Values::Points(&m.end_effector.xyz);
            add("positions", Some("time_s"), m.unit.symbol, points);
            if let Some(base) = &m.base {
                let points = Values::Points(&base.xyz);
                add("base_positions", Some("time_s"), m.unit.symbol, points);
            }
        }
        if let Some(v) = &raw.voltage {
            let clock = "voltage_time_s";
            add(clock, None, "s", Values::One(&v.time_s));
            let values = Values::Channels(&v.channels);
            add("voltages", Some(clock), v.unit.symbol, values);
        }
        if let Some(m) = raw.monitor.as_ref().filter(|m| !m.channels.is_empty()) {
            let clock = "monitor_time_s";
            add(clock, None, "s", Values::One(&m.time_s));
            let values = Values::Channels(&m.channels);
            add("monitor_voltages", Some(clock), m.unit.symbol, values);
        }
        // clock of plain tables
        let times = [
            raw.coupon.as_ref().and_then(|c| c.time_s.as_ref()),
            raw.bench.as_ref().and_then(|b| b.time_s.as_ref()),
            raw.axis.as_ref().map(|a| &a.time_s),
        ];
        let time = times.into_iter().flatten().next();
        let clock = time.map(|_| "time_s");
        if let Some(time) = time {
            add("time_s", None, "s", Values::One(time));
        }
        if let Some(c) = &raw.coupon {
            let (name, column) = match &c.elongation {
                RawElongation::Displacement { displacement, .. } => ("displacement", displacement),
                RawElongation::Stretch(stretch) => ("stretch", stretch),
            };
            add(name, clock, unit(column), Values::One(&column.values));
            let (name, column) = match &c.load {
                RawLoad::Force { force, .. } => ("force", force),
                RawLoad::NominalStress(stress) => ("stress", stress),
            };
            add(name, clock, unit(column), Values::One(&column.values));
        }
        if let Some(b) = &raw.bench {
            add("angle", clock, unit(&b.angle), Values::One(&b.angle.values));
            let torque = Values::One(&b.torque.values);
            add("torque", clock, unit(&b.torque), torque);
        }
        if let Some(a) = &raw.axis {
            let (name, column) = match &a.coordinate {
                RawCoordinate::Position(column) => ("position", column),
                RawCoordinate::Velocity(column) => ("velocity", column),
            };
            add(name, clock, unit(column), Values::One(&column.values));
            let mut input = clock;
            if let Some(time) = &a.input_time_s {
                input = Some("input_time_s");
                add("input_time_s", None, "s", Values::One(time));
            }
            add("input", input, &a.input_unit, Values::One(&a.input.values));
            if let Some(load) = &a.load {
                add("load", clock, unit(load), Values::One(&load.values));
            }
        }
        out
    }

    /// All arrays by name, made once.
    fn all<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let made = self.arrays.get_or_try_init(py, || {
            let all = PyDict::new(py);
            for signal in self.signals() {
                let array = match signal.values {
                    Values::One(values) => one(py, values)?,
                    Values::Points(points) => rows(py, points.len(), 3, |i, k| points[i][k])?,
                    Values::Channels(c) => {
                        rows(py, c.first().map_or(0, Vec::len), c.len(), |i, k| c[k][i])?
                    }
                };
                all.set_item(signal.name, array)?;
            }
            Ok::<_, PyErr>(all.unbind())
        })?;
        Ok(made.bind(py).clone())
    }

    fn find<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.all(py)?.get_item(name)
    }

    /// Names of the signals on a clock, and whether each has several columns.
    fn on(&self, clock: &str) -> Vec<(&'static str, Vec<String>)> {
        let on = |s: &Signal| s.clock == Some(clock);
        let signals = self.signals().into_iter().filter(on);
        let columns = |s: &Signal| match s.values {
            Values::One(_) => Vec::new(),
            Values::Points(_) => ["x", "y", "z"].map(String::from).to_vec(),
            Values::Channels(c) => (1..=c.len()).map(|k| k.to_string()).collect(),
        };
        signals.map(|s| (s.name, columns(&s))).collect()
    }
}

#[pymethods]
impl Recording {
    /// Identity, as recording.toml states it.
    #[getter]
    fn id(&self) -> &str {
        &self.raw.manifest.id
    }

    /// What was recorded: "robot", "film-sample", "film-coupon", "hinge-bench" or "axis".
    #[getter]
    fn kind(&self) -> &'static str {
        self.raw.manifest.kind.name()
    }

    /// The recording.toml.
    #[getter]
    fn path(&self) -> &std::path::Path {
        &self.raw.path
    }

    /// Id of the rig; None where the recording has none.
    #[getter]
    fn rig(&self) -> Option<&str> {
        match &self.raw.rig {
            Some(Rig::Robot(rig)) => Some(&rig.id),
            Some(Rig::FilmSample(rig)) => Some(&rig.id),
            None => None,
        }
    }

    /// Time of each sample on the clock of the motion or of the table, s, shape (n,); None without a clock.
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.find(py, "time_s")
    }

    /// Positions of the marker that moves, in capture axes, shape (n, 3); None but for robots and samples.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.find(py, "positions")
    }

    /// Time of each voltage on the clock of the voltages, s, shape (m,); None but for robots and samples.
    #[getter]
    fn voltage_time_s<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.find(py, "voltage_time_s")
    }

    /// Commanded voltages, one column a channel, shape (m, channels); None but for robots and samples.
    #[getter]
    fn voltages<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.find(py, "voltages")
    }

    /// Unit of each array, as the file has it; "" where it has none.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for s in self.signals() {
            out.set_item(s.name, s.unit)?;
        }
        Ok(out)
    }

    /// The array that has the times of each; None for those arrays themselves, and where rows have no times.
    #[getter]
    fn clocks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for s in self.signals() {
            out.set_item(s.name, s.clock)?;
        }
        Ok(out)
    }

    /// Gaps of the capture: time of the first missing sample, s, and how many are missing.
    #[getter]
    fn gaps(&self) -> Vec<(f64, usize)> {
        let Some(m) = &self.raw.motion else {
            return Vec::new();
        };
        let mut out: Vec<(f64, usize)> = Vec::new();
        let mut within = false;
        for (t, p) in m.time_s.iter().zip(&m.end_effector.xyz) {
            let missing = p.iter().any(|v| v.is_nan());
            match out.last_mut() {
                Some((_, n)) if missing && within => *n += 1,
                _ if missing => out.push((*t, 1)),
                _ => {}
            }
            within = missing;
        }
        out
    }

    /// What was found and dropped while the files were read.
    #[getter]
    fn notes(&self) -> Vec<String> {
        let note = |n: &deacal::recording::Note| format!("{}: {}", n.path.display(), n.text);
        self.raw.notes.iter().map(note).collect()
    }

    /// Names of the arrays.
    fn keys(&self) -> Vec<&'static str> {
        self.signals().iter().map(|s| s.name).collect()
    }

    fn __contains__(&self, name: &str) -> bool {
        self.keys().contains(&name)
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.find(py, name)?.ok_or_else(|| {
            let known = self.keys().join(", ");
            PyKeyError::new_err(format!("there is no `{name}`; there are: {known}"))
        })
    }

    /// What is wrong with the recording, or looks so: wiring, axes, units, clocks. One dict a finding, with
    /// what is seen and what to do.
    fn check<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let raw = Arc::clone(&self.raw);
        let found = py.detach(move || FindingJson::of(&check_all(std::slice::from_ref(&raw))));
        to_python(py, &serde_json::json!(found))
    }

    /// A robot's recording on one clock, in world axes, smoothed, with derivatives: what `deacal import`
    /// leaves. `plan` is the plan.toml of an earlier run, to make the same choices again.
    #[pyo3(signature = (plan=None, *, progress=None))]
    fn aligned<'py>(
        &self,
        py: Python<'py>,
        plan: Option<std::path::PathBuf>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Table> {
        let raw = Arc::clone(&self.raw);
        let columns = run(py, progress, move |progress| {
            load::of_one_kind(
                std::slice::from_ref(&raw),
                &[deacal::recording::Kind::Robot],
            )?;
            let plans = load::plans(plan.as_ref())?;
            let datasets = load::aligned(std::slice::from_ref(&raw), &plans, progress)?;
            Ok(Arrays::of(&datasets[0], None).columns().to_vec())
        })?;
        Ok(Table::new(columns, Vec::new()))
    }

    /// The signals on one clock as a pandas.DataFrame, with the times as index where there are any. Another
    /// clock than that of the motion or table is named: `to_pandas("voltage_time_s")`.
    #[pyo3(signature = (clock="time_s"))]
    fn to_pandas<'py>(&self, py: Python<'py>, clock: &str) -> PyResult<Bound<'py, PyAny>> {
        let columns = PyDict::new(py);
        let time = self.find(py, clock)?;
        if time.is_none() && (clock != "time_s" || self.raw.motion.is_some()) {
            return Err(PyKeyError::new_err(format!("there is no clock `{clock}`")));
        }
        let on = match time {
            Some(_) => self.on(clock),
            None => self.keys().into_iter().map(|k| (k, Vec::new())).collect(),
        };
        for (name, parts) in on {
            let array = self.__getitem__(py, name)?;
            if parts.is_empty() {
                columns.set_item(name, &array)?;
            }
            for (k, part) in parts.iter().enumerate() {
                let column = array.getattr("T")?.get_item(k)?;
                columns.set_item(format!("{name}_{part}"), column)?;
            }
        }
        frame(py, &columns, time.map(|t| (clock, t)))
    }

    /// Everything as an xarray.Dataset: the clocks are its dimensions, units are attributes.
    fn to_xarray<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (variables, times) = (PyDict::new(py), PyDict::new(py));
        for s in self.signals() {
            let array = self.__getitem__(py, s.name)?;
            let attributes = PyDict::new(py);
            attributes.set_item("units", &s.unit)?;
            let is_clock = s.name.ends_with("time_s");
            let along = if is_clock {
                s.name
            } else {
                s.clock.unwrap_or("row")
            };
            let dimensions = match s.values {
                Values::One(_) => PyTuple::new(py, [along])?,
                Values::Points(_) => PyTuple::new(py, [along, "axis"])?,
                Values::Channels(_) => PyTuple::new(py, [along, "channel"])?,
            };
            let of = if is_clock { &times } else { &variables };
            of.set_item(s.name, (dimensions, array, attributes))?;
        }
        if self.raw.motion.is_some() {
            times.set_item("axis", vec!["x", "y", "z"])?;
        }
        xarray(py, &variables, &times, self.id())
    }

    fn __repr__(&self) -> String {
        format!(
            "<deacal.Recording `{}` ({}): {}>",
            self.id(),
            self.kind(),
            self.keys().join(", ")
        )
    }
}
