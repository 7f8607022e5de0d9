//! The files of a diagnosis, of one made up for the purpose. `DEACAL_WRITE_LOOK=DIR` also leaves the reports
//! there, to be looked at.

use crate::common;

use std::path::Path;

use deacal::diagnosis::{
    Candidate, Departed, Diagnosis, Evidence, Gain, Hidden, Law, LearntPhysics, LearntTerm, Place,
    Pose, RivalModel, Traces, Value, Verdict,
};
use deacal::effects::learnt::{Form, Learnt, Place as Site, Variable};
use deacal::effects::{Acting, by_id};
use deacal::film::Film;
use deacal::model::{ForearmTorque, Parameters, Robot};
use deacal::recording::Rig;
use deacal::report::diagnosis_json::DiagnosisJson;
use deacal::report::html::render_diagnosis;
use deacal::report::json::to_text;
use deacal::report::parameter_file::{ParameterFile, SeriesEntry};
use deacal::report::provenance::Provenance;

const HOSTILE: &str = "a/02-<b>sine</b>";

fn candidate(
    id: &str,
    on: [bool; 3],
    values: &[f64],
    probability: f64,
    in_model: bool,
) -> Candidate {
    let effect = by_id(id).unwrap();
    let acting = Acting {
        effect,
        values: values.to_vec(),
        on,
    };
    let values = effect
        .parameters()
        .iter()
        .zip(values)
        .map(|(q, &value)| {
            let word = match q.name {
                "recording" => Some(HOSTILE.to_string()),
                "link" => Some(effect.variants()[value as usize].to_string()),
                _ => None,
            };
            let std_error = if word.is_some() {
                f64::NAN
            } else {
                0.05 * value.abs()
            };
            Value {
                name: q.name,
                unit: q.unit.into(),
                value,
                fitted: value,
                word,
                std_error,
                ci95: [value - 2.0 * std_error, value + 2.0 * std_error],
                at_bound: false,
            }
        })
        .collect();
    Candidate {
        acting,
        probability,
        delta_bic: -812.4,
        mean_square: 1.21,
        holdout_mean_square: 1.34,
        in_model,
        values,
        says: "the resistance of wires and electrodes delays the charge of the film; it takes 97 % of the excess away".into(),
    }
}

fn place(dimension: &'static str) -> Place {
    Place {
        dimension,
        called: dimension,
        range: Some([1.2, 4.0]),
        unit: "kV/s".into(),
        value: None,
        recording: None,
        actuators: vec![2],
        share_of_excess: 0.72,
        share_of_samples: 0.31,
        p_value: 1e-9,
        says: "where the command of actuator 2 rises faster than 1.2 kV/s the motion needs less voltage than was given.".into(),
    }
}

fn trace(id: &str, held_out: bool) -> Traces {
    let time_s: Vec<f64> = (0..3000).map(|i| f64::from(i) * 0.01).collect();
    let drive = |t: f64, k: usize| 2500.0 - 2400.0 * (2.1 * t + k as f64).cos();
    let rate = |t: f64, k: usize| (2.1 * t + k as f64).sin();
    let noise = |i: usize, k: usize| ((i * 7919 + 31 * k) % 97) as f64 - 48.0;
    let rows = |gain: f64| -> Vec<[f64; 3]> {
        let row = |(i, t): (usize, &f64)| {
            let strong = |k: usize| if k == 1 { gain } else { 0.15 * gain };
            [0, 1, 2].map(|k| strong(k) * rate(*t, k) + 0.5 * noise(i, k))
        };
        time_s.iter().enumerate().map(row).collect()
    };
    let torque = |gain: f64| -> Vec<[f64; 4]> {
        let errors = rows(gain);
        let kept = (40..2960).step_by(8);
        kept.map(|i| {
            let e = errors[i].map(|v| v * 2e-6);
            [time_s[i], e[0], e[1], e[2]]
        })
        .collect()
    };
    Traces {
        id: id.into(),
        held_out,
        command_v: time_s
            .iter()
            .map(|t| [0, 1, 2].map(|k| drive(*t, k)))
            .collect(),
        before_v: rows(250.0),
        after_v: rows(10.0),
        torque_before: torque(250.0),
        torque_after: torque(10.0),
        height_mm: time_s
            .iter()
            .map(|t| -50.0 - drive(*t, 0) / 200.0)
            .collect(),
        time_s,
    }
}

