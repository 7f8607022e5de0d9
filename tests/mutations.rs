//! Whatever stands in the files and whatever is typed, the program ends with a sentence: manifests, rigs,
//! parameters, plans, values, files of instruments, results of earlier runs and options are spoiled at
//! random, one or two at a time, and every command meets them. Nothing panics, nothing hangs, and no figure
//! is NaN.
//!
//! A short form always runs. The long one, of any number from any one on, prints what it counted:
//! `DEACAL_MUTATIONS=2000 cargo test --release --test mutations -- --ignored --nocapture`

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use common::bench::{End, figure_of_nothing, lay, run, within_limits};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

/// Causes of every site, with and without memory.
const CAUSES: &str = r#"
[[effect]]
id = "leakage"
loss_fraction = 0.06
field_exponent = 1.5
resistance = 3e6
[[effect]]
id = "dielectric_relaxation"
actuators = [2]
fraction = 0.05
time_constant = 0.4
slow_fraction = 0.03
[[effect]]
id = "series_resistance"
actuators = [1]
resistance = 2e7
[[effect]]
id = "permittivity_stretch"
slope = 0.1
curvature = 0.1
[[effect]]
id = "mullins_softening"
softening = 0.2
energy_scale = 4e4
[[effect]]
id = "joint_friction"
torque = 5e-4
presliding = 6e-3
sticking = 0.3
[[effect]]
id = "end_stop"
theta_stop = 4.2
stiffness = 0.3
damping = 0.1
[[effect]]
id = "payload_change"
mass = 2e-3
time = 1.0
[[effect]]
id = "link_length_error"
actuators = [2]
link = "q"
relative_error = 0.01
[[effect]]
id = "marker_offset"
offset = [1e-3, -5e-4, 2e-4]
"#;

/// What was learnt, of every form.
const LEARNT: &str = r#"
[[effect]]
id = "learnt"
site = "bicep"
form = "spline"
variables = ["bicep angle", "bicep rate"]
unit = "N m"
knots = [4.0, 4.1, 4.2, 4.3]
values = [1e-4, 2e-4, -1e-4, 5e-5]
[[effect]]
id = "learnt"
site = "film"
form = "presliding"
variables = ["lozenge angle", "direction of motion"]
unit = "N m"
coefficients = [1e-4, -4e-5]
widths = [0.002, 0.03]
[[effect]]
id = "learnt"
site = "bicep"
form = "wave"
variables = ["time"]
unit = "N m"
coefficients = [3e-5, 2e-5]
frequency_Hz = 1.3
[[effect]]
id = "learnt"
site = "force"
form = "oscillator"
variables = ["effector velocity", "history"]
unit = "N"
coefficients = [2e-3, 2e-3, 1e-3, 2e-4, 0.0, 1e-4]
frequency_Hz = 4.0
damping = 0.1
[[effect]]
id = "learnt"
site = "force"
form = "ridge"
variables = ["effector x", "effector y", "effector z"]
unit = "N"
direction = [0.6, 0.0, 0.8]
knots = [-0.04, -0.025, -0.015]
values = [0.001, -0.002, 0.001]
[[effect]]
id = "learnt"
site = "electrical"
form = "neighbours"
variables = ["voltages of the other actuators"]
unit = "V^2"
coefficients = [0.02, -0.01]
[[effect]]
id = "learnt"
site = "capacitance"
form = "lag"
variables = ["area stretch"]
unit = "1"
coefficients = [0.02, -0.01]
times_s = [0.2, 2.0]
"#;

const BATCH: &str = "fit = \"sample --branches 2 --starts 1\"\n\
    [[set]]\nname = \"one\"\nrecordings = [\"films/one\"]\nbatch = \"A\"\nday = 1\n\
    [[set]]\nname = \"two\"\nrecordings = [\"films/two\"]\nbatch = \"B\"\nday = 2\n";

/// Files of instruments, of every format.
const INSTRUMENTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/recording");
const SEEDS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fuzz/corpus");

/// What is spoiled: recordings of every kind and what the program made of them, files of instruments.
struct Template(tempfile::TempDir);

