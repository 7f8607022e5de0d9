//! `simulate`: known parameters and a drive to a recording, as the instruments would have written it.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::series::{AtWork, Occasion, at_work_on};
use super::{Failure, load};
use crate::kinematics::Vec3;
use crate::model::{HangingSample, Parameters, Robot, Track};
use crate::recording::{FilmSampleRig, Kind, Rig, RobotRig, nearest};
use crate::report::csv;
use crate::report::json::{ActedJson, SimulationJson, finite};
use crate::report::output::OutputSet;
use crate::report::parameter_file::{Effect, ParameterFile};
use crate::simulate::write::{
    Capture, Noise, Placement, RecordingText, VoltageLog, nexus_csv, recording_toml, voltage_csv,
};
use crate::simulate::{
    Circle, DEFAULT_RATE_HZ, Drive, Error, Hold, Options, Payload, SampleOptions, Sampled,
    drive_along, flip_polarity, motion_with_effects, sample_motion,
};

/// What drives a simulation.
#[derive(Debug, Clone)]
pub enum Course {
    /// A table of voltages: CSV with time_s and phi1_kV, phi2_kV, phi3_kV (or phi1_V, ...), of a sample
    /// phi_kV or phi_V; the first row is time 0.
    VoltageFile(PathBuf),
    /// Voltages, V; a sample takes the first.
    Voltages(Sampled),
    /// A built-in drive.
    BuiltIn(DriveText),
    /// A planned path (CSV: time_s, x_mm, y_mm, z_mm), whose voltages come from the inverse model.
    PathFile(PathBuf),
}

/// What to simulate, and how the instruments see it.
#[derive(Debug, Clone)]
pub struct Simulation {
    /// rig.toml of a robot or of a hanging film sample.
    pub rig: PathBuf,
    /// The truth, its causes included.
    pub parameters: ParameterFile,
    /// What the parameters are called in words.
    pub parameters_name: String,
    /// Causes at work beside those of the parameters.
    pub effects: Vec<Effect>,
    /// What drives.
    pub course: Course,
    /// Length, s; by default 60 for drives without an end, else as long as the drive lasts.
    pub duration_s: Option<f64>,
    /// Samples a second of a built-in drive or planned path, Hz.
    pub drive_rate_hz: f64,
    /// The sign of the voltages turns every so many seconds.
    pub flip_every_s: Option<f64>,
    /// The amplifier holds the last value between samples instead of a straight line.
    pub hold_previous: bool,
    /// What hangs on the end effector or on the free end.
    pub payload: PayloadText,
    /// Highest voltage that is allowed, V.
    pub limit_v: f64,
    /// Standard deviation of the white noise of each marker coordinate, mm.
    pub noise_mm: f64,
    /// Standard deviation of noise with a correlation time, mm.
    pub coloured_noise_mm: f64,
    /// That correlation time, s.
    pub noise_correlation_s: f64,
    /// Gaps of the end effector's marker: start and length, s.
    pub gaps_s: Vec<(f64, f64)>,
    /// True offset of the clocks: voltage clock minus motion clock, s.
    pub clock_offset_s: f64,
    /// What recording.toml states of it; by default the true one.
    pub stated_offset: Option<Stated>,
    /// Smallest step of the voltage log, V; 0 for none.
    pub quantum_v: f64,
    /// Frames a second of the capture, Hz.
    pub rate_hz: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Name of the recording.
    pub id: String,
    /// Electrode, as ageing compares them.
    pub electrode: Option<String>,
    /// Batch, as ageing compares them.
    pub batch: Option<String>,
    /// Day, as ageing orders them.
    pub day: Option<i64>,
}

/// What recording.toml says of the clock offset.
#[derive(Debug, Clone, Copy)]
pub enum Stated {
    /// A number, s.
    Seconds(f64),
    /// It is to be estimated.
    Estimate,
}

/// Mass at the start and steps (s, kg), written `0,7:5,50:0` in g and s.
#[derive(Debug, Clone, Default)]
pub struct PayloadText {
    start_kg: f64,
    steps: Vec<(f64, f64)>,
}

