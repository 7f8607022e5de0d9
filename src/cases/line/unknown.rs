//! Causes on a moving axis that stand in no catalogue. Each is possible in a laboratory, and none is another
//! form of a catalogued one.

use std::f64::consts::{PI, TAU};

use super::mechanism::{Draw, Mechanism};

/// A motor that prefers some positions: cogging, several to the stroke, with a second harmonic.
pub fn cogging(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.02, 0.3);
    let pitch = draw.at.stroke * draw.dice.range(0.15, 0.5);
    let (phase, second) = (draw.dice.range(0.0, TAU), draw.dice.range(0.1, 0.4));
    draw.cause("x_cogging")
        .form("force_N", force)
        .form("pitch_m", pitch)
        .push(move |now, _, _| {
            let p = TAU * now.x / pitch + phase;
            force * (p.sin() + second * (2.0 * p).sin())
        })
}

/// A magnet beside the path: it pulls towards one place, and no further than its own size.
pub fn magnet(draw: &mut Draw) -> Mechanism {
    let force = draw.dice.sign() * draw.share(0.03, 0.5);
    let [low, high] = draw.at.ends;
    let place = low + (high - low) * draw.dice.range(0.3, 0.7);
    let size = draw.at.stroke * draw.dice.range(0.06, 0.2);
    draw.cause("x_magnet")
        .form("force_N", force)
        .form("place_m", place)
        .form("size_m", size)
        .push(move |now, _, _| {
            let s = (now.x - place) / size;
            // largest force at s = 1/2
            force * s * (1.25 / (1.0 + s * s)).powi(3) * 1.024
        })
}

/// A catch that snaps: it pushes one way until the axis has gone beyond one place, and the other way until it
/// is back beyond another.
pub fn snap(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.015, 0.25);
    let [low, high] = draw.at.ends;
    let middle = 0.5 * (low + high);
    let half = draw.dice.range(0.15, 0.35) * (high - low);
    let quick = 0.01 / draw.at.base_hz;
    draw.cause("x_snap")
        .form("force_N", force)
        .form("half_width_m", half)
        .with(vec![1.0, 1.0])
        .push(move |_, s, rate| {
            rate[1] = (s[0] - s[1]) / quick;
            // snapped over, it pushes on
            force * s[1]
        })
        .after(move |now, s| {
            if now.x > middle + half {
                s[0] = -1.0;
            }
            if now.x < middle - half {
                s[0] = 1.0;
            }
        })
}

/// A load on a crank: an inertia that depends on the position, J(x) x'' + J'(x) x'^2/2.
pub fn crank(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.15, 1.5);
    let mass = share * draw.at.mass;
    let pitch = draw.at.stroke * draw.dice.range(0.8, 1.6);
    let phase = draw.dice.range(0.0, TAU);
    let tau = 0.004 / draw.at.base_hz.max(1.0);
    draw.cause("x_crank")
        .form("mass_kg", mass)
        .form("pitch_m", pitch)
        // the acceleration by a quick follower of the speed
        .with(vec![0.0])
        .push(move |now, s, rate| {
            let p = TAU * now.x / pitch + phase;
            let a = (now.v - s[0]) / tau;
            rate[0] = a;
            mass * (0.5 * (1.0 + p.sin()) * a + 0.25 * TAU / pitch * p.cos() * now.v * now.v)
        })
}

/// A pump on the same table: a force of its own frequency, whatever the axis does.
pub fn pump(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.015, 0.25);
    let hz = draw.at.base_hz * draw.dice.range(1.3, 4.7);
    let phase = draw.dice.range(0.0, TAU);
    draw.cause("x_pump")
        .form("force_N", force)
        .form("frequency_Hz", hz)
        .push(move |now, _, _| {
            let p = TAU * hz * now.t + phase;
            force * (p.sin() + 0.3 * (2.0 * p + 1.0).sin())
        })
}

/// A second mass on a spring: a hose, a tool, a coupling.
pub fn second_mass(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.08, 1.0);
    let mass = share * draw.at.mass;
    let hz = draw.at.base_hz * draw.dice.range(1.2, 3.0);
    let zeta = draw.dice.range(0.03, 0.15);
    let (k, c) = (mass * (TAU * hz).powi(2), 2.0 * zeta * mass * TAU * hz);
    draw.cause("x_second_mass")
        .form("mass_kg", mass)
        .form("frequency_Hz", hz)
        .form("damping_ratio", zeta)
        .with(vec![0.0, 0.0])
        .push(move |now, y, rate| {
            let f = k * (now.x - y[0]) + c * (now.v - y[1]);
            rate[0] = y[1];
            rate[1] = f / mass;
            f
        })
}

/// A force that wanders: many slow waves without a common measure.
pub fn wander(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.015, 0.25);
    let waves: Vec<[f64; 3]> = (0..14)
        .map(|i| {
            let hz = draw.at.base_hz * 0.12 * 12f64.powf(f64::from(i) / 13.0);
            [
                hz,
                draw.dice.range(0.0, TAU),
                draw.dice.normal() * (hz / draw.at.base_hz).powf(-0.5),
            ]
        })
        .collect();
    let size: f64 = waves.iter().map(|w| 0.5 * w[2] * w[2]).sum::<f64>().sqrt();
    draw.cause("x_wander")
        .form("force_N", force)
        .push(move |now, _, _| {
            let of = |w: &[f64; 3]| w[2] * (TAU * w[0] * now.t + w[1]).sin();
            force * waves.iter().map(of).sum::<f64>() / size
        })
}

