//! What may be learnt of a robot: groups of columns for every site, over the ranges that its recordings show.

use nalgebra::DVector;

use super::{Group, Made};
use crate::effects::learnt::{Form, Learnt, Place, Variable, wider};
use crate::effects::{Acting, Along};
use crate::kinematics::{Vec3, dot};
use crate::model::others;
use crate::residual::RobotResidual;

/// Knots of a smooth curve, and of one that ripples.
const KNOTS: usize = 8;
const FINE: usize = 28;
/// Ranges over which a joint slides before it grips, as shares of the angles that are seen.
const GRIPS: [f64; 5] = [0.01, 0.03, 0.1, 0.3, 1.0];
/// Times of what lags, s.
const TIMES_S: [f64; 6] = [0.05, 0.2, 0.8, 3.0, 12.0, 50.0];
/// Centres of a potential, and widths over the range of the positions.
const CENTRES: usize = 40;
const WIDTHS: [f64; 2] = [0.25, 0.5];
/// Directions in which a cable may pull.
const DIRECTIONS: usize = 24;
/// Frequencies of a mass on a spring, Hz: from the lowest by this factor up.
const SWINGS_HZ: (f64, f64, usize) = (0.5, 1.06, 52);
const DAMPING: f64 = 0.05;
/// Highest frequency of a wave, Hz, and how many peaks are tried.
const WAVE_HZ: f64 = 8.0;
const PEAKS: usize = 3;

/// A group of one form.
fn group(place: Place, smooth: bool, form: Form) -> Group {
    together(place, smooth, vec![form])
}

/// A group of several forms.
fn together(place: Place, smooth: bool, forms: Vec<Form>) -> Group {
    Group {
        place,
        forms,
        smooth,
    }
}

/// What lags behind a variable, at all times.
fn lag(of: Variable, by: Option<Variable>) -> Form {
    Form::Lag {
        of,
        times_s: TIMES_S.to_vec(),
        by,
    }
}

/// The groups of a robot's recordings, of which a film without terms leaves `residual`.
pub(in crate::diagnosis) fn of_robot(robot: &RobotResidual, residual: &DVector<f64>) -> Vec<Group> {
    let ranges = Ranges::of(robot);
    let mut out = of_joints(&ranges);
    out.extend(of_voltage(&ranges));
    out.extend(of_force(&ranges));
    out.extend(of_waves(robot, residual));
    out
}

/// What film and joints do beside their model.
fn of_joints(ranges: &Ranges) -> Vec<Group> {
    use Variable as V;
    let spline = |of: Variable, count: usize, by: Option<Variable>| ranges.spline(of, count, by);
    let grips = |of: Variable| {
        let (low, high) = ranges.span(of);
        Form::Presliding {
            of,
            ranges: GRIPS.map(|g| g * (high - low)).to_vec(),
        }
    };
    let slow = [V::Voltage, V::SquaredVoltage].map(|by| lag(V::SquaredVoltage, Some(by)));
    let (angle, rate) = (V::BicepAngle, V::BicepRate);
    vec![
        together(Place::Film, false, slow.to_vec()),
        group(Place::Bicep, true, spline(angle, KNOTS, None)),
        group(Place::Bicep, true, spline(angle, FINE, None)),
        group(Place::Bicep, true, spline(rate, KNOTS + 1, None)),
        group(Place::Bicep, true, spline(angle, KNOTS, Some(rate))),
        group(Place::Bicep, false, grips(angle)),
        group(Place::Bicep, false, lag(angle, None)),
        group(Place::Film, false, grips(V::LozengeAngle)),
        group(Place::Film, true, spline(V::LargestStretch, KNOTS, None)),
    ]
}

