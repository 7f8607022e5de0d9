//! Motions of a single coordinate: what an experimenter makes an axis, a hinge or a film do.
//!
//! A motion is drawn as a course from -1 to 1 (or 0 to 1) and rounded by three moving means, so that its
//! acceleration has no jump; rate
//! and acceleration are the exact derivatives of what the means leave.

use std::f64::consts::{PI, TAU};

use super::super::dice::Dice;

/// Kinds of motion.
pub const MOTIONS: [&str; 12] = [
    "slow_triangle",
    "triangles",
    "sine",
    "sines",
    "multisine",
    "chirp",
    "steps",
    "staircase",
    "reaching",
    "growing",
    "loops",
    "pulses",
];

/// Excursion over the largest one, its rate in 1/s and acceleration in 1/s^2, at even times from 0 on.
#[derive(Debug, Clone)]
pub struct Path {
    /// Distance of the values, s.
    pub step_s: f64,
    /// Excursion.
    pub x: Vec<f64>,
    /// Rate.
    pub v: Vec<f64>,
    /// Acceleration.
    pub a: Vec<f64>,
}

/// What a motion is to be.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// One of [`MOTIONS`].
    pub kind: &'static str,
    /// The frequency that it is made around, Hz.
    pub base_hz: f64,
    /// Its length, s.
    pub duration_s: f64,
    /// Rest before and after, s.
    pub rest_s: f64,
    /// From 0 to 1 instead of -1 to 1.
    pub one_sided: bool,
}

/// A triangle from 0 up, with period 1 and between -1 and 1.
fn triangle(p: f64) -> f64 {
    let q = (p + 0.25).rem_euclid(1.0);
    1.0 - 4.0 * (q - 0.5).abs()
}

