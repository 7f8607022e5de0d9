//! What is in a bare file, and what looks wrong in it, in one pass and constant memory.
//!
//! The file goes by in batches of rows; of each column its range and its gaps are kept, of each marker and
//! each voltage a little history: enough for spikes, frozen stretches, swaps and clipping, not enough to grow
//! with the file. A [`Doubt`] is a sentence to a person. Nothing is changed, and an import that has doubts is
//! no failure.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::mpsc;

use super::capture::{
    Capture, Column, ColumnRef, Gaps, Note, ReadOptions, Section, Sink, column_gap_note, gap_notes,
    importer_for, nothing,
};
use super::error::Error;
use super::open::{section_markers, slow};
use crate::units::{Dimension, TimeScale, Unit};

/// What is in a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// Name of the importer that read it.
    pub format: &'static str,
    /// Its tables.
    pub sections: Vec<SectionSurvey>,
    /// What was found and dropped.
    pub notes: Vec<Note>,
    /// What looks wrong.
    pub doubts: Vec<Doubt>,
}

/// What is in one table.
#[derive(Debug, Clone, PartialEq)]
pub struct SectionSurvey {
    /// `Trajectories`, `Devices`, `table`, ...
    pub name: String,
    /// Line at which it begins, from 1.
    pub line: u64,
    /// Rows.
    pub rows: usize,
    /// Samples per second: declared by the file, else the mean of its time stamps, Hz.
    pub rate_hz: Option<f64>,
    /// First and last frame number.
    pub frames: Option<[i64; 2]>,
    /// First and last time on the file's own clock, s.
    pub time_s: Option<[f64; 2]>,
    /// Markers and devices.
    pub groups: Vec<GroupSurvey>,
    /// Columns.
    pub columns: Vec<ColumnSurvey>,
    /// Which triples of columns are positions.
    pub markers: Vec<MarkerSurvey>,
    /// The column that says when.
    pub time_column: Option<usize>,
}

/// What is in one group of columns.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupSurvey {
    /// As the file has it.
    pub name: String,
    /// Which of [`SectionSurvey::columns`].
    pub columns: Range<usize>,
    /// Rows without a value, and runs of them.
    pub gaps: Gaps,
    /// Rows of the longest run.
    pub longest_gap: usize,
}

/// What is in one column.
#[derive(Debug, Clone, PartialEq)]
pub struct ColumnSurvey {
    /// Its name, with that of its group.
    pub title: String,
    /// The group that it names itself: a marker, a device, a sheet of several; else empty.
    pub group: String,
    /// Its own name.
    pub axis: String,
    /// As the file says.
    pub unit: String,
    /// Its cell in the row, from 1.
    pub number: usize,
    /// Empty cells.
    pub missing: usize,
    /// Smallest and largest value, in `unit`.
    pub range: Option<[f64; 2]>,
    /// Whether it is there in every row, of a plain table of two and more, and each value is larger than the
    /// one before: what a clock does.
    pub rises: bool,
}

/// A position.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerSurvey {
    /// As a manifest names it.
    pub label: String,
    /// Which of [`SectionSurvey::columns`] are x, y, z.
    pub columns: [usize; 3],
}

/// What kind of thing looks wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DoubtKind {
    /// A marker or a voltage repeats one value while it is otherwise noisy.
    Frozen,
    /// Two markers exchanged their places.
    Swap,
    /// Single samples far off the line between their neighbours.
    Spikes,
    /// A voltage ran into a limit.
    Clipped,
    /// The numbers are not what the unit says.
    Unit,
    /// Time stamps that leap, step back or drift.
    Clock,
}

impl SectionSurvey {
    /// Whether each row has a time of its own beside the columns: a header's clock, or the stamps of
    /// messages.
    #[must_use]
    pub fn has_own_clock(&self) -> bool {
        self.frames.is_none() && self.time_column.is_none() && self.time_s.is_some()
    }
}

impl Survey {
    /// How a manifest names a column of this file so that no other is meant: by its header, with its group,
    /// else by its number; `None` where none of them does.
    #[must_use]
    pub fn column_ref(&self, section: usize, column: usize) -> Option<ColumnRef> {
        let own = self.sections.get(section)?.columns.get(column)?;
        let names = match (own.group.as_str(), own.axis.as_str()) {
            ("", axis) => vec![axis.to_owned()],
            (group, "") => vec![group.to_owned()],
            (group, axis) if self.sections[section].groups.is_empty() => {
                vec![axis.to_owned(), format!("{group}:{axis}")]
            }
            (group, axis) => vec![format!("{group}:{axis}")],
        };
        let names = names.into_iter().filter(|n| !n.is_empty());
        let names = names.map(ColumnRef::Name);
        let frame = self.frame();
        names
            .chain([ColumnRef::Number(own.number)])
            .find(|wanted| frame.find_column(Path::new(""), wanted).ok() == Some((section, column)))
    }

    /// The columns of the file, without their values.
    fn frame(&self) -> Capture {
        let section = |s: &SectionSurvey| Section {
            name: s.name.clone(),
            columns: s
                .columns
                .iter()
                .map(|c| Column {
                    group: c.group.clone(),
                    axis: c.axis.clone(),
                    unit: c.unit.clone(),
                    number: c.number,
                    values: Vec::new(),
                })
                .collect(),
            ..Section::default()
        };
        Capture {
            format: self.format,
            sections: self.sections.iter().map(section).collect(),
            notes: Vec::new(),
        }
    }
}

impl DoubtKind {
    /// In one word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            DoubtKind::Frozen => "frozen",
            DoubtKind::Swap => "swap",
            DoubtKind::Spikes => "spikes",
            DoubtKind::Clipped => "clipped",
            DoubtKind::Unit => "unit",
            DoubtKind::Clock => "clock",
        }
    }
}

