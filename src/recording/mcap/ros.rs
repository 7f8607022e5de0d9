//! Messages of ROS 1 and ROS 2, read by the definition that the file carries.
//!
//! ROS 2 writes CDR: four bytes say the byte order, numbers are aligned to their size (counted from behind
//! those four), a text is its length with the final NUL. ROS 1 writes little-endian without alignment. A
//! definition is the text of the `.msg` (its own first, those that it uses after a line of `=`), or OMG IDL.
//!
//! What a service was asked and answered is recorded as messages of type `pkg/srv/Name_Event`, beside which
//! recorders write the text of the `.srv`. That describes what is asked and what is answered, and no message:
//! this is a `service_msgs/ServiceEventInfo` with at most one request and at most one response behind it, as
//! rosidl makes it.

use std::collections::HashMap;

use super::table::{KEY_NUMBERS, MAX_LIST, Table, Tables, key_fields, unit};

/// How a number is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Number {
    fn size(self) -> usize {
        match self {
            Number::U8 | Number::I8 => 1,
            Number::U16 | Number::I16 => 2,
            Number::U32 | Number::I32 | Number::F32 => 4,
            Number::U64 | Number::I64 | Number::F64 => 8,
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Type {
    Number(Number),
    Text,
    WideText,
    /// `time` and `duration` of ROS 1.
    Time,
    Message(String),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum List {
    One,
    Fixed(usize),
    Counted,
    /// A list of one or none: what a service was asked, or answered.
    Maybe,
}

#[derive(Debug, Clone, PartialEq)]
struct Field {
    name: String,
    of: Type,
    list: List,
}

type Definitions = HashMap<String, Vec<Field>>;

/// `pkg/msg/Name`, `pkg::msg::Name` and `pkg/Name` are `pkg/Name`.
fn plain_name(name: &str) -> String {
    let steps: Vec<&str> = name
        .split(['/', ':'])
        .filter(|s| !s.is_empty() && *s != "msg" && *s != "srv" && *s != "action")
        .collect();
    steps.join("/")
}

fn primitive(name: &str, ros1: bool) -> Option<Type> {
    Some(match name {
        "bool" | "boolean" | "uint8" | "byte" | "octet" => Type::Number(Number::U8),
        // char is unsigned in both
        "char" => Type::Number(Number::U8),
        "int8" => Type::Number(Number::I8),
        "uint16" | "unsigned short" => Type::Number(Number::U16),
        "int16" | "short" => Type::Number(Number::I16),
        "uint32" | "unsigned long" => Type::Number(Number::U32),
        "int32" | "long" => Type::Number(Number::I32),
        "uint64" | "unsigned long long" => Type::Number(Number::U64),
        "int64" | "long long" => Type::Number(Number::I64),
        "float32" | "float" => Type::Number(Number::F32),
        "float64" | "double" => Type::Number(Number::F64),
        "string" => Type::Text,
        "wstring" => Type::WideText,
        "time" | "duration" if ros1 => Type::Time,
        _ => return None,
    })
}

/// The end of the names of messages that tell what a service was asked and answered.
const EVENT: &str = "_Event";

/// The definitions of a `ros1msg` or `ros2msg` schema.
fn parse_msg(name: &str, text: &str, ros1: bool) -> Result<Definitions, String> {
    let mut all = Definitions::new();
    let mut current = plain_name(name);
    let mut fields = Vec::new();
    // a line of `=` may stand above the first definition too
    let mut begun = false;
    for line in text.lines() {
        let line = line.trim();
        if line.starts_with("====") {
            let done = std::mem::take(&mut current);
            if begun {
                all.insert(done, std::mem::take(&mut fields));
            }
            begun = true;
            continue;
        }
        begun |= !line.is_empty();
        if let Some(next) = ["MSG:", "SRV:"].iter().find_map(|k| line.strip_prefix(k)) {
            current = plain_name(next.trim());
            continue;
        }
        if line == "---" {
            // of a .srv: what is asked above, what is answered below
            if current.ends_with("_Response") {
                return Err(
                    "a definition of three parts is an action's, which is not read".to_owned(),
                );
            }
            let service = current.strip_suffix(EVENT).unwrap_or(&current).to_owned();
            all.insert(format!("{service}_Request"), std::mem::take(&mut fields));
            current = format!("{service}_Response");
            continue;
        }
        let line = line.split('#').next().unwrap_or("").trim();
        let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
            continue;
        };
        let rest = rest.trim_start();
        let end = rest
            .find(|c: char| c.is_whitespace() || c == '=')
            .unwrap_or(rest.len());
        let (field, after) = rest.split_at(end);
        if after.trim_start().starts_with('=') {
            // a constant
            continue;
        }
        let (kind, list) = match kind.split_once('[') {
            None => (kind, List::One),
            Some((kind, size)) => {
                let size = size.trim_end_matches(']');
                let list = match size.parse() {
                    Ok(n) => List::Fixed(n),
                    Err(_) if size.is_empty() || size.starts_with("<=") => List::Counted,
                    Err(_) => return Err(format!("the length [{size}] of {field} is no number")),
                };
                (kind, list)
            }
        };
        // string<=10
        let kind = kind.split_once('<').map_or(kind, |(k, _)| k);
        let of = primitive(kind, ros1).unwrap_or_else(|| {
            Type::Message(if kind == "Header" {
                "std_msgs/Header".to_owned()
            } else if kind.contains('/') {
                plain_name(kind)
            } else {
                let package = current.split('/').next().unwrap_or("");
                format!("{package}/{kind}")
            })
        });
        fields.push(Field {
            name: field.to_owned(),
            of,
            list,
        });
    }
    all.insert(current, fields);
    Ok(all)
}

/// Puts the definition of a service's event in place where the schema is of one and has only what is asked
/// and answered; where the event is defined, its lists are of one or none. Whether the schema is of an event.
///
/// # Errors
/// The schema is of an event, and the file does not say of what service.
fn service_event(name: &str, definitions: &mut Definitions) -> Result<bool, String> {
    let service = name.strip_suffix(EVENT);
    let (request, response) = (
        format!("{}_Request", service.unwrap_or(name)),
        format!("{}_Response", service.unwrap_or(name)),
    );
    let known = definitions.contains_key(&request) && definitions.contains_key(&response);
    let defined = definitions.get(name).is_some_and(|f| !f.is_empty());
    if service.is_none() && (defined || !known) {
        return Ok(false);
    }
    if !known {
        return Err("the file does not define what its service is asked and answers".to_owned());
    }
    let one = |name: &str, of: Type, list: List| Field {
        name: name.to_owned(),
        of,
        list,
    };
    let info = "service_msgs/ServiceEventInfo";
    // service_msgs/msg/ServiceEventInfo.msg of ROS 2 Iron and later
    definitions.entry(info.to_owned()).or_insert_with(|| {
        vec![
            one("event_type", Type::Number(Number::U8), List::One),
            one(
                "stamp",
                Type::Message("builtin_interfaces/Time".to_owned()),
                List::One,
            ),
            one("client_gid", Type::Number(Number::U8), List::Fixed(16)),
            one("sequence_number", Type::Number(Number::I64), List::One),
        ]
    });
    definitions.insert(
        name.to_owned(),
        vec![
            one("info", Type::Message(info.to_owned()), List::One),
            one("request", Type::Message(request), List::Maybe),
            one("response", Type::Message(response), List::Maybe),
        ],
    );
    Ok(true)
}

/// Words and signs of an IDL text, without comments, preprocessor lines and annotations.
fn idl_tokens(text: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let mut chars = text.char_indices().peekable();
    while let Some((at, c)) = chars.next() {
        let rest = &text[at..];
        let skip_to = |chars: &mut std::iter::Peekable<std::str::CharIndices>, end: usize| {
            while chars.peek().is_some_and(|(i, _)| *i < end) {
                chars.next();
            }
        };
        if rest.starts_with("//")
            || c == '#'
            || rest.starts_with("====")
            || rest.starts_with("IDL:")
        {
            let end = rest.find('\n').unwrap_or(rest.len());
            skip_to(&mut chars, at + end);
        } else if rest.starts_with("/*") {
            let end = rest.find("*/").map_or(rest.len(), |i| i + 2);
            skip_to(&mut chars, at + end);
        } else if c == '"' || c == '\'' {
            let mut end = rest.len();
            let mut escaped = false;
            for (i, d) in rest.char_indices().skip(1) {
                if d == c && !escaped {
                    end = i + d.len_utf8();
                    break;
                }
                escaped = d == '\\' && !escaped;
            }
            skip_to(&mut chars, at + end);
            out.push("\"\"".to_owned());
        } else if c.is_alphanumeric() || c == '_' || c == '@' {
            let end = rest
                .find(|d: char| !(d.is_alphanumeric() || matches!(d, '_' | '.' | '@')))
                .unwrap_or(rest.len());
            skip_to(&mut chars, at + end);
            out.push(rest[..end].to_owned());
        } else if !c.is_whitespace() {
            out.push(c.to_string());
        }
    }
    // @name and @name(...) say nothing about the layout
    let mut plain = Vec::with_capacity(out.len());
    let mut i = 0;
    while i < out.len() {
        if !out[i].starts_with('@') {
            plain.push(std::mem::take(&mut out[i]));
            i += 1;
            continue;
        }
        i += 1;
        if out.get(i).is_some_and(|t| t == "(") {
            let mut depth = 0;
            while i < out.len() {
                depth += i32::from(out[i] == "(") - i32::from(out[i] == ")");
                i += 1;
                if depth == 0 {
                    break;
                }
            }
        }
    }
    plain
}

/// The definitions of a `ros2idl` schema.
fn parse_idl(text: &str) -> Result<Definitions, String> {
    let tokens = idl_tokens(text);
    let mut all = Definitions::new();
    let mut modules: Vec<String> = Vec::new();
    let mut aliases: HashMap<String, (Type, List)> = HashMap::new();
    let mut i = 0;
    let word = |i: usize| tokens.get(i).map_or("", String::as_str);
    // skips to behind the next `;` outside of braces
    let behind = |mut i: usize| {
        let mut depth = 0;
        while i < tokens.len() {
            depth += i32::from(word(i) == "{") - i32::from(word(i) == "}");
            i += 1;
            if depth == 0 && word(i - 1) == ";" {
                break;
            }
        }
        i
    };
    while i < tokens.len() {
        match word(i) {
            "module" => {
                modules.push(word(i + 1).to_owned());
                i += 3;
            }
            "typedef" => {
                let (of, list, next) = idl_type(&tokens, i + 1, &modules, &aliases)?;
                let name = word(next).to_owned();
                let (list, next) = idl_array(&tokens, next + 1, list)?;
                aliases.insert(name, (of, list));
                i = next + 1;
            }
            "enum" => {
                aliases.insert(
                    word(i + 1).to_owned(),
                    (Type::Number(Number::U32), List::One),
                );
                i = behind(i);
            }
            "const" => i = behind(i),
            "struct" => {
                let name = format!("{}/{}", modules.join("/"), word(i + 1));
                let mut fields = Vec::new();
                i += 2;
                if word(i) != "{" {
                    return Err(format!("struct {name} has no body"));
                }
                i += 1;
                while i < tokens.len() && word(i) != "}" {
                    let (of, list, next) = idl_type(&tokens, i, &modules, &aliases)?;
                    let field = word(next).to_owned();
                    let (list, next) = idl_array(&tokens, next + 1, list)?;
                    if word(next) != ";" {
                        return Err(format!("field {field} of {name} does not end with ;"));
                    }
                    fields.push(Field {
                        name: field,
                        of,
                        list,
                    });
                    i = next + 1;
                }
                all.insert(plain_name(&name), fields);
                i += 1;
            }
            "}" => {
                modules.pop();
                i += 1;
            }
            _ => i += 1,
        }
    }
    Ok(all)
}

/// A type that begins at a token, and the token behind it.
fn idl_type(
    tokens: &[String],
    mut i: usize,
    modules: &[String],
    aliases: &HashMap<String, (Type, List)>,
) -> Result<(Type, List, usize), String> {
    let word = |i: usize| tokens.get(i).map_or("", String::as_str);
    if word(i) == "sequence" {
        let (of, inner, next) = idl_type(tokens, i + 2, modules, aliases)?;
        if inner != List::One {
            return Err("a list of lists is not read".to_owned());
        }
        let mut next = next;
        while next < tokens.len() && word(next) != ">" {
            next += 1;
        }
        return Ok((of, List::Counted, next + 1));
    }
    let mut name = word(i).to_owned();
    i += 1;
    while matches!(name.as_str(), "unsigned" | "long" | "unsigned long")
        && matches!(word(i), "long" | "short" | "double")
    {
        name = format!("{name} {}", word(i));
        i += 1;
    }
    while word(i) == ":" && word(i + 1) == ":" {
        name = format!("{name}/{}", word(i + 2));
        i += 3;
    }
    if matches!(name.as_str(), "string" | "wstring") && word(i) == "<" {
        i += 3;
    }
    if let Some(of) = primitive(&name, false) {
        // char in IDL is a character; one byte all the same
        return Ok((of, List::One, i));
    }
    let last = name.rsplit('/').next().unwrap_or(&name);
    if let Some((of, list)) = aliases.get(last) {
        return Ok((of.clone(), *list, i));
    }
    let full = if name.contains('/') {
        plain_name(&name)
    } else {
        plain_name(&format!("{}/{name}", modules.join("/")))
    };
    Ok((Type::Message(full), List::One, i))
}

/// `[9]` behind a name.
fn idl_array(tokens: &[String], i: usize, list: List) -> Result<(List, usize), String> {
    let word = |i: usize| tokens.get(i).map_or("", String::as_str);
    if word(i) != "[" {
        return Ok((list, i));
    }
    let size = word(i + 1)
        .parse()
        .map_err(|_| format!("the length [{}] is no number", word(i + 1)))?;
    if list != List::One || word(i + 3) == "[" {
        return Err("a list of lists is not read".to_owned());
    }
    Ok((List::Fixed(size), i + 3))
}

/// How to go through a message.
#[derive(Debug)]
enum Node {
    /// A number and the leaf it fills.
    Number(Number, Option<usize>),
    /// A text; whether it is of the thing's name.
    Text(bool),
    WideText,
    /// Seconds and nanoseconds: the stamp of the row.
    Stamp {
        signed: bool,
    },
    /// Seconds and nanoseconds as a leaf in s.
    Seconds {
        signed: bool,
        leaf: Option<usize>,
    },
    Struct(Vec<Node>),
    /// Numbers, the first of which fill leaves.
    Numbers {
        of: Number,
        fixed: Option<usize>,
        first: usize,
        most: usize,
    },
    /// Things of a list: a table of their own, or passed over.
    Things {
        fixed: Option<usize>,
        element: Box<Node>,
        table: Option<usize>,
        key: Option<usize>,
    },
    /// A message that is there once or not at all.
    Maybe(Box<Node>),
}

/// A message type, ready to be read.
#[derive(Debug)]
pub(super) struct Layout {
    root: Node,
    aligned: bool,
}

struct Compiler<'a> {
    definitions: &'a Definitions,
    aligned: bool,
    /// Of what a service was asked and answered.
    event: bool,
    nodes: usize,
}

/// Steps into messages inside messages, at most.
const DEPTH: usize = 32;
/// Fields of one message with all that it holds, at most.
const MOST_NODES: usize = 20_000;

/// A field of a message, and where it is.
struct Place<'a> {
    field: &'a Field,
    /// Its path from the message of the topic, and from the thing whose table it is in.
    path: String,
    inside: String,
    unit: &'static str,
    /// The table that its numbers fill.
    at: Option<usize>,
    depth: usize,
}

