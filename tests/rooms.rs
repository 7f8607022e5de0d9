//! The rooms of `src/` stay apart: data flows down the table below and never up, and only four rooms touch
//! files.
//!
//! The test reads the paths that begin with `crate::`, `deacal::` or as many `super::` as lead out of the
//! room, wherever they stand (`use` lines, types, expressions, test modules), and knows comments and strings
//! from code. `ARCHITECTURE.md` says why the rooms are what they are. A room that needs one more is a
//! decision: change the table, and the reason there.
//!
//! A cause is one file: what depends on a cause is asked of it, so no room but `effects` (and `cases`, whose
//! forms are their own) writes a cause's id.

use std::path::{Path, PathBuf};

use deacal::effects::{CATALOGUE, line};

/// What a room may use.
enum May {
    /// Every room.
    All,
    /// These rooms; with a list of names, only these names of them.
    Only(&'static [(&'static str, &'static [&'static str])]),
}

/// Every name of a room.
const ANY: &[&str] = &[];

/// Name, what it may use, whether it may touch files, and why no more.
type Room = (&'static str, May, bool, &'static str);

const NO_FILES: bool = false;
const FILES: bool = true;

/// Who may use whom.
const ROOMS: &[Room] = &[
    ("units", May::Only(&[]), NO_FILES, "units rest on nothing"),
    (
        "parameter",
        May::Only(&[]),
        NO_FILES,
        "a parameter is a name with a value; it does not know what it is a parameter of",
    ),
    (
        "kinematics",
        May::Only(&[]),
        NO_FILES,
        "the mechanism knows lengths and angles, no time and no volt",
    ),
    (
        "film",
        May::Only(&[]),
        NO_FILES,
        "the film has never heard of the robot",
    ),
    (
        "effects",
        May::Only(&[("parameter", ANY), ("kinematics", ANY), ("film", ANY)]),
        NO_FILES,
        "an effect is one thing that the model left out; it has never heard of a fit",
    ),
    (
        "recording",
        May::Only(&[("units", ANY)]),
        FILES,
        "a recording is what the instrument wrote, whatever it is used for",
    ),
    (
        "dataset",
        May::Only(&[
            ("recording", ANY),
            ("kinematics", &["Vec3"]),
            ("film", &["InitialState"]),
        ]),
        NO_FILES,
        "a dataset is the same for every model",
    ),
    (
        "model",
        May::Only(&[
            ("units", ANY),
            ("kinematics", ANY),
            ("film", ANY),
            ("effects", ANY),
            ("dataset", &["Track"]),
            ("recording", &["RobotRig", "FilmSampleRig", "Stated"]),
        ]),
        NO_FILES,
        "the model sees the motion and the rig, never the recorded voltage, which is the answer",
    ),
    (
        "checks",
        May::Only(&[
            ("units", ANY),
            ("kinematics", ANY),
            ("film", ANY),
            ("recording", ANY),
            ("dataset", &["Track", "Voltage", "OFFSET_SEARCH_S"]),
            ("model", &["Mechanics", "Parameters", "Robot"]),
        ]),
        NO_FILES,
        "a check looks at what was recorded and at what is stated; it fits nothing and changes nothing",
    ),
    (
        "residual",
        May::Only(&[
            ("units", ANY),
            ("dataset", ANY),
            ("model", ANY),
            ("effects", ANY),
            ("film", ANY),
        ]),
        NO_FILES,
        "the residual is predicted minus recorded and does not know who minimises it",
    ),
    (
        "fit",
        May::Only(&[("residual", &["Normal", "SeparableResidual", "Slope"])]),
        NO_FILES,
        "a fit has never heard of a film; it sees numbers through the traits of the problem",
    ),
    (
        "simulate",
        May::Only(&[
            ("units", ANY),
            ("kinematics", ANY),
            ("film", ANY),
            ("effects", ANY),
            ("dataset", &["Dataset", "Voltage"]),
            ("model", ANY),
        ]),
        NO_FILES,
        "a simulation is the yardstick of the calibration and shares nothing with it but the model and the recorded voltages",
    ),
    (
        "calibration",
        May::Only(&[
            ("parameter", ANY),
            ("film", ANY),
            ("effects", ANY),
            ("recording", &["nearest"]),
            ("dataset", ANY),
            ("model", ANY),
            ("residual", ANY),
            ("fit", ANY),
        ]),
        NO_FILES,
        "a calibration goes from datasets to an outcome that is plain data; reading and showing are other rooms' work",
    ),
    (
        "diagnosis",
        May::Only(&[
            ("film", ANY),
            ("effects", ANY),
            ("dataset", ANY),
            ("kinematics", &["Vec3", "dot"]),
            ("model", ANY),
            ("residual", ANY),
            ("fit", ANY),
            ("simulate", &["predict_motions"]),
            ("recording", &["Stated"]),
        ]),
        NO_FILES,
        "a diagnosis doubts what a fit found; it judges on datasets and gives plain data",
    ),
    (
        "validation",
        May::Only(&[
            ("units", ANY),
            ("effects", ANY),
            ("dataset", ANY),
            ("model", ANY),
            ("calibration", ANY),
            ("simulate", ANY),
        ]),
        NO_FILES,
        "a validation holds finished parameters against recordings: it joins what the inverse and the forward model say, and fits nothing",
    ),
    (
        "cases",
        May::Only(&[
            ("units", ANY),
            ("kinematics", ANY),
            ("film", ANY),
            (
                "recording",
                &[
                    "Rig",
                    "RobotRig",
                    "Manifest",
                    "CouponMode",
                    "RawAxis",
                    "RawBench",
                    "RawColumn",
                    "RawCoordinate",
                    "RawCoupon",
                    "RawElongation",
                    "RawLoad",
                    "Recording",
                ],
            ),
            ("dataset", &["Parts", "Voltage"]),
            ("model", ANY),
            ("simulate", ANY),
        ]),
        NO_FILES,
        "what hides an effect shares nothing with what has to find it",
    ),
    (
        "proof",
        May::Only(&[
            ("cases", ANY),
            ("dataset", ANY),
            ("diagnosis", ANY),
            ("effects", ANY),
            ("film", &["Film"]),
            ("model", ANY),
            ("simulate", &["Motion", "Options", "motion_with_effects"]),
        ]),
        NO_FILES,
        "a proof runs the diagnosis blind and only then opens the answers",
    ),
    (
        "report",
        May::All,
        FILES,
        "a report shows everything, and nothing looks at a report",
    ),
    (
        "jobs",
        May::All,
        NO_FILES,
        "a job joins the rooms for whoever asks: it reads through `recording`, and leaves writing to who asked",
    ),
    ("cli", May::All, FILES, "the command line opens the doors"),
    ("main", May::All, FILES, "main calls the command line"),
    (
        "lib",
        May::Only(&[]),
        NO_FILES,
        "lib.rs lists the rooms and gives none of them another name",
    ),
];

