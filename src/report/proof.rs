//! `proof.json` and the report of a proof.

use minijinja::context;

use super::html::number;
use super::html::page::{self, Cell, Section, Status, Summary, Table, Tile};
use super::html::plot::{self, Axis, Band, Mark, Panel, Role, Width};
use crate::effects::plain_name;
use crate::proof::{Count, FirstNames, Proof, Row, Trial};

fn share(c: &Count) -> Cell {
    let Some(p) = c.share else {
        return Cell::number("0 of 0");
    };
    let [low, high] = c.ci95.map(|x| 100.0 * x);
    let parts = [
        format!("{:.1} % ({} of {};", 100.0 * p, c.hits, c.of),
        format!("{low:.1} to {high:.1})"),
    ];
    // a narrow column breaks before the interval and nowhere else
    let parts = parts.map(|part| part.replace(' ', "\u{a0}"));
    Cell::of("flush", parts.join(" "))
}

/// The report of a proof.
pub fn render_proof(proof: &Proof, trials: &[Trial]) -> String {
    let sections = [
        methods(proof),
        scores(proof),
        power(proof),
        confusion(proof),
        rows(
            "kinds",
            "By kind",
            "What became of the cases of each rig and kind. A wrong name above 80 % is neither true nor in a group with the truth that the diagnosis itself calls indistinguishable.",
            &proof.by_kind,
        ),
        rows(
            "causes",
            "By cause",
            "The same, by the generator's own name of the cause.",
            &proof.by_cause,
        ),
        calibration(proof),
        concealed(trials),
    ];
    let summary = Summary {
        of: String::new(),
        picture: reliability(proof),
        status: Status::Good,
        word: format!("{} cases", proof.n_cases),
        headline: number::words(&format!(
            "Of {} cases with sealed answers, the effect that a plain refit leaves visible was named first in {}, false alarms were raised on {}, and what is in no catalogue was called unexplained in {}.",
            proof.n_cases,
            words(&proof.top1_detectable),
            words(&proof.false_alarm_rate),
            words(&proof.unknown_called_unexplained),
        )),
        tiles: [
            ("Visible: right effect first", &proof.top1_detectable),
            ("False alarms on clean cases", &proof.false_alarm_rate),
            (
                "In no catalogue: called unexplained",
                &proof.unknown_called_unexplained,
            ),
            ("A wrong name above 80 %", &proof.wrong_above_80),
        ]
        .iter()
        .filter_map(|(label, count)| tile(label, count))
        .collect(),
        notes: Vec::new(),
    };
    page::page("Proof of the diagnosis", &summary, &sections)
}

fn words(c: &Count) -> String {
    format!("{} of {}", c.hits, c.of)
}

/// A share as a key number, with its interval.
fn tile(label: &str, c: &Count) -> Option<Tile> {
    let [low, high] = c.ci95.map(|x| number::fixed(100.0 * x, 1));
    c.share.map(|share| Tile {
        label: label.into(),
        value: number::fixed(100.0 * share, 1),
        unit: "%".into(),
        note: format!("{low} to {high}; {}", words(c)),
    })
}

