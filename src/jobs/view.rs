//! `view`: what there is to see of a recording. What was measured is there at once; what parameters make of
//! it is worked out when it is first asked for, once for each choice of causes.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::{Failure, Progress, load, series};
use crate::calibration::{RecordingOutcome, predict_line, validate_robot_with, validate_samples};
use crate::dataset::line::{Line, Measured};
use crate::dataset::{Dataset, HangingDataset, Parts, Voltage};
use crate::effects::plain_name;
use crate::model::Robot;
use crate::recording::{Kind, Recording, Rig};
use crate::report::answer::{Answer, sits_in};
use crate::report::html::number::words;
use crate::report::html::plot::{Axis, Band, Mark, Panel, Role, Series, Shade};
use crate::report::html::reduce::spans;
use crate::report::html::skeleton;
use crate::report::html::view::{Drawing, Shown};
use crate::report::parameter_file::ParameterFile;

/// Distance of the frames of the motion that are shown, s, at least.
const FRAME_S: f64 = 0.02;
/// Frames of the motion that are given at a time, at most.
const MOST_FRAMES: usize = 2000;
/// Height of a panel, units of a drawing, and of one that is looked at beside others.
const HIGH: f64 = 110.0;
const LOW: f64 = 70.0;

/// A recording that is looked at.
#[derive(Debug)]
pub struct View {
    recording: Recording,
    file: Option<ParameterFile>,
    measured: Vec<Drawing>,
    span: [f64; 2],
    title: &'static str,
    moving: Option<(Robot, Parts)>,
    aligned: OnceLock<Result<Subject, String>>,
    predicted: Mutex<HashMap<Vec<bool>, Arc<Predicted>>>,
}

/// What a prediction is made on.
#[derive(Debug)]
enum Subject {
    Robot(Box<(Robot, Dataset)>),
    Line(Box<Line>),
    Sample,
}

/// What parameters make of a recording.
#[derive(Debug)]
pub struct Predicted {
    /// Prediction, measurement and their difference.
    pub drawings: Vec<Drawing>,
    /// How they stand, and what a reader should know.
    pub says: String,
}

/// The motion of a robot between two times.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Motion {
    /// Time of the first frame, s.
    pub from: f64,
    /// Distance of the frames, s.
    pub step: f64,
    /// The points of each frame ([`skeleton`]), hundredths of a millimetre; `None` where nothing was captured
    /// or the arms do not reach.
    pub frames: Vec<Option<Vec<i32>>>,
}

impl View {
    /// Of a recording, and of parameters to hold against it.
    ///
    /// # Errors
    /// The recording cannot be put on one clock and in SI.
    pub fn new(recording: Recording, file: Option<ParameterFile>) -> Result<Self, Failure> {
        let mut moving = None;
        let mut timed = true;
        let measured = match recording.manifest.kind {
            Kind::Robot => {
                let parts = Parts::from_recording(&recording)?;
                let drawings = of_parts(&parts);
                if let Some(Rig::Robot(rig)) = &recording.rig {
                    // without the permittivity of a film the arms move all the same
                    let eps_r = file.as_ref().and_then(ParameterFile::eps_r).or(Some(1.0));
                    let eps_r = rig.film.eps_r.map_or(eps_r, Some);
                    moving = Some((Robot::from_rig(rig, eps_r)?, parts));
                }
                drawings
            }
            Kind::FilmSample => of_sample(&HangingDataset::from_recording(&recording)?),
            _ => {
                let line = Line::from_recording(&recording)?;
                timed = line.timed;
                of_line(&line)
            }
        };
        let times = |d: &Drawing| -> Vec<f64> {
            let ends = d.panels.iter().flat_map(|p| &p.series);
            ends.flat_map(|s| [s.points.first(), s.points.last()])
                .filter_map(|p| p.map(|p| p[0]))
                .collect()
        };
        let all = measured.iter().flat_map(times);
        let span = crate::report::html::plot::extent(all);
        Ok(View {
            title: if timed { "time, s" } else { "row" },
            recording,
            file,
            measured,
            span,
            moving,
            aligned: OnceLock::new(),
            predicted: Mutex::default(),
        })
    }

