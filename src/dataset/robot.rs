//! From a robot recording as the instruments wrote it to a dataset: SI, world axes, equidistant frames.

use std::borrow::Cow;

use nalgebra::{Rotation3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

use super::colour::{self, Filtered};
use super::spikes::spikes;
use super::{Clocks, Dataset, Error, Event, OffsetSource, Parts, Plan, SyncPlan, Voltage};
use crate::film::InitialState;
use crate::kinematics::Vec3;
use crate::recording::{
    FilmState, Manifest, MotionManifest, NumberOrEstimate, RawMotion, RawVoltage, Recording,
};

/// Seed of the noise that is put back where a filter took it.
const UNFILTERED: u64 = 0x0dea_f117;
/// Frames of which it is said that they were left out.
const SAID: usize = 8;
/// Frames whose stamp lies further from the grid than this share of a step are said to jitter.
const JITTER: f64 = 0.25;
/// Rates of a motion that can be worked with, Hz: the smoother's lowest half-power frequency (0.05 Hz) lies
/// within 0.4 of the lowest, and no capture reaches the highest.
const RATES_HZ: std::ops::RangeInclusive<f64> = 0.125..=1e6;
/// Largest voltage, V, and distance, m, that can be worked with: far beyond any amplifier and laboratory, and
/// their squares and fourth powers are still numbers.
const LARGEST_V: f64 = 1e9;
const LARGEST_M: f64 = 1e6;
/// Places of the grid a frame, beyond which one of its stamps is wrong: so many gaps no capture has.
const SPARSE: usize = 10;
const SPARSE_AND: usize = 100_000;

impl Dataset {
    /// A recording of a robot beside whose end effector the marker `still` was captured, in units of `unit`, m:
    /// it tells the colour of the noise, and what a filter took of it, which is put back.
    ///
    /// # Errors
    /// As [`Dataset::new`].
    pub fn beside(mut parts: Parts, still: &[Vec3], unit: f64) -> Result<Self, Error> {
        let mut still = Cow::Borrowed(still);
        unfiltered(&mut parts.measured_m, &mut still, unit, parts.step_s);
        let mut out = Dataset::new(parts, None)?;
        out.colour_from(&still);
        Ok(out)
    }

    /// Puts a recording of kind `robot` on one clock and into the world frame, in SI, and smooths its motion.
    ///
    /// The base marker's mean is taken as the position that the recording states; what the recording leaves
    /// to be estimated stays free. Nothing is dropped: a frame without a position stays as a gap.
    ///
    /// # Errors
    /// [`Error::Unsuitable`] for a recording of another kind, and those of [`Dataset::new`].
    pub fn from_recording(recording: &Recording, plan: Option<&Plan>) -> Result<Self, Error> {
        let mut notes = Vec::new();
        let (parts, still, found) = parts(recording, plan, &mut notes)?;
        let mut dataset = Dataset::new(parts, plan)?;
        if !still.is_empty() {
            dataset.colour_from(&still);
        }
        if let Some(c) = dataset.colour {
            notes.push(format!(
                "the capture's noise is not white: a slow part of {:.0} % of the white part's size, correlated over {:.0} ms",
                100.0 * c.variance.sqrt(),
                1e3 * c.correlation_s
            ));
        }
        if let Some(stated) = &recording.manifest.motion {
            dataset.pivot_m = [0, 1, 2]
                .map(|i| (stated.base_position_mm[i] - stated.end_effector_offset_mm[i]) * 1e-3);
        }
        if let Some((sync, _)) = found {
            dataset.offset_source = OffsetSource::Measured;
            dataset.plan.sync = Some(sync);
        }
        dataset.notes.splice(0..0, notes);
        Ok(dataset)
    }
}

impl Parts {
    /// A recording of kind `robot` on one clock and in the world frame, in SI, with nothing smoothed: what
    /// there is to see of it at once. An offset that is left to be estimated is `None`.
    ///
    /// # Errors
    /// [`Error::Unsuitable`] for a recording of another kind, or with a number that cannot be.
    pub fn from_recording(recording: &Recording) -> Result<Self, Error> {
        Ok(parts(recording, None, &mut Vec::new())?.0)
    }
}

/// What a dataset is made of, the base marker where it tells of the noise, and the clocks where events, a
/// shared channel or a plan tell them.
type Aligned<'m> = (Parts, Cow<'m, [Vec3]>, Option<(SyncPlan, Clocks)>);

