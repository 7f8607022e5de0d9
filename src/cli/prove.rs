//! `prove`: the diagnosis blind over cases with sealed answers, then scored.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::progress::Progress;
use super::resume::{Pieces, Run, from_hex};
use super::shard::{Campaign, Part, Shard, short};
use super::{Failure, Talk, folders, load, series, stop};
use crate::cases::line::{self, Rig};
use crate::cases::{Case, DriveSet, Likeness, Spec, Truth, generate_on, plan};
use crate::diagnosis::{self, Diagnosis, Entry};
use crate::jobs::diagnose;
use crate::proof::{
    Proof, StandsOut, Trial, compare, own_form, run as run_own, score, stands_out, trial,
    trial_lines,
};
use crate::recording::Kind;
use crate::report::html::number;
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
    /// The same, of other sizes and softness too, some with a film of another law, captured at 50 to 240 Hz
    /// through filters, slow noise, spikes and coarse digits
    #[arg(long, conflicts_with_all = ["cases", "own_form", "built"])]
    realistic: bool,
    /// Kinds of the planned cases that are made: clean, single, pair, unknown (default: all)
    #[arg(long, value_name = "KIND,KIND", value_delimiter = ',', value_parser = ["clean", "single", "pair", "unknown"], conflicts_with = "cases")]
    kinds: Vec<String>,
    /// Folder to leave the own cases in: `cases/` and, apart from them, `answers/`
    #[arg(long, value_name = "DIR", conflicts_with = "cases")]
    keep: Option<PathBuf>,
    /// The i-th of n parts of the cases only; then `deacal merge DIR` (default: the task of a Slurm array)
    #[arg(long, value_name = "i/n", conflicts_with = "keep")]
    shard: Option<Shard>,
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
    /// Of these, those of an earlier run.
    kept: AtomicUsize,
    total: usize,
    /// What kept a trial from being written down.
    failed: Mutex<Option<Failure>>,
}

impl<'a> Ledger<'a> {
    fn new(pieces: &'a Pieces, progress: &'a Progress, total: usize) -> Self {
        progress.counted(format!("0 of {total} cases"), 0, 0, total);
        Ledger {
            pieces,
            progress,
            done: AtomicUsize::new(0),
            kept: AtomicUsize::new(0),
            total,
            failed: Mutex::new(None),
        }
    }

    /// Counts one more trial and says so.
    fn count(&self) {
        let n = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        let kept = self.kept.load(Ordering::Relaxed);
        let text = format!("{n} of {} cases", self.total);
        self.progress.counted(text, n, kept, self.total);
        let path = self.pieces.path().display();
        stop::instead(format!(
            "{n} of {} cases are kept in {path}: the same command goes on from there",
            self.total
        ));
    }

    /// A trial that was made before.
    fn known(&self, name: impl ToString) -> Option<Trial> {
        let trial = self.pieces.get(&name.to_string())?;
        self.kept.fetch_add(1, Ordering::Relaxed);
        self.count();
        Some(trial)
    }

