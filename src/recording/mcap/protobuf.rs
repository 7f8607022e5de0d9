//! Protobuf messages, read by the descriptors that the file carries (a `FileDescriptorSet`, itself protobuf).
//!
//! A field is a tag (number and wire type) and its value. A number that proto3 leaves out is 0; one that may
//! be absent (optional, one of several, proto2) is a gap.

use std::collections::HashMap;

use super::ros::seconds;
use super::table::{KEY_NUMBERS, MAX_LIST, Table, Tables, key_fields, unit};

/// Why bytes are no message.
type Broken = &'static str;

const SHORT: Broken = "it ends early";

/// A field as it stands in the bytes.
enum Wire<'a> {
    Varint(u64),
    Fixed64(u64),
    Fixed32(u32),
    Bytes(&'a [u8]),
    /// Begin or end of a group of proto2.
    Group,
}

struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn varint(&mut self) -> Result<u64, Broken> {
        let mut value = 0u64;
        for i in 0..10 {
            let (first, rest) = self.0.split_first().ok_or(SHORT)?;
            self.0 = rest;
            value |= u64::from(first & 0x7f) << (7 * i);
            if first & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err("a number in it has no end")
    }

    fn bytes(&mut self, count: usize) -> Result<&'a [u8], Broken> {
        if count > self.0.len() {
            return Err(SHORT);
        }
        let (here, rest) = self.0.split_at(count);
        self.0 = rest;
        Ok(here)
    }

    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], Broken> {
        let mut out = [0; N];
        out.copy_from_slice(self.bytes(N)?);
        Ok(out)
    }

    fn field(&mut self) -> Result<Option<(u64, Wire<'a>)>, Broken> {
        if self.0.is_empty() {
            return Ok(None);
        }
        let tag = self.varint()?;
        let value = match tag & 7 {
            0 => Wire::Varint(self.varint()?),
            1 => Wire::Fixed64(u64::from_le_bytes(self.fixed()?)),
            2 => {
                let length = usize::try_from(self.varint()?).map_err(|_| SHORT)?;
                Wire::Bytes(self.bytes(length)?)
            }
            3 | 4 => Wire::Group,
            5 => Wire::Fixed32(u32::from_le_bytes(self.fixed()?)),
            _ => return Err("it has a field of no known kind"),
        };
        Ok(Some((tag >> 3, value)))
    }
}

#[derive(Debug, Clone, Default)]
struct FieldText {
    name: String,
    number: u64,
    repeated: bool,
    may_be_absent: bool,
    /// `Type` of descriptor.proto.
    kind: u64,
    of: String,
}

