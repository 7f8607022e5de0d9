//! The report of electrodes over days: strokes, what moved, loops overlaid by day, the test between
//! electrodes.

use minijinja::{Value, context};

use super::number::Quantity;
use super::page::{self, Cell, Section, Status, Summary, Table, Tile, safe};
use super::plot::{self, Axis, Mark, Panel, Role, Series, Width};
use super::recordings::curve;
use super::summary::{self, capital, item, note};
use super::{Provenance, number, provenance};
use crate::calibration::{
    AgeingInput, AgeingOutcome, By, ElectrodeAgeing, Joint, SampleAgeing, doubtful, named, open,
    words,
};
use crate::effects::plain_name;
use crate::report::ageing_json::{AgeingJson, CauseJson, Measured, SampleAgeingJson};

const TEMPLATE: &str = include_str!("ageing.html");
/// Colours of electrodes, and of days.
const ROLES: [Role; 5] = [Role::One, Role::Two, Role::Three, Role::Four, Role::Base];
/// The paper's Fig 9: loss of the mean stroke of the first eight loops against day 1, mm and %.
const PAPER: [(&str, f64, f64, f64); 3] = [
    ("CGE", 3.0, 0.23, 17.5),
    ("CGE", 7.0, 0.49, 38.4),
    ("CGE", 14.0, 0.82, 64.3),
];

/// The report of `outcome`; `inputs` are the recordings that it numbers, `json` the same numbers as written;
/// with `paper`, beside the paper's Fig 9.
pub fn render_ageing(
    outcome: &AgeingOutcome,
    inputs: &[AgeingInput],
    json: &AgeingJson,
    paper: bool,
    made_of: &Provenance,
) -> String {
    let sections = [
        strokes(outcome, paper),
        Some(causes(outcome, json)),
        Some(loops(outcome, inputs)),
        difference(json),
        Some(provenance::of(made_of)),
    ];
    let sections: Vec<Section> = sections.into_iter().flatten().collect();
    let title = match outcome.by {
        By::Day => "Electrodes over days",
        By::Batch => "Electrodes over batches",
    };
    let mut summary = first_screen(outcome, json, made_of);
    summary.picture = picture(outcome, paper);
    page::page(title, &summary, &sections)
}

fn first_screen(outcome: &AgeingOutcome, json: &AgeingJson, made_of: &Provenance) -> Summary {
    let any = |f: fn(&crate::calibration::LevelStroke) -> bool| {
        outcome.electrodes.iter().flat_map(|e| &e.levels).any(f)
    };
    let (status, word) = if any(|l| l.relevant && l.significant) {
        (Status::Poor, "changed")
    } else if any(|l| l.significant) {
        (Status::Fair, "changed a little")
    } else {
        (Status::Good, "no change")
    };
    let tiles: Vec<Tile> = outcome
        .electrodes
        .iter()
        .filter_map(|e| {
            let l = e.levels.last()?;
            let shown = Quantity::new(l.change_percent.value, l.percent_ci95, "%");
            Some(Tile {
                label: format!("{}, change by {} {}", e.name, level(outcome.by), l.name),
                value: shown.value,
                unit: shown.unit,
                note: shown.interval,
            })
        })
        .collect();
    let mut notes = vec![note(
        "How sure is the loss?",
        format!(
            "Significant: the 95 % interval of the change excludes 0. Relevant: beyond {} %.",
            outcome.threshold_percent
        ),
        Vec::new(),
    )];
    for (name, list) in &json.causes.0 {
        let items = list
            .iter()
            .filter(|c| c.in_model || c.probability > 0.05)
            .map(|c| item(format!("{}:", capital(&plain_name(&c.effect))), changed(c)))
            .collect();
        notes.push(note(&format!("What moved in {name}?"), "", items));
    }
    for (name, trend) in &json.trend.0 {
        notes.push(note(
            &format!("Trend of {name}"),
            number::words(&trend.says),
            Vec::new(),
        ));
    }
    if let Some(d) = &json.difference {
        notes.push(note(
            "Do the electrodes differ?",
            number::words(&d.last.says),
            Vec::new(),
        ));
    }
    notes.extend(summary::remarks(&json.remarks));
    Summary {
        of: provenance::head(made_of),
        picture: String::new(),
        status,
        word: word.into(),
        headline: number::words(&outcome.verdict),
        tiles,
        notes,
    }
}

