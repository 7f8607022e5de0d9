//! What is wrong with the recordings: the first thing on a page, before any number that was made of them.

use minijinja::context;

use super::page::{self, Section, Status, Summary};
use super::summary::{item, note};
use super::{Provenance, provenance};
use crate::checks::{Finding, Grade};

const TEMPLATE: &str = include_str!("findings.html");
/// Where a page begins.
const BEGINS: &str = "<main>";

/// The page with the findings before everything else; as it is where there are none.
#[must_use]
pub fn with_findings(page: String, findings: &[Finding]) -> String {
    if findings.is_empty() {
        return page;
    }
    let list: Vec<_> = findings
        .iter()
        .map(|f| {
            context! {
                grade => f.grade.name(),
                class => if f.grade == Grade::Wrong { "poor" } else { "fair" },
                recording => f.recording.clone(),
                check => f.check.replace('_', " "),
                line => f.line(),
            }
        })
        .collect();
    let wrong = findings.iter().any(|f| f.grade == Grade::Wrong);
    let section = Section::new(
        "findings",
        "The recordings",
        TEMPLATE,
        context! { list => list, wrong => wrong },
    );
    page.replacen(BEGINS, &format!("{BEGINS}\n{}", section.html), 1)
}

/// The report of a diagnosis that stops at its recordings.
#[must_use]
pub fn render_recording(says: &str, findings: &[Finding], made_of: &Provenance) -> String {
    let summary = Summary {
        of: provenance::head(made_of),
        picture: String::new(),
        status: Status::Poor,
        word: "first mend the recording".into(),
        headline: says.into(),
        tiles: Vec::new(),
        notes: vec![note(
            "What was fitted?",
            "Nothing that is shown here: a cause that was named on these recordings would be a guess at the mistake.",
            vec![item(
                "What to do:",
                "what stands beside each finding above; then run the same command again.",
            )],
        )],
    };
    let page = page::page(
        "Diagnosis of the model",
        &summary,
        &[provenance::of(made_of)],
    );
    with_findings(page, findings)
}
