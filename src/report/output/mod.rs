//! Files that are there whole or not at all.
//!
//! An [`OutputSet`] holds the files of one command. Each is written, flushed and synced in a work folder;
//! [`OutputSet::commit`] puts them in place at once when all are complete. Without a commit the work folder
//! goes, and so do folders that were made for it; files of an earlier run stay as they were. [`write_atomic`]
//! does the same for a single file.
//!
//! Nothing is put onto a file that the command read, or that the program did not make itself: see
//! [`Overwrite`].

mod made;
mod work;

use std::fmt;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Component, Path, PathBuf};

use crate::recording::was_opened;
use made::{Lists, Made, Origin, sum_of};
use work::Work;
pub use work::{HELD, abandon, settle};

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
    /// A file is in the way that is not the program's to overwrite.
    Foreign,
    /// Another process is writing there.
    Busy,
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
            _ => (
                Cause::Other,
                format!("cannot be written: {error}"),
                "write elsewhere with -o",
            ),
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

/// What a command may overwrite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overwrite {
    /// Only what the program made itself and nobody has changed since.
    Own,
    /// Anything that is not write-protected.
    Any,
}

/// The files of one command.
#[derive(Debug)]
pub struct OutputSet {
    dir: PathBuf,
    overwrite: Overwrite,
    work: Work,
    lists: Lists,
    /// Complete files, with the sums of their bytes.
    staged: Vec<(PathBuf, String)>,
    /// Files that are in place with the very same bytes.
    as_they_are: Vec<PathBuf>,
}

impl OutputSet {
    /// Files below `dir`, which comes into being with them if it is not there.
    ///
    /// # Errors
    /// `dir` is a file, or cannot be made; another process is writing there.
    pub fn new(dir: impl Into<PathBuf>, overwrite: Overwrite) -> Result<Self, OutputError> {
        let dir = dir.into();
        Ok(OutputSet {
            work: Work::open(&dir)?,
            dir,
            overwrite,
            lists: Lists::default(),
            staged: Vec::new(),
            as_they_are: Vec::new(),
        })
    }

    /// Whether `names` could be written below `dir`, before a long run begins. Nothing is changed.
    ///
    /// # Errors
    /// `dir` is a file, may not be written to, or holds files of these names that may not be overwritten.
    pub fn check(dir: &Path, names: &[&str], overwrite: Overwrite) -> Result<(), OutputError> {
        let mut missing = Vec::new();
        let there = first_folder(dir, &mut missing)?;
        // A file without a name, or one that goes again at once.
        tempfile::tempfile_in(&there).map_err(|e| OutputError::io(&there, e))?;
        let mut lists = Lists::default();
        for name in names {
            let path = dir.join(name);
            if let Some(objection) = objection(&path, overwrite, &mut lists)? {
                return Err(objection);
            }
        }
        Ok(())
    }

