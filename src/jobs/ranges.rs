//! Where a prediction asks learnt terms for what the recordings that they were learnt from did not show.

use crate::dataset::{Dataset, Track};
use crate::diagnosis::in_unit;
use crate::effects::learnt::{Form, Learnt, Outside, wider};
use crate::effects::{Acting, Along, When};
use crate::kinematics::Vec3;
use crate::model::{Mechanics, Robot, others};

/// Left out at both ends of a recording, as in the errors in volts, s: derivatives rest on one side there.
const ENDS_S: f64 = 0.3;

/// What is to be said of the measured motion of `dataset`, where the amplifiers are told `told_v`.
pub fn of_dataset(
    robot: &Robot,
    dataset: &Dataset,
    (effects, when): (&[Acting], When),
    told_v: &[Vec<f64>; 3],
) -> Vec<String> {
    if !effects.iter().any(|a| a.effect.learnt().is_some()) {
        return Vec::new();
    }
    let n = dataset.samples();
    let edge = (ENDS_S / dataset.step_s).round() as usize;
    let counts = |i: usize| i >= edge && i + edge < n && dataset.captured(i);
    let track = (&dataset.track(), dataset.pivot_m);
    remarks(&dataset.id, robot, track, (effects, when), told_v, &counts)
}

/// The same of a motion that was predicted, `position_m` at the frames of `dataset`; NaN where it was not.
pub fn of_motion(
    robot: &Robot,
    dataset: &Dataset,
    position_m: &[Vec3],
    (effects, when): (&[Acting], When),
    offset_s: f64,
) -> Vec<String> {
    let known = |u: &Vec3| u.iter().all(|v| v.is_finite());
    let Some(first) = position_m.iter().position(known) else {
        return Vec::new();
    };
    let n = position_m[first..].iter().take_while(|u| known(u)).count();
    if n < 2 || !effects.iter().any(|a| a.effect.learnt().is_some()) {
        return Vec::new();
    }
    let position_m = position_m[first..first + n].to_vec();
    let step_s = dataset.step_s;
    let velocity = |i: usize| {
        let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
        let time_s = step_s * (b - a) as f64;
        [0, 1, 2].map(|k| (position_m[b][k] - position_m[a][k]) / time_s)
    };
    let track = Track {
        step_s,
        velocity_m_s: (0..n).map(velocity).collect(),
        // no learnt term sees it
        acceleration_m_s2: vec![[0.0; 3]; n],
        payload_kg: dataset.track().payload_kg[first..first + n].to_vec(),
        initial: dataset.track().initial,
        position_m,
    };
    let when = When {
        start_s: when.start_s + step_s * first as f64,
        series_s: when.series_s + step_s * first as f64,
        ..when
    };
    let told_v = [0, 1, 2].map(|k| {
        let each = (first..first + n).map(|i| dataset.command_v(k, i, offset_s));
        each.collect::<Vec<f64>>()
    });
    remarks(
        &dataset.id,
        robot,
        (&track, dataset.pivot_m),
        (effects, when),
        &told_v,
        &|_| true,
    )
}

/// The commands of a recording, read with the clock offset `offset_s`, V.
pub fn commands_v(dataset: &Dataset, offset_s: f64) -> [Vec<f64>; 3] {
    let n = dataset.samples();
    [0, 1, 2].map(|k| (0..n).map(|i| dataset.command_v(k, i, offset_s)).collect())
}

/// Voltages of the three actuators as rows, as one list of each; a voltage that is not known is the one
/// before it.
pub fn by_actuator(rows: &[Vec3]) -> [Vec<f64>; 3] {
    [0, 1, 2].map(|k| {
        let mut last = 0.0;
        let held = rows.iter().map(|row| {
            if row[k].is_finite() {
                last = row[k];
            }
            last
        });
        held.collect()
    })
}

