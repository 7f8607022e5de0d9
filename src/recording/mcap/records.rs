//! The records of an MCAP file, one after the other, chunks opened.
//!
//! ```text
//! file   := MAGIC record* MAGIC        MAGIC = 89 "MCAP0" 0D 0A
//! record := opcode u8, length u64, body
//! chunk  := start u64, end u64, uncompressed size u64, CRC u32, compression, records
//! ```
//!
//! Nothing but the current record is held, and no length field is believed: a buffer grows as bytes arrive,
//! and a record longer than [`MAX_RECORD_BYTES`] is passed over. Read in order, without the index at the end,
//! so that a file that was cut gives all messages before the cut.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::recording::error::{Error, ErrorKind, quote};
use crate::recording::text::decode;

/// The longest record that is held in memory; longer ones (images, attachments) are passed over and counted.
pub const MAX_RECORD_BYTES: u64 = 64 << 20;

/// How much is read at a time.
const BLOCK: usize = 256 << 10;

/// What compressed chunks may unpack to: any file to 256 MiB, and 256 times its size. Messages carry their
/// own times, so that even those of a channel that stands still do not pack to less than about a fiftieth; a
/// file that says more is made to keep its reader busy.
const UNPACKED_BYTES: u64 = 256 << 20;
const RATIO: u64 = 256;

const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Opcodes that are looked at here; the others are handed on.
pub(super) mod op {
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const STATISTICS: u8 = 0x0b;
    pub const DATA_END: u8 = 0x0f;
}

/// A range of a file, read by its own position.
struct Part {
    file: Arc<File>,
    at: u64,
    end: u64,
}

impl Read for Part {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let most = usize::try_from(self.end - self.at).unwrap_or(usize::MAX);
        let most = most.min(out.len());
        if most == 0 {
            return Ok(0);
        }
        (&*self.file).seek(SeekFrom::Start(self.at))?;
        let read = (&*self.file).read(&mut out[..most])?;
        self.at += read as u64;
        Ok(read)
    }
}

/// A buffer over a reader from which records are cut.
struct Window<R> {
    inner: R,
    buffer: Vec<u8>,
    from: usize,
    to: usize,
    /// Checksum of what was taken, up to `hashed`: small pieces are added together.
    hasher: Option<crc32fast::Hasher>,
    hashed: usize,
}

impl<R: Read> Window<R> {
    fn new(inner: R, hash: bool) -> Self {
        Window {
            inner,
            buffer: vec![0; BLOCK],
            from: 0,
            to: 0,
            hasher: hash.then(crc32fast::Hasher::new),
            hashed: 0,
        }
    }

    /// Begins a checksum here.
    fn begin_checksum(&mut self) {
        self.hasher = Some(crc32fast::Hasher::new());
        self.hashed = self.from;
    }

    /// The checksum of what was taken since it began.
    fn checksum(&mut self) -> Option<u32> {
        self.hash();
        self.hasher.take().map(crc32fast::Hasher::finalize)
    }

    fn hash(&mut self) {
        if let Some(hasher) = &mut self.hasher {
            hasher.update(&self.buffer[self.hashed..self.from]);
        }
        self.hashed = self.from;
    }

    /// Whether `count` bytes are there; reads until they are or nothing more comes.
    fn fill(&mut self, count: usize) -> io::Result<bool> {
        while self.to - self.from < count {
            if self.from > 0 && self.buffer.len() - self.from < count.max(BLOCK / 2) {
                self.hash();
                self.buffer.copy_within(self.from..self.to, 0);
                self.to -= self.from;
                self.from = 0;
                self.hashed = 0;
            }
            if self.to == self.buffer.len() {
                // what is full is doubled: bytes that arrived, not bytes that were promised
                self.buffer.resize(2 * self.to.max(BLOCK / 2), 0);
            }
            let read = self.inner.read(&mut self.buffer[self.to..])?;
            if read == 0 {
                return Ok(false);
            }
            self.to += read;
        }
        Ok(true)
    }

    fn held(&self) -> &[u8] {
        &self.buffer[self.from..self.to]
    }

    /// Takes bytes that [`Window::fill`] found.
    fn take(&mut self, count: usize) -> &[u8] {
        let bytes = &self.buffer[self.from..self.from + count];
        self.from += count;
        bytes
    }

    /// Passes over bytes, up to the end of what is there; how many there were.
    fn skip(&mut self, mut count: u64) -> io::Result<u64> {
        let wanted = count;
        while count > 0 {
            if !self.fill(1)? {
                return Ok(wanted - count);
            }
            let here = usize::try_from(count).unwrap_or(usize::MAX);
            let here = here.min(self.to - self.from);
            self.take(here);
            count -= here as u64;
        }
        Ok(wanted)
    }
}

