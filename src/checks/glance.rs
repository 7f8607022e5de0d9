//! A quick look at a robot recording: the balance of each chain as one small linear regression.
//!
//! The torque that the recorded voltage makes on a lozenge, 1/2 dC/d theta phi^2, is held against what the
//! pose asks for: the film's equilibrium spring (neo-Hookean, one modulus), four rates at which it creeps,
//! the forearms' spring-back (odd, cubic) and the weights, all known up to a dozen numbers. Gent's locking,
//! further branches and all left-out physics are small beside what a wrong order of wires or axes does, so
//! the share of the made torque that the regression leaves (`Look::left`) tells the two apart, in
//! milliseconds.

use nalgebra::{Rotation3, Vector3};

use super::linear::{Columns, about_mean};
use crate::dataset::{Track, Voltage};
use crate::film::InitialState;
use crate::kinematics::{Lozenge, Vec3};
use crate::model::{Mechanics, Robot};
use crate::recording::{Kind, NumberOrEstimate, Recording, Rig};

/// Distance of the means that are looked at, s, and the most of them: 80 s tell what is to be told.
pub(super) const STEP_S: f64 = 0.05;
const MOST: usize = 1600;
/// Times at which the creep of the film is looked at, s.
const CREEP_S: [f64; 4] = [0.15, 1.0, 8.0, 60.0];
/// A robot rests while no voltage is above this, V, for so many means, and moves by no more than this, m.
const REST_V: f64 = 300.0;
const REST_MEANS: usize = 3;
const REST_M: f64 = 1e-3;
/// Where the moduli of chains 2 and 3 beside that of chain 1 stand among the coefficients.
const OWN: usize = 3 + CREEP_S.len();
/// Of what is looked at so much has to be within reach.
const WITHIN_REACH: f64 = 0.9;

/// A recording, thinned to means over [`STEP_S`].
pub(super) struct Glance {
    pub robot: Robot,
    /// Time of the first mean on the motion clock, s.
    pub start_s: f64,
    /// End effector's marker from the base marker, in the stated axes, m; NaN where it was not seen.
    pub from_base_m: Vec<Vec3>,
    /// Where that is 0, in the rig's axes, m.
    pub origin_m: Vec3,
    /// Payload, kg.
    payload_kg: Vec<f64>,
    /// Voltages, as stated.
    pub voltage: Voltage,
    /// Stated offset of the voltage clock, s; `None`: to be estimated.
    pub offset_s: Option<f64>,
    initial: InitialState,
}

/// The columns of the regression at the poses of a recording.
pub(super) struct Poses {
    columns: Columns,
    /// 1/2 dC/d theta of the chains, N m/V^2.
    half_c: [Vec<f64>; 3],
    /// Torque of the weights, N m.
    load: [Vec<f64>; 3],
    /// Means that count.
    pub usable: Vec<bool>,
}

/// What the three chains share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ties {
    /// Each chain has a modulus of its own, and no constant: rest pose and directions have to be right.
    Rest,
    /// Each chain has a modulus and a constant of its own, so that poses that are off by little matter less:
    /// for who moves when.
    Each,
}

/// What a regression leaves.
#[derive(Debug, Clone)]
pub(super) struct Look {
    /// Share of the variance of the torque that is made (1: all; above 1 where even its sign is wrong).
    pub left: f64,
    /// The same whatever the film's sign.
    pub any: f64,
    /// Variance of the made torque, (N m)^2.
    pub variance: f64,
}

