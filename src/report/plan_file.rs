//! `plan.toml`: the choices that turned recordings into datasets, one `[[recording]]` table each. Given back,
//! they are made again, to the bit.

use std::fmt::Write;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::parameter_file::number;
use crate::dataset::{Plan, SmoothingPlan, StretchPlan, SyncPlan};
use crate::recording::Error;
use crate::recording::keys::{Document, Keys, PLAN};

/// The content of the file.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "plan.toml")]
pub struct PlanFile {
    /// One a recording.
    #[serde(rename = "recording")]
    pub plans: Vec<Plan>,
}

/// The text of `plan.toml`.
#[must_use]
pub fn plan_to_toml(plans: &[Plan]) -> String {
    let string = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let mut out = String::from(
        "# Choices made for each recording. Given back, the same choices are made again.\n\
         # order: of the smoothing spline (3 quintic, 4 septic); cutoff_hz: half-power frequency; noise_mm: capture noise found;\n\
         # offset_s: voltage clock minus motion clock where it is kept, else it is estimated;\n\
         # sync: what told the offset and the skew of the clocks, where events or a shared channel did;\n\
         # stretches: what is compared of a recording that is longer than a fit holds, evenly spread over it.\n",
    );
    for plan in plans {
        let _ = write!(
            out,
            "\n[[recording]]\nrecording = {}\ncriterion = {}\n",
            string(&plan.recording),
            string(&plan.criterion)
        );
        if let Some(offset_s) = plan.offset_s {
            let _ = writeln!(out, "offset_s = {}", number(offset_s));
        }
        if let Some(sync) = &plan.sync {
            let _ = write!(
                out,
                "sync = {{ method = {}, skew_ppm = {}, middle_s = {}",
                string(&sync.method),
                number(sync.skew_ppm),
                number(sync.middle_s)
            );
            if let Some(e) = sync.offset_std_error_s {
                let _ = write!(out, ", offset_std_error_s = {}", number(e));
            }
            if let Some(e) = sync.skew_std_error_ppm {
                let _ = write!(out, ", skew_std_error_ppm = {}", number(e));
            }
            out.push_str(" }\n");
        }
        if let Some(s) = &plan.stretches {
            let _ = writeln!(
                out,
                "stretches = {{ count = {}, length_s = {} }}",
                s.count,
                number(s.length_s)
            );
        }
        out.push_str("smoothing = [\n");
        for (s, axis) in plan.smoothing.iter().zip(["x", "y", "z"].iter().cycle()) {
            let _ = writeln!(
                out,
                "  {{ order = {}, cutoff_hz = {}, noise_mm = {}{} }}, # {axis}",
                s.order,
                number(s.cutoff_hz),
                number(s.noise_mm),
                if s.follows { ", follows = true" } else { "" }
            );
        }
        out.push_str("]\n");
    }
    out
}

/// Reads a `plan.toml`.
///
/// # Errors
/// The file cannot be read; a key is unknown (the nearest is named), missing, of the wrong type or cannot be.
pub fn read_plan(path: &Path) -> Result<Vec<Plan>, Error> {
    read(&Document::read(path, &PLAN)?)
}

/// Reads the text of a `plan.toml`; `path` is for messages.
///
/// # Errors
/// As [`read_plan`].
pub fn parse_plan(path: &Path, text: &str) -> Result<Vec<Plan>, Error> {
    read(&Document::new(path, text.to_owned(), &PLAN))
}

fn read(document: &Document) -> Result<Vec<Plan>, Error> {
    let root = document.parse()?;
    let top = Keys::top(document, &root, &["recording"])?;
    let mut plans: Vec<Plan> = Vec::new();
    for t in top.tables(
        "recording",
        &[
            "recording",
            "criterion",
            "offset_s",
            "sync",
            "stretches",
            "smoothing",
        ],
    )? {
        let recording: String = t.need("recording")?;
        if plans.iter().any(|p| p.recording == recording) {
            return Err(t
                .bad("recording", format!("\"{recording}\" is there twice"))
                .expected("one table a recording"));
        }
        let axes = t.tables("smoothing", &["order", "cutoff_hz", "noise_mm", "follows"])?;
        if axes.len() != 3 {
            return Err(t
                .bad("smoothing", format!("found {} axes", axes.len()))
                .expected("3: x, y and z"));
        }
        let mut smoothing = Vec::with_capacity(3);
        for axis in &axes {
            let order = axis.need::<i64>("order")?;
            let known = crate::dataset::smoother::ORDERS;
            let order = usize::try_from(order)
                .ok()
                .filter(|o| known.contains(o))
                .ok_or_else(|| {
                    axis.bad("order", format!("found {order}"))
                        .expected("3 or 4")
                })?;
            smoothing.push(SmoothingPlan {
                order,
                cutoff_hz: axis.need_positive("cutoff_hz")?,
                noise_mm: axis.need_not_negative("noise_mm")?,
                follows: axis.get("follows")?.unwrap_or(false),
            });
        }
        let sync = t
            .table(
                "sync",
                &[
                    "method",
                    "skew_ppm",
                    "middle_s",
                    "offset_std_error_s",
                    "skew_std_error_ppm",
                ],
            )?
            .map(|s| -> Result<SyncPlan, Error> {
                Ok(SyncPlan {
                    method: s.need("method")?,
                    offset_std_error_s: s.get("offset_std_error_s")?,
                    skew_ppm: s.need("skew_ppm")?,
                    skew_std_error_ppm: s.get("skew_std_error_ppm")?,
                    middle_s: s.need("middle_s")?,
                })
            })
            .transpose()?;
        let stretches = t
            .table("stretches", &["count", "length_s"])?
            .map(|s| -> Result<StretchPlan, Error> {
                let count = s.need::<i64>("count")?;
                Ok(StretchPlan {
                    count: usize::try_from(count)
                        .ok()
                        .filter(|c| *c > 0)
                        .ok_or_else(|| {
                            s.bad("count", format!("found {count}"))
                                .expected("1 or more")
                        })?,
                    length_s: s.need_positive("length_s")?,
                })
            })
            .transpose()?;
        plans.push(Plan {
            stretches,
            recording,
            smoothing,
            criterion: t.get("criterion")?.unwrap_or_default(),
            offset_s: t.get("offset_s")?,
            sync,
        });
    }
    Ok(plans)
}
