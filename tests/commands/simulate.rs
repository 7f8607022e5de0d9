//! Simulation: round trips, energy, replay, additions, and what is refused.
use crate::common;
use common::*;
use deacal::film::InitialState;
use deacal::kinematics::Joint;
use deacal::model::{Mechanics, Parameters, Robot};
use deacal::simulate::write::{
    Capture, Noise, Placement, RecordingText, VoltageLog, nexus_csv, recording_toml, voltage_csv,
};
use deacal::simulate::{
    Action, Addition, Circle, Drive, Error, Hold, Motion, Options, Payload, Sampled, Side,
    Situation, Smooth, Start, Voltage, flip_polarity, motion, rest,
};

fn subject() -> (Robot, Parameters) {
    let g = golden("forward_dynamics");
    (robot(&g["rig"]), parameters(&g))
}

fn sine(peak_v: [f64; 3], frequency_hz: f64) -> Drive {
    Drive::Sine {
        peak_v,
        frequency_hz,
        phase_rad: [0.0; 3],
    }
}

/// RMSE (V) and number of samples above 1 kV of f_ID on a noise-free motion against the voltage that made it.
fn round_trip(robot: &Robot, parameters: &Parameters, m: &Motion) -> (f64, usize) {
    let mechanics = Mechanics::new(robot, &m.track()).unwrap();
    assert!(mechanics.unreachable.is_empty());
    let squared = mechanics.phi_squared_v2(parameters).unwrap();
    let (mut sum, mut count) = (0.0, 0);
    for (got, want) in squared.iter().zip(&m.phi_v) {
        for k in 0..3 {
            if want[k] > 1000.0 {
                sum += (got[k].max(0.0).sqrt() - want[k]).powi(2);
                count += 1;
            }
        }
    }
    ((sum / count as f64).sqrt(), count)
}

#[test]
fn inverse_dynamics_give_the_voltage_back() {
    let (robot, parameters) = subject();
    let drives = [
        ("symmetric sine", sine([5000.0; 3], 1.0 / 3.0)),
        ("one chain", sine([3000.0, 0.0, 0.0], 1.0 / 3.0)),
        (
            "three phases",
            Drive::Sine {
                peak_v: [4000.0, 3500.0, 3000.0],
                frequency_hz: 0.5,
                phase_rad: [0.0, 2.0, 4.0],
            },
        ),
        (
            "multisine",
            Drive::Multisine {
                peak_v: [4000.0; 3],
                frequency_hz: vec![0.1, 0.3, 0.7, 1.1, 1.9],
            },
        ),
        (
            "chirp",
            Drive::Chirp {
                peak_v: [4000.0; 3],
                from_hz: 0.1,
                to_hz: 2.0,
            },
        ),
        (
            "staircase",
            Drive::Staircase {
                peak_v: [4500.0; 3],
                steps: 4,
                hold_s: 1.2,
                ramp_s: 0.3,
                repeats: 2,
            },
        ),
    ];
    for (name, drive) in drives {
        let voltage = drive.sampled(20.0, 1000.0).unwrap();
        let options = Options {
            duration_s: 20.0,
            ..Options::default()
        };
        let m = motion(&robot, &parameters, &voltage, &options, &[]).unwrap();
        let (rmse, count) = round_trip(&robot, &parameters, &m);
        println!(
            "{name}: RMSE {rmse:.4} V over {count} samples above 1 kV, {:?}",
            m.effort
        );
        assert!(count > 500);
        assert!(rmse < 1.0, "{name}: {rmse} V");
    }
}

#[test]
fn a_planned_circle_is_followed() {
    let (robot, parameters) = subject();
    let circle = Circle {
        radius_m: 4e-3,
        height_m: -0.046,
        period_s: 3.0,
        turns: 3.0,
        move_s: 2.0,
    };
    let plan = circle
        .drive(&robot, &parameters, 0.0, 1000.0, 6000.0)
        .unwrap();
    let options = Options {
        duration_s: plan.voltage.duration_s(),
        ..Options::default()
    };
    let m = motion(&robot, &parameters, &plan.voltage, &options, &[]).unwrap();
    let mut worst = 0.0_f64;
    for (i, u) in m.position_m.iter().enumerate() {
        for j in 0..3 {
            worst = worst.max((u[j] - plan.path.position_m[10 * i][j]).abs());
        }
    }
    println!(
        "circle: at most {:.2e} mm from the plan, {:?}",
        worst * 1e3,
        m.effort
    );
    assert!(worst < 1e-6, "{worst:e}");
}

