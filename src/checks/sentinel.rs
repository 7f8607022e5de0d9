//! Numbers that stand for "nothing was measured": -999, 9999, a marker at 0, 0, 0.

use super::view::{Is, View, short};
use super::{Findings, Grade};

/// What instruments and scripts write for a missing value.
const SENTINELS: [f64; 8] = [
    999.0, 999.9, 999.99, 9999.0, 99999.0, 32767.0, 32768.0, 65535.0,
];
/// From this size on a number is no measurement in any unit of a laboratory.
const HUGE: f64 = 1e15;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    for s in &view.signals {
        let known = |v: f64| SENTINELS.contains(&v.abs()) || v.abs() > HUGE;
        let rows: Vec<usize> = (0..s.values.len())
            .filter(|&i| known(s.values[i]))
            .collect();
        let Some(&first) = rows.first() else { continue };
        // It has to lie outside what is otherwise measured: 999 mm may be a place.
        let others = || {
            s.values
                .iter()
                .copied()
                .filter(|v| v.is_finite() && !known(*v))
        };
        let (low, high) = (
            others().fold(f64::INFINITY, f64::min),
            others().fold(f64::NEG_INFINITY, f64::max),
        );
        let outside = |v: f64| v < low - 0.1 * (high - low) || v > high + 0.1 * (high - low);
        if low > high || !rows.iter().all(|&i| outside(s.values[i])) {
            continue;
        }
        found.add(
            "sentinel",
            Grade::Wrong,
            format!(
                "{} is {} in {} of {} rows, first {}, and lies between {} and {} {} otherwise: that stands for a missing value",
                s.name,
                s.values[first],
                rows.len(),
                s.values.len(),
                s.at(first),
                short(low),
                short(high),
                s.unit
            ),
            "leave these cells empty, so that they are gaps",
        );
    }
    let Some(m) = &view.recording.motion else {
        return;
    };
    for marker in std::iter::once(&m.end_effector).chain(&m.base) {
        let zero = |p: &[f64; 3]| p.iter().all(|v| *v == 0.0);
        let rows: Vec<usize> = (0..marker.xyz.len())
            .filter(|&i| zero(&marker.xyz[i]))
            .collect();
        let Some(&first) = rows.first() else { continue };
        let far = |p: &&[f64; 3]| p.iter().map(|v| v * v).sum::<f64>().sqrt() * m.unit.to_si > 5e-3;
        let others = marker.xyz.iter().filter(|p| p[0].is_finite() && !zero(p));
        let (count, all) = (others.clone().filter(far).count(), others.count());
        if count == all && all > 0 {
            let at = view
                .signals
                .iter()
                .find(|s| s.is == Is::Marker)
                .map_or(String::new(), |s| s.at(first));
            found.add(
                "sentinel",
                Grade::Wrong,
                format!(
                    "marker {} is at 0, 0, 0 in {} of {} frames, first {at}, and never near there otherwise: it was not seen",
                    marker.label,
                    rows.len(),
                    marker.xyz.len()
                ),
                "leave these cells empty, so that they are gaps",
            );
        }
    }
}
