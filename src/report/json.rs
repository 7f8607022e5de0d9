//! `fit.json`, `validation.json` and `import.json`: plain data, in the keys that scripts rely on. A number
//! that does not exist (NaN) is null. No time of day is written: the same inputs give the same bytes.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;

use super::effect_entries::actuators;
use super::parameter_file::Effect;
use super::provenance::{FileSum, Provenance};
use crate::calibration::{
    AtBound, ChainError, CouponFit, CouponOutcome, CouponPlace, CouponTotal, Estimate, LineFit,
    LineOutcome, Outcome, RecordingOutcome, SampleFit, SampleOutcome, StartOutcome, WeakDirection,
};
use crate::checks::Finding;
use crate::dataset::{CouponMode, CouponPlan, Dataset, OffsetSource, Plan, Voltage};
use crate::effects::Acting;
use crate::film::InitialState;
use crate::recording::{
    Doubt, Level, Marker, Note, Payload, RawColumn, RawCoordinate, RawElongation, RawLoad,
    RawMonitor, RawMotion, RawVoltage, Recording, SectionSurvey, Survey,
};
use crate::validation::{self, Validation};

/// A number, or null where there is none.
pub type Number = Option<f64>;

/// NaN and infinities become `None`.
#[must_use]
pub fn finite(value: f64) -> Number {
    value.is_finite().then_some(value)
}

/// Something that is wrong with a recording, or looks so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FindingJson {
    /// The kind of mistake: `chain_order`, `mirror`, `axes`, `unit`, `rate`, `clock`, `polarity`, `sentinel`,
    /// `stated_value`, ...
    pub check: String,
    /// `wrong`: a diagnosis stops at it; `doubtful`: it is said, and the job goes on.
    pub grade: String,
    /// Identity of the recording.
    pub recording: String,
    /// What is seen, with the evidence.
    pub says: String,
    /// What to do.
    pub remedy: String,
    /// Probability of evidence as strong from a sound recording; null where it is a matter of plausibility.
    pub p_value: Number,
}

impl FindingJson {
    /// Of findings, in their order.
    #[must_use]
    pub fn of(findings: &[Finding]) -> Vec<Self> {
        let one = |f: &Finding| FindingJson {
            check: f.check.into(),
            grade: f.grade.name().into(),
            recording: f.recording.clone(),
            says: f.says.clone(),
            remedy: f.remedy.clone(),
            p_value: finite(f.p_value),
        };
        findings.iter().map(one).collect()
    }
}

/// Values by name, in an order of their own.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Named<T>(pub Vec<(String, T)>);

impl<T> Named<T> {
    /// The value of a name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&T> {
        self.0.iter().find(|(n, _)| n == name).map(|(_, v)| v)
    }
}

impl<T: Serialize> Serialize for Named<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(n, v)| (n, v)))
    }
}

impl<'de, T: serde::de::DeserializeOwned> Deserialize<'de> for Named<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let map = serde_json::Map::<String, Value>::deserialize(deserializer)?;
        map.into_iter()
            .map(|(n, v)| Ok((n, serde_json::from_value(v)?)))
            .collect::<Result<_, serde_json::Error>>()
            .map(Named)
            .map_err(serde::de::Error::custom)
    }
}

impl<T: JsonSchema> JsonSchema for Named<T> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> std::borrow::Cow<'static, str> {
        format!("Named_{}", T::schema_name()).into()
    }
    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        std::collections::BTreeMap::<String, T>::json_schema(generator)
    }
}

/// The text of a JSON file: two spaces an indent, lists of numbers or words in one line, a newline at the
/// end.
///
/// # Panics
/// Never for the types of this room: all their keys are strings.
#[must_use]
pub fn to_text(content: &impl Serialize) -> String {
    let value = serde_json::to_value(content).expect("keys are strings");
    let mut out = String::new();
    pretty(&value, 0, &mut out);
    out.push('\n');
    out
}

/// What has to be a number and is none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error(
    "{file}: {place} came out as no finite number, so nothing is written: check the constants that rig, manifest and parameters state, and their units"
)]
pub struct NoFigure {
    file: String,
    place: String,
}

/// The text of a file of results, as [`to_text`] makes it. Null stands only where a key's description says
/// that there may be no number: errors of no sample, the standard error of what was held or is not
/// determined, what a job has no use for.
///
/// # Errors
/// The first place at which there is no number though there should be one.
pub fn results_to_text(file: &str, content: &impl Serialize) -> Result<String, NoFigure> {
    let root = serde_json::to_value(content).expect("keys are strings");
    match missing(&root, &root, "") {
        None => Ok(to_text(&root)),
        Some(place) => Err(NoFigure {
            file: file.to_owned(),
            place,
        }),
    }
}

/// Whether a key of `own`, anywhere in a file of results, has to be a number.
fn is_figure(root: &Value, own: &serde_json::Map<String, Value>, key: &str) -> bool {
    let above_0 = |name: &str| own.get(name).and_then(Value::as_u64) > Some(0);
    let is = |name: &str| own.get(name) == Some(&Value::Bool(true));
    let job = root.get("job").and_then(Value::as_str);
    let of_robot = matches!(job, Some("film" | "forearm" | "robot"));
    match key {
        "rmse_V" | "max_error_V" => above_0("n_samples"),
        // of a coupon's noise only an upper bound may be known
        "noise_floor_V" => above_0("n_samples") && root.get("rmse_unit") != Some(&"Pa".into()),
        "rmse_all_V" => above_0("n_samples_all"),
        "value" => own.contains_key("identifiable"),
        "std_error" | "ci95" => is("identifiable") && !is("fixed"),
        "weighted_mean_square" | "noise_mean_square" => of_robot,
        "eps_r" => of_robot || job == Some("sample"),
        "probability" => true,
        // what has to be mended first has no odds
        "confidence" => root.get("verdict") != Some(&"recording".into()),
        _ => false,
    }
}

/// Where a figure is missing.
fn missing(root: &Value, value: &Value, place: &str) -> Option<String> {
    match value {
        Value::Object(own) => own.iter().find_map(|(key, value)| {
            let place = match place {
                "" => key.clone(),
                place => format!("{place}.{key}"),
            };
            let nulls = match value {
                Value::Array(list) => list.contains(&Value::Null),
                value => value.is_null(),
            };
            match nulls && is_figure(root, own, key) {
                true => Some(place),
                false => missing(root, value, &place),
            }
        }),
        Value::Array(list) => (list.iter().enumerate())
            .find_map(|(i, value)| missing(root, value, &format!("{place}[{i}]"))),
        _ => None,
    }
}

fn pretty(value: &Value, depth: usize, out: &mut String) {
    let scalar = |v: &Value| !v.is_array() && !v.is_object();
    let short = |v: &Value| match v {
        Value::Array(list) => list.iter().all(scalar),
        Value::Object(map) => map.is_empty(),
        _ => true,
    };
    let indent = |out: &mut String, depth: usize| {
        out.push('\n');
        out.extend(std::iter::repeat_n("  ", depth));
    };
    match value {
        Value::Array(list) if !short(value) => {
            out.push('[');
            for (i, v) in list.iter().enumerate() {
                out.push_str(if i > 0 { "," } else { "" });
                indent(out, depth + 1);
                pretty(v, depth + 1, out);
            }
            indent(out, depth);
            out.push(']');
        }
        Value::Array(list) => {
            out.push('[');
            for (i, v) in list.iter().enumerate() {
                out.push_str(if i > 0 { ", " } else { "" });
                pretty(v, depth, out);
            }
            out.push(']');
        }
        Value::Object(map) if !map.is_empty() => {
            out.push('{');
            for (i, (key, v)) in map.iter().enumerate() {
                out.push_str(if i > 0 { "," } else { "" });
                indent(out, depth + 1);
                out.push_str(&Value::from(key.as_str()).to_string());
                out.push_str(": ");
                pretty(v, depth + 1, out);
            }
            indent(out, depth);
            out.push('}');
        }
        other => out.push_str(&other.to_string()),
    }
}