/// Something that looks wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct Doubt {
    /// What kind of thing.
    pub kind: DoubtKind,
    /// The section.
    pub section: String,
    /// The markers or the column.
    pub what: Vec<String>,
    /// When it is first (or worst), s on the file's own clock, where it has one.
    pub time_s: Option<f64>,
    /// One sentence, with what to do.
    pub says: String,
}

/// Goes through a file of any known format.
///
/// # Errors
/// As [`super::read_file`].
pub fn survey_file(
    path: &Path,
    format: Option<&str>,
    options: &ReadOptions,
) -> Result<Survey, Error> {
    let importer = importer_for(path, format)?;
    if path.metadata().is_ok_and(|m| m.len() < ALONE) {
        let mut sections = Sections::default();
        let capture = importer.stream(path, options, &mut sections)?;
        return sections.finish(path, capture);
    }
    // one thread reads, the other looks at what it has read
    let (to, batches) = mpsc::sync_channel(2);
    let (back, emptied) = mpsc::channel();
    std::thread::scope(|scope| {
        let looking = scope.spawn(move || {
            let mut sections = Sections::default();
            for batch in batches {
                match batch {
                    None => sections.restart(),
                    Some((index, mut section)) => {
                        sections.rows(index, &mut section);
                        // a reader that has ended wants none
                        let _ = back.send((index, section));
                    }
                }
            }
            sections
        });
        let read = importer.stream(path, options, &mut Hand { to, emptied });
        let sections = looking
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        sections.finish(path, read?)
    })
}

/// A file of fewer bytes is gone through sooner than a second thread is under way.
const ALONE: u64 = 1 << 20;

/// What the reading thread hands over: rows of a section; none where what came before does not count.
type Batch = Option<(usize, Section)>;

/// Hands rows over, and takes emptied sections back to be filled again: names of thousands of columns are not
/// copied each time.
struct Hand {
    to: mpsc::SyncSender<Batch>,
    emptied: mpsc::Receiver<(usize, Section)>,
}

impl Hand {
    fn send(&self, batch: Batch) {
        // the other end is gone only where it panicked, which the join tells
        let _ = self.to.send(batch);
    }
}

impl Sink for Hand {
    fn restart(&mut self) {
        self.send(None);
    }

    fn rows(&mut self, index: usize, section: &mut Section) {
        let same = |(i, s): &(usize, Section)| {
            *i == index && s.columns.len() == section.columns.len() && s.name == section.name
        };
        let mut empty = match self.emptied.try_recv().ok().filter(same) {
            Some((_, empty)) => Section {
                // what a reader may have learnt since
                line: section.line,
                rate_hz: section.rate_hz,
                zero_frame: section.zero_frame,
                subframes_per_frame: section.subframes_per_frame,
                ..empty
            },
            None => section.without_rows(),
        };
        std::mem::swap(section, &mut empty);
        self.send(Some((index, empty)));
    }
}

/// Markers and voltages that are watched; a file with more is told of, not watched in full.
const WATCHED: usize = 2000;

#[derive(Default)]
struct Sections {
    all: Vec<Running>,
}

impl Sink for Sections {
    fn restart(&mut self) {
        self.all.clear();
    }

    fn rows(&mut self, index: usize, section: &mut Section) {
        while self.all.len() <= index {
            self.all.push(Running::default());
        }
        self.all[index].take(section);
        section.clear_rows();
    }
}

/// A row, for a person.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Place {
    row: usize,
    line: u64,
    frame: Option<(i64, u32)>,
    time_s: Option<f64>,
}

impl Place {
    fn time(&self, s: &Section) -> Option<f64> {
        self.time_s.or_else(|| {
            let (frame, sub) = self.frame?;
            let n = i64::from(s.subframes_per_frame.unwrap_or(1));
            #[allow(clippy::cast_precision_loss)]
            let samples = frame
                .saturating_sub(s.zero_frame.unwrap_or(1))
                .saturating_mul(n)
                .saturating_add(i64::from(sub)) as f64;
            Some(samples / s.rate_hz?)
        })
    }

    fn says(&self, s: &Section) -> String {
        match (self.time(s), self.frame, self.line) {
            (Some(t), Some((frame, _)), _) => format!("at {} (frame {frame})", written(t, s)),
            (Some(t), None, _) => format!("at {}", written(t, s)),
            (None, _, line) if line > 0 => format!("in line {line}"),
            _ => format!("in row {}", self.row + 1),
        }
    }
}

/// A time of a section, in words.
fn written(t: f64, s: &Section) -> String {
    TimeScale::new(t, s.rate_hz.map(f64::recip)).text(t)
}

/// One section while it goes by.
#[derive(Default)]
struct Running {
    rows: usize,
    first: Place,
    last: Place,
    columns: Vec<ColumnSurvey>,
    /// The last value of each column of a plain table.
    last_values: Vec<f64>,
    groups: Vec<RunningGroup>,
    markers: Vec<MarkerTrack>,
    unwatched: usize,
    volts: Vec<VoltTrack>,
    clock: Option<Clock>,
    swaps: BTreeMap<(usize, usize), (Place, usize)>,
}

#[derive(Default)]
struct RunningGroup {
    gaps: Gaps,
    run: usize,
    longest: usize,
}

