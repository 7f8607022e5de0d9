//! Tables as CSV: predictions and the aligned recording. Comma, point, one header row, LF; the last column
//! `flag` says why cells of a row are empty. Rows are streamed; a number is written to the digit that means
//! something.

use std::io::{self, Write};

use crate::calibration::{LineFit, RecordingOutcome, SampleFit};
use crate::dataset::Dataset;

/// One column of a table.
pub struct Column<'a> {
    name: String,
    decimals: usize,
    value: Box<dyn Fn(usize) -> f64 + 'a>,
}

impl<'a> Column<'a> {
    /// A column: its header (unit included), digits after the point (at most 9), and its value in a row; NaN
    /// leaves the cell empty.
    pub fn new(
        name: impl Into<String>,
        decimals: usize,
        value: impl Fn(usize) -> f64 + 'a,
    ) -> Self {
        Column {
            name: name.into(),
            decimals: decimals.min(9),
            value: Box::new(value),
        }
    }

    /// The header.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The value in a row, every digit; NaN for an empty cell.
    #[must_use]
    pub fn value(&self, row: usize) -> f64 {
        (self.value)(row)
    }

    /// Three columns; `name` has `{}` in the place of x, y, z or 1, 2, 3.
    fn three(
        name: &str,
        labels: [&str; 3],
        decimals: usize,
        value: impl Fn(usize) -> [f64; 3] + Copy + 'a,
    ) -> Vec<Self> {
        (0..3)
            .map(|k| {
                Column::new(name.replace("{}", labels[k]), decimals, move |i| {
                    value(i)[k]
                })
            })
            .collect()
    }
}

/// Digits after the point of a time, s.
const TIME: usize = 6;
/// Digits after the point of a voltage, V.
const VOLT: usize = 4;
/// Digits after the point of a position, mm.
const POSITION: usize = 6;
/// Digits after the point of velocity, mm/s, and acceleration, mm/s^2.
const RATE: usize = 5;
/// Digits after the point of a force, N.
const FORCE: usize = 9;

const AXES: [&str; 3] = ["x", "y", "z"];
const CHAINS: [&str; 3] = ["1", "2", "3"];

/// Writes `value` with a fixed number of digits after the point; nothing for NaN.
pub(super) fn fixed(buffer: &mut Vec<u8>, value: f64, decimals: usize) {
    const TENS: [f64; 10] = [1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9];
    /// Above it not every whole number is a double.
    const EXACT: f64 = 9_007_199_254_740_992.0;
    if value.is_nan() {
        return;
    }
    let scaled = (value.abs() * TENS[decimals]).round();
    if scaled >= EXACT {
        // writing to memory does not fail
        let _ = write!(buffer, "{value}");
        return;
    }
    let mut digits = [b'0'; 40];
    let mut rest = scaled as u64;
    let mut at = digits.len();
    let least = digits.len() - decimals - 1;
    while rest > 0 || at > least {
        at -= 1;
        digits[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    if value < 0.0 && scaled > 0.0 {
        buffer.push(b'-');
    }
    let point = digits.len() - decimals;
    buffer.extend_from_slice(&digits[at..point]);
    if decimals > 0 {
        buffer.push(b'.');
        buffer.extend_from_slice(&digits[point..]);
    }
}

/// Writes a table of `rows` rows. `flag` writes the last cell of a row, without commas, quotes or line
/// breaks.
///
/// # Errors
/// Those of the writer.
pub fn write_table(
    out: &mut (impl Write + ?Sized),
    columns: &[Column<'_>],
    rows: usize,
    flag: impl Fn(usize, &mut Vec<u8>),
) -> io::Result<()> {
    const CHUNK: usize = 1 << 16;
    let mut buffer = Vec::with_capacity(CHUNK + 4096);
    for column in columns {
        buffer.extend_from_slice(column.name.as_bytes());
        buffer.push(b',');
    }
    buffer.extend_from_slice(b"flag\n");
    for i in 0..rows {
        for column in columns {
            fixed(&mut buffer, (column.value)(i), column.decimals);
            buffer.push(b',');
        }
        flag(i, &mut buffer);
        buffer.push(b'\n');
        if buffer.len() >= CHUNK {
            out.write_all(&buffer)?;
            buffer.clear();
        }
    }
    out.write_all(&buffer)
}

/// Why nothing can be predicted at a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Missing {
    /// The frame was not captured.
    Gap,
    /// The mechanism cannot reach the pose: chain and joint.
    OutOfReach(String),
    /// phi^2 < 0 in these chains (1 to 3): no voltage holds the pose.
    Negative(Vec<usize>),
    /// No command makes the voltage that the film of this chain (1 to 3) needs.
    NoCommand(usize),
    /// No voltage is known at the frame.
    NoVoltage,
    /// Anything else.
    Other(String),
}

impl std::fmt::Display for Missing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Missing::Gap => f.write_str("gap"),
            Missing::OutOfReach(why) if why.is_empty() => f.write_str("out of reach"),
            Missing::OutOfReach(why) => write!(f, "out of reach: {why}"),
            Missing::Negative(chains) => {
                f.write_str("phi^2 < 0: chain ")?;
                for (i, chain) in chains.iter().enumerate() {
                    write!(f, "{}{chain}", if i > 0 { " and " } else { "" })?;
                }
                Ok(())
            }
            Missing::NoCommand(chain) => write!(f, "no command: chain {chain}"),
            Missing::NoVoltage => f.write_str("no voltage"),
            Missing::Other(why) => f.write_str(why),
        }
    }
}

