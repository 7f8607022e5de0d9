//! Numbers that are out of the ordinary: curves of any number of nodes, gaps, signs, sentinels, sizes and
//! rates beyond reason. Every command ends with a sentence or with numbers that hold.

use crate::common;

use common::bench::{self, figure_of_nothing, run};
use common::recordings::{film, recording};
use common::{golden, robot};
use deacal::model::ForearmTorque;
use deacal::residual::RobotResidual;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

/// A straight torque curve is the same curve through any nodes: so is the residual.
#[test]
fn a_curve_of_any_number_of_nodes_gives_the_same_residual() {
    let robot = robot(&golden("inverse_dynamics")["rig"]);
    let mut generator = ChaCha12Rng::seed_from_u64(1);
    let film = film(&mut generator);
    let dataset = recording(&robot, &film, &mut generator, 6.0, Some(0.0));
    let mut first: Option<Vec<f64>> = None;
    for count in 2..=100 {
        let nodes: Vec<f64> = (0..count)
            .map(|i| -0.5 + i as f64 / (count - 1) as f64)
            .collect();
        let torque: Vec<f64> = nodes.iter().map(|x| 3e-3 * x + 2e-4).collect();
        let curve = ForearmTorque::new(nodes, torque.clone()).unwrap();
        let residual = RobotResidual::new(&robot, &[&dataset], film.branches(), &curve).unwrap();
        let mut eta: Vec<f64> = film.relaxation_time_s.iter().map(|t| t.ln()).collect();
        eta.push(1.0 / film.locking);
        let beta = [film.mu_pa.clone(), torque].concat();
        let design = residual.design(&eta, &beta).unwrap();
        let own: Vec<f64> = design.column(design.ncols() - 1).iter().copied().collect();
        let first = first.get_or_insert_with(|| own.clone());
        let size = first.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        for (a, b) in own.iter().zip(first.iter()) {
            assert!((a - b).abs() < 1e-9 * size, "{count} nodes: {a} {b}");
        }
    }
}

/// Replaces the cell in `column` of a line (both from 0) of a table.
fn cell(path: &std::path::Path, line: usize, column: usize, with: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let mut cells: Vec<&str> = lines[line].split(',').collect();
    cells[column] = with;
    lines[line] = cells.join(",");
    std::fs::write(path, lines.join("\n") + "\n").unwrap();
}

