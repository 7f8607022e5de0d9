//! Drawings as inline SVG. They know curves, bands and axes, and nothing of what these mean.
//!
//! Shapes are drawn by `plotters` on a canvas four times finer than its units. A drawing has no colour of its
//! own: each [`Role`] is drawn in a marker colour, which `themed` replaces by a CSS class, so that the style
//! sheet of the page decides (light, dark, print), and text takes the font and size of the page.

use std::fmt::Write as _;

use plotters::coord::Shift;
use plotters::element::{Circle, PathElement, Polygon, Rectangle};
use plotters::prelude::{DrawingArea, IntoDrawingArea, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, FontTransform, IntoFont, RGBAColor, RGBColor, ShapeStyle, TextStyle};

use super::number;
use super::page::escape;
use super::reduce;

/// Canvas points per unit of a drawing; a unit is about a pixel of a small drawing.
const FINE: f64 = 4.0;
/// Marks a colour as a role.
const MARKER: u8 = 0xdc;

/// What a shape is for; the style sheet gives it a colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Text and marks that must be seen.
    Ink,
    /// Secondary text.
    Muted,
    /// Grid lines.
    Grid,
    /// Axis and zero lines.
    Rule,
    /// The thing that others are held against, drawn broad and grey.
    Base,
    /// First colour (blue).
    One,
    /// Second colour (vermilion).
    Two,
    /// Third colour (green).
    Three,
    /// Fourth colour (orange).
    Four,
    /// Fifth colour (purple).
    Five,
    /// Shade over something missing.
    Gap,
    /// Shade over something that does not count.
    Skip,
}

impl Role {
    const ALL: [Role; 12] = [
        Role::Ink,
        Role::Muted,
        Role::Grid,
        Role::Rule,
        Role::Base,
        Role::One,
        Role::Two,
        Role::Three,
        Role::Four,
        Role::Five,
        Role::Gap,
        Role::Skip,
    ];

    /// Its class in the style sheet, behind `s-` for strokes and `f-` for fills.
    pub fn class(self) -> &'static str {
        match self {
            Role::Ink => "ink",
            Role::Muted => "muted",
            Role::Grid => "grid",
            Role::Rule => "rule",
            Role::Base => "base",
            Role::One => "one",
            Role::Two => "two",
            Role::Three => "three",
            Role::Four => "four",
            Role::Five => "five",
            Role::Gap => "gap",
            Role::Skip => "skip",
        }
    }

    fn colour(self, dashed: bool) -> RGBColor {
        RGBColor(self as u8, u8::from(dashed), MARKER)
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A thin line.
    Line,
    /// A broad line, to lie under a thin one.
    Broad,
    /// A dashed line.
    Dashed,
    /// Dots alone.
    Dots,
}

/// A named curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend; none when empty.
    pub name: String,
    /// Colour.
    pub role: Role,
    /// Line or dots.
    pub mark: Mark,
    /// x and y; a value that is not finite breaks the line.
    pub points: Vec<[f64; 2]>,
}

/// A named band around a curve.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Name in the legend; none when empty.
    pub name: String,
    /// Colour.
    pub role: Role,
    /// x, lower and upper edge.
    pub rows: Vec<[f64; 3]>,
}

/// Named stretches of the x axis, shaded over the full height.
#[derive(Debug, Clone, PartialEq)]
pub struct Shade {
    /// Name in the legend; none when empty.
    pub name: String,
    /// Colour.
    pub role: Role,
    /// From, to.
    pub spans: Vec<[f64; 2]>,
}

/// An axis. The title carries the unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Title with unit.
    pub title: String,
    /// First and last value; what the data span where it is `None`.
    pub range: Option<[f64; 2]>,
}

impl Axis {
    /// An axis that spans its data.
    pub fn new(title: impl Into<String>) -> Self {
        Axis {
            title: title.into(),
            range: None,
        }
    }

    /// An axis over a given range; values beyond it are drawn at its edge.
    pub fn over(title: impl Into<String>, range: [f64; 2]) -> Self {
        Axis {
            title: title.into(),
            range: Some(range),
        }
    }
}

/// One of several plots above each other that share their x axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Vertical axis.
    pub y: Axis,
    /// Height of the plotting area, units.
    pub height: f64,
    /// Shaded stretches, lowest.
    pub shades: Vec<Shade>,
    /// Bands, above them.
    pub bands: Vec<Band>,
    /// Curves, on top.
    pub series: Vec<Series>,
}

impl Panel {
    /// Curves alone.
    pub fn new(title: impl Into<String>, height: f64, series: Vec<Series>) -> Self {
        Panel {
            y: Axis::new(title),
            height,
            shades: Vec::new(),
            bands: Vec::new(),
            series,
        }
    }
}

/// Width of a drawing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// The full width of the page.
    Full,
    /// A part of it: two or three stand side by side where there is room.
    Part,
}

impl Width {
    fn units(self) -> f64 {
        match self {
            Width::Full => 720.0,
            Width::Part => 340.0,
        }
    }

    fn class(self) -> &'static str {
        match self {
            Width::Full => "full",
            Width::Part => "part",
        }
    }
}

