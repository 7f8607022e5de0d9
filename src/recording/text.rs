//! The text rules that every importer shares: encodings, lines, cells, numbers.
//!
//! A file is streamed: at most one line of at most [`MAX_LINE_BYTES`] is held. A byte-order mark is dropped,
//! LF and CRLF and a missing last newline are all fine. Text that is not UTF-8 is read as Latin-1 unless
//! another encoding is declared.
//!
//! Numbers: a column is written with a decimal dot until a cell shows otherwise. `1,5` between semicolons,
//! tabs or spaces is a decimal comma; a cell with two dots, `1.003.000`, makes every dot of its column a
//! thousands separator. Where a column was read the other way before, the reader says so
//! ([`Trouble::Reread`]) and the file is read again.

use std::borrow::Cow;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use encoding_rs::Encoding;

use super::error::{Error, ErrorKind, quote, suggestion};

/// The longest line that is read, bytes. A longer one is refused in constant memory.
pub const MAX_LINE_BYTES: usize = 1 << 20;

/// Encodings to suggest when a declared one is not known.
const COMMON_ENCODINGS: &[&str] = &[
    "utf-8",
    "latin1",
    "windows-1252",
    "gbk",
    "gb18030",
    "big5",
    "shift_jis",
    "euc-jp",
    "euc-kr",
    "utf-16le",
    "utf-16be",
];

/// The encoding that a manifest names.
///
/// # Errors
/// [`ErrorKind::Encoding`] when no encoding has that name.
pub fn encoding(path: &Path, label: &str) -> Result<&'static Encoding, Error> {
    let plain = match label.to_ascii_lowercase().as_str() {
        "latin-1" => "latin1".to_owned(),
        other => other.to_owned(),
    };
    Encoding::for_label(plain.as_bytes()).ok_or_else(|| {
        Error::new(
            ErrorKind::Encoding,
            path,
            format!("encoding {} is not known", quote(label)),
        )
        .at_key("encoding")
        .action(suggestion(label, COMMON_ENCODINGS))
    })
}

/// Turns any encoding into UTF-8 while reading, a few kilobytes at a time.
struct Decoding<R> {
    inner: R,
    decoder: encoding_rs::Decoder,
    raw: Box<[u8]>,
    raw_from: usize,
    raw_to: usize,
    ended: bool,
    finished: bool,
}

impl<R: Read> Decoding<R> {
    fn new(inner: R, encoding: &'static Encoding) -> Self {
        Decoding {
            inner,
            decoder: encoding.new_decoder_with_bom_removal(),
            raw: vec![0; 16 * 1024].into(),
            raw_from: 0,
            raw_to: 0,
            ended: false,
            finished: false,
        }
    }
}

impl<R: Read> Read for Decoding<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while !self.finished {
            if self.raw_from == self.raw_to && !self.ended {
                self.raw_from = 0;
                self.raw_to = self.inner.read(&mut self.raw)?;
                self.ended = self.raw_to == 0;
            }
            let (result, read, written, malformed) =
                self.decoder
                    .decode_to_utf8(&self.raw[self.raw_from..self.raw_to], out, self.ended);
            self.raw_from += read;
            if malformed {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidData,
                    format!("bytes that are no {}", self.decoder.encoding().name()),
                ));
            }
            self.finished = self.ended && result == encoding_rs::CoderResult::InputEmpty;
            if written > 0 {
                return Ok(written);
            }
            if read == 0 && result == encoding_rs::CoderResult::OutputFull {
                return Err(io::ErrorKind::WriteZero.into());
            }
        }
        Ok(0)
    }
}

/// The lines of a text file, one at a time, without their ends.
pub struct LineReader {
    path: PathBuf,
    reader: BufReader<Box<dyn Read>>,
    line: Vec<u8>,
    number: u64,
    ended_with_newline: bool,
    not_utf8: bool,
    cells_left: u64,
}

/// Numbers that a table may hold whatever its length, and how many more for each byte of the file: rows that
/// are almost empty below a wide header would ask for any amount of memory.
const CELLS: u64 = 1 << 23;
const CELLS_PER_BYTE: u64 = 16;

