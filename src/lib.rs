//! deacal
pub mod calibration;
pub mod cli;
pub mod dataset;
pub mod film;
pub mod fit;
pub mod kinematics;
pub mod model;
pub mod parameter;
pub mod recording;
pub mod report;
pub mod residual;
pub mod simulate;
pub mod units;
