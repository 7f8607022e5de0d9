//! Every real file of motion-capture formats against what independent readers found in it. The files are not
//! in this repository: the folder that `DEACAL_SHARED` names holds them. Without it these tests say that they
//! are skipped, and pass. (Nexus and Tracker CSV: `recording_shared.rs`.)

use std::path::{Path, PathBuf};

use deacal::recording::{
    Capture, Column, ErrorKind, Level, ReadOptions, Section, read_file, survey_file,
};
use serde_json::Value;

fn shared(folder: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("DEACAL_SHARED") else {
        eprintln!("skipped: DEACAL_SHARED is not set");
        return None;
    };
    let path = Path::new(&root).join("datasets/formats").join(folder);
    if !path.is_dir() {
        eprintln!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

/// The data files of a folder that have an expectation.
fn files(folder: &Path) -> Vec<(PathBuf, String, Value)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let Some(data) = name.strip_suffix(".expect.json") else {
            continue;
        };
        let text = std::fs::read_to_string(&path).unwrap();
        // Python writes what JSON has no word for
        let text = text
            .replace("-Infinity", "null")
            .replace("Infinity", "null")
            .replace("NaN", "null");
        let value = serde_json::from_str(&text).unwrap();
        if path.with_file_name(data).exists() {
            found.push((path.with_file_name(data), data.to_owned(), value));
        } else {
            eprintln!("skipped: {data} is not there");
        }
    }
    found.sort_by(|a, b| a.1.cmp(&b.1));
    found
}

fn close(found: f64, expected: &Value, what: &str) {
    let expected = expected.as_f64().unwrap();
    // the readers kept nine digits
    let tolerance = expected.abs().max(1e-6) * 1e-8;
    assert!(
        (found - expected).abs() <= tolerance,
        "{what}: {found}, expected {expected}"
    );
}

fn mean_of(values: &[f64]) -> f64 {
    let seen: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    seen.iter().sum::<f64>() / seen.len() as f64
}

/// The columns x, y, z of every point of a C3D file, in the order of the file, with section and label.
fn points(capture: &Capture) -> Vec<(&Section, &str, [&Column; 3])> {
    let mut points: Vec<_> = capture
        .sections
        .iter()
        .filter(|s| s.name != "Devices")
        .flat_map(|s| {
            s.groups.iter().map(move |g| {
                let c = g.columns.start;
                let columns = [&s.columns[c], &s.columns[c + 1], &s.columns[c + 2]];
                (s, g.name.as_str(), columns)
            })
        })
        .collect();
    points.sort_by_key(|p| p.2[0].number);
    points
}

fn at<'a>(value: &'a Value, path: &[&str]) -> &'a Value {
    path.iter().fold(value, |v, key| &v[key])
}

