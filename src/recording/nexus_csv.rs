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
        let header = Header::read(lines, name)?;
        let index = self.sections.len();
        let width = header.cells.len();
        let mut section = Section {
            name: name.to_owned(),
            line: header.line,
            rate_hz: Some(header.rate_hz),
            groups: header.groups,
            columns: header.columns,
            ..Section::default()
        };
        let mut numbers = NumberColumn::row(width, header.delimiter, |cell| {
            self.comma_columns.contains(&(index, cell))
        });
        let mut block = Block::new(section.columns.len());
        let mut rows = Rows::default();
        let end = loop {
            if !lines.advance()? {
                break End::File;
            }
            if is_blank(lines.line()) {
                break End::Blank;
            }
            let first = lines.line().first();
            if first.is_some_and(|b| b.is_ascii_alphabetic() || *b == b'"')
                && let Some(next) = name_row(lines.line())
            {
                break End::Name(next);
            }
            let mut width_found = 0;
            let mut frame = f64::NAN;
            let mut sub_frame = f64::NAN;
            let mut trouble = None;
            let mut frame_only = true;
            let row = block.row();
            let mut cells = Cells::new(lines.line(), header.delimiter);
            loop {
                let i = width_found;
                let Some(number) = numbers.get_mut(i) else {
                    let Some(cell) = cells.next() else { break };
                    width_found += 1;
                    frame_only &= cell.bytes.is_empty();
                    if !cell.bytes.is_empty() {
                        trouble = Some((i, None));
                        break;
                    }
                    continue;
                };
                let Some(next) = number.next(&mut cells) else {
                    break;
                };
                width_found += 1;
                match next {
                    Ok(value) => match i {
                        0 => frame = value,
                        1 => sub_frame = value,
                        _ => {
                            frame_only &= value.is_nan();
                            if let Some(column) = header.cells[i] {
                                row[column] = value;
                            } else if !value.is_nan() {
                                trouble = Some((i, None));
                                break;
                            }
                        }
                    },
                    Err((Trouble::Reread, _)) => {
                        self.comma_columns.insert((index, i));
                        return Ok(End::Reread);
                    }
                    Err((t, _)) => {
                        frame_only &= i < 2;
                        trouble = Some((i, Some(t)));
                        break;
                    }
                }
            }
            let number = lines.number();
            // a row of the frame number alone is whole, unless it is where the file was cut
            let short = width_found < width && !(frame_only && lines.ended_with_newline());
            if (short || trouble.is_some()) && !lines.ended_with_newline() {
                self.notes.push(
                    Note::warning(
                        lines.path(),
                        format!(
                            "section {name}: the file ends in the middle of a row, which is dropped ({width_found} cells of {width})"
                        ),
                    )
                    .at_line(number),
                );
                break End::File;
            }
            if let Some((cell, trouble)) = trouble {
                let expected = format!("{width} cells as in the header of section {name}");
                return Err(wrong_cell(lines, header.delimiter, cell, trouble, expected));
            }
            if short {
                return Err(Error::new(
                    ErrorKind::CellCount,
                    lines.path(),
                    format!("found {width_found} cells"),
                )
                .at_line(number)
                .expected(format!("{width} as in the header of section {name}"))
                .action("a row was cut; delete it or export the trial again"));
            }
            rows.push(lines, &mut section, frame, sub_frame)?;
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
        let mut row = |what: &str| -> Result<(u64, Vec<u8>), Error> {
            let here = lines.number() + 1;
            if !lines.advance()? {
                return Err(Error::new(ErrorKind::NoData, lines.path(), "the file ends")
                    .at_line(here)
                    .expected(format!("{what} of section {name}"))
                    .action("export the trial again"));
            }
            Ok((lines.number(), lines.line().to_vec()))
        };
        let rate = row("the rate")?;
        let group_row = row("the group names")?;
        let axis_row = row("the row Frame, Sub Frame, axes")?;
        let units = row("the units")?;
        let path = lines.path().to_owned();
        let wrong = |at: u64, found: &[u8], expected: &str| {
            Error::new(
                ErrorKind::Grammar,
                &path,
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
        let delimiter = [Delimiter::Comma, Delimiter::Semicolon, Delimiter::Tab]
            .into_iter()
            .find(|d| {
                let mut cells = Cells::new(&axis_row.1, *d);
                cells
                    .next()
                    .is_some_and(|c| c.bytes.eq_ignore_ascii_case(b"Frame"))
                    && cells
                        .next()
                        .is_some_and(|c| c.bytes.eq_ignore_ascii_case(b"Sub Frame"))
            })
            .ok_or_else(|| {
                wrong(
                    axis_row.0,
                    &axis_row.1,
                    "Frame and Sub Frame parted by comma, semicolon or tab",
                )
            })?;

        let mut not_utf8 = false;
        let mut texts = |row: &[u8]| -> Vec<String> {
            not_utf8 |= std::str::from_utf8(row).is_err();
            text::texts(row, delimiter)
        };
        let names = texts(&group_row.1);
        let axes = texts(&axis_row.1);
        let units = texts(&units.1);
        if not_utf8 {
            lines.note_not_utf8();
        }
        let last = |row: &[String]| row.iter().rposition(|c| !c.is_empty()).map_or(0, |i| i + 1);
        let width = last(&names).max(last(&axes)).max(last(&units)).max(2);
        let at = |row: &[String], i: usize| row.get(i).cloned().unwrap_or_default();

        let mut cells = vec![None; 2];
        let mut groups: Vec<Group> = Vec::new();
        let mut columns: Vec<Column> = Vec::new();
        for i in 2..width {
            let (group, axis, unit) = (at(&names, i), at(&axes, i), at(&units, i));
            if group.is_empty() && axis.is_empty() && unit.is_empty() {
                cells.push(None);
                continue;
            }
            if !group.is_empty() || groups.is_empty() {
                if group.is_empty() {
                    return Err(Error::new(
                        ErrorKind::Grammar,
                        &path,
                        format!("column {} ({}) has no name above it", i + 1, quote(&axis)),
                    )
                    .at_line(group_row.0)
                    .at_column(i + 1)
                    .expected("a marker or device name at the first column of each group")
                    .action("a header row is missing or was edited; export the trial again"));
                }
                groups.push(Group {
                    name: group,
                    columns: columns.len()..columns.len(),
                });
            }
            cells.push(Some(columns.len()));
            if let Some(group) = groups.last_mut() {
                columns.push(Column {
                    group: group.name.clone(),
                    axis,
                    unit,
                    number: i + 1,
                    values: Vec::new(),
                });
                group.columns.end = columns.len();
            }
        }
        if columns.is_empty() {
            return Err(Error::new(
                ErrorKind::NoData,
                &path,
                format!("section {name} has no columns"),
            )
            .at_line(group_row.0)
            .action("export the trial again with its markers"));
        }
        Ok(Header {
            line,
            rate_hz,
            delimiter,
            cells,
            groups,
            columns,
        })
    }
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
