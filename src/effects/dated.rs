//! A cause that acts over the series, beside which it is open when some recordings were made: it has further
//! values, one for each of them, by how much later it was made than is assumed. With it such times are found;
//! no catalogue lists it.

use super::{Acting, Along, Effect, Quantity, Reach, Site, shape};
use crate::film::Film;

/// How far off, s, the time of a recording may be about which nothing is stated.
const FARTHEST_S: f64 = 110.0;

/// A cause with the times of recordings.
pub(crate) struct Dated {
    own: &'static dyn Effect,
    /// Numbers of the recordings in the series.
    recordings: Vec<usize>,
    quantities: &'static [Quantity],
}

impl Dated {
    /// What is known of when a recording was made about whose time nothing is stated: one standard deviation,
    /// s. Recordings of a sitting follow each other within minutes.
    pub const SPREAD_S: f64 = 60.0;

    /// `acting` with these recordings' times beside it, by so much later, s. It lasts as long as the program
    /// runs: [`Acting`] refers to it.
    pub fn beside(acting: &Acting, recordings: &[usize], later_s: &[f64]) -> Acting {
        let own = acting.effect;
        let later = shape("later", "s", 0.0, -FARTHEST_S, FARTHEST_S, Dated::SPREAD_S);
        let all = own.parameters().iter().copied();
        let all: Vec<Quantity> = all.chain(recordings.iter().map(|_| later)).collect();
        Acting {
            effect: Box::leak(Box::new(Dated {
                own,
                recordings: recordings.to_vec(),
                quantities: all.leak(),
            })),
            values: [&acting.values, later_s].concat(),
            on: acting.on,
        }
    }

    /// Its cause's own values, and the cause along a recording as it was made by these.
    fn as_made<'a>(&self, v: &'a [f64], along: &Along<'a>) -> (&'a [f64], Along<'a>) {
        let (own, later) = v.split_at(v.len() - self.recordings.len());
        let mut at = *along;
        let number = self.recordings.iter();
        let number = number.zip(later).find(|(n, _)| **n == at.when.recording);
        at.when.series_s += number.map_or(0.0, |(_, later_s)| *later_s);
        (own, at)
    }
}

impl Effect for Dated {
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
    fn site(&self) -> Site {
        self.own.site()
    }
    fn reach(&self) -> Reach {
        self.own.reach()
    }
    fn over_series(&self, _: &[f64]) -> bool {
        true
    }
    fn brought_out_by(&self) -> &'static str {
        self.own.brought_out_by()
    }
    fn stress(&self, v: &[f64], along: &Along, film: &Film, factor: &mut [[f64; 2]]) {
        let (own, at) = self.as_made(v, along);
        self.own.stress(own, &at, film, factor);
    }
    fn torque(&self, v: &[f64], along: &Along, torque_n_m: &mut [f64]) {
        let (own, at) = self.as_made(v, along);
        self.own.torque(own, &at, torque_n_m);
    }
}
