//! CSV files of oscilloscopes, which hide their clock in the header: Tektronix, Keysight, Rigol, Rohde &
//! Schwarz.
//!
//! | make | how it begins | where the time stands |
//! |---|---|---|
//! | Tektronix | `Record Length,2.5e+03,,` | settings in cells 1 and 2 of the first rows, time and value in 4 and 5 of every row |
//! | Keysight, Agilent | `x-axis,1,2` over `second,Volt,Volt` | first cell |
//! | Rigol | `X,CH1,CH2,Start,Increment` over `Sequence,Volt,Volt,<start>,<step>` | start + row * step |
//! | Rigol, older | `X,CH1` (or an empty cell) over `Second,Volt` | first cell |
//! | Rohde & Schwarz | one number a row, file `*.Wfm.csv` | in the file of the same name without `.Wfm`: `XStart`, `XStop`, `SignalRecordLength` |

use std::path::Path;

use super::capture::{Capture, Column, Importer, Note, ReadOptions, RowLines, Section};
use super::error::{Error, ErrorKind, quote};
use super::text::{
    Cells, Delimiter, LineReader, Notation, NumberColumn, Trouble, bad_cell, decode, is_blank,
    texts,
};
use crate::units::Unit;

/// The importer of Tektronix files.
pub struct Tektronix;
/// The importer of Keysight and Agilent files.
pub struct Keysight;
/// The importer of Rigol files.
pub struct Rigol;
/// The importer of Rohde & Schwarz files.
pub struct RohdeSchwarz;

/// The cells of a line, by commas.
fn cells(line: &[u8]) -> Vec<String> {
    texts(line, Delimiter::Comma)
}

/// The first two lines of a file.
fn first_lines(head: &[u8]) -> (Vec<String>, Vec<String>) {
    let mut lines = head.split(|b| *b == b'\n').map(|l| l.trim_ascii_end());
    (
        cells(lines.next().unwrap_or_default()),
        cells(lines.next().unwrap_or_default()),
    )
}

fn unit(text: &str) -> String {
    Unit::parse(text).map_or_else(|| text.to_owned(), |u| u.symbol.to_owned())
}

/// Whether cells are the units of a scope: a time, then volts or amperes.
fn are_units(units: &[String], first: &str) -> bool {
    let known = |u: &String| matches!(u.as_str(), "Volt" | "Volts" | "Ampere" | "Watt" | "V" | "A");
    units.len() > 1
        && units[0].eq_ignore_ascii_case(first)
        && units[1..].iter().take_while(|u| known(u)).count() > 0
}

/// Rows of numbers: the wanted cells of each, with the errors of a table.
struct Rows {
    columns: Vec<Vec<f64>>,
    readers: Vec<NumberColumn>,
    lines: RowLines,
    cut: bool,
}

impl Rows {
    fn new(count: usize) -> Self {
        Rows {
            columns: vec![Vec::new(); count],
            readers: vec![NumberColumn::new(Delimiter::Comma, Notation::Dot); count],
            lines: RowLines::default(),
            cut: false,
        }
    }

    /// Reads the cells from `first` on of the reader's line.
    fn push(&mut self, lines: &LineReader, first: usize) -> Result<(), Error> {
        let rows = self.lines.len();
        let count = self.columns.len();
        let mut found = 0;
        let mut wrong = None;
        for (i, cell) in Cells::new(lines.line(), Delimiter::Comma).enumerate() {
            let Some(c) = i.checked_sub(first).filter(|c| *c < count) else {
                if i >= first + count && !cell.bytes.is_empty() {
                    wrong = Some((i, cell.bytes, Trouble::NotANumber));
                }
                continue;
            };
            found += 1;
            match self.readers[c].parse(cell.bytes) {
                Ok(v) => self.columns[c].push(v),
                Err(trouble) => {
                    wrong = Some((i, cell.bytes, trouble));
                    break;
                }
            }
        }
        if wrong.is_none() && found == count {
            self.lines.push(lines.number());
            return Ok(());
        }
        for c in &mut self.columns {
            c.truncate(rows);
        }
        if !lines.ended_with_newline() {
            self.cut = true;
            return Ok(());
        }
        Err(match wrong {
            Some((i, bytes, trouble)) => {
                bad_cell(lines.path(), lines.number(), i + 1, bytes, trouble)
            }
            None => Error::new(
                ErrorKind::CellCount,
                lines.path(),
                format!("found {} cells", found + first),
            )
            .at_line(lines.number())
            .expected(format!("{}", count + first))
            .action("a row was cut; complete or delete it"),
        })
    }

