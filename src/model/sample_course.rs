//! Causes along the course of a hanging sample. Each one's own law is called along a course that was run; the
//! sample is run again with what they made of it, linear in the stretches about that course, until the course
//! stands still: then the laws hold along it exactly.
//!
//! ```text
//! voltage, capacitance   X = (eps/L3^2) S (lambda_1 lambda_2)^2,  S = phi^2 times what a cause leaves of C'
//! stress                 sigma = f_b sigma(springs) + (f_0 - f_b) sigma(equilibrium spring) + stresses that causes add
//! slack                  of p = sigma_1 - X the active part carries p + change(p)
//! load                   M + m in place of M
//! ```
//!
//! A cause of the film sits in all parts, one of the electrode in the active part. Side and end strips are
//! uniaxial: lambda_2 = lambda_1^-1/2.

use super::HangingSample;
use crate::effects::{Acting, Along, Site, When};
use crate::film::{Film, gent_stress};
use crate::kinematics::Lozenge;
use crate::units::VACUUM_PERMITTIVITY_F_M;

/// By how much logarithms of stretches are moved to see what a cause makes of it: back, so that the largest
/// stretch so far stays what it is.
const MOVED: f64 = -1e-5;
/// The same of a net stress, Pa.
const MOVED_PA: f64 = 10.0;

/// A course of a hanging sample in equal steps.
#[derive(Debug, Clone, Default)]
pub struct SampleCourse {
    /// Length of a step, s.
    pub step_s: f64,
    /// The recording's place in its series; its `start_s` is the time of the first step.
    pub when: When,
    /// What the amplifier is told, V.
    pub command_v: Vec<f64>,
    /// ln lambda_1, ln lambda_2 of the active part, ln lambda_1 of the end strips.
    pub log_stretch: Vec<[f64; 3]>,
    /// sigma_1 - eps E^2 of the active part, as its springs have it, Pa.
    pub net_pa: Vec<f64>,
}

/// A number along a course, linear in the logarithms of the stretches about it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Linear {
    /// Its value on the course.
    pub value: f64,
    /// Its slopes by ln lambda_1 and ln lambda_2.
    pub slope: [f64; 2],
}

impl Linear {
    /// Its value where the logarithms of the stretches are `moved` off the course.
    #[must_use]
    pub fn at(&self, moved: [f64; 2]) -> f64 {
        self.value + self.slope[0] * moved[0] + self.slope[1] * moved[1]
    }
}

/// What causes make of one step of a hanging sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleLoad {
    /// ln lambda_1, ln lambda_2 of the active part, ln lambda_1 of the end strips about which it is linear.
    pub about: [f64; 3],
    /// phi^2 on the film, less what is lost of the capacitance, V^2.
    pub squared_v2: Linear,
    /// Factor on the stress of all springs.
    pub factor: f64,
    /// sigma_1, sigma_2 that the active part carries beside its springs, Pa.
    pub active_pa: [Linear; 2],
    /// sigma_1 that side and end strips carry beside theirs, Pa; linear in their ln lambda_1.
    pub strips_pa: [Linear; 2],
    /// What the active part carries of p = sigma_1 - eps E^2 beside p, Pa: at p = 0, and by p.
    pub slack: [f64; 2],
    /// Mass over the stated one.
    pub mass: f64,
}

impl SampleLoad {
    /// No cause at all, at a voltage on the film.
    #[must_use]
    pub fn none(phi_v: f64) -> Self {
        SampleLoad {
            about: [0.0; 3],
            squared_v2: Linear {
                value: phi_v * phi_v,
                slope: [0.0; 2],
            },
            factor: 1.0,
            active_pa: [Linear::default(); 2],
            strips_pa: [Linear::default(); 2],
            slack: [0.0; 2],
            mass: 1.0,
        }
    }
}

/// Stresses of a part along a course.
struct PartStress {
    factor: Vec<f64>,
    added_pa: Vec<[f64; 2]>,
}

/// The causes at work in a sample, along a course.
struct AtWork<'a> {
    sample: &'a HangingSample,
    film: &'a Film,
    effects: &'a [Acting],
    course: &'a SampleCourse,
    /// The active film as a sheet.
    sheet: Lozenge,
}

