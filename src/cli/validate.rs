//! `validate`: parameter files against recordings.

use std::path::PathBuf;

use super::progress::Progress;
use super::{Failure, Talk, load};
use crate::calibration::{Outcome, SampleOutcome, predict_force, validate_robot, validate_samples};
use crate::dataset::Dataset;
use crate::model::{Parameters, Robot};
use crate::recording::{Kind, Recording};
use crate::report::html;
use crate::report::json::{ForceErrors, ModelValidation, Stroke, ValidationJson, finite, to_text};
use crate::report::output::OutputSet;
use crate::report::provenance::{FileSum, Provenance};

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
    /// Folder for the results
    #[arg(short, long, default_value = "out/validate")]
    output: PathBuf,
}

pub(super) fn run(a: &Arguments, command: &str, talk: Talk) -> Result<(), Failure> {
    let progress = Progress::new(talk);
    let kinds = [Kind::Robot, Kind::FilmSample];
    let recordings = load::recordings_of(&a.recordings, a.rig.as_ref(), &kinds, &progress)?;
    let provenance = Provenance::of(command, &recordings);
    if recordings[0].manifest.kind == Kind::FilmSample {
        return samples(a, &recordings, &provenance, progress, talk);
    }
    let datasets = load::datasets(&recordings, a.plan.as_ref(), &progress)?;
    let rig = load::rig(&recordings)?;
    let refs: Vec<&Dataset> = datasets.iter().collect();
    let mut models = Vec::new();
    let mut first: Option<Outcome> = None;
    for path in &a.params {
        progress.step(format!("predicting with {}", path.display()));
        let file = load::parameters(path)?;
        let robot = load::robot(rig, Some(&file))?;
        let parameters = file.parameters()?;
        let outcome = validate_robot(&robot, &refs, &parameters)?;
        let sum = FileSum {
            role: "parameters".into(),
            file: path.display().to_string(),
            sha256: crate::recording::sha256(path)?,
        };
        let mut model = ModelValidation::new(&outcome, sum);
        for (i, r) in model.recordings.iter_mut().enumerate() {
            let offset_s = outcome.recordings[i].offset_s;
            r.force = Some(force_errors(&robot, &datasets[i], &parameters, offset_s)?);
            r.stroke_mm = Some(Stroke {
                recorded: finite(stroke_mm(&datasets[i])),
                predicted: None,
            });
        }
        talk.say(&format!("{}: {}", path.display(), outcome.verdict));
        for r in &outcome.recordings {
            talk.say(&format!(
                "  {:20} {:8.2} V rms above 1 kV (noise alone {:.2} V), largest {:.1} V, {} samples",
                r.id, r.total.rmse_v, r.total.noise_floor_v, r.total.max_error_v, r.total.samples
            ));
        }
        models.push(model);
        first.get_or_insert(outcome);
        progress.stopped()?;
    }
    let shown = first.ok_or("no parameter file was given")?;
    let head = models.remove(0);
    let json = ValidationJson::new(head, models, provenance.clone());
    let mut set = OutputSet::new(&a.output)?;
    set.write("validation.json", to_text(&json))?;
    set.write("report.html", html::render(&shown, &provenance))?;
    set.commit()?;
    drop(progress);
    talk.result(&json);
    talk.say(&format!(
        "Report: {}",
        a.output.join("report.html").display()
    ));
    Ok(())
}

/// Films against hanging samples.
fn samples(
    a: &Arguments,
    recordings: &[Recording],
    provenance: &Provenance,
    progress: Progress,
    talk: Talk,
) -> Result<(), Failure> {
    let mut models = Vec::new();
    let mut first: Option<SampleOutcome> = None;
    for path in &a.params {
        progress.step(format!("predicting with {}", path.display()));
        let file = load::parameters(path)?;
        let (datasets, samples) = load::samples(recordings, Some(&file))?;
        let refs: Vec<_> = datasets.iter().collect();
        let outcome = validate_samples(&refs, &samples, &file.parameters()?.film)?;
        let sum = FileSum {
            role: "parameters".into(),
            file: path.display().to_string(),
            sha256: crate::recording::sha256(path)?,
        };
        models.push(ModelValidation::of_samples(&outcome, sum));
        talk.say(&format!("{}: {}", path.display(), outcome.verdict));
        for r in &outcome.recordings {
            talk.say(&format!(
                "  {:20} {:8.2} V rms above 1 kV (noise alone {:.2} V); stroke {:.3} mm, predicted {:.3} mm",
                r.id,
                r.error.rmse_v,
                r.error.noise_floor_v,
                r.stroke_m[0] * 1e3,
                r.stroke_m[1] * 1e3
            ));
        }
        first.get_or_insert(outcome);
        progress.stopped()?;
    }
    let shown = first.ok_or("no parameter file was given")?;
    let head = models.remove(0);
    let json = ValidationJson::new(head, models, provenance.clone());
    let mut set = OutputSet::new(&a.output)?;
    set.write("validation.json", to_text(&json))?;
    set.write("report.html", html::render_samples(&shown, provenance))?;
    set.commit()?;
    drop(progress);
    talk.result(&json);
    talk.say(&format!(
        "Report: {}",
        a.output.join("report.html").display()
    ));
    Ok(())
}

/// Speed below which the robot counts as holding, m/s.
const HOLDING_M_S: f64 = 2e-3;

/// Predicted output force where nothing touches the robot but what the recording declares: it should be zero. By phase.
fn force_errors(
    robot: &Robot,
    dataset: &Dataset,
    parameters: &Parameters,
    offset_s: f64,
) -> Result<Vec<ForceErrors>, Failure> {
    let force = predict_force(robot, dataset, parameters, offset_s)?;
    let track = dataset.track();
    let edge = (0.3 / dataset.step_s).round() as usize;
    let n = dataset.samples();
    let size = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut out = Vec::new();
    for (phase, holding) in [("hold", true), ("move", false)] {
        let chosen: Vec<f64> = (edge..n.saturating_sub(edge))
            .filter(|&i| {
                dataset.captured(i) && (size(track.velocity_m_s[i]) < HOLDING_M_S) == holding
            })
            .map(|i| size(force[i]))
            .filter(|f| !f.is_nan())
            .collect();
        let count = chosen.len();
        out.push(ForceErrors {
            phase: phase.into(),
            rmse_mn: finite(
                1e3 * (chosen.iter().map(|f| f * f).sum::<f64>() / count as f64).sqrt(),
            ),
            max_mn: finite(1e3 * chosen.iter().copied().fold(f64::NEG_INFINITY, f64::max)),
            rmse_relative: None,
            n_frames: count,
        });
    }
    Ok(out)
}

/// Height between the lowest and the highest pose, mm.
fn stroke_mm(dataset: &Dataset) -> f64 {
    let z = &dataset.axes[2].position;
    let high = z.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = z.iter().copied().fold(f64::INFINITY, f64::min);
    1e3 * (high - low)
}
