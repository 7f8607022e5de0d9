//! C3D files: what motion-capture software has written since the 1980s, in the number formats of three makes
//! of computer.
//!
//! ```text
//! file      := header (512 bytes), parameters, data      all in blocks of 512 bytes
//! header    := parameter block (u8), 0x50, points, analog values a frame, first frame, last frame (u16), gap, scale (f32),
//!              data block, analog samples a frame, rate (f32)
//! parameters:= 2 bytes, number of blocks, processor (84 Intel, 85 DEC, 86 SGI), records
//! record    := length of name (i8), id (i8, < 0: group), name, offset to the next (u16), type, dimensions, values
//! data      := per frame: x, y, z, w of every point, then samples a frame x channels, channel fastest
//! ```
//!
//! scale < 0: numbers are f32 and in units; scale > 0: numbers are i16 and times scale. w is a word of 16
//! bits with a sign in both; where it is written as f32 some writers left the sign out, and -1 is 65535
//! (Vicon Workstation). w < 0 says that the point was not seen; else its low byte is the residual over
//! |scale|, its high byte the cameras that saw it. Analog values are (raw - OFFSET) SCALE GEN_SCALE.
//!
//! Files contradict themselves. The header decides, unless another count of points, channels and frames fits
//! the size of the file and the header's does not; parameters that cannot be read are done without. Every
//! such choice is a note.
//!
//! Points are section `Trajectories`, what POINT:ANGLES, FORCES, MOMENTS, POWERS and SCALARS list is section
//! `Model Outputs`, channels are section `Devices`: the names that the same trial has as a Nexus CSV.

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::capture::{Capture, Column, Group, Importer, Note, ReadOptions, Section, Sink};
use super::error::{Error, ErrorKind, quote};
use super::text::decode;
use crate::units::Unit;

const BLOCK: u64 = 512;

/// The importer of C3D files.
pub struct C3d;

impl Importer for C3d {
    fn name(&self) -> &'static str {
        "c3d"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        // text may begin so, but has no zero byte
        head.len() >= 512 && head[0] > 0 && head[1] == 0x50 && head[..512].contains(&0)
    }

    fn stream(
        &self,
        path: &Path,
        _options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        let mut file = Reader::open(path)?;
        let mut head = [0; BLOCK as usize];
        file.exactly(0, &mut head)?;
        if head[1] != 0x50 || head[0] == 0 {
            return Err(Error::new(
                ErrorKind::Grammar,
                path,
                "the file does not begin as a C3D file",
            )
            .expected("0x50 in the second byte, the block of the parameters in the first")
            .action("use the file as the capture software wrote it"));
        }
        let mut notes = Vec::new();
        let (processor, parameters) = Parameters::find(&mut file, &head, &mut notes)?;
        let header = Header::new(processor, &head);
        let shape = Shape::find(&header, &parameters, &mut file, &mut notes)?;
        let mut sections = shape.sections(&header, &parameters, path, &mut notes);
        data(&mut file, &shape, &parameters, &mut sections, sink)?;
        parameters.tell(path, &mut notes);
        Ok(Capture {
            format: self.name(),
            sections: sections.into_iter().map(|s| s.section).collect(),
            notes,
        })
    }
}

/// How a make of computer wrote its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Processor {
    Intel,
    Dec,
    Sgi,
}

impl Processor {
    fn of(byte: u8) -> Option<Self> {
        match byte {
            84 => Some(Processor::Intel),
            85 => Some(Processor::Dec),
            86 => Some(Processor::Sgi),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Processor::Intel => "Intel",
            Processor::Dec => "DEC",
            Processor::Sgi => "SGI",
        }
    }

    #[inline(always)]
    fn u16(self, b: [u8; 2]) -> u16 {
        match self {
            Processor::Sgi => u16::from_be_bytes(b),
            _ => u16::from_le_bytes(b),
        }
    }

    #[inline(always)]
    fn i16(self, b: [u8; 2]) -> i16 {
        self.u16(b).cast_signed()
    }

    #[inline(always)]
    fn f32(self, b: [u8; 4]) -> f32 {
        match self {
            Processor::Intel => f32::from_le_bytes(b),
            Processor::Sgi => f32::from_be_bytes(b),
            // VAX F: the halves are swapped and the exponent is two higher
            Processor::Dec => f32::from_le_bytes([b[2], b[3], b[0], b[1]]) / 4.0,
        }
    }
}

/// A file of known length.
struct Reader<'a> {
    path: &'a Path,
    file: File,
    length: u64,
}

impl<'a> Reader<'a> {
    fn open(path: &'a Path) -> Result<Self, Error> {
        let io = |e| Error::io(path, e);
        let file = super::opened::open(path).map_err(io)?;
        let meta = file.metadata().map_err(io)?;
        Ok(Reader {
            path,
            file,
            length: meta.len(),
        })
    }

    fn seek(&mut self, at: u64) -> Result<(), Error> {
        self.file
            .seek(SeekFrom::Start(at))
            .map(drop)
            .map_err(|e| Error::io(self.path, e))
    }

    fn exactly(&mut self, at: u64, into: &mut [u8]) -> Result<(), Error> {
        self.seek(at)?;
        self.next(into)
    }

