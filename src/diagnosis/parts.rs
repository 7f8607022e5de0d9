//! Parts that differ within their tolerances in the causes' place: whether they, alone or beside one cause,
//! explain more than the causes do.
//!
//! The model that foretells most likely, -ln L with what its values and the directions of its parts cost, is
//! what all others are held against. A cause that leaves more than it does may do so by its form: that costs
//! it no more than the law of forms (`blocks`) allows. Two kinds of names are not spared so: those that leave
//! too much to be believed, and those that leave more than noise where parts within their tolerances do
//! better, alone, beside some of the same names, or beside all of them and another. Parts have no form, nor has
//! a cause that is tried beside them because a named one may be taken for it; parts far beyond their tolerances
//! cost what normal ones as far off would. Each cause costs its prior odds; one within its tolerance, one beside
//! parts and every further one cost what chance makes of a scan besides.

use rayon::prelude::*;

use super::blocks::{Blocks, form_costs};
use super::fits::{choose, refit};
use super::judge::{INDEPENDENT, Judged};
use super::outcome::Error;
use super::problem::{Fitted, Problem};
use super::scan::Scanned;
use super::subject::Subject;
use super::tolerance::{self, Built, FAR, Tolerance};
use super::{PAIR_ABOVE, POLISH};
use crate::effects::Acting;

/// Share of what causes explain that parts within their tolerances may miss in linear theory for a fit of
/// them to be worth while.
const WORTH_A_FIT: f64 = 0.5;
/// Mean square of the best causes, over the noise, above which parts are looked for beside them.
const BEYOND_NOISE: f64 = 1.1;
/// Causes that are fitted beside parts that differ, those of them beside which parts are told again, and those
/// beside which they are told to the end.
const BESIDE_PARTS: usize = 6;
const RACING: usize = 3;
const SETTLED: usize = 2;
/// Share of what the model without a cause leaves beyond the best one, up to which what the cause leaves may
/// be its form.
const OF_FORM: f64 = 0.5;
/// Sum of squares over the least, or over what noise makes, from which a cause beside parts is out of the race.
const HOPELESS: f64 = 3.0;

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
    /// [`Chance::noises`](super::chance::Chance::noises) as the plain model's misfit looks.
    pub noises: [f64; 2],
    /// The first of them as what the best leaves looks.
    pub shown: f64,
    /// Logarithm of the prior odds of one cause.
    pub each: f64,
}

/// A model that is held against the others.
struct Tried {
    parts: Option<Built>,
    fitted: Fitted,
    /// Mean square with priors: the larger of both of [`Judged::new`].
    square: f64,
    /// Minus the logarithm of the prior odds of its causes, and what it costs that parts are far off.
    prior: f64,
    /// What a scan finds by chance, where the model is to outdo others by as much.
    chance: f64,
    /// Whether what it leaves may be its form.
    of_form: bool,
}

impl Tried {
    /// Whether its parts can be believed.
    fn is_near(&self) -> bool {
        let parts = self.parts.as_ref();
        parts.is_none_or(|p| p.farthest(&self.fitted) < FAR)
    }

    /// -ln L with so much noise, and what free values cost.
    fn told(&self, noise: f64) -> f64 {
        let rows = self.fitted.state.rows as f64;
        let of = |p: &Built| p.spread(noise) + p.priors(&self.fitted, noise);
        let parts = self.parts.as_ref().map_or(0.0, of);
        let free = self.fitted.free.len() as f64 * (INDEPENDENT * rows).ln();
        0.5 * (self.square * rows / noise + parts + free)
    }
}