    /// What a page has to know of it.
    #[must_use]
    pub fn shown(&self) -> Shown {
        let actuators = self.measured.iter().filter_map(|d| d.actuator);
        Shown {
            id: self.recording.manifest.id.clone(),
            kind: self.recording.manifest.kind.name(),
            span: self.span,
            actuators: actuators.max().map_or(0, |k| k + 1),
            moves: self.moving.is_some(),
            predicted: self.file.is_some(),
        }
    }

    /// What was measured.
    #[must_use]
    pub fn measured(&self) -> &[Drawing] {
        &self.measured
    }

    /// Title of the axis of time.
    #[must_use]
    pub fn title(&self) -> &'static str {
        self.title
    }

    /// The causes of the parameter file, in its order, in words.
    #[must_use]
    pub fn causes(&self) -> Vec<String> {
        let robot = self.recording.manifest.kind == Kind::Robot;
        let effects = self.file.iter().flat_map(|f| &f.effects);
        let name = |e: &crate::report::parameter_file::Effect| match robot {
            true => format!("{}, {}", plain_name(&e.id), sits_in(&e.actuators)),
            false => plain_name(&e.id),
        };
        effects.map(name).collect()
    }

    /// What the parameters make of it, with those of their causes for which `with` holds (all, where it says
    /// nothing of one).
    ///
    /// # Errors
    /// There are no parameters, or they are of another rig, or lack what is needed.
    pub fn predicted(&self, with: &[bool]) -> Result<Arc<Predicted>, Failure> {
        let file = self.file.as_ref().ok_or("no parameters are given")?;
        let at_work = |i: usize| with.get(i).copied().unwrap_or(true);
        let with: Vec<bool> = (0..file.effects.len()).map(at_work).collect();
        let mut known = self
            .predicted
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known.get(&with) {
            return Ok(Arc::clone(found));
        }
        let mut part = file.clone();
        let mut ticked = with.iter();
        part.effects.retain(|_| ticked.next() == Some(&true));
        let subject = self
            .aligned
            .get_or_init(|| self.align(file).map_err(|e| e.to_string()));
        let subject = subject.as_ref().map_err(Clone::clone)?;
        let found = Arc::new(self.predict(subject, &part)?);
        known.insert(with, Arc::clone(&found));
        Ok(found)
    }

    fn align(&self, file: &ParameterFile) -> Result<Subject, Failure> {
        Ok(match self.recording.manifest.kind {
            Kind::Robot => {
                let recordings = std::slice::from_ref(&self.recording);
                let robot = load::robot(load::rig(recordings)?, Some(file))?;
                let dataset = Dataset::from_recording(&self.recording, None)?;
                Subject::Robot(Box::new((robot, dataset)))
            }
            Kind::FilmSample => Subject::Sample,
            _ => Subject::Line(Box::new(Line::from_recording(&self.recording)?)),
        })
    }

    fn predict(&self, subject: &Subject, file: &ParameterFile) -> Result<Predicted, Failure> {
        let recordings = std::slice::from_ref(&self.recording);
        match subject {
            Subject::Robot(both) => {
                let (robot, dataset) = both.as_ref();
                let at_work = series::at_work(file, recordings, std::slice::from_ref(dataset))?;
                let parameters = file.parameters()?;
                let (effects, when) = (&at_work.effects, &at_work.when);
                let mut outcome =
                    validate_robot_with(robot, &[dataset], &parameters, effects, when)?;
                let says = Answer::of_robot(&outcome, robot).says;
                let r = outcome.recordings.remove(0);
                let drawings = of_robot(&r, &self.measured);
                Ok(Predicted::new(drawings, says, &at_work.remarks))
            }
            Subject::Line(line) => {
                let lines = std::slice::from_ref(line.as_ref());
                let (model, remarks) = series::line_model_on(file, recordings, lines)?;
                let (r, unit) = predict_line(line, &model)?;
                let what = driven(line);
                let says = Answer::of_line(&r, what, &unit).says;
                let points = |v: &[f64]| zip(&r.time_s, v, 1.0);
                let pair = [points(&r.measured), points(&r.predicted)];
                let noise = r.noise;
                let band = r.time_s.iter().map(|t| [*t, -2.0 * noise, 2.0 * noise]);
                let panels = compared(what, &unit, pair, band.collect(), (&unit, 1.0));
                let mut drawings = self.measured[..1].to_vec();
                drawings.push(drawing(None, what, panels));
                Ok(Predicted::new(drawings, says, &remarks))
            }
            Subject::Sample => {
                let (datasets, samples) = load::samples(recordings, Some(file))?;
                let film = file.parameters()?.film;
                let mut outcome = validate_samples(&[&datasets[0]], &samples, &film)?;
                let r = outcome.recordings.remove(0);
                let points = |v: &[f64]| zip(&r.time_s, v, 1e3);
                let pair = [points(&r.captured_m), points(&r.predicted_m)];
                let noise = 2e3 * r.noise_m;
                let band = r.time_s.iter().map(|t| [*t, -noise, noise]);
                let panels = compared("position", "mm", pair, band.collect(), ("mm", 1.0));
                let mut drawings = vec![drawing(None, "position", panels)];
                drawings.extend(self.measured.iter().skip(1).cloned());
                Ok(Predicted::new(drawings, outcome.verdict, &[]))
            }
        }
    }

    /// The motion between two times (s), in at most 2000 frames; `None` where it is of no robot with a rig.
    #[must_use]
    pub fn motion(&self, from_s: f64, to_s: f64) -> Option<Motion> {
        let (robot, parts) = self.moving.as_ref()?;
        let every = (FRAME_S / parts.step_s).round().max(1.0) as usize;
        let place = |t: f64| ((t - parts.start_s) / parts.step_s).round().max(0.0) as usize;
        let end = place(to_s).min(parts.measured_m.len());
        let first = place(from_s).min(end);
        let frames = parts.measured_m[first..end].iter().step_by(every);
        Some(Motion {
            from: parts.start_s + parts.step_s * first as f64,
            step: parts.step_s * every as f64,
            frames: (frames.take(MOST_FRAMES))
                .map(|u| skeleton(robot, *u))
                .collect(),
        })
    }
}

