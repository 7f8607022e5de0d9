//! `batch`: many recording sets, each fitted (and diagnosed) into a folder of its own, and what they show
//! together.

use std::collections::HashMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use clap::Parser;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::progress::Progress;
use super::resume::Run;
use super::shard::{CAMPAIGN, Campaign, Part, Shard};
use super::{Cli, Command, Failure, Talk, diagnose, fit, folders, load, merge, stop};
use crate::recording::keys::{BATCH, Document};
use crate::recording::{DAY, Manifest, sha256, sha256_of};
use crate::report::batch::{BatchJson, SetDiagnosis, SetJson};
use crate::report::json::to_text;
use crate::report::library::is_of_library;
use crate::report::output::{OutputSet, settle};
use crate::report::provenance::{FileSum, Provenance};

/// What to fit.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// PLAN.toml with a [[set]] for each recording set, or a folder: each folder in it is a set of the
    /// recordings in it (or in its `train`, with `holdout` beside)
    #[arg(value_name = "PLAN|DIR")]
    plan: PathBuf,
    /// The i-th of n parts of the sets only; then `deacal merge DIR` (default: the task of a Slurm array)
    #[arg(long, value_name = "i/n")]
    shard: Option<Shard>,
    /// Diagnoses each set, too (a plan says so for each of its own)
    #[arg(long)]
    diagnose: bool,
    /// Folder for the results: a folder a set, batch.json, report.html
    #[arg(short, long, default_value = "out/batch")]
    output: PathBuf,
}

/// A plan.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    /// Of all sets that do not say it.
    #[serde(default)]
    fit: Option<String>,
    #[serde(default)]
    diagnose: Option<Diagnose>,
    set: Vec<SetFile>,
}

/// A set of a plan.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SetFile {
    name: String,
    recordings: Vec<PathBuf>,
    #[serde(default)]
    holdout: Vec<PathBuf>,
    /// Which fit, with its options: `film --branches 4`.
    #[serde(default)]
    fit: Option<String>,
    #[serde(default)]
    diagnose: Option<Diagnose>,
    #[serde(default)]
    params: Option<PathBuf>,
    #[serde(default)]
    rig: Option<PathBuf>,
    #[serde(default)]
    batch: Option<String>,
    #[serde(default, deserialize_with = "day")]
    day: Option<f64>,
}

/// A day, as a manifest may have it.
fn day<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    let day = f64::deserialize(from)?;
    let [first, last] = DAY;
    if (first..=last).contains(&day) {
        return Ok(Some(day));
    }
    let says = format!("found day = {day}, expected a number from {first} to {last}");
    Err(serde::de::Error::custom(says))
}

/// Whether to diagnose, or with which options.
#[derive(Clone, Deserialize)]
#[serde(untagged)]
enum Diagnose {
    Whether(bool),
    With(String),
}

/// A recording set and what is done with it.
struct Set {
    name: String,
    /// Words of the command lines that are run for it, without -o.
    fit: Vec<String>,
    diagnose: Option<Vec<String>>,
    batch: Option<String>,
    day: Option<f64>,
    /// Manifests, rig and parameters.
    stated: Vec<PathBuf>,
}

/// The file that ends a set.
const SET: &str = "set.json";
const FILES: [&str; 2] = ["batch.json", "report.html"];

