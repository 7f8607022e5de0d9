//! `recording.toml`: what a recording is, and which files it is in. Values stay in the units that the keys
//! name.

use std::path::{Component, Path, PathBuf};

use toml::de::DeValue;
use toml::value::Datetime;

use super::capture::{ColumnRef, importers};
use super::described::{self, DAY, HUMIDITY_PERCENT, ROOM_C, names};
use super::error::{Error, ErrorKind, quote, suggestion};
use super::keys::{Document, Keys, RECORDING, Value, numbers};
use crate::units::{Dimension, Unit};

/// What was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The delta robot: motion of the end effector, three voltages.
    Robot,
    /// A film that hangs and carries a weight: motion of the free end, one voltage.
    FilmSample,
    /// A tensile or relaxation test of bare film.
    FilmCoupon,
    /// The spring-back torque of a flexure, measured by itself.
    HingeBench,
    /// One drive and one coordinate.
    Axis,
}

impl Kind {
    /// Every kind.
    pub(super) const ALL: [Kind; 5] = [
        Kind::Robot,
        Kind::FilmSample,
        Kind::FilmCoupon,
        Kind::HingeBench,
        Kind::Axis,
    ];

    const WORDS: [(&'static str, Kind); 5] = [
        ("robot", Kind::Robot),
        ("film-sample", Kind::FilmSample),
        ("film-coupon", Kind::FilmCoupon),
        ("hinge-bench", Kind::HingeBench),
        ("axis", Kind::Axis),
    ];

    /// As the manifest writes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::WORDS
            .iter()
            .find(|(_, k)| *k == self)
            .map_or("", |(w, _)| w)
    }
}

/// State of the film at the first sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilmState {
    /// Its slow branches have had time to relax at rest.
    Relaxed,
    /// It has never been stretched since it was mounted.
    Virgin,
}

/// A number, or the word `"estimate"`: the tool is to find it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NumberOrEstimate {
    /// Known and held.
    Number(f64),
    /// To be found.
    Estimate,
}

impl Value for NumberOrEstimate {
    const EXPECTED: &'static str = "a number or \"estimate\"";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        match value.as_str() {
            Some("estimate") => Some(NumberOrEstimate::Estimate),
            Some(_) => None,
            None => f64::from_toml(value).map(NumberOrEstimate::Number),
        }
    }
}

/// Mass added to the end effector.
#[derive(Debug, Clone, PartialEq)]
pub enum Payload {
    /// The same throughout, g.
    Constant {
        /// g
        mass_g: f64,
    },
    /// From each time on, another mass; nothing before the first.
    Steps(Vec<PayloadStep>),
}

/// One step of a payload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PayloadStep {
    /// On the motion clock, s.
    pub time_s: f64,
    /// From then on, g.
    pub mass_g: f64,
}

impl Payload {
    /// The mass at a time of the motion clock, g.
    #[must_use]
    pub fn mass_g(&self, time_s: f64) -> f64 {
        match self {
            Payload::Constant { mass_g } => *mass_g,
            Payload::Steps(steps) => steps
                .iter()
                .rev()
                .find(|s| s.time_s <= time_s)
                .map_or(0.0, |s| s.mass_g),
        }
    }
}

impl Value for Payload {
    const EXPECTED: &'static str = "a mass in g, or a list of [time_s, g] steps whose times rise";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        if let Some(mass_g) = f64::from_toml(value) {
            return Some(Payload::Constant { mass_g });
        }
        let mut steps: Vec<PayloadStep> = Vec::new();
        for step in value.as_array()?.iter() {
            let [time_s, mass_g] = numbers(step.get_ref())?.try_into().ok()?;
            if steps.last().is_some_and(|s| s.time_s >= time_s) {
                return None;
            }
            steps.push(PayloadStep { time_s, mass_g });
        }
        (!steps.is_empty()).then_some(Payload::Steps(steps))
    }
}

/// When a recording began.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// As the manifest has it.
    pub text: String,
    /// Seconds since 1970-01-01T00:00:00 on the clock that the manifest uses (UTC if it states an offset).
    /// Only differences within a series mean something.
    pub clock_s: f64,
}

impl Value for Start {
    const EXPECTED: &'static str =
        "a date and time such as 2026-03-02T10:15:00, without quotation marks";
    fn from_toml(value: &DeValue<'_>) -> Option<Self> {
        let DeValue::Datetime(Datetime { date, time, offset }) = value else {
            return None;
        };
        let (date, time) = ((*date)?, (*time)?);
        // days since 1970-01-01 in the Gregorian calendar; years begin in March
        let (year, month) = (i64::from(date.year), i64::from(date.month));
        let (y, m) = if month > 2 {
            (year, month - 3)
        } else {
            (year - 1, month + 9)
        };
        let day_of_year = (153 * m + 2) / 5 + i64::from(date.day) - 1;
        let days = y * 365 + y.div_euclid(4) - y.div_euclid(100) + y.div_euclid(400) + day_of_year
            - 719_468;
        let seconds = i64::from(time.hour) * 3600
            + i64::from(time.minute) * 60
            + i64::from(time.second.unwrap_or(0));
        let offset_s = match offset {
            Some(toml::value::Offset::Custom { minutes }) => i64::from(*minutes) * 60,
            _ => 0,
        };
        #[allow(clippy::cast_precision_loss)]
        let clock_s = (days * 86_400 + seconds - offset_s) as f64
            + f64::from(time.nanosecond.unwrap_or(0)) * 1e-9;
        Some(Start {
            text: value_text(value),
            clock_s,
        })
    }
}

