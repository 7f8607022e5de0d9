//! A recording that is longer than a fit can hold: stretches of it that are compared, spread evenly, and the
//! motion between them, through which the film's history runs.

use std::sync::Arc;

use super::{Dataset, StretchPlan, Vec3};

/// Frames that a fit holds, over all of its recordings: a good hour at 100 Hz.
pub const FRAMES: usize = 400_000;
/// Length of a stretch, s: minutes hold whole cycles of the drives that are met.
const LENGTH_S: f64 = 60.0;
/// Frames of a stretch at least, whatever the rate.
const SHORTEST: usize = 64;
/// Stretches that a recording has at least: beginning, end, and one between.
const FEWEST: usize = 3;
/// Voltages are kept so far beyond the ends of a stretch, s: a free clock offset wanders by less.
const BESIDE_S: f64 = 1.0;
/// The golden ratio less one.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Frames that follow one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    /// Its first frame in the whole recording.
    pub first: usize,
    /// Its first frame among those of all stretches.
    pub at: usize,
    /// Number of frames.
    pub length: usize,
}

/// The motion between two stretches, with the last frame of the one and the first of the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Between {
    /// First frame, among those of the stretches, of the one that follows.
    pub before: usize,
    /// Smoothed positions, m.
    pub position_m: Vec<Vec3>,
    /// Smoothed velocities, m/s.
    pub velocity_m_s: Vec<Vec3>,
}

/// Which frames of a recording a dataset has, where it does not have all.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub stretches: Vec<Stretch>,
    pub between: Arc<Vec<Between>>,
    /// Frames of the whole recording.
    pub frames: usize,
}

impl Stretch {
    /// Its frames in the whole recording.
    pub(super) fn frames(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.length
    }

    /// The values of the frames of `stretches`.
    pub(super) fn pick<T: Clone>(stretches: &[Stretch], list: &[T]) -> Vec<T> {
        (stretches.iter())
            .flat_map(|s| list[s.frames()].iter().cloned())
            .collect()
    }

    /// Place of a frame of the whole recording among those of `stretches`.
    pub(super) fn place(stretches: &[Stretch], frame: usize) -> Option<usize> {
        let s = stretches.iter().find(|s| s.frames().contains(&frame))?;
        Some(s.at + frame - s.first)
    }
}

/// `count` stretches of `length` frames: the first begins with the recording and the last ends with it; of
/// the others each lies within its equal share of the whole, at places (by the golden ratio) that keep no
/// step with a drive that repeats.
fn spread(frames: usize, length: usize, count: usize) -> Vec<Stretch> {
    let room = frames as f64 / count as f64 - length as f64;
    let mut out: Vec<Stretch> = Vec::new();
    for i in 0..count {
        let first = match i {
            0 => 0,
            i if i + 1 == count => frames - length,
            i => {
                let share = (i as f64 * GOLDEN).fract();
                (i as f64 * frames as f64 / count as f64 + share * room) as usize
            }
        };
        match out.last_mut() {
            Some(before) if before.first + before.length == first => before.length += length,
            _ => out.push(Stretch {
                first,
                at: i * length,
                length,
            }),
        }
    }
    out
}

/// For each of `datasets` the stretches that a fit to all of them compares, where it cannot hold every frame;
/// `None` where it takes the whole. A plan in which an earlier run wrote them down comes first.
pub fn stretches(datasets: &[&Dataset]) -> Vec<Option<StretchPlan>> {
    let all: usize = datasets.iter().map(|d| d.samples()).sum();
    let choose = |d: &&Dataset| {
        let length = (LENGTH_S / d.step_s).max(SHORTEST as f64);
        let share = FRAMES as f64 / all as f64;
        let count = (share * d.samples() as f64 / length) as usize;
        let fits = |count: usize| (count as f64) * length < d.samples() as f64;
        let count = count.max(FEWEST);
        (all > FRAMES && fits(count)).then_some(StretchPlan {
            count,
            length_s: LENGTH_S,
        })
    };
    (datasets.iter())
        .map(|d| d.plan.stretches.or_else(|| choose(d)))
        .collect()
}

