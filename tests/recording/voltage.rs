//! Voltage logs: LVM, TDMS and oscilloscopes, real ones against what other readers found (in the folder that
//! `DEACAL_SHARED` names; without it those tests say that they are skipped) and small ones made by hand.

use std::io::Write;
use std::path::{Path, PathBuf};

use deacal::recording::{
    Capture, ColumnRef, Error, ErrorKind, Level, ReadOptions, Recording, read_file, read_file_as,
    survey_file,
};
use deacal::report::survey::{lines, manifest};
use serde_json::Value;

fn shared() -> Option<PathBuf> {
    let Some(root) = std::env::var_os("DEACAL_SHARED") else {
        eprintln!("skipped: DEACAL_SHARED is not set");
        return None;
    };
    let path = Path::new(&root).join("datasets/formats/voltage");
    path.is_dir().then_some(path)
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/recording")
        .join(name)
}

fn expectation(path: &Path) -> Value {
    let text = std::fs::read_to_string(format!("{}.expect.json", path.display())).unwrap();
    serde_json::from_str(&text.replace("NaN", "null")).unwrap()
}

/// Files of the folder whose name fits.
fn named(folder: &Path, fits: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| fits(&p.file_name().unwrap().to_string_lossy()))
        .collect();
    all.sort();
    all
}

fn mean(values: &[f64]) -> f64 {
    let seen: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    seen.iter().sum::<f64>() / seen.len() as f64
}

#[track_caller]
fn close(found: f64, wanted: f64, relative: f64) {
    assert!(
        (found - wanted).abs() <= relative * wanted.abs().max(1e-9),
        "{found}, expected {wanted}"
    );
}

fn read(bytes: impl AsRef<[u8]>) -> Result<Capture, Error> {
    let mut file = tempfile::Builder::new().suffix(".csv").tempfile().unwrap();
    file.write_all(bytes.as_ref()).unwrap();
    read_file(file.path())
}

/// Time and values of every channel in the order of the file: (name, unit, times, values).
/// Number of the section, label, unit, times where it has its own, values.
type Channel<'a> = (usize, &'a str, &'a str, Option<&'a Vec<f64>>, &'a Vec<f64>);

fn channels(capture: &Capture) -> Vec<Channel<'_>> {
    let mut all: Vec<_> = capture
        .sections
        .iter()
        .flat_map(|s| {
            s.columns.iter().map(|c| {
                let times = s.stamps_s.as_ref();
                (c.number, c.axis.as_str(), c.unit.as_str(), times, &c.values)
            })
        })
        .collect();
    all.sort_by_key(|c| c.0);
    all
}

#[test]
fn every_lvm_file() {
    let Some(folder) = shared() else { return };
    let files = named(&folder, |n| n.ends_with(".lvm"));
    assert!(files.len() >= 4);
    for path in files {
        let expected = expectation(&path);
        let capture = read_file(&path).unwrap();
        assert_eq!(capture.format, "lvm");
        let found = channels(&capture);
        let multi = expected["x_columns"] == "Multi";
        let one = expected["x_columns"] == "One";
        let names: Vec<&str> = expected["names"]
            .as_array()
            .unwrap()
            .iter()
            .map(|n| n.as_str().unwrap())
            .filter(|n| !matches!(*n, "X_Value" | "Comment"))
            .collect();
        let own: Vec<&str> = found.iter().map(|c| c.1).collect();
        assert_eq!(own.len(), names.len(), "{}", path.display());
        for (own, name) in own.iter().zip(&names) {
            // other letters than ASCII were dropped by the other reader
            let ascii: String = own.chars().filter(char::is_ascii).collect();
            let wanted: String = name.chars().filter(char::is_ascii).collect();
            assert_eq!(ascii, wanted);
        }
        for (key, last) in [("first_row", false), ("last_row", true)] {
            let row: Vec<f64> = expected[key]
                .as_array()
                .unwrap()
                .iter()
                .filter_map(Value::as_f64)
                .collect();
            let mut mine = Vec::new();
            for (i, (_, _, _, times, values)) in found.iter().enumerate() {
                assert_eq!(values.len() as u64, expected["rows"].as_u64().unwrap());
                let at = if last { values.len() - 1 } else { 0 };
                if multi || (one && i == 0) {
                    mine.push(times.unwrap()[at]);
                }
                mine.push(values[at]);
            }
            assert_eq!(mine, row, "{} {key}", path.display());
        }
        if !one && !multi {
            let times = found[0].3.unwrap();
            close(
                times[1] - times[0],
                expected["delta_x"][0].as_f64().unwrap(),
                1e-12,
            );
        }
    }
}

