//! Recordings of single coordinates as files, and as what is read from these files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::recording::{
    CouponMode, Manifest, RawAxis, RawBench, RawColumn, RawCoordinate, RawCoupon, RawElongation,
    RawLoad, Recording,
};
use crate::units::Unit;

/// What the manifest of an axis says; what it does not say is to be found.
#[derive(Debug, Clone, Copy)]
pub struct AxisText {
    /// N per unit of input.
    pub gain: Option<f64>,
    /// kg.
    pub mass: Option<f64>,
    /// N s/m.
    pub damping: Option<f64>,
    /// N/m.
    pub stiffness: Option<f64>,
    /// The input is a force.
    pub force_cell: bool,
}

/// Names and bytes of `recording.toml` and `run.csv`.
pub type Files = [(&'static str, Vec<u8>); 2];

/// What a manifest says.
#[derive(Debug, Clone, Copy)]
pub enum Text {
    /// Of an axis.
    Axis(AxisText),
    /// Of a bench.
    Bench,
    /// Of a coupon.
    Coupon,
}

/// What instruments wrote.
#[derive(Debug, Clone)]
pub enum Columns {
    /// An axis.
    Axis {
        /// s.
        time_s: Vec<f64>,
        /// m.
        position_m: Vec<f64>,
        /// V, or N of a force cell.
        input: Vec<f64>,
    },
    /// A bench.
    Bench {
        /// s; not every bench writes it.
        time_s: Option<Vec<f64>>,
        /// rad.
        angle_rad: Vec<f64>,
        /// N m.
        torque_n_m: Vec<f64>,
    },
    /// A coupon.
    Coupon {
        /// s.
        time_s: Vec<f64>,
        /// 1.
        stretch: Vec<f64>,
        /// Pa.
        stress_pa: Vec<f64>,
    },
}

/// A number as the files have it, and the number that is read back.
fn digits(v: f64) -> (String, f64) {
    let text = format!("{v:.8e}");
    let read = text.parse().unwrap_or(v);
    (text, read)
}

fn csv(header: &str, columns: &[&[f64]]) -> (String, Vec<Vec<f64>>) {
    let mut text = String::new();
    let mut read: Vec<Vec<f64>> = columns
        .iter()
        .map(|c| Vec::with_capacity(c.len()))
        .collect();
    let _ = writeln!(text, "{header}");
    for row in 0..columns[0].len() {
        for (j, column) in columns.iter().enumerate() {
            let (word, value) = digits(column[row]);
            if j > 0 {
                text.push(',');
            }
            text.push_str(&word);
            read[j].push(value);
        }
        text.push('\n');
    }
    (text, read)
}

fn unit(symbol: &str) -> Option<&'static Unit> {
    Unit::parse(symbol)
}

fn raw(label: &str, symbol: &str, values: Vec<f64>) -> RawColumn {
    RawColumn {
        label: label.into(),
        unit: unit(symbol),
        values,
    }
}

/// The files of a recording: `recording.toml` and `run.csv`; and the recording that opening them gives.
///
/// # Errors
/// A manifest that does not read back.
pub fn write(id: &str, text: &Text, columns: &Columns) -> Result<(Files, Recording), String> {
    let mut toml = String::new();
    let estimate = |v: Option<f64>| v.map_or("\"estimate\"".to_owned(), |v| format!("{v:?}"));
    let table;
    let (mut raw_axis, mut raw_bench, mut raw_coupon) = (None, None, None);
    match columns {
        Columns::Axis {
            time_s,
            position_m,
            input,
        } => {
            let Text::Axis(text) = text else {
                return Err("an axis without constants".into());
            };
            let symbol = if text.force_cell { "N" } else { "V" };
            let label = format!("u_{symbol}");
            let _ = write!(
                toml,
                "[recording]\nid = \"{id}\"\nkind = \"axis\"\n\n[axis]\nfile = \"run.csv\"\ntime = \"t_s\"\nposition = \"x_m\"\ninput = \"{label}\"\nunits = {{ time = \"s\", position = \"m\", input = \"{symbol}\" }}\ninput_gain = {}\nmass_kg = {}\ndamping = {}\nstiffness = {}\n",
                estimate(text.gain),
                estimate(text.mass),
                estimate(text.damping),
                estimate(text.stiffness),
            );
            let (words, mut read) = csv(&format!("t_s,x_m,{label}"), &[time_s, position_m, input]);
            table = words;
            let (u, x, t) = (
                read.pop().unwrap_or_default(),
                read.pop().unwrap_or_default(),
                read.pop().unwrap_or_default(),
            );
            raw_axis = Some(RawAxis {
                time_s: t,
                input_time_s: None,
                coordinate: RawCoordinate::Position(raw("x_m", "m", x)),
                input: raw(&label, symbol, u),
                input_unit: symbol.into(),
                load: None,
            });
        }
        Columns::Bench {
            time_s,
            angle_rad,
            torque_n_m,
        } => {
            let clock = if time_s.is_some() {
                "time = \"t_s\"\n"
            } else {
                ""
            };
            let time_unit = if time_s.is_some() {
                "time = \"s\", "
            } else {
                ""
            };
            let _ = write!(
                toml,
                "[recording]\nid = \"{id}\"\nkind = \"hinge-bench\"\n\n[bench]\nfile = \"run.csv\"\n{clock}angle = \"angle_rad\"\ntorque = \"torque_Nm\"\nunits = {{ {time_unit}angle = \"rad\", torque = \"N m\" }}\n"
            );
            let mut list: Vec<&[f64]> = vec![angle_rad, torque_n_m];
            let mut header = "angle_rad,torque_Nm".to_owned();
            if let Some(t) = time_s {
                list.insert(0, t);
                header.insert_str(0, "t_s,");
            }
            let (words, mut read) = csv(&header, &list);
            table = words;
            let torque = read.pop().unwrap_or_default();
            let angle = read.pop().unwrap_or_default();
            raw_bench = Some(RawBench {
                time_s: read.pop(),
                angle: raw("angle_rad", "rad", angle),
                torque: raw("torque_Nm", "N m", torque),
            });
        }
        Columns::Coupon {
            time_s,
            stretch,
            stress_pa,
        } => {
            let _ = write!(
                toml,
                "[recording]\nid = \"{id}\"\nkind = \"film-coupon\"\nfilm_state = \"virgin\"\n\n[coupon]\nfile = \"run.csv\"\nmode = \"uniaxial\"\ntime = \"t_s\"\nstretch = \"stretch\"\nnominal_stress = \"stress_Pa\"\nunits = {{ time = \"s\", stretch = \"1\", nominal_stress = \"Pa\" }}\n"
            );
            let (words, mut read) = csv("t_s,stretch,stress_Pa", &[time_s, stretch, stress_pa]);
            table = words;
            let stress = read.pop().unwrap_or_default();
            let stretch = read.pop().unwrap_or_default();
            raw_coupon = Some(RawCoupon {
                mode: CouponMode::Uniaxial,
                time_s: read.pop(),
                time_steps_back: Vec::new(),
                elongation: RawElongation::Stretch(raw("stretch", "1", stretch)),
                load: RawLoad::NominalStress(raw("stress_Pa", "Pa", stress)),
            });
        }
    }
    let path = Path::new("recording.toml");
    let recording = Recording {
        manifest: Manifest::parse(path, &toml).map_err(|e| e.to_string())?,
        rig: None,
        rig_path: None,
        path: path.into(),
        dir: PathBuf::new(),
        motion: None,
        voltage: None,
        monitor: None,
        coupon: raw_coupon,
        bench: raw_bench,
        axis: raw_axis,
        sources: Vec::new(),
        notes: Vec::new(),
    };
    let files = [
        ("recording.toml", toml.into_bytes()),
        ("run.csv", table.into_bytes()),
    ];
    Ok((files, recording))
}
