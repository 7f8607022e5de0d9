//! Who moves when, and where: the order of the voltage channels, the capture's axes, the clocks. Each way in
//! which a recording may have been put together wrongly is a hypothesis; all are held against the recording
//! by the same small regression (`glance`), and the best is told where it leaves a small part of what the
//! stated way leaves.
//!
//! # Limits
//! Of the 141 recordings of 26 robots with strong left-out causes, most of them on one actuator, the stated
//! way leaves up to 5.3 % of the variance of the drive, and no other way leaves less than a sixth of that and
//! below 1 %. Wrong ways leave 5 to 100 %, the right one beside them mostly less than 0.1 %. So another way
//! is told when the stated one leaves more than [`SUSPECT`], and it less than [`GOES`] and a [`FALL`]th.

use super::glance::{Glance, Look, Ties};
use super::view::{View, per_cent, short};
use super::{Findings, Grade, clock, dead_channel};
use crate::kinematics::Vec3;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// Share of the drive's variance from which on the stated way is suspected.
pub(super) const SUSPECT: f64 = 0.04;
/// The way that is told leaves no more than this, and
const GOES: f64 = 0.01;
/// this much less.
const FALL: f64 = 6.0;
/// A drive that moves something, V, and one that is steady: its squares scatter by less than this share of
/// the largest.
const LEAST_V: f64 = 100.0;
const STEADY: f64 = 0.02;
/// Where no way will do: share above which motion and voltages do not belong together.
const NOTHING_GOES: f64 = 0.5;
/// Turn of the axes from which on it is told, degrees: the largest of the catalogue is 4.5.
const TURNED_DEG: f64 = 4.75;
const TURN_SAID_DEG: f64 = 4.0;
const FARTHEST_DEG: f64 = 20.0;
/// Turns from which the best is looked for, degrees, one axis at a time.
const STARTS_DEG: [f64; 6] = [-10.0, -6.0, -3.0, 3.0, 6.0, 10.0];
/// A turn of 5 degrees leaves at least this much of the drive's variance; below, none is looked for.
const NO_TURN: f64 = 0.002;
/// What the motion leaves of the drive, of its variance, once the axes are turned back: a stiff hinge on one
/// actuator passes for a turn of 7 degrees, and leaves 3 to 6 % of the drive then, a stiff film on one for 5
/// degrees and 1.8 %; a sound robot leaves 0.3 to 1.3 %.
const TURNED_BACK: f64 = 0.015 * 0.015;
/// First and least step of a search for turns, degrees, and for shifts, m.
const TURNS_DEG: [f64; 2] = [2.0, 0.1];
const SHIFTS_M: [f64; 2] = [5e-4, 2e-5];
/// Share of the variance that a mere shift of the poses has to leave, over what the turn leaves.
const SHIFTED: f64 = 2.0;
/// Clock offset that a fit looks for, s.
const SEARCHED_S: f64 = crate::dataset::OFFSET_SEARCH_S;

/// A way in which the recording may have been put together.
#[derive(Debug, Clone)]
pub(super) struct Hypothesis {
    pub check: &'static str,
    pub grade: Grade,
    /// Share of the drive's variance that it leaves.
    pub left: f64,
    /// What it looks like.
    pub seems: String,
    /// With what done the error falls.
    pub then: String,
    pub remedy: String,
}

