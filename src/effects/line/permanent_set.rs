//! Permanent set:  the spring sees x - s x_max, x_max the largest x so far.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct PermanentSet;

impl LineEffect for PermanentSet {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis, Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.02]]]
    }
    fn held(&self, _: &[f64]) -> Option<Quantity> {
        Some(shape("largest_before", "coordinate", 0.0, 0.0, 1.0, 0.5))
    }
}

impl Effect for PermanentSet {
    fn id(&self) -> &'static str {
        "x_permanent_set"
    }
    fn says(&self) -> &'static str {
        "it does not come back: rest moves by a share of the largest excursion"
    }
    fn source(&self) -> &'static str {
        "permanent set of an elastomer"
    }
    fn equation(&self) -> &'static str {
        "x -> x - share x_max, x_max the largest x so far"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("share", "1", 0.0, 0.5, 0.03)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "a rest after each amplitude of a staircase"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for PermanentSet {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        state.state = state.state.max(at.xi);
        point.xi = point.xi - v[0] * state.state;
    }
}
