//! `predict`: voltages, forces or motion of a recording, from parameters.

use std::borrow::Cow;
use std::io::{self, Write};
use std::path::Path;

use super::load;
use super::simulate::explain;
use super::{Failure, Progress, ranges, series};
use crate::calibration::{
    LineFit, RecordingOutcome, SampleFit, predict_command, predict_force, predict_line,
    predict_line_motion, predict_sample_motion, validate_robot_with, validate_samples,
};
use crate::dataset::line::Measured;
use crate::dataset::{Dataset, OffsetSource, Plan};
use crate::effects::Site;
use crate::kinematics::Vec3;
use crate::recording::{Kind, Recording};
use crate::report::answer::Answer;
use crate::report::arrays::{ArrayFormat, Arrays};
use crate::report::csv::{self, Column, Missing};
use crate::report::html::number;
use crate::report::mcap;
use crate::report::output::{Overwrite, write_atomic_with};
use crate::report::parameter_file::ParameterFile;
use crate::report::provenance::Provenance;
use crate::residual::command_for_v;
use crate::simulate::predict_motion;

/// What is to be predicted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What {
    /// Inverse dynamics: motion to voltages, or the input of an axis.
    Voltage,
    /// Motion and voltages to the force on the end effector; the torque of a bench, the stress of a coupon.
    Force,
    /// Forward dynamics: voltages, or an input, to motion.
    Motion,
}

impl What {
    /// Kinds of recordings of which it can be predicted.
    #[must_use]
    pub fn kinds(self) -> &'static [Kind] {
        match self {
            What::Voltage | What::Motion => &[Kind::Robot, Kind::FilmSample, Kind::Axis],
            What::Force => &[Kind::Robot, Kind::HingeBench, Kind::FilmCoupon],
        }
    }

    /// Endings of the files that the prediction of a kind of recording is written as.
    #[must_use]
    pub fn formats(self, kind: Kind) -> &'static [&'static str] {
        match (self, kind) {
            (What::Voltage, Kind::Robot) => &["csv", "mcap", "mat", "npz"],
            _ => &["csv"],
        }
    }
}

/// A prediction: a table with a row for each sample of the recording.
#[derive(Debug)]
pub struct Prediction {
    /// The recording.
    pub id: String,
    /// Why a row is empty, or partly.
    pub flags: Vec<Option<Missing>>,
    /// What a reader should know: causes that were not applied, learnt terms outside their ranges.
    pub remarks: Vec<String>,
    /// In one sentence.
    pub says: String,
    /// What was predicted by name, in [`Prediction::unit`], for a look at its course; empty where a look at
    /// it says nothing.
    pub courses: Vec<(String, Vec<f64>)>,
    /// Unit of the courses.
    pub unit: &'static str,
    what: What,
    kind: Kind,
    provenance: Provenance,
    values: Values,
}

/// The values behind the columns.
#[derive(Debug)]
enum Values {
    Voltage {
        dataset: Box<Dataset>,
        outcome: Box<RecordingOutcome>,
        command_v: Option<Vec<Vec3>>,
    },
    Force {
        time_s: Vec<f64>,
        force_n: Vec<Vec3>,
    },
    Motion {
        time_s: Vec<f64>,
        position_m: Vec<Vec3>,
    },
    SampleVoltage {
        fit: Box<SampleFit>,
        command_v: Vec<f64>,
    },
    SampleMotion {
        time_s: Vec<f64>,
        x_m: Vec<f64>,
    },
    Line {
        fit: Box<LineFit>,
        names: [String; 3],
    },
    LineMotion {
        fit: Box<LineFit>,
        column: (&'static str, f64),
    },
}

impl Prediction {
    fn new(id: &str, values: Values, flags: Vec<Option<Missing>>) -> Self {
        Prediction {
            id: id.to_owned(),
            flags,
            remarks: Vec::new(),
            says: String::new(),
            courses: Vec::new(),
            unit: "",
            what: What::Voltage,
            kind: Kind::Robot,
            provenance: Provenance::default(),
            values,
        }
    }

