//! The motion of a single axis run forward, and its residual: the position (or velocity) that the model makes
//! of the input, minus the one that was measured, over its noise.
//!
//! ```text
//! m x'' + c x' + k x_s + b + F(x, x', memory) = g(x) u(t) + load(t),     x_s, F, g: what causes make of them
//! ```
//!
//! By the classical Runge-Kutta scheme in even steps, a whole number of them a sample; without mass x' is
//! solved for in place of x''. Causes act by the same laws as in the inverse model
//! ([`crate::effects::line::Law`]), which remember the course from step to step. Derivatives by every
//! unknown, initial states included, come from the same lines with [`Dual`] numbers; only those by what acts
//! on the input alone (a clock, a lag of the drive) begin with a central difference of the input.
//!
//! What the input does between its samples is stated ([`Between`]): a filter of its own, which matters as
//! soon as the motion is known to a thousandth.
//!
//! Unknowns, in this order: those of [`LineResidual`] that are linear there (beta), its nonlinear ones (free
//! clock offsets, values of causes over their spreads), then position and velocity at the first sample of
//! each piece, over the largest excursion and the largest speed. A recording may be cut into pieces that
//! begin anew, which keeps a poor start from running away (multiple shooting: Bock 1981).

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use nalgebra::{DMatrix, DVectorView};
use rayon::prelude::*;

use super::line::LineResidual;
use super::{Normal, SeparableResidual, Slope};
use crate::dataset::line::{AxisLine, Line, Measured, interpolate_rising};
use crate::effects::Acting;
use crate::effects::line::{At, Dual, Forward, LANES, Memory, Moment, Point, Real, runs_forward};

/// What an input does between its samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    /// Straight lines.
    Straight,
    /// Held until the next sample.
    Held,
    /// Smooth: nothing above half the sampling rate (Shannon 1949), by a windowed sinc.
    Smooth,
}

impl Between {
    /// All of them.
    pub const ALL: [Between; 3] = [Between::Straight, Between::Held, Between::Smooth];

    /// As files and options write it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Between::Straight => "straight",
            Between::Held => "held",
            Between::Smooth => "smooth",
        }
    }

    /// In words.
    #[must_use]
    pub fn says(self) -> &'static str {
        match self {
            Between::Straight => "goes straight from sample to sample",
            Between::Held => "is held until the next sample",
            Between::Smooth => "is smooth between samples, with nothing above half their rate",
        }
    }
}

/// Samples to each side that a smooth input is worked out from.
const REACH: i64 = 40;
/// Unevenness of an input's clock, over its step, beyond which nothing says what is smooth between samples.
const EVEN: f64 = 1e-3;
/// Relative step of a difference of the input.
const STEP: f64 = 1e-4;
/// Longest step of the clock's difference, in samples of the input.
const CLOCK_STEP: f64 = 1e-3;
/// Fewest samples of a piece.
const SHORTEST: usize = 100;
/// Turns of an iteration.
const TURNS: usize = 60;

/// Why a motion cannot be run forward.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Trouble {
    /// No axis.
    #[error("only an axis is run forward: a bench and a coupon are led along their coordinate")]
    Kind,
    /// A cause without a law.
    #[error("the cause `{0}` cannot be run forward: take it out of the parameter file")]
    Cause(String),
    /// Neither mass nor damping.
    #[error("an axis without mass and damping has no motion of its own to run forward")]
    Massless,
    /// The input's clock is uneven.
    #[error(
        "recording `{0}`: the input's samples are not evenly spaced, so that nothing says what is smooth \
         between them: take `straight` or `held`"
    )]
    Uneven(String),
    /// The motion runs away.
    #[error(
        "recording `{id}`: at {at_s:.4} s the motion that the model makes runs away: a negative damping or \
         stiffness, or a mass so small that {steps} steps a sample are too few"
    )]
    RunsAway {
        /// Recording.
        id: String,
        /// Time of the last finite sample, s.
        at_s: f64,
        /// Steps a sample.
        steps: usize,
    },
}

/// A part of a recording that begins anew: number of the recording, its samples.
#[derive(Debug, Clone, PartialEq)]
struct Piece {
    number: usize,
    samples: std::ops::Range<usize>,
}

/// The plant and its causes in one kind of number, in the unit of the inverse model's balance.
struct Driven<'b, R> {
    mass: R,
    damping: R,
    stiffness: R,
    bias: R,
    /// Multiplies the load.
    per_load: R,
    /// Multiplies the input.
    gain: f64,
    laws: Vec<(&'static dyn Forward, &'b [R])>,
    rest: R,
    coordinate: f64,
    force: f64,
    to_xi: f64,
    /// Unit of the velocities at the beginning, over that of the coordinate, 1/s.
    speed: f64,
    /// The first sample in the time of the series, s.
    series_s: f64,
}

/// Where a run stands: memories as they were left `passed` seconds ago.
struct Going<R> {
    x: R,
    v: R,
    memories: Vec<Memory<R>>,
    scratch: Vec<Memory<R>>,
    passed: f64,
}

/// Beginning, middle and end of a step.
const HALVES: [f64; 3] = [0.0, 0.5, 1.0];

/// Input, load and time at the beginning, the middle and the end of a step of `h` seconds.
struct Stages<R> {
    u: [R; 3],
    load: [R; 3],
    time_s: [f64; 3],
    h: f64,
}