fn parts<'m>(
    recording: &'m Recording,
    plan: Option<&Plan>,
    notes: &mut Vec<String>,
) -> Result<Aligned<'m>, Error> {
    let manifest = &recording.manifest;
    let unsuitable = |what: String| Error::Unsuitable {
        id: manifest.id.clone(),
        what,
    };
    let (motion, voltage, stated) = of_robot(recording).map_err(unsuitable)?;
    let world = world_frame(motion, stated, notes);
    let (start_s, step_s, seen) = grid(motion, notes).map_err(unsuitable)?;
    let mut measured_m: Vec<Vec3> = seen.into_iter().map(|p| world(&p)).collect();
    possible_m(&measured_m, start_s, step_s).map_err(unsuitable)?;
    notes.extend(without_spikes(&mut measured_m, start_s, step_s));
    let still = still_marker(motion, step_s, &mut measured_m, notes);
    let payload_g = |i: usize| manifest.payload.mass_g(start_s + step_s * i as f64);
    let mut parts = Parts {
        id: manifest.id.clone(),
        step_s,
        start_s,
        payload_kg: (0..measured_m.len()).map(|i| payload_g(i) * 1e-3).collect(),
        measured_m,
        initial: initial(manifest, notes),
        monitor: monitor(recording, notes).map_err(unsuitable)?,
        voltage: command(voltage, notes).map_err(unsuitable)?,
        offset_s: match manifest.offset_s {
            NumberOrEstimate::Number(stated) => Some(stated),
            NumberOrEstimate::Estimate => None,
        },
    };
    notes.extend(signs(&parts.voltage));
    // a plan says what was found before; else events or a shared channel may tell
    let found = match plan {
        Some(plan) => planned(plan),
        None => clocks(recording, &parts, notes).map_err(unsuitable)?,
    };
    if let Some((_, clocks)) = &found {
        parts.offset_s = Some(clocks.offset_s);
        parts.voltage = clocks.without_skew(&parts.voltage);
        parts.monitor = parts.monitor.as_ref().map(|m| clocks.without_skew(m));
    }
    Ok((parts, still, found))
}

/// Motion and voltage of a robot, and what the manifest says of the motion.
fn of_robot(recording: &Recording) -> Result<(&RawMotion, &RawVoltage, &MotionManifest), String> {
    let manifest = &recording.manifest;
    let (Some(motion), Some(voltage), Some(stated)) =
        (&recording.motion, &recording.voltage, &manifest.motion)
    else {
        return Err(format!(
            "kind \"{}\" has no robot motion and voltage",
            manifest.kind.name()
        ));
    };
    match voltage.channels.len() {
        3 => Ok((motion, voltage, stated)),
        n => Err(format!("{n} voltage channels, a robot has 3")),
    }
}

/// Leaves the frames empty in which the marker sticks out of its path, and says which.
pub(super) fn without_spikes(measured_m: &mut [Vec3], start_s: f64, step_s: f64) -> Option<String> {
    let spikes = spikes(measured_m);
    spikes.iter().for_each(|&i| measured_m[i] = [f64::NAN; 3]);
    let at = |i: &usize| format!("{:.2}", start_s + step_s * *i as f64);
    let first: Vec<String> = spikes.iter().take(SAID).map(at).collect();
    let more = if spikes.len() > SAID { ", ..." } else { "" };
    (!spikes.is_empty()).then(|| {
        format!(
            "{} frames in which the marker sticks out of its path are left out, as if they had not been captured: at {}{more} s",
            spikes.len(),
            first.join(", ")
        )
    })
}

