//! Files that are there whole or not at all.
//!
//! An [`OutputSet`] holds the files of one command. Each is written to a temporary file in the folder where it will be,
//! flushed and synced; [`OutputSet::commit`] renames them into place when all are complete. Without a commit the
//! temporaries go, and so do folders that the set made and that are empty; files of an earlier run stay as they were.
//! [`write_atomic`] does the same for a single file.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Component, Path, PathBuf};

use tempfile::NamedTempFile;

/// What kept a file from being written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// No room on the disk, or a quota is used up.
    DiskFull,
    /// The right to write is missing.
    NoPermission,
    /// The file system is mounted read-only.
    ReadOnly,
    /// A folder is asked for where a file is.
    NotAFolder,
    /// A file is asked for where a folder is.
    IsAFolder,
    /// A name that cannot be a file's here: empty, with `..`, or too long.
    BadName,
    /// Anything else that the file system said.
    Other,
}

/// A file that could not be written: which, why, and what to do, in one line.
#[derive(Debug, thiserror::Error)]
#[error("{}: {}{}", path.display(), what, Action(action))]
pub struct OutputError {
    /// The file or folder.
    pub path: PathBuf,
    /// Why.
    pub cause: Cause,
    /// Why, in words.
    pub what: String,
    /// What to do; may be empty.
    pub action: &'static str,
    /// What the file system said.
    #[source]
    pub source: Option<io::Error>,
}

struct Action<'a>(&'a str);

impl fmt::Display for Action<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            return Ok(());
        }
        write!(f, "; {}", self.0)
    }
}

impl OutputError {
    fn new(path: &Path, cause: Cause, what: impl Into<String>, action: &'static str) -> Self {
        OutputError {
            path: path.to_owned(),
            cause,
            what: what.into(),
            action,
            source: None,
        }
    }

    /// The error for what the file system said about `path`.
    #[must_use]
    pub fn io(path: &Path, error: io::Error) -> Self {
        use io::ErrorKind as K;
        let (cause, what, action) = match error.kind() {
            K::StorageFull | K::QuotaExceeded | K::FileTooLarge => (
                Cause::DiskFull,
                "cannot be written, the disk is full".to_owned(),
                "free some space, or write elsewhere with -o; files of an earlier run were left as they were",
            ),
            K::PermissionDenied => (
                Cause::NoPermission,
                "may not be written (permission denied)".to_owned(),
                "give yourself the right to write there, or write elsewhere with -o",
            ),
            K::ReadOnlyFilesystem => (
                Cause::ReadOnly,
                "cannot be written, the file system is read-only".to_owned(),
                "write elsewhere with -o",
            ),
            K::NotADirectory => (
                Cause::NotAFolder,
                "cannot be written, a part of this path is a file and not a folder".to_owned(),
                "name another place with -o, or move that file away",
            ),
            K::IsADirectory => (
                Cause::IsAFolder,
                "is a folder, and a file is to be written".to_owned(),
                "name a file",
            ),
            K::InvalidFilename => (
                Cause::BadName,
                "cannot be a file's name here".to_owned(),
                "use a shorter name, or one without special characters",
            ),
            _ => (Cause::Other, format!("cannot be written: {error}"), ""),
        };
        OutputError {
            source: Some(error),
            ..OutputError::new(path, cause, what, action)
        }
    }
}

/// What can be written to and sought in.
pub trait WriteSeek: Write + Seek {}
impl<T: Write + Seek> WriteSeek for T {}

/// One file that is complete and not yet in place.
#[derive(Debug)]
struct Staged {
    target: PathBuf,
    file: NamedTempFile,
}

/// The files of one command.
#[derive(Debug)]
pub struct OutputSet {
    dir: PathBuf,
    staged: Vec<Staged>,
    /// Folders that this set made, outer ones first.
    made: Vec<PathBuf>,
    committed: bool,
}

impl OutputSet {
    /// Files below `dir`, which is made if it is not there.
    ///
    /// # Errors
    /// `dir` is a file, or cannot be made.
    pub fn new(dir: impl Into<PathBuf>) -> Result<Self, OutputError> {
        let mut set = OutputSet {
            dir: dir.into(),
            staged: Vec::new(),
            made: Vec::new(),
            committed: false,
        };
        let dir = set.dir.clone();
        make_folders(&dir, &mut set.made)?;
        Ok(set)
    }

    /// The folder.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Writes a whole file. `name` is relative to the folder; a `/` in it makes a folder.
    ///
    /// # Errors
    /// The name leads out of the folder or is taken by another file of this set; the file cannot be written.
    pub fn write(&mut self, name: &str, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
        self.write_with(name, |w| w.write_all(bytes.as_ref()))
    }