/// Plots above each other on one x axis. `label` says in words what is drawn.
pub fn line_plot(label: &str, x: &Axis, panels: &[Panel], width: Width) -> String {
    let span = x.range.unwrap_or_else(|| {
        let all = panels.iter().flat_map(|p| {
            let series = p.series.iter().flat_map(|s| &s.points).map(|p| p[0]);
            series.chain(p.bands.iter().flat_map(|b| &b.rows).map(|r| r[0]))
        });
        extent(all)
    });
    stacked(label, &x.title, span, panels, width, false)
}

/// Curves that run back and forth over x, in one part-width plot.
pub fn loops(label: &str, x: &Axis, y: &Axis, series: Vec<Series>) -> String {
    let all = series.iter().flat_map(|s| &s.points).map(|p| p[0]);
    let span = x.range.unwrap_or_else(|| padded(extent(all)));
    let panel = Panel {
        y: y.clone(),
        height: 230.0,
        shades: Vec::new(),
        bands: Vec::new(),
        series,
    };
    stacked(label, &x.title, span, &[panel], Width::Part, true)
}

fn stacked(
    label: &str,
    x_title: &str,
    span: [f64; 2],
    panels: &[Panel],
    width: Width,
    both: bool,
) -> String {
    const HEAD: f64 = 28.0;
    const FOOT: f64 = 47.0;
    let height = FOOT + panels.iter().map(|p| HEAD + p.height).sum::<f64>();
    let size = [width.units(), height];
    let mut top = 0.0;
    let frame = |panel: &Panel| {
        top += HEAD;
        let y = panel.y.range.unwrap_or_else(|| {
            let series = panel.series.iter().flat_map(|s| &s.points);
            let bands = panel.bands.iter().flat_map(|b| &b.rows);
            let values = series.map(|p| p[1]);
            padded(extent(values.chain(bands.flat_map(|r| [r[1], r[2]]))))
        });
        let frame = Frame {
            left: 50.0,
            right: size[0] - 8.0,
            top,
            bottom: top + panel.height,
            x: span,
            y,
        };
        top += panel.height;
        frame
    };
    let frames: Vec<Frame> = panels.iter().map(frame).collect();
    let axes = axes_of(x_title, span, panels, &frames, both);
    canvas_of(label, width.class(), size, &axes, |c| {
        for (number, (panel, frame)) in panels.iter().zip(&frames).enumerate() {
            c.panel(frame, panel, number + 1 == panels.len(), both);
        }
        let middle = (50.0 + size[0] - 8.0) / 2.0;
        c.text(
            x_title,
            [middle, height - 3.0],
            Role::Muted,
            HPos::Center,
            VPos::Bottom,
        );
    })
}

/// What the script of the page needs to tell values from places: the axes with their ranges, and where they
/// lie on the canvas.
fn axes_of(x: &str, span: [f64; 2], panels: &[Panel], frames: &[Frame], both: bool) -> String {
    let panel = |(panel, f): (&Panel, &Frame)| {
        let place = [f.top, f.bottom].map(|v| v * FINE);
        serde_json::json!({ "title": panel.y.title, "y": f.y, "at": place })
    };
    let sides = frames
        .first()
        .map_or([0.0; 2], |f| [f.left, f.right].map(|v| v * FINE));
    let panels: Vec<_> = panels.iter().zip(frames).map(panel).collect();
    serde_json::json!({ "title": x, "x": span, "at": sides, "loops": both, "panels": panels })
        .to_string()
}

/// One bar: colour, length.
pub type Bar = (Role, f64);

/// Horizontal bars in named groups, each bar with its value at its end. Bars of one group differ by colour.
pub fn bars(label: &str, x_title: &str, groups: &[(String, Vec<Bar>)]) -> String {
    const NAME: f64 = 20.0;
    const BAR: f64 = 11.0;
    const REST: f64 = 6.0;
    let width = Width::Part;
    let rows: f64 = groups
        .iter()
        .map(|g| NAME + BAR * g.1.len() as f64 + REST)
        .sum();
    let size = [width.units(), rows + 50.0];
    let most = groups.iter().flat_map(|g| &g.1).map(|b| b.1);
    let most = most.filter(|v| v.is_finite()).fold(0.0, f64::max);
    let frame = Frame {
        left: 2.0,
        right: size[0] - 44.0,
        top: 0.0,
        bottom: rows,
        x: [0.0, if most > 0.0 { most } else { 1.0 }],
        y: [0.0, 1.0],
    };
    canvas(label, "part bars", size, |c| {
        c.x_ticks(&frame, 4);
        let mut top = 0.0;
        for (name, bars) in groups {
            c.text(
                name,
                [2.0, top + NAME - 4.0],
                Role::Ink,
                HPos::Left,
                VPos::Bottom,
            );
            top += NAME;
            for (role, value) in bars {
                let end = if value.is_finite() {
                    frame.x_at(*value)
                } else {
                    frame.left
                };
                if end > frame.left {
                    let corners = (
                        [frame.left, top + 0.5],
                        [end.max(frame.left + 0.5), top + BAR - 0.5],
                    );
                    c.rectangle(corners.0, corners.1, *role, 1.0);
                }
                let text = if *value > 0.0 && *value < 2e-4 * most {
                    "\u{2248} 0".to_string()
                } else {
                    number::significant(*value, 2)
                };
                c.text(
                    &text,
                    [end + 4.0, top + BAR / 2.0],
                    Role::Muted,
                    HPos::Left,
                    VPos::Center,
                );
                top += BAR;
            }
            top += REST;
        }
        c.line(&[[2.0, 0.0], [2.0, rows]], Role::Rule, 1.0, false);
        let middle = (frame.left + frame.right) / 2.0;
        let at = [middle, size[1] - 3.0];
        c.text(x_title, at, Role::Muted, HPos::Center, VPos::Bottom);
    })
}

