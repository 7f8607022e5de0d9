//! One coordinate: hinge benches, axes and coupons, from their files to a fit and a diagnosis.

use crate::common;

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

use deacal::calibration::{LineModel, LineRequest, calibrate_lines, predict_line, validate_lines};
use deacal::dataset::line::Line;
use deacal::diagnosis::{Diagnosis, LineEntry, Request, RigKind, Verdict, diagnose_lines};
use deacal::effects::line::{Terms, View, every};
use deacal::effects::{Acting, When};
use deacal::recording::Recording;
use deacal::report::parameter_file::ParameterFile;
use deacal::report::provenance::Provenance;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

/// A recording folder: its manifest and one CSV beside it.
fn line(dir: &Path, id: &str, kind: &str, table: &str, csv: &str) -> Line {
    let own = dir.join(id);
    std::fs::create_dir_all(&own).unwrap();
    std::fs::write(own.join("data.csv"), csv).unwrap();
    let manifest = format!("[recording]\nid = \"{id}\"\nkind = \"{kind}\"\n\n{table}");
    std::fs::write(own.join("recording.toml"), manifest).unwrap();
    Line::from_recording(&Recording::open(&own).unwrap()).unwrap()
}

/// An axis that moves as a sum of sines; the input follows from the balance, exactly, and both are noisy.
struct Slide {
    mass: f64,
    damping: f64,
    stiffness: f64,
    gain: f64,
    cubic: f64,
    amplitude: f64,
    /// How far the input is ahead of the position.
    ahead_s: f64,
    /// Share by which the spring is stiffer 600 s after the series began, where this recording begins.
    warms: f64,
    begins_s: f64,
    seed: u64,
}

const SLIDE: Slide = Slide {
    mass: 2.0,
    damping: 15.0,
    stiffness: 900.0,
    gain: 4.0,
    cubic: 0.0,
    amplitude: 0.02,
    ahead_s: 0.0,
    warms: 0.0,
    begins_s: 0.0,
    seed: 1,
};

impl Slide {
    /// Position, velocity and acceleration.
    fn motion(&self, t: f64) -> [f64; 3] {
        let (mut x, mut v, mut a) = (0.0, 0.0, 0.0);
        for (k, f) in [0.31, 0.83, 1.7, 2.9].iter().enumerate() {
            let w = std::f64::consts::TAU * f;
            let phase = w * t + 1.3 * k as f64 + self.seed as f64;
            let size = self.amplitude / (1.0 + k as f64);
            x += size * phase.sin();
            v += size * w * phase.cos();
            a -= size * w * w * phase.sin();
        }
        [x, v, a]
    }

    fn csv(&self) -> String {
        let mut generator = ChaCha12Rng::seed_from_u64(self.seed);
        let mut out = String::from("t_s,x_m,u_V\n");
        for i in 0..6000 {
            let t = f64::from(i) * 0.005;
            let [x, _, _] = self.motion(t);
            let [ahead, v, a] = self.motion(t + self.ahead_s);
            let warm = 1.0 - (-(self.begins_s + t) / 900.0).exp();
            let warmer = self.warms * warm / (1.0 - (-600.0_f64 / 900.0).exp());
            let force = self.mass * a
                + self.damping * v
                + self.stiffness * (1.0 + warmer) * ahead
                + self.cubic * ahead.powi(3);
            let mut z = || -> f64 { StandardNormal.sample(&mut generator) };
            let (x, u) = (x + 2e-5 * z(), force / self.gain + 0.01 * z());
            writeln!(out, "{t:.4},{x:.8},{u:.6}").unwrap();
        }
        out
    }
}

const BENCH: &str = "[bench]\nfile = \"data.csv\"\nangle = \"angle\"\ntorque = \"torque\"\nunits = { angle = \"rad\", torque = \"N m\" }\n";

const AXIS: &str = "[axis]\nfile = \"data.csv\"\ntime = \"t_s\"\nposition = \"x_m\"\ninput = \"u_V\"\nunits = { time = \"s\", position = \"m\", input = \"V\" }\nmass_kg = \"estimate\"\ndamping = \"estimate\"\nstiffness = \"estimate\"\n";

fn entries<'a>(lines: &[&'a Line]) -> Vec<LineEntry<'a>> {
    let when = |recording| When {
        recording,
        series_s: 0.0,
        start_s: 0.0,
    };
    let numbered = lines.iter().enumerate();
    numbered
        .map(|(i, line)| LineEntry {
            line,
            when: when(i),
        })
        .collect()
}

fn diagnose(train: &[&Line], holdout: &[&Line]) -> Diagnosis {
    let all = entries(&[train, holdout].concat());
    let (train, holdout) = all.split_at(train.len());
    diagnose_lines(train, holdout, &Request::default(), &|_| {}).unwrap()
}

#[test]
fn an_axis_is_found_within_its_intervals() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    let mut inside = 0;
    let mut all = 0;
    for seed in 0..12 {
        let slide = Slide { seed, ..SLIDE };
        let one = line(
            dir.path(),
            &format!("a{seed}"),
            "axis",
            &table,
            &slide.csv(),
        );
        let fit = calibrate_lines(&[one], &LineRequest::default()).unwrap();
        for (name, truth) in [("mass", 2.0), ("damping", 15.0), ("stiffness", 900.0)] {
            let e = fit.estimates.iter().find(|e| e.name == name).unwrap();
            assert!((e.value / truth - 1.0).abs() < 0.01, "{name} {}", e.value);
            all += 1;
            inside += usize::from((e.ci95[0]..=e.ci95[1]).contains(&truth));
        }
        let (rmse, _, _, noise) = fit.total();
        assert!(rmse < 1.3 * noise && rmse > 0.6 * noise, "{rmse} {noise}");
    }
    println!("{inside} of {all} intervals hold");
    // 36 intervals of 95 %: fewer than 30 would happen once in a thousand
    assert!(inside >= 30, "{inside} of {all}");
}

#[test]
fn a_gain_is_found_where_the_mass_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let table =
        AXIS.replace("mass_kg = \"estimate\"", "mass_kg = 2.0") + "input_gain = \"estimate\"\n";
    let one = line(dir.path(), "known", "axis", &table, &SLIDE.csv());
    let fit = calibrate_lines(&[one], &LineRequest::default()).unwrap();
    for (name, truth) in [("gain", 4.0), ("damping", 15.0), ("stiffness", 900.0)] {
        let e = fit.estimates.iter().find(|e| e.name == name).unwrap();
        assert!((e.value / truth - 1.0).abs() < 0.03, "{name} {}", e.value);
        assert!(
            (e.value - truth).abs() < 4.0 * e.std_error,
            "{name}: {} +- {}",
            e.value,
            e.std_error
        );
    }
}

#[test]
fn a_clean_axis_is_adequate_and_a_stiffening_one_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    let make = |id: &str, slide: Slide| line(dir.path(), id, "axis", &table, &slide.csv());
    let other = make("clean-2", Slide { seed: 2, ..SLIDE });
    // nothing is left out of any of eight, so nothing may be named in one
    for seed in 11..19 {
        let clean = make(&format!("clean-{seed}"), Slide { seed, ..SLIDE });
        let d = diagnose(&[&clean], &[&other]);
        assert_eq!(d.verdict, Verdict::Adequate, "{seed}: {}", d.says);
    }
    let clean = make("clean", SLIDE);
    let d = diagnose(&[&clean], &[&other]);
    assert_eq!(d.verdict, Verdict::Adequate, "{}", d.says);
    assert_eq!(
        (d.rig, d.unit.as_str(), d.basis),
        (RigKind::Axis, "V", "all")
    );
    // the cubic force at the largest excursion is a fifth of the linear one
    let stiff = Slide {
        cubic: 1.2e5,
        seed: 3,
        ..SLIDE
    };
    let a = make("stiff", stiff);
    let b = make(
        "stiff-2",
        Slide {
            cubic: 1.2e5,
            seed: 4,
            amplitude: 0.03,
            ..SLIDE
        },
    );
    let d = diagnose(&[&a], &[&b]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    assert_eq!(d.candidates[0].acting.effect.id(), "x_nonlinear_stiffness");
    let h = d.holdout.unwrap();
    assert!(
        h.after_v < 1.3 * h.noise_floor_v && h.before_v > 3.0 * h.noise_floor_v,
        "{h:?}"
    );
}