/// The robot of the bundled rig.
fn robot() -> Robot {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/twin2026_delta/rig.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    match Rig::parse(&path, &text).unwrap() {
        Rig::Robot(rig) => Robot::from_rig(&rig, None).unwrap(),
        Rig::FilmSample(_) => panic!("no robot"),
    }
}

fn diagnosis(verdict: Verdict) -> Diagnosis {
    let parameters = Parameters {
        film: Film {
            mu_pa: vec![8.1e5, 1.2e5, 3.3e4],
            relaxation_time_s: vec![0.07, 4.2],
            locking: 77.7,
        },
        forearm: ForearmTorque::zero(),
    };
    let gain = Gain {
        before_v: 240.5,
        after_v: 27.8,
        noise_floor_v: 22.4,
        all_v: [251.0, 80.1, 77.2],
    };
    let candidates = match verdict {
        Verdict::Adequate => vec![],
        Verdict::MissingPhysics => vec![
            candidate(
                "series_resistance",
                [false, true, false],
                &[9.8e6, 0.0],
                0.93,
                true,
            ),
            candidate(
                "payload_change",
                [true; 3],
                &[2.1e-3, 12.5, 2.0],
                0.81,
                true,
            ),
            candidate(
                "marker_offset",
                [true; 3],
                &[1e-4, -2e-4, 3e-4],
                0.05,
                false,
            ),
            candidate("link_length_error", [true; 3], &[4.0, 1e-3], 0.03, false),
            candidate("slew_limit", [true; 3], &[5e3, f64::INFINITY], 0.001, false),
        ],
        Verdict::Unexplained => vec![candidate("joint_damping", [true; 3], &[1e-4], 0.08, false)],
    };
    Diagnosis {
        verdict,
        confidence: 0.97,
        places: vec![place("voltage_rate"), place("height")],
        candidates,
        groups: vec![vec!["time_offset", "mocap_lag"], vec!["series_resistance", "slew_limit"]],
        next_experiment: "steps with holds, and sines at two rates: a resistance loses amplitude at the higher one.".into(),
        hidden: vec![Hidden {
            effect: "electrode_stiffness",
            hidden_share: 0.998,
            smallest_detectable: 4e4,
            name: "modulus",
            unit: "Pa".into(),
        }],
        train: Gain { before_v: 212.0, ..gain },
        holdout: (verdict != Verdict::Unexplained).then_some(gain),
        plain: parameters.clone(),
        parameters,
        pose: Some(Pose {
            robot: robot(),
            position_m: [0.0, 0.0, -0.036],
        }),
        eps_r: 2.8,
        rig: deacal::diagnosis::RigKind::Robot,
        values: Vec::new(),
        unit: "V".into(),
        basis: "above_1kV",
        over: " above 1 kV",
        plain_mean_square: 31.0,
        plain_holdout_mean_square: 36.0,
        law: (verdict == Verdict::Unexplained).then(|| Law {
            terms: vec![("rate of theta_b, squared".into(), 1.2e-5, 0.4), ("height".into(), -3e-6, 0.1)],
            share: 0.47,
        }),
        learnt: None,
        rival_models: vec![RivalModel {
            method: "forward selection (AIC)",
            effects: vec!["leakage", "joint_damping"],
            train: gain,
            holdout: Some(Gain { after_v: 61.0, ..gain }),
        }],
        traces: vec![trace("a/01-symmetric", false), trace(HOSTILE, true)],
        dated: Vec::new(),
        remarks: vec!["Not every recording states its `start`.".into()],
        says: "The plain model leaves ten times the noise. A series resistance in actuator 2 accounts for 97 % of it.".into(),
        probabilities: [0.01, 0.97, 0.02],
        departed: vec![Departed {
            what: "link d of actuator 2".into(),
            found: 0.0011,
            tolerance: 0.002,
            unit: "1",
            stated: false,
        }],
        beyond: None,
        built: 0.3,
        rivals: vec![("whiteness test", true, None)],
        evidence: Evidence::default(),
    }
}

