//! `validate`: parameters against recordings that they were not, or were, fitted to.

use std::path::Path;

use super::load::{self, Given};
use super::{Failure, Files, Progress, ranges, series};
use crate::calibration::{validate_lines, validate_samples};
use crate::dataset::{Dataset, Plan};
use crate::recording::{Kind, sha256, sha256_of};
use crate::report::answer::Answer;
use crate::report::html::{self, number};
use crate::report::json::{FindingJson, ModelValidation, ValidationJson, results_to_text};
use crate::report::library;
use crate::report::parameter_file::ParameterFile;
use crate::report::provenance::{FileSum, Provenance};
use crate::report::terminal;
use crate::simulate::PlannedPath;
use crate::validation;

/// Kinds of recordings that parameters can be held against.
pub const KINDS: [Kind; 5] = [
    Kind::Robot,
    Kind::FilmSample,
    Kind::Axis,
    Kind::HingeBench,
    Kind::FilmCoupon,
];

/// Parameters that are held against recordings.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Their file, or what they are called in words.
    pub name: String,
    file: ParameterFile,
    sha256: String,
}

impl Candidate {
    /// Of a file, or of a parameter set of the library.
    ///
    /// # Errors
    /// As [`load::parameters`].
    pub fn read(path: &Path) -> Result<Self, Failure> {
        if let Some(found) = library::text(path) {
            let (path, text) = found?;
            return Self::of_text(&path.display().to_string(), text);
        }
        Ok(Candidate {
            name: path.display().to_string(),
            file: load::parameters(path)?,
            sha256: sha256(path)?,
        })
    }

    /// Of the text of a parameter file.
    ///
    /// # Errors
    /// As [`load::parameters_of_text`].
    pub fn of_text(name: &str, text: &str) -> Result<Self, Failure> {
        Ok(Candidate {
            name: name.to_owned(),
            file: load::parameters_of_text(Path::new(name), text)?,
            sha256: sha256_of(text.as_bytes())?,
        })
    }

    fn sum(&self) -> FileSum {
        FileSum {
            role: "parameters".into(),
            file: self.name.clone(),
            sha256: self.sha256.clone(),
        }
    }
}

/// Parameters that were held against recordings, in words.
#[derive(Debug, Clone)]
pub struct Held {
    /// As [`Candidate::name`].
    pub name: String,
    /// Do they predict?
    pub answer: Answer,
    /// A line a recording, and what else a reader should see.
    pub lines: Vec<String>,
}

/// What a validation found.
#[derive(Debug, Clone)]
pub struct Validated {
    /// All of its numbers.
    pub json: ValidationJson,
    /// Each parameter file in words, in the order in which they were given.
    pub held: Vec<Held>,
    /// `report.html` and `validation.json`.
    pub files: Files,
}

/// What to hold against what beside the recordings and their parameters.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// Choices of an earlier run to make again.
    pub plans: Vec<Plan>,
    /// The planned path of the one recording: the measured path is held against it instead of against the
    /// forward dynamics.
    pub path: Option<PlannedPath>,
    /// In the report, beside what the paper reports of its own robot.
    pub paper: bool,
}

/// Holds parameters against recordings of one kind among [`KINDS`].
///
/// # Errors
/// No parameters; recordings of different rigs, or that cannot be aligned; a path for several recordings;
/// parameters of another kind of model; a figure that came out as no finite number.
pub fn validate(
    given: Given,
    candidates: &[Candidate],
    request: &Request,
    progress: &Progress,
) -> Result<Validated, Failure> {
    if candidates.is_empty() {
        return Err("no parameters were given".into());
    }
    let found = match given.recordings.first().map(|r| r.manifest.kind) {
        None => return Err("no recording was given".into()),
        Some(Kind::Robot) => robots(&given, candidates, request, progress)?,
        Some(Kind::FilmSample) => samples(&given, candidates, progress)?,
        Some(_) => lines(&given, candidates, progress)?,
    };
    let mut models = found.models.into_iter();
    let first = models.next().ok_or("no parameters were given")?;
    let unit = found.unit.as_deref();
    let mut json = ValidationJson::new(first, models.collect(), unit, given.provenance);
    json.findings = FindingJson::of(&given.findings);
    let mut files = Files::default();
    files.add(
        "validation.json",
        results_to_text("validation.json", &json)?,
    );
    let report = html::with_findings(found.report, &given.findings);
    files.add("report.html", report);
    Ok(Validated {
        json,
        held: found.held,
        files,
    })
}

/// What there is before it is put together.
struct Found {
    models: Vec<ModelValidation>,
    held: Vec<Held>,
    /// The page, of the first parameters or of all.
    report: String,
    /// Unit of the errors of a single coordinate.
    unit: Option<String>,
}

