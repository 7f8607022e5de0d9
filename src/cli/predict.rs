//! `predict voltage|force|motion`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::simulate::explain;
use super::{Failure, Talk, Unsaid, load, ranges, series};
use crate::calibration::{
    RecordingOutcome, predict_command, predict_force, predict_line, predict_line_motion,
    predict_sample_motion, validate_robot_with, validate_samples,
};
use crate::dataset::line::Measured;
use crate::dataset::{Dataset, OffsetSource};
use crate::effects::Site;
use crate::model::{Parameters, Robot};
use crate::recording::{Kind, Recording};
use crate::report::answer::Answer;
use crate::report::arrays::{ArrayFormat, Arrays};
use crate::report::csv::{self, Missing};
use crate::report::html::number;
use crate::report::json::PredictionJson;
use crate::report::mcap;
use crate::report::output::write_atomic_with;
use crate::report::parameter_file::ParameterFile;
use crate::report::provenance::Provenance;
use crate::report::terminal;
use crate::residual::command_for_v;
use crate::simulate::predict_motion;

/// What to predict.
#[derive(Subcommand)]
pub(super) enum Predict {
    /// Inverse dynamics: motion to voltages (CSV: time_s, phi1_V, phi2_V, phi3_V, their standard deviations,
    /// flag). Where the parameter file has electrical causes, phi is what the amplifier must be told, and
    /// film1_V to film3_V are the voltages on the films; a hanging sample has phi_V. Of an axis, its input:
    /// measured and predicted
    Voltage(Arguments),
    /// Motion and voltages to the force on the end effector (CSV: time_s, Fx_N, Fy_N, Fz_N, flag); of a hinge
    /// bench its torque, of a film coupon its stress
    Force(Arguments),
    /// Forward dynamics from rest: voltages to motion (CSV: time_s, x_mm, y_mm, z_mm, flag; a hanging sample
    /// has x_mm downwards, zero at rest; an axis x_mm, angle_rad, or what it was measured as: v_mm_s,
    /// rate_rad_s)
    Motion(Arguments),
}

/// From what, and where to.
#[derive(Args)]
pub(super) struct Arguments {
    /// A recording.toml, or a folder that has one
    #[arg(value_name = "REC")]
    recording: PathBuf,
    /// Parameter file
    #[arg(long)]
    params: PathBuf,
    /// Rig to use instead of the recording's own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// plan.toml of an earlier run, to make the same choices again
    #[arg(long)]
    plan: Option<PathBuf>,
    /// File to write (default: standard output). Voltages as .mcap, .mat (MATLAB) or .npz (NumPy) come with
    /// the aligned recording and the residual
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// The aligned recording and the residual in the CSV too, every digit
    #[arg(long)]
    full: bool,
    /// Motion of an axis: first samples of the measured motion that tell where it begins (0: from rest under
    /// the first input, and nothing of the motion is read)
    #[arg(long, default_value_t = 0, value_name = "SAMPLES")]
    begin: usize,
}

pub(super) fn run(predict: &Predict, command: &str, talk: Talk) -> Result<(), Failure> {
    let (Predict::Voltage(a) | Predict::Force(a) | Predict::Motion(a)) = predict;
    let progress = Progress::new(talk);
    let kinds: &[Kind] = match predict {
        Predict::Voltage(_) => &[Kind::Robot, Kind::FilmSample, Kind::Axis],
        Predict::Force(_) => &[Kind::Robot, Kind::HingeBench, Kind::FilmCoupon],
        Predict::Motion(_) => &[Kind::Robot, Kind::FilmSample, Kind::Axis],
    };
    let recordings = load::recordings_of(
        std::slice::from_ref(&a.recording),
        a.rig.as_ref(),
        kinds,
        &progress,
    )?;
    let kind = recordings[0].manifest.kind;
    if let Some(path) = &a.output {
        let whole = matches!(predict, Predict::Voltage(_)) && kind == Kind::Robot;
        let fits: &[&str] = if whole {
            &["csv", "mcap", "mat", "npz"]
        } else {
            &["csv"]
        };
        load::ending(path, "the prediction", fits)?;
    }
    let file = load::parameters(&a.params)?;
    match (kind, predict) {
        (Kind::FilmSample, _) => {
            drop(progress);
            sample(predict, a, &recordings, &file, talk)
        }
        (Kind::Robot, _) => robot(predict, command, &recordings, &file, progress, talk),
        (_, Predict::Motion(_)) => axis_motion(a, &recordings, &file, progress, talk),
        _ => line(a, &recordings, &file, progress, talk),
    }
}

