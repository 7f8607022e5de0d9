//! Hanging samples: causes run forward by two integrators, derivatives, and causes that are simulated and
//! found again.

use std::f64::consts::TAU;

use deacal::dataset::{HangingDataset, HangingParts, Voltage};
use deacal::diagnosis::{Diagnosis, Request, RigKind, SampleEntry, Verdict, diagnose_samples};
use deacal::effects::{Acting, HANGING, When, by_id};
use deacal::film::Film;
use deacal::model::{Electrode, HangingSample};
use deacal::residual::{Acts, HangingResidual, Hung, SampleResidual, Steps};
use deacal::simulate::{Hold, SampleOptions, Sampled, sample_motion_with_effects};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

const STEP_S: f64 = 0.01;
const NOISE_M: f64 = 1e-5;
/// Length of a recording, s.
const LASTS_S: f64 = 30.0;

/// With wide margins, whose strips carry the load where the active part does not.
const SAMPLE: HangingSample = HangingSample {
    width_m: 0.045,
    length_m: 0.06,
    margin_m: 0.012,
    l3_m: 1e-4,
    films: 1.0,
    eps_r: 2.8,
    mass_kg: 0.05,
    electrode: Electrode::IDEAL,
};

fn film() -> Film {
    Film {
        mu_pa: vec![4.4e5, 4e4, 4e4, 3e4],
        relaxation_time_s: vec![0.05, 0.8, 12.0],
        locking: 80.0,
    }
}

/// A sine, steps, and three sines: from rest at 0.5 s.
fn drive(number: usize, t: f64) -> f64 {
    let t = t - 0.5;
    if t <= 0.0 {
        return 0.0;
    }
    let most = 5000.0;
    match number {
        0 => 0.5 * most * (1.0 - (TAU * 0.33 * t).cos()),
        1 => {
            let levels = [0.5, 1.0, 0.3, 0.8, 0.0, 0.6, 0.95, 0.4];
            let at = (t / 3.0) as usize;
            let before = if at == 0 { 0.0 } else { levels[(at - 1) % 8] };
            let share = ((t % 3.0) / 0.1).min(1.0);
            most * (before + share * (levels[at % 8] - before))
        }
        _ => {
            let sum: f64 = [0.31, 0.83, 1.7].iter().map(|f| (TAU * f * t).sin()).sum();
            most * (t / 0.5).min(1.0) * (0.5 + sum / 6.5)
        }
    }
}

fn logged(number: usize) -> Sampled {
    let count = (LASTS_S / STEP_S) as usize + 2;
    let volts = (0..count).map(|i| [drive(number, i as f64 * STEP_S); 3]);
    Sampled::new(0.0, STEP_S, volts.collect(), Hold::Linear).unwrap()
}

fn when(number: usize) -> When {
    When {
        recording: number + 1,
        series_s: 120.0 * number as f64,
        start_s: 0.0,
    }
}

fn acting(id: &str, values: &[f64]) -> Acting {
    Acting {
        effect: by_id(id).unwrap(),
        values: values.to_vec(),
        on: [true; 3],
    }
}

/// A recording, whose capture reads `read` of x.
fn recording(number: usize, effects: &[Acting], read: impl Fn(f64) -> f64) -> HangingDataset {
    let options = SampleOptions {
        sample_step_s: STEP_S,
        duration_s: LASTS_S,
        ..SampleOptions::default()
    };
    let voltage = logged(number);
    let moved =
        sample_motion_with_effects(&SAMPLE, &film(), &voltage, &options, effects, when(number))
            .unwrap();
    let mut generator = ChaCha12Rng::seed_from_u64(7 + number as u64);
    let mut noise =
        || NOISE_M * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut generator);
    let below_m = moved
        .x_m
        .iter()
        .map(|x| 0.07 + read(*x) + noise())
        .collect();
    let time = (0..voltage.samples_v().len()).map(|i| i as f64 * STEP_S);
    let channel = voltage.samples_v().iter().map(|v| v[0]).collect();
    HangingDataset::new(HangingParts {
        id: format!("{:02}-hung", number + 1),
        step_s: STEP_S,
        start_s: 0.0,
        below_m,
        payload_kg: 0.0,
        voltage: Voltage::new(time.collect(), vec![channel], false),
        offset_s: Some(0.0),
    })
    .unwrap()
}

