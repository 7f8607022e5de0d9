//! The report of a diagnosis: first in words what is missing and how sure that is, then what it looks like.

use minijinja::{Value, context};

use super::number;
use super::page::{self, Cell, Item, Note, Section, Status, Summary, Table, Tile, safe};
use super::plot::{self, Axis, Band, Mark, Panel, Role, Series, Width};
use super::recordings::curve;
use super::summary::{item, note, remarks, sized, tile};
use super::{Provenance, learnt, mechanism, provenance};
use crate::diagnosis::{Candidate, Diagnosis, Gain, Place, RigKind, Traces, Verdict};
use crate::effects::{by_id, plain_name};
use crate::report::answer::{Answer, mistaken_for, odds, sits_in, size};
use crate::report::effect_entries::{actuators, named};

/// Questions that the first screen answers.
pub const FITS: &str = "Does the plain model fit, against the noise?";
/// See [`FITS`].
pub const WHERE: &str = "Where does the plain model fail?";
/// See [`FITS`].
pub const MISSING_IS: &str = "What is missing?";
/// See [`FITS`].
pub const CHANGED: &str = "What changed when it was added?";
/// See [`FITS`].
pub const NEXT: &str = "What to record next?";
/// See [`FITS`].
pub const UNSEEN: &str = "What could not have been seen?";

/// Places and causes that the first screen names.
const NAMED: usize = 4;
/// A cause less probable than this is left to the table.
const WORTH_NAMING: f64 = 0.02;
/// Dots of a scatter plot.
const DOTS: usize = 500;

/// The report of a diagnosis.
pub fn render_diagnosis(d: &Diagnosis, made_of: &Provenance) -> String {
    let sections: Vec<Section> = [
        voltages(d),
        mechanism::section(d),
        located(d),
        candidates(d),
        rivals(d),
        learnt::section(d),
        law(d),
        tolerances(d),
        hidden(d),
        Some(provenance::of(made_of)),
    ]
    .into_iter()
    .flatten()
    .collect();
    page::page("Diagnosis of the model", &summary(d, made_of), &sections)
}

fn summary(d: &Diagnosis, made_of: &Provenance) -> Summary {
    let (status, word) = match d.verdict {
        Verdict::Adequate => (Status::Good, "adequate"),
        Verdict::MissingPhysics => (Status::Fair, "physics is missing"),
        Verdict::Unexplained => (Status::Poor, "unexplained"),
    };
    let answer = Answer::of_diagnosis(d);
    let notes = [
        missing(d),
        places(d),
        changed(d),
        next(d),
        unseen(d),
        fits(d),
        remarks(&d.remarks),
    ];
    let mut tiles = super::summary::facts(&answer);
    tiles.extend(errors(d));
    Summary {
        of: provenance::head(made_of),
        status,
        word: word.into(),
        headline: number::words(&answer.says),
        picture: picture(d),
        tiles,
        notes: notes.into_iter().flatten().collect(),
    }
}

/// The error before and after, and the noise.
fn picture(d: &Diagnosis) -> String {
    let bars = |g: &Gain| {
        let [before, after, noise] = g.told(d.over_all());
        let mut list = vec![(Role::Two, before)];
        if d.has_augmented() {
            list.push((Role::Five, after));
        }
        list.push((Role::Base, noise));
        list
    };
    let mut groups = vec![("fitted".to_string(), bars(&d.train))];
    if let Some(gain) = &d.holdout {
        groups.insert(0, ("held out".to_string(), bars(gain)));
    }
    let mut names = vec![("plain model", Role::Two)];
    if d.has_augmented() {
        names.push(("augmented model", Role::Five));
    }
    names.push(("noise alone", Role::Base));
    let title = format!("error{}, {} rms", d.told_over(), d.unit);
    let drawing = plot::bars("Error before and after, and the noise", &title, &groups);
    plot::figure(&[drawing], &plot::colour_key(&names), "")
}

fn errors(d: &Diagnosis) -> Vec<Tile> {
    let (gain, on) = judged_on(d);
    let [before, after, noise] = gain.told(d.over_all());
    let mut out = vec![
        tile("Probability of this verdict", odds(d.confidence), ""),
        sized(
            &format!("Plain model, {on}, rms{}", d.told_over()),
            before,
            &d.unit,
        ),
    ];
    if d.has_augmented() {
        out.push(sized(&format!("Augmented model, {on}"), after, &d.unit));
    }
    out.push(sized("Noise alone makes", noise, &d.unit));
    out
}

