//! `prove`: the diagnosis blind over cases with sealed answers, then scored.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::progress::Progress;
use super::resume::{Pieces, Run};
use super::{Failure, Talk, diagnose, load};
use super::{series, stop};
use crate::cases::line::{self, Rig};
use crate::cases::{Case, DriveSet, Spec, Truth, generate, generate_built, plan};
use crate::diagnosis::{self, Diagnosis, Entry};
use crate::proof::{
    StandsOut, Trial, compare, own_form, run as run_own, score, stands_out, trial, trial_lines,
};
use crate::recording::Kind;
use crate::report::json::to_text;
use crate::report::output::{OutputSet, Overwrite, settle};
use crate::report::proof::render_proof;

/// What to prove on.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder of cases: <case>/train/<recording>, <case>/holdout/<recording>, of a robot <case>/rig.toml
    /// (default: own cases are made)
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
    /// Drives of the own cases: what an experimenter ordinarily does, the program's own protocol, or three
    /// short recordings
    #[arg(long, value_name = "ordinary|protocol|short", default_value = "ordinary", value_parser = parse_drive, conflicts_with = "cases")]
    drive: DriveSet,
    /// Let effects act in the very form that the catalogue gives them: do the intervals hold what they
    /// promise?
    #[arg(long, conflicts_with_all = ["cases", "keep"])]
    own_form: bool,
    /// Own robots that are only nearly their drawings: parts, marker, axes and clocks off by up to usual
    /// workshop tolerances
    #[arg(long, conflicts_with_all = ["cases", "own_form"])]
    built: bool,
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

/// How a case of the robot is made.
type Make = fn(&Spec) -> Result<Case, String>;

/// The files of a case with their paths, and its answer's name and text.
type Files = (Vec<(String, Vec<u8>)>, String, String);

/// Writes cases with their answers apart.
fn keep<S>(
    specs: &[S],
    dir: &Path,
    overwrite: Overwrite,
    files: impl Fn(&S) -> Result<Files, String>,
) -> Result<(), Failure> {
    let mut cases = OutputSet::new(dir.join("cases"), overwrite)?;
    let mut answers = OutputSet::new(dir.join("answers"), overwrite)?;
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

/// The files of a proof.
const FILES: [&str; 3] = ["proof.json", "trials.json", "report.html"];
/// What is done so far, until they are there.
const PART: &str = "trials.part.jsonl";

/// The trials of a run, one by one: those that an earlier run wrote down, and the new ones.
struct Ledger<'a> {
    pieces: &'a Pieces,
    progress: &'a Progress,
    done: AtomicUsize,
    total: usize,
    /// What kept a trial from being written down.
    failed: Mutex<Option<Failure>>,
}

impl<'a> Ledger<'a> {
    fn new(pieces: &'a Pieces, progress: &'a Progress, total: usize) -> Self {
        Ledger {
            pieces,
            progress,
            done: AtomicUsize::new(0),
            total,
            failed: Mutex::new(None),
        }
    }

    /// Counts one more trial and says so.
    fn count(&self) {
        let n = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        self.progress.step(format!("{n} of {} cases", self.total));
        let path = self.pieces.path().display();
        stop::instead(format!(
            "{n} of {} cases are kept in {path}: the same command goes on from there",
            self.total
        ));
    }

    /// A trial that was made before.
    fn known(&self, name: impl ToString) -> Option<Trial> {
        let trial = self.pieces.get(&name.to_string())?;
        self.count();
        Some(trial)
    }

    /// Writes a trial down.
    fn add(&self, name: impl ToString, trial: &Trial) {
        let words = |list: &[String]| match list {
            [] => "nothing".to_owned(),
            list => list.join(" and "),
        };
        let (truth, named) = (words(&trial.truth), words(&trial.named));
        let says = match &trial.failure {
            Some(why) => why.clone(),
            None => format!("{}: {truth}; said {}: {named}", trial.case, trial.verdict),
        };
        if let Err(why) = self.pieces.add(&name.to_string(), says, trial) {
            self.failed
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .get_or_insert(why);
        }
        self.count();
    }

