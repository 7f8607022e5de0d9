//! Files about recordings: CSV, MCAP, JSON and plans.

use crate::common;

use std::io::Cursor;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use common::check;
use deacal::calibration::*;
use deacal::dataset::{Dataset, Parts, Plan, SmoothingPlan, Voltage};
use deacal::film::{Film, InitialState};
use deacal::model::{ForearmTorque, Parameters};
use deacal::recording::{ReadOptions, Recording, survey_file};
use deacal::report::json::*;
use deacal::report::parameter_file::ParameterFile;
use deacal::report::plan_file::{parse_plan, plan_to_toml};
use deacal::report::provenance::{FileSum, Provenance};
use deacal::report::{csv, mcap};
use deacal::validation::{
    ForceErrors as ForceFigures, PathErrors as PathFigures, Phase, RecordingCheck, Validation,
};
use serde_json::Value;

/// A recording at 100 Hz with a short and a long gap, and voltages that end early.
fn dataset(frames: usize) -> Dataset {
    let time = |i: usize| i as f64 * 0.01;
    let mut state = 1u64;
    let mut noise = move || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        6e-5 * ((state >> 33) as f64 / (1u64 << 31) as f64 - 0.5)
    };
    let mut measured_m: Vec<[f64; 3]> = (0..frames)
        .map(|i| {
            let t = time(i);
            [
                5e-3 * (2.0 * t).sin() + noise(),
                3e-3 * (1.5 * t).cos() + noise(),
                -0.08 + 4e-3 * (2.1 * t).sin() + noise(),
            ]
        })
        .collect();
    measured_m[100..103].fill([f64::NAN; 3]);
    measured_m[frames - 150..frames - 20].fill([f64::NAN; 3]);
    let voltage_s: Vec<f64> = (0..frames * 10 - 100).map(|i| i as f64 * 1e-3).collect();
    let channel = |k: f64| -> Vec<f64> {
        let wave = |t: &f64| 2500.0 + 2000.0 * (2.0 * t + k).sin();
        voltage_s.iter().map(wave).collect()
    };
    let voltage = Voltage::new(
        voltage_s.clone(),
        vec![channel(0.0), channel(1.0), channel(2.0)],
        false,
    );
    Dataset::new(
        Parts {
            id: "day/one".into(),
            step_s: 0.01,
            start_s: -0.5,
            measured_m,
            payload_kg: vec![2e-3; frames],
            monitor: Some(voltage.clone()),
            voltage,
            offset_s: Some(0.5),
            initial: InitialState::Relaxed,
        },
        None,
    )
    .unwrap()
}

fn recording_outcome(d: &Dataset) -> RecordingOutcome {
    let n = d.samples();
    let command_v: Vec<[f64; 3]> = (0..n)
        .map(|i| [0, 1, 2].map(|k| d.command_v(k, i, d.offset_s)))
        .collect();
    let mut squared: Vec<[f64; 3]> = command_v
        .iter()
        .map(|c| c.map(|v| (v + 10.0).powi(2)))
        .collect();
    squared[20] = [-1.0, 4e6, -2.0];
    squared[30] = [f64::NAN; 3];
    let chain = ChainError {
        rmse_v: 10.0,
        max_error_v: 12.0,
        samples: 100,
        rmse_all_v: 11.0,
        samples_all: 120,
        noise_floor_v: 9.0,
        negative: 1,
    };
    RecordingOutcome {
        id: d.id.clone(),
        chains: [chain; 3],
        total: chain,
        offset_s: 0.5,
        offset_std_error_s: None,
        plan: d.plan.clone(),
        time_s: (0..n).map(|i| d.time_s(i)).collect(),
        position_mm: vec![[0.0; 3]; n],
        predicted_v: squared
            .iter()
            .map(|p| p.map(|v| if v < 0.0 { 0.0 } else { v.sqrt() }))
            .collect(),
        command_v,
        predicted_squared_v2: squared,
        sd_v: vec![[5.0; 3]; n],
        monitor_v: None,
        counts: vec![true; n],
        gap: (0..n).map(|i| !d.captured(i)).collect(),
        unreachable: vec![(
            30,
            "pose (0, 0, 0) mm is out of reach: chain 2, elbow (bicep and forearm): cos is 2"
                .into(),
        )],
        contributions_n_m: vec![],
        swing_deg: vec![[0.0; 3]; n],
        gaps: d.gaps(),
        cycles_s: vec![],
        notes: d.notes.clone(),
    }
}

