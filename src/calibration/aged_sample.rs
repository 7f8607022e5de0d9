//! A hanging sample over its levels, as the choice of causes sees it.

use std::ops::ControlFlow;

use super::Error;
use super::aged::{Aged, Cause, LevelModel, Minimum, Normal, Place, Slot};
use super::ageing::AgeingRequest;
use super::sample::{noise_of, spread_times, start_film};
use super::sample_problem::{
    Hung, Levels, Prior, Rest, SampleProblem, errors_m, hang_at_first, hang_within, room_of,
};
use crate::dataset::{HangingDataset, OffsetSource};
use crate::film::Film;
use crate::fit::levenberg_marquardt::{self as lm, Resting};
use crate::fit::memory::Memory;
use crate::model::{Electrode, ForearmTorque, HangingSample};

/// Branches of the film.
const BRANCHES: usize = 6;
/// Locking constant that is held.
const LOCKING: f64 = 80.0;
/// A resistance to begin with, ohm.
const START_RESISTANCE_OHM: f64 = 5e6;
/// Scatter of the mounting that is thought of, m: from a marker's repeatability to a clamp set by eye.
const MOUNTS_M: [f64; 2] = [2e-5, 1e-3];
/// Values between these that are weighed.
const MOUNTS: usize = 9;
/// Accuracy of a predicted shift at rest, share of the shifts seen.
const REST_ACCURACY: f64 = 0.05;
/// An aged electrode, on which the step of the integration is settled: a lag asks for a finer one than a film
/// alone.
const AGED: Electrode = Electrode {
    modulus_pa: 2e5,
    resistance_ohm: 3e8,
    active_fraction: 1.0,
};
/// Position at rest beyond the mean of the first frames, m.
const SHIFT_PRIOR_M: f64 = 1e-3;

/// Recordings of one sample.
pub(super) struct AgedSample<'a> {
    hung: Vec<Hung<'a>>,
    /// Of each recording.
    level: Vec<usize>,
    levels: usize,
    film: Film,
    free_offset: Vec<usize>,
    /// Positions at rest of the recordings, m.
    seen_m: Vec<f64>,
    /// Scatter of the mounting where it is known, m.
    mount_m: Option<f64>,
    memory: Memory,
}

impl<'a> AgedSample<'a> {
    /// The recordings `datasets` of `samples`; `level` numbers each one's level, from 0 without a hole.
    ///
    /// # Errors
    /// [`Error`], when the model cannot be run at all.
    pub fn new(
        datasets: &[&'a HangingDataset],
        samples: &[HangingSample],
        level: &[usize],
        request: &AgeingRequest,
    ) -> Result<Self, Error> {
        let film = start_film(spread_times(BRANCHES, datasets), LOCKING);
        let aged: Vec<HangingSample> = samples
            .iter()
            .map(|s| HangingSample {
                electrode: AGED,
                ..*s
            })
            .collect();
        let of = |mut hung: Vec<Hung<'a>>| {
            for (h, sample) in hung.iter_mut().zip(samples) {
                h.sample = *sample;
            }
            AgedSample {
                hung,
                level: level.to_vec(),
                levels: level.iter().max().map_or(0, |m| m + 1),
                film: film.clone(),
                free_offset: (0..datasets.len())
                    .filter(|&r| datasets[r].offset_source == OffsetSource::Free)
                    .collect(),
                seen_m: datasets.iter().map(|d| d.rest_below_m).collect(),
                mount_m: request.mount_m,
                memory: request.memory.clone(),
            }
        };
        // Steps as fine as what the model leaves of the first level asks for, over what noise leaves.
        let look = of(hang_at_first(datasets, &aged, &film)?);
        let room = vec![look.first_room().unwrap_or(1.0); datasets.len()];
        let errors = errors_m(datasets, &room);
        Ok(of(hang_within(datasets, &aged, &film, &errors, 0.0)?))
    }