fn value_text(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Datetime(d) => d.to_string(),
        _ => String::new(),
    }
}

/// A file that the manifest names, and what it says of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileRef {
    /// Relative to the manifest's folder.
    pub file: PathBuf,
    /// Importer's name; `None`: told from the content.
    pub format: Option<String>,
    /// Text encoding where it is not UTF-8.
    pub encoding: Option<String>,
}

/// Where the times of a table come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Clock {
    /// A column, and its unit where the manifest states it.
    Column {
        /// Which.
        column: ColumnRef,
        /// `s`, `ms`, ...; `None`: from the header.
        unit: Option<&'static Unit>,
    },
    /// Sample i was taken at i/rate.
    Rate {
        /// Samples per second, Hz.
        rate_hz: f64,
    },
    /// The format has a clock of its own (frames, stamps).
    Own,
}

/// `[motion]`.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionManifest {
    /// The file.
    pub source: FileRef,
    /// Only for plain tables; others have their own clock.
    pub clock: Clock,
    /// Unit of the positions; `None`: from the file.
    pub unit: Option<&'static Unit>,
    /// Marker that moves; `*` and `?` stand for any text and any letter.
    pub end_effector: String,
    /// Of the markers called so, the one nearest to this place in capture axes, mm.
    pub end_effector_near_mm: Option<[f64; 3]>,
    /// Marker fixed to the frame, as `end_effector`.
    pub base: Option<String>,
    /// As `end_effector_near_mm`.
    pub base_near_mm: Option<[f64; 3]>,
    /// Of the base marker in the rig's world W, mm.
    pub base_position_mm: [f64; 3],
    /// From the end effector's centre to its marker, in W, mm.
    pub end_effector_offset_mm: [f64; 3],
    /// Motion-capture axes to W, degrees: v_W = Rx Ry Rz v_capture.
    pub rotation_deg: [f64; 3],
}

/// `[voltage]`.
#[derive(Debug, Clone, PartialEq)]
pub struct VoltageManifest {
    /// The file.
    pub source: FileRef,
    /// Time column or rate.
    pub clock: Clock,
    /// Chains 1, 2, 3; one for a film sample.
    pub channels: Vec<ColumnRef>,
    /// V or kV; `None` only where the header says it.
    pub unit: Option<&'static Unit>,
    /// Volts per volt of the file: volts = value * unit * scale.
    pub scale: Option<f64>,
    /// `hold = "previous"`: between samples the amplifier holds the last value; else linear.
    pub hold_previous: bool,
}

/// `[monitor]`: the amplifier's own measurement, beside the command.
#[derive(Debug, Clone, PartialEq)]
pub struct MonitorManifest {
    /// The file.
    pub source: FileRef,
    /// Time column or rate; that of `[voltage]` where nothing is said.
    pub clock: Clock,
    /// Measured voltages, one a chain.
    pub channels: Vec<ColumnRef>,
    /// Measured currents, one a chain, where they are logged.
    pub current: Vec<ColumnRef>,
    /// V or kV; `None`: from the header, else that of `[voltage]`.
    pub unit: Option<&'static Unit>,
    /// Unit of the currents; `None`: from the header.
    pub current_unit: Option<&'static Unit>,
    /// Volts per volt of the file.
    pub scale: Option<f64>,
}

/// How a coupon is pulled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CouponMode {
    /// One direction, sides free.
    Uniaxial,
    /// Two directions alike.
    Equibiaxial,
    /// One direction, the width held.
    PureShear,
}

/// A column, with the unit where the manifest states one.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Which.
    pub column: ColumnRef,
    /// `None`: from the header.
    pub unit: Option<&'static Unit>,
}

/// How far a coupon is pulled.
#[derive(Debug, Clone, PartialEq)]
pub enum CouponElongation {
    /// Measured displacement over a gauge length.
    Displacement {
        /// Which column.
        displacement: Quantity,
        /// Length at zero displacement, mm.
        gauge_mm: f64,
    },
    /// Stretch itself.
    Stretch(Quantity),
}

