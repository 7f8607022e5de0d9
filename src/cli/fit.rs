//! `fit film|forearm|robot|sample|coupon|hinge|axis`.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::resume::Lasting;
use super::{Failure, Talk, load};
use crate::calibration::{
    self, Causes, CouponRequest, LineOutcome, LineRequest, MotionRequest, Outcome, Request,
    SampleRequest, Stage, calibrate_coupons, calibrate_lines, calibrate_motion, calibrate_robot,
    calibrate_samples,
};
use crate::checks::Finding;
use crate::dataset::line::Line;
use crate::dataset::{Coupon, Plan};
use crate::recording::Kind;
use crate::report::answer::{self, Answer};
use crate::report::html;
use crate::report::json::{FindingJson, FitJson, results_to_text};
use crate::report::output::{OutputSet, Overwrite};
use crate::report::parameter_file::ParameterFile;
use crate::report::plan_file::plan_to_toml;
use crate::report::provenance::Provenance;
use crate::report::terminal;
use crate::residual::motion::Between;

/// What to fit.
#[derive(Subcommand)]
pub(super) enum Fit {
    /// Film moduli, relaxation times and J (best from a symmetric drive)
    Film(Robot),
    /// Spring-back torque curve of the forearms (best from single-actuator drives)
    Forearm(Robot),
    /// Film and forearms jointly, all recordings at once
    Robot(Robot),
    /// Film parameters from hanging samples (one voltage, a mass on the free end)
    Sample(Samples),
    /// Film parameters from tensile and relaxation tests
    Coupon(Coupons),
    /// The torque curve of a flexure hinge from its bench, usable as the forearm's
    Hinge(Lines),
    /// Mass, damping, stiffness, gain of a single axis; with --objective motion also causes of the catalogue
    Axis(AxisFit),
}

/// Options that every fit takes.
#[derive(Args)]
struct Common {
    /// recording.toml files, or folders that have one
    #[arg(required = true, value_name = "REC")]
    recordings: Vec<PathBuf>,
    /// Folder for the results (default: out/fit)
    #[arg(short, long, default_value = "out/fit")]
    output: PathBuf,
    /// Holds a parameter: NAME=VALUE, in the unit of fit.json
    #[arg(long, value_name = "NAME=VALUE", value_parser = parse_fix)]
    fix: Vec<(String, f64)>,
    /// Keeps a parameter within bounds: NAME=LOW..HIGH
    #[arg(long, value_name = "NAME=LOW..HIGH", value_parser = parse_bound)]
    bound: Vec<(String, [f64; 2])>,
    /// Viscoelastic branches of the film
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u8).range(0..=8))]
    branches: u8,
    /// Number of starts, the first ones evenly spread, the others at random
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    starts: u16,
    /// Seed of the random starts
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// A fit to robot recordings.
#[derive(Args)]
pub(super) struct Robot {
    #[command(flatten)]
    common: Common,
    /// Rig to use instead of the recordings' own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Parameter file to start from; what is not fitted is held there
    #[arg(long, visible_alias = "params", value_name = "PARAMETERS")]
    start: Option<PathBuf>,
    /// plan.toml of an earlier run, to make the same choices again
    #[arg(long)]
    plan: Option<PathBuf>,
    /// Huber loss: samples further off than this many standard deviations count less
    #[arg(long, value_name = "SIGMA")]
    robust: Option<f64>,
}

/// A fit to hanging film samples.
#[derive(Args)]
pub(super) struct Samples {
    #[command(flatten)]
    common: Common,
    /// Rig to use instead of the recordings' own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Parameter file to start from; its J and its electrode effects are held
    #[arg(long, visible_alias = "params", value_name = "PARAMETERS")]
    start: Option<PathBuf>,
}

/// A fit to film coupons.
#[derive(Args)]
pub(super) struct Coupons {
    #[command(flatten)]
    common: Common,
}

