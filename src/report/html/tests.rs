//! The whole report, of outcomes made up for the purpose.

use super::Provenance;
use crate::calibration::{
    AtBound, ChainError, Estimate, Outcome, RecordingOutcome, StartOutcome, WeakDirection,
    WorstPlace,
};
use crate::dataset::{Plan, SmoothingPlan};
use crate::film::Film;
use crate::model::{Contribution, ForearmTorque, Parameters};
use crate::report::answer::Answer;
use crate::report::provenance::{FileSum, RecordingSum};

const HOSTILE: &str = "run <b>7</b> & \"x\" 'y'";

fn estimate(name: &str, unit: &'static str, value: f64) -> Estimate {
    Estimate {
        name: name.into(),
        meaning: "modulus of <it>".into(),
        unit: unit.into(),
        value,
        std_error: 0.01 * value,
        ci95: [0.98 * value, 1.02 * value],
        at_bound: None,
        identifiable: true,
        fixed: false,
        says: "determined to 1.0 %".into(),
    }
}

fn recording(id: &str, frames: usize) -> RecordingOutcome {
    let time_s: Vec<f64> = (0..frames).map(|i| i as f64 * 0.01).collect();
    let drive = |t: f64| 2750.0 - 2750.0 * (2.0 * std::f64::consts::PI * t / 3.0).cos();
    // a coarse but repeatable noise
    let noise = |i: usize| ((i * 7919) % 97) as f64 - 48.0;
    let command_v: Vec<[f64; 3]> = time_s.iter().map(|t| [drive(*t); 3]).collect();
    let predicted_v: Vec<[f64; 3]> = (0..frames)
        .map(|i| [0, 1, 2].map(|k| command_v[i][k] + noise(i + k)))
        .collect();
    let error = ChainError {
        rmse_v: 28.0,
        max_error_v: 49.0,
        samples: frames * 2 / 3,
        rmse_all_v: 30.0,
        samples_all: frames,
        noise_floor_v: 14.0,
        negative: 3,
    };
    RecordingOutcome {
        id: id.into(),
        chains: [error; 3],
        total: error,
        offset_s: 0.0123,
        offset_std_error_s: Some(0.0004),
        plan: Plan {
            recording: id.into(),
            smoothing: vec![
                SmoothingPlan {
                    order: 4,
                    cutoff_hz: 2.5,
                    noise_mm: 0.03,
                    follows: false,
                };
                3
            ],
            criterion: "largest likelihood".into(),
            offset_s: None,
            sync: None,
            stretches: None,
        },
        position_mm: time_s
            .iter()
            .map(|t| [0.0, 0.0, -40.0 - drive(*t) / 200.0])
            .collect(),
        predicted_squared_v2: predicted_v.iter().map(|p| p.map(|v| v * v)).collect(),
        sd_v: vec![[14.0; 3]; frames],
        monitor_v: Some(command_v.clone()),
        command_v,
        predicted_v,
        counts: (0..frames).map(|i| i > 30 && i + 30 < frames).collect(),
        gap: (0..frames).map(|i| (100..110).contains(&i)).collect(),
        unreachable: vec![(50, "arm too short".into())],
        contributions_n_m: Contribution::ALL
            .iter()
            .map(|c| (c.name().to_string(), [0.05, 0.02, 0.0]))
            .collect(),
        swing_deg: vec![[1.0; 3]; frames],
        gaps: vec![(100, 10)],
        cycles_s: (0..6).map(f64::from).collect(),
        notes: vec!["the offset is NaN in one place".into()],
        time_s,
    }
}