const ORDERS: [[usize; 3]; 5] = [[1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]];

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some(glance) = &view.glance else { return };
    if found.wrong(&[
        "stated_value",
        "dead_channel",
        "unit",
        "rate",
        "base",
        "exchanged",
        "noise",
    ]) || found.wrong(&["clock"])
    {
        return;
    }
    let positions = glance.positions_m(|v| v);
    let Some(poses) = glance.poses(&positions, Ties::Each) else {
        return out_of_reach(view, glance, found);
    };
    let stated = match glance.offset_s {
        Some(offset) => {
            let (squared, logged) = glance.squared_v2(offset, 1.0);
            if logged.iter().filter(|l| **l).count() * 10 < 9 * logged.len() {
                return; // what is not covered is told by the lengths
            }
            let look = poses.look([&squared[0], &squared[1], &squared[2]]);
            (offset, squared, look)
        }
        None => {
            let Some([(far, all), (near, within)]) = clock::offsets(glance, &poses, SEARCHED_S)
            else {
                return;
            };
            if far.abs() > SEARCHED_S + 0.5 && all.left * 2.0 < within.left && all.left < SUSPECT {
                tell(
                    glance,
                    found,
                    within.left,
                    &Hypothesis {
                        grade: Grade::Wrong,
                        check: "clock",
                        left: all.left,
                        seems: format!(
                            "the clocks look {} s apart, beyond the {} s within which \"estimate\" looks; what it would find is off by whole periods of the drive",
                            short(far),
                            short(SEARCHED_S)
                        ),
                        then: format!("with {} s instead of {} s", short(far), short(near)),
                        remedy: format!("set [sync] offset_s = {far:.2}"),
                    },
                );
                return;
            }
            let (squared, _) = glance.squared_v2(near, 1.0);
            (near, squared, within)
        }
    };
    let (offset, squared, look) = stated;
    // Who moves when is told by a drive that changes.
    let most = squared.iter().flatten().copied().fold(0.0, f64::max);
    let changes =
        |v: &Vec<f64>| super::linear::about_mean(v) > v.len() as f64 * (STEADY * most).powi(2);
    if most < LEAST_V * LEAST_V || !squared.iter().any(changes) {
        return;
    }
    if look.any > SUSPECT {
        let mut ways = orders(&poses, &squared);
        ways.extend(clock::hypotheses(glance, &poses, Some(offset)));
        ways.extend(dead_channel::hypothesis(&poses, &squared));
        ways.extend(axes(glance, &squared, Ties::Each));
        ways.extend(turn(glance, &squared));
        ways.sort_by(|a, b| a.left.total_cmp(&b.left));
        if let Some(best) = ways
            .first()
            .filter(|w| w.left < (look.any / FALL).min(GOES))
        {
            tell(glance, found, look.any, best);
            return;
        }
        if look.any > NOTHING_GOES {
            found.add(
                "mismatch",
                Grade::Wrong,
                format!(
                    "the motion does not go with the voltages: it leaves {} of the drive unexplained, and neither another order of the channels, nor other axes, nor another clock leaves less than {}",
                    per_cent(look.any.sqrt().min(9.99)),
                    per_cent(ways.first().map_or(1.0, |w| w.left.sqrt().min(9.99)))
                ),
                "look whether the two files are of the same run, and at [voltage] channels and [sync]",
            );
            return;
        }
    }
    // A chain without a voltage may pass for one without stiffness.
    if let Some(dead) = dead_channel::hypothesis(&poses, &squared) {
        found.add("dead_channel", Grade::Wrong, dead.seems, dead.remedy);
        return;
    }
    where_it_is(glance, found, &squared);
}

fn tell(glance: &Glance, found: &mut Findings, before: f64, way: &Hypothesis) {
    // independent samples: one a second, by the films' memory
    let independent = glance.length_s();
    let p = (0.5 * independent * (way.left / before).max(1e-12).ln()).exp();
    found.add_with(
        way.check,
        way.grade,
        format!(
            "{}: {} what of the drive the motion leaves unexplained falls from {} to {}",
            way.seems,
            way.then,
            per_cent(before.sqrt().min(9.99)),
            per_cent(way.left.sqrt())
        ),
        way.remedy.clone(),
        p.max(1e-300),
    );
}

