//! Numbers for a terminal: plain text in columns, the same on a screen and in a pipe.

use super::html::number::{decimals, exponent};
use super::json::{Named, ParameterJson};

/// Prefixes, a thousand times the one before, from 1e-9 on.
const PREFIXES: [&str; 7] = ["n", "u", "m", "", "k", "M", "G"];
/// Units that take a prefix.
const PREFIXED: [&str; 12] = [
    "Pa",
    "s",
    "m",
    "V",
    "Hz",
    "N",
    "N m",
    "N/m",
    "N s/m",
    "N m/rad",
    "N m s/rad",
    "ohm",
];
/// Significant digits of an interval's narrower half, and of a value without one.
const OF_ERROR: usize = 2;
const OF_VALUE: usize = 4;

/// One line a parameter: name, value with its 95 % interval, what it is. Where the recordings do not
/// determine it the line says so, with the interval that is left.
#[must_use]
pub fn parameters(list: &Named<ParameterJson>) -> Vec<String> {
    let rows: Vec<[String; 4]> = list
        .0
        .iter()
        .map(|(name, p)| {
            let [value, interval] = cells(p);
            [name.clone(), value, interval, p.meaning.clone()]
        })
        .collect();
    let width = |column: usize| rows.iter().map(|r| r[column].chars().count()).max();
    let [name, value, interval] = [0, 1, 2].map(|c| width(c).unwrap_or(0));
    let line = |r: &[String; 4]| {
        let [n, v, i, meaning] = r;
        let text = format!("  {n:name$}  {v:value$}  {i:interval$}  {meaning}");
        text.trim_end().to_owned()
    };
    rows.iter().map(line).collect()
}

/// The value and its interval; "open" with what is left of the interval where the recordings do not tell.
fn cells(p: &ParameterJson) -> [String; 2] {
    let value = p.value.unwrap_or(f64::NAN);
    let ends = p.ci95.map(|c| c.map(|v| v.unwrap_or(f64::NAN)));
    let [low, high] = ends.unwrap_or([value; 2]);
    if p.fixed || p.identifiable {
        let (factor, unit) = scaled(value, &p.unit);
        let error = factor * (value - low).min(high - value);
        let places = match error > 0.0 {
            true => decimals(error, OF_ERROR),
            false => decimals(factor * value, OF_VALUE),
        };
        let number = |v: f64| format!("{:.places$}", factor * v);
        let interval = match (p.fixed, ends) {
            (true, _) => "held".into(),
            (false, Some(_)) => format!("{} to {}", number(low), number(high)),
            (false, None) => String::new(),
        };
        return [format!("{}{unit}", number(value)), interval];
    }
    let end = |v: f64| {
        let (factor, unit) = scaled(v, &p.unit);
        let places = decimals(factor * v, OF_ERROR);
        (format!("{:.places$}", factor * v), unit)
    };
    let ((low, low_unit), (high, unit)) = (end(low), end(high));
    let between = match low == "0" || low_unit == unit {
        true => format!("{low} to {high}{unit}"),
        false => format!("{low}{low_unit} to {high}{unit}"),
    };
    ["open".into(), between]
}

/// The factor into a prefixed unit in which a value has one to three digits before the point, and that unit
/// after a space.
fn scaled(value: f64, unit: &str) -> (f64, String) {
    let thousands = match exponent(value, OF_VALUE) {
        Some(e) if PREFIXED.contains(&unit) => e.div_euclid(3).clamp(-3, 3),
        _ => 0,
    };
    let factor = 10f64.powi(-3 * thousands);
    let prefix = PREFIXES[(thousands + 3) as usize];
    match unit {
        "1" | "" => (factor, String::new()),
        _ => (factor, format!(" {prefix}{unit}")),
    }
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
        let lines = parameters(&list);
        let expected = [
            "  mu_1         1.112 MPa  1.080 to 1.144  what it is",
            "  T_5          open       2.1 to 192 s    what it is",
            "  torque_0deg  -300 uN m  -400 to -200    what it is",
            "  J            80.00      held            what it is",
        ];
        assert_eq!(lines, expected);
    }
}
