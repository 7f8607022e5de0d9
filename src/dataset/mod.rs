//! One clock, one world frame, SI, a mask, and the motion with its derivatives and its noise. Discards no
//! sample, marks it; writes down every choice it made in a [`Plan`], which can be given back to make the same
//! choices again.

mod colour;
mod coupon;
mod cycles;
mod gap;
pub mod line;
mod noise;
mod plan;
mod rest;
mod robot;
mod sample;
pub mod smoother;
mod spikes;
mod stretches;
mod sync;
mod thin;
mod voltage;

pub use colour::Colour;
pub use coupon::{
    Coupon, CouponError, CouponMode, CouponParts, CouponPlan, FEW_ROWS, Grid, GridChoice,
};
pub use cycles::{Cycles, cycles, repeats};
pub use plan::{Plan, SmoothingPlan, StretchPlan, SyncPlan};
pub use rest::{Wander, tell_wander};
pub use sample::{HangingDataset, HangingParts};
pub use stretches::{Between, stretches};
pub use sync::{Clocks, Event};
pub use voltage::Voltage;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::film::InitialState;
use crate::kinematics::Vec3;
use gap::Bridges;
pub(crate) use smoother::SmoothedAxis;
use smoother::smooth_axis;
use stretches::Part;
use thin::Thinned;

/// Motion of the end effector's centre at equal distances in time, SI, world axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Distance of the samples, s.
    pub step_s: f64,
    /// Position, m.
    pub position_m: Vec<Vec3>,
    /// Velocity, m/s.
    pub velocity_m_s: Vec<Vec3>,
    /// Acceleration, m/s^2.
    pub acceleration_m_s2: Vec<Vec3>,
    /// Payload m_p at each sample, kg.
    pub payload_kg: Vec<f64>,
    /// State of the films at the first sample.
    pub initial: InitialState,
}

/// Where the clock offset of a recording comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OffsetSource {
    /// Stated by the recording: fixed.
    Stated,
    /// From events or a shared channel: fixed, with a standard error.
    Measured,
    /// To be estimated: free in a fit.
    Free,
}

/// A motion capture of the robot and its applied voltages, as a calibration needs them.
#[derive(Debug, Clone)]
pub struct Dataset {
    /// Identity of the recording.
    pub id: String,
    /// Distance of the captured frames, s.
    pub step_s: f64,
    /// Time of the first frame on the motion clock, s.
    pub start_s: f64,
    /// Measured position of the end effector's centre in the world frame, m; NaN where nothing was captured.
    pub measured_m: Vec<Vec3>,
    /// x, y and z, smoothed.
    pub axes: [SmoothedAxis; 3],
    /// Samples whose motion can be used: captured, or in a gap that the smoother bridges.
    pub usable: Vec<bool>,
    /// Samples about a gap that the smoother cannot bridge: beside it derivatives rest on one side, and after
    /// it what the film went through is not known; and the first of each further stretch. Neither a fit nor
    /// an error counts them.
    pub film_unknown: Vec<bool>,
    /// Payload at each frame, kg.
    pub payload_kg: Vec<f64>,
    /// Commanded voltages.
    pub voltage: Voltage,
    /// The amplifier's own measurement, where there is one.
    pub monitor: Option<Voltage>,
    /// Voltage clock minus motion clock, s.
    pub offset_s: f64,
    /// Whether it is fixed.
    pub offset_source: OffsetSource,
    /// State of the films at the first sample.
    pub initial: InitialState,
    /// The slow part of the capture's noise, where a marker that stands still tells of one.
    pub colour: Option<Colour>,
    /// What wanders before the drives of the recordings that this one was told of with ([`tell_wander`]).
    pub wander: Option<Wander>,
    /// The point about which wrongly rotated capture axes turn: the base marker less the offset of the
    /// end-effector marker, m.
    pub pivot_m: Vec3,
    /// Every choice that was made.
    pub plan: Plan,
    /// What a reader should know, in words.
    pub notes: Vec<String>,
    /// The gaps that the smoother cannot bridge.
    bridges: Option<Bridges>,
    /// Which frames these are, where they are not all.
    part: Option<Part>,
    thinned: Option<Thinned>,
}

