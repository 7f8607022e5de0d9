//! A hinge on its bench: a flexure with a smooth curve of torque over angle, led slowly to and fro; angle and
//! torque are written, with or
//! without a time.

use super::super::dice::Dice;
use super::axis::{Axis, Maker, Needs, between, motions, setting, simulate};
use super::forms;
use super::mechanism::{Draw, Spring};
use super::noise::Noise;
use super::unknown;
use super::visible::Balance;
use super::write::Columns;
use super::{LineRecording, Made, Text};

/// Causes of the catalogue.
pub const EFFECTS: &[(&str, Maker, Needs)] = &[
    ("joint_friction", forms::friction, Needs::Any),
    ("x_load_friction", forms::load_friction, Needs::Any),
    ("x_backlash", forms::backlash, Needs::Any),
    ("joint_damping", forms::damping, Needs::Clock),
    ("slow_creep", forms::creep, Needs::Clock),
    ("mullins_softening", forms::softening, Needs::Any),
    ("temperature_drift", forms::drift, Needs::Clock),
    ("x_zero_drift", forms::zero_drift, Needs::Clock),
];

/// Causes that are in no catalogue.
pub const UNKNOWN: &[(&str, Maker, Needs)] = &[
    ("x_cogging", unknown::cogging, Needs::Any),
    ("x_magnet", unknown::magnet, Needs::Any),
    ("x_snap", unknown::snap, Needs::Any),
    ("x_pump", unknown::pump, Needs::Clock),
    ("x_wander", unknown::wander, Needs::Clock),
    ("x_sticky_place", unknown::sticky_place, Needs::Clock),
    ("x_frozen_reading", unknown::frozen_reading, Needs::Any),
    ("x_lost_counts", unknown::lost_counts, Needs::Any),
    ("x_cell_leaps", unknown::cell_leaps, Needs::Any),
];

/// Motions of a bench.
const MOTIONS: [&str; 10] = [
    "slow_triangle",
    "triangles",
    "sine",
    "sines",
    "steps",
    "staircase",
    "reaching",
    "growing",
    "loops",
    "multisine",
];

/// Longest step of the integration, as a share of a period.
const STEP: f64 = 2.5e-4;

/// Draws a hinge and how it is led.
fn hinge(dice: &mut Dice) -> Axis {
    let torque = dice.log_range(3e-3, 1.0);
    let stroke = dice.range(12.0, 29.0).to_radians();
    let base_hz = dice.log_range(0.03, 0.25);
    let rate = [10.0, 20.0, 50.0][dice.below(3)];
    Axis {
        mass: 0.0,
        damping: 0.0,
        // no curve of a flexure has a corner: what is cubic and quadratic bends it little
        spring: Spring::Curve([
            torque,
            stroke,
            dice.range(-0.15, 0.5),
            dice.range(-0.2, 0.2),
        ]),
        bias: torque * dice.range(-0.1, 0.1),
        gain: 1.0,
        led: true,
        servo: [0.0; 2],
        stroke,
        base_hz,
        duration_s: (dice.range(4.0, 12.0) / base_hz).min(4000.0 / rate),
        step_s: 1.0 / rate,
        zero: 0.0,
    }
}

/// Makes the recordings of a case on a bench.
pub fn make(
    seed: u64,
    strength: f64,
    cause: Option<(Maker, Needs)>,
    stride: usize,
) -> Result<Made, String> {
    let mut dice = Dice::new(seed, 1);
    let a = hinge(&mut dice);
    let timed = dice.chance(0.7) || cause.is_some_and(|c| c.1 == Needs::Clock);
    let one_sided = dice.chance(0.3);
    let sub = (a.step_s * a.base_hz / STEP).ceil();
    let fine = 0.5 * a.step_s / sub;
    let paths = motions(seed, &mut dice, &MOTIONS, &a, one_sided, fine);
    let setting = setting(&a, &paths);
    let mut draw = Draw {
        dice: Dice::new(seed, 10),
        strength,
        at: setting,
    };
    let mechanism = cause.map(|c| c.0(&mut draw));
    let mut channel = Dice::new(seed, 2);
    let sd = setting.force * channel.log_range(1.5e-3, 1.2e-2);
    let noise_torque = Noise::draw(&mut channel, sd);
    // an encoder is far finer than the torque cell
    let noise_angle = Noise::draw(&mut channel, 0.1 * sd / setting.force * a.stroke);
    let (mut recordings, mut balances) = (Vec::new(), Vec::new());
    for (number, (kind, p, cut_s)) in paths.iter().enumerate() {
        let course = simulate(&a, p, mechanism.as_ref(), stride);
        let end_s = course.step_s * (course.x.len() - 1) as f64;
        let rows = ((end_s - cut_s) / a.step_s) as usize;
        let time: Vec<f64> = (0..rows).map(|i| i as f64 * a.step_s).collect();
        let at = |values: &[f64]| -> Vec<f64> {
            let one = |t: &f64| between(values, course.step_s, cut_s + t);
            time.iter().map(one).collect()
        };
        let (mut x, mut u) = (at(&course.x), at(&course.u));
        let mut own = Dice::new(seed, 100 + number as u64);
        let mut read_x = noise_angle.read(&x, &mut own);
        let mut read_u = noise_torque.read(&u, &mut own);
        let noise: Vec<f64> = (0..rows)
            .map(|i| read_u[i] - u[i] - a.spring.force(read_x[i]) + a.spring.force(x[i]))
            .collect();
        if let Some(m) = &mechanism {
            if let Some(fault) = &m.reading {
                fault(&mut x);
                fault(&mut read_x);
            }
            if let Some(fault) = &m.cell {
                fault(&mut u);
                fault(&mut read_u);
            }
        }
        // a polynomial stands for any smooth curve
        let columns = (0..10)
            .map(|n| x.iter().map(|x| (x / a.stroke).powi(n)).collect())
            .collect();
        balances.push(Balance {
            columns,
            target: u,
            noise,
            edge: 0,
        });
        recordings.push(LineRecording {
            kind,
            columns: Columns::Bench {
                time_s: timed.then_some(time),
                angle_rad: read_x,
                torque_n_m: read_u,
            },
        });
    }
    Ok(Made {
        text: Text::Bench,
        recordings,
        balances,
        detail: mechanism.map(|m| m.detail),
    })
}
