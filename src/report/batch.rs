//! `batch.json` and the report of a batch: every recording set, and its parameters across films, days and
//! batches.

use minijinja::context;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::diagnosis_json::DiagnosisJson;
use super::html::number;
use super::html::page::{self, Cell, Section, Status, Summary, Table, safe};
use super::html::plot::{self, Axis, Band, Mark, Panel, Role, Series, Width};
use super::json::{FitJson, Named, Number, ParameterJson, finite};
use crate::calibration::{Across, Estimated, StandsOut, across};
use crate::effects::plain_name;

/// Share of comparisons in which something is said to stand out, drift or differ though nothing does: over
/// all sets and parameters together, for each of the three.
pub const FALSE_ALARMS: f64 = 0.01;
/// Share of the sets in which a parameter must be determined to be compared.
const MOSTLY: f64 = 0.8;

/// A recording set: what it was, and what its fit and its diagnosis gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SetJson {
    /// Name: its folder beside `batch.json`.
    pub name: String,
    /// Batch of the film, where it is stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub batch: Option<String>,
    /// Day, where it is stated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub day: Option<f64>,
    /// Why it could not be done; the rest is empty then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
    /// What was fitted: `film`, `forearm`, `robot`, `sample`, `coupon`, `hinge`, `axis`.
    pub fit: String,
    /// Ids of the recordings that were fitted.
    pub recordings: Vec<String>,
    /// Error, in `rmse_unit`.
    #[serde(rename = "rmse_V")]
    pub rmse_v: Number,
    /// What the noise of the capture makes of it.
    #[serde(rename = "noise_floor_V")]
    pub noise_floor_v: Number,
    /// Unit of both.
    pub rmse_unit: String,
    /// Whether the fit converged.
    pub converged: bool,
    /// Its parameters.
    pub parameters: Named<ParameterJson>,
    /// What the diagnosis said, where one was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<SetDiagnosis>,
}

/// What a diagnosis said of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SetDiagnosis {
    /// `adequate`, `missing_physics`, `unexplained`, `recording`.
    pub verdict: String,
    /// Probability of that.
    pub confidence: Number,
    /// Causes that are named.
    pub causes: Vec<String>,
    /// Why it could not be done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

impl SetDiagnosis {
    /// From a diagnosis.
    #[must_use]
    pub fn of(d: &DiagnosisJson) -> Self {
        let named = d.candidates.iter().filter(|c| c.in_model);
        SetDiagnosis {
            verdict: d.verdict.clone(),
            confidence: d.confidence,
            causes: named.map(|c| c.effect.clone()).collect(),
            failure: None,
        }
    }

    /// Of one that could not be done.
    #[must_use]
    pub fn failed(why: String) -> Self {
        SetDiagnosis {
            verdict: String::new(),
            confidence: None,
            causes: Vec::new(),
            failure: Some(why),
        }
    }
}

impl SetJson {
    /// A set of which nothing is known yet but its name and labels.
    #[must_use]
    pub fn new(name: &str, batch: Option<String>, day: Option<f64>, fit: &str) -> Self {
        SetJson {
            name: name.to_owned(),
            batch,
            day,
            failure: None,
            fit: fit.to_owned(),
            recordings: Vec::new(),
            rmse_v: None,
            noise_floor_v: None,
            rmse_unit: String::new(),
            converged: false,
            parameters: Named(Vec::new()),
            diagnosis: None,
        }
    }

    /// The same with what its fit gave.
    #[must_use]
    pub fn with_fit(self, fit: &FitJson) -> Self {
        SetJson {
            fit: fit.job.clone(),
            recordings: fit.recordings.iter().map(|r| r.id.clone()).collect(),
            rmse_v: fit.errors.rmse_v,
            noise_floor_v: fit.errors.noise_floor_v,
            rmse_unit: fit.rmse_unit.clone(),
            converged: fit.converged,
            parameters: fit.parameters.clone(),
            ..self
        }
    }
}

