//! Hanging film samples: the production scheme against the adaptive simulator, its derivatives, fits that
//! find what was simulated.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use assert_cmd::cargo::CommandCargoExt;

use deacal::calibration::{SampleRequest, StartOutcome, calibrate_samples, validate_samples};
use deacal::dataset::HangingDataset;
use deacal::film::Film;
use deacal::model::{Electrode, HangingSample};
use deacal::recording::{Recording, Rig};
use deacal::residual::{
    Bounce, SampleKnob, Steps, command_for_v, film_voltage_v, inverse_sample, run_sample,
};
use deacal::simulate::write::{Capture, Noise, RecordingText, VoltageLog, sample_recording};
use deacal::simulate::{Hold, SampleOptions, Sampled, Smooth, sample_motion};

fn sample(electrode: Electrode) -> HangingSample {
    HangingSample {
        width_m: 0.045,
        length_m: 0.06,
        margin_m: 0.003,
        l3_m: 1e-4,
        films: 1.0,
        eps_r: 2.8,
        mass_kg: 0.05,
        electrode,
    }
}

fn film() -> Film {
    Film {
        mu_pa: vec![4.4e5, 3e4, 2.5e4, 2e4, 2e4, 1.5e4, 1.5e4],
        relaxation_time_s: vec![0.02, 0.12, 0.7, 4.0, 25.0, 150.0],
        locking: 80.0,
    }
}

/// The paper's drive: from rest at 1 s, 2.5 kV + 2.5 kV at 1/3 Hz.
fn drive(t: f64) -> f64 {
    let w = 2.0 * std::f64::consts::PI / 3.0;
    2500.0 * (1.0 - (w * (t - 1.0).clamp(0.0, 24.0)).cos())
}

const AGED: Electrode = Electrode {
    modulus_pa: 3e5,
    resistance_ohm: 1.5e8,
    active_fraction: 0.9,
};

#[test]
fn the_scheme_agrees_with_the_simulator() {
    for (electrode, h, limit) in [
        (Electrode::IDEAL, 0.02, 1.0),
        (AGED, 0.02, 1.0),
        (Electrode::IDEAL, 0.05, 1.0),
        (AGED, 0.05, 1.0),
    ] {
        let sample = sample(electrode);
        let options = SampleOptions {
            sample_step_s: h,
            duration_s: 27.0,
            ..SampleOptions::default()
        };
        let truth = sample_motion(&sample, &film(), &Smooth(|t| [drive(t); 3]), &options).unwrap();
        let command: Vec<f64> = (0..truth.x_m.len()).map(|i| drive(i as f64 * h)).collect();
        let at = std::time::Instant::now();
        let steps = Steps::of(&sample, &film(), 0.0, h);
        let run = run_sample(&sample, &film(), &command, &steps, &[]).unwrap();
        let took = at.elapsed();
        let worst = run
            .x_m
            .iter()
            .zip(&truth.x_m)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        eprintln!(
            "h {h}: worst {:.3e} mm, {took:?}; rest {:e}",
            worst * 1e3,
            run.rest_length_m - truth.rest_length_m
        );
        assert!((run.rest_length_m - truth.rest_length_m).abs() < 1e-12);
        assert!(worst * 1e6 < limit);
    }
}

/// Up within 0.2 s and down again, half a second later.
fn kick(t: f64) -> f64 {
    let rise = |t: f64| 0.5 - 0.5 * (std::f64::consts::PI * (t / 0.2).clamp(0.0, 1.0)).cos();
    3000.0 * (rise(t - 0.2) - rise(t - 0.9))
}

