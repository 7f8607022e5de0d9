//! Long runs and many runs: a run that was killed goes on and gives the same bytes, shards give the bytes of
//! one run, and a batch says which films stand out.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use serde_json::Value;

const RIG: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/datasets/twin2026_delta/rig.toml"
);
const SAMPLE_RIG: &str = "[rig]\nid = \"hanging\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\n\
    margin_mm = 3.0\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n";

/// A folder with a robot's parameters in `p.toml` and a hanging sample's rig in `hanging.toml`.
struct Room(tempfile::TempDir);

impl Room {
    fn new() -> Self {
        let room = Room(tempfile::tempdir().unwrap());
        let film = "[film]\nmu_Pa = [1.12e6, 2.2e5, 5e4]\nT_s = [0.3, 6.0]\nJ = 80.0\neps_r = 2.8\n[forearm]\n\
            nodes_deg = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]\n\
            torque_N_m = [-1.6e-3, -8e-4, -3e-4, 0.0, 3e-4, 8e-4, 1.6e-3]\n";
        fs::write(room.path("p.toml"), film).unwrap();
        fs::write(room.path("hanging.toml"), SAMPLE_RIG).unwrap();
        room
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// `deacal` in the folder `within`, as it is run outside of any Slurm task.
    fn command(&self, within: &str, words: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_deacal"));
        fs::create_dir_all(self.path(within)).unwrap();
        command.current_dir(self.path(within)).args(words);
        for (name, _) in std::env::vars().filter(|v| v.0.starts_with("SLURM_")) {
            command.env_remove(name);
        }
        command
    }

    fn run(&self, within: &str, words: &[&str]) -> Output {
        self.command(within, words).output().unwrap()
    }

    fn done(&self, within: &str, words: &[&str]) -> String {
        let out = self.run(within, words);
        assert!(out.status.success(), "{words:?}: {}", said(&out));
        String::from_utf8(out.stdout).unwrap()
    }

    fn refused(&self, within: &str, words: &[&str]) -> String {
        let out = self.run(within, words);
        assert_eq!(out.status.code(), Some(1), "{words:?}: {}", said(&out));
        said(&out)
    }

    /// A simulated recording of the robot, `duration` long.
    fn robot(&self, name: &str, duration: &str, seed: &str) {
        let words = [
            "simulate",
            "--rig",
            RIG,
            "--params",
            "p.toml",
            "--drive",
            "multisine:peak_V=4000,hz=0.3/0.7/1.9",
            "--noise",
            "0.03",
            "--duration",
            duration,
            "--seed",
            seed,
            "--id",
            name,
            "-o",
            name,
            "-q",
        ];
        self.done("", &words);
    }
}

fn said(out: &Output) -> String {
    String::from_utf8_lossy(&out.stderr).into_owned()
}

/// All files below a folder.
fn contents(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut out = BTreeMap::new();
    let mut open = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let bytes = fs::read(&path).unwrap();
                out.insert(path.strip_prefix(root).unwrap().to_owned(), bytes);
            }
        }
    }
    out
}

