//! A film coupon pulled in one direction: springs that lock and branches that flow, in steps of an integrator
//! of their own.
//!
//! ```text
//! A = (lambda/xi)^2,  s = (A - A^(-1/2)) f(I),  I = A + 2 A^(-1/2) - 3
//! d ln xi/dt = s/(3 T),   P = sum mu s/lambda
//! f = 1/(1 - I/J) (Gent), or its first three terms (Yeoh), where these differ by less than the noise
//! ```

use super::super::dice::Dice;
use super::axis::{Axis, between, motions};
use super::mechanism::{Draw, Mechanism, Now, Setting, Spring};
use super::noise::Noise;
use super::path::Path;
use super::unknown;
use super::visible::Balance;
use super::write::Columns;
use super::{LineRecording, Made, Text};

pub type Maker = fn(&mut Draw) -> Mechanism;

/// Causes of the catalogue.
pub const EFFECTS: &[(&str, Maker)] = &[
    ("slow_creep", creep),
    ("mullins_softening", softening),
    ("x_permanent_set", permanent_set),
    ("x_nonlinear_relaxation", nonlinear_relaxation),
    ("x_second_invariant", second_invariant),
    ("x_slack", slack),
    ("x_grip_slip", grip_slip),
    ("temperature_drift", drift),
    ("x_zero_drift", super::forms::zero_drift),
];

/// Causes that are in no catalogue.
pub const UNKNOWN: &[(&str, Maker)] = &[
    ("x_pump", unknown::pump),
    ("x_wander", unknown::wander),
    ("x_cell_leaps", unknown::cell_leaps),
    ("x_frozen_cell", unknown::frozen_cell),
    ("x_tear", tear),
    ("x_crystals", crystals),
    ("x_temperature_swing", temperature_swing),
    ("x_guide_friction", guide_friction),
];

/// Motions of a tensile machine.
const MOTIONS: [&str; 10] = [
    "slow_triangle",
    "triangles",
    "sine",
    "sines",
    "steps",
    "staircase",
    "reaching",
    "growing",
    "loops",
    "pulses",
];

/// Creep by a power of the time: branches that are linear in the strain.
fn creep(draw: &mut Draw) -> Mechanism {
    super::forms::creep(draw)
}

/// Softening below the largest invariant so far, by a hyperbolic tangent, in the equilibrium spring.
fn softening(draw: &mut Draw) -> Mechanism {
    let loss = draw.size(0.015, 0.4);
    let scale = draw.dice.log_range(0.15, 0.7) * invariant(1.0 + draw.at.stroke);
    draw.cause("mullins_softening")
        .form("loss", loss)
        .form("scale", scale)
        .with(vec![0.0])
        .factor(move |now, most| {
            let i = invariant(1.0 + now.x);
            [1.0 - loss * ((most[0].max(i) - i) / scale).tanh(), 1.0]
        })
        .after(|now, most| most[0] = most[0].max(invariant(1.0 + now.x)))
}

/// A set that grows while the film is pulled further than ever, and stays.
fn permanent_set(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.004, 0.12);
    let power = draw.dice.range(0.8, 1.3);
    let stroke = draw.at.stroke;
    let slow = draw.dice.range(0.01, 0.05) / draw.at.base_hz;
    draw.cause("x_permanent_set")
        .form("share", share)
        .form("power", power)
        .with(vec![0.0])
        .push(move |now, set, rate| {
            let due = share * stroke * (now.x.max(0.0) / stroke).powf(power);
            rate[0] = (due - set[0]).max(0.0) / slow;
            0.0
        })
        .seen(|now, set| 1.0 + now.x - set[0])
}

/// Branches that are stiffer, or softer, the further the film is stretched: an exponential of the invariant.
fn nonlinear_relaxation(draw: &mut Draw) -> Mechanism {
    let size = draw.dice.sign() * draw.size(0.05, 1.0);
    let top = invariant(1.0 + draw.at.stroke);
    draw.cause("x_nonlinear_relaxation")
        .form("exponent", size)
        .factor(move |now, _| [1.0, (size * invariant(1.0 + now.x) / top).exp()])
}

/// A logarithm of the second invariant (Gent and Thomas 1958).
fn second_invariant(draw: &mut Draw) -> Mechanism {
    let modulus = draw.share(0.01, 0.4);
    draw.cause("x_second_invariant")
        .form("modulus_Pa", modulus)
        .push(move |now, _, _| {
            let l = 1.0 + now.x;
            3.0 * modulus * (2.0 - 2.0 / l.powi(3)) / (2.0 * l + 1.0 / (l * l))
        })
}

