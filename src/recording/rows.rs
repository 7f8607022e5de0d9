//! Rows of frames below a header: what the text formats of marker tracks share once their headers are read.

use std::collections::BTreeSet;
use std::path::Path;

use super::capture::{BATCH, Block, Capture, Column, Group, Note, ReadOptions, Section, Sink};
use super::error::{Error, ErrorKind};
use super::text::{
    Cells, Delimiter, LineReader, Notation, NumberColumn, Trouble, is_blank, plain_number,
    says_not_finite, wrong_cell,
};

/// A table whose header is known.
pub(super) struct Table {
    /// Name, rate, groups and columns; the rows are put into it.
    pub section: Section,
    /// What stands between cells.
    pub delimiter: Delimiter,
    /// The cell of the frame number; without one, rows count from 1.
    pub frame: Option<usize>,
    /// The cell of the printed time, s. It says which frame was at 0, and no more: it is rounded.
    pub time: Option<usize>,
    /// For every cell, the column it fills.
    pub slots: Vec<Option<usize>>,
    /// Whether x, y, z all exactly 0 is how the format writes that nothing was seen.
    pub zero_is_gap: bool,
    /// Whether rows may go on beyond the header with markers that have no name.
    pub grows: bool,
    /// Frames that the header declares.
    pub declared: Option<u64>,
}

/// How a table ended.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum End {
    /// With the file.
    File,
    /// A column has to be read again with a decimal comma.
    Reread,
}

/// Reads a file of one table below a header, again where a column turns out to have a decimal comma. `header`
/// gives the table, and whether the reader already stands on its first row.
///
/// # Errors
/// The file does not follow the format, with line and column.
pub(super) fn stream(
    format: &'static str,
    path: &Path,
    options: &ReadOptions,
    sink: &mut dyn Sink,
    header: impl Fn(&mut LineReader, &mut Vec<Note>) -> Result<(Table, bool), Error>,
) -> Result<Capture, Error> {
    let mut comma_cells = BTreeSet::new();
    loop {
        let mut lines = LineReader::open(path, options.encoding.as_deref())?;
        let mut notes = Vec::new();
        let (mut table, here) = header(&mut lines, &mut notes)?;
        if table.read(&mut lines, here, &mut comma_cells, sink, &mut notes)? == End::Reread {
            sink.restart();
            continue;
        }
        return Ok(Capture {
            format,
            sections: vec![table.section],
            notes,
        });
    }
}

#[derive(Default)]
struct Counts {
    rows: u64,
    first: Option<i64>,
    last: i64,
    missing_frames: i64,
    not_finite: u64,
    zeros: u64,
    short: u64,
    cut: bool,
    first_time: Option<(i64, f64)>,
    last_time: (i64, f64),
    off_clock: f64,
    off_clock_line: u64,
}

/// What goes along while the rows are read.
struct Pass {
    numbers: Vec<NumberColumn>,
    block: Block,
    counts: Counts,
    /// The last cell that the header has a column for.
    needed: usize,
}

/// A row whose cells are read.
struct Row {
    frame: f64,
    time: f64,
    width: usize,
    /// The first cell that is wrong; without a trouble it is beyond the header.
    trouble: Option<(usize, Option<Trouble>)>,
}