/// A drive of iron: what arrives hangs behind what is commanded by a hysteresis in the command itself (Bouc
/// and Wen).
pub fn magnetic_hysteresis(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.04, 0.5);
    let width = draw.at.force * draw.dice.range(0.15, 0.4);
    let lean = draw.dice.range(0.3, 0.7);
    let quick = 2e-3;
    draw.cause("x_magnetic_hysteresis")
        .form("share", share)
        .form("width_N", width)
        // follower of the command, and the hysteretic part
        .with(vec![draw.at.bias, 0.0])
        .drive(move |u, _, s, rate| {
            let du = (u - s[0]) / quick;
            rate[0] = du;
            let z = s[1];
            let hold = lean + (1.0 - lean) * (du * z).signum();
            rate[1] = du - hold * (z / width).powi(2) * du;
            u - share * z
        })
}

/// A body in water: it drags along what it has stirred, so that the drag depends on where the water goes by
/// now.
pub fn wake(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.05, 0.6);
    let top = draw.at.speed;
    let slow = draw.dice.range(0.15, 0.6) / draw.at.base_hz;
    draw.cause("x_wake")
        .form("force_N", force)
        .form("memory_s", slow)
        .with(vec![0.0])
        .push(move |now, w, rate| {
            rate[0] = (now.v - w[0]) / slow;
            let through = (now.v - 1.5 * w[0]) / top;
            force * through * through.abs()
        })
}

/// A sticky place: grease or dirt on one stretch of the path, which resists like a fluid.
pub fn sticky_place(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.03, 0.5);
    let top = draw.at.speed;
    let [low, high] = draw.at.ends;
    let place = low + (high - low) * draw.dice.range(0.25, 0.75);
    let half = draw.dice.range(0.06, 0.15) * (high - low);
    draw.cause("x_sticky_place")
        .form("force_at_top_speed_N", force)
        .form("place_m", place)
        .form("half_width_m", half)
        .push(move |now, _, _| {
            let s = ((now.x - place) / half).abs();
            let window = if s < 1.0 {
                0.5 * (1.0 + (PI * s).cos())
            } else {
                0.0
            };
            force * window * now.v / top
        })
}

/// Stretches of a recording through which an instrument repeats its last value: places as shares of the
/// recording, and samples.
fn frozen(draw: &mut Draw) -> (Vec<f64>, usize) {
    let count = 3 + draw.dice.below(5);
    let length_s = draw.size(0.015, 0.12) / draw.at.base_hz;
    let samples = ((length_s / draw.at.step_s) as usize).max(3);
    let places = (0..count).map(|_| draw.dice.range(0.1, 0.9)).collect();
    (places, samples)
}

fn freeze(values: &mut [f64], places: &[f64], samples: usize) {
    for place in places {
        let i = (place * values.len() as f64) as usize;
        let to = (i + samples).min(values.len());
        let held = values[i];
        values[i..to].fill(held);
    }
}

/// Leaps of an instrument's zero: places as shares of the recording, and sizes.
fn leaps(draw: &mut Draw, size: f64) -> Vec<(f64, f64)> {
    let count = 2 + draw.dice.below(3);
    (0..count)
        .map(|_| (draw.dice.range(0.1, 0.9), draw.dice.sign() * size))
        .collect()
}

fn leap(values: &mut [f64], leaps: &[(f64, f64)]) {
    let n = values.len() as f64;
    for (place, size) in leaps {
        for v in &mut values[(place * n) as usize..] {
            *v += size;
        }
    }
}

/// A reading that stops: now and then the instrument of the motion repeats its last value for a while.
pub fn frozen_reading(draw: &mut Draw) -> Mechanism {
    let (places, samples) = frozen(draw);
    draw.cause("x_frozen_reading")
        .form("count", places.len() as f64)
        .form("samples", samples as f64)
        .reading(move |x| freeze(x, &places, samples))
}

/// The same of the force cell.
pub fn frozen_cell(draw: &mut Draw) -> Mechanism {
    let (places, samples) = frozen(draw);
    draw.cause("x_frozen_cell")
        .form("count", places.len() as f64)
        .form("samples", samples as f64)
        .cell(move |x| freeze(x, &places, samples))
}

/// An encoder that loses counts: at a few moments its zero leaps for good.
pub fn lost_counts(draw: &mut Draw) -> Mechanism {
    let size = draw.at.stroke * draw.size(0.01, 0.15);
    let list = leaps(draw, size);
    draw.cause("x_lost_counts")
        .form("leap_m", size)
        .form("count", list.len() as f64)
        .reading(move |x| leap(x, &list))
}

/// A force cell that was knocked: its zero leaps.
pub fn cell_leaps(draw: &mut Draw) -> Mechanism {
    let size = draw.share(0.015, 0.2);
    let list = leaps(draw, size);
    draw.cause("x_cell_leaps")
        .form("leap", size)
        .form("count", list.len() as f64)
        .cell(move |u| leap(u, &list))
}
