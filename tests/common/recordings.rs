//! Simulated recordings of a robot with a known film.

use deacal::dataset::{Dataset, Parts, Voltage};
use deacal::film::{Film, InitialState};
use deacal::model::{ForearmTorque, Mechanics, Parameters, Robot, Track};
use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

/// Voltage clock minus motion clock where a recording does not state it, s.
pub const HIDDEN_OFFSET_S: f64 = 0.1234;

/// A film that differs from trial to trial by about a fifth.
pub fn film(generator: &mut ChaCha12Rng) -> Film {
    let mut vary = |value: f64| {
        let z: f64 = StandardNormal.sample(generator);
        value * (0.2 * z).exp()
    };
    Film {
        mu_pa: [1120e3, 220e3, 120e3, 55e3, 45e3, 35e3, 30e3]
            .map(&mut vary)
            .to_vec(),
        relaxation_time_s: [0.02, 0.12, 0.7, 4.0, 25.0, 150.0].map(&mut vary).to_vec(),
        locking: vary(80.0),
    }
}

/// A recording: a motion of many sines from rest near the top, the voltages that the film needs for it
/// (sampled at 500 Hz along the exact track), and the capture of it at 100 Hz with 0.03 mm of white noise.
/// The clocks agree where the offset is stated; else the voltage clock is ahead by [`HIDDEN_OFFSET_S`], which
/// the dataset does not know.
pub fn recording(
    robot: &Robot,
    film: &Film,
    generator: &mut ChaCha12Rng,
    duration_s: f64,
    offset_s: Option<f64>,
) -> Dataset {
    // a motion some pose of which no voltage holds is drawn again
    (0..50)
        .find_map(|_| drawn(robot, film, generator, duration_s, offset_s))
        .expect("one motion in fifty can be held")
}

fn drawn(
    robot: &Robot,
    film: &Film,
    generator: &mut ChaCha12Rng,
    duration_s: f64,
    offset_s: Option<f64>,
) -> Option<Dataset> {
    let tones: Vec<(f64, f64, f64)> = [1.0 / 3.0, 0.11, 0.8, 1.7, 2.9]
        .iter()
        .zip([9e-3, 3e-3, 2e-3, 0.7e-3, 0.25e-3])
        .map(|(f, a)| {
            (
                2.0 * std::f64::consts::PI * f * (0.9 + 0.2 * generator.random::<f64>()),
                a,
                std::f64::consts::TAU * generator.random::<f64>(),
            )
        })
        .collect();
    // fades in over 3 s from a pose at which the relaxed film needs a voltage already
    let at = |t: f64| -> [f64; 3] {
        let x = (t / 3.0).min(1.0);
        let (s, s1, s2) = (
            x * x * x * (10.0 - 15.0 * x + 6.0 * x * x),
            30.0 * x * x * (1.0 - x) * (1.0 - x) / 3.0,
            60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / 9.0,
        );
        let mut z = [-17e-3, 0.0, 0.0];
        for &(w, a, p) in &tones {
            let (sin, cos) = (w * t + p).sin_cos();
            z[0] += a * sin;
            z[1] += a * w * cos;
            z[2] -= a * w * w * sin;
        }
        [
            -41e-3 + s * z[0],
            s * z[1] + s1 * z[0],
            s * z[2] + 2.0 * s1 * z[1] + s2 * z[0],
        ]
    };
    let fine = 0.002;
    let n = (duration_s / fine) as usize + 1;
    let column = |k: usize| -> Vec<[f64; 3]> {
        (0..n).map(|i| [0.0, 0.0, at(i as f64 * fine)[k]]).collect()
    };
    let track = Track {
        step_s: fine,
        position_m: column(0),
        velocity_m_s: column(1),
        acceleration_m_s2: column(2),
        payload_kg: vec![0.0; n],
        initial: InitialState::Relaxed,
    };
    let truth = Parameters {
        film: film.clone(),
        forearm: ForearmTorque::zero(),
    };
    let phi = Mechanics::new(robot, &track)
        .unwrap()
        .phi_squared_v2(&truth)
        .unwrap();
    if phi.iter().any(|p| p[0] < 0.0) {
        return None;
    }
    let end = n;
    let measured_m = track.position_m[..end]
        .iter()
        .step_by(5)
        .map(|p| {
            p.map(|v| {
                let z: f64 = StandardNormal.sample(generator);
                v + 3e-5 * z
            })
        })
        .collect::<Vec<_>>();
    let frames = measured_m.len();
    let ahead = if offset_s.is_some() {
        0.0
    } else {
        HIDDEN_OFFSET_S
    };
    let channels = (0..3)
        .map(|k| phi[..end].iter().map(|p| p[k].max(0.0).sqrt()).collect())
        .collect();
    let parts = Parts {
        id: "simulated".into(),
        step_s: 0.01,
        start_s: 0.0,
        measured_m,
        payload_kg: vec![0.0; frames],
        voltage: Voltage::new(
            (0..end).map(|i| i as f64 * fine + ahead).collect(),
            channels,
            false,
        ),
        monitor: None,
        offset_s,
        initial: InitialState::Relaxed,
    };
    Some(Dataset::new(parts, None).unwrap())
}
