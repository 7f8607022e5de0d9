//! The page of `deacal view`: a recording drawn between two times, and the robot as it moves. What is drawn
//! is made anew for each look, at the resolution of the screen.

use minijinja::{Value, context};
use serde::Serialize;

use super::page::{SCRIPT, STYLE, fill, safe};
use super::plot::{self, Axis, Band, Panel, Series, Shade, Width};
use crate::report::json::to_text;

const PAGE: &str = include_str!("view.html");
const MORE_STYLE: &str = include_str!("view.css");
const MORE_SCRIPT: &str = include_str!("view.js");

/// Panels above each other over time, all of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// The actuator, from 0, that it is of; `None` for what is of all.
    pub actuator: Option<usize>,
    /// What is drawn, in words.
    pub label: String,
    /// The panels, x in s (or rows).
    pub panels: Vec<Panel>,
}

/// A recording on the page.
#[derive(Debug, Clone, Serialize)]
pub struct Shown {
    /// Its id.
    pub id: String,
    /// Its kind.
    pub kind: &'static str,
    /// First and last time, s (or rows).
    pub span: [f64; 2],
    /// Actuators that can be picked.
    pub actuators: usize,
    /// Whether it can be played.
    pub moves: bool,
    /// Whether parameters are held against it.
    pub predicted: bool,
}

/// A link to a page of the folder.
#[derive(Debug, Clone, Serialize)]
pub struct Link {
    /// Where it leads, below `/files/`.
    pub path: String,
    /// Its name.
    pub name: String,
}

/// The page. `recordings` are those that can be looked at, of which `first` has the figures; `links` lead to
/// the reports of the folder.
pub fn view_page(title: &str, links: &[Link], recordings: &[Shown], first: &str) -> String {
    let link = |l: &Link| context! { path => l.path.clone(), name => l.name.clone() };
    let ids: Vec<String> = recordings.iter().map(|r| r.id.clone()).collect();
    let context = context! {
        title => title,
        style => safe(format!("{STYLE}\n{MORE_STYLE}")),
        script => safe(format!("{SCRIPT}\n{MORE_SCRIPT}")),
        links => links.iter().map(link).collect::<Vec<Value>>(),
        ids => ids,
        recordings => to_text(&recordings),
        first => safe(first.to_owned()),
    };
    fill(PAGE, context)
}

/// The figure of drawings between two times; all of them where there are none. Of drawings of an actuator
/// only those of `wanted` ones. `x` is the title of the axis.
pub fn view_figure(
    drawings: &[Drawing],
    span: [f64; 2],
    wanted: &dyn Fn(usize) -> bool,
    x: &str,
) -> String {
    let shown = drawings.iter().filter(|d| d.actuator.is_none_or(wanted));
    let (mut all, mut out) = (Vec::new(), Vec::new());
    for d in shown {
        let panels: Vec<Panel> = d.panels.iter().map(|p| between(p, span)).collect();
        let x = Axis::over(x, span);
        out.push(plot::line_plot(&d.label, &x, &panels, Width::Full));
        all.extend(panels);
    }
    plot::figure(&out, &plot::legend(&all), "")
}

/// A panel between two times.
fn between(panel: &Panel, [from, to]: [f64; 2]) -> Panel {
    let series = |s: &Series| Series {
        name: s.name.clone(),
        points: cut(&s.points, from, to),
        role: s.role,
        mark: s.mark,
    };
    let band = |b: &Band| {
        let first = b.rows.partition_point(|r| r[0] < from);
        let end = b.rows.partition_point(|r| r[0] <= to);
        Band {
            name: b.name.clone(),
            role: b.role,
            rows: b.rows[first..end.max(first)].to_vec(),
        }
    };
    let within = |s: &[f64; 2]| (s[1] > from && s[0] < to).then(|| [s[0].max(from), s[1].min(to)]);
    let shade = |s: &Shade| Shade {
        name: s.name.clone(),
        role: s.role,
        spans: s.spans.iter().filter_map(within).collect(),
    };
    Panel {
        y: panel.y.clone(),
        height: panel.height,
        shades: panel.shades.iter().map(shade).collect(),
        bands: panel.bands.iter().map(band).collect(),
        series: panel.series.iter().map(series).collect(),
    }
}

/// Points between two times, and where the line to their neighbours crosses the edges.
fn cut(points: &[[f64; 2]], from: f64, to: f64) -> Vec<[f64; 2]> {
    let (first, end) = (
        points.partition_point(|p| p[0] < from),
        points.partition_point(|p| p[0] <= to),
    );
    let at = |i: usize, x: f64| {
        let ([x0, y0], [x1, y1]) = (*points.get(i.wrapping_sub(1))?, *points.get(i)?);
        (x0 < x && x < x1).then(|| [x, y0 + (x - x0) / (x1 - x0) * (y1 - y0)])
    };
    let (before, after) = (at(first, from), at(end.max(first), to));
    let inside = points[first..end.max(first)].iter().copied();
    before.into_iter().chain(inside).chain(after).collect()
}

#[cfg(test)]
mod tests {
    use super::cut;

    #[test]
    fn lines_reach_the_edges_of_what_is_looked_at() {
        let points: Vec<[f64; 2]> = (0..5).map(|i| [f64::from(i), f64::from(2 * i)]).collect();
        assert_eq!(
            cut(&points, 0.5, 2.5),
            [[0.5, 1.0], [1.0, 2.0], [2.0, 4.0], [2.5, 5.0]]
        );
        assert_eq!(cut(&points, 1.25, 1.5), [[1.25, 2.5], [1.5, 3.0]]);
        assert_eq!(cut(&points, 0.0, 4.0), points);
        assert_eq!(cut(&points, -3.0, 9.0), points);
        assert!(cut(&points, 7.0, 9.0).is_empty());
        assert!(cut(&[], 0.0, 1.0).is_empty());
    }
}
