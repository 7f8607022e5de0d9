//! The recordings, the plain model's unknowns, and fits of the model with effects.

use std::ops::{ControlFlow, Range};

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::outcome::Tally;
use super::subject::Subject;
use super::tolerance::Built;
use crate::effects::{Acting, Dated, Site, When};
use crate::film::Locked;
use crate::fit::memory::Memory;
use crate::fit::separable::{Options, Prior, State, Unknown};
use crate::residual::DepartureTorques;

/// Branches of the plain model.
pub(super) const BRANCHES: usize = 6;
/// Where relaxation times begin, s: half a decade's spread each.
pub(super) const TIMES_S: [f64; 6] = [0.03, 0.15, 0.76, 3.9, 20.0, 100.0];
/// What is known of a relaxation time, in ln.
const LOG_TIME_SD: f64 = 0.7;
/// 1/J of elastomers that actuators are made of: J of 30 to 200 and above.
const RECIPROCAL_LOCKING: Prior = Prior {
    mean: 0.0125,
    sd: 0.01,
};
/// Modulus of a silicone film, Pa: data sheets leave it open by as much. Softer films differ from it by less
/// than two deviations.
const EQUILIBRIUM: Prior = Prior {
    mean: 1.0e6,
    sd: 6e5,
};
/// Modulus of a branch, Pa.
const BRANCH: Prior = Prior {
    mean: 8e4,
    sd: 1.5e5,
};
/// Nodal torque, N m: a few mN m.
const NODE: Prior = Prior {
    mean: 0.0,
    sd: 3e-3,
};

/// Training and held-out recordings with their weights, and the plain model's unknowns.
pub(super) struct Problem<S> {
    pub train: S,
    pub holdout: Option<S>,
    pub train_when: Vec<When>,
    pub holdout_when: Vec<When>,
    /// The same as they were assumed, where nobody states them.
    pub assumed: Option<[Vec<When>; 2]>,
    pub nonlinear: Vec<Unknown>,
    pub linear: Vec<Unknown>,
    /// Share of the residuals that count as independent.
    pub independent: f64,
    /// What a standard deviation of where each recording begins changes of the torque error: no cause, and in
    /// every tangent space.
    pub begun: DepartureTorques,
    /// The model whose noise the weights are, and the plain one whose smoothing was taken out.
    pub weighed_at: Option<Fitted>,
    pub smoothed_at: Option<Fitted>,
    /// What was found before the run was stopped.
    pub memory: Memory,
    /// How much of the step under way is done.
    pub tally: Tally,
}

/// A fitted model: the plain one when it has no effects.
#[derive(Clone)]
pub(super) struct Fitted {
    pub effects: Vec<Acting>,
    pub free: Vec<(usize, usize)>,
    pub state: State,
}

impl Fitted {
    /// Sum of squares with the priors.
    pub fn cost(&self) -> f64 {
        self.state.cost
    }
}

/// Unknowns of the plain model on recordings with `offsets` free clock offsets that begin at these values, s.
pub(super) fn unknowns(
    offsets: &[f64],
    nodes: usize,
    reach_s: f64,
) -> (Vec<Unknown>, Vec<Unknown>) {
    let mut nonlinear: Vec<Unknown> = TIMES_S
        .iter()
        .map(|t| Unknown {
            start: t.ln(),
            lower: (0.004_f64).ln(),
            upper: (2000.0_f64).ln(),
            prior: Some(Prior {
                mean: t.ln(),
                sd: LOG_TIME_SD,
            }),
        })
        .collect();
    nonlinear.push(Unknown {
        start: RECIPROCAL_LOCKING.mean,
        lower: 1e-4,
        upper: 0.2,
        prior: Some(RECIPROCAL_LOCKING),
    });
    for o in offsets {
        nonlinear.push(Unknown::free(*o, o - reach_s, o + reach_s));
    }
    let modulus = |prior: Prior| Unknown {
        start: prior.mean,
        lower: 0.0,
        upper: 1e9,
        prior: Some(prior),
    };
    let mut linear = vec![modulus(EQUILIBRIUM)];
    linear.extend((0..BRANCHES).map(|_| modulus(BRANCH)));
    linear.extend((0..nodes).map(|_| Unknown {
        start: 0.0,
        lower: -1.0,
        upper: 1.0,
        prior: Some(NODE),
    }));
    (nonlinear, linear)
}