impl AtWork<'_> {
    fn along<'b>(&'b self, area: &'b [f64], stretch: &'b [[f64; 2]]) -> Along<'b> {
        Along {
            step_s: self.course.step_s,
            when: self.course.when,
            lozenge: &self.sheet,
            eps_f_m: self.sample.eps_r * VACUUM_PERMITTIVITY_F_M,
            bicep_m: f64::NAN,
            theta_dea_rad: &[],
            area_stretch: area,
            stretch,
            painted: [1.0; 2],
            theta_b: &[],
            bicep_lever: &[],
            force_lever: &[],
            acceleration_m_s2: &[],
            position_m: &[],
            velocity_m_s: &[],
            others_v: [&[]; 2],
        }
    }

    /// Stretches of the active part.
    fn active(&self) -> Vec<[f64; 2]> {
        let of = |y: &[f64; 3]| [y[0].exp(), y[1].exp()];
        self.course.log_stretch.iter().map(of).collect()
    }

    /// Stretches of strips, whose ln lambda_1 has the place `at`.
    fn strips(&self, at: usize) -> Vec<[f64; 2]> {
        let of = |y: &[f64; 3]| [y[at].exp(), (-0.5 * y[at]).exp()];
        self.course.log_stretch.iter().map(of).collect()
    }

    fn area(&self, moved: f64) -> Vec<f64> {
        let of = |y: &[f64; 3]| (y[0] + y[1] + moved).exp();
        self.course.log_stretch.iter().map(of).collect()
    }

    /// The voltage on the film, V, and phi^2 times what is left of the slope of the capacitance, V^2.
    fn electrical(&self, moved: f64) -> (Vec<f64>, Vec<f64>) {
        let area = self.area(moved);
        let along = self.along(&area, &[]);
        let mut phi = self.course.command_v.clone();
        let mut half = vec![1.0; phi.len()];
        for a in self.effects {
            if a.effect.site() == Site::Electrical {
                a.effect.voltage(&a.values, &along, &mut phi);
            }
            a.effect.capacitance(&a.values, &along, &mut half);
        }
        let squared = phi.iter().zip(&half).map(|(p, h)| p * p * h).collect();
        (phi, squared)
    }

    /// What causes make of a part's stress at these stretches.
    fn stress(&self, stretch: &[[f64; 2]], active: bool) -> PartStress {
        let n = stretch.len();
        let along = self.along(&[], stretch);
        let mut factor = vec![[1.0; 2]; n];
        let mut added_pa = vec![[0.0; 2]; n];
        let mut own = vec![[0.0; 2]; n];
        for a in self.effects {
            if a.effect.site() == Site::Film {
                a.effect.stress(&a.values, &along, self.film, &mut factor);
            }
            if a.effect.in_electrode() && !active {
                continue;
            }
            own.fill([0.0; 2]);
            a.effect.carries(&a.values, &along, &mut own);
            for (sum, s) in added_pa.iter_mut().zip(&own) {
                *sum = [sum[0] + a.values[0] * s[0], sum[1] + a.values[0] * s[1]];
            }
        }
        for ((sum, f), l) in added_pa.iter_mut().zip(&factor).zip(stretch) {
            let more = (f[0] - f[1]) * self.film.mu_pa[0];
            if more != 0.0
                && let Ok((s, _)) = gent_stress(l[0] * l[0], l[1] * l[1], self.film.locking)
            {
                *sum = [sum[0] + more * s[0], sum[1] + more * s[1]];
            }
        }
        PartStress {
            factor: factor.iter().map(|f| f[1]).collect(),
            added_pa,
        }
    }

    /// What is added to a part's stress at each step where the logarithms of its stretches alone are moved by
    /// `by`, and those of other steps stay: every second one is moved at a time. What is relaxed at the first
    /// step follows it.
    fn moved_alone(&self, stretch: &[[f64; 2]], by: [f64; 2], active: bool) -> Vec<[f64; 2]> {
        let factor = by.map(f64::exp);
        let moved = |l: [f64; 2]| [l[0] * factor[0], l[1] * factor[1]];
        let mut out = self.stress(&[moved(stretch[0])], active).added_pa;
        out.resize(stretch.len(), [0.0; 2]);
        for first in [1, 2] {
            let mut course = stretch.to_vec();
            course
                .iter_mut()
                .skip(first)
                .step_by(2)
                .for_each(|l| *l = moved(*l));
            let added = self.stress(&course, active).added_pa;
            for i in (first..stretch.len()).step_by(2) {
                out[i] = added[i];
            }
        }
        out
    }

    /// What the active part carries beside its net stress where that stress is `moved_pa` more, Pa.
    fn slack(&self, phi_v: &[f64], moved_pa: f64) -> Vec<f64> {
        let area = self.area(0.0);
        let along = self.along(&area, &[]);
        let maxwell = along.eps_f_m / (self.sample.l3_m * self.sample.l3_m);
        // the first stress is the one at rest
        let sigma = (self.course.net_pa.iter().zip(phi_v).zip(&area).enumerate())
            .map(|(i, ((p, phi), a))| {
                p + if i > 0 { moved_pa } else { 0.0 } + maxwell * (phi * a).powi(2)
            })
            .collect::<Vec<f64>>();
        let mut change = vec![0.0; sigma.len()];
        for a in self.effects.iter().filter(|a| a.effect.needs_tension()) {
            (a.effect).slack(&a.values, &along, &sigma, phi_v, &mut change);
        }
        change
    }

    fn mass_kg(&self) -> Vec<f64> {
        let stretch = self.active();
        let along = self.along(&[], &stretch);
        let mut mass = vec![0.0; stretch.len()];
        for a in self.effects {
            a.effect.load(&a.values, &along, &mut mass);
        }
        mass
    }
}

