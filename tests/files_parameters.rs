//! Parameter files: what is written reads back to the same bits, and what is wrong is named with its line.

use std::path::Path;

use deacal::model::ForearmTorque;
use deacal::recording::ErrorKind;
use deacal::report::parameter_file::*;
use deacal::report::provenance::*;
use proptest::prelude::*;

fn read(text: &str) -> Result<ParameterFile, deacal::recording::Error> {
    ParameterFile::parse(Path::new("parameters.toml"), text)
}

/// Any finite bit pattern, subnormals and zeros included.
fn bits() -> impl Strategy<Value = f64> {
    any::<u64>().prop_map(|b| {
        let v = f64::from_bits(b);
        // clearing an exponent bit makes a NaN or an infinity finite
        if v.is_finite() {
            v
        } else {
            f64::from_bits(b & !(1 << 62))
        }
    })
}

fn positive() -> impl Strategy<Value = f64> {
    prop_oneof![
        bits().prop_map(f64::abs),
        (1u64..1 << 52).prop_map(f64::from_bits),
        1e-3..1e7f64,
    ]
    .prop_filter("above zero", |v| *v > 0.0)
}

fn with_error(value: f64, error: Option<f64>) -> Quantity {
    match error {
        None => Quantity::exact(value),
        Some(e) => Quantity {
            value,
            std_error: e,
            ci95: [value - e, value + e],
        },
    }
}

fn quantity(value: impl Strategy<Value = f64>) -> impl Strategy<Value = Quantity> {
    (value, proptest::option::of(1e-9..1e6f64)).prop_map(|(v, e)| with_error(v, e))
}

prop_compose! {
    fn file()(
        mu in prop::collection::vec(quantity(positive()), 1..9),
        times in prop::collection::vec(positive(), 8),
        errors in prop::collection::vec(proptest::option::of(1e-9..1e3f64), 8),
        locking in quantity(positive()),
        eps_r in proptest::option::of(quantity(positive())),
        torque in prop::collection::vec(quantity(bits()), 7),
        with_forearm in any::<bool>(),
        effects in prop::collection::vec(
            ("[a-z][a-z_0-9]{0,20}", bits(), any::<i64>(), "\\PC*", prop::collection::vec(bits(), 0..4)), 0..4),
        command in "\\PC*",
    ) -> ParameterFile {
        let mut times = times[..mu.len() - 1].to_vec();
        times.sort_by(f64::total_cmp);
        ParameterFile {
            path: "parameters.toml".into(),
            film: Some(FilmEntry {
                mu_pa: mu,
                relaxation_time_s: times.iter().zip(&errors).map(|(t, e)| with_error(*t, *e)).collect(),
                locking,
                eps_r,
            }),
            forearm: with_forearm.then(|| ForearmEntry {
                nodes_deg: ForearmTorque::DEFAULT_NODES_DEG.to_vec(),
                torque_n_m: torque,
            }),
            axis: vec![("mass_kg".into(), toml::Value::Float(0.25))],
            effects: effects
                .into_iter()
                .map(|(id, value, whole, word, list)| Effect {
                    id,
                    actuators: vec![3, 1],
                    values: vec![
                        ("resistance".into(), toml::Value::Float(value)),
                        ("resistance_std_error".into(), toml::Value::Float(f64::NAN)),
                        ("count".into(), toml::Value::Integer(whole)),
                        ("a_word".into(), toml::Value::String(word)),
                        ("list".into(), toml::Value::Array(list.into_iter().map(toml::Value::Float).collect())),
                    ],
                })
                .collect(),
            provenance: Provenance {
                program: "deacal 0.0.0".into(),
                command,
                rig: Some(FileSum { role: "rig".into(), file: "a \"rig\".toml".into(), sha256: "ab".into() }),
                recordings: vec![RecordingSum { id: "day/one".into(), files: vec![
                    FileSum { role: "motion".into(), file: "m.csv".into(), sha256: "cd".into() }; 3] }],
            },
            series: Vec::new(),
            notes: Vec::new(),
        }
    }
}