/// Rooms that nobody uses but these.
const READERS: &[(&str, &[&str])] = &[
    ("report", &["jobs", "cli", "main"]),
    ("jobs", &["cli", "main"]),
    ("cli", &["main"]),
];

/// A name that a room hands on from another one opens a way round the table: (room, from, name).
const HANDED_ON: &[(&str, &str, &str)] = &[
    ("dataset", "recording", "CouponMode"),
    ("model", "dataset", "Track"),
];

/// Rooms that write ids of causes.
const ID_WRITERS: &[&str] = &["effects", "cases"];

/// What is written like the id of a cause, and is none: (file, word, what it is).
const NAMESAKES: &[(&str, &str, &str)] = &[(
    "src/recording/described.rs",
    "amplifier_gain",
    "a key of rig.toml: by how much a gain may be off",
)];

/// Crates, and associated functions, that open files.
const OPENERS: &[&str] = &["tempfile", "memmap2", "argmin_checkpointing_file"];
const OPENING: &[&str] = &["from_path"];

#[test]
fn rooms_stay_apart() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut complaints = Vec::new();
    for (name, text) in sources() {
        complaints.extend(complain(&name, &text));
    }
    for (room, ..) in ROOMS {
        let there = |p: &str| root.join("src").join(p).exists();
        if !there(&format!("{room}.rs")) && !there(&format!("{room}/mod.rs")) {
            complaints.push(format!("src/: the table has a room `{room}`, src has not"));
        }
    }
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

