//! A clock offset:  the input is read at t + offset.

use super::super::{Effect, Quantity, size};
use super::{Kind, LineEffect, Terms, View};

pub struct ClockOffset;

pub(super) const ID: &str = "time_offset";

impl LineEffect for ClockOffset {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, view: &View) -> Vec<Vec<Vec<f64>>> {
        [1.0, -1.0]
            .iter()
            .map(|&x| vec![vec![x * view.step_s]])
            .collect()
    }
}

impl Effect for ClockOffset {
    fn id(&self) -> &'static str {
        ID
    }
    fn says(&self) -> &'static str {
        "the clocks of input and motion differ by a constant"
    }
    fn source(&self) -> &'static str {
        "clock model"
    }
    fn equation(&self) -> &'static str {
        "u_c is read at t + offset"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("offset", "s", -1.0, 1.0, 0.01)] }
    }
    fn brought_out_by(&self) -> &'static str {
        "a drive with steps"
    }
    fn line(&self, v: &[f64], _: &View, terms: &mut Terms) {
        terms.shift_s += v[0];
    }
}
