//! Fits of the plain model and of hypotheses beside it.

use rayon::prelude::*;

use super::blocks::Blocks;
use super::chance::{Chance, chance};
use super::judge::Judged;
use super::outcome::*;
use super::problem::{Fitted, Problem, Tangent};
use super::scan::{Group, Scanned, Unit, fingerprints, scan, units};
use super::subject::Subject;
use super::{BASELINE, FIRST, OF_ONE, PARTNERS, POLISH, RARE};
use crate::effects::Acting;
use crate::film::Locked;

/// The plain model, weighted by the noise of an ordinary film and then by that of its own, where that is
/// believed; with that of an ordinary film ([`Problem::log_noise`]).
pub(super) fn baseline<S: Subject>(problem: &mut Problem<S>) -> Result<(Fitted, [f64; 2]), Error> {
    let ordinary = ordinary(problem)?;
    let first = problem.several(BASELINE);
    if !first.cost().is_finite() {
        return Err(Error::Baseline(first.state.failure.unwrap_or_default()));
    }
    if !problem.weigh_if_believed(&first, ordinary)? {
        return Ok((first, ordinary));
    }
    let (a, b) = rayon::join(
        || problem.fit_near(&first, &[], BASELINE),
        || problem.nominal(&[], BASELINE),
    );
    Ok((if a.cost() < b.cost() { a } else { b }, ordinary))
}

/// Weighs by the noise of an ordinary film, and says how much that is ([`Problem::log_noise`]).
pub(super) fn ordinary<S: Subject>(problem: &mut Problem<S>) -> Result<[f64; 2], Error> {
    problem.weigh(&problem.typical())?;
    Ok(problem.log_noise())
}

/// The most promising hypotheses, not too many of one effect.
pub(super) fn choose(scanned: &[Scanned], count: usize) -> Vec<&Scanned> {
    let mut out: Vec<&Scanned> = Vec::new();
    for s in scanned {
        let same = |c: &&&Scanned| c.acting.effect.id() == s.acting.effect.id();
        let of = out.iter().filter(same).count();
        let known = out.iter().any(|c| c.acting.is(&s.acting));
        if out.len() < count
            && of < OF_ONE
            && !(known && of > 0 && s.promised < 0.5 * out[0].promised)
        {
            out.push(s);
        }
    }
    out
}

/// Fits the hypotheses, each beside the effects that are there already, best first.
pub(super) fn refit<S: Subject>(
    problem: &Problem<S>,
    base: &Fitted,
    chosen: &[&Scanned],
    beside: &[Acting],
) -> Vec<Fitted> {
    problem.tally.expect(chosen.len());
    let mut fits: Vec<Fitted> = chosen
        .par_iter()
        .map(|s| {
            let mut effects = beside.to_vec();
            effects.push(s.acting.clone());
            let warm = problem.fit_near(base, &effects, FIRST);
            if warm.cost() > base.cost() - 0.5 * s.promised {
                // Worse than promised: the plain film may have run to its bounds.
                let cold = problem.nominal(&effects, FIRST);
                problem.tally.done();
                return if cold.cost() < warm.cost() {
                    cold
                } else {
                    warm
                };
            }
            problem.tally.done();
            warm
        })
        .filter(|f: &Fitted| f.cost().is_finite())
        .collect();
    fits.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    fits
}

/// A fit with the moments at which its causes begin where they leave least: a scan tells them to a kept sample
/// of the plain film, which is bent, and what lies between two moments is all error.
fn settle_moments<S: Subject>(problem: &Problem<S>, fitted: Fitted) -> Fitted {
    /// Distances that are tried, s, the coarsest first.
    const BY_S: [f64; 5] = [0.32, 0.16, 0.08, 0.04, 0.02];
    let mut best = fitted;
    for e in 0..best.effects.len() {
        let parameters = best.effects[e].effect.parameters();
        let Some(time) = parameters.iter().position(|q| q.name == "time") else {
            continue;
        };
        for by_s in BY_S {
            let beside = |sign: f64| {
                let mut effects = best.effects.clone();
                effects[e].values[time] += sign * by_s;
                problem.fit_near(&best, &effects, FIRST)
            };
            let (before, after) = rayon::join(|| beside(-1.0), || beside(1.0));
            let less = if before.cost() < after.cost() {
                before
            } else {
                after
            };
            if less.cost() < best.cost() {
                best = less;
            }
        }
    }
    best
}

