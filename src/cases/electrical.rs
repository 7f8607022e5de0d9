//! Effects between the commanded voltage and the Maxwell torque.

use serde_json::json;

use super::effect::{Draw, Effect, Hook, Order, half_slope, mask, smooth};

/// Field of the film to which conductances refer, V/m.
const FIELD_V_M: f64 = 1e8;

/// Charge Q = C phi through a resistance that grows with the stretch of the electrode:
/// Q' = (phi_in - Q/C)/R, R = R_w + R_e lambda_1^p.
pub fn series_resistance(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let total = draw.size(1.5e6, 1e8);
    let share = draw.dice.range(0.25, 0.6);
    let power = draw.dice.range(0.8, 2.5);
    let (wire, electrode) = (total * (1.0 - share), total * share);
    // At the rest stretch of the long diagonal, R_e lambda_1^p is R_e.
    let rest = draw.lozenge().stretches(draw.setting.rest[0].theta_dea_rad)[0];
    let mut out = draw.effect("series_resistance", on);
    out.order = Order::Wire;
    out.parameter("resistance", total);
    out.form("wire_ohm", wire);
    out.form("electrode_ohm", electrode);
    out.form("stretch_power", power);
    out.note(
        "frequency",
        "lag of the film voltage, grows with the rate of change",
    );
    if total > 0.0 {
        out.always(move || {
            Hook::with_states(
                3,
                1e-5,
                |s, q| {
                    for k in 0..3 {
                        q[k] = s.capacitance_f[k] * s.command_v[k];
                    }
                },
                move |s, q, action, rates| {
                    for k in 0..3 {
                        let c = s.capacitance_f[k];
                        if on[k] {
                            let r = wire + electrode * (s.stretch[k][0] / rest).powf(power);
                            rates[k] = (action.phi_v[k] - q[k] / c) / r;
                            action.phi_v[k] = q[k] / c;
                        } else {
                            rates[k] = 0.0;
                        }
                    }
                },
            )
        });
    }
    out
}

/// Q' = (phi_in - phi)/R - G phi, G = g (1 + e (E/E_0)^2).
pub fn leakage(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let loss = draw.size(0.004, 0.12);
    let wire = draw.dice.range(0.6e6, 2.5e6);
    let growth = draw.dice.range(0.6, 2.5);
    let conductance = loss / wire;
    let lozenge = draw.lozenge();
    let field = move |phi: f64, stretch: [f64; 2]| phi * stretch[0] * stretch[1] / lozenge.l3_m;
    let stretch = lozenge.stretches(draw.setting.rest[0].theta_dea_rad);
    // The loss at 3 kV at rest, and how it grows there.
    let mut phi = 3000.0;
    for _ in 0..60 {
        let e = field(phi, stretch) / FIELD_V_M;
        phi = 3000.0 / (1.0 + wire * conductance * (1.0 + growth * e * e));
    }
    let e2 = growth * (field(phi, stretch) / FIELD_V_M).powi(2);
    let mut out = draw.effect("leakage", on);
    out.order = Order::Wire;
    out.parameter("loss_fraction", 1.0 - phi / 3000.0);
    out.parameter("field_exponent", 2.0 * e2 / (1.0 + e2));
    out.form("wire_ohm", wire);
    out.form("conductance_S", conductance);
    out.form("growth_with_field_squared", growth);
    out.note("voltage", "loss grows faster than the voltage");
    if loss > 0.0 {
        out.always(move || {
            Hook::with_states(
                3,
                1e-5,
                |s, q| {
                    for k in 0..3 {
                        q[k] = s.capacitance_f[k] * s.command_v[k];
                    }
                },
                move |s, q, action, rates| {
                    for k in 0..3 {
                        rates[k] = 0.0;
                        if on[k] {
                            let phi = q[k] / s.capacitance_f[k];
                            let e = field(phi, s.stretch[k]) / FIELD_V_M;
                            let g = conductance * (1.0 + growth * e * e);
                            rates[k] = (action.phi_v[k] - phi) / wire - g * phi;
                            action.phi_v[k] = phi;
                        }
                    }
                },
            )
        });
    }
    out
}

