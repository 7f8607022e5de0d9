//! From paths to what a job works on.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::Failure;
use super::progress::Progress;
use crate::dataset::{Dataset, HangingDataset, Plan};
use crate::model::{Electrode, HangingSample, Robot};
use crate::recording::{Kind, OpenOptions, Recording, Rig, RobotRig};
use crate::report::parameter_file::ParameterFile;
use crate::report::plan_file::read_plan;

/// Opens recordings, all of one kind.
pub(super) fn recordings(
    paths: &[PathBuf],
    rig: Option<&PathBuf>,
    kind: Kind,
    progress: &Progress,
) -> Result<Vec<Recording>, Failure> {
    recordings_of(paths, rig, &[kind], progress)
}

/// Opens recordings, all of one kind, which is among `kinds`.
pub(super) fn recordings_of(
    paths: &[PathBuf],
    rig: Option<&PathBuf>,
    kinds: &[Kind],
    progress: &Progress,
) -> Result<Vec<Recording>, Failure> {
    progress.step(format!("reading {} recording(s)", paths.len()));
    let options = OpenOptions { rig: rig.cloned() };
    let all: Vec<Recording> = paths
        .par_iter()
        .map(|p| Recording::open_with(p, &options))
        .collect::<Result<_, _>>()?;
    for r in &all {
        let kind = r.manifest.kind;
        if !kinds.contains(&kind) {
            let names: Vec<&str> = kinds.iter().map(|k| k.name()).collect();
            let (found, wanted) = (kind.name(), names.join("\" or \""));
            let path = r.path.display();
            return Err(format!(
                "{path}: recording `{}` is of kind \"{found}\", this command works on \"{wanted}\"",
                r.manifest.id
            )
            .into());
        }
    }
    if let Some(other) = all.iter().find(|r| r.manifest.kind != all[0].manifest.kind) {
        return Err(format!(
            "recordings `{}` and `{}` are of kinds \"{}\" and \"{}\": give recordings of one kind at a time",
            all[0].manifest.id,
            other.manifest.id,
            all[0].manifest.kind.name(),
            other.manifest.kind.name()
        )
        .into());
    }
    for (i, r) in all.iter().enumerate() {
        if let Some(earlier) = all[..i].iter().find(|e| e.manifest.id == r.manifest.id) {
            return Err(format!(
                "{} and {} have the same id `{}`: give each recording its own",
                earlier.path.display(),
                r.path.display(),
                r.manifest.id
            )
            .into());
        }
    }
    Ok(all)
}

/// Smooths and aligns robot recordings.
pub(super) fn datasets(
    recordings: &[Recording],
    plan: Option<&PathBuf>,
    progress: &Progress,
) -> Result<Vec<Dataset>, Failure> {
    let plans: Vec<Plan> = plan.map(|p| read_plan(p)).transpose()?.unwrap_or_default();
    progress.step("smoothing and aligning");
    let all = recordings
        .par_iter()
        .map(|r| Dataset::from_recording(r, plans.iter().find(|p| p.recording == r.manifest.id)))
        .collect::<Result<Vec<_>, _>>()?;
    progress.stopped()?;
    Ok(all)
}

/// The rig that all recordings share.
pub(super) fn rig(recordings: &[Recording]) -> Result<&RobotRig, Failure> {
    let mut found: Option<(&Recording, &RobotRig)> = None;
    for r in recordings {
        let Some(Rig::Robot(rig)) = &r.rig else {
            return Err(format!(
                "{}: recording `{}` has no robot rig",
                r.path.display(),
                r.manifest.id
            )
            .into());
        };
        match found {
            None => found = Some((r, rig)),
            Some((first, known)) if known != rig => {
                return Err(format!(
                    "recordings `{}` and `{}` are of different rigs (`{}` and `{}`): fit them apart, or give one with --rig",
                    first.manifest.id, r.manifest.id, known.id, rig.id
                )
                .into());
            }
            Some(_) => {}
        }
    }
    found
        .map(|f| f.1)
        .ok_or_else(|| "no recording was given".into())
}

/// The robot of a rig, with the permittivity of a parameter file where that has one.
pub(super) fn robot(rig: &RobotRig, parameters: Option<&ParameterFile>) -> Result<Robot, Failure> {
    Ok(Robot::from_rig(
        rig,
        parameters.and_then(ParameterFile::eps_r),
    )?)
}

/// Hanging samples, aligned, with geometry and mass of each rig and the electrode of a parameter file where there is one.
pub(super) fn samples(
    recordings: &[Recording],
    parameters: Option<&ParameterFile>,
) -> Result<(Vec<HangingDataset>, Vec<HangingSample>), Failure> {
    let electrode = match parameters {
        Some(file) => file.electrode()?,
        None => Electrode::IDEAL,
    };
    let mut samples = Vec::new();
    let mut datasets = Vec::new();
    for r in recordings {
        let Some(Rig::FilmSample(rig)) = &r.rig else {
            return Err(format!(
                "{}: recording `{}` has no rig of kind \"film-sample\"",
                r.path.display(),
                r.manifest.id
            )
            .into());
        };
        let dataset = HangingDataset::from_recording(r)?;
        let eps_r = parameters.and_then(ParameterFile::eps_r);
        let sample = HangingSample::from_rig(rig, eps_r, dataset.payload_kg)?;
        samples.push(HangingSample {
            electrode,
            ..sample
        });
        datasets.push(dataset);
    }
    Ok((datasets, samples))
}

/// Reads a parameter file.
pub(super) fn parameters(path: &Path) -> Result<ParameterFile, Failure> {
    Ok(ParameterFile::read(path)?)
}
