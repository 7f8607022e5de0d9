//! The errors in numbers.

use minijinja::context;

use super::page::{Cell, Section, Table, safe};
use super::plot::{self, Axis, Mark, Panel, Role, Width};
use super::recordings::curve;
use super::{Provenance, number};
use crate::calibration::{ChainError, JUDGED_ABOVE_V, Outcome, RecordingOutcome};

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

/// Parts of an axis in which errors are summed up.
const PARTS: usize = 24;
/// A part with fewer samples is not drawn.
const LEAST: usize = 10;
/// Frames to each side over which the rate of the command is taken.
const REACH: usize = 3;

/// One sample: where (or when), error and what noise makes.
pub type Sample = [f64; 3];

/// Root mean squares of error and noise over parts of an axis.
fn summed_up(samples: &[Sample]) -> [Vec<[f64; 2]>; 2] {
    let [low, high] = plot::extent(samples.iter().map(|s| s[0]));
    let size = (high - low) / PARTS as f64;
    let mut parts = [[0.0; 3]; PARTS];
    for [at, error, noise] in samples {
        let part = &mut parts[(((at - low) / size) as usize).min(PARTS - 1)];
        *part = [
            part[0] + 1.0,
            part[1] + error * error,
            part[2] + noise * noise,
        ];
    }
    [1, 2].map(|what| {
        let of = |(i, part): (usize, &[f64; 3])| {
            let middle = low + size * (i as f64 + 0.5);
            let root = (part[what] / part[0]).sqrt();
            [
                middle,
                if part[0] < LEAST as f64 {
                    f64::NAN
                } else {
                    root
                },
            ]
        };
        parts.iter().enumerate().map(of).collect()
    })
}

/// A recording, cycle by cycle.
pub struct Cycles<'a> {
    /// Its name.
    pub id: &'a str,
    /// Time of each frame, s.
    pub time_s: &'a [f64],
    /// Where its cycles begin, and where the last one ends, s; may be empty.
    pub cycles_s: &'a [f64],
    /// Errors of the voltage above 1 kV, V, over time.
    pub samples: Vec<Sample>,
}

/// Root mean squares of error and noise of each cycle; nothing where fewer than two have enough samples.
fn of_each(r: &Cycles) -> Option<[Vec<[f64; 2]>; 2]> {
    let cycle = |edges: &[f64]| {
        let here = |s: &&Sample| edges[0] <= s[0] && s[0] < edges[1];
        let [n, error, noise] = r
            .samples
            .iter()
            .filter(here)
            .fold([0.0; 3], |[n, e, w], s| {
                [n + 1.0, e + s[1] * s[1], w + s[2] * s[2]]
            });
        let middle = f64::midpoint(edges[0], edges[1]);
        let root = |sum: f64| match n >= LEAST as f64 {
            true => [middle, (sum / n).sqrt()],
            false => [middle, f64::NAN],
        };
        [root(error), root(noise)]
    };
    let rows: Vec<[[f64; 2]; 2]> = r.cycles_s.windows(2).map(cycle).collect();
    let known = rows.iter().filter(|r| r[0][1].is_finite()).count();
    (known > 1).then(|| [0, 1].map(|i| rows.iter().map(|r| r[i]).collect()))
}

/// A figure of the error and the noise of each cycle of the recordings whose drive repeats; empty where none
/// does.
pub fn per_cycle(recordings: &[Cycles]) -> String {
    let panel = |r: &Cycles| {
        let [error, noise] = of_each(r)?;
        let all = error.iter().chain(&noise).map(|p| p[1]);
        let most = all.filter(|v| v.is_finite()).fold(0.0, f64::max);
        let panel = Panel {
            y: Axis::over(
                format!("{}: error of each cycle, V rms", r.id),
                [0.0, 1.1 * most.max(1e-9)],
            ),
            height: 150.0,
            shades: Vec::new(),
            bands: Vec::new(),
            series: vec![
                curve("noise makes", Role::Base, Mark::Broad, noise),
                curve("error", Role::Two, Mark::Line, error),
            ],
        };
        // the axis of the other drawings over this time
        let span = plot::extent(r.time_s.iter().copied());
        Some((panel, span))
    };
    let drawn: Vec<(Panel, [f64; 2])> = recordings.iter().filter_map(panel).collect();
    let drawings: Vec<String> = drawn
        .iter()
        .map(|(panel, span)| {
            let label = format!("Error and noise of each cycle, {}", panel.y.title);
            let x = Axis::over("time, s", *span);
            plot::line_plot(&label, &x, std::slice::from_ref(panel), Width::Part)
        })
        .collect();
    let Some((first, _)) = drawn.first() else {
        return String::new();
    };
    let caption = "Each cycle of the drive by itself, above 1 kV. An error that falls or rises from cycle to cycle is memory that the model lacks, or a robot that changes; one that stays is the same physics missing each time.";
    plot::figure(
        &drawings,
        &plot::legend(std::slice::from_ref(first)),
        caption,
    )
}

