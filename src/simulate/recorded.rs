//! The motion that the recorded voltages make, from rest.

use rayon::prelude::*;

use super::{Error, Hold, Options, Payload, Sampled, Start, motion_with_effects};
use crate::dataset::{Dataset, Voltage};
use crate::effects::{Acting, When};
use crate::film::InitialState;
use crate::model::{Parameters, Robot};

/// The motion that recorded voltages make, a row a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictedMotion {
    /// Position at each frame, m; NaN after the end of the prediction and where no voltage is known.
    pub position_m: Vec<[f64; 3]>,
    /// The first frame that is not reached, and why.
    pub ended: Option<(usize, String)>,
}

/// The commanded voltages on the motion clock.
fn command(voltage: &Voltage, offset_s: f64) -> Result<Sampled, String> {
    let times: Vec<f64> = voltage.time_s().iter().map(|t| t - offset_s).collect();
    let channels = voltage.channels_v();
    let samples = (0..times.len()).map(|i| [0, 1, 2].map(|k| channels[k][i]));
    let hold = match voltage.holds_previous() {
        true => Hold::Previous,
        false => Hold::Linear,
    };
    Sampled::from_log(&times, samples.collect(), hold)
}

/// Forward dynamics of the recorded voltages and payloads at every frame of `dataset`, read with the clock
/// offset `offset_s`: from rest under the first voltages; a virgin film from rest at the first measured
/// position.
///
/// # Errors
/// The motion does not begin: there is no rest under the first voltages and payload.
pub fn predict_motion(
    robot: &Robot,
    dataset: &Dataset,
    parameters: &Parameters,
    offset_s: f64,
    effects: &[Acting],
    when: When,
) -> Result<PredictedMotion, Error> {
    let tolerance_m = Options::default().tolerance_m;
    let mut motion = follow(
        robot,
        dataset,
        parameters,
        offset_s,
        (effects, when),
        tolerance_m,
    )?;
    for (i, u) in motion.position_m.iter_mut().enumerate() {
        if !dataset.has_voltage(i, offset_s) {
            *u = [f64::NAN; 3];
        }
    }
    Ok(motion)
}

/// [`predict_motion`] with steps as long as an error of so many metres allows; where no voltage is known it
/// holds its first or last value.
fn follow(
    robot: &Robot,
    dataset: &Dataset,
    parameters: &Parameters,
    offset_s: f64,
    (effects, when): (&[Acting], When),
    tolerance_m: f64,
) -> Result<PredictedMotion, Error> {
    let n = dataset.samples();
    let voltage = command(&dataset.voltage, offset_s).map_err(Error::Refused)?;
    let mass = &dataset.payload_kg;
    let steps = (1..n)
        .filter(|&i| mass[i] != mass[i - 1])
        .map(|i| (dataset.time_s(i), mass[i]))
        .collect();
    let start = match dataset.initial {
        InitialState::Relaxed => Start::Rest,
        InitialState::Virgin => Start::From {
            position_m: [0, 1, 2].map(|k| dataset.axes[k].position[0]),
            velocity_m_s: [0.0; 3],
            films: InitialState::Virgin,
        },
    };
    let options = Options {
        sample_step_s: dataset.step_s,
        start_s: dataset.start_s,
        duration_s: (n - 1) as f64 * dataset.step_s,
        tolerance_m,
        payload: Payload::steps(mass[0], steps).map_err(Error::Refused)?,
        start,
        ..Options::default()
    };
    let (motion, ended) = motion_with_effects(
        robot,
        parameters,
        &voltage,
        &options,
        effects,
        when,
        dataset.pivot_m,
    )?;
    let mut position_m = motion.position_m;
    let reached = position_m.len();
    position_m.resize(n, [f64::NAN; 3]);
    Ok(PredictedMotion {
        position_m,
        ended: ended.map(|why| (reached.min(n - 1), why.to_string())),
    })
}

/// Error that a step of a motion may make which is to be captured again, m: far below any capture's noise.
const BELOW_NOISE_M: f64 = 1e-7;

/// The motions that the voltages of a series of recordings make, m a frame, to be captured again; `None`
/// where one of them does not run to its end.
pub fn predict_motions(
    robot: &Robot,
    datasets: &[&Dataset],
    parameters: &Parameters,
    offset_s: &(dyn Fn(usize) -> f64 + Sync),
    effects: &[Acting],
    series: &[When],
) -> Option<Vec<Vec<[f64; 3]>>> {
    datasets
        .par_iter()
        .enumerate()
        .map(|(r, dataset)| {
            let motion = follow(
                robot,
                dataset,
                parameters,
                offset_s(r),
                (effects, series[r]),
                BELOW_NOISE_M,
            );
            let whole = motion.ok().filter(|m| m.ended.is_none());
            whole.map(|m| m.position_m)
        })
        .collect()
}
