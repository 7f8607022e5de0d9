//! Each recording against the model: voltages over time with their residual, loops over height, the
//! amplifier's monitor.

use minijinja::{Value, context};

use super::page::{Section, safe};
use super::plot::{self, Axis, Band, Mark, Panel, Role, Series, Shade, Width};
use super::{Provenance, number, reduce};
use crate::calibration::{JUDGED_ABOVE_V, Outcome, RecordingOutcome};

const TEMPLATE: &str = include_str!("recordings.html");

/// See the module.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    if outcome.recordings.is_empty() {
        return None;
    }
    let items: Vec<Value> = outcome
        .recordings
        .iter()
        .enumerate()
        .map(|(number, r)| item(number, r))
        .collect();
    let context = context! { recordings => items };
    Some(Section::new(
        "recordings",
        "Recordings: command and prediction",
        TEMPLATE,
        context,
    ))
}

fn item(number: usize, r: &RecordingOutcome) -> Value {
    let lead = if r.total.samples == 0 {
        "No sample has a command above 1 kV.".to_string()
    } else {
        format!(
            "{} V rms above 1 kV, where the noise of the capture makes {} V; at most {} V.",
            number::significant(r.total.rmse_v, 3),
            number::significant(r.total.noise_floor_v, 3),
            number::significant(r.total.max_error_v, 3)
        )
    };
    context! {
        anchor => format!("recording-{}", number + 1),
        id => r.id.clone(),
        lead => lead + &passive(r),
        time => safe(over_time(r)),
        height => safe(over_height(r)),
        monitor => safe(monitor(r)),
    }
}

/// Values over others, scaled.
pub fn points(x: &[f64], y: &[f64], factor: f64) -> Vec<[f64; 2]> {
    x.iter().zip(y).map(|(x, y)| [*x, y * factor]).collect()
}

/// Column `k` of `rows` over time, scaled.
pub fn column(r: &RecordingOutcome, rows: &[[f64; 3]], k: usize, scale: f64) -> Vec<[f64; 2]> {
    let pair = |(t, v): (&f64, &[f64; 3])| [*t, v[k] * scale];
    r.time_s.iter().zip(rows).map(pair).collect()
}

/// A named curve.
pub fn curve(name: &str, role: Role, mark: Mark, points: Vec<[f64; 2]>) -> Series {
    Series {
        name: name.into(),
        role,
        mark,
        points,
    }
}

/// One actuator of one recording, for the first screen: the one with the most samples that count.
pub fn picture(outcome: &Outcome) -> String {
    let each = outcome
        .recordings
        .iter()
        .flat_map(|r| (0..3).map(move |k| (r, k)));
    let most = each
        .filter(|(r, k)| r.chains[*k].samples > 0)
        .max_by_key(|(r, k)| (r.chains[*k].samples, std::cmp::Reverse(*k)));
    let Some((r, k)) = most else {
        return String::new();
    };
    let (drawing, legend) = actuator(r, k, &Scale::of(r));
    let caption = format!(
        "{}, actuator {}: the voltage that the measured motion needs, over the commanded one; below, their difference and what noise makes.",
        r.id,
        k + 1
    );
    plot::figure(&[drawing], &legend, &caption)
}

/// What the drawings of a recording share, so that actuators can be compared.
struct Scale {
    shades: Vec<Shade>,
    kilovolt: [f64; 2],
    reach_v: f64,
}