    /// Writes a file by a function that is given a buffered writer.
    ///
    /// # Errors
    /// As [`OutputSet::write`]; an error of the function counts as one of the file.
    pub fn write_with(
        &mut self,
        name: &str,
        write: impl FnOnce(&mut dyn WriteSeek) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        let relative = Path::new(name);
        let inside = relative
            .components()
            .all(|c| matches!(c, Component::Normal(_)));
        if name.is_empty() || name.ends_with('/') || !inside {
            return Err(OutputError::new(
                &self.dir.join(relative),
                Cause::BadName,
                "is no file below the output folder",
                "use a relative name without \"..\"",
            ));
        }
        let target = follow(self.dir.join(relative));
        if self.staged.iter().any(|s| s.target == target) {
            return Err(OutputError::new(
                &target,
                Cause::BadName,
                "would be written twice",
                "give the recordings different ids",
            ));
        }
        let folder = target.parent().unwrap_or(&self.dir).to_owned();
        make_folders(&folder, &mut self.made)?;
        let file = stage(&target, &folder, write)?;
        self.staged.push(Staged { target, file });
        Ok(())
    }

    /// Puts all files in place. If one cannot be put there, those before it are taken back.
    ///
    /// # Errors
    /// A file cannot be replaced.
    pub fn commit(mut self) -> Result<Vec<PathBuf>, OutputError> {
        let staged = std::mem::take(&mut self.staged);
        let mut placed: Vec<Placed> = Vec::with_capacity(staged.len());
        for Staged { target, file } in staged {
            match place(&target, file) {
                Ok(done) => placed.push(done),
                Err(error) => {
                    for done in placed.into_iter().rev() {
                        done.take_back();
                    }
                    return Err(error);
                }
            }
        }
        self.committed = true;
        let mut folders: Vec<&Path> = placed.iter().filter_map(|p| p.target.parent()).collect();
        folders.extend(self.made.iter().filter_map(|d| d.parent()));
        folders.sort_unstable();
        folders.dedup();
        for folder in folders {
            sync_folder(folder);
        }
        Ok(placed.into_iter().map(|p| p.target).collect())
    }
}

impl Drop for OutputSet {
    fn drop(&mut self) {
        self.staged.clear();
        if !self.committed {
            for folder in self.made.iter().rev() {
                // one that is not empty stays
                let _ = fs::remove_dir(folder);
            }
        }
    }
}

/// Writes one file whole or not at all. A device or a pipe (`/dev/stdout`) is written to directly.
///
/// # Errors
/// `path` is a folder, or the file cannot be written.
pub fn write_atomic(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
    write_atomic_with(path, |w| w.write_all(bytes.as_ref()))
}

/// As [`write_atomic`], by a function that is given a buffered writer. The writer of a pipe cannot seek.
///
/// # Errors
/// As [`write_atomic`]; an error of the function counts as one of the file.
pub fn write_atomic_with(
    path: &Path,
    write: impl FnOnce(&mut dyn WriteSeek) -> io::Result<()>,
) -> Result<(), OutputError> {
    // A redirected standard output may be a plain file that must not be replaced under the shell's feet.
    let descriptor = ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc/self/fd"];
    let special = descriptor.iter().any(|d| path.starts_with(d))
        || fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir());
    if special {
        let written = File::options().write(true).open(path).and_then(|file| {
            let mut buffered = BufWriter::new(file);
            write(&mut buffered)?;
            buffered.flush()
        });
        return written.map_err(|e| OutputError::io(path, e));
    }
    let mut made = Vec::new();
    let path = &follow(path.to_owned());
    let folder = match path.parent() {
        Some(p) if p != Path::new("") => p,
        _ => Path::new("."),
    };
    let clean = |made: &[PathBuf]| {
        for folder in made.iter().rev() {
            let _ = fs::remove_dir(folder);
        }
    };
    let result = make_folders(folder, &mut made)
        .and_then(|()| stage(path, folder, write))
        .and_then(|file| place(path, file));
    match result {
        Ok(_) => {
            sync_folder(folder);
            Ok(())
        }
        Err(error) => {
            clean(&made);
            Err(error)
        }
    }
}

/// Where a link leads, so that the file is replaced and the link stays; a path that is no link as it is.
fn follow(path: PathBuf) -> PathBuf {
    match fs::symlink_metadata(&path) {
        Ok(m) if m.is_symlink() => fs::canonicalize(&path).unwrap_or(path),
        _ => path,
    }
}

