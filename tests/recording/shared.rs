//! Real exports against what independent readers found in them. The files are not in this repository: the
//! folder that `DEACAL_SHARED` names holds them. Without it these tests say that they are skipped, and pass.

use std::path::{Path, PathBuf};

use deacal::recording::{
    Capture, ColumnRef, ErrorKind, NumberOrEstimate, ReadOptions, Recording, Section, read_file,
    read_file_as,
};
use serde_json::Value;

fn shared(folder: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("DEACAL_SHARED") else {
        eprintln!("skipped: DEACAL_SHARED is not set");
        return None;
    };
    let path = Path::new(&root).join(folder);
    if !path.is_dir() {
        eprintln!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

fn expectation(path: &Path) -> Value {
    let mut name = path.as_os_str().to_owned();
    name.push(".expect.json");
    let text = std::fs::read_to_string(&name)
        .unwrap()
        .replace("NaN", "null");
    serde_json::from_str(&text).unwrap()
}

fn strings(value: &Value) -> Vec<&str> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v.as_str().unwrap())
        .collect()
}

fn close(found: f64, expected: f64, digits: i32, what: &str) {
    let tolerance = expected.abs().max(1e-6) * 10f64.powi(-digits);
    assert!(
        (found - expected).abs() <= tolerance,
        "{what}: {found}, expected {expected}"
    );
}

fn compare_section(file: &str, section: &Section, expected: &Value) {
    let what = format!("{file} {}", section.name);
    assert_eq!(section.name, expected["section"].as_str().unwrap());
    assert_eq!(section.line, expected["line"].as_u64().unwrap(), "{what}");
    assert_eq!(section.rate_hz, expected["rate"].as_f64(), "{what}");
    assert_eq!(
        section.rows() as u64,
        expected["rows"].as_u64().unwrap(),
        "{what}"
    );
    assert_eq!(section.frames.len(), section.rows());
    #[allow(clippy::cast_precision_loss)]
    let ends = (
        section.frames[0] as f64,
        section.frames[section.rows() - 1] as f64,
    );
    assert_eq!(Some(ends.0), expected["first_frame"].as_f64(), "{what}");
    assert_eq!(Some(ends.1), expected["last_frame"].as_f64(), "{what}");
    assert_eq!(
        section.subframes_per_frame.map(u64::from),
        expected["subframes_per_frame"].as_u64(),
        "{what}"
    );
    let names: Vec<&str> = section.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, strings(&expected["group_names"]), "{what}");
    for (group, axes) in section
        .groups
        .iter()
        .zip(expected["axes"].as_array().unwrap())
    {
        let found: Vec<&str> = section.columns[group.columns.clone()]
            .iter()
            .map(|c| c.axis.as_str())
            .collect();
        assert_eq!(found, strings(axes), "{what} {}", group.name);
    }
    let mut units: Vec<&str> = section.columns.iter().map(|c| c.unit.as_str()).collect();
    units.sort_unstable();
    units.dedup();
    assert_eq!(units, strings(&expected["units"]), "{what}");
    let empty: usize = section
        .columns
        .iter()
        .map(|c| c.values.iter().filter(|v| v.is_nan()).count())
        .sum();
    assert_eq!(
        empty as u64,
        expected["empty_cells_in_used_columns"].as_u64().unwrap(),
        "{what}"
    );
    let gaps: Vec<_> = section
        .groups
        .iter()
        .map(|g| section.gaps(g.columns.clone()))
        .collect();
    assert_eq!(
        gaps.iter().filter(|g| g.missing > 0).count() as u64,
        expected["groups_with_gaps"].as_u64().unwrap(),
        "{what}"
    );
    assert_eq!(
        gaps.iter().map(|g| g.missing).sum::<usize>() as u64,
        expected["samples_missing_total"].as_u64().unwrap(),
        "{what}"
    );
    for (name, detail) in expected["detail"].as_object().unwrap() {
        let at = section.groups.iter().position(|g| g.name == *name).unwrap();
        let columns = &section.columns[section.groups[at].columns.clone()];
        let axes: Vec<&str> = columns.iter().map(|c| c.axis.as_str()).collect();
        let units: Vec<&str> = columns.iter().map(|c| c.unit.as_str()).collect();
        assert_eq!(axes, strings(&detail["axes"]), "{what} {name}");
        assert_eq!(units, strings(&detail["units"]), "{what} {name}");
        assert_eq!(
            gaps[at].missing as u64,
            detail["missing"].as_u64().unwrap(),
            "{what} {name}"
        );
        assert_eq!(
            gaps[at].runs as u64,
            detail["gap_runs"].as_u64().unwrap(),
            "{what} {name}"
        );
        for (row, values) in [("first_valid_row", "first"), ("last_valid_row", "last")] {
            let Some(row) = detail[row].as_u64() else {
                continue;
            };
            for (column, value) in columns.iter().zip(detail[values].as_array().unwrap()) {
                // the readers kept nine digits
                let found = column.values[usize::try_from(row).unwrap()];
                close(found, value.as_f64().unwrap(), 8, &what);
            }
        }
        if let Some(means) = detail["mean"].as_array() {
            for (column, mean) in columns.iter().zip(means) {
                close(
                    mean_of(column.values.iter().copied()),
                    mean.as_f64().unwrap(),
                    7,
                    &what,
                );
            }
        }
    }
}

