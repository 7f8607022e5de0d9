//! Importers on small hand-made files, one for each quirk of the formats.

use std::io::Write;
use std::path::{Path, PathBuf};

use deacal::recording::{
    Capture, ColumnRef, Error, ErrorKind, Level, ReadOptions, Section, importers, read_file,
    read_file_as, survey_file,
};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/data/recording")
        .join(name)
}

/// Reads bytes as a file.
fn read(bytes: impl AsRef<[u8]>) -> Result<Capture, Error> {
    let mut file = tempfile::Builder::new().suffix(".csv").tempfile().unwrap();
    file.write_all(bytes.as_ref()).unwrap();
    read_file(file.path())
}

fn read_columns(bytes: impl AsRef<[u8]>, columns: &[ColumnRef]) -> Result<Capture, Error> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes.as_ref()).unwrap();
    let options = ReadOptions {
        columns: Some(columns.to_vec()),
        ..ReadOptions::default()
    };
    read_file_as(file.path(), Some("csv"), &options)
}

/// NaN as -1 to compare lists.
fn values(section: &Section, group: &str, axis: &str) -> Vec<f64> {
    let column = section.column(group, axis).unwrap();
    column
        .values
        .iter()
        .map(|v| if v.is_nan() { -1.0 } else { *v })
        .collect()
}

fn warnings(capture: &Capture) -> Vec<&str> {
    capture
        .notes
        .iter()
        .filter(|n| n.level == Level::Warning)
        .map(|n| n.text.as_str())
        .collect()
}

const NEXUS: &str = "Trajectories\n100\n,,DEA:EE,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n";

#[test]
fn spreadsheet_padding_sections_and_sub_frames() {
    let capture = read_file(&data("padded.csv")).unwrap();
    assert_eq!(capture.format, "nexus-csv");
    let names: Vec<(&str, u64)> = capture
        .sections
        .iter()
        .map(|s| (s.name.as_str(), s.line))
        .collect();
    assert_eq!(
        names,
        [("Devices", 3), ("Joints", 15), ("Trajectories", 22)]
    );

    let devices = &capture.sections[0];
    assert_eq!(
        (devices.rate_hz, devices.subframes_per_frame),
        (Some(300.0), Some(3))
    );
    // frame 2, sub-frame 1 of 3 at 100 frames a second: (2 - 1 + 1/3)/100
    assert_eq!(devices.times_s().unwrap()[4], 4.0 / 300.0);
    assert_eq!(
        values(devices, "Amplifier - Voltage", "1"),
        [1.0, 1.1, 1.2, 2.0, 2.1, 2.2]
    );
    let groups: Vec<_> = devices
        .groups
        .iter()
        .map(|g| (g.name.as_str(), g.columns.clone()))
        .collect();
    assert_eq!(groups, [("Amplifier - Voltage", 0..2), ("Force", 2..3)]);
    assert_eq!(devices.columns[2].unit, "N");

    let joints = &capture.sections[1];
    assert_eq!(joints.subframes_per_frame, None);
    assert_eq!(
        (joints.rows(), joints.groups.len(), joints.columns.len()),
        (2, 3, 5)
    );
    assert_eq!(
        (
            joints.columns[1].axis.as_str(),
            joints.columns[1].unit.as_str()
        ),
        ("", "")
    );

    let trajectories = &capture.sections[2];
    assert_eq!(values(trajectories, "arm:a", "Y"), [2.0, -1.0]);
    assert_eq!(
        values(trajectories, "Trajectory Count", "Count"),
        [1.0, 0.0]
    );
    assert_eq!(trajectories.gaps(0..3).missing, 1);
    assert!(
        capture
            .notes
            .iter()
            .any(|n| n.text.contains("1 events left out"))
    );
}

#[test]
fn semicolons_decimal_comma_latin_1_and_a_cut_row() {
    let capture = read_file(&data("semicolon.csv")).unwrap();
    let section = &capture.sections[0];
    assert_eq!(section.groups[0].name, "Daphñée:a b");
    assert_eq!(values(section, "Daphñée:a b", "X"), [1.5, 1.25]);
    assert_eq!(values(section, "Daphñée:a b", "Y"), [-2.25, -1.0]);
    assert_eq!(values(section, "Daphñée:c", "X"), [1234.5, -1.0]);
    let notes = warnings(&capture);
    assert!(
        notes.iter().any(|n| n.contains("middle of a row")),
        "{notes:?}"
    );
    assert!(capture.notes.iter().any(|n| n.text.contains("Latin-1")));
    assert!(capture.notes.iter().any(|n| n.text.contains("semicolon")));
}

