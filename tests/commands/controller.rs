//! What `export --controller` writes, run as a controller would: sample by sample, in C, Python and Octave,
//! against the program's own predictions.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use deacal::calibration::{predict_command, predict_force, validate_robot_with};
use deacal::dataset::Dataset;
use deacal::effects::{Acting, Site, When};
use deacal::model::{Mechanics, Parameters, Robot};
use deacal::recording::{Recording, Rig};
use deacal::report::controller::{Refused, controller};
use deacal::report::export::Format;
use deacal::report::parameter_file::ParameterFile;

/// Of a prediction, or of these: V^2, V and N below which a share says nothing (of a voltage near 0 little is
/// left that its square does not have).
const SHARE: f64 = 1e-9;
const FLOORS: [f64; 3] = [1e4, 1e3, 1e-2];
/// Of the largest that a learnt term makes.
const LEARNT: f64 = 1e-12;
/// Samples that Python and Octave are fed, which take up to milliseconds a call; C is fed all.
const SOME: usize = 800;
const FEW: usize = 80;
/// From where on commands are held against the voltages that they make: every film has one there.
const UNDER_WAY: usize = 700;

const PLAIN: &str = "
[film]
mu_Pa = [1.12e6, 2.2e5, 1.2e5, 5.5e4, 4.5e4, 3.5e4, 3.0e4]
T_s = [0.02, 0.12, 0.7, 4.0, 25.0, 150.0]
J = 80.0
eps_r = 2.8
[forearm]
nodes_deg = [-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0]
torque_N_m = [-1.6e-3, -8e-4, -3e-4, 1e-4, 3e-4, 8e-4, 1.6e-3]
";

/// Next to nothing but the causes: a share of them is not lost in what else there is.
const FEATHER: &str = "
[film]
mu_Pa = [1e-12, 1e-12]
T_s = [1.0]
J = 80.0
eps_r = 2.8
";

