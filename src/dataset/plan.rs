//! The choices that turned a recording into a dataset, written beside every result and read back to repeat them.

use serde::{Deserialize, Serialize};

use super::smoother::AxisChoice;

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
}

impl SmoothingPlan {
    pub(super) fn of(choice: &AxisChoice) -> Self {
        SmoothingPlan {
            order: choice.order,
            cutoff_hz: choice.cutoff_hz,
            noise_mm: choice.noise * 1e3,
        }
    }
}
