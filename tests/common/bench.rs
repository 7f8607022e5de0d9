//! Short recordings of every kind with rigs and parameters, and the program run on them within limits.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

const TWIN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/datasets/twin2026_delta");
const FITTED: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/fits/twin2026_delta/parameters.toml"
);

/// The first `lines` lines of a bundled file.
fn head(from: &str, to: &Path, lines: usize) {
    let text = fs::read_to_string(from).unwrap();
    let kept: Vec<&str> = text.lines().take(lines).collect();
    fs::write(to, kept.join("\n") + "\n").unwrap();
}

fn folder(dir: &Path, name: &str, manifest: &str, csv: &str) {
    let own = dir.join(name);
    fs::create_dir_all(&own).unwrap();
    fs::write(own.join("recording.toml"), manifest).unwrap();
    fs::write(own.join("data.csv"), csv).unwrap();
}

/// All of them in `dir`; a robot recording has so many frames.
pub fn lay(dir: &Path, frames: usize) {
    fs::copy(format!("{TWIN}/rig.toml"), dir.join("rig.toml")).unwrap();
    fs::copy(FITTED, dir.join("parameters.toml")).unwrap();
    for name in ["symmetric", "single-1"] {
        let own = dir.join(name);
        fs::create_dir_all(&own).unwrap();
        let from = |file: &str| format!("{TWIN}/{name}/{file}");
        fs::copy(from("recording.toml"), own.join("recording.toml")).unwrap();
        head(&from("motion.csv"), &own.join("motion.csv"), 5 + frames);
        head(
            &from("voltage.csv"),
            &own.join("voltage.csv"),
            1 + 2 * frames,
        );
    }
    let mut hinge = String::from("t_s,angle_rad,torque_Nm\n");
    let mut axis = String::from("t_s,x_m,u_V\n");
    let mut coupon = String::from("t_s,stretch,stress_Pa\n");
    let mut hanging = String::from(
        "Trajectories\n100\n,,S:End,,,S:Top,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n",
    );
    let mut volts = String::from("time_s,phi_kV\n");
    for i in 0..600_u32 {
        let t = f64::from(i) * 0.01;
        let wobble = 1e-5 * f64::from((i * 7919) % 101) - 5e-4;
        let swing = (1.7 * t).sin() + 0.4 * (5.3 * t).sin();
        writeln!(
            hinge,
            "{t:.3},{:.6},{:.8}",
            0.3 * swing,
            1e-3 * swing + 0.01 * wobble
        )
        .unwrap();
        let push = -5.0 * (1.7 * t).sin() + 30.0 * (1.7 * t).cos() - 20.0 * (5.3 * t).sin();
        writeln!(
            axis,
            "{t:.3},{:.8},{:.6}",
            0.01 * swing + 0.001 * wobble,
            push + wobble
        )
        .unwrap();
        let stretch = 1.0 + 0.5 * t.min(3.0);
        let stress = 1e5 * (stretch - stretch.powi(-2)) * (1.0 + 0.2 * (-t).exp()) + 1e4 * wobble;
        writeln!(coupon, "{t:.3},{stretch:.6},{stress:.3}").unwrap();
        let z = 0.6 * (1.0 - (4.189 * t).cos()) + 10.0 * wobble;
        writeln!(
            hanging,
            "{},0,0.0,0.0,{:.4},0.0,0.0,{:.4}",
            i + 1,
            30.0 - z,
            90.0
        )
        .unwrap();
        writeln!(volts, "{t:.3},{:.4}", 1.25 * (1.0 - (4.189 * t).cos())).unwrap();
    }
    let recording = |id: &str, kind: &str, table: &str| {
        format!("[recording]\nid = \"{id}\"\nkind = \"{kind}\"\n{table}")
    };
    folder(
        dir,
        "hinge",
        &recording(
            "hinge",
            "hinge-bench",
            "\n[bench]\nfile = \"data.csv\"\nangle = \"angle_rad\"\ntorque = \"torque_Nm\"\ntime = \"t_s\"\nunits = { angle = \"rad\", torque = \"N m\", time = \"s\" }\n",
        ),
        &hinge,
    );
    folder(
        dir,
        "axis",
        &recording(
            "axis",
            "axis",
            "\n[axis]\nfile = \"data.csv\"\ntime = \"t_s\"\nposition = \"x_m\"\ninput = \"u_V\"\nunits = { time = \"s\", position = \"m\", input = \"V\" }\ninput_gain = 1.0\nmass_kg = \"estimate\"\ndamping = \"estimate\"\nstiffness = \"estimate\"\n",
        ),
        &axis,
    );
    folder(
        dir,
        "coupon",
        &recording(
            "coupon",
            "film-coupon",
            "\n[coupon]\nfile = \"data.csv\"\nmode = \"uniaxial\"\ntime = \"t_s\"\nstretch = \"stretch\"\nnominal_stress = \"stress_Pa\"\nunits = { time = \"s\", nominal_stress = \"Pa\" }\n",
        ),
        &coupon,
    );
    folder(
        dir,
        "sample",
        &recording(
            "sample",
            "film-sample",
            "rig = \"../hanging.toml\"\nfilm_state = \"relaxed\"\nelectrode = \"CGE\"\nday = 1\n\n[motion]\nfile = \"data.csv\"\nend_effector = \"S:End\"\nbase = \"S:Top\"\n\n[voltage]\nfile = \"voltage.csv\"\ntime = \"time_s\"\nchannels = [\"phi_kV\"]\nunit = \"kV\"\n\n[sync]\noffset_s = 0.0\n",
        ),
        &hanging,
    );
    fs::write(dir.join("sample/voltage.csv"), volts).unwrap();
    fs::write(dir.join("hanging.toml"), "[rig]\nid = \"hanging\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\nmargin_mm = 3.0\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n").unwrap();
}

