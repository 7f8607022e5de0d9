//! The room `recording`.
