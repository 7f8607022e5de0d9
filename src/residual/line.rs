//! The residual of a single coordinate: what the model asks for minus what was measured, in force (torque,
//! stress), over its noise.
//!
//! ```text
//! bench    r = sum_j beta_j N_j(angle)                                    + effects - torque          N_j: natural cubic spline
//! axis     r = m x'' + c x' + k x + b                                     + effects - g u - load      through one low-pass
//! coupon   r = sum_n mu_n P_n(stretch history; T, J)                      + effects - nominal stress
//! ```
//!
//! All are linear in beta: nodal torques; m, c, k, the bias b (zero of position and input are conventions of
//! the instruments) and the gain g where they are to be found; moduli. eta: ln T_1 .. ln T_n and 1/J of a
//! coupon, the free clock offsets of an axis, then the free values of effects over their spreads.
//!
//! An axis is judged at samples so far apart that they are nearly independent after the low-pass
//! ([`crate::dataset::line`]). A kernel for the k-th derivative is the sampled inverse transform of (2 pi i
//! f)^k H(f); a straight line goes through it exactly.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector, DVectorView};
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};

use super::coupon::stretch_history;
use super::{Normal, SeparableResidual, Slope};
use crate::dataset::Coupon;
use crate::dataset::line::{AxisLine, Constant, Line, Measured, interpolate_rising};
use crate::effects::learnt::Learnt;
use crate::effects::line::{Kind, Real, Terms, Undone, View, played, sliding};
use crate::effects::{Acting, When};
use crate::film::kernel::{LANES, Pass, ROW, Shape};
use crate::film::{Film, Locked};
use crate::model::ForearmTorque;

/// A linear parameter of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisTerm {
    /// Mass or moment of inertia.
    Mass,
    /// Damping.
    Damping,
    /// Stiffness.
    Stiffness,
    /// Force at rest.
    Bias,
    /// One over the force per unit of input.
    Gain,
}

/// Largest values: what normalised quantities are multiplied by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    /// Rest: what the excursion is counted from.
    pub rest: f64,
    /// Largest excursion.
    pub coordinate: f64,
    /// Largest force.
    pub force: f64,
    /// Largest input.
    pub input: f64,
}

/// The plain model of one coordinate.
#[derive(Debug, Clone)]
pub enum Plain {
    /// A torque curve with these nodes.
    Bench(ForearmTorque),
    /// An axis: terms to be found, and the known gain, mass, damping, stiffness (0 where they are to be
    /// found).
    Axis {
        /// To be found, in this order.
        terms: Vec<AxisTerm>,
        /// Known gain, mass, damping, stiffness.
        known: [f64; 4],
        /// The balance is written in units of the input, because the gain g is to be found: unknowns are 1/g
        /// (under [`AxisTerm::Gain`]) and the others over g. Written as forces, a small gain would make any
        /// error small.
        over_gain: bool,
    },
    /// A film with this number of branches.
    Coupon {
        /// Branches.
        branches: usize,
    },
}

/// Columns of beta, the constant side, and that side without what the input makes.
type Rows = (DMatrix<f64>, DVector<f64>, Vec<f64>);

/// Columns of each site, by its name.
type Columns = Vec<(&'static str, Vec<Vec<f64>>)>;

/// Flexible columns of each site, by its name.
pub type Sites = Vec<(&'static str, DMatrix<f64>)>;

/// One recording, worked out as far as it does not depend on the parameters.
#[derive(Clone)]
struct Part<'a> {
    line: &'a Line,
    when: When,
    /// Places (samples, or nodes of a coupon's grid) at which effects are worked out.
    time_s: Arc<Vec<f64>>,
    xi: Arc<Vec<f64>>,
    way: Arc<Vec<f64>>,
    rate: Arc<Vec<f64>>,
    acceleration: Arc<Vec<f64>>,
    second: Arc<Vec<f64>>,
    /// Kept places, and their measured value (bench, coupon).
    kept: Arc<Vec<usize>>,
    measured: Arc<Vec<f64>>,
    /// Where between nodes the kept values of a coupon were measured.
    means: Arc<Vec<Mean>>,
    kernel: Option<Arc<Kernel>>,
    /// Whitening of the kept places.
    weight: Vec<f64>,
    /// Filtered columns of an axis at the kept places, without effects.
    base: Arc<Base>,
}

impl Part<'_> {
    /// A column at the kept places, of an axis through its low-pass.
    fn at_kept(&self, column: &[f64]) -> Vec<f64> {
        let kernel = self.kernel.as_ref();
        let at = |&c: &usize| kernel.map_or(column[c], |k| k.at(0, column, c));
        self.kept.iter().map(at).collect()
    }

    /// Largest rate; never 0.
    fn largest_rate(&self) -> f64 {
        largest(self.rate.iter().copied()).max(f64::MIN_POSITIVE)
    }

    /// From the first place to the last, s; never 0.
    fn span_s(&self) -> f64 {
        (self.time_s[self.time_s.len() - 1] - self.time_s[0]).max(f64::MIN_POSITIVE)
    }

    /// A function of the coordinate at every place.
    fn of_xi(&self, f: impl Fn(f64) -> f64) -> Vec<f64> {
        self.xi.iter().map(|x| f(*x)).collect()
    }

    /// Hat functions of and ripples in position.
    fn position_columns(&self) -> Vec<Vec<f64>> {
        let mut out = hats(&self.xi, -1.0, 1.0, 13);
        for k in 1..=8 {
            for shift in [0.0, 0.25] {
                out.push(self.of_xi(|x| (TAU * (0.5 * f64::from(k + 2) * x + shift)).sin()));
            }
        }
        out
    }

    /// States of sliding; where time counts, direction and rate as well.
    fn friction_columns(&self) -> Vec<Vec<f64>> {
        let xi = &self.xi;
        let mut out: Vec<Vec<f64>> = Vec::new();
        for presliding in [0.005, 0.03, 0.2] {
            let z = sliding(&self.way, presliding);
            out.push(times(&z, xi));
            out.push(times(&z, &self.of_xi(f64::abs)));
            out.push(z);
        }
        if self.line.timed {
            let speed = self.largest_rate();
            let way: Vec<f64> = self
                .rate
                .iter()
                .map(|r| (r / (0.02 * speed)).tanh())
                .collect();
            // rates are told apart near zero as well as at their largest
            let rate: Vec<f64> = self
                .rate
                .iter()
                .map(|r| (r / speed).signum() * (r / speed).abs().sqrt())
                .collect();
            let along = times(&way, xi);
            out.push(way);
            out.push(along);
            out.extend(hats(&rate, -1.0, 1.0, 11));
            out.push(times(&self.rate, &self.of_xi(|x| x / speed)));
            out.push(times(&self.rate, &self.of_xi(|x| x * x / speed)));
        }
        out
    }

    /// The largest excursion so far; where time counts, the position lagging behind as well.
    fn history_columns(&self) -> Vec<Vec<f64>> {
        let mut so_far = 0.0_f64;
        let most: Vec<f64> = self
            .xi
            .iter()
            .map(|x| {
                so_far = so_far.max(x.abs());
                so_far
            })
            .collect();
        let mut out = vec![times(&most, &self.xi), most];
        if self.line.timed {
            let lagged = |values: &[f64], lag_s: f64| -> Vec<f64> {
                let mut q = values[0];
                (0..values.len())
                    .map(|i| {
                        let h = self.time_s[i] - self.time_s[i.saturating_sub(1)];
                        q += (1.0 - (-h / lag_s).exp()) * (values[i] - q);
                        q
                    })
                    .collect()
            };
            for share in [0.002, 0.01, 0.05, 0.2] {
                let lag_s = share * self.span_s();
                out.push(lagged(&self.xi, lag_s));
                out.push(lagged(&self.of_xi(|x| x * x.abs()), lag_s));
            }
        }
        out
    }

    /// What a mass that depends on position would make.
    fn inertia_columns(&self) -> Vec<Vec<f64>> {
        vec![
            times(&self.acceleration, &self.xi),
            times(&self.rate, &self.rate),
        ]
    }

    /// Waves along the recording, in force and in stiffness.
    fn slow_columns(&self) -> Vec<Vec<f64>> {
        let (start, span) = (self.time_s[0], self.span_s());
        let waves: Vec<Vec<f64>> = (1..=6)
            .map(|k| {
                let wave = |t: &f64| (0.5 * TAU * f64::from(k) * (t - start) / span).cos();
                self.time_s.iter().map(wave).collect()
            })
            .collect();
        let first = waves.iter().take(3).map(|w| times(w, &self.xi));
        let mut out: Vec<Vec<f64>> = first.collect();
        out.extend(waves);
        out
    }
}

/// `count` hat functions of the values, evenly from low to high, a column each.
fn hats(values: &[f64], low: f64, high: f64, count: usize) -> Vec<Vec<f64>> {
    let step = (high - low) / (count - 1) as f64;
    (0..count)
        .map(|k| {
            let centre = low + step * k as f64;
            let hat = |v: &f64| (1.0 - ((v - centre) / step).abs()).max(0.0);
            values.iter().map(hat).collect()
        })
        .collect()
}

