//! Effects of the instruments: clocks, axes, markers, the capture's own dynamics.

use super::effect::{Draw, Effect, Lag};

/// Voltage-file time = true time + offset.
pub fn time_offset(draw: &mut Draw) -> Effect {
    let sign = draw.dice.sign();
    let offset = sign * draw.size(1.5e-3, 0.12);
    let mut out = draw.effect("time_offset", [true; 3]);
    out.parameter("offset", offset);
    out.clock = (offset, 0.0);
    out
}

/// Voltage-file time = (1 + skew) true time.
pub fn clock_skew(draw: &mut Draw) -> Effect {
    let sign = draw.dice.sign();
    let skew = sign * draw.size(1.2e-4, 8e-3);
    let mut out = draw.effect("clock_skew", [true; 3]);
    out.parameter("skew", skew);
    out.note("time", "grows along each recording");
    out.clock = (0.0, skew);
    out
}

/// Positions pass a second-order low-pass and a pure delay.
pub fn mocap_lag(draw: &mut Draw) -> Effect {
    let delay = draw.size(1.5e-3, 0.08);
    let pure = draw.dice.range(0.0, 0.5);
    let damping = draw.dice.range(0.6, 1.0);
    let mut out = draw.effect("mocap_lag", [true; 3]);
    out.parameter("delay", delay);
    out.form("pure_share", pure);
    out.form("damping_ratio", damping);
    out.note("frequency", "rounds fast motion");
    if delay > 0.0 {
        // The low-pass delays slow motion by 2 zeta/omega.
        out.lag = Some(Lag {
            omega_rad_s: 2.0 * damping / (delay * (1.0 - pure)),
            damping,
            delay_s: delay * pure,
        });
    }
    out
}

/// The capture's axes are rotated about the base marker: tilt, yaw or both.
pub fn frame_tilt(draw: &mut Draw) -> Effect {
    let angle = draw.size(0.08, 4.5);
    let direction = draw.dice.sideways();
    let kind = draw.dice.below(3);
    let sign = draw.dice.sign();
    let rotation_deg = match kind {
        0 => direction.map(|d| d * angle),
        1 => [0.0, 0.0, sign * angle],
        _ => [
            0.7 * direction[0] * angle,
            0.7 * direction[1] * angle,
            0.7 * sign * angle,
        ],
    };
    let mut out = draw.effect("frame_tilt", [true; 3]);
    out.parameter("rotation", rotation_deg.map(f64::to_radians).to_vec());
    out.placement.rotation_deg = rotation_deg;
    out
}

/// The end effector's marker sits elsewhere than stated.
pub fn marker_offset(draw: &mut Draw) -> Effect {
    let size = draw.size(8e-5, 6e-3);
    let side = draw.dice.sideways();
    let up = draw.dice.range(-1.0, 1.0);
    let flat = (1.0 - up * up).sqrt();
    let offset = [size * flat * side[0], size * flat * side[1], size * up];
    let mut out = draw.effect("marker_offset", [true; 3]);
    out.parameter("offset", offset.to_vec());
    out.placement.end_effector_offset_m = offset;
    out
}