/// How hard a coupon pulls back.
#[derive(Debug, Clone, PartialEq)]
pub enum CouponLoad {
    /// Measured force over the unstretched section.
    Force {
        /// Which column.
        force: Quantity,
        /// Unstretched width, mm.
        width_mm: f64,
        /// Unstretched thickness, mm.
        thickness_mm: f64,
    },
    /// Nominal stress itself.
    NominalStress(Quantity),
}

/// `[coupon]`.
#[derive(Debug, Clone, PartialEq)]
pub struct CouponManifest {
    /// The file.
    pub source: FileRef,
    /// Uniaxial, equibiaxial or pure shear.
    pub mode: CouponMode,
    /// `Clock::Own`: the file has no time.
    pub clock: Clock,
    /// Displacement with gauge length, or stretch.
    pub elongation: CouponElongation,
    /// Force with section, or nominal stress.
    pub load: CouponLoad,
}

/// `[bench]`.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchManifest {
    /// The file.
    pub source: FileRef,
    /// `Clock::Own`: the order of the rows is all that is known.
    pub clock: Clock,
    /// Angle of the hinge.
    pub angle: Quantity,
    /// Its torque.
    pub torque: Quantity,
    /// Part of the recording that is used: s, or rows from 1 where the file has no time.
    pub span: Option<[f64; 2]>,
}

/// What moves on a single axis.
#[derive(Debug, Clone, PartialEq)]
pub enum AxisCoordinate {
    /// Measured position (or angle).
    Position(Quantity),
    /// Measured velocity.
    Velocity(Quantity),
}

/// What resists acceleration on a single axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AxisInertia {
    /// A sliding mass, kg.
    MassKg(NumberOrEstimate),
    /// A turning one, kg m^2.
    InertiaKgM2(NumberOrEstimate),
}

/// `[axis]`: gain * input + load = mass x'' + damping x' + stiffness x.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisManifest {
    /// The file.
    pub source: FileRef,
    /// Time column or rate; `Clock::Own`: the times that the file has.
    pub clock: Clock,
    /// Position or velocity.
    pub coordinate: AxisCoordinate,
    /// What drives; its unit may be any word.
    pub input: ColumnRef,
    /// Unit of the input as the manifest states it.
    pub input_unit: Option<String>,
    /// Measured external force, along +position.
    pub load: Option<Quantity>,
    /// N (or N m) per unit of input.
    pub input_gain: NumberOrEstimate,
    /// Mass or moment of inertia.
    pub inertia: AxisInertia,
    /// N s/m, or N m s/rad.
    pub damping: NumberOrEstimate,
    /// N/m, or N m/rad.
    pub stiffness: NumberOrEstimate,
    /// The input's own file and clock, where another instrument logged it.
    pub input_source: Option<(FileRef, Clock)>,
    /// Factors from the columns to `units`: coordinate, input, load.
    pub scale: [f64; 3],
    /// The drive is this power of the input: 2 for an electrostatic force by voltage.
    pub input_power: f64,
    /// Part of the recording that is used, s.
    pub span_s: Option<[f64; 2]>,
}

/// A column of the motion file that shows a voltage channel.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedManifest {
    /// The column.
    pub column: ColumnRef,
    /// The chain whose voltage it shows, from 1.
    pub chain: usize,
}

/// A `recording.toml`.
#[derive(Debug, Clone, PartialEq)]
pub struct Manifest {
    /// Name of the recording; `/` makes a folder of outputs.
    pub id: String,
    /// What was recorded.
    pub kind: Kind,
    /// Rig file, relative to the manifest's folder.
    pub rig: Option<PathBuf>,
    /// Mass added to the end effector; none unless stated.
    pub payload: Payload,
    /// State of the film at the first sample, where stated.
    pub film_state: Option<FilmState>,
    /// Film batch.
    pub batch: Option<String>,
    /// Electrode.
    pub electrode: Option<String>,
    /// Age, days.
    pub day: Option<f64>,
    /// Recordings of one sitting.
    pub series: Option<String>,
    /// When it began.
    pub start: Option<Start>,
    /// Room temperature, degrees Celsius.
    pub temperature_c: Option<f64>,
    /// Relative humidity, percent.
    pub humidity_percent: Option<f64>,
    /// Voltage clock minus motion clock, s. 0 where the manifest says nothing.
    pub offset_s: NumberOrEstimate,
    /// Events on both clocks, (motion, voltage), s: they tell an offset that is to be estimated.
    pub events: Vec<[f64; 2]>,
    /// A column of the motion file that shows a voltage channel, by which the offset is estimated.
    pub shared: Option<SharedManifest>,
    /// `[motion]`: robot and film sample.
    pub motion: Option<MotionManifest>,
    /// `[voltage]`: robot and film sample.
    pub voltage: Option<VoltageManifest>,
    /// `[monitor]`: robot and film sample.
    pub monitor: Option<MonitorManifest>,
    /// `[coupon]`: film coupon.
    pub coupon: Option<CouponManifest>,
    /// `[bench]`: hinge bench.
    pub bench: Option<BenchManifest>,
    /// `[axis]`: axis.
    pub axis: Option<AxisManifest>,
}

