//! `ageing`: electrodes over days or batches.

use std::path::PathBuf;

use super::progress::Progress;
use super::resume::Lasting;
use super::{Failure, Talk, load};
use crate::calibration::{AgeingOutcome, AgeingRequest, By, ElectrodeAgeing, LevelStroke};
use crate::fit::memory::Memory;
use crate::jobs::ageing::{KINDS, ageing, check};
use crate::jobs::load::Given;
use crate::report::html::number::Quantity;
use crate::report::output::OutputSet;
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
    let request = AgeingRequest {
        by: match a.by.as_str() {
            "batch" => By::Batch,
            _ => By::Day,
        },
        threshold_percent: a.threshold,
        loss_percent: a.loss,
        cycles: a.cycles.into(),
        mount_m: a.mount.map(|mm| mm * 1e-3),
        memory: Memory::default(),
    };
    check(&request)?;
    let progress = Progress::new(talk);
    OutputSet::check(&a.output, &["report.html", "ageing.json"], talk.overwrite())?;
    let all = load::recordings_of(&a.recordings, a.rig.as_ref(), &KINDS, &progress)?;
    let given = Given::new(all, 0, command);
    let lasting = Lasting::new(&a.output, &given.provenance);
    let request = AgeingRequest {
        memory: lasting.memory(),
        ..request
    };
    let aged = ageing(given, request, a.compare.is_some(), &progress)?;
    aged.files.stage(&a.output, talk.overwrite())?.commit()?;
    lasting.done()?;
    drop(progress);
    let (outcome, json) = (&aged.outcome, &aged.json);
    talk.result(json);
    talk.answer(&outcome.verdict);
    terminal::columns(&levels(outcome))
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