#[test]
fn every_tdms_file() {
    let Some(folder) = shared() else { return };
    let files = named(&folder, |n| n.ends_with(".tdms"));
    assert!(files.len() >= 3);
    for path in files {
        let expected = expectation(&path);
        let capture = read_file(&path).unwrap();
        for c in expected["channels"].as_array().unwrap() {
            let (group, name) = (c["group"].as_str().unwrap(), c["name"].as_str().unwrap());
            let what = format!("{} {group}/{name}", path.display());
            let section = capture
                .sections
                .iter()
                .find(|s| s.column(group, name).is_some())
                .unwrap_or_else(|| panic!("{what} is missing"));
            let column = section.column(group, name).unwrap();
            let number = |key: &str| -> f64 { c[key].as_str().unwrap().parse().unwrap() };
            assert_eq!(
                column.values.len() as u64,
                c["n"].as_u64().unwrap(),
                "{what}"
            );
            assert_eq!(column.values[0], number("first"), "{what}");
            assert_eq!(*column.values.last().unwrap(), number("last"), "{what}");
            let expected_mean = c["mean"].as_f64().unwrap();
            assert!(
                (mean(&column.values) - expected_mean).abs() < 1e-8 * expected_mean.abs().max(1e-3)
            );
            if let Some(step) = c["props"]["wf_increment"].as_str() {
                let times = section.stamps_s.as_ref().unwrap();
                close(times[1] - times[0], step.parse().unwrap(), 1e-9);
            }
            if let Some(unit) = c["props"]["unit_string"].as_str() {
                assert_eq!(column.unit, unit);
            }
        }
    }
}

#[test]
fn every_oscilloscope_file() {
    let Some(folder) = shared() else { return };
    let read = |name: &str| -> Option<(Capture, Value)> {
        let path = folder.join(name);
        path.is_file()
            .then(|| (read_file(&path).unwrap(), expectation(&path)))
    };
    let mut files = 0;
    if let Some((capture, expected)) = read("tek_TBS1052B_F0002CH1.CSV") {
        files += 1;
        let found = channels(&capture);
        let (_, name, unit, times, values) = found[0];
        assert_eq!((capture.format, name, unit), ("tektronix-csv", "CH1", "V"));
        assert_eq!(values.len() as u64, expected["rows"].as_u64().unwrap());
        for (key, at) in [("first", 0), ("last", values.len() - 1)] {
            assert_eq!(times.unwrap()[at], expected[key][0].as_f64().unwrap());
            assert_eq!(values[at], expected[key][1].as_f64().unwrap());
        }
        close(mean(values), expected["mean_V"].as_f64().unwrap(), 1e-8);
    }
    for (name, format) in [
        ("keysight_scope_0.csv", "keysight-csv"),
        ("rigol_DS1054Z-A.csv", "rigol-csv"),
        ("rigol_DS1102E-B.csv", "rigol-csv"),
        ("rigol_DS1204B_first1000.csv", "rigol-csv"),
    ] {
        let Some((capture, expected)) = read(name) else {
            continue;
        };
        files += 1;
        assert_eq!(capture.format, format);
        let found = channels(&capture);
        let rows = found[0].4.len();
        assert_eq!(rows as u64, expected["rows"].as_u64().unwrap(), "{name}");
        let start = expected["start"]
            .as_f64()
            .zip(expected["increment"].as_f64());
        for (key, at) in [("first_row", 0), ("last_row", rows - 1)] {
            let row = expected[key].as_array().unwrap();
            let first = row[0].as_f64().unwrap();
            let time = start.map_or(first, |(start, step)| start + first * step);
            assert_eq!(found[0].3.unwrap()[at], time, "{name}");
            assert_eq!(found.len(), row.len() - 1, "{name}");
            for (c, wanted) in found.iter().zip(&row[1..]) {
                assert_eq!((Some(c.4[at]), c.2), (wanted.as_f64(), "V"), "{name}");
            }
        }
        for (c, wanted) in found
            .iter()
            .zip(&expected["means"].as_array().unwrap()[1..])
        {
            close(mean(c.4), wanted.as_f64().unwrap(), 1e-8);
        }
    }
    if let Some((capture, expected)) = read("rs_rtp_01.Wfm.csv") {
        files += 1;
        let found = channels(&capture);
        let values = found[0].4;
        assert_eq!(capture.format, "rohde-schwarz-csv");
        assert_eq!(values.len() as u64, expected["rows"].as_u64().unwrap());
        assert_eq!(Some(values[0]), expected["first"].as_f64());
        assert_eq!(values.last().copied(), expected["last"].as_f64());
        assert_eq!(found[0].3, None);
        assert!(
            capture
                .notes
                .iter()
                .any(|n| n.text.contains("rs_rtp_01.csv"))
        );
    }
    // edited by a person: no header, three pairs side by side, empty columns between
    let path = folder.join("tek_F0000CH1_edited_3traces.CSV");
    if path.is_file() {
        files += 1;
        let expected = expectation(&path);
        let e = read_file(&path).unwrap_err();
        assert!(e.to_string().contains("no header row"), "{e}");
        let options = ReadOptions {
            columns: Some([1, 2, 4, 5, 7, 8].map(ColumnRef::Number).to_vec()),
            ..ReadOptions::default()
        };
        let capture = read_file_as(&path, None, &options).unwrap();
        for (c, i) in capture.sections[0].columns.iter().zip(0..) {
            assert_eq!(c.values.len(), 2500);
            assert_eq!(Some(c.values[0]), expected["first_row"][i].as_f64());
            assert_eq!(Some(c.values[2499]), expected["last_row"][i].as_f64());
            close(
                mean(&c.values),
                expected["means"][i].as_f64().unwrap(),
                1e-8,
            );
        }
    }
    assert!(files >= 6, "{files}");
}

