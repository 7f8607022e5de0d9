//! CSV exports of OptiTrack Motive, in both of its layouts.
//!
//! Since format 1.2 a table:
//!
//! ```text
//! Format Version,1.23,Take Name,...,Length Units,Millimeters,Coordinate Space,Global      key, value, ...
//!
//! ,Type,Rigid Body,...,Rigid Body Marker,...,Marker,...
//! ,Name,...          ,ID,...          [,Parent,...]
//! ,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,...
//! Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,...
//! rows
//! ```
//!
//! Before that, rows that say what they are; markers come and go, and no unit is stated (it was m):
//!
//! ```text
//! comment,... | info,version,1.1 | righthanded | rigidbody,name,id,markers,...
//! frame,index,time,bodies,(id,x,y,z,qx,qy,qz,qw,yaw,pitch,roll)*,markers,(x,y,z,id,name)*
//! ```
//!
//! Rotations are columns RX, RY, RZ, RW (quaternions, scalar last; Euler angles have no RW), positions X, Y,
//! Z. An empty cell is a gap. The printed time is rounded to ms: frames and the rate say when.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::iter::{Enumerate, Skip};
use std::path::Path;

use super::capture::{
    BATCH, Capture, Column, Group, Importer, Note, ReadOptions, Section, Sink, first_cell,
};
use super::error::{Error, ErrorKind, quote};
use super::rows::{End, Table, no_unit, positive, rounded_rate, whole, zero_frame};
use super::text::{
    Cell, Cells, Delimiter, LineReader, Notation, NumberColumn, bad_cell, decode, is_blank,
    plain_number, says_not_finite, texts,
};

/// The importer of Motive exports.
pub struct OptitrackCsv;

impl Importer for OptitrackCsv {
    fn name(&self) -> &'static str {
        "optitrack-csv"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        match first_cell(head) {
            b"Format Version" => true,
            b"comment" | b"info" | b"righthanded" | b"lefthanded" | b"frame" => is_row_typed(head),
            _ => false,
        }
    }

    fn stream(
        &self,
        path: &Path,
        options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        let mut comma_cells = BTreeSet::new();
        loop {
            let mut lines = LineReader::open(path, options.encoding.as_deref())?;
            let mut notes = Vec::new();
            while lines.advance()? && is_blank(lines.line()) {}
            let section = if first_cell(lines.line()) == b"Format Version" {
                let mut table = header(&mut lines, &mut notes)?;
                let end = table.read(&mut lines, false, &mut comma_cells, sink, &mut notes)?;
                if end == End::Reread {
                    sink.restart();
                    continue;
                }
                table.section
            } else {
                row_typed(&mut lines, sink, &mut notes)?
            };
            return Ok(Capture {
                format: self.name(),
                sections: vec![section],
                notes,
            });
        }
    }
}

/// Whether the first rows are of the kinds of the old layout.
fn is_row_typed(head: &[u8]) -> bool {
    let kinds: [&[u8]; 6] = [
        b"comment",
        b"info",
        b"righthanded",
        b"lefthanded",
        b"frame",
        b"rigidbody",
    ];
    let mut lines = head
        .split(|b| *b == b'\n')
        .filter(|l| !is_blank(l))
        .map(first_cell)
        .peekable();
    let mut told = false;
    let mut n = 0;
    while let Some(kind) = lines.next() {
        // the last line of the head may be cut
        if lines.peek().is_none() && n > 0 {
            break;
        }
        if !kinds.contains(&kind) {
            return false;
        }
        told |= kind != b"comment";
        n += 1;
    }
    told
}