/// A free length that is not the stated one: slack hangs and pulls at nothing, a pre-stretched sample pulls
/// from the start.
fn slack(draw: &mut Draw) -> Mechanism {
    let more = draw.dice.sign() * draw.size(0.001, 0.03);
    draw.cause("x_slack")
        .form("free_length_more", more)
        .seen(move |now, _| {
            let l = (1.0 + now.x) / (1.0 + more);
            if more > 0.0 { l.max(1.0) } else { l }
        })
}

/// Film that is drawn out of its clamps as it is pulled: the strain is less than it reads.
fn grip_slip(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.006, 0.2);
    let stroke = draw.at.stroke;
    draw.cause("x_grip_slip")
        .form("share", share)
        .seen(move |now, _| 1.0 + now.x / (1.0 + share * (0.8 + 0.4 * now.x / stroke)))
}

/// A film that warms up.
fn drift(draw: &mut Draw) -> Mechanism {
    let change = draw.dice.sign() * draw.size(0.012, 0.3);
    let tau = draw.at.duration_s * draw.dice.range(0.5, 2.0);
    let whole = 1.0 - (-draw.at.duration_s / tau).exp();
    draw.cause("temperature_drift")
        .form("change", change)
        .form("time_s", tau)
        .factor(move |now, _| [1.0 + change * (1.0 - (-now.t / tau).exp()) / whole; 2])
}

/// A cut that runs on at a few moments, each time by a share of the section.
fn tear(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.02, 0.25);
    let count = 1 + draw.dice.below(3);
    let length = draw.at.duration_s;
    let moments: Vec<f64> = (0..count)
        .map(|_| length * draw.dice.range(0.15, 0.85))
        .collect();
    draw.cause("x_tear")
        .form("share", share)
        .form("count", count as f64)
        .factor(move |now, _| {
            let gone = moments.iter().filter(|m| **m < now.t).count();
            [(1.0 - share).powi(gone as i32); 2]
        })
}

/// Crystals that grow above one stretch and melt below another: more stress on the way back than on the way
/// out, at the top only.
fn crystals(draw: &mut Draw) -> Mechanism {
    let stress = draw.share(0.03, 0.4);
    let stroke = draw.at.stroke;
    let begin = stroke * draw.dice.range(0.55, 0.75);
    let melt = begin * draw.dice.range(0.5, 0.75);
    let slow = 0.02 / draw.at.base_hz;
    draw.cause("x_crystals")
        .form("stress_Pa", stress)
        .form("begin", begin)
        .form("melt", melt)
        .with(vec![0.0, 0.0])
        .push(move |now, c, rate| {
            rate[1] = (c[0] - c[1]) / slow;
            stress * c[1] * ((now.x - melt) / (stroke - melt)).max(0.0)
        })
        .after(move |now, c| {
            if now.x > begin {
                c[0] = 1.0;
            }
            if now.x < melt {
                c[0] = 0.0;
            }
        })
}

/// Air conditioning: moduli that swing.
fn temperature_swing(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.015, 0.2);
    let turns = draw.dice.range(3.0, 9.0);
    let (length, phase) = (draw.at.duration_s, draw.dice.range(0.0, 6.0));
    draw.cause("x_temperature_swing")
        .form("share", share)
        .form("turns", turns)
        .factor(move |now, _| {
            let p = std::f64::consts::TAU * turns * now.t / length + phase;
            [1.0 + share * p.sin(); 2]
        })
}

/// The guide of the crosshead rubs, and the cell feels it.
fn guide_friction(draw: &mut Draw) -> Mechanism {
    let mut out = super::forms::friction(draw);
    out.detail.effect = "x_guide_friction".into();
    out
}

/// First invariant less 3 of a film pulled in one direction.
fn invariant(stretch: f64) -> f64 {
    stretch * stretch + 2.0 / stretch - 3.0
}

/// A film.
#[derive(Debug, Clone)]
struct Film {
    mu_pa: Vec<f64>,
    time_s: Vec<f64>,
    locking: f64,
    /// Three terms of the series instead of Gent's law.
    yeoh: bool,
}

impl Film {
    /// Cauchy stress over the modulus, for an elastic stretch.
    fn stress(&self, stretch: f64) -> f64 {
        let i = invariant(stretch) / self.locking;
        let f = if self.yeoh {
            1.0 + i + i * i
        } else {
            1.0 / (1.0 - i).max(1e-3)
        };
        (stretch * stretch - 1.0 / stretch) * f
    }
}

