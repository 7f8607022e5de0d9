//! CSV exports of Vicon Nexus (and Tracker, which writes the same rows).
//!
//! ```text
//! file    := blank* section (blank+ section)* blank*
//! section := NAME row, RATE row, GROUP row, AXIS row, UNIT row, data row*
//! ```
//!
//! A section ends at a blank row, at the name of another section, or at the end of the file. The rate is the
//! section's own: devices are sampled several times a frame, and `Sub Frame` counts those samples. A name in
//! the group row covers the columns up to the next name. Frame f was taken at (f - 1)/rate, sub-frame s of n
//! at (f - 1 + s/n)/frame rate.
//!
//! The delimiter is the one between `Frame` and `Sub Frame`. Files saved again by a spreadsheet pad every row
//! to the same width; files cut while being written may end in half a row, which is dropped with a note.

use std::collections::BTreeSet;
use std::path::Path;

use super::capture::{
    BATCH, Block, Capture, Column, Group, Importer, Note, ReadOptions, Section, Sink, first_cell,
};
use super::error::{Error, ErrorKind, quote};
use super::rows::whole;
use super::text::{
    self, Cells, Delimiter, LineReader, Notation, NumberColumn, Trouble, decode, is_blank,
    wrong_cell,
};

/// Names that a section may have. `Events` is a list of words and is left out with a note.
const SECTIONS: [&str; 7] = [
    "Trajectories",
    "Devices",
    "Model Outputs",
    "Joints",
    "Segments",
    "Objects",
    "Events",
];

/// The importer of Vicon Nexus exports.
pub struct NexusCsv;

impl Importer for NexusCsv {
    fn name(&self) -> &'static str {
        "nexus-csv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        section_name(first_cell(head)).is_some_and(|name| name != "Objects")
    }

    fn stream(
        &self,
        path: &Path,
        options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        read_sections(self.name(), path, options, sink)
    }
}

/// The importer of Vicon Tracker exports: the same rows, section `Objects`. Rotations are handed over as they
/// stand.
pub struct TrackerCsv;

impl Importer for TrackerCsv {
    fn name(&self) -> &'static str {
        "tracker-csv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        section_name(first_cell(head)) == Some("Objects")
    }

    fn stream(
        &self,
        path: &Path,
        options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        read_sections(self.name(), path, options, sink)
    }
}

fn section_name(cell: &[u8]) -> Option<&'static str> {
    SECTIONS
        .into_iter()
        .find(|name| name.as_bytes().eq_ignore_ascii_case(cell))
}

/// A row that holds a section's name and nothing else.
fn name_row(line: &[u8]) -> Option<&'static str> {
    let cell = first_cell(line);
    let name = section_name(cell)?;
    let letters = |bytes: &[u8]| {
        bytes
            .iter()
            .filter(|b| !matches!(b, b',' | b';' | b'\t' | b' ' | b'"'))
            .count()
    };
    (letters(line) == letters(cell)).then_some(name)
}

/// Reads until no column has to be read again in another notation.
fn read_sections(
    format: &'static str,
    path: &Path,
    options: &ReadOptions,
    sink: &mut dyn Sink,
) -> Result<Capture, Error> {
    let mut comma_columns = BTreeSet::new();
    loop {
        let mut lines = LineReader::open(path, options.encoding.as_deref())?;
        let mut pass = Pass {
            comma_columns: &mut comma_columns,
            sections: Vec::new(),
            notes: Vec::new(),
            sink,
        };
        if pass.read(&mut lines)? == Outcome::Reread {
            sink.restart();
            continue;
        }
        let Pass {
            sections,
            mut notes,
            ..
        } = pass;
        if lines.was_not_utf8() {
            notes.push(Note::info(path, "names are not UTF-8; read as Latin-1"));
        }
        return Ok(Capture {
            format,
            sections,
            notes,
        });
    }
}

#[derive(PartialEq, Eq)]
enum Outcome {
    Done,
    Reread,
}

/// How a section ended.
enum End {
    /// With the file.
    File,
    /// At a blank row.
    Blank,
    /// At the name of the next section.
    Name(&'static str),
    /// A column has to be read again.
    Reread,
}

struct Pass<'a> {
    /// (section, cell) of columns whose dots part thousands or whose decimal mark is a comma.
    comma_columns: &'a mut BTreeSet<(usize, usize)>,
    sections: Vec<Section>,
    notes: Vec<Note>,
    sink: &'a mut dyn Sink,
}