#[test]
fn a_cause_is_one_file() {
    let files = sources();
    let every = files.iter().flat_map(|(name, text)| ids(name, text));
    let (known, unknown): (Vec<_>, Vec<_>) = every.partition(|(file, _, id)| {
        let same = |n: &&(&str, &str, &str)| n.0 == file && n.1 == id;
        NAMESAKES.iter().find(same).is_some()
    });
    let complaints: Vec<String> = (unknown.iter())
        .map(|(file, line, id)| {
            format!(
                "{file}:{line}: \"{id}\" is a cause's id: ask the cause for what depends on it (a method of \
                 `Effect`), or take the one that is meant by its type"
            )
        })
        .collect();
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
    for (file, word, what) in NAMESAKES {
        let there = known.iter().any(|(f, _, id)| f == file && id == word);
        assert!(there, "{file} has no \"{word}\" ({what}) any more");
    }
}

/// Ids of causes as strings in a file where they may not stand, outside test modules: file, line, id.
fn ids(file: &str, text: &str) -> Vec<(String, usize, String)> {
    let room = file.strip_prefix("src/").unwrap().split('/').next();
    if ID_WRITERS.iter().any(|r| Some(*r) == room) || file.ends_with("/tests.rs") {
        return Vec::new();
    }
    let robots = CATALOGUE.iter().map(|e| e.id());
    let every: Vec<&str> = robots.chain(line::every().map(|e| e.id())).collect();
    let tokens = tokens(text);
    let tested = tested(&tokens);
    let outside = tokens.iter().zip(tested).filter(|(_, tested)| !tested);
    outside
        .filter_map(|((line, token), _)| Some((*line, token.strip_prefix('"')?)))
        .filter(|(_, word)| every.contains(word))
        .map(|(line, word)| (file.to_owned(), line, word.to_owned()))
        .collect()
}

/// Every file of `src/`: its name from the root, and its text.
fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    rust_files(&root.join("src"), &mut files);
    files.sort();
    assert!(files.len() > 30, "the walk found {} files", files.len());
    let read = |file: PathBuf| {
        let name = file.strip_prefix(root).unwrap().to_string_lossy();
        let text = std::fs::read_to_string(&file).unwrap();
        (name.replace('\\', "/"), text)
    };
    files.into_iter().map(read).collect()
}

