//! What several checks look at.

use super::glance::Glance;
use crate::dataset::Voltage;
use crate::kinematics::Vec3;
use crate::recording::{RawColumn, RawCoordinate, RawElongation, RawLoad, RawVoltage, Recording};

/// The place at which a marker is most of the time: the median of each coordinate.
pub(super) fn middle(xyz: &[Vec3]) -> Option<Vec3> {
    let out = [0, 1, 2].map(|k| super::linear::quantile(xyz.iter().map(|p| p[k]), 0.5));
    out.iter().all(|v| v.is_finite()).then_some(out)
}

/// The volts of the samples in which all channels have a value.
pub(super) fn volts(raw: &RawVoltage) -> Option<Voltage> {
    let scale = raw.unit.to_si * raw.scale.unwrap_or(1.0);
    let whole: Vec<usize> = (0..raw.time_s.len())
        .filter(|&i| raw.channels.iter().all(|c| c[i].is_finite()))
        .collect();
    if whole.is_empty() {
        return None;
    }
    let keep = |v: &[f64], scale: f64| whole.iter().map(|&i| v[i] * scale).collect::<Vec<f64>>();
    let channels = raw.channels.iter().map(|c| keep(c, scale)).collect();
    Some(Voltage::new(
        keep(&raw.time_s, 1.0),
        channels,
        raw.hold_previous,
    ))
}

/// Positions with what is missing filled along straight lines; `None` where nothing was seen.
pub(super) fn bridged(position: &[Vec3]) -> Option<Vec<Vec3>> {
    let seen = |p: &Vec3| p.iter().all(|v| v.is_finite());
    let first = position.iter().position(seen)?;
    let mut out = position.to_vec();
    let mut last = first;
    for i in 0..out.len() {
        if seen(&position[i]) {
            for j in last + 1..i {
                let share = (j - last) as f64 / (i - last) as f64;
                let (a, b) = (position[last], position[i]);
                out[j] = [0, 1, 2].map(|k| a[k] + share * (b[k] - a[k]));
            }
            last = i;
        }
    }
    for j in 0..first {
        out[j] = position[first];
    }
    let end = position[last];
    for p in &mut out[last + 1..] {
        *p = end;
    }
    Some(out)
}

/// A recording, as the checks look at it.
pub(super) struct View<'a> {
    /// As it was opened.
    pub recording: &'a Recording,
    /// Every column of numbers that was measured.
    pub signals: Vec<Signal<'a>>,
    /// A quick look, of a robot.
    pub glance: Option<Glance>,
}

/// What a column is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Is {
    /// A coordinate of the marker that moves, or of one that does not.
    Marker,
    /// A voltage.
    Voltage,
    /// Position, angle or stretch of a single coordinate.
    Coordinate,
    /// Input of an axis, torque of a bench, load of a coupon.
    Effort,
}

/// A column of numbers as the file has it.
pub(super) struct Signal<'a> {
    /// What it is called in a sentence.
    pub name: String,
    /// Its unit.
    pub unit: String,
    pub is: Is,
    /// Times, s; empty where the file has none.
    pub time_s: &'a [f64],
    pub values: Vec<f64>,
}

impl<'a> View<'a> {
    pub fn new(recording: &'a Recording) -> Self {
        let mut signals = Vec::new();
        if let Some(m) = &recording.motion {
            let markers = std::iter::once(&m.end_effector).chain(&m.base);
            for marker in markers {
                for (k, axis) in ["x", "y", "z"].iter().enumerate() {
                    signals.push(Signal {
                        name: format!("{axis} of marker {}", marker.label),
                        unit: m.unit.symbol.to_owned(),
                        is: Is::Marker,
                        time_s: if marker.xyz.len() == m.time_s.len() {
                            &m.time_s
                        } else {
                            &[]
                        },
                        values: marker.xyz.iter().map(|p| p[k]).collect(),
                    });
                }
            }
        }
        if let Some(v) = &recording.voltage {
            for (label, values) in v.labels.iter().zip(&v.channels) {
                signals.push(Signal {
                    name: format!("voltage {label}"),
                    unit: v.unit.symbol.to_owned(),
                    is: Is::Voltage,
                    time_s: &v.time_s,
                    values: values.clone(),
                });
            }
        }
        let column = |c: &RawColumn, is: Is, time_s: &'a [f64]| Signal {
            name: c.label.clone(),
            unit: c.unit.map_or(String::new(), |u| u.symbol.to_owned()),
            is,
            time_s,
            values: c.values.clone(),
        };
        let none: &[f64] = &[];
        if let Some(a) = &recording.axis {
            let (RawCoordinate::Position(c) | RawCoordinate::Velocity(c)) = &a.coordinate;
            signals.push(column(c, Is::Coordinate, &a.time_s));
            let input_time = a.input_time_s.as_ref().unwrap_or(&a.time_s);
            signals.push(column(&a.input, Is::Effort, input_time));
            signals.extend(a.load.iter().map(|l| column(l, Is::Effort, &a.time_s)));
        }
        if let Some(b) = &recording.bench {
            let time = b.time_s.as_deref().unwrap_or(none);
            signals.push(column(&b.angle, Is::Coordinate, time));
            signals.push(column(&b.torque, Is::Effort, time));
        }
        if let Some(c) = &recording.coupon {
            let time = c.time_s.as_deref().unwrap_or(none);
            let (RawElongation::Displacement {
                displacement: d, ..
            }
            | RawElongation::Stretch(d)) = &c.elongation;
            signals.push(column(d, Is::Coordinate, time));
            let (RawLoad::Force { force: f, .. } | RawLoad::NominalStress(f)) = &c.load;
            signals.push(column(f, Is::Effort, time));
        }
        View {
            recording,
            signals,
            glance: Glance::new(recording),
        }
    }

    /// Length of the motion and of the voltage log, s.
    pub fn lengths_s(&self) -> Option<[f64; 2]> {
        let span = |t: &[f64]| Some(t.last()? - t.first()?);
        let (m, v) = (
            self.recording.motion.as_ref()?,
            self.recording.voltage.as_ref()?,
        );
        Some([span(&m.time_s)?, span(&v.time_s)?])
    }
}

impl Signal<'_> {
    /// A row, for a person.
    pub fn at(&self, row: usize) -> String {
        match self.time_s.get(row) {
            Some(t) => format!("at {t:.3} s"),
            None => format!("in row {}", row + 1),
        }
    }

    /// Smallest and largest value.
    pub fn range(&self) -> Option<[f64; 2]> {
        let finite = || self.values.iter().copied().filter(|v| v.is_finite());
        let low = finite().fold(f64::INFINITY, f64::min);
        let high = finite().fold(f64::NEG_INFINITY, f64::max);
        (low <= high).then_some([low, high])
    }

    /// Sizes of the steps from row to row.
    pub fn steps(&self) -> Vec<f64> {
        self.values
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .collect()
    }
}

/// A number with three digits.
pub(super) fn short(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let digits = (2.0 - v.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    if v.abs() >= 1e6 || v.abs() < 1e-4 {
        return format!("{v:.2e}");
    }
    let text = format!("{v:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

/// A share in per cent.
pub(super) fn per_cent(share: f64) -> String {
    format!("{} %", short(100.0 * share))
}
