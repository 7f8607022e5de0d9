//! An axis: a slide of mass, damping and spring on a drive, or led along a path with a force cell between.
//!
//! ```text
//! m x'' + c x' + k x + b + push(x, v, states) = drive(u, states)
//! ```
//!
//! by the classical Runge-Kutta scheme in steps of a quarter of a millisecond or less.

use super::super::dice::Dice;
use super::forms;
use super::mechanism::{Draw, Mechanism, Now, Setting, Spring};
use super::noise::Noise;
use super::path::{MOTIONS, Path, Plan, path};
use super::unknown;
use super::visible::{Balance, band, derivatives, low_pass};
use super::write::{AxisText, Columns};
use super::{LineRecording, Made, Text};

/// What a cause asks of the axis it is to show on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Nothing.
    Any,
    /// A spring.
    Spring,
    /// A drive between command and force.
    Drive,
    /// Both.
    DrivenSpring,
    /// A clock.
    Clock,
}

pub type Maker = fn(&mut Draw) -> Mechanism;

/// Causes of the catalogue.
pub const EFFECTS: &[(&str, Maker, Needs)] = &[
    ("joint_friction", forms::friction, Needs::Any),
    ("x_load_friction", forms::load_friction, Needs::Spring),
    ("x_stribeck", forms::stribeck, Needs::Any),
    ("x_rate_friction", forms::rate_friction, Needs::Any),
    ("x_quadratic_damping", forms::quadratic_damping, Needs::Any),
    ("x_direction_damping", forms::direction_damping, Needs::Any),
    ("x_stroke_inertia", forms::stroke_inertia, Needs::Any),
    (
        "x_nonlinear_stiffness",
        forms::nonlinear_stiffness,
        Needs::Any,
    ),
    ("end_stop", forms::end_stop, Needs::Any),
    ("x_backlash", forms::backlash, Needs::Spring),
    ("slow_creep", forms::creep, Needs::Spring),
    ("mullins_softening", forms::softening, Needs::Spring),
    ("x_permanent_set", forms::permanent_set, Needs::Spring),
    ("amplifier_saturation", forms::saturation, Needs::Drive),
    ("amplifier_deadband", forms::deadband, Needs::Drive),
    ("x_drive_power", forms::drive_power, Needs::Drive),
    ("x_drive_lag", forms::drive_lag, Needs::Drive),
    (
        "x_drive_second_order",
        forms::drive_second_order,
        Needs::Drive,
    ),
    ("x_drive_stroke", forms::drive_stroke, Needs::DrivenSpring),
    ("time_offset", forms::time_offset, Needs::Any),
    ("temperature_drift", forms::drift, Needs::Spring),
    ("x_zero_drift", forms::zero_drift, Needs::Any),
];

/// Causes that are in no catalogue.
pub const UNKNOWN: &[(&str, Maker, Needs)] = &[
    ("x_cogging", unknown::cogging, Needs::Any),
    ("x_magnet", unknown::magnet, Needs::Any),
    ("x_snap", unknown::snap, Needs::Any),
    ("x_crank", unknown::crank, Needs::Any),
    ("x_pump", unknown::pump, Needs::Any),
    ("x_second_mass", unknown::second_mass, Needs::Any),
    ("x_wander", unknown::wander, Needs::Any),
    (
        "x_magnetic_hysteresis",
        unknown::magnetic_hysteresis,
        Needs::Drive,
    ),
    ("x_wake", unknown::wake, Needs::Any),
    ("x_sticky_place", unknown::sticky_place, Needs::Any),
    ("x_frozen_reading", unknown::frozen_reading, Needs::Any),
    ("x_lost_counts", unknown::lost_counts, Needs::Any),
];

/// Longest step of the integration, s.
const STEP_S: f64 = 2.5e-4;
/// Most samples of a recording.
const MOST: f64 = 9000.0;

