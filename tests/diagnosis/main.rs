//! The diagnosis and its proof.

#[path = "../common/mod.rs"]
mod common;

mod cases;
mod chain;
mod line;
mod motion;