/// -ln of the posterior odds of each model, but for a constant; the causes as drawn come first. `plain` is
/// the mean square of the plain model, `alone` that of parts alone, where they were fitted; `colour` the
/// variance of a score over the one that white noise would give it.
fn costs(tried: &[Tried], plain: f64, alone: Option<f64>, colour: f64) -> Vec<f64> {
    let least = tried.iter().map(|t| t.square).fold(f64::INFINITY, f64::min);
    let noise = colour.max(1.0) * least.max(1.0);
    let told: Vec<f64> = tried.iter().map(|t| t.told(noise)).collect();
    let whole = |at: usize| tried[at].prior + tried[at].chance + told[at];
    // Parts within their tolerances that do with some of the names, with none, or with another beside them all
    // are no other form of them: they are held against all that the names leave. (Parts beyond may be what is
    // named, or take up its form.) Names that leave what noise does keep their place.
    let own = &tried[0];
    let agree = |t: &Tried| {
        let has = |of: &Fitted, a: &Acting| {
            let mut names = of.effects.iter();
            names.any(|o| o.effect.id() == a.effect.id())
        };
        let (a, b) = (&own.fitted, &t.fitted);
        b.effects.iter().all(|e| has(a, e)) || a.effects.iter().all(|e| has(b, e))
    };
    let within = |t: &Tried| {
        let parts = t.parts.as_ref();
        parts.is_some_and(|p| p.beyond(&t.fitted).is_none())
    };
    let loses = |at: usize| within(&tried[at]) && agree(&tried[at]) && whole(at) < whole(0);
    let gives_way = own.square > PAIR_ABOVE && (1..tried.len()).any(loses);
    let likeliest =
        (tried.iter().zip(&told)).min_by(|a, b| (a.1 + a.0.prior).total_cmp(&(b.1 + b.0.prior)));
    let (best, left) = likeliest.map_or((0.0, least), |(t, told)| (*told, t.square));
    let each = tried.iter().zip(&told).enumerate().map(|(at, (t, told))| {
        let plain = match &t.parts {
            Some(_) => alone.unwrap_or(plain),
            None => plain,
        };
        let form = best + form_costs(t.square, left, plain);
        let takes = t.square - left < OF_FORM * (plain - left);
        let of_form = t.of_form && takes && !(at == 0 && gives_way);
        t.prior + t.chance + if of_form { told.min(form) } else { *told }
    });
    each.collect()
}

/// A scan of the catalogue beside a fit.
type Scan<'a, S> = dyn Fn(&Problem<S>, &Fitted) -> Result<Vec<Scanned>, Error> + Sync + 'a;

/// A search for parts that outdo causes.
struct Search<'a, S> {
    causes: &'a Causes<'a>,
    blocks: &'a Blocks,
    scanned: &'a Scan<'a, S>,
    /// Whether a cause of the best is a departure within its tolerance.
    expected: bool,
    /// -ln of the likelihood that chance makes of a scan: what a cause within its tolerance, one beside
    /// parts, and every further one has to make up for.
    by_chance: f64,
    /// -2 ln L that parts must promise in linear theory to be worth a fit.
    most: f64,
}

/// What a search for one more cause beside parts ends with.
enum OneMore<S> {
    /// Parts that are believed beside it, of each cause with which they are.
    Believed(Vec<Tried>),
    /// Parts that are not, in their problem, of the cause with which they leave least.
    Far(Box<(Problem<S>, Built, Fitted)>),
    Nothing,
}

