//! `simulate`: known parameters and a drive to a recording, as the instruments would have written it.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::series::{AtWork, Occasion, at_work_on};
use super::{Failure, Talk, load};
use crate::kinematics::Vec3;
use crate::model::{HangingSample, Parameters, Robot, Track};
use crate::recording::{FilmSampleRig, Kind, Rig, RobotRig, is_id, nearest};
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

/// What to simulate.
#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).args(["voltage", "drive", "path"])))]
pub(super) struct Arguments {
    /// rig.toml of a robot or of a hanging film sample; a copy goes into the recording
    #[arg(long, value_name = "RIG")]
    rig: PathBuf,
    /// Parameter file: the truth of the simulation, its [[effect]] tables included
    #[arg(long)]
    params: PathBuf,
    /// A cause that the plain model leaves out, at work beside those of the parameter file:
    /// ID:NAME=VALUE,NAME=VALUE with the names and units of [[effect]], in all actuators or in those after an
    /// `@`; may be given several times. series_resistance:resistance=1e7@2; marker_offset:offset=1e-3/0/0 (m;
    /// or offset_x=1e-3); link_length_error:link=q,relative_error=0.01;
    /// electrode_failure:fraction=0.2,time=4@1 (4 s into this recording, or into the one named by
    /// recording=ID). Electrical causes act in their order, from the amplifier to the film. A planned path or
    /// circle knows nothing of causes
    #[arg(
        long,
        value_name = "ID:NAME=VALUE[@ACTUATOR]",
        value_parser = parse_effect
    )]
    effect: Vec<Effect>,
    /// Voltages to apply (CSV: time_s, phi1_kV, phi2_kV, phi3_kV, or phi1_V, ...; of a sample phi_kV or
    /// phi_V); the first row is time 0
    #[arg(long, value_name = "FILE")]
    voltage: Option<PathBuf>,
    /// Built-in drive, KIND:KEY=VALUE,KEY=VALUE; lists with `/`, one voltage for all actuators or three.
    /// sine:peak_V=5500,hz=0.333 (phase_deg=0/0/0);
    /// multisine:peak_V=4000,hz=0.1/0.3/0.7;
    /// staircase:peak_V=5000,steps=5,hold_s=4 (ramp_s=0.5, repeats=2);
    /// holds:levels_V=3000/4000/0,time_s=13/13/5 (ramp_s=3, scale=1/0/0);
    /// chirp:peak_V=4000,from_hz=0.1,to_hz=2;
    /// circle:radius_mm=5,height_mm=-50 (period_s=3, turns=5, move_s=3), through the inverse model
    #[arg(long, value_name = "DRIVE")]
    drive: Option<DriveText>,
    /// Planned path (CSV: time_s, x_mm, y_mm, z_mm): its voltages come from the inverse model; the plan is
    /// left as planned.csv
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// Length, s (default: 60 for sine, multisine and chirp, else as long as the drive lasts)
    #[arg(long, value_name = "S", value_parser = positive)]
    duration: Option<f64>,
    /// Samples a second of a built-in drive or planned path
    #[arg(long, value_name = "HZ", default_value_t = DEFAULT_RATE_HZ, value_parser = positive)]
    drive_rate: f64,
    /// Turns the sign of the voltages every so many seconds
    #[arg(long, value_name = "S", value_parser = positive)]
    flip_every: Option<f64>,
    /// The amplifier holds the last value between samples instead of a straight line
    #[arg(long)]
    hold_previous: bool,
    /// Payload, g; with steps: 0,7:5,50:0 (0 g at first, 5 g from 7 s on, 0 g from 50 s on)
    #[arg(long, value_name = "G", default_value = "0", value_parser = parse_payload)]
    payload: PayloadText,
    /// Highest voltage that is allowed, V
    #[arg(long, value_name = "V", default_value_t = f64::INFINITY, value_parser = positive)]
    limit: f64,
    /// Standard deviation of the white noise of each marker coordinate, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = at_least_zero)]
    noise: f64,
    /// Standard deviation of noise with a correlation time, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = at_least_zero)]
    coloured_noise: f64,
    /// Its correlation time, s
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = positive)]
    noise_correlation: f64,
    /// Gap of the end effector's marker, START:LENGTH in s; may be given several times
    #[arg(long, value_name = "S:S", value_parser = parse_gap)]
    gap: Vec<(f64, f64)>,
    /// True offset of the clocks: voltage clock minus motion clock, s
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true, value_parser = number)]
    clock_offset: f64,
    /// The offset that recording.toml states, s, or `estimate` (default: the true one)
    #[arg(long, value_name = "S|estimate", allow_negative_numbers = true, value_parser = parse_stated)]
    stated_offset: Option<Stated>,
    /// Smallest step of the voltage log, V; 0 for none
    #[arg(long, value_name = "V", default_value_t = 0.1, value_parser = at_least_zero)]
    quantum: f64,
    /// Frames a second of the capture
    #[arg(long, value_name = "HZ", default_value_t = 100.0, value_parser = positive)]
    rate: f64,
    /// Seed of the noise; the same seed gives the same bytes
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Name of the recording
    #[arg(long, default_value = "simulated", value_parser = parse_id)]
    id: String,
    /// Electrode, as `deacal ageing` compares them
    #[arg(long, value_name = "NAME")]
    electrode: Option<String>,
    /// Batch, as `deacal ageing` compares them
    #[arg(long, value_name = "NAME")]
    batch: Option<String>,
    /// Day of the recording, as `deacal ageing` orders them
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    day: Option<i64>,
    /// Folder of the recording
    #[arg(short, long, default_value = "out/simulate")]
    output: PathBuf,
}