fn full(frames: usize) -> Outcome {
    let mut at_bound = estimate("mu_3", "Pa", 0.0);
    at_bound.at_bound = Some(AtBound::Lower);
    at_bound.std_error = f64::NAN;
    at_bound.identifiable = false;
    at_bound.says = "at zero: the recordings ask for no such branch".into();
    let mut open = estimate("T_1", "s", 0.02);
    open.identifiable = false;
    open.says = "not determined by these recordings (standard error 80 % of the value)".into();
    let mut held = estimate("J", "1", 80.0);
    held.fixed = true;
    held.std_error = f64::NAN;
    held.says = "held".into();
    let recordings: Vec<_> = (0..4)
        .map(|i| {
            recording(
                &if i == 0 {
                    HOSTILE.into()
                } else {
                    format!("rec-{i}")
                },
                frames,
            )
        })
        .collect();
    let total = recordings[0].total;
    let start = |cost: f64| StartOutcome {
        origin: "random 1".into(),
        cost,
        evaluations: 12,
        failed: 1,
        ended: "converged".into(),
        reached: vec![0.02, 80.0],
    };
    Outcome {
        job: "robot",
        parameters: Parameters {
            film: Film {
                mu_pa: vec![1.1e6, 2e5],
                relaxation_time_s: vec![0.02],
                locking: 80.0,
            },
            forearm: ForearmTorque::zero().with_torques(&[-1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3]),
        },
        eps_r: 2.8,
        estimates: vec![
            estimate("mu_1", "Pa", 1.1e6),
            at_bound,
            open,
            held,
            estimate("torque_0deg", "N m", 1e-4),
        ],
        correlation: (
            vec!["mu_1".into(), "T_1".into()],
            vec![vec![1.0, -0.9], vec![-0.9, 1.0]],
        ),
        weak_directions: vec![WeakDirection {
            relative_sd: 20.0,
            parts: vec![("mu_1".into(), 0.9)],
            says: "mu_1 up while T_1 down: these recordings say nothing about it".into(),
        }],
        recordings,
        total,
        starts: vec![start(1.0), start(1.0005), start(1.7), start(f64::NAN)],
        converged: true,
        reason: "converged: no parameter moves any more".into(),
        evaluations: 99,
        failed_evaluations: 4,
        weighted_mean_square: 1.1,
        noise_mean_square: 1.0,
        torque_band: (-30..=30)
            .map(|a| [f64::from(a), f64::from(a) * 0.03, 0.2])
            .collect(),
        swing_range_deg: [-12.0, 17.0],
        worst: vec![WorstPlace {
            place: format!("actuator 1 of {HOSTILE}"),
            ratio: 2.0,
            rmse_v: 28.0,
            share: 0.8,
        }],
        verdict: "The model does not fit: 28.0 V rms above 1 kV.".into(),
        remarks: vec!["at 3 samples phi^2 < 0".into()],
    }
}

fn empty() -> Outcome {
    let nothing = ChainError {
        rmse_v: f64::NAN,
        max_error_v: 0.0,
        samples: 0,
        rmse_all_v: f64::NAN,
        samples_all: 0,
        noise_floor_v: f64::NAN,
        negative: 0,
    };
    Outcome {
        job: "validate",
        estimates: Vec::new(),
        correlation: Default::default(),
        weak_directions: Vec::new(),
        recordings: Vec::new(),
        total: nothing,
        starts: Vec::new(),
        converged: false,
        reason: String::new(),
        evaluations: 0,
        failed_evaluations: 0,
        weighted_mean_square: f64::NAN,
        noise_mean_square: f64::NAN,
        torque_band: Vec::new(),
        swing_range_deg: [f64::INFINITY, f64::NEG_INFINITY],
        worst: Vec::new(),
        verdict: "No sample has a command above 1 kV: the fit cannot be judged in volts.".into(),
        remarks: Vec::new(),
        eps_r: f64::NAN,
        ..full(0)
    }
}

fn provenance() -> Provenance {
    let file = |path: &str, role: &str| FileSum {
        file: path.into(),
        role: role.into(),
        sha256: "00ff".repeat(16),
    };
    Provenance {
        program: "deacal 0.1.0".into(),
        command: "deacal fit robot 'a<b>' && more".into(),
        rig: Some(file("rig.toml", "rig")),
        recordings: vec![RecordingSum {
            id: HOSTILE.into(),
            files: vec![file("a&b/motion.csv", "motion")],
        }],
        rig_ids: vec!["delta-01".into()],
        days: vec!["2026-03-02".into()],
    }
}

