//! Axes run forward and fitted by their motion, against an integrator of this file's own.

use crate::common;

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

use deacal::calibration::{
    Causes, Estimate, LineModel, LineOutcome, LineRequest, MotionRequest, calibrate_lines,
    calibrate_motion, predict_line_motion,
};
use deacal::dataset::line::Line;
use deacal::recording::Recording;
use deacal::residual::motion::Between;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

/// What an axis has beside its plain model; sizes are shares of the force that its spring makes at the
/// amplitude.
#[derive(Debug, Clone, Copy, PartialEq)]
enum More {
    Nothing,
    /// Quadratic and cubic force at the amplitude.
    Spring(f64, f64),
    /// Force at the fastest speed, v |v|.
    Drag(f64),
    /// Dry friction: force, and the distance of its presliding over the amplitude.
    Dry(f64, f64),
    /// (a x + b x^2) v at amplitude and fastest speed.
    Stroke(f64, f64),
    /// A lag of the drive, s.
    Lag(f64),
    /// Share of the mass that the stroke adds at the amplitude.
    Inertia(f64),
}

impl More {
    fn id(self) -> Option<&'static str> {
        match self {
            More::Nothing => None,
            More::Spring(..) => Some("x_nonlinear_stiffness"),
            More::Drag(_) => Some("x_quadratic_damping"),
            More::Dry(..) => Some("joint_friction"),
            More::Stroke(..) => Some("x_stroke_damping"),
            More::Lag(_) => Some("x_drive_lag"),
            More::Inertia(_) => Some("x_stroke_inertia"),
        }
    }
}

/// m x'' + c x' + k x + more = g u, driven by a sum of sines that is held or smooth between samples.
#[derive(Debug, Clone, Copy)]
struct Axis {
    mass: f64,
    damping: f64,
    stiffness: f64,
    gain: f64,
    more: More,
    /// Size of the motion, about, m.
    amplitude: f64,
    held: bool,
    rate_hz: f64,
    samples: usize,
    /// Noise of the position over the root mean square of the motion.
    noise: f64,
    /// Noise of the force over the root mean square of the drive: a random walk that is pulled back.
    shaken: f64,
    seed: u64,
}

const AXIS: Axis = Axis {
    mass: 2.0,
    damping: 12.0,
    stiffness: 1200.0,
    gain: 4.0,
    more: More::Nothing,
    amplitude: 0.01,
    held: true,
    rate_hz: 200.0,
    samples: 4000,
    noise: 0.01,
    shaken: 0.0,
    seed: 1,
};

/// Steps of the integration a sample.
const FINE: usize = 20;

impl Axis {
    fn own_rad_s(&self) -> f64 {
        (self.stiffness / self.mass).sqrt()
    }

    /// The force of friction, springs and damping beside the plain ones, and the next state of sliding.
    fn more(&self, x: f64, v: f64, z: f64, way: f64) -> (f64, f64) {
        let (a, w) = (self.amplitude, self.own_rad_s());
        let (force, xi, fast) = (self.stiffness * a, x / a, v / (a * w));
        match self.more {
            More::Nothing | More::Lag(_) => (0.0, 0.0),
            More::Spring(q, c) => (force * xi * xi * (q + c * xi), 0.0),
            More::Drag(d) => (force * d * fast * fast.abs(), 0.0),
            More::Stroke(l, q) => (force * xi * (l + q * xi) * fast, 0.0),
            More::Inertia(s) => (0.5 * self.mass * s / a * v * v, 0.0),
            More::Dry(f, s) => {
                let z = z + (way.signum() - z) * (1.0 - (-way.abs() / (s * a)).exp());
                (force * f * z, z)
            }
        }
    }

