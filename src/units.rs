//! SI at the door: constants, and the conversions between the units that files carry and SI.

/// Standard acceleration of gravity, m/s^2 (model.md section 1).
pub const GRAVITY_M_S2: f64 = 9.80665;
/// Vacuum permittivity, F/m (model.md section 3).
pub const VACUUM_PERMITTIVITY_F_M: f64 = 8.8541878128e-12;
