//! SI at the door: constants, and the conversions between the units that files carry and SI.

/// Standard acceleration of gravity, m/s^2 (model.md section 1).
pub const GRAVITY_M_S2: f64 = 9.80665;
/// Vacuum permittivity, F/m (model.md section 3).
pub const VACUUM_PERMITTIVITY_F_M: f64 = 8.8541878128e-12;

/// What a unit measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// second
    Time,
    /// metre
    Length,
    /// radian
    Angle,
    /// volt
    Voltage,
    /// ampere
    Current,
    /// newton
    Force,
    /// newton metre
    Torque,
    /// pascal
    Stress,
    /// kilogram
    Mass,
    /// metre per second
    Velocity,
    /// radian per second
    AngularVelocity,
    /// a pure number (stretch, strain)
    Ratio,
}

/// A unit that a file may carry: its symbol, what it measures, and the factor to SI.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// As this program writes it: `kV`, `N m`.
    pub symbol: &'static str,
    /// What it measures.
    pub dimension: Dimension,
    /// SI value = file value * `to_si`.
    pub to_si: f64,
}

const fn unit(symbol: &'static str, dimension: Dimension, to_si: f64) -> Unit {
    Unit {
        symbol,
        dimension,
        to_si,
    }
}

/// How times of one table are written: a unit in which the largest is short, with the digits that tell its
/// samples apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeScale {
    symbol: &'static str,
    per_s: f64,
    digits: usize,
}

impl TimeScale {
    /// For times up to `largest_s` with `step_s` between samples, s. Steps of half a millisecond and more,
    /// and times beyond a second, are written in s.
    #[must_use]
    pub fn new(largest_s: f64, step_s: Option<f64>) -> Self {
        let step_s = step_s.filter(|s| s.is_finite() && *s > 0.0).unwrap_or(1e-3);
        let (symbol, per_s) = match largest_s.abs() {
            largest if step_s >= 5e-4 || largest >= 1.0 || largest.is_nan() => ("s", 1.0),
            largest if largest >= 1e-3 => ("ms", 1e3),
            largest if largest >= 1e-6 => ("us", 1e6),
            _ => ("ns", 1e9),
        };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let digits = (-(step_s * per_s).log10() - 1e-9).ceil().clamp(0.0, 9.0) as usize;
        let digits = match symbol {
            "s" => digits.max(3),
            _ => digits,
        };
        TimeScale {
            symbol,
            per_s,
            digits,
        }
    }

    /// A time without its unit.
    #[must_use]
    pub fn number(&self, time_s: f64) -> String {
        let text = format!("{:.*}", self.digits, time_s * self.per_s);
        // nothing before zero: -0.000 is 0.000
        match text.strip_prefix('-') {
            Some(bare) if bare.bytes().all(|b| matches!(b, b'0' | b'.')) => bare.to_owned(),
            _ => text,
        }
    }

    /// A time with its unit: `0.250 s`, `-300.0 ns`.
    #[must_use]
    pub fn text(&self, time_s: f64) -> String {
        format!("{} {}", self.number(time_s), self.symbol)
    }
}

const UNITS: &[Unit] = &[
    unit("s", Dimension::Time, 1.0),
    unit("ms", Dimension::Time, 1e-3),
    unit("us", Dimension::Time, 1e-6),
    unit("ns", Dimension::Time, 1e-9),
    unit("min", Dimension::Time, 60.0),
    unit("m", Dimension::Length, 1.0),
    unit("cm", Dimension::Length, 1e-2),
    unit("mm", Dimension::Length, 1e-3),
    unit("um", Dimension::Length, 1e-6),
    unit("rad", Dimension::Angle, 1.0),
    unit("deg", Dimension::Angle, std::f64::consts::PI / 180.0),
    unit("V", Dimension::Voltage, 1.0),
    unit("kV", Dimension::Voltage, 1e3),
    unit("mV", Dimension::Voltage, 1e-3),
    unit("uV", Dimension::Voltage, 1e-6),
    unit("A", Dimension::Current, 1.0),
    unit("mA", Dimension::Current, 1e-3),
    unit("uA", Dimension::Current, 1e-6),
    unit("nA", Dimension::Current, 1e-9),
    unit("N", Dimension::Force, 1.0),
    unit("mN", Dimension::Force, 1e-3),
    unit("kN", Dimension::Force, 1e3),
    unit("N m", Dimension::Torque, 1.0),
    unit("N mm", Dimension::Torque, 1e-3),
    unit("mN m", Dimension::Torque, 1e-3),
    unit("Pa", Dimension::Stress, 1.0),
    unit("kPa", Dimension::Stress, 1e3),
    unit("MPa", Dimension::Stress, 1e6),
    unit("GPa", Dimension::Stress, 1e9),
    unit("bar", Dimension::Stress, 1e5),
    unit("kg", Dimension::Mass, 1.0),
    unit("g", Dimension::Mass, 1e-3),
    unit("m/s", Dimension::Velocity, 1.0),
    unit("mm/s", Dimension::Velocity, 1e-3),
    unit("rad/s", Dimension::AngularVelocity, 1.0),
    unit(
        "deg/s",
        Dimension::AngularVelocity,
        std::f64::consts::PI / 180.0,
    ),
    unit("1", Dimension::Ratio, 1.0),
    unit("%", Dimension::Ratio, 1e-2),
];

