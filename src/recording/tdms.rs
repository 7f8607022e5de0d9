//! TDMS of National Instruments.
//!
//! ```text
//! file    := segment*
//! segment := "TDSm", contents u32, version u32, next segment u64, raw data u64, metadata?, raw data?
//! ```
//!
//! A segment that lists no objects goes on with those of the one before; one may list only what changed. Raw
//! data of the listed channels repeat until the segment ends, one channel after the other or interleaved, in
//! either byte order. A file that was cut (or is still being written) gives the values that are whole. Values
//! that the driver left unscaled (`NI_Scale`) are scaled, which is said; so are scales that are not known
//! here.
//!
//! Channels of a group that share a clock (`wf_start_offset`, `wf_increment`) and a length are one section.
//! No length in the file is believed: what is read is what the file has bytes for.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::capture::{Capture, Column, Group, Importer, Note, ReadOptions, RowLines, Section};
use super::error::{Error, ErrorKind, quote};
use super::text::decode;

/// The importer of TDMS files.
pub struct Tdms;

impl Importer for Tdms {
    fn name(&self) -> &'static str {
        "tdms"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        head.starts_with(b"TDSm")
    }

    fn read(&self, path: &Path, _options: &ReadOptions) -> Result<Capture, Error> {
        let mut file = super::opened::open(path).map_err(|e| Error::io(path, e))?;
        let size = file.metadata().map_err(|e| Error::io(path, e))?.len();
        let mut reader = Reader {
            path,
            size,
            objects: Vec::new(),
            by_path: HashMap::new(),
            order: Vec::new(),
            notes: Vec::new(),
            segments: 0,
            cut: false,
        };
        reader.file(&mut file)?;
        reader.finish()
    }
}

/// The longest metadata of one segment, bytes.
const MAX_METADATA: u64 = 256 << 20;
/// How much raw data is held at a time.
const BLOCK: usize = 1 << 20;

/// How a number is kept in a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    Bool,
    Text,
    Time,
    /// A size that is known and a content that is no number here.
    Other(u64),
}

impl Kind {
    fn parse(code: u32) -> Option<Kind> {
        Some(match code {
            0 => Kind::Other(0),
            1 => Kind::I8,
            2 => Kind::I16,
            3 => Kind::I32,
            4 => Kind::I64,
            5 => Kind::U8,
            6 => Kind::U16,
            7 => Kind::U32,
            8 => Kind::U64,
            9 | 0x19 => Kind::F32,
            10 | 0x1a => Kind::F64,
            11 | 0x1b => Kind::Other(16),
            0x20 => Kind::Text,
            0x21 => Kind::Bool,
            0x44 => Kind::Time,
            0x08_000c => Kind::Other(8),
            0x10_000d => Kind::Other(16),
            _ => return None,
        })
    }

    /// Bytes of a value; 0 for texts, which have no size of their own.
    pub(super) fn size(self) -> u64 {
        match self {
            Kind::U8 | Kind::I8 | Kind::Bool => 1,
            Kind::U16 | Kind::I16 => 2,
            Kind::U32 | Kind::I32 | Kind::F32 => 4,
            Kind::U64 | Kind::I64 | Kind::F64 => 8,
            Kind::Time => 16,
            Kind::Other(size) => size,
            Kind::Text => 0,
        }
    }

    fn is_number(self) -> bool {
        !matches!(self, Kind::Text | Kind::Other(_))
    }

    /// A value from as many bytes as its size.
    pub(super) fn value(self, bytes: &[u8], big: bool) -> f64 {
        macro_rules! of {
            ($t:ty, $n:literal) => {{
                let mut b = [0; $n];
                b.copy_from_slice(&bytes[..$n]);
                if big {
                    <$t>::from_be_bytes(b)
                } else {
                    <$t>::from_le_bytes(b)
                }
            }};
        }
        match self {
            Kind::U8 => f64::from(bytes[0]),
            Kind::Bool => f64::from(u8::from(bytes[0] != 0)),
            Kind::I8 => f64::from(bytes[0] as i8),
            Kind::U16 => f64::from(of!(u16, 2)),
            Kind::I16 => f64::from(of!(i16, 2)),
            Kind::U32 => f64::from(of!(u32, 4)),
            Kind::I32 => f64::from(of!(i32, 4)),
            Kind::U64 => of!(u64, 8) as f64,
            Kind::I64 => of!(i64, 8) as f64,
            Kind::F32 => f64::from(of!(f32, 4)),
            Kind::F64 => of!(f64, 8),
            Kind::Time => {
                // little-endian: fraction, seconds since 1904; the other way round in big-endian
                let (low, high) = (word(&bytes[..8], big), word(&bytes[8..16], big));
                let (fraction, seconds) = if big { (high, low) } else { (low, high) };
                stamp(seconds as i64, fraction)
            }
            Kind::Text | Kind::Other(_) => f64::NAN,
        }
    }
}