/// The base marker, where it tells of the noise. What a filter took of that before the export is put back,
/// there and in `measured_m`.
fn still_marker<'m>(
    motion: &'m RawMotion,
    step_s: f64,
    measured_m: &mut [Vec3],
    notes: &mut Vec<String>,
) -> Cow<'m, [Vec3]> {
    // a base marker on a clock of its own says nothing of the noise at these frames
    let base = motion
        .base
        .as_ref()
        .filter(|b| b.xyz.len() == motion.end_effector.xyz.len());
    let mut still = base.map_or_else(Cow::default, |b| Cow::Borrowed(&b.xyz[..]));
    let unit = motion.unit.to_si;
    let Some(filter) = unfiltered(measured_m, &mut still, unit, step_s) else {
        return still;
    };
    notes.push(format!(
        "the capture was filtered before it was exported, at about {:.0} Hz: its noise ends there. White noise of {:.3} mm is put back above, so that weights and floors are right; export it unfiltered",
        filter.corner_hz,
        1e3 * unit * filter.noise
    ));
    still
}

/// Puts back what a filter took of the noise before the export, in positions, m, and in the marker `still`,
/// in units of `unit`, m, which tells of it: nothing of the motion is above the corner that the filter left,
/// but what it took of the noise would be missed by every weight. `None` where there was no filter.
fn unfiltered(
    measured_m: &mut [Vec3],
    still: &mut Cow<[Vec3]>,
    unit: f64,
    step_s: f64,
) -> Option<Filtered> {
    let filter = colour::filtered(&super::about_the_mean(still), step_s)?;
    let mut generator = ChaCha12Rng::seed_from_u64(UNFILTERED);
    let frames = measured_m.len();
    for k in 0..3 {
        let mut missing = || filter.missing(frames, step_s, &mut generator);
        for (m, n) in measured_m.iter_mut().zip(missing()) {
            m[k] += unit * n;
        }
        for (b, n) in still.to_mut().iter_mut().zip(missing()) {
            b[k] += n;
        }
    }
    Some(filter)
}

/// State of the film at the first frame.
fn initial(manifest: &Manifest, notes: &mut Vec<String>) -> InitialState {
    match manifest.film_state {
        Some(FilmState::Virgin) => InitialState::Virgin,
        Some(FilmState::Relaxed) => InitialState::Relaxed,
        None => {
            notes.push(
                "film_state is not stated: every branch is taken as relaxed at the first frame"
                    .into(),
            );
            InitialState::Relaxed
        }
    }
}

/// The amplifier's own measurement, where all three channels have one.
fn monitor(recording: &Recording, notes: &mut Vec<String>) -> Result<Option<Voltage>, String> {
    let Some(m) = recording.monitor.as_ref().filter(|m| m.channels.len() == 3) else {
        return Ok(None);
    };
    let scale = m.unit.to_si * m.scale.unwrap_or(1.0);
    volts(&m.time_s, &m.channels, scale, false, "monitor", notes)
}

/// The commanded voltage.
fn command(v: &RawVoltage, notes: &mut Vec<String>) -> Result<Voltage, String> {
    let scale = v.unit.to_si * v.scale.unwrap_or(1.0);
    let hold = v.hold_previous;
    volts(&v.time_s, &v.channels, scale, hold, "voltage", notes)?
        .ok_or_else(|| "no voltage sample has all three channels".into())
}

/// The clocks as a plan has them.
fn planned(plan: &Plan) -> Option<(SyncPlan, Clocks)> {
    let (sync, offset_s) = plan.sync.clone().zip(plan.offset_s)?;
    let clocks = Clocks {
        offset_s,
        offset_std_error_s: sync.offset_std_error_s,
        skew: sync.skew_ppm * 1e-6,
        skew_std_error: sync.skew_std_error_ppm.map(|e| e * 1e-6),
        middle_s: sync.middle_s,
        events: 0,
        quantile: f64::NAN,
    };
    Some((sync, clocks))
}

