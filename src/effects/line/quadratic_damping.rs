//! Drag:  force c v |v|.

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct QuadraticDamping;

impl LineEffect for QuadraticDamping {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.02 / view.speed.powi(2)]]]
    }
}

impl Effect for QuadraticDamping {
    fn id(&self) -> &'static str {
        "x_quadratic_damping"
    }
    fn says(&self) -> &'static str {
        "a drag that grows with the square of the speed"
    }
    fn source(&self) -> &'static str {
        "drag of a body in a fluid"
    }
    fn equation(&self) -> &'static str {
        "f -> f + coefficient v |v|"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[size(
                "coefficient",
                "force/(coordinate/s)^2",
                -10.0,
                10.0,
                0.02,
            )]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "steps and sines of several amplitudes"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for QuadraticDamping {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + v[0] * at.rate * at.rate.abs();
    }
}
