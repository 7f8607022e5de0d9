//! Manifests, rigs and whole recordings; everything that can be wrong with them.

use std::fs;
use std::path::{Path, PathBuf};

use deacal::recording::{
    AxisInertia, Clock, Error, ErrorKind, FilmState, Kind, Manifest, NumberOrEstimate, OpenOptions,
    RawElongation, RawLoad, Recording, Rig, Role,
};

fn robot() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recording/robot")
}

/// A copy of the robot recording with one file edited.
fn edited(file: &str, from: &str, to: &str) -> (tempfile::TempDir, Result<Recording, Error>) {
    let dir = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(robot()).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, dir.path().join(path.file_name().unwrap())).unwrap();
    }
    let path = dir.path().join(file);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{file} has no {from:?}");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
    let recording = Recording::open(dir.path());
    (dir, recording)
}

fn fails(file: &str, from: &str, to: &str) -> Error {
    edited(file, from, to).1.unwrap_err()
}

#[test]
fn a_whole_recording() {
    let r = Recording::open(&robot()).unwrap();
    let m = &r.manifest;
    assert_eq!((m.id.as_str(), m.kind), ("tests/robot", Kind::Robot));
    assert_eq!(m.film_state, Some(FilmState::Virgin));
    assert_eq!(m.offset_s, NumberOrEstimate::Estimate);
    assert_eq!((m.payload.mass_g(0.01), m.payload.mass_g(0.02)), (0.0, 2.0));
    // date -u -d 2026-03-02T10:15:00 +%s
    assert_eq!(m.start.as_ref().unwrap().clock_s, 1_772_446_500.0);
    assert_eq!(
        (m.temperature_c, m.humidity_percent, m.day),
        (Some(21.5), Some(40.0), Some(3.0))
    );
    let Some(Rig::Robot(rig)) = &r.rig else {
        panic!()
    };
    assert_eq!(
        (rig.delta.n0_mm, rig.actuator.films, rig.film.eps_r),
        (50.0, 2, Some(2.8))
    );

    let motion = r.motion.as_ref().unwrap();
    assert_eq!(
        (motion.rate_hz, motion.first_frame, motion.unit.symbol),
        (100.0, Some(5), "mm")
    );
    // frames 5 to 10; 8 and 9 are not in the file, 7 was not seen
    assert_eq!(motion.time_s, [0.04, 0.05, 0.06, 0.07, 0.08, 0.09]);
    assert_eq!(motion.end_effector.label, "DEA:EE");
    assert_eq!(motion.end_effector.xyz[1], [1.25, 2.0, -2.61e-5]);
    let seen: Vec<bool> = motion
        .end_effector
        .xyz
        .iter()
        .map(|p| p[0].is_finite())
        .collect();
    assert_eq!(seen, [true, true, false, false, false, true]);
    assert_eq!(motion.base.as_ref().unwrap().xyz[5], [10.5, 20.0, 30.0]);

    let voltage = r.voltage.as_ref().unwrap();
    assert_eq!(voltage.time_s, [0.0, 0.001, 0.002, 0.003]);
    assert_eq!(voltage.channels[1], [0.0, 0.25, 0.5, 0.75]);
    assert!(voltage.channels[2][2].is_nan());
    assert_eq!(
        (voltage.unit.symbol, voltage.hold_previous, voltage.scale),
        ("kV", true, None)
    );
    assert_eq!(voltage.labels, ["phi1_kV", "phi2_kV", "phi3_kV"]);

    let monitor = r.monitor.as_ref().unwrap();
    assert_eq!((monitor.unit.symbol, monitor.scale), ("V", Some(1000.0)));
    assert_eq!(monitor.channels[0], [0.0, 1.0]);
    assert_eq!(
        (
            monitor.current[2].unit.unwrap().symbol,
            monitor.current[2].values[0]
        ),
        ("mA", 0.3)
    );

    let roles: Vec<Role> = r.sources.iter().map(|s| s.role).collect();
    assert_eq!(
        roles,
        [
            Role::Manifest,
            Role::Rig,
            Role::Motion,
            Role::Voltage,
            Role::Monitor
        ]
    );
    // sha256sum tests/data/recording/robot/voltage.csv
    assert_eq!(
        r.sources[3].sha256,
        "11ee280c3463d0123cf1db502fc43fa4a2a68695aa3abb3d368769a82260b2cc"
    );
    assert_eq!(
        (r.sources[2].format.as_str(), r.sources[3].format.as_str()),
        ("nexus-csv", "csv")
    );
    let notes: Vec<&str> = r.notes.iter().map(|n| n.text.as_str()).collect();
    assert!(
        notes
            .iter()
            .any(|n| n.contains("marker \"DEA:EE\": 3 of 6 samples, 1 gaps")),
        "{notes:#?}"
    );
    // the same by its file's name
    assert_eq!(
        Recording::open(&robot().join("recording.toml"))
            .unwrap()
            .sources,
        r.sources
    );
}

