//! The room `residual`.
