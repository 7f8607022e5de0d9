//! What the torque on the lozenges is made of.

use minijinja::{Value, context};

use super::page::{Section, safe};
use super::plot::{self, Bar};
use super::{ACTUATORS, Provenance};
use crate::calibration::Outcome;

const TEMPLATE: &str = include_str!("contributions.html");

/// See the module.
pub fn section(outcome: &Outcome, _: &Provenance) -> Option<Section> {
    let shown = outcome
        .recordings
        .iter()
        .filter(|r| !r.contributions_n_m.is_empty());
    let items: Vec<Value> = shown
        .map(|r| {
            let group = |(name, torque): &(String, [f64; 3])| -> (String, Vec<Bar>) {
                let bar = |k: usize| (ACTUATORS[k].1, torque[k] * 1e3);
                (name.clone(), vec![bar(0), bar(1), bar(2)])
            };
            let groups: Vec<_> = r.contributions_n_m.iter().map(group).collect();
            let label = format!("Torque by cause in {}", r.id);
            context! {
                id => r.id.clone(),
                drawing => safe(plot::bars(&label, "torque on the lozenge, mN m rms", &groups)),
            }
        })
        .collect();
    if items.is_empty() {
        return None;
    }
    let context = context! { recordings => items, key => safe(plot::colour_key(&ACTUATORS)) };
    Some(Section::new(
        "contributions",
        "What the voltage works against",
        TEMPLATE,
        context,
    ))
}
