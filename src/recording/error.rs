//! One error for the whole room: where, what was found, what was expected, what to do.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// What kind of trouble a file gave. The sentence is in [`Error`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// No such file or folder.
    NotFound,
    /// The file is there and may not be read.
    NoPermission,
    /// Any other failure of the file system.
    Io,
    /// A `.toml` file is not TOML.
    Toml,
    /// A key or a table that is not known.
    UnknownKey,
    /// A key or a table that has to be there.
    MissingKey,
    /// A key with a value of another type.
    WrongType,
    /// A value of the right type that cannot be: a negative length, two channels for three chains.
    BadValue,
    /// No importer knows the file.
    UnknownFormat,
    /// Bytes that are no text in the declared encoding, or an encoding that is not known.
    Encoding,
    /// A line longer than [`crate::recording::text::MAX_LINE_BYTES`].
    LineTooLong,
    /// Nothing in the file.
    Empty,
    /// A header and no data below it.
    NoData,
    /// The rows of a file do not follow the format's grammar.
    Grammar,
    /// A cell that is no number.
    BadNumber,
    /// A cell that says NaN or infinity.
    NotFinite,
    /// A row with too few or too many cells.
    CellCount,
    /// A time or a frame number that steps back, stands still or leaps.
    TimeOrder,
    /// A marker that is not in the file.
    UnknownMarker,
    /// A column that is not in the file.
    UnknownColumn,
    /// A name that fits several markers or columns.
    Ambiguous,
    /// A unit that is not known, or contradicts the manifest.
    WrongUnit,
    /// A marker that is in the file and never seen.
    MissingThroughout,
}

/// What is wrong with a file, in one line: file, line and column (or key), both values, and what to do.
///
/// Lines and columns count from 1; a column is a cell of the row, as a spreadsheet counts.
#[derive(Debug, thiserror::Error)]
#[error("{}", Sentence(self))]
pub struct Error {
    kind: ErrorKind,
    detail: Box<Detail>,
    #[source]
    source: Option<io::Error>,
}

#[derive(Debug, Default)]
struct Detail {
    path: PathBuf,
    line: Option<u64>,
    column: Option<usize>,
    key: String,
    found: String,
    expected: String,
    action: String,
}

struct Sentence<'a>(&'a Error);

impl fmt::Display for Sentence<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let d = &self.0.detail;
        write!(f, "{}", one_line(d.path.display().to_string()))?;
        self.0.behind_path(f)
    }
}

impl Error {
    /// The sentence behind the file's name.
    fn behind_path(&self, f: &mut impl fmt::Write) -> fmt::Result {
        let d = &self.detail;
        if let Some(line) = d.line {
            write!(f, ", line {line}")?;
        }
        if let Some(column) = d.column {
            write!(f, ", column {column}")?;
        }
        if !d.key.is_empty() {
            write!(f, ", {}", one_line(&d.key))?;
        }
        write!(f, ": {}", one_line(&d.found))?;
        if !d.expected.is_empty() {
            write!(f, ", expected {}", one_line(&d.expected))?;
        }
        if !d.action.is_empty() {
            write!(f, "; {}", one_line(&d.action))?;
        }
        Ok(())
    }

    /// The sentence without the file's name: `line 3: found "x", ...`.
    #[must_use]
    pub fn without_path(&self) -> String {
        let mut text = String::new();
        // writing to a text does not fail
        let _ = self.behind_path(&mut text);
        text.trim_start_matches([',', ':', ' ']).to_owned()
    }

    /// An error about a file: `found` says what is there.
    #[must_use]
    pub fn new(kind: ErrorKind, path: &Path, found: impl Into<String>) -> Self {
        Error {
            kind,
            detail: Box::new(Detail {
                path: path.to_owned(),
                found: found.into(),
                ..Detail::default()
            }),
            source: None,
        }
    }

    /// What the file system said.
    #[must_use]
    pub fn io(path: &Path, error: io::Error) -> Self {
        let (kind, found, action) = match error.kind() {
            io::ErrorKind::NotFound => (
                ErrorKind::NotFound,
                "no such file".to_owned(),
                "check the name; paths are relative to the file that names them",
            ),
            io::ErrorKind::PermissionDenied => (
                ErrorKind::NoPermission,
                "may not be read (permission denied)".to_owned(),
                "give yourself the right to read it",
            ),
            io::ErrorKind::IsADirectory => (
                ErrorKind::Io,
                "is a folder, not a file".to_owned(),
                "name the file inside it",
            ),
            _ => (ErrorKind::Io, format!("cannot be read: {error}"), ""),
        };
        let mut e = Error::new(kind, path, found).action(action);
        e.source = Some(error);
        e
    }