    /// Times, positions without noise and the input at the samples.
    fn run(&self) -> (Vec<f64>, Vec<f64>) {
        let mut generator = ChaCha12Rng::seed_from_u64(self.seed);
        let lines: Vec<(f64, f64)> = (0..14)
            .map(|i| {
                let f = self.own_rad_s() / TAU * (0.15 + 0.14 * f64::from(i));
                (TAU * f, generator.random_range(0.0..TAU))
            })
            .collect();
        let size = self.stiffness * self.amplitude / self.gain / 12.0;
        let drive = |t: f64| -> f64 {
            // from rest, within one period of the axis
            let begin = (t * self.own_rad_s() / TAU).min(1.0);
            size * begin * lines.iter().map(|(w, p)| (w * t + p).sin()).sum::<f64>()
        };
        let step = 1.0 / self.rate_hz;
        let h = step / FINE as f64;
        let (mut x, mut v, mut z, mut shake, mut lagged) = (0.0, 0.0, 0.0, 0.0_f64, 0.0);
        let (mut positions, mut inputs) = (Vec::new(), Vec::new());
        let spread = (2.0 * h * self.own_rad_s()).sqrt();
        for i in 0..self.samples {
            let t = i as f64 * step;
            positions.push(x);
            inputs.push(drive(t));
            for j in 0..FINE {
                let at = |half: f64| {
                    if self.held {
                        drive(t)
                    } else {
                        drive(t + h * (j as f64 + half))
                    }
                };
                let mut u = [at(0.0), at(0.5), at(1.0)];
                if let More::Lag(tau) = self.more {
                    let before = lagged;
                    lagged += (1.0 - (-h / tau).exp()) * (u[1] - lagged);
                    u = [before, 0.5 * (before + lagged), lagged];
                }
                let w: f64 = StandardNormal.sample(&mut generator);
                shake += -h * self.own_rad_s() * shake + spread * w;
                let push = self.shaken * size * self.gain * 2.6 * shake;
                let (start, state) = (x, z);
                let acceleration = |x: f64, v: f64, u: f64| {
                    let (more, _) = self.more(x, v, state, x - start);
                    let plain = self.damping * v + self.stiffness * x;
                    let mass = match self.more {
                        More::Inertia(s) => self.mass * (1.0 + s * x / self.amplitude),
                        _ => self.mass,
                    };
                    (self.gain * u + push - plain - more) / mass
                };
                let a1 = acceleration(x, v, u[0]);
                let a2 = acceleration(x + 0.5 * h * v, v + 0.5 * h * a1, u[1]);
                let a3 = acceleration(x + 0.5 * h * (v + 0.5 * h * a1), v + 0.5 * h * a2, u[1]);
                let a4 = acceleration(x + h * (v + 0.5 * h * a2), v + h * a3, u[2]);
                x += h * (v + h * (a1 + a2 + a3) / 6.0);
                v += h * (a1 + 2.0 * (a2 + a3) + a4) / 6.0;
                z = self.more(x, v, state, x - start).1;
            }
        }
        (positions, inputs)
    }