impl<R: Real> Driven<'_, R>
where
    dyn Forward: At<R>,
{
    /// The first sample, with memories as a course begins.
    fn begin(&self, states: &[R], velocity: bool, massless: bool) -> Going<R> {
        let mut states = states.iter();
        let mut next = || states.next().copied().unwrap_or(R::of(0.0));
        let x = if velocity {
            R::of(0.0)
        } else {
            next().times(self.coordinate) + self.rest
        };
        let v = if massless {
            R::of(0.0)
        } else {
            next().times(self.coordinate * self.speed)
        };
        let begin = (x - self.rest).times(self.to_xi);
        let memories: Vec<Memory<R>> = self
            .laws
            .iter()
            .map(|(law, _)| Memory {
                before: begin,
                state: law.begins(begin),
            })
            .collect();
        Going {
            x,
            v,
            scratch: memories.clone(),
            memories,
            passed: 0.0,
        }
    }

    /// What pushes, less c x' where it is not among the unknowns, and the mass that it pushes. A moment: its
    /// time, and how long ago the memory was left.
    #[inline(always)]
    fn push(
        &self,
        x: R,
        v: R,
        u: R,
        load: R,
        moment: (f64, f64),
        memory: &mut [Memory<R>],
    ) -> (R, R) {
        let xi = (x - self.rest).times(self.to_xi);
        let before = memory.first().map_or(xi, |m| m.before);
        let at = Moment {
            since_s: moment.0,
            series_s: self.series_s + moment.0,
            unstrained: false,
            straight: true,
            step_s: moment.1,
            xi,
            way: xi - before,
            rate: v.times(self.to_xi),
            elastic: (self.stiffness * xi).times(self.coordinate / self.force),
        };
        let mut point = Point {
            xi,
            factor: [R::of(1.0); 2],
            force: R::of(0.0),
            inertia: R::of(0.0),
            gain: R::of(1.0),
        };
        for ((law, values), m) in self.laws.iter().zip(memory) {
            law.acts(values, &at, m, &mut point);
            m.before = xi;
        }
        let (mut total, mut mass) = (u.times(self.gain), self.mass);
        if !self.laws.is_empty() {
            total = total * point.gain - point.force.times(self.force);
            point.xi = point.xi * point.factor[0];
            mass = mass + point.inertia.times(self.force * self.to_xi);
        }
        if !load_is_none(load) {
            total = total + self.per_load * load;
        }
        let pushed = total - self.bias - (self.stiffness * point.xi).times(self.coordinate);
        (pushed, mass)
    }

    /// The acceleration at a place.
    #[inline(always)]
    fn swing(&self, x: R, v: R, u: R, load: R, moment: (f64, f64), memory: &mut [Memory<R>]) -> R {
        let (pushed, mass) = self.push(x, v, u, load, moment, memory);
        (pushed - self.damping * v) / mass
    }

    /// The velocity without mass, from a guess `v`: c v = push(v).
    #[inline(always)]
    fn slide(&self, x: R, u: R, load: R, moment: (f64, f64), memory: &mut [Memory<R>], v: R) -> R {
        if self.laws.is_empty() {
            return self.push(x, v, u, load, moment, memory).0 / self.damping;
        }
        let (c, small) = (self.damping.value(), 1e-6 * self.speed * self.coordinate);
        let left = |v: f64| {
            let mut own = memory.to_vec();
            let (pushed, _) = self.push(x, R::of(v), u, load, moment, &mut own);
            pushed.value() - c * v
        };
        let (mut v, mut slope) = (v.value(), -c);
        for _ in 0..TURNS {
            let e = left(v);
            slope = (left(v + small) - e) / small;
            let step = e / slope;
            v -= step;
            if step.abs() < 1e-12 * self.speed * self.coordinate || !step.is_finite() {
                break;
            }
        }
        // one more step in the number at hand carries its derivatives (implicit function)
        let at = R::of(v);
        let e = self.push(x, at, u, load, moment, memory).0 - self.damping * at;
        at - e.times(1.0 / slope)
    }

    /// The velocity without mass at a sample; memories stay as they are.
    #[inline(always)]
    fn sliding(&self, going: &mut Going<R>, u: R, load: R, since: f64) -> R {
        going.scratch.clone_from(&going.memories);
        let moment = (since, going.passed);
        self.slide(going.x, u, load, moment, &mut going.scratch, going.v)
    }

    /// One step without mass. Carries the memory on to the beginning of the step.
    #[inline(always)]
    fn slide_on(&self, going: &mut Going<R>, s: &Stages<R>) {
        let (x, h) = (going.x, s.h);
        let now = (s.time_s[0], going.passed);
        let r1 = self.slide(x, s.u[0], s.load[0], now, &mut going.memories, going.v);
        going.passed = h;
        let mut stage = |x: R, k: usize, guess: R| {
            going.scratch.clone_from(&going.memories);
            let moment = (s.time_s[k], HALVES[k] * h);
            self.slide(x, s.u[k], s.load[k], moment, &mut going.scratch, guess)
        };
        let r2 = stage(x + r1.times(0.5 * h), 1, r1);
        let r3 = stage(x + r2.times(0.5 * h), 1, r2);
        let r4 = stage(x + r3.times(h), 2, r3);
        going.x = x + (r1 + (r2 + r3).times(2.0) + r4).times(h / 6.0);
        going.v = r4;
    }

    /// One step with mass. Carries the memory on to the beginning of the step.
    #[inline(always)]
    fn swing_on(&self, going: &mut Going<R>, s: &Stages<R>) {
        let (x, v, h) = (going.x, going.v, s.h);
        let now = (s.time_s[0], going.passed);
        let a1 = self.swing(x, v, s.u[0], s.load[0], now, &mut going.memories);
        going.passed = h;
        let mut stage = |x: R, v: R, k: usize| {
            going.scratch.clone_from(&going.memories);
            let moment = (s.time_s[k], HALVES[k] * h);
            self.swing(x, v, s.u[k], s.load[k], moment, &mut going.scratch)
        };
        let v2 = v + a1.times(0.5 * h);
        let a2 = stage(x + v.times(0.5 * h), v2, 1);
        let v3 = v + a2.times(0.5 * h);
        let a3 = stage(x + v2.times(0.5 * h), v3, 1);
        let v4 = v + a3.times(h);
        let a4 = stage(x + v3.times(h), v4, 2);
        going.x = x + (v + (v2 + v3).times(2.0) + v4).times(h / 6.0);
        going.v = v + (a1 + (a2 + a3).times(2.0) + a4).times(h / 6.0);
    }
}