/// A flag as it may stand in a cell: no comma, quote or line break.
fn put(buffer: &mut Vec<u8>, flag: &Missing) {
    let start = buffer.len();
    let _ = write!(buffer, "{flag}");
    for byte in &mut buffer[start..] {
        if matches!(byte, b',' | b'"' | b'\n' | b'\r') {
            *byte = b';';
        }
    }
}

/// `pose (..) mm is out of reach: chain 2, bicep (bicep and forearm): ...` becomes `chain 2 elbow`.
fn short_reach(why: &str) -> String {
    match why.split_once("out of reach: ") {
        Some((_, rest)) => {
            let place = rest.split([':', '(']).next().unwrap_or("");
            place.replace(',', "").trim().to_owned()
        }
        None => "singular pose".to_owned(),
    }
}

/// Why nothing is predicted at each frame of a recording.
#[must_use]
pub fn missing(r: &RecordingOutcome) -> Vec<Option<Missing>> {
    let mut out: Vec<Option<Missing>> = (0..r.time_s.len())
        .map(|i| {
            let squared = r.predicted_squared_v2[i];
            let negative: Vec<usize> = (0..3)
                .filter(|&k| squared[k] < 0.0)
                .map(|k| k + 1)
                .collect();
            if !negative.is_empty() {
                Some(Missing::Negative(negative))
            } else if squared.iter().any(|v| !v.is_finite()) {
                Some(Missing::Other("not predicted".to_owned()))
            } else {
                None
            }
        })
        .collect();
    for (i, why) in &r.unreachable {
        if let Some(flag) = out.get_mut(*i) {
            *flag = Some(Missing::OutOfReach(short_reach(why)));
        }
    }
    for (flag, gap) in out.iter_mut().zip(&r.gap) {
        if *gap {
            *flag = Some(Missing::Gap);
        }
    }
    out
}

/// Marks the frames at which no command makes the voltage that a film needs.
pub fn no_command(flags: &mut [Option<Missing>], command_v: &[[f64; 3]]) {
    for (flag, command) in flags.iter_mut().zip(command_v) {
        if flag.is_none() {
            let chain = command.iter().position(|v| v.is_nan());
            *flag = chain.map(|k| Missing::NoCommand(k + 1));
        }
    }
}