fn rust_files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Everything that a file of `src/` does and may not, one sentence each.
fn complain(file: &str, text: &str) -> Vec<String> {
    let inside = file.strip_prefix("src/").unwrap();
    let modules: Vec<&str> = inside
        .trim_end_matches(".rs")
        .trim_end_matches("/mod")
        .split('/')
        .collect();
    let room = modules[0];
    let Some((_, may, touches_files, why)) = ROOMS.iter().find(|r| r.0 == room) else {
        return vec![format!(
            "{file}:1: room `{room}` is not in the table of tests/rooms.rs: say there what it may use, and why no more"
        )];
    };
    // The crate's root: as many `super` as the file is deep.
    let depth = if matches!(room, "lib" | "main") {
        0
    } else {
        modules.len()
    };
    let mut complaints = Vec::new();
    for path in paths(&tokens(text), depth) {
        let Found {
            line,
            segments,
            handed_on,
            in_test,
        } = &path;
        let shown = segments.join("::");
        let mut say = |what: String| complaints.push(format!("{file}:{line}: {what} ({why})"));
        match segments[0].as_str() {
            "crate" => {
                let Some(other) = segments.get(1) else {
                    continue;
                };
                if other == room {
                    continue;
                }
                if other == "*" || other == "self" {
                    say(format!(
                        "room `{room}` takes `{shown}`, that is every room at once"
                    ));
                    continue;
                }
                // Macros and names of the root itself are no room.
                let Some(_) = ROOMS.iter().find(|r| r.0 == other) else {
                    say(format!(
                        "room `{room}` uses `{shown}`, and `{other}` is no room of the table"
                    ));
                    continue;
                };
                let name = segments.get(2).map_or("self", String::as_str);
                match may {
                    May::All => {}
                    May::Only(list) => match list.iter().find(|(r, _)| r == other) {
                        None => say(format!(
                            "room `{room}` uses `{shown}`, but may not look into `{other}`; it may use {}",
                            names(list.iter().map(|(r, _)| *r))
                        )),
                        Some((_, only)) if !only.is_empty() && !only.contains(&name) => {
                            say(format!(
                                "room `{room}` uses `{shown}`, but of `{other}` only {}",
                                names(only.iter().copied())
                            ))
                        }
                        Some(_) => {}
                    },
                }
                if let Some((_, readers)) = READERS.iter().find(|(r, _)| r == other)
                    && !readers.contains(&room)
                {
                    say(format!(
                        "room `{room}` uses `{shown}`, but `{other}` is for {} alone",
                        names(readers.iter().copied())
                    ));
                }
                if *handed_on
                    && !HANDED_ON.contains(&(room, other.as_str(), name))
                    && room != "report"
                {
                    say(format!(
                        "room `{room}` hands `{shown}` on under its own name, a way round the table"
                    ));
                }
            }
            _ if *touches_files || *in_test => {}
            "std" if segments.get(1).is_some_and(|s| s == "fs") => say(format!(
                "room `{room}` uses `{shown}`; only recording, report, cli and main touch files"
            )),
            first
                if (first == "File" && segments.len() > 1)
                    || OPENERS.contains(&first)
                    || segments
                        .iter()
                        .skip(1)
                        .any(|s| OPENING.contains(&s.as_str())) =>
            {
                say(format!(
                    "room `{room}` uses `{shown}`, which opens a file; only recording, report, cli and main touch files"
                ))
            }
            _ => {}
        }
    }
    complaints
}

fn names<'a>(list: impl Iterator<Item = &'a str>) -> String {
    let list: Vec<String> = list.map(|n| format!("`{n}`")).collect();
    if list.is_empty() {
        "no room".into()
    } else {
        list.join(", ")
    }
}

/// A path in the code.
#[derive(Debug, PartialEq)]
struct Found {
    line: usize,
    /// `crate` first for what lies in this crate.
    segments: Vec<String>,
    /// Stands in a `pub use`.
    handed_on: bool,
    /// Stands in a test module.
    in_test: bool,
}