/// Causes by their sites; whether an electrical one among them remembers.
const CASES: [(&str, bool, &str); 10] = [
    ("plain", false, ""),
    (
        "electrical_with_memory",
        true,
        r#"
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
id = "x_space_charge"
actuators = [3]
fraction = 0.04
time_constant = 20.0
[[effect]]
id = "series_resistance"
actuators = [1]
resistance = 2e7
stretch_exponent = 4.0
[[effect]]
id = "slew_limit"
rate_up = 4e5
rate_down = 4e5
"#,
    ),
    (
        "electrical_without_memory",
        false,
        r#"
[[effect]]
id = "amplifier_gain"
gain_error = 0.05
offset = 30.0
[[effect]]
id = "amplifier_deadband"
actuators = [1]
threshold = 300.0
edge = 40.0
[[effect]]
id = "amplifier_saturation"
actuators = [2]
ceiling = 6200.0
knee = 80.0
[[effect]]
id = "permittivity_stretch"
slope = 0.1
curvature = 0.1
[[effect]]
id = "electrode_failure"
actuators = [3]
fraction = 0.2
time = 1.5
"#,
    ),
    (
        "film",
        false,
        r#"
[[effect]]
id = "mullins_softening"
softening = 0.2
energy_scale = 4e4
[[effect]]
id = "actuator_asymmetry"
actuators = [2]
thickness_factor = 1.1
[[effect]]
id = "x_nonlinear_flow"
actuators = [1]
modulus = 8e4
time_constant = 2.0
stress_exponent = 3.0
[[effect]]
id = "electrode_stiffness"
modulus = 3e4
[[effect]]
id = "x_electrode_viscosity"
viscosity = 3e3
"#,
    ),
    (
        "joint_torque",
        false,
        r#"
[[effect]]
id = "joint_friction"
torque = 5e-4
presliding = 6e-3
sticking = 0.3
[[effect]]
id = "joint_damping"
actuators = [1]
coefficient = 5e-4
[[effect]]
id = "end_stop"
theta_stop = 4.2
stiffness = 0.3
damping = 0.1
[[effect]]
id = "hinge_stiffness"
stiffness = 0.05
rest_angle = 2.3
cubic = 3.0
[[effect]]
id = "actuator_mass"
first_moment = 1e-4
[[effect]]
id = "x_backlash"
actuators = [3]
stiffness = 5e-3
play = 0.01
"#,
    ),
    (
        "force_and_geometry",
        false,
        r#"
[[effect]]
id = "payload_change"
mass = 2e-3
time = 1.0
[[effect]]
id = "link_length_error"
actuators = [2]
link = "q"
relative_error = 0.01
"#,
    ),
    (
        "reading",
        false,
        r#"
[[effect]]
id = "frame_tilt"
rotation = [0.02, -0.01, 0.03]
[[effect]]
id = "marker_offset"
offset = [1e-3, -5e-4, 2e-4]
"#,
    ),
    (
        "series",
        false,
        r#"
[[effect]]
id = "temperature_drift"
relative_change = -0.1
early_change = 0.03
[[effect]]
id = "slow_creep"
modulus = 1e5
time_constant = 1100.0
since_assembly = 300.0
"#,
    ),
    (
        "learnt_torques_and_forces",
        false,
        r#"
[[effect]]
id = "learnt"
site = "bicep"
form = "spline"
variables = ["bicep angle", "bicep rate"]
unit = "N m"
knots = [4.0, 4.1, 4.2, 4.3]
values = [1e-3, 2e-3, -1e-3, 5e-4]
[[effect]]
id = "learnt"
site = "film"
form = "presliding"
variables = ["lozenge angle", "direction of motion"]
unit = "N m"
coefficients = [1e-3, -4e-4]
widths = [0.002, 0.03]
[[effect]]
id = "learnt"
site = "series"
form = "spline"
variables = ["time in the series"]
unit = "N m"
knots = [0.0, 400.0, 900.0]
values = [0.0, 1e-3, 1.5e-3]
[[effect]]
id = "learnt"
site = "bicep"
form = "wave"
variables = ["time"]
unit = "N m"
coefficients = [3e-4, 2e-4]
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
"#,
    ),
    (
        "learnt_voltages",
        true,
        r#"
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
form = "spline"
variables = ["voltage"]
unit = "1"
knots = [0.0, 3000.0, 6000.0]
values = [0.02, -0.03, 0.04]
[[effect]]
id = "learnt"
site = "capacitance"
form = "lag"
variables = ["area stretch"]
unit = "1"
coefficients = [0.02, -0.01]
times_s = [0.2, 2.0]
"#,
    ),
];