fn outcome(d: &Dataset) -> Outcome {
    let estimate = |name: &str, value: f64, fixed: bool| Estimate {
        name: name.into(),
        meaning: "m".into(),
        unit: "Pa".into(),
        value,
        std_error: if fixed { f64::NAN } else { 0.1 * value },
        ci95: [0.8 * value, 1.2 * value],
        at_bound: (name == "J").then_some(AtBound::Upper),
        identifiable: !fixed,
        fixed,
        says: "s".into(),
    };
    let forearm = ForearmTorque::zero();
    let mut estimates = vec![
        estimate("T_1", 0.3, false),
        estimate("J", 80.0, false),
        estimate("mu_1", 1e5, false),
        estimate("mu_2", 2e4, false),
    ];
    estimates.extend((-3..=3).map(|i| estimate(&format!("torque_{}deg", 10 * i), 0.0, true)));
    let r = recording_outcome(d);
    Outcome {
        job: "film",
        parameters: Parameters {
            film: Film {
                mu_pa: vec![1e5, 2e4],
                relaxation_time_s: vec![0.3],
                locking: 80.0,
            },
            forearm,
        },
        eps_r: 2.8,
        estimates,
        correlation: (
            vec!["T_1".into(), "J".into()],
            vec![vec![1.0, f64::NAN], vec![f64::NAN, 1.0]],
        ),
        weak_directions: vec![WeakDirection {
            relative_sd: f64::INFINITY,
            parts: vec![("mu_2".into(), 0.9), ("J".into(), -0.3)],
            says: "w".into(),
        }],
        total: r.total,
        recordings: vec![r],
        starts: vec![],
        converged: true,
        reason: "r".into(),
        evaluations: 7,
        failed_evaluations: 0,
        weighted_mean_square: f64::NAN,
        noise_mean_square: 1.0,
        torque_band: vec![],
        swing_range_deg: [f64::INFINITY, f64::NEG_INFINITY],
        worst: vec![],
        verdict: "v".into(),
        remarks: vec![],
    }
}

fn rows(bytes: Vec<u8>) -> (Vec<String>, Vec<Vec<String>>) {
    let text = String::from_utf8(bytes).unwrap();
    let mut lines = text
        .lines()
        .map(|l| l.split(',').map(str::to_owned).collect::<Vec<_>>());
    let header = lines.next().unwrap();
    let rows: Vec<_> = lines.collect();
    assert!(rows.iter().all(|r| r.len() == header.len()));
    (header, rows)
}

#[test]
fn every_frame_has_its_row_and_a_missing_one_its_reason() {
    let d = dataset(1000);
    let r = recording_outcome(&d);
    let mut out = Vec::new();
    let flags = csv::missing(&r);
    csv::write_flagged(&mut out, &csv::predicted_voltage(&r, None, &flags), &flags).unwrap();
    let (header, rows) = rows(out);
    assert_eq!(
        header.join(","),
        "time_s,phi1_V,phi2_V,phi3_V,phi1_sd_V,phi2_sd_V,phi3_sd_V,flag"
    );
    assert_eq!(rows.len(), 1000);
    assert_eq!(
        rows[20].join(","),
        "-0.300000,,2000.0000,,,5.0000,,phi^2 < 0: chain 1 and 3"
    );
    assert_eq!(
        rows[30].join(","),
        "-0.200000,,,,,,,out of reach: chain 2 elbow"
    );
    assert_eq!(rows[101].join(","), "0.510000,,,,,,,gap");
    assert_eq!(rows[5][7], "");
    let json = to_text(&PredictionJson::new("a", None, &csv::missing(&r)));
    assert!(json.contains("\"gap\": 133"), "{json}");
    assert!(json.contains("\"phi^2 < 0\": 1") && json.contains("\"out of reach\": 1"));
    for (i, row) in rows.iter().enumerate().filter(|(_, r)| r[7].is_empty()) {
        for k in 0..3 {
            let v: f64 = row[1 + k].parse().unwrap();
            assert!((v - r.predicted_v[i][k]).abs() <= 0.51e-4);
        }
    }
}