fn orders(poses: &super::glance::Poses, squared: &[Vec<f64>; 3]) -> Vec<Hypothesis> {
    let driven: Vec<usize> = (0..3)
        .filter(|&k| super::linear::about_mean(&squared[k]) > 0.0)
        .collect();
    let way = |order: &[usize; 3]| {
        let [a, b, c] = order.map(|k| &squared[k][..]);
        let look = poses.look([a, b, c]);
        // chain k is driven by channel order[k]
        let moved: Vec<usize> = (0..3).filter(|&k| order[k] != k).collect();
        let seems = if let [one] = driven[..] {
            let arm = order.iter().position(|c| *c == one).unwrap_or(one);
            format!("voltage {} is driven, and arm {} moves", one + 1, arm + 1)
        } else if let [a, b] = moved[..] {
            format!("voltages {} and {} look exchanged", a + 1, b + 1)
        } else {
            let list = order.map(|k| (k + 1).to_string()).join(", ");
            format!("voltages {list} look like those of chains 1, 2, 3")
        };
        let list = order.map(|k| (k + 1).to_string()).join(", ");
        Hypothesis {
            grade: Grade::Wrong,
            check: "chain_order",
            left: look.left,
            seems,
            then: format!("in the order {list}"),
            remedy: match moved[..] {
                [a, b] if driven.len() > 1 => {
                    format!("swap {} and {} in [voltage] channels", a + 1, b + 1)
                }
                _ => format!("put the channels into the order {list} in [voltage] channels"),
            },
        }
    };
    ORDERS.iter().map(way).collect()
}

/// The rotations and mirrorings that take axes to axes, but the one that does nothing, with a name.
fn axis_maps() -> Vec<([[f64; 3]; 3], bool, String)> {
    let mut out = Vec::new();
    let every = [
        [0, 1, 2],
        [1, 0, 2],
        [0, 2, 1],
        [2, 1, 0],
        [1, 2, 0],
        [2, 0, 1],
    ];
    for order in every {
        for signs in 0..8 {
            let mut m = [[0.0; 3]; 3];
            let mut words = Vec::new();
            for k in 0..3 {
                let minus = signs >> k & 1 == 1;
                m[k][order[k]] = if minus { -1.0 } else { 1.0 };
                words.push(format!(
                    "{}{}",
                    if minus { "-" } else { "" },
                    ["x", "y", "z"][order[k]]
                ));
            }
            if order == [0, 1, 2] && signs == 0 {
                continue;
            }
            let mirrored = Matrix3::from_fn(|i, j| m[i][j]).determinant() < 0.0;
            out.push((m, mirrored, words.join(", ")));
        }
    }
    out
}

fn axes(glance: &Glance, squared: &[Vec<f64>; 3], ties: Ties) -> Vec<Hypothesis> {
    let mut out = Vec::new();
    for (m, mirrored, name) in axis_maps() {
        let turned =
            glance.positions_m(|v| [0, 1, 2].map(|i| (0..3).map(|j| m[i][j] * v[j]).sum()));
        let Some(poses) = glance.poses(&turned, ties) else {
            continue;
        };
        let look = poses.look([&squared[0], &squared[1], &squared[2]]);
        out.push(of_axes(&m, mirrored, &name, look.left));
    }
    out
}

/// Rx Ry Rz in degrees of a rotation.
fn angles_deg(r: &Matrix3<f64>) -> [f64; 3] {
    // Rx Ry Rz: r[0][2] = sin b, r[1][2] = -sin a cos b, r[0][1] = -cos b sin c
    let b = r[(0, 2)].clamp(-1.0, 1.0).asin();
    let (a, c) = if b.cos().abs() > 1e-6 {
        ((-r[(1, 2)]).atan2(r[(2, 2)]), (-r[(0, 1)]).atan2(r[(0, 0)]))
    } else {
        (r[(2, 1)].atan2(r[(1, 1)]), 0.0)
    };
    [a, b, c].map(|x| {
        let deg = x.to_degrees();
        if deg.abs() < 0.05 { 0.0 } else { deg }
    })
}