// Small files.

#[test]
fn lvm_segments_clocks_commas_and_comments() {
    let capture = read_file(&data("two_segments.lvm")).unwrap();
    let found = channels(&capture);
    let names: Vec<(&str, &str)> = found.iter().map(|c| (c.1, c.2)).collect();
    assert_eq!(
        names,
        [("monitor", "V"), ("weg \u{b5}m", "mm"), ("second", "V")]
    );
    assert_eq!(found[0].3.unwrap()[..], [0.0, 0.5, 1.0]);
    assert_eq!(found[1].3.unwrap()[..], [0.0, 0.25, 0.5]);
    assert_eq!(found[0].4[..], [1.5, 2.5, 3.5]);
    assert!(found[1].4[1].is_nan());
    assert_eq!(found[2].3.unwrap()[..], [10.0, 10.5]);
    let said = |text: &str| capture.notes.iter().any(|n| n.text.contains(text));
    assert!(said("Latin-1") && said("1 comments") && said("9 samples, 2 rows"));
    let cut = std::fs::read(data("two_segments.lvm")).unwrap();
    for length in 0..cut.len() {
        let _ = read(&cut[..length]);
    }
    let e = read("LabVIEW Measurement\t\nSeparator\tTab\n").unwrap_err();
    assert_eq!(e.kind(), ErrorKind::NoData);
}

#[test]
fn tdms_segments_types_scales_and_texts() {
    let capture = read_file(&data("small.tdms")).unwrap();
    let found = channels(&capture);
    let of = |name: &str| found.iter().find(|c| c.1 == name).unwrap();
    assert_eq!(of("monitor").4[..], [0.5, 1.5, -2.5, 4.0]);
    assert_eq!((of("monitor").2, of("monitor").3.unwrap()[1]), ("V", 0.51));
    assert_eq!(of("counts").4[..], [1.0, -2.0, 300.0, 5.0]);
    assert_eq!(of("scaled").4[..], [1.25, 1.5]);
    assert!(
        capture
            .notes
            .iter()
            .any(|n| n.text.contains("left out: words"))
    );
    // monitor and counts share a clock
    assert_eq!(capture.sections[0].columns.len(), 2);
    let whole = std::fs::read(data("small.tdms")).unwrap();
    let mut last = 0;
    for length in 0..whole.len() {
        if let Ok(c) = read(&whole[..length]) {
            let rows: usize = c.sections.iter().map(|s| s.rows() * s.columns.len()).sum();
            assert!(rows >= last, "{length}: {rows} values after {last}");
            last = rows;
        }
    }
    // every word as large as can be: no length is believed
    for at in 0..whole.len() - 8 {
        let mut bytes = whole.clone();
        bytes[at..at + 8].fill(0xff);
        let _ = read(&bytes);
    }
}