/// What a dataset is made of, on the motion clock, SI and world axes.
#[derive(Debug, Clone)]
pub struct Parts {
    /// Identity of the recording.
    pub id: String,
    /// Distance of the captured frames, s.
    pub step_s: f64,
    /// Time of the first frame, s.
    pub start_s: f64,
    /// Measured position of the end effector's centre, m; NaN where missing.
    pub measured_m: Vec<Vec3>,
    /// Payload at each frame, kg.
    pub payload_kg: Vec<f64>,
    /// Commanded voltages of the three chains.
    pub voltage: Voltage,
    /// Measured voltages.
    pub monitor: Option<Voltage>,
    /// Stated clock offset, s; `None` lets it be estimated.
    pub offset_s: Option<f64>,
    /// State of the films at the first sample.
    pub initial: InitialState,
}

/// Data that cannot become a dataset.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Too little was captured.
    #[error("recording `{id}`: {what}")]
    TooShort {
        /// Recording.
        id: String,
        /// What is missing.
        what: String,
    },
    /// A recording that is not what is asked for.
    #[error("recording `{id}`: {what}")]
    Unsuitable {
        /// Recording.
        id: String,
        /// Why.
        what: String,
    },
    /// Voltage and motion share no time.
    #[error(
        "recording `{id}`: voltage and motion do not overlap in time: the motion runs from {motion_s:?} s, the voltage from {voltage_s:?} s on the motion clock (offset {offset_s} s); check [sync] offset_s"
    )]
    NoOverlap {
        /// Recording.
        id: String,
        /// First and last frame, s.
        motion_s: (f64, f64),
        /// First and last voltage sample on the motion clock, s.
        voltage_s: (f64, f64),
        /// Offset used, s.
        offset_s: f64,
    },
}

/// Largest clock offset that is looked for, s, when a recording leaves it to be estimated.
pub const OFFSET_SEARCH_S: f64 = 5.0;

/// A gap is bridged while the smoothed position stays this well known, relative to its median uncertainty.
const BRIDGE_LIMIT: f64 = 5.0;