/// Columns of predicted voltages: `time_s,phi1_V,phi2_V,phi3_V,phi1_sd_V,phi2_sd_V,phi3_sd_V`. `sd` is what
/// the noise of the capture makes of the prediction. Every frame has its row; see [`Missing`] for the flags.
/// With `command_v`, what the amplifier must be told, that is phi, and `film1_V` to `film3_V` at the end are
/// the voltages on the films.
#[must_use]
pub fn predicted_voltage<'a>(
    r: &'a RecordingOutcome,
    command_v: Option<&'a [[f64; 3]]>,
    flags: &'a [Option<Missing>],
) -> Vec<Column<'a>> {
    let known = move |i: usize, v: [f64; 3]| match &flags[i] {
        None => v,
        Some(Missing::Negative(chains)) => [0, 1, 2].map(|k| {
            if chains.contains(&(k + 1)) {
                f64::NAN
            } else {
                v[k]
            }
        }),
        Some(_) => [f64::NAN; 3],
    };
    let command = move |i: usize| known(i, command_v.map_or(r.predicted_v[i], |c| c[i]));
    let film = move |i: usize| match &flags[i] {
        Some(Missing::NoCommand(_)) => r.predicted_v[i],
        _ => known(i, r.predicted_v[i]),
    };
    let sd = move |i: usize| known(i, r.sd_v.get(i).copied().unwrap_or([f64::NAN; 3]));
    let mut columns = vec![Column::new("time_s", TIME, |i| r.time_s[i])];
    columns.extend(Column::three("phi{}_V", CHAINS, VOLT, command));
    columns.extend(Column::three("phi{}_sd_V", CHAINS, VOLT, sd));
    if command_v.is_some() {
        columns.extend(Column::three("film{}_V", CHAINS, VOLT, film));
    }
    columns
}

/// Why nothing is predicted at each frame of a hanging sample: of its voltage, which follows from the
/// captured x.
#[must_use]
pub fn missing_of_sample(r: &SampleFit) -> Vec<Option<Missing>> {
    (0..r.time_s.len())
        .map(|i| {
            let squared = r.needed_squared_v2[i];
            if r.captured_m[i].is_nan() {
                Some(Missing::Gap)
            } else if squared < 0.0 {
                Some(Missing::Other("phi^2 < 0".to_owned()))
            } else if squared.is_nan() {
                Some(Missing::Other("not predicted".to_owned()))
            } else {
                None
            }
        })
        .collect()
}

/// A column of values, empty where there is a flag.
fn unflagged<'a>(
    name: impl Into<String>,
    decimals: usize,
    flags: &'a [Option<Missing>],
    value: impl Fn(usize) -> f64 + 'a,
) -> Column<'a> {
    Column::new(name, decimals, move |i| match flags[i] {
        None => value(i),
        Some(_) => f64::NAN,
    })
}

/// Columns of the predicted voltage of a hanging sample: `time_s,phi_V,phi_sd_V`, the command that the motion
/// needs.
#[must_use]
pub fn predicted_sample_voltage<'a>(
    r: &'a SampleFit,
    command_v: &'a [f64],
    flags: &'a [Option<Missing>],
) -> Vec<Column<'a>> {
    vec![
        Column::new("time_s", TIME, |i| r.time_s[i]),
        unflagged("phi_V", VOLT, flags, |i| command_v[i]),
        unflagged("phi_sd_V", VOLT, flags, |i| r.sd_v[i]),
    ]
}

/// Columns of the predicted motion of a hanging sample: `time_s,x_mm`, x downwards, zero at rest.
#[must_use]
pub fn predicted_sample_motion<'a>(
    time_s: &'a [f64],
    x_m: &'a [f64],
    flags: &'a [Option<Missing>],
) -> Vec<Column<'a>> {
    vec![
        Column::new("time_s", TIME, |i| time_s[i]),
        unflagged("x_mm", POSITION, flags, |i| x_m[i] * 1e3),
    ]
}

