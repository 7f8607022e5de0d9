//! Numbers for a terminal: plain text in columns, the same on a screen and in a pipe.

use super::answer::{Fact, Open};
use super::html::number::{self, Quantity};
use super::json::{Named, ParameterJson};

/// Width of a curve.
pub const WIDTH: usize = 60;
/// Heights of a curve.
const BLOCKS: [char; 8] = [
    '\u{2581}', '\u{2582}', '\u{2583}', '\u{2584}', '\u{2585}', '\u{2586}', '\u{2587}', '\u{2588}',
];

/// Rows of cells as lines, their columns below each other, the last one as long as it is.
#[must_use]
pub fn columns<const N: usize>(rows: &[[String; N]]) -> Vec<String> {
    let width = |c: usize| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0);
    let widths: [usize; N] = std::array::from_fn(width);
    let line = |row: &[String; N]| {
        let cells = row.iter().zip(widths);
        let text: String = cells.map(|(cell, w)| format!("  {cell:w$}")).collect();
        text.trim_end().to_owned()
    };
    rows.iter().map(line).collect()
}

/// One line a quantity: name, value, 95 % interval, what it means.
#[must_use]
pub fn facts(list: &[Fact]) -> Vec<String> {
    let row = |f: &Fact| {
        [
            f.what.clone(),
            f.size.with_unit(),
            f.size.interval.clone(),
            f.means.clone(),
        ]
    };
    columns(&list.iter().map(row).collect::<Vec<_>>())
}

/// One line a parameter that the recordings determine and that is not among `told`: name, value, 95 %
/// interval, what it is.
#[must_use]
pub fn parameters(list: &Named<ParameterJson>, told: &[Fact]) -> Vec<String> {
    let is_told = |name: &String| told.iter().any(|f| f.what == *name);
    let known = list
        .0
        .iter()
        .filter(|(name, p)| p.identifiable && !p.fixed && !is_told(name));
    let rows: Vec<[String; 4]> = known
        .map(|(name, p)| {
            let number = |v: Option<f64>| v.unwrap_or(f64::NAN);
            let ends = p.ci95.map_or([f64::NAN; 2], |c| c.map(number));
            let size = Quantity::new(number(p.value), ends, &p.unit);
            [
                name.clone(),
                size.with_unit(),
                size.interval,
                number::words(&p.meaning),
            ]
        })
        .collect();
    columns(&rows)
}

/// One line a thing to record: what it would determine, and the names of that.
#[must_use]
pub fn open(list: &[Open]) -> Vec<String> {
    let line = |o: &Open| format!("  {}: {} ({})", o.record, o.what, o.names.join(", "));
    list.iter().map(line).collect()
}

/// A curve as one line of `width` blocks between its smallest and its largest value, each block the mean of
/// its share of the values; a space where there is none.
#[must_use]
pub fn curve(values: &[f64], width: usize) -> String {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let low = finite().fold(f64::INFINITY, f64::min);
    let size = finite().fold(f64::NEG_INFINITY, f64::max) - low;
    let blocks = width.min(values.len());
    let block = |i: usize| {
        let share = &values[i * values.len() / blocks..(i + 1) * values.len() / blocks];
        let (sum, n) = share
            .iter()
            .filter(|v| v.is_finite())
            .fold((0.0, 0), |(s, n), v| (s + v, n + 1));
        if n == 0 {
            return ' ';
        }
        let height = (sum / f64::from(n) - low) / size;
        BLOCKS[(height * 7.0).round().clamp(0.0, 7.0) as usize]
    };
    (0..blocks).map(block).collect()
}

/// The ends of a range in one prefixed unit: `-77.3 to -40.9 mm`.
#[must_use]
pub fn range(values: impl Iterator<Item = f64>, unit: &str) -> String {
    let [low, high] = super::html::plot::extent(values);
    let (factor, unit) = number::scaled(low.abs().max(high.abs()), unit);
    let places = number::decimals(factor * low.abs().max(high.abs()), 3);
    let end = |v: f64| number::fixed(factor * v, places);
    number::with_unit(&format!("{} to {}", end(low), end(high)), &unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(value: f64, unit: &str, ci95: [f64; 2], identifiable: bool) -> ParameterJson {
        ParameterJson {
            value: Some(value),
            unit: unit.into(),
            std_error: None,
            misfit_std_error: None,
            ci95: Some(ci95.map(Some)),
            at_bound: false,
            bound: None,
            identifiable,
            fixed: false,
            meaning: "what it is".into(),
            says: String::new(),
        }
    }

    #[test]
    fn values_stand_in_columns_with_their_intervals() {
        let list = Named(vec![
            (
                "mu_1".into(),
                row(1_111_799.0, "Pa", [1_080_068.0, 1_143_529.0], true),
            ),
            ("T_5".into(), row(20.108, "s", [2.1109, 191.548], false)),
            (
                "torque_0deg".into(),
                row(-3e-4, "N m", [-4e-4, -2e-4], true),
            ),
            (
                "J".into(),
                ParameterJson {
                    fixed: true,
                    ..row(80.0, "1", [80.0; 2], false)
                },
            ),
        ]);
        let lines = parameters(&list, &[]);
        let expected = [
            "  mu_1         1.112 MPa  1.080 to 1.144  what it is",
            "  torque_0deg  \u{2212}300 \u{b5}N m  \u{2212}400 to \u{2212}200    what it is",
        ];
        assert_eq!(lines, expected);
    }

    #[test]
    fn a_curve_is_drawn_in_one_line() {
        let ramp: Vec<f64> = (0..16).map(f64::from).collect();
        assert_eq!(
            curve(&ramp, 8),
            "\u{2581}\u{2582}\u{2583}\u{2584}\u{2585}\u{2586}\u{2587}\u{2588}"
        );
        assert_eq!(curve(&[f64::NAN, 1.0], 2).chars().next(), Some(' '));
        assert_eq!(curve(&[], 8), "");
        assert_eq!(
            range([-0.0773, -0.0409].into_iter(), "m"),
            "\u{2212}77.3 to \u{2212}40.9 mm"
        );
    }
}