/// Whether parts of the fitted recordings were held out, because no whole one was.
fn parts_held_out(d: &Diagnosis) -> bool {
    let fitted = |id: &str| d.traces.iter().any(|t| !t.held_out && t.id == id);
    d.traces.iter().any(|t| t.held_out && fitted(&t.id))
}

/// The errors that count: on held-out recordings where there are any.
fn judged_on(d: &Diagnosis) -> (&Gain, &'static str) {
    match &d.holdout {
        Some(gain) => (gain, "held out"),
        None => (&d.train, "fitted"),
    }
}

fn fits(d: &Diagnosis) -> Option<Note> {
    let size = |v: f64| number::sized(v, &d.unit, 3);
    let sentence = |on: &str, gain: &Gain, square: f64| {
        let mut text = format!(
            "{} rms{}, where the noise of the capture makes {}: {} times as much.",
            size(gain.before_v),
            d.over,
            size(gain.noise_floor_v),
            number::significant(gain.before_v / gain.noise_floor_v, 2),
        );
        if square.is_finite() {
            text += &format!(
                " {}eighted by the noise, the mean square is {} where noise alone makes 1.",
                if d.rig == RigKind::Robot {
                    "In torque, w"
                } else {
                    "W"
                },
                number::significant(square, 3)
            );
        }
        item(format!("{on}:"), text)
    };
    let mut items = vec![sentence(
        "On the fitted recordings",
        &d.train,
        d.plain_mean_square,
    )];
    if let Some(gain) = &d.holdout {
        let square = d.plain_holdout_mean_square;
        items.push(sentence("On the held-out recordings", gain, square));
    }
    let lead = match d.verdict {
        _ if d.beyond.is_some() => {
            "Only with a part beyond its tolerance: then it leaves no more than noise."
        }
        Verdict::Adequate => {
            "Yes. With all of its parameters fitted anew it leaves no more than noise."
        }
        _ => "No. With all of its parameters fitted anew it leaves more than noise:",
    };
    Some(note(FITS, lead, items))
}

fn places(d: &Diagnosis) -> Option<Note> {
    if d.places.is_empty() {
        return None;
    }
    let line = |p: &Place| {
        let says = super::summary::capital(number::words(&p.says).trim_end_matches('.'));
        let counted = says.contains("of the excess");
        let mut text = says;
        if !counted && p.share_of_excess.is_finite() && p.share_of_samples.is_finite() {
            text += &format!(
                ". {} of what exceeds the noise lies in {} of the samples",
                number::per_cent(p.share_of_excess),
                number::per_cent(p.share_of_samples)
            );
        }
        text += &match p.p_value {
            p if p.is_nan() => ".".to_string(),
            p if p < 1e-3 => "; chance would not do that.".into(),
            p if p > 0.9 => "; chance does as much.".into(),
            p => format!(
                "; by chance with probability {}.",
                number::significant(p, 1)
            ),
        };
        item(format!("{}:", super::summary::capital(&place(p))), text)
    };
    let lead = match d.verdict {
        _ if d.beyond.is_some() => {
            "With that part it leaves no more than noise as a whole. Least like noise is what lies here:"
        }
        Verdict::Adequate => {
            "As a whole it leaves no more than noise. Least like noise is what lies here:"
        }
        _ => "",
    };
    Some(note(
        WHERE,
        lead,
        d.places.iter().take(NAMED).map(line).collect(),
    ))
}

/// A place in few words: `voltage 0 to 1.5 kV, actuator 2`.
fn place(p: &Place) -> String {
    let mut out = p.called.replace('_', " ");
    if let Some([low, high]) = p.range {
        let digits = number::digits(low.abs().max(high.abs()), high - low).max(3);
        let end = |v: f64| number::significant(v, digits);
        out += &match (low.is_finite(), high.is_finite()) {
            (true, true) => format!(" {} to {}", end(low), end(high)),
            (true, false) => format!(" above {}", end(low)),
            (false, true) => format!(" below {}", end(high)),
            (false, false) => String::new(),
        };
        if p.unit != "1" && (low.is_finite() || high.is_finite()) {
            out += &format!(" {}", p.unit);
        }
    }
    if let Some(value) = &p.value {
        out += &format!(" {value}");
    }
    let said = p.value.as_ref();
    if let Some(recording) = p.recording.as_ref().filter(|r| Some(*r) != said) {
        out += &format!(", {recording}");
    }
    if !p.actuators.is_empty() && p.dimension != "actuator" {
        out += &format!(", {}", sits_in(&p.actuators));
    }
    out
}

