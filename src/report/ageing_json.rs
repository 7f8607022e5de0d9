//! `ageing.json`: strokes over days for each electrode, what moved, and the test between electrodes.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::html::number;
use super::json::{Named, Number, finite};
use super::provenance::Provenance;
use crate::calibration::{
    AgeingOutcome, By, Cause, CauseFound, Difference, ElectrodeAgeing, Joint, LevelStroke,
    SampleAgeing, Trend, Value, named, words,
};

/// A number with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Measured {
    /// The number; null where there is none.
    pub value: Number,
    /// Its 95 % interval.
    pub ci95: [Number; 2],
}

impl Measured {
    fn new(value: f64, ci95: [f64; 2]) -> Self {
        Measured {
            value: finite(value),
            ci95: ci95.map(finite),
        }
    }
}

impl From<&Value> for Measured {
    fn from(v: &Value) -> Self {
        Measured::new(v.value, v.ci95())
    }
}

/// An electrode on one day, or of one batch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LevelJson {
    /// The day, where one is stated.
    pub day: Number,
    /// The batch, of a comparison of batches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub batch: Option<String>,
    /// Mean stroke of the cycles that are averaged.
    pub stroke_mm: Measured,
    /// Change against the first; a loss is negative.
    pub change_mm: Measured,
    /// The same in % of the first.
    pub change_percent: Measured,
    /// Whether the interval of the change excludes 0.
    pub significant: bool,
    /// Whether the change is beyond `threshold_percent`.
    pub relevant: bool,
    /// Change of the stroke within the runs, a cycle: not part of the change between days.
    pub drift_mm_per_cycle: Measured,
    /// Samples behind the change.
    pub samples: usize,
}

/// A cause on one day.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CauseLevelJson {
    /// The day, where one is stated.
    pub day: Number,
    /// The batch, of a comparison of batches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub batch: Option<String>,
    /// Value of the effect's parameter.
    pub value: Number,
    /// Its unit.
    pub unit: String,
    /// 95 % interval; of the first day equal ends where it is the reference.
    pub ci95: [Number; 2],
    /// Change against the first.
    pub change: Measured,
    /// Days (or batches) with the same number share the value: nothing changed between them.
    pub group: usize,
}

/// A cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CauseJson {
    /// Id of the effect.
    pub effect: String,
    /// Parameter of the effect that `by_day` gives.
    pub parameter: String,
    /// Probability that it changed.
    pub probability: f64,
    /// Whether the chosen model has it.
    pub in_model: bool,
    /// Its values; empty unless in the model.
    pub by_day: Vec<CauseLevelJson>,
    /// In words.
    pub says: String,
}

/// Trend of the loss over days.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrendJson {
    /// `linear`, `exponential` or `saturating`.
    pub law: String,
    /// Its parameters.
    pub parameters: Named<Measured>,
    /// chi^2 per degree of freedom.
    pub misfit: Number,
    /// The loss that is asked for.
    pub loss_percent: f64,
    /// The day on which it is reached; null where the data do not carry it.
    pub reached_day: Option<Measured>,
    /// In words.
    pub says: String,
}

impl From<&Trend> for TrendJson {
    fn from(t: &Trend) -> Self {
        let parameters = t.parameters.iter();
        TrendJson {
            law: t.law.into(),
            parameters: Named(parameters.map(|(n, v)| ((*n).into(), v.into())).collect()),
            misfit: finite(t.misfit),
            loss_percent: t.loss_percent,
            reached_day: t.reached_day.map(|(day, ci95)| Measured::new(day, ci95)),
            says: t.says.clone(),
        }
    }
}

