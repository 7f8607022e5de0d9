//! What the instrument wrote: its own clock, axes, units and gaps.
//!
//! A [`Recording`] is a folder with a `recording.toml` ([`Manifest`]) and the files it names, read as they
//! are. This room fills no gap and converts no unit: a missing sample is NaN, and the unit stands beside the
//! values. Only times are put in seconds. If a file is wrong, the [`Error`] says which, in what line and
//! column (or key), what was found, what was expected, and what to do.
//!
//! One importer reads one kind of file and is told by content: see [`Importer`] and [`importers`].
//! [`read_file`] reads a bare file without a manifest.
//!
//! ```no_run
//! use deacal::recording::Recording;
//! let recording = Recording::open("datasets/sym-01".as_ref())?;
//! for note in &recording.notes {
//!     println!("{}: {}", note.path.display(), note.text);
//! }
//! # Ok::<(), deacal::recording::Error>(())
//! ```

mod c3d;
mod capture;
mod delimited;
mod described;
pub(crate) mod error;
pub(crate) mod keys;
mod lvm;
mod manifest;
mod mat;
mod mat73;
pub mod mcap;
mod nexus_csv;
mod open;
mod opened;
mod optitrack_csv;
mod oscilloscope;
mod pose;
mod qualisys_tsv;
mod rig;
mod rows;
mod survey;
mod tdms;
pub mod text;
mod trc;
mod xlsx;

use std::path::PathBuf;

pub use c3d::C3d;
pub use capture::{
    Capture, Column, ColumnRef, Gaps, Group, Importer, Keep, Level, Note, ReadOptions, RowLines,
    Section, Sink, importer_for, importers, read_file, read_file_as,
};
pub use delimited::Delimited;
pub use described::{DAY, recording_schema, reference, rig_schema};
pub use error::{Error, ErrorKind, nearest, suggestion};
pub use lvm::Lvm;
pub use manifest::{
    AxisCoordinate, AxisInertia, AxisManifest, BenchManifest, Clock, CouponElongation, CouponLoad,
    CouponManifest, CouponMode, FileRef, FilmState, Kind, Manifest, MonitorManifest,
    MotionManifest, NumberOrEstimate, Payload, PayloadStep, Quantity, SharedManifest, Start,
    VoltageManifest, is_id,
};
pub use mcap::Mcap;
pub use nexus_csv::{NexusCsv, TrackerCsv};
pub use open::{sha256, sha256_of};
pub use opened::{open, share_read, was_opened};
pub use optitrack_csv::OptitrackCsv;
pub use oscilloscope::{Keysight, Rigol, RohdeSchwarz, Tektronix};
pub use qualisys_tsv::QualisysTsv;
pub use rig::{Actuator, Delta, FilmSampleRig, Rig, RobotFilm, RobotMass, RobotRig, Sam, Stated};
pub use survey::{
    ColumnSurvey, Doubt, DoubtKind, GroupSurvey, MarkerSurvey, SectionSurvey, Survey, survey_file,
};
pub use tdms::Tdms;
pub use trc::Trc;

use crate::units::Unit;

/// What a file is in a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// `recording.toml`.
    Manifest,
    /// The rig file.
    Rig,
    /// `[motion]`.
    Motion,
    /// `[voltage]`.
    Voltage,
    /// `[monitor]`.
    Monitor,
    /// `[coupon]`.
    Coupon,
    /// `[bench]`.
    Bench,
    /// `[axis]`.
    Axis,
}

impl Role {
    /// In one word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Role::Manifest => "manifest",
            Role::Rig => "rig",
            Role::Motion => "motion",
            Role::Voltage => "voltage",
            Role::Monitor => "monitor",
            Role::Coupon => "coupon",
            Role::Bench => "bench",
            Role::Axis => "axis",
        }
    }
}

/// A file that a recording was read from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// As it was opened.
    pub path: PathBuf,
    /// What it is.
    pub role: Role,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
    /// Name of the importer; `toml` for manifest and rig.
    pub format: String,
}

/// A marker, one position a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Marker {
    /// As the file has it, subject prefix included.
    pub label: String,
    /// Position in capture axes, in [`RawMotion::unit`]; NaN where it was not seen.
    pub xyz: Vec<[f64; 3]>,
    /// Of a rigid body, its rotation as a quaternion x, y, z, w whose sign does not jump; NaN where it was
    /// not seen. `None` for a marker, and where the file has angles whose order it does not state.
    pub rotation: Option<Vec<[f64; 4]>>,
}

/// `[motion]` as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawMotion {
    /// Samples per second, Hz: declared, or the median of the stamps.
    pub rate_hz: f64,
    /// Number of the first sample where the file counts frames: its time is (first_frame - 1)/rate. Frame
    /// numbers go on without a hole: frames that the file leaves out are samples that were not seen.
    pub first_frame: Option<i64>,
    /// Time of every sample on the motion clock, s.
    pub time_s: Vec<f64>,
    /// Unit of the positions: `mm`.
    pub unit: &'static Unit,
    /// The marker that moves.
    pub end_effector: Marker,
    /// The marker fixed to the frame.
    pub base: Option<Marker>,
    /// The channel that tells the clock offset.
    pub shared: Option<RawShared>,
}

