//! The folder in which a set of files is made before it is put in place, and how that happens all at once.
//!
//! A set for a folder that is not there yet is made beside it and becomes the folder by one rename. A set for
//! a folder that is there is made in `.deacal-work` inside it: when all files are complete, the mark `commit`
//! is set, then each file is renamed into place, then the mark goes. From the mark on the set counts as in
//! place: whoever comes next ([`settle`]) ends what was cut off. Before the mark nothing has changed. The
//! work folder is locked as long as its process lives; one that is not locked is a leftover, and goes.

use std::fs::{self, File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Cause, OutputError, follow, make_folders, sync_folder};

/// Every work folder begins so.
const PREFIX: &str = ".deacal-";
/// What the name of a file begins with that its writer holds locked until it has its own name.
pub const HELD: &str = ".deacal-held-";
/// The work folder inside a folder that is there.
const INSIDE: &str = ".deacal-work";
/// Names inside a work folder.
const LOCK: &str = "lock";
const COMMIT: &str = "commit";
pub(super) const NEW: &str = "new";
const OLD: &str = "old";
/// How long another process is waited for. Putting files in place takes milliseconds; who holds a folder
/// longer is a long run.
const PATIENCE: Duration = Duration::from_millis(if cfg!(test) { 200 } else { 5000 });

/// The work folders of this process and the folders made for them, to be taken away when it is stopped.
/// Whoever makes a file in a work folder or puts a set in place holds this, so that a stop comes before it or
/// after it.
static AT_WORK: Mutex<AtWork> = Mutex::new(AtWork {
    roots: Vec::new(),
    placed: Vec::new(),
});

struct AtWork {
    roots: Vec<(PathBuf, Vec<PathBuf>)>,
    placed: Vec<PathBuf>,
}

fn at_work() -> MutexGuard<'static, AtWork> {
    AT_WORK.lock().unwrap_or_else(PoisonError::into_inner)
}

/// For a process that is about to end: takes away what is not complete, and gives the folders into which sets
/// were put before. A set that is being put in place is waited for; from now on none is begun: whoever tries
/// waits for the end.
pub fn abandon() -> Vec<PathBuf> {
    let mut held = at_work();
    for (root, made) in held.roots.drain(..) {
        clear(&root);
        remove_empty(&made);
    }
    let placed = std::mem::take(&mut held.placed);
    std::mem::forget(held);
    placed
}

fn remove_empty(made: &[PathBuf]) {
    for folder in made.iter().rev() {
        // one that is not empty stays
        let _ = fs::remove_dir(folder);
    }
}

/// Takes a work folder away, the lock last.
fn clear(root: &Path) {
    for part in [NEW, OLD] {
        let _ = fs::remove_dir_all(root.join(part));
    }
    let _ = fs::remove_file(root.join(COMMIT));
    let _ = fs::remove_file(root.join(LOCK));
    let _ = fs::remove_dir(root);
}

/// A work folder, locked.
#[derive(Debug)]
pub(super) struct Work {
    /// The folder of the results.
    dir: PathBuf,
    root: PathBuf,
    /// Becomes the results' folder as a whole.
    fresh: bool,
    /// Folders that were made on the way, outer ones first.
    made: Vec<PathBuf>,
    /// None where the file system knows no locks.
    _lock: Option<File>,
}

impl Work {
    /// Locks the work folder for results in `dir`, ends what an earlier run left there, and clears leftovers.
    ///
    /// # Errors
    /// `dir` is a file or cannot be made; another process is at work there.
    pub(super) fn open(dir: &Path) -> Result<Self, OutputError> {
        let dir = if dir == Path::new("") {
            Path::new(".")
        } else {
            dir
        };
        let dir = follow(dir.to_owned());
        let mut made = Vec::new();
        let name = dir.file_name();
        let there = match (fs::metadata(&dir), name) {
            (Ok(_), _) => true,
            (Err(_), Some(_)) if fs::symlink_metadata(&dir).is_ok() => {
                return Err(OutputError::new(
                    &dir,
                    Cause::NotAFolder,
                    "is a link that leads nowhere",
                    "remove the link, or name another folder with -o",
                ));
            }
            (Err(_), Some(_)) => false,
            (Err(_), None) => true,
        };
        let beside = beside(&dir);
        let (home, inner) = match &beside {
            Some((parent, name)) if !there => (parent.clone(), name.clone()),
            _ => (dir.clone(), INSIDE.to_owned()),
        };
        make_folders(&home, &mut made)?;
        let root = home.join(inner);
        let lock = match lock(&root, &dir, &made) {
            Ok(lock) => lock,
            Err(error) => {
                remove_empty(&made);
                return Err(error);
            }
        };
        // Another process may have put the folder there while this one waited for the lock.
        if !there && fs::metadata(&dir).is_ok() {
            clear(&root);
            at_work().roots.retain(|r| r.0 != root);
            return Work::open(&dir);
        }
        if let Err(error) = finish_earlier(&dir, &root) {
            at_work().roots.retain(|r| r.0 != root);
            return Err(error);
        }
        sweep(&home, &root);
        // left by one that found no folder yet
        if let Some((parent, name)) = beside.filter(|_| there) {
            clear_if_left(&parent.join(name));
        }
        let work = Work {
            dir,
            root,
            fresh: !there,
            made,
            _lock: lock,
        };
        let held = at_work();
        let new = fs::create_dir(work.root.join(NEW));
        drop(held);
        new.map_err(|e| OutputError::io(&work.root, e))?;
        Ok(work)
    }

