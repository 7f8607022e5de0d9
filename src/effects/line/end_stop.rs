//! A stop:  force k max(x - x0, 0) where x0 > 0, k min(x - x0, 0) where x0 < 0.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct EndStop;

impl LineEffect for EndStop {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [-0.6, 0.6, 0.8, 0.95]
            .iter()
            .map(|&x| vec![vec![0.2, x]])
            .collect()
    }
}

impl Effect for EndStop {
    fn id(&self) -> &'static str {
        "end_stop"
    }
    fn says(&self) -> &'static str {
        "a stop pushes back beyond one position"
    }
    fn source(&self) -> &'static str {
        "one-sided linear contact"
    }
    fn equation(&self) -> &'static str {
        "f -> f + stiffness max(x - stop, 0), where stop < 0: min(x - stop, 0)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("stiffness", "force/coordinate", 0.0, 100.0, 1.0),
                shape("stop", "coordinate", 0.85, -1.0, 1.0, 0.1),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "strokes that end before it and at it"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for EndStop {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        let into = if v[1].value() >= 0.0 {
            (at.xi - v[1]).max(R::of(0.0))
        } else {
            (at.xi - v[1]).min(R::of(0.0))
        };
        point.force = point.force + v[0] * into;
    }
}