/// Nominal stress along a path of the strain, at every integration step; by spring, and what a cause adds.
fn pulled(
    film: &Film,
    a: &Axis,
    p: &Path,
    mechanism: Option<&Mechanism>,
    stride: usize,
) -> Vec<f64> {
    let h = 2.0 * stride as f64 * p.step_s;
    let n = film.time_s.len();
    let states = mechanism.map_or(Vec::new(), |m| m.states.clone());
    let mut y = vec![0.0; n];
    y.extend(&states);
    let rates = |i: usize, y: &[f64], dy: &mut [f64]| -> f64 {
        let now = Now {
            t: i as f64 * p.step_s,
            x: a.stroke * p.x[i],
            v: a.stroke * p.v[i],
        };
        let own = &y[n..];
        let (flow, rest) = dy.split_at_mut(n);
        let push = mechanism.and_then(|m| m.push.as_ref());
        let mut stress = push.map_or(0.0, |f| f(&now, own, rest));
        let seen = mechanism.and_then(|m| m.seen.as_ref());
        let l = seen.map_or(1.0 + now.x, |f| f(&now, own));
        let factor = mechanism.and_then(|m| m.factor.as_ref());
        let factor = factor.map_or([1.0; 2], |f| f(&now, own));
        stress += factor[0] * film.mu_pa[0] * film.stress(l) / l;
        for (j, flow) in flow.iter_mut().enumerate() {
            let s = film.stress(l / y[j].exp());
            *flow = s / (3.0 * film.time_s[j]);
            stress += factor[1] * film.mu_pa[j + 1] * s / l;
        }
        stress
    };
    let width = y.len();
    let mut k = [(); 4].map(|()| vec![0.0; width]);
    let mut at = vec![0.0; width];
    let steps = (p.x.len() - 1) / (2 * stride);
    let mut out = Vec::with_capacity(steps);
    for s in 0..steps {
        let i = 2 * stride * s;
        out.push(rates(i, &y, &mut k[0]));
        for (stage, (half, share)) in [(stride, 0.5), (stride, 0.5), (2 * stride, 1.0)]
            .into_iter()
            .enumerate()
        {
            for j in 0..width {
                at[j] = y[j] + share * h * k[stage][j];
            }
            let (_, later) = k.split_at_mut(stage + 1);
            rates(i + half, &at, &mut later[0]);
        }
        for j in 0..width {
            y[j] += h / 6.0 * (k[0][j] + 2.0 * (k[1][j] + k[2][j]) + k[3][j]);
        }
        if let Some(after) = mechanism.and_then(|m| m.after.as_ref()) {
            let i = i + 2 * stride;
            let now = Now {
                t: i as f64 * p.step_s,
                x: a.stroke * p.x[i],
                v: a.stroke * p.v[i],
            };
            after(&now, &mut y[n..]);
        }
    }
    out
}

/// Draws a film, and the course on which it is pulled.
fn film_on(dice: &mut Dice) -> (Film, Axis) {
    let stroke = dice.log_range(0.25, 2.2);
    let base_hz = dice.log_range(0.01, 0.15);
    let duration_s = dice.range(4.0, 9.0) / base_hz;
    let rows = dice.range(500.0, 1800.0);
    let equilibrium = dice.log_range(2e4, 4e5);
    let branches = 1 + dice.below(3);
    let (fastest, slowest) = (0.04 / base_hz, 0.25 * duration_s);
    let time_s: Vec<f64> = (0..branches)
        .map(|i| {
            let share = (i as f64 + dice.range(0.25, 0.75)) / branches as f64;
            fastest * (slowest / fastest).powf(share)
        })
        .collect();
    let mut mu_pa = vec![equilibrium];
    mu_pa.extend((0..branches).map(|_| equilibrium * dice.log_range(0.1, 0.8)));
    let reached = invariant(1.0 + stroke);
    let locking = reached * dice.log_range(2.5, 25.0);
    let film = Film {
        mu_pa,
        time_s,
        locking,
        // what Yeoh's series leaves out of Gent's is then below a ten-thousandth
        yeoh: reached / locking < 0.045,
    };
    let course = Axis {
        mass: 0.0,
        damping: 0.0,
        spring: Spring::Linear(0.0),
        bias: 0.0,
        gain: 1.0,
        led: true,
        servo: [0.0; 2],
        stroke,
        base_hz,
        duration_s,
        step_s: duration_s / rows,
        zero: 0.0,
    };
    (film, course)
}