fn mean_of(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values
        .filter(|v| !v.is_nan())
        .fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
    sum / n
}

fn compare_sections(folder: &str, least: usize) {
    let Some(folder) = shared(folder) else { return };
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "csv") {
            continue;
        }
        files += 1;
        let expected = expectation(&path);
        let file = path.file_name().unwrap().to_string_lossy().into_owned();
        let sections = expected["sections"].as_array().unwrap();
        if sections.is_empty() {
            let error = read_file(&path).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Grammar, "{error}");
            assert!(error.to_string().contains("no header row"), "{error}");
            continue;
        }
        let capture = read_file(&path).unwrap();
        assert_eq!(capture.sections.len(), sections.len(), "{file}");
        for (section, expected) in capture.sections.iter().zip(sections) {
            compare_section(&file, section, expected);
        }
        assert!(!capture.notes.is_empty());
    }
    assert!(files >= least, "{files} files");
}

#[test]
fn nexus_exports() {
    compare_sections("datasets/formats/nexus_csv", 7);
}

#[test]
fn tracker_exports() {
    compare_sections("datasets/formats/tracker_csv", 3);
}

fn compare_table(name: &str, columns: Option<usize>) {
    let Some(folder) = shared("datasets/formats/voltage") else {
        return;
    };
    let path = folder.join(name);
    if !path.exists() {
        eprintln!("skipped: {name} is not there");
        return;
    }
    let options = ReadOptions {
        columns: columns.map(|n| (1..=n).map(ColumnRef::Number).collect()),
        ..ReadOptions::default()
    };
    let capture = read_file_as(&path, None, &options).unwrap();
    let expected = expectation(&path);
    let section = &capture.sections[0];
    assert_eq!(
        section.rows() as u64,
        expected["rows"].as_u64().unwrap(),
        "{name}"
    );
    let last = section.rows() - 1;
    for (key, row) in [("first_row", 0), ("last_row", last)] {
        let values = expected[key].as_array().unwrap();
        assert_eq!(section.columns.len(), values.len(), "{name}");
        for (column, value) in section.columns.iter().zip(values) {
            assert_eq!(Some(column.values[row]), value.as_f64(), "{name} {key}");
        }
    }
    for (column, mean) in section
        .columns
        .iter()
        .zip(expected["means"].as_array().unwrap())
    {
        close(
            mean_of(column.values.iter().copied()),
            mean.as_f64().unwrap(),
            8,
            name,
        );
    }
}

#[test]
fn plain_tables() {
    compare_table("semicolon_decimalcomma_Resultaten.csv", None);
    compare_table("labview_tab_noheader_NAPN_1bar_first3000.csv", Some(7));
    compare_table("labview_semicolon_noheader_Aluminium.csv", Some(2));
}

