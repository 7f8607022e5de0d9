//! From a recording of a hanging film sample to a dataset: x downwards, zero at rest, SI, equidistant frames.
//!
//! Nothing is smoothed here: the capture's noise is in x alone, and a model that predicts x is held against x
//! as captured.

use super::noise::white;
use super::robot::{grid, possible_m, signs, volts, without_spikes, world_frame};
use super::smoother::{SmoothedAxis, smooth_axis};
use super::{Error, OffsetSource, Plan, SmoothingPlan, Voltage, coarse_offset, plan, runs};
use crate::recording::{FilmState, NumberOrEstimate, Payload, RawVoltage, Recording};

/// Share of the largest voltage below which the sample counts as at rest, before the drive begins.
const REST_SHARE: f64 = 0.01;
/// Captured frames at rest from which its position is taken.
const REST_FRAMES: usize = 5;
/// Captured frames that a recording needs.
const FEWEST_FRAMES: usize = 16;
/// Noise of a capture that has none, m: below any instrument's last digit.
const LEAST_NOISE_M: f64 = 1e-9;

/// What a dataset of a hanging sample is made of, SI, on the motion clock.
#[derive(Debug, Clone)]
pub struct HangingParts {
    /// Identity of the recording.
    pub id: String,
    /// Distance of the captured frames, s.
    pub step_s: f64,
    /// Time of the first frame, s.
    pub start_s: f64,
    /// How far the free end lies below the origin of the world, m; NaN where it was not captured.
    pub below_m: Vec<f64>,
    /// Mass beside that of the rig, kg.
    pub payload_kg: f64,
    /// Commanded voltage, one channel.
    pub voltage: Voltage,
    /// Stated clock offset (voltage minus motion), s; `None` lets it be estimated.
    pub offset_s: Option<f64>,
}

/// A capture of a hanging sample and its voltage, as a calibration needs them.
#[derive(Debug, Clone)]
pub struct HangingDataset {
    /// Identity of the recording.
    pub id: String,
    /// Distance of the captured frames, s.
    pub step_s: f64,
    /// Time of the first frame on the motion clock, s.
    pub start_s: f64,
    /// Captured x, downwards, zero at rest, m; NaN where nothing was captured.
    pub x_m: Vec<f64>,
    /// How far the free end lies below the origin of the world at rest, m: it holds the length of the sample
    /// and how it was hung.
    pub rest_below_m: f64,
    /// Mass beside that of the rig, kg.
    pub payload_kg: f64,
    /// Commanded voltage, one channel.
    pub voltage: Voltage,
    /// Voltage clock minus motion clock, s.
    pub offset_s: f64,
    /// Whether it is fixed.
    pub offset_source: OffsetSource,
    /// Standard deviation of the capture noise, m, from fourth differences.
    pub noise_m: f64,
    /// What a reader should know, in words.
    pub notes: Vec<String>,
}

