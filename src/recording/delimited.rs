//! Plain tables of numbers: commas, semicolons, tabs or spaces; with a header, a row of units, or neither.
//!
//! Where the data begin is told by the columns that are numbers in most rows: the first row in which each of
//! them holds a number or nothing. The row above is the header, or the units and the one above it the header.
//! What stands above that (instrument settings, blank lines) is passed over and said. A table without a
//! header is read only when its columns are asked for by number. A cell that is empty, or says NaN, is a gap;
//! infinity is an error.

use std::collections::BTreeSet;
use std::path::Path;

use super::capture::{
    BATCH, Block, Capture, Column, ColumnRef, Importer, Note, ReadOptions, Section, Sink,
    is_foreign, unknown_column,
};
use super::error::{Error, ErrorKind, quote};
use super::text::{
    Cells, Delimiter, LineReader, Notation, NumberColumn, Trouble, bad_cell, decode, filled_texts,
    is_blank, says_missing, says_not_finite,
};
use crate::units::{Dimension, Unit};

/// The importer of plain tables.
pub struct Delimited;

impl Importer for Delimited {
    fn name(&self) -> &'static str {
        "csv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        let control = |b: &u8| *b < b' ' && !matches!(b, b'\t' | b'\n' | b'\r' | 0x0c);
        !is_foreign(head) && !head.iter().any(control)
    }

    fn stream(
        &self,
        path: &Path,
        options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        let open = || LineReader::open(path, options.encoding.as_deref());
        read_lines(path, &open, &Delimiter::ALL, options, sink)
    }
}

/// Reads a table from its lines, which `open` gives, again where a column turns out to have a decimal comma.
/// What parts its cells is one of `delimiters`.
///
/// # Errors
/// As [`Importer::stream`].
pub(super) fn read_lines(
    path: &Path,
    open: &dyn Fn() -> Result<LineReader, Error>,
    delimiters: &[Delimiter],
    options: &ReadOptions,
    sink: &mut dyn Sink,
) -> Result<Capture, Error> {
    let mut comma_columns = BTreeSet::new();
    loop {
        let lines = open()?;
        if let Some(capture) =
            read_once(path, lines, delimiters, options, &mut comma_columns, sink)?
        {
            return Ok(capture);
        }
        sink.restart();
    }
}

/// What stands above the columns of a table.
pub(super) struct Headers {
    /// As many as there are; empty without a header.
    pub names: Vec<String>,
    /// Cells of a row.
    pub width: usize,
}

/// The names of a table's columns, from the beginning of its lines.
///
/// # Errors
/// There is no row of numbers.
pub(super) fn headers(
    path: &Path,
    mut lines: LineReader,
    delimiters: &[Delimiter],
) -> Result<Headers, Error> {
    let layout = layout(path, &sample(path, &mut lines)?, delimiters)?;
    Ok(Headers {
        names: layout.header.map_or(Vec::new(), |h| h.names),
        width: layout.width,
    })
}

/// How many bytes and lines decide on the layout.
const SAMPLE_BYTES: usize = 64 * 1024;
const SAMPLE_LINES: usize = 1000;

/// A line of the beginning of the file.
struct Line {
    number: u64,
    bytes: Vec<u8>,
    ended: bool,
}

/// What the beginning of the file tells.
struct Layout {
    delimiter: Delimiter,
    /// Whether it was told from the file, and is worth a word.
    told: bool,
    /// Index of the first data row in the sample.
    data: usize,
    /// Cells in it.
    width: usize,
    /// Which cells are numbers in most rows.
    numeric: Vec<bool>,
    header: Option<Header>,
}

struct Header {
    line: u64,
    names: Vec<String>,
    units: Vec<String>,
}

/// The lines that decide on the layout.
fn sample(path: &Path, lines: &mut LineReader) -> Result<Vec<Line>, Error> {
    let mut sample: Vec<Line> = Vec::new();
    let mut bytes = 0;
    while bytes < SAMPLE_BYTES && sample.len() < SAMPLE_LINES && lines.advance()? {
        bytes += lines.line().len() + 1;
        sample.push(Line {
            number: lines.number(),
            bytes: lines.line().to_vec(),
            ended: lines.ended_with_newline(),
        });
    }
    if sample.iter().all(|l| is_blank(&l.bytes)) {
        return Err(
            Error::new(ErrorKind::Empty, path, "the file is empty").action("export it again")
        );
    }
    Ok(sample)
}

