//! Every parameter, how far to trust it, and which combinations stay open.

use minijinja::{Value, context};

use super::page::{Cell, Section, Table, safe};
use super::{Provenance, number, plot};
use crate::calibration::{AtBound, Estimate, Outcome, WeakDirection};

const TEMPLATE: &str = include_str!("parameters.html");

/// Behind value and standard error.
const MISFIT_COLUMN: usize = 4;

/// The factor into the unit in which a value and its error read well, and that unit.
fn shown(e: &Estimate) -> (f64, String) {
    let error = if e.std_error.is_finite() {
        e.std_error
    } else {
        0.0
    };
    number::scaled(error.max(e.value.abs()), &e.unit)
}

fn trust(e: &Estimate) -> Cell {
    match (e.fixed, e.at_bound, e.identifiable) {
        (true, _, _) => Cell::of("badge held", "held"),
        (_, Some(AtBound::Lower), _) => Cell::of("badge bound", "at lower bound"),
        (_, Some(AtBound::Upper), _) => Cell::of("badge bound", "at upper bound"),
        (_, None, true) => Cell::of("badge good", "determined"),
        (_, None, false) => Cell::of("badge open", "not determined"),
    }
}

fn interval(e: &Estimate, factor: f64) -> String {
    let [low, high] = e.ci95.map(|v| v * factor);
    if e.fixed || e.at_bound.is_some() || !low.is_finite() || !high.is_finite() {
        return number::MISSING.into();
    }
    let error = e.std_error * factor;
    // Both ends to the digits of the error where they lie symmetric, else each to its own.
    let middle = (low + high) / 2.0 - e.value * factor;
    if middle.abs() < 0.2 * error {
        let ends = [low, high].map(|v| number::with_error(v, error).0);
        return format!("{} to {}", ends[0], ends[1]);
    }
    let digits = |v| number::digits(v, error).max(3);
    let ends = [low, high].map(|v| number::significant(v, digits(v)));
    format!("{} to {}", ends[0], ends[1])
}

/// What the section shows, of whatever job.
pub struct Shown<'a> {
    /// Every parameter, in order.
    pub estimates: &'a [Estimate],
    /// Standard error of each counting the misfit, where that is another; else empty.
    pub misfit: &'a [f64],
    /// Correlation of the free ones.
    pub correlation: &'a (Vec<String>, Vec<Vec<f64>>),
    /// Combinations that stay open.
    pub weak_directions: &'a [WeakDirection],
    /// Relative permittivity used; NaN where there is none.
    pub eps_r: f64,
}

fn row(e: &Estimate, misfit: Option<f64>) -> Vec<Cell> {
    let (factor, unit) = shown(e);
    let (value, error) = number::with_error(e.value * factor, e.std_error * factor);
    let error = match error {
        Some(error) => format!("\u{b1} {error}"),
        None if e.fixed => "held".into(),
        None => number::MISSING.into(),
    };
    let mut cells = vec![
        Cell::text(&e.name),
        Cell::text(number::words(&e.meaning)),
        Cell::number(value),
        Cell::number(error),
        Cell::number(interval(e, factor)),
        Cell::of("nowrap", unit),
        trust(e),
        Cell::of("quiet", number::words(&e.says)),
    ];
    if let Some(misfit) = misfit {
        let text = match misfit.is_finite() {
            true => format!("\u{b1} {}", number::significant(misfit * factor, 2)),
            false => number::MISSING.into(),
        };
        cells.insert(MISFIT_COLUMN, Cell::number(text));
        // Both figures stand in their columns.
        if let (Some(why), Some((_, rest))) =
            (cells.last_mut(), e.says.split_once("counting the misfit: "))
        {
            why.text = number::words(rest);
        }
    }
    cells
}

/// Half of an interval beyond this share of the value leaves the value open, %.
const OPEN_PERCENT: f64 = 100.0 * 1.96 / 3.0;

/// The colour of what is determined, and of what is not.
fn role(e: &Estimate) -> plot::Role {
    match e.identifiable && e.at_bound.is_none() {
        true => plot::Role::One,
        false => plot::Role::Two,
    }
}

/// How well each free parameter is known, in one picture.
fn known(estimates: &[Estimate]) -> Option<String> {
    let told = |e: &&Estimate| !e.fixed && e.ci95.iter().all(|v| v.is_finite()) && e.value != 0.0;
    let row = |e: &Estimate| {
        let [low, high] = e.ci95;
        let half = 100.0 * (high - low) / 2.0 / e.value.abs();
        (e.name.clone(), half, role(e))
    };
    let rows: Vec<_> = estimates
        .iter()
        .filter(told)
        .map(row)
        .filter(|r| r.1 > 0.0)
        .collect();
    (rows.len() > 1).then(|| {
        let title = "half of the 95 % interval, % of the value";
        let drawing = plot::forest("How well each parameter is known", title, &rows, OPEN_PERCENT);
        let key = plot::colour_key(&[
            ("determined", plot::Role::One),
            ("open", plot::Role::Two),
        ]);
        let caption =
            "How well each free parameter is known; further left is better. Beyond the dashed line a value is open; one beyond 1000 % stands at the edge.";
        plot::figure(&[drawing], &key, caption)
    })
}

