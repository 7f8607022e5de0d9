//! What was learnt: its curves with the bands that the recordings leave, and its numbers.

use minijinja::context;

use super::number;
use super::page::{Cell, Section, Table};
use super::plot::{self, Axis, Band, Mark, Panel, Role, Width};
use super::recordings::curve;
use crate::diagnosis::{Diagnosis, LearntPhysics, LearntTerm};
use crate::effects::learnt::{Form, Learnt, Place};
use crate::report::effect_entries::actuators;

/// What curves show.
const CURVES: &str = "What each curve adds, with its 95 % band, over the values that the recordings show. Beyond them it is held at its edge.";
/// The same along a coordinate.
const SHARES: &str = "What each curve adds, in per cent of the largest force, torque or stress measured, with its 95 % band, over the values that the recordings show; excursions are in per cent of the largest. Beyond them it is held at its edge.";
/// Points of a curve.
const POINTS: usize = 120;
/// Standard deviations to each side of a band of 95 %.
const BAND: f64 = 1.96;

/// See the module; nothing where nothing was learnt.
pub fn section(d: &Diagnosis) -> Option<Section> {
    let l = d.learnt.as_ref()?;
    let along = l.place == Place::Coordinate;
    let drawings: Vec<String> = l.terms.iter().filter_map(|t| drawn(l, t)).collect();
    let figure = match drawings.is_empty() {
        true => String::new(),
        false => plot::figure(&drawings, "", if along { SHARES } else { CURVES }),
    };
    let says = format!(
        "{} {} Left out one at a time, {} are foretold with {} of the squares that are left without it{}. It \
         describes these recordings; it is a hypothesis about what to look for at the rig.",
        if l.beside {
            "The named causes leave more than noise, so what they leave was learnt beside them:"
        } else {
            "No cause of the catalogue explains the misfit, so what is missing was learnt together with the \
             plain model:"
        },
        l.says,
        if along { "stretches" } else { "recordings" },
        number::per_cent(l.left_out.exp()),
        if along {
            ""
        } else {
            " (geometric mean of each and of all)"
        },
    );
    let context = context! {
        says => number::words(&says),
        figure => super::page::safe(figure),
        table => table(l).html(),
    };
    let template = "<p>{{ says }}</p>\n{{ figure }}\n{{ table }}\n";
    let title = "What was learnt of the missing physics";
    Some(Section::new("learnt", title, template, context))
}

fn on(t: &LearntTerm) -> String {
    let list = actuators(t.acting.on);
    match list.len() {
        3 => "all".into(),
        _ => list
            .iter()
            .map(|k| k.to_string())
            .collect::<Vec<_>>()
            .join(", "),
    }
}

fn table(l: &LearntPhysics) -> Table {
    let robot = l.place != Place::Coordinate;
    let mut head = vec![Cell::text("depends on"), Cell::text("form")];
    head.extend(robot.then(|| Cell::text("actuators")));
    head.push(Cell::number(format!("largest, {}", unit(l))));
    head.push(Cell::number("probability that it belongs"));
    let mut table = Table::new("Terms: what they make adds up.", head);
    for t in &l.terms {
        let Some(term) = t.acting.effect.learnt() else {
            continue;
        };
        let mut row = vec![
            Cell::text(term.form.variables().join(", ")),
            Cell::text(shape(term)),
        ];
        row.extend(robot.then(|| Cell::text(on(t))));
        row.push(Cell::number(number::significant(t.largest, 3)));
        row.push(Cell::number(match t.inclusion {
            p if p > 0.99 => "above 99 %".into(),
            p => number::per_cent(p),
        }));
        table.row(row);
    }
    table
}

/// Unit of what the terms make, as an axis has it.
fn unit(l: &LearntPhysics) -> &'static str {
    match l.place {
        Place::Coordinate => "over the largest measured",
        place => place.unit(),
    }
}

/// The form with the numbers that its coefficients do not hold.
fn shape(term: &Learnt) -> String {
    let name = term.form.name();
    match &term.form {
        Form::Wave { frequency_hz, .. } => {
            format!("{name} of {} Hz", number::significant(*frequency_hz, 4))
        }
        Form::Oscillator {
            frequency_hz,
            damping,
        } => format!(
            "{name} of {} Hz, damping {}",
            number::significant(*frequency_hz, 4),
            number::significant(*damping, 2)
        ),
        Form::Ridge { along, .. } => {
            let axis = along.map(|x| number::significant(x, 2));
            format!("{name} along ({})", axis.join(", "))
        }
        _ => name.to_owned(),
    }
}

/// The curve of a spline or a ridge with its band.
fn drawn(l: &LearntPhysics, t: &LearntTerm) -> Option<String> {
    let term = t.acting.effect.learnt()?;
    let (Form::Spline { knots, .. } | Form::Ridge { knots, .. }) = &term.form else {
        return None;
    };
    let (low, high) = (*knots.first()?, *knots.last()?);
    let (title, scale) = match &term.form {
        Form::Ridge { .. } => ("position along its direction, mm".to_owned(), 1e3),
        _ => {
            let unit = *term.form.units().first()?;
            match unit {
                "rad" => (
                    format!("{}, deg", term.form.variables()[0]),
                    1f64.to_degrees(),
                ),
                "1" => (format!("{}, %", term.form.variables()[0]), 100.0),
                unit => (format!("{}, {unit}", term.form.variables()[0]), 1.0),
            }
        }
    };
    let (who, of, behind, upwards) = match l.place {
        Place::Coordinate => (String::new(), "share", ", %", 100.0),
        _ => (format!("actuators {}, ", on(t)), unit(l), "", 1.0),
    };
    let mut points = Vec::new();
    let mut rows = Vec::new();
    for i in 0..=POINTS {
        let x = low + (high - low) * i as f64 / POINTS as f64;
        let basis = term.at(x);
        let y: f64 = basis.iter().zip(&t.acting.values).map(|(b, v)| b * v).sum();
        let product = |row: &Vec<f64>| basis.iter().zip(row).map(|(b, c)| b * c).sum::<f64>();
        let variance: f64 = (basis.iter().zip(&t.covariance))
            .map(|(b, row)| b * product(row))
            .sum();
        let half = BAND * variance.max(0.0).sqrt();
        points.push([x * scale, upwards * y]);
        if half.is_finite() {
            rows.push([x * scale, upwards * (y - half), upwards * (y + half)]);
        }
    }
    let units = term.form.units();
    let (by, per) = match (&term.form, term.form.variables().get(1)) {
        (Form::Spline { .. }, Some(other)) => match (behind, units[1]) {
            ("", _) | (_, "1") => (format!(" per {other}"), String::new()),
            // of a rate, 1/s: what it is multiplied with is in s
            (_, unit) => (
                format!(" per {other}"),
                format!(" {}", unit.trim_start_matches("1/")),
            ),
        },
        _ => Default::default(),
    };
    let panel = Panel {
        y: Axis::new(format!("{who}{of}{by}{behind}{per}")),
        height: 150.0,
        shades: Vec::new(),
        bands: vec![Band {
            name: String::new(),
            role: Role::One,
            rows,
        }],
        series: vec![curve("", Role::One, Mark::Line, points)],
    };
    let label = format!("{} over {title}", l.place.says());
    Some(plot::line_plot(
        &label,
        &Axis::new(title),
        &[panel],
        Width::Part,
    ))
}
