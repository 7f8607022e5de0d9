//! JSON Schemas of the files that the program writes and of those that users write, kept in `schemas/` as well.

use schemars::{JsonSchema, schema_for};

use super::ageing_json::AgeingJson;
use super::batch::BatchJson;
use super::diagnosis_json::DiagnosisJson;
use super::json::{FitJson, ImportJson, ValidationJson, to_text};
use super::parameter_file::ParametersJson;
use super::plan_file::PlanFile;
use crate::recording::{recording_schema, rig_schema};

/// Name and text of every schema: `fit` is `schemas/fit.schema.json`.
#[must_use]
pub fn schemas() -> Vec<(&'static str, String)> {
    vec![
        ("fit", text::<FitJson>()),
        ("validation", text::<ValidationJson>()),
        ("diagnosis", text::<DiagnosisJson>()),
        ("ageing", text::<AgeingJson>()),
        ("batch", text::<BatchJson>()),
        ("import", text::<ImportJson>()),
        ("parameters", text::<ParametersJson>()),
        ("plan", text::<PlanFile>()),
        ("recording", to_text(&recording_schema())),
        ("rig", to_text(&rig_schema())),
    ]
}

fn text<T: JsonSchema>() -> String {
    to_text(&schema_for!(T))
}
