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
use std::path::Path;

use super::capture::{
    BATCH, Capture, Column, Group, Importer, Note, ReadOptions, Section, Sink, first_cell,
};
use super::error::{Error, ErrorKind, quote};
use super::rows::{End, Table, rounded_rate, whole, zero_frame};
use super::text::{
    Cells, Delimiter, LineReader, Notation, NumberColumn, bad_cell, decode, is_blank, plain_number,
    says_not_finite, texts,
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
    let top = texts(lines.line(), Delimiter::Comma);
    let key = |name: &str| {
        top.chunks(2)
            .find(|pair| pair[0].eq_ignore_ascii_case(name))
            .and_then(|pair| pair.get(1))
            .filter(|v| !v.is_empty())
            .cloned()
    };
    let mut rows: Vec<(String, Vec<String>)> = Vec::new();
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
        rows.push((cells.get(1).cloned().unwrap_or_default(), cells));
    };
    if not_utf8 {
        lines.note_not_utf8();
    }
    let path = lines.path();
    let row = |name: &str| {
        rows.iter()
            .find(|r| r.0.eq_ignore_ascii_case(name))
            .map_or(&[][..], |r| &r.1)
    };
    let (kinds, names, ids) = (row("Type"), row("Name"), row("ID"));
    // the last row without a name says what is measured
    let measures = rows
        .iter()
        .rev()
        .find(|r| r.0.is_empty())
        .map_or(&[][..], |r| &r.1);
    let at = |row: &[String], i: usize| row.get(i).cloned().unwrap_or_default();
    let number = |name: &str| {
        let (v, _) = plain_number(key(name)?.as_bytes())?;
        (v.is_finite() && v > 0.0).then_some(v)
    };
    let length = key("Length Units").unwrap_or_default();
    if length.is_empty() {
        notes.push(Note::warning(
            path,
            "the unit of the positions is not stated; state it, as in unit = \"mm\"",
        ));
    }
    let rotation = key("Rotation Type").unwrap_or_default();
    let quaternion = rotation.eq_ignore_ascii_case("Quaternion") || rotation.is_empty();
    if !quaternion {
        notes.push(Note::info(
            path,
            format!("rotations are Euler angles {}", quote(&rotation)),
        ));
    }
    let mut section = Section {
        name: "Trajectories".to_owned(),
        line: lines.number(),
        rate_hz: number("Export Frame Rate").or_else(|| number("Capture Frame Rate")),
        ..Section::default()
    };
    let time = axes
        .get(1)
        .is_some_and(|c| c.to_lowercase().starts_with("time"))
        .then_some(1);
    let from = 1 + usize::from(time.is_some());
    let width = axes.len().max(names.len()).max(measures.len());
    let mut slots = vec![None; from];
    let mut before: Option<(String, String, String)> = None;
    let mut taken = HashSet::new();
    for i in from..width {
        let (kind, name, id) = (at(kinds, i), at(names, i), at(ids, i));
        let (measure, axis) = (at(measures, i), at(&axes, i));
        if name.is_empty() && measure.is_empty() && axis.is_empty() {
            slots.push(None);
            continue;
        }
        let this = (kind, name, id);
        let column = section.columns.len();
        if before.as_ref() != Some(&this) {
            let (kind, name, id) = &this;
            section.groups.push(Group {
                name: free_name(&mut taken, kind, name, id, i),
                columns: column..column,
            });
            before = Some(this);
        }
        let rotates = measure.eq_ignore_ascii_case("Rotation");
        let moves = measure.eq_ignore_ascii_case("Position") || measure.is_empty();
        let axis = match (rotates, moves) {
            (true, _) => format!("R{axis}"),
            (_, true) => axis,
            _ if axis.is_empty() => measure.clone(),
            _ => format!("{measure} {axis}"),
        };
        let unit = match (rotates, measure.to_lowercase().as_str()) {
            (true, _) if quaternion => "",
            (true, _) => "deg",
            // a quality is a share, an error a length
            (_, m) if m.contains("quality") => "",
            _ => &length,
        };
        if let Some(group) = section.groups.last_mut() {
            group.columns.end = column + 1;
            section.columns.push(Column {
                group: group.name.clone(),
                axis,
                unit: unit.to_owned(),
                number: i + 1,
                values: Vec::new(),
            });
            slots.push(Some(column));
        }
    }
    if section.columns.is_empty() {
        return Err(
            Error::new(ErrorKind::NoData, path, "no marker has a column")
                .at_line(section.line)
                .action("export the take again with its markers or rigid bodies"),
        );
    }
    errors_last(&mut section, &mut slots);
    if let Some(space) = key("Coordinate Space").filter(|s| !s.eq_ignore_ascii_case("Global")) {
        notes.push(Note::warning(
            path,
            format!(
                "positions are in coordinate space {}, not Global",
                quote(&space)
            ),
        ));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let declared = number("Total Exported Frames").map(|n| n as u64);
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
    let mut section = Section {
        name: "Trajectories".to_owned(),
        line: 1,
        ..Section::default()
    };
    let mut names = Names {
        markers: HashMap::new(),
        bodies: HashMap::new(),
        titles: HashMap::new(),
    };
    let mut declared = None;
    let (mut rows, mut passed_over, mut cut, mut twice) = (0u64, 0u64, false, 0u64);
    let mut first = (0, 0.0);
    let mut last = (0, 0.0);
    let mut missing_frames = 0;
    let mut here = true;
    while here || lines.advance()? {
        here = false;
        if is_blank(lines.line()) {
            continue;
        }
        let mut cells = Cells::new(lines.line(), Delimiter::Comma);
        match cells.next().map_or(&b""[..], |c| c.bytes) {
            b"frame" => {
                let many = section.frames.len();
                match frame(lines, &mut section, &mut names, many, &mut twice) {
                    Ok((number, time)) => {
                        if rows == 0 {
                            first = (number, time);
                            section.line = lines.number();
                        } else if number <= last.0 {
                            return Err(Error::new(
                                ErrorKind::TimeOrder,
                                lines.path(),
                                format!("frame {number} follows frame {}", last.0),
                            )
                            .at_line(lines.number())
                            .at_column(2)
                            .expected("frame numbers that rise")
                            .action("delete the repeated rows, or export the take again"));
                        } else {
                            missing_frames += number - last.0 - 1;
                        }
                        last = (number, time);
                        rows += 1;
                        section.frames.push(number);
                        section.lines.push(lines.number());
                        for column in &mut section.columns {
                            column.values.resize(many + 1, f64::NAN);
                        }
                        lines.spend(section.columns.len())?;
                        if (many + 1) * section.columns.len() >= BATCH {
                            sink.rows(0, &mut section);
                        }
                    }
                    Err(_) if !lines.ended_with_newline() => {
                        for column in &mut section.columns {
                            column.values.truncate(many);
                            column.values.resize(many, f64::NAN);
                        }
                        cut = true;
                        break;
                    }
                    Err(e) => return Err(e),
                }
            }
            b"info" => {
                let key = cells.next().map_or(&b""[..], |c| c.bytes);
                let value = cells.next().map_or(&b""[..], |c| c.bytes);
                if key == b"framecount" {
                    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                    let count = plain_number(value).map(|(v, _)| v as u64);
                    declared = count;
                }
            }
            b"rigidbody" => {
                // a definition has a name where the extended rows of a frame have its number
                let (name, id) = (cells.next(), cells.next());
                if let (Some(name), Some(id)) = (name, id)
                    && plain_number(name.bytes).is_none()
                {
                    names.titles.insert(id.text(), name.text());
                } else {
                    passed_over += 1;
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
    }
    if rows == 0 || section.columns.is_empty() {
        return Err(Error::new(
            ErrorKind::NoData,
            lines.path(),
            format!("{rows} frames and no marker in them"),
        )
        .action("export the take again with its markers"));
    }
    #[allow(clippy::cast_precision_loss)]
    let rate = (last.0 - first.0) as f64 / (last.1 - first.1);
    section.rate_hz = rounded_rate(rate);
    section.zero_frame = zero_frame(first.0, first.1, section.rate_hz);
    sink.rows(0, &mut section);
    let path = lines.path();
    notes.push(Note::info(
        path,
        format!(
            "section Trajectories: {rows} rows, frames {} to {}, {} groups",
            first.0,
            last.0,
            section.groups.len()
        ),
    ));
    match section.rate_hz {
        Some(rate_hz) => notes.push(Note::info(
            path,
            format!("no rate is stated; {rate_hz} Hz from the printed times"),
        )),
        None => notes.push(Note::warning(
            path,
            "no rate is stated and the printed times do not rise",
        )),
    }
    notes.push(Note::warning(
        path,
        "the unit of the positions is not stated (this version of Motive wrote metres); state it, as in unit = \"m\"",
    ));
    let mut warn = |text: String| notes.push(Note::warning(path, text));
    if let Some(declared) = declared.filter(|d| *d != rows) {
        warn(format!("{declared} frames are declared, {rows} are there"));
    }
    if missing_frames > 0 {
        warn(format!("{missing_frames} frames are not in the file"));
    }
    if cut {
        warn("the file ends in the middle of a row, which is dropped".to_owned());
    }
    if twice > 0 {
        warn(format!(
            "{twice} times a marker's name is twice in a frame; the first counts"
        ));
    }
    if passed_over > 0 {
        notes.push(Note::info(
            path,
            format!("{passed_over} rows with the markers of rigid bodies are left out"),
        ));
    }
    Ok(section)
}

/// One frame of the old layout: its number and time. The values go to the end of their columns.
fn frame(
    lines: &LineReader,
    section: &mut Section,
    names: &mut Names,
    rows: usize,
    twice: &mut u64,
) -> Result<(i64, f64), Error> {
    let mut cells = Cells::new(lines.line(), Delimiter::Comma)
        .enumerate()
        .skip(1);
    let mut next = || {
        cells.next().ok_or_else(|| {
            Error::new(ErrorKind::CellCount, lines.path(), "the row ends too early")
                .at_line(lines.number())
                .expected("as many bodies and markers as it counts")
                .action("a row was cut; delete it or export the take again")
        })
    };
    let parse = |(i, cell): (usize, super::text::Cell)| -> Result<f64, Error> {
        if says_not_finite(cell.bytes) {
            return Ok(f64::NAN);
        }
        NumberColumn::new(Delimiter::Comma, Notation::Dot)
            .parse(cell.bytes)
            .map_err(|t| bad_cell(lines.path(), lines.number(), i + 1, cell.bytes, t))
    };
    let count = |value: f64, cell: usize| -> Result<u64, Error> {
        // each needs a cell: no row has more
        if value.fract() == 0.0 && (0.0..1e6).contains(&value) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            return Ok(value as u64);
        }
        Err(
            Error::new(ErrorKind::BadNumber, lines.path(), format!("found {value}"))
                .at_line(lines.number())
                .at_column(cell)
                .expected("how many there are")
                .action("use the file as Motive exported it"),
        )
    };
    let number = whole(lines, parse(next()?)?, 1, "a frame number")?;
    let time = parse(next()?)?;
    let bodies = count(parse(next()?)?, 4)?;
    let mut put = |section: &mut Section, at: usize, values: &[f64]| {
        let columns = &mut section.columns[at..at + values.len()];
        if columns[0].values.len() > rows {
            *twice += 1;
            return;
        }
        for (column, value) in columns.iter_mut().zip(values) {
            column.values.push(*value);
        }
    };
    for _ in 0..bodies {
        let id = next()?.1.text();
        let mut values = [0.0; 10];
        for v in &mut values {
            *v = parse(next()?)?;
        }
        let at = match names.bodies.get(&id) {
            Some(at) => *at,
            None => {
                let name = names.titles.get(&id).cloned().unwrap_or_else(|| id.clone());
                let at = add(
                    section,
                    &name,
                    rows,
                    &["X", "Y", "Z", "RX", "RY", "RZ", "RW"],
                );
                names.bodies.insert(id, at);
                at
            }
        };
        // yaw, pitch and roll say the same again
        put(section, at, &values[..7]);
    }
    let place = next()?;
    let markers = count(parse(place)?, place.0 + 1)?;
    for _ in 0..markers {
        let mut values = [0.0; 3];
        for v in &mut values {
            *v = parse(next()?)?;
        }
        let id = next()?.1;
        let name = next()?.1;
        let name = if name.bytes.is_empty() {
            id.text()
        } else {
            name.text()
        };
        let at = match names.markers.get(&name) {
            Some(at) => *at,
            None => {
                let at = add(section, &name, rows, &["X", "Y", "Z"]);
                names.markers.insert(name, at);
                at
            }
        };
        put(section, at, &values);
    }
    Ok((number, time))
}

/// A group that was not seen in the rows before; where its columns begin.
fn add(section: &mut Section, name: &str, rows: usize, axes: &[&str]) -> usize {
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
