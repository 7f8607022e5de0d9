//! The catalogue's causes on a moving axis, each in a form of its own: what stands in `effects::line` is not
//! used, and where a name there
//! stands for one formula, another formula of the literature stands for it here.

use std::f64::consts::PI;

use super::mechanism::{Draw, Mechanism};

/// Bristles that bend by up to `reach` and let go over a power of how far they are bent (Dahl 1968 with an
/// exponent): the rate of z.
fn bristle(v: f64, z: f64, reach: f64, exponent: f64) -> f64 {
    let s = 1.0 - v.signum() * z / reach;
    v * s.signum() * s.abs().powf(exponent)
}

/// Dry friction: Dahl's law with another exponent, or slip elements of several reaches in parallel (Iwan
/// 1966).
pub fn friction(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.006, 0.25);
    let reach = draw.at.stroke * draw.dice.log_range(0.004, 0.08);
    let out = draw
        .cause("joint_friction")
        .form("force_N", force)
        .form("reach_m", reach);
    if draw.dice.chance(0.5) {
        let exponent = draw.dice.range(1.5, 2.2);
        return out
            .form("exponent", exponent)
            .with(vec![0.0])
            .push(move |now, z, rate| {
                rate[0] = bristle(now.v, z[0], reach, exponent);
                force * z[0] / reach
            });
    }
    let reaches: [f64; 6] = std::array::from_fn(|i| reach * 0.35 * 1.6f64.powi(i as i32));
    out.form("elements", 6.0)
        .with(vec![0.0; 6])
        .push(move |now, z, rate| {
            rate.fill(now.v);
            let of = |(z, r): (&f64, &f64)| (z / r).clamp(-1.0, 1.0);
            force / 6.0 * z.iter().zip(&reaches).map(of).sum::<f64>()
        })
        .after(move |_, z| {
            for (z, r) in z.iter_mut().zip(&reaches) {
                *z = z.clamp(-r, *r);
            }
        })
}

/// Friction in a guide that the spring's pull presses together: mu |N|, bristles.
pub fn load_friction(draw: &mut Draw) -> Mechanism {
    let mu = draw.size(0.012, 0.4);
    let reach = draw.at.stroke * draw.dice.log_range(0.005, 0.08);
    let exponent = draw.dice.range(1.4, 2.0);
    let spring = draw.at.spring;
    draw.cause("x_load_friction")
        .form("coefficient", mu)
        .form("reach_m", reach)
        .with(vec![0.0])
        .push(move |now, z, rate| {
            rate[0] = bristle(now.v, z[0], reach, exponent);
            mu * spring.force(now.x).abs() * z[0] / reach
        })
}

/// A lubricated slide: bristles, and a film of oil that takes their force away with the speed as 1/(1 +
/// (v/vs)^p) (Hess and Soom 1990).
pub fn stribeck(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.01, 0.3);
    let slow = draw.at.speed * draw.dice.log_range(0.08, 0.4);
    let p = draw.dice.range(1.6, 2.6);
    let reach = draw.at.stroke * draw.dice.log_range(0.003, 0.01);
    draw.cause("x_stribeck")
        .form("force_N", force)
        .form("speed_m_s", slow)
        .form("exponent", p)
        .with(vec![0.0])
        .push(move |now, z, rate| {
            let g = 1.0 / (1.0 + (now.v.abs() / slow).powf(p));
            rate[0] = now.v - now.v.abs() * z[0] / reach;
            force * g * z[0] / reach
        })
}

/// Dry friction without a hold at rest: an arc tangent, or v over the root of v^2 + v0^2.
pub fn rate_friction(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.006, 0.25);
    let v0 = draw.at.speed * draw.dice.log_range(0.01, 0.15);
    let arc = draw.dice.chance(0.5);
    draw.cause("x_rate_friction")
        .form("force_N", force)
        .form("speed_m_s", v0)
        .push(move |now, _, _| {
            let s = now.v / v0;
            force
                * if arc {
                    (0.5 * PI * s).atan() * 2.0 / PI
                } else {
                    s / (1.0 + s * s).sqrt()
                }
        })
}

/// Drag with a power near two: a drag coefficient that changes with the speed.
pub fn quadratic_damping(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.01, 0.4);
    let power = 2.0 + draw.dice.sign() * draw.dice.range(0.08, 0.2);
    let top = draw.at.speed;
    draw.cause("x_quadratic_damping")
        .form("force_at_top_speed_N", force)
        .form("power", power)
        .push(move |now, _, _| force * now.v.signum() * (now.v.abs() / top).powf(power))
}

