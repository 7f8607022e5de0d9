//! `view`: what there is to see of a recording. What was measured is there at once; what parameters make of
//! it is worked out when it is first asked for, once for each choice of causes.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::{Failure, Progress, load, series};
use crate::calibration::{predict_line, validate_robot_with, validate_samples};
use crate::dataset::line::Line;
use crate::dataset::{Dataset, HangingDataset, Parts};
use crate::effects::plain_name;
use crate::model::Robot;
use crate::recording::{Kind, Recording, Rig};
use crate::report::answer::{Answer, sits_in};
use crate::report::html::looks::{self, driven};
use crate::report::html::number::words;
use crate::report::html::skeleton;
use crate::report::html::view::{Drawing, Shown};
use crate::report::parameter_file::ParameterFile;

/// Distance of the frames of the motion that are shown, s, at least.
const FRAME_S: f64 = 0.02;
/// Frames of the motion that are given at a time, at most.
const MOST_FRAMES: usize = 2000;

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
                let drawings = looks::of_robot(&parts);
                if let Some(Rig::Robot(rig)) = &recording.rig {
                    // without the permittivity of a film the arms move all the same
                    let eps_r = file.as_ref().and_then(ParameterFile::eps_r).or(Some(1.0));
                    let eps_r = rig.film.eps_r.map_or(eps_r, Some);
                    moving = Some((Robot::from_rig(rig, eps_r)?, parts));
                }
                drawings
            }
            Kind::FilmSample => looks::of_sample(&HangingDataset::from_recording(&recording)?),
            _ => {
                let line = Line::from_recording(&recording)?;
                timed = line.timed;
                looks::of_line(&line)
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
                let drawings = looks::of_robot_held(&r, &self.measured);
                Ok(Predicted::new(drawings, says, &at_work.remarks))
            }
            Subject::Line(line) => {
                let lines = std::slice::from_ref(line.as_ref());
                let (model, remarks) = series::line_model_on(file, recordings, lines)?;
                let (r, unit) = predict_line(line, &model)?;
                let says = Answer::of_line(&r, driven(line), &unit).says;
                let drawings = looks::of_line_held(line, &r, &unit, &self.measured);
                Ok(Predicted::new(drawings, says, &remarks))
            }
            Subject::Sample => {
                let (datasets, samples) = load::samples(recordings, Some(file))?;
                let film = file.parameters()?.film;
                let mut outcome = validate_samples(&[&datasets[0]], &samples, &film)?;
                let r = outcome.recordings.remove(0);
                let drawings = looks::of_sample_held(&r, &self.measured);
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