impl HangingDataset {
    /// Aligns and finds rest and noise.
    ///
    /// # Errors
    /// [`Error::TooShort`] when fewer than 16 frames were captured, [`Error::NoOverlap`] when voltage and
    /// motion share no time.
    pub fn new(parts: HangingParts) -> Result<Self, Error> {
        let captured = parts.below_m.iter().filter(|v| !v.is_nan()).count();
        if captured < FEWEST_FRAMES {
            return Err(Error::TooShort {
                id: parts.id,
                what: format!("{captured} captured frames are too few: {FEWEST_FRAMES} are needed"),
            });
        }
        let (step_s, start_s) = (parts.step_s, parts.start_s);
        let (offset_s, offset_source) = match parts.offset_s {
            Some(stated) => (stated, OffsetSource::Stated),
            None => {
                let bridged = bridged(&parts.below_m)
                    .iter()
                    .map(|b| -b)
                    .collect::<Vec<_>>();
                let found = coarse_offset(&bridged, start_s, step_s, &parts.voltage);
                (found, OffsetSource::Free)
            }
        };
        let motion_s = (start_s, start_s + step_s * (parts.below_m.len() - 1) as f64);
        let (first, last) = parts.voltage.span_s();
        let voltage_s = (first - offset_s, last - offset_s);
        if motion_s.1.min(voltage_s.1) - motion_s.0.max(voltage_s.0) < 10.0 * step_s {
            return Err(Error::NoOverlap {
                id: parts.id,
                motion_s,
                voltage_s,
                offset_s,
            });
        }
        let mut notes = Vec::new();
        let largest = parts.voltage.channels_v()[0]
            .iter()
            .fold(0.0_f64, |m, v| m.max(v.abs()));
        let resting = (0..parts.below_m.len())
            .take_while(|&i| {
                let t = start_s + step_s * i as f64 + offset_s;
                parts.voltage.at(0, t).abs() <= REST_SHARE * largest
            })
            .count();
        let quiet: Vec<f64> = parts.below_m[..resting]
            .iter()
            .copied()
            .filter(|v| !v.is_nan())
            .collect();
        let rest_below_m = if quiet.len() >= REST_FRAMES {
            quiet.iter().sum::<f64>() / quiet.len() as f64
        } else {
            notes.push(format!(
                "{} captured frames before the drive begins: the position at rest is known from the first frames only",
                quiet.len()
            ));
            let early: Vec<f64> = parts
                .below_m
                .iter()
                .copied()
                .filter(|v| !v.is_nan())
                .take(REST_FRAMES)
                .collect();
            early.iter().sum::<f64>() / early.len() as f64
        };
        let at_first = parts.voltage.at(0, start_s + offset_s).abs();
        if at_first > REST_SHARE * largest {
            notes.push(format!(
                "the recording begins under {at_first:.0} V: the sample is taken to hang at rest under that voltage at the first frame"
            ));
        }
        let x_m: Vec<f64> = parts.below_m.iter().map(|b| b - rest_below_m).collect();
        let noise_m = white(&x_m, 4).max(LEAST_NOISE_M);
        Ok(HangingDataset {
            id: parts.id,
            step_s,
            start_s,
            x_m,
            rest_below_m,
            payload_kg: parts.payload_kg,
            voltage: parts.voltage,
            offset_s,
            offset_source,
            noise_m,
            notes,
        })
    }

    /// Puts a recording of kind `film-sample` on one clock, in SI, x downwards from rest.
    ///
    /// # Errors
    /// [`Error::Unsuitable`] for a recording of another kind, a virgin film or a payload that changes, and
    /// those of [`HangingDataset::new`].
    pub fn from_recording(recording: &Recording) -> Result<Self, Error> {
        let manifest = &recording.manifest;
        let unsuitable = |what: String| Error::Unsuitable {
            id: manifest.id.clone(),
            what,
        };
        let (Some(motion), Some(voltage), Some(stated)) =
            (&recording.motion, &recording.voltage, &manifest.motion)
        else {
            let what = format!(
                "kind \"{}\" has no motion of a free end",
                manifest.kind.name()
            );
            return Err(unsuitable(what));
        };
        if voltage.channels.len() != 1 {
            let what = format!(
                "{} voltage channels, a hanging sample has 1: name its column in [voltage] channels",
                voltage.channels.len()
            );
            return Err(unsuitable(what));
        }
        let Payload::Constant { mass_g } = &manifest.payload else {
            return Err(unsuitable(
                "payload_g changes during the recording, which the model of a hanging sample has no place for: give one number".into(),
            ));
        };
        let mut notes = Vec::new();
        match manifest.film_state {
            Some(FilmState::Relaxed) => {}
            Some(FilmState::Virgin) => {
                return Err(unsuitable(
                    "film_state = \"virgin\": a sample that was hung just now creeps under its load and is not at rest; let it hang before it is recorded".into(),
                ));
            }
            None => notes.push(
                "film_state is not stated: every branch is taken as relaxed at the first frame"
                    .into(),
            ),
        }
        let world = world_frame(motion, stated, &mut notes);
        let (start_s, step_s, seen) = grid(motion, &mut notes).map_err(unsuitable)?;
        let mut seen: Vec<_> = seen.iter().map(world).collect();
        possible_m(&seen, start_s, step_s).map_err(unsuitable)?;
        notes.extend(without_spikes(&mut seen, start_s, step_s));
        let scale = voltage.unit.to_si * voltage.scale.unwrap_or(1.0);
        let RawVoltage {
            time_s,
            channels,
            hold_previous,
            ..
        } = voltage;
        let parts = HangingParts {
            id: manifest.id.clone(),
            step_s,
            start_s,
            below_m: seen.iter().map(|p| -p[2]).collect(),
            payload_kg: mass_g * 1e-3,
            voltage: volts(
                time_s,
                channels,
                scale,
                *hold_previous,
                "voltage",
                &mut notes,
            )
            .map_err(unsuitable)?
            .ok_or_else(|| unsuitable("no voltage sample has a value".into()))?,
            offset_s: match manifest.offset_s {
                NumberOrEstimate::Number(stated) => Some(stated),
                NumberOrEstimate::Estimate => None,
            },
        };
        notes.extend(signs(&parts.voltage));
        let mut dataset = HangingDataset::new(parts)?;
        dataset.notes.splice(0..0, notes);
        Ok(dataset)
    }