impl Scale {
    fn of(r: &RecordingOutcome) -> Self {
        let at = |flags: &[bool], i: usize| flags.get(i).copied();
        let gap = reduce::spans(&r.time_s, |i| at(&r.gap, i) == Some(true));
        let skip = reduce::spans(&r.time_s, |i| {
            at(&r.counts, i) == Some(false) && at(&r.gap, i) != Some(true)
        });
        let shade = |name: &str, role, spans| Shade {
            name: name.into(),
            role,
            spans,
        };
        let kilo = r.command_v.iter().chain(&r.predicted_v).flatten();
        let reach = [r.total.max_error_v, 3.0 * r.total.noise_floor_v];
        let reach = reach.into_iter().filter(|v| v.is_finite());
        let reach = 1.15 * reach.fold(0.0, f64::max);
        Scale {
            shades: vec![
                shade("does not count", Role::Skip, skip),
                shade("gap in the capture", Role::Gap, gap),
            ],
            kilovolt: plot::padded(plot::extent(kilo.map(|v| v * 1e-3).chain([0.0]))),
            reach_v: match reach {
                0.0 if r.total.rmse_all_v > 0.0 => 3.0 * r.total.rmse_all_v,
                0.0 => 100.0,
                reach => reach,
            },
        }
    }
}

fn over_time(r: &RecordingOutcome) -> String {
    let scale = Scale::of(r);
    let mut legend = String::new();
    let drawings: Vec<String> = (0..3)
        .map(|k| {
            let (drawing, key) = actuator(r, k, &scale);
            if key.len() > legend.len() {
                legend = key;
            }
            drawing
        })
        .collect();
    let caption = "Look for a difference that leaves the blue band for long, or that repeats with the drive: noise does neither. Near 0 V the noise of the capture alone is worth hundreds of volts; what lies beyond a panel is drawn at its edge.";
    plot::figure(&drawings, &legend, caption)
}

/// Command and prediction of actuator `k`, and the legend.
fn actuator(r: &RecordingOutcome, k: usize, scale: &Scale) -> (String, String) {
    let sd = |i: usize| r.sd_v.get(i).map_or(f64::NAN, |s| s[k]);
    let predicted = column(r, &r.predicted_v, k, 1e-3);
    let band = predicted.iter().enumerate().map(|(i, p)| {
        let half = 2e-3 * sd(i);
        [p[0], p[1] - half, p[1] + half]
    });
    let mut series = vec![curve(
        "command",
        Role::Base,
        Mark::Broad,
        column(r, &r.command_v, k, 1e-3),
    )];
    if let Some(m) = &r.monitor_v {
        let points = column(r, m, k, 1e-3);
        series.push(curve("monitor", Role::Three, Mark::Dashed, points));
    }
    let band = Band {
        name: "\u{b1}2 sd of the capture noise".into(),
        role: Role::One,
        rows: band.collect(),
    };
    let error = |above: bool| -> Vec<[f64; 2]> {
        let rows = r.predicted_v.iter().zip(&r.command_v);
        let point = |(t, (p, c)): (&f64, (&[f64; 3], &[f64; 3]))| {
            let here = (c[k].abs() > JUDGED_ABOVE_V) == above;
            [*t, if here { p[k] - c[k] } else { f64::NAN }]
        };
        r.time_s.iter().zip(rows).map(point).collect()
    };
    let above = "difference where the command exceeds 1 kV";
    let below = "difference below";
    let errors = vec![
        curve(below, Role::Base, Mark::Line, error(false)),
        curve(above, Role::Two, Mark::Line, error(true)),
    ];
    let noise = (0..r.time_s.len()).map(|i| [r.time_s[i], -2.0 * sd(i), 2.0 * sd(i)]);
    let noise = Band {
        name: String::new(),
        role: Role::One,
        rows: noise.collect(),
    };
    series.push(curve("predicted", Role::One, Mark::Line, predicted));
    let driven = driven(r, k);
    let mut panels = vec![Panel {
        y: Axis::over(format!("Actuator {}: voltage, kV", k + 1), scale.kilovolt),
        height: if driven { 130.0 } else { 70.0 },
        shades: scale.shades.clone(),
        bands: vec![band],
        series,
    }];
    if driven {
        panels.push(Panel {
            y: Axis::over(
                "predicted minus command, V",
                [-scale.reach_v, scale.reach_v],
            ),
            height: 82.0,
            shades: scale.shades.clone(),
            bands: vec![noise],
            series: errors,
        });
    }
    let label = format!(
        "Command and predicted voltage of actuator {} over time, and their difference",
        k + 1
    );
    let drawing = plot::line_plot(&label, &Axis::new("time, s"), &panels, Width::Full);
    (drawing, plot::legend(&panels))
}

