//! Concealed cases: robots with a left-out cause that is known here and nowhere else, as recordings and a
//! sealed answer. The forms differ from those that a diagnosis has, and nothing here is shared with it.
//!
//! | what | where |
//! |---|---|
//! | which cases a proof consists of | [`plan`] |
//! | one case from its [`Spec`], a function of the seed | [`generate`] |
//! | what is true of it | [`Truth`] |
//! | its files | [`Case::files`] |

mod bench;
mod dice;
mod drives;
mod effect;
mod electrical;
mod film;
mod joints;
pub mod line;
mod measurement;
mod truth;
mod unknown;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

pub use truth::{Detail, FilmTruth, RecordingTruth, Truth};

use crate::dataset::{Parts, Voltage};
use crate::film::{Film, InitialState};
use crate::kinematics::Vec3;
use crate::model::{ForearmTorque, Parameters, Robot};
use crate::recording::{Rig, RobotRig};
use crate::simulate::write::{Capture, Noise, Placement, RecordingText, VoltageLog};
use crate::simulate::{Addition, Motion, Options, Payload, Sampled, motion, rest, write};
pub use bench::Likeness;
use bench::{Bench, Made};
use dice::Dice;
use drives::Planned;
use effect::{Draw, Effect, Hook, Lag, Setting, Slot};

/// What is left out of the model in a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Nothing.
    Clean,
    /// One effect of the catalogue.
    Effect(&'static str),
    /// Two.
    Pair(&'static str, &'static str),
    /// One that is in no catalogue.
    Unknown(&'static str),
}

impl Kind {
    /// clean, single, pair, unknown.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Clean => "clean",
            Kind::Effect(_) => "single",
            Kind::Pair(..) => "pair",
            Kind::Unknown(_) => "unknown",
        }
    }
}

/// Which drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveSet {
    /// Sine, single, multisine, steps, circle.
    #[default]
    Ordinary,
    /// The program's own protocol.
    Protocol,
    /// Three recordings of 8 to 10 s, one of them held out.
    Short,
}

/// What a case is made of.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spec {
    /// What is left out.
    pub kind: Kind,
    /// Everything random follows from it.
    pub seed: u64,
    /// 0 barely visible to 1 strong.
    pub strength: f64,
    /// Which drives.
    pub drive: DriveSet,
}

/// What a motion is made of, for another form of the effects than the ones here: [`generate_as`].
pub struct Planted<'a> {
    /// The robot that the user believes in.
    pub robot: &'a Robot,
    /// Film and forearm without the effects.
    pub parameters: &'a Parameters,
    /// Its voltages.
    pub drive: &'a Sampled,
    /// The effects, with equivalent values.
    pub details: &'a [&'a Detail],
    /// Names of the recordings, the training ones first.
    pub names: &'a [&'a str],
    /// Number of this one among them.
    pub number: usize,
    /// Its time in the series, s, all two minutes apart.
    pub series_s: f64,
    /// The point about which the capture's axes would turn, as stated, m.
    pub pivot_m: Vec3,
}

/// Simulates what is planted, with a duration, tolerance and payload: the motion as it is read.
pub type Simulate<'a> = &'a dyn Fn(&Planted, &Options) -> Result<Motion, String>;

