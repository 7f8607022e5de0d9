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

/// What one kind of recording makes of its columns: manifest, table, and what is read back of it.
struct Written {
    toml: String,
    table: String,
    axis: Option<RawAxis>,
    bench: Option<RawBench>,
    coupon: Option<RawCoupon>,
}

impl Written {
    /// Nothing read back yet.
    fn new(toml: String, table: String) -> Self {
        Written {
            toml,
            table,
            axis: None,
            bench: None,
            coupon: None,
        }
    }
}

/// An axis: time, position, input.
fn written_axis(id: &str, text: &AxisText, [time_s, position_m, input]: [&[f64]; 3]) -> Written {
    let estimate = |v: Option<f64>| v.map_or("\"estimate\"".to_owned(), |v| format!("{v:?}"));
    let symbol = if text.force_cell { "N" } else { "V" };
    let label = format!("u_{symbol}");
    let toml = format!(
        "[recording]\nid = \"{id}\"\nkind = \"axis\"\n\n[axis]\nfile = \"run.csv\"\ntime = \"t_s\"\nposition = \"x_m\"\ninput = \"{label}\"\nunits = {{ time = \"s\", position = \"m\", input = \"{symbol}\" }}\ninput_gain = {}\nmass_kg = {}\ndamping = {}\nstiffness = {}\n",
        estimate(text.gain),
        estimate(text.mass),
        estimate(text.damping),
        estimate(text.stiffness),
    );
    let (table, mut read) = csv(&format!("t_s,x_m,{label}"), &[time_s, position_m, input]);
    let (u, x, t) = (
        read.pop().unwrap_or_default(),
        read.pop().unwrap_or_default(),
        read.pop().unwrap_or_default(),
    );
    Written {
        axis: Some(RawAxis {
            time_s: t,
            input_time_s: None,
            coordinate: RawCoordinate::Position(raw("x_m", "m", x)),
            input: raw(&label, symbol, u),
            input_unit: symbol.into(),
            load: None,
        }),
        ..Written::new(toml, table)
    }
}

/// A bench, with or without a time.
fn written_bench(id: &str, time_s: Option<&[f64]>, angle: &[f64], torque: &[f64]) -> Written {
    let (clock, time_unit) = match time_s {
        Some(_) => ("time = \"t_s\"\n", "time = \"s\", "),
        None => ("", ""),
    };
    let toml = format!(
        "[recording]\nid = \"{id}\"\nkind = \"hinge-bench\"\n\n[bench]\nfile = \"run.csv\"\n{clock}angle = \"angle_rad\"\ntorque = \"torque_Nm\"\nunits = {{ {time_unit}angle = \"rad\", torque = \"N m\" }}\n"
    );
    let mut list: Vec<&[f64]> = vec![angle, torque];
    let mut header = "angle_rad,torque_Nm".to_owned();
    if let Some(t) = time_s {
        list.insert(0, t);
        header.insert_str(0, "t_s,");
    }
    let (table, mut read) = csv(&header, &list);
    let torque = read.pop().unwrap_or_default();
    let angle = read.pop().unwrap_or_default();
    Written {
        bench: Some(RawBench {
            time_s: read.pop(),
            angle: raw("angle_rad", "rad", angle),
            torque: raw("torque_Nm", "N m", torque),
        }),
        ..Written::new(toml, table)
    }
}

/// A coupon: time, stretch, stress.
fn written_coupon(id: &str, columns: [&[f64]; 3]) -> Written {
    let toml = format!(
        "[recording]\nid = \"{id}\"\nkind = \"film-coupon\"\nfilm_state = \"virgin\"\n\n[coupon]\nfile = \"run.csv\"\nmode = \"uniaxial\"\ntime = \"t_s\"\nstretch = \"stretch\"\nnominal_stress = \"stress_Pa\"\nunits = {{ time = \"s\", stretch = \"1\", nominal_stress = \"Pa\" }}\n"
    );
    let (table, mut read) = csv("t_s,stretch,stress_Pa", &columns);
    let stress = read.pop().unwrap_or_default();
    let stretch = read.pop().unwrap_or_default();
    Written {
        coupon: Some(RawCoupon {
            mode: CouponMode::Uniaxial,
            time_s: read.pop(),
            time_steps_back: Vec::new(),
            elongation: RawElongation::Stretch(raw("stretch", "1", stretch)),
            load: RawLoad::NominalStress(raw("stress_Pa", "Pa", stress)),
        }),
        ..Written::new(toml, table)
    }
}

/// The files of a recording: `recording.toml` and `run.csv`; and the recording that opening them gives.
///
/// # Errors
/// A manifest that does not read back.
pub fn write(id: &str, text: &Text, columns: &Columns) -> Result<(Files, Recording), String> {
    let written = match (columns, text) {
        (
            Columns::Axis {
                time_s,
                position_m,
                input,
            },
            Text::Axis(text),
        ) => written_axis(id, text, [time_s, position_m, input]),
        (Columns::Axis { .. }, _) => return Err("an axis without constants".into()),
        (
            Columns::Bench {
                time_s,
                angle_rad,
                torque_n_m,
            },
            _,
        ) => written_bench(id, time_s.as_deref(), angle_rad, torque_n_m),
        (
            Columns::Coupon {
                time_s,
                stretch,
                stress_pa,
            },
            _,
        ) => written_coupon(id, [time_s, stretch, stress_pa]),
    };
    let path = Path::new("recording.toml");
    let recording = Recording {
        manifest: Manifest::parse(path, &written.toml).map_err(|e| e.to_string())?,
        rig: None,
        rig_path: None,
        path: path.into(),
        dir: PathBuf::new(),
        motion: None,
        voltage: None,
        monitor: None,
        coupon: written.coupon,
        bench: written.bench,
        axis: written.axis,
        sources: Vec::new(),
        notes: Vec::new(),
    };
    let files = [
        ("recording.toml", written.toml.into_bytes()),
        ("run.csv", written.table.into_bytes()),
    ];
    Ok((files, recording))
}