impl Running {
    fn take(&mut self, section: &Section) {
        let n = section.rows();
        self.meet(section);
        if n == 0 {
            return;
        }
        let place = |i: usize| self.place(section, i);
        let (first, last) = (place(0), place(n - 1));
        if self.rows == 0 {
            self.first = first;
        }
        self.last = last;

        let mut missing = vec![0usize; section.columns.len()];
        for ((seen, column), missing) in self
            .columns
            .iter_mut()
            .zip(&section.columns)
            .zip(&mut missing)
        {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for v in &column.values {
                *missing += usize::from(v.is_nan());
                low = if *v < low { *v } else { low };
                high = if *v > high { *v } else { high };
            }
            seen.missing += *missing;
            if low <= high {
                let [a, b] = seen.range.unwrap_or([low, high]);
                seen.range = Some([a.min(low), b.max(high)]);
            }
        }
        if section.groups.is_empty() {
            for ((seen, last), column) in self
                .columns
                .iter_mut()
                .zip(&mut self.last_values)
                .zip(&section.columns)
            {
                // nothing is larger than what is not there
                let larger = |v: &f64| *v > std::mem::replace(last, *v);
                seen.rises = seen.rises && column.values.iter().all(larger);
            }
        }
        for (group, running) in section.groups.iter().zip(&mut self.groups) {
            let columns = group.columns.clone();
            if missing[columns.clone()].iter().all(|m| *m == 0) {
                running.run = 0;
                continue;
            }
            let columns = &section.columns[columns];
            for row in 0..n {
                if columns.iter().any(|c| c.values[row].is_nan()) {
                    running.gaps.missing += 1;
                    running.gaps.runs += usize::from(running.run == 0);
                    running.run += 1;
                    running.longest = running.longest.max(running.run);
                } else {
                    running.run = 0;
                }
            }
        }
        let mut jumps = Vec::new();
        let rows = self.rows;
        let mut markers = std::mem::take(&mut self.markers);
        for (m, track) in markers.iter_mut().enumerate() {
            track.take(section, rows, m, &mut jumps);
        }
        self.markers = markers;
        self.find_swaps(section, jumps);
        let mut volts = std::mem::take(&mut self.volts);
        for track in &mut volts {
            track.take(&section.columns[track.column].values, rows);
        }
        self.volts = volts;
        if let Some(clock) = &mut self.clock {
            let stamps = match clock.column {
                Some(column) => Some(&section.columns[column].values),
                None => section.stamps_s.as_ref(),
            };
            for (i, t) in stamps.into_iter().flatten().enumerate() {
                clock.take(rows + i, section.lines.line(i), *t);
            }
        }
        self.rows += n;
    }

    fn place(&self, section: &Section, i: usize) -> Place {
        let time_s = self.clock.as_ref().and_then(|clock| match clock.column {
            Some(column) => Some(section.columns[column].values.get(i)? * clock.to_si),
            None => section.stamps_s.as_ref()?.get(i).copied(),
        });
        Place {
            row: self.rows + i,
            line: section.lines.line(i),
            frame: section
                .frames
                .get(i)
                .map(|f| (*f, section.sub_frames.get(i).copied().unwrap_or(0))),
            time_s: time_s.filter(|t| t.is_finite()),
        }
    }

    /// Columns and groups that are new.
    fn meet(&mut self, section: &Section) {
        let known = self.columns.len();
        if known == section.columns.len() && self.groups.len() == section.groups.len() {
            return;
        }
        for column in &section.columns[known..] {
            self.columns.push(ColumnSurvey {
                title: column.title(),
                group: column.group.clone(),
                axis: column.axis.clone(),
                unit: column.unit.clone(),
                number: column.number,
                missing: self.rows,
                range: None,
                rises: section.groups.is_empty() && self.rows == 0,
            });
            self.last_values.push(f64::NEG_INFINITY);
        }
        while self.groups.len() < section.groups.len() {
            self.groups.push(RunningGroup {
                gaps: Gaps {
                    missing: self.rows,
                    runs: usize::from(self.rows > 0),
                },
                run: self.rows,
                longest: self.rows,
            });
        }
        let from = self.markers.len() + self.unwatched;
        for marker in section_markers(0, section).into_iter().skip(from) {
            if self.markers.len() >= WATCHED {
                self.unwatched += 1;
                continue;
            }
            let unit = Unit::parse(&section.columns[marker.columns[0]].unit);
            self.markers
                .push(MarkerTrack::new(marker.label, marker.columns, unit));
        }
        for (i, column) in section.columns.iter().enumerate().skip(known) {
            let volts =
                Unit::parse(&column.unit).is_some_and(|u| u.dimension == Dimension::Voltage);
            if volts && self.volts.len() < WATCHED {
                self.volts.push(VoltTrack::new(i));
            }
        }
        if self.clock.is_none() {
            self.clock = Clock::of(section);
        }
    }

    /// Of the markers that jumped in one row, the pairs that jumped to each other's place.
    fn find_swaps(&mut self, section: &Section, mut jumps: Vec<Jump>) {
        jumps.sort_by_key(|j| j.row);
        for same in jumps.chunk_by(|a, b| a.row == b.row) {
            // a cut in the recording moves all of them
            if same.len() > 32 {
                continue;
            }
            for (i, a) in same.iter().enumerate() {
                for b in &same[i + 1..] {
                    let far = distance2(a.from, a.to).min(distance2(b.from, b.to));
                    let near = distance2(a.to, b.from).max(distance2(b.to, a.from));
                    if near < 0.09 * far {
                        let place = self.place(section, a.row);
                        self.swaps
                            .entry((a.marker, b.marker))
                            .or_insert((place, 0))
                            .1 += 1;
                    }
                }
            }
        }
    }
}

fn samples(count: usize) -> String {
    if count == 1 {
        "1 single sample".to_owned()
    } else {
        format!("{count} single samples")
    }
}

fn distance2(a: [f64; 3], b: [f64; 3]) -> f64 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// How often values of each size came, to half an octave.
#[derive(Clone)]
struct Sizes {
    counts: Box<[u32; 160]>,
    zeros: usize,
    total: usize,
}

impl Sizes {
    fn new() -> Self {
        Sizes {
            counts: Box::new([0; 160]),
            zeros: 0,
            total: 0,
        }
    }