#[test]
fn what_cannot_be_is_refused_with_its_place() {
    let refused =
        |frames: usize, change: &dyn Fn(&std::path::Path), arguments: &str, says: &[&str]| {
            let dir = tempfile::tempdir().unwrap();
            bench::lay(dir.path(), frames);
            change(dir.path());
            let out = run(dir.path(), arguments);
            let error = String::from_utf8_lossy(&out.stderr).into_owned();
            // a diagnosis may say instead what has to be mended first; in either case it names no physics
            if arguments.starts_with("diagnose") && out.status.code() == Some(0) {
                let json = std::fs::read_to_string(dir.path().join("out/diagnosis.json")).unwrap();
                let told: serde_json::Value = serde_json::from_str(&json).unwrap();
                assert_eq!(told["verdict"], "recording", "{json}");
                let candidates = told["candidates"].as_array().map(Vec::len);
                assert_eq!(candidates, Some(0), "{json}");
                return;
            }
            assert_eq!(
                out.status.code(),
                Some(1),
                "{arguments}: {:?} {error}",
                out.status
            );
            assert_eq!(error.trim_end().lines().count(), 1, "{error}");
            for word in says {
                assert!(error.contains(word), "`{word}` is not in: {error}");
            }
        };
    let nothing = |_: &std::path::Path| ();
    for frames in [50, 100] {
        refused(
            frames,
            &nothing,
            "diagnose symmetric -o out",
            &["independent samples", "record longer"],
        );
        refused(
            frames,
            &nothing,
            "fit film symmetric -o out",
            &["independent samples", "record longer"],
        );
    }
    let volts = |dir: &std::path::Path| cell(&dir.join("symmetric/voltage.csv"), 40, 2, "1e300");
    for command in ["fit film symmetric -o out", "diagnose symmetric -o out"] {
        refused(
            300,
            &volts,
            command,
            &["channel 2", "e303 V", "check its unit"],
        );
    }
    for rate in ["1e9", "1e11", "1e19", "1e-3"] {
        let stated = |dir: &std::path::Path| {
            let path = dir.join("symmetric/recording.toml");
            let text = std::fs::read_to_string(&path).unwrap();
            let from = "format = \"nexus-csv\"";
            std::fs::write(
                path,
                text.replace(from, &format!("{from}\nrate_hz = {rate}")),
            )
            .unwrap();
        };
        for command in [
            "fit film symmetric -o out",
            "predict voltage symmetric --params parameters.toml -o out/p.csv",
        ] {
            refused(300, &stated, command, &["rate is", "check rate_hz"]);
        }
    }
    let replaced = |file: &'static str, from: &'static str, to: &'static str| {
        move |dir: &std::path::Path| {
            let text = std::fs::read_to_string(dir.join(file)).unwrap();
            assert!(text.contains(from), "{file}: {from}");
            std::fs::write(dir.join(file), text.replacen(from, to, 1)).unwrap();
        }
    };
    for (from, to, key) in [
        ("[2.5, ", "[-1e300, ", "base_position_mm"),
        ("-4.0]", "1e300]", "end_effector_offset_mm"),
        (
            "rotation_deg = [0.0",
            "rotation_deg = [1e19",
            "rotation_deg",
        ),
    ] {
        let stated = replaced("symmetric/recording.toml", from, to);
        for command in [
            "import symmetric -o out",
            "fit film symmetric -o out",
            "validate symmetric --params parameters.toml -o out",
        ] {
            refused(
                300,
                &stated,
                command,
                &["line 1", key, "numbers within 1e6"],
            );
        }
    }
    let torque = replaced("parameters.toml", "9.620080324007091e-5", "1e160");
    refused(
        300,
        &torque,
        "validate symmetric --params parameters.toml -o out",
        &["1e160 N m", "torque_N_m"],
    );
    // a gain that makes nothing of the input, and of its noise: nothing to hold an error against
    let dir = tempfile::tempdir().unwrap();
    bench::lay(dir.path(), 300);
    replaced(
        "axis/recording.toml",
        "input_gain = 1.0",
        "input_gain = 1e-300",
    )(dir.path());
    let said = run(dir.path(), "fit axis axis -o out");
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.contains("no noise to hold it against"), "{said}");
    // a size that no step of the integrator is short enough for is not followed for minutes
    refused(
        300,
        &nothing,
        "simulate --rig rig.toml --params parameters.toml --drive sine:peak_V=3000,hz=1 --duration 2 \
         --effect joint_friction:torque=5e-4,presliding=1e-9 -o out",
        &["does not get beyond", "sizes of [[effect]]"],
    );
    let axis = |dir: &std::path::Path| cell(&dir.join("axis/data.csv"), 99, 1, "1e300");
    for command in ["fit axis axis -o out", "diagnose axis -o out"] {
        refused(300, &axis, command, &["coordinate of sample 99", "1e300"]);
    }
}

/// Parameters with a forearm curve of so many nodes.
fn with_nodes(dir: &std::path::Path, count: usize) -> String {
    let name = format!("nodes{count}.toml");
    let step = 60.0 / (count - 1) as f64;
    let list = |of: &dyn Fn(usize) -> f64| {
        let all: Vec<String> = (0..count).map(|i| format!("{:?}", of(i))).collect();
        all.join(", ")
    };
    let text = format!(
        "[film]\nmu_Pa = [1.12e6, 2.2e5]\nT_s = [0.7]\nJ = 80.0\n[forearm]\nnodes_deg = [{}]\ntorque_N_m = [{}]\n",
        list(&|i| -30.0 + step * i as f64),
        list(&|i| 1e-4 * (i as f64 / (count - 1) as f64 - 0.5))
    );
    std::fs::write(dir.join(&name), text).unwrap();
    name
}