/// An axis, and how it is run. A hinge on its bench is one without mass that is led.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// kg.
    pub mass: f64,
    /// N s/m.
    pub damping: f64,
    /// Its spring.
    pub spring: Spring,
    /// Force at rest, N.
    pub bias: f64,
    /// N per unit of input.
    pub gain: f64,
    /// Led along its path, the input is a force cell; else driven.
    pub led: bool,
    /// Stiffness and damping of a position loop; 0: open.
    pub servo: [f64; 2],
    /// Largest excursion, m.
    pub stroke: f64,
    /// The frequency that motions are made around, Hz.
    pub base_hz: f64,
    /// Length of a recording, s.
    pub duration_s: f64,
    /// Distance of the samples, s.
    pub step_s: f64,
    /// Position that is written at rest, m.
    pub zero: f64,
}

fn axis(dice: &mut Dice, needs: Needs) -> Axis {
    let spring = matches!(needs, Needs::Spring | Needs::DrivenSpring) || dice.chance(0.6);
    let driven = matches!(needs, Needs::Drive | Needs::DrivenSpring);
    let led = dice.chance(0.45) && !driven;
    let mass = dice.log_range(0.05, 10.0);
    let stroke = dice.log_range(2e-3, 0.3);
    let own = std::f64::consts::TAU * dice.log_range(1.5, 8.0);
    let (zeta, drag) = (dice.log_range(0.03, 0.6), dice.log_range(0.5, 8.0));
    let slow = dice.log_range(0.04, 0.35);
    let (stiffness, damping, base_hz) = if spring {
        let base = (slow * own / std::f64::consts::TAU).clamp(0.08, 1.2);
        (mass * own * own, 2.0 * zeta * mass * own, base)
    } else {
        (0.0, mass * drag, dice.log_range(0.1, 0.9))
    };
    let duration_s = (dice.log_range(5.0, 20.0) / base_hz).clamp(8.0, 60.0);
    let highest = if spring && !led {
        (own / std::f64::consts::TAU).max(3.5 * base_hz)
    } else {
        3.5 * base_hz
    };
    let rates = [50.0, 100.0, 200.0, 250.0, 500.0, 1000.0];
    let fits = |r: &&f64| **r > 25.0 * highest && **r * duration_s < MOST;
    let fit: Vec<f64> = rates.iter().filter(fits).copied().collect();
    let any = dice.below(fit.len().clamp(1, 3));
    let rate = fit.get(any).copied().unwrap_or(200.0);
    let duration_s = duration_s.min(MOST / rate);
    let loop_hz = base_hz * dice.range(4.0, 9.0);
    let closed = !spring || dice.chance(0.3);
    let w = std::f64::consts::TAU * loop_hz;
    let servo = if led || !closed {
        [0.0; 2]
    } else {
        [mass * w * w, 1.4 * mass * w]
    };
    let force = stiffness * stroke + mass * (6.0 * base_hz).powi(2) * stroke;
    let bias = if dice.chance(0.5) {
        force * dice.range(-0.3, 0.3)
    } else {
        0.0
    };
    Axis {
        mass,
        damping,
        spring: Spring::Linear(stiffness),
        bias,
        gain: if led {
            1.0
        } else {
            force / dice.log_range(0.5, 20.0)
        },
        led,
        servo,
        stroke,
        base_hz,
        duration_s,
        step_s: 1.0 / rate,
        zero: if dice.chance(0.5) {
            stroke * dice.range(-2.0, 2.0)
        } else {
            0.0
        },
    }
}

/// Course of a simulation at every integration step.
pub struct Course {
    /// Distance of the steps, s.
    pub step_s: f64,
    /// Excursion, m.
    pub x: Vec<f64>,
    /// Commanded (or felt) force, N.
    pub u: Vec<f64>,
}

/// The force that the plain axis needs along a path, at one of its values.
pub fn planned(a: &Axis, p: &Path, i: usize) -> f64 {
    let spring = a.spring.force(a.stroke * p.x[i]);
    a.stroke * (a.mass * p.a[i] + a.damping * p.v[i]) + spring + a.bias
}

