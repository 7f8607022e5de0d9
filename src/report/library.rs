//! Parameter sets that come with the program: the folders of `fits/` that have a `library.toml`, which says
//! by hand what the `parameters.toml` beside it is of, where it comes from and how far it goes.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::recording::suggestion;

/// What a path of the library begins with.
const SCHEME: &str = "library:";

/// Name, what is said of it, and the parameter file.
const ENTRIES: &[(&str, &str, &str)] = &[
    (
        "miles2015_vhb4910",
        include_str!("../../fits/miles2015_vhb4910/library.toml"),
        include_str!("../../fits/miles2015_vhb4910/parameters.toml"),
    ),
    (
        "silverbox2013",
        include_str!("../../fits/silverbox2013_official/library.toml"),
        include_str!("../../fits/silverbox2013_official/parameters.toml"),
    ),
    (
        "twin2026_delta",
        include_str!("../../fits/twin2026_delta/library.toml"),
        include_str!("../../fits/twin2026_delta/parameters.toml"),
    ),
];

/// What is said of a parameter set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Its name: `--params library:NAME`.
    #[serde(default)]
    pub name: String,
    /// What it describes.
    pub of: String,
    /// The command that wrote it.
    pub made_by: String,
    /// The recordings that it was fitted to, and who took them.
    pub source: String,
    /// Licence of these recordings and of the numbers.
    pub licence: String,
    /// What was covered: strokes, voltages, rates, lengths.
    pub range: String,
    /// What it does not tell.
    pub beyond: String,
}

/// All parameter sets, by name.
///
/// # Panics
/// When what is said of one cannot be read: it is part of the program.
#[must_use]
pub fn entries() -> Vec<Entry> {
    let entry = |(name, says, _): &(&str, &str, &str)| {
        let read: Entry = toml::from_str(says).unwrap_or_else(|e| panic!("fits/{name}: {e}"));
        Entry {
            name: (*name).to_owned(),
            ..read
        }
    };
    ENTRIES.iter().map(entry).collect()
}

/// The parameter set of a name.
///
/// # Errors
/// There is none: the names that there are.
pub fn find(name: &str) -> Result<Entry, String> {
    let found = entries().into_iter().find(|e| e.name == name);
    found.ok_or_else(|| unknown(name))
}

fn unknown(name: &str) -> String {
    let names: Vec<&str> = ENTRIES.iter().map(|e| e.0).collect();
    format!(
        "the library has no parameter set `{name}`; {}",
        suggestion(name, &names)
    )
}

/// Whether a path names a parameter set of the library: `library:NAME`.
#[must_use]
pub fn is_of_library(path: &Path) -> bool {
    path.to_str().is_some_and(|p| p.starts_with(SCHEME))
}

/// The path under which errors name a parameter set, and its text; `None` where the path is not of the
/// library.
///
/// # Errors
/// There is no set of that name.
pub fn text(path: &Path) -> Option<Result<(PathBuf, &'static str), String>> {
    let name = path.to_str()?.strip_prefix(SCHEME)?;
    let found = ENTRIES.iter().find(|e| e.0 == name);
    let named = found.map(|e| (path.to_owned(), e.2));
    Some(named.ok_or_else(|| unknown(name)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::parameter_file::ParameterFile;

    #[test]
    fn every_set_is_read_and_says_how_it_was_made() {
        for e in entries() {
            let path = PathBuf::from(format!("library:{}", e.name));
            let (path, text) = text(&path).unwrap().unwrap();
            let file = ParameterFile::parse(&path, text).unwrap();
            assert!(file.provenance.command.starts_with("deacal "), "{}", e.name);
            assert!(!file.provenance.recordings.is_empty(), "{}", e.name);
            assert!(e.made_by.starts_with("deacal "), "{}", e.name);
        }
    }

    #[test]
    fn names_that_are_not_there_are_answered_with_those_that_are() {
        let why = text(Path::new("library:twin")).unwrap().unwrap_err();
        assert!(why.contains("twin2026_delta"), "{why}");
        assert!(text(Path::new("out/parameters.toml")).is_none());
    }
}
