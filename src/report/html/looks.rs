//! What `deacal view` draws of a recording: what was measured, and what parameters make of it.

use super::plot::{Band, Mark, Panel, Role, Shade};
use super::recordings::{column, curve, points};
use super::reduce::spans;
use super::view::Drawing;
use crate::calibration::{LineFit, RecordingOutcome, SampleFit};
use crate::dataset::line::{Line, Measured};
use crate::dataset::{HangingDataset, Parts, Voltage};

/// Height of a panel, units of a drawing, and of one that is looked at beside others.
const HIGH: f64 = 110.0;
const LOW: f64 = 70.0;

fn drawing(actuator: Option<usize>, label: &str, panels: Vec<Panel>) -> Drawing {
    Drawing {
        actuator,
        label: label.to_owned(),
        panels,
    }
}

/// A channel of a voltage, kV, on the motion's clock.
fn kilovolts(voltage: &Voltage, channel: usize, offset_s: f64) -> Vec<[f64; 2]> {
    let points = points(voltage.time_s(), &voltage.channels_v()[channel], 1e-3);
    points.iter().map(|p| [p[0] - offset_s, p[1]]).collect()
}

/// Position and voltages of a robot, as measured. An offset of the clocks that is to be estimated is taken as
/// 0 here.
pub fn of_robot(parts: &Parts) -> Vec<Drawing> {
    let n = parts.measured_m.len();
    let time_s: Vec<f64> = (0..n)
        .map(|i| parts.start_s + parts.step_s * i as f64)
        .collect();
    let axis = |k: usize| {
        let values: Vec<f64> = parts.measured_m.iter().map(|p| p[k]).collect();
        let points = points(&time_s, &values, 1e3);
        let series = vec![curve("captured", Role::Ink, Mark::Line, points)];
        Panel::new(format!("{}, mm", ["x", "y", "z"][k]), LOW, series)
    };
    let label = "Position of the end effector";
    let mut out = vec![drawing(None, label, vec![axis(2), axis(0), axis(1)])];
    let offset_s = parts.offset_s.unwrap_or(0.0);
    for k in 0..3 {
        let points = kilovolts(&parts.voltage, k, offset_s);
        let mut series = vec![curve("command", Role::Base, Mark::Broad, points)];
        if let Some(m) = &parts.monitor {
            let points = kilovolts(m, k, offset_s);
            series.push(curve("monitor", Role::Three, Mark::Dashed, points));
        }
        let title = format!("Actuator {}: voltage, kV", k + 1);
        let label = format!("Voltage of actuator {}", k + 1);
        out.push(drawing(
            Some(k),
            &label,
            vec![Panel::new(title, HIGH, series)],
        ));
    }
    out
}

/// Voltages of a robot that its motion needs beside its commands.
pub fn of_robot_held(r: &RecordingOutcome, measured: &[Drawing]) -> Vec<Drawing> {
    let mut out: Vec<Drawing> = (measured.iter().filter(|d| d.actuator.is_none()))
        .cloned()
        .collect();
    let skipped = spans(&r.time_s, |i| !r.counts[i] && !r.gap[i]);
    let gaps = spans(&r.time_s, |i| r.gap[i]);
    let shades: Vec<Shade> = [
        ("does not count", Role::Skip, skipped),
        ("gap in the capture", Role::Gap, gaps),
    ]
    .map(|(name, role, spans)| Shade {
        name: name.to_owned(),
        role,
        spans,
    })
    .into();
    for k in 0..3 {
        let column = |rows: &[[f64; 3]]| column(r, rows, k, 1e-3);
        let band = (0..r.time_s.len()).map(|i| {
            let sd = r.sd_v.get(i).map_or(f64::NAN, |s| 2.0 * s[k]);
            [r.time_s[i], -sd, sd]
        });
        let pair = [column(&r.command_v), column(&r.predicted_v)];
        let name = format!("Actuator {}: voltage", k + 1);
        let mut panels = compared(&name, "kV", pair, band.collect(), ("V", 1e3));
        if let Some(m) = &r.monitor_v {
            let monitor = curve("monitor", Role::Three, Mark::Dashed, column(m));
            panels[0].series.insert(1, monitor);
        }
        panels.iter_mut().for_each(|p| p.shades = shades.clone());
        let label = format!("Voltage of actuator {}, measured and predicted", k + 1);
        out.push(drawing(Some(k), &label, panels));
    }
    out
}