fn compare_c3d(name: &str, capture: &Capture, expected: &Value) {
    let raw = &expected["reference_from_raw_bytes"];
    let header = &expected["header"];
    let all = points(capture);
    let frames = usize::try_from(raw["frames_used"].as_u64().unwrap()).unwrap();
    // the count of a synthetic file of 70000 frames is what this program is to find, not the header's
    let frames = if name.contains("70000frames") {
        70_000
    } else {
        frames
    };
    assert_eq!(
        all.len() as u64,
        header["points"].as_u64().unwrap(),
        "{name}"
    );
    for (section, label, _) in &all {
        assert_eq!(section.rows(), frames, "{name} {label}");
        assert_eq!(
            section.frames[0],
            header["first_frame"].as_i64().unwrap(),
            "{name}"
        );
        close(section.rate_hz.unwrap(), &header["rate"], name);
    }
    let labels = at(expected, &["ezc3d", "labels"]).as_array();
    if let Some(labels) = labels.filter(|l| !l.is_empty()) {
        assert!(labels.len() >= all.len());
        for (i, ((_, label, _), theirs)) in all.iter().zip(labels).enumerate() {
            let theirs = theirs.as_str().unwrap().trim();
            let numbered = format!("{theirs}#{}", i + 1);
            let none = theirs.is_empty() && *label == format!("*{}", i + 1);
            assert!(
                *label == theirs || *label == numbered || none,
                "{name}: {label}, {theirs}"
            );
        }
    }
    let unit = at(expected, &["params", "POINT:UNITS"])
        .as_array()
        .and_then(|u| u.first()?.as_str())
        .unwrap_or("")
        .trim_matches(['\0', ' ']);
    let unit = if unit == "mete" { "m" } else { unit };
    for (section, label, columns) in &all {
        if section.name == "Trajectories" {
            assert_eq!(columns[0].unit, unit, "{name} {label}");
        }
    }

    // gaps: w < 0, no number, and 0, 0, 0 without a residual where the point is a position
    let empty = |c: &[&Column; 3], i: usize| c.iter().any(|c| c.values[i].is_nan());
    let mut gaps = 0;
    let mut zeros = 0;
    for (section, label, columns) in &all {
        gaps += (0..frames).filter(|i| empty(columns, *i)).count();
        let residual = section.column(label, "residual");
        assert_eq!(residual.is_some(), section.name == "Trajectories");
        for i in (0..frames).filter(|i| columns.iter().all(|c| c.values[*i] == 0.0)) {
            zeros += 1;
            // cameras saw it there: a residual that can be read, and is not 0
            assert!(residual.is_none_or(|r| r.values[i] > 0.0), "{name} {label}");
        }
    }
    let sum: u64 = [
        "missing_samples_total",
        "nonfinite_xyz",
        "xyz_zero_but_not_flagged",
    ]
    .iter()
    .map(|key| raw[key].as_u64().unwrap_or(0))
    .sum();
    assert_eq!((gaps + zeros) as u64, sum, "{name}: gaps");

    for key in ["first_point_first_valid", "first_point_last_valid"] {
        let place = &raw[key];
        if place.is_object() {
            let point = place["index"].as_u64().unwrap() as usize;
            let frame = place["frame"].as_u64().unwrap() as usize;
            for (k, column) in all[point].2.iter().enumerate() {
                let theirs = &place["xyz"][k];
                if column.values[frame].is_nan() {
                    // a sample that counts as a gap here
                    assert!(
                        theirs.is_null() || theirs.as_f64() == Some(0.0),
                        "{name} {key}"
                    );
                } else {
                    close(column.values[frame], theirs, name);
                }
            }
        }
    }
    let agreed = expected["oracle_disagreements"]
        .as_array()
        .is_none_or(Vec::is_empty);
    if agreed && raw["xyz_zero_but_not_flagged"].as_u64() == Some(0) {
        for detail in at(expected, &["ezc3d", "markers"])
            .as_object()
            .into_iter()
            .flat_map(|m| m.values())
        {
            let (_, label, columns) = &all[detail["index"].as_u64().unwrap() as usize];
            let missing = (0..frames).filter(|i| empty(columns, *i)).count();
            assert_eq!(
                missing as u64,
                detail["missing"].as_u64().unwrap(),
                "{name} {label}"
            );
            for (row, values) in [
                ("first_valid_frame_index", "first_xyz"),
                ("last_valid_frame_index", "last_xyz"),
            ] {
                if let Some(row) = detail[row].as_u64() {
                    for (k, column) in columns.iter().enumerate() {
                        close(column.values[row as usize], &detail[values][k], name);
                    }
                }
            }
            for (k, column) in columns.iter().enumerate() {
                if let Some(mean) = detail["mean_xyz_over_valid"]
                    .get(k)
                    .filter(|m| !m.is_null())
                {
                    let found = mean_of(&column.values);
                    let mean = mean.as_f64().unwrap();
                    assert!(
                        (found - mean).abs() <= 1e-5 * mean.abs().max(1.0),
                        "{name} {label}: {found}, {mean}"
                    );
                }
            }
        }
    }

    let analog = &raw["analog"];
    if analog.is_object() && analog["n_channels"].as_u64() > Some(0) {
        let devices = capture
            .sections
            .iter()
            .find(|s| s.name == "Devices")
            .unwrap();
        assert_eq!(
            devices.columns.len() as u64,
            analog["n_channels"].as_u64().unwrap(),
            "{name}"
        );
        assert_eq!(
            devices.rows() as u64,
            analog["samples"].as_u64().unwrap(),
            "{name}"
        );
        close(devices.rate_hz.unwrap(), &analog["rate"], name);
        for (channel, detail) in analog["channels"].as_object().unwrap() {
            let values = &devices.columns[channel.parse::<usize>().unwrap()].values;
            let what = format!("{name} channel {channel}");
            for (value, theirs) in values.iter().zip(detail["first3"].as_array().unwrap()) {
                close(*value, theirs, &what);
            }
            close(values[values.len() - 1], &detail["last"], &what);
            let (found, mean) = (mean_of(values), detail["mean"].as_f64().unwrap());
            let size = values.iter().fold(1e-6, |m: f64, v| m.max(v.abs()));
            assert!(
                (found - mean).abs() <= 1e-6 * size,
                "{what}: {found}, {mean}"
            );
        }
        if let Some(labels) = at(expected, &["ezc3d", "analog", "labels"]).as_array() {
            for (group, theirs) in devices.groups.iter().zip(labels) {
                let bare = group.name.split('#').next().unwrap();
                let theirs = theirs.as_str().unwrap().trim();
                assert!(
                    bare == theirs.split('#').next().unwrap() || theirs.is_empty(),
                    "{name}: {bare}, {theirs}"
                );
            }
        }
        if let Some(units) = at(expected, &["ezc3d", "analog", "units"]).as_array() {
            for (column, theirs) in devices.columns.iter().zip(units) {
                let theirs = theirs.as_str().unwrap().trim_matches(['\0', ' ']);
                // the reader writes ? for a byte that is no UTF-8
                assert!(
                    column.unit == theirs || theirs == "?",
                    "{name}: {}, {theirs}",
                    column.unit
                );
            }
        }
    }
}

