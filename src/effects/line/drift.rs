//! A modulus that drifts:  all springs times 1 + a d, where d goes to its end exponentially: from the
//! beginning of each recording (a motor that warms up, and cools between), or of the series. Where a spring is
//! not strained is not known of a rig but of a coupon: its force where the excursion is counted from drifts
//! along, its preload.

use super::super::{Effect, Quantity, shape, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct Drift;

/// What a drift goes along.
pub(super) const OVER: &[&str] = &["recording", "series"];
/// Times of a recording and of a series after which its drift is what its size says, s: the same of all
/// recordings, however long, for a longer one drifts further.
const TOLD_AT_S: [f64; 2] = [60.0, 600.0];

/// The place in [`OVER`], and how fast a drift goes to its end.
pub(super) const ALONG: Quantity = shape("over", "1", 0.0, 0.0, 1.0, 1.0);
pub(super) const TIME_CONSTANT: Quantity = shape("time_constant", "s", 600.0, 1.0, 1e6, 1000.0);

/// Whether a drift of `v` goes along the series.
pub(super) fn of_series(v: &[f64]) -> bool {
    v[0] != 0.0
}

/// Starts of a scan for a drift of `size` over a recording, or ten minutes of a series.
pub(super) fn near(size: f64, view: &View) -> Vec<Vec<Vec<f64>>> {
    let to_the_end = gone(view.duration_s, view.duration_s);
    let told = gone(TOLD_AT_S[0], view.duration_s);
    let mut out = vec![vec![vec![0.0, size * told / to_the_end, view.duration_s]]];
    if view.timed {
        out.extend([300.0, 3000.0].map(|t| vec![vec![1.0, size, t]]));
    }
    out
}

/// How much of a drift is there after a time, of all that there will be.
fn gone<R: Real>(time_s: f64, time_constant_s: R) -> R {
    R::of(1.0) - (R::of(-time_s) / time_constant_s).exp()
}

/// The drift of `v` at a moment, over what it is a minute into a recording that began with it, or ten into the
/// series. `before` is the share of its way that it had gone when the recording began.
pub(super) fn course<R: Real>(v: &[R], at: &Moment<R>, before: R) -> R {
    let to_go = R::of(1.0) - before;
    match v[0].value() {
        0.0 => (before + to_go * gone(at.since_s, v[2])) / gone(TOLD_AT_S[0], v[2]),
        _ => gone(at.series_s, v[2]) / gone(TOLD_AT_S[1], v[2]),
    }
}

/// The share of its way that a drift of `v` may have gone when a recording begins.
pub(super) fn gone_before(v: &[f64]) -> Option<Quantity> {
    (!of_series(v)).then(|| shape("gone_before", "1", 0.0, 0.0, 0.95, 0.25))
}

impl LineEffect for Drift {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Bench, Kind::Axis, Kind::Coupon]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        let mut out = near(0.02, view);
        out.iter_mut().flatten().for_each(|v| v.push(0.0));
        out
    }
    fn held(&self, v: &[f64]) -> Option<Quantity> {
        gone_before(v)
    }
}

impl Effect for Drift {
    fn id(&self) -> &'static str {
        "temperature_drift"
    }
    fn says(&self) -> &'static str {
        "the stiffness drifts, along each recording or over the series"
    }
    fn source(&self) -> &'static str {
        "drift of the modulus to another temperature"
    }
    fn equation(&self) -> &'static str {
        "f -> f + relative_change d (springs + preload), d = (1 - e^(-t/time_constant)) over its value after 60 s of the recording, or 600 s of the series"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                ALONG,
                size("relative_change", "1", -0.9, 0.9, 0.05),
                TIME_CONSTANT,
                shape("preload", "force", 0.0, -2.0, 2.0, 0.5),
            ]
        }
    }
    fn variants(&self) -> &'static [&'static str] {
        OVER
    }
    fn over_series(&self, v: &[f64]) -> bool {
        of_series(v)
    }
    fn brought_out_by(&self) -> &'static str {
        "the first test again as the last"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for Drift {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, state: &mut Memory<R>, point: &mut Point<R>) {
        // no drift turns a spring round
        let change = (v[1] * course(v, at, state.state)).max(R::of(-1.0));
        point.factor = point.factor.map(|f| f * (R::of(1.0) + change));
        if !at.unstrained {
            point.force = point.force + change * v[3];
        }
    }
}
