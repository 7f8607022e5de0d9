//! Importers: files as instruments write them.

#[path = "../mocap/mod.rs"]
mod mocap;

mod c3d;
mod captures;
mod files;
mod formats;
mod mcap;
mod open;
mod random;
mod shared;
mod voltage;