#[test]
fn forces_and_motions_have_their_columns() {
    let flags = [None, Some(csv::Missing::Gap)];
    let mut out = Vec::new();
    let force = [[1e-3, 0.0, -2e-9]; 2];
    let columns = csv::predicted_force(&[0.0, 0.01], &force, &flags);
    csv::write_flagged(&mut out, &columns, &flags).unwrap();
    assert_eq!(
        String::from_utf8(out).unwrap(),
        "time_s,Fx_N,Fy_N,Fz_N,flag\n0.000000,0.001000000,0.000000000,-0.000000002,\n0.010000,,,,gap\n"
    );
    let mut out = Vec::new();
    let columns = csv::predicted_motion(&[0.0], &[[1e-3, 0.0, -0.08]], &flags[..1]);
    csv::write_flagged(&mut out, &columns, &flags[..1]).unwrap();
    assert_eq!(
        String::from_utf8(out).unwrap(),
        "time_s,x_mm,y_mm,z_mm,flag\n0.000000,1.000000,0.000000,-80.000000,\n"
    );
}

#[test]
fn the_aligned_recording_keeps_every_frame() {
    let d = dataset(1000);
    let mut out = Vec::new();
    csv::aligned(&mut out, &d, d.offset_s).unwrap();
    let (header, rows) = rows(out);
    assert_eq!(rows.len(), 1000);
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    let flag = column("flag");
    assert_eq!(rows[101][flag], "gap bridged");
    assert_eq!(rows[101][column("x_raw_mm")], "");
    assert_ne!(rows[101][column("x_mm")], "");
    assert_eq!(rows[900][flag], "gap");
    assert_eq!(rows[900][column("x_mm")], "");
    assert_eq!(rows[999][flag], "no voltage");
    assert_eq!(rows[999][column("phi1_V")], "");
    let x: f64 = rows[500][column("x_mm")].parse().unwrap();
    assert!((x - d.axes[0].position[500] * 1e3).abs() < 1e-6);
    let v: f64 = rows[500][column("vx_mm_s")].parse().unwrap();
    assert!((v - d.axes[0].velocity[500] * 1e3).abs() < 1e-5);
    assert_eq!(
        rows[500][column("phi2_monitor_V")],
        rows[500][column("phi2_V")]
    );
    assert_eq!(rows[500][column("payload_g")], "2.0000");
}

#[test]
fn a_minute_is_written_in_milliseconds() {
    let d = dataset(6000);
    let r = recording_outcome(&d);
    let mut out = Vec::with_capacity(4 << 20);
    let started = Instant::now();
    csv::aligned(&mut out, &d, 0.5).unwrap();
    let aligned = started.elapsed();
    let started = Instant::now();
    let flags = csv::missing(&r);
    csv::write_flagged(&mut out, &csv::predicted_voltage(&r, None, &flags), &flags).unwrap();
    let predicted = started.elapsed();
    let started = Instant::now();
    let mut file = Cursor::new(Vec::new());
    mcap::aligned(&mut file, &d, Some(&r), &Provenance::new("t")).unwrap();
    let container = started.elapsed();
    println!(
        "60 s at 100 Hz: aligned CSV {aligned:.1?}, voltage CSV {predicted:.1?}, MCAP {container:.1?} ({} bytes)",
        file.get_ref().len()
    );
    // generous: shared machines stall
    assert!(aligned.as_millis() < 500 && container.as_millis() < 2000);
}

