//! Cases on single coordinates: diagnosed from their recordings alone.

use super::{Trial, compare};
use crate::cases::line::{LineCase, LineCaseRecording};
use crate::dataset::line::Line;
use crate::diagnosis::{Diagnosis, LineEntry, Request, diagnose_lines};
use crate::effects::When;

/// Recordings are taken to be so far apart, s.
const APART_S: f64 = 120.0;

/// Diagnoses a case from its recordings alone: nothing of the answer is looked at.
///
/// # Errors
/// Why there is no diagnosis.
pub fn blind_lines(case: &LineCase) -> Result<Diagnosis, String> {
    let lines = |list: &[LineCaseRecording]| -> Result<Vec<Line>, String> {
        let line = |r: &LineCaseRecording| Line::from_recording(&r.recording);
        let all: Result<_, _> = list.iter().map(line).collect();
        all.map_err(|e| e.to_string())
    };
    let (train, holdout) = (lines(&case.train)?, lines(&case.holdout)?);
    let mut series_s = 0.0;
    let mut entries: Vec<LineEntry> = train
        .iter()
        .chain(&holdout)
        .enumerate()
        .map(|(recording, line)| {
            let when = When {
                recording,
                series_s,
                start_s: line.time_s.first().copied().unwrap_or(0.0),
            };
            series_s += APART_S + line.step_s * line.samples() as f64;
            LineEntry { line, when }
        })
        .collect();
    let held = entries.split_off(train.len());
    diagnose_lines(&entries, &held, &Request::default(), &|_| ()).map_err(|e| e.to_string())
}

/// Diagnoses a case and compares.
pub fn trial_lines(case: &LineCase) -> Trial {
    compare(&case.truth, blind_lines(case))
}
