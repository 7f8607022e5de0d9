//! The one door to the files of this room: it opens plain files only, and remembers which, so that no result
//! is ever put onto a file that it was made of.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Every file that was opened, by its own name without links.
static OPENED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The file of some size that was opened last, by a handle that moves along with its reader; its length, and
/// when it was opened.
static LARGE: Mutex<Option<(File, u64, Instant)>> = Mutex::new(None);

/// A file of some size, bytes.
const SOME_SIZE: u64 = 8 << 20;

/// How far the reader of the file of some size that was opened last is in it, 0 to 1, and how long it took
/// so far; `None` where there is none, or it is through.
#[must_use]
pub fn share_read() -> Option<(f64, Duration)> {
    let mut large = LARGE.lock().unwrap_or_else(PoisonError::into_inner);
    let (file, length, since) = large.as_mut()?;
    let share = file.stream_position().ok()? as f64 / *length as f64;
    let took = since.elapsed();
    if share >= 1.0 {
        *large = None;
        return None;
    }
    Some((share, took))
}

/// Opens a plain file for reading. A pipe or a device could keep a reader waiting for ever, and cannot be
/// read twice: the importers look at a file first and read it then.
///
/// # Errors
/// What the file system says; `IsADirectory` for a folder, `InvalidInput` for a pipe, a socket or a device.
pub fn open(path: &Path) -> io::Result<File> {
    let meta = fs::metadata(path)?;
    if meta.is_dir() {
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if !meta.is_file() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "it is a pipe or a device; save its content as a file and name that",
        ));
    }
    let file = File::open(path)?;
    let own = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    OPENED
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .insert(own);
    if meta.len() >= SOME_SIZE {
        let handle = file.try_clone().ok();
        let handle = handle.map(|f| (f, meta.len(), Instant::now()));
        *LARGE.lock().unwrap_or_else(PoisonError::into_inner) = handle;
    }
    Ok(file)
}

/// Opens a text file for reading, unpacked where it is gzipped.
///
/// # Errors
/// As [`open`].
pub fn text(path: &Path) -> io::Result<Box<dyn Read>> {
    let mut file = open(path)?;
    let mut mark = Vec::with_capacity(2);
    file.by_ref().take(2).read_to_end(&mut mark)?;
    let gzipped = mark == [0x1f, 0x8b];
    let bytes = io::Cursor::new(mark).chain(file);
    Ok(if gzipped {
        Box::new(flate2::read::MultiGzDecoder::new(bytes))
    } else {
        Box::new(bytes)
    })
}

/// Whether this process has opened that file, under this name or another one that leads there.
#[must_use]
pub fn was_opened(path: &Path) -> bool {
    let Ok(own) = fs::canonicalize(path) else {
        return false;
    };
    OPENED
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .contains(&own)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_opened_is_known_by_any_name() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a");
        fs::write(&file, b"1").unwrap();
        assert!(!was_opened(&file));
        open(&file).unwrap();
        assert!(was_opened(&dir.path().join("./a")));
        assert!(!was_opened(&dir.path().join("b")));
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&file, dir.path().join("link")).unwrap();
            assert!(was_opened(&dir.path().join("link")));
        }
        assert_eq!(
            open(dir.path()).unwrap_err().kind(),
            io::ErrorKind::IsADirectory
        );
    }

    #[test]
    fn a_text_may_be_gzipped() {
        use std::io::Write as _;
        let dir = tempfile::tempdir().unwrap();
        let (plain, packed) = (dir.path().join("a.csv"), dir.path().join("a.csv.gz"));
        let words = "t,x\n0,1\n1,2\n".repeat(40_000);
        fs::write(&plain, &words).unwrap();
        let file = File::create(&packed).unwrap();
        let mut gz = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
        gz.write_all(words.as_bytes()).unwrap();
        gz.finish().unwrap();
        for path in [plain, packed] {
            let mut read = String::new();
            text(&path).unwrap().read_to_string(&mut read).unwrap();
            assert_eq!(read, words);
        }
    }

    #[test]
    fn it_is_told_how_far_a_large_file_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("large");
        fs::write(&path, vec![b'1'; SOME_SIZE as usize]).unwrap();
        let mut file = open(&path).unwrap();
        file.by_ref()
            .take(SOME_SIZE / 4)
            .read_to_end(&mut Vec::new())
            .unwrap();
        assert_eq!(share_read().unwrap().0, 0.25);
        file.read_to_end(&mut Vec::new()).unwrap();
        assert!(share_read().is_none());
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_refused() {
        let error = open(Path::new("/dev/null")).unwrap_err();
        assert!(error.to_string().contains("pipe or a device"), "{error}");
    }
}