/// Every form of a learnt term at every kind of place.
const TERMS: [&str; 16] = [
    "site = \"bicep\"\nform = \"spline\"\nvariables = [\"bicep angle\"]\nknots = [4.0, 4.1, 4.2, 4.3]\nvalues = [1e-3, 2e-3, -1e-3, 5e-4]",
    "site = \"film\"\nform = \"spline\"\nvariables = [\"largest stretch so far\", \"bicep rate\"]\nknots = [1.0, 1.2, 1.4]\nvalues = [1e-3, 2e-3, -1e-3]",
    "site = \"film\"\nform = \"presliding\"\nvariables = [\"lozenge angle\", \"direction of motion\"]\ncoefficients = [1e-3, -4e-4, 2e-4]\nwidths = [0.002, 0.03, 0.1]",
    "site = \"bicep\"\nform = \"lag\"\nvariables = [\"bicep rate\", \"area stretch\"]\ncoefficients = [1e-3, -4e-4]\ntimes_s = [0.05, 3.0]",
    "site = \"bicep\"\nform = \"wave\"\nvariables = [\"time\", \"bicep angle\"]\ncoefficients = [3e-4, 2e-4]\nfrequency_Hz = 1.3",
    "site = \"series\"\nform = \"spline\"\nvariables = [\"time in the series\"]\nknots = [0.0, 400.0, 900.0]\nvalues = [1e-4, 1e-3, 1.5e-3]",
    "site = \"force\"\nform = \"potential\"\nvariables = [\"effector x\", \"effector y\", \"effector z\"]\ncoefficients = [1e-4, -2e-4]\ncentres_m = [[0.0, 0.0, -0.03], [0.01, 0.0, -0.04]]\nwidth_m = 0.01",
    "site = \"force\"\nform = \"ridge\"\nvariables = [\"effector x\", \"effector y\", \"effector z\"]\ndirection = [0.6, 0.0, 0.8]\nknots = [-0.04, -0.025, -0.015]\nvalues = [0.01, -0.02, 0.01]",
    "site = \"force\"\nform = \"affine\"\nvariables = [\"effector x\", \"effector y\", \"effector z\"]\ncoefficients = [0.01, -0.02, 0.03, 1.0, 2.0, 3.0, 0.5, -0.5, 0.2]\nabout_m = [0.0, 0.0, -0.03]",
    "site = \"force\"\nform = \"drag\"\nvariables = [\"effector velocity\"]\ncoefficients = [-0.1, -0.2, -0.3, -1.0, -2.0, -3.0]",
    "site = \"force\"\nform = \"oscillator\"\nvariables = [\"effector velocity\", \"history\"]\ncoefficients = [2e-3, 2e-3, 1e-3, 2e-4, 1e-4, 1e-4]\nfrequency_Hz = 4.0\ndamping = 0.1",
    "site = \"electrical\"\nform = \"spline\"\nvariables = [\"voltage rate\", \"cubed voltage\"]\nknots = [-2e4, 0.0, 2e4]\nvalues = [1e-5, 2e-5, 4e-5]",
    "site = \"electrical\"\nform = \"neighbours\"\nvariables = [\"voltages of the other actuators\"]\ncoefficients = [0.02, -0.01]",
    "site = \"electrical\"\nform = \"lag\"\nvariables = [\"squared voltage\"]\ncoefficients = [0.05]\ntimes_s = [0.5]",
    "site = \"capacitance\"\nform = \"spline\"\nvariables = [\"voltage\"]\nknots = [0.0, 3000.0, 6000.0]\nvalues = [0.02, -0.03, 0.04]",
    "site = \"film\"\nform = \"spline\"\nvariables = [\"lozenge angle\", \"squared voltage\"]\nknots = [2.2, 2.3, 2.4]\nvalues = [1e-11, 2e-11, 1e-11]",
];

/// A recording, and what a controller is fed of it.
struct Fed {
    robot: Robot,
    dataset: Dataset,
    when: When,
    offset_s: f64,
    commands_v: [Vec<f64>; 3],
    squared_v2: [Vec<f64>; 3],
    text: String,
}

impl Fed {
    fn new() -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/twin2026_delta/circle-3s");
        let recording = Recording::open(&path).unwrap();
        let Some(Rig::Robot(rig)) = &recording.rig else {
            panic!("no rig");
        };
        let robot = Robot::from_rig(rig, None).unwrap();
        let dataset = Dataset::from_recording(&recording, None).unwrap();
        let (n, step_s, offset_s) = (dataset.samples(), dataset.step_s, dataset.offset_s);
        let start_s = dataset.start_s + offset_s;
        let at = |k: usize| {
            (0..n)
                .map(|i| dataset.voltage.at(k, start_s + step_s * i as f64))
                .collect()
        };
        let squared = |k: usize| dataset.voltage.squared(k, start_s, step_s, n).0;
        let (commands_v, squared_v2) = ([0, 1, 2].map(at), [0, 1, 2].map(squared));
        let when = When {
            recording: 1,
            series_s: 240.0,
            start_s: dataset.time_s(0),
        };
        let pivot = dataset.pivot_m;
        let mut text = format!("{step_s:?} {:?} {:?} 1", when.series_s, when.start_s);
        pivot.iter().for_each(|p| write!(text, " {p:?}").unwrap());
        text.push('\n');
        let track = dataset.track();
        for i in 0..n {
            let three = [
                track.position_m[i],
                track.velocity_m_s[i],
                track.acceleration_m_s2[i],
            ];
            for v in three.concat() {
                write!(text, "{v:?} ").unwrap();
            }
            write!(text, "{:?}", track.payload_kg[i]).unwrap();
            for k in 0..6 {
                let of = if k < 3 {
                    &commands_v[k]
                } else {
                    &squared_v2[k - 3]
                };
                write!(text, " {:?}", of[i]).unwrap();
            }
            text.push('\n');
        }
        Fed {
            robot,
            dataset,
            when,
            offset_s,
            commands_v,
            squared_v2,
            text,
        }
    }

    fn samples(&self) -> usize {
        self.dataset.samples()
    }
}