    /// The section and the notes: times, and the other columns with their names and units.
    fn capture(
        self,
        format: &'static str,
        path: &Path,
        times: Option<Vec<f64>>,
        names: Vec<(usize, String, String)>,
        mut notes: Vec<Note>,
    ) -> Result<Capture, Error> {
        if self.lines.is_empty() {
            return Err(
                Error::new(ErrorKind::NoData, path, "the file has no samples")
                    .action("save the waveform again"),
            );
        }
        if self.cut {
            notes.push(Note::warning(
                path,
                "the file ends in the middle of a row, which is dropped",
            ));
        }
        let endless = times
            .as_ref()
            .and_then(|t| t.iter().position(|t| t.is_infinite()));
        if let Some(row) = endless {
            return Err(
                Error::new(ErrorKind::BadNumber, path, "the time is beyond all numbers")
                    .at_line(self.lines.line(row))
                    .expected("seconds")
                    .action("save the waveform again with its time"),
            );
        }
        let rows = self.lines.len();
        notes.insert(
            0,
            Note::info(path, format!("{rows} samples of {} channels", names.len())),
        );
        let mut values: Vec<Vec<f64>> = self.columns;
        let columns = names
            .into_iter()
            .map(|(at, axis, unit)| Column {
                group: String::new(),
                axis,
                unit,
                number: at + 1,
                values: values.get_mut(at).map(std::mem::take).unwrap_or_default(),
            })
            .collect();
        Ok(Capture {
            format,
            sections: vec![Section {
                name: "table".to_owned(),
                line: 1,
                stamps_s: times,
                lines: self.lines,
                columns,
                ..Section::default()
            }],
            notes,
        })
    }
}

/// Seconds of a column in a unit that the file names.
fn seconds(path: &Path, values: &[f64], unit: &str) -> Result<Vec<f64>, Error> {
    let known = Unit::parse(unit).filter(|u| u.dimension == crate::units::Dimension::Time);
    let Some(known) = known else {
        return Err(Error::new(
            ErrorKind::WrongUnit,
            path,
            format!("the horizontal unit is {}", quote(unit)),
        )
        .expected("s")
        .action("save the waveform over time"));
    };
    Ok(values.iter().map(|t| t * known.to_si).collect())
}

impl Importer for Tektronix {
    fn name(&self) -> &'static str {
        "tektronix-csv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        let (first, second) = first_lines(head);
        first.first().is_some_and(|c| c == "Record Length")
            && second.first().is_some_and(|c| c == "Sample Interval")
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Capture, Error> {
        let mut lines = LineReader::open(path, options.encoding.as_deref())?;
        let mut rows = Rows::new(2);
        let mut settings: Vec<(String, String)> = Vec::new();
        while lines.advance()? && !rows.cut {
            if is_blank(lines.line()) {
                continue;
            }
            let mut head = Cells::new(lines.line(), Delimiter::Comma);
            if let (Some(key), Some(value)) = (head.next(), head.next())
                && !key.bytes.is_empty()
            {
                settings.push((key.text(), value.text()));
            }
            rows.push(&lines, 3)?;
        }
        let setting = |key: &str| {
            let found = settings.iter().find(|(k, _)| k == key);
            found.map_or("", |(_, v)| v.as_str())
        };
        let mut notes = Vec::new();
        if let Ok(declared) = setting("Record Length").parse::<f64>()
            && declared != rows.lines.len() as f64
        {
            notes.push(Note::warning(
                path,
                format!(
                    "the header says {declared} samples, {} are there",
                    rows.lines.len()
                ),
            ));
        }
        for key in [
            "Sample Interval",
            "Vertical Scale",
            "Probe Atten",
            "Model Number",
        ] {
            if !setting(key).is_empty() {
                notes.push(Note::info(path, format!("{key}: {}", setting(key))));
            }
        }
        let time_unit = match setting("Horizontal Units") {
            "" => "s",
            unit => unit,
        };
        let times = seconds(path, &rows.columns[0], time_unit)?;
        let name = match setting("Source") {
            "" => "CH",
            source => source,
        };
        let names = vec![(1, name.to_owned(), unit(setting("Vertical Units")))];
        let mut capture = rows.capture(self.name(), path, Some(times), names, notes)?;
        for c in &mut capture.sections[0].columns {
            c.number += 3;
        }
        Ok(capture)
    }
}