/// What the electrical chain and the capacitance do beside their model, and what drifts.
fn of_voltage(ranges: &Ranges) -> Vec<Group> {
    use Place::{Capacitance, Electrical, Series};
    use Variable as V;
    let spline = |of: Variable, count: usize, by: Option<Variable>| ranges.spline(of, count, by);
    let volt = Some(V::Voltage);
    vec![
        group(Electrical, true, spline(V::Voltage, KNOTS, volt)),
        group(Electrical, true, spline(V::VoltageRate, KNOTS + 1, volt)),
        group(Electrical, false, lag(V::Voltage, volt)),
        group(Electrical, false, Form::Neighbours),
        group(Capacitance, true, spline(V::AreaStretch, KNOTS, None)),
        group(Capacitance, true, spline(V::SeriesTime, KNOTS, None)),
        group(Series, true, spline(V::SeriesTime, KNOTS, None)),
    ]
}

/// What pulls at the end effector.
fn of_force(ranges: &Ranges) -> Vec<Group> {
    let mut out = Vec::new();
    let mut one = |smooth: bool, form: Form| out.push(group(Place::Force, smooth, form));
    let (centres_m, about_m, span_m) = ranges.centres();
    for width in WIDTHS {
        let potential = Form::Potential {
            centres_m: centres_m.clone(),
            width_m: width * span_m,
        };
        one(false, potential);
    }
    for along in directions() {
        let knots = ranges.along(along, KNOTS + 2);
        one(true, Form::Ridge { along, knots });
    }
    one(false, Form::Affine { about_m });
    one(false, Form::Drag);
    for i in 0..SWINGS_HZ.2 {
        let swing = Form::Oscillator {
            frequency_hz: SWINGS_HZ.0 * SWINGS_HZ.1.powi(i as i32),
            damping: DAMPING,
        };
        one(false, swing);
    }
    out
}

/// Waves at the frequencies at which the residual has peaks: of the bicep, and of the voltage itself and of
/// the share that its load makes.
fn of_waves(robot: &RobotResidual, residual: &DVector<f64>) -> Vec<Group> {
    use Variable as V;
    let mut out = Vec::new();
    for frequency_hz in peaks(robot, residual, Place::Bicep, None) {
        let by = None;
        out.push(group(Place::Bicep, false, Form::Wave { frequency_hz, by }));
    }
    for frequency_hz in peaks(robot, residual, Place::Electrical, Some(V::SquaredVoltage)) {
        let wave = |by| Form::Wave {
            frequency_hz,
            by: Some(by),
        };
        let forms = [V::Voltage, V::SquaredVoltage, V::CubedVoltage].map(wave);
        out.push(together(Place::Electrical, false, forms.to_vec()));
    }
    out
}

/// What a term does along a robot's recordings.
pub(in crate::diagnosis) fn made_by(robot: &RobotResidual, acting: &Acting) -> Made {
    let mut out = Made::default();
    let Some(term) = acting.effect.learnt() else {
        return out;
    };
    out.range = vec![[f64::INFINITY, f64::NEG_INFINITY]; term.form.variables().len()];
    let series = robot.series();
    for (number, d) in robot.datasets().enumerate() {
        let m = robot.mechanics(number);
        let kept = robot.kept(number);
        let first = kept.first().copied().unwrap_or(0);
        let last = kept.last().copied().unwrap_or(0);
        let volts = [0, 1, 2].map(|k| {
            let told = (0..d.samples()).map(|i| d.command_v(k, i, d.offset_s));
            told.collect::<Vec<f64>>()
        });
        let force = term.place == Place::Force;
        for k in (0..3).filter(|&k| acting.on[k]) {
            let along = Along {
                others_v: others(k, [0, 1, 2].map(|k| &volts[k][..])),
                ..m.along(k, series[number])
            };
            let own = term.form.ranges(&along, &volts[k], &|i| {
                (first..=last).contains(&i) && d.captured(i)
            });
            for (all, own) in out.range.iter_mut().zip(own) {
                *all = wider(*all, own);
            }
            if force && k > 0 {
                continue;
            }
            let made = term.made(&acting.values, &along, &volts[k]);
            let largest = kept.iter().map(|&i| made[i].abs());
            out.largest = largest.fold(out.largest, f64::max);
            let forces = if force {
                term.force(&acting.values, &along)
            } else {
                Vec::new()
            };
            for &i in kept.iter().filter(|i| **i > 0) {
                let power = match term.place {
                    Place::Force => dot(forces[i], m.track.velocity_m_s[i]),
                    Place::Film if !term.electrical() => {
                        let theta = &along.theta_dea_rad;
                        made[i] * (theta[i] - theta[i - 1]) / d.step_s
                    }
                    Place::Bicep | Place::Series if !term.electrical() => {
                        made[i] * along.theta_b[i][1]
                    }
                    _ => 0.0,
                };
                out.work += power;
                out.exchanged += power.abs();
            }
        }
    }
    out
}