fn render(outcome: &Outcome, provenance: &Provenance) -> String {
    let answer = Answer {
        says: outcome.verdict.clone(),
        ..Answer::default()
    };
    // a number and its unit stay in one line
    super::render(outcome, &answer, provenance).replace('\u{a0}', " ")
}

/// Opens and closes its tags in order, as far as a plain count can tell.
pub fn assert_balanced(html: &str) {
    let html = apart(html).0;
    let mut open: Vec<&str> = Vec::new();
    let mut rest = html.as_str();
    while let Some(start) = rest.find('<') {
        let end = start + rest[start..].find('>').expect("a tag ends");
        let tag = &rest[start + 1..end];
        rest = &rest[end + 1..];
        let name = tag.split([' ', '\n']).next().unwrap_or("");
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "closing tag in the wrong place");
        } else if !tag.ends_with('/') && !["!DOCTYPE", "meta"].contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?} stay open");
}

/// A page without its script, and the script.
fn apart(html: &str) -> (String, String) {
    let (before, rest) = html.split_once("<script>").unwrap_or((html, ""));
    let (script, after) = rest.split_once("</script>").unwrap_or(("", rest));
    ([before, after].concat(), script.into())
}

/// Nothing is fetched from anywhere.
pub fn assert_self_contained(html: &str) {
    let (html, script) = &apart(html);
    for absent in [
        "http",
        "import",
        "fetch",
        "src",
        "XMLHttp",
        "eval",
        "innerHTML",
    ] {
        assert!(!script.contains(absent), "{absent}");
    }
    for absent in [
        "http://",
        "https://",
        "@import",
        "url(",
        "<link",
        "src=",
        "javascript:",
        "//fonts",
    ] {
        assert!(!html.contains(absent), "{absent}");
    }
    assert!(!html.contains("NaN"));
    assert!(html.starts_with("<!DOCTYPE html>") && html.contains("<html lang=\"en\">"));
    assert!(html.contains("name=\"viewport\"") && html.contains("<title>"));
}

#[test]
fn a_full_outcome_has_every_section_and_needs_nothing_else() {
    let html = render(&full(3000), &provenance());
    assert_self_contained(&html);
    assert_balanced(&html);
    for anchor in [
        "summary",
        "recordings",
        "torque",
        "contributions",
        "starts",
        "parameters",
        "errors",
        "quality",
        "provenance",
    ] {
        assert_eq!(
            html.matches(&format!("id=\"{anchor}\"")).count(),
            1,
            "{anchor}"
        );
    }
    for words in [
        "does not fit",
        "28.0 V rms, 2.00 times the noise; 80 % of the excess",
        "2 of 4 starts reached the lowest cost",
        "at lower bound",
        "not determined",
        "badge held",
        "12.30 \u{b1} 0.40 ms",
        "from \u{2212}12.0 to 17.0 degrees",
        "no parameter moves any more",
        "arm too short",
        "n&#x2f;a in one place",
        "\u{3c6}\u{b2} &lt; 0",
        "1 gap in the capture, 10 frames",
        "4 of 99 evaluations failed",
        &"00ff".repeat(16),
        "delta-01 \u{b7} run",
        "recorded 2026-03-02",
    ] {
        assert!(html.contains(words), "{words}");
    }
    // every drawing is told in words
    assert_eq!(
        html.matches("role=\"img\"").count(),
        html.matches("<svg").count()
    );
    assert!(!html.contains("aria-label=\"\""));
    assert_eq!(
        html.matches("<figure").count(),
        html.matches("<figcaption").count()
    );
}

