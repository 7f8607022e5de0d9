//! The motion that the recorded voltages make, from rest.

use super::Error;
use crate::dataset::{Dataset, Voltage};
use crate::effects::{Acting, When};
use crate::film::InitialState;
use crate::model::{Parameters, Robot};
use crate::simulate::{self, Hold, Options, Payload, Sampled, Start, motion_with_effects};

/// A predicted motion, a row a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Forward {
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

/// Forward dynamics of the recorded voltages and payloads at every frame of `dataset`, read with the clock offset `offset_s`: from
/// rest under the first voltages; a virgin film from rest at the first measured position.
///
/// # Errors
/// [`Error::Forward`] when the motion does not begin: there is no rest under the first voltages and payload.
pub fn predict_motion(
    robot: &Robot,
    dataset: &Dataset,
    parameters: &Parameters,
    offset_s: f64,
    effects: &[Acting],
    when: When,
) -> Result<Forward, Error> {
    let refuse = |why| Error::Forward {
        recording: dataset.id.clone(),
        why,
    };
    let text = |why| refuse(simulate::Error::Refused(why));
    let n = dataset.samples();
    let voltage = command(&dataset.voltage, offset_s).map_err(text)?;
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
        payload: Payload::steps(mass[0], steps).map_err(text)?,
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
    )
    .map_err(refuse)?;
    let mut position_m = motion.position_m;
    let reached = position_m.len();
    position_m.resize(n, [f64::NAN; 3]);
    for (i, u) in position_m.iter_mut().enumerate() {
        if !dataset.has_voltage(i, offset_s) {
            *u = [f64::NAN; 3];
        }
    }
    Ok(Forward {
        position_m,
        ended: ended.map(|why| (reached.min(n - 1), why.to_string())),
    })
}