impl Table {
    /// Reads to the end of the file. With `here`, the reader already stands on the first row.
    pub(super) fn read(
        &mut self,
        lines: &mut LineReader,
        mut here: bool,
        comma_cells: &mut BTreeSet<usize>,
        sink: &mut dyn Sink,
        notes: &mut Vec<Note>,
    ) -> Result<End, Error> {
        let named = self.section.groups.len();
        let mut pass = Pass {
            numbers: self.numbers(comma_cells),
            block: Block::new(self.section.columns.len()),
            counts: Counts::default(),
            needed: self.slots.iter().rposition(Option::is_some).unwrap_or(0),
        };
        while here || lines.advance()? {
            here = false;
            if is_blank(lines.line()) {
                continue;
            }
            let row = self.cells(lines, &mut pass, comma_cells);
            if let Some((cell, Some(Trouble::Reread))) = row.trouble {
                comma_cells.insert(cell);
                return Ok(End::Reread);
            }
            let short = row.width <= pass.needed;
            if (short || row.trouble.is_some()) && !lines.ended_with_newline() {
                pass.counts.cut = true;
                break;
            }
            pass.counts.short += u64::from(short);
            self.keep(lines, &mut pass, row)?;
            if self.section.frames.len() * self.section.columns.len() >= BATCH {
                pass.block.pour(&mut self.section.columns);
                sink.rows(0, &mut self.section);
            }
        }
        pass.block.pour(&mut self.section.columns);
        if pass.counts.rows == 0 {
            return Err(Error::new(
                ErrorKind::NoData,
                lines.path(),
                "there is a header and no row",
            )
            .at_line(lines.number().max(1))
            .action("the file was cut; export the trial again"));
        }
        if self.section.rate_hz.is_none() {
            self.rate_of_times(&pass.counts, lines.path(), notes);
        }
        sink.rows(0, &mut self.section);
        if self.section.groups.len() > named {
            notes.push(Note::warning(
                lines.path(),
                format!(
                    "rows go on beyond the header: {} markers without a name, called by their number",
                    self.section.groups.len() - named
                ),
            ));
        }
        self.tell(lines, &pass, notes);
        Ok(End::File)
    }

    /// A reader for every cell of the header.
    fn numbers(&self, comma_cells: &BTreeSet<usize>) -> Vec<NumberColumn> {
        NumberColumn::row(self.slots.len(), self.delimiter, |cell| {
            comma_cells.contains(&cell)
        })
    }

    /// Reads the cells of a row into the block, up to the first that is wrong.
    #[inline]
    fn cells(&mut self, lines: &LineReader, pass: &mut Pass, commas: &BTreeSet<usize>) -> Row {
        let (mut frame, mut time) = (f64::NAN, f64::NAN);
        let mut trouble = None;
        let mut width = 0;
        let mut cells = Cells::new(lines.line(), self.delimiter);
        let mut row = pass.block.row();
        loop {
            let i = width;
            let Some(number) = pass.numbers.get_mut(i) else {
                // beyond the header
                let mut ahead = cells.clone();
                let Some(cell) = ahead.next() else { break };
                if cell.bytes.is_empty() {
                    cells = ahead;
                    width += 1;
                } else if self.grows {
                    let half = row.to_vec();
                    pass.block.pour(&mut self.section.columns);
                    self.grow(i);
                    let wider = self.numbers(commas);
                    let known = pass.numbers.len();
                    pass.numbers.extend(wider.into_iter().skip(known));
                    pass.block = Block::new(self.section.columns.len());
                    row = pass.block.row();
                    row[..half.len()].copy_from_slice(&half);
                } else {
                    trouble = Some((i, None));
                    break;
                }
                continue;
            };
            let Some(next) = number.next(&mut cells) else {
                break;
            };
            width += 1;
            let value = match next {
                Ok(value) => value,
                Err((t, cell))
                    if t != Trouble::Reread
                        && says_not_finite(cell.bytes)
                        && Some(i) != self.frame =>
                {
                    pass.counts.not_finite += 1;
                    f64::NAN
                }
                Err((t, _)) => {
                    trouble = Some((i, Some(t)));
                    break;
                }
            };
            if Some(i) == self.frame {
                frame = value;
            } else if Some(i) == self.time {
                time = value;
            } else if let Some(column) = self.slots[i] {
                row[column] = value;
            }
        }
        Row {
            frame,
            time,
            width,
            trouble,
        }
    }

