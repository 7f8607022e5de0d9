//! `validate`: parameter files against recordings.

use std::path::PathBuf;

use super::progress::Progress;
use super::{Failure, Talk, load, ranges, say_findings, series};
use crate::calibration::{validate_lines, validate_samples};
use crate::checks::Finding;
use crate::dataset::Dataset;
use crate::jobs::load::Given;
use crate::recording::{Kind, Recording};
use crate::report::answer::Answer;
use crate::report::html::{self, number};
use crate::report::json::{FindingJson, ModelValidation, ValidationJson, results_to_text};
use crate::report::output::OutputSet;
use crate::report::parameter_file::ParameterFile;
use crate::report::provenance::{FileSum, Provenance};
use crate::report::terminal;
use crate::validation::validate;

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
    let kinds = [
        Kind::Robot,
        Kind::FilmSample,
        Kind::Axis,
        Kind::HingeBench,
        Kind::FilmCoupon,
    ];
    OutputSet::check(&a.output, &FILES, talk.overwrite())?;
    let recordings = load::recordings_of(&a.recordings, a.rig.as_ref(), &kinds, &progress)?;
    let given = Given::new(recordings, 0, command);
    given.copies.iter().for_each(|remark| talk.say(remark));
    let Given {
        recordings,
        copies,
        findings,
        provenance,
        ..
    } = given.look_over(&progress);
    say_findings(&findings, talk);
    let given = (&recordings[..], &findings[..]);
    match recordings[0].manifest.kind {
        Kind::Robot => {}
        Kind::FilmSample => return samples(a, given, copies, &provenance, progress, talk),
        Kind::Axis | Kind::HingeBench | Kind::FilmCoupon => {
            return lines(a, given, copies, &provenance, progress, talk);
        }
    }
    let datasets = load::datasets(&recordings, a.plan.as_ref(), &progress)?;
    let rig = load::rig(&recordings)?;
    let refs: Vec<&Dataset> = datasets.iter().collect();
    if a.path.is_some() && refs.len() != 1 {
        let text = format!(
            "--path is the plan of one recording, and {} were given",
            refs.len()
        );
        return Err(text.into());
    }
    let plan = a.path.as_deref().map(load::path).transpose()?;
    let (mut models, mut shown, mut answers) = (Vec::new(), Vec::new(), Vec::new());
    let (mut heads, mut says) = (Vec::new(), Vec::new());
    for path in &a.params {
        progress.step(format!("predicting with {}", path.display()));
        let file = load::parameters(path)?;
        let robot = load::robot(rig, Some(&file))?;
        let parameters = file.parameters()?;
        let at_work = series::at_work(&file, &recordings, &datasets)?;
        let effects = (at_work.effects.as_slice(), at_work.when.as_slice());
        let mut validation = validate(&robot, &refs, &parameters, plan.as_ref(), effects)?;
        validation.outcome.remarks.extend(at_work.remarks);
        let mut outside = Vec::new();
        for (i, d) in datasets.iter().enumerate() {
            let told_v = ranges::commands_v(d, validation.outcome.recordings[i].offset_s);
            let acting = (&at_work.effects[..], at_work.when[i]);
            outside.extend(ranges::of_dataset(&robot, d, acting, &told_v));
        }
        validation.outcome.remarks.extend(outside.iter().cloned());
        validation.outcome.remarks.extend(copies.iter().cloned());
        let sum = FileSum {
            role: "parameters".into(),
            file: path.display().to_string(),
            sha256: crate::recording::sha256(path)?,
        };
        let outcome = &validation.outcome;
        let answer = Answer::of_robot(outcome, &robot);
        heads.push((path, answer.says.clone()));
        let volt = |v: f64| number::sized(v, "V", 3);
        let rows: Vec<[String; 4]> = outcome
            .recordings
            .iter()
            .map(|r| match r.total.samples {
                0 => [
                    r.id.clone(),
                    "no sample above 1 kV that counts".into(),
                    String::new(),
                    String::new(),
                ],
                n => [
                    r.id.clone(),
                    format!("{} rms above 1 kV", volt(r.total.rmse_v)),
                    format!("noise alone {}", volt(r.total.noise_floor_v)),
                    format!("largest {}, {n} samples", volt(r.total.max_error_v)),
                ],
            })
            .collect();
        let words = html::validation_words(&validation);
        let each = words.iter().chain(&outside).map(|l| format!("  {l}"));
        let rows = terminal::columns(&rows);
        says.push(rows.into_iter().chain(each).collect::<Vec<String>>());
        answers.push(answer);
        models.push(ModelValidation::new(&validation, sum));
        shown.push((path.display().to_string(), validation));
    }
    tell(&heads, &says, talk);
    let head = models.remove(0);
    let json = ValidationJson::new(head, models, None, provenance.clone());
    let report = html::render_validation(&shown, &answers, a.compare.is_some(), &provenance);
    leave(a, json, report, &findings, progress, talk)
}