#[test]
fn the_energy_closes() {
    let (robot, parameters) = subject();
    for (name, payload, hold) in [
        ("smooth", Payload::constant(1e-3), Hold::Linear),
        (
            "payload steps",
            Payload::steps(0.0, vec![(2.5, 2e-3), (6.0, 0.5e-3)]).unwrap(),
            Hold::Linear,
        ),
        ("held at 50 Hz", Payload::default(), Hold::Previous),
    ] {
        let voltage = sine([4500.0, 4000.0, 3500.0], 0.5)
            .sampled(9.0, 50.0)
            .unwrap();
        let voltage = match hold {
            Hold::Linear => sine([4500.0, 4000.0, 3500.0], 0.5)
                .sampled(9.0, 1000.0)
                .unwrap(),
            Hold::Previous => Sampled::new(0.0, 0.02, voltage.samples_v().to_vec(), hold).unwrap(),
        };
        let options = Options {
            duration_s: 9.0,
            payload,
            energy: true,
            ..Options::default()
        };
        let damping = Damping(2e-5);
        let m = motion(&robot, &parameters, &voltage, &options, &[&damping]).unwrap();
        let share = m.energy.imbalance_j() / m.energy.electrical_j;
        println!(
            "{name}: {:?}\n  imbalance {share:.1e} of the electrical work",
            m.energy
        );
        assert!(m.energy.electrical_j > 0.0);
        assert!(m.energy.heat_j > 0.0 && m.energy.additions_j < 0.0);
        assert!(share.abs() < 1e-6, "{name}: {share:e}");
        // Most of the electrical work is charge that comes back: at a tenth of the tolerance also against the
        // rest of it.
        let finer = Options {
            tolerance_m: 1e-9,
            ..options
        };
        let m = motion(&robot, &parameters, &voltage, &finer, &[&damping]).unwrap();
        let share = m.energy.imbalance_j() / m.energy.maxwell_j;
        println!("  {share:.1e} of the Maxwell work at a tolerance of 1e-9 m");
        assert!(share.abs() < 1e-6, "{name}: {share:e}");
    }
}

/// A voltage none of whose jumps is made smooth.
struct Hard(Sampled);

impl Voltage for Hard {
    fn phi_v(&self, t_s: f64, side: Side) -> [f64; 3] {
        self.0.phi_v(t_s, side)
    }

    fn next_break_s(&self, t_s: f64) -> f64 {
        self.0.next_break_s(t_s)
    }
}

#[test]
fn small_jumps_of_a_held_voltage_are_made_smooth_within_the_tolerance() {
    let (robot, parameters) = subject();
    let sine = sine([5000.0, 4000.0, 3000.0], 1.0 / 3.0)
        .sampled(8.0, 1000.0)
        .unwrap();
    let run = |voltage: &dyn Voltage, tolerance_m: f64| {
        let options = Options {
            duration_s: 8.0,
            sample_step_s: 0.0105,
            tolerance_m,
            ..Options::default()
        };
        motion(&robot, &parameters, voltage, &options, &[]).unwrap()
    };
    // Stepped every millisecond, with a jump of some 600 V in it; as computed, and in steps of 0.1 V, which
    // no longer are smooth.
    let mut held = sine.clone();
    let mut exact = run(&sine, 1e-8);
    for (decimals, limit_m) in [(1, 1e-6), (9, 1e-7)] {
        let tens = 10f64.powi(decimals);
        let samples = sine.samples_v().iter().enumerate().map(|(i, phi)| {
            let factor = if i > 5200 { 0.8 } else { 1.0 };
            phi.map(|p| (tens * factor * p).round() / tens)
        });
        held = Sampled::new(0.0, 1e-3, samples.collect(), Hold::Previous).unwrap();
        exact = run(&Hard(held.clone()), 1e-9);
        let soft = run(&held, 1e-8);
        let mut worst = 0.0_f64;
        for (a, b) in soft.position_m.iter().zip(&exact.position_m) {
            for j in 0..3 {
                worst = worst.max((a[j] - b[j]).abs());
            }
        }
        println!(
            "softened, {decimals} decimals: off by {worst:.1e} m, {:?} against {:?}",
            soft.effort, exact.effort
        );
        assert_eq!(soft.phi_v, exact.phi_v);
        assert!(worst < limit_m, "{worst:e} m");
        assert!(4 * soft.effort.steps < exact.effort.steps);
    }
    // The lag of half a sample is there: a straight line between the samples moves elsewhere.
    let straight = Sampled::new(0.0, 1e-3, held.samples_v().to_vec(), Hold::Linear).unwrap();
    let straight = run(&straight, 1e-8);
    let apart = (straight.position_m[200][2] - exact.position_m[200][2]).abs();
    assert!(apart > 1e-6, "{apart:e} m");
    // Long steps and large jumps stay what they are.
    let slow: Vec<[f64; 3]> = held.samples_v().iter().step_by(20).copied().collect();
    let slow = Sampled::new(0.0, 0.02, slow, Hold::Previous).unwrap();
    assert!(slow.softened(0.05).is_none());
}