/// The test between two electrodes at one day.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DifferenceJson {
    /// Their names.
    pub electrodes: [String; 2],
    /// Day or batch at which they are compared.
    pub at: String,
    /// Change of the first minus change of the second, percentage points.
    pub change_percent: Measured,
    /// p-value of no difference.
    pub p_value: Number,
    /// Whether it rests on several samples an electrode.
    pub between_samples: bool,
    /// Scatter between samples, percentage points, that `samples_needed` rests on.
    pub scatter_percent: Number,
    /// Whether that scatter was measured; else it is an assumption.
    pub scatter_measured: bool,
    /// Samples an electrode that would show such a difference with 80 % power at 5 %; null where no number
    /// would.
    pub samples_needed: Option<usize>,
    /// In words.
    pub says: String,
}

impl From<&Difference> for DifferenceJson {
    fn from(d: &Difference) -> Self {
        DifferenceJson {
            electrodes: d.electrodes.clone(),
            at: d.level.clone(),
            change_percent: Measured::new(d.percent.value, d.ci95),
            p_value: finite(d.p_value),
            between_samples: d.between_samples,
            scatter_percent: finite(d.scatter),
            scatter_measured: d.scatter_measured,
            samples_needed: (d.samples_needed < usize::MAX).then_some(d.samples_needed),
            says: d.says.clone(),
        }
    }
}

/// The test between electrodes: at the last day that both have, and at the others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DifferencesJson {
    /// At the last.
    #[serde(flatten)]
    pub last: DifferenceJson,
    /// At every one, and of every pair.
    pub all: Vec<DifferenceJson>,
}

/// One sample of an electrode and its joint fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SampleAgeingJson {
    /// Its batch; empty where none is stated.
    pub name: String,
    /// Days or batches that it has.
    pub levels: Vec<String>,
    /// Why there is no joint fit, where there is none.
    pub refused: Option<String>,
    /// Causes, most probable first.
    pub causes: Vec<CauseJson>,
    /// Pairs of effects of which one could stand for the other.
    pub indistinguishable: Vec<[String; 2]>,
    /// Probability that nothing changed.
    pub nothing: Number,
    /// Mean square of (predicted minus captured)/noise, x of a sample, torques of a robot: 1 where the model
    /// is right.
    pub weighted_mean_square: Number,
    /// The same with nothing allowed to change.
    pub unchanged_mean_square: Number,
    /// Whether the fit converged.
    pub converged: Option<bool>,
    /// Change of the position at rest since the first, as captured, downwards, mm, of a hanging sample.
    /// Values do not rest on it: it holds how the sample was hung.
    pub rest_shift_mm: Vec<Number>,
    /// The same by the chosen model, mm.
    pub predicted_rest_shift_mm: Vec<Number>,
}

/// `ageing.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "ageing.json")]
pub struct AgeingJson {
    /// `day` or `batch`.
    pub by: String,
    /// What was found, in a few words.
    pub verdict: String,
    /// Loss from which a change counts as relevant, %.
    pub threshold_percent: f64,
    /// Strokes by day.
    pub electrodes: Named<Vec<LevelJson>>,
    /// What moved, most probable first.
    pub causes: Named<Vec<CauseJson>>,
    /// The test between electrodes; null where there is one only.
    pub difference: Option<DifferencesJson>,
    /// Trend of the loss over days.
    pub trend: Named<TrendJson>,
    /// Cycles that were averaged.
    pub cycles: Named<usize>,
    /// The samples of each electrode.
    pub samples: Named<Vec<SampleAgeingJson>>,
    /// What a reader should know.
    pub remarks: Vec<String>,
    /// What the result was made of.
    pub provenance: Provenance,
}

/// Id of the effect, its parameter, its unit, and its value and standard error from those of the fit;
/// `mass_kg` of the sample.
#[must_use]
pub fn effect(
    cause: Cause,
    v: &Value,
    mass_kg: f64,
) -> (&'static str, &'static str, &'static str, Value) {
    let [by, plus] = cause.first_value(mass_kg);
    let value = Value {
        value: plus + by * v.value,
        std_error: by.abs() * v.std_error,
    };
    match cause.effect() {
        Some(effect) => {
            let first = &effect.parameters()[0];
            (effect.id(), first.name, first.unit, value)
        }
        None => ("x_film_modulus", "factor", "1", value),
    }
}

