//! A simulated motion as the instruments would have written it: Vicon Nexus CSV, a voltage table and the
//! recording.toml that names them. The caller gives the writers; this room opens no file.
//!
//! All randomness comes from ChaCha12 (crate `rand_chacha`) with the capture's seed; the end effector's white
//! and coloured noise and the base marker's noise are separate streams, so that a gap or another source of
//! noise changes nothing elsewhere. The same input and seed give the same bytes.

use std::io::{self, Write};

use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

use super::voltage::{Hold, Sampled};
use super::{Error, SampleOptions, sample_motion};
use crate::film::Film;
use crate::kinematics::Vec3;
use crate::model::HangingSample;

/// Where the markers are and how the capture's axes lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Base marker in the world W, m.
    pub base_position_m: Vec3,
    /// From the centre of the end effector to its marker, in W, m.
    pub end_effector_offset_m: Vec3,
    /// Capture axes to W, deg: v_W = Rx Ry Rz v_capture.
    pub rotation_deg: Vec3,
}

impl Default for Placement {
    fn default() -> Self {
        Placement {
            base_position_m: [0.0; 3],
            end_effector_offset_m: [0.0; 3],
            rotation_deg: [0.0; 3],
        }
    }
}

/// Noise of a marker, each coordinate by itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// Standard deviation of the white part, m.
    pub white_m: f64,
    /// Standard deviation of the coloured part, a first-order autoregression, m.
    pub coloured_m: f64,
    /// Its correlation time, s.
    pub correlation_s: f64,
}

/// A motion capture system.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Frames a second, Hz.
    pub rate_hz: f64,
    /// Number of the first frame (frame f is taken at (f - 1)/rate).
    pub first_frame: u64,
    /// Name of the end effector's marker.
    pub end_effector: String,
    /// Name of the base marker.
    pub base: String,
    /// Base marker in the capture's own axes, m.
    pub base_in_capture_m: Vec3,
    /// True places of the markers.
    pub placement: Placement,
    /// Noise of either marker.
    pub noise: Noise,
    /// Gaps of the end effector's marker: first frame of the gap counted from 0, and its length.
    pub gaps: Vec<(usize, usize)>,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for Capture {
    /// 100 Hz, 0.03 mm of white noise, no gap, seed 0.
    fn default() -> Self {
        Capture {
            rate_hz: 100.0,
            first_frame: 1,
            end_effector: "DEA:EE".into(),
            base: "DEA:Base".into(),
            base_in_capture_m: [0.0; 3],
            placement: Placement::default(),
            noise: Noise {
                white_m: 3e-5,
                ..Noise::default()
            },
            gaps: Vec::new(),
            seed: 0,
        }
    }
}

/// (Rx Ry Rz)^T applied to a vector of W: its coordinates in the capture's axes.
fn into_capture(rotation_deg: Vec3, v: Vec3) -> Vec3 {
    let [x, y, z] = rotation_deg.map(f64::to_radians);
    // Rx^T first, then Ry^T, then Rz^T.
    let (s, c) = x.sin_cos();
    let v = [v[0], c * v[1] + s * v[2], c * v[2] - s * v[1]];
    let (s, c) = y.sin_cos();
    let v = [c * v[0] - s * v[2], v[1], c * v[2] + s * v[0]];
    let (s, c) = z.sin_cos();
    [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]]
}

/// Noise of one marker.
struct MarkerNoise {
    noise: Noise,
    white: ChaCha12Rng,
    coloured: ChaCha12Rng,
    keep: f64,
    renew: f64,
    state: Vec3,
}

impl MarkerNoise {
    fn new(noise: Noise, seed: u64, marker: u64, rate_hz: f64) -> Self {
        let generator = |stream| {
            let mut generator = ChaCha12Rng::seed_from_u64(seed);
            generator.set_stream(2 * marker + stream);
            generator
        };
        let mut coloured = generator(1);
        // x[i+1] = r x[i] + sqrt(1 - r^2) n, r = exp(-dt/tau): begins in its stationary state.
        let keep = if noise.correlation_s > 0.0 {
            (-1.0 / (rate_hz * noise.correlation_s)).exp()
        } else {
            0.0
        };
        let state = [(); 3].map(|()| StandardNormal.sample(&mut coloured));
        MarkerNoise {
            noise,
            white: generator(0),
            coloured,
            keep,
            renew: (1.0 - keep * keep).sqrt(),
            state,
        }
    }