/// Directions spread over the half of a sphere (a spiral of equal areas).
fn directions() -> Vec<Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..DIRECTIONS)
        .map(|i| {
            let z = (i as f64 + 0.5) / DIRECTIONS as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let flat = (1.0 - z * z).sqrt();
            [flat * cos, flat * sin, z]
        })
        .collect()
}

/// What the recordings show.
struct Ranges {
    of: Vec<(Variable, Vec<f64>)>,
    positions_m: Vec<Vec3>,
}

impl Ranges {
    fn of(robot: &RobotResidual) -> Self {
        let mut of: Vec<(Variable, Vec<f64>)> =
            Variable::ALL.iter().map(|v| (*v, Vec::new())).collect();
        let mut positions_m = Vec::new();
        let series = robot.series();
        for (number, d) in robot.datasets().enumerate() {
            let m = robot.mechanics(number);
            let kept = robot.kept(number);
            positions_m.extend(kept.iter().map(|&i| m.track.position_m[i]));
            for k in 0..3 {
                let phi: Vec<f64> = (0..d.samples())
                    .map(|i| d.command_v(k, i, d.offset_s))
                    .collect();
                let along = m.along(k, series[number]);
                for (v, values) in &mut of {
                    let all = v.along(&along, &phi);
                    values.extend(kept.iter().map(|&i| all[i]));
                }
            }
        }
        for (_, values) in &mut of {
            values.retain(|v| v.is_finite());
            values.sort_by(f64::total_cmp);
        }
        Ranges { of, positions_m }
    }

    fn values(&self, of: Variable) -> &[f64] {
        let found = self.of.iter().find(|v| v.0 == of);
        &found.expect("all variables").1
    }

    /// Smallest and largest.
    fn span(&self, of: Variable) -> (f64, f64) {
        let values = self.values(of);
        match (values.first(), values.last()) {
            (Some(a), Some(b)) if b > a => (*a, *b),
            (Some(a), _) => (*a, a + a.abs().max(1e-9)),
            _ => (0.0, 1.0),
        }
    }

    /// A curve over a variable, with knots over the range.
    fn spline(&self, of: Variable, count: usize, by: Option<Variable>) -> Form {
        Form::Spline {
            of,
            knots: self.knots(of, count),
            by,
        }
    }

    /// Knots over the range: evenly, of a rate by how often it is met.
    fn knots(&self, of: Variable, count: usize) -> Vec<f64> {
        let (low, high) = self.span(of);
        let even = |i: usize| low + (high - low) * i as f64 / (count - 1) as f64;
        if !matches!(of, Variable::BicepRate | Variable::VoltageRate) {
            return (0..count).map(even).collect();
        }
        // half evenly, half by quantiles
        let values = self.values(of);
        let quantile = |i: usize| values[(values.len() - 1) * i / (count - 1)];
        let mut knots: Vec<f64> = (0..count).map(|i| 0.5 * (even(i) + quantile(i))).collect();
        let least = 1e-3 * (high - low);
        for i in 1..count {
            knots[i] = knots[i].max(knots[i - 1] + least);
        }
        knots
    }

    /// Knots over the positions along a direction, m.
    fn along(&self, direction: Vec3, count: usize) -> Vec<f64> {
        let each = || self.positions_m.iter().map(|u| dot(*u, direction));
        let low = each().fold(f64::INFINITY, f64::min);
        let high = each().fold(f64::NEG_INFINITY, f64::max).max(low + 1e-4);
        (0..count)
            .map(|i| low + (high - low) * i as f64 / (count - 1) as f64)
            .collect()
    }

