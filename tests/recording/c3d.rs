//! The C3D importer on files that are written here, one for each quirk.

use crate::mocap;

use std::io::Write;
use std::path::Path;

use deacal::recording::{
    Capture, Column, Error, ErrorKind, Level, ReadOptions, Section, read_file, survey_file,
};
use mocap::{C3dFile, Make, Value};

fn read(bytes: &[u8]) -> Result<Capture, Error> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    read_file(file.path())
}

fn section<'a>(capture: &'a Capture, name: &str) -> &'a Section {
    capture.sections.iter().find(|s| s.name == name).unwrap()
}

fn column<'a>(capture: &'a Capture, group: &str, axis: &str) -> &'a Column {
    capture
        .sections
        .iter()
        .find_map(|s| s.column(group, axis))
        .unwrap()
}

/// NaN as -1 to compare lists.
fn values(capture: &Capture, group: &str, axis: &str) -> Vec<f64> {
    let values = &column(capture, group, axis).values;
    values
        .iter()
        .map(|v| if v.is_nan() { -1.0 } else { *v })
        .collect()
}

fn says(capture: &Capture, words: &str) -> bool {
    capture
        .notes
        .iter()
        .any(|n| n.level == Level::Warning && n.text.contains(words))
}

#[test]
fn every_make_and_both_kinds_of_numbers() {
    for make in [Make::Intel, Make::Dec, Make::Sgi] {
        for scale in [-0.1, 0.5] {
            for groups_last in [false, true] {
                let file = C3dFile {
                    make,
                    scale,
                    groups_last,
                    channels: 2,
                    per_frame: 2,
                    parameters: vec![
                        ("POINT", "LABELS", Value::Text(vec!["EE", "Base"])),
                        ("POINT", "UNITS", Value::Text(vec!["mm"])),
                        ("ANALOG", "LABELS", Value::Text(vec!["phi1", "phi2"])),
                        ("ANALOG", "UNITS", Value::Text(vec!["V", "V"])),
                        ("ANALOG", "SCALE", Value::Floats(vec![0.5, 2.0])),
                        ("ANALOG", "OFFSET", Value::Words(vec![10, 0])),
                        ("ANALOG", "GEN_SCALE", Value::Floats(vec![-0.25])),
                    ],
                    analog: (0..12).map(|v| v as f32).collect(),
                    ..C3dFile::default()
                };
                let capture = read(&file.bytes()).unwrap();
                let what = format!("{make:?} {scale} {groups_last}");
                assert_eq!(capture.format, "c3d");
                assert_eq!(values(&capture, "EE", "X"), [0.0, 2.0, 4.0], "{what}");
                assert_eq!(values(&capture, "Base", "Y"), [11.0, 13.0, 15.0], "{what}");
                assert_eq!(values(&capture, "Base", "Z"), [-0.5; 3], "{what}");
                assert_eq!(column(&capture, "EE", "X").unit, "mm");
                // (raw - OFFSET) SCALE GEN_SCALE, channel fastest
                assert_eq!(
                    values(&capture, "phi1", ""),
                    [0.0, 2.0, 4.0, 6.0, 8.0, 10.0].map(|v| (v - 10.0) * 0.5 * -0.25),
                    "{what}"
                );
                assert_eq!(values(&capture, "phi2", "")[5], 11.0 * 2.0 * -0.25);
                let devices = section(&capture, "Devices");
                assert_eq!(
                    (devices.rate_hz, devices.subframes_per_frame),
                    (Some(200.0), Some(2))
                );
                assert_eq!(devices.times_s().unwrap()[3], 0.015);
                assert!(
                    capture.notes[0]
                        .text
                        .contains("2 points, 2 channels, 3 frames from 1 at 100 Hz")
                );
            }
        }
    }
}