/// A word of eight bytes.
fn word(bytes: &[u8], big: bool) -> u64 {
    let mut b = [0; 8];
    b.copy_from_slice(bytes);
    if big {
        u64::from_be_bytes(b)
    } else {
        u64::from_le_bytes(b)
    }
}

/// Seconds since 1970 of seconds since 1904 and a fraction in 2^-64 s.
fn stamp(seconds: i64, fraction: u64) -> f64 {
    (seconds as f64 - 2_082_844_800.0) + fraction as f64 / 18_446_744_073_709_551_616.0
}

/// A time as a date of the Gregorian calendar: `2012-09-07 18:58:23 UTC`. What is beyond all calendars is
/// left in seconds.
fn utc(since_1970_s: f64) -> String {
    if since_1970_s.is_nan() || since_1970_s.abs() > 1e11 {
        return format!("{since_1970_s:e} s since 1970");
    }
    #[allow(clippy::cast_possible_truncation)]
    let seconds = since_1970_s.floor() as i64;
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // years that begin in March, 400 of which have 146097 days
    let day = days + 719_468;
    let (era, day) = (day.div_euclid(146_097), day.rem_euclid(146_097));
    let year = (day - day / 1_460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year + 400 * era + i64::from(month <= 2);
    format!(
        "{year:04}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC",
        second / 3_600,
        second / 60 % 60,
        second % 60
    )
}

/// How the raw data of a channel lie in a segment.
#[derive(Debug, Clone, PartialEq)]
enum Layout {
    /// `count` values of a kind; texts also have a size in bytes.
    Plain { kind: Kind, count: u64, bytes: u64 },
    /// Values inside the rows of an acquisition: which buffer, and what lies where in a row of it.
    Acquired {
        count: u64,
        scalers: Vec<Scaler>,
        widths: Vec<u64>,
    },
}

#[derive(Debug, Clone, PartialEq)]
struct Scaler {
    kind: Kind,
    buffer: usize,
    offset: u64,
    /// A bit of a digital line, not a number.
    bit: Option<u64>,
}

#[derive(Debug, Clone, PartialEq)]
enum Property {
    Number(f64),
    Text(String),
    Time(f64),
}

#[derive(Default)]
struct Object {
    path: String,
    properties: HashMap<String, Property>,
    layout: Option<Layout>,
    values: Vec<f64>,
    /// Whether it has values that are no numbers.
    odd: bool,
    /// Whether it has raw data in the segments to come.
    listed: bool,
}

impl Object {
    /// A property that is a number.
    fn number(&self, key: &str) -> Option<f64> {
        match self.properties.get(key) {
            Some(Property::Number(v)) => Some(*v),
            _ => None,
        }
    }

    /// A property that is a text.
    fn text(&self, key: &str) -> Option<&str> {
        match self.properties.get(key) {
            Some(Property::Text(t)) => Some(t),
            _ => None,
        }
    }
}

struct Reader<'a> {
    path: &'a Path,
    size: u64,
    objects: Vec<Object>,
    by_path: HashMap<String, usize>,
    /// Objects with raw data, in the order of the segment.
    order: Vec<usize>,
    notes: Vec<Note>,
    segments: u64,
    cut: bool,
}

/// Numbers and texts of the metadata.
struct Meta<'a> {
    bytes: &'a [u8],
    big: bool,
}