/// A damper with a valve that opens over a small speed.
pub fn direction_damping(draw: &mut Draw) -> Mechanism {
    let force = draw.dice.sign() * draw.share(0.01, 0.4);
    let top = draw.at.speed;
    let valve = top * draw.dice.range(0.02, 0.08);
    draw.cause("x_direction_damping")
        .form("force_at_top_speed_N", force)
        .form("valve_m_s", valve)
        .push(move |now, _, _| force * now.v / top * 0.5 * (1.0 + (now.v / valve).tanh()))
}

/// Oil that thins or thickens: a resistance with a power near one.
pub fn damping(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.01, 0.4);
    let power = 1.0 + draw.dice.sign() * draw.dice.range(0.03, 0.12);
    let top = draw.at.speed;
    draw.cause("joint_damping")
        .form("force_at_top_speed_N", force)
        .form("power", power)
        .push(move |now, _, _| force * now.v.signum() * (now.v.abs() / top).powf(power))
}

/// A load on a long lever that is out of square: its inertia changes with the stroke by a line and a bend.
pub fn stroke_inertia(draw: &mut Draw) -> Mechanism {
    let share = draw.dice.sign() * draw.size(0.04, 0.6);
    let bend = draw.dice.range(-0.2, 0.2);
    let (mass, stroke) = (draw.at.mass, draw.at.stroke);
    let tau = 0.004 / draw.at.base_hz.max(1.0);
    draw.cause("x_stroke_inertia")
        .form("share_of_mass", share)
        .form("bend", bend)
        // the acceleration by a quick follower of the speed
        .with(vec![0.0])
        .push(move |now, s, rate| {
            let (p, a) = (now.x / stroke, (now.v - s[0]) / tau);
            rate[0] = a;
            let more = share * mass;
            more * (p * (1.0 + bend * p) * a
                + 0.5 * (1.0 + 2.0 * bend * p) / stroke * now.v * now.v)
        })
}

/// A spring that is no straight line: a hyperbolic sine, one exponential, or an arc tangent, less its
/// straight part.
pub fn nonlinear_stiffness(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.008, 0.4);
    let (x0, bend) = (draw.at.stroke, draw.dice.range(0.7, 2.0));
    let law = draw.dice.below(3);
    draw.cause("x_nonlinear_stiffness")
        .form("force_at_full_stroke_N", force)
        .form("bend", bend)
        .form("law", law as f64)
        .push(move |now, _, _| {
            let s = bend * now.x / x0;
            force
                * match law {
                    0 => (s.sinh() - s) / (bend.sinh() - bend),
                    1 => (s.exp() - 1.0 - s) / (bend.exp() - 1.0 - bend),
                    _ => (s.atan() - s) / (bend - bend.atan()),
                }
        })
}

/// A buffer: Hertz's power of 3/2 with the damping of Hunt and Crossley 1975.
pub fn end_stop(draw: &mut Draw) -> Mechanism {
    let force = draw.share(0.03, 1.2);
    let side = if draw.at.ends[0] < -0.6 * draw.at.stroke && draw.dice.chance(0.5) {
        -1.0
    } else {
        1.0
    };
    let reach = side
        * if side > 0.0 {
            draw.at.ends[1]
        } else {
            draw.at.ends[0]
        };
    let share = draw.dice.range(0.6, 0.92);
    let (begin, depth) = (share * reach, (1.0 - share) * reach);
    let loss = draw.dice.range(0.0, 0.3) / draw.at.speed;
    draw.cause("end_stop")
        .form("begins_m", side * begin)
        .form("force_at_full_stroke_N", force)
        .form("loss_s_m", loss)
        .push(move |now, _, _| {
            let d = side * now.x - begin;
            if d <= 0.0 {
                return 0.0;
            }
            let f = force * (d / depth).powf(1.5) * (1.0 + loss * side * now.v).max(0.0);
            side * f
        })
}

