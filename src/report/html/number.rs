//! Numbers as a reader wants them: digits by the interval, SI prefixes, a real minus sign, groups of three,
//! never the word NaN.

use crate::effects::{by_id, line, plain_name};

/// What stands where there is no number.
pub const MISSING: &str = "n/a";

/// Typographic minus, and groups of three digits from ten thousand on.
fn dress(plain: &str) -> String {
    let (sign, rest) = match plain.strip_prefix('-') {
        Some(rest) if rest.bytes().any(|b| (b'1'..=b'9').contains(&b)) => ("\u{2212}", rest),
        Some(rest) => ("", rest),
        None => ("", plain),
    };
    let (whole, fraction) = rest.split_at(rest.find('.').unwrap_or(rest.len()));
    let mut out = String::from(sign);
    for (i, digit) in whole.chars().enumerate() {
        if i > 0 && whole.len() > 4 && (whole.len() - i) % 3 == 0 {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out + fraction
}

/// `value` with `decimals` places.
pub fn fixed(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return MISSING.into();
    }
    dress(&format!("{value:.decimals$}"))
}

/// Power of ten of the first of `digits` significant digits of `value`; `None` for 0 and what is not finite.
pub fn exponent(value: f64, digits: usize) -> Option<i32> {
    // Rounding may carry into the next decade: 9.96 to two digits is 10, not 10.0.
    let size = format!("{:.*e}", digits.saturating_sub(1), value);
    size.split_once('e')?
        .1
        .parse()
        .ok()
        .filter(|_| value != 0.0)
}

/// Decimal places that show `digits` significant digits of `value`.
pub fn decimals(value: f64, digits: usize) -> usize {
    exponent(value, digits).map_or(0, |e| (digits as i32 - 1 - e).clamp(0, 12) as usize)
}

/// A probability that something is chance.
pub fn chance(probability: f64) -> String {
    match probability {
        p if p < 1e-3 => "< 0.001".into(),
        p => significant(p, 1),
    }
}

/// `value` to `digits` significant digits; powers of ten where it is very large or very small.
pub fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return MISSING.into();
    }
    if value == 0.0 {
        return "0".into();
    }
    if !(1e-4..1e7).contains(&value.abs()) {
        let text = format!("{:.*e}", digits.saturating_sub(1), value);
        let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
        let power: String = exponent
            .chars()
            .map(|c| match c {
                '-' => '\u{207b}',
                '1' => '\u{b9}',
                '2' => '\u{b2}',
                '3' => '\u{b3}',
                c => char::from_u32(0x2070 + c.to_digit(10).unwrap_or(0)).unwrap_or(c),
            })
            .collect();
        return format!("{}\u{2009}\u{d7}\u{2009}10{power}", dress(mantissa));
    }
    fixed(value, decimals(value, digits))
}

/// Significant digits of a value down to the second of its standard error, at most 9; 0 where there is none.
pub fn digits(value: f64, error: f64) -> usize {
    match (exponent(value, 2), exponent(error, 2)) {
        (Some(v), Some(e)) => (v - e + 2).clamp(0, 9) as usize,
        _ => 0,
    }
}

/// A value and its standard error, both to the digit in which the error has two: `1119 ± 12`.
/// The error is `None` where there is none.
pub fn with_error(value: f64, error: f64) -> (String, Option<String>) {
    if !(error.is_finite() && error > 0.0) {
        return (significant(value, 4), None);
    }
    let places = decimals(error, 2);
    (fixed(value, places), Some(fixed(error, places)))
}

/// Prefixes, a thousand times the one before, from 1e-9 on.
const PREFIXES: [&str; 7] = ["n", "\u{b5}", "m", "", "k", "M", "G"];
/// Units that take a prefix, alone or at the beginning of a compound one (`N s^2/m^2`).
const PREFIXED: [&str; 13] = [
    "Pa", "s", "m", "g", "V", "A", "Hz", "N", "Nm", "J", "W", "rad", "\u{3a9}",
];

/// Whether a unit takes a prefix: its first factor does, and is not raised to a power.
fn takes_prefix(unit: &str) -> bool {
    let first = unit.find([' ', '/', '^']).unwrap_or(unit.len());
    PREFIXED.contains(&&unit[..first]) && !unit[first..].starts_with('^')
}

/// A unit as it is printed: powers are raised.
fn printed(unit: &str) -> String {
    unit.replace("^2", "\u{b2}").replace("^3", "\u{b3}")
}

