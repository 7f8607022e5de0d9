//! What a calibration is for: films that differ by a fifth are recorded, fitted, and driven along a circle
//! with the voltages that the fitted parameters ask for. The true robot must follow.
//!
//! Two films by default; `DEACAL_TRIALS=20 cargo test --release --test fit identification:: -- --nocapture`
//! is the long proof.

use crate::common;

use std::ops::ControlFlow;

use common::recordings::{film, recording as long_recording};
use common::{golden, parameters, robot};
use deacal::calibration::{Request, Stage, calibrate_robot};
use deacal::dataset::{Dataset, Parts, StretchPlan, Voltage, stretches};
use deacal::film::InitialState;
use deacal::model::{Parameters, Robot};
use deacal::residual::{RobotResidual, SeparableResidual, frames_apart};
use deacal::simulate::{Circle, Drive, Options, Payload, motion, predict_motions, rest};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

/// Diameter of the circle, m.
const DIAMETER_M: f64 = 10e-3;
/// White noise of the capture, m.
const NOISE_M: f64 = 3e-5;

/// Film and forearm, each number of the film about a fifth off.
fn truth(nominal: &Parameters, generator: &mut ChaCha12Rng) -> Parameters {
    let mut vary = |value: &mut f64| {
        let z: f64 = StandardNormal.sample(generator);
        *value *= (0.2 * z).exp();
    };
    let mut out = nominal.clone();
    out.film.mu_pa.iter_mut().for_each(&mut vary);
    out.film.relaxation_time_s.iter_mut().for_each(&mut vary);
    vary(&mut out.film.locking);
    out
}

/// The paper's calibration drive: `peak_v` at 1/3 Hz, captured at 100 Hz.
fn recording(
    robot: &Robot,
    truth: &Parameters,
    (id, peak_v, duration_s): (&str, [f64; 3], f64),
    generator: &mut ChaCha12Rng,
) -> Dataset {
    let drive = Drive::Sine {
        peak_v,
        frequency_hz: 1.0 / 3.0,
        phase_rad: [0.0; 3],
    };
    let voltage = drive.sampled(duration_s, 1000.0).unwrap();
    let options = Options {
        duration_s,
        ..Options::default()
    };
    let m = motion(robot, truth, &voltage, &options, &[]).unwrap();
    let mut noisy = |u: &[f64; 3]| {
        u.map(|v| {
            let z: f64 = StandardNormal.sample(generator);
            v + NOISE_M * z
        })
    };
    let measured_m: Vec<[f64; 3]> = m.position_m.iter().map(&mut noisy).collect();
    let samples = voltage.samples_v();
    let time_s = (0..samples.len()).map(|i| i as f64 * 1e-3).collect();
    let channel = |k: usize| samples.iter().map(|p| p[k]).collect();
    let parts = Parts {
        id: id.into(),
        step_s: 0.01,
        start_s: 0.0,
        payload_kg: vec![0.0; measured_m.len()],
        measured_m,
        voltage: Voltage::new(time_s, vec![channel(0), channel(1), channel(2)], false),
        monitor: None,
        offset_s: Some(0.0),
        initial: InitialState::Relaxed,
    };
    Dataset::new(parts, None).unwrap()
}

/// Root mean square of x, y, z and of the distance from the plan while the true robot goes round, m.
fn tracking(
    robot: &Robot,
    truth: &Parameters,
    fitted: &Parameters,
    period_s: f64,
    payload_kg: f64,
) -> [f64; 4] {
    let turns = 3.0;
    let move_s = 3.0;
    let top = rest(robot, truth, [0.0; 3], payload_kg, &[]).unwrap();
    let circle = Circle {
        radius_m: 0.5 * DIAMETER_M,
        height_m: top.position_m[2] - 18e-3,
        period_s,
        turns,
        move_s,
    };
    let plan = circle
        .drive(robot, fitted, payload_kg, 1000.0, 6500.0)
        .unwrap();
    let options = Options {
        duration_s: plan.voltage.duration_s(),
        payload: Payload::constant(payload_kg),
        ..Options::default()
    };
    let m = motion(robot, truth, &plan.voltage, &options, &[]).unwrap();
    let mut sum = [0.0; 4];
    let mut count = 0.0;
    for (i, u) in m.position_m.iter().enumerate() {
        if i as f64 * 0.01 < 2.0 * move_s {
            continue;
        }
        let planned = plan.path.position_m[10 * i];
        for j in 0..3 {
            let d = (u[j] - planned[j]).powi(2);
            sum[j] += d;
            sum[3] += d;
        }
        count += 1.0;
    }
    sum.map(|s| (s / count).sqrt())
}