    /// The line of the file, from 1; 0 for a file without lines.
    #[must_use]
    pub fn at_line(mut self, line: u64) -> Self {
        self.detail.line = (line > 0).then_some(line);
        self
    }

    /// The cell of the row, from 1.
    #[must_use]
    pub fn at_column(mut self, column: usize) -> Self {
        self.detail.column = Some(column);
        self
    }

    /// The key of a `.toml` file, `[voltage] unit`.
    #[must_use]
    pub fn at_key(mut self, key: impl Into<String>) -> Self {
        self.detail.key = key.into();
        self
    }

    /// What would have been right.
    #[must_use]
    pub fn expected(mut self, expected: impl Into<String>) -> Self {
        self.detail.expected = expected.into();
        self
    }

    /// What the user can do.
    #[must_use]
    pub fn action(mut self, action: impl Into<String>) -> Self {
        self.detail.action = action.into();
        self
    }

    /// The kind of trouble.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.detail.path
    }

    /// The line, from 1, where one is to blame.
    #[must_use]
    pub fn line(&self) -> Option<u64> {
        self.detail.line
    }

    /// The cell of the row, from 1, where one is to blame.
    #[must_use]
    pub fn column(&self) -> Option<usize> {
        self.detail.column
    }

    /// The key of a `.toml` file, empty where none is to blame.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.detail.key
    }
}

/// Of `known`, the name nearest to `name`, if one is near at all.
#[must_use]
pub fn nearest<'a, S: AsRef<str>>(name: &str, known: &'a [S]) -> Option<&'a str> {
    let lower = name.to_lowercase();
    known
        .iter()
        .map(AsRef::as_ref)
        .map(|k| (strsim::jaro_winkler(&lower, &k.to_lowercase()), k))
        .filter(|(similarity, _)| *similarity > 0.6)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, k)| k)
}

/// "did you mean X?; known: A, B, C" for an unknown name: the nearest, and a list cut at 40 names.
#[must_use]
pub fn suggestion<S: AsRef<str>>(name: &str, known: &[S]) -> String {
    const MOST: usize = 40;
    if known.is_empty() {
        return "there are none".to_owned();
    }
    let mut list: Vec<&str> = known.iter().take(MOST).map(AsRef::as_ref).collect();
    let more;
    if known.len() > MOST {
        more = format!("and {} more", known.len() - MOST);
        list.push(&more);
    }
    let list = list.join(", ");
    match nearest(name, known) {
        Some(near) => format!("did you mean \"{near}\"? There are: {list}"),
        None => format!("there are: {list}"),
    }
}

/// A text safe to print in one line: names in a file may hold line ends.
#[must_use]
pub fn one_line(text: impl Into<String>) -> String {
    let text = text.into();
    match text.contains(char::is_control) {
        true => text.replace(char::is_control, "\u{fffd}"),
        false => text,
    }
}

/// A short quotation of what a file says, safe to print in one line.
#[must_use]
pub fn quote(text: &str) -> String {
    const MOST: usize = 40;
    let mut out = one_line(text.chars().take(MOST).collect::<String>());
    if text.chars().nth(MOST).is_some() {
        out.push_str("...");
    }
    format!("\"{out}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_line_with_place_values_and_action() {
        let e = Error::new(
            ErrorKind::BadNumber,
            Path::new("a/motion.csv"),
            "found \"x\"",
        )
        .at_line(12)
        .at_column(3)
        .expected("a number")
        .action("correct the cell");
        assert_eq!(
            e.to_string(),
            "a/motion.csv, line 12, column 3: found \"x\", expected a number; correct the cell"
        );
    }

    #[test]
    fn names_with_line_ends_stay_in_one_line() {
        let e =
            Error::new(ErrorKind::Grammar, Path::new("a\nb"), "no topic MCAP0\r\n").action("c\td");
        assert!(!e.to_string().contains(char::is_control), "{e:?}");
    }

    #[test]
    fn permission_denied_says_so() {
        let e = Error::io(Path::new("x"), io::ErrorKind::PermissionDenied.into());
        assert_eq!(e.kind(), ErrorKind::NoPermission);
        assert!(e.to_string().contains("permission denied"));
    }

    #[test]
    fn nearest_is_near_or_nothing() {
        let known = ["end_effector", "base", "file"];
        assert_eq!(nearest("end_efector", &known), Some("end_effector"));
        assert_eq!(nearest("FILE", &known), Some("file"));
        assert_eq!(nearest("zzz", &known), None);
    }
}
