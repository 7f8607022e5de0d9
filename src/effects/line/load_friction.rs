//! Friction that grows with the load:  force c |elastic force + preload| z, z as in dry friction with
//! presliding. Where a rig is without load is not known of it: its excursions are counted from a rest, which
//! may be an end of the motion.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along, slid};
use super::{Kind, LineEffect, Terms, View};

pub struct LoadFriction;

impl LineEffect for LoadFriction {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        let starts = [(0.02, 0.0), (0.1, 0.0), (0.3, 0.0), (0.1, 0.5), (0.1, -0.5)];
        starts.map(|(x, p)| vec![vec![0.02, x, p]]).to_vec()
    }
}

impl Effect for LoadFriction {
    fn id(&self) -> &'static str {
        "x_load_friction"
    }
    fn says(&self) -> &'static str {
        "friction in proportion to the elastic load: layers or cables that press harder rub harder"
    }
    fn source(&self) -> &'static str {
        "Coulomb's law on a loaded contact; Dahl's presliding"
    }
    fn equation(&self) -> &'static str {
        "f -> f + coefficient |f_elastic + preload| z, dz = (sign(dx) - z)(1 - e^(-|dx|/presliding))"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("coefficient", "1", 0.0, 1.0, 0.05),
                shape("presliding", "coordinate", 0.05, 1e-3, 0.6, 0.05),
                shape("preload", "force", 0.0, -1.0, 1.0, 0.5),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "loops of several amplitudes about several mean loads"
    }
    fn sees_elastic(&self) -> bool {
        true
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for LoadFriction {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        state.state = slid(state.state, at.way, v[1]);
        point.force = point.force + v[0] * (at.elastic + v[2]).abs() * state.state;
    }
}