/// One recording of a case.
#[derive(Debug, Clone)]
pub struct CaseRecording {
    /// `<case>/01-symmetric`.
    pub id: String,
    /// What a tool sees.
    pub parts: Parts,
    /// The motion that happened, without noise or any effect of the instruments.
    pub motion: Motion,
    /// What a capture without noise and gaps would have measured, m: the counterpart of `parts.measured_m`.
    pub clean_m: Vec<Vec3>,
    /// The base marker as captured, mm.
    pub base_mm: Vec<Vec3>,
    /// Parameters at work in this recording, drifts included.
    pub parameters: Parameters,
    /// Robot at work in this recording.
    pub robot: Robot,
    files: [(&'static str, Vec<u8>); 3],
}

/// A case.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// The robot that the user believes in.
    pub robot: Robot,
    /// Its rig file.
    pub rig_toml: String,
    /// The film and the forearm of the robot, without the effect.
    pub parameters: Parameters,
    /// To train on.
    pub train: Vec<CaseRecording>,
    /// Held out.
    pub holdout: Vec<CaseRecording>,
    /// The point about which the capture's axes would turn, as stated: base marker less the offset of the
    /// end-effector marker, m.
    pub pivot_m: Vec3,
    /// The answer.
    pub truth: Truth,
}

type Maker = fn(&mut Draw) -> Effect;

/// The effects of the catalogue.
const EFFECTS: &[(&str, Maker)] = &[
    ("series_resistance", electrical::series_resistance),
    ("leakage", electrical::leakage),
    ("amplifier_gain", electrical::amplifier_gain),
    ("amplifier_deadband", electrical::amplifier_deadband),
    ("amplifier_saturation", electrical::amplifier_saturation),
    ("slew_limit", electrical::slew_limit),
    ("permittivity_stretch", electrical::permittivity_stretch),
    ("dielectric_relaxation", electrical::dielectric_relaxation),
    ("electrode_failure", electrical::electrode_failure),
    ("electrode_stiffness", film::electrode_stiffness),
    ("hinge_stiffness", film::hinge_stiffness),
    ("mullins_softening", film::mullins_softening),
    ("slow_creep", film::slow_creep),
    ("loss_of_tension", film::loss_of_tension),
    ("actuator_asymmetry", film::actuator_asymmetry),
    ("temperature_drift", film::temperature_drift),
    ("joint_friction", joints::joint_friction),
    ("joint_damping", joints::joint_damping),
    ("end_stop", joints::end_stop),
    ("actuator_mass", joints::actuator_mass),
    ("link_length_error", joints::link_length_error),
    ("payload_change", joints::payload_change),
    ("time_offset", measurement::time_offset),
    ("clock_skew", measurement::clock_skew),
    ("mocap_lag", measurement::mocap_lag),
    ("frame_tilt", measurement::frame_tilt),
    ("marker_offset", measurement::marker_offset),
];

/// Effects that are in no catalogue.
const UNKNOWN: &[(&str, Maker)] = &[
    ("x_backlash", unknown::backlash),
    ("x_cogging", unknown::cogging),
    ("x_slack_cable", unknown::slack_cable),
    ("x_crosstalk", unknown::crosstalk),
    ("x_amplifier_ripple", unknown::ripple),
    ("x_self_heating", unknown::self_heating),
    ("x_quadratic_drag", unknown::quadratic_drag),
    ("x_yielding_branch", unknown::yielding_branch),
    ("x_cable_pull", unknown::cable_pull),
    ("x_swinging_hose", unknown::swinging_hose),
];

/// Ids of the catalogued effects that can be made.
pub fn effects() -> impl Iterator<Item = &'static str> {
    EFFECTS.iter().map(|e| e.0)
}

/// Where an effect that is in no catalogue acts, as `learnt.site` of `diagnosis.json` has it.
pub fn site_of(unknown: &str) -> Option<&'static str> {
    Some(match unknown {
        "x_backlash" | "x_cogging" => "bicep",
        "x_slack_cable" | "x_quadratic_drag" | "x_cable_pull" | "x_swinging_hose" => "force",
        "x_crosstalk" | "x_amplifier_ripple" => "electrical",
        "x_self_heating" | "x_yielding_branch" => "film",
        _ => return None,
    })
}

/// Names of the effects that are in no catalogue.
pub fn unknowns() -> impl Iterator<Item = &'static str> {
    UNKNOWN.iter().map(|e| e.0)
}

/// Name of a case, from which nothing can be read.
fn folder_name(seed: u64) -> String {
    format!("case-{:013x}", Dice::new(seed, 5).seed())
}

impl Spec {
    /// Name of the case; neither the seed nor what is left out can be read from it.
    pub fn name(&self) -> String {
        folder_name(self.seed)
    }

    fn makers(&self) -> Result<Vec<Maker>, String> {
        let find = |list: &[(&str, Maker)], id: &str| {
            list.iter()
                .find(|e| e.0 == id)
                .map(|e| e.1)
                .ok_or_else(|| format!("no effect `{id}` can be generated"))
        };
        Ok(match self.kind {
            Kind::Clean => Vec::new(),
            Kind::Effect(id) => vec![find(EFFECTS, id)?],
            Kind::Pair(a, b) => vec![find(EFFECTS, a)?, find(EFFECTS, b)?],
            Kind::Unknown(id) => vec![find(UNKNOWN, id)?],
        })
    }
}

/// The rig that every case is built on.
const RIG: &str = include_str!("../../datasets/twin2026_delta/rig.toml");

fn rig(text: &str) -> Result<RobotRig, String> {
    match Rig::parse(Path::new("rig.toml"), text).map_err(|e| e.to_string())? {
        Rig::Robot(rig) => Ok(rig),
        Rig::FilmSample(_) => Err("the built-in rig is no robot".into()),
    }
}