/// A parameter file and its causes as the program puts them to work in the recording.
fn file(text: &str) -> (ParameterFile, Vec<Acting>) {
    let file = ParameterFile::parse(Path::new("parameters.toml"), text).unwrap();
    let mut effects = file.acting(&|_| None).unwrap();
    for acting in &mut effects {
        let quantities = acting.effect.parameters().iter();
        for (value, q) in acting.values.iter_mut().zip(quantities) {
            if q.name == "recording" {
                *value = 1.0;
            }
        }
    }
    (file, effects)
}

/// What a controller made of a sample: squared voltages, commands, status of both, force.
type Row = [f64; 11];

fn rows(text: &str) -> Vec<Row> {
    let row = |line: &str| -> Row {
        let numbers: Vec<f64> = line
            .split_whitespace()
            .map(|w| w.parse().unwrap_or_else(|_| panic!("{line}")))
            .collect();
        numbers.try_into().unwrap_or_else(|_| panic!("{line}"))
    };
    text.lines().map(row).collect()
}

/// Runs a program with a text as its input; `None`, said, where it is not there.
fn run(program: &str, args: &[&Path], input: &str) -> Option<(String, String)> {
    let child = Command::new(program)
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = match child {
        Ok(child) => child,
        Err(error) => {
            eprintln!("skipped: {program}: {error}");
            return None;
        }
    };
    let mut to = child.stdin.take().unwrap();
    let input = input.to_owned();
    // a program that does not read to the end says why on its own
    let writer = std::thread::spawn(move || {
        let _ = std::io::Write::write_all(&mut to, input.as_bytes());
    });
    let done = child.wait_with_output().unwrap();
    writer.join().unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(done.status.success(), "{program} {args:?}: {said}");
    Some((String::from_utf8_lossy(&done.stdout).into_owned(), said))
}

fn folder(name: &str) -> PathBuf {
    let dir = PathBuf::from(env!("CARGO_TARGET_TMPDIR"))
        .join("controller")
        .join(name);
    std::fs::create_dir_all(&dir).unwrap();
    dir
}

/// The C export, compiled as strictly as a compiler can and run; what it says of its time a call.
fn in_c(dir: &Path, text: &str, input: &str) -> Option<(Vec<Row>, String)> {
    let (source, program) = (dir.join("robot.h"), dir.join("robot"));
    std::fs::write(&source, text).unwrap();
    let strict = "-std=c99 -Wall -Wextra -Werror -pedantic -O2 -DDEACAL_IMPLEMENTATION -DDEACAL_PROGRAM -x c";
    let mut args: Vec<&Path> = strict.split(' ').map(Path::new).collect();
    args.extend([&*source, Path::new("-lm"), Path::new("-o"), &*program]);
    run("cc", &args, "")?;
    let (out, said) = run(program.to_str().unwrap(), &[], input)?;
    Some((rows(&out), said))
}

/// The Python export, fed the first samples.
fn in_python(dir: &Path, text: &str, input: &str) -> Option<Vec<Row>> {
    let source = dir.join("robot.py");
    std::fs::write(&source, text).unwrap();
    let lines: Vec<&str> = input.lines().take(1 + SOME).collect();
    Some(rows(&run("python3", &[&source], &lines.join("\n"))?.0))
}