/// Values by rank on a logarithmic axis; those for which `reached` holds stand out.
pub fn waterfall(
    label: &str,
    x_title: &str,
    y_title: &str,
    values: &[f64],
    reached: impl Fn(f64) -> bool,
) -> String {
    let width = Width::Part;
    let size = [width.units(), 230.0];
    let logs = values.iter().filter(|v| **v > 0.0).map(|v| v.log10());
    let [mut low, mut high] = extent(logs);
    // Less than a tenth between best and worst is one height: noise of the search must not look like a cliff.
    let least = 0.05;
    if high - low < least {
        let middle = (low + high) / 2.0;
        (low, high) = (middle - least / 2.0, middle + least / 2.0);
    }
    let margin = 0.08 * (high - low);
    let frame = Frame {
        left: 50.0,
        right: size[0] - 8.0,
        top: 28.0,
        bottom: size[1] - 50.0,
        x: [0.5, values.len().max(1) as f64 + 0.5],
        y: [low - margin, high + margin],
    };
    canvas(label, width.class(), size, |c| {
        let marks = log_ticks(frame.y);
        for (mark, text) in marks.iter().zip(number::tick_labels(&marks)) {
            c.y_tick(&frame, mark.log10(), &text);
        }
        let every = values.len().div_ceil(10).max(1);
        for rank in (1..=values.len()).step_by(every) {
            c.x_tick(&frame, rank as f64, &rank.to_string(), false);
        }
        c.frame(&frame, y_title);
        let point = |(i, v): (usize, &f64)| [frame.x_at(i as f64 + 1.0), frame.y_at(v.log10())];
        let points: Vec<[f64; 2]> = values
            .iter()
            .enumerate()
            .filter(|(_, v)| v.is_finite() && **v > 0.0)
            .map(point)
            .collect();
        c.line(&points, Role::Base, 1.5, false);
        let finite = values.iter().filter(|v| v.is_finite() && **v > 0.0);
        for (at, value) in points.iter().zip(finite) {
            let role = if reached(*value) {
                Role::One
            } else {
                Role::Two
            };
            c.dot(*at, 4.0, role);
        }
        let middle = (frame.left + frame.right) / 2.0;
        let at = [middle, size[1] - 3.0];
        c.text(x_title, at, Role::Muted, HPos::Center, VPos::Bottom);
    })
}

/// Sizes above zero by name on a logarithmic axis up to 1000, each a dot at the end of a line; `mark` is
/// drawn across.
pub fn forest(label: &str, x_title: &str, rows: &[(String, f64, Role)], mark: f64) -> String {
    const ROW: f64 = 17.0;
    let width = Width::Part;
    let longest = rows.iter().map(|r| r.0.chars().count()).max().unwrap_or(0) as f64;
    let bottom = 6.0 + ROW * rows.len() as f64;
    let size = [width.units(), bottom + 47.0];
    let known = rows.iter().map(|r| r.1).filter(|v| *v > 0.0);
    let [low, high] = extent(known.chain([mark]).map(f64::log10));
    let frame = Frame {
        left: 14.0 + 7.0 * longest,
        right: size[0] - 14.0,
        top: 2.0,
        bottom,
        x: [low - 0.3, (high + 0.3).min(3.0)],
        y: [0.0, 1.0],
    };
    canvas(label, "part bars", size, |c| {
        for value in log_ticks(frame.x) {
            c.x_tick(&frame, value.log10(), &number::significant(value, 1), true);
        }
        let across = frame.x_at(mark.log10());
        let ends = [[across, frame.top], [across, frame.bottom]];
        c.line(&ends, Role::Rule, 1.0, true);
        for (i, (name, value, role)) in rows.iter().enumerate() {
            let y = 6.0 + ROW * (i as f64 + 0.5);
            let at = [frame.left - 6.0, y];
            c.text(name, at, Role::Ink, HPos::Right, VPos::Center);
            if *value > 0.0 && value.is_finite() {
                let end = [frame.x_at(value.log10()), y];
                c.line(&[[frame.left, y], end], *role, 1.5, false);
                c.dot(end, 4.0, *role);
            }
        }
        let foot = [
            [frame.left, frame.top],
            [frame.left, bottom],
            [frame.right, bottom],
        ];
        c.line(&foot, Role::Rule, 1.0, false);
        let at = [(frame.left + frame.right) / 2.0, size[1] - 3.0];
        c.text(x_title, at, Role::Muted, HPos::Center, VPos::Bottom);
    })
}