/// Of a robot: the voltages or the force that its motion asks for, or the motion itself.
fn robot(
    predict: &Predict,
    command: &str,
    recordings: &[Recording],
    file: &ParameterFile,
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let (Predict::Voltage(a) | Predict::Force(a) | Predict::Motion(a)) = predict;
    if a.begin > 0 {
        return Err("--begin is for the motion of an axis: others begin at rest".into());
    }
    let robot = load::robot(load::rig(recordings)?, Some(file))?;
    let datasets = load::datasets(recordings, a.plan.as_ref(), &progress)?;
    let dataset = &datasets[0];
    progress.step("predicting");
    let parameters = file.parameters()?;
    let at_work = series::at_work(file, recordings, &datasets)?;
    let (effects, when) = (&at_work.effects, at_work.when[0]);
    if matches!(predict, Predict::Motion(_)) {
        return motion(a, &robot, dataset, &parameters, &at_work, progress, talk);
    }
    let outcome = validate_robot_with(&robot, &[dataset], &parameters, effects, &[when])?;
    let r = &outcome.recordings[0];
    let mut flags = csv::missing(r);
    // What the amplifier has to be told, where it is not what the film gets.
    let electrical = effects.iter().any(|a| a.effect.site() == Site::Electrical);
    let command_v = if electrical && matches!(predict, Predict::Voltage(_)) {
        let told = predict_command(&robot, dataset, &r.predicted_v, effects, when)?;
        csv::no_command(&mut flags, &told);
        Some(told)
    } else {
        None
    };
    let told_v = match &command_v {
        Some(told) => ranges::by_actuator(told),
        None if matches!(predict, Predict::Voltage(_)) => ranges::by_actuator(&r.predicted_v),
        None => ranges::commands_v(dataset, r.offset_s),
    };
    let mut remarks = at_work.remarks.clone();
    remarks.extend(ranges::of_dataset(
        &robot,
        dataset,
        (effects, when),
        &told_v,
    ));
    drop(progress);
    let mut shown = r.predicted_v.clone();
    let (mut names, mut unit) = (["voltage 1", "voltage 2", "voltage 3"], "V");
    if matches!(predict, Predict::Force(_)) {
        shown = predict_force(&robot, dataset, &parameters, r.offset_s, effects, when)?;
        force_flags(&mut flags, &shown);
        write(a.output.as_deref(), talk, |out| {
            csv::predicted_force(out, &r.time_s, &shown, &flags)
        })?;
        (names, unit) = (["force x", "force y", "force z"], "N");
    } else if is_whole(a) {
        let path = a.output.as_deref().unwrap_or(Path::new(""));
        let provenance = Provenance::of(command, recordings);
        // where the amplifier must be told another voltage than the film gets, that is compared with the
        // command
        let mut whole = r.clone();
        if let Some(told) = command_v {
            whole.predicted_v = told;
        }
        write_whole(path, talk, dataset, &whole, &provenance)?;
    } else {
        write(a.output.as_deref(), talk, |out| {
            csv::predicted_voltage(out, r, command_v.as_deref(), &flags)
        })?;
    }
    let json = PredictionJson::new(&r.id, a.output.as_deref(), &flags);
    talk.result(&json.with_remarks(&remarks));
    if a.output.is_some() {
        match predict {
            Predict::Force(_) => talk.answer(&of_force(&shown)),
            _ => talk.answer(&Answer::of_robot(&outcome, &robot).says),
        }
        let axis = |k: usize| shown.iter().map(move |v| v[k]);
        let rows = (0..3).map(|k| (names[k].to_owned(), axis(k)));
        say_ranges(rows, unit, talk);
    }
    remark(a, talk, &remarks);
    Ok(())
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

/// What was predicted, one line a channel: its range and its course.
fn say_ranges<I: Iterator<Item = f64>>(
    channels: impl Iterator<Item = (String, I)>,
    unit: &str,
    talk: Talk,
) {
    let rows: Vec<[String; 3]> = channels
        .map(|(name, values)| {
            let values: Vec<f64> = values.collect();
            let range = terminal::range(values.iter().copied(), unit);
            [name, range, terminal::curve(&values, terminal::WIDTH)]
        })
        .collect();
    terminal::columns(&rows).iter().for_each(|l| talk.say(l));
}

/// Says what a reader should know: beside the prediction where that is in a file, else beside the table on
/// standard output, on standard error.
fn remark(a: &Arguments, talk: Talk, remarks: &[String]) {
    for text in remarks {
        if a.output.is_some() {
            talk.say(text);
        } else if !talk.json && !talk.quiet {
            eprintln!("deacal: {}", super::plain(text));
        }
    }
}

/// The motion that the recorded voltages make. What was captured is not looked at, but for a clock offset
/// that is to be estimated.
fn motion(
    a: &Arguments,
    robot: &Robot,
    dataset: &Dataset,
    parameters: &Parameters,
    at_work: &series::AtWork,
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let (effects, when) = (at_work.effects.as_slice(), at_work.when[0]);
    let offset_s = match dataset.offset_source {
        OffsetSource::Stated | OffsetSource::Measured => dataset.offset_s,
        OffsetSource::Free => {
            validate_robot_with(robot, &[dataset], parameters, effects, &[when])?.recordings[0]
                .offset_s
        }
    };
    let forward = predict_motion(robot, dataset, parameters, offset_s, effects, when)
        .map_err(|why| format!("recording `{}`: {}", dataset.id, explain(&why)))?;
    let mut remarks = at_work.remarks.clone();
    let position_m = &forward.position_m;
    remarks.extend(ranges::of_motion(
        robot,
        dataset,
        position_m,
        (effects, when),
        offset_s,
    ));
    drop(progress);
    let n = dataset.samples();
    let time_s: Vec<f64> = (0..n).map(|i| dataset.time_s(i)).collect();
    let flags: Vec<Option<Missing>> = (0..n)
        .map(|i| match &forward.ended {
            Some((end, why)) if i >= *end => Some(Missing::Other(why.clone())),
            _ if forward.position_m[i][0].is_nan() => Some(Missing::NoVoltage),
            _ => None,
        })
        .collect();
    write(a.output.as_deref(), talk, |out| {
        csv::predicted_motion(out, &time_s, &forward.position_m, &flags)
    })?;
    let json = PredictionJson::new(&dataset.id, a.output.as_deref(), &flags);
    talk.result(&json.with_remarks(&remarks));
    if a.output.is_some() {
        talk.say(&match &forward.ended {
            None => format!("{n} frames predicted, from rest; position:"),
            Some((end, why)) => format!("{end} of {n} frames predicted: {why}."),
        });
        let axis = |k: usize| forward.position_m.iter().map(move |p| p[k]);
        let rows = ["z", "y", "x"].into_iter().zip([2, 1, 0]);
        say_ranges(rows.map(|(name, k)| (name.to_owned(), axis(k))), "m", talk);
    }
    remark(a, talk, &remarks);
    Ok(())
}

/// Voltage or motion of a hanging sample.
fn sample(
    predict: &Predict,
    a: &Arguments,
    recordings: &[Recording],
    file: &ParameterFile,
    talk: Talk,
) -> Result<(), Failure> {
    let (datasets, samples) = load::samples(recordings, Some(file))?;
    let film = file.parameters()?.film;
    let (dataset, sample) = (&datasets[0], &samples[0]);
    let flags = if matches!(predict, Predict::Motion(_)) {
        let x_m = predict_sample_motion(dataset, sample, &film)?;
        let times: Vec<f64> = (0..dataset.samples()).map(|i| dataset.time_s(i)).collect();
        let (first, last) = dataset.voltage.span_s();
        let slack = 0.5 * dataset.step_s;
        let flags: Vec<Option<Missing>> = times
            .iter()
            .map(|t| {
                let known = (first - slack..=last + slack).contains(&(t + dataset.offset_s));
                (!known).then_some(Missing::NoVoltage)
            })
            .collect();
        write(a.output.as_deref(), talk, |out| {
            csv::predicted_sample_motion(out, &times, &x_m, &flags)
        })?;
        flags
    } else {
        let outcome = validate_samples(&[dataset], &samples, &film)?;
        let r = &outcome.recordings[0];
        let flags = csv::missing_of_sample(r);
        let phi: Vec<f64> = r
            .needed_squared_v2
            .iter()
            .map(|s| s.max(0.0).sqrt())
            .collect();
        let command = command_for_v(sample, &phi, &r.area, dataset.step_s);
        write(a.output.as_deref(), talk, |out| {
            csv::predicted_sample_voltage(out, r, &command, &flags)
        })?;
        if a.output.is_some() {
            talk.say(&outcome.verdict);
        }
        flags
    };
    talk.result(&PredictionJson::new(
        &dataset.id,
        a.output.as_deref(),
        &flags,
    ));
    Ok(())
}

/// The motion that the input of an axis makes.
fn axis_motion(
    a: &Arguments,
    recordings: &[Recording],
    file: &ParameterFile,
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let lines = load::lines(recordings, &progress)?;
    let r = predict_line_motion(&lines[0], &file.line_model()?, a.begin)?;
    drop(progress);
    let (column, unit) = match &lines[0].measured {
        Measured::Axis(x) if x.turns && x.velocity => (("rate_rad_s", 1.0), "rad/s"),
        Measured::Axis(x) if x.turns => (("angle_rad", 1.0), "rad"),
        Measured::Axis(x) if x.velocity => (("v_mm_s", 1e3), "m/s"),
        _ => (("x_mm", 1e3), "m"),
    };
    let read = || Missing::Other("read, to tell where the motion begins".into());
    let flags: Vec<Option<Missing>> = (0..r.predicted.len())
        .map(|i| (i < a.begin).then(read))
        .collect();
    write(a.output.as_deref(), talk, |out| {
        csv::predicted_line_motion(out, &r, column, &flags)
    })?;
    talk.result(&PredictionJson::new(&r.id, a.output.as_deref(), &flags));
    if a.output.is_some() {
        talk.tell(&Answer::of_line(&r, "motion", unit).says);
        let name = column.0.split('_').next().unwrap_or("x").to_owned();
        say_ranges(
            [(name, r.predicted.iter().copied())].into_iter(),
            unit,
            talk,
        );
        talk.say(&match a.begin {
            0 => format!("{} samples predicted, from rest.", r.predicted.len()),
            n => format!(
                "{} samples predicted; {n} of the measured motion tell where it begins.",
                r.predicted.len().saturating_sub(n)
            ),
        });
    }
    Ok(())
}

/// Input of an axis, torque of a bench or stress of a coupon.
fn line(
    a: &Arguments,
    recordings: &[Recording],
    file: &ParameterFile,
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let lines = load::lines(recordings, &progress)?;
    let (r, unit) = predict_line(&lines[0], &file.line_model()?)?;
    drop(progress);
    let coordinate = match &lines[0].measured {
        Measured::Torque(_) => "angle_rad",
        Measured::Axis(a) if a.turns => "angle_rad",
        Measured::Axis(_) => "position_m",
        Measured::Coupon(_) => "stretch",
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
    write(a.output.as_deref(), talk, |out| {
        csv::predicted_line(out, &r, names, &flags)
    })?;
    talk.result(&PredictionJson::new(&r.id, a.output.as_deref(), &flags));
    if a.output.is_some() {
        let driven = match &lines[0].measured {
            Measured::Torque(_) => "torque",
            Measured::Axis(_) => "input",
            Measured::Coupon(_) => "stress",
        };
        talk.tell(&Answer::of_line(&r, driven, &unit).says);
    }
    Ok(())
}

/// The extension of the file to write.
fn extension(path: &Path) -> String {
    path.extension()
        .map_or(String::new(), |e| e.to_string_lossy().to_ascii_lowercase())
}

/// Whether recording, prediction and residual are asked for together.
fn is_whole(a: &Arguments) -> bool {
    let other = |p: &PathBuf| matches!(extension(p).as_str(), "mcap" | "mat" | "npz");
    a.output.as_ref().is_some_and(|p| a.full || other(p))
}

/// Aligned recording, prediction and residual.
fn write_whole(
    path: &Path,
    talk: Talk,
    dataset: &Dataset,
    r: &RecordingOutcome,
    provenance: &Provenance,
) -> Result<(), Failure> {
    let extension = extension(path);
    if extension == "mcap" {
        write_atomic_with(path, talk.overwrite(), |out| {
            mcap::aligned(out, dataset, Some(r), provenance)
        })?;
        return Ok(());
    }
    let format = ArrayFormat::of_extension(&extension).unwrap_or(ArrayFormat::Csv);
    let arrays = Arrays::of(dataset, Some(r));
    write_atomic_with(path, talk.overwrite(), |mut out| {
        arrays.write(format, &mut out)
    })?;
    Ok(())
}

/// Into the file, or to standard output when none is named (and the output is not JSON).
fn write(
    path: Option<&Path>,
    talk: Talk,
    fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), Failure> {
    match path {
        Some(path) => write_atomic_with(path, talk.overwrite(), |mut out| fill(&mut out))?,
        None if talk.json => {}
        None => {
            let mut out = std::io::BufWriter::new(std::io::stdout().lock());
            fill(&mut out)
                .and_then(|()| out.flush())
                .map_err(Unsaid::failure)?;
        }
    }
    Ok(())
}