    #[inline]
    fn bin(value: f64) -> usize {
        // exponent and first bit of the mantissa: 2^-40 is bin 0, 2^40 bin 160
        let half_octaves = value.to_bits() >> 51;
        usize::try_from(half_octaves)
            .unwrap_or(0)
            .clamp(1966, 1966 + 159)
            - 1966
    }

    fn value(bin: usize) -> f64 {
        f64::from_bits(((bin + 1966) as u64) << 51)
    }

    /// Takes a value that is not negative.
    #[inline]
    fn add(&mut self, value: f64) {
        self.total += 1;
        if value == 0.0 {
            self.zeros += 1;
        } else {
            let count = &mut self.counts[Self::bin(value)];
            *count = count.saturating_add(1);
        }
    }

    /// The value that a share of all does not exceed (upper end of its bin); of all, or of those that are not
    /// 0.
    fn quantile(&self, share: f64, with_zeros: bool) -> f64 {
        #[allow(clippy::cast_precision_loss)]
        let wanted = share * (self.total - if with_zeros { 0 } else { self.zeros }) as f64;
        #[allow(clippy::cast_precision_loss)]
        let mut sum = if with_zeros { self.zeros as f64 } else { 0.0 };
        if with_zeros && sum >= wanted && self.zeros > 0 {
            return 0.0;
        }
        for (bin, count) in self.counts.iter().enumerate() {
            sum += f64::from(*count);
            if *count > 0 && sum >= wanted {
                return Self::value(bin + 1);
            }
        }
        0.0
    }

    fn above(&self, value: f64) -> usize {
        let from = if value > 0.0 { Self::bin(value) + 1 } else { 0 };
        self.counts[from.min(160)..]
            .iter()
            .map(|c| *c as usize)
            .sum()
    }
}

/// Samples that stick out, the worst few with their places.
struct Spikes {
    /// Distance from the middle between the neighbours, of all samples.
    off: Sizes,
    /// Of those that stick out from both neighbours.
    out: Sizes,
    worst: Vec<(f64, usize)>,
}

impl Spikes {
    fn new() -> Self {
        Spikes {
            off: Sizes::new(),
            out: Sizes::new(),
            worst: Vec::new(),
        }
    }

    /// `off`: how far a sample is from the middle between its neighbours, `apart`: how far these are from
    /// each other.
    #[inline]
    fn add(&mut self, off: f64, apart: f64, row: usize) {
        self.off.add(off);
        // a step is half as far from the middle as its sides are apart
        if off > 3.0 * apart {
            self.out.add(off);
            if self.worst.len() < 8 || self.worst.last().is_some_and(|w| w.0 < off) {
                let at = self.worst.partition_point(|w| w.0 >= off);
                self.worst.insert(at, (off, row));
                self.worst.truncate(8);
            }
        }
    }

    /// How many exceed what noise and motion do, and the worst of them. `rough` for a signal that may be
    /// rough by itself.
    fn found(&self, floor: f64, rough: bool) -> Option<(usize, f64, usize)> {
        if self.off.total < 20 {
            return None;
        }
        let (of_most, of_all) = if rough { (50.0, 12.0) } else { (20.0, 5.0) };
        let usual =
            (of_most * self.off.quantile(0.5, true)).max(of_all * self.off.quantile(0.95, true));
        let limit = usual.max(floor);
        let (worst, row) = *self.worst.first()?;
        (worst > limit).then(|| (self.out.above(limit).max(1), worst, row))
    }
}

/// A leap of a marker from where it was seen last.
struct Jump {
    /// In the batch.
    row: usize,
    marker: usize,
    from: [f64; 3],
    to: [f64; 3],
}

/// Ten times the usual step, squared: what is longer is a leap.
fn leap2(steps: &Sizes) -> f64 {
    let usual = if steps.total >= 20 {
        steps.quantile(0.5, false)
    } else {
        0.0
    };
    if usual > 0.0 {
        100.0 * usual
    } else {
        f64::INFINITY
    }
}

/// One marker while it goes by.
struct MarkerTrack {
    label: String,
    columns: [usize; 3],
    unit: Option<&'static Unit>,
    /// The two samples before, where they were seen.
    before: [Option<[f64; 3]>; 2],
    seen: Option<(usize, [f64; 3])>,
    steps: Sizes,
    limit2: f64,
    spikes: Spikes,
    repeat: Repeat,
    /// Where the rows stand that are told of: (row, place), of the worst spike and the longest repeat.
    places: Vec<Place>,
}

/// Runs of one and the same value.
#[derive(Default)]
struct Repeat {
    run: usize,
    longest: usize,
    longest_end: usize,
    /// Repeats in runs of twenty and more, and all.
    in_long: usize,
    all: usize,
    steps: usize,
}

impl Repeat {
    const LONG: usize = 20;

    #[inline]
    fn add(&mut self, same: bool, row: usize) {
        self.steps += 1;
        if !same {
            self.run = 0;
            return;
        }
        self.run += 1;
        self.all += 1;
        if self.run == Self::LONG {
            self.in_long += Self::LONG;
        } else if self.run > Self::LONG {
            self.in_long += 1;
        }
        if self.run > self.longest {
            self.longest = self.run;
            self.longest_end = row;
        }
    }

    /// A stretch far longer than what rounding makes: (samples, row of its end).
    fn found(&self) -> Option<(usize, usize)> {
        if self.longest < Self::LONG {
            return None;
        }
        let others = self.steps - self.in_long;
        let by_rounding = self.all - self.in_long;
        // values that repeat often are written coarsely, and a rest is a run of them
        (10 * by_rounding <= 3 * others).then_some((self.longest + 1, self.longest_end))
    }
}

