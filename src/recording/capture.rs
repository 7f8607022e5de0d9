//! What an importer hands over: sections of columns, as the file has them.

use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::error::{Error, ErrorKind, one_line, quote, suggestion};
use super::{
    c3d, delimited, lvm, mat, mcap, nexus_csv, optitrack_csv, oscilloscope, qualisys_tsv, tdms,
    text, trc, xlsx,
};

/// How weighty a [`Note`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What was found: rate, rows, delimiter.
    Info,
    /// What was dropped or looks wrong.
    Warning,
}

/// One sentence on what was found in a file, or dropped from it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// The file.
    pub path: PathBuf,
    /// The line it is about, from 1, where there is one.
    pub line: Option<u64>,
    /// How weighty it is.
    pub level: Level,
    /// The sentence, without the file's name.
    pub text: String,
}

impl Note {
    /// A note of what was found.
    pub fn info(path: &Path, text: impl Into<String>) -> Self {
        Note {
            path: path.to_owned(),
            line: None,
            level: Level::Info,
            text: one_line(text),
        }
    }

    /// A note of what looks wrong or was dropped.
    pub fn warning(path: &Path, text: impl Into<String>) -> Self {
        Note {
            level: Level::Warning,
            ..Note::info(path, text)
        }
    }

    /// The line it is about.
    #[must_use]
    pub fn at_line(mut self, line: u64) -> Self {
        self.line = Some(line);
        self
    }
}

/// Everything in one file.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Name of the importer that read it: `nexus-csv`.
    pub format: &'static str,
    /// Its sections, in the order of the file. A plain table is one section.
    pub sections: Vec<Section>,
    /// What was found and dropped.
    pub notes: Vec<Note>,
}

/// One table of a file, with one clock.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Section {
    /// `Trajectories`, `Devices`, ...; `table` for a plain table.
    pub name: String,
    /// Line of the section's name (or header), from 1.
    pub line: u64,
    /// Samples per second that the file declares, Hz; sub-frames counted.
    pub rate_hz: Option<f64>,
    /// Frame number of each row as the file says; empty where the format has no frames.
    pub frames: Vec<i64>,
    /// Sub-frame of each row, from 0; empty where the format has none or no row says one.
    pub sub_frames: Vec<u32>,
    /// Samples in one frame; `None` where no row says a sub-frame.
    pub subframes_per_frame: Option<u32>,
    /// Time stamp of each row, s, for formats that stamp rows instead of counting frames.
    pub stamps_s: Option<Vec<f64>>,
    /// Number of the frame at time 0; `None`: 1, as Vicon counts. Formats that print times say another.
    pub zero_frame: Option<i64>,
    /// The columns that belong together under one name (a marker, a device), in the order of the file.
    pub groups: Vec<Group>,
    /// The columns, in the order of the file.
    pub columns: Vec<Column>,
    /// The line of each row.
    pub lines: RowLines,
}

/// Columns under one name: a marker with X, Y, Z.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// As the file has it, subject prefix included: `DEA:EE`.
    pub name: String,
    /// Which of [`Section::columns`].
    pub columns: Range<usize>,
}

/// One column of numbers, in the unit of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name of its group; empty in a plain table.
    pub group: String,
    /// Its own name: `X`, or the header of a plain table.
    pub axis: String,
    /// As the file says; empty where it says none.
    pub unit: String,
    /// Its cell in the row, from 1.
    pub number: usize,
    /// One value a row, in `unit`; NaN where the cell was empty.
    pub values: Vec<f64>,
}

impl Column {
    /// Whether it is called as a time is: `t` or `time`, also as a field of a structure, `run.t`.
    #[must_use]
    pub fn called_time(&self) -> bool {
        let own = self.axis.rsplit('.').next().unwrap_or_default();
        ["t", "time"].iter().any(|n| own.eq_ignore_ascii_case(n))
    }

    /// How to call it in a message.
    #[must_use]
    pub fn title(&self) -> String {
        match (self.group.is_empty(), self.axis.is_empty()) {
            (true, true) => self.number.to_string(),
            (true, false) => self.axis.clone(),
            (false, true) => self.group.clone(),
            (false, false) => format!("{}/{}", self.group, self.axis),
        }
    }
}

