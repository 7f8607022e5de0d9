//! Electrodes over days: strokes without the capture's noise, causes of simulated campaigns, and bad input.
//!
//! The campaigns are made by the adaptive simulator, which shares nothing with the fit but the model; films,
//! sizes, days and mounts are drawn with seeds of their own.
//! `DEACAL_CAMPAIGNS=500 cargo test --release --test fit ageing:: -- --nocapture` runs the long form,
//! `DEACAL_CAMPAIGN_SEED` other campaigns: what is chosen on some is measured on others.

use crate::common;

use std::fs;
use std::path::Path;

use assert_cmd::cargo::CommandCargoExt;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use deacal::calibration::{
    AgeingInput, AgeingRequest, AgeingSubject, Cause, ageing, named, open, strokes,
};
use deacal::dataset::{Dataset, HangingDataset, HangingParts, Parts, Voltage, cycles};
use deacal::effects::{Acting, When, by_id};
use deacal::film::{Film, InitialState};
use deacal::model::{Electrode, HangingSample, Parameters, Robot};
use deacal::report::parameter_file::ParameterFile;
use deacal::simulate::write::{Capture, Noise, RecordingText, VoltageLog, sample_recording};
use deacal::simulate::{
    Drive, Hold, Options, SampleOptions, Sampled, Smooth, motion_with_effects, sample_motion,
};

const SECONDS: f64 = 27.0;

/// The paper's drive: from rest at 1 s, eight cycles of 2.5 kV + 2.5 kV at 1/3 Hz.
fn drive(t: f64) -> f64 {
    let w = 2.0 * std::f64::consts::PI / 3.0;
    2500.0 * (1.0 - (w * (t - 1.0).clamp(0.0, 24.0)).cos())
}

fn voltage() -> Voltage {
    let time: Vec<f64> = (0..=27_000).map(|i| i as f64 * 1e-3).collect();
    let phi = time.iter().map(|&t| drive(t)).collect();
    Voltage::new(time, vec![phi], false)
}

fn sample(electrode: Electrode) -> HangingSample {
    HangingSample {
        width_m: 0.045,
        length_m: 0.06,
        margin_m: 0.003,
        l3_m: 1e-4,
        films: 1.0,
        eps_r: 2.8,
        mass_kg: 0.05,
        electrode,
    }
}

fn film(scale: f64) -> Film {
    Film {
        mu_pa: [4.3e5, 3e4, 2.5e4, 2e4, 2e4, 1.5e4, 1.5e4]
            .map(|m| m * scale)
            .to_vec(),
        relaxation_time_s: vec![0.02, 0.12, 0.7, 4.0, 25.0, 150.0],
        locking: 80.0,
    }
}

/// x of a sample at 100 Hz without noise, and its length at rest.
fn motion(film: &Film, sample: HangingSample) -> (Vec<f64>, f64) {
    let options = SampleOptions {
        duration_s: SECONDS,
        tolerance_m: 1e-8,
        ..SampleOptions::default()
    };
    let m = sample_motion(&sample, film, &Smooth(|t| [drive(t); 3]), &options).unwrap();
    (m.x_m, m.rest_length_m)
}

/// Mean of the first eight strokes of a motion without noise.
fn true_stroke(x: &[f64]) -> f64 {
    (0..8)
        .map(|i| {
            let own = &x[100 + 300 * i..=400 + 300 * i];
            own.iter().copied().fold(f64::NEG_INFINITY, f64::max)
                - own.iter().copied().fold(f64::INFINITY, f64::min)
        })
        .sum::<f64>()
        / 8.0
}

fn noisy(x: &[f64], noise_m: f64, seed: u64) -> Vec<f64> {
    let mut generator = ChaCha12Rng::seed_from_u64(seed);
    x.iter()
        .map(|x| {
            let z: f64 = StandardNormal.sample(&mut generator);
            x + noise_m * z
        })
        .collect()
}