/// One parameter across the sets of one kind of fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AcrossJson {
    /// The kind of fit.
    pub fit: String,
    /// The parameter.
    pub parameter: String,
    /// Its unit.
    pub unit: String,
    /// Sets that determine it.
    pub n_sets: usize,
    /// Whether spread and drift are shares of the value.
    pub relative: bool,
    /// Its middle over all sets.
    pub middle: Number,
    /// Standard deviation between sets of one batch, beside the errors of their estimates.
    pub spread: Number,
    /// Change a day, where there are three days or more.
    pub drift: Option<DriftJson>,
    /// The batches, where there are two or more of three sets or more.
    pub batches: Vec<BatchMiddleJson>,
}

/// Change over the days.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DriftJson {
    /// Change a day.
    pub per_day: Number,
    /// Its 95 % interval.
    pub ci95: [Number; 2],
    /// Chance that one of the parameters moves as much though none drifts.
    pub p_value: Number,
    /// Whether that is below `false_alarm_rate`.
    pub significant: bool,
}

/// A batch against the others.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BatchMiddleJson {
    /// Batch.
    pub batch: String,
    /// Sets of it that count.
    pub n_sets: usize,
    /// Middle of its values.
    pub middle: Number,
    /// 95 % interval of that.
    pub ci95: [Number; 2],
    /// Chance that one of the batches and parameters is as far off though none differs.
    pub p_value: Number,
    /// Whether that is below `false_alarm_rate`.
    pub differs: bool,
}

/// A set that stands out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OutlierJson {
    /// The set.
    pub set: String,
    /// The parameter in which it does so most.
    pub parameter: String,
    /// Its value there.
    pub value: Number,
    /// What its batch and day would have it be.
    pub expected: Number,
    /// Unit of both.
    pub unit: String,
    /// How far off it is, in standard deviations.
    pub deviations: Number,
    /// Chance that one of all sets and parameters is as far off though none stands out.
    pub p_value: Number,
    /// Other parameters in which it stands out.
    pub also: Vec<String>,
    /// One sentence.
    pub says: String,
}

/// `batch.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "batch.json")]
pub struct BatchJson {
    /// Recording sets.
    pub n_sets: usize,
    /// Those that could not be done.
    pub n_failed: usize,
    /// Chance that anything is said to stand out though nothing does; the same for drift, and for batches.
    pub false_alarm_rate: f64,
    /// Sets that stand out, furthest first.
    pub outliers: Vec<OutlierJson>,
    /// The parameters that most sets determine.
    pub parameters: Vec<AcrossJson>,
    /// What a reader should see first.
    pub says: Vec<String>,
    /// Every set, by name.
    pub sets: Vec<SetJson>,
}

/// What is drawn of a parameter: values with their standard errors.
struct Drawn {
    title: String,
    points: Vec<Estimated>,
    out: Vec<usize>,
    middle: f64,
}

/// A parameter in the sets of one fit that determine it.
struct Determined<'a> {
    fit: &'a str,
    name: &'a str,
    unit: &'a str,
    list: Vec<Estimated>,
}

