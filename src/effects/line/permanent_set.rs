//! Permanent set:  the spring sees x - s x_max, x_max the largest x so far.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct PermanentSet;

impl LineEffect for PermanentSet {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis, Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.02]]]
    }
}

impl Effect for PermanentSet {
    fn id(&self) -> &'static str {
        "x_permanent_set"
    }
    fn says(&self) -> &'static str {
        "it does not come back: rest moves by a share of the largest excursion"
    }
    fn source(&self) -> &'static str {
        "permanent set of an elastomer"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("share", "1", 0.0, 0.5, 0.03)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "a rest after each amplitude of a staircase"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        let mut largest = 0.0_f64;
        for (out, x) in terms.xi.iter_mut().zip(view.xi) {
            largest = largest.max(*x);
            *out -= v[0] * largest;
        }
    }
}