/// Makes the recordings of a case on coupons of one film.
pub fn make(seed: u64, strength: f64, cause: Option<Maker>, stride: usize) -> Result<Made, String> {
    let mut dice = Dice::new(seed, 1);
    let (film, a) = film_on(&mut dice);
    let longest = film.time_s[0] / 12.0;
    let sub = (a.step_s / longest.min(2e-3 / a.base_hz)).ceil();
    let fine = 0.5 * a.step_s / sub;
    let paths = motions(seed, &mut dice, &MOTIONS, &a, true, fine);
    let plain: Vec<Vec<f64>> = paths
        .iter()
        .map(|p| pulled(&film, &a, &p.1, None, stride))
        .collect();
    let top = plain.iter().flatten().fold(0.0_f64, |m, s| m.max(s.abs()));
    let speeds = paths.iter().flat_map(|p| &p.1.v);
    let mut draw = Draw {
        dice: Dice::new(seed, 10),
        strength,
        at: Setting {
            spring: a.spring,
            mass: 0.0,
            bias: 0.0,
            stroke: a.stroke,
            ends: [0.0, a.stroke],
            speed: a.stroke * speeds.fold(0.0, |m, v| f64::max(m, v.abs())),
            force: top,
            duration_s: a.duration_s,
            base_hz: a.base_hz,
            step_s: a.step_s,
        },
    };
    let mechanism = cause.map(|c| c(&mut draw));
    let mut channel = Dice::new(seed, 2);
    let sd = top * channel.log_range(1.5e-3, 1e-2);
    let noise_stress = Noise::draw(&mut channel, sd);
    let noise_stretch = Noise::draw(&mut channel, 2e-5 * a.stroke);
    let cell = mechanism.as_ref().and_then(|m| m.cell.as_ref());
    let (mut recordings, mut balances) = (Vec::new(), Vec::new());
    for (number, (kind, p, _)) in paths.iter().enumerate() {
        let stress = pulled(&film, &a, p, mechanism.as_ref(), stride);
        let h = 2.0 * stride as f64 * p.step_s;
        let count = (h * (stress.len() - 1) as f64 / a.step_s) as usize;
        let time: Vec<f64> = (0..count).map(|i| i as f64 * a.step_s).collect();
        let at =
            |values: &[f64]| -> Vec<f64> { time.iter().map(|t| between(values, h, *t)).collect() };
        let course = p.x.iter().step_by(2 * stride);
        let course: Vec<f64> = course.map(|x| 1.0 + a.stroke * x).collect();
        let (x, mut u) = (at(&course), at(&stress));
        let mut own = Dice::new(seed, 100 + number as u64);
        let read_x = noise_stretch.read(&x, &mut own);
        let mut read_u = noise_stress.read(&u, &mut own);
        let noise = read_u.iter().zip(&u).map(|(r, u)| r - u).collect();
        if let Some(fault) = cell {
            fault(&mut u);
            fault(&mut read_u);
        }
        balances.push(Balance {
            columns: tangents(&film, &a, p, stride, &at),
            target: u,
            noise,
            edge: 0,
        });
        recordings.push(LineRecording {
            kind,
            columns: Columns::Coupon {
                time_s: time,
                stretch: read_x,
                stress_pa: read_u,
            },
        });
    }
    Ok(Made {
        text: Text::Coupon,
        recordings,
        balances,
        detail: mechanism.map(|m| m.detail),
    })
}

/// Columns of a refit: each spring by itself, three more branches, and what a change of each time and of the
/// locking constant makes.
fn tangents(
    film: &Film,
    a: &Axis,
    p: &Path,
    stride: usize,
    at: &dyn Fn(&[f64]) -> Vec<f64>,
) -> Vec<Vec<f64>> {
    let alone = |time: Option<f64>, locking: f64| -> Vec<f64> {
        let one = Film {
            mu_pa: match time {
                None => vec![1.0],
                Some(_) => vec![0.0, 1.0],
            },
            time_s: time.into_iter().collect(),
            locking,
            yeoh: film.yeoh,
        };
        at(&pulled(&one, a, p, None, stride))
    };
    let j = film.locking;
    let mut out = vec![alone(None, j)];
    let less = |x: &[f64], y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(a, b)| a - b).collect() };
    let mut by_locking = less(&alone(None, 1.02 * j), &out[0]);
    for t in &film.time_s {
        let (own, later) = (alone(Some(*t), j), alone(Some(1.05 * t), j));
        out.push(less(&later, &own));
        out.push(own);
    }
    by_locking.iter_mut().for_each(|v| *v *= film.mu_pa[0]);
    out.push(by_locking);
    for share in [0.01, 0.07, 0.5] {
        out.push(alone(Some(share * a.duration_s), j));
    }
    out
}
