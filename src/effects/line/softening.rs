//! Softening with history:  the spring's force times 1 - r (1 - e^(-(x_max - |x|)/m)), x_max the largest |x|
//! so far.

use super::super::{Effect, Quantity, shape, size};
use super::{Kind, LineEffect, Terms, View};

pub struct Softening;

impl LineEffect for Softening {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        [0.05, 0.2, 0.6]
            .iter()
            .map(|&x| vec![vec![0.02, x]])
            .collect()
    }
}

impl Effect for Softening {
    fn id(&self) -> &'static str {
        "mullins_softening"
    }
    fn says(&self) -> &'static str {
        "softer below the largest excursion so far"
    }
    fn source(&self) -> &'static str {
        "Ogden and Roxburgh 1999, pseudo-elasticity, over the excursion"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("softening", "1", 0.0, 0.9, 0.15),
                shape("scale", "coordinate", 0.2, 0.01, 1.5, 0.2),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a staircase of amplitudes, each repeated"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        let mut largest = 0.0_f64;
        for (f, x) in terms.factor.iter_mut().zip(view.xi) {
            largest = largest.max(x.abs());
            f[0] *= 1.0 - v[0] * (1.0 - (-(largest - x.abs()) / v[1]).exp());
        }
    }
}