    /// The columns, each named with its unit; NaN where a row is flagged.
    #[must_use]
    pub fn columns(&self) -> Vec<Column<'_>> {
        let flags = &self.flags;
        match &self.values {
            Values::Voltage {
                outcome, command_v, ..
            } => csv::predicted_voltage(outcome, command_v.as_deref(), flags),
            Values::Force { time_s, force_n } => csv::predicted_force(time_s, force_n, flags),
            Values::Motion { time_s, position_m } => {
                csv::predicted_motion(time_s, position_m, flags)
            }
            Values::SampleVoltage { fit, command_v } => {
                csv::predicted_sample_voltage(fit, command_v, flags)
            }
            Values::SampleMotion { time_s, x_m } => {
                csv::predicted_sample_motion(time_s, x_m, flags)
            }
            Values::Line { fit, names } => csv::predicted_line(fit, names),
            Values::LineMotion { fit, column } => csv::predicted_line_motion(fit, *column, flags),
        }
    }

    /// Of the voltages of a robot: the aligned recording, and prediction and command. Where the amplifier
    /// must be told another voltage than the film gets, that is the prediction.
    fn whole(&self) -> Option<(&Dataset, Cow<'_, RecordingOutcome>)> {
        let Values::Voltage {
            dataset,
            outcome,
            command_v,
        } = &self.values
        else {
            return None;
        };
        let outcome = match command_v {
            None => Cow::Borrowed(outcome.as_ref()),
            Some(told) => Cow::Owned(RecordingOutcome {
                predicted_v: told.clone(),
                ..outcome.as_ref().clone()
            }),
        };
        Some((dataset, outcome))
    }

    /// Writes the table as CSV, each number to the digit that means something.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn csv(&self, out: &mut (impl Write + ?Sized)) -> io::Result<()> {
        csv::write_flagged(out, &self.columns(), &self.flags)
    }

    /// Writes a file: the table as CSV. Voltages of a robot as `.mcap`, `.mat` or `.npz`, or when `full`,
    /// come with the aligned recording and the residual.
    ///
    /// # Errors
    /// The ending is that of another kind of file; the file may not be overwritten, or cannot be written.
    pub fn save(&self, path: &Path, full: bool, overwrite: Overwrite) -> Result<(), Failure> {
        load::ending(path, "the prediction", self.what.formats(self.kind))?;
        let ending = path
            .extension()
            .map_or(String::new(), |e| e.to_string_lossy().to_ascii_lowercase());
        let whole = full || matches!(ending.as_str(), "mcap" | "mat" | "npz");
        match self.whole().filter(|_| whole) {
            Some((dataset, outcome)) if ending == "mcap" => {
                write_atomic_with(path, overwrite, |out| {
                    mcap::aligned(out, dataset, Some(&outcome), &self.provenance)
                })?;
            }
            Some((dataset, outcome)) => {
                let format = ArrayFormat::of_extension(&ending).unwrap_or(ArrayFormat::Csv);
                let arrays = Arrays::of(dataset, Some(&outcome));
                write_atomic_with(path, overwrite, |mut out| arrays.write(format, &mut out))?;
            }
            None => write_atomic_with(path, overwrite, |mut out| self.csv(&mut out))?,
        }
        Ok(())
    }
}