#[test]
fn every_c3d_file() {
    let Some(folder) = shared("c3d") else { return };
    let mut compared = 0;
    for (path, name, expected) in files(&folder) {
        let raw = &expected["reference_from_raw_bytes"];
        if raw["error"].is_string() {
            let error = read_file(&path).unwrap_err();
            assert!(
                matches!(error.kind(), ErrorKind::NoData | ErrorKind::Grammar),
                "{name}: {error}"
            );
            assert!(
                error.to_string().contains("no points and no channels"),
                "{name}: {error}"
            );
        } else {
            let capture = read_file(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(capture.format, "c3d");
            compare_c3d(&name, &capture, &expected);
        }
        compared += 1;
    }
    eprintln!("{compared} C3D files");
    assert!(compared >= 38, "{compared}");
}

/// What a file gets wrong is said.
#[test]
fn c3d_files_that_contradict_themselves_say_so() {
    let Some(folder) = shared("c3d") else { return };
    for (name, words) in [
        (
            "ezc3d_Optotrak_truncated.c3d",
            "1149 frames are declared and 29 are there",
        ),
        ("s06_MACsample.c3d", "the header's is used"),
        ("s13_Dance.c3d", "POINT:FRAMES is 500"),
        ("s15_FP1.C3D", "\"mete\", taken as m"),
        ("s16_basketball.c3d", "not stated"),
        ("s18_bad_parameter_section.c3d", "damaged"),
        ("s20_phasespace.c3d", "no parameters"),
        ("s27_kyowadengyo.c3d", "POINT:USED is 12"),
    ] {
        let path = folder.join(name);
        if !path.exists() {
            eprintln!("skipped: {name} is not there");
            continue;
        }
        let capture = read_file(&path).unwrap();
        let said: Vec<&str> = capture
            .notes
            .iter()
            .filter(|n| n.level == Level::Warning)
            .map(|n| n.text.as_str())
            .collect();
        assert!(said.iter().any(|s| s.contains(words)), "{name}: {said:?}");
    }
}

/// One trial, exported twice: positions within 0.005 mm, voltages within 5e-7 V, channel by channel by name.
#[test]
fn c3d_and_csv_of_one_trial() {
    let (Some(c3d), Some(csv)) = (shared("c3d"), shared("nexus_csv")) else {
        return;
    };
    let c3d = read_file(&c3d.join("pyomeca_markers_analogs.c3d")).unwrap();
    let markers = read_file(&csv.join("pyomeca_markers.csv")).unwrap();
    let devices = read_file(&csv.join("pyomeca_analogs.csv")).unwrap();
    let section = |capture: &'_ Capture, name: &str| {
        capture
            .sections
            .iter()
            .find(|s| s.name == name)
            .unwrap()
            .clone()
    };
    let (a, b) = (
        section(&c3d, "Trajectories"),
        section(&markers, "Trajectories"),
    );
    assert_eq!(a.frames, b.frames);
    let mut worst_mm = 0.0f64;
    let mut markers = 0;
    for group in &b.groups {
        for column in &b.columns[group.columns.clone()] {
            let other = a.column(&group.name, &column.axis).unwrap();
            for (x, y) in column.values.iter().zip(&other.values) {
                assert_eq!(x.is_nan(), y.is_nan(), "{}", group.name);
                if !x.is_nan() {
                    worst_mm = worst_mm.max((x - y).abs());
                }
            }
        }
        markers += 1;
    }
    assert!(
        markers >= 51 && worst_mm <= 0.005,
        "{markers} markers, {worst_mm} mm"
    );

    let (a, b) = (section(&c3d, "Devices"), section(&devices, "Devices"));
    assert_eq!(
        (a.frames.clone(), &a.sub_frames),
        (b.frames.clone(), &b.sub_frames)
    );
    let mut worst_v = 0.0f64;
    let mut channels = 0;
    for column in &b.columns {
        // `Imported Analog EMG - Voltage`, 1 is `Voltage.1`; a column EMG1 is `Delt_ant.EMG1`
        let bare = if column.group.ends_with("- Voltage") {
            format!("Voltage.{}", column.axis)
        } else {
            let end = format!(".{}", column.axis);
            let all: Vec<&str> = a
                .groups
                .iter()
                .map(|g| g.name.as_str())
                .filter(|g| g.ends_with(&end))
                .collect();
            assert_eq!(all.len(), 1, "{}", column.title());
            all[0].to_owned()
        };
        let other = a.columns.iter().find(|c| c.group == bare).unwrap();
        assert_eq!((column.unit.as_str(), other.unit.as_str()), ("V", "V"));
        for (x, y) in column.values.iter().zip(&other.values) {
            worst_v = worst_v.max((x - y).abs());
        }
        channels += 1;
    }
    eprintln!(
        "{markers} markers within {worst_mm:.2e} mm, {channels} channels within {worst_v:.2e} V"
    );
    assert!(
        channels == 38 && worst_v <= 5e-7,
        "{channels} channels, {worst_v} V"
    );
}

