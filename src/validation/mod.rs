//! Finished parameters held against recordings, as the paper does: voltage (Fig 10 C), path (Fig 11), output
//! force (Fig 12) and stroke. Nothing is fitted here but clock offsets that a recording leaves to be
//! estimated.
//!
//! | figure | predicted | held against |
//! |---|---|---|
//! | voltage | inverse dynamics of the measured motion | the command |
//! | path | forward dynamics of the recorded voltages, from rest; or the plan that the voltages were made for | the measured motion |
//! | force | force of the surroundings that motion and voltages ask for | the payload's weight |
//! | stroke | height between lowest and highest pose of the predicted motion | the same of the measured one |

use crate::calibration::{self, Outcome, predict_force, validate_robot_with};
use crate::dataset::Dataset;
use crate::effects::{Acting, When};
use crate::model::{Parameters, Robot};
use crate::simulate::{PlannedPath, predict_motion};
use crate::units::GRAVITY_M_S2;

/// Something that keeps a validation from being done.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The inverse side.
    #[error(transparent)]
    Calibration(#[from] calibration::Error),
    /// A plan that shares no time with its recording.
    #[error(
        "recording `{recording}`: the planned path runs from {} to {} s, the motion from {} to {} s: they must overlap on the motion clock",
        plan_s.0, plan_s.1, motion_s.0, motion_s.1
    )]
    PlanElsewhere {
        /// Recording.
        recording: String,
        /// First and last time of the plan, s.
        plan_s: (f64, f64),
        /// First and last frame, s.
        motion_s: (f64, f64),
    },
}

/// Path errors of the three axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathErrors {
    /// Held against a plan that was given, instead of the forward dynamics.
    pub planned: bool,
    /// Root mean square of measured minus predicted, mm.
    pub rmse_mm: [f64; 3],
    /// The error of largest magnitude, with its sign, mm.
    pub max_mm: [f64; 3],
    /// What relative errors are relative to, mm: the larger extent of the measured path in x and y (the
    /// diameter of a circle), and its stroke in z; NaN for an extent below 1 mm.
    pub relative_to_mm: [f64; 3],
    /// Frames.
    pub frames: usize,
}

/// What a robot with a load on it does at a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// At 0 V, not driven yet.
    Idle,
    /// Driven, and standing still.
    Holding,
    /// Moving.
    Moving,
    /// At 0 V again, and standing still.
    Released,
}

impl Phase {
    /// All, in the order of a recording.
    pub const ALL: [Phase; 4] = [Phase::Idle, Phase::Holding, Phase::Moving, Phase::Released];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Idle => "idle",
            Phase::Holding => "hold",
            Phase::Moving => "move",
            Phase::Released => "released",
        }
    }

    /// Its name in sentences.
    pub fn words(self) -> &'static str {
        match self {
            Phase::Idle => "before the drive",
            Phase::Holding => "holding",
            Phase::Moving => "moving",
            Phase::Released => "released",
        }
    }
}

/// Errors of the predicted force in one phase, N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceErrors {
    /// The phase.
    pub phase: Phase,
    /// Root mean square of the whole vector.
    pub rmse_n: f64,
    /// Its largest magnitude.
    pub max_n: f64,
    /// Root mean square of z.
    pub z_rmse_n: f64,
    /// The z error of largest magnitude, with its sign.
    pub z_max_n: f64,
    /// Root mean square of the resultant in the xy plane.
    pub xy_rmse_n: f64,
    /// Frames.
    pub frames: usize,
}

/// One recording, frame by frame and in figures.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingCheck {
    /// Identity.
    pub id: String,
    /// Time of each frame, s.
    pub time_s: Vec<f64>,
    /// Measured position, mm; NaN in gaps.
    pub measured_mm: Vec<[f64; 3]>,
    /// Predicted (or planned) position, mm; NaN where there is none.
    pub predicted_mm: Vec<[f64; 3]>,
    /// Path errors; none when no frame can be compared.
    pub path: Option<PathErrors>,
    /// Height between lowest and highest pose, mm: measured and predicted (NaN where it is not).
    pub stroke_mm: [f64; 2],
    /// Error of the predicted force, N: with the payload in the balance it should be 0; NaN where it is not
    /// predicted.
    pub force_error_n: Vec<[f64; 3]>,
    /// Weight of the payload and its inertia along z, N.
    pub load_n: Vec<f64>,
    /// Phase of each frame.
    pub phase: Vec<Phase>,
    /// Force errors of the phases that occur.
    pub force: Vec<ForceErrors>,
    /// Largest weight of the payload, N; 0 without one.
    pub largest_load_n: f64,
    /// What a reader should know.
    pub remarks: Vec<String>,
}