impl Manifest {
    /// Reads a `recording.toml`.
    ///
    /// # Errors
    /// The file cannot be read; a key is unknown (the nearest is named), missing, of the wrong type, cannot
    /// be, or does not go with the kind.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Self::from_document(&Document::read(path, &RECORDING)?)
    }

    /// Reads the text of a `recording.toml`; `path` is for messages.
    ///
    /// # Errors
    /// As [`Manifest::read`].
    pub fn parse(path: &Path, text: &str) -> Result<Self, Error> {
        Self::from_document(&Document::new(path, text.to_owned(), &RECORDING))
    }

    fn from_document(document: &Document) -> Result<Self, Error> {
        let root = document.parse()?;
        const TABLES: &[&str] = &names(&described::RECORDING_TOML);
        let top = Keys::top(document, &root, TABLES)?;
        let mut manifest = Self::of_recording(&top.need_table(
            "recording",
            &const { names(&described::RECORDING) },
            "a recording.toml begins with [recording]",
        )?)?;
        let kind = manifest.kind;
        let belongs = described::tables(kind).concat();
        for table in TABLES {
            if top.has(table) && !belongs.contains(table) {
                return Err(top
                    .bad(
                        table,
                        format!("a recording of kind \"{}\" has no such table", kind.name()),
                    )
                    .expected(format!("[{}]", belongs.join("], [")))
                    .action("remove the table, or correct `kind`"));
            }
        }
        match kind {
            Kind::Robot | Kind::FilmSample => manifest.motion_and_voltage(&top)?,
            Kind::FilmCoupon => {
                let t = top.need_table(
                    "coupon",
                    &const { names(&described::COUPON) },
                    "a film coupon has [coupon]",
                )?;
                manifest.coupon = Some(coupon(&t)?);
            }
            Kind::HingeBench => {
                let t = top.need_table(
                    "bench",
                    &const { names(&described::BENCH) },
                    "a hinge bench has [bench]",
                )?;
                manifest.bench = Some(bench(&t)?);
            }
            Kind::Axis => manifest.single_axis(&top)?,
        }
        Ok(manifest)
    }

    /// `[recording]`, and nothing of the other tables.
    fn of_recording(t: &Keys<'_>) -> Result<Self, Error> {
        let kind = t.choice("kind", &Kind::WORDS)?.ok_or_else(|| {
            t.missing(
                "kind",
                "add `kind = \"robot\"` (or film-sample, film-coupon, hinge-bench, axis)",
            )
        })?;
        Ok(Manifest {
            id: id(t)?,
            kind,
            rig: t.get::<String>("rig")?.map(PathBuf::from),
            payload: t
                .get("payload_g")?
                .unwrap_or(Payload::Constant { mass_g: 0.0 }),
            film_state: t.choice(
                "film_state",
                &[
                    ("relaxed", FilmState::Relaxed),
                    ("virgin", FilmState::Virgin),
                ],
            )?,
            batch: t.get("batch")?,
            electrode: t.get("electrode")?,
            day: t.between(
                "day",
                DAY,
                "count the days since the electrodes were made: 0 or 1 is the first",
            )?,
            series: t.get("series")?,
            start: t.get("start")?,
            temperature_c: t.between(
                "temperature_C",
                ROOM_C,
                "give that of the room in degrees Celsius",
            )?,
            humidity_percent: t.between(
                "humidity_percent",
                HUMIDITY_PERCENT,
                "give the relative humidity of the room in per cent",
            )?,
            offset_s: NumberOrEstimate::Number(0.0),
            events: Vec::new(),
            shared: None,
            motion: None,
            voltage: None,
            monitor: None,
            coupon: None,
            bench: None,
            axis: None,
        })
    }

    /// The tables of a robot or a hanging sample.
    fn motion_and_voltage(&mut self, top: &Keys<'_>) -> Result<(), Error> {
        let kind = self.kind;
        let why = format!(
            "a recording of kind \"{}\" has [motion] and [voltage]",
            kind.name()
        );
        self.motion = Some(motion(&top.need_table(
            "motion",
            &const { names(&described::MOTION) },
            &why,
        )?)?);
        let chains = if kind == Kind::Robot { 3 } else { 1 };
        let t = top.need_table("voltage", &const { names(&described::VOLTAGE) }, &why)?;
        let voltage = voltage(&t, kind, chains)?;
        if let Some(t) = top.table("monitor", &const { names(&described::MONITOR) })? {
            self.monitor = Some(monitor(&t, &voltage, kind, chains)?);
        }
        self.voltage = Some(voltage);
        if let Some(t) = top.table("sync", &const { names(&described::SYNC) })? {
            sync(&t, chains, self)?;
        }
        Ok(())
    }

    /// `[axis]`, and `[sync]` where its input has a clock of its own.
    fn single_axis(&mut self, top: &Keys<'_>) -> Result<(), Error> {
        let axis = axis(&top.need_table(
            "axis",
            &const { names(&described::AXIS) },
            "a single axis has [axis]",
        )?)?;
        let apart = axis.input_source.is_some();
        self.axis = Some(axis);
        let Some(t) = top.table("sync", &["offset_s"])? else {
            return Ok(());
        };
        if let Some(offset_s) = t.get("offset_s")? {
            self.offset_s = offset_s;
        }
        if !apart && self.offset_s != NumberOrEstimate::Number(0.0) {
            return Err(t
                .bad(
                    "offset_s",
                    "position and input are in one file, on one clock",
                )
                .expected("no [sync], or the input in a file of its own (`input_file`)"));
        }
        Ok(())
    }
}

