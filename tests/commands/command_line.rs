//! The program as a user runs it: the main job, and bad input. A failed run says in one line what, where and
//! what to do, exits with 1, and leaves nothing.

use crate::common;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::cargo::CommandCargoExt;

const TWIN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/datasets/twin2026_delta");

/// A copy of one bundled recording and its rig, to spoil.
struct Bench {
    dir: tempfile::TempDir,
}

impl Bench {
    fn new(recording: &str) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let bench = Bench { dir };
        fs::create_dir(bench.path("rec")).unwrap();
        fs::copy(format!("{TWIN}/rig.toml"), bench.path("rig.toml")).unwrap();
        for file in ["recording.toml", "motion.csv", "voltage.csv"] {
            fs::copy(
                format!("{TWIN}/{recording}/{file}"),
                bench.path(&format!("rec/{file}")),
            )
            .unwrap();
        }
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn edit(&self, name: &str, change: impl Fn(String) -> String) -> &Self {
        let path = self.path(name);
        let old = fs::read_to_string(&path).unwrap();
        let new = change(old.clone());
        assert_ne!(old, new, "the edit of {name} must change it");
        fs::write(path, new).unwrap();
        self
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = std::process::Command::cargo_bin("deacal").unwrap();
        command
            .current_dir(self.dir.path())
            .args(arguments)
            .output()
            .unwrap()
    }

    /// Runs, expects failure, and gives the message.
    fn refused(&self, arguments: &[&str]) -> String {
        let out = self.run(arguments);
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(1), "{arguments:?}: {text}");
        assert_eq!(text.trim_end().lines().count(), 1, "one line, not:\n{text}");
        assert!(
            !self.path("out").exists(),
            "a refused run left something: {text}"
        );
        text
    }

    /// Runs `fit film rec` with more arguments, and gives fit.json.
    fn film(&self, more: &[&str]) -> serde_json::Value {
        let arguments = [
            &["fit", "film", "rec", "-o", "out", "--json", "--starts", "2"],
            more,
        ]
        .concat();
        let out = self.run(&arguments);
        assert!(
            out.status.success(),
            "{}",
            String::from_utf8_lossy(&out.stderr)
        );
        let printed: serde_json::Value =
            serde_json::from_slice(&out.stdout).expect("--json prints JSON and nothing else");
        let written = fs::read_to_string(self.path("out/fit.json")).unwrap();
        assert_eq!(
            printed,
            serde_json::from_str::<serde_json::Value>(&written).unwrap()
        );
        printed
    }
}

fn assert_says(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

#[test]
fn the_main_job_ends_in_parameters_that_predict_a_recording_that_was_not_fitted() {
    let dir = tempfile::tempdir().unwrap();
    let twin = Path::new(TWIN);
    let go = |arguments: &[&str]| {
        let mut command = std::process::Command::cargo_bin("deacal").unwrap();
        let out = command
            .current_dir(dir.path())
            .args(arguments)
            .output()
            .unwrap();
        assert!(
            out.status.success(),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&out.stderr)
        );
    };
    let rec = |name: &str| twin.join(name).to_str().unwrap().to_string();
    let singles = [rec("single-1"), rec("single-2"), rec("single-3")];
    go(&["fit", "film", &rec("symmetric"), "-o", "film", "-q"]);
    let forearm = ["fit", "forearm", &singles[0], &singles[1], &singles[2]];
    go(&[
        &forearm[..],
        &["--params", "film/parameters.toml", "-o", "forearm", "-q"],
    ]
    .concat());
    let robot = [
        "fit",
        "robot",
        &rec("symmetric"),
        &singles[0],
        &singles[1],
        &singles[2],
    ];
    go(&[
        &robot[..],
        &["--start", "forearm/parameters.toml", "-o", "robot", "-q"],
    ]
    .concat());
    go(&[
        "validate",
        &rec("circle-3s"),
        "--params",
        "robot/parameters.toml",
        "-o",
        "validate",
        "-q",
    ]);
    go(&[
        "predict",
        "voltage",
        &rec("circle-3s"),
        "--params",
        "robot/parameters.toml",
        "-o",
        "phi.csv",
    ]);
    go(&[
        "predict",
        "force",
        &rec("circle-3s"),
        "--params",
        "robot/parameters.toml",
        "-o",
        "force.csv",
    ]);
    go(&[
        "export",
        "robot/parameters.toml",
        "--format",
        "c",
        "-o",
        "parameters.h",
    ]);
    let read = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap();
    let validation: serde_json::Value =
        serde_json::from_str(&read("validate/validation.json")).unwrap();
    let rmse = validation["rmse_V"].as_f64().unwrap();
    // The true parameters reach 4.5 V with a simple low-pass on the same motion.
    assert!(rmse < 1.15 * 4.5, "{rmse} V");
    assert_eq!(validation["rmse_basis"], "above_1kV");
    let phi = read("phi.csv");
    assert!(phi.starts_with("time_s,phi1_V,phi2_V,phi3_V,"));
    assert_eq!(phi.lines().count(), 1 + 3051, "one row a captured frame");
    assert!(read("force.csv").starts_with("time_s,Fx_N,Fy_N,Fz_N,flag"));
    assert!(read("parameters.h").contains("static const double"));
    assert!(read("robot/report.html").contains("</html>"));
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let bench = Bench::new("single-1");
    let run = |out: &str| {
        let done = bench.run(&["fit", "film", "rec", "-o", out, "-q", "--starts", "3"]);
        assert!(done.status.success());
        fs::read_to_string(bench.path(out).join("parameters.toml")).unwrap()
    };
    let strip = |text: String| {
        text.lines()
            .filter(|l| !l.starts_with("command"))
            .collect::<Vec<_>>()
            .join("\n")
    };
    assert_eq!(strip(run("a")), strip(run("b")));
}

