//! MCAP: the conformance files of the format and real recordings, which are not in this repository (the
//! folder that `DEACAL_SHARED` names holds them; without it those tests say that they are skipped), and files
//! made here, one for each quirk.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use deacal::recording::mcap::RecordReader;
use deacal::recording::{
    Capture, DoubtKind, Error, ErrorKind, ReadOptions, Recording, Section, Sink, importer_for,
    read_file, survey_file,
};
use deacal::report::survey::manifest;
use mcap::records::{MessageHeader, Record};
use mcap::{Compression, WriteOptions, Writer};
use serde_json::{Map, Value, json};

fn shared(folder: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("DEACAL_SHARED") else {
        eprintln!("skipped: DEACAL_SHARED is not set");
        return None;
    };
    let path = Path::new(&root).join(folder);
    path.is_dir().then_some(path)
}

fn files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, out);
        } else if path.extension().is_some_and(|e| e == "mcap") {
            out.push(path);
        }
    }
}

fn list(bytes: &[u8]) -> Value {
    bytes.iter().map(|b| Value::from(b.to_string())).collect()
}

fn counts<K: ToString, V: ToString>(map: &BTreeMap<K, V>) -> Value {
    map.iter()
        .map(|(k, v)| (k.to_string(), Value::from(v.to_string())))
        .collect::<Map<_, _>>()
        .into()
}

/// A record as the conformance suite prints it; `None` for those that it leaves out.
fn printed(record: &Record) -> Option<(&'static str, Value)> {
    let text = |v: &dyn ToString| Value::from(v.to_string());
    Some(match record {
        Record::Header(h) => (
            "Header",
            json!([["library", h.library], ["profile", h.profile]]),
        ),
        Record::Footer(f) => (
            "Footer",
            json!([
                ["summary_crc", text(&f.summary_crc)],
                ["summary_offset_start", text(&f.summary_offset_start)],
                ["summary_start", text(&f.summary_start)]
            ]),
        ),
        Record::Schema { header, data } => (
            "Schema",
            json!([
                ["data", list(data)],
                ["encoding", header.encoding],
                ["id", text(&header.id)],
                ["name", header.name]
            ]),
        ),
        Record::Channel(c) => (
            "Channel",
            json!([
                ["id", text(&c.id)],
                ["message_encoding", c.message_encoding],
                ["metadata", counts(&c.metadata)],
                ["schema_id", text(&c.schema_id)],
                ["topic", c.topic]
            ]),
        ),
        Record::Message { header, data } => (
            "Message",
            json!([
                ["channel_id", text(&header.channel_id)],
                ["data", list(data)],
                ["log_time", text(&header.log_time)],
                ["publish_time", text(&header.publish_time)],
                ["sequence", text(&header.sequence)]
            ]),
        ),
        Record::ChunkIndex(c) => (
            "ChunkIndex",
            json!([
                ["chunk_length", text(&c.chunk_length)],
                ["chunk_start_offset", text(&c.chunk_start_offset)],
                ["compressed_size", text(&c.compressed_size)],
                ["compression", c.compression],
                ["message_end_time", text(&c.message_end_time)],
                ["message_index_length", text(&c.message_index_length)],
                ["message_index_offsets", counts(&c.message_index_offsets)],
                ["message_start_time", text(&c.message_start_time)],
                ["uncompressed_size", text(&c.uncompressed_size)]
            ]),
        ),
        Record::Attachment { header, data, .. } => (
            "Attachment",
            json!([
                ["create_time", text(&header.create_time)],
                ["data", list(data)],
                ["log_time", text(&header.log_time)],
                ["media_type", header.media_type],
                ["name", header.name]
            ]),
        ),
        Record::AttachmentIndex(a) => (
            "AttachmentIndex",
            json!([
                ["create_time", text(&a.create_time)],
                ["data_size", text(&a.data_size)],
                ["length", text(&a.length)],
                ["log_time", text(&a.log_time)],
                ["media_type", a.media_type],
                ["name", a.name],
                ["offset", text(&a.offset)]
            ]),
        ),
        Record::Statistics(s) => (
            "Statistics",
            json!([
                ["attachment_count", text(&s.attachment_count)],
                ["channel_count", text(&s.channel_count)],
                ["channel_message_counts", counts(&s.channel_message_counts)],
                ["chunk_count", text(&s.chunk_count)],
                ["message_count", text(&s.message_count)],
                ["message_end_time", text(&s.message_end_time)],
                ["message_start_time", text(&s.message_start_time)],
                ["metadata_count", text(&s.metadata_count)],
                ["schema_count", text(&s.schema_count)]
            ]),
        ),
        Record::Metadata(m) => (
            "Metadata",
            json!([["metadata", counts(&m.metadata)], ["name", m.name]]),
        ),
        Record::MetadataIndex(m) => (
            "MetadataIndex",
            json!([
                ["length", text(&m.length)],
                ["name", m.name],
                ["offset", text(&m.offset)]
            ]),
        ),
        Record::SummaryOffset(s) => (
            "SummaryOffset",
            json!([
                ["group_length", text(&s.group_length)],
                ["group_opcode", text(&s.group_opcode)],
                ["group_start", text(&s.group_start)]
            ]),
        ),
        Record::DataEnd(d) => (
            "DataEnd",
            json!([["data_section_crc", text(&d.data_section_crc)]]),
        ),
        _ => return None,
    })
}

/// Fields of an expected record: bytes are a list of texts, attachments also have a checksum that the library
/// leaves out.
fn expected_fields(record: &Value) -> Value {
    record["fields"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|f| !(record["type"] == "Attachment" && f[0] == "crc"))
        .cloned()
        .collect()
}

