//! The room `report`.
pub mod html;