/// Products, value by value.
fn times(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// The mean of the rows of a coupon that are nearest to a node of its grid.
#[derive(Debug, Clone, Copy)]
struct Mean {
    /// The node on the other side of the rows' mean time, and its share of what the model says there.
    other: usize,
    share: f64,
    /// How many rows.
    rows: f64,
}

/// Filtered columns of an axis at its kept places.
#[derive(Debug, Default)]
struct Base {
    mass: Vec<f64>,
    damping: Vec<f64>,
    stiffness: Vec<f64>,
    load: Vec<f64>,
    /// Of the input at the stated offset; empty where the offset is an unknown.
    input: Vec<f64>,
}

/// Low-pass and its derivatives on even samples.
#[derive(Debug)]
struct Kernel {
    /// h, h', h'' at -L..L; the first is a weight, the others over s and s^2.
    taps: [Vec<f64>; 3],
    half: usize,
}

impl Kernel {
    fn new(band_hz: f64, step_s: f64, samples: usize) -> Self {
        let pass = band_hz * step_s;
        let stop = (1.3 * pass).min(0.47).max(1.05 * pass);
        let half = ((6.0 / (stop - pass)).ceil() as usize)
            .min(samples / 6)
            .max(3);
        // phi and its derivatives in units of samples, then times a window w: the taps of a derivative are
        // those of (phi w)', so that all three belong to one and the same low-pass
        let points = 1024;
        let mut taps = [0, 1, 2].map(|_| vec![0.0; 2 * half + 1]);
        for i in 0..=2 * half {
            let n = i as f64 - half as f64;
            let mut phi = [0.0; 3];
            for p in 0..points {
                let f = stop * (p as f64 + 0.5) / points as f64;
                let h = if f < pass {
                    1.0
                } else {
                    0.5 + 0.5 * (std::f64::consts::PI * (f - pass) / (stop - pass)).cos()
                };
                let weight = 2.0 * stop / points as f64 * h;
                let (s, c) = (TAU * f * n).sin_cos();
                phi[0] += weight * c;
                phi[1] -= weight * TAU * f * s;
                phi[2] -= weight * (TAU * f).powi(2) * c;
            }
            let a = 0.5 * std::f64::consts::PI / (half as f64 + 1.0);
            let (s, c) = (a * n).sin_cos();
            let w = [
                c.powi(4),
                -4.0 * a * c.powi(3) * s,
                4.0 * a * a * (3.0 * c * c * s * s - c.powi(4)),
            ];
            // value at the middle: sum over n of tap x[c + n]
            taps[0][i] = phi[0] * w[0];
            taps[1][i] = -(phi[1] * w[0] + phi[0] * w[1]);
            taps[2][i] = phi[2] * w[0] + 2.0 * phi[1] * w[1] + phi[0] * w[2];
        }
        let sum: f64 = taps[0].iter().sum();
        let rest: f64 = taps[2].iter().sum::<f64>() / sum;
        for i in 0..=2 * half {
            // a constant has no second derivative
            taps[2][i] -= rest * taps[0][i];
            taps[0][i] /= sum;
            taps[1][i] /= sum * step_s;
            taps[2][i] /= sum * step_s * step_s;
        }
        Kernel { taps, half }
    }

    fn at(&self, order: usize, values: &[f64], centre: usize) -> f64 {
        let part = &values[centre - self.half..=centre + self.half];
        let own = &self.taps[order];
        // nalgebra's product adds in eight lanes at once
        DVectorView::from_slice(own, own.len()).dot(&DVectorView::from_slice(part, part.len()))
    }
}

/// Residual of recordings of one coordinate.
#[derive(Clone)]
pub struct LineResidual<'a> {
    parts: Vec<Part<'a>>,
    kind: Kind,
    plain: Arc<Plain>,
    scales: Scales,
    free_offsets: Vec<usize>,
    effects: Vec<Acting>,
    free: Vec<(usize, usize)>,
    /// Lags through which the stated input is told.
    through: Vec<Acting>,
}

/// Samples left out at both ends of an axis, s, and at most this share.
const EDGE_S: f64 = 0.3;
const EDGE_SHARE: f64 = 0.05;
/// Kept samples of a recording of an axis, about: more say little more and cost as much.
const MOST_ROWS: usize = 6000;
/// Least step of the input, over its largest value, over which the slope of a drive is taken, and slope below
/// which the input is not told.
const SECANT: f64 = 1e-4;
const FLAT: f64 = 0.05;
/// Blocks over all recordings, about, and the fewest rows of one.
const BLOCKS: usize = 12;
const FEWEST_ROWS: usize = 10;
/// Step of a difference of a nonlinear unknown.
const STEP: f64 = 1e-4;

fn kind(line: &Line) -> Kind {
    match line.measured {
        Measured::Torque(_) => Kind::Bench,
        Measured::Axis(_) => Kind::Axis,
        Measured::Coupon(_) => Kind::Coupon,
    }
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values
        .filter(|v| v.is_finite())
        .fold(0.0, |m: f64, v| m.max(v.abs()))
}

/// Rest, and the largest values, over recordings of one kind.
#[must_use]
pub fn scales(lines: &[&Line]) -> Scales {
    let mut out = Scales {
        rest: 0.0,
        coordinate: 0.0,
        force: 0.0,
        input: 0.0,
    };
    for (number, line) in lines.iter().enumerate() {
        let usable = |i: &usize| line.usable[*i];
        match &line.measured {
            Measured::Torque(t) => {
                let rows = (0..line.samples()).filter(usable);
                out.coordinate = out.coordinate.max(largest(rows.clone().map(|i| line.x[i])));
                out.force = out.force.max(largest(rows.map(|i| t[i])));
            }
            Measured::Axis(a) => {
                let x = excursion(line, a);
                if number == 0 {
                    let few = (x.len() / 100).clamp(1, 50);
                    let mut first: Vec<f64> = x[..few].to_vec();
                    first.sort_by(f64::total_cmp);
                    out.rest = first[few / 2];
                }
                out.coordinate = out.coordinate.max(largest(x.iter().map(|v| v - out.rest)));
                out.input = out.input.max(largest(a.input.iter().copied()));
                let g = match a.gain {
                    Constant::Known(g) => g.abs(),
                    Constant::Free => 1.0,
                };
                out.force = out.force.max(g * largest(a.input.iter().copied()));
                if a.gain != Constant::Free {
                    out.force = out.force.max(largest(a.load.iter().copied()));
                }
            }
            Measured::Coupon(c) => {
                out.rest = 1.0;
                let x = c.grid.stretch.iter().map(|l| l - 1.0);
                out.coordinate = out.coordinate.max(largest(x));
                out.force = out.force.max(largest(c.rows().map(|i| c.stress_pa[i])));
            }
        }
    }
    for v in [&mut out.coordinate, &mut out.force, &mut out.input] {
        if *v <= 0.0 {
            *v = 1.0;
        }
    }
    out
}

/// Position along an axis: measured, or the integral of the velocity from 0.
fn excursion(line: &Line, axis: &AxisLine) -> Vec<f64> {
    if !axis.velocity {
        return line.x.clone();
    }
    let mut x = 0.0;
    let mut before = line.x[0];
    line.x
        .iter()
        .map(|&v| {
            x += 0.5 * (v + before) * line.step_s;
            before = v;
            x
        })
        .collect()
}

/// Nodes of a bench's torque curve at most: a turn and a half every 10 deg is more than any flexure makes.
const MOST_NODES: usize = 60;
/// Intervals between nodes over the range of angles, at least; wide ranges have one every 10 deg.
const INTERVALS: f64 = 6.0;

/// The plain model that recordings of one kind call for.
#[must_use]
pub fn plain(lines: &[&Line], branches: usize) -> Plain {
    match &lines[0].measured {
        Measured::Torque(_) => {
            let angles = lines
                .iter()
                .flat_map(|l| (0..l.samples()).filter(|&i| l.usable[i]).map(|i| l.x[i]));
            let (low, high) = angles.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
                (a.min(x), b.max(x))
            });
            // enough for any smooth curve, but no more nodes than the rows can tell
            let rows: usize = lines
                .iter()
                .map(|l| l.usable.iter().filter(|u| **u).count())
                .sum();
            let most = MOST_NODES.min(rows / 2).max(4) as f64;
            let range = (high - low).max(1e-6);
            let step = (range / INTERVALS)
                .min(10f64.to_radians())
                .max(range / (most - 3.0));
            // the curve is straight beyond its end nodes: one more to either side lets it bend where angles are
            let first = (low / step).floor() - 1.0;
            let last = (high / step).ceil() + 1.0;
            let count = (last - first) as usize;
            let nodes: Vec<f64> = (0..=count).map(|i| (first + i as f64) * step).collect();
            let zero = vec![0.0; nodes.len()];
            Plain::Bench(ForearmTorque::new(nodes, zero).unwrap_or_else(|_| ForearmTorque::zero()))
        }
        Measured::Axis(a) => {
            let mut terms = Vec::new();
            let mut known = [0.0; 4];
            let anchored = !a.load.is_empty()
                || [a.mass, a.damping, a.stiffness]
                    .iter()
                    .any(|c| matches!(c, Constant::Known(v) if *v != 0.0));
            match a.gain {
                Constant::Known(g) => known[0] = g,
                Constant::Free if anchored => {}
                Constant::Free => known[0] = 1.0,
            }
            for (i, (constant, term)) in [
                (a.mass, AxisTerm::Mass),
                (a.damping, AxisTerm::Damping),
                (a.stiffness, AxisTerm::Stiffness),
            ]
            .into_iter()
            .enumerate()
            {
                match constant {
                    Constant::Known(v) => known[i + 1] = v,
                    Constant::Free => terms.push(term),
                }
            }
            terms.push(AxisTerm::Bias);
            let over_gain = a.gain == Constant::Free && anchored;
            if over_gain {
                known[0] = 1.0;
                terms.push(AxisTerm::Gain);
            }
            Plain::Axis {
                terms,
                known,
                over_gain,
            }
        }
        Measured::Coupon(_) => Plain::Coupon { branches },
    }
}

/// Stress of the second invariant for C2 = 1: 2 (lambda_1 - 1/lambda_1^2 ...) of each mode, per mode (Mooney
/// 1940).
fn second_invariant(coupon: &Coupon, lambda: f64) -> f64 {
    let [l1, l2] = coupon.stretches(lambda);
    // W = C2 (I2 - 3), I2 = l1^-2 + l2^-2 + (l1 l2)^2; P = (l1 dW/dl1 - l3 dW/dl3)/l1
    let l3 = 1.0 / (l1 * l2);
    2.0 * (l3.powi(-2) - l1.powi(-2)) / l1
}