/// Makes a folder and those above it; those that it made go to `made`.
fn make_folders(folder: &Path, made: &mut Vec<PathBuf>) -> Result<(), OutputError> {
    let mut missing = Vec::new();
    for path in folder.ancestors() {
        if path == Path::new("") {
            break;
        }
        match fs::metadata(path) {
            Ok(m) if m.is_dir() => break,
            Ok(_) => {
                return Err(OutputError::new(
                    path,
                    Cause::NotAFolder,
                    "is a file, and a folder is needed there",
                    "name another folder with -o, or move the file away",
                ));
            }
            Err(e)
                if matches!(
                    e.kind(),
                    io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
                ) =>
            {
                missing.push(path);
            }
            Err(e) => return Err(OutputError::io(path, e)),
        }
    }
    for path in missing.into_iter().rev() {
        match fs::create_dir(path) {
            Ok(()) => made.push(path.to_owned()),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && path.is_dir() => {}
            Err(e) => return Err(OutputError::io(path, e)),
        }
    }
    Ok(())
}

/// A complete, synced temporary file beside `target`.
fn stage(
    target: &Path,
    folder: &Path,
    write: impl FnOnce(&mut dyn WriteSeek) -> io::Result<()>,
) -> Result<NamedTempFile, OutputError> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".deacal-").suffix(".part");
    let old = fs::metadata(target);
    match &old {
        Ok(m) if m.is_dir() => {
            return Err(OutputError::new(
                target,
                Cause::IsAFolder,
                "is a folder, and a file is to be written",
                "remove or rename the folder, or write elsewhere with -o",
            ));
        }
        // As any new file: what the process's mask leaves of rw-rw-rw-.
        #[cfg(unix)]
        Err(_) => {
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        _ => {}
    }
    let work = || -> io::Result<NamedTempFile> {
        let file = builder.tempfile_in(folder)?;
        let mut buffered = BufWriter::with_capacity(1 << 16, file);
        write(&mut buffered)?;
        let file = buffered.into_inner().map_err(|e| e.into_error())?;
        if let Ok(old) = &old {
            // some file systems have none to set
            let _ = file.as_file().set_permissions(old.permissions());
        }
        file.as_file().sync_all()?;
        Ok(file)
    };
    work().map_err(|e| OutputError::io(target, e))
}

/// A file in place, and what was there before.
struct Placed {
    target: PathBuf,
    /// The old file under another name until the whole set is in place; removed when dropped.
    old: Option<tempfile::TempPath>,
}

impl Placed {
    fn take_back(self) {
        match self.old {
            // nothing more can be done if this fails as well
            Some(old) => drop(old.persist(&self.target)),
            None => drop(fs::remove_file(&self.target)),
        }
    }
}

fn place(target: &Path, file: NamedTempFile) -> Result<Placed, OutputError> {
    let folder = target.parent().unwrap_or(Path::new("."));
    let old = match fs::symlink_metadata(target) {
        Ok(m) if m.is_file() => Some(keep(target, folder).map_err(|e| OutputError::io(target, e))?),
        _ => None,
    };
    file.persist(target)
        .map_err(|e| OutputError::io(target, e.error))?;
    Ok(Placed {
        target: target.to_owned(),
        old,
    })
}

/// Another name for a file that is about to be replaced: a link, or a copy where the file system has none.
fn keep(target: &Path, folder: &Path) -> io::Result<tempfile::TempPath> {
    let folder = if folder == Path::new("") {
        Path::new(".")
    } else {
        folder
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".deacal-").suffix(".old");
    if let Ok(link) = builder.make_in(folder, |path| fs::hard_link(target, path)) {
        return Ok(link.into_temp_path());
    }
    let copy = builder.tempfile_in(folder)?;
    fs::copy(target, copy.path())?;
    Ok(copy.into_temp_path())
}