#[test]
fn every_conformance_file_gives_its_records() {
    let Some(folder) = shared("datasets/formats/mcap_conformance") else {
        return;
    };
    let mut all = Vec::new();
    files(&folder, &mut all);
    assert!(all.len() >= 100, "{}", all.len());
    let mut records = 0;
    for path in &all {
        let expected: Value =
            serde_json::from_str(&std::fs::read_to_string(path.with_extension("json")).unwrap())
                .unwrap();
        let wanted = expected["records"].as_array().unwrap();
        let mut reader = RecordReader::open(path).unwrap();
        let mut found = Vec::new();
        while let Some(r) = reader.advance().unwrap() {
            if let Some(p) = printed(&mcap::parse_record(r.opcode, r.body).unwrap()) {
                found.push(p);
            }
        }
        assert_eq!(reader.cut(), None, "{}", path.display());
        assert_eq!(found.len(), wanted.len(), "{}", path.display());
        for ((kind, fields), wanted) in found.iter().zip(wanted) {
            assert_eq!(
                *kind,
                wanted["type"].as_str().unwrap(),
                "{}",
                path.display()
            );
            assert_eq!(*fields, expected_fields(wanted), "{}", path.display());
            records += 1;
        }
        // its messages are in encoding "a": an answer in words, or nothing to import
        let e = read_file(path).unwrap_err().to_string();
        let said = ["messages in \"a\"", "there is nothing to import"];
        assert!(said.iter().any(|s| e.contains(s)), "{e}");
    }
    eprintln!("{} files, {records} records", all.len());
}

/// Every number in a decoded message: path and value; what is in lists of things, by list.
type Things = Vec<(String, Vec<(String, f64)>)>;

fn numbers(value: &Value, path: &str, out: &mut Vec<(String, f64)>, things: &mut Things) {
    let number = match value {
        Value::Number(n) => n.as_f64(),
        Value::Bool(b) => Some(f64::from(u8::from(*b))),
        Value::Null => Some(f64::NAN),
        _ => None,
    };
    if let Some(number) = number {
        out.push((path.to_owned(), number));
    }
    let join = |k: &str| {
        if path.is_empty() {
            k.to_owned()
        } else {
            format!("{path}.{k}")
        }
    };
    match value {
        Value::Object(map) if !path.ends_with("stamp") => {
            for (k, v) in map {
                numbers(v, &join(k), out, things);
            }
        }
        Value::Array(list) if list.len() <= 64 => {
            for (i, v) in list.iter().enumerate() {
                if v.is_object() {
                    let mut own = Vec::new();
                    numbers(v, "", &mut own, &mut Vec::new());
                    things.push((path.to_owned(), own));
                } else {
                    numbers(v, &format!("{path}[{i}]"), out, things);
                }
            }
        }
        _ => {}
    }
}

/// Whether a row of a section holds these numbers.
fn holds(section: &Section, row: usize, wanted: &[(String, f64)]) -> bool {
    wanted.iter().all(|(path, value)| {
        let (parent, axis) = path.rsplit_once('.').unwrap_or(("", path));
        let short: Vec<&str> = parent
            .split('.')
            .filter(|p| {
                !matches!(
                    *p,
                    "" | "pose" | "position" | "transform" | "translation" | "point" | "data"
                )
            })
            .collect();
        // a place of a list that is a gap throughout is no column
        let gap = value.is_nan() && path.ends_with(']');
        gap || section.columns.iter().any(|c| {
            let group = c.group.rsplit('/').next().unwrap_or("");
            let there = short.is_empty() || group == short.join(".") || group == parent;
            let v = c.values[row];
            c.axis == axis && there && (v == *value || (v.is_nan() && value.is_nan()))
        })
    })
}

fn record_counts(path: &Path) -> BTreeMap<u16, (u64, u64, u64)> {
    let mut out: BTreeMap<u16, (u64, u64, u64)> = BTreeMap::new();
    let mut reader = RecordReader::open(path).unwrap();
    while let Some(r) = reader.advance().unwrap() {
        if let Record::Message { header, .. } = mcap::parse_record(r.opcode, r.body).unwrap() {
            let c = out.entry(header.channel_id).or_insert((0, u64::MAX, 0));
            *c = (c.0 + 1, c.1.min(header.log_time), c.2.max(header.log_time));
        }
    }
    out
}

