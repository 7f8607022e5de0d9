//! `predict voltage|force|motion`.

use std::io::{IsTerminal as _, Write};
use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::{Failure, Talk, Unsaid, load};
use crate::jobs::predict::{Prediction, What, predict};
use crate::report::html::number;
use crate::report::json::PredictionJson;
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
    /// File to write; left out, the table goes to standard output, and with --json it is in the result.
    /// Voltages as .mcap, .mat (MATLAB) or .npz (NumPy) come with the aligned recording and the residual
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
        load::ending(
            path,
            "the prediction",
            what.formats(recording.manifest.kind),
        )?;
    }
    let file = load::parameters(&a.params)?;
    let plans = load::plans(a.plan.as_ref())?;
    let found = predict(what, recording, &file, &plans, a.begin, command, &progress)?;
    drop(progress);
    match &a.output {
        Some(path) => found.save(path, a.full, talk.overwrite())?,
        None if talk.json => {}
        None => {
            let mut out = std::io::BufWriter::new(std::io::stdout().lock());
            found
                .csv(&mut out)
                .and_then(|()| out.flush())
                .map_err(Unsaid::failure)?;
        }
    }
    let json = PredictionJson::new(&found.id, a.output.as_deref(), &found.flags);
    let json = match a.output {
        Some(_) => json,
        None => json.with_columns(&found.columns()),
    };
    talk.result(&json.with_remarks(&found.remarks));
    match &a.output {
        Some(path) => {
            if !found.says.is_empty() {
                talk.answer(&found.says);
            }
            say_courses(&found, talk);
            talk.say(&format!("Written to {}", path.display()));
        }
        None if std::io::stdout().is_terminal() => {
            let mut says = vec![number::words(&found.says)];
            says.retain(|s| !s.is_empty());
            says.push("-o FILE writes this table to a file".into());
            remark(a, talk, &says);
        }
        None => {}
    }
    remark(a, talk, &found.remarks);
    Ok(())
}

/// Share of the largest value below which one is rounding.
const ROUNDING: f64 = 1e-9;

/// What was predicted, one line a channel: its range and its course.
fn say_courses(found: &Prediction, talk: Talk) {
    let sizes = found.courses.iter().flat_map(|(_, values)| values);
    let largest = sizes.fold(0.0_f64, |m, v| m.max(v.abs()));
    let row = |(name, values): &(String, Vec<f64>)| {
        // what only rounding makes is nothing
        let nothing = |v: &f64| v.abs() < ROUNDING * largest;
        let values: Vec<f64> = values
            .iter()
            .map(|v| if nothing(v) { 0.0 } else { *v })
            .collect();
        let range = terminal::range(values.iter().copied(), found.unit);
        [
            name.clone(),
            range,
            terminal::curve(&values, terminal::WIDTH),
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
