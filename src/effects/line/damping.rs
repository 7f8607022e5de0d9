//! A viscous resistance of a flexure, whose plain model is a curve of torque over angle:  force c v.

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct Damping;

impl LineEffect for Damping {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        match view.timed {
            true => vec![vec![vec![0.02 / view.speed]]],
            false => Vec::new(),
        }
    }
}

impl Effect for Damping {
    fn id(&self) -> &'static str {
        "joint_damping"
    }
    fn says(&self) -> &'static str {
        "a resistance that grows with the speed"
    }
    fn source(&self) -> &'static str {
        "viscous damper"
    }
    fn equation(&self) -> &'static str {
        "f -> f + coefficient v"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("coefficient", "force s/coordinate", 0.0, 1e3, 0.05)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "the same loop at several speeds"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Damping {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + v[0] * at.rate;
    }
}