impl<'a> LineResidual<'a> {
    /// Prepares recordings of one kind under `plain`, with normalised quantities over `scales`.
    #[must_use]
    pub fn new(lines: &[&'a Line], plain: Plain, scales: Scales) -> Self {
        Self::prepared(lines, plain, scales, false)
    }

    fn prepared(lines: &[&'a Line], plain: Plain, scales: Scales, every: bool) -> Self {
        let parts: Vec<Part> = lines
            .iter()
            .enumerate()
            .map(|(number, line)| part(line, number, &scales, every))
            .collect();
        let free_offsets = lines
            .iter()
            .enumerate()
            .filter(|(_, l)| match &l.measured {
                Measured::Axis(a) => a.offset_s == Constant::Free,
                _ => false,
            })
            .map(|(i, _)| i)
            .collect();
        LineResidual {
            kind: kind(lines[0]),
            parts,
            plain: Arc::new(plain),
            scales,
            free_offsets,
            effects: Vec::new(),
            free: Vec::new(),
            through: Vec::new(),
        }
    }

    /// The same recordings at finished parameters, eta and beta: `values` as [`Self::values`] gives them, the
    /// film of coupons, the torque curve of benches. What these recordings state as known gives way to
    /// `values`. With `every` row kept, not only nearly independent ones.
    ///
    /// # Errors
    /// The name of what is not there.
    pub fn given(
        lines: &[&'a Line],
        values: &[(String, f64)],
        film: Option<&Film>,
        curve: Option<&ForearmTorque>,
        every: bool,
    ) -> Result<(Self, Vec<f64>, Vec<f64>), &'static str> {
        let value = |name: &str| values.iter().find(|v| v.0 == name).map(|v| v.1);
        let own = scales(lines);
        let scales = Scales {
            rest: value("rest").unwrap_or(own.rest),
            coordinate: value("largest_coordinate").unwrap_or(own.coordinate),
            force: value("largest_force").unwrap_or(own.force),
            input: value("largest_input").unwrap_or(own.input),
        };
        let (mut eta, mut beta) = (Vec::new(), Vec::new());
        let mut model = plain(lines, 0);
        match &mut model {
            Plain::Bench(nodes) => {
                *nodes = curve.ok_or("[forearm]")?.clone();
                beta = nodes.torque_n_m().to_vec();
            }
            Plain::Axis {
                terms,
                known,
                over_gain,
            } => {
                let turns = matches!(&lines[0].measured, Measured::Axis(a) if a.turns);
                let names = axis_names(turns);
                let mut stated = [0.0; 5];
                for (v, name) in stated.iter_mut().zip(names) {
                    *v = value(name).ok_or(name)?;
                }
                let [gain, mass, damping, stiffness, bias] = stated;
                let divide = if *over_gain { gain } else { 1.0 };
                *known = [
                    if *over_gain { 1.0 } else { gain },
                    mass,
                    damping,
                    stiffness,
                ];
                for term in terms.iter() {
                    let (own, place) = match term {
                        AxisTerm::Mass => (mass, Some(1)),
                        AxisTerm::Damping => (damping, Some(2)),
                        AxisTerm::Stiffness => (stiffness, Some(3)),
                        AxisTerm::Bias => (bias, None),
                        AxisTerm::Gain => (1.0, None),
                    };
                    beta.push(own / divide);
                    if let Some(place) = place {
                        known[place] = 0.0;
                    }
                }
            }
            Plain::Coupon { branches } => {
                let film = film.ok_or("[film]")?;
                *branches = film.relaxation_time_s.len();
                eta.extend(film.relaxation_time_s.iter().map(|t| t.ln()));
                eta.push(1.0 / film.locking);
                beta.clone_from(&film.mu_pa);
            }
        }
        let mut out = LineResidual::prepared(lines, model, scales, every);
        let offset = value("clock_offset_s").unwrap_or(0.0);
        eta.extend(out.free_offsets.iter().map(|_| offset));
        out.weigh(&beta);
        Ok((out, eta, beta))
    }

    /// What was recorded.
    #[must_use]
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// The plain model.
    #[must_use]
    pub fn plain(&self) -> &Plain {
        &self.plain
    }

    /// What normalised quantities are multiplied by.
    #[must_use]
    pub fn scales(&self) -> Scales {
        self.scales
    }

    /// The recordings.
    pub fn lines(&self) -> impl Iterator<Item = &'a Line> + '_ {
        self.parts.iter().map(|p| p.line)
    }

    /// When a recording was made.
    #[must_use]
    pub fn when(&self, number: usize) -> When {
        self.parts[number].when
    }

    /// When they were made.
    #[must_use]
    pub fn series(&self) -> Vec<When> {
        self.parts.iter().map(|p| p.when).collect()
    }

    /// Recordings whose clock offset is an unknown.
    #[must_use]
    pub fn free_offsets(&self) -> &[usize] {
        &self.free_offsets
    }

    /// Unknowns before those of the effects.
    #[must_use]
    pub fn plain_unknowns(&self) -> usize {
        let film = match &*self.plain {
            Plain::Coupon { branches } => branches + 1,
            _ => 0,
        };
        film + self.free_offsets.len()
    }

    /// Linear unknowns.
    #[must_use]
    pub fn linear(&self) -> usize {
        match &*self.plain {
            Plain::Bench(curve) => curve.nodes_rad().len(),
            Plain::Axis { terms, .. } => terms.len(),
            Plain::Coupon { branches } => branches + 1,
        }
    }

    /// Nonlinear unknowns.
    #[must_use]
    pub fn nonlinear(&self) -> usize {
        self.plain_unknowns() + self.free.len()
    }

    /// The causes at work, unknowns where they began.
    #[must_use]
    pub fn acting(&self) -> &[Acting] {
        &self.effects
    }

    /// Which of the causes' values are unknowns.
    #[must_use]
    pub fn free(&self) -> &[(usize, usize)] {
        &self.free
    }

    /// Which nonlinear unknown a value of a cause is.
    #[must_use]
    pub fn place_of(&self, effect: usize, value: usize) -> Option<usize> {
        let place = self.free.iter().position(|f| *f == (effect, value));
        place.map(|p| self.plain_unknowns() + p)
    }

    /// A nonlinear unknown as far as its bounds let it go.
    #[must_use]
    pub fn bounded(&self, eta: &[f64], place: usize) -> f64 {
        let [low, high] = self.bounds(place);
        eta[place].clamp(low, high)
    }

    /// Whether a nonlinear unknown acts on the input of a recording, or on its clock.
    #[must_use]
    pub fn on_input(&self, number: usize, place: usize) -> bool {
        match place.checked_sub(self.plain_unknowns()) {
            Some(p) => self.effects[self.free[p].0].effect.law().is_none(),
            None => self.free_offsets.get(place) == Some(&number),
        }
    }

    /// The input of a recording as the causes that act on it alone leave it, in its unit on its own clock,
    /// and how much later than the motion's clock it is read, s.
    pub(super) fn driven(&self, number: usize, eta: &[f64], effects: &[Acting]) -> (Vec<f64>, f64) {
        let own = effects.iter().filter(|a| a.effect.law().is_none());
        let own: Vec<Acting> = own.cloned().collect();
        if let (true, Measured::Axis(a)) = (own.is_empty(), &self.parts[number].line.measured) {
            return (a.input.clone(), self.offset_s(number, eta));
        }
        let terms = self.terms(number, &own, &[], 0.0);
        let input = terms.input.iter().map(|u| self.scales.input * u);
        (input.collect(), self.offset_s(number, eta) + terms.shift_s)
    }

    /// A recording.
    pub(super) fn line_of(&self, number: usize) -> &'a Line {
        self.parts[number].line
    }

    /// Whether an axis has a mass, known or to be found.
    pub(super) fn has_mass(&self) -> bool {
        self.has(AxisTerm::Mass, 1)
    }

    /// Whether an axis has damping, known or to be found.
    pub(super) fn has_damping(&self) -> bool {
        self.has(AxisTerm::Damping, 2)
    }

    fn has(&self, term: AxisTerm, place: usize) -> bool {
        match &*self.plain {
            Plain::Axis { terms, known, .. } => terms.contains(&term) || known[place] != 0.0,
            _ => false,
        }
    }

    /// Mass, damping, stiffness, bias of an axis, and what multiplies its load, in the unit of its balance.
    pub(super) fn balance<R: Real>(&self, beta: &[R]) -> [R; 5] {
        let Plain::Axis {
            terms,
            known,
            over_gain,
        } = &*self.plain
        else {
            return [R::of(0.0); 5];
        };
        balance(terms, known, *over_gain, beta)
    }

    /// Residuals.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.parts.iter().map(|p| p.kept.len()).sum()
    }

    /// The same recordings and weights with `effects` at work; `free` are those of their values that are
    /// unknowns.
    #[must_use]
    pub fn with_effects(
        &self,
        effects: Vec<Acting>,
        free: Vec<(usize, usize)>,
        series: &[When],
    ) -> Self {
        let mut out = self.clone();
        for (p, when) in out.parts.iter_mut().zip(series) {
            p.when = *when;
        }
        out.effects = effects;
        out.free = free;
        out
    }

    /// The same, with the stated input of an axis told through the lags among `effects`, as asked and as
    /// measured alike ([`Self::stated`]): beyond its corner a lag passes little, and what it was given there is
    /// the noise of what came of it, many times enlarged.
    #[must_use]
    pub fn told_through(mut self, effects: &[Acting]) -> Self {
        let lags = effects.iter().filter(|a| a.effect.lags());
        self.through = lags.cloned().collect();
        self
    }

    /// What the lags through which the input is told make of it, over each stretch that is known.
    fn lagged(&self, number: usize, input: &mut [f64], known: impl Fn(usize) -> bool) {
        let (view, step_s) = (self.view(number, &[]), self.parts[number].line.step_s);
        let mut from = 0;
        while from < input.len() {
            let to = (from..input.len())
                .find(|&i| !known(i))
                .unwrap_or(input.len());
            let mut terms = Terms {
                xi: Vec::new(),
                factor: Vec::new(),
                force: Vec::new(),
                input: input[from..to].to_vec(),
                input_step_s: step_s,
                gain: Vec::new(),
                shift_s: 0.0,
            };
            for a in &self.through {
                a.effect.line(&a.values, &view, &mut terms);
            }
            input[from..to].copy_from_slice(&terms.input);
            from = to + 1;
        }
    }

    /// The effects at eta.
    #[must_use]
    pub fn effects(&self, eta: &[f64]) -> Vec<Acting> {
        let mut out = self.effects.clone();
        let first = self.plain_unknowns();
        for (place, &(e, v)) in self.free.iter().enumerate() {
            let q = &out[e].effect.parameters()[v];
            out[e].values[v] = (eta[first + place] * q.spread).clamp(q.lower, q.upper);
        }
        out
    }

    /// The film at eta and beta; no spring where it is no coupon.
    #[must_use]
    pub fn film(&self, eta: &[f64], beta: &[f64]) -> Film {
        match &*self.plain {
            Plain::Coupon { branches: n } => Film {
                mu_pa: beta[..=*n].to_vec(),
                relaxation_time_s: eta[..*n].iter().map(|t| t.exp()).collect(),
                locking: 1.0 / eta[*n],
            },
            _ => Film {
                mu_pa: vec![0.0],
                relaxation_time_s: Vec::new(),
                locking: 100.0,
            },
        }
    }

    /// The torque curve at beta; none where it is no bench.
    #[must_use]
    pub fn curve(&self, beta: &[f64]) -> ForearmTorque {
        match &*self.plain {
            Plain::Bench(curve) => curve.with_torques(beta),
            _ => ForearmTorque::zero(),
        }
    }

    /// Symbols of force, coordinate and input.
    #[must_use]
    pub fn symbols(&self) -> (String, &'static str, String) {
        match self.lines().next().map(|l| &l.measured) {
            // the balance is written in units of the input
            Some(Measured::Axis(a)) if self.over_gain() => {
                let coordinate = if a.turns { "rad" } else { "m" };
                (a.unit.clone(), coordinate, a.unit.clone())
            }
            Some(Measured::Axis(a)) if a.turns => ("N m".into(), "rad", a.unit.clone()),
            Some(Measured::Axis(a)) => ("N".into(), "m", a.unit.clone()),
            Some(Measured::Coupon(_)) => ("Pa".into(), "1", String::new()),
            _ => ("N m".into(), "rad", String::new()),
        }
    }

    /// Whether forces are told in units of the input, because nothing but the input or what is known of mass,
    /// damping, stiffness or load sets their scale.
    fn over_gain(&self) -> bool {
        match &*self.plain {
            Plain::Axis { over_gain, .. } => {
                *over_gain
                    || self.lines().any(
                        |l| matches!(&l.measured, Measured::Axis(a) if a.gain == Constant::Free),
                    )
            }
            _ => false,
        }
    }

