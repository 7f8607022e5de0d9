//! Play of half-width g:  the spring sees s with |x - s| <= g, moved only where x pushes it.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct Backlash;

impl LineEffect for Backlash {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [0.01, 0.05].iter().map(|&x| vec![vec![x]]).collect()
    }
}

impl Effect for Backlash {
    fn id(&self) -> &'static str {
        "x_backlash"
    }
    fn says(&self) -> &'static str {
        "play between the measured coordinate and the spring"
    }
    fn source(&self) -> &'static str {
        "play operator"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("gap", "coordinate", 0.0, 0.6, 0.02)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "reversals without and with a pre-load"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        let mut s = view.xi.first().copied().unwrap_or(0.0);
        for (out, x) in terms.xi.iter_mut().zip(view.xi) {
            s = s.max(x - v[0]).min(x + v[0]);
            *out += s - x;
        }
    }
}
