//! The jobs as functions of Python.

use std::path::PathBuf;

use deacal::calibration::{
    AgeingRequest, By, CouponRequest, LineRequest, Request, SampleRequest, Stage,
};
use deacal::diagnosis;
use deacal::fit::memory::Memory;
use deacal::jobs::load::{self, Given};
use deacal::jobs::predict::What;
use deacal::jobs::simulate::{Course, Simulation};
use deacal::jobs::{
    ageing as of_ageing, diagnose as of_diagnosis, fit, predict as of_prediction,
    simulate as of_simulation, validate as of_validation,
};
use deacal::recording::{Kind, is_id};
use deacal::report::output::OutputSet;
use deacal::report::parameter_file::Effect;
use deacal::residual::motion::Between;
use deacal::simulate::{Hold, Sampled};
use numpy::{AllowTypeChange, PyArrayLikeDyn};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::arguments::{
    Bounds, Call, Fixed, Parameters, Several, Source, Sources, argument, one_of, within,
};
use crate::arrays::{one, rows};
use crate::json::to_python;
use crate::recording::Recording;
use crate::results::{Ageing, Diagnosis, Fit, Validation, overwrite};
use crate::table::Table;
use crate::work::{raised, run};

/// What a user wants to see of the way.
type Shown<'py> = Option<Bound<'py, PyAny>>;

/// Reads a recording: a recording.toml, or a folder that has one. `rig` is used instead of its own.
#[pyfunction]
#[pyo3(signature = (path, *, rig=None, progress=None))]
pub fn read<'py>(
    py: Python<'py>,
    path: PathBuf,
    rig: Option<PathBuf>,
    progress: Shown<'py>,
) -> PyResult<Recording> {
    let mut all = run(py, progress, move |progress| {
        load::opened(&[path], rig.as_ref(), progress)
    })?;
    Ok(Recording::new(all.remove(0)))
}

/// What every fit with starts can be asked.
struct Common {
    fix: Fixed,
    bound: Bounds,
    branches: usize,
    starts: usize,
    seed: u64,
}

impl Common {
    fn new(
        fix: Option<Fixed>,
        bound: Option<Bounds>,
        branches: i64,
        starts: i64,
        seed: u64,
    ) -> PyResult<Self> {
        Ok(Common {
            fix: fix.unwrap_or_default(),
            bound: bound.unwrap_or_default(),
            branches: within("branches", branches, 0..=8)? as usize,
            starts: within("starts", starts, 1..=1000)? as usize,
            seed,
        })
    }

    /// The call with what was asked for.
    fn call(&self, function: &str, recordings: &Sources, start: Option<&Parameters>) -> Call {
        held(Call::new(function, recordings), &self.fix, &self.bound)
            .word("start", start.map(Parameters::name).as_deref())
            .with("branches", self.branches != 6, self.branches)
            .with("starts", self.starts != 5, self.starts)
            .with("seed", self.seed != 1, self.seed)
    }
}

/// A call with what was held.
fn held(call: Call, fix: &Fixed, bound: &Bounds) -> Call {
    let fixes: Vec<String> = fix.0.iter().map(|(n, v)| format!("{n:?}: {v}")).collect();
    let pair = |(n, [low, high]): &(String, [f64; 2])| format!("{n:?}: ({low}, {high})");
    let bounds: Vec<String> = bound.0.iter().map(pair).collect();
    call.with(
        "fix",
        !fixes.is_empty(),
        format!("{{{}}}", fixes.join(", ")),
    )
    .with(
        "bound",
        !bounds.is_empty(),
        format!("{{{}}}", bounds.join(", ")),
    )
}

/// Of a path, its words.
fn words(path: Option<&PathBuf>) -> Option<String> {
    path.map(|p| p.display().to_string())
}