fn compare_group(name: &str, section: &Section, group: usize, detail: &Value) {
    let range = section.groups[group].columns.clone();
    let columns = &section.columns[range.clone()];
    let gaps = section.gaps(range);
    assert_eq!(
        gaps.missing as u64,
        detail["missing"].as_u64().unwrap(),
        "{name} group {group}"
    );
    assert_eq!(
        gaps.runs as u64,
        detail["gap_runs"].as_u64().unwrap(),
        "{name} group {group}"
    );
    for (row, values) in [("first_valid_row", "first"), ("last_valid_row", "last")] {
        let row = detail[row].as_u64().unwrap() as usize;
        for (k, column) in columns.iter().take(3).enumerate() {
            close(column.values[row], &detail[values][k], name);
        }
    }
    for (k, column) in columns.iter().take(3).enumerate() {
        close(mean_of(&column.values), &detail["mean"][k], name);
    }
}

#[test]
fn every_qualisys_file() {
    let Some(folder) = shared("qualisys_tsv") else {
        return;
    };
    for (path, name, expected) in files(&folder) {
        let capture = read_file(&path).unwrap();
        assert_eq!(capture.format, "qualisys-tsv");
        let section = &capture.sections[0];
        assert_eq!(section.rows() as u64, expected["rows"].as_u64().unwrap());
        assert_eq!(section.rate_hz, expected["rate"].as_f64());
        let names: Vec<&str> = section.groups.iter().map(|g| g.name.as_str()).collect();
        assert_eq!(Value::from(names.clone()), expected["markers"]);
        assert!(section.columns.iter().all(|c| c.unit == "mm"));
        assert_eq!(section.times_s().unwrap()[..2], [0.0, 0.01]);
        let missing: usize = section
            .groups
            .iter()
            .map(|g| section.gaps(g.columns.clone()).missing)
            .sum();
        assert_eq!(missing as u64, expected["empty_samples"].as_u64().unwrap());
        for (marker, detail) in expected["detail"].as_object().unwrap() {
            let group = names.iter().position(|n| n == marker).unwrap();
            compare_group(&name, section, group, detail);
        }
    }
}

