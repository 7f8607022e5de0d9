//! `simulate`, `predict motion` and what `validate` says of path, force and stroke, as a user runs them.

use std::fs;
use std::path::PathBuf;
use std::process::Output;

use assert_cmd::cargo::CommandCargoExt;
use serde_json::Value;

const RIG: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/datasets/twin2026_delta/rig.toml"
);
const CIRCLE: &str = "circle:radius_mm=5,height_mm=-50,turns=2";

fn film(scale: f64) -> String {
    let mu = [1120e3, 220e3, 120e3, 55e3, 45e3, 35e3, 30e3].map(|m| m * scale);
    format!(
        "[film]\nmu_Pa = {mu:?}\nT_s = [0.02, 0.12, 0.7, 4.0, 25.0, 150.0]\nJ = 80.0\neps_r = 2.8\n\n\
         [forearm]\nnodes_deg = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]\n\
         torque_N_m = [-1.6e-3, -0.8e-3, -0.3e-3, 0.0, 0.3e-3, 0.8e-3, 1.6e-3]\n"
    )
}

/// A folder with the true parameters in `p.toml`.
struct Bench {
    dir: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Bench {
            dir: tempfile::tempdir().unwrap(),
        };
        fs::write(bench.path("p.toml"), film(1.0)).unwrap();
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = std::process::Command::cargo_bin("deacal").unwrap();
        command
            .current_dir(self.dir.path())
            .args(arguments)
            .output()
            .unwrap()
    }

    fn done(&self, arguments: &[&str]) -> String {
        let out = self.run(arguments);
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.success(), "{arguments:?}: {error}");
        String::from_utf8(out.stdout).unwrap()
    }

    fn simulate(&self, more: &[&str]) -> String {
        let base = ["simulate", "--rig", RIG, "--params", "p.toml", "-o", "rec"];
        self.done(&[&base[..], more].concat())
    }

    /// Simulates, expects refusal in one line, and that nothing is left.
    fn refused(&self, more: &[&str]) -> String {
        let base = ["simulate", "--rig", RIG, "--params", "p.toml", "-o", "no"];
        let out = self.run(&[&base[..], more].concat());
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(1), "{more:?}: {text}");
        assert_eq!(text.trim_end().lines().count(), 1, "one line, not:\n{text}");
        assert!(!self.path("no").exists(), "left something: {text}");
        text
    }

    fn validation(&self, more: &[&str]) -> Value {
        let base = [
            "validate", "rec", "--params", "p.toml", "-o", "val", "--json",
        ];
        serde_json::from_str(&self.done(&[&base[..], more].concat())).unwrap()
    }

    /// Numbers of a table: one row a line, an empty or worded cell as NaN.
    fn table(&self, name: &str, skip: usize) -> Vec<Vec<f64>> {
        let row = |line: &str| {
            let cell = |c: &str| c.trim().parse().unwrap_or(f64::NAN);
            line.split(',').map(cell).collect()
        };
        self.read(name).lines().skip(skip).map(row).collect()
    }
}

fn assert_says(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "`{word}` is not in: {text}");
    }
}

#[test]
fn voltages_come_back_from_a_simulated_recording_to_a_volt() {
    let bench = Bench::new();
    bench.simulate(&["--drive", CIRCLE, "-q"]);
    bench.done(&[
        "predict", "voltage", "rec", "--params", "p.toml", "-o", "phi.csv", "-q",
    ]);
    let applied = bench.table("rec/voltage.csv", 1);
    let predicted = bench.table("phi.csv", 1);
    let (mut sum, mut count) = (0.0, 0);
    for row in &predicted[30..predicted.len() - 30] {
        let command = &applied[(row[0] * 1000.0).round() as usize];
        for k in 1..=3 {
            let want = command[k] * 1e3;
            if want > 1000.0 {
                sum += (row[k] - want).powi(2);
                count += 1;
            }
        }
    }
    let rmse = (sum / f64::from(count)).sqrt();
    println!("round trip through files: {rmse:.3} V over {count} samples above 1 kV");
    assert!(count > 1500 && rmse < 1.0, "{rmse} V, {count} samples");
}

