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
    fn over_series(&self, v: &[f64]) -> bool {
        self.own.over_series(v)
    }
    fn sees_elastic(&self) -> bool {
        self.own.sees_elastic()
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

#[cfg(test)]
mod tests {
    use super::super::every;
    use super::*;

    /// A cause that was under way is the cause itself where its memory held nothing, and another where it did.
    #[test]
    fn what_was_not_under_way_is_the_cause_itself() {
        let time_s: Vec<f64> = (0..300).map(|i| 0.02 * f64::from(i)).collect();
        let xi: Vec<f64> = time_s.iter().map(|t| 0.6 * (2.0 * t).sin()).collect();
        let rate: Vec<f64> = time_s.iter().map(|t| 1.2 * (2.0 * t).cos()).collect();
        let elastic: Vec<f64> = xi.iter().map(|x| 0.8 * x).collect();
        let still = vec![0.0; 300];
        let view = View {
            recording: 4,
            held: 0.0,
            timed: true,
            time_s: &time_s,
            step_s: 0.02,
            duration_s: 5.98,
            series_s: 0.0,
            unstrained: false,
            straight: true,
            xi: &xi,
            way: &xi,
            rate: &rate,
            speed: 1.2,
            acceleration: &still,
            inertial: true,
            elastic: &elastic,
            second: &still,
        };
        let does = |acting: &Acting| -> Vec<u64> {
            let mut terms = Terms {
                xi: xi.clone(),
                factor: vec![[1.0; 2]; 300],
                force: still.clone(),
                input: xi.clone(),
                input_step_s: 0.02,
                gain: vec![1.0; 300],
                shift_s: 0.0,
            };
            acting.effect.line(&acting.values, &view, &mut terms);
            let factors = terms.factor.iter().flatten();
            let all = terms.xi.iter().chain(factors).chain(&terms.force);
            all.map(|v| v.to_bits()).collect()
        };
        let mut remember = 0;
        for effect in every() {
            let values = effect.near(&view)[0][0].clone();
            let alone = Acting {
                effect,
                values,
                on: [true; 3],
            };
            let Some(q) = UnderWay::held(&alone) else {
                assert!(UnderWay::beside(&alone, &[4], &[0.0]).is_none());
                continue;
            };
            remember += 1;
            let with = |number: usize, held: f64| {
                UnderWay::beside(&alone, &[number], &[held]).expect("it remembers")
            };
            let own = does(&alone);
            assert_eq!(own, does(&with(4, q.off)), "{}", effect.id());
            assert_eq!(own, does(&with(3, 0.5 * q.upper)), "{}", effect.id());
            assert_ne!(own, does(&with(4, 0.9 * q.upper)), "{}", effect.id());
            let begun = with(4, 0.5 * q.upper);
            let of = |e: &dyn Effect, v: &[f64]| {
                let acts = (e.site(), e.reach(), e.drives(), e.lags());
                (acts, e.sees_elastic(), e.over_series(v), e.variants())
            };
            assert!(of(begun.effect, &begun.values) == of(effect, &alone.values));
            let (again, held) = UnderWay::apart(&begun);
            assert_eq!((again, held), (alone.clone(), vec![(4, 0.5 * q.upper)]));
        }
        assert_eq!(remember, 4);
    }
}