#[test]
fn every_real_recording_reads_as_other_readers_read_it() {
    let Some(folder) = shared("datasets/formats/mcap") else {
        return;
    };
    let mut all = Vec::new();
    files(&folder, &mut all);
    let mut compared = 0;
    for path in &all {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let text = std::fs::read_to_string(format!("{}.expect.json", path.display())).unwrap();
        let expected: Value = serde_json::from_str(&text.replace("NaN", "null")).unwrap();
        let broken = match name.as_str() {
            "chunk_not_closed.mcap" => Some("cut before its first message"),
            "crlf_mangled_keelson.mcap" => Some("line ends were converted"),
            "rosbag2_wrong_rmw.mcap" => Some("\"wrong_format\""),
            "empty_keelson.mcap" => Some("there is nothing to import (0 messages"),
            "protobuf_keelson_649ch.mcap" => Some("649 topics hold no number"),
            "ros2_cougars_rosout_only.mcap" => Some("log messages are no measurement"),
            "zstd_chunk_with_padding.mcap" => Some("12 messages are of channels"),
            _ => None,
        };
        if let Some(reason) = broken {
            let e = read_file(path).unwrap_err();
            assert!(e.to_string().contains(reason), "{e}");
            continue;
        }
        assert_eq!(expected["stream_error"], Value::Null, "{name}");
        let found = record_counts(path);
        assert_eq!(
            found.values().map(|c| c.0).sum::<u64>(),
            expected["messages"].as_u64().unwrap(),
            "{name}"
        );
        let capture = read_file(path).unwrap();
        let survey = survey_file(path, None, &ReadOptions::default()).unwrap();
        assert_eq!(capture.sections.len(), survey.sections.len(), "{name}");
        for (kept, counted) in capture.sections.iter().zip(&survey.sections) {
            assert_eq!(kept.rows(), counted.rows, "{name} {}", kept.name);
            assert_eq!(
                kept.groups.len(),
                counted.groups.len(),
                "{name} {}",
                kept.name
            );
        }
        for c in expected["channels"].as_array().unwrap() {
            let id = u16::try_from(c["id"].as_u64().unwrap()).unwrap();
            let topic = c["topic"].as_str().unwrap();
            let what = format!("{name} {topic}");
            let (count, first, last) = found.get(&id).copied().unwrap_or((0, 0, 0));
            assert_eq!(count, c["count"].as_u64().unwrap(), "{what}");
            if count == 0 {
                continue;
            }
            assert_eq!(first, c["log_time_min_ns"].as_u64().unwrap(), "{what}");
            assert_eq!(last, c["log_time_max_ns"].as_u64().unwrap(), "{what}");
            let section = capture.sections.iter().find(|s| s.name == topic);
            if let Some(s) = section {
                assert_eq!(s.rows() as u64, count, "{what}");
                let times = s.stamps_s.as_ref().unwrap();
                assert!(times.windows(2).all(|w| w[0] <= w[1]), "{what}");
            }
            for (key, at_end) in [("first_decoded", false), ("last_decoded", true)] {
                if c[key].is_null() {
                    continue;
                }
                let mut wanted = Vec::new();
                let mut things = Vec::new();
                numbers(&c[key], "", &mut wanted, &mut things);
                wanted.retain(|(p, _)| !p.starts_with("header.") && !p.starts_with("stamp."));
                if !wanted.is_empty() {
                    let s = section.unwrap_or_else(|| panic!("{what} is missing"));
                    let sorted = c["out_of_order"].as_u64() == Some(0);
                    let row = if at_end { s.rows() - 1 } else { 0 };
                    let there = if sorted {
                        holds(s, row, &wanted)
                    } else {
                        (0..s.rows()).any(|row| holds(s, row, &wanted))
                    };
                    assert!(there, "{what} {key} {wanted:?}");
                    compared += wanted.len();
                }
                for (list, own) in &things {
                    let start = format!("{topic} {list} ");
                    let there = capture
                        .sections
                        .iter()
                        .filter(|s| s.name.starts_with(&start))
                        .any(|s| (0..s.rows()).any(|row| holds(s, row, own)));
                    assert!(there || own.is_empty(), "{what} {key} {list} {own:?}");
                    compared += own.len();
                }
            }
        }
        let none = Vec::new();
        for cut in expected["truncation"].as_array().unwrap_or(&none) {
            let keep = usize::try_from(cut["keep_bytes"].as_u64().unwrap()).unwrap();
            let least = cut["messages_in_complete_chunks"].as_u64().unwrap();
            let bytes = std::fs::read(path).unwrap();
            let mut file = tempfile::NamedTempFile::new().unwrap();
            file.write_all(&bytes[..keep]).unwrap();
            let found: u64 = record_counts(file.path()).values().map(|c| c.0).sum();
            assert!(found >= least, "{name} cut to {keep}: {found}, {least}");
            assert!(found > 0);
            let capture = read_file(file.path()).unwrap();
            let said = capture
                .notes
                .iter()
                .any(|n| n.text.contains("the file was cut"));
            assert!(said, "{name}");
        }
    }
    assert!(compared > 500, "{compared}");
    eprintln!("{} files, {compared} numbers", all.len());
}

// Files made here.

const POSE: &str = "std_msgs/Header header\ngeometry_msgs/Pose pose\n================================================================================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n================================================================================\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n================================================================================\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n================================================================================\nMSG: geometry_msgs/Quaternion\nfloat64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n";

/// A PoseStamped in CDR of either byte order.
fn pose(big: bool, stamp: (i32, u32), p: [f64; 3]) -> Vec<u8> {
    let mut out = vec![0, u8::from(!big), 0, 0];
    let int = |v: u32| {
        if big {
            v.to_be_bytes()
        } else {
            v.to_le_bytes()
        }
    };
    let real = |v: f64| {
        if big {
            v.to_be_bytes()
        } else {
            v.to_le_bytes()
        }
    };
    out.extend(int(stamp.0 as u32));
    out.extend(int(stamp.1));
    out.extend(int(6));
    out.extend(b"world\0");
    while (out.len() - 4) % 8 != 0 {
        out.push(0);
    }
    for v in p.into_iter().chain([0.0, 0.0, 0.0, 1.0]) {
        out.extend(real(v));
    }
    out
}

struct Made<'a> {
    schema: (&'a str, &'a str, &'a [u8]),
    encoding: &'a str,
    messages: Vec<(u64, Vec<u8>)>,
}

