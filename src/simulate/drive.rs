//! Built-in drives: sampled voltages for the three chains.

use super::path::{PlannedDrive, drive_along};
use super::voltage::{Hold, Sampled};
use super::{Addition, Error, rest};
use crate::film::InitialState;
use crate::kinematics::Vec3;
use crate::model::{Parameters, Robot, Track};

const TURN: f64 = 2.0 * std::f64::consts::PI;

/// Samples a second unless the user says otherwise, 1/s.
pub const DEFAULT_RATE_HZ: f64 = 1000.0;

/// A drive that is known beforehand. `peak_v` is one voltage a chain: equal ones drive symmetrically, (V, 0,
/// 0) chain 1 alone.
#[derive(Debug, Clone, PartialEq)]
pub enum Drive {
    /// peak (1 - cos(2 pi f t + phase))/2, raised smoothly over the first period where a phase is not zero.
    Sine {
        /// Peak voltages, V.
        peak_v: [f64; 3],
        /// Frequency, Hz.
        frequency_hz: f64,
        /// Phases of the chains, rad.
        phase_rad: [f64; 3],
    },
    /// Equal sines with Schroeder's phases (another order of phases in each chain), scaled to lie between 0
    /// and the peak, raised smoothly over the first second.
    Multisine {
        /// Peak voltages, V.
        peak_v: [f64; 3],
        /// Frequencies, Hz.
        frequency_hz: Vec<f64>,
    },
    /// Up and down a stair, several times: shows what depends on the largest stretch so far.
    Staircase {
        /// Voltage of the highest step, V.
        peak_v: [f64; 3],
        /// Steps up (and as many down).
        steps: usize,
        /// Length of a step, ramp included, s.
        hold_s: f64,
        /// Length of the ramp to a step, s; 0 jumps within a sample.
        ramp_s: f64,
        /// How often.
        repeats: usize,
    },
    /// A list of voltages, each held for its time, with ramps between them; begins at 0 V.
    Holds {
        /// (voltages V, time s, ramp included).
        levels: Vec<([f64; 3], f64)>,
        /// Length of a ramp, s.
        ramp_s: f64,
    },
    /// peak (1 - cos(phase(t)))/2 with a frequency that rises exponentially over the duration.
    Chirp {
        /// Peak voltages, V.
        peak_v: [f64; 3],
        /// Frequency at the beginning, Hz.
        from_hz: f64,
        /// Frequency at the end, Hz.
        to_hz: f64,
    },
}

/// A ramp from 0 to 1 with slope zero at both ends.
fn smooth(f: f64) -> f64 {
    let f = f.clamp(0.0, 1.0);
    f * f * (3.0 - 2.0 * f)
}

impl Drive {
    /// The voltages every 1/`rate_hz` for `duration_s` from time 0 (the staircase and the holds last as long
    /// as they last, then hold their last value).
    ///
    /// # Errors
    /// [`Error::Refused`] for numbers that make no sense.
    pub fn sampled(&self, duration_s: f64, rate_hz: f64) -> Result<Sampled, Error> {
        let count = (duration_s * rate_hz + 1e-9).floor();
        if !(rate_hz > 0.0 && (0.0..1e9).contains(&count)) {
            let text = format!(
                "a drive of {duration_s} s at {rate_hz} Hz is more than 1e9 samples: make it shorter, or its rate lower"
            );
            return Err(Error::Refused(text));
        }
        self.check()?;
        let highest_hz = self.highest_hz();
        if highest_hz > 0.5 * rate_hz {
            let text = format!(
                "a drive of {highest_hz} Hz is lost at {rate_hz} samples a second: state frequencies up to {} Hz, or a higher rate",
                0.5 * rate_hz
            );
            return Err(Error::Refused(text));
        }
        let at_all = |f: &dyn Fn(f64) -> [f64; 3]| -> Vec<[f64; 3]> {
            (0..=count as usize)
                .map(|i| f(i as f64 / rate_hz))
                .collect()
        };
        let samples = match self {
            Drive::Sine {
                peak_v,
                frequency_hz,
                phase_rad,
            } => at_all(&|t| {
                let raise = if *phase_rad == [0.0; 3] {
                    1.0
                } else {
                    smooth(t * frequency_hz)
                };
                [0, 1, 2].map(|k| {
                    let angle = TURN * frequency_hz * t + phase_rad[k];
                    0.5 * peak_v[k] * (1.0 - angle.cos()) * raise
                })
            }),
            Drive::Multisine {
                peak_v,
                frequency_hz,
            } => {
                let n = frequency_hz.len() as f64;
                let raw = at_all(&|t| {
                    [0, 1, 2].map(|k| {
                        frequency_hz
                            .iter()
                            .enumerate()
                            .map(|(i, f)| {
                                let i = i as f64;
                                // Schroeder: -pi i (i + 1)/n; a third of a turn times i more in each chain.
                                let phase =
                                    -0.5 * TURN * i * (i + 1.0) / n + TURN * i * k as f64 / 3.0;
                                (TURN * f * t + phase).sin()
                            })
                            .sum::<f64>()
                    })
                });
                let largest = |k: usize| raw.iter().fold(1e-300_f64, |m, v| m.max(v[k].abs()));
                let scale = [largest(0), largest(1), largest(2)];
                raw.iter()
                    .enumerate()
                    .map(|(i, v)| {
                        let raise = smooth(i as f64 / rate_hz);
                        [0, 1, 2].map(|k| 0.5 * peak_v[k] * (1.0 + v[k] / scale[k]) * raise)
                    })
                    .collect()
            }
            Drive::Staircase {
                peak_v,
                steps,
                hold_s,
                ramp_s,
                repeats,
            } => {
                let stair = (1..=*steps).chain((0..*steps).rev());
                let levels: Vec<([f64; 3], f64)> = (0..*repeats)
                    .flat_map(|_| stair.clone())
                    .map(|s| (peak_v.map(|p| p * s as f64 / *steps as f64), *hold_s))
                    .collect();
                at_all(&|t| held(&levels, *ramp_s, t))
            }
            Drive::Holds { levels, ramp_s } => at_all(&|t| held(levels, *ramp_s, t)),
            Drive::Chirp {
                peak_v,
                from_hz,
                to_hz,
            } => {
                let growth = (to_hz / from_hz).ln() / duration_s.max(f64::MIN_POSITIVE);
                at_all(&|t| {
                    let turns = if growth.abs() < 1e-12 {
                        from_hz * t
                    } else {
                        from_hz * (growth * t).exp_m1() / growth
                    };
                    peak_v.map(|p| 0.5 * p * (1.0 - (TURN * turns).cos()))
                })
            }
        };
        Sampled::new(0.0, 1.0 / rate_hz, samples, Hold::Linear).map_err(Error::Refused)
    }