    fn line(&self, dir: &Path) -> Line {
        let (x, u) = self.run();
        let rms = (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
        let mut generator = ChaCha12Rng::seed_from_u64(self.seed + 1_000_000);
        let mut csv = String::from("t_s,x_m,u_V\n");
        for (i, (x, u)) in x.iter().zip(&u).enumerate() {
            let z: f64 = StandardNormal.sample(&mut generator);
            let t = i as f64 / self.rate_hz;
            writeln!(csv, "{t:.6},{:.9e},{u:.12e}", x + self.noise * rms * z).unwrap();
        }
        opened(dir, &format!("a{}", self.seed), self.gain, &csv)
    }

    /// What a fit should find: name, truth in the units of the outcome.
    fn truths(&self, outcome: &LineOutcome) -> Vec<(String, f64)> {
        let value = |name: &str| outcome.values.iter().find(|v| v.0 == name).unwrap().1;
        let (rest, largest) = (value("rest"), value("largest_coordinate"));
        let (a, w) = (self.amplitude, self.own_rad_s());
        let force = self.stiffness * a;
        let mut stiffness = self.stiffness;
        let mut damping = self.damping;
        let mut mass = self.mass;
        let mut out = Vec::new();
        match self.more {
            More::Nothing => {}
            More::Spring(q, c) => {
                // about the rest that the fit counts from
                let (q, c) = (force * q / a.powi(2), force * c / a.powi(3));
                stiffness += 2.0 * q * rest + 3.0 * c * rest * rest;
                out.push((
                    "x_nonlinear_stiffness.quadratic",
                    (q + 3.0 * c * rest) * largest.powi(2),
                ));
                out.push(("x_nonlinear_stiffness.cubic", c * largest.powi(3)));
            }
            More::Drag(d) => {
                out.push((
                    "x_quadratic_damping.coefficient",
                    force * d / (a * w).powi(2),
                ));
            }
            More::Dry(f, s) => {
                out.push(("joint_friction.force", force * f));
                out.push(("joint_friction.presliding", s * a));
            }
            More::Stroke(l, q) => {
                let (l, q) = (force * l / (a * a * w), force * q / (a.powi(3) * w));
                damping += l * rest + q * rest * rest;
                out.push(("x_stroke_damping.linear", (l + 2.0 * q * rest) * largest));
                out.push(("x_stroke_damping.quadratic", q * largest.powi(2)));
            }
            More::Lag(tau) => out.push(("x_drive_lag.time_constant", tau)),
            More::Inertia(s) => {
                mass += self.mass * s * rest / a;
                out.push(("x_stroke_inertia.coefficient", self.mass * s / a));
            }
        }
        let plain = [
            ("mass", mass),
            ("damping", damping),
            ("stiffness", stiffness),
        ];
        let all = plain.into_iter().chain(out);
        all.map(|(name, v)| (name.to_owned(), v)).collect()
    }
}

fn opened(dir: &Path, id: &str, gain: f64, csv: &str) -> Line {
    let own = dir.join(id);
    std::fs::create_dir_all(&own).unwrap();
    std::fs::write(own.join("data.csv"), csv).unwrap();
    let manifest = format!(
        "[recording]\nid = \"{id}\"\nkind = \"axis\"\n\n[axis]\nfile = \"data.csv\"\ntime = \"t_s\"\nposition = \"x_m\"\ninput = \"u_V\"\nunits = {{ time = \"s\", position = \"m\", input = \"V\" }}\nmass_kg = \"estimate\"\ndamping = \"estimate\"\nstiffness = \"estimate\"\ninput_gain = {gain}\n"
    );
    std::fs::write(own.join("recording.toml"), manifest).unwrap();
    Line::from_recording(&Recording::open(&own).unwrap()).unwrap()
}

fn asked(more: More) -> MotionRequest {
    MotionRequest {
        causes: more
            .id()
            .map_or(Causes::None, |id| Causes::These(vec![id.into()])),
        ..MotionRequest::default()
    }
}

fn choose(without: &[&str]) -> Causes {
    Causes::Choose {
        without: without.iter().map(|id| (*id).to_owned()).collect(),
    }
}

fn of<'a>(outcome: &'a LineOutcome, name: &str) -> &'a Estimate {
    outcome.estimates.iter().find(|e| e.name == name).unwrap()
}

fn model(outcome: &LineOutcome) -> LineModel {
    LineModel {
        values: outcome.values.clone(),
        effects: outcome.causes.iter().map(|c| c.acting.clone()).collect(),
        ..LineModel::default()
    }
}

/// Without noise everything is found, whatever is at work, and the motion comes out again.
#[test]
fn quiet_axes_are_found_to_a_thousandth() {
    let dir = tempfile::tempdir().unwrap();
    let causes = [
        More::Nothing,
        More::Spring(0.1, 0.25),
        More::Drag(0.05),
        More::Dry(0.04, 0.05),
        More::Stroke(0.03, 0.06),
        More::Lag(0.01),
        More::Inertia(0.2),
    ];
    for (i, more) in causes.into_iter().enumerate() {
        let axis = Axis {
            more,
            held: i % 2 == 0,
            noise: 1e-5,
            seed: 10 + i as u64,
            ..AXIS
        };
        let line = axis.line(dir.path());
        let fit = calibrate_motion(std::slice::from_ref(&line), &asked(more)).unwrap();
        let way = if axis.held {
            Between::Held
        } else {
            Between::Smooth
        };
        // a lag acts at the samples, and what lies between them is another question
        if !matches!(more, More::Lag(_)) {
            assert_eq!(fit.between, way, "{more:?} {:?}", fit.compared);
        }
        // friction and a lag are stepped through at the samples of their own clock
        let near = if matches!(more, More::Dry(..) | More::Lag(_)) {
            0.05
        } else {
            1e-3
        };
        for (name, truth) in axis.truths(&fit.outcome) {
            let e = of(&fit.outcome, &name);
            assert!(
                (e.value / truth - 1.0).abs() < near,
                "{more:?} {name} {} {truth}",
                e.value
            );
        }
        let again = predict_line_motion(&line, &model(&fit.outcome), 0).unwrap();
        let range = line.x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(
            again.rmse < 5e-3 * range,
            "{more:?}: {} of {range}",
            again.rmse
        );
    }
}

