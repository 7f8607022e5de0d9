//! The first screen: does it fit, where not, which parameters to trust.

use super::number;
use super::page::{Item, Note, Status, Summary, Tile};
use crate::calibration::{Estimate, Outcome, Standing, WeakDirection};

/// Questions that every report of a fit answers.
pub const WHERE: &str = "Where does it err most?";
/// See [`WHERE`].
pub const TRUSTED: &str = "Which parameters to trust?";
/// See [`WHERE`].
pub const DOUBTED: &str = "Which not to trust, and why?";
/// See [`WHERE`].
pub const HOW_IT_ENDED: &str = "How did the fit end?";

/// Heading of the whole report.
pub fn title(outcome: &Outcome) -> &'static str {
    match outcome.job {
        "film" => "Calibration of the film",
        "forearm" => "Calibration of the forearm",
        "robot" => "Calibration of film and forearm",
        "validate" => "Prediction against measurement",
        _ => "Calibration",
    }
}

/// Colour and word of a standing.
pub fn standing(of: Standing) -> (Status, &'static str) {
    match of {
        Standing::CannotBeJudged => (Status::Unknown, "cannot be judged"),
        Standing::Fits => (Status::Good, "fits"),
        Standing::NearlyFits => (Status::Fair, "nearly fits"),
        Standing::DoesNotFit => (Status::Poor, "does not fit"),
    }
}

/// The first screen.
pub fn summary(outcome: &Outcome) -> Summary {
    let (status, word) = standing(match outcome.total.samples {
        0 => Standing::CannotBeJudged,
        _ => Standing::of(outcome.total.rmse_v / outcome.total.noise_floor_v),
    });
    let notes = [
        worst(outcome),
        trusted(outcome),
        covered(outcome),
        how_it_ended(outcome),
        doubted(&outcome.estimates, &outcome.weak_directions),
        remarks(&outcome.remarks),
    ];
    Summary {
        status,
        word: word.into(),
        headline: number::words(&outcome.verdict),
        tiles: tiles(outcome),
        notes: notes.into_iter().flatten().collect(),
    }
}

/// A key number with its unit, or without where there is none.
pub fn tile(label: &str, value: String, unit: &str) -> Tile {
    Tile {
        label: label.into(),
        unit: if value == number::MISSING { "" } else { unit }.into(),
        value,
    }
}

fn tiles(outcome: &Outcome) -> Vec<Tile> {
    let t = &outcome.total;
    let volt = |v: f64| number::significant(v, 3);
    let largest = if t.samples == 0 {
        f64::NAN
    } else {
        t.max_error_v
    };
    let out = vec![
        tile("Error above 1 kV, rms", volt(t.rmse_v), "V"),
        tile("Noise floor, rms", volt(t.noise_floor_v), "V"),
        tile("Largest error above 1 kV", volt(largest), "V"),
        tile("Samples above 1 kV", number::count(t.samples), ""),
        tile("Recordings", number::count(outcome.recordings.len()), ""),
    ];
    out
}

/// A question and its answer.
pub fn note(heading: &str, lead: impl Into<String>, items: Vec<Item>) -> Note {
    Note {
        heading: heading.into(),
        lead: lead.into(),
        items,
    }
}

/// A line of an answer.
pub fn item(strong: impl Into<String>, text: impl Into<String>) -> Item {
    Item {
        strong: strong.into(),
        text: text.into(),
    }
}

fn worst(outcome: &Outcome) -> Option<Note> {
    if outcome.total.samples == 0 {
        return None;
    }
    let lead = match outcome.worst.first() {
        None => "No place has enough samples above 1 kV to be judged by itself.",
        Some(w) if w.ratio < Standing::RATIOS[0] => {
            "Nowhere does the error stand out from the noise. The places with the largest error, against what the noise makes there:"
        }
        Some(_) => {
            "The places with the largest error, against what the noise of the capture makes there:"
        }
    };
    // Where nothing stands out, shares of an excess mean nothing.
    let stands_out = outcome
        .worst
        .first()
        .is_some_and(|w| w.ratio >= Standing::RATIOS[0]);
    let items = outcome
        .worst
        .iter()
        .map(|w| {
            let mut text = format!(
                "{} V rms, {} times the noise",
                number::significant(w.rmse_v, 3),
                number::significant(w.ratio, 3)
            );
            if stands_out && w.share >= 0.005 {
                text += &format!("; {} of the excess over it", number::per_cent(w.share));
            }
            item(format!("{}:", number::words(&w.place)), text)
        })
        .collect();
    Some(note(WHERE, lead, items))
}

