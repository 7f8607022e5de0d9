//! A first-order lag of the drive:  tau u' = u_c - u.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct DriveLag;

impl LineEffect for DriveLag {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        [1.0, 5.0]
            .iter()
            .map(|&x| vec![vec![x * view.step_s]])
            .collect()
    }
}

impl Effect for DriveLag {
    fn id(&self) -> &'static str {
        "x_drive_lag"
    }
    fn says(&self) -> &'static str {
        "the drive follows its command late, as a first-order lag"
    }
    fn source(&self) -> &'static str {
        "series resistance into a capacitance, or an amplifier's bandwidth"
    }
    fn equation(&self) -> &'static str {
        "time_constant u' = u_c - u"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("time_constant", "s", 0.0, 10.0, 0.02)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "a fast and a slow drive"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        if v[0] <= 0.0 {
            return;
        }
        // exact where the command is straight from sample to sample
        let steps = terms.input_step_s / v[0];
        let stays = (-steps).exp();
        let mean = (1.0 - stays) / steps;
        let mut u = terms.input.first().copied().unwrap_or(0.0);
        let mut before = u;
        for x in &mut terms.input {
            u = stays * u + (mean - stays) * before + (1.0 - mean) * *x;
            before = *x;
            *x = u;
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn passes(&self, v: &[f64], f_hz: f64) -> f64 {
        1.0 / (std::f64::consts::TAU * f_hz * v[0]).hypot(1.0)
    }
    fn lags(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        undone.add_derivatives(v[0], 0.0);
    }
}
