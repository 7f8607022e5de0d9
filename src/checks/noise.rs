//! Noise and resolution of the capture, and drives that are too fast for it.

use super::linear::{self, about_mean, quantile};
use super::view::{Is, View};
use super::{Findings, Grade};

/// Noise from which on it is said, and from which on nothing is to be learnt, m. A capture has 0.01 to 0.2
/// mm.
const NOISY_M: f64 = 1e-3;
const HOPELESS_M: f64 = 5e-3;
/// Resolution that is said, m: no capture is coarser than its noise, but a rounded file is.
const COARSE_M: f64 = 0.2e-3;
/// Share of the drive above half the capture's rate that is said.
const ALIASED: f64 = 0.1;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let Some(m) = &view.recording.motion else {
        return;
    };
    let si = m.unit.to_si;
    let moving: Vec<_> = view
        .signals
        .iter()
        .filter(|s| s.is == Is::Marker)
        .take(3)
        .collect();
    let mut noise_m: f64 = 0.0;
    for s in &moving {
        noise_m = noise_m.max(linear::noise(&s.values) * si);
    }
    if noise_m > NOISY_M {
        let stroke = moving
            .iter()
            .map(|s| {
                quantile(s.values.iter().copied(), 0.95) - quantile(s.values.iter().copied(), 0.05)
            })
            .fold(0.0, f64::max)
            * si;
        let hopeless = noise_m > HOPELESS_M || noise_m > 0.3 * stroke;
        found.add(
            "noise",
            if hopeless { Grade::Wrong } else { Grade::Doubtful },
            format!(
                "the capture's noise is {:.1} mm from frame to frame, where the motion is {:.1} mm and captures have 0.01 to 0.2 mm",
                noise_m * 1e3,
                stroke * 1e3
            ),
            "look for reflections, a marker that is taken for another, or a wrong unit",
        );
    }
    let quantum = moving
        .iter()
        .filter_map(|s| quantum(&s.values))
        .fold(f64::INFINITY, f64::min)
        * si;
    if moving.len() == 3 && quantum.is_finite() && quantum > COARSE_M {
        found.add(
            "resolution",
            Grade::Doubtful,
            format!(
                "all positions are whole multiples of {} mm: the file is rounded more coarsely than a capture measures",
                super::view::short(quantum * 1e3)
            ),
            "export the positions with three decimals of a millimetre",
        );
    }
    aliasing(view, found);
}

/// The step of which all values are multiples; none where there is none, or few values.
fn quantum(values: &[f64]) -> Option<f64> {
    let smallest = values
        .windows(2)
        .map(|w| (w[1] - w[0]).abs())
        .filter(|d| *d > 0.0)
        .fold(f64::INFINITY, f64::min);
    let whole = |v: &f64| {
        let r = v / smallest;
        (r - r.round()).abs() < 1e-3 * r.abs().clamp(1.0, 10.0)
    };
    let finite = || values.iter().filter(|v| v.is_finite());
    (smallest.is_finite() && finite().count() > 50 && finite().all(whole)).then_some(smallest)
}

/// A drive faster than half the capture's rate looks slow in it.
fn aliasing(view: &View<'_>, found: &mut Findings) {
    let (Some(m), Some(v)) = (&view.recording.motion, &view.recording.voltage) else {
        return;
    };
    let frame = 1.0 / m.rate_hz;
    for (label, channel) in v.labels.iter().zip(&v.channels) {
        // what a mean over two frames takes away is faster than the capture can show
        let squared: Vec<f64> = channel.iter().map(|x| x * x).collect();
        if squared.iter().any(|x| !x.is_finite()) {
            continue;
        }
        let total = about_mean(&squared);
        let (mut from, mut inside) = (0, 0.0);
        let mut most = 0;
        while from < squared.len() {
            let to = v
                .time_s
                .partition_point(|t| *t < v.time_s[from] + 2.0 * frame)
                .max(from + 1);
            inside += about_mean(&squared[from..to]);
            most = most.max(to - from);
            from = to;
        }
        if most >= 4 && total > 0.0 && inside > ALIASED * total {
            found.add(
                "aliasing",
                Grade::Doubtful,
                format!(
                    "{:.0} % of what voltage {label} does happens within two frames of the capture ({:.1} Hz), which cannot show it",
                    100.0 * inside / total,
                    m.rate_hz
                ),
                "capture faster, or drive slower; and look whether the rate of the capture is stated rightly",
            );
            return;
        }
    }
}
