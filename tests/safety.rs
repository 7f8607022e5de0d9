//! Nothing is lost and nothing hangs: what was read or is somebody else's is never overwritten, a stop is
//! heard at once, and whatever moment a run is killed at, its results are wholly those of before or wholly
//! its own.
//!
//! The campaigns have a short form that always runs. The long one, 500 kills and 100 stops:
//! `DEACAL_KILLS=500 DEACAL_STOPS=100 cargo test --release --test safety -- --ignored --nocapture`
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const TWIN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/datasets/twin2026_delta");
const PARAMETERS: &str = "[film]\nmu_Pa = [1.12e6, 2.2e5]\nT_s = [0.7]\nJ = 80.0\n[forearm]\nnodes_deg = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]\ntorque_N_m = [-1.6e-3, -8e-4, -3e-4, 0.0, 3e-4, 8e-4, 1.6e-3]\n";

/// A folder with a recording `rec`, its `rig.toml` and a parameter file `p.toml`.
struct Room(tempfile::TempDir);

impl Room {
    fn new() -> Self {
        let room = Room(tempfile::tempdir().unwrap());
        fs::copy(format!("{TWIN}/rig.toml"), room.path("rig.toml")).unwrap();
        room.copy("rec", "rec");
        fs::write(room.path("p.toml"), PARAMETERS).unwrap();
        room
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A copy of the bundled symmetric recording, in the folder `name`, under the id `id`.
    fn copy(&self, name: &str, id: &str) {
        fs::create_dir_all(self.path(name)).unwrap();
        for file in ["motion.csv", "voltage.csv"] {
            let from = format!("{TWIN}/symmetric/{file}");
            fs::copy(from, self.path(name).join(file)).unwrap();
        }
        let text = fs::read_to_string(format!("{TWIN}/symmetric/recording.toml")).unwrap();
        let line = text.lines().find(|l| l.starts_with("id = ")).unwrap();
        let text = text.replace(line, &format!("id = {id:?}"));
        fs::write(self.path(name).join("recording.toml"), text).unwrap();
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_deacal"));
        command.current_dir(self.0.path()).args(arguments);
        command
    }

    fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs, expects success.
    fn done(&self, arguments: &[&str]) {
        let out = self.run(arguments);
        assert!(out.status.success(), "{arguments:?}: {}", words(&out));
    }

    /// Runs, expects failure, and gives the line that says why.
    fn refused(&self, arguments: &[&str]) -> String {
        let out = self.run(arguments);
        let text = words(&out);
        assert_eq!(out.status.code(), Some(1), "{arguments:?}: {text}");
        assert_eq!(text.trim_end().lines().count(), 1, "{text}");
        text
    }

    /// Starts without waiting.
    fn start(&self, arguments: &[&str]) -> Child {
        let mut command = self.command(arguments);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command.spawn().unwrap()
    }

    fn files(&self, name: &str) -> Option<BTreeMap<PathBuf, Vec<u8>>> {
        contents(&self.path(name))
    }

    /// Every file and folder of work that nobody holds any more.
    fn leftovers(&self) -> Vec<PathBuf> {
        let mut open = vec![self.0.path().to_owned()];
        let mut found = Vec::new();
        while let Some(folder) = open.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                if name.starts_with(".deacal-") {
                    found.push(path);
                } else if path.is_dir() {
                    open.push(path);
                }
            }
        }
        found
    }
}

fn words(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// All files below a folder but those of work in progress; none if the folder is not there.
fn contents(root: &Path) -> Option<BTreeMap<PathBuf, Vec<u8>>> {
    let mut out = BTreeMap::new();
    let mut open = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).ok()? {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if path.is_dir() {
                if !name.starts_with(".deacal-") {
                    open.push(path);
                }
            } else {
                let inside = path.strip_prefix(root).unwrap().to_owned();
                out.insert(inside, fs::read(&path).unwrap());
            }
        }
    }
    Some(out)
}