impl Glance {
    /// `None` where the recording is no robot's, or has no time in which both are known.
    pub fn new(recording: &Recording) -> Option<Self> {
        let (Some(motion), Some(raw), Some(Rig::Robot(rig)), Some(stated)) = (
            &recording.motion,
            &recording.voltage,
            &recording.rig,
            &recording.manifest.motion,
        ) else {
            return None;
        };
        if recording.manifest.kind != Kind::Robot || raw.channels.len() != 3 {
            return None;
        }
        let robot = Robot::from_rig(rig, None).ok()?;
        let mean = |xyz: &[Vec3]| {
            let seen: Vec<&Vec3> = xyz
                .iter()
                .filter(|p| p.iter().all(|v| v.is_finite()))
                .collect();
            let n = seen.len().max(1) as f64;
            [0, 1, 2].map(|k| seen.iter().map(|p| p[k]).sum::<f64>() / n)
        };
        let base = motion.base.as_ref().map_or([0.0; 3], |b| {
            super::view::middle(&b.xyz).unwrap_or_else(|| mean(&b.xyz))
        });
        let [a, b, c] = stated.rotation_deg.map(f64::to_radians);
        let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), a)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), c);
        let start_s = *motion.time_s.first()?;
        let end_s = *motion.time_s.last()?;
        let count = (((end_s - start_s) / STEP_S).floor() as usize + 1).min(MOST);
        let mut sum = vec![([0.0; 3], 0.0); count];
        for (t, p) in motion.time_s.iter().zip(&motion.end_effector.xyz) {
            let i = ((t - start_s) / STEP_S + 0.5).floor() as usize;
            if i < count && p.iter().all(|v| v.is_finite()) {
                for k in 0..3 {
                    sum[i].0[k] += p[k];
                }
                sum[i].1 += 1.0;
            }
        }
        let from_base_m: Vec<Vec3> = sum
            .iter()
            .map(|(s, n)| {
                let p = [0, 1, 2].map(|k| s[k] / n - base[k]);
                let v = rotation * Vector3::from(p) * motion.unit.to_si;
                [v[0], v[1], v[2]]
            })
            .collect();
        let origin_m = [0, 1, 2]
            .map(|k| (stated.base_position_mm[k] - stated.end_effector_offset_mm[k]) * 1e-3);
        let payload_kg = (0..count)
            .map(|i| {
                recording
                    .manifest
                    .payload
                    .mass_g(start_s + STEP_S * i as f64)
                    * 1e-3
            })
            .collect();
        let voltage = super::view::volts(raw)?;
        Some(Glance {
            robot,
            start_s,
            from_base_m,
            origin_m,
            payload_kg,
            voltage,
            offset_s: match recording.manifest.offset_s {
                NumberOrEstimate::Number(s) => Some(s),
                NumberOrEstimate::Estimate => None,
            },
            initial: InitialState::Relaxed,
        })
    }

    /// The squared voltage on a long grid in steps of [`STEP_S`] from `start_s` on the voltage clock on, V^2;
    /// 0 where none was logged.
    pub fn squared_from_v2(&self, start_s: f64, count: usize) -> [Vec<f64>; 3] {
        let (first, last) = self.voltage.span_s();
        [0, 1, 2].map(|k| {
            let mut v = self.voltage.squared(k, start_s, STEP_S, count).0;
            for (i, v) in v.iter_mut().enumerate() {
                let t = start_s + STEP_S * i as f64;
                if !(first..=last).contains(&t) {
                    *v = 0.0;
                }
            }
            v
        })
    }

    /// Largest payload, kg.
    pub fn most_payload_kg(&self) -> f64 {
        self.payload_kg.iter().copied().fold(0.0, f64::max)
    }

    /// Length of what is looked at, s.
    pub fn length_s(&self) -> f64 {
        STEP_S * self.len() as f64
    }

    /// Number of means.
    pub fn len(&self) -> usize {
        self.from_base_m.len()
    }

    /// Positions in the rig's axes, m, when what was seen from the base goes through `turn` first.
    pub fn positions_m(&self, turn: impl Fn(Vec3) -> Vec3) -> Vec<Vec3> {
        self.from_base_m
            .iter()
            .map(|v| {
                let w = turn(*v);
                [0, 1, 2].map(|k| w[k] + self.origin_m[k])
            })
            .collect()
    }

    /// Squared voltage of the channels at the means when the voltage clock is `offset_s` ahead and runs
    /// `scale` times as fast, V^2; 0 where no voltage was logged. And whether it was logged.
    pub fn squared_v2(&self, offset_s: f64, scale: f64) -> ([Vec<f64>; 3], Vec<bool>) {
        let (first, last) = self.voltage.span_s();
        let start = self.start_s * scale + offset_s;
        let logged: Vec<bool> = (0..self.len())
            .map(|i| {
                let t = start + STEP_S * scale * i as f64;
                (first - 0.5 * STEP_S..=last + 0.5 * STEP_S).contains(&t)
            })
            .collect();
        let squared = [0, 1, 2].map(|k| {
            let mut v = self.voltage.squared(k, start, STEP_S * scale, self.len()).0;
            for (v, logged) in v.iter_mut().zip(&logged) {
                if !logged {
                    *v = 0.0;
                }
            }
            v
        });
        (squared, logged)
    }

    /// The regression's columns where the end effector is at `position_m`; NaN is passed over. `None` where
    /// most of it is out of reach.
    pub fn poses(&self, position_m: &[Vec3], ties: Ties) -> Option<Poses> {
        self.poses_of(&self.robot, position_m, ties)
    }

    /// The rows of `position_m` as a track, differentiated row by row.
    fn track(&self, position_m: Vec<Vec3>) -> Track {
        let n = position_m.len();
        let slope = |x: &[Vec3]| -> Vec<Vec3> {
            (0..n)
                .map(|i| {
                    let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
                    let dt = STEP_S * (b - a).max(1) as f64;
                    [0, 1, 2].map(|k| (x[b][k] - x[a][k]) / dt)
                })
                .collect()
        };
        let velocity = slope(&position_m);
        let acceleration = slope(&velocity);
        Track {
            step_s: STEP_S,
            position_m,
            velocity_m_s: velocity,
            acceleration_m_s2: acceleration,
            payload_kg: self.payload_kg.clone(),
            initial: self.initial,
        }
    }

    /// The balance at the pose in which the robot rests before anything drives it; `None` where it moves from
    /// the first sample on, or cannot be there.
    pub fn at_rest(&self) -> Option<Mechanics> {
        let (squared, logged) = self.squared_v2(self.offset_s.unwrap_or(0.0), 1.0);
        let still = |i: &usize| logged[*i] && squared.iter().all(|v| v[*i] < REST_V * REST_V);
        let rest: Vec<Vec3> = (0..self.len())
            .take_while(still)
            .map(|i| self.from_base_m[i])
            .filter(|p| p.iter().all(|v| v.is_finite()))
            .collect();
        // the last mean may be half of a drive
        let rest = &rest[..rest.len().checked_sub(1).filter(|n| *n >= REST_MEANS)?];
        let mut place = [0.0; 3];
        for k in 0..3 {
            let along = || rest.iter().map(|p| p[k]);
            let (low, high) = (
                along().fold(f64::MAX, f64::min),
                along().fold(f64::MIN, f64::max),
            );
            if high - low > REST_M {
                return None;
            }
            place[k] = along().sum::<f64>() / rest.len() as f64 + self.origin_m[k];
        }
        let track = Track {
            payload_kg: vec![*self.payload_kg.first()?],
            ..self.track(vec![place])
        };
        Mechanics::new(&self.robot, &track).ok()
    }

    /// As [`Glance::poses`] of another robot.
    pub fn poses_of(&self, robot: &Robot, position_m: &[Vec3], ties: Ties) -> Option<Poses> {
        let n = position_m.len();
        let seen: Vec<bool> = position_m
            .iter()
            .map(|p| p.iter().all(|v| v.is_finite()))
            .collect();
        let track = self.track(super::view::bridged(position_m)?);
        let mechanics = Mechanics::new(robot, &track).ok()?;
        let mut usable = seen;
        for (i, _) in &mechanics.unreachable {
            usable[*i] = false;
        }
        let reached = n - mechanics.unreachable.len();
        if (reached as f64) < WITHIN_REACH * n as f64 {
            return None;
        }
        let columns = columns_of(robot, &mechanics, &usable, ties);
        let masked = |values: Vec<f64>| -> Vec<f64> {
            values
                .into_iter()
                .zip(&usable)
                .map(|(v, on)| if *on { v } else { 0.0 })
                .collect()
        };
        let half_c = [0, 1, 2].map(|k| masked(mechanics.chains[k].half_capacitance_slope.clone()));
        let load = [0, 1, 2].map(|k| {
            masked(
                mechanics.chains[k]
                    .load_n_m
                    .iter()
                    .map(|l| l.iter().sum())
                    .collect(),
            )
        });
        Some(Poses {
            columns: Columns::new(columns)?,
            half_c,
            load,
            usable,
        })
    }
}