/// One set of parameters against recordings.
#[derive(Debug, Clone)]
pub struct Validation {
    /// Voltages.
    pub outcome: Outcome,
    /// Path, force and stroke of each recording.
    pub checks: Vec<RecordingCheck>,
}

/// Speed below which the robot counts as standing still, m/s.
const STILL_M_S: f64 = 2e-3;
/// Voltage below which an actuator counts as not driven, V.
const UNDRIVEN_V: f64 = 50.0;
/// Change of a command within [`HOLD_REACH_S`] to either side up to which it counts as held, V.
const HELD_V: f64 = 5.0;
/// See [`HELD_V`], s.
const HOLD_REACH_S: f64 = 0.25;
/// Left out at both ends of a recording, as in the errors in volts, s.
const ENDS_S: f64 = 0.3;
/// Extent below which an error relative to it says nothing, mm.
const SMALL_EXTENT_MM: f64 = 1.0;

/// Holds `parameters` against `datasets`. `plan` (on the motion clock) replaces the forward dynamics as what
/// the path of the first recording is held against.
///
/// # Errors
/// [`Error`]. A forward prediction that does not begin or ends early is no error; it is said in the remarks.
pub fn validate(
    robot: &Robot,
    datasets: &[&Dataset],
    parameters: &Parameters,
    plan: Option<&PlannedPath>,
    (effects, when): (&[Acting], &[When]),
) -> Result<Validation, Error> {
    let outcome = validate_robot_with(robot, datasets, parameters, effects, when)?;
    let mut checks = Vec::with_capacity(datasets.len());
    for (i, d) in datasets.iter().enumerate() {
        let offset_s = outcome.recordings[i].offset_s;
        let plan = if i == 0 { plan } else { None };
        checks.push(check(
            robot,
            d,
            parameters,
            offset_s,
            plan,
            (effects, when.get(i).copied().unwrap_or_default()),
        )?);
    }
    Ok(Validation { outcome, checks })
}

fn check(
    robot: &Robot,
    d: &Dataset,
    parameters: &Parameters,
    offset_s: f64,
    plan: Option<&PlannedPath>,
    (effects, when): (&[Acting], When),
) -> Result<RecordingCheck, Error> {
    let n = d.samples();
    let time_s: Vec<f64> = (0..n).map(|i| d.time_s(i)).collect();
    let measured_mm: Vec<[f64; 3]> = d.measured_m.iter().map(|u| u.map(|v| v * 1e3)).collect();
    let mut remarks = Vec::new();
    let forward_mm: Vec<[f64; 3]> =
        match predict_motion(robot, d, parameters, offset_s, effects, when) {
            Ok(f) => {
                if let Some((i, why)) = &f.ended {
                    remarks.push(format!(
                        "{}: the predicted motion ends at {:.2} s: {why}.",
                        d.id, time_s[*i]
                    ));
                }
                f.position_m.iter().map(|u| u.map(|v| v * 1e3)).collect()
            }
            Err(why) => {
                remarks.push(format!("{}: no motion can be predicted: {why}.", d.id));
                vec![[f64::NAN; 3]; n]
            }
        };
    let captured = |k: usize| {
        let position = &d.axes[k].position;
        (0..n).filter(|&i| d.captured(i)).map(|i| position[i])
    };
    let stroke_mm = [
        1e3 * extent(captured(2)),
        extent(forward_mm.iter().map(|u| u[2])),
    ];
    let predicted_mm = match plan {
        None => forward_mm,
        Some(plan) => {
            let (first, last) = plan.span_s();
            let motion_s = (time_s[0], time_s[n - 1]);
            if first >= motion_s.1 || last <= motion_s.0 {
                return Err(Error::PlanElsewhere {
                    recording: d.id.clone(),
                    plan_s: (first, last),
                    motion_s,
                });
            }
            let planned = |t: f64| match (first..=last).contains(&t) {
                true => plan.at(t)[0].map(|v| v * 1e3),
                false => [f64::NAN; 3],
            };
            time_s.iter().map(|&t| planned(t)).collect()
        }
    };
    let edge = (ENDS_S / d.step_s).round() as usize;
    let counts = |i: usize| i >= edge && i + edge < n && d.captured(i);
    let path = path_errors(d, &measured_mm, &predicted_mm, counts, plan.is_some());
    let force_error_n = predict_force(robot, d, parameters, offset_s, effects, when)?;
    let track = d.track();
    let load_n: Vec<f64> = (0..n)
        .map(|i| d.payload_kg[i] * (GRAVITY_M_S2 + track.acceleration_m_s2[i][2]))
        .collect();
    let phase = phases(d, &track.velocity_m_s, offset_s);
    let force = Phase::ALL
        .into_iter()
        .filter_map(|p| {
            let frames: Vec<[f64; 3]> = (0..n)
                .filter(|&i| counts(i) && phase[i] == p && !d.film_unknown[i])
                .map(|i| force_error_n[i])
                .filter(|f| !f[0].is_nan())
                .collect();
            force_errors(p, &frames)
        })
        .collect();
    let heaviest = d.payload_kg.iter().copied().fold(0.0, f64::max);
    Ok(RecordingCheck {
        id: d.id.clone(),
        time_s,
        measured_mm,
        predicted_mm,
        path,
        stroke_mm,
        force_error_n,
        load_n,
        phase,
        force,
        largest_load_n: heaviest * GRAVITY_M_S2,
        remarks,
    })
}