fn id(cause: Cause) -> &'static str {
    let nothing = Value {
        value: 0.0,
        std_error: 0.0,
    };
    effect(cause, &nothing, 0.0).0
}

fn level(l: &LevelStroke, by: By) -> LevelJson {
    LevelJson {
        day: l.day,
        batch: (by == By::Batch).then(|| l.name.clone()),
        stroke_mm: Measured::new(l.stroke_mm.value, l.stroke_ci95),
        change_mm: Measured::new(l.change_mm.value, l.change_ci95),
        change_percent: Measured::new(l.change_percent.value, l.percent_ci95),
        significant: l.significant,
        relevant: l.relevant,
        drift_mm_per_cycle: (&l.drift_mm).into(),
        samples: l.samples,
    }
}

fn cause(
    c: &CauseFound,
    joint: &Joint,
    sample: &SampleAgeing,
    e: &ElectrodeAgeing,
    by: By,
) -> CauseJson {
    let mass_kg = joint.levels[0].mass_kg;
    let zero = Value {
        value: 0.0,
        std_error: 0.0,
    };
    let (id, parameter, unit, _) = effect(c.cause, &zero, mass_kg);
    let by_day: Vec<CauseLevelJson> = c
        .by_level
        .iter()
        .enumerate()
        .map(|(i, v)| {
            let l = &e.levels[sample.levels[i]];
            let at = effect(c.cause, v, mass_kg).3;
            let change = &c.change[i];
            // A change has no zero of its own: only its sign and scale are the effect's.
            let factor = effect(
                c.cause,
                &Value {
                    value: 1.0,
                    std_error: 0.0,
                },
                mass_kg,
            )
            .3
            .value
                - effect(c.cause, &zero, mass_kg).3.value;
            let change = Value {
                value: factor * change.value,
                std_error: factor.abs() * change.std_error,
            };
            CauseLevelJson {
                day: l.day,
                batch: (by == By::Batch).then(|| l.name.clone()),
                value: finite(at.value),
                unit: unit.into(),
                ci95: at.ci95().map(finite),
                change: (&change).into(),
                group: c.groups[i],
            }
        })
        .collect();
    CauseJson {
        effect: id.into(),
        parameter: parameter.into(),
        probability: c.probability,
        in_model: c.in_model,
        says: says(c, &by_day, joint, sample, e),
        by_day,
    }
}

fn says(
    c: &CauseFound,
    by_day: &[CauseLevelJson],
    joint: &Joint,
    sample: &SampleAgeing,
    e: &ElectrodeAgeing,
) -> String {
    let mut text = match (c.in_model, named(joint).contains(&c.cause)) {
        (true, true) => format!("The recordings ask for {}", words(c.cause)),
        (true, false) => format!("The best model has {}, but not surely", words(c.cause)),
        (false, _) if joint.confused.iter().any(|pair| pair[1] == c.cause) => {
            return format!(
                "It may as well be {} (probability {:.2}).",
                words(c.cause),
                c.probability
            );
        }
        (false, _) => {
            return format!(
                "The recordings do not ask for {} (probability {:.2}).",
                words(c.cause),
                c.probability
            );
        }
    };
    let name = |i: usize| e.levels[sample.levels[i]].name.as_str();
    if let Some(last) = by_day.last() {
        let show = |v: Number| v.map_or("n/a".into(), |v| format!("{v:.3e}"));
        text += &format!(
            ": changed by {} {} from {} to {} (95 %: {} to {})",
            show(last.change.value),
            last.unit,
            name(0),
            name(by_day.len() - 1),
            show(last.change.ci95[0]),
            show(last.change.ci95[1])
        );
    }
    for group in 0..c.groups.len() {
        let alike: Vec<String> = (0..c.groups.len())
            .filter(|&i| c.groups[i] == group)
            .map(|i| name(i).to_owned())
            .collect();
        if alike.len() > 1 {
            text += &format!("; nothing of it changed between {}", number::list(&alike));
        }
    }
    if c.cause != Cause::SeriesResistance {
        text += "; counted from the first, which is the reference";
    }
    if c.at_bound {
        text += "; it rests on a bound";
    }
    text + "."
}

