//! Electrodes over days (or batches): stroke, its loss against the first day, what moved, and whether two
//! electrodes differ.
//!
//! The stroke is measured (`stroke`), the cause is fitted (`joint`); neither needs the other. Intervals of
//! strokes are those of the capture's noise. They say nothing of how samples of one electrode scatter: with
//! one sample an electrode a difference between electrodes is a difference between two samples, and the
//! outcome says how many would tell more.

use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;
use statrs::distribution::{ContinuousCDF, StudentsT};
use statrs::function::erf::erfc;

use super::Error;
use super::aged::Cause;
use super::aged_robot::AgedRobot;
use super::aged_sample::AgedSample;
use super::joint::{Joint, joint};
use super::stroke::{Strokes, Value, strokes};
use crate::dataset::{Cycles, Dataset, HangingDataset};
use crate::fit::memory::Memory;
use crate::fit::profile::TWO_SIDED_95;
use crate::model::{HangingSample, Robot};

/// Cycles of the ageing figure.
pub const CYCLES: usize = 8;
/// Fewer intact cycles than this are no run.
const FEWEST_CYCLES: usize = 3;
/// Power and level of the number of samples: z at 0.8 and at 0.975.
const POWER_Z: f64 = 0.8416;
/// Scatter of the loss between samples that is assumed where it was not measured, percentage points.
pub const ASSUMED_SCATTER: f64 = 5.0;
/// Probability from which a cause is named: odds of twenty.
const SURE: f64 = 0.95;
/// Draws for the day at which a loss is reached.
const DRAWS: usize = 4000;
/// A day further than this many times the range of days is not carried by the data.
const REACH: f64 = 3.0;
/// Rest of the fit that a trend may leave: chi^2 per degree of freedom above which no law of the list is
/// called a fit.
const MISFIT: f64 = 4.0;

/// What the recordings are grouped by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// Days of one sample.
    Day,
    /// Batches of one electrode.
    Batch,
}

impl By {
    /// What one level is called.
    fn word(self) -> &'static str {
        match self {
            By::Day => "day",
            By::Batch => "batch",
        }
    }
}

/// What a recording is of, for the joint fit.
#[derive(Debug, Clone)]
pub enum AgeingSubject {
    /// A hanging sample.
    Sample(Box<HangingDataset>, HangingSample),
    /// A robot.
    Robot(Box<Dataset>, Box<Robot>),
}

/// One recording, as ageing sees it.
#[derive(Debug, Clone)]
pub struct AgeingInput {
    /// Identity.
    pub id: String,
    /// `electrode` of its manifest.
    pub electrode: Option<String>,
    /// `batch`.
    pub batch: Option<String>,
    /// `day`.
    pub day: Option<f64>,
    /// The coordinate whose stroke is measured, m; NaN in gaps.
    pub x_m: Vec<f64>,
    /// Time of the first frame, s.
    pub start_s: f64,
    /// Distance of the frames, s.
    pub step_s: f64,
    /// Cycles of its drive.
    pub cycles: Result<Cycles, String>,
    /// What it is of, and what a joint fit needs.
    pub subject: AgeingSubject,
    /// The command at each frame (the first channel), V, to draw loops.
    pub command_v: Vec<f64>,
}

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct AgeingRequest {
    /// Days or batches.
    pub by: By,
    /// Loss from which a change is relevant, %.
    pub threshold_percent: f64,
    /// Loss whose day is asked for, %.
    pub loss_percent: f64,
    /// Cycles over which the stroke is averaged, at most.
    pub cycles: usize,
    /// Scatter with which samples are hung, m, where it is known: next to nothing for a sample that stays in
    /// its frame.
    pub mount_m: Option<f64>,
    /// What was found before the run was stopped.
    pub memory: Memory,
}

impl Default for AgeingRequest {
    fn default() -> Self {
        AgeingRequest {
            by: By::Day,
            threshold_percent: 5.0,
            loss_percent: 50.0,
            cycles: CYCLES,
            mount_m: None,
            memory: Memory::default(),
        }
    }
}

/// One recording that counts.
#[derive(Debug, Clone)]
pub struct Run {
    /// Number among the inputs.
    pub input: usize,
    /// Sample that it is of, within its electrode.
    pub sample: String,
    /// Level, from 0.
    pub level: usize,
    /// Strokes of its cycles.
    pub strokes: Strokes,
}

/// An electrode on one day, or of one batch.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelStroke {
    /// The day, or the batch, as it was stated.
    pub name: String,
    /// The day, where one is stated.
    pub day: Option<f64>,
    /// Mean stroke, mm.
    pub stroke_mm: Value,
    /// 95 % interval of each of the three.
    pub stroke_ci95: [f64; 2],
    /// Change against the first level, mm; a loss is negative.
    pub change_mm: Value,
    /// Its 95 % interval.
    pub change_ci95: [f64; 2],
    /// Change against the first level, %.
    pub change_percent: Value,
    /// Its 95 % interval.
    pub percent_ci95: [f64; 2],
    /// Whether the interval of the change excludes 0.
    pub significant: bool,
    /// Whether the change is beyond the threshold.
    pub relevant: bool,
    /// Change of the stroke within the runs, mm a cycle.
    pub drift_mm: Value,
    /// Samples behind it.
    pub samples: usize,
}