/// Offset and skew from events or a shared channel, where the recording has them.
fn clocks(
    recording: &Recording,
    parts: &Parts,
    notes: &mut Vec<String>,
) -> Result<Option<(SyncPlan, Clocks)>, String> {
    let events: Vec<Event> = recording
        .manifest
        .events
        .iter()
        .map(|[motion_s, voltage_s]| Event {
            motion_s: *motion_s,
            voltage_s: *voltage_s,
            std_error_s: None,
        })
        .collect();
    let shared = recording.motion.as_ref().and_then(|m| m.shared.as_ref());
    let (method, found) = match shared {
        _ if !events.is_empty() => ("events", Clocks::from_events(&events)),
        Some(s) => {
            let found = Clocks::from_shared(&s.time_s, &s.values, &parts.voltage, s.chain);
            if found.is_none() {
                return Err(format!(
                    "channel {} resembles the voltage of chain {} nowhere within {} s: check [sync] shared and chain",
                    s.label,
                    s.chain + 1,
                    super::OFFSET_SEARCH_S
                ));
            }
            ("shared channel", found)
        }
        None => return Ok(None),
    };
    let Some(clocks) = found else { return Ok(None) };
    if clocks.skew != 0.0 {
        notes.push(format!(
            "the voltage clock runs {:.1} ppm faster than the motion clock: its times are put right",
            clocks.skew * 1e6
        ));
    }
    Ok(Some((SyncPlan::of(method, &clocks), clocks)))
}

/// From captured positions to metres in the frame of the rig: the base marker's mean is where the recording
/// states it to be.
pub(super) fn world_frame(
    motion: &RawMotion,
    stated: &MotionManifest,
    notes: &mut Vec<String>,
) -> impl (Fn(&Vec3) -> Vec3) + use<> {
    let base = match &motion.base {
        Some(marker) => mean(&marker.xyz),
        None => {
            notes.push(
                "no base marker: the capture's origin is taken as the base's position".into(),
            );
            [0.0; 3]
        }
    };
    let [a, b, c] = stated.rotation_deg.map(f64::to_radians);
    let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), a)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), c);
    let si = motion.unit.to_si;
    let (from, to) = (stated.base_position_mm, stated.end_effector_offset_mm);
    move |p| {
        let v = rotation * (Vector3::from(*p) - Vector3::from(base)) * si;
        [0, 1, 2].map(|i| v[i] + (from[i] - to[i]) * 1e-3)
    }
}

fn mean(xyz: &[Vec3]) -> Vec3 {
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for p in xyz.iter().filter(|p| p.iter().all(|v| !v.is_nan())) {
        for i in 0..3 {
            sum[i] += p[i];
        }
        count += 1.0;
    }
    sum.map(|s| s / count)
}

/// Positions that a laboratory can have, else where there is one that it cannot.
pub(super) fn possible_m(measured_m: &[Vec3], start_s: f64, step_s: f64) -> Result<(), String> {
    let beyond = |p: &Vec3| p.iter().any(|v| v.is_infinite() || v.abs() > LARGEST_M);
    match measured_m.iter().position(beyond) {
        None => Ok(()),
        Some(i) => Err(format!(
            "the position at {:.3} s is {:?} m, and nothing beyond {LARGEST_M:.0e} m can be worked with: check the motion's unit, or mark \
             the frame as missing by empty cells",
            start_s + step_s * i as f64,
            measured_m[i]
        )),
    }
}

/// Share of the largest voltage within which a reading counts as 0 V.
const NEAR_ZERO: f64 = 0.02;

fn largest(channel: &[f64]) -> f64 {
    channel.iter().fold(0.0, |m, v| m.max(v.abs()))
}

/// What to say of commands below 0 V: the film feels their squares.
pub(super) fn signs(voltage: &Voltage) -> Option<String> {
    let list = |of: fn(&[f64]) -> bool| -> Vec<String> {
        (voltage.channels_v().iter().enumerate())
            .filter(|(_, c)| of(c))
            .map(|(k, _)| (k + 1).to_string())
            .collect()
    };
    // below what a reading near 0 V may be off
    let below = list(|c| {
        let floor = NEAR_ZERO * largest(c);
        c.iter().any(|v| *v < -floor) && c.iter().all(|v| *v <= floor)
    });
    let both = list(|c| {
        let floor = NEAR_ZERO * largest(c);
        c.iter().any(|v| *v < -floor) && c.iter().any(|v| *v > floor)
    });
    let mut parts = Vec::new();
    if !below.is_empty() {
        parts.push(format!("channel {} is negative", below.join(", ")));
    }
    if !both.is_empty() {
        parts.push(format!("channel {} changes its sign", both.join(", ")));
    }
    (!parts.is_empty()).then(|| {
        format!(
            "voltage {}: the film feels the square, so errors in volts are of sizes",
            parts.join(", ")
        )
    })
}

