//! A single axis: plausible strokes and rates, and signs of mass, damping and stiffness, from one linear
//! regression.
//!
//! gain input + load = mass x'' + damping x' + stiffness x + constant, with x, its derivatives and the input
//! as means over one and the same step, short beside the motion.

use super::linear::{Columns, about_mean, quantile};
use super::view::{View, per_cent, short};
use super::{Findings, Grade};
use crate::recording::{AxisInertia, NumberOrEstimate, RawAxis, RawCoordinate};

/// Strokes, m, and slowest sampling of a dynamic test, s.
const STROKE_M: [f64; 2] = [1e-7, 5.0];
const TURNS_RAD: f64 = 1e4;
const SLOWEST_S: f64 = 0.5;
/// Fastest motion of a rig, m/s.
const FASTEST_M_S: f64 = 300.0;
/// Share of the input's variance that the regression has to explain, for its signs to count.
const EXPLAINS: f64 = 0.6;
/// A clock offset is told where the regression explains at most this share, and this much more with it.
const HARDLY: f64 = 0.5;
const WELL: f64 = 0.85;
/// Standard errors that a mass, a damping, a stiffness or a friction lies from 0 to count as told.
const TOLD: f64 = 8.0;
/// Share of the largest rate below which an axis counts as at rest.
const AT_REST: f64 = 0.02;
/// Steps of the regression, at most.
const MOST: usize = 6000;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let (Some(a), Some(stated)) = (&view.recording.axis, &view.recording.manifest.axis) else {
        return;
    };
    if found.wrong(&["sentinel", "stated_value"]) {
        return;
    }
    let (column, velocity) = match &a.coordinate {
        RawCoordinate::Position(c) => (c, false),
        RawCoordinate::Velocity(c) => (c, true),
    };
    let turns = matches!(stated.inertia, AxisInertia::InertiaKgM2(_));
    let si = column.unit.map_or(1.0, |u| u.to_si);
    let x: Vec<f64> = column.values.iter().map(|v| v * si).collect();
    let range = quantile(x.iter().copied(), 0.999) - quantile(x.iter().copied(), 0.001);
    let symbol = column.unit.map_or("", |u| u.symbol);
    let unitless = circuit(stated, &a.input_unit);
    if !turns
        && !velocity
        && !unitless
        && !(STROKE_M[0]..=STROKE_M[1]).contains(&range)
        && range > 0.0
    {
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "the position ranges over {} m ({} {symbol}), which no such axis does",
                short(range),
                short(range / si)
            ),
            "state the position's unit under [axis]: units = { position = \"mm\", ... }",
        );
    }
    if !turns && velocity && range > FASTEST_M_S {
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "the velocity ranges over {} m/s, which no such axis does",
                short(range)
            ),
            "state the velocity's unit, or its scale, under [axis]",
        );
    }
    if turns && !velocity && range > TURNS_RAD {
        found.add(
            "unit",
            Grade::Wrong,
            format!("the angle ranges over {} rad", short(range)),
            "state the angle's unit under [axis]: units = { position = \"deg\", ... }",
        );
    }
    let step = quantile(a.time_s.windows(2).map(|w| w[1] - w[0]), 0.5);
    if step >= SLOWEST_S {
        found.add(
            "rate",
            Grade::Wrong,
            format!(
                "the samples lie {} s apart and the recording lasts {} s: nothing that moves can be told from that; milliseconds, it seems",
                short(step),
                short(a.time_s[a.time_s.len() - 1] - a.time_s[0])
            ),
            "state the time's unit under [axis]: units = { time = \"ms\", ... }",
        );
        return;
    }
    if found.wrong(&["unit", "frozen"]) {
        return;
    }
    signs(view, &x, velocity, found);
}

/// Whether the gain is 1 N a volt: a circuit whose voltages stand for a position and a force.
fn circuit(m: &crate::recording::AxisManifest, input_unit: &str) -> bool {
    m.input_gain == NumberOrEstimate::Number(1.0) && input_unit.ends_with('V')
}

struct Regression {
    explained: f64,
    /// Mass, damping, stiffness per unit of input, with their sizes over their standard errors.
    beta: [f64; 3],
    t: [f64; 3],
}

/// The part of an axis's recording that is looked at.
struct Course<'a> {
    axis: &'a RawAxis,
    /// Position or velocity, SI.
    x: &'a [f64],
    velocity: bool,
    /// The input to its stated power.
    input: Vec<f64>,
    offset_s: f64,
    start_s: f64,
    end_s: f64,
    frame_s: f64,
}