/// Predicts of one recording. `plans` are choices of an earlier run to make again. Of the motion of an axis
/// the first `begin` samples that were measured tell where it begins; others begin at rest. `command` is what
/// a file of it states of how it was made.
///
/// # Errors
/// The recording cannot be aligned, or is of another rig than the parameters; the parameters lack what is
/// needed; `begin` where it has no meaning.
pub fn predict(
    what: What,
    recording: Recording,
    file: &ParameterFile,
    plans: &[Plan],
    begin: usize,
    command: &str,
    progress: &Progress,
) -> Result<Prediction, Failure> {
    let kind = recording.manifest.kind;
    let recordings = [recording];
    let provenance = Provenance::of(command, &recordings);
    let found = match (kind, what) {
        (Kind::FilmSample, _) => sample(what, &recordings, file)?,
        (Kind::Robot, _) if begin > 0 => {
            return Err("--begin is for the motion of an axis: others begin at rest".into());
        }
        (Kind::Robot, What::Motion) => motion(&recordings, file, plans, progress)?,
        (Kind::Robot, _) => robot(what, &recordings, file, plans, progress)?,
        (_, What::Motion) => axis_motion(&recordings, file, begin, progress)?,
        _ => line(&recordings, file, progress)?,
    };
    Ok(Prediction {
        what,
        kind,
        provenance,
        ..found
    })
}

/// The three axes of vectors, each under its name.
fn axes(names: [&str; 3], values: &[Vec3]) -> Vec<(String, Vec<f64>)> {
    let axis = |k: usize| values.iter().map(|v| v[k]).collect();
    (0..3).map(|k| (names[k].to_owned(), axis(k))).collect()
}

/// The voltages or the force that the motion of a robot asks for.
fn robot(
    what: What,
    recordings: &[Recording],
    file: &ParameterFile,
    plans: &[Plan],
    progress: &Progress,
) -> Result<Prediction, Failure> {
    let robot = load::robot(load::rig(recordings)?, Some(file))?;
    let mut datasets = load::aligned(recordings, plans, progress)?;
    progress.step("predicting");
    let parameters = file.parameters()?;
    let at_work = series::at_work(file, recordings, &datasets)?;
    let (effects, when) = (&at_work.effects, at_work.when[0]);
    let dataset = datasets.remove(0);
    let mut outcome = validate_robot_with(&robot, &[&dataset], &parameters, effects, &[when])?;
    let answer = Answer::of_robot(&outcome, &robot).says;
    let r = outcome.recordings.remove(0);
    let mut flags = csv::missing(&r);
    // What the amplifier has to be told, where it is not what the film gets.
    let electrical = effects.iter().any(|a| a.effect.site() == Site::Electrical);
    let command_v = if electrical && what == What::Voltage {
        let told = predict_command(&robot, &dataset, &r.predicted_v, effects, when)?;
        csv::no_command(&mut flags, &told);
        Some(told)
    } else {
        None
    };
    let told_v = match &command_v {
        Some(told) => ranges::by_actuator(told),
        None if what == What::Voltage => ranges::by_actuator(&r.predicted_v),
        None => ranges::commands_v(&dataset, r.offset_s),
    };
    let mut remarks = at_work.remarks.clone();
    let acting = (&effects[..], when);
    remarks.extend(ranges::of_dataset(&robot, &dataset, acting, &told_v));
    let id = r.id.clone();
    if what == What::Force {
        let force_n = predict_force(&robot, &dataset, &parameters, r.offset_s, effects, when)?;
        force_flags(&mut flags, &force_n);
        let time_s = r.time_s;
        return Ok(Prediction {
            says: of_force(&force_n),
            courses: axes(["force x", "force y", "force z"], &force_n),
            unit: "N",
            remarks,
            ..Prediction::new(&id, Values::Force { time_s, force_n }, flags)
        });
    }
    let courses = axes(["voltage 1", "voltage 2", "voltage 3"], &r.predicted_v);
    let values = Values::Voltage {
        dataset: Box::new(dataset),
        outcome: Box::new(r),
        command_v,
    };
    Ok(Prediction {
        says: answer,
        courses,
        unit: "V",
        remarks,
        ..Prediction::new(&id, values, flags)
    })
}

/// A pose that no voltage holds is a force like any other; one without a force had no voltage.
fn force_flags(flags: &mut [Option<Missing>], force_n: &[[f64; 3]]) {
    for (flag, f) in flags.iter_mut().zip(force_n) {
        if matches!(flag, Some(Missing::Negative(_))) {
            *flag = None;
        }
        if flag.is_none() && f[0].is_nan() {
            *flag = Some(Missing::NoVoltage);
        }
    }
}