/// Standard errors from which on it is said that the model keeps another value than the one freed of noise.
const TELLING: f64 = 0.5;

/// The values of a candidate with their intervals: `resistance 9.8 MΩ (9.1 to 10.5)`.
fn values(c: &Candidate) -> String {
    let one = |v: &&crate::diagnosis::Value| {
        let mut text = size(v).with_interval();
        if v.word.is_none() && (v.value - v.fitted).abs() > TELLING * v.std_error {
            text += &format!(", {} in the model", number::sized(v.fitted, &v.unit, 3));
        }
        text + if v.at_bound { " at its bound" } else { "" }
    };
    named(c)
        .iter()
        .map(|n| {
            let list: Vec<String> = n.values.iter().map(one).collect();
            format!("{} {}", n.name.replace('_', " "), list.join(", "))
        })
        .collect::<Vec<_>>()
        .join("; ")
}

/// The id of an effect as a reader wants it.
fn title(id: &str) -> String {
    super::summary::capital(&plain_name(id))
}

fn missing(d: &Diagnosis) -> Option<Note> {
    let line = |c: &Candidate| -> Item {
        let id = c.acting.effect.id();
        let role = if c.in_model {
            ""
        } else {
            " (not in the model)"
        };
        let mut text = super::summary::capital(&number::words(&c.says));
        if !text.is_empty() && !text.ends_with('.') {
            text.push('.');
        }
        text += &match d.rig {
            RigKind::Robot => {
                format!(" In {}; {}.", sits_in(&actuators(c.acting.on)), values(c))
            }
            _ => format!(" {}.", super::summary::capital(&values(c))),
        };
        let others = mistaken_for(d, id);
        if !others.is_empty() {
            text += &format!(" Could be mistaken for {}.", others.join(", "));
        }
        item(
            format!("{}, {}{role}:", title(id), odds(c.probability)),
            text,
        )
    };
    let list: Vec<Item> = d
        .candidates
        .iter()
        .filter(|c| c.in_model || c.probability >= WORTH_NAMING)
        .take(NAMED)
        .map(line)
        .collect();
    if let Some(part) = &d.beyond {
        let nearest = match list.is_empty() {
            true => "",
            false => " The nearest causes, none of which is needed beside it:",
        };
        let lead = format!(
            "Perhaps nothing: a part is off, {}. Perhaps something that it stands in for.{nearest}",
            part.says()
        );
        return Some(note(MISSING_IS, lead, list));
    }
    let list = match &d.learnt {
        Some(l) => {
            let own = item(
                "Learnt:".to_owned(),
                number::words(&super::summary::capital(&l.says)),
            );
            // after the causes beside which it is
            let at = d.candidates.iter().filter(|c| c.in_model).count();
            let mut list: Vec<Item> = list;
            list.insert(at.min(list.len()), own);
            list
        }
        None => list,
    };
    let lead = match (d.verdict, list.is_empty()) {
        (Verdict::Adequate, true) => "Nothing that these recordings could show.",
        (Verdict::Adequate, false) => {
            "Nothing that these recordings could show; the nearest causes, none of which is needed:"
        }
        (Verdict::MissingPhysics, _) => {
            "The percentage is the probability that the cause is at work; several can be. Sizes are equivalent values of a textbook form, with 95 % intervals."
        }
        (Verdict::Unexplained, _) if d.learnt.is_some() => {
            "Something that is not in the catalogue. It was learnt from the recordings instead:"
        }
        (Verdict::Unexplained, true) => {
            "Something that is not in the catalogue. None of its causes accounts for the misfit."
        }
        (Verdict::Unexplained, false) => {
            "Something that is not in the catalogue. None of its causes accounts for the misfit; those that come nearest:"
        }
    };
    Some(note(MISSING_IS, lead, list))
}

/// Share of the way from the plain model down to the noise, in squares.
fn closed([before, after, noise]: [f64; 3]) -> Option<f64> {
    let excess = |v: f64| v * v - noise * noise;
    (excess(before) > 0.0).then(|| (1.0 - excess(after) / excess(before)).min(1.0))
}

