//! Voltages of a case: what an experimenter ordinarily does, or the program's own richer protocol. Every
//! drive stands at 0 V for half a second at either end.

use super::dice::Dice;
use super::effect::smooth;
use crate::simulate::{Hold, Sampled};

const TURN: f64 = std::f64::consts::TAU;
/// Distance of the samples, s.
pub const STEP_S: f64 = 0.01;
/// Smallest step of the converter, V.
pub const QUANTUM_V: f64 = 0.1;

/// One recording as it is planned.
#[derive(Debug, Clone)]
pub struct Planned {
    /// "symmetric".
    pub kind: &'static str,
    /// Whether it is for training.
    pub train: bool,
    /// Voltages.
    pub drive: Sampled,
    /// Stated payload: (time s, kg).
    pub payload_kg: Vec<(f64, f64)>,
}

impl Planned {
    /// Length, s.
    pub fn duration_s(&self) -> f64 {
        self.drive.duration_s()
    }
}

/// 0 to 1 within the first second, back to 0 within the last one and a half, smoothly.
fn window(t: f64, duration_s: f64) -> f64 {
    smooth((t - 0.5) / 0.5) * smooth((duration_s - 0.5 - t) / 0.8)
}

fn sampled(duration_s: f64, f: impl Fn(f64) -> [f64; 3]) -> Result<Sampled, String> {
    let count = (duration_s / STEP_S).round() as usize;
    let samples = (0..=count).map(|i| {
        let t = i as f64 * STEP_S;
        let w = window(t, duration_s);
        f(t).map(|v| (v * w / QUANTUM_V).round() * QUANTUM_V)
    });
    Sampled::new(0.0, STEP_S, samples.collect(), Hold::Linear)
}

fn raised(peak: f64, turns: f64) -> f64 {
    0.5 * peak * (1.0 - (TURN * turns).cos())
}

/// All three alike.
fn symmetric(dice: &mut Dice, peak: f64) -> Result<Sampled, String> {
    let f = dice.range(0.28, 0.4);
    sampled(22.0, |t| [raised(peak, f * (t - 0.5)); 3])
}

/// One after the other.
fn single(dice: &mut Dice, peak: f64) -> Result<Sampled, String> {
    let f = dice.range(0.33, 0.45);
    let each = 26.0 / 3.0;
    sampled(27.0, |t| {
        let mut out = [0.0; 3];
        let place = ((t - 0.5) / each).max(0.0);
        let k = (place as usize).min(2);
        let own = t - 0.5 - k as f64 * each;
        let edge = smooth(own / 0.4) * smooth((each - own) / 0.4);
        out[k] = raised(peak, f * own) * edge;
        out
    })
}

/// Several sines in each actuator, each with its own phases.
fn multisine(dice: &mut Dice, peak: f64, duration_s: f64) -> Result<Sampled, String> {
    let tones = 4 + dice.below(3);
    let low = dice.range(0.05, 0.11);
    let high = dice.range(0.7, 1.5);
    let alike = dice.chance(0.4);
    let mut waves = Vec::new();
    for i in 0..tones {
        let f = low * (high / low).powf((i as f64 + dice.range(0.0, 0.6)) / tones as f64);
        let common = dice.range(0.0, TURN);
        let own = [(); 3].map(|()| {
            let own = dice.range(0.0, TURN);
            if alike { common + 0.2 * own } else { own }
        });
        waves.push((f, dice.range(0.6, 1.0), own));
    }
    let sum = |t: f64| {
        [0, 1, 2].map(|k| {
            let each = waves
                .iter()
                .map(|(f, a, p)| a * (TURN * f * t + p[k]).sin());
            each.sum::<f64>()
        })
    };
    let mut most = [1e-9_f64; 3];
    let mut t = 0.5;
    while t < duration_s {
        let now = sum(t);
        for k in 0..3 {
            most[k] = most[k].max(now[k].abs());
        }
        t += 0.02;
    }
    let (centre, swing) = (0.54 * peak, 0.46 * peak);
    sampled(duration_s, |t| {
        let now = sum(t);
        [0, 1, 2].map(|k| (centre + swing * now[k] / most[k]).max(0.0))
    })
}