/// Robots, with voltage, path, force and stroke.
fn robots(
    given: &Given,
    candidates: &[Candidate],
    request: &Request,
    progress: &Progress,
) -> Result<Found, Failure> {
    let recordings = &given.recordings;
    let datasets = load::aligned(recordings, &request.plans, progress)?;
    let rig = load::rig(recordings)?;
    let refs: Vec<&Dataset> = datasets.iter().collect();
    if request.path.is_some() && refs.len() != 1 {
        let text = format!(
            "--path is the plan of one recording, and {} were given",
            refs.len()
        );
        return Err(text.into());
    }
    let (mut models, mut shown, mut held) = (Vec::new(), Vec::new(), Vec::new());
    for candidate in candidates {
        progress.step(format!("predicting with {}", candidate.name));
        let file = &candidate.file;
        let robot = load::robot(rig, Some(file))?;
        let parameters = file.parameters()?;
        let at_work = series::at_work(file, recordings, &datasets)?;
        let effects = (at_work.effects.as_slice(), at_work.when.as_slice());
        let path = request.path.as_ref();
        let mut validation = validation::validate(&robot, &refs, &parameters, path, effects)?;
        validation.outcome.remarks.extend(at_work.remarks);
        let mut outside = Vec::new();
        for (i, d) in datasets.iter().enumerate() {
            let told_v = ranges::commands_v(d, validation.outcome.recordings[i].offset_s);
            let acting = (&at_work.effects[..], at_work.when[i]);
            outside.extend(ranges::of_dataset(&robot, d, acting, &told_v));
        }
        validation.outcome.remarks.extend(outside.iter().cloned());
        validation
            .outcome
            .remarks
            .extend(given.copies.iter().cloned());
        let outcome = &validation.outcome;
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
        held.push(Held {
            name: candidate.name.clone(),
            answer: Answer::of_robot(outcome, &robot),
            lines: rows.into_iter().chain(each).collect(),
        });
        models.push(ModelValidation::new(&validation, candidate.sum()));
        shown.push((candidate.name.clone(), validation));
    }
    let answers: Vec<Answer> = held.iter().map(|h| h.answer.clone()).collect();
    Ok(Found {
        report: html::render_validation(&shown, &answers, request.paper, &given.provenance),
        models,
        held,
        unit: None,
    })
}

/// One of several that were held against recordings: its numbers, its page, and what to say of it.
struct One {
    model: ModelValidation,
    report: String,
    answer: Answer,
    lines: Vec<String>,
}

/// Films against hanging samples.
fn samples(given: &Given, candidates: &[Candidate], progress: &Progress) -> Result<Found, Failure> {
    let hold = |candidate: &Candidate, provenance: &Provenance| {
        let file = &candidate.file;
        let (datasets, samples) = load::samples(&given.recordings, Some(file))?;
        let refs: Vec<_> = datasets.iter().collect();
        let mut outcome = validate_samples(&refs, &samples, &file.parameters()?.film)?;
        outcome.remarks.extend(given.copies.iter().cloned());
        let lines = outcome.recordings.iter().map(|r| {
            format!(
                "{:20} {} rms above 1 kV (noise alone {}); stroke {:.3} mm, predicted {:.3} mm",
                r.id,
                number::sized(r.error.rmse_v, "V", 3),
                number::sized(r.error.noise_floor_v, "V", 3),
                r.stroke_m[0] * 1e3,
                r.stroke_m[1] * 1e3
            )
        });
        Ok(One {
            lines: lines.collect(),
            answer: Answer::of_samples(&outcome),
            report: html::render_samples(&outcome, provenance),
            model: ModelValidation::of_samples(&outcome, candidate.sum()),
        })
    };
    each(given, candidates, hold, None, progress)
}

/// Models of a single coordinate against hinge benches, axes or coupons.
fn lines(given: &Given, candidates: &[Candidate], progress: &Progress) -> Result<Found, Failure> {
    let recordings = &given.recordings;
    let lines = load::lines(recordings, progress)?;
    let unit = lines[0].unit();
    let hold = |candidate: &Candidate, provenance: &Provenance| {
        let (model, remarks) = series::line_model_on(&candidate.file, recordings, &lines)?;
        let mut outcome = validate_lines(&lines, &model)?;
        outcome.remarks.extend(remarks);
        outcome.remarks.extend(given.copies.iter().cloned());
        let lines = outcome.recordings.iter().map(|r| {
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
        Ok(One {
            lines: lines.collect(),
            answer: Answer::of_lines(&outcome),
            report: html::render_lines(&outcome, provenance),
            model: ModelValidation::of_lines(&outcome, candidate.sum()),
        })
    };
    each(given, candidates, hold, Some(unit.clone()), progress)
}

/// Each of the parameters against the recordings; the report is that of the first.
fn each(
    given: &Given,
    candidates: &[Candidate],
    hold: impl Fn(&Candidate, &Provenance) -> Result<One, Failure>,
    unit: Option<String>,
    progress: &Progress,
) -> Result<Found, Failure> {
    let (mut models, mut held, mut report) = (Vec::new(), Vec::new(), None);
    for candidate in candidates {
        progress.step(format!("predicting with {}", candidate.name));
        let one = hold(candidate, &given.provenance)?;
        report.get_or_insert(one.report);
        models.push(one.model);
        held.push(Held {
            name: candidate.name.clone(),
            answer: one.answer,
            lines: one.lines.iter().map(|line| format!("  {line}")).collect(),
        });
    }
    Ok(Found {
        models,
        held,
        report: report.unwrap_or_default(),
        unit,
    })
}