/// A fit to hinge benches or axes.
#[derive(Args)]
pub(super) struct Lines {
    /// recording.toml files, or folders that have one
    #[arg(required = true, value_name = "REC")]
    recordings: Vec<PathBuf>,
    /// Folder for the results (default: out/fit)
    #[arg(short, long, default_value = "out/fit")]
    output: PathBuf,
    /// Holds a parameter: NAME=VALUE, in the unit of fit.json
    #[arg(long, value_name = "NAME=VALUE", value_parser = parse_fix)]
    fix: Vec<(String, f64)>,
    /// Keeps a parameter within bounds: NAME=LOW..HIGH
    #[arg(long, value_name = "NAME=LOW..HIGH", value_parser = parse_bound)]
    bound: Vec<(String, [f64; 2])>,
}

/// What a fit of an axis makes small.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Objective {
    /// The error of the input that the motion needs (the balance): linear, nothing to be searched, but noise
    /// in the motion shortens mass and damping
    Input,
    /// The error of the motion that the input makes (output error): nothing is differentiated, and noise
    /// shortens nothing
    Motion,
}

/// What the input does between samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum BetweenWord {
    /// Straight lines
    Straight,
    /// Held until the next sample
    Held,
    /// Smooth, nothing above half the sampling rate
    Smooth,
}

impl From<BetweenWord> for Between {
    fn from(word: BetweenWord) -> Self {
        match word {
            BetweenWord::Straight => Between::Straight,
            BetweenWord::Held => Between::Held,
            BetweenWord::Smooth => Between::Smooth,
        }
    }
}

/// A fit to axes.
#[derive(Args)]
pub(super) struct AxisFit {
    #[command(flatten)]
    lines: Lines,
    /// What is made small
    #[arg(long, value_enum, default_value = "input")]
    objective: Objective,
    /// With --objective motion: a cause to fit as well, by its id (again for another), or `choose`: those
    /// that foretell what was left out
    #[arg(long, value_name = "ID")]
    cause: Vec<String>,
    /// With --cause choose: a cause that is not thought of, by its id (again for another)
    #[arg(long, value_name = "ID")]
    without: Vec<String>,
    /// With --objective motion: what the input does between samples (default: what leaves least)
    #[arg(long, value_enum)]
    between: Option<BetweenWord>,
}

fn parse_fix(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.rsplit_once('=').ok_or("expected NAME=VALUE")?;
    let value = value
        .parse()
        .map_err(|_| format!("`{value}` is no number"))?;
    Ok((name.to_string(), value))
}

fn parse_bound(text: &str) -> Result<(String, [f64; 2]), String> {
    let (name, range) = text.rsplit_once('=').ok_or("expected NAME=LOW..HIGH")?;
    let (low, high) = range
        .split_once("..")
        .ok_or("expected NAME=LOW..HIGH, with two dots")?;
    let number = |t: &str| t.parse::<f64>().map_err(|_| format!("`{t}` is no number"));
    Ok((name.to_string(), [number(low)?, number(high)?]))
}

/// Fits, puts the results in place and says them.
pub(super) fn run(fit: &Fit, command: &str, talk: Talk) -> Result<(), Failure> {
    complete(fit, command, talk)?.in_place(talk)
}

/// A fit whose files are complete and not in place yet.
pub(super) struct Complete {
    pub(super) fit: FitJson,
    pub(super) files: OutputSet,
    answer: Answer,
    remarks: Vec<String>,
    lasting: Option<Arc<Lasting>>,
}

impl Complete {
    /// Puts the files in place, all or none, and says what they hold.
    pub(super) fn in_place(self, talk: Talk) -> Result<(), Failure> {
        let folder = self.files.dir().to_owned();
        self.files.commit()?;
        self.lasting.map_or(Ok(()), |l| l.done())?;
        talk.result(&self.fit);
        say_fit(&self.answer, &self.fit, &self.remarks, talk);
        talk.report(&folder);
        Ok(())
    }
}