impl<'a> Meta<'a> {
    fn take(&mut self, count: u64) -> Option<&'a [u8]> {
        let count = usize::try_from(count).ok()?;
        if count > self.bytes.len() {
            return None;
        }
        let (here, rest) = self.bytes.split_at(count);
        self.bytes = rest;
        Some(here)
    }

    fn u32(&mut self) -> Option<u32> {
        let mut b = [0; 4];
        b.copy_from_slice(self.take(4)?);
        Some(if self.big {
            u32::from_be_bytes(b)
        } else {
            u32::from_le_bytes(b)
        })
    }

    fn u64(&mut self) -> Option<u64> {
        let mut b = [0; 8];
        b.copy_from_slice(self.take(8)?);
        Some(if self.big {
            u64::from_be_bytes(b)
        } else {
            u64::from_le_bytes(b)
        })
    }

    fn text(&mut self) -> Option<String> {
        let length = self.u32()?;
        self.take(u64::from(length)).map(|b| decode(b).into_owned())
    }

    fn property(&mut self) -> Option<Property> {
        let kind = Kind::parse(self.u32()?)?;
        Some(match kind {
            Kind::Text => Property::Text(self.text()?),
            Kind::Time => Property::Time(kind.value(self.take(16)?, self.big)),
            Kind::Other(_) => {
                self.take(kind.size())?;
                Property::Text(String::new())
            }
            _ => Property::Number(kind.value(self.take(kind.size())?, self.big)),
        })
    }
}

const NO_DATA: u32 = 0xffff_ffff;
const AS_BEFORE: u32 = 0;
const FORMAT_CHANGING: u32 = 0x1269;
const DIGITAL_LINE: u32 = 0x126a;