#[test]
fn every_trc_file() {
    let Some(folder) = shared("trc") else { return };
    let mut compared = 0;
    for (path, name, expected) in files(&folder) {
        compared += 1;
        if expected["error"].is_string() {
            let error = read_file(&path).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::NoData, "{error}");
            continue;
        }
        let capture = read_file(&path).unwrap();
        assert_eq!(capture.format, "trc");
        let section = &capture.sections[0];
        assert_eq!(
            section.rows() as u64,
            expected["rows"].as_u64().unwrap(),
            "{name}"
        );
        assert_eq!(section.rate_hz, expected["DataRate"].as_f64(), "{name}");
        assert!(
            section
                .columns
                .iter()
                .all(|c| Some(c.unit.as_str()) == expected["Units"].as_str())
        );
        let names: Vec<&str> = section.groups.iter().map(|g| g.name.as_str()).collect();
        let theirs: Vec<&str> = expected["names"]
            .as_array()
            .unwrap()
            .iter()
            .map(|n| n.as_str().unwrap())
            .collect();
        assert_eq!(names[..theirs.len()], theirs, "{name}");
        for (marker, detail) in expected["detail"].as_object().unwrap() {
            // without a name: by number from 0
            let group = match marker.strip_prefix('#') {
                Some(n) => n.parse().unwrap(),
                None => names.iter().position(|n| n == marker).unwrap(),
            };
            compare_group(&name, section, group, detail);
        }
        // the reader looked at as many markers as the header declares
        let looked = usize::try_from(expected["NumMarkers"].as_u64().unwrap_or(u64::MAX))
            .unwrap_or(usize::MAX)
            .max(expected["NumMarkers"].as_f64().unwrap() as usize);
        let missing: usize = section
            .groups
            .iter()
            .take(looked)
            .map(|g| section.gaps(g.columns.clone()).missing)
            .sum();
        assert_eq!(
            missing as u64,
            expected["samples_missing_total"].as_u64().unwrap(),
            "{name}"
        );
        let times = section.times_s().unwrap();
        let ends = expected["time_first_last"].as_array().unwrap();
        for (time, end) in [times[0], times[times.len() - 1]].iter().zip(ends) {
            // printed to ms
            assert!(
                (time - end.as_f64().unwrap()).abs() < 6e-4,
                "{name}: {time}, {end}"
            );
        }
    }
    assert!(compared >= 4, "{compared}");
}