/// Fits and writes the results, which whoever asked puts in place.
pub(super) fn complete(fit: &Fit, command: &str, talk: Talk) -> Result<Complete, Failure> {
    match fit {
        Fit::Film(a) => robot(Stage::Film, a, command, talk),
        Fit::Forearm(a) => robot(Stage::Forearm, a, command, talk),
        Fit::Robot(a) => robot(Stage::Robot, a, command, talk),
        Fit::Sample(a) => sample(a, command, talk),
        Fit::Coupon(a) => coupon(a, command, talk),
        Fit::Hinge(a) => line(a, Kind::HingeBench, command, talk, &calibrate_lines),
        Fit::Axis(a) => axis(a, command, talk),
    }
}

fn robot(stage: Stage, a: &Robot, command: &str, talk: Talk) -> Result<Complete, Failure> {
    let progress = Progress::new(talk);
    OutputSet::check(&a.common.output, &FILES, talk.overwrite())?;
    let recordings =
        load::recordings(&a.common.recordings, a.rig.as_ref(), Kind::Robot, &progress)?;
    let (recordings, _, copies) = load::distinct(recordings, 0);
    let file = a.start.as_deref().map(load::parameters).transpose()?;
    let robot = load::robot(load::rig(&recordings)?, file.as_ref())?;
    let findings = load::findings(&recordings, &progress, talk);
    let provenance = Provenance::of(command, &recordings);
    let lasting = Lasting::new(&a.common.output, &provenance);
    let mut datasets = load::datasets(&recordings, a.plan.as_ref(), &progress)?;
    drop(recordings);
    let cut = load::cut_all(&mut datasets);
    let request = Request {
        branches: a.common.branches.into(),
        start: file.as_ref().map(ParameterFile::parameters).transpose()?,
        fix: a.common.fix.clone(),
        bound: a.common.bound.clone(),
        starts: a.common.starts.into(),
        robust: a.robust,
        seed: a.common.seed,
        memory: lasting.memory(),
        ..Request::new(stage)
    };
    let refs: Vec<_> = datasets.iter().collect();
    progress.fit(request.starts);
    let mut outcome = calibrate_robot(&robot, &refs, &request, &|state| progress.watch(state))?;
    outcome.remarks.extend(copies);
    outcome.remarks.extend(cut);
    let answer = Answer::of_robot(&outcome, &robot);
    progress.step("writing");
    let mut fit = FitJson::new(&outcome, provenance.clone());
    fit.findings = FindingJson::of(&findings);
    let files = write_fit(
        &a.common.output,
        (&outcome, &answer),
        &fit,
        provenance,
        &findings,
        talk.overwrite(),
    )?;
    Ok(Complete {
        fit,
        files,
        remarks: answer::remarks(&outcome),
        answer,
        lasting: Some(lasting),
    })
}

/// The files of a fit.
const FILES: [&str; 4] = ["report.html", "parameters.toml", "fit.json", "plan.toml"];

/// Parameters, numbers, choices and report of a fit, complete and not in place yet.
pub(super) fn write_fit(
    output: &Path,
    (outcome, answer): (&Outcome, &Answer),
    fit: &FitJson,
    provenance: Provenance,
    findings: &[Finding],
    overwrite: Overwrite,
) -> Result<OutputSet, Failure> {
    let plans: Vec<Plan> = outcome.recordings.iter().map(|r| r.plan.clone()).collect();
    let mut set = OutputSet::new(output, overwrite)?;
    let page = html::render(outcome, answer, &provenance);
    set.write("report.html", html::with_findings(page, findings))?;
    set.write(
        "parameters.toml",
        ParameterFile::of_outcome(outcome, provenance).to_toml()?,
    )?;
    set.write("fit.json", results_to_text("fit.json", fit)?)?;
    set.write("plan.toml", plan_to_toml(&plans))?;
    Ok(set)
}

