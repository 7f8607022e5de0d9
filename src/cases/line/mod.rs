//! Concealed cases on single coordinates: axes, hinge benches and film coupons with a cause that is known
//! here and nowhere else. Forms, integrator
//! and noise are own; nothing is shared with what has to find it.
//!
//! | what | where |
//! |---|---|
//! | which cases a proof consists of | [`plan`] |
//! | one case from its [`LineSpec`], a function of the seed | [`generate`] |
//! | its files | [`LineCase::files`] |

mod axis;
mod bench;
mod coupon;
mod forms;
mod mechanism;
mod noise;
mod path;
mod unknown;
mod visible;
mod write;

use serde::Serialize;

use super::dice::Dice;
use super::truth::{Detail, RecordingTruth, Truth};
use super::{Kind, folder_name};
use crate::recording::Recording;
pub use path::MOTIONS;
use visible::{Balance, detectability};
use write::{Columns, Text};

/// What was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rig {
    /// One drive, one coordinate.
    Axis,
    /// Angle and torque of a flexure.
    Bench,
    /// Stretch and stress of a film.
    Coupon,
}

impl Rig {
    /// Every kind.
    pub const ALL: [Rig; 3] = [Rig::Axis, Rig::Bench, Rig::Coupon];

    /// axis, bench, coupon.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Rig::Axis => "axis",
            Rig::Bench => "bench",
            Rig::Coupon => "coupon",
        }
    }
}

/// What a case is made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LineSpec {
    /// What is recorded.
    pub rig: Rig,
    /// What is left out; no pairs.
    pub kind: Kind,
    /// Everything random follows from it.
    pub seed: u64,
    /// 0 barely visible to 1 strong.
    pub strength: f64,
}

/// A recording before it has a name.
struct LineRecording {
    kind: &'static str,
    columns: Columns,
}

/// What a rig made.
struct Made {
    text: Text,
    recordings: Vec<LineRecording>,
    balances: Vec<Balance>,
    detail: Option<Detail>,
}

/// One recording of a case.
#[derive(Debug, Clone)]
pub struct LineCaseRecording {
    /// `<case>/01-chirp`.
    pub id: String,
    /// What opening its files gives.
    pub recording: Recording,
    files: write::Files,
}

/// A case.
#[derive(Debug, Clone)]
pub struct LineCase {
    /// Its name.
    pub name: String,
    /// To train on.
    pub train: Vec<LineCaseRecording>,
    /// Held out; may be empty.
    pub holdout: Vec<LineCaseRecording>,
    /// The answer.
    pub truth: Truth,
}

impl LineCase {
    /// All files of the case, with paths relative to the folder of cases; the answer is not among them.
    pub fn files(&self) -> Vec<(String, &[u8])> {
        let mut out = Vec::new();
        for (set, list) in [("train", &self.train), ("holdout", &self.holdout)] {
            for recording in list {
                let own = recording.id.rsplit('/').next().unwrap_or(&recording.id);
                for (file, bytes) in &recording.files {
                    let path = format!("{}/{set}/{own}/{file}", self.name);
                    out.push((path, bytes.as_slice()));
                }
            }
        }
        out
    }

    /// Name of the answer's file in the folder of answers.
    pub fn answer_file(&self) -> String {
        format!("{}.json", self.name)
    }
}

/// Ids of the catalogued causes that can be made on a rig.
pub fn effects(rig: Rig) -> Vec<&'static str> {
    match rig {
        Rig::Axis => axis::EFFECTS.iter().map(|e| e.0).collect(),
        Rig::Bench => bench::EFFECTS.iter().map(|e| e.0).collect(),
        Rig::Coupon => coupon::EFFECTS.iter().map(|e| e.0).collect(),
    }
}

/// Names of the causes that are in no catalogue.
pub fn unknowns(rig: Rig) -> Vec<&'static str> {
    match rig {
        Rig::Axis => axis::UNKNOWN.iter().map(|e| e.0).collect(),
        Rig::Bench => bench::UNKNOWN.iter().map(|e| e.0).collect(),
        Rig::Coupon => coupon::UNKNOWN.iter().map(|e| e.0).collect(),
    }
}

/// Share of the strength, where the rig does not bear it; the answer has the strength that was simulated.
const WEAKER: [f64; 6] = [1.0, 0.8, 0.6, 0.4, 0.2, 0.0];

/// Makes a case, in memory: a function of `spec` alone.
///
/// # Errors
/// A sentence when the cause is unknown, or drives the rig out of its stroke at every strength.
pub fn generate(spec: &LineSpec) -> Result<LineCase, String> {
    generate_by(spec, 1)
}

