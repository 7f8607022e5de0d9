//! MATLAB files: here those of level 5, which `save` writes with `-v6` (plain) and `-v7` (compressed); those
//! of level 7.3 are taken apart in [`super::mat73`] and put together here.
//!
//! ```text
//! file    := header of 128 bytes, element*
//! element := type u32, bytes u32, data, padding to 8 bytes   (up to 4 bytes of data: bytes u16, type u16, data)
//! ```
//!
//! Each variable is an element `miMATRIX`, or one inside an element `miCOMPRESSED` (zlib). Arrays of numbers
//! in one dimension are columns, a matrix is several: `U(:,1)`, or `U(1,:)` where its rows go on in time.
//! Fields of a structure are called `s.a`. Columns of one length are one section, and its clock is told as in
//! a plain table: by a unit of time in a name (`t_ms`), or a column called `t` or `time`. NaN is a gap, and
//! so is infinity, which is said. Tables, timetables and other objects are kept by MATLAB in a form of its
//! own, and are named with how to save them instead.
//!
//! No length in the file is believed: what is read is what the file has bytes for, and what comes out of a
//! compressed variable is counted. MathWorks, "MAT-File Format", R2019b.

use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use flate2::bufread::ZlibDecoder;

use super::capture::{Capture, Column, Importer, Note, ReadOptions, RowLines, Section};
use super::delimited::unit_in_name;
use super::error::{Error, ErrorKind};
use super::mat73;
use super::tdms::Kind;
use super::text::decode;

/// The importer of MATLAB files.
pub struct Mat;

const MARK: &[u8] = b"MATLAB 5.0";
const HEADER_BYTES: usize = 128;

impl Importer for Mat {
    fn name(&self) -> &'static str {
        "mat"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        head.starts_with(MARK) || mat73::recognises(head)
    }

    fn read(&self, path: &Path, _options: &ReadOptions) -> Result<Capture, Error> {
        let file = super::opened::open(path).map_err(|e| Error::io(path, e))?;
        let size = file.metadata().map_err(|e| Error::io(path, e))?.len();
        let numbers = size
            .saturating_mul(NUMBERS_PER_BYTE)
            .saturating_add(NUMBERS);
        let mut file = BufReader::with_capacity(BLOCK, file);
        let head = file.fill_buf().map_err(|e| Error::io(path, e))?;
        if mat73::recognises(head) {
            return Ok(mat73::read(path, file.into_inner(), numbers)?.capture(path));
        }
        let mut found = Found::new(numbers);
        found.file(path, &mut file)?;
        Ok(found.capture(path))
    }
}

/// How much is read at a time, bytes.
const BLOCK: usize = 64 * 1024;
/// Numbers that a file may hold whatever its length (512 MiB), and how many more for each of its bytes: a
/// compressed variable of zeros may be a thousand times as long as its bytes.
const NUMBERS: u64 = 1 << 26;
const NUMBERS_PER_BYTE: u64 = 16;
/// Structures within structures, and elements of arrays of structures: more is no recording.
pub(super) const MAX_DEPTH: usize = 16;
const MAX_ELEMENTS: u64 = 4096;
/// Texts of names: MATLAB's own limit is 63 letters; all names of a structure stand in one element.
const MAX_NAMES: u64 = 1 << 20;

const NO_ZLIB: &str = "its compressed bytes are damaged";

const MI_MATRIX: u32 = 14;
const MI_COMPRESSED: u32 = 15;

/// How a number of an element is kept.
fn kind(mi: u32) -> Option<Kind> {
    Some(match mi {
        1 => Kind::I8,
        2 => Kind::U8,
        3 => Kind::I16,
        4 => Kind::U16,
        5 => Kind::I32,
        6 => Kind::U32,
        7 => Kind::F32,
        9 => Kind::F64,
        12 => Kind::I64,
        13 => Kind::U64,
        _ => return None,
    })
}

/// Why a variable cannot be read.
enum Stop {
    /// The file ends within it.
    Cut,
    /// It is not as the format has it.
    Wrong(&'static str),
    /// It holds more numbers than a file of this size may.
    Large,
    Io(io::Error),
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Stop::Cut,
            // what the decompressor says of bytes that are no zlib
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => Stop::Wrong(NO_ZLIB),
            _ => Stop::Io(error),
        }
    }
}

/// The bytes of one element, as far as they are not read yet.
struct Bytes<'a> {
    from: &'a mut dyn Read,
    left: u64,
    big: bool,
}