/// Every number by its bits, so that NaN equals NaN and 0 is not -0.
fn fingerprint(file: &ParameterFile) -> String {
    fn number(v: f64) -> String {
        if v.is_nan() {
            "nan".into()
        } else {
            format!("{:016x}", v.to_bits())
        }
    }
    fn value(v: &toml::Value) -> String {
        match v {
            toml::Value::Float(v) => number(*v),
            toml::Value::Array(l) => l.iter().map(value).collect::<Vec<_>>().join(" "),
            other => other.to_string(),
        }
    }
    let list = |l: &[Quantity]| {
        l.iter()
            .map(|q| {
                [q.value, q.std_error, q.ci95[0], q.ci95[1]]
                    .map(number)
                    .join(",")
            })
            .collect::<Vec<_>>()
            .join(" ")
    };
    let mut out = String::new();
    if let Some(f) = &file.film {
        out += &format!(
            "{}\n{}\n{}\n{}\n",
            list(&f.mu_pa),
            list(&f.relaxation_time_s),
            list(&[f.locking]),
            list(f.eps_r.as_slice())
        );
    }
    if let Some(f) = &file.forearm {
        let nodes: Vec<String> = f.nodes_deg.iter().map(|&v| number(v)).collect();
        out += &format!("{nodes:?}\n{}\n", list(&f.torque_n_m));
    }
    for (name, v) in &file.axis {
        out += &format!("{name} {}\n", value(v));
    }
    for e in &file.effects {
        out += &format!("{} {:?}\n", e.id, e.actuators);
        for (name, v) in &e.values {
            out += &format!("{name} {}\n", value(v));
        }
    }
    out + &format!("{:?}", file.provenance)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn reads_back_to_the_same_bits(file in file()) {
        let text = file.to_toml().unwrap();
        let back = read(&text).map_err(|e| TestCaseError::fail(format!("{e}\n{text}")))?;
        prop_assert_eq!(fingerprint(&back), fingerprint(&file));
        prop_assert_eq!(back.to_toml().unwrap(), text);
    }

    #[test]
    fn no_text_makes_it_panic(text in "(\\[film\\]\n|mu_Pa = \\[|1.0|,|\\]\n|T_s|J = |nan|\\[\\[effect\\]\\]\n|id = \"a\"\n|=|\\PC){0,40}") {
        let _ = read(&text);
    }

    #[test]
    fn nodes_in_degrees_come_back_to_the_bit(mut degrees in prop::collection::vec(-90.0..90.0f64, 2..9)) {
        degrees.sort_by(f64::total_cmp);
        degrees.dedup();
        prop_assume!(degrees.len() > 1);
        let nodes: Vec<f64> = degrees.iter().map(|d| d.to_radians()).collect();
        prop_assume!(nodes.windows(2).all(|p| p[0] < p[1]));
        let forearm = ForearmTorque::new(nodes, vec![0.0; degrees.len()]).unwrap();
        let parameters = deacal::model::Parameters {
            film: deacal::film::Film { mu_pa: vec![1e5], relaxation_time_s: vec![], locking: 50.0 },
            forearm,
        };
        let back = read(&ParameterFile::of(&parameters, None).to_toml().unwrap()).unwrap().parameters().unwrap();
        prop_assert_eq!(back, parameters);
    }
}

const GOOD: &str = "\
[film]
mu_Pa = [100000.0, 20000.0]
T_s = [0.5]
J = 80
eps_r = 2.8
[forearm]
nodes_deg = [-30, 30]
torque_N_m = [-1e-3, 1e-3]
[[effect]]
id = \"series_resistance\"
actuators = [1, 2]
resistance = 9.8e6
";

#[test]
fn the_contracts_layout_is_read() {
    let file = read(GOOD).unwrap();
    let p = file.parameters().unwrap();
    assert_eq!(p.film.mu_pa, [1e5, 2e4]);
    assert_eq!(p.film.locking, 80.0);
    assert_eq!(p.forearm.torque_n_m, [-1e-3, 1e-3]);
    assert_eq!(file.eps_r(), Some(2.8));
    assert_eq!(file.effects[0].number("resistance"), Some(9.8e6));
    assert_eq!(file.effects[0].actuators, [1, 2]);
    assert!(file.notes.is_empty());
}

