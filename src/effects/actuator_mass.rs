//! Weight and inertia of bicep, SAM links and lozenge: as the point mass of the balance, with the first
//! moment S about the bicep joint:  S (q theta_b'' - g sin theta_b) on theta_b.

use super::{Along, Effect, Memory, Part, Quantity, Reach, Seen, Site, size};

pub struct ActuatorMass;

/// Standard gravity, m/s^2.
const GRAVITY_M_S2: f64 = 9.80665;

impl Effect for ActuatorMass {
    fn id(&self) -> &'static str {
        "actuator_mass"
    }
    fn says(&self) -> &'static str {
        "bicep, links and lozenge have a weight of their own"
    }
    fn source(&self) -> &'static str {
        "point mass at the bicep (model, section 4)"
    }
    fn equation(&self) -> &'static str {
        "torque on theta_b: -first_moment (q theta_b'' - g sin theta_b)"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["hinge_stiffness", "a payload", "marker_offset"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Bicep
    }
    fn parameters(&self) -> &'static [Quantity] {
        const { &[size("first_moment", "kg m", -2e-3, 2e-3, 2e-4)] }
    }
    fn site(&self) -> Site {
        Site::Balance
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![1e-5]]]
    }
    fn brought_out_by(&self) -> &'static str {
        "poses far off the axis, with and without payload; or weighing the parts"
    }
    fn memory(&self) -> Memory<'_> {
        Memory::BicepRate
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        for (i, t) in torque_n_m.iter_mut().enumerate() {
            let [angle, _, acceleration] = along.theta_b[i];
            let needed = along.bicep_m * acceleration - GRAVITY_M_S2 * angle.sin();
            *t -= v[0] * needed / along.bicep_lever[i];
        }
    }
}