    /// Forgets the frames after `end_s` on the motion clock: they are NaN, and the noise is that of the
    /// frames before.
    pub fn forget_after(&mut self, end_s: f64) {
        let (start_s, step_s) = (self.start_s, self.step_s);
        for (i, x) in self.x_m.iter_mut().enumerate() {
            if start_s + step_s * i as f64 > end_s {
                *x = f64::NAN;
            }
        }
        self.noise_m = white(&self.x_m, 4).max(LEAST_NOISE_M);
    }

    /// Number of frames.
    pub fn samples(&self) -> usize {
        self.x_m.len()
    }

    /// Time of a frame on the motion clock, s.
    pub fn time_s(&self, sample: usize) -> f64 {
        self.start_s + self.step_s * sample as f64
    }

    /// Whether the frame was captured (not in a gap).
    pub fn captured(&self, sample: usize) -> bool {
        !self.x_m[sample].is_nan()
    }

    /// Runs of frames that were not captured: first frame and length.
    pub fn gaps(&self) -> Vec<(usize, usize)> {
        let observed: Vec<bool> = (0..self.samples()).map(|i| self.captured(i)).collect();
        runs(&observed, false)
    }

    /// x, smoothed: for the inverse dynamics, which needs accelerations.
    ///
    /// # Errors
    /// [`Error::TooShort`].
    pub fn smoothed(&self, plan: Option<&Plan>) -> Result<SmoothedAxis, Error> {
        let fixed = plan.and_then(|p| p.smoothing.first());
        smooth_axis(
            &self.x_m,
            self.step_s,
            fixed.map(|f| f.order),
            fixed.map(|f| f.cutoff_hz),
        )
        .map_err(|what| Error::TooShort {
            id: self.id.clone(),
            what,
        })
    }

    /// The choices made for this recording, with `axis` from [`HangingDataset::smoothed`].
    pub fn plan(&self, axis: &SmoothedAxis) -> Plan {
        Plan {
            sync: None,
            stretches: None,
            recording: self.id.clone(),
            smoothing: vec![SmoothingPlan::of(&axis.choice)],
            criterion: plan::CRITERION.into(),
            offset_s: match self.offset_source {
                OffsetSource::Stated | OffsetSource::Measured => Some(self.offset_s),
                OffsetSource::Free => None,
            },
        }
    }
}

/// Gaps bridged by straight lines, ends held.
fn bridged(values: &[f64]) -> Vec<f64> {
    let mut out = values.to_vec();
    let mut last: Option<usize> = None;
    for i in 0..values.len() {
        if values[i].is_nan() {
            continue;
        }
        let from = last.map_or(values[i], |l| values[l]);
        let begin = last.map_or(0, |l| l + 1);
        let length = (i + 1 - begin) as f64;
        for j in begin..i {
            let share = match last {
                Some(_) => (j + 1 - begin) as f64 / length,
                None => 1.0,
            };
            out[j] = from + share * (values[i] - from);
        }
        last = Some(i);
    }
    if let Some(l) = last {
        let held = values[l];
        out[l + 1..].fill(held);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_bridged_by_lines() {
        let nan = f64::NAN;
        let got = bridged(&[nan, 1.0, nan, nan, 4.0, nan]);
        assert_eq!(got, [1.0, 1.0, 2.0, 3.0, 4.0, 4.0]);
    }
}