#[test]
fn what_is_not_there_is_named() {
    let bench = Bench::new("single-1");
    assert_says(
        &bench.refused(&["fit", "film", "nowhere", "-o", "out"]),
        &["nowhere"],
    );
    let text = bench.refused(&["fit", "film", "rec", "-o", "out", "--fix", "mu1=3e5"]);
    assert_says(&text, &["mu1", "nearest is `mu_1`", "T_6"]);
    let text = bench.refused(&["fit", "film", "rec", "-o", "out", "--bound", "T_1=3..1"]);
    assert_says(&text, &["T_1", "3 .. 1", "empty"]);
    let text = bench.refused(&["fit", "film", "rec", "-o", "out", "--start", "none.toml"]);
    assert_says(&text, &["none.toml"]);
    let text = bench.refused(&["fit", "forearm", "rec", "-o", "out"]);
    assert_says(&text, &["film", "--params"]);
    bench.edit("rec/recording.toml", |t| t.replace("payload_g", "payloadg"));
    let text = bench.refused(&["fit", "film", "rec", "-o", "out"]);
    assert_says(&text, &["payloadg", "payload_g", "recording.toml"]);
}

#[test]
fn what_is_mistaken_is_refused_with_its_place_and_remedy() {
    let bench = Bench::new("single-1");
    let text = bench.refused(&["fit", "film", "rec", "rec", "-o", "out"]);
    assert_says(&text, &["rec/recording.toml is named twice"]);
    let text = bench.refused(&["diagnose", "rec", "--holdout", "rec", "-o", "out"]);
    assert_says(&text, &["rec/recording.toml is named twice"]);
    let text = bench.refused(&["fit", "film", "rec", "-o", "out", "--fix", "J=nan"]);
    assert_says(&text, &["`J`: NaN is not possible"]);
    let text = bench.refused(&["fit", "film", "rec", "-o", "out", "--bound", "J=90..40"]);
    assert_says(&text, &["`J`: bounds 90 .. 40 are empty"]);
    fs::write(bench.path("plan.toml"), "fit = \"film\"\n[[set]\n").unwrap();
    let text = bench.refused(&["batch", "plan.toml", "-o", "out"]);
    assert_says(&text, &["plan.toml, line 2", "correct the TOML"]);
    bench.edit("rec/recording.toml", |t| {
        t.replace("\"single-1\"", &format!("\"{}\"", "x".repeat(300)))
    });
    let text = bench.refused(&["import", "rec", "-o", "out"]);
    assert_says(
        &text,
        &["recording.toml, line 2", "[recording] id", "200 bytes"],
    );
}

#[test]
fn wrong_usage_exits_with_2() {
    let bench = Bench::new("single-1");
    let code = |arguments: &[&str]| bench.run(arguments).status.code();
    assert_eq!(code(&["fit", "film"]), Some(2));
    assert_eq!(code(&["fit", "film", "rec", "--branches", "9"]), Some(2));
    assert_eq!(code(&["fit", "film", "rec", "--fix", "J"]), Some(2));
    assert_eq!(code(&["nonsense"]), Some(2));
    assert_eq!(code(&["--help"]), Some(0));
}

#[test]
fn clocks_that_do_not_overlap() {
    let bench = Bench::new("single-1");
    bench.edit("rec/recording.toml", |t| {
        t.replace("offset_s = 0.0", "offset_s = 500.0")
    });
    let text = bench.refused(&["fit", "film", "rec", "-o", "out"]);
    assert_says(&text, &["do not overlap", "offset_s", "500"]);
}

#[test]
fn poses_out_of_reach_name_sample_chain_and_joint() {
    let bench = Bench::new("single-1");
    bench.edit("rec/recording.toml", |t| {
        t.replace("95.0, 12.5]", "95.0, -112.5]")
    });
    let text = bench.refused(&["fit", "film", "rec", "-o", "out"]);
    assert_says(
        &text,
        &["single-1", " s:", "chain 1", "bicep", "base_position_mm"],
    );
    let bench = Bench::new("single-1");
    bench.edit("rig.toml", |t| t.replace("d_mm = 62.0", "d_mm = 45.0"));
    let text = bench.refused(&["fit", "film", "rec", "-o", "out"]);
    assert_says(&text, &["chain 1", "SAM"]);
}