/// A fit of one stage to recordings of a robot.
macro_rules! robot_fit {
    ($name:ident, $stage:expr, $doc:literal) => {
        #[doc = $doc]
        #[pyfunction]
        #[pyo3(signature = (
            recordings, *, start=None, rig=None, plan=None, fix=None, bound=None, branches=6, starts=5,
            seed=1, robust=None, progress=None
        ))]
        #[allow(clippy::too_many_arguments)]
        pub fn $name<'py>(
            py: Python<'py>,
            recordings: Sources,
            start: Option<Parameters>,
            rig: Option<PathBuf>,
            plan: Option<PathBuf>,
            fix: Option<Fixed>,
            bound: Option<Bounds>,
            branches: i64,
            starts: i64,
            seed: u64,
            robust: Option<f64>,
            progress: Shown<'py>,
        ) -> PyResult<Bound<'py, Fit>> {
            let common = Common::new(fix, bound, branches, starts, seed)?;
            let command = common
                .call(stringify!($name), &recordings, start.as_ref())
                .word("rig", words(rig.as_ref()).as_deref())
                .word("plan", words(plan.as_ref()).as_deref())
                .with("robust", robust.is_some(), robust.unwrap_or_default())
                .text();
            let found = run(py, progress, move |progress| {
                let all = recordings.open(rig.as_ref(), &[Kind::Robot], progress)?;
                let start = start.map(|s| s.read()).transpose()?;
                let given = Given::new(all, 0, &command).look_over(progress);
                let request = Request {
                    branches: common.branches,
                    fix: common.fix.0,
                    bound: common.bound.0,
                    starts: common.starts,
                    robust,
                    seed: common.seed,
                    ..Request::new($stage)
                };
                let plans = load::plans(plan.as_ref())?;
                fit::robot(given, start.as_ref(), &plans, request, progress)
            })?;
            Bound::new(py, Fit::init(found)?)
        }
    };
}

robot_fit!(
    fit_film,
    Stage::Film,
    "Fits film moduli, relaxation times and J to recordings of a robot, best of a symmetric drive."
);
robot_fit!(
    fit_forearm,
    Stage::Forearm,
    "Fits the spring-back torque of the forearms, best of single drives. The film is that of `start`."
);
robot_fit!(
    fit_robot,
    Stage::Robot,
    "Fits film and forearms jointly, to all recordings at once."
);

/// Fits film parameters to hanging samples. J and electrode effects of `start` are held.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, start=None, rig=None, fix=None, bound=None, branches=6, starts=5, seed=1, progress=None
))]
#[allow(clippy::too_many_arguments)]
pub fn fit_sample<'py>(
    py: Python<'py>,
    recordings: Sources,
    start: Option<Parameters>,
    rig: Option<PathBuf>,
    fix: Option<Fixed>,
    bound: Option<Bounds>,
    branches: i64,
    starts: i64,
    seed: u64,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Fit>> {
    let common = Common::new(fix, bound, branches, starts, seed)?;
    let command = common
        .call("fit_sample", &recordings, start.as_ref())
        .word("rig", words(rig.as_ref()).as_deref())
        .text();
    let found = run(py, progress, move |progress| {
        let all = recordings.open(rig.as_ref(), &[Kind::FilmSample], progress)?;
        let start = start.map(|s| s.read()).transpose()?;
        let given = Given::new(all, 0, &command).look_over(progress);
        let request = SampleRequest {
            fix: common.fix.0,
            bound: common.bound.0,
            starts: common.starts,
            seed: common.seed,
            ..SampleRequest::new(common.branches)
        };
        fit::sample(given, start.as_ref(), request, progress)
    })?;
    Bound::new(py, Fit::init(found)?)
}