/// The same case with steps of the integration this many times as long: what tells whether they are short
/// enough.
///
/// # Errors
/// As [`generate`].
pub fn generate_by(spec: &LineSpec, stride: usize) -> Result<LineCase, String> {
    let (id, known) = match spec.kind {
        Kind::Clean => (None, true),
        Kind::Effect(id) => (Some(id), true),
        Kind::Unknown(id) => (Some(id), false),
        Kind::Pair(..) => return Err("single coordinates have no pairs".into()),
    };
    let missing = |id: &str| format!("no cause `{id}` can be made on this rig");
    let moved = |known_list: &'static [(&str, axis::Maker, axis::Needs)],
                 unknown_list: &'static [(&str, axis::Maker, axis::Needs)]| {
        let list = if known { known_list } else { unknown_list };
        id.map(|id| {
            let found = list.iter().find(|e| e.0 == id);
            found.map(|e| (e.1, e.2)).ok_or_else(|| missing(id))
        })
        .transpose()
    };
    let make = |strength: f64| -> Result<Made, String> {
        match spec.rig {
            Rig::Axis => {
                let cause = moved(axis::EFFECTS, axis::UNKNOWN)?;
                axis::make(spec.seed, strength, cause, stride)
            }
            Rig::Bench => {
                let cause = moved(bench::EFFECTS, bench::UNKNOWN)?;
                bench::make(spec.seed, strength, cause, stride)
            }
            Rig::Coupon => {
                let list = if known {
                    coupon::EFFECTS
                } else {
                    coupon::UNKNOWN
                };
                let find = |id| list.iter().find(|e| e.0 == id).map(|e| e.1);
                let cause = id
                    .map(|id| find(id).ok_or_else(|| missing(id)))
                    .transpose()?;
                coupon::make(spec.seed, strength, cause, stride)
            }
        }
    };
    let mut last = String::new();
    for weaker in WEAKER {
        match make(spec.strength * weaker) {
            Ok(made) => return case(spec, made),
            Err(why) => last = why,
        }
    }
    Err(format!(
        "{} ({:?}): {last}",
        folder_name(spec.seed),
        spec.kind
    ))
}

fn case(spec: &LineSpec, made: Made) -> Result<LineCase, String> {
    let name = folder_name(spec.seed);
    let mut dice = Dice::new(spec.seed, 3);
    let count = made.recordings.len();
    // one is held out where there are several, as most would do
    let held = usize::from(count > 1 && dice.chance(0.7));
    let (mut train, mut holdout, mut recordings) = (Vec::new(), Vec::new(), Vec::new());
    for (i, r) in made.recordings.iter().enumerate() {
        let own = format!("{:02}-{}", i + 1, r.kind);
        let id = format!("{name}/{own}");
        let (files, recording) = write::write(&id, &made.text, &r.columns)?;
        let trains = i + held < count;
        recordings.push(RecordingTruth {
            name: own,
            set: if trains { "train" } else { "holdout" }.into(),
            ..RecordingTruth::default()
        });
        let made = LineCaseRecording {
            id,
            recording,
            files,
        };
        if trains {
            train.push(made);
        } else {
            holdout.push(made);
        }
    }
    let (ids, verdict): (Vec<String>, &str) = match spec.kind {
        Kind::Effect(id) => (vec![id.into()], "missing_physics"),
        Kind::Unknown(_) => (vec!["unknown".into()], "unexplained"),
        Kind::Clean | Kind::Pair(..) => (Vec::new(), "adequate"),
    };
    Ok(LineCase {
        train,
        holdout,
        truth: Truth {
            case: name.clone(),
            rig: spec.rig.name().into(),
            effects: ids,
            verdict: verdict.into(),
            detail: made.detail.into_iter().collect(),
            seed: spec.seed,
            detectability: Some(detectability(&made.balances)),
            recordings,
            clock: "input clock minus motion clock, s; stated as 0".into(),
            ..Truth::default()
        },
        name,
    })
}

/// `n_total` cases on these rigs by turns: ten in 23 clean, ten with one cause (each as often as the others,
/// strengths spread evenly over 0
/// to 1), three in no catalogue; in random order.
pub fn plan(rigs: &[Rig], n_total: usize, seed: u64) -> Vec<LineSpec> {
    let mut dice = Dice::new(seed, 0);
    let unknown = (3 * n_total + 11) / 23;
    let clean = (n_total - unknown) / 2;
    let single = n_total - unknown - clean;
    let mut kinds: Vec<(Rig, Kind, f64)> = Vec::new();
    for (r, rig) in rigs.iter().enumerate() {
        let share = |total: usize| (total + rigs.len() - 1 - r) / rigs.len();
        for _ in 0..share(clean) {
            kinds.push((*rig, Kind::Clean, dice.unit()));
        }
        for (list, total, known) in [
            (effects(*rig), share(single), true),
            (unknowns(*rig), share(unknown), false),
        ] {
            let mut order: Vec<usize> = (0..list.len()).collect();
            dice.shuffle(&mut order);
            let times = total.div_ceil(list.len()).max(1) as f64;
            // each cause has its own share of each stretch of strengths
            for i in 0..total {
                let id = list[order[i % list.len()]];
                let kind = if known {
                    Kind::Effect(id)
                } else {
                    Kind::Unknown(id)
                };
                let strength = ((i / list.len()) as f64 + dice.unit()) / times;
                kinds.push((*rig, kind, strength.min(1.0)));
            }
        }
    }
    dice.shuffle(&mut kinds);
    kinds
        .into_iter()
        .map(|(rig, kind, strength)| LineSpec {
            rig,
            kind,
            seed: dice.seed(),
            strength,
        })
        .collect()
}