/// Whether odds are kept: how often a name was right over the odds that it was given.
fn reliability(proof: &Proof) -> String {
    let bins: Vec<_> = proof.calibration.iter().filter(|b| b.3.of > 0).collect();
    if bins.len() < 2 {
        return String::new();
    }
    let point = |b: &&&(f64, f64, f64, Count)| Some([100.0 * b.2, 100.0 * b.3.share?]);
    let points: Vec<[f64; 2]> = bins.iter().filter_map(|b| point(&b)).collect();
    let rows = bins.iter().map(|b| {
        let [low, high] = b.3.ci95.map(|v| 100.0 * v);
        [100.0 * b.2, low, high]
    });
    let dots = |name: &str, mark| plot::Series {
        name: name.into(),
        role: Role::One,
        mark,
        points: points.clone(),
    };
    let panel = Panel {
        y: Axis::over("right, %", [0.0, 100.0]),
        height: 230.0,
        shades: Vec::new(),
        bands: vec![Band {
            name: "95 % interval".into(),
            role: Role::One,
            rows: rows.collect(),
        }],
        series: vec![
            plot::Series {
                name: "as promised".into(),
                role: Role::Base,
                mark: Mark::Dashed,
                points: vec![[0.0, 0.0], [100.0, 100.0]],
            },
            dots("", Mark::Line),
            dots("names", Mark::Dots),
        ],
    };
    let panels = [panel];
    let drawing = plot::line_plot(
        "How often a name was right, over its odds",
        &Axis::over("odds of the name, %", [0.0, 100.0]),
        &panels,
        Width::Part,
    );
    let caption = "Every name by its own odds: on the line they are kept, above it the diagnosis is too careful, below it too sure. Right is what is true, or stands in a stated group with it.";
    plot::figure(&[drawing], &plot::legend(&panels), caption)
}

/// Share of right names over the strength of the cause.
fn power_curve(proof: &Proof) -> String {
    let middle = |b: &(f64, f64, Count)| (b.0 + b.1) / 2.0;
    let known: Vec<_> = proof.power.iter().filter(|b| b.2.of > 0).collect();
    if known.len() < 2 {
        return String::new();
    }
    let row = |b: &&(f64, f64, Count)| {
        let [low, high] = b.2.ci95.map(|v| 100.0 * v);
        [middle(b), low, high]
    };
    let points = known
        .iter()
        .filter_map(|b| Some([middle(b), 100.0 * b.2.share?]));
    let panels = [Panel {
        y: Axis::over("right effect first, %", [0.0, 100.0]),
        height: 230.0,
        shades: Vec::new(),
        bands: vec![Band {
            name: "95 % interval".into(),
            role: Role::One,
            rows: known.iter().map(row).collect(),
        }],
        series: vec![plot::Series {
            name: "right first".into(),
            role: Role::One,
            mark: Mark::Line,
            points: points.collect(),
        }],
    }];
    let drawing = plot::line_plot(
        "Right effect first, over its strength",
        &Axis::over("strength from 0 (barely visible) to 1 (strong)", [0.0, 1.0]),
        &panels,
        Width::Part,
    );
    plot::figure(&[drawing], &plot::legend(&panels), "")
}

fn methods(proof: &Proof) -> Section {
    let mut table = Table::new(
        "The diagnosis and simpler methods on the same cases",
        vec![
            Cell::text("Method"),
            Cell::number("False alarms on clean cases"),
            Cell::number("Right effect first, visible"),
            Cell::number("Right effect first, below 1.5 times the floor"),
            Cell::number("No name claimed for what is in no catalogue"),
            Cell::number("Brier score of its names"),
        ],
    );
    for m in &proof.methods {
        table.row(vec![
            Cell::text(m.name.clone()),
            share(&m.false_alarm_rate),
            share(&m.top1_detectable),
            share(&m.top1_hidden),
            share(&m.unknown_not_named),
            Cell::number(m.brier.map_or("-".into(), |b| format!("{b:.3}"))),
        ]);
    }
    Section::table(
        "methods",
        "Against simpler methods",
        "Counts with 95 % intervals (Wilson). Visible: a plain refit with all parameters free leaves 1.5 times the noise or more. A Brier score is the mean square of the probability of a name less 1 where it is right, less 0 where it is not; simpler methods know no doubt, so theirs is the share of wrong names.",
        table,
    )
}