#[test]
fn voltages_from_a_fit_lead_the_true_film_along_a_circle() {
    let trials: usize = std::env::var("DEACAL_TRIALS")
        .ok()
        .and_then(|t| t.parse().ok())
        .unwrap_or(2);
    let g = golden("forward_dynamics");
    let (robot, nominal) = (robot(&g["rig"]), parameters(&g));
    let results: Vec<Vec<[f64; 4]>> = (0..trials)
        .into_par_iter()
        .map(|trial| {
            let mut generator = ChaCha12Rng::seed_from_u64(70_000 + trial as u64);
            let truth = truth(&nominal, &mut generator);
            let peak = 5000.0;
            let datasets = [
                ("symmetric", [peak; 3], 60.0),
                ("single-1", [peak, 0.0, 0.0], 30.0),
                ("single-2", [0.0, peak, 0.0], 30.0),
                ("single-3", [0.0, 0.0, peak], 30.0),
            ]
            .map(|drive| recording(&robot, &truth, drive, &mut generator));
            let refs: Vec<&Dataset> = datasets.iter().collect();
            let request = Request {
                starts: 3,
                ..Request::new(Stage::Robot)
            };
            let watch = |_: &deacal::fit::separable::State| ControlFlow::Continue(());
            let fitted = calibrate_robot(&robot, &refs, &request, &watch)
                .unwrap()
                .parameters;
            let cases = [(3.0, 0.0), (3.0, 2e-3), (8.0, 0.0), (8.0, 2e-3)];
            cases
                .iter()
                .map(|&(period, payload)| tracking(&robot, &truth, &fitted, period, payload))
                .collect()
        })
        .collect();
    let mut worst = [0.0_f64; 4];
    for (trial, cases) in results.iter().enumerate() {
        for (case, rms) in cases.iter().enumerate() {
            let share = rms.map(|v| 100.0 * v / DIAMETER_M);
            let name = ["3 s, 0 g", "3 s, 2 g", "8 s, 0 g", "8 s, 2 g"][case];
            println!(
                "film {trial:2}, {name}: x {:.3} %, y {:.3} %, z {:.3} %, distance {:.3} % of the diameter rms",
                share[0], share[1], share[2], share[3]
            );
            for j in 0..4 {
                worst[j] = worst[j].max(share[j]);
            }
        }
    }
    println!(
        "worst of {trials} films: x {:.3} %, y {:.3} %, z {:.3} %, distance {:.3} %",
        worst[0], worst[1], worst[2], worst[3]
    );
    assert!(worst[3] < 0.5, "{worst:?} % of the diameter");
}

#[test]
fn a_motion_captured_again_is_smoothed_as_the_first_time() {
    let g = golden("forward_dynamics");
    let (robot, nominal) = (robot(&g["rig"]), parameters(&g));
    let mut generator = ChaCha12Rng::seed_from_u64(71);
    let drive = ("again", [5000.0, 4000.0, 3000.0], 12.0);
    let d = recording(&robot, &nominal, drive, &mut generator);
    let (own, dice) = (d.track(), ChaCha12Rng::seed_from_u64(72));
    let again = |times| d.retaken_track(&d.measured_m, &mut dice.clone(), times);
    let (silent, plus, minus) = (again(0.0), again(1.0), again(-1.0));
    let (silent, plus, minus) = (silent.unwrap(), plus.unwrap(), minus.unwrap());
    let n = d.samples();
    let mut noise = 0.0;
    for i in 0..n {
        for k in 0..3 {
            assert!((silent.position_m[i][k] - own.position_m[i][k]).abs() < 1e-12);
            assert!((silent.acceleration_m_s2[i][k] - own.acceleration_m_s2[i][k]).abs() < 1e-6);
            let mean = 0.5 * (plus.position_m[i][k] + minus.position_m[i][k]);
            assert!((mean - own.position_m[i][k]).abs() < 1e-12);
            noise += (plus.position_m[i][k] - own.position_m[i][k]).powi(2) / (3 * n) as f64;
        }
    }
    // what smoothing leaves of the noise
    let left = noise.sqrt() / NOISE_M;
    assert!((0.1..0.9).contains(&left), "{left}");
    // a motion that is known nowhere has no track
    let nowhere = vec![[f64::NAN; 3]; n];
    assert!(d.retaken_track(&nowhere, &mut generator, 1.0).is_none());
}