impl Dataset {
    /// Smooths, masks and aligns. `plan` fixes choices that were made before.
    ///
    /// # Errors
    /// [`Error::TooShort`] when fewer than 16 frames were captured, [`Error::NoOverlap`] when voltage and
    /// motion share no time.
    pub fn new(parts: Parts, plan: Option<&Plan>) -> Result<Self, Error> {
        let too_short = |what| Error::TooShort {
            id: parts.id.clone(),
            what,
        };
        let values = [0, 1, 2].map(|k| parts.measured_m.iter().map(|p| p[k]).collect::<Vec<_>>());
        let axis = |k: usize| -> Result<SmoothedAxis, Error> {
            let fixed = plan.and_then(|p| p.smoothing.get(k));
            smooth_axis(
                &values[k],
                parts.step_s,
                fixed.map(|f| f.order),
                fixed.map(|f| f.cutoff_hz),
            )
            .map_err(too_short)
        };
        let (x, (y, z)) = rayon::join(|| axis(0), || rayon::join(|| axis(1), || axis(2)));
        let mut axes = [x?, y?, z?];
        let fixed = plan.map(|p| &p.smoothing[..]);
        smoother::let_follow(&mut axes, &values, fixed).map_err(too_short)?;
        let mut notes = Vec::new();
        let observed: Vec<bool> = parts.measured_m.iter().map(|p| !p[0].is_nan()).collect();
        let (usable, film_unknown, long) = bridged(&observed, &axes, parts.step_s, &mut notes);
        let (offset_s, offset_source) = match (plan.and_then(|p| p.offset_s), parts.offset_s) {
            (Some(fixed), _) => (fixed, OffsetSource::Stated),
            (None, Some(stated)) => (stated, OffsetSource::Stated),
            (None, None) => (
                coarse_offset(
                    &axes[2].position,
                    parts.start_s,
                    parts.step_s,
                    &parts.voltage,
                ),
                OffsetSource::Free,
            ),
        };
        let n = parts.measured_m.len();
        let motion_s = (parts.start_s, parts.start_s + parts.step_s * (n - 1) as f64);
        let (first, last) = parts.voltage.span_s();
        let voltage_s = (first - offset_s, last - offset_s);
        let shared = motion_s.1.min(voltage_s.1) - motion_s.0.max(voltage_s.0);
        if shared < 10.0 * parts.step_s {
            return Err(Error::NoOverlap {
                id: parts.id,
                motion_s,
                voltage_s,
                offset_s,
            });
        }
        let plan = Plan {
            recording: parts.id.clone(),
            smoothing: axes.iter().map(|a| SmoothingPlan::of(&a.choice)).collect(),
            criterion: plan::CRITERION.into(),
            offset_s: match offset_source {
                OffsetSource::Stated | OffsetSource::Measured => Some(offset_s),
                OffsetSource::Free => None,
            },
            sync: plan.and_then(|p| p.sync.clone()),
            stretches: plan.and_then(|p| p.stretches),
        };
        let mut bridges = None;
        if !long.is_empty() {
            let mut bridged_track = track_of(&axes, parts.step_s, &parts.payload_kg, parts.initial);
            bridges = Bridges::over(
                long,
                &observed,
                &parts.voltage,
                parts.start_s + offset_s,
                &mut bridged_track,
            );
            for (k, axis) in axes.iter_mut().enumerate() {
                let of = |list: &[Vec3]| list.iter().map(|v| v[k]).collect();
                axis.position = of(&bridged_track.position_m);
                axis.velocity = of(&bridged_track.velocity_m_s);
                axis.acceleration = of(&bridged_track.acceleration_m_s2);
            }
        }
        Ok(Dataset {
            id: parts.id,
            step_s: parts.step_s,
            start_s: parts.start_s,
            measured_m: parts.measured_m,
            axes,
            bridges,
            part: None,
            thinned: None,
            usable,
            film_unknown,
            payload_kg: parts.payload_kg,
            voltage: parts.voltage,
            monitor: parts.monitor,
            offset_s,
            offset_source,
            initial: parts.initial,
            colour: None,
            wander: None,
            pivot_m: [0.0; 3],
            plan,
            notes,
        })
    }

    /// Takes the colour of the capture's noise from a marker that stands still (the base), as measured, in
    /// any unit.
    fn colour_from(&mut self, still: &[Vec3]) {
        let axes = about_the_mean(still);
        let moves = axes
            .iter()
            .any(|a| a.iter().all(|v| *v == 0.0 || v.is_nan()));
        if !moves {
            self.colour = colour::colour(&axes, &[0.15; 3], self.step_s);
        }
    }

    /// Number of frames.
    pub fn samples(&self) -> usize {
        self.measured_m.len()
    }

    /// Time of a frame on the motion clock, s.
    pub fn time_s(&self, sample: usize) -> f64 {
        self.start_s + self.step_s * self.frame(sample) as f64
    }

    /// Whether the frame was captured (not in a gap).
    pub fn captured(&self, sample: usize) -> bool {
        !self.measured_m[sample][0].is_nan()
    }

    /// Standard deviation of the capture noise of each axis, m.
    pub fn noise_m(&self) -> Vec3 {
        [0, 1, 2].map(|k| self.axes[k].choice.noise)
    }

    /// Commanded voltage of a chain (0 to 2) at a frame, V, with the clock offset `offset_s`.
    pub fn command_v(&self, chain: usize, sample: usize, offset_s: f64) -> f64 {
        self.voltage.at(chain, self.time_s(sample) + offset_s)
    }

    /// Whether the voltage is known at a frame, with the clock offset `offset_s`.
    pub fn has_voltage(&self, sample: usize, offset_s: f64) -> bool {
        let (first, last) = self.voltage.span_s();
        let slack = 0.5 * self.step_s;
        (first - slack..=last + slack).contains(&(self.time_s(sample) + offset_s))
    }

    /// The smoothed track.
    pub fn track(&self) -> Track {
        track_of(&self.axes, self.step_s, &self.payload_kg, self.initial)
    }