/// What `--stated-offset` says.
#[derive(Clone, Copy)]
enum Stated {
    Seconds(f64),
    Estimate,
}

/// Mass at the start and steps (s, kg).
#[derive(Clone)]
struct PayloadText {
    start_kg: f64,
    steps: Vec<(f64, f64)>,
}

fn number(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if !value.is_nan() => Ok(value),
        _ => Err(format!("`{text}` is no number")),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    match value > 0.0 {
        true => Ok(value),
        false => Err(format!("{value} is not above 0")),
    }
}

fn at_least_zero(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    match value >= 0.0 && value.is_finite() {
        true => Ok(value),
        false => Err(format!("{value} is not 0 or above")),
    }
}

fn parse_gap(text: &str) -> Result<(f64, f64), String> {
    let (start, length) = text
        .split_once(':')
        .ok_or("expected START:LENGTH in seconds")?;
    Ok((at_least_zero(start)?, positive(length)?))
}

fn parse_stated(text: &str) -> Result<Stated, String> {
    match text {
        "estimate" => Ok(Stated::Estimate),
        other => number(other).map(Stated::Seconds),
    }
}

fn parse_id(text: &str) -> Result<String, String> {
    if is_id(text) {
        return Ok(text.to_owned());
    }
    Err("expected a name that can be a file's, such as sym-01 or ageing/day-03".into())
}

fn parse_effect(text: &str) -> Result<Effect, String> {
    let effect: Effect = text.parse()?;
    effect.check()?;
    Ok(effect)
}

fn parse_payload(text: &str) -> Result<PayloadText, String> {
    let mut parts = text.split(',');
    let start_kg = 1e-3 * at_least_zero(parts.next().unwrap_or_default())?;
    let step = |part: &str| {
        let (time, mass) = part
            .split_once(':')
            .ok_or(format!("`{part}`: expected TIME:GRAMS"))?;
        Ok::<_, String>((at_least_zero(time)?, 1e-3 * at_least_zero(mass)?))
    };
    let steps: Vec<(f64, f64)> = parts.map(step).collect::<Result<_, _>>()?;
    Payload::steps(start_kg, steps.clone())?;
    Ok(PayloadText { start_kg, steps })
}

