//! Scores of a proof: counts with their 95 % intervals.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use super::Trial;
use crate::cases::site_of;

/// A share: how many of how many, with the 95 % interval of Wilson 1927.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Count {
    /// How many.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
    /// Their ratio; none of nothing.
    pub share: Option<f64>,
    /// Its interval.
    pub ci95: [f64; 2],
}

impl Count {
    fn new(hits: usize, of: usize) -> Self {
        if of == 0 {
            return Count {
                hits,
                of,
                share: None,
                ci95: [0.0, 1.0],
            };
        }
        let (n, p, z) = (of as f64, hits as f64 / of as f64, 1.959_964_f64);
        let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt() / (1.0 + z * z / n);
        Count {
            hits,
            of,
            share: Some(p),
            ci95: [(middle - half).max(0.0), (middle + half).min(1.0)],
        }
    }

    fn of(trials: &[&Trial], hit: impl Fn(&Trial) -> bool) -> Self {
        Count::new(trials.iter().filter(|t| hit(t)).count(), trials.len())
    }
}

/// A median with the interval that holds it in 95 % of samples (order statistics).
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Median {
    /// The median; none of nothing.
    pub value: Option<f64>,
    /// Of how many.
    pub of: usize,
    /// Its interval.
    pub ci95: [Option<f64>; 2],
}

impl Median {
    fn new(mut values: Vec<f64>) -> Self {
        values.retain(|v| v.is_finite());
        values.sort_by(f64::total_cmp);
        let n = values.len();
        let half = 0.98 * (n as f64).sqrt();
        let low = (n as f64 / 2.0 - half).floor().max(0.0) as usize;
        let high = ((n as f64 / 2.0 + half).ceil() as usize).min(n.saturating_sub(1));
        Median {
            value: values.get(n / 2).copied(),
            of: n,
            ci95: [values.get(low).copied(), values.get(high).copied()],
        }
    }
}

/// What one method scored.
#[derive(Debug, Clone, Serialize)]
pub struct Method {
    /// Its name.
    pub name: String,
    /// Clean cases in which it saw something.
    pub false_alarm_rate: Count,
    /// Detectable single effects that it named first.
    pub top1_detectable: Count,
    /// Barely visible single effects that it named first.
    pub top1_hidden: Count,
    /// Effects in no catalogue for which it claimed no name.
    pub unknown_not_named: Count,
    /// Brier score of its names: the square of the probability less 1 where the name is right, less 0 where
    /// not. A rival knows no doubt: its probability is 1.
    pub brier: Option<f64>,
}

