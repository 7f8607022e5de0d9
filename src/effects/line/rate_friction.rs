//! Dry friction that lets go where nothing moves:  force F tanh(v/v0).

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct RateFriction;

impl LineEffect for RateFriction {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        [0.01, 0.1]
            .iter()
            .map(|&x| vec![vec![0.02, x * view.speed]])
            .collect()
    }
}

impl Effect for RateFriction {
    fn id(&self) -> &'static str {
        "x_rate_friction"
    }
    fn says(&self) -> &'static str {
        "dry friction resists what moves, and nothing is left of it at rest: something else than the input holds the axis there"
    }
    fn source(&self) -> &'static str {
        "Coulomb 1785, smoothed about zero speed"
    }
    fn equation(&self) -> &'static str {
        "f -> f + force tanh(v/speed)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("force", "force", 0.0, 1.0, 0.05),
                shape("speed", "coordinate/s", 0.1, 1e-4, 1e3, 0.2),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "constant speeds in both directions with rests between"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for RateFriction {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + v[0] * (at.rate / v[1]).tanh();
    }
}