fn read_once(
    path: &Path,
    mut lines: LineReader,
    delimiters: &[Delimiter],
    options: &ReadOptions,
    comma_columns: &mut BTreeSet<usize>,
    sink: &mut dyn Sink,
) -> Result<Option<Capture>, Error> {
    let sample = sample(path, &mut lines)?;
    let layout = layout(path, &sample, delimiters)?;
    let mut notes = Vec::new();
    let mut table = Table::new(path, options, &layout, comma_columns, &mut notes)?;

    let mut cut = false;
    for line in &sample[layout.data..] {
        match table.row(path, &line.bytes, line.number, line.ended)? {
            Row::Read => {}
            Row::Reread => return Ok(None),
            Row::Cut => cut = true,
        }
        table.show(sink, false);
    }
    while lines.advance()? {
        match table.row(
            path,
            lines.line(),
            lines.number(),
            lines.ended_with_newline(),
        )? {
            Row::Read => {}
            Row::Reread => return Ok(None),
            Row::Cut => cut = true,
        }
        table.show(sink, false);
    }
    table.show(sink, true);
    table.describe(path, &layout, &sample, cut, &mut notes);
    Ok(Some(Capture {
        format: "csv",
        sections: vec![table.section],
        notes,
    }))
}

/// Whether a cell looks like a number in any notation, so that its column is one of numbers.
fn looks_numeric(cell: &[u8], delimiter: Delimiter) -> bool {
    !cell.is_empty()
        && (says_not_finite(cell)
            || matches!(
                NumberColumn::new(delimiter, Notation::Dot).parse(cell),
                Ok(_) | Err(Trouble::Reread | Trouble::Contradiction | Trouble::NotFinite)
            ))
}

fn layout(path: &Path, sample: &[Line], delimiters: &[Delimiter]) -> Result<Layout, Error> {
    let shapes: Vec<(Delimiter, Shape)> = delimiters
        .iter()
        .map(|d| (*d, columns_of_numbers(sample, *d)))
        .collect();
    // "0,5" is one number between tabs and two between commas: several columns win over one that has not
    // twice as many
    let several = shapes
        .iter()
        .filter(|(_, s)| s.width > 1)
        .map(|(_, s)| s.score)
        .max();
    let single = shapes
        .iter()
        .filter(|(_, s)| s.width == 1)
        .map(|(_, s)| s.score)
        .max();
    let alone = several.unwrap_or(0) * 2 < single.unwrap_or(0);
    // the most numbers; the first of equals
    let best = shapes
        .into_iter()
        .filter(|(_, s)| (s.width > 1) != alone)
        .rev()
        .max_by_key(|(_, s)| s.score);
    let (delimiter, width, numeric) = best.map_or((Delimiter::Comma, 0, Vec::new()), |(d, s)| {
        (d, s.width, s.numeric)
    });
    let last_number = numeric.iter().rposition(|n| *n);
    let Some(last_number) = last_number else {
        let first = sample.iter().find(|l| !is_blank(&l.bytes));
        return Err(
            Error::new(ErrorKind::NoData, path, "no row of numbers is in the file")
                .at_line(first.map_or(1, |l| l.number))
                .expected("a table with a row of numbers below its header")
                .action("export the file again with its data"),
        );
    };
    let is_data = |line: &Line| {
        if is_blank(&line.bytes) {
            return false;
        }
        let mut any = false;
        let mut count = 0;
        for (i, cell) in Cells::new(&line.bytes, delimiter).enumerate() {
            count += 1;
            if numeric.get(i) == Some(&true) && !cell.bytes.is_empty() {
                if !looks_numeric(cell.bytes, delimiter) {
                    return false;
                }
                any = true;
            }
        }
        any && count > last_number
    };
    let data = sample.iter().position(is_data).unwrap_or(sample.len() - 1);
    let width = Cells::new(&sample[data].bytes, delimiter)
        .count()
        .min(width.max(last_number + 1))
        .max(last_number + 1);
    Ok(Layout {
        delimiter,
        told: delimiters.len() > 1,
        data,
        width,
        header: header(&sample[..data], delimiter, &numeric),
        numeric,
    })
}