/// Starts a run in the folder `cut`, kills it when it has written down what it found so far, lets it go on,
/// and holds the results against those of an unbroken run. What is kept is that of this run: one of another
/// command begins anew.
fn killed_and_resumed(room: &Room, words: &[&str], pieces: usize) {
    let whole = Instant::now();
    room.done("whole", words);
    let whole = whole.elapsed();
    let part = room.path("cut/out/searches.part.jsonl");
    let mut child = room.command("cut", words).spawn().unwrap();
    let begin = Instant::now();
    loop {
        let lines = fs::read_to_string(&part).map_or(0, |text| text.lines().count());
        if lines > pieces {
            break;
        }
        assert!(
            child.try_wait().unwrap().is_none() && begin.elapsed() < 20 * whole,
            "{words:?}: nothing was kept of a run of {whole:?}"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!room.path("cut/out/report.html").exists(), "not cut off");
    room.done("cut", words);
    assert!(!part.exists(), "{words:?}: the pieces are still there");
    assert!(
        contents(&room.path("cut/out")) == contents(&room.path("whole/out")),
        "{words:?}: other bytes"
    );
}

#[test]
fn a_killed_fit_goes_on_and_gives_the_same_bytes() {
    let room = Room::new();
    // each start takes long enough to be kept, on a fast machine too
    room.robot("a", "360", "1");
    let words = ["fit", "robot", "../a", "--starts", "60", "-o", "out", "-q"];
    killed_and_resumed(&room, &words, 20);
}

#[test]
fn a_killed_diagnosis_goes_on_and_gives_the_same_bytes() {
    let room = Room::new();
    room.robot("a", "300", "1");
    room.robot("b", "60", "2");
    let words = ["diagnose", "../a", "--holdout", "../b", "-o", "out", "-q"];
    killed_and_resumed(&room, &words, 3);
}

#[test]
fn shards_of_a_proof_give_the_bytes_of_one_run() {
    let room = Room::new();
    let own = ["prove", "--rigs", "axis", "--number", "7", "-q", "-o"];
    room.done("", &[&own[..], &["one"]].concat());
    let shard = |i: &'static str| [&own[..], &["many", "--shard", i]].concat();
    room.done("", &shard("1/3"));
    let text = room.refused("", &["merge", "many"]);
    assert!(
        text.contains("2 of 3 parts are missing: shard-2-of-3, shard-3-of-3"),
        "{text}"
    );
    room.done("", &shard("3/3"));
    // as a task of an array of Slurm
    let out = room
        .command("", &[&own[..], &["many"]].concat())
        .envs([
            ("SLURM_ARRAY_TASK_ID", "8"),
            ("SLURM_ARRAY_TASK_MIN", "7"),
            ("SLURM_ARRAY_TASK_COUNT", "3"),
            ("SLURM_CPUS_PER_TASK", "1"),
        ])
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", said(&out));
    // one that is there is not run again: an array that is queued anew costs nothing
    let file = room.path("many/shard-2-of-3/shard.json");
    let before = fs::metadata(&file).unwrap().modified().unwrap();
    room.done("", &shard("2/3"));
    assert_eq!(fs::metadata(&file).unwrap().modified().unwrap(), before);
    // another seed and another number of shards are another campaign
    for other in [
        vec!["--seed", "2", "--shard", "1/3"],
        vec!["--shard", "1/4"],
    ] {
        let text = room.refused("", &[&own[..], &["many"], &other[..]].concat());
        assert!(
            text.contains("campaign.json") && text.contains("-o"),
            "{text}"
        );
    }
    room.done("", &["merge", "many", "-q"]);
    for name in ["proof.json", "trials.json", "report.html"] {
        let [one, many] = ["one", "many"].map(|d| fs::read(room.path(d).join(name)).unwrap());
        assert!(one == many, "{name}: other bytes");
    }
    // a shard of another build is refused
    let text = fs::read_to_string(&file).unwrap();
    fs::write(
        &file,
        text.replacen("\"program\": \"deacal ", "\"program\": \"deacal 9.", 1),
    )
    .unwrap();
    let text = room.refused("", &["merge", "many"]);
    assert!(
        text.contains("shard-2-of-3") && text.contains("deacal 9."),
        "{text}"
    );
}

/// Hanging samples of two batches over days, one of them of a film that is a fifth stiffer.
fn samples(room: &Room, count: usize, odd: usize) {
    for i in 0..count {
        // films of a batch differ by some 2 %
        let own = 1.0 + 0.02 * ((i * 7 % 11) as f64 - 5.0) / 5.0;
        let scale = own * if i == odd { 1.25 } else { 1.0 };
        let mu = [4.4e5, 3e4, 2.5e4].map(|m| m * scale);
        let film = format!("[film]\nmu_Pa = {mu:?}\nT_s = [0.12, 2.0]\nJ = 80.0\n");
        fs::write(room.path("film.toml"), film).unwrap();
        let name = format!("films/film-{i:02}");
        let (seed, day) = (i.to_string(), (i % 4).to_string());
        let words = [
            "simulate",
            "--rig",
            "hanging.toml",
            "--params",
            "film.toml",
            "--drive",
            "sine:peak_V=5000,hz=0.5",
            "--duration",
            "10",
            "--noise",
            "0.02",
            "--seed",
            &seed,
            "--day",
            &day,
            "--id",
            &seed,
            "-o",
            &name,
            "-q",
        ];
        room.done("", &words);
    }
}

const FILMS: usize = 24;

#[test]
fn a_batch_finds_the_film_that_stands_out_and_shards_give_its_bytes() {
    let room = Room::new();
    samples(&room, FILMS, 4);
    let mut plan = "fit = \"sample --branches 2 --starts 2\"\n".to_owned();
    for i in 0..FILMS {
        let batch = ["A", "B"][i % 2];
        plan += &format!(
            "[[set]]\nname = \"film-{i:02}\"\nrecordings = [\"films/film-{i:02}\"]\nbatch = \"{batch}\"\n"
        );
    }
    fs::write(room.path("plan.toml"), &plan).unwrap();
    let one = ["batch", "plan.toml", "-o", "one", "--json"];
    let json: Value = serde_json::from_str(&room.done("", &one)).unwrap();
    assert_eq!(json["n_sets"], FILMS);
    assert_eq!(json["n_failed"], 0, "{json}");
    let out: Vec<&str> = json["outliers"]
        .as_array()
        .unwrap()
        .iter()
        .map(|o| o["set"].as_str().unwrap())
        .collect();
    assert_eq!(out, ["film-04"], "{}", json["outliers"]);
    let parameters = json["parameters"].as_array().unwrap();
    let mu = parameters
        .iter()
        .find(|p| p["parameter"] == "mu_1")
        .unwrap();
    let middle = mu["middle"].as_f64().unwrap();
    assert!((middle / 4.4e5 - 1.0).abs() < 0.02, "{mu}");
    assert_eq!(json["sets"][3]["batch"], "B");
    assert_eq!(json["sets"][3]["day"], 3.0);
    for name in [
        "batch.json",
        "report.html",
        "film-04/report.html",
        "film-04/fit.json",
    ] {
        assert!(room.path("one").join(name).is_file(), "{name}");
    }
    // as shards, of which one is missing at first
    for shard in ["1/3", "3/3"] {
        room.done("", &["batch", "plan.toml", "-o", "many", "--shard", shard]);
    }
    let text = room.refused("", &["merge", "many"]);
    assert!(
        text.contains("8 of 24 parts are missing: film-01, film-04, film-07, film-10"),
        "{text}"
    );
    assert!(!room.path("many/batch.json").exists());
    room.done("", &["batch", "plan.toml", "-o", "many", "--shard", "2/3"]);
    room.done("", &["merge", "many"]);
    assert!(
        contents(&room.path("one")) == contents(&room.path("many")),
        "other bytes"
    );
    // nothing is done twice, and what is lost is done again
    let time = |name: &str| fs::metadata(room.path(name)).unwrap().modified().unwrap();
    let before = time("one/film-03/fit.json");
    fs::remove_file(room.path("one/film-02/set.json")).unwrap();
    let text = room.done("", &["batch", "plan.toml", "-o", "one"]);
    assert!(text.contains("23 sets were there already"), "{text}");
    assert_eq!(time("one/film-03/fit.json"), before);
    assert!(contents(&room.path("one")) == contents(&room.path("many")));
    // other inputs are noticed: by merge, and by the next run
    let file = room.path("films/film-05/recording.toml");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, format!("{text}\n# measured again\n")).unwrap();
    let text = room.refused("", &["merge", "one"]);
    assert!(
        text.contains("film-05") && text.contains("changed"),
        "{text}"
    );
    let text = room.refused("", &["batch", "plan.toml", "-o", "many", "--shard", "1/3"]);
    assert!(text.contains("other parts or other inputs"), "{text}");
    let text = room.done("", &["batch", "plan.toml", "-o", "one"]);
    assert!(text.contains("23 sets were there already"), "{text}");
}

