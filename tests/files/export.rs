//! Exports hold the same bits as the parameter file, as compilers and interpreters of those languages read
//! them.

use std::path::Path;
use std::process::Command;

use deacal::effects::Acting;
use deacal::effects::learnt::{Form, Learnt, Place, Variable};
use deacal::report::export::{Format, export};
use deacal::report::parameter_file::*;
use deacal::report::provenance::*;

/// Numbers that are hard to print: long, tiny, subnormal, huge, negative zero.
const HARD: [f64; 8] = [
    1e5 / 7.0,
    0.1 + 0.2,
    f64::MIN_POSITIVE,
    5e-324,
    1.797_693_134_862_315_7e308,
    -0.0,
    1e16,
    2.225_073_858_507_201e-308,
];

fn file() -> ParameterFile {
    let mut mu: Vec<Quantity> = HARD.iter().map(|v| Quantity::exact(v.abs())).collect();
    mu[0].std_error = 12.5;
    let mut times: Vec<f64> = HARD[..7].iter().map(|v| v.abs() + 1e-3).collect();
    times.sort_by(f64::total_cmp);
    ParameterFile {
        film: Some(FilmEntry {
            mu_pa: mu,
            relaxation_time_s: times.into_iter().map(Quantity::exact).collect(),
            locking: Quantity {
                value: 80.0 / 3.0,
                std_error: 0.5,
                ci95: [25.0, 28.0],
            },
            eps_r: Some(Quantity::exact(2.8)),
        }),
        forearm: Some(ForearmEntry {
            nodes_deg: vec![-30.0, 1.0 / 3.0],
            torque_n_m: vec![Quantity::exact(-1.6e-3 / 3.0), Quantity::exact(-0.0)],
        }),
        axis: vec![],
        effects: vec![Effect {
            id: "series_resistance".into(),
            actuators: vec![1, 3],
            values: vec![
                ("resistance".into(), toml::Value::Float(9.8e6 / 7.0)),
                (
                    "kind".into(),
                    toml::Value::String("it's \"odd\" \\ ??/ */ \u{e9}\n7".into()),
                ),
                ("on".into(), toml::Value::Boolean(true)),
                (
                    "knots".into(),
                    toml::Value::Array(vec![toml::Value::Float(0.1), toml::Value::Integer(2)]),
                ),
            ],
            lines: Lines::default(),
        }],
        provenance: Provenance {
            program: "deacal 0.1.0".into(),
            command: "deacal fit robot a */ b \\".into(),
            rig: None,
            recordings: vec![RecordingSum {
                id: "a".into(),
                files: vec![FileSum {
                    role: "motion".into(),
                    file: "a.csv".into(),
                    sha256: "00ff".into(),
                }],
            }],
            ..Provenance::default()
        },
        ..ParameterFile::default()
    }
}

/// Bits of every plain number, in the order in which the test programs print them.
fn expected(file: &ParameterFile) -> String {
    let film = file.film.as_ref().unwrap();
    let forearm = file.forearm.as_ref().unwrap();
    let mut all: Vec<f64> = Vec::new();
    all.extend(film.mu_pa.iter().map(|q| q.value));
    all.extend(film.relaxation_time_s.iter().map(|q| q.value));
    all.push(film.locking.value);
    all.push(film.eps_r.unwrap().value);
    all.extend(&forearm.nodes_deg);
    all.extend(forearm.torque_n_m.iter().map(|q| q.value));
    all.push(file.effects[0].number("resistance").unwrap());
    all.iter()
        .map(|v| format!("{:016x}\n", v.to_bits()))
        .collect()
}