/// A table whose first cell is the time, below two rows of header.
fn table(
    importer: &dyn Importer,
    path: &Path,
    options: &ReadOptions,
    counted: bool,
) -> Result<Capture, Error> {
    let mut lines = LineReader::open(path, options.encoding.as_deref())?;
    lines.advance()?;
    let mut names = cells(lines.line());
    lines.advance()?;
    let units = cells(lines.line());
    while names.last().is_some_and(String::is_empty) {
        names.pop();
    }
    if names.len() < 2 {
        return Err(Error::new(
            ErrorKind::Grammar,
            path,
            "the first row names fewer than two columns",
        )
        .at_line(1)
        .expected("the time and a channel")
        .action("save the waveform again"));
    }
    let at = |name: &str| names.iter().position(|n| n == name);
    let (start, step) = (at("Start"), at("Increment"));
    let clock = |at: Option<usize>, what: &str| -> Result<f64, Error> {
        let text = at.and_then(|i| units.get(i)).map_or("", String::as_str);
        text.trim()
            .parse()
            .ok()
            .filter(|v: &f64| v.is_finite())
            .ok_or_else(|| {
                Error::new(
                    ErrorKind::BadNumber,
                    path,
                    format!("the header's {what} is {}", quote(text)),
                )
                .at_line(2)
                .expected("a number of seconds")
                .action("save the waveform again with its time")
            })
    };
    let count = start.unwrap_or(names.len()).max(1);
    let mut rows = Rows::new(count);
    while lines.advance()? && !rows.cut {
        if !is_blank(lines.line()) {
            rows.push(&lines, 0)?;
        }
    }
    let times = if counted {
        let (start, step) = (clock(start, "start")?, clock(step, "increment")?);
        rows.columns[0].iter().map(|i| start + i * step).collect()
    } else {
        seconds(
            path,
            &rows.columns[0],
            units.first().map_or("", String::as_str),
        )?
    };
    let channels = (1..count)
        .map(|i| {
            (
                i,
                names[i].clone(),
                unit(units.get(i).map_or("", String::as_str)),
            )
        })
        .collect();
    rows.capture(importer.name(), path, Some(times), channels, Vec::new())
}

impl Importer for Keysight {
    fn name(&self) -> &'static str {
        "keysight-csv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        let (names, units) = first_lines(head);
        names.first().is_some_and(|n| n == "x-axis") && are_units(&units, "second")
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Capture, Error> {
        table(self, path, options, false)
    }
}

impl Importer for Rigol {
    fn name(&self) -> &'static str {
        "rigol-csv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        let (names, units) = first_lines(head);
        let channel = |n: &String| n.starts_with("CH") || n.starts_with("MATH");
        names.len() > 1
            && (names[0] == "X" || names[0].is_empty())
            && channel(&names[1])
            && (are_units(&units, "Second") || are_units(&units, "Sequence"))
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Capture, Error> {
        let mut lines = LineReader::open(path, options.encoding.as_deref())?;
        let mut counted = false;
        for _ in 0..2 {
            lines.advance()?;
            counted = cells(lines.line()).first().is_some_and(|c| c == "Sequence");
        }
        table(self, path, options, counted)
    }
}

