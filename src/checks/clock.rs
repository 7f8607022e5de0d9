//! Clocks and rates: how long motion and voltage are, and when the motion follows the voltage best.

use super::glance::{Glance, Look, Poses, STEP_S};
use super::view::{View, short};
use super::wiring::Hypothesis;
use super::{Findings, Grade};
use crate::recording::{NumberOrEstimate, RawMotion};

/// Ratios of clocks that come of wrong units and rates.
const RATIOS: [f64; 16] = [
    1000.0,
    1e-3,
    60.0,
    1.0 / 60.0,
    10.0,
    0.1,
    5.0,
    0.2,
    4.0,
    0.25,
    2.5,
    0.4,
    2.0,
    0.5,
    1.2,
    1.0 / 1.2,
];
/// Lengths that differ by less than this share are those of two people who press two buttons.
const ALIKE: f64 = 0.1;
/// An offset up to this is left to a fit, s: the largest of the catalogue is 0.12 s.
const LEAST_S: f64 = 0.3;
/// What motion and voltage have to share, of the shorter one.
const SHARED: f64 = 0.4;
/// Motion outside the voltage's log that is as large as this share of that inside was driven.
const DRIVEN: f64 = 0.3;

/// Ratios of the clocks of voltage and motion: what the voltage's times look like, and a remedy.
const UNITS: [(f64, &str, &str); 4] = [
    (
        1000.0,
        "milliseconds",
        "state time_unit = \"ms\" for the voltage's time under [voltage]",
    ),
    (
        1e6,
        "microseconds",
        "state time_unit = \"us\" for the voltage's time under [voltage]",
    ),
    (
        1e-3,
        "kiloseconds, or the motion's in milliseconds",
        "look at the unit of the motion's time",
    ),
    (1.0 / 60.0, "minutes", "put the voltage's time into seconds"),
];

/// What the lengths alone tell.
pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some([motion_s, voltage_s]) = view.lengths_s() else {
        return;
    };
    let r = view.recording;
    let (Some(m), Some(v)) = (&r.motion, &r.voltage) else {
        return;
    };
    if motion_s <= 0.0 || voltage_s <= 0.0 {
        return;
    }
    // a clock in other units
    for (ratio, what, remedy) in UNITS {
        let share = voltage_s / (ratio * motion_s);
        if (0.5..2.0).contains(&share) && !(0.1..=10.0).contains(&ratio) {
            found.add(
                "rate",
                Grade::Wrong,
                format!(
                    "the voltage runs for {} s and the motion for {} s: the voltage's times look like {what}",
                    short(voltage_s),
                    short(motion_s)
                ),
                remedy,
            );
            return;
        }
    }
    let offset = match r.manifest.offset_s {
        NumberOrEstimate::Number(s) => s,
        NumberOrEstimate::Estimate => return,
    };
    // motion where no voltage was logged
    let (first, last) = (v.time_s[0] - offset, v.time_s[v.time_s.len() - 1] - offset);
    let (start, end) = (m.time_s[0], m.time_s[m.time_s.len() - 1]);
    if first > end || last < start {
        let says = format!(
            "the motion runs from {} to {} s and the voltage from {} to {} s on the motion's clock: they share no time",
            short(start),
            short(end),
            short(first),
            short(last)
        );
        found.add(
            "clock",
            Grade::Wrong,
            says,
            "set [sync] offset_s to the voltage clock minus the motion clock, or to \"estimate\" where that is below 5 s",
        );
        return;
    }
    let covered = last.min(end) - first.max(start);
    if covered > (1.0 - ALIKE) * motion_s {
        return;
    }
    uncovered(m, [first, last], covered, [motion_s, voltage_s], found);
}

/// Says how much of the motion the voltage covers, from when to when on its clock, and whether the rest was
/// driven.
fn uncovered(
    m: &RawMotion,
    [first, last]: [f64; 2],
    covered: f64,
    [motion_s, voltage_s]: [f64; 2],
    found: &mut Findings,
) {
    let spread = |inside: bool| {
        let mut most: f64 = 0.0;
        for k in 0..3 {
            let at = m.time_s.iter().zip(&m.end_effector.xyz);
            let values: Vec<f64> = at
                .filter(|(t, _)| (first - 0.5..=last + 0.5).contains(*t) == inside)
                .map(|(_, p)| p[k])
                .collect();
            let q = |s| super::linear::quantile(values.iter().copied(), s);
            most = most.max(q(0.97) - q(0.03));
        }
        most
    };
    let (inside, outside) = (spread(true), spread(false));
    let ratio = voltage_s / motion_s;
    if outside > DRIVEN * inside {
        found.add(
            "rate",
            Grade::Wrong,
            format!(
                "the voltage covers {} of the {} s of motion (it is {} times as long), and the end effector moves by {:.2} mm where no voltage was logged, {:.2} mm where one was",
                short(covered),
                short(motion_s),
                short(ratio),
                outside * m.unit.to_si * 1e3,
                inside * m.unit.to_si * 1e3
            ),
            "look at the rates of both files (rate_hz, the first lines of the motion file) and whether the voltage log is whole",
        );
    } else {
        found.add(
            "rate",
            Grade::Doubtful,
            format!(
                "the voltage covers {} of the {} s of motion; nothing much moves in the rest, which is left out",
                short(covered),
                short(motion_s)
            ),
            "nothing needs to be done if the log was stopped before the capture",
        );
    }
}

