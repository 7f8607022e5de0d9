//! The capture axes are rotated against the world about the base marker:  u = p + R (u_measured - p), R =
//! exp(rotation).

use super::{Effect, Part, Quantity, Reach, Reading, Seen, Site, size};
use crate::kinematics::Vec3;

pub struct FrameTilt;

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// R v - v as a function of v for the rotation vector w (Rodrigues).
fn turned(w: Vec3) -> impl Fn(Vec3) -> Vec3 {
    let angle = (w[0] * w[0] + w[1] * w[1] + w[2] * w[2]).sqrt();
    let axis = match angle > 0.0 {
        true => w.map(|x| x / angle),
        false => [0.0; 3],
    };
    let (s, c) = angle.sin_cos();
    move |v| {
        let once = cross(axis, v);
        let twice = cross(axis, once);
        [0, 1, 2].map(|i| s * once[i] + (1.0 - c) * twice[i])
    }
}

impl Effect for FrameTilt {
    fn id(&self) -> &'static str {
        "frame_tilt"
    }
    fn says(&self) -> &'static str {
        "the axes of the motion capture are tilted or turned against the robot"
    }
    fn source(&self) -> &'static str {
        "Rodrigues's rotation about the base marker"
    }
    fn equation(&self) -> &'static str {
        "u = p + R (u_m - p), R = exp(rotation), p at the base marker"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["actuator_asymmetry", "marker_offset"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Marker
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("rotation_x", "rad", -0.3, 0.3, 0.03),
                size("rotation_y", "rad", -0.3, 0.3, 0.03),
                size("rotation_z", "rad", -0.3, 0.3, 0.03),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Motion
    }
    fn reach(&self) -> Reach {
        Reach::All
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        let d = 1e-3;
        vec![vec![
            vec![d, 0.0, 0.0],
            vec![0.0, d, 0.0],
            vec![0.0, 0.0, d],
        ]]
    }
    fn brought_out_by(&self) -> &'static str {
        "poses far off the axis in all directions, low and high"
    }
    fn reads_otherwise(&self) -> bool {
        true
    }
    fn reading(&self, v: &[f64], motion: &mut Reading) {
        let turned = turned([v[0], v[1], v[2]]);
        let p = motion.pivot_m;
        let add = |x: &mut Vec3, d: Vec3| *x = [x[0] + d[0], x[1] + d[1], x[2] + d[2]];
        for u in motion.position_m.iter_mut() {
            let arm = [u[0] - p[0], u[1] - p[1], u[2] - p[2]];
            add(u, turned(arm));
        }
        for u in motion
            .velocity_m_s
            .iter_mut()
            .chain(motion.acceleration_m_s2.iter_mut())
        {
            add(u, turned(*u));
        }
    }
}
