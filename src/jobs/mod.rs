//! Jobs: from recordings and what is asked to results that can be shown and written. The command line and
//! the Python package call them, so that both come to the same numbers, files and words.
//!
//! A job reads what it is given, tells a [`Progress`] how far it is, and puts nothing in place: of what it
//! leaves, [`Files`] are complete in memory, or written by whoever asked.

pub mod ageing;
pub mod diagnose;
pub mod fit;
pub mod load;
pub mod predict;
mod progress;
pub(crate) mod ranges;
pub(crate) mod series;
pub mod simulate;
pub mod validate;
pub mod view;

use std::path::Path;

pub use progress::Progress;

use crate::report::output::{OutputError, OutputSet, Overwrite};

/// Anything that keeps a job from being done: one line that says what, where, and what to do.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// The files of a result, complete and not in place yet: names below a folder, and bytes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Files(Vec<(String, Vec<u8>)>);

impl Files {
    /// Adds a file.
    pub fn add(&mut self, name: impl Into<String>, bytes: impl Into<Vec<u8>>) {
        self.0.push((name.into(), bytes.into()));
    }

    /// The text of a file; `None` where there is no such file, or it is no text.
    #[must_use]
    pub fn text(&self, name: &str) -> Option<&str> {
        let (_, bytes) = self.0.iter().find(|(n, _)| n == name)?;
        std::str::from_utf8(bytes).ok()
    }

    /// The names, in the order in which the files were added.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(|(name, _)| name.as_str())
    }

    /// Writes them for the folder `dir`; [`OutputSet::commit`] puts them in place.
    ///
    /// # Errors
    /// A file may not be overwritten, or cannot be written.
    pub fn stage(&self, dir: &Path, overwrite: Overwrite) -> Result<OutputSet, OutputError> {
        let mut set = OutputSet::new(dir, overwrite)?;
        for (name, bytes) in &self.0 {
            set.write(name, bytes)?;
        }
        Ok(set)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_by_name_and_written_as_they_are() {
        let mut files = Files::default();
        files.add("a.txt", "one");
        files.add("deep/b.bin", [0xff, 0xfe]);
        assert_eq!(files.names().collect::<Vec<_>>(), ["a.txt", "deep/b.bin"]);
        assert_eq!((files.text("a.txt"), files.text("c")), (Some("one"), None));
        assert_eq!(files.text("deep/b.bin"), None);
        let dir = tempfile::tempdir().unwrap();
        let set = files.stage(dir.path(), Overwrite::Own).unwrap();
        assert!(!dir.path().join("a.txt").exists());
        set.commit().unwrap();
        let read = |name: &str| std::fs::read(dir.path().join(name)).unwrap();
        assert_eq!(
            (read("a.txt"), read("deep/b.bin")),
            (b"one".to_vec(), vec![0xff, 0xfe])
        );
    }
}