impl Template {
    fn new(frames: usize) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        lay(dir.path(), frames);
        let fitted = fs::read_to_string(at("parameters.toml")).unwrap();
        let known = fitted.split("[provenance]").next().unwrap().to_owned();
        fs::write(at("causes.toml"), format!("{known}{CAUSES}")).unwrap();
        fs::write(at("learnt.toml"), format!("{known}{LEARNT}")).unwrap();
        copy(&at("symmetric"), &at("bare"));
        fs::remove_file(at("bare/recording.toml")).unwrap();
        fs::copy(at("axis/data.csv"), at("bare/axis.csv")).unwrap();
        // a robot's recording with every key, and its clock to be found
        copy(&at("symmetric"), &at("rich"));
        let text = fs::read_to_string(at("rich/recording.toml")).unwrap();
        let own = [
            "batch",
            "electrode",
            "day",
            "series",
            "start",
            "temperature_C",
        ];
        let stated = |l: &&str| !own.iter().any(|k| l.starts_with(k));
        let text: Vec<&str> = text.lines().filter(stated).collect();
        let keys = "[recording]\nbatch = \"B\"\nelectrode = \"DCPE\"\nday = 3\nseries = \"s\"\n\
            start = 2026-03-01T10:00:00\ntemperature_C = 23.5\nhumidity_percent = 41.0";
        let text = text.join("\n").replacen("[recording]", keys, 1) + "\n";
        let text = text.replacen("id = \"symmetric\"", "id = \"rich\"", 1);
        let text = text.replacen("offset_s = 0.0", "offset_s = \"estimate\"", 1);
        fs::write(at("rich/recording.toml"), text).unwrap();
        // and a motion of its own, by its last row: a copy is no further evidence
        let motion = fs::read_to_string(at("rich/motion.csv")).unwrap();
        let mut rows: Vec<String> = motion.lines().map(str::to_owned).collect();
        let [.., before, last] = &mut rows[..] else {
            panic!("{motion}")
        };
        let (time, pose) = (last.split_once(','), before.split_once(','));
        *last = format!("{},{}", time.unwrap().0, pose.unwrap().1);
        fs::write(at("rich/motion.csv"), rows.join("\n") + "\n").unwrap();
        for (day, name) in [(1, "one"), (2, "two")] {
            copy(&at("sample"), &at(&format!("films/{name}")));
            let path = at(&format!("films/{name}/recording.toml"));
            let text = fs::read_to_string(&path).unwrap();
            let text = text.replacen("id = \"sample\"", &format!("id = \"{name}\""), 1);
            let text = text.replacen("day = 1", &format!("day = {day}"), 1);
            let text = text.replacen("../hanging.toml", "../../hanging.toml", 1);
            fs::write(path, text).unwrap();
            let path = at(&format!("films/{name}/data.csv"));
            let table = fs::read_to_string(&path).unwrap();
            let longer: Vec<&str> = table.lines().take(600 + day).collect();
            fs::write(path, longer.join("\n") + "\n").unwrap();
        }
        fs::write(at("batch.toml"), BATCH).unwrap();
        fs::create_dir_all(at("files")).unwrap();
        for folder in fs::read_dir(SEEDS).unwrap() {
            for file in fs::read_dir(folder.unwrap().path()).unwrap() {
                let file = file.unwrap();
                fs::copy(file.path(), at("files").join(file.file_name())).unwrap();
            }
        }
        for file in fs::read_dir(INSTRUMENTS).unwrap() {
            let file = file.unwrap();
            if file.file_type().unwrap().is_file() {
                fs::copy(file.path(), at("files").join(file.file_name())).unwrap();
            }
        }
        let _ = fs::remove_file(at("files/README.md"));
        let mut path = "time_s,x_mm,y_mm,z_mm\n".to_owned();
        for i in 0..=100 {
            let t = 0.03 * f64::from(i);
            let (sin, cos) = (2.0 * t).sin_cos();
            path += &format!("{t:.2},{sin:.4},{:.4},{:.4}\n", cos - 1.0, -38.0 - t);
        }
        fs::write(at("planned.csv"), path).unwrap();
        for command in MADE {
            let out = run(dir.path(), command);
            let error = String::from_utf8_lossy(&out.stderr).into_owned();
            assert!(out.status.success(), "{command}: {error}");
        }
        Template(dir)
    }
}

/// What the program makes of it first, to be spoiled too.
const MADE: [&str; 12] = [
    "fit film symmetric --branches 2 --starts 1 -o made/film -q",
    "fit axis axis -o made/axis -q",
    "fit hinge hinge -o made/hinge -q",
    "fit coupon coupon --branches 2 --starts 1 -o made/coupon -q",
    "import files/small.mcap files/sheet.xlsx -o made/import -q",
    "batch batch.toml --shard 1/2 -o made/batch -q",
    "batch batch.toml --shard 2/2 -o made/batch -q",
    "prove --rigs axis --number 1 --keep made/kept/axis -o made/whole/axis -q",
    "prove --rigs bench --number 1 --keep made/kept/bench -o made/whole/bench -q",
    "prove --rigs coupon --number 1 --keep made/kept/coupon -o made/whole/coupon -q",
    "prove --rigs axis,bench,coupon --number 3 --shard 1/2 -o made/proof -q",
    "prove --rigs axis,bench,coupon --number 3 --shard 2/2 -o made/proof -q",
];