fn of_axes(m: &[[f64; 3]; 3], mirrored: bool, name: &str, left: f64) -> Hypothesis {
    let minus: Vec<&str> = name.split(", ").filter(|w| w.starts_with('-')).collect();
    let plain = name.replace('-', "") == "x, y, z";
    let (seems, remedy) = if mirrored {
        let seems = if plain && minus.len() == 1 {
            format!("{} looks mirrored", minus[0].trim_start_matches('-'))
        } else {
            format!("the capture's axes look mirrored (the rig's are {name} of them)")
        };
        (
            seems,
            "export the capture with right-handed axes; no rotation_deg makes up for a mirrored axis".to_owned(),
        )
    } else {
        let [a, b, c] = angles_deg(&Matrix3::from_fn(|i, j| m[i][j]));
        (
            format!(
                "the capture's axes look exchanged: the rig's x, y, z are {name} of the capture as it is turned now"
            ),
            format!(
                "turn them under [motion]: rotation_deg = [{a:.0}, {b:.0}, {c:.0}] before what is stated there"
            ),
        )
    };
    Hypothesis {
        grade: Grade::Wrong,
        check: if mirrored { "mirror" } else { "axes" },
        left,
        seems,
        then: format!("with {name}"),
        remedy,
    }
}

/// The poses that the mechanism cannot take: because of axes, of a unit, or of what is stated.
fn out_of_reach(view: &View<'_>, glance: &Glance, found: &mut Findings) {
    let (squared, _) = glance.squared_v2(glance.offset_s.unwrap_or(0.0), 1.0);
    let mut ways = axes(glance, &squared, Ties::Each);
    for (factor, unit) in [
        (1e-3, "um"),
        (1e3, "m"),
        (10.0, "cm"),
        (25.4, "inch"),
        (0.1, "mm"),
        (1.0 / 25.4, "mm"),
    ] {
        let scaled = glance.positions_m(|v| v.map(|x| x * factor));
        if let Some(poses) = glance.poses(&scaled, Ties::Each) {
            ways.push(Hypothesis {
                grade: Grade::Wrong,
                check: "unit",
                left: poses.look([&squared[0], &squared[1], &squared[2]]).left,
                seems: format!(
                    "positions look like {unit}, not {}",
                    view.recording.motion.as_ref().map_or("mm", |m| m.unit.symbol)
                ),
                then: format!("with positions multiplied by {}", short(factor)),
                remedy: format!("correct the unit of the positions in the file's header, or state unit = \"{unit}\" under [motion]"),
            });
        }
    }
    for degrees in (5..360).step_by(5) {
        for axis in 0..3 {
            let mut w = [0.0; 3];
            w[axis] = f64::from(degrees).to_radians();
            if degrees % 90 == 0 {
                continue;
            }
            if let Some(left) = turned(glance, &squared, w) {
                ways.push(of_turn(w, left));
            }
        }
    }
    ways.sort_by(|a, b| a.left.total_cmp(&b.left));
    let positions = glance.positions_m(|v| v);
    let at = super::view::middle(&positions).map_or([f64::NAN; 3], |p| p.map(|v| 1e3 * v));
    // what no laboratory has is refused with its place, not with a guess at the axes
    if !at.iter().all(|v| v.abs() < LARGEST_MM) {
        return;
    }
    let why = glance
        .robot
        .mechanism
        .pose(at.map(|v| v * 1e-3))
        .err()
        .map_or(String::new(), |e| format!(" ({e})"));
    let stated = view.recording.manifest.motion.as_ref();
    if stated.is_some_and(|m| m.base_position_mm == [0.0; 3]) {
        // another unit or a turn would fit many such paths
        found.add(
            "axes",
            Grade::Wrong,
            format!(
                "the end effector is mostly where the mechanism cannot take it, about ({:.1}, {:.1}, {:.1}) mm, and base_position_mm is 0, 0, 0",
                at[0], at[1], at[2]
            ),
            "state base_position_mm, where the base marker sits in the robot's axes, and end_effector_offset_mm under [motion]; where it does sit at their origin, look at rotation_deg, the unit of the positions, and the rig's lengths",
        );
        return;
    }
    match ways.first().filter(|w| w.left < 0.3) {
        Some(best) => found.add(
            best.check,
            Grade::Wrong,
            format!(
                "the end effector is mostly where the mechanism cannot take it, about ({:.1}, {:.1}, {:.1}) mm{why}; {}: {} it is within reach and leaves {} of the drive unexplained",
                at[0], at[1], at[2], best.seems, best.then, per_cent(best.left.sqrt())
            ),
            best.remedy.clone(),
        ),
        None => found.add(
            "axes",
            Grade::Wrong,
            format!(
                "the end effector is mostly where the mechanism cannot take it, about ({:.1}, {:.1}, {:.1}) mm{why}",
                at[0], at[1], at[2]
            ),
            "look at base_position_mm, end_effector_offset_mm and rotation_deg under [motion], the unit of the positions, and the rig's lengths",
        ),
    }
}