impl Reader<'_> {
    fn wrong(&self, at: u64, what: &str) -> Error {
        Error::new(
            ErrorKind::Grammar,
            self.path,
            format!("the segment at byte {at} is damaged: {what}"),
        )
        .action("copy the file again, or export it as text")
    }

    fn file(&mut self, file: &mut File) -> Result<(), Error> {
        let mut at = 0u64;
        while self.size - at >= 28 {
            let io = |e| Error::io(self.path, e);
            file.seek(SeekFrom::Start(at)).map_err(io)?;
            let mut lead = [0; 28];
            file.read_exact(&mut lead).map_err(io)?;
            if !lead.starts_with(b"TDSm") {
                return Err(self.wrong(at, "it does not begin with TDSm"));
            }
            let contents = u32::from_le_bytes([lead[4], lead[5], lead[6], lead[7]]);
            let has = |bit: u32| contents & (1 << bit) != 0;
            let big = has(6);
            let mut head = Meta {
                bytes: &lead[12..],
                big,
            };
            let next = head.u64().unwrap_or(u64::MAX);
            let raw = head.u64().unwrap_or(u64::MAX);
            self.segments += 1;
            let body = at + 28;
            let left = self.size - body;
            // u64::MAX: the writer did not come to close the segment
            let length = if next > left {
                self.cut = true;
                left
            } else {
                next
            };
            if raw > length {
                if self.cut {
                    break;
                }
                return Err(self.wrong(at, "its metadata are longer than it is"));
            }
            if has(1) {
                if raw > MAX_METADATA {
                    return Err(self.wrong(at, "its metadata are longer than 256 MiB"));
                }
                let mut bytes = vec![0; usize::try_from(raw).unwrap_or(0)];
                file.read_exact(&mut bytes).map_err(io)?;
                let mut meta = Meta { bytes: &bytes, big };
                if has(2) {
                    for i in self.order.drain(..) {
                        self.objects[i].listed = false;
                    }
                }
                if self.metadata(&mut meta).is_none() {
                    return Err(self.wrong(at, "its metadata cannot be read"));
                }
            }
            if has(3) {
                self.raw(file, body + raw, length - raw, has(5), big, at)?;
            }
            at = body + length;
        }
        self.cut |= at < self.size;
        Ok(())
    }

    fn metadata(&mut self, meta: &mut Meta) -> Option<()> {
        let count = meta.u32()?;
        for _ in 0..count {
            let path = meta.text()?;
            let at = match self.by_path.get(&path) {
                Some(at) => *at,
                None => {
                    self.objects.push(Object {
                        path: path.clone(),
                        ..Object::default()
                    });
                    self.by_path.insert(path, self.objects.len() - 1);
                    self.objects.len() - 1
                }
            };
            let index = meta.u32()?;
            match index {
                NO_DATA => self.objects[at].listed = false,
                AS_BEFORE => {
                    self.objects[at].layout.as_ref()?;
                    self.list(at);
                }
                _ => {
                    let layout = if matches!(index, FORMAT_CHANGING | DIGITAL_LINE) {
                        acquired(meta, index == DIGITAL_LINE)?
                    } else {
                        plain(meta)?
                    };
                    self.objects[at].layout = Some(layout);
                    self.list(at);
                }
            }
            for _ in 0..meta.u32()? {
                let name = meta.text()?;
                let value = meta.property()?;
                self.objects[at].properties.insert(name, value);
            }
        }
        let objects = &self.objects;
        self.order.retain(|i| objects[*i].listed);
        Some(())
    }

    /// Puts an object among those with raw data.
    fn list(&mut self, at: usize) {
        if !std::mem::replace(&mut self.objects[at].listed, true) {
            self.order.push(at);
        }
    }

    fn raw(
        &mut self,
        file: &mut File,
        from: u64,
        length: u64,
        interleaved: bool,
        big: bool,
        segment: u64,
    ) -> Result<(), Error> {
        let order = std::mem::take(&mut self.order);
        let acquired = order
            .iter()
            .any(|i| matches!(self.objects[*i].layout, Some(Layout::Acquired { .. })));
        let mut input = Input {
            file,
            left: length,
            buffer: Vec::new(),
        };
        let io = |e| Error::io(self.path, e);
        input.file.seek(SeekFrom::Start(from)).map_err(io)?;
        let result = if acquired {
            acquired_rows(&mut self.objects, &order, &mut input, big)
        } else if interleaved {
            interleaved_rows(&mut self.objects, &order, &mut input, big)
        } else {
            one_after_the_other(&mut self.objects, &order, &mut input, big)
        };
        self.order = order;
        match result {
            Ok(true) => Ok(()),
            Ok(false) => {
                self.cut = true;
                Ok(())
            }
            Err(Failed::Io(e)) => Err(Error::io(self.path, e)),
            Err(Failed::Wrong(what)) => Err(self.wrong(segment, what)),
        }
    }

    fn finish(mut self) -> Result<Capture, Error> {
        let path = self.path;
        let mut sorted = Sorted::default();
        for object in &mut self.objects {
            sorted.add(object, path, &mut self.notes);
        }
        // one name for the columns' group: that of the TDMS group
        for s in &mut sorted.sections {
            s.groups = vec![Group {
                name: s.name.clone(),
                columns: 0..s.columns.len(),
            }];
        }
        let mut notes = vec![Note::info(path, format!("{} segments", self.segments))];
        notes.append(&mut self.notes);
        for start in sorted.starts {
            notes.push(Note::info(
                path,
                format!(
                    "a waveform starts at {}; its times here count from there",
                    utc(start)
                ),
            ));
        }
        let list = |names: &[String]| names.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
        if !sorted.texts.is_empty() {
            notes.push(Note::warning(
                path,
                format!(
                    "channels without numbers are left out: {}",
                    list(&sorted.texts)
                ),
            ));
        }
        if !sorted.empty.is_empty() {
            notes.push(Note::info(
                path,
                format!("channels without a value: {}", list(&sorted.empty)),
            ));
        }
        if self.cut {
            notes.push(Note::warning(
                path,
                "the file was cut, or is still being written; the values that are whole are read",
            ));
        }
        if sorted.sections.is_empty() {
            return Err(
                Error::new(ErrorKind::NoData, path, "no channel holds a number")
                    .expected("at least one channel with values")
                    .action("take the recording again, or name another file"),
            );
        }
        Ok(Capture {
            format: "tdms",
            sections: sorted.sections,
            notes,
        })
    }
}

/// Channels in sections: those of a group with as many values and one clock are together.
#[derive(Default)]
struct Sorted {
    sections: Vec<Section>,
    /// The section of a group, rows, and a step and an offset as bits.
    clocks: HashMap<(String, usize, Option<[u64; 2]>), usize>,
    columns: usize,
    /// Channels without numbers.
    texts: Vec<String>,
    /// Channels without a value.
    empty: Vec<String>,
    /// When waveforms began; a few.
    starts: Vec<f64>,
}

