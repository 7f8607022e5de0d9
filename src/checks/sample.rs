//! A hanging sample grows downwards when its voltage is on: direction, sign, clock and size of what the
//! marker does.

use super::linear::{Columns, about_mean, quantile};
use super::view::{Is, View, per_cent, short};
use super::{Findings, Grade};
use crate::dataset::Voltage;
use crate::recording::{
    FilmSampleRig, Kind, MotionManifest, NumberOrEstimate, RawMotion, RawVoltage, Rig,
};
use crate::units::VACUUM_PERMITTIVITY_F_M;
use nalgebra::{Rotation3, Vector3};

/// Step of what is looked at, s, and the most of it.
const STEP_S: f64 = 0.05;
const MOST: usize = 4000;
/// Rates at which the film creeps, s.
const CREEP_S: [f64; 3] = [0.15, 1.5, 15.0];
/// The vertical carries at least this share of what follows the voltage: a sample that hangs aslant by 18
/// degrees has 0.9 of it.
const VERTICAL: f64 = 0.7;
/// What follows the voltage, of the variance of a coordinate: enough to judge by.
const FOLLOWS: f64 = 0.5;
/// Moduli that films have, Pa, with a factor of ten on both sides for what this estimate leaves out.
const MODULUS_PA: [f64; 2] = [1e3, 3e8];
/// Clock offset from which on it is told, s, and by how much the error has to fall.
const LEAST_S: f64 = 0.5;
const FALL: f64 = 6.0;

/// How far a coordinate follows the voltage.
struct Followed {
    /// What the voltage explains of the variance, and the step that it makes, m.
    share: f64,
    stroke_m: f64,
    variance: f64,
}

impl Followed {
    /// What is explained, of the variance.
    fn caught(&self) -> f64 {
        self.share.max(0.0) * self.variance
    }
}

/// What the voltage leaves of the motion in all directions, as a share of it.
fn left(all: &[Followed; 3]) -> f64 {
    let whole: f64 = all.iter().map(|f| f.variance).sum();
    1.0 - all.iter().map(Followed::caught).sum::<f64>() / whole.max(1e-300)
}

/// The free end in world axes, averaged over even steps, and the voltage.
struct Hanging {
    voltage: Voltage,
    start_s: f64,
    steps: usize,
    /// Steps in which the marker was seen, and where it was, m.
    rows: Vec<usize>,
    position: Vec<Vector3<f64>>,
}

