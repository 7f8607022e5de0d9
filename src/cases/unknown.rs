//! Effects that stand in no catalogue. Each is possible in a laboratory, and none is another form of a
//! catalogued one.

use serde_json::json;

use super::effect::{Draw, Effect, Hook, Order, film_torque, mask, soft_positive};
use crate::kinematics::dot;

/// A cable loom follows the bicep with play: y' = (k dead(theta_b - y) - k_s (y - y_0))/d, torque -k
/// dead(theta_b - y).
pub fn backlash(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.4);
    let wall = draw.size(1.2e-3, 6e-2);
    let play = draw.dice.range(0.03, 0.12);
    let own = wall * draw.dice.range(0.05, 0.2);
    let drag = wall * draw.dice.range(0.3, 1.5);
    let rest = draw.setting.rest.map(|p| p.theta_b_rad);
    let mut out = draw.effect("x_backlash", on);
    out.form("wall_N_m_rad", wall);
    out.form("play_rad", play);
    out.form("own_stiffness_N_m_rad", own);
    out.form("drag_N_m_s_rad", drag);
    out.note("direction", "after reversals, within the play");
    let m = mask(on);
    let dead = move |x: f64| soft_positive(x - play, 1e-3) - soft_positive(-x - play, 1e-3);
    if wall > 0.0 {
        out.always(move || {
            Hook::with_states(
                3,
                0.1,
                move |s, y| {
                    for k in 0..3 {
                        y[k] = s.theta_b_rad[k] - 0.5 * play;
                    }
                },
                move |s, y, action, rates| {
                    for k in 0..3 {
                        let push = wall * dead(s.theta_b_rad[k] - y[k]);
                        rates[k] = (push - own * (y[k] - rest[k])) / drag;
                        action.torque_b_n_m[k] -= m[k] * push;
                    }
                },
            )
        });
    }
    out
}

/// A joint that prefers some angles: A sin(n theta_b + p).
pub fn cogging(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.4);
    let amplitude = draw.size(2e-5, 7e-4);
    let teeth = draw.dice.range(25.0, 45.0);
    let phase = [(); 3].map(|()| draw.dice.range(0.0, std::f64::consts::TAU));
    let mut out = draw.effect("x_cogging", on);
    out.form("amplitude_N_m", amplitude);
    out.form("periods_a_radian", teeth / std::f64::consts::TAU);
    out.note("position", "periodic in the bicep angle");
    let m = mask(on);
    out.always(move || {
        Hook::plain(move |s, action| {
            for k in 0..3 {
                let wave = (teeth * s.theta_b_rad[k] + phase[k]).sin();
                action.torque_b_n_m[k] += m[k] * amplitude * wave;
            }
        })
    });
    out
}

/// A pretension cable is slack on one side of the workspace and pulls on the other.
pub fn slack_cable(draw: &mut Draw) -> Effect {
    let stiffness = draw.size(0.15, 12.0);
    let side = draw.dice.sideways();
    let down = draw.dice.range(0.2, 0.6);
    let direction = {
        let length = (1.0 + down * down).sqrt();
        [side[0] / length, side[1] / length, -down / length]
    };
    let begins = dot(direction, draw.setting.rest_m) + draw.dice.range(1e-3, 4e-3);
    let edge = draw.dice.range(2e-4, 1e-3);
    let mut out = draw.effect("x_slack_cable", [true; 3]);
    out.form("stiffness_N_m", stiffness);
    out.form("direction", direction.to_vec());
    out.form("begins_at_m", begins);
    out.note("position", "one side of the workspace");
    out.always(move || {
        Hook::plain(move |s, action| {
            let stretch = soft_positive(dot(direction, s.position_m) - begins, edge);
            for i in 0..3 {
                action.force_n[i] -= stiffness * stretch * direction[i];
            }
        })
    });
    out
}

/// Each output of the amplifier picks up a share of its neighbour's, and a little of the product.
pub fn crosstalk(draw: &mut Draw) -> Effect {
    let sign = draw.dice.sign();
    let share = sign * draw.size(0.004, 0.12);
    let other = share * draw.dice.range(-0.5, 0.2);
    let mut out = draw.effect("x_crosstalk", [true; 3]);
    out.order = Order::Amplifier;
    out.form("share_of_next", share);
    out.form("share_of_previous", other);
    out.note("voltage", "of the neighbouring actuator");
    out.always(move || {
        Hook::plain(move |_, action| {
            let phi = action.phi_v;
            for k in 0..3 {
                action.phi_v[k] += share * phi[(k + 1) % 3] + other * phi[(k + 2) % 3];
            }
        })
    });
    out
}

/// The amplifier ripples at one frequency, more under load: phi (1 + a |phi|/5 kV sin(2 pi f t + p)).
pub fn ripple(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let amplitude = draw.size(0.004, 0.12);
    let frequency = draw.dice.range(1.3, 3.6);
    let phase = [(); 3].map(|()| draw.dice.range(0.0, std::f64::consts::TAU));
    let mut out = draw.effect("x_amplifier_ripple", on);
    out.order = Order::Amplifier;
    out.form("amplitude_at_5_kV", amplitude);
    out.form("frequency_Hz", frequency);
    out.at(json!({"dimension": "frequency", "value": frequency, "unit": "Hz"}));
    let m = mask(on);
    out.always(move || {
        Hook::plain(move |s, action| {
            let turn = std::f64::consts::TAU * frequency * s.t_s;
            for k in 0..3 {
                let load = action.phi_v[k].abs() / 5e3;
                action.phi_v[k] *= 1.0 + m[k] * amplitude * load * (turn + phase[k]).sin();
            }
        })
    });
    out
}