    /// Writes a trial down.
    fn add(&self, name: impl ToString, trial: &Trial) {
        let words = |list: &[String]| match list {
            [] => "nothing".to_owned(),
            list => number::list(list),
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

/// Trials with the numbers of their cases.
type Numbered = Vec<(usize, Trial)>;

/// The cases that a run is to try, and where it writes: all of them, or those of a shard.
struct Share<'a> {
    a: &'a Arguments,
    shard: Option<Shard>,
    talk: Talk,
    progress: &'a Progress,
}

/// The file of a shard.
const SHARD: &str = "shard.json";

/// `shard.json`.
#[derive(Serialize, Deserialize)]
struct Tried {
    #[serde(flatten)]
    run: Run,
    shard: usize,
    of_shards: usize,
    trials: Vec<TriedCase>,
}

/// A trial with its bits.
#[derive(Serialize, Deserialize)]
struct TriedCase {
    number: usize,
    case: String,
    bytes: String,
}

/// The folder of a shard.
fn folder_of(shard: Shard) -> String {
    let width = shard.of.to_string().len();
    format!("shard-{:0width$}-of-{}", shard.number, shard.of)
}

impl Share<'_> {
    /// Folder of what this run writes.
    fn folder(&self) -> PathBuf {
        match self.shard {
            Some(shard) => self.a.output.join(folder_of(shard)),
            None => self.a.output.clone(),
        }
    }

    /// Of `count` cases, the numbers of those that are tried.
    fn numbers(&self, count: usize) -> Vec<usize> {
        let mine = |i: &usize| self.shard.is_none_or(|s| s.has(*i));
        (0..count).filter(mine).collect()
    }

    /// What an earlier run of `of` wrote down, or the beginning of that; `None` where the shard is there.
    fn begin(&self, of: String, count: usize) -> Result<Option<Pieces>, Failure> {
        let run = Run::new(of);
        if let Some(shard) = self.shard {
            let part = |number| Part {
                folder: folder_of(Shard { number, ..shard }),
                of: format!("{count} cases"),
            };
            let campaign = Campaign {
                campaign: "prove".into(),
                run: run.clone(),
                parts: (1..=shard.of).map(part).collect(),
            };
            campaign.claim(&self.a.output, true, self.talk.overwrite())?;
            if read_shard(&self.folder()).is_some_and(|t| t.run == run) {
                return Ok(None);
            }
        }
        let path = self.folder().join(PART);
        Pieces::open(&path, &run, self.talk.overwrite()).map(Some)
    }
}

/// A shard that is there.
fn read_shard(folder: &Path) -> Option<Tried> {
    settle(folder).ok()?;
    serde_json::from_str(&std::fs::read_to_string(folder.join(SHARD)).ok()?).ok()
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let progress = Progress::new(talk);
    let share = Share {
        a,
        shard: Shard::or_slurm(a.shard)?,
        talk,
        progress: &progress,
    };
    if share.shard.is_some() && a.keep.is_some() {
        return Err("--keep leaves the cases of a whole run: leave it out in a Slurm array".into());
    }
    match share.shard {
        None => OutputSet::check(&a.output, &FILES, talk.overwrite())?,
        Some(_) => OutputSet::check(&share.folder(), &[SHARD], talk.overwrite())?,
    }
    settle(&share.folder())?;
    let tried = match &a.cases {
        Some(cases) => of_folder(&cases_of(cases, a.answers.as_deref())?, &share)?,
        None => of_plan(&share)?,
    };
    let Some(shard) = share.shard else {
        let Some((trials, pieces)) = tried else {
            return Ok(());
        };
        let trials: Vec<Trial> = trials.into_iter().map(|t| t.1).collect();
        progress.step("writing");
        let proof = write(&a.output, &trials, talk)?;
        pieces.done()?;
        drop(progress);
        say(&a.output, &proof, talk);
        return Ok(());
    };
    let output = a.output.display();
    if let Some((trials, pieces)) = tried {
        let hex = |bytes: Vec<u8>| bytes.iter().map(|b| format!("{b:02x}")).collect();
        let trials = trials.into_iter().map(|(number, trial)| {
            Ok(TriedCase {
                number,
                case: trial.case.clone(),
                bytes: hex(postcard::to_allocvec(&trial)?),
            })
        });
        let tried = Tried {
            run: pieces.run().clone(),
            shard: shard.number,
            of_shards: shard.of,
            trials: trials.collect::<Result<_, Failure>>()?,
        };
        let mut set = OutputSet::new(share.folder(), talk.overwrite())?;
        set.write(SHARD, to_text(&tried))?;
        set.commit()?;
        pieces.done()?;
        drop(progress);
        talk.say(&format!(
            "{shard} is in {output}; when all are: deacal merge {output}"
        ));
    } else {
        drop(progress);
        talk.say(&format!("{shard} is in {output} already."));
    }
    Ok(())
}

/// All shards as one result.
pub(super) fn merge(dir: &Path, campaign: &Campaign, talk: Talk) -> Result<(), Failure> {
    OutputSet::check(dir, &FILES, talk.overwrite())?;
    let (mut missing, mut trials) = (Vec::new(), Numbered::new());
    for part in &campaign.parts {
        let folder = dir.join(&part.folder);
        let Some(tried) = read_shard(&folder) else {
            missing.push(part.folder.clone());
            continue;
        };
        if tried.run != campaign.run {
            return Err(format!(
                "{}: is of {} by {}, the campaign of {} by {}: run this shard again, or write elsewhere with -o",
                folder.join(SHARD).display(),
                short(&tried.run.of),
                tried.run.program,
                short(&campaign.run.of),
                campaign.run.program
            )
            .into());
        }
        for case in tried.trials {
            let bytes = from_hex(&case.bytes);
            let trial = bytes.and_then(|b| postcard::from_bytes(&b).ok());
            let trial = trial.ok_or_else(|| {
                let path = folder.join(SHARD);
                format!(
                    "{}: case {} cannot be read: delete the file and run its shard again",
                    path.display(),
                    case.case
                )
            })?;
            trials.push((case.number, trial));
        }
    }
    if !missing.is_empty() {
        let how = format!(
            "run `deacal prove --shard i/n` for them into {}",
            dir.display()
        );
        return Err(super::merge::missing(&missing, campaign.parts.len(), &how));
    }
    trials.sort_by_key(|t| t.0);
    let trials: Vec<Trial> = trials.into_iter().map(|t| t.1).collect();
    let proof = write(dir, &trials, talk)?;
    say(dir, &proof, talk);
    Ok(())
}

/// Scores the trials and writes the results, all or none.
fn write(output: &Path, trials: &[Trial], talk: Talk) -> Result<Proof, Failure> {
    let proof = score(trials);
    let mut set = OutputSet::new(output, talk.overwrite())?;
    set.write("proof.json", to_text(&proof))?;
    set.write("trials.json", to_text(&trials))?;
    set.write("report.html", render_proof(&proof, trials))?;
    set.commit()?;
    Ok(proof)
}

/// The first screen of the report, in the terminal.
fn say(output: &Path, proof: &Proof, talk: Talk) {
    talk.result(proof);
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
    talk.report(output);
}

/// Leaves the cases in the folder of `--keep`, once in a run that is taken up again.
fn keep_once<S>(
    specs: &[S],
    pieces: &Pieces,
    share: &Share,
    files: impl Fn(&S) -> Result<Files, String>,
) -> Result<(), Failure> {
    let Some(dir) = &share.a.keep else {
        return Ok(());
    };
    if pieces.get::<()>("kept").is_some() {
        return Ok(());
    }
    share.progress.step("writing the cases");
    keep(specs, dir, share.talk.overwrite(), files)?;
    pieces.add("kept", dir.display().to_string(), &())
}

/// Makes cases as they are planned, and tries those of the share; `None` where its shard is there.
fn of_plan(share: &Share) -> Result<Option<(Numbered, Pieces)>, Failure> {
    let a = share.a;
    let wanted = |kind: &str| a.kinds.is_empty() || a.kinds.iter().any(|k| k == kind);
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
        let (make, form): (Make, &str) = match (a.own_form, a.built, a.realistic) {
            (true, ..) => (own_form, ", own form"),
            (_, true, _) => (|s| generate_on(s, Likeness::Built), ", as built"),
            (.., true) => (|s| generate_on(s, Likeness::Real), ", realistic"),
            _ => (|s| generate_on(s, Likeness::Drawn), ""),
        };
        let of = format!("{} own cases of seed {}{form}: {specs:?}", a.number, a.seed);
        return try_all(share, specs, of, make, trial, |case| {
            (
                owned(case.files()),
                case.answer_file(),
                case.truth.to_json(),
            )
        });
    }
    if a.own_form
        || a.built
        || a.realistic
        || a.drive != DriveSet::Ordinary
        || a.rigs.iter().any(|r| r == "robot")
    {
        return Err(
            "--own-form, --built, --realistic, --drive and --rigs robot do not go with single coordinates: prove these apart"
                .into(),
        );
    }
    let mut specs = line::plan(&rigs, a.number, a.seed);
    specs.retain(|s| wanted(s.kind.name()));
    let of = format!("{} own cases of seed {}: {specs:?}", a.number, a.seed);
    try_all(share, specs, of, line::generate, trial_lines, |case| {
        (
            owned(case.files()),
            case.answer_file(),
            case.truth.to_json(),
        )
    })
}