impl<'a> Course<'a> {
    /// `None` where the offset is to be found, or nothing lies inside the stated span.
    fn new(view: &View<'a>, x: &'a [f64], velocity: bool) -> Option<Self> {
        let axis = view.recording.axis.as_ref()?;
        let stated = view.recording.manifest.axis.as_ref()?;
        let NumberOrEstimate::Number(offset_s) = view.recording.manifest.offset_s else {
            return None;
        };
        let span = stated.span_s.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let mut inside =
            (0..axis.time_s.len()).filter(|&i| (span[0]..=span[1]).contains(&axis.time_s[i]));
        let i0 = inside.next()?;
        let i1 = inside.next_back().unwrap_or(i0);
        let power = stated.input_power;
        let to_power = |u: &f64| {
            if power == 1.0 {
                *u
            } else if power % 2.0 == 0.0 {
                u.abs().powf(power)
            } else {
                u.signum() * u.abs().powf(power)
            }
        };
        Some(Course {
            axis,
            x,
            velocity,
            input: axis.input.values.iter().map(to_power).collect(),
            offset_s,
            start_s: axis.time_s[i0],
            end_s: axis.time_s[i1],
            frame_s: quantile(axis.time_s[i0..=i1].windows(2).map(|w| w[1] - w[0]), 0.5),
        })
    }

    /// Means over `n` steps, read `ahead` later on their own clock, all smoothed alike: mean of three steps,
    /// then differences over two.
    fn smoothed(&self, times: &[f64], values: &[f64], ahead: f64, step: f64, n: usize) -> Vec<f64> {
        let mut sum = vec![(0.0, 0.0); n];
        for (t, v) in times.iter().zip(values) {
            let at = (t - ahead - self.start_s) / step;
            if at >= 0.0 && (at as usize) < n && v.is_finite() {
                sum[at as usize].0 += *v;
                sum[at as usize].1 += 1.0;
            }
        }
        let v: Vec<f64> = sum.iter().map(|(s, c)| s / c).collect();
        (0..n)
            .map(|i| {
                if i == 0 || i + 1 == n {
                    f64::NAN
                } else {
                    (v[i - 1] + 2.0 * v[i] + v[i + 1]) / 4.0
                }
            })
            .collect()
    }

    /// Columns of mass, damping, stiffness, constant and load, and the input that is `lag` further ahead.
    fn rows(&self, step: f64, lag: f64) -> Option<(Vec<Vec<f64>>, Vec<f64>)> {
        let a = self.axis;
        let n = (((self.end_s - self.start_s) / step) as usize).min(MOST);
        if n < 30 {
            return None;
        }
        let smoothed = |times: &[f64], values: &[f64], ahead: f64| {
            self.smoothed(times, values, ahead, step, n)
        };
        let xs = smoothed(&a.time_s, self.x, 0.0);
        let input_time = a.input_time_s.as_ref().unwrap_or(&a.time_s);
        let us = smoothed(input_time, &self.input, self.offset_s + lag);
        let loads: Vec<f64> = a.load.as_ref().map_or(Vec::new(), |l| {
            let si = l.unit.map_or(1.0, |u| u.to_si);
            let newton = smoothed(&a.time_s, &l.values, 0.0);
            newton.iter().map(|v| v * si).collect()
        });
        let first = |v: &[f64], i: usize| (v[i + 1] - v[i - 1]) / (2.0 * step);
        let second = |v: &[f64], i: usize| (v[i + 1] - 2.0 * v[i] + v[i - 1]) / (step * step);
        let mut columns = vec![Vec::new(); if loads.is_empty() { 4 } else { 5 }];
        let mut y = Vec::new();
        let mut sum = 0.0;
        for i in 2..n - 2 {
            // the position of a velocity, by its sum
            if self.velocity && xs[i].is_finite() {
                sum += xs[i] * step;
            }
            let row = if self.velocity {
                [first(&xs, i), xs[i], sum]
            } else {
                [second(&xs, i), first(&xs, i), xs[i]]
            };
            let load = loads.get(i).copied().unwrap_or(0.0);
            if us[i].is_finite() && load.is_finite() && row.iter().all(|v| v.is_finite()) {
                for (c, v) in columns.iter_mut().zip(row) {
                    c.push(v);
                }
                columns[3].push(1.0);
                if !loads.is_empty() {
                    columns[4].push(load);
                }
                y.push(us[i]);
            }
        }
        (y.len() >= 30).then_some((columns, y))
    }

    /// The regression in steps of `step`, the input `lag` further ahead.
    fn regress(&self, step: f64, lag: f64) -> Option<Regression> {
        let (columns, y) = self.rows(step, lag)?;
        let variance = about_mean(&y);
        let mut t = [0.0; 3];
        let solved = Columns::new(columns.clone())?.solve(&y);
        for (k, t) in t.iter_mut().enumerate() {
            let mut fewer = columns.clone();
            fewer.remove(k);
            let without = Columns::new(fewer)?.solve(&y).left;
            // neighbours are smoothed together: a quarter of the rows are independent
            *t = (0.25 * y.len() as f64 * (without / solved.left.max(1e-12 * variance) - 1.0))
                .max(0.0)
                .sqrt();
        }
        Some(Regression {
            explained: 1.0 - solved.left / variance.max(1e-300),
            beta: [solved.beta[0], solved.beta[1], solved.beta[2]],
            t,
        })
    }