/// All files of a folder, into another.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &to);
        } else {
            fs::copy(entry.path(), to).unwrap();
        }
    }
}

/// A kind of input: the files that may be spoiled (a folder is any file in it), and the commands that meet
/// them.
struct Kind {
    files: &'static [&'static str],
    commands: &'static [&'static str],
}

const KINDS: [Kind; 14] = [
    Kind {
        files: &[
            "symmetric/recording.toml",
            "symmetric/motion.csv",
            "symmetric/voltage.csv",
            "bare/motion.csv",
            "rig.toml",
            "parameters.toml",
        ],
        commands: &[
            "import symmetric -o out",
            "import symmetric --also mat -o out",
            "import symmetric --also npz --json",
            "import symmetric/motion.csv symmetric/voltage.csv",
            "import bare/motion.csv bare/voltage.csv --init",
            "fit film symmetric --starts 1 -o out",
            "fit film symmetric --starts 1 --branches 2 --robust 3.0 --bound J=20..200 -o out",
            "fit film symmetric --starts 1 --start parameters.toml -o out",
            "fit forearm single-1 symmetric --params parameters.toml --starts 1 -o out",
            "fit robot symmetric single-1 --starts 1 --branches 3 --fix J=80.0 -o out",
            "predict voltage symmetric --params parameters.toml -o out/p.csv",
            "predict voltage symmetric --params parameters.toml --full",
            "predict voltage symmetric --params parameters.toml -o out/p.mcap",
            "predict voltage symmetric --params parameters.toml -o out/p.mat",
            "predict force symmetric --params parameters.toml -o out/p.csv",
            "predict motion symmetric --params parameters.toml -o out/p.csv",
            "validate symmetric --params parameters.toml -o out",
            "validate symmetric --params parameters.toml --params causes.toml --compare paper -o out",
            "diagnose symmetric --only marker_offset,series_resistance,amplifier_gain -o out",
            "diagnose symmetric --only joint_friction --holdout single-1 --rivals --relevant 5.0 -o out",
            "simulate --rig rig.toml --params parameters.toml --voltage symmetric/voltage.csv -o out",
            "ageing symmetric rich -o out",
            "export parameters.toml --format json",
            "export parameters.toml --format m -o out/p.m",
            "export parameters.toml --format py",
            "export parameters.toml --format c",
        ],
    },
    Kind {
        files: &[
            "rich/recording.toml",
            "rich/motion.csv",
            "rich/voltage.csv",
            "causes.toml",
            "learnt.toml",
            "rig.toml",
            "made/film/plan.toml",
            "made/film/parameters.toml",
            "planned.csv",
        ],
        commands: &[
            "import rich -o out",
            "fit film rich --starts 1 --branches 2 -o out",
            "fit film symmetric --starts 1 --branches 2 --plan made/film/plan.toml -o out",
            "fit film symmetric --starts 1 --branches 2 --start made/film/parameters.toml -o out",
            "fit forearm symmetric --params made/film/parameters.toml --starts 1 -o out",
            "predict voltage rich --params causes.toml -o out/p.csv",
            "predict force rich --params learnt.toml -o out/p.csv",
            "predict motion rich --params causes.toml -o out/p.csv",
            "predict motion rich --params learnt.toml -o out/p.csv",
            "validate rich symmetric --params causes.toml -o out",
            "validate symmetric --params learnt.toml -o out",
            "validate symmetric --params parameters.toml --path planned.csv -o out",
            "diagnose rich --only joint_friction,payload_change -o out",
            "ageing rich symmetric -o out",
            "simulate --rig rig.toml --params causes.toml --voltage rich/voltage.csv -o out",
            "simulate --rig rig.toml --params learnt.toml --drive sine:peak_V=3000,hz=1 --duration 2 -o out",
            "simulate --rig rig.toml --params parameters.toml --path planned.csv -o out",
            "export causes.toml --format c",
            "export learnt.toml --format json",
            "export causes.toml --format c --controller --rig rig.toml -o out/robot.c",
            "export causes.toml --format m --controller --rig rig.toml -o out/robot.m",
            "export learnt.toml --format py --controller --rig rig.toml -o out/robot.py",
            "export learnt.toml --format c --controller --rig rig.toml -o out/robot.h",
        ],
    },
    Kind {
        files: &[
            "sample/recording.toml",
            "sample/data.csv",
            "sample/voltage.csv",
            "hanging.toml",
            "parameters.toml",
        ],
        commands: &[
            "import sample -o out",
            "fit sample sample --starts 1 --branches 2 -o out",
            "fit sample sample films/two --starts 1 --branches 1 --start parameters.toml -o out",
            "validate sample --params parameters.toml -o out",
            "predict voltage sample --params parameters.toml -o out/p.csv",
            "predict motion sample --params parameters.toml -o out/p.csv",
            "ageing films/one films/two -o out",
            "ageing films/one films/two --threshold 5 --cycles 4 --mount 0.1 -o out",
            "ageing films/one films/two --by day --compare paper -o out",
            "simulate --rig hanging.toml --params parameters.toml --voltage sample/voltage.csv -o out",
            "simulate --rig hanging.toml --params parameters.toml --drive sine:peak_V=3000,hz=1 --duration 2 -o out",
        ],
    },
    Kind {
        files: &[
            "hinge/recording.toml",
            "hinge/data.csv",
            "made/hinge/parameters.toml",
        ],
        commands: &[
            "import hinge -o out",
            "import hinge/data.csv",
            "fit hinge hinge -o out",
            "diagnose hinge -o out",
            "predict force hinge --params made/hinge/parameters.toml -o out/p.csv",
            "validate hinge --params made/hinge/parameters.toml -o out",
            "export made/hinge/parameters.toml --format c",
        ],
    },
    Kind {
        files: &[
            "axis/recording.toml",
            "axis/data.csv",
            "bare/axis.csv",
            "made/axis/parameters.toml",
        ],
        commands: &[
            "import axis -o out",
            "import bare/axis.csv --init",
            "fit axis axis -o out",
            "fit axis axis --objective motion -o out",
            "fit axis axis --objective motion --between held -o out",
            "fit axis axis --objective motion --cause joint_friction -o out",
            "diagnose axis -o out",
            "predict voltage axis --params made/axis/parameters.toml -o out/p.csv",
            "predict motion axis --params made/axis/parameters.toml -o out/p.csv",
            "predict motion axis --params made/axis/parameters.toml --begin 20",
            "validate axis --params made/axis/parameters.toml -o out",
            "export made/axis/parameters.toml --format m",
        ],
    },
    Kind {
        files: &[
            "coupon/recording.toml",
            "coupon/data.csv",
            "made/coupon/parameters.toml",
        ],
        commands: &[
            "import coupon -o out",
            "fit coupon coupon --branches 2 --starts 1 -o out",
            "diagnose coupon -o out",
            "predict force coupon --params made/coupon/parameters.toml -o out/p.csv",
            "validate coupon --params made/coupon/parameters.toml -o out",
            "export made/coupon/parameters.toml --format py",
        ],
    },
    Kind {
        files: &["batch.toml", "films", "hanging.toml"],
        commands: &[
            "batch batch.toml -o out",
            "batch films -o out",
            "ageing films/one films/two -o out",
        ],
    },
    Kind {
        files: &["made/batch"],
        commands: &["merge made/batch", "batch batch.toml -o made/batch"],
    },
    Kind {
        files: &["made/proof"],
        commands: &[
            "merge made/proof",
            "prove --rigs axis,bench,coupon --number 3 --shard 1/2 -o made/proof",
        ],
    },
    Kind {
        files: &["made/kept/axis"],
        commands: &["prove --cases made/kept/axis/cases --answers made/kept/axis/answers -o out"],
    },
    Kind {
        files: &["made/kept/bench"],
        commands: &["prove --cases made/kept/bench/cases --answers made/kept/bench/answers -o out"],
    },
    Kind {
        files: &["made/kept/coupon"],
        commands: &[
            "prove --cases made/kept/coupon/cases --answers made/kept/coupon/answers -o out",
        ],
    },
    Kind {
        files: &["files"],
        commands: &[
            "import SPOILED",
            "import SPOILED --init --force",
            "import SPOILED -o out",
        ],
    },
    // what is typed
    Kind {
        files: &[],
        commands: &[
            "simulate --rig rig.toml --params parameters.toml --drive sine:peak_V=3000,hz=1 --duration 2 -o out",
            "simulate --rig rig.toml --params parameters.toml --drive multisine:peak_V=4000,hz=0.3/0.7 --duration 2 --drive-rate 500 --noise 0.03 --coloured-noise 0.02 --noise-correlation 0.2 -o out",
            "simulate --rig rig.toml --params parameters.toml --drive sine:peak_V=3000,hz=1 --duration 2 --gap 0.5:0.2 --clock-offset 0.02 --stated-offset 0.01 --quantum 1 --rate 200 -o out",
            "simulate --rig rig.toml --params parameters.toml --drive sine:peak_V=3000,hz=1 --duration 2 --payload 2 --limit 3500 --flip-every 0.5 --day 2 --seed 5 -o out",
            "simulate --rig rig.toml --params parameters.toml --drive sine:peak_V=3000,hz=1 --duration 2 --effect joint_friction:torque=5e-4,presliding=6e-3 -o out",
            "fit film symmetric --starts 1 --branches 2 --bound mu_1=1e5..2e6 --fix J=80.0 --robust 3.0 --seed 2 -o out",
            "fit axis axis --objective motion --fix mass=100.0 -o out",
            "predict motion axis --params made/axis/parameters.toml --begin 20",
            "ageing films/one films/two --threshold 5 --loss 50 --cycles 4 --mount 0.1 -o out",
            "diagnose symmetric --only marker_offset --false-alarms 0.02 --relevant 5.0 -o out",
            "prove --rigs bench --number 1 --seed 3 -o out",
            "batch batch.toml --shard 1/2 -o out",
        ],
    },
];