/// An input on its own clock, and how much later than the motion's clock it is read, s.
type Sent = (Vec<f64>, f64);

/// The input of a recording: as it is sent, and with each unknown that acts on it moved up and down (the
/// unknown, how far apart, both).
struct Inputs {
    value: Sent,
    by: Vec<(usize, f64, [Sent; 2])>,
}

/// Axes run forward.
#[derive(Clone)]
pub struct MotionResidual<'a> {
    inverse: LineResidual<'a>,
    between: Between,
    steps: usize,
    cut: (usize, usize),
    pieces: Vec<Piece>,
    /// What unknowns are multiplied by to be beta.
    unit: Vec<f64>,
    /// The fastest rate, 1/s: unit of the velocities at the beginning.
    speed: f64,
    /// Noise of each recording.
    noise: Vec<f64>,
    /// The recorded input of each piece, once it has been worked out.
    tables: Arc<Vec<OnceLock<Vec<f64>>>>,
}

fn empty(pieces: usize) -> Arc<Vec<OnceLock<Vec<f64>>>> {
    Arc::new((0..pieces).map(|_| OnceLock::new()).collect())
}

fn axis(line: &Line) -> Result<&AxisLine, Trouble> {
    match &line.measured {
        Measured::Axis(a) => Ok(a),
        _ => Err(Trouble::Kind),
    }
}

impl<'a> MotionResidual<'a> {
    /// Recordings of axes run forward in `steps` steps a sample, each cut into `pieces`, of which only the
    /// first samples are kept where all would be more than so many. `inverse` states what is known of them
    /// and which causes are at work; `unit` is what the unknowns beta are counted in.
    ///
    /// # Errors
    /// [`Trouble`] where something cannot be run forward.
    pub fn new(
        inverse: LineResidual<'a>,
        between: Between,
        steps: usize,
        (pieces, most): (usize, usize),
        unit: Vec<f64>,
    ) -> Result<Self, Trouble> {
        let lines: Vec<&Line> = inverse.lines().collect();
        let mut parts = Vec::new();
        for (number, line) in lines.iter().enumerate() {
            let axis = axis(line)?;
            if between == Between::Smooth && even_step(&axis.input_time_s).is_none() {
                return Err(Trouble::Uneven(line.id.clone()));
            }
            let (from, n) = (line.captured.start, line.captured.len());
            let count = pieces.min(n / SHORTEST).max(1);
            parts.extend((0..count).map(|i| Piece {
                number,
                samples: from + i * n / count..from + (i + 1) * n / count,
            }));
        }
        let all: usize = parts.iter().map(|p| p.samples.len()).sum();
        if all > most {
            for p in &mut parts {
                let own = (p.samples.len() as f64 * most as f64 / all as f64) as usize;
                p.samples.end = p.samples.start + own.max(SHORTEST).min(p.samples.len());
            }
        }
        forward(&inverse)?;
        let speed = (0..lines.len())
            .flat_map(|n| inverse.course(n).2.iter())
            .fold(0.0_f64, |m, r| m.max(r.abs()))
            .max(f64::MIN_POSITIVE);
        Ok(MotionResidual {
            inverse,
            between,
            steps,
            cut: (pieces, most),
            tables: empty(parts.len()),
            pieces: parts,
            unit,
            speed,
            noise: lines
                .iter()
                .map(|l| l.x_noise.max(f64::MIN_POSITIVE))
                .collect(),
        })
    }

    /// The same with other causes at work: `inverse` of the same recordings.
    ///
    /// # Errors
    /// [`Trouble`] where a cause cannot be run forward.
    pub fn with_inverse(&self, inverse: LineResidual<'a>) -> Result<Self, Trouble> {
        forward(&inverse)?;
        Ok(MotionResidual {
            inverse,
            ..self.clone()
        })
    }