#[test]
fn predicted_motion_is_the_simulated_one() {
    let bench = Bench::new();
    // With everything that must not matter: payload steps, a clock offset, a gap.
    let more = [
        "--payload",
        "1,2.5:3",
        "--clock-offset",
        "0.37",
        "--gap",
        "1:0.2",
    ];
    bench.simulate(
        &[
            &[
                "--drive",
                "sine:peak_V=4000/3000/3500,hz=0.5",
                "--duration",
                "6",
            ],
            &more[..],
        ]
        .concat(),
    );
    let said = bench.done(&[
        "predict", "motion", "rec", "--params", "p.toml", "-o", "m.csv",
    ]);
    assert_says(&said, &["601 frames predicted"]);
    assert!(
        bench
            .read("m.csv")
            .starts_with("time_s,x_mm,y_mm,z_mm,flag\n")
    );
    let predicted = bench.table("m.csv", 1);
    let captured = bench.table("rec/motion.csv", 5);
    assert_eq!(predicted.len(), captured.len());
    let (mut worst, mut gap) = (0.0_f64, 0);
    for (p, c) in predicted.iter().zip(&captured) {
        for k in 0..3 {
            match c[2 + k].is_nan() {
                true => gap += 1,
                false => worst = worst.max((p[1 + k] - c[2 + k]).abs()),
            }
        }
    }
    assert_eq!(gap, 3 * 20);
    // Files round to 0.001 mm and 0.1 V.
    println!("predicted against simulated motion: at most {worst:.5} mm");
    assert!(worst < 2e-3, "{worst} mm");
}

#[test]
fn a_motion_that_ends_early_is_predicted_as_far_as_it_goes() {
    let bench = Bench::new();
    bench.simulate(&[
        "--drive",
        "sine:peak_V=5000,hz=0.5",
        "--duration",
        "4",
        "-q",
    ]);
    // The same voltages on a film half as stiff snap through.
    fs::write(bench.path("soft.toml"), film(0.4)).unwrap();
    let out = bench.done(&[
        "predict",
        "motion",
        "rec",
        "--params",
        "soft.toml",
        "-o",
        "m.csv",
        "--json",
    ]);
    let json: Value = serde_json::from_str(&out).unwrap();
    let predicted = json["predicted"].as_u64().unwrap();
    assert_eq!(json["rows"], 401);
    assert!((10..390).contains(&predicted), "{predicted}");
    let text = bench.read("m.csv");
    let last = text.lines().last().unwrap();
    assert!(last.starts_with("4.000000,,,,at "), "{last}");
    assert_says(last, &["snaps through"]);
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let bench = Bench::new();
    let files = |seed: &str| {
        let noise = [
            "--noise",
            "0.03",
            "--coloured-noise",
            "0.02",
            "--seed",
            seed,
        ];
        bench.simulate(
            &[
                &[
                    "--drive",
                    "chirp:peak_V=3000,from_hz=0.2,to_hz=2",
                    "--duration",
                    "3",
                ],
                &noise[..],
            ]
            .concat(),
        );
        ["motion.csv", "voltage.csv", "recording.toml", "rig.toml"]
            .map(|f| bench.read(&format!("rec/{f}")))
    };
    let (a, b, other) = (files("7"), files("7"), files("8"));
    assert_eq!(a, b);
    assert_ne!(a[0], other[0]);
    assert_eq!(a[1..], other[1..]);
    assert_eq!(a[3], fs::read_to_string(RIG).unwrap());
}

#[test]
fn a_planned_path_becomes_voltages_that_follow_it() {
    let bench = Bench::new();
    bench.simulate(&["--drive", CIRCLE, "-q"]);
    fs::rename(bench.path("rec"), bench.path("first")).unwrap();
    let out = bench.simulate(&["--path", "first/planned.csv", "--json"]);
    let json: Value = serde_json::from_str(&out).unwrap();
    let off = json["off_plan_mm"].as_f64().unwrap();
    println!("a path at 100 Hz is followed to {off:.5} mm");
    assert!(off < 5e-3, "{off} mm");
    let (a, b) = (
        bench.table("first/voltage.csv", 1),
        bench.table("rec/voltage.csv", 1),
    );
    assert_eq!(a.len(), b.len());
    // The plan ends on the move; its last rows know nothing of what would come.
    for (i, (a, b)) in a.iter().zip(&b).enumerate().take(a.len() - 50) {
        for k in 1..=3 {
            assert!(
                a[k] < 1.0 || (a[k] - b[k]).abs() < 2e-3,
                "row {i}: {a:?} {b:?}"
            );
        }
    }
    // What the inverse model gives is a voltage file, too.
    bench.done(&[
        "predict", "voltage", "first", "--params", "p.toml", "-o", "phi.csv", "-q",
    ]);
    let phi = bench.read("phi.csv");
    let (head, rows) = phi.split_once('\n').unwrap();
    let whole: Vec<&str> = rows.lines().filter(|l| !l.contains("phi^2")).collect();
    assert!(whole.len() > 800);
    fs::write(
        bench.path("phi.csv"),
        format!("{head}\n{}\n", whole.join("\n")),
    )
    .unwrap();
    bench.simulate(&["--voltage", "phi.csv", "-q"]);
    let second = whole[1].split(',').collect::<Vec<_>>();
    let hole = [second[0], "", second[2], second[3], ",,,"].join(",");
    fs::write(
        bench.path("phi.csv"),
        format!("{head}\n{}\n{hole}\n", whole[0]),
    )
    .unwrap();
    let text = bench.refused(&["--voltage", "phi.csv"]);
    assert_says(&text, &["phi.csv:3", "empty cell"]);
}

