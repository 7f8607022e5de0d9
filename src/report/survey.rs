//! A bare file in words, and the `recording.toml` to start from.

use std::fmt::Write;
use std::path::Path;

use crate::recording::{ColumnRef, DoubtKind, Level, MarkerSurvey, Note, SectionSurvey, Survey};
use crate::units::{Dimension, TimeScale, Unit};

/// Lines shown of what there may be many of; `import.json` has all.
const SHOWN: usize = 30;

/// How much looks wrong, in words.
#[must_use]
pub fn looks(things: usize) -> String {
    match things {
        0 => "nothing looks wrong".to_owned(),
        1 => "one thing to look at".to_owned(),
        n => format!("{n} things to look at"),
    }
}

/// What looks wrong in a file.
fn warnings(survey: &Survey) -> impl Iterator<Item = &Note> {
    survey.notes.iter().filter(|n| n.level == Level::Warning)
}

/// How many things in a file look wrong.
#[must_use]
pub fn things(survey: &Survey) -> usize {
    survey.doubts.len() + warnings(survey).count()
}

/// What is in a file, line by line, for a terminal: first what looks wrong.
#[must_use]
pub fn lines(path: &Path, survey: &Survey) -> Vec<String> {
    let looks = looks(things(survey));
    let mut out = vec![format!("{}: {}; {looks}", path.display(), survey.format)];
    for note in warnings(survey) {
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
            // what has no name of its own is called by its table
            let mut names: Vec<&str> = of_kind[6..]
                .iter()
                .flat_map(|d| match d.what.as_slice() {
                    [] => std::slice::from_ref(&d.section),
                    what => what,
                })
                .map(String::as_str)
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
    for s in &survey.sections {
        section(s, &mut out);
    }
    out
}

/// `1 gap`, `2 gaps`.
#[must_use]
pub fn count(n: usize, what: &str) -> String {
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
    let mut head = format!("  {}: {}", s.name, count(s.rows, "row"));
    if let Some(rate) = s.rate_hz {
        let _ = write!(head, " at {} Hz", short(rate));
    }
    if let Some([first, last]) = s.frames {
        let _ = write!(head, ", frames {first} to {last}");
    }
    match s.time_s {
        Some([at, to]) if s.rows == 1 || at == to => {
            let _ = write!(head, ", at {}", TimeScale::new(at, None).text(at));
        }
        Some([from, to]) => {
            let times = TimeScale::new(from.abs().max(to.abs()), s.rate_hz.map(f64::recip));
            let _ = write!(head, ", {} to {}", times.number(from), times.text(to));
        }
        None => {}
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

/// A table of a file.
#[derive(Clone, Copy)]
struct Place<'a> {
    file: &'a str,
    survey: &'a Survey,
    index: usize,
}

impl<'a> Place<'a> {
    fn section(&self) -> &'a SectionSurvey {
        &self.survey.sections[self.index]
    }

    /// A column as a manifest names it, and no other.
    fn column(&self, i: usize) -> String {
        match self.survey.column_ref(self.index, i) {
            Some(ColumnRef::Name(name)) => quoted(&name),
            Some(ColumnRef::Number(number)) => number.to_string(),
            None => quoted(&self.section().columns[i].title),
        }
    }

    /// The lines that say where the times are, each behind `mark`.
    fn clock(&self, mark: &str, out: &mut String) {
        let s = self.section();
        if s.frames.is_some() {
            return;
        }
        if s.has_own_clock() {
            let rate = s
                .rate_hz
                .map_or(String::new(), |r| format!(", {} Hz", short(r)));
            let _ = writeln!(out, "{mark}# the times are the file's own{rate}");
            return;
        }
        let rising = || s.columns.iter().position(|c| c.rises && c.unit.is_empty());
        let Some(c) = s.time_column.or_else(rising) else {
            let _ = writeln!(
                out,
                "{mark}# rate_hz = 1000.0             # ? the file has no clock: state its samples per second"
            );
            return;
        };
        let guess = match s.time_column {
            Some(_) => "",
            None => "  # ? it rises from row to row",
        };
        let _ = writeln!(out, "{mark}time = {}{guess}", self.column(c));
        let step = s.columns[c].range.map_or(f64::NAN, |[a, b]| {
            #[allow(clippy::cast_precision_loss)]
            let steps = s.rows.saturating_sub(1) as f64;
            (b - a) / steps
        });
        // the largest unit in which there is a sample a second
        let likely = ["s", "ms", "us", "ns"]
            .into_iter()
            .find(|u| Unit::parse(u).is_some_and(|u| step * u.to_si <= 1.0));
        if s.columns[c].unit.is_empty()
            && let Some(unit) = likely
            && let Some(known) = Unit::parse(unit)
        {
            let _ = writeln!(
                out,
                "{mark}time_unit = {}              # ? a sample every {} {unit}: {} Hz",
                quoted(unit),
                short(step),
                short(1.0 / (step * known.to_si))
            );
        }
    }
}

/// Markers of a table with how far they move, the farthest first. A single row shows no motion.
fn movers(s: &SectionSurvey) -> Vec<(f64, &MarkerSurvey)> {
    let mut all: Vec<(f64, &MarkerSurvey)> = s
        .markers
        .iter()
        .map(|m| (travel(s, m), m))
        .filter(|(t, _)| t.is_finite() && s.rows > 1)
        .collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0));
    all
}

