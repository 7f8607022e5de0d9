//! What the messages of a topic become: one row a message, one column a number.
//!
//! A decoder knows its leaves (the numbers of a message, by their path) and fills a row with them. Messages
//! that hold a list of things with names (transforms, rigid bodies, markers) give one series a name.

use std::collections::HashMap;

use crate::recording::capture::{Column, Group, RowLines, Section};
use crate::recording::text::decode;

/// The most values of one file that are kept in memory; 1 GiB.
pub(super) const MAX_VALUES: usize = 1 << 27;
/// The most columns of one series, and the most series of one topic; further ones are left out and said.
pub(super) const MAX_LEAVES: usize = 4096;
/// The most bytes of one name.
const MAX_NAME: usize = 256;
/// Of a list of numbers, so many become columns.
pub(super) const MAX_LIST: usize = 64;

/// A number in a message.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Leaf {
    /// `pose.position.x`
    pub path: String,
    /// As far as the message's type tells; else empty.
    pub unit: &'static str,
}

/// Where a decoder puts what it finds: the topic's own table first, then one a list of things.
pub(super) struct Tables {
    pub list: Vec<Table>,
    /// Values that may still be kept.
    pub budget: usize,
    /// A row was not kept, for want of budget.
    pub full: bool,
    /// The most values that wait in one series since this was last set to 0.
    pub waiting: usize,
}

impl Tables {
    pub fn new() -> Self {
        Tables {
            list: vec![Table::default()],
            budget: MAX_VALUES,
            full: false,
            waiting: 0,
        }
    }

    /// Ends the row of a table.
    pub fn push(&mut self, table: usize, time_s: f64) {
        let Some(waiting) = self.list[table].push(time_s, self.budget) else {
            self.full = true;
            return;
        };
        self.budget -= waiting.1;
        self.waiting = self.waiting.max(waiting.0);
    }

    /// Ends the row of the thing `index` of a list; the number in leaf `key` names it where no text does.
    pub fn push_thing(&mut self, table: usize, time_s: f64, key: Option<usize>, index: usize) {
        let t = &mut self.list[table];
        if t.key.is_empty() {
            let number = key.and_then(|leaf| t.row.get(leaf)).filter(|v| !v.is_nan());
            t.key = match number {
                Some(number) => number.to_string(),
                None => index.to_string(),
            };
        }
        self.push(table, time_s);
    }
}

/// Rows of one shape.
#[derive(Default)]
pub(super) struct Table {
    /// Path of the list inside the message; empty for the message itself.
    pub path: String,
    /// Texts that name the thing whose row it is, by their path.
    pub texts: Vec<String>,
    pub leaves: Vec<Leaf>,
    pub series: Vec<Series>,
    by_key: HashMap<String, usize>,
    last: usize,
    /// The row that is being filled.
    pub row: Vec<f64>,
    /// Name of the thing whose row it is.
    pub key: String,
    /// Things beyond the most that are kept apart.
    pub left_out: u64,
}

/// The rows of one thing.
#[derive(Default)]
pub(super) struct Series {
    key: String,
    rows: usize,
    /// Whether a column has a number.
    seen: Vec<bool>,
    times_s: Vec<f64>,
    columns: Vec<Vec<f64>>,
    last_s: f64,
    /// Rows that come before the row above them.
    back: usize,
    /// The latest row that was shown, s.
    shown_s: f64,
}

impl Table {
    /// Of a list at a path of the message, whose things have names.
    pub fn of_list(path: String, texts: Vec<String>) -> Self {
        Table {
            path,
            texts,
            ..Table::default()
        }
    }

    /// Adds a leaf; `None` when there are too many.
    pub fn leaf(&mut self, path: String, unit: &'static str) -> Option<usize> {
        if self.leaves.len() >= MAX_LEAVES {
            return None;
        }
        self.leaves.push(Leaf { path, unit });
        Some(self.leaves.len() - 1)
    }