/// Torque of a neo-Hookean spring on a lozenge over its modulus, m^3.
pub(super) fn spring_m3(lozenge: &Lozenge, theta_dea_rad: f64) -> f64 {
    let [a, b] = lozenge.stretches(theta_dea_rad);
    let [da, db] = lozenge.log_stretch_slopes(theta_dea_rad);
    let across = (a * b).powi(-2);
    lozenge.volume_m3() * (da * (a * a - across) + db * (b * b - across))
}

/// Columns of the springs, of their creep at each rate and of the passive joints, then each actuator's own;
/// rows that are not usable are 0.
fn columns_of(robot: &Robot, mechanics: &Mechanics, usable: &[bool], ties: Ties) -> Vec<Vec<f64>> {
    let n = usable.len();
    let mut columns: Vec<Vec<f64>> = vec![Vec::with_capacity(3 * n); 3 + CREEP_S.len()];
    let mut own: Vec<Vec<f64>> = match ties {
        Ties::Rest => vec![vec![0.0; 3 * n]; 2],
        Ties::Each => vec![vec![0.0; 3 * n]; 5],
    };
    for (k, chain) in mechanics.chains.iter().enumerate() {
        let lozenge = &robot.lozenges[k];
        let spring: Vec<f64> = chain
            .theta_dea_rad
            .iter()
            .map(|&theta| spring_m3(lozenge, theta))
            .collect();
        let mut slow: Vec<f64> = vec![spring[0]; CREEP_S.len()];
        for i in 0..n {
            let on = f64::from(u8::from(usable[i]));
            if k > 0 {
                own[k - 1][k * n + i] = on * spring[i];
            }
            if ties == Ties::Each {
                own[2 + k][k * n + i] = on;
            }
            columns[0].push(on * spring[i]);
            for (j, t) in CREEP_S.iter().enumerate() {
                let follow = 1.0 - (-STEP_S / t).exp();
                slow[j] += follow * (spring[i] - slow[j]);
                columns[1 + j].push(on * (spring[i] - slow[j]));
            }
            let lever = chain.forearm_lever[i];
            let swing = |power: i32| -> f64 {
                (0..3)
                    .map(|j| lever[j] * mechanics.chains[j].theta_fa_rad[i].powi(power))
                    .sum()
            };
            columns[1 + CREEP_S.len()].push(on * swing(1));
            columns[2 + CREEP_S.len()].push(on * swing(3));
        }
    }
    columns.extend(own);
    columns
}