    /// Time that a staircase or a list of holds takes, s; none for drives without an end.
    pub fn length_s(&self) -> Option<f64> {
        match self {
            Drive::Staircase {
                steps,
                hold_s,
                repeats,
                ..
            } => Some((2 * steps * repeats) as f64 * hold_s),
            Drive::Holds { levels, .. } => Some(levels.iter().map(|l| l.1).sum()),
            _ => None,
        }
    }

    /// Highest frequency that it is told to have, Hz; 0 where it is told none.
    fn highest_hz(&self) -> f64 {
        match self {
            Drive::Sine { frequency_hz, .. } => *frequency_hz,
            Drive::Multisine { frequency_hz, .. } => {
                frequency_hz.iter().copied().fold(0.0, f64::max)
            }
            Drive::Chirp { from_hz, to_hz, .. } => from_hz.max(*to_hz),
            Drive::Staircase { .. } | Drive::Holds { .. } => 0.0,
        }
    }

    fn check(&self) -> Result<(), Error> {
        let positive = |v: &f64| *v > 0.0 && v.is_finite();
        // The ramp is part of the hold.
        let within = |ramp: f64, hold: f64| ramp >= 0.0 && ramp <= hold;
        let (good, what) = match self {
            Drive::Sine { frequency_hz, .. } => (positive(frequency_hz), "the frequency of a sine"),
            Drive::Multisine { frequency_hz, .. } => (
                !frequency_hz.is_empty() && frequency_hz.iter().all(positive),
                "the frequencies of a multisine",
            ),
            Drive::Staircase {
                steps,
                hold_s,
                ramp_s,
                ..
            } => (
                *steps > 0 && positive(hold_s) && within(*ramp_s, *hold_s),
                "steps and hold of a staircase, with a ramp within the hold,",
            ),
            Drive::Holds { levels, ramp_s } => (
                levels
                    .iter()
                    .all(|l| positive(&l.1) && within(*ramp_s, l.1)),
                "the times of holds, with a ramp within each,",
            ),
            Drive::Chirp { from_hz, to_hz, .. } => (
                positive(from_hz) && positive(to_hz),
                "the frequencies of a chirp",
            ),
        };
        if good {
            Ok(())
        } else {
            Err(Error::Refused(format!("{what} must be positive")))
        }
    }
}

/// Voltage at `t` of levels held one after the other, each reached by a smooth ramp at its beginning.
fn held(levels: &[([f64; 3], f64)], ramp_s: f64, t: f64) -> [f64; 3] {
    let mut previous = [0.0; 3];
    let mut begin = 0.0;
    for (level, time) in levels {
        if t < begin + time {
            let f = if ramp_s > 0.0 {
                smooth((t - begin) / ramp_s)
            } else {
                1.0
            };
            return [0, 1, 2].map(|k| previous[k] + f * (level[k] - previous[k]));
        }
        previous = *level;
        begin += time;
    }
    previous
}

