//! The proof: the diagnosis runs blind over cases whose answers are sealed apart; then they are opened and
//! scored.
//!
//! A case is diagnosed from its recordings alone ([`blind`]); only [`score`] sees an answer.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

mod concealment;
mod line;
mod own_form;
mod score;

pub use concealment::{Concealment, StandsOut, stands_out};
pub use line::{blind_lines, trial_lines};
pub use own_form::own_form;
pub use score::{Count, FirstNames, Median, Method, Proof, Row, score};

use crate::cases::{Case, CaseRecording, Truth};
use crate::dataset::{Dataset, tell_wander};
use crate::diagnosis::{Diagnosis, Entry, Request, Verdict, diagnose};
use crate::effects::When;

/// What the diagnosis said of one case, and what was true.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Trial {
    /// Name of the case.
    pub case: String,
    /// robot, axis, bench, coupon.
    pub rig: String,
    /// Names of its recordings.
    pub recordings: Vec<String>,
    /// Effects at work; empty: none; `unknown`: in no catalogue.
    pub truth: Vec<String>,
    /// Actuators of the first effect.
    pub actuators: Vec<usize>,
    /// The generator's own name of it.
    pub form: Vec<String>,
    /// 0 barely visible to 1 strong.
    pub strength: f64,
    /// Plain refit over the noise floor: train, above 1 kV; of a single coordinate as the generator knows it.
    pub detectability: f64,
    /// adequate, missing_physics, unexplained.
    pub verdict: String,
    /// Its probability.
    pub confidence: f64,
    /// Effects that were named, in order.
    pub named: Vec<String>,
    /// Their own probabilities.
    pub odds: Vec<f64>,
    /// All candidates with their probabilities, in order.
    pub candidates: Vec<(String, f64)>,
    /// Ids that the diagnosis calls indistinguishable from the first.
    pub group: Vec<String>,
    /// All groups that the diagnosis calls indistinguishable.
    pub groups: Vec<Vec<String>>,
    /// How each effect stands out at the truth.
    pub stands_out: Vec<StandsOut>,
    /// What the plain refit makes of the case.
    pub concealment: Concealment,
    /// Share of the gap to the floor that is closed on held-out recordings.
    pub gap_closed: f64,
    /// Where what was learnt acts; none where nothing was.
    #[serde(default)]
    pub learnt_site: Option<String>,
    /// Whether a place among the first three overlaps the truth by half; none where the truth has no place.
    pub located: Option<bool>,
    /// The first named effect's values: name, value, standard error, 95 % interval.
    pub values: Vec<(String, f64, f64, [f64; 2])>,
    /// The truth's values of it.
    pub true_values: Vec<(String, f64)>,
    /// Size of the true effect over the smallest that the diagnosis says it would have found.
    pub over_smallest: Option<f64>,
    /// Weighted mean squares: plain, best; held out plain, best.
    pub mean_squares: [f64; 4],
    /// Evidence: largest surprise of the scan, what noise allows, p-value; fall of the sum of squares, what
    /// chance allows; variance of the noise over the promised one.
    pub evidence: [f64; 6],
    /// The effect with the largest surprise.
    pub most_surprising: String,
    /// Largest surprise of each effect.
    pub surprises: Vec<(String, f64)>,
    /// Models that were fitted: effects, score less the plain model's, weighted mean square, that of the
    /// held-out recordings.
    pub tried: Vec<(String, f64, f64, f64)>,
    /// What simpler methods said: their name, whether they saw anything, what they named.
    pub rivals: Vec<(String, bool, Option<String>)>,
    /// Why there is no diagnosis.
    pub failure: Option<String>,
}

/// The datasets of a case: what a tool sees.
fn datasets(case: &Case, list: &[CaseRecording]) -> Result<Vec<Dataset>, String> {
    let one = |r: &CaseRecording| {
        let d = Dataset::beside(r.parts.clone(), &r.base_mm, 1e-3);
        let mut d = d.map_err(|e| e.to_string())?;
        d.pivot_m = case.pivot_m;
        Ok::<_, String>(d)
    };
    let mut all = list.iter().map(one).collect::<Result<Vec<_>, _>>()?;
    tell_wander(&mut all);
    Ok(all)
}