impl FromStr for PayloadText {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut parts = text.split(',');
        let start_kg = 1e-3 * at_least_zero(number(parts.next().unwrap_or_default())?)?;
        let step = |part: &str| {
            let (time, mass) = part
                .split_once(':')
                .ok_or(format!("`{part}`: expected TIME:GRAMS"))?;
            let time_s = at_least_zero(number(time)?)?;
            Ok::<_, String>((time_s, 1e-3 * at_least_zero(number(mass)?)?))
        };
        let steps: Vec<(f64, f64)> = parts.map(step).collect::<Result<_, _>>()?;
        Payload::steps(start_kg, steps.clone())?;
        Ok(PayloadText { start_kg, steps })
    }
}

/// The number that a text is.
///
/// # Errors
/// It is none, or NaN.
pub fn number(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if !value.is_nan() => Ok(value),
        _ => Err(format!("`{text}` is no number")),
    }
}

/// A number above 0.
///
/// # Errors
/// It is not.
pub fn positive(value: f64) -> Result<f64, String> {
    match value > 0.0 {
        true => Ok(value),
        false => Err(format!("{value} is not above 0")),
    }
}

/// A finite number not below 0.
///
/// # Errors
/// It is not.
pub fn at_least_zero(value: f64) -> Result<f64, String> {
    match value >= 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(format!("{value} is not 0 or above")),
    }
}

/// A cause as written `ID:NAME=VALUE,NAME=VALUE@ACTUATOR`.
///
/// # Errors
/// It is in no catalogue, or has no such value.
pub fn effect(text: &str) -> Result<Effect, String> {
    let effect: Effect = text.parse()?;
    effect.check()?;
    Ok(effect)
}

impl Simulation {
    /// A simulation without noise at 100 frames a second, of parameters that are called `name` in words.
    #[must_use]
    pub fn new(rig: PathBuf, parameters: ParameterFile, name: String, course: Course) -> Self {
        Simulation {
            rig,
            parameters,
            parameters_name: name,
            effects: Vec::new(),
            course,
            duration_s: None,
            drive_rate_hz: DEFAULT_RATE_HZ,
            flip_every_s: None,
            hold_previous: false,
            payload: PayloadText::default(),
            limit_v: f64::INFINITY,
            noise_mm: 0.0,
            coloured_noise_mm: 0.0,
            noise_correlation_s: 0.1,
            gaps_s: Vec::new(),
            clock_offset_s: 0.0,
            stated_offset: None,
            quantum_v: 0.1,
            rate_hz: 100.0,
            seed: 1,
            id: "simulated".into(),
            electrode: None,
            batch: None,
            day: None,
        }
    }
}

/// A drive as it is written, `KIND:KEY=VALUE,KEY=VALUE`: a kind, and lists of numbers by key.
#[derive(Debug, Clone)]
pub struct DriveText {
    kind: String,
    values: Vec<(String, Vec<f64>)>,
}

/// Kinds of drives and their keys; those with a `*` may be left out.
const KINDS: [(&str, &[&str]); 6] = [
    ("sine", &["peak_V", "hz", "*phase_deg"]),
    ("multisine", &["peak_V", "hz"]),
    (
        "staircase",
        &["peak_V", "steps", "hold_s", "*ramp_s", "*repeats"],
    ),
    ("holds", &["levels_V", "time_s", "*ramp_s", "*scale"]),
    ("chirp", &["peak_V", "from_hz", "to_hz"]),
    (
        "circle",
        &["radius_mm", "height_mm", "*period_s", "*turns", "*move_s"],
    ),
];