/// `set.json`.
#[derive(Serialize, Deserialize)]
struct Done {
    #[serde(flatten)]
    run: Run,
    /// Every file that it rests on.
    files: Vec<FileSum>,
    set: SetJson,
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let shard = Shard::or_slurm(a.shard)?;
    let progress = Progress::new(talk);
    OutputSet::check(&a.output, &FILES, talk.overwrite())?;
    progress.step("looking at the sets");
    let sets = sets(a)?;
    let parts: Vec<Part> = sets
        .par_iter()
        .map(|s| {
            Ok(Part {
                folder: s.name.clone(),
                of: s.of()?,
            })
        })
        .collect::<Result<_, Failure>>()?;
    let run = Run::new(format!("sets of {}", a.plan.display()));
    let campaign = Campaign {
        campaign: "batch".into(),
        run,
        parts,
    };
    campaign.claim(&a.output, shard.is_some(), talk.overwrite())?;
    let mine: Vec<usize> = (0..sets.len())
        .filter(|&i| shard.is_none_or(|s| s.has(i)))
        .collect();
    let count = AtomicUsize::new(0);
    let there = AtomicUsize::new(0);
    progress.counted(format!("0 of {} sets", mine.len()), 0, 0, mine.len());
    mine.par_iter().with_max_len(1).try_for_each(|&i| {
        let run = Run {
            program: campaign.run.program.clone(),
            of: campaign.parts[i].of.clone(),
        };
        let folder = a.output.join(&sets[i].name);
        if done(&folder, &run) {
            there.fetch_add(1, Ordering::Relaxed);
        } else {
            sets[i].work(&folder, run, talk)?;
        }
        let n = 1 + count.fetch_add(1, Ordering::Relaxed);
        let kept = there.load(Ordering::Relaxed);
        progress.counted(format!("{n} of {} sets", mine.len()), n, kept, mine.len());
        stop::instead(format!(
            "{n} of {} sets are done in {}: the same command goes on from there",
            mine.len(),
            a.output.display()
        ));
        Ok::<_, Failure>(())
    })?;
    drop(progress);
    let there = there.into_inner();
    if there > 0 {
        talk.say(&format!("{there} sets were there already."));
    }
    match shard {
        None => merge(&a.output, &campaign, talk),
        Some(shard) => {
            talk.say(&format!(
                "{shard}: {} of {} sets are in {}; when all shards are done: deacal merge {}",
                mine.len(),
                sets.len(),
                a.output.display(),
                a.output.display()
            ));
            Ok(())
        }
    }
}

/// All sets as one result.
pub(super) fn merge(dir: &Path, campaign: &Campaign, talk: Talk) -> Result<(), Failure> {
    OutputSet::check(dir, &FILES, talk.overwrite())?;
    let read: Vec<Option<Done>> = campaign
        .parts
        .par_iter()
        .map(|part| read(&dir.join(&part.folder)))
        .collect();
    let mut missing = Vec::new();
    let mut sets = Vec::new();
    let mut sums: HashMap<String, (String, String)> = HashMap::new();
    for (part, done) in campaign.parts.iter().zip(read) {
        let Some(done) = done else {
            missing.push(part.folder.clone());
            continue;
        };
        let place = dir.join(&part.folder);
        let mixed = |what: String| -> Failure {
            format!("{}: {what}; run its shard again", place.join(SET).display()).into()
        };
        if done.run.program != campaign.run.program {
            let (own, all) = (&done.run.program, &campaign.run.program);
            return Err(mixed(format!("is by {own}, the others by {all}")));
        }
        if done.run.of != part.of {
            let (own, planned) = (&done.run.of, &part.of);
            return Err(mixed(format!("is of `{own}`, planned was `{planned}`")));
        }
        for file in &done.files {
            match sums.get(&file.file) {
                Some((sum, other)) if *sum != file.sha256 => {
                    let name = &file.file;
                    return Err(mixed(format!("{name} was another file for {other}")));
                }
                Some(_) => {}
                None => {
                    let own = (file.sha256.clone(), part.folder.clone());
                    sums.insert(file.file.clone(), own);
                }
            }
        }
        sets.push(done.set);
    }
    if !missing.is_empty() {
        let how = format!(
            "run their shards, or the same `deacal batch` without --shard, into {}",
            dir.display()
        );
        return Err(merge::missing(&missing, campaign.parts.len(), &how));
    }
    let changed: Vec<&String> = sums
        .par_iter()
        .filter(|(file, (sum, _))| {
            let path = Path::new(file);
            path.exists() && sha256(path).is_ok_and(|now| now != *sum)
        })
        .map(|(file, _)| file)
        .collect();
    if let Some(file) = changed.iter().min() {
        return Err(format!(
            "{file} was changed since set {} was fitted: run its shard again, or the same `deacal batch`",
            sums[*file].1
        )
        .into());
    }
    let (json, report) = BatchJson::with_report(sets);
    let mut out = OutputSet::new(dir, talk.overwrite())?;
    out.write("batch.json", to_text(&json))?;
    out.write("report.html", report)?;
    out.commit()?;
    talk.result(&json);
    for line in json
        .says
        .iter()
        .chain(json.outliers.iter().map(|o| &o.says))
    {
        talk.tell(line);
    }
    for s in &json.sets {
        if let Some(why) = &s.failure {
            talk.say(&format!("{}: {why}", s.name));
        }
    }
    talk.report(dir);
    Ok(())
}