    /// Whether all trials could be written down.
    fn end(self) -> Result<(), Failure> {
        let failed = self.failed.into_inner();
        match failed.unwrap_or_else(PoisonError::into_inner) {
            Some(why) => Err(why),
            None => Ok(()),
        }
    }
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let progress = Progress::new(talk);
    OutputSet::check(&a.output, &FILES, talk.overwrite())?;
    settle(&a.output)?;
    let (trials, pieces) = match &a.cases {
        Some(cases) => {
            let list = cases_of(cases, a.answers.as_deref())?;
            let pieces = begin(a, "cases of a folder".into(), talk)?;
            let ledger = Ledger::new(&pieces, &progress, list.len());
            let trials = of_folder(&list, a.answers.as_deref(), &ledger)?;
            ledger.end()?;
            (trials, pieces)
        }
        None => of_plan(a, &progress, talk)?,
    };
    let proof = score(&trials);
    progress.step("writing");
    let mut set = OutputSet::new(&a.output, talk.overwrite())?;
    set.write("proof.json", to_text(&proof))?;
    set.write("trials.json", to_text(&trials))?;
    set.write("report.html", render_proof(&proof, &trials))?;
    set.commit()?;
    pieces.done()?;
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
    if let Some(gap) = proof.unknown_gap_closed_median.value {
        talk.say(&format!(
            "In no catalogue: learnt where it acts {}; {:.0} % of the gap to the noise closed on held-out recordings (median of {})",
            words(&proof.learnt_where_it_acts),
            100.0 * gap,
            proof.unknown_gap_closed_median.of,
        ));
    }
    for f in &proof.failures {
        talk.say(f);
    }
    talk.say(&format!(
        "Report: {}",
        a.output.join("report.html").display()
    ));
    Ok(())
}

/// What an earlier run of `of` wrote down, or the beginning of that.
fn begin(a: &Arguments, of: String, talk: Talk) -> Result<Pieces, Failure> {
    Pieces::open(&a.output.join(PART), &Run::new(of), talk.overwrite())
}

/// Leaves the cases in the folder of `--keep`, once in a run that is taken up again.
fn keep_once<S>(
    a: &Arguments,
    specs: &[S],
    pieces: &Pieces,
    progress: &Progress,
    talk: Talk,
    files: impl Fn(&S) -> Result<Files, String>,
) -> Result<(), Failure> {
    let Some(dir) = &a.keep else {
        return Ok(());
    };
    if pieces.get::<()>("kept").is_some() {
        return Ok(());
    }
    progress.step("writing the cases");
    keep(specs, dir, talk.overwrite(), files)?;
    pieces.add("kept", dir.display().to_string(), &())
}

/// Makes cases as they are planned, and tries them.
fn of_plan(
    a: &Arguments,
    progress: &Progress,
    talk: Talk,
) -> Result<(Vec<Trial>, Pieces), Failure> {
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
        let (make, form): (Make, &str) = match (a.own_form, a.built) {
            (true, _) => (own_form, ", own form"),
            (_, true) => (generate_built, ", as built"),
            _ => (generate, ""),
        };
        let of = format!("{} own cases of seed {}{form}: {specs:?}", a.number, a.seed);
        let pieces = begin(a, of, talk)?;
        keep_once(a, &specs, &pieces, progress, talk, |s| {
            let case = make(s)?;
            Ok((
                owned(case.files()),
                case.answer_file(),
                case.truth.to_json(),
            ))
        })?;
        let ledger = Ledger::new(&pieces, progress, specs.len());
        let trials = run_own(&specs, make, trial, &|i| ledger.known(i), &|i, t| {
            ledger.add(i, t)
        });
        ledger.end()?;
        return Ok((trials, pieces));
    }
    if a.own_form || a.built || a.drive != DriveSet::Ordinary || a.rigs.iter().any(|r| r == "robot")
    {
        return Err(
            "--own-form, --built, --drive and --rigs robot do not go with single coordinates: prove these apart"
                .into(),
        );
    }
    let mut specs = line::plan(&rigs, a.number, a.seed);
    specs.retain(|s| wanted(s.kind.name()));
    let of = format!("{} own cases of seed {}: {specs:?}", a.number, a.seed);
    let pieces = begin(a, of, talk)?;
    keep_once(a, &specs, &pieces, progress, talk, |s| {
        let case = line::generate(s)?;
        Ok((
            owned(case.files()),
            case.answer_file(),
            case.truth.to_json(),
        ))
    })?;
    let ledger = Ledger::new(&pieces, progress, specs.len());
    let trials = run_own(
        &specs,
        line::generate,
        trial_lines,
        &|i| ledger.known(i),
        &|i, t| ledger.add(i, t),
    );
    ledger.end()?;
    Ok((trials, pieces))
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