fn signal(child: &Child, name: &str) {
    let number = child.id().to_string();
    let sent = Command::new("kill").args([name, &number]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn nothing_is_written_onto_what_was_read_or_made_by_others() {
    let room = Room::new();
    fs::write(
        room.path("drive.csv"),
        "time_s,phi1_kV,phi2_kV,phi3_kV\n0,0,0,0\n1,1,1,1\n2,0,0,0\n",
    )
    .unwrap();
    let simulate = |to: &'static str| {
        [
            "simulate",
            "--rig",
            "rig.toml",
            "--params",
            "p.toml",
            "--voltage",
            "drive.csv",
            "-o",
            to,
        ]
    };
    let before = room.files("").unwrap();
    for id in ["motion", "voltage", "recording"] {
        room.copy("rec", id);
        let before = room.files("rec");
        // an id may take the name of an instrument's file, or of the next file of the same import
        if id != "recording" {
            let text = room.refused(&["import", "rec", "-o", "rec"]);
            assert!(
                text.contains(&format!("{id}.csv")) && text.contains("--force"),
                "{text}"
            );
            assert_eq!(room.files("rec"), before);
        }
    }
    room.copy("rec", "rec");
    for (arguments, file) in [
        (
            &[
                "predict",
                "voltage",
                "rec",
                "--params",
                "p.toml",
                "-o",
                "rec/voltage.csv",
            ][..],
            "voltage.csv",
        ),
        (&simulate("rec"), "recording.toml"),
    ] {
        let text = room.refused(arguments);
        assert!(text.contains(file) && text.contains("--force"), "{text}");
        assert_eq!(room.files("").unwrap(), before, "{arguments:?}");
    }
    // what has an ending of its own is never written onto parameters or a rig, whoever insists
    let predict = ["predict", "voltage", "rec", "--params", "p.toml"];
    let export = |format: &'static str| ["export", "p.toml", "--format", format];
    for (arguments, file, ending) in [
        (&predict[..], "p.toml", ".csv"),
        (&export("json"), "p.toml", ".json"),
        (&export("c"), "rig.toml", ".c"),
    ] {
        let onto = [arguments, &["-o", file, "--force"]].concat();
        let text = room.refused(&onto);
        assert!(text.contains(file) && text.contains(ending), "{text}");
        assert_eq!(room.files("").unwrap(), before, "{onto:?}");
    }
    // a report of somebody else is in the way: said before the work begins
    fs::create_dir(room.path("out")).unwrap();
    for (file, arguments) in [
        ("report.html", &["fit", "film", "no-such", "-o", "out"][..]),
        ("fit.json", &["fit", "coupon", "no-such", "-o", "out"]),
        ("plan.toml", &["fit", "sample", "no-such", "-o", "out"]),
        ("parameters.toml", &["fit", "axis", "no-such", "-o", "out"]),
        ("diagnosis.json", &["diagnose", "no-such", "-o", "out"]),
        ("ageing.json", &["ageing", "no-such", "-o", "out"]),
        (
            "validation.json",
            &["validate", "no-such", "--params", "p.toml", "-o", "out"],
        ),
        ("proof.json", &["prove", "--number", "1", "-o", "out"]),
    ] {
        fs::write(room.path("out").join(file), "mine").unwrap();
        let text = room.refused(arguments);
        assert!(text.contains(file) && text.contains("--force"), "{text}");
        assert_eq!(fs::read(room.path("out").join(file)).unwrap(), b"mine");
        fs::remove_file(room.path("out").join(file)).unwrap();
    }
    // its own results are another matter, and so is who insists
    for _ in 0..2 {
        room.done(&simulate("made"));
        room.done(&["import", "rec", "-o", "in"]);
        room.done(&[
            "predict", "voltage", "rec", "--params", "p.toml", "-o", "v.csv",
        ]);
    }
    fs::write(room.path("v.csv"), "mine").unwrap();
    let predict = [
        "predict", "voltage", "rec", "--params", "p.toml", "-o", "v.csv",
    ];
    assert!(room.refused(&predict).contains("changed"));
    room.done(&[&predict[..], &["--force"]].concat());
    assert_ne!(fs::read(room.path("v.csv")).unwrap(), b"mine");
    assert_eq!(room.leftovers(), Vec::<PathBuf>::new());
}

#[test]
fn an_id_that_leads_elsewhere_or_steers_the_terminal_is_refused() {
    let room = Room::new();
    for id in ["../../x", "/x", "a\u{1b}[2Jb", ""] {
        let arguments = [
            "simulate", "--rig", "rig.toml", "--params", "p.toml", "--drive",
        ];
        let out = room.run(&[&arguments[..], &["sine:peak_V=100,hz=1", "--id", id]].concat());
        assert_eq!(out.status.code(), Some(2), "{id:?}");
        assert!(!room.path("out").exists());
    }
    let text = fs::read_to_string(room.path("rec/recording.toml")).unwrap();
    let text = text.replace("id = \"rec\"", "id = \"a\\u001b[2Jb\"");
    fs::write(room.path("rec/recording.toml"), text).unwrap();
    assert!(!room.refused(&["import", "rec"]).contains('\u{1b}'));
    // what stands in a file or is its name is shown, not sent
    let name = "a\u{1b}[31m.csv";
    let table = "time_s,b\u{202e}c,d\n0,1,2\n1,2,3\n2,3,4\n";
    fs::write(room.path(name), table).unwrap();
    let out = room.run(&["import", name]);
    assert!(out.status.success(), "{}", words(&out));
    let said = String::from_utf8_lossy(&out.stdout).into_owned() + &words(&out);
    assert!(!said.contains(['\u{1b}', '\u{202e}']), "{said:?}");
    assert!(said.contains("a\\u{1b}[31m.csv"), "{said}");
    assert!(said.contains("b\\u{202e}c"), "{said}");
}

#[test]
fn a_pipe_is_refused_at_once() {
    let room = Room::new();
    let made = Command::new("mkfifo")
        .arg(room.path("pipe.csv"))
        .status()
        .unwrap();
    assert!(made.success());
    let text = fs::read_to_string(room.path("rec/recording.toml")).unwrap();
    let text = text.replace("\"voltage.csv\"", "\"../pipe.csv\"");
    fs::write(room.path("rec/recording.toml"), text).unwrap();
    for arguments in [
        &["import", "pipe.csv"][..],
        &["import", "rec"],
        &["export", "pipe.csv", "--format", "m"],
    ] {
        let mut child = room.start(arguments);
        let begin = Instant::now();
        while child.try_wait().unwrap().is_none() {
            if begin.elapsed() > Duration::from_secs(60) {
                child.kill().unwrap();
                panic!("{arguments:?} waits for the pipe");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let mut text = String::new();
        child
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut text)
            .unwrap();
        assert!(text.contains("pipe or a device"), "{text}");
    }
}

#[test]
fn a_result_that_does_not_fit_on_standard_output_is_an_error() {
    let room = Room::new();
    for arguments in [
        &["import", "rec", "--json"][..],
        &["import", "rec"],
        &["predict", "voltage", "rec", "--params", "p.toml"],
        &["export", "p.toml", "--format", "json"],
        &["completions", "bash"],
    ] {
        let full = File::options().write(true).open("/dev/full").unwrap();
        let out = room.command(arguments).stdout(full).output().unwrap();
        let text = words(&out);
        assert_eq!(out.status.code(), Some(1), "{arguments:?}: {text}");
        assert!(text.contains("standard output"), "{arguments:?}: {text}");
    }
    // a reader that has seen enough is none
    let mut child = room
        .command(&["import", "rec", "--json"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
}

#[test]
fn a_copy_is_no_further_evidence() {
    let room = Room::new();
    room.copy("other", "other");
    let fit = |more: &[&str]| -> serde_json::Value {
        let one = [
            "fit",
            "film",
            "rec",
            "--starts",
            "1",
            "--branches",
            "1",
            "--json",
            "-o",
            "out",
        ];
        let out = room.run(&[&one[..], more].concat());
        assert!(out.status.success(), "{}", words(&out));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let (once, twice) = (fit(&[]), fit(&["other"]));
    assert_eq!(once["parameters"], twice["parameters"]);
    assert!(
        twice["remarks"]
            .to_string()
            .contains("other holds the very numbers of rec")
    );
    let out = room.run(&["validate", "rec", "other", "--params", "p.toml", "-o", "v"]);
    assert!(
        String::from_utf8_lossy(&out.stdout).contains("very numbers"),
        "{}",
        words(&out)
    );
}

#[test]
fn a_copy_is_no_further_evidence_to_a_diagnosis_or_of_ageing() {
    let room = Room::new();
    room.copy("other", "other");
    let diagnosis = |more: &[&str]| -> serde_json::Value {
        let one = [
            "diagnose",
            "rec",
            "--only",
            "amplifier_gain",
            "--json",
            "-o",
            "out",
        ];
        let out = room.run(&[&one[..], more].concat());
        assert!(out.status.success(), "{}", words(&out));
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let (once, twice) = (diagnosis(&[]), diagnosis(&["other"]));
    for key in ["verdict", "candidates", "train_rmse_V", "probabilities"] {
        assert_eq!(once[key], twice[key], "{key}");
    }
    assert!(
        twice["remarks"]
            .to_string()
            .contains("other holds the very numbers of rec")
    );
    // held out, the copy of what is fitted would foretell itself
    let held = diagnosis(&["--holdout", "other"]);
    assert_eq!(held["holdout_rmse_V"], once["holdout_rmse_V"]);
    // the same capture under a later day shows no electrode that keeps
    let text = fs::read_to_string(room.path("other/recording.toml")).unwrap();
    fs::write(
        room.path("other/recording.toml"),
        text.replace("day = 1", "day = 2"),
    )
    .unwrap();
    let out = room.run(&["ageing", "rec", "other", "-o", "aged"]);
    assert!(
        words(&out).contains("other holds the very numbers of rec"),
        "{}",
        words(&out)
    );
}

#[test]
fn a_chunk_that_unpacks_to_gigabytes_is_refused_by_what_it_says() {
    let room = Room::new();
    let mut file = b"\x89MCAP0\r\n".to_vec();
    let mut record = |opcode: u8, body: &[u8]| {
        file.push(opcode);
        file.extend((body.len() as u64).to_le_bytes());
        file.extend(body);
    };
    record(1, &[0; 8]);
    let mut chunk = vec![0; 16];
    chunk.extend((8u64 << 30).to_le_bytes());
    chunk.extend([0; 4]);
    chunk.extend(4u32.to_le_bytes());
    chunk.extend(b"zstd");
    chunk.extend(64u64.to_le_bytes());
    chunk.extend([0; 64]);
    record(6, &chunk);
    fs::write(room.path("bomb.mcap"), file).unwrap();
    let text = room.refused(&["import", "bomb.mcap"]);
    assert!(text.contains("unpack to 8589934592"), "{text}");
}

unsafe extern "C" {
    /// What a process does at a signal: signal(2).
    #[link_name = "signal"]
    fn disposition(number: i32, handler: usize) -> usize;
}

#[test]
fn a_hang_up_ends_a_run_unless_it_was_asked_to_stay() {
    let room = Room::new();
    // SIGHUP is 1, SIG_DFL 0 and SIG_IGN 1 on every Unix; a child takes over what it was told, whatever the
    // tests themselves were
    for (told, code) in [(0, Some(129)), (1, None)] {
        let mut command = room.command(&["prove", "--number", "3", "--seed", "5", "-o", "p"]);
        // SAFETY: between fork and exec it calls signal(2) alone, which may be called there
        unsafe {
            command.pre_exec(move || {
                disposition(1, told);
                Ok(())
            });
        }
        let mut child = command
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        signal(&child, "-HUP");
        std::thread::sleep(Duration::from_millis(1500));
        let ended = child.try_wait().unwrap();
        assert_eq!(ended.and_then(|s| s.code()), code, "{told}");
        if code.is_none() {
            assert!(ended.is_none());
            signal(&child, "-TERM");
            assert_eq!(child.wait().unwrap().code(), Some(143));
        }
    }
}

/// What a campaign runs: a name, arguments that leave a set in `out`, and others that leave another one
/// there.
type Job = (&'static str, &'static str, &'static str);

const JOBS: [Job; 8] = [
    (
        "simulate",
        "simulate --rig rig.toml --params p.toml --drive sine:peak_V=3000,hz=1 --duration 2 -o out",
        "simulate --rig rig.toml --params p.toml --drive sine:peak_V=3000,hz=1 --duration 2 --seed 2 -o out",
    ),
    (
        "import",
        "import rec -o out",
        "import rec --also mat -o out",
    ),
    (
        "validate",
        "validate s --params p.toml -o out",
        "validate s --params p2.toml -o out",
    ),
    (
        "fit",
        "fit film s --branches 1 --starts 1 -o out",
        "fit film s --branches 0 --starts 1 -o out",
    ),
    (
        "ageing",
        "ageing h1 h2 -o out",
        "ageing h1 h2 --threshold 7 -o out",
    ),
    (
        "diagnose",
        "diagnose s --only marker_offset -o out",
        "diagnose s --only time_offset -o out",
    ),
    (
        "prove",
        "prove --number 4 --kinds clean --drive short -o out",
        "prove --number 4 --kinds clean --drive short -o out",
    ),
    (
        "batch",
        "batch batch.toml -o out",
        "batch batch2.toml -o out",
    ),
];

/// Jobs that take long, for stops alone: what a stop finds is a loop of every kind.
const LONG: [(&str, &str); 6] = [
    (
        "fit by the motion",
        "fit axis axis --objective motion --cause choose -o out",
    ),
    (
        "predict motion",
        "predict motion rec --params p.toml -o out/m.csv",
    ),
    ("validate, long", "validate rec s --params p.toml -o out"),
    ("diagnose, all", "diagnose s -o out"),
    ("fit robot", "fit robot s -o out"),
    ("prove of axes", "prove --rigs line --number 6 -o out"),
];

fn split(arguments: &str) -> Vec<&str> {
    arguments.split(' ').collect()
}

/// A room with short recordings `s` (a robot's) and `h1`, `h2` (of a hanging sample on two days).
fn furnished() -> Room {
    let room = Room::new();
    fs::write(room.path("p2.toml"), PARAMETERS.replace("1.12e6", "1.2e6")).unwrap();
    let strip = "[rig]\nid = \"strip\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\nmargin_mm = 3.0\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n";
    fs::write(room.path("strip.toml"), strip).unwrap();
    let robot = [
        "simulate", "--rig", "rig.toml", "--params", "p.toml", "--noise", "0.03", "--drive",
    ];
    room.done(
        &[
            &robot[..],
            &[
                "multisine:peak_V=4000,hz=0.3/0.7",
                "--duration",
                "8",
                "-o",
                "s",
            ],
        ]
        .concat(),
    );
    let film = "[film]\nmu_Pa = [4.4e5, 3e4]\nT_s = [0.7]\nJ = 80.0\n";
    fs::write(room.path("strip.params.toml"), film).unwrap();
    let strip = [
        "simulate",
        "--rig",
        "strip.toml",
        "--params",
        "strip.params.toml",
        "--electrode",
        "A",
    ];
    let drive = [
        "--noise",
        "0.03",
        "--drive",
        "sine:peak_V=5000,hz=0.5",
        "--duration",
        "12",
    ];
    for (name, day) in [("h1", "1"), ("h2", "2")] {
        let own = ["--day", day, "--seed", day, "--id", name, "-o", name];
        room.done(&[&strip[..], &drive, &own].concat());
    }
    let fit = "fit = \"sample --branches 1 --starts 1\"\n";
    let set = |n: &str| format!("[[set]]\nname = \"{n}\"\nrecordings = [\"{n}\"]\n");
    fs::write(
        room.path("batch.toml"),
        format!("{fit}{}{}", set("h1"), set("h2")),
    )
    .unwrap();
    fs::write(
        room.path("batch2.toml"),
        format!(
            "{}{}{}",
            fit.replace("branches 1", "branches 0"),
            set("h1"),
            set("h2")
        ),
    )
    .unwrap();
    axis(&room);
    room
}

/// An axis with friction in the folder `axis`: a mass on a spring, pushed by two sines.
fn axis(room: &Room) {
    let (mass, damping, stiffness, friction, step) = (0.3, 1.2, 60.0, 0.4, 1e-4);
    let (mut x, mut v) = (0.0_f64, 0.0_f64);
    let mut table = String::from("t_s,x_m,u_N\n");
    for i in 0..400_000 {
        let t = f64::from(i) * step;
        let push = 3.0 * (1.7 * t).sin() + 2.0 * (5.3 * t).sin();
        if i % 100 == 0 {
            let noise = 1e-6 * f64::from((i / 100 * 7919) % 101 - 50);
            table += &format!("{t:.2},{:.8},{push:.6}\n", x + noise);
        }
        let force = push - damping * v - stiffness * x - friction * (v / 1e-3).tanh();
        v += step * force / mass;
        x += step * v;
    }
    fs::create_dir_all(room.path("axis")).unwrap();
    fs::write(room.path("axis/data.csv"), table).unwrap();
    let manifest = "[recording]\nid = \"axis\"\nkind = \"axis\"\n[axis]\nfile = \"data.csv\"\ntime = \"t_s\"\n\
        position = \"x_m\"\ninput = \"u_N\"\nunits = { time = \"s\", position = \"m\", input = \"N\" }\n\
        input_gain = 1.0\nmass_kg = \"estimate\"\ndamping = \"estimate\"\nstiffness = \"estimate\"\n";
    fs::write(room.path("axis/recording.toml"), manifest).unwrap();
}

struct Dice(u64);

impl Dice {
    /// Between 0 and 1 (xorshift64*).
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn copy_all(files: &BTreeMap<PathBuf, Vec<u8>>, to: &Path) {
    for (name, bytes) in files {
        let path = to.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }
}

type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Of a set what is in one folder of it, beside its folders (`""`), or all of it (`"*"`), without what a
/// proof and a run that lasts keep of what they have done, and without what tells shards of whose plan they
/// are.
fn of_part(files: &Files, part: &str) -> Files {
    let kept = ["trials.part.jsonl", "searches.part.jsonl", "campaign.json"];
    let mut out = files.clone();
    out.retain(|path, _| {
        let name = path.file_name().unwrap_or_default();
        let folder = path.parent().unwrap_or(Path::new(""));
        let in_work = name.to_string_lossy().starts_with(".deacal-");
        let named = !in_work && !kept.iter().any(|k| name == *k);
        named && (part == "*" || folder == Path::new(part))
    });
    out
}

/// Whether files are those of before or those of after.
fn place(there: &Files, old: &Files, new: &Files) -> Option<&'static str> {
    match there {
        files if files == old => Some("old"),
        files if files == new => Some("new"),
        _ => None,
    }
}

/// What a kill left of a part of `out`. Cut off between two renames, the mark says so, and the next reader
/// ends it.
fn state(
    room: &Room,
    part: &str,
    looks: &dyn Fn() -> Option<&'static str>,
) -> Option<&'static str> {
    looks().or_else(|| {
        let folder = room.path("out").join(part);
        if !folder.join(".deacal-work/commit").exists() {
            return None;
        }
        deacal::report::output::settle(&folder).unwrap();
        looks()
            .filter(|s| *s == "new")
            .map(|_| "ended by the reader")
    })
}

/// Kills runs at random moments, every other one onto earlier results, and checks what is there.
fn kills(count: usize, jobs: &[&str], seed: u64) {
    let room = furnished();
    let mut dice = Dice(seed);
    let jobs: Vec<&Job> = JOBS.iter().filter(|j| jobs.contains(&j.0)).collect();
    // both sets of each job, and how long the second takes
    let known: Vec<_> = jobs
        .iter()
        .map(|(name, old, new)| {
            let mut sets = Vec::new();
            let mut took = Duration::ZERO;
            for arguments in [old, new] {
                let _ = fs::remove_dir_all(room.path("out"));
                let begin = Instant::now();
                room.done(&split(arguments));
                took = begin.elapsed();
                sets.push(room.files("out").unwrap());
            }
            // what is replaced and what stays, as the second run onto the first leaves it
            let _ = fs::remove_dir_all(room.path("out"));
            copy_all(&sets[0], &room.path("out"));
            room.done(&split(new));
            (
                *name,
                *new,
                took,
                sets[0].clone(),
                sets[1].clone(),
                room.files("out").unwrap(),
            )
        })
        .collect();
    let mut tally: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for i in 0..count {
        let (name, new, took, old, fresh, over) = &known[i % known.len()];
        let onto_old = (i / known.len()) % 2 == 0;
        let _ = fs::remove_dir_all(room.path("out"));
        if onto_old {
            copy_all(old, &room.path("out"));
        }
        let mut child = room.start(&split(new));
        // half of them while results are written
        let share = if dice.unit() < 0.5 {
            dice.unit()
        } else {
            0.85 + 0.2 * dice.unit()
        };
        std::thread::sleep(took.mul_f64(share));
        child.kill().unwrap();
        let ended = child.wait().unwrap();
        let killed = ended.signal() == Some(9);
        // a batch puts each of its sets in place when it has it
        let state = match *name {
            "batch" => {
                let before = onto_old.then_some(old);
                let after = if onto_old { over } else { fresh };
                let all = ["h1", "h2", ""].map(|part| {
                    let of = |all: &Files| of_part(all, part);
                    let old = before.map(of).unwrap_or_default();
                    state(&room, part, &|| {
                        let there = room.files("out").unwrap_or_default();
                        let there = of_part(&there, part);
                        place(&there, &old, &of(after))
                    })
                });
                let new = all.iter().filter(|s| **s != Some("old")).count();
                let state = ["old", "one set is new", "both sets are new", "new"][new];
                (!all.contains(&None)).then_some(state)
            }
            _ => state(&room, "", &|| {
                let there = room.files("out").unwrap_or_default();
                let empty = Files::new();
                let (old, new) = if onto_old {
                    (old, over)
                } else {
                    (&empty, fresh)
                };
                place(&of_part(&there, "*"), old, new)
            }),
        };
        let state = state.unwrap_or_else(|| panic!("{name}: kill {i}: neither old nor new"));
        *tally
            .entry((name, if killed { state } else { "not killed" }))
            .or_default() += 1;
        // the same command again: the whole set, the same bytes, and nothing beside it
        if i % 5 == 0 || ["prove", "batch"].contains(name) {
            room.done(&split(new));
            let wanted = if onto_old { over } else { fresh };
            assert!(
                room.files("out").as_ref() == Some(wanted),
                "{name}: kill {i}: other bytes"
            );
            assert_eq!(room.leftovers(), Vec::<PathBuf>::new(), "{name}: kill {i}");
        }
    }
    eprintln!("{count} kills: {tally:?}");
}

/// Asks runs to stop at random moments, and gives the times that they took, s.
fn stops(count: usize, jobs: &[&str], seed: u64) -> Vec<f64> {
    let room = furnished();
    let mut dice = Dice(seed);
    let short = JOBS.iter().map(|j| (j.0, j.1));
    let jobs: Vec<(&str, &str)> = short.chain(LONG).filter(|j| jobs.contains(&j.0)).collect();
    let took: Vec<Duration> = jobs
        .iter()
        .map(|job| {
            let _ = fs::remove_dir_all(room.path("out"));
            let begin = Instant::now();
            room.done(&split(job.1));
            eprintln!("{}: {:.1} s", job.0, begin.elapsed().as_secs_f64());
            begin.elapsed()
        })
        .collect();
    let mut times = Vec::new();
    let mut i = 0;
    while times.len() < count {
        let (job, took) = (jobs[i % jobs.len()], took[i % jobs.len()]);
        i += 1;
        let _ = fs::remove_dir_all(room.path("out"));
        let mut child = room.start(&split(job.1));
        // the first milliseconds belong to the loader
        std::thread::sleep(Duration::from_millis(20) + took.mul_f64(0.9 * dice.unit()));
        let (name, code) = if dice.unit() < 0.5 {
            ("-INT", 130)
        } else {
            ("-TERM", 143)
        };
        if child.try_wait().unwrap().is_some() {
            continue;
        }
        let begin = Instant::now();
        signal(&child, name);
        let ended = child.wait().unwrap();
        if ended.success() {
            continue; // done before it heard
        }
        times.push(begin.elapsed().as_secs_f64());
        if times.last().is_some_and(|t| *t > 0.5) {
            eprintln!("{}: {:.2} s", job.0, begin.elapsed().as_secs_f64());
        }
        let mut text = String::new();
        child
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut text)
            .unwrap();
        assert_eq!(ended.code(), Some(code), "{}: {text}", job.0);
        assert!(text.contains("stopped by"), "{}: {text}", job.0);
        assert_eq!(room.leftovers(), Vec::<PathBuf>::new(), "{}", job.0);
        if !job.0.starts_with("prove") && job.0 != "batch" && text.contains("nothing was written") {
            assert!(!room.path("out").exists(), "{}", job.0);
        }
    }
    times.sort_by(f64::total_cmp);
    let place = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    eprintln!(
        "{count} stops: median {:.3} s, 99 % {:.3} s, longest {:.3} s",
        place(0.5),
        place(0.99),
        place(1.0)
    );
    times
}

fn number(name: &str, otherwise: usize) -> usize {
    std::env::var(name)
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(otherwise)
}

#[test]
fn killed_at_any_moment_a_set_is_wholly_old_or_wholly_new() {
    kills(24, &["simulate", "import"], 7);
}

#[test]
fn a_stop_is_heard_within_half_a_second() {
    let times = stops(8, &["import", "diagnose"], 3);
    let late = times.iter().filter(|t| **t > 0.5).count();
    assert!(late <= 1, "{times:?}");
}

#[test]
fn a_proof_that_was_stopped_goes_on_and_gives_the_same_bytes() {
    let room = Room::new();
    let prove = [
        "prove", "--number", "4", "--seed", "2", "--drive", "short", "-o", "out",
    ];
    room.done(&prove);
    let whole = room.files("out").unwrap();
    fs::remove_dir_all(room.path("out")).unwrap();
    let mut child = room.start(&prove);
    let part = room.path("out/trials.part.jsonl");
    let cases = || fs::read_to_string(&part).map_or(0, |t| t.lines().count());
    while cases() < 2 && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(20));
    }
    signal(&child, "-TERM");
    assert_eq!(child.wait().unwrap().code(), Some(143));
    let mut text = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut text)
        .unwrap();
    assert!(text.contains("goes on from there"), "{text}");
    let kept = fs::read_to_string(&part).unwrap();
    assert!(kept.lines().count() >= 2, "{kept}");
    // another run keeps its hands off
    let other = room.refused(&["prove", "--number", "5", "-o", "out"]);
    assert!(
        other.contains("another run") && other.contains("--force"),
        "{other}"
    );
    assert_eq!(fs::read_to_string(&part).unwrap(), kept);
    room.done(&prove);
    assert!(room.files("out").unwrap() == whole);
    assert!(!part.exists());
}

/// A proof of many cases holds few files open: fewer than it keeps.
#[test]
fn a_proof_that_keeps_its_cases_holds_few_files_open() {
    let room = Room::new();
    let program = env!("CARGO_BIN_EXE_deacal");
    let prove = "prove --rigs line --number 6 --keep kept -o out";
    let out = Command::new("sh")
        .args(["-c", &format!("ulimit -n 24; exec '{program}' {prove}")])
        .current_dir(room.path(""))
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", words(&out));
    let kept = room.files("kept").unwrap().len();
    assert!(kept > 24, "{kept} files tell nothing");
}

#[test]
fn answers_are_looked_for_before_the_work_begins() {
    let room = Room::new();
    fs::create_dir_all(room.path("cases/one/train")).unwrap();
    let text = room.refused(&["prove", "--cases", "cases", "-o", "out"]);
    assert!(
        text.contains("truth.json") && text.contains("--answers"),
        "{text}"
    );
    assert!(!room.path("out").exists());
}

#[test]
fn two_at_once_leave_the_set_of_one_of_them() {
    let room = furnished();
    let (_, old, new) = JOBS[0];
    for _ in 0..4 {
        let _ = fs::remove_dir_all(room.path("out"));
        let mut children = [old, new].map(|job| room.start(&split(job)));
        let codes = children.each_mut().map(|c| c.wait().unwrap().code());
        assert_eq!(codes, [Some(0); 2]);
        let both = room.files("out").unwrap();
        let either = [old, new].map(|job| {
            let _ = fs::remove_dir_all(room.path("out"));
            room.done(&split(job));
            room.files("out").unwrap()
        });
        assert!(either.contains(&both));
    }
}

#[test]
#[ignore = "a campaign of minutes; the short forms above run always"]
fn the_long_campaigns() {
    let names: Vec<&str> = JOBS.iter().map(|j| j.0).collect();
    let (many_kills, many_stops) = (number("DEACAL_KILLS", 500), number("DEACAL_STOPS", 100));
    if many_stops > 0 {
        let all: Vec<&str> = names.iter().copied().chain(LONG.map(|j| j.0)).collect();
        let times = stops(many_stops, &all, 11);
        let late = times.iter().filter(|t| **t > 0.5).count();
        assert!(
            late <= many_stops / 100,
            "{late} of {many_stops} later than 0.5 s"
        );
    }
    kills(many_kills, &names, 13);
}

/// Largest memory of a run, kB, as the kernel counts it.
#[cfg(target_os = "linux")]
fn peak_kb(room: &Room, arguments: &[&str]) -> f64 {
    let mut child = room
        .command(arguments)
        .env("RAYON_NUM_THREADS", "2")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0.0_f64;
    let ended = loop {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let own = text.lines().find_map(|l| l.strip_prefix("VmHWM:"));
        let kb = own.and_then(|l| l.trim().trim_end_matches(" kB").parse::<f64>().ok());
        peak = peak.max(kb.unwrap_or(0.0));
        match child.try_wait().unwrap() {
            Some(ended) => break ended,
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let mut said = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut said)
        .unwrap();
    assert!(ended.success(), "{arguments:?}: {said}");
    peak
}

/// Twelve hours at 100 Hz are 4.32 million frames: in 2 GB each may take 463 bytes. A plan makes a fit
/// compare stretches of recordings that it could hold whole, as it does by itself with longer ones.
#[test]
#[cfg(target_os = "linux")]
fn memory_grows_by_less_than_twelve_hours_in_two_gigabytes() {
    const BYTES_A_FRAME: f64 = 463.0;
    let room = Room::new();
    let axis = "  { order = 4, cutoff_hz = 3.0, noise_mm = 0.03 },\n";
    let plan = format!(
        "[[recording]]\nrecording = \"long\"\noffset_s = 0.0\nstretches = {{ count = 10, length_s = 30.0 }}\nsmoothing = [\n{}]\n",
        axis.repeat(3)
    );
    fs::write(room.path("plan.toml"), plan).unwrap();
    let lengths_s = ["1000", "4000"];
    for length_s in lengths_s {
        room.done(&[
            "simulate",
            "--rig",
            "rig.toml",
            "--params",
            "p.toml",
            "--drive",
            "multisine:peak_V=3000,hz=0.1/0.27/0.7",
            "--duration",
            length_s,
            "--drive-rate",
            "200",
            "--noise",
            "0.03",
            "--id",
            "long",
            "-o",
            &format!("long{length_s}"),
        ]);
    }
    let more = 100.0 * 3000.0;
    let growth = |arguments: &dyn Fn(&str) -> Vec<String>| {
        let [short, long] = lengths_s.map(|l| {
            let arguments = arguments(l);
            peak_kb(
                &room,
                &arguments.iter().map(String::as_str).collect::<Vec<_>>(),
            )
        });
        println!(
            "{}: {short:.0} kB and {long:.0} kB",
            arguments("").join(" ")
        );
        1024.0 * (long - short) / more
    };
    let words = |text: String| text.split(' ').map(str::to_owned).collect();
    let fit = growth(&|l| {
        words(format!(
            "fit film long{l} --plan plan.toml --branches 1 --starts 1 -q -o fit{l}"
        ))
    });
    let import = growth(&|l| words(format!("import long{l} -q -o import{l}")));
    let file = growth(&|l| {
        words(format!(
            "import long{l}/motion.csv long{l}/voltage.csv -q -o file{l}"
        ))
    });
    println!("bytes a frame: fit film {fit:.0}, import REC {import:.0}, import FILE {file:.0}");
    assert!(
        fit < BYTES_A_FRAME && import < BYTES_A_FRAME && file < 10.0,
        "{fit} {import} {file}"
    );
    // what the fit says of it
    let json = fs::read_to_string(room.path("fit4000/fit.json")).unwrap();
    assert!(
        json.contains("1.11 h are more than a fit holds") && json.contains("10 stretches of 30 s")
    );
}