/// One of 200: parameters, cause, noise of the sensor, and in a third of them a force that shakes.
fn drawn(seed: u64) -> Axis {
    let mut g = ChaCha12Rng::seed_from_u64(0x6178_6573 + seed);
    let mut log = |low: f64, high: f64| (g.random_range(low.ln()..high.ln())).exp();
    let mass = log(0.2, 5.0);
    let own = TAU * log(2.0, 6.0);
    let damping = 2.0 * log(0.04, 0.4) * mass * own;
    let noise = log(0.001, 0.05);
    let amplitude = log(0.002, 0.05);
    let (a, b) = (log(0.03, 0.2), log(0.05, 0.3));
    let more = match seed % 6 {
        0 => More::Nothing,
        1 => More::Spring(a, b),
        2 => More::Drag(a),
        3 => More::Dry(0.5 * a, 0.1),
        4 => More::Stroke(a, b),
        _ => More::Spring(-0.5 * a, b),
    };
    Axis {
        mass,
        damping,
        stiffness: mass * own * own,
        gain: log(0.5, 20.0),
        more,
        amplitude,
        held: seed.is_multiple_of(2),
        rate_hz: 200.0,
        samples: 4000,
        noise,
        shaken: if seed.is_multiple_of(3) { 0.03 } else { 0.0 },
        seed: 5000 + seed,
    }
}

/// Intervals that hold, of how many; by name those of 95 %.
fn coverage(seeds: std::ops::Range<u64>) -> (usize, usize) {
    use rayon::prelude::*;
    let dir = tempfile::tempdir().unwrap();
    let found: Vec<Vec<(String, f64)>> = seeds
        .into_par_iter()
        .map(|seed| {
            let axis = drawn(seed);
            let fit = calibrate_motion(&[axis.line(dir.path())], &asked(axis.more)).unwrap();
            let off = |(name, truth): (String, f64)| {
                let e = of(&fit.outcome, &name);
                let z = (e.value - truth) / e.std_error;
                if z.abs() > 4.0 {
                    println!(
                        "{axis:?}: {name} {} +- {} truth {truth}",
                        e.value, e.std_error
                    );
                }
                (name, z)
            };
            axis.truths(&fit.outcome).into_iter().map(off).collect()
        })
        .collect();
    let mut names: std::collections::BTreeMap<String, [usize; 2]> = Default::default();
    for (name, z) in found.iter().flatten() {
        let n = names.entry(name.clone()).or_default();
        n[0] += usize::from(z.abs() <= 1.96);
        n[1] += 1;
    }
    for (name, [held, all]) in &names {
        println!("{name}: {held} of {all}");
    }
    let total = names.values().fold((0, 0), |t, n| (t.0 + n[0], t.1 + n[1]));
    println!("{} of {} intervals hold", total.0, total.1);
    total
}

#[test]
fn intervals_of_named_causes_hold() {
    let (held, all) = coverage(0..12);
    // of 95 %: fewer would happen once in a thousand
    assert!(held * 100 >= 83 * all, "{held} of {all}");
}

/// `cargo test --release --test diagnosis intervals -- --ignored --nocapture`
#[test]
#[ignore = "200 axes: minutes"]
fn intervals_of_two_hundred_axes_hold() {
    let (held, all) = coverage(0..200);
    let share = held as f64 / all as f64;
    assert!((0.92..=0.97).contains(&share), "{share}");
}

/// Mean error over the standard error of one fit: of the balance, and of the motion; mass and damping.
fn biases(noise: f64, count: u64) -> [[f64; 2]; 2] {
    use rayon::prelude::*;
    let dir = tempfile::tempdir().unwrap();
    let each: Vec<[[f64; 2]; 2]> = (0..count)
        .into_par_iter()
        .map(|seed| {
            let axis = Axis {
                noise,
                seed: 9000 + seed,
                ..AXIS
            };
            let lines = [axis.line(dir.path())];
            let balance = calibrate_lines(&lines, &LineRequest::default()).unwrap();
            let motion = calibrate_motion(&lines, &asked(More::Nothing)).unwrap();
            [&balance, &motion.outcome].map(|o| {
                [("mass", axis.mass), ("damping", axis.damping)].map(|(name, truth)| {
                    let e = of(o, name);
                    (e.value - truth) / e.std_error
                })
            })
        })
        .collect();
    let n = each.len() as f64;
    let mean = [0, 1].map(|fit| [0, 1].map(|p| each.iter().map(|e| e[fit][p]).sum::<f64>() / n));
    println!(
        "noise {noise}: balance {:.2?}, motion {:.2?} standard errors",
        mean[0], mean[1]
    );
    mean
}

