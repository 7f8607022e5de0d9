//! `diagnosis.json`, in the keys that scripts rely on.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::effect_entries::{actuators, named, word};
use super::json::{FindingJson, Named, Number, finite};
use super::parameter_file::SeriesEntry;
use super::provenance::Provenance;
use crate::checks::{Finding, Grade};
use crate::diagnosis::{
    Candidate, Departed, Diagnosis, Gain, Hidden, Law, LearntPhysics, Place, RigKind, RivalModel,
};
use crate::effects::learnt::Form;

/// `diagnosis.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "diagnosis.json")]
pub struct DiagnosisJson {
    /// `adequate`, `missing_physics`, `unexplained` or `recording`: the recording or a stated number is
    /// wrong, and no physics is named.
    pub verdict: String,
    /// Probability of the verdict; null where the recording is to be mended first and no check has odds.
    pub confidence: Number,
    /// The verdict in one or two sentences.
    pub says: String,
    /// What is wrong with the recordings, or looks so: said before anything is fitted.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub findings: Vec<FindingJson>,
    /// Where model and recordings differ, most telling first.
    #[serde(rename = "where")]
    pub places: Vec<PlaceJson>,
    /// Causes, most probable first.
    pub candidates: Vec<CandidateJson>,
    /// Groups of causes that these recordings cannot tell apart.
    pub indistinguishable: Vec<Vec<String>>,
    /// What to record next.
    pub next_experiment: String,
    /// Causes that these recordings could not have shown.
    pub hidden: Vec<HiddenJson>,
    /// The law that was found in what no cause explains.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub law: Option<LawJson>,
    /// What was learnt where no cause explains what is left; the model after has it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub learnt: Option<LearntJson>,
    /// Samples over which the errors are taken.
    pub rmse_basis: String,
    /// Unit of the errors: V for a robot; for an axis that of its input, for a bench N m, for a coupon Pa.
    pub rmse_unit: String,
    /// Errors on the recordings that were fitted.
    #[serde(rename = "train_rmse_V")]
    pub train: GainJson,
    /// Errors on the recordings that were held out; null without any.
    #[serde(rename = "holdout_rmse_V")]
    pub holdout: Option<GainJson>,
    /// Weighted mean square of the plain model on the recordings that were fitted; noise alone makes 1.
    pub plain_mean_square: Number,
    /// The same on those that were held out.
    pub plain_holdout_mean_square: Number,
    /// The models that simpler methods end with, where `--rivals` asked for them.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub rivals: Vec<RivalJson>,
    /// Probabilities that nothing is left out, that it is a cause of the catalogue, and that it is something
    /// else.
    pub probabilities: ProbabilitiesJson,
    /// What may differ from the drawing, and by how much it does; empty where the model as drawn suffices.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub tolerances: Vec<ToleranceJson>,
    /// What the defaults among the tolerances are multiplied by, from 0 to 1: how well this robot was built.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub tolerance_scale: Option<f64>,
    /// What weakens the verdict.
    pub remarks: Vec<String>,
    /// The recordings in the order in which they were made.
    pub series: Vec<SeriesEntry>,
    /// What the result was made of.
    pub provenance: Provenance,
}

/// A place where model and recordings differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlaceJson {
    /// The coordinate: `voltage`, `direction`, `recording`, ...
    pub dimension: String,
    /// From and to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Unit of the range.
    #[serde(skip_serializing_if = "String::is_empty", default)]
    pub unit: String,
    /// A place that is a word.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
    /// The recording, where it is in one only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
    /// The actuators, where it is not in all.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub actuators: Vec<usize>,
    /// Share of the squares beyond noise that lies here.
    pub share_of_excess: Number,
    /// Share of the samples that lie here.
    pub share_of_samples: Number,
    /// Probability of as much by chance, over the whole search.
    pub p_value: Number,
    /// One sentence.
    pub says: String,
}

impl PlaceJson {
    fn of(p: &Place) -> Self {
        PlaceJson {
            dimension: p.dimension.into(),
            range: p.range.filter(|r| r.iter().all(|v| v.is_finite())),
            unit: p.unit.clone(),
            value: p.value.clone(),
            recording: p.recording.clone(),
            actuators: p.actuators.clone(),
            share_of_excess: finite(p.share_of_excess),
            share_of_samples: finite(p.share_of_samples),
            p_value: finite(p.p_value),
            says: p.says.clone(),
        }
    }
}

