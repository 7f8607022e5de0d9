//! The choices that turned a recording into a dataset, written beside every result and read back to repeat
//! them.

use serde::{Deserialize, Serialize};

use super::smoother::AxisChoice;
use super::sync::Clocks;

/// How order and cutoff are chosen where nobody fixed them.
pub const CRITERION: &str =
    "largest likelihood of an integrated Wiener process seen through white noise (order 3 or 4)";

/// Choices for one recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Identity of the recording.
    pub recording: String,
    /// Smoothing of x, y and z.
    pub smoothing: Vec<SmoothingPlan>,
    /// What chose it.
    #[serde(default)]
    pub criterion: String,
    /// Clock offset that is kept fixed, s (voltage clock minus motion clock); absent when it is estimated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset_s: Option<f64>,
    /// How the offset was found, where not by a fit or by statement; and the skew of the clocks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sync: Option<SyncPlan>,
    /// The stretches that a fit compares, where it does not hold the whole recording.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretches: Option<StretchPlan>,
}

/// Stretches of a long recording, evenly spread: the first begins with it, the last ends with it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StretchPlan {
    /// Their number.
    pub count: usize,
    /// Length of each, s.
    pub length_s: f64,
}

/// What offset and skew of the clocks were told from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SyncPlan {
    /// `events` or `shared channel`.
    pub method: String,
    /// Standard error of the offset, s; absent where a single event tells it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset_std_error_s: Option<f64>,
    /// How much faster the voltage clock runs, in millionths; 0 where that is not told from 0.
    pub skew_ppm: f64,
    /// Its standard error, in millionths.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skew_std_error_ppm: Option<f64>,
    /// Where on the motion clock the offset is that, s; a skewed clock has another elsewhere.
    pub middle_s: f64,
}

impl SyncPlan {
    pub(super) fn of(method: &str, clocks: &Clocks) -> Self {
        SyncPlan {
            method: method.to_owned(),
            offset_std_error_s: clocks.offset_std_error_s,
            skew_ppm: clocks.skew * 1e6,
            skew_std_error_ppm: clocks.skew_std_error.map(|e| e * 1e6),
            middle_s: clocks.middle_s,
        }
    }
}

/// Smoothing of one axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SmoothingPlan {
    /// Order of the process: 3 (quintic spline) or 4 (septic spline).
    pub order: usize,
    /// Half-power frequency, Hz.
    pub cutoff_hz: f64,
    /// Capture noise found, mm.
    pub noise_mm: f64,
    /// Whether it follows the axis that moves most: a sum of that one's motion and of its square is taken off
    /// before it is smoothed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub follows: bool,
}

impl SmoothingPlan {
    pub(super) fn of(choice: &AxisChoice) -> Self {
        SmoothingPlan {
            order: choice.order,
            cutoff_hz: choice.cutoff_hz,
            noise_mm: choice.noise * 1e3,
            follows: choice.follows,
        }
    }
}
