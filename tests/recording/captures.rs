//! Motive, Qualisys, TRC and Tracker files on small hand-made examples; markers and bodies chosen from them;
//! what a survey finds wrong.

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

use deacal::recording::{
    Capture, DoubtKind, ErrorKind, Level, Manifest, ReadOptions, Recording, Section, Survey,
    read_file, survey_file,
};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/recording")
        .join(name)
}

/// NaN as -1 to compare lists.
fn values(section: &Section, group: &str, axis: &str) -> Vec<f64> {
    let column = section
        .column(group, axis)
        .unwrap_or_else(|| panic!("no {group} {axis}"));
    column
        .values
        .iter()
        .map(|v| if v.is_nan() { -1.0 } else { *v })
        .collect()
}

fn says(capture: &Capture, words: &str) -> bool {
    capture.notes.iter().any(|n| n.text.contains(words))
}

#[test]
fn motive_tables() {
    let capture = read_file(&data("motive.csv")).unwrap();
    assert_eq!(capture.format, "optitrack-csv");
    let s = &capture.sections[0];
    let names: Vec<&str> = s.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["EE", "EE:1", "EE:1 (Marker)"]);
    // the printed 0.008, 0.017, 0.025 are rounded
    assert_eq!(s.rate_hz, Some(120.0));
    assert_eq!(
        s.times_s().unwrap(),
        [0.0, 1.0 / 120.0, 2.0 / 120.0, 3.0 / 120.0]
    );
    assert_eq!(values(s, "EE", "X"), [1.5, 1.6, -1.0, 1.8]);
    assert_eq!(values(s, "EE", "RW"), [1.0, -0.995, -1.0, 0.995]);
    assert_eq!(values(s, "EE:1 (Marker)", "Y"), [8.0, -1.0, 8.0, 8.0]);
    assert_eq!(s.column("EE", "X").unwrap().unit, "Millimeters");
    assert_eq!(s.column("EE", "RX").unwrap().unit, "");
    // an error that is not there is no gap of the body
    assert_eq!(s.gaps(s.groups[0].columns.clone()).missing, 1);
    assert_eq!(values(s, "EE", "Mean Marker Error"), [0.1, -1.0, -1.0, 0.1]);
    assert!(
        says(&capture, "middle of a row") && says(&capture, "5 frames are declared, 4 are there")
    );
}

#[test]
fn motive_rows() {
    let capture = read_file(&data("motive-rows.csv")).unwrap();
    assert_eq!(capture.format, "optitrack-csv");
    let s = &capture.sections[0];
    let names: Vec<&str> = s.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["Plate", "Marker-11", "Marker-12"]);
    assert_eq!(s.frames, [0, 1, 2, 4]);
    assert_eq!(s.rate_hz, Some(120.0));
    assert!((s.times_s().unwrap()[3] - 4.0 / 120.0).abs() < 1e-12);
    assert_eq!(values(s, "Marker-11", "X"), [-1.0, 0.5, 0.51, -1.0]);
    assert_eq!(values(s, "Marker-11", "Z"), [-1.0, 0.7, -1.0, -1.0]);
    assert_eq!(values(s, "Marker-12", "X"), [-1.0, 0.8, -1.0, 0.8]);
    assert_eq!(values(s, "Plate", "RW"), [-1.0, 1.0, -1.0, -1.0]);
    assert!(says(&capture, "the unit of the positions is not stated"));
    assert!(says(&capture, "1 frames are not in the file"));
    assert!(says(
        &capture,
        "1 rows with the markers of rigid bodies are left out"
    ));
}

#[test]
fn qualisys_tables() {
    let capture = read_file(&data("qualisys.tsv")).unwrap();
    assert_eq!(capture.format, "qualisys-tsv");
    let s = &capture.sections[0];
    let names: Vec<&str> = s.groups.iter().map(|g| g.name.as_str()).collect();
    assert_eq!(names, ["end effector", "base"]);
    // 0.000 is how a sample that was not seen may be written
    assert_eq!(values(s, "end effector", "X"), [1.5, -1.0, -1.0, 1.7]);
    assert_eq!((s.rate_hz, s.frames[0]), (Some(100.0), 11));
    assert_eq!(s.times_s().unwrap(), [0.1, 0.11, 0.12, 0.14]);
    assert!(says(&capture, "3 markers are declared, 2 have columns"));
    assert!(says(
        &capture,
        "1 frames between 11 and 15 are not in the file"
    ));
    assert!(says(&capture, "exactly 0, 0, 0") && says(&capture, "no unit is stated"));

    let capture = read_file(&data("qualisys-6d.tsv")).unwrap();
    let s = &capture.sections[0];
    assert_eq!(s.groups.len(), 1);
    assert_eq!(values(s, "plate", "X"), [10.0, 11.0]);
    assert_eq!(s.column("plate", "Yaw").unwrap().unit, "deg");
}

