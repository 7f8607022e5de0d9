//! The law of a cause at one moment of a course. One law serves both ways: the inverse model walks it along
//! the course that was measured ([`along`]), the forward model along the one that it makes, and with
//! [`Dual`] numbers the same lines give the derivatives by every unknown (the variational equations of the
//! discrete scheme, exact to rounding).

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{Terms, View};

/// A number of a law: a float, or one with derivatives.
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// A constant.
    fn of(value: f64) -> Self;
    /// Its value.
    fn value(self) -> f64;
    /// f(self), by the value and the slope of f there.
    fn with(self, value: f64, slope: f64) -> Self;
    /// So many times itself.
    #[inline]
    fn times(self, factor: f64) -> Self {
        self.with(factor * self.value(), factor)
    }
    /// Magnitude.
    fn abs(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }
    /// e^self.
    fn exp(self) -> Self {
        let e = self.value().exp();
        self.with(e, e)
    }
    /// Hyperbolic tangent.
    fn tanh(self) -> Self {
        let t = self.value().tanh();
        self.with(t, 1.0 - t * t)
    }
    /// The larger of two.
    fn max(self, other: Self) -> Self {
        if other.value() > self.value() {
            other
        } else {
            self
        }
    }
    /// The smaller of two.
    fn min(self, other: Self) -> Self {
        if other.value() < self.value() {
            other
        } else {
            self
        }
    }
}

impl Real for f64 {
    #[inline]
    fn of(value: f64) -> Self {
        value
    }
    #[inline]
    fn value(self) -> f64 {
        self
    }
    #[inline]
    fn with(self, value: f64, _: f64) -> Self {
        value
    }
}

/// Unknowns whose derivatives are carried at once: mass, damping, stiffness, bias and both initial states.
pub const LANES: usize = 6;

/// A number with its derivatives by up to [`LANES`] unknowns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual {
    /// The number.
    pub value: f64,
    /// Its derivatives.
    pub by: [f64; LANES],
}

impl Dual {
    /// The unknown of a lane, or a constant.
    #[must_use]
    pub fn unknown(value: f64, lane: Option<usize>) -> Self {
        let mut by = [0.0; LANES];
        if let Some(lane) = lane {
            by[lane] = 1.0;
        }
        Dual { value, by }
    }

    #[inline]
    fn both(self, other: Self, value: f64, a: f64, b: f64) -> Self {
        let mut by = [0.0; LANES];
        for (out, (x, y)) in by.iter_mut().zip(self.by.iter().zip(&other.by)) {
            *out = a * x + b * y;
        }
        Dual { value, by }
    }
}

impl Add for Dual {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        self.both(o, self.value + o.value, 1.0, 1.0)
    }
}

impl Sub for Dual {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        self.both(o, self.value - o.value, 1.0, -1.0)
    }
}

impl Mul for Dual {
    type Output = Self;
    #[inline]
    fn mul(self, o: Self) -> Self {
        self.both(o, self.value * o.value, o.value, self.value)
    }
}

impl Div for Dual {
    type Output = Self;
    #[inline]
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        self.both(o, value, 1.0 / o.value, -value / o.value)
    }
}

impl Neg for Dual {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.with(-self.value, -1.0)
    }
}

impl Real for Dual {
    #[inline]
    fn of(value: f64) -> Self {
        Dual {
            value,
            by: [0.0; LANES],
        }
    }
    #[inline]
    fn value(self) -> f64 {
        self.value
    }
    #[inline]
    fn with(self, value: f64, slope: f64) -> Self {
        let mut by = self.by;
        by.iter_mut().for_each(|b| *b *= slope);
        Dual { value, by }
    }
}

/// A moment of a course, as a cause sees it.
#[derive(Debug, Clone, Copy)]
pub struct Moment<R> {
    /// Since the first sample, s.
    pub since_s: f64,
    /// Since the first sample of the first recording of the series, s.
    pub series_s: f64,
    /// As [`View::unstrained`].
    pub unstrained: bool,
    /// As [`View::straight`].
    pub straight: bool,
    /// Since the moment at which the memory was left, s.
    pub step_s: f64,
    /// Excursion from rest, over the largest one.
    pub xi: R,
    /// How far it went since then, as far as its noise does not make it ([`View::way`]).
    pub way: R,
    /// Rate of the excursion, 1/s.
    pub rate: R,
    /// Force of the springs at the current model, over the largest measured force.
    pub elastic: R,
}