/// Columns of the motion that a model makes of the input of an axis: `time_s`, and the coordinate under the
/// header and in the unit that `column` says, with its factor.
#[must_use]
pub fn predicted_line_motion<'a>(
    r: &'a LineFit,
    (header, factor): (&str, f64),
    flags: &'a [Option<Missing>],
) -> Vec<Column<'a>> {
    vec![
        Column::new("time_s", TIME, |i| r.time_s[i]),
        unflagged(header, FORCE, flags, move |i| factor * r.predicted[i]),
    ]
}

/// Columns of the predicted side of a single coordinate: `time_s`, the coordinate, what was measured and what
/// the model asks for; `names` are the headers of the last three.
#[must_use]
pub fn predicted_line<'a>(r: &'a LineFit, names: &[String; 3]) -> Vec<Column<'a>> {
    let [coordinate, measured, predicted] = names.clone();
    vec![
        Column::new("time_s", TIME, |i| r.time_s[i]),
        Column::new(coordinate, FORCE, |i| r.coordinate[i]),
        Column::new(measured, FORCE, |i| r.measured[i]),
        Column::new(predicted, FORCE, |i| r.predicted[i]),
    ]
}

/// Writes a table with a row for each flag.
///
/// # Errors
/// Those of the writer.
pub fn write_flagged(
    out: &mut (impl Write + ?Sized),
    columns: &[Column<'_>],
    flags: &[Option<Missing>],
) -> io::Result<()> {
    write_table(out, columns, flags.len(), |i, buffer| {
        if let Some(flag) = &flags[i] {
            put(buffer, flag);
        }
    })
}

/// Columns of a predicted force: `time_s,Fx_N,Fy_N,Fz_N`; world axes, N. A frame with a flag has empty cells.
#[must_use]
pub fn predicted_force<'a>(
    time_s: &'a [f64],
    force_n: &'a [[f64; 3]],
    flags: &'a [Option<Missing>],
) -> Vec<Column<'a>> {
    vectors(time_s, force_n, flags, ("F{}_N", FORCE, 1.0))
}

/// Columns of a predicted motion: `time_s,x_mm,y_mm,z_mm`; world axes, from m. A frame with a flag has empty
/// cells.
#[must_use]
pub fn predicted_motion<'a>(
    time_s: &'a [f64],
    position_m: &'a [[f64; 3]],
    flags: &'a [Option<Missing>],
) -> Vec<Column<'a>> {
    vectors(time_s, position_m, flags, ("{}_mm", POSITION, 1e3))
}

fn vectors<'a>(
    time_s: &'a [f64],
    values: &'a [[f64; 3]],
    flags: &'a [Option<Missing>],
    (name, decimals, factor): (&str, usize, f64),
) -> Vec<Column<'a>> {
    let value = move |i: usize| match &flags[i] {
        None => values[i].map(|v| v * factor),
        Some(_) => [f64::NAN; 3],
    };
    let mut columns = vec![Column::new("time_s", TIME, |i| time_s[i])];
    columns.extend(Column::three(name, AXES, decimals, value));
    columns
}