/// The error of a prediction. In V unless `rmse_unit` of the file says otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Errors {
    /// Root mean square over the samples of `rmse_basis`; null where there is none, as everything here that
    /// is over none.
    #[serde(rename = "rmse_V")]
    pub rmse_v: Number,
    /// Largest magnitude among them.
    #[serde(rename = "max_error_V")]
    pub max_error_v: Number,
    /// Their number; three a frame for a robot.
    pub n_samples: usize,
    /// Root mean square over all samples outside gaps and 0.3 s from the ends.
    #[serde(rename = "rmse_all_V")]
    pub rmse_all_v: Number,
    /// Their number.
    pub n_samples_all: usize,
    /// What the noise of the capture alone makes of the prediction, rms, over the samples of `rmse_basis`.
    #[serde(rename = "noise_floor_V")]
    pub noise_floor_v: Number,
    /// Samples with phi^2 < 0: no voltage holds that pose; they count as 0 V.
    pub n_negative: usize,
}

impl From<&ChainError> for Errors {
    fn from(e: &ChainError) -> Self {
        let some = e.samples > 0;
        Errors {
            rmse_v: finite(e.rmse_v).filter(|_| some),
            max_error_v: finite(e.max_error_v).filter(|_| some),
            n_samples: e.samples,
            rmse_all_v: finite(e.rmse_all_v),
            n_samples_all: e.samples_all,
            noise_floor_v: finite(e.noise_floor_v),
            n_negative: e.negative,
        }
    }
}

impl From<CouponTotal> for Errors {
    fn from(t: CouponTotal) -> Self {
        let rmse_pa = finite(t.rmse_pa);
        Errors {
            rmse_v: rmse_pa,
            max_error_v: finite(t.max_error_pa).filter(|_| t.n_samples > 0),
            n_samples: t.n_samples,
            rmse_all_v: rmse_pa,
            n_samples_all: t.n_samples,
            noise_floor_v: finite(t.noise_pa),
            n_negative: 0,
        }
    }
}

/// `rmse_basis` of everything that has no voltage.
pub const ALL: &str = "all";
/// `rmse_basis` of a robot or a film sample.
pub const ABOVE_1KV: &str = "above_1kV";

/// A gap of the capture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GapJson {
    /// Time of the first missing frame on the motion clock, s.
    pub start_s: f64,
    /// Missing frames.
    pub frames: usize,
    /// Length, s.
    pub duration_s: f64,
}

fn gaps(time_s: &[f64], gaps: &[(usize, usize)]) -> Vec<GapJson> {
    let step = match time_s {
        [a, .., b] => (b - a) / (time_s.len() - 1) as f64,
        _ => 0.0,
    };
    gaps.iter()
        .filter_map(|&(first, frames)| {
            Some(GapJson {
                start_s: *time_s.get(first)?,
                frames,
                duration_s: step * frames as f64,
            })
        })
        .collect()
}

/// One recording against the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RecordingFit {
    /// Identity.
    pub id: String,
    /// All chains together.
    #[serde(flatten)]
    pub errors: Errors,
    /// Chains 1 to 3; one for a film sample or a coupon.
    pub chains: Vec<Errors>,
    /// What only a coupon has.
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    pub coupon: Option<CouponJson>,
    /// What only a hanging sample has.
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    pub sample: Option<SampleJson>,
    /// Voltage clock minus motion clock, s; null where there is only one clock.
    pub offset_s: Number,
    /// Its standard error, s; null where it was not estimated.
    pub offset_std_error_s: Number,
    /// Gaps of the capture.
    pub gaps: Vec<GapJson>,
    /// Frames that the mechanism cannot reach.
    pub n_unreachable: usize,
    /// What a reader should know.
    pub notes: Vec<String>,
}

impl From<&RecordingOutcome> for RecordingFit {
    fn from(r: &RecordingOutcome) -> Self {
        RecordingFit {
            id: r.id.clone(),
            errors: (&r.total).into(),
            chains: r.chains.iter().map(Errors::from).collect(),
            coupon: None,
            sample: None,
            offset_s: finite(r.offset_s),
            offset_std_error_s: r.offset_std_error_s.and_then(finite),
            gaps: gaps(&r.time_s, &r.gaps),
            n_unreachable: r.unreachable.len(),
            notes: r.notes.clone(),
        }
    }
}

/// What only a coupon has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CouponJson {
    /// `uniaxial`, `equibiaxial` or `pure-shear`.
    pub mode: String,
    /// `relaxed` or `virgin` at the first row.
    pub film_state: String,
    /// Root mean square error over the range of the measured stress, %.
    pub nrmse_percent: Number,
    /// Root mean square error over the largest measured stress, %.
    pub nrmse_of_max_percent: Number,
    /// Standard deviation of the stress noise, Pa.
    #[serde(rename = "noise_Pa")]
    pub noise_pa: Number,
    /// Whether `noise_Pa` is the noise, not only an upper bound; `noise_floor_V` is null where it is not.
    pub noise_known: bool,
    /// Whether the error is more than the noise.
    pub exceeds_noise: bool,
    /// Correlation length of the error, rows.
    pub correlation_rows: Number,
    /// What a row was divided by in the fit, Pa.
    #[serde(rename = "scale_Pa")]
    pub scale_pa: Number,
    /// Whether it fits, in one sentence.
    pub verdict: String,
}

impl From<&CouponFit> for RecordingFit {
    fn from(c: &CouponFit) -> Self {
        let errors = Errors::from(CouponTotal {
            rmse_pa: c.rmse_pa,
            max_error_pa: c.max_error_pa,
            n_samples: c.n_samples,
            noise_pa: if c.noise_known { c.noise_pa } else { f64::NAN },
        });
        let mode = match c.mode {
            CouponMode::Uniaxial => "uniaxial",
            CouponMode::Equibiaxial => "equibiaxial",
            CouponMode::PureShear => "pure-shear",
        };
        let film_state = match c.initial {
            InitialState::Relaxed => "relaxed",
            InitialState::Virgin => "virgin",
        };
        RecordingFit {
            id: c.id.clone(),
            errors,
            chains: vec![errors],
            coupon: Some(CouponJson {
                mode: mode.to_owned(),
                film_state: film_state.to_owned(),
                nrmse_percent: finite(c.nrmse_percent),
                nrmse_of_max_percent: finite(c.nrmse_of_max_percent),
                noise_pa: finite(c.noise_pa),
                noise_known: c.noise_known,
                exceeds_noise: c.exceeds_noise(),
                correlation_rows: finite(c.correlation_rows),
                scale_pa: finite(c.scale_pa),
                verdict: c.verdict.clone(),
            }),
            sample: None,
            offset_s: None,
            offset_std_error_s: None,
            gaps: Vec::new(),
            n_unreachable: 0,
            notes: c.notes.clone(),
        }
    }
}

/// What only a hanging sample has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SampleJson {
    /// Predicted minus captured x, rms of frames averaged over a step of the integration, mm.
    pub rmse_x_mm: Number,
    /// What the noise of the capture makes of that, mm.
    pub noise_floor_x_mm: Number,
    /// Largest magnitude of it, mm.
    pub max_error_x_mm: Number,
    /// Noise of one captured frame, mm.
    pub noise_mm: Number,
    /// Length of the sample at rest by the model, mm.
    pub rest_length_mm: Number,
    /// Step of the integration, s.
    pub step_s: f64,
}

impl From<&SampleFit> for RecordingFit {
    fn from(r: &SampleFit) -> Self {
        let mm = |v: f64| finite(v * 1e3);
        RecordingFit {
            id: r.id.clone(),
            errors: (&r.error).into(),
            chains: vec![(&r.error).into()],
            coupon: None,
            sample: Some(SampleJson {
                rmse_x_mm: mm(r.rmse_m),
                noise_floor_x_mm: mm(r.noise_rmse_m),
                max_error_x_mm: mm(r.max_error_m),
                noise_mm: mm(r.noise_m),
                rest_length_mm: mm(r.rest_length_m),
                step_s: r.step_s,
            }),
            offset_s: finite(r.offset_s),
            offset_std_error_s: r.offset_std_error_s.and_then(finite),
            gaps: gaps(&r.time_s, &r.gaps),
            n_unreachable: 0,
            notes: r.notes.clone(),
        }
    }
}