    /// The folder.
    #[must_use]
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Writes a whole file. `name` is relative to the folder; a `/` in it makes a folder.
    ///
    /// # Errors
    /// The name leads out of the folder or is taken by another file of this set; the file may not be
    /// overwritten, or cannot be written.
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
        // a path forgets a `/` at its end
        let name = if name.ends_with('/') { "" } else { name };
        self.write_path(Path::new(name), write)
    }

    fn write_path(
        &mut self,
        relative: &Path,
        write: impl FnOnce(&mut dyn WriteSeek) -> io::Result<()>,
    ) -> Result<(), OutputError> {
        let target = self.dir.join(relative);
        let mut parts = relative.components();
        let inside = parts.all(|c| matches!(c, Component::Normal(_)));
        if relative.as_os_str().is_empty() || !inside {
            return Err(OutputError::new(
                &target,
                Cause::BadName,
                "is no file below the output folder",
                "use a relative name without \"..\"",
            ));
        }
        let taken = |p: &PathBuf| p == relative;
        if self.staged.iter().any(|(p, _)| taken(p)) || self.as_they_are.iter().any(taken) {
            return Err(OutputError::new(
                &target,
                Cause::BadName,
                "would be written twice",
                "give the recordings different ids",
            ));
        }
        first_folder(target.parent().unwrap_or(&self.dir), &mut Vec::new())?;
        let objection = objection(&target, self.overwrite, &mut self.lists)?;
        let staged = self.work.staging().join(relative);
        let file = self.work.create(relative)?;
        let old = fs::metadata(&target);
        let work = || -> io::Result<()> {
            let mut buffered = BufWriter::with_capacity(1 << 16, file);
            write(&mut buffered)?;
            let file = buffered.into_inner().map_err(|e| e.into_error())?;
            if let Ok(old) = &old {
                // some file systems have none to set
                let _ = file.set_permissions(old.permissions());
            }
            file.sync_all()
        };
        work().map_err(|e| OutputError::io(&target, e))?;
        let sum = sum_of(&staged);
        match objection {
            None => self.staged.push((relative.to_owned(), sum)),
            // No byte would change.
            Some(_) if sum == sum_of(&target) => {
                fs::remove_file(&staged).map_err(|e| OutputError::io(&target, e))?;
                self.as_they_are.push(relative.to_owned());
            }
            Some(objection) => return Err(objection),
        }
        Ok(())
    }

    /// Puts all files in place at once. If one cannot be put there, none is.
    ///
    /// # Errors
    /// A file cannot be replaced.
    pub fn commit(mut self) -> Result<Vec<PathBuf>, OutputError> {
        let mut names: Vec<PathBuf> = self.staged.iter().map(|(name, _)| name.clone()).collect();
        let files = names.iter().chain(&self.as_they_are);
        let files = files.map(|n| self.dir.join(n)).collect();
        if names.is_empty() {
            return Ok(files);
        }
        let key = |name: &Path| {
            let parts: Vec<_> = name.iter().map(|p| p.to_string_lossy()).collect();
            parts.join("/")
        };
        let sums = self.staged.drain(..).map(|(n, sum)| (key(&n), sum));
        let list = Made::read(&self.dir).with(&self.dir, sums.collect());
        let mut file = self.work.create(Path::new(made::NAME))?;
        file.write_all(list.to_text().as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(|e| OutputError::io(&self.dir.join(made::NAME), e))?;
        names.push(made::NAME.into());
        self.work.commit(&names)?;
        Ok(files)
    }
}

fn a_folder(path: &Path) -> OutputError {
    OutputError::new(
        path,
        Cause::IsAFolder,
        "is a folder, and a file is to be written",
        "remove or rename the folder, or write elsewhere with -o",
    )
}

/// Why `path` may not be overwritten, if it may not.
fn objection(
    path: &Path,
    overwrite: Overwrite,
    lists: &mut Lists,
) -> Result<Option<OutputError>, OutputError> {
    let Ok(old) = fs::metadata(path) else {
        return Ok(None);
    };
    if old.is_dir() {
        return Err(a_folder(path));
    }
    let foreign = |what, action| Ok(Some(OutputError::new(path, Cause::Foreign, what, action)));
    let shut = || {
        let opened = File::options().write(true).open(path);
        opened.is_err_and(|e| e.kind() == io::ErrorKind::PermissionDenied)
    };
    if old.permissions().readonly() || shut() {
        return foreign(
            "is write-protected",
            "take the protection off, or write elsewhere with -o",
        );
    }
    if overwrite == Overwrite::Any {
        return Ok(None);
    }
    if was_opened(path) {
        return foreign(
            "is what this command reads, and would be overwritten by its result",
            "write elsewhere with -o, or insist with --force",
        );
    }
    match lists.origin(path) {
        Origin::Own => Ok(None),
        Origin::Changed => foreign(
            "was changed since deacal wrote it",
            "move it away, write elsewhere with -o, or overwrite it with --force",
        ),
        Origin::Foreign => foreign(
            "is there already, and deacal did not write it there",
            "move it away, write elsewhere with -o, or overwrite it with --force",
        ),
    }
}

/// Writes one file whole or not at all. A device or a pipe (`/dev/stdout`) is written to directly.
///
/// # Errors
/// `path` is a folder or may not be overwritten, or the file cannot be written.
pub fn write_atomic(
    path: &Path,
    overwrite: Overwrite,
    bytes: impl AsRef<[u8]>,
) -> Result<(), OutputError> {
    write_atomic_with(path, overwrite, |w| w.write_all(bytes.as_ref()))
}

/// As [`write_atomic`], by a function that is given a buffered writer. The writer of a pipe cannot seek.
///
/// # Errors
/// As [`write_atomic`]; an error of the function counts as one of the file.
pub fn write_atomic_with(
    path: &Path,
    overwrite: Overwrite,
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
    let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
        return Err(OutputError::new(
            path,
            Cause::BadName,
            "is no name of a file",
            "name a file",
        ));
    };
    if path.is_dir() {
        return Err(a_folder(path));
    }
    let mut set = OutputSet::new(folder, overwrite)?;
    set.write_path(Path::new(name), write)?;
    set.commit().map(drop)
}