/// A sentence with its first letter large.
pub fn capital(sentence: &str) -> String {
    let mut letters = sentence.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// What is said of the estimates, each saying once with the names of which it is said. A saying is taken
/// apart where its figures begin, so that `determined to 0.9 %` and `determined to 3 %` are one saying with
/// two names.
fn grouped<'a>(estimates: impl Iterator<Item = &'a Estimate>) -> Vec<Item> {
    let mut groups: Vec<(String, Vec<String>)> = Vec::new();
    for e in estimates {
        let says = number::words(&e.says);
        let (says, figure) = if let Some(figure) = says.strip_prefix("determined to ") {
            ("determined", format!(" to {figure}"))
        } else if let Some((says, figure)) = says.split_once(" (") {
            (says, format!(" ({figure}"))
        } else {
            (says.as_str(), String::new())
        };
        let name = format!("{}{figure}", e.name);
        match groups.iter_mut().find(|g| g.0 == says) {
            Some(group) => group.1.push(name),
            None => groups.push((says.to_string(), vec![name])),
        }
    }
    let line = |(says, names): (String, Vec<String>)| {
        item(
            format!("{}:", capital(&says)),
            format!("{}.", names.join(", ")),
        )
    };
    groups.into_iter().map(line).collect()
}

fn trusted(outcome: &Outcome) -> Option<Note> {
    let free = outcome.estimates.iter().filter(|e| !e.fixed);
    let number = free.clone().count();
    if number == 0 {
        return None;
    }
    let good = free.filter(|e| e.identifiable && e.at_bound.is_none());
    let count = good.clone().count();
    let lead = if count == 0 {
        format!("The recordings determine none of the {number} free parameters by itself.")
    } else {
        format!(
            "The recordings determine {count} of {number} free parameters (to a third of the value; torques to 0.2 mN m; clock offsets to 10 ms)."
        )
    };
    Some(note(TRUSTED, lead, grouped(good)))
}

/// Parameters that are not determined, and why.
pub fn doubted(estimates: &[Estimate], weak_directions: &[WeakDirection]) -> Option<Note> {
    let bad = estimates
        .iter()
        .filter(|e| !e.fixed && (!e.identifiable || e.at_bound.is_some()));
    let mut items = grouped(bad);
    let weak = weak_directions.iter();
    items.extend(weak.map(|w| item("Open together:", format!("{}.", number::words(&w.says)))));
    if items.is_empty() {
        return None;
    }
    let lead = if weak_directions.is_empty() {
        ""
    } else {
        "Parameters that are open together may move jointly while the prediction hardly changes."
    };
    Some(note(DOUBTED, lead, items))
}

fn covered(outcome: &Outcome) -> Option<Note> {
    let [low, high] = outcome.swing_range_deg;
    if !(low.is_finite() && high.is_finite()) {
        return None;
    }
    let lead = format!(
        "The recordings swing the forearms from {} to {} degrees. Outside that range the torque curve is not supported by data.",
        number::fixed(low, 1),
        number::fixed(high, 1)
    );
    Some(note("What do the recordings cover?", lead, Vec::new()))
}

/// How the fit ended, in a sentence.
pub fn ended(converged: bool, reason: &str) -> String {
    let how = if converged {
        "The fit converged"
    } else {
        "The fit did not converge: take its numbers as provisional. It ended"
    };
    let reason = number::words(reason);
    let reason = ["converged: ", "not converged: "]
        .iter()
        .find_map(|p| reason.strip_prefix(p))
        .unwrap_or(&reason);
    if reason.is_empty() {
        format!("{how}.")
    } else {
        format!("{how}: {reason}.")
    }
}

fn how_it_ended(outcome: &Outcome) -> Option<Note> {
    if outcome.evaluations == 0 {
        return None;
    }
    let mut lead = ended(outcome.converged, &outcome.reason);
    if outcome.weighted_mean_square.is_finite() && outcome.noise_mean_square.is_finite() {
        lead += &format!(
            " The weighted mean square residual is {}, where the noise alone makes {}.",
            number::significant(outcome.weighted_mean_square, 3),
            number::significant(outcome.noise_mean_square, 3)
        );
    }
    lead += &failed(outcome.failed_evaluations, outcome.evaluations);
    Some(note(HOW_IT_ENDED, lead, Vec::new()))
}

/// What is said of evaluations that failed; nothing where none did.
pub fn failed(failed: usize, all: usize) -> String {
    match failed {
        0 => String::new(),
        n => format!(
            " {} of {} evaluations failed.",
            number::count(n),
            number::count(all)
        ),
    }
}

/// What else to know.
pub fn remarks(remarks: &[String]) -> Option<Note> {
    let items: Vec<_> = remarks.iter().map(|r| item("", number::words(r))).collect();
    (!items.is_empty()).then(|| note("What else to know", "", items))
}
