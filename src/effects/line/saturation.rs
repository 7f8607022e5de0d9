//! A ceiling:  u = sign(u_c) (u_c - w ln(1 + e^((|u_c| - c)/w))), w = 2 % of the ceiling.

use super::super::{Effect, Quantity};
use super::{Kind, LineEffect, Terms, View};

pub struct Saturation;

/// Share of the bend's full height from which on the slope is below a twentieth: there it says "at least".
const SAYS_NOTHING: f64 = 0.95;

impl LineEffect for Saturation {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [0.6, 0.8, 0.95].iter().map(|&x| vec![vec![x]]).collect()
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
        "u = sign(u_c) (|u_c| - w ln(1 + e^((|u_c| - ceiling)/w))), w = 0.02 ceiling"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[Quantity {
                name: "ceiling",
                unit: "input",
                off: f64::INFINITY,
                lower: 0.1,
                upper: 1.2,
                spread: 0.1,
                size: true,
            }]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a slow ramp to the largest input"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        let w = 0.02 * v[0];
        for u in &mut terms.input {
            *u = u.signum() * (u.abs() - w * super::super::soft_plus((u.abs() - v[0]) / w));
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        let w = 0.02 * v[0];
        for (u, told) in undone.input.iter_mut().zip(&mut undone.told) {
            let q = ((u.abs() - v[0]) / w).exp();
            if q > SAYS_NOTHING {
                *told = false;
                *u = u.signum() * v[0];
            } else {
                *u = u.signum() * (u.abs() - w * (1.0 - q).ln());
            }
        }
    }
}
