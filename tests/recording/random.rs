//! No bytes make a reader panic: random ones, and files with random damage.

use std::io::{Cursor, Read, Write};
use std::path::Path;

use deacal::recording::{ColumnRef, Manifest, ReadOptions, Rig, importers, read_file, survey_file};
use proptest::prelude::*;

const NEXUS: &[u8] = include_bytes!("../data/recording/padded.csv");
const SEMICOLON: &[u8] = include_bytes!("../data/recording/semicolon.csv");
const MOTION: &[u8] = include_bytes!("../data/recording/robot/motion.csv");
const VOLTAGE: &[u8] = include_bytes!("../data/recording/robot/voltage.csv");
const TRACKER: &[u8] = include_bytes!("../data/recording/tracker-quaternion.csv");
const MOTIVE: &[u8] = include_bytes!("../data/recording/motive.csv");
const MOTIVE_ROWS: &[u8] = include_bytes!("../data/recording/motive-rows.csv");
const QUALISYS: &[u8] = include_bytes!("../data/recording/qualisys.tsv");
const TRC: &[u8] = include_bytes!("../data/recording/small.trc");
const C3D: &[u8] = include_bytes!("../../fuzz/corpus/c3d/intel-float.c3d");
const C3D_DEC: &[u8] = include_bytes!("../../fuzz/corpus/c3d/dec-whole.c3d");
const GBK: &[u8] = include_bytes!("../data/recording/gbk.csv");
const MCAP: &[u8] = include_bytes!("../data/recording/small.mcap");
const TDMS: &[u8] = include_bytes!("../data/recording/small.tdms");
const LVM: &[u8] = include_bytes!("../data/recording/two_segments.lvm");
const MAT: &[u8] = include_bytes!("../data/recording/small.mat");
const MAT_PLAIN: &[u8] = include_bytes!("../data/recording/plain.mat");
const MAT73: &[u8] = include_bytes!("../data/recording/small73.mat");
const MAT_BIG_ENDIAN: &[u8] = include_bytes!("../data/recording/matlab-6.1-big-endian.mat");
const XLSX: &[u8] = include_bytes!("../data/recording/sheets.xlsx");
const SCOPE: &[u8] = b"X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-1,0.25\n0,1,2,\n1,3,4,\n";
const MANIFEST: &[u8] = include_bytes!("../data/recording/robot/recording.toml");
const RIG: &[u8] = include_bytes!("../data/recording/robot/rig.toml");

/// Every importer, with and without columns asked for, in several encodings: an answer or an error, never a
/// panic. Each column has as many values as the section has rows.
fn all_importers(bytes: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let options = [
        (None, None),
        (None, Some(vec![ColumnRef::Number(1), ColumnRef::Number(3)])),
        (Some("gbk"), Some(vec![ColumnRef::Name("X".to_owned())])),
        (Some("utf-16le"), None),
    ];
    let mut check = |capture: deacal::recording::Capture| {
        for section in &capture.sections {
            for column in &section.columns {
                assert_eq!(column.values.len(), section.rows());
                assert!(column.values.iter().all(|v| !v.is_infinite()));
            }
            // a binary file has no lines
            assert!(section.lines.is_empty() || section.lines.len() == section.rows());
            let _ = section.times_s();
        }
    };
    let _ = read_file(file.path()).map(&mut check);
    let _ = survey_file(file.path(), None, &ReadOptions::default());
    for importer in importers() {
        importer.recognises(bytes, file.path());
        for (encoding, columns) in &options {
            let options = ReadOptions {
                encoding: encoding.map(str::to_owned),
                columns: columns.clone(),
            };
            let _ = importer.read(file.path(), &options).map(&mut check);
        }
    }
}