#[test]
fn every_motive_file() {
    let Some(folder) = shared("optitrack_csv") else {
        return;
    };
    for (path, name, expected) in files(&folder) {
        let capture = read_file(&path).unwrap();
        assert_eq!(capture.format, "optitrack-csv");
        let section = &capture.sections[0];
        assert_eq!(
            section.rows() as u64,
            expected["frames"].as_u64().unwrap(),
            "{name}"
        );
        assert_eq!(section.rate_hz, expected["rate_from_times"].as_f64());
        assert_eq!(
            section.groups.len() as u64,
            expected["distinct_marker_names"].as_u64().unwrap()
        );
        let times = section.times_s().unwrap();
        for (time, end) in [times[0], times[times.len() - 1]]
            .iter()
            .zip(expected["t_first_last"].as_array().unwrap())
        {
            assert!(
                (time - end.as_f64().unwrap()).abs() < 1e-6,
                "{name}: {time}, {end}"
            );
        }
        let seen: Vec<usize> = (0..section.rows())
            .map(|i| {
                section
                    .columns
                    .iter()
                    .filter(|c| c.axis == "X" && !c.values[i].is_nan())
                    .count()
            })
            .collect();
        let range = [*seen.iter().min().unwrap(), *seen.iter().max().unwrap()];
        assert_eq!(
            Value::from(range.to_vec()),
            expected["markers_per_frame_min_max"]
        );
        for (marker, detail) in expected["first_markers"].as_object().unwrap() {
            let columns = ["X", "Y", "Z"].map(|a| section.column(marker, a).unwrap());
            let samples = columns[0].values.iter().filter(|v| !v.is_nan()).count();
            assert_eq!(
                samples as u64,
                detail["samples"].as_u64().unwrap(),
                "{marker}"
            );
            for key in ["first", "last"] {
                let frame = detail[key][0].as_i64().unwrap();
                let row = section.frames.iter().position(|f| *f == frame).unwrap();
                for (k, column) in columns.iter().enumerate() {
                    close(column.values[row], &detail[key][k + 1], marker);
                }
            }
        }
    }
    // an excerpt without an expectation: its numbers stand in the file
    let excerpt = folder.join("motive_v1.23_excerpt.csv");
    if !excerpt.exists() {
        eprintln!("skipped: {} is not there", excerpt.display());
        return;
    }
    let capture = read_file(&excerpt).unwrap();
    let section = &capture.sections[0];
    let names: Vec<&str> = section.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["Left", "Left:Marker1"]);
    assert_eq!(section.rate_hz, Some(120.0));
    // frames and rate, not the printed 0.025
    assert_eq!(section.times_s().unwrap()[3], 3.0 / 120.0);
    assert_eq!(section.column("Left", "RW").unwrap().values[0], 0.308_385);
    assert_eq!(section.column("Left", "X").unwrap().values[0], -79.610_710);
    assert_eq!(section.column("Left", "X").unwrap().unit, "Millimeters");
    assert_eq!(
        section.column("Left:Marker1", "Z").unwrap().values[5],
        252.545_273
    );
}

/// A survey sees what a reading sees, in batches.
#[test]
fn surveys_agree_with_readings() {
    let mut compared = 0;
    for folder in [
        "c3d",
        "nexus_csv",
        "tracker_csv",
        "optitrack_csv",
        "qualisys_tsv",
        "trc",
    ] {
        let Some(folder) = shared(folder) else { return };
        for (path, name, _) in files(&folder) {
            let survey = survey_file(&path, None, &ReadOptions::default());
            let capture = match (read_file(&path), survey) {
                (Ok(capture), Ok(survey)) => (capture, survey),
                (Err(a), Err(b)) => {
                    assert_eq!(a.to_string(), b.to_string());
                    continue;
                }
                (a, b) => panic!("{name}: {:?} {:?}", a.err(), b.err()),
            };
            let (capture, survey) = capture;
            assert_eq!(capture.sections.len(), survey.sections.len());
            for (a, b) in capture.sections.iter().zip(&survey.sections) {
                let what = format!("{name} {}", a.name);
                assert_eq!((a.rows(), a.rate_hz), (b.rows, b.rate_hz), "{what}");
                assert_eq!(a.columns.len(), b.columns.len(), "{what}");
                for (c, d) in a.columns.iter().zip(&b.columns) {
                    let missing = c.values.iter().filter(|v| v.is_nan()).count();
                    let low = c.values.iter().copied().fold(f64::INFINITY, f64::min);
                    let high = c.values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                    assert_eq!(missing, d.missing, "{what} {}", d.title);
                    assert_eq!(
                        (low <= high).then_some([low, high]),
                        d.range,
                        "{what} {}",
                        d.title
                    );
                }
                for (g, h) in a.groups.iter().zip(&b.groups) {
                    assert_eq!(a.gaps(g.columns.clone()), h.gaps, "{what} {}", g.name);
                }
                let times = a.times_s().unwrap();
                let ends = b.time_s.unwrap();
                assert!((times[0] - ends[0]).abs() < 1e-12, "{what}");
                assert!((times[times.len() - 1] - ends[1]).abs() < 1e-9, "{what}");
            }
            let mut a: Vec<&str> = capture.notes.iter().map(|n| n.text.as_str()).collect();
            let mut b: Vec<&str> = survey.notes.iter().map(|n| n.text.as_str()).collect();
            a.sort_unstable();
            b.sort_unstable();
            assert_eq!(a, b, "{name}");
            for doubt in &survey.doubts {
                eprintln!("{name}: {}: {}", doubt.kind.name(), doubt.says);
            }
            compared += 1;
        }
    }
    assert!(compared > 40, "{compared}");
}