impl Hanging {
    /// From what the capture wrote, turned as stated.
    fn new(m: &RawMotion, stated: &MotionManifest, voltage: Voltage) -> Self {
        let [a, b, c] = stated.rotation_deg.map(f64::to_radians);
        let rotation = Rotation3::from_axis_angle(&Vector3::x_axis(), a)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), c);
        let (start, end) = (m.time_s[0], m.time_s[m.time_s.len() - 1]);
        let n = (((end - start) / STEP_S) as usize + 1).min(MOST);
        let mut sum = vec![(Vector3::zeros(), 0.0); n];
        for (t, p) in m.time_s.iter().zip(&m.end_effector.xyz) {
            let i = ((t - start) / STEP_S).round() as usize;
            if i < n && p.iter().all(|v| v.is_finite()) {
                sum[i].0 += rotation * Vector3::from(*p) * m.unit.to_si;
                sum[i].1 += 1.0;
            }
        }
        let rows: Vec<usize> = (0..n).filter(|&i| sum[i].1 > 0.0).collect();
        let position = rows.iter().map(|&i| sum[i].0 / sum[i].1).collect();
        Hanging {
            voltage,
            start_s: start,
            steps: n,
            rows,
            position,
        }
    }

    /// How coordinate `k` follows the voltage, read `offset` later on a clock `scale` times as fast.
    fn followed(&self, offset: f64, scale: f64, k: usize) -> Option<Followed> {
        let start = self.start_s * scale + offset;
        let (squared, _) = self.voltage.squared(0, start, STEP_S * scale, self.steps);
        let mut columns = vec![Vec::new(); 2 + CREEP_S.len()];
        let mut slow = CREEP_S.map(|_| squared[0]);
        let mut next = 0;
        for (i, v) in squared.iter().enumerate() {
            for (s, t) in slow.iter_mut().zip(CREEP_S) {
                *s += (1.0 - (-STEP_S / t).exp()) * (v - *s);
            }
            if self.rows.get(next) == Some(&i) {
                columns[0].push(1.0);
                columns[1].push(*v);
                for (c, s) in columns[2..].iter_mut().zip(slow) {
                    c.push(s);
                }
                next += 1;
            }
        }
        let most = squared.iter().copied().fold(0.0, f64::max);
        let y: Vec<f64> = self.position.iter().map(|p| p[k]).collect();
        let middle = quantile(y.iter().copied(), 0.5);
        let y: Vec<f64> = y.iter().map(|v| v - middle).collect();
        let variance = about_mean(&y);
        let solved = Columns::new(columns)?.solve(&y);
        Some(Followed {
            share: 1.0 - solved.left / variance.max(1e-300),
            stroke_m: solved.beta[1..].iter().sum::<f64>() * most,
            variance: variance / y.len() as f64,
        })
    }

    /// The same of all three coordinates.
    fn each(&self, offset: f64, scale: f64) -> Option<[Followed; 3]> {
        Some([
            self.followed(offset, scale, 0)?,
            self.followed(offset, scale, 1)?,
            self.followed(offset, scale, 2)?,
        ])
    }

    /// The offset that leaves least, and what it leaves: the stated one unless another leaves less.
    fn best_offset(&self, stated: Option<f64>, now: f64) -> (f64, f64) {
        let (first, last) = self.voltage.span_s();
        let length = STEP_S * self.steps as f64;
        let mut best = (stated.unwrap_or(0.0), now);
        let count = ((last - first + length) / 0.1) as usize;
        if stated.is_none() || count >= 6000 {
            return best;
        }
        let from = first - self.start_s - 0.6 * length;
        for i in 0..count {
            let at = from + 0.1 * i as f64;
            if at > last - self.start_s - 0.4 * length {
                break;
            }
            if let Some(other) = self.each(at, 1.0)
                && left(&other) < best.1
            {
                best = (at, left(&other));
            }
        }
        best
    }

    /// The clock, by what follows in any direction. `None` where another rate or offset is told.
    fn clock(
        &self,
        stated: Option<f64>,
        all: [Followed; 3],
        found: &mut Findings,
    ) -> Option<[Followed; 3]> {
        let now = left(&all);
        if now <= 0.2 || now.is_nan() {
            return Some(all);
        }
        let best = self.best_offset(stated, now);
        let from = stated.unwrap_or(0.0);
        for ratio in [2.0, 0.5, 10.0, 0.1, 1.2, 1.0 / 1.2, 5.0, 0.2] {
            let Some(other) = self.each(from * ratio, ratio) else {
                continue;
            };
            let other = left(&other);
            if FALL * other < now && other < best.1 {
                found.add(
                    "rate",
                    Grade::Wrong,
                    format!(
                        "the voltage clock looks {} times as fast as the motion clock: with that, what the voltage leaves of the motion falls from {} to {}",
                        short(ratio),
                        per_cent(now),
                        per_cent(other)
                    ),
                    "look at the rates of both files",
                );
                return None;
            }
        }
        if FALL * best.1 < now && (best.0 - from).abs() > LEAST_S {
            found.add(
                "clock",
                Grade::Wrong,
                format!(
                    "the voltage clock looks {} s ahead of the motion clock, not {} s: with that, what the voltage leaves of the motion falls from {} to {}",
                    short(best.0),
                    short(from),
                    per_cent(now),
                    per_cent(best.1)
                ),
                format!("set [sync] offset_s = {:.2}", best.0),
            );
            return None;
        }
        Some(all)
    }
}

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let r = view.recording;
    let (Kind::FilmSample, Some(m), Some(raw), Some(stated), Some(Rig::FilmSample(rig))) = (
        r.manifest.kind,
        &r.motion,
        &r.voltage,
        &r.manifest.motion,
        &r.rig,
    ) else {
        return;
    };
    if found.wrong(&[
        "sentinel",
        "exchanged",
        "dead_channel",
        "unit",
        "stated_value",
        "rate",
        "clock",
        "noise",
    ]) {
        return;
    }
    let Some(voltage) = super::view::volts(raw) else {
        return;
    };
    let hanging = Hanging::new(m, stated, voltage);
    if hanging.rows.len() < 40 {
        return;
    }
    let offset = match r.manifest.offset_s {
        NumberOrEstimate::Number(s) => Some(s),
        NumberOrEstimate::Estimate => None,
    };
    let Some(now) = hanging.each(offset.unwrap_or(0.0), 1.0) else {
        return;
    };
    let Some(all) = hanging.clock(offset, now, found) else {
        return;
    };
    let parts = all.each_ref().map(Followed::caught);
    let total: f64 = parts.iter().sum();
    let whole: f64 = all.iter().map(|f| f.variance).sum();
    if total < FOLLOWS * whole {
        if offset.is_some() && whole.sqrt() > 0.3e-3 && total < 0.2 * whole {
            found.add(
                "mismatch",
                Grade::Wrong,
                format!("the motion does not follow the voltage, in any direction: it explains {} of it", per_cent(total / whole)),
                "look whether the two files are of the same run, and at [sync]",
            );
        }
        return;
    }
    let direction = all.each_ref().map(|f| f.stroke_m);
    let size = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
    if parts[2] < VERTICAL * total {
        aslant(direction, size, parts, found);
    } else if direction[2] > 0.0 {
        found.add(
            "sign",
            Grade::Wrong,
            format!(
                "the free end rises by {:.2} mm when the voltage is on, and a hanging sample grows downwards: z points down",
                direction[2] * 1e3
            ),
            "turn the capture's axes under [motion]: rotation_deg = [180, 0, 0] before what is stated there",
        );
    } else {
        modulus(view, raw, rig, size, found);
    }
}