/// Every command takes a curve of any number of nodes: few, those about each multiple of eight, and a
/// hundred.
#[test]
fn commands_take_a_curve_of_any_number_of_nodes() {
    let dir = tempfile::tempdir().unwrap();
    bench::lay(dir.path(), 500);
    let counts = (2..=100).filter(|n| *n < 7 || n % 8 < 2 || n % 8 == 7 || *n == 100);
    for (i, count) in counts.enumerate() {
        let p = with_nodes(dir.path(), count);
        let mut commands = vec![
            format!("predict voltage symmetric --params {p} -o out/v.csv"),
            format!("predict force symmetric --params {p} -o out/f.csv"),
            format!("validate symmetric --params {p} -o out"),
        ];
        // what fits takes longer: of the many, every fourth
        if count < 7 || i % 4 == 0 {
            commands.push(format!("fit film symmetric --start {p} --starts 1 -o out"));
            let fix: String = (0..count.saturating_sub(5))
                .map(|n| {
                    let degrees = -30.0 + 60.0 / (count - 1) as f64 * n as f64;
                    format!(" --fix torque_{}deg=0", (degrees * 1e6).round() / 1e6)
                })
                .collect();
            commands.push(format!(
                "fit forearm single-1 --params {p} --starts 1{fix} -o out"
            ));
        }
        for command in commands {
            let out = run(dir.path(), &command);
            let error = String::from_utf8_lossy(&out.stderr);
            assert_eq!(
                out.status.code(),
                Some(0),
                "{count} nodes: {command}: {error}"
            );
            let said = String::from_utf8_lossy(&out.stdout).into_owned();
            assert_eq!(figure_of_nothing(&said), None, "{count} nodes: {command}");
        }
    }
}

/// Numbers that are only unlikely cost no more than others, and end in an answer.
#[test]
fn what_is_unlikely_costs_no_more() {
    let dir = tempfile::tempdir().unwrap();
    bench::lay(dir.path(), 300);
    cell(&dir.path().join("hinge/data.csv"), 77, 1, "10000");
    let percent = dir.path().join("coupon/data.csv");
    let text = std::fs::read_to_string(&percent).unwrap();
    let scaled = text.lines().enumerate().map(|(i, line)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if i > 0 {
            cells[1] = format!("{}", 100.0 * cells[1].parse::<f64>().unwrap());
        }
        cells.join(",")
    });
    std::fs::write(&percent, scaled.collect::<Vec<_>>().join("\n") + "\n").unwrap();
    for command in [
        "fit hinge hinge -o out",
        "diagnose hinge -o out",
        "fit coupon coupon -o out",
        "diagnose coupon -o out",
    ] {
        let out = run(dir.path(), command);
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(
            matches!(out.status.code(), Some(0 | 1)),
            "{command}: {:?} {error}",
            out.status
        );
        assert!(!error.contains("panicked"), "{command}: {error}");
        let said = String::from_utf8_lossy(&out.stdout).into_owned();
        assert_eq!(figure_of_nothing(&said), None, "{command}");
    }
}