/// Unknowns of the free values of effects, over their spreads.
pub(super) fn value_unknowns(effects: &[Acting], free: &[(usize, usize)]) -> Vec<Unknown> {
    free.iter()
        .map(|&(e, v)| {
            let q = &effects[e].effect.parameters()[v];
            let start = effects[e].values[v] / q.spread;
            let (lower, upper) = (q.lower / q.spread, q.upper / q.spread);
            let prior = q.off.is_finite().then_some(Prior {
                mean: q.off / q.spread,
                sd: if q.size { SIZE_SD } else { 1.0 },
            });
            Unknown {
                start: start.clamp(lower, upper),
                lower,
                upper,
                prior,
            }
        })
        .collect()
}

/// Distance of the films from which a plain fit starts, in standard deviations of what is known of them.
const APART: f64 = 0.8;
/// ln of how much noisier than shown a film may be until its noise is not believed.
const NOISIER: f64 = 0.2;

/// ln of how much quieter than an ordinary film one is that is not believed where it does not fit, and the
/// mean square from which it does not. A film that bends to a cause ends far softer than any is, and weights
/// set there make the misfit thousands of times the noise; a film that is soft in truth fits.
const QUIETER: f64 = std::f64::consts::LN_2;
const MISFITS: f64 = 4.0;

/// What a fit may cost.
#[derive(Clone, Copy)]
pub(super) struct Effort {
    /// Evaluations, in each round.
    pub evaluations: usize,
    /// Share of the cost below which a step is not worth taking.
    pub cost_tolerance: f64,
    /// Times that effects on the motion are worked out anew where a fit ended.
    pub motion_rounds: usize,
    /// Cost that has to be promised: a search stops where its linear model sees no way below.
    pub below: f64,
}

impl Effort {
    /// The same of a search that is to end below a cost that is reached already, by no less than one standard
    /// error costs.
    pub fn to_outdo(self, cost: f64) -> Self {
        Effort {
            below: match cost.is_finite() {
                true => cost - (self.cost_tolerance * cost).max(1.0),
                false => f64::INFINITY,
            },
            ..self
        }
    }
}

/// What is known of a size, in its spread: strong effects are not rare.
const SIZE_SD: f64 = 4.0;

/// Distance of the times at which a recording that was held out is tried, s, and how many there are on either
/// side of the one assumed.
const DATES_S: f64 = 5.0;
const DATES: i32 = 22;

/// Place of the cause that acts over the series.
pub(super) fn over_series(effects: &[Acting]) -> Option<usize> {
    effects.iter().position(|a| a.effect.over_series(&a.values))
}

impl<S: Subject> Problem<S> {
    /// Fits the plain model with `effects`, from the film at `eta` (plain unknowns) and `beta`.
    pub fn fit(&self, effects: &[Acting], eta: &[f64], beta: &[f64], effort: Effort) -> Fitted {
        self.fit_from(0, effects, eta, beta, effort)
    }

    /// The same, where the values of the first `held` effects stay as they are.
    fn fit_from(
        &self,
        held: usize,
        effects: &[Acting],
        eta: &[f64],
        beta: &[f64],
        effort: Effort,
    ) -> Fitted {
        let free: Vec<(usize, usize)> = effects
            .iter()
            .enumerate()
            .skip(held)
            .flat_map(|(e, a)| a.free_values().into_iter().map(move |v| (e, v)))
            .collect();
        let mut residual =
            self.train
                .with_effects(effects.to_vec(), free.clone(), &self.train_when);
        let mut nonlinear = self.nonlinear.clone();
        let own = value_unknowns(effects, &free);
        let mut start = eta.to_vec();
        start.extend(own.iter().map(|u| u.start));
        nonlinear.extend(own);
        let mut linear = self.linear.clone();
        for (u, b) in linear.iter_mut().zip(beta) {
            u.start = *b;
        }
        let options = Options {
            evaluations: effort.evaluations,
            cost_tolerance: effort.cost_tolerance,
            step_tolerance: 1e-6,
        };
        let moving = effects.iter().any(|a| a.effect.site() == Site::Motion);
        // the model at the start may be far off, and one of a motion is about another mechanism
        let bounded = effort.below < f64::INFINITY && !moving;
        let priors = linear.clone();
        let watch = |s: &State| {
            let hopeless = || s.iterations > 0 && s.promised(&nonlinear, &priors) >= effort.below;
            match bounded && hopeless() {
                true => ControlFlow::Break(()),
                false => ControlFlow::Continue(()),
            }
        };
        if moving && residual.linearise(&start, beta, true).is_err() {
            // The mechanism cannot follow: from off instead.
            let off: Vec<f64> = value_unknowns(effects, &free)
                .iter()
                .map(|u| u.prior.map_or(u.start, |p| p.mean))
                .collect();
            start.truncate(eta.len());
            start.extend(off);
            let _ = residual.linearise(&start, beta, true);
        }
        let tag = format!("{held} {effects:?} below {}", effort.below);
        let search = |residual: &S, linear: &[Unknown], eta: &[f64]| {
            let memory = &self.memory;
            memory.minimise(&tag, residual, &nonlinear, linear, eta, &options, watch)
        };
        let mut state = search(&residual, &linear, &start);
        for _ in 0..if moving { effort.motion_rounds } else { 0 } {
            let before = state.cost;
            if residual.linearise(&state.eta, &state.beta, false).is_err() {
                break;
            }
            for (u, b) in linear.iter_mut().zip(&state.beta) {
                u.start = *b;
            }
            let next = search(&residual, &linear, &state.eta);
            let spent = state.evaluations + next.evaluations;
            state = next;
            state.evaluations = spent;
            if (before - state.cost).abs() < 1e-3 * state.cost {
                break;
            }
        }
        let effects = residual.effects(&state.eta);
        Fitted {
            effects,
            free,
            state,
        }
    }