/// The parameters that most sets of a fit determine.
fn determined<'a>(sets: &'a [SetJson], batches: &[Option<&String>]) -> Vec<Determined<'a>> {
    let done = sets.iter().filter(|s| s.failure.is_none());
    let mut fits: Vec<&str> = done.map(|s| s.fit.as_str()).collect();
    fits.sort_unstable();
    fits.dedup();
    let mut lists = Vec::new();
    for fit in fits {
        let own: Vec<(usize, &SetJson)> = sets
            .iter()
            .enumerate()
            .filter(|(_, s)| s.fit == fit && s.failure.is_none())
            .collect();
        let mut names: Vec<&String> = Vec::new();
        for (name, _) in own.iter().flat_map(|s| &s.1.parameters.0) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        for name in names {
            let told = own.iter().filter_map(|(number, s)| {
                let p = s.parameters.get(name)?;
                let determined = p.identifiable && !p.fixed && !p.at_bound;
                let estimated = Estimated {
                    set: *number,
                    batch: batches.iter().position(|b| *b == s.batch.as_ref())?,
                    day: s.day,
                    value: p.value?,
                    std_error: p.std_error?,
                };
                determined.then_some((estimated, p.unit.as_str()))
            });
            let (list, units): (Vec<Estimated>, Vec<&str>) = told.unzip();
            if list.len() as f64 >= MOSTLY * own.len() as f64 && !list.is_empty() {
                lists.push(Determined {
                    fit,
                    name,
                    unit: units[0],
                    list,
                });
            }
        }
    }
    lists
}

impl Determined<'_> {
    /// What was found of it over the sets.
    fn across(&self, found: &Across, batches: &[Option<&String>]) -> AcrossJson {
        AcrossJson {
            fit: self.fit.to_owned(),
            parameter: self.name.to_owned(),
            unit: self.unit.to_owned(),
            n_sets: self.list.len(),
            relative: found.logarithmic,
            middle: finite(found.middle),
            spread: finite(found.spread),
            drift: found.drift.as_ref().map(|d| DriftJson {
                per_day: finite(d.per_day),
                ci95: d.ci95.map(finite),
                p_value: finite(d.p_value),
                significant: d.p_value < FALSE_ALARMS,
            }),
            batches: (found.batches.iter())
                .map(|b| BatchMiddleJson {
                    batch: batches[b.batch].cloned().unwrap_or_default(),
                    n_sets: b.films,
                    middle: finite(b.middle),
                    ci95: b.ci95.map(finite),
                    p_value: finite(b.p_value),
                    differs: b.p_value < FALSE_ALARMS,
                })
                .collect(),
        }
    }

    /// A set in which it stands out; what that says is told later.
    fn outlier(&self, o: &StandsOut, sets: &[SetJson]) -> OutlierJson {
        OutlierJson {
            set: sets[o.set].name.clone(),
            parameter: self.name.to_owned(),
            value: self.list.iter().find(|e| e.set == o.set).map(|e| e.value),
            expected: finite(o.expected),
            unit: self.unit.to_owned(),
            deviations: finite(o.deviations),
            p_value: finite(o.p_value),
            also: Vec::new(),
            says: String::new(),
        }
    }
}

/// One entry a set, of the parameter in which it is furthest off; furthest first.
fn by_set(mut outliers: Vec<OutlierJson>) -> Vec<OutlierJson> {
    let far = |o: &OutlierJson| o.deviations.map_or(0.0, f64::abs);
    outliers.sort_by(|a, b| far(b).total_cmp(&far(a)).then_with(|| a.set.cmp(&b.set)));
    let mut first: Vec<OutlierJson> = Vec::new();
    for o in outliers {
        match first.iter_mut().find(|f| f.set == o.set) {
            Some(f) => f.also.push(o.parameter),
            None => first.push(o),
        }
    }
    for o in &mut first {
        let (value, expected) = (o.value.unwrap_or(f64::NAN), o.expected.unwrap_or(f64::NAN));
        o.says = format!(
            "{}: {} is {} {}, where its batch and day have {}: {:.1} standard deviations off",
            o.set,
            o.parameter,
            number::significant(value, 4),
            o.unit,
            number::significant(expected, 4),
            far(o)
        );
    }
    first
}

impl BatchJson {
    /// Of all sets, which are in the order of their names, and its report.
    #[must_use]
    pub fn with_report(sets: Vec<SetJson>) -> (Self, String) {
        let (json, drawn) = Self::compare(sets);
        let page = json.render(&drawn);
        (json, page)
    }