#[test]
fn a_hinge_with_friction_is_named_and_its_rail_left_out() {
    let dir = tempfile::tempdir().unwrap();
    let csv = |friction: f64, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("angle,torque\n");
        let (mut z, mut before) = (0.0, 0.0_f64);
        for i in 0..400 {
            let x = 0.45 * (std::f64::consts::TAU * f64::from(i) / 130.0).sin();
            let d = x - before;
            before = x;
            z += (d.signum() - z) * (1.0 - (-d.abs() / 0.01).exp());
            let noise: f64 = StandardNormal.sample(&mut generator);
            let torque = 0.02 * x + 0.05 * x.powi(3) + friction * z + 2e-5 * noise;
            // the angle's sensor ends at 0.44
            writeln!(out, "{:.6},{torque:.8}", x.min(0.44)).unwrap();
        }
        out
    };
    let hinge = line(dir.path(), "rough", "hinge-bench", BENCH, &csv(1e-3, 1));
    assert!(
        hinge.notes.iter().any(|n| n.contains("rail")),
        "{:?}",
        hinge.notes
    );
    let again = line(dir.path(), "rough-2", "hinge-bench", BENCH, &csv(1e-3, 2));
    let d = diagnose(&[&hinge], &[&again]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    assert_eq!(d.candidates[0].acting.effect.id(), "joint_friction");
    let force = &d.candidates[0].values[0];
    assert_eq!(force.unit, "N m");
    assert!((force.value / 1e-3 - 1.0).abs() < 0.1, "{force:?}");
    let fit = calibrate_lines(&[again], &LineRequest::default()).unwrap();
    let curve = fit.curve.unwrap();
    assert!((curve.torque_n_m_at(0.3) - (0.006 + 0.05 * 0.027)).abs() < 5e-4);
}

#[test]
fn what_is_held_out_beyond_the_fitted_angles_does_not_count() {
    let dir = tempfile::tempdir().unwrap();
    let hinge = |id: &str, middle: f64, reach: f64, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("angle,torque\n");
        let (mut z, mut before) = (0.0, 0.0_f64);
        for i in 0..400 {
            let x = middle + reach * (std::f64::consts::TAU * f64::from(i) / 130.0).sin();
            let d = x - before;
            before = x;
            z += (d.signum() - z) * (1.0 - (-d.abs() / 0.01).exp());
            let noise: f64 = StandardNormal.sample(&mut generator);
            let torque = 0.02 * x + 0.05 * x.powi(3) + 1e-3 * z + 2e-5 * noise;
            writeln!(out, "{x:.6},{torque:.8}").unwrap();
        }
        line(dir.path(), id, "hinge-bench", BENCH, &out)
    };
    let fitted = hinge("fitted", 0.0, 0.3, 3);
    for (id, middle, reach, says) in [
        ("wider", 0.0, 0.6, "do not count"),
        ("elsewhere", 0.7, 0.3, "nothing was held out"),
    ] {
        let other = hinge(id, middle, reach, 4);
        let d = diagnose(&[&fitted], &[&other]);
        assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
        assert_eq!(d.candidates[0].acting.effect.id(), "joint_friction");
        let said = d.remarks.iter().find(|r| r.contains("beyond")).unwrap();
        assert!(said.contains(says), "{said}");
        assert_eq!(d.holdout.is_some(), id == "wider");
        if let Some(h) = &d.holdout {
            assert!(h.after_v < 1.3 * h.noise_floor_v, "{h:?}");
        }
    }
}

/// The places of a coupon are nodes of a grid, of which there are other numbers than of samples.
#[test]
fn the_last_quarter_of_a_coupon_is_held_out() {
    let dir = tempfile::tempdir().unwrap();
    let table = "[coupon]\nfile = \"data.csv\"\ntime = \"t\"\nstretch = \"l\"\nnominal_stress = \"s\"\nmode = \"uniaxial\"\nunits = { time = \"s\", nominal_stress = \"Pa\" }\n";
    let mut generator = ChaCha12Rng::seed_from_u64(5);
    let mut out = String::from("t,l,s\n");
    for i in (0..600).filter(|i| i % 7 != 3) {
        let t = 0.1 * f64::from(i);
        let l = 1.2 + 0.15 * (0.4 * t).sin();
        let noise: f64 = StandardNormal.sample(&mut generator);
        let stress = 4e4 * (l - 1.0 / (l * l)) + 20.0 * noise;
        writeln!(out, "{t:.2},{l:.6},{stress:.3}").unwrap();
    }
    let strip = line(dir.path(), "strip", "film-coupon", table, &out);
    let d = diagnose(&[&strip], &[]);
    let held = d.holdout.unwrap();
    assert!(held.before_v < 2.0 * held.noise_floor_v, "{held:?}");
    assert_eq!(d.verdict, Verdict::Adequate, "{}", d.says);
}

/// The model that a diagnosis ends with, its named causes in it.
fn augmented(d: &Diagnosis) -> LineModel {
    let named = d.candidates.iter().filter(|c| c.in_model);
    LineModel {
        values: d.values.clone(),
        effects: named
            .map(|c| Acting {
                values: c.values.iter().map(|v| v.value).collect(),
                ..c.acting.clone()
            })
            .collect(),
        ..LineModel::default()
    }
}

/// A file that holds what a diagnosis found predicts a recording as the diagnosis did.
fn predicts(d: &Diagnosis, held_out: &Line) {
    let file = ParameterFile::of_diagnosis(d, Vec::new(), Provenance::default());
    let text = file.to_toml().unwrap();
    let read = ParameterFile::parse(Path::new("parameters.toml"), &text).unwrap();
    let model = read.line_model().unwrap();
    let after = validate_lines(std::slice::from_ref(held_out), &model).unwrap();
    let held = d.holdout.unwrap();
    assert!(
        (after.total().0 / held.after_v - 1.0).abs() < 0.02,
        "{held:?}"
    );
}

/// A hinge whose detents no cause of the catalogue has, and friction that lives in one place of a slide's
/// track: both are learnt along the coordinate, alone or beside a named cause, and a file that holds the term
/// predicts with it.
#[test]
fn what_no_cause_accounts_for_is_learnt_along_the_coordinate() {
    let dir = tempfile::tempdir().unwrap();
    let make = |id: &str, detents: &dyn Fn(f64, f64) -> f64, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("angle,torque\n");
        for i in 0..900 {
            let turn = std::f64::consts::TAU * f64::from(i) / (100.0 + seed as f64);
            let x = 0.4 * turn.sin();
            let noise: f64 = StandardNormal.sample(&mut generator);
            let torque = 0.02 * x + 0.05 * x.powi(3) + 2e-5 * noise + detents(x, turn.cos());
            writeln!(out, "{x:.6},{torque:.8}").unwrap();
        }
        line(dir.path(), id, "hinge-bench", BENCH, &out)
    };
    let detents = |x: f64, _: f64| 3e-4 * (TAU * x / 0.09).sin();
    let sticky = |x: f64, way: f64| 4e-4 * way.signum() * (-((x - 0.15) / 0.06_f64).powi(2)).exp();
    type Force<'a> = &'a dyn Fn(f64, f64) -> f64;
    let kinds: [(&str, Force, &str); 2] = [
        ("detents", &detents, "excursion"),
        ("sticky", &sticky, "sliding"),
    ];
    for (id, force, variable) in kinds {
        let [a, b, c] = [1, 2, 3].map(|n| make(&format!("{id}-{n}"), force, n));
        let d = diagnose(&[&a, &b], &[&c]);
        assert_eq!(d.verdict, Verdict::Unexplained, "{id}: {}", d.says);
        let learnt = d
            .learnt
            .as_ref()
            .unwrap_or_else(|| panic!("{id}: {}", d.says));
        assert!(d.says.contains("along the coordinate"), "{}", d.says);
        let variables = learnt.variables();
        assert!(variables.iter().any(|v| v.0 == variable), "{variables:?}");
        assert!(learnt.gap_closed > 0.85, "{id}: {}", learnt.says);
        assert_eq!(learnt.takes_energy(), id == "sticky", "{}", learnt.says);
        predicts(&d, &c);
    }
    // and what a named cause leaves, beside it
    let both = |x: f64, way: f64| 8e-4 * (way / 0.05).tanh() + 0.5 * detents(x, 0.0);
    // (every hundredth sample of the first lies at the largest angle: the last goes no further)
    let [a, b, c] = [0, 1, 3].map(|n| make(&format!("both-{n}"), &both, n));
    let d = diagnose(&[&a, &b], &[&c]);
    let named = d.candidates.iter().filter(|c| c.in_model);
    let named: Vec<&str> = named.map(|c| c.acting.effect.id()).collect();
    assert_eq!(
        (d.verdict, &named[..]),
        (Verdict::MissingPhysics, &["joint_friction"][..])
    );
    let learnt = d.learnt.as_ref().unwrap_or_else(|| panic!("{}", d.says));
    assert!(learnt.beside && learnt.gap_closed > 0.5, "{}", learnt.says);
    predicts(&d, &c);
    // what raises the error of a recording that was held out is dropped
    let away = make("away", &|x, _| -detents(x, 0.0), 6);
    let [a, b] = [1, 2].map(|n| make(&format!("again-{n}"), &detents, n));
    let d = diagnose(&[&a, &b], &[&away]);
    assert_eq!((d.verdict, &d.learnt), (Verdict::Unexplained, &None));
    let dropped = |r: &String| r.starts_with("What was learnt") && r.contains("was dropped");
    assert!(d.remarks.iter().any(dropped), "{:?}", d.remarks);
    // noise teaches nothing
    let [a, b] = [4, 5].map(|n| make(&format!("plain-{n}"), &|_, _| 0.0, n));
    let d = diagnose(&[&a], &[&b]);
    assert_eq!((d.verdict, d.learnt), (Verdict::Adequate, None));
}

