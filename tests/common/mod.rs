//! What several test programs share.
#![allow(dead_code)]

pub mod bench;
pub mod recordings;

use std::path::{Path, PathBuf};

use deacal::kinematics::{Chain, FourBar, Lozenge, Mechanism};
use serde_json::Value;

/// Runs `deacal`, which has to succeed, and gives what it wrote on standard output.
pub fn run(
    arguments: impl FnOnce(&mut std::process::Command) -> &mut std::process::Command,
) -> Vec<u8> {
    let mut deacal = std::process::Command::new(env!("CARGO_BIN_EXE_deacal"));
    let done = arguments(&mut deacal).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{deacal:?}: {said}");
    done.stdout
}

/// Every file below a folder whose name ends so; none where there is no such folder.
pub fn files_below(dir: &Path, end: &str) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(dir) else {
        return Vec::new();
    };
    let paths = entries.map(|e| e.unwrap().path());
    paths
        .flat_map(|path| match path.is_dir() {
            true => files_below(&path, end),
            false => Vec::from_iter(
                path.to_str()
                    .is_some_and(|p| p.ends_with(end))
                    .then_some(path),
            ),
        })
        .collect()
}

/// A file of `tests/golden`.
pub fn golden(name: &str) -> Value {
    let path = format!("{}/tests/golden/{name}.json", env!("CARGO_MANIFEST_DIR"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A number of a JSON value.
pub fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("not a number: {v}"))
}

/// A list of numbers of a JSON value.
pub fn numbers(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(number).collect()
}

/// Three numbers.
pub fn triple(v: &Value) -> [f64; 3] {
    numbers(v).try_into().unwrap()
}

/// The mechanism of a golden file's `rig`.
pub fn mechanism(rig: &Value) -> Mechanism {
    let m = |key: &str| number(&rig[key]) * 1e-3;
    Mechanism::symmetric(Chain {
        azimuth_rad: 0.0,
        base_radius_m: m("l_ch_mm"),
        effector_radius_m: m("l_end_mm"),
        bicep_m: m("q_mm"),
        forearm_m: m("n0_mm"),
        input_offset_rad: (number(&rig["omega_deg"]) + number(&rig["alpha_deg"])).to_radians(),
        four_bar: FourBar {
            a_m: m("a_mm"),
            b_m: m("b_mm"),
            c_m: m("c_mm"),
            d_m: m("d_mm"),
        },
        dea_offset_rad: number(&rig["dea_offset_deg"]).to_radians(),
    })
}

/// The lozenge of a golden file's `rig`.
pub fn lozenge(rig: &Value) -> Lozenge {
    let m = |key: &str| number(&rig[key]) * 1e-3;
    Lozenge {
        side_m: m("l_dea_mm"),
        l1_m: m("L1_mm"),
        l2_m: m("L2_mm"),
        l3_m: m("L3_mm"),
        films: number(&rig["films"]),
    }
}

/// A sum of sines with value, first and second derivative.
pub fn sines(form: &Value, t: f64) -> [f64; 3] {
    let slope = form.get("slope").map_or(0.0, number);
    let mut out = [number(&form["c0"]) + slope * t, slope, 0.0];
    let (amp, freq, phase) = (
        numbers(&form["amp"]),
        numbers(&form["freq"]),
        numbers(&form["phase"]),
    );
    for i in 0..amp.len() {
        let w = 2.0 * std::f64::consts::PI * freq[i];
        let (s, c) = (w * t + phase[i]).sin_cos();
        out[0] += amp[i] * s;
        out[1] += amp[i] * w * c;
        out[2] -= amp[i] * w * w * s;
    }
    out
}

/// A film of a golden file.
pub fn film(v: &Value) -> deacal::film::Film {
    deacal::film::Film {
        mu_pa: numbers(&v["mu_Pa"]),
        relaxation_time_s: numbers(&v["T_s"]),
        locking: number(&v["J"]),
    }
}

/// The initial state named in a golden file.
pub fn initial(v: &Value) -> deacal::film::InitialState {
    match v.as_str().unwrap() {
        "relaxed" => deacal::film::InitialState::Relaxed,
        "virgin" => deacal::film::InitialState::Virgin,
        other => panic!("unknown start {other}"),
    }
}

/// The robot of a golden file's `rig`.
pub fn robot(rig: &Value) -> deacal::model::Robot {
    deacal::model::Robot {
        mechanism: mechanism(rig),
        lozenges: [lozenge(rig); 3],
        eps_r: number(&rig["eps_r"]),
        effector_kg: number(&rig["m_g"]) * 1e-3,
        bicep_tip_kg: number(&rig["m_bc_g"]) * 1e-3,
        tolerances: Vec::new(),
    }
}

/// Film and forearm of a golden case.
pub fn parameters(case: &Value) -> deacal::model::Parameters {
    let forearm = &case["forearm"];
    let nodes = numbers(&forearm["nodes_deg"])
        .iter()
        .map(|d| d.to_radians())
        .collect();
    deacal::model::Parameters {
        film: film(&case["film"]),
        forearm: deacal::model::ForearmTorque::new(nodes, numbers(&forearm["torque_Nm"])).unwrap(),
    }
}

/// The track of a golden case at the given times; `step_s` is the distance that it claims.
pub fn track(case: &Value, times: &[f64], step_s: f64) -> deacal::model::Track {
    let at = |t: f64, order: usize| {
        ["x", "y", "z"].map(|axis| sines(&case["track"][axis], t)[order] * 1e-3)
    };
    deacal::model::Track {
        step_s,
        position_m: times.iter().map(|&t| at(t, 0)).collect(),
        velocity_m_s: times.iter().map(|&t| at(t, 1)).collect(),
        acceleration_m_s2: times.iter().map(|&t| at(t, 2)).collect(),
        payload_kg: vec![number(&case["payload_g"]) * 1e-3; times.len()],
        initial: initial(&case["film"]["start"]),
    }
}

/// Whether a value is what a schema says: types, required and known keys, items.
fn conforms(root: &Value, schema: &Value, value: &Value, place: &str) {
    if let Some(name) = schema["$ref"].as_str() {
        let name = name.trim_start_matches("#/$defs/");
        return conforms(root, &root["$defs"][name], value, place);
    }
    if let Some(list) = schema["anyOf"].as_array() {
        let null = |s: &&Value| s["type"] == "null";
        if value.is_null() {
            assert!(list.iter().any(|s| null(&s)), "{place}");
            return;
        }
        // of several objects the one whose required keys are all there
        let whole = |s: &&Value| {
            let name = s["$ref"].as_str().unwrap_or("");
            let at = &root["$defs"][name.trim_start_matches("#/$defs/")];
            let keys = at["required"].as_array().into_iter().flatten();
            keys.map(|k| k.as_str().unwrap())
                .all(|k| value.get(k).is_some())
        };
        let mut others = list.iter().filter(|s| !null(s));
        let other = match others.clone().count() {
            1 => others.next(),
            _ => others.find(whole),
        };
        let other = other.unwrap_or_else(|| panic!("{place}: {value} is none of {list:?}"));
        return conforms(root, other, value, place);
    }
    let fits = |t: &Value| match t.as_str().unwrap_or("") {
        "null" => value.is_null(),
        "number" => value.is_number(),
        "integer" => value.is_i64() || value.is_u64(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        _ => true,
    };
    match &schema["type"] {
        Value::Array(types) => assert!(types.iter().any(fits), "{place}: {value}"),
        one => assert!(fits(one), "{place}: {value}, not {one}"),
    }
    if let Some(map) = value.as_object() {
        for key in schema["required"].as_array().into_iter().flatten() {
            assert!(map.contains_key(key.as_str().unwrap()), "{place}: no {key}");
        }
        for (key, v) in map {
            let known = match schema["properties"].get(key) {
                Some(known) => known,
                None => &schema["additionalProperties"],
            };
            assert!(
                !known.is_null() && *known != false,
                "{place}: {key} is in no schema"
            );
            conforms(root, known, v, &format!("{place}/{key}"));
        }
    }
    for (i, v) in value.as_array().into_iter().flatten().enumerate() {
        conforms(root, &schema["items"], v, &format!("{place}/{i}"));
    }
}

/// Whether a text conforms to the schema of that name.
pub fn check(name: &str, text: &str) {
    let all = deacal::report::schema::schemas();
    let schema = &all.iter().find(|(n, _)| *n == name).unwrap().1;
    let schema: Value = serde_json::from_str(schema).unwrap();
    conforms(&schema, &schema, &serde_json::from_str(text).unwrap(), name);
}
