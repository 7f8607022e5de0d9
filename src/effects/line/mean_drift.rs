//! A zero that drifts:  force a t over the recording's length.

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct MeanDrift;

impl LineEffect for MeanDrift {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.01]]]
    }
}

impl Effect for MeanDrift {
    fn id(&self) -> &'static str {
        "x_zero_drift"
    }
    fn says(&self) -> &'static str {
        "the zero of the force, or of the rest position, drifts along the recording"
    }
    fn source(&self) -> &'static str {
        "linear drift of a zero"
    }
    fn equation(&self) -> &'static str {
        "f -> f + change t/t_end"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("change", "force", -1.0, 1.0, 0.05)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "rests at the beginning and at the end"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for MeanDrift {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + v[0] * R::of(at.since_s / at.span_s);
    }
}
