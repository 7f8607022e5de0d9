//! A stop:  force k d max(1 + loss |d|', 0) with d = max(x - x0, 0) of one above the motion, min(x - x0, 0) of
//! one below; where rest lies between them is for each rig to say.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct EndStop;

/// Places in [`EndStop::variants`].
const ABOVE: f64 = 0.0;
const BELOW: f64 = 1.0;

impl LineEffect for EndStop {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        let [low, high] = view.range();
        let reach = high - low;
        let inside = [0.6, 0.75, 0.9, 0.97].map(|share| share * reach);
        // a recording of a large swing makes stops of the others lie near its middle
        let above = inside.map(|x| low + x).into_iter().chain([0.15, 0.3, 0.95]);
        let below = inside.map(|x| high - x).into_iter().chain([-0.3, -0.6]);
        let start = |side: f64, x: f64| vec![vec![side, 0.2, x, 0.0]];
        (above.map(|x| start(ABOVE, x)))
            .chain(below.map(|x| start(BELOW, x)))
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
        "f -> f + stiffness d max(1 + loss d|d|/dt, 0), d = max(x - stop, 0), of a stop below min(x - stop, 0)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                shape("side", "1", 0.0, 0.0, 1.0, 1.0),
                size("stiffness", "force/coordinate", 0.0, 100.0, 1.0),
                shape("stop", "coordinate", 0.85, -1.0, 1.0, 0.1),
                shape("loss", "s/coordinate", 0.0, 0.0, 10.0, 0.1),
            ]
        }
    }
    fn variants(&self) -> &'static [&'static str] {
        &["above", "below"]
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
        let (into, going) = if v[0].value() == ABOVE {
            ((at.xi - v[2]).max(zero), at.rate)
        } else {
            ((at.xi - v[2]).min(zero), -at.rate)
        };
        let loss = (R::of(1.0) + v[3] * going).max(zero);
        point.force = point.force + v[1] * into * loss;
    }
}
