//! A long run that can be taken up again: what is done is written down piece by piece, in a file beside the
//! results, until they are there.
//!
//! The first line says of what run the pieces are; every other line is a piece: its name, what it says in
//! words, and its bytes. A line that was cut off counts as not written. A piece comes back to the very bits,
//! so that a run that was stopped gives the same files.

use std::collections::HashMap;
use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::Failure;
use crate::report::output::{OutputError, Overwrite};

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
            known,
            file: Mutex::new(file),
        })
    }

    /// Where they are.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// A piece that an earlier run wrote down.
    pub(super) fn get<T: DeserializeOwned>(&self, name: &str) -> Option<T> {
        let hex = self.known.get(name)?.as_bytes().chunks(2);
        let bytes: Option<Vec<u8>> = hex
            .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok())
            .collect();
        postcard::from_bytes(&bytes?).ok()
    }

    /// Writes a piece down.
    pub(super) fn add(
        &self,
        name: &str,
        says: String,
        piece: &impl Serialize,
    ) -> Result<(), Failure> {
        let bytes = postcard::to_allocvec(piece)?;
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