#[test]
fn a_film_past_its_locking_stretch() {
    let bench = Bench::new("single-1");
    let text = bench.refused(&["fit", "film", "rec", "-o", "out", "--fix", "J=0.3"]);
    assert_says(&text, &["locking stretch", "J = 0.3", "spring 1"]);
}

/// Loses the marker of a recording in these lines of its motion.
fn lose_marker(bench: &Bench, lines: std::ops::Range<usize>) {
    bench.edit("rec/motion.csv", |t| {
        let rows = t.lines().enumerate().map(|(i, line)| {
            let kept: Vec<&str> = line.split(',').take(2).collect();
            match lines.contains(&i) {
                true => format!("{},,,,,,", kept.join(",")),
                false => line.to_string(),
            }
        });
        rows.collect::<Vec<_>>().join("\n")
    });
}

#[test]
fn a_long_gap_is_masked_and_said() {
    let bench = Bench::new("symmetric");
    lose_marker(&bench, 805..1205);
    let fit = bench.film(&[]);
    let notes = fit["recordings"][0]["notes"].to_string();
    assert_says(
        &notes,
        &["gap of 4.00 s", "longer than the smoother can bridge"],
    );
    assert_says(&notes, &["history in the gap is not known"]);
    let n = fit["n_samples"].as_u64().unwrap();
    assert!(n > 3000, "what is left is used: {n}");
}

#[test]
fn a_marker_that_was_lost_costs_less_than_the_noise_again() {
    let bench = Bench::new("symmetric");
    bench.film(&[]);
    let whole = fs::read_to_string(bench.path("rec/motion.csv")).unwrap();
    // at the start for a second and for three, in the middle for ten
    let error_v = |lines: std::ops::Range<usize>| {
        fs::write(bench.path("rec/motion.csv"), &whole).unwrap();
        lose_marker(&bench, lines);
        let parameters = ["validate", "rec", "--params", "out/parameters.toml"];
        let out = bench.run(&[&parameters[..], &["--json", "-o", "v", "--force"]].concat());
        let told = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success(), "{told}");
        let validation: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        ["rmse_V", "noise_floor_V"].map(|key| validation[key].as_f64().unwrap())
    };
    // what the film did before is not known, which cost hundreds of volts
    for lost in [0..0, 5..105, 5..305, 805..1805] {
        let [error, floor] = error_v(lost.clone());
        assert!(
            error < 2.0 * floor,
            "{lost:?}: {error} V, and noise makes {floor} V"
        );
    }
}

#[test]
fn a_negative_squared_voltage_is_counted_and_shown() {
    let bench = Bench::new("single-1");
    let fit = bench.film(&[]);
    assert_says(
        &fit["remarks"].to_string(),
        &["phi^2 < 0", "no voltage holds that pose"],
    );
}

#[test]
fn a_recording_too_short_for_its_slow_branches_is_fitted_and_they_are_called_open() {
    let bench = Bench::new("symmetric");
    bench.edit("rec/motion.csv", |t| {
        t.lines().take(5 + 800).collect::<Vec<_>>().join("\n")
    });
    let fit = bench.film(&[]);
    for name in ["T_5", "T_6", "mu_6", "mu_7"] {
        assert_eq!(fit["parameters"][name]["identifiable"], false, "{name}");
    }
    let too_short = Bench::new("symmetric");
    too_short.edit("rec/motion.csv", |t| {
        t.lines().take(5 + 75).collect::<Vec<_>>().join("\n")
    });
    let text = too_short.refused(&["fit", "film", "rec", "-o", "out"]);
    assert_says(&text, &["independent samples", "record longer"]);
}

#[test]
fn recordings_of_another_kind_or_another_rig() {
    let bench = Bench::new("single-1");
    let text = bench.refused(&["fit", "coupon", "rec", "-o", "out"]);
    assert_says(&text, &["robot", "film-coupon"]);
    let other = Bench::new("single-2");
    other.edit("rig.toml", |t| t.replace("q_mm = 50.0", "q_mm = 50.5"));
    let path = other.path("rec");
    let text = bench.refused(&["fit", "film", "rec", path.to_str().unwrap(), "-o", "out"]);
    assert_says(&text, &["single-1", "single-2", "different rigs", "--rig"]);
}

