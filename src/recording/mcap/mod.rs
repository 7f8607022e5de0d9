//! MCAP: messages of ROS 2 (CDR), ROS 1, protobuf and JSON, read by the schemas that the file carries.
//!
//! A topic is a section; a message is a row, a number in it a column. The position of a pose is the group
//! that is called as the topic (`end_effector = "/vicon/ee/pose"`), what else there is stands in groups
//! `topic/orientation`. A topic with lists of named things (transforms, rigid bodies, markers) is a section a
//! thing, and the group has the thing's name: `world:ee` for a transform, so that `ee` finds it. Lists of up
//! to 64 numbers are columns `data[0]`, `data[1]`, ...
//!
//! The time of a row is the stamp in the message (`header.stamp`, `stamp`, `timestamp`) where that is set,
//! else the log time; both as seconds since 1970 as far as the recorder's clock counts so. Rows are put in
//! the order of time, because recorders need not write them so.
//!
//! The file is read in order and needs no index; one that was cut gives what stands before the cut. A chunk
//! whose checksum is wrong is an error. A file of any size is surveyed in constant memory
//! ([`Importer::stream`]).

mod json;
mod protobuf;
mod records;
mod ros;
mod table;

use std::collections::HashMap;
use std::path::Path;

use super::capture::{BATCH, Capture, Importer, Note, ReadOptions, Section, Sink, nothing};
use super::error::{Error, ErrorKind, quote};
use super::text::decode;
pub use records::{MAX_RECORD_BYTES, Record, RecordReader};
use records::{op, u16_at, u32_at, u64_at};
use table::{MAX_LEAVES, Table, Tables};

/// The importer of MCAP files.
pub struct Mcap;

impl Importer for Mcap {
    fn name(&self) -> &'static str {
        "mcap"
    }

    fn recognises(&self, head: &[u8], _path: &Path) -> bool {
        head.starts_with(b"\x89MCAP0")
    }

    fn read(&self, path: &Path, _options: &ReadOptions) -> Result<Capture, Error> {
        let gathered = gather(path, Keeping::All, &mut |_, _| {})?;
        Ok(capture(path, gathered)?.0)
    }

    /// A small file is read as [`Importer::read`] does. Of a larger one the beginning tells what its topics
    /// hold; where the end tells otherwise, the rows are shown again from the first.
    fn stream(
        &self,
        path: &Path,
        _options: &ReadOptions,
        sink: &mut dyn Sink,
    ) -> Result<Capture, Error> {
        let beginning = gather(path, Keeping::Few, &mut |_, _| {})?;
        let whole = !beginning.stopped;
        let (mut guess, mut sources) = capture(path, beginning)?;
        if whole {
            for (index, section) in guess.sections.iter_mut().enumerate() {
                sink.rows(index, section);
            }
            return Ok(guess);
        }
        loop {
            let sections = &mut guess.sections;
            sections.iter_mut().for_each(Section::clear_rows);
            let mut late = vec![0; sections.len()];
            let mut show = |channel: usize, c: &mut Channel, all: bool| {
                for (table, t) in c.tables.list.iter_mut().enumerate() {
                    for (place, series) in t.series.iter_mut().enumerate() {
                        if !all && series.waiting() < WAITING {
                            continue;
                        }
                        let from = |s: &Source| (s.channel, s.table, s.series);
                        let here = (channel, table, place);
                        let Some(index) = sources.iter().position(|s| from(s) == here) else {
                            series.forget();
                            continue;
                        };
                        // rows in the order of time need not wait
                        let source = &sources[index];
                        let now = all || source.in_order;
                        late[index] += series.pour(&mut sections[index], &source.leaves, now);
                        sink.rows(index, &mut sections[index]);
                    }
                }
                c.tables.waiting = 0;
            };
            let mut gathered = gather(path, Keeping::Some, &mut |channel, c| {
                if c.tables.waiting >= WAITING {
                    show(channel, c, false);
                }
            })?;
            for (channel, c) in gathered.channels.iter_mut().enumerate() {
                show(channel, c, true);
            }
            let (mut out, known) = capture(path, gathered)?;
            if known != sources {
                sink.restart();
                (guess, sources) = (out, known);
                continue;
            }
            for (section, late) in out.sections.iter().zip(late) {
                if late > 0 {
                    out.notes.push(Note::warning(
                        path,
                        format!(
                            "{}: {late} rows are earlier than rows long before them, and stay where they are",
                            section.name
                        ),
                    ));
                }
            }
            return Ok(out);
        }
    }
}

