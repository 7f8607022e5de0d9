//! What no cause of the catalogue accounts for is learnt: at which site it acts, on which coordinates it
//! depends, and how.
//!
//! Every site has groups of columns, linear in their coefficients, each a smooth function of some coordinates
//! ([`Group`]; the forms are those of [`crate::effects::learnt`]). A group's coefficients have a normal prior
//! of unknown scale, and what a refit of the film could absorb is projected out. Groups join one after the
//! other while the marginal likelihood, with the noise's size unknown,
//!
//! ```text
//! -2 ln L = n ln(Q/n) + ln det(I + S G S),     Q = r'r - g'S (I + S G S)^-1 S g
//! ```
//!
//! falls by more than the choice among groups costs (G, g: products of the columns with each other and with
//! the residual; S: scales). A film that was fitted without the term has bent to it, so groups are chosen
//! about an ordinary one, which what is known beforehand holds the closer the more is left. Film and term are
//! then fitted together, the film being let go in steps, and the groups are chosen again about the film that
//! is found. The sites that promise most are judged by that likelihood and by what they foretell of
//! recordings that are left out one at a time.
//!
//! | file | what |
//! |---|---|
//! | `dictionary` | which groups a robot's recordings may have |
//! | `columns` | a group's columns, whitened |
//! | `coordinate` | the same on a single coordinate, whose plain model is linear: groups, and the choice by blocks |
//! | `evidence` | the likelihood, and the choice |
//! | `shapes` | frequencies, dampings, directions |
//! | `physics` | what it is: ranges, energy, likeness, the sentence |

mod columns;
mod coordinate;
mod dictionary;
mod evidence;
mod physics;
mod shapes;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::POLISH;
use super::problem::{BRANCHES, Fitted, Problem, Tangent};
use super::subject::Subject;
use crate::effects::Acting;
use crate::effects::learnt::{Learnt, Place};
use crate::film::Locked;
use crate::fit::separable::{Prior, Unknown};
use crate::residual::Departure;
pub(super) use columns::{Group, Made};
use columns::{Known, known};
pub(super) use coordinate::{learn_along, made_along, work_along};
pub(super) use dictionary::{made_by, of_robot};
use evidence::{About, Choice, Products, log_det};
pub(super) use physics::physics;
use shapes::{refined, sharpened};

/// Sites that are fitted with the film, and times that each one's groups are chosen.
const SITES: usize = 3;
const ROUNDS: usize = 2;
/// A direction may go as far as this many standard deviations.
const FARTHEST: f64 = 1e6;
/// Steps in which a film is let go.
const FREER: f64 = 10.0;

/// What was learnt.
pub(super) struct Taught {
    /// The fit with the terms as effects.
    pub fitted: Fitted,
    /// The site.
    pub place: Place,
    /// Covariance of each term's coefficients, and the probability that its group belongs to the site.
    pub open: Vec<(DMatrix<f64>, f64)>,
    /// Logarithm of what is left of recordings that are left out over what the plain model leaves.
    pub left_out: f64,
}

/// A problem whose linear unknowns have those of chosen groups at their end.
struct Joint<S> {
    problem: Problem<S>,
    /// From those unknowns to those of the groups.
    combine: DMatrix<f64>,
}

/// The parts of chosen groups: term, coefficients (columns: unknowns of the groups one after the other),
/// actuators.
fn parts(
    list: &[Known],
    members: &[(usize, f64)],
) -> Vec<(&'static Learnt, [bool; 3], DMatrix<f64>)> {
    let size = members.iter().map(|m| list[m.0].columns.ncols()).sum();
    let mut out = Vec::new();
    let mut from = 0;
    for &(i, _) in members {
        let k = &list[i];
        for (on, root) in k.on.iter().zip(&k.roots) {
            let n = root.nrows();
            let mut row = 0;
            for term in &k.terms {
                let count = term.form.count();
                let mut values = DMatrix::zeros(count, size);
                values
                    .view_mut((0, from), (count, n))
                    .copy_from(&root.rows(row, count));
                out.push((*term, *on, values));
                row += count;
            }
            from += n;
        }
    }
    out
}

