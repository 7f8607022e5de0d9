//! Reads the files that a manifest names, and puts what is asked for together.

use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use ring::digest::{Context, SHA256};

use super::capture::{
    Capture, Column, ColumnRef, Note, ReadOptions, RowLines, Section, read_file_as, without_subject,
};
use super::error::{Error, ErrorKind, quote, suggestion};
use super::manifest::{
    AxisCoordinate, AxisManifest, BenchManifest, Clock, CouponElongation, CouponLoad,
    CouponManifest, FileRef, Kind, Manifest, MonitorManifest, MotionManifest, SharedManifest,
    VoltageManifest, missing_rig,
};
use super::pose::{largest_turn_deg, rotations};
use super::rig::Rig;
use super::{
    Marker, OpenOptions, RawAxis, RawBench, RawColumn, RawCoordinate, RawCoupon, RawElongation,
    RawLoad, RawMonitor, RawMotion, RawShared, RawVoltage, Recording, Role, Source,
};
use crate::units::{Dimension, Unit};

impl Recording {
    /// Opens a `recording.toml`, or the folder that has one, and reads every file it names.
    ///
    /// # Errors
    /// See [`ErrorKind`]; the first thing wrong is reported.
    pub fn open(path: &Path) -> Result<Self, Error> {
        Self::open_with(path, &OpenOptions::default())
    }

    /// As [`Recording::open`], with options.
    ///
    /// # Errors
    /// See [`ErrorKind`]; the first thing wrong is reported.
    pub fn open_with(path: &Path, options: &OpenOptions) -> Result<Self, Error> {
        let path = manifest_path(path)?;
        let dir = path.parent().unwrap_or(Path::new("")).to_owned();
        let manifest = Manifest::read(&path)?;
        let mut reader = Reader {
            dir: &dir,
            sources: Vec::new(),
            notes: Vec::new(),
        };
        reader.source(&path, Role::Manifest, "toml")?;

        let rig_path = options
            .rig
            .clone()
            .or_else(|| manifest.rig.as_ref().map(|rig| dir.join(rig)));
        let rig = match &rig_path {
            Some(rig_path) => Some(reader.rig(rig_path, manifest.kind, &path)?),
            None if matches!(manifest.kind, Kind::Robot | Kind::FilmSample) => {
                return Err(missing_rig(&path, manifest.kind));
            }
            None => None,
        };

        let motion = manifest
            .motion
            .as_ref()
            .map(|m| reader.motion(m, manifest.shared.as_ref()))
            .transpose()?;
        let frames = motion.as_ref().map_or(0, |m| m.time_s.len());
        let mut voltage = manifest
            .voltage
            .as_ref()
            .map(|v| reader.voltage(v))
            .transpose()?;
        if let Some(v) = &mut voltage {
            reader.thin("voltage", &mut v.time_s, &mut v.channels, frames);
        }
        let mut monitor = match (&manifest.monitor, &voltage) {
            (Some(m), Some(v)) => Some(reader.monitor(m, v.unit)?),
            _ => None,
        };
        if let Some(m) = &mut monitor
            && m.current.is_empty()
        {
            reader.thin("monitor", &mut m.time_s, &mut m.channels, frames);
        }
        let coupon = manifest
            .coupon
            .as_ref()
            .map(|c| reader.coupon(c))
            .transpose()?;
        let bench = manifest
            .bench
            .as_ref()
            .map(|b| reader.bench(b))
            .transpose()?;
        let axis = manifest.axis.as_ref().map(|a| reader.axis(a)).transpose()?;
        let Reader { sources, notes, .. } = reader;
        Ok(Recording {
            manifest,
            rig,
            rig_path,
            path,
            dir,
            motion,
            voltage,
            monitor,
            coupon,
            bench,
            axis,
            sources,
            notes,
        })
    }
}

/// The manifest, where a folder is named the one in it.
fn manifest_path(path: &Path) -> Result<PathBuf, Error> {
    if !path.is_dir() {
        return Ok(path.to_owned());
    }
    let inside = path.join("recording.toml");
    if !inside.exists() {
        return Err(Error::new(
            ErrorKind::NotFound,
            path,
            "the folder has no recording.toml",
        )
        .action(match inside_of(path).as_slice() {
            [] => "name a folder with a recording.toml, or the file itself".to_owned(),
            names => format!("name the recordings in it: {}", names.join(", ")),
        }));
    }
    Ok(inside)
}

/// The first recordings in a folder.
fn inside_of(folder: &Path) -> Vec<String> {
    const MOST: usize = 6;
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let manifests = entries
        .map(|e| e.path())
        .filter(|p| p.join("recording.toml").is_file());
    let mut names: Vec<String> = manifests.map(|p| p.display().to_string()).collect();
    names.sort();
    if names.len() > MOST {
        names.truncate(MOST);
        names.push("...".to_owned());
    }
    names
}

impl Recording {
    /// SHA-256 of what the instruments measured, hexadecimal: motion and voltage (or a coupon's, bench's or
    /// axis' own columns), number for number. Names, labels, rig and all that the manifest states do not
    /// count, so that a copy under another id has the same sum.
    #[must_use]
    pub fn content_sum(&self) -> String {
        let mut hasher = Context::new(&SHA256);
        let mut list = |values: &[f64]| {
            hasher.update(&(values.len() as u64).to_le_bytes());
            // one NaN is as good as another
            let bits = |v: &f64| if v.is_nan() { f64::NAN } else { *v }.to_bits();
            for some in values.chunks(4096) {
                let bytes: Vec<u8> = some.iter().flat_map(|v| bits(v).to_le_bytes()).collect();
                hasher.update(&bytes);
            }
        };
        if let Some(m) = &self.motion {
            list(&m.time_s);
            list(m.end_effector.xyz.as_flattened());
        }
        if let Some(v) = &self.voltage {
            list(&v.time_s);
            v.channels.iter().for_each(|c| list(c));
        }
        if let Some(c) = &self.coupon {
            list(c.time_s.as_deref().unwrap_or_default());
            let (RawElongation::Displacement {
                displacement: elongation,
                ..
            }
            | RawElongation::Stretch(elongation)) = &c.elongation;
            let (RawLoad::Force { force: load, .. } | RawLoad::NominalStress(load)) = &c.load;
            list(&elongation.values);
            list(&load.values);
        }
        if let Some(b) = &self.bench {
            list(b.time_s.as_deref().unwrap_or_default());
            list(&b.angle.values);
            list(&b.torque.values);
        }
        if let Some(a) = &self.axis {
            list(&a.time_s);
            let (RawCoordinate::Position(x) | RawCoordinate::Velocity(x)) = &a.coordinate;
            list(&x.values);
            list(&a.input.values);
        }
        hex(hasher.finish().as_ref())
    }
}

fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::new(), |mut hex, byte| {
        let _ = write!(hex, "{byte:02x}");
        hex
    })
}

/// SHA-256 of a file, hexadecimal.
///
/// # Errors
/// The file cannot be read.
pub fn sha256(path: &Path) -> Result<String, Error> {
    super::opened::open(path)
        .and_then(sha256_of)
        .map_err(|e| Error::io(path, e))
}

/// SHA-256 of all that a reader gives, hexadecimal.
///
/// # Errors
/// The reader's.
pub fn sha256_of(mut source: impl Read) -> std::io::Result<String> {
    let mut hasher = Context::new(&SHA256);
    let mut buffer = vec![0; 64 * 1024];
    loop {
        let read = source.read(&mut buffer)?;
        if read == 0 {
            break;
        }
        hasher.update(&buffer[..read]);
    }
    Ok(hex(hasher.finish().as_ref()))
}

/// Columns of one section, with the time of their rows.
struct Table {
    path: PathBuf,
    time_s: Option<Vec<f64>>,
    columns: Vec<Column>,
    lines: RowLines,
}

/// Samples of a voltage log that are held: three hours at 1 kHz.
const LOG_SAMPLES: usize = 11_000_000;

/// Reads the files of one recording.
struct Reader<'a> {
    dir: &'a Path,
    sources: Vec<Source>,
    notes: Vec<Note>,
}

