//! From paths to what a job works on.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::Failure;
use super::progress::Progress;
use crate::dataset::{Dataset, Plan};
use crate::model::Robot;
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
    progress.step(format!("reading {} recording(s)", paths.len()));
    let options = OpenOptions { rig: rig.cloned() };
    let all: Vec<Recording> = paths
        .par_iter()
        .map(|p| Recording::open_with(p, &options))
        .collect::<Result<_, _>>()?;
    for r in &all {
        if r.manifest.kind != kind {
            let (found, wanted) = (r.manifest.kind.name(), kind.name());
            let path = r.path.display();
            return Err(format!(
                "{path}: recording `{}` is of kind \"{found}\", this command works on \"{wanted}\"",
                r.manifest.id
            )
            .into());
        }
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

/// Reads a parameter file.
pub(super) fn parameters(path: &Path) -> Result<ParameterFile, Failure> {
    Ok(ParameterFile::read(path)?)
}