impl LineReader {
    /// Opens a file, unpacked where it is gzipped. Without a declared encoding it is UTF-8, or UTF-16 if a
    /// byte-order mark says so; a cell that is not UTF-8 is then read as Latin-1.
    ///
    /// # Errors
    /// The file cannot be opened, or the encoding is not known.
    pub fn open(path: &Path, declared: Option<&str>) -> Result<Self, Error> {
        let declared = declared.map(|label| encoding(path, label)).transpose()?;
        let mut text = super::opened::text(path).map_err(|e| Error::io(path, e))?;
        let mut mark = Vec::with_capacity(2);
        text.by_ref()
            .take(2)
            .read_to_end(&mut mark)
            .map_err(|e| Error::io(path, e))?;
        let found = match mark.as_slice() {
            [0xff, 0xfe] => Some(encoding_rs::UTF_16LE),
            [0xfe, 0xff] => Some(encoding_rs::UTF_16BE),
            _ => None,
        };
        let length = std::fs::metadata(path).map_or(0, |m| m.len());
        let bytes = io::Cursor::new(mark).chain(text);
        let mut reader = match found.or(declared) {
            Some(e) if e != encoding_rs::UTF_8 => Self::new(path, Decoding::new(bytes, e)),
            _ => Self::new(path, bytes),
        };
        reader.cells_left = length.saturating_mul(CELLS_PER_BYTE).saturating_add(CELLS);
        Ok(reader)
    }

    /// Reads lines of UTF-8 (or Latin-1) from anything; `path` is for messages.
    pub fn new(path: &Path, bytes: impl Read + 'static) -> Self {
        LineReader {
            path: path.to_owned(),
            reader: BufReader::with_capacity(64 * 1024, Box::new(bytes)),
            line: Vec::with_capacity(256),
            number: 0,
            ended_with_newline: true,
            not_utf8: false,
            cells_left: CELLS,
        }
    }

    /// Counts a row of so many numbers, written or left out.
    ///
    /// # Errors
    /// The table is far larger than the file: almost all of it is empty.
    pub fn spend(&mut self, cells: usize) -> Result<(), Error> {
        match self.cells_left.checked_sub(cells as u64) {
            Some(left) => {
                self.cells_left = left;
                Ok(())
            }
            None => Err(Error::new(
                ErrorKind::CellCount,
                &self.path,
                format!("the table has {cells} columns and almost all of its cells are empty"),
            )
            .at_line(self.number)
            .action("export fewer columns, or label the markers so that they do not come and go")),
        }
    }

    /// Goes to the next line; false at the end of the file.
    ///
    /// # Errors
    /// Reading fails, or the line is longer than [`MAX_LINE_BYTES`].
    pub fn advance(&mut self) -> Result<bool, Error> {
        self.line.clear();
        let limit = MAX_LINE_BYTES as u64 + 2;
        let read = (&mut self.reader)
            .take(limit)
            .read_until(b'\n', &mut self.line)
            .map_err(|e| match e.kind() {
                io::ErrorKind::InvalidData => {
                    Error::new(ErrorKind::Encoding, &self.path, format!("has {e}"))
                        .at_line(self.number + 1)
                        .action("declare the file's encoding with `encoding = \"...\"`")
                }
                _ => Error::io(&self.path, e).at_line(self.number + 1),
            })?;
        if read == 0 {
            return Ok(false);
        }
        self.number += 1;
        self.ended_with_newline = self.line.last() == Some(&b'\n');
        if self.ended_with_newline {
            self.line.pop();
        }
        if self.line.last() == Some(&b'\r') {
            self.line.pop();
        }
        if self.line.len() > MAX_LINE_BYTES {
            return Err(Error::new(
                ErrorKind::LineTooLong,
                &self.path,
                format!("the line is longer than {MAX_LINE_BYTES} bytes"),
            )
            .at_line(self.number)
            .expected("lines of text")
            .action("the file is no table, or has lost its line ends; export it again"));
        }
        if self.number == 1 && self.line.starts_with(b"\xef\xbb\xbf") {
            self.line.drain(..3);
        }
        Ok(true)
    }

    /// The current line, without its end.
    #[must_use]
    pub fn line(&self) -> &[u8] {
        &self.line
    }

    /// The number of the current line, from 1.
    #[must_use]
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Whether the current line ended with a newline; the last line of a file that was cut does not.
    #[must_use]
    pub fn ended_with_newline(&self) -> bool {
        self.ended_with_newline
    }

    /// The file, for messages.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Remembers that a cell was not UTF-8.
    pub fn note_not_utf8(&mut self) {
        self.not_utf8 = true;
    }

    /// Whether a cell was not UTF-8 and was read as Latin-1.
    #[must_use]
    pub fn was_not_utf8(&self) -> bool {
        self.not_utf8
    }
}

