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

/// The section of any job.
pub fn of(provenance: &Provenance) -> Section {
    let head = ["of", "file", "role", "SHA-256"].map(Cell::text);
    let mut table = Table::new("Files read, and the SHA-256 of their bytes.", head.to_vec());
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