fn write(options: WriteOptions, channels: &[Made]) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let mut writer: Writer<_> = options.create(&mut out).unwrap();
    for (i, c) in channels.iter().enumerate() {
        let (name, encoding, data) = c.schema;
        let schema = writer.add_schema(name, encoding, data).unwrap();
        let topic = format!("/topic{i}");
        let id = writer
            .add_channel(schema, &topic, c.encoding, &BTreeMap::new())
            .unwrap();
        for (sequence, (log_time, data)) in c.messages.iter().enumerate() {
            let header = MessageHeader {
                channel_id: id,
                sequence: u32::try_from(sequence).unwrap(),
                log_time: *log_time,
                publish_time: *log_time,
            };
            writer.write_to_known_channel(&header, data).unwrap();
        }
    }
    writer.finish().unwrap();
    drop(writer);
    out.into_inner()
}

fn read(bytes: &[u8]) -> Result<Capture, Error> {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let kept = read_file(file.path());
    let counted = survey_file(file.path(), None, &ReadOptions::default());
    assert_eq!(kept.is_ok(), counted.is_ok());
    kept
}

fn poses(count: u32, big: bool) -> Made<'static> {
    Made {
        schema: ("geometry_msgs/msg/PoseStamped", "ros2msg", POSE.as_bytes()),
        encoding: "cdr",
        messages: (0..count)
            .map(|i| {
                let p = [f64::from(i), 0.5, -1.25e-3 * f64::from(i)];
                (
                    u64::from(i) * 10_000_000 + 5,
                    pose(big, (7 + (i / 100) as i32, i % 100 * 10_000_000), p),
                )
            })
            .collect(),
    }
}

#[test]
fn chunks_of_every_compression_and_none() {
    let options: [(&str, WriteOptions); 5] = [
        (
            "zstd",
            WriteOptions::new().compression(Some(Compression::Zstd)),
        ),
        (
            "lz4",
            WriteOptions::new().compression(Some(Compression::Lz4)),
        ),
        ("plain", WriteOptions::new().compression(None)),
        ("no chunks", WriteOptions::new().use_chunks(false)),
        (
            "small chunks",
            WriteOptions::new()
                .compression(Some(Compression::Lz4))
                .chunk_size(Some(500)),
        ),
    ];
    for (what, options) in options {
        for big in [false, true] {
            let capture = read(&write(options.clone(), &[poses(1000, big)])).unwrap();
            let s = &capture.sections[0];
            assert_eq!((s.name.as_str(), s.rows()), ("/topic0", 1000), "{what}");
            let names: Vec<&str> = s.groups.iter().map(|g| g.name.as_str()).collect();
            assert_eq!(names, ["/topic0", "/topic0/orientation"]);
            let x = s.column("/topic0", "x").unwrap();
            assert_eq!((x.unit.as_str(), x.values[999]), ("m", 999.0), "{what}");
            assert_eq!(s.column("/topic0", "z").unwrap().values[8], -0.01);
            assert_eq!(s.column("/topic0/orientation", "w").unwrap().values[3], 1.0);
            let t = s.stamps_s.as_ref().unwrap();
            assert!((t[100] - 8.0).abs() < 1e-9, "{what} {}", t[100]);
        }
    }
}

#[test]
fn a_file_cut_anywhere_gives_what_stands_before() {
    for options in [
        WriteOptions::new().compression(None).chunk_size(Some(2000)),
        WriteOptions::new()
            .compression(Some(Compression::Zstd))
            .chunk_size(Some(2000)),
        WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(2000)),
        WriteOptions::new().use_chunks(false),
    ] {
        let whole = write(options, &[poses(25, false)]);
        let mut before = 0;
        for length in 0..whole.len() {
            let rows = match read(&whole[..length]) {
                Ok(c) => {
                    assert!(
                        c.notes.iter().any(|n| n.text.contains("was cut")),
                        "{length}"
                    );
                    c.sections[0].rows()
                }
                Err(e) => {
                    assert!(
                        matches!(
                            e.kind(),
                            ErrorKind::NoData | ErrorKind::Empty | ErrorKind::UnknownFormat
                        ) || length < 20,
                        "{length} {e}"
                    );
                    0
                }
            };
            assert!(rows >= before, "{length}: {rows} after {before}");
            before = rows;
        }
        assert_eq!(before, 25);
    }
}

#[test]
fn damage_is_said_and_lengths_are_not_believed() {
    let whole = write(WriteOptions::new().compression(None), &[poses(60, false)]);
    // a byte of a message: the checksum of its chunk is wrong
    let mut bytes = whole.clone();
    let middle = bytes.len() / 3;
    bytes[middle] ^= 0xff;
    let e = read(&bytes).unwrap_err();
    assert!(e.to_string().contains("damaged"), "{e}");
    // every length field as large as can be, one after the other
    for at in 8..whole.len().min(3000) {
        let mut bytes = whole.clone();
        let end = (at + 8).min(bytes.len());
        bytes[at..end].fill(0xff);
        let _ = read(&bytes);
    }
}

#[test]
fn rows_are_in_the_order_of_time() {
    let mut made = poses(5, false);
    for m in &mut made.messages {
        // no stamp: the log time counts
        m.1[4..12].fill(0);
    }
    made.messages.swap(1, 3);
    let capture = read(&write(WriteOptions::new(), &[made])).unwrap();
    let s = &capture.sections[0];
    let x = &s.column("/topic0", "x").unwrap().values;
    assert_eq!(x[..], [0.0, 1.0, 2.0, 3.0, 4.0]);
    assert!((s.stamps_s.as_ref().unwrap()[1] - 0.010_000_005).abs() < 1e-12);
    assert!(capture.notes.iter().any(|n| n.text.contains("sorted")));
}