impl MarkerTrack {
    fn new(label: String, columns: [usize; 3], unit: Option<&'static Unit>) -> Self {
        MarkerTrack {
            label,
            columns,
            unit,
            before: [None; 2],
            seen: None,
            steps: Sizes::new(),
            limit2: f64::INFINITY,
            spikes: Spikes::new(),
            repeat: Repeat::default(),
            places: Vec::new(),
        }
    }

    fn take(&mut self, section: &Section, rows: usize, marker: usize, jumps: &mut Vec<Jump>) {
        const MOST_JUMPS: usize = 20_000;
        let [x, y, z] = self.columns.map(|c| section.columns[c].values.as_slice());
        let at = |i: usize| [x[i], y[i], z[i]];
        if self.limit2.is_infinite() {
            // the usual step first: what leaps is told by it
            let mut steps = self.steps.clone();
            let mut before: Option<[f64; 3]> = None;
            for i in 0..section.rows() {
                let p = at(i);
                let seen = p.iter().all(|v| !v.is_nan());
                if let (Some(before), true) = (before, seen) {
                    steps.add(distance2(before, p));
                }
                before = seen.then_some(p);
            }
            self.limit2 = leap2(&steps);
        }
        for (i, ((x, y), z)) in x.iter().zip(y).zip(z).enumerate() {
            let p = [*x, *y, *z];
            if x.is_nan() || y.is_nan() || z.is_nan() {
                self.before = [None; 2];
                self.repeat.run = 0;
                continue;
            }
            let row = rows + i;
            if let Some((last, from)) = self.seen {
                let step2 = distance2(from, p);
                let gap = row - last;
                if gap == 1 {
                    self.steps.add(step2);
                    self.repeat.add(step2 == 0.0, row);
                }
                #[allow(clippy::cast_precision_loss)]
                let wide = (gap * gap) as f64;
                if step2 > self.limit2 * wide && gap <= 50 && jumps.len() < MOST_JUMPS {
                    jumps.push(Jump {
                        row: i,
                        marker,
                        from,
                        to: p,
                    });
                }
            }
            if let [Some(a), Some(b)] = self.before {
                let middle = [0, 1, 2].map(|k| 0.5 * (a[k] + p[k]));
                self.spikes
                    .add(distance2(b, middle).sqrt(), distance2(a, p).sqrt(), row - 1);
            }
            self.before = [self.before[1], Some(p)];
            self.seen = Some((row, p));
        }
        self.limit2 = leap2(&self.steps);
        self.keep_places(section, rows);
    }

    /// Remembers where those rows stand that may be told of at the end.
    fn keep_places(&mut self, section: &Section, rows: usize) {
        keep_places(
            &mut self.places,
            self.spikes
                .worst
                .iter()
                .map(|w| w.1)
                .chain([self.repeat.longest_end]),
            section,
            rows,
        );
    }
}

/// Keeps the places of these rows, dropping others.
fn keep_places(
    places: &mut Vec<Place>,
    wanted: impl Iterator<Item = usize>,
    section: &Section,
    rows: usize,
) {
    let wanted: Vec<usize> = wanted.collect();
    places.retain(|p| wanted.contains(&p.row));
    for row in wanted {
        let Some(i) = row.checked_sub(rows).filter(|i| *i < section.rows()) else {
            continue;
        };
        if places.iter().all(|p| p.row != row) {
            places.push(Place {
                row,
                line: section.lines.line(i),
                frame: section
                    .frames
                    .get(i)
                    .map(|f| (*f, section.sub_frames.get(i).copied().unwrap_or(0))),
                time_s: None,
            });
        }
    }
}

/// One side of a signal: how it stands at its extreme.
#[derive(Default)]
struct Extreme {
    value: f64,
    samples: usize,
    runs: usize,
    run: usize,
    longest: usize,
    first_row: usize,
    /// Largest step with which it was reached.
    entry: f64,
}

impl Extreme {
    #[inline]
    fn add(&mut self, value: f64, step: f64, row: usize, further: bool) {
        if further {
            *self = Extreme {
                value,
                samples: 1,
                runs: 1,
                run: 1,
                longest: 1,
                first_row: row,
                entry: step,
            };
        } else if value == self.value {
            if self.run == 0 {
                self.runs += 1;
                self.entry = self.entry.max(step);
            }
            self.run += 1;
            self.samples += 1;
            self.longest = self.longest.max(self.run);
        } else {
            self.run = 0;
        }
    }
}

/// One voltage while it goes by.
struct VoltTrack {
    column: usize,
    before: [Option<f64>; 2],
    steps: Sizes,
    spikes: Spikes,
    repeat: Repeat,
    high: Option<Extreme>,
    low: Option<Extreme>,
    samples: usize,
}

impl VoltTrack {
    fn new(column: usize) -> Self {
        VoltTrack {
            column,
            before: [None; 2],
            steps: Sizes::new(),
            spikes: Spikes::new(),
            repeat: Repeat::default(),
            high: None,
            low: None,
            samples: 0,
        }
    }

    fn take(&mut self, values: &[f64], rows: usize) {
        for (i, v) in values.iter().enumerate() {
            if v.is_nan() {
                self.before = [None; 2];
                continue;
            }
            let row = rows + i;
            self.samples += 1;
            let step = self.before[1].map_or(0.0, |b| (v - b).abs());
            if self.before[1].is_some() {
                self.steps.add(step);
                self.repeat.add(step == 0.0, row);
            }
            let further = self.high.as_ref().is_none_or(|h| *v > h.value);
            self.high
                .get_or_insert_default()
                .add(*v, step, row, further);
            let further = self.low.as_ref().is_none_or(|l| *v < l.value);
            self.low.get_or_insert_default().add(*v, step, row, further);
            if let [Some(a), Some(b)] = self.before {
                self.spikes
                    .add((b - 0.5 * (a + v)).abs(), (v - a).abs(), row - 1);
            }
            self.before = [self.before[1], Some(*v)];
        }
    }