/// Levels held for one to three seconds, with ramps between them.
fn steps(dice: &mut Dice, peak: f64, duration_s: f64) -> Result<Sampled, String> {
    let ramp = dice.range(0.35, 0.7);
    let mut levels: Vec<(f64, [f64; 3])> = Vec::new();
    let mut t = 0.5 + dice.range(0.0, 0.3);
    while t < duration_s - 1.5 {
        let mean = peak * dice.range(0.18, 0.82);
        let level = [(); 3].map(|()| (mean * dice.range(0.7, 1.3)).min(peak));
        levels.push((t, level));
        t += dice.range(1.6, 3.0);
    }
    sampled(duration_s, |t| held(&levels, ramp, t))
}

/// Levels from their times on, each reached within `ramp`.
fn held(levels: &[(f64, [f64; 3])], ramp: f64, t: f64) -> [f64; 3] {
    let mut from = [0.0; 3];
    let mut out = [0.0; 3];
    for (begin, level) in levels {
        if t < *begin {
            break;
        }
        let f = smooth((t - begin) / ramp);
        out = [0, 1, 2].map(|k| from[k] + f * (level[k] - from[k]));
        from = *level;
    }
    out
}

/// Voltages a third of a turn apart: roughly a circle.
fn circle(dice: &mut Dice, peak: f64) -> Result<Sampled, String> {
    let f = dice.sign() * dice.range(0.25, 0.4);
    let centre = peak * dice.range(0.6, 0.66);
    let swing = peak * dice.range(0.2, 0.28);
    sampled(22.0, |t| {
        [0, 1, 2].map(|k| centre + swing * (TURN * (f * t - k as f64 / 3.0)).cos())
    })
}

/// A triangle of another period in each actuator.
fn triangle(dice: &mut Dice, peak: f64) -> Result<Sampled, String> {
    let period = [0, 1, 2].map(|k| dice.range(3.5, 5.0) + 0.8 * f64::from(k));
    sampled(22.0, |t| {
        period.map(|p| {
            let s = ((t - 0.5) / p).rem_euclid(1.0);
            peak * (1.0 - (2.0 * s - 1.0).abs())
        })
    })
}

fn planned(kind: &'static str, train: bool, drive: Sampled) -> Planned {
    Planned {
        kind,
        train,
        drive,
        payload_kg: vec![(0.0, 0.0)],
    }
}

/// Three or four recordings to train on, two held out. `share` of the usual voltages.
///
/// # Errors
/// A drive that makes no sense.
pub fn ordinary(dice: &mut Dice, share: f64) -> Result<Vec<Planned>, String> {
    let (high, middle) = (5400.0 * share, 4860.0 * share);
    let mut out = vec![
        planned("symmetric", true, symmetric(dice, high)?),
        planned("single", true, single(dice, high)?),
        planned("multisine", true, multisine(dice, middle, 24.0)?),
    ];
    if dice.chance(0.45) {
        let mut loaded = planned("payload", true, steps(dice, 0.78 * middle, 20.0)?);
        loaded.payload_kg = vec![(0.0, 2e-3)];
        out.push(loaded);
    }
    out.push(if dice.chance(0.5) {
        planned("circle", false, circle(dice, middle)?)
    } else {
        planned("triangle", false, triangle(dice, middle)?)
    });
    out.push(if dice.chance(0.5) {
        planned("multisine", false, multisine(dice, 0.95 * middle, 22.0)?)
    } else {
        planned("steps", false, steps(dice, 0.92 * middle, 22.0)?)
    });
    Ok(out)
}

/// What the paper drives alone: all together, one after the other; a circle held out. `share` of the usual
/// voltages.
///
/// # Errors
/// A drive that makes no sense.
pub fn few(dice: &mut Dice, share: f64) -> Result<Vec<Planned>, String> {
    let high = 5400.0 * share;
    Ok(vec![
        planned("symmetric", true, symmetric(dice, high)?),
        planned("single", true, single(dice, high)?),
        planned("circle", false, circle(dice, 0.9 * high)?),
    ])
}