    /// A quantity of an effect in the units of these recordings: factor and unit.
    #[must_use]
    pub fn unit_of(&self, unit: &'static str) -> (f64, String) {
        let s = self.scales();
        let (force, coordinate, input) = self.symbols();
        let x = coordinate;
        match unit {
            "force" => (s.force, force),
            "coordinate" => (s.coordinate, x.into()),
            "coordinate/s" => (s.coordinate, format!("{x}/s")),
            "s/coordinate" => (1.0 / s.coordinate, format!("s/{x}")),
            "input" => (s.input, input),
            "force/coordinate" => (s.force / s.coordinate, format!("{force}/{x}")),
            "force s/coordinate" => (s.force / s.coordinate, format!("{force} s/{x}")),
            "force/(coordinate/s)^2" => (
                s.force / (s.coordinate * s.coordinate),
                format!("{force} s^2/{x}^2"),
            ),
            "s" if !self.lines().all(|l| l.timed) => (1.0, "rows".into()),
            other => (1.0, other.into()),
        }
    }

    /// What a parameter file needs beside film and torque curve: of an axis its constants, each name with its
    /// unit; of all kinds rest and the largest values ([`Scales`]), in m or rad (1 for a stretch), N, N m or
    /// Pa, and the unit of the input.
    #[must_use]
    pub fn values(&self, eta: &[f64], beta: &[f64]) -> Vec<(String, f64)> {
        let mut out: Vec<(String, f64)> = Vec::new();
        let mut add = |name: &str, value: f64| out.push((name.to_owned(), value));
        if let Plain::Axis { terms, known, .. } = &*self.plain {
            let turns = self
                .lines()
                .any(|l| matches!(&l.measured, Measured::Axis(a) if a.turns));
            let place = |term: AxisTerm| terms.iter().position(|t| *t == term);
            // with the gain to be found, what is found of the others is each over the gain
            let found = place(AxisTerm::Gain).map(|i| 1.0 / beta[i]);
            let of = |term: AxisTerm, known: f64| {
                place(term).map_or(known, |i| found.unwrap_or(1.0) * beta[i])
            };
            let found_or_known = [
                found.unwrap_or(known[0]),
                of(AxisTerm::Mass, known[1]),
                of(AxisTerm::Damping, known[2]),
                of(AxisTerm::Stiffness, known[3]),
                of(AxisTerm::Bias, 0.0),
            ];
            for (name, value) in axis_names(turns).into_iter().zip(found_or_known) {
                add(name, value);
            }
            if !self.free_offsets.is_empty() {
                add(
                    "clock_offset_s",
                    eta[self.plain_unknowns() - self.free_offsets.len()],
                );
            }
        }
        add("rest", self.scales.rest);
        add("largest_coordinate", self.scales.coordinate);
        add("largest_force", self.scales.force);
        add("largest_input", self.scales.input);
        out
    }

    /// Clock offset of a recording, s.
    fn offset_s(&self, number: usize, eta: &[f64]) -> f64 {
        if let Some(place) = self.free_offsets.iter().position(|&r| r == number) {
            return eta[self.plain_unknowns() - self.free_offsets.len() + place];
        }
        match &self.parts[number].line.measured {
            Measured::Axis(AxisLine {
                offset_s: Constant::Known(o),
                ..
            }) => *o,
            _ => 0.0,
        }
    }

    /// What effects make of a recording whose input is `more` larger (over its largest value).
    fn terms(&self, number: usize, effects: &[Acting], elastic: &[f64], more: f64) -> Terms {
        let p = &self.parts[number];
        let n = p.xi.len();
        let (input, input_step_s) = match &p.line.measured {
            Measured::Axis(a) => {
                let step = (a.input_time_s[a.input.len() - 1] - a.input_time_s[0])
                    / (a.input.len().max(2) - 1) as f64;
                (
                    a.input
                        .iter()
                        .map(|u| u / self.scales.input + more)
                        .collect(),
                    step,
                )
            }
            _ => (Vec::new(), p.line.step_s),
        };
        let mut terms = Terms {
            xi: p.xi.to_vec(),
            factor: vec![[1.0; 2]; n],
            force: vec![0.0; n],
            input,
            input_step_s,
            gain: vec![1.0; n],
            shift_s: 0.0,
        };
        let view = self.view(number, elastic);
        for a in effects {
            a.effect.line(&a.values, &view, &mut terms);
        }
        terms
    }

    /// Mean logarithm, over the kept samples of all recordings, of the slope of what `effects` make of the
    /// input by the input: the Jacobian by which a residual in what acts is told as one of the input that was
    /// stated (Box and Cox 1964). Without it a cause that maps much of the input to one value, or makes it
    /// small, would earn by shrinking what it is weighed against. 0 without such causes.
    ///
    /// The slope is a secant over more than the input's noise. What passes frequencies unevenly counts with
    /// the mean logarithm of what it passes in the band. Where the input is not told (a ceiling says "at
    /// least"), its density is even over the untold range.
    #[must_use]
    pub fn log_slope(&self, effects: &[Acting]) -> f64 {
        let drives: Vec<Acting> = effects
            .iter()
            .filter(|a| a.effect.drives())
            .cloned()
            .collect();
        if self.kind != Kind::Axis || drives.is_empty() {
            return 0.0;
        }
        let bends = drives.iter().any(|a| !a.effect.lags());
        let (mut slopes, mut flat): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        let mut noise = 0.0_f64;
        let (mut passed, mut rows) = (0.0, 0.0);
        for (number, p) in self.parts.iter().enumerate() {
            let Measured::Axis(axis) = &p.line.measured else {
                continue;
            };
            rows += p.kept.len() as f64;
            if bends {
                let step = (0.5 * axis.input_noise / self.scales.input).max(SECANT);
                let [up, down] = [step, -step].map(|d| self.terms(number, &drives, &[], d));
                let own = p.kept.iter().map(|&c| p.time_s[c] + up.shift_s);
                let at = |u: &[f64]| -> Vec<f64> {
                    interpolate_rising(&axis.input_time_s, u, own.clone()).collect()
                };
                let (above, below, stated) = (at(&up.input), at(&down.input), at(&axis.input));
                for (i, &c) in p.kept.iter().enumerate() {
                    let slope = (above[i] - below[i]) / (2.0 * step) * up.gain[c];
                    if slope.abs() < FLAT {
                        flat.push(stated[i].abs() / self.scales.input);
                    } else {
                        slopes.push(slope.abs());
                    }
                }
            }
            let own = self.noise(number) / (self.gain().abs() * self.scales.input);
            noise = noise.max(own);
            let points = 32;
            let at = |i: usize| 1.15 * axis.band_hz * (i as f64 + 0.5) / points as f64;
            // what rings up earns nothing by it
            let of = |i: usize| -> f64 {
                let each = drives.iter().map(|a| a.effect.passes(&a.values, at(i)));
                each.product::<f64>().min(1.0).ln()
            };
            passed += p.kept.len() as f64 * (0..points).map(of).sum::<f64>() / points as f64;
        }
        // Even over the range that is not told, against a normal density of the noise; and there no residual
        // shows how large that is.
        let range = flat.iter().fold(0.0_f64, |m, u| m.max(*u))
            - flat.iter().fold(f64::INFINITY, |m, u| m.min(*u));
        let even = TAU.sqrt() * noise / range.max(SECANT);
        let untold = even.clamp(1e-6, (-0.5_f64).exp()).ln();
        let told: f64 = slopes.iter().map(|s| s.min(1.0 / SECANT).ln()).sum();
        (told + untold * flat.len() as f64 + passed) / f64::max(rows, 1.0)
    }

    /// A recording as effects see it.
    #[must_use]
    pub fn view<'b>(&'b self, number: usize, elastic: &'b [f64]) -> View<'b> {
        let p = &self.parts[number];
        View {
            recording: p.when.recording,
            held: 0.0,
            timed: p.line.timed,
            time_s: &p.time_s,
            step_s: p.line.step_s,
            duration_s: (p.time_s[p.time_s.len() - 1] - p.time_s[0]).max(f64::MIN_POSITIVE),
            series_s: p.when.series_s,
            unstrained: matches!(&*self.plain, Plain::Coupon { .. }),
            straight: matches!(&*self.plain, Plain::Axis { .. }),
            xi: &p.xi,
            way: &p.way,
            rate: &p.rate,
            speed: largest(p.rate.iter().copied()).max(f64::MIN_POSITIVE),
            acceleration: &p.acceleration,
            inertial: self.has_mass(),
            elastic,
            second: &p.second,
        }
    }

    /// Force of the springs at a model, over the largest force: what friction that grows with the load sees.
    fn elastic(&self, number: usize, beta: &[f64]) -> Vec<f64> {
        let p = &self.parts[number];
        match &*self.plain {
            Plain::Bench(curve) => {
                let curve = curve.with_torques(beta);
                p.xi.iter()
                    .map(|x| {
                        let angle = self.scales.rest + self.scales.coordinate * x;
                        curve.torque_n_m_at(angle) / self.scales.force
                    })
                    .collect()
            }
            Plain::Axis {
                terms,
                known,
                over_gain,
            } => {
                let place = terms.iter().position(|t| *t == AxisTerm::Stiffness);
                let inverse = inverse_gain(terms, *over_gain, beta);
                let k = place.map_or(inverse * known[3], |i| beta[i]);
                let factor = k * self.scales.coordinate / self.scales.force;
                p.xi.iter().map(|x| factor * x).collect()
            }
            Plain::Coupon { .. } => vec![0.0; p.xi.len()],
        }
    }

    /// Columns of beta and the constant side of a recording at its kept places: r = B beta - d, N, N m or Pa;
    /// and d without what was measured (of an axis: without what the input makes).
    fn rows_of(
        &self,
        number: usize,
        eta: &[f64],
        beta: &[f64],
        effects: &[Acting],
    ) -> Result<Rows, Locked> {
        let p = &self.parts[number];
        let elastic = if effects.iter().any(|a| a.effect.sees_elastic()) {
            self.elastic(number, beta)
        } else {
            vec![0.0; p.xi.len()]
        };
        let terms = self.terms(number, effects, &elastic, 0.0);
        match &*self.plain {
            Plain::Bench(curve) => Ok(self.bench_rows(p, curve, &terms)),
            Plain::Axis {
                terms: list,
                known,
                over_gain,
            } => {
                let Some(filtered) = self.filtered(number, eta, &terms) else {
                    return Ok(self.no_rows(p));
                };
                Ok(self.axis_rows(p, list, known, *over_gain, &filtered))
            }
            Plain::Coupon { branches } => {
                let stresses = self.stresses(number, eta, *branches, &terms)?;
                Ok(self.coupon_rows(p, &stresses, &terms))
            }
        }
    }