    /// The extremes at which the signal was cut: run into at its usual slope, and held, while it is not a
    /// staircase.
    fn clipped(&self) -> Vec<&Extreme> {
        let both: Vec<&Extreme> = self.high.iter().chain(&self.low).collect();
        let at_ends: usize = both.iter().map(|e| e.samples).sum();
        let holds_elsewhere = self
            .steps
            .zeros
            .saturating_sub(both.iter().map(|e| e.samples - e.runs).sum());
        // levels, as a command of steps has them
        if 10 * at_ends > 6 * self.samples || 10 * holds_elsewhere > 3 * self.samples {
            return Vec::new();
        }
        let usual = self.steps.quantile(0.5, false);
        both.into_iter()
            .filter(|e| {
                e.value != 0.0
                    && e.longest >= 5
                    && e.samples >= 10
                    && e.entry > 0.2 * usual
                    && e.entry < 8.0 * usual
            })
            .collect()
    }
}

/// The time stamps of a table.
struct Clock {
    /// The column, where it is one.
    column: Option<usize>,
    to_si: f64,
    first: f64,
    last: f64,
    count: usize,
    steps: Sizes,
    back: Option<(u64, f64, f64)>,
    backs: usize,
    longest: (f64, u64, f64),
    /// (row, time), at most 64, evenly apart.
    marks: Vec<(usize, f64)>,
    stride: usize,
}

impl Clock {
    /// The stamps of a section, or its first column of times.
    fn of(section: &Section) -> Option<Self> {
        let clock = |column, to_si| Clock {
            column,
            to_si,
            first: 0.0,
            last: 0.0,
            count: 0,
            steps: Sizes::new(),
            back: None,
            backs: 0,
            longest: (0.0, 0, 0.0),
            marks: Vec::new(),
            stride: 1,
        };
        if section.stamps_s.is_some() {
            return Some(clock(None, 1.0));
        }
        if !section.frames.is_empty() || !section.groups.is_empty() {
            return None;
        }
        section.columns.iter().enumerate().find_map(|(i, c)| {
            let unit = Unit::parse(&c.unit).filter(|u| u.dimension == Dimension::Time);
            (unit.is_some() || (c.called_time() && c.unit.is_empty()))
                .then(|| clock(Some(i), unit.map_or(1.0, |u| u.to_si)))
        })
    }

    fn take(&mut self, row: usize, line: u64, stamp: f64) {
        let t = stamp * self.to_si;
        if t.is_nan() {
            return;
        }
        if self.count == 0 {
            self.first = t;
        } else {
            let step = t - self.last;
            if step <= 0.0 {
                self.backs += 1;
                self.back.get_or_insert((line, self.last, t));
            } else {
                self.steps.add(step);
                if step > self.longest.0 {
                    self.longest = (step, line, self.last);
                }
            }
        }
        self.last = t;
        self.count += 1;
        if row.is_multiple_of(self.stride) {
            self.marks.push((row, t));
            if self.marks.len() > 64 {
                self.stride *= 2;
                let stride = self.stride;
                self.marks.retain(|m| m.0.is_multiple_of(stride));
            }
        }
    }

    fn rate_hz(&self) -> Option<f64> {
        #[allow(clippy::cast_precision_loss)]
        let rate = (self.count.checked_sub(1)?) as f64 / (self.last - self.first);
        (rate.is_finite() && rate > 0.0).then_some(rate)
    }

    fn doubts(&self, section: &Section, declared: Option<f64>, doubts: &mut Vec<Doubt>) {
        let mut doubt = |time_s: f64, says: String| {
            doubts.push(Doubt {
                kind: DoubtKind::Clock,
                section: section.name.clone(),
                what: self
                    .column
                    .map(|c| section.columns[c].title())
                    .into_iter()
                    .collect(),
                time_s: Some(time_s),
                says,
            });
        };
        let line = |line: u64| {
            if line > 0 {
                format!(" (line {line})")
            } else {
                String::new()
            }
        };
        if let Some((at, before, after)) = self.back {
            doubt(
                after,
                format!(
                    "time does not rise in {} rows, first from {before} s to {after} s{}; split the file there, or delete what is twice",
                    self.backs,
                    line(at)
                ),
            );
        }
        let usual = self.steps.quantile(0.5, true);
        let (longest, at, from) = self.longest;
        if self.steps.total >= 20 && longest > 5.0 * usual {
            let text = |t| TimeScale::new(t, Some(usual)).text(t);
            doubt(
                from,
                format!(
                    "time leaps by {} after {}{}; a usual step is below {usual:.2e} s",
                    text(longest),
                    text(from),
                    line(at)
                ),
            );
        }
        if let Some(column) = self.column.map(|c| &section.columns[c])
            && let Some(unit) = Unit::parse(&column.unit)
            && let Some(says) = slow(
                column,
                [self.first, self.last],
                self.count.saturating_sub(1),
                unit,
            )
        {
            doubt(self.first, says);
        }
        let Some(rate) = self.rate_hz() else { return };
        if let Some(declared) = declared
            && (declared - rate).abs() > 1e-3 * declared
            && self.backs == 0
        {
            doubt(
                self.first,
                format!(
                    "the file states {declared} Hz, its stamps make {rate:.3} Hz; state the right one as rate_hz"
                ),
            );
        }
        // the halves of a steady clock take equally long
        if self.backs == 0 && self.marks.len() >= 9 && longest <= 5.0 * usual {
            let at = |i: usize| self.marks[i];
            let (a, b, c) = (at(0), at(self.marks.len() / 2), at(self.marks.len() - 1));
            #[allow(clippy::cast_precision_loss)]
            let rate = |p: (usize, f64), q: (usize, f64)| (q.0 - p.0) as f64 / (q.1 - p.1);
            let (early, late) = (rate(a, b), rate(b, c));
            // stamps are off by a step at most
            let uncertain = 2.0 * longest / (b.1 - a.1).min(c.1 - b.1);
            let change = late / early - 1.0;
            if change.abs() > uncertain.max(2e-4) {
                doubt(
                    b.1,
                    format!(
                        "the clock drifts: {early:.3} Hz in the first half, {late:.3} Hz in the second; do not count samples, use the stamps"
                    ),
                );
            }
        }
    }
}

