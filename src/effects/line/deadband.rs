//! A dead band:  u = 0 below the threshold, u_c above it.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct Deadband;

impl LineEffect for Deadband {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [0.03, 0.1, 0.3].iter().map(|&x| vec![vec![x]]).collect()
    }
}

impl Effect for Deadband {
    fn id(&self) -> &'static str {
        "amplifier_deadband"
    }
    fn says(&self) -> &'static str {
        "below a threshold the input does nothing"
    }
    fn source(&self) -> &'static str {
        "dead zone"
    }
    fn equation(&self) -> &'static str {
        "u = u_c/(1 + e^(-(|u_c| - threshold)/w)), w = 0.05 threshold"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("threshold", "input", 0.0, 0.8, 0.05)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "a slow triangle through zero"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        let w = 0.05 * v[0] + 1e-9;
        for u in &mut terms.input {
            *u *= super::super::soft_step((u.abs() - v[0]) / w);
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        let w = 0.05 * v[0] + 1e-9;
        let made = |u: f64| u * super::super::soft_step((u - v[0]) / w);
        for (u, told) in undone.input.iter_mut().zip(&mut undone.told) {
            // rising from 0, and within the threshold of its own value
            let (mut low, mut high) = (0.0, u.abs() + v[0] + 20.0 * w);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if made(middle) < u.abs() {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            *told &= low >= v[0];
            *u = u.signum() * low;
        }
    }
}
