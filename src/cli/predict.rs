//! `predict voltage|force|motion`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::{Failure, Talk, Unsaid, ending, load};
use crate::calibration::RecordingOutcome;
use crate::dataset::Dataset;
use crate::jobs::predict::{Prediction, What, predict};
use crate::recording::Kind;
use crate::report::arrays::{ArrayFormat, Arrays};
use crate::report::json::PredictionJson;
use crate::report::mcap;
use crate::report::output::write_atomic_with;
use crate::report::provenance::Provenance;
use crate::report::terminal;

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

pub(super) fn run(asked: &Predict, command: &str, talk: Talk) -> Result<(), Failure> {
    let (what, a) = match asked {
        Predict::Voltage(a) => (What::Voltage, a),
        Predict::Force(a) => (What::Force, a),
        Predict::Motion(a) => (What::Motion, a),
    };
    let progress = Progress::new(talk);
    let paths = std::slice::from_ref(&a.recording);
    let mut recordings = load::recordings_of(paths, a.rig.as_ref(), what.kinds(), &progress)?;
    let recording = recordings.remove(0);
    if let Some(path) = &a.output {
        let whole = what == What::Voltage && recording.manifest.kind == Kind::Robot;
        let fits: &[&str] = if whole {
            &["csv", "mcap", "mat", "npz"]
        } else {
            &["csv"]
        };
        ending(path, "the prediction", fits)?;
    }
    let file = load::parameters(&a.params)?;
    let plans = load::plans(a.plan.as_ref())?;
    let provenance = Provenance::of(command, [&recording]);
    let found = predict(what, recording, &file, &plans, a.begin, &progress)?;
    drop(progress);
    match found.whole() {
        Some((dataset, outcome)) if is_whole(a) => {
            let path = a.output.as_deref().unwrap_or(Path::new(""));
            write_whole(path, talk, dataset, &outcome, &provenance)?;
        }
        _ => write(a.output.as_deref(), talk, |out| found.csv(out))?,
    }
    let json = PredictionJson::new(&found.id, a.output.as_deref(), &found.flags);
    talk.result(&json.with_remarks(&found.remarks));
    if a.output.is_some() {
        if !found.says.is_empty() {
            talk.answer(&found.says);
        }
        say_courses(&found, talk);
    }
    remark(a, talk, &found.remarks);
    Ok(())
}

/// What was predicted, one line a channel: its range and its course.
fn say_courses(found: &Prediction, talk: Talk) {
    let row = |(name, values): &(String, Vec<f64>)| {
        let range = terminal::range(values.iter().copied(), found.unit);
        [
            name.clone(),
            range,
            terminal::curve(values, terminal::WIDTH),
        ]
    };
    let rows: Vec<[String; 3]> = found.courses.iter().map(row).collect();
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
