//! One coordinate against one measured quantity: a hinge bench (angle, torque), a single axis (position or
//! velocity, input), a film coupon (stretch, stress). SI units, a mask, the noise, and for an axis the band
//! in which its motion stands above the noise.
//!
//! # Band of an axis
//! The balance of an axis needs an acceleration, and noise grows with the square of the frequency. Motion,
//! input and load go through one and the same low-pass, flat up to f and zero from 1.3 f on; the derivatives
//! are part of it (a finite kernel each), so that nothing is differentiated that was not measured. f is where
//! a wider band would bring more noise than motion to the balance, read from the spectrum of the coordinate
//! and its floor.

use super::coupon::LARGEST;
use super::noise::{colour, in_band, of_mean, over_third_differences, spectrum, white};
use super::{Coupon, CouponError};
use crate::recording::{
    AxisInertia, AxisManifest, CouponMode, NumberOrEstimate, RawAxis, RawBench, RawColumn,
    RawCoordinate, Recording,
};

/// What was measured along the coordinate.
#[derive(Debug, Clone, PartialEq)]
pub enum Measured {
    /// Torque of a hinge, N m.
    Torque(Vec<f64>),
    /// Input and load of an axis.
    Axis(AxisLine),
    /// Stress of a coupon.
    Coupon(Box<Coupon>),
}

/// A constant of an axis: stated, or to be found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Constant {
    /// Stated.
    Known(f64),
    /// To be found.
    Free,
}

impl Constant {
    fn of(value: NumberOrEstimate) -> Self {
        match value {
            NumberOrEstimate::Number(v) => Constant::Known(v),
            NumberOrEstimate::Estimate => Constant::Free,
        }
    }
}

/// What drives an axis, and what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisLine {
    /// Whether the coordinate was measured as a velocity.
    pub velocity: bool,
    /// Whether it turns: units with rad instead of m.
    pub turns: bool,
    /// Times of the input on its own clock, s.
    pub input_time_s: Vec<f64>,
    /// The input, in its unit.
    pub input: Vec<f64>,
    /// Unit of the input.
    pub unit: String,
    /// External force along +position at the samples, N or N m; empty where there is none.
    pub load: Vec<f64>,
    /// Input clock minus motion clock, s; `Free`: to be found.
    pub offset_s: Constant,
    /// N (or N m) per unit of input.
    pub gain: Constant,
    /// kg (or kg m^2).
    pub mass: Constant,
    /// N s/m.
    pub damping: Constant,
    /// N/m.
    pub stiffness: Constant,
    /// Frequency up to which the motion stands above its noise, Hz.
    pub band_hz: f64,
    /// Standard deviation of the input's noise.
    pub input_noise: f64,
}

/// A recording of one coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Identity.
    pub id: String,
    /// Time of every sample, s; the row number where the file has no time.
    pub time_s: Vec<f64>,
    /// Whether it has a time.
    pub timed: bool,
    /// Distance of the samples, s (axis: all alike).
    pub step_s: f64,
    /// Angle rad, position m, velocity m/s, stretch.
    pub x: Vec<f64>,
    /// Standard deviation of its noise.
    pub x_noise: f64,
    /// Samples that count.
    pub usable: Vec<bool>,
    /// Samples that were captured; an axis that begins or ends at rest is known beyond.
    pub captured: std::ops::Range<usize>,
    /// What was measured.
    pub measured: Measured,
    /// Standard deviation of the noise of torque, N m, or stress, Pa.
    pub noise: f64,
    /// Correlation of neighbours in it, where neighbours are averaged: those of a coupon.
    pub colour: f64,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// A recording that cannot become a line.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LineError {
    /// Of another kind.
    #[error("recording `{0}` is no hinge bench, axis or film coupon")]
    Kind(String),
    /// Too few samples.
    #[error(
        "recording `{id}`: {usable} of {samples} samples have both values; at least {FEWEST} are needed"
    )]
    TooShort {
        /// Recording.
        id: String,
        /// Usable samples.
        usable: usize,
        /// All.
        samples: usize,
    },
    /// Nothing moves.
    #[error("recording `{id}`: the {what} is {value} throughout: nothing can be learned from it")]
    Flat {
        /// Recording.
        id: String,
        /// Column.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// A number whose powers are none.
    #[error(
        "recording `{id}`: the {what} of sample {} is {value:e}, and nothing beyond {LARGEST:e} can be worked with: mend it, or empty the cell", sample + 1
    )]
    Beyond {
        /// Recording.
        id: String,
        /// Column.
        what: &'static str,
        /// Which of its samples.
        sample: usize,
        /// Its value.
        value: f64,
    },
    /// A time so far off that nearly all of an even clock would be empty.
    #[error(
        "recording `{id}`: its times run from {first_s} to {last_s} s in steps of {step_s:e} s, {missing:.3e} samples more than it has: a time is wrong"
    )]
    Sparse {
        /// Recording.
        id: String,
        /// First time, s.
        first_s: f64,
        /// Last time, s.
        last_s: f64,
        /// Ordinary step, s.
        step_s: f64,
        /// Samples of the even clock that the recording has not.
        missing: f64,
    },
    /// A coupon that cannot be used.
    #[error(transparent)]
    Coupon(#[from] CouponError),
}