/// Feeds the first samples to each of some functions, in one run of Octave.
fn in_octave(dir: &Path, names: &[&str], texts: &[String], input: &str) -> Option<Vec<Vec<Row>>> {
    let (head, samples) = input.split_once('\n').unwrap();
    let few: Vec<&str> = samples.lines().take(FEW).collect();
    std::fs::write(dir.join("head.txt"), head).unwrap();
    std::fs::write(dir.join("samples.txt"), few.join("\n")).unwrap();
    let mut script = String::from("1;\nh = load('head.txt');\nx = load('samples.txt');\n");
    for (name, text) in names.iter().zip(texts) {
        std::fs::write(dir.join(format!("{name}.m")), text).unwrap();
        write!(
            script,
            "a = {name}('init', h(1)); a.series_s = h(2); a.start_s = h(3); a.recording = h(4);
a.pivot_m = h(5:7); b = a;
for i = 1:rows(x)
  a.payload_kg = x(i, 10); b.payload_kg = x(i, 10);
  [a, c, s, p] = {name}('voltage', a, x(i, 1:3), x(i, 4:6), x(i, 7:9));
  [b, f, q] = {name}('force', b, x(i, 1:3), x(i, 4:6), x(i, 7:9), x(i, 11:13), x(i, 14:16));
  printf('%.17g ', [s, c, p, q, f]); printf('\\n');
end
"
        )
        .unwrap();
    }
    let path = dir.join("feed.m");
    std::fs::write(&path, format!("cd('{}');\n{script}", dir.display())).unwrap();
    let flags = ["--norc", "--no-gui", "--quiet"].map(Path::new);
    let mut args = flags.to_vec();
    args.push(&path);
    let (out, _) = run("octave-cli", &args, "")?;
    let all = rows(&out);
    assert_eq!(all.len(), FEW * names.len());
    Some(all.chunks(FEW).map(<[Row]>::to_vec).collect())
}

/// What the program predicts.
struct Expected {
    squared_v2: Vec<[f64; 3]>,
    /// Where no electrical cause remembers.
    command_v: Option<Vec<[f64; 3]>>,
    force_n: Vec<[f64; 3]>,
}

fn expected(fed: &Fed, parameters: &Parameters, effects: &[Acting], remembers: bool) -> Expected {
    let (robot, dataset, when) = (&fed.robot, &fed.dataset, fed.when);
    let outcome = validate_robot_with(robot, &[dataset], parameters, effects, &[when]).unwrap();
    let r = &outcome.recordings[0];
    assert_eq!(r.offset_s, fed.offset_s);
    let force = predict_force(robot, dataset, parameters, fed.offset_s, effects, when).unwrap();
    let told = (!remembers)
        .then(|| predict_command(robot, dataset, &r.predicted_v, effects, when).unwrap());
    Expected {
        squared_v2: r.predicted_squared_v2.clone(),
        command_v: told,
        force_n: force,
    }
}

/// The largest distance as a share of what is wanted; floors as of [`FLOORS`].
fn share(found: [f64; 3], wanted: [f64; 3], floor: f64, place: &str) -> f64 {
    let one = |(f, w): (&f64, &f64)| match (f.is_nan(), w.is_nan()) {
        (true, true) => 0.0,
        (false, false) => (f - w).abs() / w.abs().max(floor),
        _ => panic!("{place}: found {f}, wanted {w}"),
    };
    found.iter().zip(&wanted).map(one).fold(0.0, f64::max)
}

/// Holds what a controller made against what the program predicts.
fn compare(name: &str, language: &str, found: &[Row], wanted: &Expected) {
    assert!(!found.is_empty());
    let mut worst = [0.0_f64; 3];
    for (i, row) in found.iter().enumerate() {
        let three = |at: usize| [row[at], row[at + 1], row[at + 2]];
        let place = format!("{name} in {language}, sample {i}");
        let squared = share(three(0), wanted.squared_v2[i], FLOORS[0], &place);
        worst[0] = worst[0].max(squared);
        if let Some(command) = &wanted.command_v {
            worst[1] = worst[1].max(share(three(3), command[i], FLOORS[1], &place));
        }
        // a frame without a voltage has no force in the program
        if !wanted.force_n[i][0].is_nan() {
            worst[2] = worst[2].max(share(three(8), wanted.force_n[i], FLOORS[2], &place));
        }
    }
    println!(
        "{name} in {language}: phi^2 {:.1e}, command {:.1e}, force {:.1e}",
        worst[0], worst[1], worst[2]
    );
    assert!(
        worst.iter().all(|w| *w <= SHARE),
        "{name} in {language}: {worst:?}"
    );
}