impl Reader<'_> {
    fn source(&mut self, path: &Path, role: Role, format: &str) -> Result<(), Error> {
        self.sources.push(Source {
            path: path.to_owned(),
            role,
            sha256: sha256(path)?,
            format: format.to_owned(),
        });
        Ok(())
    }

    /// Reads a file; `columns` are those that will be used, where only some are.
    fn capture(
        &mut self,
        source: &FileRef,
        role: Role,
        columns: Option<Vec<ColumnRef>>,
    ) -> Result<(PathBuf, Capture), Error> {
        let path = self.dir.join(&source.file);
        let options = ReadOptions {
            encoding: source.encoding.clone(),
            columns,
        };
        let mut capture = read_file_as(&path, source.format.as_deref(), &options)?;
        self.source(&path, role, capture.format)?;
        // motion, voltage and monitor may stand in one file, which says what is in it once
        for note in capture.notes.drain(..) {
            if !self.notes.contains(&note) {
                self.notes.push(note);
            }
        }
        Ok((path, capture))
    }

    /// Reads columns that share a clock.
    fn table(
        &mut self,
        source: &FileRef,
        role: Role,
        clock: &Clock,
        wanted: &[&ColumnRef],
    ) -> Result<Table, Error> {
        let mut asked: Vec<ColumnRef> = wanted.iter().map(|c| (*c).clone()).collect();
        if let Clock::Column { column, .. } = clock {
            asked.push(column.clone());
        }
        let (path, mut capture) = self.capture(source, role, Some(asked.clone()))?;
        let mut places = asked
            .iter()
            .map(|column| capture.find_column(&path, column))
            .collect::<Result<Vec<_>, _>>()?;
        let index = places.first().map_or(0, |p| p.0);
        if places.iter().any(|p| p.0 != index) {
            return Err(Error::new(
                ErrorKind::Ambiguous,
                &path,
                format!("the columns of [{}] are in several sections", role.name()),
            )
            .action("name columns of one section: they share a clock"));
        }
        let Some(section) = capture.sections.get_mut(index) else {
            return Err(Error::new(
                ErrorKind::NoData,
                &path,
                "the file has no section",
            ));
        };
        let time_s = match clock {
            Clock::Own => section.times_s(),
            #[allow(clippy::cast_precision_loss)]
            Clock::Rate { rate_hz } => {
                self.notes.extend(overruled(&path, section, *rate_hz));
                Some((0..section.rows()).map(|i| i as f64 / rate_hz).collect())
            }
            Clock::Column { unit, .. } => {
                let (_, place) = places.pop().unwrap_or_default();
                let own = !places.iter().any(|(_, c)| *c == place);
                let column = &mut section.columns[place];
                let values = match own {
                    true => std::mem::take(&mut column.values),
                    false => column.values.clone(),
                };
                Some(self.seconds(&path, role, column, values, *unit)?)
            }
        };
        let columns = places
            .iter()
            .enumerate()
            .map(|(i, (_, c))| {
                if places[i + 1..].iter().any(|(_, later)| later == c) {
                    section.columns[*c].clone()
                } else {
                    Column {
                        values: std::mem::take(&mut section.columns[*c].values),
                        ..section.columns[*c].clone()
                    }
                }
            })
            .collect();
        Ok(Table {
            path,
            time_s,
            columns,
            lines: std::mem::take(&mut section.lines),
        })
    }

    /// A time column in seconds.
    fn seconds(
        &mut self,
        path: &Path,
        role: Role,
        column: &Column,
        mut values: Vec<f64>,
        declared: Option<&'static Unit>,
    ) -> Result<Vec<f64>, Error> {
        let unit = match unit_of(path, column, declared, Dimension::Time)? {
            Some(unit) => unit,
            None if column.called_time() => {
                self.notes.push(Note::warning(
                    path,
                    format!("column {} has no unit; taken as seconds", column.title()),
                ));
                return Ok(values);
            }
            None => {
                let key = match role {
                    Role::Motion | Role::Voltage | Role::Monitor => "time_unit = \"s\"",
                    _ => "units = { time = \"s\" }",
                };
                return Err(no_unit(path, column, "s, ms or us").action(format!(
                    "add `{key}` under [{}] in the recording.toml",
                    role.name()
                )));
            }
        };
        values.iter_mut().for_each(|t| *t *= unit.to_si);
        if let [first, .., last] = values.as_slice()
            && let Some(doubt) = slow(column, [*first, *last], values.len() - 1, unit)
        {
            self.notes.push(Note::warning(path, doubt));
        }
        Ok(values)
    }

    /// Keeps every n-th sample of a log that is too long to be held, but at least one a frame of the motion,
    /// and says so.
    fn thin(
        &mut self,
        what: &str,
        time_s: &mut Vec<f64>,
        channels: &mut [Vec<f64>],
        frames: usize,
    ) {
        let samples = time_s.len();
        let every = samples.div_ceil(LOG_SAMPLES).min(samples / frames.max(1));
        if every < 2 {
            return;
        }
        for values in std::iter::once(time_s).chain(channels) {
            *values = values.iter().copied().step_by(every).collect();
        }
        let path = self
            .sources
            .last()
            .map_or(PathBuf::new(), |s| s.path.clone());
        self.notes.push(Note::warning(
            &path,
            format!(
                "{samples} samples of the {what} are more than are held at once ({LOG_SAMPLES}): one in {every} is taken, as a slower log \
                 would have it"
            ),
        ));
    }

    fn voltage(&mut self, m: &VoltageManifest) -> Result<RawVoltage, Error> {
        let wanted: Vec<&ColumnRef> = m.channels.iter().collect();
        let mut table = self.table(&m.source, Role::Voltage, &m.clock, &wanted)?;
        let time_s = rising_time(&mut table, Role::Voltage)?;
        let unit = volts(&table, &table.columns, m.unit, m.scale)?;
        let Some(unit) = unit else {
            let column = &table.columns[0];
            return Err(no_unit(&table.path, column, "V or kV")
                .action("add `unit = \"kV\"` (or \"V\") under [voltage] in the recording.toml"));
        };
        self.check_size(&table, unit, m.scale);
        Ok(RawVoltage {
            time_s,
            labels: table.columns.iter().map(Column::title).collect(),
            channels: table.columns.into_iter().map(|c| c.values).collect(),
            unit,
            scale: m.scale,
            hold_previous: m.hold_previous,
        })
    }

    /// Says when the voltages look a thousand times too small or too large.
    fn check_size(&mut self, table: &Table, unit: &Unit, scale: Option<f64>) {
        let largest = table
            .columns
            .iter()
            .flat_map(|c| &c.values)
            .fold(0.0_f64, |m, v| m.max(v.abs()))
            * unit.to_si
            * scale.unwrap_or(1.0).abs();
        if largest > 0.0 && largest < 20.0 {
            self.notes.push(Note::warning(
                &table.path,
                format!("the largest voltage is {largest} V: is the unit kV, or a scale missing?"),
            ));
        } else if largest > 50_000.0 {
            self.notes.push(Note::warning(
                &table.path,
                format!(
                    "the largest voltage is {} kV: is the unit V?",
                    largest / 1000.0
                ),
            ));
        }
    }

    fn monitor(
        &mut self,
        m: &MonitorManifest,
        voltage_unit: &'static Unit,
    ) -> Result<RawMonitor, Error> {
        let wanted: Vec<&ColumnRef> = m.channels.iter().chain(&m.current).collect();
        let mut table = self.table(&m.source, Role::Monitor, &m.clock, &wanted)?;
        let time_s = rising_time(&mut table, Role::Monitor)?;
        let currents = table.columns.split_off(m.channels.len());
        let unit = volts(&table, &table.columns, m.unit, m.scale)?.unwrap_or(voltage_unit);
        let mut current = Vec::new();
        for column in currents {
            current.push(raw(
                &table.path,
                column,
                m.current_unit,
                Dimension::Current,
                "current_unit = \"mA\"",
            )?);
        }
        Ok(RawMonitor {
            time_s,
            channels: table.columns.into_iter().map(|c| c.values).collect(),
            unit,
            scale: m.scale,
            current,
        })
    }

    fn coupon(&mut self, m: &CouponManifest) -> Result<RawCoupon, Error> {
        let far = match &m.elongation {
            CouponElongation::Displacement { displacement, .. } => displacement,
            CouponElongation::Stretch(stretch) => stretch,
        };
        let hard = match &m.load {
            CouponLoad::Force { force, .. } => force,
            CouponLoad::NominalStress(stress) => stress,
        };
        let table = self.table(
            &m.source,
            Role::Coupon,
            &m.clock,
            &[&far.column, &hard.column],
        )?;
        let mut time_steps_back = Vec::new();
        if let Some(time_s) = &table.time_s {
            complete(&table, time_s)?;
            time_steps_back = (1..time_s.len())
                .filter(|i| time_s[*i] <= time_s[i - 1])
                .collect();
            if let Some(first) = time_steps_back.first() {
                self.notes.push(
                    Note::warning(
                        &table.path,
                        format!(
                            "time does not rise in {} rows, here from {} s to {} s",
                            time_steps_back.len(),
                            time_s[first - 1],
                            time_s[*first]
                        ),
                    )
                    .at_line(table.lines.line(*first)),
                );
            }
        }
        let Table {
            path,
            time_s,
            columns,
            ..
        } = table;
        let (far_column, hard_column) = pair(&path, columns)?;
        let elongation = match &m.elongation {
            CouponElongation::Displacement { gauge_mm, .. } => RawElongation::Displacement {
                displacement: raw(
                    &path,
                    far_column,
                    far.unit,
                    Dimension::Length,
                    "units = { displacement = \"mm\" }",
                )?,
                gauge_mm: *gauge_mm,
            },
            CouponElongation::Stretch(_) => {
                // a stretch is a pure number: no unit is the rule
                let unit = far.unit.or_else(|| Unit::parse("1"));
                RawElongation::Stretch(raw(
                    &path,
                    far_column,
                    unit,
                    Dimension::Ratio,
                    "units = { stretch = \"1\" }",
                )?)
            }
        };
        let load = match &m.load {
            CouponLoad::Force {
                width_mm,
                thickness_mm,
                ..
            } => RawLoad::Force {
                force: raw(
                    &path,
                    hard_column,
                    hard.unit,
                    Dimension::Force,
                    "units = { force = \"N\" }",
                )?,
                width_mm: *width_mm,
                thickness_mm: *thickness_mm,
            },
            CouponLoad::NominalStress(_) => RawLoad::NominalStress(raw(
                &path,
                hard_column,
                hard.unit,
                Dimension::Stress,
                "units = { nominal_stress = \"kPa\" }",
            )?),
        };
        Ok(RawCoupon {
            mode: m.mode,
            time_s,
            time_steps_back,
            elongation,
            load,
        })
    }

    fn bench(&mut self, m: &BenchManifest) -> Result<RawBench, Error> {
        let mut table = self.table(
            &m.source,
            Role::Bench,
            &m.clock,
            &[&m.angle.column, &m.torque.column],
        )?;
        let time_s = match table.time_s {
            Some(_) => Some(rising_time(&mut table, Role::Bench)?),
            None => None,
        };
        let (angle, torque) = pair(&table.path, table.columns)?;
        Ok(RawBench {
            time_s,
            angle: raw(
                &table.path,
                angle,
                m.angle.unit,
                Dimension::Angle,
                "units = { angle = \"rad\" }",
            )?,
            torque: raw(
                &table.path,
                torque,
                m.torque.unit,
                Dimension::Torque,
                "units = { torque = \"N m\" }",
            )?,
        })
    }

    fn axis(&mut self, m: &AxisManifest) -> Result<RawAxis, Error> {
        let moved = match &m.coordinate {
            AxisCoordinate::Position(q) | AxisCoordinate::Velocity(q) => q,
        };
        let mut wanted = vec![&moved.column];
        if m.input_source.is_none() {
            wanted.push(&m.input);
        }
        wanted.extend(m.load.as_ref().map(|l| &l.column));
        let mut table = self.table(&m.source, Role::Axis, &m.clock, &wanted)?;
        let time_s = rising_time(&mut table, Role::Axis)?;
        let path = table.path.clone();
        let load = match &m.load {
            Some(load) => table.columns.pop().map(|c| (load, c)),
            None => None,
        };
        let mut input_time_s = None;
        if let Some((source, clock)) = &m.input_source {
            let mut other = self.table(source, Role::Axis, clock, &[&m.input])?;
            input_time_s = Some(rising_time(&mut other, Role::Axis)?);
            table.columns.extend(other.columns);
        }
        let (mut coordinate, mut input) = pair(&path, table.columns)?;
        for (column, factor) in [(&mut coordinate, m.scale[0]), (&mut input, m.scale[1])] {
            column.values.iter_mut().for_each(|v| *v *= factor);
        }
        // an axis may slide or turn: the unit says which
        let turns = |unit: Option<&Unit>, column: &Column, turning: Dimension| {
            unit.or_else(|| Unit::parse(&column.unit))
                .is_some_and(|u| u.dimension == turning)
        };
        let either = |unit, column: &Column, sliding, turning| {
            if turns(unit, column, turning) {
                turning
            } else {
                sliding
            }
        };
        let coordinate = match &m.coordinate {
            AxisCoordinate::Position(q) => {
                let d = either(q.unit, &coordinate, Dimension::Length, Dimension::Angle);
                RawCoordinate::Position(raw(
                    &path,
                    coordinate,
                    q.unit,
                    d,
                    "units = { position = \"m\" }",
                )?)
            }
            AxisCoordinate::Velocity(q) => {
                let d = either(
                    q.unit,
                    &coordinate,
                    Dimension::Velocity,
                    Dimension::AngularVelocity,
                );
                RawCoordinate::Velocity(raw(
                    &path,
                    coordinate,
                    q.unit,
                    d,
                    "units = { velocity = \"m/s\" }",
                )?)
            }
        };
        let load = match load {
            Some((q, mut column)) => {
                column.values.iter_mut().for_each(|v| *v *= m.scale[2]);
                let d = either(q.unit, &column, Dimension::Force, Dimension::Torque);
                Some(raw(&path, column, q.unit, d, "units = { load = \"N\" }")?)
            }
            None => None,
        };
        let header_unit = Unit::parse(&input.unit);
        let declared = m.input_unit.as_deref().and_then(Unit::parse);
        if let (Some(header), Some(declared)) = (header_unit, declared)
            && header != declared
        {
            return Err(contradiction(&path, &input, declared));
        }
        let input_unit = m.input_unit.clone().unwrap_or_else(|| input.unit.clone());
        Ok(RawAxis {
            time_s,
            input_time_s,
            coordinate,
            input: RawColumn {
                label: input.title(),
                unit: declared.or(header_unit),
                values: input.values,
            },
            input_unit,
            load,
        })
    }

    /// Reads the rig of a recording of this kind.
    fn rig(&mut self, path: &Path, kind: Kind, manifest: &Path) -> Result<Rig, Error> {
        let rig = Rig::read(path)?;
        let fits = match kind {
            Kind::Robot => matches!(rig, Rig::Robot(_)),
            Kind::FilmSample => matches!(rig, Rig::FilmSample(_)),
            _ => true,
        };
        if !fits {
            return Err(
                Error::new(ErrorKind::BadValue, path, "the rig is of another kind")
                    .at_key("[rig] kind")
                    .expected(format!("\"{}\" as {}", kind.name(), manifest.display()))
                    .action("name the right rig file under [recording] rig"),
            );
        }
        self.source(path, Role::Rig, "toml")?;
        Ok(rig)
    }

    fn motion(
        &mut self,
        m: &MotionManifest,
        shared: Option<&SharedManifest>,
    ) -> Result<RawMotion, Error> {
        let (path, capture) = self.capture(&m.source, Role::Motion, None)?;
        let all = markers(&capture);
        let (end, base) = self.end_and_base(&path, &capture, &all, m)?;
        let section = &capture.sections[end.section];
        let unit = positions_unit(&path, section, end, m.unit)?;
        if let Some(base) = base
            && positions_unit(&path, &capture.sections[base.section], base, m.unit)? != unit
        {
            return Err(Error::new(
                ErrorKind::WrongUnit,
                &path,
                format!("{} and {} are in different units", end.label, base.label),
            )
            .expected("one unit for both markers"));
        }

        let clock = self.motion_clock(&path, section, &m.clock)?;
        let end_effector = on_clock(section, end, &clock);
        let base = base.map(|base| {
            if base.section == end.section {
                return on_clock(section, base, &clock);
            }
            let own = &capture.sections[base.section];
            let row = |i: usize| base.columns.map(|c| own.columns[c].values[i]);
            Marker {
                label: base.label.clone(),
                xyz: (0..own.rows()).map(row).collect(),
                rotation: None,
            }
        });
        let shared = shared.map(|s| raw_shared(&path, &capture, s)).transpose()?;
        for marker in std::iter::once(&end_effector).chain(&base) {
            self.check_marker(&path, marker)?;
        }
        Ok(RawMotion {
            rate_hz: clock.rate_hz,
            first_frame: clock.first_frame,
            time_s: clock.time_s,
            unit,
            end_effector,
            base,
            shared,
        })
    }

    /// The columns of the end effector, and of the base if one is named.
    fn end_and_base<'a>(
        &mut self,
        path: &Path,
        capture: &Capture,
        all: &'a [MarkerColumns],
        m: &MotionManifest,
    ) -> Result<(&'a MarkerColumns, Option<&'a MarkerColumns>), Error> {
        let mut choose = |label: &str, near: Option<[f64; 3]>, section: Option<usize>| {
            let inside: Vec<&'a MarkerColumns> = all
                .iter()
                .filter(|a| section.is_none_or(|s| a.section == s))
                .collect();
            let hits = called(&inside, label);
            match near {
                Some(near_mm) if !hits.is_empty() => {
                    let (marker, note) = nearest_marker(path, capture, &hits, near_mm, m.unit)?;
                    self.notes.push(note);
                    Ok(marker)
                }
                _ => pick(path, &inside, &hits, label),
            }
        };
        let end = choose(&m.end_effector, m.end_effector_near_mm, None)?;
        let base = match &m.base {
            // beside the end effector, or on a clock of its own: only its mean is used
            Some(label) => Some(
                choose(label, m.base_near_mm, Some(end.section))
                    .or_else(|near| choose(label, m.base_near_mm, None).map_err(|_| near))?,
            ),
            None => None,
        };
        Ok((end, base))
    }

    /// Refuses a marker that was never seen, and says how often it was not.
    fn check_marker(&mut self, path: &Path, marker: &Marker) -> Result<(), Error> {
        let samples = marker.xyz.len();
        let whole = marker
            .xyz
            .iter()
            .filter(|p| p.iter().all(|v| v.is_finite()))
            .count();
        let part = marker
            .xyz
            .iter()
            .filter(|p| p.iter().any(|v| v.is_nan()) && p.iter().any(|v| v.is_finite()))
            .count();
        if whole == 0 {
            return Err(Error::new(
                ErrorKind::MissingThroughout,
                path,
                format!(
                    "marker {} has no position in any of {samples} samples",
                    quote(&marker.label)
                ),
            )
            .action(
                "name a marker that was seen, or label it in the capture software and export again",
            ));
        }
        let zeros = marker.xyz.iter().filter(|p| **p == [0.0; 3]).count();
        let runs = marker
            .xyz
            .iter()
            .fold((0usize, false), |(runs, inside), p| {
                let missing = p.iter().any(|v| v.is_nan());
                (runs + usize::from(missing && !inside), missing)
            })
            .0;
        self.notes.push(Note::info(
            path,
            format!(
                "marker {}: {whole} of {samples} samples, {runs} gaps",
                quote(&marker.label)
            ),
        ));
        if let Some(turn) = marker.rotation.as_deref().and_then(largest_turn_deg) {
            let text = format!("body {} turns by up to {turn:.2} deg", quote(&marker.label));
            self.notes.push(if turn > 5.0 {
                Note::warning(
                    path,
                    text + "; base and end effector of a Delta keep their direction: is the body loose?",
                )
            } else {
                Note::info(path, text)
            });
        }
        if part > 0 {
            self.notes.push(Note::warning(
                path,
                format!(
                    "marker {}: {part} samples have some coordinates and not others",
                    quote(&marker.label)
                ),
            ));
        }
        if zeros > 0 && zeros < whole {
            self.notes.push(Note::warning(
                path,
                format!(
                    "marker {}: {zeros} samples are exactly 0, 0, 0; some exports write gaps so",
                    quote(&marker.label)
                ),
            ));
        }
        Ok(())
    }

    fn motion_clock(
        &mut self,
        path: &Path,
        section: &Section,
        clock: &Clock,
    ) -> Result<MotionClock, Error> {
        if !section.frames.is_empty() && !matches!(clock, Clock::Column { .. }) {
            let mut rate_hz = section.rate_hz.unwrap_or(f64::NAN);
            if let Clock::Rate { rate_hz: declared } = clock {
                if rate_hz != *declared {
                    self.notes.push(Note::warning(
                        path,
                        format!("the file says {rate_hz} Hz; the manifest's {declared} Hz is used"),
                    ));
                }
                rate_hz = *declared;
            }
            return frame_clock(path, section, rate_hz);
        }
        let time_s = match clock {
            Clock::Column { column, unit } => {
                let capture = Capture {
                    format: "",
                    sections: vec![section.clone()],
                    notes: Vec::new(),
                };
                let (_, place) = capture.find_column(path, column)?;
                let column = &section.columns[place];
                self.seconds(path, Role::Motion, column, column.values.clone(), *unit)?
            }
            #[allow(clippy::cast_precision_loss)]
            Clock::Rate { rate_hz } => {
                self.notes.extend(overruled(path, section, *rate_hz));
                (0..section.rows()).map(|i| i as f64 / rate_hz).collect()
            }
            Clock::Own => section.stamps_s.clone().ok_or_else(|| {
                Error::new(
                    ErrorKind::MissingKey,
                    path,
                    "a plain table has no clock of its own",
                )
                .at_key("[motion] time")
                .action("add `time = ...` (a column) or `rate_hz = ...` under [motion]")
            })?,
        };
        let mut table = Table {
            path: path.to_owned(),
            time_s: Some(time_s),
            columns: Vec::new(),
            lines: section.lines.clone(),
        };
        let time_s = rising_time(&mut table, Role::Motion)?;
        let mut steps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        let rate_hz = match (clock, steps.get(steps.len() / 2)) {
            (Clock::Rate { rate_hz }, _) => *rate_hz,
            (_, Some(step)) => 1.0 / step,
            (_, None) => {
                return Err(
                    Error::new(ErrorKind::NoData, path, "the motion has a single sample")
                        .expected("at least two"),
                );
            }
        };
        Ok(MotionClock {
            rate_hz,
            first_frame: None,
            places: (0..time_s.len()).collect(),
            time_s,
        })
    }
}