struct Shape {
    score: usize,
    width: usize,
    numeric: Vec<bool>,
}

/// Which cells are numbers in most rows of the commonest width, and how many numbers there are in all.
fn columns_of_numbers(sample: &[Line], delimiter: Delimiter) -> Shape {
    // numbers and texts in each cell, by the width of the row
    let mut widths: Vec<(usize, usize)> = Vec::new();
    let mut rows: Vec<(usize, Vec<(bool, bool)>)> = Vec::new();
    for line in sample.iter().filter(|l| !is_blank(&l.bytes)) {
        let cells: Vec<(bool, bool)> = Cells::new(&line.bytes, delimiter)
            .map(|c| (looks_numeric(c.bytes, delimiter), c.bytes.is_empty()))
            .collect();
        if !cells.iter().any(|c| c.0) {
            continue;
        }
        match widths.iter_mut().find(|(w, _)| *w == cells.len()) {
            Some((_, n)) => *n += 1,
            None => widths.push((cells.len(), 1)),
        }
        rows.push((cells.len(), cells));
    }
    // the commonest; the first of equals
    let width = widths
        .iter()
        .rev()
        .max_by_key(|(_, n)| *n)
        .map_or(0, |(w, _)| *w);
    let mut numbers = vec![0usize; width];
    let mut texts = vec![0usize; width];
    let mut last = vec![false; width];
    for (_, cells) in rows.iter().filter(|(w, _)| *w == width) {
        for (i, (number, empty)) in cells.iter().enumerate() {
            numbers[i] += usize::from(*number);
            texts[i] += usize::from(!*number && !*empty);
            last[i] = *number;
        }
    }
    let numeric: Vec<bool> = (0..width)
        .map(|i| numbers[i] > texts[i] || (numbers[i] == texts[i] && last[i]))
        .collect();
    let score = numbers
        .iter()
        .zip(&numeric)
        .filter(|(_, is)| **is)
        .map(|(n, _)| n)
        .sum();
    Shape {
        score,
        width,
        numeric,
    }
}

/// A unit as a cell of a unit row or a header writes it: `kV`, `(kV)`, `[kV]`.
fn bare_unit(text: &str) -> &str {
    let text = text.trim();
    for (open, close) in [('(', ')'), ('[', ']')] {
        if let Some(inner) = text.strip_prefix(open).and_then(|t| t.strip_suffix(close)) {
            return inner.trim();
        }
    }
    text
}

/// The unit in a header: `Force (N)`, `U [kV]`, `time_s`. A suffix of one letter is a unit only if it is s,
/// m, V or N.
pub(super) fn unit_in_name(name: &str) -> Option<&'static Unit> {
    let name = name.trim();
    for (open, close) in [('(', ')'), ('[', ']')] {
        if let Some(inner) = name.strip_suffix(close)
            && let Some((_, unit)) = inner.rsplit_once(open)
            && let Some(unit) = Unit::parse(unit)
        {
            return Some(unit);
        }
    }
    if let Some(stem) = name.strip_suffix("_N_m")
        && !stem.is_empty()
    {
        return Unit::parse("N m");
    }
    let (stem, suffix) = name.rsplit_once('_')?;
    // `v_mm_s` is a speed, not a time
    let over = stem.rsplit_once('_').map_or(stem, |(_, over)| over);
    if suffix == "s"
        && Unit::parse(over).is_some_and(|u| {
            u.symbol == over && matches!(u.dimension, Dimension::Length | Dimension::Angle)
        })
    {
        return Unit::parse(&format!("{over}/s"));
    }
    let known = suffix.len() > 1 || matches!(suffix, "s" | "m" | "V" | "N");
    if stem.is_empty() || !known || !suffix.chars().all(char::is_alphabetic) {
        return None;
    }
    Unit::parse(suffix).filter(|u| u.symbol == suffix)
}

