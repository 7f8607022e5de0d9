//! Loops over the whole catalogue: names, off, derivatives.

use std::path::Path;

use deacal::dataset::Dataset;
use deacal::effects::{Acting, CATALOGUE, Effect, Reach, When};
use deacal::model::{ForearmTorque, Robot};
use deacal::recording::{Recording, Rig};
use deacal::residual::{RobotResidual, SeparableResidual};

/// Ids with parameter names and units as files promise them. More may follow, with usual values.
const PROMISED: &[(&str, &[(&str, &str)])] = &[
    ("series_resistance", &[("resistance", "ohm")]),
    (
        "leakage",
        &[("loss_fraction", "1"), ("field_exponent", "1")],
    ),
    ("amplifier_gain", &[("gain_error", "1"), ("offset", "V")]),
    ("amplifier_deadband", &[("threshold", "V")]),
    ("amplifier_saturation", &[("ceiling", "V")]),
    ("slew_limit", &[("rate_up", "V/s"), ("rate_down", "V/s")]),
    ("permittivity_stretch", &[("slope", "1")]),
    (
        "dielectric_relaxation",
        &[("fraction", "1"), ("time_constant", "s")],
    ),
    (
        "electrode_failure",
        &[("fraction", "1"), ("time", "s"), ("recording", "1")],
    ),
    ("electrode_stiffness", &[("modulus", "Pa")]),
    (
        "hinge_stiffness",
        &[("stiffness", "N m/rad"), ("rest_angle", "rad")],
    ),
    (
        "mullins_softening",
        &[("softening", "1"), ("energy_scale", "J/m^3")],
    ),
    ("slow_creep", &[("modulus", "Pa"), ("time_constant", "s")]),
    ("loss_of_tension", &[("threshold", "1")]),
    ("actuator_asymmetry", &[("thickness_factor", "1")]),
    (
        "temperature_drift",
        &[("relative_change", "1"), ("time_constant", "s")],
    ),
    ("joint_friction", &[("torque", "N m")]),
    ("joint_damping", &[("coefficient", "N m s/rad")]),
    (
        "end_stop",
        &[("theta_stop", "rad"), ("stiffness", "N m/rad")],
    ),
    ("actuator_mass", &[("first_moment", "kg m")]),
    (
        "link_length_error",
        &[("link", "1"), ("relative_error", "1")],
    ),
    (
        "payload_change",
        &[("mass", "kg"), ("time", "s"), ("recording", "1")],
    ),
    ("time_offset", &[("offset", "s")]),
    ("clock_skew", &[("skew", "1")]),
    ("frame_tilt", &[("rotation", "rad")]),
    ("marker_offset", &[("offset", "m")]),
    ("mocap_lag", &[("delay", "s"), ("pure", "1")]),
    (
        "x_space_charge",
        &[("fraction", "1"), ("time_constant", "s")],
    ),
    ("x_electrode_viscosity", &[("viscosity", "Pa s")]),
    (
        "x_nonlinear_flow",
        &[
            ("modulus", "Pa"),
            ("time_constant", "s"),
            ("stress_exponent", "1"),
        ],
    ),
    ("x_backlash", &[("stiffness", "N m/rad"), ("play", "rad")]),
];

#[test]
fn every_id_is_there_with_its_names_and_units() {
    let ids: Vec<&str> = CATALOGUE.iter().map(|e| e.id()).collect();
    let promised: Vec<&str> = PROMISED.iter().map(|p| p.0).collect();
    assert_eq!(ids, promised);
    for (effect, (id, names)) in CATALOGUE.iter().zip(PROMISED) {
        for (name, unit) in *names {
            let own: Vec<_> = effect
                .parameters()
                .iter()
                .filter(|q| q.part().0 == *name)
                .collect();
            assert!(!own.is_empty(), "{id} has no {name}");
            assert!(own.iter().all(|q| q.unit == *unit), "{id}: unit of {name}");
            assert!(own.len() == 1 || own.len() == 3, "{id}: {name}");
        }
        for q in effect.parameters() {
            assert!(q.lower <= q.upper && q.spread > 0.0, "{id}: {}", q.name);
        }
        assert!(
            !effect.says().is_empty()
                && !effect.source().is_empty()
                && !effect.brought_out_by().is_empty()
        );
        assert!(
            effect.says().starts_with(|c: char| c.is_lowercase()),
            "{id}: says"
        );
    }
}