/// Every path of two segments or more, groups in braces taken apart. `super` that leads to the root is
/// `crate`.
fn paths(tokens: &[(usize, String)], file_depth: usize) -> Vec<Found> {
    let at = |i: usize| tokens.get(i).map_or("", |t| t.1.as_str());
    let before = |i: usize, n: usize| i.checked_sub(n).map_or("", at);
    let mut out = Vec::new();
    let tested = tested(tokens);
    // Open braces: whether of a module.
    let mut braces: Vec<bool> = Vec::new();
    let mut i = 0;
    while i < tokens.len() {
        match at(i) {
            "{" => braces.push(before(i, 2) == "mod"),
            "}" => {
                braces.pop();
            }
            word if is_word(word) && at(i + 1) == "::" && before(i, 1) != "::" => {
                let used = before(i, 1) == "use" || (before(i, 1) == "::" && before(i, 2) == "use");
                let used_at = i.saturating_sub(1);
                let handed_on = used && (before(used_at, 1) == "pub" || before(used_at, 1) == ")");
                let depth = file_depth + braces.iter().filter(|b| **b).count();
                let mut found = Vec::new();
                let end = tree(tokens, i, &mut Vec::new(), &mut found);
                for (line, mut segments) in found {
                    let ups = segments.iter().take_while(|s| *s == "super").count();
                    if ups > 0 {
                        if ups < depth {
                            continue;
                        }
                        segments.splice(..ups, ["crate".to_owned()]);
                    }
                    if segments[0] == "deacal" {
                        segments[0] = "crate".into();
                    }
                    out.push(Found {
                        line,
                        segments,
                        handed_on,
                        in_test: tested[i],
                    });
                }
                i = end;
                continue;
            }
            _ => {}
        }
        i += 1;
    }
    out
}

/// Of each token whether it stands in a test module, or in an item under `#[cfg(test)]`.
fn tested(tokens: &[(usize, String)]) -> Vec<bool> {
    let at = |i: usize| tokens.get(i).map_or("", |t| t.1.as_str());
    let mut braces: Vec<bool> = Vec::new();
    let mut follows = false;
    let of = |i: usize| {
        let cfg = (1..7).map(|n| at(i + n));
        match at(i) {
            "#" if cfg.eq(["[", "cfg", "(", "test", ")", "]"]) => follows = true,
            "{" => braces.push(std::mem::take(&mut follows)),
            "}" => {
                braces.pop();
            }
            // `mod tests;` and single items under cfg(test)
            ";" => follows = false,
            _ => {}
        }
        follows || braces.contains(&true)
    };
    (0..tokens.len()).map(of).collect()
}

/// One path from token `i` on, its groups taken apart; returns the token after it.
fn tree(
    tokens: &[(usize, String)],
    mut i: usize,
    prefix: &mut Vec<String>,
    out: &mut Vec<(usize, Vec<String>)>,
) -> usize {
    let at = |i: usize| tokens.get(i).map_or("", |t| t.1.as_str());
    let own = prefix.len();
    let line = tokens.get(i).map_or(0, |t| t.0);
    loop {
        match at(i) {
            "{" => {
                i += 1;
                while i < tokens.len() && at(i) != "}" {
                    if is_word(at(i)) || matches!(at(i), "*" | "{") {
                        i = tree(tokens, i, prefix, out);
                    } else {
                        i += 1;
                    }
                    // `name as other`
                    while i < tokens.len() && !matches!(at(i), "," | "}") {
                        i += 1;
                    }
                    if at(i) == "," {
                        i += 1;
                    }
                }
                prefix.truncate(own);
                return i + 1;
            }
            word if is_word(word) || word == "*" => {
                prefix.push(word.to_owned());
                i += 1;
                let goes_on =
                    at(i) == "::" && (is_word(at(i + 1)) || matches!(at(i + 1), "{" | "*"));
                if goes_on {
                    i += 1;
                } else {
                    break;
                }
            }
            _ => break,
        }
    }
    out.push((line, prefix.clone()));
    prefix.truncate(own);
    i
}

fn is_word(token: &str) -> bool {
    token
        .chars()
        .next()
        .is_some_and(|c| c.is_alphabetic() || c == '_')
}