/// A law of the loss over days.
#[derive(Debug, Clone, PartialEq)]
pub struct Trend {
    /// `linear`, `exponential` or `saturating`.
    pub law: &'static str,
    /// Its parameters: rate (1 a day) of the first two; largest loss and time constant (days) of the third.
    pub parameters: Vec<(&'static str, Value)>,
    /// chi^2 per degree of freedom; NaN without one.
    pub misfit: f64,
    /// Loss whose day is told, %.
    pub loss_percent: f64,
    /// That day with its 95 % interval, where the data carry it.
    pub reached_day: Option<(f64, [f64; 2])>,
    /// In words.
    pub says: String,
}

/// A sample of an electrode and its joint fit.
#[derive(Debug, Clone)]
pub struct SampleAgeing {
    /// Its name: the batch, or empty.
    pub name: String,
    /// Levels that it has, by their number in the electrode.
    pub levels: Vec<usize>,
    /// The fit over its levels, or why there is none.
    pub joint: Result<Joint, String>,
    /// Change of the position at rest against the first level as captured, m (upwards is negative), by its
    /// levels.
    pub rest_shift_m: Vec<f64>,
}

/// One electrode.
#[derive(Debug, Clone)]
pub struct ElectrodeAgeing {
    /// Its name.
    pub name: String,
    /// Cycles that were averaged in every run.
    pub cycles: usize,
    /// Levels in order; the first is the reference.
    pub levels: Vec<LevelStroke>,
    /// Its samples.
    pub samples: Vec<SampleAgeing>,
    /// Trend of the loss over days, where there is one.
    pub trend: Option<Trend>,
    /// What a reader should know.
    pub remarks: Vec<String>,
}

/// The test between two electrodes.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Their names.
    pub electrodes: [String; 2],
    /// The level at which they are compared.
    pub level: String,
    /// Change of the first minus change of the second, percentage points.
    pub percent: Value,
    /// 95 % interval.
    pub ci95: [f64; 2],
    /// p-value of no difference.
    pub p_value: f64,
    /// Whether it rests on several samples an electrode.
    pub between_samples: bool,
    /// Scatter between samples, percentage points, that the number of samples rests on.
    pub scatter: f64,
    /// Whether that scatter was measured.
    pub scatter_measured: bool,
    /// Samples an electrode that would show the difference with 80 % power at 5 %.
    pub samples_needed: usize,
    /// In words.
    pub says: String,
}

/// Everything that was found.
#[derive(Debug, Clone)]
pub struct AgeingOutcome {
    /// Grouped by.
    pub by: By,
    /// Loss from which a change is relevant, %.
    pub threshold_percent: f64,
    /// The electrodes, by name.
    pub electrodes: Vec<ElectrodeAgeing>,
    /// Recordings that count.
    pub runs: Vec<Run>,
    /// Differences between electrodes, level by level.
    pub differences: Vec<Difference>,
    /// First sentence.
    pub verdict: String,
    /// Further sentences.
    pub remarks: Vec<String>,
}

impl ElectrodeAgeing {
    /// The sample whose fit speaks for the electrode: the one with most levels.
    #[must_use]
    pub fn main(&self) -> Option<(&SampleAgeing, &Joint)> {
        let fitted = self
            .samples
            .iter()
            .filter_map(|s| Some((s, s.joint.as_ref().ok()?)));
        fitted.max_by_key(|(s, _)| s.levels.len())
    }
}

fn refuse<T>(what: String) -> Result<T, Error> {
    Err(Error::NothingToFit(what))
}

/// A day without needless digits.
fn day_name(day: f64) -> String {
    format!("{day}")
}

/// A recording with its place among electrodes, samples and levels.
struct Placed {
    input: usize,
    electrode: String,
    sample: String,
    level: String,
    day: Option<f64>,
    strokes: Strokes,
}

/// The electrode that a recording states, under the name that it was first stated by.
fn electrode_of(
    input: &AgeingInput,
    names: &mut Vec<String>,
    remarks: &mut Vec<String>,
) -> Result<String, Error> {
    let stated = input.electrode.as_deref().map(str::trim);
    let Some(stated) = stated.filter(|e| !e.is_empty()) else {
        return refuse(format!(
            "recording `{}` states no electrode: add `electrode = \"...\"` under [recording]",
            input.id
        ));
    };
    let Some(known) = names.iter().find(|n| n.eq_ignore_ascii_case(stated)) else {
        names.push(stated.into());
        return Ok(stated.into());
    };
    if known != stated {
        remarks.push(format!(
            "electrode `{stated}` of `{}` is taken as `{known}`.",
            input.id
        ));
    }
    Ok(known.clone())
}

/// Sample and level that a recording is of.
fn sample_and_level(input: &AgeingInput, by: By) -> Result<(String, String), Error> {
    match by {
        By::Day => {
            let Some(day) = input.day else {
                return refuse(format!(
                    "recording `{}` states no day: add `day = ...` under [recording], or compare with --by batch",
                    input.id
                ));
            };
            Ok((input.batch.clone().unwrap_or_default(), day_name(day)))
        }
        By::Batch => {
            let Some(batch) = &input.batch else {
                return refuse(format!(
                    "recording `{}` states no batch: add `batch = \"...\"` under [recording], or compare with --by day",
                    input.id
                ));
            };
            Ok((String::new(), batch.clone()))
        }
    }
}

/// Age is not batch: of each batch its first day.
fn keep_first_days(placed: &mut Vec<Placed>, inputs: &[AgeingInput], remarks: &mut Vec<String>) {
    let first: Vec<(String, String, Option<f64>)> = placed
        .iter()
        .map(|p| (p.electrode.clone(), p.level.clone(), p.day))
        .collect();
    placed.retain(|p| {
        let Some(day) = p.day else { return true };
        let youngest = first
            .iter()
            .filter(|f| f.0 == p.electrode && f.1 == p.level)
            .filter_map(|f| f.2)
            .fold(f64::INFINITY, f64::min);
        if day > youngest {
            remarks.push(format!(
                "`{}` (day {day}) is left out: batches are compared on their first day, {youngest}.",
                inputs[p.input].id
            ));
        }
        day <= youngest
    });
}

/// The recordings that have a stroke, each in its place; and the names of the electrodes.
fn placed(
    inputs: &[AgeingInput],
    request: &AgeingRequest,
    remarks: &mut Vec<String>,
) -> Result<(Vec<Placed>, Vec<String>), Error> {
    let measured: Vec<Result<Strokes, String>> = inputs
        .par_iter()
        .map(|i| {
            let cycles = i.cycles.as_ref().map_err(Clone::clone)?;
            strokes(&i.x_m, i.start_s, i.step_s, cycles, request.cycles)
        })
        .collect();
    let mut names: Vec<String> = Vec::new();
    let mut placed: Vec<Placed> = Vec::new();
    for (number, (input, strokes)) in inputs.iter().zip(measured).enumerate() {
        let electrode = electrode_of(input, &mut names, remarks)?;
        let (sample, level) = sample_and_level(input, request.by)?;
        match strokes {
            Ok(s) => placed.push(Placed {
                input: number,
                electrode,
                sample,
                level,
                day: input.day,
                strokes: s,
            }),
            Err(why) => remarks.push(format!("`{}` is left out: {why}.", input.id)),
        }
    }
    if request.by == By::Batch {
        keep_first_days(&mut placed, inputs, remarks);
    }
    if placed.is_empty() {
        let why = remarks.join(" ");
        return refuse(format!("no recording has a stroke to compare: {why}"));
    }
    Ok((placed, names))
}

