//! LVM, the text files of LabVIEW's measurement blocks.
//!
//! ```text
//! LabVIEW Measurement
//! key <separator> value ...            Separator, Decimal_Separator, X_Columns, ...
//! ***End_of_Header***
//! ( Channels, Samples, Y_Unit_Label, X0, Delta_X, ...      one value a channel
//!   ***End_of_Header***
//!   X_Value <separator> names ... Comment
//!   rows )*                             a segment; several may follow each other
//! ```
//!
//! `X_Columns` says where the time stands: nowhere (`No`: X0 + row * Delta_X), in the first cell of a row
//! (`One`), or before the value of every channel (`Multi`). Channels that share a clock are one section.
//! `Samples` is not believed, cells may be empty, and the last cell is a comment, of which only is said how
//! often it was used.

use std::path::Path;

use super::capture::{Capture, Column, Importer, Note, ReadOptions, RowLines, Section};
use super::error::{Error, ErrorKind, quote};
use super::text::{
    Cells, Delimiter, LineReader, Notation, NumberColumn, Trouble, bad_cell, decode, is_blank,
    texts,
};
use crate::units::Unit;

/// The importer of LVM files.
pub struct Lvm;

impl Importer for Lvm {
    fn name(&self) -> &'static str {
        "lvm"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        head.trim_ascii_start().starts_with(b"LabVIEW Measurement")
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Capture, Error> {
        let mut lines = LineReader::open(path, options.encoding.as_deref())?;
        let mut file = Reader {
            delimiter: Delimiter::Tab,
            decimal: None,
            x: XColumns::One,
            sections: Vec::new(),
            notes: Vec::new(),
            number: 0,
        };
        file.header(&mut lines)?;
        while file.segment(&mut lines)? {}
        if file.sections.is_empty() {
            return Err(
                Error::new(ErrorKind::NoData, path, "the file has headers and no rows")
                    .expected("rows of numbers below the second ***End_of_Header***")
                    .action("take the recording again"),
            );
        }
        Ok(Capture {
            format: "lvm",
            sections: file.sections,
            notes: file.notes,
        })
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum XColumns {
    No,
    One,
    Multi,
}

const END: &[u8] = b"***End_of_Header***";

struct Reader {
    delimiter: Delimiter,
    decimal: Option<Notation>,
    x: XColumns,
    sections: Vec<Section>,
    notes: Vec<Note>,
    /// Columns of the file so far.
    number: usize,
}

/// The header of a segment: its keys that are used, one value a channel.
#[derive(Default)]
struct Head {
    line: u64,
    channels: usize,
    samples: Vec<f64>,
    units: Vec<String>,
    dimensions: Vec<String>,
    x0: Vec<f64>,
    delta: Vec<f64>,
}

impl Head {
    /// The times of a channel's rows, where no column has them.
    fn stamps(&self, channel: usize, rows: usize) -> Vec<f64> {
        let at = |list: &[f64], other: f64| {
            list.get(channel)
                .copied()
                .filter(|v| v.is_finite())
                .unwrap_or(other)
        };
        let (x0, delta) = (at(&self.x0, 0.0), at(&self.delta, f64::NAN));
        (0..rows).map(|i| x0 + i as f64 * delta).collect()
    }

    /// A section without columns, after so many others.
    fn section(&self, before: usize, lines: &RowLines) -> Section {
        Section {
            name: match before {
                0 => "table".to_owned(),
                n => format!("table {}", n + 1),
            },
            line: self.line,
            lines: lines.clone(),
            ..Section::default()
        }
    }
}

/// The rate of the first two stamps.
fn rate(section: &Section) -> Option<f64> {
    let stamps = section.stamps_s.as_ref()?;
    let step = stamps.get(1)? - stamps.first()?;
    (step > 0.0).then_some(1.0 / step)
}

impl Reader {
    fn header(&mut self, lines: &mut LineReader) -> Result<(), Error> {
        while lines.advance()? {
            let line = lines.line();
            if line.starts_with(END) {
                return Ok(());
            }
            // the separator is not known before it is named, and is written as a word
            let key_end = line
                .iter()
                .position(|b| matches!(b, b'\t' | b',' | b';'))
                .unwrap_or(line.len());
            let key = line[..key_end].trim_ascii();
            let rest = line.get(key_end + 1..).unwrap_or_default();
            let value = decode(rest).trim_matches(['\t', ' ']).to_owned();
            match key {
                b"Separator" => {
                    self.delimiter = match value.to_ascii_lowercase().as_str() {
                        "comma" | "," => Delimiter::Comma,
                        "semicolon" | ";" => Delimiter::Semicolon,
                        "tab" | "" => Delimiter::Tab,
                        other => {
                            return Err(Error::new(
                                ErrorKind::Grammar,
                                lines.path(),
                                format!("found {}", quote(other)),
                            )
                            .at_line(lines.number())
                            .expected("Separator Tab, Comma or Semicolon"));
                        }
                    };
                }
                b"Decimal_Separator" => {
                    self.decimal = match rest.trim_ascii().first() {
                        Some(b',') => Some(Notation::Comma),
                        Some(b'.') => Some(Notation::Dot),
                        _ => None,
                    };
                }
                b"X_Columns" => {
                    self.x = match value.to_ascii_lowercase().as_str() {
                        "no" => XColumns::No,
                        "multi" => XColumns::Multi,
                        _ => XColumns::One,
                    };
                }
                _ => {}
            }
        }
        Err(Error::new(
            ErrorKind::NoData,
            lines.path(),
            "the file ends in its header",
        )
        .at_line(lines.number())
        .expected("***End_of_Header***")
        .action("the file was cut; take the recording again"))
    }

    fn numbers(&self, cells: &[String]) -> Vec<f64> {
        cells
            .iter()
            .map(|c| {
                NumberColumn::new(self.delimiter, self.decimal.unwrap_or(Notation::Dot))
                    .parse(c.as_bytes())
                    .unwrap_or(f64::NAN)
            })
            .collect()
    }

    /// One segment; false at the end of the file.
    fn segment(&mut self, lines: &mut LineReader) -> Result<bool, Error> {
        let mut head = Head::default();
        let mut begun = false;
        loop {
            if !lines.advance()? {
                if begun {
                    self.notes.push(
                        Note::warning(lines.path(), "the file ends in the header of a segment")
                            .at_line(lines.number()),
                    );
                }
                return Ok(false);
            }
            if is_blank(lines.line()) {
                continue;
            }
            if lines.line().starts_with(END) {
                break;
            }
            begun = true;
            let mut cells = texts(lines.line(), self.delimiter);
            let key = if cells.is_empty() {
                String::new()
            } else {
                cells.remove(0)
            };
            head.line = if head.line == 0 {
                lines.number()
            } else {
                head.line
            };
            // with a column X of its own each channel has two cells
            if self.x == XColumns::Multi && key != "Channels" {
                cells = cells.into_iter().step_by(2).collect();
            }
            match key.as_str() {
                "Channels" => {
                    head.channels = cells.first().and_then(|c| c.parse().ok()).unwrap_or(0);
                }
                "Samples" => head.samples = self.numbers(&cells),
                "Y_Unit_Label" => head.units = cells,
                "X_Dimension" => head.dimensions = cells,
                "X0" => head.x0 = self.numbers(&cells),
                "Delta_X" => head.delta = self.numbers(&cells),
                _ => {}
            }
        }
        self.rows(lines, &head)?;
        Ok(true)
    }

    /// The row of names and the rows of numbers. Leaves the reader behind the blank line or at the file's
    /// end.
    fn rows(&mut self, lines: &mut LineReader, head: &Head) -> Result<(), Error> {
        let path = lines.path().to_owned();
        // a blank line may stand before the names
        let mut found = lines.advance()?;
        while found && is_blank(lines.line()) {
            found = lines.advance()?;
        }
        if !found {
            return Ok(());
        }
        let names = texts(lines.line(), self.delimiter);
        let not_utf8 = std::str::from_utf8(lines.line()).is_err();
        let comment = names.iter().position(|n| n == "Comment");
        let last = comment.unwrap_or(names.len());
        // cells of X and of values
        let values: Vec<usize> = match self.x {
            XColumns::Multi => (0..last).skip(1).step_by(2).collect(),
            _ => (1..last).collect(),
        };
        if values.is_empty() || (head.channels != 0 && head.channels > values.len()) {
            return Err(Error::new(
                ErrorKind::Grammar,
                &path,
                format!("{} channels have names", values.len()),
            )
            .at_line(lines.number())
            .expected(format!("{} channels as the header says", head.channels))
            .action("export the file again"));
        }
        let width = last;
        let notation = self.decimal.unwrap_or(Notation::Dot);
        let mut readers: Vec<NumberColumn> = (0..width)
            .map(|_| NumberColumn::new(self.delimiter, notation))
            .collect();
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); width];
        let mut row_lines = RowLines::default();
        let mut comments = 0usize;
        'rows: while lines.advance()? {
            if is_blank(lines.line()) {
                break;
            }
            let rows = row_lines.len();
            for (i, cell) in Cells::new(lines.line(), self.delimiter).enumerate() {
                if i >= width {
                    comments += usize::from(comment == Some(i) && !cell.bytes.is_empty());
                    continue;
                }
                // without an X column the first cell is empty
                if i == 0 && self.x == XColumns::No {
                    continue;
                }
                match readers[i].parse(cell.bytes) {
                    Ok(v) => columns[i].push(v),
                    // LabVIEW writes these for what it could not measure
                    Err(Trouble::NotFinite) => columns[i].push(f64::NAN),
                    Err(trouble) => {
                        if lines.ended_with_newline() {
                            return Err(bad_cell(
                                &path,
                                lines.number(),
                                i + 1,
                                cell.bytes,
                                trouble,
                            ));
                        }
                        columns.iter_mut().for_each(|c| c.truncate(rows));
                        self.notes.push(Note::warning(
                            &path,
                            "the file ends in the middle of a row, which is dropped",
                        ));
                        break 'rows;
                    }
                }
            }
            row_lines.push(lines.number());
            for c in &mut columns {
                c.resize(row_lines.len(), f64::NAN);
            }
        }
        let rows = row_lines.len();
        if rows == 0 {
            return Ok(());
        }
        self.describe(&path, head, rows, not_utf8, comments);
        self.split(&path, head, &names, &values, columns, &row_lines);
        Ok(())
    }

    fn describe(&mut self, path: &Path, head: &Head, rows: usize, not_utf8: bool, comments: usize) {
        let mut say = |level: fn(&Path, String) -> Note, text: String| {
            self.notes.push(level(path, text).at_line(head.line));
        };
        say(Note::info, format!("a segment of {rows} rows"));
        let most = head.samples.iter().copied().fold(0.0, f64::max);
        // one header may stand above rows that were written one by one: more of them than it says are no
        // contradiction there
        let contradicts = match self.x {
            XColumns::One => most > rows as f64,
            _ => most > 0.0 && most != rows as f64,
        };
        if contradicts {
            say(
                Note::warning,
                format!("the header says {most} samples, {rows} rows are there"),
            );
        }
        if comments > 0 {
            say(Note::info, format!("{comments} comments are left out"));
        }
        if not_utf8 {
            say(
                Note::info,
                "names are not UTF-8; read as Latin-1".to_owned(),
            );
        }
    }

    /// Columns that share a clock become a section.
    fn split(
        &mut self,
        path: &Path,
        head: &Head,
        names: &[String],
        values: &[usize],
        mut columns: Vec<Vec<f64>>,
        lines: &RowLines,
    ) {
        let mut sections: Vec<(Vec<f64>, Section)> = Vec::new();
        let mut open = Vec::new();
        for (channel, cell) in values.iter().enumerate() {
            let value = std::mem::take(&mut columns[*cell]);
            let name = names.get(*cell).cloned().unwrap_or_default();
            if value.iter().all(|v| v.is_nan()) {
                open.push(name);
                continue;
            }
            let stamps: Vec<f64> = match self.x {
                XColumns::No => head.stamps(channel, lines.len()),
                XColumns::One => columns[0].clone(),
                XColumns::Multi => columns[cell - 1].clone(),
            };
            let same = |t: &Vec<f64>| {
                t.len() == stamps.len()
                    && t.iter()
                        .zip(&stamps)
                        .all(|(a, b)| a.to_bits() == b.to_bits())
            };
            // the clocks of a file are few: the last one is the likely one
            let place = match sections.iter().rposition(|(t, _)| same(t)) {
                Some(place) => place,
                None => {
                    let time = head.dimensions.get(channel).is_none_or(|d| d == "Time");
                    let known = time && stamps.iter().all(|t| t.is_finite());
                    let mut section = head.section(self.sections.len() + sections.len(), lines);
                    section.stamps_s = known.then(|| stamps.clone());
                    if self.x != XColumns::No && !known {
                        self.notes.push(Note::warning(
                            path,
                            format!(
                                "the times of {} are not all there, or are no times",
                                quote(&name)
                            ),
                        ));
                    }
                    sections.push((stamps, section));
                    sections.len() - 1
                }
            };
            // "Volts" is V; what is not known stays as it is written
            let unit = head.units.get(channel).cloned().unwrap_or_default();
            let unit = Unit::parse(&unit).map_or(unit, |u| u.symbol.to_owned());
            sections[place].1.columns.push(Column {
                group: String::new(),
                axis: name,
                unit,
                number: self.number + cell + 1,
                values: value,
            });
        }
        if !open.is_empty() {
            self.notes.push(Note::warning(
                path,
                format!("channels without a value are left out: {}", open.join(", ")),
            ));
        }
        if let XColumns::No = self.x {
            sections.iter_mut().for_each(|(_, s)| s.rate_hz = rate(s));
        }
        self.number += names.len();
        self.sections.extend(sections.into_iter().map(|s| s.1));
    }
}
