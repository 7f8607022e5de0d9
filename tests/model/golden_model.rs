//! Inverse dynamics and force prediction against an independent simulator: with the reference integrator to
//! its tolerance, with the production kernel on 100 Hz samples to the tolerance of the kernel's order.
use crate::common;
use common::*;
use deacal::film::integrate_reference;
use deacal::model::{Mechanics, Parameters, Robot};
use serde_json::Value;

/// Film torque of each chain at `times` with the film integrated along the exact track.
fn reference_film_torque(
    robot: &Robot,
    parameters: &Parameters,
    case: &Value,
    times: &[f64],
) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|k| {
        let theta = |t: f64| {
            let u = track(case, &[t], 1.0).position_m[0];
            robot.mechanism.pose(u).unwrap()[k].theta_dea_rad
        };
        let lozenge = robot.lozenges[k];
        let start = initial(&case["film"]["start"]);
        let stretch = |t: f64| lozenge.stretches(theta(t));
        let states = integrate_reference(&parameters.film, start, stretch, times, 1e-3).unwrap();
        let torque = |i: usize| {
            let (sigma, _) = parameters
                .film
                .stress_pa(states[i].lambda, &states[i].xi)
                .unwrap();
            let slopes = lozenge.log_stretch_slopes(theta(times[i]));
            lozenge.volume_m3() * (sigma[0] * slopes[0] + sigma[1] * slopes[1])
        };
        (0..times.len()).map(torque).collect()
    })
}

fn row_times(case: &Value) -> Vec<f64> {
    case["rows"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| number(&r["t"]))
        .collect()
}

/// Samples at 100 Hz up to the last row, and the sample number of each row.
fn sampled(case: &Value) -> (Vec<f64>, Vec<usize>) {
    let rows: Vec<usize> = row_times(case)
        .iter()
        .map(|t| (t * 100.0).round() as usize)
        .collect();
    (
        (0..=*rows.last().unwrap())
            .map(|i| i as f64 * 0.01)
            .collect(),
        rows,
    )
}

#[test]
fn inverse_dynamics() {
    let g = golden("inverse_dynamics");
    let robot = robot(&g["rig"]);
    let relative = number(&g["tolerance"]["phi_squared_relative"]);
    let absolute = number(&g["tolerance"]["phi_squared_absolute_V2"]);
    for case in g["cases"].as_array().unwrap() {
        let parameters = parameters(case);
        let times = row_times(case);
        let at_rows = Mechanics::new(&robot, &track(case, &times, 0.01)).unwrap();
        let film = reference_film_torque(&robot, &parameters, case, &times);
        let (grid, index) = sampled(case);
        let production = Mechanics::new(&robot, &track(case, &grid, 0.01)).unwrap();
        let production = production.phi_squared_v2(&parameters).unwrap();
        let scale = case["rows"]
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|r| numbers(&r["phi_squared_V2"]))
            .fold(0.0_f64, |m, v| m.max(v.abs()));
        let mut worst = 0.0_f64;
        for (i, row) in case["rows"].as_array().unwrap().iter().enumerate() {
            let forearm = at_rows.forearm_torques_n_m(&parameters.forearm)[i];
            for k in 0..3 {
                let chain = &at_rows.chains[k];
                let slope = chain.half_capacitance_slope[i];
                let want = numbers(&row["phi_squared_V2"])[k];
                let got = (film[k][i] + forearm[k] + chain.load(i)) / slope;
                assert!((slope / numbers(&row["half_dC_dtheta"])[k] - 1.0).abs() < 1e-9);
                assert!((film[k][i] / numbers(&row["tau_film_Nm"])[k] - 1.0).abs() < 1e-7);
                let torque = parameters.forearm.torque_n_m_at(chain.theta_fa_rad[i]);
                assert!((torque - numbers(&row["T_forearm_Nm"])[k]).abs() < 1e-12);
                let error = (got - want).abs();
                assert!(
                    error < absolute.max(relative * want.abs()),
                    "{} row {i} chain {k}: {got} {want}",
                    case["name"]
                );
                worst = worst.max((production[index[i]][k] - want).abs() / scale);
            }
        }
        println!(
            "{}: production kernel at 100 Hz off by {worst:.1e} of the largest phi^2",
            case["name"]
        );
        assert!(worst < 2e-6, "{} {worst:e}", case["name"]);
    }
}

#[test]
fn bicep_acceleration() {
    let g = golden("inverse_dynamics");
    let mechanism = mechanism(&g["rig"]);
    for case in g["cases"].as_array().unwrap() {
        let times = row_times(case);
        let track = track(case, &times, 0.01);
        for (i, row) in case["rows"].as_array().unwrap().iter().enumerate() {
            let pose = mechanism.pose(track.position_m[i]).unwrap();
            for k in 0..3 {
                let (v, a) = (track.velocity_m_s[i], track.acceleration_m_s2[i]);
                let (_, got) = mechanism.chains[k].bicep_rates(&pose[k], v, a);
                let want = numbers(&row["theta_b_ddot"])[k];
                assert!(
                    (got - want).abs() < 1e-9 * want.abs().max(1.0),
                    "{got} {want}"
                );
            }
        }
    }
}