    fn next(&mut self) -> Vec3 {
        let mut out = [0.0; 3];
        for i in 0..3 {
            let white: f64 = StandardNormal.sample(&mut self.white);
            out[i] = self.noise.white_m * white + self.noise.coloured_m * self.state[i];
            let fresh: f64 = StandardNormal.sample(&mut self.coloured);
            self.state[i] = self.keep * self.state[i] + self.renew * fresh;
        }
        out
    }
}

/// Writes a Vicon Nexus CSV: the end effector's and the base marker's trajectory, mm with three decimals,
/// CRLF, gaps as empty cells. `position_m` is the centre of the end effector in W at the capture's rate.
///
/// # Errors
/// The writer's.
pub fn nexus_csv(out: &mut impl Write, capture: &Capture, position_m: &[Vec3]) -> io::Result<()> {
    let Capture {
        end_effector, base, ..
    } = capture;
    write!(out, "Trajectories\r\n{}\r\n", capture.rate_hz)?;
    write!(out, ",,{end_effector},,,{base},,\r\n")?;
    write!(
        out,
        "Frame,Sub Frame,X,Y,Z,X,Y,Z\r\n,,mm,mm,mm,mm,mm,mm\r\n"
    )?;
    let mut effector = MarkerNoise::new(capture.noise, capture.seed, 0, capture.rate_hz);
    let mut base = MarkerNoise::new(capture.noise, capture.seed, 1, capture.rate_hz);
    let place = &capture.placement;
    for (i, u) in position_m.iter().enumerate() {
        let (noise, base_noise) = (effector.next(), base.next());
        write!(out, "{},0", capture.first_frame + i as u64)?;
        let gap = capture
            .gaps
            .iter()
            .any(|&(first, length)| i >= first && i - first < length);
        if gap {
            write!(out, ",,,")?;
        } else {
            let w =
                [0, 1, 2].map(|j| u[j] + place.end_effector_offset_m[j] - place.base_position_m[j]);
            let v = into_capture(place.rotation_deg, w);
            for j in 0..3 {
                let value = capture.base_in_capture_m[j] + v[j] + noise[j];
                out.write_all(b",")?;
                fixed(out, value * 1e3, 3)?;
            }
        }
        for j in 0..3 {
            let value = capture.base_in_capture_m[j] + base_noise[j];
            out.write_all(b",")?;
            fixed(out, value * 1e3, 3)?;
        }
        write!(out, "\r\n")?;
    }
    Ok(())
}

/// How the voltage is logged.
#[derive(Debug, Clone, PartialEq)]
pub struct VoltageLog {
    /// Names of the columns, one a channel (three, or one for a film sample).
    pub channels: Vec<String>,
    /// Voltage clock minus motion clock, s.
    pub clock_offset_s: f64,
    /// The smallest step of the converter, V (0: none).
    pub quantum_v: f64,
}

impl Default for VoltageLog {
    /// Three channels in kV, in steps of 0.1 V, on the motion's clock.
    fn default() -> Self {
        VoltageLog {
            channels: ["phi1_kV", "phi2_kV", "phi3_kV"].map(String::from).to_vec(),
            clock_offset_s: 0.0,
            quantum_v: 0.1,
        }
    }
}

/// The fewest decimals (from `least` to 9) with which every one of `values` is written to within 1e-10.
fn decimals(values: &[f64], least: usize) -> usize {
    (least..9)
        .find(|&d| {
            let scale = 10f64.powi(d as i32);
            values
                .iter()
                .all(|v| ((v * scale).round() / scale - v).abs() < 1e-10)
        })
        .unwrap_or(9)
}

/// Writes a voltage table: time_s and one column in kV a channel.
///
/// # Errors
/// The writer's, and one when there is no channel or there are more than three.
pub fn voltage_csv(out: &mut impl Write, log: &VoltageLog, drive: &Sampled) -> io::Result<()> {
    if !(1..=3).contains(&log.channels.len()) {
        let text = format!(
            "a voltage table has one to three channels, not {}",
            log.channels.len()
        );
        return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    }
    writeln!(out, "time_s,{}", log.channels.join(","))?;
    let start = drive.start_s() + log.clock_offset_s;
    let places = decimals(&[start, drive.step_s()], 3);
    let kilo = decimals(&[log.quantum_v * 1e-3], 4);
    for (i, phi) in drive.samples_v().iter().enumerate() {
        fixed(out, start + i as f64 * drive.step_s(), places)?;
        for phi in phi.iter().take(log.channels.len()) {
            let quantised = if log.quantum_v > 0.0 {
                (phi / log.quantum_v).round() * log.quantum_v
            } else {
                *phi
            };
            out.write_all(b",")?;
            fixed(out, (quantised * 1e-3 * 1e9).round() / 1e9, kilo)?;
        }
        out.write_all(b"\n")?;
    }
    Ok(())
}