#[test]
fn validation_of_path_stroke_and_force() {
    let bench = Bench::new();
    bench.simulate(&["--drive", CIRCLE, "--noise", "0.03", "-q"]);
    fs::write(bench.path("stiff.toml"), film(1.1)).unwrap();
    let v = bench.validation(&["--params", "stiff.toml"]);
    let right = &v["recordings"][0];
    let wrong = &v["compared"][0]["recordings"][0];
    for axis in 0..3 {
        let rmse = right["path"]["rmse_mm"][axis].as_f64().unwrap();
        // The true parameters leave the noise.
        assert!((0.025..0.035).contains(&rmse), "{rmse} mm");
        assert!(wrong["path"]["rmse_mm"][axis].as_f64().unwrap() > 3.0 * rmse);
        let whole = right["path"]["relative_to_mm"][axis].as_f64().unwrap();
        let relative = right["path"]["rmse_relative"][axis].as_f64().unwrap();
        assert!((relative * whole - rmse).abs() < 1e-12);
        assert!(axis == 2 || (whole - 10.0).abs() < 0.1, "{whole} mm");
    }
    assert_eq!(right["path"]["basis"], "predicted");
    let stroke = &right["stroke_mm"];
    let of = |s: &Value, key: &str| s[key].as_f64().unwrap();
    assert!((of(stroke, "recorded") - of(stroke, "predicted")).abs() < 0.1);
    assert!((of(stroke, "recorded") - of(&wrong["stroke_mm"], "predicted")).abs() > 0.5);
    // The report shows both beside the paper, words first.
    let report = bench.read("val/report.html");
    assert_says(
        &report,
        &[
            "p.toml",
            "stiff.toml",
            "0.18 (1.8 %)",
            "49.3",
            "How well are path, force and stroke predicted?",
        ],
    );
    assert!(report.find("path off by").unwrap() < report.find("<svg").unwrap());
    // Against the plan: the simulated robot followed it, so the noise is left again, with any parameters.
    let v = bench.validation(&["--path", "rec/planned.csv"]);
    let path = &v["recordings"][0]["path"];
    assert_eq!(path["basis"], "planned");
    assert!(path["rmse_mm"][0].as_f64().unwrap() < 0.035);
}

#[test]
fn the_weight_that_was_placed_is_read_from_motion_and_voltages() {
    let bench = Bench::new();
    // The paper's Fig 12: 5 g placed, then 0 V, 3 kV, 4 kV, 0 V.
    let drive = "holds:levels_V=0/3000/4000/0,time_s=8/8/8/6,ramp_s=3";
    bench.simulate(&[
        "--drive",
        drive,
        "--payload",
        "0,3:5",
        "--noise",
        "0.03",
        "-q",
    ]);
    let weight_mn = 5.0 * 9.80665;
    let phase = |v: &Value, name: &str, key: &str| {
        let all = v["recordings"][0]["force"].as_array().unwrap();
        let one = all.iter().find(|f| f["phase"] == name);
        one.unwrap_or_else(|| panic!("no phase {name}"))[key]
            .as_f64()
            .unwrap()
    };
    let v = bench.validation(&[]);
    for name in ["idle", "hold", "move", "released"] {
        let relative = phase(&v, name, "z_rmse_relative");
        println!("{name}: {:.2} % of the weight", 100.0 * relative);
        // The paper's robot: 12.4 % while holding.
        assert!(relative < 0.05, "{name}: {relative}");
    }
    // Undeclared, the weight shows as a force.
    let path = bench.path("rec/recording.toml");
    let text = fs::read_to_string(&path).unwrap();
    let without = text.replace("payload_g = [[0.0, 0.0], [3.0, 5.0]]", "payload_g = 0.0");
    assert_ne!(text, without);
    fs::write(&path, without).unwrap();
    let v = bench.validation(&[]);
    for name in ["hold", "released"] {
        let z = phase(&v, name, "z_rmse_mN");
        assert!((z - weight_mn).abs() < 2.0, "{name}: {z} mN");
        assert!(phase(&v, name, "z_max_mN") < 0.0, "it pulls down");
    }
}

