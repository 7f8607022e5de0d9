//! `predict voltage|force`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::{Failure, Talk, load};
use crate::calibration::{RecordingOutcome, predict_force, validate_robot};
use crate::dataset::Dataset;
use crate::recording::Kind;
use crate::report::arrays::{ArrayFormat, Arrays};
use crate::report::csv::{self, Missing};
use crate::report::json::PredictionJson;
use crate::report::mcap;
use crate::report::output::write_atomic_with;
use crate::report::provenance::Provenance;

/// What to predict.
#[derive(Subcommand)]
pub(super) enum Predict {
    /// Inverse dynamics: motion to voltages (CSV: time_s, phi1_V, phi2_V, phi3_V, their standard deviations, flag)
    Voltage(Arguments),
    /// Motion and voltages to the force on the end effector (CSV: time_s, Fx_N, Fy_N, Fz_N, flag)
    Force(Arguments),
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
    /// File to write (default: standard output). Voltages as .mcap, .mat (MATLAB) or .npz (NumPy) come with the aligned recording
    /// and the residual
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// The aligned recording and the residual in the CSV too, every digit
    #[arg(long)]
    full: bool,
}

pub(super) fn run(predict: &Predict, command: &str, talk: Talk) -> Result<(), Failure> {
    let (Predict::Voltage(a) | Predict::Force(a)) = predict;
    let progress = Progress::new(talk);
    let recordings = load::recordings(
        std::slice::from_ref(&a.recording),
        a.rig.as_ref(),
        Kind::Robot,
        &progress,
    )?;
    let file = load::parameters(&a.params)?;
    let robot = load::robot(load::rig(&recordings)?, Some(&file))?;
    let datasets = load::datasets(&recordings, a.plan.as_ref(), &progress)?;
    progress.step("predicting");
    let parameters = file.parameters()?;
    let outcome = validate_robot(&robot, &[&datasets[0]], &parameters)?;
    let r = &outcome.recordings[0];
    let mut flags = csv::missing(r);
    drop(progress);
    match predict {
        Predict::Voltage(_) if is_whole(a) => {
            let path = a.output.as_deref().unwrap_or(Path::new(""));
            let provenance = Provenance::of(command, &recordings);
            write_whole(path, &datasets[0], r, &provenance)?;
        }
        Predict::Voltage(_) => write(a.output.as_deref(), talk, |out| {
            csv::predicted_voltage(out, r)
        })?,
        Predict::Force(_) => {
            let force = predict_force(&robot, &datasets[0], &parameters, r.offset_s)?;
            for (flag, f) in flags.iter_mut().zip(&force) {
                // A pose that no voltage holds is a force like any other.
                if matches!(flag, Some(Missing::Negative(_))) {
                    *flag = None;
                }
                if flag.is_none() && f[0].is_nan() {
                    *flag = Some(Missing::NoVoltage);
                }
            }
            write(a.output.as_deref(), talk, |out| {
                csv::predicted_force(out, &r.time_s, &force, &flags)
            })?;
        }
    }
    talk.result(&PredictionJson::new(&r.id, a.output.as_deref(), &flags));
    if a.output.is_some() {
        talk.say(&outcome.verdict);
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
    dataset: &Dataset,
    r: &RecordingOutcome,
    provenance: &Provenance,
) -> Result<(), Failure> {
    let extension = extension(path);
    if extension == "mcap" {
        write_atomic_with(path, |out| mcap::aligned(out, dataset, Some(r), provenance))?;
        return Ok(());
    }
    let format = ArrayFormat::of_extension(&extension).unwrap_or(ArrayFormat::Csv);
    let arrays = Arrays::of(dataset, Some(r));
    write_atomic_with(path, |mut out| arrays.write(format, &mut out))?;
    Ok(())
}

/// Into the file, or to standard output when none is named (and the output is not JSON).
fn write(
    path: Option<&Path>,
    talk: Talk,
    fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), Failure> {
    match path {
        Some(path) => write_atomic_with(path, |mut out| fill(&mut out))?,
        None if talk.json => {}
        None => fill(&mut std::io::BufWriter::new(std::io::stdout().lock()))?,
    }
    Ok(())
}