#[test]
fn a_file_of_another_kind_is_called_what_it_is() {
    let bench = Bench::new("single-1");
    parameter_file(&bench, "");
    fs::write(bench.path("fit.json"), "{\"film\": {\"J\": 80}}").unwrap();
    fs::write(bench.path("empty.toml"), "\n").unwrap();
    let parameters = "name the parameters.toml that `deacal fit`";
    let recording = "name the folder of a recording";
    for (arguments, words) in [
        (
            "validate rec --params rec/motion.csv",
            ["motion.csv: these are data (nexus-csv)", parameters],
        ),
        (
            "validate rec --params fit.json",
            ["fit.json: this is JSON", parameters],
        ),
        (
            "validate rec --params rec",
            ["rec: is a folder", parameters],
        ),
        (
            "validate rec --params empty.toml",
            ["the file is empty", parameters],
        ),
        (
            "validate rec --params rig.toml",
            ["rig.toml, line 9: this is a rig file", parameters],
        ),
        (
            "validate rec --params rec/recording.toml",
            ["line 1: this is a recording.toml", parameters],
        ),
        (
            "validate rec --params p.toml --rig p.toml",
            [
                "p.toml, line 1: this is a parameter file",
                "name the rig.toml",
            ],
        ),
        (
            "validate rec/voltage.csv --params p.toml",
            ["these are data (csv)", recording],
        ),
        ("fit film p.toml", ["this is a parameter file", recording]),
        ("import rig.toml", ["this is a rig file", recording]),
        (
            "batch p.toml",
            ["this is a parameter file", "name a plan with a [[set]]"],
        ),
        (
            "fit film .",
            ["no recording.toml", "name the recordings in it: ./rec"],
        ),
        (
            "fit coupon rec",
            ["of kind \"robot\"", "`deacal fit robot` fits it"],
        ),
    ] {
        let mut all: Vec<&str> = arguments.split(' ').collect();
        all.extend(["-o", "out"]);
        assert_says(&bench.refused(&all), &words);
    }
}

#[test]
fn numbers_that_cannot_be_are_refused_with_line_and_range() {
    let bench = Bench::new("single-1");
    for (from, to, words) in [
        (
            "day = 1",
            "day = -3",
            ["line 9, [recording] day: found -3", "from 0 to 36525"],
        ),
        (
            "day = 1",
            "day = 20261128",
            ["found 20261128", "days since the electrodes"],
        ),
        (
            "day = 1",
            "temperature_C = 294.15",
            ["found 294.15", "degrees Celsius"],
        ),
        (
            "day = 1",
            "humidity_percent = 140",
            ["found 140", "from 0 to 100"],
        ),
    ] {
        bench.edit("rec/recording.toml", |t| t.replace(from, to));
        assert_says(&bench.refused(&["import", "rec", "-o", "out"]), &words);
        bench.edit("rec/recording.toml", |t| t.replace(to, from));
    }
    fs::write(
        bench.path("plan.toml"),
        "[[set]]\nname = \"a\"\nrecordings = [\"rec\"]\nday = -3\n",
    )
    .unwrap();
    let text = bench.refused(&["batch", "plan.toml", "-o", "out"]);
    assert_says(
        &text,
        &["plan.toml, line 4", "found day = -3", "from 0 to 36525"],
    );
    let file = parameter_file(&bench, "");
    bench.edit("p.toml", |t| {
        t.replace("J = 80.0", "J = 80.0\neps_r = 2800.0")
    });
    let text = bench.refused(&["validate", "rec", "--params", &file, "-o", "out"]);
    assert_says(&text, &["p.toml: eps_r = 2800", "1 to 100"]);
    parameter_file(&bench, "[effect]\nid = \"leakage\"\n");
    let text = bench.refused(&["validate", "rec", "--params", &file, "-o", "out"]);
    assert_says(&text, &["a list of tables", "begin each with [[effect]]"]);
    parameter_file(&bench, "");
    let simulate = |drive: &str, length: &str| {
        let given = [
            "simulate", "--rig", "rig.toml", "--params", "p.toml", "--drive",
        ];
        bench.refused(&[&given[..], &[drive, "--duration", length, "-o", "out"]].concat())
    };
    let text = simulate("sine:peak_V=5500,hz=1e6", "5");
    assert_says(&text, &["1000000 Hz is lost", "up to 500 Hz"]);
    let text = simulate("sine:peak_V=5500,hz=0.3", "1e12");
    assert_says(&text, &["1000000000000 s", "make it shorter"]);
}

/// A prediction or an export without a file goes to standard output, with `--json` as a part of the result.
#[test]
fn without_a_file_the_result_is_on_standard_output() {
    let bench = Bench::new("single-1");
    let file = parameter_file(&bench, "");
    let said = |arguments: &[&str]| {
        let out = bench.run(arguments);
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(out.status.success() && error.is_empty(), "{error}");
        String::from_utf8(out.stdout).unwrap()
    };
    let predict = ["predict", "voltage", "rec", "--params", &file];
    let table = said(&predict);
    let json = said(&[&predict[..], &["--json"]].concat());
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["file"], serde_json::Value::Null);
    let told = json["columns"]["phi1_V"].as_array().unwrap();
    let read = column(&table, "phi1_V");
    assert_eq!(told.len(), read.len());
    for (a, b) in told.iter().zip(&read) {
        assert!(
            a.as_f64().map_or(b.is_nan(), |a| (a - b).abs() < 1e-3),
            "{a} {b}"
        );
    }
    let json = said(&[&predict[..], &["--json", "-o", "p.csv"]].concat());
    assert!(
        json.contains("p.csv") && !json.contains("columns"),
        "{json}"
    );
    let export = ["export", &file, "--format", "c"];
    let text = said(&export);
    let json = said(&[&export[..], &["--json"]].concat());
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["text"].as_str(), Some(text.as_str()));
    let words = said(&[&export[..], &["-o", "p.h"]].concat());
    assert_says(
        &words,
        &["the film (7 springs)", "(7 angles) and 0 causes", "p.h"],
    );
}

