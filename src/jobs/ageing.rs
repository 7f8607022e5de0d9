//! `ageing`: electrodes over days or batches.

use rayon::prelude::*;

use super::load::Given;
use super::{Failure, Files, Progress};
use crate::calibration::{
    AgeingInput, AgeingOutcome, AgeingRequest, AgeingSubject, By, ageing as compare,
};
use crate::dataset::{Dataset, HangingDataset, cycles};
use crate::model::{HangingSample, Robot};
use crate::recording::{Kind, Recording, Rig};
use crate::report::ageing_json::AgeingJson;
use crate::report::html;
use crate::report::json::to_text;
use crate::report::parameter_file::{FilmEntry, ForearmEntry, ParameterFile, ageing_effects};
use crate::report::provenance::Provenance;

/// Kinds of recordings whose ageing can be told.
pub const KINDS: [Kind; 2] = [Kind::FilmSample, Kind::Robot];

/// What a comparison of electrodes found.
pub struct Aged {
    /// All of its numbers.
    pub json: AgeingJson,
    /// The same as it was found.
    pub outcome: AgeingOutcome,
    /// `report.html`, `ageing.json`, and `parameters.toml` of every sample or robot on every level in a
    /// folder of its own.
    pub files: Files,
}

/// Compares electrodes over days or batches, as the request says; with `paper` the report has the figures of
/// the paper's electrodes beside.
///
/// # Errors
/// A loss or a scatter that cannot be meant; recordings without a rig, or too few of an electrode.
pub fn ageing(
    given: Given,
    request: AgeingRequest,
    paper: bool,
    progress: &Progress,
) -> Result<Aged, Failure> {
    progress.step("aligning");
    let Given {
        recordings,
        copies,
        provenance,
        ..
    } = given;
    let inputs = recordings
        .par_iter()
        .map(input)
        .collect::<Result<Vec<_>, Failure>>()?;
    drop(recordings);
    progress.step("comparing");
    let request = AgeingRequest {
        memory: request.memory.until(progress.stop()),
        ..request
    };
    let mut outcome = compare(&inputs, &request).map_err(|e| {
        // without its copies there may be too few
        let left_out = copies
            .iter()
            .map(|c| format!("; {}", c.trim_end_matches('.')));
        Failure::from(format!("{e}{}", left_out.collect::<String>()))
    })?;
    outcome.remarks.extend(copies);
    let json = AgeingJson::new(&outcome, provenance.clone());
    let page = html::render_ageing(&outcome, &inputs, &json, paper, &provenance);
    let mut files = Files::default();
    files.add("report.html", page);
    files.add("ageing.json", to_text(&json));
    for (name, text) in parameter_files(&outcome, &provenance)? {
        files.add(name, text);
    }
    Ok(Aged {
        json,
        outcome,
        files,
    })
}

/// Whether the figures of a request can be meant.
///
/// # Errors
/// The first that cannot, as the option that states it.
pub fn check(request: &AgeingRequest) -> Result<(), Failure> {
    for (name, value) in [
        ("threshold", request.threshold_percent),
        ("loss", request.loss_percent),
    ] {
        if !(0.0..100.0).contains(&value) {
            return Err(format!("--{name} {value}: give a loss between 0 and 100 %").into());
        }
    }
    if let Some(mount_m) = request.mount_m
        && !(0.0..=0.1).contains(&mount_m)
    {
        let mount = mount_m * 1e3;
        return Err(format!("--mount {mount}: give a length between 0 and 100 mm").into());
    }
    Ok(())
}

/// A recording as ageing sees it: x of a sample, height of a robot.
fn input(r: &Recording) -> Result<AgeingInput, Failure> {
    let m = &r.manifest;
    if m.kind == Kind::Robot {
        let Some(Rig::Robot(rig)) = &r.rig else {
            return Err(format!(
                "{}: recording `{}` has no rig of kind \"robot\"",
                r.path.display(),
                m.id
            )
            .into());
        };
        let robot = Robot::from_rig(rig, None)?;
        let d = Dataset::from_recording(r, None)?;
        let end_s = d.time_s(d.samples() - 1);
        return Ok(AgeingInput {
            id: m.id.clone(),
            electrode: m.electrode.clone(),
            batch: m.batch.clone(),
            day: m.day,
            x_m: d.measured_m.iter().map(|p| -p[2]).collect(),
            start_s: d.start_s,
            step_s: d.step_s,
            cycles: cycles(&d.voltage, d.offset_s, d.start_s, end_s),
            command_v: (0..d.samples())
                .map(|i| d.command_v(0, i, d.offset_s))
                .collect(),
            subject: AgeingSubject::Robot(Box::new(d), Box::new(robot)),
        });
    }
    let Some(Rig::FilmSample(rig)) = &r.rig else {
        return Err(format!(
            "{}: recording `{}` has no rig of kind \"film-sample\"",
            r.path.display(),
            m.id
        )
        .into());
    };
    let d = HangingDataset::from_recording(r)?;
    let sample = HangingSample::from_rig(rig, None, d.payload_kg)?;
    let end_s = d.time_s(d.samples() - 1);
    Ok(AgeingInput {
        id: m.id.clone(),
        electrode: m.electrode.clone(),
        batch: m.batch.clone(),
        day: m.day,
        x_m: d.x_m.clone(),
        start_s: d.start_s,
        step_s: d.step_s,
        cycles: cycles(&d.voltage, d.offset_s, d.start_s, end_s),
        command_v: (0..d.samples())
            .map(|i| d.voltage.at(0, d.time_s(i) + d.offset_s))
            .collect(),
        subject: AgeingSubject::Sample(Box::new(d), sample),
    })
}

/// Film, forearms and electrode of every sample or robot on every level:
/// `<electrode>[-<sample>]-<level>/parameters.toml`.
fn parameter_files(
    outcome: &AgeingOutcome,
    provenance: &Provenance,
) -> Result<Vec<(String, String)>, Failure> {
    let safe = |text: &str| -> String {
        text.chars()
            .map(|c| match c {
                c if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') => c,
                _ => '_',
            })
            .collect()
    };
    let what = match outcome.by {
        By::Day => "day-",
        By::Batch => "",
    };
    let mut out = Vec::new();
    for e in &outcome.electrodes {
        for s in &e.samples {
            let Ok(joint) = &s.joint else { continue };
            for (i, &level) in s.levels.iter().enumerate() {
                let own = &joint.levels[i];
                let mut film = joint.film.clone();
                film.mu_pa.iter_mut().for_each(|mu| *mu *= own.film_factor);
                let file = ParameterFile {
                    film: Some(FilmEntry::of(&film, Some(own.eps_r), &[])),
                    forearm: joint.forearm.as_ref().map(ForearmEntry::of),
                    effects: ageing_effects(joint, i),
                    provenance: provenance.clone(),
                    ..ParameterFile::default()
                };
                let mut folder = safe(&e.name);
                if e.samples.len() > 1 {
                    folder += &format!("-{}", safe(&s.name));
                }
                let name = safe(&e.levels[level].name);
                out.push((
                    format!("{folder}-{what}{name}/parameters.toml"),
                    file.to_toml()?,
                ));
            }
        }
    }
    Ok(out)
}