/// What a proof found.
#[derive(Debug, Clone, Serialize)]
pub struct Proof {
    /// Cases that were diagnosed.
    pub n_cases: usize,
    /// Cases without a diagnosis, and why.
    pub failures: Vec<String>,
    /// Clean cases that were not called adequate.
    pub false_alarm_rate: Count,
    /// Detectable single effects (plain refit at 1.5 times the floor or more) that were named first.
    pub top1_detectable: Count,
    /// The same among the first three candidates.
    pub top3_detectable: Count,
    /// The same, or within the group that the prover draws at the truth.
    pub group_detectable: Count,
    /// Single effects below 1.5 times the floor that were named first.
    pub top1_hidden: Count,
    /// The same, or within the group that the prover draws at the truth.
    pub group_hidden: Count,
    /// Single effects below 1.5 times the floor for which another name was claimed, outside the prover's
    /// group.
    pub wrong_hidden: Count,
    /// Single effects of three times the smallest size that the diagnosis says it would have found, or more,
    /// that were named (or one that the recordings cannot tell from them).
    pub found_at_three_times_smallest: Count,
    /// Effects in no catalogue that were called unexplained.
    pub unknown_called_unexplained: Count,
    /// The same of those that a plain refit leaves at 1.5 times the floor or more.
    pub visible_unknown_called_unexplained: Count,
    /// What was learnt of robots' effects in no catalogue that acts where they do.
    pub learnt_where_it_acts: Count,
    /// Share of the gap to the floor that is closed on held-out recordings, of effects in no catalogue that a
    /// plain refit leaves at 1.5 times the floor or more.
    pub unknown_gap_closed_median: Median,
    /// Pairs of which both were named, where a refit without either would leave as much as a detectable
    /// single one does.
    pub pairs_both_named: Count,
    /// The same, or one that the recordings cannot tell from it.
    pub pairs_by_group: Count,
    /// All pairs of which both were named.
    pub all_pairs_both_named: Count,
    /// Pairs of which the first named one is right.
    pub pairs_first_right: Count,
    /// Cases whose truth has a place that is among the first three.
    pub located: Count,
    /// Share of the gap to the floor that is closed on held-out recordings, detectable cases.
    pub gap_closed_median: Median,
    /// 95 % intervals of the named effect's first stated value that hold the truth, where the right effect is
    /// named. The cases' forms are richer than the catalogue's: this counts the equivalent value.
    pub coverage: Count,
    /// Expected calibration error of the first candidate's probability, ten bins, where an effect is named.
    pub calibration_error: f64,
    /// Brier score of that probability, and of the base rate.
    pub brier: [f64; 2],
    /// truth -> what was said -> how often; `none`, `unknown` and pairs with a plus.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
    /// Cases with one cause or none, true cause against first name.
    pub first_names: Vec<FirstNames>,
    /// Shares right by strength: from, to, count.
    pub power: Vec<(f64, f64, Count)>,
    /// The rivals on the same cases, and the diagnosis itself first.
    pub methods: Vec<Method>,
    /// Detectable single effects that were named first, or are in a group with the first name that the
    /// diagnosis itself calls
    /// indistinguishable.
    pub stated_group_detectable: Count,
    /// Cases, of all, with a name above 80 % that is neither true nor in a stated group with what is.
    pub wrong_above_80: Count,
    /// Cases, of all, in which the names are exactly what is true; none for what is in no catalogue.
    pub exact_sets: Count,
    /// Expected calibration error of every name by its own probability, ten bins; right is what is true or in
    /// a stated group with it.
    pub calibration_error_each: f64,
    /// The same, where right is only what is true.
    pub calibration_error_each_strict: f64,
    /// Every name by its own probability: from, to, mean probability, how many of them right.
    pub calibration: Vec<(f64, f64, f64, Count)>,
    /// Names in a stated group with the first name, mean over the cases with a name; 1: it stands alone.
    pub stated_group_size: f64,
    /// What became of the cases of each rig and kind.
    pub by_kind: Vec<Row>,
    /// What became of the cases of each rig and cause.
    pub by_cause: Vec<Row>,
}

/// What became of some cases.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    /// robot, axis, bench, coupon.
    pub rig: String,
    /// clean, single, pair, unknown; or the name of a cause.
    pub what: String,
    /// How many.
    pub cases: usize,
    /// Of these, those that a plain refit leaves visible.
    pub visible: usize,
    /// Of the visible ones, those with the true name first.
    pub visible_first: usize,
    /// The same, or in a stated group.
    pub visible_group: usize,
    /// Called adequate.
    pub adequate: usize,
    /// Called unexplained.
    pub unexplained: usize,
    /// With a wrong name above 80 %.
    pub wrong_above_80: usize,
}

impl Row {
    fn of(trials: &[&Trial], what: impl Fn(&Trial) -> String) -> Vec<Row> {
        let mut rows: BTreeMap<(String, String), Row> = BTreeMap::new();
        for t in trials {
            let row = rows.entry((t.rig.clone(), what(t))).or_default();
            let visible = t.detectability >= DETECTABLE;
            row.cases += 1;
            row.visible += usize::from(visible);
            row.visible_first += usize::from(visible && first_right(t));
            row.visible_group += usize::from(visible && first_in_group(t));
            row.adequate += usize::from(t.verdict == "adequate");
            row.unexplained += usize::from(t.verdict == "unexplained");
            row.wrong_above_80 += usize::from(wrong_sure(t));
        }
        rows.into_iter()
            .map(|((rig, what), row)| Row { rig, what, ..row })
            .collect()
    }
}