/// Holds the commands of a C controller, begun where the robot is under way, against the voltages that they
/// have to make on the films.
fn commands_make_the_voltages(fed: &Fed, effects: &[Acting], dir: &Path, text: &str) {
    let lines: Vec<&str> = fed.text.lines().collect();
    let input = [&lines[..1], &lines[1 + UNDER_WAY..]].concat().join("\n");
    let Some((found, _)) = in_c(dir, text, &input) else {
        return;
    };
    let mut track = fed.dataset.track();
    track.position_m.drain(..UNDER_WAY);
    track.velocity_m_s.drain(..UNDER_WAY);
    track.acceleration_m_s2.drain(..UNDER_WAY);
    track.payload_kg.drain(..UNDER_WAY);
    let mechanics = Mechanics::with_effects(&fed.robot, &track, effects, [0.0; 3], None).unwrap();
    let none = found
        .iter()
        .position(|r| r[6] != 0.0)
        .unwrap_or(found.len());
    println!("{none} of {} samples have commands", found.len());
    let found = &found[..none];
    let told = [3, 4, 5].map(|k| found.iter().map(|r| r[k]).collect::<Vec<f64>>());
    let told = [&told[0][..], &told[1][..], &told[2][..]];
    let mut worst = 0.0_f64;
    for k in 0..3 {
        let made = mechanics.film_voltage_v(k, fed.when, effects, told);
        for (row, made) in found.iter().zip(&made) {
            let wanted = row[k].sqrt();
            worst = worst.max((made - wanted).abs() / wanted.max(FLOORS[1]));
        }
    }
    println!("commands make the voltages on the films to {worst:.1e}");
    assert!(none > 1000 && worst <= SHARE, "{none} samples, {worst:e}");
}

#[test]
fn controllers_predict_what_the_program_predicts() {
    let fed = Fed::new();
    let mut octave = Vec::new();
    for (name, remembers, causes) in CASES {
        let (file, effects) = file(&format!("{PLAIN}{causes}"));
        let wanted = expected(&fed, &file.parameters().unwrap(), &effects, remembers);
        let text = |format| controller(&file, &fed.robot, format, name).unwrap().text;
        let dir = folder(name);
        if let Some((found, said)) = in_c(&dir, &text(Format::C), &fed.text) {
            assert_eq!(found.len(), fed.samples());
            compare(name, "C", &found, &wanted);
            if remembers && name != "learnt_voltages" {
                commands_make_the_voltages(&fed, &effects, &dir, &text(Format::C));
            }
            println!("{}", said.trim());
        }
        if let Some(found) = in_python(&dir, &text(Format::Python), &fed.text) {
            assert_eq!(found.len(), SOME);
            compare(name, "Python", &found, &wanted);
        }
        octave.push((name, text(Format::Matlab), wanted));
    }
    let names: Vec<&str> = octave.iter().map(|o| o.0).collect();
    let texts: Vec<String> = octave.iter().map(|o| o.1.clone()).collect();
    if let Some(all) = in_octave(&folder("octave"), &names, &texts, &fed.text) {
        for ((name, _, wanted), found) in octave.iter().zip(&all) {
            compare(name, "Octave", found, wanted);
        }
    }
}