/// Values beyond which the rows of a file are shown as they come instead of being kept; 32 MiB.
const FEW_VALUES: usize = 1 << 22;
/// So many values of a series wait before they are shown: rows that are out of order by less are put into
/// order.
const WAITING: usize = 2 * BATCH;

/// What becomes of the rows.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Keeping {
    /// Kept; too many are an error.
    All,
    /// Kept while they are few; the reading stops there.
    Few,
    /// Kept until someone takes them.
    Some,
}

/// What was read of a file.
struct Gathered {
    reader: RecordReader,
    channels: Vec<Channel>,
    unknown: u64,
    broken: u64,
    /// How many messages the recorder counted.
    declared: Option<u64>,
    /// The rows were too many, and what follows was not read.
    stopped: bool,
}

/// Where the rows of a section come from.
#[derive(PartialEq, Eq)]
struct Source {
    channel: usize,
    table: usize,
    series: usize,
    /// The leaf of each column.
    leaves: Vec<usize>,
    in_order: bool,
}

struct Schema {
    name: String,
    encoding: String,
    data: Vec<u8>,
}

enum Decoder {
    Ros(ros::Layout),
    Json(json::Layout),
    Protobuf(protobuf::Layout),
    /// Messages for people.
    Log,
    /// Why there is none.
    None(String),
}

struct Channel {
    topic: String,
    unit: String,
    decoder: Decoder,
    tables: Tables,
    messages: u64,
    unread: u64,
    why: String,
}

/// The most channels; a file may not make up more than these.
const MAX_CHANNELS: usize = 1 << 16;

/// Length-prefixed pieces of a record.
struct Pieces<'a>(&'a [u8]);

impl<'a> Pieces<'a> {
    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        if count > self.0.len() {
            return None;
        }
        let (here, rest) = self.0.split_at(count);
        self.0 = rest;
        Some(here)
    }

    fn u16(&mut self) -> Option<u16> {
        self.bytes(2).map(|b| u16_at(b, 0))
    }

    fn prefixed(&mut self) -> Option<&'a [u8]> {
        let length = self.bytes(4).map(|b| u32_at(b, 0))?;
        self.bytes(usize::try_from(length).ok()?)
    }

    fn text(&mut self) -> Option<String> {
        self.prefixed().map(|b| decode(b).into_owned())
    }
}

fn schema(body: &[u8]) -> Option<(u16, Schema)> {
    let mut p = Pieces(body);
    let id = p.u16()?;
    let (name, encoding) = (p.text()?, p.text()?);
    let data = p.prefixed()?.to_vec();
    Some((
        id,
        Schema {
            name,
            encoding,
            data,
        },
    ))
}

struct ChannelText {
    id: u16,
    schema: u16,
    topic: String,
    encoding: String,
    unit: String,
}

fn channel(body: &[u8]) -> Option<ChannelText> {
    let mut p = Pieces(body);
    let (id, schema) = (p.u16()?, p.u16()?);
    let (topic, encoding) = (p.text()?, p.text()?);
    let mut metadata = Pieces(p.prefixed()?);
    let mut unit = String::new();
    while let (Some(key), Some(value)) = (metadata.text(), metadata.text()) {
        if key == "unit" {
            unit = value;
        }
    }
    Some(ChannelText {
        id,
        schema,
        topic,
        encoding,
        unit,
    })
}

