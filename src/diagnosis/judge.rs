//! From fits to a verdict: scores, pairs, probabilities, groups.

use nalgebra::{DMatrix, DVector};

use super::POLISH;
use super::blocks::{Blocks, Foretold, Forms, odds};
use super::problem::{Fitted, Problem, Tangent, informed};
use super::scan::Group;
use super::subject::Subject;
use crate::film::Locked;

/// Share of the residuals that count as independent.
pub(super) const INDEPENDENT: f64 = 0.8;
/// Squares at the weights of a model's own noise over those at the shared ones, from which its noise is
/// another.
const ANOTHER: f64 = 1.5;
/// Smallest weighted mean square that is believed.
const NOISE: f64 = 0.1;
/// Directions of fingerprints whose cosine is above this cannot be told apart.
pub(super) const ALIKE: f64 = 0.9;

/// A fit with what it scores.
#[derive(Clone)]
pub(super) struct Judged {
    pub fitted: Fitted,
    /// Lower is better: a Bayesian information criterion with an unknown scale of the error, because every
    /// textbook form is wrong in detail.
    pub score: f64,
    /// Sum of squares with priors over the number of residuals.
    pub mean_square: f64,
    /// Mean square of the held-out recordings; NaN without, and until [`Judged::hold`].
    pub holdout: f64,
    /// What it foretells of stretches that its fit left out.
    pub foretold: Foretold,
}

impl Judged {
    /// Judges a fit. A cause changes how much torque the noise of the capture makes: one that softens the
    /// film makes less of it, and would earn by shrinking what it is weighed by, the more the longer the
    /// recordings. So a model with causes is held against the noise of its own as well, and the larger of
    /// both squares counts. Where its own noise is another (a film without tension makes hardly any), a fit
    /// at the shared weights says nothing of what the cause can do at its own, and it is fitted there.
    pub fn new<S: Subject>(problem: &Problem<S>, blocks: &Blocks, fitted: Fitted) -> Self {
        let of_a_cause = !fitted.effects.is_empty();
        Judged::at_its_own(problem, blocks, fitted, of_a_cause)
    }

    /// The same; whether a model is held against the noise of its own too is asked for.
    pub fn at_its_own<S: Subject>(
        problem: &Problem<S>,
        blocks: &Blocks,
        fitted: Fitted,
        own: bool,
    ) -> Self {
        let n = fitted.state.rows as f64;
        let share = problem.independent;
        let foretell = |train: &S, fitted: &Fitted| {
            let tangent = Tangent::of(train, problem, fitted)?;
            let priors = fitted.cost() - fitted.state.data_cost;
            let squares = tangent.residual.norm_squared() + priors;
            Ok::<_, Locked>((squares, blocks.foretell(&tangent, None)))
        };
        let told = foretell(&problem.train, &fitted);
        // a mechanism that cannot take the poses of the recordings explains nothing, whatever a fit made of it
        let mut squares = told.as_ref().map_or(f64::INFINITY, |_| fitted.cost());
        let mut foretold = told.map_or_else(|_| blocks.untold(), |f| f.1);
        let own = own.then(|| problem.weighed(&fitted));
        if let Some(Ok((train, _))) = own
            && let Ok(mut own) = foretell(&train, &fitted)
        {
            if own.0 > ANOTHER * squares {
                let there = problem.with(train);
                let fit = there.fit_near(&fitted, &fitted.effects, POLISH);
                let again = foretell(&there.train, &fit);
                own = again.ok().filter(|a| a.0 < own.0).unwrap_or(own);
            }
            squares = squares.max(own.0);
            if own.1.mean_square() > foretold.mean_square() {
                foretold = own.1;
            }
        }
        let mean_square = squares / n;
        let free = informed(problem, &fitted) + steps(&fitted) as f64;
        let score = share * n * mean_square.max(NOISE).ln()
            + free * (share * n).max(1.0).ln()
            + 2.0 * choices(&fitted).ln();
        Judged {
            fitted,
            score,
            mean_square,
            holdout: f64::NAN,
            foretold,
        }
    }