#[test]
fn strokes_are_free_of_the_captures_noise() {
    let cycles = cycles(&voltage(), 0.0, 0.0, SECONDS).unwrap();
    for electrode in [
        Electrode::IDEAL,
        Electrode {
            modulus_pa: 6e5,
            resistance_ohm: 3e8,
            active_fraction: 1.0,
        },
    ] {
        let (x, _) = motion(&film(1.0), sample(electrode));
        let truth = true_stroke(&x);
        let found = strokes(&x, 0.0, 0.01, &cycles, 8).unwrap();
        assert_eq!(found.cycles.len(), 8);
        let clean = found.mean.value - truth;
        for (noise_m, limit_m) in [(3e-5, 2e-6), (1e-4, 1e-5)] {
            let runs = 100;
            let mut sum = 0.0;
            let mut raw = 0.0;
            let mut covered = 0;
            for seed in 0..runs {
                let s = strokes(&noisy(&x, noise_m, seed), 0.0, 0.01, &cycles, 8).unwrap();
                sum += s.mean.value - truth;
                raw += s.cycles.iter().map(|c| c.raw_m).sum::<f64>() / 8.0 - truth;
                let [a, b] = s.mean.ci95();
                covered += usize::from(a < truth && truth < b);
            }
            let (bias, raw) = (sum / runs as f64, raw / runs as f64);
            eprintln!(
                "stroke {:.4} mm, noise {:.2} mm: bias {:+.5} mm (without noise {:+.5}), of max minus min {:+.4}, covered {covered} of {runs}",
                truth * 1e3,
                noise_m * 1e3,
                bias * 1e3,
                clean * 1e3,
                raw * 1e3
            );
            assert!(bias.abs() < limit_m, "{bias:e}");
            assert!(raw > 2.5 * noise_m);
            assert!(covered >= 88, "{covered}");
        }
    }
}

/// A campaign: what was done to one electrode over some days, and what was found.
struct Campaign {
    truth: Vec<Cause>,
    /// Its sizes, in words.
    sizes: String,
    /// Whether the sample stayed in its frame, and the program was told so.
    stays: bool,
    named: Vec<Cause>,
    /// Causes that are not named, each with those that could stand for it.
    groups: Vec<Vec<Cause>>,
    /// True change to the last day, interval found, of every cause of a model with the right causes.
    intervals: Vec<(Cause, f64, [f64; 2])>,
    /// Loss of stroke on each later day: true, and its interval, %.
    losses: Vec<(f64, [f64; 2])>,
}

impl Campaign {
    /// Every true cause is named or in a group of its own, and nothing else is said.
    fn said(&self) -> bool {
        let named = |c: &Cause| self.named.contains(c);
        self.named.iter().all(|c| self.truth.contains(c))
            && self.named.len() + self.groups.len() == self.truth.len()
            && self
                .truth
                .iter()
                .all(|c| named(c) || self.groups.iter().any(|g| g.contains(c)))
    }
}

/// Nothing in this file or in the program was chosen on these.
const FIRST_SEED: u64 = 0x0f19_0000;

