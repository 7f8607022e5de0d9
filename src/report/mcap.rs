//! The aligned recording as MCAP, with JSON messages that Foxglove and PlotJuggler show without set-up.
//!
//! | topic | schema | unit |
//! |---|---|---|
//! | `/end_effector/position` | `foxglove.PoseInFrame` in frame `world`, smoothed | m |
//! | `/end_effector/measured` | the same, as captured | m |
//! | `/end_effector/velocity`, `/end_effector/acceleration` | `deacal.Vector3` | m/s, m/s^2 |
//! | `/voltage/command`, `/voltage/monitor`, `/voltage/predicted`, `/voltage/residual` | `deacal.Voltages` | V |
//! | `/log` | `foxglove.Log`: gaps and notes | |
//!
//! The residual is predicted minus command. A topic has no message where there is no value. Log time is the
//! motion clock in ns; should that clock begin below zero, whole seconds are added and metadata `deacal` says
//! how many (`time_shift_s`).

use std::collections::BTreeMap;
use std::io::{self, Seek, Write};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::{McapError, WriteOptions, Writer};

use super::csv::{Missing, fixed, missing};
use super::provenance::Provenance;
use crate::calibration::RecordingOutcome;
use crate::dataset::smoother::SmoothedAxis;
use crate::dataset::{Dataset, Voltage};

const POSE: &str = r#"{"title":"foxglove.PoseInFrame","description":"A timestamped pose for an object or reference frame in 3D space; position in m","type":"object","properties":{"timestamp":{"type":"object","title":"time","properties":{"sec":{"type":"integer","minimum":0},"nsec":{"type":"integer","minimum":0,"maximum":999999999}},"description":"Timestamp of pose"},"frame_id":{"type":"string","description":"Frame of reference for pose position and orientation"},"pose":{"title":"foxglove.Pose","description":"Pose in 3D space","type":"object","properties":{"position":{"title":"foxglove.Vector3","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}},"orientation":{"title":"foxglove.Quaternion","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"},"w":{"type":"number"}}}}}}}"#;
const LOG: &str = r#"{"title":"foxglove.Log","description":"A log message","type":"object","properties":{"timestamp":{"type":"object","title":"time","properties":{"sec":{"type":"integer","minimum":0},"nsec":{"type":"integer","minimum":0,"maximum":999999999}}},"level":{"title":"foxglove.LogLevel","description":"0 unknown, 1 debug, 2 info, 3 warning, 4 error, 5 fatal","oneOf":[{"title":"UNKNOWN","const":0},{"title":"DEBUG","const":1},{"title":"INFO","const":2},{"title":"WARNING","const":3},{"title":"ERROR","const":4},{"title":"FATAL","const":5}]},"message":{"type":"string"},"name":{"type":"string"},"file":{"type":"string"},"line":{"type":"integer","minimum":0}}}"#;
const VECTOR: &str = r#"{"title":"deacal.Vector3","description":"A vector in world axes; m/s for a velocity, m/s^2 for an acceleration","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}}}"#;
const VOLTAGES: &str = r#"{"title":"deacal.Voltages","description":"Voltages of the chains, V; a chain without a value is left out","type":"object","properties":{"chain_1":{"type":"number"},"chain_2":{"type":"number"},"chain_3":{"type":"number"}}}"#;

/// One topic: its channel and how many messages it has.
struct Topic {
    id: u16,
    sequence: u32,
}

struct Recorder<W: Write + Seek> {
    writer: Writer<W>,
    shift_s: f64,
    body: Vec<u8>,
}

impl<W: Write + Seek> Recorder<W> {
    fn topic(&mut self, name: &str, schema: u16, unit: &str) -> Result<Topic, McapError> {
        let mut metadata = BTreeMap::new();
        if !unit.is_empty() {
            metadata.insert("unit".to_owned(), unit.to_owned());
        }
        let id = self.writer.add_channel(schema, name, "json", &metadata)?;
        Ok(Topic { id, sequence: 0 })
    }

    fn log_time_ns(&self, time_s: f64) -> u64 {
        ((time_s + self.shift_s) * 1e9).round() as u64
    }

    /// Sends the body as a message.
    fn send(&mut self, topic: &mut Topic, time_s: f64) -> Result<(), McapError> {
        let log_time = self.log_time_ns(time_s);
        let header = MessageHeader {
            channel_id: topic.id,
            sequence: topic.sequence,
            log_time,
            publish_time: log_time,
        };
        topic.sequence += 1;
        self.writer.write_to_known_channel(&header, &self.body)
    }