/// True cause against first name, of the robots or of the single coordinates, of causes that a plain refit
/// leaves visible or of the others (and of cases without a cause).
#[derive(Debug, Clone, Serialize)]
pub struct FirstNames {
    /// Whether they are robots.
    pub robots: bool,
    /// Whether a plain refit leaves 1.5 times the noise or more.
    pub visible: bool,
    /// What is true, a row each: `none`, ids, `unknown` (in no catalogue).
    pub truths: Vec<String>,
    /// What was said, a column each: `none` (adequate), ids of the first name, `unknown` (unexplained).
    pub said: Vec<String>,
    /// How often.
    pub counts: Vec<Vec<usize>>,
}

impl FirstNames {
    fn of(trials: &[&Trial]) -> Vec<FirstNames> {
        let said = |t: &Trial| match t.verdict.as_str() {
            "adequate" => "none".to_owned(),
            "unexplained" => "unknown".into(),
            _ => t.named.first().cloned().unwrap_or_else(|| "unknown".into()),
        };
        let truth = |t: &Trial| match kind(t) {
            "clean" => "none".to_owned(),
            "unknown" => "unknown".into(),
            _ => t.truth[0].clone(),
        };
        let sorted = |list: Vec<String>| {
            let place = |id: &str| match id {
                "none" => 0,
                "unknown" => 2,
                _ => 1,
            };
            let set: BTreeSet<(u8, String)> = list.into_iter().map(|id| (place(&id), id)).collect();
            set.into_iter().map(|(_, id)| id).collect::<Vec<_>>()
        };
        let mut out = Vec::new();
        for (robots, visible) in [(true, true), (true, false), (false, true), (false, false)] {
            let here: Vec<(String, String)> = trials
                .iter()
                .filter(|t| kind(t) != "pair" && (t.rig == "robot") == robots)
                .filter(|t| (t.detectability >= DETECTABLE && !t.truth.is_empty()) == visible)
                .map(|t| (truth(t), said(t)))
                .collect();
            let truths = sorted(here.iter().map(|c| c.0.clone()).collect());
            let said = sorted(here.iter().map(|c| c.1.clone()).collect());
            let count =
                |t: &String, s: &String| here.iter().filter(|c| c.0 == *t && c.1 == *s).count();
            let counts = truths
                .iter()
                .map(|t| said.iter().map(|s| count(t, s)).collect());
            let counts = counts.collect();
            if !here.is_empty() {
                out.push(FirstNames {
                    robots,
                    visible,
                    truths,
                    said,
                    counts,
                });
            }
        }
        out
    }
}

/// A name above this is claimed surely.
const SURE: f64 = 0.8;

/// Whether what is at work is in no catalogue. Foreign answers for robots may have the name of it, which
/// begins with `x_`.
fn is_unknown(t: &Trial) -> bool {
    let foreign = |e: &String| t.rig == "robot" && e.starts_with("x_");
    t.truth.iter().any(|e| e == "unknown" || foreign(e))
}

fn first_right(t: &Trial) -> bool {
    t.named.first().is_some_and(|n| t.truth.first() == Some(n))
}

/// Whether a name is true, or in a stated group with what is.
fn right_or_grouped(t: &Trial, name: &str) -> bool {
    let in_truth = |n: &str| t.truth.iter().any(|e| e == n);
    in_truth(name)
        || t.groups
            .iter()
            .any(|g| g.iter().any(|n| n == name) && g.iter().any(|n| in_truth(n)))
}

fn first_in_group(t: &Trial) -> bool {
    t.named.first().is_some_and(|n| right_or_grouped(t, n))
}

fn wrong_sure(t: &Trial) -> bool {
    let mut named = t.named.iter().zip(&t.odds);
    named.any(|(n, p)| *p > SURE && !right_or_grouped(t, n))
}

/// clean, single, pair, unknown.
fn kind(t: &Trial) -> &'static str {
    match t.truth.len() {
        0 => "clean",
        _ if is_unknown(t) => "unknown",
        1 => "single",
        _ => "pair",
    }
}

/// Probabilities against what came true, in ten bins.
fn calibration(calls: &[(f64, bool)]) -> Vec<(f64, f64, f64, Count)> {
    (0..10)
        .map(|bin| {
            let (low, high) = (0.1 * f64::from(bin), 0.1 * f64::from(bin + 1));
            let own: Vec<&(f64, bool)> = calls
                .iter()
                .filter(|c| c.0 >= low && (c.0 < high || (bin == 9 && c.0 <= 1.0)))
                .collect();
            let mean = own.iter().map(|c| c.0).sum::<f64>() / own.len().max(1) as f64;
            let hits = own.iter().filter(|c| c.1).count();
            (low, high, mean, Count::new(hits, own.len()))
        })
        .collect()
}

