//! Softening with history:  the spring's force times 1 - r (1 - e^(-(d_max - d)/m)), d = |x - c| and d_max the
//! largest so far. A recording of an axis may begin anywhere, so where its spring is not strained, c, is to be
//! found; those of coupons and flexures are not strained at rest.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct Softening;

impl LineEffect for Softening {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        let [low, high] = view.range();
        let mut centres = vec![0.0];
        if view.straight {
            centres.push(0.5 * (low + high));
        }
        let starts = |c: f64| [0.05, 0.2, 0.6].map(|x| vec![vec![0.02, x, c]]);
        centres.into_iter().flat_map(starts).collect()
    }
    fn held(&self, _: &[f64]) -> Option<Quantity> {
        Some(shape("largest_before", "coordinate", 0.0, 0.0, 1.0, 0.5))
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
    fn equation(&self) -> &'static str {
        "the spring's force times 1 - softening (1 - e^(-(d_max - d)/scale)), d = |x - centre| (of coupons and flexures |x|), d_max the largest d so far"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("softening", "1", 0.0, 0.9, 0.15),
                shape("scale", "coordinate", 0.2, 0.01, 1.5, 0.2),
                shape("centre", "coordinate", 0.0, -1.0, 1.0, 0.2),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "a staircase of amplitudes, each repeated"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Softening {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        let strain = match at.straight {
            true => at.xi - v[2],
            false => at.xi,
        };
        state.state = state.state.max(strain.abs());
        let below = (strain.abs() - state.state) / v[1];
        let lost = v[0] * (R::of(1.0) - below.exp());
        if at.straight {
            // its force is one from where it is not strained, not from rest
            point.xi = point.xi - lost * strain;
        } else {
            point.factor[0] = point.factor[0] * (R::of(1.0) - lost);
        }
    }
}
