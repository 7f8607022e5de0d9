//! Workbooks of Excel (`.xlsx`, `.xlsm`): each worksheet with a table of numbers is a section.
//!
//! A sheet is read as the plain table that it would be as a text file, by the same rules
//! ([`super::delimited`]): header, units, empty cells and all. So the sheet and the CSV file that was saved
//! from it give the same numbers, but for digits that the CSV file shows no longer. A cell with an error
//! (`#N/A`, `#DIV/0!`) is a gap; dates and times of day are texts, as they are in a CSV file, and that is
//! said. Where several sheets hold tables, a column is called `Sheet:column`.
//!
//! The workbook is taken apart by `calamine`. Its cells are read as a stream, and what comes out of the
//! archive is counted, so that a small file cannot ask for any amount of memory.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;
use std::rc::Rc;

use calamine::{CellErrorType, DataRef, Reader, SheetType, Xlsx as Workbook};

use super::capture::{Capture, ColumnRef, Importer, Keep, Note, ReadOptions, unknown_column};
use super::delimited::{self, Headers};
use super::error::{Error, ErrorKind, one_line, quote};
use super::text::{Delimiter, LineReader};

/// The importer of Excel workbooks.
pub struct Xlsx;

/// Bytes that may come out of the archive whatever its length, and how many more for each of its bytes.
const BYTES: u64 = 512 << 20;
const BYTES_PER_BYTE: u64 = 64;
/// The last row and column of a sheet, as Excel has it.
const ROWS: u32 = 1 << 20;
const COLUMNS: u32 = 1 << 14;
/// Cells of a table that may be empty whatever it holds, and how many more for each cell that is not.
const EMPTY: u64 = 1 << 23;
const EMPTY_PER_CELL: u64 = 16;

impl Importer for Xlsx {
    fn name(&self) -> &'static str {
        "xlsx"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        head.starts_with(b"PK\x03\x04") && head.windows(3).any(|w| w == b"xl/")
    }

    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Capture, Error> {
        let file = super::opened::open(path).map_err(|e| Error::io(path, e))?;
        let size = file.metadata().map_err(|e| Error::io(path, e))?.len();
        let mut file = BufReader::new(file);
        measure(path, &mut file, size)?;
        let mut workbook =
            Workbook::new(file).map_err(|e| damaged(path, &format!("it cannot be opened: {e}")))?;
        let names: Vec<String> = workbook
            .sheets_metadata()
            .iter()
            .filter(|s| s.typ == SheetType::WorkSheet)
            .map(|s| s.name.clone())
            .collect();
        let mut sheets = Vec::new();
        for name in names {
            let sheet = Sheet::read(path, &mut workbook, name)?;
            if !sheet.cells.is_empty() {
                sheets.push(Rc::new(sheet));
            }
        }
        tables(path, &sheets, options)
    }
}

fn damaged(path: &Path, what: &str) -> Error {
    Error::new(
        ErrorKind::Grammar,
        path,
        format!("the workbook is damaged or no .xlsx: {}", one_line(what)),
    )
    .action("open it in Excel and save it again as .xlsx, or save the sheet as CSV")
}

/// Goes through what the archive holds, and counts its bytes.
fn measure(path: &Path, file: &mut BufReader<File>, size: u64) -> Result<(), Error> {
    let broken = |e: &dyn std::fmt::Display| damaged(path, &e.to_string());
    let mut left = size.saturating_mul(BYTES_PER_BYTE).saturating_add(BYTES);
    let mut archive = zip::ZipArchive::new(&mut *file).map_err(|e| broken(&e))?;
    for i in 0..archive.len() {
        let entry = archive.by_index(i).map_err(|e| broken(&e))?;
        let counted =
            io::copy(&mut entry.take(left + 1), &mut io::sink()).map_err(|e| broken(&e))?;
        left = left.checked_sub(counted).ok_or_else(|| {
            damaged(
                path,
                "its archive holds far more bytes than a workbook of its size",
            )
        })?;
    }
    file.rewind().map_err(|e| Error::io(path, e))
}

enum Value {
    Number(f64),
    Text(Box<str>),
}

/// A worksheet: its cells by rows, from 0.
struct Sheet {
    name: String,
    cells: Vec<(u32, u32, Value)>,
    width: u32,
    errors: usize,
    dates: usize,
}