#[test]
fn tabs_and_a_column_that_mixes_notations() {
    let error = read_file(&data("tab.txt")).unwrap_err();
    assert_eq!(
        (error.line(), error.column()),
        (Some(6), Some(3)),
        "{error}"
    );
    assert!(error.to_string().contains("\"1.5\""), "{error}");
    let good = NEXUS.replace(',', "\t") + "1\t0\t1,5\t\t3\n";
    assert_eq!(
        values(&read(good).unwrap().sections[0], "DEA:EE", "X"),
        [1.5]
    );
}

#[test]
fn tracker_has_the_same_rows() {
    let capture = read_file(&data("tracker.csv")).unwrap();
    assert_eq!(capture.format, "tracker-csv");
    assert_eq!(
        values(&capture.sections[0], "Global Angle Arm:Tip", "TX"),
        [1.0, 4.0]
    );
}

#[test]
fn frames_that_begin_late_or_are_left_out() {
    let capture = read(format!("{NEXUS}500,0,1,2,3\n501,0,1,2,3\n504,0,1,2,3\n")).unwrap();
    let section = &capture.sections[0];
    assert_eq!(section.frames, [500, 501, 504]);
    assert_eq!(section.times_s().unwrap()[0], 4.99);
    assert!(warnings(&capture)[0].contains("2 frames between 500 and 504"));
    let error = read(format!("{NEXUS}7,0,1,2,3\n7,0,1,2,3\n")).unwrap_err();
    assert_eq!(
        (error.kind(), error.line()),
        (ErrorKind::TimeOrder, Some(7)),
        "{error}"
    );
}

#[test]
fn sections_may_follow_without_a_blank_row() {
    let capture = read(format!("{NEXUS}1,0,1,2,3\n{NEXUS}1,0,4,5,6")).unwrap();
    assert_eq!(capture.sections.len(), 2);
    assert_eq!(values(&capture.sections[1], "DEA:EE", "Z"), [6.0]);
}

#[test]
fn a_file_without_its_header_is_refused_usefully() {
    let error = read_file(&data("headerless.csv")).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Grammar);
    let text = error.to_string();
    assert!(
        text.contains("2 columns and no header row") && text.contains("by number from 1"),
        "{text}"
    );
    // told to be a Nexus export, it is still none
    let options = ReadOptions::default();
    let error = read_file_as(&data("headerless.csv"), Some("nexus-csv"), &options).unwrap_err();
    assert!(
        error.to_string().contains("the name of a section"),
        "{error}"
    );
}

#[test]
fn what_is_wrong_in_a_nexus_file_has_a_place() {
    let cases: &[(&str, ErrorKind, u64, Option<usize>)] = &[
        ("1,0,1,NaN,3\n", ErrorKind::NotFinite, 6, Some(4)),
        ("1,0,1,2,-inf\n", ErrorKind::NotFinite, 6, Some(5)),
        ("1,0,1,2,3\n2,0,1,x,3\n", ErrorKind::BadNumber, 7, Some(4)),
        ("1,0,1,2\n2,0,1,2,3\n", ErrorKind::CellCount, 6, None),
        ("1,0,1,2,3,4\n", ErrorKind::CellCount, 6, Some(6)),
        ("1.5,0,1,2,3\n", ErrorKind::BadNumber, 6, Some(1)),
        (",0,1,2,3\n", ErrorKind::BadNumber, 6, Some(1)),
        ("1,-1,1,2,3\n", ErrorKind::BadNumber, 6, Some(2)),
        ("2,0,1,2,3\n1,0,1,2,3\n", ErrorKind::TimeOrder, 7, Some(1)),
        ("1,0,1,2,3\n\nhello\n", ErrorKind::Grammar, 8, Some(1)),
        ("", ErrorKind::NoData, 1, None),
    ];
    for (rows, kind, line, column) in cases {
        let error = read(format!("{NEXUS}{rows}")).unwrap_err();
        assert_eq!(
            (error.kind(), error.line(), error.column()),
            (*kind, Some(*line), *column),
            "{error}"
        );
        assert!(!error.to_string().contains('\n'));
    }
    let headers = [
        (
            "Trajectories\nfast\n,,a,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n",
            2,
            "rate in Hz",
        ),
        (
            "Trajectories\n100\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n",
            4,
            "begins with Frame",
        ),
        (
            "Trajectories\n100\n,,,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n",
            3,
            "name at the first",
        ),
        ("Trajectories\n100\n,,a\n", 4, "row Frame"),
    ];
    for (text, line, what) in headers {
        let error = read(text).unwrap_err();
        assert_eq!(error.line(), Some(line), "{error}");
        assert!(
            error
                .to_string()
                .replace("marker or device name", "name")
                .contains(what),
            "{error}"
        );
    }
}

