//! A power law of the drive:  u = sign(u_c) |u_c|^p (u over its largest value).

use super::super::{Effect, Quantity};
use super::{Kind, LineEffect, Terms, View};

pub struct DrivePower;

impl LineEffect for DrivePower {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1.2]]]
    }
}

impl Effect for DrivePower {
    fn id(&self) -> &'static str {
        "x_drive_power"
    }
    fn says(&self) -> &'static str {
        "the force follows a power of the input, not the input itself: an electrostatic drive pulls with its square"
    }
    fn source(&self) -> &'static str {
        "electrostatic force, E^2"
    }
    fn equation(&self) -> &'static str {
        "u = sign(u_c) |u_c|^exponent"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[Quantity {
                name: "exponent",
                unit: "1",
                off: 1.0,
                lower: 0.2,
                upper: 4.0,
                spread: 0.5,
                size: true,
            }]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "the same drive at several amplitudes, and of both signs"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        for u in &mut terms.input {
            *u = u.signum() * u.abs().powf(v[0]);
        }
    }
    fn drives(&self) -> bool {
        true
    }
    fn undo(&self, v: &[f64], undone: &mut super::Undone) {
        for u in &mut undone.input {
            *u = u.signum() * u.abs().powf(1.0 / v[0]);
        }
    }
}
