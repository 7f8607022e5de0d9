//! JSON messages, read as they come: every number at a path is a column.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};

use super::ros::seconds;
use super::table::{KEY_NUMBERS, MAX_LIST, Table, Tables, key_fields, unit};

/// What was found at a path so far.
#[derive(Debug, Default)]
struct Place {
    name: String,
    /// The leaf of a number here; `Some(None)` when there were too many.
    leaf: Option<Option<usize>>,
    children: Vec<Place>,
    /// The table of the things in this list.
    table: Option<usize>,
}

/// The shape of the messages of a topic.
#[derive(Debug, Default)]
pub(super) struct Layout {
    root: Place,
    package: String,
}

/// What one message, or one thing in it, tells beside numbers.
#[derive(Default)]
struct Told {
    stamp_ns: i64,
    /// Texts that may be names.
    names: Vec<(String, String)>,
}

struct Reader<'a> {
    tables: &'a mut Tables,
    package: &'a str,
    log_s: f64,
}

impl Layout {
    /// Of a schema's name.
    pub fn new(schema: &str) -> Self {
        Layout {
            root: Place::default(),
            package: schema.split('.').next().unwrap_or("").to_owned(),
        }
    }

    /// Reads a message into the tables.
    ///
    /// # Errors
    /// What keeps it from being read.
    pub fn read(&mut self, data: &[u8], log_s: f64, tables: &mut Tables) -> Result<(), String> {
        tables.list[0].clear();
        let mut told = Told::default();
        let mut reader = Reader {
            tables,
            package: &self.package,
            log_s,
        };
        let mut json = serde_json::Deserializer::from_slice(data);
        Node {
            place: &mut self.root,
            path: "",
            holder: "",
            table: Some(0),
            told: &mut told,
            reader: &mut reader,
        }
        .deserialize(&mut json)
        .and_then(|()| json.end())
        .map_err(|e| e.to_string())?;
        name(&told, false, &mut tables.list[0]);
        tables.push(0, seconds(told.stamp_ns).unwrap_or(log_s));
        Ok(())
    }
}

fn name(told: &Told, of_list: bool, table: &mut Table) {
    let names: Vec<&str> = told.names.iter().map(|n| n.0.as_str()).collect();
    for key in key_fields(&names, of_list) {
        if let Some((_, text)) = told.names.iter().find(|n| n.0 == key) {
            table.name(text.as_bytes());
        }
    }
}

/// One value of a message.
struct Node<'a, 'b> {
    place: &'a mut Place,
    /// Path inside its table.
    path: &'a str,
    holder: &'a str,
    table: Option<usize>,
    told: &'a mut Told,
    reader: &'a mut Reader<'b>,
}

impl Node<'_, '_> {
    fn number(self, value: f64) {
        let Some(t) = self.table else { return };
        let table = &mut self.reader.tables.list[t];
        let leaf = *self.place.leaf.get_or_insert_with(|| {
            let field = self.path.rsplit('.').next().unwrap_or("");
            let message = match (self.holder, field) {
                ("orientation" | "rotation", _) => "Quaternion",
                _ => "Vector3",
            };
            let unit = unit(
                &format!("{}.{message}", self.reader.package),
                self.holder,
                field,
            );
            let path = if self.path.is_empty() {
                "value"
            } else {
                self.path
            };
            table.leaf(path.to_owned(), unit)
        });
        if let Some(leaf) = leaf {
            table.set(leaf, value);
        }
    }
}

impl<'de> DeserializeSeed<'de> for Node<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<(), D::Error> {
        d.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Node<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_bool<E>(self, v: bool) -> Result<(), E> {
        self.number(f64::from(u8::from(v)));
        Ok(())
    }

    fn visit_i64<E>(self, v: i64) -> Result<(), E> {
        self.number(v as f64);
        Ok(())
    }

    fn visit_u64<E>(self, v: u64) -> Result<(), E> {
        self.number(v as f64);
        Ok(())
    }