    /// Fits the plain model with `effects` from the film at which another fit ended.
    pub fn fit_near(&self, near: &Fitted, effects: &[Acting], effort: Effort) -> Fitted {
        let eta = &near.state.eta[..self.nonlinear.len()];
        self.fit(effects, eta, &near.state.beta, effort)
    }

    /// Fits the plain model with the effects of another fit, whose values stay, and more beside them, from the
    /// film at which that fit ended.
    pub fn fit_beside(&self, near: &Fitted, more: &[Acting], effort: Effort) -> Fitted {
        let eta = &near.state.eta[..self.nonlinear.len()];
        let effects = [&near.effects[..], more].concat();
        self.fit_from(near.effects.len(), &effects, eta, &near.state.beta, effort)
    }

    /// Fits the plain model with `effects` from the nominal film.
    pub fn nominal(&self, effects: &[Acting], effort: Effort) -> Fitted {
        let start = |list: &[Unknown]| list.iter().map(|u| u.start).collect::<Vec<f64>>();
        self.fit(
            effects,
            &start(&self.nonlinear),
            &start(&self.linear),
            effort,
        )
    }

    /// Fits the plain model from several films: the nominal one, faster and slower ones, stiffer and softer
    /// at large stretch; the best.
    pub fn several(&self, effort: Effort) -> Fitted {
        let (times, locking) = (0..BRANCHES, BRANCHES..BRANCHES + 1);
        let starts = [
            (times.clone(), 0.0),
            (times.clone(), -APART),
            (times, APART),
            (locking.clone(), -APART),
            (locking, APART),
        ];
        let beta: Vec<f64> = self.linear.iter().map(|u| u.start).collect();
        let from = |(which, shift): &(Range<usize>, f64), effort: Effort| {
            let mut eta: Vec<f64> = self.nonlinear.iter().map(|u| u.start).collect();
            for i in which.start..which.end.min(eta.len()) {
                eta[i] += shift * self.nonlinear[i].prior.map_or(0.0, |p| p.sd);
            }
            self.fit(&[], &eta, &beta, effort)
        };
        let nominal = from(&starts[0], effort);
        let others = if S::CHAINS > 1 { &starts[1..] } else { &[] };
        let others = others.par_iter();
        let better = others
            .map(|start| from(start, effort.to_outdo(nominal.cost())))
            .filter(|f| f.cost() < nominal.cost())
            .min_by(|a, b| a.cost().total_cmp(&b.cost()));
        better.unwrap_or(nominal)
    }

    /// The film that the priors describe, unfitted: its noise is that of an ordinary film.
    pub fn typical(&self) -> Fitted {
        let eta: Vec<f64> = self.nonlinear.iter().map(|u| u.start).collect();
        Fitted {
            effects: Vec::new(),
            free: Vec::new(),
            state: State::at(&eta, &self.nonlinear, &self.linear),
        }
    }

    /// The same where the variance of what is left is `noise` times the one that the weights promise: what is
    /// known beforehand counts for as much more beside the residual.
    pub fn tempered(&self, noise: f64) -> Self {
        let closer = |list: &[Unknown]| {
            let of = |u: &Unknown| Unknown {
                prior: u.prior.map(|p| Prior {
                    sd: p.sd / noise.sqrt(),
                    ..p
                }),
                ..*u
            };
            list.iter().map(of).collect()
        };
        let mut begun = self.begun.clone();
        for x in begun.iter_mut().flatten().flatten().flatten() {
            *x /= noise.sqrt();
        }
        Problem {
            nonlinear: closer(&self.nonlinear),
            linear: closer(&self.linear),
            begun,
            ..self.copy()
        }
    }

