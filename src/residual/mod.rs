//! Predicted minus recorded, weighted: the only minus sign between the two.
//!
//! The residual of chain k is a torque on its lozenge: what the motion needs (film, forearms, weights, inertia) minus what the
//! commanded voltage makes there (1/2 C' phi^2). Divided by C' phi it is, to first order, the error of the predicted voltage;
//! weighted by its own noise it is the same number whichever of the two it is written in. As a torque it is linear in moduli
//! and nodal torques, has no root, and is as well behaved near 0 V as anywhere.

mod coupon;
mod decimate;
mod gram;
mod normal;
mod robot;
mod sample;

pub use coupon::{CouponLocked, CouponResidual};
pub use decimate::Decimation;
pub use normal::{Normal, SeparableResidual, Slope};
pub use robot::{Layout, RobotResidual, VoltageError};
pub(crate) use robot::{OFFSET_REACH_S, root_v};
pub use sample::{
    MOST_BRANCHES, SampleInverse, SampleKnob, SampleResidual, SampleRows, SampleRun, SampleTrouble,
    command_for_v, film_voltage_v, inverse_sample, run_sample,
};
