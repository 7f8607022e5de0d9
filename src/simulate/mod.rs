//! Simulated recordings: known parameters to motion, and to the files that instruments would have written.
//! This room lies in a known way, with a seed.
//!
//! | what | where |
//! |---|---|
//! | forward dynamics of the robot, phi_k(t) to u(t) | [`motion`], [`motion_as_far`], [`rest`] |
//! | hanging film sample, both ways | [`sample_motion`], [`sample_phi_squared_v2`], [`sample_rest`] |
//! | what else acts on the robot | [`Addition`] |
//! | a motion with causes of the catalogue | [`motion_with_effects`], made of [`effect_addition`], [`effect_robot`], [`effect_reading`], [`EffectClock`] |
//! | the motion that the voltages of a recording make | [`predict_motion`] |
//! | built-in drives, a path or a circle through the inverse model | [`Drive`], [`PlannedPath`], [`Circle`], [`flip_polarity`] |
//! | the files of a recording, with noise and a seed | [`mod@write`] |
//! | voltages and payload over time | [`Voltage`], [`Sampled`], [`Payload`] |

#![allow(clippy::needless_range_loop)] // indices are those of the equations

mod addition;
mod branches;
mod drive;
mod effects;
mod integrator;
mod path;
mod recorded;
mod robot;
mod sample;
mod voltage;
pub mod write;

pub use addition::{Action, Addition, Situation};
pub use drive::{Circle, DEFAULT_RATE_HZ, Drive, flip_polarity};
pub use effects::{
    EffectClock, effect_addition, effect_reading, effect_robot, motion_with_effects,
};
pub use integrator::Effort;
pub use path::{PlannedDrive, PlannedPath, drive_along};
pub use recorded::{PredictedMotion, predict_motion, predict_motions};
pub use robot::{Energy, Motion, Options, Rest, Start, motion, motion_as_far, rest};
pub use sample::{
    SampleMotion, SampleOptions, SampleRest, SampleTrack, Stretches, sample_motion,
    sample_phi_squared_v2, sample_rest,
};
pub use voltage::{Hold, Payload, Sampled, Side, Smooth, Softened, Voltage};

use crate::film::Locked;
use crate::kinematics::{OutOfReach, Vec3};