/// Measures strokes, fits causes, compares electrodes.
///
/// # Errors
/// [`Error`], in words: no electrode, day or batch stated, nothing to compare with, no cycles.
pub fn ageing(inputs: &[AgeingInput], request: &AgeingRequest) -> Result<AgeingOutcome, Error> {
    let mut remarks = Vec::new();
    let (mut placed, names) = placed(inputs, request, &mut remarks)?;
    let mut electrodes = Vec::new();
    let mut runs = Vec::new();
    for name in &names {
        let (own, rest) = placed.into_iter().partition(|p| &p.electrode == name);
        placed = rest;
        match electrode(name, own, inputs, request)? {
            Ok((e, r)) => {
                electrodes.push(e);
                runs.extend(r);
            }
            Err(why) => remarks.push(why),
        }
    }
    if electrodes.is_empty() {
        return refuse(match remarks.last() {
            Some(why) => why.trim_end_matches('.').to_string(),
            None => "there is nothing to compare".into(),
        });
    }
    remarks.extend(rigs(&electrodes, &runs, inputs));
    let differences = differences(&electrodes);
    let verdict = verdict(&electrodes, request);
    Ok(AgeingOutcome {
        by: request.by,
        threshold_percent: request.threshold_percent,
        electrodes,
        runs,
        differences,
        verdict,
        remarks,
    })
}

/// What it means that electrodes hang on films of another thickness or under another mass.
fn rigs(electrodes: &[ElectrodeAgeing], runs: &[Run], inputs: &[AgeingInput]) -> Vec<String> {
    let of = |e: &ElectrodeAgeing| {
        let named = |input: &&AgeingInput| {
            let own = input.electrode.as_deref();
            own.is_some_and(|n| n.trim().eq_ignore_ascii_case(&e.name))
        };
        let own = runs.iter().map(|r| &inputs[r.input]);
        own.filter(named).find_map(|i| match &i.subject {
            AgeingSubject::Sample(_, sample) => Some(*sample),
            AgeingSubject::Robot(..) => None,
        })
    };
    let mut out = Vec::new();
    for (i, a) in electrodes.iter().enumerate() {
        for b in &electrodes[i + 1..] {
            let (Some(x), Some(y)) = (of(a), of(b)) else {
                continue;
            };
            let mut differ = Vec::new();
            let mut say = |what: &str, unit: &str, u: f64, v: f64| {
                if (u - v).abs() > 1e-6 * u.abs() {
                    differ.push(format!("{what} {u:.4} and {v:.4} {unit}"));
                }
            };
            say("thickness", "mm", x.l3_m * 1e3, y.l3_m * 1e3);
            say("mass", "g", x.mass_kg * 1e3, y.mass_kg * 1e3);
            say("width", "mm", x.width_m * 1e3, y.width_m * 1e3);
            say("length", "mm", x.length_m * 1e3, y.length_m * 1e3);
            if !differ.is_empty() {
                out.push(format!(
                    "{} and {} hang on different rigs ({}): their strokes in mm do not compare, because the stress of the field goes with \
                     1/thickness^2 ({:.2} times that of {} on {}); losses are compared in percent of each sample's own first stroke.",
                    a.name,
                    b.name,
                    differ.join("; "),
                    (x.l3_m / y.l3_m).powi(2),
                    a.name,
                    b.name,
                ));
            }
        }
    }
    out
}

/// Recordings of one electrode by samples and levels.
struct Grouped {
    own: Vec<Placed>,
    samples: Vec<String>,
    /// Name and day of each.
    levels: Vec<(String, Option<f64>)>,
}

/// Short runs go, if what is left can still be compared.
fn leave_short(own: &mut Vec<Placed>, inputs: &[AgeingInput], remarks: &mut Vec<String>) {
    let mut left: Vec<&str> = Vec::new();
    own.retain(|p| {
        let short = p.strokes.cycles.len() < FEWEST_CYCLES;
        if short {
            left.push(&inputs[p.input].id);
        }
        !short
    });
    if !left.is_empty() {
        remarks.push(format!(
            "Left out, with fewer than {FEWEST_CYCLES} intact cycles: {}.",
            left.join(", ")
        ));
    }
}

impl Grouped {
    fn new(own: Vec<Placed>, by: By, remarks: &mut Vec<String>) -> Self {
        // Levels: days in order, batches as they come.
        let mut levels: Vec<(String, Option<f64>)> = Vec::new();
        for p in &own {
            if !levels.iter().any(|l| l.0 == p.level) {
                levels.push((p.level.clone(), p.day));
            }
        }
        if by == By::Day {
            levels.sort_by(|a, b| a.1.partial_cmp(&b.1).unwrap_or(std::cmp::Ordering::Equal));
        }
        let mut out = Grouped {
            samples: distinct(own.iter().map(|p| p.sample.clone())),
            own,
            levels,
        };
        out.join_renamed(by, remarks);
        out
    }

    /// A sample that changed its name has one level under each.
    fn join_renamed(&mut self, by: By, remarks: &mut Vec<String>) {
        let of = |s: &str| count_levels(self.own.iter().filter(|p| p.sample == s));
        if self.samples.len() > 1
            && self.samples.iter().all(|s| of(s) == 1)
            && self.own.len() == self.levels.len()
        {
            remarks.push(format!(
                "The batch is another on every {} ({}): the recordings are taken as of one sample that changed its name. If they are \
                 different samples, the changes are differences between samples.",
                by.word(),
                self.samples.join(", ")
            ));
            self.samples.truncate(1);
            for p in &mut self.own {
                p.sample.clone_from(&self.samples[0]);
            }
        }
    }