    /// An empty row.
    pub fn clear(&mut self) {
        self.row.clear();
        self.row.resize(self.leaves.len(), f64::NAN);
        self.key.clear();
    }

    /// Sets a value of the row.
    #[inline]
    pub fn set(&mut self, leaf: usize, value: f64) {
        if let Some(slot) = self.row.get_mut(leaf) {
            // an infinity is no measurement
            *slot = if value.is_finite() { value } else { f64::NAN };
        } else if leaf < self.leaves.len() {
            self.row.resize(leaf + 1, f64::NAN);
            self.set(leaf, value);
        }
    }

    /// Adds a text to the name of the thing.
    pub fn name(&mut self, text: &[u8]) {
        let text = decode(&text[..text.len().min(MAX_NAME)]);
        if !text.is_empty() && self.key.len() < 2 * MAX_NAME {
            if !self.key.is_empty() {
                self.key.push(':');
            }
            self.key.push_str(&text);
        }
    }

    /// Ends the row: it is of the thing called `key`, at a time. Gives the values that wait in its series and
    /// how many of them are new; `None` for a row of more than `budget` values, which is counted and not
    /// kept.
    pub fn push(&mut self, time_s: f64, budget: usize) -> Option<(usize, usize)> {
        if self.leaves.is_empty() {
            // a message without numbers is still counted
            let at = self.place();
            if let Some(s) = at.and_then(|i| self.series.get_mut(i)) {
                s.rows += 1;
                s.stamp(time_s);
            }
            return Some((0, 0));
        }
        let Some(at) = self.place() else {
            self.left_out += 1;
            return Some((0, 0));
        };
        let width = self.leaves.len();
        self.row.resize(width, f64::NAN);
        let series = &mut self.series[at];
        series.rows += 1;
        series.stamp(time_s);
        series.seen.resize(width, false);
        for (seen, value) in series.seen.iter_mut().zip(&self.row) {
            *seen |= !value.is_nan();
        }
        if budget < width + 1 {
            return None;
        }
        while series.columns.len() < width {
            series.columns.push(vec![f64::NAN; series.times_s.len()]);
        }
        for (column, value) in series.columns.iter_mut().zip(&self.row) {
            column.push(*value);
        }
        series.times_s.push(time_s);
        Some((series.times_s.len() * width, width + 1))
    }

    fn place(&mut self) -> Option<usize> {
        if self
            .series
            .get(self.last)
            .is_some_and(|s| s.key == self.key)
        {
            return Some(self.last);
        }
        let at = match self.by_key.get(&self.key) {
            Some(at) => *at,
            None if self.series.len() < MAX_LEAVES => {
                self.series.push(Series {
                    key: self.key.clone(),
                    last_s: f64::NEG_INFINITY,
                    shown_s: f64::NEG_INFINITY,
                    ..Series::default()
                });
                self.by_key.insert(self.key.clone(), self.series.len() - 1);
                self.series.len() - 1
            }
            None => return None,
        };
        self.last = at;
        Some(at)
    }
}

/// Steps of a path that say no more than that there is a position.
const PLAIN: [&str; 7] = [
    "pose",
    "position",
    "transform",
    "translation",
    "point",
    "data",
    "rigidbodies",
];

impl Series {
    fn stamp(&mut self, time_s: f64) {
        self.back += usize::from(time_s < self.last_s);
        self.last_s = time_s;
    }

    /// Takes its name away.
    pub fn unname(&mut self) {
        self.key.clear();
    }

    /// Rows that come before the row above them.
    pub fn back(&self) -> usize {
        self.back
    }

