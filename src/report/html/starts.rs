//! The starts of the fit: whether the best result is found again and again, or once by luck.

use minijinja::context;

use super::page::{Cell, Section, Table, safe};
use super::{Provenance, number, plot, summary};
use crate::calibration::{Outcome, StartOutcome};

const TEMPLATE: &str = include_str!("starts.html");
/// Relative difference of cost up to which a start counts as having reached the best.
const SAME: f64 = 1e-3;

/// See the module.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    let mut ended = summary::end(outcome.converged, &outcome.reason);
    if outcome.weighted_mean_square.is_finite() && outcome.noise_mean_square.is_finite() {
        ended += &format!(
            " The weighted mean square residual is {}, where the noise alone makes {}.",
            number::significant(outcome.weighted_mean_square, 3),
            number::significant(outcome.noise_mean_square, 3)
        );
    }
    ended += &summary::failed(outcome.failed_evaluations, outcome.evaluations);
    of(
        &outcome.starts,
        "sum of squares per residual with equal weights",
        &ended,
    )
}

/// The section of any job; `cost` says what the cost is, `ended` how the fit ended.
pub fn of(starts: &[StartOutcome], cost: &str, ended: &str) -> Option<Section> {
    let costs: Vec<f64> = starts.iter().map(|s| s.cost).collect();
    let best = costs.iter().copied().filter(|c| c.is_finite());
    let best = best.fold(f64::INFINITY, f64::min);
    let reached = |cost: f64| cost <= best * (1.0 + SAME);
    let number = costs.iter().filter(|c| reached(**c)).count();
    let all = starts.len();
    let says = match (all, number) {
        (0, _) => return None,
        (_, 0) => "No start ended at a finite cost.".to_string(),
        (1, _) => {
            "There was one start; more starts would tell whether it found the best fit.".into()
        }
        (_, 1) => format!(
            "Only one of {all} starts reached the lowest cost (to 1 in 1000): the lowest may not have been found, try more starts."
        ),
        (_, n) if n == all => format!(
            "All {all} starts reached the same lowest cost (to 1 in 1000): there is no sign of a better fit elsewhere."
        ),
        (_, n) if n + 1 == all => format!(
            "{n} of {all} starts reached the lowest cost (to 1 in 1000); the other ended in a worse place, which it alone would have passed for the answer."
        ),
        (_, n) => format!(
            "{n} of {all} starts reached the lowest cost (to 1 in 1000); the others ended in worse places, which a single start could have taken for the answer."
        ),
    };
    let head = [
        ("rank", true),
        ("where it began", false),
        ("cost", true),
        ("evaluations", true),
        ("failed", true),
        ("how it ended", false),
    ];
    let head = head.map(|(text, number)| match number {
        true => Cell::number(text),
        false => Cell::text(text),
    });
    let mut table = Table::new(&format!("Starts, best first. Cost: {cost}."), head.to_vec());
    for (i, s) in starts.iter().enumerate() {
        table.row(vec![
            Cell::number((i + 1).to_string()),
            Cell::text(&s.origin),
            Cell::number(number::significant(s.cost, 5)),
            Cell::number(number::count(s.evaluations)),
            Cell::number(number::count(s.failed)),
            Cell::text(number::words(&s.ended)),
        ]);
    }
    let figure = if all > 1 {
        let drawing = plot::waterfall(
            "Cost of the starts by rank",
            "rank of the start",
            "cost (logarithmic, no unit)",
            &costs,
            reached,
        );
        let caption = "Blue: reached the lowest cost. A flat beginning is what to look for; steps are other minima.";
        plot::figure(&[drawing], "", caption)
    } else {
        String::new()
    };
    let context = context! { says => format!("{ended} {says}"), figure => safe(figure), table => table.html() };
    Some(Section::new(
        "starts",
        "Starts of the fit",
        TEMPLATE,
        context,
    ))
}
