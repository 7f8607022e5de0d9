//! What is wrong with a recording is said before anything is fitted: a table of mistakes, each made to a
//! sound recording's files or manifest as a user would make it, and sound recordings, none of which is
//! accused.

use std::path::{Path, PathBuf};

use crate::common;
use deacal::checks::{Finding, Grade, check};
use deacal::recording::Recording;

/// The files of a recording, by name.
#[derive(Clone)]
struct Files(Vec<(String, String)>);

impl Files {
    /// Those of a folder, with the rig that its manifest names beside it.
    fn of(folder: &str) -> Self {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("datasets")
            .join(folder);
        let mut out = Vec::new();
        for entry in std::fs::read_dir(&dir).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if name.ends_with(".toml") || name.ends_with(".csv") {
                out.push((
                    name,
                    std::fs::read_to_string(&path)
                        .unwrap()
                        .replace("\r\n", "\n"),
                ));
            }
        }
        let rig = dir.join("../rig.toml");
        if rig.exists() {
            out.push(("rig.toml".into(), std::fs::read_to_string(rig).unwrap()));
        }
        let mut files = Files(out);
        files.text("recording.toml", |t| t.replace("../rig.toml", "rig.toml"));
        files
    }

    fn text(&mut self, name: &str, change: impl Fn(&str) -> String) {
        let file = self.0.iter_mut().find(|f| f.0 == name).unwrap();
        let changed = change(&file.1);
        file.1 = changed;
    }

    /// Replaces a text that has to be there.
    fn put(mut self, name: &str, from: &str, to: &str) -> Self {
        self.text(name, |t| {
            assert!(t.contains(from), "{name} has no `{from}`");
            t.replace(from, to)
        });
        self
    }

    /// Changes the cells of every row of numbers; `None` loses the row.
    fn rows(
        mut self,
        name: &str,
        change: impl Fn(usize, Vec<String>) -> Option<Vec<String>>,
    ) -> Self {
        self.text(name, |t| {
            let mut out = String::new();
            let mut row = 0;
            for line in t.lines() {
                let cells: Vec<String> = line.split(',').map(str::to_owned).collect();
                let data = cells.len() > 1 && cells[0].parse::<f64>().is_ok();
                if !data {
                    out += line;
                    out.push('\n');
                    continue;
                }
                if let Some(cells) = change(row, cells) {
                    out += &cells.join(",");
                    out.push('\n');
                }
                row += 1;
            }
            out
        });
        self
    }

    /// Changes the numbers of a row of the motion: x, y, z of the end effector and of the base.
    fn motion(self, change: impl Fn(usize, [f64; 6]) -> [f64; 6]) -> Self {
        self.rows("motion.csv", |row, cells| {
            let mut v = [0.0; 6];
            for (v, c) in v.iter_mut().zip(&cells[2..8]) {
                *v = c.parse().ok()?;
            }
            let v = change(row, v);
            let mut out = cells[..2].to_vec();
            out.extend(v.iter().map(|v| format!("{v:.3}")));
            Some(out)
        })
    }

    /// Changes time and voltages of a row.
    fn voltage(self, change: impl Fn(usize, &mut Vec<f64>)) -> Self {
        self.rows("voltage.csv", |row, cells| {
            let mut v: Vec<f64> = cells.iter().map(|c| c.parse().unwrap()).collect();
            change(row, &mut v);
            Some(v.iter().map(|v| format!("{v:.4}")).collect())
        })
    }

    fn write(&self, dir: &Path) -> PathBuf {
        std::fs::create_dir_all(dir).unwrap();
        for (name, text) in &self.0 {
            std::fs::write(dir.join(name), text).unwrap();
        }
        dir.join("recording.toml")
    }
}

/// Noise without a generator: the same on every machine.
struct Noise(u64);

impl Noise {
    fn normal(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        (0..12).map(|_| uniform()).sum()
    }
}

