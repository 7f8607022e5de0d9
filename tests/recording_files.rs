//! Importers on small hand-made files, one for each quirk of the formats.

use std::io::Write;
use std::path::{Path, PathBuf};

use deacal::recording::{
    Capture, ColumnRef, Error, ErrorKind, Level, ReadOptions, Section, importers, read_file,
    read_file_as,
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
            "c3d" | "mcap" | "tdms" => (ErrorKind::Grammar, None),
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
        (&b"PK\x03\x04..."[..], "workbook (.xlsx, .ods)"),
        (b"\xd0\xcf\x11\xe0...", "old spreadsheet workbook"),
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "writetable"),
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64", "writetable"),
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