/// The factor into a prefixed unit in which `value` has one to three digits before the point, and that unit;
/// empty for a plain number.
pub fn scaled(value: f64, unit: &str) -> (f64, String) {
    let (of, unit) = match unit.strip_prefix("kg") {
        _ if unit == "1" => (1.0, String::new()),
        Some(rest) if rest.is_empty() || rest.starts_with([' ', '/']) => (1e3, format!("g{rest}")),
        _ => (1.0, unit.replace("ohm", "\u{3a9}")),
    };
    let thousands = match exponent(of * value, 4) {
        Some(e) if takes_prefix(&unit) => e.div_euclid(3).clamp(-3, 3),
        _ => 0,
    };
    let unit = printed(&unit);
    let prefix = PREFIXES[(thousands + 3) as usize];
    (of * 10f64.powi(-3 * thousands), format!("{prefix}{unit}"))
}

/// A value in its prefixed unit, with its 95 % interval: `value` and the ends to the digit in which the
/// narrower half of the interval has two.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Quantity {
    /// The value.
    pub value: String,
    /// `1.08 to 1.14`; empty where there is no interval.
    pub interval: String,
    /// The unit; empty for a plain number.
    pub unit: String,
}

impl Quantity {
    /// Of a value and the ends of its interval (no number, or the value itself, where there is none).
    pub fn new(value: f64, [low, high]: [f64; 2], unit: &str) -> Self {
        let half = (value - low).min(high - value);
        let known = half > 0.0 && half.is_finite();
        let size = if known { half.max(value.abs()) } else { value };
        let (factor, unit) = scaled(size, unit);
        let shown = |v: f64| match known {
            true => fixed(factor * v, decimals(factor * half, 2)),
            false => significant(factor * v, 4),
        };
        Quantity {
            value: shown(value),
            interval: match known {
                true => format!("{} to {}", shown(low), shown(high)),
                false => String::new(),
            },
            unit,
        }
    }

    /// The value with its unit.
    pub fn with_unit(&self) -> String {
        with_unit(&self.value, &self.unit)
    }

    /// `9.8 MΩ (9.1 to 10.5)`.
    pub fn with_interval(&self) -> String {
        match self.interval.as_str() {
            "" => self.with_unit(),
            interval => format!("{} ({interval})", self.with_unit()),
        }
    }
}

/// A number and its unit; alone where it has none.
pub fn with_unit(number: &str, unit: &str) -> String {
    match unit {
        "" => number.into(),
        unit => format!("{number} {unit}"),
    }
}

/// `value` of `unit` with its prefix, to `digits` significant digits.
pub fn sized(value: f64, unit: &str, digits: usize) -> String {
    let (factor, unit) = scaled(value, unit);
    match significant(factor * value, digits) {
        number if number == MISSING => number,
        number => with_unit(&number, &unit),
    }
}

/// A sentence in which no line breaks between a number and its unit, nor inside a unit.
pub fn unbroken(sentence: &str) -> String {
    let mut out = String::with_capacity(sentence.len());
    let mut after = false;
    for (i, word) in sentence.split(' ').enumerate() {
        let unit = after && is_unit(word.trim_end_matches([',', '.', ';', ':', ')']));
        if i > 0 {
            let held = unit || out.ends_with('\u{b1}');
            out.push(if held { '\u{a0}' } else { ' ' });
        }
        out.push_str(word);
        // a unit goes on (`N m`) where no mark ends it
        let number = word.ends_with(|c: char| c.is_ascii_digit() || "⁰¹²³⁴⁵⁶⁷⁸⁹".contains(c));
        after = (number && !unit) || (unit && is_unit(word));
    }
    out
}

/// Whether a word is a unit, or a factor of one.
fn is_unit(word: &str) -> bool {
    let first = word.split(['/', '\u{b2}', '\u{b3}']).next().unwrap_or("");
    let plain = |unit: &str| PREFIXED.contains(&unit) || ["%", "deg", "min", "ppm"].contains(&unit);
    let prefixed = PREFIXES
        .iter()
        .any(|p| !p.is_empty() && first.strip_prefix(p).is_some_and(|u| PREFIXED.contains(&u)));
    plain(first) || prefixed
}