/// What a service was asked (`Some` of two numbers) or answered, as ROS 2 records it.
fn service_event(
    kind: u8,
    stamp: (i32, u32),
    asked: Option<[f64; 2]>,
    told: Option<f64>,
) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0, kind];
    let align = |out: &mut Vec<u8>, to: usize| {
        while !(out.len() - 4).is_multiple_of(to) {
            out.push(0);
        }
    };
    align(&mut out, 4);
    out.extend(stamp.0.to_le_bytes());
    out.extend(stamp.1.to_le_bytes());
    out.extend([0xfe; 16]);
    align(&mut out, 8);
    out.extend(41i64.to_le_bytes());
    for values in [asked.map(|v| v.to_vec()), told.map(|v| vec![v])] {
        align(&mut out, 4);
        out.extend(u32::from(values.is_some()).to_le_bytes());
        for v in values.into_iter().flatten() {
            align(&mut out, 8);
            out.extend(v.to_le_bytes());
        }
    }
    out
}

/// Beside the events of a service stands the text of the .srv, which is not what the messages hold.
#[test]
fn service_events_are_no_requests() {
    let bare = "float64 a\nfloat64 b\n---\nfloat64 sum\n";
    let headed = format!("{}\nSRV: p/srv/Add\n{bare}", "=".repeat(80));
    let whole = "service_msgs/msg/ServiceEventInfo info\np/srv/Add_Request[<=1] request\np/srv/Add_Response[<=1] response\n\
         ====\nMSG: service_msgs/msg/ServiceEventInfo\nuint8 REQUEST_SENT=0\nuint8 event_type\nbuiltin_interfaces/Time stamp\n\
         char[16] client_gid\nint64 sequence_number\n====\nMSG: p/srv/Add_Request\nfloat64 a\nfloat64 b\n\
         ====\nMSG: p/srv/Add_Response\nfloat64 sum\n";
    let idl = "====\nIDL: p/srv/Add\nmodule p { module srv { struct Add_Request { double a; double b; }; \
         struct Add_Response { double sum; }; }; };\n";
    let messages = || {
        vec![
            (
                1,
                service_event(1, (7, 500_000_000), Some([2.0, 3.5]), None),
            ),
            (2, service_event(2, (8, 0), None, Some(5.5))),
        ]
    };
    for (name, encoding, text) in [
        ("p/srv/Add_Event", "ros2msg", bare),
        ("p/srv/Add_Event", "ros2msg", headed.as_str()),
        ("p/srv/Add_Event", "ros2msg", whole),
        ("p/srv/Add", "ros2msg", bare),
        ("p/srv/Add_Event", "ros2idl", idl),
    ] {
        let made = Made {
            schema: (name, encoding, text.as_bytes()),
            encoding: "cdr",
            messages: messages(),
        };
        let capture = read(&write(WriteOptions::new(), &[made])).unwrap();
        let section = &capture.sections[0];
        let times = section.stamps_s.as_deref().unwrap();
        assert!(
            (times[0] - 7.5).abs() < 1e-12 && times[1] == 8.0,
            "{text}: {times:?}"
        );
        let titles: Vec<(String, Vec<f64>)> = section
            .columns
            .iter()
            .map(|c| {
                (
                    c.title(),
                    c.values
                        .iter()
                        .map(|v| if v.is_nan() { -1.0 } else { *v })
                        .collect(),
                )
            })
            .collect();
        let wanted = [
            ("/topic0/info/event_type", [1.0, 2.0]),
            ("/topic0/info/sequence_number", [41.0, 41.0]),
            ("/topic0/request/a", [2.0, -1.0]),
            ("/topic0/request/b", [3.5, -1.0]),
            ("/topic0/response/sum", [-1.0, 5.5]),
        ]
        .map(|(title, values)| (title.to_owned(), values.to_vec()));
        assert_eq!(titles, wanted, "{text}");
    }
    // of what service is not said: refused by name, not read as something else
    for text in ["", "int32 x\n", "int32 a\n---\nint32 b\n---\nint32 c\n"] {
        let made = Made {
            schema: ("p/srv/Add_Event", "ros2msg", text.as_bytes()),
            encoding: "cdr",
            messages: messages(),
        };
        let error = read(&write(WriteOptions::new(), &[made]))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("/topic0") && error.contains("service") || error.contains("action's"),
            "{error}"
        );
    }
}

/// Of topics the one that moves farthest is the effector; a single message shows no motion, and the stamps
/// are the clock.
#[test]
fn a_start_from_topics() {
    let moving = |count: u32, step: f64| {
        let mut made = poses(count, false);
        for (i, m) in made.messages.iter_mut().enumerate() {
            let p = [step * i as f64, 0.5, 0.0];
            m.1 = pose(
                false,
                (7 + (i / 100) as i32, (i % 100) as u32 * 10_000_000),
                p,
            );
        }
        made
    };
    let bytes = write(
        WriteOptions::new(),
        &[moving(1, 1.0), moving(50, 1e-9), moving(50, 1e-3)],
    );
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.mcap");
    std::fs::write(&path, bytes).unwrap();
    let survey = survey_file(&path, None, &ReadOptions::default()).unwrap();
    let text = manifest("run", &[("run.mcap".to_owned(), &survey)]);
    assert!(text.contains("end_effector = \"/topic2\""), "{text}");
    assert!(text.contains("base = \"/topic1\""), "{text}");
    assert!(
        text.contains("# the times are the file's own, 100 Hz"),
        "{text}"
    );
    assert!(!text.contains("rate_hz"), "{text}");
    std::fs::copy(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/recording/robot/rig.toml"),
        dir.path().join("rig.toml"),
    )
    .unwrap();
    std::fs::write(
        dir.path().join("v.csv"),
        "t_s,a (V),b (V),c (V)\n7,500,0,0\n8,500,1,1\n",
    )
    .unwrap();
    let voltage = "[voltage]\nfile = \"v.csv\"\ntime = \"t_s\"\nchannels = [\"a (V)\", \"b (V)\", \"c (V)\"]\n";
    std::fs::write(dir.path().join("recording.toml"), text + voltage).unwrap();
    let motion = Recording::open(dir.path()).unwrap().motion.unwrap();
    assert!((motion.time_s[1] - 7.01).abs() < 1e-9 && motion.time_s.len() == 50);
    // a single message of each: no motion
    let bytes = write(WriteOptions::new(), &[moving(1, 1.0), moving(1, 2.0)]);
    std::fs::write(&path, bytes).unwrap();
    let survey = survey_file(&path, None, &ReadOptions::default()).unwrap();
    let text = manifest("run", &[("run.mcap".to_owned(), &survey)]);
    assert!(
        text.contains("# ? no marker was seen in more than one row"),
        "{text}"
    );
    assert!(!text.contains("\n[motion]"), "{text}");
}

