//! `simulate`, `predict motion` and what `validate` says of path, force and stroke, as a user runs them.

use std::fs;
use std::path::PathBuf;
use std::process::Output;

use assert_cmd::cargo::CommandCargoExt;
use rayon::prelude::*;
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

/// `[[effect]]` as a parameter file has it, of `ID:NAME=VALUE,...[@ACTUATOR]`.
fn table_of(text: &str) -> String {
    let (text, on) = text.split_once('@').unwrap_or((text, "1, 2, 3"));
    let (id, list) = text.split_once(':').unwrap();
    let mut out = format!("[[effect]]\nid = \"{id}\"\nactuators = [{on}]\n");
    for pair in list.split(',') {
        let (name, value) = pair.split_once('=').unwrap();
        let value = match (value.contains('/'), value.parse::<f64>()) {
            (true, _) => format!("[{}]", value.replace('/', ", ")),
            (_, Ok(number)) => format!("{number:?}"),
            _ => format!("\"{value}\""),
        };
        out += &format!("{name} = {value}\n");
    }
    out
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
    let v = bench.validation(&["--params", "stiff.toml", "--compare", "paper"]);
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
    // The report shows both, beside the paper where that is asked for, words before sections.
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
    assert!(report.find("path off by").unwrap() < report.find("<nav").unwrap());
    // Against the plan: the simulated robot followed it, so the noise is left again, with any parameters.
    let v = bench.validation(&["--path", "rec/planned.csv"]);
    let path = &v["recordings"][0]["path"];
    assert_eq!(path["basis"], "planned");
    assert!(path["rmse_mm"][0].as_f64().unwrap() < 0.035);
    // No paper where nobody asks for it.
    assert!(!bench.read("val/report.html").contains("the paper"));
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
    let text = bench.refused(&["--drive", CIRCLE, "--payload", "20"]);
    assert_says(
        &text,
        &[
            "at 0.1",
            "no voltage of chain 1 holds the path",
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

/// Every cause of the catalogue at a moderate size, as `--effect` takes it; V rms that are allowed with it;
/// and from which voltage on the command can be told from the film's voltage (a dead band hides what lies
/// below it, a slew limit what is steeper).
const EFFECTS: [(&str, f64, f64); 31] = [
    ("series_resistance:resistance=1e7", 2.0, 1e3),
    ("leakage:loss_fraction=0.05", 2.0, 1e3),
    ("amplifier_gain:gain_error=0.05,offset=60", 2.0, 1e3),
    ("amplifier_deadband:threshold=1500", 3.0, 1.8e3),
    ("amplifier_saturation:ceiling=3700", 3.0, 1e3),
    ("slew_limit:rate_up=6000,rate_down=4000", 5.0, f64::INFINITY),
    ("permittivity_stretch:slope=0.1", 2.0, 1e3),
    (
        "dielectric_relaxation:fraction=0.08,time_constant=0.4",
        2.0,
        1e3,
    ),
    ("electrode_failure:fraction=0.2,time=2.005@2", 5.0, 1e3),
    ("electrode_stiffness:modulus=5e4", 2.0, 1e3),
    ("hinge_stiffness:stiffness=0.05,rest_angle=2.3", 2.0, 1e3),
    ("mullins_softening:softening=0.1,energy_scale=4e4", 2.0, 1e3),
    ("slow_creep:modulus=5e4,time_constant=1100", 2.0, 1e3),
    ("loss_of_tension:threshold=0.9", 5.0, 1e3),
    ("actuator_asymmetry:thickness_factor=1.05@2", 2.0, 1e3),
    (
        "temperature_drift:relative_change=0.5,time_constant=20",
        2.0,
        1e3,
    ),
    ("joint_friction:torque=1e-4", 5.0, 1e3),
    ("joint_damping:coefficient=1e-4", 2.0, 1e3),
    ("end_stop:theta_stop=4.1,stiffness=0.05", 5.0, 1e3),
    ("actuator_mass:first_moment=2e-5@2", 2.0, 1e3),
    ("link_length_error:link=q,relative_error=5e-3", 2.0, 1e3),
    ("payload_change:mass=1e-3,time=2.005", 5.0, 1e3),
    ("time_offset:offset=0.02", 2.0, 1e3),
    ("clock_skew:skew=3e-3", 2.0, 1e3),
    ("frame_tilt:rotation=0.01/-0.02/0.03", 2.0, 1e3),
    ("marker_offset:offset=5e-4/-3e-4/4e-4", 2.0, 1e3),
    ("mocap_lag:delay=0.02", 2.0, 1e3),
    ("x_space_charge:fraction=0.1,time_constant=5", 2.0, 1e3),
    ("x_electrode_viscosity:viscosity=2e3", 2.0, 1e3),
    ("x_nonlinear_flow:modulus=1e5,time_constant=0.5", 2.0, 1e3),
    ("x_backlash:stiffness=0.02,play=0.02", 5.0, 1e3),
];

#[test]
fn every_cause_is_simulated_and_understood_again() {
    for effect in deacal::effects::CATALOGUE {
        let head = format!("{}:", effect.id());
        assert!(EFFECTS.iter().any(|e| e.0.starts_with(&head)), "{head}");
    }
    let bench = Bench::new();
    let drive = "multisine:peak_V=4000/3600/3200,hz=0.31/0.7/1.3";
    let complaints: Vec<String> = EFFECTS
        .par_iter()
        .filter_map(|&(effect, allowed, floor)| {
            let id = effect.split_once(':').unwrap().0;
            let (rec, with) = (format!("rec-{id}"), format!("{id}.toml"));
            fs::write(bench.path(&with), film(1.0) + &table_of(effect)).unwrap();
            let said = bench.done(&[
                "simulate", "--rig", RIG, "--params", "p.toml", "--effect", effect, "--drive", drive,
                "--duration", "4", "-o", &rec, "--json",
            ]);
            let said: Value = serde_json::from_str(&said).unwrap();
            assert_eq!(said["effects"][0]["effect"], id);
            assert_eq!(said["effects"][0]["from"], "--effect");
            // Error at the film, with the cause and without; the motion that the file with the cause
            // predicts.
            let out = bench.done(&[
                "validate", &rec, "--params", &with, "--params", "p.toml", "-o", &format!("val-{id}"),
                "--json",
            ]);
            let v: Value = serde_json::from_str(&out).unwrap();
            let rmse = |v: &Value| v["recordings"][0]["rmse_V"].as_f64().unwrap();
            let (own, plain) = (rmse(&v), rmse(&v["compared"][0]));
            let path = (0..3).fold(0.0_f64, |m, k| {
                m.max(v["recordings"][0]["path"]["rmse_mm"][k].as_f64().unwrap())
            });
            // The command that the motion asks for.
            let phi = format!("{id}.csv");
            bench.done(&[
                "predict", "voltage", &rec, "--params", &with, "-o", &phi, "-q",
            ]);
            let applied = bench.table(&format!("{rec}/voltage.csv"), 1);
            let (mut sum, mut count) = (0.0, 0);
            let predicted = bench.table(&phi, 1);
            for row in &predicted[30..predicted.len() - 30] {
                let t = match id {
                    "time_offset" => row[0] + 0.02,
                    "clock_skew" => row[0] * 1.003,
                    _ => row[0],
                };
                let place = t * 1000.0;
                let (i, f) = (place.floor() as usize, place.fract());
                for k in 1..=3 {
                    let want = 1e3 * (applied[i][k] + f * (applied[i + 1][k] - applied[i][k]));
                    if want > floor && !row[k].is_nan() {
                        sum += (row[k] - want).powi(2);
                        count += 1;
                    }
                }
            }
            let command = (sum / f64::from(count.max(1))).sqrt();
            println!("{id:22} {own:6.3} V with, {plain:7.1} V without; command {command:6.3} V; path {path:.5} mm");
            let good = own < allowed
                && command < allowed
                && plain > 3.0 * own.max(1.0)
                && path < 2e-3
                && (count > 300 || floor.is_infinite());
            (!good).then(|| {
                format!("{effect}: {own} V with it, {plain} V without, command {command} V ({count}), path {path} mm")
            })
        })
        .collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn causes_of_file_and_command_line_act_together() {
    let bench = Bench::new();
    let all = [
        "amplifier_gain:gain_error=-0.04@1",
        "series_resistance:resistance=8e6",
        "permittivity_stretch:slope=0.1",
        "electrode_failure:fraction=0.1,time=1@3",
        "temperature_drift:relative_change=0.05,early_change=0.03",
        "mullins_softening:softening=0.1",
        "link_length_error:link=n0,relative_error=4e-3@2",
        "link_length_error:link=q,relative_error=-3e-3",
        "payload_change:mass=5e-4,time=1.5",
        "clock_skew:skew=1e-3",
        "marker_offset:offset=[2e-4,0,-1e-4]",
    ];
    let tables = |list: &[&str]| -> String {
        let plain = |t: &&str| table_of(&t.replace("[2e-4,0,-1e-4]", "2e-4/0/-1e-4"));
        film(1.0) + &list.iter().map(plain).collect::<String>()
    };
    fs::write(bench.path("all.toml"), tables(&all)).unwrap();
    fs::write(bench.path("some.toml"), tables(&all[..4])).unwrap();
    let base = [
        "simulate",
        "--rig",
        RIG,
        "--drive",
        "sine:peak_V=4000/3000/3500,hz=0.7",
        "--duration",
        "4",
    ];
    let simulate = |params: &str, effects: &[&str], out: &str| {
        let mut words: Vec<&str> = base.to_vec();
        words.extend(["--params", params, "-o", out, "--json"]);
        for e in effects {
            words.extend(["--effect", e]);
        }
        serde_json::from_str::<Value>(&bench.done(&words)).unwrap()
    };
    let mixed = simulate("some.toml", &all[4..], "rec");
    let whole = simulate("all.toml", &[], "rec2");
    assert_eq!(bench.read("rec/motion.csv"), bench.read("rec2/motion.csv"));
    // What acted is said, with the values that were not stated.
    let said = mixed["effects"].as_array().unwrap();
    assert_eq!(said.len(), all.len());
    assert_eq!(said[0]["from"], "some.toml");
    assert_eq!(said[0]["actuators"], serde_json::json!([1]));
    // the recording has the name of its folder
    assert_eq!(said[3]["parameters"]["recording"]["value"], "rec");
    assert_eq!(said[5]["from"], "--effect");
    assert_eq!(said[5]["parameters"]["energy_scale"]["value"], 4e4);
    assert_eq!(said[5]["parameters"]["energy_scale"]["unit"], "J/m^3");
    assert_eq!(said[6]["parameters"]["link"]["value"], "n0");
    let offset = &said[10]["parameters"]["offset"]["value"];
    assert_eq!(*offset, serde_json::json!([2e-4, 0.0, -1e-4]));
    assert!(whole["effects"][10]["from"] == "all.toml");
    // The inverse model with the same file finds its way back, causes on causes included.
    let out = bench.done(&[
        "validate", "rec", "--params", "all.toml", "--params", "p.toml", "-o", "val", "--json",
    ]);
    let v: Value = serde_json::from_str(&out).unwrap();
    let own = v["recordings"][0]["rmse_V"].as_f64().unwrap();
    let plain = v["compared"][0]["recordings"][0]["rmse_V"]
        .as_f64()
        .unwrap();
    println!("eleven causes together: {own:.3} V with them, {plain:.1} V without");
    assert!(own < 5.0 && plain > 50.0, "{own} V, {plain} V");
    // What cannot be.
    let refused = |params: &str, effects: &[&str], status: i32| {
        let mut words: Vec<&str> = base.to_vec();
        words.extend(["--params", params, "-o", "no"]);
        for e in effects {
            words.extend(["--effect", e]);
        }
        let out = bench.run(&words);
        assert_eq!(out.status.code(), Some(status), "{effects:?}");
        assert!(!bench.path("no").exists());
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    let text = refused("some.toml", &["series_resistance:resistance=1e6"], 1);
    assert_says(
        &text,
        &["series_resistance", "some.toml", "--effect", "one of them"],
    );
    let twice = ["leakage:loss_fraction=0.1", "leakage:loss_fraction=0.2@2"];
    assert_says(&refused("p.toml", &twice, 1), &["leakage", "twice", "@1"]);
    for (wrong, words) in [
        (
            "series_resistence:resistance=1",
            &["series_resistence", "did you mean", "series_resistance"][..],
        ),
        (
            "series_resistance:resistence=1",
            &["resistence", "did you mean", "resistance"],
        ),
        (
            "link_length_error:link=l_chh,relative_error=0.1",
            &["l_chh", "did you mean", "l_ch"],
        ),
        (
            "series_resistance:resistance=-1",
            &["-1", "ohm", "from 0 up"],
        ),
        ("marker_offset:offset=1e-3", &["1 value", "3 in m"]),
        ("mocap_lag:delay=0.1@1", &["all three"]),
        ("mocap_lag", &["ID:NAME=VALUE"]),
    ] {
        assert_says(&refused("p.toml", &[wrong], 2), words);
    }
}

#[test]
fn a_series_reaches_into_a_simulated_recording() {
    let bench = Bench::new();
    let simulate = |id: &str, effect: &str, out: &str| {
        bench.done(&[
            "simulate",
            "--rig",
            RIG,
            "--params",
            "p.toml",
            "--effect",
            effect,
            "--drive",
            "sine:peak_V=4000,hz=0.7",
            "--duration",
            "2",
            "--id",
            id,
            "-o",
            out,
            "-q",
        ]);
        bench.table(&format!("{out}/motion.csv"), 5)
    };
    let plain = simulate("s/03-a", "leakage:loss_fraction=0", "plain");
    // Contact was lost before this recording, in it, or will be later.
    let before = "electrode_failure:fraction=0.3,time=1,recording=s/01-x";
    let within = "electrode_failure:fraction=0.3,time=1,recording=s/03-a";
    let later = "electrode_failure:fraction=0.3,time=1,recording=s/04-x";
    let (a, b, c) = (
        simulate("s/03-a", before, "before"),
        simulate("s/03-a", within, "within"),
        simulate("s/03-a", later, "later"),
    );
    assert_eq!(plain, c);
    let moved = |x: &[Vec<f64>], range: std::ops::Range<usize>| {
        range.fold(0.0_f64, |m, i| m.max((x[i][4] - plain[i][4]).abs()))
    };
    assert!(moved(&a, 0..100) > 0.5, "lost before");
    assert!(moved(&b, 0..100) <= 1e-3, "not yet");
    assert!(moved(&b, 101..200) > 0.5, "lost within");
}

const SAMPLE_RIG: &str = "[rig]\nid = \"hanging\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\n\
    margin_mm = 3.0\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n";

/// A bench with a hanging sample, and the film of a third of a robot's stiffness in `s.toml`.
fn sample_bench() -> Bench {
    let bench = Bench::new();
    fs::write(bench.path("hanging.toml"), SAMPLE_RIG).unwrap();
    let mu = [4.4e5, 3e4, 2.5e4, 2e4, 2e4, 1.5e4, 1.5e4];
    let film =
        format!("[film]\nmu_Pa = {mu:?}\nT_s = [0.02, 0.12, 0.7, 4.0, 25.0, 150.0]\nJ = 80.0\n");
    fs::write(bench.path("s.toml"), film).unwrap();
    bench
}

const SAMPLE: [&str; 5] = ["simulate", "--rig", "hanging.toml", "--params", "s.toml"];

#[test]
fn a_hanging_sample_is_simulated_predicted_and_validated() {
    let bench = sample_bench();
    let resistance = "series_resistance:resistance=5e7";
    let aged = bench.read("s.toml") + &table_of(resistance);
    fs::write(bench.path("aged.toml"), aged).unwrap();
    let drive = [
        "--drive",
        "sine:peak_V=5000,hz=0.333",
        "--duration",
        "9",
        "-o",
        "rec",
    ];
    let more = [
        "--effect",
        resistance,
        "--effect",
        "electrode_stiffness:modulus=1e5",
    ];
    let out = bench.done(&[&SAMPLE[..], &drive, &more, &["--json"]].concat());
    let said: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(said["kind"], "film-sample");
    assert_eq!(said["n_frames"], 901);
    assert_eq!(said["effects"][1]["effect"], "electrode_stiffness");
    let stiff = said["stroke_mm"].as_f64().unwrap();
    // The same without the stiff electrode, from the parameter file alone.
    let params = [
        "simulate",
        "--rig",
        "hanging.toml",
        "--params",
        "aged.toml",
        "--json",
    ];
    let out = bench.done(&[&params[..], &drive].concat());
    let said: Value = serde_json::from_str(&out).unwrap();
    let stroke = said["stroke_mm"].as_f64().unwrap();
    assert!(
        (1.0..5.0).contains(&stroke) && stroke > 1.05 * stiff,
        "{stroke} {stiff}"
    );
    assert_says(
        &bench.read("rec/recording.toml"),
        &["kind = \"film-sample\"", "channels = [\"phi_kV\"]"],
    );
    assert!(bench.read("rec/voltage.csv").starts_with("time_s,phi_kV\n"));
    // Voltages: the command comes back through the resistance.
    bench.done(&[
        "predict",
        "voltage",
        "rec",
        "--params",
        "aged.toml",
        "-o",
        "phi.csv",
        "-q",
    ]);
    assert!(bench.read("phi.csv").starts_with("time_s,phi_V"));
    let applied = bench.table("rec/voltage.csv", 1);
    let (mut sum, mut count) = (0.0, 0);
    let predicted = bench.table("phi.csv", 1);
    assert_eq!(predicted.len(), 901);
    for row in &predicted[30..predicted.len() - 30] {
        let want = applied[(row[0] * 1000.0).round() as usize][1] * 1e3;
        if want > 1000.0 {
            sum += (row[1] - want).powi(2);
            count += 1;
        }
    }
    let command = (sum / f64::from(count)).sqrt();
    println!("hanging sample, round trip through files: {command:.3} V over {count} samples");
    assert!(count > 400 && command < 2.0, "{command} V, {count}");
    // Motion.
    bench.done(&[
        "predict",
        "motion",
        "rec",
        "--params",
        "aged.toml",
        "-o",
        "m.csv",
        "-q",
    ]);
    assert!(bench.read("m.csv").starts_with("time_s,x_mm"));
    let captured = bench.table("rec/motion.csv", 5);
    let rest = captured[0][4];
    let worst = bench
        .table("m.csv", 1)
        .iter()
        .zip(&captured)
        .fold(0.0_f64, |m, (p, c)| m.max((p[1] - (rest - c[4])).abs()));
    println!("predicted against simulated x: at most {worst:.5} mm");
    assert!(worst < 2e-3, "{worst} mm");
    // Validation: right parameters leave nothing, others do.
    let out = bench.done(&[
        "validate",
        "rec",
        "--params",
        "aged.toml",
        "--params",
        "s.toml",
        "-o",
        "val",
        "--json",
    ]);
    let v: Value = serde_json::from_str(&out).unwrap();
    let rmse = |v: &Value| v["recordings"][0]["rmse_V"].as_f64().unwrap();
    let (own, other) = (rmse(&v), rmse(&v["compared"][0]));
    println!("validation of a sample: {own:.3} V, without the resistance {other:.1} V");
    assert!(own < 2.0 && other > 50.0, "{own} V, {other} V");
    // A table of voltages, a second of rest before them, with noise, a seed and a payload; the same seed
    // gives the same bytes.
    let mut rows = String::from("time_s,phi_V\n");
    for i in 0..1000 {
        rows += &format!("{:.3},0\n", f64::from(i) * 1e-3);
    }
    for row in &applied {
        rows += &format!("{:.3},{:.1}\n", 1.0 + row[0], 1e3 * row[1]);
    }
    fs::write(bench.path("v.csv"), rows).unwrap();
    let table = ["--voltage", "v.csv", "--noise", "0.03", "--payload", "5"];
    let noisy = |seed: &str| {
        bench.done(&[&SAMPLE[..], &table, &["--seed", seed, "-o", "noisy", "-q"]].concat());
        bench.read("noisy/motion.csv")
    };
    let (a, b, c) = (noisy("3"), noisy("3"), noisy("4"));
    assert!(a == b && a != c);
    assert_says(&bench.read("noisy/recording.toml"), &["payload_g = 5.0"]);
    let out = bench.done(&[
        "validate", "noisy", "--params", "s.toml", "-o", "val", "--json",
    ]);
    let v: Value = serde_json::from_str(&out).unwrap();
    let floor = v["recordings"][0]["noise_floor_V"].as_f64().unwrap();
    println!("with noise: {:.1} V, floor {floor:.1} V", rmse(&v));
    assert!((0.8..1.25).contains(&(rmse(&v) / floor)));
}

#[test]
fn simulated_samples_are_fitted_and_age() {
    let bench = sample_bench();
    // A branch slower than the recording would pass for the equilibrium spring.
    let film =
        "[film]\nmu_Pa = [4.4e5, 3e4, 2.5e4, 2e4, 2e4]\nT_s = [0.02, 0.12, 0.7, 4.0]\nJ = 80.0\n";
    fs::write(bench.path("s.toml"), film).unwrap();
    let mut folders = Vec::new();
    for (electrode, day, lost) in [("A", 1, 0.0), ("A", 7, 0.3), ("B", 1, 0.0), ("B", 7, 0.0)] {
        let out = format!("rec/{electrode}{day}");
        let lost = format!("electrode_failure:fraction={lost:?},time=0");
        let day = day.to_string();
        let id = format!("{electrode}{day}");
        bench.done(
            &[
                &SAMPLE[..],
                &[
                    "--drive",
                    "sine:peak_V=5000,hz=0.3333333333",
                    "--duration",
                    "27",
                ],
                &["--noise", "0.03", "--electrode", electrode, "--day", &day],
                &[
                    "--id",
                    &id,
                    "--seed",
                    &folders.len().to_string(),
                    "--effect",
                    &lost,
                ],
                &["-o", &out, "-q"],
            ]
            .concat(),
        );
        folders.push(out);
    }
    let fit: Value = serde_json::from_str(&bench.done(&[
        "fit",
        "sample",
        &folders[0],
        "--branches",
        "4",
        "-o",
        "fit",
        "--json",
    ]))
    .unwrap();
    let mu = &fit["parameters"]["mu_1"];
    let (value, error) = (
        mu["value"].as_f64().unwrap(),
        mu["std_error"].as_f64().unwrap(),
    );
    println!("mu_1 {value:.0} +- {error:.0} Pa, true 440000");
    assert!(
        error < 5e3 && (value - 4.4e5).abs() < 3.5 * error,
        "{value} {error}"
    );
    let words: Vec<&str> = ["ageing"]
        .into_iter()
        .chain(folders.iter().map(String::as_str))
        .chain(["-o", "age", "--json"])
        .collect();
    let age: Value = serde_json::from_str(&bench.done(&words)).unwrap();
    let change = |name: &str| {
        let days = age["electrodes"][name].as_array().unwrap();
        days[1]["change_percent"]["value"].as_f64().unwrap()
    };
    println!("stroke: A {:.1} %, B {:.1} %", change("A"), change("B"));
    assert!((-36.0..-24.0).contains(&change("A")), "{}", change("A"));
    assert!(change("B").abs() < 2.0, "{}", change("B"));
}

#[test]
fn a_sample_that_cannot_be_simulated_is_refused_in_words() {
    let bench = sample_bench();
    let refused = |more: &[&str]| {
        let out = bench.run(&[&SAMPLE[..], &["-o", "no"], more].concat());
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(1), "{more:?}: {text}");
        assert_eq!(text.trim_end().lines().count(), 1, "one line, not:\n{text}");
        assert!(!bench.path("no").exists());
        text
    };
    let sine = |peak: u32| format!("sine:peak_V={peak},hz=0.333");
    let drive = |peak: u32| {
        [
            "--drive".to_owned(),
            sine(peak),
            "--duration".into(),
            "4".into(),
        ]
    };
    let with = |peak: u32, more: &[&str]| {
        let drive = drive(peak);
        let drive: Vec<&str> = drive.iter().map(String::as_str).collect();
        refused(&[&drive[..], more].concat())
    };
    assert_says(
        &with(5000, &["--limit", "4000"]),
        &["above the limit of 4000.000 V", "lower the drive"],
    );
    assert_says(&with(14000, &[]), &["sample", "lower the voltage"]);
    assert_says(
        &with(5000, &["--payload", "0,2:5"]),
        &["mass on a hanging sample", "without steps"],
    );
    assert_says(
        &refused(&["--drive", CIRCLE]),
        &["hanging.toml", "follows no path"],
    );
    let text = with(5000, &["--effect", "mocap_lag:delay=0.02"]);
    assert_says(&text, &["mocap_lag", "hanging sample", "series_resistance"]);
    let text = with(5000, &["--effect", "electrode_failure:fraction=0.2,time=3"]);
    assert_says(&text, &["before its first sample", "time = 0.0"]);
    fs::write(bench.path("v.csv"), "time_s,volts\n0,0\n1,1\n").unwrap();
    assert_says(
        &refused(&["--voltage", "v.csv"]),
        &["v.csv", "phi_kV", "volts"],
    );
    fs::write(bench.path("v.csv"), "time_s,phi_V\n0,0\n1,\n2,5\n").unwrap();
    assert_says(&refused(&["--voltage", "v.csv"]), &["v.csv:3", "its value"]);
}