impl FromStr for DriveText {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unknown = |what: &str, name: &str, known: &[&str]| {
            let near =
                nearest(name, known).map_or(String::new(), |n| format!(", nearest is `{n}`"));
            format!("no {what} `{name}`{near}; there are: {}", known.join(", "))
        };
        let (kind, rest) = text.split_once(':').unwrap_or((text, ""));
        let Some((_, keys)) = KINDS.iter().find(|k| k.0 == kind) else {
            return Err(unknown("drive", kind, &KINDS.map(|k| k.0)));
        };
        let known: Vec<&str> = keys.iter().map(|k| k.trim_start_matches('*')).collect();
        let mut values: Vec<(String, Vec<f64>)> = Vec::new();
        for part in rest.split(',').filter(|p| !p.is_empty()) {
            let (key, list) = part
                .split_once('=')
                .ok_or(format!("`{part}`: expected KEY=VALUE"))?;
            if !known.contains(&key) {
                return Err(unknown(&format!("key of {kind}"), key, &known));
            }
            if values.iter().any(|v| v.0 == key) {
                return Err(format!("`{key}` stands twice"));
            }
            let list = list.split('/').map(number).collect::<Result<_, _>>()?;
            values.push((key.into(), list));
        }
        for key in keys.iter().filter(|k| !k.starts_with('*')) {
            if !values.iter().any(|v| v.0 == *key) {
                return Err(format!("{kind} needs {key}"));
            }
        }
        let out = DriveText {
            kind: kind.into(),
            values,
        };
        // Wrong numbers of numbers are wrong usage too.
        if kind == "circle" {
            out.circle()?;
        } else {
            out.drive()?;
        }
        Ok(out)
    }
}

impl DriveText {
    fn list(&self, key: &str, default: &[f64]) -> Vec<f64> {
        let found = self.values.iter().find(|v| v.0 == key);
        found.map_or(default.to_vec(), |v| v.1.clone())
    }

    fn one(&self, key: &str, default: f64) -> Result<f64, String> {
        match self.list(key, &[default])[..] {
            [value] => Ok(value),
            ref list => Err(format!("{key} is one number, got {}", list.len())),
        }
    }

    fn count(&self, key: &str, default: f64) -> Result<usize, String> {
        let value = self.one(key, default)?;
        match (1.0..1e6).contains(&value) && value.fract() == 0.0 {
            true => Ok(value as usize),
            false => Err(format!("{key} is a whole number from 1 on, got {value}")),
        }
    }

    /// One number for all three actuators, or three.
    fn three(&self, key: &str, default: f64) -> Result<[f64; 3], String> {
        match self.list(key, &[default])[..] {
            [all] => Ok([all; 3]),
            [a, b, c] => Ok([a, b, c]),
            ref list => Err(format!("{key} is one number or three, got {}", list.len())),
        }
    }

    fn circle(&self) -> Result<Circle, String> {
        Ok(Circle {
            radius_m: 1e-3 * self.one("radius_mm", f64::NAN)?,
            height_m: 1e-3 * self.one("height_mm", f64::NAN)?,
            period_s: self.one("period_s", 3.0)?,
            turns: self.one("turns", 5.0)?,
            move_s: self.one("move_s", 3.0)?,
        })
    }

    fn drive(&self) -> Result<Drive, String> {
        let peak_v = self.three("peak_V", 0.0)?;
        Ok(match self.kind.as_str() {
            "sine" => Drive::Sine {
                peak_v,
                frequency_hz: self.one("hz", f64::NAN)?,
                phase_rad: self.three("phase_deg", 0.0)?.map(f64::to_radians),
            },
            "multisine" => Drive::Multisine {
                peak_v,
                frequency_hz: self.list("hz", &[]),
            },
            "staircase" => Drive::Staircase {
                peak_v,
                steps: self.count("steps", 1.0)?,
                hold_s: self.one("hold_s", f64::NAN)?,
                ramp_s: self.one("ramp_s", 0.5)?,
                repeats: self.count("repeats", 2.0)?,
            },
            "holds" => {
                let scale = self.three("scale", 1.0)?;
                let levels = self.list("levels_V", &[]);
                let times = match self.list("time_s", &[]) {
                    one if one.len() == 1 => vec![one[0]; levels.len()],
                    times => times,
                };
                if times.len() != levels.len() {
                    return Err(format!(
                        "{} levels_V need as many time_s (or one for all), got {}",
                        levels.len(),
                        times.len()
                    ));
                }
                let level = |(v, t): (&f64, f64)| (scale.map(|s| s * v), t);
                Drive::Holds {
                    levels: levels.iter().zip(times).map(level).collect(),
                    ramp_s: self.one("ramp_s", 0.0)?,
                }
            }
            _ => Drive::Chirp {
                peak_v,
                from_hz: self.one("from_hz", f64::NAN)?,
                to_hz: self.one("to_hz", f64::NAN)?,
            },
        })
    }
}

/// Length of a drive without an end, s.
const ENDLESS_S: f64 = 60.0;
/// Speed of a path's first point from which it is said, m/s.
const STARTS_MOVING_M_S: f64 = 1e-3;