/// A force in a sentence: its mean along each axis.
fn of_force(force_n: &[[f64; 3]]) -> String {
    let mean = |k: usize| {
        let known = force_n.iter().map(|f| f[k]).filter(|f| f.is_finite());
        let (sum, n) = known.fold((0.0, 0.0), |(s, n), f| (s + f, n + 1.0));
        number::sized(sum / n, "N", 2)
    };
    format!(
        "The force on the end effector that motion and voltages ask for is {} in x, {} in y, {} in z, on average.",
        mean(0),
        mean(1),
        mean(2)
    )
}

/// The motion that the recorded voltages make. What was captured is not looked at, but for a clock offset
/// that is to be estimated.
fn motion(
    recordings: &[Recording],
    file: &ParameterFile,
    plans: &[Plan],
    progress: &Progress,
) -> Result<Prediction, Failure> {
    let robot = load::robot(load::rig(recordings)?, Some(file))?;
    let datasets = load::aligned(recordings, plans, progress)?;
    progress.step("predicting");
    let parameters = file.parameters()?;
    let at_work = series::at_work(file, recordings, &datasets)?;
    let (effects, when) = (at_work.effects.as_slice(), at_work.when[0]);
    let dataset = &datasets[0];
    let offset_s = match dataset.offset_source {
        OffsetSource::Stated | OffsetSource::Measured => dataset.offset_s,
        OffsetSource::Free => {
            validate_robot_with(&robot, &[dataset], &parameters, effects, &[when])?.recordings[0]
                .offset_s
        }
    };
    let forward = predict_motion(&robot, dataset, &parameters, offset_s, effects, when)
        .map_err(|why| format!("recording `{}`: {}", dataset.id, explain(&why)))?;
    let mut remarks = at_work.remarks.clone();
    let position_m = forward.position_m;
    let acting = (effects, when);
    remarks.extend(ranges::of_motion(
        &robot,
        dataset,
        &position_m,
        acting,
        offset_s,
    ));
    let n = dataset.samples();
    let time_s: Vec<f64> = (0..n).map(|i| dataset.time_s(i)).collect();
    let flags: Vec<Option<Missing>> = (0..n)
        .map(|i| match &forward.ended {
            Some((end, why)) if i >= *end => Some(Missing::Other(why.clone())),
            _ if position_m[i][0].is_nan() => Some(Missing::NoVoltage),
            _ => None,
        })
        .collect();
    let mut courses = axes(["x", "y", "z"], &position_m);
    courses.reverse();
    Ok(Prediction {
        says: match &forward.ended {
            None => format!("{n} frames predicted, from rest; position:"),
            Some((end, why)) => format!("{end} of {n} frames predicted: {why}."),
        },
        courses,
        unit: "m",
        remarks,
        ..Prediction::new(&dataset.id, Values::Motion { time_s, position_m }, flags)
    })
}

/// Voltage or motion of a hanging sample.
fn sample(
    what: What,
    recordings: &[Recording],
    file: &ParameterFile,
) -> Result<Prediction, Failure> {
    let (datasets, samples) = load::samples(recordings, Some(file))?;
    let film = file.parameters()?.film;
    let (dataset, sample) = (&datasets[0], &samples[0]);
    if what == What::Motion {
        let x_m = predict_sample_motion(dataset, sample, &film)?;
        let time_s: Vec<f64> = (0..dataset.samples()).map(|i| dataset.time_s(i)).collect();
        let (first, last) = dataset.voltage.span_s();
        let slack = 0.5 * dataset.step_s;
        let flags: Vec<Option<Missing>> = time_s
            .iter()
            .map(|t| {
                let known = (first - slack..=last + slack).contains(&(t + dataset.offset_s));
                (!known).then_some(Missing::NoVoltage)
            })
            .collect();
        let values = Values::SampleMotion { time_s, x_m };
        return Ok(Prediction::new(&dataset.id, values, flags));
    }
    let mut outcome = validate_samples(&[dataset], &samples, &film)?;
    let r = outcome.recordings.remove(0);
    let flags = csv::missing_of_sample(&r);
    let phi: Vec<f64> = r
        .needed_squared_v2
        .iter()
        .map(|s| s.max(0.0).sqrt())
        .collect();
    let command_v = command_for_v(sample, &phi, &r.area, dataset.step_s);
    let values = Values::SampleVoltage {
        fit: Box::new(r),
        command_v,
    };
    Ok(Prediction {
        says: outcome.verdict,
        ..Prediction::new(&dataset.id, values, flags)
    })
}

