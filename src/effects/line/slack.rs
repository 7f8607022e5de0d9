//! A wrong zero:  the film sees lambda - d.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct Slack;

impl LineEffect for Slack {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.005]], vec![vec![-0.005]]]
    }
}

impl Effect for Slack {
    fn id(&self) -> &'static str {
        "x_slack"
    }
    fn says(&self) -> &'static str {
        "the stretch is counted from another length: the sample was slack or pre-stretched when it was clamped"
    }
    fn source(&self) -> &'static str {
        "zero of the stretch"
    }
    fn equation(&self) -> &'static str {
        "x -> x - stretch"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("stretch", "coordinate", -0.3, 0.3, 0.01)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "a test that begins well before the force does"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        for x in &mut terms.xi {
            *x -= v[0];
        }
    }
}
