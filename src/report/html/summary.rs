//! The first screen: the answer, a picture of it, its numbers; then what weakens it.

use super::page::{Item, Note, Status, Summary, Tile};
use super::{Provenance, number, provenance, recordings, torque};
use crate::calibration::{Estimate, Outcome, Standing, WorstPlace};
use crate::report::answer::{self, Answer, Fact, Open};

/// Questions that every report of a fit answers.
pub const WHERE: &str = "Where does it err most?";
/// See [`WHERE`].
pub const OPEN: &str = "What do the recordings leave open?";
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
pub fn summary(outcome: &Outcome, answer: &Answer, made_of: &Provenance) -> Summary {
    let (status, word) = standing(match outcome.total.samples {
        0 => Standing::CannotBeJudged,
        _ => Standing::of(outcome.total.rmse_v / outcome.total.noise_floor_v),
    });
    let notes = [
        ended(outcome.evaluations, outcome.converged, &outcome.reason),
        worst(outcome),
        open(&outcome.estimates, answer),
        remarks(&answer::remarks(outcome)),
    ];
    let mut tiles = facts(answer);
    tiles.extend(errors(outcome));
    Summary {
        of: provenance::head(made_of),
        status,
        word: word.into(),
        headline: number::words(&answer.says),
        picture: match outcome.job {
            torque::ON_FIRST_SCREEN => torque::picture(outcome),
            _ => recordings::picture(outcome),
        },
        tiles,
        notes: notes.into_iter().flatten().collect(),
    }
}

/// A key number with its unit, or without where there is none.
pub fn tile(label: &str, value: String, unit: &str) -> Tile {
    Tile {
        label: label.into(),
        unit: if value == number::MISSING { "" } else { unit }.into(),
        value,
        note: String::new(),
    }
}

/// A size as a key number.
pub fn sized(label: &str, value: f64, unit: &str) -> Tile {
    let (factor, unit) = number::scaled(value, unit);
    tile(label, number::significant(factor * value, 3), &unit)
}

/// The quantities of an answer as key numbers.
pub fn facts(answer: &Answer) -> Vec<Tile> {
    let fact = |f: &Fact| Tile {
        label: capital(&f.what),
        value: f.size.value.clone(),
        unit: f.size.unit.clone(),
        note: f.size.interval.clone(),
    };
    answer.facts.iter().map(fact).collect()
}

fn errors(outcome: &Outcome) -> Vec<Tile> {
    let t = &outcome.total;
    if t.samples == 0 {
        return Vec::new();
    }
    vec![
        sized("Error above 1 kV, rms", t.rmse_v, "V"),
        sized("Noise alone makes", t.noise_floor_v, "V"),
        sized("Largest error above 1 kV", t.max_error_v, "V"),
    ]
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

/// The places with the largest error, where one stands out.
fn worst(outcome: &Outcome) -> Option<Note> {
    let stands_out = |w: &WorstPlace| w.ratio >= Standing::RATIOS[0];
    if !outcome.worst.first().is_some_and(stands_out) {
        return None;
    }
    let items = outcome.worst.iter().filter(|w| stands_out(w)).map(|w| {
        let mut text = format!(
            "{} V rms, {} times the noise",
            number::significant(w.rmse_v, 3),
            number::significant(w.ratio, 3)
        );
        if w.share >= 0.005 {
            text += &format!("; {} of the excess over it", number::per_cent(w.share));
        }
        item(format!("{}:", capital(&number::words(&w.place))), text)
    });
    Some(note(WHERE, "", items.collect()))
}

/// A sentence with its first letter large.
pub fn capital(sentence: &str) -> String {
    let mut letters = sentence.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// What is open, said once as what to record.
pub fn open(estimates: &[Estimate], answer: &Answer) -> Option<Note> {
    let free = estimates.iter().filter(|e| !e.fixed).count();
    let known = estimates
        .iter()
        .filter(|e| !e.fixed && e.identifiable && e.at_bound.is_none());
    let lead = format!(
        "{} of {free} free parameters are determined, to a third of the value or better. What would determine the others:",
        known.count(),
    );
    let line = |o: &Open| item(format!("{}:", capital(&o.record)), o.what.clone());
    let items: Vec<Item> = answer.open.iter().map(line).collect();
    (!items.is_empty()).then(|| note(OPEN, lead, items))
}

/// How a fit ended that did not converge.
pub fn ended(evaluations: usize, converged: bool, reason: &str) -> Option<Note> {
    let lead = end(converged, reason);
    (evaluations > 0 && !converged).then(|| note(HOW_IT_ENDED, lead, Vec::new()))
}

/// How the fit ended, in a sentence.
pub fn end(converged: bool, reason: &str) -> String {
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
