//! A report as one HTML file that opens without a network and needs no script to be read.
//!
//! [`page`](mod@page) is the frame and [`plot`] draws; neither knows what a calibration is, so that other
//! jobs use them with their own outcomes. A section of the calibration report is one file here: a title, an
//! anchor, a template and a context. A new one is a file and a line in `SECTIONS`. Nothing is worked out here
//! but where a mark goes on the page (which includes the distance of two curves that are drawn over each
//! other).

mod ageing;
mod contributions;
mod coupon;
mod diagnosis;
mod errors;
mod findings;
mod index;
mod learnt;
mod line;
pub mod looks;
mod mechanism;
pub mod number;
pub mod page;
mod parameters;
pub mod plot;
mod provenance;
mod quality;
mod recordings;
pub mod reduce;
mod sample;
mod starts;
mod summary;
mod torque;
mod validation;
pub mod view;

use crate::calibration::Outcome;
use crate::report::answer::Answer;
use crate::report::provenance::Provenance;
use page::Section;

pub use ageing::render_ageing;
pub use coupon::render_coupons;
pub use diagnosis::render_diagnosis;
pub use findings::{render_recording, with_findings};
pub use index::{Run, render_index};
pub use line::render_lines;
pub use mechanism::skeleton;
pub use sample::render_samples;
pub(super) use summary::capital;
pub use validation::{render_validation, words as validation_words};

type MakeSection = fn(&Outcome, &Provenance) -> Option<Section>;

/// The sections of a calibration report below its first screen, in order. One that has nothing to show gives
/// `None`.
const SECTIONS: [MakeSection; 8] = [
    recordings::section,
    torque::section,
    contributions::section,
    starts::section,
    parameters::section,
    errors::section,
    quality::section,
    provenance::section,
];

/// The report of a calibration of a robot.
pub fn render(outcome: &Outcome, answer: &Answer, provenance: &Provenance) -> String {
    let sections: Vec<Section> = SECTIONS
        .iter()
        .filter_map(|make| make(outcome, provenance))
        .collect();
    let title = summary::title(outcome);
    page::page(
        title,
        &summary::summary(outcome, answer, provenance),
        &sections,
    )
}

/// The colours of actuators 1 to 3, wherever they are told apart by colour.
const ACTUATORS: [(&str, plot::Role); 3] = [
    ("actuator 1", plot::Role::One),
    ("actuator 2", plot::Role::Four),
    ("actuator 3", plot::Role::Three),
];

#[cfg(test)]
mod tests;