/// A spring that warms up from one recording to the next: its size, and predictions that know when a recording
/// was made.
#[test]
fn a_spring_that_warms_up_over_a_series_is_a_drift() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    let begins = [0.0, 600.0, 1200.0, 2400.0];
    let lines: Vec<Line> = (begins.iter().enumerate())
        .map(|(i, &begins_s)| {
            let slide = Slide {
                warms: 0.1,
                begins_s,
                seed: 20 + i as u64,
                ..SLIDE
            };
            line(dir.path(), &format!("{i}"), "axis", &table, &slide.csv())
        })
        .collect();
    let when = |i: usize| When {
        recording: i,
        series_s: begins[i],
        start_s: 0.0,
    };
    let entries: Vec<LineEntry> = (lines.iter().enumerate())
        .map(|(i, line)| LineEntry {
            line,
            when: when(i),
        })
        .collect();
    let (train, holdout) = entries.split_at(3);
    let d = diagnose_lines(train, holdout, &Request::default(), &|_| {}).unwrap();
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    let found = &d.candidates[0];
    assert_eq!(found.acting.effect.id(), "temperature_drift");
    assert!(found.acting.effect.over_series(&found.acting.values));
    let size = &found.values[1];
    assert!(
        size.ci95[0] < 0.1 && 0.1 < size.ci95[1] && size.ci95[1] < 0.12,
        "{size:?}"
    );
    let held = d.holdout.unwrap();
    assert!(held.after_v < 0.2 * held.before_v, "{held:?}");
    let mut model = augmented(&d);
    let last = std::slice::from_ref(&lines[3]);
    let unplaced = validate_lines(last, &model).unwrap().total().0;
    model.when = vec![(lines[3].id.clone(), when(3))];
    let placed = validate_lines(last, &model).unwrap().total().0;
    assert!(
        (placed / held.after_v - 1.0).abs() < 1e-6,
        "{placed} {held:?}"
    );
    assert!(unplaced > 4.0 * placed, "{unplaced} {placed}");
}

/// A force cell that was knocked leaps; one whose zero drifts goes on steadily. Only the drift is a cause.
#[test]
fn a_knocked_cell_is_no_drift() {
    let dir = tempfile::tempdir().unwrap();
    let make = |id: &str, zero: &dyn Fn(i32) -> f64, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("angle,torque\n");
        for i in 0..600 {
            let x = 0.4 * (std::f64::consts::TAU * f64::from(i) / 110.0).sin();
            let noise: f64 = StandardNormal.sample(&mut generator);
            let torque = 0.02 * x + 0.05 * x.powi(3) + 2e-5 * noise + zero(i);
            writeln!(out, "{x:.6},{torque:.8}").unwrap();
        }
        line(dir.path(), id, "hinge-bench", BENCH, &out)
    };
    let leaps = |a: i32, b: i32| {
        move |i: i32| 4e-4 * (f64::from(u8::from(i >= a)) + f64::from(u8::from(i >= b)))
    };
    let knocked = make("knocked", &leaps(187, 431), 1);
    let d = diagnose(&[&knocked], &[&make("knocked-2", &leaps(143, 402), 2)]);
    assert_eq!(d.verdict, Verdict::Unexplained, "{}", d.says);
    let said = d.remarks.iter().find(|r| r.contains("comes at moments"));
    let said = said.unwrap_or_else(|| panic!("{:?}", d.remarks));
    assert!(said.contains("knocked (row 188, row 432)"), "{said}");
    let drift = |i: i32| 8e-4 * (1.0 - (-f64::from(i) / 400.0).exp());
    let d = diagnose(
        &[&make("drifts", &drift, 3)],
        &[&make("drifts-2", &drift, 4)],
    );
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    assert_eq!(d.candidates[0].acting.effect.id(), "x_zero_drift");
}

/// A drift goes on for as long as a recording does: longer ones drift further, those that were held out too.
#[test]
fn a_drift_goes_on_as_long_as_its_recording() {
    let dir = tempfile::tempdir().unwrap();
    let make = |id: &str, rows: i32, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("angle,torque\n");
        for i in 0..rows {
            let x = 0.4 * (std::f64::consts::TAU * f64::from(i) / 110.0).sin();
            let noise: f64 = StandardNormal.sample(&mut generator);
            let drift = 8e-4 * (1.0 - (-f64::from(i) / 400.0).exp());
            let torque = 0.02 * x + 0.05 * x.powi(3) + 2e-5 * noise + drift;
            writeln!(out, "{x:.6},{torque:.8}").unwrap();
        }
        line(dir.path(), id, "hinge-bench", BENCH, &out)
    };
    let (a, b, c) = (make("a", 300, 1), make("b", 700, 2), make("c", 1200, 3));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    assert_eq!(d.candidates[0].acting.effect.id(), "x_zero_drift");
    let held = d.holdout.unwrap();
    assert!(held.after_v < 0.2 * held.before_v, "{held:?}");
}

/// What goes along recordings may have begun before them, each time by another time: a zero that drifts, and a
/// film that was stretched further before the recording that is held out.
#[test]
fn what_was_under_way_when_a_recording_began_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let drifting = |id: &str, before: i32, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("angle,torque\n");
        for i in 0..900 {
            let x = 0.4 * (std::f64::consts::TAU * f64::from(i) / 110.0).sin();
            let noise: f64 = StandardNormal.sample(&mut generator);
            let drift = 8e-4 * (1.0 - (-f64::from(i + before) / 400.0).exp());
            let torque = 0.02 * x + 0.05 * x.powi(3) + 2e-5 * noise + drift;
            writeln!(out, "{x:.6},{torque:.8}").unwrap();
        }
        line(dir.path(), id, "hinge-bench", BENCH, &out)
    };
    let [a, b, c] = [("a", 0), ("b", 260), ("c", 130)].map(|(id, n)| drifting(id, n, n as u64));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    let named = d.candidates[0].acting.effect.id();
    assert_eq!(named, "x_zero_drift", "{}", d.says);
    let held = d.holdout.unwrap();
    assert!(held.after_v < 1.2 * held.noise_floor_v, "{held:?}");
    let said = d.remarks.iter().find(|r| r.contains("under way"));
    let said = said.unwrap_or_else(|| panic!("{:?}", d.remarks));
    // of the way that is to go where the first one begins, 1 - e^(-260/400) and 1 - e^(-130/400)
    let told = |id: &str| -> f64 {
        let after = said.split(&format!("{id} ")).nth(1);
        let number = after.and_then(|s| s.split([',', ' ']).next());
        let number = number.and_then(|n| n.trim_end_matches('.').parse().ok());
        number.unwrap_or_else(|| panic!("{said}"))
    };
    assert!((told("b") - 0.478).abs() < 0.05, "{said}");
    assert!((told("c") - 0.277).abs() < 0.05, "{said}");

    let softened = |id: &str, from: i32, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("angle,torque\n");
        let mut most = 0.0_f64;
        for i in 0..from + 700 {
            let t = f64::from(i) / 110.0;
            let x =
                0.2 * (1.0 - (std::f64::consts::TAU * t).cos()) * (1.0 - 0.4 * (t / 2.0).fract());
            most = most.max(x);
            let noise: f64 = StandardNormal.sample(&mut generator);
            let lost = 0.15 * (1.0 - (-(most - x) / 0.1).exp());
            let torque = (0.02 * x + 0.05 * x.powi(3)) * (1.0 - lost) + 1e-5 * noise;
            if i >= from {
                writeln!(out, "{x:.6},{torque:.8}").unwrap();
            }
        }
        line(dir.path(), id, "hinge-bench", BENCH, &out)
    };
    let (a, b, c) = (
        softened("d", 0, 1),
        softened("e", 0, 2),
        softened("f", 130, 3),
    );
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    let named = d.candidates[0].acting.effect.id();
    assert_eq!(named, "mullins_softening", "{}", d.says);
    assert!(
        d.remarks.iter().any(|r| r.contains("under way")),
        "{:?}",
        d.remarks
    );
}