/// What is counted, in the order of the table.
fn counts(proof: &Proof) -> [(&str, &Count); 18] {
    [
        (
            "Visible: right effect among the first three",
            &proof.top3_detectable,
        ),
        (
            "Visible: right effect, or one that the recordings cannot tell from it",
            &proof.group_detectable,
        ),
        (
            "Visible: right effect, or one in a stated group with it",
            &proof.stated_group_detectable,
        ),
        ("All cases: a wrong name above 80 %", &proof.wrong_above_80),
        (
            "All cases: the names are exactly what is true",
            &proof.exact_sets,
        ),
        (
            "Below 1.5 times the floor: right effect first",
            &proof.top1_hidden,
        ),
        (
            "Below: right effect, or one that the recordings cannot tell from it",
            &proof.group_hidden,
        ),
        ("Below: another name outside the group", &proof.wrong_hidden),
        (
            "In no catalogue: called unexplained",
            &proof.unknown_called_unexplained,
        ),
        (
            "In no catalogue and visible: called unexplained",
            &proof.visible_unknown_called_unexplained,
        ),
        (
            "In no catalogue, robots: what was learnt acts where it does",
            &proof.learnt_where_it_acts,
        ),
        (
            "Three times the smallest size that the program states, or more: found",
            &proof.found_at_three_times_smallest,
        ),
        (
            "Two effects, each detectable beside the other: both named",
            &proof.pairs_both_named,
        ),
        (
            "The same, or effects that the recordings cannot tell from them",
            &proof.pairs_by_group,
        ),
        (
            "Two effects, all pairs: both named",
            &proof.all_pairs_both_named,
        ),
        (
            "Two effects: the first name is right",
            &proof.pairs_first_right,
        ),
        ("Place among the first three", &proof.located),
        (
            "95 % intervals that hold the equivalent value",
            &proof.coverage,
        ),
    ]
}

fn scores(proof: &Proof) -> Section {
    let mut table = Table::new("Scores", vec![Cell::text("What"), Cell::number("Measured")]);
    for (what, count) in counts(proof) {
        table.row(vec![Cell::text(what), share(count)]);
    }
    let medians = [
        (
            "Share of the gap to the floor closed on held-out, median of visible cases",
            &proof.gap_closed_median,
        ),
        (
            "The same of effects in no catalogue, by what was learnt",
            &proof.unknown_gap_closed_median,
        ),
    ];
    for (what, gap) in medians {
        table.row(vec![
            Cell::text(what),
            Cell::number(gap.value.map_or("-".into(), |v| {
                format!("{:.1} % (of {})", 100.0 * v, gap.of)
            })),
        ]);
    }
    table.row(vec![
        Cell::text("Expected calibration error of the first probability, ten bins"),
        Cell::number(format!("{:.3}", proof.calibration_error)),
    ]);
    table.row(vec![
        Cell::text(
            "Expected calibration error of every name by its own odds: right if in a stated group, only if true",
        ),
        Cell::number(format!(
            "{:.3}, {:.3}",
            proof.calibration_error_each, proof.calibration_error_each_strict
        )),
    ]);
    table.row(vec![
        Cell::text("Names in the stated group of the first name, mean"),
        Cell::number(format!("{:.2}", proof.stated_group_size)),
    ]);
    table.row(vec![
        Cell::text("Brier score of it, and of the base rate"),
        Cell::number(format!("{:.3}, {:.3}", proof.brier[0], proof.brier[1])),
    ]);
    Section::table("scores", "Scores", "", table)
}

fn power(proof: &Proof) -> Section {
    let mut table = Table::new(
        "Right effect first, by strength",
        vec![
            Cell::text("Strength (0 barely visible, 1 strong)"),
            Cell::number("Right first"),
        ],
    );
    for (low, high, count) in &proof.power {
        table.row(vec![
            Cell::text(format!("{low:.1} to {high:.1}")),
            share(count),
        ]);
    }
    let context = context! { picture => page::safe(power_curve(proof)), table => table.html() };
    Section::new(
        "power",
        "Power against size",
        "{{ picture }}{{ table }}",
        context,
    )
}

