//! A modulus that drifts:  all springs times 1 + a t over the recording's length.

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct Drift;

impl LineEffect for Drift {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.02]]]
    }
}

impl Effect for Drift {
    fn id(&self) -> &'static str {
        "temperature_drift"
    }
    fn says(&self) -> &'static str {
        "the stiffness drifts along the recording"
    }
    fn source(&self) -> &'static str {
        "linear drift of the modulus"
    }
    fn equation(&self) -> &'static str {
        "all springs times 1 + relative_change t/t_end"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("relative_change", "1", -0.5, 0.5, 0.05)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "the first test again as the last"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Drift {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        let g = R::of(1.0) + v[0] * R::of(at.since_s / at.span_s);
        point.factor = point.factor.map(|f| f * g);
    }
}