fn header(above: &[Line], delimiter: Delimiter, numeric: &[bool]) -> Option<Header> {
    let wanted = numeric.iter().filter(|n| **n).count();
    // a table of one column may have a header of one cell; elsewhere one name may be left out
    let names_columns = |cells: &[String]| {
        let filled = cells.iter().filter(|c| !c.is_empty()).count();
        filled >= wanted.saturating_sub(1).max(1)
    };
    let mut rows = above.iter().rev().filter(|l| !is_blank(&l.bytes));
    let last = rows.next()?;
    let cells = filled_texts(&last.bytes, delimiter);
    if !names_columns(&cells) {
        return None;
    }
    let is_unit = |c: &String| {
        c.is_empty() || Unit::parse(bare_unit(c)).is_some() || c.eq_ignore_ascii_case("unit")
    };
    if cells.iter().all(is_unit)
        && let Some(row) = rows.next()
    {
        let names = filled_texts(&row.bytes, delimiter);
        if names_columns(&names) {
            let units = cells
                .iter()
                .map(|c| {
                    Unit::parse(bare_unit(c))
                        .map_or("", |u| u.symbol)
                        .to_owned()
                })
                .collect();
            return Some(Header {
                line: row.number,
                names,
                units,
            });
        }
    }
    let units = cells
        .iter()
        .map(|c| unit_in_name(c).map_or("", |u| u.symbol).to_owned())
        .collect();
    Some(Header {
        line: last.number,
        names: cells,
        units,
    })
}

enum Row {
    Read,
    Reread,
    /// The last row of a file that was cut.
    Cut,
}

/// The table while it is read.
struct Table<'a> {
    section: Section,
    delimiter: Delimiter,
    /// Cells that a row must have.
    width: usize,
    /// Cells that a row may have filled.
    named: usize,
    /// For every cell, the column it fills.
    slots: Vec<Option<usize>>,
    numbers: Vec<NumberColumn>,
    comma_columns: &'a mut BTreeSet<usize>,
    blank_rows: usize,
    rows: usize,
    block: Block,
}

impl<'a> Table<'a> {
    fn new(
        path: &Path,
        options: &ReadOptions,
        layout: &Layout,
        comma_columns: &'a mut BTreeSet<usize>,
        notes: &mut Vec<Note>,
    ) -> Result<Self, Error> {
        let names: &[String] = layout.header.as_ref().map_or(&[], |h| &h.names);
        let named = names.len().max(layout.width);
        let wanted: Vec<usize> = match &options.columns {
            // none in particular: all that are there, by number where nothing names them
            Some(columns) if columns.is_empty() && layout.header.is_none() => (0..layout.width)
                .filter(|i| layout.numeric.get(*i) == Some(&true))
                .collect(),
            Some(columns) if !columns.is_empty() => {
                let mut cells = columns
                    .iter()
                    .map(|c| find(path, c, names, layout))
                    .collect::<Result<Vec<_>, _>>()?;
                cells.sort_unstable();
                cells.dedup();
                cells
            }
            None if layout.header.is_none() => return Err(no_header(path, layout)),
            _ => {
                let text: Vec<String> = (0..layout.width)
                    .filter(|i| !layout.numeric.get(*i).copied().unwrap_or(false))
                    .filter_map(|i| names.get(i).filter(|n| !n.is_empty()).cloned())
                    .collect();
                if !text.is_empty() {
                    notes.push(Note::warning(
                        path,
                        format!("columns without numbers are left out: {}", text.join(", ")),
                    ));
                }
                (0..layout.width)
                    .filter(|i| layout.numeric.get(*i) == Some(&true))
                    .collect()
            }
        };
        // a row reaches the last column of numbers and the last one asked for; texts and empty cells after it
        // may be left out
        let last_number = layout.numeric.iter().rposition(|n| *n);
        let needed = wanted
            .iter()
            .max()
            .max(last_number.as_ref())
            .map_or(1, |i| i + 1);
        let units: &[String] = layout.header.as_ref().map_or(&[], |h| &h.units);
        let mut slots = vec![None; named];
        let mut columns = Vec::new();
        for cell in wanted {
            if let Some(slot) = slots.get_mut(cell) {
                *slot = Some(columns.len());
            }
            columns.push(Column {
                group: String::new(),
                axis: names.get(cell).cloned().unwrap_or_default(),
                unit: units.get(cell).cloned().unwrap_or_default(),
                number: cell + 1,
                values: Vec::new(),
            });
        }
        let numbers = NumberColumn::row(columns.len(), layout.delimiter, |c| {
            comma_columns.contains(&columns[c].number)
        });
        Ok(Table {
            block: Block::new(columns.len()),
            section: Section {
                name: "table".to_owned(),
                line: layout.header.as_ref().map_or(1, |h| h.line),
                columns,
                ..Section::default()
            },
            delimiter: layout.delimiter,
            width: needed,
            named,
            slots,
            numbers,
            comma_columns,
            blank_rows: 0,
            rows: 0,
        })
    }