#[test]
fn instruments_are_what_the_flags_say() {
    let bench = Bench::new();
    let drive = [
        "--drive",
        "staircase:peak_V=3000,steps=2,hold_s=0.5,ramp_s=0.1,repeats=1",
        "--flip-every",
        "1",
    ];
    let more = [
        "--clock-offset",
        "-0.25",
        "--stated-offset",
        "estimate",
        "--quantum",
        "5",
        "--rate",
        "50",
        "--hold-previous",
        "--id",
        "a/b",
    ];
    bench.simulate(&[&drive[..], &more[..]].concat());
    let text = bench.read("rec/recording.toml");
    assert_says(
        &text,
        &[
            "id = \"a/b\"",
            "hold = \"previous\"",
            "offset_s = \"estimate\"",
        ],
    );
    let volts = bench.table("rec/voltage.csv", 1);
    assert_eq!(volts[0][0], -0.25);
    assert!(volts.iter().any(|r| r[1] > 2.9) && volts.iter().any(|r| r[1] < -1.4));
    for row in &volts {
        let steps = row[1] * 1e3 / 5.0;
        assert!((steps - steps.round()).abs() < 1e-6, "{row:?}");
    }
    assert!(
        bench
            .read("rec/motion.csv")
            .starts_with("Trajectories\r\n50\r\n")
    );
    assert_eq!(bench.table("rec/motion.csv", 5).len(), 101);
    let out = bench.done(&["import", "rec", "-o", "imp", "--json"]);
    assert_says(&out, &["a/b"]);
}

#[test]
fn what_cannot_be_simulated_is_said_with_place_values_and_remedy() {
    let bench = Bench::new();
    let row = |t: f64, x: f64, z: f64| format!("{t},{x},0,{z}\n");
    let mut far = String::from("time_s,x_mm,y_mm,z_mm\n");
    for i in 0..=100 {
        far += &row(f64::from(i) * 0.05, f64::from(i), -50.0);
    }
    fs::write(bench.path("far.csv"), &far).unwrap();
    let text = bench.refused(&["--path", "far.csv"]);
    assert_says(
        &text,
        &[
            "far.csv",
            " s",
            "out of reach",
            "chain",
            "must lie within",
            "outside the workspace",
            "where the nearest pose within reach is",
            "nearer to the axis",
            " mm ",
            "keep the path",
        ],
    );
    let text = bench.refused(&["--drive", CIRCLE, "--limit", "3000"]);
    assert_says(
        &text,
        &[
            "chain 1",
            "above the limit of 3000.000 V",
            "raise the limit",
        ],
    );
    let text = bench.refused(&[
        "--drive",
        "sine:peak_V=4000,hz=1",
        "--limit",
        "3000",
        "--duration",
        "3",
    ]);
    assert_says(&text, &["above the limit of 3000.000 V"]);
    let text = bench.refused(&["--drive", CIRCLE, "--payload", "200"]);
    assert_says(
        &text,
        &[
            "no stable rest",
            "200.000 g",
            "only up to",
            "lower the payload",
        ],
    );
    let text = bench.refused(&["--drive", "circle:radius_mm=5,height_mm=-30"]);
    assert_says(
        &text,
        &[
            "no voltage of chain 1 holds",
            "phi^2 would be -",
            "lower the payload",
        ],
    );
    let text = bench.refused(&["--drive", "sine:peak_V=9500,hz=0.33"]);
    assert_says(&text, &["snaps through", "lower the voltages"]);
    let text = bench.refused(&["--drive", CIRCLE, "--gap", "60:1"]);
    assert_says(&text, &["gap from 60 s for 1 s", "recording of"]);
    fs::write(bench.path("back.csv"), far.replace("\n0.5,", "\n0.4,")).unwrap();
    let text = bench.refused(&["--path", "back.csv"]);
    assert_says(&text, &["back.csv", "0.4 s", "0.45 s", "must rise"]);
    fs::write(bench.path("names.csv"), far.replace("x_mm", "xx")).unwrap();
    assert_says(
        &bench.refused(&["--path", "names.csv"]),
        &["names.csv", "x_mm", "xx"],
    );
    let usage = |more: &[&str]| {
        let base = ["simulate", "--rig", RIG, "--params", "p.toml"];
        let out = bench.run(&[&base[..], more].concat());
        assert_eq!(out.status.code(), Some(2), "{more:?}");
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    assert_says(
        &usage(&["--drive", "sin:hz=1"]),
        &["`sin`", "nearest is `sine`", "circle"],
    );
    assert_says(
        &usage(&["--drive", "sine:peakV=1,hz=1"]),
        &["`peakV`", "nearest is `peak_V`"],
    );
    assert_says(&usage(&["--drive", "sine:peak_V=1"]), &["sine needs hz"]);
    assert_says(
        &usage(&["--drive", CIRCLE, "--voltage", "v.csv"]),
        &["cannot be used with"],
    );
    usage(&[]);
}