/// Recordings that begin where the motion turns: a stop below the first sample that is met from below, a
/// spring that has softened about the middle, and a guide that the spring's pull presses together, which is
/// without pull beyond the first sample.
#[test]
fn an_axis_may_begin_anywhere() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    type Force<'a> = &'a mut dyn FnMut([f64; 2]) -> f64;
    let make = |id: &str, seed: u64, force: Force| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("t_s,x_m,u_V\n");
        for i in 0..4000 {
            let t = f64::from(i) * 0.005;
            // loops that grow: the first sample is the top of the first one
            let (w, size) = (std::f64::consts::TAU * 0.45, 0.012 + 4e-4 * t);
            let [s, c] = [(w * t).sin(), (w * t).cos()];
            let x = size * c;
            let v = 4e-4 * c - size * w * s;
            let a = -8e-4 * w * s - size * w * w * c;
            let mut z = || -> f64 { StandardNormal.sample(&mut generator) };
            let u = (2.0 * a + 15.0 * v + force([x, v])) / 4.0 + 0.01 * z();
            writeln!(out, "{t:.4},{:.8},{u:.6}", x + 1e-6 * z()).unwrap();
        }
        line(dir.path(), id, "axis", &table, &out)
    };
    let mut stop = |[x, v]: [f64; 2]| {
        let into = (x - 0.009).max(0.0);
        900.0 * x + 400.0 * into * (1.0 + 2.0 * v).max(0.0)
    };
    let [a, b, c] = [1, 2, 3].map(|n| make(&format!("stop-{n}"), n, &mut stop));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    let found = &d.candidates[0].acting;
    assert_eq!(found.effect.id(), "end_stop", "{}", d.says);
    assert_eq!(found.values[0], 0.0, "{:?}", found.values);
    let softened = |id: &str, seed: u64| {
        let mut most = 0.0_f64;
        make(id, seed, &mut |[x, _]| {
            most = most.max(x.abs());
            900.0 * x * (1.0 - 0.2 * ((most - x.abs()) / 0.006).tanh())
        })
    };
    let (a, b, c) = (softened("a", 4), softened("b", 5), softened("c", 6));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    let named = d.candidates[0].acting.effect.id();
    assert_eq!(named, "mullins_softening", "{}", d.says);
    let rubs = |id: &str, seed: u64| {
        let (mut z, mut before) = (0.0_f64, None);
        make(id, seed, &mut |[x, _]| {
            let way = x - before.replace(x).unwrap_or(x);
            z += (way.signum() - z) * (1.0 - (-way.abs() / 6e-4).exp());
            900.0 * x + 0.05 * (900.0 * (x - 0.025)).abs() * z
        })
    };
    let (a, b, c) = (rubs("g", 7), rubs("h", 8), rubs("i", 9));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    let named = d.candidates[0].acting.effect.id();
    assert_eq!(named, "x_load_friction", "{}", d.says);
}

/// A drive that is straight at small inputs and bends at large ones, and a lag of two stages: each is found by
/// the command that makes the force which the motion needs.
#[test]
fn bent_drives_and_lags_of_two_stages_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    let wanted = |t: f64, slide: &Slide| {
        let [x, v, a] = slide.motion(t);
        (2.0 * a + 15.0 * v + 900.0 * x) / 4.0
    };
    let bent = |t: f64, slide: &Slide| {
        let (top, bend) = (12.0, 1.8_f64);
        top / bend * (wanted(t, slide) / top * bend.sinh()).asinh()
    };
    let late = |t: f64, slide: &Slide| {
        let (first_s, second_s, h) = (0.02, 0.005, 1e-4);
        let [a, b, c] = [-h, 0.0, h].map(|d| wanted(t + d, slide));
        b + (first_s + second_s) * (c - a) / (2.0 * h)
            + first_s * second_s * (a - 2.0 * b + c) / (h * h)
    };
    type Command<'a> = &'a dyn Fn(f64, &Slide) -> f64;
    let cases: [(&str, Command); 2] = [("x_drive_power", &bent), ("x_drive_lag", &late)];
    for (id, command) in cases {
        let make = |seed: u64| {
            let slide = Slide { seed, ..SLIDE };
            let mut generator = ChaCha12Rng::seed_from_u64(seed);
            let mut out = String::from("t_s,x_m,u_V\n");
            for i in 0..4000 {
                let t = f64::from(i) * 0.005;
                let mut z = || -> f64 { StandardNormal.sample(&mut generator) };
                let x = slide.motion(t)[0] + 5e-6 * z();
                let u = command(t, &slide) + 0.01 * z();
                writeln!(out, "{t:.4},{x:.8},{u:.6}").unwrap();
            }
            line(dir.path(), &format!("{id}-{seed}"), "axis", &table, &out)
        };
        let (a, b, c) = (make(1), make(2), make(3));
        let d = diagnose(&[&a, &b], &[&c]);
        assert_eq!(d.verdict, Verdict::MissingPhysics, "{id}: {}", d.says);
        assert_eq!(d.candidates[0].acting.effect.id(), id, "{}", d.says);
        let held = d.holdout.unwrap();
        assert!(held.after_v < 0.3 * held.before_v, "{id}: {held:?}");
    }
}

/// A lag is exact between samples, where it is shorter than their distance as well: of a ramp it makes
/// t - T + T e^(-t/T).
#[test]
fn a_lag_is_exact_between_samples() {
    with_view(|view| {
        let lag = deacal::effects::line::by_id("x_drive_lag").unwrap();
        let mut made = terms(view);
        let step_s = made.input_step_s;
        for share in [0.4, 1.0, 7.0] {
            let after_s = share * step_s;
            for (i, u) in made.input.iter_mut().enumerate() {
                *u = i as f64 * step_s;
            }
            lag.line(&[after_s, 0.0], view, &mut made);
            for (i, u) in made.input.iter().enumerate() {
                let t = i as f64 * step_s;
                let exact = t - after_s + after_s * (-t / after_s).exp();
                assert!(
                    (u - exact).abs() < 1e-9 * (1.0 + t),
                    "{share} {i}: {u} {exact}"
                );
            }
        }
    });
}