/// The cases of a folder. Each has an answer that can be read: that is looked at now, hours before it is
/// needed, and forgotten.
fn cases_of(cases: &Path, answers: Option<&Path>) -> Result<Vec<PathBuf>, Failure> {
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
    for case in &list {
        answer(case, answers)?;
    }
    Ok(list)
}

/// Name of a case: its folder's.
fn name_of(case: &Path) -> String {
    let name = case.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// The text of the answer to a case, and what it says.
fn answer(case: &Path, answers: Option<&Path>) -> Result<(String, Truth), Failure> {
    let name = name_of(case);
    let path = match answers {
        Some(dir) => dir.join(format!("{name}.json")),
        None => case.join("truth.json"),
    };
    let mut text = String::new();
    crate::recording::open(&path)
        .and_then(|mut file| file.read_to_string(&mut text))
        .map_err(|e| {
            format!(
                "{}: {e}: an answer is needed to score case {name}; give --answers",
                path.display()
            )
        })?;
    let truth = Truth::from_json(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok((text, truth))
}

/// The sum of all files of a case.
fn sum_of(folder: &Path, answer: &str) -> Result<String, Failure> {
    let mut all = answer.to_owned();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        let entries =
            std::fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let mut paths: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
        paths.sort();
        for path in paths {
            if path.is_dir() {
                open.push(path);
            } else {
                all += &format!("\n{} {}", path.display(), crate::recording::sha256(&path)?);
            }
        }
    }
    Ok(crate::recording::sha256_of(all.as_bytes())?)
}

/// Diagnoses each case blind, then opens its answer.
fn of_folder(
    list: &[PathBuf],
    answers: Option<&Path>,
    ledger: &Ledger,
) -> Result<Vec<Trial>, Failure> {
    list.par_iter()
        .map(|case| {
            let name = format!(
                "{} {}",
                name_of(case),
                sum_of(case, &answer(case, answers)?.0)?
            );
            if let Some(trial) = ledger.known(&name) {
                return Ok(trial);
            }
            let diagnosis = blind(case, ledger.progress).map_err(|e| e.to_string());
            let (_, truth) = answer(case, answers)?;
            let mut trial = compare(&truth, diagnosis);
            trial.stands_out = likeness(case, &truth, ledger.progress).unwrap_or_default();
            ledger.add(&name, &trial);
            Ok(trial)
        })
        .collect()
}

/// How the true effects of a robot's case stand out in its recordings.
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
    let recordings = load::recordings_of(&paths, None, &diagnose::KINDS, progress)?;
    let request = diagnosis::Request::default();
    if recordings
        .first()
        .is_some_and(|r| r.manifest.kind != Kind::Robot)
    {
        return Ok(diagnose::judge_lines(&recordings, train.len(), &request, progress)?.0);
    }
    let robot = load::robot(load::rig(&recordings)?, None)?;
    let datasets = load::datasets(&recordings, None, progress)?;
    let series = series::order(&recordings, &datasets)?;
    drop(recordings);
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