impl Dataset {
    /// The frames of some stretches alone. The motion between them is kept for the film's history; all that
    /// was chosen looking at the whole (smoothing, noise, gaps, clocks) stays.
    ///
    /// # Panics
    /// When there are already stretches.
    pub fn in_stretches(&self, plan: StretchPlan) -> Self {
        assert!(self.part.is_none(), "a dataset is cut into stretches once");
        let frames = self.samples();
        let length = ((plan.length_s / self.step_s).round() as usize)
            .max(SHORTEST)
            .min(frames);
        let count = plan.count.clamp(1, frames / length);
        let stretches = spread(frames, length, count);
        let pick_vec = |list: &[Vec3]| Stretch::pick(&stretches, list);
        let axes = [0, 1, 2].map(|k| self.axes[k].stretches(&stretches));
        let mut film_unknown = Stretch::pick(&stretches, &self.film_unknown);
        let between = (stretches.windows(2))
            .map(|pair| {
                // no window of the residual's filter reaches over a seam
                film_unknown[pair[1].at] = true;
                let way = || pair[0].first + pair[0].length - 1..=pair[1].first;
                let rows = |of: fn(&super::SmoothedAxis) -> &Vec<f64>| {
                    way()
                        .map(|i| [0, 1, 2].map(|k| of(&self.axes[k])[i]))
                        .collect()
                };
                Between {
                    before: pair[1].at,
                    position_m: rows(|a| &a.position),
                    velocity_m_s: rows(|a| &a.velocity),
                }
            })
            .collect();
        let heard = |offset_s: f64| -> Vec<[f64; 2]> {
            (stretches.iter())
                .map(|s| {
                    let end = s.first + s.length - 1;
                    [
                        self.time_s(s.first) + offset_s - BESIDE_S,
                        self.time_s(end) + offset_s + BESIDE_S,
                    ]
                })
                .collect()
        };
        let heard = heard(self.offset_s);
        let mut plan_of = self.plan.clone();
        plan_of.stretches = Some(plan);
        Dataset {
            id: self.id.clone(),
            step_s: self.step_s,
            start_s: self.start_s,
            measured_m: pick_vec(&self.measured_m),
            axes,
            usable: Stretch::pick(&stretches, &self.usable),
            film_unknown,
            payload_kg: Stretch::pick(&stretches, &self.payload_kg),
            voltage: self.voltage.within(&heard),
            monitor: self.monitor.as_ref().map(|m| m.within(&heard)),
            offset_s: self.offset_s,
            offset_source: self.offset_source,
            initial: self.initial,
            colour: self.colour,
            wander: self.wander,
            pivot_m: self.pivot_m,
            plan: plan_of,
            notes: self.notes.clone(),
            bridges: self.bridges.as_ref().and_then(|b| b.stretches(&stretches)),
            thinned: None,
            part: Some(Part {
                between: Arc::new(between),
                frames,
                stretches,
            }),
        }
    }

    /// Runs of frames that follow one another: first frame here, its time on the motion clock (s), number of
    /// frames.
    pub fn runs(&self) -> Vec<(usize, f64, usize)> {
        match &self.part {
            None => vec![(0, self.start_s, self.samples())],
            Some(part) => (part.stretches.iter())
                .map(|s| (s.at, self.start_s + self.step_s * s.first as f64, s.length))
                .collect(),
        }
    }

    /// The motion between the runs.
    pub fn between(&self) -> &[Between] {
        self.part.as_ref().map_or(&[], |p| &p.between)
    }

    /// Length of the whole recording, s.
    pub fn length_s(&self) -> f64 {
        let frames = self.part.as_ref().map_or(self.samples(), |p| p.frames);
        self.step_s * frames as f64
    }

    /// Frame of the whole recording.
    pub(super) fn frame(&self, sample: usize) -> usize {
        match &self.part {
            None => sample,
            Some(part) => {
                let number = part.stretches.partition_point(|s| s.at <= sample);
                let s = part.stretches[number.max(1) - 1];
                s.first + sample - s.at
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_begin_and_end_with_the_recording_and_never_overlap() {
        for (frames, length, count) in [
            (1000, 10, 3),
            (1000, 10, 100),
            (999, 10, 99),
            (4_320_000, 6000, 60),
        ] {
            let s = spread(frames, length, count);
            assert_eq!(s[0].first, 0);
            let last = s[s.len() - 1];
            assert_eq!(last.first + last.length, frames);
            for pair in s.windows(2) {
                assert!(pair[0].first + pair[0].length < pair[1].first, "{pair:?}");
                assert_eq!(pair[0].at + pair[0].length, pair[1].at);
            }
            assert_eq!(s.iter().map(|s| s.length).sum::<usize>(), length * count);
        }
    }
}