#[test]
fn the_bounce_of_the_mass_is_followed() {
    let (sample, film) = (sample(Electrode::IDEAL), lively());
    let worst = |h: f64, bounce: Bounce| {
        let options = SampleOptions {
            sample_step_s: h,
            duration_s: 3.0,
            ..SampleOptions::default()
        };
        let truth = sample_motion(&sample, &film, &Smooth(|t| [kick(t); 3]), &options).unwrap();
        let command: Vec<f64> = (0..truth.x_m.len()).map(|i| kick(i as f64 * h)).collect();
        let steps = Steps {
            start_s: 0.0,
            step_s: h,
            bounce,
        };
        let run = run_sample(&sample, &film, &command, &steps, &[]).unwrap();
        let off = run.x_m.iter().zip(&truth.x_m).map(|(a, b)| (a - b).abs());
        1e6 * off.fold(0.0, f64::max)
    };
    let [long, short] = [0.01, 0.005].map(|h| worst(h, Bounce::Followed));
    let [damped, damped_short] = [0.01, 0.005].map(|h| worst(h, Bounce::Damped));
    eprintln!("followed {long:.3} {short:.4} um, damped {damped:.1} {damped_short:.1} um");
    // 16 for the mass alone; the strains of the branches are of second order
    assert!(short * 8.0 < long && long < 4.0);
    assert!(30.0 * long < damped);
    // where steps are too long for it, it is taken away instead
    let of = |h: f64| Steps::of(&sample, &film, 0.0, h).bounce;
    assert_eq!((of(0.01), of(0.1)), (Bounce::Followed, Bounce::Damped));
}

/// A film that damps the mass little.
fn lively() -> Film {
    Film {
        mu_pa: vec![4.4e5, 8e3, 6e3],
        relaxation_time_s: vec![0.3, 5.0],
        locking: 80.0,
    }
}

#[test]
fn derivatives_are_those_of_the_scheme() {
    for h in [0.04, 0.01] {
        derivatives_at(h);
    }
}

fn derivatives_at(h: f64) {
    let command: Vec<f64> = (0..400).map(|i| drive(i as f64 * h)).collect();
    let (film, sample) = (film(), sample(AGED));
    let knobs = [
        SampleKnob::Modulus(0),
        SampleKnob::Modulus(3),
        SampleKnob::LogTime(2),
        SampleKnob::ElectrodeModulus,
        SampleKnob::Resistance,
        SampleKnob::ActiveFraction,
        SampleKnob::Mass,
    ];
    let steps = Steps::of(&sample, &film, 0.0, h);
    let at = |sample: &HangingSample, film: &Film| {
        let run = run_sample(sample, film, &command, &steps, &[]).unwrap();
        (run.x_m, run.rest_length_m)
    };
    let run = run_sample(&sample, &film, &command, &steps, &knobs).unwrap();
    for (k, knob) in knobs.iter().enumerate() {
        let moved = |sign: f64| {
            let (mut s, mut f) = (sample, film.clone());
            let step = match *knob {
                SampleKnob::Modulus(n) => {
                    let d = 3e-3 * f.mu_pa[n];
                    f.mu_pa[n] += sign * d;
                    d
                }
                SampleKnob::LogTime(n) => {
                    f.relaxation_time_s[n] *= (sign * 3e-3).exp();
                    3e-3
                }
                SampleKnob::ElectrodeModulus => {
                    s.electrode.modulus_pa += sign * 900.0;
                    900.0
                }
                SampleKnob::Resistance => {
                    s.electrode.resistance_ohm += sign * 4e5;
                    4e5
                }
                SampleKnob::ActiveFraction => {
                    s.electrode.active_fraction += sign * 3e-3;
                    3e-3
                }
                SampleKnob::Mass => {
                    s.mass_kg += sign * 1e-4;
                    1e-4
                }
            };
            (at(&s, &f), step)
        };
        let ((up, rest_up), d) = moved(1.0);
        let ((down, rest_down), _) = moved(-1.0);
        let size = run.columns[k].iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        for i in 0..up.len() {
            let slope = (up[i] - down[i]) / (2.0 * d);
            assert!(
                (slope - run.columns[k][i]).abs() < 5e-4 * size,
                "{knob:?} at {i}: {slope} {}",
                run.columns[k][i]
            );
        }
        let slope = (rest_up - rest_down) / (2.0 * d);
        assert!((slope - run.rest_columns[k]).abs() <= 1e-4 * slope.abs().max(1e-12 / d));
    }
}

const RIG: &str = "[rig]\nid = \"hanging\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\nmargin_mm = 3.0\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n";

