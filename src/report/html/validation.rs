//! Prediction against measurement: voltage, path, force and stroke of several parameter files side by side,
//! and, where that is asked for, the numbers that the paper reports of its own robot.

use minijinja::{Value, context};

use super::page::{self, Cell, Item, Section, Table, safe};
use super::plot::{self, Axis, Mark, Panel, Role, Width};
use super::{Provenance, SECTIONS, number, recordings, summary};
use crate::report::answer::Answer;
use crate::validation::{ForceErrors, Phase, RecordingCheck, Validation};

const FIGURES: &str = include_str!("validation.html");
const PLOTS: &str = include_str!("validation_plots.html");

/// A parameter file's name and what its parameters predict.
type Model = (String, Validation);

/// Errors of x, y, z on the paper's circles of 3 s a turn, of 3 s with 2 g, and of 8 s, as printed (text of
/// Fig 11), mm: rms and largest.
const PAPER_PATH: [[&str; 2]; 3] = [
    [
        "0.18 (1.8 %); 0.13 (1.3 %); 0.23 (1.7 %)",
        "0.56 (5.6 %); 0.39 (4.1 %); -0.67 (-6.7 %)",
    ],
    [
        "0.21 (2.1 %); 0.24 (2.5 %); 0.18 (2.2 %)",
        "-0.52 (-5.2 %); 0.67 (7.0 %); -0.50 (-5.0 %)",
    ],
    [
        "1.03 (3.0 %); 0.81 (1.6 %); 0.81 (2.3 %)",
        "2.03 (6.0 %); 1.44 (3.0 %); -1.93 (-5.6 %)",
    ],
];

/// What path, force and stroke say, a sentence a recording.
pub fn words(validation: &Validation) -> Vec<String> {
    let mut out = Vec::new();
    for c in &validation.checks {
        let mut parts = Vec::new();
        if let Some(p) = &c.path {
            let list = |v: [f64; 3]| v.map(|v| number::significant(v.abs(), 2)).join(", ");
            let relative = [0, 1, 2].map(|k| p.rmse_mm[k] / p.relative_to_mm[k]);
            let share = |v: f64| match v.is_nan() {
                true => number::MISSING.to_string(),
                false => per_cent(v),
            };
            parts.push(format!(
                "{} {} mm rms in x, y, z ({}), at most {} mm",
                if p.planned {
                    "path off the plan by"
                } else {
                    "path off by"
                },
                list(p.rmse_mm),
                relative.map(share).join(", "),
                list(p.max_mm)
            ));
        }
        let phases: Vec<String> = c
            .force
            .iter()
            .map(|f| {
                format!(
                    "{} {}",
                    number::significant(1e3 * f.z_rmse_n, 2),
                    f.phase.words()
                )
            })
            .collect();
        if !phases.is_empty() {
            parts.push(format!(
                "vertical force off by (mN rms) {}",
                phases.join(", ")
            ));
        }
        let [measured, predicted] = c.stroke_mm;
        parts.push(match predicted.is_nan() {
            true => format!("stroke {} mm", number::fixed(measured, 2)),
            false => format!(
                "stroke {} mm, predicted {} mm",
                number::fixed(measured, 2),
                number::fixed(predicted, 2)
            ),
        });
        out.push(format!("{}: {}.", c.id, parts.join("; ")));
    }
    out
}