    fn next(&mut self, into: &mut [u8]) -> Result<(), Error> {
        self.file.read_exact(into).map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                Error::new(ErrorKind::NoData, self.path, "the file ends too early")
                    .action("copy the file again from where it was recorded")
            }
            _ => Error::io(self.path, e),
        })
    }

    /// Whole frames of zeros with which the last block is filled up.
    fn zero_frames(&mut self, data: u64, one: u64, whole: u64) -> Result<u64, Error> {
        let many = ((BLOCK - 1) / one).min(whole);
        let tail = self.some(data + (whole - many) * one, many * one)?;
        let zeros = tail.iter().rev().take_while(|b| **b == 0).count() as u64;
        Ok(zeros / one)
    }

    /// Up to `most` bytes from `at` on, never more than the file has.
    fn some(&mut self, at: u64, most: u64) -> Result<Vec<u8>, Error> {
        let length = self.length.saturating_sub(at).min(most);
        let mut bytes = vec![0; usize::try_from(length).unwrap_or(0)];
        self.exactly(at.min(self.length), &mut bytes)?;
        Ok(bytes)
    }
}

/// The first block.
struct Header {
    points: u64,
    analog_per_frame: u64,
    first: i64,
    last: i64,
    scale: f64,
    data_block: u64,
    samples_per_frame: u64,
    rate_hz: f64,
}

impl Header {
    fn new(p: Processor, head: &[u8; BLOCK as usize]) -> Self {
        let word = |n: usize| p.u16([head[2 * n - 2], head[2 * n - 1]]);
        let float = |n: usize| {
            let i = 2 * n - 2;
            f64::from(p.f32([head[i], head[i + 1], head[i + 2], head[i + 3]]))
        };
        Header {
            points: word(2).into(),
            analog_per_frame: word(3).into(),
            first: word(4).into(),
            last: word(5).into(),
            scale: float(7),
            data_block: word(9).into(),
            samples_per_frame: word(10).into(),
            rate_hz: float(11),
        }
    }

    fn is_plausible(&self) -> bool {
        let rate = self.rate_hz.is_finite() && (0.0..1e6).contains(&self.rate_hz);
        let scale = self.scale.is_finite() && self.scale != 0.0 && self.scale.abs() < 1e6;
        rate && scale && self.last >= self.first && self.points + self.analog_per_frame > 0
    }
}

/// One value of the parameter section.
#[derive(Debug, Clone)]
struct Parameter<B = Vec<u8>> {
    kind: i8,
    dimensions: Vec<usize>,
    bytes: B,
}

/// The parameter section: group and name, in capitals, to a value.
struct Parameters {
    processor: Processor,
    values: HashMap<(String, String), Parameter>,
    groups: Vec<String>,
}

impl Parameters {
    /// Reads the section that the first byte of the file points to, as far as it can be read.
    fn find(
        file: &mut Reader,
        head: &[u8; BLOCK as usize],
        notes: &mut Vec<Note>,
    ) -> Result<(Processor, Self), Error> {
        let start = (u64::from(head[0]) - 1) * BLOCK;
        let mut top = [0; 4];
        if start + 4 <= file.length {
            file.exactly(start, &mut top)?;
        }
        // without a known processor, the one in which the header makes sense
        let processor = Processor::of(top[3]).or_else(|| {
            [Processor::Intel, Processor::Sgi, Processor::Dec]
                .into_iter()
                .find(|p| Header::new(*p, head).is_plausible())
        });
        let Some(processor) = processor else {
            return Err(Error::new(
                ErrorKind::Grammar,
                file.path,
                format!("the processor type is {}", top[3]),
            )
            .expected(
                "84 (Intel), 85 (DEC) or 86 (SGI), or a header that makes sense in one of them",
            )
            .action(
                "the file has no points and no channels, or is damaged; export the trial again",
            ));
        };
        if Processor::of(top[3]).is_none() {
            notes.push(Note::warning(
                file.path,
                format!(
                    "the processor type {} is not known; read as {}, in which the header makes sense",
                    top[3],
                    processor.name()
                ),
            ));
        }
        let header = Header::new(processor, head);
        // the section ends where the data begin; some writers state too few blocks
        let data = header.data_block.saturating_sub(1) * BLOCK;
        let end = if data > start {
            data
        } else {
            start + u64::from(top[2]).max(1) * BLOCK
        };
        let bytes = file.some(start + 4, end.saturating_sub(start + 4))?;
        let mut found = Parameters {
            processor,
            values: HashMap::new(),
            groups: Vec::new(),
        };
        found.parse(&bytes, file.path, notes);
        Ok((processor, found))
    }

    fn parse(&mut self, bytes: &[u8], path: &Path, notes: &mut Vec<Note>) {
        let mut records = Records {
            bytes,
            processor: self.processor,
            names: HashMap::new(),
            found: Vec::new(),
            budget: bytes.len(),
            broken: false,
        };
        records.read(path, notes);
        let Records { names, found, .. } = records;
        if records.broken {
            notes.push(Note::warning(
                path,
                format!(
                    "the parameters are damaged; {} of them could be read",
                    found.len()
                ),
            ));
        } else if found.is_empty() {
            notes.push(Note::warning(
                path,
                "there are no parameters: no labels, no units; the header alone is used",
            ));
        }
        let mut twice = Vec::new();
        for (id, name, parameter) in found {
            let group = names.get(&id).cloned().unwrap_or_else(|| format!("#{id}"));
            let full = format!("{group}:{name}");
            if self.values.insert((group, name), parameter).is_some() {
                twice.push(full);
            }
        }
        if !twice.is_empty() {
            twice.truncate(8);
            notes.push(Note::warning(
                path,
                format!(
                    "parameters that are there twice, the later counts: {}",
                    twice.join(", ")
                ),
            ));
        }
        self.groups = names.into_values().collect();
        self.groups.sort();
    }

    fn get(&self, group: &str, name: &str) -> Option<&Parameter> {
        self.values.get(&(group.to_owned(), name.to_owned()))
    }