/// The line of every row, kept as the places where lines were skipped.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RowLines {
    rows: usize,
    runs: Vec<(usize, u64)>,
}

impl RowLines {
    /// Rows of a file that has no lines.
    #[must_use]
    pub fn without(rows: usize) -> Self {
        RowLines {
            rows,
            runs: Vec::new(),
        }
    }

    /// The next row stands in `line`.
    pub fn push(&mut self, line: u64) {
        if self.rows == 0 || self.line(self.rows - 1) + 1 != line {
            self.runs.push((self.rows, line));
        }
        self.rows += 1;
    }

    /// How many rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows == 0
    }

    /// The line of a row, from 1; 0 if there is no line known.
    #[must_use]
    pub fn line(&self, row: usize) -> u64 {
        let run = self.runs.partition_point(|(first, _)| *first <= row);
        match run.checked_sub(1).and_then(|i| self.runs.get(i)) {
            Some((first, line)) => line + (row - first) as u64,
            None => 0,
        }
    }
}

/// Rows in which a group has no value, and how many stretches of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Gaps {
    /// Rows with at least one empty cell in the group.
    pub missing: usize,
    /// Runs of such rows.
    pub runs: usize,
}

impl Section {
    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns
            .first()
            .map_or(self.frames.len(), |c| c.values.len())
    }

    /// Time of every row on the file's own clock, s: stamps, or (frame - zero + sub/n) / frame rate, where
    /// frame rate is the declared rate / n and zero is [`Section::zero_frame`]. `None` if the file has
    /// neither.
    #[must_use]
    pub fn times_s(&self) -> Option<Vec<f64>> {
        if let Some(stamps) = &self.stamps_s {
            return Some(stamps.clone());
        }
        let rate_hz = self.rate_hz?;
        if self.frames.is_empty() {
            return None;
        }
        // (f - zero + sub/n) / (rate/n) = ((f - zero) n + sub) / rate
        Some(
            (0..self.frames.len())
                .map(|i| self.sample_index(i) as f64 / rate_hz)
                .collect(),
        )
    }

    /// Samples since time 0 of a row, counting sub-frames: (frame - zero) n + sub.
    #[must_use]
    pub fn sample_index(&self, row: usize) -> i64 {
        let n = i64::from(self.subframes_per_frame.unwrap_or(1));
        let sub = i64::from(self.sub_frames.get(row).copied().unwrap_or(0));
        let zero = self.zero_frame.unwrap_or(1);
        self.frames.get(row).map_or(0, |f| {
            f.saturating_sub(zero).saturating_mul(n).saturating_add(sub)
        })
    }

    /// Takes out all rows and leaves the columns.
    pub fn clear_rows(&mut self) {
        self.frames.clear();
        self.sub_frames.clear();
        self.lines = RowLines::default();
        if let Some(stamps) = &mut self.stamps_s {
            stamps.clear();
        }
        for column in &mut self.columns {
            column.values.clear();
        }
    }

    /// The same without its rows.
    pub(super) fn without_rows(&self) -> Self {
        Section {
            name: self.name.clone(),
            groups: self.groups.clone(),
            columns: self
                .columns
                .iter()
                .map(|c| Column {
                    group: c.group.clone(),
                    axis: c.axis.clone(),
                    unit: c.unit.clone(),
                    number: c.number,
                    values: Vec::new(),
                })
                .collect(),
            stamps_s: self.stamps_s.as_ref().map(|_| Vec::new()),
            frames: Vec::new(),
            sub_frames: Vec::new(),
            lines: RowLines::default(),
            ..*self
        }
    }

    /// The column with this group and axis.
    #[must_use]
    pub fn column(&self, group: &str, axis: &str) -> Option<&Column> {
        self.columns
            .iter()
            .find(|c| c.group == group && c.axis == axis)
    }

    /// How often some of these columns are empty.
    #[must_use]
    pub fn gaps(&self, columns: Range<usize>) -> Gaps {
        let mut gaps = Gaps::default();
        let mut inside = false;
        let columns = self.columns.get(columns).unwrap_or_default();
        for row in 0..self.rows() {
            let missing = columns.iter().any(|c| c.values[row].is_nan());
            gaps.missing += usize::from(missing);
            gaps.runs += usize::from(missing && !inside);
            inside = missing;
        }
        gaps
    }
}