/// What is said where a stated rate takes the place of times that the file has, and the two differ.
fn overruled(path: &Path, section: &Section, rate_hz: f64) -> Option<Note> {
    let times = section.times_s()?;
    let (first, last) = (times.first()?, times.last()?);
    #[allow(clippy::cast_precision_loss)]
    let own_hz = (times.len() - 1) as f64 / (last - first);
    (own_hz.is_finite() && (own_hz - rate_hz).abs() > 1e-3 * own_hz).then(|| {
        Note::warning(
            path,
            format!(
                "the file has times, which make {} Hz; the manifest's rate_hz = {rate_hz} is used. Leave rate_hz out to take the file's own times",
                // to a millionth
                (own_hz * 1e6).round() / 1e6
            ),
        )
    })
}

/// What is said where times, `steps` steps from the first to the last, run so slowly that their unit is
/// doubtful: samples farther apart, on average, than the longest relaxation that a film shows within a
/// recording (40 s) show nothing of it.
pub(super) fn slow(
    column: &Column,
    [first, last]: [f64; 2],
    steps: usize,
    unit: &Unit,
) -> Option<String> {
    const FARTHEST_S: f64 = 40.0;
    #[allow(clippy::cast_precision_loss)]
    let step_s = (last - first) / steps as f64;
    (step_s.is_finite() && step_s > FARTHEST_S).then(|| {
        format!(
            "column {} in {} runs for {:.0} s with a sample every {step_s:.0} s: is the unit of the time right?",
            column.title(),
            unit.symbol,
            last - first
        )
    })
}