    /// How many rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The series as a section, with the leaf of each column; `number` counts the columns of the file. `None`
    /// when it holds no number.
    pub fn section(
        mut self,
        topic: &str,
        table: (&str, &[Leaf]),
        unit: &str,
        number: &mut usize,
    ) -> Option<(Section, Vec<usize>)> {
        let (list, leaves) = table;
        let seen = |i: usize| self.seen.get(i).is_some_and(|s| *s);
        // a place of a list that no message reached is no column; a field that is NaN throughout is one
        let used: Vec<usize> = (0..leaves.len())
            .filter(|i| seen(*i) || !leaves[*i].path.ends_with(']'))
            .collect();
        if used.is_empty() || self.rows == 0 {
            return None;
        }
        let label = if self.key.is_empty() {
            topic
        } else {
            &self.key
        };
        let name = match (list.is_empty(), self.key.is_empty()) {
            (true, true) => topic.to_owned(),
            (true, false) => format!("{topic} {}", self.key),
            (false, _) => format!("{topic} {list} {}", self.key),
        };
        // groups in the order of their first leaf, the leaves of each together
        let mut groups: Vec<(&str, Vec<usize>)> = Vec::new();
        for i in used {
            let parent = parts(&leaves[i].path).0;
            match groups.iter_mut().find(|(p, _)| *p == parent) {
                Some((_, list)) => list.push(i),
                None => groups.push((parent, vec![i])),
            }
        }
        let mut names: Vec<String> = Vec::new();
        for (parent, _) in &groups {
            let short: Vec<&str> = parent
                .split('.')
                .filter(|p| !p.is_empty() && !PLAIN.contains(p))
                .collect();
            let short = if short.is_empty() {
                label.to_owned()
            } else {
                format!("{label}/{}", short.join("."))
            };
            let name = if names.contains(&short) {
                format!("{label}/{parent}")
            } else {
                short
            };
            names.push(name);
        }
        let order = self.order();
        let mut section = Section {
            name,
            lines: RowLines::without(self.times_s.len()),
            ..Section::default()
        };
        let mut of_columns = Vec::new();
        for ((_, members), name) in groups.iter().zip(&names) {
            let from = section.columns.len();
            for &i in members {
                let own = parts(&leaves[i].path).1;
                let leaf_unit = leaves[i].unit;
                *number += 1;
                of_columns.push(i);
                let own_values = self.columns.get_mut(i).map(std::mem::take);
                let mut values = own_values.unwrap_or_default();
                values.resize(self.times_s.len(), f64::NAN);
                if let Some(order) = &order {
                    values = order.iter().map(|at| values[*at]).collect();
                }
                section.columns.push(Column {
                    group: name.clone(),
                    axis: own.to_owned(),
                    unit: if leaf_unit.is_empty() {
                        unit
                    } else {
                        leaf_unit
                    }
                    .to_owned(),
                    number: *number,
                    values,
                });
            }
            section.groups.push(Group {
                name: name.clone(),
                columns: from..section.columns.len(),
            });
        }
        section.stamps_s = Some(match order {
            Some(order) => order.iter().map(|at| self.times_s[*at]).collect(),
            None => self.times_s,
        });
        Some((section, of_columns))
    }

    /// Adds waiting rows to a section that has a column for each of `leaves`: all of them where they come in
    /// the order of time or none follow (`all`), else the earlier half by time, in the order of time. Says
    /// how many come before one that was shown earlier.
    pub fn pour(&mut self, section: &mut Section, leaves: &[usize], all: bool) -> usize {
        let count = self.times_s.len();
        let mut order: Vec<usize> = (0..count).collect();
        let rising = self.times_s.windows(2).all(|w| w[0] <= w[1]);
        if !rising {
            order.sort_by(|a, b| self.times_s[*a].total_cmp(&self.times_s[*b]));
        }
        let mut rest = order.split_off(if all { count } else { count / 2 });
        rest.sort_unstable();
        let stamps = section.stamps_s.get_or_insert_default();
        let mut late = 0;
        for &i in &order {
            late += usize::from(self.times_s[i] < self.shown_s);
            self.shown_s = self.shown_s.max(self.times_s[i]);
            stamps.push(self.times_s[i]);
        }
        section.lines = RowLines::without(stamps.len());
        for (column, leaf) in section.columns.iter_mut().zip(leaves) {
            let values = self.columns.get(*leaf);
            let value = |i: &usize| values.map_or(f64::NAN, |v| v[*i]);
            column.values.extend(order.iter().map(value));
        }
        self.times_s = rest.iter().map(|&i| self.times_s[i]).collect();
        for column in &mut self.columns {
            *column = rest.iter().map(|&i| column[i]).collect();
        }
        late
    }