    /// The same with nothing held out.
    pub fn copy(&self) -> Self {
        let train = (self.train).with_effects(Vec::new(), Vec::new(), &self.train_when);
        self.with(train)
    }

    /// The same with other weights, those of `train`, and nothing held out.
    pub fn with(&self, train: S) -> Self {
        Problem {
            train,
            holdout: None,
            train_when: self.train_when.clone(),
            holdout_when: Vec::new(),
            assumed: None,
            nonlinear: self.nonlinear.clone(),
            linear: self.linear.clone(),
            independent: self.independent,
            begun: self.begun.clone(),
            weighed_at: None,
            smoothed_at: None,
            memory: self.memory.clone(),
            tally: self.tally.clone(),
        }
    }

    /// Logarithm of the noise's standard deviation, as the weights have it: mean and median over all samples.
    pub fn log_noise(&self) -> [f64; 2] {
        let mut each: Vec<f64> = (0..self.train_when.len())
            .flat_map(|number| self.train.whitening(number))
            .map(|w| match S::CHAINS {
                1 => -w[0].ln(),
                _ => -(w[0] * w[2] * w[5]).ln() / S::CHAINS as f64,
            })
            .collect();
        if each.is_empty() {
            return [0.0; 2];
        }
        let (middle, mean) = (each.len() / 2, each.iter().sum::<f64>() / each.len() as f64);
        [mean, *each.select_nth_unstable_by(middle, f64::total_cmp).1]
    }