fn confusion(proof: &Proof) -> Section {
    let mut table = Table::new(
        "What was said of what was true",
        vec![Cell::text("Truth"), Cell::text("Said, how often")],
    );
    for (truth, said) in &proof.confusion {
        let mut list: Vec<(&String, &usize)> = said.iter().collect();
        list.sort_by(|a, b| b.1.cmp(a.1));
        let text: Vec<String> = list
            .iter()
            .map(|(s, n)| format!("{} {n}", number::words(s)))
            .collect();
        table.row(vec![
            Cell::text(number::words(truth)),
            Cell::text(text.join(", ")),
        ]);
    }
    let pictures: String = proof.first_names.iter().map(first_names).collect();
    let says = "What is true to the left, what was named first below, how often in the cells: blue where it is right, vermilion where not. Cases with two causes are in the table.";
    let context =
        context! { says => says, pictures => page::safe(pictures), table => table.html() };
    let template = "<p>{{ says }}</p>{{ pictures }}{{ table }}";
    Section::new("confusion", "Confusion", template, context)
}

/// True cause against first name as a picture.
fn first_names(f: &FirstNames) -> String {
    let names = |list: &[String], none: &str, unknown: &str| -> Vec<String> {
        let name = |id: &String| match id.as_str() {
            "none" => none.to_owned(),
            "unknown" => unknown.to_owned(),
            id => plain_name(id),
        };
        list.iter().map(name).collect()
    };
    let rows = names(&f.truths, "no cause", "in no catalogue");
    let columns = names(&f.said, "adequate", "unexplained");
    let of = match f.robots {
        true => "Robots",
        false => "Single coordinates",
    };
    let which = match f.visible {
        true => "visible: a plain refit leaves 1.5 times the noise or more.",
        false => "hidden: a plain refit leaves less than that; and cases without a cause.",
    };
    let caption = format!("{of}, {which}");
    let label = format!("What is true against what was named first: {caption}");
    let right = |i: usize, j: usize| f.truths[i] == f.said[j];
    let drawing = plot::counts(&label, &rows, &columns, &f.counts, right);
    plot::figure(&[drawing], "", &caption)
}

fn rows(anchor: &'static str, title: &'static str, text: &str, list: &[Row]) -> Section {
    let mut table = Table::new(
        title,
        vec![
            Cell::text("Rig"),
            Cell::text("What"),
            Cell::number("Cases"),
            Cell::number("Visible"),
            Cell::number("of these right first"),
            Cell::number("or in the stated group"),
            Cell::number("Adequate"),
            Cell::number("Unexplained"),
            Cell::number("Wrong above 80 %"),
        ],
    );
    for r in list {
        let mut cells = vec![
            Cell::text(r.rig.clone()),
            Cell::text(number::words(&r.what)),
        ];
        let counts = [
            r.cases,
            r.visible,
            r.visible_first,
            r.visible_group,
            r.adequate,
            r.unexplained,
            r.wrong_above_80,
        ];
        cells.extend(counts.map(|n| Cell::number(n.to_string())));
        table.row(cells);
    }
    Section::table(anchor, title, text, table)
}

fn calibration(proof: &Proof) -> Section {
    let mut table = Table::new(
        "Every name by its own odds",
        vec![
            Cell::text("Odds"),
            Cell::number("Mean"),
            Cell::number("True, or in a stated group"),
        ],
    );
    for (low, high, mean, count) in proof.calibration.iter().filter(|b| b.3.of > 0) {
        table.row(vec![
            Cell::text(format!("{:.0} to {:.0} %", 100.0 * low, 100.0 * high)),
            Cell::number(format!("{:.1} %", 100.0 * mean)),
            share(count),
        ]);
    }
    Section::table("calibration", "Calibration of the odds", "", table)
}

/// The three that moved furthest.
fn moved(list: &[(String, f64)]) -> String {
    let words: Vec<String> = list
        .iter()
        .take(3)
        .map(|(name, by)| {
            format!(
                "{} x {}",
                name.replace('_', " "),
                number::significant(1.0 + by, 2)
            )
        })
        .collect();
    words.join(", ")
}