    fn visit_f64<E>(self, v: f64) -> Result<(), E> {
        self.number(v);
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, v: &str) -> Result<(), E> {
        let field = self.path.rsplit('.').next().unwrap_or("");
        let may_name = matches!(
            field,
            "child_frame_id" | "frame_id" | "parent_frame_id" | "name" | "label" | "id"
        ) || field.ends_with("_name");
        if may_name && self.path.split('.').count() <= 2 {
            self.told.names.push((self.path.to_owned(), v.to_owned()));
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let stamps = matches!(self.path, "timestamp" | "stamp" | "header.stamp");
        let (mut sec, mut nsec, mut fields) = (None, None, 0);
        let mut next = 0;
        while let Some(at) = map.next_key_seed(Key {
            children: &mut self.place.children,
            next,
        })? {
            let Some(at) = at else {
                map.next_value::<serde::de::IgnoredAny>()?;
                continue;
            };
            next = at + 1;
            let child = &mut self.place.children[at];
            fields += 1;
            if stamps {
                match child.name.as_str() {
                    "sec" | "secs" | "seconds" => {
                        sec = map.next_value::<serde_json::Number>()?.as_i64();
                        continue;
                    }
                    "nsec" | "nsecs" | "nanosec" | "nanos" => {
                        nsec = map.next_value::<serde_json::Number>()?.as_i64();
                        continue;
                    }
                    _ => {}
                }
            }
            let path = if self.path.is_empty() {
                child.name.clone()
            } else {
                format!("{}.{}", self.path, child.name)
            };
            map.next_value_seed(Node {
                place: child,
                path: &path,
                holder: self.path.rsplit('.').next().unwrap_or(""),
                table: self.table,
                told: self.told,
                reader: self.reader,
            })?;
        }
        if let (Some(sec), Some(nsec), 2) = (sec, nsec, fields) {
            self.told.stamp_ns = sec.saturating_mul(1_000_000_000).saturating_add(nsec);
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        let mut i = 0;
        loop {
            // the first value tells what the list holds: numbers, or things
            if self.place.children.len() <= i && i < MAX_LIST {
                self.place.children.push(Place::default());
            }
            let one = if i < MAX_LIST { i } else { MAX_LIST - 1 };
            let path = format!("{}[{i}]", self.path);
            let mut element = Element {
                list: self.place,
                one,
                path: &path,
                list_path: self.path,
                table: if i < MAX_LIST { self.table } else { None },
                index: i,
                told: &mut *self.told,
                reader: &mut *self.reader,
            };
            if list.next_element_seed(&mut element)?.is_none() {
                return Ok(());
            }
            i += 1;
        }
    }
}

/// The place of a key: the next of last time, an other one, or a new one.
struct Key<'a> {
    children: &'a mut Vec<Place>,
    next: usize,
}

/// The most keys at one place.
const MAX_KEYS: usize = 1024;

impl<'de> DeserializeSeed<'de> for Key<'_> {
    type Value = Option<usize>;

    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<Option<usize>, D::Error> {
        d.deserialize_str(self)
    }
}

impl Visitor<'_> for Key<'_> {
    type Value = Option<usize>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a key")
    }

    fn visit_str<E>(self, key: &str) -> Result<Option<usize>, E> {
        if self.children.get(self.next).is_some_and(|c| c.name == key) {
            return Ok(Some(self.next));
        }
        if let Some(at) = self.children.iter().position(|c| c.name == key) {
            return Ok(Some(at));
        }
        if self.children.len() >= MAX_KEYS {
            return Ok(None);
        }
        self.children.push(Place {
            name: key.to_owned(),
            ..Place::default()
        });
        Ok(Some(self.children.len() - 1))
    }
}

/// One entry of a list.
struct Element<'a, 'b> {
    list: &'a mut Place,
    one: usize,
    path: &'a str,
    list_path: &'a str,
    table: Option<usize>,
    index: usize,
    told: &'a mut Told,
    reader: &'a mut Reader<'b>,
}

impl<'de> DeserializeSeed<'de> for &mut Element<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<(), D::Error> {
        d.deserialize_any(self)
    }
}

impl Element<'_, '_> {
    fn as_number(&mut self, value: f64) {
        Node {
            place: &mut self.list.children[self.one],
            path: self.path,
            holder: "",
            table: self.table,
            told: self.told,
            reader: self.reader,
        }
        .number(value);
    }
}

impl<'de> Visitor<'de> for &mut Element<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_bool<E>(self, v: bool) -> Result<(), E> {
        self.as_number(f64::from(u8::from(v)));
        Ok(())
    }

    fn visit_i64<E>(self, v: i64) -> Result<(), E> {
        self.as_number(v as f64);
        Ok(())
    }

    fn visit_u64<E>(self, v: u64) -> Result<(), E> {
        self.as_number(v as f64);
        Ok(())
    }

    fn visit_f64<E>(self, v: f64) -> Result<(), E> {
        self.as_number(v);
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        // a list of lists holds no column
        while list.next_element::<serde::de::IgnoredAny>()?.is_some() {}
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<(), A::Error> {
        // things of the message's own lists become series; those of lists inside them are passed over
        let own = self.list.table;
        let table = match own {
            Some(t) => Some(t),
            None if self.table == Some(0) => {
                self.reader
                    .tables
                    .list
                    .push(Table::of_list(self.list_path.to_owned(), Vec::new()));
                self.list.table = Some(self.reader.tables.list.len() - 1);
                self.list.table
            }
            None => None,
        };
        if let Some(t) = table {
            self.reader.tables.list[t].clear();
        }
        let mut told = Told::default();
        Node {
            // all things of a list have one shape
            place: &mut self.list.children[0],
            path: "",
            holder: "",
            table,
            told: &mut told,
            reader: &mut *self.reader,
        }
        .visit_map(map)?;
        if let Some(t) = table {
            let tables = &mut *self.reader.tables;
            name(&told, true, &mut tables.list[t]);
            let time_s = seconds(told.stamp_ns)
                .or(seconds(self.told.stamp_ns))
                .unwrap_or(self.reader.log_s);
            let leaves = &tables.list[t].leaves;
            let key = KEY_NUMBERS
                .iter()
                .find_map(|k| leaves.iter().position(|l| l.path == *k));
            tables.push_thing(t, time_s, key, self.index);
        }
        Ok(())
    }
}
