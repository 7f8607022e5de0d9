//! The room `fit`.

pub mod levenberg_marquardt;