/// `[sync]`
fn sync(t: &Keys<'_>, chains: usize, manifest: &mut Manifest) -> Result<(), Error> {
    if let Some(offset_s) = t.get("offset_s")? {
        manifest.offset_s = offset_s;
    }
    for (_, entry) in t.list("events")?.unwrap_or_default() {
        let pair = super::keys::numbers(entry).and_then(|n| <[f64; 2]>::try_from(n).ok());
        let Some(pair) = pair else {
            return Err(t
                .bad("events", "an event is no pair of numbers")
                .expected("[[motion_s, voltage_s], ...]"));
        };
        manifest.events.push(pair);
    }
    let chain = t.get::<i64>("chain")?.unwrap_or(1);
    let chain = usize::try_from(chain)
        .ok()
        .filter(|c| (1..=chains).contains(c))
        .ok_or_else(|| {
            t.bad("chain", format!("found {chain}"))
                .expected(format!("1 to {chains}"))
        })?;
    manifest.shared = t
        .get("shared")?
        .map(|column| SharedManifest { column, chain });
    if manifest.shared.is_some() && !manifest.events.is_empty() {
        return Err(t
            .bad(
                "events",
                "the offset is told by events and by a shared channel",
            )
            .expected("one of them"));
    }
    let stated = matches!(manifest.offset_s, NumberOrEstimate::Number(_));
    if stated && (manifest.shared.is_some() || !manifest.events.is_empty()) {
        return Err(t
            .bad("offset_s", "the offset is stated")
            .expected("offset_s = \"estimate\" where events or a shared channel tell it"));
    }
    Ok(())
}

/// Bytes that each part of an id may have: file systems take 255, with the endings that results add.
const LONGEST_ID: usize = 200;

/// Whether a text can be the id of a recording. It becomes a path below the output folder: relative, without
/// `..`, no part too long for a file's name, and without anything that steers a terminal.
#[must_use]
pub fn is_id(id: &str) -> bool {
    let plain = !id.contains(|c: char| c == '\\' || c.is_control()) && !id.ends_with('/');
    let inside = Path::new(id)
        .components()
        .all(|c| matches!(c, Component::Normal(name) if name.len() <= LONGEST_ID));
    !id.trim().is_empty() && plain && inside
}

/// The id of a recording.
fn id(t: &Keys<'_>) -> Result<String, Error> {
    let id: String = t.need("id")?;
    if !is_id(&id) {
        return Err(t
            .bad("id", format!("found {}", quote(&id)))
            .expected("a name that can be a file's, such as \"sym-01\" or \"ageing/day-03\"")
            .action(format!(
                "the id names the output files; each of its parts may have {LONGEST_ID} bytes"
            )));
    }
    Ok(id)
}

fn file_ref(t: &Keys<'_>) -> Result<FileRef, Error> {
    let file: String = t.need("file")?;
    if file.trim().is_empty() {
        return Err(t
            .bad("file", "found an empty name")
            .expected("the name of a file"));
    }
    let format: Option<String> = t.get("format")?;
    if let Some(format) = &format {
        let names: Vec<&str> = importers().iter().map(|i| i.name()).collect();
        if !names.contains(&format.as_str()) {
            return Err(t
                .bad("format", format!("found {}", quote(format)))
                .expected("a format that is read here")
                .action(suggestion(format, &names)));
        }
    }
    let encoding: Option<String> = t.get("encoding")?;
    if let Some(label) = &encoding
        && super::text::encoding(Path::new(""), label).is_err()
    {
        return Err(t
            .bad("encoding", format!("found {}", quote(label)))
            .expected("the name of a text encoding, such as utf-8, latin1 or gbk"));
    }
    Ok(FileRef {
        file: PathBuf::from(file),
        format,
        encoding,
    })
}

/// A unit of one of these dimensions.
fn unit_of(
    t: &Keys<'_>,
    key: &'static str,
    dimensions: &[Dimension],
) -> Result<Option<&'static Unit>, Error> {
    let Some(text) = t.get::<String>(key)? else {
        return Ok(None);
    };
    match Unit::parse(&text) {
        Some(unit) if dimensions.contains(&unit.dimension) => Ok(Some(unit)),
        _ => {
            let known: Vec<&str> = dimensions.iter().flat_map(|d| Unit::symbols(*d)).collect();
            Err(t
                .bad(key, format!("found {}", quote(&text)))
                .expected(format!("one of {}", known.join(", "))))
        }
    }
}