impl Compiler<'_> {
    fn message(
        &mut self,
        name: &str,
        holder: &str,
        path: &str,
        at: Option<usize>,
        tables: &mut Tables,
        depth: usize,
    ) -> Result<Node, String> {
        self.nodes += 1;
        if depth > DEPTH || self.nodes > MOST_NODES {
            return Err("its definition is too deep or too long".to_owned());
        }
        let fields = match self.definitions.get(name) {
            Some(fields) => fields,
            None if is_time(name) => &Vec::new(),
            None => return Err(format!("{name} is not defined in the file")),
        };
        if fields.is_empty() && self.aligned && !is_time(name) {
            // a message without fields is one byte
            return Ok(Node::Number(Number::U8, None));
        }
        // a text that tells things apart: of this message, or of its header
        let list_path = at.map_or("", |t| tables.list[t].path.as_str()).to_owned();
        let inside = path.strip_prefix(&list_path).unwrap_or(path);
        let inside = inside.trim_start_matches('.').to_owned();
        let mut out = Vec::new();
        for field in fields {
            let place = Place {
                field,
                path: join(path, &field.name),
                inside: join(&inside, &field.name),
                unit: unit(name, holder, &field.name),
                at,
                depth,
            };
            out.push(self.field(&place, tables)?);
        }
        if is_time(name) {
            return Ok(self.time(false, &inside, at, tables));
        }
        Ok(Node::Struct(out))
    }

    /// A field of a message.
    fn field(&mut self, place: &Place, tables: &mut Tables) -> Result<Node, String> {
        let (of, list) = (&place.field.of, place.field.list);
        let (here, at) = (&place.inside, place.at);
        Ok(match (of, list) {
            (Type::Number(of), List::One) => {
                let leaf = at
                    .filter(|_| here != "header.seq")
                    .and_then(|t| tables.list[t].leaf(here.clone(), place.unit));
                Node::Number(*of, leaf)
            }
            (Type::Number(of), list) => self.numbers(*of, fixed(list), place, tables),
            (Type::Text, List::One) => {
                Node::Text(at.is_some_and(|t| tables.list[t].texts.contains(here)))
            }
            (Type::WideText, List::One) => Node::WideText,
            (Type::Time, List::One) => self.time(true, here, at, tables),
            (Type::Message(m), List::One) if is_time(m) => self.time(false, here, at, tables),
            (Type::Message(m), List::One) => self.inner(m, place, at, tables)?,
            (Type::Message(m), List::Maybe) => {
                Node::Maybe(Box::new(self.inner(m, place, at, tables)?))
            }
            (of, list) => self.things(of, list, place, tables)?,
        })
    }

    /// A message inside a message; its numbers fill the table `at`.
    fn inner(
        &mut self,
        message: &str,
        place: &Place,
        at: Option<usize>,
        tables: &mut Tables,
    ) -> Result<Node, String> {
        let (holder, path) = (&place.field.name, &place.path);
        self.message(message, holder, path, at, tables, place.depth + 1)
    }

    /// A list of numbers; a short one has leaves.
    fn numbers(
        &self,
        of: Number,
        fixed: Option<usize>,
        place: &Place,
        tables: &mut Tables,
    ) -> Node {
        let here = &place.inside;
        // who asked is a number of 16 bytes, and no measurement
        let at = place
            .at
            .filter(|_| !(self.event && here == "info.client_gid"));
        let most = fixed.unwrap_or(MAX_LIST).min(MAX_LIST);
        // long lists (covariances are not) are pictures and clouds
        let small = fixed.is_none_or(|n| n <= MAX_LIST);
        let mut first = 0;
        let mut count = 0;
        if let (Some(t), true) = (at, small) {
            first = tables.list[t].leaves.len();
            for i in 0..most {
                let leaf = tables.list[t].leaf(format!("{here}[{i}]"), "");
                count += usize::from(leaf.is_some());
            }
        }
        Node::Numbers {
            of,
            fixed,
            first,
            most: count,
        }
    }

    /// A list of anything else; messages of a message of the topic have a table of their own.
    fn things(
        &mut self,
        of: &Type,
        list: List,
        place: &Place,
        tables: &mut Tables,
    ) -> Result<Node, String> {
        let mut table = None;
        let mut key = None;
        let element = match of {
            Type::Message(m) => {
                if place.at == Some(0) && !is_time(m) {
                    let texts = self.texts(m, true);
                    tables.list.push(Table::of_list(place.path.clone(), texts));
                    table = Some(tables.list.len() - 1);
                }
                let node = self.inner(m, place, table, tables)?;
                key = table.and_then(|t| {
                    let leaves = &tables.list[t].leaves;
                    KEY_NUMBERS
                        .iter()
                        .find_map(|k| leaves.iter().position(|l| l.path == *k))
                });
                node
            }
            Type::Text => Node::Text(false),
            Type::WideText => Node::WideText,
            Type::Time => Node::Seconds {
                signed: true,
                leaf: None,
            },
            Type::Number(of) => Node::Number(*of, None),
        };
        Ok(Node::Things {
            fixed: fixed(list),
            element: Box::new(element),
            table,
            key,
        })
    }

    fn time(&self, ros1: bool, here: &str, at: Option<usize>, tables: &mut Tables) -> Node {
        // ROS 1 times are unsigned, ROS 2 seconds are signed; durations are signed in both
        let signed = !ros1;
        let stamp = matches!(here, "header.stamp" | "stamp" | "timestamp")
            || (self.event && here == "info.stamp");
        if stamp && at.is_some() {
            return Node::Stamp { signed };
        }
        Node::Seconds {
            signed,
            leaf: at.and_then(|t| tables.list[t].leaf(here.to_owned(), "s")),
        }
    }

    /// The texts that name a thing.
    fn texts(&self, message: &str, of_list: bool) -> Vec<String> {
        let none = Vec::new();
        let fields = self.definitions.get(message).unwrap_or(&none);
        let mut names: Vec<&str> = fields
            .iter()
            .filter(|f| f.of == Type::Text && f.list == List::One)
            .map(|f| f.name.as_str())
            .collect();
        let header = fields
            .iter()
            .any(|f| f.name == "header" && f.of == Type::Message("std_msgs/Header".to_owned()));
        if header {
            names.push("header.frame_id");
        }
        key_fields(&names, of_list)
            .into_iter()
            .map(str::to_owned)
            .collect()
    }
}