    /// The inverse model of the same recordings.
    #[must_use]
    pub fn inverse(&self) -> &LineResidual<'a> {
        &self.inverse
    }

    /// The same with other steps.
    #[must_use]
    pub fn with_steps(&self, steps: usize) -> Self {
        MotionResidual {
            steps,
            tables: empty(self.pieces.len()),
            ..self.clone()
        }
    }

    /// The same with beta counted in other units.
    #[must_use]
    pub fn with_unit(&self, unit: Vec<f64>) -> Self {
        MotionResidual {
            unit,
            ..self.clone()
        }
    }

    /// The same, nothing in it told by what was measured of the motion: a prediction reads nothing of what it
    /// predicts.
    #[must_use]
    pub fn blind(&self) -> Self {
        let coordinate = self.inverse.scales().coordinate;
        let count = self.noise.len();
        MotionResidual {
            speed: 0.1 / self.line(0).step_s,
            noise: vec![coordinate; count],
            ..self.clone()
        }
    }

    /// What the unknowns beta are counted in.
    #[must_use]
    pub fn unit(&self) -> &[f64] {
        &self.unit
    }

    /// Pieces of a recording, and samples over all of them at most.
    #[must_use]
    pub fn cut(&self) -> (usize, usize) {
        self.cut
    }

    /// What the input does between samples.
    #[must_use]
    pub fn between(&self) -> Between {
        self.between
    }

    /// Steps a sample.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Unknowns before the initial states.
    #[must_use]
    pub fn shared(&self) -> usize {
        self.inverse.linear() + self.inverse.nonlinear()
    }

    /// Initial states of a piece: position where there is one, velocity where there is a mass.
    #[must_use]
    pub fn states(&self) -> usize {
        usize::from(!self.velocity()) + usize::from(self.inverse.has_mass())
    }

    /// All unknowns.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.shared() + self.states() * self.pieces.len()
    }

    /// Whether the velocity was measured.
    #[must_use]
    pub fn velocity(&self) -> bool {
        self.inverse
            .lines()
            .any(|l| matches!(&l.measured, Measured::Axis(a) if a.velocity))
    }

    /// The unknowns at a point of the inverse model, pieces beginning where they were measured to.
    #[must_use]
    pub fn at(&self, beta: &[f64], eta: &[f64]) -> Vec<f64> {
        let own = beta.iter().zip(&self.unit).map(|(b, u)| b / u);
        let mut out: Vec<f64> = own.chain(eta.iter().copied()).collect();
        for p in &self.pieces {
            let (_, xi, rate) = self.inverse.course(p.number);
            if !self.velocity() {
                out.push(xi[p.samples.start]);
            }
            if self.inverse.has_mass() {
                out.push(rate[p.samples.start] / self.speed);
            }
        }
        out
    }

    /// beta and eta of the inverse model at the unknowns.
    #[must_use]
    pub fn model(&self, unknowns: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let linear = self.inverse.linear();
        let beta = unknowns[..linear].iter().zip(&self.unit);
        (
            beta.map(|(b, u)| b * u).collect(),
            unknowns[linear..self.shared()].to_vec(),
        )
    }

    /// Initial states of a piece.
    fn states_of<'b>(&self, piece: usize, unknowns: &'b [f64]) -> &'b [f64] {
        let from = self.shared() + piece * self.states();
        &unknowns[from..from + self.states()]
    }

    /// The input of a piece at every half step, on the motion's clock.
    fn table(&self, piece: &Piece, (made, offset): &Sent) -> Vec<f64> {
        let line = self.line(piece.number);
        let Ok(axis) = axis(line) else {
            return Vec::new();
        };
        let first = line.time_s[piece.samples.start] + offset;
        let half = 0.5 * line.step_s / self.steps as f64;
        let count = 2 * self.steps * (piece.samples.len() - 1) + 1;
        let times = (0..count).map(|j| first + half * j as f64);
        match (self.between, even_step(&axis.input_time_s)) {
            (Between::Held, _) => {
                // a sample that is due within rounding is there
                let early = 1e-6 * half;
                let mut i = 0;
                let of = |t: f64| {
                    while i + 1 < made.len() && axis.input_time_s[i + 1] <= t + early {
                        i += 1;
                    }
                    made[i]
                };
                times.map(of).collect()
            }
            (Between::Smooth, Some(step)) => {
                let start = axis.input_time_s[0];
                smooth(made, times.map(|t| (t - start) / step))
            }
            _ => interpolate_rising(&axis.input_time_s, made, times).collect(),
        }
    }

    fn line(&self, number: usize) -> &'a Line {
        self.inverse.line_of(number)
    }

    /// The same of one of the pieces; where nothing acts on the input it is worked out once.
    fn table_of(&self, piece: usize, sent: &Sent) -> Cow<'_, [f64]> {
        let own = &self.pieces[piece];
        let touched = self.inverse.free_offsets().contains(&own.number)
            || self
                .inverse
                .acting()
                .iter()
                .any(|a| a.effect.law().is_none());
        if touched {
            return Cow::Owned(self.table(own, sent));
        }
        Cow::Borrowed(self.tables[piece].get_or_init(|| self.table(own, sent)))
    }

    /// The input of a recording, and what the unknowns that act on it make of it.
    fn inputs(&self, number: usize, eta: &[f64]) -> Inputs {
        let sent = |eta: &[f64]| self.inverse.driven(number, eta, &self.inverse.effects(eta));
        let mut by = Vec::new();
        for place in (0..eta.len()).filter(|&p| self.inverse.on_input(number, p)) {
            let step = if place < self.inverse.free_offsets().len() {
                CLOCK_STEP * self.line(number).step_s
            } else {
                STEP * eta[place].abs().max(1e-2)
            };
            let moved = |by: f64| {
                let mut eta = eta.to_vec();
                eta[place] += by;
                (sent(&eta), self.inverse.bounded(&eta, place))
            };
            let ((up, high), (down, low)) = (moved(step), moved(-step));
            // a value at its bound does not move: what is left is one-sided
            if high > low {
                by.push((self.inverse.linear() + place, high - low, [up, down]));
            }
        }
        Inputs {
            value: sent(eta),
            by,
        }
    }

    /// Runs a piece, and gives `out` what is measured of every sample.
    fn run<R: Real>(
        &self,
        piece: &Piece,
        driven: &Driven<'_, R>,
        states: &[R],
        input: &dyn Fn(usize) -> R,
        out: &mut dyn FnMut(usize, R),
    ) -> Result<(), Trouble>
    where
        dyn Forward: At<R>,
    {
        let line = self.line(piece.number);
        let load = &axis(line)?.load;
        let massless = !self.inverse.has_mass();
        let velocity = self.velocity();
        let mut going = driven.begin(states, velocity, massless);
        let origin = line.time_s[0];
        let h = line.step_s / self.steps as f64;
        let held = self.between == Between::Held;
        let load_at = |i: usize, share: f64| -> R {
            match (load.get(i), load.get(i + 1)) {
                (Some(a), Some(b)) => R::of(a + share * (b - a)),
                (Some(a), None) => R::of(*a),
                _ => R::of(0.0),
            }
        };
        let last = piece.samples.end - 1;
        for i in piece.samples.clone() {
            let since = line.time_s[i] - origin;
            let first = 2 * self.steps * (i - piece.samples.start);
            if massless && velocity {
                going.v = driven.sliding(&mut going, input(first), load_at(i, 0.0), since);
            }
            let seen = if velocity { going.v } else { going.x };
            if !seen.value().is_finite() {
                return Err(Trouble::RunsAway {
                    id: line.id.clone(),
                    at_s: line.time_s[i.saturating_sub(1)],
                    steps: self.steps,
                });
            }
            out(i, seen);
            if i == last {
                break;
            }
            for step in 0..self.steps {
                let j = first + 2 * step;
                let share = |half: f64| (step as f64 + half) / self.steps as f64;
                let stages = Stages {
                    u: if held { [j + 1; 3] } else { [j, j + 1, j + 2] }.map(input),
                    load: HALVES.map(|s| load_at(i, share(s))),
                    time_s: HALVES.map(|half| since + h * (step as f64 + half)),
                    h,
                };
                if massless {
                    driven.slide_on(&mut going, &stages);
                } else {
                    driven.swing_on(&mut going, &stages);
                }
            }
        }
        Ok(())
    }

    /// The plant and its causes on a recording. `beta` and `values` (of the effects) in the number at hand.
    fn driven<'b, R: Real>(
        &self,
        number: usize,
        beta: &[R],
        effects: &[Acting],
        values: &'b [Vec<R>],
    ) -> Driven<'b, R> {
        let s = self.inverse.scales();
        let [mass, damping, stiffness, bias, per_load] = self.inverse.balance(beta);
        Driven {
            mass,
            damping,
            stiffness,
            bias,
            per_load,
            gain: self.inverse.gain(),
            laws: effects
                .iter()
                .zip(values)
                .filter_map(|(a, v)| Some((a.effect.law()?, v.as_slice())))
                .collect(),
            rest: R::of(s.rest),
            coordinate: s.coordinate,
            force: s.force,
            to_xi: 1.0 / s.coordinate,
            speed: self.speed,
            series_s: self.inverse.when(number).series_s,
        }
    }

    fn check(&self) -> Result<(), Trouble> {
        if !self.inverse.has_mass() && !self.inverse.has_damping() {
            return Err(Trouble::Massless);
        }
        Ok(())
    }

    /// What the model makes of the coordinate (velocity) at every sample of a piece, in its own unit. Nothing
    /// of what was measured of the motion is read.
    ///
    /// # Errors
    /// [`Trouble`] where the motion runs away.
    fn piece(
        &self,
        piece: &Piece,
        unknowns: &[f64],
        states: &[f64],
        table: &[f64],
    ) -> Result<Vec<f64>, Trouble> {
        self.check()?;
        let (beta, eta) = self.model(unknowns);
        let effects = self.inverse.effects(&eta);
        let values: Vec<Vec<f64>> = effects.iter().map(|a| a.values.clone()).collect();
        let mut out = Vec::with_capacity(piece.samples.len());
        let driven = self.driven(piece.number, &beta, &effects, &values);
        self.run(piece, &driven, states, &|j| table[j], &mut |_, x| {
            out.push(x)
        })?;
        Ok(out)
    }

    /// What the model makes of the coordinate (or velocity) of a recording at its captured samples, from
    /// initial states as [`Self::rest`] or [`Self::begun`] give them.
    ///
    /// # Errors
    /// [`Trouble`] where the motion runs away.
    pub fn predicted(
        &self,
        number: usize,
        unknowns: &[f64],
        states: &[f64],
    ) -> Result<Vec<f64>, Trouble> {
        let samples = self.line(number).captured.clone();
        let piece = Piece { number, samples };
        let table = self.table(&piece, &self.sent(number, unknowns));
        self.piece(&piece, unknowns, states, &table)
    }

    /// The input of a recording at the unknowns.
    fn sent(&self, number: usize, unknowns: &[f64]) -> Sent {
        let (_, eta) = self.model(unknowns);
        self.inverse
            .driven(number, &eta, &self.inverse.effects(&eta))
    }

    /// What the model makes of each piece, in their order.
    fn made(&self, unknowns: &[f64]) -> Result<Vec<Vec<f64>>, Trouble> {
        let count = self.noise.len();
        let sent: Vec<Sent> = (0..count).map(|n| self.sent(n, unknowns)).collect();
        self.pieces
            .par_iter()
            .enumerate()
            .map(|(n, p)| {
                let table = self.table_of(n, &sent[p.number]);
                self.piece(p, unknowns, self.states_of(n, unknowns), &table)
            })
            .collect()
    }

    /// The initial states at rest under the first input: where the spring holds it, or at the zero of the
    /// excursion where none does.
    #[must_use]
    pub fn rest(&self, number: usize, unknowns: &[f64]) -> Vec<f64> {
        let (beta, eta) = self.model(unknowns);
        let effects = self.inverse.effects(&eta);
        let [_, _, k, b, per_load] = self.inverse.balance(&beta);
        let line = self.line(number);
        let start = line.captured.start;
        let s = self.inverse.scales();
        let mut out = Vec::new();
        if !self.velocity() {
            let piece = Piece {
                number,
                samples: start..start + 2,
            };
            let table = self.table(&piece, &self.inverse.driven(number, &eta, &effects));
            let load = axis(line).map_or(0.0, |a| a.load.get(start).copied().unwrap_or(0.0));
            let mut xi = 0.0_f64;
            for _ in 0..TURNS {
                if k <= 0.0 {
                    break;
                }
                let mut point = Point {
                    xi,
                    factor: [1.0; 2],
                    force: 0.0,
                    inertia: 0.0,
                    gain: 1.0,
                };
                let at = Moment {
                    since_s: 0.0,
                    series_s: self.inverse.when(number).series_s,
                    unstrained: false,
                    straight: true,
                    step_s: 0.0,
                    xi,
                    way: 0.0,
                    rate: 0.0,
                    elastic: k * s.coordinate * xi / s.force,
                };
                for a in &effects {
                    if let Some(law) = a.effect.law() {
                        let mut memory = Memory {
                            before: xi,
                            state: At::<f64>::begins(law, xi),
                        };
                        law.acts(&a.values, &at, &mut memory, &mut point);
                    }
                }
                let left = table[0] * self.inverse.gain() * point.gain + per_load * load
                    - b
                    - s.force * point.force
                    - k * s.coordinate * point.xi * point.factor[0];
                let step = left / (k * s.coordinate);
                xi = (xi + 0.7 * step).clamp(-3.0, 3.0);
                if step.abs() < 1e-12 {
                    break;
                }
            }
            out.push(xi);
        }
        if self.inverse.has_mass() {
            out.push(0.0);
        }
        out
    }

    /// The initial states that the first `samples` measured ones tell: smallest squares over them, nothing
    /// later being read.
    ///
    /// # Errors
    /// [`Trouble`] where the motion runs away.
    pub fn begun(
        &self,
        number: usize,
        unknowns: &[f64],
        samples: usize,
    ) -> Result<Vec<f64>, Trouble> {
        let line = self.line(number);
        let from = line.captured.start;
        let n = samples.clamp(2, line.captured.len());
        let piece = Piece {
            number,
            samples: from..from + n,
        };
        let own: Vec<usize> = (self.shared()..self.shared() + self.states()).collect();
        let mut states = self.rest(number, unknowns);
        if !self.velocity() {
            states[0] =
                (line.x[from] - self.inverse.scales().rest) / self.inverse.scales().coordinate;
        }
        let mut all = unknowns[..self.shared()].to_vec();
        all.extend(&states);
        let inputs = self.inputs(number, &self.model(unknowns).1);
        let value = self.table(&piece, &inputs.value);
        for _ in 0..8 {
            let table = (&inputs, &*value);
            let rows = self.rows(&piece, &all, (self.shared(), &states), &own, table)?;
            let width = own.len();
            let j = rows.columns(0, width);
            let gram = j.tr_mul(&j);
            let gram = &gram + DMatrix::from_diagonal(&gram.diagonal()) * 1e-12;
            let pull = j.tr_mul(&rows.column(width));
            let Some(step) = gram.cholesky().map(|c| c.solve(&pull)) else {
                break;
            };
            for (s, d) in states.iter_mut().zip(step.iter()) {
                *s -= d;
            }
        }
        Ok(states)
    }

    /// Derivatives of a piece's residual by the unknowns `wanted`, and the residual, at its usable samples;
    /// `states` with the number of the unknown that the first of them is.
    fn rows(
        &self,
        piece: &Piece,
        unknowns: &[f64],
        states: (usize, &[f64]),
        wanted: &[usize],
        (inputs, value): (&Inputs, &[f64]),
    ) -> Result<DMatrix<f64>, Trouble> {
        self.check()?;
        let line = self.line(piece.number);
        let usable: Vec<usize> = piece.samples.clone().filter(|&i| line.usable[i]).collect();
        let (beta, eta) = self.model(unknowns);
        let effects = self.inverse.effects(&eta);
        let linear = self.inverse.linear();
        let noise = self.noise[piece.number];
        let passes: Vec<DMatrix<f64>> = wanted
            .par_chunks(LANES)
            .map(|own| {
                let lane = |unknown: usize| own.iter().position(|w| *w == unknown);
                let beta: Vec<Dual> = beta
                    .iter()
                    .zip(&self.unit)
                    .enumerate()
                    .map(|(i, (b, unit))| Dual::unknown(b / unit, lane(i)).times(*unit))
                    .collect();
                let values: Vec<Vec<Dual>> = effects
                    .iter()
                    .enumerate()
                    .map(|(e, a)| {
                        let quantities = a.effect.parameters();
                        a.values
                            .iter()
                            .enumerate()
                            .map(|(v, value)| {
                                let place = self.inverse.place_of(e, v);
                                let spread = quantities[v].spread;
                                let own = place.and_then(|p| lane(linear + p));
                                Dual::unknown(value / spread, own).times(spread)
                            })
                            .collect()
                    })
                    .collect();
                let numbered = states.1.iter().enumerate();
                let states: Vec<Dual> = numbered
                    .map(|(i, s)| Dual::unknown(*s, lane(states.0 + i)))
                    .collect();
                let slope = |(unknown, apart, moved): &(usize, f64, [Sent; 2])| {
                    let lane = lane(*unknown)?;
                    let [up, down] = [0, 1].map(|i| self.table(piece, &moved[i]));
                    let slopes = up.iter().zip(&down).map(|(u, d)| (u - d) / apart);
                    Some((lane, slopes.collect::<Vec<f64>>()))
                };
                let slopes: Vec<(usize, Vec<f64>)> = inputs.by.iter().filter_map(slope).collect();
                let at = |j: usize| {
                    let mut u = Dual::of(value[j]);
                    for (lane, slope) in &slopes {
                        u.by[*lane] = slope[j];
                    }
                    u
                };
                let mut out = DMatrix::zeros(usable.len(), own.len() + 1);
                let mut row = 0;
                let mut put = |i: usize, x: Dual| {
                    if usable.get(row) == Some(&i) {
                        for (l, d) in x.by[..own.len()].iter().enumerate() {
                            out[(row, l)] = d / noise;
                        }
                        out[(row, own.len())] = (x.value - line.x[i]) / noise;
                        row += 1;
                    }
                };
                let driven = self.driven(piece.number, &beta, &effects, &values);
                self.run(piece, &driven, &states, &at, &mut put)?;
                Ok(out)
            })
            .collect::<Result<_, Trouble>>()?;
        let mut out = DMatrix::zeros(usable.len(), wanted.len() + 1);
        for (pass, own) in passes.iter().enumerate() {
            // the last column of each is the residual, and the last of all stays
            out.columns_mut(pass * LANES, own.ncols()).copy_from(own);
        }
        Ok(out)
    }

    /// The whitened design of all pieces: d r/d unknowns, residual.
    ///
    /// # Errors
    /// [`Trouble`] where the motion runs away.
    pub fn design(&self, unknowns: &[f64]) -> Result<DMatrix<f64>, Trouble> {
        let n = self.unknowns();
        let counted = |p: &Piece| {
            let line = self.line(p.number);
            p.samples.clone().filter(|&i| line.usable[i]).count()
        };
        let rows: usize = self.pieces.iter().map(counted).sum();
        let (_, eta) = self.model(unknowns);
        let count = self.noise.len();
        let inputs: Vec<Inputs> = (0..count).map(|n| self.inputs(n, &eta)).collect();
        let parts: Vec<(Vec<usize>, DMatrix<f64>)> = self
            .pieces
            .par_iter()
            .enumerate()
            .map(|(number, p)| {
                let first = self.shared() + number * self.states();
                let wanted: Vec<usize> = (0..self.shared())
                    .chain(first..first + self.states())
                    .collect();
                let states = (first, self.states_of(number, unknowns));
                let inputs = &inputs[p.number];
                let value = self.table_of(number, &inputs.value);
                let own = self.rows(p, unknowns, states, &wanted, (inputs, &value))?;
                Ok((wanted, own))
            })
            .collect::<Result<_, Trouble>>()?;
        let mut out = DMatrix::zeros(rows, n + 1);
        let mut from = 0;
        for (wanted, own) in &parts {
            for (column, &unknown) in wanted.iter().chain([&n]).enumerate() {
                out.view_mut((from, unknown), (own.nrows(), 1))
                    .copy_from(&own.column(column));
            }
            from += own.nrows();
        }
        Ok(out)
    }

    /// The whitened residual alone, with other causes at work than the unknowns state.
    ///
    /// # Errors
    /// [`Trouble`] where the motion runs away.
    pub fn residual(&self, unknowns: &[f64]) -> Result<Vec<f64>, Trouble> {
        let mut out = Vec::new();
        for (p, made) in self.pieces.iter().zip(self.made(unknowns)?) {
            let line = self.line(p.number);
            let noise = self.noise[p.number];
            let counted = p.samples.clone().zip(made).filter(|(i, _)| line.usable[*i]);
            out.extend(counted.map(|(i, x)| (x - line.x[i]) / noise));
        }
        Ok(out)
    }

    /// Rows of each recording in [`Self::design`], in their order.
    #[must_use]
    pub fn rows_of_recordings(&self) -> Vec<usize> {
        let mut out = vec![0; self.inverse.lines().count()];
        for p in &self.pieces {
            let line = self.line(p.number);
            out[p.number] += p.samples.clone().filter(|&i| line.usable[i]).count();
        }
        out
    }

    /// What the model makes of the coordinate at all captured samples of every recording, at unknowns of one
    /// piece a recording.
    ///
    /// # Errors
    /// [`Trouble`] where the motion runs away.
    pub fn courses(&self, unknowns: &[f64]) -> Result<Vec<Vec<f64>>, Trouble> {
        self.made(unknowns)
    }
}