/// V or kV.
fn volts(t: &Keys<'_>) -> Result<Option<&'static Unit>, Error> {
    Ok(t.choice(
        "unit",
        &[("V", Unit::parse("V")), ("kV", Unit::parse("kV"))],
    )?
    .flatten())
}

/// `time` (with its unit) or `rate_hz`.
fn clock(t: &Keys<'_>, time_unit: Option<&'static Unit>) -> Result<Clock, Error> {
    let column = t.get::<ColumnRef>("time")?;
    let rate_hz = t.positive("rate_hz")?;
    match (column, rate_hz) {
        (Some(_), Some(_)) => Err(t
            .bad("rate_hz", "both `time` and `rate_hz` are given")
            .expected("one of them")
            .action("keep the time column where there is one: its jitter is real")),
        (Some(column), None) => Ok(Clock::Column {
            column,
            unit: time_unit,
        }),
        (None, Some(rate_hz)) => Ok(Clock::Rate { rate_hz }),
        (None, None) => Ok(Clock::Own),
    }
}

fn channels(
    t: &Keys<'_>,
    key: &'static str,
    kind: Kind,
    chains: usize,
) -> Result<Vec<ColumnRef>, Error> {
    // a film sample may name its one channel without a list
    let list = t.get_with(key, <Vec<ColumnRef>>::EXPECTED, |v| {
        <Vec<ColumnRef>>::from_toml(v).or_else(|| ColumnRef::from_toml(v).map(|c| vec![c]))
    })?;
    let list = list.unwrap_or_default();
    if list.len() != chains && t.has(key) {
        return Err(t
            .bad(key, format!("found {} channels", list.len()))
            .expected(format!(
                "{chains} for a recording of kind \"{}\"",
                kind.name()
            ))
            .action("name one column for each chain, in the order of the chains"));
    }
    if let Some((i, twice)) = list
        .iter()
        .enumerate()
        .find(|(i, c)| list[..*i].contains(c))
    {
        return Err(t
            .bad(
                key,
                format!("column {twice} stands for two chains (entry {})", i + 1),
            )
            .expected("a column of its own for each chain"));
    }
    Ok(list)
}

fn motion(t: &Keys<'_>) -> Result<MotionManifest, Error> {
    let time_unit = unit_of(t, "time_unit", &[Dimension::Time])?;
    let end_effector_near_mm = t.get::<[f64; 3]>("end_effector_near_mm")?;
    let base_near_mm = t.get::<[f64; 3]>("base_near_mm")?;
    Ok(MotionManifest {
        source: file_ref(t)?,
        clock: clock(t, time_unit)?,
        unit: unit_of(t, "unit", &[Dimension::Length])?,
        end_effector: match (t.get("end_effector")?, end_effector_near_mm) {
            (Some(label), _) => label,
            (None, Some(_)) => "*".to_owned(),
            (None, None) => t.need("end_effector")?,
        },
        end_effector_near_mm,
        base: t
            .get("base")?
            .or_else(|| base_near_mm.map(|_| "*".to_owned())),
        base_near_mm,
        base_position_mm: within(t, "base_position_mm", LARGEST_MM)?,
        end_effector_offset_mm: within(t, "end_effector_offset_mm", LARGEST_MM)?,
        rotation_deg: within(t, "rotation_deg", LARGEST_DEG)?,
    })
}

/// Largest place in a laboratory, mm, and largest angle, deg: beyond, sines and sums have lost every digit.
const LARGEST_MM: f64 = 1e6;
const LARGEST_DEG: f64 = 1e6;

/// Three numbers, zero where they are not stated, none of a size beyond `largest`.
fn within(t: &Keys<'_>, key: &'static str, largest: f64) -> Result<[f64; 3], Error> {
    let values: [f64; 3] = t.get(key)?.unwrap_or_default();
    match values.iter().find(|v| v.abs() > largest) {
        None => Ok(values),
        Some(v) => Err(t
            .bad(key, format!("found {v:e}"))
            .expected(format!("numbers within {largest:e}"))),
    }
}

/// `scale` turns the volts of a file into volts at the film: it goes with V.
fn scale(t: &Keys<'_>, unit: Option<&'static Unit>) -> Result<Option<f64>, Error> {
    let Some(scale) = t.get::<f64>("scale")? else {
        return Ok(None);
    };
    if scale == 0.0 {
        return Err(t
            .bad("scale", "found 0")
            .expected("volts per volt of the file, not 0"));
    }
    if unit.is_some_and(|u| u.symbol == "kV") {
        return Err(t
            .bad("scale", format!("found {scale} beside unit = \"kV\""))
            .expected("unit = \"V\" with a scale, or unit = \"kV\" without")
            .action("a scale turns the volts of a monitor output into volts at the film"));
    }
    Ok(Some(scale))
}

fn voltage(t: &Keys<'_>, kind: Kind, chains: usize) -> Result<VoltageManifest, Error> {
    let time_unit = unit_of(t, "time_unit", &[Dimension::Time])?;
    let source = file_ref(t)?;
    if !t.has("channels") {
        return Err(t.missing(
            "channels",
            "add `channels = [...]`, one column for each chain",
        ));
    }
    let unit = volts(t)?;
    Ok(VoltageManifest {
        source,
        clock: clock(t, time_unit)?,
        channels: channels(t, "channels", kind, chains)?,
        unit,
        scale: scale(t, unit)?,
        hold_previous: t
            .choice("hold", &[("previous", true), ("linear", false)])?
            .unwrap_or(false),
    })
}

fn monitor(
    t: &Keys<'_>,
    voltage: &VoltageManifest,
    kind: Kind,
    chains: usize,
) -> Result<MonitorManifest, Error> {
    let time_unit = unit_of(t, "time_unit", &[Dimension::Time])?;
    let unit = volts(t)?;
    let channels_v = channels(t, "channels", kind, chains)?;
    let current = channels(t, "current", kind, chains)?;
    if channels_v.is_empty() && current.is_empty() {
        return Err(t.missing(
            "channels",
            "add `channels = [...]`, `current = [...]` or both",
        ));
    }
    let clock = match clock(t, time_unit)? {
        Clock::Own => voltage.clock.clone(),
        own => own,
    };
    Ok(MonitorManifest {
        source: file_ref(t)?,
        clock,
        channels: channels_v,
        current,
        unit,
        current_unit: unit_of(t, "current_unit", &[Dimension::Current])?,
        scale: scale(t, unit)?,
    })
}

/// Exactly one of two ways to give the same thing.
fn one_of(t: &Keys<'_>, a: &'static str, b: &'static str) -> Result<bool, Error> {
    match (t.has(a), t.has(b)) {
        (true, false) => Ok(true),
        (false, true) => Ok(false),
        (true, true) => Err(t
            .bad(b, format!("both `{a}` and `{b}` are given"))
            .expected("one of them")),
        (false, false) => Err(t.missing(a, &format!("add `{a} = ...` or `{b} = ...`"))),
    }
}

fn coupon(t: &Keys<'_>) -> Result<CouponManifest, Error> {
    let units = t.table("units", &const { names(&described::COUPON_UNITS) })?;
    let unit = |key, dimension| match &units {
        Some(units) => unit_of(units, key, &[dimension]),
        None => Ok(None),
    };
    let elongation = if one_of(t, "displacement", "stretch")? {
        CouponElongation::Displacement {
            displacement: Quantity {
                column: t.need("displacement")?,
                unit: unit("displacement", Dimension::Length)?,
            },
            gauge_mm: t.need_positive("gauge_mm")?,
        }
    } else {
        CouponElongation::Stretch(Quantity {
            column: t.need("stretch")?,
            unit: unit("stretch", Dimension::Ratio)?,
        })
    };
    let load = if one_of(t, "force", "nominal_stress")? {
        CouponLoad::Force {
            force: Quantity {
                column: t.need("force")?,
                unit: unit("force", Dimension::Force)?,
            },
            width_mm: t.need_positive("width_mm")?,
            thickness_mm: t.need_positive("thickness_mm")?,
        }
    } else {
        CouponLoad::NominalStress(Quantity {
            column: t.need("nominal_stress")?,
            unit: unit("nominal_stress", Dimension::Stress)?,
        })
    };
    let modes = [
        ("uniaxial", CouponMode::Uniaxial),
        ("equibiaxial", CouponMode::Equibiaxial),
        ("pure-shear", CouponMode::PureShear),
    ];
    Ok(CouponManifest {
        source: file_ref(t)?,
        mode: t.choice("mode", &modes)?.ok_or_else(|| {
            t.missing(
                "mode",
                "add `mode = \"uniaxial\"` (or equibiaxial, pure-shear)",
            )
        })?,
        clock: clock(t, unit("time", Dimension::Time)?)?,
        elongation,
        load,
    })
}

fn bench(t: &Keys<'_>) -> Result<BenchManifest, Error> {
    let units = t.table("units", &const { names(&described::BENCH_UNITS) })?;
    let unit = |key, dimension| match &units {
        Some(units) => unit_of(units, key, &[dimension]),
        None => Ok(None),
    };
    Ok(BenchManifest {
        source: file_ref(t)?,
        clock: clock(t, unit("time", Dimension::Time)?)?,
        angle: Quantity {
            column: t.need("angle")?,
            unit: unit("angle", Dimension::Angle)?,
        },
        torque: Quantity {
            column: t.need("torque")?,
            unit: unit("torque", Dimension::Torque)?,
        },
        span: span(t, "span")?,
    })
}

/// A pair of rising numbers.
fn span(t: &Keys<'_>, key: &'static str) -> Result<Option<[f64; 2]>, Error> {
    let expected = "[from, to], two rising numbers";
    let read = |v: &DeValue<'_>| {
        super::keys::numbers(v)
            .and_then(|n| <[f64; 2]>::try_from(n).ok())
            .filter(|[a, b]| a < b)
    };
    t.get_with(key, expected, read)
}