    /// Variance of the noise that the residual shows over the one that the weights promise: from second
    /// differences of neighbouring kept samples, where slow causes leave little, against those of the drawn
    /// tracks (medians, so that jumps count little).
    pub fn noise_scale(&self, residual: &DVector<f64>) -> f64 {
        let chains = S::CHAINS;
        let tracks: Vec<Vec<f64>> = self
            .train
            .noise_rows()
            .into_iter()
            .filter(|t| t.len() == residual.len())
            .collect();
        let mut own: Vec<f64> = Vec::new();
        let mut drawn: Vec<f64> = Vec::new();
        let mut first = 0;
        for number in 0..self.train_when.len() {
            let times = self.train.kept_times_s(number);
            for (j, t) in times.windows(3).enumerate() {
                let (a, b) = (t[1] - t[0], t[2] - t[1]);
                if (a - b).abs() > 1e-6 * a {
                    continue;
                }
                let at = first + chains * j;
                let bend =
                    |r: &[f64], a: usize| (r[a] - 2.0 * r[a + chains] + r[a + 2 * chains]).powi(2);
                for a in at..at + chains {
                    own.push(bend(residual.as_slice(), a));
                    drawn.extend(tracks.iter().map(|t| bend(t, a)));
                }
            }
            first += chains * times.len();
        }
        let median = |list: &mut Vec<f64>| {
            let middle = list.len() / 2;
            if list.is_empty() {
                return f64::NAN;
            }
            *list.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let scale = median(&mut own) / median(&mut drawn);
        if scale.is_finite() { scale } else { 1.0 }
    }

    /// The plain unknowns of the held-out recordings: the fitted model, clock offsets as far as they are
    /// known.
    pub fn holdout_eta(&self, fitted: &Fitted) -> Option<Vec<f64>> {
        let holdout = self.holdout.as_ref()?;
        Some(holdout.carried(&fitted.state.eta[..self.nonlinear.len()]))
    }

    /// Sum of squares of the held-out recordings under a fitted model, and their number of residuals.
    pub fn held_out(&self, fitted: &Fitted) -> Option<(f64, usize)> {
        self.squares_of(self.holdout.as_ref()?, fitted)
    }

    /// The same with the weights of `holdout`.
    pub fn squares_of(&self, holdout: &S, fitted: &Fitted) -> Option<(f64, usize)> {
        let residual = holdout.with_effects(fitted.effects.clone(), Vec::new(), &self.holdout_when);
        let eta = self.holdout_eta(fitted)?;
        let normal =
            crate::residual::SeparableResidual::evaluate(&residual, &eta, &fitted.state.beta)
                .ok()?;
        let last = normal.gram.nrows() - 1;
        Some((normal.gram[(last, last)], normal.rows))
    }

    /// Dates recordings about whose time nothing is stated: they were made when a fitted cause that acts over
    /// the series leaves least of them. The fit with these times, where it leaves less than with those that
    /// were assumed.
    pub fn date(&mut self, fitted: &Fitted, effort: Effort) -> Option<Fitted> {
        let [assumed, _] = self.assumed.as_ref()?;
        let e = over_series(&fitted.effects)?;
        let first = self.first()?;
        let open: Vec<usize> = (0..assumed.len())
            .filter(|&i| assumed[i].recording != first)
            .collect();
        let numbers: Vec<usize> = open.iter().map(|&i| assumed[i].recording).collect();
        let later = |i: &usize| self.train_when[*i].series_s - assumed[*i].series_s;
        let later: Vec<f64> = open.iter().map(later).collect();
        let own = &fitted.effects[e];
        let mut effects = fitted.effects.clone();
        effects[e] = Dated::beside(own, &numbers, &later);
        let mut when = assumed.clone();
        let as_assumed = Problem {
            train_when: when.clone(),
            ..self.copy()
        };
        let dated = as_assumed.fit_near(fitted, &effects, effort);
        let (values, later) = dated.effects[e].values.split_at(own.values.len());
        for (i, later_s) in open.iter().zip(later) {
            when[*i].series_s += later_s;
        }
        let mut effects = dated.effects.clone();
        effects[e] = Acting {
            values: values.to_vec(),
            ..own.clone()
        };
        let before = std::mem::replace(&mut self.train_when, when);
        let with = self.fit_near(&dated, &effects, effort);
        let in_order = {
            let mut all: Vec<&When> = self.train_when.iter().collect();
            all.sort_by_key(|w| w.recording);
            all.windows(2).all(|w| w[0].series_s < w[1].series_s)
        };
        if !in_order || with.cost() >= fitted.cost() {
            self.train_when = before;
            return None;
        }
        self.train = self
            .train
            .with_effects(Vec::new(), Vec::new(), &self.train_when);
        Some(with)
    }

    /// Number of the recording that was made first.
    fn first(&self) -> Option<usize> {
        let assumed = self.assumed.as_ref()?.iter().flatten();
        assumed.map(|w| w.recording).min()
    }

    /// Dates recordings that were held out by the first half of each, as [`Problem::date`] does.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn date_held_out(&mut self, fitted: &Fitted) -> Result<(), Locked> {
        let (Some([_, assumed]), Some(holdout), Some(eta), Some(_)) = (
            &self.assumed,
            &self.holdout,
            self.holdout_eta(fitted),
            over_series(&fitted.effects),
        ) else {
            return Ok(());
        };
        let first = self.first();
        let open = |w: &When| Some(w.recording) != first;
        let noise = (fitted.cost() / fitted.state.rows as f64).max(1.0);
        let squares = |later_s: f64| {
            let mut when = assumed.clone();
            for w in when.iter_mut().filter(|w| open(w)) {
                w.series_s += later_s;
            }
            let residual = holdout.with_effects(fitted.effects.clone(), Vec::new(), &when);
            let halves = first_halves(&residual, when.len(), &eta, &fitted.state.beta)?;
            let known = (later_s / Dated::SPREAD_S).powi(2);
            let each = halves.iter().map(|half| half / noise + known);
            Ok::<Vec<f64>, Locked>(each.collect())
        };
        let tried = (-DATES..=DATES).map(|i| f64::from(i) * DATES_S);
        let tried: Vec<(f64, Vec<f64>)> = tried
            .map(|later_s| Ok((later_s, squares(later_s)?)))
            .collect::<Result<_, Locked>>()?;
        let mut dated = assumed.clone();
        let each = dated.iter_mut().enumerate();
        for (number, w) in each.filter(|(_, w)| open(w)) {
            let least = tried
                .iter()
                .min_by(|a, b| a.1[number].total_cmp(&b.1[number]));
            w.series_s += least.map_or(0.0, |(later_s, _)| *later_s);
        }
        self.holdout = Some(holdout.with_effects(Vec::new(), Vec::new(), &dated));
        self.holdout_when = dated;
        Ok(())
    }

    /// Takes what capture and smoothing make of a fitted plain model's own motion out of all residuals, where
    /// less is left then. The fit without it, where it was taken out.
    pub fn take_out_smoothing(&mut self, fitted: &Fitted) -> Option<Fitted> {
        let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
        let expected = self.train.expected_residual(eta, beta)?;
        self.train.take_out(Some(&expected));
        let other = self.fit(&[], eta, beta, super::BASELINE);
        if other.cost() > fitted.cost() {
            self.train.take_out(None);
            return None;
        }
        self.smoothed_at = Some(fitted.clone());
        Some(other)
    }