fn run(program: &str, args: &[&Path]) -> Option<String> {
    let output = match Command::new(program).args(args).output() {
        Ok(output) => output,
        Err(error) => {
            eprintln!("skipped: {program}: {error}");
            return None;
        }
    };
    assert!(
        output.status.success(),
        "{program}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn c_compiles_without_a_warning_and_has_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("p.h"), export(&file(), Format::C)).unwrap();
    let program = r#"
#include "p.h"
#include "p.h"
#include <stdio.h>
#include <string.h>
static void show(double v) { unsigned long long b; memcpy(&b, &v, 8); printf("%016llx\n", b); }
#define ALL(a, n) do { int i; for (i = 0; i < n; i++) show(a[i]); } while (0)
int main(void) {
    ALL(deacal_film_mu_Pa, DEACAL_FILM_MU_PA_COUNT);
    ALL(deacal_film_T_s, DEACAL_FILM_T_S_COUNT);
    show(deacal_film_J);
    show(deacal_film_eps_r);
    ALL(deacal_forearm_nodes_deg, DEACAL_FOREARM_NODES_DEG_COUNT);
    ALL(deacal_forearm_torque_N_m, DEACAL_FOREARM_TORQUE_N_M_COUNT);
    show(deacal_effect_1_resistance);
    return deacal_effect_1_on == 1 && deacal_effect_1_actuators[1] == 3
        && strstr(deacal_effect_1_kind, "it's \"odd\" \\ \?\?/ */ \xc3\xa9 7") ? 0 : 1;
}
"#;
    let source = dir.path().join("main.c");
    std::fs::write(&source, program).unwrap();
    let binary = dir.path().join("main");
    let flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-o"].map(Path::new);
    let mut args = flags.to_vec();
    args.extend([binary.as_path(), source.as_path()]);
    if run("cc", &args).is_none() {
        return;
    }
    let got = run(binary.to_str().unwrap(), &[]).unwrap();
    assert_eq!(got, expected(&file()));
}

#[test]
fn python_has_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(
        dir.path().join("parameters.py"),
        export(&file(), Format::Python),
    )
    .unwrap();
    let script = dir.path().join("main.py");
    std::fs::write(
        &script,
        r#"
import struct, sys
sys.dont_write_bytecode = True
import parameters as p
def show(*values):
    for v in values:
        sys.stdout.write(struct.pack(">d", v).hex() + "\n")
d = p.PARAMETERS
assert d["film"]["mu_Pa"] is p.FILM_mu_Pa
show(*d["film"]["mu_Pa"], *p.FILM_T_s, p.FILM_J, p.FILM_eps_r, *p.FOREARM_nodes_deg)
show(*p.FOREARM_torque_N_m, d["effect"][0]["resistance"])
e = p.EFFECT_1
assert e["kind"] == "it's \"odd\" \\ ??/ */ \u00e9\n7" and e["on"] is True and e["actuators"] == [1, 3], e
assert e["knots"] == [0.1, 2.0]
"#,
    )
    .unwrap();
    if let Some(got) = run("python3", &[&script]) {
        assert_eq!(got, expected(&file()));
    }
}

#[test]
fn json_has_the_same_bits() {
    let text = export(&file(), Format::Json);
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let film = file().film.unwrap();
    let mu = json["film"]["mu_Pa"].as_array().unwrap();
    for (got, want) in mu.iter().zip(&film.mu_pa) {
        assert_eq!(got.as_f64().unwrap().to_bits(), want.value.to_bits());
    }
    assert!(json["film"]["mu_Pa_std_error"][1].is_null());
    assert_eq!(json["film"]["mu_Pa_std_error"][0], 12.5);
    assert_eq!(json["effect"][0]["id"], "series_resistance");
    assert_eq!(json["provenance"]["recording"][0]["id"], "a");
}

#[test]
fn matlab_is_written_as_matlab_reads_it() {
    let text = export(&file(), Format::Matlab);
    for part in [
        "deacal = struct();\n",
        "deacal.film.J = 26.666666666666668;\n",
        "deacal.film.mu_Pa_std_error = [12.5 NaN ",
        "deacal.forearm.torque_N_m = [-0.0005333333333333334 -0.0];\n",
        "deacal.effect{1}.id = 'series_resistance';\n",
        "deacal.effect{1}.kind = 'it''s \"odd\" ",
        "deacal.effect{1}.knots = [0.1 2.0];\n",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    assert!(text.lines().all(|l| l.starts_with(['%', 'd'])), "{text}");
}

#[test]
fn an_empty_film_compiles_too() {
    let mut file = file();
    let film = file.film.as_mut().unwrap();
    film.mu_pa.truncate(1);
    film.relaxation_time_s.clear();
    let text = export(&file, Format::C);
    assert!(text.contains("#define DEACAL_FILM_T_S_COUNT 0\n"), "{text}");
    assert!(!text.contains("deacal_film_T_s["), "{text}");
    assert_eq!(Format::parse("c"), Some(Format::C));
    assert_eq!(Format::parse("x"), None);
}

#[test]
fn keys_that_a_language_cannot_have_or_tell_apart_get_other_names() {
    let list = |v: f64| toml::Value::Array(vec![v.into(), v.into()]);
    let file = ParameterFile {
        axis: vec![
            ("for".into(), 1.0.into()),
            ("end".into(), 2.0.into()),
            ("a".into(), list(3.0)),
            ("A".into(), list(4.0)),
            ("with space".into(), 5.0.into()),
        ],
        ..file()
    };
    let matlab = export(&file, Format::Matlab);
    for line in [
        "axis.for_ = 1.0;",
        "axis.end_ = 2.0;",
        "axis.a = [",
        "axis.A = [",
        "axis.with_space = 5.0;",
    ] {
        assert!(
            matlab.contains(&format!("deacal.{line}")),
            "{line}: {matlab}"
        );
    }
    assert!(matlab.contains("The key `for` is the field for_ here."));
    let c = export(&file, Format::C);
    let macros: Vec<&str> = c
        .lines()
        .filter_map(|l| l.strip_prefix("#define "))
        .map(|l| l.split(' ').next().unwrap())
        .collect();
    let mut distinct = macros.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), macros.len(), "{macros:?}");
    assert!(c.contains("deacal_axis_A_2[2]") && c.contains("The key `A` is called A_2 here."));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.py");
    std::fs::write(
        &path,
        export(&file, Format::Python)
            + "\nprint(PARAMETERS['axis']['A'], PARAMETERS['axis']['with space'])\n",
    )
    .unwrap();
    match run("python3", &[&path]) {
        Some(said) => assert_eq!(said.trim(), "[4.0, 4.0] 5.0"),
        None => eprintln!("skipped: no python3 here"),
    }
}