/// Viscous torque in the bicep joints.
struct Damping(f64);

impl Addition for Damping {
    fn act(&self, s: &Situation, _states: &[f64], action: &mut Action, _rates: &mut [f64]) {
        for k in 0..3 {
            action.torque_b_n_m[k] -= self.0 * s.theta_b_rate_rad_s[k];
        }
    }
}

/// Wire and electrode resistance: R d(C phi)/dt = phi_c - phi; the state is the charge over the first
/// capacitance.
struct Series {
    resistance_ohm: f64,
}

const NANOFARAD: f64 = 1e-9;

impl Addition for Series {
    fn states(&self) -> usize {
        3
    }
    fn start(&self, s: &Situation, states: &mut [f64]) {
        for k in 0..3 {
            states[k] = s.capacitance_f[k] * s.command_v[k] / NANOFARAD;
        }
    }
    fn scale(&self, _i: usize) -> f64 {
        3000.0
    }
    fn act(&self, s: &Situation, states: &[f64], action: &mut Action, rates: &mut [f64]) {
        for k in 0..3 {
            let phi = states[k] * NANOFARAD / s.capacitance_f[k];
            rates[k] = (action.phi_v[k] - phi) / self.resistance_ohm / NANOFARAD;
            action.phi_v[k] = phi;
        }
    }
}

/// A stiff one-sided stop of the bicep, with damping, and regularised dry friction: the stiff additions to
/// come.
struct Stop;

impl Addition for Stop {
    fn act(&self, s: &Situation, _states: &[f64], action: &mut Action, _rates: &mut [f64]) {
        for k in 0..3 {
            let depth = s.theta_b_rad[k] - STOP_RAD;
            if depth > 0.0 {
                let damped = (1.0 + 0.5 * s.theta_b_rate_rad_s[k]).max(0.0);
                action.torque_b_n_m[k] -= 20.0 * depth * damped;
            }
            action.torque_b_n_m[k] -= 2e-5 * (s.theta_b_rate_rad_s[k] / 1e-3).tanh();
        }
    }
}

/// Just below the bicep angle of the free rest (4.2264 rad): the robot rests against it.
const STOP_RAD: f64 = 4.22;