fn changed(d: &Diagnosis) -> Option<Note> {
    if !d.has_augmented() {
        return None;
    }
    let size = |v: f64| number::sized(v, &d.unit, 3);
    let line = |on: &str, g: &Gain| {
        let errors @ [before, after, noise] = g.told(d.over_all());
        let mut text = format!(
            "{} rms{} before, {} after; the noise makes {}.",
            size(before),
            d.told_over(),
            size(after),
            size(noise)
        );
        match closed(errors) {
            Some(share) if share > 0.0 => {
                text += &format!(
                    " {} of the squares beyond noise are gone.",
                    match share {
                        s if s > 0.99 => "Above 99 %".to_string(),
                        s => number::per_cent(s),
                    }
                );
            }
            Some(_) => text += " That is no gain.",
            None => {}
        }
        item(format!("{on}:"), text)
    };
    let mut items = Vec::new();
    if let Some(gain) = &d.holdout {
        let on = match parts_held_out(d) {
            true => "On parts that were not fitted",
            false => "On recordings that were not fitted",
        };
        items.push(line(on, gain));
    }
    items.push(line("Where it was fitted", &d.train));
    let lead = match d.holdout {
        Some(_) => "",
        None => {
            "No recording was held out, so this is no proof: any further parameter lowers the error where it is fitted."
        }
    };
    Some(note(CHANGED, lead, items))
}

fn next(d: &Diagnosis) -> Option<Note> {
    let says = super::summary::capital(&number::words(&d.next_experiment));
    (!says.is_empty()).then(|| note(NEXT, says, Vec::new()))
}

fn unseen(d: &Diagnosis) -> Option<Note> {
    let names: Vec<String> = d.hidden.iter().map(|h| plain_name(h.effect)).collect();
    let lead = match names.len() {
        0 => return None,
        1 => "One cause would have stayed hidden in these recordings, because a refit of the plain model absorbs it. Its smallest visible size is in the table below.".to_string(),
        n => format!(
            "{n} causes would have stayed hidden in these recordings unless large, because a refit of the plain model absorbs them: {}. Their smallest visible sizes are in the table below.",
            names.join(", ")
        ),
    };
    Some(note(UNSEEN, lead, Vec::new()))
}

/// How the quantities of a kind of rig are drawn.
struct Drawn {
    /// Actuators.
    channels: usize,
    /// Commands above which errors are shown.
    above: f64,
    /// What drives, and the factor into the unit of the label.
    command: (String, f64),
    /// The coordinate that moves.
    height: String,
    /// The error at a kept sample, and the factor into its unit.
    kept: (String, f64),
    /// What the error is, in a sentence.
    says: &'static str,
}

fn drawn(d: &Diagnosis) -> Drawn {
    if d.rig == RigKind::Robot {
        return Drawn {
            channels: 3,
            above: 1000.0,
            command: ("command, kV".into(), 1e-3),
            height: "height of the end effector, mm".into(),
            kept: ("mN m".into(), 1e3),
            says: "Voltage that the motion needs at the film minus the one that the command makes there, where the command exceeds 1 kV; below, the noise of the capture alone is worth hundreds of volts.",
        };
    }
    let (command, height, says) = match d.rig {
        RigKind::Axis => (
            "input",
            "position",
            "Input that the model asks for to make the measured motion, minus the input that was given.",
        ),
        RigKind::Bench => (
            "measured torque",
            "angle, rad",
            "Torque of the model minus measured torque.",
        ),
        _ => (
            "measured nominal stress",
            "stretch",
            "Nominal stress of the model minus measured nominal stress.",
        ),
    };
    Drawn {
        channels: 1,
        above: -1.0,
        command: (format!("{command}, {}", d.unit), 1.0),
        height: match d.rig {
            RigKind::Axis => format!("{height}, {}", position_unit(d)),
            _ => height.into(),
        },
        kept: (d.unit.clone(), 1.0),
        says,
    }
}

/// The unit of an axis's position, as the places where it fails have it.
fn position_unit(d: &Diagnosis) -> &str {
    let of = |p: &&Place| matches!(p.dimension, "position" | "largest_stretch");
    let place = d.places.iter().find(of);
    place.map_or("in the unit of the recording", |p| &p.unit)
}