/// Fits film parameters to tensile and relaxation tests.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, fix=None, bound=None, branches=6, starts=5, seed=1, progress=None
))]
#[allow(clippy::too_many_arguments)]
pub fn fit_coupon<'py>(
    py: Python<'py>,
    recordings: Sources,
    fix: Option<Fixed>,
    bound: Option<Bounds>,
    branches: i64,
    starts: i64,
    seed: u64,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Fit>> {
    let common = Common::new(fix, bound, branches, starts, seed)?;
    let command = common.call("fit_coupon", &recordings, None).text();
    let found = run(py, progress, move |progress| {
        let all = recordings.open(None, &[Kind::FilmCoupon], progress)?;
        let given = Given::new(all, 0, &command).look_over(progress);
        let request = CouponRequest {
            fix: common.fix.0,
            bound: common.bound.0,
            starts: common.starts,
            seed: common.seed,
            ..CouponRequest::new(common.branches)
        };
        fit::coupon(given, request, progress)
    })?;
    Bound::new(py, Fit::init(found)?)
}

/// Fits a single coordinate.
fn line<'py>(
    py: Python<'py>,
    (recordings, kind): (Sources, Kind),
    (fix, bound): (Option<Fixed>, Option<Bounds>),
    objective: fit::Objective,
    call: Call,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Fit>> {
    let (fix, bound) = (fix.unwrap_or_default(), bound.unwrap_or_default());
    let command = held(call, &fix, &bound).text();
    let found = run(py, progress, move |progress| {
        let all = recordings.open(None, &[kind], progress)?;
        let given = Given::new(all, 0, &command).look_over(progress);
        let request = LineRequest {
            fix: fix.0,
            bound: bound.0,
        };
        fit::line(given, request, objective, progress)
    })?;
    Bound::new(py, Fit::init(found)?)
}

/// Fits the torque curve of a flexure hinge to recordings of its bench.
#[pyfunction]
#[pyo3(signature = (recordings, *, fix=None, bound=None, progress=None))]
pub fn fit_hinge<'py>(
    py: Python<'py>,
    recordings: Sources,
    fix: Option<Fixed>,
    bound: Option<Bounds>,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Fit>> {
    let call = Call::new("fit_hinge", &recordings);
    let given = (recordings, Kind::HingeBench);
    line(
        py,
        given,
        (fix, bound),
        fit::Objective::Input,
        call,
        progress,
    )
}

/// Fits mass, damping, stiffness and gain of an axis. `objective` "input" makes the error of the input small
/// that the motion needs, "motion" that of the motion that the input makes; then `cause` are ids of causes to
/// fit as well, or "choose" alone, without those of `without`, and `between` is what the input does between
/// samples: "straight", "held", "smooth", or what leaves least.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, fix=None, bound=None, objective="input", cause=Vec::new(), without=Vec::new(),
    between=None, progress=None
), text_signature = "(recordings, *, fix=None, bound=None, objective='input', cause=(), without=(), \
    between=None, progress=None)")]
#[allow(clippy::too_many_arguments)]
pub fn fit_axis<'py>(
    py: Python<'py>,
    recordings: Sources,
    fix: Option<Fixed>,
    bound: Option<Bounds>,
    objective: &str,
    cause: Vec<String>,
    without: Vec<String>,
    between: Option<&str>,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Fit>> {
    let motion = one_of(
        "objective",
        objective,
        &[("input", false), ("motion", true)],
    )?;
    let words = [
        ("straight", Between::Straight),
        ("held", Between::Held),
        ("smooth", Between::Smooth),
    ];
    let course = between
        .map(|word| one_of("between", word, &words))
        .transpose()?;
    let call = Call::new("fit_axis", &recordings)
        .word("objective", Some(objective).filter(|_| motion))
        .with("cause", !cause.is_empty(), format!("{cause:?}"))
        .with("without", !without.is_empty(), format!("{without:?}"))
        .word("between", between);
    let objective = fit::Objective::stated(motion, &cause, &without, course);
    let objective = objective.map_err(|why| PyValueError::new_err(why.to_string()))?;
    line(
        py,
        (recordings, Kind::Axis),
        (fix, bound),
        objective,
        call,
        progress,
    )
}

/// What was predicted of a recording: a table with a row a sample, named as the columns of the program's CSV.
#[pyclass(frozen, extends = Table, module = "deacal")]
pub struct Prediction {
    of: of_prediction::Prediction,
}