/// Chosen groups as terms, where their unknowns combine `sizes`.
fn terms_of(
    list: &[Known],
    members: &[(usize, f64)],
    combine: &DMatrix<f64>,
    sizes: &[f64],
) -> Vec<Acting> {
    let unknowns = combine * DVector::from_column_slice(sizes);
    let term = |(term, on, values): (&'static Learnt, [bool; 3], DMatrix<f64>)| Acting {
        effect: term,
        values: (values * &unknowns).iter().copied().collect(),
        on,
    };
    parts(list, members).into_iter().map(term).collect()
}

/// What each coefficient of chosen groups changes of the torque error at the kept samples, and the
/// coefficients (rows) that the groups' unknowns make.
fn torques<S: Subject>(
    problem: &Problem<S>,
    film: &Fitted,
    list: &[Known],
    members: &[(usize, f64)],
) -> Result<(Vec<DMatrix<f64>>, DMatrix<f64>), Locked> {
    let mut departures = Vec::new();
    let mut rows = Vec::new();
    for (term, on, values) in parts(list, members) {
        for j in 0..term.form.count() {
            let mut one = vec![0.0; term.form.count()];
            one[j] = 1.0;
            let acting = Acting {
                effect: term,
                values: one,
                on,
            };
            departures.push(Departure::Effect { acting, only: None });
            rows.push(values.row(j).into_owned());
        }
    }
    let (eta, beta) = (&film.state.eta, &film.state.beta);
    let torques = problem.train.departures(eta, beta, &departures)?;
    let filtered = problem.train.filtered_departures(&torques);
    Ok((filtered, DMatrix::from_rows(&rows)))
}

/// The problem with the unknowns of chosen groups, of which `torques` are those of the coefficients; the
/// variance of what is left is about `noise`.
fn joint<S: Subject>(
    problem: &Problem<S>,
    members: &[(usize, f64)],
    products: &Products,
    (torques, coefficients): &(Vec<DMatrix<f64>>, DMatrix<f64>),
    noise: f64,
) -> Joint<S> {
    let (combine, means) = products.directions(members, noise);
    let mut train = problem
        .train
        .with_effects(Vec::new(), Vec::new(), &problem.train_when);
    train.allow_more(torques, &(coefficients * &combine));
    let mut linear = problem.linear.clone();
    linear.extend(means.iter().map(|&mean| Unknown {
        prior: Some(Prior { mean, sd: 1.0 }),
        ..Unknown::free(0.0, -FARTHEST, FARTHEST)
    }));
    Joint {
        problem: Problem {
            train,
            holdout: None,
            train_when: problem.train_when.clone(),
            holdout_when: Vec::new(),
            assumed: None,
            nonlinear: problem.nonlinear.clone(),
            linear,
            independent: problem.independent,
            begun: problem.begun.clone(),
            weighed_at: None,
            smoothed_at: None,
            memory: problem.memory.clone(),
            tally: problem.tally.clone(),
        },
        combine,
    }
}

/// A site with its groups and the film beside them.
struct Sited<S> {
    place: Place,
    joint: Joint<S>,
    fitted: Fitted,
    /// The film with the terms as they act.
    acting: Fitted,
    groups: Vec<Known>,
    members: Vec<(usize, f64)>,
    /// -2 ln L over that of no term.
    score: f64,
}

