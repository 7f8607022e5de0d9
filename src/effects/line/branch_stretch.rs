//! Branches whose stress is multiplied by 1 + a x, x the strain over the largest one.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct BranchStretch;

impl LineEffect for BranchStretch {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.1]]]
    }
}

impl Effect for BranchStretch {
    fn id(&self) -> &'static str {
        "x_nonlinear_relaxation"
    }
    fn says(&self) -> &'static str {
        "the viscous part grows or fades with the stretch: relaxation depends on the strain"
    }
    fn source(&self) -> &'static str {
        "strain-dependent branch modulus"
    }
    fn equation(&self) -> &'static str {
        "stress of the branches times max(1 + slope x, 0)"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("slope", "1", -0.95, 5.0, 0.3)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "relaxation tests at several stretches"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        for (f, x) in terms.factor.iter_mut().zip(view.xi) {
            f[1] *= (1.0 + v[0] * x).max(0.0);
        }
    }
}
