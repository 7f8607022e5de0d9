//! The robot drawn from its rig, with the place of what was left out.

use minijinja::context;

use super::page::{Section, safe};
use super::plot::{Canvas, Role, canvas, figure};
use crate::diagnosis::{Diagnosis, Pose, Verdict};
use crate::effects::{Acting, Part, plain_name};
use crate::kinematics::{Chain, ChainPose, Vec3, dot};
use crate::model::Robot;
use crate::report::answer::{odds, sits_in};
use crate::report::effect_entries::actuators;
use plotters::style::text_anchor::{HPos, VPos};

/// Causes that are marked where none is named.
const FIRST: usize = 3;
/// Width and height of the drawing, units, and its margin.
const SIZE: [f64; 2] = [340.0, 330.0];
const MARGIN: f64 = 22.0;
/// From where it is seen: azimuth and height above the horizon, deg.
const SEEN_FROM: [f64; 2] = [-72.0, 22.0];
/// Length of the axes over the radius of the base, and of the wires over the side of a lozenge.
const AXIS: f64 = 1.3;
const WIRE: f64 = 0.35;

/// The points of one chain, m, world axes.
struct Points {
    pivot: Vec3,
    elbow: Vec3,
    wrist: Vec3,
    /// Tip of the input link, ends of the coupler and the ground link.
    bar: [Vec3; 3],
    /// Corners of the lozenge, from the ground link round.
    lozenge: [Vec3; 4],
    amplifier: Vec3,
}

fn along(from: Vec3, to: Vec3, share: f64) -> Vec3 {
    [0, 1, 2].map(|i| from[i] + share * (to[i] - from[i]))
}

impl Points {
    /// Of a chain in a pose. Its ground link is drawn upright, and the lozenge with one side along the output
    /// link: how these are mounted, a rig does not say.
    fn new(chain: &Chain, pose: &ChainPose, side_m: f64, u_m: Vec3) -> Points {
        let (s, c) = chain.azimuth_rad.sin_cos();
        let at = |radius: f64, up: f64| [radius * c, radius * s, up];
        // a way from the pivot at an angle from upright towards the axis of the robot
        let way = |from: [f64; 2], length: f64, angle: f64| {
            [
                from[0] - length * angle.sin(),
                from[1] + length * angle.cos(),
            ]
        };
        let bar = &chain.four_bar;
        let pivot = [chain.base_radius_m, 0.0];
        let top = way(pivot, bar.a_m, 0.0);
        let psi = std::f64::consts::PI - pose.theta_sam_rad;
        let moved = way(top, side_m, psi + std::f64::consts::PI);
        let fixed = way(top, side_m, psi + std::f64::consts::PI - pose.theta_dea_rad);
        let far = [moved[0] + fixed[0] - top[0], moved[1] + fixed[1] - top[1]];
        let place = |p: [f64; 2]| at(p[0], p[1]);
        let hub = at(chain.effector_radius_m, 0.0);
        Points {
            pivot: place(pivot),
            elbow: place(way(pivot, chain.bicep_m, pose.theta_b_rad)),
            wrist: [0, 1, 2].map(|i| u_m[i] + hub[i]),
            bar: [
                place(way(pivot, bar.b_m, pose.theta_k1_rad)),
                place(way(top, bar.d_m, psi)),
                place(top),
            ],
            lozenge: [top, moved, far, fixed].map(place),
            amplifier: place(way(moved, WIRE * side_m, 0.0)),
        }
    }

    /// Where a part lies.
    fn of(&self, part: Part, effector: Vec3) -> Option<Vec3> {
        let centre = along(self.lozenge[0], self.lozenge[2], 0.5);
        Some(match part {
            Part::Amplifier => self.amplifier,
            Part::Lead => along(self.amplifier, self.lozenge[1], 0.5),
            Part::Film => centre,
            Part::Hinges => self.lozenge[2],
            Part::FourBar => self.bar[1],
            Part::BicepJoint => self.pivot,
            Part::Bicep => along(self.pivot, self.elbow, 0.6),
            Part::Forearm => along(self.elbow, self.wrist, 0.5),
            Part::Base => along(self.pivot, [0.0; 3], 0.5),
            Part::Effector | Part::Marker => effector,
            Part::Clocks => return None,
        })
    }
}