/// A cause that was judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CandidateJson {
    /// Id of the catalogue.
    pub effect: String,
    /// Probability that it is at work.
    pub probability: Number,
    /// Bayesian information criterion with it minus without.
    pub delta_bic: Number,
    /// Whether the augmented model contains it.
    pub in_model: bool,
    /// Its values, by name.
    pub parameters: Named<ValueJson>,
    /// The actuators that it sits in; a single coordinate has none.
    pub actuators: Vec<usize>,
    /// Weighted mean square with it on the recordings that were fitted; noise alone makes 1.
    pub mean_square: Number,
    /// The same on those that were held out.
    pub holdout_mean_square: Number,
    /// One sentence.
    pub says: String,
}

/// A value of a cause: a number, a word (a link, a recording), or the three of a vector with three errors and
/// intervals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ValueJson {
    /// The value, freed of what the noise of the motion makes of it (`X_estimate` in `parameters.toml`).
    pub value: Value,
    /// Its unit.
    pub unit: String,
    /// Standard error; null where it was not estimated.
    pub std_error: Value,
    /// 95 % interval; null where there is none.
    pub ci95: Value,
    /// Whether it rests on a physical bound.
    pub at_bound: bool,
}

impl CandidateJson {
    fn of(c: &Candidate, series: &[SeriesEntry], chains: bool) -> Self {
        let number = |v: f64| finite(v).map_or(Value::Null, Value::from);
        let parameters = named(c)
            .into_iter()
            .map(|n| {
                let each = |of: &dyn Fn(&crate::diagnosis::Value) -> Value| match &n.values[..] {
                    [one] => of(one),
                    many => many.iter().map(|v| of(v)).collect(),
                };
                let ends = |v: &crate::diagnosis::Value| match v.ci95.map(finite) {
                    [Some(low), Some(high)] => Value::from(vec![low, high]),
                    _ => Value::Null,
                };
                let value = ValueJson {
                    value: each(&|v| match word(v, series) {
                        Some(word) => word.into(),
                        None => number(v.value),
                    }),
                    unit: match word(n.values[0], series) {
                        Some(_) => String::new(),
                        None => n.values[0].unit.clone(),
                    },
                    std_error: each(&|v| number(v.std_error)),
                    ci95: each(&ends),
                    at_bound: n.values.iter().any(|v| v.at_bound),
                };
                (n.name.to_owned(), value)
            })
            .collect();
        CandidateJson {
            effect: c.acting.effect.id().into(),
            probability: finite(c.probability),
            delta_bic: finite(c.delta_bic),
            in_model: c.in_model,
            parameters: Named(parameters),
            actuators: if chains {
                actuators(c.acting.on)
            } else {
                Vec::new()
            },
            mean_square: finite(c.mean_square),
            holdout_mean_square: finite(c.holdout_mean_square),
            says: c.says.clone(),
        }
    }
}

/// A cause that these recordings could not have shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HiddenJson {
    /// Id of the catalogue.
    pub effect: String,
    /// Share of its trace that a refit of the plain model absorbs.
    pub hidden_share: Number,
    /// Smallest size that would have been seen.
    pub smallest_detectable: SizeJson,
}

/// A size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SizeJson {
    /// Name of the cause's parameter.
    pub name: String,
    /// Its value.
    pub value: Number,
    /// Its unit.
    pub unit: String,
}

impl HiddenJson {
    fn of(h: &Hidden) -> Self {
        HiddenJson {
            effect: h.effect.into(),
            hidden_share: finite(h.hidden_share),
            smallest_detectable: SizeJson {
                name: h.name.into(),
                value: finite(h.smallest_detectable),
                unit: h.unit.clone(),
            },
        }
    }
}

/// What is left out: the three add up to 1; null where no physics was looked at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ProbabilitiesJson {
    /// Nothing.
    pub nothing: Number,
    /// A cause of the catalogue.
    pub catalogue: Number,
    /// Something else.
    pub something_else: Number,
}

/// A part that may differ from the drawing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ToleranceJson {
    /// What may be off.
    pub what: String,
    /// By how much it is, most probably.
    pub found: Number,
    /// One standard deviation of what is built.
    pub tolerance: Number,
    /// Unit of both; `1` is a share.
    pub unit: String,
    /// Whether the rig states it; else it is a default.
    pub stated: bool,
}