/// Two learnt terms: a curve with a covariance, and a potential with centres.
fn with_learnt() -> ParameterFile {
    let spline = Form::Spline {
        of: Variable::BicepAngle,
        knots: vec![-0.1, 0.1 / 3.0, 0.3],
        by: Some(Variable::BicepRate),
    };
    let potential = Form::Potential {
        centres_m: vec![[0.01 / 3.0, -0.0, 0.1], [0.0, 5e-324, -0.05]],
        width_m: 0.02 / 3.0,
    };
    let curve = Acting {
        effect: Learnt::new(Place::Bicep, spline, vec![[-0.1, 0.3], [-2.0, 2.0 / 3.0]]),
        values: vec![1e-3 / 7.0, -0.0, 5e-324],
        on: [true, false, true],
    };
    let pushes = Acting {
        effect: Learnt::new(Place::Force, potential, Vec::new()),
        values: vec![1e-3, -2e-3 / 3.0],
        on: [true; 3],
    };
    let spread = |i: usize, j: usize| if i == j { 1e-8 / 3.0 } else { 1e-9 / 7.0 };
    let covariance: Vec<Vec<f64>> = (0..3)
        .map(|i| (0..3).map(|j| spread(i, j)).collect())
        .collect();
    ParameterFile {
        effects: vec![
            Effect::learnt(&curve, &covariance).unwrap(),
            Effect::learnt(&pushes, &[]).unwrap(),
        ],
        ..file()
    }
}

/// Bits of the numbers of a key of an effect, lists in lists one after another.
fn bits_of(effect: &Effect, keys: &[&str]) -> String {
    fn all(v: &toml::Value) -> Vec<f64> {
        match v {
            toml::Value::Array(list) => list.iter().flat_map(all).collect(),
            v => vec![v.as_float().unwrap()],
        }
    }
    let value = |key: &&str| &effect.values.iter().find(|(n, _)| n == key).unwrap().1;
    let numbers = keys.iter().map(value).flat_map(all);
    numbers.map(|v| format!("{:016x}\n", v.to_bits())).collect()
}

const OF_CURVE: [&str; 4] = ["knots", "values", "covariance", "range"];
const OF_PUSHES: [&str; 3] = ["coefficients", "centres_m", "width_m"];

fn learnt_bits(file: &ParameterFile) -> String {
    bits_of(&file.effects[0], &OF_CURVE) + &bits_of(&file.effects[1], &OF_PUSHES)
}