    fn row(&mut self, path: &Path, line: &[u8], number: u64, ended: bool) -> Result<Row, Error> {
        if is_blank(line) {
            self.blank_rows += 1;
            return Ok(Row::Read);
        }
        let mut count = 0;
        let mut failed = None;
        let values = self.block.row();
        let mut cells = Cells::new(line, self.delimiter);
        loop {
            let i = count;
            if let Some(Some(column)) = self.slots.get(i) {
                let Some(next) = self.numbers[*column].next(&mut cells) else {
                    break;
                };
                count += 1;
                match next {
                    Ok(value) => values[*column] = value,
                    Err((Trouble::Reread, _)) => {
                        self.comma_columns.insert(i + 1);
                        return Ok(Row::Reread);
                    }
                    Err((Trouble::NotFinite, cell)) if says_missing(cell.bytes) => {
                        values[*column] = f64::NAN;
                    }
                    Err((trouble, cell)) => {
                        failed = Some(bad_cell(path, number, i + 1, cell.bytes, trouble));
                        break;
                    }
                }
                continue;
            }
            let Some(cell) = cells.next() else { break };
            count += 1;
            if i >= self.slots.len() && !cell.bytes.is_empty() {
                failed = Some(
                    Error::new(
                        ErrorKind::CellCount,
                        path,
                        format!(
                            "found {} beyond the table's columns",
                            quote(&decode(cell.bytes))
                        ),
                    )
                    .at_line(number)
                    .at_column(i + 1)
                    .expected(format!("{} cells", self.named))
                    .action("look for a stray delimiter in the row"),
                );
                break;
            }
        }
        let short = count < self.width;
        if failed.is_none() && !short {
            self.block.keep(&mut self.section.columns);
            self.section.lines.push(number);
            self.rows += 1;
            return Ok(Row::Read);
        }
        if !ended {
            return Ok(Row::Cut);
        }
        Err(failed.unwrap_or_else(|| {
            Error::new(ErrorKind::CellCount, path, format!("found {count} cells"))
                .at_line(number)
                .expected(format!("{} or more as in the other rows", self.width))
                .action("a row was cut; complete or delete it")
        }))
    }

    /// Shows the rows so far, where they are many or the last.
    fn show(&mut self, sink: &mut dyn Sink, last: bool) {
        if last || self.section.lines.len() * self.section.columns.len() >= BATCH {
            self.block.pour(&mut self.section.columns);
            sink.rows(0, &mut self.section);
        }
    }