#[test]
fn decimal_dots_that_turn_out_to_part_thousands() {
    let columns = [ColumnRef::Number(1), ColumnRef::Number(2)];
    let bytes = std::fs::read(data("thousands.csv")).unwrap();
    let capture = read_columns(bytes, &columns).unwrap();
    let section = &capture.sections[0];
    assert_eq!(
        section.columns[0].values,
        [903_000.0, 1_003_000.0, 1_103_000.0]
    );
    assert_eq!(section.columns[1].values, [3.658, 3.7, 3.71]);
}

#[test]
fn gbk_header_unit_row_quoted_numbers() {
    let options = ReadOptions {
        encoding: Some("gbk".to_owned()),
        columns: None,
    };
    let capture = read_file_as(&data("gbk.csv"), None, &options).unwrap();
    let section = &capture.sections[0];
    let columns: Vec<_> = section
        .columns
        .iter()
        .map(|c| (c.axis.as_str(), c.unit.as_str()))
        .collect();
    assert_eq!(columns, [("时间", "s"), ("位移", "mm"), ("力", "N")]);
    assert_eq!(section.columns[2].values, [-0.0018, 0.0292]);
    assert_eq!(section.lines.line(1), 5);
    // undeclared: numbers are read, the names are Latin-1 and it is said
    let capture = read_file(&data("gbk.csv")).unwrap();
    assert_eq!(capture.sections[0].columns[2].values, [-0.0018, 0.0292]);
    assert!(warnings(&capture)[0].contains("not UTF-8"));
}

#[test]
fn tables_in_many_dresses() {
    // preamble, blank line, header with units, text column, trailing delimiter
    let text = "Machine;Instron 5569;;\nSpeed (mm/min);450;;\n;;;\nTime (s);State;F [N];\n0;on;1,5;\n0,1;on;;\n0,2;off;2,5;\n";
    let capture = read(text).unwrap();
    let section = &capture.sections[0];
    let columns: Vec<_> = section
        .columns
        .iter()
        .map(|c| (c.axis.as_str(), c.unit.as_str(), c.number))
        .collect();
    assert_eq!(columns, [("Time (s)", "s", 1), ("F [N]", "N", 3)]);
    assert_eq!(values(section, "", "Time (s)"), [0.0, 0.1, 0.2]);
    assert_eq!(values(section, "", "F [N]"), [1.5, -1.0, 2.5]);
    assert_eq!(section.line, 4);
    let notes = warnings(&capture).join("; ");
    assert!(
        notes.contains("State") && notes.contains("1 of 3"),
        "{notes}"
    );
    // words as units
    let capture = read("x-axis,1,2\nsecond,Volt,Volt\n-1E-03,+2E-03,0\n").unwrap();
    assert_eq!(capture.format, "keysight-csv");
    assert_eq!(capture.sections[0].columns[1].unit, "V");
    assert_eq!(capture.sections[0].stamps_s, Some(vec![-1e-3]));
    // spaces
    let capture = read("t_s   u_V\n  0.0   1.0\n  0.1   2.0\n").unwrap();
    assert_eq!(values(&capture.sections[0], "", "u_V"), [1.0, 2.0]);
    // UTF-16 as spreadsheets write it
    let mut bytes = vec![0xff, 0xfe];
    bytes.extend(
        "t_s\tu_V\r\n0\t1,5\r\n"
            .encode_utf16()
            .flat_map(u16::to_le_bytes),
    );
    assert_eq!(values(&read(bytes).unwrap().sections[0], "", "u_V"), [1.5]);
    // one column
    assert_eq!(
        read("V1\n0.5\n1\n").unwrap().sections[0].columns[0].values,
        [0.5, 1.0]
    );
}