/// In words, with what to do.
pub(crate) fn explain(error: &Error) -> Failure {
    match error.advice() {
        "" => error.to_string().into(),
        advice => format!("{error}: {advice}").into(),
    }
}

/// The voltages, and the path that they are made for where there is one.
fn drive(
    a: &Simulation,
    robot: &Robot,
    parameters: &Parameters,
    payload: &Payload,
) -> Result<(Sampled, Option<Track>), Failure> {
    let refuse = |error: Error| explain(&error);
    match &a.course {
        Course::PathFile(file) => {
            let path = load::path(file)?;
            let track = path.track(payload, a.drive_rate_hz);
            let plan = drive_along(robot, parameters, track, a.limit_v).map_err(|error| {
                // Times of the file, not of the drive.
                let shift = path.span_s().0;
                let from = if shift == 0.0 {
                    String::new()
                } else {
                    format!(" (times from the path's first row, at {shift} s)")
                };
                let text = refuse(error);
                Failure::from(format!("{}: {text}{from}", file.display()))
            })?;
            Ok((plan.voltage, Some(plan.path)))
        }
        Course::VoltageFile(file) => Ok((load::voltage(file, Hold::Linear)?, None)),
        Course::Voltages(voltage) => Ok((voltage.clone(), None)),
        Course::BuiltIn(text) if text.kind == "circle" => {
            if !a.payload.steps.is_empty() {
                let text =
                    "a circle is planned for one payload: give --payload without steps, or a path";
                return Err(text.into());
            }
            let circle = text.circle()?;
            let mass = a.payload.start_kg;
            let plan = circle.drive(robot, parameters, mass, a.drive_rate_hz, a.limit_v);
            let plan = plan.map_err(refuse)?;
            Ok((plan.voltage, Some(plan.path)))
        }
        Course::BuiltIn(text) => Ok((built_in(a, text)?, None)),
    }
}

/// The voltages of a drive that is known beforehand.
fn built_in(a: &Simulation, text: &DriveText) -> Result<Sampled, Failure> {
    let drive = text.drive()?;
    let length = a.duration_s.or(drive.length_s()).unwrap_or(ENDLESS_S);
    let voltage = drive.sampled(length, a.drive_rate_hz);
    voltage.map_err(|e| explain(&e))
}

/// What the amplifier makes of a drive, within the limit.
fn amplified(a: &Simulation, mut voltage: Sampled) -> Result<Sampled, Failure> {
    if let Some(every) = a.flip_every_s {
        voltage = flip_polarity(&voltage, every).map_err(|e| explain(&e))?;
    }
    if a.hold_previous {
        let samples = voltage.samples_v().to_vec();
        voltage = Sampled::new(0.0, voltage.step_s(), samples, Hold::Previous)?;
    }
    check_limit(&voltage, a.limit_v).map_err(|e| explain(&e))?;
    Ok(voltage)
}

/// The parameters with the causes that are stated beside them behind their own, and where each was stated.
fn with_effects(a: &Simulation) -> Result<(ParameterFile, Vec<String>), Failure> {
    let mut file = a.parameters.clone();
    let name = a.parameters_name.clone();
    let mut from = vec![name.clone(); file.effects.len()];
    let of_file = file.effects.len();
    for effect in &a.effects {
        let id = &effect.id;
        if file.effects[..of_file].iter().any(|e| e.id == *id) {
            return Err(format!(
                "{id} is at work in {name} ([[effect]]) and in --effect: state it in one of them"
            )
            .into());
        }
        let form = |e: &Effect| e.values.iter().find(|(n, _)| n == "link").cloned();
        let again = file.effects[of_file..].iter().any(|e| {
            let shared = e.actuators.iter().any(|k| effect.actuators.contains(k));
            e.id == *id && shared && form(e) == form(effect)
        });
        if again {
            return Err(format!(
                "--effect states {id} twice for one actuator: put its values into one, or give each its own actuators (@1)"
            )
            .into());
        }
        file.effects.push(effect.clone());
        from.push("--effect".into());
    }
    Ok((file, from))
}

