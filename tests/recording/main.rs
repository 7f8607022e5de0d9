//! Importers: files as instruments write them.

mod c3d;
mod captures;
mod files;
mod formats;
mod mcap;
mod mocap;
mod open;
mod random;
mod shared;
mod voltage;