    /// Columns and constant side before anything is put in.
    fn no_rows(&self, p: &Part) -> Rows {
        let rows = p.kept.len();
        (
            DMatrix::zeros(rows, self.linear()),
            DVector::zeros(rows),
            Vec::new(),
        )
    }

    /// Of a bench, with the torque curve as a basis.
    fn bench_rows(&self, p: &Part, curve: &ForearmTorque, terms: &Terms) -> Rows {
        let s = &self.scales;
        let (mut b, mut d, mut rest) = self.no_rows(p);
        let mut basis = vec![0.0; self.linear()];
        for (row, &i) in p.kept.iter().enumerate() {
            curve.basis(s.rest + s.coordinate * terms.xi[i], &mut basis);
            for (j, v) in basis.iter().enumerate() {
                b[(row, j)] = v * terms.factor[i][0];
            }
            rest.push(-s.force * terms.force[i]);
            d[row] = p.measured[row] + rest[row];
        }
        (b, d, rest)
    }

    /// Input, stiffness and force of effects on an axis at its kept places, through the low-pass; what no
    /// effect touches is not worked out again.
    fn filtered(&self, number: usize, eta: &[f64], terms: &Terms) -> Option<[Vec<f64>; 3]> {
        let (p, s) = (&self.parts[number], &self.scales);
        let Measured::Axis(axis) = &p.line.measured else {
            return None;
        };
        let plain_input = terms
            .input
            .iter()
            .zip(&axis.input)
            .all(|(u, own)| *u == own / s.input);
        let plain_gain = terms.gain.iter().all(|g| *g == 1.0);
        let whole = plain_input && plain_gain && terms.shift_s == 0.0;
        let input = if whole && !p.base.input.is_empty() {
            p.base.input.clone()
        } else {
            let offset = self.offset_s(number, eta) + terms.shift_s;
            let mut u = shifted(p.line, axis, &terms.input, s.input, offset);
            u.iter_mut().zip(&terms.gain).for_each(|(u, g)| *u *= g);
            p.at_kept(&u)
        };
        let plain_spring = terms.xi == *p.xi && terms.factor.iter().all(|f| f[0] == 1.0);
        let stiffness = if plain_spring {
            p.base.stiffness.clone()
        } else {
            let spring: Vec<f64> = terms
                .xi
                .iter()
                .zip(&terms.factor)
                .map(|(x, f)| s.coordinate * x * f[0])
                .collect();
            p.at_kept(&spring)
        };
        let force = if terms.force.iter().all(|f| *f == 0.0) {
            vec![0.0; p.kept.len()]
        } else {
            p.at_kept(&terms.force)
        };
        Some([input, stiffness, force])
    }

    /// Of an axis, from its input, stiffness and force through the low-pass.
    fn axis_rows(
        &self,
        p: &Part,
        list: &[AxisTerm],
        known: &[f64; 4],
        over_gain: bool,
        [input, stiffness, force]: &[Vec<f64>; 3],
    ) -> Rows {
        let (mut b, mut d, mut rest) = self.no_rows(p);
        let base = &p.base;
        for row in 0..p.kept.len() {
            let known_side = known[1] * base.mass[row]
                + known[2] * base.damping[row]
                + known[3] * stiffness[row]
                - base.load[row];
            for (j, term) in list.iter().enumerate() {
                b[(row, j)] = match term {
                    AxisTerm::Mass => base.mass[row],
                    AxisTerm::Damping => base.damping[row],
                    AxisTerm::Stiffness => stiffness[row],
                    AxisTerm::Bias => 1.0,
                    AxisTerm::Gain => known_side,
                };
            }
            let known_side = if over_gain { 0.0 } else { known_side };
            rest.push(-self.scales.force * force[row] - known_side);
            d[row] = known[0] * input[row] + rest[row];
        }
        (b, d, rest)
    }

    /// Of a coupon, from the nominal stress of each spring at its nodes.
    fn coupon_rows(&self, p: &Part, stresses: &DMatrix<f64>, terms: &Terms) -> Rows {
        let (mut b, mut d, mut rest) = self.no_rows(p);
        let at = |i: usize, j: usize| stresses[(i, j)] * terms.factor[i][usize::from(j > 0)];
        for (row, (&i, mean)) in p.kept.iter().zip(p.means.iter()).enumerate() {
            let between = |near: f64, other: f64| near + mean.share * (other - near);
            for j in 0..stresses.ncols() {
                b[(row, j)] = between(at(i, j), at(mean.other, j));
            }
            let force = between(terms.force[i], terms.force[mean.other]);
            rest.push(-self.scales.force * force);
            d[row] = p.measured[row] + rest[row];
        }
        (b, d, rest)
    }

    /// Nominal stress per modulus of each spring at the nodes of a coupon's grid.
    fn stresses(
        &self,
        number: usize,
        eta: &[f64],
        branches: usize,
        terms: &Terms,
    ) -> Result<DMatrix<f64>, Locked> {
        let p = &self.parts[number];
        let Measured::Coupon(coupon) = &p.line.measured else {
            return Ok(DMatrix::zeros(0, 0));
        };
        let s = &self.scales;
        let grid = &coupon.grid;
        let moved: Vec<f64> = terms
            .xi
            .iter()
            .map(|x| (s.rest + s.coordinate * x).max(0.05))
            .collect();
        let middle: Vec<f64> = (0..moved.len())
            .map(|k| {
                let before = k.saturating_sub(1);
                let shift =
                    0.5 * (moved[k] - grid.stretch[k] + moved[before] - grid.stretch[before]);
                (grid.mid_stretch[k] + shift).max(0.05)
            })
            .collect();
        let history = stretch_history(coupon, &moved, &middle);
        let relaxation: Vec<f64> = eta[..branches].iter().map(|t| t.exp()).collect();
        let shape = Shape {
            relaxation_time_s: &relaxation,
            locking: 1.0 / eta[branches],
        };
        let mut pass = Pass::of_stress(&history, shape);
        let width = pass.row_width();
        let nodes = moved.len();
        let mut rows = vec![0.0; nodes * width];
        let mut have = 0;
        while have < nodes {
            let produced = pass.next_block(&mut rows[have * width..])?;
            if produced == 0 {
                break;
            }
            have += produced;
        }
        Ok(DMatrix::from_fn(nodes, branches + 1, |i, j| {
            rows[i * width + j / LANES * ROW + j % LANES]
        }))
    }

    /// Whitened residual at every kept place of every recording, as one of the stated input
    /// ([`Self::log_slope`]).
    fn residual(
        &self,
        eta: &[f64],
        beta: &[f64],
        effects: &[Acting],
    ) -> Result<DVector<f64>, Locked> {
        let beta_v = DVector::from_column_slice(beta);
        let stated = (-self.log_slope(effects)).exp();
        let mut out = Vec::with_capacity(self.rows());
        for number in 0..self.parts.len() {
            let (b, d, _) = self.rows_of(number, eta, beta, effects)?;
            let r = b * &beta_v - d;
            let weight = &self.parts[number].weight;
            out.extend(r.iter().zip(weight).map(|(r, w)| stated * r * w));
        }
        Ok(DVector::from_vec(out))
    }

    /// The whitened design: d r/d eta, B, residual; of an axis as a residual of the stated input
    /// ([`Self::log_slope`]).
    ///
    /// # Errors
    /// [`Locked`] when a coupon's film is past its locking stretch.
    pub fn design(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        let (nonlinear, linear) = (eta.len(), beta.len());
        let mut out = DMatrix::zeros(self.rows(), nonlinear + linear + 1);
        let effects = self.effects(eta);
        let stated = (-self.log_slope(&effects)).exp();
        let beta_v = DVector::from_column_slice(beta);
        let mut from = 0;
        for number in 0..self.parts.len() {
            let (b, d, _) = self.rows_of(number, eta, beta, &effects)?;
            let r = &b * &beta_v - d;
            for (i, w) in self.parts[number].weight.iter().enumerate() {
                let w = stated * w;
                for j in 0..linear {
                    out[(from + i, nonlinear + j)] = w * b[(i, j)];
                }
                out[(from + i, nonlinear + linear)] = w * r[i];
            }
            from += self.parts[number].kept.len();
        }
        for j in 0..nonlinear {
            let mut moved = eta.to_vec();
            let step = STEP * eta[j].abs().max(1e-2);
            let [low, high] = self.bounds(j);
            let (above, below) = ((eta[j] + step).min(high), (eta[j] - step).max(low));
            if above <= below {
                continue;
            }
            moved[j] = above;
            let up = self.residual(&moved, beta, &self.effects(&moved));
            moved[j] = below;
            let down = self.residual(&moved, beta, &self.effects(&moved));
            let here = out.column(nonlinear + linear);
            let column = match (up, down) {
                (Ok(up), Ok(down)) => (up - down) / (above - below),
                (Ok(up), Err(_)) => (up - here) / (above - eta[j]),
                (Err(_), Ok(down)) => (here - down) / (eta[j] - below),
                (Err(e), Err(_)) => return Err(e),
            };
            out.set_column(j, &column);
        }
        Ok(out)
    }

    /// Bounds of a nonlinear unknown that is a value of an effect, over its spread; none for the others.
    #[must_use]
    pub fn bounds(&self, unknown: usize) -> [f64; 2] {
        let place = unknown.checked_sub(self.plain_unknowns());
        match place.and_then(|p| self.free.get(p)) {
            Some(&(e, v)) => {
                let q = &self.effects[e].effect.parameters()[v];
                [q.lower / q.spread, q.upper / q.spread]
            }
            None => [f64::NEG_INFINITY, f64::INFINITY],
        }
    }

    /// Whitened change of the residual when an effect joins.
    ///
    /// # Errors
    /// [`Locked`] when a coupon's film is past its locking stretch.
    pub fn fingerprint(
        &self,
        eta: &[f64],
        beta: &[f64],
        acting: &Acting,
    ) -> Result<Vec<f64>, Locked> {
        let mut effects = self.effects(eta);
        let before = self.residual(eta, beta, &effects)?;
        effects.push(acting.clone());
        let after = self.residual(eta, beta, &effects)?;
        Ok((after - before).iter().copied().collect())
    }

    /// Sets the weights to the noise at a model: of the torque or stress; of an axis that of position, input
    /// and load through the low-pass.
    pub fn weigh(&mut self, beta: &[f64]) {
        let plain = self.plain.clone();
        for p in &mut self.parts {
            let sd = match (&*plain, &p.line.measured) {
                (
                    Plain::Axis {
                        terms,
                        known,
                        over_gain,
                    },
                    Measured::Axis(a),
                ) => axis_noise(p, terms, known, *over_gain, a, beta),
                _ => p.line.noise,
            };
            let least = 1e-12 * self.scales.force;
            match &*plain {
                // noise of the angle moves along the curve
                Plain::Bench(curve) => {
                    let curve = curve.with_torques(beta);
                    let angle = |i: usize| self.scales.rest + self.scales.coordinate * p.xi[i];
                    for (w, &i) in p.weight.iter_mut().zip(p.kept.iter()) {
                        let at = |by: f64| curve.torque_n_m_at(angle(i) + by * p.line.x_noise);
                        let along = 0.5 * (at(1.0) - at(-1.0));
                        *w = 1.0 / sd.hypot(along).max(least);
                    }
                }
                _ => p.weight.fill(1.0 / sd.max(least)),
            }
            for (w, mean) in p.weight.iter_mut().zip(p.means.iter()) {
                *w *= p.line.independent(mean.rows).sqrt();
            }
        }
    }