#[test]
fn what_was_learnt_compiles_with_its_matrices_and_words() {
    let file = with_learnt();
    let text = export(&file, Format::C);
    for part in [
        "/* Effect 1: learnt */\n/* Learnt from recordings",
        "a torque on the bicep joints, N m: the natural cubic spline",
        "static const double deacal_effect_1_covariance[3][3] = {",
        "#define DEACAL_EFFECT_2_CENTRES_M_COLUMNS 3\n",
        "static const char deacal_effect_2_formula[] = \"-grad of",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("p.h"), &text).unwrap();
    let program = r#"
#include "p.h"
#include <stdio.h>
#include <string.h>
static void show(double v) { unsigned long long b; memcpy(&b, &v, 8); printf("%016llx\n", b); }
#define ALL(a, n) do { int i; for (i = 0; i < n; i++) show(a[i]); } while (0)
#define ROWS(a, n, m) do { int i, j; for (i = 0; i < n; i++) for (j = 0; j < m; j++) show(a[i][j]); } while (0)
#define E1(x) deacal_effect_1_ ## x
#define E2(x) deacal_effect_2_ ## x
int main(void) {
    ALL(E1(knots), DEACAL_EFFECT_1_KNOTS_COUNT);
    ALL(E1(values), DEACAL_EFFECT_1_VALUES_COUNT);
    ROWS(E1(covariance), DEACAL_EFFECT_1_COVARIANCE_COUNT, DEACAL_EFFECT_1_COVARIANCE_COLUMNS);
    ROWS(E1(range), DEACAL_EFFECT_1_RANGE_COUNT, DEACAL_EFFECT_1_RANGE_COLUMNS);
    ALL(E2(coefficients), DEACAL_EFFECT_2_COEFFICIENTS_COUNT);
    ROWS(E2(centres_m), DEACAL_EFFECT_2_CENTRES_M_COUNT, DEACAL_EFFECT_2_CENTRES_M_COLUMNS);
    show(E2(width_m));
    return DEACAL_EFFECT_1_VARIABLES_COUNT == 2 && !strcmp(E1(variables)[1], "bicep rate")
        && !strcmp(E1(site), "bicep") && E1(actuators)[1] == 3 ? 0 : 1;
}
"#;
    let source = dir.path().join("main.c");
    std::fs::write(&source, program).unwrap();
    let binary = dir.path().join("main");
    let flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-o"].map(Path::new);
    let mut args = flags.to_vec();
    args.extend([binary.as_path(), source.as_path()]);
    if run("cc", &args).is_none() {
        return;
    }
    let got = run(binary.to_str().unwrap(), &[]).unwrap();
    assert_eq!(got, learnt_bits(&file));
}

#[test]
fn what_was_learnt_has_the_same_bits_in_python_and_json() {
    let file = with_learnt();
    let json: serde_json::Value = serde_json::from_str(&export(&file, Format::Json)).unwrap();
    let rows = json["effect"][0]["covariance"].as_array().unwrap();
    assert_eq!(rows.len(), 3);
    assert_eq!(
        rows[1][1].as_f64().unwrap().to_bits(),
        (1e-8_f64 / 3.0).to_bits()
    );
    assert_eq!(json["effect"][1]["centres_m"][1][1].as_f64(), Some(5e-324));
    assert_eq!(json["effect"][0]["variables"][1], "bicep rate");
    let text = export(&file, Format::Python);
    assert!(text.contains("# Learnt from recordings"), "{text}");
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("parameters.py"), text).unwrap();
    let script = dir.path().join("main.py");
    std::fs::write(
        &script,
        r#"
import struct, sys
sys.dont_write_bytecode = True
import parameters as p
def show(v):
    if isinstance(v, list):
        for one in v: show(one)
    else:
        sys.stdout.write(struct.pack(">d", v).hex() + "\n")
curve, pushes = p.PARAMETERS["effect"]
for key in ["knots", "values", "covariance", "range"]: show(curve[key])
for key in ["coefficients", "centres_m", "width_m"]: show(pushes[key])
assert curve["id"] == "learnt" and curve["variables"] == ["bicep angle", "bicep rate"], curve
"#,
    )
    .unwrap();
    if let Some(got) = run("python3", &[&script]) {
        assert_eq!(got, learnt_bits(&file));
    }
}

#[test]
fn what_was_learnt_is_matrices_and_cells_in_matlab() {
    let text = export(&with_learnt(), Format::Matlab);
    for part in [
        "% Learnt from recordings",
        "deacal.effect{1}.variables = {'bicep angle', 'bicep rate'};\n",
        "deacal.effect{1}.range = [-0.1 0.3; -2.0 0.6666666666666666];\n",
        "deacal.effect{2}.centres_m = [0.0033333333333333335 -0.0 0.1; 0.0 5e-324 -0.05];\n",
        "deacal.effect{2}.site = 'force';\n",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    assert!(text.lines().all(|l| l.starts_with(['%', 'd'])), "{text}");
}