fn campaign(first_seed: u64, seed: u64) -> Campaign {
    let mut g = ChaCha12Rng::seed_from_u64(first_seed + seed);
    // Films of other moduli, relaxation times and thickness, under other masses: nothing of it is known to
    // the fit but what a rig file states.
    let mut film = film(g.random_range(0.85..1.15));
    for mu in &mut film.mu_pa[1..] {
        *mu *= g.random_range(0.6..1.5);
    }
    let slower: f64 = g.random_range(0.7..1.4);
    for t in &mut film.relaxation_time_s {
        *t *= slower;
    }
    let rig = HangingSample {
        l3_m: g.random_range(9e-5..1.1e-4),
        mass_kg: g.random_range(0.035..0.065),
        ..sample(Electrode::IDEAL)
    };
    let calendars: [&[f64]; 4] = [
        &[1.0, 3.0, 7.0, 14.0],
        &[0.0, 2.0, 9.0],
        &[1.0, 2.0, 5.0, 10.0, 21.0],
        &[1.0, 4.0, 8.0, 15.0],
    ];
    let days = calendars[g.random_range(0..4)];
    let truth: Vec<Cause> = match seed % 7 {
        0 => vec![Cause::ElectrodeStiffness],
        1 => vec![Cause::SeriesResistance],
        2 => vec![Cause::ActiveArea],
        3 => vec![Cause::ElectrodeStiffness, Cause::SeriesResistance],
        4 => vec![Cause::ElectrodeStiffness, Cause::ActiveArea],
        5 => vec![Cause::SeriesResistance, Cause::ActiveArea],
        _ => Vec::new(),
    };
    let layer: f64 = g.random_range(0.0..1e4);
    let wire: f64 = g.random_range(2e6..1e7);
    let mut size = |low: f64, high: f64| {
        let share: f64 = g.random_range(0.0..1.0);
        low * (high / low).powf(share)
    };
    let (stiffer, resists, lost) = (size(6e4, 6e5), size(5e7, 4e8), size(0.05, 0.4));
    let has = |c: Cause, size: f64| if truth.contains(&c) { size } else { 0.0 };
    let shape: f64 = g.random_range(0.5..1.5);
    // Half of the campaigns leave their samples in the frame and say so; half hang them anew, to 0.3 mm, and
    // do not.
    let stays = g.random_range(0..2) == 0;
    let mount_m = if stays { 3e-5 } else { 3e-4 };
    let mut inputs = Vec::new();
    let mut strokes_m = Vec::new();
    for (i, &day) in days.iter().enumerate() {
        let share = ((day - days[0]) / (days[days.len() - 1] - days[0])).powf(shape);
        let electrode = Electrode {
            modulus_pa: layer + has(Cause::ElectrodeStiffness, stiffer) * share,
            resistance_ohm: wire + has(Cause::SeriesResistance, resists) * share,
            active_fraction: 1.0 - has(Cause::ActiveArea, lost) * share,
        };
        let (x, rest) = motion(&film, HangingSample { electrode, ..rig });
        strokes_m.push(true_stroke(&x));
        let z: f64 = StandardNormal.sample(&mut g);
        let below: Vec<f64> = noisy(&x, 3e-5, first_seed + 1000 * seed + i as u64)
            .iter()
            .map(|x| x + rest + 6e-3 + mount_m * z)
            .collect();
        let dataset = HangingDataset::new(HangingParts {
            id: format!("day-{day}"),
            step_s: 0.01,
            start_s: 0.0,
            below_m: below,
            payload_kg: 0.0,
            voltage: voltage(),
            offset_s: Some(0.0),
        })
        .unwrap();
        inputs.push(AgeingInput {
            id: dataset.id.clone(),
            electrode: Some("E".into()),
            batch: Some("B".into()),
            day: Some(day),
            x_m: dataset.x_m.clone(),
            start_s: 0.0,
            step_s: 0.01,
            cycles: cycles(&dataset.voltage, 0.0, 0.0, SECONDS),
            command_v: Vec::new(),
            subject: AgeingSubject::Sample(Box::new(dataset), rig),
        });
    }
    let request = AgeingRequest {
        mount_m: stays.then_some(mount_m),
        ..AgeingRequest::default()
    };
    let outcome = ageing(&inputs, &request).unwrap();
    let e = &outcome.electrodes[0];
    let (_, joint) = e.main().unwrap();
    let sorted = |mut v: Vec<Cause>| {
        v.sort();
        v
    };
    let truth = sorted(truth);
    let sizes: Vec<String> = truth
        .iter()
        .map(|c| match c {
            Cause::ElectrodeStiffness => format!("stiffer by {:.2} MPa", stiffer / 1e6),
            Cause::SeriesResistance => format!("{:.0} Mohm", resists / 1e6),
            _ => format!("{:.0} % of area lost", 100.0 * lost),
        })
        .collect();
    let change = |c: Cause| match c {
        Cause::ElectrodeStiffness => stiffer,
        Cause::SeriesResistance => resists,
        _ => -lost,
    };
    let model = || joint.causes.iter().filter(|c| c.in_model);
    Campaign {
        intervals: match sorted(model().map(|c| c.cause).collect()) == truth {
            false => Vec::new(),
            true => model()
                .map(|c| (c.cause, change(c.cause), c.change.last().unwrap().ci95()))
                .collect(),
        },
        losses: (1..days.len())
            .map(|i| {
                let loss = 100.0 * (strokes_m[i] / strokes_m[0] - 1.0);
                (loss, e.levels[i].percent_ci95)
            })
            .collect(),
        named: sorted(named(joint)),
        groups: open(joint),
        truth,
        sizes: format!("{} over {} days", sizes.join(" and "), days.len()),
        stays,
    }
}