/// A point with its interval in both directions: x, its ends, y, its ends, colour.
pub type Cross = ([f64; 3], [f64; 3], Role);

/// Points with intervals over a logarithmic axis; the other one begins at zero.
pub fn spectrum(label: &str, x_title: &str, y_title: &str, points: &[Cross]) -> String {
    let width = Width::Part;
    let size = [width.units(), 260.0];
    let logs = |at: fn(&Cross) -> [f64; 3], log: bool| {
        let all = points.iter().flat_map(at).filter(|v| v.is_finite());
        let all: Vec<f64> = match log {
            true => all.filter(|v| *v > 0.0).map(f64::log10).collect(),
            false => all.collect(),
        };
        extent(all.into_iter())
    };
    // an interval may be far longer than what matters: the points with half as much again, and a decade
    let [low, high] = extent(points.iter().map(|p| p.0[0].log10()));
    let [from, to] = logs(|p| p.0, true);
    let most = points.iter().map(|p| p.1[0]).fold(0.0, f64::max);
    let [_, reach] = logs(|p| p.1, false);
    let frame = Frame {
        left: 50.0,
        right: size[0] - 8.0,
        top: 28.0,
        bottom: size[1] - 50.0,
        x: [from.max(low - 1.0) - 0.2, to.min(high + 1.0) + 0.2],
        y: [0.0, 1.08 * reach.min(1.5 * most).max(1e-300)],
    };
    canvas(label, width.class(), size, |c| {
        for value in log_ticks(frame.x) {
            c.x_tick(&frame, value.log10(), &number::significant(value, 1), true);
        }
        let values = ticks(frame.y, 6);
        for (value, text) in values.iter().zip(number::tick_labels(&values)) {
            c.y_tick(&frame, *value, &text);
        }
        c.frame(&frame, y_title);
        for ([x, left, right], [y, low, high], role) in points {
            let at = [frame.x_at(x.log10()), frame.y_at(*y)];
            let side = |v: f64| [frame.x_at(v.max(1e-300).log10()), at[1]];
            let level = |v: f64| [at[0], frame.y_at(v)];
            let sound = |a: &f64, b: &f64| a.is_finite() && b.is_finite();
            if sound(left, right) {
                c.line(&[side(*left), side(*right)], *role, 1.0, false);
            }
            if sound(low, high) {
                c.line(&[level(*low), level(*high)], *role, 1.0, false);
            }
            c.dot(at, 4.5, *role);
        }
        let at = [(frame.left + frame.right) / 2.0, size[1] - 3.0];
        c.text(x_title, at, Role::Muted, HPos::Center, VPos::Bottom);
    })
}

/// Lower half of a symmetric matrix of values from -1 to 1: blue for positive, vermilion for negative,
/// fainter towards zero, with the number where it is large.
pub fn heat_map(label: &str, names: &[String], rows: &[Vec<f64>]) -> String {
    const CELL: f64 = 30.0;
    let n = names.len().saturating_sub(1);
    let longest = names.iter().map(|n| n.chars().count()).max().unwrap_or(0) as f64;
    let margin = 8.0 + 6.4 * longest;
    let side = CELL * n as f64;
    let size = [margin + side + 2.0, side + margin + 2.0];
    canvas(label, "heat", size, |c| {
        for i in 0..n {
            let y = CELL * i as f64;
            let at = [margin - 6.0, y + CELL / 2.0];
            c.text(&names[i + 1], at, Role::Ink, HPos::Right, VPos::Center);
            for j in 0..=i {
                let value = rows.get(i + 1).and_then(|r| r.get(j)).copied();
                let value = value.unwrap_or(f64::NAN);
                let x = margin + CELL * j as f64;
                let corners = ([x + 0.5, y + 0.5], [x + CELL - 0.5, y + CELL - 0.5]);
                c.rectangle(corners.0, corners.1, Role::Grid, 0.5);
                if !value.is_finite() {
                    continue;
                }
                let role = if value > 0.0 { Role::One } else { Role::Two };
                let size = value.abs().min(1.0);
                c.rectangle(corners.0, corners.1, role, (0.8 * size * size).max(0.02));
                if size >= 0.5 {
                    let text = number::fixed(value, 2).replacen("0.", ".", 1);
                    let text = text.strip_suffix(".00").unwrap_or(&text).to_string();
                    let at = [x + CELL / 2.0, y + CELL / 2.0];
                    c.text(&text, at, Role::Ink, HPos::Center, VPos::Center);
                }
            }
            let at = [margin + CELL * (i as f64 + 0.5), side + 6.0];
            c.upright(&names[i], at);
        }
    })
}