/// A column, named by header or by number from 1.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ColumnRef {
    /// The header of a plain table; the axis, the group, or `group:axis` where columns have groups.
    Name(String),
    /// The cell in the row, from 1.
    Number(usize),
}

impl std::fmt::Display for ColumnRef {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ColumnRef::Name(name) => f.write_str(name),
            ColumnRef::Number(number) => write!(f, "{number}"),
        }
    }
}

impl Capture {
    /// The column that a manifest means: (section, column).
    ///
    /// A name is matched with the whole header first, then (where columns have groups) with `group:axis`,
    /// `group/axis` or a group of one column, subject prefix left out or not.
    ///
    /// # Errors
    /// [`ErrorKind::UnknownColumn`] with the nearest and the list of those there are;
    /// [`ErrorKind::Ambiguous`].
    pub fn find_column(&self, path: &Path, wanted: &ColumnRef) -> Result<(usize, usize), Error> {
        let all = || {
            self.sections.iter().enumerate().flat_map(|(s, section)| {
                section
                    .columns
                    .iter()
                    .enumerate()
                    .map(move |(c, column)| (s, c, column))
            })
        };
        let tests: [&dyn Fn(&Column) -> bool; 4] = [
            &|c| matches!(wanted, ColumnRef::Number(n) if c.number == *n),
            &|c| matches!(wanted, ColumnRef::Name(n) if c.axis == *n),
            &|c| {
                matches!(wanted, ColumnRef::Name(n) if !c.group.is_empty()
                && (format!("{}:{}", c.group, c.axis) == *n || format!("{}/{}", c.group, c.axis) == *n))
            },
            &|c| {
                matches!(wanted, ColumnRef::Name(n) if !c.group.is_empty()
                && (c.group == *n || without_subject(&c.group) == n))
            },
        ];
        for test in tests {
            let hits: Vec<_> = all().filter(|(_, _, c)| test(c)).collect();
            match hits.as_slice() {
                [] => {}
                [(s, c, _)] => return Ok((*s, *c)),
                several => {
                    let places: Vec<String> = several
                        .iter()
                        .take(8)
                        .map(|(s, _, c)| format!("{} column {}", self.sections[*s].name, c.number))
                        .collect();
                    return Err(Error::new(
                        ErrorKind::Ambiguous,
                        path,
                        format!("{} columns are called {wanted}", several.len()),
                    )
                    .action(format!(
                        "name one as group:axis or by its number from 1: {}",
                        places.join(", ")
                    )));
                }
            }
        }
        let known: Vec<String> = all().map(|(_, _, c)| c.title()).collect();
        Err(unknown_column(path, wanted, &known))
    }
}

/// The error for a column that is not there.
pub(super) fn unknown_column(path: &Path, wanted: &ColumnRef, known: &[String]) -> Error {
    let name = wanted.to_string();
    let found = match wanted {
        ColumnRef::Name(_) => format!("no column is called {}", quote(&name)),
        ColumnRef::Number(_) => format!("there is no column {name}"),
    };
    Error::new(ErrorKind::UnknownColumn, path, found).action(suggestion(&name, known))
}

/// A label without its subject: `DEA:EE` is `EE`.
pub(super) fn without_subject(label: &str) -> &str {
    label.split_once(':').map_or(label, |(_, bare)| bare)
}

/// What an importer may be told about a file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Text encoding where it is not UTF-8: `gbk`.
    pub encoding: Option<String>,
    /// The columns that will be used. A plain table reads no others, and may have no header if all are
    /// numbers; an empty list stands for all that there are, header or not.
    pub columns: Option<Vec<ColumnRef>>,
}

/// Reads one kind of file.
///
/// A new importer is one file with this trait and one line in [`importers`].
pub trait Importer: Sync {
    /// What a manifest writes under `format`.
    fn name(&self) -> &'static str;

