//! What conceals a case: how little a plain refit leaves, at the price of which wrong moduli; and which
//! effects its recordings cannot tell from the true one. All of it from the answer: nothing here is seen by
//! the diagnosis.

use serde::{Deserialize, Serialize};

use super::own_form::acting;
use crate::cases::Truth;
use crate::diagnosis::{Diagnosis, Entry, alike_at};
use crate::effects::Acting;
use crate::film::Film;
use crate::model::{ForearmTorque, Parameters, Robot};

/// What the plain refit makes of a case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Concealment {
    /// What it leaves above 1 kV over the noise floor there, on the recordings that were fitted.
    pub residual_over_floor: f64,
    /// The same on the held-out ones.
    pub held_out_over_floor: f64,
    /// Film parameters over the true ones less 1, those that moved furthest first: `mu_1`, ..., `T_1`, ...,
    /// `J`.
    pub moved: Vec<(String, f64)>,
}

impl Concealment {
    /// Compares a plain refit with the true film.
    pub fn new(truth: &Truth, d: &Diagnosis) -> Self {
        let film = &d.plain.film;
        let mut moved = Vec::new();
        let mut compare = |name: &str, own: &[f64], truth: &[f64]| {
            for (i, (a, b)) in own.iter().zip(truth).enumerate() {
                if *b > 0.0 && own.len() == truth.len() {
                    moved.push((format!("{name}_{}", i + 1), a / b - 1.0));
                }
            }
        };
        compare("mu", &film.mu_pa, &truth.film.mu_Pa);
        compare("T", &film.relaxation_time_s, &truth.film.T_s);
        if truth.film.J > 0.0 {
            moved.push(("J".into(), film.locking / truth.film.J - 1.0));
        }
        // Twice as much and half as much are equally far.
        moved.sort_by(|a, b| {
            let far = |m: f64| (1.0 + m).max(1e-3).ln().abs();
            far(b.1).total_cmp(&far(a.1))
        });
        let over = |g: &crate::diagnosis::Gain| g.before_v / g.noise_floor_v;
        Concealment {
            residual_over_floor: over(&d.train),
            held_out_over_floor: d.holdout.as_ref().map_or(f64::NAN, over),
            moved,
        }
    }
}

/// The true film and forearm, where the answer has them.
fn parameters(truth: &Truth) -> Option<Parameters> {
    let f = &truth.film;
    if f.mu_Pa.len() != f.T_s.len() + 1 || f.forearm_nodes_deg.is_empty() {
        return None;
    }
    let nodes = f.forearm_nodes_deg.iter().map(|d| d.to_radians()).collect();
    Some(Parameters {
        film: Film {
            mu_pa: f.mu_Pa.clone(),
            relaxation_time_s: f.T_s.clone(),
            locking: f.J,
        },
        forearm: ForearmTorque::new(nodes, f.forearm_torque_Nm.clone()).ok()?,
    })
}

/// How an effect of a case stands out at the truth, beside the others of the case.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct StandsOut {
    /// Ids that the recordings cannot tell from it, with the cosine of the projected fingerprints.
    pub alike: Vec<(String, f64)>,
    /// Weighted mean square beyond noise that a refit without it would leave.
    pub excess: f64,
}

/// How each effect of a case stands out; nothing where the catalogue does not have them.
pub fn stands_out(truth: &Truth, robot: &Robot, entries: &[Entry]) -> Vec<StandsOut> {
    let recording = |word: &str| {
        let name = |id: &str| id.rsplit('/').next() == word.rsplit('/').next();
        entries.iter().position(|e| name(&e.dataset.id))
    };
    let all: Option<Vec<Acting>> = truth
        .effects
        .iter()
        .zip(&truth.detail)
        .map(|(id, detail)| acting(id, detail, &recording))
        .collect();
    let (Some(parameters), Some(all)) = (parameters(truth), all) else {
        return Vec::new();
    };
    let own = |i: usize| {
        let mut beside = all.clone();
        let acting = beside.remove(i);
        alike_at(robot, entries, &parameters, &acting, &beside)
            .map(|l| StandsOut {
                alike: l.alike.iter().map(|a| (a.0.to_string(), a.1)).collect(),
                excess: l.excess,
            })
            .unwrap_or_default()
    };
    (0..all.len()).map(own).collect()
}
