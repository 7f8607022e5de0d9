//! A drive that is no straight line:  u = u_c ((u_c^2 + k^2)/(1 + k^2))^((p - 1)/2), u over its largest value:
//! the power p far above k, straight below it.

use super::super::{Effect, Quantity, shape};
use super::{Kind, LineEffect, Terms, View};

pub struct DrivePower;

/// Most steps of Newton by which a drive is undone.
const STEPS: usize = 60;

/// What comes of an input without sign, and its slope.
fn bent(u: f64, v: &[f64]) -> [f64; 2] {
    let (p, k2) = (v[0], v[1] * v[1]);
    if u == 0.0 && k2 == 0.0 {
        return [0.0, 0.0];
    }
    let square = u * u + k2;
    let factor = (square / (1.0 + k2)).powf(0.5 * (p - 1.0));
    [u * factor, factor * (p * u * u + k2) / square]
}

impl LineEffect for DrivePower {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1.2, 0.0]], vec![vec![1.2, 0.5]]]
    }
}

impl Effect for DrivePower {
    fn id(&self) -> &'static str {
        "x_drive_power"
    }
    fn says(&self) -> &'static str {
        "the force is no straight line of the input: an electrostatic drive pulls with its square, an iron core saturates"
    }
    fn source(&self) -> &'static str {
        "electrostatic force, E^2; a magnetisation that levels off"
    }
    fn equation(&self) -> &'static str {
        "u = u_c ((u_c^2 + straight_below^2)/(1 + straight_below^2))^((exponent - 1)/2)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                Quantity {
                    name: "exponent",
                    unit: "1",
                    off: 1.0,
                    lower: 0.2,
                    upper: 4.0,
                    spread: 0.5,
                    size: true,
                },
                shape("straight_below", "input", 0.0, 0.0, 2.0, 0.5),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "the same drive at several amplitudes, and of both signs"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        for u in &mut terms.input {
            *u = u.signum() * bent(u.abs(), v)[0];
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        for u in &mut undone.input {
            let wanted = u.abs();
            if wanted == 0.0 {
                continue;
            }
            // in logarithms the slope is between 1 and the exponent, and each step lands nearer
            let mut at = wanted.ln();
            for _ in 0..STEPS {
                let [made, slope] = bent(at.exp(), v);
                let step = (wanted / made).ln() / (slope * at.exp() / made);
                at += step;
                if step.abs() < 1e-12 {
                    break;
                }
            }
            *u = u.signum() * at.exp();
        }
    }
}