/// Whether all causes at work can be run forward.
fn forward(inverse: &LineResidual) -> Result<(), Trouble> {
    match inverse.acting().iter().find(|a| !runs_forward(a.effect)) {
        Some(a) => Err(Trouble::Cause(a.effect.id().into())),
        None => Ok(()),
    }
}

/// Whether there is no load.
fn load_is_none<R: Real>(load: R) -> bool {
    load.value() == 0.0
}

/// The step of an even clock; `None` where it is uneven.
fn even_step(time_s: &[f64]) -> Option<f64> {
    let n = time_s.len();
    if n < 2 {
        return None;
    }
    let step = (time_s[n - 1] - time_s[0]) / (n - 1) as f64;
    let even =
        |(i, t): (usize, &f64)| (t - time_s[0] - step * i as f64).abs() < EVEN * step * n as f64;
    let steps = time_s
        .windows(2)
        .all(|w| ((w[1] - w[0]) / step - 1.0).abs() < 0.05);
    (step > 0.0 && steps && time_s.iter().enumerate().all(even)).then_some(step)
}

/// Band-limited values at rising places, in samples; beyond the ends the first and last value hold.
fn smooth(values: &[f64], places: impl Iterator<Item = f64>) -> Vec<f64> {
    let last = values.len() as i64 - 1;
    // one kernel a fraction of a sample: there are few
    let mut kernels: Vec<(f64, Vec<f64>)> = Vec::new();
    let mut used = 0;
    places
        .map(|place| {
            let whole = place.floor();
            let share = place - whole;
            let near = |k: &(f64, Vec<f64>)| (k.0 - share).abs() < 1e-9;
            let count = kernels.len();
            let found = (0..count)
                .map(|i| (used + 1 + i) % count)
                .find(|&i| near(&kernels[i]));
            let k = found.unwrap_or_else(|| {
                if count >= 512 {
                    kernels.clear();
                }
                kernels.push((share, kernel(share)));
                kernels.len() - 1
            });
            used = k;
            let first = whole as i64 - REACH + 1;
            let taps = &kernels[k].1;
            if first >= 0 && first + 2 * REACH - 1 <= last {
                let own = &values[first as usize..][..taps.len()];
                // nalgebra's product adds in eight lanes at once
                return DVectorView::from_slice(own, own.len())
                    .dot(&DVectorView::from_slice(taps, taps.len()));
            }
            let at = |i: i64| values[(first + i).clamp(0, last) as usize];
            (0..2 * REACH).zip(taps).map(|(i, t)| at(i) * t).sum()
        })
        .collect()
}