/// Makes the names in a folder last. Where folders cannot be synced there is nothing to do.
fn sync_folder(folder: &Path) {
    let folder = if folder == Path::new("") {
        Path::new(".")
    } else {
        folder
    };
    #[cfg(unix)]
    if let Ok(open) = File::open(folder) {
        let _ = open.sync_all();
    }
    #[cfg(not(unix))]
    let _ = folder;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut all: Vec<String> = fs::read_dir(dir)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        all.sort();
        all
    }

    #[test]
    fn a_set_appears_whole() {
        let root = tempfile::tempdir().unwrap();
        let dir = root.path().join("out/fit");
        let mut set = OutputSet::new(&dir).unwrap();
        set.write("a.json", b"{}").unwrap();
        set.write("day/one.csv", b"1").unwrap();
        assert!(!dir.join("a.json").exists());
        let files = set.commit().unwrap();
        assert_eq!(files, [dir.join("a.json"), dir.join("day/one.csv")]);
        assert_eq!(names(&dir), ["a.json", "day"]);
        assert_eq!(fs::read(dir.join("day/one.csv")).unwrap(), b"1");
    }

    #[test]
    fn failure_half_way_leaves_everything_as_it_was() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("a.json"), b"old").unwrap();
        let full = |w: &mut dyn WriteSeek| {
            w.write_all(&[0; 100_000])?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        };
        let mut set = OutputSet::new(root.path()).unwrap();
        set.write("a.json", b"new").unwrap();
        let error = set.write_with("sub/b.csv", full).unwrap_err();
        assert_eq!(error.cause, Cause::DiskFull);
        let text = error.to_string();
        assert!(
            text.contains("b.csv") && text.contains("disk is full") && text.contains("free some"),
            "{text}"
        );
        drop(set);
        assert_eq!(names(root.path()), ["a.json"]);
        assert_eq!(fs::read(root.path().join("a.json")).unwrap(), b"old");
    }

    #[test]
    fn a_set_whose_last_file_cannot_be_placed_is_taken_back() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("a"), b"old").unwrap();
        let mut set = OutputSet::new(root.path()).unwrap();
        set.write("a", b"new").unwrap();
        set.write("b", b"new").unwrap();
        set.write("c", b"new").unwrap();
        fs::create_dir(root.path().join("c")).unwrap();
        fs::write(root.path().join("c/inside"), b"").unwrap();
        assert!(set.commit().is_err());
        assert_eq!(fs::read(root.path().join("a")).unwrap(), b"old");
        assert_eq!(names(root.path()), ["a", "c"]);
    }

    #[test]
    fn a_dropped_set_removes_the_folders_it_made_and_no_others() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join("there")).unwrap();
        let dir = root.path().join("there/x/y");
        let mut set = OutputSet::new(&dir).unwrap();
        set.write("f", b"1").unwrap();
        drop(set);
        assert_eq!(names(root.path()), ["there"]);
        assert!(names(&root.path().join("there")).is_empty());
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("out");
        fs::write(&file, b"mine").unwrap();
        for dir in [file.clone(), file.join("below")] {
            let error = OutputSet::new(&dir).unwrap_err();
            assert_eq!(error.cause, Cause::NotAFolder, "{error}");
            assert_eq!(error.path, file);
        }
        let folder = root.path().join("folder");
        fs::create_dir(&folder).unwrap();
        let error = write_atomic(&folder, b"").unwrap_err();
        assert_eq!(error.cause, Cause::IsAFolder, "{error}");
        assert_eq!(fs::read(&file).unwrap(), b"mine");
    }

    #[test]
    fn names_stay_inside_and_are_written_once() {
        let root = tempfile::tempdir().unwrap();
        let mut set = OutputSet::new(root.path()).unwrap();
        for name in ["", "../x", "/x", "a/../../x", "a/"] {
            assert_eq!(set.write(name, b"").unwrap_err().cause, Cause::BadName);
        }
        set.write("a", b"").unwrap();
        assert!(
            set.write("a", b"")
                .unwrap_err()
                .to_string()
                .contains("twice")
        );
    }

    #[cfg(unix)]
    #[test]
    fn permission_is_asked_for_and_kept() {
        use std::os::unix::fs::PermissionsExt;
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("f");
        write_atomic(&file, b"1").unwrap();
        let plain = root.path().join("plain");
        fs::write(&plain, b"").unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&file), mode(&plain));
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        write_atomic(&file, b"2").unwrap();
        assert_eq!(mode(&file) & 0o777, 0o640);
        let shut = root.path().join("shut");
        fs::create_dir(&shut).unwrap();
        fs::set_permissions(&shut, fs::Permissions::from_mode(0o500)).unwrap();
        match write_atomic(&shut.join("f"), b"") {
            Ok(()) => eprintln!("skipped: this user may write anywhere"),
            Err(error) => {
                assert_eq!(error.cause, Cause::NoPermission);
                assert!(error.to_string().contains("permission denied"), "{error}");
            }
        }
        fs::set_permissions(&shut, fs::Permissions::from_mode(0o700)).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        fs::write(&file, b"old").unwrap();
        let link = root.path().join("link");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_atomic(&link, b"new").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_says_so_and_stays_a_device() {
        use std::os::unix::fs::FileTypeExt;
        let error = write_atomic(Path::new("/dev/full"), [0; 100_000]).unwrap_err();
        assert_eq!(error.cause, Cause::DiskFull, "{error}");
        let kind = fs::metadata("/dev/full").unwrap().file_type();
        assert!(kind.is_char_device());
        write_atomic(Path::new("/dev/null"), b"1").unwrap();
    }
}