/// The samples of a motion, and where each row of the file goes.
struct MotionClock {
    rate_hz: f64,
    first_frame: Option<i64>,
    time_s: Vec<f64>,
    places: Vec<usize>,
}

/// A marker at the samples of a clock; NaN where it has no row.
fn on_clock(section: &Section, marker: &MarkerColumns, clock: &MotionClock) -> Marker {
    let mut xyz = vec![[f64::NAN; 3]; clock.time_s.len()];
    for (row, at) in clock.places.iter().enumerate() {
        for (value, column) in xyz[*at].iter_mut().zip(marker.columns) {
            *value = section.columns[column].values[row];
        }
    }
    let turns = marker
        .group
        .and_then(|g| rotations(section, section.groups.get(g)?.columns.clone()));
    let rotation = turns.map(|turns| {
        let mut rotation = vec![[f64::NAN; 4]; clock.time_s.len()];
        for (turn, at) in turns.iter().zip(&clock.places) {
            rotation[*at] = *turn;
            // a body at 0, 0, 0 without a rotation was not seen
            if turn[0].is_nan() && xyz[*at] == [0.0; 3] {
                xyz[*at] = [f64::NAN; 3];
            }
        }
        rotation
    });
    Marker {
        label: marker.label.clone(),
        xyz,
        rotation,
    }
}