    fn stamp(&mut self, time_s: f64) -> io::Result<()> {
        let ns = self.log_time_ns(time_s);
        let (sec, nsec) = (ns / 1_000_000_000, ns % 1_000_000_000);
        write!(self.body, r#"{{"timestamp":{{"sec":{sec},"nsec":{nsec}}}"#)
    }

    fn pose(&mut self, topic: &mut Topic, time_s: f64, p: [f64; 3]) -> Result<(), McapError> {
        if p.iter().any(|v| !v.is_finite()) {
            return Ok(());
        }
        self.body.clear();
        self.stamp(time_s)?;
        self.body
            .extend_from_slice(br#","frame_id":"world","pose":{"position":{"x":"#);
        fixed(&mut self.body, p[0], 9);
        self.body.extend_from_slice(br#","y":"#);
        fixed(&mut self.body, p[1], 9);
        self.body.extend_from_slice(br#","z":"#);
        fixed(&mut self.body, p[2], 9);
        self.body
            .extend_from_slice(br#"},"orientation":{"x":0,"y":0,"z":0,"w":1}}}"#);
        self.send(topic, time_s)
    }

    /// A flat object of numbers; entries that are not finite are left out, and so is an empty object.
    fn numbers(
        &mut self,
        topic: &mut Topic,
        time_s: f64,
        names: [&str; 3],
        values: [f64; 3],
        decimals: usize,
    ) -> Result<(), McapError> {
        self.body.clear();
        for (name, value) in names.iter().zip(values) {
            if value.is_finite() {
                let separator = if self.body.is_empty() { '{' } else { ',' };
                write!(self.body, r#"{separator}"{name}":"#)?;
                fixed(&mut self.body, value, decimals);
            }
        }
        if self.body.is_empty() {
            return Ok(());
        }
        self.body.push(b'}');
        self.send(topic, time_s)
    }

    fn log(
        &mut self,
        topic: &mut Topic,
        time_s: f64,
        warning: bool,
        name: &str,
        message: &str,
    ) -> Result<(), McapError> {
        self.body.clear();
        self.stamp(time_s)?;
        let text = serde_json::Value::from(message);
        let name = serde_json::Value::from(name);
        let level = if warning { 3 } else { 2 };
        write!(
            self.body,
            r#","level":{level},"message":{text},"name":{name},"file":"","line":0}}"#
        )?;
        self.send(topic, time_s)
    }

    /// Where the recording comes from.
    fn metadata(
        &mut self,
        d: &Dataset,
        offset_s: f64,
        provenance: &Provenance,
    ) -> Result<(), McapError> {
        let mut metadata: BTreeMap<String, String> = [
            ("recording", d.id.clone()),
            ("program", provenance.program.clone()),
            ("command", provenance.command.clone()),
            ("offset_s", offset_s.to_string()),
            ("time_shift_s", self.shift_s.to_string()),
            ("noise_mm", format!("{:?}", d.noise_m().map(|v| v * 1e3))),
        ]
        .into_iter()
        .map(|(k, v)| (k.to_owned(), v))
        .collect();
        for r in provenance.recordings.iter().filter(|r| r.id == d.id) {
            for f in &r.files {
                metadata.insert(format!("sha256/{}", f.role), f.sha256.clone());
            }
        }
        self.writer.write_metadata(&Metadata {
            name: "deacal".to_owned(),
            metadata,
        })
    }
}

const AXES: [&str; 3] = ["x", "y", "z"];
const CHAINS: [&str; 3] = ["chain_1", "chain_2", "chain_3"];

/// Writes the aligned recording; with an `outcome` of the same recording its predictions as well, and its
/// clock offset.
///
/// # Errors
/// Those of the writer; an outcome with another number of frames.
pub fn aligned<W: Write + Seek>(
    out: W,
    d: &Dataset,
    outcome: Option<&RecordingOutcome>,
    provenance: &Provenance,
) -> io::Result<()> {
    if let Some(r) = outcome
        && r.predicted_v.len() != d.samples()
    {
        return Err(io::Error::other(format!(
            "recording `{}` has {} frames, its prediction {}",
            d.id,
            d.samples(),
            r.predicted_v.len()
        )));
    }
    write_all(out, d, outcome, provenance).map_err(|e| match e {
        McapError::Io(e) => e,
        other => io::Error::other(other),
    })
}

fn write_all<W: Write + Seek>(
    out: W,
    d: &Dataset,
    outcome: Option<&RecordingOutcome>,
    provenance: &Provenance,
) -> Result<(), McapError> {
    let writer = WriteOptions::new()
        .library(concat!("deacal ", env!("CARGO_PKG_VERSION")))
        // one thread: the same input gives the same bytes on any machine
        .compression_threads(0)
        .compression_level(1)
        .create(out)?;
    let mut file = Recorder {
        writer,
        shift_s: if d.start_s < 0.0 {
            (-d.start_s).ceil()
        } else {
            0.0
        },
        body: Vec::with_capacity(512),
    };
    let mut topics = Topics::new(&mut file, d, outcome)?;
    file.metadata(d, topics.offset_s, provenance)?;
    for note in &d.notes {
        file.log(&mut topics.log, d.start_s, true, &d.id, note)?;
    }
    let gaps = d.gaps();
    let mut gaps = gaps.iter().peekable();
    for i in 0..d.samples() {
        if let Some((_, frames)) = gaps.next_if(|(first, _)| *first == i) {
            let what = if d.usable[i] { "bridged" } else { "masked" };
            let text = format!("gap of {:.3} s: {what}", *frames as f64 * d.step_s);
            file.log(&mut topics.log, d.time_s(i), !d.usable[i], &d.id, &text)?;
        }
        topics.motion(&mut file, d, i)?;
        topics.voltages(&mut file, d, i)?;
    }
    file.writer.finish()?;
    Ok(())
}

/// The topics of a recording.
struct Topics<'a> {
    offset_s: f64,
    position: Topic,
    measured: Topic,
    velocity: Topic,
    acceleration: Topic,
    command: Topic,
    monitor: Option<(&'a Voltage, Topic)>,
    prediction: Option<Prediction<'a>>,
    log: Topic,
}

/// What an outcome predicts, and where that goes.
struct Prediction<'a> {
    of: &'a RecordingOutcome,
    missing: Vec<Option<Missing>>,
    predicted: Topic,
    residual: Topic,
}

impl<'a> Topics<'a> {
    /// Adds schemas and topics to the file, in their order.
    fn new<W: Write + Seek>(
        file: &mut Recorder<W>,
        d: &'a Dataset,
        outcome: Option<&'a RecordingOutcome>,
    ) -> Result<Self, McapError> {
        let mut schema =
            |name: &str, text: &str| file.writer.add_schema(name, "jsonschema", text.as_bytes());
        let pose = schema("foxglove.PoseInFrame", POSE)?;
        let vector = schema("deacal.Vector3", VECTOR)?;
        let voltages = schema("deacal.Voltages", VOLTAGES)?;
        let log = schema("foxglove.Log", LOG)?;
        Ok(Topics {
            offset_s: outcome.map_or(d.offset_s, |r| r.offset_s),
            position: file.topic("/end_effector/position", pose, "m")?,
            measured: file.topic("/end_effector/measured", pose, "m")?,
            velocity: file.topic("/end_effector/velocity", vector, "m/s")?,
            acceleration: file.topic("/end_effector/acceleration", vector, "m/s^2")?,
            command: file.topic("/voltage/command", voltages, "V")?,
            monitor: match &d.monitor {
                Some(m) => Some((m, file.topic("/voltage/monitor", voltages, "V")?)),
                None => None,
            },
            prediction: match outcome {
                Some(r) => Some(Prediction {
                    of: r,
                    missing: missing(r),
                    predicted: file.topic("/voltage/predicted", voltages, "V")?,
                    residual: file.topic("/voltage/residual", voltages, "V")?,
                }),
                None => None,
            },
            log: file.topic("/log", log, "")?,
        })
    }

    /// The pose of frame `i` as captured, and smoothed with its derivatives where it is usable.
    fn motion<W: Write + Seek>(
        &mut self,
        file: &mut Recorder<W>,
        d: &Dataset,
        i: usize,
    ) -> Result<(), McapError> {
        let t = d.time_s(i);
        file.pose(&mut self.measured, t, d.measured_m[i])?;
        if d.usable[i] {
            let row = |f: fn(&SmoothedAxis) -> &Vec<f64>| [0, 1, 2].map(|k| f(&d.axes[k])[i]);
            file.pose(&mut self.position, t, row(|a| &a.position))?;
            file.numbers(&mut self.velocity, t, AXES, row(|a| &a.velocity), 9)?;
            file.numbers(&mut self.acceleration, t, AXES, row(|a| &a.acceleration), 6)?;
        }
        Ok(())
    }

    /// The voltages of frame `i`: told, measured, predicted.
    fn voltages<W: Write + Seek>(
        &mut self,
        file: &mut Recorder<W>,
        d: &Dataset,
        i: usize,
    ) -> Result<(), McapError> {
        let (t, offset_s) = (d.time_s(i), self.offset_s);
        if d.has_voltage(i, offset_s) {
            let volts = [0, 1, 2].map(|k| d.command_v(k, i, offset_s));
            file.numbers(&mut self.command, t, CHAINS, volts, 4)?;
        }
        if let Some((m, topic)) = &mut self.monitor {
            let (first, last) = m.span_s();
            if (first..=last).contains(&(t + offset_s)) {
                let volts = [0, 1, 2].map(|k| m.at(k, t + offset_s));
                file.numbers(topic, t, CHAINS, volts, 4)?;
            }
        }
        if let Some(p) = &mut self.prediction {
            let value = match &p.missing[i] {
                None => p.of.predicted_v[i],
                Some(Missing::Negative(chains)) => [0, 1, 2].map(|k| {
                    if chains.contains(&(k + 1)) {
                        f64::NAN
                    } else {
                        p.of.predicted_v[i][k]
                    }
                }),
                Some(_) => [f64::NAN; 3],
            };
            file.numbers(&mut p.predicted, t, CHAINS, value, 4)?;
            let error = [0, 1, 2].map(|k| value[k] - p.of.command_v[i][k]);
            file.numbers(&mut p.residual, t, CHAINS, error, 4)?;
        }
        Ok(())
    }
}