fn entries<'a>(datasets: &'a [Dataset], first: usize, series_s: &[f64]) -> Vec<Entry<'a>> {
    datasets
        .iter()
        .enumerate()
        .map(|(i, d)| Entry {
            dataset: d,
            when: When {
                recording: first + i,
                series_s: series_s[first + i],
                start_s: d.start_s,
            },
        })
        .collect()
}

/// Diagnoses a case from its recordings alone: nothing of the answer is looked at. The recordings are taken
/// to be two minutes apart.
///
/// # Errors
/// Why there is no diagnosis.
pub fn blind(case: &Case) -> Result<Diagnosis, String> {
    let (train, holdout) = (datasets(case, &case.train)?, datasets(case, &case.holdout)?);
    let series_s = series(train.iter().chain(&holdout));
    diagnose(
        &case.robot,
        &entries(&train, 0, &series_s),
        &entries(&holdout, train.len(), &series_s),
        &Request::default(),
        &|_| (),
    )
    .map_err(|e| e.to_string())
}

/// Diagnoses a case and compares.
pub fn trial(case: &Case) -> Trial {
    let mut out = compare(&case.truth, blind(case));
    if let Ok(train) = datasets(case, &case.train) {
        let series_s = series(&train);
        out.stands_out = stands_out(&case.truth, &case.robot, &entries(&train, 0, &series_s));
    }
    out
}

/// Beginnings of recordings that are taken to be two minutes apart, s.
fn series<'a>(list: impl IntoIterator<Item = &'a Dataset>) -> Vec<f64> {
    let mut now = 0.0;
    list.into_iter()
        .map(|d| {
            let begins = now;
            now += 120.0 + d.step_s * d.samples() as f64;
            begins
        })
        .collect()
}

/// Makes and tries all cases, in parallel: `make` is [`crate::cases::generate`] or [`own_form`] and `attempt`
/// [`trial`]; for single coordinates [`crate::cases::line::generate`] and [`trial_lines`]. Cases that are
/// `known` by their number are not tried again; `watch` hears of each that is. Gives the trials with their
/// numbers; a case that cannot be made has none.
pub fn run<S: Sync, C>(
    specs: &[S],
    make: impl Fn(&S) -> Result<C, String> + Sync,
    attempt: impl Fn(&C) -> Trial + Sync,
    known: &(dyn Fn(usize) -> Option<Trial> + Sync),
    watch: &(dyn Fn(usize, &Trial) + Sync),
) -> Vec<(usize, Trial)> {
    specs
        .par_iter()
        .enumerate()
        .filter_map(|(i, s)| {
            let trial = known(i).or_else(|| {
                let t = attempt(&make(s).ok()?);
                watch(i, &t);
                Some(t)
            });
            Some((i, trial?))
        })
        .collect()
}

/// Opens the answer of a case that was diagnosed.
pub fn compare(truth: &Truth, diagnosis: Result<Diagnosis, String>) -> Trial {
    let mut out = undiagnosed(truth);
    match diagnosis {
        Ok(d) => tell(&mut out, truth, &d),
        Err(why) => out.failure = Some(why),
    }
    out
}

/// What the answer alone says of a case.
fn undiagnosed(truth: &Truth) -> Trial {
    let first = truth.detail.first().filter(|_| !truth.effects.is_empty());
    Trial {
        case: truth.case.clone(),
        rig: if truth.rig.is_empty() {
            "robot".into()
        } else {
            truth.rig.clone()
        },
        recordings: truth.recordings.iter().map(|r| r.name.clone()).collect(),
        truth: truth.effects.clone(),
        actuators: first.map_or(Vec::new(), |d| d.actuators.clone()),
        form: truth.detail.iter().map(|d| d.effect.clone()).collect(),
        strength: first.map_or(0.0, |d| d.strength),
        detectability: f64::NAN,
        verdict: String::new(),
        confidence: f64::NAN,
        named: Vec::new(),
        odds: Vec::new(),
        candidates: Vec::new(),
        group: Vec::new(),
        groups: Vec::new(),
        stands_out: Vec::new(),
        concealment: Concealment::default(),
        gap_closed: f64::NAN,
        learnt_site: None,
        located: None,
        values: Vec::new(),
        true_values: first.map_or(Vec::new(), |d| {
            d.parameters
                .iter()
                .filter_map(|(k, v)| Some((k.clone(), v.as_f64()?)))
                .collect()
        }),
        over_smallest: None,
        mean_squares: [f64::NAN; 4],
        evidence: [f64::NAN; 6],
        most_surprising: String::new(),
        surprises: Vec::new(),
        tried: Vec::new(),
        rivals: Vec::new(),
        failure: None,
    }
}

