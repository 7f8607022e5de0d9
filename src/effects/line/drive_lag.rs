//! A lag of the drive in one stage or two:  tau q' = u_c - q,  second_stage tau u' = q - u.

use super::super::{Effect, Quantity, shape, size};
use super::{Kind, LineEffect, Terms, View};

pub struct DriveLag;

/// Time constants of both stages, s.
fn stages(v: &[f64]) -> [f64; 2] {
    [v[0], v[0] * v[1]]
}

/// Sends the input through a stage; exact where it is straight from sample to sample.
fn lag(tau_s: f64, terms: &mut Terms) {
    if tau_s <= 0.0 {
        return;
    }
    let steps = terms.input_step_s / tau_s;
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

impl LineEffect for DriveLag {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        [1.0, 5.0]
            .iter()
            .map(|&x| vec![vec![x * view.step_s, 0.0]])
            .collect()
    }
}

impl Effect for DriveLag {
    fn id(&self) -> &'static str {
        "x_drive_lag"
    }
    fn says(&self) -> &'static str {
        "the drive follows its command late and does not ring: a lag of one stage, or of two"
    }
    fn source(&self) -> &'static str {
        "series resistance into a capacitance, alone or spread along an electrode, or an amplifier's bandwidth"
    }
    fn equation(&self) -> &'static str {
        "time_constant q' = u_c - q, second_stage time_constant u' = q - u"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("time_constant", "s", 0.0, 10.0, 0.02),
                shape("second_stage", "1", 0.0, 0.0, 1.0, 0.2),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a fast and a slow drive"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        for tau_s in stages(v) {
            lag(tau_s, terms);
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn passes(&self, v: &[f64], f_hz: f64) -> f64 {
        let passed = |tau_s: f64| 1.0 / (std::f64::consts::TAU * f_hz * tau_s).hypot(1.0);
        stages(v).map(passed).iter().product()
    }
    fn lags(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        let [first, second] = stages(v);
        undone.add_derivatives(first + second, first * second);
    }
}