/// A recording of a sample as instruments would write it, in its own folder.
fn record(dir: &Path, id: &str, electrode: Electrode, noise_m: f64, seed: u64) {
    let samples: Vec<[f64; 3]> = (0..27_001).map(|i| [drive(i as f64 * 1e-3); 3]).collect();
    let voltage = Sampled::new(0.0, 1e-3, samples, Hold::Linear).unwrap();
    let capture = Capture {
        end_effector: "Sample:End".into(),
        base: "Sample:Frame".into(),
        noise: Noise {
            white_m: noise_m,
            ..Noise::default()
        },
        gaps: vec![(700, 12)],
        seed,
        ..Capture::default()
    };
    let text = RecordingText {
        id: id.into(),
        rig: "../rig.toml".into(),
        labels: vec![("electrode".into(), "E".into()), ("day".into(), "1".into())],
        ..RecordingText::default()
    };
    let files = sample_recording(
        &sample(electrode),
        &film(),
        &voltage,
        0.1,
        &capture,
        &text,
        &VoltageLog::default(),
    )
    .unwrap();
    fs::create_dir_all(dir.join(id)).unwrap();
    fs::write(dir.join("rig.toml"), RIG).unwrap();
    fs::write(dir.join(id).join("recording.toml"), files.recording_toml).unwrap();
    fs::write(dir.join(id).join("motion.csv"), files.motion_csv).unwrap();
    fs::write(dir.join(id).join("voltage.csv"), files.voltage_csv).unwrap();
}

fn open(dir: &Path, id: &str) -> (HangingDataset, HangingSample) {
    let recording = Recording::open(&dir.join(id)).unwrap();
    let dataset = HangingDataset::from_recording(&recording).unwrap();
    let Some(Rig::FilmSample(rig)) = &recording.rig else {
        panic!("a sample's rig");
    };
    let sample = HangingSample::from_rig(rig, None, dataset.payload_kg).unwrap();
    (dataset, sample)
}

#[test]
fn a_film_is_found_again() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path(), "one", Electrode::IDEAL, 3e-5, 1);
    record(dir.path(), "two", Electrode::IDEAL, 3e-5, 2);
    let (one, sample) = open(dir.path(), "one");
    let (two, _) = open(dir.path(), "two");
    assert!((one.noise_m / 3e-5 - 1.0).abs() < 0.1, "{}", one.noise_m);
    assert_eq!(one.gaps(), [(700, 12)]);
    let request = SampleRequest::new(6);
    let outcome =
        calibrate_samples(&[&one], &[sample], &request, &|_| ControlFlow::Continue(())).unwrap();
    assert!(outcome.converged, "{}", outcome.reason);
    assert!(
        (outcome.weighted_mean_square - 1.0).abs() < 0.25,
        "{}",
        outcome.weighted_mean_square
    );
    // The stiffness at the drive's rate is fixed, how it falls to the branches is not.
    let at = |f: &Film| -> f64 {
        let w = 2.0 * std::f64::consts::PI / 3.0;
        let branches = f.mu_pa[1..].iter().zip(&f.relaxation_time_s);
        f.mu_pa[0]
            + branches
                .map(|(m, t)| m * (w * t).powi(2) / (1.0 + (w * t).powi(2)))
                .sum::<f64>()
    };
    let ratio = at(&outcome.film) / at(&film());
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
    let first = &outcome.estimates.iter().find(|e| e.name == "mu_1").unwrap();
    // What relaxes slower than the recording counts as equilibrium.
    let slow: f64 = film().mu_pa[5..].iter().sum();
    assert!(
        first.ci95[0] < film().mu_pa[0] + slow && film().mu_pa[0] < first.ci95[1],
        "{:?}",
        first.ci95
    );
    assert!(outcome.total.rmse_v < 1.3 * outcome.total.noise_floor_v);
    let scale = outcome.scale.unwrap();
    assert!(
        (scale.by_permittivity + scale.by_mass - 1.0).abs() < 0.02,
        "{scale:?}"
    );

    // What was not fitted to is predicted to the noise, and another electrode is not.
    let held = validate_samples(&[&two], &[sample], &outcome.film).unwrap();
    assert!(held.recordings[0].rmse_m < 1.1 * held.recordings[0].noise_rmse_m);
    assert!((held.recordings[0].stroke_m[0] - held.recordings[0].stroke_m[1]).abs() < 3e-5);
    let aged = HangingSample {
        electrode: AGED,
        ..sample
    };
    let off = validate_samples(&[&two], &[aged], &outcome.film).unwrap();
    assert!(off.recordings[0].rmse_m > 5.0 * off.recordings[0].noise_rmse_m);
}