#[test]
fn joint_damping_is_the_torque_that_it_says() {
    let (robot, parameters) = subject();
    let voltage = sine([4000.0, 3000.0, 3500.0], 0.5)
        .sampled(6.0, 1000.0)
        .unwrap();
    let options = Options {
        duration_s: 6.0,
        ..Options::default()
    };
    let c = 2e-4;
    let plain = motion(&robot, &parameters, &voltage, &options, &[]).unwrap();
    let off = motion(&robot, &parameters, &voltage, &options, &[&Damping(0.0)]).unwrap();
    let m = motion(&robot, &parameters, &voltage, &options, &[&Damping(c)]).unwrap();
    // Off it changes nothing, to the bit.
    assert_eq!(plain.position_m, off.position_m);
    assert_eq!(plain.acceleration_m_s2, off.acceleration_m_s2);
    // The inverse dynamics without damping miss just this torque: 1/2 C' (phi^2 - phi_ID^2) = c theta_b' / (d
    // theta_DEA/d theta_b).
    let mechanics = Mechanics::new(&robot, &m.track()).unwrap();
    let squared = mechanics.phi_squared_v2(&parameters).unwrap();
    let mut worst = 0.0_f64;
    let mut largest = 0.0_f64;
    for i in 0..squared.len() {
        let pose = robot.mechanism.pose(m.position_m[i]).unwrap();
        for k in 0..3 {
            let missed = mechanics.chains[k].half_capacitance_slope[i]
                * (m.phi_v[i][k].powi(2) - squared[i][k]);
            let rate = deacal::kinematics::dot(pose[k].dtheta_b_du, m.velocity_m_s[i]);
            let torque = c * rate / pose[k].dtheta_dea_dtheta_b;
            worst = worst.max((missed - torque).abs());
            largest = largest.max(torque.abs());
        }
    }
    println!(
        "damping torque found to {:.1e} of its largest",
        worst / largest
    );
    assert!(worst < 1e-3 * largest);
}

#[test]
fn series_resistance_delays_the_film_by_its_time_constant() {
    let (robot, parameters) = subject();
    let peak = 3000.0;
    let voltage = sine([peak; 3], 0.5).sampled(10.0, 1000.0).unwrap();
    let options = Options {
        duration_s: 10.0,
        ..Options::default()
    };
    let series = Series {
        resistance_ohm: 10e6,
    };
    let m = motion(&robot, &parameters, &voltage, &options, &[&series]).unwrap();
    // f_ID gives the voltage on the film, and that obeys R d(C phi)/dt = phi_c - phi.
    let mechanics = Mechanics::new(&robot, &m.track()).unwrap();
    let squared = mechanics.phi_squared_v2(&parameters).unwrap();
    let eps = robot.eps_r * deacal::units::VACUUM_PERMITTIVITY_F_M;
    let charge = |i: usize| {
        let theta = mechanics.chains[0].theta_dea_rad[i];
        robot.lozenges[0].capacitance_f(theta, eps) * squared[i][0].max(0.0).sqrt()
    };
    let mut worst = 0.0_f64;
    for i in 500..squared.len() - 1 {
        let film = squared[i][0].max(0.0).sqrt();
        if film < 1000.0 {
            continue;
        }
        let current = (charge(i + 1) - charge(i - 1)) / (2.0 * m.step_s);
        let want = m.phi_v[i][0] - series.resistance_ohm * current;
        worst = worst.max((film - want).abs());
    }
    println!("series resistance: film voltage off by at most {worst:.2} V");
    assert!(worst < 1.0, "{worst}");
}

#[test]
fn a_stiff_stop_and_friction_are_survived() {
    let (robot, parameters) = subject();
    let drive = Drive::Holds {
        levels: vec![
            ([0.0; 3], 0.5),
            ([4000.0; 3], 2.0),
            ([0.0; 3], 2.0),
            ([3000.0; 3], 1.0),
        ],
        ramp_s: 0.0,
    };
    let voltage = drive.sampled(drive.length_s().unwrap(), 1000.0).unwrap();
    let options = Options {
        duration_s: voltage.duration_s(),
        ..Options::default()
    };
    let mut out: Vec<Motion> = Vec::new();
    for tolerance_m in [1e-8, 1e-9] {
        let options = Options {
            tolerance_m,
            ..options.clone()
        };
        out.push(motion(&robot, &parameters, &voltage, &options, &[&Stop]).unwrap());
    }
    let worst = out[0]
        .position_m
        .iter()
        .zip(&out[1].position_m)
        .flat_map(|(a, b)| [a[0] - b[0], a[1] - b[1], a[2] - b[2]])
        .fold(0.0_f64, |m, d| m.max(d.abs()));
    let highest = out[0]
        .position_m
        .iter()
        .map(|&u| robot.mechanism.pose(u).unwrap()[0].theta_b_rad)
        .fold(0.0_f64, f64::max);
    println!(
        "stop: highest bicep angle {highest:.4} rad, two tolerances {:.1e} mm apart, {:?}",
        worst * 1e3,
        out[0].effort
    );
    // Impacts are not smooth: a fraction of the capture's noise (0.03 mm) is what can be asked for.
    assert!(worst < 5e-6);
    assert!(highest > STOP_RAD && highest < STOP_RAD + 1e-3);
}