#[test]
fn three_ways_of_not_being_seen() {
    let file = C3dFile {
        points: 1,
        last: 6,
        xyzw: vec![
            [1.0, 2.0, 3.0, -1.0],
            [f32::NAN, 2.0, 3.0, 0.0],
            [0.0, 0.0, 0.0, 0.0],
            // a position at the origin that cameras saw
            [0.0, 0.0, 0.0, 5.0],
            // garbage beside a position
            [1.0, 2.0, 3.0, 1.7e38],
            // residual 3 units of 0.1, cameras 1 and 3
            [1.0, 2.0, 3.0, 5.0 * 256.0 + 3.0],
        ],
        parameters: vec![("POINT", "LABELS", Value::Text(vec!["EE"]))],
        ..C3dFile::default()
    };
    let capture = read(&file.bytes()).unwrap();
    assert_eq!(
        values(&capture, "EE", "X"),
        [-1.0, -1.0, -1.0, 0.0, 1.0, 1.0]
    );
    let residual = values(&capture, "EE", "residual");
    assert!((residual[3] - 0.5).abs() < 1e-7 && (residual[5] - 0.3).abs() < 1e-7);
    assert_eq!(residual[4], -1.0);
    let points = section(&capture, "Trajectories");
    let gaps = points.gaps(points.groups[0].columns.clone());
    assert_eq!((gaps.missing, gaps.runs), (3, 1));
    assert!(says(&capture, "unit of the points is not stated"));
    assert_eq!(column(&capture, "EE", "X").unit, "");
}

/// The fourth word of a point is a 16-bit number with a sign. Vicon Workstation wrote it into floats without:
/// what was not seen is 0, 0, 0 with 65535, and is no position at the origin.
#[test]
fn minus_one_without_its_sign_is_not_seen() {
    for make in [Make::Intel, Make::Dec, Make::Sgi] {
        for (scale, unseen) in [
            (-0.1, 65_535.0),
            (-0.1, 40_000.0),
            (-0.1, -1.0),
            (0.5, 65_535.0),
        ] {
            let seen = 127.0 * 256.0 + 2.0;
            let file = C3dFile {
                make,
                scale,
                points: 2,
                last: 4,
                xyzw: vec![
                    [100.0, 200.0, 300.0, seen],
                    [0.0, 0.0, 0.0, unseen],
                    [0.0, 0.0, 0.0, unseen],
                    [0.0, 0.0, 0.0, unseen],
                    [102.0, 200.0, 300.0, seen],
                    [0.0, 0.0, 0.0, unseen],
                    [103.0, 200.0, 300.0, 0.0],
                    [0.0, 0.0, 0.0, unseen],
                ],
                ..C3dFile::default()
            };
            let what = format!("{make:?} {scale} {unseen}");
            let mut on_disk = tempfile::NamedTempFile::new().unwrap();
            on_disk.write_all(&file.bytes()).unwrap();
            let capture = read_file(on_disk.path()).unwrap();
            assert_eq!(
                values(&capture, "EE", "X"),
                [100.0, -1.0, 102.0, 103.0],
                "{what}"
            );
            assert_eq!(values(&capture, "Base", "Z"), [-1.0; 4], "{what}");
            let residual = values(&capture, "EE", "residual");
            assert!(
                (residual[0] - 2.0 * f64::from(scale).abs()).abs() < 1e-6,
                "{what}"
            );
            assert_eq!(&residual[1..], [-1.0, residual[0], 0.0], "{what}");
            let survey = survey_file(on_disk.path(), None, &ReadOptions::default()).unwrap();
            let points = &survey.sections[0];
            let missing: Vec<usize> = points.groups.iter().map(|g| g.gaps.missing).collect();
            assert_eq!(missing, [1, 4], "{what}");
            let range = |title: &str| {
                points
                    .columns
                    .iter()
                    .find(|c| c.title == title)
                    .unwrap()
                    .range
            };
            assert_eq!(range("EE/X"), Some([100.0, 103.0]), "{what}");
            assert_eq!(range("Base/X"), None, "{what}");
            assert_eq!(survey.doubts, [], "{what}");
        }
    }
}

