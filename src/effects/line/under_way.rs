//! A cause with a memory that was under way when recordings began: it has further values, one for each of
//! them, of what the memory held then. With it such beginnings are found; no catalogue lists it.

use super::super::{Acting, Effect, Quantity};
use super::{LineEffect, Terms, View, by_id, law};

/// A cause with what its memory held where recordings begin.
pub(crate) struct UnderWay {
    own: &'static dyn LineEffect,
    /// Numbers of the recordings in the series.
    recordings: Vec<usize>,
    quantities: &'static [Quantity],
}

impl UnderWay {
    /// What the memory of a cause may hold where a recording begins, beyond what the beginning makes; `None`
    /// of one that has none, or forgets soon.
    pub fn held(acting: &Acting) -> Option<Quantity> {
        by_id(acting.effect.id())?.held(&acting.values)
    }

    /// `acting` with what its memory held where each of `recordings` begins. It lasts as long as the program
    /// runs: [`Acting`] refers to it. `None` where nothing can be held.
    pub fn beside(acting: &Acting, recordings: &[usize], held: &[f64]) -> Option<Acting> {
        let quantity = UnderWay::held(acting)?;
        let own = by_id(acting.effect.id())?;
        let all = own.parameters().iter().copied();
        let all: Vec<Quantity> = all.chain(recordings.iter().map(|_| quantity)).collect();
        let plain = &acting.values[..own.parameters().len()];
        Some(Acting {
            effect: Box::leak(Box::new(UnderWay {
                own,
                recordings: recordings.to_vec(),
                quantities: all.leak(),
            })),
            values: [plain, held].concat(),
            on: acting.on,
        })
    }

    /// The cause alone, as the catalogue has it, and what its memory held where recordings began: their
    /// numbers in the series, and values.
    pub fn apart(acting: &Acting) -> (Acting, Vec<(usize, f64)>) {
        let Some(own) = by_id(acting.effect.id()) else {
            return (acting.clone(), Vec::new());
        };
        let (values, held) = acting.values.split_at(own.parameters().len());
        let alone = Acting {
            effect: own,
            values: values.to_vec(),
            on: acting.on,
        };
        let numbers = acting.effect.under_way().iter().copied();
        (alone, numbers.zip(held.iter().copied()).collect())
    }
}

impl Effect for UnderWay {
    fn id(&self) -> &'static str {
        self.own.id()
    }
    fn says(&self) -> &'static str {
        self.own.says()
    }
    fn source(&self) -> &'static str {
        self.own.source()
    }
    fn equation(&self) -> &'static str {
        self.own.equation()
    }
    fn parameters(&self) -> &'static [Quantity] {
        self.quantities
    }
    fn variants(&self) -> &'static [&'static str] {
        self.own.variants()
    }
    fn under_way(&self) -> &[usize] {
        &self.recordings
    }
    fn brought_out_by(&self) -> &'static str {
        self.own.brought_out_by()
    }
    fn line(&self, v: &[f64], view: &View, terms: &mut Terms) {
        let (own, held) = v.split_at(v.len() - self.recordings.len());
        let number = self.recordings.iter();
        let found = number.zip(held).find(|(n, _)| **n == view.recording);
        let at = View {
            held: found.map_or(0.0, |(_, held)| *held),
            ..*view
        };
        self.own.line(own, &at, terms);
    }
    fn law(&self) -> Option<&dyn law::Forward> {
        self.own.law()
    }
}