fn sample(s: &SampleAgeing, e: &ElectrodeAgeing, by: By) -> SampleAgeingJson {
    let joint = s.joint.as_ref().ok();
    let mm = |v: f64| finite(v * 1e3);
    SampleAgeingJson {
        name: s.name.clone(),
        levels: s.levels.iter().map(|&l| e.levels[l].name.clone()).collect(),
        refused: s.joint.as_ref().err().cloned(),
        causes: joint.map_or_else(Vec::new, |j| {
            j.causes.iter().map(|c| cause(c, j, s, e, by)).collect()
        }),
        indistinguishable: joint.map_or_else(Vec::new, confused),
        nothing: joint.and_then(|j| finite(j.nothing)),
        weighted_mean_square: joint.and_then(|j| finite(j.weighted_mean_square)),
        unchanged_mean_square: joint.and_then(|j| finite(j.unchanged_mean_square)),
        converged: joint.map(|j| j.converged),
        rest_shift_mm: s.rest_shift_m.iter().map(|v| mm(*v)).collect(),
        predicted_rest_shift_mm: joint.map_or_else(Vec::new, |j| {
            let lengths: Vec<f64> = j.levels.iter().filter_map(|l| l.rest_length_m).collect();
            lengths.iter().map(|l| mm(l - lengths[0])).collect()
        }),
    }
}

/// Groups that no recording of this kind can split, and those that these could not.
fn confused(joint: &Joint) -> Vec<[String; 2]> {
    let mut out: Vec<[String; 2]> = joint
        .confused
        .iter()
        .map(|p| p.map(|c| id(c).to_owned()))
        .collect();
    if joint
        .causes
        .iter()
        .any(|c| c.in_model && c.cause == Cause::ActiveArea)
    {
        out.push([id(Cause::ActiveArea).into(), "x_permittivity".into()]);
    }
    out
}

impl AgeingJson {
    /// Of an outcome.
    #[must_use]
    pub fn new(outcome: &AgeingOutcome, provenance: Provenance) -> Self {
        let by = outcome.by;
        let electrodes = || outcome.electrodes.iter();
        let all: Vec<DifferenceJson> = outcome.differences.iter().map(Into::into).collect();
        let mut remarks = outcome.remarks.clone();
        for e in electrodes() {
            remarks.extend(e.remarks.iter().map(|r| format!("{}: {r}", e.name)));
        }
        AgeingJson {
            by: match by {
                By::Day => "day",
                By::Batch => "batch",
            }
            .into(),
            verdict: outcome.verdict.clone(),
            threshold_percent: outcome.threshold_percent,
            electrodes: Named(
                electrodes()
                    .map(|e| {
                        let levels = e.levels.iter().map(|l| level(l, by)).collect();
                        (e.name.clone(), levels)
                    })
                    .collect(),
            ),
            causes: Named(
                electrodes()
                    .map(|e| {
                        let causes = e.main().map_or_else(Vec::new, |(s, j)| {
                            j.causes.iter().map(|c| cause(c, j, s, e, by)).collect()
                        });
                        (e.name.clone(), causes)
                    })
                    .collect(),
            ),
            difference: all
                .last()
                .cloned()
                .map(|last| DifferencesJson { last, all }),
            trend: Named(
                electrodes()
                    .filter_map(|e| Some((e.name.clone(), e.trend.as_ref()?.into())))
                    .collect(),
            ),
            cycles: Named(electrodes().map(|e| (e.name.clone(), e.cycles)).collect()),
            samples: Named(
                electrodes()
                    .map(|e| {
                        let all = e.samples.iter().map(|s| sample(s, e, by)).collect();
                        (e.name.clone(), all)
                    })
                    .collect(),
            ),
            remarks,
            provenance,
        }
    }
}