/// What says that nothing was measured is a gap, as an empty cell is; what was infinite is not.
#[test]
fn nan_in_a_table_is_a_gap() {
    for nan in ["NaN", "nan", "-nan(ind)", "1.#QNAN", "#N/A", ""] {
        let text = format!("t_s,u_V,w_V\n0,1,5\n1,{nan},6\n2,3,{nan}\n");
        let capture = read(&text).unwrap();
        let section = &capture.sections[0];
        assert_eq!(values(section, "", "u_V"), [1.0, -1.0, 3.0], "{nan}");
        assert_eq!(values(section, "", "w_V"), [5.0, 6.0, -1.0], "{nan}");
        let said = warnings(&capture).join("; ");
        assert!(
            said.contains("column u_V: 1 of 3 values missing"),
            "{nan}: {said}"
        );
    }
    // in the first row, and in most of a column
    let capture = read("t_s,u_V\n0,NaN\n1,nan\n2,4\n").unwrap();
    assert_eq!(values(&capture.sections[0], "", "u_V"), [-1.0, -1.0, 4.0]);
}

#[test]
fn what_is_wrong_in_a_table_has_a_place() {
    let cases: &[(&str, ErrorKind, Option<u64>, Option<usize>)] = &[
        ("", ErrorKind::Empty, None, None),
        ("\r\n \n", ErrorKind::Empty, None, None),
        ("t_s,u_V\n", ErrorKind::NoData, Some(1), None),
        (
            "t_s,u_V\n0,1\n1,inf\n",
            ErrorKind::NotFinite,
            Some(3),
            Some(2),
        ),
        (
            "t_s,u_V\n0,1\n1,1e400\n",
            ErrorKind::NotFinite,
            Some(3),
            Some(2),
        ),
        (
            "t_s,u_V\n0,1\n1,2x\n2,1\n",
            ErrorKind::BadNumber,
            Some(3),
            Some(2),
        ),
        (
            "t_s,u_V\n0,1\n1\n2,1\n",
            ErrorKind::CellCount,
            Some(3),
            None,
        ),
        (
            "t_s,u_V\n0,1\n1,2,3\n",
            ErrorKind::CellCount,
            Some(3),
            Some(3),
        ),
        (
            "t_s,u_V\n0,\"1,234\"\n1,2\n",
            ErrorKind::BadNumber,
            Some(2),
            Some(2),
        ),
    ];
    for (text, kind, line, column) in cases {
        let error = read(text).unwrap_err();
        assert_eq!(
            (error.kind(), error.line(), error.column()),
            (*kind, *line, *column),
            "{text:?}: {error}"
        );
    }
}

#[test]
fn columns_are_found_or_the_others_are_listed() {
    let name = |n: &str| ColumnRef::Name(n.to_owned());
    let text = "time_s,phi1_kV,phi2_kV,x,x\n0,1,2,3,4\n";
    let capture = read_columns(text, &[name("phi2_kV"), ColumnRef::Number(1)]).unwrap();
    assert_eq!(capture.sections[0].columns.len(), 2);
    let error = read_columns(text, &[name("phi3_kV")]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::UnknownColumn);
    assert!(
        error.to_string().contains("time_s, phi1_kV, phi2_kV"),
        "{error}"
    );
    assert!(error.to_string().contains("did you mean \"phi"), "{error}");
    let error = read_columns(text, &[ColumnRef::Number(6)]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::UnknownColumn);
    let error = read_columns(text, &[name("x")]).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Ambiguous);
    assert!(error.to_string().contains("4, 5"), "{error}");
    let error = read_columns("0,1\n", &[name("x")]).unwrap_err();
    assert!(error.to_string().contains("no header row"), "{error}");
}

#[test]
fn rows_of_a_frame_number_alone_and_rows_that_were_cut() {
    for (rows, frames) in [
        ("98,0,1,2,3\n99\n100,\n101,0\n", vec![98, 99, 100, 101]),
        // cut inside the frame number, after it, and inside the row
        ("98,0,1,2,3\n9", vec![98]),
        ("98,0,1,2,3\n99,", vec![98]),
        ("98,0,1,2,3\n99,0,1,-", vec![98]),
        ("98,0,1,2,3\n99,0,1,2,3", vec![98, 99]),
    ] {
        let capture = read(format!("{NEXUS}{rows}")).unwrap();
        assert_eq!(capture.sections[0].frames, frames, "{rows:?}");
        assert_eq!(capture.sections[0].columns[2].values.len(), frames.len());
    }
}