#[derive(Debug, Clone, Default)]
struct MessageText {
    fields: Vec<FieldText>,
    map: bool,
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Every message of a descriptor set, by its full name without the first dot.
fn descriptors(set: &[u8]) -> Result<HashMap<String, MessageText>, Broken> {
    let mut all = HashMap::new();
    let mut files = Fields(set);
    while let Some((number, value)) = files.field()? {
        let (1, Wire::Bytes(file)) = (number, value) else {
            continue;
        };
        let (mut package, mut proto3) = (String::new(), false);
        let mut messages = Vec::new();
        let mut fields = Fields(file);
        while let Some((number, value)) = fields.field()? {
            match (number, value) {
                (2, Wire::Bytes(b)) => package = text(b),
                (4, Wire::Bytes(b)) => messages.push(b),
                (12, Wire::Bytes(b)) => proto3 = b == b"proto3",
                _ => {}
            }
        }
        for m in messages {
            message(m, &package, proto3, &mut all, 0)?;
        }
    }
    Ok(all)
}

fn message(
    bytes: &[u8],
    scope: &str,
    proto3: bool,
    all: &mut HashMap<String, MessageText>,
    depth: usize,
) -> Result<(), Broken> {
    if depth > DEPTH {
        return Err("its messages are nested too deep");
    }
    let mut name = String::new();
    let mut nested = Vec::new();
    let mut out = MessageText::default();
    let mut fields = Fields(bytes);
    while let Some((number, value)) = fields.field()? {
        match (number, value) {
            (1, Wire::Bytes(b)) => name = text(b),
            (2, Wire::Bytes(b)) => out.fields.push(field(b, proto3)?),
            (3, Wire::Bytes(b)) => nested.push(b),
            (7, Wire::Bytes(b)) => {
                let mut options = Fields(b);
                while let Some((number, value)) = options.field()? {
                    out.map |= matches!((number, value), (7, Wire::Varint(1)));
                }
            }
            _ => {}
        }
    }
    let full = if scope.is_empty() {
        name
    } else {
        format!("{scope}.{name}")
    };
    for m in nested {
        message(m, &full, proto3, all, depth + 1)?;
    }
    all.insert(full, out);
    Ok(())
}

fn field(bytes: &[u8], proto3: bool) -> Result<FieldText, Broken> {
    let mut out = FieldText::default();
    let (mut in_oneof, mut optional3) = (false, false);
    let mut fields = Fields(bytes);
    while let Some((number, value)) = fields.field()? {
        match (number, value) {
            (1, Wire::Bytes(b)) => out.name = text(b),
            (3, Wire::Varint(v)) => out.number = v,
            (4, Wire::Varint(v)) => out.repeated = v == 3,
            (5, Wire::Varint(v)) => out.kind = v,
            (6, Wire::Bytes(b)) => out.of = text(b).trim_start_matches('.').to_owned(),
            (9, Wire::Varint(_)) => in_oneof = true,
            (17, Wire::Varint(v)) => optional3 = v == 1,
            _ => {}
        }
    }
    out.may_be_absent = !proto3 || in_oneof || optional3;
    Ok(out)
}

/// What a field is used for.
#[derive(Debug)]
enum Use {
    Number {
        kind: u64,
        leaf: usize,
    },
    Numbers {
        kind: u64,
        first: usize,
        most: usize,
        place: usize,
    },
    Text,
    Stamp,
    Seconds {
        leaf: usize,
    },
    Message(Message),
    Things {
        table: usize,
        key: Option<usize>,
        element: Message,
    },
}

#[derive(Debug, Default)]
struct Message {
    /// By number; short lists.
    fields: Vec<(u64, Use)>,
    /// Leaves that are 0 when they are left out.
    zero: Vec<usize>,
}

/// A message type, ready to be read.
#[derive(Debug)]
pub(super) struct Layout {
    root: Message,
    /// How many numbers of each list the message has given.
    lists: usize,
}

const DEPTH: usize = 32;
const MOST_NODES: usize = 20_000;

struct Compiler<'a> {
    all: &'a HashMap<String, MessageText>,
    nodes: usize,
    lists: usize,
}