    /// Puts back what [`Problem::take_out_smoothing`] took out.
    pub fn put_back_smoothing(&mut self) {
        self.train.take_out(None);
        self.smoothed_at = None;
    }

    /// Takes up recordings that were held out of all choices, as the fitted ones are by now: of a robot that
    /// differs alike, with the same weights, and without what capture and smoothing make of the plain model's
    /// motion.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn take_up(&mut self, holdout: Option<S>, built: Option<&Built>) -> Result<(), Locked> {
        self.holdout = holdout;
        if let Some(built) = built
            && let Some(mut held) = self.holdout.take()
        {
            built.hold(self, &mut held)?;
            self.holdout = Some(held);
        }
        let of = |p: &Self, f: &Fitted| p.holdout_eta(f).unwrap_or_default();
        if let Some(model) = self.weighed_at.clone() {
            let eta = of(self, &model);
            let holdout = self.holdout.take();
            let weighed = |h: S| self.weighed_like(&h, &eta, &model, &self.holdout_when);
            self.holdout = holdout.map(weighed).transpose()?;
        }
        if let Some(model) = self.smoothed_at.clone() {
            let eta = of(self, &model);
            if let Some(holdout) = &mut self.holdout {
                let expected = holdout.expected_residual(&eta, &model.state.beta);
                holdout.take_out(expected.as_ref());
            }
        }
        Ok(())
    }

    /// Sets the weights of train and held-out recordings at a fitted model.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn weigh(&mut self, fitted: &Fitted) -> Result<(), Locked> {
        (self.train, self.holdout) = self.weighed(fitted)?;
        self.weighed_at = Some(fitted.clone());
        Ok(())
    }

    /// Recordings with the weights of a fitted model, whose plain unknowns they have as `eta`.
    fn weighed_like(
        &self,
        residual: &S,
        eta: &[f64],
        fitted: &Fitted,
        when: &[When],
    ) -> Result<S, Locked> {
        let mut own = residual.with_effects(fitted.effects.clone(), Vec::new(), when);
        own.weigh(eta, &fitted.state.beta)?;
        Ok(own.with_effects(Vec::new(), Vec::new(), when))
    }

    /// Training and held-out recordings with the weights of a fitted model.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn weighed(&self, fitted: &Fitted) -> Result<(S, Option<S>), Locked> {
        let plain = self.nonlinear.len();
        let own = &fitted.state.eta[..plain];
        let train = self.weighed_like(&self.train, own, fitted, &self.train_when)?;
        let holdout = (self.holdout.as_ref()).map(|h| {
            let eta = self.holdout_eta(fitted).unwrap_or_default();
            self.weighed_like(h, &eta, fitted, &self.holdout_when)
        });
        Ok((train, holdout.transpose()?))
    }

    /// Sets the weights at a fitted model. Where its film is so extreme that it makes more noise than the
    /// residual shows, weights set there would hide everything, and those of an ordinary film are taken; so
    /// they are where it makes far less and does not fit. The same of its causes, but a stop or a friction
    /// may multiply the noise of what little motion it leaves, so that they are doubted only where the middle
    /// sample is too noisy. `ordinary` is [`Problem::log_noise`] of an ordinary film. Says whether the
    /// model's own film was taken.
    ///
    /// # Errors
    /// Those of [`Problem::weigh`].
    pub fn weigh_if_believed(
        &mut self,
        fitted: &Fitted,
        ordinary: [f64; 2],
    ) -> Result<bool, Locked> {
        if S::CHAINS == 1 {
            self.weigh(fitted)?;
            return Ok(true);
        }
        let scale = self.noise_scale(&self.left(fitted)?);
        let over = |noise: [f64; 2]| [0, 1].map(|i| noise[i] - ordinary[i]);
        let shown = over(self.log_noise()).map(|n| n + 0.5 * scale.ln());
        let noisier = |own: f64, shown: f64| own > NOISIER && own > shown + NOISIER;
        let mut model = fitted.clone();
        model.effects.clear();
        self.weigh(&model)?;
        let own = over(self.log_noise())[0];
        let misfits = fitted.cost() > MISFITS * fitted.state.rows as f64;
        let film = !(noisier(own, shown[0]) || (misfits && own < -QUIETER));
        if !film {
            model = self.typical();
            self.weigh(&model)?;
        }
        if !fitted.effects.is_empty() {
            let mut with = model.clone();
            with.effects.clone_from(&fitted.effects);
            self.weigh(&with)?;
            if noisier(over(self.log_noise())[1], shown[1]) {
                self.weigh(&model)?;
            }
        }
        Ok(film)
    }

    /// What a fitted model leaves of the training recordings, whitened.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn left(&self, fitted: &Fitted) -> Result<DVector<f64>, Locked> {
        let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
        let design = self.residual(fitted).design(eta, beta)?;
        Ok(design.column(design.ncols() - 1).into_owned())
    }

    /// The residual of the training recordings with the effects of a fitted model.
    pub fn residual(&self, fitted: &Fitted) -> S {
        self.train.with_effects(
            fitted.effects.clone(),
            fitted.free.clone(),
            &self.train_when,
        )
    }
}