/// A film and a forearm of their own for each case: batches scatter by a fifth.
fn parameters(dice: &mut Dice, [modulus, torque]: [f64; 2]) -> Result<Parameters, String> {
    const MU_PA: [f64; 7] = [1.14e6, 2.2e5, 1.1e5, 5.5e4, 4.4e4, 3.5e4, 3.0e4];
    const TIME_S: [f64; 6] = [0.02, 0.115, 0.65, 3.7, 24.0, 140.0];
    let common = 1.0 + 0.12 * dice.range(-1.0, 1.0);
    let mu_pa = MU_PA
        .iter()
        .map(|mu| modulus * mu * common * (1.0 + 0.08 * dice.range(-1.0, 1.0)));
    let mu_pa = mu_pa.collect();
    let relaxation_time_s = TIME_S
        .iter()
        .map(|t| t * (1.0 + 0.2 * dice.range(-1.0, 1.0)))
        .collect();
    let locking = dice.range(65.0, 95.0);
    // Odd and smooth: a linear and a cubic part.
    let nodes: Vec<f64> = ForearmTorque::DEFAULT_NODES_DEG
        .iter()
        .map(|d| d.to_radians())
        .collect();
    let end = torque * dice.range(1.4e-3, 2.2e-3);
    let linear = dice.range(0.35, 0.55);
    let torque = nodes.iter().map(|x| {
        let s = x / 30f64.to_radians();
        end * (linear * s + (1.0 - linear) * s * s * s)
    });
    let torque = torque.collect();
    Ok(Parameters {
        film: Film {
            mu_pa,
            relaxation_time_s,
            locking,
        },
        forearm: ForearmTorque::new(nodes, torque)?,
    })
}

/// Makes a case, in memory: a function of `spec` alone.
///
/// # Errors
/// A sentence when no drive could be found that the robot follows.
pub fn generate(spec: &Spec) -> Result<Case, String> {
    generate_with(spec, false, None, Likeness::Drawn)
}

/// The same case on a robot and a bench that are only nearly their model.
///
/// # Errors
/// As [`generate`].
pub fn generate_on(spec: &Spec, likeness: Likeness) -> Result<Case, String> {
    generate_with(spec, false, None, likeness)
}

/// The same case, with its effects in the form that `simulate` gives them.
///
/// # Errors
/// As [`generate`].
pub fn generate_as(spec: &Spec, simulate: Simulate) -> Result<Case, String> {
    generate_with(spec, false, Some(simulate), Likeness::Drawn)
}

/// Share of the usual voltages, tried one after the other where the robot leaves its workspace.
const SHARES: [f64; 7] = [1.0, 0.93, 0.86, 0.79, 0.72, 0.64, 0.55];
/// Share of the strength, where the robot does not bear it at any voltage; the answer has the strength that
/// was simulated.
const WEAKER: [f64; 4] = [1.0, 0.8, 0.6, 0.4];

/// The same case with its effects switched off: same robot, film, drives, noise and gaps.
///
/// # Errors
/// As [`generate`].
pub fn generate_off(spec: &Spec) -> Result<Case, String> {
    generate_with(spec, true, None, Likeness::Drawn)
}

fn generate_with(
    spec: &Spec,
    off: bool,
    simulate: Option<Simulate>,
    likeness: Likeness,
) -> Result<Case, String> {
    let mut bench = Bench::new(likeness, spec.seed);
    let rig_toml = bench.rig(RIG);
    let believed = Robot::from_rig(&rig(&rig_toml)?, None)?;
    let parameters = parameters(&mut Dice::new(spec.seed, 1), bench.stiffness())?;
    bench.draw_film(&parameters.film);
    let lab = Lab {
        bench,
        rig_toml,
        believed,
        parameters,
    };
    let mut last = String::new();
    for weaker in WEAKER {
        let spec = Spec {
            strength: spec.strength * weaker,
            ..*spec
        };
        for share in SHARES {
            match attempt(&spec, off, &lab, share, simulate) {
                Ok(case) => return Ok(case),
                Err(why) => last = why,
            }
        }
    }
    Err(format!(
        "{} ({:?}, strength {:.3}): {last}",
        spec.name(),
        spec.kind,
        spec.strength
    ))
}

/// A robot on its bench.
struct Lab {
    bench: Bench,
    rig_toml: String,
    /// The robot that the user believes in.
    believed: Robot,
    /// Film and forearm.
    parameters: Parameters,
}