#[test]
fn every_wrong_key_has_its_line_and_the_nearest() {
    let cases = [
        (
            "end_effector =",
            "end_efector =",
            ErrorKind::UnknownKey,
            18,
            "did you mean \"end_effector\"?",
        ),
        (
            "[voltage]",
            "[volatge]",
            ErrorKind::UnknownKey,
            24,
            "did you mean \"voltage\"?",
        ),
        (
            "kind = \"robot\"",
            "kind = \"robbot\"",
            ErrorKind::BadValue,
            3,
            "did you mean \"robot\"?",
        ),
        (
            "kind = \"robot\"",
            "kind = 3",
            ErrorKind::WrongType,
            3,
            "found the number 3, expected a string",
        ),
        (
            "id = \"tests/robot\"\n",
            "",
            ErrorKind::MissingKey,
            1,
            "[recording] id",
        ),
        (
            "id = \"tests/robot\"",
            "id = \"../robot\"",
            ErrorKind::BadValue,
            2,
            "\"../robot\"",
        ),
        (
            "unit = \"kV\"",
            "unit = \"MV\"",
            ErrorKind::BadValue,
            28,
            "one of V, kV",
        ),
        (
            "\"phi2_kV\", ",
            "",
            ErrorKind::BadValue,
            27,
            "found 2 channels, expected 3",
        ),
        (
            "\"phi2_kV\", ",
            "\"phi1_kV\", ",
            ErrorKind::BadValue,
            27,
            "two chains",
        ),
        (
            "[0.0, 90.0, 0.0]",
            "[0.0, 90.0]",
            ErrorKind::WrongType,
            22,
            "three numbers",
        ),
        (
            "[0.0, 90.0, 0.0]",
            "[0.0, 90.0, nan]",
            ErrorKind::WrongType,
            22,
            "three numbers",
        ),
        (
            "[0.02, 2.0]]",
            "[0.0, 2.0]]",
            ErrorKind::WrongType,
            5,
            "times rise",
        ),
        (
            "start = 2026-03-02T10:15:00",
            "start = \"March\"",
            ErrorKind::WrongType,
            11,
            "date and time",
        ),
        (
            "offset_s = \"estimate\"",
            "offset_s = \"find\"",
            ErrorKind::WrongType,
            41,
            "a number or \"estimate\"",
        ),
        (
            "hold = \"previous\"",
            "hold = \"last\"",
            ErrorKind::BadValue,
            29,
            "one of previous, linear",
        ),
        (
            "format = \"nexus-csv\"",
            "format = \"nexus\"",
            ErrorKind::BadValue,
            17,
            "did you mean \"nexus-csv\"?",
        ),
        (
            "time = \"time_ms\"",
            "time = 1\nrate_hz = 1000",
            ErrorKind::BadValue,
            27,
            "both `time` and `rate_hz`",
        ),
        (
            "rig = \"rig.toml\"\n",
            "",
            ErrorKind::MissingKey,
            0,
            "[recording] rig",
        ),
        ("[motion]", "[motion", ErrorKind::Toml, 15, ""),
        (
            "[sync]",
            "[coupon]\nfile = \"x\"\n[sync]",
            ErrorKind::BadValue,
            40,
            "has no such table",
        ),
    ];
    for (from, to, kind, line, text) in cases {
        let e = fails("recording.toml", from, to);
        assert_eq!(
            (e.kind(), e.line().unwrap_or(0)),
            (kind, line),
            "{to:?}: {e}"
        );
        assert!(e.to_string().contains(text), "{e}");
        assert!(!e.to_string().contains('\n'), "{e}");
    }
}