/// What is lost of a hanging sample, at either end or for seconds inside, is bridged by what the model makes
/// of the voltage: the rest fits as before, and so do the voltages that it needs.
#[test]
fn a_gap_of_a_hanging_sample_is_bridged() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path(), "one", Electrode::IDEAL, 3e-5, 1);
    let (whole, sample) = open(dir.path(), "one");
    let error = |d: &HangingDataset| {
        let held = validate_samples(&[d], &[sample], &film()).unwrap();
        let r = &held.recordings[0];
        (r.rmse_m / r.noise_rmse_m, held.total)
    };
    let (_, before) = error(&whole);
    for lost_s in [0.0..2.0, 9.0..9.4, 8.0..14.0, 24.0..30.0] {
        let mut d = whole.clone();
        for i in 0..d.samples() {
            if lost_s.contains(&d.time_s(i)) {
                d.x_m[i] = f64::NAN;
            }
        }
        let (ratio, total) = error(&d);
        println!(
            "{lost_s:?}: {ratio:.3}, {:.2} V of {:.2} V, {:.2} V before",
            total.rmse_v, total.noise_floor_v, before.rmse_v
        );
        assert!((0.9..1.1).contains(&ratio), "{lost_s:?}: {ratio}");
        assert!(total.samples < before.samples && total.samples > before.samples / 2);
        assert!(
            total.rmse_v < 1.4 * total.noise_floor_v && total.rmse_v < 1.5 * before.rmse_v,
            "{lost_s:?}: {total:?}"
        );
        let request = SampleRequest {
            starts: 1,
            start: Some(film()),
            ..SampleRequest::new(6)
        };
        let fitted =
            calibrate_samples(&[&d], &[sample], &request, &|_| ControlFlow::Continue(())).unwrap();
        let e = fitted.estimates.iter().find(|e| e.name == "mu_1").unwrap();
        let slow: f64 = film().mu_pa[5..].iter().sum();
        assert!(
            e.value + 3.0 * e.std_error > film().mu_pa[0]
                && e.value - 3.0 * e.std_error < film().mu_pa[0] + slow,
            "{lost_s:?}: {e:?}"
        );
        assert!(
            (fitted.weighted_mean_square - 1.0).abs() < 0.25,
            "{lost_s:?}: {}",
            fitted.weighted_mean_square
        );
    }
}

/// A log that ends early leaves the model off by far more than the noise. Starts that fit worse than the best
/// are left behind, and said to be; no start spends what a search for the last digit would.
#[test]
fn starts_that_crawl_are_left_behind_and_said_to_be() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path(), "one", Electrode::IDEAL, 3e-5, 1);
    let (mut d, sample) = open(dir.path(), "one");
    let time: Vec<f64> = (0..=1000).map(|i| 0.01 * f64::from(i)).collect();
    let phi = time.iter().map(|&t| drive(t)).collect();
    d.voltage = deacal::dataset::Voltage::new(time, vec![phi], false);
    let request = SampleRequest {
        starts: 5,
        ..SampleRequest::new(6)
    };
    let outcome =
        calibrate_samples(&[&d], &[sample], &request, &|_| ControlFlow::Continue(())).unwrap();
    let r = &outcome.recordings[0];
    println!(
        "{} evaluations, steps of {} s",
        outcome.evaluations, r.step_s
    );
    for s in &outcome.starts {
        println!("{} {:.6e} {} {}", s.origin, s.cost, s.evaluations, s.ended);
    }
    assert!(
        r.rmse_m > 20.0 * r.noise_rmse_m,
        "{} {}",
        r.rmse_m,
        r.noise_rmse_m
    );
    assert!(outcome.evaluations < 1000, "{}", outcome.evaluations);
    let left = |s: &&StartOutcome| s.ended.starts_with("left behind");
    assert!(outcome.starts.iter().any(|s| left(&s)));
    let best = &outcome.starts[0];
    assert!(!left(&best), "{}", best.ended);
    for s in outcome.starts.iter().filter(left) {
        assert!(s.cost > best.cost, "{}: {}", s.origin, s.cost);
    }
}