#[test]
fn force_prediction() {
    let g = golden("force_prediction");
    let robot = robot(&g["rig"]);
    let tolerance = number(&g["tolerance"]["F_absolute_N"]);
    for case in g["cases"].as_array().unwrap() {
        let parameters = parameters(case);
        let times = row_times(case);
        let at_rows = Mechanics::new(&robot, &track(case, &times, 0.01)).unwrap();
        let film = reference_film_torque(&robot, &parameters, case, &times);
        let rows = case["rows"].as_array().unwrap();
        let squared = |phi: Vec<f64>| [phi[0] * phi[0], phi[1] * phi[1], phi[2] * phi[2]];
        let (grid, index) = sampled(case);
        let voltage = |t: f64| {
            let form = &case["voltage"];
            let at = |key: &str, k: usize| numbers(&form[key])[k];
            squared(
                (0..3)
                    .map(|k| {
                        at("c0", k)
                            + at("amp", k)
                                * (2.0 * std::f64::consts::PI * at("freq", k) * t + at("phase", k))
                                    .sin()
                    })
                    .collect(),
            )
        };
        let phi: Vec<[f64; 3]> = grid.iter().map(|&t| voltage(t)).collect();
        let production = Mechanics::new(&robot, &track(case, &grid, 0.01)).unwrap();
        let production = production.external_force_n(&parameters, &phi).unwrap();
        for (i, row) in rows.iter().enumerate() {
            let want = triple(&row["F_ext_N"]);
            // The balance with the film of the reference integrator: move the difference of the film torques
            // into phi^2.
            let mut phi = squared(numbers(&row["phi_V"]));
            for k in 0..3 {
                let chain = &at_rows.chains[k];
                let own = at_rows.film_torque_n_m(k, &parameters).unwrap()[i];
                phi[k] -= (film[k][i] - own[0] - own[1]) / chain.half_capacitance_slope[i];
            }
            let mut all = vec![[0.0; 3]; times.len()];
            all[i] = phi;
            let got = at_rows.external_force_n(&parameters, &all).unwrap()[i];
            for j in 0..3 {
                assert!(
                    (got[j] - want[j]).abs() < tolerance,
                    "{} row {i}: {got:?} {want:?}",
                    case["name"]
                );
                let error = (production[index[i]][j] - want[j]).abs();
                assert!(
                    error < 2e-6,
                    "{} row {i}: production kernel off by {error:e} N",
                    case["name"]
                );
            }
        }
    }
}

#[test]
fn force_prediction_inverts_inverse_dynamics() {
    let g = golden("inverse_dynamics");
    let robot = robot(&g["rig"]);
    let case = &g["cases"][0];
    let parameters = parameters(case);
    let (grid, _) = sampled(case);
    let mechanics = Mechanics::new(&robot, &track(case, &grid, 0.01)).unwrap();
    let phi = mechanics.phi_squared_v2(&parameters).unwrap();
    for f in mechanics.external_force_n(&parameters, &phi).unwrap() {
        assert!(f.iter().all(|f| f.abs() < 1e-14), "{f:?}");
    }
    let needed = mechanics.needed_torque_n_m(&parameters).unwrap();
    for i in 0..grid.len() {
        for k in 0..3 {
            let sum: f64 = needed[k][i].iter().sum();
            let maxwell = mechanics.chains[k].half_capacitance_slope[i] * phi[i][k];
            assert!((sum - maxwell).abs() < 1e-15);
        }
    }
}

#[test]
fn the_highest_bicep_pose_is_reported_and_not_divided_by() {
    let g = golden("inverse_dynamics");
    let robot = robot(&g["rig"]);
    let mut case = g["cases"][1].clone();
    case["track"]["z"] =
        serde_json::json!({"c0": -21.8, "amp": [0.05], "freq": [0.5], "phase": [0.0]});
    let times: Vec<f64> = (0..200).map(|i| i as f64 * 0.01).collect();
    let mechanics = Mechanics::new(&robot, &track(&case, &times, 0.01)).unwrap();
    assert!(!mechanics.unreachable.is_empty());
    let (sample, why) = mechanics.unreachable[0];
    assert!(why.to_string().contains("condition number"), "{why}");
    let phi = mechanics
        .phi_squared_v2(&parameters(&g["cases"][0]))
        .unwrap();
    assert!(phi[sample].iter().all(|p| p.is_nan()));
}