impl Predicted {
    fn new(drawings: Vec<Drawing>, says: String, remarks: &[String]) -> Self {
        let all = std::iter::once(&says).chain(remarks);
        let says = all.map(|s| words(s)).collect::<Vec<_>>().join(" ");
        Predicted { drawings, says }
    }
}

fn drawing(actuator: Option<usize>, label: &str, panels: Vec<Panel>) -> Drawing {
    Drawing {
        actuator,
        label: label.to_owned(),
        panels,
    }
}

fn panel(title: impl Into<String>, height: f64, series: Vec<Series>) -> Panel {
    Panel {
        y: Axis::new(title),
        height,
        shades: Vec::new(),
        bands: Vec::new(),
        series,
    }
}

fn curve(name: &str, role: Role, mark: Mark, points: Vec<[f64; 2]>) -> Series {
    Series {
        name: name.to_owned(),
        role,
        mark,
        points,
    }
}

/// Values over times, scaled.
fn zip(time_s: &[f64], values: &[f64], scale: f64) -> Vec<[f64; 2]> {
    let both = time_s.iter().zip(values);
    both.map(|(t, v)| [*t, scale * v]).collect()
}

/// A channel of a voltage, kV, on the motion's clock.
fn kilovolts(voltage: &Voltage, channel: usize, offset_s: f64) -> Vec<[f64; 2]> {
    let points = zip(voltage.time_s(), &voltage.channels_v()[channel], 1e-3);
    points.iter().map(|p| [p[0] - offset_s, p[1]]).collect()
}