fn voltages(d: &Diagnosis) -> Option<Section> {
    if d.traces.is_empty() {
        return None;
    }
    let after = d.verdict == Verdict::MissingPhysics;
    let recordings: Vec<Value> = d
        .traces
        .iter()
        .map(|t| {
            let floor = match (&d.holdout, t.held_out) {
                (Some(gain), true) => gain.noise_floor_v,
                _ => d.train.noise_floor_v,
            };
            let context = context! {
                id => t.id.clone(),
                lead => if t.held_out { "Held out: no step of the fit has read it." } else { "Fitted." },
                figure => safe(errors_over_time(d, t, floor, after)),
            };
            context
        })
        .collect();
    let context = context! { says => number::words(&d.says), recordings => recordings };
    let template = include_str!("diagnosis_voltages.html");
    Some(Section::new(
        "voltages",
        if d.rig == RigKind::Robot {
            "Voltage error before and after"
        } else {
            "Error before and after"
        },
        template,
        context,
    ))
}

fn errors_over_time(d: &Diagnosis, t: &Traces, floor_v: f64, after: bool) -> String {
    let how = drawn(d);
    let shown = |rows: &[[f64; 3]], k: usize| -> Vec<[f64; 2]> {
        let row = |((t, c), v): ((&f64, &[f64; 3]), &[f64; 3])| {
            let above = c[k].abs() > how.above;
            [*t, if above { v[k] } else { f64::NAN }]
        };
        t.time_s
            .iter()
            .zip(&t.command_v)
            .zip(rows)
            .map(row)
            .collect()
    };
    let all = (0..how.channels).flat_map(|k| [shown(&t.before_v, k), shown(&t.after_v, k)]);
    let most = all.flatten().filter(|p| p[1].is_finite()).fold(
        2.5 * floor_v.max(if how.channels == 3 { 1.0 } else { 0.0 }),
        |m, p| m.max(p[1].abs()),
    );
    let ends = plot::extent(t.time_s.iter().copied());
    let noise = |name: &str| Band {
        name: name.into(),
        role: Role::Base,
        rows: ends.map(|x| [x, -2.0 * floor_v, 2.0 * floor_v]).to_vec(),
    };
    let command = Panel {
        y: Axis::new(how.command.0.clone()),
        height: 90.0,
        shades: Vec::new(),
        bands: Vec::new(),
        series: super::ACTUATORS
            .iter()
            .take(how.channels)
            .enumerate()
            .map(|(k, (name, role))| {
                let points = t.time_s.iter().zip(&t.command_v);
                let points = points.map(|(t, c)| [*t, c[k] * how.command.1]).collect();
                let name = if how.channels == 3 { name } else { "measured" };
                curve(name, *role, Mark::Line, points)
            })
            .collect(),
    };
    let mut panels = vec![command];
    for k in 0..how.channels {
        let mut series = vec![curve(
            "plain model",
            Role::Two,
            Mark::Line,
            shown(&t.before_v, k),
        )];
        if after {
            let points = shown(&t.after_v, k);
            series.push(curve("augmented model", Role::Five, Mark::Line, points));
        }
        panels.push(Panel {
            y: Axis::over(
                if how.channels == 3 {
                    format!("error of actuator {}, V", k + 1)
                } else {
                    format!("error, {}", d.unit)
                },
                [-1.1 * most, 1.1 * most],
            ),
            height: 110.0,
            shades: Vec::new(),
            bands: vec![noise("\u{b1}2 noise floors")],
            series,
        });
    }
    let label = format!("Error over time in {}", t.id);
    let drawing = plot::line_plot(&label, &Axis::new("time, s"), &panels, Width::Full);
    plot::figure(&[drawing], &plot::legend(&panels), how.says)
}

/// The value of a trace at a frame of a chain that an error is drawn over.
type Over = fn(&Traces, usize, usize) -> f64;

/// The coordinate in which a place lies, as far as the traces have it: axis, value, factor into the axis's
/// unit.
fn coordinate(d: &Diagnosis, dimension: &str) -> (String, Over, f64) {
    fn rate(t: &Traces, i: usize, k: usize) -> f64 {
        let (a, b) = (i.saturating_sub(3), (i + 3).min(t.time_s.len() - 1));
        (t.command_v[b][k] - t.command_v[a][k]) / (t.time_s[b] - t.time_s[a])
    }
    let how = drawn(d);
    let (command, factor) = how.command;
    match dimension {
        "voltage" if how.channels == 3 => (command, |t, i, k| t.command_v[i][k].abs(), factor),
        "voltage" => (command, |t, i, k| t.command_v[i][k], factor),
        "voltage_rate" | "direction" | "frequency" if how.channels == 3 => {
            ("rate of the command, kV/s".into(), rate, factor)
        }
        "height" | "position" | "largest_stretch" | "direction" => {
            (how.height, |t, i, _| t.height_mm[i], 1.0)
        }
        _ => (
            "time in the recording, s".into(),
            |t, i, _| t.time_s[i],
            1.0,
        ),
    }
}