/// The first screen of the report, in the terminal: the answer, its quantities, then the parameters and what
/// is open.
pub(super) fn say_fit(answer: &Answer, fit: &FitJson, remarks: &[String], talk: Talk) {
    talk.answer(&answer.says);
    let say_all = |lines: Vec<String>| lines.iter().for_each(|l| talk.say(l));
    say_all(terminal::facts(&answer.facts));
    if !fit.converged {
        talk.tell(&format!(
            "The fit did not converge ({}): take its numbers as provisional.",
            fit.reason
        ));
    }
    let known = terminal::parameters(&fit.parameters, &answer.facts);
    if !known.is_empty() {
        talk.say("Parameters that the recordings determine, with 95 % intervals:");
        say_all(known);
    }
    if !answer.open.is_empty() {
        talk.say("Parameters that they leave open, and what to record for them:");
        say_all(terminal::open(&answer.open));
    }
    remarks.iter().for_each(|r| talk.tell(r));
}

fn sample(a: &Samples, command: &str, talk: Talk) -> Result<Complete, Failure> {
    let progress = Progress::new(talk);
    OutputSet::check(&a.common.output, &FILES, talk.overwrite())?;
    let recordings = load::recordings(
        &a.common.recordings,
        a.rig.as_ref(),
        Kind::FilmSample,
        &progress,
    )?;
    let (recordings, _, copies) = load::distinct(recordings, 0);
    let file = a.start.as_deref().map(load::parameters).transpose()?;
    let provenance = Provenance::of(command, &recordings);
    let findings = load::findings(&recordings, &progress, talk);
    let lasting = Lasting::new(&a.common.output, &provenance);
    let (datasets, samples) = load::samples(&recordings, file.as_ref())?;
    let refs: Vec<_> = datasets.iter().collect();
    let start = file.as_ref().map(ParameterFile::parameters).transpose()?;
    let request = SampleRequest {
        start: start.map(|p| p.film),
        fix: a.common.fix.clone(),
        bound: a.common.bound.clone(),
        starts: a.common.starts.into(),
        seed: a.common.seed,
        memory: lasting.memory(),
        ..SampleRequest::new(a.common.branches.into())
    };
    progress.step("fitting");
    let mut outcome = calibrate_samples(&refs, &samples, &request, &|_| ControlFlow::Continue(()))?;
    outcome.remarks.extend(copies);
    let plans: Vec<Plan> = outcome.recordings.iter().map(|r| r.plan.clone()).collect();
    let found = Found {
        answer: Answer::of_samples(&outcome),
        report: html::render_samples(&outcome, &provenance),
        fit: FitJson::of_samples(&outcome, provenance.clone()),
        parameters: ParameterFile::of_samples(&outcome, provenance),
        plan: Some(plan_to_toml(&plans)),
        findings,
    };
    found.complete(&a.common.output, Some(lasting), talk)
}

/// What a fit of samples, lines or coupons finds.
struct Found {
    answer: Answer,
    report: String,
    fit: FitJson,
    parameters: ParameterFile,
    plan: Option<String>,
    findings: Vec<Finding>,
}

impl Found {
    /// Writes it.
    fn complete(
        self,
        output: &Path,
        lasting: Option<Arc<Lasting>>,
        talk: Talk,
    ) -> Result<Complete, Failure> {
        let mut fit = self.fit;
        fit.findings = FindingJson::of(&self.findings);
        let mut files = OutputSet::new(output, talk.overwrite())?;
        let page = html::with_findings(self.report, &self.findings);
        files.write("report.html", page)?;
        files.write("parameters.toml", self.parameters.to_toml()?)?;
        files.write("fit.json", results_to_text("fit.json", &fit)?)?;
        if let Some(plan) = &self.plan {
            files.write("plan.toml", plan)?;
        }
        Ok(Complete {
            remarks: fit.remarks.clone(),
            fit,
            files,
            answer: self.answer,
            lasting,
        })
    }
}