    /// The folder in which the files are made; it mirrors the folder of the results.
    pub(super) fn staging(&self) -> PathBuf {
        self.root.join(NEW)
    }

    /// Makes an empty file in the staging folder.
    pub(super) fn create(&self, name: &Path) -> Result<File, OutputError> {
        let path = self.staging().join(name);
        let held = at_work();
        let folder = path.parent().unwrap_or(&self.root);
        let file = fs::create_dir_all(folder).and_then(|()| File::create_new(&path));
        drop(held);
        file.map_err(|e| OutputError::io(&self.dir.join(name), e))
    }

    /// Puts all files in place, all or none; `names` are relative to the folder.
    ///
    /// # Errors
    /// A file cannot be replaced; those before it have been taken back.
    pub(super) fn commit(mut self, names: &[PathBuf]) -> Result<(), OutputError> {
        let mut held = at_work();
        if self.fresh {
            use io::ErrorKind::{AlreadyExists, DirectoryNotEmpty};
            match fs::rename(self.staging(), &self.dir) {
                Ok(()) => {}
                Err(e) if matches!(e.kind(), AlreadyExists | DirectoryNotEmpty) => {
                    drop(held);
                    return self.into_place_of(names);
                }
                Err(e) => return Err(OutputError::io(&self.dir, e)),
            }
            sync_folder(self.dir.parent().unwrap_or(&self.dir));
            held.placed.push(self.dir.clone());
            self.made.clear();
            return Ok(());
        }
        let kept = self.keep(names)?;
        File::create(self.root.join(COMMIT))
            .and_then(|mark| mark.sync_all())
            .map_err(|e| OutputError::io(&self.dir, e))?;
        sync_folder(&self.root);
        let mut made = Vec::new();
        for (i, name) in names.iter().enumerate() {
            let folders = match self.dir.join(name).parent() {
                Some(folder) => make_folders(folder, &mut made),
                None => Ok(()),
            };
            if let Err(error) = folders.and_then(|()| place(&self.root, &self.dir, name)) {
                for (name, old) in names[..i].iter().zip(&kept) {
                    let target = follow(self.dir.join(name));
                    // nothing more can be done if this fails as well
                    let _ = match old {
                        Some(old) => fs::rename(old, &target),
                        None => fs::remove_file(&target),
                    };
                }
                let _ = fs::remove_file(self.root.join(COMMIT));
                remove_empty(&made);
                return Err(error);
            }
        }
        let mut folders: Vec<PathBuf> = names
            .iter()
            .filter_map(|n| self.dir.join(n).parent().map(Path::to_owned))
            .chain(made.iter().filter_map(|d| d.parent().map(Path::to_owned)))
            .collect();
        folders.sort_unstable();
        folders.dedup();
        folders.iter().for_each(|f| sync_folder(f));
        let _ = fs::remove_file(self.root.join(COMMIT));
        held.placed.push(self.dir.clone());
        self.made.clear();
        Ok(())
    }

    /// The same where the folder has come into being since the work began: what is in it stays.
    fn into_place_of(self, names: &[PathBuf]) -> Result<(), OutputError> {
        let there = Work::open(&self.dir)?;
        for name in names {
            let target = self.dir.join(name);
            if fs::symlink_metadata(&target).is_ok() {
                return Err(OutputError::new(
                    &target,
                    Cause::Foreign,
                    "was put there by another program meanwhile",
                    "move it away and run again, or write elsewhere with -o",
                ));
            }
            drop(there.create(name)?);
            fs::rename(self.staging().join(name), there.staging().join(name))
                .map_err(|e| OutputError::io(&target, e))?;
        }
        there.commit(names)
    }

