//! Parts that differ within their tolerances in the causes' place: whether they, alone or beside one cause,
//! explain more than the causes do.
//!
//! All are priced alike: -2 ln L, ln n for every value of a cause, and what it costs to pick the causes among
//! all that there are. What lies within its tolerance is to be expected and has to be outdone by parts no
//! more than chance allows; any other cause by more than that.

use rayon::prelude::*;

use super::POLISH;
use super::blocks::Blocks;
use super::fits::{choose, refit};
use super::judge::{INDEPENDENT, Judged};
use super::outcome::{Departed, Error};
use super::problem::{Fitted, Problem};
use super::scan::Scanned;
use super::subject::Subject;
use super::tolerance::{self, Built, Tolerance};
use crate::effects::Acting;

/// Share of what causes explain that parts within their tolerances may miss in linear theory for a fit of
/// them to be worth while.
const WORTH_A_FIT: f64 = 0.5;
/// Mean square of parts on blocks that the fits left out, over that of causes, from which it speaks against
/// them: three times the error.
const FORETELLS_WORSE: f64 = 9.0;
/// Mean square of the best causes, over the noise, above which parts are looked for beside them.
const BEYOND_NOISE: f64 = 1.1;
/// Departure, in tolerances, from which parts are not believed: no workshop is off by as much, but parts that
/// stand in for a cause go there.
const FAR: f64 = 10.0;
/// Causes that are fitted beside parts that differ.
const BESIDE_PARTS: usize = 6;

/// What the robot as drawn is given.
pub(super) struct Causes<'a> {
    /// The plain model.
    pub plain: &'a Judged,
    /// One cause each.
    pub singles: &'a [Judged],
    /// The best.
    pub best: &'a Judged,
    /// Whether the best leaves too much.
    pub unexplained: bool,
    /// What chance makes of a sum of squares in a scan.
    pub allowed: f64,
    /// Variance of the noise over the one that the weights promise.
    pub noise: f64,
    /// Logarithm of the prior odds of one cause.
    pub each: f64,
}

impl Causes<'_> {
    /// The parts that outdo the causes, and the fit with them and at most one cause.
    ///
    /// # Errors
    /// Those of a scan, and of a mechanism that cannot follow.
    pub fn outdone<S: Subject>(
        &self,
        problem: &mut Problem<S>,
        blocks: &Blocks,
        scanned: impl Fn(&Problem<S>, &Fitted) -> Result<Vec<Scanned>, Error>,
    ) -> Result<Option<(Built, Fitted)>, Error> {
        let rows = self.plain.fitted.state.rows as f64;
        let picked = |f: &Fitted| {
            f.free.len() as f64 * (INDEPENDENT * rows).ln()
                - 2.0 * f.effects.len() as f64 * self.each
        };
        let own = &self.best.fitted;
        // Parts and causes are priced by the noise that the plain misfit looks like: a textbook form leaves part
        // of a loud cause, which is no reason to believe in parts.
        let causes = own.cost() / self.noise + own.free.len() as f64 * (INDEPENDENT * rows).ln()
            - 2.0 * self.best.prior(self.each);
        let explained = (self.plain.fitted.cost() / self.noise - causes).max(0.0);
        let most = causes + WORTH_A_FIT * explained;
        let list = problem.train.tolerances();
        let within = |f: &Fitted| f.effects.iter().any(|a| tolerance::holds(&list, a));
        let expected = within(own);
        let by_chance = self.allowed / self.noise;
        let margin = if expected { -by_chance } else { by_chance };
        // A name that holds as drawn gives way to parts alone, which then leave nothing to name; one that
        // does not, and the second of two names, to parts beside a cause too.
        let doubtful = expected || self.unexplained;
        let loud = own.cost() > BEYOND_NOISE * self.noise * rows;
        let mut starts = vec![self.plain.fitted.clone()];
        if expected || own.effects.len() > 1 || (loud && self.unexplained) {
            starts.extend(self.beside(problem, &list));
        }
        let mut chosen: Option<(Built, Fitted)> = None;
        for start in starts {
            if let Ok(Some((mut built, mut fitted))) = Built::fit(problem, &start, self.noise, most)
            {
                let price = |built: &Built, f: &Fitted| built.likelihood(f, self.noise) + picked(f);
                if doubtful && start.effects.is_empty() {
                    // the same parts with a cause, then told about that
                    let beside = scanned(problem, &fitted)?;
                    let with = refit(problem, &fitted, &choose(&beside, BESIDE_PARTS), &[]);
                    let by_price =
                        |a: &Fitted, b: &Fitted| price(&built, a).total_cmp(&price(&built, b));
                    let cheapest = with.into_par_iter().min_by(by_price);
                    // both told once more: parts that are not settled yet leave something to any cause
                    if let Ok(alone) = built.again(problem, &fitted) {
                        let with = cheapest.and_then(|f| {
                            built.restore(problem).ok()?;
                            built.again(problem, &f).ok()
                        });
                        let wins = |w: &(Built, Fitted)| {
                            price(&w.0, &w.1) < price(&alone.0, &alone.1) - by_chance
                        };
                        (built, fitted) = with.filter(wins).unwrap_or(alone);
                    }
                    built.restore(problem)?;
                }
                let judged = Judged::new(problem, blocks, fitted.clone());
                // where names leave only noise as drawn, parts beyond their tolerances do not take their
                // place; parts far beyond stand in for something else
                let within = |p: Departed| (self.unexplained || loud) && p.times() < FAR;
                let believed = built.beyond(&fitted).is_none_or(within)
                    && judged.foretold.mean_square()
                        <= FORETELLS_WORSE * self.best.foretold.mean_square();
                // a cause beside parts has to outdo parts alone, which come first, by more than chance too
                let alone = |f: &Fitted| f.effects.is_empty() && !fitted.effects.is_empty();
                let bar = chosen.as_ref().map_or(f64::INFINITY, |(b, f)| {
                    price(b, f) - if alone(f) { by_chance } else { 0.0 }
                });
                if price(&built, &fitted) < (causes - margin).min(bar) && believed {
                    chosen = Some((built, fitted));
                }
            }
            Built::leave(problem)?;
        }
        Ok(chosen)
    }

    /// The causes beside which parts are worth a fit, each alone: those that are named, and of all others the
    /// one beside which parts promise most in linear theory; none that is a departure within its tolerance.
    fn beside<S: Subject>(&self, problem: &Problem<S>, list: &[Tolerance]) -> Vec<Fitted> {
        let free = |a: &Acting| !tolerance::holds(list, a);
        let alone = |own: &Acting| {
            let known = self.singles.iter().find(|s| s.fitted.effects[0].is(own));
            let fit = || problem.nominal(std::slice::from_ref(own), POLISH);
            known.map_or_else(fit, |s| s.fitted.clone())
        };
        let named = self.best.fitted.effects.iter();
        let mut out: Vec<Fitted> = named.filter(|a| free(a)).map(alone).collect();
        let others = self.singles.par_iter().map(|s| &s.fitted).filter(|f| {
            let own = &f.effects[0];
            free(own) && !out.iter().any(|o| o.effects[0].is(own))
        });
        let promised = others.filter_map(|f| {
            let promise = Built::promise(problem, f, self.noise).ok()?;
            // less than nothing is what linear theory cannot promise
            (promise > 0.0).then_some((promise, f))
        });
        let most = promised.min_by(|a, b| a.0.total_cmp(&b.0));
        out.extend(most.map(|m| m.1.clone()));
        out
    }
}
