//! Effects in joints, links and masses.

use serde_json::json;

use super::effect::{Draw, Effect, Hook, Steps, mask, soft_positive};
use crate::units::GRAVITY_M_S2;

/// LuGre: z' = v - sigma_0 |v| z/g(v), g = F_c + (F_s - F_c) exp(-(v/v_s)^2), torque -(sigma_0 z + sigma_1
/// z').
pub fn joint_friction(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let coulomb = draw.size(8e-6, 8e-4);
    let sticking = coulomb * draw.dice.range(1.05, 1.5);
    let stribeck = draw.dice.log_range(0.03, 0.2);
    let breakaway = draw.dice.log_range(3e-3, 1e-2);
    let stiffness = coulomb / breakaway;
    let micro = stiffness * draw.dice.log_range(1e-4, 6e-4);
    let mut out = draw.effect("joint_friction", on);
    out.parameter("torque", coulomb);
    out.form("sticking_N_m", sticking);
    out.form("stribeck_rad_s", stribeck);
    out.form("bristle_stiffness_N_m_rad", stiffness);
    out.form("bristle_damping_N_m_s_rad", micro);
    out.note("direction", "sign of the bicep velocity");
    let m = mask(on);
    if coulomb > 0.0 {
        out.always(move || {
            Hook::with_states(
                3,
                breakaway,
                |_, z| z.fill(0.0),
                move |s, z, action, rates| {
                    for k in 0..3 {
                        let v = s.theta_b_rate_rad_s[k];
                        let g = coulomb + (sticking - coulomb) * (-(v / stribeck).powi(2)).exp();
                        // |v| rounded within 1e-3 rad/s
                        let speed = (v * v + 1e-6).sqrt() - 1e-3;
                        rates[k] = v - stiffness * speed * z[k] / g;
                        action.torque_b_n_m[k] -= m[k] * (stiffness * z[k] + micro * rates[k]);
                    }
                },
            )
        });
    }
    out
}

/// -c v/(1 + |v|/v_0)^n: a grease that thins.
pub fn joint_damping(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.3);
    let coefficient = draw.size(5e-6, 8e-4);
    let thinning = draw.dice.range(0.0, 0.35);
    let speed = draw.dice.range(0.5, 2.0);
    let mut out = draw.effect("joint_damping", on);
    // At 0.5 rad/s.
    out.parameter(
        "coefficient",
        coefficient / (1.0 + 0.5 / speed).powf(thinning),
    );
    out.form("coefficient_at_rest", coefficient);
    out.form("thinning_power", thinning);
    out.form("thinning_rad_s", speed);
    out.note("direction", "proportional to the rate");
    let m = mask(on);
    out.always(move || {
        Hook::plain(move |s, action| {
            for k in 0..3 {
                let v = s.theta_b_rate_rad_s[k];
                let thin = (1.0 + (v * v + 1e-6).sqrt() / speed).powf(thinning);
                action.torque_b_n_m[k] -= m[k] * coefficient * v / thin;
            }
        })
    });
    out
}

/// Contact beyond theta_stop with a soft edge and a damping that grows with the depth: -k d (1 + c theta_b'),
/// never pulling.
pub fn end_stop(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.2);
    // How far below the free rest pose the stop holds the end effector (all three), or would hold it.
    let depth = 1.5e-4 * (4e-3_f64 / 1.5e-4).powf(draw.strength);
    let stiffness = draw.dice.log_range(1.0, 5.0);
    let damping = draw.dice.range(0.02, 0.15);
    let edge = draw.dice.log_range(2e-4, 1.5e-3);
    let mut at = draw.setting.rest_m;
    at[2] -= depth;
    let poses = draw.setting.robot.mechanism.pose(at);
    let stop = match poses {
        Ok(p) => [0, 1, 2].map(|k| p[k].theta_b_rad),
        Err(_) => draw.setting.rest.map(|p| p.theta_b_rad - 0.02),
    };
    let mut out = draw.effect("end_stop", on);
    out.parameter("theta_stop", stop[0]);
    out.parameter("stiffness", stiffness);
    out.form("damping_s", damping);
    out.form("edge_rad", edge);
    out.form("depth_below_rest_m", depth);
    out.note("position", "upper edge of the workspace");
    if !draw.off {
        out.always(move || {
            Hook::plain(move |s, action| {
                for k in 0..3 {
                    if on[k] {
                        let depth = soft_positive(s.theta_b_rad[k] - stop[k], edge);
                        let push = (1.0 + damping * s.theta_b_rate_rad_s[k]).max(0.0);
                        action.torque_b_n_m[k] -= stiffness * depth * push;
                    }
                }
            })
        });
    }
    out
}