/// The aligned recording, on the motion clock, world axes: raw and smoothed position (mm), velocity (mm/s),
/// acceleration (mm/s^2), command and, where there is one, monitor of each chain (V, shifted by `offset_s`),
/// payload (g), flag: `gap` (nothing captured, nothing usable), `gap bridged` (smoothed values go on),
/// `no voltage`.
///
/// # Errors
/// Those of the writer.
pub fn aligned(out: &mut (impl Write + ?Sized), d: &Dataset, offset_s: f64) -> io::Result<()> {
    let usable = |i: usize, v: [f64; 3]| if d.usable[i] { v } else { [f64::NAN; 3] };
    let raw = |i: usize| d.measured_m[i].map(|v| v * 1e3);
    let position = |i: usize| usable(i, [0, 1, 2].map(|k| d.axes[k].position[i] * 1e3));
    let velocity = |i: usize| usable(i, [0, 1, 2].map(|k| d.axes[k].velocity[i] * 1e3));
    let acceleration = |i: usize| usable(i, [0, 1, 2].map(|k| d.axes[k].acceleration[i] * 1e3));
    let commands: Vec<[f64; 3]> = (0..d.samples())
        .map(|i| match d.has_voltage(i, offset_s) {
            true => [0, 1, 2].map(|k| d.command_v(k, i, offset_s)),
            false => [f64::NAN; 3],
        })
        .collect();
    let command = |i: usize| commands[i];
    let monitors: Vec<[f64; 3]> = d
        .monitor
        .iter()
        .flat_map(|m| {
            let slack = 0.5 * d.step_s;
            let known = m.span_s().0 - slack..=m.span_s().1 + slack;
            (0..d.samples()).map(move |i| {
                let t = d.time_s(i) + offset_s;
                match known.contains(&t) {
                    true => [0, 1, 2].map(|k| m.at(k, t)),
                    false => [f64::NAN; 3],
                }
            })
        })
        .collect();
    let monitor = |i: usize| monitors[i];
    let mut columns = vec![Column::new("time_s", TIME, |i| d.time_s(i))];
    columns.extend(Column::three("{}_raw_mm", AXES, POSITION, raw));
    columns.extend(Column::three("{}_mm", AXES, POSITION, position));
    columns.extend(Column::three("v{}_mm_s", AXES, RATE, velocity));
    columns.extend(Column::three("a{}_mm_s2", AXES, RATE, acceleration));
    columns.extend(Column::three("phi{}_V", CHAINS, VOLT, command));
    if d.monitor.is_some() {
        columns.extend(Column::three("phi{}_monitor_V", CHAINS, VOLT, monitor));
    }
    columns.push(Column::new("payload_g", 4, |i| d.payload_kg[i] * 1e3));
    write_table(out, &columns, d.samples(), |i, buffer| {
        buffer.extend_from_slice(match (d.captured(i), d.usable[i]) {
            (false, true) => b"gap bridged",
            (false, false) => b"gap",
            (true, _) if !d.has_voltage(i, offset_s) => b"no voltage",
            (true, _) => b"",
        });
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(value: f64, decimals: usize) -> String {
        let mut buffer = Vec::new();
        fixed(&mut buffer, value, decimals);
        String::from_utf8(buffer).unwrap()
    }

    #[test]
    fn numbers_are_written_to_the_digit() {
        assert_eq!(text(1234.56789, 4), "1234.5679");
        assert_eq!(text(-0.25, 2), "-0.25");
        assert_eq!(text(-0.00001, 4), "0.0000");
        assert_eq!(text(0.0, 3), "0.000");
        assert_eq!(text(-7.0, 0), "-7");
        assert_eq!(text(f64::NAN, 3), "");
        assert_eq!(text(1e300, 3).parse::<f64>().unwrap(), 1e300);
        for i in 0..2000 {
            let v = f64::from(i).sin() * 7e3;
            let back: f64 = text(v, 6).parse().unwrap();
            assert!((back - v).abs() <= 0.5e-6 + 1e-12, "{v}");
        }
    }

    #[test]
    fn the_models_words_become_a_short_flag() {
        let error = crate::kinematics::OutOfReach {
            pose_m: [0.0, 0.0, 1.0],
            chain: 2,
            joint: crate::kinematics::Joint::Elbow,
            quantity: "cos",
            value: 2.0,
            low: -1.0,
            high: 1.0,
        };
        let flag = Missing::OutOfReach(short_reach(&error.to_string()));
        assert_eq!(flag.to_string(), "out of reach: chain 2 bicep");
        let flag = Missing::OutOfReach(short_reach("the actuators hold no force"));
        assert_eq!(flag.to_string(), "out of reach: singular pose");
        assert_eq!(
            Missing::Negative(vec![1, 3]).to_string(),
            "phi^2 < 0: chain 1 and 3"
        );
    }
}