#[test]
fn virgin_films_and_released_poses() {
    let (robot, parameters) = subject();
    let zero = Smooth(|_| [0.0; 3]);
    // With 5 g: the virgin film is stiffer and would throw the free robot over its highest bicep pose.
    let at_rest = rest(&robot, &parameters, [0.0; 3], 5e-3, &[]).unwrap();
    let mut u = at_rest.position_m;
    u[2] -= 1e-3;
    for films in [InitialState::Relaxed, InitialState::Virgin] {
        let options = Options {
            duration_s: 3.0,
            start: Start::From {
                position_m: u,
                velocity_m_s: [0.0; 3],
                films,
            },
            payload: Payload::constant(5e-3),
            energy: true,
            tolerance_m: 1e-11,
            ..Options::default()
        };
        let m = motion(&robot, &parameters, &zero, &options, &[]).unwrap();
        // No work goes in: what is stored turns into heat.
        let lost =
            -(m.energy.elastic_j + m.energy.kinetic_j + m.energy.gravity_j + m.energy.forearm_j);
        println!(
            "{films:?}: {:.3e} J into heat, imbalance {:.1e} J",
            m.energy.heat_j,
            m.energy.imbalance_j()
        );
        assert!((lost - m.energy.heat_j).abs() < 1e-6 * m.energy.heat_j);
    }
}

#[test]
fn polarity_changes_nothing_in_the_motion() {
    let (robot, parameters) = subject();
    let plain = sine([4000.0; 3], 0.5).sampled(8.0, 1000.0).unwrap();
    let flipped = flip_polarity(&plain, 2.0).unwrap();
    assert!(flipped.samples_v()[3000][0] < -3999.0);
    let options = Options {
        duration_s: 8.0,
        ..Options::default()
    };
    let a = motion(&robot, &parameters, &plain, &options, &[]).unwrap();
    let b = motion(&robot, &parameters, &flipped, &options, &[]).unwrap();
    for (a, b) in a.position_m.iter().zip(&b.position_m) {
        assert!((a[2] - b[2]).abs() < 1e-9);
    }
}

