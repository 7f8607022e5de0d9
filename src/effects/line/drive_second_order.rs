//! A drive of second order that rings:  T^2 u'' + 2 z T u' + u = u_c, by the trapezoidal rule. One that does
//! not, z > 1, is a lag of two stages ([`super::drive_lag`]).

use super::super::{Effect, Quantity, shape, size};
use super::{Kind, LineEffect, Terms, View};

pub struct DriveSecondOrder;

impl LineEffect for DriveSecondOrder {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        [2.0, 8.0]
            .iter()
            .flat_map(|&x| [0.2, 0.7].map(|z| vec![vec![x * view.step_s, z]]))
            .collect()
    }
}

impl Effect for DriveSecondOrder {
    fn id(&self) -> &'static str {
        "x_drive_second_order"
    }
    fn says(&self) -> &'static str {
        "the drive follows its command as a damped second order: a compliance or a loop of its own lies between"
    }
    fn source(&self) -> &'static str {
        "an elastic transmission, or the velocity loop of a servo"
    }
    fn equation(&self) -> &'static str {
        "T^2 u'' + 2 z T u' + u = u_c, T = time_constant, z = damping_ratio"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("time_constant", "s", 0.0, 1.0, 0.01),
                shape("damping_ratio", "1", 0.7, 0.05, 1.0, 0.3),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "steps of the drive, and a sweep beyond its bandwidth"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        if v[0] <= 0.0 {
            return;
        }
        let (a, z) = (0.5 * terms.input_step_s / v[0], v[1]);
        let mut before = terms.input.first().copied().unwrap_or(0.0);
        let (mut q, mut s) = (before, 0.0);
        for u in &mut terms.input {
            let next = (s * (1.0 - a * a - 2.0 * z * a) + a * (before + *u - 2.0 * q))
                / (1.0 + a * a + 2.0 * z * a);
            q += a * (s + next);
            s = next;
            before = *u;
            *u = q;
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn passes(&self, v: &[f64], f_hz: f64) -> f64 {
        let w = std::f64::consts::TAU * f_hz * v[0];
        1.0 / (1.0 - w * w).hypot(2.0 * v[1] * w).max(f64::MIN_POSITIVE)
    }
    fn lags(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        undone.add_derivatives(2.0 * v[1] * v[0], v[0] * v[0]);
    }
}