/// Errors at the kept samples of the recordings `held_out` or not over a coordinate.
fn scatter(d: &Diagnosis, p: &Place, held_out: bool, after: bool) -> Vec<[f64; 2]> {
    let (_, over, factor) = coordinate(d, p.dimension);
    let how = drawn(d);
    let mut out = Vec::new();
    for t in d.traces.iter().filter(|t| t.held_out == held_out) {
        if !held_out && p.recording.as_ref().is_some_and(|r| *r != t.id) {
            continue;
        }
        let rows = if after {
            &t.torque_after
        } else {
            &t.torque_before
        };
        let frames = t.time_s.len();
        for row in rows {
            let i = t.time_s.partition_point(|x| *x < row[0] - 1e-9);
            if i >= frames || frames < 2 {
                continue;
            }
            for k in 0..how.channels {
                if p.actuators.is_empty() || p.actuators.contains(&(k + 1)) {
                    out.push([factor * over(t, i, k), row[k + 1] * how.kept.1]);
                }
            }
        }
    }
    let every = out.len().div_ceil(DOTS).max(1);
    out.into_iter().step_by(every).collect()
}

fn located(d: &Diagnosis) -> Option<Section> {
    let p = d.places.first()?;
    let mut figures = Vec::new();
    for held_out in [false, true] {
        let mut drawings = Vec::new();
        let before = scatter(d, p, held_out, false);
        if before.is_empty() {
            continue;
        }
        let after = scatter(d, p, held_out, true);
        let y = |points: &[[f64; 2]]| points.iter().map(|p| p[1]).collect::<Vec<_>>();
        let all = [y(&before), y(&after)].concat();
        let range = plot::padded(plot::extent(all.into_iter()));
        let what = if held_out { "held out" } else { "fitted" };
        let mut both: Vec<(&str, Role, Vec<[f64; 2]>)> = vec![("plain model", Role::Two, before)];
        if d.verdict == Verdict::MissingPhysics && !after.is_empty() {
            both.push(("augmented model", Role::Five, after));
        }
        for (name, role, points) in both {
            let series = Series {
                name: name.into(),
                role,
                mark: Mark::Dots,
                points,
            };
            drawings.push(plot::loops(
                &format!("Error of the {name}, {what}"),
                &Axis::new(coordinate(d, p.dimension).0),
                &Axis::over(format!("{name}, {what}, {}", drawn(d).kept.0), range),
                vec![series],
            ));
        }
        figures.push(drawings);
    }
    if figures.is_empty() {
        return None;
    }
    let of = match p.actuators.len() {
        1 | 2 => format!(" Shown: {}.", sits_in(&p.actuators)),
        _ => String::new(),
    };
    let caption = format!(
        "{}, in the coordinate in which the plain model fails most ({}).{of} A model that suffices leaves a level cloud around zero.",
        if d.rig == RigKind::Robot {
            "Torque that the motion needs minus torque that the command makes"
        } else {
            drawn(d).says.trim_end_matches('.')
        },
        place(p)
    );
    let last = figures.len() - 1;
    let drawn: String = figures
        .iter()
        .enumerate()
        .map(|(i, drawings)| plot::figure(drawings, "", if i == last { &caption } else { "" }))
        .collect();
    let mut table = Table::new(
        "Places in which the plain model differs from the recordings, most telling first.",
        [
            vec![Cell::text("place")],
            ["share of excess", "share of samples", "by chance"]
                .map(Cell::number)
                .to_vec(),
            vec![Cell::text("in words")],
        ]
        .concat(),
    );
    for p in &d.places {
        table.row(vec![
            Cell::text(place(p)),
            Cell::number(number::per_cent(p.share_of_excess)),
            Cell::number(number::per_cent(p.share_of_samples)),
            Cell::number(number::chance(p.p_value)),
            Cell::text(number::words(&p.says)),
        ]);
    }
    let context = context! { figure => safe(drawn), table => table.html() };
    let template = "{{ figure }}\n{{ table }}\n";
    Some(Section::new(
        "where",
        "Where the model fails",
        template,
        context,
    ))
}