    /// Numbers of any type; empty if there is no such parameter.
    fn numbers(&self, group: &str, name: &str) -> Vec<f64> {
        let Some(p) = self.get(group, name) else {
            return Vec::new();
        };
        match p.kind {
            1 => p.bytes.iter().map(|b| f64::from(*b)).collect(),
            2 => p
                .bytes
                .chunks_exact(2)
                .map(|b| f64::from(self.processor.i16([b[0], b[1]])))
                .collect(),
            4 => p
                .bytes
                .chunks_exact(4)
                .map(|b| f64::from(self.processor.f32([b[0], b[1], b[2], b[3]])))
                .collect(),
            _ => Vec::new(),
        }
    }

    fn number(&self, group: &str, name: &str) -> Option<f64> {
        self.numbers(group, name)
            .first()
            .copied()
            .filter(|v| v.is_finite())
    }

    /// A count: a negative 16-bit number is a large one.
    fn count(&self, group: &str, name: &str) -> Option<u64> {
        let value = self.number(group, name)?;
        let value = if value < 0.0 { value + 65_536.0 } else { value };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        (0.0..=4e9).contains(&value).then_some(value as u64)
    }

    /// A frame number of two 16-bit words.
    fn long(&self, group: &str, name: &str) -> Option<i64> {
        let words = self.numbers(group, name);
        let word = |v: f64| {
            #[allow(clippy::cast_possible_truncation)]
            let v = v as i64;
            if v < 0 { v + 65_536 } else { v }
        };
        match words.as_slice() {
            [low, high, ..] => Some(word(*low) + 65_536 * word(*high)),
            [one] => Some(word(*one)),
            [] => None,
        }
    }

    /// Strings: the first dimension is their length. Padding is taken off.
    fn strings(&self, group: &str, name: &str) -> Vec<String> {
        let Some(p) = self.get(group, name).filter(|p| p.kind == -1) else {
            return Vec::new();
        };
        let length = p.dimensions.first().copied().unwrap_or(1);
        if length == 0 {
            return Vec::new();
        }
        p.bytes
            .chunks_exact(length)
            .map(|b| {
                decode(b)
                    .trim_matches(|c: char| c == '\0' || c.is_whitespace())
                    .to_owned()
            })
            .collect()
    }

    /// `NAME`, `NAME2`, `NAME3`, ...: a parameter holds at most 255.
    fn all<T>(&self, group: &str, name: &str, get: impl Fn(&Self, &str, &str) -> Vec<T>) -> Vec<T> {
        let mut list = get(self, group, name);
        for n in 2.. {
            let next = format!("{name}{n}");
            if self.get(group, &next).is_none() {
                break;
            }
            list.extend(get(self, group, &next));
        }
        list
    }

    /// What is listed as angles, forces and the like is no position; with its unit.
    fn no_positions(&self) -> HashMap<String, String> {
        let mut other = HashMap::new();
        for (list, unit) in [
            ("ANGLES", "ANGLE_UNITS"),
            ("FORCES", "FORCE_UNITS"),
            ("MOMENTS", "MOMENT_UNITS"),
            ("POWERS", "POWER_UNITS"),
            ("SCALARS", "SCALAR_UNITS"),
        ] {
            let unit = self.strings("POINT", unit).into_iter().next();
            for name in self.all("POINT", list, Self::strings) {
                if !name.is_empty() {
                    other.insert(name, unit.clone().unwrap_or_default());
                }
            }
        }
        other
    }

    /// What is beside points and channels.
    fn tell(&self, path: &Path, notes: &mut Vec<Note>) {
        let times = self.numbers("EVENT", "TIMES");
        let labels = self.strings("EVENT", "LABELS");
        let contexts = self.strings("EVENT", "CONTEXTS");
        let events: Vec<String> = times
            .chunks_exact(2)
            .enumerate()
            .filter(|(i, _)| *i < labels.len())
            .map(|(i, t)| {
                // minutes and seconds
                let context = contexts.get(i).map_or("", String::as_str);
                let text = format!("{context} {} {:.3} s", labels[i], t[0] * 60.0 + t[1]);
                quote(text.trim()).trim_matches('"').to_owned()
            })
            .collect();
        if !events.is_empty() {
            let more = events.len().saturating_sub(8);
            let mut text = format!(
                "{} events left out: {}",
                events.len(),
                events[..events.len() - more].join(", ")
            );
            if more > 0 {
                text += &format!(", and {more} more");
            }
            notes.push(Note::info(path, text));
        }
        let subjects: Vec<String> = self
            .strings("SUBJECTS", "NAMES")
            .into_iter()
            .filter(|n| !n.is_empty())
            .take(8)
            .collect();
        if !subjects.is_empty() {
            notes.push(Note::info(
                path,
                format!("subjects: {}", quote(&subjects.join(", "))),
            ));
        }
        if self.groups.iter().any(|g| g == "ROTATION") {
            notes.push(Note::warning(
                path,
                "rotations of segments (group ROTATION) are left out",
            ));
        }
    }
}

fn two(bytes: &[u8], at: usize) -> Option<[u8; 2]> {
    bytes.get(at..at + 2)?.try_into().ok()
}

/// The records of the parameter section as far as they are read. A group may stand after its parameters: ids
/// become names at the end.
struct Records<'a> {
    bytes: &'a [u8],
    processor: Processor,
    /// Names of groups by their id.
    names: HashMap<u8, String>,
    /// The id of the group, name and value.
    found: Vec<(u8, String, Parameter)>,
    /// Values do not overlap: more bytes than the section has is damage, however often a record says so.
    budget: usize,
    broken: bool,
}