/// Says along which axis the sample grows; `parts` are what follows the voltage along each.
fn aslant(direction: [f64; 3], size: f64, parts: [f64; 3], found: &mut Findings) {
    let total: f64 = parts.iter().sum();
    let names = ["x", "y", "z"];
    let k = (0..3)
        .max_by(|a, b| parts[*a].total_cmp(&parts[*b]))
        .unwrap_or(2);
    let remedy = match (k, direction[k] > 0.0) {
        (0, false) => "rotation_deg = [0, -90, 0]",
        (0, true) => "rotation_deg = [0, 90, 0]",
        (1, false) => "rotation_deg = [90, 0, 0]",
        (_, _) => "rotation_deg = [-90, 0, 0]",
    };
    found.add(
        "axes",
        Grade::Wrong,
        format!(
            "what follows the voltage ({:.2} mm) is {} along {}{} and {} along z, in which a hanging sample grows",
            size * 1e3,
            per_cent(parts[k] / total),
            if direction[k] < 0.0 { "-" } else { "" },
            names[k],
            per_cent(parts[2] / total)
        ),
        format!("turn the capture's axes under [motion]: {remedy} before what is stated there"),
    );
}

/// The modulus that a stroke of `size` asks for, from the strain that the Maxwell stress makes.
fn modulus(
    view: &View<'_>,
    raw: &RawVoltage,
    rig: &FilmSampleRig,
    size: f64,
    found: &mut Findings,
) {
    let volts = view
        .signals
        .iter()
        .filter(|s| s.is == Is::Voltage)
        .filter_map(|s| s.range())
        .map(|[a, b]| a.abs().max(b.abs()))
        .fold(0.0, f64::max)
        * raw.unit.to_si
        * raw.scale.unwrap_or(1.0);
    let stress =
        rig.eps_r.unwrap_or(3.0) * VACUUM_PERMITTIVITY_F_M * (volts / (rig.L3_mm * 1e-3)).powi(2);
    let modulus = stress * rig.length_mm * 1e-3 / size;
    if !(MODULUS_PA[0]..=MODULUS_PA[1]).contains(&modulus) {
        found.add(
            "unit",
            Grade::Wrong,
            format!(
                "a stroke of {:.3} mm at {} V on L3_mm = {} of film asks for a modulus of about {} MPa, which no elastomer has",
                size * 1e3,
                short(volts),
                rig.L3_mm,
                short(modulus * 1e-6)
            ),
            "look at the units of voltages, positions and of the film's thickness",
        );
    }
}