impl Channel {
    fn new(c: ChannelText, schema: Option<&Schema>) -> Self {
        let mut tables = Tables::new();
        let decoder = match (c.encoding.as_str(), schema) {
            (_, Some(s)) if table::is_log(&s.name) => Decoder::Log,
            ("cdr", Some(s)) if matches!(s.encoding.as_str(), "ros2msg" | "ros2idl") => {
                ros::Layout::new(&s.name, &s.encoding, &decode(&s.data), &mut tables)
                    .map_or_else(Decoder::None, Decoder::Ros)
            }
            ("ros1", Some(s)) if s.encoding == "ros1msg" => {
                ros::Layout::new(&s.name, &s.encoding, &decode(&s.data), &mut tables)
                    .map_or_else(Decoder::None, Decoder::Ros)
            }
            ("protobuf", Some(s)) if s.encoding == "protobuf" => {
                protobuf::Layout::new(&s.name, &s.data, &mut tables)
                    .map_or_else(Decoder::None, Decoder::Protobuf)
            }
            ("json", s) => Decoder::Json(json::Layout::new(s.map_or("", |s| &s.name))),
            (encoding, None) => {
                Decoder::None(format!("messages in {} without a schema", quote(encoding)))
            }
            (encoding, Some(s)) => Decoder::None(format!(
                "messages in {} with a schema in {}",
                quote(encoding),
                quote(&s.encoding)
            )),
        };
        let mut why = String::new();
        if let Decoder::None(reason) = &decoder {
            why.clone_from(reason);
            tables = Tables::new();
        }
        Channel {
            topic: c.topic,
            unit: c.unit,
            decoder,
            tables,
            messages: 0,
            unread: 0,
            why,
        }
    }

    fn message(&mut self, log_time: u64, data: &[u8]) {
        self.messages += 1;
        let log_s = log_time as f64 * 1e-9;
        let read = match &mut self.decoder {
            Decoder::Ros(layout) => layout
                .read(data, log_s, &mut self.tables)
                .map_err(str::to_owned),
            Decoder::Json(layout) => layout.read(data, log_s, &mut self.tables),
            Decoder::Protobuf(layout) => layout
                .read(data, log_s, &mut self.tables)
                .map_err(str::to_owned),
            Decoder::Log | Decoder::None(_) => return,
        };
        if let Err(why) = read {
            if self.unread == 0 {
                self.why = why;
            }
            self.unread += 1;
        }
    }
}

/// Goes through a file; `after` sees each channel after its message.
fn gather(
    path: &Path,
    keeping: Keeping,
    after: &mut dyn FnMut(usize, &mut Channel),
) -> Result<Gathered, Error> {
    let mut reader = RecordReader::open(path)?;
    let mut schemas: HashMap<u16, Schema> = HashMap::new();
    let mut channels: Vec<Channel> = Vec::new();
    let mut by_id: Vec<u32> = vec![u32::MAX; 1 << 16];
    let mut unknown: u64 = 0;
    let mut broken: u64 = 0;
    let mut declared = None;
    let mut stopped = false;
    let mut budget = match keeping {
        Keeping::All => table::MAX_VALUES,
        Keeping::Few => FEW_VALUES,
        Keeping::Some => usize::MAX,
    };
    while let Some(Record { opcode, body }) = reader.advance()? {
        match opcode {
            op::MESSAGE if body.len() >= 22 => {
                let id = usize::from(u16_at(body, 0));
                let at = by_id[id] as usize;
                let Some(c) = channels.get_mut(at) else {
                    unknown += 1;
                    continue;
                };
                if keeping == Keeping::Some {
                    budget = usize::MAX;
                }
                c.tables.budget = budget;
                c.message(u64_at(body, 6), &body[22..]);
                budget = c.tables.budget;
                if c.tables.full && keeping == Keeping::Few {
                    stopped = true;
                    break;
                } else if c.tables.full {
                    return Err(Error::new(
                        ErrorKind::Grammar,
                        path,
                        format!(
                            "the messages hold more than {} numbers, too many to keep",
                            table::MAX_VALUES
                        ),
                    )
                    .action(
                        "write the topics that are needed to a file of their own (`mcap filter`)",
                    ));
                } else {
                    after(at, c);
                }
            }
            op::SCHEMA => match schema(body) {
                Some((id, s)) => drop(schemas.entry(id).or_insert(s)),
                None => broken += 1,
            },
            op::CHANNEL => match channel(body) {
                Some(c) => {
                    let id = usize::from(c.id);
                    if by_id[id] == u32::MAX && channels.len() < MAX_CHANNELS {
                        by_id[id] = u32::try_from(channels.len()).unwrap_or(u32::MAX);
                        let schema = schemas.get(&c.schema);
                        channels.push(Channel::new(c, schema));
                    }
                }
                None => broken += 1,
            },
            op::MESSAGE => broken += 1,
            op::STATISTICS if body.len() >= 8 => declared = Some(u64_at(body, 0)),
            // what follows is the summary: the same schemas and channels again
            op::DATA_END => schemas.clear(),
            _ => {}
        }
    }
    Ok(Gathered {
        reader,
        channels,
        unknown,
        broken,
        declared,
        stopped,
    })
}