#[test]
fn the_mcap_reads_back() {
    let d = dataset(1000);
    let r = recording_outcome(&d);
    let write = || {
        let mut file = Cursor::new(Vec::new());
        let mut provenance = Provenance::new("deacal import day/one");
        provenance.rig = None;
        mcap::aligned(&mut file, &d, Some(&r), &provenance).unwrap();
        file.into_inner()
    };
    let bytes = write();
    assert_eq!(bytes, write(), "the same input gives the same bytes");
    let mut counts = std::collections::BTreeMap::new();
    let mut last = 0;
    for message in ::mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= last);
        last = message.log_time;
        assert_eq!(message.channel.message_encoding, "json");
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!(schema.encoding, "jsonschema");
        let _: Value = serde_json::from_slice(&schema.data).unwrap();
        let body: Value = serde_json::from_slice(&message.data).unwrap();
        *counts.entry(message.channel.topic.clone()).or_insert(0) += 1;
        // the clock begins at -0.5 s: one second is added
        let frame = ((message.log_time as f64 * 1e-9 - 0.5) * 100.0).round() as usize;
        match message.channel.topic.as_str() {
            "/end_effector/position" => {
                assert_eq!(schema.name, "foxglove.PoseInFrame");
                let z = body["pose"]["position"]["z"].as_f64().unwrap();
                assert!((z - d.axes[2].position[frame]).abs() < 1e-9);
                let sec = body["timestamp"]["sec"].as_u64().unwrap();
                let nsec = body["timestamp"]["nsec"].as_u64().unwrap();
                assert_eq!(sec * 1_000_000_000 + nsec, message.log_time);
            }
            "/voltage/predicted" => {
                if frame == 20 {
                    assert!(body.get("chain_1").is_none() && body["chain_2"] == 2000.0);
                }
                assert!(frame != 30 && d.captured(frame));
            }
            "/voltage/residual" if frame == 500 => {
                assert!((body["chain_1"].as_f64().unwrap() - 10.0).abs() < 1e-3);
            }
            _ => {}
        }
    }
    assert_eq!(counts["/end_effector/measured"], 1000 - 133);
    assert_eq!(counts["/end_effector/position"], 1000 - 130);
    assert_eq!(counts["/voltage/predicted"], 1000 - 134);
    assert_eq!(counts["/log"], 3);

    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    std::fs::write(&path, &bytes).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scripts/read_mcap.py");
    let python = std::env::var("DEACAL_PYTHON").unwrap_or_else(|_| "python3".into());
    let output = match Command::new(&python).arg(script).arg(&path).output() {
        Ok(output) if output.status.code() != Some(77) => output,
        _ => {
            eprintln!(
                "skipped: {python} with the package mcap is not there (DEACAL_PYTHON names one)"
            );
            return;
        }
    };
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let read: Value = serde_json::from_slice(&output.stdout).unwrap();
    for (topic, count) in &counts {
        assert_eq!(read["topics"][topic]["count"], *count, "{topic}");
    }
    assert_eq!(read["metadata"][0]["recording"], "day/one");
    assert_eq!(read["metadata"][0]["time_shift_s"], "1");
}

#[test]
fn csv_mat_npz_and_mcap_hold_the_same_values() {
    use deacal::report::arrays::{ArrayFormat, Arrays};
    let d = dataset(400);
    let outcome = outcome(&d);
    let r = &outcome.recordings[0];
    let arrays = Arrays::of(&d, Some(r));
    let names: Vec<&str> = arrays.columns().iter().map(|c| c.0.as_str()).collect();
    for name in [
        "time_s",
        "z_mm",
        "phi3_V",
        "phi1_predicted_V",
        "phi2_residual_V",
    ] {
        assert!(names.contains(&name), "{name}");
    }
    let dir = tempfile::tempdir().unwrap();
    for (extension, format) in [
        ("csv", ArrayFormat::Csv),
        ("mat", ArrayFormat::Mat),
        ("npz", ArrayFormat::Npz),
    ] {
        assert_eq!(ArrayFormat::of_extension(extension), Some(format));
        let mut bytes = Vec::new();
        arrays.write(format, &mut bytes).unwrap();
        let mut again = Vec::new();
        arrays.write(format, &mut again).unwrap();
        assert_eq!(bytes, again);
        std::fs::write(dir.path().join("r").with_extension(extension), bytes).unwrap();
    }
    let mut bytes = std::io::Cursor::new(Vec::new());
    let provenance = Provenance::new("deacal predict voltage day/one");
    deacal::report::mcap::aligned(&mut bytes, &d, Some(r), &provenance).unwrap();
    std::fs::write(dir.path().join("r.mcap"), bytes.into_inner()).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scripts/read_arrays.py");
    let python = std::env::var("DEACAL_PYTHON").unwrap_or_else(|_| "python3".into());
    let output = match Command::new(&python)
        .arg(script)
        .arg(dir.path())
        .arg("r")
        .output()
    {
        Ok(output) if output.status.code() != Some(77) => output,
        _ => {
            eprintln!(
                "skipped: {python} with mcap, numpy and scipy is not there (DEACAL_PYTHON names one)"
            );
            return;
        }
    };
    let said = String::from_utf8_lossy(&output.stdout);
    eprintln!("{said}");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(said.contains("values agree"), "{said}");
}