    /// The recordings of the first level alone, and their fit.
    fn first_fit(&self) -> Result<(Self, Minimum), Error> {
        let own: Vec<usize> = (0..self.hung.len())
            .filter(|&r| self.level[r] == 0)
            .collect();
        let first = AgedSample {
            hung: own.iter().map(|&r| self.hung[r].clone()).collect(),
            level: vec![0; own.len()],
            levels: 1,
            film: self.film.clone(),
            free_offset: (0..own.len())
                .filter(|&i| self.free_offset.contains(&own[i]))
                .collect(),
            seen_m: own.iter().map(|&r| self.seen_m[r]).collect(),
            mount_m: self.mount_m,
            memory: self.memory.clone(),
        };
        let begin = Place {
            causes: Vec::new(),
            slots: vec![Slot::Cause(Cause::SeriesResistance, 0)],
            values: vec![START_RESISTANCE_OHM],
        };
        let Place { slots, values, .. } = first.place(&[], &begin);
        let found = first.minimise(&[], slots, &values, false)?;
        Ok((first, found))
    }

    /// What the model leaves to the steps in the recording of the first level where that is least.
    fn first_room(&self) -> Option<f64> {
        let (first, found) = self.first_fit().ok()?;
        let problem = first.problem_of(&found.place);
        let rows = problem.evaluate(&found.place.values, false).ok()?;
        let room = room_of(&first.hung, &rows);
        room.into_iter().reduce(f64::min)
    }

    fn problem(&self, causes: &[Cause], slots: Vec<Slot>) -> SampleProblem<'_> {
        let priors: Vec<Prior> = slots
            .iter()
            .map(|s| matches!(s, Slot::Shift(_)).then_some((0.0, SHIFT_PRIOR_M)))
            .collect();
        let levels: Vec<Levels> = self
            .level
            .iter()
            .map(|&l| Cause::ALL.map(|c| if causes.contains(&c) { l } else { 0 }))
            .collect();
        SampleProblem::new(&self.hung, self.film.clone(), slots, priors, levels)
    }

    fn problem_of(&self, place: &Place) -> SampleProblem<'_> {
        self.problem(&place.causes, place.slots.clone())
    }

    fn first_of(&self, level: usize) -> usize {
        self.level.iter().position(|l| *l == level).unwrap_or(0)
    }
}

