//! A long run that can be taken up again: what is done is written down piece by piece, in a file beside the
//! results, until they are there.
//!
//! The first line says of what run the pieces are; every other line is a piece: its name, what it says in
//! words, and its bytes. A line that was cut off counts as not written, and of several pieces of one name the
//! last one counts. A piece comes back to the very bits, so that a run that was stopped gives the same files.
//!
//! [`Pieces`] are written from the first one on. A [`Lasting`] run has its searches in mind and begins to
//! write only when it has lasted a while.

use std::collections::HashMap;
use std::fs::{self, File, TryLockError};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Failure, stop};
use crate::fit::memory::{Keep, Memory};
use crate::report::output::{OutputError, Overwrite};
use crate::report::provenance::Provenance;

/// What the pieces are of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Run {
    /// The program, to the byte: another build may come to other results.
    pub program: String,
    /// The arguments that the results depend on.
    pub of: String,
}

impl Run {
    /// A run of this program.
    pub(super) fn new(of: String) -> Self {
        let own = std::env::current_exe().and_then(File::open);
        let sum = own
            .and_then(crate::recording::sha256_of)
            .unwrap_or_default();
        Run {
            program: format!(concat!("deacal ", env!("CARGO_PKG_VERSION"), " {}"), sum),
            of,
        }
    }
}

#[derive(Serialize, Deserialize)]
struct Line {
    name: String,
    says: String,
    bytes: String,
}

/// The pieces of a run.
pub(super) struct Pieces {
    path: PathBuf,
    run: Run,
    known: HashMap<String, String>,
    file: Mutex<File>,
}

impl Pieces {
    /// Opens the pieces of `run` at `path`, or begins them. Those of another run are an error, unless
    /// anything may be overwritten.
    pub(super) fn open(path: &Path, run: &Run, overwrite: Overwrite) -> Result<Self, Failure> {
        let io = |e| OutputError::io(path, e);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|e| OutputError::io(folder, e))?;
        }
        let mut file = File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path)
            .map_err(io)?;
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            return Err(format!(
                "{}: another deacal is at this run; wait for it to end, or write elsewhere with -o",
                path.display()
            )
            .into());
        }
        let mut text = String::new();
        // what is no text is nothing of this program's
        let read = file.read_to_string(&mut text);
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let mut lines = whole.lines();
        let first: Option<Run> = lines.next().and_then(|l| serde_json::from_str(l).ok());
        let begun = first.as_ref() == Some(run);
        if !begun && (read.is_err() || !text.is_empty()) && overwrite == Overwrite::Own {
            let path = path.display();
            let why = match first {
                None => "is no beginning of a run of this program".to_owned(),
                Some(other) if other.of == run.of => {
                    "holds the beginning of this run by another build of the program".to_owned()
                }
                Some(other) => format!("holds the beginning of another run ({})", other.of),
            };
            return Err(format!(
                "{path}: {why}; end that first, write elsewhere with -o, or drop it with --force"
            )
            .into());
        }
        let mut known = HashMap::new();
        if begun {
            for line in lines {
                if let Ok(line) = serde_json::from_str::<Line>(line) {
                    known.insert(line.name, line.bytes);
                }
            }
            file.set_len(whole.len() as u64).map_err(io)?;
            file.seek(SeekFrom::End(0)).map_err(io)?;
        } else {
            file.set_len(0).map_err(io)?;
            file.seek(SeekFrom::Start(0)).map_err(io)?;
            append(&mut file, run).map_err(io)?;
        }
        Ok(Pieces {
            path: path.to_owned(),
            run: run.clone(),
            known,
            file: Mutex::new(file),
        })
    }

    /// What they are of.
    pub(super) fn run(&self) -> &Run {
        &self.run
    }

    /// Where they are.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// A piece that an earlier run wrote down.
    pub(super) fn get<T: DeserializeOwned>(&self, name: &str) -> Option<T> {
        postcard::from_bytes(&self.bytes(name)?).ok()
    }

    /// The bytes of such a piece.
    fn bytes(&self, name: &str) -> Option<Vec<u8>> {
        from_hex(self.known.get(name)?)
    }

    /// Writes a piece down.
    pub(super) fn add(
        &self,
        name: &str,
        says: String,
        piece: &impl Serialize,
    ) -> Result<(), Failure> {
        self.add_bytes(name, says, &postcard::to_allocvec(piece)?)
    }

    /// Writes the bytes of a piece down.
    fn add_bytes(&self, name: &str, says: String, bytes: &[u8]) -> Result<(), Failure> {
        let line = Line {
            name: name.to_owned(),
            says,
            bytes: bytes.iter().map(|b| format!("{b:02x}")).collect(),
        };
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        append(&mut file, &line).map_err(|e| OutputError::io(&self.path, e))?;
        Ok(())
    }

    /// The results are in place: the pieces have done their work.
    pub(super) fn done(self) -> Result<(), Failure> {
        fs::remove_file(&self.path).map_err(|e| OutputError::io(&self.path, e))?;
        Ok(())
    }
}