/// Adds what the diagnosis says.
fn tell(out: &mut Trial, truth: &Truth, d: &Diagnosis) {
    out.concealment = Concealment::new(truth, d);
    let known = truth.detectability.filter(|_| !truth.rig.is_empty());
    out.detectability = known.unwrap_or(d.train.before_v / d.train.noise_floor_v);
    out.verdict = d.verdict.name().into();
    out.confidence = d.confidence;
    out.candidates = d
        .candidates
        .iter()
        .map(|c| (c.acting.effect.id().to_string(), c.probability))
        .collect();
    if d.verdict == Verdict::MissingPhysics {
        let named = d.candidates.iter().filter(|c| c.in_model);
        (out.named, out.odds) = named
            .map(|c| (c.acting.effect.id().to_string(), c.probability))
            .unzip();
    }
    let words = |g: &Vec<&str>| g.iter().map(|s| s.to_string()).collect();
    out.groups = d.groups.iter().map(words).collect();
    out.group = out.groups.first().cloned().unwrap_or_default();
    if let Some(h) = d.holdout {
        out.gap_closed = h.gap_closed();
    }
    out.learnt_site = (d.learnt.as_ref()).map(|l| l.place.name().to_owned());
    let best = d.candidates.first();
    out.mean_squares = [
        d.plain_mean_square,
        best.map_or(f64::NAN, |c| c.mean_square),
        d.plain_holdout_mean_square,
        best.map_or(f64::NAN, |c| c.holdout_mean_square),
    ];
    if let Some(c) = best {
        out.values = c
            .values
            .iter()
            .map(|v| (v.name.to_string(), v.value, v.std_error, v.ci95))
            .collect();
    }
    let e = &d.evidence;
    out.evidence = [
        e.surprise,
        e.limit,
        e.p_value,
        e.fall,
        e.fall_by_chance,
        e.noise_scale,
    ];
    out.surprises = e.each.iter().map(|s| (s.0.to_string(), s.1)).collect();
    out.most_surprising = e.whose.into();
    out.tried = e
        .tried
        .iter()
        .map(|t| (t.0.join(" + "), t.1, t.2, t.3))
        .collect();
    out.rivals = d
        .rivals
        .iter()
        .map(|r| (r.0.to_string(), r.1, r.2.map(str::to_string)))
        .collect();
    out.over_smallest = truth.effects.first().and_then(|id| {
        let hidden = d.hidden.iter().find(|h| h.effect == id.as_str())?;
        let size = out.true_values.iter().find(|v| v.0 == hidden.name)?.1;
        Some(size.abs() / hidden.smallest_detectable)
    });
    out.located = located(truth, d);
}

/// Whether a place among the first three overlaps the truth's by half.
fn located(truth: &Truth, d: &Diagnosis) -> Option<bool> {
    let detail = truth.detail.first().filter(|_| !truth.effects.is_empty())?;
    let mut any = false;
    let mut found = false;
    if detail.actuators.len() < 3 && !detail.actuators.is_empty() {
        any = true;
        found |= d
            .places
            .iter()
            .take(3)
            .any(|p| p.actuators == detail.actuators);
    }
    for place in &detail.place {
        let from = place.get("from_s").and_then(serde_json::Value::as_f64);
        if let Some(from) = from {
            any = true;
            found |= d.places.iter().take(3).any(|p| {
                p.dimension == "time" && p.range.is_some_and(|r| (r[0] - from).abs() < 2.0)
            });
        }
        let range = place.get("range").and_then(serde_json::Value::as_array);
        if let (Some(range), Some(dimension)) = (range, place.get("dimension")) {
            let ends: Vec<f64> = range.iter().filter_map(serde_json::Value::as_f64).collect();
            if ends.len() == 2 {
                any = true;
                found |= d.places.iter().take(3).any(|p| {
                    dimension.as_str() == Some(p.dimension)
                        && p.range.is_some_and(|r| {
                            let both = r[1].min(ends[1]) - r[0].max(ends[0]);
                            both >= 0.5 * (ends[1] - ends[0])
                        })
                });
            }
        }
    }
    any.then_some(found)
}