#[test]
fn a_folder_is_a_batch_and_what_cannot_be_fitted_is_said() {
    let room = Room::new();
    samples(&room, 2, 9);
    fs::write(room.path("films/film-01/recording.toml"), "[recording]\n").unwrap();
    let text = room.refused("", &["batch", "films"]);
    assert!(text.contains("film-01"), "{text}");
    let good = fs::read_to_string(room.path("films/film-00/recording.toml")).unwrap();
    fs::write(room.path("films/film-01/recording.toml"), &good).unwrap();
    let motion = fs::read_dir(room.path("films/film-01"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .find(|p| p.extension().is_some_and(|e| e == "csv"))
        .unwrap();
    fs::write(motion, "nothing\n").unwrap();
    let json = room.done("", &["batch", "films", "--json"]);
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["n_sets"], 2);
    assert_eq!(json["n_failed"], 1);
    assert_eq!(json["sets"][0]["fit"], "sample");
    let why = json["sets"][1]["failure"].as_str().unwrap();
    assert!(why.contains("film-01"), "{why}");
    let text = room.refused("", &["batch", "films/film-00"]);
    assert!(text.contains("deacal fit"), "{text}");
    for (plan, word) in [
        (
            "[[set]]\nname = \"../x\"\nrecordings = [\"films/film-00\"]\n",
            "name",
        ),
        ("[[set]]\nname = \"x\"\nrecordings = []\n", "no recordings"),
        (
            "[[set]]\nname = \"x\"\nrecordings = [\"films/film-00\"]\nfit = \"film --nonsense\"\n",
            "--nonsense",
        ),
        ("[[set]]\nname = \"x\"\nwhat = 1\nrecordings = []\n", "what"),
    ] {
        fs::write(room.path("plan.toml"), plan).unwrap();
        let text = room.refused("", &["batch", "plan.toml"]);
        assert!(text.contains(word), "{text}");
    }
}