impl Records<'_> {
    /// Goes from record to record up to the last, or to damage.
    fn read(&mut self, path: &Path, notes: &mut Vec<Note>) {
        let mut at = 0;
        while let Some([length, id]) = two(self.bytes, at) {
            let length = usize::from(length.cast_signed().unsigned_abs());
            if length == 0 || id == 0 {
                break;
            }
            let id = id.cast_signed();
            let link = at + 2 + length;
            let Some((name, offset)) = self.name_and_offset(at + 2, link) else {
                self.broken = true;
                break;
            };
            if id < 0 {
                self.group(id.unsigned_abs(), name, path, notes);
            } else {
                self.parameter(id.unsigned_abs(), name, link + 2);
            }
            if offset == 0 {
                break;
            }
            let next = link + offset;
            if next <= at || next > self.bytes.len() {
                self.broken |= next != self.bytes.len();
                break;
            }
            at = next;
        }
    }

    /// The name that goes up to `link`, in capitals, and how far it is from there to the next record.
    fn name_and_offset(&self, from: usize, link: usize) -> Option<(String, usize)> {
        let name = self.bytes.get(from..link)?;
        let offset = usize::from(self.processor.u16(two(self.bytes, link)?));
        let is_name = name.iter().all(|b| *b >= b' ' && *b != 0x7f);
        is_name.then(|| (decode(name).trim().to_uppercase(), offset))
    }

    /// A name of a group; the same name twice is a note.
    fn group(&mut self, id: u8, name: String, path: &Path, notes: &mut Vec<Note>) {
        if self.names.values().any(|n| *n == name) {
            notes.push(Note::warning(
                path,
                format!("parameter group {name} is there twice; the later values count"),
            ));
        }
        self.names.insert(id, name);
    }

    /// A value, if it is whole and the section has room for it.
    fn parameter(&mut self, id: u8, name: String, at: usize) {
        let Some(v) = value(self.bytes, at).filter(|v| v.bytes.len() <= self.budget) else {
            self.broken = true;
            return;
        };
        self.budget -= v.bytes.len();
        let parameter = Parameter {
            kind: v.kind,
            dimensions: v.dimensions,
            bytes: v.bytes.to_vec(),
        };
        self.found.push((id, name, parameter));
    }
}

/// Type, dimensions and values at `at`; what the section does not hold is damage.
fn value(bytes: &[u8], at: usize) -> Option<Parameter<&[u8]>> {
    let [kind, ndim] = two(bytes, at)?;
    let kind = kind.cast_signed();
    let size = match kind {
        -1 | 1 => 1usize,
        2 => 2,
        4 => 4,
        _ => return None,
    };
    let dimensions: Vec<usize> = bytes
        .get(at + 2..at + 2 + usize::from(ndim))?
        .iter()
        .map(|d| usize::from(*d))
        .collect();
    let length = dimensions.iter().try_fold(size, |n, d| n.checked_mul(*d))?;
    let from = at + 2 + usize::from(ndim);
    Some(Parameter {
        kind,
        dimensions,
        bytes: bytes.get(from..from.checked_add(length)?)?,
    })
}

/// How many of what there are, and where.
#[derive(Debug, Clone, PartialEq)]
struct Shape {
    points: usize,
    channels: usize,
    samples_per_frame: usize,
    first: i64,
    frames: u64,
    data: u64,
    /// Bytes of a number.
    width: usize,
    scale: f64,
    rate_hz: f64,
}

/// Where the data begin, how many bytes there are, and how many a number has.
struct Room {
    data: u64,
    available: u64,
    width: u64,
}

impl Room {
    fn frame_bytes(&self, points: u64, analog: u64) -> u64 {
        (4 * points + analog) * self.width
    }

    /// The data fill whole blocks; some writers leave out the padding.
    fn fits(&self, points: u64, analog: u64, frames: u64) -> bool {
        let all = self.frame_bytes(points, analog).saturating_mul(frames);
        all > 0 && all <= self.available && self.available - all < BLOCK
    }
}

/// The frames that header and parameters declare.
struct Declared {
    first: i64,
    in_header: u64,
    /// The last frame of the header is the largest that it can say.
    saturated: bool,
    /// POINT:FRAMES
    counted: Option<u64>,
    /// How many there are, as the header has it, then as the parameters do.
    frames: Vec<u64>,
}

impl Declared {
    /// As header and parameters say it.
    fn new(header: &Header, parameters: &Parameters) -> Self {
        let start = parameters.long("TRIAL", "ACTUAL_START_FIELD");
        let end = parameters.long("TRIAL", "ACTUAL_END_FIELD");
        let first = start
            .filter(|s| s & 0xffff == header.first)
            .unwrap_or(header.first);
        let in_header = u64::try_from(header.last - header.first + 1).unwrap_or(0);
        let saturated = header.last == 65_535;
        let trial = start
            .zip(end)
            .and_then(|(s, e)| u64::try_from(e - s + 1).ok());
        let long = parameters.count("POINT", "LONG_FRAMES");
        let counted = parameters.count("POINT", "FRAMES").filter(|n| *n != 65_535);
        let mut frames: Vec<u64> = [
            (!saturated).then_some(in_header),
            trial,
            long,
            counted,
            Some(in_header),
        ]
        .into_iter()
        .flatten()
        .filter(|n| *n > 0)
        .collect();
        frames.dedup();
        Declared {
            first,
            in_header,
            saturated,
            counted,
            frames,
        }
    }
}

/// Where header and parameters contradict each other, what is used.
struct Choice<'a> {
    header: &'a Header,
    parameters: &'a Parameters,
    path: &'a Path,
    notes: &'a mut Vec<Note>,
}

