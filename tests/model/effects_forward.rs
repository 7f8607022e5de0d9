//! Causes of the catalogue in forward dynamics and back: a robot is simulated with a cause, and the inverse
//! model with the same cause asks for the voltage that was given.

use crate::common;

use common::*;
use deacal::effects::learnt::{Form, Learnt, Place, Variable};
use deacal::effects::{Acting, Site, When, by_id};
use deacal::model::{Mechanics, Parameters, Robot};
use deacal::simulate::{
    Action, Addition, Drive, EffectClock, Hold, Motion, Options, Sampled, Side, Situation, Voltage,
    effect_addition, effect_reading, effect_robot, motion, motion_with_effects, rest,
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
    needed_with(robot, p, std::slice::from_ref(acting), m, log)
}

/// The same of several causes.
fn needed_with(
    robot: &Robot,
    p: &Parameters,
    effects: &[Acting],
    m: &Motion,
    log: &Sampled,
) -> f64 {
    let mechanics = Mechanics::with_effects(robot, &m.track(), effects, PIVOT_M, None).unwrap();
    let n = mechanics.samples();
    let clock = |t: f64| {
        let on_clock = effects.iter().filter(|a| a.effect.site() == Site::Clock);
        on_clock.fold(t, |t, a| a.effect.clock(&a.values, t))
    };
    let (mut sum, mut count) = (0.0, 0);
    let command = [0, 1, 2].map(|k| -> Vec<f64> {
        (0..n)
            .map(|i| log.phi_v(clock(i as f64 * m.step_s), Side::Before)[k])
            .collect()
    });
    let told = [0, 1, 2].map(|k| &command[k][..]);
    for k in 0..3 {
        let film_v = mechanics.film_voltage_v(k, when(), effects, told);
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
                + mechanics.forearm_torques_n_m(&p.forearm)[i][k]
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
        ("series_resistance", &[1e7, 0.0], all, 2.0),
        ("series_resistance", &[1e7, 5.0], all, 2.0),
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

/// A learnt term in all actuators.
fn term(place: Place, form: Form, values: &[f64]) -> Acting {
    assert_eq!(form.count(), values.len(), "{form:?}");
    Acting {
        effect: Learnt::new(place, form, Vec::new()),
        values: values.to_vec(),
        on: [true; 3],
    }
}

/// A term of every form, at every place, each large enough to be seen; what is allowed, V: 0.1, and 1 where
/// samples see the motion or the voltage only roughly: presliding, a rate of the voltage, a swing.
fn terms() -> Vec<(Acting, f64)> {
    use Variable as V;
    let spline = |place: Place, of: V, by: Option<V>, knots: &[f64], values: &[f64]| {
        let knots = knots.to_vec();
        term(place, Form::Spline { of, knots, by }, values)
    };
    let lag = |place: Place, of: V, by: Option<V>, times_s: &[f64], values: &[f64]| {
        let times_s = times_s.to_vec();
        term(place, Form::Lag { of, times_s, by }, values)
    };
    let presliding = |place: Place, of: V, ranges: &[f64], values: &[f64]| {
        let ranges = ranges.to_vec();
        term(place, Form::Presliding { of, ranges }, values)
    };
    let wave = |place: Place, frequency_hz: f64, by: Option<V>, values: &[f64]| {
        term(place, Form::Wave { frequency_hz, by }, values)
    };
    let force = |form: Form, values: &[f64]| term(Place::Force, form, values);
    let (angles, areas) = ([3.6, 3.9, 4.2, 4.5], [4.0, 8.0, 12.0]);
    let rates = [-2.0, -0.3, 0.3, 2.0];
    let volts = [0.0, 1500.0, 3000.0, 4500.0];
    let slews = [-2e4, -2e3, 2e3, 2e4];
    let series = [230.0, 243.0, 260.0];
    let square = Some(V::SquaredVoltage);
    let ridge = Form::Ridge {
        along: [0.6, 0.0, 0.8],
        knots: vec![-0.033, -0.03, -0.026],
    };
    let affine = Form::Affine {
        about_m: [0.0, 0.0, -0.037],
    };
    let stiff = [2e-3, -1e-3, 2e-3, -1.0, -1.0, -2.0, 0.5, 0.0, 0.3];
    vec![
        (
            spline(
                Place::Bicep,
                V::BicepAngle,
                None,
                &angles,
                &[2e-4, -4e-4, 2e-4, 4e-4],
            ),
            0.1,
        ),
        (
            spline(
                Place::Bicep,
                V::BicepRate,
                None,
                &rates,
                &[2e-3, 1e-3, -1e-3, -2e-3],
            ),
            0.1,
        ),
        (
            spline(
                Place::Bicep,
                V::BicepAngle,
                Some(V::BicepRate),
                &angles,
                &[-1e-3, -2e-3, -1e-3, 0.0],
            ),
            0.1,
        ),
        (
            spline(
                Place::Film,
                V::LozengeAngle,
                None,
                &[1.2, 1.6, 2.0, 2.4],
                &[2e-3, -2e-3, 2e-3, 0.0],
            ),
            0.1,
        ),
        (
            spline(
                Place::Film,
                V::LargestStretch,
                None,
                &areas,
                &[2e-3, -1e-3, 1e-3],
            ),
            0.1,
        ),
        (
            spline(
                Place::Series,
                V::SeriesTime,
                None,
                &series,
                &[0.0, 4e-4, -2e-4],
            ),
            0.1,
        ),
        (
            spline(
                Place::Electrical,
                V::Voltage,
                None,
                &volts,
                &[0.0, 4e5, -4e5, 8e5],
            ),
            0.1,
        ),
        (
            spline(
                Place::Electrical,
                V::VoltageRate,
                Some(V::Voltage),
                &slews,
                &[300.0, 100.0, -100.0, -300.0],
            ),
            1.0,
        ),
        (
            spline(
                Place::Capacitance,
                V::AreaStretch,
                None,
                &areas,
                &[0.05, -0.05, 0.1],
            ),
            0.1,
        ),
        (
            spline(
                Place::Capacitance,
                V::SeriesTime,
                None,
                &series,
                &[0.0, 0.1, -0.1],
            ),
            0.1,
        ),
        (
            presliding(Place::Bicep, V::BicepAngle, &[6e-3, 0.1], &[-2e-4, -2e-4]),
            1.0,
        ),
        (
            presliding(Place::Film, V::LozengeAngle, &[0.02, 0.2], &[-3e-3, 1e-3]),
            1.0,
        ),
        (
            presliding(Place::Film, V::AreaStretch, &[0.1, 1.0], &[-8e-3, 2e-3]),
            1.0,
        ),
        (
            lag(
                Place::Bicep,
                V::BicepAngle,
                None,
                &[0.05, 0.8],
                &[-5e-3, 5e-3],
            ),
            0.1,
        ),
        (
            lag(
                Place::Film,
                V::SquaredVoltage,
                None,
                &[0.2, 3.0],
                &[2e-10, -2e-10],
            ),
            0.1,
        ),
        (
            lag(
                Place::Film,
                V::SquaredVoltage,
                Some(V::LozengeAngle),
                &[0.2, 3.0],
                &[1e-10, -1e-10],
            ),
            0.1,
        ),
        (
            lag(
                Place::Electrical,
                V::SquaredVoltage,
                None,
                &[0.05, 0.8],
                &[-0.1, 0.15],
            ),
            0.1,
        ),
        (wave(Place::Bicep, 2.3, None, &[4e-4, 2e-4]), 0.1),
        (wave(Place::Electrical, 1.7, square, &[0.05, 0.05]), 0.1),
        (
            wave(Place::Electrical, 1.7, Some(V::VoltageRate), &[30.0, 30.0]),
            1.0,
        ),
        (
            term(Place::Electrical, Form::Neighbours, &[0.08, -0.05]),
            0.1,
        ),
        (
            force(
                Form::Potential {
                    centres_m: CENTRES_M.to_vec(),
                    width_m: 0.004,
                },
                &[2e-5, -3e-5],
            ),
            0.1,
        ),
        (force(ridge, &[6e-3, -9e-3, 6e-3]), 0.1),
        (force(affine, &stiff), 0.1),
        (
            force(Form::Drag, &[-0.3, -0.4, -0.3, -2.0, -2.0, -2.0]),
            0.1,
        ),
        (force(SWING, &[0.02, 0.01, 0.02, 0.0, 0.005, 0.0]), 1.0),
    ]
}

/// Two points in the workspace, m.
const CENTRES_M: [[f64; 3]; 2] = [[0.0, 0.0, -0.036], [1e-3, -1e-3, -0.038]];

/// A mass on a spring.
const SWING: Form = Form::Oscillator {
    frequency_hz: 3.0,
    damping: 0.05,
};

#[test]
fn a_learnt_term_of_every_form_at_every_place_is_found_back() {
    let (robot, parameters) = subject();
    let log = drive();
    let all = terms();
    // the last is no robot's
    for place in &Place::ALL[..6] {
        let place = *place;
        let there = |(a, _): &(Acting, f64)| a.effect.learnt().is_some_and(|l| l.place == place);
        assert!(all.iter().any(there), "{}", place.name());
    }
    let plain = motion(&robot, &parameters, &log, &options(), &[]).unwrap();
    let mut complaints = Vec::new();
    for (acting, allowed) in all {
        let learnt = acting.effect.learnt().unwrap();
        let m = simulated(&robot, &parameters, &acting, &log);
        let off = Acting::off(acting.effect, acting.on);
        let with = round_trip(&robot, &parameters, &acting, &m, &log);
        let without = round_trip(&robot, &parameters, &off, &m, &log);
        let name = format!("{} {:?}", learnt.place.name(), learnt.form);
        println!("{with:8.3} V with the term, {without:8.1} V without: {name}");
        if with.is_nan() || with > allowed || without < 20.0 {
            complaints.push(format!(
                "{name}: {with:.3} V with, {without:.1} V without, allowed {allowed}"
            ));
        }
        // Zero coefficients change nothing, to the bit.
        let still = simulated(&robot, &parameters, &off, &log);
        if still.position_m != plain.position_m
            || still.acceleration_m_s2 != plain.acceleration_m_s2
        {
            complaints.push(format!("{name}: off it moves the robot"));
        }
    }
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn learnt_terms_after_a_cause_of_the_catalogue_are_found_back_in_one_actuator_from_a_loaded_start()
{
    // in one actuator, behind an amplifier that gives another voltage from the first sample on
    let (robot, parameters) = subject();
    let held = Drive::Multisine {
        peak_v: [1500.0; 3],
        frequency_hz: vec![0.31, 0.7, 1.3],
    };
    let mut phi = held.sampled(7.0, 1000.0).unwrap().samples_v().to_vec();
    for v in phi.iter_mut().flatten() {
        *v += 2000.0;
    }
    let log = Sampled::new(0.0, 1e-3, phi, Hold::Linear).unwrap();
    let one = [false, true, false];
    let gain = Acting {
        effect: by_id("amplifier_gain").unwrap(),
        values: vec![0.05, 60.0],
        on: [true; 3],
    };
    let times_s = vec![0.3, 20.0];
    let of = Variable::SquaredVoltage;
    let lag = Acting {
        on: one,
        ..term(
            Place::Electrical,
            Form::Lag {
                of,
                times_s,
                by: None,
            },
            &[0.1, -0.2],
        )
    };
    let swing = term(Place::Force, SWING, &[0.02, 0.01, 0.02, 0.0, 0.005, 0.0]);
    let effects = [gain, lag, swing];
    let options = Options {
        duration_s: 6.5,
        ..Options::default()
    };
    let (m, ended) = motion_with_effects(
        &robot,
        &parameters,
        &log,
        &options,
        &effects,
        when(),
        PIVOT_M,
    )
    .unwrap();
    assert!(ended.is_none());
    let with = needed_with(&robot, &parameters, &effects, &m, &log);
    let without = needed_with(&robot, &parameters, &effects[..1], &m, &log);
    println!("{with:.3} V with the terms, {without:.1} V without");
    assert!(with < 0.5 && without > 20.0, "{with} V, {without} V");
}

#[test]
fn a_learnt_lag_at_rest_is_the_spring_that_it_becomes() {
    let (robot, parameters) = subject();
    let (middle, stiffness) = (3.95, 0.05);
    let line = |at: [f64; 2]| at.map(|x| -stiffness * (x - middle));
    let ends = [3.0, 5.0];
    let spline = |values: [f64; 2]| {
        let knots = ends.to_vec();
        let of = Variable::BicepAngle;
        term(
            Place::Bicep,
            Form::Spline {
                of,
                knots,
                by: None,
            },
            &values,
        )
    };
    let lag = Form::Lag {
        of: Variable::BicepAngle,
        times_s: vec![5.0],
        by: None,
    };
    let rests = |effects: &[Acting]| {
        let boxed: Vec<Box<dyn Addition>> = effects
            .iter()
            .map(|a| effect_addition(a, &robot, &parameters, when()).unwrap())
            .collect();
        let list: Vec<&dyn Addition> = boxed.iter().map(|b| &**b).collect();
        rest(&robot, &parameters, [2000.0, 1000.0, 0.0], 0.0, &list).unwrap()
    };
    let spring = rests(&[spline(line(ends))]);
    let settled = rests(&[
        term(Place::Bicep, lag, &[-stiffness]),
        spline([stiffness * middle; 2]),
    ]);
    for i in 0..3 {
        let off = spring.position_m[i] - settled.position_m[i];
        assert!(off.abs() < 1e-10, "axis {i}: {off} m");
    }
    let stiff = spring.stiffness_n_m / settled.stiffness_n_m;
    assert!((stiff - 1.0).abs() < 1e-4, "{stiff}");
    let bare = rests(&[]);
    let moved = (spring.position_m[2] - bare.position_m[2]).abs();
    assert!(moved > 1e-4, "{moved} m");
}

#[test]
fn a_robot_with_a_learnt_wave_begins_at_rest_whenever_its_recording_begins() {
    let (robot, parameters) = subject();
    let form = Form::Wave {
        frequency_hz: 0.25,
        by: None,
    };
    // at its top after 5 s
    let wave = term(Place::Bicep, form, &[1e-3, 0.0]);
    let late = When {
        start_s: 5.0,
        ..when()
    };
    let options = Options {
        start_s: late.start_s,
        duration_s: 1.0,
        ..Options::default()
    };
    let held = Sampled::new(5.0, 1.0, vec![[2000.0; 3]; 3], Hold::Linear).unwrap();
    let addition = effect_addition(&wave, &robot, &parameters, late).unwrap();
    let m = motion(&robot, &parameters, &held, &options, &[&*addition]).unwrap();
    let a = m.acceleration_m_s2[0];
    assert!(a.iter().all(|a| a.abs() < 1e-6), "{a:?} m/s^2");
}

#[test]
fn a_learnt_potential_gives_back_what_it_took() {
    let (robot, parameters) = subject();
    let width_m = 0.004;
    let sizes = [2e-5, -3e-5];
    let centres_m = CENTRES_M.to_vec();
    let acting = term(Place::Force, Form::Potential { centres_m, width_m }, &sizes);
    let addition = effect_addition(&acting, &robot, &parameters, when()).unwrap();
    let options = Options {
        energy: true,
        ..options()
    };
    let m = motion(&robot, &parameters, &drive(), &options, &[&*addition]).unwrap();
    let held = |u: &[f64; 3]| -> f64 {
        let one = |(c, centre): (&f64, &[f64; 3])| {
            let d = (0..3).map(|i| (u[i] - centre[i]).powi(2)).sum::<f64>();
            c * (-0.5 * d / (width_m * width_m)).exp()
        };
        sizes.iter().zip(&CENTRES_M).map(one).sum()
    };
    let along: Vec<f64> = m.position_m.iter().map(held).collect();
    let fell = along[0] - along[along.len() - 1];
    let highest = along.iter().copied().fold(f64::MIN, f64::max);
    let lowest = along.iter().copied().fold(f64::MAX, f64::min);
    let swing = highest - lowest;
    println!(
        "work {:.3e} J, fell {fell:.3e} J, swing {swing:.3e} J",
        m.energy.additions_j
    );
    assert!(swing > 1e-6, "{swing} J");
    assert!((m.energy.additions_j - fell).abs() < 1e-4 * swing);
}

/// A robot at one place whose effector has a speed.
fn moving(velocity_m_s: [f64; 3]) -> Situation {
    Situation {
        t_s: 0.0,
        position_m: [0.0, 0.0, -0.036],
        velocity_m_s,
        theta_dea_rad: [1.8; 3],
        theta_dea_rate_rad_s: [0.0; 3],
        theta_b_rad: [4.0; 3],
        theta_b_rate_rad_s: [0.0; 3],
        stretch: [[3.0, 2.5]; 3],
        film_stress_pa: [[1e5; 2]; 3],
        capacitance_f: [1e-10; 3],
        command_v: [0.0; 3],
    }
}

#[test]
fn a_learnt_mass_on_a_spring_without_damping_gives_back_all_and_with_it_less() {
    let (robot, parameters) = subject();
    // shaken for a second, then held: what it took is in its swing, m p^2/2 + m (omega b)^2/2
    let mass = [0.02, 0.01, 0.03, 0.002, 0.0, 0.005];
    let omega = std::f64::consts::TAU * 3.0;
    let speed = |t: f64| match t < 1.0 {
        true => [0.1, 0.05, -0.08].map(|a| a * (9.0 * t).sin() * (std::f64::consts::PI * t).sin()),
        false => [0.0; 3],
    };
    let run = |damping: f64| -> (f64, f64) {
        let form = Form::Oscillator {
            frequency_hz: 3.0,
            damping,
        };
        let acting = term(Place::Force, form, &mass);
        let addition = effect_addition(&acting, &robot, &parameters, when()).unwrap();
        let n = addition.states();
        assert_eq!(n, 6);
        let rates = |z: &[f64], t: f64| -> Vec<f64> {
            let (mut action, mut rate) = (Action::default(), vec![0.0; n]);
            addition.act(&moving(speed(t)), z, &mut action, &mut rate);
            // and the work that is done on it
            let power = (0..3).map(|i| action.force_n[i] * speed(t)[i]).sum::<f64>();
            rate.push(-power);
            rate
        };
        let mut z = vec![0.0; n + 1];
        addition.start(&moving([0.0; 3]), &mut z[..n]);
        let h = 1e-3;
        for step in 0..1500 {
            let t = f64::from(step) * h;
            let on = |k: &[f64], x: f64| -> Vec<f64> {
                z.iter().zip(k).map(|(z, k)| z + x * h * k).collect()
            };
            let k1 = rates(&z[..n], t);
            let k2 = rates(&on(&k1, 0.5)[..n], t + 0.5 * h);
            let k3 = rates(&on(&k2, 0.5)[..n], t + 0.5 * h);
            let k4 = rates(&on(&k3, 1.0)[..n], t + h);
            for i in 0..=n {
                z[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
            }
        }
        let [xx, yy, zz, xy, xz, yz] = mass;
        let matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let twice = |x: [f64; 3]| -> f64 {
            let row = |i: usize| (0..3).map(|j| matrix[i][j] * x[j]).sum::<f64>();
            (0..3).map(|i| x[i] * row(i)).sum()
        };
        let moving = twice([z[1], z[3], z[5]]);
        let bent = twice([z[0], z[2], z[4]].map(|b| omega * b));
        (z[n], 0.5 * (moving + bent))
    };
    let (work, stored) = run(0.0);
    println!("{work:.6e} J of work, {stored:.6e} J stored");
    assert!(work > 1e-6);
    assert!((work - stored).abs() < 1e-6 * work, "{work} J, {stored} J");
    let (work, stored) = run(0.1);
    assert!(stored < 0.5 * work, "{work} J, {stored} J");
}
