//! A hanging sample grows downwards when its voltage is on: direction, sign, clock and size of what the
//! marker does.

use super::linear::{Columns, about_mean, quantile};
use super::view::{Is, View, per_cent, short};
use super::{Findings, Grade};
use crate::recording::{Kind, NumberOrEstimate, Rig};
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

struct Followed {
    /// What the voltage explains of the variance, and the step that it makes, m.
    share: f64,
    stroke_m: f64,
    variance: f64,
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
    let position: Vec<Vector3<f64>> = rows.iter().map(|&i| sum[i].0 / sum[i].1).collect();
    if rows.len() < 40 {
        return;
    }
    let followed = |offset: f64, scale: f64, k: usize| -> Option<Followed> {
        let (squared, _) = voltage.squared(0, start * scale + offset, STEP_S * scale, n);
        let mut columns = vec![Vec::new(); 2 + CREEP_S.len()];
        let mut slow = CREEP_S.map(|_| squared[0]);
        let mut next = 0;
        for (i, v) in squared.iter().enumerate() {
            for (s, t) in slow.iter_mut().zip(CREEP_S) {
                *s += (1.0 - (-STEP_S / t).exp()) * (v - *s);
            }
            if rows.get(next) == Some(&i) {
                columns[0].push(1.0);
                columns[1].push(*v);
                for (c, s) in columns[2..].iter_mut().zip(slow) {
                    c.push(s);
                }
                next += 1;
            }
        }
        let most = squared.iter().copied().fold(0.0, f64::max);
        let y: Vec<f64> = position.iter().map(|p| p[k]).collect();
        let middle = quantile(y.iter().copied(), 0.5);
        let y: Vec<f64> = y.iter().map(|v| v - middle).collect();
        let variance = about_mean(&y);
        let solved = Columns::new(columns)?.solve(&y);
        Some(Followed {
            share: 1.0 - solved.left / variance.max(1e-300),
            stroke_m: solved.beta[1..].iter().sum::<f64>() * most,
            variance: variance / y.len() as f64,
        })
    };
    let offset = match r.manifest.offset_s {
        NumberOrEstimate::Number(s) => Some(s),
        NumberOrEstimate::Estimate => None,
    };
    let each = |offset: f64| -> Option<[Followed; 3]> {
        Some([
            followed(offset, 1.0, 0)?,
            followed(offset, 1.0, 1)?,
            followed(offset, 1.0, 2)?,
        ])
    };
    let Some(now) = each(offset.unwrap_or(0.0)) else {
        return;
    };
    let caught = |f: &Followed| f.share.max(0.0) * f.variance;
    // the clock, by what follows in any direction
    let left = |all: &[Followed; 3]| {
        let whole: f64 = all.iter().map(|f| f.variance).sum();
        1.0 - all.iter().map(caught).sum::<f64>() / whole.max(1e-300)
    };
    let (first, last) = voltage.span_s();
    let mut all = now;
    if left(&all) > 0.2 {
        let length = STEP_S * n as f64;
        let mut best = (offset.unwrap_or(0.0), left(&all));
        let count = ((last - first + length) / 0.1) as usize;
        if let (Some(_), true) = (offset, count < 6000) {
            let from = first - start - 0.6 * length;
            for i in 0..count {
                let at = from + 0.1 * i as f64;
                if at > last - start - 0.4 * length {
                    break;
                }
                if let Some(other) = each(at)
                    && left(&other) < best.1
                {
                    best = (at, left(&other));
                }
            }
        }
        for ratio in [2.0, 0.5, 10.0, 0.1, 1.2, 1.0 / 1.2, 5.0, 0.2] {
            let at = [0, 1, 2].map(|k| followed(offset.unwrap_or(0.0) * ratio, ratio, k));
            let [Some(x), Some(y), Some(z)] = at else {
                continue;
            };
            let other = left(&[x, y, z]);
            if FALL * other < left(&all) && other < best.1 {
                found.add(
                    "rate",
                    Grade::Wrong,
                    format!(
                        "the voltage clock looks {} times as fast as the motion clock: with that, what the voltage leaves of the motion falls from {} to {}",
                        short(ratio),
                        per_cent(left(&all)),
                        per_cent(other)
                    ),
                    "look at the rates of both files",
                );
                return;
            }
        }
        let from = offset.unwrap_or(0.0);
        if FALL * best.1 < left(&all) && (best.0 - from).abs() > LEAST_S {
            found.add(
                "clock",
                Grade::Wrong,
                format!(
                    "the voltage clock looks {} s ahead of the motion clock, not {} s: with that, what the voltage leaves of the motion falls from {} to {}",
                    short(best.0),
                    short(from),
                    per_cent(left(&all)),
                    per_cent(best.1)
                ),
                format!("set [sync] offset_s = {:.2}", best.0),
            );
            return;
        }
        if let Some(at) = each(best.0).filter(|_| offset.is_none()) {
            all = at;
        }
    }
    let parts = all.each_ref().map(caught);
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
        // E from the strain that the Maxwell stress makes
        let volts = view
            .signals
            .iter()
            .filter(|s| s.is == Is::Voltage)
            .filter_map(|s| s.range())
            .map(|[a, b]| a.abs().max(b.abs()))
            .fold(0.0, f64::max)
            * raw.unit.to_si
            * raw.scale.unwrap_or(1.0);
        let stress = rig.eps_r.unwrap_or(3.0)
            * VACUUM_PERMITTIVITY_F_M
            * (volts / (rig.L3_mm * 1e-3)).powi(2);
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
}
