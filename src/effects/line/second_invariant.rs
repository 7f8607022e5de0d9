//! The Mooney term:  stress 2 C2 (lambda_2^2 - lambda_1^-2 lambda_2^-2 ... ) per mode; uniaxial 2 C2 (1 -
//! lambda^-3).

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct SecondInvariant;

impl LineEffect for SecondInvariant {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.05]]]
    }
}

impl Effect for SecondInvariant {
    fn id(&self) -> &'static str {
        "x_second_invariant"
    }
    fn says(&self) -> &'static str {
        "the elastic energy depends on the second invariant as well"
    }
    fn source(&self) -> &'static str {
        "Mooney 1940, Rivlin 1948"
    }
    fn equation(&self) -> &'static str {
        "f -> f + modulus s, s = 2 (lambda_3^-2 - lambda_1^-2)/lambda_1"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("modulus", "force", -1.0, 1.0, 0.1)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "uniaxial and equibiaxial tests of one film"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        for (f, s) in terms.force.iter_mut().zip(view.second) {
            *f += v[0] * s;
        }
    }
}
