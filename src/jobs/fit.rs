//! `fit`: parameters from recordings of each kind.

use std::ops::ControlFlow;

use super::load::{self, Given};
use super::{Failure, Files, Progress};
use crate::calibration::{
    Causes, CouponRequest, LineRequest, MotionRequest, Outcome, Request, SampleRequest,
    calibrate_coupons, calibrate_lines, calibrate_motion, calibrate_robot, calibrate_samples,
};
use crate::checks::Finding;
use crate::dataset::{Coupon, Plan};
use crate::report::answer::{self, Answer};
use crate::report::html;
use crate::report::json::{FindingJson, FitJson, results_to_text};
use crate::report::parameter_file::ParameterFile;
use crate::report::plan_file::plan_to_toml;
use crate::report::provenance::Provenance;
use crate::residual::motion::Between;

/// What a fit found.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// All of its numbers.
    pub fit: FitJson,
    /// The first screen: does it fit, what is known, what is open.
    pub answer: Answer,
    /// What a reader should know beside.
    pub remarks: Vec<String>,
    /// `report.html`, `parameters.toml`, `fit.json`, and `plan.toml` where there are choices to make again.
    pub files: Files,
}

/// Fits film, forearms or both, as the request's stage says, to recordings of a robot. What is not fitted is
/// that of `start`; `plans` are choices of an earlier run to make again.
///
/// # Errors
/// Recordings of different rigs, or that cannot be aligned; a request that cannot be meant; no start that
/// could be evaluated; a figure that came out as no finite number.
pub fn robot(
    given: Given,
    start: Option<&ParameterFile>,
    plans: &[Plan],
    request: Request,
    progress: &Progress,
) -> Result<Fitted, Failure> {
    let robot = load::robot(load::rig(&given.recordings)?, start)?;
    let mut datasets = load::aligned(&given.recordings, plans, progress)?;
    let Given {
        copies,
        findings,
        provenance,
        recordings,
        ..
    } = given;
    drop(recordings);
    let cut = load::cut_all(&mut datasets);
    let request = Request {
        start: start.map(ParameterFile::parameters).transpose()?,
        memory: request.memory.until(progress.stop()),
        ..request
    };
    let refs: Vec<_> = datasets.iter().collect();
    progress.fit(request.starts);
    let mut outcome = calibrate_robot(&robot, &refs, &request, &|state| progress.watch(state))?;
    outcome.remarks.extend(copies);
    outcome.remarks.extend(cut);
    let answer = Answer::of_robot(&outcome, &robot);
    progress.step("writing");
    of_robot(&outcome, answer, provenance, &findings)
}

/// A calibration of a robot as the fit that it is, with its files.
///
/// # Errors
/// A figure that is no finite number.
pub fn of_robot(
    outcome: &Outcome,
    answer: Answer,
    provenance: Provenance,
    findings: &[Finding],
) -> Result<Fitted, Failure> {
    let plans: Vec<Plan> = outcome.recordings.iter().map(|r| r.plan.clone()).collect();
    let found = Found {
        report: html::render(outcome, &answer, &provenance),
        fit: FitJson::new(outcome, provenance.clone()),
        parameters: ParameterFile::of_outcome(outcome, provenance),
        plan: Some(plan_to_toml(&plans)),
        answer,
    };
    Ok(Fitted {
        remarks: answer::remarks(outcome),
        ..found.complete(findings)?
    })
}

/// Fits film parameters to hanging samples. J and electrode effects of `start` are held.
///
/// # Errors
/// As [`robot`].
pub fn sample(
    given: Given,
    start: Option<&ParameterFile>,
    request: SampleRequest,
    progress: &Progress,
) -> Result<Fitted, Failure> {
    let (datasets, samples) = load::samples(&given.recordings, start)?;
    let refs: Vec<_> = datasets.iter().collect();
    let film = start.map(ParameterFile::parameters).transpose()?;
    let request = SampleRequest {
        start: film.map(|p| p.film),
        memory: request.memory.until(progress.stop()),
        ..request
    };
    progress.step("fitting");
    let mut outcome = calibrate_samples(&refs, &samples, &request, &|_| ControlFlow::Continue(()))?;
    outcome.remarks.extend(given.copies);
    let plans: Vec<Plan> = outcome.recordings.iter().map(|r| r.plan.clone()).collect();
    let found = Found {
        answer: Answer::of_samples(&outcome),
        report: html::render_samples(&outcome, &given.provenance),
        fit: FitJson::of_samples(&outcome, given.provenance.clone()),
        parameters: ParameterFile::of_samples(&outcome, given.provenance),
        plan: Some(plan_to_toml(&plans)),
    };
    found.complete(&given.findings)
}

