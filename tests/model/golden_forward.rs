//! Forward dynamics of the robot and of the hanging film sample against an independent simulator.
use crate::common;
use common::*;
use deacal::simulate::{
    Hold, Motion, Options, SampleOptions, SampleTrack, Sampled, Smooth, Voltage, motion, rest,
    sample_motion, sample_phi_squared_v2,
};

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
    for tolerance_m in [Options::default().tolerance_m, 1e-9] {
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

#[test]
fn hanging_sample() {
    let g = golden("film_sample");
    let film = film(&g["film"]);
    let tolerance = number(&g["tolerance"]["x_mm"]);
    let m = |key: &str| number(&g["geometry"][key]) * 1e-3;
    for case in g["cases"].as_array().unwrap() {
        let sample = deacal::model::HangingSample {
            width_m: m("width_mm"),
            length_m: m("length_mm"),
            margin_m: m("margin_mm"),
            l3_m: number(&case["L3_mm"]) * 1e-3,
            films: number(&g["geometry"]["films"]),
            eps_r: number(&g["geometry"]["eps_r"]),
            mass_kg: number(&case["mass_g"]) * 1e-3,
            electrode: deacal::model::Electrode::IDEAL,
        };
        let sine = case["name"] == "sine";
        let phi = |t: f64| {
            if sine {
                2500.0 * (1.0 - (2.0 * std::f64::consts::PI * t / 3.0).cos())
            } else {
                4000.0 * (t / 4.0).min(1.0)
            }
        };
        // The ramp has a kink at 4 s: as samples it is exact and known to have it.
        let samples = (0..=1200).map(|i| [phi(i as f64 * 0.01); 3]).collect();
        let sampled = Sampled::new(0.0, 0.01, samples, Hold::Linear).unwrap();
        let smooth = Smooth(|t| [phi(t); 3]);
        let voltage: &dyn Voltage = if sine { &smooth } else { &sampled };
        for tolerance_m in [SampleOptions::default().tolerance_m, 1e-10] {
            let options = SampleOptions {
                duration_s: 12.0,
                tolerance_m,
                ..SampleOptions::default()
            };
            let got = sample_motion(&sample, &film, voltage, &options).unwrap();
            let rest = got.rest_length_m * 1e3 - number(&case["rest_length_mm"]);
            assert!(rest.abs() < 1e-9, "{rest:e}");
            let (mut worst, mut worst_stretch) = (0.0_f64, 0.0_f64);
            for row in case["rows"].as_array().unwrap() {
                let i = (number(&row["t"]) * 100.0).round() as usize;
                worst = worst.max((got.x_m[i] * 1e3 - number(&row["x_mm"])).abs());
                let active = numbers(&row["lambda_active"]);
                let end = numbers(&row["lambda_end"]);
                let s = got.stretches[i];
                for d in [
                    s.active[0] - active[0],
                    s.active[1] - active[1],
                    s.side_2 - number(&row["lambda_side_2"]),
                    s.end[0] - end[0],
                    s.end[1] - end[1],
                ] {
                    worst_stretch = worst_stretch.max(d.abs());
                }
            }
            println!(
                "{}, step tolerance {tolerance_m:.0e} m: x off by {worst:.1e} mm, stretches by {worst_stretch:.1e}, {:?}",
                case["name"], got.effort
            );
            assert!(worst < tolerance, "{worst:e} mm");
            assert!(worst_stretch < 1e-6);
            if let Some(strokes) = case["strokes_mm"].as_array() {
                for (cycle, stroke) in strokes.iter().enumerate() {
                    let own = &got.x_m[300 * cycle..=300 * (cycle + 1)];
                    let span = own.iter().fold(f64::MIN, |m, v| m.max(*v))
                        - own.iter().fold(f64::MAX, |m, v| m.min(*v));
                    // The highest of samples every 10 ms lies below the peak.
                    assert!((span * 1e3 - number(stroke)).abs() < 1e-4);
                }
            }
            // And back: the voltage from the motion.
            let track = SampleTrack {
                step_s: got.step_s,
                x_m: &got.x_m,
                velocity_m_s: &got.velocity_m_s,
                acceleration_m_s2: &got.acceleration_m_s2,
                rest_phi_v: 0.0,
            };
            let back = sample_phi_squared_v2(&sample, &film, track, 1e-9).unwrap();
            let (mut sum, mut count) = (0.0, 0.0);
            for (i, squared) in back.iter().enumerate() {
                let phi = phi(i as f64 * 0.01);
                if phi > 1000.0 {
                    sum += (squared.max(0.0).sqrt() - phi).powi(2);
                    count += 1.0;
                }
            }
            let rmse = f64::sqrt(sum / count);
            println!("    inverse dynamics: RMSE {rmse:.2e} V above 1 kV");
            assert!(rmse < 1.0, "{rmse}");
        }
    }
}

#[test]
fn a_sample_pulls_in_under_too_high_a_voltage() {
    let g = golden("film_sample");
    let film = film(&g["film"]);
    let sample = deacal::model::HangingSample {
        width_m: 45e-3,
        length_m: 60e-3,
        margin_m: 3e-3,
        l3_m: 1e-4,
        films: 1.0,
        eps_r: 2.8,
        mass_kg: 50e-3,
        electrode: deacal::model::Electrode::IDEAL,
    };
    let ramp = Smooth(|t| [4000.0 * t; 3]);
    let error = sample_motion(&sample, &film, &ramp, &SampleOptions::default()).unwrap_err();
    println!("{error}");
    assert!(matches!(error, deacal::simulate::Error::SampleUnstable { at_s, .. } if at_s > 1.0));
    let mut wrong = sample;
    wrong.margin_m = 0.04;
    let error = sample_motion(&wrong, &film, &ramp, &SampleOptions::default()).unwrap_err();
    assert!(error.to_string().contains("margin"), "{error}");
}