/// (line, token): words, `::`, single characters, and strings, which begin with a quote and end without one.
/// Comments and characters in quotes are left out.
fn tokens(text: &str) -> Vec<(usize, String)> {
    let c: Vec<char> = text.chars().collect();
    let at = |i: usize| c.get(i).copied().unwrap_or('\0');
    let mut out = Vec::new();
    let (mut i, mut line) = (0, 1);
    while i < c.len() {
        match c[i] {
            '\n' => {
                line += 1;
                i += 1;
            }
            '/' if at(i + 1) == '/' => {
                while i < c.len() && c[i] != '\n' {
                    i += 1;
                }
            }
            '/' if at(i + 1) == '*' => {
                let mut deep = 0;
                while i < c.len() {
                    if c[i] == '/' && at(i + 1) == '*' {
                        deep += 1;
                        i += 1;
                    } else if c[i] == '*' && at(i + 1) == '/' {
                        deep -= 1;
                        i += 1;
                    } else if c[i] == '\n' {
                        line += 1;
                    }
                    i += 1;
                    if deep == 0 {
                        break;
                    }
                }
            }
            '"' => {
                let (from, first) = (i, line);
                i += 1;
                while i < c.len() && c[i] != '"' {
                    if c[i] == '\\' {
                        i += 1;
                    }
                    line += usize::from(at(i) == '\n');
                    i += 1;
                }
                out.push((first, c[from..i.min(c.len())].iter().collect()));
                i += 1;
            }
            // 'x' and '\n' are characters, 'a is a lifetime
            '\'' if at(i + 1) == '\\' => {
                i += 3;
                while i < c.len() && c[i] != '\'' {
                    i += 1;
                }
                i += 1;
            }
            '\'' if at(i + 2) == '\'' => i += 3,
            ':' if at(i + 1) == ':' => {
                out.push((line, "::".into()));
                i += 2;
            }
            x if x.is_alphanumeric() || x == '_' => {
                let from = i;
                while at(i).is_alphanumeric() || at(i) == '_' {
                    i += 1;
                }
                let word: String = c[from..i].iter().collect();
                let mut hashes = 0;
                while at(i + hashes) == '#' {
                    hashes += 1;
                }
                if matches!(word.as_str(), "r" | "br") && at(i + hashes) == '"' {
                    // r#"..."#
                    i += hashes + 1;
                    let (from, first) = (i - 1, line);
                    while i < c.len() && !(c[i] == '"' && (1..=hashes).all(|n| at(i + n) == '#')) {
                        line += usize::from(c[i] == '\n');
                        i += 1;
                    }
                    out.push((first, c[from..i.min(c.len())].iter().collect()));
                    i += hashes + 1;
                } else if word == "r" && hashes == 1 {
                    i += 1; // r#word
                } else {
                    out.push((line, word));
                }
            }
            x if x.is_whitespace() => i += 1,
            x => {
                out.push((line, x.to_string()));
                i += 1;
            }
        }
    }
    out
}

/// The one complaint about a file.
fn complaint(file: &str, text: &str) -> String {
    let mut all = complain(file, text);
    assert_eq!(all.len(), 1, "{all:?}");
    all.pop().unwrap()
}

#[test]
fn a_room_that_looks_up_is_named_with_file_line_and_reason() {
    assert_eq!(
        complaint(
            "src/film/kernel.rs",
            "//! film\n\nuse crate::kinematics::Vec3;\n"
        ),
        "src/film/kernel.rs:3: room `film` uses `crate::kinematics::Vec3`, but may not look into `kinematics`; it may use \
         no room (the film has never heard of the robot)"
    );
    assert_eq!(
        complaint(
            "src/dataset/robot.rs",
            "fn f() { crate::kinematics::dot(a, b) }"
        ),
        "src/dataset/robot.rs:1: room `dataset` uses `crate::kinematics::dot`, but of `kinematics` only `Vec3` (a dataset \
         is the same for every model)"
    );
    assert!(complaint("src/weather/mod.rs", "").contains("not in the table"));
}