/// Play before the spring, worn: five fingers in parallel, each with a gap of its own and held where it is
/// within it (Prandtl and
/// Ishlinskii).
pub fn backlash(draw: &mut Draw) -> Mechanism {
    let gap = draw.at.stroke * draw.size(0.006, 0.2);
    let wear = draw.dice.range(0.1, 0.4);
    let gaps: [f64; 5] = std::array::from_fn(|i| gap * (1.0 + wear * (0.5 * i as f64 - 1.0)));
    let spring = draw.at.spring;
    draw.cause("x_backlash")
        .form("half_gap_m", gap)
        .form("wear", wear)
        .with(vec![0.0; 5])
        .push(move |now, y, _| {
            let held = |(y, g): (&f64, &f64)| spring.force(y.clamp(now.x - g, now.x + g));
            y.iter().zip(&gaps).map(held).sum::<f64>() / 5.0 - spring.force(now.x)
        })
        .after(move |now, y| {
            for (y, g) in y.iter_mut().zip(&gaps) {
                *y = y.clamp(now.x - g, now.x + g);
            }
        })
}

/// Creep by a power of the time: five branches a third of a decade apart and their weights as a power law has
/// them.
pub fn creep(draw: &mut Draw) -> Mechanism {
    let stiffness = draw.share(0.02, 0.5) / draw.at.stroke;
    let power = draw.dice.range(0.1, 0.4);
    let middle = draw.at.duration_s * draw.dice.log_range(0.03, 0.5);
    let times: [f64; 5] = std::array::from_fn(|i| middle * 10f64.powf((i as f64 - 2.0) / 3.0));
    let weights = times.map(|t| (t / middle).powf(-power));
    let sum: f64 = weights.iter().sum();
    draw.cause("slow_creep")
        .form("stiffness_N_m", stiffness)
        .form("power", power)
        .form("middle_time_s", middle)
        .with(vec![0.0; 5])
        .push(move |now, q, rate| {
            let mut force = 0.0;
            for i in 0..5 {
                rate[i] = (now.x - q[i]) / times[i];
                force += stiffness * weights[i] / sum * (now.x - q[i]);
            }
            force
        })
}

/// Softening by the stored energy: below the largest energy so far the spring has lost a share of its force
/// (a hyperbolic tangent).
pub fn softening(draw: &mut Draw) -> Mechanism {
    let loss = draw.size(0.012, 0.35);
    let scale = draw.dice.log_range(0.1, 0.6);
    let (spring, stroke) = (draw.at.spring, draw.at.stroke);
    draw.cause("mullins_softening")
        .form("loss", loss)
        .form("scale", scale)
        .with(vec![0.0])
        .push(move |now, most, _| {
            let energy = (now.x / stroke).powi(2);
            let behind = (most[0].max(energy) - energy) / scale;
            -loss * behind.tanh() * spring.force(now.x)
        })
        .after(move |now, most| most[0] = most[0].max((now.x / stroke).powi(2)))
}

/// A set that grows while the spring is pulled beyond what it had seen, and stays.
pub fn permanent_set(draw: &mut Draw) -> Mechanism {
    let share = draw.size(0.008, 0.2);
    let power = draw.dice.range(0.8, 1.3);
    let (spring, stroke) = (draw.at.spring, draw.at.stroke);
    let slow = draw.dice.range(0.01, 0.05) / draw.at.base_hz;
    draw.cause("x_permanent_set")
        .form("share", share)
        .form("power", power)
        .with(vec![0.0])
        .push(move |now, set, rate| {
            let due = share * stroke * (now.x.max(0.0) / stroke).powf(power);
            rate[0] = (due - set[0]).max(0.0) / slow;
            spring.force(now.x - set[0]) - spring.force(now.x)
        })
}

/// A ceiling with a soft knee: u over the n-th root of 1 + |u/c|^n.
pub fn saturation(draw: &mut Draw) -> Mechanism {
    let n = draw.dice.range(8.0, 20.0);
    let ceiling = draw.at.force * (1.0 - draw.size(0.015, 0.45));
    draw.cause("amplifier_saturation")
        .form("ceiling_N", ceiling)
        .form("knee", n)
        .drive(move |u, _, _, _| u / (1.0 + (u / ceiling).abs().powf(n)).powf(1.0 / n))
}

/// A dead band: nothing arrives below a threshold, by a steep power; or the threshold is taken off what
/// arrives.
pub fn deadband(draw: &mut Draw) -> Mechanism {
    let threshold = draw.share(0.015, 0.25);
    let steep = draw.dice.range(10.0, 20.0);
    let taken = draw.dice.chance(0.3);
    draw.cause("amplifier_deadband")
        .form("threshold_N", threshold)
        .form("taken_off", f64::from(u8::from(taken)))
        .drive(move |u, _, _, _| {
            if taken {
                return u - u.clamp(-threshold, threshold);
            }
            let p = (u.abs() / threshold).min(1e6).powf(steep);
            u * p / (1.0 + p)
        })
}