/// A hanging sample: its free end falls with the squared voltage, at once and by creep.
fn sample(seed: u64) -> Files {
    let mut noise = Noise(seed);
    let (mut motion, mut volts) = (
        String::from(
            "Trajectories\n100\n,,Sample:End,,,Sample:Frame,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n,,mm,mm,mm,mm,mm,mm\n",
        ),
        String::from("time_s,phi_kV\n"),
    );
    let drive = |t: f64| if t < 1.0 { 0.0 } else { 2.0 - 2.0 * (std::f64::consts::TAU * 0.4 * (t - 1.0)).cos() } * 1.3;
    let mut slow = [0.0; 2];
    for i in 0..3000 {
        let t = 0.01 * f64::from(i);
        let squared = drive(t).powi(2);
        slow[0] += 0.01 / 0.7 * (squared - slow[0]);
        slow[1] += 0.01 / 9.0 * (squared - slow[1]);
        let down = 0.06 * squared + 0.012 * slow[0] + 0.008 * slow[1];
        let n: Vec<f64> = (0..6).map(|_| 0.03 * noise.normal()).collect();
        motion += &format!(
            "{},0,{:.3},{:.3},{:.3},{:.3},{:.3},{:.3}\n",
            i + 1,
            -297.2 + n[0],
            185.6 + n[1],
            830.8 - down + n[2],
            -312.4 + n[3],
            188.7 + n[4],
            902.3 + n[5]
        );
        volts += &format!("{t:.3},{:.4}\n", drive(t));
    }
    let manifest = "[recording]\nid = \"sample\"\nkind = \"film-sample\"\nrig = \"rig.toml\"\npayload_g = 0.0\nfilm_state = \"relaxed\"\n\n[motion]\nfile = \"motion.csv\"\nend_effector = \"Sample:End\"\nbase = \"Sample:Frame\"\nbase_position_mm = [0.0, 0.0, 0.0]\nrotation_deg = [0.0, 0.0, 0.0]\n\n[voltage]\nfile = \"voltage.csv\"\ntime = \"time_s\"\nchannels = [\"phi_kV\"]\nunit = \"kV\"\n\n[sync]\noffset_s = 0.0\n";
    let rig = "[rig]\nid = \"s\"\nkind = \"film-sample\"\n[sample]\nwidth_mm = 45.0\nlength_mm = 60.0\nmargin_mm = 3.0\nfilms = 1\n[film]\nL3_mm = 0.1\neps_r = 2.8\n[mass]\nm_g = 50.0\n";
    Files(vec![
        ("motion.csv".into(), motion),
        ("voltage.csv".into(), volts),
        ("recording.toml".into(), manifest.into()),
        ("rig.toml".into(), rig.into()),
    ])
}

/// A hinge bench: a torque that rises with the angle, with dry friction.
fn bench(seed: u64) -> Files {
    let mut noise = Noise(seed);
    let mut table = String::from("t,angle,torque\n");
    let mut before = 0.0;
    for i in 0..1500 {
        let t = 0.02 * f64::from(i);
        let angle = 0.5 * (std::f64::consts::TAU * 0.1 * t).sin();
        let rate: f64 = angle - before;
        before = angle;
        let torque = 0.11 * angle + 0.05 * angle.powi(3) + 0.006 * (rate / 1e-4).tanh();
        table += &format!(
            "{t:.3},{:.6},{:.6}\n",
            angle + 2e-4 * noise.normal(),
            torque + 2e-4 * noise.normal()
        );
    }
    let manifest = "[recording]\nid = \"bench\"\nkind = \"hinge-bench\"\n\n[bench]\nfile = \"table.csv\"\ntime = \"t\"\nangle = \"angle\"\ntorque = \"torque\"\nunits = { time = \"s\", angle = \"rad\", torque = \"N m\" }\n";
    Files(vec![
        ("table.csv".into(), table),
        ("recording.toml".into(), manifest.into()),
    ])
}

/// An axis: mass, damper, spring and a little dry friction, driven by a few sines from rest.
fn axis(seed: u64) -> Files {
    let mut noise = Noise(seed);
    let mut table = String::from("t,x,u\n");
    let (mut x, mut v): (f64, f64) = (0.0, 0.0);
    let force = |t: f64| {
        [
            (0.31, 4.0, 0.3),
            (0.83, 3.0, 1.1),
            (1.9, 2.0, 2.0),
            (3.1, 1.0, 0.5),
        ]
        .iter()
        .map(|(f, a, p): &(f64, f64, f64)| {
            a * ((std::f64::consts::TAU * f * t + p).sin() - p.sin() * (-t).exp())
        })
        .sum::<f64>()
    };
    for i in 0..6000 {
        let t = 0.005 * f64::from(i);
        table += &format!(
            "{t:.4},{:.7},{:.5}\n",
            x + 2e-6 * noise.normal(),
            force(t) + 1e-3 * noise.normal()
        );
        for k in 0..10 {
            let dt = 0.0005;
            let a = (force(t + dt * f64::from(k)) - 4.0 * v - 250.0 * x - 0.1 * (v / 1e-3).tanh())
                / 1.4;
            v += a * dt;
            x += v * dt;
        }
    }
    let manifest = "[recording]\nid = \"axis\"\nkind = \"axis\"\n\n[axis]\nfile = \"table.csv\"\ntime = \"t\"\nposition = \"x\"\ninput = \"u\"\nunits = { time = \"s\", position = \"m\", input = \"N\" }\ninput_gain = 1.0\nmass_kg = \"estimate\"\ndamping = \"estimate\"\nstiffness = \"estimate\"\n";
    Files(vec![
        ("table.csv".into(), table),
        ("recording.toml".into(), manifest.into()),
    ])
}