/// One parameter of a fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ParameterJson {
    /// Value.
    pub value: Number,
    /// Unit of all values here.
    pub unit: String,
    /// Standard error; null where it was fixed, rests on a bound or is not determined at all.
    pub std_error: Number,
    /// Standard error as if the misfit were noise of its own size and correlation length: of coupons, of
    /// which `std_error` is what the noise alone leaves open. Null where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit_std_error: Number,
    /// 95 % interval; null where it was fixed.
    pub ci95: Option<[Number; 2]>,
    /// Whether it rests on a bound.
    pub at_bound: bool,
    /// Which: `lower`, `upper`.
    pub bound: Option<String>,
    /// Whether the recordings determine it.
    pub identifiable: bool,
    /// Whether it was held.
    pub fixed: bool,
    /// What it is.
    pub meaning: String,
    /// How far to trust it.
    pub says: String,
}

impl From<&Estimate> for ParameterJson {
    fn from(e: &Estimate) -> Self {
        let bound = e.at_bound.map(|b| match b {
            AtBound::Lower => "lower".to_owned(),
            AtBound::Upper => "upper".to_owned(),
        });
        ParameterJson {
            value: finite(e.value),
            unit: e.unit.to_string(),
            std_error: finite(e.std_error),
            misfit_std_error: None,
            ci95: (!e.fixed && e.ci95.iter().any(|v| v.is_finite())).then(|| e.ci95.map(finite)),
            at_bound: bound.is_some(),
            bound,
            identifiable: e.identifiable,
            fixed: e.fixed,
            meaning: e.meaning.clone(),
            says: e.says.clone(),
        }
    }
}

/// One start of a fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StartJson {
    /// Where it came from.
    pub origin: String,
    /// Sum of squares per residual that it reached.
    pub cost: Number,
    /// Evaluations that it took.
    pub evaluations: usize,
    /// Evaluations that failed.
    pub failed_evaluations: usize,
    /// Why it ended.
    pub ended: String,
    /// Relaxation times, s, and J that it reached.
    pub reached: Vec<Number>,
}

impl From<&StartOutcome> for StartJson {
    fn from(s: &StartOutcome) -> Self {
        StartJson {
            origin: s.origin.clone(),
            cost: finite(s.cost),
            evaluations: s.evaluations,
            failed_evaluations: s.failed,
            ended: s.ended.clone(),
            reached: s.reached.iter().map(|&v| finite(v)).collect(),
        }
    }
}

/// A combination of parameters that the recordings leave open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WeakDirectionJson {
    /// Relative standard deviation along it.
    pub relative_sd: Number,
    /// Share (-1 to 1) of each parameter that takes part, largest first.
    pub parts: Named<f64>,
    /// In words.
    pub says: String,
}

impl From<&WeakDirection> for WeakDirectionJson {
    fn from(w: &WeakDirection) -> Self {
        WeakDirectionJson {
            relative_sd: finite(w.relative_sd),
            parts: Named(w.parts.clone()),
            says: w.says.clone(),
        }
    }
}

/// Correlation of the free estimates.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct CorrelationJson {
    /// Names of rows and columns.
    pub names: Vec<String>,
    /// One row a name.
    pub rows: Vec<Vec<Number>>,
}

impl From<&(Vec<String>, Vec<Vec<f64>>)> for CorrelationJson {
    fn from((names, rows): &(Vec<String>, Vec<Vec<f64>>)) -> Self {
        CorrelationJson {
            names: names.clone(),
            rows: rows
                .iter()
                .map(|row| row.iter().map(|&v| finite(v)).collect())
                .collect(),
        }
    }
}

/// Where the prediction errs most, against the noise.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WorstPlaceJson {
    /// The place, in words.
    pub place: String,
    /// Error there over what the noise makes there.
    pub ratio: Number,
    /// Root mean square error there.
    #[serde(rename = "rmse_V")]
    pub rmse_v: Number,
    /// Share of the whole excess over the noise.
    pub share: Number,
}

impl From<&CouponPlace> for WorstPlaceJson {
    fn from(w: &CouponPlace) -> Self {
        WorstPlaceJson {
            place: format!("{}, {}", w.coupon, w.place),
            ratio: finite(w.ratio),
            rmse_v: finite(w.rmse_pa),
            share: finite(w.share),
        }
    }
}

/// Choices made for a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum PlanJson {
    /// Of a robot or a film sample.
    Motion(Plan),
    /// Of a coupon.
    Coupon(CouponPlan),
}

/// `fit.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "fit.json")]
pub struct FitJson {
    /// What was fitted: `film`, `forearm`, `robot`, `sample`, `coupon`, `hinge`, `axis`.
    pub job: String,
    /// Whether it fits, in one sentence.
    pub verdict: String,
    /// All recordings together.
    #[serde(flatten)]
    pub errors: Errors,
    /// Root of the mean squared NRMSE (error over the range of the measured stress) of coupons, %: what their
    /// fit makes small.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nrmse_percent: Number,
    /// Unit of the errors, here and below: `V`, `N m` for a hinge, `Pa` for a coupon, that of the input for
    /// an axis.
    pub rmse_unit: String,
    /// Samples over which `rmse_V` is taken: `above_1kV` or `all`.
    pub rmse_basis: String,
    /// Whether the fit converged.
    pub converged: bool,
    /// Why it stopped.
    pub reason: String,
    /// Evaluations of all starts and rounds.
    pub evaluations: usize,
    /// Those that failed.
    pub failed_evaluations: usize,
    /// Sum of weighted squares per residual; null for a coupon.
    pub weighted_mean_square: Number,
    /// What the noise alone would make of it; null but for a robot.
    pub noise_mean_square: Number,
    /// Every parameter, by name.
    pub parameters: Named<ParameterJson>,
    /// Relative permittivity used; null where no voltage is.
    pub eps_r: Number,
    /// Combinations of parameters that the recordings leave open, worst first.
    pub weak_directions: Vec<WeakDirectionJson>,
    /// Correlation of the free estimates.
    pub correlation: CorrelationJson,
    /// Each recording.
    pub recordings: Vec<RecordingFit>,
    /// Range of forearm swing that the recordings cover, deg.
    pub swing_range_deg: Option<[f64; 2]>,
    /// Where the prediction errs most.
    pub worst: Vec<WorstPlaceJson>,
    /// The starts, best first.
    pub starts: Vec<StartJson>,
    /// Choices made for each recording; of motions `plan.toml` holds the same.
    pub plan: Vec<PlanJson>,
    /// Further sentences a reader should see.
    pub remarks: Vec<String>,
    /// What the result was made of.
    pub provenance: Provenance,
    /// What is wrong with the recordings, or looks so: said before anything is fitted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub findings: Vec<FindingJson>,
}

impl FitJson {
    /// Of a calibration of the robot.
    #[must_use]
    pub fn new(outcome: &Outcome, provenance: Provenance) -> Self {
        let [low, high] = outcome.swing_range_deg;
        FitJson {
            findings: Vec::new(),
            rmse_unit: "V".to_owned(),
            rmse_basis: ABOVE_1KV.to_owned(),
            converged: outcome.converged,
            reason: outcome.reason.clone(),
            evaluations: outcome.evaluations,
            failed_evaluations: outcome.failed_evaluations,
            weighted_mean_square: finite(outcome.weighted_mean_square),
            noise_mean_square: finite(outcome.noise_mean_square),
            eps_r: finite(outcome.eps_r),
            weak_directions: outcome.weak_directions.iter().map(Into::into).collect(),
            correlation: (&outcome.correlation).into(),
            recordings: outcome.recordings.iter().map(RecordingFit::from).collect(),
            swing_range_deg: (low.is_finite() && high.is_finite()).then_some([low, high]),
            worst: outcome
                .worst
                .iter()
                .map(|w| WorstPlaceJson {
                    place: w.place.clone(),
                    ratio: finite(w.ratio),
                    rmse_v: finite(w.rmse_v),
                    share: finite(w.share),
                })
                .collect(),
            starts: outcome.starts.iter().map(Into::into).collect(),
            plan: outcome
                .recordings
                .iter()
                .map(|r| PlanJson::Motion(r.plan.clone()))
                .collect(),
            ..FitJson::found(
                (outcome.job, &outcome.verdict),
                (&outcome.total).into(),
                &outcome.estimates,
                &outcome.remarks,
                provenance,
            )
        }
    }