/// What stands where a number stood.
const STRANGE: [&str; 26] = [
    "nan",
    "inf",
    "-inf",
    "1e300",
    "-1e300",
    "1e160",
    "1e-300",
    "0",
    "-0.0",
    "-1",
    "1",
    "1e3",
    "1e6",
    "1e9",
    "1e11",
    "1e19",
    "-1e19",
    "1e-9",
    "9999",
    "-9999",
    "\"\"",
    "\"x\"",
    "true",
    "18446744073709551616",
    "0.1",
    "3000",
];

/// Where the numbers of a text stand.
fn numbers_of(text: &str) -> Vec<(usize, usize)> {
    let bytes = text.as_bytes();
    let of = |b: u8| b.is_ascii_digit() || matches!(b, b'.' | b'-' | b'+' | b'e' | b'E');
    let word = |b: u8| b.is_ascii_alphanumeric() || b == b'_';
    let mut out = Vec::new();
    let mut i = 0;
    while i < bytes.len() {
        let begins = bytes[i].is_ascii_digit() && (i == 0 || !word(bytes[i - 1]));
        if begins {
            let from = if i > 0 && bytes[i - 1] == b'-' {
                i - 1
            } else {
                i
            };
            let to = (i..bytes.len())
                .find(|&j| !of(bytes[j]))
                .unwrap_or(bytes.len());
            if to == bytes.len() || !word(bytes[to]) {
                out.push((from, to));
            }
            i = to;
        }
        i += 1;
    }
    out
}