/// A TDMS segment: contents, metadata, raw data.
fn segment(contents: u32, big: bool, meta: &[u8], raw: &[u8]) -> Vec<u8> {
    let long = |v: u64| {
        if big {
            v.to_be_bytes()
        } else {
            v.to_le_bytes()
        }
    };
    let contents = contents | if big { 1 << 6 } else { 0 };
    let version = 4713u32;
    let mut out = b"TDSm".to_vec();
    out.extend(contents.to_le_bytes());
    out.extend(if big {
        version.to_be_bytes()
    } else {
        version.to_le_bytes()
    });
    out.extend(long((meta.len() + raw.len()) as u64));
    out.extend(long(meta.len() as u64));
    out.extend(meta);
    out.extend(raw);
    out
}

#[test]
fn tdms_interleaved_in_both_byte_orders_and_changed_lists() {
    for big in [false, true] {
        let int = |v: u32| {
            if big {
                v.to_be_bytes()
            } else {
                v.to_le_bytes()
            }
        };
        let text = |t: &str| [&int(t.len() as u32)[..], t.as_bytes()].concat();
        let object = |path: &str, kind: u32, count: u64| {
            let mut o = text(path);
            o.extend(int(20));
            o.extend(int(kind));
            o.extend(int(1));
            o.extend(if big {
                count.to_be_bytes()
            } else {
                count.to_le_bytes()
            });
            o.extend(int(0));
            o
        };
        let mut meta = int(2).to_vec();
        meta.extend(object("/'g'/'a'", 10, 2));
        meta.extend(object("/'g'/'b'", 3, 2));
        let row = |a: f64, b: i32| {
            let (a, b) = if big {
                (a.to_be_bytes(), b.to_be_bytes())
            } else {
                (a.to_le_bytes(), b.to_le_bytes())
            };
            [&a[..], &b].concat()
        };
        let (meta_bit, new_list, raw_bit, interleaved) = (2, 4, 8, 32);
        let mut file = segment(
            meta_bit | new_list | raw_bit | interleaved,
            big,
            &meta,
            &[row(1.5, -1), row(2.5, -2)].concat(),
        );
        // no metadata: the same again; then `a` alone, as before, not interleaved
        file.extend(segment(raw_bit | interleaved, big, &[], &row(3.5, -3)));
        let mut only_a = int(1).to_vec();
        only_a.extend(text("/'g'/'a'"));
        only_a.extend(int(0));
        only_a.extend(int(0));
        let two = [row(4.5, 0)[..8].to_vec(), row(5.5, 0)[..8].to_vec()].concat();
        file.extend(segment(meta_bit | new_list | raw_bit, big, &only_a, &two));
        let capture = read(&file).unwrap();
        let found = channels(&capture);
        assert_eq!(found[0].4[..], [1.5, 2.5, 3.5, 4.5, 5.5], "{big}");
        assert_eq!(found[1].4[..], [-1.0, -2.0, -3.0], "{big}");
    }
}

#[test]
fn tdms_texts_and_clocks_beyond_all_numbers() {
    let text = |t: &str| [&(t.len() as u32).to_le_bytes()[..], t.as_bytes()].concat();
    let object = |path: &str, kind: u32, count: u64, bytes: &[u8]| {
        let mut o = text(path);
        o.extend((20 + bytes.len() as u32).to_le_bytes());
        o.extend(kind.to_le_bytes());
        o.extend(1u32.to_le_bytes());
        o.extend(count.to_le_bytes());
        o.extend(bytes);
        o
    };
    // twice 2^63 texts are 2^64, and the last time is 0 + 2 * 1e308
    let mut meta = 2u32.to_le_bytes().to_vec();
    meta.extend(object("/'g'/'a'", 10, 1, &[]));
    meta.extend(1u32.to_le_bytes());
    meta.extend(text("wf_increment"));
    meta.extend(10u32.to_le_bytes());
    meta.extend(1e308f64.to_le_bytes());
    meta.extend(object("/'g'/'t'", 32, 1 << 63, &4u64.to_le_bytes()));
    meta.extend(0u32.to_le_bytes());
    let raw = [&1.5f64.to_le_bytes()[..], &[0; 4]].concat();
    let mut file = segment(2 | 4 | 8, false, &meta, &raw);
    file.extend(segment(8, false, &[], &raw));
    let capture = read(&file).unwrap();
    assert_eq!(channels(&capture)[0].4[..], [1.5, 1.5]);
    assert_eq!(capture.sections[0].stamps_s, None);
    assert!(
        capture
            .notes
            .iter()
            .any(|n| n.text.contains("without numbers are left out: t"))
    );
}