/// Why a simulation could not be done, and where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The mechanism cannot follow.
    #[error("at {at_s:.4} s the robot leaves its workspace: {place}")]
    OutOfReach {
        /// Time, s.
        at_s: f64,
        /// Pose, chain, joint and both values.
        place: OutOfReach,
    },
    /// A planned path leaves the workspace.
    #[error(
        "from {at_s:.4} s on, at {}, the path is outside the workspace: {place}; it goes farthest out at {farthest_s:.4} s{}",
        millimetres(position_m),
        nearest.map_or(String::new(), |(d, way)| format!(", where the nearest pose within reach is {:.3} mm {way}", d * 1e3))
    )]
    PathOutside {
        /// Time of its first point that cannot be taken, s.
        at_s: f64,
        /// That point, m.
        position_m: Vec3,
        /// The first point out of reach: chain, joint and both values.
        place: Box<OutOfReach>,
        /// Time of the point that is farthest from a pose within reach, s.
        farthest_s: f64,
        /// How far that one is, m, and which way; none beyond 50 mm.
        nearest: Option<(f64, &'static str)>,
    },
    /// G loses rank: the actuators hold no force in one direction.
    #[error(
        "at {at_s:.4} s, at {}, the actuators hold no force in one direction: the levers d theta_DEA/du have condition number {condition:.3e} (limit {limit:.0e})",
        millimetres(position_m)
    )]
    Singular {
        /// Time, s.
        at_s: f64,
        /// Pose, m.
        position_m: Vec3,
        /// Condition number of G.
        condition: f64,
        /// What is still accepted.
        limit: f64,
    },
    /// A step went through a pose at which G loses rank: the mechanism has flipped.
    #[error(
        "before {at_s:.4} s, at {}, the robot went through a pose at which the actuators hold no force in one direction, and flipped",
        millimetres(position_m)
    )]
    Flipped {
        /// Time, s.
        at_s: f64,
        /// Pose after it, m.
        position_m: Vec3,
    },
    /// No direction holds: the stiffness is indefinite even with the branches frozen.
    #[error(
        "at {at_s:.4} s, at {}, the robot snaps through: its smallest stiffness is {stiffness_n_m:.3} N/m",
        millimetres(position_m)
    )]
    SnapThrough {
        /// Time, s.
        at_s: f64,
        /// Pose, m.
        position_m: Vec3,
        /// Smallest eigenvalue of the stiffness, N/m.
        stiffness_n_m: f64,
    },
    /// There is no stable rest pose.
    #[error(
        "no stable rest under ({:.0}, {:.0}, {:.0}) V with {:.3} g: there is one only up to {:.1} % of payload and squared voltage, at {}: {why}",
        phi_v[0], phi_v[1], phi_v[2], payload_kg * 1e3, share * 100.0, millimetres(position_m)
    )]
    NoRest {
        /// Voltages asked for, V.
        phi_v: [f64; 3],
        /// Payload asked for, kg.
        payload_kg: f64,
        /// Share of phi^2 and payload up to which there is a rest.
        share: f64,
        /// Pose there, m.
        position_m: Vec3,
        /// What stands in the way.
        why: String,
    },
    /// A film reaches its locking stretch.
    #[error("chain {chain}: {place}")]
    Locked {
        /// Chain (or part of a film sample), 1 to 3.
        chain: usize,
        /// Spring, invariant and time.
        place: Locked,
    },
    /// A part of a film sample reaches its locking stretch.
    #[error("{part} of the sample: {place}")]
    LockedPart {
        /// Which part.
        part: &'static str,
        /// Spring, invariant and time.
        place: Locked,
    },
    /// A film sample gives way under voltage and load (pull-in).
    #[error(
        "at {at_s:.4} s the sample gives way at a length of {:.3} mm: its stiffness falls to {stiffness_n_m:.1e} N/m",
        length_m * 1e3
    )]
    SampleUnstable {
        /// Time, s.
        at_s: f64,
        /// Length of the sample, m.
        length_m: f64,
        /// Stiffness at the end, N/m.
        stiffness_n_m: f64,
    },
    /// A voltage above what is allowed.
    #[error(
        "at {at_s:.4} s chain {chain} is given {phi_v:.3} V, above the limit of {limit_v:.3} V"
    )]
    VoltageLimit {
        /// Time, s.
        at_s: f64,
        /// Chain, 1 to 3.
        chain: usize,
        /// The voltage, V.
        phi_v: f64,
        /// The limit, V.
        limit_v: f64,
    },
    /// No voltage holds a planned pose.
    #[error(
        "at {at_s:.4} s, at {}, no voltage of chain {chain} holds the path: phi^2 would be {phi_squared_v2:.4e} V^2",
        millimetres(position_m)
    )]
    NoVoltage {
        /// Time, s.
        at_s: f64,
        /// Pose, m.
        position_m: Vec3,
        /// Chain, 1 to 3.
        chain: usize,
        /// What the balance asks for, V^2.
        phi_squared_v2: f64,
    },
    /// No step is short enough for the integrator, or so many that the end is not in sight.
    #[error(
        "the integration does not get beyond {at_s:.6} s, at {}",
        millimetres(position_m)
    )]
    Stuck {
        /// Time, s.
        at_s: f64,
        /// Pose, m.
        position_m: Vec3,
    },
    /// The question makes no sense.
    #[error("{0}")]
    Refused(String),
}

impl Error {
    /// What a user can do about it; empty where the message says it all.
    pub fn advice(&self) -> &'static str {
        match self {
            Error::OutOfReach { .. }
            | Error::PathOutside { .. }
            | Error::Singular { .. }
            | Error::Flipped { .. } => {
                "keep the path and the voltages within the workspace of the rig, or check the rig's lengths and angles"
            }
            Error::SnapThrough { .. } => "lower the voltages or the payload",
            Error::NoRest { share, .. } if *share > 0.0 => {
                "lower the payload or the first voltages to that share"
            }
            Error::NoRest { .. } => {
                "check the rig's film (L1, L2, L3, dea_offset) against the moduli of the parameter file"
            }
            Error::Locked { .. } | Error::LockedPart { .. } => {
                "lower the voltages, or check J of the parameter file"
            }
            Error::SampleUnstable { .. } => "lower the voltage or the load",
            Error::VoltageLimit { .. } => {
                "shrink or slow the path, lower the drive, or raise the limit if the amplifier and the film bear it"
            }
            Error::NoVoltage { .. } => {
                "films only push the end effector down: lower the payload, or keep the path below the rest pose and slow enough"
            }
            Error::Stuck { .. } => {
                "lower the voltages, make their steps smaller, or check the sizes of [[effect]] and --effect"
            }
            Error::Refused(_) => "",
        }
    }
}

fn millimetres(u: &Vec3) -> String {
    format!(
        "({:.3}, {:.3}, {:.3}) mm",
        u[0] * 1e3,
        u[1] * 1e3,
        u[2] * 1e3
    )
}