/// Type and bytes of an element, and how many bytes follow its data.
struct Tag {
    mi: u32,
    bytes: u64,
    padding: u64,
}

impl Bytes<'_> {
    fn exact(&mut self, into: &mut [u8]) -> Result<(), Stop> {
        self.left = self
            .left
            .checked_sub(into.len() as u64)
            .ok_or(Stop::Wrong("a part of it is longer than it is"))?;
        Ok(self.from.read_exact(into)?)
    }

    fn u32(&self, bytes: [u8; 4]) -> u32 {
        match self.big {
            true => u32::from_be_bytes(bytes),
            false => u32::from_le_bytes(bytes),
        }
    }

    fn tag(&mut self) -> Result<Tag, Stop> {
        let mut word = [0; 4];
        self.exact(&mut word)?;
        let first = self.u32(word);
        let (mi, bytes, padding) = match first >> 16 {
            0 => {
                self.exact(&mut word)?;
                let bytes = u64::from(self.u32(word));
                (first, bytes, bytes.wrapping_neg() % 8)
            }
            small if small <= 4 => (first & 0xffff, u64::from(small), 4 - u64::from(small)),
            _ => return Err(Stop::Wrong("the type of a part is not known")),
        };
        if bytes > self.left {
            return Err(Stop::Wrong("a part of it is longer than it is"));
        }
        Ok(Tag { mi, bytes, padding })
    }

    fn skip(&mut self, bytes: u64) -> Result<(), Stop> {
        // the padding of a last element may be left out
        let wanted = bytes.min(self.left);
        let skipped = io::copy(&mut (&mut *self.from).take(wanted), &mut io::sink())?;
        self.left -= wanted;
        match skipped == wanted {
            true => Ok(()),
            false => Err(Stop::Cut),
        }
    }

    /// The bytes of a short element, such as a name.
    fn short(&mut self) -> Result<Vec<u8>, Stop> {
        let tag = self.tag()?;
        if tag.bytes > MAX_NAMES {
            return Err(Stop::Wrong("a name is longer than names are"));
        }
        let mut bytes = vec![0; usize::try_from(tag.bytes).unwrap_or(0)];
        self.exact(&mut bytes)?;
        self.skip(tag.padding)?;
        Ok(bytes)
    }

    fn text(&mut self) -> Result<String, Stop> {
        let bytes = self.short()?;
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        Ok(decode(&bytes[..end]).into_owned())
    }

    /// So many numbers, which have to be all that an element holds.
    fn numbers(&mut self, count: u64) -> Result<Vec<f64>, Stop> {
        let tag = self.tag()?;
        let kind =
            kind(tag.mi).ok_or(Stop::Wrong("its numbers are of a type that is not known"))?;
        let size = kind.size();
        if count.checked_mul(size) != Some(tag.bytes) {
            return Err(Stop::Wrong("it holds more or fewer numbers than it states"));
        }
        let mut values = Vec::new();
        let mut buffer = [0; 8 * 1024];
        let mut left = tag.bytes;
        while left > 0 {
            let some = usize::try_from(left)
                .unwrap_or(usize::MAX)
                .min(buffer.len());
            self.exact(&mut buffer[..some])?;
            let each = usize::try_from(size).unwrap_or(1);
            values.extend(
                buffer[..some]
                    .chunks_exact(each)
                    .map(|b| kind.value(b, self.big)),
            );
            left -= some as u64;
        }
        self.skip(tag.padding)?;
        Ok(values)
    }
}

/// An array of numbers, column after column.
struct Array {
    name: String,
    rows: usize,
    columns: usize,
    values: Vec<f64>,
}

/// What is in a file.
#[derive(Default)]
pub(super) struct Found {
    arrays: Vec<Array>,
    /// `fs = 1000`.
    single: Vec<String>,
    /// Name and class of objects.
    pub(super) objects: Vec<(String, String)>,
    /// Names of what is no number, and why.
    pub(super) others: Vec<(String, &'static str)>,
    /// The variable in which the file ends.
    cut: Option<String>,
    /// How many more it may hold.
    pub(super) numbers_left: u64,
}

impl Found {
    /// Nothing yet, and at most so many numbers.
    pub(super) fn new(numbers_left: u64) -> Self {
        Found {
            numbers_left,
            ..Found::default()
        }
    }