/// Slopes from what was moved by [`MOVED`].
fn linear(value: f64, by_1: f64, by_2: f64) -> Linear {
    Linear {
        value,
        slope: [(by_1 - value) / MOVED, (by_2 - value) / MOVED],
    }
}

/// What `effects` make of every step of a hanging sample of `film` about a course.
#[must_use]
pub fn sample_loads(
    sample: &HangingSample,
    film: &Film,
    effects: &[Acting],
    course: &SampleCourse,
) -> Vec<SampleLoad> {
    let [length, _] = sample.lengths_m();
    let at_work = AtWork {
        sample,
        film,
        effects,
        course,
        sheet: Lozenge {
            side_m: f64::NAN,
            l1_m: length,
            l2_m: sample.width_m - 2.0 * sample.margin_m,
            l3_m: sample.l3_m,
            films: sample.films,
        },
    };
    let n = course.log_stretch.len();
    let (phi_v, squared) = at_work.electrical(0.0);
    let moved = at_work.electrical(MOVED).1;
    let mass = at_work.mass_kg();
    let mut out: Vec<SampleLoad> = (0..n)
        .map(|i| SampleLoad {
            about: course.log_stretch[i],
            squared_v2: linear(squared[i], moved[i], moved[i]),
            mass: 1.0 + mass[i] / sample.mass_kg,
            ..SampleLoad::none(0.0)
        })
        .collect();
    let carries = |a: &Acting| matches!(a.effect.site(), Site::Film | Site::Balance);
    if effects.iter().any(carries) {
        let active = at_work.active();
        let own = at_work.stress(&active, true);
        let [by_1, by_2] =
            [[MOVED, 0.0], [0.0, MOVED]].map(|by| at_work.moved_alone(&active, by, true));
        let strips = [0, 2].map(|at| {
            let strip = at_work.strips(at);
            let added = at_work.stress(&strip, false).added_pa;
            [
                added,
                at_work.moved_alone(&strip, [MOVED, -0.5 * MOVED], false),
            ]
        });
        for (i, load) in out.iter_mut().enumerate() {
            load.factor = own.factor[i];
            load.active_pa = [0, 1].map(|k| linear(own.added_pa[i][k], by_1[i][k], by_2[i][k]));
            load.strips_pa = [0, 1].map(|part: usize| {
                let [at, by]: &[Vec<[f64; 2]>; 2] = &strips[part];
                linear(at[i][0], by[i][0], at[i][0])
            });
        }
    }
    if effects.iter().any(|a| a.effect.needs_tension()) {
        let [at, by] = [0.0, MOVED_PA].map(|moved| at_work.slack(&phi_v, moved));
        for (i, load) in out.iter_mut().enumerate() {
            let slope = (by[i] - at[i]) / MOVED_PA;
            load.slack = [at[i] - slope * course.net_pa[i], slope];
        }
    }
    out
}
