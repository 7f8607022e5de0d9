//! The room `fit`.

pub mod argmin_adapter;
pub mod levenberg_marquardt;