    /// The same cycles of every run, because a film still creeps in its first ones; how many.
    fn even_cycles(
        &mut self,
        inputs: &[AgeingInput],
        wanted: usize,
        remarks: &mut Vec<String>,
    ) -> Result<usize, Error> {
        let counts = self.own.iter().map(|p| p.strokes.cycles.len());
        let cycles = counts.min().unwrap_or(0).min(wanted);
        if cycles < wanted {
            let least: Vec<&str> = self
                .own
                .iter()
                .filter(|p| p.strokes.cycles.len() == cycles)
                .map(|p| inputs[p.input].id.as_str())
                .collect();
            remarks.push(format!(
                "{} {} {cycles} intact cycles: of every run only the first {cycles} are averaged, not {wanted}.",
                least.join(", "),
                if least.len() == 1 { "has" } else { "have" },
            ));
        }
        for p in &mut self.own {
            let input = &inputs[p.input];
            for note in &p.strokes.notes {
                remarks.push(format!("{}: {note}.", input.id));
            }
            if p.strokes.cycles.len() > cycles
                && let Ok(c) = &input.cycles
            {
                let again = strokes(&input.x_m, input.start_s, input.step_s, c, cycles);
                p.strokes = again.map_err(Error::NothingToFit)?;
            }
        }
        Ok(cycles)
    }

    /// Number of the level that a recording is of.
    fn level(&self, p: &Placed) -> usize {
        self.levels.iter().position(|l| l.0 == p.level).unwrap_or(0)
    }

    /// Stroke of a sample on a level: the mean over its recordings.
    fn mean(&self, sample: &str, level: usize) -> Option<Value> {
        let values: Vec<Value> = self
            .own
            .iter()
            .filter(|p| p.sample == sample && self.level(p) == level)
            .map(|p| p.strokes.mean)
            .collect();
        let n = values.len() as f64;
        let all = sum(&values);
        (!values.is_empty()).then(|| Value {
            value: all.value / n,
            std_error: all.std_error / n,
        })
    }

    /// Stroke on level `l` over the samples, and its change against the first.
    fn stroke(&self, l: usize, threshold_percent: f64) -> LevelStroke {
        let strokes = self.samples.iter().filter_map(|s| self.mean(s, l));
        let strokes: Vec<Value> = strokes.collect();
        let pairs: Vec<(Value, Value)> = self
            .samples
            .iter()
            .filter_map(|s| Some((self.mean(s, 0)?, self.mean(s, l)?)))
            .collect();
        let all_are = |value: f64| {
            let std_error = value;
            (Value { value, std_error }, [value; 2])
        };
        let pool = |f: fn(&(Value, Value)) -> Value| {
            if l == 0 {
                all_are(0.0)
            } else if pairs.is_empty() {
                all_are(f64::NAN)
            } else {
                pooled(&pairs.iter().map(f).collect::<Vec<_>>())
            }
        };
        let mm = |(v, ci95): (Value, [f64; 2])| {
            let v = Value {
                value: v.value * 1e3,
                std_error: v.std_error * 1e3,
            };
            (v, ci95.map(|x| x * 1e3))
        };
        let (stroke_mm, stroke_ci95) = mm(pooled(&strokes));
        let (change_mm, change_ci95) = mm(pool(difference_m));
        let (change_percent, percent_ci95) = pool(change_percent);
        LevelStroke {
            name: self.levels[l].0.clone(),
            day: self.levels[l].1,
            stroke_mm,
            stroke_ci95,
            change_mm,
            change_ci95,
            change_percent,
            percent_ci95,
            significant: l > 0 && (percent_ci95[0] > 0.0 || percent_ci95[1] < 0.0),
            relevant: l > 0 && change_percent.value.abs() > threshold_percent,
            drift_mm: self.drift_mm(l),
            samples: if l == 0 { strokes.len() } else { pairs.len() },
        }
    }

    /// Mean drift within the runs of a level, mm a cycle.
    fn drift_mm(&self, level: usize) -> Value {
        let own = self.own.iter().filter(|p| self.level(p) == level);
        let drifts: Vec<Value> = own.map(|p| p.strokes.drift).collect();
        let (all, n) = (sum(&drifts), drifts.len() as f64);
        Value {
            value: 1e3 * all.value / n,
            std_error: 1e3 * all.std_error / n,
        }
    }

    /// The joint fit of one sample.
    fn fitted(&self, name: &str, inputs: &[AgeingInput], request: &AgeingRequest) -> SampleAgeing {
        let mine: Vec<&Placed> = self.own.iter().filter(|p| p.sample == name).collect();
        let levels = distinct(mine.iter().map(|p| self.level(p)));
        let place = |p: &&Placed| {
            let own = self.level(p);
            levels.iter().position(|l| *l == own).unwrap_or(0)
        };
        let numbers: Vec<usize> = mine.iter().map(place).collect();
        let subjects = Subjects::of(&mine, inputs);
        SampleAgeing {
            name: name.into(),
            joint: self.cause(&mine, &levels, (&subjects, &numbers), inputs, request),
            rest_shift_m: subjects.rest_shift_m(levels.len(), &numbers),
            levels,
        }
    }

