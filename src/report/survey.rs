//! A bare file in words, and the `recording.toml` to start from.

use std::fmt::Write;
use std::path::Path;

use crate::recording::{DoubtKind, Level, MarkerSurvey, SectionSurvey, Survey};
use crate::units::{Dimension, Unit};

/// Lines shown of what there may be many of; `import.json` has all.
const SHOWN: usize = 30;

/// What is in a file, line by line, for a terminal.
#[must_use]
pub fn lines(path: &Path, survey: &Survey) -> Vec<String> {
    let mut out = vec![format!("{}: {}", path.display(), survey.format)];
    for s in &survey.sections {
        section(s, &mut out);
    }
    for note in survey.notes.iter().filter(|n| n.level == Level::Warning) {
        let line = note.line.map_or(String::new(), |l| format!("line {l}: "));
        out.push(format!("  ! {line}{}", note.text));
    }
    for kind in [
        DoubtKind::Unit,
        DoubtKind::Clock,
        DoubtKind::Swap,
        DoubtKind::Frozen,
        DoubtKind::Spikes,
        DoubtKind::Clipped,
    ] {
        let of_kind: Vec<_> = survey.doubts.iter().filter(|d| d.kind == kind).collect();
        out.extend(of_kind.iter().take(6).map(|d| format!("  ? {}", d.says)));
        if of_kind.len() > 6 {
            let mut names: Vec<&str> = of_kind[6..]
                .iter()
                .flat_map(|d| d.what.iter().map(String::as_str))
                .collect();
            let more = names.len();
            names.truncate(12);
            out.push(format!(
                "  ? {} the same ({}): {}{}",
                of_kind.len() - 6,
                kind.name(),
                names.join(", "),
                if more > 12 { ", ..." } else { "" }
            ));
        }
    }
    if survey.doubts.is_empty() {
        out.push("  nothing looks wrong".to_owned());
    }
    out
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

const NEVER: &str = "never seen";

fn range(values: Option<[f64; 2]>) -> String {
    values.map_or(NEVER.to_owned(), |[a, b]| {
        format!("{} to {}", short(a), short(b))
    })
}

/// Six digits, as instruments write.
fn short(v: f64) -> String {
    if v == 0.0 {
        return "0".to_owned();
    }
    if !(1e-4..1e7).contains(&v.abs()) {
        return format!("{v:.3e}");
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let digits = (5.0 - v.abs().log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{v:.digits$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

fn section(s: &SectionSurvey, out: &mut Vec<String>) {
    let mut head = format!("  {}: {} rows", s.name, s.rows);
    if let Some(rate) = s.rate_hz {
        let _ = write!(head, " at {} Hz", short(rate));
    }
    if let Some([first, last]) = s.frames {
        let _ = write!(head, ", frames {first} to {last}");
    }
    if let Some([from, to]) = s.time_s {
        let _ = write!(head, ", {from:.3} to {to:.3} s");
    }
    out.push(head);

    let mut in_markers = vec![false; s.columns.len()];
    for m in &s.markers {
        m.columns.iter().for_each(|c| in_markers[*c] = true);
    }
    if !s.markers.is_empty() {
        let with_gaps = s.groups.iter().filter(|g| g.gaps.missing > 0).count();
        let missing: usize = s.groups.iter().map(|g| g.gaps.missing).sum();
        let unit = &s.columns[s.markers[0].columns[0]].unit;
        let unit = if unit.is_empty() {
            "no unit stated"
        } else {
            unit
        };
        let mut text = format!("    {} ({unit})", count(s.markers.len(), "position"));
        if missing > 0 {
            let _ = write!(
                text,
                ", {with_gaps} with gaps, {} missing",
                count(missing, "sample")
            );
        }
        out.push(text);
        let widest = s
            .markers
            .iter()
            .take(SHOWN)
            .map(|m| m.label.chars().count())
            .max();
        let width = widest.unwrap_or(0).min(40);
        for m in s.markers.iter().take(SHOWN) {
            out.push(marker(s, m, width));
        }
        more(s.markers.len(), "markers", out);
    }
    let rest: Vec<_> = s
        .columns
        .iter()
        .zip(&in_markers)
        .filter(|(c, of_marker)| !**of_marker && c.axis != "residual")
        .map(|(c, _)| c)
        .collect();
    let width = rest
        .iter()
        .take(SHOWN)
        .map(|c| c.title.chars().count())
        .max();
    let width = width.unwrap_or(0).min(40);
    for c in rest.iter().take(SHOWN) {
        let unit = if c.unit.is_empty() { "-" } else { &c.unit };
        let mut text = format!("    {:width$}  {unit:6}  {}", c.title, range(c.range));
        if c.missing > 0 {
            let _ = write!(text, "; {} missing", c.missing);
        }
        out.push(text);
    }
    more(rest.len(), "columns", out);
    let residual = s
        .columns
        .iter()
        .filter(|c| c.axis == "residual")
        .filter_map(|c| Some((c.range?[1], c)))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((largest, c)) = residual {
        out.push(format!(
            "    residuals up to {} {} ({})",
            short(largest),
            c.unit,
            c.title.trim_end_matches("/residual")
        ));
    }
}

fn more(count: usize, what: &str, out: &mut Vec<String>) {
    if count > SHOWN {
        out.push(format!("    and {} {what} more", count - SHOWN));
    }
}

fn marker(s: &SectionSurvey, m: &MarkerSurvey, width: usize) -> String {
    let ranges = m.columns.map(|c| s.columns[c].range);
    let mut text = format!("    {:width$}  ", m.label);
    if ranges.iter().all(Option::is_none) {
        return text + NEVER;
    }
    let [x, y, z] = ranges.map(range);
    let _ = write!(text, "x {x}, y {y}, z {z}");
    let group = s.groups.iter().find(|g| g.columns.contains(&m.columns[0]));
    if let Some(g) = group.filter(|g| g.gaps.missing > 0) {
        let _ = write!(
            text,
            "; {} missing in {}",
            g.gaps.missing,
            count(g.gaps.runs, "gap")
        );
        match s.rate_hz {
            #[allow(clippy::cast_precision_loss)]
            Some(rate) => {
                let _ = write!(text, ", the longest {:.2} s", g.longest_gap as f64 / rate);
            }
            None => {
                let _ = write!(text, ", the longest {} rows", g.longest_gap);
            }
        }
    }
    text
}

/// How far a marker moved in all, in the unit of the file.
fn travel(s: &SectionSurvey, m: &MarkerSurvey) -> f64 {
    let sides = m
        .columns
        .map(|c| s.columns[c].range.map_or(f64::NAN, |[a, b]| b - a));
    sides.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// A `recording.toml` to start from, for files beside it. What is a guess has a question mark behind it.
#[must_use]
pub fn manifest(files: &[(String, &Survey)]) -> String {
    let mut motion = None;
    let mut volts = None;
    for (name, survey) in files {
        for s in &survey.sections {
            if motion.is_none() && !s.markers.is_empty() {
                motion = Some((name, s));
            }
            let columns: Vec<usize> = (0..s.columns.len())
                .filter(|i| {
                    Unit::parse(&s.columns[*i].unit).is_some_and(|u| matches!(u.symbol, "V" | "kV"))
                })
                .collect();
            if volts.is_none() && !columns.is_empty() {
                volts = Some((name, s, columns));
            }
        }
    }
    let id = files.first().map_or("recording", |(name, _)| name.as_str());
    let id = Path::new(id)
        .file_stem()
        .map_or("recording".into(), |s| s.to_string_lossy());
    let mut out = String::from(
        "# A start, from what is in the files: lines with a question mark are guesses. Check them, then: deacal import .\n\n",
    );
    let _ = write!(
        out,
        "[recording]\nid = {}\nkind = \"robot\"                 # ? or film-sample, film-coupon, hinge-bench, axis\nrig = \"rig.toml\"               # ? where the robot is described\npayload_g = 0.0                # ? mass added to the end effector\nfilm_state = \"relaxed\"         # ? \"virgin\" where the film was stretched just now\n",
        quoted(&id)
    );
    match motion {
        Some((name, s)) => {
            let mut by_travel: Vec<(f64, &MarkerSurvey)> = s
                .markers
                .iter()
                .map(|m| (travel(s, m), m))
                .filter(|(t, _)| t.is_finite())
                .collect();
            by_travel.sort_by(|a, b| b.0.total_cmp(&a.0));
            let unit = &s.columns[s.markers[0].columns[0]].unit;
            let _ = write!(out, "\n[motion]\nfile = {}\n", quoted(name));
            if Unit::parse(unit).is_none_or(|u| u.dimension != Dimension::Length) {
                out += "unit = \"mm\"                    # ? the file does not say\n";
            }
            match by_travel.as_slice() {
                [] => out += "end_effector = \"*\"            # ? no marker was ever seen\n",
                all @ [(far, moves), ..] => {
                    let _ = writeln!(
                        out,
                        "end_effector = {}  # ? of {} it moves most: {} {unit}",
                        quoted(&moves.label),
                        count(all.len(), "position"),
                        short(*far)
                    );
                    if let [_, .., (near, rests)] = all {
                        let _ = writeln!(
                            out,
                            "base = {}  # ? it moves least: {} {unit}\nbase_position_mm = [0.0, 0.0, 0.0]           # ? of the base marker in the robot's axes",
                            quoted(&rests.label),
                            short(*near)
                        );
                    }
                    out += "end_effector_offset_mm = [0.0, 0.0, 0.0]     # ? from the end effector's centre to its marker\nrotation_deg = [0.0, 0.0, 0.0]               # ? capture axes to robot axes: v = Rx Ry Rz v_capture\n";
                }
            }
            if s.frames.is_none() {
                match s.time_column {
                    Some(c) => {
                        let _ = writeln!(out, "time = {}", column(s, c));
                    }
                    None => out += "rate_hz = 100.0                # ? the file has no clock\n",
                }
            }
        }
        None => out += "\n# [motion]                     # ? no marker is in the files\n",
    }
    match volts {
        Some((name, s, columns)) => {
            let channels: Vec<String> = columns.iter().take(3).map(|c| column(s, *c)).collect();
            // a table that cannot be read yet is worse than one that says what is missing
            let mark = if channels.len() == 3 { "" } else { "# " };
            let _ = write!(out, "\n{mark}[voltage]\n{mark}file = {}\n", quoted(name));
            if s.frames.is_none() {
                match s.time_column {
                    Some(c) => {
                        let _ = writeln!(out, "{mark}time = {}", column(s, c));
                    }
                    None => {
                        let _ = writeln!(
                            out,
                            "{mark}rate_hz = 1000.0               # ? the file has no clock"
                        );
                    }
                }
            }
            let _ = writeln!(
                out,
                "{mark}channels = [{}]  # ? chains 1, 2, 3{}",
                channels.join(", "),
                match columns.len() {
                    3 => String::new(),
                    n => format!("; {n} columns are voltages"),
                }
            );
            let largest = columns
                .iter()
                .take(3)
                .filter_map(|c| {
                    let to_si = Unit::parse(&s.columns[*c].unit)?.to_si;
                    Some(s.columns[*c].range?.map(|v| (v * to_si).abs()))
                })
                .flatten()
                .fold(0.0, f64::max);
            if largest < 20.0 {
                let _ = writeln!(
                    out,
                    "{mark}# scale = 1000.0               # ? the largest is {} V: a monitor output of 1 V for 1 kV?",
                    short(largest)
                );
            }
            out += "\n[sync]\noffset_s = 0.0                 # ? voltage clock minus motion clock; \"estimate\" lets the fit find it\n";
        }
        None => {
            out += "\n# [voltage]                    # ? no column in V or kV is in the files\n# file = \"voltage.csv\"\n# time = \"time_s\"\n# channels = [\"phi1_kV\", \"phi2_kV\", \"phi3_kV\"]\n"
        }
    }
    out
}

/// A column as a manifest names it.
fn column(s: &SectionSurvey, i: usize) -> String {
    let c = &s.columns[i];
    let group = s.groups.iter().find(|g| g.columns.contains(&i));
    match (group, c.axis.as_str()) {
        (Some(g), "") => quoted(&g.name),
        (Some(g), axis) => quoted(&format!("{}:{axis}", g.name)),
        (None, "") => c.number.to_string(),
        (None, axis) => quoted(axis),
    }
}