fn axis(a: &AxisFit, command: &str, talk: Talk) -> Result<Complete, Failure> {
    if a.objective == Objective::Input {
        if !a.cause.is_empty() || !a.without.is_empty() || a.between.is_some() {
            return Err(
                "--cause, --without and --between are for --objective motion; `deacal diagnose` looks for \
                 causes in the input"
                    .into(),
            );
        }
        return line(&a.lines, Kind::Axis, command, talk, &calibrate_lines);
    }
    let choose = a.cause.iter().any(|c| c == "choose");
    if choose && a.cause.len() > 1 {
        return Err("--cause choose stands alone".into());
    }
    if !choose && !a.without.is_empty() {
        return Err("--without is for --cause choose".into());
    }
    let causes = match a.cause.as_slice() {
        [] => Causes::None,
        _ if choose => Causes::Choose {
            without: a.without.clone(),
        },
        ids => Causes::These(ids.to_vec()),
    };
    let fit = |lines: &[Line], request: &LineRequest| {
        let request = MotionRequest {
            line: request.clone(),
            causes: causes.clone(),
            between: a.between.map(Between::from),
        };
        calibrate_motion(lines, &request).map(|m| m.outcome)
    };
    line(&a.lines, Kind::Axis, command, talk, &fit)
}

/// How a line is fitted.
type FitLines<'a> = dyn Fn(&[Line], &LineRequest) -> Result<LineOutcome, calibration::Error> + 'a;

fn line(
    a: &Lines,
    kind: Kind,
    command: &str,
    talk: Talk,
    fit: &FitLines,
) -> Result<Complete, Failure> {
    let progress = Progress::new(talk);
    OutputSet::check(&a.output, &FILES, talk.overwrite())?;
    let recordings = load::recordings(&a.recordings, None, kind, &progress)?;
    let (recordings, _, copies) = load::distinct(recordings, 0);
    let provenance = Provenance::of(command, &recordings);
    let findings = load::findings(&recordings, &progress, talk);
    let lines = load::lines(&recordings, &progress)?;
    drop(recordings);
    let request = LineRequest {
        fix: a.fix.clone(),
        bound: a.bound.clone(),
    };
    progress.step("fitting");
    let mut outcome = fit(&lines, &request)?;
    outcome.remarks.extend(copies);
    let found = Found {
        answer: Answer::of_lines(&outcome),
        report: html::render_lines(&outcome, &provenance),
        fit: FitJson::of_lines(&outcome, provenance.clone()),
        parameters: ParameterFile::of_lines(&outcome, provenance),
        plan: None,
        findings,
    };
    found.complete(&a.output, None, talk)
}

fn coupon(a: &Coupons, command: &str, talk: Talk) -> Result<Complete, Failure> {
    let progress = Progress::new(talk);
    OutputSet::check(&a.common.output, &FILES, talk.overwrite())?;
    let recordings = load::recordings(&a.common.recordings, None, Kind::FilmCoupon, &progress)?;
    let (recordings, _, copies) = load::distinct(recordings, 0);
    let provenance = Provenance::of(command, &recordings);
    let findings = load::findings(&recordings, &progress, talk);
    let lasting = Lasting::new(&a.common.output, &provenance);
    let coupons = recordings
        .iter()
        .map(Coupon::from_recording)
        .collect::<Result<Vec<_>, _>>()?;
    let refs: Vec<_> = coupons.iter().collect();
    let request = CouponRequest {
        fix: a.common.fix.clone(),
        bound: a.common.bound.clone(),
        starts: usize::from(a.common.starts).max(8),
        seed: a.common.seed,
        memory: lasting.memory(),
        ..CouponRequest::new(a.common.branches.into())
    };
    progress.fit(request.starts);
    let mut outcome = calibrate_coupons(&refs, &request, &|state| progress.watch(state))?;
    outcome.remarks.extend(copies);
    let found = Found {
        answer: Answer::of_coupons(&outcome),
        report: html::render_coupons(&outcome, &provenance),
        fit: FitJson::of_coupons(&outcome, provenance.clone()),
        parameters: ParameterFile::of_coupons(&outcome, provenance),
        plan: None,
        findings,
    };
    found.complete(&a.common.output, Some(lasting), talk)
}