impl Pass<'_> {
    fn read(&mut self, lines: &mut LineReader) -> Result<Outcome, Error> {
        let mut next = None;
        loop {
            let name = match next.take() {
                Some(name) => name,
                None => match self.find_name(lines)? {
                    Some(name) => name,
                    None => break,
                },
            };
            let end = if name == "Events" {
                self.skip_events(lines)?
            } else {
                self.read_section(lines, name)?
            };
            match end {
                End::File => break,
                End::Blank => {}
                End::Name(name) => next = Some(name),
                End::Reread => return Ok(Outcome::Reread),
            }
        }
        if self.sections.is_empty() {
            return Err(Error::new(
                ErrorKind::NoData,
                lines.path(),
                "there is no section with data",
            )
            .expected("a section such as Trajectories or Devices")
            .action("export the trial again with its trajectories"));
        }
        Ok(Outcome::Done)
    }

    /// Skips blank rows up to the name of a section.
    fn find_name(&mut self, lines: &mut LineReader) -> Result<Option<&'static str>, Error> {
        while lines.advance()? {
            if is_blank(lines.line()) {
                continue;
            }
            return match name_row(lines.line()) {
                Some(name) => Ok(Some(name)),
                None => Err(Error::new(
                    ErrorKind::Grammar,
                    lines.path(),
                    format!("found {}", quote(&decode(first_cell(lines.line())))),
                )
                .at_line(lines.number())
                .at_column(1)
                .expected(format!("the name of a section ({})", SECTIONS.join(", ")))
                .action(
                    "use the file as Nexus exported it, header rows included; a plain table of numbers needs format = \"csv\" and numbered columns",
                )),
            };
        }
        Ok(None)
    }

    fn skip_events(&mut self, lines: &mut LineReader) -> Result<End, Error> {
        let first = lines.number();
        let mut rows: usize = 0;
        let mut end = End::File;
        while lines.advance()? {
            if is_blank(lines.line()) {
                end = End::Blank;
                break;
            }
            if let Some(name) = name_row(lines.line()) {
                end = End::Name(name);
                break;
            }
            rows += 1;
        }
        // the first two rows are the rate and the header
        self.notes.push(
            Note::info(
                lines.path(),
                format!(
                    "section Events: {} events left out, they are no samples",
                    rows.saturating_sub(2)
                ),
            )
            .at_line(first),
        );
        Ok(end)
    }

    fn read_section(&mut self, lines: &mut LineReader, name: &'static str) -> Result<End, Error> {
        let mut header = Header::read(lines, name)?;
        let index = self.sections.len();
        let mut section = Section {
            name: name.to_owned(),
            line: header.line,
            rate_hz: Some(header.rate_hz),
            groups: std::mem::take(&mut header.groups),
            columns: std::mem::take(&mut header.columns),
            ..Section::default()
        };
        let mut numbers = NumberColumn::row(header.cells.len(), header.delimiter, |cell| {
            self.comma_columns.contains(&(index, cell))
        });
        let mut block = Block::new(section.columns.len());
        let mut rows = Rows::default();
        let end = loop {
            if !lines.advance()? {
                break End::File;
            }
            if let Some(end) = end_at(lines.line()) {
                break end;
            }
            let row = Row::read(lines.line(), &header, &mut numbers, block.row());
            if let Some((cell, Some(Trouble::Reread))) = row.trouble {
                self.comma_columns.insert((index, cell));
                return Ok(End::Reread);
            }
            if let Some(cut) = row.check(lines, &header, name)? {
                self.notes.push(cut);
                break End::File;
            }
            rows.push(lines, &mut section, row.frame, row.sub_frame)?;
            block.keep(&mut section.columns);
            lines.spend(section.columns.len())?;
            if section.frames.len() * section.columns.len() >= BATCH {
                block.pour(&mut section.columns);
                self.sink.rows(index, &mut section);
            }
        };
        block.pour(&mut section.columns);
        if rows.count == 0 {
            return Err(Error::new(
                ErrorKind::NoData,
                lines.path(),
                format!("section {name} has a header and no rows"),
            )
            .at_line(header.line)
            .action("export the trial again with its data"));
        }
        rows.finish(lines.path(), &mut section, &mut self.notes);
        self.sink.rows(index, &mut section);
        if header.delimiter != Delimiter::Comma {
            self.notes.push(Note::info(
                lines.path(),
                format!(
                    "section {name}: cells are parted by {}",
                    header.delimiter.name()
                ),
            ));
        }
        if numbers.iter().any(|n| n.notation() == Notation::Comma) {
            self.notes.push(Note::info(
                lines.path(),
                format!("section {name}: numbers have a decimal comma"),
            ));
        }
        self.sections.push(section);
        Ok(end)
    }
}