#[test]
fn trailing_delimiters_may_come_and_go() {
    let capture = read("t_s,u_V,\n0,1,\n1,2\n2,3,,\n").unwrap();
    assert_eq!(capture.sections[0].columns[1].values, [1.0, 2.0, 3.0]);
}

#[test]
fn a_cut_file_and_a_missing_last_newline() {
    let capture = read("t_s,u_V\n0,1\n1,2").unwrap();
    assert_eq!(capture.sections[0].rows(), 2);
    assert!(warnings(&capture).is_empty());
    let capture = read("t_s,u_V\n0,1\n1").unwrap();
    assert_eq!(capture.sections[0].rows(), 1);
    assert!(warnings(&capture)[0].contains("middle of a row"));
}

#[test]
fn a_file_of_one_endless_line_is_refused_by_every_importer() {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    let block = vec![b'1'; 1 << 20];
    for _ in 0..32 {
        file.write_all(&block).unwrap();
    }
    let start = std::time::Instant::now();
    for importer in importers() {
        let error = importer
            .read(file.path(), &ReadOptions::default())
            .unwrap_err();
        // a binary file has no lines
        let expected = match importer.name() {
            "c3d" | "mat" | "mcap" | "tdms" | "xlsx" => (ErrorKind::Grammar, None),
            _ => (ErrorKind::LineTooLong, Some(1)),
        };
        assert_eq!((error.kind(), error.line()), expected, "{error}");
    }
    assert!(start.elapsed().as_secs_f64() < 2.0);
}

#[test]
fn unknown_formats_and_missing_files() {
    let error = read(b"\x00\x01\x02binary").unwrap_err();
    assert_eq!(error.kind(), ErrorKind::UnknownFormat);
    assert!(error.to_string().contains("nexus-csv"), "{error}");
    for (head, word) in [
        (&b"PK\x03\x04..."[..], "(.ods, .xlsb)"),
        (b"\xd0\xcf\x11\xe0...", "old spreadsheet workbook"),
        (b"# Created by Octave 8.4.0", "save -v7"),
        (b"\x89HDF\r\n\x1a\n", "HDF5"),
        (b"\x93NUMPY\x01\0v\0{'descr'", "numpy.savetxt"),
        (b"PAR1\x15\x04\x15", "Parquet"),
    ] {
        let error = read(head).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::UnknownFormat);
        assert!(error.to_string().contains(word), "{error}");
    }
    let error = read_file(Path::new("no/such/file.csv")).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::NotFound);
    let error = read_file(&data("robot")).unwrap_err();
    assert!(error.to_string().contains("folder"), "{error}");
}

fn columns(capture: &Capture) -> Vec<Vec<&str>> {
    capture
        .sections
        .iter()
        .map(|s| s.columns.iter().map(|c| c.axis.as_str()).collect())
        .collect()
}

