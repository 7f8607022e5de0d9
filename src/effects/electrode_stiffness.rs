//! The electrode is an elastic layer, stress-free in the state in which it was painted (lambda_1 = 1.5,
//! lambda_2 = 1.5^-1/2): sigma_i = mu (A_i - C),  A_i = (lambda_i/lambda_i0)^2,  C = 1/(A_1 A_2); torque V
//! sum sigma_i d ln lambda_i/d theta.

use super::{Along, Effect, Part, Quantity, Reach, Seen, Site, size};

pub struct ElectrodeStiffness;

/// Stretches in which electrodes are painted in the robot.
const PAINTED: [f64; 2] = [1.5, 0.816_496_580_927_726];

impl Effect for ElectrodeStiffness {
    fn id(&self) -> &'static str {
        "electrode_stiffness"
    }
    fn says(&self) -> &'static str {
        "the electrode layer is elastic and pulls the film back to the state in which it was painted"
    }
    fn source(&self) -> &'static str {
        "neo-Hookean layer with its own stress-free state"
    }
    fn equation(&self) -> &'static str {
        "sigma_i = modulus (A_i - 1/(A_1 A_2)), A_1 = (lambda_1/1.5)^2, A_2 = 1.5 lambda_2^2"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "hinge_stiffness",
            "the film's equilibrium modulus and locking constant",
        ]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("modulus", "Pa", 0.0, 1e6, 1e5)] }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1e4]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "a second known payload, and the same film before and after the electrodes have dried"
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        let volume = along.lozenge.volume_m3();
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            let theta = along.theta_dea_rad[i];
            let l = along.lozenge.stretches(theta);
            let slope = along.lozenge.log_stretch_slopes(theta);
            let (a, b) = ((l[0] / PAINTED[0]).powi(2), (l[1] / PAINTED[1]).powi(2));
            let c = 1.0 / (a * b);
            *t -= v[0] * volume * ((a - c) * slope[0] + (b - c) * slope[1]);
        }
    }
}