/// A clock that was never set says the beginning of 1904.
#[test]
fn a_waveform_starts_at_a_date_or_is_not_said_to() {
    let text = |t: &str| [&(t.len() as u32).to_le_bytes()[..], t.as_bytes()].concat();
    let file = |since_1904_s: i64| {
        let mut meta = 1u32.to_le_bytes().to_vec();
        meta.extend(text("/'g'/'a'"));
        meta.extend(20u32.to_le_bytes());
        meta.extend(10u32.to_le_bytes());
        meta.extend(1u32.to_le_bytes());
        meta.extend(2u64.to_le_bytes());
        meta.extend(2u32.to_le_bytes());
        meta.extend(text("wf_increment"));
        meta.extend(10u32.to_le_bytes());
        meta.extend(0.5f64.to_le_bytes());
        meta.extend(text("wf_start_time"));
        meta.extend(0x44u32.to_le_bytes());
        meta.extend(0u64.to_le_bytes());
        meta.extend(since_1904_s.to_le_bytes());
        segment(
            2 | 4 | 8,
            false,
            &meta,
            &[1f64.to_le_bytes(), 2f64.to_le_bytes()].concat(),
        )
    };
    let starts = |since_1904_s: i64| -> Vec<String> {
        let capture = read(file(since_1904_s)).unwrap();
        assert_eq!(
            capture.sections[0].stamps_s.as_deref(),
            Some(&[0.0, 0.5][..])
        );
        let notes = capture.notes.into_iter().map(|n| n.text);
        notes.filter(|t| t.contains("starts at")).collect()
    };
    assert_eq!(starts(0), Vec::<String>::new());
    let said = starts(2_082_844_800 + 1_347_044_303);
    assert!(said[0].contains("2012-09-07 18:58:23 UTC"), "{said:?}");
}

#[test]
fn oscilloscopes_by_hand() {
    let tek =
        "Record Length,2,,  0.5,  1.5,\r\nSample Interval,0.5,,  1.0,  -2.5,\r\nSource,CH2,,1.5\n";
    // the third row lacks its value and is not the last
    assert_eq!(read(format!("{tek}x")).unwrap_err().line(), Some(3));
    let tek = "Record Length,3,,0.5,1.5,\nSample Interval,5,,1,-2.5,\nHorizontal Units,ms,,1.5,3,\nSource,CH2,,2,4,\n";
    let capture = read(tek).unwrap();
    let found = channels(&capture);
    assert_eq!((found[0].1, found[0].3.unwrap()[0]), ("CH2", 0.5e-3));
    assert!(
        capture
            .notes
            .iter()
            .any(|n| n.text.contains("3 samples, 4 are there"))
    );
    let rigol = "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-1,0.25\n0,1,2,\n1,3,4,\n3,5";
    let capture = read(rigol).unwrap();
    let found = channels(&capture);
    assert_eq!(found[1].3.unwrap()[..], [-1.0, -0.75]);
    assert_eq!(found[1].4[..], [2.0, 4.0]);
    assert!(
        capture
            .notes
            .iter()
            .any(|n| n.text.contains("middle of a row"))
    );
    let e = read("X,CH1,Start,Increment,\nSequence,Volt,x,0.25\n0,1,\n").unwrap_err();
    assert_eq!(e.kind(), ErrorKind::BadNumber);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.Wfm.csv");
    std::fs::write(&path, "1\n2\n3\n4\n").unwrap();
    assert_eq!(read_file(&path).unwrap().sections[0].stamps_s, None);
    let header = dir.path().join("run.csv");
    std::fs::write(&header, "XStart:-0.5:\nXStop:1.5:\n").unwrap();
    let times = read_file(&path).unwrap().sections[0]
        .stamps_s
        .clone()
        .unwrap();
    assert_eq!(times, [-0.5, 0.0, 0.5, 1.0]);
    for header_text in ["XStart:-0.5:\n", "XStart:-inf:\nXStop:inf:\n"] {
        std::fs::write(&header, header_text).unwrap();
        assert!(read_file(&path).unwrap_err().to_string().contains("XStop"));
    }
}

