//! A robot over its levels, as the choice of causes sees it: one film and one forearm curve, and electrodes
//! that age alike on all actuators.
//!
//! Each level is a [`RobotResidual`] of its own, with the causes as effects of the catalogue; what the levels
//! share is the same column in all. The sum stays separable: a factor on the film multiplies the columns of
//! its moduli,
//!
//! ```text
//! r_l = B_l(eta, causes_l) diag(factor_l, 1) beta - d_l(eta, causes_l)
//! ```
//!
//! so that `fit::separable` solves it as it solves one recording. The pose is measured against the base, and
//! a robot is not hung anew: the pose at rest is part of the residual.

use std::ops::ControlFlow;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::Error;
use super::aged::{Aged, Cause, LevelModel, Minimum, Normal, Place, Slot};
use super::robot::{Request, Stage, open, parameters, starts, unknown};
use super::sample::noise_of;
use crate::dataset::{Dataset, OffsetSource};
use crate::effects::{Acting, Quantity, When};
use crate::film::{Film, Locked};
use crate::fit::memory::Memory;
use crate::fit::separable::{Options, State, Unknown};
use crate::model::{Electrode, ForearmTorque, Robot};
use crate::residual::{self, RobotResidual, SeparableResidual, Slope};

/// Starts of the first level's film.
const STARTS: usize = 4;
/// Rounds of weights, because the noise gain depends on the film.
const ROUNDS: usize = 2;
/// How far the search goes from off, in a cause's range.
const REACH: f64 = 6.0;
/// A resistance to begin with, ohm.
const START_RESISTANCE_OHM: f64 = 1e6;
/// Before every first sample: a change that has happened on a level when that begins, s.
pub const LONG_AGO_S: f64 = -1e6;

/// Recordings of one robot.
pub(super) struct AgedRobot<'a> {
    /// Of each level, without causes.
    levels: Vec<RobotResidual<'a>>,
    /// Unknowns that are no cause: nonlinear ones first.
    common: Vec<(Slot, Unknown)>,
    /// How many of them are nonlinear.
    nonlinear: usize,
    /// End effector and payload as stated, kg.
    mass_kg: f64,
    eps_r: f64,
    /// Film and resistance of the first level by itself, and the evaluations spent on it.
    begin: (Place, usize),
    memory: Memory,
}

/// A level within a model.
struct Day<'a> {
    residual: RobotResidual<'a>,
    /// Its nonlinear unknowns from those of the model: place there, factor, and what is added.
    eta: Vec<(usize, f64, f64)>,
    /// Place of the factor on its film.
    factor: Option<usize>,
}

/// All levels with the same film.
struct Days<'a> {
    days: Vec<Day<'a>>,
    /// Number of moduli: the first linear unknowns.
    moduli: usize,
}

impl Day<'_> {
    /// Its own nonlinear and linear unknowns, and the factor on its film.
    fn at(&self, moduli: usize, eta: &[f64], beta: &[f64]) -> (Vec<f64>, Vec<f64>, f64) {
        let own = self.eta.iter().map(|&(j, by, plus)| plus + by * eta[j]);
        let factor = self.factor.map_or(1.0, |j| eta[j]);
        let mut scaled = beta.to_vec();
        scaled[..moduli].iter_mut().for_each(|mu| *mu *= factor);
        (own.collect(), scaled, factor)
    }
}

