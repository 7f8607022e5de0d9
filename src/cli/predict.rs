//! `predict voltage|force|motion`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::{Failure, Talk, load};
use crate::calibration::{predict_force, predict_sample_motion, validate_robot, validate_samples};
use crate::recording::{Kind, Recording};
use crate::report::csv::{self, Missing};
use crate::report::json::PredictionJson;
use crate::report::output::write_atomic_with;
use crate::report::parameter_file::ParameterFile;
use crate::residual::command_for_v;

/// What to predict.
#[derive(Subcommand)]
pub(super) enum Predict {
    /// Inverse dynamics: motion to voltages (CSV: time_s, phi1_V, phi2_V, phi3_V, their standard deviations, flag; a hanging sample has phi_V)
    Voltage(Arguments),
    /// Motion and voltages to the force on the end effector (CSV: time_s, Fx_N, Fy_N, Fz_N, flag)
    Force(Arguments),
    /// Voltage to the motion of a hanging sample, from rest (CSV: time_s, x_mm downwards and zero at rest, flag)
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
    /// File to write (default: standard output)
    #[arg(short, long)]
    output: Option<PathBuf>,
}

pub(super) fn run(predict: &Predict, talk: Talk) -> Result<(), Failure> {
    let (Predict::Voltage(a) | Predict::Force(a) | Predict::Motion(a)) = predict;
    let progress = Progress::new(talk);
    let kinds: &[Kind] = match predict {
        Predict::Voltage(_) => &[Kind::Robot, Kind::FilmSample],
        Predict::Force(_) => &[Kind::Robot],
        Predict::Motion(_) => &[Kind::FilmSample],
    };
    let recordings = load::recordings_of(
        std::slice::from_ref(&a.recording),
        a.rig.as_ref(),
        kinds,
        &progress,
    )?;
    let file = load::parameters(&a.params)?;
    if recordings[0].manifest.kind == Kind::FilmSample {
        drop(progress);
        return sample(predict, a, &recordings, &file, talk);
    }
    let robot = load::robot(load::rig(&recordings)?, Some(&file))?;
    let datasets = load::datasets(&recordings, a.plan.as_ref(), &progress)?;
    progress.step("predicting");
    let parameters = file.parameters()?;
    let outcome = validate_robot(&robot, &[&datasets[0]], &parameters)?;
    let r = &outcome.recordings[0];
    let mut flags = csv::missing(r);
    drop(progress);
    match predict {
        Predict::Voltage(_) => write(a.output.as_deref(), talk, |out| {
            csv::predicted_voltage(out, r)
        })?,
        Predict::Motion(_) => unreachable!("only hanging samples come this way, and went another"),
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
