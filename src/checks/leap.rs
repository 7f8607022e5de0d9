//! Leaps of a marker: rows that are lost in a file that counts its frames anew, a marker that was knocked or
//! taken for another, and single samples that stick out.

use super::glance::{Glance, STEP_S, Ties};
use super::linear::quantile;
use super::view::{View, short};
use super::{Findings, Grade};
use crate::kinematics::Vec3;

/// A leap is so many times the step that 199 of 200 do not exceed, and longer than this, m.
const LEAPS: f64 = 4.0;
const LEAST_M: f64 = 0.5e-3;
/// Frames around it that have to be ordinary.
const CALM: usize = 6;
/// Where the drive changes by more than this share of its range within 0.3 s of the leap, the robot was
/// kicked.
const KICK: f64 = 0.1;
/// More leaps than this in a recording are its way of moving.
const FEW: usize = 6;
/// A lost stretch of rows is looked for up to this length, s.
const LOST_S: f64 = 5.0;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some(m) = &view.recording.motion else {
        return;
    };
    if found.wrong(&["sentinel", "frozen", "exchanged", "noise", "unit"]) {
        return;
    }
    let si = m.unit.to_si;
    let xyz = &m.end_effector.xyz;
    let distance =
        |a: &Vec3, b: &Vec3| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt() * si;
    let steps: Vec<f64> = xyz.windows(2).map(|w| distance(&w[0], &w[1])).collect();
    let usual = quantile(steps.iter().copied(), 0.995);
    let limit = (LEAPS * usual).max(LEAST_M);
    let big: Vec<usize> = (0..steps.len()).filter(|&i| steps[i] > limit).collect();
    let stays = |i: usize| {
        // i to i + 1 is the leap; what follows and what was before is calm and on its own side
        let before = i.saturating_sub(CALM)..i;
        let after = i + 1..(i + 1 + CALM).min(steps.len());
        before.len() >= CALM / 2
            && after.len() >= CALM / 2
            && before
                .chain(after)
                .all(|j| steps[j].is_finite() && steps[j] < 0.5 * limit)
    };
    let leaps: Vec<usize> = big
        .iter()
        .copied()
        .filter(|&i| stays(i) && !kicked(view, m.time_s[i]))
        .collect();
    if let Some(&i) = leaps.first()
        && leaps.len() <= FEW
    {
        let at_s = m.time_s[i];
        let what = format!(
            "marker {} leaps by {:.2} mm from one frame to the next at {at_s:.3} s{}, where 199 of 200 steps are below {:.2} mm and nothing happened to the voltages",
            m.end_effector.label,
            steps[i] * 1e3,
            if leaps.len() > 1 {
                format!(" (and {} times more)", leaps.len() - 1)
            } else {
                String::new()
            },
            usual * 1e3
        );
        match view.glance.as_ref().and_then(|g| lost(g, at_s)) {
            Some((lost_s, before, after)) if leaps.len() == 1 => found.add(
                "rows_lost",
                Grade::Wrong,
                format!(
                    "{what}: {} s of rows look lost there; with them left out of the voltages too, what of the drive the motion leaves unexplained falls from {} to {}",
                    short(lost_s),
                    super::view::per_cent(before.sqrt()),
                    super::view::per_cent(after.sqrt())
                ),
                "get the whole file; or cut the recording there and use the longer part",
            ),
            _ => found.add(
                "leap",
                Grade::Wrong,
                what,
                "look at the capture there: rows are lost, or the marker was knocked or taken for another; cut the recording there, or leave the frames empty",
            ),
        }
    }
    let single: Vec<usize> = (1..xyz.len().saturating_sub(1))
        .filter(|&i| {
            let there = steps[i - 1].min(steps[i]);
            there > limit && distance(&xyz[i - 1], &xyz[i + 1]) < 0.3 * there
        })
        .collect();
    if let Some(&worst) = single
        .iter()
        .max_by(|a, b| steps[**a].total_cmp(&steps[**b]))
    {
        found.add(
            "spikes",
            Grade::Doubtful,
            format!(
                "marker {} sticks out in {} single frames, the worst by {:.2} mm at {:.3} s",
                m.end_effector.label,
                single.len(),
                steps[worst] * 1e3,
                m.time_s[worst]
            ),
            "look for reflections; frames that stick out of the path by ten times the noise are left out of every fit",
        );
    }
}

/// Whether a voltage changes fast around `at_s` on the motion's clock.
fn kicked(view: &View<'_>, at_s: f64) -> bool {
    let Some(v) = &view.recording.voltage else {
        return false;
    };
    let offset = match view.recording.manifest.offset_s {
        crate::recording::NumberOrEstimate::Number(s) => s,
        crate::recording::NumberOrEstimate::Estimate => return false,
    };
    let near = |share: f64| v.time_s.partition_point(|t| *t < at_s + offset + share);
    let (from, to) = (near(-0.3), near(0.1));
    v.channels.iter().any(|c| {
        let span = |values: &[f64]| {
            let finite = || values.iter().copied().filter(|x| x.is_finite());
            finite().fold(f64::NEG_INFINITY, f64::max) - finite().fold(f64::INFINITY, f64::min)
        };
        // as fast as a step: most of the change within a tenth of the window
        let whole = span(c);
        let short = ((to - from) / 10).max(1);
        from < to
            && c[from..to]
                .windows(short + 1)
                .any(|w| span(w) > KICK * whole)
    })
}

/// The length of rows that are lost at `at_s`, and the shares that are left before and after.
fn lost(glance: &Glance, at_s: f64) -> Option<(f64, f64, f64)> {
    let poses = glance.poses(&glance.positions_m(|v| v), Ties::Each)?;
    let n = glance.len();
    let at = ((at_s - glance.start_s) / STEP_S).round() as usize;
    if at < 40 || at + 40 > n {
        return None;
    }
    let most = (LOST_S / STEP_S) as usize;
    let squared = glance.squared_from_v2(glance.start_s + glance.offset_s?, n + most);
    let left = |by: usize| {
        let shifted: [Vec<f64>; 3] = [0, 1, 2].map(|k| {
            let mut v = squared[k][..at].to_vec();
            v.extend_from_slice(&squared[k][at + by..n + by]);
            v
        });
        poses.look([&shifted[0], &shifted[1], &shifted[2]]).left
    };
    let before = left(0);
    let (best, after) = (1..most)
        .map(|by| (by, left(by)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    (4.0 * after < before).then_some((STEP_S * best as f64, before, after))
}