impl Sections {
    fn finish(self, path: &Path, capture: Capture) -> Result<Survey, Error> {
        if self.all.iter().all(|s| s.rows == 0) {
            return Err(nothing(path, &capture.notes));
        }
        let Capture {
            format,
            sections,
            mut notes,
        } = capture;
        let mut doubts = Vec::new();
        let mut all = Vec::new();
        for (section, mut running) in sections.iter().zip(
            self.all
                .into_iter()
                .chain(std::iter::repeat_with(Running::default)),
        ) {
            // a section without rows still has columns
            running.meet(section);
            let before = doubts.len();
            all.push(running.finish(path, section, &mut notes, &mut doubts));
            // the clocks of several sections are told apart by whose they are
            for doubt in &mut doubts[before..] {
                if doubt.kind == DoubtKind::Clock && sections.len() > 1 {
                    doubt.says = format!("{}: {}", section.name, doubt.says);
                }
            }
        }
        Ok(Survey {
            format,
            sections: all,
            notes,
            doubts,
        })
    }
}

impl Running {
    fn finish(
        mut self,
        path: &Path,
        section: &Section,
        notes: &mut Vec<Note>,
        doubts: &mut Vec<Doubt>,
    ) -> SectionSurvey {
        if section.groups.is_empty() {
            for column in &self.columns {
                column_gap_note(path, &column.title, column.missing, self.rows, notes);
            }
        } else {
            let groups: Vec<(&str, Gaps)> = section
                .groups
                .iter()
                .zip(&self.groups)
                .map(|(g, r)| (g.name.as_str(), r.gaps))
                .collect();
            gap_notes(path, &section.name, self.rows, &groups, notes);
        }
        if self.unwatched > 0 {
            notes.push(Note::warning(
                path,
                format!(
                    "section {}: {} markers; only the first {WATCHED} are looked at for spikes and the like",
                    section.name,
                    self.markers.len() + self.unwatched
                ),
            ));
        }
        self.marker_doubts(section, doubts);
        self.volt_doubts(section, doubts);
        self.unit_doubts(section, doubts);
        if let Some(clock) = &self.clock {
            clock.doubts(section, section.rate_hz, doubts);
        }
        let time_s = self
            .first
            .time(section)
            .zip(self.last.time(section))
            .map(|(a, b)| [a, b])
            .filter(|_| self.rows > 0);
        SectionSurvey {
            name: section.name.clone(),
            line: section.line,
            rows: self.rows,
            rate_hz: section
                .rate_hz
                .or_else(|| self.clock.as_ref().and_then(Clock::rate_hz)),
            frames: self
                .first
                .frame
                .zip(self.last.frame)
                .map(|(a, b)| [a.0, b.0]),
            time_s,
            groups: section
                .groups
                .iter()
                .zip(&self.groups)
                .map(|(g, r)| GroupSurvey {
                    name: g.name.clone(),
                    columns: g.columns.clone(),
                    gaps: r.gaps,
                    longest_gap: r.longest,
                })
                .collect(),
            markers: self
                .markers
                .iter()
                .map(|m| MarkerSurvey {
                    label: m.label.clone(),
                    columns: m.columns,
                })
                .collect(),
            time_column: self.clock.as_ref().and_then(|c| c.column),
            columns: std::mem::take(&mut self.columns)
                .into_iter()
                .map(|c| ColumnSurvey {
                    rises: c.rises && self.rows > 1,
                    ..c
                })
                .collect(),
        }
    }

    fn marker_doubts(&self, section: &Section, doubts: &mut Vec<Doubt>) {
        for track in &self.markers {
            let mut doubt = |kind, time_s, says| {
                doubts.push(Doubt {
                    kind,
                    section: section.name.clone(),
                    what: vec![track.label.clone()],
                    time_s,
                    says,
                });
            };
            let place = |row: usize| {
                track
                    .places
                    .iter()
                    .find(|p| p.row == row)
                    .copied()
                    .unwrap_or(Place {
                        row,
                        ..Place::default()
                    })
            };
            let unit = &section.columns[track.columns[0]].unit;
            // 0.2 mm, or a fiftieth of the way where the unit is not known
            let floor = match track.unit {
                Some(u) => 2e-4 / u.to_si,
                None => track
                    .columns
                    .iter()
                    .filter_map(|c| self.columns[*c].range)
                    .map(|[a, b]| 0.02 * (b - a))
                    .fold(0.0, f64::max),
            };
            if let Some((count, worst, row)) = track.spikes.found(floor, false) {
                let at = place(row);
                doubt(
                    DoubtKind::Spikes,
                    at.time(section),
                    format!(
                        "marker {}: {} stick out, the worst by {} {}; take them out of the capture, or mask them",
                        track.label,
                        samples(count),
                        match worst.is_finite() {
                            true => format!("{worst:.3} {unit}"),
                            false => "more than can be counted".into(),
                        },
                        at.says(section)
                    ),
                );
            }
            if let Some((samples, row)) = track.repeat.found() {
                let at = place(row);
                let whole = samples > track.repeat.steps;
                let long = section.rate_hz.map_or(String::new(), |r| {
                    #[allow(clippy::cast_precision_loss)]
                    let s = samples as f64 / r;
                    format!(" ({s:.2} s)")
                });
                doubt(
                    DoubtKind::Frozen,
                    at.time(section),
                    if whole {
                        format!(
                            "marker {} is at one and the same place throughout: a virtual point, or frozen",
                            track.label
                        )
                    } else {
                        format!(
                            "marker {} is frozen for {samples} samples{long}, up to {}; a gap was filled with the last value there",
                            track.label,
                            at.says(section).trim_start_matches("at ")
                        )
                    },
                );
            }
        }
        for ((a, b), (at, count)) in &self.swaps {
            let (a, b) = (&self.markers[*a].label, &self.markers[*b].label);
            doubts.push(Doubt {
                kind: DoubtKind::Swap,
                section: section.name.clone(),
                what: vec![a.clone(), b.clone()],
                time_s: at.time(section),
                says: format!(
                    "markers {a} and {b} exchange places {}, first {}; correct their labels in the capture software",
                    if *count == 1 { "once".to_owned() } else { format!("{count} times") },
                    at.says(section)
                ),
            });
        }
    }