    /// A track drawn from what the capture leaves open: the smoothed one plus deviations of its uncertainty.
    pub fn drawn_track(&self, generator: &mut impl Rng) -> Track {
        if let Some(thinned) = &self.thinned {
            return thinned.of(&thinned.whole.drawn_track(generator));
        }
        let mut track = self.track();
        for (k, axis) in self.axes.iter().enumerate() {
            axis.draw_deviation(generator, |i, d| {
                track.position_m[i][k] += d[0];
                track.velocity_m_s[i][k] += d[1];
                track.acceleration_m_s2[i][k] += d[2];
            });
            if let Some(slow) = self.slow_noise_m(axis, generator) {
                self.deviate(&mut track, k, &slow, 1.0);
            }
        }
        if let Some(bridges) = &self.bridges {
            bridges.carry(&self.track(), &mut track, Some(generator));
        }
        track
    }

    /// The smoothed track with the capture's noise once more: plus `times` what the smoother makes of a draw
    /// of it.
    pub fn noisier_track(&self, generator: &mut impl Rng, times: f64) -> Track {
        if let Some(thinned) = &self.thinned {
            return thinned.of(&thinned.whole.noisier_track(generator, times));
        }
        let mut track = self.track();
        for (k, axis) in self.axes.iter().enumerate() {
            let noise = self.capture_noise_m(axis, generator);
            self.deviate(&mut track, k, &noise, times);
        }
        self.carry_bridges(&mut track);
        track
    }

    /// Gaps that the smoother cannot bridge, in a track that was smoothed anew.
    fn carry_bridges(&self, track: &mut Track) {
        if let Some(bridges) = &self.bridges {
            bridges.carry(&self.track(), track, None::<&mut rand_chacha::ChaCha12Rng>);
        }
    }

    /// Adds `times` what the smoother makes of an axis's noise to a track.
    fn deviate(&self, track: &mut Track, k: usize, noise_m: &[f64], times: f64) {
        let Some(part) = self.smooth_as(&self.axes[k], noise_m) else {
            return;
        };
        for i in 0..self.samples() {
            track.position_m[i][k] += times * part.position[i];
            track.velocity_m_s[i][k] += times * part.velocity[i];
            track.acceleration_m_s2[i][k] += times * part.acceleration[i];
        }
    }

    /// The track of another motion, m a frame of the whole dataset, had it been captured and smoothed as this
    /// one was: with `times` a draw of the capture's noise, and its gaps. `None` where it is not known at too
    /// many frames.
    pub fn retaken_track(
        &self,
        position_m: &[Vec3],
        generator: &mut impl Rng,
        times: f64,
    ) -> Option<Track> {
        if let Some(thinned) = &self.thinned {
            let track = thinned.whole.retaken_track(position_m, generator, times)?;
            return Some(thinned.of(&track));
        }
        let mut track = self.track();
        for (k, axis) in self.axes.iter().enumerate() {
            let noise = self.capture_noise_m(axis, generator);
            let seen: Vec<f64> = (position_m.iter().zip(&noise))
                .map(|(u, n)| u[k] + times * n)
                .collect();
            let smoothed = self.smooth_as(axis, &seen)?;
            for i in 0..self.samples() {
                track.position_m[i][k] = smoothed.position[i];
                track.velocity_m_s[i][k] = smoothed.velocity[i];
                track.acceleration_m_s2[i][k] = smoothed.acceleration[i];
            }
        }
        self.carry_bridges(&mut track);
        Some(track)
    }

    /// A draw of the capture's noise on an axis, m: its white and its slow part; NaN where nothing was
    /// captured.
    fn capture_noise_m(&self, axis: &SmoothedAxis, generator: &mut impl Rng) -> Vec<f64> {
        let white = self
            .colour
            .map_or(1.0, |c| 1.0 / (1.0 + c.seen(axis)))
            .sqrt();
        let mut noise: Vec<f64> = (0..self.samples())
            .map(|i| {
                let fresh: f64 = StandardNormal.sample(generator);
                if self.captured(i) {
                    white * axis.choice.noise * fresh
                } else {
                    f64::NAN
                }
            })
            .collect();
        let slow = self.slow_noise_m(axis, generator);
        for (n, slow) in noise.iter_mut().zip(slow.into_iter().flatten()) {
            *n += slow;
        }
        noise
    }

