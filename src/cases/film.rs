//! Effects in the film, its electrode and the lozenge.

use serde_json::json;
use statrs::function::erf::erf;

use super::effect::{Draw, Effect, Hook, film_torque, mask};
use crate::film::gent_stress;

/// Gent stress over modulus; a locked spring keeps the stress of the locking's edge.
fn gent(a: f64, b: f64, locking: f64) -> [f64; 2] {
    match gent_stress(a, b, locking) {
        Ok((s, _)) => s,
        Err(_) => [1e6; 2],
    }
}

/// The electrode, a Gent layer of its own that is free of stress where it was painted: lambda_1 = 1.5,
/// lambda_2 = 1.5^-1/2.
pub fn electrode_stiffness(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.4);
    let modulus = draw.size(1.5e3, 9e4);
    let locking = draw.dice.range(5.0, 14.0);
    let painted = [1.5_f64, 1.5_f64.powf(-0.5)];
    let lozenge = draw.lozenge();
    let mut out = draw.effect("electrode_stiffness", on);
    out.parameter("modulus", modulus);
    out.form("locking", locking);
    out.form("painted_stretch", painted.to_vec());
    out.note(
        "position",
        "grows with the distance from the painted stretch",
    );
    let m = mask(on);
    out.always(move || {
        Hook::plain(move |s, action| {
            for k in 0..3 {
                let [a, b] = [0, 1].map(|i| (s.stretch[k][i] / painted[i]).powi(2));
                let sigma = gent(a, b, locking).map(|s| s * modulus * m[k]);
                action.torque_dea_n_m[k] -= film_torque(&lozenge, s.theta_dea_rad[k], sigma);
            }
        })
    });
    out
}

/// -k (x + c x^3), x = theta_DEA - theta_0.
pub fn hinge_stiffness(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.4);
    let k1 = draw.size(0.002, 0.2);
    let cubic = draw.dice.range(0.0, 13.0);
    let rest = draw.dice.range(122.0, 150.0_f64).to_radians();
    let mut out = draw.effect("hinge_stiffness", on);
    out.parameter("stiffness", k1);
    out.parameter("rest_angle", rest);
    out.form("cubic_over_linear", cubic);
    let m = mask(on);
    out.always(move || {
        Hook::plain(move |s, action| {
            for k in 0..3 {
                let x = s.theta_dea_rad[k] - rest;
                action.torque_dea_n_m[k] -= m[k] * k1 * x * (1.0 + cubic * x * x);
            }
        })
    });
    out
}

/// Ogden and Roxburgh: below the largest energy so far the equilibrium spring carries 1 - r erf((W_max -
/// W)/(m + b W_max)). The maximum follows the energy within milliseconds.
pub fn mullins_softening(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.2);
    let softening = draw.size(0.04, 0.8);
    let lozenge = draw.lozenge();
    let film = draw.setting.parameters.film.clone();
    let (mu, locking) = (film.mu_pa[0], film.locking);
    let energy = move |a: f64, b: f64| {
        let d = 1.0 - (a + b + 1.0 / (a * b) - 3.0) / locking;
        -0.5 * mu * locking * d.max(1e-3).ln()
    };
    let at = |theta: f64| {
        let l = lozenge.stretches(theta);
        energy(l[0] * l[0], l[1] * l[1])
    };
    let rest = draw.setting.rest[0].theta_dea_rad;
    let span = (at(rest - 0.45) - at(rest)).abs();
    let scale = span * draw.dice.range(0.05, 0.3);
    let growth = draw.dice.range(0.0, 0.08);
    let follow_s = 2e-3;
    let mut out = draw.effect("mullins_softening", on);
    out.parameter("softening", softening);
    out.parameter("energy_scale", scale + growth * at(rest - 0.45));
    out.form("energy_scale_constant_J_m3", scale);
    out.form("energy_scale_growth", growth);
    out.form("follows_within_s", follow_s);
    out.note(
        "largest_stretch",
        "first loading of a recording against the later ones",
    );
    let m = mask(on);
    let squares = |l: [f64; 2]| [l[0] * l[0], l[1] * l[1]];
    out.always(move || {
        Hook::with_states(
            3,
            span,
            move |s, largest| {
                for k in 0..3 {
                    let [a, b] = squares(s.stretch[k]);
                    largest[k] = energy(a, b);
                }
            },
            move |s, largest, action, rates| {
                for k in 0..3 {
                    let [a, b] = squares(s.stretch[k]);
                    let w = energy(a, b);
                    rates[k] = (w - largest[k]).max(0.0) / follow_s;
                    let below = (largest[k] - w).max(0.0);
                    let lost =
                        m[k] * softening * erf(below / (scale + growth * largest[k].max(0.0)));
                    let sigma = gent(a, b, locking).map(|s| s * mu * lost);
                    action.torque_dea_n_m[k] += film_torque(&lozenge, s.theta_dea_rad[k], sigma);
                }
            },
        )
    });
    out
}