/// Whether a section ends before this row.
fn end_at(line: &[u8]) -> Option<End> {
    if is_blank(line) {
        return Some(End::Blank);
    }
    line.first()
        .filter(|b| b.is_ascii_alphabetic() || **b == b'"')
        .and_then(|_| name_row(line))
        .map(End::Name)
}

/// The cells of a row but for those of its columns.
struct Row {
    width: usize,
    frame: f64,
    sub_frame: f64,
    /// Nothing but the frame and the sub-frame is there.
    frame_only: bool,
    /// The first cell that is wrong; without a trouble no column takes it.
    trouble: Option<(usize, Option<Trouble>)>,
}

impl Row {
    /// Reads a row up to the first cell that is wrong; `values` is of the columns.
    #[inline]
    fn read(
        line: &[u8],
        header: &Header,
        numbers: &mut [NumberColumn],
        values: &mut [f64],
    ) -> Self {
        let mut row = Row {
            width: 0,
            frame: f64::NAN,
            sub_frame: f64::NAN,
            frame_only: true,
            trouble: None,
        };
        let mut cells = Cells::new(line, header.delimiter);
        loop {
            let i = row.width;
            let Some(number) = numbers.get_mut(i) else {
                let Some(cell) = cells.next() else { break };
                row.width += 1;
                row.frame_only &= cell.bytes.is_empty();
                if !cell.bytes.is_empty() {
                    row.trouble = Some((i, None));
                    break;
                }
                continue;
            };
            let Some(next) = number.next(&mut cells) else {
                break;
            };
            row.width += 1;
            match next {
                Ok(value) if i == 0 => row.frame = value,
                Ok(value) if i == 1 => row.sub_frame = value,
                Ok(value) => {
                    row.frame_only &= value.is_nan();
                    if let Some(column) = header.cells[i] {
                        values[column] = value;
                    } else if !value.is_nan() {
                        row.trouble = Some((i, None));
                        break;
                    }
                }
                Err((t, _)) => {
                    row.frame_only &= i < 2;
                    row.trouble = Some((i, Some(t)));
                    break;
                }
            }
        }
        row
    }

    /// Refuses a row that is wrong; where the file was cut in it, that is a note.
    #[inline]
    fn check(
        &self,
        lines: &LineReader,
        header: &Header,
        name: &str,
    ) -> Result<Option<Note>, Error> {
        let (found, width) = (self.width, header.cells.len());
        // a row of the frame number alone is whole, unless it is where the file was cut
        let short = found < width && !(self.frame_only && lines.ended_with_newline());
        if (short || self.trouble.is_some()) && !lines.ended_with_newline() {
            let text = format!(
                "section {name}: the file ends in the middle of a row, which is dropped ({found} cells of {width})"
            );
            return Ok(Some(
                Note::warning(lines.path(), text).at_line(lines.number()),
            ));
        }
        if let Some((cell, trouble)) = self.trouble {
            let expected = format!("{width} cells as in the header of section {name}");
            return Err(wrong_cell(lines, header.delimiter, cell, trouble, expected));
        }
        if short {
            return Err(Error::new(
                ErrorKind::CellCount,
                lines.path(),
                format!("found {found} cells"),
            )
            .at_line(lines.number())
            .expected(format!("{width} as in the header of section {name}"))
            .action("a row was cut; delete it or export the trial again"));
        }
        Ok(None)
    }
}