/// Files with bytes of their own.
fn owned(files: Vec<(String, &[u8])>) -> Vec<(String, Vec<u8>)> {
    files.into_iter().map(|f| (f.0, f.1.to_vec())).collect()
}

/// Tries the cases of `specs` that are of the share.
fn try_all<S: Sync + Clone, C>(
    share: &Share,
    specs: Vec<S>,
    of: String,
    make: impl Fn(&S) -> Result<C, String> + Sync,
    attempt: impl Fn(&C) -> Trial + Sync,
    files: impl Fn(&C) -> Files,
) -> Result<Option<(Numbered, Pieces)>, Failure> {
    let Some(pieces) = share.begin(of, specs.len())? else {
        return Ok(None);
    };
    keep_once(&specs, &pieces, share, |s| Ok(files(&make(s)?)))?;
    let numbers = share.numbers(specs.len());
    let mine: Vec<S> = numbers.iter().map(|&i| specs[i].clone()).collect();
    let ledger = Ledger::new(&pieces, share.progress, mine.len());
    let known = |k: usize| ledger.known(numbers[k]);
    let trials = run_own(&mine, make, attempt, &known, &|k, t| {
        ledger.add(numbers[k], t)
    });
    ledger.end()?;
    let numbered = trials.into_iter().map(|(k, t)| (numbers[k], t));
    Ok(Some((numbered.collect(), pieces)))
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

/// Diagnoses each case of the share blind, then opens its answer; `None` where its shard is there.
fn of_folder(list: &[PathBuf], share: &Share) -> Result<Option<(Numbered, Pieces)>, Failure> {
    let answers = share.a.answers.as_deref();
    let mut of = "cases of a folder".to_owned();
    if share.shard.is_some() {
        // shards agree on what all cases are
        let sums = list
            .par_iter()
            .map(|case| sum_of(case, &answer(case, answers)?.0))
            .collect::<Result<Vec<_>, Failure>>()?;
        of += &format!(
            ", {}",
            crate::recording::sha256_of(sums.concat().as_bytes())?
        );
    }
    let Some(pieces) = share.begin(of, list.len())? else {
        return Ok(None);
    };
    let numbers = share.numbers(list.len());
    let ledger = Ledger::new(&pieces, share.progress, numbers.len());
    let trials = numbers
        .par_iter()
        .map(|&i| {
            let case = &list[i];
            let name = format!(
                "{} {}",
                name_of(case),
                sum_of(case, &answer(case, answers)?.0)?
            );
            if let Some(trial) = ledger.known(&name) {
                return Ok((i, trial));
            }
            let diagnosis = blind(case, share.progress).map_err(|e| e.to_string());
            let (_, truth) = answer(case, answers)?;
            let mut trial = compare(&truth, diagnosis);
            trial.stands_out = likeness(case, &truth, share.progress).unwrap_or_default();
            ledger.add(&name, &trial);
            Ok((i, trial))
        })
        .collect::<Result<Numbered, Failure>>()?;
    ledger.end()?;
    Ok(Some((trials, pieces)))
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