/// What a set came to, where it is there.
fn read(folder: &Path) -> Option<Done> {
    settle(folder).ok()?;
    serde_json::from_str(&std::fs::read_to_string(folder.join(SET)).ok()?).ok()
}

/// Whether a set is there, of the same program and the same files. One that failed is tried again.
fn done(folder: &Path, run: &Run) -> bool {
    let Some(done) = read(folder) else {
        return false;
    };
    let same = |f: &FileSum| sha256(Path::new(&f.file)).is_ok_and(|sum| sum == f.sha256);
    done.run == *run
        && done.set.failure.is_none()
        && ["fit.json", "parameters.toml", "report.html"]
            .iter()
            .all(|name| folder.join(name).is_file())
        && done.files.iter().all(same)
}

impl Set {
    /// What it is of: what is run, on what is stated.
    fn of(&self) -> Result<String, Failure> {
        let mut sums = String::new();
        for path in &self.stated {
            sums += &sha256(path)?;
        }
        let mut text = self.fit.join(" ");
        if let Some(words) = &self.diagnose {
            text += &format!("; {}", words.join(" "));
        }
        if let Some(batch) = &self.batch {
            text += &format!("; batch {batch}");
        }
        if let Some(day) = self.day {
            text += &format!("; day {day}");
        }
        Ok(format!("{text}; stated {}", sha256_of(sums.as_bytes())?))
    }

    /// The command line `words` with its folder, as it is parsed.
    fn parse(words: &[String], folder: &Path) -> Result<Cli, Failure> {
        let folder = folder.as_os_str().to_owned();
        let words = words
            .iter()
            .map(OsString::from)
            .chain(["-o".into(), folder]);
        Cli::try_parse_from(words).map_err(|e| {
            let text = e.to_string();
            text.lines().next().unwrap_or_default().to_owned().into()
        })
    }

    /// Fits and diagnoses it into its folder. What cannot be done is said in its `set.json`.
    fn work(&self, folder: &Path, run: Run, talk: Talk) -> Result<(), Failure> {
        let quiet = Talk {
            json: false,
            quiet: true,
            ..talk
        };
        let mut files = Vec::new();
        let mut set = SetJson::new(&self.name, self.batch.clone(), self.day, &self.fit[2]);
        let fitted = Self::parse(&self.fit, folder).and_then(|cli| match cli.command {
            Command::Fit(f) => fit::complete(&f, &self.fit.join(" "), quiet),
            _ => Err("is no fit".into()),
        });
        let fitted = match fitted {
            Ok(complete) => {
                add(&mut files, &complete.fit.provenance);
                set = set.with_fit(&complete.fit);
                Some(complete)
            }
            Err(why) => {
                set.failure = Some(why.to_string());
                None
            }
        };
        if let (Some(words), None) = (&self.diagnose, &set.failure) {
            let into = folder.join("diagnosis");
            let found = Self::parse(words, &into).and_then(|cli| match cli.command {
                Command::Diagnose(d) => {
                    let search = crate::diagnosis::diagnose;
                    diagnose::run(&d, &words.join(" "), quiet, search)
                }
                _ => Err("is no diagnosis".into()),
            });
            set.diagnosis = Some(match found {
                Ok(found) => {
                    add(&mut files, &found.provenance);
                    SetDiagnosis::of(&found)
                }
                Err(why) => SetDiagnosis::failed(why.to_string()),
            });
        }
        let done = to_text(&Done { run, files, set });
        let Some(mut fitted) = fitted else {
            let mut out = OutputSet::new(folder, talk.overwrite())?;
            out.write(SET, done)?;
            out.commit()?;
            return Ok(());
        };
        fitted.files.write(SET, done)?;
        fitted.in_place(quiet)
    }
}