/// A channel that was logged beside the motion and shows a voltage.
#[derive(Debug, Clone, PartialEq)]
pub struct RawShared {
    /// What the column is called.
    pub label: String,
    /// The chain whose voltage it shows, from 0.
    pub chain: usize,
    /// Time of every sample on the motion clock, s.
    pub time_s: Vec<f64>,
    /// Values in a unit that does not matter; NaN where a cell was empty.
    pub values: Vec<f64>,
}

/// `[voltage]` as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawVoltage {
    /// Time of every sample on the voltage clock, s; strictly rising.
    pub time_s: Vec<f64>,
    /// One list a chain, in `unit`; NaN where a cell was empty.
    pub channels: Vec<Vec<f64>>,
    /// What the columns are called.
    pub labels: Vec<String>,
    /// V or kV.
    pub unit: &'static Unit,
    /// volts at the film = value * unit * scale; `None`: 1.
    pub scale: Option<f64>,
    /// Between samples the amplifier holds the last value; else linear.
    pub hold_previous: bool,
}

/// `[monitor]` as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawMonitor {
    /// Time of every sample on the voltage clock, s; strictly rising.
    pub time_s: Vec<f64>,
    /// Measured voltages, one a chain, in `unit`; empty if none are logged.
    pub channels: Vec<Vec<f64>>,
    /// V or kV.
    pub unit: &'static Unit,
    /// volts at the film = value * unit * scale; `None`: 1.
    pub scale: Option<f64>,
    /// Measured currents, one a chain; empty if none are logged.
    pub current: Vec<RawColumn>,
}

/// One quantity of a plain table.
#[derive(Debug, Clone, PartialEq)]
pub struct RawColumn {
    /// What the column is called.
    pub label: String,
    /// Its unit; `None` only for the input of an axis in a unit of its own.
    pub unit: Option<&'static Unit>,
    /// One value a row, in `unit`; NaN where a cell was empty.
    pub values: Vec<f64>,
}

/// How far a coupon was pulled.
#[derive(Debug, Clone, PartialEq)]
pub enum RawElongation {
    /// Displacement, over a gauge length.
    Displacement {
        /// Measured.
        displacement: RawColumn,
        /// Length at zero displacement, mm.
        gauge_mm: f64,
    },
    /// Stretch, a pure number.
    Stretch(RawColumn),
}

/// How hard a coupon pulled back.
#[derive(Debug, Clone, PartialEq)]
pub enum RawLoad {
    /// Force, over the unstretched section.
    Force {
        /// Measured.
        force: RawColumn,
        /// Unstretched width, mm.
        width_mm: f64,
        /// Unstretched thickness, mm.
        thickness_mm: f64,
    },
    /// Nominal stress.
    NominalStress(RawColumn),
}

/// `[coupon]` as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawCoupon {
    /// Uniaxial, equibiaxial or pure shear.
    pub mode: CouponMode,
    /// Time of every row, s; `None` where the file has none.
    pub time_s: Option<Vec<f64>>,
    /// Rows whose time does not come after the row before, from 0. Such a row begins another test, or is an
    /// error of the instrument; it is left as it is and noted.
    pub time_steps_back: Vec<usize>,
    /// Displacement or stretch.
    pub elongation: RawElongation,
    /// Force or nominal stress.
    pub load: RawLoad,
}

/// `[bench]` as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawBench {
    /// Time of every row, s; `None` where the order of the rows is all that is known.
    pub time_s: Option<Vec<f64>>,
    /// Angle of the hinge.
    pub angle: RawColumn,
    /// Its torque.
    pub torque: RawColumn,
}

/// What moved on an axis.
#[derive(Debug, Clone, PartialEq)]
pub enum RawCoordinate {
    /// Position or angle.
    Position(RawColumn),
    /// Velocity or angular velocity.
    Velocity(RawColumn),
}

/// `[axis]` as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawAxis {
    /// Time of every row, s; strictly rising.
    pub time_s: Vec<f64>,
    /// Time of every row of the input on its own clock, s, where it has one.
    pub input_time_s: Option<Vec<f64>>,
    /// Position or velocity, times the manifest's scale.
    pub coordinate: RawCoordinate,
    /// What drives.
    pub input: RawColumn,
    /// Its unit as the manifest or the header writes it; empty where neither says.
    pub input_unit: String,
    /// Measured external force, along +position.
    pub load: Option<RawColumn>,
}

/// A recording: manifest, rig, and what the instruments wrote.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// What `recording.toml` says.
    pub manifest: Manifest,
    /// The rig that the manifest (or [`OpenOptions::rig`]) names.
    pub rig: Option<Rig>,
    /// Its file.
    pub rig_path: Option<PathBuf>,
    /// The `recording.toml`.
    pub path: PathBuf,
    /// Its folder.
    pub dir: PathBuf,
    /// Robot, film sample.
    pub motion: Option<RawMotion>,
    /// Robot, film sample.
    pub voltage: Option<RawVoltage>,
    /// Robot, film sample; optional.
    pub monitor: Option<RawMonitor>,
    /// Film coupon.
    pub coupon: Option<RawCoupon>,
    /// Hinge bench.
    pub bench: Option<RawBench>,
    /// Axis.
    pub axis: Option<RawAxis>,
    /// Every file that was read.
    pub sources: Vec<Source>,
    /// What was found and dropped, file by file.
    pub notes: Vec<Note>,
}

/// What may be told apart from the manifest.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// A rig file instead of the one that the manifest names.
    pub rig: Option<PathBuf>,
}