    /// Works out what it leaves of the held-out recordings, once all is chosen.
    pub fn hold<S: Subject>(&mut self, problem: &Problem<S>) {
        let held_out = problem.held_out(&self.fitted);
        self.holdout = held_out.map_or(f64::NAN, |(squares, rows)| squares / rows as f64);
    }

    /// Logarithm of the prior odds against no cause, where each cause has those of `each`: the moment of a
    /// change, forms and places are as many chances to be wrong.
    pub fn prior(&self, each: f64) -> f64 {
        Judged::prior_of(&self.fitted, self.foretold.rows(), each)
    }

    /// The same of a fit on so many rows.
    pub fn prior_of(fitted: &Fitted, rows: f64, each: f64) -> f64 {
        let free = 0.5 * steps(fitted) as f64 * rows.max(1.0).ln();
        fitted.effects.len() as f64 * each - choices(fitted).ln() - free
    }

    /// Mean square beyond noise.
    pub fn excess(&self) -> f64 {
        (self.mean_square - 1.0).max(0.0)
    }
}

/// Probabilities of models against each other, from what they foretell.
pub(super) struct Odds(Vec<(Vec<&'static str>, f64)>);

impl Odds {
    /// Those of these models, with the logarithms of their prior odds against none.
    pub fn of<'a>(
        models: impl Iterator<Item = &'a Judged>,
        prior: impl Fn(&Judged) -> f64,
    ) -> Self {
        let models: Vec<&Judged> = models.collect();
        let told: Vec<(&Foretold, f64)> = models.iter().map(|j| (&j.foretold, prior(j))).collect();
        let ids = |j: &Judged| j.fitted.effects.iter().map(|a| a.effect.id()).collect();
        let causes: Vec<usize> = models.iter().map(|j| j.fitted.effects.len()).collect();
        let probabilities = odds(&told, Forms::Peers(&causes), 1.0);
        Odds(models.iter().map(|j| ids(j)).zip(probabilities).collect())
    }

    /// Those of sets of causes that are told otherwise.
    pub fn told(sets: Vec<(Vec<&'static str>, f64)>) -> Self {
        Odds(sets)
    }

    /// That of no cause.
    pub fn nothing(&self) -> f64 {
        let none = self.0.iter().filter(|m| m.0.is_empty());
        none.map(|m| m.1).sum()
    }

    /// That of all models with a cause.
    pub fn cause(&self, id: &str) -> f64 {
        let with = self.0.iter().filter(|m| m.0.contains(&id));
        with.map(|m| m.1).sum()
    }
}

/// Share of what a model leaves beyond noise up to which the rest, were it true, is what capture and
/// smoothing make of its own motion.
const SMOOTHED: f64 = 0.75;

/// Mean square that a model leaves beside what capture and smoothing make of the motion that it predicts
/// itself, where that is a good part: dry friction and stops change faster than a smoothed track can. `None`
/// where it is not, or cannot be known.
///
/// # Errors
/// [`Locked`] when the film is past its locking stretch.
pub(super) fn beside_smoothing<S: Subject>(
    problem: &Problem<S>,
    judged: &Judged,
) -> Result<Option<f64>, Locked> {
    let state = &judged.fitted.state;
    let mut residual = problem.residual(&judged.fitted);
    residual.linearise(&state.eta, &state.beta, true)?;
    let Some(expected) = residual.expected_residual(&state.eta, &state.beta) else {
        return Ok(None);
    };
    // the model may be refitted to what is left
    let mut whole = problem
        .train
        .with_effects(Vec::new(), Vec::new(), &problem.train_when);
    whole.take_out(None);
    let tangent = Tangent::of(&whole, problem, &judged.fitted)?;
    let left = &tangent.residual - expected;
    let along = tangent.columns.tr_mul(&left);
    let mean_square = tangent.projected(left.norm_squared(), &along, &along) / left.len() as f64;
    Ok(Some(mean_square).filter(|m| m - 1.0 < SMOOTHED * judged.excess()))
}

/// Forms and places among which a fit was chosen, all as likely as each other beforehand.
fn choices(fitted: &Fitted) -> f64 {
    let of = |a: &crate::effects::Acting| {
        a.effect.variants().len().max(1) as f64 * a.effect.reach().sets().len() as f64
    };
    fitted.effects.iter().map(of).product()
}

/// Moments of change, which count as parameters though they are found by a search.
fn steps(fitted: &Fitted) -> usize {
    let is_step =
        |a: &&crate::effects::Acting| a.effect.parameters().iter().any(|q| q.name == "recording");
    2 * fitted.effects.iter().filter(is_step).count()
}

/// Plain mean square above which a model is never adequate.
pub(super) const NEVER_ADEQUATE: f64 = 2.0;

/// Ids that the recordings cannot tell from the effect number `own` of a fitted model: the projected
/// fingerprint of that effect lies in the span of theirs.
pub(super) fn alike<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
    own: usize,
    groups: &[Group],
) -> Vec<&'static str> {
    let Ok((film, column)) = own_column(problem, fitted, own) else {
        return Vec::new();
    };
    let me = &fitted.effects[own];
    alike_to(&film, &column, me.effect.id(), me.on, groups)
        .into_iter()
        .map(|o| o.0)
        .collect()
}