#[test]
fn names_beyond_255_go_on_in_labels2() {
    let name = |i: usize| format!("m{i}");
    let file = C3dFile {
        points: 300,
        last: 1,
        xyzw: (0..300).map(|i| [i as f32, 0.0, 1.0, 0.0]).collect(),
        parameters: vec![
            (
                "POINT",
                "LABELS",
                Value::Texts((0..255).map(name).collect()),
            ),
            (
                "POINT",
                "LABELS2",
                Value::Texts((255..300).map(name).collect()),
            ),
            ("POINT", "UNITS", Value::Text(vec!["m"])),
        ],
        ..C3dFile::default()
    };
    let capture = read(&file.bytes()).unwrap();
    assert_eq!(section(&capture, "Trajectories").groups.len(), 300);
    assert_eq!(values(&capture, "m299", "X"), [299.0]);
    // channels: SCALE2, OFFSET2 and UNITS2 go with them
    let channel = |i: usize| format!("a{i}");
    let file = C3dFile {
        points: 0,
        channels: 260,
        last: 1,
        xyzw: Vec::new(),
        analog: vec![4.0; 260],
        parameters: vec![
            (
                "ANALOG",
                "LABELS",
                Value::Texts((0..255).map(channel).collect()),
            ),
            (
                "ANALOG",
                "LABELS2",
                Value::Texts((255..260).map(channel).collect()),
            ),
            ("ANALOG", "SCALE", Value::Floats(vec![1.0; 255])),
            ("ANALOG", "SCALE2", Value::Floats(vec![3.0; 5])),
            ("ANALOG", "UNITS", Value::Texts(vec!["V".to_owned(); 255])),
            ("ANALOG", "UNITS2", Value::Texts(vec!["mV".to_owned(); 5])),
        ],
        ..C3dFile::default()
    };
    let capture = read(&file.bytes()).unwrap();
    assert_eq!(capture.sections.len(), 1);
    assert_eq!(values(&capture, "a259", ""), [12.0]);
    assert_eq!(column(&capture, "a259", "").unit, "mV");
}

#[test]
fn more_frames_than_a_header_can_count() {
    let long = |parameters| C3dFile {
        points: 1,
        first: 1,
        last: 65_535,
        padded: false,
        scale: 0.01,
        xyzw: (0..70_000)
            .map(|i| [(i % 300) as f32, 1.0, 2.0, 0.0])
            .collect(),
        parameters,
        ..C3dFile::default()
    };
    let (low, high) = ((70_000 % 65_536) as i16, 1);
    // without any count, the zeros that fill the last block are no frames
    let mut padded = long(vec![("POINT", "UNITS", Value::Text(vec!["mm"]))]);
    padded.padded = true;
    assert_eq!(read(&padded.bytes()).unwrap().sections[0].rows(), 70_000);
    for parameters in [
        vec![
            ("TRIAL", "ACTUAL_START_FIELD", Value::Words(vec![1, 0])),
            ("TRIAL", "ACTUAL_END_FIELD", Value::Words(vec![low, high])),
        ],
        vec![("POINT", "LONG_FRAMES", Value::Floats(vec![70_000.0]))],
        // unknown: the size of the file tells
        vec![("POINT", "FRAMES", Value::Words(vec![-1]))],
    ] {
        let capture = read(&long(parameters).bytes()).unwrap();
        let points = section(&capture, "Trajectories");
        assert_eq!((points.rows(), points.frames[69_999]), (70_000, 70_000));
        assert!((values(&capture, "*1", "X")[69_999] - f64::from(69_999 % 300)).abs() < 1e-2);
    }
}

#[test]
fn a_file_that_was_cut_gives_its_whole_frames() {
    let file = C3dFile {
        padded: false,
        ..C3dFile::default()
    };
    let bytes = file.bytes();
    let capture = read(&bytes[..bytes.len() - 5]).unwrap();
    assert_eq!(values(&capture, "EE", "X"), [0.0, 2.0]);
    assert!(says(&capture, "3 frames are declared and 2 are there"));
    let error = read(&bytes[..bytes.len() - 80]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NoData);
    assert!(
        error
            .to_string()
            .contains("3 frames are declared and none is there"),
        "{error}"
    );
    let error = read(&bytes[..700]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NoData, "{error}");
}

