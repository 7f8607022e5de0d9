//! One more branch of the film whose flow speeds up with its stress: the rate of a linear branch times
//! (s/S_0)^(m - 1), s the equivalent stress over the modulus and S_0 = 0.1; `time_constant` is the relaxation
//! time at S_0. Relaxed at the first sample.

use super::slow_creep::creep;
use super::{Along, Effect, Memory, Part, Quantity, Reach, Seen, Site, shape, size};

pub struct NonlinearFlow;

/// Equivalent stress over the modulus at which the relaxation time is stated.
const AT: f64 = 0.1;
/// Largest share of its own relaxation time that a step may take.
const STEP: f64 = 0.1;

/// d ln xi/dt of the branch with values `v` at the squared stretches `l`, its stress over its modulus, and
/// the rate with which it relaxes, 1/s.
pub(crate) fn flow(v: &[f64], l: [f64; 2], x: [f64; 2]) -> ([f64; 2], [f64; 2], f64) {
    let (rate, s) = creep(v[1], l, x);
    let size = (s[0] * s[0] - s[0] * s[1] + s[1] * s[1]).sqrt();
    let faster = (size / AT).powf(v[2] - 1.0);
    // the three squared elastic stretches, added
    let steep = 3.0 * l[0] * (-2.0 * x[0]).exp() - 2.0 * s[0] + s[1];
    (rate.map(|r| faster * r), s, faster / v[1] * v[2] * steep)
}

impl Effect for NonlinearFlow {
    fn id(&self) -> &'static str {
        "x_nonlinear_flow"
    }
    fn says(&self) -> &'static str {
        "a branch of the film flows the faster the more it carries"
    }
    fn source(&self) -> &'static str {
        "power law of the flow (Bergstrom and Boyce 1998)"
    }
    fn equation(&self) -> &'static str {
        "sigma_i = modulus s_i and (ln xi_i)' as of slow_creep with this time_constant, times \
         (s/0.1)^(stress_exponent - 1), s^2 = s_1^2 - s_1 s_2 + s_2^2, relaxed at the first sample"
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("modulus", "Pa", 0.0, 1e6, 1e5),
                shape("time_constant", "s", 2.0, 0.05, 200.0, 3.0),
                shape("stress_exponent", "1", 2.0, 1.0, 6.0, 1.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [0.3, 3.0, 20.0]
            .iter()
            .map(|time| vec![vec![1e4, *time, 3.0]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "sines of one rate at two amplitudes, and holds after small and large steps"
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Flow
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        if v[0] == 0.0 || along.samples() == 0 {
            return;
        }
        let volume = along.lozenge.volume_m3();
        let stretches = |i: usize| along.lozenge.stretches(along.theta_dea_rad[i]);
        let mut x = stretches(0).map(f64::ln);
        let mut before = stretches(0).map(|l| l * l);
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            let l = stretches(i).map(|l| l * l);
            let mut left_s = if i == 0 { 0.0 } else { along.step_s };
            while left_s > 0.0 {
                let at = |left: f64| {
                    let on = 1.0 - left / along.step_s;
                    [0, 1].map(|k| before[k] + on * (l[k] - before[k]))
                };
                let (rate, _, fast) = flow(v, at(left_s), x);
                let h = left_s.min((STEP / fast.max(f64::MIN_POSITIVE)).max(1e-3 * along.step_s));
                let half = [0, 1].map(|k| x[k] + 0.5 * h * rate[k]);
                let (rate, ..) = flow(v, at(left_s - 0.5 * h), half);
                x = [0, 1].map(|k| x[k] + h * rate[k]);
                left_s -= h;
            }
            before = l;
            let (_, s, _) = flow(v, l, x);
            let slope = along.lozenge.log_stretch_slopes(along.theta_dea_rad[i]);
            *t -= v[0] * volume * (s[0] * slope[0] + s[1] * slope[1]);
        }
    }
}