    /// What every job gives; the rest is empty.
    fn found(
        (job, verdict): (&str, &str),
        errors: Errors,
        estimates: &[Estimate],
        remarks: &[String],
        provenance: Provenance,
    ) -> Self {
        let parameters = estimates.iter().map(|e| (e.name.clone(), e.into()));
        FitJson {
            findings: Vec::new(),
            job: job.to_owned(),
            verdict: verdict.to_owned(),
            errors,
            nrmse_percent: None,
            rmse_unit: String::new(),
            rmse_basis: ALL.to_owned(),
            converged: false,
            reason: String::new(),
            evaluations: 0,
            failed_evaluations: 0,
            weighted_mean_square: None,
            noise_mean_square: None,
            parameters: Named(parameters.collect()),
            eps_r: None,
            weak_directions: Vec::new(),
            correlation: (&(Vec::new(), Vec::new())).into(),
            recordings: Vec::new(),
            swing_range_deg: None,
            worst: Vec::new(),
            starts: Vec::new(),
            plan: Vec::new(),
            remarks: remarks.to_vec(),
            provenance,
        }
    }

    /// Of a calibration on coupons: errors of the nominal stress in Pa over all rows, under the keys of the
    /// others.
    #[must_use]
    pub fn of_coupons(outcome: &CouponOutcome, provenance: Provenance) -> Self {
        let misfit = outcome.misfit_std_error.iter().copied();
        FitJson {
            findings: Vec::new(),
            nrmse_percent: finite(outcome.nrmse_percent),
            rmse_unit: "Pa".to_owned(),
            converged: outcome.converged,
            reason: outcome.reason.clone(),
            evaluations: outcome.evaluations,
            failed_evaluations: outcome.failed_evaluations,
            parameters: Named(
                outcome
                    .estimates
                    .iter()
                    .zip(misfit.chain(std::iter::repeat(f64::NAN)))
                    .map(|(e, misfit)| {
                        let misfit_std_error = finite(misfit);
                        let parameter = ParameterJson {
                            misfit_std_error,
                            ..e.into()
                        };
                        (e.name.clone(), parameter)
                    })
                    .collect(),
            ),
            weak_directions: outcome.weak_directions.iter().map(Into::into).collect(),
            correlation: (&outcome.correlation).into(),
            recordings: outcome.coupons.iter().map(Into::into).collect(),
            worst: outcome.worst.iter().map(Into::into).collect(),
            starts: outcome.starts.iter().map(Into::into).collect(),
            plan: outcome
                .coupons
                .iter()
                .map(|c| PlanJson::Coupon(c.plan.clone()))
                .collect(),
            ..FitJson::found(
                (outcome.job, &outcome.verdict),
                outcome.total().into(),
                &[],
                &outcome.remarks,
                provenance,
            )
        }
    }
}

impl FitJson {
    /// Of a fit of hinge benches or axes: errors of the torque, or of the input.
    #[must_use]
    pub fn of_lines(outcome: &LineOutcome, provenance: Provenance) -> Self {
        let errors = |(rmse, largest, n, noise): (f64, f64, usize, f64)| Errors {
            rmse_v: finite(rmse),
            max_error_v: finite(largest),
            n_samples: n,
            rmse_all_v: finite(rmse),
            n_samples_all: n,
            noise_floor_v: finite(noise),
            n_negative: 0,
        };
        let recording = |r: &LineFit| {
            let own = errors((r.rmse, r.max_error, r.n_samples, r.noise));
            RecordingFit {
                id: r.id.clone(),
                errors: own,
                chains: vec![own],
                coupon: None,
                sample: None,
                offset_s: None,
                offset_std_error_s: None,
                gaps: Vec::new(),
                n_unreachable: 0,
                notes: r.notes.clone(),
            }
        };
        FitJson {
            findings: Vec::new(),
            rmse_unit: outcome.unit.clone(),
            converged: outcome.converged,
            reason: outcome.reason.clone(),
            evaluations: outcome.evaluations,
            weighted_mean_square: finite(outcome.weighted_mean_square),
            noise_mean_square: Some(1.0),
            recordings: outcome.recordings.iter().map(recording).collect(),
            ..FitJson::found(
                (outcome.job, &outcome.verdict),
                errors(outcome.total()),
                &outcome.estimates,
                &outcome.remarks,
                provenance,
            )
        }
    }

    /// Of a calibration on hanging samples.
    #[must_use]
    pub fn of_samples(outcome: &SampleOutcome, provenance: Provenance) -> Self {
        FitJson {
            findings: Vec::new(),
            rmse_unit: "V".to_owned(),
            rmse_basis: ABOVE_1KV.to_owned(),
            converged: outcome.converged,
            reason: outcome.reason.clone(),
            evaluations: outcome.evaluations,
            failed_evaluations: outcome.failed_evaluations,
            weighted_mean_square: finite(outcome.weighted_mean_square),
            noise_mean_square: Some(1.0),
            eps_r: finite(outcome.eps_r),
            weak_directions: outcome.weak_directions.iter().map(Into::into).collect(),
            correlation: (&outcome.correlation).into(),
            recordings: outcome.recordings.iter().map(Into::into).collect(),
            starts: outcome.starts.iter().map(Into::into).collect(),
            plan: outcome
                .recordings
                .iter()
                .map(|r| PlanJson::Motion(r.plan.clone()))
                .collect(),
            ..FitJson::found(
                (outcome.job, &outcome.verdict),
                (&outcome.total).into(),
                &outcome.estimates,
                &outcome.remarks,
                provenance,
            )
        }
    }
}

/// Measured against predicted motion, per axis x, y, z.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PathErrors {
    /// `predicted` (forward dynamics of the recorded voltages) or `planned` (the path that they were made
    /// for).
    pub basis: String,
    /// Root mean square, mm.
    pub rmse_mm: [Number; 3],
    /// Largest magnitude, mm.
    pub max_mm: [Number; 3],
    /// Root mean square over `relative_to_mm`.
    pub rmse_relative: [Number; 3],
    /// Largest magnitude over `relative_to_mm`.
    pub max_relative: [Number; 3],
    /// Diameter of the measured path (its larger extent in x and y) for x and y, its stroke for z, mm; null
    /// below 1 mm.
    pub relative_to_mm: [Number; 3],
    /// Frames.
    pub n_frames: usize,
}

impl From<&validation::PathErrors> for PathErrors {
    fn from(p: &validation::PathErrors) -> Self {
        let relative = |v: [f64; 3]| [0, 1, 2].map(|k| finite(v[k].abs() / p.relative_to_mm[k]));
        PathErrors {
            basis: if p.planned { "planned" } else { "predicted" }.to_owned(),
            rmse_mm: p.rmse_mm.map(finite),
            max_mm: p.max_mm.map(|v| finite(v.abs())),
            rmse_relative: relative(p.rmse_mm),
            max_relative: relative(p.max_mm),
            relative_to_mm: p.relative_to_mm.map(finite),
            n_frames: p.frames,
        }
    }
}

/// Predicted output force against the payload's weight in one phase of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ForceErrors {
    /// `idle` (not driven yet), `hold` (driven, standing still), `move`, `released` (at 0 V again).
    pub phase: String,
    /// Root mean square of the vector, mN.
    #[serde(rename = "rmse_mN")]
    pub rmse_mn: Number,
    /// Its largest magnitude, mN.
    #[serde(rename = "max_mN")]
    pub max_mn: Number,
    /// `rmse_mN` over the largest weight of the payload; null without a payload.
    pub rmse_relative: Number,
    /// Root mean square along z, mN.
    #[serde(rename = "z_rmse_mN")]
    pub z_rmse_mn: Number,
    /// Error of largest magnitude along z, mN, with its sign.
    #[serde(rename = "z_max_mN")]
    pub z_max_mn: Number,
    /// `z_rmse_mN` over the largest weight of the payload.
    pub z_rmse_relative: Number,
    /// Root mean square of the resultant in the xy plane, mN.
    #[serde(rename = "xy_rmse_mN")]
    pub xy_rmse_mn: Number,
    /// Frames.
    pub n_frames: usize,
}

