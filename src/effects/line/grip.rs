//! A wrong gauge length:  the film sees 1 + (lambda - 1)(1 - s).

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct Grip;

impl LineEffect for Grip {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.02]]]
    }
}

impl Effect for Grip {
    fn id(&self) -> &'static str {
        "x_grip_slip"
    }
    fn says(&self) -> &'static str {
        "the film between the grips stretches by another amount than the crosshead says"
    }
    fn source(&self) -> &'static str {
        "gauge length that is not the stated one, or grips that slip"
    }
    fn equation(&self) -> &'static str {
        "x -> x (1 - share)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("share", "1", -0.5, 0.5, 0.05)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "two gauge lengths, or marks on the film"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        for x in &mut terms.xi {
            *x *= 1.0 - v[0];
        }
    }
}