/// Position and voltages of a robot, as measured. An offset of the clocks that is to be estimated is taken as
/// 0 here.
fn of_parts(parts: &Parts) -> Vec<Drawing> {
    let n = parts.measured_m.len();
    let time_s: Vec<f64> = (0..n)
        .map(|i| parts.start_s + parts.step_s * i as f64)
        .collect();
    let axis = |k: usize| {
        let values: Vec<f64> = parts.measured_m.iter().map(|p| p[k]).collect();
        let points = zip(&time_s, &values, 1e3);
        let series = vec![curve("captured", Role::Ink, Mark::Line, points)];
        panel(format!("{}, mm", ["x", "y", "z"][k]), LOW, series)
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
        out.push(drawing(Some(k), &label, vec![panel(title, HIGH, series)]));
    }
    out
}

/// Voltages of a robot that its motion needs beside its commands.
fn of_robot(r: &RecordingOutcome, measured: &[Drawing]) -> Vec<Drawing> {
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
        let column = |rows: &[[f64; 3]]| -> Vec<[f64; 2]> {
            let values: Vec<f64> = rows.iter().map(|v| v[k]).collect();
            zip(&r.time_s, &values, 1e-3)
        };
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
    let mut below = panel(
        format!("predicted minus measured, {fine}"),
        LOW,
        vec![curve("difference", Role::Two, Mark::Line, error)],
    );
    below.bands.push(Band {
        name: "\u{b1}2 sd of the noise".into(),
        role: Role::One,
        rows: noise,
    });
    vec![panel(format!("{what}, {unit}"), HIGH, series), below]
}

/// What is predicted of a recording of one coordinate.
fn driven(line: &Line) -> &'static str {
    match line.measured {
        Measured::Torque(_) => "torque",
        Measured::Axis(_) => "input",
        Measured::Coupon(_) => "stress",
    }
}

/// Coordinate and what was measured along it.
fn of_line(line: &Line) -> Vec<Drawing> {
    let one = |title: &str, points| {
        let series = vec![curve("measured", Role::Ink, Mark::Line, points)];
        drawing(None, title, vec![panel(title, HIGH, series)])
    };
    let x = |title: &str, scale| one(title, zip(&line.time_s, &line.x, scale));
    match &line.measured {
        Measured::Torque(torque) => vec![
            x("angle, rad", 1.0),
            one("torque, N m", zip(&line.time_s, torque, 1.0)),
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
            vec![coordinate, one(&title, zip(&a.input_time_s, &a.input, 1.0))]
        }
        Measured::Coupon(c) => vec![
            one("stretch", zip(&c.time_s, &c.stretch, 1.0)),
            one("nominal stress, kPa", zip(&c.time_s, &c.stress_pa, 1e-3)),
        ],
    }
}

/// Position and voltage of a hanging sample.
fn of_sample(d: &HangingDataset) -> Vec<Drawing> {
    let time_s: Vec<f64> = (0..d.samples()).map(|i| d.time_s(i)).collect();
    let position = vec![curve(
        "captured",
        Role::Ink,
        Mark::Line,
        zip(&time_s, &d.x_m, 1e3),
    )];
    let points = kilovolts(&d.voltage, 0, d.offset_s);
    let voltage = vec![curve("command", Role::Base, Mark::Broad, points)];
    vec![
        drawing(
            None,
            "Position",
            vec![panel("position, mm", HIGH, position)],
        ),
        drawing(None, "Voltage", vec![panel("voltage, kV", HIGH, voltage)]),
    ]
}

/// Opens the recordings that are looked at, with parameters to hold against them.
///
/// # Errors
/// One of them cannot be read.
pub fn views(
    recordings: Vec<Recording>,
    file: Option<&ParameterFile>,
    progress: &Progress,
) -> Result<Vec<View>, Failure> {
    progress.step("drawing");
    let each = recordings.into_iter();
    each.map(|r| View::new(r, file.cloned())).collect()
}
