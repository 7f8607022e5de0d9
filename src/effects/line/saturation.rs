//! A ceiling:  u = sign(u_c) (|u_c| - w ln((1 + e^((|u_c| - c)/w))/(1 + e^(-c/w)))), w the width of its knee: an
//! amplifier clips sharply, a coil's iron saturates softly.

use super::super::{Effect, Quantity, shape, soft_plus};
use super::{Kind, LineEffect, Terms, View};

pub struct Saturation;

/// Share of the bend's full height from which on the slope is below a twentieth: there it says "at least".
const SAYS_NOTHING: f64 = 0.95;

/// Width of the knee, and its bend where nothing is asked.
fn knee(v: &[f64]) -> (f64, f64) {
    let w = v[1] * v[0];
    (w, soft_plus(-v[0] / w))
}

impl LineEffect for Saturation {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [[0.6, 0.02], [0.8, 0.02], [0.95, 0.02], [0.7, 0.15]]
            .map(|x| vec![x.to_vec()])
            .to_vec()
    }
}

impl Effect for Saturation {
    fn id(&self) -> &'static str {
        "amplifier_saturation"
    }
    fn says(&self) -> &'static str {
        "the input does not exceed a ceiling"
    }
    fn source(&self) -> &'static str {
        "soft saturation"
    }
    fn equation(&self) -> &'static str {
        "u = sign(u_c) (|u_c| - w ln((1 + e^((|u_c| - ceiling)/w))/(1 + e^(-ceiling/w)))), w = knee ceiling"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                Quantity {
                    name: "ceiling",
                    unit: "input",
                    off: f64::INFINITY,
                    lower: 0.1,
                    upper: 1.2,
                    spread: 0.1,
                    size: true,
                },
                shape("knee", "1", 0.02, 0.02, 0.5, 0.1),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a slow ramp to the largest input"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        if v[0].is_infinite() {
            return;
        }
        let (w, at_rest) = knee(v);
        for u in &mut terms.input {
            let bend = soft_plus((u.abs() - v[0]) / w) - at_rest;
            *u = u.signum() * (u.abs() - w * bend);
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        let (w, at_rest) = knee(v);
        for (u, told) in undone.input.iter_mut().zip(&mut undone.told) {
            let passed = u.abs() - w * at_rest;
            let q = ((passed - v[0]) / w).exp();
            if q > SAYS_NOTHING {
                *told = false;
                *u = u.signum() * v[0];
            } else {
                *u = u.signum() * (passed - w * (1.0 - q).ln());
            }
        }
    }
}
