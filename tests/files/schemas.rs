//! The schemas in `schemas/` are those of the types. They are written by
//! `DEACAL_WRITE_SCHEMAS=1 cargo test --test files schemas::`.

use std::path::Path;

use serde_json::Value;

use crate::common;

#[test]
fn committed_schemas_are_current() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas");
    for (name, text) in deacal::report::schema::schemas() {
        let path = dir.join(format!("{name}.schema.json"));
        if std::env::var_os("DEACAL_WRITE_SCHEMAS").is_some() {
            deacal::report::output::write_atomic(
                &path,
                deacal::report::output::Overwrite::Any,
                &text,
            )
            .unwrap();
        }
        let committed = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            committed == text,
            "{} is not current: run DEACAL_WRITE_SCHEMAS=1 cargo test --test files schemas::",
            path.display()
        );
    }
}

#[test]
fn the_reference_of_keys_is_current() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/src/keys.md");
    let text = deacal::recording::reference();
    if std::env::var_os("DEACAL_WRITE_SCHEMAS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    assert!(
        std::fs::read_to_string(&path).unwrap_or_default() == text,
        "{} is not current: run DEACAL_WRITE_SCHEMAS=1 cargo test --test files schemas::",
        path.display()
    );
}

/// What a value breaks of a schema, by the keywords that the schemas of manifests use; none where it conforms.
fn broken(schema: &Value, value: &Value, at: &str) -> Option<String> {
    let list = |key: &str| schema.get(key).and_then(Value::as_array);
    let say = |what: &str| Some(format!("{at}: {value} is not {what}"));
    if schema == &Value::Bool(false) {
        return say("allowed");
    }
    let fits = |s: &Value, v: &Value| broken(s, v, at).is_none();
    let number = value.as_f64();
    if let Some(wanted) = schema.get("type").and_then(Value::as_str) {
        let is = match wanted {
            "string" => value.is_string(),
            "number" => number.is_some(),
            "integer" => value.is_i64() || value.is_u64(),
            "array" => value.is_array(),
            "object" => value.is_object(),
            other => panic!("{at}: the schema has a type {other}"),
        };
        if !is {
            return say(wanted);
        }
    }
    let limit = |key: &str| schema.get(key).and_then(Value::as_f64).zip(number);
    if limit("minimum").is_some_and(|(least, x)| x < least)
        || limit("maximum").is_some_and(|(most, x)| x > most)
        || limit("exclusiveMinimum").is_some_and(|(least, x)| x <= least)
        || list("enum").is_some_and(|words| !words.contains(value))
        || schema.get("const").is_some_and(|only| only != value)
        || list("oneOf").is_some_and(|ways| ways.iter().filter(|s| fits(s, value)).count() != 1)
    {
        return say("what the schema asks for");
    }
    if let Some(items) = value.as_array() {
        let count = |key: &str| schema.get(key).and_then(Value::as_u64);
        if count("minItems").is_some_and(|n| (items.len() as u64) < n)
            || count("maxItems").is_some_and(|n| (items.len() as u64) > n)
        {
            return say("as long as it has to be");
        }
        if let Some(each) = schema.get("items") {
            return items.iter().find_map(|v| broken(each, v, at));
        }
    }
    if let Some(table) = value.as_object() {
        for key in list("required").into_iter().flatten() {
            if !table.contains_key(key.as_str().unwrap()) {
                return Some(format!("{at}: {key} is missing"));
            }
        }
        for (key, inner) in table {
            let at = format!("{at}.{key}");
            let known = schema.get("properties").and_then(|p| p.get(key));
            let open = schema.get("additionalProperties") != Some(&Value::Bool(false));
            match known {
                Some(s) => {
                    if let Some(wrong) = broken(s, inner, &at) {
                        return Some(wrong);
                    }
                }
                None if open => {}
                None => return Some(format!("{at} is not known")),
            }
        }
    }
    list("allOf")
        .into_iter()
        .flatten()
        .find_map(|part| match (part.get("if"), part.get("then")) {
            (Some(when), Some(then)) => fits(when, value).then(|| broken(then, value, at))?,
            _ => broken(part, value, at),
        })
}

/// A file of TOML as a schema sees it: dates are text.
fn as_json(text: &str) -> Value {
    fn of(value: toml::Value) -> Value {
        match value {
            toml::Value::Datetime(d) => Value::String(d.to_string()),
            toml::Value::Array(list) => list.into_iter().map(of).collect(),
            toml::Value::Table(t) => {
                Value::Object(t.into_iter().map(|(k, v)| (k, of(v))).collect())
            }
            plain => serde_json::to_value(plain).unwrap(),
        }
    }
    of(toml::Value::Table(text.parse().unwrap()))
}

#[test]
fn every_manifest_and_rig_conforms_to_its_schema() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = ["datasets", "fits", "tests/data"]
        .map(|d| root.join(d))
        .to_vec();
    if let Some(shared) = std::env::var_os("DEACAL_SHARED") {
        folders.push(Path::new(&shared).join("datasets"));
    }
    let found = folders
        .iter()
        .flat_map(|dir| common::files_below(dir, ".toml"));
    let (recording, rig) = (
        deacal::recording::recording_schema(),
        deacal::recording::rig_schema(),
    );
    let mut looked_at = [0, 0];
    for path in found {
        let text = std::fs::read_to_string(&path).unwrap();
        let at = path.display().to_string();
        let sound = [
            deacal::recording::Manifest::parse(&path, &text).is_ok(),
            deacal::recording::Rig::parse(&path, &text).is_ok(),
        ];
        for (which, schema) in [&recording, &rig].into_iter().enumerate() {
            if sound[which] {
                looked_at[which] += 1;
                assert_eq!(broken(schema, &as_json(&text), &at), None);
            }
        }
    }
    assert!(looked_at[0] >= 30 && looked_at[1] >= 4, "{looked_at:?}");
}

#[test]
fn what_a_reader_refuses_a_schema_refuses() {
    let sound = std::fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("datasets/twin2026_delta/symmetric/recording.toml"),
    )
    .unwrap();
    let schema = deacal::recording::recording_schema();
    let refused = |text: &str| {
        let reader = deacal::recording::Manifest::parse(Path::new("recording.toml"), text).is_err();
        let schema = broken(&schema, &as_json(text), "recording").is_some();
        (reader, schema)
    };
    assert_eq!(refused(&sound), (false, false));
    for (from, to) in [
        ("kind = \"robot\"", "kind = \"robots\""),
        ("kind = \"robot\"", "kind = \"axis\""),
        ("[recording]", "[recording]\ncolour = 1"),
        ("[recording]", "[recording]\ntemperature_C = \"warm\""),
        ("[recording]", "[recording]\ntemperature_C = 294.5"),
        ("[recording]", "[recording]\nhumidity_percent = 140"),
        ("day = 1", "day = -3"),
        ("\"relaxed\"", "\"wet\""),
        ("[motion]", "[motion]\nrate_hz = 0"),
        ("[motion]", "[motion]\nend_effector_near_mm = [1, 2]"),
        ("channels", "chanels"),
        ("[sync]", "[bench]\n[sync]"),
    ] {
        let text = sound.replacen(from, to, 1);
        assert_ne!(text, sound, "{from} is not in the file");
        assert_eq!(refused(&text), (true, true), "{to}");
    }
}