impl Causes<'_> {
    /// The parts that outdo the causes on a robot as drawn, and the fit with them and at most two causes.
    ///
    /// # Errors
    /// Those of a scan, and of a mechanism that cannot follow.
    pub fn outdone<S: Subject>(
        &self,
        problem: &Problem<S>,
        blocks: &Blocks,
        scanned: &Scan<'_, S>,
    ) -> Result<Option<(Built, Fitted)>, Error> {
        let (own, [noise, colour]) = (&self.best.fitted, self.noises);
        let rows = own.state.rows as f64;
        let list = problem.train.tolerances();
        let expected = own.effects.iter().any(|a| tolerance::holds(&list, a));
        // work that linear theory, by the noise that the plain misfit looks like, says is in vain
        let causes = own.cost() / noise + own.free.len() as f64 * (INDEPENDENT * rows).ln()
            - 2.0 * Judged::prior_of(own, rows, self.each);
        let explained = (self.plain.fitted.cost() / noise - causes).max(0.0);
        // A name that holds as drawn gives way to parts alone, which then leave nothing to name; one that
        // does not, and the second of two names, to parts beside a cause too. One that leaves a little more
        // than noise may have parts beside it.
        let above = |noise: f64| own.cost() > BEYOND_NOISE * noise * rows;
        let doubtful = expected || self.unexplained || above(noise);
        let search = Search {
            causes: self,
            blocks,
            scanned,
            expected,
            by_chance: 0.5 * self.allowed / noise,
            most: causes + WORTH_A_FIT * explained,
        };
        let mut tried = vec![search.entry(problem, None, own.clone())];
        let alone = search.parts_alone(problem, doubtful)?;
        let of_parts = alone.first().map(|t| t.square);
        tried.extend(alone.into_iter().filter(Tried::is_near));
        let likeliest = |tried: &[Tried]| {
            let costs = costs(tried, self.plain.mean_square, of_parts, colour);
            let by_cost = |a: &usize, b: &usize| costs[*a].total_cmp(&costs[*b]);
            (0..tried.len()).min_by(by_cost).unwrap_or(0)
        };
        // no name gives way to parts alone before the same parts were tried beside it
        let widely = doubtful || own.effects.len() > 1 || likeliest(&tried) > 0;
        if widely || above(self.shown) {
            let mut starts = self.beside(problem, &list, widely);
            let ordinary = starts.len();
            if widely {
                let like = self.like_the_named(problem, &list, &starts);
                starts.extend(like);
            }
            let beside = starts.par_iter().map(|s| search.beside_causes(problem, s));
            let beside = beside.collect::<Result<Vec<_>, Error>>()?;
            for (at, beside) in beside.into_iter().enumerate() {
                // what only stands in for a name has to be as good by itself, not in another form
                let of_form = |t: Tried| Tried {
                    of_form: t.of_form && at < ordinary,
                    ..t
                };
                tried.extend(beside.into_iter().filter(Tried::is_near).map(of_form));
            }
        }
        let best = likeliest(&tried);
        let best = tried.swap_remove(best);
        Ok(best.parts.map(|parts| (parts, best.fitted)))
    }

    /// The fits beside which parts are worth one: the causes that are named, each alone and, where they leave
    /// too much to be believed, all together; `widely`, of all others the one beside which parts promise most
    /// in linear theory too; none with a departure within its tolerance, or with what scales all that voltages
    /// make.
    fn beside<S: Subject>(
        &self,
        problem: &Problem<S>,
        list: &[Tolerance],
        widely: bool,
    ) -> Vec<Fitted> {
        let named = &self.best.fitted;
        let own = named.effects.iter().filter(|a| is_free(list, a));
        let mut out: Vec<Fitted> = own.map(|a| self.alone(problem, a)).collect();
        if widely {
            let others = self.singles.iter().map(|s| &s.fitted);
            let others = others.filter(|f| is_new(list, &out, &f.effects[0]));
            let others = others.cloned().collect();
            out.extend(self.most_promising(problem, others));
        }
        let free = named.effects.iter().all(|a| is_free(list, a));
        if self.unexplained && named.effects.len() > 1 && free {
            out.push(named.clone());
        }
        out
    }

    /// Of the causes for which a named one may be taken, none of which has a fit in `known`, the one beside
    /// which parts promise most: a film that bends to both may hide the one that parts would leave.
    fn like_the_named<S: Subject>(
        &self,
        problem: &Problem<S>,
        list: &[Tolerance],
        known: &[Fitted],
    ) -> Option<Fitted> {
        let starts = problem.train.starts();
        let named = self.best.fitted.effects.iter();
        let like = named.flat_map(|a| a.effect.taken_for().iter().map(|id| (*id, a.on)));
        let like = like.filter_map(|(id, on)| {
            let (effect, values) = starts.iter().find(|(e, _)| e.id() == id)?;
            let (effect, values) = (*effect, values.first()?.clone());
            let own = Acting { effect, values, on };
            let may_be = effect.reach().sets().contains(&on) && is_new(list, known, &own);
            may_be.then_some(own)
        });
        let like: Vec<Acting> = like.collect();
        let fits = like.par_iter().map(|a| self.alone(problem, a)).collect();
        self.most_promising(problem, fits)
    }

    /// A cause alone on the robot as drawn.
    fn alone<S: Subject>(&self, problem: &Problem<S>, own: &Acting) -> Fitted {
        let known = self.singles.iter().find(|s| s.fitted.effects[0].is(own));
        let fit = || problem.nominal(std::slice::from_ref(own), POLISH);
        known.map_or_else(fit, |s| s.fitted.clone())
    }

    /// The fit beside which parts promise most in linear theory.
    fn most_promising<S: Subject>(
        &self,
        problem: &Problem<S>,
        fits: Vec<Fitted>,
    ) -> Option<Fitted> {
        let promised = fits.into_par_iter().filter_map(|f| {
            let promise = Built::promise(problem, &f, self.noises).ok()?;
            // less than nothing is what linear theory cannot promise
            (promise > 0.0).then_some((promise, f))
        });
        promised.min_by(|a, b| a.0.total_cmp(&b.0)).map(|m| m.1)
    }
}

