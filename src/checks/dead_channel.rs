//! Voltages that are zero while the robot moves.

use super::glance::Poses;
use super::view::{Is, View, short};
use super::wiring::{Hypothesis, SUSPECT};
use super::{Findings, Grade};

/// Below this no film moves visibly, V.
const NOTHING_V: f64 = 20.0;
/// Torque that a chain without voltage has to be given, over that of the others, from which on it was driven.
/// One that the others take along needs up to a fifth of theirs.
const DRIVEN: f64 = 0.8;
/// A motion, in standard deviations of its noise.
const MOTION: f64 = 20.0;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let r = view.recording;
    let (Some(m), Some(v)) = (&r.motion, &r.voltage) else {
        return;
    };
    let scale = v.unit.to_si * v.scale.unwrap_or(1.0);
    let volts: Vec<f64> = view
        .signals
        .iter()
        .filter(|s| s.is == Is::Voltage)
        .filter_map(|s| s.range())
        .map(|[a, b]| a.abs().max(b.abs()) * scale)
        .collect();
    let most = volts.iter().copied().fold(0.0, f64::max);
    if most > NOTHING_V || found.wrong(&["unit", "stated_value"]) {
        return;
    }
    let (mut moves, mut noise) = (0.0_f64, 0.0_f64);
    for s in view.signals.iter().filter(|s| s.is == Is::Marker).take(3) {
        let q = |share| super::linear::quantile(s.values.iter().copied(), share);
        moves = moves.max(q(0.98) - q(0.02));
        noise = noise.max(super::linear::noise(&s.values));
    }
    if moves * m.unit.to_si > 0.3e-3 && moves > MOTION * noise {
        let says = if most == 0.0 {
            "all voltages are zero".to_owned()
        } else {
            format!("no voltage exceeds {} V", short(most))
        };
        found.add(
            "dead_channel",
            Grade::Wrong,
            format!(
                "{says} while marker {} moves by {:.2} mm: what drove it was not logged, or is in another unit",
                m.end_effector.label,
                moves * m.unit.to_si * 1e3
            ),
            "look at the channels under [voltage], their unit (V, kV) and scale, and at the voltage file",
        );
    }
}

/// One channel that does nothing while its chain has to be driven: what is left when that chain is passed
/// over.
pub(super) fn hypothesis(poses: &Poses, squared: &[Vec<f64>; 3]) -> Option<Hypothesis> {
    let size = |k: usize| squared[k].iter().copied().fold(0.0, f64::max);
    let most = (0..3).map(size).fold(0.0, f64::max);
    let silent: Vec<usize> = (0..3).filter(|&k| size(k) < 1e-3 * most).collect();
    // Of single drives the order tells; two that are driven tell of the third.
    let [k] = silent[..] else { return None };
    let without = poses.without(k)?;
    let all = [&squared[0][..], &squared[1][..], &squared[2][..]];
    let look = without.look(all);
    (look.left < SUSPECT && poses.needs(&without, k, all) > DRIVEN).then(|| Hypothesis {
        check: "dead_channel",
        grade: Grade::Wrong,
        left: look.left,
        seems: format!(
            "voltage {0} is zero throughout while arm {0} moves as if it were driven",
            k + 1
        ),
        then: format!("without chain {}", k + 1),
        remedy: format!(
            "look at the channel that [voltage] channels names in place {}, and at its cable",
            k + 1
        ),
    })
}