#[pymethods]
impl Prediction {
    /// The recording.
    #[getter]
    fn id(&self) -> &str {
        &self.of.id
    }

    /// In one sentence; "" where there is nothing to say.
    #[getter]
    fn says(&self) -> &str {
        &self.of.says
    }

    /// What a reader should know: causes that were not applied, learnt terms outside their ranges.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.of.remarks.clone()
    }

    /// Writes the table as CSV, each number to the digit that means something. Voltages of a robot as .npz,
    /// .mat or .mcap, or with `full`, come with the aligned recording and the residual, every digit. A file
    /// that is not the program's own is overwritten only with `force`.
    #[pyo3(signature = (path, *, full=false, force=false))]
    fn save(&self, py: Python<'_>, path: PathBuf, full: bool, force: bool) -> PyResult<()> {
        let saved = py.detach(|| self.of.save(&path, full, overwrite(force)));
        saved.map_err(|e| raised(&e))
    }

    fn __repr__(slf: &Bound<'_, Self>) -> String {
        let names = slf.get().of.columns();
        let names: Vec<&str> = names.iter().map(|c| c.name()).collect();
        let rows = slf.get().of.flags.len();
        format!("<deacal.Prediction of {rows} rows: {}>", names.join(", "))
    }
}

/// Predicts of a recording: "voltage" (motion to voltages, or the input of an axis), "force" (motion and
/// voltages to the force on the end effector; torque of a bench, stress of a coupon) or "motion" (forward,
/// from rest; of an axis the first `begin` samples tell where it begins).
#[pyfunction]
#[pyo3(signature = (
    recording, parameters, what="voltage", *, rig=None, plan=None, begin=0, progress=None
))]
#[allow(clippy::too_many_arguments)]
pub fn predict<'py>(
    py: Python<'py>,
    recording: Source,
    parameters: Parameters,
    what: &str,
    rig: Option<PathBuf>,
    plan: Option<PathBuf>,
    begin: usize,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Prediction>> {
    let known = [
        ("voltage", What::Voltage),
        ("force", What::Force),
        ("motion", What::Motion),
    ];
    let asked = one_of("what", what, &known)?;
    let given = Sources(vec![recording]);
    let command = Call::new("predict", &given)
        .word("parameters", Some(&parameters.name()))
        .word("what", Some(what))
        .word("rig", words(rig.as_ref()).as_deref())
        .word("plan", words(plan.as_ref()).as_deref())
        .with("begin", begin > 0, begin)
        .text();
    let (columns, flags, of) = run(py, progress, move |progress| {
        let mut all = given.open(rig.as_ref(), asked.kinds(), progress)?;
        let file = parameters.read()?;
        let plans = load::plans(plan.as_ref())?;
        let raw = all.remove(0);
        let found = of_prediction::predict(asked, raw, &file, &plans, begin, &command, progress)?;
        let n = found.flags.len();
        let values = |c: &deacal::report::csv::Column| (0..n).map(|i| c.value(i)).collect();
        let columns: Vec<(String, Vec<f64>)> = found
            .columns()
            .iter()
            .map(|c| (c.name().to_owned(), values(c)))
            .collect();
        let word = |f: &Option<_>| f.as_ref().map_or(String::new(), ToString::to_string);
        let flags: Vec<String> = found.flags.iter().map(word).collect();
        Ok((columns, flags, found))
    })?;
    let table = PyClassInitializer::from(Table::new(columns, flags));
    Bound::new(py, table.add_subclass(Prediction { of }))
}

