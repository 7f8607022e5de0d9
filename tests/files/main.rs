//! Files that the program writes and reads again.

#[path = "../common/mod.rs"]
mod common;

mod coupon;
mod diagnosis;
mod export;
mod parameters;
mod recordings;
mod schemas;