/// The points of the three chains of a robot whose end effector is at `u_m` (m, world axes), in hundredths of
/// a millimetre: of each its pivot, elbow and wrist, the three of its four-bar, and the four corners of its
/// lozenge; `None` where the arms do not reach.
pub fn skeleton(robot: &Robot, u_m: Vec3) -> Option<Vec<i32>> {
    let poses = robot.mechanism.pose(u_m).ok()?;
    let each = robot.mechanism.chains.iter().zip(&poses);
    let points = each.zip(&robot.lozenges).flat_map(|((chain, pose), l)| {
        let p = Points::new(chain, pose, l.side_m, u_m);
        let arm = [p.pivot, p.elbow, p.wrist];
        arm.into_iter().chain(p.bar).chain(p.lozenge)
    });
    Some(points.flatten().map(|v| (1e5 * v).round() as i32).collect())
}

/// What a part is called on a number of chains.
fn called(part: Part, on: [bool; 3]) -> String {
    let own = match part {
        Part::Amplifier => "the amplifier",
        Part::Lead => "the wires",
        Part::Film => "the film",
        Part::Hinges => "the hinges of the lozenge",
        Part::FourBar => "the four-bar",
        Part::BicepJoint => "the joint of the bicep",
        Part::Bicep => "the bicep",
        Part::Forearm => "the forearm",
        Part::Base => "the base",
        Part::Effector => return "the end effector".into(),
        Part::Marker => return "the marker, or the capture that sees it".into(),
        Part::Clocks => return "the clocks, not on the robot".into(),
    };
    format!("{own}, {}", sits_in(&actuators(on)))
}

/// What is marked: where, and in words.
fn marks(d: &Diagnosis) -> Vec<(Acting, String)> {
    let named: Vec<_> = d.candidates.iter().filter(|c| c.in_model).collect();
    let shown = match (d.verdict, named.is_empty()) {
        (Verdict::Adequate, _) => Vec::new(),
        (_, false) => named,
        _ if d.learnt.is_some() => Vec::new(),
        _ => d.candidates.iter().take(FIRST).collect(),
    };
    let cause = |c: &&crate::diagnosis::Candidate| {
        let part = c.acting.effect.part(&c.acting.values);
        let name = plain_name(c.acting.effect.id());
        let words = format!(
            "{name}, {}: {}",
            odds(c.probability),
            called(part, c.acting.on)
        );
        (c.acting.clone(), words)
    };
    let mut out: Vec<_> = shown.iter().map(cause).collect();
    if let Some(l) = &d.learnt {
        for t in l.terms.iter().take(1) {
            let acting = Acting {
                on: l.on(),
                ..t.acting.clone()
            };
            let part = acting.effect.part(&acting.values);
            let words = format!(
                "what was learnt, {}: {}",
                l.place.says(),
                called(part, acting.on)
            );
            out.push((acting, words));
        }
    }
    out
}

/// See the module; nothing where there is no robot.
pub fn section(d: &Diagnosis) -> Option<Section> {
    let pose = d.pose.as_ref()?;
    let marks = marks(d);
    let places: Vec<(String, Acting)> = ('A'..)
        .zip(&marks)
        .map(|(letter, (acting, _))| (letter.to_string(), acting.clone()))
        .collect();
    let drawing = drawing(pose, &places)?;
    let caption = "Arms to scale, in the mean pose of the recordings, with the robot\u{2019}s axes and the numbers of the chains; how the actuators stand on the base is only sketched.";
    let items: Vec<String> = ('A'..)
        .zip(&marks)
        .map(|(l, (_, words))| format!("{l}: {words}"))
        .collect();
    let says = match (items.is_empty(), d.verdict) {
        (true, Verdict::Adequate) => {
            "Nothing is marked: the plain model leaves no more than noise."
        }
        (true, _) => "Nothing is marked: no cause comes near.",
        (false, Verdict::Unexplained) if d.learnt.is_none() => {
            "No cause accounts for the misfit; those that come nearest:"
        }
        (false, _) => "",
    };
    let context = context! {
        figure => safe(figure(&[drawing], "", caption)),
        items => items,
        says => says,
    };
    Some(Section::new(
        "robot",
        "On the robot",
        include_str!("mechanism.html"),
        context,
    ))
}

