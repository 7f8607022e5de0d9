//! `prove`: the diagnosis blind over cases with sealed answers, then scored.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::progress::Progress;
use super::series;
use super::{Failure, Talk, diagnose, load};
use crate::cases::line::{self, Rig};
use crate::cases::{DriveSet, Truth, generate, plan};
use crate::diagnosis::{self, Diagnosis, Entry};
use crate::proof::{
    StandsOut, Trial, compare, own_form, run as run_own, score, stands_out, trial, trial_lines,
};
use crate::recording::Kind;
use crate::report::json::to_text;
use crate::report::output::OutputSet;
use crate::report::proof::render_proof;

/// What to prove on.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder of cases: <case>/rig.toml, <case>/train/<recording>, <case>/holdout/<recording> (default: own cases are made)
    #[arg(long, value_name = "DIR")]
    cases: Option<PathBuf>,
    /// Folder of answers: <case>.json (default: <case>/truth.json)
    #[arg(long, value_name = "DIR", requires = "cases")]
    answers: Option<PathBuf>,
    /// What the own cases are recordings of: the robot; or single coordinates, `line`: axis, bench and coupon
    #[arg(long, value_name = "RIG,RIG", value_delimiter = ',', default_value = "robot", value_parser = ["robot", "line", "axis", "bench", "coupon"], conflicts_with = "cases")]
    rigs: Vec<String>,
    /// Number of own cases
    #[arg(long, default_value_t = 60, conflicts_with = "cases")]
    number: usize,
    /// Seed of the own cases
    #[arg(long, default_value_t = 1, conflicts_with = "cases")]
    seed: u64,
    /// Drives of the own cases: what an experimenter ordinarily does, the program's own protocol, or three short recordings
    #[arg(long, value_name = "ordinary|protocol|short", default_value = "ordinary", value_parser = parse_drive, conflicts_with = "cases")]
    drive: DriveSet,
    /// Let effects act in the very form that the catalogue gives them: do the intervals hold what they promise?
    #[arg(long, conflicts_with_all = ["cases", "keep"])]
    own_form: bool,
    /// Kinds of the planned cases that are made: clean, single, pair, unknown (default: all)
    #[arg(long, value_name = "KIND,KIND", value_delimiter = ',', value_parser = ["clean", "single", "pair", "unknown"], conflicts_with = "cases")]
    kinds: Vec<String>,
    /// Folder to leave the own cases in: `cases/` and, apart from them, `answers/`
    #[arg(long, value_name = "DIR", conflicts_with = "cases")]
    keep: Option<PathBuf>,
    /// Folder for the results
    #[arg(short, long, default_value = "out/prove")]
    output: PathBuf,
}

/// The files of a case with their paths, and its answer's name and text.
type Files = (Vec<(String, Vec<u8>)>, String, String);

/// Writes cases with their answers apart.
fn keep<S>(
    specs: &[S],
    dir: &Path,
    files: impl Fn(&S) -> Result<Files, String>,
) -> Result<(), Failure> {
    let mut cases = OutputSet::new(dir.join("cases"))?;
    let mut answers = OutputSet::new(dir.join("answers"))?;
    for spec in specs {
        let (case, answer, truth) = files(spec)?;
        for (name, bytes) in case {
            cases.write(&name, bytes)?;
        }
        answers.write(&answer, truth)?;
    }
    cases.commit()?;
    answers.commit()?;
    Ok(())
}

fn parse_drive(text: &str) -> Result<DriveSet, String> {
    match text {
        "ordinary" => Ok(DriveSet::Ordinary),
        "protocol" => Ok(DriveSet::Protocol),
        "short" => Ok(DriveSet::Short),
        _ => Err("expected `ordinary`, `protocol` or `short`".into()),
    }
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let progress = Progress::new(talk);
    let trials = match &a.cases {
        Some(cases) => of_folder(cases, a.answers.as_deref(), &progress)?,
        None => of_plan(a, &progress)?,
    };
    let proof = score(&trials);
    progress.step("writing");
    let mut set = OutputSet::new(&a.output)?;
    set.write("proof.json", to_text(&proof))?;
    set.write("trials.json", to_text(&trials))?;
    set.write("report.html", render_proof(&proof, &trials))?;
    set.commit()?;
    drop(progress);
    talk.result(&proof);
    let words = |c: &crate::proof::Count| format!("{} of {}", c.hits, c.of);
    talk.say(&format!(
        "{} cases: right effect first {} (visible), {} (below 1.5 times the floor); false alarms {}; unknown called unexplained {}; both of a pair {}",
        proof.n_cases,
        words(&proof.top1_detectable),
        words(&proof.top1_hidden),
        words(&proof.false_alarm_rate),
        words(&proof.unknown_called_unexplained),
        words(&proof.pairs_both_named),
    ));
    talk.say(&format!(
        "Right first or in the stated group {} (visible); a wrong name above 80 % {}; exact sets {}; calibration error of each name {:.3}",
        words(&proof.stated_group_detectable),
        words(&proof.wrong_above_80),
        words(&proof.exact_sets),
        proof.calibration_error_each,
    ));
    for f in &proof.failures {
        talk.say(f);
    }
    talk.say(&format!(
        "Report: {}",
        a.output.join("report.html").display()
    ));
    Ok(())
}

/// Tells how many cases are done.
fn counted(total: usize, progress: &Progress) -> impl Fn(&Trial) + Sync + '_ {
    let done = AtomicUsize::new(0);
    move |_| {
        let n = 1 + done.fetch_add(1, Ordering::Relaxed);
        progress.step(format!("{n} of {total} cases"));
        progress.leave_if_stopped();
    }
}