/// Error and noise of each cycle of the recordings whose drive repeats.
fn cycles(outcome: &Outcome) -> String {
    let of = |r: &RecordingOutcome| {
        let sample = |i: usize, k: usize| {
            let error = r.predicted_v[i][k] - r.command_v[i][k];
            [r.time_s[i], error, r.sd_v[i][k]]
        };
        (0..r.time_s.len())
            .filter(|i| r.counts[*i])
            .flat_map(|i| (0..3).map(move |k| (i, k)))
            .filter(|(i, k)| r.command_v[*i][*k].abs() > JUDGED_ABOVE_V)
            .map(|(i, k)| sample(i, k))
            .filter(|s| s.iter().all(|v| v.is_finite()))
            .collect()
    };
    let each = outcome.recordings.iter().map(|r| Cycles {
        id: &r.id,
        time_s: &r.time_s,
        cycles_s: &r.cycles_s,
        samples: of(r),
    });
    per_cycle(&each.collect::<Vec<_>>())
}

/// The error over height, command and rate of the command, and what noise makes there.
fn over(outcome: &Outcome) -> String {
    let mut samples: [Vec<Sample>; 3] = Default::default();
    for r in &outcome.recordings {
        let frames = r.time_s.len();
        for i in (0..frames).filter(|i| r.counts[*i]) {
            let (a, b) = (i.saturating_sub(REACH), (i + REACH).min(frames - 1));
            for k in (0..3).filter(|k| r.command_v[i][*k].abs() > JUDGED_ABOVE_V) {
                let error = r.predicted_v[i][k] - r.command_v[i][k];
                let noise = r.sd_v[i][k];
                let rate = (r.command_v[b][k] - r.command_v[a][k]) / (r.time_s[b] - r.time_s[a]);
                let at = [r.position_mm[i][2], r.command_v[i][k] * 1e-3, rate * 1e-3];
                for (list, at) in samples.iter_mut().zip(at) {
                    if [at, error, noise].iter().all(|v| v.is_finite()) {
                        list.push([at, error, noise]);
                    }
                }
            }
        }
    }
    if samples[0].len() < PARTS * LEAST {
        return String::new();
    }
    let titles = ["height, mm", "command, kV", "rate of the command, kV/s"];
    let panels: Vec<Panel> = samples
        .iter()
        .map(|list| {
            let [error, noise] = summed_up(list);
            let all = error.iter().chain(&noise).map(|p| p[1]);
            let most = all.filter(|v| v.is_finite()).fold(0.0, f64::max);
            Panel {
                y: Axis::over("error above 1 kV, V rms", [0.0, 1.1 * most.max(1e-9)]),
                height: 150.0,
                shades: Vec::new(),
                bands: Vec::new(),
                series: vec![
                    curve("noise makes", Role::Base, Mark::Broad, noise),
                    curve("error", Role::Two, Mark::Line, error),
                ],
            }
        })
        .collect();
    let drawings: Vec<String> = panels
        .iter()
        .zip(titles)
        .map(|(panel, title)| {
            let label = format!("Error and noise over {title}");
            plot::line_plot(
                &label,
                &Axis::new(title),
                std::slice::from_ref(panel),
                Width::Part,
            )
        })
        .collect();
    let caption =
        "Where the error is larger than noise makes it, something is left out that acts there.";
    plot::figure(&drawings, &plot::legend(&panels), caption)
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
    let context = context! { table => table.html(), over => safe(over(outcome)), cycles => safe(cycles(outcome)) };
    Some(Section::new("errors", "Errors in volts", TEMPLATE, context))
}