    /// Another name for each file that is about to be replaced: a link, or a copy where the file system has
    /// none.
    fn keep(&self, names: &[PathBuf]) -> Result<Vec<Option<PathBuf>>, OutputError> {
        let keep = |name: &PathBuf| -> io::Result<Option<PathBuf>> {
            let target = follow(self.dir.join(name));
            if fs::symlink_metadata(&target).is_err() {
                return Ok(None);
            }
            let old = self.root.join(OLD).join(name);
            fs::create_dir_all(old.parent().unwrap_or(&self.root))?;
            if fs::hard_link(&target, &old).is_err() {
                fs::copy(&target, &old)?;
            }
            Ok(Some(old))
        };
        let kept = names
            .iter()
            .map(|n| keep(n).map_err(|e| OutputError::io(&self.dir.join(n), e)));
        kept.collect()
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let mut held = at_work();
        clear(&self.root);
        remove_empty(&self.made);
        held.roots.retain(|(root, _)| *root != self.root);
    }
}

/// Ends what an earlier process began to put in place in `dir`, and clears what it left in its work folder.
fn finish_earlier(dir: &Path, root: &Path) -> Result<(), OutputError> {
    let held = at_work();
    if root.join(COMMIT).exists() {
        let mut files = Vec::new();
        list(&root.join(NEW), Path::new(""), &mut files)?;
        for file in &files {
            place(root, dir, file)?;
        }
        let _ = fs::remove_file(root.join(COMMIT));
    }
    drop(held);
    for part in [NEW, OLD] {
        let _ = fs::remove_dir_all(root.join(part));
    }
    Ok(())
}

/// Renames one complete file from a work folder into place.
fn place(root: &Path, dir: &Path, name: &Path) -> Result<(), OutputError> {
    let staged = root.join(NEW).join(name);
    let target = follow(dir.join(name));
    if let Some(folder) = target.parent() {
        make_folders(folder, &mut Vec::new())?;
    }
    let renamed = match fs::rename(&staged, &target) {
        // The target of a link may lie on another disk.
        Err(e) if e.kind() == io::ErrorKind::CrossesDevices => {
            let beside = target.with_file_name(format!("{PREFIX}{}.part", std::process::id()));
            fs::copy(&staged, &beside)
                .and_then(|_| fs::rename(&beside, &target))
                .and_then(|()| fs::remove_file(&staged))
        }
        other => other,
    };
    renamed.map_err(|e| OutputError::io(&target, e))
}

/// Where the work folder of results in `dir` is as long as `dir` is not there: its folder and its name.
fn beside(dir: &Path) -> Option<(PathBuf, String)> {
    let parent = match dir.parent() {
        Some(p) if p != Path::new("") => p,
        _ => Path::new("."),
    };
    let name = dir.file_name()?.as_encoded_bytes();
    let digest = ring::digest::digest(&ring::digest::SHA256, name);
    let short = digest.as_ref()[..8].iter();
    let short: String = short.map(|b| format!("{b:02x}")).collect();
    Some((parent.to_owned(), format!("{PREFIX}{short}")))
}

/// Makes and locks a work folder, and puts it down with the folders `made` for it; no lock where the file
/// system knows none. A stop comes before a try or after it.
fn lock(root: &Path, dir: &Path, made: &[PathBuf]) -> Result<Option<File>, OutputError> {
    let io = |e| OutputError::io(dir, e);
    let begin = Instant::now();
    loop {
        let mut held = at_work();
        let own = || (root.to_owned(), made.to_owned());
        match fs::create_dir(root) {
            Err(e) if e.kind() != io::ErrorKind::AlreadyExists => return Err(io(e)),
            _ => {}
        }
        let path = root.join(LOCK);
        let opened = File::options()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&path);
        let mut file = match opened {
            // Its owner has just taken it away.
            Err(e) if e.kind() == io::ErrorKind::NotFound && begin.elapsed() < PATIENCE => continue,
            Err(e) => return Err(io(e)),
            Ok(file) => file,
        };
        match file.try_lock() {
            Ok(()) if is_at(&file, &path) => {
                let _ = file
                    .set_len(0)
                    .and_then(|()| write!(file, "{}", std::process::id()));
                held.roots.push(own());
                return Ok(Some(file));
            }
            Ok(()) => {}
            Err(TryLockError::WouldBlock) if begin.elapsed() < PATIENCE => {
                drop(held);
                std::thread::sleep(Duration::from_millis(10));
            }
            Err(TryLockError::WouldBlock) => {
                let who = fs::read_to_string(&path).unwrap_or_default();
                return Err(OutputError::new(
                    dir,
                    Cause::Busy,
                    format!("another deacal (process {}) is writing there", who.trim()),
                    "wait for it to end, or write elsewhere with -o",
                ));
            }
            Err(TryLockError::Error(_)) => {
                held.roots.push(own());
                return Ok(None);
            }
        }
    }
}

