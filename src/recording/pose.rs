//! Rotations of rigid bodies, however a file writes them, as quaternions x, y, z, w.
//!
//! Tracker's RX, RY, RZ in rad are a rotation vector, axis times angle, with angles up to 2 pi: no Euler
//! angles. q = (r/|r| sin(|r|/2), cos(|r|/2)). Three angles in degrees have an order that no file states;
//! they are left alone. q and -q are one rotation: the sign is the one nearer to the sample before, so that a
//! track can be differentiated.

use super::capture::Section;
use std::ops::Range;

/// The rotation of a group, one a row, NaN where there is none; `None` if the group has no rotation that can
/// be told.
pub(super) fn rotations(section: &Section, group: Range<usize>) -> Option<Vec<[f64; 4]>> {
    let at = |axis: &str| {
        let mut columns = section.columns.get(group.clone())?.iter();
        columns.find(|c| c.axis.eq_ignore_ascii_case(axis))
    };
    let (x, y, z) = (at("RX")?, at("RY")?, at("RZ")?);
    let rows = 0..section.rows();
    let mut track: Vec<[f64; 4]> = if let Some(w) = at("RW") {
        rows.map(|i| unit([x.values[i], y.values[i], z.values[i], w.values[i]]))
            .collect()
    } else if [x, y, z].iter().all(|c| c.unit == "rad") {
        rows.map(|i| of_vector([x.values[i], y.values[i], z.values[i]]))
            .collect()
    } else {
        return None;
    };
    make_continuous(&mut track);
    Some(track)
}

/// Of length 1; a quaternion of zeros is how loggers write a body that was not seen.
fn unit(q: [f64; 4]) -> [f64; 4] {
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length > 0.1 && length.is_finite() {
        q.map(|v| v / length)
    } else {
        [f64::NAN; 4]
    }
}

fn of_vector(r: [f64; 3]) -> [f64; 4] {
    let angle = r.iter().map(|v| v * v).sum::<f64>().sqrt();
    if angle.is_nan() {
        return [f64::NAN; 4];
    }
    // sin(a/2)/a, which is 1/2 for small angles
    let factor = if angle < 1e-8 {
        0.5
    } else {
        (0.5 * angle).sin() / angle
    };
    [
        r[0] * factor,
        r[1] * factor,
        r[2] * factor,
        (0.5 * angle).cos(),
    ]
}

/// Chooses the sign that is nearer to the sample before.
fn make_continuous(track: &mut [[f64; 4]]) {
    let mut before: Option<[f64; 4]> = None;
    for q in track {
        if q[0].is_nan() {
            continue;
        }
        let against = match before {
            Some(b) => dot(*q, b) < 0.0,
            None => q[3] < 0.0,
        };
        if against {
            *q = q.map(|v| -v);
        }
        before = Some(*q);
    }
}

fn dot(a: [f64; 4], b: [f64; 4]) -> f64 {
    a.iter().zip(&b).map(|(a, b)| a * b).sum()
}

/// The largest angle between the first rotation and any other, degrees.
#[must_use]
pub(super) fn largest_turn_deg(track: &[[f64; 4]]) -> Option<f64> {
    let mut seen = track.iter().filter(|q| !q[0].is_nan());
    let first = *seen.next()?;
    Some(
        seen.map(|q| 2.0 * dot(first, *q).abs().min(1.0).acos())
            .fold(0.0, f64::max)
            .to_degrees(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_vector_passes_a_full_turn_without_a_jump() {
        // about z, from 6.2 rad on: 6.3 rad is 0.017 rad again, and no instrument writes an angle beyond 2 pi
        let angle = |i: usize| (6.2 + 0.02 * i as f64) % std::f64::consts::TAU;
        let mut track: Vec<[f64; 4]> = (0..10).map(|i| of_vector([0.0, 0.0, angle(i)])).collect();
        make_continuous(&mut track);
        for pair in track.windows(2) {
            let turn = 2.0 * dot(pair[0], pair[1]).min(1.0).acos();
            assert!((turn - 0.02).abs() < 1e-6, "{turn}");
        }
        assert!((largest_turn_deg(&track).unwrap() - 0.18f64.to_degrees()).abs() < 1e-6);
    }

    #[test]
    fn zeros_are_no_rotation() {
        assert!(unit([0.0; 4])[0].is_nan());
        assert_eq!(of_vector([0.0; 3]), [0.0, 0.0, 0.0, 1.0]);
        // a half turn about x
        let half = of_vector([std::f64::consts::PI, 0.0, 0.0]);
        assert!((half[0] - 1.0).abs() < 1e-15 && half[3].abs() < 1e-15);
    }
}