impl Aged for AgedSample<'_> {
    fn levels(&self) -> usize {
        self.levels
    }

    fn rows(&self) -> usize {
        self.hung.iter().map(|h| h.residual.rows()).sum()
    }

    fn common(&self) -> Vec<Slot> {
        let moduli = (0..self.film.mu_pa.len()).map(Slot::Modulus);
        moduli
            .chain((0..self.hung.len()).map(Slot::Shift))
            .chain(self.free_offset.iter().map(|&r| Slot::Offset(r)))
            .collect()
    }

    fn bounds(&self, slot: &Slot) -> [f64; 2] {
        match slot {
            Slot::Cause(cause, _) => cause.bounds(),
            Slot::Modulus(0) => [1e3, 1e9],
            Slot::Modulus(_) => [0.0, 1e9],
            Slot::Offset(r) => [-0.2, 0.2].map(|v| self.hung[*r].offset_s + v),
            _ => [f64::NEG_INFINITY, f64::INFINITY],
        }
    }

    fn start(&self, slot: &Slot) -> f64 {
        match *slot {
            Slot::Modulus(n) => self.film.mu_pa[n],
            Slot::Offset(r) => self.hung[r].offset_s,
            _ => 0.0,
        }
    }

    fn first(&self) -> Result<(Place, usize), Error> {
        let (_, found) = self.first_fit()?;
        let kept = |s: &Slot| matches!(s, Slot::Cause(..) | Slot::Modulus(_));
        let all = found.place.slots.into_iter().zip(found.place.values);
        let (slots, values) = all.filter(|(s, _)| kept(s)).unzip();
        let place = Place {
            causes: Vec::new(),
            slots,
            values,
        };
        Ok((place, found.evaluations))
    }

    fn minimise(
        &self,
        causes: &[Cause],
        slots: Vec<Slot>,
        start: &[f64],
        fine: bool,
    ) -> Result<Minimum, Error> {
        let mut problem = self.problem(causes, slots);
        let mounts = self.mounts();
        problem.rest = (!fine && self.seen_m.len() > 1).then(|| Rest {
            seen_m: self.seen_m.clone(),
            sd_m: mounts[mounts.len() / 2],
        });
        let options = lm::Options {
            bounds: problem.slots.iter().map(|s| self.bounds(s)).collect(),
            iteration_limit: 60,
            // The square of the first times the cost is what a step would still save: 0.1 of chi^2 in a
            // thousand rows, 1e-5 in the last fit.
            gradient_tolerance: if fine { 1e-4 } else { 1e-2 },
            step_tolerance: 1e-8,
            cost_tolerance: if fine { 1e-9 } else { 1e-6 },
            polish_limit: 0,
            ..lm::Options::default()
        };
        let go_on = |_: &lm::State| ControlFlow::Continue(());
        let tag = format!("{causes:?}");
        let outcome = (self.memory)
            .least_squares(&tag, &problem, start, &options, go_on)
            .map_err(|misuse| Error::NothingToFit(misuse.to_string()))?;
        if !outcome.cost.is_finite() {
            return Err(Error::AllStartsFailed {
                tried: 1,
                last: outcome.last_failure.map(|f| f.message).unwrap_or_default(),
            });
        }
        Ok(Minimum {
            resting: outcome
                .resting
                .iter()
                .map(|r| matches!(r, Resting::Lower | Resting::Upper))
                .collect(),
            evaluations: outcome.evaluations + outcome.jacobian_evaluations,
            converged: outcome.reason.converged(),
            place: Place {
                causes: causes.to_vec(),
                slots: problem.slots,
                values: outcome.parameters,
            },
        })
    }

    fn normal(&self, place: &Place) -> Result<Normal, Error> {
        Ok(self.problem_of(place).normal(&place.values, &self.seen_m)?)
    }

    fn noise(&self, place: &Place) -> Result<[f64; 2], Error> {
        let ended = self.problem_of(place).evaluate(&place.values, false)?;
        let (square, inflation) = noise_of(
            ended.iter().map(|r| r.residuals.as_slice()),
            place.slots.len(),
        );
        Ok([square, inflation])
    }

    fn possible(&self, place: &Place) -> bool {
        let problem = self.problem_of(place);
        (0..self.hung.len()).all(|r| {
            let s = problem.setting(r, &place.values);
            let residual = &self.hung[r].residual;
            let length = residual.rest_length_m(&s.sample, &s.film, s.offset_s);
            length.is_ok()
        })
    }

    /// Standard deviations of a length at rest that are weighed, m: the mounting's scatter, from exact to
    /// loose, and the accuracy of the model.
    fn mounts(&self) -> Vec<f64> {
        let n = self.seen_m.len() as f64;
        let mean = self.seen_m.iter().sum::<f64>() / n;
        let spread = self.seen_m.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let model = REST_ACCURACY * spread.sqrt();
        if let Some(mount) = self.mount_m {
            return vec![mount.max(MOUNTS_M[0]).hypot(model)];
        }
        let ratio = (MOUNTS_M[1] / MOUNTS_M[0]).powf(1.0 / (MOUNTS - 1) as f64);
        (0..MOUNTS)
            .map(|i| (MOUNTS_M[0] * ratio.powi(i as i32)).hypot(model))
            .collect()
    }

    fn level(&self, place: &Place, level: usize) -> Result<LevelModel, Error> {
        let problem = self.problem_of(place);
        let first = self.first_of(level);
        let s = problem.setting(first, &place.values);
        let residual = &self.hung[first].residual;
        Ok(LevelModel {
            film_factor: s.film_factor,
            electrode: s.sample.electrode,
            mass_kg: s.sample.mass_kg,
            eps_r: s.sample.eps_r,
            rest_length_m: Some(residual.rest_length_m(&s.sample, &s.film, s.offset_s)?),
        })
    }

    fn film(&self, place: &Place) -> (Film, Option<ForearmTorque>) {
        let s = self
            .problem_of(place)
            .setting(self.first_of(0), &place.values);
        let mut film = s.film;
        for mu in &mut film.mu_pa {
            *mu /= s.film_factor;
        }
        (film, None)
    }
}