    /// Whether a file that begins with `head` is of this kind. `head` is up to 64 KiB, without a byte-order
    /// mark, UTF-16 made UTF-8; `path` is there for formats that only the extension tells.
    fn recognises(&self, head: &[u8], path: &Path) -> bool;

    /// Reads the file: fills no gap, converts no unit. An importer has to have this or [`Importer::stream`]:
    /// each is made of the other where it is left out.
    ///
    /// # Errors
    /// The file does not follow the format, with line and column.
    fn read(&self, path: &Path, options: &ReadOptions) -> Result<Capture, Error> {
        let mut capture = self.stream(path, options, &mut Keep)?;
        note_gaps(path, &mut capture);
        Ok(capture)
    }

    /// Reads the file and shows its rows to `sink` as they come; what the sink takes out is not in the
    /// answer. An importer that can, hands over a few rows at a time, so that a file of any size is gone
    /// through in constant memory; it says nothing of gaps, because it has not seen them all.
    ///
    /// # Errors
    /// As [`Importer::read`].
    fn stream(
        &self,
        path: &Path,
        options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        let mut capture = self.read(path, options)?;
        for (index, section) in capture.sections.iter_mut().enumerate() {
            sink.rows(index, section);
        }
        Ok(capture)
    }
}

/// Sees rows while a file is read.
pub trait Sink {
    /// The file is read again from its beginning: nothing that came before counts.
    fn restart(&mut self) {}

    /// Section `index` has more rows. Those that the sink leaves in it stay; [`Section::clear_rows`] takes
    /// all out. A format without fixed columns may have added some at the end.
    fn rows(&mut self, index: usize, section: &mut Section);
}

/// Leaves every row where it is.
pub struct Keep;

impl Sink for Keep {
    fn rows(&mut self, _index: usize, _section: &mut Section) {}
}

/// How many numbers an importer gathers before it shows them to a [`Sink`].
pub(super) const BATCH: usize = 64 * 1024;

/// Rows that wait to be put into their columns, many at a time: a table may have thousands of columns, and a
/// number in each is a walk through memory.
pub(super) struct Block {
    width: usize,
    rows: usize,
    values: Vec<f64>,
}

impl Block {
    const NUMBERS: usize = 8 * 1024;

    /// For so many columns.
    pub(super) fn new(width: usize) -> Self {
        Block {
            width,
            rows: 0,
            values: Vec::new(),
        }
    }

    /// A new row, NaN in every column. It does not count before [`Block::keep`].
    #[inline]
    pub(super) fn row(&mut self) -> &mut [f64] {
        let from = self.rows * self.width;
        self.values.truncate(from);
        self.values.resize(from + self.width, f64::NAN);
        &mut self.values[from..]
    }

    /// The row that [`Block::row`] began.
    #[inline]
    pub(super) fn open(&mut self) -> &mut [f64] {
        &mut self.values[self.rows * self.width..]
    }

    /// Keeps the row; a block that is full goes into the columns.
    #[inline]
    pub(super) fn keep(&mut self, columns: &mut [Column]) {
        self.rows += 1;
        if self.rows >= 16 && self.rows * self.width >= Self::NUMBERS {
            self.pour(columns);
        }
    }

    /// Puts the rows into their columns.
    pub(super) fn pour(&mut self, columns: &mut [Column]) {
        if self.rows == 0 {
            return;
        }
        let kept = &self.values[..self.rows * self.width];
        for (c, column) in columns.iter_mut().enumerate().take(self.width) {
            column.values.extend(kept[c..].iter().step_by(self.width));
        }
        self.rows = 0;
        self.values.clear();
    }
}

/// Says what is missing in a capture that was read whole by streaming.
fn note_gaps(path: &Path, capture: &mut Capture) {
    for section in &capture.sections {
        let rows = section.rows();
        if section.groups.is_empty() {
            for column in &section.columns {
                let missing = column.values.iter().filter(|v| v.is_nan()).count();
                column_gap_note(path, &column.title(), missing, rows, &mut capture.notes);
            }
            continue;
        }
        let groups: Vec<(&str, Gaps)> = section
            .groups
            .iter()
            .map(|g| (g.name.as_str(), section.gaps(g.columns.clone())))
            .collect();
        gap_notes(path, &section.name, rows, &groups, &mut capture.notes);
    }
}