/// How often each column was met in each row: a cell is the bluer the greater its share of the row, vermilion
/// where `right` (row, column) does not hold. It keeps its size and is scrolled on a narrow screen.
pub fn counts(
    label: &str,
    rows: &[String],
    columns: &[String],
    cells: &[Vec<usize>],
    right: impl Fn(usize, usize) -> bool,
) -> String {
    const CELL: f64 = 24.0;
    let long = |names: &[String]| {
        let longest = names.iter().map(|n| n.chars().count()).max().unwrap_or(0);
        8.0 + 6.0 * longest as f64
    };
    let (left, foot) = (long(rows), long(columns));
    let bottom = CELL * rows.len() as f64;
    let size = [
        left + CELL * columns.len() as f64 + 2.0,
        bottom + foot + 2.0,
    ];
    let drawing = canvas(label, "heat counts", size, |c| {
        for (i, (name, row)) in rows.iter().zip(cells).enumerate() {
            let y = CELL * i as f64;
            let at = [left - 6.0, y + CELL / 2.0];
            c.text(name, at, Role::Ink, HPos::Right, VPos::Center);
            let all: usize = row.iter().sum();
            for (j, count) in row.iter().enumerate() {
                let x = left + CELL * j as f64;
                let same = right(i, j);
                let corners = ([x + 0.5, y + 0.5], [x + CELL - 0.5, y + CELL - 0.5]);
                c.rectangle(corners.0, corners.1, Role::Grid, 0.5);
                if *count > 0 {
                    let role = if same { Role::One } else { Role::Two };
                    let share = *count as f64 / all as f64;
                    c.rectangle(corners.0, corners.1, role, 0.15 + 0.45 * share);
                    let at = [x + CELL / 2.0, y + CELL / 2.0];
                    c.text(
                        &count.to_string(),
                        at,
                        Role::Ink,
                        HPos::Center,
                        VPos::Center,
                    );
                }
                if same {
                    let [a, b] = [corners.0, corners.1];
                    let around = [a, [b[0], a[1]], b, [a[0], b[1]], a];
                    c.line(&around, Role::Rule, 1.0, false);
                }
            }
        }
        for (j, name) in columns.iter().enumerate() {
            c.upright(name, [left + CELL * (j as f64 + 0.5), bottom + 6.0]);
        }
    });
    let width = 1.2 * size[0];
    format!(
        "<div class=\"scroll\"><div class=\"sized\" style=\"width:{width:.0}px\">{drawing}</div></div>"
    )
}

/// The names of everything drawn in `panels`, each once, with its sign: a list for the caption of the figure.
pub fn legend(panels: &[Panel]) -> String {
    let mut entries: Vec<(&str, String)> = Vec::new();
    for panel in panels {
        for s in &panel.series {
            let kind = match s.mark {
                Mark::Line => "line",
                Mark::Broad => "broad",
                Mark::Dashed => "dashed",
                Mark::Dots => "dot",
            };
            entries.push((&s.name, format!("{kind} k-{}", s.role.class())));
        }
        for b in &panel.bands {
            entries.push((&b.name, format!("area faint k-{}", b.role.class())));
        }
        for s in panel.shades.iter().filter(|s| !s.spans.is_empty()) {
            entries.push((&s.name, format!("area k-{}", s.role.class())));
        }
    }
    let mut seen = std::collections::BTreeSet::new();
    entries.retain(|e| !e.0.is_empty() && seen.insert(e.0));
    key(&entries)
}

/// A legend of filled squares: name and colour.
pub fn colour_key(entries: &[(&str, Role)]) -> String {
    let entries: Vec<(&str, String)> = entries
        .iter()
        .map(|(name, role)| (*name, format!("area k-{}", role.class())))
        .collect();
    key(&entries)
}

fn key(entries: &[(&str, String)]) -> String {
    if entries.is_empty() {
        return String::new();
    }
    let mut out = String::from("<ul class=\"key\">");
    for (name, class) in entries {
        let name = escape(name);
        let _ = write!(
            out,
            "<li><i class=\"{class}\" aria-hidden=\"true\"></i>{name}</li>"
        );
    }
    out + "</ul>"
}

/// One or more drawings with their legend and a caption that says what to look for (plain text).
pub fn figure(drawings: &[String], legend: &str, caption: &str) -> String {
    let class = if drawings.len() > 1 && drawings.iter().all(|d| d.contains("class=\"plot part\""))
    {
        "side"
    } else {
        "stack"
    };
    format!(
        "<figure>{legend}<div class=\"{class}\">{}</div><figcaption>{}</figcaption></figure>\n",
        drawings.concat(),
        escape(caption)
    )
}

/// Smallest and largest finite value; 0 and 1 where there is none.
pub fn extent(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values
        .filter(|v| v.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| {
            [a.min(v), b.max(v)]
        });
    if low > high { [0.0, 1.0] } else { [low, high] }
}

/// A range with some air at both ends, and never empty.
pub fn padded([low, high]: [f64; 2]) -> [f64; 2] {
    let size = high - low;
    let air = if size > 1e-9 * low.abs().max(high.abs()).max(1e-300) {
        0.05 * size
    } else if low == 0.0 {
        1.0
    } else {
        0.1 * low.abs()
    };
    [low - air, high + air]
}

/// Round values within a range, about `wanted` of them.
fn ticks([low, high]: [f64; 2], wanted: usize) -> Vec<f64> {
    let size = high - low;
    if size <= 0.0 || !size.is_finite() {
        return vec![low];
    }
    let raw = size / wanted.max(1) as f64;
    let decade = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|s| s * decade)
        .find(|s| *s >= 0.7 * raw)
        .unwrap_or(10.0 * decade);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|i| i as f64 * step).collect()
}

