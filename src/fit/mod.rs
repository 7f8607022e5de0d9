//! The room `fit`.

pub mod argmin_adapter;
pub mod bounded;
pub mod levenberg_marquardt;
pub mod separable;
