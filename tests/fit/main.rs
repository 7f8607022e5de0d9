//! Fits: what comes out is what went in, with intervals that hold.

#[path = "../common/mod.rs"]
mod common;

mod ageing;
mod campaign;
mod clocks;
mod coupon;
mod identification;
mod intervals;
mod nist;
mod sample;