/// Round values on a logarithmic axis whose ends are given as log10.
fn log_ticks([low, high]: [f64; 2]) -> Vec<f64> {
    if high - low < 1.0 {
        let inside = [10f64.powf(low), 10f64.powf(high)];
        return ticks(inside, 4).into_iter().filter(|v| *v > 0.0).collect();
    }
    let within = |v: &f64| (low..=high).contains(&v.log10());
    let factors: &[f64] = if high - low < 3.0 {
        &[1.0, 2.0, 5.0]
    } else {
        &[1.0]
    };
    let decades = low.floor() as i32..=high.ceil() as i32;
    let all = decades.flat_map(|d| factors.iter().map(move |f| f * 10f64.powi(d)));
    all.filter(within).collect()
}

/// A plotting area and its ranges.
struct Frame {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    x: [f64; 2],
    y: [f64; 2],
}

impl Frame {
    fn x_at(&self, value: f64) -> f64 {
        let share = (value - self.x[0]) / (self.x[1] - self.x[0]);
        self.left + share.clamp(0.0, 1.0) * (self.right - self.left)
    }

    fn y_at(&self, value: f64) -> f64 {
        let share = (value - self.y[0]) / (self.y[1] - self.y[0]);
        self.bottom - share.clamp(0.0, 1.0) * (self.bottom - self.top)
    }
}

/// The area that is drawn on. Drawing into a string does not fail, so that results are not looked at.
pub(super) struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

pub(super) fn canvas(
    label: &str,
    class: &str,
    size: [f64; 2],
    draw: impl FnOnce(&Canvas),
) -> String {
    canvas_of(label, class, size, "", draw)
}

/// The same with what the page's script needs to know of the axes, as JSON; may be empty.
fn canvas_of(
    label: &str,
    class: &str,
    size: [f64; 2],
    axes: &str,
    draw: impl FnOnce(&Canvas),
) -> String {
    let mut raw = String::new();
    let fine = size.map(|s| (s * FINE).round() as u32);
    {
        let area = SVGBackend::with_string(&mut raw, (fine[0], fine[1])).into_drawing_area();
        let canvas = Canvas { area };
        draw(&canvas);
        let _ = canvas.area.present();
    }
    // A drawing grows with the page, but not beyond a comfortable size.
    let most = if size[0] < 400.0 { 1.2 } else { 1.45 } * size[0];
    let open = format!(
        "<svg class=\"plot {class}\" viewBox=\"0 0 {} {}\" style=\"max-width:{most:.0}px\" role=\"img\" aria-label=\"{}\"{}>",
        fine[0],
        fine[1],
        escape(label),
        match axes {
            "" => String::new(),
            axes => format!(" data-axes=\"{}\"", escape(axes)),
        }
    );
    themed(&raw, &open)
}

fn fine(at: [f64; 2]) -> (i32, i32) {
    ((at[0] * FINE).round() as i32, (at[1] * FINE).round() as i32)
}