impl SeparableResidual for Days<'_> {
    type Error = Locked;

    fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<residual::Normal, Locked> {
        let moduli = self.moduli;
        let parts: Vec<(residual::Normal, f64)> = self
            .days
            .par_iter()
            .map(|day| {
                let (own, scaled, factor) = day.at(moduli, eta, reference);
                Ok((day.residual.evaluate(&own, &scaled)?, factor))
            })
            .collect::<Result<_, Locked>>()?;
        // Columns of each level as combinations of those of the whole.
        let mut slopes: Vec<Slope> = Vec::new();
        let mut place = |slope: Slope| {
            let known = slopes.iter().position(|s| *s == slope);
            known.unwrap_or_else(|| {
                slopes.push(slope);
                slopes.len() - 1
            })
        };
        let linear = reference.len();
        let mut combined: Vec<Vec<(usize, usize, f64)>> = Vec::new();
        for (day, (normal, factor)) in self.days.iter().zip(&parts) {
            let by = |i: usize| if i < moduli { *factor } else { 1.0 };
            let mut own: Vec<(usize, usize, f64)> = (0..linear).map(|i| (i, i, by(i))).collect();
            for (s, slope) in normal.slopes.iter().enumerate() {
                let (nonlinear, inner, _) = day.eta[slope.nonlinear];
                let to = place(Slope {
                    nonlinear,
                    ..*slope
                });
                own.push((
                    linear + s,
                    linear + to,
                    inner * slope.linear.map_or(1.0, by),
                ));
            }
            if let Some(nonlinear) = day.factor {
                for i in 0..moduli {
                    let to = place(Slope {
                        nonlinear,
                        linear: Some(i),
                    });
                    own.push((i, linear + to, 1.0));
                }
            }
            combined.push(own);
        }
        let size = linear + slopes.len() + 1;
        let mut gram = DMatrix::zeros(size, size);
        for ((normal, _), own) in parts.iter().zip(combined) {
            let rows = normal.gram.nrows();
            let mut combine = DMatrix::zeros(rows, size);
            for (from, to, by) in own {
                combine[(from, to)] += by;
            }
            combine[(rows - 1, size - 1)] = 1.0;
            gram += combine.tr_mul(&(&normal.gram * &combine));
        }
        Ok(residual::Normal {
            gram,
            slopes,
            reference: reference.to_vec(),
            rows: parts.iter().map(|p| p.0.rows).sum(),
        })
    }
}

/// A cause as an effect of the catalogue that lasts, at 0. A factor on the film is none.
fn acting(cause: Cause) -> Option<Acting> {
    let effect = cause.effect()?;
    let value = |q: &Quantity| if q.name == "time" { LONG_AGO_S } else { 0.0 };
    Some(Acting {
        effect,
        values: effect.parameters().iter().map(value).collect(),
        on: [true; 3],
    })
}