/// From 0 to 1 with zero rate and acceleration at both ends.
fn minimum_jerk(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

/// One wave after the other: frequency, amplitude and number of periods.
fn waves(list: &[(f64, f64, f64)], wave: fn(f64) -> f64, t: f64) -> f64 {
    let mut begin = 0.0;
    for &(hz, amplitude, periods) in list {
        let length = periods / hz;
        if t < begin + length {
            return amplitude * wave(hz * (t - begin));
        }
        begin += length;
    }
    0.0
}

/// Fills the time with waves drawn one at a time.
fn fill(total_s: f64, mut next: impl FnMut(usize) -> (f64, f64, f64)) -> Vec<(f64, f64, f64)> {
    let (mut out, mut used) = (Vec::new(), 0.0);
    for i in 0..200 {
        let (hz, amplitude, periods) = next(i);
        let room = ((total_s - used) * hz).floor();
        let periods = periods.min(room);
        if periods < 1.0 {
            break;
        }
        used += periods / hz;
        out.push((hz, amplitude, periods));
    }
    out
}

/// Levels that are held: end of the hold, and level.
fn levels(total_s: f64, mut next: impl FnMut(usize) -> (f64, f64)) -> Vec<(f64, f64)> {
    let (mut out, mut now) = (Vec::new(), 0.0);
    let mut i = 0;
    while now < total_s && i < 2000 {
        let (hold, level) = next(i);
        now += hold;
        out.push((now, level));
        i += 1;
    }
    out
}

fn held(list: &[(f64, f64)], t: f64) -> f64 {
    list.iter()
        .find(|l| t < l.0)
        .or(list.last())
        .map_or(0.0, |l| l.1)
}

fn sine(p: f64) -> f64 {
    (TAU * p).sin()
}

/// A moving mean over 2 h + 1 values.
fn mean(values: &[f64], h: usize) -> Vec<f64> {
    let n = values.len();
    let mut sum = vec![0.0; n + 1];
    for i in 0..n {
        sum[i + 1] = sum[i] + values[i];
    }
    (0..n)
        .map(|i| {
            let (a, b) = (i.saturating_sub(h), (i + h + 1).min(n));
            (sum[b] - sum[a]) / (b - a) as f64
        })
        .collect()
}

/// A course in time.
type Course = Box<dyn Fn(f64) -> f64>;

/// One wave after the other, as drawn.
fn in_waves(list: Vec<(f64, f64, f64)>, wave: fn(f64) -> f64) -> Course {
    Box::new(move |t| waves(&list, wave, t))
}

/// Triangles at four rates, all as large or not.
fn triangles(f: f64, total: f64, dice: &mut Dice) -> Course {
    let order = [0.3, 1.0, 2.0, 0.6].map(|r| r * f);
    let equal = dice.chance(0.5);
    let amplitude = [1.0, 1.0, 0.6, 0.8].map(|a| if equal { 1.0 } else { a });
    let list = fill(total, |i| (order[i % 4], amplitude[i % 4], 2.0));
    in_waves(list, triangle)
}

/// Sines of other amplitude and frequency every three periods.
fn sines(f: f64, total: f64, dice: &Dice) -> Course {
    let mut own = dice.clone();
    let list = fill(total, |i| {
        let amplitude = if i == 0 { 1.0 } else { own.range(0.3, 1.0) };
        (f * own.log_range(0.4, 2.5), amplitude, 3.0)
    });
    in_waves(list, sine)
}

/// Five to twelve sines at once.
fn multisine(f: f64, dice: &mut Dice) -> Course {
    let count = 5 + dice.below(8);
    let lines: Vec<[f64; 3]> = (0..count)
        .map(|i| {
            let hz = f * 0.15 * 20f64.powf((i as f64 + dice.unit()) / count as f64);
            [hz, dice.range(0.0, 1.0), (hz / f).max(0.3).powf(-0.8)]
        })
        .collect();
    Box::new(move |t| lines.iter().map(|l| l[2] * sine(l[0] * t + l[1])).sum())
}

/// A sine that gets faster or slower.
fn chirp(f: f64, total: f64, dice: &mut Dice) -> Course {
    let (low, high) = (0.2 * f, f * dice.range(2.0, 3.5));
    let falling = dice.chance(0.3);
    let rate = (high / low).ln() / total;
    Box::new(move |t| {
        let s = if falling { total - t } else { t };
        sine(low * ((rate * s).exp() - 1.0) / rate)
    })
}

/// Levels and holds as they come.
fn steps(f: f64, total: f64, dice: &Dice) -> Course {
    let mut own = dice.clone();
    let list = levels(total, |i| {
        let level = if i == 1 { 1.0 } else { own.range(-1.0, 1.0) };
        let level = if i == 0 { 0.0 } else { level };
        (own.range(0.6, 1.6) / f, level)
    });
    Box::new(move |t| held(&list, t))
}

/// Even steps up, down, below and back.
fn staircase(f: f64, total: f64, dice: &mut Dice) -> Course {
    let count = 4 + dice.below(4);
    let hold = (0.5 / f).max(total / (4.2 * count as f64 * 3.0));
    let list = levels(total, |i| {
        // up, down, below, back
        let p = triangle(i as f64 / (4 * count) as f64);
        (hold, p)
    });
    Box::new(move |t| held(&list, t))
}

/// From place to place with minimum jerk, a dwell after each.
fn reaching(f: f64, total: f64, dice: &Dice) -> Course {
    let mut own = dice.clone();
    let (mut moves, mut now, mut at) = (Vec::new(), 0.0, 0.0);
    while now < total {
        let to = if moves.is_empty() {
            1.0
        } else {
            own.range(-1.0, 1.0)
        };
        let length = own.log_range(0.25, 1.2) / f;
        moves.push((now, length, at, to));
        now += length + own.range(0.0, 0.5) / f;
        at = to;
    }
    Box::new(move |t| {
        let of = moves.iter().rev().find(|m| m.0 <= t);
        of.map_or(0.0, |m| m.2 + (m.3 - m.2) * minimum_jerk((t - m.0) / m.1))
    })
}

/// Waves that grow from small to large.
fn growing(f: f64, total: f64, dice: &mut Dice) -> Course {
    let wave = if dice.chance(0.5) { sine } else { triangle };
    let each = 1.0 + dice.below(3) as f64;
    let count = (total * f / each).floor().clamp(2.0, 8.0);
    let list = fill(total, |i| {
        let share = ((i as f64 + 1.0) / count).min(1.0);
        (f, share, each)
    });
    in_waves(list, wave)
}

/// Draws the course of a motion over `total` seconds, and the share of a period over which a corner is
/// rounded.
fn course(plan: &Plan, total: f64, dice: &mut Dice) -> (Course, f64) {
    let f = plan.base_hz;
    let mut round = dice.log_range(0.03, 0.1);
    let course = match plan.kind {
        "slow_triangle" => in_waves(fill(total, |_| (0.6 * f, 1.0, 1.0)), triangle),
        "triangles" => triangles(f, total, dice),
        "sine" => in_waves(fill(total, |_| (f, 1.0, 1.0)), sine),
        "sines" => sines(f, total, dice),
        "multisine" => multisine(f, dice),
        "chirp" => chirp(f, total, dice),
        "steps" => {
            round = dice.log_range(0.08, 0.3);
            steps(f, total, dice)
        }
        "staircase" => {
            round = dice.log_range(0.08, 0.3);
            staircase(f, total, dice)
        }
        "reaching" => reaching(f, total, dice),
        "growing" => growing(f, total, dice),
        "loops" => {
            // a move, a dwell, a move back; each loop larger, then each again
            let order = [0.4, 0.7, 1.0, 0.7, 1.0];
            let list = fill(total, |i| (0.5 * f, order[i % 5], 1.0));
            in_waves(list, |p| (1.6 * triangle(p)).clamp(-1.0, 1.0))
        }
        _ => {
            round = dice.log_range(0.08, 0.25);
            let list = fill(total, |_| (0.5 * f, 1.0, 1.0));
            in_waves(list, |p| if p.rem_euclid(1.0) < 0.5 { 1.0 } else { -1.0 })
        }
    };
    (course, round)
}

/// Draws a motion and works it out every `step_s`.
pub fn path(plan: &Plan, dice: &mut Dice, step_s: f64) -> Path {
    let f = plan.base_hz;
    let total = plan.duration_s - 2.0 * plan.rest_s;
    let (course, round) = course(plan, total, dice);
    // at rest before and after: faded in and out over a while
    let n = (plan.duration_s / step_s).ceil() as usize + 1;
    let fade = 0.5 / f;
    let raw: Vec<f64> = (0..n)
        .map(|i| {
            let t = i as f64 * step_s - plan.rest_s;
            if t <= 0.0 || t >= total {
                return 0.0;
            }
            let near = (t.min(total - t) / fade).min(1.0);
            let y = course(t);
            let y = if plan.one_sided { 0.5 * (1.0 + y) } else { y };
            y * 0.5 * (1.0 - (PI * near).cos())
        })
        .collect();
    let half = ((round / f / 6.0 / step_s) as usize).max(2);
    let x = mean(&mean(&mean(&raw, half), half), half);
    let top = x.iter().fold(1e-9_f64, |m, v| m.max(v.abs()));
    let x: Vec<f64> = x.iter().map(|v| v / top).collect();
    let at = |i: i64| x[i.clamp(0, n as i64 - 1) as usize];
    let v = (0..n as i64)
        .map(|i| (at(i + 1) - at(i - 1)) / (2.0 * step_s))
        .collect();
    let a = (0..n as i64)
        .map(|i| (at(i + 1) - 2.0 * at(i) + at(i - 1)) / (step_s * step_s))
        .collect();
    Path { step_s, x, v, a }
}