fn part(heading: &str, lines: Vec<String>, table: Option<Value>, figure: String) -> Value {
    context! {
        heading => heading,
        lines => lines,
        table => table.unwrap_or_else(|| safe(String::new())),
        figure => safe(figure),
    }
}

fn interval(m: &Measured, digits: usize) -> String {
    match (m.value, m.ci95) {
        (Some(v), [Some(a), Some(b)]) => format!(
            "{} ({} to {})",
            number::fixed(v, digits),
            number::fixed(a, digits),
            number::fixed(b, digits)
        ),
        _ => number::MISSING.into(),
    }
}

/// Where a level stands on the axis: its day, else its number.
fn place(e: &ElectrodeAgeing, level: usize) -> f64 {
    e.levels[level].day.unwrap_or(level as f64 + 1.0)
}

fn level(by: By) -> &'static str {
    match by {
        By::Day => "day",
        By::Batch => "batch",
    }
}

/// What is said of a cause, by how much it changed in its unit.
fn changed(c: &CauseJson) -> String {
    let (Some(first), Some(last)) = (c.by_day.first(), c.by_day.last()) else {
        return number::words(&c.says);
    };
    let Some((says, _)) = c.says.split_once(": changed by ") else {
        return number::words(&c.says);
    };
    let number = |v: Option<f64>| v.unwrap_or(f64::NAN);
    let Measured { value, ci95 } = last.change;
    let size = Quantity::new(number(value), ci95.map(number), &last.unit).with_interval();
    let [from, to] = [first, last].map(|d| match (&d.batch, d.day) {
        (Some(batch), _) => batch.clone(),
        (None, day) => format!("day {}", number::significant(day.unwrap_or(f64::NAN), 3)),
    });
    format!("{says}: changed by {size} from {from} to {to}.")
}

/// Strokes and their change over days.
fn picture(outcome: &AgeingOutcome, paper: bool) -> String {
    let what = level(outcome.by);
    let mut series = Vec::new();
    let mut losses = Vec::new();
    for (i, e) in outcome.electrodes.iter().enumerate() {
        let role = ROLES[i % ROLES.len()];
        let points = |f: &dyn Fn(&crate::calibration::LevelStroke) -> f64| -> Vec<[f64; 2]> {
            (0..e.levels.len())
                .map(|l| [place(e, l), f(&e.levels[l])])
                .collect()
        };
        series.push(curve(
            &e.name,
            role,
            Mark::Line,
            points(&|l| l.stroke_mm.value),
        ));
        for end in 0..2 {
            let ends = points(&|l| l.stroke_ci95[end]);
            series.push(curve(
                &format!("{}, 95 %", e.name),
                role,
                Mark::Dashed,
                ends,
            ));
        }
        losses.push(curve(
            &e.name,
            role,
            Mark::Line,
            points(&|l| l.change_percent.value),
        ));
    }
    let paper = paper && outcome.by == By::Day;
    if paper {
        let days = std::iter::once([1.0, 0.0]).chain(PAPER.iter().map(|p| [p.1, -p.3]));
        losses.push(curve(
            "CGE in the paper",
            Role::Base,
            Mark::Dots,
            days.collect(),
        ));
    }
    let panels = [
        Panel::new("mean stroke, mm", 150.0, series),
        Panel::new("change against the first, %", 130.0, losses),
    ];
    let drawing = plot::line_plot(
        &format!("Mean stroke of each electrode over {what}s"),
        &Axis::new(what),
        &panels,
        Width::Full,
    );
    let dots = match paper {
        true => " Dots: the paper's Fig 9 for carbon grease; its DCPE changes by less than 6 %.",
        false => "",
    };
    let caption =
        format!("Mean stroke of the averaged cycles, and its change against the first.{dots}");
    plot::figure(&[drawing], &plot::legend(&panels), &caption)
}