/// How long a run has lasted before it is written down.
const A_WHILE: Duration = Duration::from_secs(3);

/// A run whose searches go on where they were stopped, if it lasts. What is kept is a help and no result:
/// where it cannot be written, or another run is at it, this one goes on without.
pub(super) struct Lasting {
    path: PathBuf,
    of: String,
    begun: Instant,
    kept: Mutex<Kept>,
}

/// Where the pieces of a lasting run are.
enum Kept {
    /// In mind: names, words, bytes.
    InMind(HashMap<String, (String, Vec<u8>)>),
    Written(Pieces),
    Nowhere,
}

impl Lasting {
    /// A run of a command on files, with its results in `folder`. Takes up what is kept there of the same
    /// run; what is kept of another one has lost its use.
    pub(super) fn new(folder: &Path, provenance: &Provenance) -> Arc<Self> {
        let inputs = crate::report::json::to_text(provenance);
        let inputs = crate::recording::sha256_of(inputs.as_bytes()).unwrap_or_default();
        let of = format!("{}, inputs {inputs}", provenance.command);
        let path = folder.join("searches.part.jsonl");
        let kept = match path.exists() {
            true => Self::write(&path, &of),
            false => Kept::InMind(HashMap::new()),
        };
        let lasting = Lasting {
            path,
            of,
            begun: Instant::now(),
            kept: Mutex::new(kept),
        };
        if matches!(&*lasting.lock(), Kept::Written(_)) {
            lasting.say();
        }
        Arc::new(lasting)
    }

    /// What the searches of this run are to remember.
    pub(super) fn memory(self: &Arc<Self>) -> Memory {
        Memory::new(Arc::<Self>::clone(self))
    }