/// Weights of the samples from 1 - [`REACH`] to [`REACH`] at a share of a sample after the one before: sinc
/// under a raised cosine, of sum 1.
fn kernel(share: f64) -> Vec<f64> {
    use std::f64::consts::PI;
    let of = |j: i64| {
        let x = share - j as f64;
        let sinc = if x.abs() < 1e-12 {
            1.0
        } else {
            (PI * x).sin() / (PI * x)
        };
        sinc * (0.5 * PI * (x / REACH as f64).clamp(-1.0, 1.0))
            .cos()
            .powi(2)
    };
    let taps: Vec<f64> = (1 - REACH..=REACH).map(of).collect();
    let sum: f64 = taps.iter().sum();
    taps.iter().map(|t| t / sum).collect()
}

impl SeparableResidual for MotionResidual<'_> {
    type Error = Trouble;

    fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, Trouble> {
        let design = self.design(eta)?;
        Ok(Normal {
            gram: design.tr_mul(&design),
            slopes: (0..eta.len())
                .map(|nonlinear| Slope {
                    nonlinear,
                    linear: None,
                })
                .collect(),
            reference: reference.to_vec(),
            rows: design.nrows(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_smooth_input_is_the_sine_it_was_sampled_from() {
        let of = |t: f64| (2.1 * t).sin() + 0.3 * (0.4 * t).cos();
        let values: Vec<f64> = (0..400).map(|i| of(f64::from(i))).collect();
        let places: Vec<f64> = (0..800).map(|j| 100.0 + 0.25 * f64::from(j)).collect();
        let made = smooth(&values, places.iter().copied());
        for (p, v) in places.iter().zip(made) {
            assert!((v - of(*p)).abs() < 2e-4, "{p}: {v} {}", of(*p));
        }
    }
}
