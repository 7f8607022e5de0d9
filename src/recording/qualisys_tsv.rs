//! TSV exports of Qualisys Track Manager.
//!
//! ```text
//! file   := (KEY tab value (tab value)*)* [column row] row*
//! column := Frame | Time | marker X | marker Y | marker Z     for 3D
//!         | body X | Y | Z | Roll | Pitch | Yaw | Residual | Rot[0] .. Rot[8]     for 6D
//! ```
//!
//! Every key is a word in capitals. Without a column row the names come from MARKER_NAMES. No unit is stated
//! anywhere: the format is in mm and degrees. An empty cell, or 0, 0, 0, is a sample that was not seen.

use std::path::Path;

use super::capture::{
    Capture, Column, Group, Importer, Note, ReadOptions, Section, Sink, first_cell,
};
use super::error::{Error, ErrorKind};
use super::rows::{self, Table, positive, tell_markers};
use super::text::{Delimiter, LineReader, is_blank, plain_number, texts};

/// The importer of Qualisys exports.
pub struct QualisysTsv;

impl Importer for QualisysTsv {
    fn name(&self) -> &'static str {
        "qualisys-tsv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        first_cell(head) == b"NO_OF_FRAMES"
    }

    fn stream(
        &self,
        path: &Path,
        options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        rows::stream(self.name(), path, options, sink, header)
    }
}

/// A word such as NO_OF_FRAMES.
fn is_key(cell: &[u8]) -> bool {
    cell.first().is_some_and(u8::is_ascii_uppercase)
        && cell
            .iter()
            .all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || *b == b'_')
}

/// The rows above the frames: words with their values, and a row of columns or none.
struct Rows {
    keys: Vec<(String, Vec<String>)>,
    columns: Option<Vec<String>>,
    /// The line of the columns.
    line: u64,
    /// The reader stands on the first frame.
    here: bool,
}

impl Rows {
    /// Reads up to the row of columns or the first frame.
    fn read(lines: &mut LineReader) -> Result<Self, Error> {
        let mut rows = Rows {
            keys: Vec::new(),
            columns: None,
            line: 1,
            here: false,
        };
        while lines.advance()? {
            if is_blank(lines.line()) {
                continue;
            }
            let cells = texts(lines.line(), Delimiter::Tab);
            let first = cells.first().map_or("", String::as_str);
            if is_key(first.as_bytes()) {
                let mut values = cells[1..].to_vec();
                while values.last().is_some_and(String::is_empty) {
                    values.pop();
                }
                rows.keys.push((first.to_owned(), values));
            } else if plain_number(first.as_bytes()).is_some() {
                rows.here = true;
                break;
            } else {
                rows.line = lines.number();
                rows.columns = Some(cells);
                break;
            }
        }
        if std::str::from_utf8(lines.line()).is_err() {
            lines.note_not_utf8();
        }
        Ok(rows)
    }

    /// What stands after a word.
    fn values(&self, key: &str) -> &[String] {
        let found = self.keys.iter().find(|k| k.0 == key);
        found.map_or(&[][..], |k| &k.1)
    }

    /// A number above 0 after a word.
    fn number(&self, key: &str) -> Option<f64> {
        positive(self.values(key).first()?)
    }

    /// The columns that the names of markers or bodies stand for.
    fn columns_of_names(&self, bodies: bool) -> Vec<String> {
        let axes: &[&str] = if bodies { &SIX } else { &["X", "Y", "Z"] };
        self.values(if bodies { "BODY_NAMES" } else { "MARKER_NAMES" })
            .iter()
            .flat_map(|n| axes.iter().map(move |a| format!("{n} {a}")))
            .collect()
    }
}

fn header(lines: &mut LineReader, notes: &mut Vec<Note>) -> Result<(Table, bool), Error> {
    let mut rows = Rows::read(lines)?;
    let path = lines.path();
    let bodies = rows
        .values("DATA_INCLUDED")
        .first()
        .is_some_and(|d| d == "6D");
    let columns = rows
        .columns
        .take()
        .unwrap_or_else(|| rows.columns_of_names(bodies));
    let mut section = Section {
        name: "Trajectories".to_owned(),
        line: rows.line,
        rate_hz: rows.number("FREQUENCY"),
        ..Section::default()
    };
    let (mut frame, mut time) = (None, None);
    let mut slots = Vec::with_capacity(columns.len());
    for (cell, title) in columns.iter().enumerate() {
        let mut slot = None;
        if title == "Frame" && section.groups.is_empty() {
            frame = Some(cell);
        } else if title == "Time" && section.groups.is_empty() {
            time = Some(cell);
        } else if !title.is_empty() {
            slot = add_column(&mut section, cell, title);
        }
        slots.push(slot);
    }
    if section.columns.is_empty() {
        return Err(Error::new(ErrorKind::NoData, path, "no marker is named")
            .at_line(lines.number().max(1))
            .expected("MARKER_NAMES, or a row of columns such as hand_top X")
            .action("export the trial again with its trajectories"));
    }
    notes.push(Note::info(
        path,
        "no unit is stated; Qualisys writes mm and degrees",
    ));
    let declared = rows.number(if bodies {
        "NO_OF_BODIES"
    } else {
        "NO_OF_MARKERS"
    });
    tell_markers(path, declared, section.groups.len(), notes);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let declared = rows.number("NO_OF_FRAMES").map(|n| n as u64);
    let table = Table {
        section,
        delimiter: Delimiter::Tab,
        frame,
        time,
        slots,
        zero_is_gap: true,
        grows: false,
        declared,
    };
    Ok((table, rows.here))
}

/// Adds a column: `marker X` begins a marker, `Y` goes on with it; a marker's name may have spaces. Returns
/// its place.
fn add_column(section: &mut Section, cell: usize, title: &str) -> Option<usize> {
    let (name, axis) = match title.rsplit_once(' ') {
        Some((name, axis)) if SIX.contains(&axis) => (name.trim(), axis),
        _ => ("", title),
    };
    let goes_on = section
        .groups
        .last()
        .is_some_and(|g| (name.is_empty() || g.name == name) && axis != "X");
    let at = section.columns.len();
    if !goes_on {
        let name = if name.is_empty() { title } else { name };
        section.groups.push(Group {
            name: name.to_owned(),
            columns: at..at,
        });
    }
    let group = section.groups.last_mut()?;
    group.columns.end = at + 1;
    let unit = match axis {
        "X" | "Y" | "Z" | "Residual" => "mm",
        "Roll" | "Pitch" | "Yaw" => "deg",
        _ => "",
    };
    section.columns.push(Column {
        group: group.name.clone(),
        axis: axis.to_owned(),
        unit: unit.to_owned(),
        number: cell + 1,
        values: Vec::new(),
    });
    Some(at)
}

/// The columns of a body.
const SIX: [&str; 16] = [
    "X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", "Rot[0]", "Rot[1]", "Rot[2]", "Rot[3]",
    "Rot[4]", "Rot[5]", "Rot[6]", "Rot[7]", "Rot[8]",
];