#[test]
fn qualisys_without_a_column_row() {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(
        b"NO_OF_FRAMES\t2\nFREQUENCY\t10\nMARKER_NAMES\ta\tb\n1\t2\t3\t4\t5\t6\n1\t2\t3\t4\t5\t7\n",
    )
    .unwrap();
    let capture = read_file(file.path()).unwrap();
    let s = &capture.sections[0];
    assert_eq!(values(s, "b", "Z"), [6.0, 7.0]);
    assert_eq!(s.times_s().unwrap(), [0.0, 0.1]);
}

#[test]
fn trc_files() {
    let capture = read_file(&data("small.trc")).unwrap();
    assert_eq!(capture.format, "trc");
    let s = &capture.sections[0];
    let names: Vec<&str> = s.groups.iter().map(|g| g.name.as_str()).collect();
    // the third stands in one row only, without a name
    assert_eq!(names, ["End Effector", "Base", "*3"]);
    assert_eq!(values(s, "*3", "Y"), [-1.0, 41.0, -1.0]);
    assert_eq!(values(s, "End Effector", "Y"), [2.5, -1.0, -1.0]);
    assert_eq!(values(s, "Base", "X"), [7.0, 7.0, -1.0]);
    for words in [
        "66 markers are declared, 2 have columns",
        "9 frames are declared, 3 are there",
        "rows go on beyond the header: 1 markers",
        "1 rows are shorter",
        "1 cells say NaN",
    ] {
        assert!(says(&capture, words), "{words}: {:?}", capture.notes);
    }
    let capture = read_file(&data("commas.trc")).unwrap();
    let s = &capture.sections[0];
    assert_eq!(
        (s.rate_hz, values(s, "EE", "Z")),
        (Some(50.0), vec![0.3, 0.4])
    );
    assert_eq!(s.columns[0].unit, "m");
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(b"PathFileType\t4\t(X/Y/Z)\tBTK\t\nDataRate\tCameraRate\n")
        .unwrap();
    let error = read_file(file.path()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NoData);
    assert!(error.to_string().contains("ends in its header"), "{error}");
}

/// Markers that begin below the header learn of a decimal comma as those in the header do: the file is read
/// again, once.
#[test]
fn a_marker_without_a_name_has_decimal_commas() {
    let capture = read_file(&data("growing-commas.trc")).unwrap();
    let s = &capture.sections[0];
    assert_eq!(values(s, "*2", "X"), [-1.0, -1.0, 1500.0, 2.5]);
    assert_eq!(values(s, "*3", "Z"), [-1.0, 9.0, 9.0, 9.0]);
    assert!(says(&capture, "decimal comma"), "{:?}", capture.notes);
}

/// Almost empty rows below a wide header would ask for a hundred gigabytes.
#[test]
fn a_table_far_larger_than_its_file_is_refused() {
    let mut text = String::from("Trajectories\n100\n,");
    for i in 0..5_000 {
        write!(text, ",m{i},,").unwrap();
    }
    text += "\nFrame,Sub Frame";
    text += &",X,Y,Z".repeat(5_000);
    text += "\n,";
    text += &",mm,mm,mm".repeat(5_000);
    for i in 1..50_000 {
        write!(text, "\n{i},0").unwrap();
    }
    text += "\n";
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(text.as_bytes()).unwrap();
    let error = read_file(file.path()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::CellCount);
    assert!(
        error
            .to_string()
            .contains("almost all of its cells are empty"),
        "{error}"
    );
}

const RIG: &str = include_str!("../data/recording/robot/rig.toml");
const VOLTAGE: &str = "time_s,a_kV,b_kV,c_kV\n0,0,0,0\n1,1,1,1\n";