/// Text of a cell: UTF-8, or Latin-1 where it is not.
#[must_use]
pub fn decode(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|b| char::from(*b)).collect()),
    }
}

/// What stands between the cells of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delimiter {
    /// `,`
    Comma,
    /// `;`
    Semicolon,
    /// a tab
    Tab,
    /// one or more spaces
    Spaces,
}

impl Delimiter {
    /// All of them, the ones that decide more firmly first.
    pub const ALL: [Delimiter; 4] = [
        Delimiter::Tab,
        Delimiter::Semicolon,
        Delimiter::Comma,
        Delimiter::Spaces,
    ];

    /// The byte.
    #[must_use]
    pub fn byte(self) -> u8 {
        match self {
            Delimiter::Comma => b',',
            Delimiter::Semicolon => b';',
            Delimiter::Tab => b'\t',
            Delimiter::Spaces => b' ',
        }
    }

    /// Its name, for notes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Delimiter::Comma => "comma",
            Delimiter::Semicolon => "semicolon",
            Delimiter::Tab => "tab",
            Delimiter::Spaces => "spaces",
        }
    }
}

/// One cell, spaces and quotation marks taken off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cell<'a> {
    /// What is in it. A doubled quotation mark is still doubled.
    pub bytes: &'a [u8],
    /// Whether it stood in quotation marks.
    pub quoted: bool,
}

impl Cell<'_> {
    /// Its text, doubled quotation marks made single.
    #[must_use]
    pub fn text(&self) -> String {
        let text = decode(self.bytes);
        if self.quoted {
            text.replace("\"\"", "\"")
        } else {
            text.into_owned()
        }
    }
}

/// The cells of one row.
#[derive(Debug, Clone)]
pub struct Cells<'a> {
    rest: Option<&'a [u8]>,
    delimiter: Delimiter,
}

impl<'a> Cells<'a> {
    /// Splits a line.
    #[must_use]
    pub fn new(line: &'a [u8], delimiter: Delimiter) -> Self {
        let rest = match delimiter {
            Delimiter::Spaces => trim(line),
            _ => line,
        };
        Cells {
            rest: Some(rest),
            delimiter,
        }
    }

    /// After a cell that ends at `end`, what is left.
    fn cut(&mut self, rest: &'a [u8], end: usize) {
        self.rest = match rest.get(end) {
            None => None,
            Some(_) if self.delimiter == Delimiter::Spaces => {
                Some(rest[end..].trim_ascii_start()).filter(|r| !r.is_empty())
            }
            Some(_) => Some(&rest[end + 1..]),
        };
    }
}

impl Cells<'_> {
    /// The next cell, if it is empty or nothing but a sign, digits and a dot, and whether it has a dot. The
    /// cells stay where they are otherwise. Rounded as [`plain_number`] rounds.
    #[inline]
    fn plain(&mut self) -> Option<(f64, bool)> {
        let rest = self.rest?;
        let delimiter = match self.delimiter {
            Delimiter::Spaces => return None,
            other => other.byte(),
        };
        let negative = rest.first() == Some(&b'-');
        let mut i = usize::from(negative);
        let mut mantissa: u64 = 0;
        let mut dot = usize::MAX;
        let mut ended = false;
        while let Some(&b) = rest.get(i) {
            let digit = b.wrapping_sub(b'0');
            if digit < 10 {
                mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(digit));
            } else if b == b'.' && dot == usize::MAX {
                dot = i;
            } else if b == delimiter {
                ended = true;
                break;
            } else {
                return None;
            }
            i += 1;
        }
        let has_dot = dot != usize::MAX;
        let digits = i - usize::from(negative) - usize::from(has_dot);
        if i > 0 && (digits == 0 || digits > 18) {
            return None;
        }
        self.rest = ended.then(|| &rest[i + 1..]);
        if i == 0 {
            return Some((f64::NAN, false));
        }
        if mantissa > 1 << 53 {
            self.rest = Some(rest);
            return None;
        }
        let fraction = if has_dot { i - 1 - dot } else { 0 };
        #[allow(clippy::cast_precision_loss)]
        let value = mantissa as f64 / EXACT_POWERS[fraction];
        Some((if negative { -value } else { value }, has_dot))
    }
}

impl<'a> Iterator for Cells<'a> {
    type Item = Cell<'a>;