/// What a diagnosis of two recordings says, judged on a third.
fn diagnosed(effects: &[Acting], read: impl Fn(f64) -> f64 + Copy) -> Diagnosis {
    let all = [0, 1, 2].map(|number| recording(number, effects, read));
    let entry = |number: usize| SampleEntry {
        dataset: &all[number],
        sample: &SAMPLE,
        when: when(number),
    };
    let request = Request::default();
    diagnose_samples(&[entry(0), entry(1)], &[entry(2)], &request, &|_| {}).unwrap()
}

/// Sizes at which causes are run.
fn sized() -> Vec<Acting> {
    let of = |id: &str, values: &[f64]| acting(id, values);
    vec![
        of("series_resistance", &[1.5e8]),
        of("leakage", &[0.1, 2.0, 0.0]),
        of("amplifier_gain", &[0.05, 50.0]),
        of("amplifier_deadband", &[900.0, 40.0]),
        of("amplifier_saturation", &[4300.0, 80.0]),
        of("slew_limit", &[6000.0, 4000.0]),
        of("permittivity_stretch", &[0.4, 0.0]),
        of("dielectric_relaxation", &[0.1, 0.4, 0.05]),
        of("electrode_failure", &[0.2, 11.003, 1.0]),
        of("electrode_stiffness", &[2e5]),
        of("mullins_softening", &[0.4, 5e3]),
        of("slow_creep", &[1e5, 1100.0, 300.0]),
        of("loss_of_tension", &[0.9, 0.05]),
        of("temperature_drift", &[0.1, 0.05, 400.0]),
        of("payload_change", &[5e-3, 11.003, 1.0]),
        of("time_offset", &[0.05]),
        of("clock_skew", &[0.003]),
        of("x_space_charge", &[0.1, 20.0]),
        of("x_nonlinear_flow", &[5e4, 2.0, 2.0]),
    ]
}

#[test]
fn two_integrators_agree_on_every_cause() {
    let sized = sized();
    assert_eq!(sized.len(), HANGING.len());
    let clean = recording(0, &[], |x| x);
    let h = 0.005;
    let bounce = Steps::of(&SAMPLE, &film(), 0.0, h).bounce;
    let grid = SampleResidual::new(&clean, h, bounce, NOISE_M);
    let options = SampleOptions {
        sample_step_s: h,
        duration_s: LASTS_S,
        ..SampleOptions::default()
    };
    let plain = sample_motion_with_effects(&SAMPLE, &film(), &logged(0), &options, &[], when(0));
    let plain = plain.unwrap().x_m;
    for own in &sized {
        let effects = std::slice::from_ref(own);
        let truth =
            sample_motion_with_effects(&SAMPLE, &film(), &logged(0), &options, effects, when(0))
                .unwrap_or_else(|e| panic!("{}: {e}", own.effect.id()))
                .x_m;
        let acts = Acts {
            effects,
            when: when(0),
            offset_s: 0.0,
            passes: 12,
        };
        let (run, _) = grid.run_with(&SAMPLE, &film(), &acts, None, &[]).unwrap();
        let far = |a: &[f64], b: &[f64]| {
            let square: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
            (square / a.len() as f64).sqrt()
        };
        let (off, does) = (far(&run.x_m, &truth), far(&plain, &truth));
        eprintln!("{}: off {off:.2e} m of {does:.2e} m", own.effect.id());
        assert!(
            off < 2e-6 && does > 10.0 * off,
            "{}: {off:e} of {does:e}",
            own.effect.id()
        );
    }
}