#[test]
fn scores_of_a_simulated_recording_have_the_mean_that_its_model_says() {
    // The score at the truth, over recordings that differ in their noise, against what is told from the model
    // alone.
    let g = golden("forward_dynamics");
    let (robot, nominal) = (robot(&g["rig"]), parameters(&g));
    let mut generator = ChaCha12Rng::seed_from_u64(73);
    let drive = ("score", [5000.0, 4000.0, 3000.0], 12.0);
    let recordings: Vec<Dataset> = (0..24)
        .map(|_| recording(&robot, &nominal, drive, &mut generator))
        .collect();
    let forearm = &nominal.forearm;
    let film = &nominal.film;
    let eta: Vec<f64> = (film.relaxation_time_s.iter().map(|t| t.ln()))
        .chain([1.0 / film.locking])
        .collect();
    let beta: Vec<f64> = [&film.mu_pa[..], forearm.torque_n_m()].concat();
    let mut scores = Vec::new();
    let mut told = None;
    for d in &recordings {
        let mut residual = RobotResidual::new(&robot, &[d], eta.len() - 1, forearm).unwrap();
        residual.weigh(&eta, &beta).unwrap();
        let gram = residual.evaluate(&eta, &beta).unwrap().at(eta.len(), &beta);
        let size = eta.len() + beta.len();
        scores.push(gram.column(size).rows(0, size).into_owned());
        if told.is_none() {
            let series = residual.series();
            let motions = predict_motions(&robot, &[d], &nominal, &|_| 0.0, &[], &series).unwrap();
            told = residual
                .expected_score(Some(&motions), &eta, &beta, 12)
                .unwrap();
        }
    }
    let told = told.unwrap();
    assert!(told.simulated && told.draws.len() == 12);
    let count = scores.len() as f64;
    for i in 0..eta.len() + beta.len() {
        let mean = scores.iter().map(|s| s[i]).sum::<f64>() / count;
        let variance = scores.iter().map(|s| (s[i] - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let drawn = told.draws.iter().map(|s| s[i] * s[i]).sum::<f64>() / 12.0;
        let off = (mean - told.mean[i]).abs() / (variance / count).sqrt();
        assert!(
            off < 4.5,
            "unknown {i}: {mean} and {} ({off})",
            told.mean[i]
        );
        let ratio = drawn / variance;
        assert!(
            (0.2..5.0).contains(&ratio),
            "unknown {i}: variance {ratio} of the true one"
        );
    }
}

/// Behind the residual's low-pass every so many-th frame tells what all do: the same voltages within a tenth of
/// the noise, the same noise, and as much of every parameter.
#[test]
fn every_second_frame_tells_what_all_do() {
    let robot = robot(&golden("inverse_dynamics")["rig"]);
    let mut generator = ChaCha12Rng::seed_from_u64(32);
    let film = film(&mut generator);
    let whole = long_recording(&robot, &film, &mut generator, 40.0, Some(0.0));
    assert_eq!(frames_apart(&whole), 2);
    let part = whole.thinned(2).into_owned();
    assert_eq!(part.samples(), whole.samples().div_ceil(2));
    let beta: Vec<f64> = film.mu_pa.iter().copied().chain([0.0; 7]).collect();
    let mut eta: Vec<f64> = film.relaxation_time_s.iter().map(|t| t.ln()).collect();
    eta.push(1.0 / film.locking);
    let told = |d: &Dataset| {
        let forearm = deacal::model::ForearmTorque::zero();
        let mut residual = RobotResidual::new(&robot, &[d], film.branches(), &forearm).unwrap();
        residual.weigh(&eta, &beta).unwrap();
        let gram = residual.evaluate(&eta, &beta).unwrap().at(eta.len(), &beta);
        let size = eta.len() + film.mu_pa.len();
        let each: Vec<f64> = (0..size).map(|i| gram[(i, i)].sqrt()).collect();
        (residual.voltage_error(0, &eta, &beta).unwrap(), each)
    };
    let ((of_whole, by_all), (of_part, by_part)) = (told(&whole), told(&part));
    let (mut squares, mut sd, mut count) = (0.0, [0.0; 2], 0.0);
    for i in 0..part.samples() {
        assert_eq!(part.time_s(i), whole.time_s(2 * i));
        assert_eq!(part.measured_m[i], whole.measured_m[2 * i]);
        for k in (0..3).filter(|&k| of_part.counts[i] && of_part.command_v[i][k] > 1000.0) {
            let volts = |e: &deacal::residual::VoltageError, i: usize| {
                e.predicted_squared_v2[i][k].max(0.0).sqrt()
            };
            let noise = of_whole.sd_v[2 * i][k];
            squares += ((volts(&of_part, i) - volts(&of_whole, 2 * i)) / noise).powi(2);
            sd = [sd[0] + noise, sd[1] + of_part.sd_v[i][k]];
            count += 1.0;
        }
    }
    let off = (squares / count).sqrt();
    assert!(count > 1000.0 && off < 0.1, "{count} {off}");
    assert!((sd[1] / sd[0] - 1.0).abs() < 0.05, "{sd:?}");
    for (i, (all, part)) in by_all.iter().zip(&by_part).enumerate() {
        assert!((part / all - 1.0).abs() < 0.1, "unknown {i}: {part} {all}");
    }
}

/// A long recording that is compared in stretches: the film has gone through all of it, to the bit.
#[test]
fn stretches_of_a_recording_have_the_films_whole_history() {
    let robot = robot(&golden("inverse_dynamics")["rig"]);
    let mut generator = ChaCha12Rng::seed_from_u64(31);
    let film = film(&mut generator);
    let mut whole = long_recording(&robot, &film, &mut generator, 90.0, Some(0.0));
    assert_eq!(
        stretches(&[&whole]),
        [None],
        "a short recording is taken whole"
    );
    let beta: Vec<f64> = film.mu_pa.iter().copied().chain([0.0; 7]).collect();
    let mut eta: Vec<f64> = film.relaxation_time_s.iter().map(|t| t.ln()).collect();
    eta.push(1.0 / film.locking);
    for initial in [InitialState::Relaxed, InitialState::Virgin] {
        whole.initial = initial;
        let plan = StretchPlan {
            count: 4,
            length_s: 8.0,
        };
        let part = whole.in_stretches(plan);
        assert_eq!((part.samples(), part.plan.stretches), (3200, Some(plan)));
        assert_eq!(part.length_s(), whole.length_s());
        let error = |d: &Dataset| {
            let forearm = deacal::model::ForearmTorque::zero();
            let residual = RobotResidual::new(&robot, &[d], film.branches(), &forearm).unwrap();
            (
                residual.voltage_error(0, &eta, &beta).unwrap(),
                residual.rows(),
            )
        };
        let ((of_whole, _), (of_part, rows)) = (error(&whole), error(&part));
        let mut counted = 0;
        for i in 0..part.samples() {
            let at = ((part.time_s(i) - whole.start_s) / whole.step_s).round() as usize;
            assert_eq!(part.time_s(i), whole.time_s(at));
            assert_eq!(part.measured_m[i], whole.measured_m[at]);
            let squared = |e: &deacal::residual::VoltageError, i: usize| e.predicted_squared_v2[i];
            assert_eq!(
                squared(&of_part, i),
                squared(&of_whole, at),
                "{initial:?} {i}"
            );
            for k in 0..3 {
                let apart = of_part.command_v[i][k] - of_whole.command_v[at][k];
                assert!(apart.abs() < 1e-6, "{i}: {apart} V");
            }
            counted += usize::from(of_part.counts[i]);
        }
        // all but 0.3 s at both ends of the recording and the first frame of the three further stretches
        assert_eq!(counted, 3200 - 60 - 3);
        // four stretches of 93 windows: none reaches over a seam
        assert!((4 * 3 * 88..=4 * 3 * 93).contains(&rows), "{rows}");
    }
}

/// Times far longer than a stretch are found from stretches: they show in what the film remembers.
#[test]
fn times_longer_than_a_stretch_are_found_from_stretches() {
    let robot = robot(&golden("inverse_dynamics")["rig"]);
    let mut generator = ChaCha12Rng::seed_from_u64(32);
    let film = film(&mut generator);
    let whole = long_recording(&robot, &film, &mut generator, 800.0, Some(0.0));
    let part = whole.in_stretches(StretchPlan {
        count: 10,
        length_s: 20.0,
    });
    let request = Request {
        starts: 1,
        ..Request::new(Stage::Film)
    };
    let fit = |d: &Dataset| {
        let watch = |_: &deacal::fit::separable::State| ControlFlow::Continue(());
        calibrate_robot(&robot, &[d], &request, &watch).unwrap()
    };
    let o = fit(&part);
    assert!(
        o.total.rmse_v < 1.25 * o.total.noise_floor_v,
        "{}",
        o.verdict
    );
    let mut found = 0;
    for (i, truth) in film.relaxation_time_s.iter().enumerate() {
        let e = o
            .estimates
            .iter()
            .find(|e| e.name == format!("T_{}", i + 1))
            .unwrap();
        println!(
            "{} {:.4} +- {:.4} s, true {truth:.4} s: {}",
            e.name, e.value, e.std_error, e.says
        );
        assert!(
            (e.value / truth).ln().abs() < 4.0 * e.std_error / e.value,
            "{e:?} {truth}"
        );
        found += usize::from(e.identifiable);
    }
    let slowest = o.estimates.iter().find(|e| e.name == "T_6").unwrap();
    assert!(
        slowest.identifiable && slowest.value > 5.0 * 20.0,
        "{slowest:?}"
    );
    assert!(found >= 5, "{found} of 6 are determined");
}