/// Where the records come from inside a chunk.
enum Source {
    /// From the file itself.
    Plain,
    /// Through a decompressor.
    Packed(Window<Box<dyn Read>>),
}

struct Chunk {
    source: Source,
    /// Bytes of records that are left; `u64::MAX` where the writer did not come to say.
    left: u64,
    /// Where the chunk's record ends in the file.
    end: u64,
    /// Where it began.
    begin: u64,
    crc: u32,
    /// Whether its end lies behind the end of the file.
    cut: bool,
}

/// One record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Record<'a> {
    /// What it is.
    pub opcode: u8,
    /// Its content.
    pub body: &'a [u8],
}

/// Reads records one after the other.
pub struct RecordReader {
    path: PathBuf,
    file: Window<Part>,
    size: u64,
    /// Position of the next byte of the file that is not in a decompressor.
    at: u64,
    chunk: Option<Chunk>,
    footer: bool,
    ended: bool,
    cut: Option<String>,
    passed_over: u64,
    chunks: u64,
    /// Bytes that compressed chunks may still unpack to.
    unpacked_left: u64,
}

impl RecordReader {
    /// Opens a file and checks how it begins.
    ///
    /// # Errors
    /// The file cannot be read, or does not begin as MCAP does.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let file = super::super::opened::open(path).map_err(|e| Error::io(path, e))?;
        let size = file.metadata().map_err(|e| Error::io(path, e))?.len();
        let part = Part {
            file: Arc::new(file),
            at: 0,
            end: size,
        };
        let mut file = Window::new(part, false);
        let whole = file.fill(MAGIC.len()).map_err(|e| Error::io(path, e))?;
        if !whole || !file.held().starts_with(MAGIC) {
            let wrong = Error::new(
                ErrorKind::Grammar,
                path,
                "does not begin with the eight bytes of MCAP",
            );
            let mangled = file.held().starts_with(b"\x89MCAP0\n");
            return Err(if mangled {
                wrong.expected("0D 0A after \"MCAP0\", found 0A alone").action(
                    "line ends were converted as if it were text (a version control system does); get the file again as binary",
                )
            } else {
                wrong.action("check that this is the recorder's file")
            });
        }
        file.take(MAGIC.len());
        Ok(RecordReader {
            path: path.to_owned(),
            file,
            size,
            at: MAGIC.len() as u64,
            chunk: None,
            footer: false,
            ended: false,
            cut: None,
            passed_over: 0,
            chunks: 0,
            unpacked_left: UNPACKED_BYTES + size.saturating_mul(RATIO),
        })
    }

    /// Why the records end before the file says so: it was cut. Known when they have ended.
    #[must_use]
    pub fn cut(&self) -> Option<&str> {
        self.cut.as_deref()
    }

    /// Records that are longer than [`MAX_RECORD_BYTES`] and were passed over.
    #[must_use]
    pub fn passed_over(&self) -> u64 {
        self.passed_over
    }

    /// Chunks so far.
    #[must_use]
    pub fn chunks(&self) -> u64 {
        self.chunks
    }

    fn io(&self, error: io::Error) -> Error {
        Error::io(&self.path, error)
    }

    fn damaged(&self, begin: u64, what: &str) -> Error {
        Error::new(
            ErrorKind::Grammar,
            &self.path,
            format!("the chunk at byte {begin} is damaged: {what}"),
        )
        .action("copy the file again; `mcap recover` saves the other chunks")
    }

    fn stop(&mut self, why: impl Into<String>) {
        self.ended = true;
        self.cut = Some(why.into());
    }

    /// The next record, chunks themselves left out; `None` at the end, or where the file was cut.
    ///
    /// # Errors
    /// A chunk that is damaged, a compression that is not known, a file that cannot be read.
    pub fn advance(&mut self) -> Result<Option<Record<'_>>, Error> {
        while !self.ended {
            let found = if self.chunk.is_some() {
                self.inside()?
            } else {
                self.outside()?
            };
            if let Some((opcode, length)) = found {
                let body = match &mut self.chunk {
                    Some(Chunk {
                        source: Source::Packed(window),
                        ..
                    }) => window.take(length),
                    _ => {
                        self.at += length as u64;
                        self.file.take(length)
                    }
                };
                return Ok(Some(Record { opcode, body }));
            }
        }
        Ok(None)
    }

    /// A record at the top of the file: its opcode and length, its body at hand. `None`: look again.
    fn outside(&mut self) -> Result<Option<(u8, usize)>, Error> {
        if self.footer {
            self.ended = true;
            let magic = self.file.fill(MAGIC.len());
            if !magic.map_err(|e| self.io(e))? || !self.file.held().starts_with(MAGIC) {
                self.cut = Some("its last bytes are missing".to_owned());
            }
            return Ok(None);
        }
        if !self.file.fill(9).map_err(|e| self.io(e))? {
            self.stop(format!("it ends at byte {} without a footer", self.size));
            return Ok(None);
        }
        let head = self.file.take(9);
        let (opcode, length) = (head[0], u64_at(head, 1));
        let begin = self.at;
        self.at += 9;
        if opcode == 0 {
            self.stop(format!("there is no record at byte {begin}"));
            return Ok(None);
        }
        if opcode == op::CHUNK {
            return self.open_chunk(begin, length).map(|()| None);
        }
        let left = self.size - self.at;
        if length > left {
            self.stop(format!(
                "the record at byte {begin} says {length} bytes and {left} are left"
            ));
            return Ok(None);
        }
        if length > MAX_RECORD_BYTES {
            self.passed_over += 1;
            self.seek(self.at + length);
            return Ok(None);
        }
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        if !self.file.fill(length).map_err(|e| self.io(e))? {
            self.stop(format!("the record at byte {begin} is cut"));
            return Ok(None);
        }
        self.footer = opcode == op::FOOTER;
        Ok(Some((opcode, length)))
    }

    /// Goes on at a byte of the file.
    fn seek(&mut self, to: u64) {
        let held = self.file.held().len() as u64;
        if to >= self.at && to - self.at <= held {
            let step = usize::try_from(to - self.at).unwrap_or(0);
            self.file.take(step);
        } else {
            self.file.from = 0;
            self.file.to = 0;
            self.file.hashed = 0;
            self.file.inner.at = to.min(self.size);
        }
        self.at = to;
    }

    fn open_chunk(&mut self, begin: u64, length: u64) -> Result<(), Error> {
        self.chunks += 1;
        let left = self.size - self.at;
        let cut = length > left;
        let end = self.at + length.min(left);
        let header_is_whole = self.file.fill(32).map_err(|e| self.io(e))?;
        if !header_is_whole || end - self.at < 32 {
            self.stop(format!("the chunk at byte {begin} is cut in its header"));
            return Ok(());
        }
        let head = self.file.take(32);
        let (uncompressed, crc) = (u64_at(head, 16), u32_at(head, 24));
        let name_length = u64::from(u32_at(head, 28));
        self.at += 32;
        if name_length > 64 {
            return Err(self.damaged(begin, "the name of its compression is too long"));
        }
        let name_bytes = usize::try_from(name_length).unwrap_or(0);
        if !self.file.fill(name_bytes + 8).map_err(|e| self.io(e))?
            || end - self.at < name_length + 8
        {
            self.stop(format!("the chunk at byte {begin} is cut in its header"));
            return Ok(());
        }
        let name = decode(self.file.take(name_bytes)).into_owned();
        let declared = u64_at(self.file.take(8), 0);
        self.at += name_length + 8;
        let packed = declared.min(end - self.at);
        if declared > end - self.at && !cut {
            return Err(self.damaged(begin, "it says more bytes than it has"));
        }
        // a writer that did not come to close the chunk left its sizes open
        let unknown = length == u64::MAX;
        let packs = !name.is_empty();
        if packs && !unknown && uncompressed > self.unpacked_left {
            let text = format!(
                "its {packed} bytes unpack to {uncompressed}, more than {RATIO} times the file, as no recording does"
            );
            return Err(self.damaged(begin, &text));
        }
        let records = if unknown {
            self.unpacked_left
        } else {
            uncompressed
        };
        if packs && !unknown {
            self.unpacked_left -= uncompressed;
        }
        let source = match name.as_str() {
            "" => Source::Plain,
            "zstd" | "lz4" => {
                let part = Part {
                    file: Arc::clone(&self.file.inner.file),
                    at: self.at,
                    end: self.at + packed,
                };
                let reader: io::Result<Box<dyn Read>> = if name == "zstd" {
                    zstd::stream::read::Decoder::new(part)
                        .map(|d| Box::new(d.single_frame()) as Box<dyn Read>)
                } else {
                    lz4::Decoder::new(io::BufReader::with_capacity(BLOCK, part))
                        .map(|d| Box::new(d) as Box<dyn Read>)
                };
                let reader = reader.map_err(|e| self.damaged(begin, &e.to_string()))?;
                Source::Packed(Window::new(reader, crc != 0))
            }
            other => {
                return Err(Error::new(
                    ErrorKind::Grammar,
                    &self.path,
                    format!(
                        "the chunk at byte {begin} is compressed with {}",
                        quote(other)
                    ),
                )
                .expected("zstd, lz4 or none")
                .action("write the file again with `mcap compress`"));
            }
        };
        let left = match source {
            Source::Plain => packed,
            Source::Packed(_) => records,
        };
        if matches!(source, Source::Plain) && crc != 0 {
            self.file.begin_checksum();
        }
        self.chunk = Some(Chunk {
            source,
            left,
            end,
            begin,
            crc,
            cut,
        });
        Ok(())
    }

    /// A record inside a chunk. `None`: look again (the chunk has ended, or a record was passed over).
    fn inside(&mut self) -> Result<Option<(u8, usize)>, Error> {
        let Some(chunk) = &mut self.chunk else {
            return Ok(None);
        };
        if chunk.left < 9 {
            return self.close_chunk().map(|()| None);
        }
        let found = match &mut chunk.source {
            Source::Plain => next_in(&mut self.file, &mut chunk.left, &mut self.passed_over),
            Source::Packed(window) => next_in(window, &mut chunk.left, &mut self.passed_over),
        };
        let (begin, cut) = (chunk.begin, chunk.cut);
        let plain = matches!(chunk.source, Source::Plain);
        match found {
            Ok(Next::Record {
                opcode,
                length,
                used,
            }) => {
                if plain {
                    self.at += used;
                }
                Ok(Some((opcode, length)))
            }
            Ok(Next::PassedOver { used }) => {
                if plain {
                    self.at += used;
                }
                Ok(None)
            }
            // the end of a file that was cut, and of the bytes that a decompressor had
            Ok(Next::End) | Err(_) if cut => {
                self.stop(format!("the chunk at byte {begin} is cut"));
                Ok(None)
            }
            Ok(Next::End) => Err(self.damaged(begin, "its records end early")),
            Err(e) => Err(self.damaged(begin, &e.to_string())),
        }
    }

    fn close_chunk(&mut self) -> Result<(), Error> {
        let Some(mut chunk) = self.chunk.take() else {
            return Ok(());
        };
        let checksum = match &mut chunk.source {
            Source::Plain => {
                let rest = usize::try_from(chunk.left).unwrap_or(0);
                if self.file.fill(rest).map_err(|e| self.io(e))? {
                    self.file.take(rest);
                    self.at += rest as u64;
                }
                self.file.checksum()
            }
            Source::Packed(window) => {
                let _ = window.skip(chunk.left);
                window.checksum()
            }
        };
        if chunk.cut {
            self.stop(format!("the chunk at byte {} is cut", chunk.begin));
            return Ok(());
        }
        if chunk.crc != 0 && checksum.is_some_and(|c| c != chunk.crc) {
            return Err(self.damaged(chunk.begin, "its checksum is wrong"));
        }
        self.seek(chunk.end);
        Ok(())
    }
}

