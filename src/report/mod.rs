//! The room `report`: shows and writes. A number that is not in the outcome it does not invent.

pub mod output;
pub mod parameter_file;
pub mod provenance;
