//! `ageing`: electrodes over days or batches.

use std::path::PathBuf;

use rayon::prelude::*;

use super::progress::Progress;
use super::resume::Lasting;
use super::{Failure, Talk, load};
use crate::calibration::{
    AgeingInput, AgeingOutcome, AgeingRequest, AgeingSubject, By, ElectrodeAgeing, LevelStroke,
    ageing,
};
use crate::dataset::{Dataset, HangingDataset, cycles};
use crate::model::{HangingSample, Robot};
use crate::recording::{Kind, Recording, Rig};
use crate::report::ageing_json::AgeingJson;
use crate::report::html::{self, number::Quantity};
use crate::report::json::to_text;
use crate::report::output::OutputSet;
use crate::report::parameter_file::{FilmEntry, ForearmEntry, ParameterFile, ageing_effects};
use crate::report::provenance::Provenance;
use crate::report::terminal;

/// What to compare.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// recording.toml files, or folders that have one: hanging samples or robots, with electrode and day (or
    /// batch)
    #[arg(required = true, value_name = "REC")]
    recordings: Vec<PathBuf>,
    /// What tells the recordings of an electrode apart: day, or batch (a new batch against the first)
    #[arg(long, default_value = "day", value_parser = ["day", "batch"])]
    by: String,
    /// Loss of stroke from which a change counts as relevant, %
    #[arg(long, default_value_t = 5.0, value_name = "PERCENT")]
    threshold: f64,
    /// Loss of stroke whose day is told, %
    #[arg(long, default_value_t = 50.0, value_name = "PERCENT")]
    loss: f64,
    /// Cycles of a run over which the stroke is averaged, at most
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u16).range(3..=1000))]
    cycles: u16,
    /// Scatter with which samples are hung, mm, where it is known: 0 for samples that stay in their frames.
    /// Then the position at rest tells causes apart
    #[arg(long, value_name = "MM")]
    mount: Option<f64>,
    /// Rig to use instead of the recordings' own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// In the report, beside the figures of the paper's electrodes
    #[arg(long, value_name = "WITH", value_parser = ["paper"])]
    compare: Option<String>,
    /// Folder for the results
    #[arg(short, long, default_value = "out/ageing")]
    output: PathBuf,
}

pub(super) fn run(a: &Arguments, command: &str, talk: Talk) -> Result<(), Failure> {
    for (name, value) in [("threshold", a.threshold), ("loss", a.loss)] {
        if !(0.0..100.0).contains(&value) {
            return Err(format!("--{name} {value}: give a loss between 0 and 100 %").into());
        }
    }
    if let Some(mount) = a.mount
        && !(0.0..=100.0).contains(&mount)
    {
        return Err(format!("--mount {mount}: give a length between 0 and 100 mm").into());
    }
    let progress = Progress::new(talk);
    let kinds = [Kind::FilmSample, Kind::Robot];
    OutputSet::check(&a.output, &["report.html", "ageing.json"], talk.overwrite())?;
    let recordings = load::recordings_of(&a.recordings, a.rig.as_ref(), &kinds, &progress)?;
    let (recordings, _, copies) = load::distinct(recordings, 0);
    let provenance = Provenance::of(command, &recordings);
    let lasting = Lasting::new(&a.output, &provenance);
    progress.step("aligning");
    let inputs = recordings
        .par_iter()
        .map(input)
        .collect::<Result<Vec<_>, Failure>>()?;
    drop(recordings);
    let request = AgeingRequest {
        by: match a.by.as_str() {
            "batch" => By::Batch,
            _ => By::Day,
        },
        threshold_percent: a.threshold,
        loss_percent: a.loss,
        cycles: a.cycles.into(),
        mount_m: a.mount.map(|mm| mm * 1e-3),
        memory: lasting.memory(),
    };
    progress.step("comparing");
    let mut outcome = ageing(&inputs, &request).map_err(|e| {
        // without its copies there may be too few
        let left_out = copies
            .iter()
            .map(|c| format!("; {}", c.trim_end_matches('.')));
        Failure::from(format!("{e}{}", left_out.collect::<String>()))
    })?;
    outcome.remarks.extend(copies);
    let json = AgeingJson::new(&outcome, provenance.clone());
    let mut set = OutputSet::new(&a.output, talk.overwrite())?;
    let page = html::render_ageing(&outcome, &inputs, &json, a.compare.is_some(), &provenance);
    set.write("report.html", page)?;
    set.write("ageing.json", to_text(&json))?;
    for (name, text) in parameter_files(&outcome, &provenance)? {
        set.write(&name, text)?;
    }
    set.commit()?;
    lasting.done()?;
    drop(progress);
    talk.result(&json);
    talk.answer(&outcome.verdict);
    terminal::columns(&levels(&outcome))
        .iter()
        .for_each(|l| talk.say(l));
    let trends = json.trend.0.iter().map(|(_, trend)| &trend.says);
    let differ = json.difference.iter().map(|d| &d.last.says);
    trends
        .chain(differ)
        .chain(&json.remarks)
        .for_each(|r| talk.tell(r));
    talk.report(&a.output);
    Ok(())
}

/// One row a day of an electrode: stroke and change with 95 % intervals.
fn levels(outcome: &AgeingOutcome) -> Vec<[String; 4]> {
    let what = match outcome.by {
        By::Day => "day ",
        By::Batch => "",
    };
    let row = |e: &ElectrodeAgeing, l: &LevelStroke| {
        let stroke = Quantity::new(l.stroke_mm.value, l.stroke_ci95, "mm");
        let change = Quantity::new(l.change_percent.value, l.percent_ci95, "%");
        [
            format!("{}, {what}{}", e.name, l.name),
            format!("stroke {}", stroke.with_interval()),
            match change.interval.as_str() {
                "" => String::new(),
                _ => format!("change {}", change.with_interval()),
            },
            String::new(),
        ]
    };
    let each = outcome.electrodes.iter();
    each.flat_map(|e| e.levels.iter().map(move |l| row(e, l)))
        .collect()
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
