//! Commands as a user types them.

#[path = "../common/mod.rs"]
mod common;

mod bad_numbers;
mod checks;
mod command_line;
mod controller;
mod simulate;
mod simulate_command;
