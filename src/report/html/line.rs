//! The report of a fit of one coordinate: hinge benches and axes.

use minijinja::{Value, context};

use super::page::{self, Section, Summary, safe};
use super::plot::{self, Axis, Mark, Panel, Role, Series, Width};
use super::recordings::curve;
use super::summary::{self, remarks, sized};
use super::{Provenance, number, parameters, provenance};
use crate::calibration::{LineFit, LineOutcome};
use crate::effects::line::Kind;
use crate::report::answer::Answer;

const TEMPLATE: &str = include_str!("samples.html");
/// Points of a drawing.
const POINTS: usize = 2500;

/// The report of a fit of hinge benches or axes, or of a model that is held against such recordings or
/// coupons.
pub fn render_lines(outcome: &LineOutcome, made_of: &Provenance) -> String {
    let (rmse, largest, _, noise) = outcome.total();
    let status = summary::standing(outcome.standing());
    let answer = Answer::of_lines(outcome);
    let mut tiles = summary::facts(&answer);
    tiles.extend([
        sized("Error, rms", rmse, &outcome.unit),
        sized("Noise alone makes", noise, &outcome.unit),
        sized("Largest error", largest, &outcome.unit),
    ]);
    let notes = [
        summary::ended(outcome.evaluations, outcome.converged, &outcome.reason),
        summary::open(&outcome.estimates, &answer),
        remarks(&outcome.remarks),
    ];
    let first = outcome.recordings.first();
    let summary = Summary {
        of: provenance::head(made_of),
        status: status.0,
        word: status.1.into(),
        headline: number::words(&answer.says),
        picture: first.map_or_else(String::new, |r| over_coordinate(outcome, r)),
        tiles,
        notes: notes.into_iter().flatten().collect(),
    };
    let sections: Vec<Section> = [
        Some(recordings(outcome)),
        parameters::of(&parameters::Shown {
            estimates: &outcome.estimates,
            misfit: &[],
            correlation: &(Vec::new(), Vec::new()),
            weak_directions: &[],
            eps_r: f64::NAN,
        }),
        Some(provenance::of(made_of)),
    ]
    .into_iter()
    .flatten()
    .collect();
    let title = match (outcome.estimates.is_empty(), outcome.kind) {
        (true, _) => "A model against recordings",
        (_, Kind::Bench) => "Torque curve of a hinge",
        _ => "Calibration of an axis",
    };
    page::page(title, &summary, &sections)
}

fn recordings(outcome: &LineOutcome) -> Section {
    let list: Vec<Value> = outcome
        .recordings
        .iter()
        .enumerate()
        .map(|(i, r)| {
            context! {
                anchor => format!("recording-{}", i + 1),
                id => r.id.clone(),
                lead => format!(
                    "{} rms over {} samples, noise {}.",
                    number::sized(r.rmse, &outcome.unit, 3),
                    number::count(r.n_samples),
                    number::sized(r.noise, &outcome.unit, 3)
                ),
                time => safe(over_time(outcome, r)),
                loops => safe(over_coordinate(outcome, r)),
            }
        })
        .collect();
    let context = context! {
        says => "What was measured first, as it was recorded; then what the model asks for.",
        recordings => list,
    };
    Section::new("recordings", "Measured and predicted", TEMPLATE, context)
}

fn pairs(x: &[f64], y: &[f64]) -> Vec<[f64; 2]> {
    let every = x.len().div_ceil(POINTS).max(1);
    let all = x.iter().zip(y).map(|(x, y)| [*x, *y]);
    all.step_by(every).collect()
}

fn words(outcome: &LineOutcome) -> (&'static str, &'static str, &'static str) {
    let forward = outcome.recordings.iter().find_map(|r| r.forward.as_ref());
    let has = |unit: &str| outcome.estimates.iter().any(|e| e.unit == unit);
    let position = match forward.map(|f| f.unit) {
        Some("rad") => "position, rad",
        Some("m") => "position, m",
        _ if has("kg m^2") || has("N m/rad") || has("N m s/rad") => "position, rad",
        _ if has("kg") || has("N/m") || has("N s/m") => "position, m",
        _ => "position, SI unit",
    };
    let (coordinate, time) = match outcome.kind {
        Kind::Bench => ("angle, rad", "row"),
        Kind::Axis => (position, "time, s"),
        Kind::Coupon => ("stretch", "time, s"),
    };
    (coordinate, outcome.driven, time)
}

fn over_time(outcome: &LineOutcome, r: &LineFit) -> String {
    let (coordinate, driven, time) = words(outcome);
    let line = |name: &str, role, y: &[f64]| curve(name, role, Mark::Line, pairs(&r.time_s, y));
    let error: Vec<f64> = r
        .predicted
        .iter()
        .zip(&r.measured)
        .map(|(p, m)| p - m)
        .collect();
    let panels = vec![
        panel(
            coordinate.into(),
            vec![line("measured", Role::One, &r.coordinate)],
        ),
        panel(
            format!("{driven}, {}", outcome.unit),
            vec![
                line("measured", Role::One, &r.measured),
                line("predicted", Role::Two, &r.predicted),
            ],
        ),
        panel(
            format!("error, {}", outcome.unit),
            vec![line("error", Role::Four, &error)],
        ),
    ];
    let label = format!("Measured and predicted {driven} in {}", r.id);
    let drawing = plot::line_plot(&label, &Axis::new(time), &panels, Width::Full);
    plot::figure(&[drawing], &plot::legend(&panels), "")
}

fn over_coordinate(outcome: &LineOutcome, r: &LineFit) -> String {
    let (coordinate, driven, _) = words(outcome);
    let series = vec![
        curve(
            "measured",
            Role::One,
            Mark::Line,
            pairs(&r.coordinate, &r.measured),
        ),
        curve(
            "predicted",
            Role::Two,
            Mark::Line,
            pairs(&r.coordinate, &r.predicted),
        ),
    ];
    let error: Vec<f64> = r
        .predicted
        .iter()
        .zip(&r.measured)
        .map(|(p, m)| p - m)
        .collect();
    let error = vec![curve(
        "difference",
        Role::Four,
        Mark::Line,
        pairs(&r.coordinate, &error),
    )];
    let key = plot::legend(&[
        panel(String::new(), series.clone()),
        panel(String::new(), error.clone()),
    ]);
    let x = Axis::new(coordinate);
    let drawings = [
        plot::loops(
            &format!("{driven} over {coordinate} in {}", r.id),
            &x,
            &Axis::new(format!("{driven}, {}", outcome.unit)),
            series,
        ),
        plot::loops(
            &format!(
                "predicted minus measured {driven} over {coordinate} in {}",
                r.id
            ),
            &x,
            &Axis::new(format!("predicted minus measured, {}", outcome.unit)),
            error,
        ),
    ];
    let (coordinate, _) = coordinate.split_once(',').unwrap_or((coordinate, ""));
    let caption = format!("{}: {driven} over {coordinate}, and the difference.", r.id);
    plot::figure(&drawings, &key, &caption)
}

fn panel(title: String, series: Vec<Series>) -> Panel {
    Panel::new(title, 120.0, series)
}