/// w_i' = -w_i (2 s_i - s_j)/(3 T) with w = xi^-2.
fn flow(stretch: [f64; 2], w: [f64; 2], time_s: f64, locking: f64) -> [f64; 2] {
    let [a, b] = [0, 1].map(|i| stretch[i] * stretch[i] * w[i]);
    let s = gent(a, b, locking);
    [
        -w[0] * (2.0 * s[0] - s[1]) / (3.0 * time_s),
        -w[1] * (2.0 * s[1] - s[0]) / (3.0 * time_s),
    ]
}

/// One more branch, virgin when the film was mounted some minutes before the series; it has rested since.
pub fn slow_creep(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.25);
    let modulus = draw.size(3e3, 2.2e5);
    let time = draw.dice.log_range(600.0, 2000.0);
    let since = draw.dice.range(120.0, 600.0);
    let locking = draw.setting.parameters.film.locking;
    let lozenge = draw.lozenge();
    let starts: Vec<f64> = draw.setting.slots.iter().map(|s| s.start_s).collect();
    let mut out = draw.effect("slow_creep", on);
    out.parameter("modulus", modulus);
    out.parameter("time_constant", time);
    out.form("since_assembly_s", since);
    out.note("time", "drifts over the whole series");
    let m = mask(on);
    out.act = Some(Box::new(move |recording| {
        let rested = since + starts[recording];
        let start = move |s: &crate::simulate::Situation, w: &mut [f64]| {
            for k in 0..3 {
                let mut now = [1.0; 2];
                let steps = 30;
                let h = rested / f64::from(steps);
                for _ in 0..steps {
                    // Midpoint rule: a step is a small share of T.
                    let slope = flow(s.stretch[k], now, time, locking);
                    let half = [0, 1].map(|i| now[i] + 0.5 * h * slope[i]);
                    let slope = flow(s.stretch[k], half, time, locking);
                    now = [0, 1].map(|i| now[i] + h * slope[i]);
                }
                w[2 * k..2 * k + 2].copy_from_slice(&now);
            }
        };
        Some(Hook::with_states(
            6,
            1.0,
            start,
            move |s, w, action, rates| {
                for k in 0..3 {
                    let own = [w[2 * k], w[2 * k + 1]];
                    let rate = flow(s.stretch[k], own, time, locking);
                    rates[2 * k..2 * k + 2].copy_from_slice(&rate);
                    let [a, b] = [0, 1].map(|i| s.stretch[k][i] * s.stretch[k][i] * own[i]);
                    let sigma = gent(a, b, locking).map(|s| s * modulus * m[k]);
                    action.torque_dea_n_m[k] -= film_torque(&lozenge, s.theta_dea_rad[k], sigma);
                }
            },
        ))
    }));
    out
}

/// Mean of max(s + w x, 0) over x uniform in -1 to 1.
fn carried(s: f64, w: f64) -> f64 {
    if s >= w {
        s
    } else if s <= -w {
        0.0
    } else {
        (s + w) * (s + w) / (4.0 * w)
    }
}