/// Largest minus smallest of the values that are numbers; NaN without any.
fn extent(values: impl Iterator<Item = f64>) -> f64 {
    let (low, high) = values
        .filter(|v| !v.is_nan())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        });
    if high >= low { high - low } else { f64::NAN }
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
    (sum / count as f64).sqrt()
}

/// The value of largest magnitude, with its sign.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m })
}

fn path_errors(
    d: &Dataset,
    measured_mm: &[[f64; 3]],
    predicted_mm: &[[f64; 3]],
    counts: impl Fn(usize) -> bool,
    planned: bool,
) -> Option<PathErrors> {
    let errors: Vec<[f64; 3]> = (0..measured_mm.len())
        .filter(|&i| counts(i) && !predicted_mm[i][0].is_nan())
        .map(|i| [0, 1, 2].map(|k| measured_mm[i][k] - predicted_mm[i][k]))
        .collect();
    if errors.is_empty() {
        return None;
    }
    // Of the smoothed motion, so that noise makes no path.
    let captured = |k: usize| {
        let position = &d.axes[k].position;
        (0..d.samples())
            .filter(|&i| d.captured(i))
            .map(|i| position[i])
    };
    let [x, y, z] = [0, 1, 2].map(|k| 1e3 * extent(captured(k)));
    let size = |v: f64| if v < SMALL_EXTENT_MM { f64::NAN } else { v };
    let diameter = size(x.max(y));
    Some(PathErrors {
        planned,
        rmse_mm: [0, 1, 2].map(|k| root_mean_square(errors.iter().map(|e| e[k]))),
        max_mm: [0, 1, 2].map(|k| largest(errors.iter().map(|e| e[k]))),
        relative_to_mm: [diameter, diameter, size(z)],
        frames: errors.len(),
    })
}

fn force_errors(phase: Phase, frames: &[[f64; 3]]) -> Option<ForceErrors> {
    if frames.is_empty() {
        return None;
    }
    let size = |f: &[f64; 3]| (f[0] * f[0] + f[1] * f[1] + f[2] * f[2]).sqrt();
    Some(ForceErrors {
        phase,
        rmse_n: root_mean_square(frames.iter().map(size)),
        max_n: largest(frames.iter().map(size)),
        z_rmse_n: root_mean_square(frames.iter().map(|f| f[2])),
        z_max_n: largest(frames.iter().map(|f| f[2])),
        xy_rmse_n: root_mean_square(frames.iter().map(|f| f[0].hypot(f[1]))),
        frames: frames.len(),
    })
}

/// Standing still, and its voltages held: holding when driven, else idle before the first drive and released
/// after it.
fn phases(d: &Dataset, velocity_m_s: &[[f64; 3]], offset_s: f64) -> Vec<Phase> {
    let n = d.samples();
    let command: Vec<[f64; 3]> = (0..n)
        .map(|i| [0, 1, 2].map(|k| d.command_v(k, i, offset_s)))
        .collect();
    let reach = (HOLD_REACH_S / d.step_s).ceil() as usize;
    let mut driven_before = false;
    (0..n)
        .map(|i| {
            let driven = command[i].iter().any(|v| v.abs() > UNDRIVEN_V);
            driven_before |= driven;
            let around = &command[i.saturating_sub(reach)..(i + reach + 1).min(n)];
            let held = (0..3).all(|k| extent(around.iter().map(|c| c[k])) <= HELD_V);
            let [x, y, z] = velocity_m_s[i];
            if !held || (x * x + y * y + z * z).sqrt() >= STILL_M_S {
                Phase::Moving
            } else if driven {
                Phase::Holding
            } else if driven_before {
                Phase::Released
            } else {
                Phase::Idle
            }
        })
        .collect()
}