/// A recording of a robot whose motion is this file, with these lines under [motion].
fn open(file: &Path, lines: &str) -> Result<Recording, deacal::recording::Error> {
    let dir = tempfile::tempdir().unwrap();
    let manifest = format!(
        "[recording]\nid = \"a\"\nkind = \"robot\"\nrig = \"rig.toml\"\n[motion]\nfile = {:?}\n{lines}\n[voltage]\nfile = \"v.csv\"\ntime = \"time_s\"\nchannels = [\"a_kV\", \"b_kV\", \"c_kV\"]\n",
        file.display().to_string()
    );
    for (name, text) in [
        ("recording.toml", manifest.as_str()),
        ("rig.toml", RIG),
        ("v.csv", VOLTAGE),
    ] {
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    Recording::open(dir.path())
}

#[test]
fn a_body_with_a_quaternion() {
    let r = open(&data("tracker-quaternion.csv"), "end_effector = \"Arm 1\"").unwrap();
    let m = r.motion.unwrap();
    assert_eq!(m.end_effector.label, "Arm 1:Arm 1");
    let turns = m.end_effector.rotation.unwrap();
    // the sign of the second is turned, the third was not seen, and neither was its position
    assert!((turns[1][2] - 0.11).abs() < 1e-3 && turns[1][3] > 0.99);
    assert!(turns[2][0].is_nan() && m.end_effector.xyz[2][0].is_nan());
    assert_eq!(m.end_effector.xyz[3], [1.0, 2.0, 5.0]);
    let turn = r
        .notes
        .iter()
        .find(|n| n.text.contains("turns by up to"))
        .unwrap();
    assert!(
        turn.text.contains("2.31 deg") || turn.text.contains("2.3"),
        "{}",
        turn.text
    );
}

#[test]
fn a_body_with_a_rotation_vector() {
    let r = open(&data("tracker.csv"), "end_effector = \"Tip\"").unwrap();
    assert!(r.motion.unwrap().end_effector.rotation.is_some());
    // Euler angles in degrees have no order in the file
    let r = open(&data("qualisys-6d.tsv"), "end_effector = \"plate\"").unwrap();
    assert!(r.motion.unwrap().end_effector.rotation.is_none());
}

#[test]
fn markers_by_wildcard_and_by_place() {
    let file = data("qualisys.tsv");
    let label = |lines: &str| {
        open(&file, lines).map(|r| {
            let m = r.motion.unwrap();
            (m.end_effector.label, m.base.map(|b| b.label))
        })
    };
    assert_eq!(label("end_effector = \"end*\"").unwrap().0, "end effector");
    assert_eq!(
        label("end_effector = \"?nd eff*r\"").unwrap().0,
        "end effector"
    );
    // first seen at 1.5, 2.5, 3.5 and 7, 8, 9
    let both = label("end_effector_near_mm = [1, 2, 3]\nbase_near_mm = [7, 7, 7]").unwrap();
    assert_eq!(both, ("end effector".to_owned(), Some("base".to_owned())));
    let error = label("end_effector = \"*\"").unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Ambiguous);
    assert!(
        error.to_string().contains("end_effector_near_mm"),
        "{error}"
    );
    let error = label("end_effector = \"x*\"").unwrap_err();
    assert_eq!(error.kind(), ErrorKind::UnknownMarker);
    let error = label("base = \"base\"").unwrap_err();
    assert_eq!(error.kind(), ErrorKind::MissingKey, "{error}");
    // in m, and far from where it is looked for
    let r = open(
        &data("commas.trc"),
        "end_effector = \"E*\"\nend_effector_near_mm = [100, 200, 900]",
    )
    .unwrap();
    let note = r.notes.iter().find(|n| n.text.contains("nearest")).unwrap();
    assert!(
        note.level == Level::Warning && note.text.contains("600.0 mm away"),
        "{}",
        note.text
    );
}

// --- what a survey finds wrong
// -----------------------------------------------------------------------------------------

fn survey(text: &str) -> Survey {
    let mut file = tempfile::Builder::new().suffix(".csv").tempfile().unwrap();
    file.write_all(text.as_bytes()).unwrap();
    survey_file(file.path(), None, &ReadOptions::default()).unwrap()
}