impl Sorted {
    /// Adds a channel, or remembers why it is left out.
    fn add(&mut self, object: &mut Object, path: &Path, notes: &mut Vec<Note>) {
        let Some((group, name)) = names(&object.path) else {
            return;
        };
        if object.odd {
            self.texts.push(name);
            return;
        }
        if object.values.is_empty() {
            self.empty.push(name);
            return;
        }
        scale(object, &name, path, notes);
        for v in &mut object.values {
            if !v.is_finite() {
                *v = f64::NAN;
            }
        }
        let section = self.section(&group, object);
        let unit = ["unit_string", "NI_UnitDescription", "unit"]
            .iter()
            .find_map(|k| object.text(k).filter(|t| !t.is_empty()));
        let is_time = matches!(
            object.layout,
            Some(Layout::Plain {
                kind: Kind::Time,
                ..
            })
        );
        self.columns += 1;
        self.sections[section].columns.push(Column {
            group,
            axis: name,
            unit: unit.unwrap_or(if is_time { "s" } else { "" }).to_owned(),
            number: self.columns,
            values: std::mem::take(&mut object.values),
        });
    }

    /// Which section has the clock of a channel.
    fn section(&mut self, group: &str, object: &Object) -> usize {
        let rows = object.values.len();
        let offset = object
            .number("wf_start_offset")
            .filter(|o| o.is_finite())
            .unwrap_or(0.0);
        // a clock whose last time is beyond all numbers is none
        let step = object.number("wf_increment").filter(|s| {
            *s > 0.0 && s.recip().is_finite() && (offset + rows as f64 * s).is_finite()
        });
        // the beginning of 1904 is what a clock says that was never set
        if let Some(Property::Time(start)) = object.properties.get("wf_start_time")
            && *start != stamp(0, 0)
            && self.starts.len() < 4
            && !self.starts.contains(start)
        {
            self.starts.push(*start);
        }
        let clock = step.map(|s| [s.to_bits(), offset.to_bits()]);
        let sections = &mut self.sections;
        *self
            .clocks
            .entry((group.to_owned(), rows, clock))
            .or_insert_with(|| {
                let stamps = step.map(|s| (0..rows).map(|i| offset + i as f64 * s).collect());
                sections.push(Section {
                    name: group.to_owned(),
                    rate_hz: step.map(|s| 1.0 / s),
                    stamps_s: stamps,
                    lines: RowLines::without(rows),
                    ..Section::default()
                });
                sections.len() - 1
            })
    }
}

/// `/'Group'/'Channel'`: the two names; a mark inside a name is doubled.
fn names(path: &str) -> Option<(String, String)> {
    let mut parts = Vec::new();
    let mut rest = path;
    while let Some(body) = rest.strip_prefix("/'") {
        let mut name = String::new();
        let mut chars = body.char_indices().peekable();
        let mut end = body.len();
        while let Some((i, c)) = chars.next() {
            if c == '\'' {
                if chars.peek().is_some_and(|(_, d)| *d == '\'') {
                    chars.next();
                } else {
                    end = i + 1;
                    break;
                }
            }
            name.push(c);
        }
        parts.push(name);
        rest = &body[end..];
    }
    let [group, channel] = <[String; 2]>::try_from(parts).ok()?;
    Some((group, channel))
}

fn plain(meta: &mut Meta) -> Option<Layout> {
    let kind = Kind::parse(meta.u32()?)?;
    let _dimension = meta.u32()?;
    let count = meta.u64()?;
    let bytes = if kind == Kind::Text {
        meta.u64()?
    } else {
        count.checked_mul(kind.size())?
    };
    Some(Layout::Plain { kind, count, bytes })
}