/// The report of a validation: `models` with their answers beside each other, details of voltage from the
/// first; with `paper`, beside the paper's robot.
pub fn render_validation(
    models: &[Model],
    answers: &[Answer],
    paper: bool,
    provenance: &Provenance,
) -> String {
    let (_, first) = &models[0];
    let outcome = &first.outcome;
    let mut sections = vec![figures(models, paper)];
    sections.extend(path(models));
    sections.extend(force(models));
    sections.extend(SECTIONS.iter().filter_map(|make| make(outcome, provenance)));
    let mut summary = summary::summary(outcome, &answers[0], provenance);
    summary.tiles.extend(strokes(first));
    let items: Vec<Item> = models
        .iter()
        .flat_map(|(name, v)| {
            let name = if models.len() > 1 {
                name.clone()
            } else {
                String::new()
            };
            words(v)
                .into_iter()
                .map(move |text| summary::item(name.clone(), text))
        })
        .collect();
    let lead = match paper {
        true => {
            "The paper's robot: path to 2.5 % rms of the diameter in x and y and 3.0 % of the stroke in z; vertical force to 6 mN rms (12.4 % of 0.05 N) while holding."
        }
        false => "",
    };
    let heading = "How well are path, force and stroke predicted?";
    summary.notes.insert(0, summary::note(heading, lead, items));
    if models.len() > 1 {
        let each = models.iter().zip(answers);
        let items =
            each.map(|((name, _), a)| summary::item(format!("{name}:"), number::words(&a.says)));
        let heading = "How do the parameter files compare?";
        summary
            .notes
            .insert(0, summary::note(heading, "", items.collect()));
    }
    let remarks: Vec<String> = models
        .iter()
        .flat_map(|(_, v)| v.checks.iter().flat_map(|c| c.remarks.clone()))
        .collect();
    summary.notes.extend(summary::remarks(&remarks));
    page::page(summary::title(outcome), &summary, &sections)
}

/// Path and stroke of the first recording, as key numbers.
fn strokes(validation: &Validation) -> Vec<page::Tile> {
    let mut out = Vec::new();
    let Some(check) = validation.checks.first() else {
        return out;
    };
    if let Some(path) = &check.path {
        let worst = path.rmse_mm.into_iter().fold(0.0, f64::max);
        out.push(summary::sized(
            "Path off by, rms, worst axis",
            worst * 1e-3,
            "m",
        ));
    }
    let [measured, predicted] = check.stroke_mm.map(|v| number::fixed(v, 2));
    let mut tile = summary::tile("Stroke", measured, "mm");
    if predicted != number::MISSING {
        tile.note = format!("predicted {predicted}");
    }
    out.push(tile);
    out
}

/// A share as the paper writes it: to a tenth of a per cent.
fn per_cent(share: f64) -> String {
    format!("{} %", number::fixed(100.0 * share, 1))
}

/// A number with its share of something, `0.18 (1.8 %)`.
fn with_share(value: f64, whole: f64) -> String {
    let text = number::significant(value, 3);
    let share = value.abs() / whole;
    match share.is_finite() {
        true => format!("{text} ({})", per_cent(share)),
        false => text,
    }
}

fn figures(models: &[Model], compare: bool) -> Section {
    let mut head = vec![Cell::text("recording, figure")];
    head.extend(models.iter().map(|(name, _)| Cell::number(name)));
    if compare {
        head.push(Cell::number("paper"));
    }
    let caption = "Measured against predicted, a column a parameter file.";
    let mut figures = Figures {
        table: Table::new(caption, head),
        models,
        compare,
    };
    let count = models[0].1.checks.len();
    for i in 0..count {
        let head = vec![Cell::text(&models[0].1.checks[i].id)];
        figures.table.row_of("group", head);
        figures.row(
            "voltage above 1 kV, V rms",
            |v| number::significant(v.outcome.recordings[i].total.rmse_v, 3),
            number::MISSING,
        );
        figures.row(
            "voltage above 1 kV, largest, V",
            |v| number::significant(v.outcome.recordings[i].total.max_error_v, 3),
            number::MISSING,
        );
        figures.path(i);
        for phase in Phase::ALL {
            figures.force(i, phase);
        }
        figures.row(
            "stroke measured, mm",
            |v| number::fixed(v.checks[i].stroke_mm[0], 2),
            "34; 49.3; 34",
        );
        figures.row(
            "stroke predicted, mm",
            |v| number::fixed(v.checks[i].stroke_mm[1], 2),
            number::MISSING,
        );
    }
    let context = context! { table => figures.table.html(), paper => compare };
    let title = match compare {
        true => "Voltage, path, force and stroke beside the paper's",
        false => "Voltage, path, force and stroke in numbers",
    };
    Section::new("figures", title, FIGURES, context)
}

/// The table of figures as it grows.
struct Figures<'a> {
    table: Table,
    models: &'a [Model],
    /// With a column of the paper's.
    compare: bool,
}