    /// Keeps a row in which nothing is wrong.
    #[inline]
    fn keep(&mut self, lines: &mut LineReader, pass: &mut Pass, row: Row) -> Result<(), Error> {
        if let Some((cell, trouble)) = row.trouble {
            let expected = format!("{} cells as in the header", self.slots.len());
            return Err(wrong_cell(lines, self.delimiter, cell, trouble, expected));
        }
        let counts = &mut pass.counts;
        let section = &mut self.section;
        let frame = match self.frame {
            Some(cell) => whole(lines, row.frame, cell, "a frame number")?,
            None => counts.last + 1,
        };
        counts.frame(lines, self.frame, frame)?;
        if counts.rows == 1 && !row.time.is_nan() {
            section.zero_frame = zero_frame(frame, row.time, section.rate_hz);
        }
        counts.time(frame, row.time, section.rate_hz, lines.number());
        section.frames.push(frame);
        section.lines.push(lines.number());
        if self.zero_is_gap {
            let row = pass.block.open();
            for group in &section.groups {
                let values = &mut row[group.columns.clone()];
                if values.len() >= 3 && values[..3] == [0.0; 3] {
                    counts.zeros += 1;
                    values.fill(f64::NAN);
                }
            }
        }
        pass.block.keep(&mut section.columns);
        lines.spend(section.columns.len())
    }

    /// The rate that the printed times have, where the header states none.
    fn rate_of_times(&mut self, counts: &Counts, path: &Path, notes: &mut Vec<Note>) {
        self.section.rate_hz = counts.rate_hz();
        if let (Some(rate_hz), Some((frame, time))) = (self.section.rate_hz, counts.first_time) {
            self.section.zero_frame = zero_frame(frame, time, Some(rate_hz));
            notes.push(Note::warning(
                path,
                format!("no rate is stated; {rate_hz} Hz from the printed times"),
            ));
        }
    }

    /// Adds markers up to a cell; they were not seen in the rows before.
    fn grow(&mut self, cell: usize) {
        let rows = self.section.frames.len();
        let unit = self
            .section
            .columns
            .last()
            .map_or_else(String::new, |c| c.unit.clone());
        while self.slots.len() <= cell {
            let at = self.section.columns.len();
            let name = format!("*{}", self.section.groups.len() + 1);
            for (k, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
                self.slots.push(Some(at + k));
                self.section.columns.push(Column {
                    group: name.clone(),
                    axis: axis.to_owned(),
                    unit: unit.clone(),
                    number: self.slots.len(),
                    values: vec![f64::NAN; rows],
                });
            }
            self.section.groups.push(Group {
                name,
                columns: at..at + 3,
            });
        }
    }

    fn tell(&self, lines: &LineReader, pass: &Pass, notes: &mut Vec<Note>) {
        let counts = &pass.counts;
        let path = lines.path();
        let name = &self.section.name;
        let rows = counts.rows;
        let first = counts.first.unwrap_or(0);
        let mut warn = |text: String| notes.push(Note::warning(path, text));
        if let Some(declared) = self.declared.filter(|d| *d != rows) {
            warn(format!("{declared} frames are declared, {rows} are there"));
        }
        if counts.missing_frames > 0 {
            warn(format!(
                "section {name}: {} frames between {first} and {} are not in the file",
                counts.missing_frames, counts.last
            ));
        }
        if counts.cut {
            warn("the file ends in the middle of a row, which is dropped".to_owned());
        }
        if counts.short > 0 {
            warn(format!(
                "{} rows are shorter than the header; their last cells are taken as empty",
                counts.short
            ));
        }
        if counts.zeros > 0 {
            warn(format!(
                "{} samples are exactly 0, 0, 0, which this format writes for what was not seen; taken as gaps",
                counts.zeros
            ));
        }
        let step = self.section.rate_hz.map_or(f64::NAN, |r| 1.0 / r);
        if counts.off_clock > (0.6 * step).max(1.1e-3) {
            notes.push(
                Note::warning(
                    path,
                    format!(
                        "the printed time is up to {:.4} s away from frame / rate; frames and rate are used",
                        counts.off_clock
                    ),
                )
                .at_line(counts.off_clock_line),
            );
        }
        let mut info = |text: String| notes.push(Note::info(path, text));
        if counts.not_finite > 0 {
            info(format!(
                "{} cells say NaN; taken as gaps",
                counts.not_finite
            ));
        }
        if pass.numbers.iter().any(|n| n.notation() == Notation::Comma) {
            info("numbers have a decimal comma".to_owned());
        }
        info(format!(
            "section {name}: {rows} rows at {} Hz, frames {first} to {}, {} groups",
            self.section.rate_hz.unwrap_or(f64::NAN),
            counts.last,
            self.section.groups.len()
        ));
        if lines.was_not_utf8() {
            info("names are not UTF-8; read as Latin-1".to_owned());
        }
    }
}