/// What was simulated.
#[derive(Debug, Clone)]
pub struct Simulated {
    asked: Simulation,
    kind: Kind,
    /// The end effector, or the free end of a sample, in W, without noise, one position a frame, m.
    pub position_m: Vec<Vec3>,
    /// What the amplifier was told, V.
    pub voltage: Sampled,
    /// The path that the voltages were made for.
    path: Option<Track>,
    /// The causes that were at work.
    pub effects: Vec<ActedJson>,
    /// What a reader should know.
    pub remarks: Vec<String>,
}

/// Simulates.
///
/// # Errors
/// Rig, parameters, drive and causes that do not go together; a motion that the model cannot follow, or
/// voltages above the limit.
pub fn simulate(asked: Simulation) -> Result<Simulated, Failure> {
    match Rig::read(&asked.rig)? {
        Rig::Robot(rig) => robot(asked, &rig),
        Rig::FilmSample(rig) => sample(asked, &rig),
    }
}

/// The causes at work in the recording, and the same as the reader is told.
fn causes(
    a: &Simulation,
    file: &ParameterFile,
    from: Vec<String>,
    duration_s: f64,
) -> Result<(AtWork, Vec<ActedJson>), Failure> {
    let occasion = Occasion {
        id: &a.id,
        clock_s: None,
        start_s: 0.0,
        duration_s,
    };
    let at_work = at_work_on(file, &[occasion])?;
    let all = at_work.effects.iter().zip(&file.effects).zip(from);
    let acted = all.map(|((acting, entry), from)| ActedJson::new(acting, entry, from, &a.id));
    let acted = acted.collect();
    Ok((at_work, acted))
}

/// The motion of a robot.
fn robot(asked: Simulation, rig: &RobotRig) -> Result<Simulated, Failure> {
    let a = &asked;
    let (file, from) = with_effects(a)?;
    let robot = load::robot(rig, Some(&file))?;
    let parameters = file.parameters()?;
    let payload = Payload::steps(a.payload.start_kg, a.payload.steps.clone())?;
    let (voltage, path) = drive(a, &robot, &parameters, &payload)?;
    let voltage = amplified(a, voltage)?;
    let options = Options {
        sample_step_s: 1.0 / a.rate_hz,
        duration_s: a.duration_s.unwrap_or(voltage.duration_s()),
        payload,
        ..Options::default()
    };
    let (at_work, acted) = causes(a, &file, from, options.duration_s)?;
    let pivot = pivot_m(&Capture::default().placement);
    let (moved, ended) = motion_with_effects(
        &robot,
        &parameters,
        &voltage,
        &options,
        &at_work.effects,
        at_work.when[0],
        pivot,
    )
    .map_err(|e| explain(&e))?;
    if let Some(error) = ended {
        return Err(explain(&error));
    }
    Ok(Simulated {
        kind: Kind::Robot,
        position_m: moved.position_m,
        voltage,
        path,
        effects: acted,
        remarks: at_work.remarks,
        asked,
    })
}

/// The point about which a capture's axes turn: the base marker less the end effector marker's offset, as
/// recordings are read.
fn pivot_m(placement: &Placement) -> Vec3 {
    [0, 1, 2].map(|i| placement.base_position_m[i] - placement.end_effector_offset_m[i])
}