    /// What moved between the levels of a sample; or, in words, why that is not fitted.
    fn cause(
        &self,
        mine: &[&Placed],
        levels: &[usize],
        (subjects, numbers): (&Subjects, &[usize]),
        inputs: &[AgeingInput],
        request: &AgeingRequest,
    ) -> Result<Joint, String> {
        let stroke = |level: usize| {
            let here = mine.iter().zip(numbers).filter(|(_, n)| **n == level);
            let own: Vec<f64> = here.map(|(p, _)| p.strokes.mean.value).collect();
            own.iter().sum::<f64>() / own.len() as f64
        };
        let losses = (0..levels.len()).map(|l| 1.0 - stroke(l) / stroke(0));
        let loss: Vec<f64> = losses.collect();
        let day = |l: &usize| mine.iter().find(|p| self.level(p) == *l)?.day;
        let days: Option<Vec<f64>> = match request.by {
            By::Day => levels.iter().map(day).collect(),
            By::Batch => None,
        };
        let (days, robots) = (days.as_deref(), &subjects.robots);
        if levels.len() < 2 {
            Err(format!("one {} only", request.by.word()))
        } else if subjects.moving.is_empty() {
            let refs: Vec<&HangingDataset> = subjects.hanging.iter().collect();
            AgedSample::new(&refs, &subjects.samples, numbers, request)
                .and_then(|aged| joint(&aged, days, &loss))
                .map_err(|e| e.to_string())
        } else if !subjects.hanging.is_empty() {
            Err(
                "its recordings are of hanging samples and of a robot, which do not share a film"
                    .into(),
            )
        } else if let Some(other) = robots.iter().position(|r| *r != robots[0]) {
            Err(format!(
                "the rigs of `{}` and `{}` differ: what aged is told of one robot, so state the same rig in both",
                inputs[mine[0].input].id, inputs[mine[other].input].id
            ))
        } else {
            let refs: Vec<&Dataset> = subjects.moving.iter().collect();
            AgedRobot::new(robots[0], &refs, numbers, &request.memory)
                .and_then(|aged| joint(&aged, days, &loss))
                .map_err(|e| e.to_string())
        }
    }

    /// The recordings with their levels.
    fn runs(self) -> Vec<Run> {
        let numbers: Vec<usize> = self.own.iter().map(|p| self.level(p)).collect();
        let runs = self.own.into_iter().zip(numbers);
        runs.map(|(p, level)| Run {
            input: p.input,
            sample: p.sample,
            level,
            strokes: p.strokes,
        })
        .collect()
    }
}

fn difference_m((a, b): &(Value, Value)) -> Value {
    Value {
        value: b.value - a.value,
        std_error: a.std_error.hypot(b.std_error),
    }
}

fn change_percent((a, b): &(Value, Value)) -> Value {
    let ratio = b.value / a.value;
    Value {
        value: 100.0 * (ratio - 1.0),
        std_error: 100.0 / a.value * b.std_error.hypot(ratio * a.std_error),
    }
}

/// One electrode; the inner error says why there is nothing to compare.
fn electrode(
    name: &str,
    mut own: Vec<Placed>,
    inputs: &[AgeingInput],
    request: &AgeingRequest,
) -> Result<Result<(ElectrodeAgeing, Vec<Run>), String>, Error> {
    let mut remarks = Vec::new();
    let what = request.by.word();
    leave_short(&mut own, inputs, &mut remarks);
    if count_levels(own.iter()) < 2 {
        let why = remarks.iter().map(|r| format!(" {r}")).collect::<String>();
        return Ok(Err(match own.first() {
            Some(one) => format!(
                "electrode `{name}` has recordings of {what} {} only: a change needs two {what}s.{why}",
                one.level
            ),
            None => {
                format!("electrode `{name}` has no recording that can be compared.{why}")
            }
        }));
    }
    let mut grouped = Grouped::new(own, request.by, &mut remarks);
    let cycles = grouped.even_cycles(inputs, request.cycles, &mut remarks)?;
    let table: Vec<LevelStroke> = (0..grouped.levels.len())
        .map(|l| grouped.stroke(l, request.threshold_percent))
        .collect();
    if let Some(l) = table.iter().find(|l| l.change_mm.value.is_nan()) {
        remarks.push(format!(
            "No sample of {what} {} was recorded on {what} {}: it has a stroke, but no change.",
            l.name, table[0].name
        ));
    }
    let samples = grouped.samples.iter();
    let fitted = samples.map(|s| grouped.fitted(s, inputs, request));
    let electrode = ElectrodeAgeing {
        name: name.into(),
        cycles,
        samples: fitted.collect(),
        trend: match request.by {
            By::Day => trend(&table, request.loss_percent),
            By::Batch => None,
        },
        levels: table,
        remarks,
    };
    Ok(Ok((electrode, grouped.runs())))
}

/// Every one once, in order.
fn distinct<T: Ord>(all: impl Iterator<Item = T>) -> Vec<T> {
    let mut out: Vec<T> = all.collect();
    out.sort_unstable();
    out.dedup();
    out
}

fn count_levels<'p>(placed: impl Iterator<Item = &'p Placed>) -> usize {
    distinct(placed.map(|p| p.level.as_str())).len()
}

/// Sum of values that err independently.
fn sum(values: &[Value]) -> Value {
    let squares = values.iter().map(|v| v.std_error.powi(2));
    Value {
        value: values.iter().map(|v| v.value).sum::<f64>(),
        std_error: squares.sum::<f64>().sqrt(),
    }
}