/// Largest distance in a laboratory, mm.
const LARGEST_MM: f64 = 1e9;

fn rotation(w: Vec3) -> Rotation3<f64> {
    Rotation3::from_scaled_axis(Vector3::from(w))
}

fn look_turned(glance: &Glance, squared: &[Vec<f64>; 3], w: Vec3) -> Option<Look> {
    let r = rotation(w);
    let positions = glance.positions_m(|v| {
        let t = r * Vector3::from(v);
        [t[0], t[1], t[2]]
    });
    let poses = glance.poses(&positions, Ties::Rest)?;
    Some(poses.look([&squared[0], &squared[1], &squared[2]]))
}

/// What is left with the axes turned by the rotation vector `w` about the base marker.
fn turned(glance: &Glance, squared: &[Vec<f64>; 3], w: Vec3) -> Option<f64> {
    Some(look_turned(glance, squared, w)?.left)
}

/// As [`turned`], also where the film would push: a way to better poses may lead through such.
fn whatever_sign(glance: &Glance, squared: &[Vec<f64>; 3], w: Vec3) -> Option<f64> {
    Some(look_turned(glance, squared, w)?.any)
}

fn of_turn(w: Vec3, left: f64) -> Hypothesis {
    let [a, b, c] = angles_deg(rotation(w).matrix());
    let size = Vector3::from(w).norm().to_degrees();
    Hypothesis {
        grade: Grade::Wrong,
        check: "axes",
        left,
        seems: format!("the capture's axes look turned by {size:.1} degrees against the rig's"),
        then: format!("turned back by ({a:.1}, {b:.1}, {c:.1}) degrees"),
        remedy: format!(
            "turn them under [motion]: rotation_deg = [{a:.1}, {b:.1}, {c:.1}] before what is stated there, or calibrate the capture's axes to the frame"
        ),
    }
}

/// Rest pose and directions: the axes by rigid registration, the film's lengths by the pose at which it
/// rests.
fn where_it_is(glance: &Glance, found: &mut Findings, squared: &[Vec<f64>; 3]) {
    let Some(here) = turned(glance, squared, [0.0; 3]) else {
        return;
    };
    if here < NO_TURN {
        return;
    }
    let mut ways = Vec::new();
    if here > 0.01 {
        ways.extend(axes(glance, squared, Ties::Rest));
        let mut other = glance.robot.clone();
        for l in &mut other.lozenges {
            (l.l1_m, l.l2_m) = (l.l2_m, l.l1_m);
        }
        let positions = glance.positions_m(|v| v);
        if let Some(poses) = glance.poses_of(&other, &positions, Ties::Rest) {
            let [l1, l2] =
                [glance.robot.lozenges[0].l1_m, glance.robot.lozenges[0].l2_m].map(|l| l * 1e3);
            ways.push(Hypothesis {
                grade: Grade::Wrong,
                check: "stated_value",
                left: poses.look([&squared[0], &squared[1], &squared[2]]).left,
                seems: format!(
                    "L1_mm = {} and L2_mm = {} look exchanged: a film with these would not rest where the robot rests",
                    short(l1),
                    short(l2)
                ),
                then: "with them exchanged".into(),
                remedy: "exchange L1_mm and L2_mm under [film] of the rig".into(),
            });
        }
    }
    ways.extend(turn(glance, squared));
    ways.sort_by(|a, b| a.left.total_cmp(&b.left));
    let Some(best) = ways
        .first()
        .filter(|w| w.left < (here / FALL).min(TURNED_BACK))
    else {
        return;
    };
    tell(glance, found, here, best);
}