/// Runs an axis along `p`, of whose values every `stride`-th stands half an integration step from the one
/// before.
pub fn simulate(a: &Axis, p: &Path, mechanism: Option<&Mechanism>, stride: usize) -> Course {
    let h = 2.0 * stride as f64 * p.step_s;
    let steps = (p.x.len() - 1) / (2 * stride);
    let states = mechanism.map_or(Vec::new(), |m| m.states.clone());
    let n = states.len();
    let mut y = vec![0.0; n + 2];
    y[2..].copy_from_slice(&states);
    let mut out = Course {
        step_s: h,
        x: Vec::with_capacity(steps),
        u: Vec::with_capacity(steps),
    };
    // Rates of x, v and the states at value `i` of the path, and the force commanded or felt.
    let rates = |i: usize, y: &[f64], dy: &mut [f64]| -> f64 {
        let (x, v) = if a.led {
            (a.stroke * p.x[i], a.stroke * p.v[i])
        } else {
            (y[0], y[1])
        };
        let now = Now {
            t: i as f64 * p.step_s,
            x,
            v,
        };
        let (_, rates) = dy.split_at_mut(2);
        let push = mechanism.and_then(|m| m.push.as_ref());
        let push = push.map_or(0.0, |f| f(&now, &y[2..], rates));
        if a.led {
            return planned(a, p, i) + push;
        }
        let error = [a.stroke * p.x[i] - x, a.stroke * p.v[i] - v];
        let u = planned(a, p, i) + a.servo[0] * error[0] + a.servo[1] * error[1];
        let drive = mechanism.and_then(|m| m.drive.as_ref());
        let drive = drive.map_or(u, |f| f(u, &now, &y[2..], rates));
        dy[0] = v;
        dy[1] = (drive - a.damping * v - a.spring.force(x) - a.bias - push) / a.mass;
        u
    };
    let mut k = [(); 4].map(|()| vec![0.0; n + 2]);
    let mut at = vec![0.0; n + 2];
    for s in 0..steps {
        let i = 2 * stride * s;
        let u = rates(i, &y, &mut k[0]);
        out.u.push(u);
        out.x.push(if a.led { a.stroke * p.x[i] } else { y[0] });
        for (stage, (half, share)) in [(stride, 0.5), (stride, 0.5), (2 * stride, 1.0)]
            .into_iter()
            .enumerate()
        {
            for j in 0..n + 2 {
                at[j] = y[j] + share * h * k[stage][j];
            }
            let (_, later) = k.split_at_mut(stage + 1);
            rates(i + half, &at, &mut later[0]);
        }
        for j in 0..n + 2 {
            y[j] += h / 6.0 * (k[0][j] + 2.0 * (k[1][j] + k[2][j]) + k[3][j]);
        }
        if let Some(after) = mechanism.and_then(|m| m.after.as_ref()) {
            let i = i + 2 * stride;
            let now = Now {
                t: i as f64 * p.step_s,
                x: if a.led { a.stroke * p.x[i] } else { y[0] },
                v: if a.led { a.stroke * p.v[i] } else { y[1] },
            };
            after(&now, &mut y[2..]);
        }
    }
    out
}

/// A value between integration steps, linear: steps are far shorter than anything in the course.
pub fn between(values: &[f64], step_s: f64, t: f64) -> f64 {
    let place = (t / step_s).clamp(0.0, (values.len() - 1) as f64);
    let i = (place as usize).min(values.len().saturating_sub(2));
    let s = place - i as f64;
    values[i] + s * (values[i + 1] - values[i])
}

/// What the manifest says of a constant: its value, or that it is to be found.
fn stated(dice: &mut Dice, value: f64, chance: f64) -> Option<f64> {
    dice.chance(chance).then_some(value)
}