/// A length of a table in m; what has no unit is taken for mm.
fn metres(s: &SectionSurvey, m: &MarkerSurvey, length: f64) -> f64 {
    length * Unit::parse(&s.columns[m.columns[0]].unit).map_or(1e-3, |u| u.to_si)
}

/// The table whose markers are the motion: the first with markers that were seen in more than one row; of
/// topics, which are a table each, the one that moves farthest.
fn motion_place<'a>(places: &[Place<'a>]) -> Option<Place<'a>> {
    let far = |p: &Place| {
        let s = p.section();
        movers(s).first().map_or(0.0, |(t, m)| metres(s, m, *t))
    };
    let mut seen = places.iter().filter(|p| !movers(p.section()).is_empty());
    let mut best = *seen.next()?;
    if best.section().has_own_clock() {
        let own = |p: &&Place| p.file == best.file && p.section().has_own_clock();
        for p in seen.filter(own).copied().collect::<Vec<_>>() {
            if far(&p) > far(&best) {
                best = p;
            }
        }
    }
    Some(best)
}

/// The marker that moves least: of the same table, or where each marker is a table of its own, of the others
/// of the file.
fn base<'a>(places: &[Place<'a>], motion: Place<'a>) -> Option<(f64, &'a MarkerSurvey, &'a str)> {
    let s = motion.section();
    let unit = |s: &'a SectionSurvey, m: &MarkerSurvey| s.columns[m.columns[0]].unit.as_str();
    if let [_, .., (near, rests)] = movers(s).as_slice() {
        return Some((*near, rests, unit(s, rests)));
    }
    places
        .iter()
        .filter(|p| p.file == motion.file && p.index != motion.index)
        .flat_map(|p| {
            movers(p.section())
                .into_iter()
                .map(move |(t, m)| (t, m, p.section()))
        })
        .filter(|(_, m, _)| s.markers.iter().all(|own| own.label != m.label))
        .min_by(|a, b| metres(a.2, a.1, a.0).total_cmp(&metres(b.2, b.1, b.0)))
        .map(|(t, m, s)| (t, m, unit(s, m)))
}

/// A `recording.toml` to start from, for files beside it, of a recording that is called `id`. What is a guess has a question mark behind it; what
/// the files do not say is left to be filled in.
#[must_use]
pub fn manifest(id: &str, files: &[(String, &Survey)]) -> String {
    let places: Vec<Place> = files
        .iter()
        .flat_map(|(file, survey)| {
            (0..survey.sections.len()).map(move |index| Place {
                file,
                survey,
                index,
            })
        })
        .collect();
    let motion = motion_place(&places);
    let in_volts = |s: &SectionSurvey| -> Vec<usize> {
        (0..s.columns.len())
            .filter(|i| {
                Unit::parse(&s.columns[*i].unit).is_some_and(|u| matches!(u.symbol, "V" | "kV"))
            })
            .collect()
    };
    let volts = places
        .iter()
        .filter(|p| p.section().rows > 1)
        .find_map(|p| Some((*p, in_volts(p.section()))).filter(|(_, c)| !c.is_empty()));
    let mut out = String::from(
        "# A start, from what is in the files: lines with a question mark are guesses. Check them, then: deacal import .\n\n",
    );
    let _ = write!(
        out,
        "[recording]\nid = {}\nkind = \"robot\"                 # ? or film-sample, film-coupon, hinge-bench, axis\nrig = \"rig.toml\"               # ? where the robot is described\npayload_g = 0.0                # ? mass added to the end effector\nfilm_state = \"relaxed\"         # ? \"virgin\" where the film was stretched just now\n",
        quoted(id)
    );
    match motion {
        Some(place) => moving(place, base(&places, place), &mut out),
        None if places.iter().any(|p| !p.section().markers.is_empty()) => {
            out += "\n# [motion]                     # ? no marker was seen in more than one row\n";
        }
        None => out += "\n# [motion]                     # ? no marker is in the files\n",
    }
    match volts {
        Some((place, columns)) => driven(place, &columns, &mut out),
        None => {
            let other = |p: &&Place| {
                let s = p.section();
                s.groups.is_empty() && s.markers.is_empty() && s.rows > 1
            };
            let without_unit = places.iter().filter(other).find_map(|p| {
                let s = p.section();
                let columns: Vec<usize> = (0..s.columns.len())
                    .filter(|i| s.columns[*i].unit.is_empty())
                    .filter(|i| s.time_column != Some(*i) && !s.columns[*i].rises)
                    .collect();
                Some((*p, columns)).filter(|(_, c)| !c.is_empty())
            });
            undriven(without_unit, &mut out);
        }
    }
    out
}