    fn file(&mut self, path: &Path, file: &mut BufReader<std::fs::File>) -> Result<(), Error> {
        let mut header = [0; HEADER_BYTES];
        file.read_exact(&mut header).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => wrong(path, 0, "", "it is shorter than its header"),
            _ => Error::io(path, e),
        })?;
        let big = match &header[126..128] {
            b"IM" => false,
            b"MI" => true,
            _ => return Err(wrong(path, 126, "", "its header states no order of bytes")),
        };
        let mut at = HEADER_BYTES as u64;
        loop {
            let mut name = String::new();
            let mut top = Bytes {
                from: file,
                left: u64::MAX,
                big,
            };
            let tag = match top.tag() {
                Ok(tag) => tag,
                // the end of the file, or of what was written of it
                Err(Stop::Cut) => return Ok(()),
                Err(stop) => return Err(stopped(path, at, "", stop)),
            };
            match self.variable(file, &tag, big, &mut name) {
                Ok(()) => {}
                Err(Stop::Cut) => {
                    self.cut = Some(name);
                    return Ok(());
                }
                Err(stop) => return Err(stopped(path, at, &name, stop)),
            }
            at = at.saturating_add(8).saturating_add(tag.bytes);
        }
    }

    /// An element of the file. `name` is that of its variable, as soon as it is known.
    fn variable(
        &mut self,
        file: &mut BufReader<std::fs::File>,
        tag: &Tag,
        big: bool,
        name: &mut String,
    ) -> Result<(), Stop> {
        if tag.mi == MI_COMPRESSED {
            let mut inside = file.take(tag.bytes);
            match self.compressed(&mut inside, big, name) {
                // its bytes are all there and make no end
                Err(Stop::Cut) if inside.limit() == 0 => return Err(Stop::Wrong(NO_ZLIB)),
                other => other?,
            }
            let wanted = inside.limit();
            let skipped = io::copy(&mut inside, &mut io::sink())?;
            return match skipped == wanted {
                true => Ok(()),
                false => Err(Stop::Cut),
            };
        }
        let mut bytes = Bytes {
            from: file,
            left: tag.bytes,
            big,
        };
        if tag.mi == MI_MATRIX {
            self.matrix(&mut bytes, None, 0, name)?;
        }
        let left = bytes.left;
        bytes.skip(left)?;
        bytes.left = tag.padding;
        bytes.skip(tag.padding)
    }

    /// The variable in the bytes of a compressed element.
    fn compressed(
        &mut self,
        inside: &mut impl BufRead,
        big: bool,
        name: &mut String,
    ) -> Result<(), Stop> {
        let mut bytes = Bytes {
            from: &mut ZlibDecoder::new(inside),
            left: u64::MAX,
            big,
        };
        let inner = bytes.tag()?;
        if inner.mi == MI_MATRIX {
            bytes.left = inner.bytes;
            self.matrix(&mut bytes, None, 0, name)?;
        }
        // to the end, where the sum of its bytes is checked
        io::copy(bytes.from, &mut io::sink())?;
        Ok(())
    }

    /// A matrix, from behind its tag on. A field has its name from its structure.
    fn matrix(
        &mut self,
        bytes: &mut Bytes,
        field: Option<&str>,
        depth: usize,
        name: &mut String,
    ) -> Result<(), Stop> {
        if bytes.left == 0 {
            // an empty array in a structure
            return Ok(());
        }
        let flags = bytes.short()?;
        let word = <[u8; 4]>::try_from(flags.get(..4).unwrap_or_default())
            .map_err(|_| Stop::Wrong("it has no flags"))?;
        let flags = bytes.u32(word);
        let (class, complex) = (flags & 0xff, flags & 0x800 != 0);
        let called = |own: String| field.map_or(own, str::to_owned);
        if class == 17 {
            *name = called(bytes.text()?);
            let _system = bytes.text()?;
            let class = bytes.text()?;
            self.objects.push((name.clone(), class));
            return Ok(());
        }
        let sizes = bytes.short()?;
        let sizes: Vec<u64> = sizes
            .chunks_exact(4)
            .map(|b| u64::from(bytes.u32([b[0], b[1], b[2], b[3]])))
            .collect();
        let count = sizes
            .iter()
            .try_fold(1, |product: u64, n| product.checked_mul(*n))
            .ok_or(Stop::Wrong("its size is beyond all numbers"))?;
        *name = called(bytes.text()?);
        // what MATLAB keeps for its objects has no name
        if name.is_empty() {
            return Ok(());
        }
        let why = match class {
            2 => return self.structure(bytes, count, depth, name),
            6..=15 if complex => "complex",
            6..=15 if sizes.len() != 2 => "of three and more dimensions",
            6..=15 => return self.numbers(bytes, &sizes, count, name),
            1 => "a cell array",
            3 => "an object",
            5 => "sparse",
            4 => "text",
            16 => "a function",
            _ => return Err(Stop::Wrong("its class is not known")),
        };
        self.others.push((name.clone(), why));
        Ok(())
    }

    fn numbers(
        &mut self,
        bytes: &mut Bytes,
        sizes: &[u64],
        count: u64,
        name: &str,
    ) -> Result<(), Stop> {
        self.numbers_left = self.numbers_left.checked_sub(count).ok_or(Stop::Large)?;
        let values = match count {
            0 => Vec::new(),
            _ => bytes.numbers(count)?,
        };
        self.keep(name, sizes, values);
        Ok(())
    }

    /// Keeps an array of two sizes with its numbers, column after column.
    pub(super) fn keep(&mut self, name: &str, sizes: &[u64], values: Vec<f64>) {
        match values.as_slice() {
            [] => self.others.push((name.to_owned(), "empty")),
            [value] => self.single.push(format!("{name} = {value}")),
            _ => {
                let size = |i: usize| usize::try_from(sizes[i]).unwrap_or(0);
                self.arrays.push(Array {
                    name: name.to_owned(),
                    rows: size(0),
                    columns: size(1),
                    values,
                });
            }
        }
    }

    fn structure(
        &mut self,
        bytes: &mut Bytes,
        elements: u64,
        depth: usize,
        name: &str,
    ) -> Result<(), Stop> {
        if depth >= MAX_DEPTH {
            return Err(Stop::Wrong("structures stand in each other without an end"));
        }
        let length = bytes.short()?;
        let length = <[u8; 4]>::try_from(length.as_slice())
            .map_err(|_| Stop::Wrong("its fields have no names"))?;
        let length = usize::try_from(bytes.u32(length)).unwrap_or(0);
        let names = bytes.short()?;
        if length == 0 && !names.is_empty() {
            return Err(Stop::Wrong("its fields have no names"));
        }
        if elements > MAX_ELEMENTS {
            self.others
                .push((name.to_owned(), "a long array of structures"));
            return Ok(());
        }
        let fields: Vec<String> = names
            .chunks(length.max(1))
            .map(|n| n.split(|b| *b == 0).next().unwrap_or_default())
            .map(|n| decode(n).into_owned())
            .collect();
        for element in 1..=elements {
            for field in &fields {
                let path = match elements {
                    1 => format!("{name}.{field}"),
                    _ => format!("{name}({element}).{field}"),
                };
                let tag = bytes.tag()?;
                if tag.mi != MI_MATRIX {
                    return Err(Stop::Wrong("a field is no array"));
                }
                let mut inside = Bytes {
                    from: &mut *bytes.from,
                    left: tag.bytes,
                    big: bytes.big,
                };
                self.matrix(&mut inside, Some(&path), depth + 1, &mut String::new())?;
                let rest = inside.left;
                inside.skip(rest)?;
                bytes.left -= tag.bytes;
                bytes.skip(tag.padding)?;
            }
        }
        Ok(())
    }

    fn capture(mut self, path: &Path) -> Capture {
        let mut sections: Vec<Section> = Vec::new();
        let mut notes = Vec::new();
        let mut number = 0;
        let lengths: Vec<usize> = self
            .arrays
            .iter()
            .filter(|a| a.rows == 1 || a.columns == 1)
            .map(|a| a.values.len())
            .collect();
        for array in std::mem::take(&mut self.arrays) {
            let unit = unit_in_name(&array.name).map_or("", |u| u.symbol);
            for (axis, mut values) in array.split(&lengths) {
                number += 1;
                let infinite = values.iter().filter(|v| v.is_infinite()).count();
                if infinite > 0 {
                    values
                        .iter_mut()
                        .filter(|v| v.is_infinite())
                        .for_each(|v| *v = f64::NAN);
                    notes.push(Note::warning(
                        path,
                        format!("{axis}: infinite values: {infinite}; taken as gaps"),
                    ));
                }
                let rows = values.len();
                let at = match sections.iter().position(|s| s.lines.len() == rows) {
                    Some(at) => at,
                    None => {
                        sections.push(Section {
                            lines: RowLines::without(rows),
                            ..Section::default()
                        });
                        sections.len() - 1
                    }
                };
                sections[at].columns.push(Column {
                    group: String::new(),
                    unit: unit.to_owned(),
                    axis,
                    number,
                    values,
                });
            }
        }
        for section in &mut sections {
            section.name = format!("arrays of {}", section.rows());
        }
        self.say(path, &mut notes);
        Capture {
            format: "mat",
            sections,
            notes,
        }
    }

    fn say(&self, path: &Path, notes: &mut Vec<Note>) {
        let some = |names: &[String]| {
            let more = names.len().saturating_sub(8);
            let list = names.iter().take(8).cloned().collect::<Vec<_>>().join(", ");
            match more {
                0 => list,
                _ => format!("{list} and {more} more"),
            }
        };
        if !self.single.is_empty() {
            notes.push(Note::info(
                path,
                format!("single numbers: {}", some(&self.single)),
            ));
        }
        for (name, class) in &self.objects {
            notes.push(Note::warning(path, object(name, class)));
        }
        if !self.others.is_empty() {
            let list: Vec<String> = self
                .others
                .iter()
                .map(|(n, why)| format!("{n} ({why})"))
                .collect();
            let all_texts = self
                .others
                .iter()
                .all(|(_, why)| matches!(*why, "text" | "empty"));
            let text = format!("no columns of numbers, left out: {}", some(&list));
            notes.push(match all_texts {
                true => Note::info(path, text),
                false => Note::warning(path, text),
            });
        }
        if let Some(name) = &self.cut {
            let within = match name.is_empty() {
                true => String::new(),
                false => format!(" within {name}"),
            };
            notes.push(Note::warning(
                path,
                format!("the file was cut{within}; the variables before are read"),
            ));
        }
    }
}