/// Sums of squares of the first half of each recording at a model.
///
/// # Errors
/// [`Locked`] when the film is past its locking stretch.
pub(super) fn first_halves<S: Subject>(
    residual: &S,
    recordings: usize,
    eta: &[f64],
    beta: &[f64],
) -> Result<Vec<f64>, Locked> {
    let design = residual.design(eta, beta)?;
    let left = design.column(design.ncols() - 1);
    let mut from = 0;
    let each = (0..recordings).map(|number| {
        let rows = S::CHAINS * residual.kept_times_s(number).len();
        let half = left.rows(from, rows / 2).norm_squared();
        from += rows;
        half
    });
    Ok(each.collect())
}

/// The tangent space of a fitted model: what a small change of its unknowns can do to the residual.
pub(super) struct Tangent {
    /// Rows by free unknowns, scaled to columns of about unit length.
    pub columns: DMatrix<f64>,
    /// Residual.
    pub residual: DVector<f64>,
    /// Inverse of columns' columns + priors.
    inverse: DMatrix<f64>,
    /// Roots of the priors' weights in the scaled unknowns.
    prior_roots: DVector<f64>,
    /// Slope of half the sum of squares, priors included, in the scaled unknowns: zero where a fit has ended.
    slope: DVector<f64>,
    /// How far each scaled unknown may go down and up.
    room: Vec<[f64; 2]>,
    /// How many of the columns, the last, are no unknowns of the fit: the residual is not at their optimum.
    pub beside: usize,
}