/// The file of the input, where it is another than the motion's.
fn input_source(
    t: &Keys<'_>,
    time_unit: Option<&'static Unit>,
    encoding: Option<String>,
) -> Result<Option<(FileRef, Clock)>, Error> {
    let column = t.get::<ColumnRef>("input_time")?;
    let rate_hz = t.positive("input_rate_hz")?;
    let format = t.get("input_format")?;
    let Some(file) = t.get::<String>("input_file")? else {
        return match (column.is_some(), rate_hz.is_some()) {
            (false, false) => Ok(None),
            _ => Err(t.missing(
                "input_file",
                "`input_time` and `input_rate_hz` are of an input in a file of its own: add `input_file = ...`",
            )),
        };
    };
    let clock = match (column, rate_hz) {
        (Some(column), None) => Clock::Column {
            column,
            unit: time_unit,
        },
        (None, Some(rate_hz)) => Clock::Rate { rate_hz },
        _ => {
            return Err(t.missing(
                "input_time",
                "say when the rows of `input_file` were taken: `input_time = ...` (a column) or `input_rate_hz = ...`",
            ));
        }
    };
    Ok(Some((
        FileRef {
            file: file.into(),
            format,
            encoding,
        },
        clock,
    )))
}

fn axis(t: &Keys<'_>) -> Result<AxisManifest, Error> {
    let units = t.table("units", &const { names(&described::AXIS_UNITS) })?;
    let unit = |key, dimensions: &[Dimension]| match &units {
        Some(units) => unit_of(units, key, dimensions),
        None => Ok(None),
    };
    let coordinate = if one_of(t, "position", "velocity")? {
        AxisCoordinate::Position(Quantity {
            column: t.need("position")?,
            unit: unit("position", &[Dimension::Length, Dimension::Angle])?,
        })
    } else {
        AxisCoordinate::Velocity(Quantity {
            column: t.need("velocity")?,
            unit: unit(
                "velocity",
                &[Dimension::Velocity, Dimension::AngularVelocity],
            )?,
        })
    };
    let load = match t.get("load")? {
        Some(column) => Some(Quantity {
            column,
            unit: unit("load", &[Dimension::Force, Dimension::Torque])?,
        }),
        None => None,
    };
    let clock = clock(t, unit("time", &[Dimension::Time])?)?;
    let inertia = if one_of(t, "mass_kg", "inertia_kg_m2")? {
        AxisInertia::MassKg(t.need("mass_kg")?)
    } else {
        AxisInertia::InertiaKgM2(t.need("inertia_kg_m2")?)
    };
    let zero = NumberOrEstimate::Number(0.0);
    let source = file_ref(t)?;
    let time_unit = unit("time", &[Dimension::Time])?;
    let input_unit = unit("input_time", &[Dimension::Time])?.or(time_unit);
    let input_source = input_source(t, input_unit, source.encoding.clone())?;
    let mut scale = [1.0; 3];
    if let Some(table) = t.table("scale", &const { names(&described::AXIS_SCALE) })? {
        let keys = ["position", "velocity", "input", "load"];
        for (key, place) in keys.into_iter().zip([0, 0, 1, 2]) {
            if let Some(factor) = table.get::<f64>(key)? {
                if factor == 0.0 || !factor.is_finite() {
                    return Err(table
                        .bad(key, format!("found {factor}"))
                        .expected("a factor other than 0"));
                }
                scale[place] = factor;
            }
        }
    }
    Ok(AxisManifest {
        source,
        input_source,
        scale,
        span_s: span(t, "span_s")?,
        input_power: t.positive("input_power")?.unwrap_or(1.0),
        clock,
        coordinate,
        input: t.need("input")?,
        input_unit: match &units {
            Some(units) => units.get("input")?,
            None => None,
        },
        load,
        input_gain: t.need("input_gain")?,
        inertia,
        damping: t.get("damping")?.unwrap_or(zero),
        stiffness: t.get("stiffness")?.unwrap_or(zero),
    })
}

/// The error for a recording that names no rig and needs one.
pub(super) fn missing_rig(path: &Path, kind: Kind) -> Error {
    Error::new(ErrorKind::MissingKey, path, "the key is missing")
        .at_key("[recording] rig")
        .expected(format!(
            "a rig file for a recording of kind \"{}\"",
            kind.name()
        ))
        .action("add `rig = \"rig.toml\"`")
}