fn attempt(
    spec: &Spec,
    off: bool,
    lab: &Lab,
    share: f64,
    simulate: Option<Simulate>,
) -> Result<Case, String> {
    let Lab {
        bench,
        believed,
        parameters,
        ..
    } = lab;
    let made = bench.made(believed);
    let share = share * bench.voltage();
    let mut dice = Dice::new(spec.seed, 2);
    let planned = match spec.drive {
        DriveSet::Ordinary if bench.few_drives => drives::few(&mut dice, share)?,
        DriveSet::Ordinary => drives::ordinary(&mut dice, share)?,
        DriveSet::Protocol => drives::protocol(&mut dice, share)?,
        DriveSet::Short => drives::short(&mut dice, share)?,
    };
    let slots = slots(spec.seed, &planned);
    let effects = planted_effects(spec, off, lab, &slots, 5400.0 * share)?;
    let name = spec.name();
    let mut train = Vec::new();
    let mut holdout = Vec::new();
    let mut recordings = Vec::new();
    let mut capture = capture(spec.seed);
    bench.capture(&mut capture);
    let order = order(&slots);
    let names: Vec<&str> = order.iter().map(|o| &slots[o.0].name[..]).collect();
    let details: Vec<&Detail> = effects.iter().map(|e| &e.detail).collect();
    for (i, (slot, planned)) in slots.iter().zip(&planned).enumerate() {
        let number = order.iter().position(|o| o.0 == i).unwrap_or_default();
        let planted = Planted {
            robot: believed,
            parameters,
            drive: &planned.drive,
            details: &details,
            names: &names,
            number,
            series_s: order[number].1,
            pivot_m: pivot_m(&capture),
        };
        let take = Take {
            seed: spec.seed,
            index: i,
            id: format!("{name}/{}", slot.name),
            planned,
            stated: &capture,
            bench,
        };
        let scene = match simulate {
            Some(_) => take.scene(&made, parameters, &[]),
            None => take.scene(&made, parameters, &effects),
        };
        let recording = take
            .record(scene, simulate.map(|s| (s, planted)))
            .map_err(|why| format!("{}: {why}", slot.name))?;
        recordings.push(recording_truth(slot, planned, &recording.motion));
        if slot.train {
            train.push(recording);
        } else {
            holdout.push(recording);
        }
    }
    Ok(Case {
        truth: Truth {
            bench: bench.words(&capture),
            ..truth(spec, effects, parameters, recordings)
        },
        name,
        robot: believed.clone(),
        rig_toml: lab.rig_toml.clone(),
        parameters: parameters.clone(),
        train,
        holdout,
        pivot_m: pivot_m(&capture),
    })
}

/// The recordings one after the other, with breaks between them.
fn slots(seed: u64, planned: &[Planned]) -> Vec<Slot> {
    let mut series = Dice::new(seed, 3);
    let mut now = series.range(60.0, 170.0);
    let mut out = Vec::new();
    for (i, p) in planned.iter().enumerate() {
        out.push(Slot {
            name: format!("{:02}-{}", i + 1, p.kind),
            train: p.train,
            start_s: (now * 100.0).round() / 100.0,
            duration_s: p.duration_s(),
        });
        now += p.duration_s() + series.range(40.0, 150.0);
    }
    out
}

/// The effects of a case, in the order in which they act.
fn planted_effects(
    spec: &Spec,
    off: bool,
    lab: &Lab,
    slots: &[Slot],
    peak_v: f64,
) -> Result<Vec<Effect>, String> {
    let (believed, parameters) = (&lab.believed, &lab.parameters);
    let film = lab.bench.hook(believed, &parameters.film);
    let film: Vec<&dyn Addition> = film.iter().map(|h| h as &dyn Addition).collect();
    let free = rest(believed, parameters, [0.0; 3], 0.0, &film).map_err(|e| e.to_string())?;
    let chains = believed
        .mechanism
        .pose(free.position_m)
        .map_err(|e| e.to_string())?;
    let mut out = Vec::new();
    for (i, make) in spec.makers()?.into_iter().enumerate() {
        let mut draw = Draw {
            dice: Dice::new(spec.seed, 10 + i as u64),
            strength: spec.strength,
            off,
            setting: Setting {
                robot: believed,
                parameters,
                rest_m: free.position_m,
                rest: chains,
                slots,
                peak_v,
            },
        };
        out.push(make(&mut draw));
    }
    out.sort_by_key(|e| e.order);
    Ok(out)
}

/// What the answer says of one recording.
fn recording_truth(slot: &Slot, planned: &Planned, motion: &Motion) -> RecordingTruth {
    let heights = motion.position_m.iter().map(|u| u[2] * 1e3);
    let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), z| {
        (a.min(z), b.max(z))
    });
    let round = |v: f64| (v * 100.0).round() / 100.0;
    RecordingTruth {
        name: slot.name.clone(),
        set: if slot.train { "train" } else { "holdout" }.into(),
        payload_g: planned.payload_kg[0].1 * 1e3,
        series_start_s: slot.start_s,
        z_mm: [round(low), round(high)],
    }
}

