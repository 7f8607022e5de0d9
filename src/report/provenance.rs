//! Where a result comes from: program, command, rig and recordings, each file with the SHA-256 of its bytes.
//! No time of day: the same inputs give the same file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::recording::{Recording, Rig, Role, Source};

/// What a result was made of.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Provenance {
    /// Program and version.
    pub program: String,
    /// The command, as given.
    #[serde(default)]
    pub command: String,
    /// The rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rig: Option<FileSum>,
    /// The recordings, in the order of the command.
    #[serde(default, rename = "recording")]
    pub recordings: Vec<RecordingSum>,
    /// Ids of the rigs, for the head of a page.
    #[serde(skip)]
    pub rig_ids: Vec<String>,
    /// Days on which the recordings began, as far as they state it, for the head of a page.
    #[serde(skip)]
    pub days: Vec<String>,
}

/// A recording and its files.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RecordingSum {
    /// Identity.
    pub id: String,
    /// Its files: manifest first, then what it names.
    pub files: Vec<FileSum>,
}

/// A file that was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct FileSum {
    /// What it is: `manifest`, `rig`, `motion`, `voltage`, `monitor`, ...
    pub role: String,
    /// Its path as it was opened.
    pub file: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
}

/// Adds what is not there yet.
fn once(list: &mut Vec<String>, item: &str) {
    if !list.iter().any(|i| i == item) {
        list.push(item.to_owned());
    }
}

impl FileSum {
    /// From a recording's list of sources.
    #[must_use]
    pub fn of(source: &Source) -> Self {
        FileSum {
            role: source.role.name().to_owned(),
            file: source.path.display().to_string(),
            sha256: source.sha256.clone(),
        }
    }
}

impl Provenance {
    /// This program and a command.
    #[must_use]
    pub fn new(command: impl Into<String>) -> Self {
        Provenance {
            program: concat!("deacal ", env!("CARGO_PKG_VERSION")).to_owned(),
            command: command.into(),
            ..Provenance::default()
        }
    }

    /// Adds a recording. Its rig becomes the rig of the whole, unless that is another file already.
    pub fn add(&mut self, recording: &Recording) {
        match &recording.rig {
            Some(Rig::Robot(rig)) => once(&mut self.rig_ids, &rig.id),
            Some(Rig::FilmSample(rig)) => once(&mut self.rig_ids, &rig.id),
            None => {}
        }
        if let Some(start) = &recording.manifest.start {
            let day = start.text.split(['T', ' ']).next();
            once(&mut self.days, day.unwrap_or_default());
        }
        let mut files = Vec::new();
        for source in &recording.sources {
            let sum = FileSum::of(source);
            if source.role == Role::Rig {
                match &self.rig {
                    None => self.rig = Some(sum),
                    Some(rig) if rig.sha256 == sum.sha256 => {}
                    Some(_) => files.push(sum),
                }
            } else {
                files.push(sum);
            }
        }
        self.recordings.push(RecordingSum {
            id: recording.manifest.id.clone(),
            files,
        });
    }

    /// As [`Provenance::new`], with recordings.
    #[must_use]
    pub fn of<'a>(
        command: impl Into<String>,
        recordings: impl IntoIterator<Item = &'a Recording>,
    ) -> Self {
        let mut out = Provenance::new(command);
        for recording in recordings {
            out.add(recording);
        }
        out
    }
}