/// The offset at which the motion follows the voltage best, over all at which they share enough, and what it
/// leaves; the best within `within_s` as well. Where no voltage was logged there was none.
pub(super) fn offsets(glance: &Glance, poses: &Poses, within_s: f64) -> Option<[(f64, Look); 2]> {
    let (first, last) = glance.voltage.span_s();
    let n = glance.len();
    let (length, logged) = (glance.length_s(), last - first);
    let shared = SHARED * length.min(logged);
    // the voltage's clock at the first mean, for every offset
    let from = first - (length - shared);
    let to = last - shared;
    let lags = ((to - from) / STEP_S).floor().max(0.0) as usize + 1;
    // a log that is far longer than the motion is another matter
    if lags > 12_000 {
        return None;
    }
    // in steps of two means, then of one about the best
    let squared = glance.squared_from_v2(from, lags + n);
    let look = |lag: usize| {
        poses.look([
            &squared[0][lag..lag + n],
            &squared[1][lag..lag + n],
            &squared[2][lag..lag + n],
        ])
    };
    let most = [0, lags / 3, 2 * lags / 3, lags - 1]
        .map(|l| look(l).variance)
        .into_iter()
        .fold(0.0, f64::max);
    let mut best: [Option<(usize, Look)>; 2] = [None, None];
    let offset = |lag: usize| from + STEP_S * lag as f64 - glance.start_s;
    let stride = if n * lags > 1_000_000 { 3 } else { 2 };
    let mut consider = |lag: usize| {
        let l = look(lag);
        if l.variance < 0.3 * most {
            return;
        }
        let near = offset(lag).abs() <= within_s;
        for (place, counts) in best.iter_mut().zip([true, near]) {
            if counts && place.as_ref().is_none_or(|b| l.left < b.1.left) {
                *place = Some((lag, l.clone()));
            }
        }
    };
    (0..lags).step_by(stride).for_each(&mut consider);
    let centres = best.clone();
    let mut consider = |lag: usize| {
        let l = look(lag);
        let near = offset(lag).abs() <= within_s;
        for (place, counts) in best.iter_mut().zip([true, near]) {
            if counts && place.as_ref().is_none_or(|b| l.left < b.1.left) {
                *place = Some((lag, l.clone()));
            }
        }
    };
    for (lag, _) in centres.iter().flatten() {
        (lag.saturating_sub(2)..(lag + 3).min(lags)).for_each(&mut consider);
    }
    let [all, near] = best;
    let (all, near) = (all?, near);
    let near = near.unwrap_or_else(|| all.clone());
    Some([(offset(all.0), all.1), (offset(near.0), near.1)])
}

/// Other offsets and rates at which the motion would follow the voltage.
pub(super) fn hypotheses(glance: &Glance, poses: &Poses, stated: Option<f64>) -> Vec<Hypothesis> {
    let mut out = Vec::new();
    if let Some([(offset, look), _]) = offsets(glance, poses, 0.0) {
        let from = stated.unwrap_or(0.0);
        if (offset - from).abs() > LEAST_S {
            let (first, last) = glance.voltage.span_s();
            out.push(Hypothesis {
                grade: Grade::Wrong,
                check: "clock",
                left: look.left,
                seems: format!(
                    "the voltage clock looks {} s ahead of the motion clock, not {} s (or that plus whole periods of the drive; the voltage runs from {} to {} s, the motion from {} s)",
                    short(offset),
                    short(from),
                    short(first),
                    short(last),
                    short(glance.start_s)
                ),
                then: format!("with an offset of {} s", short(offset)),
                remedy: format!("set [sync] offset_s = {offset:.2}, or synchronise the two by events or a shared channel"),
            });
        }
    }
    let (first, _) = glance.voltage.span_s();
    for ratio in RATIOS {
        for offset in [
            stated.unwrap_or(0.0) * ratio,
            first - glance.start_s * ratio,
        ] {
            let (squared, logged) = glance.squared_v2(offset, ratio);
            if logged.iter().filter(|l| **l).count() * 2 < logged.len() {
                continue;
            }
            let look = poses.look([&squared[0], &squared[1], &squared[2]]);
            out.push(Hypothesis {
                grade: Grade::Wrong,
                check: "rate",
                left: look.left,
                seems: format!("the voltage clock looks {} times as fast as the motion clock", short(ratio)),
                then: format!("with the motion's times multiplied by {}", short(ratio)),
                remedy: format!(
                    "look at the rates: the motion's may be {} times too high, or the voltage's times in another unit",
                    short(ratio)
                ),
            });
        }
    }
    out
}