impl ToleranceJson {
    fn of(d: &Departed) -> Self {
        ToleranceJson {
            what: d.what.clone(),
            found: finite(d.found),
            tolerance: finite(d.tolerance),
            unit: d.unit.into(),
            stated: d.stated,
        }
    }
}

/// A law over physical variables: a hypothesis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LawJson {
    /// Its terms, strongest first.
    pub terms: Vec<TermJson>,
    /// Share of the squares beyond noise that all terms take away.
    pub share_of_excess: Number,
}

/// Physics that stands in no catalogue, learnt from the recordings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LearntJson {
    /// Where it acts: `bicep`, `film`, `force`, `electrical`, `capacitance`, `series`.
    pub site: String,
    /// Actuators (1 to 3) on which it acts.
    pub actuators: Vec<usize>,
    /// What it depends on.
    pub variables: Vec<String>,
    /// `spline` where all of it is curves, `formula` where not.
    pub form: String,
    /// What each of its terms is, in a formula; nothing of curves.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub formula: Option<String>,
    /// Unit of what it adds.
    pub unit: String,
    /// Probability that what depends on a variable belongs to it.
    pub inclusion: BTreeMap<String, Number>,
    /// Range of each variable in the recordings; null where it has none.
    pub range: BTreeMap<String, [Number; 2]>,
    /// Whether it takes energy; null where it is not about energy.
    pub dissipative: Option<bool>,
    /// Net work over what is exchanged, -1 to 1; null where it is not about energy.
    pub net_work: Number,
    /// The largest that each term makes, in the unit.
    pub largest: Vec<Number>,
    /// Causes of the catalogue that are nearest, with the cosine of the traces.
    pub resembles: Vec<(String, Number)>,
    /// Share of the gap to the noise that it closes on recordings that were held out; null without any.
    pub gap_closed: Number,
    /// Whether the model after contains it.
    pub in_model: bool,
    /// One sentence.
    pub says: String,
}

impl LearntJson {
    fn of(l: &LearntPhysics) -> Self {
        let variables = l.variables();
        let mut formulas: Vec<&str> = Vec::new();
        for term in l.terms.iter().filter_map(|t| t.acting.effect.learnt()) {
            let formula = term.form.formula();
            let curve = matches!(term.form, Form::Spline { .. } | Form::Ridge { .. });
            if !curve && !formulas.contains(&formula) {
                formulas.push(formula);
            }
        }
        let spline = formulas.is_empty();
        LearntJson {
            site: l.place.name().into(),
            actuators: actuators(l.on()),
            variables: variables.iter().map(|v| v.0.to_owned()).collect(),
            form: if spline { "spline" } else { "formula" }.into(),
            formula: (!spline).then(|| formulas.join("; ")),
            unit: l.place.unit().into(),
            inclusion: (variables.iter())
                .map(|v| (v.0.to_owned(), finite(v.1)))
                .collect(),
            range: (variables.iter())
                .map(|v| (v.0.to_owned(), v.2.map(finite)))
                .collect(),
            dissipative: l.net_work.is_finite().then(|| l.takes_energy()),
            net_work: finite(l.net_work),
            largest: l.terms.iter().map(|t| finite(t.largest)).collect(),
            resembles: (l.resembles.iter())
                .map(|(id, cosine)| ((*id).to_owned(), finite(*cosine)))
                .collect(),
            gap_closed: finite(l.gap_closed),
            in_model: true,
            says: l.says.clone(),
        }
    }
}

/// A term of a law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[allow(non_snake_case)]
pub struct TermJson {
    /// The variable.
    pub variable: String,
    /// Torque per standard deviation of the variable, N m.
    pub coefficient_N_m: Number,
    /// Share that it takes away alone.
    pub share_of_excess: Number,
}

impl LawJson {
    fn of(law: &Law) -> Self {
        LawJson {
            terms: law
                .terms
                .iter()
                .map(|(variable, coefficient, share)| TermJson {
                    variable: variable.clone(),
                    coefficient_N_m: finite(*coefficient),
                    share_of_excess: finite(*share),
                })
                .collect(),
            share_of_excess: finite(law.share),
        }
    }
}

/// Errors before and after, V.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GainJson {
    /// Of the plain model, refitted with all its parameters free.
    pub before: Number,
    /// Of the augmented model.
    pub after: Number,
    /// Of the noise of the capture alone.
    pub noise_floor: Number,
    /// The same three over all samples.
    pub all: [Number; 3],
}