#[test]
fn a_rig_has_positive_lengths_and_known_keys() {
    let cases = [
        (
            "q_mm = 50.0",
            "q_mm = -50.0",
            ErrorKind::BadValue,
            9,
            "above 0",
        ),
        (
            "q_mm = 50.0",
            "q_m = 0.05",
            ErrorKind::UnknownKey,
            9,
            "did you mean \"q_mm\"?",
        ),
        ("films = 2", "films = 0", ErrorKind::BadValue, 23, "above 0"),
        (
            "films = 2",
            "films = 1.5",
            ErrorKind::WrongType,
            23,
            "a whole number",
        ),
        ("m_g = 6.0\n", "", ErrorKind::MissingKey, 31, "[mass] m_g"),
        (
            "[sam]\n",
            "[sam2]\n",
            ErrorKind::UnknownKey,
            14,
            "did you mean \"sam\"?",
        ),
        (
            "kind = \"robot\"",
            "kind = \"film-sample\"",
            ErrorKind::UnknownKey,
            6,
            "[delta]",
        ),
    ];
    for (from, to, kind, line, text) in cases {
        let e = fails("rig.toml", from, to);
        assert_eq!((e.kind(), e.line()), (kind, Some(line)), "{to:?}: {e}");
        assert!(e.to_string().contains(text), "{e}");
        assert!(e.path().ends_with("rig.toml"));
    }
    // what may be left out
    let (_dir, r) = edited("rig.toml", "eps_r = 2.8\n", "");
    let Some(Rig::Robot(rig)) = r.unwrap().rig else {
        panic!()
    };
    assert_eq!(rig.film.eps_r, None);
}

const SAMPLE_RIG: &str = "[rig]\nid = \"s\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\nmargin_mm = 3.0\nfilms = 1\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n";

#[test]
fn a_film_sample_rig() {
    let Rig::FilmSample(rig) = Rig::parse(Path::new("rig.toml"), SAMPLE_RIG).unwrap() else {
        panic!()
    };
    assert_eq!(
        (rig.width_mm, rig.L3_mm, rig.m_g, rig.margin_mm),
        (45.0, 0.1, 50.0, 3.0)
    );
    let e = Rig::parse(Path::new("rig.toml"), &SAMPLE_RIG.replace("= 3.0", "= 23")).unwrap_err();
    assert!(e.to_string().contains("no electrode"), "{e}");
    let (_dir, r) = edited("rig.toml", "", "");
    let mut r = r.unwrap();
    // a sample's rig is no robot's
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sample.toml");
    fs::write(&path, SAMPLE_RIG).unwrap();
    let options = OpenOptions { rig: Some(path) };
    let e = Recording::open_with(&robot(), &options).unwrap_err();
    assert!(e.to_string().contains("another kind"), "{e}");
    r.notes.clear();
}

#[test]
fn a_rig_given_apart_wins() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("other.toml");
    let text = fs::read_to_string(robot().join("rig.toml")).unwrap();
    fs::write(&path, text.replace("m_g = 6.0", "m_g = 7.5")).unwrap();
    let options = OpenOptions {
        rig: Some(path.clone()),
    };
    let r = Recording::open_with(&robot(), &options).unwrap();
    let Some(Rig::Robot(rig)) = r.rig else {
        panic!()
    };
    assert_eq!((rig.mass.m_g, r.rig_path), (7.5, Some(path)));
}

#[test]
fn markers_that_are_not_there() {
    let e = fails("recording.toml", "\"EE\"", "\"EF\"");
    assert_eq!(e.kind(), ErrorKind::UnknownMarker);
    assert!(e.to_string().contains("DEA:EE, DEA:Base, DEA:Lost"), "{e}");
    let e = fails("recording.toml", "\"DEA:Base\"", "\"DEA:Basis\"");
    assert!(e.to_string().contains("did you mean \"DEA:Base\"?"), "{e}");
    let e = fails("recording.toml", "\"EE\"", "\"Lost\"");
    assert_eq!(e.kind(), ErrorKind::MissingThroughout, "{e}");
    // two subjects with the same marker
    let e = fails("motion.csv", "DEA:Lost", "XYZ:EE");
    assert_eq!(e.kind(), ErrorKind::Ambiguous);
    assert!(e.to_string().contains("DEA:EE, XYZ:EE"), "{e}");
}