/// Holds parameters, or several to compare, against recordings: measured against predicted voltage, path,
/// force and stroke. `path` is the planned path of the one recording (a CSV file): the measured path is held
/// against it.
#[pyfunction]
#[pyo3(signature = (
    recordings, parameters, *, rig=None, plan=None, path=None, compare=None, progress=None
))]
#[allow(clippy::too_many_arguments)]
pub fn validate<'py>(
    py: Python<'py>,
    recordings: Sources,
    parameters: Several,
    rig: Option<PathBuf>,
    plan: Option<PathBuf>,
    path: Option<PathBuf>,
    compare: Option<&str>,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Validation>> {
    let paper = compare
        .map(|with| one_of("compare", with, &[("paper", true)]))
        .transpose()?;
    let names: Vec<String> = parameters.0.iter().map(Parameters::name).collect();
    let command = Call::new("validate", &recordings)
        .with("parameters", true, format!("{names:?}"))
        .word("rig", words(rig.as_ref()).as_deref())
        .word("plan", words(plan.as_ref()).as_deref())
        .word("path", words(path.as_ref()).as_deref())
        .text();
    let found = run(py, progress, move |progress| {
        let all = recordings.open(rig.as_ref(), &of_validation::KINDS, progress)?;
        let given = Given::new(all, 0, &command).look_over(progress);
        let candidates = parameters.0.iter().map(Parameters::candidate);
        let candidates = candidates.collect::<Result<Vec<_>, _>>()?;
        let request = of_validation::Request {
            plans: load::plans(plan.as_ref())?,
            path: path.as_deref().map(load::path).transpose()?,
            paper: paper.is_some(),
        };
        of_validation::validate(given, &candidates, &request, progress)
    })?;
    Bound::new(py, Validation::init(found)?)
}

/// What was simulated: frames of the true motion, without noise, as a table, and the voltages.
#[pyclass(frozen, extends = Table, module = "deacal")]
pub struct Simulated {
    of: of_simulation::Simulated,
}

#[pymethods]
impl Simulated {
    /// Times of the voltages, s, shape (m,).
    #[getter]
    fn voltage_time_s<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let v = &self.of.voltage;
        let times = (0..v.samples_v().len()).map(|i| v.start_s() + i as f64 * v.step_s());
        one(py, &times.collect::<Vec<f64>>())
    }

    /// What the amplifier was told, V, shape (m, 3); of a sample all three are the same.
    #[getter]
    fn voltages<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let v = self.of.voltage.samples_v();
        rows(py, v.len(), 3, |i, k| v[i][k])
    }

    /// Causes that the plain model leaves out and that were at work: one dict each.
    #[getter]
    fn effects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &serde_json::json!(self.of.effects))
    }

    /// What a reader should know.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.of.remarks.clone()
    }

    /// Writes the recording as the instruments would have written it, with noise, gaps and clocks, and gives
    /// what it is in numbers. `deacal.read(folder)` reads it. Files that are not the program's own are
    /// overwritten only with `force`.
    #[pyo3(signature = (folder, *, force=false))]
    fn save<'py>(
        &self,
        py: Python<'py>,
        folder: PathBuf,
        force: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let written = py.detach(|| {
            let mut set = OutputSet::new(folder, overwrite(force))?;
            let json = self.of.write(&mut set)?;
            set.commit()?;
            Ok(json)
        });
        let json = written.map_err(|e| raised(&e))?;
        to_python(py, &serde_json::json!(json))
    }

    fn __repr__(&self) -> String {
        format!("<deacal.Simulated of {} frames>", self.of.position_m.len())
    }
}

/// Voltages: a file, or times and values.
#[derive(FromPyObject)]
pub enum Voltage<'py> {
    #[pyo3(transparent)]
    File(PathBuf),
    #[pyo3(transparent)]
    Log((Bound<'py, PyAny>, Bound<'py, PyAny>)),
}

