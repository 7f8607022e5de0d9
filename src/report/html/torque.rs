//! The spring-back torque of the forearms.

use minijinja::context;

use super::page::{Section, safe};
use super::plot::{self, Axis, Band, Mark, Panel, Role, Series, Shade, Width};
use super::{Provenance, number};
use crate::calibration::Outcome;

const TEMPLATE: &str = include_str!("torque.html");

/// Whether a torque was fitted.
fn free(outcome: &Outcome) -> bool {
    let mut torques = outcome.estimates.iter().filter(|e| e.unit == "N m");
    torques.any(|e| !e.fixed)
}

/// See the module. Nothing where there is no torque, and where the first screen shows the curve.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    let zero = outcome
        .parameters
        .forearm
        .torque_n_m()
        .iter()
        .all(|t| *t == 0.0);
    if outcome.job == ON_FIRST_SCREEN || (zero && !free(outcome)) {
        return None;
    }
    let says = match free(outcome) {
        false => "The curve was held here; it comes from the parameters that were given.",
        true => "The torque with which a forearm springs back, as fitted.",
    };
    let context = context! { says => says, figure => safe(picture(outcome)) };
    Some(Section::new("torque", "Forearm torque", TEMPLATE, context))
}

/// The job whose first screen shows the curve.
pub const ON_FIRST_SCREEN: &str = "forearm";

/// The curve with its band, as a figure.
pub fn picture(outcome: &Outcome) -> String {
    let forearm = &outcome.parameters.forearm;
    let nodes = forearm.nodes_rad();
    let (Some(&first), Some(&last)) = (nodes.first(), nodes.last()) else {
        return String::new();
    };
    let free = free(outcome);
    // Without a band the curve is drawn as it is.
    let curve: Vec<[f64; 3]> = if outcome.torque_band.is_empty() {
        let at = |i: i32| first + (last - first) * f64::from(i) / 120.0;
        (0..=120)
            .map(|i| [at(i).to_degrees(), forearm.torque_n_m_at(at(i)) * 1e3, 0.0])
            .collect()
    } else {
        outcome.torque_band.clone()
    };
    let [low, high] = outcome.swing_range_deg;
    let covered = low.is_finite() && high.is_finite();
    let line = Series {
        name: "torque".into(),
        role: Role::One,
        mark: Mark::Line,
        points: curve.iter().map(|r| [r[0], r[1]]).collect(),
    };
    let at = |(n, t): (&f64, &f64)| [n.to_degrees(), t * 1e3];
    let dots = Series {
        name: "nodes".into(),
        role: Role::One,
        mark: Mark::Dots,
        points: nodes.iter().zip(forearm.torque_n_m()).map(at).collect(),
    };
    let band = Band {
        name: if free {
            "95 % band".into()
        } else {
            String::new()
        },
        role: Role::One,
        rows: curve
            .iter()
            .filter(|_| free)
            .map(|r| [r[0], r[1] - r[2], r[1] + r[2]])
            .collect(),
    };
    let shade = Shade {
        name: "range that the recordings cover".into(),
        role: Role::Skip,
        spans: if covered {
            vec![[low, high]]
        } else {
            Vec::new()
        },
    };
    let panel = Panel {
        y: Axis::new("torque, mN m"),
        height: 240.0,
        shades: vec![shade],
        bands: vec![band],
        series: vec![line, dots],
    };
    let ends = [first, last].map(f64::to_degrees);
    let x = Axis::over("forearm swing, deg", [ends[0] - 1.0, ends[1] + 1.0]);
    let panels = [panel];
    let drawing = plot::line_plot("Torque curve of the forearms", &x, &panels, Width::Full);
    let range = match covered {
        true => format!(
            "The recordings swing the forearms from {} to {} degrees.",
            number::fixed(low, 1),
            number::fixed(high, 1)
        ),
        false => "The recordings cover no range of swing.".into(),
    };
    let caption = if free {
        "Outside the shade only smoothness and the prior hold the curve. Where the band is wide even inside it, the level of the curve is not determined."
    } else {
        "The curve as it was used; no recording here tests it outside the shade."
    };
    let caption = format!("{range} {caption}");
    plot::figure(&[drawing], &plot::legend(&panels), &caption)
}
