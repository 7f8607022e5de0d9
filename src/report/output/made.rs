//! Which files the program made itself: every folder of results has a list of them, `.deacal.json`, each with
//! the SHA-256 of its bytes. What stands in the list with the sum that it still has may be overwritten by the
//! next run; anything else is somebody's work.

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::recording::sha256_of;

/// Name of the list.
pub(super) const NAME: &str = ".deacal.json";

/// The list of one folder.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Made {
    /// What the file is for, for those who open it.
    #[serde(default)]
    about: String,
    /// SHA-256 by name; `/` between folders.
    files: BTreeMap<String, String>,
}

impl Made {
    /// The list in `folder`; empty where there is none that can be read.
    pub(super) fn read(folder: &Path) -> Self {
        let text = fs::read_to_string(folder.join(NAME)).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    }

    /// The list with more files, without those that have gone from `folder`.
    pub(super) fn with(mut self, folder: &Path, files: BTreeMap<String, String>) -> Self {
        self.files.retain(|name, _| folder.join(name).exists());
        self.files.extend(files);
        self.about = "Files that deacal wrote here, with their SHA-256: only these does it overwrite without --force.".into();
        self
    }

    pub(super) fn to_text(&self) -> String {
        crate::report::json::to_text(self)
    }
}

/// What is known of a file that is in the way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// The program made it, and nobody has changed it since.
    Own,
    /// The program made it, and it was changed.
    Changed,
    /// No list names it.
    Foreign,
}

/// The lists that were looked at.
#[derive(Debug, Default)]
pub(super) struct Lists(HashMap<PathBuf, Made>);

impl Lists {
    /// Where the file at `path` comes from, by the lists of its folder and of those above it: a set is listed
    /// in its outermost folder.
    pub(super) fn origin(&mut self, path: &Path) -> Origin {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let mut listed = false;
        let mut own: Option<String> = None;
        for folder in path.ancestors().skip(1) {
            let Ok(inside) = path.strip_prefix(folder) else {
                continue;
            };
            let parts: Vec<_> = inside.iter().map(|p| p.to_string_lossy()).collect();
            let list = self
                .0
                .entry(folder.to_owned())
                .or_insert_with(|| Made::read(folder));
            if let Some(sum) = list.files.get(&parts.join("/")) {
                listed = true;
                let found = own.get_or_insert_with(|| sum_of(&path));
                if sum == found {
                    return Origin::Own;
                }
            }
        }
        if listed {
            Origin::Changed
        } else {
            Origin::Foreign
        }
    }
}

/// SHA-256 of a file; empty where it cannot be read.
pub(super) fn sum_of(path: &Path) -> String {
    File::open(path).and_then(sha256_of).unwrap_or_default()
}