/// A stop that two of three recordings reach, in the middle of what the third one shows; a dead zone of a drive
/// whose input is told through noise; and a lag within a sample, which no creep is blamed for.
#[test]
fn stops_dead_zones_and_short_lags_of_an_axis() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    type Input<'a> = &'a dyn Fn(f64, [f64; 3]) -> f64;
    let make = |id: &str, amplitude: f64, step_s: f64, seed: u64, input: Input| {
        let slide = Slide {
            amplitude,
            seed,
            ..SLIDE
        };
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("t_s,x_m,u_V\n");
        for i in 0..(20.0 / step_s) as u32 {
            let t = f64::from(i) * step_s;
            let mut z = || -> f64 { StandardNormal.sample(&mut generator) };
            let [x, v, a] = slide.motion(t);
            let force = 2.0 * a + 15.0 * v + 900.0 * x;
            let (x, u) = (x + 1e-5 * z(), input(force, [x, v, a]) + 0.01 * z());
            writeln!(out, "{t:.4},{x:.8},{u:.6}").unwrap();
        }
        line(dir.path(), id, "axis", &table, &out)
    };
    let stop = |force: f64, [x, v, _]: [f64; 3]| {
        let into = (x - 0.009).max(0.0);
        (force + 2000.0 * into * (1.0 + 2.0 * v).max(0.0)) / 4.0
    };
    let [a, b] = [1, 2].map(|n| make(&format!("stop-{n}"), 0.01, 0.005, n, &stop));
    let d = diagnose(&[&a, &b], &[&make("stop-3", 0.04, 0.005, 3, &stop)]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    assert_eq!(d.candidates[0].acting.effect.id(), "end_stop", "{}", d.says);
    // run forward: what the zone lets through drives the slide
    let zone = |seed: u64| {
        let command = |t: f64| -> f64 {
            let sines = [0.31, 0.83, 1.7].iter().enumerate();
            sines
                .map(|(k, f)| 1.3 * (TAU * f * t + k as f64 + seed as f64).sin())
                .sum()
        };
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("t_s,x_m,u_V\n");
        let (mut x, mut v) = (0.0, 0.0);
        for i in 0..400_000 {
            let t = f64::from(i) * 5e-5;
            if i % 100 == 0 {
                let mut z = || -> f64 { StandardNormal.sample(&mut generator) };
                let (x, u) = (x + 1e-5 * z(), command(t) + 0.01 * z());
                writeln!(out, "{t:.4},{x:.8},{u:.6}").unwrap();
            }
            let u = command(t);
            let through = u.signum() * (u.abs() - 0.6).max(0.0);
            v += 5e-5 * (4.0 * through - 15.0 * v - 900.0 * x) / 2.0;
            x += 5e-5 * v;
        }
        line(dir.path(), &format!("zone-{seed}"), "axis", &table, &out)
    };
    let [a, b, c] = [4, 5, 6].map(zone);
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    assert_eq!(
        d.candidates[0].acting.effect.id(),
        "amplifier_deadband",
        "{}",
        d.says
    );
    // the error is told where the zone leaves the input open to neither side; its edges are low-passed
    let held = d.holdout.as_ref().unwrap();
    assert!(held.after_v < held.before_v / 3.0, "{}", d.says);
    // 7 ms of a sample of 10: u_c = u + T du/dt
    let slide = |seed| Slide {
        amplitude: 0.01,
        seed,
        ..SLIDE
    };
    let late = |seed: u64| {
        let force = move |t: f64| {
            let [x, v, a] = slide(seed).motion(t);
            (2.0 * a + 15.0 * v + 900.0 * x) / 4.0
        };
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("t_s,x_m,u_V\n");
        for i in 0..2000 {
            let t = f64::from(i) * 0.01;
            let slope = (force(t + 1e-4) - force(t - 1e-4)) / 2e-4;
            let mut z = || -> f64 { StandardNormal.sample(&mut generator) };
            let x = slide(seed).motion(t)[0] + 1e-5 * z();
            let u = force(t) + 0.007 * slope + 0.01 * z();
            writeln!(out, "{t:.4},{x:.8},{u:.6}").unwrap();
        }
        line(dir.path(), &format!("late-{seed}"), "axis", &table, &out)
    };
    let [a, b, c] = [7, 8, 9].map(late);
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::Adequate, "{}", d.says);
    assert!(
        d.candidates.iter().all(|c| c.probability < 0.5),
        "{}",
        d.says
    );
    assert!(d.says.contains("sample"), "{}", d.says);
}

/// A pump on the same table: its frequency is told, and it is looked for at rest. Where the rows have no time
/// there are no frequencies.
#[test]
fn a_pump_is_told_by_its_frequency() {
    let dir = tempfile::tempdir().unwrap();
    let make = |id: &str, clock: bool, seed: u64| {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut out = String::from("t,angle,torque\n");
        for i in 0..1500 {
            let t = 0.02 * f64::from(i);
            let x = 0.4 * (TAU * t / 4.4).sin();
            let noise: f64 = StandardNormal.sample(&mut generator);
            let pump = 2e-4 * (TAU * 1.734 * t + 2.0 * seed as f64).sin();
            let torque = 0.02 * x + 0.05 * x.powi(3) + 2e-5 * noise + pump;
            writeln!(out, "{t:.2},{x:.6},{torque:.8}").unwrap();
        }
        let (time, unit) = if clock {
            ("time = \"t\"\n", "time = \"s\", ")
        } else {
            ("", "")
        };
        let table = format!(
            "[bench]\nfile = \"data.csv\"\n{time}angle = \"angle\"\ntorque = \"torque\"\n\
             units = {{ {unit}angle = \"rad\", torque = \"N m\" }}\n"
        );
        line(dir.path(), id, "hinge-bench", &table, &out)
    };
    let [a, b, c] = [1, 2, 3].map(|n| make(&format!("pump-{n}"), true, n));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::Unexplained, "{}", d.says);
    let place = &d.places[0];
    assert_eq!(place.dimension, "frequency", "{place:?}");
    let [low, high] = place.range.unwrap();
    assert!(
        low < 1.734 && 1.734 < high && high - low < 0.05,
        "{low} {high}"
    );
    assert!(
        place.share_of_excess > 0.8 && place.p_value < 1e-6,
        "{place:?}"
    );
    assert!(
        d.next_experiment.contains("at rest"),
        "{}",
        d.next_experiment
    );
    let [a, b] = [4, 5].map(|n| make(&format!("rows-{n}"), false, n));
    let d = diagnose(&[&a], &[&b]);
    assert!(
        d.places.iter().all(|p| p.dimension != "frequency"),
        "{:?}",
        d.places
    );
}

#[test]
fn recordings_that_say_nothing_are_refused_in_words() {
    let dir = tempfile::tempdir().unwrap();
    let own = dir.path().join("still");
    std::fs::create_dir_all(&own).unwrap();
    let mut csv = String::from("t_s,x_m,u_V\n");
    for i in 0..100 {
        writeln!(csv, "{},{},{}", f64::from(i) * 0.01, 0.5, f64::from(i)).unwrap();
    }
    std::fs::write(own.join("data.csv"), csv).unwrap();
    let manifest =
        format!("[recording]\nid = \"still\"\nkind = \"axis\"\n\n{AXIS}input_gain = 1.0\n");
    std::fs::write(own.join("recording.toml"), manifest).unwrap();
    let error = Line::from_recording(&Recording::open(&own).unwrap()).unwrap_err();
    assert!(error.to_string().contains("0.5 throughout"), "{error}");
    let table = format!("{AXIS}input_gain = 4.0\n");
    let good = line(dir.path(), "good", "axis", &table, &SLIDE.csv());
    let wrong = LineRequest {
        fix: vec![("masss".into(), 1.0)],
        bound: Vec::new(),
    };
    let error = calibrate_lines(&[good], &wrong).unwrap_err().to_string();
    assert!(error.contains("masss") && error.contains("mass"), "{error}");
}

#[test]
fn silverbox_stiffens() {
    let Some(shared) = std::env::var_os("DEACAL_SHARED") else {
        println!("skipped: DEACAL_SHARED is not set");
        return;
    };
    let file = Path::new(&shared).join("datasets/real/silverbox/SNLS80mV.csv");
    let dir = tempfile::tempdir().unwrap();
    let make = |id: &str, span: &str| silverbox(dir.path(), &file, id, span);
    let multisine = make("multisine", "[67.0, 80.0]");
    let arrow = make("arrow", "[45.0, 66.0]");
    let d = diagnose(&[&multisine], &[&arrow]);
    assert_eq!(d.candidates[0].acting.effect.id(), "x_nonlinear_stiffness");
    let h = d.holdout.unwrap();
    println!(
        "held out: {:.3e} V before, {:.3e} V after",
        h.before_v, h.after_v
    );
    assert!(h.after_v < 2e-3 && h.after_v < 0.5 * h.before_v, "{h:?}");
}

/// At its smallest amplitudes the circuit is linear, and its noise lies within the band of the signal.
#[test]
fn the_quiet_silverbox_is_adequate() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/silverbox2013/quiet.csv");
    let dir = tempfile::tempdir().unwrap();
    for (id, span) in [
        ("all", "[0.2, 6.0]"),
        ("first", "[0.2, 3.0]"),
        ("second", "[3.0, 6.0]"),
    ] {
        let quiet = silverbox(dir.path(), &file, id, span);
        let d = diagnose(&[&quiet], &[]);
        assert_eq!(d.verdict, Verdict::Adequate, "{id}: {}", d.says);
        assert!(
            d.remarks
                .iter()
                .any(|r| r.contains("noise within the band"))
        );
    }
}