impl GainJson {
    fn of(g: &Gain) -> Self {
        GainJson {
            before: finite(g.before_v),
            after: finite(g.after_v),
            noise_floor: finite(g.noise_floor_v),
            all: g.all_v.map(finite),
        }
    }
}

/// The model that a simpler method ends with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RivalJson {
    /// Its name.
    pub method: String,
    /// Ids of its causes, in the order in which it took them.
    pub effects: Vec<String>,
    /// Errors on the recordings that were fitted.
    #[serde(rename = "train_rmse_V")]
    pub train: GainJson,
    /// Errors on the recordings that were held out; null without any.
    #[serde(rename = "holdout_rmse_V")]
    pub holdout: Option<GainJson>,
}

impl RivalJson {
    fn of(r: &RivalModel) -> Self {
        RivalJson {
            method: r.method.into(),
            effects: r.effects.iter().map(|e| (*e).to_owned()).collect(),
            train: GainJson::of(&r.train),
            holdout: r.holdout.as_ref().map(GainJson::of),
        }
    }
}

impl DiagnosisJson {
    /// Of recordings that have to be mended first: nothing was fitted, no physics is named. Errors are null.
    #[must_use]
    pub fn of_recordings(
        says: String,
        findings: &[Finding],
        unit: String,
        provenance: Provenance,
    ) -> Self {
        let largest = findings
            .iter()
            .filter(|f| f.grade == Grade::Wrong)
            .map(|f| f.p_value)
            .fold(f64::INFINITY, f64::min);
        DiagnosisJson {
            verdict: "recording".into(),
            confidence: finite(1.0 - largest),
            says,
            findings: FindingJson::of(findings),
            places: Vec::new(),
            candidates: Vec::new(),
            indistinguishable: Vec::new(),
            next_experiment: String::new(),
            hidden: Vec::new(),
            law: None,
            learnt: None,
            rmse_basis: if unit == "V" { "above_1kV" } else { "all" }.into(),
            rmse_unit: unit,
            train: GainJson {
                before: None,
                after: None,
                noise_floor: None,
                all: [None; 3],
            },
            holdout: None,
            plain_mean_square: None,
            plain_holdout_mean_square: None,
            rivals: Vec::new(),
            probabilities: ProbabilitiesJson {
                nothing: None,
                catalogue: None,
                something_else: None,
            },
            tolerances: Vec::new(),
            tolerance_scale: None,
            remarks: Vec::new(),
            series: Vec::new(),
            provenance,
        }
    }

    /// Of a diagnosis.
    #[must_use]
    pub fn new(d: &Diagnosis, series: Vec<SeriesEntry>, provenance: Provenance) -> Self {
        let groups = d.groups.iter();
        DiagnosisJson {
            verdict: d.verdict.name().into(),
            confidence: finite(d.confidence),
            says: d.says.clone(),
            findings: Vec::new(),
            places: d.places.iter().map(PlaceJson::of).collect(),
            candidates: d
                .candidates
                .iter()
                .map(|c| CandidateJson::of(c, &series, d.rig == RigKind::Robot))
                .collect(),
            indistinguishable: groups
                .map(|g| g.iter().map(|id| (*id).to_owned()).collect())
                .collect(),
            next_experiment: d.next_experiment.clone(),
            hidden: d.hidden.iter().map(HiddenJson::of).collect(),
            law: d.law.as_ref().map(LawJson::of),
            learnt: d.learnt.as_ref().map(LearntJson::of),
            rmse_basis: d.basis.into(),
            rmse_unit: d.unit.clone(),
            train: GainJson::of(&d.train),
            holdout: d.holdout.as_ref().map(GainJson::of),
            plain_mean_square: finite(d.plain_mean_square),
            plain_holdout_mean_square: finite(d.plain_holdout_mean_square),
            rivals: d.rival_models.iter().map(RivalJson::of).collect(),
            probabilities: ProbabilitiesJson {
                nothing: finite(d.probabilities[0]),
                catalogue: finite(d.probabilities[1]),
                something_else: finite(d.probabilities[2]),
            },
            tolerances: d.departed.iter().map(ToleranceJson::of).collect(),
            tolerance_scale: finite(d.built),
            remarks: d.remarks.clone(),
            series,
            provenance,
        }
    }
}