/// A turn that is large enough to be told, leaves as little as a sound robot does, and is told from a marker
/// that sits elsewhere than stated, which moves the poses as a turn does but leaves the directions of motion.
fn turn(glance: &Glance, squared: &[Vec<f64>; 3]) -> Option<Hypothesis> {
    let (w, left) = best_turn(glance, squared)?;
    let size = Vector3::from(w).norm().to_degrees();
    let said = (TURN_SAID_DEG..FARTHEST_DEG).contains(&size) && left < TURNED_BACK;
    (said && shifted(glance, squared, w) > SHIFTED * left).then(|| Hypothesis {
        grade: if size < TURNED_DEG {
            Grade::Doubtful
        } else {
            Grade::Wrong
        },
        ..of_turn(w, left)
    })
}

/// What is left where the poses are only moved, from as far as the turn `w` moves their mean on.
fn shifted(glance: &Glance, squared: &[Vec<f64>; 3], w: Vec3) -> f64 {
    let Some(middle) = super::view::middle(&glance.from_base_m) else {
        return f64::INFINITY;
    };
    let by = rotation(w) * Vector3::from(middle) - Vector3::from(middle);
    let left = |d: Vec3| {
        let positions = glance.positions_m(|v| [0, 1, 2].map(|k| v[k] + d[k]));
        let poses = glance.poses(&positions, Ties::Rest)?;
        Some(poses.look([&squared[0], &squared[1], &squared[2]]).any)
    };
    let start = [by[0], by[1], by[2]];
    let from = left(start).unwrap_or(f64::INFINITY);
    descend((start, from), SHIFTS_M, left).1
}

/// The small turn that leaves least.
fn best_turn(glance: &Glance, squared: &[Vec<f64>; 3]) -> Option<(Vec3, f64)> {
    let mut w = [0.0; 3];
    let mut best = whatever_sign(glance, squared, w)?;
    for k in 0..3 {
        for degrees in STARTS_DEG {
            let mut v = [0.0; 3];
            v[k] = f64::to_radians(degrees);
            if let Some(left) = whatever_sign(glance, squared, v).filter(|l| *l < best) {
                (w, best) = (v, left);
            }
        }
    }
    let left = |v: Vec3| whatever_sign(glance, squared, v);
    let (w, _) = descend((w, best), TURNS_DEG.map(f64::to_radians), left);
    Some((w, turned(glance, squared, w)?))
}

/// Three numbers from which on no step leaves less, and what they leave: a parabola through each, and on
/// along the valley, from the first step on down to the `least`.
fn descend(
    (mut w, mut best): (Vec3, f64),
    [mut step, least]: [f64; 2],
    left: impl Fn(Vec3) -> Option<f64>,
) -> (Vec3, f64) {
    for _ in 0..20 {
        let mut moved = false;
        let before = w;
        for k in 0..3 {
            let at = |d: f64| {
                let mut v = w;
                v[k] += d;
                left(v).unwrap_or(f64::INFINITY)
            };
            let (up, down) = (at(step), at(-step));
            let curvature = up + down - 2.0 * best;
            let to = if curvature.is_finite() && curvature > 0.0 {
                (0.5 * step * (down - up) / curvature).clamp(-3.0 * step, 3.0 * step)
            } else if up < down {
                step
            } else {
                -step
            };
            let there = at(to);
            if there < best {
                w[k] += to;
                moved |= to.abs() > 0.2 * step;
                best = there;
            }
        }
        // along the valley, if there is one
        for far in [4.0, 2.0, 1.0] {
            let on = [0, 1, 2].map(|k| w[k] + far * (w[k] - before[k]));
            if let Some(there) = left(on).filter(|l| *l < best) {
                (w, best) = (on, there);
                moved = true;
                break;
            }
        }
        if !moved {
            step *= 0.4;
            if step < least {
                break;
            }
        }
    }
    (w, best)
}