/// Measured and predicted (two lists of one time) in a unit, and below their difference with what noise makes
/// of it (time, lower and upper edge), in a unit of which that one has so many.
fn compared(
    what: &str,
    unit: &str,
    [measured, predicted]: [Vec<[f64; 2]>; 2],
    noise: Vec<[f64; 3]>,
    (fine, many): (&str, f64),
) -> Vec<Panel> {
    let both = predicted.iter().zip(&measured);
    let error: Vec<[f64; 2]> = both.map(|(p, m)| [p[0], many * (p[1] - m[1])]).collect();
    let series = vec![
        curve("measured", Role::Base, Mark::Broad, measured),
        curve("predicted", Role::One, Mark::Line, predicted),
    ];
    let mut below = Panel::new(
        format!("predicted minus measured, {fine}"),
        LOW,
        vec![curve("difference", Role::Two, Mark::Line, error)],
    );
    below.bands.push(Band {
        name: "\u{b1}2 sd of the noise".into(),
        role: Role::One,
        rows: noise,
    });
    vec![Panel::new(format!("{what}, {unit}"), HIGH, series), below]
}

/// What is predicted of a recording of one coordinate.
pub fn driven(line: &Line) -> &'static str {
    match line.measured {
        Measured::Torque(_) => "torque",
        Measured::Axis(_) => "input",
        Measured::Coupon(_) => "stress",
    }
}

/// Coordinate and what was measured along it.
pub fn of_line(line: &Line) -> Vec<Drawing> {
    let one = |title: &str, points| {
        let series = vec![curve("measured", Role::Ink, Mark::Line, points)];
        drawing(None, title, vec![Panel::new(title, HIGH, series)])
    };
    let x = |title: &str, scale| one(title, points(&line.time_s, &line.x, scale));
    match &line.measured {
        Measured::Torque(torque) => vec![
            x("angle, rad", 1.0),
            one("torque, N m", points(&line.time_s, torque, 1.0)),
        ],
        Measured::Axis(a) => {
            let coordinate = match (a.turns, a.velocity) {
                (true, true) => x("rate, rad/s", 1.0),
                (true, false) => x("angle, rad", 1.0),
                (false, true) => x("velocity, mm/s", 1e3),
                (false, false) => x("position, mm", 1e3),
            };
            let title = match a.unit.is_empty() {
                true => "input, its own unit".to_owned(),
                false => format!("input, {}", a.unit),
            };
            vec![
                coordinate,
                one(&title, points(&a.input_time_s, &a.input, 1.0)),
            ]
        }
        Measured::Coupon(c) => vec![
            one("stretch", points(&c.time_s, &c.stretch, 1.0)),
            one("nominal stress, kPa", points(&c.time_s, &c.stress_pa, 1e-3)),
        ],
    }
}

/// Position and voltage of a hanging sample.
pub fn of_sample(d: &HangingDataset) -> Vec<Drawing> {
    let time_s: Vec<f64> = (0..d.samples()).map(|i| d.time_s(i)).collect();
    let position = vec![curve(
        "captured",
        Role::Ink,
        Mark::Line,
        points(&time_s, &d.x_m, 1e3),
    )];
    let points = kilovolts(&d.voltage, 0, d.offset_s);
    let voltage = vec![curve("command", Role::Base, Mark::Broad, points)];
    vec![
        drawing(
            None,
            "Position",
            vec![Panel::new("position, mm", HIGH, position)],
        ),
        drawing(
            None,
            "Voltage",
            vec![Panel::new("voltage, kV", HIGH, voltage)],
        ),
    ]
}

/// What was measured along the coordinate of a line, and below it what is predicted of it, in its unit.
pub fn of_line_held(line: &Line, r: &LineFit, unit: &str, measured: &[Drawing]) -> Vec<Drawing> {
    let what = driven(line);
    let pair = [&r.measured, &r.predicted].map(|v| points(&r.time_s, v, 1.0));
    let noise = 2.0 * r.noise;
    let band = r.time_s.iter().map(|t| [*t, -noise, noise]);
    let panels = compared(what, unit, pair, band.collect(), (unit, 1.0));
    let mut drawings = measured[..1].to_vec();
    drawings.push(drawing(None, what, panels));
    drawings
}

/// Position of a hanging sample, captured and predicted, and what else was measured.
pub fn of_sample_held(r: &SampleFit, measured: &[Drawing]) -> Vec<Drawing> {
    let pair = [&r.captured_m, &r.predicted_m].map(|v| points(&r.time_s, v, 1e3));
    let noise = 2e3 * r.noise_m;
    let band = r.time_s.iter().map(|t| [*t, -noise, noise]);
    let panels = compared("position", "mm", pair, band.collect(), ("mm", 1.0));
    let mut drawings = vec![drawing(None, "position", panels)];
    drawings.extend(measured.iter().skip(1).cloned());
    drawings
}
