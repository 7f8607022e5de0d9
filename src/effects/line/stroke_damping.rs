//! Damping that changes along the stroke:  force (a x + b x^2) v (x over the largest excursion).

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct StrokeDamping;

impl LineEffect for StrokeDamping {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        let small = 0.02 / view.speed;
        vec![vec![vec![0.0, small], vec![small, 0.0]]]
    }
}

impl Effect for StrokeDamping {
    fn id(&self) -> &'static str {
        "x_stroke_damping"
    }
    fn says(&self) -> &'static str {
        "the viscous resistance changes along the stroke: a gap that narrows squeezes its film harder"
    }
    fn source(&self) -> &'static str {
        "van der Pol 1926; squeeze-film damping"
    }
    fn equation(&self) -> &'static str {
        "f -> f + (linear x + quadratic x^2) v"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("linear", "force s/coordinate", -10.0, 10.0, 0.02),
                size("quadratic", "force s/coordinate", -10.0, 10.0, 0.02),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "free decays from several amplitudes about several positions"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for StrokeDamping {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + at.xi * (v[0] + v[1] * at.xi) * at.rate;
    }
}