/// What the recorder counted and what is there are held against each other.
#[test]
fn messages_that_were_counted_and_are_missing_are_said() {
    let mut bytes = write(WriteOptions::new(), &[poses(7, false)]);
    let said = |bytes: &[u8]| {
        let notes = read(bytes).unwrap().notes;
        notes
            .iter()
            .any(|n| n.text.contains("counted 9 messages, 7 are there"))
    };
    assert!(!said(&bytes));
    // opcode, length 46 + 10 for one channel's count, then the number of messages
    let mark = [&[0x0b][..], &56u64.to_le_bytes(), &7u64.to_le_bytes()].concat();
    let at = bytes.windows(mark.len()).position(|w| w == mark).unwrap();
    bytes[at + 9] = 9;
    assert!(said(&bytes));
}

/// Several clocks of one file are each called by their topic.
#[test]
fn a_clock_is_said_to_be_whose_it_is() {
    let mut again = poses(30, false);
    for m in &mut again.messages {
        m.1[4..12].copy_from_slice(&[7, 0, 0, 0, 0, 0, 0, 0]);
    }
    let made = [
        Made {
            messages: again.messages.clone(),
            ..poses(0, false)
        },
        again,
    ];
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(&write(WriteOptions::new(), &made)).unwrap();
    let survey = survey_file(file.path(), None, &ReadOptions::default()).unwrap();
    let clocks: Vec<&str> = survey
        .doubts
        .iter()
        .filter(|d| d.kind == DoubtKind::Clock)
        .map(|d| d.says.as_str())
        .collect();
    assert_eq!(clocks.len(), 2, "{clocks:?}");
    assert!(
        clocks[0].starts_with("/topic0: time does not rise"),
        "{clocks:?}"
    );
    assert!(
        clocks[1].starts_with("/topic1: time does not rise"),
        "{clocks:?}"
    );
}

/// A file without a number is refused whatever it lacks, as every other format does.
#[test]
fn a_file_with_nothing_to_import_is_an_error() {
    let log = "builtin_interfaces/Time stamp\nstring msg\n";
    let none = Made {
        messages: Vec::new(),
        ..poses(0, false)
    };
    let logs = Made {
        schema: ("rcl_interfaces/msg/Log", "ros2msg", log.as_bytes()),
        encoding: "cdr",
        messages: vec![(1, vec![0, 1, 0, 0])],
    };
    let texts = Made {
        schema: ("std_msgs/msg/String", "ros2msg", b"string data\n"),
        encoding: "cdr",
        messages: vec![(1, [&[0, 1, 0, 0, 2, 0, 0, 0][..], b"x\0"].concat())],
    };
    for (channels, why) in [
        (vec![], "0 messages"),
        (vec![none], "1 topics without a message: /topic0"),
        (vec![logs], "log messages are no measurement"),
        (vec![texts], "1 topics hold no number: /topic0"),
    ] {
        let error = read(&write(WriteOptions::new(), &channels)).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NoData, "{error}");
        let text = error.to_string();
        assert!(
            text.contains("there is nothing to import") && text.contains(why),
            "{text}"
        );
    }
}

#[test]
fn transforms_are_a_series_each() {
    let text = format!(
        "geometry_msgs/TransformStamped[] transforms\n====\nMSG: geometry_msgs/TransformStamped\nHeader header\nstring child_frame_id\nTransform transform\n====\nMSG: geometry_msgs/Transform\nVector3 translation\nQuaternion rotation\n====\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n====\n{}",
        POSE.split_once("MSG: std_msgs")
            .map(|(_, s)| format!("MSG: std_msgs{s}"))
            .unwrap()
    );
    // ROS 1: no alignment, a sequence number in the header
    let text1 = text.replace("builtin_interfaces/Time stamp", "uint32 seq\ntime stamp");
    let message = |children: &[&str], x: f64| {
        let mut out = Vec::new();
        out.extend((children.len() as u32).to_le_bytes());
        for c in children {
            out.extend(9u32.to_le_bytes());
            out.extend(12u32.to_le_bytes());
            out.extend(500_000_000u32.to_le_bytes());
            out.extend(5u32.to_le_bytes());
            out.extend(b"world");
            out.extend((c.len() as u32).to_le_bytes());
            out.extend(c.bytes());
            for v in [x, 1.0, 2.0, 0.0, 0.0, 0.0, 1.0] {
                out.extend(v.to_le_bytes());
            }
        }
        out
    };
    let made = Made {
        schema: ("tf2_msgs/TFMessage", "ros1msg", text1.as_bytes()),
        encoding: "ros1",
        messages: vec![
            (1, message(&["ee", "base"], 3.0)),
            (2, message(&["ee"], f64::NAN)),
        ],
    };
    let capture = read(&write(WriteOptions::new(), &[made])).unwrap();
    let names: Vec<&str> = capture.sections.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "/topic0 transforms world:ee",
            "/topic0 transforms world:base"
        ]
    );
    let ee = &capture.sections[0];
    let x = ee.column("world:ee", "x").unwrap();
    assert_eq!((x.unit.as_str(), x.values[0]), ("m", 3.0));
    assert!(x.values[1].is_nan());
    assert_eq!(ee.stamps_s.as_ref().unwrap()[0], 12.5);
    assert_eq!(ee.gaps(ee.groups[0].columns.clone()).missing, 1);
}