    /// Other values of an axis, smoothed as its own are.
    fn smooth_as(&self, axis: &SmoothedAxis, values: &[f64]) -> Option<SmoothedAxis> {
        let (order, cutoff_hz) = (Some(axis.choice.order), Some(axis.choice.cutoff_hz));
        let smoothed = match &axis.lead {
            Some(led) => led.lead.smooth(values, self.step_s, order, cutoff_hz),
            None => smooth_axis(values, self.step_s, order, cutoff_hz),
        };
        smoothed.ok()
    }

    /// A draw of the noise's slow part on an axis, m; NaN where nothing was captured.
    fn slow_noise_m(&self, axis: &SmoothedAxis, generator: &mut impl Rng) -> Option<Vec<f64>> {
        let colour = self.colour?;
        let a = (-self.step_s / colour.correlation_s).exp();
        // The noise that the smoother found holds the white part, and of the slow one what it does not take
        // for motion.
        let size = axis.choice.noise * (colour.variance / (1.0 + colour.seen(axis))).sqrt();
        let mut state: f64 = StandardNormal.sample(generator);
        let noise = (0..self.samples()).map(|i| {
            let fresh: f64 = StandardNormal.sample(generator);
            state = a * state + (1.0 - a * a).sqrt() * fresh;
            if self.captured(i) {
                size * state
            } else {
                f64::NAN
            }
        });
        Some(noise.collect())
    }

    /// Runs of frames that were not captured: first frame and length.
    pub fn gaps(&self) -> Vec<(usize, usize)> {
        let observed: Vec<bool> = (0..self.samples()).map(|i| self.captured(i)).collect();
        runs(&observed, false)
    }
}

impl Colour {
    /// Variance over the white part's of what lies above the frequency up to which the smoother follows an
    /// axis.
    fn seen(&self, axis: &SmoothedAxis) -> f64 {
        let turn = 2.0 * std::f64::consts::PI * axis.choice.cutoff_hz * self.correlation_s;
        self.variance * (1.0 - turn.atan() / std::f64::consts::FRAC_PI_2)
    }
}

/// Each axis of a marker less its mean; NaN where it was not captured.
fn about_the_mean(still: &[Vec3]) -> Vec<Vec<f64>> {
    (0..3)
        .map(|k| {
            let known = || still.iter().map(|p| p[k]).filter(|v| !v.is_nan());
            let mean = known().sum::<f64>() / known().count().max(1) as f64;
            still.iter().map(|p| p[k] - mean).collect()
        })
        .collect()
}

/// Runs of `value`: first index and length.
fn runs(flags: &[bool], value: bool) -> Vec<(usize, usize)> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    for (i, &flag) in flags.iter().enumerate() {
        if flag != value {
            continue;
        }
        match out.last_mut() {
            Some((start, length)) if *start + *length == i => *length += 1,
            _ => out.push((i, 1)),
        }
    }
    out
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// The track of smoothed axes.
fn track_of(
    axes: &[SmoothedAxis; 3],
    step_s: f64,
    payload_kg: &[f64],
    initial: InitialState,
) -> Track {
    let row = |f: fn(&SmoothedAxis) -> &Vec<f64>| -> Vec<Vec3> {
        let [x, y, z] = [f(&axes[0]), f(&axes[1]), f(&axes[2])];
        (0..x.len()).map(|i| [x[i], y[i], z[i]]).collect()
    };
    Track {
        step_s,
        position_m: row(|a| &a.position),
        velocity_m_s: row(|a| &a.velocity),
        acceleration_m_s2: row(|a| &a.acceleration),
        payload_kg: payload_kg.to_vec(),
        initial,
    }
}

/// Samples masked after a gap that cannot be bridged, in lengths of the gap: what the bridged path is off has
/// then faded in branches that are as fast as the gap is long; slower ones felt little of it. What is left is
/// in the draws.
const AFTER_GAP: f64 = 0.5;
/// Left out on both sides of such a gap, s: derivatives there rest on one side, as at the ends of a
/// recording.
const BESIDE_GAP_S: f64 = 0.3;