/// Whether a text for a reader has NaN or an infinity where a figure should be.
pub fn figure_of_nothing(text: &str) -> Option<&str> {
    let bare = |c: char| !c.is_alphanumeric() && !matches!(c, '_' | '`' | '"' | '\'');
    text.lines().find(|line| {
        ["NaN", "nan", "inf", "-inf"].iter().any(|word| {
            line.match_indices(word).any(|(at, _)| {
                let before = line[..at].chars().next_back().is_none_or(bare);
                before && line[at + word.len()..].chars().next().is_none_or(bare)
            })
        })
    })
}

/// Runs the program, with ten seconds of each of two cores and 4 GB.
pub fn run(dir: &Path, arguments: &str) -> std::process::Output {
    let program = env!("CARGO_BIN_EXE_deacal");
    let limits = if cfg!(target_os = "linux") {
        "ulimit -v 4194304; ulimit -t 20; ulimit -c 0;"
    } else {
        ""
    };
    std::process::Command::new("sh")
        .args(["-c", &format!("{limits} exec '{program}' {arguments}")])
        .current_dir(dir)
        .env("RAYON_NUM_THREADS", "2")
        .output()
        .unwrap()
}

/// How a run within limits ended.
pub struct End {
    pub code: Option<i32>,
    /// The status in words.
    pub how: String,
    pub stdout: String,
    pub stderr: String,
    pub took_s: f64,
}

/// Runs the program with ten seconds of processor time and 4 GB, and ends it after a minute of the clock:
/// what waits for nothing is found too.
pub fn within_limits(dir: &Path, arguments: &str) -> End {
    let program = env!("CARGO_BIN_EXE_deacal");
    let limits = if cfg!(target_os = "linux") {
        "ulimit -v 4194304; ulimit -t 10; ulimit -c 0;"
    } else {
        ""
    };
    let file = |name: &str| fs::File::create(dir.join(name)).unwrap();
    let begun = std::time::Instant::now();
    let mut child = std::process::Command::new("sh")
        .args(["-c", &format!("{limits} exec '{program}' {arguments}")])
        .current_dir(dir)
        .env("RAYON_NUM_THREADS", "2")
        .stdin(std::process::Stdio::null())
        .stdout(file("said.txt"))
        .stderr(file("told.txt"))
        .spawn()
        .unwrap();
    let (code, how) = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break (status.code(), status.to_string());
        }
        if begun.elapsed().as_secs() >= 60 {
            child.kill().unwrap();
            child.wait().unwrap();
            break (None, "a minute without end".into());
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    };
    let text = |name: &str| {
        let bytes = fs::read(dir.join(name)).unwrap();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    End {
        code,
        how,
        stdout: text("said.txt"),
        stderr: text("told.txt"),
        took_s: begun.elapsed().as_secs_f64(),
    }
}