/// A field of a protobuf message.
fn field(number: u8, bytes: &[u8]) -> Vec<u8> {
    let mut out = vec![number << 3 | 2, u8::try_from(bytes.len()).unwrap()];
    out.extend(bytes);
    out
}

fn number_field(number: u8, value: u8) -> Vec<u8> {
    vec![number << 3, value]
}

/// A FieldDescriptorProto.
fn descriptor(name: &str, number: u8, label: u8, kind: u8, of: &str) -> Vec<u8> {
    let mut f = field(1, name.as_bytes());
    f.extend(number_field(3, number));
    f.extend(number_field(4, label));
    f.extend(number_field(5, kind));
    if !of.is_empty() {
        f.extend(field(6, of.as_bytes()));
    }
    field(2, &f)
}

#[test]
fn protobuf_by_its_descriptors() {
    let mut stamp = field(1, b"Timestamp");
    stamp.extend(descriptor("seconds", 1, 1, 3, ""));
    stamp.extend(descriptor("nanos", 2, 1, 5, ""));
    let mut vector = field(1, b"Vector3");
    for (i, axis) in ["x", "y", "z"].iter().enumerate() {
        vector.extend(descriptor(axis, i as u8 + 1, 1, 1, ""));
    }
    let mut message = field(1, b"Sample");
    message.extend(descriptor(
        "timestamp",
        1,
        1,
        11,
        ".google.protobuf.Timestamp",
    ));
    message.extend(descriptor("position", 2, 1, 11, ".foxglove.Vector3"));
    message.extend(descriptor("volts", 3, 3, 2, ""));
    message.extend(descriptor("count", 4, 1, 17, ""));
    let mut google = field(2, b"google.protobuf");
    google.extend(field(4, &stamp));
    google.extend(field(12, b"proto3"));
    let mut own = field(2, b"foxglove");
    own.extend(field(4, &vector));
    own.extend(field(4, &message));
    own.extend(field(12, b"proto3"));
    // the descriptor is longer than one length byte holds
    let mut set = Vec::new();
    for file in [google, own] {
        set.push(1 << 3 | 2);
        set.push(u8::try_from(file.len() & 0x7f).unwrap() | 0x80);
        set.push(u8::try_from(file.len() >> 7).unwrap());
        set.extend(file);
    }
    let mut at = field(1, &[8, 3, 16, 5]);
    let mut position = vec![9];
    position.extend(1.5f64.to_le_bytes());
    position.push(25);
    position.extend((-2.0f64).to_le_bytes());
    at.extend(field(2, &position));
    let packed: Vec<u8> = [1f32, 2.5].iter().flat_map(|v| v.to_le_bytes()).collect();
    at.extend(field(3, &packed));
    at.extend([4 << 3, 3]);
    // a second message leaves out what proto3 leaves out
    let second = field(2, &[]);
    let made = Made {
        schema: ("foxglove.Sample", "protobuf", &set),
        encoding: "protobuf",
        messages: vec![
            (1, at),
            (5_000_000_000, second),
            (6_000_000_000, vec![0xff]),
        ],
    };
    let capture = read(&write(WriteOptions::new(), &[made])).unwrap();
    let s = &capture.sections[0];
    let value = |group: &str, axis: &str, row: usize| s.column(group, axis).unwrap().values[row];
    assert_eq!(s.rows(), 2);
    assert_eq!(s.stamps_s.as_ref().unwrap()[0], 3.000_000_005);
    assert_eq!(value("/topic0", "x", 0), 1.5);
    assert_eq!(value("/topic0", "y", 0), 0.0);
    assert_eq!(value("/topic0", "z", 0), -2.0);
    assert_eq!(s.column("/topic0", "x").unwrap().unit, "m");
    let volts: Vec<&str> = s
        .columns
        .iter()
        .filter(|c| c.axis.starts_with("volts"))
        .map(|c| c.axis.as_str())
        .collect();
    assert_eq!(volts, ["volts[0]", "volts[1]"]);
    let find = |axis: &str| s.columns.iter().find(|c| c.axis == axis).unwrap();
    assert_eq!(find("volts[1]").values[0], 2.5);
    assert!(find("volts[1]").values[1].is_nan());
    assert_eq!(find("count").values[..], [-2.0, 0.0]);
    assert_eq!(value("/topic0", "x", 1), 0.0);
    assert!(
        capture
            .notes
            .iter()
            .any(|n| n.text.contains("1 of 3 messages"))
    );
}