/// The column of the motion file that the voltage has too.
fn raw_shared(path: &Path, capture: &Capture, s: &SharedManifest) -> Result<RawShared, Error> {
    let (at, column) = capture.find_column(path, &s.column)?;
    let own = &capture.sections[at];
    let time_s = own.times_s().ok_or_else(|| {
        Error::new(
            ErrorKind::MissingKey,
            path,
            format!("column {} has no clock of its own", s.column),
        )
        .at_key("[sync] shared")
        .action("name a column of a section with a rate or with time stamps")
    })?;
    Ok(RawShared {
        label: own.columns[column].title(),
        chain: s.chain - 1,
        time_s,
        values: own.columns[column].values.clone(),
    })
}

/// Samples without a hole from the first frame to the last: time (frame - 1)/rate.
fn frame_clock(path: &Path, section: &Section, rate_hz: f64) -> Result<MotionClock, Error> {
    let first = section.sample_index(0);
    let mut places = Vec::with_capacity(section.rows());
    let most = section.rows().saturating_mul(10).saturating_add(100_000);
    for row in 0..section.rows() {
        let place =
            usize::try_from(section.sample_index(row).saturating_sub(first)).unwrap_or(usize::MAX);
        if place > most {
            return Err(Error::new(
                ErrorKind::TimeOrder,
                path,
                format!(
                    "frame {} follows frame {}",
                    section.frames[row],
                    section.frames[row.saturating_sub(1)]
                ),
            )
            .at_line(section.lines.line(row))
            .at_column(1)
            .expected("frame numbers that go on")
            .action("a frame number is wrong; correct it or export the trial again"));
        }
        places.push(place);
    }
    let samples = places.last().map_or(0, |p| p + 1);
    #[allow(clippy::cast_precision_loss)]
    let time_s = (0..samples)
        .map(|i| first.saturating_add(i64::try_from(i).unwrap_or(0)) as f64 / rate_hz)
        .collect();
    Ok(MotionClock {
        rate_hz,
        first_frame: Some(first.saturating_add(1)),
        time_s,
        places,
    })
}

/// A marker in a file: its columns X, Y, Z.
pub(super) struct MarkerColumns {
    pub(super) label: String,
    pub(super) section: usize,
    /// Which of [`Section::groups`].
    pub(super) group: Option<usize>,
    pub(super) columns: [usize; 3],
}

/// Every marker of every section.
fn markers(capture: &Capture) -> Vec<MarkerColumns> {
    let sections = capture.sections.iter().enumerate();
    sections.flat_map(|(i, s)| section_markers(i, s)).collect()
}

/// Every group with X, Y, Z (or TX, TY, TZ) in a length, and in a plain table every trio `EE_x, EE_y, EE_z`
/// and every matrix of three, `EE(:,1)` to `EE(:,3)`, unless its unit is that of something else.
pub(super) fn section_markers(s: usize, section: &Section) -> Vec<MarkerColumns> {
    let mut found = Vec::new();
    for (g, group) in section.groups.iter().enumerate() {
        let at = |axis: &str| {
            group
                .columns
                .clone()
                .find(|c| section.columns[*c].axis.eq_ignore_ascii_case(axis))
        };
        let trio = |x, y, z| Some([at(x)?, at(y)?, at(z)?]);
        let Some(columns) = trio("X", "Y", "Z")
            .or_else(|| trio("TX", "TY", "TZ"))
            .or_else(|| trio("x_trans", "y_trans", "z_trans"))
        else {
            continue;
        };
        let unit = &section.columns[columns[0]].unit;
        // angles and forces of a C3D file may have no unit
        let unit_left_out = unit.is_empty() && section.name != "Model Outputs";
        if unit_left_out || Unit::parse(unit).is_some_and(|u| u.dimension == Dimension::Length) {
            let label = group
                .name
                .strip_prefix("Global Angle (Quaternion) ")
                .or_else(|| group.name.strip_prefix("Global Angle "))
                .unwrap_or(&group.name);
            found.push(MarkerColumns {
                label: label.to_owned(),
                section: s,
                group: Some(g),
                columns,
            });
        }
    }
    if section.groups.is_empty() {
        let mut trios: HashMap<&str, [Option<usize>; 3]> = HashMap::new();
        let mut order = Vec::new();
        for (c, column) in section.columns.iter().enumerate() {
            let place = match of_three(section, column) {
                Some(place) => {
                    let unit = Unit::parse(&column.unit);
                    let far = unit.is_none_or(|u| u.dimension == Dimension::Length);
                    far.then_some(place)
                }
                None => coordinate(&column.axis),
            };
            let Some((label, axis)) = place else {
                continue;
            };
            let trio = trios.entry(label).or_insert_with(|| {
                order.push(label);
                [None; 3]
            });
            let k = usize::from(axis as u8 - b'x');
            trio[k] = trio[k].or(Some(c));
        }
        for label in order {
            if let Some([Some(x), Some(y), Some(z)]) = trios.get(label) {
                found.push(MarkerColumns {
                    label: label.to_owned(),
                    section: s,
                    group: None,
                    columns: [*x, *y, *z],
                });
            }
        }
    }
    found
}