impl<'a> AgedRobot<'a> {
    /// The recordings `datasets` of `robot`; `level` numbers each one's level, from 0 without a hole. Fits
    /// the film of the first level, by whose noise everything is weighed.
    ///
    /// # Errors
    /// [`Error`]: the mechanism cannot follow, or the film of the first level cannot be fitted at all.
    pub fn new(
        robot: &'a Robot,
        datasets: &[&'a Dataset],
        level: &[usize],
        memory: &Memory,
    ) -> Result<Self, Error> {
        let levels = level.iter().max().map_or(0, |m| m + 1);
        let of = |l: usize| -> Vec<usize> { (0..level.len()).filter(|&r| level[r] == l).collect() };
        let mut first = Self::plain(robot, datasets, &[of(0)], memory)?;
        let request = Request {
            starts: STARTS,
            ..Request::new(Stage::Robot)
        };
        let slots = first.slots(&[]);
        let (unknowns, split) = first.unknowns(&slots);
        let begins = starts(&unknowns[..split], &request);
        let values = |eta: Vec<f64>| -> Vec<f64> {
            let linear = unknowns[split..].iter().map(|u| u.start);
            eta.into_iter().chain(linear).collect()
        };
        let tried = begins.len();
        let mut found = begins
            .into_par_iter()
            .filter_map(|(_, eta)| {
                let (state, _) = first.search(&[], &slots, &values(eta), false).ok()?;
                state.cost.is_finite().then_some(state)
            })
            .min_by(|a, b| a.cost.total_cmp(&b.cost))
            .ok_or_else(|| Error::AllStartsFailed {
                tried,
                last: "the film locks".into(),
            })?;
        let mut evaluations = tried * found.evaluations;
        for _ in 0..ROUNDS {
            first.weigh(&slots, &found)?;
            let at: Vec<f64> = found.eta.iter().chain(&found.beta).copied().collect();
            found = first.search(&[], &slots, &at, false)?.0;
            evaluations += found.evaluations;
        }
        let of_level: Vec<Vec<usize>> = (0..levels).map(of).collect();
        let mut out = Self::plain(robot, datasets, &of_level, memory)?;
        out.weigh(&slots, &found)?;
        let kept = |s: &Slot| !matches!(s, Slot::Offset(_));
        let all = slots.iter().zip(found.eta.iter().chain(&found.beta));
        let (slots, values) = all.filter(|(s, _)| kept(s)).unzip();
        out.begin = (
            Place {
                causes: Vec::new(),
                slots,
                values,
            },
            evaluations,
        );
        Ok(out)
    }

    /// The recordings of each level, not yet weighed.
    fn plain(
        robot: &'a Robot,
        datasets: &[&'a Dataset],
        levels: &[Vec<usize>],
        memory: &Memory,
    ) -> Result<Self, Error> {
        let numbers: Vec<usize> = levels.iter().flatten().copied().collect();
        let used: Vec<&Dataset> = numbers.iter().map(|&r| datasets[r]).collect();
        let request = Request::new(Stage::Robot);
        let (list, nonlinear) = parameters(&request, &used)?;
        let branches = request.branches;
        let offsets = numbers
            .iter()
            .filter(|&&r| datasets[r].offset_source == OffsetSource::Free);
        let slots = (0..branches)
            .map(Slot::LogTime)
            .chain([Slot::ReciprocalLocking])
            .chain(offsets.map(|&r| Slot::Offset(r)))
            .chain((0..=branches).map(Slot::Modulus))
            .chain((0..list.len() - nonlinear - branches - 1).map(Slot::Torque));
        let payload = |d: &Dataset| d.payload_kg.iter().sum::<f64>() / d.payload_kg.len() as f64;
        Ok(AgedRobot {
            common: slots.zip(list.iter().map(unknown)).collect(),
            nonlinear,
            mass_kg: robot.effector_kg + used.first().map_or(0.0, |d| payload(d)),
            eps_r: robot.eps_r,
            memory: memory.clone(),
            begin: (
                Place {
                    causes: Vec::new(),
                    slots: Vec::new(),
                    values: Vec::new(),
                },
                0,
            ),
            levels: levels
                .iter()
                .map(|own| {
                    let own: Vec<&Dataset> = own.iter().map(|&r| datasets[r]).collect();
                    open(robot, &own, branches, &ForearmTorque::zero())
                })
                .collect::<Result<_, _>>()?,
        })
    }

    /// Unknowns of `slots`, and how many of them are nonlinear.
    fn unknowns(&self, slots: &[Slot]) -> (Vec<Unknown>, usize) {
        let causes = slots.len() - self.common.len();
        let own = slots[..causes].iter().map(|slot| {
            let [low, high] = self.bounds(slot);
            Unknown::free(self.start(slot), low, high)
        });
        let all = own.chain(self.common.iter().map(|c| c.1)).collect();
        (all, causes + self.nonlinear)
    }

    /// The levels with the causes of `slots` at work.
    fn days(&self, causes: &[Cause], slots: &[Slot]) -> Days<'a> {
        let place = |slot: Slot| slots.iter().position(|s| *s == slot);
        let branches = self.levels[0].layout().branches;
        let mut number = 0;
        let days = self.levels.iter().enumerate().map(|(level, plain)| {
            let mut eta: Vec<(usize, f64, f64)> = Vec::new();
            let mut add = |slot: Slot| {
                if let Some(j) = place(slot) {
                    eta.push((j, 1.0, 0.0));
                }
            };
            (0..branches).for_each(|i| add(Slot::LogTime(i)));
            add(Slot::ReciprocalLocking);
            // Free offsets stand in the order of the recordings, level by level.
            let free = plain.layout().free_offsets.len();
            let offsets: Vec<Slot> = self
                .common
                .iter()
                .map(|c| c.0)
                .filter(|s| matches!(s, Slot::Offset(_)))
                .collect();
            offsets[number..number + free].iter().for_each(|s| add(*s));
            number += free;
            let mut at_work = Vec::new();
            let mut values = Vec::new();
            for cause in Cause::ALL {
                let own = if causes.contains(&cause) { level } else { 0 };
                let (Some(j), Some(acting)) = (place(Slot::Cause(cause, own)), acting(cause))
                else {
                    continue;
                };
                let spread = acting.effect.parameters()[0].spread;
                let [by, plus] = cause.first_value(self.mass_kg);
                eta.push((j, by / spread, plus / spread));
                values.push((at_work.len(), 0));
                at_work.push(acting);
            }
            let when: Vec<When> = plain.series();
            Day {
                residual: plain.with_effects(at_work, values, &when),
                eta,
                factor: place(Slot::Cause(Cause::FilmModulus, level)),
            }
        });
        Days {
            days: days.collect(),
            moduli: branches + 1,
        }
    }

    /// Fits a model from the values of `slots`; its unknowns beside the state.
    fn search(
        &self,
        causes: &[Cause],
        slots: &[Slot],
        start: &[f64],
        fine: bool,
    ) -> Result<(State, Vec<Unknown>), Error> {
        let (mut unknowns, split) = self.unknowns(slots);
        for (u, x) in unknowns.iter_mut().zip(start) {
            u.start = x.clamp(u.lower, u.upper);
        }
        let options = Options {
            evaluations: 60,
            cost_tolerance: if fine { 1e-8 } else { 1e-5 },
            step_tolerance: 1e-7,
        };
        let (nonlinear, linear) = unknowns.split_at(split);
        let days = self.days(causes, slots);
        let watch = |_: &State| ControlFlow::Continue(());
        let (memory, tag) = (&self.memory, format!("{causes:?}"));
        let eta = &start[..split];
        let state = memory.minimise(&tag, &days, nonlinear, linear, eta, &options, watch);
        if !state.cost.is_finite() {
            return Err(Error::AllStartsFailed {
                tried: 1,
                last: state.failure.unwrap_or_default(),
            });
        }
        Ok((state, unknowns))
    }

    /// Weighs every level by what the capture's noise makes of the film of a fit.
    fn weigh(&mut self, slots: &[Slot], found: &State) -> Result<(), Error> {
        let film = slots.iter().zip(&found.eta);
        let film = film.filter(|(s, _)| matches!(s, Slot::LogTime(_) | Slot::ReciprocalLocking));
        let film: Vec<f64> = film.map(|(_, v)| *v).collect();
        self.levels.par_iter_mut().try_for_each(|level| {
            let free = level.layout().free_offsets.clone();
            let mut eta = film.clone();
            eta.extend(free.iter().map(|&r| level.dataset(r).offset_s));
            level.weigh(&eta, &found.beta)
        })?;
        Ok(())
    }
}

impl Aged for AgedRobot<'_> {
    fn levels(&self) -> usize {
        self.levels.len()
    }