/// A model that was held against recordings: its numbers, its report, and what to say of each recording.
struct Held {
    model: ModelValidation,
    answer: Answer,
    report: String,
    says: Vec<String>,
}

/// Films against hanging samples.
fn samples(
    a: &Arguments,
    (recordings, findings): (&[Recording], &[Finding]),
    copies: Vec<String>,
    provenance: &Provenance,
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let hold = |file: &ParameterFile, sum: FileSum| {
        let (datasets, samples) = load::samples(recordings, Some(file))?;
        let refs: Vec<_> = datasets.iter().collect();
        let mut outcome = validate_samples(&refs, &samples, &file.parameters()?.film)?;
        outcome.remarks.extend(copies.iter().cloned());
        let says = outcome.recordings.iter().map(|r| {
            format!(
                "{:20} {} rms above 1 kV (noise alone {}); stroke {:.3} mm, predicted {:.3} mm",
                r.id,
                number::sized(r.error.rmse_v, "V", 3),
                number::sized(r.error.noise_floor_v, "V", 3),
                r.stroke_m[0] * 1e3,
                r.stroke_m[1] * 1e3
            )
        });
        Ok(Held {
            says: says.collect(),
            answer: Answer::of_samples(&outcome),
            report: html::render_samples(&outcome, provenance),
            model: ModelValidation::of_samples(&outcome, sum),
        })
    };
    compare(a, hold, None, (provenance, findings), progress, talk)
}

/// Models of a single coordinate against hinge benches, axes or coupons.
fn lines(
    a: &Arguments,
    (recordings, findings): (&[Recording], &[Finding]),
    copies: Vec<String>,
    provenance: &Provenance,
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let lines = load::lines(recordings, &progress)?;
    let unit = lines[0].unit();
    let hold = |file: &ParameterFile, sum: FileSum| {
        let (model, remarks) = series::line_model_on(file, recordings, &lines)?;
        let mut outcome = validate_lines(&lines, &model)?;
        outcome.remarks.extend(remarks);
        outcome.remarks.extend(copies.iter().cloned());
        let says = outcome.recordings.iter().map(|r| {
            let forward = r.forward.as_ref().map_or_else(String::new, |f| {
                format!(
                    "; run forward {} rms over a range of {}",
                    number::sized(f.rmse, f.unit, 3),
                    number::sized(f.range, f.unit, 3)
                )
            });
            format!(
                "{:20} {} rms (noise alone {}), {} samples{forward}",
                r.id,
                number::sized(r.rmse, &outcome.unit, 3),
                number::sized(r.noise, &outcome.unit, 3),
                r.n_samples
            )
        });
        Ok(Held {
            says: says.collect(),
            answer: Answer::of_lines(&outcome),
            report: html::render_lines(&outcome, provenance),
            model: ModelValidation::of_lines(&outcome, sum),
        })
    };
    compare(a, hold, Some(&unit), (provenance, findings), progress, talk)
}

/// Each parameter file against the recordings; the report is that of the first.
fn compare(
    a: &Arguments,
    hold: impl Fn(&ParameterFile, FileSum) -> Result<Held, Failure>,
    unit: Option<&str>,
    (provenance, findings): (&Provenance, &[Finding]),
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let mut all = Vec::new();
    let (mut heads, mut says) = (Vec::new(), Vec::new());
    for path in &a.params {
        progress.step(format!("predicting with {}", path.display()));
        let sum = FileSum {
            role: "parameters".into(),
            file: path.display().to_string(),
            sha256: crate::recording::sha256(path)?,
        };
        let held = hold(&load::parameters(path)?, sum)?;
        heads.push((path, held.answer.says.clone()));
        says.push(held.says.iter().map(|line| format!("  {line}")).collect());
        all.push(held);
    }
    tell(&heads, &says, talk);
    let first = all.remove(0);
    let others = all.into_iter().map(|h| h.model).collect();
    let json = ValidationJson::new(first.model, others, unit, provenance.clone());
    leave(a, json, first.report, findings, progress, talk)
}

/// The answers of all models, then what there is to say of each.
fn tell(answers: &[(&PathBuf, String)], says: &[Vec<String>], talk: Talk) {
    for (path, answer) in answers {
        talk.answer(&format!("{}: {answer}", path.display()));
    }
    for ((path, _), lines) in answers.iter().zip(says) {
        if answers.len() > 1 {
            talk.say(&format!("With {}", path.display()));
        }
        lines.iter().for_each(|line| talk.tell(line));
    }
}

/// Writes the results and says where they are.
fn leave(
    a: &Arguments,
    mut json: ValidationJson,
    report: String,
    findings: &[Finding],
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    json.findings = FindingJson::of(findings);
    let mut set = OutputSet::new(&a.output, talk.overwrite())?;
    set.write(
        "validation.json",
        results_to_text("validation.json", &json)?,
    )?;
    set.write("report.html", html::with_findings(report, findings))?;
    set.commit()?;
    drop(progress);
    talk.result(&json);
    talk.report(&a.output);
    Ok(())
}