    /// Points among the positions that are far from each other, their middle, and their largest extent.
    fn centres(&self) -> (Vec<Vec3>, Vec3, f64) {
        let all = &self.positions_m;
        let n = all.len().max(1) as f64;
        let middle = [0, 1, 2].map(|i| all.iter().map(|u| u[i]).sum::<f64>() / n);
        let away = |a: &Vec3, b: &Vec3| {
            let d = [0, 1, 2].map(|i| a[i] - b[i]);
            dot(d, d)
        };
        let mut centres = vec![middle];
        let mut far: Vec<f64> = all.iter().map(|u| away(u, &middle)).collect();
        while centres.len() < CENTRES {
            let Some((at, distance)) = (far.iter().copied().enumerate())
                .filter(|f| f.1.is_finite())
                .max_by(|a, b| a.1.total_cmp(&b.1))
            else {
                break;
            };
            if distance <= 0.0 {
                break;
            }
            centres.push(all[at]);
            for (f, u) in far.iter_mut().zip(all) {
                *f = f.min(away(u, &all[at]));
            }
        }
        let extent = |i: usize| {
            let of = |f: fn(f64, f64) -> f64, s: f64| all.iter().map(|u| u[i]).fold(s, f);
            of(f64::max, f64::NEG_INFINITY) - of(f64::min, f64::INFINITY)
        };
        let span = (0..3).map(extent).fold(1e-4, f64::max);
        (centres, middle, span)
    }
}

/// The frequencies at which what is left looks most like a wave at a site.
fn peaks(
    robot: &RobotResidual,
    residual: &DVector<f64>,
    place: Place,
    by: Option<Variable>,
) -> Vec<f64> {
    // what a constant does there
    let constant = Form::Wave {
        frequency_hz: 0.0,
        by,
    };
    let term = Learnt::new(place, constant, Vec::new());
    let mut times = Vec::with_capacity(residual.len() / 3);
    let mut longest_s = 1.0_f64;
    for (number, d) in robot.datasets().enumerate() {
        times.extend(robot.kept(number).iter().map(|&c| d.time_s(c)));
        longest_s = longest_s.max(d.step_s * d.samples() as f64);
    }
    let mut made: Vec<Vec<f64>> = Vec::new();
    let (columns, _) = robot.term_columns(term);
    for column in columns {
        let g = column.column(1);
        let power = g.norm_squared().sqrt().max(f64::MIN_POSITIVE);
        let product = g.iter().zip(residual.iter()).map(|(g, r)| g * r / power);
        // one product for each kept sample
        let product: Vec<f64> = product.collect();
        made.push(product.chunks(3).map(|c| c.iter().sum()).collect());
    }
    let step_hz = 0.25 / longest_s;
    let count = (WAVE_HZ / step_hz) as usize;
    let power = |f: f64| -> f64 {
        made.iter()
            .map(|g| {
                let (mut s, mut c) = (0.0, 0.0);
                for (g, t) in g.iter().zip(&times) {
                    let (sin, cos) = (std::f64::consts::TAU * f * t).sin_cos();
                    s += g * sin;
                    c += g * cos;
                }
                s * s + c * c
            })
            .sum()
    };
    use rayon::prelude::*;
    let first = (0.3 / step_hz) as usize;
    let spectrum: Vec<f64> = (first..count)
        .into_par_iter()
        .map(|i| power(i as f64 * step_hz))
        .collect();
    let mut tops: Vec<usize> = (1..spectrum.len().saturating_sub(1))
        .filter(|&i| spectrum[i] > spectrum[i - 1] && spectrum[i] >= spectrum[i + 1])
        .collect();
    tops.sort_by(|a, b| spectrum[*b].total_cmp(&spectrum[*a]));
    tops.truncate(PEAKS);
    tops.into_iter()
        .map(|i| {
            // a parabola through the top and its neighbours
            let [a, b, c] = [spectrum[i - 1], spectrum[i], spectrum[i + 1]];
            let off = 0.5 * (a - c) / (a - 2.0 * b + c);
            ((first + i) as f64 + off.clamp(-0.5, 0.5)) * step_hz
        })
        .collect()
}