#[test]
fn an_input_in_a_file_of_its_own_may_be_shorter() {
    let dir = tempfile::tempdir().unwrap();
    let own = dir.path().join("two-files");
    std::fs::create_dir_all(&own).unwrap();
    let mut motion = String::from("t_s,x_m\n");
    for i in 0..3000 {
        // the encoder's first reading is its smallest, for a long time
        let x = (f64::from(i) * 0.01 - 12.0).max(0.0).sin();
        writeln!(motion, "{},{x:.6}", f64::from(i) * 0.01).unwrap();
    }
    let mut input = String::from("t_s,u_V\n");
    for i in 0..150 {
        writeln!(
            input,
            "{},{:.4}",
            f64::from(i) * 0.2,
            (f64::from(i) * 0.2).sin()
        )
        .unwrap();
    }
    std::fs::write(own.join("data.csv"), motion).unwrap();
    std::fs::write(own.join("input.csv"), input).unwrap();
    let manifest = format!(
        "[recording]\nid = \"two-files\"\nkind = \"axis\"\n\n{AXIS}input_gain = 1.0\ninput_file = \"input.csv\"\ninput_time = \"t_s\"\n"
    );
    std::fs::write(own.join("recording.toml"), manifest).unwrap();
    let line = Line::from_recording(&Recording::open(&own).unwrap()).unwrap();
    assert!(line.usable.iter().all(|u| *u));
}

/// A course with pauses and reversals, as causes see it.
fn with_view<R>(of: impl FnOnce(&View) -> R) -> R {
    let time_s: Vec<f64> = (0..400).map(|i| 0.01 * f64::from(i)).collect();
    let course = |t: &f64| (2.3 * t).sin() * (0.7 * t).cos();
    let largest = time_s
        .iter()
        .map(course)
        .fold(0.0, |m: f64, x| m.max(x.abs()));
    let xi: Vec<f64> = time_s.iter().map(|t| course(t) / largest).collect();
    let slopes = |values: &[f64]| -> Vec<f64> {
        let between = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(399));
            (values[b] - values[a]) / (time_s[b] - time_s[a])
        };
        (0..400).map(between).collect()
    };
    let rate = slopes(&xi);
    let acceleration = slopes(&rate);
    let elastic: Vec<f64> = xi.iter().map(|x| 0.8 * x).collect();
    let second = vec![0.5; 400];
    of(&View {
        recording: 0,
        held: 0.0,
        timed: true,
        time_s: &time_s,
        step_s: 0.01,
        duration_s: 3.99,
        series_s: 0.0,
        unstrained: false,
        straight: true,
        xi: &xi,
        way: &xi,
        rate: &rate,
        speed: rate.iter().fold(0.0, |m: f64, r| m.max(r.abs())),
        acceleration: &acceleration,
        inertial: true,
        elastic: &elastic,
        second: &second,
    })
}

fn terms(view: &View) -> Terms {
    Terms {
        xi: view.xi.to_vec(),
        factor: vec![[1.0; 2]; view.xi.len()],
        force: vec![0.0; view.xi.len()],
        input: view.xi.iter().map(|x| 0.9 * x).collect(),
        input_step_s: view.step_s,
        gain: vec![1.0; view.xi.len()],
        shift_s: 0.0,
    }
}

fn all(t: &Terms) -> Vec<u64> {
    let factor = t.factor.iter().flatten();
    let lists =
        t.xi.iter()
            .chain(factor)
            .chain(&t.force)
            .chain(&t.input)
            .chain(&t.gain);
    lists.chain([&t.shift_s]).map(|v| v.to_bits()).collect()
}

#[test]
fn a_cause_on_one_coordinate_does_something_where_a_scan_looks_and_nothing_when_off() {
    with_view(|view| {
        for effect in every() {
            let before = terms(view);
            for values in effect.near(view).iter().flatten() {
                let mut after = terms(view);
                effect.line(values, view, &mut after);
                assert_ne!(all(&before), all(&after), "{} {values:?}", effect.id());
                assert!(
                    all(&after).iter().all(|v| f64::from_bits(*v).is_finite()),
                    "{} {values:?}",
                    effect.id()
                );
            }
            let off: Vec<f64> = effect.parameters().iter().map(|q| q.off).collect();
            if off.iter().all(|v| v.is_finite()) {
                let mut after = terms(view);
                effect.line(&off, view, &mut after);
                let same = all(&before).iter().zip(&all(&after)).all(|(a, b)| {
                    // a change of 0 may be -0
                    f64::from_bits(*a) == f64::from_bits(*b)
                });
                assert!(same, "{} is not off at {off:?}", effect.id());
            }
        }
    });
}

#[test]
fn drives_of_second_order_ring_as_theirs_do() {
    let effect = deacal::effects::line::by_id("x_drive_second_order").unwrap();
    with_view(|view| {
        let mut t = terms(view);
        t.input = vec![1.0; 4000];
        t.input[0] = 0.0;
        t.input_step_s = 1e-4;
        let (period, damping) = (0.01, 0.2);
        effect.line(&[period, damping], view, &mut t);
        // step response 1 - e^(-z t/T) (cos w t + z/sqrt(1 - z^2) sin w t), w = sqrt(1 - z^2)/T
        let root = (1.0_f64 - damping * damping).sqrt();
        for i in [50, 170, 330, 700] {
            let x = (f64::from(i) - 0.5) * 1e-4 / period;
            let exact =
                1.0 - (-damping * x).exp() * ((root * x).cos() + damping / root * (root * x).sin());
            assert!((t.input[i as usize] - exact).abs() < 2e-3, "{i}");
        }
    });
}

#[test]
fn a_fitted_axis_predicts_other_recordings_and_an_augmented_one_better() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    let stiff = Slide {
        cubic: 1.2e5,
        seed: 3,
        ..SLIDE
    };
    let a = line(dir.path(), "a", "axis", &table, &stiff.csv());
    let wide = Slide {
        amplitude: 0.03,
        seed: 4,
        ..stiff
    };
    let b = line(dir.path(), "b", "axis", &table, &wide.csv());
    let fit = calibrate_lines(std::slice::from_ref(&a), &LineRequest::default()).unwrap();
    let plain = LineModel {
        values: fit.values.clone(),
        ..LineModel::default()
    };
    // the fit's own recording comes out as in the fit
    let again = validate_lines(std::slice::from_ref(&a), &plain).unwrap();
    assert!((again.total().0 / fit.total().0 - 1.0).abs() < 1e-9);
    let d = diagnose(&[&a], &[&b]);
    let full = augmented(&d);
    let after = validate_lines(std::slice::from_ref(&b), &full).unwrap();
    let held = d.holdout.unwrap();
    assert!(
        (after.total().0 / held.after_v - 1.0).abs() < 1e-6,
        "{held:?}"
    );
    let (every, unit) = predict_line(&b, &full).unwrap();
    assert_eq!((every.time_s.len(), unit.as_str()), (6000, "V"));
    let told: Vec<usize> = (0..6000)
        .filter(|&i| every.predicted[i].is_finite())
        .collect();
    assert!(told.len() > 4500, "{}", told.len());
    let square = |i: &usize| (every.predicted[*i] - every.measured[*i]).powi(2);
    let rms = (told.iter().map(square).sum::<f64>() / told.len() as f64).sqrt();
    assert!(rms < 0.5 * held.before_v, "{rms} {held:?}");
    let nothing = LineModel::default();
    let error = validate_lines(&[b], &nothing).unwrap_err().to_string();
    assert!(error.contains("gain_N"), "{error}");
}

/// A slide of known mass with dry friction in the catalogue's own form, driven to and fro at one speed, its
/// force cell as the input. Clocks that are half a sample apart are said, in recordings that are held out
/// too, and are no cause.
#[test]
fn clocks_within_a_sample_are_no_cause() {
    let dir = tempfile::tempdir().unwrap();
    let table = AXIS.replace("mass_kg = \"estimate\"", "mass_kg = 2.0") + "input_gain = 4.0\n";
    for (seed, ahead_s) in [(1, 0.0025), (2, -0.0025), (3, 0.0015), (4, -0.001)] {
        let make = |id: &str, seed: u64| {
            let slide = Slide {
                seed,
                ahead_s,
                ..SLIDE
            };
            line(
                dir.path(),
                &format!("{id}-{seed}"),
                "axis",
                &table,
                &slide.csv(),
            )
        };
        let (a, b) = (make("a", seed), make("b", 10 + seed));
        let d = diagnose(&[&a], &[&b]);
        assert_eq!(d.verdict, Verdict::Adequate, "{ahead_s}: {}", d.says);
        assert!(d.says.contains("on one clock"), "{ahead_s}: {}", d.says);
    }
}