#[test]
fn fit_json_has_the_contracts_keys_and_no_nan() {
    let d = dataset(1000);
    let fit = FitJson::new(&outcome(&d), Provenance::new("deacal fit film day/one"));
    let text = to_text(&fit);
    check("fit", &text);
    assert_eq!(serde_json::from_str::<FitJson>(&text).unwrap(), fit);
    let json: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["rmse_V"], 10.0);
    assert_eq!(json["max_error_V"], 12.0);
    assert_eq!(json["n_samples"], 100);
    assert_eq!(json["rmse_basis"], "above_1kV");
    assert_eq!(json["rmse_all_V"], 11.0);
    assert_eq!(json["noise_floor_V"], 9.0);
    assert_eq!(json["recordings"][0]["id"], "day/one");
    assert_eq!(json["recordings"][0]["rmse_V"], 10.0);
    assert_eq!(json["recordings"][0]["chains"].as_array().unwrap().len(), 3);
    assert_eq!(json["recordings"][0]["gaps"][0]["frames"], 3);
    let j = &json["parameters"]["J"];
    assert_eq!(j["value"], 80.0);
    assert_eq!(
        (j["at_bound"].as_bool(), j["bound"].as_str()),
        (Some(true), Some("upper"))
    );
    assert_eq!(j["ci95"].as_array().unwrap().len(), 2);
    let held = &json["parameters"]["torque_0deg"];
    assert!(held["std_error"].is_null() && held["ci95"].is_null() && held["fixed"] == true);
    assert!(json["correlation"]["rows"][0][1].is_null());
    assert!(json["weak_directions"][0]["relative_sd"].is_null());
    assert_eq!(json["converged"], true);
    assert_eq!(json["plan"][0]["recording"], "day/one");
    assert!(text.contains("\"swing_range_deg\": null"));
    // parameters stay in their order
    let order: Vec<&String> = json["parameters"].as_object().unwrap().keys().collect();
    assert_eq!(order[..4], ["T_1", "J", "mu_1", "mu_2"]);
    // a list of numbers is one line
    assert!(text.contains("\"ci95\": [64.0, 96.0]"), "{text}");
}

#[test]
fn validation_json_is_read_back() {
    let d = dataset(1000);
    let params = FileSum {
        role: "params".into(),
        file: "parameters.toml".into(),
        sha256: "ab".into(),
    };
    let check_of = |path, predicted_mm: f64| RecordingCheck {
        id: "day/one".into(),
        time_s: Vec::new(),
        measured_mm: Vec::new(),
        predicted_mm: Vec::new(),
        path,
        stroke_mm: [8.0, predicted_mm],
        force_error_n: Vec::new(),
        load_n: Vec::new(),
        phase: Vec::new(),
        force: vec![ForceFigures {
            phase: Phase::Holding,
            rmse_n: 0.005,
            max_n: 0.02,
            z_rmse_n: 0.003,
            z_max_n: -0.02,
            xy_rmse_n: 0.004,
            frames: 70,
        }],
        largest_load_n: 0.05,
        remarks: vec!["seen".into()],
    };
    let path = PathFigures {
        planned: false,
        rmse_mm: [0.1, 0.2, 0.3],
        max_mm: [0.3, -0.4, 0.5],
        relative_to_mm: [10.0, 10.0, f64::NAN],
        frames: 90,
    };
    let validation = |path, predicted_mm| Validation {
        outcome: outcome(&d),
        checks: vec![check_of(path, predicted_mm)],
    };
    let first = ModelValidation::new(&validation(Some(path), 7.5), params.clone());
    let second = ModelValidation::new(&validation(None, f64::NAN), params);
    let file = ValidationJson::new(first, vec![second], None, Provenance::new("c"));
    let text = to_text(&file);
    check("validation", &text);
    assert_eq!(serde_json::from_str::<ValidationJson>(&text).unwrap(), file);
    let json: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["rmse_V"], 10.0);
    assert_eq!(json["recordings"][0]["rmse_V"], 10.0);
    assert_eq!(json["recordings"][0]["stroke_mm"]["predicted"], 7.5);
    assert_eq!(json["recordings"][0]["path"]["max_mm"][1], 0.4);
    assert_eq!(json["recordings"][0]["path"]["max_relative"][1], 0.04);
    assert!(json["recordings"][0]["path"]["max_relative"][2].is_null());
    let force = &json["recordings"][0]["force"][0];
    assert_eq!(
        (force["phase"].as_str(), force["z_max_mN"].as_f64()),
        (Some("hold"), Some(-20.0))
    );
    for (key, want) in [("z_rmse_relative", 0.06), ("rmse_relative", 0.1)] {
        assert!((force[key].as_f64().unwrap() - want).abs() < 1e-12, "{key}");
    }
    assert!(json["remarks"].to_string().contains("seen"));
    let second = &json["compared"][0]["recordings"][0];
    assert!(second.get("path").is_none() && second["stroke_mm"]["predicted"].is_null());
    assert_eq!(
        json["compared"][0]["recordings"][0]["chains"][2]["n_samples"],
        100
    );
}

