//! The room `calibration`.