#[test]
fn columns_units_and_times_that_are_wrong() {
    let cases = [
        (
            "recording.toml",
            "\"phi2_kV\"",
            "\"phi4_kV\"",
            ErrorKind::UnknownColumn,
            0,
            "did you mean \"phi",
        ),
        (
            "recording.toml",
            "unit = \"kV\"",
            "unit = \"V\"",
            ErrorKind::WrongUnit,
            0,
            "is in kV by its header, expected V",
        ),
        (
            "voltage.csv",
            "phi2_kV\n",
            "phi2_kV\n",
            ErrorKind::WrongUnit,
            0,
            "",
        ),
        (
            "voltage.csv",
            "phi1_kV",
            "phi1_A",
            ErrorKind::UnknownColumn,
            0,
            "phi1_A",
        ),
        (
            "voltage.csv",
            "2,1,0.5,",
            "0.5,1,0.5,",
            ErrorKind::TimeOrder,
            4,
            "time 0.0005 s follows 0.001 s",
        ),
        (
            "voltage.csv",
            "2,1,0.5,",
            "1,1,0.5,",
            ErrorKind::TimeOrder,
            4,
            "rises",
        ),
        (
            "voltage.csv",
            "2,1,0.5,",
            ",1,0.5,",
            ErrorKind::BadNumber,
            4,
            "time is missing",
        ),
        (
            "voltage.csv",
            "2,1,0.5,",
            "NaN,1,0.5,",
            ErrorKind::BadNumber,
            4,
            "time is missing",
        ),
        (
            "voltage.csv",
            "2,1,0.5,",
            "2,1,-inf,",
            ErrorKind::NotFinite,
            4,
            "column 3: found \"-inf\"",
        ),
        (
            "voltage.csv",
            "2,1,0.5,",
            "2,1,0.5",
            ErrorKind::CellCount,
            4,
            "found 3 cells, expected 4 or more",
        ),
        (
            "motion.csv",
            ",20,30,,,,4\r\n6",
            ",inf,30,,,,4\r\n6",
            ErrorKind::NotFinite,
            6,
            "column 7",
        ),
        (
            "motion.csv",
            ",,mm,mm,mm",
            ",,mm,m,mm",
            ErrorKind::WrongUnit,
            0,
            "different units",
        ),
        (
            "motion.csv",
            "10,0,1,2,3",
            "900000,0,1,2,3",
            ErrorKind::TimeOrder,
            9,
            "frame 900000 follows frame 7",
        ),
    ];
    for (file, from, to, kind, line, text) in cases {
        if from == to || text.is_empty() {
            continue;
        }
        let e = fails(file, from, to);
        assert_eq!(
            (e.kind(), e.line().unwrap_or(0)),
            (kind, line),
            "{to:?}: {e}"
        );
        assert!(e.to_string().contains(text), "{e}");
    }
    // a motion without a unit is asked for one, and takes it from the manifest
    let e = fails("motion.csv", ",,mm,mm,mm,mm,mm,mm", ",,,,,,,");
    assert!(e.to_string().contains("add `unit = \"mm\"`"), "{e}");
    // a whole channel without a value
    let (dir, _) = edited("voltage.csv", "", "");
    fs::write(
        dir.path().join("voltage.csv"),
        "time_ms,phi1_kV,phi2_kV,phi3_kV\n0,0,,1\n1,0,,1\n",
    )
    .unwrap();
    let e = Recording::open(dir.path()).unwrap_err();
    assert_eq!(e.kind(), ErrorKind::MissingThroughout, "{e}");
    assert!(e.to_string().contains("phi2_kV"), "{e}");
}

#[test]
fn time_without_a_unit_is_asked_for() {
    let (dir, _) = edited("recording.toml", "\"time_ms\"", "\"clock\"");
    let voltage = dir.path().join("voltage.csv");
    let text = fs::read_to_string(&voltage)
        .unwrap()
        .replace("time_ms", "clock");
    fs::write(&voltage, text).unwrap();
    let e = Recording::open(dir.path()).unwrap_err();
    assert!(e.to_string().contains("time_unit = \"s\""), "{e}");
    let path = dir.path().join("recording.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(
        &path,
        text.replace("\"clock\"", "\"clock\"\ntime_unit = \"us\""),
    )
    .unwrap();
    assert_eq!(
        Recording::open(dir.path()).unwrap().voltage.unwrap().time_s[1],
        1e-6
    );
    fs::write(&path, text.replace("time = \"clock\"", "rate_hz = 500")).unwrap();
    assert_eq!(
        Recording::open(dir.path()).unwrap().voltage.unwrap().time_s[1],
        0.002
    );
}

#[test]
fn files_that_are_missing_empty_or_closed() {
    let e = fails("recording.toml", "voltage.csv", "volts.csv");
    assert_eq!(e.kind(), ErrorKind::NotFound);
    assert!(e.path().ends_with("volts.csv"));
    let (dir, _) = edited("voltage.csv", "", "");
    fs::write(dir.path().join("voltage.csv"), "").unwrap();
    assert_eq!(
        Recording::open(dir.path()).unwrap_err().kind(),
        ErrorKind::Empty
    );
    fs::write(
        dir.path().join("voltage.csv"),
        "time_ms,phi1_kV,phi2_kV,phi3_kV\n",
    )
    .unwrap();
    assert_eq!(
        Recording::open(dir.path()).unwrap_err().kind(),
        ErrorKind::NoData
    );
    fs::remove_file(dir.path().join("recording.toml")).unwrap();
    let e = Recording::open(dir.path()).unwrap_err();
    assert!(e.to_string().contains("no recording.toml"), "{e}");
    // data instead of a manifest
    let e = Recording::open(&robot().join("voltage.csv")).unwrap_err();
    assert_eq!(e.kind(), ErrorKind::Toml, "{e}");
    let e = Recording::open(Path::new("no/such")).unwrap_err();
    assert_eq!(e.kind(), ErrorKind::NotFound);
}