#[test]
fn causes_of_simulated_campaigns_are_found() {
    let count: u64 = std::env::var("DEACAL_CAMPAIGNS")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(14);
    let long = count >= 100;
    let first_seed = std::env::var("DEACAL_CAMPAIGN_SEED")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(FIRST_SEED);
    let all: Vec<Campaign> = (0..count)
        .into_par_iter()
        .map(|seed| campaign(first_seed, seed))
        .collect();
    for c in all.iter().filter(|c| c.named != c.truth) {
        let where_ = if c.stays { "in its frame" } else { "hung anew" };
        eprintln!(
            "  {where_}: {} was named {:?}, in doubt {:?}",
            c.sizes, c.named, c.groups
        );
    }
    let share = |hits: usize, n: usize| 100.0 * hits as f64 / n.max(1) as f64;
    // Right alone, right or in its group, of so many that aged.
    let score = |stays: Option<bool>| {
        let own = all
            .iter()
            .filter(|c| !c.truth.is_empty() && stays.is_none_or(|s| s == c.stays));
        let (mut right, mut said, mut n) = (0, 0, 0);
        for c in own {
            n += 1;
            right += usize::from(c.named == c.truth);
            said += usize::from(c.named == c.truth || c.said());
        }
        (right, said, n)
    };
    for (words, stays) in [
        ("in their frames", Some(true)),
        ("hung anew", Some(false)),
        ("all", None),
    ] {
        let (right, said, n) = score(stays);
        eprintln!(
            "{words}: right cause {right} of {n} ({:.1} %), right or in its group {said} ({:.1} %)",
            share(right, n),
            share(said, n)
        );
    }
    let none = all.iter().filter(|c| c.truth.is_empty()).count();
    let false_alarms = all
        .iter()
        .filter(|c| c.truth.is_empty() && !c.named.is_empty())
        .count();
    let wrong = all
        .iter()
        .filter(|c| c.named.iter().any(|n| !c.truth.contains(n)))
        .count();
    let intervals: Vec<_> = all.iter().flat_map(|c| &c.intervals).collect();
    let hits = |list: &[&(Cause, f64, [f64; 2])]| {
        list.iter()
            .filter(|(_, t, [a, b])| a <= t && t <= b)
            .count()
    };
    for cause in [
        Cause::ElectrodeStiffness,
        Cause::SeriesResistance,
        Cause::ActiveArea,
    ] {
        let own: Vec<_> = intervals.iter().filter(|i| i.0 == cause).copied().collect();
        eprintln!(
            "  {cause:?}: {} of {} intervals hold",
            hits(&own),
            own.len()
        );
    }
    let losses: Vec<_> = all.iter().flat_map(|c| &c.losses).collect();
    let held = losses.iter().filter(|(t, [a, b])| a <= t && t <= b).count();
    eprintln!(
        "{} campaigns: false difference {false_alarms} of {none}, something named that is not there {wrong}, intervals of causes {} of {} ({:.1} %), of losses {held} of {} ({:.1} %)",
        all.len(),
        hits(&intervals),
        intervals.len(),
        share(hits(&intervals), intervals.len()),
        losses.len(),
        share(held, losses.len())
    );
    let between =
        |value: f64, low: f64, high: f64| assert!((low..=high).contains(&value), "{value}");
    if long {
        let ((frame, _, frames), (_, said, n)) = (score(Some(true)), score(None));
        // Wanted are 90 % right alone. Measured on 500: 92.3 % (192 of 208) in their frames, 67.9 % hung
        // anew, 79.7 % of all; these are floors.
        between(share(frame, frames), 88.0, 100.0);
        between(share(said, n), 85.0, 100.0);
        between(share(wrong, all.len()), 0.0, 5.0);
        between(share(false_alarms, none), 0.0, 5.0);
        between(share(held, losses.len()), 93.0, 97.0);
        between(share(hits(&intervals), intervals.len()), 93.0, 97.0);
    } else {
        let (right, said, n) = score(None);
        between(share(right, n), 50.0, 100.0);
        between(share(said, n), 65.0, 100.0);
        assert_eq!(false_alarms, 0);
        between(share(held, losses.len()), 85.0, 100.0);
        between(share(hits(&intervals), intervals.len()), 75.0, 100.0);
    }
}

/// A robot whose electrodes all age alike, over three days: six cycles of the paper's drive.
fn robot_days(
    robot: &Robot,
    nominal: &Parameters,
    aged: &[(&str, [f64; 3])],
    seed: u64,
) -> Vec<AgeingInput> {
    let (days, length_s) = ([1.0, 3.0, 7.0], 19.0);
    let drive = Drive::Sine {
        peak_v: [5000.0; 3],
        frequency_hz: 1.0 / 3.0,
        phase_rad: [0.0; 3],
    };
    let log = drive.sampled(length_s, 1000.0).unwrap();
    let one = |i: usize| {
        let mut truth = nominal.clone();
        let mut effects = Vec::new();
        for (id, values) in aged {
            match by_id(id) {
                Some(effect) => effects.push(Acting {
                    effect,
                    values: match effect.parameters().len() {
                        1 => vec![values[i]],
                        2 => vec![values[i], 0.0],
                        _ => vec![values[i], -1e6, 0.0],
                    },
                    on: [true; 3],
                }),
                None => truth.film.mu_pa.iter_mut().for_each(|mu| *mu *= values[i]),
            }
        }
        let options = Options {
            duration_s: length_s,
            ..Options::default()
        };
        let when = When::default();
        let (m, ended) =
            motion_with_effects(robot, &truth, &log, &options, &effects, when, [0.0; 3]).unwrap();
        assert!(ended.is_none());
        let mut g = ChaCha12Rng::seed_from_u64(seed + i as u64);
        let mut noisy = |u: &[f64; 3]| {
            u.map(|v| {
                let z: f64 = StandardNormal.sample(&mut g);
                v + 3e-5 * z
            })
        };
        let measured_m: Vec<[f64; 3]> = m.position_m.iter().map(&mut noisy).collect();
        let samples = log.samples_v();
        let channel = |k: usize| samples.iter().map(|p| p[k]).collect();
        let time = (0..samples.len()).map(|i| i as f64 * 1e-3).collect();
        let dataset = Dataset::new(
            Parts {
                id: format!("day-{}", days[i]),
                step_s: 0.01,
                start_s: 0.0,
                payload_kg: vec![0.0; measured_m.len()],
                measured_m,
                voltage: Voltage::new(time, vec![channel(0), channel(1), channel(2)], false),
                monitor: None,
                offset_s: Some(0.0),
                initial: InitialState::Relaxed,
            },
            None,
        )
        .unwrap();
        AgeingInput {
            id: dataset.id.clone(),
            electrode: Some("E".into()),
            batch: None,
            day: Some(days[i]),
            x_m: dataset.measured_m.iter().map(|p| -p[2]).collect(),
            start_s: 0.0,
            step_s: 0.01,
            cycles: cycles(&dataset.voltage, 0.0, 0.0, length_s),
            command_v: Vec::new(),
            subject: AgeingSubject::Robot(Box::new(dataset), Box::new(robot.clone())),
        }
    };
    (0..3).into_par_iter().map(one).collect()
}