impl Compiler<'_> {
    fn message(
        &mut self,
        name: &str,
        holder: &str,
        path: &str,
        at: usize,
        tables: &mut Tables,
        depth: usize,
    ) -> Result<Message, String> {
        self.nodes += 1;
        if depth > DEPTH || self.nodes > MOST_NODES {
            return Ok(Message::default());
        }
        let of = self
            .all
            .get(name)
            .ok_or_else(|| format!("{name} is not described in the file"))?;
        let mut out = Message::default();
        for f in &of.fields {
            let here = if path.is_empty() {
                f.name.clone()
            } else {
                format!("{path}.{}", f.name)
            };
            let table = &mut tables.list[at];
            let number = matches!(f.kind, 1..=8 | 13..=18);
            let used = match (f.repeated, f.kind) {
                (false, _) if number => {
                    let Some(leaf) = table.leaf(here, unit(name, holder, &f.name)) else {
                        continue;
                    };
                    if !f.may_be_absent {
                        out.zero.push(leaf);
                    }
                    Use::Number { kind: f.kind, leaf }
                }
                (true, _) if number && f.kind != 14 => {
                    let first = table.leaves.len();
                    let most = (0..MAX_LIST)
                        .filter(|i| table.leaf(format!("{here}[{i}]"), "").is_some())
                        .count();
                    self.lists += 1;
                    Use::Numbers {
                        kind: f.kind,
                        first,
                        most,
                        place: self.lists - 1,
                    }
                }
                (false, 9) if table.texts.contains(&here) => Use::Text,
                (false, 11) if is_time(&f.of) => {
                    if matches!(here.as_str(), "timestamp" | "stamp" | "header.stamp") {
                        Use::Stamp
                    } else if let Some(leaf) = table.leaf(here, "s") {
                        Use::Seconds { leaf }
                    } else {
                        continue;
                    }
                }
                (false, 11) => {
                    Use::Message(self.message(&f.of, &f.name, &here, at, tables, depth + 1)?)
                }
                (true, 11) if at == 0 && !is_time(&f.of) => {
                    if self.all.get(&f.of).is_some_and(|m| m.map) {
                        continue;
                    }
                    tables
                        .list
                        .push(Table::of_list(here, self.texts(&f.of, true)));
                    let t = tables.list.len() - 1;
                    let element = self.message(&f.of, &f.name, "", t, tables, depth + 1)?;
                    let leaves = &tables.list[t].leaves;
                    let key = KEY_NUMBERS
                        .iter()
                        .find_map(|k| leaves.iter().position(|l| l.path == *k));
                    Use::Things {
                        table: t,
                        key,
                        element,
                    }
                }
                _ => continue,
            };
            out.fields.push((f.number, used));
        }
        Ok(out)
    }

    fn texts(&self, message: &str, of_list: bool) -> Vec<String> {
        let Some(m) = self.all.get(message) else {
            return Vec::new();
        };
        let names: Vec<&str> = m
            .fields
            .iter()
            .filter(|f| f.kind == 9 && !f.repeated)
            .map(|f| f.name.as_str())
            .collect();
        key_fields(&names, of_list)
            .into_iter()
            .map(str::to_owned)
            .collect()
    }
}

fn is_time(name: &str) -> bool {
    matches!(
        name,
        "google.protobuf.Timestamp" | "google.protobuf.Duration"
    )
}

fn decoded(kind: u64, value: &Wire) -> Option<f64> {
    Some(match (kind, value) {
        (1, Wire::Fixed64(v)) => f64::from_bits(*v),
        (2, Wire::Fixed32(v)) => f64::from(f32::from_bits(*v)),
        (3, Wire::Varint(v)) => *v as i64 as f64,
        (4, Wire::Varint(v)) => *v as f64,
        // 32-bit numbers are written as 64-bit ones
        (5 | 14, Wire::Varint(v)) => f64::from(*v as i32),
        (13, Wire::Varint(v)) => f64::from(*v as u32),
        (8, Wire::Varint(v)) => f64::from(u8::from(*v != 0)),
        (6, Wire::Fixed64(v)) => *v as f64,
        (16, Wire::Fixed64(v)) => *v as i64 as f64,
        (7, Wire::Fixed32(v)) => f64::from(*v),
        (15, Wire::Fixed32(v)) => f64::from(*v as i32),
        (17, Wire::Varint(v)) => f64::from(zigzag(*v) as i32),
        (18, Wire::Varint(v)) => zigzag(*v) as f64,
        _ => return None,
    })
}

fn zigzag(v: u64) -> i64 {
    (v >> 1) as i64 ^ -((v & 1) as i64)
}

/// The next number of a packed list.
fn packed<'a>(kind: u64, fields: &mut Fields<'a>) -> Result<Wire<'a>, Broken> {
    Ok(match kind {
        1 | 6 | 16 => Wire::Fixed64(u64::from_le_bytes(fields.fixed()?)),
        2 | 7 | 15 => Wire::Fixed32(u32::from_le_bytes(fields.fixed()?)),
        _ => Wire::Varint(fields.varint()?),
    })
}

impl Layout {
    /// Of a schema; adds the leaves of the message to `tables`.
    ///
    /// # Errors
    /// What in the descriptors is not understood.
    pub fn new(schema: &str, set: &[u8], tables: &mut Tables) -> Result<Self, String> {
        let all = descriptors(set).map_err(|e| format!("its descriptors cannot be read: {e}"))?;
        let mut compiler = Compiler {
            all: &all,
            nodes: 0,
            lists: 0,
        };
        tables.list[0].texts = compiler.texts(schema, false);
        let root = compiler.message(schema, "", "", 0, tables, 0)?;
        Ok(Layout {
            root,
            lists: compiler.lists,
        })
    }