#[test]
fn learnt_terms_are_those_of_the_program() {
    let mut fed = Fed::new();
    fed.robot.effector_kg = 1e-15;
    fed.robot.bicep_tip_kg = 1e-15;
    let mut octave = Vec::new();
    for (number, term) in TERMS.iter().enumerate() {
        let name = format!("term_{number}");
        let unit = [
            "bicep",
            "film",
            "series",
            "force",
            "electrical",
            "capacitance",
        ]
        .iter()
        .zip(["N m", "N m", "N m", "N", "V^2", "1"])
        .find(|(site, _)| term.contains(&format!("site = \"{site}\"")))
        .unwrap()
        .1;
        let text = format!("{FEATHER}[[effect]]\nid = \"learnt\"\nunit = \"{unit}\"\n{term}\n");
        let (file, effects) = file(&text);
        let parameters = file.parameters().unwrap();
        let electrical = effects[0].effect.site() == Site::Electrical;
        // what acts on the voltage shows in the force, beside that of the voltage itself
        let force = |effects: &[Acting]| {
            let (robot, dataset) = (&fed.robot, &fed.dataset);
            predict_force(robot, dataset, &parameters, fed.offset_s, effects, fed.when).unwrap()
        };
        let wanted: Vec<[f64; 3]> = if electrical {
            force(&effects)
        } else {
            let track = fed.dataset.track();
            let m = Mechanics::with_effects(&fed.robot, &track, &effects, [0.0; 3], None).unwrap();
            let torque = [0, 1, 2].map(|k| m.effect_torque_n_m(k, fed.when, &effects));
            let plain = m.phi_squared_v2(&parameters).unwrap();
            (0..fed.samples())
                .map(|i| {
                    [0, 1, 2]
                        .map(|k| plain[i][k] - torque[k][i] / m.chains[k].half_capacitance_slope[i])
                })
                .collect()
        };
        let largest = (wanted.iter().flatten()).fold(0.0_f64, |l, w| l.max(w.abs()));
        assert!(largest > 0.0, "{name}");
        let hold = |language: &str, found: &[Row]| {
            let at = if electrical { 8 } else { 0 };
            let worst = (found.iter().zip(&wanted).enumerate())
                .filter(|(_, (_, w))| !w[0].is_nan())
                .map(|(i, (row, w))| {
                    let found = [row[at], row[at + 1], row[at + 2]];
                    share(found, *w, largest, &format!("{name}, sample {i}"))
                })
                .fold(0.0, f64::max);
            println!("{name} in {language}: {worst:.1e} of the largest");
            assert!(worst <= LEARNT, "{name} in {language}: {worst:e}\n{term}");
        };
        let text = |format| controller(&file, &fed.robot, format, &name).unwrap().text;
        let dir = folder(&name);
        if let Some((found, _)) = in_c(&dir, &text(Format::C), &fed.text) {
            hold("C", &found);
        }
        if let Some(found) = in_python(&dir, &text(Format::Python), &fed.text) {
            hold("Python", &found);
        }
        let m = text(Format::Matlab);
        octave.push((name.clone(), m, wanted.clone(), largest, electrical));
    }
    let names: Vec<&str> = octave.iter().map(|o| &*o.0).collect();
    let texts: Vec<String> = octave.iter().map(|o| o.1.clone()).collect();
    if let Some(all) = in_octave(&folder("octave_terms"), &names, &texts, &fed.text) {
        for ((name, _, wanted, largest, electrical), found) in octave.iter().zip(&all) {
            let at = if *electrical { 8 } else { 0 };
            for (i, row) in found
                .iter()
                .enumerate()
                .filter(|(i, _)| !wanted[*i][0].is_nan())
            {
                let three = [row[at], row[at + 1], row[at + 2]];
                let worst = share(three, wanted[i], *largest, name);
                assert!(worst <= LEARNT, "{name} in Octave, sample {i}: {worst:e}");
            }
        }
    }
}

#[test]
fn what_needs_more_than_what_was_sampled_is_refused_by_name() {
    let fed = Fed::new();
    let refused = |causes: &str, format, name: &str| {
        let (file, _) = file(&format!("{PLAIN}{causes}"));
        controller(&file, &fed.robot, format, name).unwrap_err()
    };
    let lag = refused(
        "[[effect]]\nid = \"mocap_lag\"\ndelay = 0.03\n",
        Format::C,
        "x",
    );
    assert!(matches!(
        lag,
        Refused::Cause {
            id: "mocap_lag",
            ..
        }
    ));
    let text = lag.to_string();
    assert!(
        text.contains("samples to come") && text.contains("[[effect]]"),
        "{text}"
    );
    let slack = "[[effect]]\nid = \"loss_of_tension\"\nthreshold = 0.1\n";
    let text = refused(slack, Format::Python, "x").to_string();
    assert!(text.contains("loss_of_tension"), "{text}");
    assert!(matches!(refused("", Format::Json, "x"), Refused::Json));
    let text = refused("", Format::Matlab, "my-robot").to_string();
    assert!(
        text.contains("my-robot") && text.contains("letter"),
        "{text}"
    );
}

#[test]
fn what_does_not_belong_to_a_controller_is_said() {
    let fed = Fed::new();
    let causes = "[[effect]]\nid = \"time_offset\"\noffset = 0.02\n[[effect]]\nid = \"marker_offset\"\noffset = [1e-3, 0.0, 0.0]\n";
    let (file, _) = file(&format!("{PLAIN}{causes}"));
    let made = controller(&file, &fed.robot, Format::C, "x").unwrap();
    assert_eq!(made.remarks.len(), 2);
    for (remark, id) in made.remarks.iter().zip(["time_offset", "marker_offset"]) {
        assert!(
            remark.starts_with(id) && made.text.contains(remark),
            "{remark}"
        );
    }
}

