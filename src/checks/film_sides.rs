//! The sides of the film against the lozenge that stretches it: at rest the film alone carries the weights.
//!
//! Its torque on the lozenge is mu/2 d(lambda_1^2 + lambda_2^2 + lambda_3^2)/d theta times its volume,
//! whatever J and the relaxation times are, so that its sign is one of lengths alone. Where it goes with the
//! weights, no modulus holds the robot where it was seen. Springs of hinges may carry a part of the weights,
//! and no film is measured to better than a hundredth: the sign has to be wrong with both sides off by
//! [`OFF`] in whatever direction.

use super::glance::spring_m3;
use super::view::{View, short};
use super::{Findings, Grade};
use crate::kinematics::Lozenge;
use crate::recording::Rig;

/// Share by which the sides of a film may be off.
const OFF: f64 = 0.05;
/// Sides that are tried, over the stated one, and how many.
const TRIED: [f64; 2] = [0.2, 5.0];
const TRIES: usize = 400;

pub(super) fn check(view: &View<'_>, found: &mut Findings) {
    let (Some(glance), Some(Rig::Robot(rig))) = (&view.glance, &view.recording.rig) else {
        return;
    };
    if found.list.iter().any(|f| f.grade == Grade::Wrong) {
        return;
    }
    let Some(rest) = glance.at_rest() else {
        return;
    };
    let loads = [0, 1, 2].map(|k| rest.chains[k].load(0));
    let angles = [0, 1, 2].map(|k| rest.chains[k].theta_dea_rad[0]);
    // where the weights do not pull all three the same way, the robot hangs at the end of its reach
    if !loads.iter().all(|l| l * loads[0] > 0.0) {
        return;
    }
    let holds = |[by_1, by_2]: [f64; 2]| {
        let torque = |k: usize| {
            let lozenge = &glance.robot.lozenges[k];
            let other = Lozenge {
                l1_m: by_1 * lozenge.l1_m,
                l2_m: by_2 * lozenge.l2_m,
                ..*lozenge
            };
            spring_m3(&other, angles[k])
        };
        (0..3).map(torque).sum::<f64>() * loads[0] < 0.0
    };
    let about = [1.0 - OFF, 1.0, 1.0 + OFF];
    let near = about.iter().flat_map(|a| about.map(|b| [*a, b]));
    if near.into_iter().any(holds) {
        return;
    }
    let [stretch_1, stretch_2] = glance.robot.lozenges[0].stretches(angles[0]);
    let (l1, l2) = (rig.film.L1_mm, rig.film.L2_mm);
    let [low, high] = TRIED;
    let tried = (0..TRIES).map(|i| low * (high / low).powf(i as f64 / (TRIES - 1) as f64));
    let fits: Vec<f64> = tried.filter(|by| holds([*by, 1.0])).collect();
    let would = match (fits.first(), fits.last()) {
        (Some(a), Some(b)) => format!(
            " (with this L2_mm, L1_mm from {} to {} would)",
            short(a * l1),
            short(b * l1)
        ),
        _ => String::new(),
    };
    found.add(
        "stated_value",
        Grade::Wrong,
        format!(
            "L1_mm = {l1} and L2_mm = {l2} cannot both be: in a lozenge of l_dea_mm = {} the robot at rest \
             stretches such a film {} times along direction 1 and {} times along direction 2, and no film that \
             is stretched so carries the weights{would}",
            rig.actuator.l_dea_mm,
            short(stretch_1),
            short(stretch_2),
        ),
        "measure both sides of the unstretched film again (direction 1 is the long diagonal), and look at \
         l_dea_mm and dea_offset_deg in the rig file",
    );
}
