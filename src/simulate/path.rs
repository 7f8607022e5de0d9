//! Planned paths and the voltages that follow them: the inverse model as a controller uses it.

use super::Error;
use super::voltage::{Hold, Payload, Sampled, Side};
use crate::film::InitialState;
use crate::kinematics::{Mechanism, Vec3};
use crate::model::{Mechanics, Parameters, Robot, Track, Unreachable};

/// A drive through the inverse model, and the path that it is made for.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedDrive {
    /// Voltages.
    pub voltage: Sampled,
    /// The path, at the same times.
    pub path: Track,
}

/// Points of a path and their times; between them runs the natural cubic spline.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedPath {
    time_s: Vec<f64>,
    position_m: Vec<Vec3>,
    /// Second derivatives at the points, m/s^2.
    bend: Vec<Vec3>,
}

impl PlannedPath {
    /// Through `position_m` at rising `time_s`.
    ///
    /// # Errors
    /// [`Error::Refused`] names the first time that does not rise, the first number that is none, and too
    /// short a path.
    pub fn new(time_s: Vec<f64>, position_m: Vec<Vec3>) -> Result<Self, Error> {
        let n = time_s.len();
        if n != position_m.len() || n < 3 {
            let text = format!("a path needs at least 3 points, got {n}");
            return Err(Error::Refused(text));
        }
        for i in 0..n {
            if !time_s[i].is_finite() || !position_m[i].iter().all(|v| v.is_finite()) {
                let [x, y, z] = position_m[i].map(|v| v * 1e3);
                return Err(Error::Refused(format!(
                    "point {} of the path is ({x}, {y}, {z}) mm at {} s: every point needs a time and three coordinates",
                    i + 1,
                    time_s[i]
                )));
            }
            if i > 0 && time_s[i] <= time_s[i - 1] {
                return Err(Error::Refused(format!(
                    "point {} of the path is at {} s, after one at {} s: times must rise",
                    i + 1,
                    time_s[i],
                    time_s[i - 1]
                )));
            }
        }
        // h[i-1] m[i-1] + 2 (h[i-1] + h[i]) m[i] + h[i] m[i+1] = 6 (d[i] - d[i-1]), m = 0 at both ends
        // (Thomas' algorithm).
        let h: Vec<f64> = time_s.windows(2).map(|t| t[1] - t[0]).collect();
        let slope = |i: usize, c: usize| (position_m[i + 1][c] - position_m[i][c]) / h[i];
        let mut bend = vec![[0.0; 3]; n];
        let mut upper = vec![0.0; n];
        for i in 1..n - 1 {
            let pivot = 2.0 * (h[i - 1] + h[i]) - h[i - 1] * upper[i - 1];
            upper[i] = h[i] / pivot;
            for c in 0..3 {
                let right = 6.0 * (slope(i, c) - slope(i - 1, c));
                bend[i][c] = (right - h[i - 1] * bend[i - 1][c]) / pivot;
            }
        }
        for i in (1..n - 1).rev() {
            for c in 0..3 {
                bend[i][c] -= upper[i] * bend[i + 1][c];
            }
        }
        Ok(PlannedPath {
            time_s,
            position_m,
            bend,
        })
    }

    /// First and last time, s.
    pub fn span_s(&self) -> (f64, f64) {
        (self.time_s[0], self.time_s[self.time_s.len() - 1])
    }

    /// Position, velocity and acceleration at `t_s`; the end points hold outside the span.
    pub fn at(&self, t_s: f64) -> [Vec3; 3] {
        let (first, last) = self.span_s();
        let n = self.time_s.len();
        if t_s < first || t_s > last {
            let end = if t_s < first { 0 } else { n - 1 };
            return [self.position_m[end], [0.0; 3], [0.0; 3]];
        }
        let i = self.time_s.partition_point(|&x| x <= t_s).clamp(1, n - 1) - 1;
        let h = self.time_s[i + 1] - self.time_s[i];
        let (b, a) = ((t_s - self.time_s[i]) / h, (self.time_s[i + 1] - t_s) / h);
        let mut out = [[0.0; 3]; 3];
        for c in 0..3 {
            let (p, q) = (self.position_m[i][c], self.position_m[i + 1][c]);
            let (m, n) = (self.bend[i][c], self.bend[i + 1][c]);
            out[0][c] = a * p + b * q + ((a * a * a - a) * m + (b * b * b - b) * n) * h * h / 6.0;
            out[1][c] = (q - p) / h + ((3.0 * b * b - 1.0) * n - (3.0 * a * a - 1.0) * m) * h / 6.0;
            out[2][c] = a * m + b * n;
        }
        out
    }

    /// The path every 1/`rate_hz` from its first time on, the films relaxed there.
    pub fn track(&self, payload: &Payload, rate_hz: f64) -> Track {
        let (first, last) = self.span_s();
        let count = ((last - first) * rate_hz + 1e-9).floor() as usize;
        let mut track = Track {
            step_s: 1.0 / rate_hz,
            position_m: Vec::with_capacity(count + 1),
            velocity_m_s: Vec::with_capacity(count + 1),
            acceleration_m_s2: Vec::with_capacity(count + 1),
            payload_kg: Vec::with_capacity(count + 1),
            initial: InitialState::Relaxed,
        };
        for i in 0..=count {
            let t = i as f64 / rate_hz;
            let [u, v, a] = self.at(first + t);
            track.position_m.push(u);
            track.velocity_m_s.push(v);
            track.acceleration_m_s2.push(a);
            track.payload_kg.push(payload.mass_kg(t, Side::After));
        }
        track
    }
}