/// Mean over samples with its 95 % interval: from their scatter where there are several (Student's t), never
/// less than the noise's own.
fn pooled(values: &[Value]) -> (Value, [f64; 2]) {
    let n = values.len() as f64;
    let all = sum(values);
    let (mean, noise) = (all.value / n, all.std_error / n);
    if values.len() < 2 {
        let v = Value {
            value: mean,
            std_error: noise,
        };
        return (v, v.ci95());
    }
    let scatter = values.iter().map(|v| (v.value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let error = (scatter / n).sqrt();
    let t = StudentsT::new(0.0, 1.0, n - 1.0).map_or(TWO_SIDED_95, |d| d.inverse_cdf(0.975));
    let half = (t * error).max(TWO_SIDED_95 * noise);
    let v = Value {
        value: mean,
        std_error: error.max(noise),
    };
    (v, [mean - half, mean + half])
}

/// What the recordings of a sample are of, each up to where the sample failed.
#[derive(Default)]
struct Subjects<'i> {
    hanging: Vec<HangingDataset>,
    samples: Vec<HangingSample>,
    moving: Vec<Dataset>,
    robots: Vec<&'i Robot>,
}

impl<'i> Subjects<'i> {
    fn of(placed: &[&Placed], inputs: &'i [AgeingInput]) -> Self {
        let mut out = Subjects::default();
        for p in placed {
            // What follows a failure says nothing of what was before.
            let failed = p.strokes.notes.iter().any(|n| n.contains("fails"));
            let last = p.strokes.cycles.last().filter(|_| failed);
            let end_s = last.map(|c| c.start_s + p.strokes.period_s);
            match &inputs[p.input].subject {
                AgeingSubject::Sample(dataset, sample) => {
                    let mut dataset = HangingDataset::clone(dataset);
                    if let Some(end_s) = end_s {
                        dataset.forget_after(end_s);
                    }
                    out.hanging.push(dataset);
                    out.samples.push(*sample);
                }
                AgeingSubject::Robot(dataset, robot) => {
                    let mut dataset = Dataset::clone(dataset);
                    if let Some(end_s) = end_s {
                        for i in 0..dataset.samples() {
                            dataset.usable[i] &= dataset.time_s(i) <= end_s;
                        }
                    }
                    out.moving.push(dataset);
                    out.robots.push(robot);
                }
            }
        }
        out
    }

    /// Position at rest on each of so many levels against the first, m; `numbers` are those of the
    /// recordings. Of a robot nothing.
    fn rest_shift_m(&self, levels: usize, numbers: &[usize]) -> Vec<f64> {
        let rest = |l: usize| -> f64 {
            let all = self.hanging.iter().zip(numbers);
            let own: Vec<f64> = all
                .filter(|(_, n)| **n == l)
                .map(|(d, _)| d.rest_below_m)
                .collect();
            own.iter().sum::<f64>() / own.len() as f64
        };
        match self.moving.is_empty() {
            true => (0..levels).map(|l| rest(l) - rest(0)).collect(),
            false => Vec::new(),
        }
    }
}

/// A law of the loss over days.
struct Law {
    name: &'static str,
    parameters: &'static [&'static str],
    /// Share lost after so many days.
    loss: fn(&[f64], f64) -> f64,
    /// Days until a share is lost; NaN where it never is.
    days: fn(&[f64], f64) -> f64,
}

const LAWS: [Law; 3] = [
    Law {
        name: "linear",
        parameters: &["rate_per_day"],
        loss: |p, t| p[0] * t,
        days: |p, loss| loss / p[0],
    },
    Law {
        name: "exponential",
        parameters: &["rate_per_day"],
        loss: |p, t| 1.0 - (-p[0] * t).exp(),
        days: |p, loss| -(1.0 - loss).ln() / p[0],
    },
    Law {
        name: "saturating",
        parameters: &["largest_loss", "time_constant_days"],
        loss: |p, t| p[0] * (1.0 - (-t / p[1]).exp()),
        days: |p, loss| match loss < p[0] {
            true => -p[1] * (1.0 - loss / p[0]).ln(),
            false => f64::NAN,
        },
    },
];

impl Law {
    /// Whether the second parameter is a time, beside a loss.
    fn saturates(&self) -> bool {
        self.parameters.len() == 2
    }

    /// Days until `loss` is lost, if ever.
    fn reach(&self, p: &[f64], loss: f64) -> Option<f64> {
        let t = (self.days)(p, loss);
        (t > 0.0 && t.is_finite()).then_some(t)
    }
}

/// Losses since the first day.
struct Losses {
    /// Days since the first, loss, and its own standard error.
    points: Vec<(f64, f64, f64)>,
    /// Inverse of their covariance.
    weight: DMatrix<f64>,
    /// Days of the last.
    longest: f64,
}

/// A law at its best.
struct LawFit {
    law: &'static Law,
    p: Vec<f64>,
    covariance: DMatrix<f64>,
    square: f64,
    /// BIC.
    criterion: f64,
}

impl Losses {
    /// `None` without two of them, or where no level differs from the first.
    fn new(levels: &[LevelStroke]) -> Option<Self> {
        let first = levels.first()?;
        let points: Vec<(f64, f64, f64)> = levels[1..]
            .iter()
            .filter(|l| l.change_percent.value.is_finite())
            .filter_map(|l| {
                let t = l.day? - first.day?;
                let sd = l.stroke_mm.std_error / first.stroke_mm.value;
                Some((t, -l.change_percent.value / 100.0, sd))
            })
            .collect();
        if points.len() < 2 || !levels.iter().any(|l| l.significant) {
            return None;
        }
        let n = points.len();
        // The first day's error is in every loss.
        let common = first.stroke_mm.std_error / first.stroke_mm.value;
        let weight = DMatrix::from_fn(n, n, |i, j| {
            let shared = common * common * (1.0 - points[i].1) * (1.0 - points[j].1);
            shared + if i == j { points[i].2.powi(2) } else { 0.0 }
        })
        .cholesky()?
        .inverse();
        Some(Losses {
            weight,
            longest: points.iter().map(|p| p.0).fold(0.0, f64::max),
            points,
        })
    }

    fn residual(&self, law: &Law, p: &[f64]) -> DVector<f64> {
        let errors = self.points.iter().map(|q| (law.loss)(p, q.0) - q.1);
        DVector::from_iterator(self.points.len(), errors)
    }

    fn cost(&self, law: &Law, p: &[f64]) -> f64 {
        let r = self.residual(law, p);
        (r.transpose() * &self.weight * &r)[(0, 0)]
    }

    fn slopes(&self, law: &Law, p: &[f64]) -> DMatrix<f64> {
        DMatrix::from_fn(self.points.len(), p.len(), |i, j| {
            let h = 1e-5 * p[j].abs().max(1e-4);
            let (mut up, mut down) = (p.to_vec(), p.to_vec());
            up[j] += h;
            down[j] -= h;
            let t = self.points[i].0;
            ((law.loss)(&up, t) - (law.loss)(&down, t)) / (2.0 * h)
        })
    }

    /// Where the search for a law's parameters begins.
    fn start(&self, law: &Law) -> Vec<f64> {
        if law.saturates() {
            let largest = self.points.iter().map(|q| q.1).fold(0.0, f64::max);
            return vec![largest.max(0.01), self.longest];
        }
        vec![self.points.iter().map(|p| p.1 / p.0).sum::<f64>() / self.points.len() as f64]
    }