#[test]
fn what_looks_wrong_is_said_in_the_first_lines() {
    let bench = Bench::new("symmetric");
    bench.edit("rig.toml", |t| t.replace("L1_mm = 62.9", "L1_mm = 40.0"));
    fs::create_dir(bench.path("other")).unwrap();
    for file in ["recording.toml", "motion.csv", "voltage.csv"] {
        fs::copy(
            format!("{TWIN}/single-1/{file}"),
            bench.path(&format!("other/{file}")),
        )
        .unwrap();
    }
    let first = |paths: &[&str]| {
        let out = bench.run(&[&["import"], paths, &["-o", "out"]].concat());
        let text = String::from_utf8(out.stdout).unwrap();
        text.lines().take(5).collect::<Vec<_>>().join("\n")
    };
    let words = ["one thing to look at", "L1_mm = 40 and L2_mm = 40.65"];
    assert_says(&first(&["rec"]), &words);
    let several = first(&["rec", "other", "rec/voltage.csv"]);
    assert_says(
        &several,
        &["2 recordings and 1 file: look at symmetric (1), single-1 (1)"],
    );
    assert_says(&several, &words);
}

#[test]
fn a_file_where_the_folder_should_be_is_left_as_it_is() {
    let bench = Bench::new("single-1");
    fs::write(bench.path("taken"), "mine").unwrap();
    let out = bench.run(&["fit", "film", "rec", "-o", "taken", "-q"]);
    assert_eq!(out.status.code(), Some(1));
    assert_says(&String::from_utf8_lossy(&out.stderr), &["taken"]);
    assert_eq!(fs::read_to_string(bench.path("taken")).unwrap(), "mine");
}

#[test]
fn a_failed_run_does_not_touch_earlier_results() {
    let bench = Bench::new("single-1");
    bench.film(&[]);
    let before = fs::read(bench.path("out/parameters.toml")).unwrap();
    bench.edit("rec/voltage.csv", |t| t.replacen("0.5", "inf", 1));
    let out = bench.run(&["fit", "film", "rec", "-o", "out", "-q"]);
    assert_eq!(out.status.code(), Some(1));
    assert_says(
        &String::from_utf8_lossy(&out.stderr),
        &["voltage.csv", "inf"],
    );
    assert_eq!(fs::read(bench.path("out/parameters.toml")).unwrap(), before);
}

#[test]
fn import_writes_a_manifest_to_start_from() {
    let bench = Bench::new("symmetric");
    fs::create_dir(bench.path("new")).unwrap();
    for file in ["motion.csv", "voltage.csv"] {
        fs::copy(
            bench.path(&format!("rec/{file}")),
            bench.path(&format!("new/{file}")),
        )
        .unwrap();
    }
    let out = bench.run(&[
        "import",
        "new/motion.csv",
        "new/voltage.csv",
        "--init",
        "-o",
        "out",
    ]);
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(
        said.contains("nexus-csv") && said.contains("A start is written"),
        "{said}"
    );
    // what moves and what rests is told from the motion; with a rig it is a recording
    fs::copy(bench.path("rig.toml"), bench.path("new/rig.toml")).unwrap();
    // what is still to be filled in is asked for first, not another unit that would fit as well
    let said = bench.run(&["import", "new", "-o", "whole"]).stdout;
    let said = String::from_utf8_lossy(&said);
    assert_says(
        &said,
        &[
            "! wrong",
            "base_position_mm is 0, 0, 0",
            "missing in 2 gaps",
        ],
    );
    assert!(!said.contains("unit = "), "{said}");
    let recording = deacal::recording::Recording::open(&bench.path("new")).unwrap();
    let original = deacal::recording::Recording::open(&bench.path("rec")).unwrap();
    let labels = |r: &deacal::recording::Recording| {
        let m = r.motion.as_ref().unwrap();
        (
            m.end_effector.label.clone(),
            m.base.as_ref().unwrap().label.clone(),
        )
    };
    assert_eq!(labels(&recording), labels(&original));
    assert_eq!(recording.manifest.id, "new");
    assert_eq!(
        recording.voltage.unwrap().channels,
        original.voltage.unwrap().channels
    );
    // nothing is overwritten, and a recording needs no start
    let text = fs::read_to_string(bench.path("new/recording.toml")).unwrap();
    for path in ["new/motion.csv", "new"] {
        let out = bench.run(&["import", path, "--init", "-o", "out2"]);
        assert_eq!(out.status.code(), Some(1));
        assert_eq!(
            String::from_utf8_lossy(&out.stderr).trim().lines().count(),
            1
        );
    }
    assert_eq!(
        fs::read_to_string(bench.path("new/recording.toml")).unwrap(),
        text
    );
    assert!(!bench.path("out2").exists());
}