    #[inline]
    fn next(&mut self) -> Option<Cell<'a>> {
        let rest = self.rest?;
        let ends = |b: &u8| match self.delimiter {
            Delimiter::Spaces => *b == b' ' || *b == b'\t',
            other => *b == other.byte(),
        };
        let lead = rest.iter().take_while(|b| **b == b' ').count();
        if rest.get(lead) == Some(&b'"') {
            // "..." with "" for a mark inside; what follows the closing mark must be spaces up to the
            // delimiter
            let body = &rest[lead + 1..];
            let mut i = 0;
            while i < body.len() {
                if body[i] != b'"' {
                    i += 1;
                } else if body.get(i + 1) == Some(&b'"') {
                    i += 2;
                } else {
                    break;
                }
            }
            if i < body.len() {
                let after = &body[i + 1..];
                let end = after.iter().position(ends).unwrap_or(after.len());
                if after[..end].trim_ascii().is_empty() {
                    self.cut(rest, lead + 1 + i + 1 + end);
                    return Some(Cell {
                        bytes: trim(&body[..i]),
                        quoted: true,
                    });
                }
            }
        }
        let end = rest.iter().position(ends).unwrap_or(rest.len());
        self.cut(rest, end);
        Some(Cell {
            bytes: trim(&rest[..end]),
            quoted: false,
        })
    }
}

/// The texts in the cells of a row.
#[must_use]
pub fn texts(line: &[u8], delimiter: Delimiter) -> Vec<String> {
    Cells::new(line, delimiter).map(|c| c.text()).collect()
}

/// [`texts`] without the empty ones at the end.
#[must_use]
pub fn filled_texts(line: &[u8], delimiter: Delimiter) -> Vec<String> {
    let mut cells = texts(line, delimiter);
    while cells.last().is_some_and(String::is_empty) {
        cells.pop();
    }
    cells
}

/// Without ASCII space at both ends.
#[inline]
#[must_use]
pub fn trim(bytes: &[u8]) -> &[u8] {
    bytes.trim_ascii()
}

/// Whether a row holds nothing: every cell empty, whatever the delimiter.
#[must_use]
pub fn is_blank(line: &[u8]) -> bool {
    line.iter()
        .all(|b| matches!(b, b',' | b';' | b'\t' | b' ' | b'"' | b'\r'))
}

/// How the numbers of one column are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Notation {
    /// `1234.5`, commas between groups of three if any.
    Dot,
    /// `1234,5`, dots between groups of three if any.
    Comma,
}

/// Why a cell is no number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trouble {
    /// It says NaN or infinity, or is too large for a number.
    NotFinite,
    /// It is something else.
    NotANumber,
    /// It contradicts the notation that the column had so far.
    Contradiction,
    /// The column is in [`Notation::Comma`] and dots were read as decimals before: read the file again.
    Reread,
}

/// One column of numbers: knows its notation as far as the cells have shown it.
#[derive(Debug, Clone)]
pub struct NumberColumn {
    notation: Notation,
    saw_dot: bool,
    saw_comma: bool,
    between_commas: bool,
}

impl NumberColumn {
    /// A column between the given delimiters, in a notation already known or [`Notation::Dot`] to begin with.
    #[must_use]
    pub fn new(delimiter: Delimiter, notation: Notation) -> Self {
        NumberColumn {
            notation,
            saw_dot: false,
            saw_comma: false,
            between_commas: delimiter == Delimiter::Comma,
        }
    }

    /// The columns of a row of so many cells; `comma` says of a cell whether it is known to be in
    /// [`Notation::Comma`].
    #[must_use]
    pub fn row(cells: usize, delimiter: Delimiter, comma: impl Fn(usize) -> bool) -> Vec<Self> {
        let notation = |cell| match comma(cell) {
            true => Notation::Comma,
            false => Notation::Dot,
        };
        (0..cells)
            .map(|cell| NumberColumn::new(delimiter, notation(cell)))
            .collect()
    }

    /// Whether dots part thousands in the column only because a number in it has two of them: no cell has a
    /// decimal comma.
    #[must_use]
    pub fn groups_by_dots_alone(&self) -> bool {
        self.notation == Notation::Comma && !self.saw_comma
    }

    /// The notation as far as it is known.
    #[must_use]
    pub fn notation(&self) -> Notation {
        self.notation
    }

