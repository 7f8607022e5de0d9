//! A stop:  force k d max(1 + loss d', 0) with d = max(x - x0, 0) where x0 > 0, min(x - x0, 0) where x0 < 0; of
//! d' only how fast it goes in or out counts.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct EndStop;

impl LineEffect for EndStop {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        // one recording of a large swing makes stops of the others lie near its middle
        [-0.6, -0.3, 0.15, 0.3, 0.6, 0.8, 0.95]
            .iter()
            .map(|&x| vec![vec![0.2, x, 0.0]])
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
        "one-sided linear contact with a loss in proportion to its depth (Hunt and Crossley 1975)"
    }
    fn equation(&self) -> &'static str {
        "f -> f + stiffness d max(1 + loss d|x|/dt, 0), d = max(x - stop, 0), where stop < 0: min"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("stiffness", "force/coordinate", 0.0, 100.0, 1.0),
                shape("stop", "coordinate", 0.85, -1.0, 1.0, 0.1),
                shape("loss", "s/coordinate", 0.0, 0.0, 10.0, 0.1),
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
        let zero = R::of(0.0);
        let (into, going) = if v[1].value() >= 0.0 {
            ((at.xi - v[1]).max(zero), at.rate)
        } else {
            ((at.xi - v[1]).min(zero), -at.rate)
        };
        let loss = (R::of(1.0) + v[2] * going).max(zero);
        point.force = point.force + v[0] * into * loss;
    }
}