/// Whether an open file still has its name.
fn is_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let number = |m: fs::Metadata| (m.dev(), m.ino());
        match (file.metadata(), fs::metadata(path)) {
            (Ok(own), Ok(there)) => number(own) == number(there),
            _ => false,
        }
    }
    #[cfg(not(unix))]
    {
        let _ = file;
        path.exists()
    }
}

/// Takes away what processes that are no more left in `home`: work folders that nobody holds, and single
/// temporaries.
fn sweep(home: &Path, own: &Path) {
    let Ok(entries) = fs::read_dir(home) else {
        return;
    };
    for entry in entries.filter_map(Result::ok) {
        let (name, path) = (entry.file_name(), entry.path());
        let name = name.to_string_lossy();
        if !name.starts_with(PREFIX) || path == own {
            continue;
        }
        let is_dir = entry.file_type().is_ok_and(|t| t.is_dir());
        if is_dir && name == INSIDE {
            continue; // of results that may have to be ended first
        }
        if is_dir {
            clear_if_left(&path);
        } else if name.starts_with(HELD) {
            let left = File::options().read(true).write(true).open(&path);
            if left.is_ok_and(|file| file.try_lock().is_ok()) {
                let _ = fs::remove_file(path);
            }
        } else if name.ends_with(".part") || name.ends_with(".old") {
            let _ = fs::remove_file(path);
        }
    }
}

/// Takes a work folder away that nobody holds.
fn clear_if_left(root: &Path) {
    let mut options = File::options();
    match options.read(true).write(true).open(root.join(LOCK)) {
        Ok(file) if file.try_lock().is_ok() => clear(root),
        Ok(_) => {}
        // empty, or about to get its lock: its owner makes it anew
        Err(_) => drop(fs::remove_dir(root)),
    }
}

/// Files below `root`, relative to it.
fn list(root: &Path, inside: &Path, out: &mut Vec<PathBuf>) -> Result<(), OutputError> {
    let folder = root.join(inside);
    let entries = fs::read_dir(&folder).map_err(|e| OutputError::io(&folder, e))?;
    for entry in entries {
        let entry = entry.map_err(|e| OutputError::io(&folder, e))?;
        let name = inside.join(entry.file_name());
        if entry.file_type().is_ok_and(|t| t.is_dir()) {
            list(root, &name, out)?;
        } else {
            out.push(name);
        }
    }
    Ok(())
}