    fn rows(&self) -> usize {
        self.levels.iter().map(RobotResidual::rows).sum()
    }

    fn common(&self) -> Vec<Slot> {
        self.common.iter().map(|c| c.0).collect()
    }

    fn bounds(&self, slot: &Slot) -> [f64; 2] {
        match slot {
            Slot::Cause(cause, _) => {
                let [low, high] = cause.bounds();
                let (off, reach) = (cause.off(), REACH * cause.range());
                [low.max(off - reach), high.min(off + reach)]
            }
            other => self
                .common
                .iter()
                .find(|c| c.0 == *other)
                .map_or([f64::NEG_INFINITY, f64::INFINITY], |c| {
                    [c.1.lower, c.1.upper]
                }),
        }
    }

    fn start(&self, slot: &Slot) -> f64 {
        match slot {
            Slot::Cause(Cause::SeriesResistance, _) => START_RESISTANCE_OHM,
            Slot::Cause(cause, _) => cause.off(),
            other => {
                let own = self.common.iter().find(|c| c.0 == *other);
                own.map_or(0.0, |c| c.1.start)
            }
        }
    }

    fn first(&self) -> Result<(Place, usize), Error> {
        Ok(self.begin.clone())
    }

    fn minimise(
        &self,
        causes: &[Cause],
        slots: Vec<Slot>,
        start: &[f64],
        fine: bool,
    ) -> Result<Minimum, Error> {
        let (state, unknowns) = self.search(causes, &slots, start, fine)?;
        let values: Vec<f64> = state.eta.into_iter().chain(state.beta).collect();
        let at = unknowns.iter().zip(&values);
        Ok(Minimum {
            resting: at.map(|(u, x)| *x <= u.lower || *x >= u.upper).collect(),
            evaluations: state.evaluations,
            converged: state.ended.is_some_and(|e| e.converged()),
            place: Place {
                causes: causes.to_vec(),
                slots,
                values,
            },
        })
    }

