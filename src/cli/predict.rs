//! `predict voltage|force`.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::{Failure, Talk, load, series};
use crate::calibration::{predict_command, predict_force, validate_robot_with};
use crate::effects::Site;
use crate::recording::Kind;
use crate::report::csv::{self, Missing};
use crate::report::json::PredictionJson;
use crate::report::output::write_atomic_with;

/// What to predict.
#[derive(Subcommand)]
pub(super) enum Predict {
    /// Inverse dynamics: motion to voltages (CSV: time_s, phi1_V, phi2_V, phi3_V, their standard deviations, flag). Where the parameter file has electrical causes, phi is what the amplifier must be told, and film1_V to film3_V are the voltages on the films
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
    /// File to write (default: standard output)
    #[arg(short, long)]
    output: Option<PathBuf>,
}

pub(super) fn run(predict: &Predict, talk: Talk) -> Result<(), Failure> {
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
    let at_work = series::at_work(&file, &recordings, &datasets)?;
    let (effects, when) = (&at_work.effects, at_work.when[0]);
    let outcome = validate_robot_with(&robot, &[&datasets[0]], &parameters, effects, &[when])?;
    let r = &outcome.recordings[0];
    let mut flags = csv::missing(r);
    // What the amplifier has to be told, where it is not what the film gets.
    let electrical = effects.iter().any(|a| a.effect.site() == Site::Electrical);
    let command_v = if electrical && matches!(predict, Predict::Voltage(_)) {
        let told = predict_command(&robot, &datasets[0], &r.predicted_v, effects, when)?;
        csv::no_command(&mut flags, &told);
        Some(told)
    } else {
        None
    };
    drop(progress);
    match predict {
        Predict::Voltage(_) => write(a.output.as_deref(), talk, |out| {
            csv::predicted_voltage(out, r, command_v.as_deref(), &flags)
        })?,
        Predict::Force(_) => {
            let force =
                predict_force(&robot, &datasets[0], &parameters, r.offset_s, effects, when)?;
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
        at_work.remarks.iter().for_each(|r| talk.say(r));
    }
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