    /// Parameters of least squares: damped steps from the start (Levenberg, Marquardt).
    fn search(&self, law: &Law) -> Vec<f64> {
        let mut p = self.start(law);
        let mut damping = 1e-3;
        for _ in 0..200 {
            let j = self.slopes(law, &p);
            let mut a = j.transpose() * &self.weight * &j;
            let g = j.transpose() * &self.weight * self.residual(law, &p);
            for i in 0..p.len() {
                a[(i, i)] *= 1.0 + damping;
            }
            let Some(c) = a.cholesky() else { break };
            let step = c.solve(&g);
            let mut next: Vec<f64> = p.iter().zip(step.iter()).map(|(v, s)| v - s).collect();
            if law.saturates() {
                next[1] = next[1].clamp(0.01 * self.longest, 1e3 * self.longest);
            }
            let (old, new) = (self.cost(law, &p), self.cost(law, &next));
            if new < old {
                p = next;
                damping = (damping * 0.3_f64).max(1e-12);
                if (old - new) < 1e-10 * old.max(1e-10) {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e12 {
                    break;
                }
            }
        }
        p
    }

    /// A law at its best; `None` where it has as many parameters as there are losses, or they are not told.
    fn fit(&self, law: &'static Law) -> Option<LawFit> {
        let (n, unknowns) = (self.points.len(), law.parameters.len());
        if unknowns >= n {
            return None;
        }
        let p = self.search(law);
        let j = self.slopes(law, &p);
        let information = j.transpose() * &self.weight * &j;
        let square = self.cost(law, &p);
        Some(LawFit {
            law,
            covariance: information.cholesky()?.inverse(),
            square,
            criterion: square + unknowns as f64 * (n as f64).ln().max(1.0),
            p,
        })
    }
}

impl LawFit {
    /// Days after which `loss` is lost, and the ends of their 95 % interval, by draws; `None` where the data
    /// do not carry that.
    fn reached(&self, loss: f64, longest: f64) -> Option<(f64, [f64; 2])> {
        let t = self.law.reach(&self.p, loss);
        let t = t.filter(|t| *t <= REACH * longest)?;
        let root = self.covariance.clone().cholesky()?.l();
        let mut generator = ChaCha12Rng::seed_from_u64(7);
        let mut days: Vec<f64> = (0..DRAWS)
            .map(|_| {
                let z =
                    DVector::from_fn(self.p.len(), |_, _| StandardNormal.sample(&mut generator));
                let d: DVector<f64> = &root * z;
                let q: Vec<f64> = self.p.iter().zip(d.iter()).map(|(a, b)| a + b).collect();
                self.law.reach(&q, loss).unwrap_or(f64::INFINITY)
            })
            .collect();
        days.sort_by(f64::total_cmp);
        let ends = [0.025, 0.975].map(|q| days[(q * (DRAWS - 1) as f64) as usize]);
        Some((t, ends))
    }
}

/// Loss over days by three laws: the one of smallest BIC, and the day at which `percent` is lost.
fn trend(levels: &[LevelStroke], percent: f64) -> Option<Trend> {
    let losses = Losses::new(levels)?;
    let mut best: Option<LawFit> = None;
    for law in &LAWS {
        let Some(fit) = losses.fit(law) else { continue };
        if best.as_ref().is_none_or(|b| fit.criterion < b.criterion) {
            best = Some(fit);
        }
    }
    let mut best = best?;
    let (law, p) = (best.law, best.p.clone());
    let misfit = best.square / (losses.points.len() - p.len()) as f64;
    // A law that misses widens its own intervals.
    best.covariance *= misfit.max(1.0);
    let value = |(i, name): (usize, &&'static str)| {
        let v = Value {
            value: p[i],
            std_error: best.covariance[(i, i)].max(0.0).sqrt(),
        };
        (*name, v)
    };
    let first_day = levels.first()?.day;
    let reached = best.reached(percent / 100.0, losses.longest);
    let reached_day = reached.and_then(|(t, ends)| {
        let start = first_day?;
        let ends = ends.map(|d| start + d);
        ends[1].is_finite().then_some((start + t, ends))
    });
    let mut says = format!("The loss follows a {} law", law.name);
    if misfit > MISFIT {
        let errors = losses.residual(law, &p);
        says = format!(
            "No law of the list (linear, exponential, saturating) follows the loss to its noise; the nearest is {}, off by up to {:.1} percentage points, and its intervals are widened for it",
            law.name,
            100.0 * errors.iter().map(|e| e.abs()).fold(0.0, f64::max)
        );
    }
    says += &match &reached_day {
        Some((day, [a, b])) => format!(
            "; {percent} % are lost on day {day:.1} (95 %: {a:.1} to {b:.1}){}",
            match *day - first_day.unwrap_or(0.0) > losses.longest {
                true => ", beyond the last day recorded",
                false => "",
            }
        ),
        None => format!("; on which day {percent} % are lost the data do not carry"),
    };
    says.push('.');
    Some(Trend {
        law: law.name,
        parameters: law.parameters.iter().enumerate().map(value).collect(),
        misfit,
        loss_percent: percent,
        reached_day,
        says,
    })
}

/// Two-sided p-value of a normal deviate.
fn normal_p(z: f64) -> f64 {
    erfc(z.abs() / std::f64::consts::SQRT_2)
}

/// Every pair of electrodes at every level that both have.
fn differences(electrodes: &[ElectrodeAgeing]) -> Vec<Difference> {
    let mut out = Vec::new();
    for (i, a) in electrodes.iter().enumerate() {
        for b in &electrodes[i + 1..] {
            for la in &a.levels[1..] {
                let same = |lb: &&LevelStroke| match (la.day, lb.day) {
                    (Some(x), Some(y)) if la.name == x.to_string() => x == y,
                    _ => la.name == lb.name,
                };
                let Some(lb) = b.levels[1..].iter().find(same) else {
                    continue;
                };
                let (x, y) = (la.change_percent, lb.change_percent);
                if !(x.value.is_finite() && y.value.is_finite()) {
                    continue;
                }
                out.push(difference(a, b, la, lb));
            }
        }
    }
    out
}

fn difference(
    a: &ElectrodeAgeing,
    b: &ElectrodeAgeing,
    la: &LevelStroke,
    lb: &LevelStroke,
) -> Difference {
    let (x, y) = (la.change_percent, lb.change_percent);
    let value = x.value - y.value;
    let error = x.std_error.hypot(y.std_error);
    let between = la.samples > 1 && lb.samples > 1;
    let z = value / error;
    let (p_value, half) = if between {
        // Welch: degrees of freedom by Satterthwaite.
        let (va, vb) = (x.std_error.powi(2), y.std_error.powi(2));
        let degrees = (va + vb).powi(2)
            / (va * va / (la.samples as f64 - 1.0) + vb * vb / (lb.samples as f64 - 1.0));
        match StudentsT::new(0.0, 1.0, degrees.max(1.0)) {
            Ok(t) => (2.0 * t.cdf(-z.abs()), t.inverse_cdf(0.975) * error),
            Err(_) => (normal_p(z), TWO_SIDED_95 * error),
        }
    } else {
        (normal_p(z), TWO_SIDED_95 * error)
    };
    let scatter = if between {
        (0.5 * (x.std_error.powi(2) * la.samples as f64 + y.std_error.powi(2) * lb.samples as f64))
            .sqrt()
    } else {
        ASSUMED_SCATTER
    };
    let needed = 2.0 * ((TWO_SIDED_95 + POWER_Z) * scatter / value).powi(2);
    let samples_needed = if needed.is_finite() {
        (needed.ceil() as usize).max(2)
    } else {
        usize::MAX
    };
    let ci95 = [value - half, value + half];
    let mut says = format!(
        "{} {} {:.1} percentage points more than {} (95 %: {:.1} to {:.1}, p {})",
        a.name,
        if value < 0.0 { "loses" } else { "keeps" },
        value.abs(),
        b.name,
        ci95[0],
        ci95[1],
        match p_value {
            p if p < 1e-3 => "< 0.001".to_string(),
            p if p < 0.0095 => format!("= {p:.3}"),
            p => format!("= {p:.2}"),
        }
    );
    says += &if between {
        format!(
            "; by the scatter between samples of {scatter:.1} points, {samples_needed} samples an electrode would show it."
        )
    } else {
        format!(
            ". One sample an electrode: the interval is that of the capture's noise and says nothing of other samples. If samples of an electrode scatter by {scatter} points, {samples_needed} of each would show such a difference with 80 % power at 5 %."
        )
    };
    Difference {
        electrodes: [a.name.clone(), b.name.clone()],
        level: la.name.clone(),
        percent: Value {
            value,
            std_error: error,
        },
        ci95,
        p_value,
        between_samples: between,
        scatter,
        scatter_measured: between,
        samples_needed,
        says,
    }
}

/// Causes of a joint fit that are named: in the model, at odds of twenty to one, and without a rival that
/// could stand for them.
#[must_use]
pub fn named(joint: &Joint) -> Vec<Cause> {
    let rivalled = |c: Cause| joint.confused.iter().any(|pair| pair[0] == c);
    let in_model = joint.causes.iter().filter(|c| c.in_model);
    in_model
        .filter(|c| c.probability > SURE && !rivalled(c.cause))
        .map(|c| c.cause)
        .collect()
}

/// Causes of the model that are not named, each with the rivals that could stand for it.
#[must_use]
pub fn open(joint: &Joint) -> Vec<Vec<Cause>> {
    let sure = named(joint);
    let in_model = joint.causes.iter().filter(|c| c.in_model);
    in_model
        .filter(|c| !sure.contains(&c.cause))
        .map(|c| {
            let rivals = joint.confused.iter().filter(|p| p[0] == c.cause);
            std::iter::once(c.cause)
                .chain(rivals.map(|p| p[1]))
                .collect()
        })
        .collect()
}

/// What a cause is called in a sentence.
#[must_use]
pub fn words(cause: Cause) -> &'static str {
    match cause {
        Cause::ElectrodeStiffness => "a stiffer electrode",
        Cause::SeriesResistance => "another series resistance",
        Cause::ActiveArea => "another active area (or permittivity)",
        Cause::FilmModulus => "another modulus of the film",
        Cause::Load => "another load",
    }
}