#[test]
fn c_allocates_nothing_and_keeps_nothing_of_its_own() {
    let fed = Fed::new();
    let (_, _, causes) = CASES[1];
    let (file, _) = file(&format!("{PLAIN}{causes}"));
    let text = controller(&file, &fed.robot, Format::C, "x").unwrap().text;
    let dir = folder("symbols");
    let (source, object) = (dir.join("robot.h"), dir.join("robot.o"));
    std::fs::write(&source, text).unwrap();
    let flags = "-std=c99 -Wall -Wextra -Werror -pedantic -DDEACAL_IMPLEMENTATION -x c -c";
    let mut args: Vec<&Path> = flags.split(' ').map(Path::new).collect();
    args.extend([&*source, Path::new("-o"), &*object]);
    if run("cc", &args, "").is_none() {
        return;
    }
    let Some((symbols, _)) = run("nm", &[&object], "") else {
        return;
    };
    for line in symbols.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [.., kind, name] = words[..] else {
            continue;
        };
        // b, d: data that a program could write to; U: what it calls
        assert!(!["b", "B", "d", "D", "C"].contains(&kind), "{line}");
        assert!(
            !["malloc", "calloc", "realloc", "free"].contains(&name),
            "{line}"
        );
    }
}

#[test]
fn a_pose_out_of_reach_is_passed_over() {
    let fed = Fed::new();
    let (file, _) = file(PLAIN);
    let text = |format| controller(&file, &fed.robot, format, "robot").unwrap().text;
    let mut lines: Vec<&str> = fed.text.lines().take(41).collect();
    let away = lines[21].replacen(lines[21].split(' ').next().unwrap(), "1.0", 1);
    lines[21] = &away;
    let input = lines.join("\n");
    let hold = |found: Vec<Row>| {
        let status: Vec<f64> = found.iter().map(|r| r[6]).collect();
        assert_eq!(status[20], 3.0);
        assert!(
            found[20][..6]
                .iter()
                .chain(&found[20][8..])
                .all(|v| v.is_nan())
        );
        assert!(
            status.iter().enumerate().all(|(i, s)| i == 20 || *s < 2.0),
            "{status:?}"
        );
    };
    let dir = folder("reach");
    if let Some((found, _)) = in_c(&dir, &text(Format::C), &input) {
        hold(found);
    }
    if let Some(found) = in_python(&dir, &text(Format::Python), &input) {
        hold(found);
    }
    assert_eq!(fed.commands_v[0].len(), fed.squared_v2[0].len());
}

#[test]
fn the_command_writes_all_three() {
    let dir = folder("command");
    let parameters = dir.join("parameters.toml");
    std::fs::write(&parameters, PLAIN).unwrap();
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/twin2026_delta/rig.toml");
    let export = |format: &str, more: &[&Path]| {
        let mut deacal = Command::new(env!("CARGO_BIN_EXE_deacal"));
        deacal
            .arg("export")
            .arg(&parameters)
            .args(["--format", format]);
        deacal.args(more).output().unwrap()
    };
    for (format, file, holds) in [
        ("c", "robot.h", "int deacal_voltage("),
        ("m", "robot.m", "function [state, a, b, c] = robot(what"),
        ("py", "robot.py", "class Controller:"),
    ] {
        let to = dir.join(file);
        let _ = std::fs::remove_file(&to);
        let args = [
            Path::new("--controller"),
            Path::new("--rig"),
            &rig,
            Path::new("-o"),
            &to,
        ];
        let done = export(format, &args);
        assert!(
            done.status.success(),
            "{}",
            String::from_utf8_lossy(&done.stderr)
        );
        assert!(std::fs::read_to_string(&to).unwrap().contains(holds));
    }
    let without_rig = export("c", &[Path::new("--controller")]);
    assert_eq!(without_rig.status.code(), Some(2));
}