#[test]
fn matlab_arrays_fields_and_what_is_none() {
    let compressed = read_file(&data("small.mat")).unwrap();
    assert_eq!(compressed.format, "mat");
    let plain = read_file(&data("plain.mat")).unwrap();
    // bit for bit, a gap being a gap
    assert_eq!(
        format!("{:?}", plain.sections),
        format!("{:?}", compressed.sections)
    );
    assert_eq!(
        columns(&plain),
        [
            vec![
                "t",
                "EE_mm(:,1)",
                "EE_mm(:,2)",
                "EE_mm(:,3)",
                "phi_kV(:,1)",
                "phi_kV(:,2)",
                "phi_kV(:,3)",
                "across"
            ],
            vec!["run.time_ms", "run.load.F_N", "run.on"],
            vec!["beyond"],
        ]
    );
    let [first, run, beyond] = plain.sections.as_slice() else {
        panic!("{:?}", columns(&plain));
    };
    assert_eq!(
        values(first, "", "EE_mm(:,3)"),
        [-60.0, -59.98, -1.0, -59.94, -59.92, -59.9]
    );
    assert_eq!(
        values(first, "", "phi_kV(:,2)"),
        [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    );
    assert_eq!(values(first, "", "across"), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(first.column("", "phi_kV(:,2)").unwrap().unit, "kV");
    assert_eq!(values(run, "", "run.load.F_N"), [1.0, -2.0, 300.0, 4.0]);
    assert_eq!(run.column("", "run.load.F_N").unwrap().unit, "N");
    assert_eq!(values(run, "", "run.on"), [1.0, 0.0, 1.0, 1.0]);
    assert_eq!(values(beyond, "", "beyond"), [1.0, -1.0, -1.0]);
    let said = warnings(&plain).join("\n");
    for word in [
        "beyond: infinite values: 1",
        "cells (a cell array)",
        "cube (of three",
        "wave (complex)",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
    assert!(
        plain
            .notes
            .iter()
            .any(|n| n.text == "single numbers: fs = 100")
    );

    // level 7.3, in which variables stand in order of their names
    let hdf5 = read_file(&data("small73.mat")).unwrap();
    let sorted = |c: &Capture| {
        let text = |c: &deacal::recording::Column| format!("{} {} {:?}", c.axis, c.unit, c.values);
        let mut all: Vec<String> = c
            .sections
            .iter()
            .flat_map(|s| &s.columns)
            .map(text)
            .collect();
        all.sort();
        all
    };
    assert_eq!(sorted(&hdf5), sorted(&plain));
    let said = warnings(&hdf5).join("\n");
    for word in [
        "moments is an object (datetime)",
        "cells (a cell array)",
        "cube (of three",
        "wave (complex)",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
    assert!(
        hdf5.notes
            .iter()
            .any(|n| n.text == "single numbers: fs = 100")
    );

    // what MATLAB wrote itself
    let own = read_file(&data("matlab-7.4.mat")).unwrap();
    assert_eq!(
        columns(&own),
        [vec!["a(1,:)", "a(2,:)", "a(3,:)"], vec!["theta"]]
    );
    let theta = own.sections[1].column("", "theta").unwrap();
    for (i, v) in theta.values.iter().enumerate() {
        assert_eq!(*v, std::f64::consts::FRAC_PI_4 * i as f64);
    }
    // exp(1) of its day is one step off
    let big_endian = read_file(&data("matlab-6.1-big-endian.mat")).unwrap();
    let field = big_endian.sections[0]
        .column("", "teststruct.doublefield")
        .unwrap();
    assert_eq!(
        field.values,
        [
            2.0_f64.sqrt(),
            2.718_281_828_459_045_5,
            std::f64::consts::PI
        ]
    );
}

#[test]
fn matlab_clocks_and_markers() {
    let survey = survey_file(&data("small.mat"), None, &ReadOptions::default()).unwrap();
    let [first, run, _] = survey.sections.as_slice() else {
        panic!("{survey:?}");
    };
    assert_eq!(
        (first.time_column, first.time_s),
        (Some(0), Some([0.0, 0.05]))
    );
    // a field in ms
    assert_eq!((run.time_column, run.time_s), (Some(0), Some([0.0, 0.03])));
    // a matrix of three in mm is a position, one in kV is none
    let markers: Vec<&str> = first.markers.iter().map(|m| m.label.as_str()).collect();
    assert_eq!(markers, ["EE_mm"]);
    assert_eq!(
        survey.column_ref(0, 5),
        Some(ColumnRef::Name("phi_kV(:,2)".into()))
    );
}

#[test]
fn damaged_matlab_files() {
    for name in ["small.mat", "plain.mat", "matlab-6.1-big-endian.mat"] {
        let whole = std::fs::read(data(name)).unwrap();
        let mut last = 0;
        // a file that was cut gives what stands before the cut
        for length in 128..=whole.len() {
            if let Ok(c) = read(&whole[..length]) {
                let cells = c.sections.iter().map(|s| s.rows() * s.columns.len()).sum();
                assert!(
                    cells >= last,
                    "{name}, {length}: {cells} values after {last}"
                );
                last = cells;
            }
        }
        // every word as large as can be: no length is believed
        for at in 124..whole.len() - 4 {
            let mut bytes = whole.clone();
            bytes[at..at + 4].fill(0xff);
            let _ = read(&bytes);
        }
    }
    // level 7.3: every word as large as can be, and cut
    let whole = std::fs::read(data("small73.mat")).unwrap();
    for at in (512..whole.len() - 8).step_by(5) {
        let mut bytes = whole.clone();
        bytes[at..at + 8].fill(0xff);
        let _ = read(&bytes);
    }
    for length in (520..whole.len()).step_by(509) {
        let error = read(&whole[..length]).unwrap_err();
        assert!(
            error.to_string().contains("is damaged"),
            "{length}: {error}"
        );
    }
    let cut = read(&std::fs::read(data("plain.mat")).unwrap()[..400]).unwrap();
    assert!(
        warnings(&cut)
            .iter()
            .any(|w| w.contains("cut within EE_mm")),
        "{cut:?}"
    );
    // one bit in the middle of compressed numbers: the sum tells
    let mut bytes = std::fs::read(data("small.mat")).unwrap();
    let after = bytes.len() - 5;
    bytes[after] ^= 1;
    let error = read(&bytes).unwrap_err();
    assert!(error.to_string().contains("at byte"), "{error}");
    assert!(
        error.to_string().contains("compressed bytes are damaged"),
        "{error}"
    );
}

/// An element of a MATLAB file, little-endian.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut out = kind.to_le_bytes().to_vec();
    out.extend((data.len() as u32).to_le_bytes());
    out.extend(data);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

#[test]
fn matlab_objects_are_named_with_how_to_save_them() {
    let mut header = b"MATLAB 5.0 MAT-file".to_vec();
    header.resize(124, b' ');
    header.extend([0, 1, b'I', b'M']);
    for (class, remedy) in [
        ("timetable", "t = seconds(T.Properties.RowTimes"),
        ("table", "writetable(T, 'run.csv')"),
        ("timeseries", "t = T.Time"),
        ("containers.Map", "as arrays of numbers"),
    ] {
        let inside = [
            element(6, &[17, 0, 0, 0, 0, 0, 0, 0]),
            element(1, b"T"),
            element(1, b"MCOS"),
            element(1, class.as_bytes()),
        ]
        .concat();
        let bytes = [header.clone(), element(14, &inside)].concat();
        let error = read(&bytes).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NoData);
        for word in [&format!("T is an object ({class})"), remedy] {
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}

#[test]
fn a_sheet_gives_what_its_csv_file_gives() {
    let sheet = read_file(&data("sheet.xlsx")).unwrap();
    let text = read_file(&data("sheet.csv")).unwrap();
    assert_eq!(sheet.format, "xlsx");
    let of = |c: &Capture| {
        let s = &c.sections[0];
        let numbers = |c: &deacal::recording::Column| {
            let bits: Vec<u64> = c.values.iter().map(|v| v.to_bits()).collect();
            (c.axis.clone(), c.unit.clone(), c.number, bits)
        };
        let lines: Vec<u64> = (0..s.rows()).map(|i| s.lines.line(i)).collect();
        (
            s.line,
            lines,
            s.columns.iter().map(numbers).collect::<Vec<_>>(),
        )
    };
    assert_eq!(of(&sheet), of(&text));
    let s = &sheet.sections[0];
    assert_eq!(
        values(s, "", "Elongation"),
        [0.0, 0.123_456_789_012_3, 1e-7, -1.0, 123_456.789]
    );
    assert_eq!(
        values(s, "", "Force (N)"),
        [0.125, -1.0, -1.0, -1.5e20, -1.0]
    );
    let said = warnings(&sheet).join("\n");
    for word in [
        "left out: remark, when",
        "error of a formula, as #N/A: 2",
        "dates or times of day: 1",
        "*86400",
    ] {
        assert!(said.contains(word), "{word}: {said}");
    }
}

#[test]
fn several_sheets() {
    let path = data("sheets.xlsx");
    let book = read_file(&path).unwrap();
    let names: Vec<&str> = book.sections.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["Motion", "Drive"]);
    assert!(warnings(&book).is_empty(), "{:?}", book.notes);
    assert!(
        book.notes
            .iter()
            .any(|n| n.text == "sheet Notes has no row of numbers")
    );
    assert_eq!(
        values(&book.sections[1], "Drive", "u2_kV"),
        [0.0, 2.0, 4.0, 6.0, 8.0]
    );
    let find = |name: &str| book.find_column(&path, &ColumnRef::Name(name.into()));
    assert_eq!(
        (find("u2_kV").unwrap(), find("Drive:time_s").unwrap()),
        ((1, 2), (1, 0))
    );
    assert_eq!(find("time_s").unwrap_err().kind(), ErrorKind::Ambiguous);
    let survey = survey_file(&path, None, &ReadOptions::default()).unwrap();
    assert_eq!(
        survey.column_ref(1, 0),
        Some(ColumnRef::Name("Drive:time_s".into()))
    );
    assert_eq!(survey.sections[0].markers[0].label, "EE");
    assert_eq!(survey.sections[1].time_s, Some([0.0, 0.08]));

    // only the sheet with what is asked for
    let asked = |names: &[&str]| {
        let options = ReadOptions {
            columns: Some(names.iter().map(|n| ColumnRef::Name((*n).into())).collect()),
            ..ReadOptions::default()
        };
        read_file_as(&path, None, &options)
    };
    let drive = asked(&["u1_kV", "Drive:time_s"]).unwrap();
    assert_eq!(columns(&drive), [["time_s", "u1_kV"]]);
    let error = asked(&["u4_kV"]).unwrap_err();
    assert!(error.to_string().contains("u3_kV"), "{error}");
}

#[test]
fn damaged_workbooks() {
    let whole = std::fs::read(data("sheet.xlsx")).unwrap();
    for length in (10..whole.len()).step_by(97) {
        assert!(read(&whole[..length]).is_err(), "{length}");
    }
    // a cell far away, and one beyond all sheets
    let with = |cell: &str, rows: usize| {
        use std::fmt::Write as _;
        let mut archive = zip::ZipArchive::new(std::io::Cursor::new(&whole)).unwrap();
        let mut out = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for i in 0..archive.len() {
            let mut entry = archive.by_index(i).unwrap();
            let name = entry.name().unwrap().into_owned();
            let mut text = String::new();
            std::io::Read::read_to_string(&mut entry, &mut text).unwrap();
            if name == "xl/worksheets/sheet1.xml" {
                let (before, _) = text.split_once("<sheetData>").unwrap();
                let mut sheet = format!("{before}<sheetData><row r=\"1\"><c r=\"A1\"><v>1</v></c>");
                write!(sheet, "<c r=\"{cell}\"><v>1</v></c></row>").unwrap();
                for row in 2..rows {
                    write!(sheet, "<row r=\"{row}\"><c r=\"A{row}\"><v>1</v></c></row>").unwrap();
                }
                text = sheet + "</sheetData></worksheet>";
            }
            out.start_file(name, zip::write::SimpleFileOptions::default())
                .unwrap();
            out.write_all(text.as_bytes()).unwrap();
        }
        read(out.finish().unwrap().into_inner()).unwrap_err()
    };
    let error = with("XFD1", 20_000);
    assert!(
        error
            .to_string()
            .contains("almost all of its cells are empty"),
        "{error}"
    );
    let error = with("A1048577", 3);
    assert!(error.to_string().contains("beyond the last row"), "{error}");
}

#[test]
fn cells_without_a_number_are_gaps() {
    let text = "t_s,F_N\n0,1\n1,NaN\n2,nan\n3,\n4,#N/A\n5,NA\n6,#DIV/0!\n7,2\n";
    let table = read(text).unwrap();
    let missing = [1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 2.0];
    assert_eq!(values(&table.sections[0], "", "F_N"), missing);
    // as the first number, and with a comma for the dot
    let table = read("t_s;F_N\n0;NaN\n0,5;1,5\n1;#N/A\n").unwrap();
    assert_eq!(values(&table.sections[0], "", "F_N"), [-1.0, 1.5, -1.0]);
    assert_eq!(
        read("t_s,F_N\n0,1\n1,inf\n").unwrap_err().kind(),
        ErrorKind::NotFinite
    );
}

#[test]
fn a_slow_clock_of_a_bare_file_is_doubted() {
    let doubts = |step: u32| {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        writeln!(file, "time (ms),u_V").unwrap();
        for i in 0..40 {
            writeln!(file, "{},{}", i * step, i % 7).unwrap();
        }
        let survey = survey_file(file.path(), None, &ReadOptions::default()).unwrap();
        survey
            .doubts
            .into_iter()
            .map(|d| d.says)
            .collect::<Vec<_>>()
    };
    let wanted = "column time (ms) in ms runs for 2340 s with a sample every 60 s: is the unit of the time right?";
    assert_eq!(doubts(60_000), [wanted]);
    assert!(doubts(30_000).is_empty());
}