    /// The number in the next cell of a row, NaN when it is empty; `None` after the last. With trouble comes
    /// the cell.
    #[inline]
    pub fn next<'a>(&mut self, cells: &mut Cells<'a>) -> Option<Result<f64, (Trouble, Cell<'a>)>> {
        if self.notation == Notation::Dot
            && let Some((value, dot)) = cells.plain()
        {
            self.saw_dot |= dot;
            return Some(Ok(value));
        }
        let cell = cells.next()?;
        Some(self.parse(cell.bytes).map_err(|trouble| (trouble, cell)))
    }

    /// The number in a cell; NaN when the cell is empty.
    ///
    /// # Errors
    /// See [`Trouble`].
    #[inline]
    pub fn parse(&mut self, cell: &[u8]) -> Result<f64, Trouble> {
        if cell.is_empty() {
            return Ok(f64::NAN);
        }
        if self.notation == Notation::Dot
            && let Some((value, dot)) = plain_number(cell)
        {
            self.saw_dot |= dot;
            return finite(value);
        }
        self.parse_slowly(cell)
    }

    #[cold]
    fn parse_slowly(&mut self, cell: &[u8]) -> Result<f64, Trouble> {
        if says_not_finite(cell) {
            return Err(Trouble::NotFinite);
        }
        let (sign, body) = match cell.first() {
            Some(b'-') => (-1.0, &cell[1..]),
            Some(b'+') => (1.0, &cell[1..]),
            _ => (1.0, cell),
        };
        let count = |byte: u8| body.iter().filter(|b| **b == byte).count();
        let (dots, commas) = (count(b'.'), count(b','));
        if !body
            .first()
            .is_some_and(|b| b.is_ascii_digit() || *b == b'.' || *b == b',')
        {
            return Err(Trouble::NotANumber);
        }
        if self.notation == Notation::Dot {
            let comma_last =
                body.iter().rposition(|b| *b == b',') > body.iter().rposition(|b| *b == b'.');
            let decimal_comma = commas == 1 && comma_last && (dots > 0 || !self.between_commas);
            let grouping_dots = commas == 0 && dots >= 2;
            if decimal_comma || grouping_dots {
                normalised(body, b',', b'.').ok_or(Trouble::NotANumber)?;
                if self.saw_dot {
                    return Err(Trouble::Reread);
                }
                self.notation = Notation::Comma;
            } else if commas == 1 && dots == 0 {
                // "1,234" in quotation marks between commas: could be either
                return Err(Trouble::Contradiction);
            } else {
                let value = normalised(body, b'.', b',').ok_or(Trouble::NotANumber)?;
                self.saw_dot |= dots > 0;
                return finite(sign * value);
            }
        }
        self.saw_comma |= commas > 0;
        match normalised(body, b',', b'.') {
            Some(value) => finite(sign * value),
            None if normalised(body, b'.', b',').is_some() => Err(Trouble::Contradiction),
            None => Err(Trouble::NotANumber),
        }
    }
}

fn finite(value: f64) -> Result<f64, Trouble> {
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Trouble::NotFinite)
    }
}

/// Whether a cell spells NaN or infinity, or that there is no number, as instruments, spreadsheets and
/// languages do.
#[must_use]
pub fn says_not_finite(cell: &[u8]) -> bool {
    let text = cell.to_ascii_lowercase();
    let text = text
        .strip_prefix(b"-")
        .or_else(|| text.strip_prefix(b"+"))
        .unwrap_or(&text);
    text.starts_with(b"1.#")
        || text.starts_with(b"nan(")
        || matches!(
            text,
            b"nan"
                | b"inf"
                | b"infinity"
                | b"qnan"
                | b"snan"
                | b"nanq"
                | b"-nan"
                | b"na"
                | b"n/a"
                | b"null"
                | b"#n/a"
                | b"#num!"
                | b"#div/0!"
                | b"#value!"
                | b"#ref!"
                | b"#name?"
                | b"#null!"
                | b"#getting_data"
        )
}

/// Whether a cell spells that nothing was measured: NaN in any of its spellings, `NA`, or an error of a
/// spreadsheet's formula, as `#N/A`.
/// Infinity is none: it was a number once.
#[must_use]
pub fn says_missing(cell: &[u8]) -> bool {
    let text = cell.to_ascii_lowercase();
    says_not_finite(cell) && !text.windows(3).any(|w| w == b"inf")
}