/// Weight of the bicep (+S g sin theta_b, as a point mass at its tip) and of the SAM's output link, and the
/// bicep's inertia.
pub fn actuator_mass(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.2);
    let moment = draw.size(4e-6, 3e-4);
    let radius = draw.dice.range(0.02, 0.035);
    let sam = moment * draw.dice.range(0.05, 0.35);
    let turned = draw.dice.range(0.3, 1.2);
    let offset = draw.setting.robot.mechanism.chains[0].dea_offset_rad;
    let q = draw.setting.robot.mechanism.chains[0].bicep_m;
    let all = on == [true; 3];
    // Inertia of the bicep, S r, as a mass at its tip; that mass has a weight of its own, which is taken off
    // again.
    let tip = if all { moment * radius / (q * q) } else { 0.0 };
    let mut out = draw.effect("actuator_mass", on);
    out.parameter("first_moment", moment);
    out.form("radius_m", radius);
    out.form("sam_first_moment_kg_m", sam);
    out.form("sam_direction_rad", turned);
    out.note("position", "depends on the pose only");
    let m = mask(on);
    out.alter = Some(Box::new(move |_, robot, _| robot.bicep_tip_kg += tip));
    out.always(move || {
        Hook::plain(move |s, action| {
            for k in 0..3 {
                let weight = (moment - tip * q) * GRAVITY_M_S2 * m[k];
                action.torque_b_n_m[k] += weight * s.theta_b_rad[k].sin();
                // V = S_d g cos(theta_SAM + gamma), theta_SAM = offset - theta_DEA
                let angle = offset - s.theta_dea_rad[k] + turned;
                action.torque_dea_n_m[k] -= m[k] * sam * GRAVITY_M_S2 * angle.sin();
            }
        })
    });
    out
}

/// One of the eight lengths differs from its drawing.
pub fn link_length_error(draw: &mut Draw) -> Effect {
    let on = draw.actuators(0.4);
    const LINKS: [(&str, f64); 8] = [
        ("l_ch", 1.5),
        ("l_end", 1.5),
        ("q", 0.8),
        ("n0", 0.8),
        ("a", 0.3),
        ("b", 1.0),
        ("c", 1.0),
        ("d", 0.3),
    ];
    let link = draw.dice.below(LINKS.len());
    let (name, sensitivity) = LINKS[link];
    let sign = draw.dice.sign();
    let error = sign * sensitivity * draw.size(8e-4, 2.5e-2);
    let mut out = draw.effect("link_length_error", on);
    out.parameter("link", name);
    out.parameter("relative_error", error);
    out.note("position", "depends on the pose only");
    out.alter = Some(Box::new(move |_, robot, _| {
        for k in 0..3 {
            if on[k] {
                *robot.mechanism.chains[k].lengths_mut()[link] *= 1.0 + error;
            }
        }
    }));
    out
}

/// From t* on the end effector carries more, or has lost something; nobody says so.
pub fn payload_change(draw: &mut Draw) -> Effect {
    let size = draw.size(4e-5, 3e-3);
    let lost = draw.dice.chance(0.3);
    let (index, time) = draw.instant();
    let mut out = draw.effect("payload_change", [true; 3]);
    let name = draw.setting.slots[index].name.clone();
    out.parameter("mass", if lost { -size } else { size });
    out.parameter("time", time);
    out.parameter("recording", name.clone());
    out.form("recording_index", index);
    out.at(
        json!({"dimension": "time", "from_s": time, "recording": name,
        "note": "and all later recordings of the series"}),
    );
    let (before, after) = if lost { (size, 0.0) } else { (0.0, size) };
    if lost {
        // What is lost later was part of the stated mass.
        out.alter = Some(Box::new(move |_, robot, _| robot.effector_kg -= size));
    }
    out.mass = Some(Box::new(move |recording| -> Steps {
        match recording.cmp(&index) {
            std::cmp::Ordering::Less => vec![(0.0, before)],
            std::cmp::Ordering::Equal => vec![(0.0, before), (time, after)],
            std::cmp::Ordering::Greater => vec![(0.0, after)],
        }
    }));
    out
}