#[test]
fn json_of_any_shape() {
    let messages = [
        r#"{"timestamp":{"sec":4,"nsec":250000000},"pose":{"position":{"x":1,"y":2.5,"z":-3}},"v":[1,2],"ok":true,"things":[{"name":"a","v":1},{"name":"b","v":2}]}"#,
        r#"{"v":[5,6,7],"pose":{"position":{"z":9,"x":8}},"things":[{"name":"b","v":3}],"late":1}"#,
        "not json",
    ];
    let made = Made {
        schema: ("foxglove.Thing", "jsonschema", b"{}"),
        encoding: "json",
        messages: messages
            .iter()
            .enumerate()
            .map(|(i, m)| (5_000_000_000 + i as u64, m.as_bytes().to_vec()))
            .collect(),
    };
    let capture = read(&write(WriteOptions::new(), &[made])).unwrap();
    let s = &capture.sections[0];
    assert_eq!(s.stamps_s.as_ref().unwrap()[..], [4.25, 5.000_000_001]);
    let find = |axis: &str| &s.columns.iter().find(|c| c.axis == axis).unwrap().values;
    assert_eq!(find("x")[..], [1.0, 8.0]);
    assert!(find("y")[1].is_nan());
    assert_eq!(find("v[1]")[..], [2.0, 6.0]);
    assert!(find("late")[0].is_nan());
    assert_eq!(find("ok")[0], 1.0);
    let names: Vec<&str> = capture.sections[1..]
        .iter()
        .map(|s| s.name.as_str())
        .collect();
    assert_eq!(names, ["/topic0 things a", "/topic0 things b"]);
    assert_eq!(capture.sections[2].columns[0].values[..], [2.0, 3.0]);
    assert!(
        capture
            .notes
            .iter()
            .any(|n| n.text.contains("1 of 3 messages"))
    );
}

/// Collects what goes by, and how much of it at once.
#[derive(Default)]
struct Gatherer {
    /// Per section: stamps and columns.
    rows: BTreeMap<usize, (Vec<f64>, Vec<Vec<f64>>)>,
    most: usize,
    restarts: usize,
}

impl Sink for Gatherer {
    fn restart(&mut self) {
        self.rows.clear();
        self.restarts += 1;
    }

    fn rows(&mut self, index: usize, section: &mut Section) {
        let (stamps, columns) = self.rows.entry(index).or_default();
        self.most = self.most.max(section.rows() * section.columns.len());
        stamps.extend(section.stamps_s.as_ref().unwrap());
        columns.resize(section.columns.len(), Vec::new());
        for (all, column) in columns.iter_mut().zip(&section.columns) {
            all.extend(&column.values);
        }
        section.clear_rows();
    }
}

#[test]
fn a_large_file_goes_by_as_it_would_be_read() {
    goes_by(false);
}

/// What the beginning tells of the topics does not hold to the end.
#[test]
fn a_large_file_with_a_late_topic_goes_by_again() {
    goes_by(true);
}

fn goes_by(late: bool) {
    // 5 million numbers; some rows are out of order
    let mut many = poses(620_000, false);
    for i in (0..many.messages.len() - 40).step_by(1000) {
        many.messages.swap(i, i + 37);
    }
    let numbers = Made {
        schema: ("numbers", "jsonschema", b"{\"type\": \"object\"}"),
        encoding: "json",
        messages: (0..3000_u32)
            .map(|i| {
                let late = if i >= 1000 { ", \"late\": 2.5" } else { "" };
                let text = format!("{{\"a\": {i}{late}}}");
                (u64::from(i) * 1_000_000, text.into_bytes())
            })
            .collect(),
    };
    let compressed = WriteOptions::new().compression(Some(Compression::Lz4));
    let mut file = tempfile::NamedTempFile::new().unwrap();
    let channels = if late {
        [many, numbers]
    } else {
        [numbers, many]
    };
    file.write_all(&write(compressed, &channels)).unwrap();
    let whole = read_file(file.path()).unwrap();
    let importer = importer_for(file.path(), None).unwrap();
    let mut seen = Gatherer::default();
    let passed = importer
        .stream(file.path(), &ReadOptions::default(), &mut seen)
        .unwrap();
    assert_eq!(passed.notes, whole.notes);
    assert_eq!(passed.sections.len(), whole.sections.len());
    let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|v| v.to_bits()).collect() };
    for (i, (p, w)) in passed.sections.iter().zip(&whole.sections).enumerate() {
        assert_eq!((&p.name, &p.groups, p.rows()), (&w.name, &w.groups, 0));
        let (stamps, columns) = &seen.rows[&i];
        assert_eq!(
            bits(stamps),
            bits(w.stamps_s.as_ref().unwrap()),
            "{}",
            p.name
        );
        for ((a, b), c) in columns.iter().zip(&w.columns).zip(&p.columns) {
            assert_eq!((&c.group, &c.axis, c.number), (&b.group, &b.axis, b.number));
            assert_eq!(bits(a), bits(&b.values), "{}", b.title());
        }
    }
    let (poses, numbers) = if late { (0, 1) } else { (1, 0) };
    assert_eq!(whole.sections[poses].rows(), 620_000);
    assert_eq!(whole.sections[numbers].columns.len(), 2);
    assert_eq!(seen.restarts, usize::from(late));
    // Not the five million at once.
    assert!(seen.most < 300_000, "{}", seen.most);
}

/// Found by fuzzing: the name of a topic may hold a line end, and an error is one line all the same.
#[test]
fn an_error_is_one_line_whatever_a_topic_is_called() {
    let file =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/mcap/topic-with-line-end.mcap");
    let error = read_file(&file).unwrap_err().to_string();
    assert!(error.contains("no topic can be read"), "{error}");
    assert!(!error.contains('\n'), "{error}");
}