/// A number without a sign, with its decimal mark made a dot and its groups checked and joined.
fn normalised(body: &[u8], decimal: u8, group: u8) -> Option<f64> {
    let mantissa_end = body
        .iter()
        .position(|b| matches!(b, b'e' | b'E'))
        .unwrap_or(body.len());
    let (mantissa, exponent) = body.split_at(mantissa_end);
    let whole_end = mantissa
        .iter()
        .position(|b| *b == decimal)
        .unwrap_or(mantissa.len());
    let (whole, fraction) = mantissa.split_at(whole_end);
    let mut plain = Vec::with_capacity(body.len());
    if whole.contains(&group) {
        for (i, digits) in whole.split(|b| *b == group).enumerate() {
            let right_size = if i == 0 {
                (1..=3).contains(&digits.len())
            } else {
                digits.len() == 3
            };
            if !right_size {
                return None;
            }
            plain.extend_from_slice(digits);
        }
    } else {
        plain.extend_from_slice(whole);
    }
    if let Some((_, digits)) = fraction.split_first() {
        plain.push(b'.');
        plain.extend_from_slice(digits);
    }
    plain.extend_from_slice(exponent);
    if plain.first().is_some_and(|b| matches!(b, b'-' | b'+')) {
        return None;
    }
    plain_number(&plain).map(|(value, _)| value)
}

/// Powers of ten that a double holds exactly.
const EXACT_POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// `[+-]digits[.digits][e[+-]digits]`, rounded as the standard library rounds, and whether it has a dot.
///
/// A mantissa below 2^53 times or over an exact power of ten is one correctly rounded operation (Clinger
/// 1990); anything longer goes to the standard library.
#[inline]
#[must_use]
pub fn plain_number(cell: &[u8]) -> Option<(f64, bool)> {
    let (negative, body) = match cell.first()? {
        b'-' => (true, &cell[1..]),
        b'+' => (false, &cell[1..]),
        _ => (false, cell),
    };
    let mut mantissa: u64 = 0;
    let mut digits = 0usize;
    let mut fraction = 0usize;
    let mut dot = false;
    let mut i = 0;
    while let Some(&b) = body.get(i) {
        match b {
            b'0'..=b'9' => {
                mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(b - b'0'));
                digits += 1;
                fraction += usize::from(dot);
            }
            b'.' if !dot => dot = true,
            b'e' | b'E' => break,
            _ => return None,
        }
        i += 1;
    }
    if digits == 0 {
        return None;
    }
    let mut exponent: i64 = 0;
    if i < body.len() {
        let (down, power) = match body.get(i + 1)? {
            b'-' => (true, &body[i + 2..]),
            b'+' => (false, &body[i + 2..]),
            _ => (false, &body[i + 1..]),
        };
        if power.is_empty() {
            return None;
        }
        for b in power {
            if !b.is_ascii_digit() {
                return None;
            }
            exponent = (exponent * 10 + i64::from(b - b'0')).min(100_000);
        }
        if down {
            exponent = -exponent;
        }
    }
    exponent -= i64::try_from(fraction).ok()?;
    let exact = digits <= 19 && mantissa <= 1 << 53 && (-22..=22).contains(&exponent);
    let value = if exact {
        #[allow(clippy::cast_precision_loss)]
        let m = mantissa as f64;
        if exponent < 0 {
            m / EXACT_POWERS[usize::try_from(-exponent).ok()?]
        } else {
            m * EXACT_POWERS[usize::try_from(exponent).ok()?]
        }
    } else {
        std::str::from_utf8(body).ok()?.parse().ok()?
    };
    Some((if negative { -value } else { value }, dot))
}

/// The error for a cell that is no number.
#[must_use]
pub fn bad_cell(path: &Path, line: u64, column: usize, cell: &[u8], trouble: Trouble) -> Error {
    let found = format!("found {}", quote(&decode(cell)));
    let (kind, action) = match trouble {
        Trouble::NotFinite => (
            ErrorKind::NotFinite,
            "leave the cell empty where nothing was measured",
        ),
        Trouble::NotANumber => (ErrorKind::BadNumber, "correct the cell or leave it empty"),
        Trouble::Contradiction | Trouble::Reread => (
            ErrorKind::BadNumber,
            "decimal mark and thousands separator cannot be told apart in this column; export it again without thousands separators",
        ),
    };
    Error::new(kind, path, found)
        .at_line(line)
        .at_column(column)
        .expected("a finite number or an empty cell")
        .action(action)
}