/// A few of some names, for a sentence.
fn some(names: &[&str]) -> String {
    const MOST: usize = 6;
    let shown: Vec<&str> = names.iter().take(MOST).copied().collect();
    let more = if names.len() > MOST {
        format!(" and {} more", names.len() - MOST)
    } else {
        String::new()
    };
    format!("{}{more}", shown.join(", "))
}

/// What was read, in sections, and where the rows of each come from.
fn capture(path: &Path, gathered: Gathered) -> Result<(Capture, Vec<Source>), Error> {
    let mut made = Made {
        path,
        notes: Vec::new(),
        sections: Vec::new(),
        sources: Vec::new(),
        number: 0,
    };
    let messages: u64 = gathered.channels.iter().map(|c| c.messages).sum();
    made.tell_cut(&gathered.reader, messages)?;
    made.tell_unreadable(&gathered.channels)?;
    made.tell_topics(&gathered.channels);
    made.tell_records(&gathered, messages);
    let mut empty: Vec<String> = Vec::new();
    for (index, channel) in gathered.channels.into_iter().enumerate() {
        empty.extend(made.channel(index, channel));
    }
    if !empty.is_empty() {
        let names: Vec<&str> = empty.iter().map(String::as_str).collect();
        made.info(format!(
            "{} topics hold no number: {}",
            empty.len(),
            some(&names)
        ));
    }
    let chunks = gathered.reader.chunks();
    let beginning = format!("{messages} messages in {chunks} chunks");
    made.notes.insert(0, Note::info(path, beginning));
    if made.sections.is_empty() {
        return Err(nothing(path, &made.notes));
    }
    let capture = Capture {
        format: "mcap",
        sections: made.sections,
        notes: made.notes,
    };
    Ok((capture, made.sources))
}

/// Sections as they are made, and what there is to say of them.
struct Made<'a> {
    path: &'a Path,
    notes: Vec<Note>,
    sections: Vec<Section>,
    sources: Vec<Source>,
    /// The columns so far.
    number: usize,
}

