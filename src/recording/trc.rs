//! TRC files, as OpenSim and Motion Analysis write them.
//!
//! ```text
//! PathFileType  4  (X/Y/Z)  name
//! DataRate  CameraRate  NumFrames  NumMarkers  Units  ...
//! values of these
//! Frame#  Time  marker1  -  -  marker2  -  -
//! -  -  X1  Y1  Z1  X2  Y2  Z2
//! [blank]
//! rows
//! ```
//!
//! Cells are parted by tabs, rarely by commas. NumFrames and NumMarkers may be wrong: the rows and the axis
//! row decide. Columns without a name are called by their number, as `*34`. Empty cells are gaps.

use std::path::Path;

use super::capture::{
    Capture, Column, Group, Importer, Note, ReadOptions, Section, Sink, first_cell,
};
use super::error::{Error, ErrorKind, quote};
use super::rows::{self, Table, no_unit, positive, tell_markers};
use super::text::{Delimiter, LineReader, filled_texts};

/// The importer of TRC files.
pub struct Trc;

impl Importer for Trc {
    fn name(&self) -> &'static str {
        "trc"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        first_cell(head) == b"PathFileType"
    }

    fn stream(
        &self,
        path: &Path,
        options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        rows::stream(self.name(), path, options, sink, |lines, notes| {
            Ok((header(lines, notes)?, false))
        })
    }
}

/// The five rows above the frames.
struct Rows {
    delimiter: Delimiter,
    keys: Vec<String>,
    values: Vec<String>,
    names: Vec<String>,
    axes: Vec<String>,
    /// The line of the names.
    line: u64,
}

impl Rows {
    /// Reads the header up to the row of axes.
    fn read(lines: &mut LineReader) -> Result<Self, Error> {
        let mut next = |what: &str| -> Result<Vec<u8>, Error> {
            if !lines.advance()? {
                return Err(Error::new(
                    ErrorKind::NoData,
                    lines.path(),
                    "the file ends in its header",
                )
                .at_line(lines.number() + 1)
                .expected(what)
                .action("the file was cut; export the trial again"));
            }
            Ok(lines.line().to_vec())
        };
        let mut top = next("the row PathFileType")?;
        while top.iter().all(u8::is_ascii_whitespace) {
            top = next("the row PathFileType")?;
        }
        let keys = next("the row DataRate, CameraRate, ...")?;
        let values = next("the values of DataRate, CameraRate, ...")?;
        let names = next("the row Frame#, Time, marker names")?;
        let axes = next("the row X1, Y1, Z1, ...")?;
        let count = |b: u8| names.iter().filter(|c| **c == b).count();
        let delimiter = if count(b'\t') >= count(b',') {
            Delimiter::Tab
        } else {
            Delimiter::Comma
        };
        if std::str::from_utf8(&names).is_err() {
            lines.note_not_utf8();
        }
        let texts = |row: &[u8]| filled_texts(row, delimiter);
        Ok(Rows {
            delimiter,
            keys: texts(&keys),
            values: texts(&values),
            names: texts(&names),
            axes: texts(&axes),
            line: lines.number() - 1,
        })
    }

    /// What stands below a key.
    fn value(&self, key: &str) -> Option<&str> {
        let at = self.keys.iter().position(|k| k.eq_ignore_ascii_case(key))?;
        let value = self.values.get(at).filter(|v| !v.is_empty());
        value.map(String::as_str)
    }

    /// A number above 0 below a key.
    fn number(&self, key: &str) -> Option<f64> {
        positive(self.value(key)?)
    }

    /// The name above a cell.
    fn name(&self, cell: usize) -> String {
        self.names.get(cell).cloned().unwrap_or_default()
    }
}

fn header(lines: &mut LineReader, notes: &mut Vec<Note>) -> Result<Table, Error> {
    let rows = Rows::read(lines)?;
    let path = lines.path();
    let wrong = |found: &str, expected: &str| {
        Error::new(ErrorKind::Grammar, path, format!("found {}", quote(found)))
            .at_line(rows.line)
            .expected(expected)
            .action("a header row is missing or was edited; export the trial again")
    };
    if !rows.name(0).to_lowercase().starts_with("frame") {
        return Err(wrong(&rows.name(0), "the row that begins with Frame#"));
    }
    let unit = rows.value("Units").unwrap_or_default();
    if unit.is_empty() {
        notes.push(no_unit(path));
    }
    let mut section = Section {
        name: "Trajectories".to_owned(),
        line: rows.line,
        rate_hz: rows.number("DataRate"),
        ..Section::default()
    };
    let unnamed = add_markers(&mut section, &rows, unit);
    let markers = section.groups.len();
    if unnamed == markers {
        return Err(wrong(
            &rows.names.join(" "),
            "marker names after Frame# and Time",
        ));
    }
    if unnamed > 0 {
        notes.push(Note::warning(
            path,
            format!("{unnamed} of {markers} markers have no name; called by their number, as *3"),
        ));
    }
    tell_markers(path, rows.number("NumMarkers"), markers, notes);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let declared = rows.number("NumFrames").map(|n| n as u64);
    let columns = 0..section.columns.len();
    Ok(Table {
        section,
        delimiter: rows.delimiter,
        frame: Some(0),
        time: Some(1),
        slots: [None; FROM].into_iter().chain(columns.map(Some)).collect(),
        zero_is_gap: false,
        grows: true,
        declared,
    })
}

/// The first cell of a marker.
const FROM: usize = 2;

/// Three columns a marker; where there are more columns than names, the row of axes tells. Returns how many
/// have no name.
fn add_markers(section: &mut Section, rows: &Rows, unit: &str) -> usize {
    let markers = (rows.names.len().max(3) - FROM)
        .div_ceil(3)
        .max(rows.axes.len().saturating_sub(FROM) / 3);
    let mut unnamed = 0;
    for m in 0..markers {
        let mut name = rows.name(FROM + 3 * m);
        if name.is_empty() {
            name = format!("*{}", m + 1);
            unnamed += 1;
        }
        section.groups.push(Group {
            name: name.clone(),
            columns: 3 * m..3 * m + 3,
        });
        for (k, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
            section.columns.push(Column {
                group: name.clone(),
                axis: axis.to_owned(),
                unit: unit.to_owned(),
                number: FROM + 3 * m + k + 1,
                values: Vec::new(),
            });
        }
    }
    unnamed
}
