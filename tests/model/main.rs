//! The model, its effects and the golden numbers.

#[path = "../common/mod.rs"]
mod common;

mod effects;
mod effects_forward;
mod golden_film;
mod golden_forward;
mod golden_kinematics;
mod golden_model;