    fn volt_doubts(&self, section: &Section, doubts: &mut Vec<Doubt>) {
        for track in &self.volts {
            let column = &section.columns[track.column];
            let title = column.title();
            let unit = &column.unit;
            let mut doubt = |kind, says| {
                doubts.push(Doubt {
                    kind,
                    section: section.name.clone(),
                    what: vec![title.clone()],
                    time_s: None,
                    says,
                });
            };
            let row = |row: usize| match (section.rate_hz, section.frames.is_empty()) {
                _ if row == usize::MAX => String::new(),
                (Some(r), _) => {
                    #[allow(clippy::cast_precision_loss)]
                    let s = row as f64 / r;
                    format!("{} after its beginning", written(s, section))
                }
                _ => format!("in row {}", row + 1),
            };
            for e in track.clipped() {
                let volts = e.value.abs() * Unit::parse(unit).map_or(1.0, |u| u.to_si);
                let rail = [1.0, 2.5, 5.0, 10.0]
                    .iter()
                    .any(|r| (volts - r).abs() <= 0.01 * r);
                doubt(
                    DoubtKind::Clipped,
                    format!(
                        "{title} runs into {} {unit} at its usual slope and stays there for up to {} samples, {} times, first {}: clipped{}, or held on purpose",
                        e.value,
                        e.longest,
                        e.runs,
                        row(e.first_row),
                        if rail {
                            " by a converter with that range"
                        } else {
                            ""
                        },
                    ),
                );
            }
            let range = self.columns[track.column].range.unwrap_or([0.0; 2]);
            if let Some((count, worst, at)) = track.spikes.found(0.05 * (range[1] - range[0]), true)
            {
                doubt(
                    DoubtKind::Spikes,
                    format!(
                        "{title}: {} stick out, the worst by {worst:.3e} {unit} {}",
                        samples(count),
                        row(at)
                    ),
                );
            }
        }
    }

    fn unit_doubts(&self, section: &Section, doubts: &mut Vec<Doubt>) {
        let largest = |columns: &mut dyn Iterator<Item = usize>| {
            columns
                .filter_map(|c| self.columns[c].range)
                .map(|[a, b]| a.abs().max(b.abs()))
                .fold(0.0, f64::max)
        };
        let mut doubt = |what: Vec<String>, says: String| {
            doubts.push(Doubt {
                kind: DoubtKind::Unit,
                section: section.name.clone(),
                what,
                time_s: None,
                says,
            });
        };
        for unit in ["m", "cm", "mm"] {
            let of_unit: Vec<&MarkerTrack> = self
                .markers
                .iter()
                .filter(|m| m.unit.is_some_and(|u| u.symbol == unit))
                .collect();
            let size = largest(&mut of_unit.iter().flat_map(|m| m.columns));
            let metres = size * Unit::parse(unit).map_or(1.0, |u| u.to_si);
            if metres > 100.0 {
                doubt(
                    Vec::new(),
                    format!(
                        "positions in {unit} go up to {size:.4}: that is {metres:.0} m; is the unit mm?"
                    ),
                );
            } else if size > 0.0 && metres < 0.005 {
                doubt(
                    Vec::new(),
                    format!(
                        "positions in {unit} stay below {size:.4}: that is {:.3} mm; is the unit m?",
                        metres * 1e3
                    ),
                );
            }
        }
        for track in &self.volts {
            let column = &section.columns[track.column];
            let size = largest(&mut std::iter::once(track.column));
            let volts = size * Unit::parse(&column.unit).map_or(1.0, |u| u.to_si);
            if volts > 50_000.0 {
                doubt(
                    vec![column.title()],
                    format!(
                        "{} goes up to {size} {}: is the unit V?",
                        column.title(),
                        column.unit
                    ),
                );
            }
        }
        for (i, column) in self.columns.iter().enumerate() {
            let size = largest(&mut std::iter::once(i));
            let unit = Unit::parse(&column.unit);
            if unit.is_some_and(|u| u.symbol == "rad") && size > 1.01 * std::f64::consts::TAU {
                doubt(
                    vec![column.title.clone()],
                    format!(
                        "{} goes up to {size:.2} rad, more than a turn: is the unit deg?",
                        column.title
                    ),
                );
            }
            if unit.is_none()
                && column.unit.is_empty()
                && column.title.to_lowercase().contains("volt")
                && size > 20.0
            {
                doubt(
                    vec![column.title.clone()],
                    format!(
                        "{} has no unit and goes up to {size}: more than a converter gives; V at the film?",
                        column.title
                    ),
                );
            }
        }
    }
}