/// A file with some bytes changed, put in or taken out.
fn damaged(original: &'static [u8]) -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![
        any::<u8>(),
        proptest::sample::select(b"\n\r,;\t \".-0123456789eENXFd=[]{}".to_vec())
    ];
    let edit = (any::<proptest::sample::Index>(), 0..3u8, byte);
    proptest::collection::vec(edit, 0..12).prop_map(move |edits| {
        let mut bytes = original.to_vec();
        for (at, what, byte) in edits {
            let i = at.index(bytes.len().max(1));
            match what {
                0 if i < bytes.len() => bytes[i] = byte,
                1 if i < bytes.len() => drop(bytes.remove(i)),
                _ => bytes.insert(i.min(bytes.len()), byte),
            }
        }
        bytes
    })
}

/// A workbook with a part of it damaged inside the archive, whose sums are right.
fn inside(original: &'static [u8]) -> impl Strategy<Value = Vec<u8>> {
    let mut archive = zip::ZipArchive::new(Cursor::new(original)).unwrap();
    let parts: Vec<(String, &'static [u8])> = (0..archive.len())
        .map(|i| {
            let mut entry = archive.by_index(i).unwrap();
            let mut bytes = Vec::new();
            entry.read_to_end(&mut bytes).unwrap();
            (entry.name().unwrap().into_owned(), &*bytes.leak())
        })
        .collect();
    let which = 0..parts.len();
    which.prop_flat_map(move |hit| {
        let parts = parts.clone();
        damaged(parts[hit].1).prop_map(move |bytes| {
            let mut out = zip::ZipWriter::new(Cursor::new(Vec::new()));
            for (i, (name, whole)) in parts.iter().enumerate() {
                let options = zip::write::SimpleFileOptions::default();
                out.start_file(name.as_str(), options).unwrap();
                out.write_all(if i == hit { &bytes } else { whole })
                    .unwrap();
            }
            out.finish().unwrap().into_inner()
        })
    })
}

fn a_file() -> impl Strategy<Value = Vec<u8>> {
    prop_oneof![
        damaged(NEXUS),
        damaged(SEMICOLON),
        damaged(MOTION),
        damaged(VOLTAGE),
        damaged(GBK),
        damaged(TRACKER),
        damaged(MOTIVE),
        damaged(MOTIVE_ROWS),
        damaged(QUALISYS),
        damaged(TRC),
        damaged(C3D),
        damaged(C3D_DEC),
        damaged(MCAP),
        damaged(TDMS),
        damaged(LVM),
        damaged(MAT),
        damaged(MAT_PLAIN),
        damaged(MAT73),
        damaged(MAT_BIG_ENDIAN),
        damaged(XLSX),
        inside(XLSX),
        damaged(SCOPE),
        proptest::collection::vec(any::<u8>(), 0..600),
        "[-+0-9.,;\t \n\"eE]{0,300}".prop_map(String::into_bytes),
    ]
}

proptest! {
    #[test]
    fn importers_answer(bytes in a_file()) {
        all_importers(&bytes);
    }

    #[test]
    fn manifests_answer(bytes in prop_oneof![damaged(MANIFEST), damaged(RIG), proptest::collection::vec(any::<u8>(), 0..300)]) {
        let text = String::from_utf8_lossy(&bytes);
        for e in [
            Manifest::parse(Path::new("recording.toml"), &text).err(),
            Rig::parse(Path::new("rig.toml"), &text).err(),
        ].into_iter().flatten() {
            prop_assert!(!e.to_string().contains('\n'), "{e}");
        }
    }

    #[test]
    fn recordings_answer(motion in damaged(MOTION), voltage in damaged(VOLTAGE)) {
        let dir = tempfile::tempdir().unwrap();
        let monitor: &[u8] = include_bytes!("../data/recording/robot/monitor.csv");
        for (name, bytes) in [("recording.toml", MANIFEST), ("rig.toml", RIG), ("motion.csv", &motion), ("voltage.csv", &voltage), ("monitor.csv", monitor)] {
            std::fs::write(dir.path().join(name), bytes).unwrap();
        }
        let _ = deacal::recording::Recording::open(dir.path());
    }
}
