//! Calibrates dielectric-elastomer actuators from recordings of motion and voltage. `ARCHITECTURE.md` says
//! which room does what; the program is a thin shell over this library.
pub mod calibration;
pub mod cases;
pub mod checks;
pub mod cli;
pub mod dataset;
pub mod diagnosis;
pub mod effects;
pub mod film;
pub mod fit;
pub mod jobs;
pub mod kinematics;
pub mod model;
pub mod parameter;
pub mod proof;
pub mod recording;
pub mod report;
pub mod residual;
pub mod simulate;
pub mod units;
pub mod validation;