/// Which samples can be used, which have a film of unknown history, the gaps that cannot be bridged, and a
/// note on each of them.
#[allow(clippy::type_complexity)]
fn bridged(
    observed: &[bool],
    axes: &[SmoothedAxis; 3],
    step_s: f64,
    notes: &mut Vec<String>,
) -> (Vec<bool>, Vec<bool>, Vec<(usize, usize)>) {
    let n = observed.len();
    let mut usable = observed.to_vec();
    let mut film_unknown = vec![false; n];
    let mut long = Vec::new();
    let limits = [0, 1, 2].map(|k| BRIDGE_LIMIT * median(&axes[k].position_sd));
    for (start, length) in runs(observed, false) {
        let after = start + length;
        let within = (start..after).all(|i| (0..3).all(|k| axes[k].position_sd[i] <= limits[k]));
        if within && start > 0 && after < n {
            usable[start..after].fill(true);
            continue;
        }
        long.push((start, length));
        let beside = (BESIDE_GAP_S / step_s).round() as usize;
        let settled = (after + beside.max((AFTER_GAP * length as f64).round() as usize)).min(n);
        film_unknown[start.saturating_sub(beside)..start].fill(true);
        film_unknown[after..settled].fill(true);
        notes.push(format!(
            "gap of {:.2} s ({length} frames from frame index {start}) is longer than the smoother can bridge: masked, with {:.2} s \
             before and {:.2} s after it; the film's \
             history in the gap is not known: the motion inside is taken to be what the same voltages made elsewhere, and what that leaves \
             open counts as noise",
            length as f64 * step_s,
            (start - start.saturating_sub(beside)) as f64 * step_s,
            (settled - after) as f64 * step_s
        ));
    }
    (usable, film_unknown, long)
}

/// Relative variance of the squared voltages up to which they count as one value: a thousandth of a volt in a
/// kilovolt.
const SAME: f64 = 1e-12;

/// The clock offset at which squared voltage and height agree best, to about a tenth of a second: where a fit
/// begins.
fn coarse_offset(height: &[f64], start_s: f64, step_s: f64, voltage: &Voltage) -> f64 {
    let stride = (0.05 / step_s).round().max(1.0) as usize;
    let step = stride as f64 * step_s;
    let down: Vec<f64> = height.iter().step_by(stride).map(|h| -h).collect();
    let n = down.len();
    let channels = voltage.channels_v().len();
    let (first, last) = voltage.span_s();
    let reach = (OFFSET_SEARCH_S / step) as i64;
    let mut best = (f64::NEG_INFINITY, 0.0);
    // The clocks may begin anywhere: lags are counted from the stated zero, and from equal beginnings.
    for base in [0.0, first - start_s] {
        let push: Vec<f64> = (-reach..n as i64 + reach)
            .map(|i| {
                let t = start_s + base + i as f64 * step;
                if t < first || t > last {
                    return f64::NAN;
                }
                (0..channels).map(|k| voltage.at(k, t).powi(2)).sum()
            })
            .collect();
        for lag in -reach..=reach {
            let pairs = || {
                down.iter().enumerate().filter_map(|(i, d)| {
                    let p = push[(i as i64 + lag + reach) as usize];
                    (!p.is_nan()).then_some((*d, p))
                })
            };
            let count = pairs().count();
            if count < n / 2 {
                continue;
            }
            let m = count as f64;
            let (mean_d, mean_p) = pairs().fold((0.0, 0.0), |s, (d, p)| (s.0 + d / m, s.1 + p / m));
            let (dd, pp, dp) = pairs().fold((0.0, 0.0, 0.0), |s, (d, p)| {
                let (d, p) = (d - mean_d, p - mean_p);
                (s.0 + d * d, s.1 + p * p, s.2 + d * p)
            });
            // a square that does not change tells no time, whatever rounding makes of it
            if pp <= SAME * m * mean_p * mean_p || dd <= 0.0 {
                continue;
            }
            let correlation = dp / (dd * pp).sqrt();
            if correlation > best.0 {
                best = (correlation, base + lag as f64 * step);
            }
        }
    }
    best.1
}
