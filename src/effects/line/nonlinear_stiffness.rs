//! A spring with two more terms:  force k2 x^2 + k3 x^3 (x over the largest excursion).

use super::super::{Effect, Quantity, size};
use super::law::{Forward, Law, Memory, Moment, Point, Real, along};
use super::{Kind, LineEffect, Terms, View};

pub struct NonlinearStiffness;

impl LineEffect for NonlinearStiffness {
    fn kinds(&self) -> &'static [Kind] {
        &[Kind::Axis]
    }
    fn near(&self, _: &View) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.0, 0.02], vec![0.02, 0.0]]]
    }
}

impl Effect for NonlinearStiffness {
    fn id(&self) -> &'static str {
        "x_nonlinear_stiffness"
    }
    fn says(&self) -> &'static str {
        "the spring is not linear: it stiffens or softens with the excursion"
    }
    fn source(&self) -> &'static str {
        "Duffing 1918"
    }
    fn equation(&self) -> &'static str {
        "f -> f + quadratic x^2 + cubic x^3"
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("quadratic", "force", -100.0, 100.0, 0.05),
                size("cubic", "force", -100.0, 100.0, 0.05),
            ]
        }
    }
    fn brought_out_by(&self) -> &'static str {
        "the same drive at several amplitudes"
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        along(self, v, view, terms);
    }
    fn law(&self) -> Option<&dyn Forward> {
        Some(self)
    }
}

impl Law for NonlinearStiffness {
    fn act<R: Real>(&self, v: &[R], at: &Moment<R>, _: &mut Memory<R>, point: &mut Point<R>) {
        point.force = point.force + at.xi * at.xi * (v[0] + v[1] * at.xi);
    }
}