/// A voltage that jumps under a sample, one that is cut short, a load that no film of the start's stiffness
/// carries, and a length that lets such a film swing fifty times as far: the model is off by far more than
/// the noise, and neither starts nor steps go on as if it were not.
#[test]
fn samples_that_do_not_fit_cost_no_more() {
    let dir = tempfile::tempdir().unwrap();
    bench::lay(dir.path(), 300);
    let at = |name: &str| dir.path().join(name);
    let volts = std::fs::read_to_string(at("sample/voltage.csv")).unwrap();
    let lines: Vec<&str> = volts.lines().collect();
    let jumping = lines.iter().enumerate().map(|(i, line)| {
        let (time, phi) = line.split_once(',').unwrap();
        match (329..438).contains(&i) {
            true => format!("{time},{}", 1e-3 * phi.parse::<f64>().unwrap()),
            false => (*line).to_owned(),
        }
    });
    let jumping = jumping.collect::<Vec<_>>().join("\n") + "\n";
    let short = lines[..222].join("\n") + "\n";
    for (what, text) in [("jumping", &jumping), ("cut", &short)] {
        std::fs::write(at("sample/voltage.csv"), text).unwrap();
        let end = bench::within_limits(dir.path(), "fit sample sample -o out --force");
        println!("{what}: {:.1} s, {}", end.took_s, end.how);
        assert!(
            matches!(end.code, Some(0 | 1)),
            "{what}: {} {}",
            end.how,
            end.stderr
        );
        assert_eq!(figure_of_nothing(&end.stdout), None, "{what}");
    }
    std::fs::write(at("sample/voltage.csv"), &volts).unwrap();
    std::fs::create_dir(at("later")).unwrap();
    for file in ["data.csv", "voltage.csv", "recording.toml"] {
        let text = std::fs::read_to_string(at("sample").join(file)).unwrap();
        let text = match file {
            "data.csv" => text.lines().take(600).collect::<Vec<_>>().join("\n") + "\n",
            _ => text
                .replace("id = \"sample\"", "id = \"later\"")
                .replace("day = 1", "day = 2"),
        };
        std::fs::write(at("later").join(file), text).unwrap();
    }
    let rig = std::fs::read_to_string(at("hanging.toml")).unwrap();
    std::fs::write(at("hanging.toml"), rig.replace("m_g = 50.0", "m_g = 1e3")).unwrap();
    let end = bench::within_limits(dir.path(), "ageing sample later -o aged");
    println!("heavy: {:.1} s, {}", end.took_s, end.how);
    assert_eq!(end.code, Some(0), "{} {}", end.how, end.stderr);
    assert_eq!(figure_of_nothing(&end.stdout), None);
    std::fs::create_dir(at("films")).unwrap();
    for name in ["sample", "later"] {
        std::fs::rename(at(name), at("films").join(name)).unwrap();
    }
    let long = rig.replace("length_mm = 60.0", "length_mm = 3000");
    std::fs::write(at("films/hanging.toml"), long).unwrap();
    let end = bench::within_limits(dir.path(), "batch films -o many");
    println!("long: {:.1} s, {}", end.took_s, end.how);
    assert_eq!(end.code, Some(0), "{} {}", end.how, end.stderr);
}

/// A sample's motion in metres under millimetres is refused with what to look at, before any search.
#[test]
fn a_sample_in_metres_is_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    bench::lay(dir.path(), 300);
    let path = dir.path().join("sample/data.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("mm,mm,mm", "m,m,m")).unwrap();
    let rig = dir.path().join("hanging.toml");
    let text = std::fs::read_to_string(&rig).unwrap();
    std::fs::write(rig, text.replace("length_mm = 60.0", "length_mm = 40.0")).unwrap();
    for command in [
        "fit sample sample --starts 1 --branches 1 -o out",
        "validate sample --params parameters.toml -o out",
    ] {
        let end = bench::within_limits(dir.path(), command);
        assert_eq!(end.code, Some(1), "{command}: {} {}", end.how, end.stderr);
        let said = ["check the unit", "length_mm"];
        assert!(
            said.iter().all(|w| end.stderr.contains(w)),
            "{}",
            end.stderr
        );
    }
}