#[test]
fn errors_say_when_and_where() {
    let (robot, parameters) = subject();
    // Paths that leave the workspace: the first point, and by how much.
    let wide = Circle {
        radius_m: 60e-3,
        height_m: -0.045,
        period_s: 4.0,
        turns: 1.0,
        move_s: 2.0,
    };
    let low = Circle {
        height_m: -0.11,
        ..wide
    };
    let error = low
        .drive(&robot, &parameters, 0.0, 1000.0, 1e6)
        .unwrap_err();
    println!("{error}");
    let Error::PathOutside { at_s, place, .. } = &error else {
        panic!("{error:?}");
    };
    assert!(*at_s > 0.5 && *at_s < 2.0);
    assert!(place.value < place.low || place.value > place.high);
    // The first point: a tenth of a millimetre earlier is within reach.
    let mut inside = place.pose_m;
    inside[2] += 1e-4;
    assert!(robot.mechanism.pose(inside).is_ok());
    let error = wide
        .drive(&robot, &parameters, 0.0, 1000.0, 1e6)
        .unwrap_err();
    println!("{error}");
    // It reaches some 40 mm out at that height, and loses rank just before.
    let Error::PathOutside {
        position_m,
        nearest: Some((far_m, way)),
        ..
    } = error
    else {
        panic!("{error:?}");
    };
    let radius_m = position_m[0].hypot(position_m[1]);
    assert!((0.03..0.05).contains(&radius_m), "{radius_m}");
    assert!((0.06 - radius_m - far_m).abs() < 0.015, "{far_m}");
    assert_eq!(way, "nearer to the axis");
    // A payload that the films carry no more.
    let error = rest(&robot, &parameters, [0.0; 3], 0.2, &[]).unwrap_err();
    println!("{error}");
    assert!(matches!(error, Error::NoRest { share, .. } if share > 0.0 && share < 1.0));
    // A path above rest: only a pushing voltage would hold it.
    let above = Circle {
        radius_m: 1e-3,
        height_m: -0.029,
        ..wide
    };
    let error = above
        .drive(&robot, &parameters, 0.0, 1000.0, 1e6)
        .unwrap_err();
    println!("{error}");
    assert!(matches!(error, Error::NoVoltage { phi_squared_v2, .. } if phi_squared_v2 < 0.0));
    // Voltage above the limit: while planning and while driving.
    let deep = Circle {
        radius_m: 5e-3,
        ..wide
    };
    let error = deep
        .drive(&robot, &parameters, 0.0, 1000.0, 2000.0)
        .unwrap_err();
    println!("{error}");
    assert!(matches!(error, Error::VoltageLimit { phi_v, .. } if phi_v > 2000.0));
    let voltage = sine([4000.0; 3], 0.5).sampled(4.0, 1000.0).unwrap();
    let options = Options {
        duration_s: 4.0,
        voltage_limit_v: 3000.0,
        ..Options::default()
    };
    let error = motion(&robot, &parameters, &voltage, &options, &[]).unwrap_err();
    println!("{error}");
    assert!(matches!(error, Error::VoltageLimit { at_s, .. } if at_s > 0.0 && at_s < 1.0));
    // A voltage far beyond what the films stand: the robot collapses, and it is said when and where.
    let voltage = sine([30e3; 3], 0.5).sampled(4.0, 1000.0).unwrap();
    let options = Options {
        duration_s: 4.0,
        ..Options::default()
    };
    let error = motion(&robot, &parameters, &voltage, &options, &[]).unwrap_err();
    println!("{error}");
    assert!(matches!(
        error,
        Error::Flipped { .. }
            | Error::Singular { .. }
            | Error::SnapThrough { .. }
            | Error::OutOfReach { .. }
    ));
    // A payload above the fold of the statics, let go at the free rest.
    let heavy = Options {
        payload: Payload::constant(0.08),
        start: Start::From {
            position_m: rest(&robot, &parameters, [0.0; 3], 0.0, &[])
                .unwrap()
                .position_m,
            velocity_m_s: [0.0; 3],
            films: InitialState::Relaxed,
        },
        ..options.clone()
    };
    let zero = Smooth(|_| [0.0; 3]);
    let error = motion(&robot, &parameters, &zero, &heavy, &[]).unwrap_err();
    println!("{error}");
    assert!(matches!(error, Error::SnapThrough { stiffness_n_m, .. } if stiffness_n_m <= 0.0));
    // A film that locks early: there is no rest, and where it is let go it is locked at once.
    let mut locking = parameters.clone();
    locking.film.locking = 0.5;
    let error = motion(&robot, &locking, &voltage, &options, &[]).unwrap_err();
    println!("{error}");
    assert!(matches!(error, Error::NoRest { .. }));
    let error = motion(&robot, &locking, &zero, &heavy, &[]).unwrap_err();
    println!("{error}");
    assert!(matches!(
        error,
        Error::Locked { chain: 1, place } if place.invariant >= 0.5 && place.at_s == Some(0.0)
    ));
    // Numbers that make no sense.
    for bad in [
        Options {
            tolerance_m: 0.0,
            ..Options::default()
        },
        Options {
            duration_s: f64::NAN,
            ..Options::default()
        },
        Options {
            sample_step_s: -1.0,
            ..Options::default()
        },
    ] {
        let error = motion(&robot, &parameters, &voltage, &bad, &[]).unwrap_err();
        assert!(matches!(error, Error::Refused(_)));
    }
    assert!(Sampled::new(0.0, 1e-3, vec![[f64::NAN; 3]], Hold::Linear).is_err());
    assert!(flip_polarity(&voltage, 0.0).is_err());
    let bad = Drive::Chirp {
        peak_v: [1.0; 3],
        from_hz: 0.0,
        to_hz: 1.0,
    };
    assert!(bad.sampled(1.0, 1000.0).is_err());
    let mut short = parameters.clone();
    short.film.mu_pa.pop();
    assert!(matches!(
        rest(&robot, &short, [0.0; 3], 0.0, &[]),
        Err(Error::Refused(_))
    ));
}