impl Poses {
    /// The same with a chain passed over.
    pub fn without(&self, chain: usize) -> Option<Poses> {
        let n = self.usable.len();
        let mut columns = self.columns.columns().to_vec();
        for c in &mut columns {
            c[chain * n..(chain + 1) * n].fill(0.0);
        }
        let mut load = self.load.clone();
        load[chain].fill(0.0);
        Some(Poses {
            columns: Columns::new(columns)?,
            half_c: self.half_c.clone(),
            load,
            usable: self.usable.clone(),
        })
    }

    /// Spread of the torque that chain `chain` needs at the film of the other chains, over that of what these
    /// are given: 0 for a chain that nothing drives. `without` is [`Poses::without`] that chain.
    pub fn needs(&self, without: &Poses, chain: usize, squared_v2: [&[f64]; 3]) -> f64 {
        let n = self.usable.len();
        let y = without.given(squared_v2);
        let solved = without.columns.solve(&y);
        let needed = self.columns.sum(&solved.beta);
        let spread = |values: &[f64]| {
            let q = |s| super::linear::quantile(values.iter().copied(), s);
            q(0.95) - q(0.05)
        };
        let own: Vec<f64> = (0..n)
            .map(|i| needed[chain * n + i] + self.load[chain][i])
            .collect();
        let others = (0..3)
            .filter(|k| *k != chain)
            .map(|k| spread(&y[k * n..(k + 1) * n]))
            .fold(0.0, f64::max);
        spread(&own) / others.max(1e-300)
    }

    /// The torque that squared voltages make, less the weights', chain after chain.
    fn given(&self, squared_v2: [&[f64]; 3]) -> Vec<f64> {
        let mut y = Vec::with_capacity(3 * self.usable.len());
        for (k, squared) in squared_v2.iter().enumerate() {
            let made = self.half_c[k].iter().zip(*squared).map(|(c, v)| c * v);
            y.extend(made.zip(&self.load[k]).map(|(m, l)| m - l));
        }
        y
    }

    /// How well the poses go with squared voltages of chains 1, 2, 3.
    pub fn look(&self, squared_v2: [&[f64]; 3]) -> Look {
        let y = self.given(squared_v2);
        let mut variances = [0.0; 3];
        for (k, squared) in squared_v2.iter().enumerate() {
            let made: Vec<f64> = self.half_c[k]
                .iter()
                .zip(*squared)
                .map(|(c, v)| c * v)
                .collect();
            let counted: Vec<f64> = made
                .iter()
                .zip(&self.usable)
                .filter(|(_, on)| **on)
                .map(|(v, _)| *v)
                .collect();
            variances[k] = about_mean(&counted);
        }
        let solved = self.columns.solve(&y);
        let variance: f64 = variances.iter().sum();
        let any = solved.left / variance.max(1e-300);
        // A film that pushes where it should pull explains nothing. At once and after a minute are hard to
        // tell apart in a short recording: what is to take the stated way's place has to pull in both. What
        // is not driven says nothing of its film.
        let own = |k: usize| match k {
            0 => 0.0,
            _ => solved.beta[OWN + k - 1],
        };
        let weighed = |film: f64| -> f64 { (0..3).map(|k| variances[k] * (film + own(k))).sum() };
        let pulls = [
            weighed(solved.beta[0]) > 0.0,
            weighed(solved.beta[..=CREEP_S.len()].iter().sum()) > 0.0,
        ];
        Look {
            left: if pulls == [true; 2] {
                any
            } else {
                any.max(1.0)
            },
            any,
            variance,
        }
    }
}