fn bundled() -> (Robot, Dataset) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/twin2026_delta/single-1");
    let recording = Recording::open(&path).unwrap();
    let Some(Rig::Robot(rig)) = &recording.rig else {
        panic!("no rig");
    };
    let robot = Robot::from_rig(rig, None).unwrap();
    let dataset = Dataset::from_recording(&recording, None).unwrap();
    (robot, dataset)
}

/// The bundled robot's own parameters.
fn parameters() -> (Vec<f64>, Vec<f64>) {
    let mut eta: Vec<f64> = [0.02, 0.12, 0.7, 4.0, 25.0, 150.0].map(f64::ln).to_vec();
    eta.push(1.0 / 80.0);
    let mut beta: Vec<f64> = [1120.0, 220.0, 120.0, 55.0, 45.0, 35.0, 30.0]
        .map(|k| k * 1e3)
        .to_vec();
    beta.extend([-1.6e-3, -0.8e-3, -0.3e-3, 0.0, 0.3e-3, 0.8e-3, 1.6e-3]);
    (eta, beta)
}

fn on(effect: &dyn Effect) -> [bool; 3] {
    match effect.reach() {
        Reach::One => [true, false, false],
        Reach::All | Reach::AllOrOne => [true; 3],
    }
}

#[test]
fn off_changes_nothing_to_the_bit() {
    let (robot, dataset) = bundled();
    let (eta, beta) = parameters();
    let when = When {
        recording: 3,
        series_s: 240.0,
        start_s: dataset.start_s,
    };
    let mut plain = RobotResidual::new(&robot, &[&dataset], 6, &ForearmTorque::zero()).unwrap();
    plain.weigh(&eta, &beta).unwrap();
    let bits = |r: &RobotResidual| -> Vec<u64> {
        let normal = r.evaluate(&eta, &beta).unwrap();
        let error = r.voltage_error(0, &eta, &beta).unwrap();
        let squared = error.predicted_squared_v2.iter().flatten();
        let made = error.command_v.iter().flatten();
        let all = normal.gram.iter().chain(squared).chain(made);
        all.map(|v| v.to_bits()).collect()
    };
    let without = bits(&plain);
    for effect in CATALOGUE {
        let acting = Acting::off(*effect, on(*effect));
        let with = plain.with_effects(vec![acting], Vec::new(), &[when]);
        let differ = bits(&with)
            .iter()
            .zip(&without)
            .filter(|(a, b)| a != b)
            .count();
        assert_eq!(differ, 0, "{} differs in {differ} numbers", effect.id());
    }
}

/// Effects whose residual is no smooth function of their size at off: a threshold, or a rate that binds only
/// from somewhere on.
const THRESHOLDS: &[&str] = &[
    "amplifier_deadband",
    "amplifier_saturation",
    "slew_limit",
    "loss_of_tension",
    "end_stop",
];

#[test]
fn two_small_sizes_agree_on_the_derivative() {
    let (robot, dataset) = bundled();
    let (eta, beta) = parameters();
    let plain = RobotResidual::new(&robot, &[&dataset], 6, &ForearmTorque::zero()).unwrap();
    let norm = |f: &[f64]| f.iter().map(|x| x * x).sum::<f64>().sqrt();
    for effect in CATALOGUE.iter().filter(|e| !THRESHOLDS.contains(&e.id())) {
        for (i, q) in effect
            .parameters()
            .iter()
            .enumerate()
            .filter(|(_, q)| q.size)
        {
            let trace = |x: f64| -> Vec<f64> {
                let mut acting = Acting::off(*effect, on(*effect));
                acting.values[i] += x;
                let all = plain.fingerprint(&eta, &beta, &acting).unwrap();
                all.iter().map(|f| f / x).collect()
            };
            let h = 2e-3 * q.spread;
            let forward = trace(h);
            let central: Vec<f64> = if q.lower < q.off {
                let back = trace(-h);
                forward
                    .iter()
                    .zip(&back)
                    .map(|(a, b)| 0.5 * (a + b))
                    .collect()
            } else {
                // One-sided, to second order.
                let half = trace(0.5 * h);
                forward
                    .iter()
                    .zip(&half)
                    .map(|(a, b)| 2.0 * b - a)
                    .collect()
            };
            let small = trace(0.25 * h);
            let apart: Vec<f64> = small.iter().zip(&central).map(|(a, b)| a - b).collect();
            let ratio = norm(&apart) / norm(&central);
            println!("{:24} {:18} {ratio:.1e}", effect.id(), q.name);
            assert!(
                norm(&central) > 0.0,
                "{} {} does nothing",
                effect.id(),
                q.name
            );
            assert!(ratio < 5e-3, "{} {}: {ratio}", effect.id(), q.name);
        }
    }
}