    /// The results are in place: what is kept has done its work.
    pub(super) fn done(&self) -> Result<(), Failure> {
        match std::mem::replace(&mut *self.lock(), Kept::Nowhere) {
            Kept::Written(pieces) => pieces.done(),
            Kept::InMind(_) | Kept::Nowhere => Ok(()),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn say(&self) {
        stop::instead(format!(
            "what its searches found is kept in {}: the same command goes on from there",
            self.path.display()
        ));
    }

    /// The pieces on disk.
    fn write(path: &Path, of: &str) -> Kept {
        let ours = || {
            let mut first = String::new();
            let file = BufReader::new(File::open(path).ok()?);
            file.take(1 << 20).read_line(&mut first).ok()?;
            serde_json::from_str::<Run>(&first).ok()
        };
        // a file of anybody else's stays
        let overwrite = match ours() {
            Some(_) => Overwrite::Any,
            None => Overwrite::Own,
        };
        Pieces::open(path, &Run::new(of.to_owned()), overwrite).map_or(Kept::Nowhere, Kept::Written)
    }
}

impl Keep for Lasting {
    fn get(&self, name: &str) -> Option<Vec<u8>> {
        match &*self.lock() {
            Kept::Written(pieces) => pieces.bytes(name),
            Kept::InMind(_) | Kept::Nowhere => None,
        }
    }

    fn put(&self, name: &str, says: String, bytes: Vec<u8>) {
        let mut kept = self.lock();
        if let Kept::InMind(known) = &mut *kept {
            known.insert(name.to_owned(), (says, bytes));
            if self.begun.elapsed() < A_WHILE {
                return;
            }
            let known = std::mem::take(known);
            *kept = Self::write(&self.path, &self.of);
            // said before the pieces are synced one by one: whoever stops it meanwhile hears of those that
            // are
            if matches!(*kept, Kept::Written(_)) {
                self.say();
            }
            for (name, (says, bytes)) in known {
                Self::add(&mut kept, &name, says, &bytes);
            }
            return;
        }
        Self::add(&mut kept, name, says, &bytes);
    }
}

impl Lasting {
    /// Writes a piece down, as long as that works.
    fn add(kept: &mut Kept, name: &str, says: String, bytes: &[u8]) {
        if let Kept::Written(pieces) = kept
            && pieces.add_bytes(name, says, bytes).is_err()
        {
            *kept = Kept::Nowhere;
        }
    }
}

/// Bytes from their hexadecimal digits.
pub(super) fn from_hex(text: &str) -> Option<Vec<u8>> {
    let pairs = text.as_bytes().chunks(2);
    pairs
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok())
        .collect()
}

fn append(file: &mut File, line: &impl Serialize) -> std::io::Result<()> {
    let mut text = serde_json::to_string(line)?;
    text.push('\n');
    file.write_all(text.as_bytes())?;
    file.sync_data()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_come_back_to_the_bit_and_a_cut_line_is_not_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("new/run.part");
        let run = Run::new("a".into());
        let pieces = Pieces::open(&path, &run, Overwrite::Own).unwrap();
        let one = (f64::NAN, f64::NEG_INFINITY, 0.1 + 0.2, Some(-0.0));
        pieces.add("one", "a word".into(), &one).unwrap();
        pieces.add("two", String::new(), &one).unwrap();
        let text = Pieces::open(&path, &run, Overwrite::Own)
            .err()
            .unwrap()
            .to_string();
        assert!(text.contains("another deacal"), "{text}");
        drop(pieces);
        let length = fs::metadata(&path).unwrap().len();
        File::options()
            .write(true)
            .open(&path)
            .and_then(|f| f.set_len(length - 5))
            .unwrap();
        let pieces = Pieces::open(&path, &run, Overwrite::Own).unwrap();
        let back: (f64, f64, f64, Option<f64>) = pieces.get("one").unwrap();
        let bits =
            |p: &(f64, f64, f64, Option<f64>)| [p.0, p.1, p.2, p.3.unwrap()].map(f64::to_bits);
        assert_eq!(bits(&back), bits(&one));
        assert!(pieces.get::<(f64, f64, f64, Option<f64>)>("two").is_none());
        pieces.add("two", String::new(), &one).unwrap();
        drop(pieces);
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text.lines().count(), 3, "{text}");
    }

    #[test]
    fn the_beginning_of_another_run_stays_unless_forced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.part");
        drop(Pieces::open(&path, &Run::new("a".into()), Overwrite::Own).unwrap());
        let other = Run::new("b".into());
        let text = Pieces::open(&path, &other, Overwrite::Own)
            .err()
            .unwrap()
            .to_string();
        assert!(
            text.contains("another run (a)") && text.contains("--force"),
            "{text}"
        );
        Pieces::open(&path, &other, Overwrite::Any)
            .unwrap()
            .done()
            .unwrap();
        assert!(!path.exists());
        fs::write(&path, b"\xff\xfe mine").unwrap();
        assert!(Pieces::open(&path, &other, Overwrite::Own).is_err());
        assert_eq!(fs::read(&path).unwrap(), b"\xff\xfe mine");
    }
}