fn is_time(name: &str) -> bool {
    matches!(
        name,
        "builtin_interfaces/Time" | "builtin_interfaces/Duration"
    )
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() {
        name.to_owned()
    } else {
        format!("{path}.{name}")
    }
}

fn fixed(list: List) -> Option<usize> {
    match list {
        List::Fixed(n) => Some(n),
        _ => None,
    }
}

/// Why a message could not be read.
type Broken = &'static str;

const SHORT: Broken = "it ends early";

impl Layout {
    /// Of a schema; adds the leaves of the message to `tables`.
    ///
    /// # Errors
    /// What in the definition is not understood.
    pub fn new(
        schema: &str,
        encoding: &str,
        text: &str,
        tables: &mut Tables,
    ) -> Result<Self, String> {
        let ros1 = encoding == "ros1msg";
        let mut definitions = match encoding {
            "ros2idl" => parse_idl(text)?,
            _ => parse_msg(schema, text, ros1)?,
        };
        let name = plain_name(schema);
        let event = !ros1 && service_event(&name, &mut definitions)?;
        let mut compiler = Compiler {
            definitions: &definitions,
            aligned: !ros1,
            event,
            nodes: 0,
        };
        tables.list[0].texts = compiler.texts(&name, false);
        let root = compiler.message(&name, "", "", Some(0), tables, 0)?;
        Ok(Layout {
            root,
            aligned: !ros1,
        })
    }

