//! The jobs: which parameters are free on which recordings, from the starts to an outcome that can be shown
//! and written.
//!
//! Stages as in the paper: the film from symmetric drives, the forearm from single-actuator drives with the
//! film held, both jointly from everything. All three are the same fit with other parameters fixed.

mod across;
mod aged;
mod aged_robot;
mod aged_sample;
mod ageing;
mod coupon;
mod joint;
mod line;
mod motion;
mod outcome;
mod robot;
mod sample;
mod sample_problem;
mod solution;
mod statistics;
mod stroke;

pub use across::{Across, BatchMiddle, Drift, Estimated, StandsOut, across};
pub use aged::{Cause, LevelModel};
pub use aged_robot::LONG_AGO_S;
pub use ageing::{
    ASSUMED_SCATTER, AgeingInput, AgeingOutcome, AgeingRequest, AgeingSubject, By, CYCLES,
    Difference, ElectrodeAgeing, LevelStroke, Run, SampleAgeing, Trend, ageing, doubtful, named,
    open, words,
};
pub use coupon::{
    CouponFit, CouponOutcome, CouponPlace, CouponRequest, CouponTotal, calibrate_coupons,
    validate_coupons,
};
pub use joint::{CauseFound, Joint};
pub use line::{
    AxisCause, Forward, LineFit, LineModel, LineOutcome, LineRequest, calibrate_lines,
    predict_line, validate_lines,
};
pub use motion::{AxisMotion, Causes, MotionRequest, calibrate_motion, predict_line_motion};
pub use outcome::{
    AtBound, ChainError, Estimate, JUDGED_ABOVE_V, Outcome, RecordingOutcome, Standing,
    StartOutcome, WeakDirection, WorstPlace,
};
pub use robot::{
    Request, Stage, calibrate_robot, predict_command, predict_force, validate_robot,
    validate_robot_with,
};
pub use sample::{
    SampleFit, SampleOutcome, SampleRequest, Scale, calibrate_samples, predict_sample_motion,
    validate_samples,
};
pub use statistics::Uncertainty;
pub use stroke::{CycleStroke, Strokes, Value, strokes};

/// Something that a calibration cannot do.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A name given to `--fix` or `--bound` does not exist.
    #[error("there is no parameter `{name}`{}; there are: {known}", nearest.as_ref().map(|n| format!(", nearest is `{n}`")).unwrap_or_default())]
    UnknownParameter {
        /// As given.
        name: String,
        /// The nearest that exists.
        nearest: Option<String>,
        /// All that exist.
        known: String,
    },
    /// A value or bound that cannot be.
    #[error("parameter `{name}`: {what}")]
    BadValue {
        /// Parameter.
        name: String,
        /// What is wrong, with both values.
        what: String,
    },
    /// A recording whose poses the mechanism cannot take.
    #[error(
        "recording `{recording}`, frame at {time_s:.3} s: {why}; check the rig's lengths, base_position_mm, end_effector_offset_mm and rotation_deg"
    )]
    Unreachable {
        /// Recording.
        recording: String,
        /// Time of the first such frame, s.
        time_s: f64,
        /// The model's own words.
        why: String,
    },
    /// The fit has nothing to work on.
    #[error("{0}")]
    NothingToFit(String),
    /// No start led anywhere.
    #[error("no start could be evaluated ({tried} tried); the last one said: {last}")]
    AllStartsFailed {
        /// Number of starts.
        tried: usize,
        /// What the last failure said.
        last: String,
    },
    /// The film locks at the parameters that were given.
    #[error("{0}")]
    Locked(#[from] crate::film::Locked),
    /// An axis that cannot be run forward.
    #[error("{0}")]
    Forward(#[from] crate::residual::motion::Trouble),
}
