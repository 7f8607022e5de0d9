//! The room `parameter`.
