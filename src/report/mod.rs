//! The room `report`: shows and writes. A number that is not in the outcome it does not invent.

pub mod ageing_json;
pub mod answer;
pub mod arrays;
pub mod batch;
pub mod controller;
pub mod csv;
pub mod diagnosis_json;
pub mod effect_entries;
pub mod export;
pub mod html;
pub mod json;
pub mod learnt_entry;
pub mod library;
pub mod mcap;
pub mod output;
pub mod parameter_file;
pub mod plan_file;
pub mod proof;
pub mod provenance;
pub mod schema;
pub mod survey;
pub mod terminal;