/// Fits film and groups of a site together, and chooses the groups again about the film that is found.
fn site<S: Subject>(
    problem: &Problem<S>,
    about: &About,
    plain: &Fitted,
    list: &[Known],
    first: Choice,
    price: f64,
) -> Result<Option<Sited<S>>, Locked> {
    let own = problem.nonlinear.len();
    let mut choice = first;
    let mut film = problem.typical();
    let mut here = None;
    let squares_of = |fit: &Fitted, noise: f64| {
        let own = &fit.state;
        let priors = (own.cost - own.data_cost) / noise;
        own.data_cost + about.noise_of(own.data_cost) * priors
    };
    let nothing = about.count * (squares_of(plain, 1.0) / about.count).ln();
    let mut best: Option<Sited<S>> = None;
    for round in 0..ROUNDS {
        let about = here.as_ref().unwrap_or(about);
        let (groups, members) = refined(problem, about, list, &choice.members);
        let mut products = Products::new(about, &groups);
        (0..groups.len()).for_each(|i| products.meet(i));
        let mut noise = about.noise_of(products.judge(&members).1);
        let torques = torques(problem, &film, &groups, &members)?;
        let fit = |noise: f64, film: &mut Fitted| {
            let tempered = problem.tempered(noise);
            let joint = joint(&tempered, &members, &products, &torques, noise);
            let more = joint.combine.ncols();
            let beta = [&film.state.beta[..], &vec![0.0; more][..]].concat();
            let fitted = (joint.problem).fit(&[], &film.state.eta[..own], &beta, POLISH);
            *film = fitted.clone();
            film.state.beta.truncate(problem.linear.len());
            (joint, fitted)
        };
        // the less is left, the less is the film held to what is known beforehand; it has to be let go to see
        // whether less is left
        let mut step = fit(noise, &mut film);
        let mut held = squares_of(&step.1, noise);
        let mut freer = noise;
        while freer > 1.0 {
            freer = (freer / FREER).max(1.0);
            let mut other = film.clone();
            let next = fit(freer, &mut other);
            let squares = squares_of(&next.1, freer);
            if squares < held {
                (step, film, noise, held) = (next, other, freer, squares);
            }
        }
        let (joint, fitted) = step;
        // about the film that was found
        let left = about.noise_of(fitted.state.data_cost);
        let about = here.insert(About::new(&problem.tempered(left), &film)?);
        let mut products = Products::new(about, &groups);
        (0..groups.len()).for_each(|i| products.meet(i));
        let (g, _) = products.joined(&members, left);
        let log_det = log_det(g, left).map_or(f64::INFINITY, |l| l.0);
        let sizes = &fitted.state.beta[problem.linear.len()..];
        let jacobian = jacobian(problem, about, &groups, &members, &joint.combine, sizes);
        // as it acts, which is not linear where it takes away what a voltage makes
        let terms = terms_of(&groups, &members, &joint.combine, sizes);
        let beta = &fitted.state.beta[..problem.linear.len()];
        let acting = (problem.tempered(noise)).fit(&terms, &fitted.state.eta[..own], beta, POLISH);
        let cost = held.max(squares_of(&acting, noise));
        let score = about.count * (cost / about.count).ln() + log_det - nothing - jacobian
            + price * members.len() as f64;
        let better = best.as_ref().is_none_or(|b| score < b.score);
        if better {
            best = Some(Sited {
                place: groups[0].group.place,
                joint,
                fitted,
                acting,
                groups,
                members,
                score,
            });
        } else if round > 0 {
            break;
        }
        if round + 1 < ROUNDS {
            choice = Products::new(about, list).choose(price);
            if choice.members.is_empty() {
                break;
            }
        }
    }
    Ok(best)
}

/// What -2 ln L has of the voltage's own change: what acts on the voltage changes how much of it a torque
/// asks for. What makes more of it earns nothing by that.
fn jacobian<S: Subject>(
    problem: &Problem<S>,
    about: &About,
    groups: &[Known],
    members: &[(usize, f64)],
    combine: &DMatrix<f64>,
    sizes: &[f64],
) -> f64 {
    let unknowns = combine * DVector::from_column_slice(sizes);
    let mut slopes = DVector::from_element(about.tangent.residual.len(), 1.0);
    let mut from = 0;
    for &(i, _) in members {
        let count = groups[i].columns.ncols();
        if let Some(own) = &groups[i].slopes {
            slopes += own.as_ref() * unknowns.rows(from, count);
        }
        from += count;
    }
    let logs: f64 = slopes.iter().map(|s| s.max(0.02).ln()).sum();
    2.0 * problem.independent * logs.min(0.0)
}