fn series() -> Vec<SeriesEntry> {
    let entry = |id: &str, number: usize| SeriesEntry {
        id: id.into(),
        number,
        begins_s: 120.0 * (number - 1) as f64,
        clock_s: None,
    };
    vec![entry("a/01-symmetric", 1), entry(HOSTILE, 2)]
}

/// A curve of the bicep angle, per rate, of actuators 1 and 2.
fn learnt() -> LearntPhysics {
    let form = Form::Spline {
        of: Variable::BicepAngle,
        knots: vec![0.0, 0.1, 0.2],
        by: Some(Variable::BicepRate),
    };
    let term = Learnt::new(Site::Bicep, form, vec![[0.01, 0.19], [-0.5, f64::INFINITY]]);
    LearntPhysics {
        place: Site::Bicep,
        terms: vec![LearntTerm {
            acting: Acting {
                effect: term,
                values: vec![1e-3, -2e-3, 5e-4],
                on: [true, true, false],
            },
            covariance: vec![
                vec![1e-8, 0.0, 0.0],
                vec![0.0, 2e-8, 0.0],
                vec![0.0, 0.0, 1e-8],
            ],
            inclusion: 0.999,
            largest: 1.9e-3,
        }],
        net_work: -0.8,
        resembles: vec![("joint_damping", 0.83)],
        gap_closed: 0.91,
        beside: false,
        left_out: -1.2,
        says: "a torque on the bicep joints <script>, by bicep angle, bicep rate.".into(),
    }
}

#[test]
fn what_was_learnt_is_shown_and_written() {
    let mut d = diagnosis(Verdict::Unexplained);
    d.law = None;
    d.learnt = Some(learnt());
    let text = to_text(&DiagnosisJson::new(&d, series(), Provenance::new("t")));
    common::check("diagnosis", &text);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let l = &json["learnt"];
    assert_eq!(l["site"], "bicep");
    assert_eq!(l["actuators"], serde_json::json!([1, 2]));
    assert_eq!(
        l["variables"],
        serde_json::json!(["bicep angle", "bicep rate"])
    );
    assert_eq!(l["form"], "spline");
    assert_eq!(l["unit"], "N m");
    assert_eq!(l["inclusion"]["bicep rate"], 0.999);
    assert_eq!(l["range"]["bicep angle"][1], 0.19);
    assert!(l["range"]["bicep rate"][1].is_null());
    assert_eq!(l["dissipative"], true);
    assert_eq!(l["resembles"][0][0], "joint_damping");
    assert_eq!(l["gap_closed"], 0.91);
    let html = render_diagnosis(&d, &Provenance::new("t"));
    assert!(html.contains("id=\"learnt\"") && !html.contains("id=\"law\""));
    assert!(html.contains("Augmented model"));
    assert!(!html.contains("<script>, by"));
    // the entry of the parameter file reads back to the same term
    let file = ParameterFile::of_diagnosis(&d, series(), Provenance::new("t"));
    let entry = &file.effects[0];
    assert_eq!(
        (entry.id.as_str(), &entry.actuators),
        ("learnt", &vec![1, 2])
    );
    let own = &d.learnt.unwrap().terms[0].acting;
    assert!(file.acting(&|_| None).unwrap()[0] == *own);
}