/// phi = (1 + e) phi_c + offset, the offset fading out below 50 V.
pub fn amplifier_gain(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.4);
    let sign = draw.dice.sign();
    let error = sign * draw.size(0.004, 0.12);
    let offset = if draw.off {
        0.0
    } else {
        draw.dice.sign() * draw.dice.range(0.0, 10.0 + 70.0 * draw.strength)
    };
    let mut out = draw.effect("amplifier_gain", on);
    out.order = Order::Amplifier;
    out.parameter("gain_error", error);
    out.parameter("offset", offset);
    out.note("voltage", "proportional to the command");
    out.always(move || {
        Hook::plain(move |_, action| {
            for k in 0..3 {
                if on[k] {
                    let phi = action.phi_v[k];
                    let fade = phi * phi / (phi * phi + 2500.0);
                    action.phi_v[k] = (1.0 + error) * phi + offset * fade;
                }
            }
        })
    });
    out
}

/// phi = phi_c S, S a smooth step of |phi_c| round the threshold.
pub fn amplifier_deadband(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let threshold = draw.size(250.0, 2200.0);
    let edge = threshold * draw.dice.range(0.08, 0.25);
    let mut out = draw.effect("amplifier_deadband", on);
    out.order = Order::Amplifier;
    out.parameter("threshold", threshold);
    out.form("edge_V", edge);
    out.at(json!({"dimension": "voltage", "range": [0.0, threshold], "unit": "V"}));
    if threshold > 0.0 {
        out.always(move || {
            Hook::plain(move |_, action| {
                for k in 0..3 {
                    if on[k] {
                        let above = action.phi_v[k].abs() - threshold;
                        action.phi_v[k] *= smooth(0.5 + 0.5 * above / edge);
                    }
                }
            })
        });
    }
    out
}

/// phi = phi_c/(1 + (|phi_c|/c)^p)^(1/p): a ceiling with a soft knee.
pub fn amplifier_saturation(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let ceiling = draw.setting.peak_v * (1.02 - 0.37 * draw.strength);
    let knee = draw.dice.range(14.0, 40.0);
    let mut out = draw.effect("amplifier_saturation", on);
    out.order = Order::Amplifier;
    out.parameter("ceiling", ceiling);
    out.form("knee_power", knee);
    let peak = draw.setting.peak_v;
    out.at(json!({"dimension": "voltage", "range": [ceiling * 0.93, peak], "unit": "V"}));
    if !draw.off {
        out.always(move || {
            Hook::plain(move |_, action| {
                for k in 0..3 {
                    if on[k] {
                        let over = (action.phi_v[k].abs() / ceiling).powf(knee);
                        action.phi_v[k] /= (1.0 + over).powf(1.0 / knee);
                    }
                }
            })
        });
    }
    out
}

/// phi' = r tanh((phi_c - phi)/(r 4 ms)), r lower where |phi| falls.
pub fn slew_limit(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let up = 11e3 * (2.6e3_f64 / 11e3).powf(draw.strength);
    let down = up * draw.dice.range(0.55, 1.0);
    let soft_s = 4e-3;
    let mut out = draw.effect("slew_limit", on);
    out.order = Order::Amplifier;
    out.parameter("rate_up", up);
    out.parameter("rate_down", down);
    out.form("softness_s", soft_s);
    out.at(json!({"dimension": "voltage_rate", "range": [down, null], "unit": "V/s"}));
    if !draw.off {
        out.always(move || {
            Hook::with_states(
                3,
                1e3,
                |s, y| y[..3].copy_from_slice(&s.command_v),
                move |_, y, action, rates| {
                    for k in 0..3 {
                        rates[k] = 0.0;
                        if on[k] {
                            let miss = action.phi_v[k] - y[k];
                            let rising = 0.5 * (1.0 + (miss * y[k] / 1e4).tanh());
                            let rate = down + (up - down) * rising;
                            rates[k] = rate * (miss / (rate * soft_s)).tanh();
                            action.phi_v[k] = y[k];
                        }
                    }
                },
            )
        });
    }
    out
}