/// The matrix of three and the coordinate that a column of it, `EE(:,2)` or `EE(2,:)`, stands for.
fn of_three<'a>(section: &Section, column: &'a Column) -> Option<(&'a str, char)> {
    let (label, place) = column.axis.strip_suffix(')')?.rsplit_once('(')?;
    let (before, after) = match place.split_once(',')? {
        (":", _) => (format!("{label}(:,"), ")"),
        (_, ":") => (format!("{label}("), ",:)"),
        _ => return None,
    };
    let columns = |k| {
        section
            .columns
            .iter()
            .any(|c| c.axis == format!("{before}{k}{after}"))
    };
    let k = (1..=3).find(|k| column.axis == format!("{before}{k}{after}"))?;
    (columns(3) && !columns(4)).then_some((label, char::from(b'w' + k)))
}

/// `EE_x_mm`, `EE:X (mm)`, `EE.x` are coordinate x of EE.
fn coordinate(header: &str) -> Option<(&str, char)> {
    let mut name = header.trim();
    for open in [" (", " [", "(", "["] {
        if let Some((stem, _)) = name.split_once(open) {
            name = stem.trim_end();
        }
    }
    if let Some((stem, unit)) = name.rsplit_once('_')
        && Unit::parse(unit).is_some_and(|u| u.dimension == Dimension::Length)
    {
        name = stem;
    }
    let axis = name.chars().next_back()?;
    let label = name[..name.len() - axis.len_utf8()].trim_end_matches(['_', ':', '.', ' ', '-']);
    let separated = name.len() > label.len() + 1;
    let axis = axis.to_ascii_lowercase();
    (matches!(axis, 'x' | 'y' | 'z') && (separated || label.is_empty())).then_some((label, axis))
}

/// The markers with a label: exactly, or under any subject, or as `*` and `?` allow.
fn called<'a>(all: &[&'a MarkerColumns], label: &str) -> Vec<&'a MarkerColumns> {
    let tests: [&dyn Fn(&str) -> bool; 3] =
        [&|l| l == label, &|l| without_subject(l) == label, &|l| {
            label.contains(['*', '?']) && matches(label, l)
        }];
    for test in tests {
        let hits: Vec<_> = all.iter().copied().filter(|m| test(&m.label)).collect();
        if !hits.is_empty() {
            return hits;
        }
    }
    Vec::new()
}

/// Whether a text is as a pattern says, in which `*` is any text and `?` any letter.
fn matches(pattern: &str, text: &str) -> bool {
    let (pattern, text): (Vec<char>, Vec<char>) =
        (pattern.chars().collect(), text.chars().collect());
    let (mut p, mut t) = (0, 0);
    // after the last star, and what it has swallowed so far
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p + 1, t));
                p += 1;
            }
            Some(c) if *c == '?' || *c == text[t] => {
                p += 1;
                t += 1;
            }
            _ => match star {
                Some((after, from)) => {
                    star = Some((after, from + 1));
                    p = after;
                    t = from + 1;
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

/// The one marker among those that have a label.
fn pick<'a>(
    path: &Path,
    all: &[&MarkerColumns],
    hits: &[&'a MarkerColumns],
    label: &str,
) -> Result<&'a MarkerColumns, Error> {
    match hits {
        [marker] => Ok(marker),
        [] => {
            let mut labels: Vec<&str> = all.iter().map(|m| m.label.as_str()).collect();
            labels.dedup();
            Err(Error::new(
                ErrorKind::UnknownMarker,
                path,
                format!("no marker is called {}", quote(label)),
            )
            .action(suggestion(label, &labels)))
        }
        several => {
            let mut labels: Vec<&str> = several.iter().map(|m| m.label.as_str()).take(40).collect();
            if several.len() > labels.len() {
                labels.push("...");
            }
            Err(Error::new(
                ErrorKind::Ambiguous,
                path,
                format!("{} markers are called {}", several.len(), quote(label)),
            )
            .action(format!(
                "write the subject too, or say which with end_effector_near_mm (base_near_mm): {}",
                labels.join(", ")
            )))
        }
    }
}

/// The marker that was first seen nearest to a place, and how near.
fn nearest_marker<'a>(
    path: &Path,
    capture: &Capture,
    hits: &[&'a MarkerColumns],
    near_mm: [f64; 3],
    declared: Option<&'static Unit>,
) -> Result<(&'a MarkerColumns, Note), Error> {
    let mut best: Option<(f64, &MarkerColumns)> = None;
    for marker in hits {
        let section = &capture.sections[marker.section];
        let to_mm = positions_unit(path, section, marker, declared)?.to_si * 1e3;
        let values = marker.columns.map(|c| &section.columns[c].values);
        let seen = (0..section.rows()).find(|i| values.iter().all(|v| !v[*i].is_nan()));
        let Some(row) = seen else { continue };
        let away = values
            .iter()
            .zip(near_mm)
            .map(|(v, near)| (v[row] * to_mm - near).powi(2))
            .sum::<f64>()
            .sqrt();
        if best.is_none_or(|b| away < b.0) {
            best = Some((away, marker));
        }
    }
    let Some((away, marker)) = best else {
        return Err(Error::new(
            ErrorKind::MissingThroughout,
            path,
            "none of the markers was ever seen",
        )
        .action("name a marker that was seen, or label it in the capture software"));
    };
    let text = format!(
        "of {} markers, {} is nearest to {near_mm:?} mm: {away:.1} mm away where it is first seen",
        hits.len(),
        quote(&marker.label)
    );
    let note = if away > 100.0 {
        Note::warning(path, text)
    } else {
        Note::info(path, text)
    };
    Ok((marker, note))
}

fn positions_unit(
    path: &Path,
    section: &Section,
    marker: &MarkerColumns,
    declared: Option<&'static Unit>,
) -> Result<&'static Unit, Error> {
    let mut unit: Option<&'static Unit> = None;
    for column in marker.columns.map(|c| &section.columns[c]) {
        let found = unit_of(path, column, declared, Dimension::Length)?.ok_or_else(|| {
            no_unit(path, column, "mm, cm or m")
                .action("add `unit = \"mm\"` under [motion] in the recording.toml")
        })?;
        if unit.is_some_and(|u| u != found) {
            return Err(Error::new(
                ErrorKind::WrongUnit,
                path,
                format!(
                    "the coordinates of {} are in different units",
                    quote(&marker.label)
                ),
            )
            .expected("one unit"));
        }
        unit = Some(found);
    }
    unit.ok_or_else(|| Error::new(ErrorKind::WrongUnit, path, "no unit"))
}