impl ForceErrors {
    fn new(f: &validation::ForceErrors, largest_load_n: f64) -> Self {
        let milli = |v: f64| finite(1e3 * v);
        ForceErrors {
            phase: f.phase.name().to_owned(),
            rmse_mn: milli(f.rmse_n),
            max_mn: milli(f.max_n),
            rmse_relative: finite(f.rmse_n / largest_load_n),
            z_rmse_mn: milli(f.z_rmse_n),
            z_max_mn: milli(f.z_max_n),
            z_rmse_relative: finite(f.z_rmse_n / largest_load_n),
            xy_rmse_mn: milli(f.xy_rmse_n),
            n_frames: f.frames,
        }
    }
}

/// Distance between lowest and highest position.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Stroke {
    /// As recorded, mm.
    pub recorded: Number,
    /// As predicted, mm.
    pub predicted: Number,
}

/// One recording of a validation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RecordingValidation {
    /// Errors in volts, offset, gaps.
    #[serde(flatten)]
    pub fit: RecordingFit,
    /// Predicted against recorded motion, where it was predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<PathErrors>,
    /// Predicted against measured force, phase by phase, where it was predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force: Option<Vec<ForceErrors>>,
    /// Stroke.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stroke_mm: Option<Stroke>,
}

/// One parameter file against all recordings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ModelValidation {
    /// The parameter file.
    pub params: FileSum,
    /// Whether it predicts, in one sentence.
    pub verdict: String,
    /// All recordings together.
    #[serde(flatten)]
    pub errors: Errors,
    /// Each recording.
    pub recordings: Vec<RecordingValidation>,
    /// Where the prediction errs most.
    pub worst: Vec<WorstPlaceJson>,
    /// Further sentences a reader should see.
    pub remarks: Vec<String>,
}

impl ModelValidation {
    /// Of parameters held against recordings.
    #[must_use]
    pub fn new(validation: &Validation, params: FileSum) -> Self {
        let fit = FitJson::new(&validation.outcome, Provenance::default());
        let checks = &validation.checks;
        let remarks = checks.iter().flat_map(|c| c.remarks.iter().cloned());
        ModelValidation {
            params,
            verdict: fit.verdict,
            errors: fit.errors,
            recordings: fit
                .recordings
                .into_iter()
                .zip(checks)
                .map(|(fit, c)| RecordingValidation {
                    fit,
                    path: c.path.as_ref().map(PathErrors::from),
                    force: Some(
                        c.force
                            .iter()
                            .map(|f| ForceErrors::new(f, c.largest_load_n))
                            .collect(),
                    ),
                    stroke_mm: Some(Stroke {
                        recorded: finite(c.stroke_mm[0]),
                        predicted: finite(c.stroke_mm[1]),
                    }),
                })
                .collect(),
            worst: fit.worst,
            remarks: fit.remarks.into_iter().chain(remarks).collect(),
        }
    }

    /// Of errors alone.
    fn of_fit(fit: FitJson, params: FileSum) -> Self {
        ModelValidation {
            params,
            verdict: fit.verdict,
            errors: fit.errors,
            recordings: fit
                .recordings
                .into_iter()
                .map(|fit| RecordingValidation {
                    fit,
                    path: None,
                    force: None,
                    stroke_mm: None,
                })
                .collect(),
            worst: fit.worst,
            remarks: fit.remarks,
        }
    }

    /// Of a model held against hinge benches, axes or coupons.
    #[must_use]
    pub fn of_lines(outcome: &LineOutcome, params: FileSum) -> Self {
        let mut model = Self::of_fit(FitJson::of_lines(outcome, Provenance::default()), params);
        for (r, own) in model.recordings.iter_mut().zip(&outcome.recordings) {
            let forward = own.forward.as_ref();
            r.path = forward.filter(|f| f.unit == "m").map(|f| {
                let first = |v: f64| [finite(v), None, None];
                PathErrors {
                    basis: "predicted".to_owned(),
                    relative_to_mm: first(f.range * 1e3),
                    n_frames: f.n_samples,
                    rmse_mm: first(f.rmse * 1e3),
                    max_mm: first(f.max_error * 1e3),
                    rmse_relative: first(f.rmse / f.range),
                    max_relative: first(f.max_error / f.range),
                }
            });
        }
        model
    }

    /// Of a film held against hanging samples.
    #[must_use]
    pub fn of_samples(outcome: &SampleOutcome, params: FileSum) -> Self {
        let fit = FitJson::of_samples(outcome, Provenance::default());
        let mut model = Self::of_fit(fit, params);
        for (r, s) in model.recordings.iter_mut().zip(&outcome.recordings) {
            let errors = || {
                let counted = s.counts.iter().zip(s.predicted_m.iter().zip(&s.captured_m));
                counted
                    .filter(|(counts, _)| **counts)
                    .map(|(_, (p, c))| (p - c) * 1e3)
            };
            let n = errors().count() as f64;
            let rmse = (errors().map(|e| e * e).sum::<f64>() / n).sqrt();
            let largest = errors().fold(0.0_f64, |m, e| m.max(e.abs()));
            let range = s.stroke_m[0] * 1e3;
            let first = |v: f64| [finite(v), None, None];
            r.path = Some(PathErrors {
                basis: "predicted".to_owned(),
                relative_to_mm: first(range),
                n_frames: errors().count(),
                rmse_mm: first(rmse),
                max_mm: first(largest),
                rmse_relative: first(rmse / range),
                max_relative: first(largest / range),
            });
            r.stroke_mm = Some(Stroke {
                recorded: finite(range),
                predicted: finite(s.stroke_m[1] * 1e3),
            });
        }
        model
    }
}

/// `validation.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "validation.json")]
pub struct ValidationJson {
    /// The first parameter file.
    #[serde(flatten)]
    pub model: ModelValidation,
    /// Unit of the errors.
    pub rmse_unit: String,
    /// Samples over which `rmse_V` is taken: `above_1kV` or `all`.
    pub rmse_basis: String,
    /// Further parameter files, in the order of the command.
    pub compared: Vec<ModelValidation>,
    /// What the result was made of.
    pub provenance: Provenance,
    /// What is wrong with the recordings, or looks so: said before anything is fitted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub findings: Vec<FindingJson>,
}

impl ValidationJson {
    /// Of one or more parameter files against the same recordings; errors are in V above 1 kV, or in the
    /// `unit` of a single coordinate over all samples.
    #[must_use]
    pub fn new(
        first: ModelValidation,
        compared: Vec<ModelValidation>,
        unit: Option<&str>,
        provenance: Provenance,
    ) -> Self {
        ValidationJson {
            findings: Vec::new(),
            model: first,
            rmse_unit: unit.unwrap_or("V").to_owned(),
            rmse_basis: unit.map_or(ABOVE_1KV, |_| ALL).to_owned(),
            compared,
            provenance,
        }
    }
}

/// Something that was found in a file, or dropped from it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct NoteJson {
    /// `info` or `warning`.
    pub level: String,
    /// The file.
    pub file: String,
    /// The line it is about, from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// The sentence.
    pub says: String,
}

impl From<&Note> for NoteJson {
    fn from(n: &Note) -> Self {
        NoteJson {
            level: match n.level {
                Level::Info => "info",
                Level::Warning => "warning",
            }
            .to_owned(),
            file: n.path.display().to_string(),
            line: n.line,
            says: n.text.clone(),
        }
    }
}

/// Smallest and largest value; null if there is none.
fn range(values: impl IntoIterator<Item = f64>) -> Option<[f64; 2]> {
    let [low, high] = values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| {
            [a.min(v), b.max(v)]
        });
    (low <= high).then_some([low, high])
}

fn rate_hz(time_s: &[f64]) -> Number {
    match time_s {
        [a, .., b] if b > a => Some((time_s.len() - 1) as f64 / (b - a)),
        _ => None,
    }
}