impl Choice<'_> {
    /// The error for what neither header nor parameters state.
    fn wrong(&self, found: impl Into<String>, expected: &str) -> Error {
        Error::new(ErrorKind::Grammar, self.path, found)
            .expected(expected)
            .action("export the trial again")
    }

    /// Notes a choice.
    fn warn(&mut self, text: String) {
        self.notes.push(Note::warning(self.path, text));
    }

    /// The header's scale, else that of the parameters.
    fn scale(&mut self) -> Result<f64, Error> {
        let other = self.parameters.number("POINT", "SCALE");
        let scale = Some(self.header.scale)
            .filter(|s| s.is_finite() && *s != 0.0)
            .or_else(|| other.filter(|s| *s != 0.0))
            .ok_or_else(|| {
                self.wrong(
                    format!("the scale is {}", self.header.scale),
                    "a scale other than 0",
                )
            })?;
        if scale > 0.0
            && let Some(other) = other
            && (other.abs() - scale).abs() > 1e-4 * scale
        {
            self.warn(format!(
                "the scale is {scale} in the header and {other} in POINT:SCALE; the header's is used"
            ));
        }
        Ok(scale)
    }

    /// The header's rate, else that of the parameters.
    fn rate_hz(&mut self) -> Result<f64, Error> {
        let rate_hz = self.header.rate_hz;
        let usable = |r: &f64| r.is_finite() && *r > 0.0 && *r < 1e9;
        let stated = self.parameters.number("POINT", "RATE").filter(usable);
        if !usable(&rate_hz) {
            let rate_hz = stated.ok_or_else(|| {
                self.wrong(format!("the rate is {rate_hz} Hz"), "a rate above 0 Hz")
            })?;
            self.warn(format!(
                "the header has no rate; {rate_hz} Hz from POINT:RATE is used"
            ));
            return Ok(rate_hz);
        }
        if let Some(stated) = stated
            && (stated - rate_hz).abs() > 1e-4 * rate_hz
        {
            self.warn(format!(
                "the rate is {rate_hz} Hz in the header and {stated} Hz in POINT:RATE; the header's is used"
            ));
        }
        Ok(rate_hz)
    }

    /// The block in which the data begin, counted from 1.
    fn data_block(&self) -> Result<u64, Error> {
        let stated = || self.parameters.count("POINT", "DATA_START");
        Some(self.header.data_block)
            .filter(|b| *b > 1)
            .or_else(|| stated().filter(|b| *b > 1))
            .ok_or_else(|| {
                self.wrong(
                    "the header does not say where the data begin",
                    "a block after the parameters",
                )
            })
    }

    /// The first counts of points, analog values a frame and frames with which the file has its size.
    fn that_fits(&self, room: &Room, declared: &Declared) -> Option<(u64, u64, u64)> {
        let per_frame = self.header.samples_per_frame.max(1);
        let used = |group: &str| self.parameters.count(group, "USED").filter(|n| *n < 65_536);
        let points = [Some(self.header.points), used("POINT")];
        let analog = [
            Some(self.header.analog_per_frame),
            used("ANALOG").map(|n| n * per_frame),
        ];
        for a in analog.into_iter().flatten() {
            for p in points.into_iter().flatten() {
                for f in &declared.frames {
                    if room.fits(p, a, *f) {
                        return Some((p, a, *f));
                    }
                }
            }
        }
        None
    }

    /// How many frames are there if a frame is as the header says.
    fn frames_of_header(
        &mut self,
        room: &Room,
        declared: &Declared,
        file: &mut Reader,
    ) -> Result<u64, Error> {
        let nothing = |found: String| Error::new(ErrorKind::NoData, self.path, found);
        let one = room.frame_bytes(self.header.points, self.header.analog_per_frame);
        if one == 0 {
            return Err(nothing("the file has no points and no channels".to_owned())
                .action("export the trial again with its markers"));
        }
        let whole = room.available / one;
        let count = declared.frames.first().copied().unwrap_or(0);
        if whole == 0 {
            return Err(
                nothing(format!("{count} frames are declared and none is there"))
                    .action("the file was cut; copy it again from where it was recorded"),
            );
        }
        // a count of 16 bits cannot say more
        let in_header = declared.in_header;
        if declared.saturated && whole > in_header {
            let whole = whole - file.zero_frames(room.data, one, whole)?;
            self.warn(format!(
                "{in_header} frames are declared, the most that the header can say; the file holds {whole}, which are read"
            ));
            return Ok(whole);
        }
        if whole < count {
            self.warn(format!(
                "the file was cut: {count} frames are declared and {whole} are there"
            ));
        }
        Ok(if count == 0 { whole } else { whole.min(count) })
    }

    /// Notes counts of the parameters that are not those that are read.
    fn tell_contradictions(&mut self, declared: &Declared, points: u64, frames: u64) {
        if let Some(used) = self.parameters.count("POINT", "USED")
            && used != points
        {
            self.warn(format!(
                "POINT:USED is {used}; {points} points fit the data"
            ));
        }
        if let Some(counted) = declared.counted
            && counted != frames & 0xffff
            && counted != frames
        {
            self.warn(format!(
                "POINT:FRAMES is {counted}, the header says {}; {frames} are read",
                declared.in_header
            ));
        }
    }

    /// Channels, and samples a frame of each.
    fn channels(&mut self, analog: u64) -> (u64, u64) {
        let per_frame = self.header.samples_per_frame.max(1);
        if analog == 0 {
            return (0, 1);
        }
        if analog.is_multiple_of(per_frame) {
            return (analog / per_frame, per_frame);
        }
        self.warn(format!(
            "{analog} analog values a frame are no multiple of {per_frame} samples a frame; taken as one sample of {analog} channels"
        ));
        (analog, 1)
    }
}

