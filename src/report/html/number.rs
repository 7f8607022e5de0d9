//! Numbers as a reader wants them: few digits, a real minus sign, groups of three, never the word NaN.

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

/// A sentence that another part of the program wrote, without NaN, inf and phi^2 for a reader to stumble
/// over.
pub fn words(sentence: &str) -> String {
    let sentence = sentence.replace("phi^2", "\u{3c6}\u{b2}");
    let mut out = String::with_capacity(sentence.len());
    let mut word = String::new();
    for c in sentence.chars().chain(['\0']) {
        if c.is_alphanumeric() || c == '_' {
            word.push(c);
            continue;
        }
        out.push_str(match word.as_str() {
            "NaN" | "inf" => MISSING,
            other => other,
        });
        word.clear();
        if c != '\0' {
            out.push(c);
        }
    }
    out
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