fn strokes(outcome: &AgeingOutcome, paper: bool) -> Option<Section> {
    let what = level(outcome.by);
    let mut head = vec![Cell::text("electrode"), Cell::number(what)];
    let columns = [
        "stroke, mm (95 %)",
        "change, mm (95 %)",
        "change, % (95 %)",
        "significant",
        "relevant",
        "samples",
    ];
    head.extend(columns.map(Cell::number));
    if paper {
        head.push(Cell::number("paper: mm, %"));
    }
    let mut table = Table::new("Strokes and their change.", head);
    let yes = |b: bool| Cell::text(if b { "yes" } else { "no" });
    for e in &outcome.electrodes {
        for l in &e.levels {
            let show = |v: f64, ci: [f64; 2], digits: usize| {
                let ends = ci.map(|x| number::fixed(x, digits));
                Cell::number(format!(
                    "{} ({} to {})",
                    number::fixed(v, digits),
                    ends[0],
                    ends[1]
                ))
            };
            let mut cells = vec![
                Cell::text(&e.name),
                Cell::number(&l.name),
                show(l.stroke_mm.value, l.stroke_ci95, 3),
                show(l.change_mm.value, l.change_ci95, 3),
                show(l.change_percent.value, l.percent_ci95, 1),
                yes(l.significant),
                yes(l.relevant),
                Cell::number(number::count(l.samples)),
            ];
            if paper {
                let same = |p: &&(&str, f64, f64, f64)| {
                    p.0.eq_ignore_ascii_case(&e.name) && Some(p.1) == l.day
                };
                let shown = PAPER.iter().find(same);
                let shown = shown.map(|p| format!("\u{2212}{}, \u{2212}{}", p.2, p.3));
                cells.push(Cell::number(shown.unwrap_or_default()));
            }
            table.row(cells);
        }
    }
    let says = "The stroke of a cycle is largest minus smallest x of a curve through its frames, freed of what the noise adds; the mean is over the first cycles of each run, as many in each. Intervals are those of the capture's noise where an electrode has one sample.";
    let mut head = vec![Cell::text("electrode"), Cell::number(what)];
    head.push(Cell::number("\u{b5}m a cycle (95 %)"));
    let mut drift = Table::new(
        "Drift of the stroke within the runs, from cycle to cycle: no part of the change between days.",
        head,
    );
    for e in &outcome.electrodes {
        for l in &e.levels {
            let [a, b] = l.drift_mm.ci95();
            let um = |v: f64| number::fixed(v * 1e3, 2);
            drift.row(vec![
                Cell::text(&e.name),
                Cell::number(&l.name),
                Cell::number(format!("{} ({} to {})", um(l.drift_mm.value), um(a), um(b))),
            ]);
        }
    }
    let parts = vec![
        part("", Vec::new(), Some(table.html()), String::new()),
        part(
            "Within the runs",
            Vec::new(),
            Some(drift.html()),
            String::new(),
        ),
    ];
    let context = context! { says => says, parts => parts };
    Some(Section::new("strokes", "Strokes", TEMPLATE, context))
}

fn causes(outcome: &AgeingOutcome, json: &AgeingJson) -> Section {
    let mut parts = Vec::new();
    for e in &outcome.electrodes {
        let written = json.samples.get(&e.name).into_iter().flatten();
        for (s, written) in e.samples.iter().zip(written) {
            parts.push(sample(e, s, written, &json.by));
        }
    }
    let says = "All recordings of a sample, or of a robot, are fitted with one film. Every set of at most two causes is weighed by its evidence, the positions at rest of hanging samples included; a cause is named at odds of 20 to 1 and where no other could stand for it. Values and intervals come from a fit with a value on every day.";
    let context = context! { says => says, parts => parts };
    Section::new("causes", "What moved", TEMPLATE, context)
}