impl Figures<'_> {
    /// A figure of every model, and the paper's.
    fn row(&mut self, name: &str, value: impl Fn(&Validation) -> String, paper: &str) {
        let mut cells = vec![Cell::of("quiet", name)];
        cells.extend(self.models.iter().map(|(_, v)| Cell::number(value(v))));
        if self.compare {
            cells.push(Cell::number(paper));
        }
        self.table.row(cells);
    }

    /// Errors of the path of recording `i`.
    fn path(&mut self, i: usize) {
        let cell = |p: Option<(f64, f64)>| {
            p.map_or_else(|| number::MISSING.to_string(), |(v, w)| with_share(v, w))
        };
        for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
            self.row(
                &format!("path {axis}, mm rms"),
                |v| {
                    let path = v.checks[i].path;
                    cell(path.map(|p| (p.rmse_mm[k], p.relative_to_mm[k])))
                },
                PAPER_PATH[k][0],
            );
            self.row(
                &format!("path {axis}, largest, mm"),
                |v| {
                    let path = v.checks[i].path;
                    cell(path.map(|p| (p.max_mm[k], p.relative_to_mm[k])))
                },
                PAPER_PATH[k][1],
            );
        }
    }

    /// Errors of the force in a phase of recording `i`, where any model has it.
    fn force(&mut self, i: usize, phase: Phase) {
        let of = |v: &Validation| v.checks[i].force.iter().position(|f| f.phase == phase);
        if !self.models.iter().any(|(_, v)| of(v).is_some()) {
            return;
        }
        // Text of Fig 12, mN: 5 g on the end effector.
        let [z, z_max, xy] = match phase {
            Phase::Idle => [number::MISSING; 3],
            Phase::Holding => ["6 (12.4 %)", "16", "20"],
            Phase::Moving => ["70", "-330", "30"],
            Phase::Released => ["23", number::MISSING, number::MISSING],
        };
        let text = |v: &Validation, what: fn(&ForceErrors) -> f64, share: bool| {
            let c = &v.checks[i];
            let whole = if share { 1e3 * c.largest_load_n } else { 0.0 };
            of(v).map_or_else(
                || number::MISSING.to_string(),
                |f| with_share(1e3 * what(&c.force[f]), whole),
            )
        };
        let words = phase.words();
        self.row(
            &format!("force z, {words}, mN rms"),
            |v| text(v, |f| f.z_rmse_n, true),
            z,
        );
        self.row(
            &format!("force z, {words}, largest, mN"),
            |v| text(v, |f| f.z_max_n, false),
            z_max,
        );
        self.row(
            &format!("force xy, {words}, mN rms"),
            |v| text(v, |f| f.xy_rmse_n, false),
            xy,
        );
    }
}

/// Colours of the parameter files, in turn.
const MODELS: [Role; 5] = [Role::One, Role::Two, Role::Three, Role::Four, Role::Five];

/// `value(i)` at each frame.
fn over_time(c: &RecordingCheck, value: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
    c.time_s
        .iter()
        .enumerate()
        .map(|(i, t)| [*t, value(i)])
        .collect()
}

/// Name of a model's curve in the legend.
fn label(models: &[Model], m: usize, word: &str) -> String {
    match models.len() {
        1 => word.into(),
        _ => format!("{word}, {}", models[m].0),
    }
}

fn section(
    anchor: &'static str,
    title: &'static str,
    says: &str,
    items: Vec<Value>,
) -> Option<Section> {
    if items.is_empty() {
        return None;
    }
    let context = context! { says => says, recordings => items };
    Some(Section::new(anchor, title, PLOTS, context))
}