/// The five rows above the data.
struct Header {
    line: u64,
    rate_hz: f64,
    delimiter: Delimiter,
    /// For every cell of a row, which column it fills; the first two are Frame and Sub Frame.
    cells: Vec<Option<usize>>,
    groups: Vec<Group>,
    columns: Vec<Column>,
}

impl Header {
    fn read(lines: &mut LineReader, name: &str) -> Result<Header, Error> {
        let line = lines.number();
        let rate = header_row(lines, name, "the rate")?;
        let group_row = header_row(lines, name, "the group names")?;
        let axis_row = header_row(lines, name, "the row Frame, Sub Frame, axes")?;
        let units = header_row(lines, name, "the units")?;
        let wrong = |at: u64, found: &[u8], expected: &str| {
            Error::new(
                ErrorKind::Grammar,
                lines.path(),
                format!("found {}", quote(&decode(found))),
            )
            .at_line(at)
            .at_column(1)
            .expected(format!("{expected} of section {name}"))
            .action("a header row is missing or was edited; export the trial again")
        };

        let rate_cell = first_cell(&rate.1);
        let rate_hz = NumberColumn::new(Delimiter::Tab, Notation::Dot)
            .parse(rate_cell)
            .ok()
            .filter(|r| *r > 0.0)
            .ok_or_else(|| wrong(rate.0, rate_cell, "the rate in Hz"))?;

        let frame_cell = first_cell(&axis_row.1);
        if !frame_cell.eq_ignore_ascii_case(b"Frame") {
            return Err(wrong(
                axis_row.0,
                frame_cell,
                "the row that begins with Frame",
            ));
        }
        let delimiter = delimiter(&axis_row.1).ok_or_else(|| {
            wrong(
                axis_row.0,
                &axis_row.1,
                "Frame and Sub Frame parted by comma, semicolon or tab",
            )
        })?;
        let rows = [&group_row.1, &axis_row.1, &units.1];
        if rows.iter().any(|row| std::str::from_utf8(row).is_err()) {
            lines.note_not_utf8();
        }
        let mut header = Header {
            line,
            rate_hz,
            delimiter,
            cells: vec![None; 2],
            groups: Vec::new(),
            columns: Vec::new(),
        };
        header
            .add_columns(rows.map(|row| text::texts(row, delimiter)))
            .map_err(|(column, axis)| {
                Error::new(
                    ErrorKind::Grammar,
                    lines.path(),
                    format!("column {column} ({}) has no name above it", quote(&axis)),
                )
                .at_line(group_row.0)
                .at_column(column)
                .expected("a marker or device name at the first column of each group")
                .action("a header row is missing or was edited; export the trial again")
            })?;
        if header.columns.is_empty() {
            return Err(Error::new(
                ErrorKind::NoData,
                lines.path(),
                format!("section {name} has no columns"),
            )
            .at_line(group_row.0)
            .action("export the trial again with its markers"));
        }
        Ok(header)
    }

    /// Fills cells, groups and columns; fails at a column, counted from 1, with an axis and no name.
    fn add_columns(
        &mut self,
        [names, axes, units]: [Vec<String>; 3],
    ) -> Result<(), (usize, String)> {
        let last = |row: &[String]| row.iter().rposition(|c| !c.is_empty()).map_or(0, |i| i + 1);
        let width = last(&names).max(last(&axes)).max(last(&units));
        let at = |row: &[String], i: usize| row.get(i).cloned().unwrap_or_default();
        for i in 2..width {
            let (group, axis, unit) = (at(&names, i), at(&axes, i), at(&units, i));
            if group.is_empty() && axis.is_empty() && unit.is_empty() {
                self.cells.push(None);
                continue;
            }
            let column = self.columns.len();
            if !group.is_empty() {
                self.groups.push(Group {
                    name: group,
                    columns: column..column,
                });
            }
            let Some(group) = self.groups.last_mut() else {
                return Err((i + 1, axis));
            };
            group.columns.end = column + 1;
            self.cells.push(Some(column));
            self.columns.push(Column {
                group: group.name.clone(),
                axis,
                unit,
                number: i + 1,
                values: Vec::new(),
            });
        }
        Ok(())
    }
}