/// The motion that the input of an axis makes.
fn axis_motion(
    recordings: &[Recording],
    file: &ParameterFile,
    begin: usize,
    progress: &Progress,
) -> Result<Prediction, Failure> {
    let lines = load::lines(recordings, progress)?;
    let (model, remarks) = series::line_model_on(file, recordings, &lines)?;
    let r = predict_line_motion(&lines[0], &model, begin)?;
    let (column, unit) = match &lines[0].measured {
        Measured::Axis(x) if x.turns && x.velocity => (("rate_rad_s", 1.0), "rad/s"),
        Measured::Axis(x) if x.turns => (("angle_rad", 1.0), "rad"),
        Measured::Axis(x) if x.velocity => (("v_mm_s", 1e3), "m/s"),
        _ => (("x_mm", 1e3), "m"),
    };
    let read = || Missing::Other("read, to tell where the motion begins".into());
    let n = r.predicted.len();
    let flags: Vec<Option<Missing>> = (0..n).map(|i| (i < begin).then(read)).collect();
    let name = column.0.split('_').next().unwrap_or("x").to_owned();
    let from = match begin {
        0 => format!("{n} samples predicted, from rest."),
        b => format!(
            "{} samples predicted; {b} of the measured motion tell where it begins.",
            n.saturating_sub(b)
        ),
    };
    let id = r.id.clone();
    let says = format!("{} {from}", Answer::of_line(&r, "motion", unit).says);
    let courses = vec![(name, r.predicted.clone())];
    let fit = Box::new(r);
    Ok(Prediction {
        says,
        remarks,
        courses,
        unit,
        ..Prediction::new(&id, Values::LineMotion { fit, column }, flags)
    })
}

/// Input of an axis, torque of a bench or stress of a coupon.
fn line(
    recordings: &[Recording],
    file: &ParameterFile,
    progress: &Progress,
) -> Result<Prediction, Failure> {
    let lines = load::lines(recordings, progress)?;
    let (model, remarks) = series::line_model_on(file, recordings, &lines)?;
    let (r, unit) = predict_line(&lines[0], &model)?;
    let (coordinate, driven) = match &lines[0].measured {
        Measured::Torque(_) => ("angle_rad", "torque"),
        Measured::Axis(a) if a.turns => ("angle_rad", "input"),
        Measured::Axis(_) => ("position_m", "input"),
        Measured::Coupon(_) => ("stretch", "stress"),
    };
    let word: String = unit
        .chars()
        .map(|c| if c.is_alphanumeric() { c } else { '_' })
        .collect();
    let left_out = || Missing::Other("left out: at an end, in a gap, or at a rail".into());
    let flags: Vec<Option<Missing>> = r
        .predicted
        .iter()
        .map(|p| p.is_nan().then(left_out))
        .collect();
    let names = [
        coordinate.to_owned(),
        format!("measured_{word}"),
        format!("predicted_{word}"),
    ];
    let (id, says) = (r.id.clone(), Answer::of_line(&r, driven, &unit).says);
    let fit = Box::new(r);
    Ok(Prediction {
        says,
        remarks,
        ..Prediction::new(&id, Values::Line { fit, names }, flags)
    })
}