fn acquired(meta: &mut Meta, digital: bool) -> Option<Layout> {
    let _kind = meta.u32()?;
    let _dimension = meta.u32()?;
    let count = meta.u64()?;
    let mut scalers = Vec::new();
    for _ in 0..meta.u32()? {
        let code = meta.u32()?;
        let buffer = usize::try_from(meta.u32()?).ok()?;
        let offset = u64::from(meta.u32()?);
        let _bitmap = if digital {
            u32::from(meta.take(1)?[0])
        } else {
            meta.u32()?
        };
        let _scale = meta.u32()?;
        let kind = match code {
            0 => Kind::U8,
            1 => Kind::I8,
            2 => Kind::U16,
            3 => Kind::I16,
            4 => Kind::U32,
            5 => Kind::I32,
            _ => return None,
        };
        let (offset, bit) = if digital {
            (offset / 8, Some(offset % 8))
        } else {
            (offset, None)
        };
        scalers.push(Scaler {
            kind,
            buffer,
            offset,
            bit,
        });
    }
    let mut widths = Vec::new();
    for _ in 0..meta.u32()? {
        widths.push(u64::from(meta.u32()?));
    }
    Some(Layout::Acquired {
        count,
        scalers,
        widths,
    })
}

/// Raw data of a segment, a block at a time.
struct Input<'a> {
    file: &'a mut File,
    left: u64,
    buffer: Vec<u8>,
}

enum Failed {
    Io(std::io::Error),
    Wrong(&'static str),
}

impl From<std::io::Error> for Failed {
    fn from(e: std::io::Error) -> Self {
        Failed::Io(e)
    }
}

impl Input<'_> {
    /// So many whole rows of `width` bytes, in blocks; how many rows there were.
    fn rows(
        &mut self,
        width: u64,
        rows: u64,
        mut each: impl FnMut(&[u8]),
    ) -> Result<u64, std::io::Error> {
        if width == 0 {
            return Ok(rows);
        }
        let rows = rows.min(self.left / width);
        let at_once = (BLOCK as u64 / width).max(1);
        let mut done = 0;
        while done < rows {
            let here = at_once.min(rows - done);
            let bytes = usize::try_from(here * width).unwrap_or(0);
            self.buffer.resize(bytes, 0);
            self.file.read_exact(&mut self.buffer)?;
            self.left -= bytes as u64;
            each(&self.buffer);
            done += here;
        }
        Ok(rows)
    }

    fn skip(&mut self, bytes: u64) -> Result<(), std::io::Error> {
        let bytes = bytes.min(self.left);
        self.file
            .seek(SeekFrom::Current(i64::try_from(bytes).unwrap_or(0)))?;
        self.left -= bytes;
        Ok(())
    }
}

fn push(values: &mut Vec<f64>, kind: Kind, bytes: &[u8], big: bool) {
    let size = usize::try_from(kind.size()).unwrap_or(1).max(1);
    values.extend(bytes.chunks_exact(size).map(|b| kind.value(b, big)));
}

/// Each channel's values in one piece, channel after channel, again and again. Whether all of it was there.
fn one_after_the_other(
    objects: &mut [Object],
    order: &[usize],
    input: &mut Input,
    big: bool,
) -> Result<bool, Failed> {
    let whole: u64 = order.iter().fold(0, |sum, i| match &objects[*i].layout {
        Some(Layout::Plain { bytes, .. }) => sum.saturating_add(*bytes),
        _ => sum,
    });
    if whole == 0 {
        return Ok(input.left == 0);
    }
    while input.left > 0 {
        let last = input.left < whole;
        for i in order {
            let object = &mut objects[*i];
            let Some(Layout::Plain { kind, count, bytes }) = object.layout else {
                continue;
            };
            if kind.is_number() {
                let values = &mut object.values;
                input.rows(kind.size(), count, |b| push(values, kind, b, big))?;
                if last {
                    // the odd bytes of a value that is not whole
                    let odd = input.left.min(kind.size() - 1);
                    if input.left < kind.size() {
                        input.skip(odd)?;
                    }
                }
            } else {
                object.odd |= if kind == Kind::Text {
                    count > 0
                } else {
                    bytes > 0
                };
                input.skip(bytes)?;
            }
        }
        if last {
            return Ok(false);
        }
    }
    Ok(true)
}