impl Tangent {
    /// The tangent space at a fitted model.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn new<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Result<Self, Locked> {
        Tangent::of(&problem.train, problem, fitted)
    }

    /// The same with the weights of `train`.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn of<S: Subject>(
        train: &S,
        problem: &Problem<S>,
        fitted: &Fitted,
    ) -> Result<Self, Locked> {
        let (effects, free) = (fitted.effects.clone(), fitted.free.clone());
        let mut residual = train.with_effects(effects, free, &problem.train_when);
        residual.linearise(&fitted.state.eta, &fitted.state.beta, true)?;
        let design = residual.design(&fitted.state.eta, &fitted.state.beta)?;
        let width = design.ncols() - 1;
        let mut unknowns = problem.nonlinear.clone();
        unknowns.extend(value_unknowns(&fitted.effects, &fitted.free));
        unknowns.extend(problem.linear.iter().copied());
        let at: Vec<f64> = fitted
            .state
            .eta
            .iter()
            .chain(&fitted.state.beta)
            .copied()
            .collect();
        // A node that no recording reaches changes nothing.
        let free: Vec<usize> = (0..width)
            .filter(|&i| {
                at[i] > unknowns[i].lower
                    && at[i] < unknowns[i].upper
                    && design.column(i).norm_squared() > 1e-100
            })
            .collect();
        let mut columns = DMatrix::zeros(design.nrows(), free.len());
        let mut ridge = vec![0.0; free.len()];
        let mut room = Vec::with_capacity(free.len());
        let mut slope = design.column(width).tr_mul(&design).transpose();
        slope = DVector::from_iterator(
            free.len(),
            free.iter().map(|&i| {
                let pull = unknowns[i]
                    .prior
                    .map_or(0.0, |p| (at[i] - p.mean) / (p.sd * p.sd));
                slope[i] + pull
            }),
        );
        for (j, &i) in free.iter().enumerate() {
            let norm = design.column(i).norm().max(f64::MIN_POSITIVE);
            columns.set_column(j, &(design.column(i) / norm));
            slope[j] /= norm;
            room.push([unknowns[i].lower, unknowns[i].upper].map(|end| norm * (end - at[i])));
            ridge[j] = unknowns[i].prior.map_or(0.0, |p| (p.sd * norm).powi(-2)) + 1e-12;
        }
        let more = match problem.begun.is_empty() {
            true => DMatrix::zeros(0, 0),
            false => train.departure_rows(&problem.begun),
        };
        let more: Vec<_> = more.column_iter().filter(|c| c.norm() > 1e-9).collect();
        let (own, size) = (free.len(), free.len() + more.len());
        let mut columns = columns.resize_horizontally(size, 0.0);
        let mut slope = slope.resize_vertically(size, 0.0);
        for (j, c) in more.iter().enumerate() {
            let norm = c.norm();
            columns.set_column(own + j, &(c / norm));
            slope[own + j] = columns.column(own + j).dot(&design.column(width));
            ridge.push(norm.powi(-2));
        }
        // the product of two matrices goes in blocks, that of a transposed one by columns
        let mut gram = columns.transpose() * &columns;
        for (j, r) in ridge.iter().enumerate() {
            gram[(j, j)] += r;
        }
        let inverse = gram
            .cholesky()
            .map_or_else(|| DMatrix::identity(size, size), |c| c.inverse());
        Ok(Tangent {
            beside: more.len(),
            columns,
            residual: design.column(width).into_owned(),
            inverse,
            prior_roots: DVector::from_iterator(size, ridge.iter().map(|r| r.sqrt())),
            slope,
            room,
        })
    }

    /// Coefficients with which the tangent space takes up a column, from the column's products with the
    /// columns here.
    pub fn absorbed(&self, a: &DVector<f64>) -> DVector<f64> {
        &self.inverse * a
    }

    /// Slope of half the sum of squares, priors included, in the scaled unknowns.
    pub fn slope(&self) -> &DVector<f64> {
        &self.slope
    }

    /// How far each scaled unknown of the fit may go down and up.
    pub fn room(&self) -> &[[f64; 2]] {
        &self.room
    }

    /// Roots of the priors' weights in the scaled unknowns.
    pub fn prior_roots(&self) -> &DVector<f64> {
        &self.prior_roots
    }

    /// The part of a'r that lies in the tangent space, from the product of a with the columns. At the fit's
    /// own residual there is none.
    pub fn hidden_product(&self, a: &DVector<f64>, r: &DVector<f64>) -> f64 {
        if std::ptr::eq(r, &self.residual) {
            return match self.beside {
                0 => 0.0,
                _ => a.dot(&(&self.inverse * &self.slope)),
            };
        }
        a.dot(&(&self.inverse * self.columns.tr_mul(r)))
    }

    /// [`Tangent::absorbed`] of several columns.
    pub fn absorb(&self, a: &DMatrix<f64>) -> DMatrix<f64> {
        &self.inverse * a
    }

    /// a'b with the tangent space projected out, from the products of a and b with the columns.
    pub fn projected(&self, product: f64, a: &DVector<f64>, b: &DVector<f64>) -> f64 {
        product - a.dot(&(&self.inverse * b))
    }
}

/// How many free values the data determine: each size counts whole, each shape by the share of its prior
/// variance that they take away (MacKay 1992), so that a shape of which they say nothing costs nothing.
pub(super) fn informed<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> f64 {
    let is_size = |f: &(usize, usize)| fitted.effects[f.0].effect.parameters()[f.1].size;
    let sizes = fitted.free.iter().filter(|f| is_size(f)).count() as f64;
    if sizes as usize == fitted.free.len() {
        return sizes;
    }
    let first = problem.nonlinear.len();
    let own = value_unknowns(&fitted.effects, &fitted.free);
    let mut h = fitted.state.gram();
    let unknowns = problem.nonlinear.iter().chain(&own).chain(&problem.linear);
    let n = h.nrows();
    for (i, u) in unknowns.enumerate() {
        h[(i, i)] += u.prior.map_or(0.0, |p| p.sd.powi(-2));
    }
    let scale: Vec<f64> = (0..n)
        .map(|i| 1.0 / h[(i, i)].sqrt().max(f64::MIN_POSITIVE))
        .collect();
    let scaled = DMatrix::from_fn(n, n, |i, j| {
        scale[i] * scale[j] * h[(i, j)] + if i == j { 1e-12 } else { 0.0 }
    });
    let Some(inverse) = scaled.cholesky().map(|c| c.inverse()) else {
        return fitted.free.len() as f64;
    };
    let shapes = fitted.free.iter().zip(&own).enumerate();
    let shapes = shapes.filter(|(_, (f, _))| !is_size(f)).map(|(i, (_, u))| {
        let at = first + i;
        let variance = inverse[(at, at)] * scale[at] * scale[at];
        let known = u.prior.map_or(f64::INFINITY, |p| p.sd * p.sd);
        (1.0 - variance / known).clamp(0.0, 1.0)
    });
    sizes + shapes.sum::<f64>()
}