/// Fewest starts of a fit to coupons: a single curve has more false minima than a motion.
const COUPON_STARTS: usize = 8;

/// Fits film parameters to tensile and relaxation tests.
///
/// # Errors
/// As [`robot`].
pub fn coupon(
    given: Given,
    request: CouponRequest,
    progress: &Progress,
) -> Result<Fitted, Failure> {
    let coupons = given
        .recordings
        .iter()
        .map(Coupon::from_recording)
        .collect::<Result<Vec<_>, _>>()?;
    let refs: Vec<_> = coupons.iter().collect();
    let request = CouponRequest {
        starts: request.starts.max(COUPON_STARTS),
        memory: request.memory.until(progress.stop()),
        ..request
    };
    progress.fit(request.starts);
    let mut outcome = calibrate_coupons(&refs, &request, &|state| progress.watch(state))?;
    outcome.remarks.extend(given.copies);
    let found = Found {
        answer: Answer::of_coupons(&outcome),
        report: html::render_coupons(&outcome, &given.provenance),
        fit: FitJson::of_coupons(&outcome, given.provenance.clone()),
        parameters: ParameterFile::of_coupons(&outcome, given.provenance),
        plan: None,
    };
    found.complete(&given.findings)
}

/// What a fit of a single coordinate makes small.
#[derive(Debug, Clone)]
pub enum Objective {
    /// The error of the input (torque, force) that the motion needs.
    Input,
    /// The error of the motion that the input of an axis makes.
    Motion {
        /// Causes to fit as well.
        causes: Causes,
        /// What the input does between samples; none: what leaves least.
        between: Option<Between>,
    },
}

impl Objective {
    /// As a user states it: ids of causes, or `choose` alone, and then ids of those that are not thought of.
    ///
    /// # Errors
    /// Causes where the input is made small, `choose` beside an id, exceptions without `choose`.
    pub fn stated(
        motion: bool,
        cause: &[String],
        without: &[String],
        between: Option<Between>,
    ) -> Result<Self, Failure> {
        if !motion {
            if !cause.is_empty() || !without.is_empty() || between.is_some() {
                return Err(
                    "--cause, --without and --between are for --objective motion; `deacal diagnose` looks for \
                     causes in the input"
                        .into(),
                );
            }
            return Ok(Objective::Input);
        }
        let choose = cause.iter().any(|c| c == "choose");
        if choose && cause.len() > 1 {
            return Err("--cause choose stands alone".into());
        }
        if !choose && !without.is_empty() {
            return Err("--without is for --cause choose".into());
        }
        let causes = match cause {
            [] => Causes::None,
            _ if choose => Causes::Choose {
                without: without.to_vec(),
            },
            ids => Causes::These(ids.to_vec()),
        };
        Ok(Objective::Motion { causes, between })
    }
}

/// Fits the model of a single coordinate to hinge benches or axes.
///
/// # Errors
/// As [`robot`]; a cause that does not exist.
pub fn line(
    given: Given,
    request: LineRequest,
    objective: Objective,
    progress: &Progress,
) -> Result<Fitted, Failure> {
    let lines = load::lines(&given.recordings, progress)?;
    progress.step("fitting");
    let mut outcome = match objective {
        Objective::Input => calibrate_lines(&lines, &request)?,
        Objective::Motion { causes, between } => {
            let request = MotionRequest {
                line: request,
                causes,
                between,
            };
            calibrate_motion(&lines, &request)?.outcome
        }
    };
    outcome.remarks.extend(given.copies);
    let found = Found {
        answer: Answer::of_lines(&outcome),
        report: html::render_lines(&outcome, &given.provenance),
        fit: FitJson::of_lines(&outcome, given.provenance.clone()),
        parameters: ParameterFile::of_lines(&outcome, given.provenance),
        plan: None,
    };
    found.complete(&given.findings)
}

/// What a fit found, before its files are made.
struct Found {
    answer: Answer,
    report: String,
    fit: FitJson,
    parameters: ParameterFile,
    plan: Option<String>,
}

impl Found {
    fn complete(self, findings: &[Finding]) -> Result<Fitted, Failure> {
        let mut fit = self.fit;
        fit.findings = FindingJson::of(findings);
        let mut files = Files::default();
        files.add("report.html", html::with_findings(self.report, findings));
        files.add("parameters.toml", self.parameters.to_toml()?);
        files.add("fit.json", results_to_text("fit.json", &fit)?);
        if let Some(plan) = self.plan {
            files.add("plan.toml", plan);
        }
        Ok(Fitted {
            remarks: fit.remarks.clone(),
            fit,
            answer: self.answer,
            files,
        })
    }
}