    /// Standard deviation of the noise of a recording's residual, N, N m or Pa, as the weights have it (root
    /// mean square over the rows).
    #[must_use]
    pub fn noise(&self, number: usize) -> f64 {
        let weight = &self.parts[number].weight;
        let squares: f64 = weight.iter().map(|w| w.powi(-2)).sum();
        (squares / weight.len() as f64).sqrt()
    }

    /// Noise of the whitened residual, drawn so many times: white.
    #[must_use]
    pub fn noise_rows(&self, count: usize) -> Vec<Vec<f64>> {
        let mut generator = ChaCha12Rng::seed_from_u64(0x6c69_6e65);
        (0..count)
            .map(|_| {
                (0..self.rows())
                    .map(|_| StandardNormal.sample(&mut generator))
                    .collect()
            })
            .collect()
    }

    /// Names of the constants of an axis that are linear unknowns, in their order: the beginnings of names in
    /// [`Self::values`].
    #[must_use]
    pub fn constants(&self) -> Vec<&'static str> {
        let turns = self
            .lines()
            .any(|l| matches!(&l.measured, Measured::Axis(a) if a.turns));
        let names = axis_names(turns);
        match &*self.plain {
            Plain::Axis { terms, .. } => terms
                .iter()
                .map(|t| match t {
                    AxisTerm::Gain => names[0],
                    AxisTerm::Mass => names[1],
                    AxisTerm::Damping => names[2],
                    AxisTerm::Stiffness => names[3],
                    AxisTerm::Bias => names[4],
                })
                .collect(),
            _ => Vec::new(),
        }
    }

    /// What white noise of position and of the measured quantity makes of the residual at a frequency in
    /// cycles a kept row, as densities that have the mean 1 over the band.
    #[must_use]
    pub fn noise_shape(&self, beta: &[f64], cycles: f64) -> [f64; 2] {
        let (
            Plain::Axis {
                terms,
                known,
                over_gain,
            },
            Some(p),
        ) = (&*self.plain, self.parts.first())
        else {
            return [1.0; 2];
        };
        let Measured::Axis(axis) = &p.line.measured else {
            return [1.0; 2];
        };
        let [m, c, k] = plant(terms, known, *over_gain, beta);
        let every = match p.kept.windows(2).map(|w| w[1] - w[0]).min() {
            Some(e) => e as f64 * p.line.step_s,
            None => return [1.0; 2],
        };
        let density = |f: f64| {
            let w = TAU * f / every;
            if axis.velocity {
                (m * w).hypot(c).powi(2)
            } else {
                (k - m * w * w).hypot(c * w).powi(2)
            }
        };
        let points = 64;
        let at = |i: usize| density(0.5 * (i as f64 + 0.5) / points as f64);
        let mean = (0..points).map(at).sum::<f64>() / points as f64;
        [(density(cycles) / mean).max(1e-6), 1.0]
    }

    /// Stretches of rows to be left out one at a time: about twelve over all recordings, at least two of
    /// each, of a whole cycle or more where there are four. First rows, and one past the last.
    #[must_use]
    pub fn blocks(&self) -> Vec<usize> {
        let wanted = BLOCKS.div_ceil(self.parts.len()).max(2);
        let mut edges = vec![0];
        for p in &self.parts {
            let kept: Vec<f64> = p.kept.iter().map(|&c| p.xi[c]).collect();
            let mean = kept.iter().sum::<f64>() / kept.len().max(1) as f64;
            let crossings = kept
                .windows(2)
                .filter(|w| (w[0] - mean) * (w[1] - mean) < 0.0)
                .count();
            let cycles = crossings / 2;
            let count = if cycles >= 4 {
                wanted.min(cycles)
            } else {
                wanted
            };
            let count = count.min(kept.len() / FEWEST_ROWS).max(1);
            let first = edges[edges.len() - 1];
            edges.extend((1..=count).map(|i| first + i * kept.len() / count));
        }
        edges.dedup();
        edges
    }

    /// Flexible columns by the site where physics might act, whitened at the kept places: what a force, a
    /// drive or a reading could be that depends on position, rate, direction, history, input or time in
    /// whatever way. Hat functions in position, rate and input, ripples in position, states of sliding over
    /// three distances, Debye lags over five times, waves along the recording.
    ///
    /// # Errors
    /// [`Locked`] when a coupon's film is past its locking stretch.
    pub fn sites(&self, eta: &[f64], beta: &[f64]) -> Result<Sites, Locked> {
        let mut out: Columns = Vec::new();
        for number in 0..self.parts.len() {
            for (place, (site, columns)) in
                self.sites_of(number, eta, beta)?.into_iter().enumerate()
            {
                if number == 0 {
                    out.push((site, vec![Vec::new(); columns.len()]));
                }
                for (sum, own) in out[place].1.iter_mut().zip(columns) {
                    sum.extend(own);
                }
            }
        }
        let rows = self.rows();
        Ok(out
            .into_iter()
            .map(|(site, columns)| {
                (
                    site,
                    DMatrix::from_iterator(rows, columns.len(), columns.into_iter().flatten()),
                )
            })
            .collect())
    }

    /// Whitened change of the residual with each coefficient of a learnt term.
    #[must_use]
    pub fn term_columns(&self, term: &Learnt) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(self.rows(), term.form.count());
        let mut first = 0;
        for (number, p) in self.parts.iter().enumerate() {
            let at_rest = vec![0.0; p.xi.len()];
            let columns = term.columns_along(&self.view(number, &at_rest));
            for (j, column) in columns.iter().enumerate() {
                for (row, (v, w)) in p.at_kept(column).iter().zip(&p.weight).enumerate() {
                    out[(first + row, j)] = self.scales.force * w * v;
                }
            }
            first += p.kept.len();
        }
        out
    }

    /// Columns of each site of one recording.
    fn sites_of(&self, number: usize, eta: &[f64], beta: &[f64]) -> Result<Columns, Locked> {
        let p = &self.parts[number];
        let mut sites = vec![
            ("position", p.position_columns()),
            ("friction", p.friction_columns()),
            ("history", p.history_columns()),
        ];
        if p.line.timed {
            if !p.acceleration.is_empty() {
                sites.push(("inertia", p.inertia_columns()));
            }
            sites.push(("series", p.slow_columns()));
        }
        let white = |kept: Vec<f64>| -> Vec<f64> {
            kept.iter()
                .zip(&p.weight)
                .map(|(v, w)| self.scales.force * w * v)
                .collect()
        };
        let all = |columns: Vec<Vec<f64>>| columns.iter().map(|c| white(p.at_kept(c))).collect();
        let mut out: Columns = sites
            .into_iter()
            .map(|(site, columns)| (site, all(columns)))
            .collect();
        if let Measured::Axis(_) = &p.line.measured {
            let electrical = self.electrical_columns(number, eta, beta)?;
            out.push(("electrical", electrical.into_iter().map(white).collect()));
        }
        Ok(out)
    }

    /// Columns of the drive of an axis at its kept places, in what the model needs, not in what was measured:
    /// columns of that would explain it by itself.
    fn electrical_columns(
        &self,
        number: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<Vec<f64>>, Locked> {
        let p = &self.parts[number];
        let effects = self.effects(eta);
        let (b, _, rest) = self.rows_of(number, eta, beta, &effects)?;
        let needed = b * DVector::from_column_slice(beta) - DVector::from_vec(rest);
        let size = self.gain() * self.scales.input;
        let u: Vec<f64> = needed.iter().map(|n| n / size).collect();
        let mut out = hats(&u, -1.2, 1.2, 13);
        for rows in [1.0_f64, 3.0, 10.0, 30.0, 100.0] {
            let mut q = u.first().copied().unwrap_or(0.0);
            let lagged = u.iter().map(|u| {
                q += (1.0 - (-1.0 / rows).exp()) * (u - q);
                q
            });
            out.push(lagged.collect());
        }
        let xi: Vec<f64> = p.kept.iter().map(|&c| p.xi[c]).collect();
        out.push(times(&u, &xi));
        out.push(times(&times(&u, &xi), &xi));
        Ok(out)
    }

    /// What instruments make of the whitened balance of an axis without anything being at work, a column
    /// each, as large as it is expected (one standard deviation): noise in the coordinate shortens what is
    /// fitted to its derivatives by the noise's share of their power (errors in variables: Fuller,
    /// Measurement Error Models, 1987), and no two clocks agree, nor is a drive held, within a sample. None
    /// for benches and coupons, whose noise is that of what is measured.
    ///
    /// # Errors
    /// None for axes; those of [`LineResidual::design`].
    pub fn blur(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        let mut columns: Vec<Vec<f64>> = vec![Vec::new(); 5];
        for number in 0..self.parts.len() {
            let p = &self.parts[number];
            let Plain::Axis {
                terms,
                known,
                over_gain,
            } = &*self.plain
            else {
                return Ok(DMatrix::zeros(self.rows(), 0));
            };
            let (Measured::Axis(axis), Some(kernel)) = (&p.line.measured, &p.kernel) else {
                return Ok(DMatrix::zeros(self.rows(), 0));
            };
            let up = usize::from(!axis.velocity);
            let base = [&p.base.mass, &p.base.damping, &p.base.stiffness];
            let orders = [Some(1 + up), Some(up), (!axis.velocity).then_some(0)];
            for (k, plant) in plant(terms, known, *over_gain, beta)
                .into_iter()
                .enumerate()
            {
                let noise = orders[k].map_or(0.0, |o| {
                    let taps: f64 = kernel.taps[o].iter().map(|t| t * t).sum();
                    p.line.x_noise.powi(2) * taps
                });
                let power = base[k].iter().map(|v| v * v).sum::<f64>() / base[k].len() as f64;
                let share = noise / power.max(noise).max(f64::MIN_POSITIVE);
                let own = base[k].iter().zip(&p.weight);
                columns[k].extend(own.map(|(v, w)| plant * share * w * v));
            }
            let input: Vec<f64> = axis.input.iter().map(|u| u / self.scales.input).collect();
            let offset = self.offset_s(number, eta);
            let u = shifted(p.line, axis, &input, self.scales.input, offset);
            for order in [1, 2] {
                let size = known[0] * p.line.step_s.powi(order as i32);
                let own = p.kept.iter().zip(&p.weight);
                columns[2 + order].extend(own.map(|(&c, w)| size * w * kernel.at(order, &u, c)));
            }
        }
        Ok(DMatrix::from_iterator(
            self.rows(),
            columns.len(),
            columns.into_iter().flatten(),
        ))
    }

    /// Kept places of a recording.
    #[must_use]
    pub fn kept(&self, number: usize) -> &[usize] {
        &self.parts[number].kept
    }

    /// Measured torque or stress at the kept places; empty for an axis.
    #[must_use]
    pub fn measured(&self, number: usize) -> &[f64] {
        &self.parts[number].measured
    }

    /// Times, excursions over the largest, and rates at all places of a recording.
    #[must_use]
    pub fn course(&self, number: usize) -> (&[f64], &[f64], &[f64]) {
        let p = &self.parts[number];
        (&p.time_s, &p.xi, &p.rate)
    }

    /// Whitening weights of a recording.
    #[must_use]
    pub fn weights(&self, number: usize) -> &[f64] {
        &self.parts[number].weight
    }

    /// The stated quantity at the kept places of a recording, predicted from everything else and as measured:
    /// torque of a bench, stress of a coupon, input of an axis in its unit (low-passed as the balance is, the
    /// model's drive causes taken back). NaN where the model does not tell it: a ceiling says no more than
    /// "at least". A prediction reads nothing of what it predicts.
    ///
    /// # Errors
    /// [`Locked`] when a coupon's film is past its locking stretch.
    pub fn stated(
        &self,
        number: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<(Vec<f64>, Vec<f64>), Locked> {
        let effects = self.effects(eta);
        let p = &self.parts[number];
        let Measured::Axis(axis) = &p.line.measured else {
            let (b, _, rest) = self.rows_of(number, eta, beta, &effects)?;
            let asked = &b * DVector::from_column_slice(beta) - DVector::from_vec(rest);
            return Ok((asked.as_slice().to_vec(), p.measured.to_vec()));
        };
        // derivatives need every sample
        let lags = effects.iter().chain(&self.through).any(|a| a.effect.lags());
        let dense = lags.then(|| {
            let mut whole = self.clone();
            whole.parts[number] = Part {
                when: p.when,
                weight: Vec::new(),
                ..part(p.line, number, &self.scales, true)
            };
            whole
        });
        let own = dense.as_ref().unwrap_or(self);
        let kept = &own.parts[number].kept;
        let (b, _, rest) = own.rows_of(number, eta, beta, &effects)?;
        let needed = &b * DVector::from_column_slice(beta) - DVector::from_vec(rest);
        let per_input = self.gain() * self.scales.input;
        let elastic = if effects.iter().any(|a| a.effect.sees_elastic()) {
            self.elastic(number, beta)
        } else {
            vec![0.0; p.xi.len()]
        };
        let terms = self.terms(number, &effects, &elastic, 0.0);
        let mut undone = Undone {
            step_s: p.line.step_s,
            input: (0..kept.len())
                .map(|i| needed[i] / per_input / terms.gain[kept[i]])
                .collect(),
            told: vec![true; kept.len()],
            noise: self.noise(number) / per_input.abs(),
        };
        if dense.is_some() {
            // a neighbour across a gap is none
            for i in 1..kept.len() {
                undone.told[i] &= kept[i] == kept[i - 1] + 1;
            }
        }
        for a in effects.iter().rev() {
            a.effect.undo(&a.values, &mut undone);
        }
        own.lagged(number, &mut undone.input, |i| undone.told[i]);
        let at = |c: usize| kept.binary_search(&c).ok().filter(|&i| undone.told[i]);
        let asked = p.kept.iter().map(|&c| {
            let input = at(c).map_or(f64::NAN, |i| undone.input[i]);
            self.scales.input * input
        });
        let offset = self.offset_s(number, eta) + terms.shift_s;
        let mut u = shifted(p.line, axis, &axis.input, 1.0, offset);
        self.lagged(number, &mut u, |_| true);
        let kernel = p.kernel.as_ref().expect("an axis has one");
        let measured = p.kept.iter().map(|&c| kernel.at(0, &u, c));
        Ok((asked.collect(), measured.collect()))
    }

    /// What an error of the balance is divided by to be one of the input; 1 where it is no axis.
    #[must_use]
    pub fn gain(&self) -> f64 {
        match &*self.plain {
            Plain::Axis { known, .. } if known[0] != 0.0 => known[0],
            _ => 1.0,
        }
    }

    /// The least and the largest coordinate at the kept places (angle, rad; position, m; stretch).
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        let at = |xi: f64| self.scales.rest + self.scales.coordinate * xi;
        let all = (self.parts.iter()).flat_map(|p| p.kept.iter().map(|&c| at(p.xi[c])));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
            [low.min(x), high.max(x)]
        })
    }

    /// The same recordings with only those kept places for which `keep` is true: number of the place, how many
    /// there are, and the coordinate there (angle, rad; position, m; stretch).
    #[must_use]
    pub fn only(&self, keep: impl Fn(usize, usize, f64) -> bool) -> Self {
        let mut out = self.clone();
        for p in &mut out.parts {
            let n = p.kept.len();
            let at = |i: usize| self.scales.rest + self.scales.coordinate * p.xi[p.kept[i]];
            let rows: Vec<usize> = (0..n).filter(|&i| keep(i, n, at(i))).collect();
            let pick = |v: &[f64]| -> Vec<f64> {
                rows.iter().filter_map(|&i| v.get(i).copied()).collect()
            };
            p.measured = Arc::new(pick(&p.measured));
            p.means = Arc::new(
                rows.iter()
                    .filter_map(|&i| p.means.get(i).copied())
                    .collect(),
            );
            p.weight = pick(&p.weight);
            p.base = Arc::new(Base {
                mass: pick(&p.base.mass),
                damping: pick(&p.base.damping),
                stiffness: pick(&p.base.stiffness),
                load: pick(&p.base.load),
                input: pick(&p.base.input),
            });
            p.kept = Arc::new(rows.iter().map(|&i| p.kept[i]).collect());
        }
        out
    }
}