/// `a`, `a and b`, `a, b and c`.
pub fn list(items: &[String]) -> String {
    match items {
        [] => String::new(),
        [only] => only.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

/// A number of things.
pub fn count(n: usize) -> String {
    dress(&n.to_string())
}

/// A share as per cent.
pub fn per_cent(share: f64) -> String {
    if share > 0.0 && share < 0.01 {
        return "below 1 %".into();
    }
    format!("{} %", fixed(100.0 * share, 0))
}

/// Labels of the ticks of an axis: no more decimals than one of them needs.
pub fn tick_labels(values: &[f64]) -> Vec<String> {
    let largest = values.iter().fold(0.0, |a: f64, v| a.max(v.abs()));
    if !(1e-5..1e7).contains(&largest) {
        return values.iter().map(|v| significant(*v, 2)).collect();
    }
    let needed = |v: &f64| {
        (0..8usize)
            .find(|d| {
                let unit = 10f64.powi(*d as i32);
                ((v * unit).round() / unit - v).abs() <= 1e-9 * largest
            })
            .unwrap_or(8)
    };
    let decimals = values.iter().map(needed).max().unwrap_or(0);
    let label = |v: &f64| match *v {
        0.0 => "0".to_string(),
        v => fixed(v, decimals),
    };
    values.iter().map(label).collect()
}

/// A sentence that another part of the program wrote, as a reader wants it: no NaN, inf or phi^2 to stumble
/// over, causes by their names, a real minus, chance without powers of ten.
pub fn words(sentence: &str) -> String {
    let sentence = sentence.replace("phi^2", "\u{3c6}\u{b2}");
    let mut out = String::with_capacity(sentence.len());
    let mut rest = sentence.as_str();
    let mut before = ' ';
    while let Some(c) = rest.chars().next() {
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let end = rest.find(|c| !is_word(c)).unwrap_or(rest.len());
        let begins = matches!(before, ' ' | '(' | '`' | '\n');
        if end > 0 {
            let (word, after) = rest.split_at(end);
            let ends = !after.starts_with(['-', '/', '\\']);
            match word {
                "NaN" | "inf" => out.push_str(MISSING),
                "um" | "uN" if begins && ends => out.push_str(&word.replace('u', "\u{b5}")),
                id if begins && ends && id.contains('_') && is_cause(id) => {
                    out.push_str(&plain_name(id));
                }
                other => out.push_str(other),
            }
            (before, rest) = ('w', after);
            continue;
        }
        rest = &rest[c.len_utf8()..];
        match c {
            '-' if begins && rest.starts_with(|c: char| c.is_ascii_digit()) => {
                out.push('\u{2212}');
            }
            c => out.push(c),
        }
        before = c;
    }
    without_powers(out)
}

fn is_cause(id: &str) -> bool {
    by_id(id).is_some() || line::by_id(id).is_some()
}

/// `p < 1e-15` as `p < 0.001`.
fn without_powers(mut sentence: String) -> String {
    const CHANCE: &str = "p < 1e-";
    while let Some(at) = sentence.find(CHANCE) {
        let digits = sentence[at + CHANCE.len()..]
            .find(|c: char| !c.is_ascii_digit())
            .map_or(sentence.len(), |n| at + CHANCE.len() + n);
        sentence.replace_range(at..digits, "p < 0.001");
    }
    sentence
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_number() {
        assert_eq!(significant(1234.567, 3), "1235");
        assert_eq!(significant(0.012345, 3), "0.0123");
        assert_eq!(significant(-9.96, 2), "\u{2212}10");
        assert_eq!(significant(123456.0, 3), "123\u{202f}456");
        assert_eq!(significant(f64::NAN, 3), "n/a");
        assert_eq!(significant(f64::INFINITY, 3), "n/a");
        assert_eq!(significant(3e-7, 2), "3.0\u{2009}×\u{2009}10⁻⁷");
        assert_eq!(significant(1e12, 1), "1\u{2009}×\u{2009}10¹²");
        assert_eq!(fixed(-0.001, 1), "0.0");
    }

    #[test]
    fn an_error_sets_the_digits_of_its_value() {
        assert_eq!(with_error(1119.8, 12.3), ("1120".into(), Some("12".into())));
        assert_eq!(
            with_error(0.70213, 0.0048),
            ("0.7021".into(), Some("0.0048".into()))
        );
        assert_eq!(with_error(80.0, f64::NAN), ("80.00".into(), None));
        assert_eq!(with_error(-0.3, 250.0), ("0".into(), Some("250".into())));
        assert_eq!(significant(4.2133451, digits(4.2133451, 2.0e-4)), "4.21335");
        assert_eq!((digits(0.78, 1.3), digits(0.78, f64::NAN)), (1, 0));
    }

    #[test]
    fn sentences_lose_nan_but_no_name() {
        assert_eq!(words("error NaN % of it"), "error n/a % of it");
        assert_eq!(words("NaNtes and info: inf"), "NaNtes and info: n/a");
        let says =
            "off by 3 um from -1.1 to -0.07 rad in sym-01 (p < 1e-15): joint_friction, x_stribeck.";
        let words_ = "off by 3 \u{b5}m from \u{2212}1.1 to \u{2212}0.07 rad in sym-01 (p < 0.001): joint friction, stribeck.";
        assert_eq!(words(says), words_);
        let id = "out/joint_friction/report.html, joint_friction-01";
        assert_eq!(words(id), id);
    }

    #[test]
    fn a_quantity_has_the_digits_of_its_interval() {
        let q = |v, ends, unit| {
            let q = Quantity::new(v, ends, unit);
            (q.with_unit(), q.interval)
        };
        let same = |v: &str, i: &str| (v.to_string(), i.to_string());
        assert_eq!(
            q(1_111_799.0, [1_080_068.0, 1_143_529.0], "Pa"),
            same("1.112 MPa", "1.080 to 1.144")
        );
        assert_eq!(q(1.3973, [0.4, 2.4], "1"), same("1.4", "0.4 to 2.4"));
        assert_eq!(
            q(-3e-4, [-4e-4, -2e-4], "N m"),
            same("\u{2212}300 \u{b5}N m", "\u{2212}400 to \u{2212}200")
        );
        assert_eq!(
            q(1e-9, [-5e-3, 5e-3], "N m"),
            same("0.0 mN m", "\u{2212}5.0 to 5.0")
        );
        assert_eq!(q(5.338e-6, [f64::NAN; 2], "kg"), same("5.338 mg", ""));
        assert_eq!(q(9.8e6, [9.8e6; 2], "ohm"), same("9.800 M\u{3a9}", ""));
        assert_eq!(sized(1.669e-3, "V", 3), "1.67 mV");
        assert_eq!(sized(7.5e-7, "N s^2/m^2", 3), "750 nN s\u{b2}/m\u{b2}");
        assert_eq!(sized(1.25e-7, "kg m", 3), "125 \u{b5}g m");
        assert_eq!(sized(5.1e-6, "kg m^2", 2), "5.1 mg m\u{b2}");
        assert_eq!(sized(-1.3e-5, "rad", 2), "\u{2212}13 \u{b5}rad");
        assert_eq!(
            sized(4e7, "m^2", 1),
            "4\u{2009}\u{d7}\u{2009}10\u{2077} m\u{b2}"
        );
        assert_eq!(sized(f64::NAN, "V", 3), "n/a");
    }

    #[test]
    fn a_list_reads_as_a_sentence() {
        let list =
            |items: &[&str]| list(&items.iter().map(|i| (*i).to_owned()).collect::<Vec<_>>());
        assert_eq!(list(&["a", "b", "c"]), "a, b and c");
        assert_eq!(
            (list(&["a", "b"]), list(&["a"]), list(&[])),
            ("a and b".into(), "a".into(), String::new())
        );
    }

    #[test]
    fn a_number_keeps_its_unit() {
        let says = unbroken(
            "300.9 µN m ± 0.92 % at 10°; within 2.6 V rms, 12 N s/m. 3 samples of 56 s; a m",
        );
        let holds =
            "300.9~µN~m ±~0.92~% at 10°; within 2.6~V rms, 12~N~s/m. 3 samples of 56~s; a m";
        assert_eq!(says.replace('\u{a0}', "~"), holds);
    }

    #[test]
    fn ticks_are_short_and_alike() {
        assert_eq!(
            tick_labels(&[0.0, 0.1, 0.30000000000000004]),
            ["0", "0.1", "0.3"]
        );
        assert_eq!(tick_labels(&[0.195, 0.2]), ["0.195", "0.200"]);
        assert_eq!(tick_labels(&[-100.0, 50.0]), ["\u{2212}100", "50"]);
        assert_eq!(tick_labels(&[1e-9]), ["1.0\u{2009}×\u{2009}10⁻⁹"]);
    }
}