fn candidates(d: &Diagnosis) -> Option<Section> {
    if d.candidates.is_empty() {
        return None;
    }
    let head = [
        vec![Cell::text("cause")],
        [
            "probability",
            "\u{394} BIC",
            "mean square, fitted",
            "mean square, held out",
        ]
        .map(Cell::number)
        .to_vec(),
        vec![
            Cell::text("in the model"),
            Cell::text("values, and how it did"),
        ],
    ]
    .concat();
    let mut table = Table::new(
        "Causes that were fitted in full, most probable first. Mean squares are of the error weighted by the noise of the capture, which alone makes 1.",
        head,
    );
    table.row_of(
        "group",
        vec![
            Cell::text("plain model"),
            Cell::number(""),
            Cell::number(""),
            Cell::number(number::significant(d.plain_mean_square, 3)),
            Cell::number(number::significant(d.plain_holdout_mean_square, 3)),
            Cell::text(""),
            Cell::text("all of its own parameters fitted anew"),
        ],
    );
    for c in &d.candidates {
        let says = number::words(&c.says);
        table.row(vec![
            Cell::text(if d.rig == RigKind::Robot {
                format!(
                    "{}, {}",
                    plain_name(c.acting.effect.id()),
                    sits_in(&actuators(c.acting.on))
                )
            } else {
                plain_name(c.acting.effect.id())
            }),
            Cell::number(odds(c.probability)),
            Cell::number(number::significant(c.delta_bic, 3)),
            Cell::number(number::significant(c.mean_square, 3)),
            Cell::number(number::significant(c.holdout_mean_square, 3)),
            match c.in_model {
                true => Cell::of("badge good", "yes"),
                false => Cell::of("quiet", "no"),
            },
            Cell::text(format!("{}. {says}", super::summary::capital(&values(c)))),
        ]);
    }
    let groups: Vec<String> = d
        .groups
        .iter()
        .map(|g| {
            g.iter()
                .map(|id| plain_name(id))
                .collect::<Vec<_>>()
                .join(", ")
        })
        .collect();
    let context = context! { table => table.html(), groups => groups };
    let template = include_str!("diagnosis_candidates.html");
    Some(Section::new("candidates", "Causes", template, context))
}

fn law(d: &Diagnosis) -> Option<Section> {
    let law = d.law.as_ref()?;
    let mut table = Table::new(
        "Terms of the law, strongest first.",
        ["share of excess alone", "per standard deviation"]
            .map(Cell::number)
            .into_iter()
            .fold(
                vec![Cell::text("what the torque error depends on")],
                |mut v, c| {
                    v.push(c);
                    v
                },
            ),
    );
    for (variable, coefficient, share) in &law.terms {
        table.row(vec![
            Cell::text(number::words(variable)),
            Cell::number(number::per_cent(*share)),
            Cell::number(number::significant(coefficient * 1e3, 2)),
        ]);
    }
    let says = format!(
        "No cause of the catalogue explains the misfit. A law over physical variables was looked for in what is left: these terms take away {} of what exceeds the noise. It is a hypothesis about what to look for at the robot, not a name.",
        number::per_cent(law.share)
    );
    let context = context! { says => says, table => table.html() };
    let template = "<p>{{ says }}</p>\n{{ table }}\n";
    Some(Section::new(
        "law",
        "What the unexplained part depends on",
        template,
        context,
    ))
}