/// Whether parts are looked for beside a cause: it is no departure within its tolerance, and does not scale
/// all that voltages make.
fn is_free(list: &[Tolerance], own: &Acting) -> bool {
    !tolerance::holds(list, own) && !own.effect.scales_made()
}

/// The same of a cause that is in none of these fits.
fn is_new(list: &[Tolerance], known: &[Fitted], own: &Acting) -> bool {
    is_free(list, own) && !known.iter().any(|f| f.effects[0].is(own))
}

impl<S: Subject> Search<'_, S> {
    /// A model as it is held against the others, at the parts that the problem has.
    fn entry(&self, problem: &Problem<S>, parts: Option<Built>, fitted: Fitted) -> Tried {
        let rows = fitted.state.rows as f64;
        let prior = Judged::prior_of(&fitted, rows, self.causes.each);
        let judged = Judged::at_its_own(problem, self.blocks, fitted.clone(), true);
        let free = usize::from(parts.is_none() && !self.expected);
        Tried {
            prior: parts.as_ref().map_or(0.0, |p| p.strange(&fitted)) - prior,
            chance: self.by_chance * fitted.effects.len().saturating_sub(free) as f64,
            square: judged.mean_square,
            // causes as drawn that leave too much for their forms say nothing
            of_form: !fitted.effects.is_empty() && (parts.is_some() || !self.causes.unexplained),
            parts,
            fitted,
        }
    }

    /// Whether a model leaves more than noise, or has parts too far off to be believed.
    fn lacks(&self, tried: &Tried) -> bool {
        tried.square > BEYOND_NOISE * self.causes.shown || !tried.is_near()
    }

    /// Parts told beside a fit of a robot as drawn, where linear theory says that this is not in vain; with the
    /// problem that has them.
    fn told(&self, drawn: &Problem<S>, start: &Fitted) -> Option<(Problem<S>, Built, Fitted)> {
        let tell = |noise: f64, most: f64| {
            let mut problem = drawn.copy();
            let told = Built::fit(&mut problem, start, [noise, self.causes.noises[1]], most);
            told.map(|t| t.map(|(b, f)| (problem, b, f)))
        };
        let believed = |(_, b, f): &(Problem<S>, Built, Fitted)| {
            b.farthest(f) < FAR && f.cost() < start.cost()
        };
        let told = tell(self.causes.noises[0], self.most);
        match told {
            Ok(Some(told)) if believed(&told) => Some(told),
            Ok(None) => None,
            // Parts that stretch to a misfit go where nothing is linear: held by as much noise as the misfit
            // would be, they take the way that the fit does as it gets better.
            told => {
                let left = start.cost() / start.state.rows as f64;
                let slowly = tell(self.causes.noises[1] * left, f64::INFINITY);
                let both = told.ok().flatten().into_iter().chain(slowly.ok().flatten());
                both.min_by(|a, b| {
                    let by_belief = believed(b).cmp(&believed(a));
                    by_belief.then(a.2.cost().total_cmp(&b.2.cost()))
                })
            }
        }
    }

    /// Parts alone, first, and, where they are in doubt and lack something, with causes that a scan beside them
    /// finds.
    fn parts_alone(&self, drawn: &Problem<S>, doubtful: bool) -> Result<Vec<Tried>, Error> {
        let Some((problem, parts, fitted)) = self.told(drawn, &self.causes.plain.fitted) else {
            return Ok(Vec::new());
        };
        let alone = self.entry(&problem, Some(parts), fitted);
        let (Some(parts), true) = (&alone.parts, doubtful && self.lacks(&alone)) else {
            return Ok(vec![alone]);
        };
        let more = self.grow(&problem, parts, &alone.fitted)?;
        // those with causes were told once more
        let mut again = problem.copy();
        let alone = match parts.again(&mut again, &alone.fitted) {
            Ok((parts, fitted)) => self.entry(&again, Some(parts), fitted),
            Err(_) => alone,
        };
        Ok(std::iter::once(alone).chain(more).collect())
    }

    /// Parts beside the causes of a fit of a robot as drawn. Where a cause that is named leaves parts that are
    /// too far off to be believed, or more than noise, another one that a scan beside them finds joins it, if
    /// that takes the parts within their tolerances.
    fn beside_causes(&self, drawn: &Problem<S>, start: &Fitted) -> Result<Vec<Tried>, Error> {
        let Some((problem, parts, fitted)) = self.told(drawn, start) else {
            return Ok(Vec::new());
        };
        let mut out = vec![self.entry(&problem, Some(parts), fitted)];
        let beside = &out[0];
        let is_named = |a: &Acting| self.causes.best.fitted.effects.iter().any(|o| o.is(a));
        if let (Some(parts), [one]) = (&beside.parts, &beside.fitted.effects[..])
            && is_named(one)
            && self.lacks(beside)
        {
            let within = |p: &Built, f: &Fitted| p.beyond(f).is_none();
            if let OneMore::Believed(with) =
                self.one_more(&problem, parts, &beside.fitted, &within)?
            {
                out.extend(with);
            }
        }
        Ok(out)
    }

    /// Parts with one cause that a scan beside them finds; with two where nothing explains a robot as drawn,
    /// and parts stand in for a second one.
    fn grow(
        &self,
        problem: &Problem<S>,
        parts: &Built,
        fitted: &Fitted,
    ) -> Result<Vec<Tried>, Error> {
        let near = |p: &Built, f: &Fitted| p.farthest(f) < FAR;
        let mut one = self.one_more(problem, parts, fitted, &near)?;
        if let (OneMore::Far(far), true) = (&one, self.causes.unexplained) {
            let (problem, parts, fitted) = &**far;
            one = self.one_more(problem, parts, fitted, &near)?;
        }
        Ok(match one {
            OneMore::Believed(with) => with,
            _ => Vec::new(),
        })
    }

    /// Parts and a fit with them, with one more cause: those that leave least race. Both are told once more, as
    /// parts that are not settled yet leave something to any cause.
    fn one_more(
        &self,
        problem: &Problem<S>,
        parts: &Built,
        fitted: &Fitted,
        believed: &dyn Fn(&Built, &Fitted) -> bool,
    ) -> Result<OneMore<S>, Error> {
        let known = |id: &str| fitted.effects.iter().any(|a| a.effect.id() == id);
        let mut beside = (self.scanned)(problem, fitted)?;
        beside.retain(|s| !s.acting.effect.scales_made() && !known(s.acting.effect.id()));
        let chosen = choose(&beside, BESIDE_PARTS);
        let mut with = refit(problem, fitted, &chosen, &fitted.effects);
        let noise = self.causes.shown * fitted.state.rows as f64;
        let most = HOPELESS * with.first().map_or(noise, |w| w.cost().max(noise));
        with.retain(|w| w.cost() <= most);
        with.truncate(RACING);
        let told = with.par_iter().filter_map(|with| {
            let mut problem = problem.copy();
            let (parts, with) = parts.again(&mut problem, with).ok()?;
            Some((problem, parts, with))
        });
        let mut told: Vec<(Problem<S>, Built, Fitted)> = told.collect();
        told.sort_by(|a, b| a.2.cost().total_cmp(&b.2.cost()));
        told.truncate(SETTLED);
        let mut out = OneMore::Nothing;
        let mut all = Vec::new();
        for (mut problem, parts, with) in told {
            let Some((parts, with)) = parts.settled(&mut problem, &with).ok().flatten() else {
                continue;
            };
            if believed(&parts, &with) {
                all.push(self.entry(&problem, Some(parts), with));
                continue;
            }
            let least = match &out {
                OneMore::Far(far) => far.2.cost(),
                _ => f64::INFINITY,
            };
            if with.cost() < least {
                out = OneMore::Far(Box::new((problem, parts, with)));
            }
        }
        Ok(match all[..] {
            [] => out,
            _ => OneMore::Believed(all),
        })
    }
}
