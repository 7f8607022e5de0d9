//! Parameter files: what is written reads back to the same bits, and what is wrong is named with its line.

use std::path::Path;

use deacal::effects::Acting;
use deacal::effects::learnt::{Form, Learnt, Place, Variable};
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
                    lines: Lines::default(),
                })
                .collect(),
            provenance: Provenance {
                program: "deacal 0.0.0".into(),
                command,
                rig: Some(FileSum { role: "rig".into(), file: "a \"rig\".toml".into(), sha256: "ab".into() }),
                recordings: vec![RecordingSum { id: "day/one".into(), files: vec![
                    FileSum { role: "motion".into(), file: "m.csv".into(), sha256: "cd".into() }; 3] }],
                ..Provenance::default()
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
    assert_eq!(p.forearm.torque_n_m(), [-1e-3, 1e-3]);
    assert_eq!(file.eps_r(), Some(2.8));
    assert_eq!(file.effects[0].number("resistance"), Some(9.8e6));
    assert_eq!(file.effects[0].actuators, [1, 2]);
    assert!(file.notes.is_empty());
}

/// A robot's electrodes resist more when stretched; the wire of a hanging sample has one resistance.
#[test]
fn a_hanging_sample_has_no_resistance_that_grows_with_stretch() {
    let told = |exponent: &str| {
        let line = format!("resistance = 9.8e6\nstretch_exponent = {exponent}");
        read(&GOOD.replace("resistance = 9.8e6", &line)).unwrap()
    };
    assert_eq!(told("0.0").electrode().unwrap().resistance_ohm, 9.8e6);
    let file = told("4.0");
    assert_eq!(
        file.acting(&|_| None).unwrap()[0].values,
        [9.8e6, 4.0],
        "a robot has it"
    );
    let error = file.electrode().unwrap_err().to_string();
    for part in [
        "stretch_exponent",
        "one resistance",
        "take `stretch_exponent` out",
    ] {
        assert!(error.contains(part), "{error}\nlacks {part}");
    }
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
    assert_eq!(file.forearm_torque().unwrap().torque_n_m(), [0.0, 1.0]);
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
        ("".into(), 1, &["the file is empty", "a parameter file"]),
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

/// One learnt term of each form and kind of variable list, at each site, with numbers that are hard to print.
fn terms() -> Vec<(Place, Form)> {
    use Variable as V;
    let third = 1.0 / 3.0;
    let knots = vec![-0.1 - third, -0.0, 5e-324, 0.1 + 0.2, 1e16];
    vec![
        (
            Place::Bicep,
            Form::Spline {
                of: V::BicepAngle,
                knots: knots.clone(),
                by: None,
            },
        ),
        (
            Place::Electrical,
            Form::Spline {
                of: V::VoltageRate,
                knots: knots.clone(),
                by: Some(V::Voltage),
            },
        ),
        (
            Place::Film,
            Form::Presliding {
                of: V::LozengeAngle,
                ranges: vec![third, 1e-9],
            },
        ),
        (
            Place::Bicep,
            Form::Lag {
                of: V::BicepAngle,
                times_s: vec![0.05, third, 50.0],
                by: None,
            },
        ),
        (
            Place::Film,
            Form::Lag {
                of: V::SquaredVoltage,
                times_s: vec![0.8],
                by: Some(V::LozengeAngle),
            },
        ),
        (
            Place::Bicep,
            Form::Wave {
                frequency_hz: 4.0 * third,
                by: None,
            },
        ),
        (
            Place::Electrical,
            Form::Wave {
                frequency_hz: 1.5,
                by: Some(V::CubedVoltage),
            },
        ),
        (Place::Electrical, Form::Neighbours),
        (
            Place::Capacitance,
            Form::Spline {
                of: V::AreaStretch,
                knots: vec![7.0 * third, 6.0],
                by: Some(V::SeriesTime),
            },
        ),
        (
            Place::Series,
            Form::Spline {
                of: V::SeriesTime,
                knots: vec![0.0, 600.0],
                by: None,
            },
        ),
        (
            Place::Force,
            Form::Potential {
                centres_m: vec![[third, -0.0, 0.1], [0.0, third / 1e3, -0.05]],
                width_m: third / 10.0,
            },
        ),
        (
            Place::Force,
            Form::Ridge {
                along: [0.6, -0.0, -0.8],
                knots: vec![-0.01, third / 10.0],
            },
        ),
        (
            Place::Force,
            Form::Affine {
                about_m: [third, 0.0, -0.1],
            },
        ),
        (Place::Force, Form::Drag),
        (
            Place::Force,
            Form::Oscillator {
                frequency_hz: third,
                damping: 0.05,
            },
        ),
    ]
}

/// A term with coefficients and a range that are hard to print.
fn term((place, form): (Place, Form)) -> Acting {
    let n = form.count();
    let range = |i: usize| [-1.0 / 7.0 - i as f64, 0.1 + 0.2];
    let ranges = (0..form.variables().len()).map(range).collect();
    let value = |j: usize| [-1e-3 / 7.0, 5e-324, -0.0, 1.7e308, 1e16][j % 5];
    Acting {
        effect: Learnt::new(place, form, ranges),
        values: (0..n).map(value).collect(),
        on: [true, place == Place::Force, true],
    }
}

/// A covariance of n numbers with entries that differ.
fn covariance(n: usize) -> Vec<Vec<f64>> {
    let entry = |i: usize, j: usize| {
        let off = 1e-7 / (3.0 + (i + j) as f64);
        if i == j { 1e-4 / 7.0 } else { off }
    };
    let row = |i: usize| (0..n).map(|j| entry(i, j)).collect();
    (0..n).map(row).collect()
}

fn with_terms(effects: Vec<Effect>) -> ParameterFile {
    ParameterFile {
        effects,
        ..read(GOOD).unwrap()
    }
}

#[test]
fn learnt_terms_read_back_to_the_same_bits() {
    let acting: Vec<Acting> = terms().into_iter().map(term).collect();
    let mut met: Vec<&str> = Vec::new();
    let entry = |a: &Acting| Effect::learnt(a, &covariance(a.values.len())).unwrap();
    let file = with_terms(acting.iter().map(entry).collect());
    let text = file.to_toml().unwrap();
    let back = read(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    assert_eq!(fingerprint(&back), fingerprint(&file), "{text}");
    assert_eq!(back.to_toml().unwrap(), text);
    let read_back = back.acting(&|_| None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(read_back.len(), acting.len());
    let bits = |v: &[f64]| v.iter().map(|v| v.to_bits()).collect::<Vec<u64>>();
    for (a, b) in acting.iter().zip(&read_back) {
        let (term, same) = (a.effect.learnt().unwrap(), b.effect.learnt().unwrap());
        assert_eq!(term.place, same.place);
        // the shortest digits of every number, the sign of 0 included
        assert_eq!(format!("{:?}", term.form), format!("{:?}", same.form));
        assert_eq!(bits(&a.values), bits(&b.values));
        assert_eq!(
            bits(term.range.as_flattened()),
            bits(same.range.as_flattened())
        );
        assert_eq!(a.on, b.on);
        met.push(term.form.name());
    }
    assert!(Form::NAMES.iter().all(|name| met.contains(name)), "{met:?}");
    // what the file says of a term is what a reader finds there
    assert!(text.contains("# Learnt from recordings"), "{text}");
    assert!(text.contains("formula = \"sum of c_j z_j"), "{text}");
}

#[test]
fn what_is_not_known_of_a_term_is_left_out() {
    let (place, form) = (Place::Force, Form::Drag);
    let acting = Acting {
        effect: Learnt::new(place, form, Vec::new()),
        values: vec![1e-3; 6],
        on: [true; 3],
    };
    for covariance in [Vec::new(), covariance(5), vec![vec![f64::NAN; 6]; 6]] {
        let entry = Effect::learnt(&acting, &covariance).unwrap();
        let names: Vec<&str> = entry.values.iter().map(|(n, _)| n.as_str()).collect();
        let expected = [
            "site",
            "form",
            "variables",
            "unit",
            "formula",
            "coefficients",
        ];
        assert_eq!(names, expected);
        let file = with_terms(vec![entry]);
        let back = read(&file.to_toml().unwrap()).unwrap();
        let back = back.acting(&|_| None).unwrap().remove(0);
        assert!(back.effect.learnt().unwrap().range.is_empty());
    }
    // a term that came out as no number is no term
    let lost = Acting {
        values: vec![f64::NAN; 6],
        ..acting
    };
    let entry = Effect::learnt(&lost, &[]).unwrap();
    let error = with_terms(vec![entry]).to_toml().unwrap_err().to_string();
    assert!(error.contains("learnt") && error.contains("NaN"), "{error}");
    // a cause of the catalogue was not learnt
    let known = deacal::effects::CATALOGUE[0];
    assert_eq!(Effect::learnt(&Acting::off(known, [true; 3]), &[]), None);
}

const SPLINE: &str = "\
[[effect]]
id = \"learnt\"
actuators = [1, 2]
site = \"bicep\"
form = \"spline\"
variables = [\"bicep angle\", \"bicep rate\"]
unit = \"N m\"
knots = [-0.1, 0.0, 0.3]
values = [1e-3, 2e-3, 0]
covariance = [[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1e-3]]
range = [[-0.1, 0.3], [-2, 2]]
";

const POTENTIAL: &str = "\
[[effect]]
id = \"learnt\"
site = \"force\"
form = \"potential\"
variables = [\"effector x\", \"effector y\", \"effector z\"]
unit = \"N\"
coefficients = [1e-3, 2e-3]
centres_m = [[0, 0, 0], [0.01, 0, 0]]
width_m = 0.01
";

#[test]
fn what_is_wrong_with_a_learnt_term_is_named() {
    let film = GOOD.split("[[effect]]").next().unwrap();
    let acting =
        |entry: &str| read(&format!("{film}{entry}")).and_then(|file| file.acting(&|_| None));
    let good = acting(SPLINE).unwrap().remove(0);
    assert_eq!(good.values, [1e-3, 2e-3, 0.0]);
    assert_eq!(good.on, [true, true, false]);
    assert_eq!(
        good.effect.learnt().unwrap().range,
        [[-0.1, 0.3], [-2.0, 2.0]]
    );
    assert!(acting(POTENTIAL).is_ok());

    let spline = |from: &str, to: &str| {
        assert!(SPLINE.contains(from), "{from}");
        SPLINE.replace(from, to)
    };
    let potential = |from: &str, to: &str| {
        assert!(POTENTIAL.contains(from), "{from}");
        POTENTIAL.replace(from, to)
    };
    let other = |place: &str, form: &str, variables: &str, own: &str| {
        let unit = Place::named(place).unwrap().unit();
        format!(
            "[[effect]]\nid = \"learnt\"\nsite = \"{place}\"\nform = \"{form}\"\nvariables = [{variables}]\nunit = \"{unit}\"\n{own}\n"
        )
    };
    let ridge = |own: &str| {
        let xyz = "\"effector x\", \"effector y\", \"effector z\"";
        other("force", "ridge", xyz, own)
    };
    let angle = "\"bicep angle\"";
    let speed = "\"effector velocity\"";
    let swing = "\"effector velocity\", \"history\"";
    let xyz = "\"effector x\", \"effector y\", \"effector z\"";
    let knots = "knots = [-0.1, 0.0, 0.3]";
    let values = "values = [1e-3, 2e-3, 0]";
    let first_row = "[2.0, 1.0, 0.0]";
    #[rustfmt::skip]
    let cases: Vec<(String, &str, &[&str])> = vec![
        // words
        (spline("\"bicep\"", "\"biceps\""), "site", &["\"biceps\"", "did you mean \"bicep\"", "capacitance"]),
        (spline("\"spline\"", "\"splines\""), "form", &["\"splines\"", "did you mean \"spline\"", "oscillator"]),
        (spline("\"spline\"", "3"), "form", &["found 3", "a word"]),
        (spline("\"bicep angle\"", "\"bicep angel\""), "variables", &["\"bicep angel\"", "did you mean \"bicep angle\""]),
        (spline("\"bicep rate\"", "\"rate\""), "variables", &["\"rate\"", "There are: "]),
        (spline("[\"bicep angle\", ", "[\"bicep angle\", \"voltage\", "), "variables", &["found \"bicep angle\", \"voltage\", \"bicep rate\", expected \"bicep angle\", \"voltage\""]),
        (spline("[\"bicep angle\", \"bicep rate\"]", "[]"), "variables", &["an empty list", "a list of words"]),
        (spline("[\"bicep angle\", \"bicep rate\"]", "[1]"), "variables", &["found 1", "a word"]),
        (spline("\"N m\"", "\"N\""), "unit", &["found \"N\"", "\"N m\"", "bicep"]),
        // curves
        (spline(knots, "knots = [-0.1, 0.3, 0.2]"), "knots", &["0.2 follows 0.3", "bicep angle that rise", "order"]),
        (spline(knots, "knots = [-0.1, -0.1, 0.2]"), "knots", &["-0.1 follows -0.1"]),
        (spline(knots, "knots = [0.1]"), "knots", &["found 1 knot", "two"]),
        (spline(knots, "knots = []"), "knots", &["an empty list"]),
        (spline(knots, "knots = [0.1, \"b\", 1]"), "knots", &["found \"b\"", "a finite number"]),
        (spline(knots, "knots = 3"), "knots", &["found 3", "a list of numbers"]),
        (spline(values, "values = [1, 2]"), "values", &["found 2 numbers", "expected 3", "knots"]),
        // covariance
        (spline(first_row, "[2.0, 1.0]"), "covariance", &["row 1 has 2", "3 rows of 3"]),
        (spline("[2.0, 1.0, 0.0], ", ""), "covariance", &["found 2 rows", "3 rows of 3"]),
        (spline(first_row, "[2.0, 1.1, 0.0]"), "covariance", &["1 in row 2, column 1, and 1.1 mirrored", "symmetric"]),
        (spline(first_row, "[0.1, 1.0, 0.0]"), "covariance", &["smallest eigenvalue is -3.29", "largest 2.4", "none below 0"]),
        (spline("1e-3]]", "-1e-3]]"), "covariance", &["smallest eigenvalue is -1e-3", "none below 0"]),
        (spline(first_row, "3"), "covariance", &["found 3", "row"]),
        // ranges
        (spline("[[-0.1, 0.3], ", "[[0.3, -0.1], "), "range", &["-0.1 follows 0.3", "bicep angle", "low not above high"]),
        (spline("[-0.1, 0.3], [-2, 2]", "[-0.1, 0.3]"), "range", &["found 1 of 2", "\"bicep rate\"", "leave it out"]),
        (spline("[-2, 2]", "[-2, 0, 2]"), "range", &["found 3 numbers of bicep rate", "two"]),
        // keys
        (spline("values = ", "value = "), "value", &["a spline has no such key", "did you mean \"values\""]),
        (spline(values, &format!("{values}\ncoefficients = [1.0]")), "coefficients", &["a spline has no such key", "values"]),
        (spline(&format!("{values}\n"), ""), "values", &["missing", "add `values = ...`"]),
        (spline(&format!("{knots}\n"), ""), "knots", &["missing", "add `knots = ...`"]),
        (spline("site = \"bicep\"\n", ""), "site", &["missing"]),
        (spline("form = \"spline\"\n", ""), "form", &["missing"]),
        (spline("unit = \"N m\"\n", ""), "unit", &["missing"]),
        (potential("width_m = 0.01\n", ""), "width_m", &["missing"]),
        (potential("width_m", "formula = \"x\"\nwidth_m"), "formula", &["found \"x\"", "expected \"-grad", "leave it out"]),
        // shapes
        (potential("0.01\n", "-0.01\n"), "width_m", &["found -0.01", "in m"]),
        (potential("0.01\n", "0.0\n"), "width_m", &["found 0", "in m"]),
        (potential("[0, 0, 0]", "[0, 0]"), "centres_m", &["found a list of 2", "[x, y, z]"]),
        (potential("[[0, 0, 0], ", "["), "coefficients", &["found 2 numbers", "expected 1", "centres_m"]),
        (ridge("direction = [1, 1, 0]\nknots = [0, 1]\nvalues = [0, 1]"), "direction", &["of length 1.414", "length 1", "divide"]),
        (ridge("direction = [1, 0]\nknots = [0, 1]\nvalues = [0, 1]"), "direction", &["three numbers"]),
        (ridge("direction = [1, 0, 0]\nknots = [1, 0]\nvalues = [0, 1]"), "knots", &["0 follows 1"]),
        (other("bicep", "lag", angle, "times_s = [1, 0]\ncoefficients = [1, 2]"), "times_s", &["found 0", "above 0 s"]),
        (other("bicep", "lag", angle, "times_s = [1, 2]\ncoefficients = [1]"), "coefficients", &["found 1", "expected 2", "times_s"]),
        (other("bicep", "presliding", &format!("{angle}, \"direction of motion\""), "widths = [-1]\ncoefficients = [1]"), "widths", &["found -1", "above 0 rad"]),
        (other("bicep", "presliding", angle, "widths = [1]\ncoefficients = [1]"), "variables", &["expected \"bicep angle\", \"direction of motion\""]),
        (other("bicep", "wave", "\"time\"", "frequency_Hz = 0\ncoefficients = [1, 2]"), "frequency_Hz", &["found 0", "in Hz, above 0"]),
        (other("bicep", "wave", "\"time\"", "frequency_Hz = 1e9\ncoefficients = [1, 2]"), "frequency_Hz", &["found 1000000000", "to 10000"]),
        (other("bicep", "wave", angle, "frequency_Hz = 1\ncoefficients = [1, 2]"), "variables", &["expected \"time\""]),
        (other("force", "oscillator", swing, "frequency_Hz = 1\ndamping = -1\ncoefficients = [1, 2, 3, 4, 5, 6]"), "damping", &["found -1", "from 0 to 10"]),
        (other("force", "oscillator", swing, "frequency_Hz = 1\ndamping = 0.1\ncoefficients = [1, 2]"), "coefficients", &["found 2", "expected 6", "oscillator"]),
        (other("force", "drag", speed, "coefficients = [1, 2]"), "coefficients", &["found 2", "expected 6"]),
        (other("force", "drag", angle, "coefficients = [1, 2, 3, 4, 5, 6]"), "variables", &["expected \"effector velocity\""]),
        (other("force", "affine", xyz, "about_m = 1\ncoefficients = [1, 2, 3, 4, 5, 6, 7, 8, 9]"), "about_m", &["found 1", "[x, y, z]"]),
        // sites
        (potential("\"force\"", "\"bicep\""), "site", &["found \"bicep\" with a potential", "expected \"force\""]),
        (other("film", "drag", speed, "coefficients = [1, 2, 3, 4, 5, 6]"), "site", &["\"film\"", "expected \"force\""]),
        (spline("\"bicep\"", "\"force\""), "site", &["found \"force\" with a spline of bicep angle", "\"bicep\" or \"film\""]),
        (other("bicep", "spline", "\"voltage\"", "knots = [0, 1]\nvalues = [1, 2]"), "site", &["found \"bicep\"", "\"film\" or \"electrical\""]),
        (potential("id = \"learnt\"\n", "id = \"learnt\"\nactuators = [1]\n"), "actuators", &["found actuators [1]", "all three"]),
    ];
    for (entry, key, parts) in &cases {
        let message = match acting(entry) {
            Ok(read) => panic!("{entry}was read as {read:?}"),
            Err(error) => error.to_string(),
        };
        let place = format!(", [[effect]] learnt {key}: ");
        let (line, _) = message
            .split_once(&place)
            .unwrap_or_else(|| panic!("{message}\nis not at {place}"));
        let line = line
            .strip_prefix("parameters.toml, line ")
            .and_then(|l| l.parse::<u32>().ok());
        assert!(line.is_some(), "{message}\nhas no line");
        assert!(!message.contains('\n'), "{message}");
        for part in *parts {
            assert!(message.contains(part), "{message}\nlacks {part}");
        }
    }
    // what is no number is found as the file is read, with its line
    for (entry, line, found) in [
        (spline("0.3]\nval", "nan]\nval"), 16, "nan"),
        (spline("1e-3, 2e-3", "inf, 2e-3"), 17, "inf"),
        (spline("[1.0, 2.0, 0.0]", "[1.0, -inf, 0.0]"), 18, "-inf"),
        (spline("[-2, 2]", "[-2, nan]"), 19, "nan"),
    ] {
        let error = acting(&entry).unwrap_err();
        assert_eq!(error.line(), Some(line), "{error}");
        let message = error.to_string();
        assert!(
            message.contains(&format!(
                "found the number {found}, expected a finite number"
            )),
            "{message}"
        );
    }
    // of several terms the one that is wrong
    let error = acting(&format!("{SPLINE}{}", potential("0.01\n", "-1\n"))).unwrap_err();
    assert!(
        error.to_string().contains("[[effect]] learnt 2 width_m"),
        "{error}"
    );
}

#[test]
fn a_learnt_term_is_one_of_a_robot_and_stands_in_a_file() {
    let axis = read(&format!("[axis]\nmass_kg = 0.2\n{SPLINE}")).unwrap();
    let error = axis.line_model().unwrap_err().to_string();
    for part in [
        "[[effect]] learnt site",
        "a term of a robot",
        "expected terms of this bench, axis or coupon",
        "take the block out",
    ] {
        assert!(error.contains(part), "{error}\nlacks {part}");
    }
    let along = "[[effect]]\nid = \"learnt\"\nsite = \"coordinate\"\nform = \"presliding\"\nvariables = [\"excursion\", \"direction of motion\"]\nunit = \"1\"\ncoefficients = [0.02]\nwidths = [0.01]\n";
    let own = read(&format!("[axis]\nmass_kg = 0.2\n{along}")).unwrap();
    assert_eq!(own.line_model().unwrap().effects[0].values, [0.02]);
    let robot = read(&format!("{GOOD}\n{along}")).unwrap();
    let error = robot.acting(&|_| None).unwrap_err().to_string();
    assert!(
        error.contains("a term of a bench, an axis or a coupon"),
        "{error}"
    );
    let argument: Effect = "learnt:site=bicep".parse().unwrap();
    let error = argument.check().unwrap_err();
    assert!(error.contains("stands in a parameter file"), "{error}");
    let error = axis.electrode().unwrap_err().to_string();
    assert!(
        error.contains("`learnt` cannot act on a hanging sample"),
        "{error}"
    );
}
