//! The frame of every report: one file that needs nothing else. It knows no job.

use minijinja::{Environment, UndefinedBehavior, Value, context};

use super::number;

pub(super) const STYLE: &str = include_str!("style.css");
pub(super) const SCRIPT: &str = include_str!("page.js");
const PAGE: &str = include_str!("page.html");
const TABLE: &str = include_str!("table.html");

/// How things stand, in one word and one colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// As it should be.
    Good,
    /// Nearly; look closer.
    Fair,
    /// Not as it should be.
    Poor,
    /// Cannot be told.
    Unknown,
}

/// One key number.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    /// What it is.
    pub label: String,
    /// The number, formatted.
    pub value: String,
    /// Its unit; empty for a count.
    pub unit: String,
    /// Its 95 % interval, or what else belongs to it; may be empty.
    pub note: String,
}

/// One line of a note: what stands out, and the rest of the sentence.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// Set in bold; may be empty.
    pub strong: String,
    /// The sentence, or its end.
    pub text: String,
}

/// An answer of the first screen.
#[derive(Debug, Clone, PartialEq)]
pub struct Note {
    /// The question.
    pub heading: String,
    /// A sentence; may be empty.
    pub lead: String,
    /// More, line by line.
    pub items: Vec<Item>,
}

/// The first screen: the answer in a sentence and a picture, then key numbers, then doubts.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// What it is of: rig, recordings, day; may be empty.
    pub of: String,
    /// Colour of the status word.
    pub status: Status,
    /// The status word.
    pub word: String,
    /// The answer.
    pub headline: String,
    /// A figure that shows it; safe HTML, may be empty.
    pub picture: String,
    /// Key numbers.
    pub tiles: Vec<Tile>,
    /// Answers to what a reader asks next.
    pub notes: Vec<Note>,
}

/// Cards in a row where there is room, at most.
const CARDS: usize = 5;

impl Summary {
    /// Cards in a row where there is room: as many in each row as can be, none left over for a row of its
    /// own.
    fn columns(&self) -> usize {
        let n = self.tiles.len().max(1);
        n.div_ceil(n.div_ceil(CARDS))
    }

    fn context(&self) -> Value {
        let status = match self.status {
            Status::Good => "good",
            Status::Fair => "fair",
            Status::Poor => "poor",
            Status::Unknown => "unknown",
        };
        let tile = |t: &Tile| {
            context! {
                label => t.label.clone(),
                value => t.value.clone(),
                unit => t.unit.clone(),
                note => t.note.clone(),
            }
        };
        let held = number::unbroken;
        let item = |i: &Item| context! { strong => held(&i.strong), text => held(&i.text) };
        let note = |n: &Note| {
            context! {
                heading => n.heading.clone(),
                lead => held(&n.lead),
                items => n.items.iter().map(item).collect::<Vec<_>>(),
            }
        };
        context! {
            of => self.of.clone(),
            picture => safe(self.picture.clone()),
            status => status,
            word => self.word.clone(),
            headline => held(&self.headline),
            columns => self.columns(),
            tiles => self.tiles.iter().map(tile).collect::<Vec<_>>(),
            notes => self.notes.iter().map(note).collect::<Vec<_>>(),
        }
    }
}

/// One section: a title, an anchor, and what its template made of its context.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// Name in the address, without `#`.
    pub anchor: &'static str,
    /// Heading.
    pub title: &'static str,
    /// Body; safe HTML.
    pub html: String,
}

impl Section {
    /// Fills `template` (escaping what the context holds, save values marked safe by [`safe`]).
    pub fn new(anchor: &'static str, title: &'static str, template: &str, context: Value) -> Self {
        Section {
            anchor,
            title,
            html: fill(template, context),
        }
    }

    /// A paragraph and a table.
    pub fn table(anchor: &'static str, title: &'static str, text: &str, table: Table) -> Self {
        let template = "<p>{{ text }}</p>{{ table }}";
        let context = context! { text => text, table => table.html() };
        Section::new(anchor, title, template, context)
    }
}

/// Fills a template, escaping what the context holds.
///
/// # Panics
/// When the template is wrong, or asks for something that the context lacks: templates are part of the
/// program.
pub fn fill(template: &str, context: Value) -> String {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment
        .render_named_str("part.html", template, context)
        .unwrap_or_else(|why| panic!("report template: {why:#}"))
}

/// HTML made by this room, which is not to be escaped again.
pub fn safe(html: String) -> Value {
    Value::from_safe_string(html)
}

/// Text as HTML.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// A whole report.
pub fn page(title: &str, summary: &Summary, sections: &[Section]) -> String {
    let listed: Vec<Value> = sections
        .iter()
        .map(|s| {
            context! { anchor => s.anchor, title => s.title, html => safe(s.html.clone()) }
        })
        .collect();
    let context = context! {
        title => title,
        style => safe(STYLE.to_string()),
        script => safe(SCRIPT.to_string()),
        summary => summary.context(),
        sections => listed,
    };
    fill(PAGE, context)
}

/// A cell of a table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cell {
    /// Text.
    pub text: String,
    /// Classes of the style sheet: `number`, `badge good`, `quiet`, `file`; may be empty.
    pub class: String,
    /// Where it leads, as seen from the page; may be empty.
    pub href: String,
}

impl Cell {
    /// Plain text.
    pub fn text(text: impl Into<String>) -> Self {
        Cell {
            text: text.into(),
            ..Cell::default()
        }
    }

    /// Text that leads to a file.
    pub fn link(text: impl Into<String>, path: &str) -> Self {
        Cell {
            text: text.into(),
            href: path.replace(' ', "%20"),
            ..Cell::default()
        }
    }

    /// A number, set flush right.
    pub fn number(text: impl Into<String>) -> Self {
        Cell::of("number", text)
    }

    /// Text of a class.
    pub fn of(class: &str, text: impl Into<String>) -> Self {
        Cell {
            text: text.into(),
            class: class.into(),
            ..Cell::default()
        }
    }
}

fn cell_contexts(cells: &[Cell]) -> Vec<Value> {
    let cell = |c: &Cell| {
        context! { text => c.text.clone(), class => c.class.clone(), href => c.href.clone() }
    };
    cells.iter().map(cell).collect()
}

/// A table. The first cell of a row is its heading; a row whose other cells are missing spans the table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// What it shows.
    pub caption: String,
    /// Column headings with units; class `number` sets one flush right.
    pub head: Vec<Cell>,
    /// Rows and the class of each (`total`, `group`, or empty).
    pub rows: Vec<(String, Vec<Cell>)>,
}

impl Table {
    /// A table without rows.
    pub fn new(caption: &str, head: Vec<Cell>) -> Self {
        Table {
            caption: caption.into(),
            head,
            rows: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: Vec<Cell>) {
        self.rows.push((String::new(), cells));
    }

    /// Adds a row of a class.
    pub fn row_of(&mut self, class: &str, cells: Vec<Cell>) {
        self.rows.push((class.into(), cells));
    }

    /// As HTML.
    pub fn html(&self) -> Value {
        let row = |(class, cells): &(String, Vec<Cell>)| {
            context! { class => class.clone(), cells => cell_contexts(cells) }
        };
        let context = context! {
            caption => self.caption.clone(),
            head => cell_contexts(&self.head),
            columns => self.head.len(),
            rows => self.rows.iter().map(row).collect::<Vec<_>>(),
        };
        safe(fill(TABLE, context))
    }
}