/// Motion and monitor in one file: what is to be said of it is said once.
#[test]
fn a_file_that_is_read_twice_warns_once() {
    let dir = tempfile::tempdir().unwrap();
    fs::copy(robot().join("rig.toml"), dir.path().join("rig.toml")).unwrap();
    let text = |i: usize| format!("{},1,2,{},500,0,0,word\n", i as f64 / 10.0, i % 3);
    let rows: String = (0..40).map(text).collect();
    let header = "t_s,EE_x_mm,EE_y_mm,EE_z_mm,a (V),b (V),c (V),remark\n";
    fs::write(
        dir.path().join("all.csv"),
        format!("settings\n{header}{rows}0.1"),
    )
    .unwrap();
    let table = "file = \"all.csv\"\ntime = \"t_s\"\n";
    let channels = "channels = [\"a (V)\", \"b (V)\", \"c (V)\"]\n";
    let manifest = format!(
        "[recording]\nid = \"a\"\nkind = \"robot\"\nrig = \"rig.toml\"\n[motion]\n{table}end_effector = \"EE\"\n\
         [voltage]\n{table}{channels}[monitor]\n{table}{channels}"
    );
    fs::write(dir.path().join("recording.toml"), manifest).unwrap();
    let r = Recording::open(dir.path()).unwrap();
    let dropped: Vec<&str> = r
        .notes
        .iter()
        .map(|n| n.text.as_str())
        .filter(|t| t.contains("middle of a row"))
        .collect();
    assert_eq!(dropped.len(), 1, "{dropped:?}");
}

/// Seconds that were taken for microseconds, and a rate that overrules times that the file has.
#[test]
fn doubtful_clocks_are_said() {
    let said = |r: &Recording, words: &str| r.notes.iter().any(|n| n.text.contains(words));
    let slow = |unit: &str| {
        let dir = tempfile::tempdir().unwrap();
        for file in ["recording.toml", "rig.toml", "motion.csv", "monitor.csv"] {
            fs::copy(robot().join(file), dir.path().join(file)).unwrap();
        }
        let path = dir.path().join("recording.toml");
        let text = fs::read_to_string(&path).unwrap();
        let text = text.replace(
            "time = \"time_ms\"",
            &format!("time = 1\ntime_unit = \"{unit}\""),
        );
        fs::write(
            &path,
            text.replace(
                "channels = [\"phi1_kV\", \"phi2_kV\", \"phi3_kV\"]",
                "channels = [2, 3, 4]",
            ),
        )
        .unwrap();
        // LabVIEW: milliseconds with three digits and a dot between thousands
        let rows: String = (9..60)
            .map(|i| match i {
                9 => "903.000;1.5;0.5;0\n".to_owned(),
                i => format!("{}.{:03}.000;1.5;0.5;0\n", i / 10, i % 10 * 100 + 3),
            })
            .collect();
        fs::write(dir.path().join("voltage.csv"), rows).unwrap();
        Recording::open(dir.path()).unwrap()
    };
    let r = slow("ms");
    assert!(
        said(&r, "a sample every 100 s: is the unit of the time right?"),
        "{:?}",
        r.notes
    );
    assert!(said(&r, "a thousand times too large"), "{:?}", r.notes);
    let r = slow("us");
    assert!(!said(&r, "is the unit of the time right"), "{:?}", r.notes);
    let (_dir, r) = edited("voltage.csv", "", "");
    assert!(!said(&r.unwrap(), "thousand times"));

    let scope = |rate: &str| {
        let csv = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\n\nChannels\t2\nSamples\t3\t3\n\
             Y_Unit_Label\tm\tV\nX0\t0\t0\nDelta_X\t0.01\t0.01\n***End_of_Header***\n\
             X_Value\tCH1\tCH2\tComment\n\t1\t2\n\t3\t4\n\t3\t4\n";
        let manifest = format!(
            "[recording]\nid = \"a\"\nkind = \"axis\"\n[axis]\nfile = \"run.csv\"\nposition = \"CH1\"\ninput = \"CH2\"\n{rate}\
             units = {{ position = \"m\", input = \"V\" }}\ninput_gain = 1.0\nmass_kg = 1.0\n"
        );
        table(&manifest, csv)
    };
    let r = scope("rate_hz = 1000.0\n").unwrap();
    let words = "which make 100 Hz; the manifest's rate_hz = 1000 is used";
    assert!(said(&r, words), "{:?}", r.notes);
    for rate in ["", "rate_hz = 100.0\n"] {
        assert!(!said(&scope(rate).unwrap(), "which make"));
    }
}