/// The sealed answer.
fn truth(
    spec: &Spec,
    effects: Vec<Effect>,
    parameters: &Parameters,
    recordings: Vec<RecordingTruth>,
) -> Truth {
    let (ids, verdict): (Vec<String>, &str) = match spec.kind {
        Kind::Clean => (vec![], "adequate"),
        Kind::Effect(a) => (vec![a.into()], "missing_physics"),
        Kind::Pair(a, b) => (vec![a.into(), b.into()], "missing_physics"),
        Kind::Unknown(_) => (vec!["unknown".into()], "unexplained"),
    };
    let film = &parameters.film;
    let forearm = &parameters.forearm;
    Truth {
        rig: String::new(),
        case: spec.name(),
        effects: ids,
        verdict: verdict.into(),
        detail: effects.into_iter().map(|e| e.detail).collect(),
        seed: spec.seed,
        detectability: None,
        film: FilmTruth {
            mu_Pa: film.mu_pa.clone(),
            T_s: film.relaxation_time_s.clone(),
            J: film.locking,
            forearm_nodes_deg: forearm.nodes_rad().iter().map(|x| x.to_degrees()).collect(),
            forearm_torque_Nm: forearm.torque_n_m().to_vec(),
        },
        recordings,
        rmse: None,
        clock: "voltage-file time = offset + (1 + skew) true time; motion frame f at (f - 1)/rate"
            .into(),
        bench: BTreeMap::new(),
    }
}

/// The point about which the capture's axes would turn, as stated, m.
fn pivot_m(stated: &Capture) -> Vec3 {
    let place = &stated.placement;
    [0, 1, 2].map(|i| place.base_position_m[i] - place.end_effector_offset_m[i])
}

/// The slots with their time in the series, s, as a proof takes them: the training recordings first, all two
/// minutes apart.
fn order(slots: &[Slot]) -> Vec<(usize, f64)> {
    let (train, holdout): (Vec<usize>, Vec<usize>) =
        (0..slots.len()).partition(|&i| slots[i].train);
    let mut now = 0.0;
    let begins = |i: usize| {
        let begins = now;
        now += 120.0 + slots[i].duration_s;
        (i, begins)
    };
    train.into_iter().chain(holdout).map(begins).collect()
}

/// The capture system of a case, as stated: where the markers are, how noisy it is.
fn capture(seed: u64) -> Capture {
    let mut dice = Dice::new(seed, 4);
    let tenth = |v: f64| (v * 1e4).round() / 1e4;
    let total = dice.log_range(2e-5, 5e-5).clamp(2e-5, 5e-5);
    let coloured = dice.range(0.2, 0.55);
    Capture {
        base_in_capture_m: [
            tenth(dice.range(-0.3, 0.3)),
            tenth(dice.range(-0.3, 0.3)),
            tenth(dice.range(0.2, 0.6)),
        ],
        placement: Placement {
            base_position_m: [
                tenth(dice.range(-0.004, 0.004)),
                tenth(dice.range(0.08, 0.1)),
                tenth(dice.range(-0.015, 0.015)),
            ],
            end_effector_offset_m: [0.0, 0.0, -0.004],
            rotation_deg: [0.0; 3],
        },
        noise: Noise {
            white_m: total * (1.0 - coloured * coloured).sqrt(),
            coloured_m: total * coloured,
            correlation_s: dice.log_range(0.02, 0.1),
        },
        ..Capture::default()
    }
}

/// One recording that is to be made.
struct Take<'a> {
    seed: u64,
    index: usize,
    id: String,
    planned: &'a Planned,
    stated: &'a Capture,
    bench: &'a Bench,
}

/// What a recording is really made of.
struct Scene {
    robot: Robot,
    parameters: Parameters,
    /// Payload: (time s, kg).
    steps: Vec<(f64, f64)>,
    hooks: Vec<Hook>,
    capture: Capture,
    /// Voltage-file time = offset + (1 + skew) true time.
    clock: (f64, f64),
    lag: Option<Lag>,
}

