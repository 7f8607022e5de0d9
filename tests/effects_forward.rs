//! Causes of the catalogue in forward dynamics and back: a robot is simulated with a cause, and the inverse
//! model with the same cause asks for the voltage that was given.

mod common;

use common::*;
use deacal::effects::{Acting, Site, When, by_id};
use deacal::model::{Mechanics, Parameters, Robot};
use deacal::simulate::{
    Addition, Drive, EffectClock, Hold, Motion, Options, Sampled, Side, Voltage, effect_addition,
    effect_reading, effect_robot, motion,
};

const PIVOT_M: [f64; 3] = [2.5e-3, 95e-3, 12.5e-3];

fn subject() -> (Robot, Parameters) {
    let g = golden("forward_dynamics");
    (robot(&g["rig"]), parameters(&g))
}

/// Two rates, three phases and a hold.
fn drive() -> Sampled {
    let sines = Drive::Multisine {
        peak_v: [4000.0, 3600.0, 3200.0],
        frequency_hz: vec![0.31, 0.7, 1.3],
    };
    let rate = 1000.0;
    let mut phi = sines.sampled(7.0, rate).unwrap().samples_v().to_vec();
    let last = *phi.last().unwrap();
    phi.extend(std::iter::repeat_n(last, 2000));
    Sampled::new(0.0, 1.0 / rate, phi, Hold::Linear).unwrap()
}

fn when() -> When {
    When {
        recording: 3,
        series_s: 240.0,
        start_s: 0.0,
    }
}

fn options() -> Options {
    Options {
        duration_s: 9.0,
        ..Options::default()
    }
}

/// The motion that the capture reads of the robot with the cause.
fn simulated(robot: &Robot, parameters: &Parameters, acting: &Acting, log: &Sampled) -> Motion {
    let site = acting.effect.site();
    let given = EffectClock::new(log, std::slice::from_ref(acting), 0.0);
    let voltage: &dyn Voltage = if site == Site::Clock { &given } else { log };
    let own = effect_robot(acting, robot);
    let addition = effect_addition(acting, robot, parameters, when());
    assert_eq!(
        addition.is_err(),
        matches!(site, Site::Motion | Site::Clock)
    );
    let boxed: Vec<Box<dyn Addition>> = addition.into_iter().collect();
    let list: Vec<&dyn Addition> = boxed.iter().map(|b| &**b).collect();
    let m = motion(&own, parameters, voltage, &options(), &list).unwrap();
    effect_reading(acting, &m, PIVOT_M)
}

/// RMSE above 1 kV of the voltage that the measured motion needs at the film against the one that the log
/// makes there, V.
fn round_trip(robot: &Robot, p: &Parameters, acting: &Acting, m: &Motion, log: &Sampled) -> f64 {
    let effects = std::slice::from_ref(acting);
    let mechanics = Mechanics::with_effects(robot, &m.track(), effects, PIVOT_M).unwrap();
    let n = mechanics.samples();
    let clock = |t: f64| match acting.effect.site() {
        Site::Clock => acting.effect.clock(&acting.values, t),
        _ => t,
    };
    let (mut sum, mut count) = (0.0, 0);
    for k in 0..3 {
        let command: Vec<f64> = (0..n)
            .map(|i| log.phi_v(clock(i as f64 * m.step_s), Side::Before)[k])
            .collect();
        let film_v = mechanics.film_voltage_v(k, when(), effects, &command);
        let half = mechanics.half_capacitance_slope(k, when(), effects);
        let torque = mechanics.effect_torque_n_m(k, when(), effects);
        let slack = mechanics
            .slack_torque_n_m(k, when(), effects, p, &film_v)
            .unwrap();
        let factor = mechanics.stress_factor(k, when(), effects, &p.film);
        let film = mechanics.film_torque_n_m(k, p).unwrap();
        for i in 30..n - 30 {
            if film_v[i] <= 1000.0 {
                continue;
            }
            let f = factor.as_ref().map_or([1.0; 2], |f| f[i]);
            let needed = film[i][0] * f[0]
                + film[i][1] * f[1]
                + mechanics.chains[k].load(i)
                + mechanics.forearm_torque_n_m(i, &p.forearm)[k]
                - torque[i]
                + slack.as_ref().map_or(0.0, |s| s[i]);
            let error = (needed / half[i]).max(0.0).sqrt() - film_v[i];
            sum += error * error;
            count += 1;
        }
    }
    assert!(count > 1000);
    (sum / f64::from(count)).sqrt()
}