/// Draws the motions of a series: kinds out of `list`, and how much of each passes before a recording is
/// switched on, s.
pub fn motions(
    seed: u64,
    dice: &mut Dice,
    list: &[&'static str],
    a: &Axis,
    one_sided: bool,
    fine_s: f64,
) -> Vec<(&'static str, Path, f64)> {
    let same = dice.chance(0.4);
    let first = dice.below(list.len());
    let count = [1, 2, 2, 2, 3, 3, 3, 4, 4, 2][dice.below(10)];
    let of = |number: usize| {
        let mut own = Dice::new(seed, 20 + number as u64);
        let kind = if same || number == 0 {
            list[first]
        } else {
            list[own.below(list.len())]
        };
        let rest_s = own.range(0.3, 1.0) * (0.3 / a.base_hz).max(1.0);
        let plan = Plan {
            kind,
            base_hz: a.base_hz,
            duration_s: a.duration_s + 2.0 * rest_s,
            rest_s,
            one_sided,
        };
        // a recording may be switched on after the motion
        let cut_s = if own.chance(0.25) {
            rest_s + own.range(0.6, 1.5) / a.base_hz
        } else {
            0.0
        };
        (kind, path(&plan, &mut own, fine_s), cut_s)
    };
    (0..count).map(of).collect()
}

/// What a cause is told of the motions that are planned.
pub fn setting(a: &Axis, paths: &[(&'static str, Path, f64)]) -> Setting {
    let over = |f: &dyn Fn(&Path) -> f64| paths.iter().map(|p| f(&p.1)).fold(0.0, f64::max);
    let largest = |v: &[f64]| v.iter().fold(0.0_f64, |m, v| m.max(*v));
    let force = over(&|p| {
        (0..p.x.len())
            .map(|i| planned(a, p, i).abs())
            .fold(0.0, f64::max)
    });
    Setting {
        spring: a.spring,
        mass: a.mass,
        bias: a.bias,
        stroke: a.stroke,
        ends: [
            -a.stroke * over(&|p| p.x.iter().fold(0.0, |m, v| m.max(-v))),
            a.stroke * over(&|p| largest(&p.x)),
        ],
        speed: a.stroke * over(&|p| p.v.iter().fold(0.0, |m, v| m.max(v.abs()))),
        force,
        duration_s: a.duration_s,
        base_hz: a.base_hz,
        step_s: a.step_s,
    }
}

/// Makes the recordings of a case on an axis.
pub fn make(
    seed: u64,
    strength: f64,
    cause: Option<(Maker, Needs)>,
    stride: usize,
) -> Result<Made, String> {
    let mut dice = Dice::new(seed, 1);
    let a = axis(&mut dice, cause.map_or(Needs::Any, |c| c.1));
    let stiffness = a.spring.force(1.0);
    let text = AxisText {
        gain: stated(&mut dice, a.gain, if a.led { 1.0 } else { 0.6 }),
        mass: stated(&mut dice, a.mass, 0.5),
        damping: stated(&mut dice, a.damping, 0.15),
        stiffness: stated(
            &mut dice,
            stiffness,
            if stiffness == 0.0 { 0.8 } else { 0.2 },
        ),
        force_cell: a.led,
    };
    let one_sided = dice.chance(0.35);
    let sub = (a.step_s / STEP_S).ceil();
    let paths = motions(
        seed,
        &mut dice,
        &MOTIONS,
        &a,
        one_sided,
        0.5 * a.step_s / sub,
    );
    let setting = setting(&a, &paths);
    let force = setting.force;
    let mut draw = Draw {
        dice: Dice::new(seed, 10),
        strength,
        at: setting,
    };
    let mechanism = cause.map(|c| c.0(&mut draw));
    let mut channel = Dice::new(seed, 2);
    let sd = a.stroke * channel.log_range(3e-5, 6e-4);
    let noise_x = Noise::draw(&mut channel, sd);
    let sd = if a.led {
        force * channel.log_range(2e-3, 1.5e-2)
    } else {
        force * channel.log_range(3e-4, 4e-3)
    };
    let noise_u = Noise::draw(&mut channel, sd);
    let mut recordings = Vec::new();
    let mut balances = Vec::new();
    for (number, (kind, p, cut_s)) in paths.iter().enumerate() {
        let course = simulate(&a, p, mechanism.as_ref(), stride);
        let beyond = |x: &f64| x.is_nan() || x.abs() > 4.0 * a.stroke;
        if course.x.iter().any(beyond) {
            return Err(format!("the axis leaves its stroke under {kind}"));
        }
        let late_s = mechanism.as_ref().map_or(0.0, |m| m.late_s);
        let end_s = course.step_s * (course.x.len() - 1) as f64;
        let rows = ((end_s - cut_s) / a.step_s) as usize;
        let time: Vec<f64> = (0..rows).map(|i| i as f64 * a.step_s).collect();
        let mut x: Vec<f64> = time
            .iter()
            .map(|t| between(&course.x, course.step_s, cut_s + t))
            .collect();
        let u: Vec<f64> = time
            .iter()
            .map(|t| between(&course.u, course.step_s, cut_s + t - late_s))
            .collect();
        let mut own = Dice::new(seed, 100 + number as u64);
        let mut read_x = noise_x.read(&x, &mut own);
        let read_u = noise_u.read(&u, &mut own);
        let noise: Vec<f64> = read_x.iter().zip(&x).map(|(r, x)| r - x).collect();
        if let Some(fault) = mechanism.as_ref().and_then(|m| m.reading.as_ref()) {
            fault(&mut x);
            fault(&mut read_x);
        }
        let noise_u: Vec<f64> = read_u.iter().zip(&u).map(|(r, u)| r - u).collect();
        balances.push(balance(&a, &text, &x, &u, &noise, &noise_u));
        recordings.push(LineRecording {
            kind,
            columns: Columns::Axis {
                time_s: time,
                position_m: read_x.iter().map(|v| v + a.zero).collect(),
                input: read_u.iter().map(|v| v / a.gain).collect(),
            },
        });
    }
    Ok(Made {
        text: Text::Axis(text),
        recordings,
        balances,
        detail: mechanism.map(|m| m.detail),
    })
}

/// The balance of a recording, low-passed where its motion ends.
fn balance(
    a: &Axis,
    text: &AxisText,
    x: &[f64],
    u: &[f64],
    noise_x: &[f64],
    noise_u: &[f64],
) -> Balance {
    let needed = |x: &[f64]| -> [Vec<f64>; 3] {
        let (v, acc) = derivatives(x, a.step_s);
        [acc, v, x.to_vec()]
    };
    let sum = |columns: &[Vec<f64>; 3]| -> Vec<f64> {
        (0..x.len())
            .map(|i| {
                a.mass * columns[0][i] + a.damping * columns[1][i] + a.spring.force(columns[2][i])
            })
            .collect()
    };
    let columns = needed(x);
    let of_noise = sum(&needed(noise_x));
    let noise: Vec<f64> = noise_u.iter().zip(&of_noise).map(|(u, f)| u - f).collect();
    let share = band(&sum(&columns), &noise);
    let smooth = |values: &[f64]| {
        let mut out = low_pass(values, share);
        // what the derivatives do not reach
        let n = out.len();
        out.truncate(n - 3);
        out.drain(..3);
        out
    };
    let known = [text.mass, text.damping, text.stiffness];
    let anchored = known.iter().flatten().any(|v| *v != 0.0);
    let mut free = Vec::new();
    let mut target = u.to_vec();
    for (column, known) in columns.iter().zip(known) {
        match known {
            Some(value) => {
                for (t, c) in target.iter_mut().zip(column) {
                    *t -= value * c;
                }
            }
            None => free.push(smooth(column)),
        }
    }
    free.push(vec![1.0; x.len() - 6]);
    if text.gain.is_none() && anchored {
        free.push(smooth(u));
    }
    Balance {
        columns: free,
        target: smooth(&target),
        noise: smooth(&noise),
        edge: (1.0 / share).ceil() as usize,
    }
}