#[test]
fn every_way_of_writing_a_path_is_seen() {
    for text in [
        "use crate::{residual::Normal, fit::{separable::Options}};",
        "use crate::{\n    residual::Normal,\n    fit as f,\n};",
        "pub(crate) fn f(x: &crate::fit::State) {}",
        "use super::super::fit::State;",
        "mod tests { use super::super::super::fit::State; }",
        "#[cfg(test)]\nmod tests { use crate::fit::State; }",
        "type T<'a> = &'a deacal::fit::State;",
        "let c = '\"'; let s = \"\\\"\"; let x = crate::fit::State;",
    ] {
        let said = complaint("src/residual/robot.rs", text).replace("crate::residual", "");
        assert!(said.contains("may not look into `fit`"), "{text}: {said}");
    }
    for text in [
        "// use crate::fit::State;",
        "/* crate::fit /* */ crate::fit::State */",
        "/// See [`crate::fit::State`].\nstruct A;",
        "let s = \"crate::fit::State\"; let r = r#\"\"crate::fit::State\"#;",
        "use super::fit::State;",
        "mod tests { use super::super::fit::State; }",
        "use crate::residual::fit::State;",
    ] {
        assert_eq!(complain("src/residual/robot.rs", text), [""; 0], "{text}");
    }
}

#[test]
fn files_reports_and_names_handed_on_are_seen() {
    let files = "only recording, report, cli and main touch files";
    for text in [
        "use std::fs;",
        "use std::{fs::File, io};",
        "let x = std::fs::read(p);",
        "let x = File::open(p);",
        "let x = tempfile::tempdir();",
        "let x = csv::Reader::from_path(p);",
    ] {
        let said = complain("src/dataset/robot.rs", text);
        assert!(
            said.iter().all(|s| s.contains(files)) && !said.is_empty(),
            "{text}: {said:?}"
        );
        assert_eq!(complain("src/report/json.rs", text), [""; 0], "{text}");
        let test = format!("#[cfg(test)] mod tests {{ {text} }}");
        assert_eq!(complain("src/dataset/robot.rs", &test), [""; 0], "{text}");
    }
    let after = "#[cfg(test)] fn g() { f() }\nuse std::fs;";
    assert!(complaint("src/fit/mod.rs", after).starts_with("src/fit/mod.rs:2: "));
    let after = "#[cfg(test)] mod tests { fn f() {} }\nuse std::fs;";
    assert!(complaint("src/fit/mod.rs", after).starts_with("src/fit/mod.rs:2: "));
    assert!(complaint("src/main.rs", "use deacal::*;").contains("every room at once"));
    assert!(complaint("src/residual/mod.rs", "pub use crate::model::Robot;").contains("hands"));
    let lib = complain("src/lib.rs", "pub mod fit;\npub use crate::fit::State;");
    assert!(lib[0].contains("src/lib.rs:2: room `lib`"), "{lib:?}");
}

#[test]
fn an_id_of_a_cause_is_seen_wherever_it_is_written() {
    for text in [
        "fn f(id: &str) { match id { \"leakage\" => 1, _ => 0 }; }",
        "const A: &[&str] = &[\n\"leakage\"];",
        "const A: &str = r#\"leakage\"#;",
        "#[cfg(test)] mod tests { fn f() {} }\nconst A: &str = \"leakage\";",
        "const A: &str = \"x_drive_lag\";",
    ] {
        assert_eq!(ids("src/report/json.rs", text).len(), 1, "{text}");
        assert_eq!(ids("src/effects/leakage.rs", text), [], "{text}");
        assert_eq!(ids("src/cases/electrical.rs", text), [], "{text}");
    }
    for text in [
        "// \"leakage\"",
        "const A: &str = \"the leakage\";",
        "const A: &str = Leakage.id();",
        "#[cfg(test)]\nmod tests { const A: &str = \"leakage\"; }",
        "const A: &str = \"learnt\";",
    ] {
        assert_eq!(ids("src/report/json.rs", text), [], "{text}");
    }
    let line = ids(
        "src/report/json.rs",
        "\nconst A: [&str; 2] = [\"\n\",\n\"leakage\"];",
    );
    assert_eq!(line[0].1, 4);
}