#[test]
fn the_numbers_have_the_promised_keys() {
    for verdict in [
        Verdict::Adequate,
        Verdict::MissingPhysics,
        Verdict::Unexplained,
    ] {
        let d = diagnosis(verdict);
        let text = to_text(&DiagnosisJson::new(&d, series(), Provenance::new("t")));
        common::check("diagnosis", &text);
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(json["verdict"], verdict.name());
        assert_eq!(json["rmse_basis"], "above_1kV");
        assert_eq!(json["train_rmse_V"]["before"], 212.0);
        assert_eq!(json["where"][0]["range"][1], 4.0);
        assert_eq!(json["where"][0]["actuators"][0], 2);
        assert_eq!(json["hidden"][0]["smallest_detectable"]["unit"], "Pa");
        assert_eq!(json["indistinguishable"][0][1], "mocap_lag");
        assert_eq!(
            json["holdout_rmse_V"].is_null(),
            verdict == Verdict::Unexplained
        );
        if verdict == Verdict::MissingPhysics {
            let c = &json["candidates"];
            assert_eq!(c[0]["parameters"]["resistance"]["value"], 9.8e6);
            assert_eq!(c[0]["parameters"]["resistance"]["unit"], "ohm");
            assert_eq!(c[0]["actuators"], serde_json::json!([2]));
            assert_eq!(c[1]["parameters"]["recording"]["value"], HOSTILE);
            assert_eq!(
                c[2]["parameters"]["offset"]["value"],
                serde_json::json!([1e-4, -2e-4, 3e-4])
            );
            assert_eq!(c[3]["parameters"]["link"]["value"], "a");
            assert!(c[4]["parameters"]["rate_down"]["value"].is_null());
        }
        assert_eq!(json["probabilities"]["something_else"], 0.02);
        assert_eq!(json["tolerances"][0]["what"], "link d of actuator 2");
        assert_eq!(json["tolerance_scale"], 0.3);
        let back: DiagnosisJson = serde_json::from_str(&text).unwrap();
        assert_eq!(to_text(&back), text);
    }
}

#[test]
fn the_augmented_model_reads_back_to_the_causes_that_it_holds() {
    let d = diagnosis(Verdict::MissingPhysics);
    let text = ParameterFile::of_diagnosis(&d, series(), Provenance::new("t"))
        .to_toml()
        .unwrap();
    let file = ParameterFile::parse(std::path::Path::new("p.toml"), &text).unwrap();
    let number = |id: &str| (id == HOSTILE).then_some(2);
    let acting = file.acting(&number).unwrap();
    let held: Vec<Acting> = d
        .candidates
        .iter()
        .filter(|c| c.in_model)
        .map(|c| c.acting.clone())
        .collect();
    assert_eq!(acting, held);
    assert_eq!(file.parameters().unwrap().film, d.parameters.film);
    assert_eq!(file.series, series());
    assert_eq!(file.to_toml().unwrap(), text);
    // a size freed of what noise does stands beside the one that predicts
    let mut freed = d.clone();
    freed.candidates[0].values[0].value *= 1.02;
    let text = ParameterFile::of_diagnosis(&freed, series(), Provenance::new("t"))
        .to_toml()
        .unwrap();
    let name = freed.candidates[0].values[0].name;
    assert!(text.contains(&format!("{name}_estimate = ")), "{text}");
    let file = ParameterFile::parse(std::path::Path::new("p.toml"), &text).unwrap();
    assert_eq!(file.acting(&number).unwrap(), held);
    assert_eq!(file.to_toml().unwrap(), text);
    // every kind of value, in the model or not
    for c in &d.candidates {
        let mut one = d.clone();
        one.candidates = vec![Candidate {
            in_model: true,
            ..c.clone()
        }];
        let text = ParameterFile::of_diagnosis(&one, series(), Provenance::new("t"))
            .to_toml()
            .unwrap();
        let file = ParameterFile::parse(std::path::Path::new("p.toml"), &text).unwrap();
        assert_eq!(
            file.acting(&number).unwrap(),
            std::slice::from_ref(&c.acting),
            "{text}"
        );
    }
}