/// A cause that is not named, with the rivals that could stand for it, as part of a sentence.
#[must_use]
pub fn doubtful(group: &[Cause]) -> String {
    let names: Vec<&str> = group.iter().map(|c| words(*c)).collect();
    match names.as_slice() {
        [one] => format!("perhaps by {one}"),
        several => format!("by {} (not told apart)", several.join(" or ")),
    }
}

fn verdict(electrodes: &[ElectrodeAgeing], request: &AgeingRequest) -> String {
    let what = request.by.word();
    electrodes
        .iter()
        .map(|e| {
            let mut text = match e
                .levels
                .iter()
                .rev()
                .find(|l| l.change_percent.value.is_finite())
            {
                Some(l) if l.significant => format!(
                    "{}: {:+.1} % of stroke by {what} {} (95 %: {:+.1} to {:+.1})",
                    e.name, l.change_percent.value, l.name, l.percent_ci95[0], l.percent_ci95[1]
                ),
                Some(l) => format!(
                    "{}: no change of stroke by {what} {} ({:+.1} %, 95 %: {:+.1} to {:+.1})",
                    e.name, l.name, l.change_percent.value, l.percent_ci95[0], l.percent_ci95[1]
                ),
                None => format!("{}: nothing to compare", e.name),
            };
            if let Some((_, joint)) = e.main() {
                let list: Vec<&str> = named(joint).into_iter().map(words).collect();
                let groups = open(joint);
                text += &match list.is_empty() && groups.is_empty() {
                    true => ", no cause".to_string(),
                    false if list.is_empty() => String::new(),
                    false => format!(", by {}", list.join(" and ")),
                };
                for group in groups {
                    text += &format!(", {}", doubtful(&group));
                }
            } else if let Some(Err(why)) = e.samples.first().map(|s| &s.joint) {
                text += &format!(" ({why})");
            }
            text + "."
        })
        .collect::<Vec<_>>()
        .join(" ")
}
