//! The moduli drift over minutes:  mu -> mu (1 + a (1 - e^(-t/T)) + b (1 - e^(-4 t/T))), t over the series; T
//! stays at what warming up takes, because the data leave it open beside a and b.

use super::{Along, Effect, Exercise, Part, Quantity, Reach, Seen, Site, shape, size};
use crate::film::Film;

pub struct TemperatureDrift;

impl Effect for TemperatureDrift {
    fn id(&self) -> &'static str {
        "temperature_drift"
    }
    fn says(&self) -> &'static str {
        "the film's stiffness drifts over the series, as with its temperature"
    }
    fn source(&self) -> &'static str {
        "thermal relaxation of the surroundings, two rates"
    }
    fn equation(&self) -> &'static str {
        "mu -> mu (1 + relative_change (1 - e^(-t/T)) + early_change (1 - e^(-4 t/T))), T = \
         time_constant, t over the series"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["slow_creep", "mullins_softening"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("relative_change", "1", -0.6, 0.6, 0.1),
                size("early_change", "1", -0.6, 0.6, 0.1),
                shape("time_constant", "s", 400.0, 400.0, 400.0, 1.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Film
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.01, 0.0, 400.0], vec![0.0, 0.01, 400.0]]]
    }
    fn over_series(&self, _: &[f64]) -> bool {
        true
    }
    fn brought_out_by(&self) -> &'static str {
        "the first recording repeated at the end"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Again, Exercise::Staircase]
    }
    fn stress(&self, v: &[f64], along: &Along, _: &Film, factor: &mut [[f64; 2]]) {
        for (i, f) in factor.iter_mut().enumerate() {
            let t = (along.when.series_s + along.step_s * i as f64) / v[2];
            let change = v[0] * (1.0 - (-t).exp()) + v[1] * (1.0 - (-4.0 * t).exp());
            f[0] *= 1.0 + change;
            f[1] *= 1.0 + change;
        }
    }
}