/// A joint that gravity tips over, with dry friction and hardly any mass, led to and fro by a servo whose
/// torque is recorded: its stiffness is negative.
fn tipped(seed: u64) -> Files {
    let mut noise = Noise(seed);
    let mut table = String::from("t,x,u\n");
    let angle = |t: f64| {
        let of = |(f, a, p): (f64, f64, f64)| a * (std::f64::consts::TAU * f * t + p).sin();
        [(0.11, 0.3, 0.2), (0.27, 0.1, 1.4)]
            .map(of)
            .iter()
            .sum::<f64>()
    };
    for i in 0..6000 {
        let t = 0.005 * f64::from(i);
        let (x, ahead) = (angle(t), angle(t + 1e-4));
        let torque = 0.3 * ((ahead - x) / 1e-4 / 5e-3).tanh() - 2.4 * x;
        table += &format!(
            "{t:.4},{:.7},{:.5}\n",
            x + 2e-6 * noise.normal(),
            torque + 0.05 * noise.normal()
        );
    }
    let text = &axis(seed).0[1].1;
    let units = text.replace("\"m\", input = \"N\"", "\"rad\", input = \"N m\"");
    let manifest = units.replace("mass_kg", "inertia_kg_m2");
    Files(vec![
        ("table.csv".into(), table),
        ("recording.toml".into(), manifest),
    ])
}

/// The numbers of a table changed, a column at a time.
fn cell(files: Files, name: &str, change: impl Fn(usize, &mut [f64])) -> Files {
    files.rows(name, |row, cells| {
        let mut v: Vec<f64> = cells.iter().map(|c| c.parse().unwrap()).collect();
        change(row, &mut v);
        Some(v.iter().map(|v| format!("{v:.9}")).collect())
    })
}