#[test]
fn counts_that_fit_the_file_win() {
    // POINT:USED is one too many, the header is right
    let mut file = C3dFile::default();
    file.parameters
        .push(("POINT", "USED", Value::Words(vec![3])));
    file.parameters
        .push(("POINT", "FRAMES", Value::Words(vec![2])));
    let capture = read(&file.bytes()).unwrap();
    assert_eq!(section(&capture, "Trajectories").rows(), 3);
    assert!(says(&capture, "POINT:USED is 3") && says(&capture, "POINT:FRAMES is 2"));
    // the header's number of points is wrong, POINT:USED fits
    let many = C3dFile {
        last: 40,
        xyzw: vec![[1.0, 2.0, 3.0, 0.0]; 80],
        parameters: vec![("POINT", "USED", Value::Words(vec![2]))],
        ..C3dFile::default()
    };
    let mut bytes = many.bytes();
    bytes[2] = 9;
    let capture = read(&bytes).unwrap();
    assert_eq!(section(&capture, "Trajectories").groups.len(), 2);
    assert!(says(&capture, "do not fit the size of the file"));
}

#[test]
fn scales_rates_units_and_labels_that_contradict() {
    let file = C3dFile {
        scale: 0.5,
        parameters: vec![
            ("POINT", "SCALE", Value::Floats(vec![0.25])),
            ("POINT", "RATE", Value::Floats(vec![50.0])),
            ("POINT", "LABELS", Value::Text(vec!["RTHI", "RTHI"])),
            ("POINT", "UNITS", Value::Text(vec!["mete"])),
            ("POINT", "UNITS", Value::Text(vec!["mete"])),
            ("TRIAL", "NOTHING", Value::Empty),
        ],
        ..C3dFile::default()
    };
    let capture = read(&file.bytes()).unwrap();
    assert_eq!(values(&capture, "RTHI", "X"), [0.0, 2.0, 4.0]);
    assert_eq!(values(&capture, "RTHI#2", "X"), [1.0, 3.0, 5.0]);
    assert_eq!(column(&capture, "RTHI", "X").unit, "m");
    for words in [
        "0.25 in POINT:SCALE",
        "50 Hz in POINT:RATE",
        "\"mete\", taken as m",
        "share a label",
        "there twice",
    ] {
        assert!(says(&capture, words), "{words}: {:?}", capture.notes);
    }
}

#[test]
fn what_is_no_position_is_kept_apart() {
    let mut file = C3dFile::default();
    file.parameters
        .push(("POINT", "ANGLES", Value::Text(vec!["Base"])));
    file.parameters
        .push(("POINT", "ANGLE_UNITS", Value::Text(vec!["deg"])));
    let capture = read(&file.bytes()).unwrap();
    assert_eq!(section(&capture, "Trajectories").groups.len(), 1);
    assert_eq!(section(&capture, "Model Outputs").columns[0].unit, "deg");
}

#[test]
fn offsets_without_a_sign() {
    let volts = |scale, format: Option<&'static str>, offset: i16, raw: f32| {
        let mut parameters = vec![
            ("ANALOG", "OFFSET", Value::Words(vec![offset])),
            ("ANALOG", "SCALE", Value::Floats(vec![1.0])),
        ];
        if let Some(format) = format {
            parameters.push(("ANALOG", "FORMAT", Value::Text(vec![format])));
        }
        let file = C3dFile {
            points: 0,
            channels: 1,
            last: 2,
            scale,
            xyzw: Vec::new(),
            analog: vec![raw, raw],
            parameters,
            ..C3dFile::default()
        };
        values(&read(&file.bytes()).unwrap(), "*1", "")[0]
    };
    // 32784 as a word is -32752
    assert_eq!(volts(0.1, Some("UNSIGNED"), -32_752, 32_790.0), 6.0);
    assert_eq!(volts(-0.1, Some("UNSIGNED"), -32_752, 32_790.0), 6.0);
    // SIGNED, but no number with a sign is that large
    assert_eq!(volts(-0.1, Some("SIGNED"), -32_768, 32_768.0), 0.0);
    // truly signed
    assert_eq!(volts(-0.1, None, -100, 50.0), 150.0);
}

