//! Dry friction with presliding:  z follows the direction over the distance x0, dz = (sign(dx) - z)(1 -
//! e^(-|dx|/x0)), force F z.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along, slid};
use super::{Kind, LineEffect, Terms, View};

pub struct Friction;

impl LineEffect for Friction {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [0.01, 0.05, 0.2]
            .iter()
            .map(|&x| vec![vec![0.02, x]])
            .collect()
    }
}

impl Effect for Friction {
    fn id(&self) -> &'static str {
        "joint_friction"
    }
    fn says(&self) -> &'static str {
        "dry friction resists the motion, whatever its rate"
    }
    fn source(&self) -> &'static str {
        "Dahl 1968, presliding"
    }
    fn equation(&self) -> &'static str {
        "f -> f + force z, dz = (sign(dx) - z)(1 - e^(-|dx|/presliding))"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("force", "force", 0.0, 1.0, 0.05),
                shape("presliding", "coordinate", 0.03, 1e-3, 0.5, 0.03),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "slow triangles of several amplitudes"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Friction {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        state.state = slid(state.state, at.way, v[1]);
        point.force = point.force + v[0] * state.state;
    }
}