impl Sheet {
    fn read(
        path: &Path,
        workbook: &mut Workbook<BufReader<File>>,
        name: String,
    ) -> Result<Self, Error> {
        let wrong = |e: &dyn std::fmt::Display| damaged(path, &format!("sheet {name}: {e}"));
        let mut cells = Vec::new();
        let (mut width, mut errors, mut dates) = (0, 0, 0);
        let mut reader = workbook
            .worksheet_cells_reader(&name)
            .map_err(|e| wrong(&e))?;
        while let Some(cell) = reader.next_cell().map_err(|e| wrong(&e))? {
            let (row, column) = cell.get_position();
            if row >= ROWS || column >= COLUMNS {
                return Err(wrong(&"a cell is beyond the last row or column"));
            }
            let text = |text: &str| Value::Text(clean(text).into());
            let value = match cell.get_value() {
                DataRef::Empty => continue,
                DataRef::Float(v) => Value::Number(*v),
                #[allow(clippy::cast_precision_loss)]
                DataRef::Int(v) => Value::Number(*v as f64),
                DataRef::Bool(true) => text("TRUE"),
                DataRef::Bool(false) => text("FALSE"),
                DataRef::String(s) | DataRef::DurationIso(s) | DataRef::DateTimeIso(s) => text(s),
                DataRef::SharedString(s) => text(s),
                DataRef::Error(e) => {
                    errors += 1;
                    text(error_text(e))
                }
                DataRef::DateTime(moment) => {
                    dates += 1;
                    let (year, month, day, hour, minute, second, milli) = moment.to_ymd_hms_milli();
                    text(&format!(
                        "{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}.{milli:03}"
                    ))
                }
            };
            width = width.max(column + 1);
            cells.push((row, column, value));
        }
        if !cells.is_sorted_by_key(|(row, column, _)| (*row, *column)) {
            cells.sort_by_key(|(row, column, _)| (*row, *column));
        }
        // of a cell that stands there twice the last is meant
        cells.reverse();
        cells.dedup_by_key(|(row, column, _)| (*row, *column));
        cells.reverse();
        let rows = cells.chunk_by(|a, b| a.0 == b.0).count() as u64;
        let most = EMPTY + EMPTY_PER_CELL * cells.len() as u64;
        if rows.saturating_mul(u64::from(width)) > most {
            return Err(Error::new(
                ErrorKind::CellCount,
                path,
                format!("sheet {name} has {width} columns and almost all of its cells are empty"),
            )
            .action("clear the cells that stand far away from the table, and save it again"));
        }
        Ok(Sheet {
            name,
            cells,
            width,
            errors,
            dates,
        })
    }

    /// The sheet as lines of text, its cells parted by tabs.
    fn lines(self: &Rc<Self>, path: &Path) -> LineReader {
        LineReader::new(
            path,
            Lines {
                sheet: Rc::clone(self),
                at: 0,
                row: 0,
                line: Vec::new(),
                given: 0,
            },
        )
    }
}

fn error_text(error: &CellErrorType) -> &'static str {
    match error {
        CellErrorType::Div0 => "#DIV/0!",
        CellErrorType::NA => "#N/A",
        CellErrorType::Name => "#NAME?",
        CellErrorType::Null => "#NULL!",
        CellErrorType::Num => "#NUM!",
        CellErrorType::Ref => "#REF!",
        CellErrorType::Value => "#VALUE!",
        CellErrorType::GettingData => "#GETTING_DATA",
    }
}

/// A text as a cell of a line: without ends of lines and tabs, and in quotation marks where it begins with
/// one.
fn clean(text: &str) -> String {
    let text = text.replace(['\t', '\r', '\n'], " ");
    match text.trim_start().starts_with('"') {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text,
    }
}

/// Writes a sheet row by row.
struct Lines {
    sheet: Rc<Sheet>,
    at: usize,
    row: u32,
    line: Vec<u8>,
    given: usize,
}

impl Lines {
    fn next_line(&mut self) {
        use io::Write;
        self.line.clear();
        self.given = 0;
        let cells = &self.sheet.cells[self.at..];
        let here = cells.partition_point(|c| c.0 <= self.row);
        let mut column = 0;
        for (_, place, value) in &cells[..here] {
            while column < *place {
                self.line.push(b'\t');
                column += 1;
            }
            match value {
                // writing to memory does not fail; these digits give the same number back
                Value::Number(v) => drop(write!(self.line, "{v:?}")),
                Value::Text(text) => self.line.extend(text.as_bytes()),
            }
        }
        if here > 0 {
            self.line
                .extend((column + 1..self.sheet.width).map(|_| b'\t'));
        }
        self.line.push(b'\n');
        self.at += here;
        self.row += 1;
    }
}