/// A drive as written on the command line: a kind, and lists of numbers by key.
#[derive(Clone)]
struct DriveText {
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
pub(super) fn explain(error: &Error) -> Failure {
    match error.advice() {
        "" => error.to_string().into(),
        advice => format!("{error}: {advice}").into(),
    }
}

/// The voltages, and the path that they are made for where there is one.
fn drive(
    a: &Arguments,
    robot: &Robot,
    parameters: &Parameters,
    payload: &Payload,
) -> Result<(Sampled, Option<Track>), Failure> {
    let refuse = |error: Error| explain(&error);
    if let Some(file) = &a.path {
        let path = load::path(file)?;
        let track = path.track(payload, a.drive_rate);
        let plan = drive_along(robot, parameters, track, a.limit).map_err(|error| {
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
        return Ok((plan.voltage, Some(plan.path)));
    }
    if let Some(file) = &a.voltage {
        return Ok((load::voltage(file, Hold::Linear)?, None));
    }
    if let Some(text) = a.drive.as_ref().filter(|d| d.kind == "circle") {
        if !a.payload.steps.is_empty() {
            let text =
                "a circle is planned for one payload: give --payload without steps, or a path";
            return Err(text.into());
        }
        let circle = text.circle()?;
        let mass = a.payload.start_kg;
        let plan = circle.drive(robot, parameters, mass, a.drive_rate, a.limit);
        let plan = plan.map_err(refuse)?;
        return Ok((plan.voltage, Some(plan.path)));
    }
    Ok((built_in(a)?, None))
}

/// The voltages of a drive that is known beforehand.
fn built_in(a: &Arguments) -> Result<Sampled, Failure> {
    let text = a.drive.as_ref().ok_or("no drive was given")?;
    let drive = text.drive()?;
    let length = a.duration.or(drive.length_s()).unwrap_or(ENDLESS_S);
    drive.sampled(length, a.drive_rate).map_err(|e| explain(&e))
}

/// What the amplifier makes of a drive, within the limit.
fn amplified(a: &Arguments, mut voltage: Sampled) -> Result<Sampled, Failure> {
    if let Some(every) = a.flip_every {
        voltage = flip_polarity(&voltage, every).map_err(|e| explain(&e))?;
    }
    if a.hold_previous {
        let samples = voltage.samples_v().to_vec();
        voltage = Sampled::new(0.0, voltage.step_s(), samples, Hold::Previous)?;
    }
    check_limit(&voltage, a.limit).map_err(|e| explain(&e))?;
    Ok(voltage)
}

/// The parameter file with the causes of the command line behind its own, and where each was stated.
fn with_effects(a: &Arguments) -> Result<(ParameterFile, Vec<String>), Failure> {
    let mut file = load::parameters(&a.params)?;
    let name = a.params.display().to_string();
    let mut from = vec![name.clone(); file.effects.len()];
    let of_file = file.effects.len();
    for effect in &a.effect {
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

/// What was simulated, as the files need it.
struct Made {
    kind: Kind,
    /// The end effector, or the free end of a sample, in W, m.
    position_m: Vec<Vec3>,
    voltage: Sampled,
    path: Option<Track>,
    effects: Vec<ActedJson>,
    remarks: Vec<String>,
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let names = ["recording.toml", "motion.csv", "voltage.csv"];
    OutputSet::check(&a.output, &names, talk.overwrite())?;
    let made = match Rig::read(&a.rig)? {
        Rig::Robot(rig) => robot(a, &rig)?,
        Rig::FilmSample(rig) => sample(a, &rig)?,
    };
    write(a, &made, talk)
}

/// The causes at work in the recording, and the same as the reader is told.
fn causes(
    a: &Arguments,
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
fn robot(a: &Arguments, rig: &RobotRig) -> Result<Made, Failure> {
    let (file, from) = with_effects(a)?;
    let robot = load::robot(rig, Some(&file))?;
    let parameters = file.parameters()?;
    let payload = Payload::steps(a.payload.start_kg, a.payload.steps.clone())?;
    let (voltage, path) = drive(a, &robot, &parameters, &payload)?;
    let voltage = amplified(a, voltage)?;
    let options = Options {
        sample_step_s: 1.0 / a.rate,
        duration_s: a.duration.unwrap_or(voltage.duration_s()),
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
    Ok(Made {
        kind: Kind::Robot,
        position_m: moved.position_m,
        voltage,
        path,
        effects: acted,
        remarks: at_work.remarks,
    })
}

/// The point about which a capture's axes turn: the base marker less the end effector marker's offset, as
/// recordings are read.
fn pivot_m(placement: &Placement) -> Vec3 {
    [0, 1, 2].map(|i| placement.base_position_m[i] - placement.end_effector_offset_m[i])
}

/// The motion of a hanging sample, its upper end at the origin.
fn sample(a: &Arguments, rig: &FilmSampleRig) -> Result<Made, Failure> {
    let circle = a.drive.as_ref().is_some_and(|d| d.kind == "circle");
    if a.path.is_some() || circle {
        let path = a.rig.display();
        return Err(format!(
            "{path}: a hanging sample follows no path: give --voltage or another --drive"
        )
        .into());
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
    let voltage = match &a.voltage {
        Some(file) => load::sample_voltage(file, Hold::Linear)?,
        None => built_in(a)?,
    };
    // A sample has one electrode: of a drive for three the first.
    let first = voltage.samples_v().iter().map(|v| [v[0]; 3]).collect();
    let voltage = Sampled::new(voltage.start_s(), voltage.step_s(), first, voltage.hold())?;
    let voltage = amplified(a, voltage)?;
    let options = SampleOptions {
        sample_step_s: 1.0 / a.rate,
        duration_s: a.duration.unwrap_or(voltage.duration_s()),
        ..SampleOptions::default()
    };
    let (at_work, acted) = causes(a, &file, from, options.duration_s)?;
    let moved = sample_motion(&hanging, &film, &voltage, &options).map_err(|e| explain(&e))?;
    let end = |x: &f64| [0.0, 0.0, -moved.rest_length_m - x];
    Ok(Made {
        kind: Kind::FilmSample,
        position_m: moved.x_m.iter().map(end).collect(),
        voltage,
        path: None,
        effects: acted,
        remarks: at_work.remarks,
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

fn write(a: &Arguments, made: &Made, talk: Talk) -> Result<(), Failure> {
    let capture = Capture {
        rate_hz: a.rate,
        noise: Noise {
            white_m: 1e-3 * a.noise,
            coloured_m: 1e-3 * a.coloured_noise,
            correlation_s: a.noise_correlation,
        },
        gaps: gaps(a, made.position_m.len())?,
        seed: a.seed,
        ..Capture::default()
    };
    let mut log = VoltageLog {
        clock_offset_s: a.clock_offset,
        quantum_v: a.quantum,
        ..VoltageLog::default()
    };
    if made.kind == Kind::FilmSample {
        log.channels = vec!["phi_kV".into()];
    }
    let text = recording_text(a, made, &capture);
    let mut set = OutputSet::new(&a.output, talk.overwrite())?;
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
        let time_s: Vec<f64> = (0..made.position_m.len())
            .map(|i| i as f64 / a.rate)
            .collect();
        let plan: Vec<Vec3> = time_s.iter().map_while(|&t| planned(path, t)).collect();
        off_plan_mm = farthest_mm(&plan, &made.position_m);
        let flags = vec![None; plan.len()];
        set.write_with("planned.csv", |mut out| {
            csv::predicted_motion(&mut out, &time_s, &plan, &flags)
        })?;
        files.push("planned.csv");
    }
    set.commit()?;
    say(a, made, &files, off_plan_mm, talk);
    Ok(())
}

/// First frame and length of the gaps that are asked for, within a recording of `n` frames.
fn gaps(a: &Arguments, n: usize) -> Result<Vec<(usize, usize)>, Failure> {
    let mut gaps = Vec::new();
    for (start, length) in &a.gap {
        let first = (start * a.rate).round() as usize;
        let frames = ((length * a.rate).round() as usize).max(1);
        if first + frames > n {
            return Err(format!(
                "a gap from {start} s for {length} s does not lie within the recording of {:.2} s: shorten it, or lengthen the drive",
                (n - 1) as f64 / a.rate
            )
            .into());
        }
        gaps.push((first, frames));
    }
    Ok(gaps)
}

/// What `recording.toml` says.
fn recording_text(a: &Arguments, made: &Made, capture: &Capture) -> RecordingText {
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
            None => Some(a.clock_offset),
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

/// Says what was simulated and written.
fn say(a: &Arguments, made: &Made, files: &[&str], off_plan_mm: f64, talk: Talk) {
    let n = made.position_m.len();
    let heights = || made.position_m.iter().map(|u| 1e3 * u[2]);
    let stroke_mm =
        heights().fold(f64::NEG_INFINITY, f64::max) - heights().fold(f64::INFINITY, f64::min);
    let volts = made.voltage.samples_v().iter().flatten();
    let result = SimulationJson {
        id: a.id.clone(),
        kind: made.kind.name().into(),
        folder: a.output.display().to_string(),
        files: files.iter().copied().map(String::from).collect(),
        n_frames: n,
        duration_s: (n - 1) as f64 / a.rate,
        stroke_mm,
        largest_voltage_v: volts.fold(0.0, |m: f64, v| m.max(v.abs())),
        off_plan_mm: finite(off_plan_mm),
        effects: made.effects.clone(),
        seed: a.seed,
    };
    talk.result(&result);
    talk.say(&format!(
        "{}: {n} frames, {:.2} s; stroke {stroke_mm:.2} mm, at most {:.0} V",
        result.id, result.duration_s, result.largest_voltage_v
    ));
    for acted in &made.effects {
        talk.say(&format!("  with {}", acted.line()));
    }
    for remark in &made.remarks {
        talk.say(&format!("  ! {remark}"));
    }
    if let Some(path) = &made.path {
        talk.say(&format!("  at most {off_plan_mm:.4} mm off the plan"));
        let [x, y, z] = path.velocity_m_s[0];
        let speed = (x * x + y * y + z * z).sqrt();
        if speed > STARTS_MOVING_M_S {
            talk.say(&format!(
                "  ! the path begins with {:.1} mm/s, the robot at rest: let the path begin at rest",
                speed * 1e3
            ));
        }
    }
    talk.say(&format!("Written to {}", a.output.display()));
}