/// Equidistant frames: each position on the grid point nearest to its stamp.
///
/// # Errors
/// A rate that no capture has, and a stamp so far off that nearly all of the grid would be empty.
pub(super) fn grid(
    motion: &RawMotion,
    notes: &mut Vec<String>,
) -> Result<(f64, f64, Vec<Vec3>), String> {
    if !RATES_HZ.contains(&motion.rate_hz) {
        return Err(format!(
            "the motion's rate is {} Hz, and rates from {} to {:e} Hz can be worked with: check rate_hz, or the unit of its time",
            motion.rate_hz,
            RATES_HZ.start(),
            RATES_HZ.end()
        ));
    }
    let step = 1.0 / motion.rate_hz;
    let times = &motion.time_s;
    let start = times.first().copied().unwrap_or(0.0);
    let place = |t: f64| ((t - start) / step).round().max(0.0) as usize;
    let count = times.last().map_or(0, |t| place(*t) + 1);
    // Stamps that are the grid, as those of a capture with frame numbers are.
    let off = |i: usize| (times[i] - start - i as f64 * step).abs();
    if count == times.len() && (0..count).all(|i| off(i) < 0.01 * step) {
        return Ok((start, step, motion.end_effector.xyz.clone()));
    }
    let most = times
        .len()
        .saturating_mul(SPARSE)
        .saturating_add(SPARSE_AND);
    if let Some(i) = (0..times.len()).find(|&i| place(times[i]) >= most) {
        return Err(format!(
            "frame {} is stamped {} s, {:.3e} steps of {step} s after the first: {} frames would be missing; correct its time, or the \
             unit of time",
            i + 1,
            times[i],
            (times[i] - start) / step,
            place(times[i]) - i
        ));
    }
    let mut out = vec![[f64::NAN; 3]; count];
    let (mut jittered, mut lost) = (0, 0);
    for (t, p) in times.iter().zip(&motion.end_effector.xyz) {
        let i = place(*t);
        jittered += usize::from(((t - start) / step - i as f64).abs() > JITTER);
        lost += usize::from(!out[i][0].is_nan());
        out[i] = *p;
    }
    if jittered > 0 || lost > 0 {
        notes.push(format!(
            "the stamps of {jittered} of {} frames lie off the {:.3} Hz grid by more than {:.0} % of a step, {lost} fell on a taken place",
            times.len(),
            motion.rate_hz,
            100.0 * JITTER
        ));
    }
    Ok((start, step, out))
}

/// Volts of the samples in which every channel has a value; `None` when there is none.
///
/// # Errors
/// A voltage that nothing can make, with its place.
pub(super) fn volts(
    time_s: &[f64],
    channels: &[Vec<f64>],
    scale: f64,
    hold: bool,
    what: &str,
    notes: &mut Vec<String>,
) -> Result<Option<Voltage>, String> {
    for (k, channel) in channels.iter().enumerate() {
        let beyond = |v: &f64| (v * scale).is_infinite() || (v * scale).abs() > LARGEST_V;
        if let Some(i) = channel.iter().position(beyond) {
            return Err(format!(
                "the {what} of channel {} at {} s is {:e} V, and nothing beyond {LARGEST_V:.0e} V can be worked with: check its unit and \
                 scale, or empty the cell",
                k + 1,
                time_s[i],
                channel[i] * scale
            ));
        }
    }
    let whole: Vec<bool> = (0..time_s.len())
        .map(|i| channels.iter().all(|c| !c[i].is_nan()))
        .collect();
    let missing = whole.iter().filter(|w| !**w).count();
    if missing == time_s.len() {
        return Ok(None);
    }
    if missing > 0 {
        notes.push(format!(
            "{missing} of {} {what} samples lack a channel and are bridged",
            time_s.len()
        ));
    }
    let keep = |v: &[f64], scale: f64| -> Vec<f64> {
        v.iter()
            .zip(&whole)
            .filter(|(_, w)| **w)
            .map(|(v, _)| v * scale)
            .collect()
    };
    let values = channels.iter().map(|c| keep(c, scale)).collect();
    Ok(Some(Voltage::new(keep(time_s, 1.0), values, hold)))
}