/// A value of each channel in turn.
fn interleaved_rows(
    objects: &mut [Object],
    order: &[usize],
    input: &mut Input,
    big: bool,
) -> Result<bool, Failed> {
    let mut places = Vec::new();
    let mut width = 0;
    for i in order {
        let Some(Layout::Plain { kind, .. }) = objects[*i].layout else {
            continue;
        };
        if kind == Kind::Text {
            return Err(Failed::Wrong("texts cannot be interleaved"));
        }
        places.push((*i, kind, width));
        width += kind.size();
    }
    if width == 0 {
        return Ok(input.left == 0);
    }
    let rows = input.left / width;
    let stride = usize::try_from(width).unwrap_or(usize::MAX);
    input.rows(width, rows, |block| {
        for (i, kind, at) in &places {
            let object = &mut objects[*i];
            object.odd |= !kind.is_number();
            if kind.is_number() {
                let at = usize::try_from(*at).unwrap_or(0);
                let rows = block.chunks_exact(stride);
                object
                    .values
                    .extend(rows.map(|r| kind.value(&r[at..], big)));
            }
        }
    })?;
    Ok(input.left == 0)
}

/// Rows of an acquisition: buffers of rows, in each of which a channel has its place.
fn acquired_rows(
    objects: &mut [Object],
    order: &[usize],
    input: &mut Input,
    big: bool,
) -> Result<bool, Failed> {
    let Some((widths, count)) = order.iter().find_map(|i| match &objects[*i].layout {
        Some(Layout::Acquired { widths, count, .. }) => Some((widths.clone(), *count)),
        _ => None,
    }) else {
        return Ok(true);
    };
    /// Object, kind, place in the row, bit.
    type Place = (usize, Kind, usize, Option<u64>);
    let mut places: Vec<Vec<Place>> = vec![Vec::new(); widths.len()];
    for i in order {
        let Some(Layout::Acquired { scalers, .. }) = &objects[*i].layout else {
            continue;
        };
        // the first scaler gives the values that the scales work on
        let Some(s) = scalers.first() else { continue };
        let width = *widths
            .get(s.buffer)
            .ok_or(Failed::Wrong("a channel is in a buffer that is not there"))?;
        if s.offset + s.kind.size() > width {
            return Err(Failed::Wrong("a channel lies outside of its row"));
        }
        let at = usize::try_from(s.offset).unwrap_or(0);
        let (kind, buffer, bit) = (s.kind, s.buffer, s.bit);
        places[buffer].push((*i, kind, at, bit));
    }
    let whole: u64 = widths
        .iter()
        .fold(0u64, |sum, w| sum.saturating_add(w.saturating_mul(count)));
    if whole == 0 {
        return Ok(input.left == 0);
    }
    while input.left > 0 {
        let last = input.left < whole;
        for (places, width) in places.iter().zip(&widths) {
            let stride = usize::try_from(*width).unwrap_or(usize::MAX);
            input.rows(*width, count, |block| {
                for (i, kind, at, bit) in places {
                    let rows = block.chunks_exact(stride);
                    objects[*i].values.extend(rows.map(|r| {
                        let v = kind.value(&r[*at..], big);
                        match bit {
                            Some(bit) => ((v as u64 >> bit) & 1) as f64,
                            None => v,
                        }
                    }));
                }
            })?;
        }
        if last {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Applies the scales that the driver left to the reader.
fn scale(object: &mut Object, name: &str, path: &Path, notes: &mut Vec<Note>) {
    if object.text("NI_Scaling_Status") == Some("scaled") {
        return;
    }
    let scales = object.number("NI_Number_Of_Scales");
    let Some(count) = scales.filter(|n| *n >= 1.0 && *n <= 64.0) else {
        return;
    };
    // from the last scale back to the raw values
    let mut chain: Vec<Step> = Vec::new();
    let mut id = count as u32 - 1;
    loop {
        let key = |what: &str| format!("NI_Scale[{id}]_{what}");
        let Some(kind) = object.text(&key("Scale_Type")) else {
            // the raw values, or the scaler of an acquisition
            break;
        };
        let real = |what: &str| object.number(&key(what));
        let source = real(&format!("{}_Input_Source", kind.replace(' ', "_")));
        let step = match kind {
            "Linear" => Step::Polynomial(vec![
                real("Linear_Y_Intercept").unwrap_or(0.0),
                real("Linear_Slope").unwrap_or(1.0),
            ]),
            "Polynomial" => {
                let size = real("Polynomial_Coefficients_Size")
                    .unwrap_or(4.0)
                    .clamp(0.0, 64.0);
                Step::Polynomial(
                    (0..size as usize)
                        .map(|i| real(&format!("Polynomial_Coefficients[{i}]")).unwrap_or(0.0))
                        .collect(),
                )
            }
            "Table" => {
                let size = |w: &str| real(w).unwrap_or(0.0).clamp(0.0, 4096.0) as usize;
                let column = |w: &str, n: usize| -> Vec<f64> {
                    (0..n)
                        .map(|i| real(&format!("{w}[{i}]")).unwrap_or(f64::NAN))
                        .collect()
                };
                Step::table(
                    column(
                        "Table_Pre_Scaled_Values",
                        size("Table_Pre_Scaled_Values_Size"),
                    ),
                    column("Table_Scaled_Values", size("Table_Scaled_Values_Size")),
                )
            }
            other => {
                notes.push(Note::warning(
                    path,
                    format!(
                        "channel {}: its scale {} is not known here; the values are as the converter gave them",
                        quote(name),
                        quote(other)
                    ),
                ));
                return;
            }
        };
        chain.push(step);
        match source {
            Some(next) if next >= 0.0 && next < f64::from(id) => id = next as u32,
            _ => break,
        }
    }
    if chain.is_empty() {
        return;
    }
    for v in &mut object.values {
        for step in chain.iter().rev() {
            *v = step.apply(*v);
        }
    }
    notes.push(Note::info(
        path,
        format!(
            "channel {}: {} scale(s) of the file applied",
            quote(name),
            chain.len()
        ),
    ));
}

enum Step {
    Polynomial(Vec<f64>),
    /// Rising.
    Table(Vec<(f64, f64)>),
}

impl Step {
    fn table(from: Vec<f64>, to: Vec<f64>) -> Self {
        let mut points: Vec<(f64, f64)> = from.into_iter().zip(to).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Step::Table(points)
    }

    fn apply(&self, x: f64) -> f64 {
        match self {
            Step::Polynomial(c) => c.iter().rev().fold(0.0, |y, c| y * x + c),
            Step::Table(points) => {
                // linear between the points, the end values beyond them
                let above = points.partition_point(|p| p.0 <= x);
                match (
                    above.checked_sub(1).and_then(|i| points.get(i)),
                    points.get(above),
                ) {
                    (Some((x0, y0)), Some((x1, y1))) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
                    (Some((_, y)), None) | (None, Some((_, y))) => *y,
                    (None, None) => f64::NAN,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_a_path() {
        assert_eq!(names("/'a'/'b'"), Some(("a".into(), "b".into())));
        assert_eq!(names("/'it''s'/'/x'"), Some(("it's".into(), "/x".into())));
        assert_eq!(names("/"), None);
        assert_eq!(names("/'a'"), None);
    }

    #[test]
    fn seconds_since_1904() {
        assert_eq!(stamp(2_082_844_800, 1 << 63), 0.5);
    }

    #[test]
    fn dates() {
        assert_eq!(utc(0.0), "1970-01-01 00:00:00 UTC");
        assert_eq!(utc(951_782_399.5), "2000-02-28 23:59:59 UTC");
        assert_eq!(utc(951_782_400.0), "2000-02-29 00:00:00 UTC");
        assert_eq!(utc(1_347_044_303.9), "2012-09-07 18:58:23 UTC");
        assert_eq!(utc(4_107_542_400.0), "2100-03-01 00:00:00 UTC");
        assert_eq!(utc(stamp(0, 0)), "1904-01-01 00:00:00 UTC");
        assert_eq!(utc(1e300), "1e300 s since 1970");
    }

    #[test]
    fn a_table_is_linear_between_its_points() {
        let t = Step::table(vec![3.0, 1.0, 0.0], vec![20.0, 10.0, 0.0]);
        let found: Vec<f64> = [-1.0, 0.5, 2.0, 3.0, 9.0]
            .iter()
            .map(|x| t.apply(*x))
            .collect();
        assert_eq!(found, [0.0, 5.0, 15.0, 20.0, 20.0]);
    }
}