    /// Reads a message into the tables.
    ///
    /// # Errors
    /// What keeps it from being read.
    pub fn read(&self, data: &[u8], log_s: f64, tables: &mut Tables) -> Result<(), Broken> {
        tables.list[0].clear();
        let mut state = State {
            stamp_ns: 0,
            seen: vec![0; self.lists],
            log_s,
        };
        state.message(&self.root, data, 0, tables)?;
        tables.push(0, seconds(state.stamp_ns).unwrap_or(log_s));
        Ok(())
    }
}

struct State {
    stamp_ns: i64,
    /// Numbers of each list so far.
    seen: Vec<usize>,
    log_s: f64,
}

impl State {
    fn message(
        &mut self,
        of: &Message,
        data: &[u8],
        at: usize,
        tables: &mut Tables,
    ) -> Result<(), Broken> {
        for leaf in &of.zero {
            tables.list[at].set(*leaf, 0.0);
        }
        let mut fields = Fields(data);
        let mut index = 0;
        while let Some((number, value)) = fields.field()? {
            let Some((_, used)) = of.fields.iter().find(|(n, _)| *n == number) else {
                continue;
            };
            match (used, value) {
                (Use::Number { kind, leaf }, value) => {
                    if let Some(v) = decoded(*kind, &value) {
                        tables.list[at].set(*leaf, v);
                    }
                }
                (
                    Use::Numbers {
                        kind,
                        first,
                        most,
                        place,
                    },
                    Wire::Bytes(bytes),
                ) => {
                    let mut list = Fields(bytes);
                    while !list.0.is_empty() && self.seen[*place] < *most {
                        let value = packed(*kind, &mut list)?;
                        self.place(*kind, &value, *first, *place, at, tables);
                    }
                }
                (
                    Use::Numbers {
                        kind,
                        first,
                        most,
                        place,
                    },
                    value,
                ) if self.seen[*place] < *most => {
                    self.place(*kind, &value, *first, *place, at, tables);
                }
                (Use::Text, Wire::Bytes(bytes)) => tables.list[at].name(bytes),
                (Use::Stamp, Wire::Bytes(bytes)) => self.stamp_ns = time(bytes)?,
                (Use::Seconds { leaf }, Wire::Bytes(bytes)) => {
                    tables.list[at].set(*leaf, time(bytes)? as f64 * 1e-9);
                }
                (Use::Message(m), Wire::Bytes(bytes)) => self.message(m, bytes, at, tables)?,
                (
                    Use::Things {
                        table,
                        key,
                        element,
                    },
                    Wire::Bytes(bytes),
                ) => {
                    let outer = std::mem::take(&mut self.stamp_ns);
                    tables.list[*table].clear();
                    let seen = std::mem::take(&mut self.seen);
                    self.seen = vec![0; seen.len()];
                    self.message(element, bytes, *table, tables)?;
                    self.seen = seen;
                    let time_s = seconds(self.stamp_ns)
                        .or(seconds(outer))
                        .unwrap_or(self.log_s);
                    tables.push_thing(*table, time_s, *key, index);
                    index += 1;
                    self.stamp_ns = outer;
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn place(
        &mut self,
        kind: u64,
        value: &Wire,
        first: usize,
        place: usize,
        at: usize,
        tables: &mut Tables,
    ) {
        if let Some(v) = decoded(kind, value) {
            tables.list[at].set(first + self.seen[place], v);
        }
        self.seen[place] += 1;
    }
}

/// Seconds and nanoseconds of a Timestamp, ns.
fn time(bytes: &[u8]) -> Result<i64, Broken> {
    let mut fields = Fields(bytes);
    let mut ns = 0i64;
    while let Some((number, value)) = fields.field()? {
        match (number, value) {
            (1, Wire::Varint(v)) => {
                ns = ns.saturating_add((v as i64).saturating_mul(1_000_000_000))
            }
            (2, Wire::Varint(v)) => ns = ns.saturating_add(i64::from(v as i32)),
            _ => {}
        }
    }
    Ok(ns)
}