/// One spoiled file: what was done to it in words.
fn spoil(path: &Path, generator: &mut ChaCha12Rng) -> String {
    let text = fs::read_to_string(path).unwrap();
    let table = path.extension().is_some_and(|e| e == "csv");
    let strange = STRANGE[generator.random_range(0..STRANGE.len())];
    let cell = strange.trim_matches('"');
    let lines: Vec<&str> = text.lines().collect();
    let row = generator.random_range(0..lines.len());
    let (new, said) = match generator.random_range(0..8_u32) {
        0 => {
            let mut kept = lines.clone();
            kept.remove(row);
            (kept.join("\n"), format!("line {} removed", row + 1))
        }
        1 => {
            let mut kept = lines.clone();
            kept.insert(row, lines[row]);
            (kept.join("\n"), format!("line {} twice", row + 1))
        }
        2 if table => (
            lines[..row.max(1)].join("\n"),
            format!("cut after line {row}"),
        ),
        // a whole column, or a stretch of it
        3 | 4 if table => {
            let width = lines.last().unwrap().split(',').count();
            let column = generator.random_range(0..width);
            let from = if generator.random_range(0..2_u32) == 0 {
                6
            } else {
                row
            };
            let to = generator.random_range(from..lines.len().max(from + 1));
            let factor = [0.0, -1.0, 1e-3, 1e3, 1e6, 57.3, 100.0][generator.random_range(0..7)];
            let scaled = generator.random_range(0..2_u32) == 0;
            let changed = lines.iter().enumerate().map(|(i, line)| {
                if i < from || i > to {
                    return (*line).to_owned();
                }
                let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
                if let Some(c) = cells.get_mut(column) {
                    match c.parse::<f64>() {
                        Ok(v) if scaled => *c = format!("{}", v * factor),
                        // a column of that name would be printed
                        Err(_) if cell.parse::<f64>().is_ok_and(f64::is_nan) => {}
                        _ => *c = cell.to_owned(),
                    }
                }
                cells.join(",")
            });
            let how = if scaled {
                format!("times {factor}")
            } else {
                format!("`{cell}`")
            };
            (
                changed.collect::<Vec<_>>().join("\n"),
                format!(
                    "column {} of lines {} to {} {how}",
                    column + 1,
                    from + 1,
                    to + 1
                ),
            )
        }
        _ => {
            let places = numbers_of(&text);
            if places.is_empty() {
                return "nothing".into();
            }
            let (from, to) = places[generator.random_range(0..places.len())];
            let with = if table { cell } else { strange };
            let line = text[..from].lines().count();
            (
                format!("{}{with}{}", &text[..from], &text[to..]),
                format!("`{}` of line {line} to `{with}`", &text[from..to]),
            )
        }
    };
    fs::write(path, new + "\n").unwrap();
    said
}