#[cfg(unix)]
#[test]
fn a_file_that_may_not_be_read() {
    use std::os::unix::fs::PermissionsExt;
    let (dir, _) = edited("voltage.csv", "", "");
    let path = dir.path().join("voltage.csv");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o000)).unwrap();
    if fs::File::open(&path).is_ok() {
        eprintln!("skipped: this user may read every file");
        return;
    }
    assert_eq!(
        Recording::open(dir.path()).unwrap_err().kind(),
        ErrorKind::NoPermission
    );
}

/// A recording of one table.
fn table(manifest: &str, csv: &str) -> Result<Recording, Error> {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("recording.toml"), manifest).unwrap();
    fs::write(dir.path().join("run.csv"), csv).unwrap();
    Recording::open(dir.path())
}

const COUPON: &str = "[recording]\nid = \"c\"\nkind = \"film-coupon\"\n[coupon]\nfile = \"run.csv\"\nmode = \"uniaxial\"\ntime = \"t_s\"\ndisplacement = 2\nforce = 3\nunits = { displacement = \"mm\", force = \"N\" }\ngauge_mm = 80.0\nwidth_mm = 22.0\nthickness_mm = 1.0\n";

#[test]
fn a_film_coupon() {
    let csv = "t_s,a,b\n0,0,0\n1,0.5,0.25\n0.5,1,0.5\n";
    let r = table(COUPON, csv).unwrap();
    let coupon = r.coupon.unwrap();
    assert_eq!(coupon.time_s.unwrap(), [0.0, 1.0, 0.5]);
    assert_eq!(coupon.time_steps_back, [2]);
    assert!(
        r.notes
            .iter()
            .any(|n| n.line == Some(4) && n.text.contains("does not rise"))
    );
    let RawElongation::Displacement {
        displacement,
        gauge_mm,
    } = coupon.elongation
    else {
        panic!()
    };
    assert_eq!(
        (
            displacement.values,
            displacement.unit.unwrap().symbol,
            gauge_mm
        ),
        (vec![0.0, 0.5, 1.0], "mm", 80.0)
    );
    let RawLoad::Force {
        force,
        width_mm,
        thickness_mm,
    } = coupon.load
    else {
        panic!()
    };
    assert_eq!(
        (force.label.as_str(), width_mm, thickness_mm),
        ("b", 22.0, 1.0)
    );

    let e = table(&COUPON.replace("gauge_mm = 80.0\n", ""), csv).unwrap_err();
    assert_eq!(
        (e.kind(), e.key()),
        (ErrorKind::MissingKey, "[coupon] gauge_mm"),
        "{e}"
    );
    let e = table(
        &COUPON.replace("force = 3", "force = 3\nnominal_stress = 3"),
        csv,
    )
    .unwrap_err();
    assert!(
        e.to_string().contains("both `force` and `nominal_stress`"),
        "{e}"
    );
    let e = table(&COUPON.replace("force = \"N\" }", "force = \"mm\" }"), csv).unwrap_err();
    assert!(
        e.to_string().contains("[coupon.units] force") && e.to_string().contains("one of N, mN"),
        "{e}"
    );
    let e = table(&COUPON.replace(", force = \"N\"", ""), csv).unwrap_err();
    assert!(
        e.to_string().contains("add `units = { force = \"N\" }`"),
        "{e}"
    );
    let e = table(
        &COUPON.replace("mode = \"uniaxial\"", "mode = \"biaxial\""),
        csv,
    )
    .unwrap_err();
    assert!(e.to_string().contains("did you mean"), "{e}");

    // stretch and stress, headers with units, no time at all
    let text = "[recording]\nid = \"c\"\nkind = \"film-coupon\"\n[coupon]\nfile = \"run.csv\"\nmode = \"pure-shear\"\nstretch = \"stretch\"\nnominal_stress = \"P_kPa\"\n";
    let coupon = table(text, "stretch,P_kPa\n1,0\n2,30\n")
        .unwrap()
        .coupon
        .unwrap();
    assert_eq!(coupon.time_s, None);
    let RawLoad::NominalStress(stress) = coupon.load else {
        panic!()
    };
    assert_eq!(
        (stress.unit.unwrap().symbol, stress.values),
        ("kPa", vec![0.0, 30.0])
    );
}