impl Read for Lines {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.given == self.line.len() {
            if self.at == self.sheet.cells.len() {
                return Ok(0);
            }
            self.next_line();
        }
        let rest = &self.line[self.given..];
        let some = rest.len().min(out.len());
        out[..some].copy_from_slice(&rest[..some]);
        self.given += some;
        Ok(some)
    }
}

/// The tables of all sheets, or those with the columns that are asked for.
fn tables(path: &Path, sheets: &[Rc<Sheet>], options: &ReadOptions) -> Result<Capture, Error> {
    let mut notes = Vec::new();
    let mut sections = Vec::new();
    let mut first_error = None;
    let several = sheets.len() > 1;
    let asked = options.columns.as_ref().filter(|c| !c.is_empty());
    let mut known = Vec::new();
    let mut with_tables = 0;
    for sheet in sheets {
        let headers = delimited::headers(path, sheet.lines(path), &[Delimiter::Tab]);
        with_tables += usize::from(headers.is_ok());
        let columns = match (&headers, asked) {
            (Ok(headers), Some(asked)) if several => {
                known.extend(headers.names.iter().filter(|n| !n.is_empty()).cloned());
                let own = own_columns(&sheet.name, headers, asked);
                if own.is_empty() {
                    continue;
                }
                Some(own)
            }
            _ => options.columns.clone(),
        };
        let inner = ReadOptions {
            encoding: None,
            columns,
        };
        let open = || Ok(sheet.lines(path));
        let read = headers
            .and_then(|_| delimited::read_lines(path, &open, &[Delimiter::Tab], &inner, &mut Keep));
        match read {
            Ok(mut capture) => {
                say(path, sheet, &mut capture.notes);
                for note in &mut capture.notes {
                    if several {
                        note.text = format!("sheet {}: {}", sheet.name, note.text);
                    }
                }
                notes.append(&mut capture.notes);
                for mut section in capture.sections {
                    section.name.clone_from(&sheet.name);
                    sections.push(section);
                }
            }
            Err(error) if several => {
                notes.push(match error.kind() {
                    ErrorKind::NoData => {
                        Note::info(path, format!("sheet {} has no row of numbers", sheet.name))
                    }
                    _ => Note::warning(
                        path,
                        format!("sheet {} is left out: {}", sheet.name, error.without_path()),
                    ),
                });
                first_error.get_or_insert(error);
            }
            Err(error) => return Err(error),
        }
    }
    if sections.is_empty() {
        return Err(match (first_error, asked.and_then(|a| a.first())) {
            (_, Some(wanted)) if !known.is_empty() => unknown_column(path, wanted, &known),
            (Some(error), _) => error,
            _ => Error::new(
                ErrorKind::Empty,
                path,
                "no sheet of the workbook has a cell",
            )
            .action("export it again"),
        });
    }
    if with_tables > 1 {
        for section in &mut sections {
            for column in &mut section.columns {
                column.group.clone_from(&section.name);
            }
        }
    }
    Ok(Capture {
        format: "xlsx",
        sections,
        notes,
    })
}

/// The columns that are asked for and that this sheet has, as it calls them.
fn own_columns(sheet: &str, headers: &Headers, asked: &[ColumnRef]) -> Vec<ColumnRef> {
    let has = |name: &str| headers.names.iter().any(|n| n == name);
    asked
        .iter()
        .filter_map(|column| match column {
            ColumnRef::Name(name) if has(name) => Some(column.clone()),
            ColumnRef::Name(name) => {
                let own = name.strip_prefix(sheet)?.strip_prefix([':', '/'])?;
                has(own).then(|| ColumnRef::Name(own.to_owned()))
            }
            ColumnRef::Number(n) => (*n <= headers.width).then(|| column.clone()),
        })
        .collect()
}

fn say(path: &Path, sheet: &Sheet, notes: &mut Vec<Note>) {
    if sheet.errors > 0 {
        notes.push(Note::warning(
            path,
            format!(
                "cells with an error of a formula, as #N/A: {}; taken as gaps",
                sheet.errors
            ),
        ));
    }
    if sheet.dates > 0 {
        notes.push(Note::warning(
            path,
            format!(
                "cells that are dates or times of day: {}; they are not read: for seconds put {} into a column of its own, as a plain number",
                sheet.dates,
                quote("=(A2-A$2)*86400")
            ),
        ));
    }
}