/// Turns the sign of a drive every `every_s`: what depends on phi^2 stays, what remembers the polarity
/// (charge in the film, an offset of the amplifier) shows. Flip where the drive is at 0 V, or the film sees a
/// jump.
pub fn flip_polarity(drive: &Sampled, every_s: f64) -> Result<Sampled, Error> {
    if every_s.is_nan() || every_s <= 0.0 {
        return Err(Error::Refused(format!("a flip every {every_s} s")));
    }
    let samples = drive
        .samples_v()
        .iter()
        .enumerate()
        .map(|(i, phi)| {
            let turn = (i as f64 * drive.step_s() / every_s + 1e-9).floor();
            let sign = if turn % 2.0 == 0.0 { 1.0 } else { -1.0 };
            phi.map(|p| sign * p)
        })
        .collect();
    Sampled::new(drive.start_s(), drive.step_s(), samples, drive.hold()).map_err(Error::Refused)
}

/// A horizontal circle about the axis, reached from rest: down to its height, out to its first point, round,
/// each smoothly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Radius, m.
    pub radius_m: f64,
    /// Height uz of the circle, m.
    pub height_m: f64,
    /// Time of one turn, s.
    pub period_s: f64,
    /// Turns at full radius.
    pub turns: f64,
    /// Time of the way down to the height, and once more of the way out to the radius, s.
    pub move_s: f64,
}

/// Position, velocity and acceleration of a quintic step from 0 to 1 within `time`.
fn quintic(t: f64, time: f64) -> [f64; 3] {
    let s = (t / time).clamp(0.0, 1.0);
    [
        s * s * s * (10.0 - 15.0 * s + 6.0 * s * s),
        30.0 * s * s * (1.0 - s) * (1.0 - s) / time,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (time * time),
    ]
}

impl Circle {
    /// The path from `rest_m` on, sampled every 1/`rate_hz`.
    fn path(&self, rest_m: Vec3, payload_kg: f64, rate_hz: f64) -> Track {
        let time = 2.0 * self.move_s + self.turns * self.period_s;
        let count = (time * rate_hz + 1e-9).floor() as usize;
        let mut track = Track {
            step_s: 1.0 / rate_hz,
            position_m: Vec::with_capacity(count + 1),
            velocity_m_s: Vec::with_capacity(count + 1),
            acceleration_m_s2: Vec::with_capacity(count + 1),
            payload_kg: vec![payload_kg; count + 1],
            initial: InitialState::Relaxed,
        };
        let speed = TURN / self.period_s;
        for i in 0..=count {
            let t = i as f64 / rate_hz;
            // Down: from rest to the axis at the height. Out and round: radius r(t) and angle w (t - move).
            let down = quintic(t, self.move_s);
            let out = quintic(t - self.move_s, self.move_s).map(|q| self.radius_m * q);
            let out = if t < self.move_s { [0.0; 3] } else { out };
            let (s, c) = (speed * (t - self.move_s)).sin_cos();
            let [r, r1, r2] = out;
            let way = [-rest_m[0], -rest_m[1], self.height_m - rest_m[2]];
            let line = |n: usize| way.map(|w| w * down[n]);
            let (p, v, a) = (line(0), line(1), line(2));
            track.position_m.push([
                rest_m[0] + p[0] + r * c,
                rest_m[1] + p[1] + r * s,
                rest_m[2] + p[2],
            ]);
            track.velocity_m_s.push([
                v[0] + r1 * c - r * speed * s,
                v[1] + r1 * s + r * speed * c,
                v[2],
            ]);
            let radial = r2 - r * speed * speed;
            let tangential = 2.0 * r1 * speed;
            track.acceleration_m_s2.push([
                a[0] + radial * c - tangential * s,
                a[1] + radial * s + tangential * c,
                a[2],
            ]);
        }
        track
    }

    /// The voltages that lead `robot` with `payload_kg` from rest along the path: f_ID of the planned motion,
    /// branches relaxed at rest.
    ///
    /// # Errors
    /// The first point that is out of reach and by how much, the first that no voltage holds, the first
    /// voltage above `limit_v`.
    pub fn drive(
        &self,
        robot: &Robot,
        parameters: &Parameters,
        payload_kg: f64,
        rate_hz: f64,
        limit_v: f64,
    ) -> Result<PlannedDrive, Error> {
        let positive = [self.radius_m, self.period_s, self.move_s, rate_hz];
        let time = 2.0 * self.move_s + self.turns * self.period_s;
        let good = positive.iter().all(|v| *v > 0.0 && v.is_finite())
            && self.turns >= 0.0
            && time * rate_hz < 1e9
            && self.height_m.is_finite();
        if !good {
            let text = format!("a circle that makes no sense: {self:?} at {rate_hz} Hz");
            return Err(Error::Refused(text));
        }
        let none: [&dyn Addition; 0] = [];
        let start = rest(robot, parameters, [0.0; 3], payload_kg, &none)?;
        let path = self.path(start.position_m, payload_kg, rate_hz);
        drive_along(robot, parameters, path, limit_v)
    }
}