/// Writes a number with so many digits after the point, without a sign where that leaves zero: in whole units
/// of the last digit, which is quicker than exact decimals and differs from them in ties alone.
fn fixed(out: &mut impl Write, value: f64, places: usize) -> io::Result<()> {
    const WHOLE: f64 = 9_007_199_254_740_992.0; // from 2^53 on not every integer is a number
    let units = (value * 10f64.powi(places as i32)).round();
    if units.is_nan() || units.abs() >= WHOLE {
        return write!(out, "{value:.places$}");
    }
    let mut left = units.abs() as u64;
    let mut text = [b'0'; 32];
    let mut at = text.len();
    for place in 0.. {
        if place == places && places > 0 {
            at -= 1;
            text[at] = b'.';
        }
        if left == 0 && place > places {
            break;
        }
        at -= 1;
        text[at] = b'0' + (left % 10) as u8;
        left /= 10;
    }
    if units < 0.0 {
        at -= 1;
        text[at] = b'-';
    }
    out.write_all(&text[at..])
}

/// What recording.toml says: what the user believes, which need not be what was simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingText {
    /// Name of the recording.
    pub id: String,
    /// "robot" or "film-sample".
    pub kind: String,
    /// Path of the rig file as it shall be written.
    pub rig: String,
    /// Payload: (time s, mass kg); the first time is that of the first sample.
    pub payload_kg: Vec<(f64, f64)>,
    /// "relaxed" or "virgin".
    pub film_state: String,
    /// Further lines of the `recording` table in their order: batch, electrode, day, series ...
    pub labels: Vec<(String, String)>,
    /// Name of the motion file.
    pub motion_file: String,
    /// Declared places of the markers.
    pub placement: Placement,
    /// Name of the voltage file.
    pub voltage_file: String,
    /// What the amplifier does between samples.
    pub hold: Hold,
    /// Declared clock offset, s; none asks the tool to estimate it.
    pub offset_s: Option<f64>,
}

impl Default for RecordingText {
    fn default() -> Self {
        RecordingText {
            id: "simulated".into(),
            kind: "robot".into(),
            rig: "rig.toml".into(),
            payload_kg: vec![(0.0, 0.0)],
            film_state: "relaxed".into(),
            labels: Vec::new(),
            motion_file: "motion.csv".into(),
            placement: Placement::default(),
            voltage_file: "voltage.csv".into(),
            hold: Hold::Linear,
            offset_s: Some(0.0),
        }
    }
}

/// The files of a recording of a hanging sample, by the names that `recording.toml` gives them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SampleFiles {
    /// `recording.toml`.
    pub recording_toml: Vec<u8>,
    /// The capture.
    pub motion_csv: Vec<u8>,
    /// The voltage log.
    pub voltage_csv: Vec<u8>,
}

/// Runs a hanging sample over `drive` (channel 1) from rest and writes the recording: the free end's marker
/// moves along the world's Z, the top of the sample is at `top_m` above the origin. `text.kind` and the
/// channels of `log` are set to those of a sample.
///
/// # Errors
/// Those of [`sample_motion`].
pub fn sample_recording(
    sample: &HangingSample,
    film: &Film,
    drive: &Sampled,
    top_m: f64,
    capture: &Capture,
    text: &RecordingText,
    log: &VoltageLog,
) -> Result<SampleFiles, Error> {
    let step_s = 1.0 / capture.rate_hz;
    let start_s = (capture.first_frame.max(1) - 1) as f64 * step_s;
    let options = SampleOptions {
        sample_step_s: step_s,
        start_s,
        duration_s: drive.start_s() + drive.duration_s() - start_s,
        ..SampleOptions::default()
    };
    let motion = sample_motion(sample, film, drive, &options)?;
    let position: Vec<Vec3> = motion
        .x_m
        .iter()
        .map(|x| [0.0, 0.0, top_m - motion.rest_length_m - x])
        .collect();
    let text = RecordingText {
        kind: "film-sample".into(),
        ..text.clone()
    };
    let log = VoltageLog {
        channels: vec!["phi_kV".into()],
        ..log.clone()
    };
    let mut files = SampleFiles {
        recording_toml: Vec::new(),
        motion_csv: Vec::new(),
        voltage_csv: Vec::new(),
    };
    let written = nexus_csv(&mut files.motion_csv, capture, &position)
        .and_then(|()| voltage_csv(&mut files.voltage_csv, &log, drive))
        .and_then(|()| recording_toml(&mut files.recording_toml, &text, capture, &log));
    written.map_err(|e| Error::Refused(e.to_string()))?;
    Ok(files)
}

