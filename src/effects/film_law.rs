//! The film follows another law than the model's, as a nuisance. Two terms tell of most laws that rubber is
//! given. [`StretchExponent`] is the change of an Ogden spring,
//!
//! ```text
//! sigma_i = (2 mu/alpha) (lambda_i^alpha - lambda_3^alpha),
//! ```
//!
//! with alpha at 2, where it is neo-Hookean, but for what scales all of it. [`LinearBranch`] relaxes an
//! elastic stress linearly, as the sums of exponentials do by which most data sheets and finite element codes
//! describe rubber: to first order in the stroke it is a branch of the model; beyond, it differs.

use super::{Along, Effect, Part, Quantity, Reach, Site, decays, shape, size};

pub struct StretchExponent;
pub struct LinearBranch;

/// Takes the torque of the stresses over its modulus that `stress` makes of the squared stretches, sample by
/// sample, times `modulus_pa`, from a torque on the lozenge.
fn pull(
    modulus_pa: f64,
    along: &Along,
    torque_n_m: &mut [f64],
    mut stress: impl FnMut([f64; 3]) -> [f64; 2],
) {
    let volume = along.lozenge.volume_m3();
    for (t, &angle) in torque_n_m.iter_mut().zip(along.theta_dea_rad) {
        let [a, b] = along.lozenge.stretches(angle).map(|l| l * l);
        let s = stress([a, b, 1.0 / (a * b)]);
        let slope = along.lozenge.log_stretch_slopes(angle);
        *t -= modulus_pa * volume * (s[0] * slope[0] + s[1] * slope[1]);
    }
}

impl Effect for StretchExponent {
    fn id(&self) -> &'static str {
        "x_stretch_exponent"
    }
    fn says(&self) -> &'static str {
        "the film's stress grows with another power of stretch"
    }
    fn source(&self) -> &'static str {
        "Ogden 1972"
    }
    fn equation(&self) -> &'static str {
        "sigma_i = modulus (lambda_i^2 ln lambda_i - lambda_3^2 ln lambda_3), modulus = mu (alpha - 2)"
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("modulus", "Pa", -1e7, 1e7, 1e5)] }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn brought_out_by(&self) -> &'static str {
        "a strip of bare film pulled to several stretches"
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        let of = |square: f64| 0.5 * square * square.ln();
        pull(v[0], along, torque_n_m, |[a, b, c]| {
            [of(a) - of(c), of(b) - of(c)]
        });
    }
}

impl Effect for LinearBranch {
    fn id(&self) -> &'static str {
        "x_linear_branch"
    }
    fn says(&self) -> &'static str {
        "the film relaxes linearly"
    }
    fn source(&self) -> &'static str {
        "linear relaxation of the elastic stress (Simo 1987)"
    }
    fn equation(&self) -> &'static str {
        "sigma_i = modulus h_i, h_i' = s_i' - h_i/time_constant, h_i = 0 at the first sample, \
         s_i = (lambda_i^2 - lambda_3^2) (I - 3)^power, I = lambda_1^2 + lambda_2^2 + lambda_3^2"
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("modulus", "Pa", -1e7, 1e7, 1e5),
                shape("time_constant", "s", 1.0, 1e-3, 1e4, 1.0),
                shape("power", "1", 0.0, 0.0, 4.0, 1.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn brought_out_by(&self) -> &'static str {
        "sines of one rate at two amplitudes"
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        let (left, mean) = decays(along.step_s / v[1]);
        let mut before: Option<[f64; 2]> = None;
        let mut carried = [0.0; 2];
        pull(v[0], along, torque_n_m, |[a, b, c]| {
            let s = [a - c, b - c].map(|s| s * (a + b + c - 3.0).powf(v[2]));
            let from = before.replace(s).unwrap_or(s);
            carried = [0, 1].map(|n| left * carried[n] + mean * (s[n] - from[n]));
            carried
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::Lozenge;

    const LOZENGE: Lozenge = Lozenge {
        side_m: 0.05,
        l1_m: 0.0629,
        l2_m: 0.04065,
        l3_m: 8.5e-5,
        films: 2.0,
    };

    /// Torques of an effect along a step of the lozenge's angle.
    fn along_a_step(effect: &dyn Effect, values: &[f64]) -> Vec<f64> {
        let angles: Vec<f64> = (0..200).map(|i| if i < 10 { 2.3 } else { 2.4 }).collect();
        let along = Along {
            step_s: 0.01,
            when: Default::default(),
            lozenge: &LOZENGE,
            eps_f_m: 2.5e-11,
            bicep_m: 0.05,
            theta_dea_rad: &angles,
            area_stretch: &[],
            theta_b: &[],
            bicep_lever: &[],
            force_lever: &[],
            acceleration_m_s2: &[],
            position_m: &[],
            velocity_m_s: &[],
            others_v: [&[], &[]],
        };
        let mut torque = vec![0.0; angles.len()];
        effect.torque(values, &along, &mut torque);
        torque
    }

    #[test]
    fn a_branch_is_relaxed_at_first_carries_a_step_and_lets_it_go_with_its_time() {
        for power in [0.0, 1.0] {
            let branch = |time_s: f64| along_a_step(&LinearBranch, &[1e5, time_s, power]);
            let t = branch(0.5);
            assert!(t[..10].iter().all(|t| *t == 0.0));
            assert!(
                t[10] < 0.0,
                "a film that is stretched along direction 1 pulls back: {}",
                t[10]
            );
            assert!((t[60] / t[10] - (-1.0_f64).exp()).abs() < 1e-9);
            // one that hardly relaxes is a spring, and keeps the whole step
            let spring = branch(1e4);
            assert!((spring[199] / spring[10] - 1.0).abs() < 1e-3);
            assert!(
                (t[10] / spring[10] - 0.99).abs() < 1e-3,
                "{}",
                t[10] / spring[10]
            );
        }
    }

    #[test]
    fn an_exponent_is_what_it_changes_of_an_ogden_spring() {
        // (2/alpha) (lambda^alpha - ...) about alpha = 2: what the exponent adds, and a share of the whole
        let torque = along_a_step(&StretchExponent, &[1e5]);
        for (t, angle) in [(torque[0], 2.3), (torque[199], 2.4)] {
            let (l, slope) = (LOZENGE.stretches(angle), LOZENGE.log_stretch_slopes(angle));
            let ogden = |alpha: f64| {
                let third = (l[0] * l[1]).powf(-alpha);
                let s = |l: f64| 2.0 / alpha * (l.powf(alpha) - third);
                -1e5 * LOZENGE.volume_m3() * (s(l[0]) * slope[0] + s(l[1]) * slope[1])
            };
            let change = (ogden(2.0 + 1e-4) - ogden(2.0 - 1e-4)) / 2e-4;
            let own = change + 0.5 * ogden(2.0);
            assert!((t / own - 1.0).abs() < 1e-6, "{t} {own}");
        }
    }
}