/// Ids whose fingerprints on the actuators `on` span a column up to an angle that cannot be told, with its
/// cosine, largest first; `id` is the column's own.
pub(super) fn alike_to(
    film: &Tangent,
    column: &DVector<f64>,
    id: &str,
    on: [bool; 3],
    groups: &[Group],
) -> Vec<(&'static str, f64)> {
    let mut out = cosines(film, column, id, on, groups);
    out.retain(|o| o.1 > ALIKE);
    out
}

/// Cosines of a column with the span of each cause's fingerprints on the actuators `on`, largest first; `id`
/// is the column's own.
pub(super) fn cosines(
    film: &Tangent,
    column: &DVector<f64>,
    id: &str,
    on: [bool; 3],
    groups: &[Group],
) -> Vec<(&'static str, f64)> {
    let along = film.columns.tr_mul(column);
    let length = film.projected(column.norm_squared(), &along, &along);
    if length <= 0.0 {
        return Vec::new();
    }
    let mut out: Vec<(&'static str, f64)> = Vec::new();
    for g in groups.iter().filter(|g| g.effect.id() != id) {
        let columns = g.columns_on(on);
        let n = columns.len();
        let theirs: Vec<DVector<f64>> = columns.iter().map(|c| film.columns.tr_mul(c)).collect();
        let gram = DMatrix::from_fn(n, n, |i, j| {
            film.projected(columns[i].dot(&columns[j]), &theirs[i], &theirs[j])
                + if i == j {
                    1e-9 * columns[i].norm_squared() + 1e-300
                } else {
                    0.0
                }
        });
        let b = DVector::from_fn(n, |i, _| {
            film.projected(columns[i].dot(column), &theirs[i], &along)
        });
        let Some(c) = gram.cholesky().map(|f| f.solve(&b)) else {
            continue;
        };
        let cosine = (c.dot(&b) / length).max(0.0).sqrt();
        match out.iter_mut().find(|o| o.0 == g.effect.id()) {
            Some(known) => known.1 = known.1.max(cosine),
            None => out.push((g.effect.id(), cosine)),
        }
    }
    out.sort_by(|a, b| b.1.total_cmp(&a.1));
    out
}

/// The tangent space without an effect, and the derivative with respect to that effect's first size.
fn own_column<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
    own: usize,
) -> Result<(Tangent, DVector<f64>), Locked> {
    let mut without = fitted.clone();
    without.free.retain(|f| f.0 != own);
    let keep: Vec<usize> = (0..fitted.free.len())
        .filter(|&i| fitted.free[i].0 != own)
        .collect();
    let plain = problem.nonlinear.len();
    let mut eta = fitted.state.eta[..plain].to_vec();
    eta.extend(keep.iter().map(|&i| fitted.state.eta[plain + i]));
    without.state.eta = eta;
    let film = Tangent::new(problem, &without)?;
    // The change that the effect makes as a whole is its own best fingerprint.
    let mut others = fitted.clone();
    others.effects.remove(own);
    others.free = Vec::new();
    others.state.eta.truncate(plain);
    let residual = problem.residual(&others);
    let column =
        residual.fingerprint(&others.state.eta, &others.state.beta, &fitted.effects[own])?;
    Ok((film, DVector::from_vec(column)))
}