/// Gain, mass, damping, stiffness, force at rest, as files write them.
fn axis_names(turns: bool) -> [&'static str; 5] {
    if turns {
        [
            "gain_N_m",
            "inertia_kg_m2",
            "damping_N_m_s",
            "stiffness_N_m",
            "bias_N_m",
        ]
    } else {
        [
            "gain_N",
            "mass_kg",
            "damping_N_s_m",
            "stiffness_N_m",
            "bias_N",
        ]
    }
}

/// One over the gain, where that is to be found.
fn inverse_gain(terms: &[AxisTerm], over_gain: bool, beta: &[f64]) -> f64 {
    let free = terms.iter().position(|t| *t == AxisTerm::Gain);
    free.filter(|_| over_gain).map_or(1.0, |i| beta[i])
}

/// An input (times `scale`) at the times of the motion, read `offset` later on its own clock.
fn shifted(line: &Line, axis: &AxisLine, input: &[f64], scale: f64, offset: f64) -> Vec<f64> {
    let at = line.time_s.iter().map(|t| t + offset);
    interpolate_rising(&axis.input_time_s, input, at)
        .map(|u| scale * u)
        .collect()
}

/// Mass, damping, stiffness and bias of an axis at a model, and what multiplies its load, in the unit of its
/// balance.
fn balance<R: Real>(terms: &[AxisTerm], known: &[f64; 4], over_gain: bool, beta: &[R]) -> [R; 5] {
    let place = |term: AxisTerm| terms.iter().position(|t| *t == term);
    let inverse = place(AxisTerm::Gain).filter(|_| over_gain);
    let inverse = inverse.map_or(R::of(1.0), |i| beta[i]);
    let of = |term: AxisTerm, known: f64| place(term).map_or(inverse.times(known), |i| beta[i]);
    [
        of(AxisTerm::Mass, known[1]),
        of(AxisTerm::Damping, known[2]),
        of(AxisTerm::Stiffness, known[3]),
        of(AxisTerm::Bias, 0.0),
        inverse,
    ]
}

/// Mass, damping, stiffness of an axis at a model, in the unit of its balance.
fn plant(terms: &[AxisTerm], known: &[f64; 4], over_gain: bool, beta: &[f64]) -> [f64; 3] {
    let [mass, damping, stiffness, ..] = balance(terms, known, over_gain, beta);
    [mass, damping, stiffness]
}

/// Noise of the residual of an axis, in its unit.
fn axis_noise(
    p: &Part,
    terms: &[AxisTerm],
    known: &[f64; 4],
    over_gain: bool,
    axis: &AxisLine,
    beta: &[f64],
) -> f64 {
    let [m, c, k] = plant(terms, known, over_gain, beta);
    let kernel = p.kernel.as_ref().expect("an axis has one");
    let up = usize::from(!axis.velocity);
    let position: f64 = (0..kernel.taps[0].len())
        .map(|i| {
            let spring = if axis.velocity {
                0.0
            } else {
                kernel.taps[0][i]
            };
            (m * kernel.taps[1 + up][i] + c * kernel.taps[up][i] + k * spring).powi(2)
        })
        .sum();
    let input: f64 = kernel.taps[0].iter().map(|h| h * h).sum();
    (p.line.x_noise.powi(2) * position + (known[0] * axis.input_noise).powi(2) * input).sqrt()
}

fn part<'a>(line: &'a Line, number: usize, s: &Scales, every: bool) -> Part<'a> {
    let when = When {
        recording: number,
        series_s: 0.0,
        start_s: line.time_s.first().copied().unwrap_or(0.0),
    };
    let l = match &line.measured {
        Measured::Torque(torque) => laid_out_bench(line, torque, s),
        Measured::Axis(axis) => laid_out_axis(line, axis, s, every),
        Measured::Coupon(coupon) => laid_out_coupon(coupon, s),
    };
    let noise = match &line.measured {
        Measured::Axis(axis) if axis.velocity => line.x_noise * line.step_s,
        _ => line.x_noise,
    };
    Part {
        line,
        when,
        weight: vec![1.0 / s.force; l.kept.len()],
        way: Arc::new(played(&l.xi, NOISE_REACHES * noise / s.coordinate)),
        second: Arc::new(l.second.unwrap_or_else(|| vec![0.0; l.xi.len()])),
        time_s: Arc::new(l.time_s),
        xi: Arc::new(l.xi),
        rate: Arc::new(l.rate),
        acceleration: Arc::new(l.acceleration),
        kept: Arc::new(l.kept),
        measured: Arc::new(l.measured),
        means: Arc::new(l.means),
        kernel: l.kernel.map(Arc::new),
        base: Arc::new(l.base),
    }
}

/// Standard deviations that noise hardly ever exceeds.
const NOISE_REACHES: f64 = 3.0;