#[test]
fn noise_shortens_nothing_of_a_fit_to_the_motion() {
    let [balance, motion] = biases(0.05, 12);
    // the mean of 12 scatters by 0.29 of a standard error
    assert!(motion.iter().all(|b| b.abs() < 1.0), "{motion:?}");
    assert!(balance.iter().any(|b| b.abs() > 3.0), "{balance:?}");
}

/// `cargo test --release --test diagnosis bias -- --ignored --nocapture`
#[test]
#[ignore = "three times 120 axes: minutes"]
fn bias_is_below_a_third_of_a_standard_error() {
    for noise in [0.001, 0.01, 0.05] {
        let [_, motion] = biases(noise, 120);
        assert!(
            motion.iter().all(|b| b.abs() < 1.0 / 3.0),
            "{noise}: {motion:?}"
        );
    }
}

#[test]
fn causes_are_chosen_by_what_they_foretell() {
    let dir = tempfile::tempdir().unwrap();
    for (i, more) in [More::Nothing, More::Spring(0.1, 0.25), More::Drag(0.15)]
        .into_iter()
        .enumerate()
    {
        let axis = Axis {
            more,
            seed: 300 + i as u64,
            ..AXIS
        };
        let request = MotionRequest {
            causes: choose(&[]),
            ..MotionRequest::default()
        };
        let fit = calibrate_motion(&[axis.line(dir.path())], &request).unwrap();
        let found: Vec<&str> = fit
            .outcome
            .causes
            .iter()
            .map(|c| c.acting.effect.id())
            .collect();
        let wanted: Vec<&str> = more.id().into_iter().collect();
        assert_eq!(found, wanted, "{:?}", fit.tried);
        let (rmse, _, _, noise) = fit.outcome.total();
        assert!((0.9..1.1).contains(&(rmse / noise)), "{rmse} {noise}");
    }
}

/// From rest nothing of the motion is read, to the bit; with a beginning nothing but that.
#[test]
fn a_predicted_motion_reads_nothing_of_what_it_predicts() {
    let dir = tempfile::tempdir().unwrap();
    let axis = Axis {
        more: More::Dry(0.04, 0.05),
        ..AXIS
    };
    let own = axis.line(dir.path());
    let mut other = own.clone();
    for (i, x) in other.x.iter_mut().enumerate().skip(own.captured.start + 60) {
        *x += 0.003 * (0.07 * i as f64).sin();
    }
    let mut another = other.clone();
    another.x.iter_mut().for_each(|x| *x *= -0.5);
    let fit = calibrate_motion(std::slice::from_ref(&own), &asked(axis.more)).unwrap();
    let model = model(&fit.outcome);
    let bits = |line: &Line, begin: usize| -> Vec<u64> {
        let made = predict_line_motion(line, &model, begin).unwrap().predicted;
        made.iter().map(|x| x.to_bits()).collect()
    };
    assert!(bits(&own, 0) == bits(&other, 0));
    assert!(bits(&own, 0) == bits(&another, 0));
    assert!(bits(&own, 60) == bits(&other, 60));
    assert!(bits(&own, 60) != bits(&another, 60));
}

/// A fit by the motion and a prediction of it answer before anything else, in the same words.
#[test]
fn a_fit_and_a_prediction_answer_first() {
    let dir = tempfile::tempdir().unwrap();
    let axis = Axis {
        more: More::Spring(0.1, 0.25),
        seed: 77,
        ..AXIS
    };
    axis.line(dir.path());
    let (recording, out) = (dir.path().join("a77"), dir.path().join("out"));
    let said = |words: &[&str], paths: [&Path; 2]| {
        let done = common::run(|d| d.args(words).arg(paths[0]).arg("-o").arg(paths[1]));
        let text = String::from_utf8(done).unwrap();
        text.lines().take(5).collect::<Vec<_>>().join("\n")
    };
    let spring = "x_nonlinear_stiffness";
    let fit = ["fit", "axis", "--objective", "motion", "--cause", spring];
    let fit = said(&fit, [&recording, &out]);
    assert!(fit.starts_with("Mass "), "{fit}");
    assert!(
        fit.contains(", with nonlinear stiffness; the motion is met within "),
        "{fit}"
    );
    let params = out.join("parameters.toml");
    let predict = ["predict", "motion", "--params", params.to_str().unwrap()];
    let predict = said(&predict, [&recording, &dir.path().join("x.csv")]);
    assert!(
        predict.starts_with("The motion is predicted within "),
        "{predict}"
    );
    assert!(
        predict.contains("samples predicted, from rest."),
        "{predict}"
    );
}

