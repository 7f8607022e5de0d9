//! The electrode is an elastic layer, stress-free in the state in which it was painted (in a robot lambda_1 =
//! 1.5, lambda_2 = 1.5^-1/2; a hanging sample is painted unstretched): sigma_i = mu (A_i - C),  A_i =
//! (lambda_i/lambda_i0)^2,  C = 1/(A_1 A_2); torque V sum sigma_i d ln lambda_i/d theta.

use super::{Along, Effect, Part, Quantity, Reach, Seen, Site, pull, size};

pub struct ElectrodeStiffness;

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
    fn in_electrode(&self) -> bool {
        true
    }
    fn carries(&self, _: &[f64], along: &Along, stress: &mut [[f64; 2]]) {
        let painted = along.painted;
        for (i, s) in stress.iter_mut().enumerate() {
            let l = along.stretches(i);
            let (a, b) = ((l[0] / painted[0]).powi(2), (l[1] / painted[1]).powi(2));
            let c = 1.0 / (a * b);
            *s = [s[0] + a - c, s[1] + b - c];
        }
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        let mut stress = vec![[0.0; 2]; torque_n_m.len()];
        self.carries(v, along, &mut stress);
        pull(v[0], along, &stress, torque_n_m);
    }
}