/// A fit carried on to its end, thresholds also from either side.
pub(super) fn polish<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Fitted {
    let mut starts = vec![fitted.effects.clone()];
    for (e, a) in fitted.effects.iter().enumerate() {
        for (v, q) in a.effect.parameters().iter().enumerate() {
            if q.is_threshold() && q.name != "rate_down" {
                for factor in [0.87, 1.13] {
                    let mut other = fitted.effects.clone();
                    let near = other[e].values[v];
                    other[e].values[v] = if q.name == "theta_stop" {
                        near + 0.1 * (factor - 1.0)
                    } else {
                        (near * factor).clamp(q.lower, q.upper)
                    };
                    starts.push(other);
                }
            }
        }
    }
    let polished = starts
        .into_iter()
        .map(|s| problem.fit_near(fitted, &s, POLISH))
        .filter(|f| f.cost().is_finite())
        .min_by(|a, b| a.cost().total_cmp(&b.cost()))
        .unwrap_or_else(|| fitted.clone());
    settle_moments(problem, polished)
}

/// A fit with every effect read as plainly as it can be, where that fits as well within what `chance` makes
/// of a sum of squares.
pub(super) fn plainest<S: Subject>(
    problem: &Problem<S>,
    blocks: &Blocks,
    judged: &Judged,
    chance: f64,
) -> Judged {
    let fitted = &judged.fitted;
    let mut effects = fitted.effects.clone();
    let mut plainer = false;
    for a in &mut effects {
        if let Some(values) = a.effect.plainer(&a.values) {
            a.values = values;
            plainer = true;
        }
    }
    if !plainer {
        return judged.clone();
    }
    let other = problem.fit_near(fitted, &effects, POLISH);
    // a shape that is usual for one reading need not be so for the other
    if other.state.data_cost < fitted.state.data_cost + chance {
        let score = judged.score;
        return Judged {
            score,
            ..Judged::new(problem, blocks, other)
        };
    }
    judged.clone()
}

/// A scan beside a model with causes, by traces of the film as it is fitted with them: one that is bent to a
/// cause bends the traces of others, too.
pub(super) struct Beside {
    tangent: Tangent,
    groups: Vec<Group>,
    units: Vec<Unit>,
    /// What every other cause promises, most promising first.
    scanned: Vec<Scanned>,
}

impl Beside {
    /// `None` where a fit ended at values that the mechanism cannot have.
    pub fn new<S: Subject>(
        problem: &Problem<S>,
        base: &Fitted,
        wanted: &(dyn Fn(&str) -> bool + Sync),
    ) -> Option<Self> {
        let others = |id: &str| wanted(id) && base.effects.iter().all(|a| a.effect.id() != id);
        let tangent = Tangent::new(problem, base).ok()?;
        let groups = fingerprints(problem, base, &others);
        let units = units(problem, base).ok()?;
        Some(Beside {
            scanned: scan(problem, &tangent, &groups, &units, &others),
            tangent,
            groups,
            units,
        })
    }

    /// What chance makes of it.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn chance<S: Subject>(
        &self,
        problem: &Problem<S>,
        base: &Fitted,
    ) -> Result<Chance, Locked> {
        chance(problem, base, &self.tangent, &self.groups, &self.units)
    }

    /// The best partners of the causes of `base`.
    pub fn partners<S: Subject>(
        &self,
        problem: &Problem<S>,
        blocks: &Blocks,
        base: &Judged,
    ) -> Vec<Judged> {
        let count = if base.mean_square > 3.0 { 6 } else { 3 };
        let chosen = choose(&self.scanned, count);
        problem.tally.expect(PARTNERS.min(chosen.len()));
        let mut fits = refit(problem, &base.fitted, &chosen, &base.fitted.effects);
        fits.truncate(PARTNERS);
        let judged = fits.into_par_iter().map(|f| {
            let judged = Judged::new(problem, blocks, polish(problem, &f));
            problem.tally.done();
            judged
        });
        judged.collect()
    }
}

/// The best fit of a cause that is thought of only where no other will do.
pub(super) fn of_the_rare<S: Subject>(
    problem: &Problem<S>,
    blocks: &Blocks,
    plain: &Judged,
    rare: &(dyn Fn(&str) -> bool + Sync),
) -> Result<Option<Judged>, Error> {
    let tangent = Tangent::new(problem, &plain.fitted)?;
    let groups = fingerprints(problem, &plain.fitted, rare);
    let scanned = scan(problem, &tangent, &groups, &[], rare);
    let fits = refit(problem, &plain.fitted, &choose(&scanned, RARE), &[]);
    Ok(fits
        .iter()
        .map(|f| Judged::new(problem, blocks, polish(problem, f)))
        .min_by(|a, b| a.score.total_cmp(&b.score)))
}

/// Relaxation times in rising order, their moduli with them.
pub(super) fn rising(mut p: crate::model::Parameters) -> crate::model::Parameters {
    let mut pairs: Vec<(f64, f64)> = p
        .film
        .relaxation_time_s
        .iter()
        .copied()
        .zip(p.film.mu_pa[1..].iter().copied())
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (i, (t, mu)) in pairs.into_iter().enumerate() {
        p.film.relaxation_time_s[i] = t;
        p.film.mu_pa[i + 1] = mu;
    }
    p
}