/// Every command squares the voltage: turned about, it gives the same numbers and the same verdict in each.
#[test]
fn a_voltage_turned_about_gives_the_same_in_every_command() {
    let dir = tempfile::tempdir().unwrap();
    bench::lay(dir.path(), 1200);
    let told = |command: &str| -> serde_json::Value {
        let out = run(dir.path(), command);
        let error = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(0), "{command}: {error}");
        serde_json::from_slice(&out.stdout).unwrap()
    };
    let commands = [
        ("fit film symmetric --starts 1 --branches 1", "rmse_V"),
        ("validate symmetric --params parameters.toml", "rmse_V"),
        ("diagnose symmetric --only marker_offset", "train_rmse_V"),
    ];
    let all = || commands.map(|(c, _)| told(&format!("{c} --json -o out --force")));
    let plain = all();
    let path = dir.path().join("symmetric/voltage.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let turned = text.lines().enumerate().map(|(i, line)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if i > 0 {
            (cells[1..].iter_mut()).for_each(|c| *c = format!("{}", -c.parse::<f64>().unwrap()));
        }
        cells.join(",")
    });
    std::fs::write(&path, turned.collect::<Vec<_>>().join("\n") + "\n").unwrap();
    for ((command, error), (before, after)) in commands.iter().zip(plain.iter().zip(&all())) {
        assert!(!before[error].is_null(), "{command}");
        for key in ["verdict", error] {
            assert_eq!(before[key], after[key], "{command}");
        }
    }
}

mod robot_numbers {
    use super::common::{golden, parameters, robot};
    use deacal::calibration::{Request, Stage, calibrate_robot, validate_robot};
    use deacal::dataset::{Dataset, Parts, Voltage};
    use deacal::film::InitialState;
    use deacal::model::{Parameters, Robot};
    use deacal::simulate::{Drive, Options, motion};
    use rand::SeedableRng;
    use rand_chacha::ChaCha12Rng;
    use rand_distr::{Distribution, StandardNormal};

    struct Trial {
        robot: Robot,
        truth: Parameters,
        position_m: Vec<[f64; 3]>,
        volts: Vec<[f64; 3]>,
    }

    fn trial() -> Trial {
        trial_of(11)
    }

    /// 40 s of the symmetric drive, captured at 100 Hz with 0.03 mm of noise.
    fn trial_of(seed: u64) -> Trial {
        let g = golden("inverse_dynamics");
        let (robot, truth) = (robot(&g["rig"]), parameters(&g["cases"][0]));
        let duration_s = 40.0;
        let drive = Drive::Sine {
            peak_v: [5000.0; 3],
            frequency_hz: 1.0 / 3.0,
            phase_rad: [0.0; 3],
        };
        let voltage = drive.sampled(duration_s, 1000.0).unwrap();
        let options = Options {
            duration_s,
            ..Options::default()
        };
        let m = motion(&robot, &truth, &voltage, &options, &[]).unwrap();
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let position_m = (m.position_m.iter())
            .map(|u| {
                u.map(|v| {
                    let z: f64 = StandardNormal.sample(&mut generator);
                    v + 3e-5 * z
                })
            })
            .collect();
        Trial {
            robot,
            truth,
            position_m,
            volts: voltage.samples_v().to_vec(),
        }
    }

    impl Trial {
        fn dataset(&self, lost: std::ops::Range<f64>, sign: impl Fn(f64) -> f64) -> Dataset {
            let mut measured_m = self.position_m.clone();
            for (i, u) in measured_m.iter_mut().enumerate() {
                if lost.contains(&(i as f64 * 0.01)) {
                    *u = [f64::NAN; 3];
                }
            }
            let time_s: Vec<f64> = (0..self.volts.len()).map(|i| i as f64 * 1e-3).collect();
            let channel = |k: usize| -> Vec<f64> {
                (self.volts.iter().zip(&time_s))
                    .map(|(v, t)| sign(*t) * v[k])
                    .collect()
            };
            Dataset::new(
                Parts {
                    id: "trial".into(),
                    step_s: 0.01,
                    start_s: 0.0,
                    payload_kg: vec![0.0; measured_m.len()],
                    measured_m,
                    voltage: Voltage::new(
                        time_s.clone(),
                        vec![channel(0), channel(1), channel(2)],
                        false,
                    ),
                    monitor: None,
                    offset_s: Some(0.0),
                    initial: InitialState::Relaxed,
                },
                None,
            )
            .unwrap()
        }
    }