/// What is written of a recording, and what is read back.
struct Written {
    files: [(&'static str, Vec<u8>); 3],
    measured_m: Vec<Vec3>,
    base_mm: Vec<Vec3>,
    clean_m: Vec<Vec3>,
}

impl Take<'_> {
    /// Robot, film, payload, capture and clock with what the effects make of them.
    fn scene(&self, made: &Made, parameters: &Parameters, effects: &[Effect]) -> Scene {
        let offset_s = made.clock_s * Dice::new(self.seed, 300 + self.index as u64).normal();
        let mut out = Scene {
            robot: made.robot.clone(),
            parameters: parameters.clone(),
            steps: self.planned.payload_kg.clone(),
            hooks: Vec::new(),
            capture: self.stated.clone(),
            clock: (offset_s, 0.0),
            lag: None,
        };
        let to = &mut out.capture.placement;
        for i in 0..3 {
            to.end_effector_offset_m[i] += made.marker_m[i];
            to.rotation_deg[i] += made.tilt_deg[i];
        }
        for effect in effects {
            if let Some(alter) = &effect.alter {
                alter(self.index, &mut out.robot, &mut out.parameters);
            }
            if let Some(act) = &effect.act {
                out.hooks.extend(act(self.index));
            }
            if let Some(mass) = &effect.mass {
                out.steps = added(&out.steps, &mass(self.index));
            }
            for i in 0..3 {
                to.end_effector_offset_m[i] += effect.placement.end_effector_offset_m[i];
                to.rotation_deg[i] += effect.placement.rotation_deg[i];
            }
            out.clock.0 += effect.clock.0;
            out.clock.1 += effect.clock.1;
            out.lag = out.lag.or(effect.lag);
        }
        let film = self.bench.hook(&out.robot, &out.parameters.film);
        out.hooks.extend(film);
        out
    }

    /// Simulates the recording and writes it as the instruments would.
    fn record(
        self,
        mut scene: Scene,
        simulate: Option<(Simulate, Planted)>,
    ) -> Result<CaseRecording, String> {
        let planned = self.planned;
        let additions: Vec<&dyn Addition> =
            scene.hooks.iter().map(|h| h as &dyn Addition).collect();
        let options = Options {
            duration_s: planned.duration_s(),
            tolerance_m: 1e-7,
            sample_step_s: 1.0 / self.stated.rate_hz,
            payload: Payload::steps(scene.steps[0].1, scene.steps[1..].to_vec())?,
            ..Options::default()
        };
        let (robot, parameters, drive) = (&scene.robot, &scene.parameters, &planned.drive);
        let truth = match simulate {
            Some((simulate, planted)) => simulate(&planted, &options)?,
            None => {
                motion(robot, parameters, drive, &options, &additions).map_err(|e| e.to_string())?
            }
        };
        let seen = match scene.lag {
            Some(lag) => lagged(&truth, lag),
            None => truth.position_m.clone(),
        };
        self.spoil(&mut scene.capture, seen.len());
        let logged = logged(drive, scene.clock, self.bench.monitor_v)?;
        let written = self.write(&scene.capture, &seen, &logged)?;
        let payload = Payload::steps(planned.payload_kg[0].1, planned.payload_kg[1..].to_vec())?;
        let payload_kg = (0..written.measured_m.len())
            .map(|i| payload.mass_kg(i as f64 * truth.step_s, crate::simulate::Side::After))
            .collect();
        let parts = Parts {
            id: self.id.clone(),
            step_s: truth.step_s,
            start_s: 0.0,
            measured_m: written.measured_m,
            payload_kg,
            voltage: voltage(&logged),
            monitor: None,
            offset_s: Some(0.0),
            initial: InitialState::Relaxed,
        };
        Ok(CaseRecording {
            id: self.id,
            parts,
            motion: truth,
            base_mm: written.base_mm,
            clean_m: written.clean_m,
            parameters: scene.parameters,
            robot: scene.robot,
            files: written.files,
        })
    }

    /// Gaps and noise: of this recording alone.
    fn spoil(&self, capture: &mut Capture, frames: usize) {
        let mut dice = Dice::new(self.seed, 100 + self.index as u64);
        capture.seed = dice.seed();
        if dice.chance(0.5) {
            for _ in 0..=dice.below(3) {
                let length = 2 + dice.below(22);
                let first = 60 + dice.below(frames - 160);
                capture.gaps.push((first, length));
            }
        }
    }

    /// A file of motion as it leaves the capture system.
    fn exported(&self, csv: Vec<u8>, noise: bool) -> Vec<u8> {
        let rate_hz = self.stated.rate_hz;
        self.bench.exported(csv, rate_hz, self.index, noise)
    }

    /// The files of what was seen and logged; and what is measured, with and without noise and gaps.
    fn write(&self, capture: &Capture, seen: &[Vec3], logged: &Sampled) -> Result<Written, String> {
        let log = VoltageLog {
            quantum_v: self.bench.monitor_v,
            ..VoltageLog::default()
        };
        let text = RecordingText {
            id: self.id.clone(),
            rig: "../../rig.toml".into(),
            payload_kg: self.planned.payload_kg.clone(),
            placement: self.stated.placement,
            ..RecordingText::default()
        };
        let fail = |e: std::io::Error| e.to_string();
        let (mut motion_csv, mut voltage_csv, mut toml) = (Vec::new(), Vec::new(), Vec::new());
        write::nexus_csv(&mut motion_csv, capture, seen).map_err(fail)?;
        let motion_csv = self.exported(motion_csv, true);
        write::voltage_csv(&mut voltage_csv, &log, logged).map_err(fail)?;
        write::recording_toml(&mut toml, &text, capture, &log).map_err(fail)?;
        let (measured_m, base_mm) = measured(&motion_csv, &self.stated.placement)?;
        let mut silent = capture.clone();
        silent.noise = Noise::default();
        silent.gaps.clear();
        let mut clean_csv = Vec::new();
        write::nexus_csv(&mut clean_csv, &silent, seen).map_err(fail)?;
        let clean_csv = self.exported(clean_csv, false);
        let (clean_m, _) = measured(&clean_csv, &self.stated.placement)?;
        Ok(Written {
            files: [
                ("recording.toml", toml),
                ("motion.csv", motion_csv),
                ("voltage.csv", voltage_csv),
            ],
            measured_m,
            base_mm,
            clean_m,
        })
    }
}

/// Sum of two staircases in time.
fn added(a: &[(f64, f64)], b: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut times: Vec<f64> = a.iter().chain(b).map(|s| s.0).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let at = |list: &[(f64, f64)], t: f64| {
        let held = list.iter().rev().find(|s| s.0 <= t);
        held.map_or(0.0, |s| s.1)
    };
    times
        .into_iter()
        .map(|t| (t, at(a, t) + at(b, t)))
        .collect()
}

/// x'' = omega^2 (u(t - delay) - x) - 2 zeta omega x', by the midpoint rule at a hundredth of a sample's
/// length or omega's.
fn lagged(motion: &Motion, lag: Lag) -> Vec<Vec3> {
    let (h, n) = (motion.step_s, motion.position_m.len());
    // Cubic Hermite between samples.
    let at = |t: f64| -> Vec3 {
        let place = (t / h).clamp(0.0, (n - 1) as f64);
        let i = (place as usize).min(n.saturating_sub(2));
        let s = place - i as f64;
        let j = (i + 1).min(n - 1);
        let (p0, p1) = (motion.position_m[i], motion.position_m[j]);
        let (v0, v1) = (motion.velocity_m_s[i], motion.velocity_m_s[j]);
        let (a, b) = (s * s * (3.0 - 2.0 * s), s * (1.0 - s) * (1.0 - s));
        let c = s * s * (s - 1.0);
        [0, 1, 2].map(|k| p0[k] + a * (p1[k] - p0[k]) + h * (b * v0[k] + c * v1[k]))
    };
    let fine = ((lag.omega_rad_s * h * 20.0).ceil() as usize).clamp(4, 400);
    let step = h / fine as f64;
    let mut x = motion.position_m[0];
    let mut v = [0.0; 3];
    let mut out = Vec::with_capacity(n);
    let (w2, c) = (
        lag.omega_rad_s * lag.omega_rad_s,
        2.0 * lag.damping * lag.omega_rad_s,
    );
    for i in 0..n {
        out.push(x);
        for j in 0..fine {
            let t = i as f64 * h + (j as f64 + 0.5) * step - lag.delay_s;
            let u = at(t);
            for k in 0..3 {
                // Trapezoidal in x and v: x1 = x + s (v + v1)/2, v1 = v + s (w2 (u - (x + x1)/2) - c (v +
                // v1)/2)
                let known =
                    v[k] + step * (w2 * (u[k] - x[k] - 0.25 * step * v[k]) - 0.5 * c * v[k]);
                let v1 = known / (1.0 + 0.25 * step * step * w2 + 0.5 * step * c);
                x[k] += 0.5 * step * (v[k] + v1);
                v[k] = v1;
            }
        }
    }
    out
}

/// The drive as a logger with its own clock writes it: file time = offset + (1 + skew) true time.
fn logged(drive: &Sampled, clock: (f64, f64), quantum_v: f64) -> Result<Sampled, String> {
    use crate::simulate::{Hold, Side, Voltage as _};
    if clock == (0.0, 0.0) && quantum_v == drives::QUANTUM_V {
        return Ok(drive.clone());
    }
    let n = drive.samples_v().len();
    let q = quantum_v;
    let samples = (0..n).map(|i| {
        let t = (i as f64 * drive.step_s() - clock.0) / (1.0 + clock.1);
        drive.phi_v(t, Side::After).map(|v| (v / q).round() * q)
    });
    Sampled::new(0.0, drive.step_s(), samples.collect(), Hold::Linear)
}

fn voltage(drive: &Sampled) -> Voltage {
    let n = drive.samples_v().len();
    let time = (0..n).map(|i| i as f64 * drive.step_s()).collect();
    let channels = (0..3)
        .map(|k| drive.samples_v().iter().map(|v| v[k]).collect())
        .collect();
    Voltage::new(time, channels, false)
}

/// Positions of the end effector's centre in the world, m, from a motion file that this room wrote and the
/// stated places of its markers (rotation zero), NaN in gaps; and the base marker as captured, mm.
fn measured(csv: &[u8], place: &Placement) -> Result<(Vec<Vec3>, Vec<Vec3>), String> {
    let text = std::str::from_utf8(csv).map_err(|e| e.to_string())?;
    let mut effector = Vec::new();
    let mut base = [0.0; 3];
    let mut still = Vec::new();
    for line in text.lines().skip(5) {
        let mut cells = line
            .split(',')
            .skip(2)
            .map(|c| c.parse::<f64>().unwrap_or(f64::NAN));
        let mut next = || cells.next().unwrap_or(f64::NAN);
        effector.push([next(), next(), next()]);
        let here = [next(), next(), next()];
        for i in 0..3 {
            base[i] += here[i];
        }
        still.push(here);
    }
    let base = base.map(|b| b / effector.len() as f64);
    let world = |p: &Vec3| {
        [0, 1, 2].map(|i| {
            (p[i] - base[i]) * 1e-3 + place.base_position_m[i] - place.end_effector_offset_m[i]
        })
    };
    Ok((effector.iter().map(world).collect(), still))
}

impl Case {
    /// All files of the case, with paths relative to the folder of cases; the answer is not among them.
    pub fn files(&self) -> Vec<(String, &[u8])> {
        let name = &self.name;
        let mut out = vec![(format!("{name}/rig.toml"), self.rig_toml.as_bytes())];
        for (set, list) in [("train", &self.train), ("holdout", &self.holdout)] {
            for recording in list {
                let own = recording.id.rsplit('/').next().unwrap_or(&recording.id);
                for (file, bytes) in &recording.files {
                    out.push((format!("{name}/{set}/{own}/{file}"), bytes));
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

impl Truth {
    /// The answer as JSON.
    pub fn to_json(&self) -> String {
        let mut out = serde_json::to_string_pretty(self).unwrap_or_default();
        let _ = writeln!(out);
        out
    }

    /// Reads an answer back.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn from_json(text: &str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|e| e.to_string())
    }
}

/// `n_total` cases: a third of them clean, nearly half with one effect (each as often as the others,
/// strengths spread evenly over 0 to 1), a tenth pairs, a tenth in no catalogue; in random order.
pub fn plan(n_total: usize, seed: u64) -> Vec<Spec> {
    let mut dice = Dice::new(seed, 0);
    let clean = n_total / 3;
    let pairs = n_total / 10;
    let unknown = n_total / 10;
    let single = n_total - clean - pairs - unknown;
    let spread = |i: usize, kinds: usize, count: usize, dice: &mut Dice| {
        // The i-th case is the (i / kinds)-th of its kind.
        let times = count.div_ceil(kinds).max(1) as f64;
        (((i / kinds) as f64 + dice.unit()) / times).min(1.0)
    };
    let mut kinds: Vec<(Kind, f64)> = Vec::new();
    for _ in 0..clean {
        kinds.push((Kind::Clean, dice.unit()));
    }
    for i in 0..single {
        let id = EFFECTS[i % EFFECTS.len()].0;
        let strength = spread(i, EFFECTS.len(), single, &mut dice);
        kinds.push((Kind::Effect(id), strength));
    }
    for _ in 0..pairs {
        let a = dice.below(EFFECTS.len());
        let b = (a + 1 + dice.below(EFFECTS.len() - 1)) % EFFECTS.len();
        let strength = dice.range(0.3, 1.0);
        kinds.push((Kind::Pair(EFFECTS[a].0, EFFECTS[b].0), strength));
    }
    for i in 0..unknown {
        let id = UNKNOWN[i % UNKNOWN.len()].0;
        let strength = spread(i, UNKNOWN.len(), unknown, &mut dice);
        kinds.push((Kind::Unknown(id), strength));
    }
    dice.shuffle(&mut kinds);
    kinds
        .into_iter()
        .map(|(kind, strength)| Spec {
            kind,
            seed: dice.seed(),
            strength,
            drive: DriveSet::Ordinary,
        })
        .collect()
}
