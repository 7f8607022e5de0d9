//! One more branch with a very long relaxation time, creeping since the film was mounted: xi = 1 at the
//! assembly, `since_assembly` before the first recording; between recordings the film rests in the pose of
//! the next first sample.

use super::{Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site, shape, size};

pub struct SlowCreep;

/// Longest step in which the branch is followed while the robot rests, s.
const REST_STEP_S: f64 = 5.0;

/// d ln xi/dt of a neo-Hookean branch with the relaxation time `time_s`, far from locking, at the squared
/// stretches `l`, and its stress over its modulus:  d ln xi_1/dt = (s_1 - s_2/2)/(3 T).
pub(crate) fn creep(time_s: f64, l: [f64; 2], x: [f64; 2]) -> ([f64; 2], [f64; 2]) {
    let (a, b) = (l[0] * (-2.0 * x[0]).exp(), l[1] * (-2.0 * x[1]).exp());
    let c = 1.0 / (a * b);
    let s = [a - c, b - c];
    let rate = 1.0 / (3.0 * time_s);
    ([rate * (s[0] - 0.5 * s[1]), rate * (s[1] - 0.5 * s[0])], s)
}

impl Effect for SlowCreep {
    fn id(&self) -> &'static str {
        "slow_creep"
    }
    fn says(&self) -> &'static str {
        "the film still creeps from its mounting, over many minutes"
    }
    fn source(&self) -> &'static str {
        "an eighth branch of the film (Eqs 18 to 23), not relaxed at the first sample"
    }
    fn equation(&self) -> &'static str {
        "sigma_i = modulus s_i, s_i = (lambda_i/xi_i)^2 - (xi_1 xi_2/(lambda_1 lambda_2))^2, \
         (ln xi_1)' = (s_1 - s_2/2)/(3 time_constant), xi_2 alike, xi = 1 since_assembly ago"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "temperature_drift",
            "electrode_stiffness",
            "dielectric_relaxation",
        ]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("modulus", "Pa", 0.0, 1e6, 1e5),
                shape("time_constant", "s", 1100.0, 300.0, 5000.0, 600.0),
                shape("since_assembly", "s", 300.0, 10.0, 5000.0, 300.0),
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
        vec![vec![vec![1e4, 1100.0, 300.0]]]
    }
    fn over_series(&self, _: &[f64]) -> bool {
        true
    }
    fn brought_out_by(&self) -> &'static str {
        "the first recording repeated at the end, and a rest of twenty minutes"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Again, Exercise::Staircase]
    }
    fn memory(&self) -> Memory<'_> {
        Memory::Branch
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        if v[0] == 0.0 {
            return;
        }
        let volume = along.lozenge.volume_m3();
        let squared = |i: usize| {
            along
                .lozenge
                .stretches(along.theta_dea_rad[i])
                .map(|l| l * l)
        };
        let advance = |l: [f64; 2], x: &mut [f64; 2], h: f64| {
            let rate = creep(v[1], l, *x).0;
            x[0] += h * rate[0];
            x[1] += h * rate[1];
        };
        let mut x = [0.0; 2];
        let rest_s = v[2] + along.when.series_s;
        let steps = (rest_s / REST_STEP_S).ceil().max(1.0);
        for _ in 0..steps as usize {
            advance(squared(0), &mut x, rest_s / steps);
        }
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            let l = squared(i);
            let s = creep(v[1], l, x).1;
            let slope = along.lozenge.log_stretch_slopes(along.theta_dea_rad[i]);
            *t -= v[0] * volume * (s[0] * slope[0] + s[1] * slope[1]);
            advance(l, &mut x, along.step_s);
        }
    }
}