#[test]
fn without_a_forearm_there_is_no_torque_and_a_note_says_so() {
    let file = read("[film]\nmu_Pa = [1.0]\nT_s = []\nJ = 1.0\n").unwrap();
    assert_eq!(file.parameters().unwrap().forearm, ForearmTorque::zero());
    assert!(file.notes[0].text.contains("no [forearm]"));
}

#[test]
fn a_hinge_gives_a_forearm_alone() {
    let file = read("[forearm]\nnodes_deg = [0, 1]\ntorque_N_m = [0, 1]\n").unwrap();
    assert_eq!(file.forearm_torque().unwrap().torque_n_m, [0.0, 1.0]);
    let error = file.parameters().unwrap_err();
    assert_eq!(error.kind(), ErrorKind::MissingKey);
    assert!(error.to_string().contains("[film]"), "{error}");
}

#[test]
fn what_is_wrong_is_named_with_its_line() {
    let change = |from: &str, to: &str| {
        assert!(GOOD.contains(from), "{from}");
        GOOD.replace(from, to)
    };
    #[rustfmt::skip]
    let cases: Vec<(String, u64, &[&str])> = vec![
        (change("mu_Pa = ", "mu_pa = "), 2, &["\"mu_pa\"", "did you mean \"mu_Pa\""]),
        (change("T_s = [0.5]", "T_s = [0.5, 0.6]"), 2, &["2 moduli and 2 relaxation times", "expected 3"]),
        (change("20000.0]", "\n-20000.0]"), 3, &["found -20000", "not below 0"]),
        (change("20000.0]\nT_s = [0.5]", "2.0, 3.0]\nT_s = [0.5,\n0.1]"), 4, &["0.1 follows 0.5", "rise"]),
        (change("[0.5]", "[0.0]"), 3, &["found 0", "above 0"]),
        (change("J = 80", "J = 0"), 4, &["[film] J", "above 0"]),
        (change("J = 80", "J = nan"), 4, &["finite"]),
        (change("eps_r = 2.8", "eps_r = -1"), 5, &["found -1"]),
        (change("[-30, 30]", "[30, -30]"), 7, &["-30 follows 30", "rise"]),
        (change("[-1e-3, 1e-3]", "[-1e-3]"), 8, &["1 torques at 2 nodes"]),
        (change("actuators = [1, 2]", "actuators = [1, 4]"), 11, &["number 4", "1, 2 or 3"]),
        (change("actuators = [1, 2]", "actuators = [1, 1]"), 11, &["each once"]),
        (change("resistance = 9.8e6", "resistance = nan"), 12, &["finite"]),
        (change("resistance = 9.8e6", "resistance = { a = 1 }"), 12, &["a table"]),
        (change("[forearm]", "[fore-arm]"), 6, &["did you mean \"forearm\""]),
        (change("J = 80", "J = 80\nmu_Pa_std_error = [1]"), 5, &["1 entries beside 2"]),
        (change("J = 80", "J = 80\nmu_Pa_std_error = [1, -1]"), 5, &["found -1"]),
        (change("J = 80", "J = 80\nJ_ci95 = [3, 2]"), 5, &["interval"]),
        (change("J = 80\n", ""), 1, &["J", "missing", "add `J = ...`"]),
        ("".into(), 1, &["[film]"]),
        ("[film\n".into(), 1, &["correct the TOML"]),
    ];
    for (text, line, parts) in cases {
        let error = read(&text).expect_err(&text);
        let message = error.to_string();
        assert_eq!(error.line(), Some(line), "{message}\n{text}");
        assert!(message.starts_with("parameters.toml"), "{message}");
        for part in parts {
            assert!(message.contains(part), "{message}\nlacks {part}");
        }
    }
}