/// A mistake: its name, the check that has to find it, a word of the remedy, and the recording with it.
type Mistake = (&'static str, &'static [&'static str], &'static str, Files);

const TURN: f64 = 0.087_266; // 5 degrees

fn mistakes() -> Vec<Mistake> {
    let circle = || Files::of("twin2026_delta/circle-3s");
    let one = || Files::of("twin2026_delta/single-1");
    let all = || Files::of("twin2026_delta/symmetric");
    let coupon = || Files::of("miles2015_vhb4910");
    let channels = "[\"phi1_kV\", \"phi2_kV\", \"phi3_kV\"]";
    let order = |f: Files, a: u8, b: u8, c: u8| {
        f.put(
            "recording.toml",
            channels,
            &format!("[\"phi{a}_kV\", \"phi{b}_kV\", \"phi{c}_kV\"]"),
        )
    };
    let turned = |f: Files, i: usize, j: usize, by: f64| {
        let (s, c) = by.sin_cos();
        f.motion(move |_, mut v| {
            for m in [0, 3] {
                let (a, b) = (v[m + i], v[m + j]);
                v[m + i] = c * a - s * b;
                v[m + j] = s * a + c * b;
            }
            v
        })
    };
    let offset = |f: Files, to: &str| {
        f.put(
            "recording.toml",
            "offset_s = 0.0",
            &format!("offset_s = {to}"),
        )
    };
    let rig = |f: Files, from: &str, to: &str| f.put("rig.toml", from, to);
    let swing = |f: Files| {
        f.rows("motion.csv", |row, cells| {
            Some(cells).filter(|_| !(1500..1600).contains(&row))
        })
    };
    vec![
        (
            "channels 2-1-3",
            &["chain_order"],
            "swap 1 and 2",
            order(circle(), 2, 1, 3),
        ),
        (
            "channels 2-3-1",
            &["chain_order"],
            "order",
            order(circle(), 2, 3, 1),
        ),
        (
            "channels 3-2-1 of a single drive",
            &["chain_order"],
            "order",
            order(one(), 3, 2, 1),
        ),
        (
            "x mirrored",
            &["mirror"],
            "right-handed",
            circle().motion(|_, mut v| {
                v[0] = -v[0];
                v[3] = -v[3];
                v
            }),
        ),
        (
            "y mirrored, a single drive",
            &["mirror", "axes"],
            "axes",
            one().motion(|_, mut v| {
                v[1] = -v[1];
                v[4] = -v[4];
                v
            }),
        ),
        (
            "turned by 5 degrees about z",
            &["axes"],
            "rotation_deg",
            turned(circle(), 0, 1, TURN),
        ),
        (
            "turned by 5 degrees about x, all driven",
            &["axes"],
            "rotation_deg",
            turned(all(), 1, 2, TURN),
        ),
        (
            "turned by 8 degrees about y",
            &["axes"],
            "rotation_deg",
            turned(circle(), 2, 0, 1.6 * TURN),
        ),
        (
            "y and z exchanged",
            &["axes", "mirror"],
            "axes",
            circle().motion(|_, v| [v[0], v[2], v[1], v[3], v[5], v[4]]),
        ),
        (
            "turned by 90 degrees about z",
            &["axes"],
            "rotation_deg",
            turned(circle(), 0, 1, 18.0 * TURN),
        ),
        (
            "capture rate 200 for 100",
            &["rate"],
            "rate",
            circle().put("motion.csv", "Trajectories\n100", "Trajectories\n200"),
        ),
        (
            "milliseconds under time_s",
            &["rate"],
            "ms",
            circle().voltage(|_, v| v[0] *= 1000.0),
        ),
        (
            "half of the voltage log",
            &["rate"],
            "log",
            circle().rows("voltage.csv", |row, c| (row < 3000).then_some(c)),
        ),
        (
            "clock 10 s late",
            &["clock", "rate"],
            "",
            offset(circle(), "10.0"),
        ),
        (
            "voltage clock 100 s ahead",
            &["clock", "rate"],
            "offset_s",
            circle().voltage(|_, v| v[0] += 100.0),
        ),
        (
            "10 s to be estimated",
            &["clock"],
            "offset_s",
            offset(circle().voltage(|_, v| v[0] += 10.0), "\"estimate\""),
        ),
        (
            "negative polarity",
            &["polarity"],
            "sign",
            circle().voltage(|_, v| v[1..].iter_mut().for_each(|v| *v = -*v)),
        ),
        (
            "alternating polarity",
            &["polarity"],
            "purpose",
            all().voltage(|_, v| {
                if (v[0] / 3.0) as usize % 2 == 1 {
                    v[1..].iter_mut().for_each(|v| *v = -*v);
                }
            }),
        ),
        (
            "gaps as -999",
            &["sentinel"],
            "empty",
            circle().motion(|row, mut v| {
                if (700..730).contains(&row) {
                    v[..3].fill(-999.0);
                }
                v
            }),
        ),
        (
            "gaps as 0, 0, 0",
            &["sentinel"],
            "empty",
            circle().motion(|row, mut v| {
                if (700..730).contains(&row) {
                    v[..3].fill(0.0);
                }
                v
            }),
        ),
        (
            "9999 in a voltage",
            &["sentinel"],
            "empty",
            circle().voltage(|row, v| {
                if row % 1000 == 500 {
                    v[2] = 9999.0;
                }
            }),
        ),
        (
            "a marker knocked by 15 mm",
            &["leap"],
            "cut",
            circle().motion(|row, mut v| {
                if row >= 1700 {
                    v[0] += 15.0;
                }
                v
            }),
        ),
        (
            "a frozen marker",
            &["frozen"],
            "empty",
            circle().rows("motion.csv", |_, c| Some(c)).frozen(),
        ),
        (
            "markers exchanged for a while",
            &["exchanged"],
            "labels",
            circle().motion(|row, v| {
                if (900..1000).contains(&row) {
                    [v[3], v[4], v[5], v[0], v[1], v[2]]
                } else {
                    v
                }
            }),
        ),
        (
            "end effector and base exchanged",
            &["exchanged"],
            "exchange",
            circle().put(
                "recording.toml",
                "end_effector = \"DEA:EE\"\nbase = \"DEA:Base\"",
                "end_effector = \"DEA:Base\"\nbase = \"DEA:EE\"",
            ),
        ),
        (
            "all voltages zero",
            &["dead_channel"],
            "channels",
            circle().voltage(|_, v| v[1..].fill(0.0)),
        ),
        (
            "one channel dead",
            &["dead_channel"],
            "channel",
            circle().voltage(|_, v| v[3] = 0.0),
        ),
        (
            "a second of frames lost",
            &["rows_lost", "leap"],
            "cut",
            swing(circle()).renumbered(),
        ),
        (
            "a second of the voltage lost",
            &["rows_lost"],
            "log",
            circle().rows("voltage.csv", |row, c| {
                Some(c).filter(|_| !(2000..2200).contains(&row))
            }),
        ),
        (
            "mass in kg",
            &["stated_value"],
            "g",
            rig(circle(), "m_g = 6.0", "m_g = 0.006"),
        ),
        (
            "2 kg of payload",
            &["stated_value"],
            "g",
            circle().put("recording.toml", "payload_g = 0.0", "payload_g = 2000.0"),
        ),
        (
            "L1 and L2 exchanged",
            &["stated_value"],
            "exchange",
            rig(
                rig(
                    rig(circle(), "L1_mm = 62.9", "L9_mm = 40.65"),
                    "L2_mm = 40.65",
                    "L2_mm = 62.9",
                ),
                "L9_mm",
                "L1_mm",
            ),
        ),
        (
            "85 mm of film",
            &["stated_value"],
            "mm",
            rig(circle(), "L3_mm = 0.085", "L3_mm = 85.0"),
        ),
        (
            "long side of the film short",
            &["stated_value"],
            "both sides",
            rig(all(), "L1_mm = 62.9", "L1_mm = 40.0"),
        ),
        (
            "short side of the film long",
            &["stated_value"],
            "both sides",
            rig(circle(), "L2_mm = 40.65", "L2_mm = 62.9"),
        ),
        (
            "sides of the lozenge halved",
            &["stated_value"],
            "l_dea_mm",
            rig(one(), "l_dea_mm = 50.0", "l_dea_mm = 25.0"),
        ),
        (
            "films in thousands",
            &["stated_value"],
            "films",
            rig(circle(), "films = 2 ", "films = 2000 "),
        ),
        (
            "angles in radians",
            &["stated_value"],
            "degrees",
            rig(
                circle(),
                "dea_offset_deg = 151.0",
                "dea_offset_deg = 2.6354",
            ),
        ),
        (
            "lengths in metres",
            &["stated_value"],
            "mm",
            rig(circle(), "q_mm = 50.0", "q_mm = 0.05"),
        ),
        (
            "volts stated for kilovolts",
            &["unit"],
            "kV",
            circle()
                .put("recording.toml", "unit = \"kV\"", "unit = \"V\"")
                .put("recording.toml", channels, "[1, 2, 3]")
                .numbered(),
        ),
        (
            "kilovolts stated for volts",
            &["unit"],
            "V",
            circle().voltage(|_, v| v[1..].iter_mut().for_each(|v| *v *= 1000.0)),
        ),
        (
            "metres under mm",
            &["unit"],
            "unit",
            circle().rows("motion.csv", |_, c| {
                let mut c = c;
                for v in &mut c[2..8] {
                    *v = format!("{:.6}", v.parse::<f64>().ok()? * 1e-3);
                }
                Some(c)
            }),
        ),
        (
            "rounded to 1 mm",
            &["resolution"],
            "decimals",
            circle().motion(|_, v| v.map(f64::round)),
        ),
        ("25 mm of noise", &["noise"], "marker", {
            let n = std::cell::RefCell::new(Noise(5));
            circle().motion(move |_, mut v| {
                for v in &mut v[..3] {
                    *v += 25.0 * n.borrow_mut().normal();
                }
                v
            })
        }),
        (
            "a base that moves",
            &["base"],
            "fix",
            circle().motion(|row, mut v| {
                for k in 3..6 {
                    v[k] += 0.004 * row as f64;
                }
                v
            }),
        ),
        (
            "voltages of another run",
            &["mismatch", "chain_order", "clock", "rate"],
            "",
            {
                let mut f = circle();
                let other = Files::of("concealed/cases/case-50effc92d2f12/train/02-multisine");
                let text = other
                    .0
                    .iter()
                    .find(|x| x.0 == "voltage.csv")
                    .unwrap()
                    .1
                    .clone();
                f.text("voltage.csv", |_| text.clone());
                f
            },
        ),
        // a hanging sample
        (
            "sample turned by 90 degrees",
            &["axes"],
            "rotation_deg",
            sample(1).motion(|_, v| [v[2], v[1], v[0], v[5], v[4], v[3]]),
        ),
        (
            "sample upside down",
            &["sign"],
            "rotation_deg",
            sample(1).motion(|_, mut v| {
                v[2] = -v[2];
                v[5] = -v[5];
                v
            }),
        ),
        (
            "sample's mass in kg",
            &["stated_value"],
            "g",
            rig(sample(1), "m_g = 50.0", "m_g = 0.05"),
        ),
        (
            "sample's thickness in micrometres",
            &["stated_value"],
            "mm",
            rig(sample(1), "L3_mm = 0.1", "L3_mm = 100.0"),
        ),
        (
            "sample's clock 7 s late",
            &["clock", "rate"],
            "",
            offset(sample(1), "7.0"),
        ),
        (
            "sample's gaps as 9999",
            &["sentinel"],
            "empty",
            sample(1).motion(|row, mut v| {
                if row % 500 == 77 {
                    v[..3].fill(9999.0);
                }
                v
            }),
        ),
        (
            "sample's voltages zero",
            &["dead_channel"],
            "channels",
            sample(1).voltage(|_, v| v[1] = 0.0),
        ),
        // a hinge bench
        (
            "bench in degrees",
            &["unit"],
            "deg",
            cell(bench(2), "table.csv", |_, v| v[1] = v[1].to_degrees()),
        ),
        (
            "bench in N mm",
            &["unit"],
            "N mm",
            cell(bench(2), "table.csv", |_, v| v[2] *= 1000.0),
        ),
        (
            "bench with a restoring torque",
            &["sign"],
            "sign",
            cell(bench(2), "table.csv", |_, v| v[2] = -v[2]),
        ),
        (
            "bench with -999",
            &["sentinel"],
            "empty",
            cell(bench(2), "table.csv", |row, v| {
                if row % 300 == 9 {
                    v[2] = -999.0;
                }
            }),
        ),
        // an axis
        (
            "axis with the force's sign",
            &["sign"],
            "sign",
            cell(axis(3), "table.csv", |_, v| v[2] = -v[2]),
        ),
        (
            "axis in mm under m",
            &["unit"],
            "mm",
            cell(axis(3), "table.csv", |_, v| v[1] *= 1000.0),
        ),
        (
            "axis in ms",
            &["rate"],
            "ms",
            cell(axis(3), "table.csv", |_, v| v[0] *= 1000.0),
        ),
        (
            "axis with 9999",
            &["sentinel"],
            "empty",
            cell(axis(3), "table.csv", |row, v| {
                if row % 700 == 9 {
                    v[1] = 9999.0;
                }
            }),
        ),
        (
            "axis with a negative mass",
            &["stated_value"],
            "positive",
            axis(3).put("recording.toml", "mass_kg = \"estimate\"", "mass_kg = -1.4"),
        ),
        (
            "axis with a second lost",
            &["rows_lost"],
            "file",
            axis(3).rows("table.csv", |row, c| {
                Some(c).filter(|_| !(3000..3200).contains(&row))
            }),
        ),
        // a coupon
        (
            "coupon in per cent",
            &["unit"],
            "100",
            cell(coupon(), "vhb4910_miles.csv", |_, v| {
                v[1] = 100.0 * (v[1] - 1.0)
            }),
        ),
        (
            "coupon's strain for stretch",
            &["unit"],
            "1",
            cell(coupon(), "vhb4910_miles.csv", |_, v| v[1] -= 1.0),
        ),
        (
            "coupon in kPa under MPa",
            &["unit"],
            "MPa",
            coupon()
                .put(
                    "recording.toml",
                    "nominal_stress = \"kPa\" }",
                    "nominal_stress = \"MPa\" }",
                )
                .put("vhb4910_miles.csv", "nominal_stress_kPa", "nominal_stress")
                .put(
                    "recording.toml",
                    "\"nominal_stress_kPa\"",
                    "\"nominal_stress\"",
                ),
        ),
        (
            "coupon with pull below zero",
            &["sign"],
            "sign",
            cell(coupon(), "vhb4910_miles.csv", |_, v| v[2] = -v[2]),
        ),
        (
            "coupon with -999",
            &["sentinel"],
            "empty",
            cell(coupon(), "vhb4910_miles.csv", |row, v| {
                if row % 300 == 9 {
                    v[2] = -999.0;
                }
            }),
        ),
    ]
}

impl Files {
    /// The end effector stands for a second and a half while the rows go on.
    fn frozen(self) -> Self {
        let held = std::cell::RefCell::new(None);
        self.motion(move |row, mut v| {
            let mut held = held.borrow_mut();
            if (800..950).contains(&row) {
                let here = [v[0], v[1], v[2]];
                v[..3].copy_from_slice(held.get_or_insert(here));
            }
            v
        })
    }

    /// Frame numbers without a hole.
    fn renumbered(self) -> Self {
        let next = std::cell::Cell::new(1);
        self.rows("motion.csv", move |_, mut cells| {
            cells[0] = next.get().to_string();
            next.set(next.get() + 1);
            Some(cells)
        })
    }

    /// The voltage's columns without units in their names.
    fn numbered(self) -> Self {
        self.put("voltage.csv", "phi1_kV,phi2_kV,phi3_kV", "a,b,c")
            .put("recording.toml", "[1, 2, 3]", "[\"a\", \"b\", \"c\"]")
    }
}

fn looked_at(name: &str, files: &Files) -> Vec<Finding> {
    let dir = tempfile::tempdir().unwrap();
    let path = files.write(dir.path());
    let recording = Recording::open(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
    check(&recording)
}

#[test]
fn mistakes_are_said_with_their_remedy() {
    let mut missed = Vec::new();
    let all = mistakes();
    for (name, checks, remedy, files) in &all {
        let found = looked_at(name, files);
        let right = |f: &&Finding| checks.contains(&f.check) && f.remedy.contains(remedy);
        let doubtful =
            matches!(checks[0], "polarity" | "resolution") || *name == "axis with a second lost";
        let graded = found
            .iter()
            .find(right)
            .is_some_and(|f| doubtful || f.grade == Grade::Wrong);
        if !graded {
            let said: Vec<String> = found
                .iter()
                .map(|f| format!("{}: {}", f.check, f.line()))
                .collect();
            missed.push(format!("{name}: {said:?}"));
        }
    }
    for line in &missed {
        println!("missed {line}");
    }
    assert!(all.len() >= 60, "{} mistakes", all.len());
    assert!(
        missed.len() * 20 <= all.len(),
        "{} of {} missed:\n{}",
        missed.len(),
        all.len(),
        missed.join("\n")
    );
}

/// What a sound recording is said to be: nothing.
fn accusations(path: &Path) -> Vec<String> {
    let recording = Recording::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let said = check(&recording);
    said.iter()
        .filter(|f| f.check != "polarity")
        .map(|f| format!("{}: {}: {}", path.display(), f.check, f.line()))
        .collect()
}

/// Every recording below a folder.
fn recordings_below(dir: &Path) -> Vec<PathBuf> {
    common::files_below(dir, "recording.toml")
}

#[test]
fn sound_recordings_are_not_accused() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut all = recordings_below(&root.join("datasets"));
    all.extend(recordings_below(&root.join("fits/silverbox2013")));
    assert!(
        all.len() >= 18,
        "{} recordings come with the program",
        all.len()
    );
    let mut accused: Vec<String> = all.iter().flat_map(|p| accusations(p)).collect();
    let dir = tempfile::tempdir().unwrap();
    for seed in 0..10 {
        for (kind, files) in [
            ("sample", sample(seed)),
            ("bench", bench(seed)),
            ("axis", axis(seed)),
            ("tipped", tipped(seed)),
        ] {
            accused.extend(accusations(
                &files.write(&dir.path().join(format!("{kind}-{seed}"))),
            ));
        }
    }
    assert!(accused.is_empty(), "{}", accused.join("\n"));
}

/// Simulated robots of every drive, noise, rate, clock and payload, some with a left-out cause; and the
/// practice recordings where DEACAL_SHARED says where they are.
/// `cargo test --release --test commands checks:: -- --ignored` (half a minute).
#[test]
#[ignore = "simulates 144 recordings: half a minute"]
fn sound_simulated_recordings_are_not_accused() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let dir = tempfile::tempdir().unwrap();
    let pick = |i: usize, of: &[&str]| of[i % of.len()].to_owned();
    let mut all = Vec::new();
    for i in 0..144 {
        let peak = pick(i / 8, &["2500", "3500", "4500", "5300"]);
        let hz = pick(i / 3, &["0.1", "0.333", "0.7", "1.5", "2.5"]);
        let drive = match i % 8 {
            0 => format!("sine:peak_V={peak},hz={hz}"),
            1 => format!("sine:peak_V={peak},hz={hz},phase_deg=0/120/240"),
            2 => format!("sine:peak_V={peak}/0/0,hz=0.333"),
            3 => format!("sine:peak_V=0/{peak}/0,hz=0.4"),
            4 => format!("multisine:peak_V={peak},hz=0.1/0.3/0.7"),
            5 => format!("staircase:peak_V={peak},steps=5,hold_s=3"),
            6 => format!("holds:levels_V={peak}/2000/0,time_s=6/6/4,scale=1/0.3/0"),
            _ => format!("chirp:peak_V={peak},from_hz=0.1,to_hz=2"),
        };
        let folder = dir.path().join(i.to_string());
        let mut run = std::process::Command::new(env!("CARGO_BIN_EXE_deacal"));
        run.args([
            "simulate",
            "-q",
            "--drive",
            &drive,
            "--seed",
            &i.to_string(),
        ])
        .arg("--rig")
        .arg(root.join("datasets/twin2026_delta/rig.toml"))
        .arg("--params")
        .arg(root.join("fits/twin2026_delta/parameters.toml"))
        .arg("-o")
        .arg(&folder)
        .args([
            "--noise",
            &pick(i / 5, &["0", "0.01", "0.03", "0.1", "0.3"]),
        ])
        .args(["--rate", &pick(i / 2, &["50", "100", "200"])])
        .args(["--clock-offset", &pick(i / 7, &["0", "0.4", "-3"])]);
        if drive.starts_with("sine") || drive.starts_with("chirp") {
            run.args(["--duration", &pick(i / 4, &["12", "30", "60"])]);
        }
        if i % 5 == 3 {
            run.args(["--stated-offset", "estimate"]);
        }
        if i % 7 == 2 {
            run.args(["--gap", "4:1.2"]);
        }
        if i % 9 == 4 {
            run.args(["--payload", "0,5:4"]);
        }
        if i % 6 == 5 {
            run.args(["--coloured-noise", "0.1"]);
        }
        if i % 13 == 6 {
            run.args(["--flip-every", "4"]);
        }
        let cause = pick(
            i / 2,
            &[
                "",
                "series_resistance:resistance=1.2e7",
                "marker_offset:offset=2e-3/1e-3/0",
                "",
                "frame_tilt:rotation=0.03/-0.02/0.03",
                "time_offset:offset=0.08",
                "link_length_error:link=q,relative_error=0.01",
            ],
        );
        if !cause.is_empty() {
            run.args(["--effect", &cause]);
        }
        let done = run.output().unwrap();
        assert!(
            done.status.success(),
            "{drive}: {}",
            String::from_utf8_lossy(&done.stderr)
        );
        all.push(folder.join("recording.toml"));
    }
    match std::env::var_os("DEACAL_SHARED") {
        Some(shared) => {
            for folder in ["practice", "practice-built", "twin"] {
                let folder = Path::new(&shared).join("datasets").join(folder);
                all.extend(recordings_below(&folder));
            }
        }
        None => println!("skipped: the practice recordings, DEACAL_SHARED is not set"),
    }
    let accused: Vec<String> = all.iter().flat_map(|p| accusations(p)).collect();
    println!(
        "{} of {} sound recordings accused",
        accused.len(),
        all.len()
    );
    assert!(accused.is_empty(), "{}", accused.join("\n"));
}