fn dry_slide(friction_n: f64, seed: u64) -> String {
    let mut generator = ChaCha12Rng::seed_from_u64(seed);
    let (step, period, speed, turn) = (0.005, 8.0, 0.01, 0.15);
    let mut out = String::from("t_s,x_m,u_N\n");
    let (mut x, mut z) = (0.0, 0.0);
    // the speed turns about within `turn`
    let edges = |t: f64| {
        let phase = (t + 0.25 * period) % period;
        [0.0, 0.5 * period, period].map(|at| ((phase - at) / turn).tanh())
    };
    let velocity = |t: f64| {
        let [a, b, c] = edges(t);
        speed * (a - b + c)
    };
    for i in 0..9000 {
        let t = f64::from(i) * step;
        if i > 0 {
            // Simpson's rule from the sample before
            let dx =
                step / 6.0 * (velocity(t - step) + 4.0 * velocity(t - 0.5 * step) + velocity(t));
            x += dx;
            z += (dx.signum() - z) * (1.0 - (-dx.abs() / 2e-4).exp());
        }
        let [a, b, c] = edges(t).map(|e| 1.0 - e * e);
        let force = 2.0 * speed / turn * (a - b + c) + friction_n * z + 30.0;
        let mut noise = || -> f64 { StandardNormal.sample(&mut generator) };
        let (shown, u) = (x + 2e-6 * noise(), force + 0.02 * noise());
        writeln!(out, "{t:.4},{shown:.8},{u:.5}").unwrap();
    }
    out
}

const DRY: &str = "[axis]\nfile = \"data.csv\"\ntime = \"t_s\"\nposition = \"x_m\"\ninput = \"u_N\"\nunits = { time = \"s\", position = \"m\", input = \"N\" }\nmass_kg = 2.0\ndamping = \"estimate\"\nstiffness = \"estimate\"\ninput_gain = 1.0\n";

/// A ceiling below everything that was measured leaves nothing to explain, and so explains nothing.
#[test]
fn friction_at_one_speed_is_not_a_ceiling() {
    let dir = tempfile::tempdir().unwrap();
    let make = |id: &str, friction: f64, seed: u64| {
        line(dir.path(), id, "axis", DRY, &dry_slide(friction, seed))
    };
    let (a, b, c) = (make("a", 5.0, 1), make("b", 5.0, 2), make("c", 5.0, 3));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::MissingPhysics, "{}", d.says);
    let named: Vec<&str> = d
        .candidates
        .iter()
        .filter(|c| c.in_model)
        .map(|c| c.acting.effect.id())
        .collect();
    assert!(named.contains(&"joint_friction"), "{}", d.says);
    for drive in [
        "amplifier_saturation",
        "amplifier_deadband",
        "x_drive_power",
        "end_stop",
    ] {
        assert!(!named.contains(&drive), "{}", d.says);
    }
    let held = d.holdout.unwrap();
    assert!(held.after_v < 0.2 * held.before_v, "{held:?}");
    let (a, b, c) = (make("a0", 0.0, 1), make("b0", 0.0, 2), make("c0", 0.0, 3));
    let d = diagnose(&[&a, &b], &[&c]);
    assert_eq!(d.verdict, Verdict::Adequate, "{}", d.says);
}

/// What is predicted is worked out from everything else: a tone in the measured input moves no bit of it,
/// whatever the drive.
#[test]
fn a_prediction_reads_nothing_of_what_it_predicts() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    let with_tone: String = SLIDE
        .csv()
        .lines()
        .enumerate()
        .map(|(i, l)| {
            let c: Vec<&str> = l.split(',').collect();
            match c[2].parse::<f64>() {
                Ok(u) => format!(
                    "{},{},{:.6}\n",
                    c[0],
                    c[1],
                    u + 0.5 * (0.07 * i as f64).sin()
                ),
                Err(_) => format!("{l}\n"),
            }
        })
        .collect();
    let own = line(dir.path(), "own", "axis", &table, &SLIDE.csv());
    let other = line(dir.path(), "tone", "axis", &table, &with_tone);
    let fit = calibrate_lines(std::slice::from_ref(&own), &LineRequest::default()).unwrap();
    for effect in every() {
        let start: Option<Vec<f64>> =
            with_view(|view| effect.near(view).into_iter().flatten().next());
        let (Some(mut values), true) = (
            start,
            effect.kinds().contains(&deacal::effects::line::Kind::Axis),
        ) else {
            continue;
        };
        // states in time constants of this slide
        for (v, q) in values.iter_mut().zip(effect.parameters()) {
            if q.unit == "s" {
                *v = 0.01;
            }
        }
        let model = LineModel {
            values: fit.values.clone(),
            effects: vec![Acting {
                effect,
                values,
                on: [true; 3],
            }],
            ..LineModel::default()
        };
        let [a, b] = [&own, &other].map(|l| predict_line(l, &model).unwrap().0);
        let mut told = 0;
        for (x, y) in a.predicted.iter().zip(&b.predicted) {
            assert_eq!(x.to_bits(), y.to_bits(), "{}", effect.id());
            told += usize::from(x.is_finite());
        }
        // a ceiling far below the input tells little
        assert!(told > 300, "{}: {told}", effect.id());
        let moved = a
            .measured
            .iter()
            .zip(&b.measured)
            .any(|(x, y)| (x - y).abs() > 0.1);
        assert!(moved, "{}", effect.id());
    }
}

/// Drives are taken back: the input that a drive was given comes out of what it made of it.
#[test]
fn a_drive_is_undone() {
    use deacal::effects::line::Undone;
    with_view(|view| {
        for (id, values) in [
            ("amplifier_saturation", vec![0.6, 0.02]),
            ("amplifier_saturation", vec![0.7, 0.15]),
            ("amplifier_deadband", vec![0.1, 0.0]),
            ("amplifier_deadband", vec![0.1, 1.0]),
            ("x_drive_power", vec![1.7, 0.0]),
            ("x_drive_power", vec![0.4, 0.3]),
            ("x_drive_power", vec![3.5, 0.6]),
            ("x_drive_lag", vec![0.03, 0.0]),
            ("x_drive_lag", vec![0.03, 0.2]),
            ("x_drive_second_order", vec![0.02, 0.7]),
        ] {
            let effect = deacal::effects::line::by_id(id).unwrap();
            let mut made = terms(view);
            let given = made.input.clone();
            effect.line(&values, view, &mut made);
            let told = vec![true; given.len()];
            let mut undone = Undone {
                step_s: view.step_s,
                input: made.input,
                told,
                noise: 0.0,
            };
            effect.undo(&values, &mut undone);
            let mut count = 0;
            for i in 30..given.len() - 1 {
                if undone.told[i] {
                    count += 1;
                    assert!(
                        (undone.input[i] - given[i]).abs() < 0.02,
                        "{id} {i}: {} {}",
                        undone.input[i],
                        given[i]
                    );
                }
            }
            assert!(count > 200, "{id}: {count}");
        }
    });
}