    /// Whatever is lost of a recording, true parameters fit what is left, and what is left gives them back.
    #[test]
    fn gaps_of_any_length_and_place_leave_the_rest() {
        let trial = trial();
        let whole = trial.dataset(0.0..0.0, |_| 1.0);
        let error = |d: &Dataset| {
            let o = validate_robot(&trial.robot, &[d], &trial.truth).unwrap();
            (o.total.rmse_v, o.total.noise_floor_v, o.total.samples)
        };
        let (bare, floor, samples) = error(&whole);
        assert!(bare < 1.5 * floor, "{bare} {floor}");
        let request = Request {
            starts: 1,
            start: Some(trial.truth.clone()),
            ..Request::new(Stage::Film)
        };
        let fit = |d: &Dataset| {
            calibrate_robot(&trial.robot, &[d], &request, &|_| {
                std::ops::ControlFlow::Continue(())
            })
            .unwrap()
        };
        let of_whole = fit(&whole);
        for lost in [
            15.0..15.1,
            15.0..15.3,
            15.0..16.0,
            14.2..17.2,
            15.0..20.0,
            12.0..22.0,
            0.0..1.0,
            0.0..5.0,
            39.0..41.0,
            30.0..41.0,
        ] {
            let d = trial.dataset(lost.clone(), |_| 1.0);
            let (rmse, own_floor, kept) = error(&d);
            println!("{lost:?}: {rmse:.2} V, noise {own_floor:.2} V, {kept} of {samples}");
            // what began unseen is known least: the film's first state is that of the bridged path
            let times = if lost.start == 0.0 { 2.0 } else { 1.5 };
            assert!(
                rmse < times * own_floor && rmse < 2.0 * times * bare,
                "{lost:?}: {rmse} V, {bare} V without"
            );
            assert!(kept > samples / 3, "{lost:?}: {kept} of {samples} are left");
            if lost.end - lost.start > 0.9 {
                assert!(
                    d.notes.iter().any(|n| n.contains("gap of")),
                    "{:?}",
                    d.notes
                );
            }
            let fitted = fit(&d);
            let [value, whole] = [&fitted, &of_whole].map(|o| {
                let e = o.estimates.iter().find(|e| e.name == "mu_1").unwrap();
                println!("  mu_1 {:.0} +- {:.0}", e.value, e.std_error);
                (e.value, e.std_error)
            });
            let true_mu = trial.truth.film.mu_pa[0];
            assert!(
                (value.0 - true_mu).abs() < 3.0 * value.1,
                "{lost:?}: {value:?}, {true_mu}"
            );
            assert!(value.1 < 3.0 * whole.1, "{lost:?}: {value:?}, {whole:?}");
            assert!(
                fitted.total.rmse_v < 1.5 * fitted.total.noise_floor_v,
                "{lost:?}"
            );
        }
    }

    /// What is lost at the beginning leaves the film's first state open: the errors that a fit states are
    /// those that it makes.
    #[test]
    fn a_beginning_that_is_lost_is_in_the_stated_errors() {
        let off = |lost: std::ops::Range<f64>| -> Vec<(String, f64, f64)> {
            (0..5)
                .flat_map(|seed| {
                    let trial = trial_of(40 + seed);
                    let d = trial.dataset(lost.clone(), |_| 1.0);
                    let request = Request {
                        starts: 1,
                        start: Some(trial.truth.clone()),
                        ..Request::new(Stage::Film)
                    };
                    let watch =
                        |_: &deacal::fit::separable::State| std::ops::ControlFlow::Continue(());
                    let o = calibrate_robot(&trial.robot, &[&d], &request, &watch).unwrap();
                    let film = &trial.truth.film;
                    let of = |name: &str, truth: f64| {
                        let e = o.estimates.iter().find(|e| e.name == name).unwrap();
                        let z = (e.value - truth) / e.std_error;
                        (name.to_owned(), z, o.total.rmse_v / o.total.noise_floor_v)
                    };
                    [
                        of("mu_1", film.mu_pa[0]),
                        of("mu_2", film.mu_pa[1]),
                        of("T_2", film.relaxation_time_s[1]),
                        of("mu_4", film.mu_pa[3]),
                    ]
                })
                .collect()
        };
        for lost in [0.0..1.0, 0.0..4.0] {
            let all = off(lost.clone());
            let n = all.len() as f64;
            let rms = (all.iter().map(|a| a.1 * a.1).sum::<f64>() / n).sqrt();
            let ratio = all.iter().map(|a| a.2).sum::<f64>() / n;
            println!("{lost:?}: z {rms:.2} rms, rmse over noise {ratio:.2}");
            assert!(
                rms < 1.2 && all.iter().all(|a| a.1.abs() < 3.5),
                "{lost:?}: {all:?}"
            );
            assert!(ratio < 1.15, "{lost:?}: {ratio}");
        }
    }