    /// Whether dry friction is told beside mass, damping and stiffness, and takes energy: the input does work
    /// then, as the sign of its gain says, and a negative stiffness is that of a joint that gravity tips over.
    fn input_works(&self, step: f64, gain: f64) -> bool {
        let Some((mut columns, y)) = self.rows(step, 0.0) else {
            return false;
        };
        let fast = columns[1].iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let direction: Vec<f64> = columns[1]
            .iter()
            .map(|v| {
                if v.abs() < AT_REST * fast {
                    0.0
                } else {
                    v.signum()
                }
            })
            .collect();
        let solve = |columns: Vec<Vec<f64>>| Some(Columns::new(columns)?.solve(&y));
        let Some(without) = solve(columns.clone()) else {
            return false;
        };
        columns.push(direction);
        let at = columns.len() - 1;
        let Some(with) = solve(columns) else {
            return false;
        };
        let floor = 1e-12 * about_mean(&y);
        let t_square = 0.25 * y.len() as f64 * (without.left / with.left.max(floor) - 1.0);
        t_square > TOLD * TOLD && with.beta[at] * gain > 0.0
    }

    /// Steps that are tried, s.
    fn steps(&self) -> impl Iterator<Item = f64> {
        (0..8).map(|k| self.frame_s * f64::from(1 << k))
    }

    /// The step at which it explains most: long enough for the noise, short enough for the motion.
    fn best_step(&self) -> Option<(f64, Regression)> {
        self.steps()
            .filter_map(|step| self.regress(step, 0.0).map(|r| (step, r)))
            .max_by(|a, b| a.1.explained.total_cmp(&b.1.explained))
    }

    /// The lag with which the regression explains well what it hardly does without, and how much that is.
    fn other_clock(&self, step: f64) -> Option<(f64, f64)> {
        let length = self.end_s - self.start_s;
        let lags = (-400..=400).map(|i| 0.9e-3 * length * f64::from(i));
        lags.filter_map(|lag| self.regress(step, lag).map(|r| (lag, r.explained)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|(lag, explained)| *explained > WELL && lag.abs() > 3.0 * step)
    }
}

fn signs(view: &View<'_>, x: &[f64], velocity: bool, found: &mut Findings) {
    let Some(stated) = &view.recording.manifest.axis else {
        return;
    };
    let Some(course) = Course::new(view, x, velocity) else {
        return;
    };
    let Some((step, r)) = course.best_step() else {
        return;
    };
    if r.explained < HARDLY
        && let Some((lag, explained)) = course.other_clock(step)
    {
        found.add(
            "clock",
            Grade::Wrong,
            format!(
                "the input looks {} s ahead of the motion: with that, mass, damping and stiffness explain {} of the input instead of {}",
                short(lag),
                per_cent(explained),
                per_cent(r.explained.max(0.0))
            ),
            "look at the times of position and input; an input of its own clock goes into input_file, with [sync] offset_s",
        );
        return;
    }
    let NumberOrEstimate::Number(gain) = stated.input_gain else {
        return;
    };
    if r.explained < EXPLAINS || course.steps().any(|step| course.input_works(step, gain)) {
        return;
    }
    negative(&r, gain, velocity, found);
}

/// Says when all that is told of mass, damping and stiffness has the wrong sign.
fn negative(r: &Regression, gain: f64, velocity: bool, found: &mut Findings) {
    let names = ["mass", "damping", "stiffness"];
    let told: Vec<usize> = (0..3).filter(|&k| r.t[k] > TOLD).collect();
    let negative: Vec<usize> = told
        .iter()
        .copied()
        .filter(|&k| r.beta[k] * gain < 0.0)
        .collect();
    // stiffness of a velocity is that of its own drift
    if !negative.is_empty() && negative.len() == told.len() && (negative.len() >= 2 || !velocity) {
        let list: Vec<String> = negative
            .iter()
            .map(|&k| format!("{} {}", names[k], short(r.beta[k] * gain)))
            .collect();
        let smallest = negative
            .iter()
            .map(|&k| r.t[k])
            .fold(f64::INFINITY, f64::min);
        found.add_with(
            "sign",
            Grade::Wrong,
            format!(
                "with input_gain = {gain} the axis would have {} ({} of the input explained): the force counts against the position",
                list.join(", "),
                per_cent(r.explained)
            ),
            "change the sign of input_gain, or of scale for the input",
            (-0.5 * smallest * smallest).exp().max(1e-300),
        );
    }
}