/// For readers: where a run was cut off while it put its files in place in `dir`, ends that, so that the
/// files there are of one run. What else it left of its work there goes.
///
/// # Errors
/// The files cannot be put in place.
pub fn settle(dir: &Path) -> Result<(), OutputError> {
    let inside = dir.join(INSIDE);
    if inside.join(COMMIT).exists() {
        drop(Work::open(dir)?);
    } else if inside.exists() {
        clear_if_left(&inside);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::{OutputSet, Overwrite};
    use super::*;

    /// What a process leaves that is killed after the first of two renames.
    fn cut_off(dir: &Path) {
        fs::create_dir_all(dir.join(INSIDE).join(NEW)).unwrap();
        fs::write(dir.join("a"), b"new").unwrap();
        fs::write(dir.join("b"), b"old").unwrap();
        fs::write(dir.join(INSIDE).join(LOCK), b"1").unwrap();
        fs::write(dir.join(INSIDE).join(NEW).join("b"), b"new").unwrap();
        fs::write(dir.join(INSIDE).join(COMMIT), b"").unwrap();
    }

    #[test]
    fn what_was_cut_off_while_it_was_put_in_place_is_ended() {
        let root = tempfile::tempdir().unwrap();
        cut_off(root.path());
        settle(root.path()).unwrap();
        assert_eq!(fs::read(root.path().join("b")).unwrap(), b"new");
        assert!(!root.path().join(INSIDE).exists());
        // a writer does the same, before its own files
        cut_off(root.path());
        drop(OutputSet::new(root.path(), Overwrite::Own).unwrap());
        assert_eq!(fs::read(root.path().join("b")).unwrap(), b"new");
        assert!(!root.path().join(INSIDE).exists());
    }

    #[test]
    fn what_was_cut_off_before_is_as_if_it_had_not_been() {
        let root = tempfile::tempdir().unwrap();
        cut_off(root.path());
        fs::remove_file(root.path().join(INSIDE).join(COMMIT)).unwrap();
        drop(OutputSet::new(root.path(), Overwrite::Own).unwrap());
        assert_eq!(fs::read(root.path().join("b")).unwrap(), b"old");
        assert!(!root.path().join(INSIDE).exists());
        // so does a reader, but while somebody is at work
        cut_off(root.path());
        fs::remove_file(root.path().join(INSIDE).join(COMMIT)).unwrap();
        settle(root.path()).unwrap();
        assert_eq!(fs::read(root.path().join("b")).unwrap(), b"old");
        assert!(!root.path().join(INSIDE).exists());
        let work = Work::open(root.path()).unwrap();
        settle(root.path()).unwrap();
        assert!(work.staging().exists());
    }

    #[test]
    fn leftovers_beside_a_result_are_cleared_and_what_is_held_stays() {
        let root = tempfile::tempdir().unwrap();
        let held = Work::open(&root.path().join("held")).unwrap();
        let dead = Work::open(&root.path().join("dead")).unwrap();
        let (held_root, dead_root) = (held.root.clone(), dead.root.clone());
        drop(dead);
        fs::create_dir_all(dead_root.join(NEW)).unwrap();
        fs::write(dead_root.join(LOCK), b"1").unwrap();
        fs::write(root.path().join(".deacal-x1y2z3.part"), b"").unwrap();
        fs::write(root.path().join(format!("{HELD}dead")), b"").unwrap();
        let alive = root.path().join(format!("{HELD}alive"));
        let alive = (File::create(&alive).unwrap(), alive);
        alive.0.try_lock().unwrap();
        fs::write(root.path().join(".deacal.json"), b"{}").unwrap();
        fs::write(root.path().join(".other"), b"").unwrap();
        let mut set = OutputSet::new(root.path().join("one"), Overwrite::Own).unwrap();
        set.write("f", b"1").unwrap();
        set.commit().unwrap();
        assert!(held_root.exists() && !dead_root.exists());
        assert!(alive.1.exists() && !root.path().join(format!("{HELD}dead")).exists());
        // also where the folder has come into being since
        fs::create_dir_all(dead_root.join(NEW)).unwrap();
        fs::write(dead_root.join(LOCK), b"1").unwrap();
        fs::create_dir(root.path().join("dead")).unwrap();
        drop(Work::open(&root.path().join("dead")).unwrap());
        assert!(!dead_root.exists());
        assert!(!root.path().join(".deacal-x1y2z3.part").exists());
        assert!(root.path().join(".deacal.json").exists() && root.path().join(".other").exists());
    }

    #[test]
    fn a_folder_at_which_another_is_at_work_is_refused_with_its_number() {
        let root = tempfile::tempdir().unwrap();
        for dir in [root.path().to_owned(), root.path().join("new")] {
            let held = Work::open(&dir).unwrap();
            let error = Work::open(&dir).unwrap_err();
            assert_eq!(error.cause, Cause::Busy, "{error}");
            let number = std::process::id().to_string();
            assert!(error.to_string().contains(&number), "{error}");
            drop(held);
            drop(Work::open(&dir).unwrap());
        }
    }

    #[test]
    fn a_folder_that_came_into_being_meanwhile_keeps_what_it_has() {
        let root = tempfile::tempdir().unwrap();
        let dir = root.path().join("new");
        let mut set = OutputSet::new(&dir, Overwrite::Own).unwrap();
        set.write("sub/mine", b"1").unwrap();
        fs::create_dir(&dir).unwrap();
        fs::write(dir.join("theirs"), b"2").unwrap();
        set.commit().unwrap();
        assert_eq!(fs::read(dir.join("theirs")).unwrap(), b"2");
        assert_eq!(fs::read(dir.join("sub/mine")).unwrap(), b"1");
        let left: Vec<_> = fs::read_dir(root.path()).unwrap().collect();
        assert_eq!(left.len(), 1);
    }
}
