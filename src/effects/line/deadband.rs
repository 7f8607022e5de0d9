//! A dead band:  u = 0 below the threshold; above it u_c less the share of the threshold that is taken off
//! (0: none, a gate; 1: all, a dead zone).

use super::super::{Effect, Quantity, shape, size};
use super::{Kind, LineEffect, Terms, View};

pub struct Deadband;

/// Half width of the edge.
fn width(v: &[f64]) -> f64 {
    0.05 * v[0] + 1e-9
}

/// What arrives of a magnitude.
fn made(u: f64, v: &[f64]) -> f64 {
    (u - v[1] * v[0]).max(0.0) * super::super::soft_step((u - v[0]) / width(v))
}

impl LineEffect for Deadband {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        let each = |&x: &f64| [0.0, 1.0].map(|taken_off| vec![vec![x, taken_off]]);
        [0.03, 0.1, 0.3].iter().flat_map(each).collect()
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
        "u = (u_c - taken_off threshold sign(u_c))/(1 + e^(-(|u_c| - threshold)/w)), w = 0.05 threshold"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("threshold", "input", 0.0, 0.8, 0.05),
                shape("taken_off", "1", 0.0, 0.0, 1.0, 0.5),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a slow triangle through zero"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        for u in &mut terms.input {
            *u = u.signum() * made(u.abs(), v);
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        let noise = undone.noise;
        for (u, told) in undone.input.iter_mut().zip(&mut undone.told) {
            // what is no more than noise may come from either side of the threshold, or from within
            *told &= u.abs() > 3.0 * noise;
            // rising from 0, and within the threshold of its own value
            let (mut low, mut high) = (0.0, u.abs() + 2.0 * v[0] + 20.0 * width(v));
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if made(middle, v) < u.abs() {
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