impl Voltage<'_> {
    fn course(self) -> PyResult<Course> {
        let (times, values) = match self {
            Voltage::File(path) => return Ok(Course::VoltageFile(path)),
            Voltage::Log(log) => log,
        };
        let array = |of: &Bound<'_, PyAny>| -> PyResult<(Vec<usize>, Vec<f64>)> {
            let array = of.extract::<PyArrayLikeDyn<'_, f64, AllowTypeChange>>()?;
            let array = array.as_array();
            Ok((array.shape().to_vec(), array.iter().copied().collect()))
        };
        let (shape, times) = array(&times)?;
        if shape.len() != 1 {
            return Err(PyValueError::new_err(format!(
                "voltage: times have shape (m,), got {shape:?}"
            )));
        }
        let (shape, values) = array(&values)?;
        let rows: Vec<[f64; 3]> = match shape[..] {
            [_] => values.iter().map(|v| [*v; 3]).collect(),
            [_, 1] => values.iter().map(|v| [*v; 3]).collect(),
            [_, 3] => values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect(),
            _ => {
                return Err(PyValueError::new_err(format!(
                    "voltage: voltages have shape (m,) or (m, 3), got {shape:?}"
                )));
            }
        };
        let first = times.first().copied().unwrap_or(0.0);
        let times: Vec<f64> = times.iter().map(|t| t - first).collect();
        let log = argument("voltage", Sampled::from_log(&times, rows, Hold::Linear))?;
        Ok(Course::Voltages(log))
    }
}

/// A number, or a word.
#[derive(FromPyObject)]
pub enum NumberOrWord {
    #[pyo3(transparent)]
    Number(f64),
    #[pyo3(transparent)]
    Word(String),
}

/// Simulates a robot or a hanging sample with known parameters. What drives is one of `drive`
/// ("sine:peak_V=5500,hz=0.333" and the other kinds of `deacal simulate --help`), `voltage` (a CSV file, or
/// times in s and voltages in V) and `path` (a CSV file, through the inverse model). `effects` are causes
/// that the plain model leaves out, "series_resistance:resistance=1e7@2". Noises in mm, payload in g (a
/// number, or "0,7:5": 5 g from 7 s on), gaps (start, length) in s, everything else in SI.
#[pyfunction]
#[pyo3(signature = (
    rig, parameters, *, drive=None, voltage=None, path=None, effects=Vec::new(), duration=None,
    drive_rate=deacal::simulate::DEFAULT_RATE_HZ, flip_every=None, hold_previous=false, payload=None,
    limit=None, noise=0.0, coloured_noise=0.0, noise_correlation=0.1, gaps=Vec::new(),
    clock_offset=0.0, stated_offset=None, quantum=0.1, rate=100.0, seed=1, id="simulated", electrode=None,
    batch=None, day=None, progress=None
), text_signature = "(rig, parameters, *, drive=None, voltage=None, path=None, effects=(), duration=None, \
    drive_rate=1000.0, flip_every=None, hold_previous=False, payload=None, limit=None, noise=0.0, \
    coloured_noise=0.0, noise_correlation=0.1, gaps=(), clock_offset=0.0, stated_offset=None, quantum=0.1, \
    rate=100.0, seed=1, id='simulated', electrode=None, batch=None, day=None, progress=None)")]