/// Says how many values of a column are missing.
pub(super) fn column_gap_note(
    path: &Path,
    title: &str,
    missing: usize,
    rows: usize,
    notes: &mut Vec<Note>,
) {
    if missing > 0 {
        notes.push(Note::warning(
            path,
            format!("column {title}: {missing} of {rows} values missing"),
        ));
    }
}

/// Says how many values are missing.
pub(super) fn gap_notes(
    path: &Path,
    name: &str,
    rows: usize,
    groups: &[(&str, Gaps)],
    notes: &mut Vec<Note>,
) {
    let with_gaps = groups.iter().filter(|g| g.1.missing > 0).count();
    let missing: usize = groups.iter().map(|g| g.1.missing).sum();
    if missing > 0 {
        notes.push(Note::info(
            path,
            format!("section {name}: {with_gaps} groups have gaps, {missing} samples missing"),
        ));
    }
    let mut never: Vec<&str> = groups
        .iter()
        .filter(|g| rows > 0 && g.1.missing == rows)
        .map(|g| g.0)
        .collect();
    if !never.is_empty() {
        let more = never.len().saturating_sub(8);
        never.truncate(8);
        let mut text = format!(
            "section {name}: without a value in some column throughout: {}",
            never.join(", ")
        );
        if more > 0 {
            text += &format!(" and {more} more");
        }
        notes.push(Note::warning(path, text));
    }
}

/// All importers; the first that recognises a file reads it.
#[must_use]
pub fn importers() -> &'static [&'static dyn Importer] {
    &[
        &c3d::C3d,
        &optitrack_csv::OptitrackCsv,
        &qualisys_tsv::QualisysTsv,
        &trc::Trc,
        &nexus_csv::NexusCsv,
        &nexus_csv::TrackerCsv,
        &mcap::Mcap,
        &tdms::Tdms,
        &mat::Mat,
        &xlsx::Xlsx,
        &lvm::Lvm,
        &oscilloscope::Tektronix,
        &oscilloscope::Keysight,
        &oscilloscope::Rigol,
        &oscilloscope::RohdeSchwarz,
        &delimited::Delimited,
    ]
}

/// Files that no importer reads, and what to do with them.
const HINTS: &[(&[u8], &str)] = &[
    (
        b"PK\x03\x04",
        "this is a zip archive or a workbook of another kind (.ods, .xlsb); unpack it, or save the sheet as .xlsx or CSV",
    ),
    (
        b"\xd0\xcf\x11\xe0",
        "this is an old spreadsheet workbook (.xls); save it as .xlsx, or the sheet as CSV",
    ),
    (
        b"# Created by Octave",
        "this is a text file of Octave; save it again in Octave: save -v7 run.mat t u",
    ),
    (
        b"\x89HDF\r\n",
        "this is an HDF5 file; write its variables to a CSV file",
    ),
    (
        b"\x93NUMPY",
        "this is a NumPy array (.npy); write it as text: numpy.savetxt(\"run.csv\", a, delimiter=\",\", header=\"t_s,u_V\", comments=\"\")",
    ),
    (b"PAR1", "this is a Parquet file; write it as CSV"),
];

/// Whether a file is known to be of a kind that no importer reads.
pub(super) fn is_foreign(head: &[u8]) -> bool {
    HINTS.iter().any(|(mark, _)| head.starts_with(mark))
}

/// The importer for a file: the one that `format` names, or the first that recognises its content.
///
/// # Errors
/// The file cannot be read, is empty, or is of no known kind.
pub fn importer_for(path: &Path, format: Option<&str>) -> Result<&'static dyn Importer, Error> {
    let head = head(path)?;
    let names: Vec<&str> = importers().iter().map(|i| i.name()).collect();
    if head.iter().all(u8::is_ascii_whitespace) && head.len() < HEAD_BYTES {
        return Err(
            Error::new(ErrorKind::Empty, path, "the file is empty").action("export it again")
        );
    }
    if let Some(format) = format {
        return importers()
            .iter()
            .copied()
            .find(|i| i.name() == format)
            .ok_or_else(|| {
                Error::new(
                    ErrorKind::UnknownFormat,
                    path,
                    format!("format {} is not known", quote(format)),
                )
                .at_key("format")
                .action(suggestion(format, &names))
            });
    }
    recognised(&head, path).ok_or_else(|| {
        let hint = HINTS.iter().find(|(mark, _)| head.starts_with(mark));
        Error::new(ErrorKind::UnknownFormat, path, "the format is not known").action(
            hint.map_or_else(
                || format!("formats that are read: {}", names.join(", ")),
                |(_, hint)| (*hint).to_owned(),
            ),
        )
    })
}