#[test]
fn a_diagnosis_of_a_wrong_recording_names_no_physics() {
    let dir = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let done = std::process::Command::new(env!("CARGO_BIN_EXE_deacal"))
            .args(arguments)
            .output()
            .unwrap();
        assert!(
            done.status.success(),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&done.stderr)
        );
        serde_json::from_slice::<serde_json::Value>(&done.stdout).unwrap()
    };
    let output = dir.path().join("out");
    let output = output.to_str().unwrap();
    for (i, (name, checks, _, files)) in mistakes().iter().enumerate() {
        let wrong = |f: &Finding| f.grade == Grade::Wrong;
        // what is only doubtful is diagnosed; hanging samples are not
        if name.starts_with("sample") || !looked_at(name, files).iter().any(wrong) {
            continue;
        }
        let path = files.write(&dir.path().join(i.to_string()));
        let path = path.to_str().unwrap();
        let found = run(&["diagnose", path, "--json", "-o", output]);
        assert_eq!(found["verdict"], "recording", "{name}");
        assert_eq!(found["candidates"], serde_json::json!([]), "{name}");
        assert!(!found["findings"].as_array().unwrap().is_empty(), "{name}");
        if i % 6 == 0 {
            let found = run(&["import", path, "--json", "-o", output]);
            let said = found["recordings"][0]["findings"].as_array().unwrap();
            assert!(
                said.iter()
                    .any(|f| checks.contains(&f["check"].as_str().unwrap())),
                "{name}"
            );
        }
    }
    let page = std::fs::read_to_string(Path::new(output).join("report.html")).unwrap();
    let (found, summary) = (page.find("id=\"findings\""), page.find("id=\"summary\""));
    assert!(found.unwrap() < summary.unwrap(), "findings stand first");
}

#[test]
fn parameters_that_cannot_be_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("fits/twin2026_delta/parameters.toml")).unwrap();
    let path = dir.path().join("parameters.toml");
    for (first, word) in [("-5.0", "not below 0"), ("1.0968825", "MPa")] {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let at = lines
            .iter()
            .position(|l| l.starts_with("mu_Pa = ["))
            .unwrap()
            + 1;
        lines[at] = format!("  {first},");
        if word == "MPa" {
            for line in &mut lines[at + 1..at + 7] {
                *line = "  0.05,".into();
            }
        }
        std::fs::write(&path, lines.join("\n")).unwrap();
        let done = std::process::Command::new(env!("CARGO_BIN_EXE_deacal"))
            .args(["validate", "-q", "-o"])
            .arg(dir.path().join("out"))
            .arg("--params")
            .arg(&path)
            .arg(root.join("datasets/twin2026_delta/single-1"))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(!done.status.success() && said.contains(word), "{said}");
    }
}
