//! A modulus that drifts:  all springs times 1 + a t over the recording's length.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct Drift;

impl LineEffect for Drift {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.02]]]
    }
}

impl Effect for Drift {
    fn id(&self) -> &'static str {
        "temperature_drift"
    }
    fn says(&self) -> &'static str {
        "the stiffness drifts along the recording"
    }
    fn source(&self) -> &'static str {
        "linear drift of the modulus"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("relative_change", "1", -0.5, 0.5, 0.05)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "the first test again as the last"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        let (first, span) = (view.time_s.first().copied().unwrap_or(0.0), view.duration_s);
        for (f, t) in terms.factor.iter_mut().zip(view.time_s) {
            let g = 1.0 + v[0] * (t - first) / span;
            f[0] *= g;
            f[1] *= g;
        }
    }
}
