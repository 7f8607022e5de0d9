//! Forward dynamics of the robot and of the hanging film sample against an independent simulator.
mod common;
use common::*;
use deacal::simulate::{Motion, Options, Smooth, motion, rest};

fn golden_motion(tolerance_m: f64) -> Motion {
    let g = golden("forward_dynamics");
    let robot = robot(&g["rig"]);
    let parameters = parameters(&g);
    let (amplitude, frequency) = (triple(&g["A_V"]), triple(&g["f_Hz"]));
    let voltage = Smooth(|t: f64| {
        [0, 1, 2]
            .map(|k| amplitude[k] * (1.0 - (2.0 * std::f64::consts::PI * frequency[k] * t).cos()))
    });
    let options = Options {
        sample_step_s: 0.2,
        duration_s: 6.0,
        tolerance_m,
        ..Options::default()
    };
    motion(&robot, &parameters, &voltage, &options, &[]).unwrap()
}

#[test]
fn rest_poses() {
    let g = golden("forward_dynamics");
    let robot = robot(&g["rig"]);
    let parameters = parameters(&g);
    let tolerance = number(&g["tolerance"]["rest_mm"]);
    let mut worst = 0.0_f64;
    for case in g["rest"].as_array().unwrap() {
        let payload = number(&case["payload_g"]) * 1e-3;
        let got = rest(&robot, &parameters, triple(&case["phi_V"]), payload, &[]).unwrap();
        let want = triple(&case["u_mm"]);
        for i in 0..3 {
            worst = worst.max((got.position_m[i] * 1e3 - want[i]).abs());
        }
        let theta = number(&case["theta_DEA_deg"]);
        for t in got.theta_dea_rad {
            assert!((t.to_degrees() - theta).abs() < 1e-6);
        }
    }
    println!("rest: off by {worst:.1e} mm");
    assert!(worst < tolerance, "{worst:e} mm");
}

#[test]
fn forward_dynamics() {
    let g = golden("forward_dynamics");
    let tolerance = number(&g["tolerance"]["u_mm"]);
    for tolerance_m in [1e-7, Options::default().tolerance_m, 1e-9] {
        let got = golden_motion(tolerance_m);
        let mut worst = 0.0_f64;
        for (i, row) in g["rows"].as_array().unwrap().iter().enumerate() {
            let want = triple(&row["u_mm"]);
            for j in 0..3 {
                worst = worst.max((got.position_m[i][j] * 1e3 - want[j]).abs());
            }
        }
        println!(
            "step tolerance {tolerance_m:.0e} m: off by {worst:.1e} mm, {:?}",
            got.effort
        );
        assert!(worst < tolerance, "{worst:e} mm");
    }
}