#[test]
fn inverse_and_forward_dynamics_are_inverse() {
    let h = 0.005;
    for electrode in [Electrode::IDEAL, AGED] {
        let sample = sample(electrode);
        let options = SampleOptions {
            sample_step_s: h,
            duration_s: 12.0,
            ..SampleOptions::default()
        };
        let truth = sample_motion(&sample, &film(), &Smooth(|t| [drive(t); 3]), &options).unwrap();
        let back = inverse_sample(
            &sample,
            &film(),
            &truth.x_m,
            &truth.acceleration_m_s2,
            h,
            0.0,
        )
        .unwrap();
        let command: Vec<f64> = (0..truth.x_m.len()).map(|i| drive(i as f64 * h)).collect();
        let phi: Vec<f64> = back.squared_v2.iter().map(|s| s.max(0.0).sqrt()).collect();
        let needed = command_for_v(&sample, &phi, &back.area, h);
        let made = film_voltage_v(&sample, &command, &back.area, h);
        for i in (0..phi.len() - 1).filter(|&i| truth.phi_v[i] > 500.0) {
            assert!(
                (phi[i] - truth.phi_v[i]).abs() < 0.5,
                "{i}: {} {}",
                phi[i],
                truth.phi_v[i]
            );
            assert!(
                (made[i] - truth.phi_v[i]).abs() < 0.5,
                "{i}: {} {}",
                made[i],
                truth.phi_v[i]
            );
            assert!(
                (needed[i] - command[i]).abs() < 2.0,
                "{i}: {} {}",
                needed[i],
                command[i]
            );
        }
    }
}

#[test]
fn the_program_fits_predicts_and_validates_samples() {
    let dir = tempfile::tempdir().unwrap();
    record(dir.path(), "one", Electrode::IDEAL, 3e-5, 3);
    let run = |arguments: &[&str]| {
        let mut command = std::process::Command::cargo_bin("deacal").unwrap();
        let out = command
            .current_dir(dir.path())
            .args(arguments)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        (
            out.status.code().unwrap(),
            String::from_utf8(out.stdout).unwrap(),
            text,
        )
    };
    let (code, json, error) = run(&["fit", "sample", "one", "-o", "fit", "--json"]);
    assert_eq!(code, 0, "{error}");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["job"], "sample");
    assert_eq!(json["rmse_unit"], "V");
    assert!(json["parameters"]["mu_1"]["ci95"].is_array());
    for file in ["parameters.toml", "fit.json", "report.html", "plan.toml"] {
        assert!(dir.path().join("fit").join(file).is_file(), "{file}");
    }
    let (code, motion, error) = run(&[
        "predict",
        "motion",
        "one",
        "--params",
        "fit/parameters.toml",
    ]);
    assert_eq!(code, 0, "{error}");
    let mut lines = motion.lines();
    assert_eq!(lines.next(), Some("time_s,x_mm,flag"));
    assert_eq!(lines.next(), Some("0.000000,0.000000,"));
    assert_eq!(lines.count(), 2700);
    let (code, voltage, error) = run(&[
        "predict",
        "voltage",
        "one",
        "--params",
        "fit/parameters.toml",
    ]);
    assert_eq!(code, 0, "{error}");
    assert!(voltage.starts_with("time_s,phi_V,phi_sd_V,flag\n"));
    assert!(voltage.contains(",,gap\n"));
    let (code, json, error) = run(&[
        "validate",
        "one",
        "--params",
        "fit/parameters.toml",
        "-o",
        "v",
        "--json",
    ]);
    assert_eq!(code, 0, "{error}");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let stroke = &json["recordings"][0]["stroke_mm"];
    let (a, b) = (
        stroke["recorded"].as_f64().unwrap(),
        stroke["predicted"].as_f64().unwrap(),
    );
    assert!((a - b).abs() < 0.05, "{a} {b}");
    let (code, _, error) = run(&["predict", "force", "one", "--params", "fit/parameters.toml"]);
    assert_eq!(code, 1);
    assert!(error.contains("film-sample"), "{error}");
    let text = fs::read_to_string(dir.path().join("one/recording.toml")).unwrap();
    fs::write(
        dir.path().join("one/recording.toml"),
        text.replace("relaxed", "virgin"),
    )
    .unwrap();
    let (code, _, error) = run(&["fit", "sample", "one", "-o", "never"]);
    assert_eq!(code, 1);
    assert!(error.contains("let it hang"), "{error}");
    assert!(!dir.path().join("never").exists());
}