impl Canvas<'_> {
    pub(super) fn line(&self, points: &[[f64; 2]], role: Role, width: f64, dashed: bool) {
        let style = ShapeStyle::from(role.colour(dashed)).stroke_width((width * FINE) as u32);
        let mut path: Vec<(i32, i32)> = points.iter().map(|p| fine(*p)).collect();
        path.dedup();
        if path.len() == 1 {
            path.push((path[0].0 + 1, path[0].1));
        }
        if !path.is_empty() {
            let _ = self.area.draw(&PathElement::new(path, style));
        }
    }

    pub(super) fn polygon(&self, points: &[[f64; 2]], role: Role, opacity: f64) {
        let colour: RGBAColor = role.colour(false).mix(opacity);
        let path: Vec<(i32, i32)> = points.iter().map(|p| fine(*p)).collect();
        let _ = self.area.draw(&Polygon::new(path, colour));
    }

    pub(super) fn rectangle(&self, from: [f64; 2], to: [f64; 2], role: Role, opacity: f64) {
        let style = role.colour(false).mix(opacity).filled();
        let _ = self
            .area
            .draw(&Rectangle::new([fine(from), fine(to)], style));
    }

    pub(super) fn dot(&self, at: [f64; 2], radius: f64, role: Role) {
        let style = role.colour(false).filled();
        let radius = (radius * FINE) as i32;
        let _ = self.area.draw(&Circle::new(fine(at), radius, style));
    }

    pub(super) fn text(&self, text: &str, at: [f64; 2], role: Role, h: HPos, v: VPos) {
        let font = ("sans-serif", 12).into_font();
        let colour = role.colour(false);
        let style = TextStyle::from(font).color(&colour).pos(Pos::new(h, v));
        let _ = self.area.draw_text(text, &style, fine(at));
    }

    /// Text that runs upwards and ends at `at`.
    fn upright(&self, text: &str, at: [f64; 2]) {
        let font = ("sans-serif", 12)
            .into_font()
            .transform(FontTransform::Rotate270);
        let colour = Role::Ink.colour(false);
        let style = TextStyle::from(font)
            .color(&colour)
            .pos(Pos::new(HPos::Right, VPos::Center));
        let _ = self.area.draw_text(text, &style, fine(at));
    }

    fn x_tick(&self, frame: &Frame, value: f64, text: &str, grid: bool) {
        let x = frame.x_at(value);
        if grid {
            let ends = [[x, frame.top], [x, frame.bottom]];
            self.line(&ends, Role::Grid, 0.75, false);
        }
        if !text.is_empty() {
            let at = [x, frame.bottom + 6.0];
            self.text(text, at, Role::Muted, HPos::Center, VPos::Top);
        }
    }

    fn x_ticks(&self, frame: &Frame, wanted: usize) {
        let values = ticks(frame.x, wanted);
        for (value, text) in values.iter().zip(number::tick_labels(&values)) {
            self.x_tick(frame, *value, &text, true);
        }
    }

    fn y_tick(&self, frame: &Frame, value: f64, text: &str) {
        let y = frame.y_at(value);
        let role = if value == 0.0 { Role::Rule } else { Role::Grid };
        self.line(&[[frame.left, y], [frame.right, y]], role, 0.75, false);
        let at = [frame.left - 6.0, y];
        self.text(text, at, Role::Muted, HPos::Right, VPos::Center);
    }

    /// Axis lines and the title of the vertical axis, which stands above it where it needs no turning of the
    /// head.
    fn frame(&self, frame: &Frame, title: &str) {
        let corner = [frame.left, frame.bottom];
        let ends = [[frame.left, frame.top], corner, [frame.right, frame.bottom]];
        self.line(&ends, Role::Rule, 1.0, false);
        let at = [2.0, frame.top - 8.0];
        self.text(title, at, Role::Ink, HPos::Left, VPos::Bottom);
    }

    fn panel(&self, frame: &Frame, panel: &Panel, last: bool, both: bool) {
        for shade in &panel.shades {
            for span in &shade.spans {
                let [from, to] = span.map(|x| frame.x_at(x));
                if to > from {
                    let corners = ([from, frame.top], [to.max(from + 0.5), frame.bottom]);
                    self.rectangle(corners.0, corners.1, shade.role, 1.0);
                }
            }
        }
        let wanted = ((frame.right - frame.left) / 85.0).round() as usize;
        let values = ticks(frame.x, wanted);
        for (value, text) in values.iter().zip(number::tick_labels(&values)) {
            self.x_tick(frame, *value, if last { &text } else { "" }, true);
        }
        let wanted = ((frame.bottom - frame.top) / 30.0).round() as usize;
        let values = ticks(frame.y, wanted.max(2));
        for (value, text) in values.iter().zip(number::tick_labels(&values)) {
            self.y_tick(frame, *value, &text);
        }
        for band in &panel.bands {
            for run in reduce::band(&band.rows) {
                let upper = run.iter().map(|r| [frame.x_at(r[0]), frame.y_at(r[2])]);
                let lower = run
                    .iter()
                    .rev()
                    .map(|r| [frame.x_at(r[0]), frame.y_at(r[1])]);
                let around: Vec<[f64; 2]> = upper.chain(lower).collect();
                self.polygon(&around, band.role, 0.25);
            }
        }
        for series in &panel.series {
            if series.mark == Mark::Dots {
                for p in series
                    .points
                    .iter()
                    .filter(|p| p.iter().all(|v| v.is_finite()))
                {
                    self.dot([frame.x_at(p[0]), frame.y_at(p[1])], 3.0, series.role);
                }
                continue;
            }
            for run in reduce::curve(&series.points, both) {
                let path: Vec<[f64; 2]> = run
                    .iter()
                    .map(|p| [frame.x_at(p[0]), frame.y_at(p[1])])
                    .collect();
                let width = if series.mark == Mark::Broad { 2.5 } else { 1.0 };
                self.line(&path, series.role, width, series.mark == Mark::Dashed);
            }
        }
        self.frame(frame, &panel.y.title);
    }
}

/// Replaces the marker colours of a raw drawing by classes, and leaves fonts and sizes to the page. `open` is
/// its new first tag.
fn themed(raw: &str, open: &str) -> String {
    let mut out = String::with_capacity(raw.len());
    let mut rest = raw;
    while let Some(start) = rest.find('<') {
        out.push_str(rest[..start].trim_matches('\n'));
        let Some(end) = rest[start..].find('>').map(|e| start + e) else {
            break;
        };
        let tag = &rest[start + 1..end];
        rest = &rest[end + 1..];
        if tag.starts_with("svg") {
            out.push_str(open);
        } else if tag.starts_with('/') {
            let _ = write!(out, "<{tag}>");
        } else {
            themed_tag(tag, &mut out);
        }
    }
    out.push('\n');
    out
}