impl Shape {
    fn frame_bytes(&self) -> u64 {
        (4 * self.points + self.channels * self.samples_per_frame) as u64 * self.width as u64
    }

    /// The shape in which header, parameters and the size of the file agree best; every choice is a note.
    fn find(
        header: &Header,
        parameters: &Parameters,
        file: &mut Reader,
        notes: &mut Vec<Note>,
    ) -> Result<Shape, Error> {
        let mut choice = Choice {
            header,
            parameters,
            path: file.path,
            notes,
        };
        let scale = choice.scale()?;
        let rate_hz = choice.rate_hz()?;
        let data = (choice.data_block()? - 1) * BLOCK;
        let width: usize = if scale < 0.0 { 4 } else { 2 };
        let room = Room {
            data,
            available: file.length.saturating_sub(data),
            width: width as u64,
        };
        let declared = Declared::new(header, parameters);
        let of_header = (header.points, header.analog_per_frame);
        let (points, analog, frames) = match choice.that_fits(&room, &declared) {
            Some(fit) => {
                let (points, analog, _) = fit;
                if (points, analog) != of_header {
                    choice.warn(format!(
                        "the header's {} points and {} analog values a frame do not fit the size of the file; {points} and {analog} from the parameters do",
                        of_header.0, of_header.1
                    ));
                }
                fit
            }
            None => {
                let frames = choice.frames_of_header(&room, &declared, file)?;
                (of_header.0, of_header.1, frames)
            }
        };
        choice.tell_contradictions(&declared, points, frames);
        let (channels, samples_per_frame) = choice.channels(analog);
        let shape = Shape {
            points: usize::try_from(points).unwrap_or(0),
            channels: usize::try_from(channels).unwrap_or(0),
            samples_per_frame: usize::try_from(samples_per_frame).unwrap_or(1),
            first: declared.first,
            frames,
            data,
            width,
            scale,
            rate_hz,
        };
        let left = room.available - shape.frame_bytes() * frames;
        if left >= BLOCK {
            choice.warn(format!("{left} bytes after the last frame are left out"));
        }
        Ok(shape)
    }

    /// The empty sections, and what goes where.
    fn sections(
        &self,
        header: &Header,
        parameters: &Parameters,
        path: &Path,
        notes: &mut Vec<Note>,
    ) -> Vec<Part> {
        notes.insert(
            0,
            Note::info(
                path,
                format!(
                    "{}, {} numbers; {} points, {} channels, {} frames from {} at {} Hz, {} samples a frame",
                    parameters.processor.name(),
                    if self.width == 4 { "32-bit float" } else { "16-bit whole" },
                    self.points,
                    self.channels,
                    self.frames,
                    self.first,
                    self.rate_hz,
                    header.samples_per_frame
                ),
            ),
        );
        let mut parts = Vec::new();
        if self.points > 0 {
            parts.extend(self.points_parts(parameters, path, notes));
        }
        if self.channels > 0 {
            parts.push(self.channels_part(parameters, path, notes));
        }
        parts
    }

    /// The markers, and what the capture software computed from them.
    fn points_parts(
        &self,
        parameters: &Parameters,
        path: &Path,
        notes: &mut Vec<Note>,
    ) -> Vec<Part> {
        let labels = parameters.all("POINT", "LABELS", Parameters::strings);
        let labels = unique(labels, self.points, path, "points", notes);
        let other = parameters.no_positions();
        let units = parameters.all("POINT", "UNITS", Parameters::strings);
        let unit = match units.iter().find(|u| !u.is_empty()) {
            Some(unit) => point_unit(unit, path, notes),
            None => {
                notes.push(Note::warning(
                    path,
                    "the unit of the points is not stated (POINT:UNITS); state it, as in unit = \"mm\"",
                ));
                String::new()
            }
        };
        let (mut markers, mut outputs) = (Vec::new(), Vec::new());
        for (i, label) in labels.into_iter().enumerate() {
            match other.get(&label) {
                Some(unit) => outputs.push((i, label, unit.clone())),
                None => markers.push((i, label, unit.clone())),
            }
        }
        [
            ("Trajectories", markers, true),
            ("Model Outputs", outputs, false),
        ]
        .into_iter()
        .filter(|(_, list, _)| !list.is_empty())
        .map(|(name, list, zero_is_gap)| self.points_part(name, &list, zero_is_gap))
        .collect()
    }

    /// The analog channels.
    fn channels_part(&self, parameters: &Parameters, path: &Path, notes: &mut Vec<Note>) -> Part {
        let labels = parameters.all("ANALOG", "LABELS", Parameters::strings);
        let labels = unique(labels, self.channels, path, "channels", notes);
        let units = parameters.all("ANALOG", "UNITS", Parameters::strings);
        let mut section = Section {
            name: "Devices".to_owned(),
            rate_hz: Some(self.rate_hz * self.samples_per_frame as f64),
            subframes_per_frame: u32::try_from(self.samples_per_frame).ok(),
            ..Section::default()
        };
        for (i, label) in labels.into_iter().enumerate() {
            section.groups.push(Group {
                name: label.clone(),
                columns: i..i + 1,
            });
            section.columns.push(Column {
                group: label,
                axis: String::new(),
                unit: units.get(i).cloned().unwrap_or_default(),
                number: i + 1,
                values: Vec::new(),
            });
        }
        Part {
            section,
            what: What::Analog,
        }
    }

