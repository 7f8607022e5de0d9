//! What the result was made with and from.

use minijinja::context;

use super::page::{Cell, Section, Table};
use crate::calibration::Outcome;
use crate::report::provenance::{FileSum, Provenance};

const TEMPLATE: &str = include_str!("provenance.html");

/// See the module.
pub fn section(_: &Outcome, provenance: &Provenance) -> Option<Section> {
    Some(of(provenance))
}

/// Recordings that the head of a page names.
const NAMED: usize = 4;

/// What a page is of: rig, recordings, days.
pub fn head(provenance: &Provenance) -> String {
    let mut ids: Vec<&str> = provenance
        .recordings
        .iter()
        .map(|r| r.id.as_str())
        .collect();
    let more = match ids.len() {
        n if n > NAMED + 1 => format!(" and {} more", n - NAMED),
        _ => String::new(),
    };
    if !more.is_empty() {
        ids.truncate(NAMED);
    }
    let days = match provenance.days.as_slice() {
        [] => String::new(),
        [day] => format!("recorded {day}"),
        several => {
            let ends = [several.iter().min(), several.iter().max()];
            let [first, last] = ends.map(|d| d.map_or("", String::as_str));
            format!("recorded {first} to {last}")
        }
    };
    let parts = [provenance.rig_ids.join(", "), ids.join(", ") + &more, days];
    let parts: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    parts.join(" \u{b7} ")
}

/// The section of any job.
pub fn of(provenance: &Provenance) -> Section {
    let head = ["of", "file", "role", "SHA-256"].map(Cell::text);
    let mut table = Table::new("Paths as they were opened.", head.to_vec());
    let mut add = |of: &str, file: &FileSum| {
        table.row(vec![
            Cell::text(of),
            Cell::of("file", &file.file),
            Cell::text(&file.role),
            Cell::of("file", &file.sha256),
        ]);
    };
    if let Some(rig) = &provenance.rig {
        add("rig", rig);
    }
    for recording in &provenance.recordings {
        recording.files.iter().for_each(|f| add(&recording.id, f));
    }
    let any = !table.rows.is_empty();
    let context = context! {
        program => provenance.program.clone(),
        command => provenance.command.clone(),
        any => any,
        table => table.html(),
    };
    Section::new("provenance", "Provenance", TEMPLATE, context)
}