#[test]
fn parameters_elsewhere_damaged_or_absent() {
    let far = C3dFile {
        parameter_block: 7,
        first: 300,
        last: 302,
        ..C3dFile::default()
    };
    let capture = read(&far.bytes()).unwrap();
    assert_eq!(section(&capture, "Trajectories").frames, [300, 301, 302]);
    assert_eq!(
        section(&capture, "Trajectories").times_s().unwrap()[0],
        2.99
    );
    // the second record is cut off in its length
    let mut damaged = C3dFile::default().bytes();
    damaged[512 + 4 + 10 + 1] = 99;
    damaged[512 + 4 + 10] = 127;
    let capture = read(&damaged).unwrap();
    assert_eq!(values(&capture, "*1", "X"), [0.0, 2.0, 4.0]);
    assert!(says(&capture, "damaged"));
    // no parameters, and a processor that is not known: the header makes sense in one byte order only
    for make in [Make::Intel, Make::Sgi] {
        let mut none = C3dFile {
            make,
            parameters: Vec::new(),
            ..C3dFile::default()
        }
        .bytes();
        none[515] = 0;
        let capture = read(&none).unwrap();
        assert_eq!(values(&capture, "*2", "X"), [1.0, 3.0, 5.0], "{make:?}");
        assert!(says(&capture, "processor type 0") && says(&capture, "no parameters"));
    }
}

#[test]
fn a_length_is_not_trusted() {
    // a header that promises 65535 points, and one that promises nothing
    let mut bytes = C3dFile::default().bytes();
    bytes[2..4].copy_from_slice(&[0xff, 0xff]);
    assert_eq!(read(&bytes).unwrap_err().kind(), ErrorKind::NoData);
    bytes[2..4].copy_from_slice(&[0, 0]);
    let error = read(&bytes).unwrap_err();
    assert!(
        error.to_string().contains("no points and no channels"),
        "{error}"
    );
    // the data begin beyond the end
    let mut bytes = C3dFile::default().bytes();
    bytes[16..18].copy_from_slice(&[0xff, 0xff]);
    assert_eq!(read(&bytes).unwrap_err().kind(), ErrorKind::NoData);
}

/// `DEACAL_WRITE_CORPUS=1 cargo test --test recording c3d::` writes the seeds for fuzzing.
#[test]
fn seeds_for_fuzzing_are_current() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/c3d");
    let analog = |make, scale| C3dFile {
        make,
        scale,
        channels: 2,
        per_frame: 2,
        analog: (0..12).map(|v| v as f32).collect(),
        parameters: vec![
            ("POINT", "LABELS", Value::Text(vec!["EE", "Base"])),
            ("POINT", "UNITS", Value::Text(vec!["mm"])),
            ("POINT", "ANGLES", Value::Text(vec!["Base"])),
            ("ANALOG", "LABELS", Value::Text(vec!["phi1", "phi2"])),
            ("ANALOG", "OFFSET", Value::Words(vec![-10, 0])),
            ("TRIAL", "ACTUAL_END_FIELD", Value::Words(vec![3, 0])),
            ("EVENT", "TIMES", Value::Floats(vec![0.0, 1.5])),
            ("EVENT", "LABELS", Value::Text(vec!["start"])),
        ],
        ..C3dFile::default()
    };
    for (name, file) in [
        ("intel-float.c3d", analog(Make::Intel, -0.1)),
        ("dec-whole.c3d", analog(Make::Dec, 0.1)),
        ("sgi-float.c3d", analog(Make::Sgi, -0.1)),
        (
            "groups-last.c3d",
            C3dFile {
                groups_last: true,
                padded: false,
                ..C3dFile::default()
            },
        ),
    ] {
        let path = dir.join(name);
        if std::env::var_os("DEACAL_WRITE_CORPUS").is_some() {
            std::fs::create_dir_all(&dir).unwrap();
            std::fs::write(&path, file.bytes()).unwrap();
        }
        assert!(
            std::fs::read(&path).unwrap() == file.bytes(),
            "{} is not current",
            path.display()
        );
    }
}