/// Recordings, or parts of them where there are fewer, that are left out one at a time.
const PARTS: usize = 4;

/// Squares of each recording (of its parts, where there are few) that a model fitted to all others leaves;
/// clocks stay where all recordings put them.
fn left_out<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Result<Vec<f64>, Locked> {
    let recordings = problem.train_when.len();
    let (own, offsets) = (problem.nonlinear.len(), BRANCHES + 1);
    let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
    let each = PARTS.div_ceil(recordings.max(1));
    let (mut before, mut list) = (0, Vec::new());
    for r in 0..recordings {
        let kept = problem.train.kept_times_s(r).len();
        for part in 0..each {
            let range = kept * part / each..kept * (part + 1) / each;
            if !range.is_empty() {
                list.push((r, range, before));
            }
        }
        before += kept;
    }
    list.into_par_iter()
        .map(|(r, kept, before)| {
            let mut nonlinear = problem.nonlinear.clone();
            for (u, at) in nonlinear.iter_mut().zip(eta).skip(offsets) {
                *u = Unknown::fixed(*at);
            }
            let (first, count) = (S::CHAINS * (before + kept.start), S::CHAINS * kept.len());
            let others = Problem {
                train: problem.train.without(r, kept),
                holdout: None,
                train_when: problem.train_when.clone(),
                holdout_when: Vec::new(),
                assumed: None,
                nonlinear,
                linear: problem.linear.clone(),
                independent: problem.independent,
                begun: problem.begun.clone(),
                weighed_at: None,
                smoothed_at: None,
                memory: problem.memory.clone(),
                tally: problem.tally.clone(),
            };
            let told = others.fit(&[], &eta[..own], beta, POLISH);
            let design = problem.train.design(&told.state.eta, &told.state.beta)?;
            let left = design.column(design.ncols() - 1);
            Ok(left.rows(first, count).norm_squared())
        })
        .collect()
}

/// Learns what the plain model of `plain` leaves. `None` where no site has anything.
///
/// # Errors
/// [`Locked`] when the film is past its locking stretch.
pub(super) fn learn<S: Subject>(
    problem: &Problem<S>,
    plain: &Fitted,
) -> Result<Option<Taught>, Locked> {
    // A film that was fitted without the term has bent to it, to where nothing is linear any more; an
    // ordinary one, whose moduli are linear, has not.
    let noise = (plain.cost() / plain.state.rows as f64).max(1.0);
    let about = About::new(&problem.tempered(noise), &problem.typical())?;
    let tangent = &about.tangent;
    let left = &tangent.residual - &tangent.columns * tangent.absorbed(tangent.slope());
    let groups = problem.train.dictionary(&left);
    if groups.is_empty() {
        return Ok(None);
    }
    let mut all: Vec<Known> = (groups.par_iter())
        .flat_map(|g| known(&problem.train, g))
        .collect();
    let price = 2.0 * (all.len() as f64).ln();
    let mut promising = Vec::new();
    for place in Place::ALL {
        let list: Vec<Known> = all.extract_if(.., |k| k.group.place == place).collect();
        let mut list = list;
        list.extend(sharpened(problem, &about, &list));
        let choice = Products::new(&about, &list).choose(price);
        if !choice.members.is_empty() {
            promising.push((list, choice));
        }
    }
    promising.sort_by(|a, b| a.1.score.total_cmp(&b.1.score));
    promising.truncate(SITES);
    let tried: Vec<Sited<S>> = promising
        .into_par_iter()
        .map(|(list, first)| site(problem, &about, plain, &list, first, price))
        .collect::<Result<Vec<_>, _>>()?
        .into_iter()
        .flatten()
        .collect();
    let nothing = left_out(&problem.tempered(noise), plain)?;
    let all = |list: &[f64]| list.iter().sum::<f64>();
    let mut best: Option<(f64, f64, Sited<S>)> = None;
    for told in tried {
        let out = left_out(&told.joint.problem, &told.fitted)?;
        let each = out.iter().zip(&nothing).map(|(a, b)| (a / b).ln());
        // the mean of what recordings say whose noise differs, and of what they say whose noise is the same
        let (typical, whole) = (
            each.sum::<f64>() / out.len() as f64,
            (all(&out) / all(&nothing)).ln(),
        );
        let log = 0.5 * (typical + whole);
        // what does not help with recordings that were left out was not learnt
        if log >= -HELPS || told.score >= 0.0 {
            continue;
        }
        let total = told.score + about.count * log;
        if best.as_ref().is_none_or(|b| total < b.0) {
            best = Some((total, log, told));
        }
    }
    let Some((_, left_out, told)) = best else {
        return Ok(None);
    };
    let open = told.open(problem, &about);
    Ok(Some(Taught {
        place: told.place,
        open,
        left_out,
        fitted: told.acting,
    }))
}