/// Where a link leads, so that the file is replaced and the link stays; a path that is no link as it is.
fn follow(path: PathBuf) -> PathBuf {
    match fs::symlink_metadata(&path) {
        Ok(m) if m.is_symlink() => fs::canonicalize(&path).unwrap_or(path),
        _ => path,
    }
}

/// The nearest folder above `folder`, or itself, that is there; those that are missing below it, inner ones
/// first.
fn first_folder(folder: &Path, missing: &mut Vec<PathBuf>) -> Result<PathBuf, OutputError> {
    for path in folder.ancestors() {
        if path == Path::new("") {
            break;
        }
        match fs::metadata(path) {
            Ok(m) if m.is_dir() => return Ok(path.to_owned()),
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
                missing.push(path.to_owned());
            }
            Err(e) => return Err(OutputError::io(path, e)),
        }
    }
    Ok(PathBuf::from("."))
}

/// Makes a folder and those above it; those that it made go to `made`.
fn make_folders(folder: &Path, made: &mut Vec<PathBuf>) -> Result<(), OutputError> {
    let mut missing = Vec::new();
    first_folder(folder, &mut missing)?;
    for path in missing.into_iter().rev() {
        match fs::create_dir(&path) {
            Ok(()) => made.push(path),
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists && path.is_dir() => {}
            Err(e) => return Err(OutputError::io(&path, e)),
        }
    }
    Ok(())
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
        let mut set = OutputSet::new(&dir, Overwrite::Own).unwrap();
        set.write("a.json", b"{}").unwrap();
        set.write("day/one.csv", b"1").unwrap();
        assert!(!dir.join("a.json").exists());
        let files = set.commit().unwrap();
        assert_eq!(files, [dir.join("a.json"), dir.join("day/one.csv")]);
        assert_eq!(names(&dir), [".deacal.json", "a.json", "day"]);
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
        let mut set = OutputSet::new(root.path(), Overwrite::Any).unwrap();
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
        let mut set = OutputSet::new(root.path(), Overwrite::Any).unwrap();
        set.write("a", b"new").unwrap();
        set.write("b", b"new").unwrap();
        set.write("c", b"new").unwrap();
        fs::create_dir(root.path().join("c")).unwrap();
        fs::write(root.path().join("c/inside"), b"").unwrap();
        assert!(set.commit().is_err());
        assert_eq!(fs::read(root.path().join("a")).unwrap(), b"old");
        assert_eq!(names(root.path()), ["a", "c"]);
    }

    /// Writes `bytes` as `f` in `dir`.
    fn write(dir: &Path, bytes: &[u8], overwrite: Overwrite) -> Result<(), OutputError> {
        let mut set = OutputSet::new(dir, overwrite)?;
        set.write("f", bytes)?;
        set.commit().map(drop)
    }

    #[test]
    fn only_what_the_program_made_is_overwritten() {
        let root = tempfile::tempdir().unwrap();
        let (dir, file) = (root.path().join("out"), root.path().join("out/f"));
        for bytes in [b"1", b"2"] {
            write(&dir, bytes, Overwrite::Own).unwrap();
            assert_eq!(fs::read(&file).unwrap(), bytes);
        }
        // known under another root, too
        let mut outer = OutputSet::new(root.path(), Overwrite::Own).unwrap();
        outer.write("out/f", b"3").unwrap();
        outer.commit().unwrap();
        write(&dir, b"4", Overwrite::Own).unwrap();
        // edited by hand
        fs::write(&file, b"mine").unwrap();
        for attempt in [
            write(&dir, b"5", Overwrite::Own),
            OutputSet::check(&dir, &["f"], Overwrite::Own),
        ] {
            let error = attempt.unwrap_err();
            assert_eq!(error.cause, Cause::Foreign);
            let text = error.to_string();
            assert!(
                text.contains("changed") && text.contains("--force"),
                "{text}"
            );
        }
        assert_eq!(fs::read(&file).unwrap(), b"mine");
        // never made here; the same bytes do no harm and stay a stranger's
        for dir in [root.path(), &dir] {
            fs::remove_file(dir.join(".deacal.json")).unwrap();
        }
        let text = write(&dir, b"5", Overwrite::Own).unwrap_err().to_string();
        assert!(text.contains("did not write it"), "{text}");
        write(&dir, b"mine", Overwrite::Own).unwrap();
        assert!(!dir.join(".deacal.json").exists());
        write(&dir, b"5", Overwrite::Any).unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"5");
        write(&dir, b"6", Overwrite::Own).unwrap();
        assert_eq!(names(&dir), [".deacal.json", "f"]);
    }

    #[test]
    fn a_file_that_was_read_is_not_overwritten_even_if_it_is_an_own_one() {
        let root = tempfile::tempdir().unwrap();
        write(root.path(), b"1", Overwrite::Own).unwrap();
        crate::recording::open(&root.path().join("f")).unwrap();
        let text = write(root.path(), b"2", Overwrite::Own)
            .unwrap_err()
            .to_string();
        assert!(text.contains("this command reads"), "{text}");
        let link = root.path().join("link");
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(root.path().join("f"), &link).unwrap();
            assert!(write_atomic(&link, Overwrite::Own, b"2").is_err());
        }
        assert_eq!(fs::read(root.path().join("f")).unwrap(), b"1");
        write(root.path(), b"2", Overwrite::Any).unwrap();
        assert_eq!(fs::read(root.path().join("f")).unwrap(), b"2");
    }

    #[test]
    fn a_write_protected_file_stays_whatever_is_asked_for() {
        let root = tempfile::tempdir().unwrap();
        write(root.path(), b"1", Overwrite::Own).unwrap();
        let file = root.path().join("f");
        let mut shut = fs::metadata(&file).unwrap().permissions();
        shut.set_readonly(true);
        fs::set_permissions(&file, shut).unwrap();
        for overwrite in [Overwrite::Own, Overwrite::Any] {
            let error = write(root.path(), b"2", overwrite).unwrap_err();
            assert!(error.to_string().contains("write-protected"), "{error}");
        }
        assert_eq!(fs::read(&file).unwrap(), b"1");
        assert_eq!(names(root.path()), [".deacal.json", "f"]);
    }

    #[test]
    fn more_files_than_a_process_may_have_open() {
        let root = tempfile::tempdir().unwrap();
        let mut set = OutputSet::new(root.path().join("out"), Overwrite::Own).unwrap();
        for i in 0..1500 {
            set.write(&format!("{i}/f"), b"1").unwrap();
        }
        assert_eq!(set.commit().unwrap().len(), 1500);
    }

    #[test]
    fn a_dropped_set_removes_the_folders_it_made_and_no_others() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join("there")).unwrap();
        let dir = root.path().join("there/x/y");
        let mut set = OutputSet::new(&dir, Overwrite::Own).unwrap();
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
            let error = OutputSet::new(&dir, Overwrite::Own).unwrap_err();
            assert_eq!(error.cause, Cause::NotAFolder, "{error}");
            assert_eq!(error.path, file);
        }
        let folder = root.path().join("folder");
        fs::create_dir(&folder).unwrap();
        let error = write_atomic(&folder, Overwrite::Own, b"").unwrap_err();
        assert_eq!(error.cause, Cause::IsAFolder, "{error}");
        assert_eq!(fs::read(&file).unwrap(), b"mine");
    }

    #[test]
    fn names_stay_inside_and_are_written_once() {
        let root = tempfile::tempdir().unwrap();
        let mut set = OutputSet::new(root.path(), Overwrite::Own).unwrap();
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
        write_atomic(&file, Overwrite::Own, b"1").unwrap();
        let plain = root.path().join("plain");
        fs::write(&plain, b"").unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&file), mode(&plain));
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        write_atomic(&file, Overwrite::Own, b"2").unwrap();
        assert_eq!(mode(&file) & 0o777, 0o640);
        let shut = root.path().join("shut");
        fs::create_dir(&shut).unwrap();
        fs::set_permissions(&shut, fs::Permissions::from_mode(0o500)).unwrap();
        match write_atomic(&shut.join("f"), Overwrite::Own, b"") {
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
        write_atomic(&link, Overwrite::Any, b"new").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_says_so_and_stays_a_device() {
        use std::os::unix::fs::FileTypeExt;
        let error = write_atomic(Path::new("/dev/full"), Overwrite::Own, [0; 100_000]).unwrap_err();
        assert_eq!(error.cause, Cause::DiskFull, "{error}");
        let kind = fs::metadata("/dev/full").unwrap().file_type();
        assert!(kind.is_char_device());
        write_atomic(Path::new("/dev/null"), Overwrite::Own, b"1").unwrap();
    }
}