/// `[motion]`.
fn moving(place: Place, base: Option<(f64, &MarkerSurvey, &str)>, out: &mut String) {
    let s = place.section();
    let all = movers(s);
    let unit = &s.columns[s.markers[0].columns[0]].unit;
    let _ = write!(out, "\n[motion]\nfile = {}\n", quoted(place.file));
    if Unit::parse(unit).is_none_or(|u| u.dimension != Dimension::Length) {
        *out += "unit = \"mm\"                    # ? the file does not say\n";
    }
    if let Some((far, moves)) = all.first() {
        let _ = writeln!(
            out,
            "end_effector = {}  # ? of {} it moves most: {} {unit}",
            quoted(&moves.label),
            count(all.len(), "position"),
            short(*far)
        );
    }
    if let Some((near, rests, unit)) = base {
        let _ = writeln!(
            out,
            "base = {}  # ? it moves least: {} {unit}\nbase_position_mm = [0.0, 0.0, 0.0]           # ? of the base marker in the robot's axes",
            quoted(&rests.label),
            short(near)
        );
    }
    *out += "end_effector_offset_mm = [0.0, 0.0, 0.0]     # ? from the end effector's centre to its marker\nrotation_deg = [0.0, 0.0, 0.0]               # ? capture axes to robot axes: v = Rx Ry Rz v_capture\n";
    place.clock("", out);
}

/// `[voltage]` and `[sync]`, with columns in V or kV.
fn driven(place: Place, columns: &[usize], out: &mut String) {
    let s = place.section();
    let channels: Vec<String> = columns.iter().take(3).map(|c| place.column(*c)).collect();
    // a table that cannot be read yet is worse than one that says what is missing
    let mark = if channels.len() == 3 { "" } else { "# " };
    let _ = write!(
        out,
        "\n{mark}[voltage]\n{mark}file = {}\n",
        quoted(place.file)
    );
    place.clock(mark, out);
    let _ = writeln!(
        out,
        "{mark}channels = [{}]  # ? chains 1, 2, 3{}",
        channels.join(", "),
        match columns.len() {
            3 => String::new(),
            1 => "; 1 column is a voltage".to_owned(),
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
    *out += "\n[sync]\noffset_s = 0.0                 # ? voltage clock minus motion clock; \"estimate\" lets the fit find it\n";
}

/// `[voltage]` to be filled in: of a table that names no unit, or of none.
fn undriven(table: Option<(Place, Vec<usize>)>, out: &mut String) {
    *out += "\n# [voltage]                    # ? no column in V or kV is in the files\n";
    let Some((place, columns)) = table else {
        *out += "# file = \"voltage.csv\"\n# time = \"time_s\"\n# channels = [\"phi1_kV\", \"phi2_kV\", \"phi3_kV\"]\n";
        return;
    };
    let _ = writeln!(out, "# file = {}", quoted(place.file));
    place.clock("# ", out);
    let channels: Vec<String> = columns.iter().take(3).map(|c| place.column(*c)).collect();
    let _ = writeln!(
        out,
        "# channels = [{}]  # ? chains 1, 2, 3; which are the voltages?\n# unit = \"V\"                   # ? or \"kV\"",
        channels.join(", ")
    );
    for c in columns.iter().take(SHOWN) {
        let column = &place.section().columns[*c];
        let _ = writeln!(out, "#   {}: {}", place.column(*c), range(column.range));
    }
}