fn concealed(trials: &[Trial]) -> Section {
    let mut table = Table::new(
        "Each case: what the plain refit makes of it",
        vec![
            Cell::text("Case"),
            Cell::text("Truth"),
            Cell::number("Plain refit over floor"),
            Cell::number("held out"),
            Cell::text("Film moved to"),
            Cell::number("Weighted mean square, plain"),
            Cell::number("with the effect named"),
            Cell::text("Said"),
        ],
    );
    for t in trials.iter().filter(|t| t.failure.is_none()) {
        let or = |list: &[String], none: &str| match list.is_empty() {
            true => none.to_string(),
            false => list.join(" + "),
        };
        table.row(vec![
            Cell::of("file", t.case.clone()),
            Cell::text(number::words(&or(&t.truth, "none"))),
            Cell::number(format!("{:.2}", t.detectability)),
            Cell::number(format!("{:.2}", t.concealment.held_out_over_floor)),
            Cell::text(moved(&t.concealment.moved)),
            Cell::number(number::significant(t.mean_squares[0], 3)),
            Cell::number(number::significant(t.mean_squares[1], 3)),
            Cell::text(number::words(&format!(
                "{} {}",
                t.verdict.replace('_', " "),
                t.named.join(" + ")
            ))),
        ]);
    }
    Section::table(
        "cases",
        "The concealment, case by case",
        "Film moved to: the three parameters of the plain refit that are furthest from the true ones, over these. A ratio near 1 means that wrong moduli hide the effect in volts; the weighted torque residual still sees it.",
        table,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proof::score;

    fn trial(truth: &[&str], said: &[&str], verdict: &str, times_the_noise: f64) -> Trial {
        let text = serde_json::json!({
            "case": "case-1", "rig": "robot", "recordings": [], "truth": truth, "actuators": [],
            "form": truth, "strength": 0.5, "detectability": times_the_noise, "verdict": verdict,
            "confidence": 0.9, "named": said, "odds": vec![0.9; said.len()],
            "candidates": [("leakage", 0.9)],
            "group": [], "groups": [], "stands_out": [],
            "concealment": { "residual_over_floor": 1.0, "held_out_over_floor": 1.0, "moved": [] },
            "gap_closed": 0.5, "located": null, "values": [], "true_values": [],
            "over_smallest": null, "mean_squares": [1.0, 1.0, 1.0, 1.0],
            "evidence": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "most_surprising": "", "surprises": [],
            "tried": [], "rivals": [], "failure": null,
        });
        serde_json::from_value(text).expect("a trial")
    }

    #[test]
    fn first_names_are_drawn_against_the_truth() {
        let missing = "missing_physics";
        let trials = [
            trial(&["joint_friction"], &["joint_friction"], missing, 3.0),
            trial(
                &["joint_friction"],
                &["joint_damping", "leakage"],
                missing,
                2.0,
            ),
            trial(&["joint_friction"], &[], "adequate", 1.1),
            trial(&["unknown"], &[], "unexplained", 4.0),
            trial(&[], &[], "adequate", 1.0),
            trial(&["leakage", "joint_friction"], &["leakage"], missing, 5.0),
        ];
        let proof = score(&trials);
        let [seen, hidden] = &proof.first_names[..] else {
            panic!("{:?}", proof.first_names);
        };
        assert!(seen.visible && !hidden.visible && seen.robots);
        assert_eq!(seen.truths, ["joint_friction", "unknown"]);
        assert_eq!(seen.said, ["joint_damping", "joint_friction", "unknown"]);
        assert_eq!(seen.counts, [[1, 1, 0], [0, 0, 1]]);
        assert_eq!(hidden.truths, ["none", "joint_friction"]);
        assert_eq!(hidden.counts, [[1], [1]]);
        let html = render_proof(&proof, &trials);
        let [first, _] = [0, 1].map(|i| first_names(&proof.first_names[i]));
        let cells = |role: &str| first.matches(&format!("class=\"f-{role}\"")).count();
        // right once and unexplained once, one other name
        assert_eq!((cells("one"), cells("two")), (2, 1));
        assert_eq!(html.matches("class=\"plot heat counts\"").count(), 2);
    }
}
