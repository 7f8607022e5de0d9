//! What the result was made with and from.

use minijinja::context;

use super::page::{Cell, Section, Table};
use super::{FileNote, Provenance};
use crate::calibration::Outcome;

const TEMPLATE: &str = include_str!("provenance.html");

/// See the module.
pub fn section(_: &Outcome, provenance: &Provenance) -> Option<Section> {
    let head = ["of", "file", "role", "SHA-256"].map(Cell::text);
    let mut table = Table::new("Files read, and the SHA-256 of their bytes.", head.to_vec());
    let mut add = |of: &str, file: &FileNote| {
        table.row(vec![
            Cell::text(of),
            Cell::of("file", &file.path),
            Cell::text(&file.role),
            Cell::of("file", &file.sha256),
        ]);
    };
    if let Some(rig) = &provenance.rig {
        add("rig", rig);
    }
    for (id, files) in &provenance.recordings {
        files.iter().for_each(|f| add(id, f));
    }
    let any = !table.rows.is_empty();
    let context = context! {
        version => provenance.program_version.clone(),
        command => provenance.command.clone(),
        generated => provenance.generated.clone().unwrap_or_default(),
        any => any,
        table => table.html(),
    };
    Some(Section::new("provenance", "Provenance", TEMPLATE, context))
}
