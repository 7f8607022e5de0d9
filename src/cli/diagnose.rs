//! `diagnose`: is the model adequate, and if not, where, and what was left out.

use std::path::PathBuf;

use super::progress::Progress;
use super::resume::Lasting;
use super::{Failure, Talk, finding_line, load, say_findings};
use crate::diagnosis::{Diagnosis, Request, Tally, Verdict};
use crate::effects::plain_name;
use crate::jobs::diagnose::{KINDS, Search, diagnose, known_cause};
use crate::jobs::load::Given;
use crate::report::answer::{Answer, mistaken_for};
use crate::report::diagnosis_json::DiagnosisJson;
use crate::report::html::number;
use crate::report::output::OutputSet;
use crate::report::terminal;

/// What to diagnose.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// recording.toml files, or folders that have one, to fit
    #[arg(required = true, value_name = "REC")]
    recordings: Vec<PathBuf>,
    /// Recordings that are not fitted, to judge by (default: the last one or two of four or more)
    #[arg(long, num_args = 1.., value_name = "REC")]
    holdout: Vec<PathBuf>,
    /// Rig to use instead of the recordings' own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// plan.toml of an earlier run, to make the same choices again
    #[arg(long)]
    plan: Option<PathBuf>,
    /// Causes to consider, by id, separated by commas (default: all)
    #[arg(long, value_delimiter = ',', value_name = "ID,ID", value_parser = parse_id)]
    only: Vec<String>,
    /// Share of recordings without a cause in which one may be named all the same
    #[arg(long, default_value_t = 0.02, value_name = "RATE", value_parser = parse_rate)]
    false_alarms: f64,
    /// Error that a cause of a robot must take away to be named, and that what nothing explains must make to
    /// be called unexplained, V (default: a seventh of what the noise makes, all of it where parts that
    /// differ within their tolerances leave about as much; all of it)
    #[arg(long, value_name = "V", value_parser = parse_relevant)]
    relevant: Option<f64>,
    /// Builds the models of simpler methods too (forward selection, sparse regression), to hold the diagnosis
    /// against
    #[arg(long)]
    rivals: bool,
    /// Folder for the results
    #[arg(short, long, default_value = "out/diagnose")]
    output: PathBuf,
}

fn parse_id(text: &str) -> Result<String, String> {
    known_cause(text).map(|()| text.to_owned())
}

fn parse_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|r| (1e-6..=0.5).contains(r));
    rate.ok_or_else(|| "expected a share between 0.000001 and 0.5".into())
}

fn parse_relevant(text: &str) -> Result<f64, String> {
    let volts = text
        .parse()
        .ok()
        .filter(|v: &f64| *v >= 0.0 && v.is_finite());
    volts.ok_or_else(|| "expected a voltage not below 0".into())
}

/// The files of a diagnosis; a robot's has the next experiment, too.
const FILES: [&str; 4] = [
    "report.html",
    "parameters.toml",
    "diagnosis.json",
    "next_experiment.csv",
];

/// Diagnoses, and gives what `diagnosis.json` has.
pub(super) fn run(
    a: &Arguments,
    command: &str,
    talk: Talk,
    search: Search,
) -> Result<DiagnosisJson, Failure> {
    let progress = Progress::new(talk);
    let paths: Vec<PathBuf> = a.recordings.iter().chain(&a.holdout).cloned().collect();
    OutputSet::check(&a.output, &FILES, talk.overwrite())?;
    let all = load::recordings_of(&paths, a.rig.as_ref(), &KINDS, &progress)?;
    let given = Given::new(all, a.recordings.len(), command).look_over(&progress);
    say_findings(&given.findings, talk);
    let lasting = Lasting::new(&a.output, &given.provenance);
    let request = Request {
        false_alarm_rate: a.false_alarms,
        only: a.only.clone(),
        rivals: a.rivals,
        relevant: a.relevant,
        undated: false, // told by the recordings
        memory: lasting.memory(),
        tally: Tally::default(),
    };
    let plans = load::plans(a.plan.as_ref())?;
    let found = diagnose(given, &plans, request, &progress, search)?;
    found.files.stage(&a.output, talk.overwrite())?.commit()?;
    drop(progress);
    talk.result(&found.json);
    match &found.diagnosis {
        Some(diagnosis) => say(diagnosis, talk),
        None => {
            if let Some(finding) = &found.beyond {
                talk.say(&finding_line(finding));
            }
            talk.say(&found.says);
        }
    }
    talk.report(&a.output);
    lasting.done()?;
    Ok(found.json)
}

/// The first screen of the report, in the terminal: the answer, sizes, why, where, what else it could be.
fn say(d: &Diagnosis, talk: Talk) {
    let answer = Answer::of_diagnosis(d);
    talk.answer(&answer.says);
    terminal::facts(&answer.facts)
        .iter()
        .for_each(|l| talk.say(l));
    for c in d.candidates.iter().filter(|c| c.in_model) {
        let id = c.acting.effect.id();
        talk.tell(&format!(
            "Why {}: {}.",
            plain_name(id),
            c.says.trim_end_matches('.')
        ));
        let others = mistaken_for(d, id);
        if !others.is_empty() {
            talk.say(&format!("Could also be: {}.", others.join(", ")));
        }
    }
    if let Some(l) = &d.learnt {
        talk.tell(&format!("Learnt: {}", l.says));
    }
    let only_noise = d.verdict == Verdict::Adequate || d.beyond.is_some();
    if let Some(place) = d.places.first().filter(|_| !only_noise) {
        talk.tell(&format!("Where: {}.", place.says.trim_end_matches('.')));
    }
    for r in &d.rival_models {
        let error = r.holdout.unwrap_or(r.train).after_v;
        let names: Vec<String> = r.effects.iter().map(|e| plain_name(e)).collect();
        talk.say(&format!(
            "{}: {} with {}.",
            r.method,
            number::sized(error, &d.unit, 3),
            match names.is_empty() {
                true => "nothing".to_owned(),
                false => names.join(", "),
            }
        ));
    }
    if !d.next_experiment.is_empty() {
        talk.tell(&format!("Record next: {}", d.next_experiment));
    }
    d.remarks.iter().for_each(|r| talk.tell(r));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_cause_is_answered_with_the_nearest() {
        let text = parse_id("series_resistence").unwrap_err();
        assert!(
            text.contains("series_resistance") && text.contains("frame_tilt"),
            "{text}"
        );
    }
}
