//! The keys of `recording.toml` and `rig.toml`: what each has to be and what it says. The readers know the
//! keys of these lists and no others; the schemas and the reference for users are made of them.

use serde_json::{Map, Value, json};

use super::manifest::Kind;

/// A key of a file.
pub(super) struct Key {
    pub name: &'static str,
    is: Is,
    says: &'static str,
    /// It has to be there.
    need: bool,
}

/// What a value has to be.
enum Is {
    Text,
    /// One of these words.
    Word(&'static [&'static str]),
    /// A date and time.
    Moment,
    Number,
    Above0,
    NotBelow0,
    /// A number from one to another.
    Between([f64; 2]),
    /// A whole number from 1 on.
    Count,
    /// Number, not below so much, that may carry its tolerance.
    Toleranced(Option<f64>),
    /// Number or `"estimate"`.
    OrEstimate,
    /// Name or number of a column.
    Column,
    /// One for each chain.
    Columns,
    /// Three numbers.
    Three,
    /// Two rising numbers.
    Pair,
    /// Pairs of numbers.
    Pairs,
    /// Number, or pairs of a time and a number.
    Payload,
    /// Table with these keys, and pairs of keys of which exactly one is there.
    Table(&'static [Key], &'static [[&'static str; 2]]),
}

/// Names of keys, as a reader wants them.
pub(super) const fn names<const N: usize>(keys: &[Key; N]) -> [&'static str; N] {
    let mut out = [""; N];
    let mut i = 0;
    while i < N {
        out[i] = keys[i].name;
        i += 1;
    }
    out
}

const fn need(name: &'static str, is: Is, says: &'static str) -> Key {
    Key {
        name,
        is,
        says,
        need: true,
    }
}

const fn may(name: &'static str, is: Is, says: &'static str) -> Key {
    Key {
        name,
        is,
        says,
        need: false,
    }
}

const FILE: Key = need("file", Is::Text, "the file, as seen from this folder");
const FORMAT: Key = may(
    "format",
    Is::Text,
    "its format, where its content does not tell",
);
const ENCODING: Key = may(
    "encoding",
    Is::Text,
    "its text encoding, where that is not UTF-8: latin1, gbk, ...",
);
const TIME: Key = may("time", Is::Column, "the column of times; or `rate_hz`");
const TIME_UNIT: Key = may(
    "time_unit",
    Is::Text,
    "unit of the times, where the header does not tell: s, ms, ...",
);
const RATE: Key = may(
    "rate_hz",
    Is::Above0,
    "rows per second, where there is no column of times",
);
const VOLTS: Key = may(
    "unit",
    Is::Word(&["V", "kV"]),
    "unit of the voltages; left out: the file's",
);
const SCALE: Key = may(
    "scale",
    Is::Number,
    "volts at the film per volt of the file: 1000 for a monitor of 1 V per kV",
);

/// Days since electrodes were made that there can be: a century.
pub const DAY: [f64; 2] = [0.0, 36525.0];
/// Temperature of a room or a chamber, degrees Celsius; one in kelvin lies above.
pub(super) const ROOM_C: [f64; 2] = [-100.0, 200.0];
/// Relative humidity, per cent.
pub(super) const HUMIDITY_PERCENT: [f64; 2] = [0.0, 100.0];

#[rustfmt::skip]
pub(super) const RECORDING: [Key; 12] = [
    need("id", Is::Text, "its name; output files are named after it, and its last number orders a series"),
    need("kind", Is::Word(&["robot", "film-sample", "film-coupon", "hinge-bench", "axis"]),
        "what was recorded"),
    may("rig", Is::Text, "the rig file, as seen from this folder; robots and hanging samples need it"),
    may("payload_g", Is::Payload, "mass added to the end effector, g; or steps [[time_s, g], ...]"),
    may("film_state", Is::Word(&["relaxed", "virgin"]),
        "of the film at the first sample: relaxed at rest, or stretched just now"),
    may("batch", Is::Text, "film batch; ageing and `batch` compare by it"),
    may("electrode", Is::Text, "kind of electrode; ageing compares by it"),
    may("day", Is::Between(DAY), "days since the electrodes were made"),
    may("series", Is::Text, "recordings with the same word were taken one after the other"),
    may("start", Is::Moment, "when it began; orders a series"),
    may("temperature_C", Is::Between(ROOM_C), "of the room"),
    may("humidity_percent", Is::Between(HUMIDITY_PERCENT), "of the room"),
];

#[rustfmt::skip]
pub(super) const MOTION: [Key; 14] = [
    FILE,
    FORMAT,
    ENCODING,
    TIME,
    TIME_UNIT,
    RATE,
    may("unit", Is::Text, "unit of the positions, where the file does not tell: mm, m, ..."),
    may("end_effector", Is::Text, "marker or body that moves; `*` and `?` stand for any letters"),
    may("base", Is::Text, "marker that is fixed to the frame"),
    may("end_effector_near_mm", Is::Three,
        "of the markers called so, the one first seen nearest to here, in capture axes"),
    may("base_near_mm", Is::Three, "the same of the base's marker"),
    may("base_position_mm", Is::Three, "of the base's marker in the robot's axes"),
    may("end_effector_offset_mm", Is::Three,
        "from the end effector's centre to its marker, in the robot's axes"),
    may("rotation_deg", Is::Three, "capture axes to robot axes: v = Rx Ry Rz v_capture"),
];

#[rustfmt::skip]
pub(super) const VOLTAGE: [Key; 10] = [
    FILE,
    FORMAT,
    ENCODING,
    TIME,
    TIME_UNIT,
    RATE,
    need("channels", Is::Columns, "the columns of the voltages, chain 1 first"),
    VOLTS,
    SCALE,
    may("hold", Is::Word(&["linear", "previous"]), "between samples: straight, or the last value held"),
];

#[rustfmt::skip]
pub(super) const MONITOR: [Key; 11] = [
    FILE,
    FORMAT,
    ENCODING,
    TIME,
    TIME_UNIT,
    RATE,
    may("channels", Is::Columns, "the columns of the measured voltages, chain 1 first"),
    may("current", Is::Columns, "the columns of the measured currents, chain 1 first"),
    VOLTS,
    may("current_unit", Is::Text, "unit of the currents: A, mA, uA"),
    SCALE,
];

const OFFSET: Key = may(
    "offset_s",
    Is::OrEstimate,
    "clock of the voltage (of the input) minus clock of the motion",
);

#[rustfmt::skip]
pub(super) const SYNC: [Key; 4] = [
    OFFSET,
    may("events", Is::Pairs,
        "the same events on both clocks, [[motion_s, voltage_s], ...]; with `offset_s = \"estimate\"`"),
    may("shared", Is::Column,
        "column of the motion's file that shows a voltage; with `offset_s = \"estimate\"`"),
    may("chain", Is::Count, "whose voltage `shared` shows"),
];

#[rustfmt::skip]
pub(super) const COUPON_UNITS: [Key; 5] = [
    may("time", Is::Text, "s, ms, ..."),
    may("displacement", Is::Text, "mm, m, ..."),
    may("stretch", Is::Text, "1 or %"),
    may("force", Is::Text, "N, mN, ..."),
    may("nominal_stress", Is::Text, "Pa, kPa, MPa"),
];

#[rustfmt::skip]
pub(super) const COUPON: [Key; 14] = [
    FILE,
    FORMAT,
    ENCODING,
    need("mode", Is::Word(&["uniaxial", "equibiaxial", "pure-shear"]), "how it is stretched"),
    TIME,
    RATE,
    may("displacement", Is::Column, "the column of the elongation, with `gauge_mm`"),
    may("stretch", Is::Column, "the column of the stretch, instead"),
    may("force", Is::Column, "the column of the force, with `width_mm` and `thickness_mm`"),
    may("nominal_stress", Is::Column, "the column of force over unstretched area, instead"),
    may("units", Is::Table(&COUPON_UNITS, &[]), "units, where the header does not tell"),
    may("gauge_mm", Is::Above0, "unstretched length"),
    may("width_mm", Is::Above0, "unstretched width"),
    may("thickness_mm", Is::Above0, "unstretched thickness"),
];

#[rustfmt::skip]
pub(super) const BENCH_UNITS: [Key; 3] = [
    may("angle", Is::Text, "rad, deg"),
    may("torque", Is::Text, "N m, mN m, ..."),
    may("time", Is::Text, "s, ms, ..."),
];

#[rustfmt::skip]
pub(super) const BENCH: [Key; 9] = [
    FILE,
    FORMAT,
    ENCODING,
    need("angle", Is::Column, "the column of the angle"),
    need("torque", Is::Column, "the column of the torque, positive along the angle"),
    TIME,
    RATE,
    may("units", Is::Table(&BENCH_UNITS, &[]), "units, where the header does not tell"),
    may("span", Is::Pair, "the part that is used: rows, seconds where there is a time"),
];

#[rustfmt::skip]
pub(super) const AXIS_UNITS: [Key; 6] = [
    may("time", Is::Text, "s, ms, ..."),
    may("position", Is::Text, "mm, m, rad, deg, ..."),
    may("velocity", Is::Text, "m/s, rad/s, ..."),
    may("input", Is::Text, "any word; it stands beside numbers"),
    may("load", Is::Text, "N, N m, ..."),
    may("input_time", Is::Text, "s, ms, ..."),
];

#[rustfmt::skip]
pub(super) const AXIS_SCALE: [Key; 4] = [
    may("position", Is::Number, "factor of the column"),
    may("velocity", Is::Number, "factor of the column"),
    may("input", Is::Number, "factor of the column"),
    may("load", Is::Number, "factor of the column"),
];

#[rustfmt::skip]
pub(super) const AXIS: [Key; 22] = [
    FILE,
    FORMAT,
    ENCODING,
    TIME,
    RATE,
    may("position", Is::Column, "the column of the position or angle"),
    may("velocity", Is::Column, "the column of the velocity, instead"),
    need("input", Is::Column, "the column of what drives it: a voltage, a current, a force"),
    may("load", Is::Column, "the column of a measured outer force, positive along the position"),
    may("units", Is::Table(&AXIS_UNITS, &[]), "units, where the header does not tell"),
    may("input_file", Is::Text, "the file of the input, where it is another"),
    may("input_format", Is::Text, "its format, where its content does not tell"),
    may("input_time", Is::Column, "its column of times; or `input_rate_hz`"),
    may("input_rate_hz", Is::Above0, "its rows per second, where there is no column of times"),
    may("scale", Is::Table(&AXIS_SCALE, &[]), "factors of columns, -1 to turn a sign"),
    may("span_s", Is::Pair, "the part that is used, s"),
    may("input_power", Is::Above0, "force goes with this power of the input: 2 for an electrostatic force"),
    need("input_gain", Is::OrEstimate, "force (torque) per unit of the input to its power"),
    may("mass_kg", Is::OrEstimate, "what moves; or `inertia_kg_m2`"),
    may("inertia_kg_m2", Is::OrEstimate, "what turns, instead"),
    may("damping", Is::OrEstimate, "N s/m or N m s/rad; 0 where left out"),
    may("stiffness", Is::OrEstimate, "N/m or N m/rad; 0 where left out"),
];

/// The tables of a `recording.toml`.
#[rustfmt::skip]
pub(super) const RECORDING_TOML: [Key; 8] = [
    need("recording", Is::Table(&RECORDING, &[]), "what it is"),
    may("motion", Is::Table(&MOTION, &[]), "where the end effector was"),
    may("voltage", Is::Table(&VOLTAGE, &[]), "what was applied"),
    may("monitor", Is::Table(&MONITOR, &[]), "what the amplifier measured"),
    may("sync", Is::Table(&SYNC, &[]), "how the clocks lie"),
    may("coupon", Is::Table(&COUPON, &[["displacement", "stretch"], ["force", "nominal_stress"]]),
        "a tensile or relaxation test of bare film"),
    may("bench", Is::Table(&BENCH, &[]), "the torque of a flexure over its angle"),
    may("axis", Is::Table(&AXIS, &[["position", "velocity"], ["mass_kg", "inertia_kg_m2"]]),
        "one drive and one coordinate"),
];

/// The tables that a recording of a kind needs, and those that it may have beside.
pub(super) fn tables(kind: Kind) -> [&'static [&'static str]; 2] {
    match kind {
        Kind::Robot | Kind::FilmSample => {
            [&["recording", "motion", "voltage"], &["monitor", "sync"]]
        }
        Kind::FilmCoupon => [&["recording", "coupon"], &[]],
        Kind::HingeBench => [&["recording", "bench"], &[]],
        Kind::Axis => [&["recording", "axis"], &["sync"]],
    }
}

#[rustfmt::skip]
pub(super) const RIG: [Key; 2] = [
    need("id", Is::Text, "its name"),
    need("kind", Is::Word(&["robot", "film-sample"]), "what it is"),
];

const LENGTH: Is = Is::Toleranced(Some(0.0));
const ANGLE: Is = Is::Toleranced(None);

#[rustfmt::skip]
pub(super) const DELTA: [Key; 6] = [
    need("l_ch_mm", LENGTH, "centre of the base to each bicep pivot"),
    need("l_end_mm", LENGTH, "centre of the end effector to each forearm joint"),
    need("q_mm", LENGTH, "bicep, from pivot to pivot"),
    need("n0_mm", LENGTH, "forearm, from pivot to pivot"),
    need("omega_deg", ANGLE, "bicep to the four-bar's link `b`"),
    need("alpha_deg", ANGLE, "from upright to the ground link `a`, positive towards the robot's axis"),
];

#[rustfmt::skip]
pub(super) const SAM: [Key; 4] = [
    need("a_mm", LENGTH, "ground link of the four-bar"),
    need("b_mm", LENGTH, "its link on the bicep"),
    need("c_mm", LENGTH, "its coupler"),
    need("d_mm", LENGTH, "its link on the lozenge"),
];

const FILMS: Key = may("films", Is::Count, "films in parallel; 1 where left out");
const EPS: Key = may("eps_r", Is::Above0, "relative permittivity of the film");

#[rustfmt::skip]
pub(super) const ACTUATOR: [Key; 3] = [
    need("l_dea_mm", Is::Above0, "side of the lozenge"),
    need("dea_offset_deg", ANGLE, "theta_DEA plus theta_SAM, the same in every pose"),
    FILMS,
];

#[rustfmt::skip]
pub(super) const ROBOT_FILM: [Key; 4] = [
    need("L1_mm", Is::Above0, "unstretched, along the long diagonal"),
    need("L2_mm", Is::Above0, "unstretched, across"),
    need("L3_mm", LENGTH, "unstretched thickness, electrodes included"),
    EPS,
];

#[rustfmt::skip]
pub(super) const ROBOT_MASS: [Key; 2] = [
    need("m_g", LENGTH, "end effector with forearms and marker"),
    need("m_bc_g", Is::NotBelow0, "point mass at each bicep tip"),
];

#[rustfmt::skip]
pub(super) const TOLERANCE: [Key; 5] = [
    may("film_modulus", Is::NotBelow0, "between films, as a share"),
    may("amplifier_gain", Is::NotBelow0, "of each channel, as a share"),
    may("frame_tilt_deg", Is::NotBelow0, "of the capture's axes"),
    may("marker_mm", Is::NotBelow0, "of where the marker sits"),
    may("clock_ms", Is::NotBelow0, "of the clocks against each other"),
];

#[rustfmt::skip]
pub(super) const SAMPLE: [Key; 4] = [
    need("width_mm", Is::Above0, "unstretched, sides free"),
    need("length_mm", Is::Above0, "unstretched, along the pull"),
    may("margin_mm", Is::NotBelow0, "rim without electrode, all round; 0 where left out"),
    FILMS,
];

#[rustfmt::skip]
pub(super) const SAMPLE_FILM: [Key; 2] = [
    need("L3_mm", Is::Above0, "unstretched thickness, electrodes included"),
    EPS,
];

pub(super) const SAMPLE_MASS: [Key; 1] = [need("m_g", Is::NotBelow0, "the mass that hangs")];

/// The tables of a robot's `rig.toml`.
#[rustfmt::skip]
pub(super) const ROBOT_TOML: [Key; 7] = [
    need("rig", Is::Table(&RIG, &[]), "what it is"),
    need("delta", Is::Table(&DELTA, &[]), "the parallel mechanism"),
    need("sam", Is::Table(&SAM, &[]), "the stroke-amplifying four-bar"),
    need("actuator", Is::Table(&ACTUATOR, &[]), "the lozenge that carries the film"),
    need("film", Is::Table(&ROBOT_FILM, &[]), "the film"),
    need("mass", Is::Table(&ROBOT_MASS, &[]), "what it carries"),
    may("tolerance", Is::Table(&TOLERANCE, &[]),
        "tolerances of what has no key of its own, one standard deviation"),
];

/// The tables of a hanging sample's `rig.toml`.
#[rustfmt::skip]
pub(super) const SAMPLE_TOML: [Key; 4] = [
    need("rig", Is::Table(&RIG, &[]), "what it is"),
    need("sample", Is::Table(&SAMPLE, &[]), "the strip"),
    need("film", Is::Table(&SAMPLE_FILM, &[]), "the film"),
    need("mass", Is::Table(&SAMPLE_MASS, &[]), "what it carries"),
];

/// JSON Schema of a `recording.toml`.
#[must_use]
pub fn recording_schema() -> Value {
    let mut schema = object(&RECORDING_TOML, &[]);
    let kinds = Kind::ALL.map(|kind| {
        let [needed, beside] = tables(kind);
        let others = names(&RECORDING_TOML);
        let others = others.iter().filter(|t| !needed.contains(t) && !beside.contains(t));
        let never: Map<String, Value> = others.map(|t| ((*t).to_owned(), json!(false))).collect();
        json!({
            "if": { "properties": { "recording": { "properties": { "kind": { "const": kind.name() } } } } },
            "then": { "required": needed, "properties": never },
        })
    });
    schema.insert("allOf".to_owned(), kinds.into_iter().collect());
    titled("recording.toml", schema)
}

/// JSON Schema of a `rig.toml`.
#[must_use]
pub fn rig_schema() -> Value {
    let of = |kind: &str, tables: &[Key]| {
        let mut schema = object(tables, &[]);
        schema["properties"]["rig"]["properties"]["kind"] = json!({ "const": kind });
        Value::Object(schema)
    };
    let kinds = [of("robot", &ROBOT_TOML), of("film-sample", &SAMPLE_TOML)];
    let schema = Map::from_iter([("oneOf".to_owned(), kinds.into_iter().collect())]);
    titled("rig.toml", schema)
}

fn titled(title: &str, mut schema: Map<String, Value>) -> Value {
    schema.insert(
        "$schema".to_owned(),
        json!("https://json-schema.org/draft/2020-12/schema"),
    );
    schema.insert("title".to_owned(), json!(title));
    Value::Object(schema)
}

fn object(keys: &[Key], either: &[[&str; 2]]) -> Map<String, Value> {
    let properties: Map<String, Value> = keys
        .iter()
        .map(|k| {
            let mut value = k.is.schema();
            value["description"] = json!(k.says);
            (k.name.to_owned(), value)
        })
        .collect();
    let needed: Vec<&str> = keys.iter().filter(|k| k.need).map(|k| k.name).collect();
    let mut out = Map::from_iter([
        ("type".to_owned(), json!("object")),
        ("properties".to_owned(), Value::Object(properties)),
        ("required".to_owned(), json!(needed)),
        ("additionalProperties".to_owned(), json!(false)),
    ]);
    if !either.is_empty() {
        let one_of =
            |pair: &[&str; 2]| json!({ "oneOf": pair.map(|k| json!({ "required": [k] })) });
        out.insert("allOf".to_owned(), either.iter().map(one_of).collect());
    }
    out
}

impl Is {
    fn schema(&self) -> Value {
        let number = json!({ "type": "number" });
        let column =
            json!({ "oneOf": [{ "type": "string" }, { "type": "integer", "minimum": 1 }] });
        let numbers =
            |n: usize| json!({ "type": "array", "items": number, "minItems": n, "maxItems": n });
        let list = |of: Value| json!({ "type": "array", "items": of });
        let or = |a: Value, b: Value| json!({ "oneOf": [a, b] });
        match self {
            Is::Text => json!({ "type": "string" }),
            Is::Word(words) => json!({ "enum": words }),
            Is::Moment => json!({ "type": "string", "format": "date-time" }),
            Is::Number => number,
            Is::Above0 => json!({ "type": "number", "exclusiveMinimum": 0 }),
            Is::NotBelow0 => json!({ "type": "number", "minimum": 0 }),
            Is::Between([low, high]) => {
                json!({ "type": "number", "minimum": low, "maximum": high })
            }
            Is::Count => json!({ "type": "integer", "minimum": 1 }),
            Is::Toleranced(least) => {
                let mut value = number;
                if let Some(least) = least {
                    value["minimum"] = json!(least);
                }
                let both = json!({
                    "type": "object",
                    "properties": { "value": value, "tolerance": { "type": "number", "minimum": 0 } },
                    "required": ["value", "tolerance"],
                    "additionalProperties": false,
                });
                or(value, both)
            }
            Is::OrEstimate => or(number, json!({ "const": "estimate" })),
            Is::Column => column,
            Is::Columns => or(list(column.clone()), column),
            Is::Three => numbers(3),
            Is::Pair => numbers(2),
            Is::Pairs => list(numbers(2)),
            Is::Payload => or(number.clone(), list(numbers(2))),
            Is::Table(keys, either) => Value::Object(object(keys, either)),
        }
    }

    /// In words, for the reference.
    fn words(&self) -> String {
        match self {
            Is::Text => "text".to_owned(),
            Is::Word(words) => {
                let quoted: Vec<String> = words.iter().map(|w| format!("`\"{w}\"`")).collect();
                quoted.join(", ")
            }
            Is::Moment => "date and time".to_owned(),
            Is::Number => "number".to_owned(),
            Is::Above0 => "number above 0".to_owned(),
            Is::NotBelow0 => "number from 0 on".to_owned(),
            Is::Between([low, high]) => format!("number from {low} to {high}"),
            Is::Count => "whole number from 1 on".to_owned(),
            Is::Toleranced(_) => "number, or `{ value, tolerance }`".to_owned(),
            Is::OrEstimate => "number, or `\"estimate\"`".to_owned(),
            Is::Column => "column: name, or number from 1 on".to_owned(),
            Is::Columns => "columns, one for each chain".to_owned(),
            Is::Three => "three numbers".to_owned(),
            Is::Pair => "two rising numbers".to_owned(),
            Is::Pairs => "pairs of numbers".to_owned(),
            Is::Payload => "number, or pairs of time and mass".to_owned(),
            Is::Table(..) => "table".to_owned(),
        }
    }
}

/// The keys of both files as a page of Markdown, a table of keys for each table of a file.
#[must_use]
pub fn reference() -> String {
    let mut page = String::from(
        "# Every key\n\n\
         Made from the lists by which the program reads. Keys in bold have to be there. Editors that know\n\
         JSON Schema (VS Code with Even Better TOML, for one) complete and check them with\n\
         `schemas/recording.schema.json` and `schemas/rig.schema.json`.\n\
         [Recordings and rigs](files.md) has an example of each kind.\n",
    );
    let mut write = |file: &str, tables: &[Key]| {
        page += &format!("\n## {file}\n");
        for table in tables {
            if let Is::Table(keys, either) = &table.is {
                page += &format!("\n### `[{}]`: {}\n\n", table.name, table.says);
                for [a, b] in *either {
                    page += &format!("One of `{a}` and `{b}` has to be there.\n");
                }
                if !either.is_empty() {
                    page.push('\n');
                }
                page += "| key | what it has to be | what it says |\n|---|---|---|\n";
                rows(&mut page, "", keys);
            }
        }
    };
    write("`recording.toml`", &RECORDING_TOML);
    write("`rig.toml` of a robot", &ROBOT_TOML);
    write("`rig.toml` of a hanging sample", &SAMPLE_TOML);
    page
}

fn rows(page: &mut String, inside: &str, keys: &[Key]) {
    for key in keys {
        let name = format!("`{inside}{}`", key.name);
        let name = if key.need {
            format!("**{name}**")
        } else {
            name
        };
        *page += &format!("| {name} | {} | {} |\n", key.is.words(), key.says);
        if let Is::Table(inner, _) = &key.is {
            rows(page, &format!("{}.", key.name), inner);
        }
    }
}
