//! Moves parameters until a residual is smallest, and says why it stopped. Has never heard of a film.

pub mod argmin_adapter;
pub mod bounded;
pub mod levenberg_marquardt;
pub mod memory;
pub mod profile;
pub mod separable;
pub mod separable_adapter;