/// The models of simpler methods, beside the diagnosis's own.
fn rivals(d: &Diagnosis) -> Option<Section> {
    if d.rival_models.is_empty() {
        return None;
    }
    let mut table = Table::new(
        &format!(
            "Errors in {}, rms, with the causes that each method adds to the plain model.",
            d.unit
        ),
        vec![
            Cell::text("method"),
            Cell::text("adds"),
            Cell::number("fitted"),
            Cell::number("held out"),
        ],
    );
    let figure = |v: f64| Cell::number(number::significant(v, 3));
    let holdout = |g: Option<&Gain>| figure(g.map_or(f64::NAN, |g| g.after_v));
    let own: Vec<String> = d
        .candidates
        .iter()
        .filter(|c| c.in_model)
        .map(|c| plain_name(c.acting.effect.id()))
        .collect();
    let before = d.holdout.map_or(f64::NAN, |h| h.before_v);
    table.row(vec![
        Cell::text("plain model"),
        Cell::text(""),
        figure(d.train.before_v),
        figure(before),
    ]);
    table.row_of(
        "group",
        vec![
            Cell::text("this diagnosis"),
            Cell::text(own.join(", ")),
            figure(d.train.after_v),
            holdout(d.holdout.as_ref()),
        ],
    );
    for r in &d.rival_models {
        table.row(vec![
            Cell::text(r.method),
            Cell::text(
                r.effects
                    .iter()
                    .map(|e| plain_name(e))
                    .collect::<Vec<_>>()
                    .join(", "),
            ),
            figure(r.train.after_v),
            holdout(r.holdout.as_ref()),
        ]);
    }
    let context = context! { table => table.html() };
    Some(Section::new(
        "rivals",
        "Against simpler methods",
        "{{ table }}\n",
        context,
    ))
}

/// The drive that brings out a cause of a kind of rig.
fn brought_out_by(rig: RigKind, id: &str) -> &'static str {
    match rig {
        RigKind::Robot => by_id(id).map_or("", |e| e.brought_out_by()),
        _ => crate::effects::line::by_id(id).map_or("", |e| e.brought_out_by()),
    }
}

/// Departures from the drawing that are shown, largest first.
const DEPARTURES: usize = 12;

fn tolerances(d: &Diagnosis) -> Option<Section> {
    if d.departed.is_empty() {
        return None;
    }
    let mut table = Table::new(
        "Parts as they are built, most probably, beside what their tolerances allow (one standard deviation).",
        [
            vec![Cell::text("part")],
            ["differs by", "tolerance", "times its tolerance"]
                .map(Cell::number)
                .to_vec(),
            vec![Cell::text("from")],
        ]
        .concat(),
    );
    let mut sorted: Vec<_> = d.departed.iter().collect();
    let times = |p: &crate::diagnosis::Departed| (p.found / p.tolerance).abs();
    sorted.sort_by(|a, b| times(b).total_cmp(&times(a)));
    for p in sorted.into_iter().take(DEPARTURES) {
        let size = |x: f64| match p.unit {
            "1" => format!("{} %", number::significant(100.0 * x, 2)),
            unit => number::sized(x, unit, 2),
        };
        table.row(vec![
            Cell::text(&p.what),
            Cell::number(size(p.found)),
            Cell::number(size(p.tolerance)),
            Cell::number(number::significant(times(p), 2)),
            Cell::text(if p.stated { "rig.toml" } else { "default" }),
        ]);
    }
    let context = context! {
        table => table.html(),
        scale => number::significant(100.0 * d.built, 2),
    };
    let template = "<p>No robot is exactly its drawing. Parts that differ within their tolerances are taken as they are and are no cause. Where the rig states none, the defaults count at {{ scale }} %: as well as this robot was built, told from the recordings.</p>\n{{ table }}\n";
    Some(Section::new("tolerances", "As built", template, context))
}

fn hidden(d: &Diagnosis) -> Option<Section> {
    if d.hidden.is_empty() {
        return None;
    }
    let mut table = Table::new(
        "Causes that these recordings could not have shown below the size in the last column.",
        [
            vec![Cell::text("cause")],
            ["share that a refit absorbs", "smallest visible size"]
                .map(Cell::number)
                .to_vec(),
            vec![Cell::text("would be brought out by")],
        ]
        .concat(),
    );
    for h in &d.hidden {
        let size = number::sized(h.smallest_detectable, &h.unit, 2);
        table.row(vec![
            Cell::text(plain_name(h.effect)),
            // Three nines say more than 100 %.
            Cell::number(format!("{} %", number::fixed(100.0 * h.hidden_share, 1))),
            Cell::number(format!("{} {size}", h.name.replace('_', " "))),
            Cell::text(brought_out_by(d.rig, h.effect)),
        ]);
    }
    let context = context! { table => table.html() };
    let template = "<p>That a cause is not named above does not mean that it is absent: moduli, relaxation times and the forearm's curve can imitate much. Each row says how much of a cause's trace a refit would have swallowed.</p>\n{{ table }}\n";
    Some(Section::new(
        "hidden",
        "What could not have been seen",
        template,
        context,
    ))
}