/// A text in which one string is another.
fn other_word(text: &str, generator: &mut ChaCha12Rng) -> Option<(String, String)> {
    let long = "x".repeat(70_000);
    let words = [
        "",
        "robot",
        "axis",
        "../..",
        "/dev/null",
        "estimate",
        "*",
        "\u{e9}\u{1f600}",
        &long,
    ];
    let quotes: Vec<usize> = text.match_indices('"').map(|m| m.0).collect();
    let pairs: Vec<&[usize]> = quotes.chunks_exact(2).collect();
    let pair = *pairs.get(generator.random_range(0..pairs.len().max(1)))?;
    let with = words[generator.random_range(0..words.len())];
    let from = text[..pair[0]].lines().count();
    let was = &text[pair[0] + 1..pair[1]];
    let shown: String = with.chars().take(12).collect();
    Some((
        format!("{}{with}{}", &text[..=pair[0]], &text[pair[1]..]),
        format!("string `{was}` of line {from} to `{shown}`"),
    ))
}

/// A file of bytes, spoiled.
fn spoil_bytes(path: &Path, generator: &mut ChaCha12Rng) -> String {
    let mut bytes = fs::read(path).unwrap();
    if bytes.is_empty() {
        return "nothing".into();
    }
    // the beginning says what the rest is
    let near = generator.random_range(0..2_u32) == 0;
    let at = generator.random_range(
        0..if near {
            bytes.len().min(600)
        } else {
            bytes.len()
        },
    );
    let said = match generator.random_range(0..5_u32) {
        0 => {
            bytes.truncate(at);
            format!("cut after {at} bytes")
        }
        1 => {
            let end = (at + generator.random_range(1..200)).min(bytes.len());
            bytes.drain(at..end);
            format!("bytes {at} to {end} removed")
        }
        2 => {
            let end = (at + generator.random_range(1..200)).min(bytes.len());
            let twice = bytes[at..end].to_vec();
            bytes.splice(at..at, twice);
            format!("bytes {at} to {end} twice")
        }
        3 => {
            let end = (at + generator.random_range(1..9)).min(bytes.len());
            let with = [0x00, 0x7f, 0x80, 0xff][generator.random_range(0..4)];
            bytes[at..end].fill(with);
            format!("bytes {at} to {end} are {with:#x}")
        }
        _ => {
            let with = generator.random_range(0..256_u32) as u8;
            bytes[at] = with;
            format!("byte {at} is {with:#x}")
        }
    };
    fs::write(path, bytes).unwrap();
    said
}

/// What is typed with one number of it spoiled; how many starts and cases are asked for is a matter of time,
/// and stays.
fn spoil_words(command: &str, generator: &mut ChaCha12Rng) -> String {
    let stays = ["--starts ", "--number ", "--seed "];
    let places: Vec<(usize, usize)> = numbers_of(command)
        .into_iter()
        .filter(|(from, _)| {
            let before = &command[..*from];
            !before.ends_with(char::is_alphanumeric) && !stays.iter().any(|s| before.ends_with(s))
        })
        .collect();
    if places.is_empty() {
        return command.to_owned();
    }
    let (from, to) = places[generator.random_range(0..places.len())];
    let with = STRANGE[generator.random_range(0..STRANGE.len())].trim_matches('"');
    format!("{}{with}{}", &command[..from], &command[to..])
}

