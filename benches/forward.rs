//! Forward dynamics: 60 s of robot, 60 s of hanging film sample (by the adaptive simulator, and by the steps
//! of a fit), and the sample's inverse dynamics.
use deacal::film::Film;
use deacal::kinematics::{Chain, FourBar, Lozenge, Mechanism};
use deacal::model::{ForearmTorque, HangingSample, Parameters, Robot};
use deacal::residual::{Bounce, Steps, run_sample};
use deacal::simulate::{
    Hold, Options, SampleOptions, SampleTrack, Sampled, Side, Voltage, motion, sample_motion,
    sample_phi_squared_v2,
};

fn main() {
    divan::main();
}

fn film(scale: f64) -> Film {
    Film {
        mu_pa: [1120e3, 220e3, 120e3, 55e3, 45e3, 35e3, 30e3]
            .map(|m| m * scale)
            .to_vec(),
        relaxation_time_s: vec![0.02, 0.12, 0.7, 4.0, 25.0, 150.0],
        locking: 80.0,
    }
}

fn robot() -> (Robot, Parameters) {
    let chain = Chain {
        azimuth_rad: 0.0,
        base_radius_m: 30e-3,
        effector_radius_m: 25e-3,
        bicep_m: 50e-3,
        forearm_m: 50e-3,
        input_offset_rad: 93f64.to_radians(),
        four_bar: FourBar {
            a_m: 55e-3,
            b_m: 10e-3,
            c_m: 11.5e-3,
            d_m: 62e-3,
        },
        dea_offset_rad: 151f64.to_radians(),
    };
    let lozenge = Lozenge {
        side_m: 50e-3,
        l1_m: 62.9e-3,
        l2_m: 40.65e-3,
        l3_m: 0.085e-3,
        films: 2.0,
    };
    let nodes = ForearmTorque::DEFAULT_NODES_DEG
        .map(f64::to_radians)
        .to_vec();
    let torque = vec![-1.6e-3, -0.8e-3, -0.3e-3, 0.0, 0.3e-3, 0.8e-3, 1.6e-3];
    (
        Robot {
            mechanism: Mechanism::symmetric(chain),
            lozenges: [lozenge; 3],
            eps_r: 2.8,
            effector_kg: 6e-3,
            bicep_tip_kg: 0.96e-3,
            tolerances: Vec::new(),
        },
        Parameters {
            film: film(1.0),
            forearm: ForearmTorque::new(nodes, torque).expect("rising nodes"),
        },
    )
}

/// A third of a hertz, three chains in different phases, every millisecond.
fn sines(peak_v: f64, hold: Hold) -> Sampled {
    let samples = (0..=60_000)
        .map(|i| {
            [0.0, 0.7, 1.9].map(|phase| {
                let t = i as f64 * 1e-3;
                let ramp = (t / 2.0).min(1.0);
                let angle = 2.0 * std::f64::consts::PI * t / 3.0 + phase;
                0.5 * peak_v * (1.0 - angle.cos()) * ramp * ramp * (3.0 - 2.0 * ramp)
            })
        })
        .collect();
    Sampled::new(0.0, 1e-3, samples, hold).expect("finite samples")
}

/// 60 s of robot, result at 100 Hz.
#[divan::bench]
fn robot_60_s(bencher: divan::Bencher) {
    let (robot, parameters) = robot();
    let voltage = sines(4000.0, Hold::Linear);
    let options = Options {
        duration_s: 60.0,
        ..Options::default()
    };
    bencher.bench_local(|| motion(&robot, &parameters, &voltage, &options, &[]).expect("a motion"));
}

/// 60 s of robot, result at 1 kHz.
#[divan::bench]
fn robot_60_s_at_1_khz(bencher: divan::Bencher) {
    let (robot, parameters) = robot();
    let voltage = sines(4000.0, Hold::Linear);
    let options = Options {
        duration_s: 60.0,
        sample_step_s: 1e-3,
        ..Options::default()
    };
    bencher.bench_local(|| motion(&robot, &parameters, &voltage, &options, &[]).expect("a motion"));
}

/// 60 s of robot under a voltage that jumps every millisecond.
#[divan::bench]
fn robot_60_s_held_at_1_khz(bencher: divan::Bencher) {
    let (robot, parameters) = robot();
    let voltage = sines(4000.0, Hold::Previous);
    let options = Options {
        duration_s: 60.0,
        ..Options::default()
    };
    bencher.bench_local(|| motion(&robot, &parameters, &voltage, &options, &[]).expect("a motion"));
}

fn sample() -> HangingSample {
    HangingSample {
        width_m: 45e-3,
        length_m: 60e-3,
        margin_m: 3e-3,
        l3_m: 0.1e-3,
        films: 1.0,
        eps_r: 2.8,
        mass_kg: 50e-3,
        electrode: deacal::model::Electrode::IDEAL,
    }
}

/// 60 s of film sample, result at 100 Hz.
#[divan::bench]
fn sample_60_s(bencher: divan::Bencher) {
    let voltage = sines(5000.0, Hold::Linear);
    let options = SampleOptions {
        duration_s: 60.0,
        ..SampleOptions::default()
    };
    bencher.bench_local(|| {
        sample_motion(&sample(), &film(0.4), &voltage, &options).expect("a motion")
    });
}

/// 60 s of film sample in the steps of a fit, 10 ms each, which follow the bounce of the mass.
#[divan::bench]
fn sample_60_s_in_steps(bencher: divan::Bencher) {
    let voltage = sines(5000.0, Hold::Linear);
    let command: Vec<f64> = (0..=6000)
        .map(|i| voltage.phi_v(0.01 * f64::from(i), Side::Before)[0])
        .collect();
    let film = film(0.4);
    let steps = Steps::of(&sample(), &film, 0.0, 0.01);
    assert_eq!(steps.bounce, Bounce::Followed);
    bencher.bench_local(|| run_sample(&sample(), &film, &command, &steps, &[]).expect("a motion"));
}

/// Inverse dynamics of 60 s of film sample at 100 Hz.
#[divan::bench]
fn sample_60_s_inverse(bencher: divan::Bencher) {
    let voltage = sines(5000.0, Hold::Linear);
    let options = SampleOptions {
        duration_s: 60.0,
        ..SampleOptions::default()
    };
    let m = sample_motion(&sample(), &film(0.4), &voltage, &options).expect("a motion");
    let track = SampleTrack {
        step_s: m.step_s,
        x_m: &m.x_m,
        velocity_m_s: &m.velocity_m_s,
        acceleration_m_s2: &m.acceleration_m_s2,
        rest_phi_v: 0.0,
    };
    bencher.bench_local(|| {
        sample_phi_squared_v2(&sample(), &film(0.4), track, 1e-9).expect("a voltage")
    });
}
