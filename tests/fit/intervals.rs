//! 95 % intervals hold the truth in about 95 % of simulated recordings of known films, for every parameter
//! that is called identifiable; and what is well determined at the truth is called so.
//!
//! 40 recordings by default; `DEACAL_TRIALS=500 cargo test --release --test fit intervals:: -- --nocapture`
//! is the long proof.

use crate::common;

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use common::recordings::{film, recording};
use common::{golden, robot};
use deacal::calibration::{Outcome, Request, Stage, Uncertainty, calibrate_robot};
use deacal::dataset::Dataset;
use deacal::film::Film;
use deacal::model::{ForearmTorque, Robot};
use deacal::residual::{RobotResidual, SeparableResidual};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;

fn truth_of(film: &Film, name: &str) -> Option<f64> {
    let number = |p: &str| name.strip_prefix(p).and_then(|n| n.parse::<usize>().ok());
    if name == "J" {
        Some(film.locking)
    } else if let Some(n) = number("mu_") {
        Some(film.mu_pa[n - 1])
    } else {
        number("T_").map(|n| film.relaxation_time_s[n - 1])
    }
}

/// Relative standard errors that the recording promises at the truth, without anything known beforehand.
fn expected_errors(robot: &Robot, dataset: &Dataset, film: &Film) -> BTreeMap<String, f64> {
    let datasets = [dataset];
    let mut residual = RobotResidual::new(robot, &datasets, 6, &ForearmTorque::zero()).unwrap();
    let mut eta: Vec<f64> = film.relaxation_time_s.iter().map(|t| t.ln()).collect();
    eta.push(1.0 / film.locking);
    let mut beta = film.mu_pa.clone();
    beta.extend([0.0; 7]);
    residual.weigh(&eta, &beta).unwrap();
    let gram = residual.evaluate(&eta, &beta).unwrap().at(eta.len(), &beta);
    let scores = residual.score_covariance(&eta, &beta).unwrap();
    let size = scores.nrows();
    let free: Vec<bool> = (0..size).map(|i| i < 14).collect();
    let gram = gram.view((0, 0), (size, size)).into_owned();
    let u = Uncertainty::new(&gram, &scores, &vec![0.0; size], &free);
    let mut out = BTreeMap::new();
    for i in 0..6 {
        out.insert(format!("T_{}", i + 1), u.std_error(i));
    }
    out.insert("J".into(), u.std_error(6) * film.locking);
    for i in 0..7 {
        out.insert(format!("mu_{}", i + 1), u.std_error(7 + i) / film.mu_pa[i]);
    }
    out
}

#[test]
fn intervals_hold_the_truth() {
    let trials: usize = std::env::var("DEACAL_TRIALS")
        .ok()
        .and_then(|t| t.parse().ok())
        .unwrap_or(40);
    let robot = robot(&golden("kinematics")["rig"]);
    let results: Vec<(Film, Outcome, BTreeMap<String, f64>)> = (0..trials)
        .into_par_iter()
        .map(|trial| {
            let mut generator = ChaCha12Rng::seed_from_u64(900_000 + trial as u64);
            let film = film(&mut generator);
            let dataset = recording(&robot, &film, &mut generator, 60.0, Some(0.0));
            let request = Request {
                starts: 3,
                ..Request::new(Stage::Film)
            };
            let watch = |_: &deacal::fit::separable::State| ControlFlow::Continue(());
            let expected = expected_errors(&robot, &dataset, &film);
            let outcome = calibrate_robot(&robot, &[&dataset], &request, &watch).unwrap();
            (film, outcome, expected)
        })
        .collect();
    let (mut held, mut called) = (0, 0);
    let (mut sure, mut sure_called) = (0, 0);
    println!("parameter  called  held  | all: held  median z  rms z  median relative error bar");
    for estimate in results[0].1.estimates.iter().map(|e| e.name.clone()) {
        let mut z = Vec::new();
        let mut bars = Vec::new();
        let (mut own_called, mut own_held, mut all_held) = (0, 0, 0);
        for (film, outcome, expected) in &results {
            let Some(truth) = truth_of(film, &estimate) else {
                continue;
            };
            let e = outcome
                .estimates
                .iter()
                .find(|e| e.name == estimate)
                .unwrap();
            let inside = e.ci95[0] <= truth && truth <= e.ci95[1];
            all_held += usize::from(inside);
            if expected[&estimate] < 0.2 {
                sure += 1;
                sure_called += usize::from(e.identifiable);
            }
            if e.identifiable {
                own_called += 1;
                own_held += usize::from(inside);
            }
            if e.std_error.is_finite() {
                z.push((e.value - truth) / e.std_error);
                bars.push(e.std_error / e.value.abs());
            }
        }
        if z.is_empty() {
            continue;
        }
        z.sort_by(f64::total_cmp);
        bars.sort_by(f64::total_cmp);
        let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
        println!(
            "{estimate:9} {own_called:6} {:6.3} | {:6.3} {:7.2} {rms:7.2} {:7.3}",
            own_held as f64 / f64::max(own_called as f64, 1.0),
            all_held as f64 / results.len() as f64,
            z[z.len() / 2],
            bars[bars.len() / 2]
        );
        held += own_held;
        called += own_called;
    }
    let ratio: Vec<f64> = results
        .iter()
        .map(|(_, o, _)| o.weighted_mean_square / o.noise_mean_square)
        .collect();
    println!(
        "weighted residual over noise, mean {:.3}",
        ratio.iter().sum::<f64>() / ratio.len() as f64
    );
    let share = held as f64 / called as f64;
    println!(
        "{held} of {called} intervals of identifiable parameters hold the truth: {:.1} %",
        100.0 * share
    );
    let found = sure_called as f64 / sure as f64;
    println!(
        "{sure_called} of {sure} parameters with an expected standard error below 20 % are called identifiable: {:.1} %",
        100.0 * found
    );
    assert!(found > 0.95, "{found}");
    // three standard deviations of the binomial, the outcomes of one recording counted as dependent
    let slack = 3.0 * (0.05 * 0.95 / trials as f64).sqrt();
    assert!(
        (0.95 - slack.max(0.02)..=0.95 + slack.max(0.02)).contains(&share),
        "{share}"
    );
}