/// A file that has fewer samples than its header says: it is said, and those that are there keep their times.
#[test]
fn samples_that_are_declared_and_missing_are_said() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.Wfm.csv");
    std::fs::write(&path, "1\n2\n3\n4\n").unwrap();
    let said = |capture: &Capture, text: &str| {
        capture
            .notes
            .iter()
            .any(|n| n.level == Level::Warning && n.text.contains(text))
    };
    for (lengths, cut) in [
        ("RecordLength:8:\n", true),
        ("RecordLength:10:\nSignalRecordLength:8:\n", true),
        ("SignalRecordLength:4:\nRecordLength:10:\n", false),
    ] {
        let header = format!("XStart:-0.5:\nXStop:1.5:\n{lengths}");
        std::fs::write(dir.path().join("run.csv"), header).unwrap();
        let capture = read_file(&path).unwrap();
        let times = capture.sections[0].stamps_s.clone().unwrap();
        let wanted = if cut {
            [-0.5, -0.25, 0.0, 0.25]
        } else {
            [-0.5, 0.0, 0.5, 1.0]
        };
        assert_eq!(times, wanted, "{lengths}");
        assert_eq!(
            said(&capture, "says 8 samples, 4 are there"),
            cut,
            "{lengths}"
        );
    }
    let lvm = |samples: u32| {
        format!(
            "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tOne\n***End_of_Header***\t\n\nChannels\t1\nSamples\t{samples}\n\
             Y_Unit_Label\tV\n***End_of_Header***\nX_Value\tu\tComment\n0.0\t1\t\n0.5\t2\t\n1.0\t4\t\n"
        )
    };
    let capture = read(lvm(51_200)).unwrap();
    assert!(
        said(&capture, "says 51200 samples, 3 rows"),
        "{:?}",
        capture.notes
    );
    // rows that were written one by one below one header
    assert!(!said(&read(lvm(1)).unwrap(), "samples"));
}

/// The start that `deacal import --init` writes says the clock that a file has, and makes none up.
#[test]
fn a_start_has_the_clock_of_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let start = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        let options = ReadOptions {
            columns: Some(Vec::new()),
            ..ReadOptions::default()
        };
        let survey = survey_file(&path, None, &options).unwrap();
        let lines = lines(&path, &survey).join("\n");
        (manifest("run", &[(name.to_owned(), &survey)]), lines)
    };
    let open = |start: &str| {
        let text = start.lines().find(|l| l.starts_with("kind")).unwrap();
        // a start for voltages alone, made a whole recording by a motion
        let motion = "[motion]\nfile = \"motion.csv\"\nend_effector = \"EE\"\ntime = \"t_s\"\n";
        std::fs::write(
            dir.path().join("motion.csv"),
            "t_s,EE_x_mm,EE_y_mm,EE_z_mm\n0,1,2,3\n1,1,2,3\n",
        )
        .unwrap();
        std::fs::copy(
            Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recording/robot/rig.toml"),
            dir.path().join("rig.toml"),
        )
        .unwrap();
        let start = start.replacen(text, "kind = \"robot\"", 1).replacen(
            "[voltage]",
            &format!("{motion}[voltage]"),
            1,
        );
        std::fs::write(dir.path().join("recording.toml"), start).unwrap();
        Recording::open(dir.path()).unwrap().voltage.unwrap()
    };

    // a scope that states its own clock, as fast as scopes are
    let (text, said) = start(
        "scope.csv",
        "X,CH1,CH2,CH3,Start,Increment,\nSequence,Volt,Volt,Volt,-3e-7,5e-10\n0,1,2,30,\n1,3,4,50,\n2,3,4,60,\n",
    );
    assert!(
        said.contains("3 rows at 2.000e9 Hz, -300.0 to -299.0 ns"),
        "{said}"
    );
    assert!(
        !text.contains("rate_hz") && text.contains("the file's own, 2.000e9 Hz"),
        "{text}"
    );
    let v = open(&text);
    assert!((v.time_s[1] - -2.995e-7).abs() < 1e-20 && v.channels[2] == [30.0, 50.0, 60.0]);

    // LVM: X0 and Delta_X; two channels of one name
    let lvm = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\n\nChannels\t3\nSamples\t3\t3\t3\n\
         Y_Unit_Label\tVolts\tVolts\tVolts\nX0\t0\t0\t0\nDelta_X\t0.0005\t0.0005\t0.0005\n***End_of_Header***\n\
         X_Value\tVoltage\tVoltage\tVoltage 2\tComment\n\t1\t4\t700\n\t2\t5\t800\n\t3\t6\t900\n";
    let (text, _) = start("bench.lvm", lvm);
    assert!(!text.contains("rate_hz"), "{text}");
    assert!(text.contains("channels = [2, 3, \"Voltage 2\"]"), "{text}");
    let v = open(&text);
    assert_eq!(v.time_s, [0.0, 0.0005, 0.001]);
    assert_eq!(
        v.channels,
        [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [700.0, 800.0, 900.0]]
    );

    // a plain table with two columns of one name, and a clock that no unit tells
    let (text, _) = start(
        "plain.csv",
        "Zeit,u (V),u (V),w (V)\n0,1,4,700\n10,2,5,800\n21,3,6,900\n",
    );
    assert!(
        text.contains("time = \"Zeit\"  # ? it rises from row to row"),
        "{text}"
    );
    assert!(text.contains("time_unit = \"ms\""), "{text}");
    assert!(text.contains("channels = [2, 3, \"w (V)\"]"), "{text}");
    assert_eq!(open(&text).time_s, [0.0, 0.01, 0.021]);

    // a table without a clock: none is made up
    let (text, _) = start("none.csv", "a (V),b (V),c (V)\n1,4,700\n2,5,800\n1,6,900\n");
    assert!(
        !text
            .lines()
            .any(|l| l.starts_with("rate_hz") || l.starts_with("time")),
        "{text}"
    );
    assert!(
        text.contains("# rate_hz = 1000.0             # ? the file has no clock"),
        "{text}"
    );
}