#[test]
fn a_hinge_bench() {
    let text = "[recording]\nid = \"h\"\nkind = \"hinge-bench\"\n[bench]\nfile = \"run.csv\"\nangle = \"Spring (rad)\"\ntorque = \"Tz (Nm)\"\nunits = { angle = \"rad\", torque = \"N m\" }\n";
    let csv = ",Spring (deg),Spring (rad),Tz (Nm)\n0,-2.1,-0.036,-5e-05\n1,-3.8,-0.066,-1e-03\n";
    let bench = table(text, csv).unwrap().bench.unwrap();
    assert_eq!(
        (bench.time_s, bench.torque.values),
        (None, vec![-5e-5, -1e-3])
    );
    let e = table(&text.replace("(rad)", "(deg)"), csv).unwrap_err();
    assert!(
        e.to_string()
            .contains("is in deg by its header, expected rad"),
        "{e}"
    );
    let timed = text.replace("units = {", "time = 1\nunits = { time = \"s\",");
    assert_eq!(
        table(&timed, csv).unwrap().bench.unwrap().time_s.unwrap(),
        [0.0, 1.0]
    );
}

#[test]
fn a_single_axis() {
    let text = "[recording]\nid = \"a\"\nkind = \"axis\"\n[axis]\nfile = \"run.csv\"\ntime = \"t_s\"\nposition = \"q_m\"\ninput = \"u_V\"\nload = \"f_N\"\nunits = { time = \"s\", position = \"m\", input = \"V\", load = \"N\" }\ninput_gain = 35.15\nmass_kg = \"estimate\"\nstiffness = 0\n";
    let csv = "t_s,q_m,u_V,f_N\n0,0,1,0\n0.1,0.01,1,0\n";
    let r = table(text, csv).unwrap();
    let m = r.manifest.axis.unwrap();
    assert_eq!(m.inertia, AxisInertia::MassKg(NumberOrEstimate::Estimate));
    assert_eq!(m.input_gain, NumberOrEstimate::Number(35.15));
    assert!(matches!(m.clock, Clock::Column { .. }));
    let axis = r.axis.unwrap();
    assert_eq!(
        (axis.time_s, axis.input_unit.as_str()),
        (vec![0.0, 0.1], "V")
    );
    assert_eq!(axis.load.unwrap().unit.unwrap().symbol, "N");
    let e = table(&text.replace("time = \"t_s\"\n", ""), csv).unwrap_err();
    assert!(e.to_string().contains("rate_hz"), "{e}");
    let e = table(text, "t_s,q_m,u_V,f_N\n0,0,1,0\n0,0.01,1,0\n").unwrap_err();
    assert_eq!((e.kind(), e.line()), (ErrorKind::TimeOrder, Some(3)));
    let e = table(&text.replace("mass_kg", "mass"), csv).unwrap_err();
    assert!(e.to_string().contains("did you mean \"mass_kg\"?"), "{e}");
}

#[test]
fn a_film_sample_of_plain_tables() {
    let dir = tempfile::tempdir().unwrap();
    let text = "[recording]\nid = \"s\"\nkind = \"film-sample\"\nrig = \"rig.toml\"\n[motion]\nfile = \"motion.csv\"\ntime = \"t_s\"\nend_effector = \"End\"\nbase = \"Top\"\n[voltage]\nfile = \"voltage.csv\"\ntime = 1\ntime_unit = \"s\"\nchannels = 2\nunit = \"V\"\n";
    fs::write(dir.path().join("recording.toml"), text).unwrap();
    fs::write(dir.path().join("rig.toml"), SAMPLE_RIG).unwrap();
    fs::write(dir.path().join("motion.csv"), "t_s,End_x_mm,End_y_mm,End_z_mm,Top x (mm),Top y (mm),Top z (mm)\n0,1,2,3,0.5,0,0\n0.01,1,2,4,0.5,0,0\n0.0200,,,,0.5,0,0\n").unwrap();
    fs::write(dir.path().join("voltage.csv"), "0\t0\n0.5\t1,5\n").unwrap();
    let r = Recording::open(dir.path()).unwrap();
    let motion = r.motion.unwrap();
    assert_eq!((motion.first_frame, motion.unit.symbol), (None, "mm"));
    assert!((motion.rate_hz - 100.0).abs() < 1e-9);
    assert_eq!(motion.end_effector.xyz[1], [1.0, 2.0, 4.0]);
    assert!(motion.end_effector.xyz[2][0].is_nan());
    let voltage = r.voltage.unwrap();
    assert_eq!(
        (voltage.channels[0].as_slice(), voltage.labels[0].as_str()),
        ([0.0, 1.5].as_slice(), "2")
    );
    // 1.5 V on a film is a unit that was mistaken
    assert!(
        r.notes
            .iter()
            .any(|n| n.text.contains("largest voltage is 1.5 V"))
    );
    assert_eq!(r.manifest.offset_s, NumberOrEstimate::Number(0.0));
}