/// A film whose stress in direction 2 is uneven by +-w: where the net stress sigma_2 - eps E^2 would fall
/// below its floor, it wrinkles and stays there.
pub fn loss_of_tension(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.25);
    let lozenge = draw.lozenge();
    let eps = draw.eps_f_m();
    let film = &draw.setting.parameters.film;
    let l = lozenge.stretches(draw.setting.rest[0].theta_dea_rad);
    let relaxed = film.mu_pa[0] * gent(l[0] * l[0], l[1] * l[1], film.locking)[1];
    // The part that begins first does so at floor + w.
    let spread = draw.dice.range(0.2, 0.5);
    let begins = 0.97 + 0.2 * draw.strength;
    let floor = begins - spread;
    let mut out = draw.effect("loss_of_tension", on);
    out.parameter("threshold", floor);
    out.form("unevenness", spread);
    out.form("relaxed_sigma2_Pa", relaxed);
    out.note("voltage", "high field");
    out.note("position", "upper poses: small lambda_2");
    if !draw.off {
        out.always(move || {
            Hook::plain(move |s, action| {
                for k in 0..3 {
                    if on[k] {
                        let field =
                            action.phi_v[k] * s.stretch[k][0] * s.stretch[k][1] / lozenge.l3_m;
                        let net = s.film_stress_pa[k][1] - eps * field * field;
                        let above = net - floor * relaxed;
                        let more = carried(above, spread * relaxed) - above;
                        let torque = film_torque(&lozenge, s.theta_dea_rad[k], [0.0, more]);
                        action.torque_dea_n_m[k] -= torque;
                    }
                }
            })
        });
    }
    out
}

/// One actuator's film is thicker or thinner.
pub fn actuator_asymmetry(draw: &mut Draw) -> Effect {
    let on = draw.one();
    let sign = draw.dice.sign();
    let factor = 1.0 + sign * draw.size(0.002, 0.09);
    let mut out = draw.effect("actuator_asymmetry", on);
    out.parameter("thickness_factor", factor);
    out.alter = Some(Box::new(move |_, robot, _| {
        for k in 0..3 {
            if on[k] {
                robot.lozenges[k].l3_m *= factor;
            }
        }
    }));
    out
}

/// mu (1 + a (1 - e^(-t/T_a)) + b (1 - e^(-t/T_b))) over the series; relaxation times go the other way, twice
/// as far.
pub fn temperature_drift(draw: &mut Draw) -> Effect {
    let sign = draw.dice.sign();
    let change = sign * draw.size(0.003, 0.2);
    let share = draw.dice.range(0.3, 0.7);
    let time = [
        draw.dice.log_range(60.0, 180.0),
        draw.dice.log_range(300.0, 900.0),
    ];
    let factor = move |t: f64| {
        let rise = |time: f64| 1.0 - (-t / time).exp();
        1.0 + change * (share * rise(time[0]) + (1.0 - share) * rise(time[1]))
    };
    let starts: Vec<f64> = draw.setting.slots.iter().map(|s| s.start_s).collect();
    let last = draw.setting.slots.last();
    let end = last.map_or(0.0, |s| s.start_s + s.duration_s);
    let lozenge = draw.lozenge();
    let mut out = draw.effect("temperature_drift", [true; 3]);
    out.parameter("relative_change", factor(end) - 1.0);
    out.parameter(
        "time_constant",
        (share * time[0].ln() + (1.0 - share) * time[1].ln()).exp(),
    );
    out.form("amplitudes", vec![change * share, change * (1.0 - share)]);
    out.form("time_constants_s", time.to_vec());
    out.at(json!({"dimension": "time", "note": "steady over the whole series"}));
    let from = starts.clone();
    out.alter = Some(Box::new(move |recording, _, parameters| {
        let now = factor(from[recording]);
        let film = &mut parameters.film;
        film.mu_pa.iter_mut().for_each(|mu| *mu *= now);
        film.relaxation_time_s
            .iter_mut()
            .for_each(|t| *t *= now * now);
    }));
    out.act = Some(Box::new(move |recording| {
        let start = starts[recording];
        let base = factor(start);
        Some(Hook::plain(move |s, action| {
            // The moduli go on changing within the recording, all by the same factor.
            let more = factor(start + s.t_s) / base - 1.0;
            for k in 0..3 {
                let sigma = s.film_stress_pa[k].map(|s| s * more);
                action.torque_dea_n_m[k] -= film_torque(&lozenge, s.theta_dea_rad[k], sigma);
            }
        }))
    }));
    out
}