/// The robot, with letters where causes act; nothing where the pose cannot be.
fn drawing(pose: &Pose, marks: &[(String, Acting)]) -> Option<String> {
    let u_m = pose.position_m;
    let poses = pose.robot.mechanism.pose(u_m).ok()?;
    let chains: Vec<Points> = pose
        .robot
        .mechanism
        .chains
        .iter()
        .zip(&poses)
        .map(|(chain, p)| Points::new(chain, p, pose.robot.lozenges[0].side_m, u_m))
        .collect();
    let [azimuth, height] = SEEN_FROM.map(f64::to_radians);
    let right = [-azimuth.sin(), azimuth.cos(), 0.0];
    let up = [
        -azimuth.cos() * height.sin(),
        -azimuth.sin() * height.sin(),
        height.cos(),
    ];
    let flat = |p: Vec3| [dot(p, right), -dot(p, up)];
    let axis = AXIS * pose.robot.mechanism.chains[0].base_radius_m;
    let tips = [[axis, 0.0, 0.0], [0.0, axis, 0.0], [0.0, 0.0, axis]];
    let all = chains.iter().flat_map(|c| {
        let own = [c.pivot, c.elbow, c.wrist, c.amplifier];
        own.into_iter().chain(c.lozenge).chain(c.bar)
    });
    let (low, high) = all.chain(tips).map(flat).fold(
        ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]),
        |(low, high), p| {
            (
                [0, 1].map(|i| low[i].min(p[i])),
                [0, 1].map(|i| high[i].max(p[i])),
            )
        },
    );
    let scale = [0, 1]
        .map(|i| (SIZE[i] - 2.0 * MARGIN) / (high[i] - low[i]).max(1e-9))
        .into_iter()
        .fold(f64::INFINITY, f64::min);
    let place = |p: Vec3| {
        let at = flat(p);
        [0, 1].map(|i| SIZE[i] / 2.0 + scale * (at[i] - 0.5 * (low[i] + high[i])))
    };
    let label = "The robot: base, three chains with their actuators, end effector and axes";
    Some(canvas(label, "part free", SIZE, |c| {
        let path = |points: &[Vec3], role, width| {
            let points: Vec<[f64; 2]> = points.iter().map(|p| place(*p)).collect();
            c.line(&points, role, width, false);
        };
        robot(c, &chains, &place, &path);
        let origin = [0.0; 3];
        for (tip, name) in tips.iter().zip(["x", "y", "z"]) {
            path(&[origin, *tip], Role::Ink, 1.0);
            let at = place(along(origin, *tip, 1.15));
            c.text(name, at, Role::Ink, HPos::Center, VPos::Center);
        }
        for (k, chain) in chains.iter().enumerate() {
            let at = place(along(chain.lozenge[1], chain.amplifier, 1.6));
            c.text(
                &(k + 1).to_string(),
                at,
                Role::Ink,
                HPos::Center,
                VPos::Center,
            );
        }
        let mut found: Vec<(Vec3, String)> = Vec::new();
        for (letter, acting) in marks {
            let part = acting.effect.part(&acting.values);
            for (chain, _) in chains.iter().zip(acting.on).filter(|(_, on)| *on) {
                let Some(at) = chain.of(part, u_m) else {
                    continue;
                };
                match found.iter_mut().find(|f| f.0 == at) {
                    Some((_, letters)) if letters.ends_with(letter.as_str()) => {}
                    Some((_, letters)) => *letters += &format!(", {letter}"),
                    None => found.push((at, letter.clone())),
                }
            }
        }
        for (at, letters) in found {
            let [x, y] = place(at);
            c.dot([x, y], 5.0, Role::Two);
            c.text(
                &letters,
                [x + 8.0, y - 4.0],
                Role::Ink,
                HPos::Left,
                VPos::Bottom,
            );
        }
    }))
}

/// Base, chains and end effector.
fn robot(
    c: &Canvas,
    chains: &[Points],
    place: &impl Fn(Vec3) -> [f64; 2],
    path: &impl Fn(&[Vec3], Role, f64),
) {
    let flat = |points: Vec<Vec3>| points.into_iter().map(place).collect::<Vec<_>>();
    let ring = |at: fn(&Points) -> Vec3| chains.iter().map(at).collect::<Vec<Vec3>>();
    c.polygon(&flat(ring(|p| p.pivot)), Role::Base, 0.35);
    c.polygon(&flat(ring(|p| p.wrist)), Role::Three, 0.4);
    for p in chains {
        c.polygon(&flat(p.lozenge.to_vec()), Role::One, 0.3);
        let [a, b, far, d] = p.lozenge;
        path(&[a, b, far, d, a], Role::One, 1.5);
        path(&[p.bar[2], p.pivot], Role::Rule, 1.5);
        path(&[p.pivot, p.bar[0], p.bar[1], p.bar[2]], Role::Muted, 1.5);
        path(&[p.lozenge[1], p.amplifier], Role::Four, 1.0);
        let [x, y] = place(p.amplifier);
        c.rectangle([x - 4.0, y - 4.0], [x + 4.0, y + 4.0], Role::Four, 1.0);
        path(&[p.pivot, p.elbow], Role::Ink, 3.0);
        path(&[p.elbow, p.wrist], Role::Ink, 1.5);
        c.dot(place(p.elbow), 2.5, Role::Ink);
        c.dot(place(p.pivot), 2.5, Role::Ink);
    }
}