    fn points_part(&self, name: &str, list: &[(usize, String, String)], zero_is_gap: bool) -> Part {
        let mut section = Section {
            name: name.to_owned(),
            rate_hz: Some(self.rate_hz),
            ..Section::default()
        };
        for (i, label, unit) in list {
            let from = section.columns.len();
            section.groups.push(Group {
                name: label.clone(),
                columns: from..from + 3,
            });
            for (k, axis) in ["X", "Y", "Z"].into_iter().enumerate() {
                section.columns.push(Column {
                    group: label.clone(),
                    axis: axis.to_owned(),
                    unit: unit.clone(),
                    number: 4 * i + k + 1,
                    values: Vec::new(),
                });
            }
        }
        // beside the groups, because a point may be seen without a residual that can be read
        if zero_is_gap {
            for (i, label, unit) in list {
                section.columns.push(Column {
                    group: label.clone(),
                    axis: "residual".to_owned(),
                    unit: unit.clone(),
                    number: 4 * i + 4,
                    values: Vec::new(),
                });
            }
        }
        Part {
            section,
            what: What::Points {
                which: list.iter().map(|(i, _, _)| *i).collect(),
                markers: zero_is_gap,
            },
        }
    }
}

/// The unit of the points; `mete`, cut from `metres` by a field of four letters, is m.
fn point_unit(unit: &str, path: &Path, notes: &mut Vec<Note>) -> String {
    let lower = unit.to_ascii_lowercase();
    let cut = Unit::parse(unit).is_none()
        && lower.len() >= 3
        && [
            "metres",
            "meters",
            "millimetres",
            "millimeters",
            "centimetres",
            "centimeters",
        ]
        .iter()
        .any(|word| word.starts_with(&lower));
    if !cut {
        return unit.to_owned();
    }
    let symbol = match lower.as_bytes()[0] {
        b'c' => "cm",
        _ if lower.starts_with("mi") => "mm",
        _ => "m",
    };
    notes.push(Note::warning(
        path,
        format!(
            "the unit of the points is {}, taken as {symbol}",
            quote(unit)
        ),
    ));
    symbol.to_owned()
}

/// As many labels as there are columns, no two alike.
fn unique(
    mut labels: Vec<String>,
    wanted: usize,
    path: &Path,
    what: &str,
    notes: &mut Vec<Note>,
) -> Vec<String> {
    let given = labels.iter().take(wanted).filter(|l| !l.is_empty()).count();
    if given < wanted {
        notes.push(Note::warning(
            path,
            format!(
                "{} of {wanted} {what} have no label; called by their number, as *3",
                wanted - given
            ),
        ));
    }
    labels.resize(wanted, String::new());
    let mut seen: HashSet<String> = HashSet::with_capacity(wanted);
    let mut twice = Vec::new();
    for (i, label) in labels.iter_mut().enumerate() {
        if label.is_empty() {
            *label = format!("*{}", i + 1);
        }
        if seen.contains(label.as_str()) {
            twice.push(quote(label));
            while seen.contains(label.as_str()) {
                *label = format!("{label}#{}", i + 1);
            }
        }
        seen.insert(label.clone());
    }
    if !twice.is_empty() {
        let n = twice.len();
        twice.dedup();
        twice.truncate(8);
        notes.push(Note::warning(
            path,
            format!(
                "{n} {what} share a label with one before them ({}); # and their number are added",
                twice.join(", ")
            ),
        ));
    }
    labels
}

/// A section and where its columns come from.
struct Part {
    section: Section,
    what: What,
}

enum What {
    Points { which: Vec<usize>, markers: bool },
    Analog,
}

/// Offset, gain and sign of every channel.
struct Channels {
    offset: Vec<f64>,
    gain: Vec<f64>,
    unsigned: bool,
}

impl Channels {
    fn new(
        file: &mut Reader,
        p: Processor,
        shape: &Shape,
        parameters: &Parameters,
    ) -> Result<Self, Error> {
        let general = parameters.number("ANALOG", "GEN_SCALE").unwrap_or(1.0);
        let scale = parameters.all("ANALOG", "SCALE", Parameters::numbers);
        let mut offset = parameters.all("ANALOG", "OFFSET", Parameters::numbers);
        let mut gain: Vec<f64> = scale.iter().map(|s| s * general).collect();
        gain.resize(shape.channels, general);
        offset.resize(shape.channels, 0.0);
        let format = parameters.strings("ANALOG", "FORMAT");
        let mut unsigned = format.iter().any(|f| f.eq_ignore_ascii_case("UNSIGNED"));
        if !unsigned && shape.width == 4 && offset.iter().any(|o| *o < 0.0) {
            unsigned = larger_than_signed(file, p, shape)?;
        }
        if unsigned {
            for o in &mut offset {
                if *o < 0.0 {
                    *o += 65_536.0;
                }
            }
        }
        Ok(Channels {
            offset,
            gain,
            unsigned,
        })
    }
}

/// Whether any analog value of a file of floats is beyond 16 bits with a sign: then offsets are unsigned too.
fn larger_than_signed(file: &mut Reader, p: Processor, shape: &Shape) -> Result<bool, Error> {
    let from = 16 * shape.points;
    blocks(file, shape, |bytes, one| {
        for frame in bytes.chunks_exact(one) {
            for b in frame[from..].chunks_exact(4) {
                if p.f32([b[0], b[1], b[2], b[3]]) > 32_767.0 {
                    return Ok(true);
                }
            }
        }
        Ok(false)
    })
}