fn path(models: &[Model]) -> Option<Section> {
    let mut items = Vec::new();
    for i in 0..models[0].1.checks.len() {
        let first = &models[0].1.checks[i];
        let Some(errors) = &first.path else { continue };
        let word = if errors.planned {
            "planned"
        } else {
            "predicted"
        };
        let mut panels = Vec::new();
        for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
            let measured = over_time(first, |f| first.measured_mm[f][k]);
            let mut positions = vec![recordings::curve(
                "measured",
                Role::Base,
                Mark::Broad,
                measured,
            )];
            let mut differences = Vec::new();
            for (m, (_, v)) in models.iter().enumerate() {
                let c = &v.checks[i];
                let role = MODELS[m % MODELS.len()];
                let name = label(models, m, word);
                let points = over_time(c, |f| c.predicted_mm[f][k]);
                positions.push(recordings::curve(&name, role, Mark::Line, points));
                let points = over_time(c, |f| c.measured_mm[f][k] - c.predicted_mm[f][k]);
                differences.push(recordings::curve("", role, Mark::Line, points));
            }
            panels.push(Panel::new(format!("{axis}, mm"), 100.0, positions));
            panels.push(Panel::new(format!("{axis} off by, mm"), 60.0, differences));
        }
        let over = plot::line_plot(
            "Path over time",
            &Axis::new("time, s"),
            &panels,
            Width::Full,
        );
        let mut top = vec![recordings::curve(
            "measured",
            Role::Base,
            Mark::Broad,
            first.measured_mm.iter().map(|u| [u[0], u[1]]).collect(),
        )];
        for (m, (_, v)) in models.iter().enumerate() {
            let points = v.checks[i]
                .predicted_mm
                .iter()
                .map(|u| [u[0], u[1]])
                .collect();
            top.push(recordings::curve(
                "",
                MODELS[m % MODELS.len()],
                Mark::Line,
                points,
            ));
        }
        let view = plot::loops(
            "Path from above",
            &Axis::new("x, mm"),
            &Axis::new("y, mm"),
            top,
        );
        let caption = format!(
            "{}: measured and {word} path over time, their difference (measured minus {word}), and the path from above.",
            first.id
        );
        let figure = plot::figure(&[over, view], &plot::legend(&panels), &caption);
        items.push(context! { id => first.id.clone(), figure => safe(figure) });
    }
    let says = "The recorded voltages drive the model from rest (or the path is held against the plan that was given). x and y are related to the larger extent of the measured path in x and y, which is the diameter of a circle; z to the stroke. Gaps and 0.3 s at both ends are left out.";
    section("path", "Path", says, items)
}

fn force(models: &[Model]) -> Option<Section> {
    let mut items = Vec::new();
    for i in 0..models[0].1.checks.len() {
        let first = &models[0].1.checks[i];
        if first.force.is_empty() {
            continue;
        }
        let load = over_time(first, |f| 1e3 * first.load_n[f]);
        let mut vertical = vec![recordings::curve(
            "weight of the payload",
            Role::Base,
            Mark::Broad,
            load,
        )];
        let mut across = Vec::new();
        for (m, (_, v)) in models.iter().enumerate() {
            let c = &v.checks[i];
            let role = MODELS[m % MODELS.len()];
            let points = over_time(c, |f| 1e3 * (c.load_n[f] - c.force_error_n[f][2]));
            vertical.push(recordings::curve(
                &label(models, m, "predicted"),
                role,
                Mark::Line,
                points,
            ));
            let points = over_time(c, |f| {
                1e3 * c.force_error_n[f][0].hypot(c.force_error_n[f][1])
            });
            across.push(recordings::curve("", role, Mark::Line, points));
        }
        let panels = [
            Panel::new("load downwards, mN", 150.0, vertical),
            Panel::new("resultant in xy, mN", 90.0, across),
        ];
        let over = plot::line_plot(
            "Force over time",
            &Axis::new("time, s"),
            &panels,
            Width::Full,
        );
        let caption = format!(
            "{}: the load that motion and voltages ask for, and the weight that was there.",
            first.id
        );
        let figure = plot::figure(&[over], &plot::legend(&panels), &caption);
        items.push(context! { id => first.id.clone(), figure => safe(figure) });
    }
    let says = "Motion and voltages give the force on the end effector; it is held against the payload that the recording states. Holding: driven, the voltages steady and slower than 2 mm/s. Released: the same at 0 V after a drive. Across, nothing should pull.";
    section("force", "Output force", says, items)
}
