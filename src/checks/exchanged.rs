//! The moving marker and the base marker exchanged, throughout or for a while.

use super::linear::quantile;
use super::view::{View, middle};
use super::{Findings, Grade};
use crate::kinematics::Vec3;

fn distance(a: &Vec3, b: &Vec3) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

/// How far a marker is from its middle in 9 of 10 frames.
pub(super) fn wander(xyz: &[Vec3], at: &Vec3) -> f64 {
    quantile(xyz.iter().map(|p| distance(p, at)), 0.9)
}

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some(m) = &view.recording.motion else {
        return;
    };
    let Some(base) = m
        .base
        .as_ref()
        .filter(|b| b.xyz.len() == m.end_effector.xyz.len())
    else {
        return;
    };
    let ee = &m.end_effector;
    let (Some(here), Some(there)) = (middle(&ee.xyz), middle(&base.xyz)) else {
        return;
    };
    let (moves, stands) = (wander(&ee.xyz, &here), wander(&base.xyz, &there));
    let si = m.unit.to_si;
    if stands * si > 1e-3 && moves < 0.2 * stands {
        found.add(
            "exchanged",
            Grade::Wrong,
            format!(
                "marker {} (end_effector) stays within {:.2} mm while {} (base) moves by {:.2} mm: the two are exchanged",
                ee.label,
                moves * si * 1e3,
                base.label,
                stands * si * 1e3
            ),
            "exchange end_effector and base under [motion]",
        );
        return;
    }
    let apart = distance(&here, &there);
    let swapped: Vec<usize> = (0..ee.xyz.len())
        .filter(|&i| {
            let (a, b) = (&ee.xyz[i], &base.xyz[i]);
            distance(a, &there) < 0.25 * apart
                && distance(b, &here) < 0.5 * apart
                && distance(a, &there) < distance(a, &here)
                && distance(b, &here) < distance(b, &there)
        })
        .collect();
    if let Some(&first) = swapped.first() {
        found.add(
            "exchanged",
            Grade::Wrong,
            format!(
                "markers {} and {} are at each other's place in {} of {} frames, first at {:.3} s",
                ee.label,
                base.label,
                swapped.len(),
                ee.xyz.len(),
                m.time_s[first]
            ),
            "correct their labels in the capture software, or leave these frames empty",
        );
    }
}