/// The expected error: the distance of probability and frequency, each bin by its number.
fn calibration_error(bins: &[(f64, f64, f64, Count)]) -> f64 {
    let total: usize = bins.iter().map(|b| b.3.of).sum();
    let far = |b: &(f64, f64, f64, Count)| (b.2 * b.3.of as f64 - b.3.hits as f64).abs();
    bins.iter().map(far).sum::<f64>() / total.max(1) as f64
}

/// From this ratio of plain refit and floor on a case counts as detectable.
const DETECTABLE: f64 = 1.5;

/// Trials by what is true of them.
struct Sorted<'a> {
    done: Vec<&'a Trial>,
    clean: Vec<&'a Trial>,
    /// With one cause, above and below what counts as detectable.
    visible: Vec<&'a Trial>,
    dim: Vec<&'a Trial>,
    unknown: Vec<&'a Trial>,
    visible_unknown: Vec<&'a Trial>,
    pairs: Vec<&'a Trial>,
    /// Pairs of which each stands out as a detectable single cause does.
    clear_pairs: Vec<&'a Trial>,
    named: Vec<&'a Trial>,
}

impl<'a> Sorted<'a> {
    fn new(trials: &'a [Trial]) -> Self {
        let done: Vec<&Trial> = trials.iter().filter(|t| t.failure.is_none()).collect();
        let select = |f: &dyn Fn(&Trial) -> bool| chosen(&done, f);
        let visible = |t: &Trial| t.detectability >= DETECTABLE;
        let least = DETECTABLE * DETECTABLE - 1.0;
        Sorted {
            clean: select(&|t| t.truth.is_empty()),
            visible: select(&|t| single(t) && visible(t)),
            dim: select(&|t| single(t) && t.detectability < DETECTABLE),
            unknown: select(&is_unknown),
            visible_unknown: select(&|t| is_unknown(t) && visible(t)),
            pairs: select(&|t| t.truth.len() == 2),
            clear_pairs: select(&|t| {
                t.truth.len() == 2
                    && t.stands_out.len() == 2
                    && t.stands_out.iter().all(|s| s.excess >= least)
            }),
            named: select(&|t| !t.named.is_empty()),
            done,
        }
    }
}

/// Those of which `f` is true.
fn chosen<'a>(trials: &[&'a Trial], f: &dyn Fn(&Trial) -> bool) -> Vec<&'a Trial> {
    trials.iter().copied().filter(|t| f(t)).collect()
}

/// Whether there is one cause, of the catalogue.
fn single(t: &Trial) -> bool {
    kind(t) == "single"
}

/// Whether a name stands for the true effect number i, by the prover's group.
fn stands_for(t: &Trial, name: &str, i: usize) -> bool {
    t.truth[i] == name
        || t.stands_out
            .get(i)
            .is_some_and(|s| s.alike.iter().any(|g| g.0 == name))
}

/// Whether the first name stands for the first cause, by the prover's group.
fn first_stands_for_it(t: &Trial) -> bool {
    t.named.first().is_some_and(|n| stands_for(t, n, 0))
}

/// Whether all that is true is named.
fn both_named(t: &Trial) -> bool {
    t.truth.iter().all(|e| t.named.contains(e))
}

/// Whether what was learnt acts where the true form does.
fn learnt_where_it_acts(t: &Trial) -> bool {
    let site = t.form.first().and_then(|form| site_of(form));
    site.is_some() && t.learnt_site.as_deref() == site
}

/// Whether the names of a pair stand for both, one each.
fn both_stand_for_them(t: &Trial) -> bool {
    let [a, b] = &t.named[..] else { return false };
    [(a, b), (b, a)]
        .iter()
        .any(|(a, b)| stands_for(t, a, 0) && stands_for(t, b, 1))
}