/// The frame at time 0, where a frame has a printed time.
pub(super) fn zero_frame(frame: i64, time: f64, rate_hz: Option<f64>) -> Option<i64> {
    let steps = (time * rate_hz?).round();
    #[allow(clippy::cast_possible_truncation)]
    (steps.abs() < 1e12).then(|| frame.saturating_sub(steps as i64))
}

/// The number of a frame or sub-frame, in a cell of the reader's line that counts from 0.
pub(super) fn whole(
    lines: &LineReader,
    value: f64,
    cell: usize,
    expected: &str,
) -> Result<i64, Error> {
    // 2^40 frames at 1 kHz are 34 years
    if value.fract() == 0.0 && (0.0..=1_099_511_627_776.0).contains(&value) {
        #[allow(clippy::cast_possible_truncation)]
        return Ok(value as i64);
    }
    let found = if value.is_nan() {
        "the cell is empty".to_owned()
    } else {
        format!("found {value}")
    };
    Err(Error::new(ErrorKind::BadNumber, lines.path(), found)
        .at_line(lines.number())
        .at_column(cell + 1)
        .expected(expected)
        .action("use the file as it was exported"))
}

impl Counts {
    fn frame(&mut self, lines: &LineReader, cell: Option<usize>, frame: i64) -> Result<(), Error> {
        if self.rows > 0 {
            if frame <= self.last {
                return Err(Error::new(
                    ErrorKind::TimeOrder,
                    lines.path(),
                    format!("frame {frame} follows frame {}", self.last),
                )
                .at_line(lines.number())
                .at_column(cell.unwrap_or(0) + 1)
                .expected("frame numbers that rise")
                .action("delete the repeated rows, or export the trial again"));
            }
            self.missing_frames += frame - self.last - 1;
        }
        self.first.get_or_insert(frame);
        self.last = frame;
        self.rows += 1;
        Ok(())
    }

    fn time(&mut self, frame: i64, time: f64, rate_hz: Option<f64>, line: u64) {
        if time.is_nan() {
            return;
        }
        let (frame0, time0) = *self.first_time.get_or_insert((frame, time));
        self.last_time = (frame, time);
        if let Some(rate_hz) = rate_hz {
            #[allow(clippy::cast_precision_loss)]
            let off = (time - time0 - (frame - frame0) as f64 / rate_hz).abs();
            if off > self.off_clock {
                self.off_clock = off;
                self.off_clock_line = line;
            }
        }
    }

    /// The rate of the printed times.
    fn rate_hz(&self) -> Option<f64> {
        let (frame0, time0) = self.first_time?;
        let (frame1, time1) = self.last_time;
        #[allow(clippy::cast_precision_loss)]
        let rate = (frame1 - frame0) as f64 / (time1 - time0);
        rounded_rate(rate)
    }
}

/// A rate that was told from printed times: to six digits, because times are rounded.
pub(super) fn rounded_rate(rate_hz: f64) -> Option<f64> {
    if !rate_hz.is_finite() || rate_hz <= 0.0 {
        return None;
    }
    format!("{rate_hz:.5e}").parse().ok()
}

/// The number above 0 that a value of a header states.
pub(super) fn positive(value: &str) -> Option<f64> {
    let (value, _) = plain_number(value.as_bytes())?;
    (value.is_finite() && value > 0.0).then_some(value)
}

/// The note where a header states no unit.
pub(super) fn no_unit(path: &Path) -> Note {
    Note::warning(
        path,
        "the unit of the positions is not stated; state it, as in unit = \"mm\"",
    )
}

/// A note where a header declares another number of markers than have columns.
pub(super) fn tell_markers(
    path: &Path,
    declared: Option<f64>,
    markers: usize,
    notes: &mut Vec<Note>,
) {
    if let Some(declared) = declared
        && declared != markers as f64
    {
        notes.push(Note::warning(
            path,
            format!("{declared} markers are declared, {markers} have columns"),
        ));
    }
}