#[test]
fn voltages_beside_the_markers() {
    let dir = tempfile::tempdir().unwrap();
    let text = "[recording]\nid = \"s\"\nkind = \"film-sample\"\nrig = \"rig.toml\"\n[motion]\nfile = \"trial.csv\"\nend_effector = \"End\"\n[voltage]\nfile = \"trial.csv\"\nchannels = [\"HV monitor:1\"]\nscale = 1000.0\n";
    fs::write(dir.path().join("recording.toml"), text).unwrap();
    fs::write(dir.path().join("rig.toml"), SAMPLE_RIG).unwrap();
    fs::write(dir.path().join("trial.csv"), "Devices\n200\n,,HV monitor,\nFrame,Sub Frame,1,2\n,,V,V\n1,0,0.5,0\n1,1,1,0\n2,0,1.5,0\n2,1,2,0\n\nTrajectories\n100\n,,End,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n2,0,1,2,3\n").unwrap();
    let r = Recording::open(dir.path()).unwrap();
    let voltage = r.voltage.unwrap();
    assert_eq!(voltage.time_s, [0.0, 0.005, 0.01, 0.015]);
    assert_eq!(
        (
            voltage.unit.symbol,
            voltage.scale,
            voltage.labels[0].as_str()
        ),
        ("V", Some(1000.0), "HV monitor/1")
    );
    assert_eq!(voltage.channels[0], [0.5, 1.0, 1.5, 2.0]);
}

#[test]
fn a_manifest_from_text() {
    let m = Manifest::parse(Path::new("recording.toml"), COUPON).unwrap();
    assert_eq!((m.kind.name(), m.kind), ("film-coupon", Kind::FilmCoupon));
}

#[test]
fn motion_and_voltage_from_arrays_and_from_sheets() {
    for (file, effector, time, drive) in [
        (
            "small.mat",
            "EE_mm",
            ["t", "t"],
            ["phi_kV(:,1)", "phi_kV(:,2)", "phi_kV(:,3)"],
        ),
        (
            "small73.mat",
            "EE_mm",
            ["t", "t"],
            ["phi_kV(:,1)", "phi_kV(:,2)", "phi_kV(:,3)"],
        ),
        (
            "sheets.xlsx",
            "EE",
            ["Motion:time_s", "Drive:time_s"],
            ["u1_kV", "u2_kV", "u3_kV"],
        ),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let data = robot().join("..").join(file);
        fs::copy(&data, dir.path().join(file)).unwrap();
        fs::copy(robot().join("rig.toml"), dir.path().join("rig.toml")).unwrap();
        let manifest = format!(
            "[recording]\nid = \"a\"\nkind = \"robot\"\nrig = \"rig.toml\"\npayload_g = 0.0\nfilm_state = \"relaxed\"\n\
             [motion]\nfile = \"{file}\"\nend_effector = \"{effector}\"\nend_effector_offset_mm = [0.0, 0.0, 0.0]\n\
             rotation_deg = [0.0, 0.0, 0.0]\ntime = \"{}\"\n\
             [voltage]\nfile = \"{file}\"\ntime = \"{}\"\nchannels = {drive:?}\n[sync]\noffset_s = 0.0\n",
            time[0], time[1]
        );
        fs::write(dir.path().join("recording.toml"), manifest).unwrap();
        let r = Recording::open(dir.path()).unwrap();
        let (motion, voltage) = (r.motion.unwrap(), r.voltage.unwrap());
        let seen: Vec<f64> = motion.end_effector.xyz.iter().map(|p| p[2]).collect();
        let (z, second, step) = match file {
            "sheets.xlsx" => (
                vec![0.0, 3.0, 6.0, 9.0, 12.0],
                vec![0.0, 2.0, 4.0, 6.0, 8.0],
                0.02,
            ),
            _ => {
                // the gap of the middle stays one
                assert!(seen[2].is_nan());
                (
                    vec![-60.0, -59.98, -59.94, -59.92, -59.9],
                    vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
                    0.01,
                )
            }
        };
        assert_eq!(
            seen.into_iter().filter(|v| !v.is_nan()).collect::<Vec<_>>(),
            z,
            "{file}"
        );
        assert_eq!(voltage.channels[1], second, "{file}");
        assert_eq!(
            (voltage.unit.symbol, voltage.time_s[1], motion.time_s[1]),
            ("kV", step, step)
        );
    }
}