/// The importer that recognises a file by how it begins.
pub(super) fn recognised(head: &[u8], path: &Path) -> Option<&'static dyn Importer> {
    let mut all = importers().iter().copied();
    all.find(|i| i.recognises(head, path))
}

pub(super) const HEAD_BYTES: usize = 64 * 1024;

/// The beginning of a file, without a byte-order mark, UTF-16 made UTF-8.
fn head(path: &Path) -> Result<Vec<u8>, Error> {
    let mut head = Vec::new();
    super::opened::text(path)
        .and_then(|t| t.take(HEAD_BYTES as u64).read_to_end(&mut head))
        .map_err(|e| Error::io(path, e))?;
    match encoding_rs::Encoding::for_bom(&head) {
        Some((e, mark)) if e == encoding_rs::UTF_8 => drop(head.drain(..mark)),
        Some((e, mark)) => {
            head = e
                .decode_without_bom_handling(&head[mark..])
                .0
                .into_owned()
                .into_bytes()
        }
        None => {}
    }
    Ok(head)
}

/// The error for a file of a known format without a row of numbers; the notes on it say why.
pub(super) fn nothing(path: &Path, notes: &[Note]) -> Error {
    let why: Vec<&str> = notes.iter().take(4).map(|n| n.text.as_str()).collect();
    let why = match why.as_slice() {
        [] => String::new(),
        some => format!(" ({})", some.join("; ")),
    };
    Error::new(
        ErrorKind::NoData,
        path,
        format!("there is nothing to import{why}"),
    )
    .expected("at least one row of numbers")
    .action("take the recording again, or name another file")
}

/// Reads one file of any known format, told by its content.
///
/// # Errors
/// See [`importer_for`] and [`Importer::read`].
pub fn read_file(path: &Path) -> Result<Capture, Error> {
    read_file_as(path, None, &ReadOptions::default())
}

/// Reads one file with what a manifest says of it.
///
/// # Errors
/// See [`importer_for`] and [`Importer::read`].
pub fn read_file_as(
    path: &Path,
    format: Option<&str>,
    options: &ReadOptions,
) -> Result<Capture, Error> {
    let capture = importer_for(path, format)?.read(path, options)?;
    if capture.sections.iter().all(|s| s.rows() == 0) {
        return Err(nothing(path, &capture.notes));
    }
    Ok(capture)
}

/// The bytes before the first line's end that are not blank, for recognising a format by its first cell.
pub(super) fn first_cell(head: &[u8]) -> &[u8] {
    let line = head
        .split(|b| *b == b'\n')
        .find(|line| !text::is_blank(line))
        .unwrap_or_default();
    let cell = line
        .split(|b| matches!(b, b',' | b';' | b'\t'))
        .next()
        .unwrap_or_default();
    let cell = text::trim(cell);
    cell.strip_prefix(b"\"")
        .and_then(|c| c.strip_suffix(b"\""))
        .unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_lines_are_kept_in_runs() {
        let mut lines = RowLines::default();
        for line in [6, 7, 8, 12, 13] {
            lines.push(line);
        }
        assert_eq!(lines.runs.len(), 2);
        let back: Vec<u64> = (0..5).map(|row| lines.line(row)).collect();
        assert_eq!(back, [6, 7, 8, 12, 13]);
    }

    #[test]
    fn first_cells() {
        assert_eq!(first_cell(b",,,\r\n\"Devices\",,\n"), b"Devices");
        assert_eq!(first_cell(b"Model Outputs\r\n"), b"Model Outputs");
        assert_eq!(first_cell(b""), b"");
    }
}