/// A file is written as what its ending says, or not at all.
#[test]
fn an_ending_that_lies_is_refused() {
    let bench = Bench::new("symmetric");
    bench.film(&[]);
    let params = "out/parameters.toml";
    for (arguments, words) in [
        (
            &[
                "predict", "voltage", "rec", "--params", params, "-o", "v.xlsx",
            ][..],
            "ends in .csv or .mcap or .mat or .npz",
        ),
        (
            &["predict", "force", "rec", "--params", params, "-o", "f.mat"],
            "ends in .csv",
        ),
        (
            &["export", params, "--format", "json", "-o", "p.py"],
            "--format json is not written as .py",
        ),
        (
            &["export", params, "--format", "c", "-o", "p.m"],
            "ends in .h or .c",
        ),
    ] {
        let out = bench.run(arguments);
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(1), "{arguments:?}: {text}");
        assert_says(&text, &[arguments[arguments.len() - 1], words]);
        assert!(!bench.path(arguments[arguments.len() - 1]).exists());
    }
    for name in ["p.h", "p", "p.txt"] {
        let out = bench.run(&["export", params, "--format", "c", "-o", name]);
        assert!(
            out.status.success(),
            "{name}: {}",
            String::from_utf8_lossy(&out.stderr)
        );
    }
}

#[test]
fn import_describes_a_recording_and_a_bare_file() {
    let bench = Bench::new("symmetric");
    let out = bench.run(&["import", "rec", "rec/voltage.csv", "-o", "out", "--json"]);
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(json["recordings"].as_array().unwrap().len(), 1);
    assert_eq!(json["files"].as_array().unwrap().len(), 1);
    for file in ["import.json", "symmetric.csv", "symmetric.mcap"] {
        assert!(bench.path("out").join(file).exists(), "{file}");
    }
}

/// A parameter file of the bundled robot's own film, with more text at its end.
fn parameter_file(bench: &Bench, more: &str) -> String {
    let text = format!(
        "[film]\nmu_Pa = [1.12e6, 2.2e5, 1.2e5, 5.5e4, 4.5e4, 3.5e4, 3e4]\nT_s = [0.02, 0.12, 0.7, 4.0, 25.0, 150.0]\nJ = 80.0\n[forearm]\nnodes_deg = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]\ntorque_N_m = [-1.6e-3, -8e-4, -3e-4, 0.0, 3e-4, 8e-4, 1.6e-3]\n{more}"
    );
    fs::write(bench.path("p.toml"), text).unwrap();
    "p.toml".into()
}

/// Column of a CSV; empty cells as NaN.
fn column(text: &str, name: &str) -> Vec<f64> {
    let at = text
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|c| c == name);
    let at = at.unwrap_or_else(|| panic!("no column {name}"));
    let cell = |l: &str| l.split(',').nth(at).unwrap().parse().unwrap_or(f64::NAN);
    text.lines().skip(1).map(cell).collect()
}