/// A drive that is no straight line: a hyperbolic sine, or its inverse.
pub fn drive_power(draw: &mut Draw) -> Mechanism {
    let bend = draw.size(0.2, 2.5);
    let expansive = draw.dice.chance(0.5);
    let top = draw.at.force;
    draw.cause("x_drive_power")
        .form("bend", bend)
        .form("expansive", f64::from(u8::from(expansive)))
        .drive(move |u, _, _, _| {
            let s = bend * u / top;
            top * if expansive {
                s.sinh() / bend.sinh()
            } else {
                s.asinh() / bend.asinh()
            }
        })
}

/// A lag: a resistance and a capacitance that is spread along a line, as two stages of which the second is
/// short.
pub fn drive_lag(draw: &mut Draw) -> Mechanism {
    let tau = draw.size(0.003, 0.1) / draw.at.base_hz.max(0.3);
    let second = tau * draw.dice.range(0.05, 0.15);
    draw.cause("x_drive_lag")
        .form("time_constant_s", tau)
        .form("second_s", second)
        .with(vec![draw.at.bias; 2])
        .drive(move |u, _, y, rate| {
            rate[0] = (u - y[0]) / tau;
            rate[1] = (y[0] - y[1]) / second;
            y[1]
        })
}

/// A drive through a spring of its own, with a short stage before it.
pub fn drive_second_order(draw: &mut Draw) -> Mechanism {
    let time = draw.size(0.006, 0.06) / draw.at.base_hz.max(0.3);
    let damping = draw.dice.range(0.35, 0.8);
    let first = time * draw.dice.range(0.1, 0.2);
    let bias = draw.at.bias;
    draw.cause("x_drive_second_order")
        .form("time_constant_s", time)
        .form("damping_ratio", damping)
        .form("first_stage_s", first)
        .with(vec![bias, bias, 0.0])
        .drive(move |u, _, y, rate| {
            rate[0] = (u - y[0]) / first;
            rate[1] = y[2];
            rate[2] = (y[0] - y[1] - 2.0 * damping * time * y[2]) / (time * time);
            y[1]
        })
}

/// A magnet or a stack of electrodes that pulls by the inverse square of its gap.
pub fn drive_stroke(draw: &mut Draw) -> Mechanism {
    let share = draw.dice.sign() * draw.size(0.006, 0.3);
    let stroke = draw.at.stroke;
    draw.cause("x_drive_stroke")
        .form("stroke_over_gap", share)
        .drive(move |u, now, _, _| u / (1.0 + share * now.x / stroke).max(0.2).powi(2))
}

/// Clocks that differ.
pub fn time_offset(draw: &mut Draw) -> Mechanism {
    let late = draw.dice.sign() * draw.size(0.002, 0.05) / draw.at.base_hz.max(0.3);
    let mut out = draw.cause("time_offset").form("late_s", late);
    out.late_s = late;
    out
}

/// A spring that warms up: its stiffness goes to another value exponentially.
pub fn drift(draw: &mut Draw) -> Mechanism {
    let change = draw.dice.sign() * draw.size(0.012, 0.3);
    let tau = draw.at.duration_s * draw.dice.range(0.5, 2.0);
    let whole = 1.0 - (-draw.at.duration_s / tau).exp();
    let spring = draw.at.spring;
    draw.cause("temperature_drift")
        .form("change", change)
        .form("time_s", tau)
        .push(move |now, _, _| spring.force(now.x) * change * (1.0 - (-now.t / tau).exp()) / whole)
}

/// A zero that goes to another value exponentially.
pub fn zero_drift(draw: &mut Draw) -> Mechanism {
    let change = draw.dice.sign() * draw.share(0.01, 0.25);
    let tau = draw.at.duration_s * draw.dice.range(0.5, 2.0);
    let whole = 1.0 - (-draw.at.duration_s / tau).exp();
    draw.cause("x_zero_drift")
        .form("change_N", change)
        .form("time_s", tau)
        .push(move |now, _, _| change * (1.0 - (-now.t / tau).exp()) / whole)
}