/// What moved in one sample: in words, its values by day, and their drawing.
fn sample(e: &ElectrodeAgeing, s: &SampleAgeing, written: &SampleAgeingJson, by: &str) -> Value {
    let heading = match s.name.is_empty() {
        true => e.name.clone(),
        false => format!("{}, {}", e.name, s.name),
    };
    let joint = match &s.joint {
        Ok(joint) => joint,
        Err(why) => return part(&heading, vec![number::words(why)], None, String::new()),
    };
    let mut lines = vec![
        causes_named(joint),
        format!(
            "One film for all, {} of the noise's mean square left; with nothing allowed to change {}.",
            number::significant(joint.weighted_mean_square, 3),
            number::significant(joint.unchanged_mean_square, 3)
        ),
    ];
    for [a, b] in &written.indistinguishable {
        lines.push(format!(
            "These recordings do not tell {} from {}.",
            plain_name(a),
            plain_name(b)
        ));
    }
    lines.push(at_rest(s, joint));
    let mut head = vec![Cell::text("effect"), Cell::number("probability")];
    head.push(Cell::number(by));
    head.push(Cell::number("value (95 %)"));
    head.push(Cell::text("unit"));
    let mut table = Table::new("What changed, by the chosen model.", head);
    let mut panels = Vec::new();
    for c in &written.causes {
        cause_rows(&mut table, c, e, s);
        if !c.by_day.is_empty() {
            panels.push(over_days(c, e, s));
        }
    }
    let figure = if panels.is_empty() {
        String::new()
    } else {
        let drawing = plot::line_plot(
            &format!("Parameters of {heading} over days"),
            &Axis::new(by),
            &panels,
            Width::Full,
        );
        plot::figure(
            &[drawing],
            &plot::legend(&panels),
            "Parameters that the chosen model lets change.",
        )
    };
    part(&heading, lines, Some(table.html()), figure)
}

/// The sentence that names the causes, those in doubt after the others.
fn causes_named(joint: &Joint) -> String {
    let list: Vec<&str> = named(joint).into_iter().map(words).collect();
    let groups: Vec<String> = open(joint).iter().map(|g| doubtful(g)).collect();
    match (list.is_empty(), groups.is_empty()) {
        (true, false) => format!("Something changed, {}.", groups.join("; ")),
        (true, true) => format!(
            "No cause is named. Probability that nothing changed: {:.2}.",
            joint.nothing
        ),
        (false, true) => format!("Named: {}.", list.join(", ")),
        (false, false) => format!("Named: {}; and {}.", list.join(", "), groups.join(", ")),
    }
}

/// The position at rest, captured and by the model.
fn at_rest(s: &SampleAgeing, joint: &Joint) -> String {
    let levels = joint.levels.iter();
    let lengths: Vec<f64> = levels.filter_map(|l| l.rest_length_m).collect();
    let shown: Vec<String> = s
        .rest_shift_m
        .iter()
        .zip(&lengths)
        .map(|(seen, length)| {
            format!(
                "{} ({})",
                number::fixed(seen * 1e3, 2),
                number::fixed((length - lengths[0]) * 1e3, 2)
            )
        })
        .collect();
    match shown.is_empty() {
        true => "The electrodes of the three actuators are taken to age alike; the pose at rest is part of what is fitted.".into(),
        false => format!(
            "Position at rest against the first, captured (by the model), mm: {}. Values do not rest on it, because it holds how the sample was hung; the choice of causes weighs it.",
            shown.join(", ")
        ),
    }
}

/// A row a day of a cause, or one without a value.
fn cause_rows(table: &mut Table, c: &CauseJson, e: &ElectrodeAgeing, s: &SampleAgeing) {
    let mut first = vec![
        Cell::text(plain_name(&c.effect)),
        Cell::number(number::fixed(c.probability, 2)),
    ];
    if c.by_day.is_empty() {
        first.extend([Cell::number(""), Cell::number(""), Cell::text("")]);
        table.row(first);
        return;
    }
    for (i, d) in c.by_day.iter().enumerate() {
        let mut cells = match i {
            0 => std::mem::take(&mut first),
            _ => vec![Cell::text(""), Cell::number("")],
        };
        let number = |v: Option<f64>| v.unwrap_or(f64::NAN);
        let shown = Quantity::new(number(d.value), d.ci95.map(number), &d.unit);
        cells.push(Cell::number(&e.levels[s.levels[i]].name));
        cells.push(Cell::number(match shown.interval.as_str() {
            "" => shown.value,
            interval => format!("{} ({interval})", shown.value),
        }));
        cells.push(Cell::text(shown.unit));
        table.row(cells);
    }
}