/// The film warms by the square of its voltage, cools with a time constant, and is softer while warm.
pub fn self_heating(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let softening = draw.size(0.015, 0.5);
    let memory = draw.dice.log_range(6.0, 25.0);
    let lozenge = draw.lozenge();
    let mut out = draw.effect("x_self_heating", on);
    out.form("softening_at_5_kV", softening);
    out.form("memory_s", memory);
    out.note("time", "builds up with the voltage, within each recording");
    let m = mask(on);
    out.always(move || {
        Hook::with_states(
            3,
            0.1,
            |_, heat| heat.fill(0.0),
            move |s, heat, action, rates| {
                for k in 0..3 {
                    let power = (action.phi_v[k] / 5e3).powi(2);
                    rates[k] = (power - heat[k]) / memory;
                    let warm = heat[k].max(0.0);
                    let lost = m[k] * softening * warm / (1.0 + softening * warm);
                    let sigma = s.film_stress_pa[k].map(|s| s * lost);
                    action.torque_dea_n_m[k] += film_torque(&lozenge, s.theta_dea_rad[k], sigma);
                }
            },
        )
    });
    out
}

/// A sail on the end effector: -c |v| v.
pub fn quadratic_drag(draw: &mut Draw) -> Effect {
    let drag = draw.size(0.4, 40.0);
    let mut out = draw.effect("x_quadratic_drag", [true; 3]);
    out.form("drag_N_s2_m2", drag);
    out.note("direction", "square of the speed");
    out.always(move || {
        Hook::plain(move |s, action| {
            let v = s.velocity_m_s;
            let speed = (dot(v, v) + 1e-10).sqrt();
            for i in 0..3 {
                action.force_n[i] -= drag * speed * v[i];
            }
        })
    });
    out
}

/// A spring in series with a dashpot that yields (Eyring): y' = r sinh(T/T_0), T = k (theta_DEA - y).
pub fn yielding_branch(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let stiffness = draw.size(0.004, 0.25);
    let yields = stiffness * draw.dice.log_range(0.008, 0.03);
    let rate = draw.dice.log_range(1e-4, 4e-3);
    let mut out = draw.effect("x_yielding_branch", on);
    out.form("stiffness_N_m_rad", stiffness);
    out.form("yield_torque_N_m", yields);
    out.form("rate_rad_s", rate);
    out.note("direction", "flows fast above a torque, hardly below");
    let m = mask(on);
    if stiffness > 0.0 {
        out.always(move || {
            Hook::with_states(
                3,
                0.1,
                |s, y| y[..3].copy_from_slice(&s.theta_dea_rad),
                move |s, y, action, rates| {
                    for k in 0..3 {
                        let torque = stiffness * (s.theta_dea_rad[k] - y[k]);
                        rates[k] = rate * (torque / yields).clamp(-40.0, 40.0).sinh();
                        action.torque_dea_n_m[k] -= m[k] * torque;
                    }
                },
            )
        });
    }
    out
}

/// The voltage cables pull towards where they are clamped: an elastic tension whose direction changes with
/// the pose.
pub fn cable_pull(draw: &mut Draw) -> Effect {
    let tension = draw.size(4e-4, 3e-2);
    let side = draw.dice.sideways();
    let far = draw.dice.range(0.06, 0.14);
    let height = draw.dice.range(-0.06, 0.02);
    let clamp = [far * side[0], far * side[1], height];
    let rest = draw.setting.rest_m;
    let distance = move |u: [f64; 3]| {
        let d = [0, 1, 2].map(|i| clamp[i] - u[i]);
        (d, dot(d, d).sqrt())
    };
    let free = distance(rest).1;
    let stiffness = tension * draw.dice.range(20.0, 120.0);
    let mut out = draw.effect("x_cable_pull", [true; 3]);
    out.form("tension_N", tension);
    out.form("stiffness_N_m", stiffness);
    out.form("clamp_m", clamp.to_vec());
    out.note("position", "a lateral force that depends on the pose");
    out.always(move || {
        Hook::plain(move |s, action| {
            let (d, length) = distance(s.position_m);
            let pull = tension + stiffness * (length - free);
            for i in 0..3 {
                action.force_n[i] += pull * d[i] / length;
            }
        })
    });
    out
}

/// A hose that is hung up elsewhere swings along: a mass on a weak spring, b' = p - v, p' = -omega^2 b - 2
/// zeta omega b', force -m_h p' along one direction (b: how far it lags behind).
pub fn swinging_hose(draw: &mut Draw) -> Effect {
    let ratio = draw.size(0.6, 8.0);
    let omega = std::f64::consts::TAU * draw.dice.range(0.8, 2.2);
    let damping = draw.dice.range(0.01, 0.05);
    let side = draw.dice.sideways();
    let up = draw.dice.range(0.3, 0.9);
    let flat = (1.0 - up * up).sqrt();
    let direction = [flat * side[0], flat * side[1], up];
    let mass = ratio * draw.setting.robot.effector_kg;
    let mut out = draw.effect("x_swinging_hose", [true; 3]);
    out.form("mass_kg", mass);
    out.form("frequency_Hz", omega / std::f64::consts::TAU);
    out.form("damping_ratio", damping);
    out.form("direction", direction.to_vec());
    out.note("frequency", "rings after fast changes");
    out.always(move || {
        Hook::with_states(
            2,
            1e-2,
            |_, b| b.fill(0.0),
            move |s, b, action, rates| {
                let speed = b[1] - dot(direction, s.velocity_m_s);
                rates[0] = speed;
                rates[1] = -omega * omega * b[0] - 2.0 * damping * omega * speed;
                for i in 0..3 {
                    action.force_n[i] -= mass * rates[1] * direction[i];
                }
            },
        )
    });
    out
}