/// Makes cases as they are planned, and tries them.
fn of_plan(a: &Arguments, progress: &Progress) -> Result<Vec<Trial>, Failure> {
    let wanted = |kind: &str| a.kinds.is_empty() || a.kinds.iter().any(|k| k == kind);
    let owned = |files: Vec<(String, &[u8])>| -> Vec<(String, Vec<u8>)> {
        files.into_iter().map(|f| (f.0, f.1.to_vec())).collect()
    };
    let rigs: Vec<Rig> = Rig::ALL
        .into_iter()
        .filter(|r| a.rigs.iter().any(|w| w == "line" || w == r.name()))
        .collect();
    if rigs.is_empty() {
        let mut specs = plan(a.number, a.seed);
        specs.retain(|s| wanted(s.kind.name()));
        for spec in &mut specs {
            spec.drive = a.drive;
        }
        if let Some(dir) = &a.keep {
            progress.step("writing the cases");
            keep(&specs, dir, |s| {
                let case = generate(s)?;
                Ok((
                    owned(case.files()),
                    case.answer_file(),
                    case.truth.to_json(),
                ))
            })?;
        }
        let make = if a.own_form { own_form } else { generate };
        return Ok(run_own(
            &specs,
            make,
            trial,
            &counted(specs.len(), progress),
        ));
    }
    if a.own_form || a.drive != DriveSet::Ordinary || a.rigs.iter().any(|r| r == "robot") {
        return Err(
            "--own-form, --drive and --rigs robot do not go with single coordinates: prove these apart"
                .into(),
        );
    }
    let mut specs = line::plan(&rigs, a.number, a.seed);
    specs.retain(|s| wanted(s.kind.name()));
    if let Some(dir) = &a.keep {
        progress.step("writing the cases");
        keep(&specs, dir, |s| {
            let case = line::generate(s)?;
            Ok((
                owned(case.files()),
                case.answer_file(),
                case.truth.to_json(),
            ))
        })?;
    }
    let watch = counted(specs.len(), progress);
    Ok(run_own(&specs, line::generate, trial_lines, &watch))
}

/// Folders in a folder, by name.
fn folders(dir: &Path) -> Result<Vec<PathBuf>, Failure> {
    let list = std::fs::read_dir(dir).map_err(|e| format!("{}: {e}", dir.display()))?;
    let mut out: Vec<PathBuf> = list
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| p.is_dir())
        .collect();
    out.sort();
    Ok(out)
}

fn of_folder(
    cases: &Path,
    answers: Option<&Path>,
    progress: &Progress,
) -> Result<Vec<Trial>, Failure> {
    let list: Vec<PathBuf> = folders(cases)?
        .into_iter()
        .filter(|c| c.join("train").is_dir())
        .collect();
    if list.is_empty() {
        return Err(format!(
            "{}: no case in it: a case is a folder with rig.toml and train/<recording>/recording.toml",
            cases.display()
        )
        .into());
    }
    // All cases first, without a look at any answer.
    let done = AtomicUsize::new(0);
    let found: Vec<(Result<Diagnosis, String>, f64)> = list
        .par_iter()
        .map(|case| {
            let begin = std::time::Instant::now();
            let diagnosis = blind(case, progress).map_err(|e| e.to_string());
            let n = 1 + done.fetch_add(1, Ordering::Relaxed);
            progress.step(format!("{n} of {} cases", list.len()));
            (diagnosis, begin.elapsed().as_secs_f64())
        })
        .collect();
    list.iter()
        .zip(found)
        .map(|(case, (diagnosis, seconds))| {
            let name = case
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            let path = match answers {
                Some(dir) => dir.join(format!("{name}.json")),
                None => case.join("truth.json"),
            };
            let text = std::fs::read_to_string(&path).map_err(|e| {
                format!(
                    "{}: {e}: an answer is needed to score case {name}; give --answers",
                    path.display()
                )
            })?;
            let truth = Truth::from_json(&text).map_err(|e| format!("{}: {e}", path.display()))?;
            let mut trial = compare(&truth, diagnosis, seconds);
            trial.stands_out = likeness(case, &truth, progress).unwrap_or_default();
            Ok(trial)
        })
        .collect()
}

/// How the true effects of a case stand out in its recordings.
fn likeness(case: &Path, truth: &Truth, progress: &Progress) -> Result<Vec<StandsOut>, Failure> {
    let recordings = load::recordings(&folders(&case.join("train"))?, None, Kind::Robot, progress)?;
    let robot = load::robot(load::rig(&recordings)?, None)?;
    let datasets = load::datasets(&recordings, None, progress)?;
    let series = series::order(&recordings, &datasets)?;
    let entries: Vec<Entry> = datasets
        .iter()
        .zip(&series.entries)
        .map(|(dataset, entry)| Entry {
            dataset,
            when: series::when(entry, dataset.start_s),
        })
        .collect();
    Ok(stands_out(truth, &robot, &entries))
}

/// Diagnoses a case from its recordings alone.
fn blind(case: &Path, progress: &Progress) -> Result<Diagnosis, Failure> {
    let train = folders(&case.join("train"))?;
    let mut paths = train.clone();
    if case.join("holdout").is_dir() {
        paths.extend(folders(&case.join("holdout"))?);
    }
    let recordings = load::recordings(&paths, None, Kind::Robot, progress)?;
    let robot = load::robot(load::rig(&recordings)?, None)?;
    let datasets = load::datasets(&recordings, None, progress)?;
    let series = series::order(&recordings, &datasets)?;
    drop(recordings);
    let request = diagnosis::Request::default();
    let found = diagnose::judge(
        &robot,
        &datasets,
        train.len(),
        series,
        &request,
        progress,
        diagnosis::diagnose,
    )?;
    Ok(found.0)
}
