//! Viscous torque in the bicep joints:  -c theta_b'.

use super::{Along, Effect, Exercise, Quantity, Reach, Seen, Site, size};

pub struct JointDamping;

impl Effect for JointDamping {
    fn id(&self) -> &'static str {
        "joint_damping"
    }
    fn says(&self) -> &'static str {
        "the bicep joints resist in proportion to their rate"
    }
    fn source(&self) -> &'static str {
        "viscous friction"
    }
    fn equation(&self) -> &'static str {
        "torque on theta_b: -coefficient theta_b'"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "the fastest branch of the film",
            "series_resistance",
            "time_offset",
        ]
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("coefficient", "N m s/rad", 0.0, 2e-2, 5e-4)] }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1e-5]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "sines of one amplitude at rates up to above 2 Hz"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Rates, Exercise::Staircase]
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            *t -= v[0] * along.theta_b[i][1] / along.bicep_lever[i];
        }
    }
}