    fn compare(sets: Vec<SetJson>) -> (Self, Vec<Drawn>) {
        let mut batches: Vec<Option<&String>> = sets.iter().map(|s| s.batch.as_ref()).collect();
        batches.sort();
        batches.dedup();
        let lists = determined(&sets, &batches);
        let mut outliers: Vec<OutlierJson> = Vec::new();
        let mut parameters = Vec::new();
        let mut drawn = Vec::new();
        for d in &lists {
            let Some(found) = across(&d.list, lists.len(), FALSE_ALARMS) else {
                continue;
            };
            parameters.push(d.across(&found, &batches));
            outliers.extend(found.outliers.iter().map(|o| d.outlier(o, &sets)));
            drawn.push(Drawn {
                title: match d.unit {
                    "1" => format!("{}, no unit", d.name),
                    unit => format!("{}, {unit}", d.name),
                },
                out: found.outliers.iter().map(|o| o.set).collect(),
                middle: found.middle,
                points: d.list.clone(),
            });
        }
        let n_failed = sets.iter().filter(|s| s.failure.is_some()).count();
        let mut json = BatchJson {
            n_sets: sets.len(),
            n_failed,
            false_alarm_rate: FALSE_ALARMS,
            outliers: by_set(outliers),
            parameters,
            says: Vec::new(),
            sets,
        };
        json.says = json.words();
        (json, drawn)
    }

    /// What a reader should see first.
    fn words(&self) -> Vec<String> {
        let sets = |n: usize| format!("{n} set{}", if n == 1 { "" } else { "s" });
        let mut out = vec![match self.n_failed {
            0 => format!("{} fitted.", sets(self.n_sets)),
            n => format!("{} fitted, {n} could not be.", sets(self.n_sets - n)),
        }];
        let rate = 100.0 * self.false_alarm_rate;
        if self.parameters.is_empty() {
            out.push(
                "Nothing is compared: that takes six sets that determine the same parameters."
                    .into(),
            );
            return out;
        }
        out.push(match self.outliers.len() {
            0 => format!("None stands out (one would by chance in {rate} % of such tables)."),
            n => format!(
                "{} out (one would by chance in {rate} % of such tables): {}.",
                if n == 1 {
                    "One stands".into()
                } else {
                    format!("{n} stand")
                },
                listed(self.outliers.iter().map(|o| o.set.as_str()))
            ),
        });
        for p in &self.parameters {
            let by = |share: f64| match p.relative {
                true => format!("{:+.2} %", 100.0 * share),
                false => format!("{} {}", number::significant(share, 3), p.unit),
            };
            if let Some(d) = p.drift.as_ref().filter(|d| d.significant)
                && let (Some(x), [Some(a), Some(b)]) = (d.per_day, d.ci95)
            {
                let (x, a, b) = (by(x), by(a), by(b));
                out.push(format!(
                    "{} drifts by {x} a day (95 %: {a} to {b}).",
                    p.parameter
                ));
            }
            let differ: Vec<&str> = p
                .batches
                .iter()
                .filter(|b| b.differs)
                .map(|b| b.batch.as_str())
                .collect();
            if !differ.is_empty() {
                let s = if differ.len() == 1 { "" } else { "es" };
                let names = listed(differ.into_iter());
                out.push(format!("{}: batch{s} {names} off the others.", p.parameter));
            }
        }
        out
    }

    fn render(&self, drawn: &[Drawn]) -> String {
        let summary = Summary {
            of: String::new(),
            picture: String::new(),
            status: match (self.n_failed, self.outliers.is_empty()) {
                (0, true) => Status::Good,
                _ => Status::Fair,
            },
            word: format!("{} sets", self.n_sets),
            headline: number::words(&self.says.join(" ")),
            tiles: Vec::new(),
            notes: Vec::new(),
        };
        let sections = [
            self.standing_out(),
            self.across(),
            self.plots(drawn),
            self.table(),
        ];
        page::page("Recording sets together", &summary, &sections)
    }