/// The motion of a hanging sample, its upper end at the origin.
fn sample(asked: Simulation, rig: &FilmSampleRig) -> Result<Simulated, Failure> {
    let a = &asked;
    let planned = || -> Failure {
        let path = a.rig.display();
        format!("{path}: a hanging sample follows no path: give --voltage or another --drive")
            .into()
    };
    if matches!(&a.course, Course::BuiltIn(text) if text.kind == "circle") {
        return Err(planned());
    }
    if !a.payload.steps.is_empty() {
        let text = "the mass on a hanging sample stays the same: give --payload without steps";
        return Err(text.into());
    }
    let (file, from) = with_effects(a)?;
    let electrode = file.electrode()?;
    let film = file.parameters()?.film;
    let plain = HangingSample::from_rig(rig, file.eps_r(), a.payload.start_kg)
        .map_err(|what| format!("{}: {what}", a.rig.display()))?;
    let hanging = HangingSample { electrode, ..plain };
    let voltage = match &a.course {
        Course::VoltageFile(file) => load::sample_voltage(file, Hold::Linear)?,
        Course::Voltages(voltage) => voltage.clone(),
        Course::BuiltIn(text) => built_in(a, text)?,
        Course::PathFile(_) => return Err(planned()),
    };
    // A sample has one electrode: of a drive for three the first.
    let first = voltage.samples_v().iter().map(|v| [v[0]; 3]).collect();
    let voltage = Sampled::new(voltage.start_s(), voltage.step_s(), first, voltage.hold())?;
    let voltage = amplified(a, voltage)?;
    let options = SampleOptions {
        sample_step_s: 1.0 / a.rate_hz,
        duration_s: a.duration_s.unwrap_or(voltage.duration_s()),
        ..SampleOptions::default()
    };
    let (at_work, acted) = causes(a, &file, from, options.duration_s)?;
    let moved = sample_motion(&hanging, &film, &voltage, &options).map_err(|e| explain(&e))?;
    let end = |x: &f64| [0.0, 0.0, -moved.rest_length_m - x];
    Ok(Simulated {
        kind: Kind::FilmSample,
        position_m: moved.x_m.iter().map(end).collect(),
        voltage,
        path: None,
        effects: acted,
        remarks: at_work.remarks,
        asked,
    })
}

/// The first voltage above `limit_v`.
fn check_limit(voltage: &Sampled, limit_v: f64) -> Result<(), Error> {
    for (i, phi) in voltage.samples_v().iter().enumerate() {
        if let Some(k) = (0..3).find(|&k| phi[k].abs() > limit_v) {
            return Err(Error::VoltageLimit {
                at_s: voltage.start_s() + i as f64 * voltage.step_s(),
                chain: k + 1,
                phi_v: phi[k],
                limit_v,
            });
        }
    }
    Ok(())
}

/// Position of the plan at `t` s, between its samples on a straight line; none after its end.
fn planned(path: &Track, t: f64) -> Option<Vec3> {
    let place = t / path.step_s;
    let i = (place as usize).min(path.position_m.len() - 1);
    let next = (i + 1).min(path.position_m.len() - 1);
    if place > next as f64 + 1e-6 {
        return None;
    }
    let (a, b) = (path.position_m[i], path.position_m[next]);
    let f = (place - i as f64).clamp(0.0, 1.0);
    Some([0, 1, 2].map(|k| a[k] + f * (b[k] - a[k])))
}

/// The bytes of a file.
fn read_whole(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let read = crate::recording::open(path).and_then(|mut file| file.read_to_end(&mut bytes));
    read.map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(bytes)
}

impl Simulated {
    /// Writes the recording: `recording.toml`, `rig.toml`, `motion.csv`, `voltage.csv`, and `planned.csv`
    /// where a path was planned. The set is not put in place.
    ///
    /// # Errors
    /// A gap outside the recording; a file that may not be overwritten, or cannot be written.
    pub fn write(&self, set: &mut OutputSet) -> Result<SimulationJson, Failure> {
        let (a, made) = (&self.asked, self);
        let capture = Capture {
            rate_hz: a.rate_hz,
            noise: Noise {
                white_m: 1e-3 * a.noise_mm,
                coloured_m: 1e-3 * a.coloured_noise_mm,
                correlation_s: a.noise_correlation_s,
            },
            gaps: gaps(a, made.position_m.len())?,
            seed: a.seed,
            ..Capture::default()
        };
        let mut log = VoltageLog {
            clock_offset_s: a.clock_offset_s,
            quantum_v: a.quantum_v,
            ..VoltageLog::default()
        };
        if made.kind == Kind::FilmSample {
            log.channels = vec!["phi_kV".into()];
        }
        let text = recording_text(a, made, &capture);
        let mut files = vec!["recording.toml", "rig.toml", "motion.csv", "voltage.csv"];
        set.write_with("recording.toml", |mut out| {
            recording_toml(&mut out, &text, &capture, &log)
        })?;
        set.write("rig.toml", read_whole(&a.rig)?)?;
        set.write_with("motion.csv", |mut out| {
            nexus_csv(&mut out, &capture, &made.position_m)
        })?;
        set.write_with("voltage.csv", |mut out| {
            voltage_csv(&mut out, &log, &made.voltage)
        })?;
        let mut off_plan_mm = f64::NAN;
        if let Some(path) = &made.path {
            let time_s = self.time_s();
            let plan: Vec<Vec3> = time_s.iter().map_while(|&t| planned(path, t)).collect();
            off_plan_mm = farthest_mm(&plan, &made.position_m);
            let flags = vec![None; plan.len()];
            let columns = csv::predicted_motion(&time_s, &plan, &flags);
            set.write_with("planned.csv", |mut out| {
                csv::write_flagged(&mut out, &columns, &flags)
            })?;
            files.push("planned.csv");
        }
        let folder = set.dir().display().to_string();
        Ok(self.json(folder, &files, off_plan_mm))
    }

