//! A dataset of every so many-th frame, for what is worked out behind a low-pass: the motion was smoothed at
//! all of them, and what the capture leaves open is drawn at all of them.

use std::borrow::Cow;
use std::sync::Arc;

use super::{Dataset, Track};

/// Every how many-th frame of which dataset.
#[derive(Debug, Clone)]
pub(super) struct Thinned {
    pub whole: Arc<Dataset>,
    every: usize,
}

/// Every so many-th of a list.
pub(super) fn pick<T: Clone>(list: &[T], every: usize) -> Vec<T> {
    list.iter().step_by(every).cloned().collect()
}

impl Thinned {
    /// A track of the whole dataset, at the frames that are kept.
    pub fn of(&self, track: &Track) -> Track {
        Track {
            step_s: self.every as f64 * track.step_s,
            position_m: pick(&track.position_m, self.every),
            velocity_m_s: pick(&track.velocity_m_s, self.every),
            acceleration_m_s2: pick(&track.acceleration_m_s2, self.every),
            payload_kg: pick(&track.payload_kg, self.every),
            initial: track.initial,
        }
    }
}

impl Dataset {
    /// Every `every`-th frame, from the first. A dataset in stretches stays as it is.
    pub fn thinned(&self, every: usize) -> Cow<'_, Dataset> {
        if every <= 1 || self.part.is_some() {
            return Cow::Borrowed(self);
        }
        // what is not known of the film between two frames that are kept is not known at them
        let last = self.film_unknown.len() - 1;
        let unknown = |i: usize| {
            let near = i.saturating_sub(every - 1)..=(i + every - 1).min(last);
            self.film_unknown[near].contains(&true)
        };
        let whole = Arc::new(self.clone());
        Cow::Owned(Dataset {
            step_s: every as f64 * self.step_s,
            measured_m: pick(&self.measured_m, every),
            axes: (self.axes.each_ref()).map(|a| a.thinned(every)),
            usable: pick(&self.usable, every),
            film_unknown: (0..=last).step_by(every).map(unknown).collect(),
            payload_kg: pick(&self.payload_kg, every),
            bridges: None, // the whole dataset has them
            thinned: Some(Thinned { whole, every }),
            ..self.clone()
        })
    }

    /// The dataset with all frames.
    pub fn whole(&self) -> &Dataset {
        self.thinned.as_ref().map_or(self, |t| &t.whole)
    }
}