/// Adds the files that a result rests on.
fn add(files: &mut Vec<FileSum>, provenance: &Provenance) {
    let recordings = provenance.recordings.iter().flat_map(|r| &r.files);
    for file in provenance.rig.iter().chain(recordings) {
        if !files.contains(file) {
            files.push(file.clone());
        }
    }
}

/// The manifest of a recording.
fn manifest(recording: &Path) -> Result<(PathBuf, Manifest), Failure> {
    let path = match recording.is_dir() {
        true => recording.join("recording.toml"),
        false => recording.to_owned(),
    };
    let manifest = Manifest::read(&path)?;
    Ok((path, manifest))
}

/// Where a file stops being a plan, in one line.
fn not_a_plan(path: &Path, text: &str, error: &toml::de::Error) -> String {
    let before = error.span().and_then(|s| text.get(..s.start)).unwrap_or("");
    let line = before.matches('\n').count() + 1;
    let why = error.message().replace('\n', ", ");
    format!(
        "{}, line {line}: {why}; correct the plan, or name a folder of recordings",
        path.display()
    )
}

/// The sets of a plan or a folder, by name.
fn sets(a: &Arguments) -> Result<Vec<Set>, Failure> {
    let (dir, plan) = match a.plan.is_dir() {
        true => (Path::new(""), of_folder(a)?),
        false => {
            let document = Document::read(&a.plan, &BATCH)?;
            document.parse()?;
            let text = document.text;
            let plan = toml::from_str(&text).map_err(|e| not_a_plan(&a.plan, &text, &e))?;
            (a.plan.parent().unwrap_or(Path::new("")), plan)
        }
    };
    let mut sets = plan
        .set
        .iter()
        .map(|s| set(s, &plan, dir, a.diagnose))
        .collect::<Result<Vec<_>, _>>()?;
    sets.sort_by(|a, b| a.name.cmp(&b.name));
    let at = a.plan.display();
    if let Some(pair) = sets.windows(2).find(|p| p[0].name == p[1].name) {
        let name = &pair[0].name;
        return Err(format!("{at}: two sets are called `{name}`: give each its own name").into());
    }
    if sets.is_empty() {
        return Err(format!(
            "{at}: there is no recording set in it: give each a [[set]], or a folder"
        )
        .into());
    }
    Ok(sets)
}

/// A folder as a plan: each folder in it with its recordings.
fn of_folder(a: &Arguments) -> Result<PlanFile, Failure> {
    let is_recording = |p: &PathBuf| p.join("recording.toml").is_file();
    if is_recording(&a.plan) {
        return Err(format!(
            "{}: is one recording: `deacal fit` fits it, a batch is a folder of folders",
            a.plan.display()
        )
        .into());
    }
    let inside = |p: &Path| -> Result<Vec<PathBuf>, Failure> {
        let mut list = match p.is_dir() {
            true => folders(p)?,
            false => Vec::new(),
        };
        list.retain(is_recording);
        Ok(list)
    };
    let mut set = Vec::new();
    for folder in folders(&a.plan)? {
        let (recordings, holdout) = if is_recording(&folder) {
            (vec![folder.clone()], Vec::new())
        } else if folder.join("train").is_dir() {
            (
                inside(&folder.join("train"))?,
                inside(&folder.join("holdout"))?,
            )
        } else {
            (inside(&folder)?, Vec::new())
        };
        if recordings.is_empty() {
            continue;
        }
        let name = folder.file_name().unwrap_or_default();
        set.push(SetFile {
            name: name.to_string_lossy().into_owned(),
            recordings,
            holdout,
            fit: None,
            diagnose: None,
            params: None,
            rig: None,
            batch: None,
            day: None,
        });
    }
    Ok(PlanFile {
        fit: None,
        diagnose: None,
        set,
    })
}