#[test]
fn cycles_are_judged_one_by_one_where_there_are_some() {
    let mut outcome = full(600);
    let cycles = |html: &str| html.matches("Error and noise of each cycle,").count();
    assert_eq!(cycles(&render(&outcome, &provenance())), 4);
    outcome.recordings[2].cycles_s = Vec::new();
    assert_eq!(cycles(&render(&outcome, &provenance())), 3);
    // each by itself: 3 V in the first second, 5 V in the next, 40 V after the last cycle
    let error = |t: f64| [3.0, 5.0, 40.0][t as usize];
    let samples: Vec<[f64; 3]> = (0..300)
        .map(|i| f64::from(i) * 0.01)
        .map(|t| [t, error(t), 1.0])
        .collect();
    let each = super::errors::Cycles {
        id: "a",
        time_s: &[0.0, 3.0],
        cycles_s: &[0.0, 1.0, 2.0],
        samples,
    };
    let html = super::errors::per_cycle(&[each]);
    assert!(
        html.contains("class=\"s-two\"") && html.contains("[0.0,5.5]"),
        "{html}"
    );
}

#[test]
fn what_others_wrote_is_escaped() {
    let html = render(&full(500), &provenance());
    assert!(!html.contains("<b>7") && !html.contains("a<b>") && !html.contains("<it>"));
    assert!(html.contains("run &lt;b&gt;7"));
}

#[test]
fn an_empty_outcome_says_so() {
    let html = render(&empty(), &Provenance::default());
    assert_self_contained(&html);
    assert_balanced(&html);
    assert!(html.contains("cannot be judged"));
    for anchor in ["recordings", "starts", "parameters", "errors", "quality"] {
        assert!(!html.contains(&format!("id=\"{anchor}\"")), "{anchor}");
    }
}

#[test]
fn missing_values_are_never_shown_as_such() {
    let mut outcome = full(400);
    let r = &mut outcome.recordings[0];
    for i in 0..400 {
        r.predicted_v[i] = [f64::NAN; 3];
        r.sd_v[i] = [f64::INFINITY; 3];
        r.position_mm[i] = [f64::NAN; 3];
    }
    r.total = ChainError {
        rmse_v: f64::NAN,
        noise_floor_v: f64::NAN,
        ..ChainError::default()
    };
    r.chains = [r.total; 3];
    r.offset_std_error_s = Some(f64::NAN);
    r.contributions_n_m[0].1 = [f64::NAN; 3];
    outcome.recordings[1] = recording("none", 0);
    outcome.recordings[2] = recording("one", 1);
    for e in &mut outcome.estimates {
        (e.std_error, e.ci95) = (f64::NAN, [f64::NAN, f64::INFINITY]);
        e.says = format!("determined to {} %", f64::NAN);
    }
    outcome.correlation.1[1][0] = f64::NAN;
    outcome.worst[0].ratio = f64::NAN;
    outcome.total.noise_floor_v = f64::NAN;
    outcome.eps_r = f64::NAN;
    let html = render(&outcome, &provenance());
    assert_self_contained(&html);
    assert_balanced(&html);
    assert!(!html.contains(">inf") && !html.contains(" inf "));
}

#[test]
fn four_long_recordings_stay_below_three_megabytes() {
    let html = render(&full(30_000), &provenance());
    assert!(html.len() < 3_000_000, "{} bytes", html.len());
}

#[test]
fn every_class_of_a_drawing_is_in_the_style_sheet() {
    let html = render(&full(300), &provenance());
    let style = include_str!("style.css");
    for piece in html.split("class=\"").skip(1) {
        let class = piece.split(['"', ' ']).next().unwrap_or("");
        if class.starts_with("s-") || class.starts_with("f-") {
            assert!(style.contains(&format!(".{class} {{")), "{class}");
        }
    }
    // a colour for light, for dark and for print
    for name in ["--ink:", "--one:", "--gap:", "--poor-back:"] {
        assert_eq!(style.matches(name).count(), 3, "{name}");
    }
}