/// A TOML string.
fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}

/// Rounds away what conversion to a file's unit leaves in the last digits.
fn tidy(value: f64) -> f64 {
    (value * 1e9).round() / 1e9 + 0.0
}

/// Writes recording.toml for a capture and a voltage log.
///
/// # Errors
/// The writer's.
pub fn recording_toml(
    out: &mut impl Write,
    text: &RecordingText,
    capture: &Capture,
    log: &VoltageLog,
) -> io::Result<()> {
    let list = |v: Vec3, scale: f64| {
        let [x, y, z] = v.map(|v| tidy(v * scale));
        format!("[{x:?}, {y:?}, {z:?}]")
    };
    writeln!(out, "[recording]")?;
    writeln!(out, "id = {}", quoted(&text.id))?;
    writeln!(out, "kind = {}", quoted(&text.kind))?;
    writeln!(out, "rig = {}", quoted(&text.rig))?;
    match text.payload_kg.as_slice() {
        [] => writeln!(out, "payload_g = 0.0")?,
        [(_, mass)] => writeln!(out, "payload_g = {:?}", tidy(mass * 1e3))?,
        steps => {
            let rows: Vec<String> = steps
                .iter()
                .map(|(t, m)| format!("[{:?}, {:?}]", tidy(*t), tidy(m * 1e3)))
                .collect();
            writeln!(out, "payload_g = [{}]", rows.join(", "))?;
        }
    }
    writeln!(out, "film_state = {}", quoted(&text.film_state))?;
    for (key, value) in &text.labels {
        match key.as_str() {
            "day" => writeln!(out, "{key} = {value}")?,
            _ => writeln!(out, "{key} = {}", quoted(value))?,
        }
    }
    writeln!(out, "\n[motion]")?;
    writeln!(out, "file = {}", quoted(&text.motion_file))?;
    writeln!(out, "format = \"nexus-csv\"")?;
    writeln!(out, "end_effector = {}", quoted(&capture.end_effector))?;
    writeln!(out, "base = {}", quoted(&capture.base))?;
    let place = &text.placement;
    writeln!(
        out,
        "base_position_mm = {}",
        list(place.base_position_m, 1e3)
    )?;
    let offset = list(place.end_effector_offset_m, 1e3);
    writeln!(out, "end_effector_offset_mm = {offset}")?;
    writeln!(out, "rotation_deg = {}", list(place.rotation_deg, 1.0))?;
    writeln!(out, "\n[voltage]")?;
    writeln!(out, "file = {}", quoted(&text.voltage_file))?;
    writeln!(out, "time = \"time_s\"")?;
    let channels: Vec<String> = log.channels.iter().map(|c| quoted(c)).collect();
    writeln!(out, "channels = [{}]", channels.join(", "))?;
    writeln!(out, "unit = \"kV\"")?;
    if text.hold == Hold::Previous {
        writeln!(out, "hold = \"previous\"")?;
    }
    writeln!(out, "\n[sync]")?;
    match text.offset_s {
        Some(offset) => writeln!(out, "offset_s = {:?}", tidy(offset)),
        None => writeln!(out, "offset_s = \"estimate\""),
    }
}

#[cfg(test)]
mod tests {
    use super::fixed;

    #[test]
    fn numbers_are_those_of_exact_decimals() {
        let of = |value: f64, places: usize| {
            let mut out = Vec::new();
            fixed(&mut out, value, places).unwrap();
            String::from_utf8(out).unwrap()
        };
        let mut value = 0.123_456_789;
        for i in 0..20_000 {
            value = (value * 1.618_034) % 7919.3;
            let (signed, places) = (if i % 2 == 0 { value } else { -value }, i % 10);
            let exact = format!("{signed:.places$}");
            let unsigned_zero = exact.trim_matches(['-', '0', '.']).is_empty();
            let exact = if unsigned_zero {
                exact.trim_start_matches('-')
            } else {
                &exact
            };
            assert_eq!(of(signed, places), exact, "{signed:e} {places}");
        }
        assert_eq!(of(-0.0, 3), "0.000");
        assert_eq!(of(-1e-5, 3), "0.000");
        assert_eq!(of(0.001, 3), "0.001");
        assert_eq!(of(7.0, 0), "7");
        assert_eq!(of(1e300, 1), format!("{:.1}", 1e300));
        assert_eq!(of(f64::NAN, 2), "NaN");
    }
}