#[test]
fn derivatives_are_those_of_a_difference() {
    let sets: Vec<HangingDataset> = [0, 1].map(|n| recording(n, &[], |x| x)).into();
    let hung = sets.iter().map(|d| {
        let bounce = Steps::of(&SAMPLE, &film(), 0.0, STEP_S).bounce;
        Hung {
            residual: SampleResidual::new(d, STEP_S, bounce, NOISE_M),
            sample: SAMPLE,
            free_offset: false,
        }
    });
    let when = [when(0), when(1)];
    let plain = HangingResidual::new(hung.collect(), 3, &when);
    let mut eta: Vec<f64> = film().relaxation_time_s.iter().map(|t| t.ln()).collect();
    eta.push(1.0 / film().locking);
    eta.extend(film().mu_pa);
    for own in [
        acting("leakage", &[0.1, 2.0, 0.0]),
        acting("permittivity_stretch", &[0.4, 0.0]),
        acting("electrode_stiffness", &[2e5]),
        acting("loss_of_tension", &[0.9, 0.05]),
        acting("temperature_drift", &[0.1, 0.05, 400.0]),
    ] {
        let id = own.effect.id();
        let first = own.values[0] / own.effect.parameters()[0].spread;
        let residual = plain.with_effects(vec![own], vec![(0, 0)], &when);
        let mut at = eta.clone();
        at.push(first);
        let design = residual.design(&at).unwrap();
        let last = design.ncols() - 1;
        for j in 0..last {
            let step = if at[j] > 1e3 { 1e-4 * at[j] } else { 1e-4 };
            let moved = |by: f64| {
                let mut at = at.clone();
                at[j] += by;
                residual.design(&at).unwrap().column(last).into_owned()
            };
            let difference = (moved(step) - moved(-step)) / (2.0 * step);
            let off = (&difference - design.column(j)).norm() / difference.norm();
            assert!(off < 0.01, "{id}, unknown {j}: {off:.1e}");
        }
    }
}

#[test]
fn a_clean_sample_is_adequate() {
    let d = diagnosed(&[], |x| x);
    assert_eq!(d.verdict, Verdict::Adequate, "{}", d.says);
    assert_eq!((d.rig, d.unit.as_str()), (RigKind::Sample, "mm"));
    let held = d.holdout.unwrap();
    assert!(held.before_v < 1.2 * held.noise_floor_v, "{held:?}");
}

#[test]
fn causes_are_named_with_their_sizes() {
    for (own, within) in [
        (acting("leakage", &[0.12, 2.0, 0.0]), 0.25),
        (acting("series_resistance", &[1.5e8]), 0.1),
        (acting("loss_of_tension", &[0.9, 0.05]), 0.1),
        (acting("mullins_softening", &[0.4, 5e3]), 0.5),
    ] {
        let id = own.effect.id();
        let d = diagnosed(std::slice::from_ref(&own), |x| x);
        assert_eq!(d.verdict, Verdict::MissingPhysics, "{id}: {}", d.says);
        let named = &d.candidates[0];
        assert_eq!(named.acting.effect.id(), id, "{}", d.says);
        let (found, truth) = (named.values[0].value, own.values[0]);
        eprintln!("{id}: {found} for {truth}, {:?}", named.values[0].ci95);
        assert!(
            (found / truth - 1.0).abs() < within,
            "{id}: {found} for {truth}"
        );
        let held = d.holdout.unwrap();
        assert!(held.after_v < 1.2 * held.noise_floor_v, "{id}: {held:?}");
    }
}

#[test]
fn what_no_cause_accounts_for_is_unexplained() {
    // the reading has a ripple along x
    let d = diagnosed(&[], |x| x + 5e-5 * (TAU * x / 2e-4).sin());
    assert_eq!(d.verdict, Verdict::Unexplained, "{}", d.says);
    assert!(d.candidates.iter().all(|c| !c.in_model));
}
