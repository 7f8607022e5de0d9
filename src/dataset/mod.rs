//! The room `dataset`.
