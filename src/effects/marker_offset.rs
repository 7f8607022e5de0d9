//! The end-effector marker sits elsewhere than stated:  u = u_measured - offset.

use super::{Effect, Part, Quantity, Reach, Reading, Seen, Site, size};

pub struct MarkerOffset;

impl Effect for MarkerOffset {
    fn id(&self) -> &'static str {
        "marker_offset"
    }
    fn says(&self) -> &'static str {
        "the marker sits elsewhere on the end effector than stated"
    }
    fn source(&self) -> &'static str {
        "translation of the measured point"
    }
    fn equation(&self) -> &'static str {
        "u = u_m - offset"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &[
            "link_length_error",
            "actuator_mass",
            "hinge_stiffness",
            "frame_tilt",
        ]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Marker
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("offset_x", "m", -0.02, 0.02, 2e-3),
                size("offset_y", "m", -0.02, 0.02, 2e-3),
                size("offset_z", "m", -0.02, 0.02, 2e-3),
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
        let d = 1e-4;
        vec![vec![
            vec![d, 0.0, 0.0],
            vec![0.0, d, 0.0],
            vec![0.0, 0.0, d],
        ]]
    }
    fn brought_out_by(&self) -> &'static str {
        "poses far off the axis in all directions; or measuring the marker"
    }
    fn reads_otherwise(&self) -> bool {
        true
    }
    fn reading(&self, v: &[f64], motion: &mut Reading) {
        for u in motion.position_m.iter_mut() {
            for k in 0..3 {
                u[k] -= v[k];
            }
        }
    }
}