/// Two short recordings to train on, one held out: for cases that travel with a program.
///
/// # Errors
/// A drive that makes no sense.
pub fn short(dice: &mut Dice, share: f64) -> Result<Vec<Planned>, String> {
    let (high, middle) = (5400.0 * share, 4860.0 * share);
    let f = dice.range(0.35, 0.5);
    let together = sampled(8.0, |t| [raised(high, f * (t - 0.5)); 3])?;
    Ok(vec![
        planned("symmetric", true, together),
        planned("multisine", true, multisine(dice, middle, 10.0)?),
        planned("steps", false, steps(dice, 0.92 * middle, 8.0)?),
    ])
}

/// The program's own protocol: three rates up to 2 Hz, holds off the axis, a staircase repeated with the
/// polarity turned, a payload that is put on while the voltages are held; then the first drive once more.
/// Held out: a circle and a multisine.
///
/// # Errors
/// A drive that makes no sense.
pub fn protocol(dice: &mut Dice, share: f64) -> Result<Vec<Planned>, String> {
    let (high, middle) = (5300.0 * share, 4860.0 * share);
    let fast = dice.range(1.7, 2.1);
    let rates = sampled(26.0, |t| {
        // Slow, middle, fast: whole periods, so that each begins and ends at 0 V.
        let v = if t < 0.5 + 10.0 {
            raised(high, 0.2 * (t - 0.5))
        } else if t < 0.5 + 10.0 + 9.0 {
            raised(high, (t - 10.5) / 1.5)
        } else {
            raised(0.85 * high, fast * (t - 19.5))
        };
        [v; 3]
    })?;
    let corners: [[f64; 3]; 8] = [
        [0.8, 0.35, 0.35],
        [0.35, 0.8, 0.35],
        [0.35, 0.35, 0.8],
        [0.75, 0.75, 0.4],
        [0.4, 0.75, 0.75],
        [0.75, 0.4, 0.75],
        [0.85, 0.85, 0.85],
        [0.3, 0.3, 0.3],
    ];
    let mut order: Vec<usize> = (0..corners.len()).collect();
    dice.shuffle(&mut order);
    let levels: Vec<(f64, [f64; 3])> = order
        .iter()
        .enumerate()
        .map(|(i, c)| {
            (
                0.7 + 2.9 * i as f64,
                corners[*c].map(|f| f * middle * dice.range(0.95, 1.05)),
            )
        })
        .collect();
    let holds = sampled(26.0, |t| held(&levels, 0.4, t))?;
    // Up four steps and down again, twice; the second time with the other sign.
    let stair = sampled(25.0, |t| {
        let each = 1.4;
        let stairs: Vec<(f64, [f64; 3])> = (0..16)
            .map(|i| {
                let n = i % 8;
                let step = if n < 4 { n + 1 } else { 7 - n };
                (0.7 + each * f64::from(i), [high * f64::from(step) / 4.0; 3])
            })
            .collect();
        let sign = if t < 0.7 + 8.0 * each - 0.5 * each {
            1.0
        } else {
            -1.0
        };
        held(&stairs, 0.4, t).map(|v| sign * v)
    })?;
    let single = single(dice, high)?;
    let under = [0.5, 0.62].map(|f| f * middle);
    let loaded = sampled(24.0, |t| {
        let base = held(&[(0.7, [under[0]; 3]), (12.0, [under[1]; 3])], 0.6, t);
        base.map(|v| v * (1.0 + 0.12 * (TURN * 0.4 * t).sin() * smooth((t - 17.0) / 0.5)))
    })?;
    let mut load = planned("load", true, loaded);
    load.payload_kg = vec![(0.0, 0.0), (5.0, 1.5e-3), (16.0, 0.0)];
    let mut out = vec![
        planned("rates", true, rates),
        planned("holds", true, holds),
        planned("staircase", true, stair),
        planned("single", true, single),
        load,
    ];
    let again = planned("rates", true, out[0].drive.clone());
    out.push(again);
    out.push(planned("circle", false, circle(dice, middle)?));
    let last = multisine(dice, 0.95 * middle, 22.0)?;
    out.push(planned("multisine", false, last));
    Ok(out)
}
