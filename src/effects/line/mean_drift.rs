//! A zero that drifts:  force a d, with the d of [`super::drift`].

use super::super::{Effect, Quantity, size};
use super::drift::{ALONG, OVER, TIME_CONSTANT, course, gone_before, near, of_series};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct MeanDrift;

impl LineEffect for MeanDrift {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        near(0.01, view)
    }
    fn held(&self, v: &[f64]) -> Option<Quantity> {
        gone_before(v)
    }
}

impl Effect for MeanDrift {
    fn id(&self) -> &'static str {
        "x_zero_drift"
    }
    fn says(&self) -> &'static str {
        "the zero of the force, or of the rest position, drifts, along each recording or over the series"
    }
    fn source(&self) -> &'static str {
        "drift of a zero to another temperature"
    }
    fn equation(&self) -> &'static str {
        "f -> f + change d, d = (1 - e^(-t/time_constant)) over its value after 60 s of the recording, or 600 s of the series"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                ALONG,
                size("change", "force", -1.0, 1.0, 0.05),
                TIME_CONSTANT,
            ]
        }
    }
    fn variants(&self) -> &'static [&'static str] {
        OVER
    }
    fn over_series(&self, v: &[f64]) -> bool {
        of_series(v)
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
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + v[1] * course(v, at, state.state);
    }
}