/// Samples of an even clock for each that is there, beyond which a time is wrong.
const SPARSE: f64 = 10.0;
const SPARSE_AND: f64 = 1e5;

fn possible(id: &str, columns: &[(&'static str, &[f64])]) -> Result<(), LineError> {
    for (what, values) in columns {
        let beyond = |v: &f64| v.is_finite() && v.abs() > LARGEST;
        if let Some(sample) = values.iter().position(beyond) {
            return Err(LineError::Beyond {
                id: id.into(),
                what,
                sample,
                value: values[sample],
            });
        }
    }
    Ok(())
}

/// Fewest samples of a recording.
pub const FEWEST: usize = 16;
/// Equal values in a row at the end of a range, from which on a sensor is at its rail.
const RAIL: usize = 4;
/// One sample in so many of an axis at its rail is a rest that an encoder rounds; more are left out.
const MANY: usize = 20;
/// A step is a jump from so many times the size on that 99 of 100 steps do not exceed.
const JUMP: f64 = 3.0;
/// A leap of a sensor that loses its target is so many times that size at least, and what follows is still
/// within this share of it.
const LEAP: f64 = 5.0;
const STAYS: f64 = 1e-3;
/// Times closer than this share of a step to an even clock are taken to be on it.
const JITTER: f64 = 0.25;

impl Line {
    /// The line of a recording of a hinge bench, an axis or a film coupon.
    ///
    /// # Errors
    /// [`LineError`].
    pub fn from_recording(recording: &Recording) -> Result<Self, LineError> {
        let m = &recording.manifest;
        if let Some(raw) = &recording.bench {
            let span = m.bench.as_ref().and_then(|b| b.span);
            return bench(&m.id, raw, span);
        }
        if recording.axis.is_some() {
            return axis(recording);
        }
        if recording.coupon.is_some() {
            let coupon = Coupon::from_recording(recording)?;
            let mut notes = coupon.notes.clone();
            let stretches = range(&coupon.stretch);
            let colour = colour(&coupon.stress_pa);
            notes.extend(unlikely("stretch", stretches, [1e-5, 20.0], "1"));
            notes.extend(unlikely(
                "stress",
                range(&coupon.stress_pa),
                [1.0, 1e9],
                "Pa",
            ));
            return Ok(Line {
                captured: 0..coupon.stretch.len(),
                id: coupon.id.clone(),
                time_s: coupon.time_s.clone(),
                timed: coupon.timed,
                step_s: coupon.step_s,
                x: coupon.stretch.clone(),
                x_noise: 0.0,
                usable: coupon.usable.clone(),
                noise: coupon.noise_pa * over_third_differences(colour).sqrt(),
                colour,
                notes,
                measured: Measured::Coupon(Box::new(coupon)),
            });
        }
        Err(LineError::Kind(m.id.clone()))
    }

    /// Number of samples.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.x.len()
    }

    /// How many rows with independent noise so many neighbours are worth.
    #[must_use]
    pub fn independent(&self, rows: f64) -> f64 {
        rows / of_mean(rows, self.colour)
    }

    /// Unit of what is measured: the input of an axis, the torque of a bench, the stress of a coupon.
    #[must_use]
    pub fn unit(&self) -> String {
        match &self.measured {
            Measured::Torque(_) => "N m".into(),
            Measured::Axis(a) => a.unit.clone(),
            Measured::Coupon(_) => "Pa".into(),
        }
    }

    /// Mode of a coupon.
    #[must_use]
    pub fn mode(&self) -> Option<CouponMode> {
        match &self.measured {
            Measured::Coupon(c) => Some(c.mode),
            _ => None,
        }
    }
}

fn check(id: &str, usable: &[bool], columns: &[(&'static str, &[f64])]) -> Result<(), LineError> {
    let count = usable.iter().filter(|u| **u).count();
    if count < FEWEST {
        return Err(LineError::TooShort {
            id: id.into(),
            usable: count,
            samples: usable.len(),
        });
    }
    for (what, values) in columns {
        let mut seen = values.iter().filter(|v| v.is_finite());
        let first = seen.next().copied().unwrap_or(f64::NAN);
        if seen.all(|v| *v == first) {
            return Err(LineError::Flat {
                id: id.into(),
                what,
                value: first,
            });
        }
    }
    Ok(())
}

/// Samples at the rail of a sensor: the largest or smallest value, many times in a row, while another
/// quantity goes on changing by more than its noise.
fn at_rail(x: &[f64], other: &[f64], noise: f64) -> Vec<bool> {
    let mut out = vec![false; x.len()];
    let finite = || x.iter().copied().filter(|v| v.is_finite());
    let (low, high) = (
        finite().fold(f64::INFINITY, f64::min),
        finite().fold(f64::NEG_INFINITY, f64::max),
    );
    let mut from = 0;
    while from < x.len() {
        let mut to = from + 1;
        while to < x.len() && x[to] == x[from] {
            to += 1;
        }
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for y in other[from..to].iter().filter(|y| y.is_finite()) {
            least = least.min(*y);
            most = most.max(*y);
        }
        let end = low < high && (x[from] == low || x[from] == high);
        if to - from >= RAIL && end && most - least > 10.0 * noise {
            out[from..to].fill(true);
        }
        from = to;
    }
    out
}

/// Of short runs at a rail, those that a jump leads to or from, as a sensor makes them that loses its target;
/// an encoder at rest stays.
fn keep_jumps(x: &[f64], rail: &mut [bool]) {
    let mut steps: Vec<f64> = x
        .windows(2)
        .map(|w| (w[1] - w[0]).abs())
        .filter(|d| d.is_finite())
        .collect();
    steps.sort_by(f64::total_cmp);
    let usual = steps.get(steps.len() * 99 / 100).copied().unwrap_or(0.0);
    let jump = |a: usize, b: usize| (x[a] - x[b]).abs() > JUMP * usual;
    let mut from = 0;
    while from < x.len() {
        if !rail[from] {
            from += 1;
            continue;
        }
        let mut to = from;
        while to < x.len() && rail[to] {
            to += 1;
        }
        let torn = (from > 0 && jump(from - 1, from)) || (to < x.len() && jump(to, to - 1));
        rail[from..to].fill(torn);
        from = to;
    }
}

/// Samples of a sensor that loses its target: one leap away, nearly still, and one leap back. Only few of a
/// recording: what leaps often is the motion itself.
fn torn_away(x: &[f64]) -> Vec<bool> {
    let mut lost = vec![false; x.len()];
    let mut steps: Vec<f64> = x
        .windows(2)
        .map(|w| (w[1] - w[0]).abs())
        .filter(|d| d.is_finite())
        .collect();
    steps.sort_by(f64::total_cmp);
    let usual = steps.get(steps.len() * 99 / 100).copied().unwrap_or(0.0);
    let mut i = 1;
    while i < x.len() {
        let leap = x[i] - x[i - 1];
        if leap.abs() > LEAP * usual {
            let still = |v: &&f64| (**v - x[i]).abs() < STAYS * leap.abs();
            let end = i + x[i..].iter().take_while(still).count();
            let back = x.get(end).map_or(0.0, |v| v - x[end - 1]);
            if end - i >= RAIL && back * leap < -0.25 * leap * leap {
                lost[i..end].fill(true);
                i = end;
            }
        }
        i += 1;
    }
    let count = lost.iter().filter(|l| **l).count();
    if count > x.len() / MANY {
        lost.fill(false);
    }
    lost
}

/// What to say of a range that no laboratory has: a wrong unit, most likely. A range of 0 is not judged.
fn unlikely(what: &str, range: f64, [low, high]: [f64; 2], unit: &str) -> Option<String> {
    (range > 0.0 && !(low..=high).contains(&range)).then(|| {
        format!(
            "the {what} ranges over {range:.3e} {unit}, which is beyond all plausibility: look whether its unit is the right one, or two columns are swapped"
        )
    })
}

fn range(values: &[f64]) -> f64 {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min)
}

fn bench(id: &str, raw: &RawBench, span: Option<[f64; 2]>) -> Result<Line, LineError> {
    let (x, torque) = (si(&raw.angle), si(&raw.torque));
    possible(id, &[("angle", &x), ("torque", &torque)])?;
    let n = x.len().min(torque.len());
    let timed = raw.time_s.is_some();
    let time_s = raw
        .time_s
        .clone()
        .unwrap_or_else(|| (0..n).map(|i| 1.0 + i as f64).collect());
    let mut notes = Vec::new();
    if !timed {
        notes.push("the file has no time: what depends on a rate cannot be told".to_owned());
    }
    let noise = white(&torque, 3) * over_third_differences(colour(&torque)).sqrt();
    let noise = noise.max(1e-9 * range(&torque).max(f64::MIN_POSITIVE));
    let rail = at_rail(&x, &torque, noise);
    let count = rail.iter().filter(|r| **r).count();
    if count > 0 {
        let first = rail.iter().position(|r| *r).unwrap_or(0);
        notes.push(format!(
            "the angle stands at {:.4} rad for {count} rows from row {} on while the torque goes on changing: the sensor is at its rail, or something holds the angle; these rows are left out",
            x[first],
            first + 1
        ));
    }
    let usable: Vec<bool> = (0..n)
        .map(|i| {
            x[i].is_finite()
                && torque[i].is_finite()
                && !rail[i]
                && span.is_none_or(|[a, b]| (a..=b).contains(&time_s[i]))
        })
        .collect();
    check(id, &usable, &[("angle", &x), ("torque", &torque)])?;
    notes.extend(unlikely("angle", range(&x), [1e-5, 20.0], "rad"));
    notes.extend(unlikely("torque", range(&torque), [1e-9, 1e3], "N m"));
    Ok(Line {
        id: id.into(),
        captured: 0..n,
        step_s: median_step(&time_s),
        time_s,
        timed,
        x_noise: white(&x, 3) * over_third_differences(colour(&x)).sqrt(),
        x,
        usable,
        measured: Measured::Torque(torque),
        noise,
        colour: 0.0,
        notes,
    })
}

fn median_step(time_s: &[f64]) -> f64 {
    let mut d: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
    d.sort_by(f64::total_cmp);
    d.get(d.len() / 2).copied().unwrap_or(1.0)
}

/// Values at other times, linear between samples.
#[must_use]
pub fn interpolate(time_s: &[f64], values: &[f64], t: f64) -> f64 {
    after(time_s, values, time_s.partition_point(|x| *x <= t), t)
}

/// As [`interpolate`], at times that rise: one walk along the samples.
pub fn interpolate_rising(
    time_s: &[f64],
    values: &[f64],
    at: impl Iterator<Item = f64>,
) -> impl Iterator<Item = f64> {
    let mut i = 0;
    at.map(move |t| {
        while i < time_s.len() && time_s[i] <= t {
            i += 1;
        }
        after(time_s, values, i, t)
    })
}

/// The value at `t`, before which i samples lie.
fn after(time_s: &[f64], values: &[f64], i: usize, t: f64) -> f64 {
    let last = time_s.len() - 1;
    if i == 0 {
        return values[0];
    }
    if i > last {
        return values[last];
    }
    let f = (t - time_s[i - 1]) / (time_s[i] - time_s[i - 1]);
    values[i - 1] + f * (values[i] - values[i - 1])
}

/// The samples of an axis as the instruments wrote them, in SI.
struct AxisSamples {
    time_s: Vec<f64>,
    x: Vec<f64>,
    load: Vec<f64>,
    input_time_s: Vec<f64>,
    input: Vec<f64>,
    /// Whether the input is on the clock of the motion.
    one_clock: bool,
    velocity: bool,
    turns: bool,
}

fn si(column: &RawColumn) -> Vec<f64> {
    let factor = column.unit.map_or(1.0, |u| u.to_si);
    column.values.iter().map(|v| v * factor).collect()
}

impl AxisSamples {
    fn new(id: &str, raw: &RawAxis, m: &AxisManifest) -> Result<Self, LineError> {
        let (column, velocity) = match &raw.coordinate {
            RawCoordinate::Position(c) => (c, false),
            RawCoordinate::Velocity(c) => (c, true),
        };
        let own_clock = raw.input_time_s.clone();
        let input = raw.input.values.iter().map(|u| match m.input_power {
            1.0 => *u,
            // an even power has no sign
            p if p % 2.0 == 0.0 => u.abs().powf(p),
            p => u.signum() * u.abs().powf(p),
        });
        let out = AxisSamples {
            x: si(column),
            load: raw.load.as_ref().map_or_else(Vec::new, si),
            input: input.collect(),
            one_clock: own_clock.is_none(),
            input_time_s: own_clock.unwrap_or_else(|| raw.time_s.clone()),
            time_s: raw.time_s.clone(),
            velocity,
            turns: matches!(m.inertia, AxisInertia::InertiaKgM2(_)),
        };
        possible(
            id,
            &[
                ("coordinate", &out.x),
                ("load", &out.load),
                ("input", &out.input),
                ("time", &out.time_s),
                ("input's time", &out.input_time_s),
            ],
        )?;
        Ok(out)
    }

    fn unit(&self) -> &'static str {
        if self.turns { "rad" } else { "m" }
    }

    /// Only what lies in a span of time.
    fn keep(&mut self, [a, b]: [f64; 2]) {
        let from = self.time_s.partition_point(|t| *t < a);
        let to = self.time_s.partition_point(|t| *t <= b);
        self.time_s = self.time_s[from..to].to_vec();
        self.x = self.x[from..to].to_vec();
        if !self.load.is_empty() {
            self.load = self.load[from..to].to_vec();
        }
        if self.one_clock {
            self.input_time_s.clone_from(&self.time_s);
            self.input = self.input[from..to].to_vec();
        }
    }

    /// Leaves out where the coordinate stands at a rail while the input goes on.
    fn leave_stuck(&mut self, notes: &mut Vec<String>) {
        let x = &mut self.x;
        let mut rail = at_rail(x, &self.input, white(&self.input, 3));
        let slow = rail.iter().filter(|r| **r).count() <= x.len() / MANY;
        if slow {
            keep_jumps(x, &mut rail);
        }
        let stuck: Vec<usize> = (0..x.len()).filter(|&i| rail[i]).collect();
        if let Some(&first) = stuck.first() {
            notes.push(format!(
                "the coordinate stands at the end of its range in {} of {} samples, first at {:.3} s, while the input goes on changing: its sensor is at its rail, or something holds it; these samples are left out",
                stuck.len(),
                x.len(),
                self.time_s[first]
            ));
        }
        for i in stuck {
            x[i] = f64::NAN;
        }
    }

    /// Leaves out where a sensor lost its target.
    fn leave_torn(&mut self, notes: &mut Vec<String>) {
        let lost = torn_away(&self.x);
        let Some(first) = lost.iter().position(|l| *l) else {
            return;
        };
        notes.push(format!(
            "the coordinate leaps to {:.6} {} and back in {} of {} samples, first at {:.3} s: a sensor that loses its target; these samples are left out",
            self.x[first],
            self.unit(),
            lost.iter().filter(|l| **l).count(),
            self.x.len(),
            self.time_s[first]
        ));
        for (x, lost) in self.x.iter_mut().zip(lost) {
            if lost {
                *x = f64::NAN;
            }
        }
    }

    /// On an even clock; what is missing is interpolated, and not usable.
    fn even(&self, id: &str, notes: &mut Vec<String>) -> Result<EvenAxis, LineError> {
        let (times, x) = (&self.time_s, &self.x);
        let (known_t, known_x) = finite_pairs(times, x);
        if known_t.len() < FEWEST {
            return Err(LineError::TooShort {
                id: id.into(),
                usable: known_t.len(),
                samples: times.len(),
            });
        }
        let (grid, step_s, regular) = even_clock(id, times, notes)?;
        let usable = |t: &f64| {
            let i = known_t.partition_point(|k| k < t);
            let near = |i: usize| known_t.get(i).is_some_and(|k| (k - t).abs() < 1.5 * step_s);
            near(i) || (i > 0 && near(i - 1))
        };
        let at = |(i, t): (usize, &f64)| match regular && x[i].is_finite() {
            true => x[i],
            false => interpolate(&known_t, &known_x, *t),
        };
        let (load_t, load) = finite_pairs(times, &self.load);
        Ok(EvenAxis {
            usable: grid.iter().map(usable).collect(),
            x: grid.iter().enumerate().map(at).collect(),
            load: match load.is_empty() {
                true => Vec::new(),
                false => interpolate_rising(&load_t, &load, grid.iter().copied()).collect(),
            },
            time_s: grid,
            step_s,
        })
    }
}

/// Samples whose value is a number.
fn finite_pairs(times: &[f64], values: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let all = times.iter().zip(values);
    all.filter(|(_, v)| v.is_finite())
        .map(|(t, v)| (*t, *v))
        .unzip()
}

/// Even times over those of the samples, their step, and whether the samples lie at them.
fn even_clock(
    id: &str,
    times: &[f64],
    notes: &mut Vec<String>,
) -> Result<(Vec<f64>, f64, bool), LineError> {
    let step_s = median_step(times);
    let n = times.len();
    let even = |i: usize| times[0] + (times[n - 1] - times[0]) * i as f64 / (n.max(2) - 1) as f64;
    let worst = (0..n)
        .map(|i| (times[i] - even(i)).abs())
        .fold(0.0, f64::max);
    if worst < JITTER * step_s {
        let step_s = (even(n - 1) - even(0)) / (n - 1) as f64;
        let grid = (0..n).map(even).collect();
        return Ok((grid, step_s, worst < JITTER * step_s));
    }
    let missing = (times[n - 1] - times[0]) / step_s - n as f64;
    if missing.is_nan() || missing > SPARSE * n as f64 + SPARSE_AND {
        return Err(LineError::Sparse {
            id: id.into(),
            first_s: times[0],
            last_s: times[n - 1],
            step_s,
            missing,
        });
    }
    let count = ((times[n - 1] - times[0]) / step_s).floor() as usize + 1;
    notes.push(format!(
        "the samples are not evenly spaced (up to {worst:.3e} s off): values were interpolated every {step_s:.6} s"
    ));
    let grid = (0..count).map(|i| times[0] + step_s * i as f64).collect();
    Ok((grid, step_s, false))
}

/// The motion of an axis on an even clock.
struct EvenAxis {
    time_s: Vec<f64>,
    step_s: f64,
    x: Vec<f64>,
    usable: Vec<bool>,
    load: Vec<f64>,
}

impl EvenAxis {
    /// A recording that begins and ends at rest is known before and after: the low-pass of a band then loses
    /// nothing at its ends. Where what was captured lies.
    fn with_rests(&mut self, band_hz: f64, velocity: bool) -> std::ops::Range<usize> {
        let (grid, x, step_s) = (&mut self.time_s, &mut self.x, self.step_s);
        let still = |part: &[f64]| {
            let still = range(part) < STILL * range(x);
            still && (!velocity || part.iter().all(|v| v.abs() < STILL * range(x)))
        };
        let few = (x.len() / 100).max(4);
        let more = ((22.0 / (band_hz * step_s)) as usize).min(3 * x.len());
        let (before, after) = (still(&x[..few]), still(&x[x.len() - few..]));
        let first = if before { more } else { 0 };
        let captured = first..first + x.len();
        if after {
            let (last, end) = (grid[grid.len() - 1], x[x.len() - 1]);
            grid.extend((1..=more).map(|i| last + step_s * i as f64));
            x.extend(std::iter::repeat_n(end, more));
            self.usable.extend(std::iter::repeat_n(true, more));
            if let Some(held) = self.load.last().copied() {
                self.load.extend(std::iter::repeat_n(held, more));
            }
        }
        if before {
            let (first, start) = (grid[0], x[0]);
            grid.splice(0..0, (1..=more).rev().map(|i| first - step_s * i as f64));
            x.splice(0..0, std::iter::repeat_n(start, more));
            self.usable.splice(0..0, std::iter::repeat_n(true, more));
            if let Some(held) = self.load.first().copied() {
                self.load.splice(0..0, std::iter::repeat_n(held, more));
            }
        }
        captured
    }
}

fn axis(recording: &Recording) -> Result<Line, LineError> {
    let id = recording.manifest.id.as_str();
    let (Some(raw), Some(m)) = (&recording.axis, &recording.manifest.axis) else {
        return Err(LineError::Kind(id.into()));
    };
    let mut notes = Vec::new();
    let mut samples = AxisSamples::new(id, raw, m)?;
    let one_clock = samples.one_clock;
    let rest = if one_clock {
        noise_at_rest(&samples.x, &samples.input)
    } else {
        None
    };
    if let Some(span_s) = m.span_s {
        samples.keep(span_s);
    }
    // what the input did at a sample is known where both are on one clock
    if one_clock {
        samples.leave_stuck(&mut notes);
    }
    samples.leave_torn(&mut notes);
    let (velocity, turns) = (samples.velocity, samples.turns);
    notes.extend(unlikely(
        if turns { "angle" } else { "position" },
        if velocity { 0.0 } else { range(&samples.x) },
        if turns { [1e-6, 1e3] } else { [1e-8, 10.0] },
        samples.unit(),
    ));
    let mut even = samples.even(id, &mut notes)?;
    let (input_time_s, input) = finite_pairs(&samples.input_time_s, &samples.input);
    check(
        id,
        &even.usable,
        &[("coordinate", &even.x), ("input", &input)],
    )?;
    let (floor, band_hz) = band(&even.x, even.step_s, if velocity { 1 } else { 2 });
    let floor = floor * in_band(colour(&even.x));
    let captured = even.with_rests(band_hz, velocity);
    let (input_floor, _) = band(&input, median_step(&input_time_s), 0);
    let input_floor = input_floor * in_band(colour(&input));
    let (rest_x, rest_input) = rest.unwrap_or((0.0, 0.0));
    Ok(Line {
        id: id.into(),
        captured,
        time_s: even.time_s,
        timed: true,
        step_s: even.step_s,
        x_noise: floor.sqrt().max(rest_x).max(1e-12 * range(&even.x)),
        x: even.x,
        usable: even.usable,
        noise: 0.0,
        colour: 0.0,
        notes,
        measured: Measured::Axis(AxisLine {
            velocity,
            turns,
            input_noise: input_floor.sqrt().max(rest_input).max(1e-9 * range(&input)),
            input_time_s,
            input,
            unit: match m.input_power {
                1.0 => raw.input_unit.clone(),
                power => format!("{}^{power}", raw.input_unit),
            },
            load: even.load,
            offset_s: Constant::of(recording.manifest.offset_s),
            gain: Constant::of(m.input_gain),
            mass: match m.inertia {
                AxisInertia::MassKg(v) | AxisInertia::InertiaKgM2(v) => Constant::of(v),
            },
            damping: Constant::of(m.damping),
            stiffness: Constant::of(m.stiffness),
            band_hz,
        }),
    })
}

/// Change over the whole range below which the end of a recording is a rest.
const STILL: f64 = 0.002;
/// Samples of a rest, and the spread of the input over its whole spread up to which it is one.
const REST: usize = 64;
const AT_REST: f64 = 0.02;
/// Correlation of neighbours below which samples are noise.
const WHITE: f64 = 0.3;

/// Standard deviations of coordinate and input where the recording rests: the noise that an instrument has in
/// its band, which the floor of a spectrum hides behind an anti-aliasing filter. `None` where nothing rests.
fn noise_at_rest(x: &[f64], input: &[f64]) -> Option<(f64, f64)> {
    let spread = |values: &[f64]| {
        let n = values.len() as f64;
        // about its own line: a slow drift is no noise
        let middle = 0.5 * (n - 1.0);
        let mean = values.iter().sum::<f64>() / n;
        let slope = values
            .iter()
            .enumerate()
            .map(|(i, v)| (i as f64 - middle) * (v - mean))
            .sum::<f64>()
            / (n * (n * n - 1.0) / 12.0);
        let left = |(i, v): (usize, &f64)| (v - mean - slope * (i as f64 - middle)).powi(2);
        (values.iter().enumerate().map(left).sum::<f64>() / (n - 2.0)).sqrt()
    };
    // what follows from sample to sample is motion, not noise
    let white = |values: &[f64]| {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        let next: f64 = values
            .windows(2)
            .map(|w| (w[0] - mean) * (w[1] - mean))
            .sum();
        next.abs() < WHITE * square
    };
    let whole = spread(input);
    let mut rests: Vec<(f64, f64)> = x
        .chunks_exact(REST)
        .zip(input.chunks_exact(REST))
        .filter(|(x, _)| white(x))
        .map(|(x, u)| (spread(x), spread(u)))
        .filter(|(x, u)| x.is_finite() && *u < AT_REST * whole)
        .collect();
    // ringing after the drive ended is no rest: the quieter half of the rests
    rests.sort_by(|a, b| a.0.total_cmp(&b.0));
    rests.get(rests.len() / 4).copied()
}

/// How far above its floor a spectrum is signal.
const ABOVE_FLOOR: f64 = 4.0;
/// The band never reaches further than this share of the sampling rate.
const WIDEST: f64 = 0.36;

/// Variance of the white floor of a signal, and the frequency up to which its derivative (of the order that
/// the balance needs) stands above that floor, Hz.
fn band(values: &[f64], step_s: f64, derivatives: i32) -> (f64, f64) {
    let power = spectrum(values);
    let bins = power.len();
    let size = 2 * bins;
    let mut top: Vec<f64> = power[bins * 85 / 100..].to_vec();
    top.sort_by(f64::total_cmp);
    let floor = top[top.len() / 2];
    // what a wider band brings of the balance's derivative, less the noise that comes with it: a far line has
    // to be worth the noise between
    let (mut sum, mut best, mut end) = (0.0, 0.0, 6);
    for (k, p) in power.iter().enumerate().skip(1) {
        sum += (p - ABOVE_FLOOR * floor) * (k as f64).powi(2 * derivatives);
        if sum > best {
            (best, end) = (sum, (k + 2).max(6));
        }
    }
    let highest = (WIDEST * size as f64) as usize;
    (floor, end.min(highest) as f64 / (size as f64 * step_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_ends_where_the_signal_does() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut generator = rand_chacha::ChaCha12Rng::seed_from_u64(3);
        let values: Vec<f64> = (0..8000)
            .map(|i| {
                let t = i as f64 * 0.01;
                let z: f64 = StandardNormal.sample(&mut generator);
                (6.0 * t).sin() + 0.5 * (60.0 * t).sin() + 0.01 * z
            })
            .collect();
        let (floor, f) = band(&values, 0.01, 2);
        // the fastest sine is at 9.5 Hz
        assert!((9.0..12.5).contains(&f), "{f}");
        assert!((floor.sqrt() / 0.01 - 1.0).abs() < 0.15, "{}", floor.sqrt());
    }

    #[test]
    fn a_sensor_that_loses_its_target_is_seen() {
        let motion = |i: usize| 0.05 + 0.02 * (i as f64 * 0.05).sin();
        let mut x: Vec<f64> = (0..2000).map(motion).collect();
        assert!(!torn_away(&x).contains(&true));
        for (j, v) in x[700..712].iter_mut().enumerate() {
            *v = 0.0101 + 1e-6 * (j % 3) as f64;
        }
        let lost = torn_away(&x);
        assert!((0..2000).all(|i| lost[i] == (700..712).contains(&i)));
        // one leap without a way back is a step, and a motion of steps is no fault
        let step: Vec<f64> = (0..2000).map(|i| f64::from(i >= 900)).collect();
        assert!(!torn_away(&step).contains(&true));
        let square: Vec<f64> = (0..2000).map(|i| f64::from(i / 40 % 2 == 0)).collect();
        assert!(!torn_away(&square).contains(&true));
    }

    #[test]
    fn a_sensor_at_its_rail_is_seen() {
        let x: Vec<f64> = (0..40).map(|i| f64::from(i).min(30.0)).collect();
        let y: Vec<f64> = (0..40).map(|i| 2.0 * f64::from(i)).collect();
        let rail = at_rail(&x, &y, 0.01);
        assert_eq!(rail.iter().filter(|r| **r).count(), 10);
        assert!(rail[30] && !rail[29]);
    }
}
