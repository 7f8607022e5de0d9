//! `fit film|forearm|robot|sample|coupon|hinge|axis`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, Subcommand};

use super::progress::Progress;
use super::resume::Lasting;
use super::{Failure, Talk, load, say_findings};
use crate::calibration::{CouponRequest, LineRequest, Request, SampleRequest, Stage};
use crate::jobs::fit::{self as job, Fitted};
use crate::jobs::load::Given;
use crate::recording::{Kind, Recording};
use crate::report::answer::Answer;
use crate::report::json::FitJson;
use crate::report::output::OutputSet;
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
    /// Writes the files for a folder.
    fn of(
        fitted: Fitted,
        output: &Path,
        lasting: Option<Arc<Lasting>>,
        talk: Talk,
    ) -> Result<Self, Failure> {
        Ok(Complete {
            files: fitted.files.stage(output, talk.overwrite())?,
            fit: fitted.fit,
            answer: fitted.answer,
            remarks: fitted.remarks,
            lasting,
        })
    }

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
        Fit::Hinge(a) => line(a, Kind::HingeBench, job::Objective::Input, command, talk),
        Fit::Axis(a) => {
            let motion = a.objective == Objective::Motion;
            let between = a.between.map(Between::from);
            let objective = job::Objective::stated(motion, &a.cause, &a.without, between)?;
            line(&a.lines, Kind::Axis, objective, command, talk)
        }
    }
}

/// Recordings that are to be fitted; what is wrong with them is said.
fn given(all: Vec<Recording>, command: &str, progress: &Progress, talk: Talk) -> Given {
    let given = Given::new(all, 0, command).look_over(progress);
    say_findings(&given.findings, talk);
    given
}

fn robot(stage: Stage, a: &Robot, command: &str, talk: Talk) -> Result<Complete, Failure> {
    let progress = Progress::new(talk);
    let Common {
        recordings, output, ..
    } = &a.common;
    OutputSet::check(output, &FILES, talk.overwrite())?;
    let all = load::recordings(recordings, a.rig.as_ref(), Kind::Robot, &progress)?;
    let start = a.start.as_deref().map(load::parameters).transpose()?;
    let given = given(all, command, &progress, talk);
    let lasting = Lasting::new(output, &given.provenance);
    let request = Request {
        branches: a.common.branches.into(),
        fix: a.common.fix.clone(),
        bound: a.common.bound.clone(),
        starts: a.common.starts.into(),
        robust: a.robust,
        seed: a.common.seed,
        memory: lasting.memory(),
        ..Request::new(stage)
    };
    let plans = load::plans(a.plan.as_ref())?;
    let fitted = job::robot(given, start.as_ref(), &plans, request, &progress)?;
    Complete::of(fitted, output, Some(lasting), talk)
}

/// The files of a fit.
const FILES: [&str; 4] = ["report.html", "parameters.toml", "fit.json", "plan.toml"];

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
    let Common {
        recordings, output, ..
    } = &a.common;
    OutputSet::check(output, &FILES, talk.overwrite())?;
    let all = load::recordings(recordings, a.rig.as_ref(), Kind::FilmSample, &progress)?;
    let start = a.start.as_deref().map(load::parameters).transpose()?;
    let given = given(all, command, &progress, talk);
    let lasting = Lasting::new(output, &given.provenance);
    let request = SampleRequest {
        fix: a.common.fix.clone(),
        bound: a.common.bound.clone(),
        starts: a.common.starts.into(),
        seed: a.common.seed,
        memory: lasting.memory(),
        ..SampleRequest::new(a.common.branches.into())
    };
    let fitted = job::sample(given, start.as_ref(), request, &progress)?;
    Complete::of(fitted, output, Some(lasting), talk)
}

fn line(
    a: &Lines,
    kind: Kind,
    objective: job::Objective,
    command: &str,
    talk: Talk,
) -> Result<Complete, Failure> {
    let progress = Progress::new(talk);
    OutputSet::check(&a.output, &FILES, talk.overwrite())?;
    let all = load::recordings(&a.recordings, None, kind, &progress)?;
    let given = given(all, command, &progress, talk);
    let request = LineRequest {
        fix: a.fix.clone(),
        bound: a.bound.clone(),
    };
    let fitted = job::line(given, request, objective, &progress)?;
    Complete::of(fitted, &a.output, None, talk)
}

fn coupon(a: &Coupons, command: &str, talk: Talk) -> Result<Complete, Failure> {
    let progress = Progress::new(talk);
    let Common {
        recordings, output, ..
    } = &a.common;
    OutputSet::check(output, &FILES, talk.overwrite())?;
    let all = load::recordings(recordings, None, Kind::FilmCoupon, &progress)?;
    let given = given(all, command, &progress, talk);
    let lasting = Lasting::new(output, &given.provenance);
    let request = CouponRequest {
        fix: a.common.fix.clone(),
        bound: a.common.bound.clone(),
        starts: a.common.starts.into(),
        seed: a.common.seed,
        memory: lasting.memory(),
        ..CouponRequest::new(a.common.branches.into())
    };
    let fitted = job::coupon(given, request, &progress)?;
    Complete::of(fitted, output, Some(lasting), talk)
}
