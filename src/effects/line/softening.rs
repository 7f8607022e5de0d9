//! Softening with history:  the spring's force times 1 - r (1 - e^(-(x_max - |x|)/m)), x_max the largest |x|
//! so far.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct Softening;

impl LineEffect for Softening {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [0.05, 0.2, 0.6]
            .iter()
            .map(|&x| vec![vec![0.02, x]])
            .collect()
    }
}

impl Effect for Softening {
    fn id(&self) -> &'static str {
        "mullins_softening"
    }
    fn says(&self) -> &'static str {
        "softer below the largest excursion so far"
    }
    fn source(&self) -> &'static str {
        "Ogden and Roxburgh 1999, pseudo-elasticity, over the excursion"
    }
    fn equation(&self) -> &'static str {
        "the spring's force times 1 - softening (1 - e^(-(x_max - |x|)/scale)), x_max the largest \
         |x| so far"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("softening", "1", 0.0, 0.9, 0.15),
                shape("scale", "coordinate", 0.2, 0.01, 1.5, 0.2),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a staircase of amplitudes, each repeated"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Softening {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        state.state = state.state.max(at.xi.abs());
        let below = (at.xi.abs() - state.state) / v[1];
        point.factor[0] = point.factor[0] * (R::of(1.0) - v[0] * (R::of(1.0) - below.exp()));
    }
}