#[test]
fn a_diagnosis_leaves_a_model_that_the_other_commands_apply() {
    let bench = Bench::new("single-1");
    let rec = |name: &str| format!("{TWIN}/{name}");
    let out = bench.run(&[
        "diagnose",
        &rec("symmetric"),
        &rec("single-1"),
        &rec("single-2"),
        &rec("single-3"),
        "--holdout",
        &rec("circle-3s"),
        "--only",
        "series_resistance,amplifier_gain,joint_damping",
        "-o",
        "out",
        "--json",
    ]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{said}");
    let printed: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let written = fs::read_to_string(bench.path("out/diagnosis.json")).unwrap();
    common::check("diagnosis", &written);
    assert_eq!(
        printed,
        serde_json::from_str::<serde_json::Value>(&written).unwrap()
    );
    // Which verdict it is, is the business of the tests of the diagnosis.
    let verdict = printed["verdict"].as_str().unwrap();
    assert!(["adequate", "missing_physics", "unexplained"].contains(&verdict));
    assert_says(
        &printed["remarks"].to_string(),
        &["order of the command line"],
    );
    assert_eq!(printed["series"].as_array().unwrap().len(), 5);
    let html = fs::read_to_string(bench.path("out/report.html")).unwrap();
    assert!(html.contains("Does the plain model fit, against the noise?"));
    let done = bench.run(&[
        "validate",
        &rec("circle-3s"),
        "--params",
        "out/parameters.toml",
        "-o",
        "v",
        "-q",
    ]);
    assert!(
        done.status.success(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    let validation: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(bench.path("v/validation.json")).unwrap())
            .unwrap();
    let (a, b) = (&validation["rmse_V"], &printed["holdout_rmse_V"]["after"]);
    let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
    // a diagnosis works with every second frame of a capture at 100 Hz
    assert!(
        (a - b).abs() < 1e-3 * a,
        "validate says {a} V, the diagnosis {b} V"
    );
}

#[test]
fn causes_of_a_parameter_file_are_applied() {
    let bench = Bench::new("single-1");
    let predict = |more: &str| {
        let file = parameter_file(&bench, more);
        let out = bench.run(&[
            "predict", "voltage", "rec", "--params", &file, "-o", "phi.csv",
        ]);
        assert!(
            out.status.success(),
            "{}",
            String::from_utf8_lossy(&out.stderr)
        );
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        (fs::read_to_string(bench.path("phi.csv")).unwrap(), said)
    };
    let (plain, _) = predict("");
    assert!(!plain.contains("film1_V"));
    let (gain, _) =
        predict("[[effect]]\nid = \"amplifier_gain\"\nactuators = [1]\ngain_error = 0.1\n");
    let (needed, told, film) = (
        column(&plain, "phi1_V"),
        column(&gain, "phi1_V"),
        column(&gain, "film1_V"),
    );
    let mut counted = 0;
    for i in (0..needed.len()).filter(|&i| needed[i] > 500.0 && told[i].is_finite()) {
        assert!(
            (film[i] - needed[i]).abs() < 1e-3,
            "the film needs what it needs"
        );
        assert!(
            (told[i] * 1.1 - needed[i]).abs() < 0.01,
            "{} {}",
            told[i],
            needed[i]
        );
        counted += 1;
    }
    assert!(counted > 500);
    // A resistance wants more while the voltage rises, less while it falls.
    let (lag, _) = predict("[[effect]]\nid = \"series_resistance\"\nresistance = 2e7\n");
    let (told, film) = (column(&lag, "phi1_V"), column(&lag, "film1_V"));
    let (mut rising, mut falling) = ((0, 0), (0, 0));
    for i in (50..film.len() - 50).filter(|&i| film[i] > 1500.0 && told[i].is_finite()) {
        let rate = film[i + 5] - film[i - 5];
        let count = if rate > 100.0 {
            &mut rising
        } else if rate < -100.0 {
            &mut falling
        } else {
            continue;
        };
        count.0 += 1;
        count.1 += usize::from((told[i] > film[i]) == (rate > 0.0));
    }
    assert!(rising.0 > 50 && falling.0 > 50, "{rising:?} {falling:?}");
    assert!(
        rising.1 * 10 > rising.0 * 9 && falling.1 * 10 > falling.0 * 9,
        "{rising:?} {falling:?}"
    );
    // A ceiling below what the motion needs: no command.
    let (cut, _) = predict("[[effect]]\nid = \"amplifier_saturation\"\nceiling = 3000.0\n");
    assert!(cut.contains("no command: chain 1"));
    // What broke in another series is whole here, and that is said.
    let (other, said) = predict(
        "[[effect]]\nid = \"payload_change\"\nmass = 0.01\ntime = 0.0\nrecording = \"elsewhere/01-a\"\n",
    );
    assert_eq!(column(&other, "phi1_V")[500], column(&plain, "phi1_V")[500]);
    assert_says(&said, &["payload_change", "another series"]);
    let (here, _) = predict(
        "[[effect]]\nid = \"payload_change\"\nmass = 0.01\ntime = 0.0\nrecording = \"single-1\"\n",
    );
    assert_ne!(column(&here, "phi1_V")[500], column(&plain, "phi1_V")[500]);
    // validate takes the error at the film, force the causes as the robot's own
    let file = parameter_file(
        &bench,
        "[[effect]]\nid = \"amplifier_gain\"\ngain_error = 0.1\n",
    );
    let out = bench.run(&["validate", "rec", "--params", &file, "-o", "v", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(
        json["rmse_V"].as_f64().unwrap() > 200.0,
        "the twin's amplifier is right: a gain makes it wrong"
    );
    let out = bench.run(&["predict", "force", "rec", "--params", &file, "-o", "f.csv"]);
    assert!(out.status.success());
}

#[test]
fn predictions_outside_what_was_learnt_are_said() {
    let bench = Bench::new("single-1");
    let term = |site: &str, unit: &str, own: &str| {
        format!("[[effect]]\nid = \"learnt\"\nsite = \"{site}\"\nunit = \"{unit}\"\n{own}\n")
    };
    let drag = |speed_m_s: f64| {
        let own = format!(
            "form = \"drag\"\nvariables = [\"effector velocity\"]\ncoefficients = [0, 0, 0, 0, 0, 0]\nrange = [[0, {speed_m_s}]]"
        );
        term("force", "N", &own)
    };
    // of the actuators one is driven: the angle of its bicep alone leaves 3.9 to 4.1 rad
    let curve = term(
        "bicep",
        "N m",
        "form = \"spline\"\nvariables = [\"bicep angle\"]\nknots = [3.9, 4.0, 4.1]\nvalues = [0, 1e-6, 0]\nrange = [[3.9, 4.1]]",
    );
    let file = parameter_file(&bench, &(curve.clone() + &drag(10.0)));
    let words = [
        "single-1: a learnt term (a torque on the bicep joints, a spline) saw bicep angle from 3.90 rad to 4.10 rad",
        "above that range",
        "held at its edge",
    ];
    for what in ["voltage", "force", "motion"] {
        let out = bench.run(&["predict", what, "rec", "--params", &file, "-o", "p.csv"]);
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        assert!(
            out.status.success(),
            "{}",
            String::from_utf8_lossy(&out.stderr)
        );
        assert_says(&said, &words);
        assert!(!said.contains("drag"), "{said}");
    }
    // the table itself says nothing, the line beside it does
    let out = bench.run(&["predict", "motion", "rec", "--params", &file]);
    assert!(!String::from_utf8_lossy(&out.stdout).contains("learnt"));
    assert_says(&String::from_utf8_lossy(&out.stderr), &words);
    let out = bench.run(&["validate", "rec", "--params", &file, "-o", "v"]);
    assert_says(&String::from_utf8_lossy(&out.stdout), &words);
    let json = fs::read_to_string(bench.path("v/validation.json")).unwrap();
    assert_says(&json, &words);
    // a force of the speed, faster than it was learnt
    let file = parameter_file(&bench, &drag(1e-4));
    let out = bench.run(&["predict", "force", "rec", "--params", &file, "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let remarks = json["remarks"].as_array().unwrap();
    assert_eq!(remarks.len(), 1, "{json}");
    let said = remarks[0].as_str().unwrap();
    assert_says(
        said,
        &[
            "a drag",
            "effector velocity",
            "0.000100 m/s",
            "no recording says",
        ],
    );
    // what is inside is no news
    let file = parameter_file(&bench, &drag(10.0));
    let out = bench.run(&["predict", "force", "rec", "--params", &file, "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert!(json.get("remarks").is_none(), "{json}");
}

#[test]
fn causes_that_do_not_exist_are_refused_with_those_that_do() {
    let bench = Bench::new("single-1");
    for (more, words) in [
        (
            "[[effect]]\nid = \"series_resistence\"\n",
            ["line 9", "did you mean \"series_resistance\"?", "leakage"],
        ),
        (
            "[[effect]]\nid = \"leakage\"\nloss = 0.1\n",
            ["line 10", "unknown name", "loss_fraction"],
        ),
        (
            "[[effect]]\nid = \"leakage\"\n",
            ["line 9", "none of its values", "state loss_fraction"],
        ),
    ] {
        let file = parameter_file(&bench, more);
        for command in [
            &["predict", "voltage", "rec"][..],
            &["validate", "rec", "-o", "out"],
        ] {
            let text = bench.refused(&[command, &["--params", &file]].concat());
            assert_says(&text, &words);
        }
    }
    // an export applies no cause, and would pass it on all the same
    let file = parameter_file(&bench, "[[effect]]\nid = \"leakge\"\nloss_fraction = 0.1\n");
    let text = bench.refused(&["export", &file, "--format", "c", "-o", "out"]);
    assert_says(&text, &["p.toml, line 9", "did you mean \"leakage\"?"]);
    parameter_file(&bench, "[[effect]]\nid = \"x_own\"\ngain = 0.1\n");
    assert!(
        bench
            .run(&["export", &file, "--format", "c"])
            .status
            .success()
    );
    let out = bench.run(&["diagnose", "rec", "--only", "series_resistence"]);
    assert_eq!(out.status.code(), Some(2));
    assert_says(
        &String::from_utf8_lossy(&out.stderr),
        &[
            "series_resistence",
            "did you mean \"series_resistance\"?",
            "frame_tilt",
        ],
    );
}

#[test]
fn recordings_that_cannot_be_diagnosed() {
    let bench = Bench::new("single-1");
    let coupon = concat!(env!("CARGO_MANIFEST_DIR"), "/datasets/miles2015_vhb4910");
    let text = bench.refused(&["diagnose", "rec", coupon, "-o", "out"]);
    assert_says(&text, &["film-coupon", "robot"]);
    let other = Bench::new("single-2");
    other.edit("rig.toml", |t| t.replace("q_mm = 50.0", "q_mm = 50.5"));
    let path = other.path("rec");
    let text = bench.refused(&[
        "diagnose",
        "rec",
        "--holdout",
        path.to_str().unwrap(),
        "-o",
        "out",
    ]);
    assert_says(&text, &["different rigs", "--rig"]);
    bench.edit("rec/voltage.csv", |t| {
        let still = |(i, l): (usize, &str)| match (i, l.split(',').next()) {
            (1.., Some(time)) => format!("{time},1.5,1.5,1.5"),
            _ => l.to_string(),
        };
        t.lines()
            .enumerate()
            .map(still)
            .collect::<Vec<_>>()
            .join("\n")
    });
    let text = bench.refused(&["diagnose", "rec", "-o", "out"]);
    assert_says(&text, &["voltage", "50 V", "sine"]);
}
