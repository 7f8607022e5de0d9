//! A mass that changes with the stroke, J = J_0 + c x:  force c (x x'' + x'^2/2).

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct StrokeInertia;

impl LineEffect for StrokeInertia {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        match view.inertial {
            true => vec![vec![vec![0.02 / view.speed.powi(2)]]],
            false => Vec::new(),
        }
    }
}

impl Effect for StrokeInertia {
    fn id(&self) -> &'static str {
        "x_stroke_inertia"
    }
    fn says(&self) -> &'static str {
        "the moving mass changes with the stroke: what hangs on a lever or a crank moves more at one end than at the other"
    }
    fn source(&self) -> &'static str {
        "Lagrange's equation of a coordinate whose kinetic energy is J(x) v^2/2"
    }
    fn equation(&self) -> &'static str {
        "f -> f + coefficient (x dv/dt + v^2/2)"
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
        "the same quick sine about several positions"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for StrokeInertia {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.inertia = point.inertia + v[0] * at.xi;
        point.force = point.force + R::of(0.5) * v[0] * at.rate * at.rate;
    }
}