    /// The film feels the square: a command's sign is no error.
    #[test]
    fn a_commands_sign_is_no_error() {
        let trial = trial();
        let error = |sign: &dyn Fn(f64) -> f64| {
            let d = trial.dataset(0.0..0.0, sign);
            validate_robot(&trial.robot, &[&d], &trial.truth)
                .unwrap()
                .total
        };
        let plain = error(&|_| 1.0);
        // turned where the drive is at 0 V
        let turned = |t: f64| {
            if (t / 3.0).floor() % 2.0 == 0.0 {
                1.0
            } else {
                -1.0
            }
        };
        for (what, other) in [
            ("negative", error(&|_| -1.0)),
            ("alternating", error(&turned)),
        ] {
            assert!(
                (other.rmse_v - plain.rmse_v).abs() < 0.01 * plain.rmse_v,
                "{what}: {} {}",
                other.rmse_v,
                plain.rmse_v
            );
            assert_eq!(other.samples, plain.samples, "{what}");
        }
    }

    /// A voltage that never changes tells nothing of the clocks.
    #[test]
    fn a_constant_voltage_leaves_the_clock_offset_open() {
        let trial = trial();
        let mut d = trial.dataset(0.0..0.0, |_| 1.0);
        let time_s: Vec<f64> = d.voltage.time_s().to_vec();
        let held = vec![3000.0; time_s.len()];
        let parts = Parts {
            id: "held".into(),
            step_s: d.step_s,
            start_s: 0.0,
            measured_m: std::mem::take(&mut d.measured_m),
            payload_kg: vec![0.0; trial.position_m.len()],
            voltage: Voltage::new(time_s, vec![held.clone(), held.clone(), held], false),
            monitor: None,
            offset_s: None,
            initial: InitialState::Relaxed,
        };
        let d = Dataset::new(parts, None).unwrap();
        assert!(d.offset_s.abs() < 0.051, "{} s", d.offset_s);
        let request = Request {
            starts: 1,
            branches: 2,
            ..Request::new(Stage::Film)
        };
        let o = calibrate_robot(&trial.robot, &[&d], &request, &|_| {
            std::ops::ControlFlow::Continue(())
        })
        .unwrap();
        let e = o
            .estimates
            .iter()
            .find(|e| e.name.starts_with("offset_s"))
            .unwrap();
        assert!(!e.identifiable && !e.std_error.is_finite(), "{e:?}");
        assert!(e.says.contains("not determined"), "{}", e.says);
    }
}

/// The last gate: a parameter that is no finite number is named, not written.
#[test]
fn a_parameter_that_is_no_number_is_not_written() {
    use deacal::report::parameter_file::ParameterFile;
    let g = golden("inverse_dynamics");
    let mut parameters = common::parameters(&g["cases"][0]);
    assert!(ParameterFile::of(&parameters, None).to_toml().is_ok());
    parameters.film.mu_pa[2] = f64::NAN;
    let error = ParameterFile::of(&parameters, None).to_toml().unwrap_err();
    assert!(
        error.to_string().contains("film.mu_Pa[2] came out as NaN"),
        "{error}"
    );
}