/// The error for a cell of the reader's line that no column takes, or that is no number; `cell` counts from
/// 0, `expected` says what a row has.
#[must_use]
pub fn wrong_cell(
    lines: &LineReader,
    delimiter: Delimiter,
    cell: usize,
    trouble: Option<Trouble>,
    expected: String,
) -> Error {
    let bytes = Cells::new(lines.line(), delimiter)
        .nth(cell)
        .map_or(&b""[..], |c| c.bytes);
    match trouble {
        Some(trouble) => bad_cell(lines.path(), lines.number(), cell + 1, bytes, trouble),
        None => Error::new(
            ErrorKind::CellCount,
            lines.path(),
            format!(
                "found {} beyond the header's columns",
                quote(&decode(bytes))
            ),
        )
        .at_line(lines.number())
        .at_column(cell + 1)
        .expected(expected)
        .action("look for a stray delimiter in the row"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cells(line: &str, delimiter: Delimiter) -> Vec<String> {
        texts(line.as_bytes(), delimiter)
    }

    #[test]
    fn cells_of_a_row() {
        assert_eq!(cells("a,b,,", Delimiter::Comma), ["a", "b", "", ""]);
        assert_eq!(cells("", Delimiter::Comma), [""]);
        assert_eq!(
            cells("\"a,\"\"b\"\"\" , 2", Delimiter::Comma),
            ["a,\"b\"", "2"]
        );
        assert_eq!(
            cells("  0   1.0 \t2 ", Delimiter::Spaces),
            ["0", "1.0", "2"]
        );
        assert_eq!(cells("1;2,5", Delimiter::Semicolon), ["1", "2,5"]);
        // a mark that is never closed is part of the text
        assert_eq!(cells("\"a,b", Delimiter::Comma), ["\"a", "b"]);
    }

    fn read(delimiter: Delimiter, cells: &[&str]) -> Result<Vec<f64>, Trouble> {
        let mut column = NumberColumn::new(delimiter, Notation::Dot);
        cells.iter().map(|c| column.parse(c.as_bytes())).collect()
    }

    #[test]
    fn missing_is_not_infinite() {
        for cell in [
            "NaN", "nan", "-nan", "1.#QNAN", "-1.#IND", "nan(0x1)", "#N/A", "NA", "n/a", "null",
            "#DIV/0!", "#VALUE!", "#REF!", "#NAME?", "#NULL!", "#NUM!",
        ] {
            assert!(says_missing(cell.as_bytes()), "{cell}");
        }
        for cell in ["inf", "-Infinity", "1.#INF", "1e400", "0", "", "nano"] {
            assert!(!says_missing(cell.as_bytes()), "{cell}");
        }
    }

    #[test]
    fn notations() {
        assert_eq!(
            read(Delimiter::Semicolon, &["0", "0,1", "-1.234,5", "2.000"]),
            Ok(vec![0.0, 0.1, -1234.5, 2000.0])
        );
        assert_eq!(
            read(
                Delimiter::Comma,
                &["+158.6506E-03", "1,234,567.5", ".5", "5."]
            ),
            Ok(vec![0.1586506, 1_234_567.5, 0.5, 5.0])
        );
        // 903.000 was read as 903 before 1.003.000 showed that dots part thousands
        assert_eq!(
            read(Delimiter::Semicolon, &["903.000", "1.003.000"]),
            Err(Trouble::Reread)
        );
        let mut again = NumberColumn::new(Delimiter::Semicolon, Notation::Comma);
        assert_eq!(again.parse(b"903.000"), Ok(903_000.0));
        assert_eq!(again.parse(b"1.003.000"), Ok(1_003_000.0));
        assert_eq!(again.parse(b"3.65"), Err(Trouble::Contradiction));
        assert_eq!(
            read(Delimiter::Comma, &["1,5"]),
            Err(Trouble::Contradiction)
        );
    }

    #[test]
    fn what_is_no_number() {
        for cell in ["NaN", "-inf", "Infinity", "1.#QNAN", "1e999", "#N/A"] {
            assert_eq!(
                read(Delimiter::Comma, &[cell]),
                Err(Trouble::NotFinite),
                "{cell}"
            );
        }
        for cell in [
            "x",
            "1x",
            "--1",
            "1e",
            "1e+",
            ".",
            "-",
            "1.2.3",
            "0x10",
            "1 2",
            "1_000",
            "e5",
            "12:30",
            "2020-03-16",
        ] {
            assert_eq!(
                read(Delimiter::Comma, &[cell]),
                Err(Trouble::NotANumber),
                "{cell}"
            );
        }
    }

    fn reader(bytes: &[u8]) -> LineReader {
        LineReader::new(Path::new("test"), io::Cursor::new(bytes.to_vec()))
    }

    #[test]
    fn line_ends_and_byte_order_mark() {
        let mut r = reader(b"\xef\xbb\xbfa\r\nb\n\nc");
        let mut lines = Vec::new();
        while r.advance().unwrap() {
            lines.push(String::from_utf8(r.line().to_vec()).unwrap());
        }
        assert_eq!(lines, ["a", "b", "", "c"]);
        assert_eq!(r.number(), 4);
        assert!(!r.ended_with_newline());
    }

    #[test]
    fn an_endless_line_is_refused_in_constant_memory() {
        // 2 GB of one line, never stored: the reader stops after one mebibyte
        let mut r = LineReader::new(Path::new("big.csv"), io::repeat(b'1').take(2_000_000_000));
        let e = r.advance().unwrap_err();
        assert_eq!((e.kind(), e.line()), (ErrorKind::LineTooLong, Some(1)));
        assert!(r.line.capacity() < 4 * MAX_LINE_BYTES);
    }

    #[test]
    fn declared_encodings() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("gbk.csv");
        std::fs::write(&path, b"\xca\xb1\xbc\xe4,\xa6\xa5\n1,2\n").unwrap();
        let mut r = LineReader::open(&path, Some("gbk")).unwrap();
        assert!(r.advance().unwrap());
        assert_eq!(decode(r.line()), "\u{65f6}\u{95f4},\u{395}");
        assert!(r.advance().unwrap());
        assert_eq!(r.line(), b"1,2");
        assert!(!r.advance().unwrap());
        let e = LineReader::open(&path, Some("gbx")).err().unwrap();
        assert!(e.to_string().contains("did you mean \"gbk\""), "{e}");
        // not Shift-JIS
        std::fs::write(&path, b"\xff\xff\n").unwrap();
        let mut r = LineReader::open(&path, Some("shift_jis")).unwrap();
        assert_eq!(r.advance().unwrap_err().kind(), ErrorKind::Encoding);
        // UTF-16 says so itself
        std::fs::write(&path, b"\xff\xfea\0\t\0b\0\n\0").unwrap();
        let mut r = LineReader::open(&path, None).unwrap();
        assert!(r.advance().unwrap());
        assert_eq!(r.line(), b"a\tb");
    }

    #[test]
    fn latin_1_where_not_utf_8() {
        assert_eq!(decode(b"20 \xb0C"), "20 °C");
    }

    proptest! {
        #[test]
        fn numbers_round_as_the_standard_library_does(text in "[+-]?[0-9]{1,22}(\\.[0-9]{0,22})?([eE][+-]?[0-9]{1,3})?") {
            let expected: f64 = text.parse().unwrap();
            let (value, _) = plain_number(text.as_bytes()).unwrap();
            prop_assert_eq!(value.to_bits(), expected.to_bits());
        }

        #[test]
        fn any_double_survives(value in any::<f64>().prop_filter("finite", |v| v.is_finite())) {
            let (read, _) = plain_number(format!("{value:?}").as_bytes()).unwrap();
            prop_assert_eq!(read.to_bits(), value.to_bits());
        }

        #[test]
        fn rows_are_read_as_their_cells_are(line in "([-+0-9.,;eEN \"]|[0-9]{3}|[0-9]{4}\\.[0-9]{2}[,;]){0,60}") {
            for delimiter in [Delimiter::Comma, Delimiter::Semicolon, Delimiter::Tab, Delimiter::Spaces] {
                let mut slow = NumberColumn::new(delimiter, Notation::Dot);
                let mut fast = slow.clone();
                let mut cells = Cells::new(line.as_bytes(), delimiter);
                for cell in Cells::new(line.as_bytes(), delimiter) {
                    let expected = slow.parse(cell.bytes);
                    let found = fast.next(&mut cells).unwrap().map_err(|(trouble, at)| {
                        assert_eq!(at, cell);
                        trouble
                    });
                    prop_assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits));
                    prop_assert_eq!((fast.notation, fast.saw_dot), (slow.notation, slow.saw_dot));
                }
                prop_assert!(fast.next(&mut cells).is_none());
            }
        }

        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            for delimiter in Delimiter::ALL {
                let mut column = NumberColumn::new(delimiter, Notation::Dot);
                for cell in Cells::new(&bytes, delimiter) {
                    let _ = column.parse(cell.bytes);
                    let _ = cell.text();
                }
            }
        }
    }
}