/// Whether the names are exactly what is true.
fn exact(t: &Trial) -> bool {
    let mut said = t.named.clone();
    let mut truth = if is_unknown(t) {
        Vec::new()
    } else {
        t.truth.clone()
    };
    said.sort();
    truth.sort();
    said == truth
}

/// Names in a stated group with the first name.
fn group_size(t: &Trial) -> f64 {
    let mut all: Vec<&String> = t
        .groups
        .iter()
        .filter(|g| g.contains(&t.named[0]))
        .flatten()
        .collect();
    all.sort();
    all.dedup();
    all.len().max(1) as f64
}

/// How many intervals of the first stated value hold the truth, where the right effect is named.
fn coverage(done: &[&Trial]) -> Count {
    let (mut inside, mut measured) = (0, 0);
    for t in done.iter().filter(|t| single(t) && first_right(t)) {
        let value = t.values.iter().find_map(|(name, _, error, ci95)| {
            let truth = t.true_values.iter().find(|v| v.0 == *name)?;
            (error.is_finite() && *name != "time").then_some((truth.1, *ci95))
        });
        if let Some((truth, [low, high])) = value {
            measured += 1;
            inside += usize::from(low <= truth && truth <= high);
        }
    }
    Count::new(inside, measured)
}

/// Every name by its own probability, in ten bins.
fn calibration_of_each(
    named: &[&Trial],
    right: &dyn Fn(&Trial, &str) -> bool,
) -> Vec<(f64, f64, f64, Count)> {
    let names = |t: &&Trial| -> Vec<(f64, bool)> {
        let own = t.named.iter().zip(&t.odds);
        own.map(|(n, p)| (*p, right(t, n))).collect()
    };
    calibration(&named.iter().flat_map(names).collect::<Vec<_>>())
}

/// truth -> what was said -> how often.
fn confusion(done: &[&Trial]) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut out: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for t in done {
        let truth = if t.truth.is_empty() {
            "none".into()
        } else {
            t.truth.join(" + ")
        };
        let said = match t.verdict.as_str() {
            "adequate" => "none".into(),
            "unexplained" => "unknown".into(),
            _ => t.named.join(" + "),
        };
        *out.entry(truth).or_default().entry(said).or_default() += 1;
    }
    out
}

/// Shares right by strength.
fn power(done: &[&Trial]) -> Vec<(f64, f64, Count)> {
    (0..5)
        .map(|i| {
            let (low, high) = (0.2 * f64::from(i), 0.2 * f64::from(i + 1));
            let own = chosen(done, &|t| {
                single(t) && t.strength >= low && t.strength < high + 1e-9
            });
            (low, high, Count::of(&own, first_right))
        })
        .collect()
}

/// The diagnosis, with its Brier score, and the rivals on the same cases.
fn methods(sorted: &Sorted, brier: Option<f64>) -> Vec<Method> {
    let Sorted {
        done,
        clean,
        visible,
        dim,
        unknown,
        ..
    } = sorted;
    let mut out = vec![Method {
        name: "deacal".into(),
        false_alarm_rate: Count::of(clean, |t| t.verdict != "adequate"),
        top1_detectable: Count::of(visible, first_right),
        top1_hidden: Count::of(dim, first_right),
        unknown_not_named: Count::of(unknown, |t| t.named.is_empty()),
        brier,
    }];
    let names = done.first().map_or(Vec::new(), |t| {
        t.rivals.iter().map(|r| r.0.clone()).collect::<Vec<_>>()
    });
    for name in names {
        let of = |t: &Trial| t.rivals.iter().find(|r| r.0 == name).cloned();
        let claims: Vec<bool> = done
            .iter()
            .filter_map(|t| Some(t.truth.contains(&of(t)?.2?)))
            .collect();
        let wrong = claims.iter().filter(|c| !**c).count() as f64;
        let says = |t: &Trial| of(t).is_some_and(|r| r.2.as_deref() == Some(t.truth[0].as_str()));
        out.push(Method {
            false_alarm_rate: Count::of(clean, |t| of(t).is_some_and(|r| r.1)),
            top1_detectable: Count::of(visible, says),
            top1_hidden: Count::of(dim, says),
            unknown_not_named: Count::of(unknown, |t| of(t).is_some_and(|r| r.2.is_none())),
            brier: (!claims.is_empty()).then(|| wrong / claims.len() as f64),
            name,
        });
    }
    out
}

