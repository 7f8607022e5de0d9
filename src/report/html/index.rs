//! The page that leads to what several runs left in one folder.

use super::page::{self, Cell, Section, Status, Summary, Table};

/// A run, as the page lists it.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Its folder, as seen from the page; empty where it is the page's own.
    pub folder: String,
    /// What was done.
    pub what: String,
    /// What came out, in a sentence.
    pub says: String,
}

/// What a file of a run is for.
const FILES: [(&str, &str); 5] = [
    ("report.html", "what came out, with drawings"),
    (
        "parameters.toml",
        "what was fitted, for --params and --start of other commands",
    ),
    (
        "fit.json, validation.json, diagnosis.json",
        "every number, for programs",
    ),
    (
        "plan.toml",
        "the choices that were made on the recordings, for --plan",
    ),
    ("next_experiment.csv", "the drive that would tell more"),
];

/// The page of `runs`; `headline` is what is to be read first.
pub fn render_index(title: &str, headline: &str, runs: &[Run]) -> String {
    let head = ["Report", "What came out"].map(Cell::text).to_vec();
    let mut table = Table::new("Runs, in the order in which they were made", head);
    for run in runs {
        let path = match run.folder.as_str() {
            "" => "report.html".to_owned(),
            folder => format!("{folder}/report.html"),
        };
        table.row(vec![
            Cell::link(&run.what, &path),
            Cell::text(super::number::words(&run.says)),
        ]);
    }
    let mut files = Table::new(
        "Files of a run",
        ["File", "What it is for"].map(Cell::text).to_vec(),
    );
    for (name, what) in FILES {
        files.row(vec![Cell::of("file", name), Cell::text(what)]);
    }
    let summary = Summary {
        of: String::new(),
        status: Status::Good,
        word: format!("{} runs", runs.len()),
        headline: headline.to_owned(),
        picture: String::new(),
        tiles: Vec::new(),
        notes: Vec::new(),
    };
    let beside = "Beside each report lie its files.";
    let sections = [
        Section::table("runs", "What was done", "Each leads to its report.", table),
        Section::table("files", "What lies there", beside, files),
    ];
    page::page(title, &summary, &sections)
}