/// Other spellings that instruments write. Words are compared without regard to case, symbols with.
const SPELLINGS: &[(&str, &str)] = &[
    ("N.m", "N m"),
    ("N*m", "N m"),
    ("N·m", "N m"),
    ("N_m", "N m"),
    ("Nm", "N m"),
    ("N.mm", "N mm"),
    ("Nmm", "N mm"),
    ("mNm", "mN m"),
    ("µs", "us"),
    ("μs", "us"),
    ("µm", "um"),
    ("μm", "um"),
    ("µV", "uV"),
    ("μV", "uV"),
    ("µA", "uA"),
    ("μA", "uA"),
    ("°", "deg"),
    ("-", "1"),
];

const WORDS: &[(&str, &str)] = &[
    ("second", "s"),
    ("seconds", "s"),
    ("sec", "s"),
    ("millisecond", "ms"),
    ("milliseconds", "ms"),
    ("msec", "ms"),
    ("volt", "V"),
    ("volts", "V"),
    ("kilovolt", "kV"),
    ("kilovolts", "kV"),
    ("degree", "deg"),
    ("degrees", "deg"),
    ("radian", "rad"),
    ("radians", "rad"),
    ("newton", "N"),
    ("newtons", "N"),
    ("metre", "m"),
    ("meter", "m"),
    ("meters", "m"),
    ("metres", "m"),
    ("millimeter", "mm"),
    ("millimeters", "mm"),
    ("millimetre", "mm"),
    ("millimetres", "mm"),
    ("centimeter", "cm"),
    ("centimeters", "cm"),
    ("centimetre", "cm"),
    ("centimetres", "cm"),
    ("ampere", "A"),
    ("amp", "A"),
    ("amps", "A"),
    ("percent", "%"),
];

impl Unit {
    /// The unit that `text` spells, or `None`.
    #[must_use]
    pub fn parse(text: &str) -> Option<&'static Unit> {
        let text = text.trim();
        let by_symbol = |symbol: &str| UNITS.iter().find(|u| u.symbol == symbol);
        by_symbol(text)
            .or_else(|| {
                let (_, symbol) = SPELLINGS.iter().find(|(s, _)| *s == text)?;
                by_symbol(symbol)
            })
            .or_else(|| {
                let (_, symbol) = WORDS.iter().find(|(w, _)| w.eq_ignore_ascii_case(text))?;
                by_symbol(symbol)
            })
    }

    /// The symbols of every unit of one dimension, for messages.
    #[must_use]
    pub fn symbols(dimension: Dimension) -> Vec<&'static str> {
        UNITS
            .iter()
            .filter(|u| u.dimension == dimension)
            .map(|u| u.symbol)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spellings_lead_to_one_unit() {
        assert_eq!(Unit::parse("Volt").unwrap().symbol, "V");
        assert_eq!(Unit::parse(" kV ").unwrap().to_si, 1000.0);
        assert_eq!(Unit::parse("N.mm").unwrap().to_si, 1e-3);
        assert_eq!(Unit::parse("Nm").unwrap().dimension, Dimension::Torque);
        assert_eq!(Unit::parse("ms").unwrap().to_si, 1e-3);
        // case tells milli from mega
        assert_eq!(Unit::parse("MPA"), None);
        assert_eq!(Unit::parse("kv"), None);
        assert_eq!(Unit::parse(""), None);
    }

    #[test]
    fn times_are_told_apart_however_short() {
        let text = |largest, step, t| TimeScale::new(largest, Some(step)).text(t);
        assert_eq!(text(0.25, 2.5e-4, -0.25), "-250.0 ms");
        assert_eq!(text(4.0, 0.01, 3.933_333), "3.933 s");
        assert_eq!(text(0.5, 0.001, 0.127), "0.127 s");
        assert_eq!(text(3e-7, 5e-10, -3e-7), "-300.0 ns");
        assert_eq!(text(3.5e-4, 3.906_25e-5, 3.515_625e-4), "352 us");
        assert_eq!(text(12.0, 1e-5, 12.000_01), "12.00001 s");
        assert_eq!(text(1e9, 1e-6, 1e9), "1000000000.000000 s");
        assert_eq!(text(0.0, 1e-6, 0.0), "0 ns");
        assert_eq!(text(6e-3, 1e-3, -1e-9), "0.000 s");
        assert_eq!(TimeScale::new(2.0, None).text(1.5), "1.500 s");
    }

    #[test]
    fn every_spelling_names_a_unit() {
        for (spelling, symbol) in SPELLINGS.iter().chain(WORDS) {
            assert_eq!(Unit::parse(spelling).map(|u| u.symbol), Some(*symbol));
        }
    }
}