/// What a kind of recording makes of a part.
#[derive(Default)]
struct LaidOut {
    time_s: Vec<f64>,
    xi: Vec<f64>,
    rate: Vec<f64>,
    /// Of an axis.
    acceleration: Vec<f64>,
    /// 0 everywhere where it is none.
    second: Option<Vec<f64>>,
    kept: Vec<usize>,
    measured: Vec<f64>,
    means: Vec<Mean>,
    kernel: Option<Kernel>,
    base: Base,
}

/// Share of the fastest rate below which the noise of a bench's rate is brought, and share of its samples
/// over which slopes are taken at most.
const RATE_NOISE: f64 = 0.02;
const WIDEST: f64 = 0.05;

/// Slopes of the straight lines through so many neighbours of each sample that `noise` of the coordinate
/// makes little of the fastest.
fn steady_slopes(t: &[f64], x: &[f64], noise: f64) -> Vec<f64> {
    let n = x.len();
    let mut sums = vec![[0.0; 4]];
    for (t, x) in t.iter().map(|own| own - t[0]).zip(x) {
        let [a, b, c, d] = sums[sums.len() - 1];
        sums.push([a + t, b + x, c + t * t, d + t * x]);
    }
    let mut half = 1;
    loop {
        let lines = (0..n).map(|i| {
            let (from, to) = (i.saturating_sub(half), (i + half + 1).min(n));
            let count = (to - from) as f64;
            let [t, x, tt, tx] = [0, 1, 2, 3].map(|k| sums[to][k] - sums[from][k]);
            let width = tt - t * t / count;
            match width > 0.0 {
                true => ((tx - t * x / count) / width, width),
                false => (0.0, f64::INFINITY),
            }
        });
        let (rate, widths): (Vec<f64>, Vec<f64>) = lines.unzip();
        let narrowest = widths.into_iter().fold(f64::INFINITY, f64::min);
        let steady = noise / narrowest.sqrt() <= RATE_NOISE * largest(rate.iter().copied());
        if steady || (4 * half) as f64 > WIDEST * n as f64 {
            return rate;
        }
        half *= 2;
    }
}

/// Slopes between the neighbours of every sample.
fn slopes(t: &[f64], x: &[f64]) -> Vec<f64> {
    (0..x.len())
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(x.len() - 1));
            let d = t[b] - t[a];
            if d > 0.0 { (x[b] - x[a]) / d } else { 0.0 }
        })
        .collect()
}

/// Rows of a bench in which angle and torque are known.
fn laid_out_bench(line: &Line, torque: &[f64], s: &Scales) -> LaidOut {
    let rows: Vec<usize> = (0..line.samples())
        .filter(|&i| line.x[i].is_finite() && torque[i].is_finite())
        .collect();
    let time_s: Vec<f64> = rows.iter().map(|&i| line.time_s[i]).collect();
    let xi: Vec<f64> = rows
        .iter()
        .map(|&i| (line.x[i] - s.rest) / s.coordinate)
        .collect();
    let rate = if line.timed {
        steady_slopes(&time_s, &xi, line.x_noise / s.coordinate)
    } else {
        vec![0.0; xi.len()]
    };
    let kept: Vec<usize> = (0..rows.len()).filter(|&r| line.usable[rows[r]]).collect();
    LaidOut {
        time_s,
        xi,
        rate,
        measured: kept.iter().map(|&r| torque[rows[r]]).collect(),
        kept,
        ..LaidOut::default()
    }
}

/// All samples of an axis; kept are every one, or those that are nearly independent after the low-pass.
fn laid_out_axis(line: &Line, axis: &AxisLine, s: &Scales, every: bool) -> LaidOut {
    let k = Kernel::new(axis.band_hz, line.step_s, line.samples());
    let position = excursion(line, axis);
    let n = line.samples();
    let order = usize::from(!axis.velocity);
    let smooth = |order: usize| -> Vec<f64> {
        let at = |i: usize| k.at(order, &line.x, i.clamp(k.half, n - 1 - k.half));
        (0..n).map(|i| at(i) / s.coordinate).collect()
    };
    let duration = line.step_s * n as f64;
    let edge = ((EDGE_S.min(EDGE_SHARE * duration) / line.step_s) as usize).max(k.half + 1);
    let independent = (1.0 / (2.0 * 1.15 * axis.band_hz * line.step_s)).floor() as usize;
    let every = if every {
        1
    } else {
        independent.max(n / MOST_ROWS).max(1)
    };
    let kept: Vec<usize> = (edge..n.saturating_sub(edge))
        .step_by(every)
        .filter(|&c| (c - k.half..=c + k.half).all(|i| line.usable[i]))
        .collect();
    LaidOut {
        time_s: line.time_s.clone(),
        xi: position
            .iter()
            .map(|x| (x - s.rest) / s.coordinate)
            .collect(),
        rate: smooth(order),
        acceleration: smooth(1 + order),
        base: Base::new(line, axis, &k, &kept, position.iter().map(|x| x - s.rest)),
        kept,
        kernel: Some(k),
        ..LaidOut::default()
    }
}

impl Base {
    /// Of an axis at the places `kept`, where its position lies `from_rest`.
    fn new(
        line: &Line,
        axis: &AxisLine,
        k: &Kernel,
        kept: &[usize],
        from_rest: impl Iterator<Item = f64>,
    ) -> Self {
        let column = |order: usize, values: &[f64]| -> Vec<f64> {
            kept.iter().map(|&c| k.at(order, values, c)).collect()
        };
        let up = usize::from(!axis.velocity);
        let from_rest: Vec<f64> = from_rest.collect();
        let moved = if axis.velocity { &line.x } else { &from_rest };
        Base {
            mass: column(1 + up, moved),
            damping: column(up, moved),
            stiffness: column(0, &from_rest),
            load: if axis.load.is_empty() {
                vec![0.0; kept.len()]
            } else {
                column(0, &axis.load)
            },
            input: match axis.offset_s {
                Constant::Known(o) => column(0, &shifted(line, axis, &axis.input, 1.0, o)),
                Constant::Free => Vec::new(),
            },
        }
    }
}

/// Nodes of a coupon's grid; kept are those that are nearest to some row.
fn laid_out_coupon(coupon: &Coupon, s: &Scales) -> LaidOut {
    let grid = &coupon.grid;
    let xi: Vec<f64> = grid
        .stretch
        .iter()
        .map(|l| (l - s.rest) / s.coordinate)
        .collect();
    // measured stress at a node: the mean of the rows that are nearest to it
    let mut sum = vec![[0.0; 3]; grid.time_s.len()];
    for i in coupon.rows() {
        let t = coupon.time_s[i];
        let (before, share) = grid.place(t);
        let own = &mut sum[before + usize::from(share > 0.5)];
        for (sum, v) in own.iter_mut().zip([1.0, t, coupon.stress_pa[i]]) {
            *sum += v;
        }
    }
    let kept: Vec<usize> = (0..sum.len()).filter(|&k| sum[k][0] > 0.0).collect();
    let mean = |&k: &usize| {
        let [rows, times, _] = sum[k];
        let (before, share) = grid.place(times / rows);
        let (other, share) = if before == k {
            (before + 1, share)
        } else {
            (before, 1.0 - share)
        };
        Mean { other, share, rows }
    };
    LaidOut {
        time_s: grid.time_s.clone(),
        rate: slopes(&grid.time_s, &xi),
        xi,
        second: Some(
            grid.stretch
                .iter()
                .map(|l| second_invariant(coupon, *l))
                .collect(),
        ),
        measured: kept.iter().map(|&k| sum[k][2] / sum[k][0]).collect(),
        means: kept.iter().map(mean).collect(),
        kept,
        ..LaidOut::default()
    }
}

impl SeparableResidual for LineResidual<'_> {
    type Error = Locked;

    fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, Locked> {
        let design = self.design(eta, reference)?;
        let (nonlinear, linear) = (eta.len(), reference.len());
        // B first, then the slopes, then the residual
        let order: Vec<usize> = (nonlinear..nonlinear + linear)
            .chain(0..nonlinear)
            .chain(std::iter::once(nonlinear + linear))
            .collect();
        let gram = design.tr_mul(&design);
        let gram = DMatrix::from_fn(gram.nrows(), gram.ncols(), |i, j| {
            gram[(order[i], order[j])]
        });
        Ok(Normal {
            gram,
            slopes: (0..nonlinear)
                .map(|n| Slope {
                    nonlinear: n,
                    linear: None,
                })
                .collect(),
            reference: reference.to_vec(),
            rows: design.nrows(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_of_the_coordinate_makes_little_of_a_steady_rate() {
        let (step, noise) = (0.01, 2e-3);
        let t: Vec<f64> = (0..4000).map(|i| f64::from(i) * step).collect();
        let mut generator = ChaCha12Rng::seed_from_u64(1);
        let x: Vec<f64> = (t.iter())
            .map(|t| {
                let z: f64 = StandardNormal.sample(&mut generator);
                (0.2 * t).sin() + noise * z
            })
            .collect();
        let wrong = |rate: &[f64]| {
            let squares = rate
                .iter()
                .zip(&t)
                .map(|(r, t)| (r - 0.2 * (0.2 * t).cos()).powi(2));
            (squares.sum::<f64>() / t.len() as f64).sqrt() / 0.2
        };
        // neighbours differ by as much as the noise
        assert!(wrong(&slopes(&t, &x)) > 0.5);
        assert!(wrong(&steady_slopes(&t, &x, noise)) < 1.5 * RATE_NOISE);
        assert_eq!(steady_slopes(&t, &t, 0.0).len(), t.len());
        assert!(
            steady_slopes(&t, &t, 0.0)
                .iter()
                .all(|r| (r - 1.0).abs() < 1e-9)
        );
    }

    #[test]
    fn kernels_differentiate_what_lies_in_their_band() {
        let step = 0.01;
        let k = Kernel::new(12.0, step, 4000);
        let f = 8.0;
        let t = |i: usize| i as f64 * step;
        let x: Vec<f64> = (0..800)
            .map(|i| 3.0 + 2.0 * t(i) + (TAU * f * t(i)).sin())
            .collect();
        for c in [350, 373, 401] {
            let (s, co) = (TAU * f * t(c)).sin_cos();
            let w = TAU * f;
            assert!((k.at(0, &x, c) - (3.0 + 2.0 * t(c) + s)).abs() < 5e-3);
            assert!((k.at(1, &x, c) - (2.0 + w * co)).abs() < 5e-3 * w);
            assert!((k.at(2, &x, c) + w * w * s).abs() < 1e-2 * w * w);
        }
        // a straight line goes through exactly
        let line: Vec<f64> = (0..800).map(|i| 1.0 - 4.0 * t(i)).collect();
        assert!((k.at(0, &line, 400) - line[400]).abs() < 1e-9);
        assert!((k.at(1, &line, 400) + 4.0).abs() < 1e-9);
        assert!(k.at(2, &line, 400).abs() < 1e-6);
    }
}
