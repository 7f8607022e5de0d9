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
use super::rows::{self, Table};
use super::text::{Delimiter, LineReader, filled_texts, plain_number};

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

fn header(lines: &mut LineReader, notes: &mut Vec<Note>) -> Result<Table, Error> {
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
    let texts = |row: &[u8]| filled_texts(row, delimiter);
    let not_utf8 = std::str::from_utf8(&names).is_err();
    let (keys, values) = (texts(&keys), texts(&values));
    let (names, axes) = (texts(&names), texts(&axes));
    if not_utf8 {
        lines.note_not_utf8();
    }
    let path = lines.path();
    let line = lines.number() - 1;
    let wrong = |at: u64, found: &str, expected: &str| {
        Error::new(ErrorKind::Grammar, path, format!("found {}", quote(found)))
            .at_line(at)
            .expected(expected)
            .action("a header row is missing or was edited; export the trial again")
    };
    let cell = |row: &[String], i: usize| row.get(i).cloned().unwrap_or_default();
    if !cell(&names, 0).to_lowercase().starts_with("frame") {
        return Err(wrong(
            line,
            &cell(&names, 0),
            "the row that begins with Frame#",
        ));
    }
    let value = |key: &str| {
        let at = keys.iter().position(|k| k.eq_ignore_ascii_case(key))?;
        values.get(at).filter(|v| !v.is_empty()).cloned()
    };
    let number = |key: &str| {
        let (v, _) = plain_number(value(key)?.as_bytes())?;
        (v.is_finite() && v > 0.0).then_some(v)
    };
    let unit = value("Units").unwrap_or_default();
    if unit.is_empty() {
        notes.push(Note::warning(
            path,
            "the unit of the positions is not stated; state it, as in unit = \"mm\"",
        ));
    }
    let mut section = Section {
        name: "Trajectories".to_owned(),
        line,
        rate_hz: number("DataRate"),
        ..Section::default()
    };
    // three columns a marker; where there are more columns than names, the axis row tells
    let from = 2;
    let markers = (names.len().max(3) - from)
        .div_ceil(3)
        .max(axes.len().saturating_sub(from) / 3);
    let mut slots = vec![None; from];
    let mut unnamed = 0;
    for m in 0..markers {
        let mut name = cell(&names, from + 3 * m);
        if name.is_empty() {
            name = format!("*{}", m + 1);
            unnamed += 1;
        }
        section.groups.push(Group {
            name: name.clone(),
            columns: 3 * m..3 * m + 3,
        });
        for (k, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
            slots.push(Some(3 * m + k));
            section.columns.push(Column {
                group: name.clone(),
                axis: axis.to_owned(),
                unit: unit.clone(),
                number: from + 3 * m + k + 1,
                values: Vec::new(),
            });
        }
    }
    let named = markers - unnamed;
    if named == 0 {
        return Err(wrong(
            line,
            &names.join(" "),
            "marker names after Frame# and Time",
        ));
    }
    if unnamed > 0 {
        notes.push(Note::warning(
            path,
            format!("{unnamed} of {markers} markers have no name; called by their number, as *3"),
        ));
    }
    if let Some(declared) = number("NumMarkers")
        && declared != markers as f64
    {
        notes.push(Note::warning(
            path,
            format!("{declared} markers are declared, {markers} have columns"),
        ));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let declared = number("NumFrames").map(|n| n as u64);
    Ok(Table {
        section,
        delimiter,
        frame: Some(0),
        time: Some(1),
        slots,
        zero_is_gap: false,
        grows: true,
        declared,
    })
}