/// A number between -0.5 and 0.5 that looks random.
fn noise(i: usize, k: usize) -> f64 {
    let mut h = (i * 31 + k * 977 + 1) as u64;
    for _ in 0..3 {
        h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (h >> 40) as f64 / (1u64 << 24) as f64 - 0.5
}

/// Two moving markers and a resting one at 100 Hz, each sample as `edit` leaves it.
fn trial(unit: &str, rows: usize, mut edit: impl FnMut(usize, &mut [[f64; 3]; 3])) -> String {
    let mut text = format!(
        "Trajectories\n100\n,,R:EE,,,R:Base,,,R:Tool,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z\n,,{unit},{unit},{unit},{unit},{unit},{unit},{unit},{unit},{unit}\n"
    );
    for i in 0..rows {
        let t = i as f64 / 100.0;
        let mut m = [
            [
                20.0 * (3.0 * t).sin(),
                15.0 * (3.0 * t).cos(),
                100.0 + 5.0 * (2.0 * t).sin(),
            ],
            [0.0, 200.0, 50.0],
            [60.0 + 10.0 * (2.5 * t).sin(), 40.0, 90.0],
        ];
        for (k, v) in m.iter_mut().flatten().enumerate() {
            *v += 0.1 * noise(i, k);
        }
        edit(i, &mut m);
        write!(text, "{},0", i + 1).unwrap();
        for v in m.iter().flatten() {
            if v.is_nan() {
                text.push(',');
            } else {
                write!(text, ",{v:.4}").unwrap();
            }
        }
        text.push('\n');
    }
    text
}

fn kinds(survey: &Survey) -> Vec<DoubtKind> {
    let mut kinds: Vec<DoubtKind> = survey.doubts.iter().map(|d| d.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    kinds
}

#[test]
fn a_clean_trial_raises_no_doubt() {
    for rows in [30, 3000, 20_000] {
        let s = survey(&trial("mm", rows, |_, _| {}));
        assert_eq!(s.doubts, [], "{rows}");
        // gaps are no doubt
        let s = survey(&trial("mm", rows, |i, m| {
            if i % 50 > 45 {
                m[0] = [f64::NAN; 3];
            }
        }));
        assert_eq!(s.doubts, [], "{rows}");
    }
}

#[test]
fn spikes_frozen_stretches_and_swaps_are_found_where_they_are() {
    // beyond the first batch of rows too
    for at in [700, 15_000] {
        let s = survey(&trial("mm", 20_000, |i, m| {
            if i == at {
                m[0][1] += 8.0;
            }
        }));
        assert_eq!(kinds(&s), [DoubtKind::Spikes]);
        let d = &s.doubts[0];
        assert_eq!(
            (d.what.as_slice(), d.time_s),
            (["R:EE".to_owned()].as_slice(), Some(at as f64 / 100.0))
        );
        assert!(d.says.contains("1 single sample"), "{}", d.says);

        let mut held = [0.0; 3];
        let s = survey(&trial("mm", 20_000, |i, m| {
            if i == at {
                held = m[2];
            }
            if (at..at + 60).contains(&i) {
                m[2] = held;
            }
        }));
        assert_eq!(kinds(&s), [DoubtKind::Frozen]);
        assert_eq!(s.doubts[0].what, ["R:Tool"]);
        assert_eq!(s.doubts[0].time_s, Some((at + 59) as f64 / 100.0));
        assert!(
            s.doubts[0].says.contains("60 samples (0.60 s)"),
            "{}",
            s.doubts[0].says
        );

        let s = survey(&trial("mm", 20_000, |i, m| {
            if (at..at + 40).contains(&i) {
                m.swap(0, 2);
            }
        }));
        assert_eq!(kinds(&s), [DoubtKind::Swap]);
        assert_eq!(s.doubts[0].what, ["R:EE", "R:Tool"]);
        assert_eq!(s.doubts[0].time_s, Some(at as f64 / 100.0));
        assert!(s.doubts[0].says.contains("2 times"), "{}", s.doubts[0].says);
    }
}

#[test]
fn a_swap_behind_a_gap_is_found() {
    let s = survey(&trial("mm", 3000, |i, m| {
        if i >= 1510 {
            m.swap(0, 2);
        }
        if (1500..1510).contains(&i) {
            *m = [[f64::NAN; 3]; 3];
        }
    }));
    assert_eq!(kinds(&s), [DoubtKind::Swap]);
}

#[test]
fn units_that_cannot_be() {
    let s = survey(&trial("m", 100, |_, _| {}));
    assert_eq!(kinds(&s), [DoubtKind::Unit]);
    assert!(
        s.doubts[0].says.contains("is the unit mm?"),
        "{}",
        s.doubts[0].says
    );
    let s = survey(&trial("mm", 100, |_, m| {
        m.iter_mut().flatten().for_each(|v| *v /= 1000.0)
    }));
    assert!(
        s.doubts
            .iter()
            .any(|d| d.kind == DoubtKind::Unit && d.says.contains("is the unit m?"))
    );
    let mut log = String::from("time_s,u_kV\n");
    for i in 0..100 {
        writeln!(log, "{},{}", f64::from(i) / 10.0, 1000 * i).unwrap();
    }
    let s = survey(&log);
    assert!(
        s.doubts
            .iter()
            .any(|d| d.kind == DoubtKind::Unit && d.says.contains("is the unit V?"))
    );
}

/// A log at 1 kHz of a voltage.
fn log(
    rows: usize,
    mut time: impl FnMut(usize) -> f64,
    mut volts: impl FnMut(usize) -> f64,
) -> Survey {
    let mut text = String::from("time_s,u_kV\n");
    for i in 0..rows {
        writeln!(text, "{:.5},{:.5}", time(i), volts(i)).unwrap();
    }
    survey(&text)
}

#[test]
fn clipped_voltages_and_commands_that_only_look_so() {
    let even = |i: usize| i as f64 / 1000.0;
    let wave = |i: usize| 6.0 * (i as f64 / 300.0).sin();
    let s = log(20_000, even, |i| (wave(i) + 0.01 * noise(i, 0)).min(5.0));
    assert_eq!(kinds(&s), [DoubtKind::Clipped]);
    assert!(
        s.doubts[0].says.contains("runs into 5 kV"),
        "{}",
        s.doubts[0].says
    );
    for (what, volts) in [
        ("a sine", &wave as &dyn Fn(usize) -> f64),
        ("noise", &|i| wave(i) + 0.02 * noise(i, 0)),
        ("a square wave", &|i| {
            if i / 500 % 2 == 0 { 0.0 } else { 5.0 }
        }),
        ("steps", &|i| (i / 1000) as f64 * 0.2),
        ("a ramp from rest", &|i| (i as f64 / 1000.0 - 5.0).max(0.0)),
    ] {
        assert_eq!(log(20_000, even, volts).doubts, [], "{what}");
    }
}

#[test]
fn clocks_that_drift_leap_or_step_back() {
    let wave = |i: usize| (i as f64 / 300.0).sin();
    let even = |i: usize| i as f64 / 1000.0;
    let s = log(20_000, |i| even(i) * (1.0 + 1e-7 * i as f64), wave);
    assert_eq!(kinds(&s), [DoubtKind::Clock]);
    assert!(
        s.doubts[0].says.contains("the clock drifts"),
        "{}",
        s.doubts[0].says
    );
    let s = log(20_000, |i| even(i) + if i > 9000 { 0.5 } else { 0.0 }, wave);
    assert!(
        s.doubts[0].says.contains("time leaps by 0.5"),
        "{}",
        s.doubts[0].says
    );
    let s = log(20_000, |i| even(if i == 7000 { 6990 } else { i }), wave);
    assert!(
        s.doubts[0].says.contains("(line 7002)"),
        "{}",
        s.doubts[0].says
    );
    // jitter of a tenth of a step, and a rate that is none of ours
    assert_eq!(
        log(20_000, |i| even(i) + 1e-4 * noise(i, 3), wave).doubts,
        []
    );
    assert_eq!(
        log(20_000, |i| i as f64 / 997.3, wave).sections[0]
            .rate_hz
            .unwrap()
            .round(),
        997.0
    );
}

/// The start that `deacal import --init` writes is a manifest.
#[test]
fn a_survey_says_enough_to_begin_a_manifest() {
    let s = survey(&trial("mm", 500, |_, _| {}));
    let section = &s.sections[0];
    assert_eq!(section.markers.len(), 3);
    assert_eq!(
        (section.rows, section.rate_hz, section.frames),
        (500, Some(100.0), Some([1, 500]))
    );
    let text = "[recording]\nid = \"a\"\nkind = \"robot\"\nrig = \"rig.toml\"\n[motion]\nfile = \"m.csv\"\nend_effector_near_mm = [1, 2, 3]\n[voltage]\nfile = \"v.csv\"\ntime = \"t_s\"\nchannels = [\"a\", \"b\", \"c\"]\n";
    let manifest = Manifest::parse(Path::new("recording.toml"), text).unwrap();
    let motion = manifest.motion.unwrap();
    assert_eq!(
        (motion.end_effector.as_str(), motion.end_effector_near_mm),
        ("*", Some([1.0, 2.0, 3.0]))
    );
}