/// The unit of a column: declared, or from the header; both must agree where both are there.
fn unit_of(
    path: &Path,
    column: &Column,
    declared: Option<&'static Unit>,
    dimension: Dimension,
) -> Result<Option<&'static Unit>, Error> {
    match (Unit::parse(&column.unit), declared) {
        (Some(header), Some(declared)) if header != declared => {
            Err(contradiction(path, column, declared))
        }
        (_, Some(declared)) => Ok(Some(declared)),
        (Some(header), None) if header.dimension == dimension => Ok(Some(header)),
        (None, None) if column.unit.is_empty() => Ok(None),
        (_, None) => Err(no_unit(path, column, &Unit::symbols(dimension).join(", "))),
    }
}

fn contradiction(path: &Path, column: &Column, declared: &Unit) -> Error {
    Error::new(
        ErrorKind::WrongUnit,
        path,
        format!(
            "column {} is in {} by its header",
            quote(&column.title()),
            column.unit
        ),
    )
    .at_column(column.number)
    .expected(format!("{} as the recording.toml says", declared.symbol))
    .action("correct the unit in the recording.toml, or name another column")
}

fn no_unit(path: &Path, column: &Column, expected: &str) -> Error {
    let found = if column.unit.is_empty() {
        format!("column {} has no unit", quote(&column.title()))
    } else {
        format!(
            "column {} is in {}",
            quote(&column.title()),
            quote(&column.unit)
        )
    };
    Error::new(ErrorKind::WrongUnit, path, found)
        .at_column(column.number)
        .expected(expected)
}

/// V or kV for all of some columns; `None` if neither manifest nor header says.
fn volts(
    table: &Table,
    columns: &[Column],
    declared: Option<&'static Unit>,
    scale: Option<f64>,
) -> Result<Option<&'static Unit>, Error> {
    let mut unit: Option<&'static Unit> = None;
    for column in columns {
        let found = unit_of(&table.path, column, declared, Dimension::Voltage)?;
        if found.is_some_and(|u| !matches!(u.symbol, "V" | "kV"))
            || (scale.is_some() && found.is_some_and(|u| u.symbol != "V"))
        {
            let expected = if scale.is_some() {
                "V, which `scale` multiplies"
            } else {
                "V or kV"
            };
            return Err(no_unit(&table.path, column, expected)
                .action("name a column in that unit, or record the voltage in it"));
        }
        if column.values.iter().all(|v| v.is_nan()) {
            return Err(Error::new(
                ErrorKind::MissingThroughout,
                &table.path,
                format!("column {} is empty throughout", quote(&column.title())),
            )
            .at_column(column.number)
            .action("name the column that holds the voltage"));
        }
        if let (Some(a), Some(b)) = (unit, found)
            && a != b
        {
            return Err(no_unit(
                &table.path,
                column,
                &format!("{} as the channels before it", a.symbol),
            ));
        }
        unit = unit.or(found);
    }
    Ok(unit)
}

/// A column with its unit, which has to be known.
fn raw(
    path: &Path,
    column: Column,
    declared: Option<&'static Unit>,
    dimension: Dimension,
    key: &str,
) -> Result<RawColumn, Error> {
    let unit = unit_of(path, &column, declared, dimension)?.ok_or_else(|| {
        no_unit(path, &column, &Unit::symbols(dimension).join(", "))
            .action(format!("add `{key}` to the recording.toml"))
    })?;
    Ok(RawColumn {
        label: column.title(),
        unit: Some(unit),
        values: column.values,
    })
}

/// The two columns that were asked for.
fn pair(path: &Path, columns: Vec<Column>) -> Result<(Column, Column), Error> {
    <[Column; 2]>::try_from(columns)
        .map(|[a, b]| (a, b))
        .map_err(|_| Error::new(ErrorKind::UnknownColumn, path, "two columns are needed"))
}

/// Every time is there.
fn complete(table: &Table, time_s: &[f64]) -> Result<(), Error> {
    match time_s.iter().position(|t| !t.is_finite()) {
        Some(row) => Err(
            Error::new(ErrorKind::BadNumber, &table.path, "the time is missing")
                .at_line(table.lines.line(row))
                .expected("a time in every row")
                .action("complete the cell or delete the row"),
        ),
        None => Ok(()),
    }
}

/// The times of a table, which have to be there and rise strictly.
fn rising_time(table: &mut Table, role: Role) -> Result<Vec<f64>, Error> {
    let Some(time_s) = table.time_s.take() else {
        return Err(Error::new(
            ErrorKind::MissingKey,
            &table.path,
            "the table has no clock of its own",
        )
        .at_key(format!("[{}] time", role.name()))
        .action("add `time = ...` (a column) or `rate_hz = ...` to the recording.toml"));
    };
    complete(table, &time_s)?;
    match (1..time_s.len()).find(|i| time_s[*i] <= time_s[i - 1]) {
        Some(row) => Err(Error::new(
            ErrorKind::TimeOrder,
            &table.path,
            format!("time {} s follows {} s", time_s[row], time_s[row - 1]),
        )
        .at_line(table.lines.line(row))
        .expected("time that rises from row to row")
        .action("split the file where the clock was set back, or delete the repeated rows")),
        None => Ok(time_s),
    }
}
