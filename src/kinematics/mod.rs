//! The room `kinematics`.