/// The parameter of a cause over the days, with its interval.
fn over_days(c: &CauseJson, e: &ElectrodeAgeing, s: &SampleAgeing) -> Panel {
    let points = |f: &dyn Fn(usize) -> f64| -> Vec<[f64; 2]> {
        (0..c.by_day.len())
            .map(|i| [place(e, s.levels[i]), f(i)])
            .collect()
    };
    let value = |i: usize| c.by_day[i].value.unwrap_or(f64::NAN);
    let mut series = vec![curve(
        &plain_name(&c.effect),
        Role::One,
        Mark::Line,
        points(&value),
    )];
    for end in 0..2 {
        let ends = points(&|i| c.by_day[i].ci95[end].unwrap_or(f64::NAN));
        series.push(curve("95 %", Role::One, Mark::Dashed, ends));
    }
    let title = format!("{}, {}", c.parameter.replace('_', " "), c.by_day[0].unit);
    Panel::new(title, 90.0, series)
}

fn loops(outcome: &AgeingOutcome, inputs: &[AgeingInput]) -> Section {
    let mut parts = Vec::new();
    for e in &outcome.electrodes {
        let mut series: Vec<Series> = Vec::new();
        for run in outcome.runs.iter() {
            let input = &inputs[run.input];
            let own = input
                .electrode
                .as_deref()
                .is_some_and(|n| n.trim().eq_ignore_ascii_case(&e.name));
            // The last averaged cycle of each run, creep behind it.
            let (true, Some(c)) = (own, run.strokes.cycles.last()) else {
                continue;
            };
            let (from, to) = (c.start_s, c.start_s + run.strokes.period_s);
            let points: Vec<[f64; 2]> = (0..input.x_m.len())
                .filter(|&i| {
                    let t = input.start_s + input.step_s * i as f64;
                    (from..=to).contains(&t)
                })
                .map(|i| [input.command_v[i] * 1e-3, input.x_m[i] * 1e3])
                .collect();
            let role = ROLES[run.level % ROLES.len()];
            series.push(curve(&e.levels[run.level].name, role, Mark::Line, points));
        }
        if series.is_empty() {
            continue;
        }
        let key = plot::legend(&[Panel::new("", 0.0, series.clone())]);
        let drawing = plot::loops(
            &format!("Loops of {} overlaid", e.name),
            &Axis::new("command, kV"),
            &Axis::new("x, mm"),
            series,
        );
        let figure = plot::figure(
            &[drawing],
            &key,
            "Captured frames of the last averaged cycle of each run.",
        );
        parts.push(part(&e.name, Vec::new(), None, figure));
    }
    let says = "Displacement against the command, one loop a day.";
    let context = context! { says => says, parts => parts };
    Section::new("loops", "Loops by day", TEMPLATE, context)
}

fn difference(json: &AgeingJson) -> Option<Section> {
    let d = json.difference.as_ref()?;
    let mut head = vec![Cell::text("electrodes"), Cell::text("at")];
    head.extend(
        [
            "difference, points (95 %)",
            "p",
            "samples that would show it",
        ]
        .map(Cell::number),
    );
    let mut table = Table::new("Change of the first minus change of the second.", head);
    for d in &d.all {
        table.row(vec![
            Cell::text(d.electrodes.join(" and ")),
            Cell::text(&d.at),
            Cell::number(interval(&d.change_percent, 2)),
            Cell::number(d.p_value.map_or(number::MISSING.into(), number::chance)),
            Cell::number(
                d.samples_needed
                    .map_or(number::MISSING.into(), |n| n.to_string()),
            ),
        ]);
    }
    let parts = vec![part(
        "",
        vec![number::words(&d.last.says)],
        Some(table.html()),
        String::new(),
    )];
    let says =
        "The test is of the loss in percent, so that films of another thickness can be compared.";
    let context = context! { says => says, parts => parts };
    Some(Section::new(
        "difference",
        "Between electrodes",
        TEMPLATE,
        context,
    ))
}