#[test]
fn bad_input_of_one_coordinate_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let table = format!("{AXIS}input_gain = 4.0\n");
    // a position in micrometres that is said to be in metres
    let csv: String = SLIDE
        .csv()
        .lines()
        .map(|l| {
            let c: Vec<&str> = l.split(',').collect();
            match c[1].parse::<f64>() {
                Ok(x) => format!("{},{:.3},{}\n", c[0], 1e6 * x, c[2]),
                Err(_) => format!("{l}\n"),
            }
        })
        .collect();
    let wrong = line(dir.path(), "unit", "axis", &table, &csv);
    assert!(
        wrong
            .notes
            .iter()
            .any(|n| n.contains("beyond all plausibility")),
        "{:?}",
        wrong.notes
    );
    let fit = calibrate_lines(&[wrong], &LineRequest::default()).unwrap();
    assert!(
        fit.remarks
            .iter()
            .any(|r| r.contains("look whether its unit")),
        "{:?}",
        fit.remarks
    );
    // a gain in the unit of something else
    let heavy = format!("{AXIS}input_gain = 4e12\n");
    let fit = line(dir.path(), "gain", "axis", &heavy, &SLIDE.csv());
    let fit = calibrate_lines(&[fit], &LineRequest::default()).unwrap();
    let mass = fit.estimates.iter().find(|e| e.name == "mass").unwrap();
    assert!(
        mass.says.contains("beyond all plausibility"),
        "{}",
        mass.says
    );
    // swapped columns of a bench: a torque of a hinge that ranges over radians is none
    let bench = "[bench]\nfile = \"data.csv\"\nangle = \"torque\"\ntorque = \"angle\"\nunits = { angle = \"rad\", torque = \"N m\" }\n";
    let mut csv = String::from("angle,torque\n");
    for i in 0..100 {
        let x = 0.4 * (0.1 * f64::from(i)).sin();
        writeln!(csv, "{x:.6},{:.9}", 1e-6 * x).unwrap();
    }
    let swapped = line(dir.path(), "swapped", "hinge-bench", bench, &csv);
    assert!(
        swapped.notes.iter().any(|n| n.contains("swapped")),
        "{:?}",
        swapped.notes
    );
    // a laser that loses its target shows one value, far from where it was
    let mut torn = String::from("t_s,x_m,u_V\n");
    for (i, l) in SLIDE.csv().lines().skip(1).enumerate() {
        let c: Vec<&str> = l.split(',').collect();
        let x = if (3000..3040).contains(&i) {
            "-0.2"
        } else {
            c[1]
        };
        writeln!(torn, "{},{x},{}", c[0], c[2]).unwrap();
    }
    let torn = line(dir.path(), "torn", "axis", &table, &torn);
    assert!(
        torn.notes.iter().any(|n| n.contains("40 of 6000 samples")),
        "{:?}",
        torn.notes
    );
    let fit = calibrate_lines(&[torn], &LineRequest::default()).unwrap();
    let mass = fit.estimates.iter().find(|e| e.name == "mass").unwrap();
    assert!((mass.value / 2.0 - 1.0).abs() < 0.01, "{}", mass.value);
    // time that steps back
    let own = dir.path().join("back");
    std::fs::create_dir_all(&own).unwrap();
    let back: String = SLIDE
        .csv()
        .lines()
        .enumerate()
        .map(|(i, l)| {
            if i == 500 {
                "0.001,0,0\n".into()
            } else {
                format!("{l}\n")
            }
        })
        .collect();
    std::fs::write(own.join("data.csv"), back).unwrap();
    let manifest = format!("[recording]\nid = \"back\"\nkind = \"axis\"\n\n{table}");
    std::fs::write(own.join("recording.toml"), manifest).unwrap();
    let error = Recording::open(&own).unwrap_err().to_string();
    assert!(
        error.contains("line 501") && error.contains("time that rises"),
        "{error}"
    );
}

/// A stretch of the silverbox.
fn silverbox(dir: &Path, file: &Path, id: &str, span: &str) -> Line {
    let own = dir.join(id);
    std::fs::create_dir_all(&own).unwrap();
    let manifest = format!(
        "[recording]\nid = \"{id}\"\nkind = \"axis\"\n\n[axis]\nfile = \"{}\"\nrate_hz = 610.3515625\nposition = \"V2\"\ninput = \"V1\"\nunits = {{ position = \"m\", input = \"V\" }}\ninput_gain = 1.0\nmass_kg = \"estimate\"\ndamping = \"estimate\"\nstiffness = \"estimate\"\nspan_s = {span}\n",
        file.display()
    );
    std::fs::write(own.join("recording.toml"), manifest).unwrap();
    Line::from_recording(&Recording::open(&own).unwrap()).unwrap()
}

/// Cases on single coordinates that were left in a folder are diagnosed from there as they were when they
/// were made.
#[test]
fn cases_of_a_folder_may_be_single_coordinates() {
    let dir = tempfile::tempdir().unwrap();
    let prove = |args: &[&str], out: &str| -> serde_json::Value {
        common::run(|deacal| {
            deacal
                .current_dir(dir.path())
                .arg("prove")
                .args(args)
                .args(["--quiet", "-o", out])
        });
        let trials = std::fs::read(dir.path().join(out).join("trials.json")).unwrap();
        let mut trials: Vec<serde_json::Value> = serde_json::from_slice(&trials).unwrap();
        trials.sort_by_key(|t| t["case"].to_string());
        let told = |t: &serde_json::Value| {
            serde_json::json!([t["case"], t["truth"], t["verdict"], t["named"]])
        };
        trials.iter().map(told).collect()
    };
    let plan = [
        "--rigs", "bench", "--number", "4", "--seed", "5", "--keep", "kept",
    ];
    let made = prove(&plan, "made");
    let given = prove(
        &["--cases", "kept/cases", "--answers", "kept/answers"],
        "given",
    );
    assert_eq!(made, given);
}

/// Mechanisms of no catalogue, most of which a cause that is in it takes away: a name that leaves as much
/// as that is none, and neither is what stands far above the noise and comes in bursts noise.
#[test]
fn what_leaves_much_of_a_loud_error_is_unexplained() {
    use deacal::cases::Kind;
    use deacal::cases::line::{LineSpec, Rig, generate};
    let cases = [
        (
            Rig::Bench,
            "x_cell_leaps",
            2783031825870473,
            0.24215239051763435,
        ),
        (
            Rig::Axis,
            "x_sticky_place",
            3252472188002015,
            0.14260731538079446,
        ),
    ];
    for (rig, what, seed, strength) in cases {
        let spec = LineSpec {
            rig,
            kind: Kind::Unknown(what),
            seed,
            strength,
        };
        let t = deacal::proof::trial_lines(&generate(&spec).unwrap());
        assert_eq!(t.verdict, "unexplained", "{what}: {t:?}");
        assert!(t.mean_squares[0] > 4.0, "{what}: {t:?}");
    }
}

/// Nor do those of benches and coupons, to the bit: the torque and the stress are theirs to predict.
#[test]
fn torque_and_stress_are_predicted_without_being_read() {
    use deacal::dataset::line::Measured;
    use deacal::film::Film;
    let dir = tempfile::tempdir().unwrap();
    let mut torques = String::from("angle,torque\n");
    let mut stresses = String::from("t,l,s\n");
    for i in 0..300 {
        let t = f64::from(i);
        let x = 0.4 * (0.06 * t).sin();
        writeln!(torques, "{x:.6},{:.8}", 0.02 * x + 0.05 * x.powi(3)).unwrap();
        let stretch = 1.2 + 0.2 * (0.06 * t).sin();
        writeln!(
            stresses,
            "{:.2},{stretch:.6},{:.3}",
            0.1 * t,
            4e4 * (stretch - 1.0)
        )
        .unwrap();
    }
    let bench = "[bench]\nfile = \"data.csv\"\nangle = \"angle\"\ntorque = \"torque\"\nunits = { angle = \"rad\", torque = \"N m\" }\n";
    let coupon = "[coupon]\nfile = \"data.csv\"\ntime = \"t\"\nstretch = \"l\"\nnominal_stress = \"s\"\nmode = \"uniaxial\"\nunits = { time = \"s\", nominal_stress = \"Pa\" }\n";
    let hinge = line(dir.path(), "hinge", "hinge-bench", bench, &torques);
    let strip = line(dir.path(), "strip", "film-coupon", coupon, &stresses);
    let curve = calibrate_lines(std::slice::from_ref(&hinge), &LineRequest::default())
        .unwrap()
        .curve;
    let film = Film {
        mu_pa: vec![2e4, 1e4],
        relaxation_time_s: vec![3.0],
        locking: 80.0,
    };
    for own in [hinge, strip] {
        let mut other = own.clone();
        match &mut other.measured {
            Measured::Torque(t) => t.iter_mut().for_each(|t| *t = 0.3 - 1.7 * *t),
            Measured::Coupon(c) => c.stress_pa.iter_mut().for_each(|s| *s = 3e3 - 1.7 * *s),
            Measured::Axis(_) => {}
        }
        let model = LineModel {
            film: Some(film.clone()),
            curve: curve.clone(),
            values: [
                ("rest", if own.mode().is_some() { 1.0 } else { 0.0 }),
                ("largest_coordinate", 0.4),
                ("largest_force", 1.0),
                ("largest_input", 1.0),
            ]
            .map(|(n, v)| (n.to_owned(), v))
            .to_vec(),
            ..LineModel::default()
        };
        let [a, b] = [&own, &other].map(|l| predict_line(l, &model).unwrap().0);
        let same = a.predicted.iter().zip(&b.predicted);
        assert!(
            same.clone().all(|(x, y)| x.to_bits() == y.to_bits()),
            "{}",
            own.id
        );
        assert!(
            same.filter(|(x, _)| x.is_finite()).count() > 200,
            "{}",
            own.id
        );
        let moved = a.measured.iter().zip(&b.measured);
        assert!(moved.filter(|(x, y)| x != y).count() > 200, "{}", own.id);
    }
}