/// A column of a bare file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ColumnJson {
    /// Its name, with that of its group.
    pub name: String,
    /// As the file says; empty where it says none.
    pub unit: String,
    /// Its cell in the row, from 1.
    pub number: usize,
    /// Empty cells.
    pub missing: usize,
    /// Smallest and largest value, in `unit`.
    pub range: Option<[f64; 2]>,
}

/// A marker or a device of a bare file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GroupJson {
    /// As the file has it.
    pub name: String,
    /// Rows in which it has no value.
    pub missing: usize,
    /// Runs of such rows.
    pub gaps: usize,
    /// Rows of the longest run.
    pub longest_gap: usize,
}

/// One table of a bare file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SectionJson {
    /// `Trajectories`, `Devices`, `table`, ...
    pub name: String,
    /// Line at which it begins, from 1.
    pub line: u64,
    /// Rows.
    pub rows: usize,
    /// Samples per second: declared by the file, else from its time stamps, Hz.
    pub rate_hz: Number,
    /// First and last frame number, where the file counts frames.
    pub frames: Option<[i64; 2]>,
    /// First and last time on the file's own clock, s.
    pub time_s: Option<[f64; 2]>,
    /// Markers and devices.
    pub groups: Vec<GroupJson>,
    /// Columns.
    pub columns: Vec<ColumnJson>,
}

impl From<&SectionSurvey> for SectionJson {
    fn from(s: &SectionSurvey) -> Self {
        SectionJson {
            name: s.name.clone(),
            line: s.line,
            rows: s.rows,
            rate_hz: s.rate_hz.and_then(finite),
            frames: s.frames,
            time_s: s.time_s,
            groups: s
                .groups
                .iter()
                .map(|g| GroupJson {
                    name: g.name.clone(),
                    missing: g.gaps.missing,
                    gaps: g.gaps.runs,
                    longest_gap: g.longest_gap,
                })
                .collect(),
            columns: s
                .columns
                .iter()
                .map(|c| ColumnJson {
                    name: c.title.clone(),
                    unit: c.unit.clone(),
                    number: c.number,
                    missing: c.missing,
                    range: c.range,
                })
                .collect(),
        }
    }
}

/// Something in a bare file that looks wrong.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DoubtJson {
    /// `frozen`, `swap`, `spikes`, `clipped`, `unit` or `clock`.
    pub kind: String,
    /// The table.
    pub section: String,
    /// The markers or columns.
    pub what: Vec<String>,
    /// When it is first or worst, on the file's own clock, s.
    pub time_s: Number,
    /// One sentence.
    pub says: String,
}

impl From<&Doubt> for DoubtJson {
    fn from(d: &Doubt) -> Self {
        DoubtJson {
            kind: d.kind.name().to_owned(),
            section: d.section.clone(),
            what: d.what.clone(),
            time_s: d.time_s.and_then(finite),
            says: d.says.clone(),
        }
    }
}

/// A bare file: what is in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ImportFile {
    /// Its path.
    pub file: String,
    /// The importer that read it.
    pub format: String,
    /// Its tables.
    pub sections: Vec<SectionJson>,
    /// What was found and dropped.
    pub notes: Vec<NoteJson>,
    /// What looks wrong.
    pub doubts: Vec<DoubtJson>,
}

impl ImportFile {
    /// Of a file that was gone through.
    #[must_use]
    pub fn new(path: &Path, survey: &Survey) -> Self {
        ImportFile {
            file: path.display().to_string(),
            format: survey.format.to_owned(),
            sections: survey.sections.iter().map(SectionJson::from).collect(),
            notes: survey.notes.iter().map(NoteJson::from).collect(),
            doubts: survey.doubts.iter().map(DoubtJson::from).collect(),
        }
    }
}

/// A marker of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MarkerJson {
    /// As the file has it.
    pub label: String,
    /// Frames in which it was not seen.
    pub missing: usize,
    /// Smallest and largest x, y, z in capture axes, in `motion.unit`.
    pub range: [Option<[f64; 2]>; 3],
}

impl MarkerJson {
    /// Of a marker, in its own unit.
    fn of(m: &Marker) -> Self {
        MarkerJson {
            label: m.label.clone(),
            missing: m.xyz.iter().filter(|p| p[0].is_nan()).count(),
            range: [0, 1, 2].map(|k| range(m.xyz.iter().map(|p| p[k]))),
        }
    }
}

/// `[motion]` of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MotionJson {
    /// Samples per second, Hz.
    pub rate_hz: Number,
    /// Frames.
    pub frames: usize,
    /// Number of the first frame, where the file counts frames.
    pub first_frame: Option<i64>,
    /// First and last time on the motion clock, s.
    pub time_s: Option<[f64; 2]>,
    /// Unit of the positions as recorded.
    pub unit: String,
    /// The marker that moves.
    pub end_effector: MarkerJson,
    /// The marker fixed to the frame.
    pub base: Option<MarkerJson>,
}

impl MotionJson {
    /// Of a motion.
    fn of(m: &RawMotion) -> Self {
        MotionJson {
            rate_hz: finite(m.rate_hz),
            frames: m.time_s.len(),
            first_frame: m.first_frame,
            time_s: range(m.time_s.iter().copied()),
            unit: m.unit.symbol.to_owned(),
            end_effector: MarkerJson::of(&m.end_effector),
            base: m.base.as_ref().map(MarkerJson::of),
        }
    }
}

/// A channel of voltages or currents, or a column of a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ChannelJson {
    /// What the column is called.
    pub label: String,
    /// Unit as recorded.
    pub unit: String,
    /// Empty cells.
    pub missing: usize,
    /// Smallest and largest value, in `unit`.
    pub range: Option<[f64; 2]>,
}

impl ChannelJson {
    fn of(label: &str, unit: &str, values: &[f64]) -> Self {
        ChannelJson {
            label: label.to_owned(),
            unit: unit.to_owned(),
            missing: values.iter().filter(|v| v.is_nan()).count(),
            range: range(values.iter().copied()),
        }
    }

    /// Of a column of a table.
    fn of_column(c: &RawColumn) -> Self {
        ChannelJson::of(&c.label, c.unit.map_or("", |u| u.symbol), &c.values)
    }
}

/// A log with a clock of its own: `[voltage]`, `[monitor]`, or the one table of a coupon, bench or axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LogJson {
    /// Samples per second, Hz, on average.
    pub rate_hz: Number,
    /// Rows.
    pub rows: usize,
    /// First and last time on its own clock, s.
    pub time_s: Option<[f64; 2]>,
    /// `linear` or `previous`: what holds between samples of a voltage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold: Option<String>,
    /// Volts at the film per volt of the file, where stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Its columns.
    pub channels: Vec<ChannelJson>,
}

impl LogJson {
    fn new(time_s: &[f64], rows: usize, channels: Vec<ChannelJson>) -> Self {
        LogJson {
            rate_hz: rate_hz(time_s),
            rows,
            time_s: range(time_s.iter().copied()),
            hold: None,
            scale: None,
            channels,
        }
    }

    /// Of the voltages of the chains.
    fn of_voltage(v: &RawVoltage) -> Self {
        let hold = if v.hold_previous {
            "previous"
        } else {
            "linear"
        };
        let label = |i: usize| v.labels.get(i).map_or("", |l| l);
        let channels = v.channels.iter().enumerate();
        let channels = channels.map(|(i, c)| ChannelJson::of(label(i), v.unit.symbol, c));
        LogJson {
            hold: Some(hold.to_owned()),
            scale: v.scale,
            ..LogJson::new(&v.time_s, v.time_s.len(), channels.collect())
        }
    }

    /// Of what the amplifier measured.
    fn of_monitor(m: &RawMonitor) -> Self {
        let voltages = m.channels.iter().enumerate().map(|(i, c)| {
            ChannelJson::of(&format!("voltage of chain {}", i + 1), m.unit.symbol, c)
        });
        let channels = voltages.chain(m.current.iter().map(ChannelJson::of_column));
        LogJson {
            scale: m.scale,
            ..LogJson::new(&m.time_s, m.time_s.len(), channels.collect())
        }
    }