#[test]
fn the_inverse_model_with_the_cause_asks_for_the_voltage_that_was_given() {
    let (robot, parameters) = subject();
    let log = drive();
    let all = [true; 3];
    let one = [false, true, false];
    // id, values, actuators, what is allowed: 2 V, 5 V for a threshold or presliding
    let cases: &[(&str, &[f64], [bool; 3], f64)] = &[
        ("series_resistance", &[1e7], all, 2.0),
        ("leakage", &[0.05, 1.5, 0.0], all, 2.0),
        ("leakage", &[0.05, 1.5, 3e6], all, 2.0),
        ("amplifier_gain", &[0.05, 60.0], all, 2.0),
        ("amplifier_deadband", &[1500.0, 40.0], all, 5.0),
        ("amplifier_saturation", &[2800.0, 80.0], all, 5.0),
        ("slew_limit", &[6000.0, 4000.0], all, 5.0),
        ("permittivity_stretch", &[0.1, 0.2], all, 2.0),
        ("dielectric_relaxation", &[0.08, 0.4, 0.05], all, 2.0),
        ("electrode_failure", &[0.2, 4.005, 3.0], one, 5.0),
        ("electrode_stiffness", &[5e4], all, 2.0),
        ("hinge_stiffness", &[0.05, 2.3, 3.0], all, 2.0),
        ("mullins_softening", &[0.1, 4e4], all, 2.0),
        ("slow_creep", &[5e4, 1100.0, 300.0], all, 2.0),
        ("loss_of_tension", &[0.9, 0.2], all, 5.0),
        ("actuator_asymmetry", &[1.05], one, 2.0),
        ("temperature_drift", &[0.05, 0.02, 400.0], all, 2.0),
        ("joint_friction", &[1e-4, 6e-3, 0.3], all, 5.0),
        ("joint_damping", &[1e-4], all, 2.0),
        ("end_stop", &[4.2, 3.0, 1e-3, 0.05], all, 5.0),
        ("actuator_mass", &[2e-5], one, 2.0),
        ("link_length_error", &[2.0, 5e-3], all, 2.0),
        ("payload_change", &[1e-3, 4.005, 3.0], all, 5.0),
        ("time_offset", &[0.02], all, 2.0),
        ("clock_skew", &[3e-3], all, 2.0),
        ("frame_tilt", &[0.01, -0.02, 0.03], all, 2.0),
        ("marker_offset", &[5e-4, -3e-4, 4e-4], all, 2.0),
        ("mocap_lag", &[0.02, 0.6], all, 2.0),
        ("x_space_charge", &[0.1, 5.0], all, 2.0),
        ("x_electrode_viscosity", &[2e3], all, 2.0),
        ("x_nonlinear_flow", &[1e5, 0.5, 3.0], all, 2.0),
        ("x_backlash", &[0.02, 0.02], all, 5.0),
    ];
    for effect in deacal::effects::CATALOGUE {
        let id = effect.id();
        assert!(cases.iter().any(|c| c.0 == id), "{id}");
    }
    let plain = motion(&robot, &parameters, &log, &options(), &[]).unwrap();
    let mut complaints = Vec::new();
    for &(id, values, on, allowed) in cases {
        let acting = Acting {
            effect: by_id(id).unwrap(),
            values: values.to_vec(),
            on,
        };
        let m = simulated(&robot, &parameters, &acting, &log);
        let off = Acting::off(acting.effect, on);
        let with = round_trip(&robot, &parameters, &acting, &m, &log);
        let without = round_trip(&robot, &parameters, &off, &m, &log);
        println!("{id:24} {with:8.3} V with the cause, {without:8.1} V without");
        if with.is_nan() || with > allowed || without < 2.0 * with.max(0.5) {
            complaints.push(format!(
                "{id}: {with:.3} V with, {without:.1} V without, allowed {allowed}"
            ));
        }
        // Off it changes nothing, to the bit.
        let still = simulated(&robot, &parameters, &off, &log);
        if still.position_m != plain.position_m
            || still.acceleration_m_s2 != plain.acceleration_m_s2
        {
            complaints.push(format!("{id}: off it moves the robot"));
        }
    }
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}