fn remarks(
    id: &str,
    robot: &Robot,
    (track, pivot_m): (&Track, Vec3),
    (effects, when): (&[Acting], When),
    told_v: &[Vec<f64>; 3],
    counts: &dyn Fn(usize) -> bool,
) -> Vec<String> {
    // what cannot be followed the prediction says itself
    let Ok(mechanics) = Mechanics::with_effects(robot, track, effects, pivot_m, None) else {
        return Vec::new();
    };
    let mut out = Vec::new();
    for acting in effects {
        let Some(term) = acting.effect.learnt() else {
            continue;
        };
        let mut asked: Vec<[f64; 2]> = Vec::new();
        for k in (0..3).filter(|k| acting.on[*k]) {
            let along = Along {
                others_v: others(k, [0, 1, 2].map(|j| &told_v[j][..])),
                ..mechanics.along(k, when)
            };
            let own = term.form.ranges(&along, &told_v[k], counts);
            asked = match asked.is_empty() {
                true => own,
                false => asked.iter().zip(own).map(|(a, b)| wider(*a, b)).collect(),
            };
        }
        let left = term.outside(&asked);
        out.extend(left.iter().map(|o| sentence(id, term, o)));
    }
    out
}

/// What a reader should know of a variable that leaves its range.
fn sentence(id: &str, term: &Learnt, o: &Outside) -> String {
    let unit = if o.unit == "1" { "" } else { o.unit };
    let number = |x: f64| in_unit(x, unit).trim_end().to_owned();
    let span = o.learnt[1] - o.learnt[0];
    let far = |way: &str, end: f64, by: f64, side: &str| {
        let share = match span > 0.0 {
            true => format!(" ({:.0} % of its width)", 100.0 * by / span),
            false => String::new(),
        };
        format!(
            "goes {way} to {}, {} {side} that range{share}",
            number(end),
            number(by)
        )
    };
    let [below, above] = o.by();
    let mut sides = Vec::new();
    if below > 0.0 {
        sides.push(far("down", o.asked[0], below, "below"));
    }
    if above > 0.0 {
        sides.push(far("up", o.asked[1], above, "above"));
    }
    let held = match &term.form {
        Form::Spline { of, .. } => of.name() == o.variable,
        Form::Ridge { .. } => true,
        _ => false,
    };
    let there = match held {
        true => "the spline is held at its edge there",
        false => "no recording says that the term holds there",
    };
    format!(
        "{id}: a learnt term ({}, a {}) saw {} from {} to {}; here it {}: {there}.",
        term.place.says(),
        term.form.name(),
        o.variable,
        number(o.learnt[0]),
        number(o.learnt[1]),
        sides.join(", and ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::learnt::{Place, Variable};

    #[test]
    fn a_sentence_says_how_far_and_what_happens() {
        let form = |by| Form::Spline {
            of: Variable::BicepAngle,
            knots: vec![-0.1, 0.3],
            by,
        };
        let range = vec![[-0.1, 0.3]];
        let term = Learnt::new(Place::Bicep, form(None), range);
        assert_eq!(term.outside(&[[-0.1039, 0.3039]]), []);
        let left = term.outside(&[[-0.15, 0.3039]]);
        assert_eq!(left.len(), 1);
        let text = sentence("day/2", term, &left[0]);
        for part in [
            "day/2: a learnt term (a torque on the bicep joints, a spline)",
            "bicep angle from -0.100 rad to 0.300 rad",
            "here it goes down to -0.150 rad, 0.0500 rad below that range (12 % of its width): the spline",
            "held at its edge",
        ] {
            assert!(text.contains(part), "{text}\nlacks {part}");
        }
        let both = vec![[-0.1, 0.3], [-1.0, 1.0]];
        let term = Learnt::new(Place::Bicep, form(Some(Variable::BicepRate)), both);
        let left = term.outside(&[[-0.1, 0.3], [-2.0, 2.0]]);
        let text = sentence("a", term, &left[0]);
        assert!(
            text.contains("bicep rate") && text.contains("no recording"),
            "{text}"
        );
        assert!(
            text.contains("(50 % of its width), and goes up to 2.00 rad/s"),
            "{text}"
        );
    }

    #[test]
    fn what_is_not_known_is_the_voltage_before() {
        let rows = [[f64::NAN, 1.0, 2.0], [3.0, f64::NAN, 4.0]];
        assert_eq!(
            by_actuator(&rows),
            [[0.0, 3.0], [1.0, 1.0], [2.0, 4.0]].map(Vec::from)
        );
    }
}