#[allow(clippy::too_many_arguments)]
pub fn simulate<'py>(
    py: Python<'py>,
    rig: PathBuf,
    parameters: Parameters,
    drive: Option<&str>,
    voltage: Option<Voltage<'py>>,
    path: Option<PathBuf>,
    effects: Vec<String>,
    duration: Option<f64>,
    drive_rate: f64,
    flip_every: Option<f64>,
    hold_previous: bool,
    payload: Option<NumberOrWord>,
    limit: Option<f64>,
    noise: f64,
    coloured_noise: f64,
    noise_correlation: f64,
    gaps: Vec<(f64, f64)>,
    clock_offset: f64,
    stated_offset: Option<NumberOrWord>,
    quantum: f64,
    rate: f64,
    seed: u64,
    id: &str,
    electrode: Option<String>,
    batch: Option<String>,
    day: Option<i64>,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Simulated>> {
    let course = match (drive, voltage, path) {
        (Some(drive), None, None) => Course::BuiltIn(argument("drive", drive.parse())?),
        (None, Some(voltage), None) => voltage.course()?,
        (None, None, Some(path)) => Course::PathFile(path),
        _ => {
            return Err(PyTypeError::new_err(
                "give one of drive, voltage and path: what drives the simulation",
            ));
        }
    };
    let above = |name: &str, value: f64| argument(name, of_simulation::positive(value));
    let above_none = |name: &str, value: Option<f64>| value.map(|v| above(name, v)).transpose();
    let not_below = |name: &str, value: f64| argument(name, of_simulation::at_least_zero(value));
    let text = match payload {
        None => "0".to_owned(),
        Some(NumberOrWord::Number(g)) => g.to_string(),
        Some(NumberOrWord::Word(text)) => text,
    };
    let stated_offset = match stated_offset {
        None => None,
        Some(NumberOrWord::Number(s)) => Some(of_simulation::Stated::Seconds(s)),
        Some(NumberOrWord::Word(word)) => Some(one_of(
            "stated_offset",
            &word,
            &[("estimate", of_simulation::Stated::Estimate)],
        )?),
    };
    if !is_id(id) {
        return argument(
            "id",
            Err("expected a name that can be a file's, such as sym-01 or ageing/day-03".into()),
        );
    }
    for (start, length) in &gaps {
        not_below("gaps", *start)?;
        above("gaps", *length)?;
    }
    let causes = effects
        .iter()
        .map(|e| argument("effects", of_simulation::effect(e)));
    let causes: Vec<Effect> = causes.collect::<PyResult<_>>()?;
    let name = parameters.name();
    let file = py.detach(|| parameters.read()).map_err(|e| raised(&e))?;
    let asked = Simulation {
        effects: causes,
        duration_s: above_none("duration", duration)?,
        drive_rate_hz: above("drive_rate", drive_rate)?,
        flip_every_s: above_none("flip_every", flip_every)?,
        hold_previous,
        payload: argument("payload", text.parse())?,
        limit_v: above_none("limit", limit)?.unwrap_or(f64::INFINITY),
        noise_mm: not_below("noise", noise)?,
        coloured_noise_mm: not_below("coloured_noise", coloured_noise)?,
        noise_correlation_s: above("noise_correlation", noise_correlation)?,
        gaps_s: gaps,
        clock_offset_s: clock_offset,
        stated_offset,
        quantum_v: not_below("quantum", quantum)?,
        rate_hz: above("rate", rate)?,
        seed,
        id: id.to_owned(),
        electrode,
        batch,
        day,
        ..Simulation::new(rig, file, name, course)
    };
    let of = run(py, progress, move |progress| {
        progress.step("simulating");
        of_simulation::simulate(asked)
    })?;
    let axis = |k: usize| of.position_m.iter().map(|p| 1e3 * p[k]).collect();
    let mut columns = vec![("time_s".to_owned(), of.time_s())];
    columns.extend([("x_mm", 0), ("y_mm", 1), ("z_mm", 2)].map(|(n, k)| (n.to_owned(), axis(k))));
    let table = PyClassInitializer::from(Table::new(columns, Vec::new()));
    Bound::new(py, table.add_subclass(Simulated { of }))
}

/// Whether the model is adequate; if not, where, and which physics was left out. `holdout` are recordings
/// that are not fitted, to judge by (by default the last one or two of four or more); `only` are the causes
/// to consider; `false_alarms` is the share of recordings without a cause in which one may be named all the
/// same; `relevant` is the error that a cause must take away to be named, V; `rivals` builds the models of
/// simpler methods too.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, holdout=None, rig=None, plan=None, only=Vec::new(), false_alarms=0.02, relevant=None,
    rivals=false, progress=None
), text_signature = "(recordings, *, holdout=None, rig=None, plan=None, only=(), false_alarms=0.02, \
    relevant=None, rivals=False, progress=None)")]
