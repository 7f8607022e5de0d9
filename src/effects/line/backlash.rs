//! Play of half-width g:  the spring sees s with |x - s| <= g, moved only where x pushes it.

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct Backlash;

impl LineEffect for Backlash {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [0.01, 0.05].iter().map(|&x| vec![vec![x]]).collect()
    }
}

impl Effect for Backlash {
    fn id(&self) -> &'static str {
        "x_backlash"
    }
    fn says(&self) -> &'static str {
        "play between the measured coordinate and the spring"
    }
    fn source(&self) -> &'static str {
        "play operator"
    }
    fn equation(&self) -> &'static str {
        "x -> s, s moves only where |x - s| would exceed gap"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("gap", "coordinate", 0.0, 0.6, 0.02)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "reversals without and with a pre-load"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Backlash {
    fn begin<R: Real>(&self, xi: R) -> R {
        xi
    }
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        state.state = state.state.max(at.xi - v[0]).min(at.xi + v[0]);
        point.xi = point.xi + (state.state - at.xi);
    }
}