/// A set of a plan in `dir`.
fn set(s: &SetFile, plan: &PlanFile, dir: &Path, diagnose: bool) -> Result<Set, Failure> {
    let name = &s.name;
    let bad = |why: &str| -> Failure { format!("set `{name}`: {why}").into() };
    let usable = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ' | '+');
    let taken = FILES.contains(&name.as_str()) || name == CAMPAIGN;
    if name.is_empty() || name.starts_with(['.', '-']) || !name.chars().all(usable) || taken {
        return Err(bad(
            "its name becomes a folder: give it one of letters, digits, `-`, `_` and `.`",
        ));
    }
    let at = |p: &PathBuf| dir.join(p);
    let recordings: Vec<PathBuf> = s.recordings.iter().map(at).collect();
    let holdout: Vec<PathBuf> = s.holdout.iter().map(at).collect();
    if recordings.is_empty() {
        return Err(bad("has no recordings"));
    }
    let mut stated = Vec::new();
    let mut first = None;
    for r in recordings.iter().chain(&holdout) {
        let (path, manifest) = manifest(r)?;
        stated.push(path);
        first.get_or_insert(manifest);
    }
    let first = first.ok_or_else(|| bad("has no recordings"))?;
    let job = load::fit_of(first.kind);
    let words = |text: &str| {
        text.split_whitespace()
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let path = |p: &PathBuf| p.display().to_string();
    let mut rest: Vec<String> = recordings.iter().map(path).collect();
    let mut shared = Vec::new();
    if let Some(rig) = s.rig.as_ref().map(at) {
        shared.extend(["--rig".to_owned(), path(&rig)]);
        stated.push(rig);
    }
    let mut fit = vec!["deacal".to_owned(), "fit".to_owned()];
    fit.extend(words(
        s.fit
            .as_ref()
            .or(plan.fit.as_ref())
            .map_or(job, String::as_str),
    ));
    fit.append(&mut rest.clone());
    fit.extend(shared.iter().cloned());
    match &s.params {
        // the version of the program says what is in its library
        Some(set) if is_of_library(set) => fit.extend(["--params".to_owned(), path(set)]),
        Some(params) => {
            let params = at(params);
            fit.extend(["--params".to_owned(), path(&params)]);
            stated.push(params);
        }
        None => {}
    }
    let wish = s.diagnose.clone().or(plan.diagnose.clone());
    let with = match wish.unwrap_or(Diagnose::Whether(diagnose)) {
        Diagnose::Whether(false) => None,
        Diagnose::Whether(true) => Some(Vec::new()),
        Diagnose::With(options) => Some(words(&options)),
    };
    let diagnose = with.map(|with| {
        let mut all = vec!["deacal".to_owned(), "diagnose".to_owned()];
        all.append(&mut rest);
        if !holdout.is_empty() {
            all.push("--holdout".to_owned());
            all.extend(holdout.iter().map(path));
        }
        all.extend(shared.into_iter().chain(with));
        all
    });
    let set = Set {
        name: name.clone(),
        fit,
        diagnose,
        batch: s.batch.clone().or(first.batch),
        day: s.day.or(first.day),
        stated,
    };
    // what cannot be parsed is said now, not after hours
    for words in std::iter::once(&set.fit).chain(&set.diagnose) {
        Set::parse(words, Path::new("out")).map_err(|e| bad(&e.to_string()))?;
    }
    Ok(set)
}