#[test]
fn import_json_says_what_is_there() {
    let dir = Path::new("tests/data/recording/robot");
    let recording = Recording::open(dir).unwrap();
    let mut import = ImportRecording::new(&recording, None);
    import.aligned = Some(AlignedJson::new(&dataset(1000), None));
    let motion = dir.join("motion.csv");
    let survey = survey_file(&motion, None, &ReadOptions::default()).unwrap();
    let mut file = ImportJson {
        recordings: vec![import],
        files: vec![ImportFile::new(&motion, &survey)],
        provenance: Provenance::of("deacal import robot", [&recording]),
    };
    let text = to_text(&file);
    check("import", &text);
    // what only the head of a page says is not in the file
    file.provenance.rig_ids.clear();
    file.provenance.days.clear();
    assert_eq!(serde_json::from_str::<ImportJson>(&text).unwrap(), file);
    let json: Value = serde_json::from_str(&text).unwrap();
    let r = &json["recordings"][0];
    assert_eq!(r["kind"], "robot");
    assert!(r["motion"]["rate_hz"].as_f64().unwrap() > 0.0);
    assert_eq!(r["voltage"]["channels"].as_array().unwrap().len(), 3);
    assert!(r["motion"]["end_effector"]["range"][2][0].is_f64());
    assert_eq!(r["aligned"]["gaps"].as_array().unwrap().len(), 2);
    assert_eq!(r["aligned"]["offset_source"], "stated");
    assert_eq!(r["files"][0]["role"], "manifest");
    assert_eq!(r["files"][0]["sha256"].as_str().unwrap().len(), 64);
    let section = &json["files"][0]["sections"][0];
    assert!(section["rows"].as_u64().unwrap() > 0);
    assert_eq!(json["provenance"]["rig"]["role"], "rig");
}

#[test]
fn plans_read_back_to_the_same_bits() {
    let plan = |id: &str, offset_s| Plan {
        recording: id.into(),
        smoothing: [0.1, 1.0 / 3.0, 12.0]
            .map(|v| SmoothingPlan {
                order: 3,
                cutoff_hz: v * 7.0,
                noise_mm: v * 0.01,
                follows: v < 0.2,
            })
            .to_vec(),
        criterion: "c \"q\"".into(),
        offset_s,
        sync: offset_s.map(|_| deacal::dataset::SyncPlan {
            method: "events".into(),
            offset_std_error_s: Some(1e-4 / 3.0),
            skew_ppm: -12.5,
            skew_std_error_ppm: None,
            middle_s: 30.0,
        }),
        stretches: offset_s.map(|_| deacal::dataset::StretchPlan {
            count: 60,
            length_s: 59.9,
        }),
    };
    let plans = vec![plan("a", None), plan("day/b", Some(-0.1))];
    let text = plan_to_toml(&plans);
    let path = Path::new("plan.toml");
    assert_eq!(parse_plan(path, &text).unwrap(), plans);
    // the plain TOML reader agrees
    let file: deacal::report::plan_file::PlanFile = toml::from_str(&text).unwrap();
    assert_eq!(file.plans, plans);
    check("plan", &to_text(&file));
    let wrong = text.replacen("order = 3", "order = 5", 1);
    let error = parse_plan(path, &wrong).unwrap_err();
    assert!(
        error.to_string().contains("found 5, expected 3 or 4"),
        "{error}"
    );
    assert!(error.line().is_some());
    let twice = parse_plan(path, &text.replace("day/b", "a")).unwrap_err();
    assert!(twice.to_string().contains("there twice"), "{twice}");
}

#[test]
fn an_outcome_becomes_a_parameter_file_with_its_errors() {
    let d = dataset(1000);
    let outcome = outcome(&d);
    let file = ParameterFile::of_outcome(&outcome, Provenance::new("deacal fit film day/one"));
    let text = file.to_toml().unwrap();
    assert!(
        text.contains("mu_Pa_std_error = [10000.0, 2000.0]"),
        "{text}"
    );
    assert!(text.contains("J_ci95 = [64.0, 96.0]"), "{text}");
    assert!(!text.contains("torque_N_m_std_error"), "{text}");
    check("parameters", &to_text(&file.to_json()));
    // the file itself has the same structure
    let table: toml::Value = toml::from_str(&text).unwrap();
    check("parameters", &serde_json::to_string(&table).unwrap());
    let back = ParameterFile::parse(Path::new("p"), &text).unwrap();
    assert_eq!(back.parameters().unwrap(), outcome.parameters);
    assert_eq!(back.eps_r(), Some(2.8));
}