/// Goes through the data, some whole frames at a time, until told that it is enough.
fn blocks(
    file: &mut Reader,
    shape: &Shape,
    mut with: impl FnMut(&[u8], usize) -> Result<bool, Error>,
) -> Result<bool, Error> {
    const AT_ONCE: u64 = 256 * 1024;
    let one = shape.frame_bytes();
    let many = (AT_ONCE / one).clamp(1, shape.frames.max(1));
    let one = usize::try_from(one).unwrap_or(usize::MAX);
    let mut buffer = vec![0; one * usize::try_from(many).unwrap_or(1)];
    let mut left = shape.frames;
    file.seek(shape.data)?;
    while left > 0 {
        let take = left.min(many);
        let bytes = &mut buffer[..one * usize::try_from(take).unwrap_or(1)];
        file.next(bytes)?;
        if with(bytes, one)? {
            return Ok(true);
        }
        left -= take;
    }
    Ok(false)
}

fn data(
    file: &mut Reader,
    shape: &Shape,
    parameters: &Parameters,
    parts: &mut [Part],
    sink: &mut dyn Sink,
) -> Result<(), Error> {
    let p = parameters.processor;
    let channels = Channels::new(file, p, shape, parameters)?;
    let mut frame = shape.first;
    // one loop for each way of writing numbers, so that the choice is not made for each number
    blocks(file, shape, |bytes, one| {
        let frames = bytes.len() / one;
        for (i, part) in parts.iter_mut().enumerate() {
            match (shape.width, p) {
                (4, Processor::Intel) => part.take(shape, &channels, bytes, one, frame, float::<0>),
                (4, Processor::Dec) => part.take(shape, &channels, bytes, one, frame, float::<1>),
                (4, Processor::Sgi) => part.take(shape, &channels, bytes, one, frame, float::<2>),
                (_, Processor::Sgi) => part.take(shape, &channels, bytes, one, frame, whole::<2>),
                _ => part.take(shape, &channels, bytes, one, frame, whole::<0>),
            }
            sink.rows(i, &mut part.section);
        }
        frame += i64::try_from(frames).unwrap_or(0);
        Ok(false)
    })
    .map(drop)
}

#[inline(always)]
fn float<const P: u8>(b: &[u8]) -> f64 {
    let p = [Processor::Intel, Processor::Dec, Processor::Sgi][usize::from(P)];
    f64::from(p.f32([b[0], b[1], b[2], b[3]]))
}

/// The fourth word of a point with its sign: what 16 bits hold without one, 32768 to 65535, is negative.
#[inline(always)]
fn signed_word(word: f64) -> f64 {
    if (32_768.0..65_536.0).contains(&word) {
        word - 65_536.0
    } else {
        word
    }
}

#[inline(always)]
fn whole<const P: u8>(b: &[u8]) -> f64 {
    let p = [Processor::Intel, Processor::Dec, Processor::Sgi][usize::from(P)];
    f64::from(p.i16([b[0], b[1]]))
}

impl Part {
    #[inline(always)]
    fn take(
        &mut self,
        shape: &Shape,
        channels: &Channels,
        bytes: &[u8],
        one: usize,
        first: i64,
        number: impl Fn(&[u8]) -> f64 + Copy,
    ) {
        let w = shape.width;
        let section = &mut self.section;
        let frames = i64::try_from(bytes.len() / one).unwrap_or(0);
        match &self.what {
            What::Points { which, markers } => {
                section.frames.extend(first..first + frames);
                // floats are in units, whole numbers times scale
                let scale = if w == 4 { 1.0 } else { shape.scale };
                let (xyz, residuals) = section.columns.split_at_mut(3 * which.len());
                for (n, point) in which.iter().enumerate() {
                    let at = 4 * point * w;
                    let [x, y, z] = &mut xyz[3 * n..3 * n + 3] else {
                        continue;
                    };
                    let mut residual = residuals.get_mut(n);
                    for frame in bytes.chunks_exact(one) {
                        let b = &frame[at..at + 4 * w];
                        let v = [
                            number(b) * scale,
                            number(&b[w..]) * scale,
                            number(&b[2 * w..]) * scale,
                        ];
                        let mark = signed_word(number(&b[3 * w..]));
                        let seen = (mark >= 0.0 || mark.is_nan())
                            && v.iter().all(|c| c.is_finite())
                            && !(*markers && mark == 0.0 && v == [0.0; 3]);
                        let v = if seen { v } else { [f64::NAN; 3] };
                        x.values.push(v[0]);
                        y.values.push(v[1]);
                        z.values.push(v[2]);
                        if let Some(r) = &mut residual {
                            // the low byte; what is no 16-bit number holds none
                            let readable = seen && mark <= 32_767.0;
                            r.values.push(if readable {
                                #[allow(clippy::cast_possible_truncation)]
                                let low = (mark as i32) & 0xff;
                                f64::from(low) * shape.scale.abs()
                            } else {
                                f64::NAN
                            });
                        }
                    }
                }
            }
            What::Analog => {
                let per_frame = shape.samples_per_frame;
                let from = 4 * shape.points * w;
                for f in first..first + frames {
                    section.frames.extend(std::iter::repeat_n(f, per_frame));
                    section
                        .sub_frames
                        .extend(0..u32::try_from(per_frame).unwrap_or(1));
                }
                let unsigned = channels.unsigned && w == 2;
                for (c, column) in section.columns.iter_mut().enumerate() {
                    let (offset, gain) = (channels.offset[c], channels.gain[c]);
                    for frame in bytes.chunks_exact(one) {
                        for s in 0..per_frame {
                            let mut raw = number(&frame[from + (s * shape.channels + c) * w..]);
                            if unsigned && raw < 0.0 {
                                raw += 65_536.0;
                            }
                            let value = (raw - offset) * gain;
                            column
                                .values
                                .push(if value.is_finite() { value } else { f64::NAN });
                        }
                    }
                }
            }
        }
    }
}