/// Scores trials whose answers are open.
pub fn score(trials: &[Trial]) -> Proof {
    let sorted = Sorted::new(trials);
    let Sorted {
        done,
        clean,
        visible,
        dim,
        unknown,
        visible_unknown,
        pairs,
        clear_pairs,
        named,
    } = &sorted;
    let calls: Vec<(f64, f64)> = named
        .iter()
        .map(|t| (t.candidates[0].1, f64::from(t.truth.contains(&t.named[0]))))
        .collect();
    let n = calls.len().max(1) as f64;
    let firsts: Vec<(f64, bool)> = calls.iter().map(|c| (c.0, c.1 > 0.5)).collect();
    let base = calls.iter().map(|c| c.1).sum::<f64>() / n;
    let brier = calls.iter().map(|c| (c.0 - c.1).powi(2)).sum::<f64>() / n;
    let own_odds = calibration_of_each(named, &right_or_grouped);
    let strict = calibration_of_each(named, &|t, n| t.truth.iter().any(|e| e == n));
    let unexplained = |t: &Trial| t.verdict == "unexplained";
    let gaps_closed = |t: &[&Trial]| Median::new(t.iter().map(|t| t.gap_closed).collect());
    Proof {
        n_cases: done.len(),
        failures: trials
            .iter()
            .filter_map(|t| t.failure.as_ref().map(|f| format!("{}: {f}", t.case)))
            .collect(),
        false_alarm_rate: Count::of(clean, |t| t.verdict != "adequate"),
        top1_detectable: Count::of(visible, first_right),
        top3_detectable: Count::of(visible, |t| {
            t.candidates.iter().take(3).any(|c| c.0 == t.truth[0])
        }),
        group_detectable: Count::of(visible, first_stands_for_it),
        top1_hidden: Count::of(dim, first_right),
        group_hidden: Count::of(dim, first_stands_for_it),
        wrong_hidden: Count::of(dim, |t| !t.named.is_empty() && !first_stands_for_it(t)),
        found_at_three_times_smallest: Count::of(
            &chosen(done, &|t| {
                single(t) && t.over_smallest.is_some_and(|o| o >= 3.0)
            }),
            first_stands_for_it,
        ),
        unknown_called_unexplained: Count::of(unknown, unexplained),
        visible_unknown_called_unexplained: Count::of(visible_unknown, unexplained),
        learnt_where_it_acts: Count::of(
            &chosen(unknown, &|t| t.learnt_site.is_some() && t.rig == "robot"),
            learnt_where_it_acts,
        ),
        unknown_gap_closed_median: gaps_closed(visible_unknown),
        pairs_both_named: Count::of(clear_pairs, both_named),
        pairs_by_group: Count::of(clear_pairs, both_stand_for_them),
        all_pairs_both_named: Count::of(pairs, both_named),
        pairs_first_right: Count::of(pairs, |t| {
            t.named.first().is_some_and(|n| t.truth.contains(n))
        }),
        located: Count::of(
            &chosen(done, &|t| t.located.is_some() && t.verdict != "adequate"),
            |t| t.located == Some(true),
        ),
        gap_closed_median: gaps_closed(visible),
        coverage: coverage(done),
        calibration_error: calibration_error(&calibration(&firsts)),
        brier: [brier, base * (1.0 - base)],
        confusion: confusion(done),
        first_names: FirstNames::of(done),
        power: power(done),
        methods: methods(&sorted, (!calls.is_empty()).then_some(brier)),
        stated_group_detectable: Count::of(visible, first_in_group),
        wrong_above_80: Count::of(done, wrong_sure),
        exact_sets: Count::of(done, exact),
        calibration_error_each: calibration_error(&own_odds),
        calibration_error_each_strict: calibration_error(&strict),
        calibration: own_odds,
        stated_group_size: named.iter().map(|t| group_size(t)).sum::<f64>() / n,
        by_kind: Row::of(done, |t| kind(t).into()),
        by_cause: Row::of(done, |t| {
            t.form.first().cloned().unwrap_or_else(|| "none".into())
        }),
    }
}