    /// Drops the rows that wait.
    pub fn forget(&mut self) {
        self.times_s.clear();
        self.columns.iter_mut().for_each(Vec::clear);
    }

    /// Values that wait to be shown.
    pub fn waiting(&self) -> usize {
        self.times_s.len() * self.columns.len()
    }

    /// The rows by time, equal ones as in the file; `None` when they are so already.
    fn order(&self) -> Option<Vec<usize>> {
        if self.back == 0 {
            return None;
        }
        let mut order: Vec<usize> = (0..self.times_s.len()).collect();
        order.sort_by(|a, b| self.times_s[*a].total_cmp(&self.times_s[*b]));
        Some(order)
    }
}

/// A path without its last step, and that step.
fn parts(path: &str) -> (&str, &str) {
    path.rsplit_once('.').unwrap_or(("", path))
}

/// The unit of a number, by the type of the message that holds it (`geometry_msgs/Point`), the field that
/// holds that message, and its own name. Standard messages are in SI (REP 103); other ones say nothing.
pub(super) fn unit(message: &str, holder: &str, field: &str) -> &'static str {
    let short = message.rsplit(['/', '.']).next().unwrap_or(message);
    let package = message.split(['/', '.']).next().unwrap_or(message);
    let xyz = matches!(field, "x" | "y" | "z");
    match (package, short) {
        ("geometry_msgs", "Point" | "Point32") if xyz => "m",
        ("foxglove", "Point3") if xyz => "m",
        ("geometry_msgs" | "foxglove", "Quaternion") if xyz || field == "w" => "1",
        ("geometry_msgs" | "foxglove", "Vector3") if xyz => match holder {
            "translation" | "position" => "m",
            "linear" => "m/s",
            "angular" | "angular_velocity" => "rad/s",
            "linear_acceleration" => "m/s^2",
            "force" => "N",
            "torque" => "N m",
            _ => "",
        },
        ("sensor_msgs", "BatteryState") => match field {
            "voltage" => "V",
            "current" => "A",
            _ => "",
        },
        ("vicon_receiver", "Position") if field.ends_with("_trans") => "mm",
        _ => "",
    }
}

/// Whether messages of this type are words for people.
pub(super) fn is_log(schema: &str) -> bool {
    matches!(
        schema,
        "rcl_interfaces/msg/Log" | "rcl_interfaces/Log" | "rosgraph_msgs/Log" | "foxglove.Log"
    )
}

/// Which text of a message names the thing that it is about, where several things share a topic: the steps of
/// the paths, in the order in which they are joined. `names` are the texts of one message.
pub(super) fn key_fields<'a>(names: &[&'a str], of_list: bool) -> Vec<&'a str> {
    let child = names.iter().find(|n| **n == "child_frame_id");
    if let Some(child) = child {
        let parent = ["header.frame_id", "parent_frame_id", "frame_id"]
            .iter()
            .find_map(|p| names.iter().find(|n| *n == p));
        return parent.into_iter().chain([child]).copied().collect();
    }
    if !of_list {
        return Vec::new();
    }
    ["name", "label", "id"]
        .iter()
        .find_map(|k| names.iter().find(|n| *n == k))
        .or_else(|| names.iter().find(|n| n.ends_with("_name")))
        .into_iter()
        .copied()
        .collect()
}

/// Numbers that name a thing of a list where no text does.
pub(super) const KEY_NUMBERS: [&str; 3] = ["id", "index", "marker_index"];
