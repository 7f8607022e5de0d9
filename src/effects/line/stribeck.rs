//! Friction that is larger at low speed, with presliding:  force F z e^(-(v/vs)^2), z as in dry friction.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along, slid};
use super::{Kind, LineEffect, Terms, View};

pub struct Stribeck;

impl LineEffect for Stribeck {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        [0.1, 1.0, 10.0]
            .iter()
            .map(|&x| vec![vec![0.02, x * view.speed, 0.01]])
            .collect()
    }
}

impl Effect for Stribeck {
    fn id(&self) -> &'static str {
        "x_stribeck"
    }
    fn says(&self) -> &'static str {
        "friction that falls as the motion gets faster"
    }
    fn source(&self) -> &'static str {
        "Stribeck 1902, exponential form; Dahl's presliding"
    }
    fn equation(&self) -> &'static str {
        "f -> f + force z e^(-(v/speed)^2), dz = (sign(dx) - z)(1 - e^(-|dx|/presliding))"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("force", "force", 0.0, 1.0, 0.05),
                shape("speed", "coordinate/s", 0.3, 1e-3, 1e3, 0.5),
                shape("presliding", "coordinate", 0.01, 1e-3, 0.5, 0.02),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "constant speeds from creeping to fast"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Stribeck {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        state.state = slid(state.state, at.way, v[2]);
        let fast = at.rate / v[1];
        point.force = point.force + v[0] * state.state * (-(fast * fast)).exp();
    }
}