/// The rows of the newer layout, up to the one that begins with Frame.
fn header(lines: &mut LineReader, notes: &mut Vec<Note>) -> Result<Table, Error> {
    let keys = Keys(texts(lines.line(), Delimiter::Comma));
    let titles = Titles::read(lines)?;
    let path = lines.path();
    let units = Units::new(&keys, path, notes);
    let mut section = Section {
        name: "Trajectories".to_owned(),
        line: lines.number(),
        rate_hz: keys
            .number("Export Frame Rate")
            .or_else(|| keys.number("Capture Frame Rate")),
        ..Section::default()
    };
    let time = titles
        .axes
        .get(1)
        .is_some_and(|c| c.to_lowercase().starts_with("time"))
        .then_some(1);
    let mut slots = vec![None; 1 + usize::from(time.is_some())];
    add_columns(&mut section, &mut slots, &titles, &units);
    if section.columns.is_empty() {
        return Err(
            Error::new(ErrorKind::NoData, path, "no marker has a column")
                .at_line(section.line)
                .action("export the take again with its markers or rigid bodies"),
        );
    }
    errors_last(&mut section, &mut slots);
    if let Some(space) = keys
        .text("Coordinate Space")
        .filter(|s| !s.eq_ignore_ascii_case("Global"))
    {
        notes.push(Note::warning(
            path,
            format!(
                "positions are in coordinate space {}, not Global",
                quote(space)
            ),
        ));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let declared = keys.number("Total Exported Frames").map(|n| n as u64);
    Ok(Table {
        section,
        delimiter: Delimiter::Comma,
        frame: Some(0),
        time,
        slots,
        zero_is_gap: false,
        grows: false,
        declared,
    })
}

/// The first row: key, value, key, value, ...
struct Keys(Vec<String>);

impl Keys {
    /// What stands after a key.
    fn text(&self, name: &str) -> Option<&str> {
        self.0
            .chunks(2)
            .find(|pair| pair[0].eq_ignore_ascii_case(name))
            .and_then(|pair| pair.get(1))
            .filter(|v| !v.is_empty())
            .map(String::as_str)
    }

    /// A number above 0 after a key.
    fn number(&self, name: &str) -> Option<f64> {
        positive(self.text(name)?)
    }
}

/// The rows above the frames.
struct Titles {
    kinds: Vec<String>,
    names: Vec<String>,
    ids: Vec<String>,
    /// What is measured.
    measures: Vec<String>,
    axes: Vec<String>,
}

impl Titles {
    /// Reads up to the row that begins with Frame.
    fn read(lines: &mut LineReader) -> Result<Self, Error> {
        let mut rows: Vec<Vec<String>> = Vec::new();
        let mut not_utf8 = false;
        let axes = loop {
            if !lines.advance()? {
                return Err(Error::new(
                    ErrorKind::NoData,
                    lines.path(),
                    "the file ends in its header",
                )
                .at_line(lines.number() + 1)
                .expected("the row Frame, Time (Seconds), X, Y, Z, ...")
                .action("the file was cut; export the take again"));
            }
            if is_blank(lines.line()) {
                continue;
            }
            not_utf8 |= std::str::from_utf8(lines.line()).is_err();
            let cells = texts(lines.line(), Delimiter::Comma);
            if cells[0].eq_ignore_ascii_case("Frame") {
                break cells;
            }
            if !cells[0].is_empty() || rows.len() > 16 {
                return Err(Error::new(
                    ErrorKind::Grammar,
                    lines.path(),
                    format!("found {}", quote(&cells[0])),
                )
                .at_line(lines.number())
                .at_column(1)
                .expected("the rows Type, Name, ID and then Frame, Time (Seconds), X, Y, Z, ...")
                .action("a header row is missing or was edited; export the take again"));
            }
            rows.push(cells);
        };
        if not_utf8 {
            lines.note_not_utf8();
        }
        let title = |row: &Vec<String>| row.get(1).cloned().unwrap_or_default();
        let row = |name: &str| rows.iter().find(|r| title(r).eq_ignore_ascii_case(name));
        Ok(Titles {
            kinds: row("Type").cloned().unwrap_or_default(),
            names: row("Name").cloned().unwrap_or_default(),
            ids: row("ID").cloned().unwrap_or_default(),
            // the last row without a name
            measures: rows
                .iter()
                .rfind(|r| title(r).is_empty())
                .cloned()
                .unwrap_or_default(),
            axes,
        })
    }

    /// Kind, name, ID, measure and axis of a cell.
    fn cell(&self, i: usize) -> [String; 5] {
        [
            &self.kinds,
            &self.names,
            &self.ids,
            &self.measures,
            &self.axes,
        ]
        .map(|row| row.get(i).cloned().unwrap_or_default())
    }
}

/// In what units positions and rotations are.
struct Units {
    length: String,
    quaternion: bool,
}

impl Units {
    /// As the keys say; notes what they leave open.
    fn new(keys: &Keys, path: &Path, notes: &mut Vec<Note>) -> Self {
        let length = keys.text("Length Units").unwrap_or_default().to_owned();
        if length.is_empty() {
            notes.push(no_unit(path));
        }
        let rotation = keys.text("Rotation Type").unwrap_or_default();
        let quaternion = rotation.eq_ignore_ascii_case("Quaternion") || rotation.is_empty();
        if !quaternion {
            notes.push(Note::info(
                path,
                format!("rotations are Euler angles {}", quote(rotation)),
            ));
        }
        Units { length, quaternion }
    }

    /// What the axis of a column is called, and its unit.
    fn axis(&self, measure: &str, axis: String) -> (String, String) {
        let rotates = measure.eq_ignore_ascii_case("Rotation");
        let moves = measure.eq_ignore_ascii_case("Position") || measure.is_empty();
        let unit = match (rotates, measure.to_lowercase().as_str()) {
            (true, _) if self.quaternion => "",
            (true, _) => "deg",
            // a quality is a share, an error a length
            (_, m) if m.contains("quality") => "",
            _ => &self.length,
        };
        let axis = match (rotates, moves) {
            (true, _) => format!("R{axis}"),
            (_, true) => axis,
            _ if axis.is_empty() => measure.to_owned(),
            _ => format!("{measure} {axis}"),
        };
        (axis, unit.to_owned())
    }
}

/// A column for every cell with a title, after the cells that have their slots.
fn add_columns(
    section: &mut Section,
    slots: &mut Vec<Option<usize>>,
    titles: &Titles,
    units: &Units,
) {
    let width = titles
        .axes
        .len()
        .max(titles.names.len())
        .max(titles.measures.len());
    let mut before: Option<[String; 3]> = None;
    let mut taken = HashSet::new();
    for i in slots.len()..width {
        let [kind, name, id, measure, axis] = titles.cell(i);
        if name.is_empty() && measure.is_empty() && axis.is_empty() {
            slots.push(None);
            continue;
        }
        let this = [kind, name, id];
        let column = section.columns.len();
        if before.as_ref() != Some(&this) {
            let [kind, name, id] = &this;
            section.groups.push(Group {
                name: free_name(&mut taken, kind, name, id, i),
                columns: column..column,
            });
            before = Some(this);
        }
        let (axis, unit) = units.axis(&measure, axis);
        if let Some(group) = section.groups.last_mut() {
            group.columns.end = column + 1;
            section.columns.push(Column {
                group: group.name.clone(),
                axis,
                unit,
                number: i + 1,
                values: Vec::new(),
            });
            slots.push(Some(column));
        }
    }
}

/// A name that no group has: with its kind, and then with its ID or cell.
fn free_name(taken: &mut HashSet<String>, kind: &str, name: &str, id: &str, cell: usize) -> String {
    let bare = if name.is_empty() { id } else { name };
    let tries = [
        bare.to_owned(),
        format!("{bare} ({kind})"),
        format!("{bare} ({kind} {id})"),
    ];
    let free = tries
        .into_iter()
        .find(|n| !n.is_empty() && !taken.contains(n))
        .unwrap_or_else(|| format!("{bare}#{}", cell + 1));
    taken.insert(free.clone());
    free
}

/// A marker is there without its error too: columns that are neither rotation nor position leave their
/// group's range.
fn errors_last(section: &mut Section, slots: &mut [Option<usize>]) {
    let is_pose =
        |c: &Column| matches!(c.axis.as_str(), "X" | "Y" | "Z" | "RX" | "RY" | "RZ" | "RW");
    let mut order = Vec::with_capacity(section.columns.len());
    let mut last = Vec::new();
    for group in &mut section.groups {
        let from = order.len();
        for c in group.columns.clone() {
            if is_pose(&section.columns[c]) {
                order.push(c);
            } else {
                last.push(c);
            }
        }
        group.columns = from..order.len();
    }
    order.extend(last);
    let mut place = vec![0; order.len()];
    for (new, old) in order.iter().enumerate() {
        place[*old] = new;
    }
    section.columns = order.iter().map(|c| section.columns[*c].clone()).collect();
    section.groups.retain(|g| !g.columns.is_empty());
    for slot in slots.iter_mut().flatten() {
        *slot = place[*slot];
    }
}

/// What a name in the old layout has: its first column.
#[derive(Default)]
struct Names {
    markers: HashMap<String, usize>,
    bodies: HashMap<String, usize>,
    /// Names of rigid bodies by their ID.
    titles: HashMap<String, String>,
}

/// The old layout: rows that say what they are.
fn row_typed(
    lines: &mut LineReader,
    sink: &mut dyn Sink,
    notes: &mut Vec<Note>,
) -> Result<Section, Error> {
    let mut take = Take {
        section: Section {
            name: "Trajectories".to_owned(),
            line: 1,
            ..Section::default()
        },
        ..Take::default()
    };
    let mut here = true;
    while !take.cut && (here || lines.advance()?) {
        here = false;
        if !is_blank(lines.line()) {
            take.row(lines, sink)?;
        }
    }
    let Take {
        rows, first, last, ..
    } = take;
    if rows == 0 || take.section.columns.is_empty() {
        return Err(Error::new(
            ErrorKind::NoData,
            lines.path(),
            format!("{rows} frames and no marker in them"),
        )
        .action("export the take again with its markers"));
    }
    let section = &mut take.section;
    #[allow(clippy::cast_precision_loss)]
    let rate = (last.0 - first.0) as f64 / (last.1 - first.1);
    section.rate_hz = rounded_rate(rate);
    section.zero_frame = zero_frame(first.0, first.1, section.rate_hz);
    sink.rows(0, section);
    take.tell(lines.path(), notes);
    Ok(take.section)
}

/// What is read of a file of the old layout.
#[derive(Default)]
struct Take {
    section: Section,
    names: Names,
    declared: Option<u64>,
    rows: u64,
    /// Number and time of a frame.
    first: (i64, f64),
    last: (i64, f64),
    missing_frames: i64,
    /// Markers whose name was in the frame already.
    twice: u64,
    passed_over: u64,
    cut: bool,
}

impl Take {
    /// Takes a row of any kind.
    fn row(&mut self, lines: &mut LineReader, sink: &mut dyn Sink) -> Result<(), Error> {
        let mut cells = Cells::new(lines.line(), Delimiter::Comma);
        match cells.next().map_or(&b""[..], |c| c.bytes) {
            b"frame" => return self.frame_row(lines, sink),
            b"info" => {
                let key = cells.next().map_or(&b""[..], |c| c.bytes);
                let value = cells.next().map_or(&b""[..], |c| c.bytes);
                if key == b"framecount" {
                    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                    let count = plain_number(value).map(|(v, _)| v as u64);
                    self.declared = count;
                }
            }
            b"rigidbody" => {
                // a definition has a name where the extended rows of a frame have its number
                let (name, id) = (cells.next(), cells.next());
                if let (Some(name), Some(id)) = (name, id)
                    && plain_number(name.bytes).is_none()
                {
                    self.names.titles.insert(id.text(), name.text());
                } else {
                    self.passed_over += 1;
                }
            }
            b"comment" | b"righthanded" | b"lefthanded" => {}
            other => {
                return Err(Error::new(
                    ErrorKind::Grammar,
                    lines.path(),
                    format!("found {}", quote(&decode(other))),
                )
                .at_line(lines.number())
                .at_column(1)
                .expected("comment, info, rigidbody, righthanded, lefthanded or frame")
                .action("use the file as Motive exported it"));
            }
        }
        Ok(())
    }

    /// Takes a frame that follows the last; one in which the file ends is dropped.
    fn frame_row(&mut self, lines: &mut LineReader, sink: &mut dyn Sink) -> Result<(), Error> {
        let many = self.section.frames.len();
        let (number, time) = match self.frame(lines) {
            Ok(frame) => frame,
            Err(_) if !lines.ended_with_newline() => {
                for column in &mut self.section.columns {
                    column.values.truncate(many);
                    column.values.resize(many, f64::NAN);
                }
                self.cut = true;
                return Ok(());
            }
            Err(e) => return Err(e),
        };
        if self.rows == 0 {
            self.first = (number, time);
            self.section.line = lines.number();
        } else if number <= self.last.0 {
            return Err(Error::new(
                ErrorKind::TimeOrder,
                lines.path(),
                format!("frame {number} follows frame {}", self.last.0),
            )
            .at_line(lines.number())
            .at_column(2)
            .expected("frame numbers that rise")
            .action("delete the repeated rows, or export the take again"));
        } else {
            self.missing_frames += number - self.last.0 - 1;
        }
        self.last = (number, time);
        self.rows += 1;
        let section = &mut self.section;
        section.frames.push(number);
        section.lines.push(lines.number());
        for column in &mut section.columns {
            column.values.resize(many + 1, f64::NAN);
        }
        lines.spend(section.columns.len())?;
        if (many + 1) * section.columns.len() >= BATCH {
            sink.rows(0, section);
        }
        Ok(())
    }

    /// The number and time of a frame. The values go to the end of their columns.
    fn frame(&mut self, lines: &LineReader) -> Result<(i64, f64), Error> {
        let mut row = FrameRow {
            lines,
            cells: Cells::new(lines.line(), Delimiter::Comma)
                .enumerate()
                .skip(1),
        };
        let number = whole(lines, row.number()?, 1, "a frame number")?;
        let time = row.number()?;
        let bodies = row.count()?;
        for _ in 0..bodies {
            let id = row.next()?.1.text();
            let values: [f64; 10] = row.numbers()?;
            let at = match self.names.bodies.get(&id) {
                Some(at) => *at,
                None => {
                    let name = self.names.titles.get(&id).unwrap_or(&id);
                    let axes = ["X", "Y", "Z", "RX", "RY", "RZ", "RW"];
                    let at = add(&mut self.section, name, &axes);
                    self.names.bodies.insert(id, at);
                    at
                }
            };
            // yaw, pitch and roll say the same again
            self.put(at, &values[..7]);
        }
        let markers = row.count()?;
        for _ in 0..markers {
            let values: [f64; 3] = row.numbers()?;
            let (id, name) = (row.next()?.1, row.next()?.1);
            let name = if name.bytes.is_empty() {
                id.text()
            } else {
                name.text()
            };
            let at = match self.names.markers.get(&name) {
                Some(at) => *at,
                None => {
                    let at = add(&mut self.section, &name, &["X", "Y", "Z"]);
                    self.names.markers.insert(name, at);
                    at
                }
            };
            self.put(at, &values);
        }
        Ok((number, time))
    }

    /// Puts values into the frame, unless they are there already.
    fn put(&mut self, at: usize, values: &[f64]) {
        let columns = &mut self.section.columns[at..at + values.len()];
        if columns[0].values.len() > self.section.frames.len() {
            self.twice += 1;
            return;
        }
        for (column, value) in columns.iter_mut().zip(values) {
            column.values.push(*value);
        }
    }

    /// Notes what is in the file and what is not.
    fn tell(&self, path: &Path, notes: &mut Vec<Note>) {
        notes.push(Note::info(
            path,
            format!(
                "section Trajectories: {} rows, frames {} to {}, {} groups",
                self.rows,
                self.first.0,
                self.last.0,
                self.section.groups.len()
            ),
        ));
        notes.push(match self.section.rate_hz {
            Some(rate_hz) => Note::info(
                path,
                format!("no rate is stated; {rate_hz} Hz from the printed times"),
            ),
            None => Note::warning(path, "no rate is stated and the printed times do not rise"),
        });
        let mut warn = |text: String| notes.push(Note::warning(path, text));
        warn("the unit of the positions is not stated (this version of Motive wrote metres); state it, as in unit = \"m\"".to_owned());
        if let Some(declared) = self.declared.filter(|d| *d != self.rows) {
            warn(format!(
                "{declared} frames are declared, {} are there",
                self.rows
            ));
        }
        if self.missing_frames > 0 {
            warn(format!(
                "{} frames are not in the file",
                self.missing_frames
            ));
        }
        if self.cut {
            warn("the file ends in the middle of a row, which is dropped".to_owned());
        }
        if self.twice > 0 {
            warn(format!(
                "{} times a marker's name is twice in a frame; the first counts",
                self.twice
            ));
        }
        if self.passed_over > 0 {
            notes.push(Note::info(
                path,
                format!(
                    "{} rows with the markers of rigid bodies are left out",
                    self.passed_over
                ),
            ));
        }
    }
}

/// A row of a frame, cell by cell.
struct FrameRow<'a> {
    lines: &'a LineReader,
    cells: Skip<Enumerate<Cells<'a>>>,
}