/// The moduli of the branches over their relaxation times, with intervals.
fn spectrum(estimates: &[Estimate]) -> Option<String> {
    let find = |name: &str| estimates.iter().find(|e| e.name == name);
    let branch = |n: usize| Some((find(&format!("T_{n}"))?, find(&format!("mu_{}", n + 1))?));
    let branches: Vec<(&Estimate, &Estimate)> = (1..).map_while(branch).collect();
    // a modulus that is open may be anything: one beyond twice what is determined would hide that
    let most = |open: bool| {
        let list = branches
            .iter()
            .filter(|b| open || role(b.1) == plot::Role::One);
        list.map(|b| b.1.value).fold(0.0, f64::max)
    };
    let (reach, all) = (2.0 * most(false), most(true));
    let reach = if reach > 0.0 { reach.min(all) } else { all };
    let (factor, unit) = number::scaled(reach, "Pa");
    let ends = |e: &Estimate| match e.fixed || e.at_bound.is_some() {
        true => [e.value, f64::NAN, f64::NAN],
        false => [e.value, e.ci95[0], e.ci95[1]],
    };
    let point = |&(time, modulus): &(&Estimate, &Estimate)| {
        let open = [time, modulus].map(role).contains(&plot::Role::Two);
        let colour = if open {
            plot::Role::Two
        } else {
            plot::Role::One
        };
        (ends(time), ends(modulus).map(|v| v * factor), colour)
    };
    let seen =
        |b: &&(&Estimate, &Estimate)| b.0.value > 0.0 && b.1.value > 0.0 && b.1.value <= reach;
    let points: Vec<plot::Cross> = branches.iter().filter(seen).map(point).collect();
    (points.len() > 1).then(|| {
        let drawing = plot::spectrum(
            "Relaxation spectrum",
            "relaxation time, s",
            &format!("modulus of the branch, {unit}"),
            &points,
        );
        let key = plot::colour_key(&[
            ("determined", plot::Role::One),
            ("time or modulus open", plot::Role::Two),
        ]);
        let caption =
            "Relaxation spectrum: what the film is stiffer at once, and by when it loses that; lines are 95 % intervals. Branches of no modulus, or of one that is open and far larger than the others, are left out.";
        plot::figure(&[drawing], &key, caption)
    })
}

/// See the module.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    of(&Shown {
        estimates: &outcome.estimates,
        misfit: &[],
        correlation: &outcome.correlation,
        weak_directions: &outcome.weak_directions,
        eps_r: outcome.eps_r,
    })
}

/// The section of any job.
pub fn of(shown: &Shown) -> Option<Section> {
    if shown.estimates.is_empty() {
        return None;
    }
    let mut head = vec![
        Cell::text("name"),
        Cell::text("meaning"),
        Cell::number("value"),
        Cell::number("standard error"),
        Cell::number("95 % interval"),
        Cell::text("unit"),
        Cell::text("trust"),
        Cell::text("why"),
    ];
    let mut caption = String::from(
        "Every parameter. Intervals are of 95 %; where a parameter was held or rests on a bound there is none.",
    );
    if !shown.misfit.is_empty() {
        head[MISFIT_COLUMN - 1] = Cell::number("\u{b1} by noise");
        head.insert(MISFIT_COLUMN, Cell::number("\u{b1} with misfit"));
        head[MISFIT_COLUMN + 1] = Cell::number("95 % by noise");
        caption += " The misfit exceeds the noise: the standard error with misfit, which counts it as correlated noise, is an order of magnitude; what the noise alone leaves open is too small.";
    }
    let mut table = Table::new(&caption, head);
    for (i, e) in shown.estimates.iter().enumerate() {
        table.row(row(e, shown.misfit.get(i).copied()));
    }
    let (names, rows) = shown.correlation;
    let figure = if names.len() > 1 {
        let drawing = plot::heat_map("Correlation of the estimates", names, rows);
        let key = plot::colour_key(&[
            ("rise together", plot::Role::One),
            ("one rises, the other falls", plot::Role::Two),
        ]);
        let caption = "Correlation of each pair of free parameters. A strong colour means that the recordings fix a combination of the two better than either alone.";
        plot::figure(
            &[format!("<div class=\"scroll\">{drawing}</div>")],
            &key,
            caption,
        )
    } else {
        String::new()
    };
    let figure = match (known(shown.estimates), spectrum(shown.estimates)) {
        (None, None) => figure,
        (known, spectrum) => {
            let both = known.unwrap_or_default() + &spectrum.unwrap_or_default();
            format!("<div class=\"three\"><div class=\"pair\">{both}</div>{figure}</div>")
        }
    };
    let weak: Vec<Value> = shown
        .weak_directions
        .iter()
        .map(|w| Value::from(number::words(&w.says)))
        .collect();
    let eps_r = if shown.eps_r.is_finite() {
        number::significant(shown.eps_r, 3)
    } else {
        String::new()
    };
    let context = context! {
        table => table.html(),
        eps_r => eps_r,
        weak => weak,
        pictured => !figure.is_empty(),
        figure => safe(figure),
    };
    Some(Section::new("parameters", "Parameters", TEMPLATE, context))
}