    /// What was simulated, in numbers; `files` are in `folder`.
    fn json(&self, folder: String, files: &[&str], off_plan_mm: f64) -> SimulationJson {
        let n = self.position_m.len();
        let heights = || self.position_m.iter().map(|u| 1e3 * u[2]);
        let volts = self.voltage.samples_v().iter().flatten();
        SimulationJson {
            id: self.asked.id.clone(),
            kind: self.kind.name().into(),
            folder,
            files: files.iter().copied().map(String::from).collect(),
            n_frames: n,
            duration_s: (n - 1) as f64 / self.asked.rate_hz,
            stroke_mm: heights().fold(f64::NEG_INFINITY, f64::max)
                - heights().fold(f64::INFINITY, f64::min),
            largest_voltage_v: volts.fold(0.0, |m: f64, v| m.max(v.abs())),
            off_plan_mm: finite(off_plan_mm),
            effects: self.effects.clone(),
            seed: self.asked.seed,
        }
    }

    /// Time of each frame, s.
    #[must_use]
    pub fn time_s(&self) -> Vec<f64> {
        let frames = 0..self.position_m.len();
        frames.map(|i| i as f64 / self.asked.rate_hz).collect()
    }

    /// Speed with which a planned path begins, where it does not begin at rest, m/s.
    #[must_use]
    pub fn begins_moving_m_s(&self) -> Option<f64> {
        let [x, y, z] = self.path.as_ref()?.velocity_m_s[0];
        let speed = (x * x + y * y + z * z).sqrt();
        (speed > STARTS_MOVING_M_S).then_some(speed)
    }
}

/// First frame and length of the gaps that are asked for, within a recording of `n` frames.
fn gaps(a: &Simulation, n: usize) -> Result<Vec<(usize, usize)>, Failure> {
    let mut gaps = Vec::new();
    for (start, length) in &a.gaps_s {
        let first = (start * a.rate_hz).round() as usize;
        let frames = ((length * a.rate_hz).round() as usize).max(1);
        if first + frames > n {
            return Err(format!(
                "a gap from {start} s for {length} s does not lie within the recording of {:.2} s: shorten it, or lengthen the drive",
                (n - 1) as f64 / a.rate_hz
            )
            .into());
        }
        gaps.push((first, frames));
    }
    Ok(gaps)
}

/// What `recording.toml` says.
fn recording_text(a: &Simulation, made: &Simulated, capture: &Capture) -> RecordingText {
    let labels = [
        ("batch", a.batch.clone()),
        ("electrode", a.electrode.clone()),
        ("day", a.day.map(|d| d.to_string())),
    ];
    let mut payload_kg = vec![(0.0, a.payload.start_kg)];
    payload_kg.extend(&a.payload.steps);
    RecordingText {
        id: a.id.clone(),
        kind: made.kind.name().into(),
        labels: labels
            .into_iter()
            .filter_map(|(key, value)| Some((key.to_owned(), value?)))
            .collect(),
        payload_kg,
        placement: capture.placement,
        hold: made.voltage.hold(),
        offset_s: match a.stated_offset {
            None => Some(a.clock_offset_s),
            Some(Stated::Seconds(offset)) => Some(offset),
            Some(Stated::Estimate) => None,
        },
        ..RecordingText::default()
    }
}

/// How far the motion is off the plan at most, mm.
fn farthest_mm(plan: &[Vec3], position_m: &[Vec3]) -> f64 {
    plan.iter().zip(position_m).fold(0.0, |worst, (p, u)| {
        let d = [0, 1, 2].map(|k| 1e3 * (u[k] - p[k]));
        (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().max(worst)
    })
}
