//! A hinge bench: angles in radians, torques in N m, and a torque that grows with the angle.

use super::linear::{Columns, about_mean, quantile};
use super::view::{View, per_cent, short};
use super::{Findings, Grade};

/// More than a turn is no flexure hinge, rad.
const TURN_RAD: f64 = 6.3;
/// Smallest range that is a bend, rad.
const BEND_RAD: f64 = 2e-3;
/// A flexure that needs more is none, N m.
const TORQUE_N_M: f64 = 10.0;
/// Share of the torque's variance that a line has to explain, for its slope to have a sign.
const EXPLAINS: f64 = 0.4;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some(b) = &view.recording.bench else {
        return;
    };
    if found.wrong(&["sentinel"]) {
        return;
    }
    let (fa, ft) = (
        b.angle.unit.map_or(1.0, |u| u.to_si),
        b.torque.unit.map_or(1.0, |u| u.to_si),
    );
    let pairs: Vec<(f64, f64)> = b
        .angle
        .values
        .iter()
        .zip(&b.torque.values)
        .filter(|(a, t)| a.is_finite() && t.is_finite())
        .map(|(a, t)| (a * fa, t * ft))
        .collect();
    if pairs.len() < 10 {
        return;
    }
    let angle: Vec<f64> = pairs.iter().map(|p| p.0).collect();
    let torque: Vec<f64> = pairs.iter().map(|p| p.1).collect();
    let span = |v: &[f64]| {
        let q = |s| quantile(v.iter().copied(), s);
        q(0.995) - q(0.005)
    };
    let (bend, size) = (span(&angle), span(&torque));
    let unit = |u: Option<&'static crate::units::Unit>| u.map_or("", |u| u.symbol);
    if bend > TURN_RAD {
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "the angle ranges over {} rad, {} turns: a hinge bends by a fraction of one, and {} degrees would be {} rad",
                short(bend),
                short(bend / std::f64::consts::TAU),
                short(bend / fa),
                short((bend / fa).to_radians())
            ),
            "state the angle's unit under [bench]: units = { angle = \"deg\", ... }",
        );
    } else if bend < BEND_RAD && bend > 0.0 {
        found.add(
            "unit",
            Grade::Doubtful,
            format!(
                "the angle ranges over {} rad only ({} {})",
                short(bend),
                short(bend / fa),
                unit(b.angle.unit)
            ),
            "look whether the angle is in rad",
        );
    }
    if size > TORQUE_N_M {
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "the torque ranges over {} N m: no flexure hinge of such a robot needs that, and {} N mm would be {} N m",
                short(size),
                short(size / ft),
                short(size / ft * 1e-3)
            ),
            "state the torque's unit under [bench]: units = { torque = \"N mm\", ... }",
        );
    }
    let variance = about_mean(&torque);
    let Some(line) = Columns::new(vec![vec![1.0; angle.len()], angle.clone()]) else {
        return;
    };
    let solved = line.solve(&torque);
    let explained = 1.0 - solved.left / variance.max(1e-300);
    if explained > EXPLAINS && solved.beta[1] < 0.0 {
        let work: f64 = pairs
            .windows(2)
            .map(|w| 0.5 * (w[0].1 + w[1].1) * (w[1].0 - w[0].0))
            .sum();
        found.add(
            "sign",
            Grade::Wrong,
            format!(
                "the torque falls by {} N m per rad ({} of its variance), as a restoring torque does{}: here it is the torque that holds the angle, which rises",
                short(-solved.beta[1]),
                per_cent(explained),
                if work < 0.0 { format!(", and the loop gives {} J back where friction takes", short(-work)) } else { String::new() }
            ),
            "change the sign of the torque, or of the angle",
        );
    }
}