/// eps = eps (1 - a x + b x^2), x = lambda_1 lambda_2 - 1:
/// tau_volt = 1/2 phi^2 (C_0' f + C_0 df/dx lambda_1 lambda_2 cot theta).
pub fn permittivity_stretch(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.25);
    let slope = draw.size(0.012, 0.38);
    let bend = slope * draw.dice.range(0.05, 0.35);
    let mut out = draw.effect("permittivity_stretch", on);
    out.parameter("slope", slope);
    out.form("slope", slope);
    out.form("quadratic", bend);
    out.always(move || {
        Hook::plain(move |s, action| {
            for k in 0..3 {
                if on[k] {
                    let area = s.stretch[k][0] * s.stretch[k][1];
                    let x = area - 1.0;
                    let change = -slope * x + bend * x * x;
                    let turn = (-slope + 2.0 * bend * x) * area;
                    let c = half_slope(s, k);
                    let squared = action.phi_v[k] * action.phi_v[k];
                    // C_0 cot theta/2 = half slope/2
                    action.torque_dea_n_m[k] += squared * c * (change + 0.5 * turn);
                }
            }
        })
    });
    out
}

/// tau_volt = 1/2 C'((1 - x_1 - x_2) phi^2 + x_1 psi_1^2 + x_2 psi_2^2), psi_i' = (phi - psi_i)/T_i.
pub fn dielectric_relaxation(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.25);
    let total = draw.size(0.008, 0.28);
    let share = draw.dice.range(0.3, 0.7);
    let x = [total * share, total * (1.0 - share)];
    let time = [
        draw.dice.log_range(0.25, 1.0),
        draw.dice.log_range(3.0, 12.0),
    ];
    let mut out = draw.effect("dielectric_relaxation", on);
    out.parameter("fraction", total);
    out.parameter(
        "time_constant",
        (share * time[0].ln() + (1.0 - share) * time[1].ln()).exp(),
    );
    out.form("fractions", x.to_vec());
    out.form("time_constants_s", time.to_vec());
    out.note("time", "creep after voltage steps, none after load steps");
    let m = mask(on);
    out.always(move || {
        Hook::with_states(
            6,
            1e3,
            |s, psi| {
                for k in 0..3 {
                    psi[2 * k] = s.command_v[k];
                    psi[2 * k + 1] = s.command_v[k];
                }
            },
            move |s, psi, action, rates| {
                for k in 0..3 {
                    let phi = action.phi_v[k];
                    let c = half_slope(s, k) * m[k];
                    for i in 0..2 {
                        let p = psi[2 * k + i];
                        rates[2 * k + i] = (phi - p) / time[i];
                        action.torque_dea_n_m[k] += c * x[i] * (p * p - phi * phi);
                    }
                }
            },
        )
    });
    out
}

/// From t* on C and C' of one actuator are scaled by 1 - f, within some hundredths of a second.
pub fn electrode_failure(draw: &mut Draw) -> Effect {
    let on = draw.one();
    let fraction = draw.size(0.012, 0.4);
    let (index, time) = draw.instant();
    let width = draw.dice.range(0.01, 0.06);
    let mut out = draw.effect("electrode_failure", on);
    let name = draw.setting.slots[index].name.clone();
    out.parameter("fraction", fraction);
    out.parameter("time", time);
    out.parameter("recording", name.clone());
    out.form("width_s", width);
    out.form("recording_index", index);
    out.at(
        json!({"dimension": "time", "from_s": time, "recording": name,
        "note": "and all later recordings of the series"}),
    );
    let m = mask(on);
    out.act = Some(Box::new(move |recording| {
        if recording < index {
            return None;
        }
        let (begin, width) = if recording == index {
            (time - width, width)
        } else {
            (-1.0, 0.1)
        };
        let hook = Hook::plain(move |s, action| {
            let lost = fraction * smooth((s.t_s - begin) / (2.0 * width));
            for k in 0..3 {
                let squared = action.phi_v[k] * action.phi_v[k];
                action.torque_dea_n_m[k] -= m[k] * lost * half_slope(s, k) * squared;
            }
        });
        Some(hook.breaking_at(vec![begin, begin + 2.0 * width]))
    }));
    out
}