/// LabVIEW's tables have no header: a start names their columns by number.
#[test]
fn a_table_without_a_header_has_a_start() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.txt");
    let rows: String = (0..40)
        .map(|i| {
            format!(
                "{}.000\t{}\t{}.5\t0.1\n",
                10 * i + i % 3,
                3.5 + f64::from(i % 7),
                i % 5
            )
        })
        .collect();
    std::fs::write(&path, rows).unwrap();
    let refused = survey_file(&path, None, &ReadOptions::default()).unwrap_err();
    assert!(refused.to_string().contains("no header row"), "{refused}");
    assert!(refused.to_string().contains("--init"), "{refused}");
    let options = ReadOptions {
        columns: Some(Vec::new()),
        ..ReadOptions::default()
    };
    let survey = survey_file(&path, None, &options).unwrap();
    assert_eq!(survey.sections[0].columns.len(), 4);
    let rising: Vec<bool> = survey.sections[0].columns.iter().map(|c| c.rises).collect();
    assert_eq!(rising, [true, false, false, false]);
    let text = manifest("run", &[("run.txt".to_owned(), &survey)]);
    for wanted in [
        "# time = 1  # ? it rises from row to row\n",
        "# time_unit = \"ms\"",
        "# channels = [2, 3, 4]  # ? chains 1, 2, 3",
        "#   3: 0.5 to 4.5\n",
    ] {
        assert!(text.contains(wanted), "{wanted} is not in:\n{text}");
    }
}

#[test]
fn scope_files_with_names_and_times_of_another_kind() {
    let dir = tempfile::tempdir().unwrap();
    // taken for this make by the manifest: the name need not end as the make ends it, nor be ASCII
    for name in ["a", "\u{e9}\u{e9}\u{e9}\u{e9}.csv", "\u{20ac}12345.csv"] {
        let path = dir.path().join(name);
        std::fs::write(&path, "1\n2\n").unwrap();
        let capture =
            deacal::recording::read_file_as(&path, Some("rohde-schwarz-csv"), &Default::default())
                .unwrap();
        assert_eq!(capture.sections[0].stamps_s, None);
        assert!(capture.notes.iter().any(|n| n.text.contains(".Wfm.csv")));
    }
    // start + row * increment is beyond all numbers in the second row
    let path = dir.path().join("rigol.csv");
    let text = "X,CH1,Start,Increment,\nSequence,Volt,1e308,1e308\n0,1,\n1,1,\n";
    std::fs::write(&path, text).unwrap();
    let e = read_file(&path).unwrap_err();
    assert_eq!((e.kind(), e.line()), (ErrorKind::BadNumber, Some(4)));
}