    fn standing_out(&self) -> Section {
        let mut table = Table::new(
            "Sets that stand out",
            vec![
                Cell::text("Set"),
                Cell::text("Parameter"),
                Cell::number("Value"),
                Cell::number("Expected"),
                Cell::number("Standard deviations"),
                Cell::number("Chance"),
                Cell::text("Also in"),
            ],
        );
        let told = |x: Number| x.map_or("-".into(), |x| number::significant(x, 4));
        for o in &self.outliers {
            table.row(vec![
                Cell::text(&o.set),
                Cell::text(format!("{} ({})", o.parameter, o.unit)),
                Cell::number(told(o.value)),
                Cell::number(told(o.expected)),
                Cell::number(o.deviations.map_or("-".into(), |d| format!("{d:+.1}"))),
                Cell::number(o.p_value.map_or("-".into(), number::chance)),
                Cell::text(o.also.join(", ")),
            ]);
        }
        let text = format!(
            "A set stands out where a parameter is further from the middle of its batch and day than the largest of {} sets and {} parameters gets by chance in {} % of such tables. Middles, drift and the spread between sets come from medians, so that those that stand out do not hide each other; the errors of the estimates are part of the spread.",
            self.n_sets,
            self.parameters.len(),
            100.0 * self.false_alarm_rate
        );
        Section::table("outliers", "What stands out", &text, table)
    }

    fn across(&self) -> Section {
        let mut table = Table::new(
            "Parameters across sets",
            vec![
                Cell::text("Parameter"),
                Cell::number("Sets"),
                Cell::number("Middle"),
                Cell::number("Spread between sets"),
                Cell::number("Change a day (95 %)"),
                Cell::text("Batches (95 %)"),
            ],
        );
        for p in &self.parameters {
            let size = |x: Number| match (x, p.relative) {
                (None, _) => "-".to_owned(),
                (Some(x), true) => format!("{:.2} %", 100.0 * x),
                (Some(x), false) => number::significant(x, 3),
            };
            let drift = p.drift.as_ref().map_or("-".into(), |d| {
                let [a, b] = d.ci95.map(size);
                let mark = if d.significant { " *" } else { "" };
                format!("{} ({a} to {b}){mark}", size(d.per_day))
            });
            let told = |x: Number| x.map_or("-".into(), |x| number::significant(x, 4));
            let batch = |b: &BatchMiddleJson| {
                let [low, high] = b.ci95.map(told);
                let mark = if b.differs { " *" } else { "" };
                format!("{}: {} ({low} to {high}){mark}", b.batch, told(b.middle))
            };
            table.row(vec![
                Cell::text(format!("{} ({})", p.parameter, p.unit)),
                Cell::number(number::count(p.n_sets)),
                Cell::number(told(p.middle)),
                Cell::number(size(p.spread)),
                Cell::number(drift),
                Cell::text(p.batches.iter().map(batch).collect::<Vec<_>>().join("; ")),
            ]);
        }
        let text = "Only parameters that four of five sets determine, without the sets that stand out. A star: beyond what chance makes of one of all parameters (and batches) at the stated rate. A batch is held against the others together.";
        Section::table("across", "Across films, days and batches", text, table)
    }