#[test]
fn the_page_of_several_runs_leads_to_each() {
    use deacal::report::html::{Run, render_index};
    let run = |folder: &str, what: &str| Run {
        folder: folder.into(),
        what: what.into(),
        says: format!("{what} came out <well>."),
    };
    let html = render_index(
        "Two runs",
        "All is done.",
        &[run("a film", "Film"), run("", "Both")],
    );
    for part in [
        "<a href=\"a%20film&#x2f;report.html\">Film</a>",
        "<a href=\"report.html\">Both</a>",
        "Film came out &lt;well&gt;.",
        "parameters.toml",
        "All is done.",
    ] {
        assert!(html.contains(part), "{part} is not in the page");
    }
}

#[test]
fn the_report_answers_in_words_first() {
    for verdict in [
        Verdict::Adequate,
        Verdict::MissingPhysics,
        Verdict::Unexplained,
    ] {
        let html = render_diagnosis(&diagnosis(verdict), &Provenance::new("deacal diagnose"))
            .replace('\u{a0}', " ");
        if let Some(dir) = std::env::var_os("DEACAL_WRITE_LOOK") {
            let path = std::path::Path::new(&dir).join(format!("{}.html", verdict.name()));
            std::fs::write(path, &html).unwrap();
        }
        for absent in ["<b>sine", "NaN", "http://", "https://", "<script src"] {
            assert!(!html.contains(absent), "{absent} in {}", verdict.name());
        }
        let first = html.split("<nav").next().unwrap();
        for question in [
            "Does the plain model fit",
            "Where does the plain model fail?",
            "What is missing?",
            "What to record next?",
            "What could not have been seen?",
        ] {
            assert!(first.contains(question), "{question}");
        }
        let robot = html.split("id=\"robot\"").nth(1).unwrap();
        let robot = robot.split("</section>").next().unwrap();
        // a mark on the wires of actuator 2, one on the end effector; none where nothing is missing
        let marks = robot.matches("class=\"f-two\"").count();
        let marked = match verdict {
            Verdict::Adequate => 0,
            _ => robot.matches("<li>").count(),
        };
        assert_eq!(marks > 0, verdict != Verdict::Adequate, "{robot}");
        assert!(robot.contains("The robot: base") && marks >= marked);
        if verdict == Verdict::MissingPhysics {
            assert_eq!(marks, 2);
            for words in [
                "A: series resistance, 93 %: the wires, actuator 2",
                "B: payload change, 81 %: the end effector",
            ] {
                assert!(robot.contains(words), "{words} not in {robot}");
            }
        }
        let changed = first.contains("What changed when it was added?");
        assert_eq!(changed, verdict == Verdict::MissingPhysics);
        assert_eq!(html.contains("id=\"law\""), verdict == Verdict::Unexplained);
        assert!(html.contains("id=\"voltages\"") && html.contains("id=\"hidden\""));
        if changed {
            for words in [
                "Series resistance, 93 %",
                "Could be mistaken for slew limit",
                "240 V",
                "not fitted",
            ] {
                assert!(first.contains(words), "{words} not in {first}");
            }
        }
        assert!(html.len() < 3_000_000, "{} bytes", html.len());
    }
}

/// A model that needs a part beyond its tolerance is not said to leave more than noise, nor to lack something
/// of no catalogue.
#[test]
fn a_part_beyond_its_tolerance_is_said_as_such() {
    let mut d = diagnosis(Verdict::Unexplained);
    d.law = None;
    d.beyond = Some(Departed {
        what: "link q of actuator 2".into(),
        found: -0.013,
        tolerance: 0.002,
        unit: "1",
        stated: false,
    });
    let html = render_diagnosis(&d, &Provenance::new("deacal diagnose")).replace('\u{a0}', " ");
    let first = html.split("<nav").next().unwrap();
    for words in [
        "Only with a part beyond its tolerance",
        "link q of actuator 2 by -1.30 %, 6.5 times its tolerance",
        "With that part it leaves no more than noise",
    ] {
        assert!(first.contains(words), "{words} not in {first}");
    }
    for words in ["it leaves more than noise", "not in the catalogue"] {
        assert!(!first.contains(words), "{words}");
    }
}
