//! `validate`: parameter files against recordings.

use std::path::PathBuf;

use super::progress::Progress;
use super::{Failure, Talk, load, say_findings};
use crate::jobs::load::Given;
use crate::jobs::validate::{self as job, Candidate, Held, Request};
use crate::report::output::OutputSet;

/// What to hold against what.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// recording.toml files, or folders that have one
    #[arg(required = true, value_name = "REC")]
    recordings: Vec<PathBuf>,
    /// Parameter file; several are compared
    #[arg(long, required = true)]
    params: Vec<PathBuf>,
    /// Rig to use instead of the recordings' own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// plan.toml of an earlier run, to make the same choices again
    #[arg(long)]
    plan: Option<PathBuf>,
    /// Planned path of the recording (CSV: time_s, x_mm, y_mm, z_mm on the motion clock): the measured path
    /// is held against it instead of against the forward dynamics
    #[arg(long, value_name = "FILE")]
    path: Option<PathBuf>,
    /// In the report, beside what the paper reports of its own robot
    #[arg(long, value_name = "WITH", value_parser = ["paper"])]
    compare: Option<String>,
    /// Folder for the results
    #[arg(short, long, default_value = "out/validate")]
    output: PathBuf,
}

const FILES: [&str; 2] = ["validation.json", "report.html"];

pub(super) fn run(a: &Arguments, command: &str, talk: Talk) -> Result<(), Failure> {
    let progress = Progress::new(talk);
    OutputSet::check(&a.output, &FILES, talk.overwrite())?;
    let recordings = load::recordings_of(&a.recordings, a.rig.as_ref(), &job::KINDS, &progress)?;
    let given = Given::new(recordings, 0, command);
    given.copies.iter().for_each(|remark| talk.say(remark));
    let given = given.look_over(&progress);
    say_findings(&given.findings, talk);
    let candidates = a.params.iter().map(|path| Candidate::read(path));
    let candidates = candidates.collect::<Result<Vec<_>, _>>()?;
    let request = Request {
        plans: load::plans(a.plan.as_ref())?,
        path: a.path.as_deref().map(load::path).transpose()?,
        paper: a.compare.is_some(),
    };
    let found = job::validate(given, &candidates, &request, &progress)?;
    tell(&found.held, talk);
    let set = found.files.stage(&a.output, talk.overwrite())?;
    set.commit()?;
    drop(progress);
    talk.result(&found.json);
    talk.report(&a.output);
    Ok(())
}

/// The answers of all models, then what there is to say of each.
fn tell(all: &[Held], talk: Talk) {
    for held in all {
        talk.answer(&format!("{}: {}", held.name, held.answer.says));
    }
    for held in all {
        if all.len() > 1 {
            talk.say(&format!("With {}", held.name));
        }
        held.lines.iter().for_each(|line| talk.tell(line));
    }
}