/// The voltages that lead `robot` along `path`, f_ID of the planned motion; its first point is time 0.
///
/// # Errors
/// The first point that is out of reach and by how much, the first that no voltage holds, the first voltage
/// above `limit_v`.
pub fn drive_along(
    robot: &Robot,
    parameters: &Parameters,
    path: Track,
    limit_v: f64,
) -> Result<PlannedDrive, Error> {
    super::robot::check_film(&parameters.film)?;
    let at = |i: usize| i as f64 * path.step_s;
    let refuse = |i: usize, why: Unreachable| match why {
        Unreachable::Pose(place) => Error::OutOfReach { at_s: at(i), place },
        Unreachable::Singular { condition, limit } => Error::Singular {
            at_s: at(i),
            position_m: path.position_m[i],
            condition,
            limit,
        },
    };
    let (first, mechanics) = match Mechanics::new(robot, &path) {
        Ok(mechanics) => (mechanics.unreachable.first().copied(), Some(mechanics)),
        Err(first) => (Some(first), None),
    };
    if let Some((i, why)) = first {
        return Err(outside(&robot.mechanism, &path, i).unwrap_or_else(|| refuse(i, why)));
    }
    let mechanics = mechanics.ok_or_else(|| Error::Refused("the path has no point".into()))?;
    let squared = mechanics.phi_squared_v2(parameters).map_err(|place| {
        let locks = |k: &usize| mechanics.film_torque_n_m(*k, parameters).is_err();
        let chain = 1 + (0..3).find(locks).unwrap_or(0);
        Error::Locked { chain, place }
    })?;
    let mut samples = Vec::with_capacity(squared.len());
    for (i, squared) in squared.iter().enumerate() {
        let mut phi = [0.0; 3];
        for k in 0..3 {
            // At rest rounding alone decides the sign (a path written to 0.001 mm: 100 V); as much is
            // nothing.
            if squared[k] < -REST_V * REST_V {
                return Err(Error::NoVoltage {
                    at_s: at(i),
                    position_m: path.position_m[i],
                    chain: k + 1,
                    phi_squared_v2: squared[k],
                });
            }
            phi[k] = squared[k].max(0.0).sqrt();
            if phi[k] > limit_v {
                return Err(Error::VoltageLimit {
                    at_s: at(i),
                    chain: k + 1,
                    phi_v: phi[k],
                    limit_v,
                });
            }
        }
        samples.push(phi);
    }
    let voltage = Sampled::new(0.0, path.step_s, samples, Hold::Linear).map_err(Error::Refused)?;
    Ok(PlannedDrive { voltage, path })
}

/// How far below 0 V a planned pose may lie and still count as held at 0 V, V.
const REST_V: f64 = 100.0;

/// How a path that cannot be taken from point `first` on leaves the workspace; none when it only loses rank
/// there.
fn outside(mechanism: &Mechanism, path: &Track, first: usize) -> Option<Error> {
    let points = &path.position_m;
    let place = points[first..]
        .iter()
        .find_map(|u| mechanism.pose(*u).err())?;
    // The farthest of at most 500 points, and the first.
    let stride = (points.len() - first).div_ceil(500);
    let (farthest, nearest) = (first..points.len())
        .step_by(stride)
        .filter(|&i| mechanism.pose(points[i]).is_err())
        .map(|i| (i, nearest_reach(mechanism, points[i])))
        .max_by(|a, b| {
            let distance = |n: &Option<(f64, &str)>| n.map_or(f64::INFINITY, |n| n.0);
            distance(&a.1).total_cmp(&distance(&b.1))
        })
        .unwrap_or((first, None));
    Some(Error::PathOutside {
        at_s: first as f64 * path.step_s,
        position_m: points[first],
        place: Box::new(place),
        farthest_s: farthest as f64 * path.step_s,
        nearest,
    })
}

/// The shortest straight way (up, down, towards the axis) from `u` to a pose within reach: its length, m, and
/// its name. `None` when there is none within 50 mm.
fn nearest_reach(mechanism: &Mechanism, u: Vec3) -> Option<(f64, &'static str)> {
    let radius = u[0].hypot(u[1]).max(f64::MIN_POSITIVE);
    let ways = [
        ([0.0, 0.0, 1.0], "higher"),
        ([0.0, 0.0, -1.0], "lower"),
        ([-u[0] / radius, -u[1] / radius, 0.0], "nearer to the axis"),
    ];
    let reached = |way: Vec3, d: f64| {
        let pose = [0, 1, 2].map(|i| u[i] + d * way[i]);
        mechanism.pose(pose).is_ok()
    };
    ways.into_iter()
        .filter_map(|(way, name)| {
            let step = 1e-4;
            let hit = (1..=500).find(|&i| reached(way, f64::from(i) * step))?;
            let (mut low, mut high) = (f64::from(hit - 1) * step, f64::from(hit) * step);
            for _ in 0..20 {
                let middle = 0.5 * (low + high);
                if reached(way, middle) {
                    high = middle;
                } else {
                    low = middle;
                }
            }
            Some((high, name))
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
}
