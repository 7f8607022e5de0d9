//! A drive whose pull changes with the stroke:  u e^(-a x - b x^2) (x over the largest excursion).

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct DriveStroke;

impl LineEffect for DriveStroke {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.1, 0.0], vec![0.0, 0.1]]]
    }
}

impl Effect for DriveStroke {
    fn id(&self) -> &'static str {
        "x_drive_stroke"
    }
    fn says(&self) -> &'static str {
        "the pull of the drive changes with the stroke: electrodes that have zipped leave less to close, a magnet pulls harder the nearer, a coil leaves its gap to either side"
    }
    fn source(&self) -> &'static str {
        "virtual work of a capacitance that is no straight line over the stroke: 1/2 u^2 dC/dx"
    }
    fn equation(&self) -> &'static str {
        "u = u_c e^(-decay x - curvature x^2)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("decay", "1", -5.0, 5.0, 0.5),
                size("curvature", "1", -5.0, 5.0, 0.5),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "the same drive against several loads, so that one voltage meets several positions"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
    fn drives(&self) -> bool {
        true
    }
}

impl Law for DriveStroke {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.gain = point.gain * (-at.xi * (v[0] + v[1] * at.xi)).exp();
    }
}
