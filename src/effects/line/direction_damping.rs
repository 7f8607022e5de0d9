//! Viscous force that acts in one direction of motion only:  c max(v, 0).

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct DirectionDamping;

impl LineEffect for DirectionDamping {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.02 / view.speed]]]
    }
}

impl Effect for DirectionDamping {
    fn id(&self) -> &'static str {
        "x_direction_damping"
    }
    fn says(&self) -> &'static str {
        "the viscous resistance differs with the direction"
    }
    fn source(&self) -> &'static str {
        "one-sided viscous force"
    }
    fn equation(&self) -> &'static str {
        "f -> f + coefficient max(v, 0)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("coefficient", "force s/coordinate", -10.0, 10.0, 0.05)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "the same speeds in both directions"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for DirectionDamping {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + v[0] * at.rate.max(R::of(0.0));
    }
}