impl Made<'_> {
    /// Notes what is as it should be.
    fn info(&mut self, text: String) {
        self.notes.push(Note::info(self.path, text));
    }

    /// Notes what a reader should see.
    fn warn(&mut self, text: String) {
        self.notes.push(Note::warning(self.path, text));
    }

    /// That the file was cut; before its first message that is an error.
    fn tell_cut(&mut self, reader: &RecordReader, messages: u64) -> Result<(), Error> {
        let Some(cut) = reader.cut() else {
            return Ok(());
        };
        if messages == 0 {
            return Err(Error::new(
                ErrorKind::NoData,
                self.path,
                format!("the file was cut before its first message: {cut}"),
            )
            .action(
                "the recorder did not come to write; take the recording again, or use another copy",
            ));
        }
        self.warn(format!(
            "the file was cut: {cut}; {messages} messages before that are read"
        ));
        Ok(())
    }

    /// Topics with messages that no decoder reads; nothing but such is an error.
    fn tell_unreadable(&mut self, channels: &[Channel]) -> Result<(), Error> {
        let (unreadable, readable): (Vec<&Channel>, Vec<&Channel>) = channels
            .iter()
            .filter(|c| c.messages > 0)
            .partition(|c| matches!(c.decoder, Decoder::None(_)));
        if !unreadable.is_empty() && readable.is_empty() {
            let topics: Vec<&str> = unreadable.iter().map(|c| c.topic.as_str()).collect();
            return Err(Error::new(
                ErrorKind::UnknownFormat,
                self.path,
                format!(
                    "no topic can be read: {} ({})",
                    some(&topics),
                    unreadable[0].why
                ),
            )
            .expected("messages in cdr with ros2msg or ros2idl, ros1, protobuf or json")
            .action("record with a serialisation that is read, or convert the file"));
        }
        for c in unreadable {
            self.warn(format!(
                "topic {} is left out: {} ({} messages)",
                c.topic, c.why, c.messages
            ));
        }
        Ok(())
    }

    /// Topics that say nothing, or nothing that is a number.
    fn tell_topics(&mut self, channels: &[Channel]) {
        let named = |wanted: &dyn Fn(&Channel) -> bool| -> Vec<&str> {
            channels
                .iter()
                .filter(|c| wanted(c))
                .map(|c| c.topic.as_str())
                .collect()
        };
        let silent = named(&|c| c.messages == 0);
        if !silent.is_empty() {
            self.info(format!(
                "{} topics without a message: {}",
                silent.len(),
                some(&silent)
            ));
        }
        let logs = named(&|c| c.messages > 0 && matches!(c.decoder, Decoder::Log));
        if !logs.is_empty() {
            self.info(format!(
                "log messages are no measurement and are left out: {}",
                some(&logs)
            ));
        }
    }

    /// Records that are left out, and whether as many are there as the recorder counted.
    fn tell_records(&mut self, gathered: &Gathered, messages: u64) {
        let (unknown, broken) = (gathered.unknown, gathered.broken);
        if unknown > 0 {
            self.warn(format!(
                "{unknown} messages are of channels that the file does not describe, and are left out"
            ));
        }
        if broken > 0 {
            self.warn(format!(
                "{broken} records are too short for what they are, and are left out"
            ));
        }
        let found = messages + unknown + broken;
        let passed_over = gathered.reader.passed_over();
        if let Some(declared) = gathered
            .declared
            .filter(|d| *d != found && passed_over == 0)
        {
            self.warn(format!(
                "the recorder counted {declared} messages, {found} are there"
            ));
        }
        if passed_over > 0 {
            self.warn(format!(
                "{passed_over} records longer than {} MiB are passed over",
                MAX_RECORD_BYTES >> 20
            ));
        }
    }

    /// Adds the sections of a channel; its topic if it was read and holds no number.
    fn channel(&mut self, index: usize, c: Channel) -> Option<String> {
        let topic = c.topic;
        if c.unread > 0 {
            self.warn(format!(
                "topic {topic}: {} of {} messages cannot be read: {}",
                c.unread, c.messages, c.why
            ));
        }
        let before = self.sections.len();
        for (i, table) in c.tables.list.into_iter().enumerate() {
            self.table((index, i), table, &topic, &c.unit);
        }
        let numberless = self.sections.len() == before
            && c.messages > c.unread
            && !matches!(c.decoder, Decoder::None(_) | Decoder::Log);
        numberless.then_some(topic)
    }

    /// Adds the sections of a table; `at` is its channel and its place there.
    fn table(&mut self, at: (usize, usize), mut t: Table, topic: &str, unit: &str) {
        if t.left_out > 0 {
            self.warn(format!(
                "topic {topic}: only {MAX_LEAVES} things are kept apart; {} rows are left out",
                t.left_out
            ));
        }
        if t.leaves.len() >= MAX_LEAVES {
            self.warn(format!(
                "topic {topic}: only {MAX_LEAVES} numbers of a message are kept"
            ));
        }
        // one thing alone on a topic is called as the topic
        if at.1 == 0 && t.series.len() == 1 {
            t.series[0].unname();
        }
        for (place, series) in t.series.into_iter().enumerate() {
            let (back, rows) = (series.back(), series.rows());
            let Some((section, leaves)) =
                series.section(topic, (&t.path, &t.leaves), unit, &mut self.number)
            else {
                continue;
            };
            self.sources.push(Source {
                channel: at.0,
                table: at.1,
                series: place,
                leaves,
                in_order: back == 0,
            });
            if back > 0 {
                self.info(format!(
                    "{}: {back} of {rows} rows are earlier than the row before; sorted",
                    section.name
                ));
            }
            self.sections.push(section);
        }
    }
}