    /// The table of a coupon, bench or axis.
    fn of_table(recording: &Recording) -> Option<Self> {
        let table = |time: Option<&Vec<f64>>, columns: Vec<&RawColumn>| {
            LogJson::new(
                time.map_or(&[], |t| t),
                columns.first().map_or(0, |c| c.values.len()),
                columns.into_iter().map(ChannelJson::of_column).collect(),
            )
        };
        if let Some(c) = &recording.coupon {
            let elongation = match &c.elongation {
                RawElongation::Displacement { displacement, .. } => displacement,
                RawElongation::Stretch(stretch) => stretch,
            };
            let load = match &c.load {
                RawLoad::Force { force, .. } => force,
                RawLoad::NominalStress(stress) => stress,
            };
            return Some(table(c.time_s.as_ref(), vec![elongation, load]));
        }
        if let Some(b) = &recording.bench {
            return Some(table(b.time_s.as_ref(), vec![&b.angle, &b.torque]));
        }
        let a = recording.axis.as_ref()?;
        let (RawCoordinate::Position(coordinate) | RawCoordinate::Velocity(coordinate)) =
            &a.coordinate;
        let mut columns = vec![coordinate, &a.input];
        columns.extend(&a.load);
        Some(table(Some(&a.time_s), columns))
    }
}

/// The recording on one clock, in one frame, SI: what a calibration sees.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AlignedJson {
    /// Frames per second, Hz.
    pub rate_hz: Number,
    /// Frames.
    pub frames: usize,
    /// First and last frame on the motion clock, s.
    pub time_s: Option<[f64; 2]>,
    /// Smallest and largest position of the end effector's centre x, y, z in the world, mm.
    pub position_mm: [Option<[f64; 2]>; 3],
    /// Standard deviation of the capture noise of each axis, mm.
    pub noise_mm: [Number; 3],
    /// Largest speed, mm/s.
    pub max_speed_mm_s: Number,
    /// Largest acceleration, mm/s^2.
    pub max_acceleration_mm_s2: Number,
    /// Smallest and largest command of each chain, V.
    #[serde(rename = "command_V")]
    pub command_v: Vec<Option<[f64; 2]>>,
    /// Smallest and largest measured voltage of each chain, V.
    #[serde(rename = "monitor_V", default, skip_serializing_if = "Option::is_none")]
    pub monitor_v: Option<Vec<Option<[f64; 2]>>>,
    /// Voltage clock minus motion clock, s.
    pub offset_s: Number,
    /// Its standard error, s, where it was estimated by a fit.
    pub offset_std_error_s: Number,
    /// `stated`, `coarse` (a first look: a fit refines it), `estimated`, `events` or `shared channel`.
    pub offset_source: String,
    /// Gaps of the capture.
    pub gaps: Vec<GapJson>,
    /// Frames that can be used: captured, or in a gap that is bridged.
    pub usable_frames: usize,
    /// Choices that were made.
    pub plan: Plan,
    /// What a reader should know.
    pub notes: Vec<String>,
}

impl AlignedJson {
    /// Of a dataset; `offset_std_error_s` where a fit estimated the clock offset.
    #[must_use]
    pub fn new(d: &Dataset, offset_std_error_s: Option<f64>) -> Self {
        let n = d.samples();
        let times: Vec<f64> = (0..n).map(|i| d.time_s(i)).collect();
        let usable = || (0..n).filter(|&i| d.usable[i]);
        let largest = |f: &dyn Fn(usize, usize) -> f64| {
            let size = |i: usize| (0..3).map(|k| f(k, i).powi(2)).sum::<f64>().sqrt() * 1e3;
            range(usable().map(size)).map(|r| r[1])
        };
        let volts = |v: &Voltage| {
            let channels = v.channels_v().iter();
            channels.map(|c| range(c.iter().copied())).collect()
        };
        AlignedJson {
            rate_hz: finite(1.0 / d.step_s),
            frames: n,
            time_s: range(times.iter().copied()),
            position_mm: [0, 1, 2].map(|k| range(usable().map(|i| d.axes[k].position[i] * 1e3))),
            noise_mm: d.noise_m().map(|v| finite(v * 1e3)),
            max_speed_mm_s: largest(&|k, i| d.axes[k].velocity[i]),
            max_acceleration_mm_s2: largest(&|k, i| d.axes[k].acceleration[i]),
            command_v: volts(&d.voltage),
            monitor_v: d.monitor.as_ref().map(volts),
            offset_s: finite(d.offset_s),
            offset_std_error_s: offset_std_error_s
                .or(d.plan.sync.as_ref().and_then(|s| s.offset_std_error_s))
                .and_then(finite),
            offset_source: match (d.offset_source, offset_std_error_s) {
                (OffsetSource::Stated, _) => "stated",
                (OffsetSource::Measured, _) => {
                    d.plan.sync.as_ref().map_or("measured", |s| &s.method)
                }
                (OffsetSource::Free, None) => "coarse",
                (OffsetSource::Free, Some(_)) => "estimated",
            }
            .to_owned(),
            gaps: gaps(&times, &d.gaps()),
            usable_frames: usable().count(),
            plan: d.plan.clone(),
            notes: d.notes.clone(),
        }
    }
}

/// A recording: what its files hold, and what it became.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ImportRecording {
    /// Identity.
    pub id: String,
    /// `robot`, `film-sample`, `film-coupon`, `hinge-bench`, `axis`.
    pub kind: String,
    /// When it began, as the manifest has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<String>,
    /// Smallest and largest payload, g.
    pub payload_g: [f64; 2],
    /// Files that were read, with the importer of each.
    pub files: Vec<ImportedFile>,
    /// Motion as recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionJson>,
    /// Voltage as recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voltage: Option<LogJson>,
    /// The amplifier's own measurement as recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub monitor: Option<LogJson>,
    /// The table of a coupon, bench or axis as recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<LogJson>,
    /// On one clock, in one frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aligned: Option<AlignedJson>,
    /// What was found and dropped.
    pub notes: Vec<NoteJson>,
    /// What is wrong with the recordings, or looks so: said before anything is fitted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub findings: Vec<FindingJson>,
}

/// A file of a recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ImportedFile {
    /// Role, path and SHA-256.
    #[serde(flatten)]
    pub sum: FileSum,
    /// The importer that read it; `toml` for manifest and rig.
    pub format: String,
}

impl ImportRecording {
    /// Of a recording, and of the dataset that it became where it did.
    #[must_use]
    pub fn new(recording: &Recording, dataset: Option<&Dataset>) -> Self {
        ImportRecording {
            findings: Vec::new(),
            id: recording.manifest.id.clone(),
            kind: recording.manifest.kind.name().to_owned(),
            start: recording.manifest.start.as_ref().map(|s| s.text.clone()),
            payload_g: match &recording.manifest.payload {
                Payload::Constant { mass_g } => [*mass_g; 2],
                Payload::Steps(steps) => {
                    let masses = steps.iter().map(|s| s.mass_g);
                    range(masses.chain([0.0])).unwrap_or_default()
                }
            },
            files: recording
                .sources
                .iter()
                .map(|s| ImportedFile {
                    sum: FileSum::of(s),
                    format: s.format.clone(),
                })
                .collect(),
            motion: recording.motion.as_ref().map(MotionJson::of),
            voltage: recording.voltage.as_ref().map(LogJson::of_voltage),
            monitor: recording.monitor.as_ref().map(LogJson::of_monitor),
            table: LogJson::of_table(recording),
            aligned: dataset.map(|d| AlignedJson::new(d, None)),
            notes: recording.notes.iter().map(NoteJson::from).collect(),
        }
    }
}

/// `import.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "import.json")]
pub struct ImportJson {
    /// Recordings, in the order of the command.
    pub recordings: Vec<ImportRecording>,
    /// Bare files, in the order of the command.
    pub files: Vec<ImportFile>,
    /// Program and command.
    pub provenance: Provenance,
}