/// The next row and its line.
fn header_row(lines: &mut LineReader, section: &str, what: &str) -> Result<(u64, Vec<u8>), Error> {
    let here = lines.number() + 1;
    if !lines.advance()? {
        return Err(Error::new(ErrorKind::NoData, lines.path(), "the file ends")
            .at_line(here)
            .expected(format!("{what} of section {section}"))
            .action("export the trial again"));
    }
    Ok((lines.number(), lines.line().to_vec()))
}

/// What parts the cells of the row that begins with Frame and Sub Frame.
fn delimiter(axis_row: &[u8]) -> Option<Delimiter> {
    [Delimiter::Comma, Delimiter::Semicolon, Delimiter::Tab]
        .into_iter()
        .find(|d| {
            let mut cells = Cells::new(axis_row, *d);
            ["Frame", "Sub Frame"].iter().all(|name| {
                cells
                    .next()
                    .is_some_and(|c| c.bytes.eq_ignore_ascii_case(name.as_bytes()))
            })
        })
}

/// Frame numbers of the rows so far: they rise, sub-frames within them.
#[derive(Default)]
struct Rows {
    count: usize,
    first: i64,
    last: Option<(i64, i64)>,
    missing_frames: i64,
    largest_sub: Option<u32>,
    rows_without_sub: usize,
}

impl Rows {
    fn push(
        &mut self,
        lines: &LineReader,
        section: &mut Section,
        frame: f64,
        sub_frame: f64,
    ) -> Result<(), Error> {
        let frame = whole(lines, frame, 0, "a frame number")?;
        let sub = if sub_frame.is_nan() {
            self.rows_without_sub += 1;
            0
        } else {
            let sub = whole(lines, sub_frame, 1, "a sub-frame number from 0")?;
            let sub = u32::try_from(sub).unwrap_or(u32::MAX - 1);
            self.largest_sub = Some(self.largest_sub.unwrap_or(0).max(sub));
            sub
        };
        if let Some((last_frame, last_sub)) = self.last {
            if (frame, i64::from(sub)) <= (last_frame, last_sub) {
                return Err(Error::new(
                    ErrorKind::TimeOrder,
                    lines.path(),
                    format!("frame {frame} (sub-frame {sub}) follows frame {last_frame} (sub-frame {last_sub})"),
                )
                .at_line(lines.number())
                .at_column(1)
                .expected("frame numbers that rise")
                .action("delete the repeated rows, or export the trial again"));
            }
            self.missing_frames += (frame - last_frame - 1).max(0);
        } else {
            self.first = frame;
        }
        self.count += 1;
        self.last = Some((frame, i64::from(sub)));
        section.frames.push(frame);
        section.sub_frames.push(sub);
        section.lines.push(lines.number());
        Ok(())
    }

    /// Closes the section and says what is in it.
    fn finish(self, path: &Path, section: &mut Section, notes: &mut Vec<Note>) {
        section.subframes_per_frame = self.largest_sub.map(|n| n + 1);
        if self.largest_sub.is_none() {
            section.sub_frames.clear();
        }
        let name = &section.name;
        let rows = self.count;
        let first = self.first;
        let last = self.last.map_or(0, |l| l.0);
        let per_frame = section.subframes_per_frame.unwrap_or(1);
        let mut text = format!(
            "section {name}: {rows} rows at {} Hz, frames {first} to {last}",
            section.rate_hz.unwrap_or(f64::NAN)
        );
        if per_frame > 1 {
            text += &format!(", {per_frame} samples a frame");
        }
        text += &format!(", {} groups", section.groups.len());
        notes.push(Note::info(path, text).at_line(section.line));

        let declared = (last - first + 1).saturating_mul(i64::from(per_frame));
        if per_frame > 1 && self.missing_frames == 0 && declared != rows as i64 {
            notes.push(Note::warning(
                path,
                format!("section {name}: {rows} rows found where {declared} would fill frames {first} to {last}"),
            ));
        }
        if self.missing_frames > 0 {
            notes.push(Note::warning(
                path,
                format!(
                    "section {name}: {} frames between {first} and {last} are not in the file",
                    self.missing_frames
                ),
            ));
        }
        if self.rows_without_sub > 0 && self.largest_sub.is_some() {
            notes.push(Note::warning(
                path,
                format!(
                    "section {name}: {} rows have no sub-frame, taken as 0",
                    self.rows_without_sub
                ),
            ));
        }
    }
}