#[allow(clippy::too_many_arguments)]
pub fn diagnose<'py>(
    py: Python<'py>,
    recordings: Sources,
    holdout: Option<Sources>,
    rig: Option<PathBuf>,
    plan: Option<PathBuf>,
    only: Vec<String>,
    false_alarms: f64,
    relevant: Option<f64>,
    rivals: bool,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Diagnosis>> {
    for id in &only {
        argument("only", of_diagnosis::known_cause(id))?;
    }
    within("false_alarms", false_alarms, 1e-6..=0.5)?;
    if let Some(volts) = relevant {
        within("relevant", volts, 0.0..=f64::MAX)?;
    }
    let named = recordings.0.len();
    let command = Call::new("diagnose", &recordings)
        .with(
            "holdout",
            holdout.is_some(),
            holdout.as_ref().map_or(String::new(), listed),
        )
        .word("rig", words(rig.as_ref()).as_deref())
        .word("plan", words(plan.as_ref()).as_deref())
        .with("only", !only.is_empty(), format!("{only:?}"))
        .with("false_alarms", false_alarms != 0.02, false_alarms)
        .with("relevant", relevant.is_some(), relevant.unwrap_or_default())
        .with("rivals", rivals, "True")
        .text();
    let mut all = recordings;
    all.0.extend(holdout.into_iter().flat_map(|h| h.0));
    let found = run(py, progress, move |progress| {
        let all = all.open(rig.as_ref(), &of_diagnosis::KINDS, progress)?;
        let given = Given::new(all, named, &command).look_over(progress);
        let request = diagnosis::Request {
            false_alarm_rate: false_alarms,
            only,
            rivals,
            relevant,
            ..diagnosis::Request::default()
        };
        let plans = load::plans(plan.as_ref())?;
        of_diagnosis::diagnose(given, &plans, request, progress, diagnosis::diagnose)
    })?;
    Bound::new(py, Diagnosis::init(found)?)
}

/// Recordings as a list of their paths.
fn listed(recordings: &Sources) -> String {
    let call = Call::new("", recordings).text();
    let inside = call
        .strip_prefix("deacal.(")
        .and_then(|c| c.strip_suffix(')'));
    inside.unwrap_or_default().to_owned()
}

/// Compares electrodes over days or batches: stroke, its loss, and what moved. Losses in %, `mount` in mm.
#[pyfunction]
#[pyo3(signature = (
    recordings, *, by="day", threshold=5.0, loss=50.0, cycles=8, mount=None, rig=None, compare=None,
    progress=None
))]
#[allow(clippy::too_many_arguments)]
pub fn ageing<'py>(
    py: Python<'py>,
    recordings: Sources,
    by: &str,
    threshold: f64,
    loss: f64,
    cycles: i64,
    mount: Option<f64>,
    rig: Option<PathBuf>,
    compare: Option<&str>,
    progress: Shown<'py>,
) -> PyResult<Bound<'py, Ageing>> {
    let request = AgeingRequest {
        by: one_of("by", by, &[("day", By::Day), ("batch", By::Batch)])?,
        threshold_percent: threshold,
        loss_percent: loss,
        cycles: within("cycles", cycles, 3..=1000)? as usize,
        mount_m: mount.map(|mm| mm * 1e-3),
        memory: Memory::default(),
    };
    of_ageing::check(&request).map_err(|why| PyValueError::new_err(why.to_string()))?;
    let paper = compare
        .map(|with| one_of("compare", with, &[("paper", true)]))
        .transpose()?;
    let command = Call::new("ageing", &recordings)
        .word("by", Some(by).filter(|b| *b != "day"))
        .with("threshold", threshold != 5.0, threshold)
        .with("loss", loss != 50.0, loss)
        .with("cycles", cycles != 8, cycles)
        .with("mount", mount.is_some(), mount.unwrap_or_default())
        .word("rig", words(rig.as_ref()).as_deref())
        .text();
    let found = run(py, progress, move |progress| {
        let all = recordings.open(rig.as_ref(), &of_ageing::KINDS, progress)?;
        let given = Given::new(all, 0, &command);
        of_ageing::ageing(given, request, paper.is_some(), progress)
    })?;
    let json = serde_json::to_value(&found.json).map_err(|e| raised(&e.into()))?;
    Bound::new(py, Ageing::init(json, found.outcome.verdict, found.files))
}