/// What a cause remembers.
#[derive(Debug, Clone, Copy)]
pub struct Memory<R> {
    /// The excursion when it was left.
    pub before: R,
    /// The state of the cause then.
    pub state: R,
}

/// What a cause may change at one moment; see [`Terms`].
#[derive(Debug, Clone, Copy)]
pub struct Point<R> {
    /// The excursion that springs see.
    pub xi: R,
    /// Multiplies the force of [equilibrium spring, branches].
    pub factor: [R; 2],
    /// Force that the model asks for beside that of the plain model, over the largest measured one.
    pub force: R,
    /// Mass beside that of the plain model: that force for a unit of acceleration, s^2.
    pub inertia: R,
    /// Multiplies the input.
    pub gain: R,
}

/// The law of a cause whose doing is told by the course of the coordinate.
pub trait Law: Sync + Send {
    /// Its state where the course begins at `xi`; 0 unless stated.
    fn begin<R: Real>(&self, _xi: R) -> R {
        R::of(0.0)
    }
    /// Carries the state on to the moment, and changes the point. `v` as in [`super::Effect::line`].
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>);
}

/// A law in one kind of number.
pub trait At<R> {
    /// [`Law::begin`].
    fn begins(&self, xi: R) -> R;
    /// [`Law::act`], from one step of an integration to the next.
    fn acts(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>);
}

impl<R: Real, L: Law> At<R> for L {
    fn begins(&self, xi: R) -> R {
        self.begin(xi)
    }
    fn acts(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        self.act(v, at, state, point);
    }
}

/// A law, alone and with derivatives.
pub trait Forward: At<f64> + At<Dual> + Sync + Send {}

impl<L: Law> Forward for L {}

/// Walks a law along a measured course: what [`super::Effect::line`] does of a cause that has one.
pub(super) fn along<L: Law>(law: &L, v: &[f64], view: &View, terms: &mut Terms) {
    let Some(&first) = view.xi.first() else {
        return;
    };
    let mut memory = Memory {
        before: first,
        state: law.begin(first) + view.held,
    };
    for i in 0..view.xi.len() {
        let since_s = view.time_s[i] - view.time_s[0];
        let at = Moment {
            since_s,
            series_s: view.series_s + since_s,
            unstrained: view.unstrained,
            straight: view.straight,
            step_s: view.time_s[i] - view.time_s[i.saturating_sub(1)],
            xi: view.xi[i],
            way: view.way[i] - view.way[i.saturating_sub(1)],
            rate: view.rate[i],
            // empty where only what becomes of the input is asked
            elastic: view.elastic.get(i).copied().unwrap_or(0.0),
        };
        let mut point = Point {
            xi: terms.xi[i],
            factor: terms.factor[i],
            force: terms.force[i],
            inertia: 0.0,
            gain: terms.gain[i],
        };
        law.act(v, &at, &mut memory, &mut point);
        memory.before = at.xi;
        terms.xi[i] = point.xi;
        terms.factor[i] = point.factor;
        let acceleration = view.acceleration.get(i).copied().unwrap_or(0.0);
        terms.force[i] = point.force + point.inertia * acceleration;
        terms.gain[i] = point.gain;
    }
}

/// The state of sliding, from -1 to 1, carried over a way `d`: it follows the direction over the distance
/// `presliding`.
pub(super) fn slid<R: Real>(z: R, d: R, presliding: R) -> R {
    let way = d.value();
    if way == 0.0 {
        return z;
    }
    z + (R::of(way.signum()) - z) * (R::of(1.0) - (-d.abs() / presliding).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_are_those_of_a_central_difference() {
        fn f<R: Real>(x: R, y: R) -> R {
            (x * y - y / x).tanh() * (-x.abs()).exp() + x.max(y) * y.min(R::of(0.3)) - y
        }
        let (x, y) = (0.7, 0.4);
        let d = f(Dual::unknown(x, Some(0)), Dual::unknown(y, Some(3)));
        assert_eq!(d.value.to_bits(), f(x, y).to_bits());
        let h = 1e-6;
        assert!((d.by[0] - (f(x + h, y) - f(x - h, y)) / (2.0 * h)).abs() < 1e-9);
        assert!((d.by[3] - (f(x, y + h) - f(x, y - h)) / (2.0 * h)).abs() < 1e-9);
        assert!(d.by[1] == 0.0);
    }
}