/// All files in a folder, sorted.
fn files_in(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut out = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                out.push(path);
            }
        }
    }
    out.sort();
    out
}

/// What is wrong with an ended run: nothing, or in words.
fn faults(dir: &Path, out: &End) -> Vec<String> {
    let mut wrong = Vec::new();
    match out.code {
        Some(0..=2) => {}
        Some(101) => wrong.push("panic".into()),
        _ => wrong.push(format!("ended by {}", out.how)),
    }
    if out.stderr.contains("panicked") && out.code != Some(101) {
        wrong.push("panic in a thread".into());
    }
    if out.code == Some(1) && !out.stderr.lines().any(|l| l.starts_with("deacal: ")) {
        wrong.push("no sentence".into());
    }
    if let Some(line) = figure_of_nothing(&unquoted(&out.stdout)) {
        wrong.push(format!(
            "prints `{}`",
            line.chars().take(200).collect::<String>()
        ));
    }
    let made = dir.join("out");
    let made = if made.is_dir() {
        files_in(&made)
    } else {
        Vec::new()
    };
    for path in made {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let Ok(text) = fs::read_to_string(&path) else {
            continue;
        };
        let numbers = |l: &&str| {
            l.chars()
                .all(|c| !c.is_alphabetic() || "naifeEN".contains(c))
        };
        let line = match name.rsplit('.').next() {
            // what a controller calls knows NaN; its numbers are none
            Some("c" | "h" | "m" | "py") if name.starts_with("robot.") => {
                let lines: Vec<&str> = text.lines().filter(numbers).collect();
                figure_of_nothing(&lines.join("\n")).map(str::to_owned)
            }
            Some("html") => {
                let shown = without(
                    &without(&text, "<script", "</script>"),
                    "<style",
                    "</style>",
                );
                figure_of_nothing(&unquoted(&shown)).map(str::to_owned)
            }
            Some("toml") if name == "parameters.toml" => parameter_of_nothing(&text),
            Some("json" | "csv" | "c" | "m" | "py") => {
                figure_of_nothing(&unquoted(&text)).map(str::to_owned)
            }
            _ => None,
        };
        if let Some(line) = line {
            let line: String = line.trim().chars().take(200).collect();
            wrong.push(format!("writes `{line}` in {name}"));
        }
    }
    wrong
}

/// A text without the lines that quote: a command, and what a file has where a number should be.
fn unquoted(text: &str) -> String {
    let quotes = [
        "deacal ",
        "found the number ",
        "found \"",
        "found \\\"",
        "found &quot;",
        "say NaN; taken as gaps",
        "make no number (",
    ];
    let own = |l: &&str| !quotes.iter().any(|q| l.contains(q));
    let lines: Vec<&str> = text.lines().filter(own).collect();
    lines.join("\n")
}

/// A text without what stands between two marks.
fn without(text: &str, from: &str, to: &str) -> String {
    let mut parts = text.split(from);
    let mut out = parts.next().unwrap_or("").to_owned();
    for part in parts {
        out.push_str(part.split_once(to).map_or("", |p| p.1));
    }
    out
}

/// A line of a parameter file that has NaN or infinity for an estimate; errors of what is held are none.
fn parameter_of_nothing(text: &str) -> Option<String> {
    let mut error = false;
    for line in text.lines().filter(|l| !l.starts_with('#')) {
        if let Some((key, _)) = line.split_once('=') {
            error = key.contains("_std_error") || key.contains("_ci95");
        }
        if !error && !line.starts_with("command =") && figure_of_nothing(line).is_some() {
            return Some(line.to_owned());
        }
    }
    None
}