fn silverbox(name: &str) -> Line {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fits/silverbox2013_official")
        .join(name);
    Line::from_recording(&Recording::open(&folder).unwrap()).unwrap()
}

/// What stands in the published table (Champneys et al., arXiv 2405.10779, 2024), mV.
const PUBLISHED: [(&str, [f64; 3]); 3] = [
    ("linear", [6.96, 14.4, 6.58]),
    ("best of ten baselines", [0.301, 0.60, 0.259]),
    ("SUBNET", [0.36, 1.4, 0.32]),
];
const TESTS: [&str; 3] = ["multisine", "arrow", "arrow_inside"];

/// Errors of a model on the three tests, the first 50 samples telling where each begins, mV.
fn errors_mv(fit: &LineOutcome) -> [f64; 3] {
    let model = model(fit);
    TESTS.map(|name| {
        let r = predict_line_motion(&silverbox(name), &model, 50).unwrap();
        r.rmse * 1e3
    })
}

/// The public table of the silverbox, its official split: everything is fitted and chosen on the training
/// multisines. `cargo test --release --test diagnosis silverbox -- --ignored --nocapture`
#[test]
#[ignore = "65,062 samples: ten seconds and more"]
fn silverbox_in_the_public_table() {
    println!("errors in mV, {}:", TESTS.join(" / "));
    for (name, of) in PUBLISHED {
        println!("  {name}: {of:?}");
    }
    let given = ["x_nonlinear_stiffness", "x_quadratic_damping"];
    for (what, causes) in [
        ("chosen", choose(&[])),
        ("given", Causes::These(given.map(str::to_owned).to_vec())),
    ] {
        let started = std::time::Instant::now();
        let train = [silverbox("train")];
        assert_eq!(train[0].samples(), 65_062);
        let request = MotionRequest {
            causes: causes.clone(),
            ..MotionRequest::default()
        };
        let fit = calibrate_motion(&train, &request).unwrap();
        let fitted = started.elapsed().as_secs_f64();
        let errors = errors_mv(&fit.outcome);
        let seconds = started.elapsed().as_secs_f64();
        let names = fit.outcome.causes.iter().map(|c| c.acting.effect.id());
        let names: Vec<&str> = names.collect();
        println!("  {what} {names:?}: {errors:.4?}, {seconds:.1} s, the fit {fitted:.1} s");
        println!(
            "{} ({} evaluations)",
            fit.outcome.verdict, fit.outcome.evaluations
        );
        for remark in &fit.outcome.remarks {
            println!("{remark}");
        }
        for e in &fit.outcome.estimates {
            println!(
                "{} = {:.6e} +- {:.1e} {}",
                e.name, e.value, e.std_error, e.unit
            );
        }
        // the worse of the two as measured, and no more than a hundredth of it
        for (error, bar) in errors.iter().zip([0.240, 0.313, 0.246]) {
            assert!(*error <= bar, "{errors:?}");
        }
    }
}

/// The same on the first of the training multisines: the causes are the same.
#[test]
fn a_part_of_the_silverbox_names_its_spring() {
    let mut train = silverbox("train");
    let n = 9000;
    train.time_s.truncate(n);
    train.x.truncate(n);
    train.usable.truncate(n);
    train.captured = 0..n;
    if let deacal::dataset::line::Measured::Axis(a) = &mut train.measured {
        a.input_time_s.truncate(n);
        a.input.truncate(n);
    }
    let request = MotionRequest {
        causes: choose(&[]),
        between: Some(Between::Smooth),
        ..MotionRequest::default()
    };
    let fit = calibrate_motion(&[train], &request).unwrap();
    let causes = fit.outcome.causes.iter().map(|c| c.acting.effect.id());
    assert!(
        causes.clone().any(|c| c == "x_nonlinear_stiffness"),
        "{:?}",
        fit.tried
    );
    let errors = errors_mv(&fit.outcome);
    // the best of ten published baselines
    assert!(errors[0] < 0.301 && errors[1] < 0.60, "{errors:?}");
}