    /// Reads a message into the tables.
    ///
    /// # Errors
    /// What keeps it from being read.
    pub fn read(&self, data: &[u8], log_s: f64, tables: &mut Tables) -> Result<(), Broken> {
        let mut cursor = Cursor {
            data,
            at: 0,
            big: false,
            align: 0,
            stamp_ns: 0,
        };
        if self.aligned {
            let head = data.get(..4).ok_or("it is shorter than its header")?;
            (cursor.big, cursor.align) = match (head[0], head[1]) {
                (0, 0) => (true, 8),
                (0, 1) => (false, 8),
                (0, 6) => (true, 4),
                (0, 7) => (false, 4),
                _ => return Err("its encapsulation is not plain CDR"),
            };
            cursor.data = &data[4..];
        }
        tables.list[0].clear();
        cursor.node(&self.root, Some(0), log_s, tables)?;
        let time_s = seconds(cursor.stamp_ns).unwrap_or(log_s);
        tables.push(0, time_s);
        Ok(())
    }
}

/// Seconds of a stamp; `None` where it is not set.
pub(super) fn seconds(stamp_ns: i64) -> Option<f64> {
    (stamp_ns != 0).then_some(stamp_ns as f64 * 1e-9)
}

struct Cursor<'a> {
    data: &'a [u8],
    at: usize,
    big: bool,
    /// The largest alignment; 0 where nothing is aligned.
    align: usize,
    stamp_ns: i64,
}

