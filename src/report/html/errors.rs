//! The errors in numbers.

use minijinja::context;

use super::page::{Cell, Section, Table};
use super::{Provenance, number};
use crate::calibration::{ChainError, Outcome};

const TEMPLATE: &str = include_str!("errors.html");

fn cells(name: Cell, e: &ChainError) -> Vec<Cell> {
    let volt = |v: f64, n: usize| {
        let value = if n == 0 { f64::NAN } else { v };
        Cell::number(number::significant(value, 3))
    };
    vec![
        name,
        volt(e.rmse_v, e.samples),
        volt(e.noise_floor_v, e.samples),
        Cell::number(if e.samples == 0 {
            number::MISSING.into()
        } else {
            number::fixed(e.rmse_v / e.noise_floor_v, 2)
        }),
        volt(e.max_error_v, e.samples),
        Cell::number(number::count(e.samples)),
        volt(e.rmse_all_v, e.samples_all),
        Cell::number(number::count(e.samples_all)),
        Cell::number(number::count(e.negative)),
    ]
}

/// See the module.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    if outcome.recordings.is_empty() {
        return None;
    }
    let mut head = vec![Cell::text("recording, actuator")];
    let numbers = [
        "rms above 1 kV, V",
        "noise floor, V",
        "over noise",
        "largest, V",
        "samples",
        "rms of all, V",
        "all samples",
        "\u{3c6}\u{b2} < 0",
    ];
    head.extend(numbers.map(Cell::number));
    let caption = "Predicted minus commanded voltage, by recording and actuator.";
    let mut table = Table::new(caption, head);
    for r in &outcome.recordings {
        table.row_of("group", vec![Cell::text(&r.id)]);
        for (k, chain) in r.chains.iter().enumerate() {
            let name = Cell::of("quiet", format!("actuator {}", k + 1));
            table.row(cells(name, chain));
        }
        if outcome.recordings.len() > 1 {
            table.row(cells(Cell::text("together"), &r.total));
        }
    }
    table.row_of("total", cells(Cell::text("all"), &outcome.total));
    let context = context! { table => table.html() };
    Some(Section::new("errors", "Errors in volts", TEMPLATE, context))
}