/// What a prediction gave, for `--json` of the predicting commands: the values themselves are in the file, or
/// in `columns` where none was named.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PredictionJson {
    /// Recording.
    pub id: String,
    /// The file; null where none was named.
    pub file: Option<String>,
    /// Rows, one a capture sample.
    pub rows: usize,
    /// Rows without a flag.
    pub predicted: usize,
    /// Rows by kind of flag: `gap`, `out of reach`, `phi^2 < 0`, ...
    pub flagged: std::collections::BTreeMap<String, usize>,
    /// What a reader should know: causes that were not applied, learnt terms outside their ranges.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// The columns of the table by name, null where nothing could be predicted; nothing where they are in a
    /// file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<Named<Vec<Option<f64>>>>,
}

impl PredictionJson {
    /// Counted from the flags of a predicted table.
    #[must_use]
    pub fn new(id: &str, file: Option<&Path>, flags: &[Option<super::csv::Missing>]) -> Self {
        let mut flagged = std::collections::BTreeMap::new();
        for flag in flags.iter().flatten() {
            let text = flag.to_string();
            let kind = text.split(':').next().unwrap_or("").to_owned();
            *flagged.entry(kind).or_insert(0) += 1;
        }
        PredictionJson {
            id: id.to_owned(),
            file: file.map(|f| f.display().to_string()),
            rows: flags.len(),
            predicted: flags.iter().filter(|f| f.is_none()).count(),
            flagged,
            remarks: Vec::new(),
            columns: None,
        }
    }

    /// The same with the table itself.
    #[must_use]
    pub fn with_columns(mut self, columns: &[super::csv::Column<'_>]) -> Self {
        let values = |c: &super::csv::Column<'_>| {
            let value = |row| Some(c.value(row)).filter(|v| v.is_finite());
            (c.name().to_owned(), (0..self.rows).map(value).collect())
        };
        self.columns = Some(Named(columns.iter().map(values).collect()));
        self
    }

    /// The same with what a reader should know.
    #[must_use]
    pub fn with_remarks(mut self, remarks: &[String]) -> Self {
        self.remarks.extend_from_slice(remarks);
        self
    }
}

/// A value of a cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ActedValue {
    /// A number, the three of a vector, or a word (a link, a recording).
    pub value: Value,
    /// Its unit.
    pub unit: String,
}

/// A cause that was at work in a simulation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ActedJson {
    /// Its id in the catalogue.
    pub effect: String,
    /// One sentence of physics.
    pub says: String,
    /// The actuators that it sits in; of a hanging sample the first stands for all.
    pub actuators: Vec<usize>,
    /// All of its values, those that were not stated too; what is switched off is left out.
    pub parameters: Named<ActedValue>,
    /// Where it was stated: `--effect`, or the parameter file.
    pub from: String,
}

impl ActedJson {
    /// A cause as it acted, and the entry that stated it; `recording` is the id of what was simulated.
    #[must_use]
    pub fn new(acting: &Acting, entry: &Effect, from: String, recording: &str) -> Self {
        let quantities = acting.effect.parameters();
        let mut parameters: Vec<(String, ActedValue)> = Vec::new();
        for (q, &value) in quantities.iter().zip(&acting.values) {
            let (name, place) = q.part();
            let stated = entry.values.iter().find(|(n, _)| n == name);
            let value = match (acting.effect.variants(), stated.map(|(_, v)| v)) {
                _ if !value.is_finite() => continue,
                (_, Some(toml::Value::String(word))) => Value::from(word.as_str()),
                (_, stated) if name == "recording" => {
                    stated.map_or_else(|| Value::from(recording), |v| v.to_string().into())
                }
                (forms @ [_, ..], _) if parameters.is_empty() => Value::from(forms[value as usize]),
                _ => Value::from(value),
            };
            match parameters.last_mut() {
                Some((last, list)) if place.is_some() && last == name => {
                    if let Value::Array(list) = &mut list.value {
                        list.push(value);
                    }
                }
                _ => {
                    let value = match place {
                        Some(_) => Value::Array(vec![value]),
                        None => value,
                    };
                    let unit = q.unit.to_owned();
                    parameters.push((name.to_owned(), ActedValue { value, unit }));
                }
            }
        }
        ActedJson {
            effect: acting.effect.id().to_owned(),
            says: acting.effect.says().to_owned(),
            actuators: actuators(acting.on),
            parameters: Named(parameters),
            from,
        }
    }

    /// In one line: `series_resistance on actuators 1, 2 (--effect): resistance 1e7 ohm`.
    #[must_use]
    pub fn line(&self) -> String {
        let values: Vec<String> = self
            .parameters
            .0
            .iter()
            .map(|(name, v)| match (&v.value, v.unit.as_str()) {
                (Value::String(word), _) => format!("{name} {word}"),
                (value, "1") => format!("{name} {value}"),
                (value, unit) => format!("{name} {value} {unit}"),
            })
            .collect();
        let on: Vec<String> = self.actuators.iter().map(usize::to_string).collect();
        format!(
            "{} on actuator {} ({}): {}",
            self.effect,
            on.join(", "),
            self.from,
            values.join(", ")
        )
    }
}

/// What `simulate` wrote, for `--json`: the recording itself is in the folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SimulationJson {
    /// Recording.
    pub id: String,
    /// `robot` or `film-sample`.
    pub kind: String,
    /// Its folder.
    pub folder: String,
    /// Its files.
    pub files: Vec<String>,
    /// Frames of the capture.
    pub n_frames: usize,
    /// From the first frame to the last, s.
    pub duration_s: f64,
    /// Height between lowest and highest pose, mm; of a hanging sample between its longest and its shortest
    /// length.
    pub stroke_mm: f64,
    /// Largest magnitude of a voltage, V.
    #[serde(rename = "largest_voltage_V")]
    pub largest_voltage_v: f64,
    /// Largest distance between planned and simulated pose, mm, where a path was planned.
    pub off_plan_mm: Number,
    /// Causes that the plain model leaves out and that were at work, in their order.
    pub effects: Vec<ActedJson>,
    /// Seed of the noise.
    pub seed: u64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// The result for a change of one key.
    fn told(path: &str, value: Value) -> Result<String, NoFigure> {
        let mut fit = json!({
            "job": "film", "rmse_V": 3.0, "max_error_V": 9.0, "n_samples": 10, "rmse_all_V": 4.0, "n_samples_all": 12,
            "noise_floor_V": 2.0, "rmse_unit": "V", "weighted_mean_square": 1.0, "noise_mean_square": 1.0, "eps_r": 2.8,
            "parameters": {"mu_1": {"value": 1.0, "std_error": 0.1, "ci95": [0.8, 1.2], "identifiable": true, "fixed": false}},
            "recordings": [{"rmse_V": 3.0, "n_samples": 10, "offset_s": null}],
        });
        *fit.pointer_mut(path).expect("a key") = value;
        results_to_text("fit.json", &fit)
    }

    #[test]
    fn a_figure_that_is_none_is_named_and_not_written() {
        assert!(told("/rmse_V", json!(3.0)).is_ok());
        let places = [
            "/rmse_V",
            "/max_error_V",
            "/rmse_all_V",
            "/noise_floor_V",
            "/eps_r",
            "/weighted_mean_square",
            "/parameters/mu_1/value",
            "/parameters/mu_1/std_error",
        ];
        for path in places {
            let error = told(path, Value::Null).unwrap_err().to_string();
            let place = path[1..].replace('/', ".");
            assert!(
                error.starts_with(&format!("fit.json: {place} came out")),
                "{error}"
            );
        }
        let error = told("/recordings/0/rmse_V", Value::Null).unwrap_err();
        assert!(
            error.to_string().contains("recordings[0].rmse_V"),
            "{error}"
        );
        assert!(told("/parameters/mu_1/ci95", json!([0.1, null])).is_err());
    }

    #[test]
    fn where_there_can_be_no_figure_there_is_none() {
        let of_nothing = json!({"rmse_V": null, "n_samples": 0, "offset_s": null});
        assert!(told("/recordings/0", of_nothing).is_ok());
        let open = json!({"value": 1.0, "std_error": null, "ci95": null, "identifiable": false, "fixed": false});
        assert!(told("/parameters/mu_1", open).is_ok());
    }
}