    fn plots(&self, drawn: &[Drawn]) -> Section {
        let figures: Vec<String> = drawn
            .iter()
            .map(|d| {
                let by_day = d.points.iter().all(|e| e.day.is_some());
                let x = |e: &Estimated| match by_day {
                    true => e.day.unwrap_or(f64::NAN),
                    false => e.set as f64 + 1.0,
                };
                let point = |e: &&Estimated| [x(e), e.value];
                let is_out = |e: &&Estimated| d.out.contains(&e.set);
                let dots = |name: &str, role, points| Series {
                    name: name.into(),
                    role,
                    mark: Mark::Dots,
                    points,
                };
                let usual = d.points.iter().filter(|e| !is_out(e)).map(|e| point(&e));
                let mut series = vec![dots("sets", Role::One, usual.collect())];
                if !d.out.is_empty() {
                    let out = d.points.iter().filter(is_out).map(|e| point(&e));
                    series.push(dots("stand out", Role::Two, out.collect()));
                }
                let [low, high] = plot::extent(d.points.iter().map(x));
                let panel = Panel {
                    y: Axis::new(d.title.clone()),
                    height: 150.0,
                    shades: Vec::new(),
                    bands: Vec::<Band>::new(),
                    series: std::iter::once(Series {
                        name: "middle".into(),
                        role: Role::Rule,
                        mark: Mark::Line,
                        points: vec![[low, d.middle], [high, d.middle]],
                    })
                    .chain(series)
                    .collect(),
                };
                let axis = Axis::new(if by_day { "day" } else { "number of the set" });
                let label = format!("{} of each set", d.title);
                let panels = [panel];
                let drawing = plot::line_plot(&label, &axis, &panels, Width::Full);
                plot::figure(&[drawing], &plot::legend(&panels), &label)
            })
            .collect();
        Section::new(
            "plots",
            "Each parameter",
            "{% for f in figures %}{{ f }}{% else %}<p>Nothing is compared.</p>{% endfor %}",
            context! { figures => figures.into_iter().map(safe).collect::<Vec<_>>() },
        )
    }

    fn table(&self) -> Section {
        let mut table = Table::new(
            "Every set",
            vec![
                Cell::text("Set"),
                Cell::text("Batch"),
                Cell::number("Day"),
                Cell::text("Fit"),
                Cell::number("Error"),
                Cell::number("Noise"),
                Cell::text("Diagnosis"),
                Cell::text("Parameters (95 %)"),
            ],
        );
        for s in &self.sets {
            if let Some(why) = &s.failure {
                let failed = Cell::text(format!("{}: could not be done: {why}", s.name));
                table.row_of("group", vec![failed]);
                continue;
            }
            let told = |x: Number| {
                x.map_or("-".into(), |x| {
                    format!("{} {}", number::significant(x, 3), s.rmse_unit)
                })
            };
            let diagnosis = s.diagnosis.as_ref().map_or(String::new(), |d| {
                let verdict = match &d.failure {
                    Some(why) => why.clone(),
                    None => d.verdict.replace('_', " "),
                };
                let causes: Vec<String> = d.causes.iter().map(|c| plain_name(c)).collect();
                match causes.is_empty() {
                    true => verdict,
                    false => format!("{verdict}: {}", causes.join(", ")),
                }
            });
            let determined = s
                .parameters
                .0
                .iter()
                .filter(|(_, p)| p.identifiable && !p.fixed);
            let values = determined.filter_map(|(name, p)| {
                let [low, high] = p.ci95?;
                let short = |x: f64| number::significant(x, 3);
                let (value, low, high) = (short(p.value?), short(low?), short(high?));
                Some(format!("{name} {value} ({low} to {high}) {}", p.unit))
            });
            table.row(vec![
                match s.failure {
                    None => Cell::link(&s.name, &format!("{}/report.html", s.name)),
                    Some(_) => Cell::text(&s.name),
                },
                Cell::text(s.batch.clone().unwrap_or_default()),
                Cell::number(s.day.map_or(String::new(), |d| d.to_string())),
                Cell::text(&s.fit),
                Cell::number(told(s.rmse_v)),
                Cell::number(told(s.noise_floor_v)),
                Cell::text(diagnosis),
                Cell::of("quiet", values.collect::<Vec<_>>().join("; ")),
            ]);
        }
        let text =
            "Each has a folder of its name with its files, and leads to the report of its fit.";
        Section::table("sets", "Every set", text, table)
    }
}

/// Names as a list; of many the first ten.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    match names.len() {
        n if n > 10 => format!("{} and {} more", names[..10].join(", "), n - 10),
        _ => names.join(", "),
    }
}