impl<'a> Cursor<'a> {
    #[inline]
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Broken> {
        if self.align > 0 {
            let to = N.min(self.align);
            self.at = self.at.next_multiple_of(to);
        }
        let mut out = [0; N];
        let end = self.at.checked_add(N).ok_or(SHORT)?;
        out.copy_from_slice(self.data.get(self.at..end).ok_or(SHORT)?);
        self.at = end;
        if self.big {
            out.reverse();
        }
        Ok(out)
    }

    #[inline]
    fn u32(&mut self) -> Result<u32, Broken> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }

    #[inline]
    fn number(&mut self, of: Number) -> Result<f64, Broken> {
        Ok(match of {
            Number::U8 => f64::from(self.bytes::<1>()?[0]),
            Number::I8 => f64::from(i8::from_le_bytes(self.bytes()?)),
            Number::U16 => f64::from(u16::from_le_bytes(self.bytes()?)),
            Number::I16 => f64::from(i16::from_le_bytes(self.bytes()?)),
            Number::U32 => f64::from(self.u32()?),
            Number::I32 => f64::from(i32::from_le_bytes(self.bytes()?)),
            Number::U64 => u64::from_le_bytes(self.bytes()?) as f64,
            Number::I64 => i64::from_le_bytes(self.bytes()?) as f64,
            Number::F32 => f64::from(f32::from_le_bytes(self.bytes()?)),
            Number::F64 => f64::from_le_bytes(self.bytes()?),
        })
    }

    fn skip(&mut self, bytes: usize) -> Result<(), Broken> {
        let end = self.at.checked_add(bytes).ok_or(SHORT)?;
        if end > self.data.len() {
            return Err(SHORT);
        }
        self.at = end;
        Ok(())
    }

    fn text(&mut self) -> Result<&'a [u8], Broken> {
        let length = self.u32()? as usize;
        let from = self.at;
        self.skip(length)?;
        let data: &'a [u8] = self.data;
        let text = &data[from..self.at];
        Ok(text.strip_suffix(b"\0").unwrap_or(text))
    }

    /// How many things a list has: never more than there are bytes.
    fn count(&mut self, fixed: Option<usize>, size: usize) -> Result<usize, Broken> {
        let count = match fixed {
            Some(n) => n,
            None => self.u32()? as usize,
        };
        if count.saturating_mul(size) > self.data.len() - self.at {
            return Err("a list in it is longer than the message");
        }
        Ok(count)
    }

    fn node(
        &mut self,
        node: &Node,
        table: Option<usize>,
        time_s: f64,
        tables: &mut Tables,
    ) -> Result<(), Broken> {
        match node {
            Node::Number(of, leaf) => {
                let value = self.number(*of)?;
                if let (Some(leaf), Some(t)) = (leaf, table) {
                    tables.list[t].set(*leaf, value);
                }
            }
            Node::Text(names) => {
                let text = self.text()?;
                if let (true, Some(t)) = (names, table) {
                    tables.list[t].name(text);
                }
            }
            Node::WideText => return Err("it has a wide text, whose width is not said"),
            Node::Stamp { signed } => {
                let ns = self.time(*signed)?;
                self.stamp_ns = ns;
            }
            Node::Seconds { signed, leaf } => {
                let ns = self.time(*signed)?;
                if let (Some(leaf), Some(t)) = (leaf, table) {
                    tables.list[t].set(*leaf, ns as f64 * 1e-9);
                }
            }
            Node::Struct(fields) => {
                for field in fields {
                    self.node(field, table, time_s, tables)?;
                }
            }
            Node::Maybe(once) => match self.u32()? {
                0 => {}
                1 => self.node(once, table, time_s, tables)?,
                _ => return Err("it has more than one request or response"),
            },
            Node::Numbers {
                of,
                fixed,
                first,
                most,
            } => {
                let count = self.count(*fixed, of.size())?;
                if count == 0 {
                    return Ok(());
                }
                let here = count.min(*most);
                for i in 0..here {
                    let value = self.number(*of)?;
                    if let Some(t) = table {
                        tables.list[t].set(first + i, value);
                    }
                }
                if here == 0 {
                    // what is passed over is aligned all the same
                    self.number(*of)?;
                    self.skip((count - 1) * of.size())?;
                } else {
                    self.skip((count - here) * of.size())?;
                }
            }
            Node::Things {
                fixed,
                element,
                table: own,
                key,
            } => {
                let count = self.count(*fixed, 1)?;
                let outer = self.stamp_ns;
                for i in 0..count {
                    let before = self.at;
                    self.stamp_ns = 0;
                    if let Some(t) = own {
                        tables.list[*t].clear();
                    }
                    self.node(element, *own, time_s, tables)?;
                    if let Some(t) = own {
                        let stamp = seconds(self.stamp_ns).or(seconds(outer)).unwrap_or(time_s);
                        tables.push_thing(*t, stamp, *key, i);
                    }
                    if self.at == before {
                        // things without a byte are no things
                        break;
                    }
                }
                self.stamp_ns = outer;
            }
        }
        Ok(())
    }

    fn time(&mut self, signed: bool) -> Result<i64, Broken> {
        let sec = if signed {
            i64::from(i32::from_le_bytes(self.bytes()?))
        } else {
            i64::from(self.u32()?)
        };
        let nanosec = i64::from(self.u32()?);
        Ok(sec * 1_000_000_000 + nanosec)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cdr(words: &[&[u8]]) -> Vec<u8> {
        let mut out = vec![0, 1, 0, 0];
        for w in words {
            while (out.len() - 4) % w.len().min(8) != 0 {
                out.push(0);
            }
            out.extend_from_slice(w);
        }
        out
    }

    fn last_row(tables: &Tables) -> Vec<f64> {
        tables.list[0].row.clone()
    }

    #[test]
    fn alignment_constants_defaults_and_both_byte_orders() {
        let text = "# a comment\nuint8 A=3\nstring S = a # b\nuint8 a 7\nfloat64 b\nint16[2] c\nfloat32[] d\nstring<=4 s \"x=y\"\nbool e\n";
        let mut tables = Tables::new();
        let layout = Layout::new("p/msg/M", "ros2msg", text, &mut tables).unwrap();
        let data = cdr(&[
            &[5],
            &1.5f64.to_le_bytes(),
            &[1, 0],
            &[0xff, 0xff],
            &2u32.to_le_bytes(),
            &2.5f32.to_le_bytes(),
            &(-1f32).to_le_bytes(),
            &2u32.to_le_bytes(),
            b"x",
            b"\0",
            &[1],
        ]);
        layout.read(&data, 1.0, &mut tables).unwrap();
        let row = last_row(&tables);
        assert_eq!(&row[..6], [5.0, 1.5, 1.0, -1.0, 2.5, -1.0]);
        assert!(row[6].is_nan());
        assert_eq!(row[row.len() - 1], 1.0);
        let big = [
            &[0u8, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0][..],
            &1.5f64.to_be_bytes(),
            &[0, 1, 0xff, 0xff],
            &0u32.to_be_bytes(),
            &1u32.to_be_bytes(),
            &[0, 1],
        ]
        .concat();
        layout.read(&big, 1.0, &mut tables).unwrap();
        assert_eq!(&last_row(&tables)[..4], [5.0, 1.5, 1.0, -1.0]);
        for cut in 0..data.len() {
            assert!(
                layout.read(&data[..cut], 1.0, &mut tables).is_err(),
                "{cut}"
            );
        }
    }

    #[test]
    fn idl_says_the_same_as_msg() {
        let msg = "std_msgs/Header header\nPose pose\n====\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n====\nMSG: p/Pose\nfloat64[3] xyz\nfloat32[] more\n";
        let idl = r#"
================
IDL: p/msg/M
// a comment
#include "x.idl"
module p { module msg {
  typedef double double__3[3];
  module M_Constants { const uint8 A = 3; };
  @verbatim (language="comment", text="a;b}")
  struct Pose { double__3 xyz; sequence<float> more; };
  struct M { std_msgs::msg::Header header; p::msg::Pose pose; };
}; };
================
IDL: std_msgs/msg/Header
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
"#;
        let mut a = Tables::new();
        let mut b = Tables::new();
        Layout::new("p/msg/M", "ros2msg", msg, &mut a).unwrap();
        Layout::new("p/msg/M", "ros2idl", idl, &mut b).unwrap();
        assert_eq!(a.list[0].leaves, b.list[0].leaves);
        assert_eq!(a.list[0].leaves[0].path, "pose.xyz[0]");
    }

    #[test]
    fn a_list_that_promises_more_than_there_is_costs_nothing() {
        let mut tables = Tables::new();
        let text = "Empty[] things\n====\nMSG: p/Empty\n";
        let layout = Layout::new("p/M", "ros1msg", text, &mut tables).unwrap();
        assert!(
            layout
                .read(&u32::MAX.to_le_bytes(), 0.0, &mut tables)
                .is_err()
        );
        assert!(Layout::new("p/M", "ros2msg", "M again", &mut tables).is_err());
        assert!(Layout::new("p/M", "ros2msg", "q/Missing x", &mut tables).is_err());
    }
}
