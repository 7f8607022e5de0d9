//! The sealed answer of a case.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// What is true of a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Truth {
    /// Name of the case.
    pub case: String,
    /// axis, bench or coupon; nothing: a robot.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub rig: String,
    /// Effects at work; empty: none; `unknown`: in no catalogue.
    pub effects: Vec<String>,
    /// adequate, missing_physics or unexplained.
    pub verdict: String,
    /// Per effect.
    pub detail: Vec<Detail>,
    /// What everything was drawn from.
    pub seed: u64,
    /// Plain refit over floor, train, above 1 kV; known once a prover has refitted.
    pub detectability: Option<f64>,
    /// Film and forearm without any effect.
    pub film: FilmTruth,
    /// The recordings in their order.
    pub recordings: Vec<RecordingTruth>,
    /// Voltage errors with their floors; known once a prover has refitted.
    pub rmse: Option<BTreeMap<String, f64>>,
    /// Meaning of the clocks.
    pub clock: String,
    /// What else is not as the model has it, and is no cause: film, capture, size.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub bench: BTreeMap<String, Value>,
}

/// One effect of a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Detail {
    /// Id, or for an effect in no catalogue a name that begins with `x_`.
    pub effect: String,
    /// 0 barely visible to 1 strong.
    pub strength: f64,
    /// Actuators, 1 to 3.
    pub actuators: Vec<usize>,
    /// Names and units of parameter files; the equivalent value where the simulated form is richer.
    pub parameters: BTreeMap<String, Value>,
    /// Numbers of the simulated form.
    pub form: BTreeMap<String, Value>,
    /// Where it shows.
    #[serde(rename = "where")]
    pub place: Vec<Value>,
}

/// Film and forearm.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[allow(non_snake_case)]
pub struct FilmTruth {
    /// Moduli, Pa.
    pub mu_Pa: Vec<f64>,
    /// Relaxation times, s.
    pub T_s: Vec<f64>,
    /// Locking constant.
    pub J: f64,
    /// Nodes of the torque curve, deg.
    pub forearm_nodes_deg: Vec<f64>,
    /// Nodal torques, N m.
    pub forearm_torque_Nm: Vec<f64>,
}

/// One recording of a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RecordingTruth {
    /// "01-symmetric".
    pub name: String,
    /// "train" or "holdout".
    pub set: String,
    /// Stated payload at the first sample, g.
    pub payload_g: f64,
    /// Time since the series began, s.
    pub series_start_s: f64,
    /// Lowest and highest height of the end effector, mm.
    pub z_mm: [f64; 2],
}