#[test]
fn what_aged_in_a_robot_is_named_with_its_size() {
    let g = common::golden("forward_dynamics");
    let (robot, nominal) = (common::robot(&g["rig"]), common::parameters(&g));
    type Aged = (&'static str, [f64; 3]);
    type Case = (&'static [Aged], Option<(Cause, f64)>);
    const WIRE: Aged = ("series_resistance", [2e6; 3]);
    let cases: [Case; 4] = [
        (&[WIRE], None),
        (
            &[("series_resistance", [2e6, 8e6, 2e7])],
            Some((Cause::SeriesResistance, 1.8e7)),
        ),
        (
            &[("electrode_stiffness", [0.0, 1e4, 3e4]), WIRE],
            Some((Cause::ElectrodeStiffness, 3e4)),
        ),
        (
            &[("electrode_failure", [0.0, 0.0, 0.1]), WIRE],
            Some((Cause::ActiveArea, -0.1)),
        ),
    ];
    for (number, (aged, wanted)) in cases.iter().enumerate() {
        let inputs = robot_days(&robot, &nominal, aged, 100 * number as u64);
        let outcome = ageing(&inputs, &AgeingRequest::default()).unwrap();
        let e = &outcome.electrodes[0];
        let joint = e.samples[0].joint.as_ref().unwrap();
        eprintln!(
            "{} {:.2} of the noise left ({:.2} with nothing allowed to change), {} evaluations",
            outcome.verdict,
            joint.weighted_mean_square,
            joint.unchanged_mean_square,
            joint.evaluations,
        );
        assert!(open(joint).is_empty(), "{:?}", open(joint));
        let Some((cause, size)) = wanted else {
            assert_eq!(named(joint), []);
            continue;
        };
        assert_eq!(named(joint), [*cause]);
        let found = joint.causes.iter().find(|c| c.cause == *cause).unwrap();
        let change = found.change[2];
        assert!(
            (change.value / size - 1.0).abs() < 0.2,
            "{change:?} {size:e}"
        );
        assert!(change.std_error < 0.1 * size.abs(), "{change:?}");
    }

    // What cannot be one film is said, and the strokes are compared all the same.
    let mut inputs = robot_days(&robot, &nominal, &[WIRE], 7);
    let mut heavier = robot.clone();
    heavier.effector_kg *= 1.1;
    let AgeingSubject::Robot(_, own) = &mut inputs[1].subject else {
        panic!("a robot")
    };
    **own = heavier;
    let outcome = ageing(&inputs, &AgeingRequest::default()).unwrap();
    let why = outcome.electrodes[0].samples[0].joint.as_ref().unwrap_err();
    assert!(why.contains("`day-1` and `day-3` differ"), "{why}");
    assert_eq!(outcome.electrodes[0].levels.len(), 3);
}

/// A robot through files: what is written for a day predicts that day's voltages.
#[test]
fn the_parameters_of_a_robots_day_predict_its_voltages() {
    let g = common::golden("forward_dynamics");
    let f = Folder::new();
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/twin2026_delta/rig.toml");
    let text = ParameterFile::of(&common::parameters(&g), None)
        .to_toml()
        .unwrap();
    fs::write(f.path().join("film.toml"), text).unwrap();
    for (day, resistance) in [("1", "2e6"), ("5", "6e7")] {
        let effect = format!("series_resistance:resistance={resistance}");
        let line = format!(
            "simulate --params film.toml --drive sine:peak_V=5000,hz=0.333333333333 --duration 19 --noise 0.03 --electrode A --id d{day} --day {day} --seed {day} -o d{day}"
        );
        let mut arguments: Vec<&str> = line.split(' ').collect();
        arguments.extend(["--rig", rig.to_str().unwrap(), "--effect", &effect]);
        let (code, _, error) = f.run(&arguments);
        assert_eq!(code, 0, "{error}");
    }
    let (code, json, error) = f.run(&["ageing", "d1", "d5", "-o", "out", "--json"]);
    assert_eq!(code, 0, "{error}");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let first = &json["causes"]["A"][0];
    assert_eq!(first["effect"], "series_resistance", "{first}");
    let change = first["by_day"][1]["change"]["value"].as_f64().unwrap();
    assert!((change / 5.8e7 - 1.0).abs() < 0.2, "{change}");
    assert_eq!(
        json["samples"]["A"][0]["rest_shift_mm"],
        serde_json::json!([])
    );
    let report = fs::read_to_string(f.path().join("out/report.html")).unwrap();
    assert!(report.contains("the pose at rest is part of what is fitted"));
    let rmse = |day: &str, parameters: &str| {
        let line = format!("validate {day} --params {parameters} --json -o validated");
        let (code, json, error) = f.run(&line.split(' ').collect::<Vec<_>>());
        assert_eq!(code, 0, "{error}");
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        json["rmse_V"]
            .as_f64()
            .unwrap_or_else(|| panic!("{json:#}"))
    };
    let [first, last] = ["1", "5"].map(|d| format!("out/A-day-{d}/parameters.toml"));
    let (own, other) = (rmse("d5", &last), rmse("d5", &first));
    assert!(own < 0.1 * other, "{own} {other}");
}

/// The twin's two samples, if the folder that `DEACAL_SHARED` names is there: the paper's losses, and what
/// made them.
#[test]
fn the_twins_losses_and_causes_are_those_of_the_paper() {
    let Some(shared) = std::env::var_os("DEACAL_SHARED") else {
        eprintln!("skipped: DEACAL_SHARED is not set");
        return;
    };
    let twin = Path::new(&shared).join("datasets/twin/ageing");
    let out = tempfile::tempdir().unwrap();
    let recordings: Vec<_> = ["cge", "dcpe"]
        .iter()
        .flat_map(|e| ["01", "03", "07", "14"].map(|d| twin.join(format!("{e}-day{d}"))))
        .collect();
    let done = common::run(|deacal| {
        deacal
            .arg("ageing")
            .args(&recordings)
            .arg("--json")
            .arg("-o")
            .arg(out.path().join("ageing"))
    });
    let json: serde_json::Value = serde_json::from_slice(&done).unwrap();
    let mut outside = 0;
    for (electrode, losses) in [("CGE", [17.5, 38.4, 64.3]), ("DCPE", [1.8, 3.7, 5.2])] {
        for (i, loss) in losses.into_iter().enumerate() {
            let change = &json["electrodes"][electrode][i + 1]["change_percent"];
            let found = change["value"].as_f64().unwrap();
            assert!(
                (found + loss).abs() < 1.0,
                "{electrode}: {found} for -{loss}"
            );
            let [a, b] = [0, 1].map(|k| change["ci95"][k].as_f64().unwrap());
            outside += usize::from(!(a..=b).contains(&-loss));
        }
    }
    assert!(outside <= 1, "{outside} of 6 outside their intervals");
    let mut found: Vec<&str> = json["causes"]["CGE"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|c| c["in_model"] == true && c["probability"].as_f64().unwrap() > 0.95)
        .map(|c| c["effect"].as_str().unwrap())
        .collect();
    found.sort_unstable();
    assert_eq!(found, ["electrode_stiffness", "series_resistance"]);
    assert!(
        json["samples"]["CGE"][0]["indistinguishable"]
            .as_array()
            .unwrap()
            .is_empty()
    );
    assert!(json["difference"]["p_value"].as_f64().unwrap() < 1e-6);
    assert!(json["remarks"].to_string().contains("thickness"));
}

const RIG: &str = "[rig]\nid = \"hanging\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\nmargin_mm = 3.0\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n";

/// A folder of recordings, as instruments would write them.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("rig.toml"), RIG).unwrap();
        Folder(dir)
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn record(&self, id: &str, labels: &[(&str, &str)], electrode: Electrode, seed: u64) -> &Self {
        let samples: Vec<[f64; 3]> = (0..=27_000).map(|i| [drive(i as f64 * 1e-3); 3]).collect();
        let voltage = Sampled::new(0.0, 1e-3, samples, Hold::Linear).unwrap();
        let capture = Capture {
            noise: Noise {
                white_m: 3e-5,
                ..Noise::default()
            },
            seed,
            ..Capture::default()
        };
        let text = RecordingText {
            id: id.into(),
            rig: "../rig.toml".into(),
            labels: labels
                .iter()
                .map(|(k, v)| ((*k).into(), (*v).into()))
                .collect(),
            ..RecordingText::default()
        };
        let log = VoltageLog::default();
        let files = sample_recording(
            &sample(electrode),
            &film(1.0),
            &voltage,
            0.1,
            &capture,
            &text,
            &log,
        )
        .unwrap();
        let dir = self.path().join(id);
        fs::create_dir_all(&dir).unwrap();
        fs::write(dir.join("recording.toml"), files.recording_toml).unwrap();
        fs::write(dir.join("motion.csv"), files.motion_csv).unwrap();
        fs::write(dir.join("voltage.csv"), files.voltage_csv).unwrap();
        self
    }

    fn edit(&self, file: &str, change: impl Fn(String) -> String) {
        let path = self.path().join(file);
        let old = fs::read_to_string(&path).unwrap();
        let new = change(old.clone());
        assert_ne!(old, new, "the edit of {file} must change it");
        fs::write(path, new).unwrap();
    }

    /// Exit status, standard output, standard error.
    fn run(&self, arguments: &[&str]) -> (i32, String, String) {
        let mut command = std::process::Command::cargo_bin("deacal").unwrap();
        let out = command
            .current_dir(self.path())
            .args(arguments)
            .output()
            .unwrap();
        let text = |b: Vec<u8>| String::from_utf8(b).unwrap();
        (
            out.status.code().unwrap(),
            text(out.stdout),
            text(out.stderr),
        )
    }
}

fn stiff(modulus_pa: f64) -> Electrode {
    Electrode {
        modulus_pa,
        ..Electrode::IDEAL
    }
}

#[test]
fn the_program_compares_electrodes_and_says_what_it_left_out() {
    let f = Folder::new();
    let day = |e: &'static str, d: &'static str| [("batch", e), ("electrode", e), ("day", d)];
    f.record("a1", &day("A", "1"), stiff(0.0), 1)
        .record("a3", &day("A", "3"), stiff(1.5e5), 2)
        .record("a7", &day("A", "7"), stiff(3e5), 3)
        .record("b1", &day("B", "1"), stiff(0.0), 4)
        .record("b7", &day("B", "7"), stiff(0.0), 5);
    let (code, json, error) = f.run(&[
        "ageing", "a1", "a3", "a7", "b1", "b7", "-o", "out", "--json",
    ]);
    assert_eq!(code, 0, "{error}");
    common::check("ageing", &json);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let a = &json["electrodes"]["A"];
    assert_eq!(a.as_array().unwrap().len(), 3);
    assert_eq!(a[2]["day"], 7.0);
    assert!(a[2]["change_percent"]["value"].as_f64().unwrap() < -20.0);
    assert_eq!(a[2]["significant"], true);
    assert_eq!(a[2]["relevant"], true);
    assert_eq!(json["electrodes"]["B"][1]["relevant"], false);
    let cause = &json["causes"]["A"][0];
    assert_eq!(cause["effect"], "electrode_stiffness");
    let change = cause["by_day"][2]["change"]["value"].as_f64().unwrap();
    assert!((change / 3e5 - 1.0).abs() < 0.1, "{change}");
    for c in json["causes"]["B"].as_array().unwrap() {
        assert_eq!(c["in_model"], false, "{c}");
    }
    // B has no day 3: the test is at day 7 alone.
    assert_eq!(json["difference"]["all"].as_array().unwrap().len(), 1);
    assert!(json["difference"]["p_value"].as_f64().unwrap() < 1e-6);
    for file in [
        "ageing.json",
        "report.html",
        "A-day-7/parameters.toml",
        "B-day-1/parameters.toml",
    ] {
        assert!(f.path().join("out").join(file).is_file(), "{file}");
    }
    // The parameters of a day predict that day.
    let (code, json, error) = f.run(&[
        "validate",
        "a7",
        "--params",
        "out/A-day-7/parameters.toml",
        "-o",
        "v",
        "--json",
    ]);
    assert_eq!(code, 0, "{error}");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let stroke = &json["recordings"][0]["stroke_mm"];
    let (x, y) = (
        stroke["recorded"].as_f64().unwrap(),
        stroke["predicted"].as_f64().unwrap(),
    );
    assert!((x - y).abs() < 0.05, "{x} {y}");

    // One day only; no electrode; no day; one electrode without a second day beside one with.
    let (code, _, error) = f.run(&["ageing", "a1", "-o", "never"]);
    assert_eq!(code, 1);
    assert!(
        error.contains("only") && error.contains("two days"),
        "{error}"
    );
    let (code, _, error) = f.run(&["ageing", "a1", "a3", "b1", "-o", "some"]);
    assert_eq!(code, 0, "{error}");
    f.edit("a3/recording.toml", |t| {
        t.replace("electrode = \"A\"\n", "")
    });
    let (code, _, error) = f.run(&["ageing", "a1", "a3", "-o", "never"]);
    assert_eq!(code, 1);
    assert!(error.contains("states no electrode"), "{error}");
    f.edit("b7/recording.toml", |t| t.replace("day = 7\n", ""));
    let (code, _, error) = f.run(&["ageing", "b1", "b7", "-o", "never"]);
    assert_eq!(code, 1);
    assert!(error.contains("states no day"), "{error}");
    assert!(!f.path().join("never").exists());
}

#[test]
fn short_broken_and_renamed_runs_are_handled() {
    let f = Folder::new();
    let day = |b: &'static str, d: &'static str| [("batch", b), ("electrode", "A"), ("day", d)];
    f.record("d1", &day("one", "1"), stiff(0.0), 1)
        .record("d3", &day("two", "3"), stiff(2e5), 2)
        .record("d7", &day("three", "7"), stiff(4e5), 3);
    // Day 3 ends after five cycles; from 13 s on the sample of day 7 hangs dead.
    f.edit("d3/motion.csv", |t| {
        t.lines().take(5 + 1650).collect::<Vec<_>>().join("\r\n") + "\r\n"
    });
    f.edit("d7/motion.csv", |t| {
        let lines: Vec<&str> = t.lines().collect();
        let dead = lines[5 + 1300].split_once(',').unwrap().1.to_owned();
        lines
            .iter()
            .enumerate()
            .map(|(i, l)| match i > 5 + 1300 {
                true => format!("{},{dead}", l.split_once(',').unwrap().0),
                false => (*l).to_string(),
            })
            .collect::<Vec<_>>()
            .join("\r\n")
            + "\r\n"
    });
    let (code, json, error) = f.run(&["ageing", "d1", "d3", "d7", "-o", "out", "--json"]);
    assert_eq!(code, 0, "{error}");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["cycles"]["A"], 4);
    let remarks = json["remarks"].to_string();
    assert!(remarks.contains("changed its name"), "{remarks}");
    assert!(remarks.contains("fails in cycle 5"), "{remarks}");
    assert!(remarks.contains("intact cycles"), "{remarks}");
    let last = &json["electrodes"]["A"][2];
    let (x, _) = motion(&film(1.0), sample(stiff(4e5)));
    let (x0, _) = motion(&film(1.0), sample(stiff(0.0)));
    let mean = |x: &[f64]| {
        (0..4)
            .map(|i| {
                let own = &x[100 + 300 * i..=400 + 300 * i];
                own.iter().copied().fold(f64::NEG_INFINITY, f64::max)
                    - own.iter().copied().fold(f64::INFINITY, f64::min)
            })
            .sum::<f64>()
    };
    let truth = 100.0 * (mean(&x) / mean(&x0) - 1.0);
    assert!(
        (last["change_percent"]["value"].as_f64().unwrap() - truth).abs() < 1.0,
        "{last} {truth}"
    );
    // Twelve seconds of the last day are little to tell causes by; that something changed is plain.
    let sample = &json["samples"]["A"][0];
    let misfit = sample["weighted_mean_square"].as_f64().unwrap();
    assert!(misfit < 2.0, "{sample}");
    assert!(sample["nothing"].as_f64().unwrap() < 1e-6, "{sample}");

    // By batch the same recordings are three batches.
    let (code, json, error) = f.run(&[
        "ageing", "d1", "d3", "--by", "batch", "-o", "batch", "--json",
    ]);
    assert_eq!(code, 0, "{error}");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["by"], "batch");
    assert_eq!(json["electrodes"]["A"][1]["batch"], "two");
    assert!(f.path().join("batch/A-two/parameters.toml").is_file());
    // A voltage without cycles has no stroke.
    f.edit("d1/voltage.csv", |t| {
        t.lines()
            .enumerate()
            .map(|(i, l)| match i {
                0 => l.to_string(),
                _ => format!("{},3.0", l.split_once(',').unwrap().0),
            })
            .collect::<Vec<_>>()
            .join("\n")
            + "\n"
    });
    let (code, _, error) = f.run(&["ageing", "d1", "d3", "-o", "never"]);
    assert_eq!(code, 1);
    assert!(error.contains("day 3 only"), "{error}");
}