enum Next {
    Record {
        opcode: u8,
        length: usize,
        /// Bytes before the body.
        used: u64,
    },
    PassedOver {
        used: u64,
    },
    End,
}

fn next_in<R: Read>(
    window: &mut Window<R>,
    left: &mut u64,
    passed_over: &mut u64,
) -> io::Result<Next> {
    if !window.fill(9)? {
        return Ok(Next::End);
    }
    let head = window.held();
    let (opcode, length) = (head[0], u64_at(head, 1));
    if length > *left - 9 {
        return Ok(Next::End);
    }
    if length > MAX_RECORD_BYTES {
        window.take(9);
        *passed_over += 1;
        *left -= 9 + length;
        let used = window.skip(length)?;
        return Ok(if used == length {
            Next::PassedOver { used: 9 + used }
        } else {
            Next::End
        });
    }
    let body = usize::try_from(length).unwrap_or(usize::MAX);
    if !window.fill(9 + body)? {
        return Ok(Next::End);
    }
    window.take(9);
    *left -= 9 + length;
    Ok(Next::Record {
        opcode,
        length: body,
        used: 9,
    })
}

/// A u16 at a place that is there.
pub(super) fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

/// A u32 at a place that is there.
pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    let mut out = [0; 4];
    out.copy_from_slice(&bytes[at..at + 4]);
    u32::from_le_bytes(out)
}

/// A u64 at a place that is there.
pub(super) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut out = [0; 8];
    out.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(out)
}
