//! One more Maxwell branch:  force k (x - q), q' = (x - q)/T.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct Creep;

impl LineEffect for Creep {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        // where no time is known, rows are taken for it: what gives way slowly keeps a loop open, as friction does
        [0.01, 0.05, 0.3]
            .iter()
            .map(|&x| vec![vec![0.05, x * view.duration_s]])
            .collect()
    }
}

impl Effect for Creep {
    fn id(&self) -> &'static str {
        "slow_creep"
    }
    fn says(&self) -> &'static str {
        "a part of the resistance gives way slowly: creep that the plain model does not have"
    }
    fn source(&self) -> &'static str {
        "Maxwell branch"
    }
    fn equation(&self) -> &'static str {
        "f -> f + stiffness (x - q), q' = (x - q)/time_constant"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("stiffness", "force/coordinate", 0.0, 5.0, 0.1),
                shape("time_constant", "s", 10.0, 1e-3, 1e5, 20.0),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a step, a long hold, and a long rest"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Creep {
    fn begin<R: Real>(&self, xi: R) -> R {
        xi
    }
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        let share = R::of(1.0) - (R::of(-at.step_s) / v[1]).exp();
        let middle = R::of(0.5) * (at.xi + state.before);
        state.state = state.state + share * (middle - state.state);
        point.force = point.force + v[0] * (at.xi - state.state);
    }
}