#[test]
fn coupons_as_received() {
    let Some(folder) = shared("datasets/real") else {
        return;
    };
    let numbered = |path: &str, encoding: Option<&str>, columns: usize| -> Capture {
        let options = ReadOptions {
            encoding: encoding.map(str::to_owned),
            columns: Some((1..=columns).map(ColumnRef::Number).collect()),
        };
        read_file_as(&folder.join(path), None, &options).unwrap()
    };
    let zhao = numbered(
        "vhb4910-zhao/loading_unloading/0d05_2d0.csv",
        Some("gbk"),
        3,
    );
    let table = &zhao.sections[0];
    let names: Vec<&str> = table.columns.iter().map(|c| c.axis.as_str()).collect();
    assert_eq!(names, ["时间", "位移", "力"]);
    let units: Vec<&str> = table.columns.iter().map(|c| c.unit.as_str()).collect();
    assert_eq!(units, ["s", "mm", "N"]);
    assert_eq!(table.columns[2].values[..3], [-0.0018, 0.0292, 0.0955]);
    let miles = read_file(&folder.join("vhb4910-miles/vhb4910_miles.csv")).unwrap();
    assert_eq!(miles.sections[0].columns[2].unit, "kPa");
    let spaces = numbered(
        "rubber-digitised/Treloar_1944__UT__stress_stretch.txt",
        None,
        2,
    );
    assert_eq!(spaces.sections[0].columns[1].values[0], 1.02);
    let mut tables = 0;
    for entry in [
        "soro-materials",
        "hasel-srl",
        "laminate-spring-torque",
        "rack-pinion-friction",
        "silverbox",
    ] {
        for file in std::fs::read_dir(folder.join(entry)).unwrap() {
            let path = file.unwrap().path();
            if path.extension().is_some_and(|e| e == "csv") {
                let capture = read_file(&path).unwrap();
                assert!(capture.sections[0].rows() > 50, "{}", path.display());
                assert!(capture.sections[0].columns.len() > 1, "{}", path.display());
                tables += 1;
            }
        }
    }
    assert!(tables > 10);
}

fn recordings(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            recordings(&path, found);
        } else if path.ends_with("recording.toml") {
            found.push(path);
        }
    }
}

#[test]
fn every_twin_recording_opens() {
    let Some(folder) = shared("datasets/twin") else {
        return;
    };
    let mut found = Vec::new();
    recordings(&folder, &mut found);
    assert!(found.len() >= 19, "{}", found.len());
    for path in &found {
        let r = Recording::open(path).unwrap();
        let motion = r.motion.as_ref().unwrap();
        assert_eq!(motion.rate_hz, 100.0);
        assert_eq!(motion.unit.symbol, "mm");
        assert_eq!(motion.time_s.len(), motion.end_effector.xyz.len());
        assert_eq!(r.voltage.as_ref().unwrap().unit.symbol, "kV");
        assert_eq!(r.sources.len(), 4);
    }
    let r = Recording::open(&folder.join("sym-01")).unwrap();
    let (motion, voltage) = (r.motion.unwrap(), r.voltage.unwrap());
    assert_eq!((motion.time_s.len(), motion.first_frame), (6001, Some(1)));
    assert_eq!(motion.end_effector.xyz[0], [-314.899, 93.741, 853.642]);
    assert_eq!((voltage.time_s.len(), voltage.channels.len()), (60_001, 3));
    assert_eq!(voltage.time_s[60_000], 60.0);
    let r = Recording::open(&folder.join("steps")).unwrap();
    assert_eq!(r.manifest.offset_s, NumberOrEstimate::Estimate);
}

/// Prints how long the reference recording takes; `cargo test --release -- --nocapture time_to_open`.
#[test]
fn time_to_open() {
    let Some(folder) = shared("datasets/twin/sym-01") else {
        return;
    };
    let mut times: Vec<f64> = (0..20)
        .map(|_| {
            let start = std::time::Instant::now();
            std::hint::black_box(Recording::open(&folder).unwrap());
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    eprintln!(
        "sym-01 opens in {:.1} ms (median of {})",
        times[10],
        times.len()
    );
}