impl Array {
    /// Its columns with their names. A matrix goes on in time along the side that is as long as some vector,
    /// else along its longer side.
    fn split(self, lengths: &[usize]) -> Vec<(String, Vec<f64>)> {
        let Array {
            name,
            rows,
            columns,
            values,
        } = self;
        if rows == 1 || columns == 1 {
            return vec![(name, values)];
        }
        let down = match (lengths.contains(&rows), lengths.contains(&columns)) {
            (true, false) => true,
            (false, true) => false,
            _ => rows >= columns,
        };
        match down {
            true => values
                .chunks_exact(rows)
                .enumerate()
                .map(|(c, v)| (format!("{name}(:,{})", c + 1), v.to_vec()))
                .collect(),
            false => (0..rows)
                .map(|r| {
                    let along = values[r..].iter().step_by(rows).copied().collect();
                    (format!("{name}({},:)", r + 1), along)
                })
                .collect(),
        }
    }
}

/// How to save an object as arrays.
fn object(name: &str, class: &str) -> String {
    let how = match class {
        "table" => format!(
            "s = table2struct({name}, 'ToScalar', true); save('run.mat', '-struct', 's'), or writetable({name}, 'run.csv')"
        ),
        "timetable" => format!(
            "t = seconds({name}.Properties.RowTimes - {name}.Properties.RowTimes(1)); u = {name}.Variables; save('run.mat', 't', 'u')"
        ),
        "datetime" => format!("t = seconds({name} - {name}(1)); save('run.mat', 't', '-append')"),
        "duration" => format!("t = seconds({name}); save('run.mat', 't', '-append')"),
        "timeseries" => {
            format!("t = {name}.Time; u = {name}.Data; save('run.mat', 't', 'u')")
        }
        _ => "save what it holds as arrays of numbers".to_owned(),
    };
    format!("{name} is an object ({class}) in a form of MATLAB's own, and is not read; {how}")
}

fn wrong(path: &Path, at: u64, name: &str, what: &str) -> Error {
    let which = match name.is_empty() {
        true => format!("the variable at byte {at}"),
        false => format!("the variable {name} at byte {at}"),
    };
    Error::new(
        ErrorKind::Grammar,
        path,
        match at < HEADER_BYTES as u64 {
            true => format!("the file is damaged: {what}"),
            false => format!("{which} is damaged: {what}"),
        },
    )
    .action("copy the file again, or save it again in MATLAB with save('run.mat', '-v7')")
}

fn stopped(path: &Path, at: u64, name: &str, stop: Stop) -> Error {
    match stop {
        Stop::Wrong(what) => wrong(path, at, name, what),
        Stop::Cut => wrong(path, at, name, "the file ends within it"),
        Stop::Large => too_many(path, name),
        Stop::Io(error) => Error::io(path, error),
    }
}

/// The error for more numbers than a file of its size is believed to hold.
pub(super) fn too_many(path: &Path, name: &str) -> Error {
    Error::new(
        ErrorKind::CellCount,
        path,
        format!("the variable {name} holds more numbers than a file of this size is read with"),
    )
    .action("save only the variables of the recording: save('run.mat', 't', 'u', '-v7')")
}