/// Whether actuator `k` is to be judged: its command exceeds 1 kV, or no command of the recording does.
fn driven(r: &RecordingOutcome, k: usize) -> bool {
    r.chains[k].samples > 0 || r.total.samples == 0
}

/// A sentence on the actuators that are not to be judged; may be empty.
fn passive(r: &RecordingOutcome) -> String {
    let names: Vec<String> = (0..3)
        .filter(|&k| !driven(r, k))
        .map(|k| (k + 1).to_string())
        .collect();
    let (actuators, stay, their) = match names.len() {
        0 => return String::new(),
        1 => ("Actuator", "stays", "its"),
        _ => ("Actuators", "stay", "their"),
    };
    format!(
        " {actuators} {} {stay} below 1 kV: {their} voltage is drawn, but not the difference or a loop.",
        number::list(&names)
    )
}

fn over_height(r: &RecordingOutcome) -> String {
    let counted = |rows: &[[f64; 3]], k: usize| -> Vec<[f64; 2]> {
        (0..r.position_mm.len().min(rows.len()))
            .map(|i| {
                if r.counts.get(i) == Some(&true) {
                    [r.position_mm[i][2], rows[i][k] * 1e-3]
                } else {
                    [f64::NAN; 2]
                }
            })
            .collect()
    };
    let mut legend = String::new();
    let drawings: Vec<String> = (0..3)
        .filter(|&k| driven(r, k))
        .map(|k| {
            let series = vec![
                curve("command", Role::Base, Mark::Broad, counted(&r.command_v, k)),
                curve(
                    "predicted",
                    Role::One,
                    Mark::Line,
                    counted(&r.predicted_v, k),
                ),
            ];
            if legend.is_empty() {
                let panel = Panel {
                    y: Axis::new(""),
                    height: 0.0,
                    shades: Vec::new(),
                    bands: Vec::new(),
                    series: series.clone(),
                };
                legend = plot::legend(&[panel]);
            }
            let label = format!(
                "Voltage of actuator {} against height, command and predicted",
                k + 1
            );
            let y = Axis::new(format!("Actuator {}: voltage, kV", k + 1));
            plot::loops(&label, &Axis::new("height uz, mm"), &y, series)
        })
        .collect();
    let caption = "Voltage against height of the end effector. Loops of another width mean another loss (viscosity, friction, delay); loops of another slope mean another stiffness; a shift along the height means another origin or load.";
    plot::figure(&drawings, &legend, caption)
}

fn monitor(r: &RecordingOutcome) -> String {
    let Some(monitor) = &r.monitor_v else {
        return String::new();
    };
    let drawings: Vec<String> = (0..3)
        .filter(|&k| driven(r, k))
        .map(|k| {
            let points = r.command_v.iter().zip(monitor);
            let points: Vec<[f64; 2]> = points.map(|(c, m)| [c[k] * 1e-3, m[k] * 1e-3]).collect();
            let ends = plot::extent(points.iter().map(|p| p[0]));
            let series = vec![
                curve(
                    "equal",
                    Role::Base,
                    Mark::Broad,
                    ends.map(|v| [v, v]).to_vec(),
                ),
                curve("monitor", Role::Three, Mark::Line, points),
            ];
            let label = format!("Monitor against command of actuator {}", k + 1);
            let y = Axis::new(format!("Actuator {}: monitor, kV", k + 1));
            plot::loops(&label, &Axis::new("command, kV"), &y, series)
        })
        .collect();
    let caption = "What the amplifier measured against what it was told. It should lie on the grey line; an open loop is a lag, another slope a gain, a flat end saturation.";
    plot::figure(&drawings, "", caption)
}