#[test]
fn a_robot_at_rest_under_voltage_stays_there() {
    let (robot, parameters) = subject();
    let phi = [3000.0, 2500.0, 2000.0];
    let at_rest = rest(&robot, &parameters, phi, 1e-3, &[]).unwrap();
    let constant = Smooth(move |_| phi);
    let options = Options {
        duration_s: 5.0,
        payload: Payload::constant(1e-3),
        ..Options::default()
    };
    let m = motion(&robot, &parameters, &constant, &options, &[]).unwrap();
    for u in &m.position_m {
        for j in 0..3 {
            assert!((u[j] - at_rest.position_m[j]).abs() < 1e-11);
        }
    }
    assert!(at_rest.stiffness_n_m > 0.0);
    assert_eq!(constant.next_break_s(0.0), f64::INFINITY);
}

#[test]
fn mechanism_curvatures_are_derivatives_of_the_slopes() {
    let (robot, _) = subject();
    let mechanism = robot.mechanism;
    let u = [4e-3, -3e-3, -45e-3];
    for (k, chain) in mechanism.chains.iter().enumerate() {
        let pose = |u: [f64; 3]| mechanism.pose(u).unwrap()[k];
        let h = chain.curvature(&pose(u));
        for j in 0..3 {
            let step = 1e-6;
            let (mut up, mut down) = (u, u);
            up[j] += step;
            down[j] -= step;
            let (up, down) = (pose(up), pose(down));
            let along = up.theta_b_rad - down.theta_b_rad;
            let second = (up.dtheta_dea_dtheta_b - down.dtheta_dea_dtheta_b) / along;
            assert!((second / h.theta_dea_theta_b - 1.0).abs() < 1e-6);
            for i in 0..3 {
                let slope = |a: [f64; 3], b: [f64; 3]| (a[i] - b[i]) / (2.0 * step);
                let scale = 1e-6 * 1e3;
                assert!((slope(up.dtheta_b_du, down.dtheta_b_du) - h.theta_b[i][j]).abs() < scale);
                let dea = slope(up.dtheta_dea_du, down.dtheta_dea_du);
                assert!((dea - h.theta_dea[i][j]).abs() < scale);
                let fa = slope(up.dtheta_fa_du, down.dtheta_fa_du);
                assert!((fa - h.theta_fa[i][j]).abs() < scale);
            }
        }
    }
    let error = mechanism.pose([0.0, 0.06, -0.04]).unwrap_err();
    assert_eq!(error.joint, Joint::ForearmSwing);
}

fn files(seed: u64) -> [String; 3] {
    let position: Vec<[f64; 3]> = (0..200)
        .map(|i| [1e-3 * (i as f64 * 0.05).sin(), 0.0, -0.032])
        .collect();
    let capture = Capture {
        base_in_capture_m: [-0.3124, 0.1887, 0.9023],
        placement: Placement {
            base_position_m: [2.5e-3, 95e-3, 12.5e-3],
            end_effector_offset_m: [0.0, 0.0, -4e-3],
            rotation_deg: [5.0, -3.0, 40.0],
        },
        noise: Noise {
            white_m: 3e-5,
            coloured_m: 2e-5,
            correlation_s: 0.05,
        },
        gaps: vec![(50, 7)],
        seed,
        ..Capture::default()
    };
    let log = VoltageLog {
        clock_offset_s: 0.7003,
        ..VoltageLog::default()
    };
    let text = RecordingText {
        id: "made/one".into(),
        placement: capture.placement,
        payload_kg: vec![(0.0, 0.0), (1.0, 2e-3)],
        labels: vec![("batch".into(), "B\"01".into())],
        offset_s: None,
        ..RecordingText::default()
    };
    let drive = sine([2345.67; 3], 1.0).sampled(2.0, 1000.0).unwrap();
    let (mut a, mut b, mut c) = (Vec::new(), Vec::new(), Vec::new());
    nexus_csv(&mut a, &capture, &position).unwrap();
    voltage_csv(&mut b, &log, &drive).unwrap();
    recording_toml(&mut c, &text, &capture, &log).unwrap();
    [a, b, c].map(|v| String::from_utf8(v).unwrap())
}

#[test]
fn files_replay_to_the_byte() {
    let (a, b, other) = (files(7), files(7), files(8));
    assert_eq!(a, b);
    assert_ne!(a[0], other[0]);
    assert_eq!(a[1..], other[1..]);
}