impl Importer for RohdeSchwarz {
    fn name(&self) -> &'static str {
        "rohde-schwarz-csv"
    }

    fn recognises(&self, head: &[u8], path: &Path) -> bool {
        let named = path.file_name().is_some_and(|n| {
            n.to_string_lossy()
                .to_ascii_lowercase()
                .ends_with(".wfm.csv")
        });
        let first = head.split(|b| *b == b'\n').next().unwrap_or_default();
        let mut cells = Cells::new(first.trim_ascii(), Delimiter::Comma);
        let number = |c: &[u8]| decode(c).parse::<f64>().is_ok();
        named && cells.next().is_some_and(|c| number(c.bytes)) && cells.all(|c| number(c.bytes))
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Capture, Error> {
        let mut lines = LineReader::open(path, options.encoding.as_deref())?;
        let mut rows: Option<Rows> = None;
        while lines.advance()? {
            if is_blank(lines.line()) {
                continue;
            }
            let count = Cells::new(lines.line(), Delimiter::Comma).count();
            let rows = rows.get_or_insert_with(|| Rows::new(count));
            rows.push(&lines, 0)?;
            if rows.cut {
                break;
            }
        }
        let rows = rows.unwrap_or_else(|| Rows::new(1));
        let mut notes = Vec::new();
        let times = header_clock(path, rows.lines.len(), &mut notes)?;
        let channels = (0..rows.columns.len())
            .map(|i| (i, format!("CH{}", i + 1), String::new()))
            .collect();
        rows.capture(self.name(), path, times, channels, notes)
    }
}

/// The times that the header file beside a waveform tells: `name.csv` beside `name.Wfm.csv`.
fn header_clock(
    path: &Path,
    samples: usize,
    notes: &mut Vec<Note>,
) -> Result<Option<Vec<f64>>, Error> {
    let name = path
        .file_name()
        .map_or(String::new(), |n| n.to_string_lossy().into_owned());
    let (stem, end) = name
        .len()
        .checked_sub(".Wfm.csv".len())
        .and_then(|at| name.split_at_checked(at))
        .unwrap_or((&name, ""));
    if !end.eq_ignore_ascii_case(".Wfm.csv") {
        notes.push(Note::warning(
            path,
            "the file has no time, and its name does not end in .Wfm.csv, by which its header file is found: state rate_hz",
        ));
        return Ok(None);
    }
    let header = path.with_file_name(format!("{stem}.csv"));
    if !header.is_file() {
        notes.push(Note::warning(
            path,
            format!(
                "the file has no time and {stem}.csv, which has it, is not beside it: copy that file too, or state rate_hz"
            ),
        ));
        return Ok(None);
    }
    let mut lines = LineReader::open(&header, None)?;
    let (mut start, mut stop, mut declared) = (None, None, None);
    while lines.advance()? {
        let text = decode(lines.line()).into_owned();
        let mut parts = text.split([':', ',', ';']).map(str::trim);
        let (key, value) = (
            parts.next(),
            parts
                .next()
                .and_then(|v| v.parse::<f64>().ok())
                .filter(|v| v.is_finite()),
        );
        match key {
            Some("XStart") => start = value,
            Some("XStop") => stop = value,
            // of what lies between XStart and XStop; RecordLength has the samples that settle a filter too
            Some("SignalRecordLength") => declared = value.filter(|v| *v >= 1.0),
            Some("RecordLength") if declared.is_none() => declared = value.filter(|v| *v >= 1.0),
            _ => {}
        }
    }
    if let Some(declared) = declared.filter(|d| *d != samples as f64) {
        notes.push(Note::warning(
            path,
            format!("its header file says {declared} samples, {samples} are there"),
        ));
    }
    match (start, stop) {
        (Some(start), Some(stop)) if stop > start && samples > 1 => {
            // of a file that was cut, the samples that are there keep their distance
            let whole = declared.map_or(samples as f64, |d| d.max(samples as f64));
            let step = (stop - start) / whole;
            Ok(Some(
                (0..samples).map(|i| start + i as f64 * step).collect(),
            ))
        }
        _ => Err(Error::new(
            ErrorKind::Grammar,
            &header,
            "XStart and XStop are not both there",
        )
        .expected("the header file that the oscilloscope wrote")
        .action("copy it again, or state rate_hz and move it away")),
    }
}