    fn describe(
        &self,
        path: &Path,
        layout: &Layout,
        sample: &[Line],
        cut: bool,
        notes: &mut Vec<Note>,
    ) {
        let rows = self.rows;
        let parted = match layout.told {
            true => format!(" parted by {}", self.delimiter.name()),
            false => String::new(),
        };
        notes.push(Note::info(
            path,
            format!(
                "{rows} rows, {} columns{parted}{}",
                layout.width,
                match &layout.header {
                    Some(h) => format!(", header in line {}", h.line),
                    None => ", no header".to_owned(),
                }
            ),
        ));
        let commas: Vec<String> = self
            .section
            .columns
            .iter()
            .zip(&self.numbers)
            .filter(|(_, n)| n.notation() == Notation::Comma)
            .map(|(c, _)| c.title())
            .collect();
        if !commas.is_empty() {
            notes.push(Note::info(
                path,
                format!(
                    "decimal comma (dots part thousands) in: {}",
                    commas.join(", ")
                ),
            ));
        }
        for (column, numbers) in self.section.columns.iter().zip(&self.numbers) {
            if numbers.groups_by_dots_alone() {
                notes.push(Note::warning(
                    path,
                    format!(
                        "{}: dots part thousands, because a number has two of them, as 1.003.000 for 1003000; where the last dot is the \
                         decimal mark, the values are a thousand times too large",
                        column.title()
                    ),
                ));
            }
        }
        let header_line = layout.header.as_ref().map_or(0, |h| h.line);
        let passed_over = sample[..layout.data]
            .iter()
            .filter(|l| !is_blank(&l.bytes) && (l.number < header_line || header_line == 0))
            .count();
        if passed_over > 0 {
            notes.push(Note::info(
                path,
                format!("{passed_over} lines above the table are passed over"),
            ));
        }
        let not_utf8 = sample[..layout.data]
            .iter()
            .any(|l| std::str::from_utf8(&l.bytes).is_err());
        if not_utf8 {
            notes.push(Note::warning(
                path,
                "the header is not UTF-8 and is read as Latin-1; declare `encoding = \"...\"` if its names look wrong",
            ));
        }
        if cut {
            notes.push(Note::warning(
                path,
                "the file ends in the middle of a row, which is dropped",
            ));
        }
    }
}

fn no_header(path: &Path, layout: &Layout) -> Error {
    Error::new(
        ErrorKind::Grammar,
        path,
        format!("the table has {} columns and no header row", layout.width),
    )
    .at_line(1)
    .expected("a row of column names above the numbers")
    .action(
        "say in a recording.toml which columns are which, by number from 1 (`deacal import FILE --init` writes one to start from)",
    )
}

/// The cell that a wanted column stands in.
fn find(
    path: &Path,
    wanted: &ColumnRef,
    names: &[String],
    layout: &Layout,
) -> Result<usize, Error> {
    let known = || -> Vec<String> {
        if names.is_empty() {
            (1..=layout.width).map(|n| n.to_string()).collect()
        } else {
            names.iter().filter(|n| !n.is_empty()).cloned().collect()
        }
    };
    match wanted {
        ColumnRef::Number(n) if (1..=layout.width).contains(n) => Ok(n - 1),
        ColumnRef::Number(_) => Err(unknown_column(path, wanted, &known())),
        ColumnRef::Name(_) if names.is_empty() => Err(no_header(path, layout)),
        ColumnRef::Name(name) => {
            let hits: Vec<usize> = (0..names.len()).filter(|i| names[*i] == *name).collect();
            match hits.as_slice() {
                [cell] if *cell < layout.width => Ok(*cell),
                [cell] => Err(Error::new(
                    ErrorKind::NoData,
                    path,
                    format!("column {} has a header and no cells", quote(name)),
                )
                .at_column(cell + 1)
                .action("export the file again with its data")),
                [] => Err(unknown_column(path, wanted, &known())),
                several => Err(Error::new(
                    ErrorKind::Ambiguous,
                    path,
                    format!("{} columns are called {}", several.len(), quote(name)),
                )
                .action(format!(
                    "name the column by its number from 1: {}",
                    several
                        .iter()
                        .map(|i| (i + 1).to_string())
                        .collect::<Vec<_>>()
                        .join(", ")
                ))),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_in_headers() {
        let symbol = |name| unit_in_name(name).map(|u| u.symbol);
        assert_eq!(symbol("phi1_kV"), Some("kV"));
        assert_eq!(symbol("Tijd (s)"), Some("s"));
        assert_eq!(symbol("U [kV]"), Some("kV"));
        assert_eq!(symbol("nominal_stress_kPa"), Some("kPa"));
        assert_eq!(symbol("Tz (Nm)"), Some("N m"));
        assert_eq!(symbol("M_N_m"), Some("N m"));
        assert_eq!(symbol("vx_mm_s"), Some("mm/s"));
        assert_eq!(symbol("w_rad_s"), Some("rad/s"));
        assert_eq!(symbol("ax_mm_s2"), None);
        // names, not units
        assert_eq!(symbol("phase_A"), None);
        assert_eq!(symbol("specimen_g"), None);
        assert_eq!(symbol("Droop pulses (by 1 pls.)"), None);
        assert_eq!(symbol("time"), None);
    }
}