fn themed_tag(tag: &str, out: &mut String) {
    let (closed, tag) = match tag.strip_suffix('/') {
        Some(tag) => (true, tag),
        None => (false, tag),
    };
    let (name, mut rest) = tag.split_once(' ').unwrap_or((tag, ""));
    out.push('<');
    out.push_str(name);
    while let Some((key, after)) = rest.split_once("=\"") {
        let Some((value, after)) = after.split_once('"') else {
            break;
        };
        rest = after;
        let key = key.trim();
        match (key, value) {
            ("font-family" | "font-size", _) | ("opacity", "1") | ("stroke" | "fill", "none") => {}
            ("stroke" | "fill", colour) => {
                let number = |at: usize| {
                    let digits = colour.get(at..at + 2)?;
                    u8::from_str_radix(digits, 16).ok()
                };
                let role = number(1).and_then(|n| Role::ALL.get(usize::from(n)));
                let dash = if number(3) == Some(1) { " dash" } else { "" };
                if let Some(role) = role {
                    let _ = write!(out, " class=\"{}-{}{dash}\"", &key[..1], role.class());
                }
            }
            (key, value) => {
                let _ = write!(out, " {key}=\"{}\"", value.trim_end());
            }
        }
    }
    out.push_str(if closed { "/>" } else { ">" });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series(points: Vec<[f64; 2]>) -> Series {
        Series {
            name: "a <b>".into(),
            role: Role::One,
            mark: Mark::Dashed,
            points,
        }
    }

    fn panel(points: Vec<[f64; 2]>) -> Panel {
        Panel {
            y: Axis::new("y, V"),
            height: 100.0,
            shades: vec![Shade {
                name: "gap".into(),
                role: Role::Gap,
                spans: vec![[1.0, 2.0]],
            }],
            bands: vec![Band {
                name: "band".into(),
                role: Role::Two,
                rows: points
                    .iter()
                    .map(|p| [p[0], p[1] - 1.0, p[1] + 1.0])
                    .collect(),
            }],
            series: vec![series(points)],
        }
    }

    #[test]
    fn a_drawing_has_classes_and_no_colour_or_font_of_its_own() {
        let points = (0..50).map(|i| [f64::from(i), f64::from(i * i)]).collect();
        let panel = panel(points);
        let svg = line_plot(
            "what <it> is",
            &Axis::new("x, s"),
            std::slice::from_ref(&panel),
            Width::Full,
        );
        for absent in ["#", "font-", "http", "<it>", "fill=", "stroke=\"", "NaN"] {
            assert!(!svg.contains(absent), "{absent} in {svg}");
        }
        for present in [
            "aria-label=\"what &lt;it&gt; is\"",
            "class=\"s-one dash\"",
            "class=\"f-two\" opacity=\"0.25\"",
            "class=\"f-gap\"",
            "x, s</text>",
        ] {
            let plain = svg.replace(
                "opacity=\"0.25\" class=\"f-two\"",
                "class=\"f-two\" opacity=\"0.25\"",
            );
            assert!(plain.contains(present), "{present} in {svg}");
        }
        let key = legend(&[panel.clone(), panel]);
        assert_eq!(key.matches("a &lt;b&gt;").count(), 1);
    }

    #[test]
    fn every_role_is_found_again() {
        for (i, role) in Role::ALL.iter().enumerate() {
            assert_eq!(*role as usize, i);
        }
    }

    #[test]
    fn nothing_to_draw_is_drawn() {
        let bad = f64::NAN;
        for points in [vec![], vec![[0.0, bad]], vec![[bad, 1.0]], vec![[3.0, 3.0]]] {
            let panel = panel(points.clone());
            let svg = line_plot("", &Axis::new("x"), &[panel], Width::Part);
            assert!(!svg.contains("NaN") && svg.ends_with("</svg>\n"));
            loops("", &Axis::new("x"), &Axis::new("y"), vec![series(points)]);
        }
        for values in [
            vec![],
            vec![bad],
            vec![0.0],
            vec![1.0, 1.0],
            vec![1.0, 3e5, bad],
        ] {
            let svg = waterfall("", "rank", "cost", &values, |v| v < 2.0);
            assert!(!svg.contains("NaN"));
        }
        let svg = waterfall("", "rank", "cost", &[1.0, 1.1, 2.0], |v| v < 1.5);
        let dots = |class: &str| svg.matches(&format!("class=\"{class}\"")).count();
        assert_eq!((dots("f-one"), dots("f-two")), (2, 1));
        let groups = [("a".to_string(), vec![(Role::One, bad), (Role::Two, 0.0)])];
        assert!(!bars("", "x", &groups).contains("NaN"));
        bars("", "x", &[]);
        heat_map("", &[], &[]);
        forest("", "x", &[], 30.0);
        spectrum("", "x", "y", &[]);
        let rows = [
            ("a".to_string(), bad, Role::One),
            ("b".to_string(), 0.0, Role::One),
        ];
        assert!(!forest("", "x", &rows, 30.0).contains("NaN"));
        let points = [([1.0, bad, 2.0], [0.0, 0.0, bad], Role::One)];
        assert!(!spectrum("", "x", "y", &points).contains("NaN"));
        let names = ["a".to_string(), "b".to_string()];
        assert!(!heat_map("", &names, &[vec![1.0, bad], vec![bad, 1.0]]).contains("NaN"));
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(
            ticks([0.0, 60.0], 6),
            [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
        );
        assert_eq!(ticks([-1.0, 1.0], 2), [-1.0, 0.0, 1.0]);
        assert_eq!(log_ticks([0.0, 4.0]), [1.0, 10.0, 100.0, 1000.0, 10000.0]);
        assert!(log_ticks([0.1, 0.15]).len() >= 2);
        assert_eq!(ticks([1.0, 1.0], 3), [1.0]);
    }
}
