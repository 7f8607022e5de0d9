//! The base marker is to stand still: a base that moves or drifts takes the frame along.

use super::exchanged::wander;
use super::linear::quantile;
use super::view::{View, middle};
use super::{Findings, Grade};

/// Drift from which on it is said, and from which on positions are no longer what they are taken for, m. A
/// marker's calibration wanders by tenths of a millimetre; the largest wander of the capture among left-out
/// causes is 0.3 mm.
const SAID_M: f64 = 0.5e-3;
const WRONG_M: f64 = 2e-3;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some(m) = &view.recording.motion else {
        return;
    };
    let Some(base) = &m.base else { return };
    let si = m.unit.to_si;
    let n = base.xyz.len();
    let tenth = (n / 10).max(1);
    let (Some(first), Some(last), Some(here)) = (
        middle(&base.xyz[..tenth]),
        middle(&base.xyz[n - tenth..]),
        middle(&base.xyz),
    ) else {
        return;
    };
    let drift = (0..3)
        .map(|k| (last[k] - first[k]).powi(2))
        .sum::<f64>()
        .sqrt()
        * si;
    let moves = wander(&base.xyz, &here) * si;
    // White noise of a capture moves a marker by twice its size in 9 of 10 frames.
    let noise = (0..3)
        .map(|k| {
            let jump = base.xyz.windows(2).map(|w| (w[1][k] - w[0][k]).abs());
            quantile(jump, 0.5) * si / 0.954
        })
        .fold(0.0, f64::max);
    if found.wrong(&["exchanged", "sentinel"]) {
        return;
    }
    let remedy = "fix the base marker to the robot's frame, or leave `base` out and calibrate the capture at the start";
    if moves.max(drift) > WRONG_M && moves > 6.0 * noise {
        found.add(
            "base",
            Grade::Wrong,
            format!(
                "marker {} is to be fixed to the frame, and moves by {:.2} mm",
                base.label,
                1e3 * moves.max(drift)
            ),
            remedy,
        );
    } else if drift > SAID_M && drift > 6.0 * noise {
        found.add(
            "base",
            Grade::Doubtful,
            format!(
                "marker {} is to be fixed to the frame, and drifts by {:.2} mm from beginning to end",
                base.label,
                1e3 * drift
            ),
            remedy,
        );
    }
}