#[test]
fn files_read_back() {
    let [motion, voltage, text] = files(7);
    let lines: Vec<&str> = motion.split("\r\n").collect();
    assert_eq!(lines[0], "Trajectories");
    assert_eq!(lines[1], "100");
    assert_eq!(lines[2], ",,DEA:EE,,,DEA:Base,,");
    assert_eq!(lines[3], "Frame,Sub Frame,X,Y,Z,X,Y,Z");
    assert_eq!(lines[4], ",,mm,mm,mm,mm,mm,mm");
    assert_eq!(lines.len(), 5 + 200 + 1);
    // Capture axes to W by v_W = Rx Ry Rz v_capture, as section "recording on disk" says.
    let rotation = |v: [f64; 3]| {
        let [x, y, z] = [5.0f64, -3.0, 40.0].map(f64::to_radians);
        let (s, c) = z.sin_cos();
        let v = [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]];
        let (s, c) = y.sin_cos();
        let v = [c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]];
        let (s, c) = x.sin_cos();
        [v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]]
    };
    let mut mean = [0.0; 3];
    let mut rows = Vec::new();
    for (i, line) in lines[5..205].iter().enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), 8);
        assert_eq!(cells[0], (i + 1).to_string());
        assert!(cells[5].split('.').nth(1).unwrap().len() == 3);
        assert_eq!(cells[2].is_empty(), (50..57).contains(&i), "{line}");
        let value = |c: usize| cells[c].parse::<f64>().unwrap();
        for j in 0..3 {
            mean[j] += value(5 + j) / 200.0;
        }
        if !cells[2].is_empty() {
            rows.push((i, [value(2), value(3), value(4)]));
        }
    }
    let mut sum = [0.0; 3];
    for (i, row) in &rows {
        let w = rotation([0, 1, 2].map(|j| row[j] - mean[j]));
        let want = [(*i as f64 * 0.05).sin(), 0.0, -32.0];
        for j in 0..3 {
            let centre = w[j] + [2.5, 95.0, 12.5][j] - [0.0, 0.0, -4.0][j];
            sum[j] += (centre - want[j]).powi(2) / rows.len() as f64;
        }
    }
    // 0.03 mm white and 0.02 mm coloured, and the mean of the base marker.
    for rms in sum.map(f64::sqrt) {
        assert!((0.025..0.05).contains(&rms), "{rms}");
    }
    let mut lines = voltage.lines();
    assert_eq!(lines.next().unwrap(), "time_s,phi1_kV,phi2_kV,phi3_kV");
    assert_eq!(lines.next().unwrap(), "0.7003,0.0000,0.0000,0.0000");
    assert_eq!(lines.clone().count(), 2000);
    assert!(lines.nth(498).unwrap().starts_with("1.1993,2.34"));
    let table: toml::Table = text.parse().unwrap();
    assert_eq!(table["recording"]["batch"].as_str(), Some("B\"01"));
    assert_eq!(table["recording"]["payload_g"][1][1].as_float(), Some(2.0));
    assert_eq!(table["motion"]["rotation_deg"][2].as_float(), Some(40.0));
    assert_eq!(table["sync"]["offset_s"].as_str(), Some("estimate"));
}

#[test]
fn coloured_noise_has_its_standard_deviation_and_correlation() {
    let capture = Capture {
        noise: Noise {
            white_m: 0.0,
            coloured_m: 1e-3,
            correlation_s: 0.1,
        },
        ..Capture::default()
    };
    let mut out = Vec::new();
    nexus_csv(&mut out, &capture, &vec![[0.0; 3]; 40_000]).unwrap();
    let text = String::from_utf8(out).unwrap();
    let x: Vec<f64> = text
        .lines()
        .skip(5)
        .map(|l| l.split(',').nth(2).unwrap().parse().unwrap())
        .collect();
    let variance = x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64;
    let lag = x.windows(11).map(|w| w[0] * w[10]).sum::<f64>() / (x.len() - 10) as f64;
    assert!((variance - 1.0).abs() < 0.1, "{variance}");
    assert!(
        (lag / variance - (-1.0f64).exp()).abs() < 0.06,
        "{}",
        lag / variance
    );
}