    fn normal(&self, place: &Place) -> Result<Normal, Error> {
        let (unknowns, split) = self.unknowns(&place.slots);
        let (eta, beta) = place.values.split_at(split);
        let days = self.days(&place.causes, &place.slots);
        let whole = days.evaluate(eta, beta)?.at(split, beta);
        let n = place.slots.len();
        let mut out = Normal {
            gram: whole.view((0, 0), (n, n)).into_owned(),
            gradient: DVector::from_fn(n, |i, _| whole[(i, n)]),
            square: whole[(n, n)],
            rest: DMatrix::zeros(0, n),
            rest_left: DVector::zeros(0),
        };
        for (j, (u, x)) in unknowns.iter().zip(&place.values).enumerate() {
            if let Some(prior) = u.prior {
                let weight = prior.sd.powi(-2);
                out.gram[(j, j)] += weight;
                out.gradient[j] += weight * (x - prior.mean);
                out.square += weight * (x - prior.mean).powi(2);
            }
        }
        Ok(out)
    }

    fn noise(&self, place: &Place) -> Result<[f64; 2], Error> {
        let (_, split) = self.unknowns(&place.slots);
        let (eta, beta) = place.values.split_at(split);
        let days = self.days(&place.causes, &place.slots);
        let mut series: Vec<Vec<f64>> = Vec::new();
        for day in &days.days {
            let (own, scaled, _) = day.at(days.moduli, eta, beta);
            let design = day.residual.design(&own, &scaled)?;
            let left = design.column(design.ncols() - 1);
            let mut from = 0;
            for recording in 0..day.residual.series().len() {
                let kept = day.residual.kept(recording).len();
                series.extend((0..3).map(|k| (0..kept).map(|j| left[from + 3 * j + k]).collect()));
                from += 3 * kept;
            }
        }
        let (square, inflation) = noise_of(series.iter().map(Vec::as_slice), place.slots.len());
        Ok([square, inflation])
    }

    fn level(&self, place: &Place, level: usize) -> Result<LevelModel, Error> {
        let value = |cause: Cause| place.value(cause, level);
        Ok(LevelModel {
            film_factor: value(Cause::FilmModulus),
            electrode: Electrode {
                modulus_pa: value(Cause::ElectrodeStiffness),
                resistance_ohm: value(Cause::SeriesResistance),
                active_fraction: value(Cause::ActiveArea),
            },
            mass_kg: self.mass_kg * value(Cause::Load),
            eps_r: self.eps_r,
            rest_length_m: None,
        })
    }

    fn film(&self, place: &Place) -> (Film, Option<ForearmTorque>) {
        let (_, split) = self.unknowns(&place.slots);
        let (eta, beta) = place.values.split_at(split);
        let days = self.days(&place.causes, &place.slots);
        let own: Vec<f64> = days.days[0].at(days.moduli, eta, beta).0;
        let p = self.levels[0].parameters(&own, beta);
        let mut order: Vec<usize> = (0..p.film.relaxation_time_s.len()).collect();
        let time = |i: usize| p.film.relaxation_time_s[i];
        order.sort_by(|&a, &b| time(a).total_cmp(&time(b)));
        let film = Film {
            mu_pa: std::iter::once(p.film.mu_pa[0])
                .chain(order.iter().map(|&i| p.film.mu_pa[i + 1]))
                .collect(),
            relaxation_time_s: order.iter().map(|&i| time(i)).collect(),
            locking: p.film.locking,
        };
        (film, Some(p.forearm))
    }
}