/// Logarithm of the factor by which less has to be left of recordings that are left out. A convention, beside
/// what a term of the wrong kind brings about by bending the film; the cases that the proof quotes had no
/// part in it.
const HELPS: f64 = 0.1;

impl<S: Subject> Sited<S> {
    /// What the recordings leave open of each term: the covariance of its coefficients, film and other terms
    /// being open too, and the probability of its group.
    fn open(&self, problem: &Problem<S>, about: &About) -> Vec<(DMatrix<f64>, f64)> {
        let state = &self.fitted.state;
        let noise = about.noise_of(state.data_cost);
        let own = &self.joint.problem;
        let size = state.eta.len() + state.beta.len();
        let mut h = state.gram().view((0, 0), (size, size)).into_owned();
        let unknowns = own.nonlinear.iter().chain(&own.linear);
        for (i, u) in unknowns.enumerate() {
            h[(i, i)] += u.prior.map_or(1e-12, |p| p.sd.powi(-2));
        }
        let scale: Vec<f64> = (0..size)
            .map(|i| 1.0 / h[(i, i)].sqrt().max(f64::MIN_POSITIVE))
            .collect();
        let scaled = DMatrix::from_fn(size, size, |i, j| {
            scale[i] * scale[j] * h[(i, j)] + if i == j { 1e-12 } else { 0.0 }
        });
        let more = self.joint.combine.ncols();
        let first = size - more;
        let inverse = scaled.cholesky().map(|c| c.inverse());
        let covariance = DMatrix::from_fn(more, more, |i, j| {
            let (i, j) = (first + i, first + j);
            let of = |m: &DMatrix<f64>| m[(i, j)] * scale[i] * scale[j];
            inverse.as_ref().map_or(f64::NAN, of) * noise / problem.independent
        });
        let mut products = Products::new(about, &self.groups);
        (0..self.groups.len()).for_each(|i| products.meet(i));
        let all = products.judge(&self.members).0;
        let mut out = Vec::new();
        for (at, &(i, _)) in self.members.iter().enumerate() {
            let mut others = self.members.clone();
            others.remove(at);
            let without = match others.is_empty() {
                true => about.count * (about.base / about.count).ln(),
                false => products.judge(&others).0,
            };
            let inclusion = 1.0 / (1.0 + (0.5 * (all - without)).clamp(-700.0, 700.0).exp());
            let count = self.groups[i].on.len() * self.groups[i].terms.len();
            out.extend(std::iter::repeat_n(inclusion, count));
        }
        let of = |((_, _, values), inclusion): ((_, _, DMatrix<f64>), f64)| {
            let to = values * &self.joint.combine;
            (&to * &covariance * to.transpose(), inclusion)
        };
        let parts = parts(&self.groups, &self.members);
        parts.into_iter().zip(out).map(of).collect()
    }
}
