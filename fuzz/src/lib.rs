//! What every fuzz target does with its bytes.

use std::fs::File;
use std::io::{Seek, Write};
use std::path::PathBuf;
use std::sync::{Mutex, OnceLock};

use deacal::recording::{Capture, ReadOptions, read_file_as, survey_file};

/// One file a process, in memory where there is a file system for that: importers read files.
fn file(data: &[u8]) -> PathBuf {
    static FILE: OnceLock<Mutex<(File, PathBuf)>> = OnceLock::new();
    let mut held = FILE
        .get_or_init(|| {
            let shm = PathBuf::from("/dev/shm");
            let dir = if shm.is_dir() {
                shm
            } else {
                std::env::temp_dir()
            };
            let path = dir.join(format!("deacal-fuzz-{}", std::process::id()));
            Mutex::new((File::create(&path).expect("a file to write to"), path))
        })
        .lock()
        .expect("one thread");
    held.0.rewind().expect("a file");
    held.0.set_len(0).expect("a file");
    held.0.write_all(data).expect("room for a file");
    held.1.clone()
}

/// An answer or an error in one line, never a panic; what is read whole and what is read in batches is the
/// same.
pub fn importer(name: &str, data: &[u8]) {
    let path = file(data);
    let options = ReadOptions::default();
    let read = read_file_as(&path, Some(name), &options);
    let survey = survey_file(&path, Some(name), &options);
    match (read, survey) {
        (Ok(capture), Ok(survey)) => {
            check(&capture);
            assert_eq!(capture.sections.len(), survey.sections.len());
            for (a, b) in capture.sections.iter().zip(&survey.sections) {
                assert_eq!(a.rows(), b.rows);
                assert_eq!(a.columns.len(), b.columns.len());
                for (c, d) in a.columns.iter().zip(&b.columns) {
                    assert_eq!(c.values.iter().filter(|v| v.is_nan()).count(), d.missing);
                }
                for (g, h) in a.groups.iter().zip(&b.groups) {
                    assert_eq!(a.gaps(g.columns.clone()), h.gaps);
                }
            }
        }
        (Err(a), Err(b)) => {
            let (a, b) = (a.to_string(), b.to_string());
            assert_eq!(a, b);
            assert!(!a.contains('\n'), "{a}");
        }
        (a, b) => panic!("read: {:?}, in batches: {:?}", a.err(), b.err()),
    }
}

fn check(capture: &Capture) {
    for section in &capture.sections {
        for column in &section.columns {
            assert_eq!(column.values.len(), section.rows());
            assert!(column.values.iter().all(|v| !v.is_infinite()));
        }
        assert!(section.lines.is_empty() || section.lines.len() == section.rows());
        for group in &section.groups {
            assert!(group.columns.end <= section.columns.len());
        }
        let times = section.times_s().unwrap_or_default();
        assert!(times.iter().all(|t| !t.is_infinite()));
    }
}