/// One mutation: the command with what was done to it, how it ended, and what was wrong.
fn mutation(template: &Template, number: u64) -> (String, End, Vec<String>) {
    let mut generator = ChaCha12Rng::seed_from_u64(0x6d75_7461 + number);
    let dir = tempfile::tempdir().unwrap();
    copy(template.0.path(), dir.path());
    // robots a third of the time
    let kind = &KINDS[match generator.random_range(0..3_u32) {
        0 => generator.random_range(0..2),
        _ => generator.random_range(0..KINDS.len()),
    }];
    let mut command = kind.commands[generator.random_range(0..kind.commands.len())].to_owned();
    let mut said = Vec::new();
    if kind.files.is_empty() || generator.random_range(0..10_u32) == 0 {
        command = spoil_words(&command, &mut generator);
    }
    let files = if kind.files.is_empty() {
        0
    } else {
        generator.random_range(1..3_u32)
    };
    for _ in 0..files {
        let mut path = dir
            .path()
            .join(kind.files[generator.random_range(0..kind.files.len())]);
        if path.is_dir() {
            let all = files_in(&path);
            path = all[generator.random_range(0..all.len())].clone();
        }
        let name = path.strip_prefix(dir.path()).unwrap().display().to_string();
        command = command.replace("SPOILED", &name);
        let how = match fs::read_to_string(&path) {
            Ok(text) if text.lines().count() > 1 => match generator.random_range(0..8_u32) {
                0 => spoil_bytes(&path, &mut generator),
                1 | 2 => match other_word(&text, &mut generator) {
                    Some((new, how)) => {
                        fs::write(&path, new).unwrap();
                        how
                    }
                    None => spoil(&path, &mut generator),
                },
                _ => spoil(&path, &mut generator),
            },
            _ => spoil_bytes(&path, &mut generator),
        };
        said.push(format!("{name}: {how}"));
    }
    let end = within_limits(dir.path(), &command);
    let wrong = faults(dir.path(), &end);
    (format!("`{command}` with {}", said.join("; ")), end, wrong)
}

/// Runs mutations from `first` on, `count` of them, two at a time; what went wrong, in sentences.
fn mutate(first: u64, count: u64, frames: usize) -> Vec<String> {
    let template = Template::new(frames);
    let next = AtomicU64::new(first);
    let wrong = Mutex::new(Vec::new());
    let ended = Mutex::new(BTreeMap::<String, usize>::new());
    let slowest = Mutex::new((0.0, String::new()));
    let work = || loop {
        let number = next.fetch_add(1, Ordering::SeqCst);
        if number >= first + count {
            break;
        }
        let (what, end, faults) = mutation(&template, number);
        let told = end
            .stderr
            .lines()
            .find(|l| l.contains("panicked") || l.starts_with("deacal"));
        let told = told
            .unwrap_or(end.stderr.lines().last().unwrap_or(""))
            .to_owned();
        if std::env::var_os("DEACAL_MUTATIONS_SHOWN").is_some() {
            eprintln!("{number} {} {:.1} s {what} | {told}", end.how, end.took_s);
        }
        *ended.lock().unwrap().entry(end.how).or_default() += 1;
        let mut slowest = slowest.lock().unwrap();
        if end.took_s > slowest.0 {
            *slowest = (end.took_s, format!("{number}: {what}"));
        }
        for fault in faults {
            let fault = format!("{number}: {fault}: {what}: {told}");
            eprintln!("{fault}");
            wrong.lock().unwrap().push(fault);
        }
    };
    std::thread::scope(|scope| {
        scope.spawn(work);
        scope.spawn(work);
    });
    let (ended, slowest) = (ended.into_inner().unwrap(), slowest.into_inner().unwrap());
    eprintln!(
        "{count} mutations: {ended:?}; the longest {:.1} s, {}",
        slowest.0, slowest.1
    );
    wrong.into_inner().unwrap()
}

/// What is spoiled later works as long as it is not.
#[test]
#[ignore = "a minute; the first thing that the long form does"]
fn every_command_of_the_campaign_works() {
    let template = Template::new(1200);
    let mut wrong = Vec::new();
    for command in KINDS.iter().flat_map(|k| k.commands) {
        let dir = tempfile::tempdir().unwrap();
        copy(template.0.path(), dir.path());
        let command = command.replace("SPOILED", "files/small.mcap");
        let end = within_limits(dir.path(), &command);
        eprintln!("{:.1} s {} `{command}`", end.took_s, end.how);
        let faults = faults(dir.path(), &end);
        if end.code != Some(0) || !faults.is_empty() {
            wrong.push(format!("{command}: {faults:?} {}: {}", end.how, end.stderr));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn spoiled_files_and_words_end_in_a_sentence() {
    let wrong = mutate(0, 40, 300);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The long form: `DEACAL_MUTATIONS=2000 cargo test --release --test mutations -- --ignored --nocapture`,
/// from `DEACAL_MUTATIONS_FROM` on; `DEACAL_MUTATIONS_SHOWN=1` shows every run.
#[test]
#[ignore = "half an hour on two cores"]
fn two_thousand_spoiled_files_and_words_end_in_a_sentence() {
    let number =
        |name: &str, otherwise: u64| std::env::var(name).map_or(otherwise, |v| v.parse().unwrap());
    let wrong = mutate(
        number("DEACAL_MUTATIONS_FROM", 0),
        number("DEACAL_MUTATIONS", 2000),
        1200,
    );
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
