//! Predicted minus recorded, weighted: the only minus sign between the two.
//!
//! The residual of chain k is a torque on its lozenge: what the motion needs (film, forearms, weights,
//! inertia) minus what the commanded voltage makes there (1/2 C' phi^2). Divided by C' phi it is, to first
//! order, the error of the predicted voltage; weighted by its own noise it is the same number whichever of
//! the two it is written in. As a torque it is linear in moduli and nodal torques, has no root, and is as
//! well behaved near 0 V as anywhere.

mod coupon;
mod decimate;
mod gram;
pub mod line;
pub mod motion;
mod normal;
mod robot;
mod sample;

pub use coupon::{CouponLocked, CouponResidual};
pub use decimate::Decimation;
pub use normal::{Normal, SeparableResidual, Slope};
pub use robot::{
    Chains, Departure, DepartureTorques, ExpectedScore, Layout, RobotResidual, VoltageError,
    frames_apart,
};
pub(crate) use robot::{OFFSET_REACH_S, root_v};
pub(crate) use sample::deviation;
pub use sample::{
    Bounce, MOST_BRANCHES, SampleInverse, SampleKnob, SampleResidual, SampleRows, SampleRun,
    SampleTrouble, Steps, command_for_v, film_voltage_v, inverse_sample, run_sample,
};

/// Correlation length of residuals in a row, in residuals: 1 + 2 sum of their autocorrelation until that
/// falls below 0.05. So many of them say as much as one that is independent.
#[must_use]
pub fn correlation_length(residual: &[f64]) -> f64 {
    let n = residual.len();
    let total: f64 = residual.iter().map(|r| r * r).sum();
    let mut length = 1.0;
    if total > 0.0 {
        for lag in 1..n / 4 {
            let rho: f64 = residual
                .windows(lag + 1)
                .map(|w| w[0] * w[lag])
                .sum::<f64>()
                / total;
            if rho < 0.05 {
                break;
            }
            length += 2.0 * rho;
        }
    }
    length
}