impl<'a> FrameRow<'a> {
    /// The next cell and its place.
    fn next(&mut self) -> Result<(usize, Cell<'a>), Error> {
        let lines = self.lines;
        self.cells.next().ok_or_else(|| {
            Error::new(ErrorKind::CellCount, lines.path(), "the row ends too early")
                .at_line(lines.number())
                .expected("as many bodies and markers as it counts")
                .action("a row was cut; delete it or export the take again")
        })
    }

    /// A number; NaN where the cell says so or is empty.
    fn parse(&self, (i, cell): (usize, Cell)) -> Result<f64, Error> {
        if says_not_finite(cell.bytes) {
            return Ok(f64::NAN);
        }
        NumberColumn::new(Delimiter::Comma, Notation::Dot)
            .parse(cell.bytes)
            .map_err(|t| bad_cell(self.lines.path(), self.lines.number(), i + 1, cell.bytes, t))
    }

    /// The next cell as a number.
    fn number(&mut self) -> Result<f64, Error> {
        let cell = self.next()?;
        self.parse(cell)
    }

    /// So many numbers.
    fn numbers<const N: usize>(&mut self) -> Result<[f64; N], Error> {
        let mut values = [0.0; N];
        for v in &mut values {
            *v = self.number()?;
        }
        Ok(values)
    }

    /// How many bodies or markers follow.
    fn count(&mut self) -> Result<u64, Error> {
        let cell = self.next()?;
        let value = self.parse(cell)?;
        // each needs a cell: no row has more
        if value.fract() == 0.0 && (0.0..1e6).contains(&value) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            return Ok(value as u64);
        }
        Err(Error::new(
            ErrorKind::BadNumber,
            self.lines.path(),
            format!("found {value}"),
        )
        .at_line(self.lines.number())
        .at_column(cell.0 + 1)
        .expected("how many there are")
        .action("use the file as Motive exported it"))
    }
}

/// A group that was not seen in the rows before; where its columns begin.
fn add(section: &mut Section, name: &str, axes: &[&str]) -> usize {
    let rows = section.frames.len();
    let at = section.columns.len();
    section.groups.push(Group {
        name: name.to_owned(),
        columns: at..at + axes.len(),
    });
    for axis in axes {
        section.columns.push(Column {
            group: name.to_owned(),
            axis: (*axis).to_owned(),
            unit: String::new(),
            number: section.columns.len() + 1,
            values: vec![f64::NAN; rows],
        });
    }
    at
}
