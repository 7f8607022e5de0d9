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
//! the residual; S: scales). The site whose groups are likeliest is where it acts. Film and term are then
//! fitted in turn, each with the other's change projected out or refitted, and the site is told again about
//! the film that was found, because a film that was fitted without the term has bent to it.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use rayon::prelude::*;

use super::POLISH;
use super::problem::{Fitted, Problem, Tangent};
use super::subject::Subject;
use crate::effects::Acting;
use crate::effects::learnt::{Form, Learnt, Place};
use crate::film::Locked;
use crate::fit::separable::{Prior, Unknown};
use crate::kinematics::dot;
use crate::residual::Departure;

/// Groups of one site at most.
const GROUPS: usize = 3;
/// Scales that are tried: the square of one times the mean squared length of a group's columns.
const SCALES: [f64; 9] = [1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8];
/// Sites that are fitted with the film, and times that each one's groups are chosen.
const SITES: usize = 3;
const ROUNDS: usize = 2;
/// A direction in which one standard deviation of its prior changes the sum of squares by less is left out.
const VISIBLE: f64 = 0.05;
/// A direction may go as far as this many standard deviations.
const FARTHEST: f64 = 1e6;
/// Times that the variance of what is left is told.
const NOISE_ROUNDS: usize = 4;
/// Steps in which a film is let go.
const FREER: f64 = 10.0;
/// Share of what remains that a further group has to take away.
const WORTH: f64 = 0.05;

/// Columns at one site that join together.
#[derive(Clone)]
pub(super) struct Group {
    pub place: Place,
    pub forms: Vec<Form>,
    /// Whether neighbouring coefficients are alike: values at knots.
    pub smooth: bool,
}

/// A group with its columns.
#[derive(Clone)]
struct Known {
    group: Group,
    terms: Vec<&'static Learnt>,
    /// The actuators of each part.
    on: Vec<[bool; 3]>,
    /// Whitened columns of standard normal unknowns.
    columns: Arc<DMatrix<f64>>,
    /// From those unknowns to coefficients, for each part.
    roots: Vec<DMatrix<f64>>,
    /// What the unknowns change of the slope of the squared voltage; nothing where they do not act on it.
    slopes: Option<Arc<DMatrix<f64>>>,
}

/// What was learnt.
pub(super) struct Taught {
    /// The fit with the terms as effects.
    pub fitted: Fitted,
    /// The site.
    pub place: Place,
    /// Covariance of each term's coefficients, and the probability that its group belongs to the site.
    pub open: Vec<(DMatrix<f64>, f64)>,
    /// Mean of the logarithm of what is left of each recording that is left out over what the plain model
    /// leaves.
    pub left_out: f64,
}

/// What a term does along recordings.
#[derive(Default)]
pub(super) struct Made {
    /// Range of each of its variables.
    pub range: Vec<[f64; 2]>,
    /// The largest that it makes, in the unit of its place.
    pub largest: f64,
    /// Net work, and the sum of what is exchanged, in units that are alike.
    pub work: f64,
    pub exchanged: f64,
}

/// Chosen groups of a site with their scales (in standard normal unknowns).
#[derive(Clone, Default)]
struct Choice {
    members: Vec<(usize, f64)>,
    score: f64,
}

/// Lower root of the prior covariance of a group's coefficients, each of unit variance.
fn prior_root(group: &Group, lengths: &[f64]) -> DMatrix<f64> {
    let n = lengths.len();
    if group.smooth {
        let near = |i: usize, j: usize| {
            let d = i.abs_diff(j) as f64 / SMOOTH;
            (-0.5 * d * d).exp() + if i == j { 1e-4 } else { 0.0 }
        };
        let k = DMatrix::from_fn(n, n, near);
        return k
            .cholesky()
            .map_or_else(|| DMatrix::identity(n, n), |c| c.l());
    }
    // of unlike units: each column counts alike
    let mean = lengths.iter().sum::<f64>() / n as f64;
    let each = lengths
        .iter()
        .map(|l| if *l > 1e-9 * mean { mean / l } else { 0.0 });
    DMatrix::from_diagonal(&DVector::from_iterator(n, each))
}

/// Knots over which values at knots are alike.
const SMOOTH: f64 = 1.2;

/// The columns of a group, shared by all actuators and one set for each: they do not depend on the film.
fn known<S: Subject>(residual: &S, group: &Group) -> Vec<Known> {
    let term = |f: &Form| Learnt::new(group.place, f.clone(), Vec::new());
    let terms: Vec<&'static Learnt> = group.forms.iter().map(term).collect();
    let n = group.forms.iter().map(Form::count).sum::<usize>();
    let electrical = terms.iter().any(|t| t.electrical());
    let mut raw = [(); 3].map(|()| DMatrix::zeros(0, n));
    let mut slopes = raw.clone();
    let mut from = 0;
    for term in &terms {
        let (columns, slope) = residual.term_columns(term);
        let count = term.form.count();
        let put = |all: &mut [DMatrix<f64>; 3], own: [DMatrix<f64>; 3]| {
            for (all, own) in all.iter_mut().zip(own) {
                if all.nrows() == 0 {
                    *all = DMatrix::zeros(own.nrows(), n);
                }
                all.columns_mut(from, count).copy_from(&own);
            }
        };
        put(&mut raw, columns);
        if let Some(slope) = slope {
            put(&mut slopes, slope);
        }
        from += count;
    }
    let finite = |m: &DMatrix<f64>| m.iter().all(|x| x.is_finite());
    if !raw.iter().chain(&slopes).all(finite) {
        return Vec::new();
    }
    let lengths: Vec<f64> = (0..n)
        .map(|j| {
            raw.iter()
                .map(|m| m.column(j).norm_squared())
                .sum::<f64>()
                .sqrt()
        })
        .collect();
    if lengths.iter().all(|l| *l < 1e-9) {
        return Vec::new();
    }
    let root = prior_root(group, &lengths);
    let on: Vec<[bool; 3]> = (0..3).map(|k| [0, 1, 2].map(|j| j == k)).collect();
    let of = |sets: &[bool]| -> Vec<Known> {
        sets.iter()
            .map(|each| {
                let put = |all: &[DMatrix<f64>; 3]| match each {
                    false => (&all[0] + &all[1] + &all[2]) * &root,
                    true => {
                        let mut out = DMatrix::zeros(all[0].nrows(), 3 * n);
                        for (k, own) in all.iter().enumerate() {
                            out.columns_mut(k * n, n).copy_from(&(own * &root));
                        }
                        out
                    }
                };
                let on = if *each { on.clone() } else { vec![[true; 3]] };
                Known {
                    columns: Arc::new(put(&raw)),
                    slopes: electrical.then(|| Arc::new(put(&slopes))),
                    group: group.clone(),
                    terms: terms.clone(),
                    roots: vec![root.clone(); on.len()],
                    on,
                }
            })
            .collect()
    };
    of(match group.place {
        Place::Force => &[false],
        _ => &[false, true],
    })
}

/// A film without terms: its residual, and what of products a refit absorbs.
struct About {
    tangent: Tangent,
    /// Sum of squares with priors, after the refit.
    base: f64,
    /// Rows that count as independent.
    count: f64,
}

impl About {
    /// Variance of what is left where the sum of squares is this.
    fn noise_of(&self, squares: f64) -> f64 {
        (squares / self.tangent.residual.len() as f64).max(1.0)
    }
}

impl About {
    /// The film of a fit, without its terms.
    fn new<S: Subject>(problem: &Problem<S>, film: &Fitted) -> Result<Self, Locked> {
        let tangent = Tangent::new(problem, film)?;
        let at = film.state.eta.iter().chain(&film.state.beta);
        let unknowns = problem.nonlinear.iter().chain(&problem.linear);
        let priors: f64 = (at.zip(unknowns))
            .filter_map(|(x, u)| u.prior.map(|p| ((x - p.mean) / p.sd).powi(2)))
            .sum();
        let slope = tangent.slope();
        Ok(About {
            base: tangent.residual.norm_squared() + priors - slope.dot(&tangent.absorbed(slope)),
            count: problem.independent * tangent.residual.len() as f64,
            tangent,
        })
    }
}

/// a'b: through the fast product, which the transposed one of nalgebra is not.
fn product(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    a.transpose() * b
}

/// Projected products of the groups of one site: of each with itself, and of the chosen ones with all.
struct Products<'a> {
    about: &'a About,
    groups: &'a [Known],
    along: Vec<DMatrix<f64>>,
    own: Vec<DMatrix<f64>>,
    across: BTreeMap<(usize, usize), DMatrix<f64>>,
    score: Vec<DVector<f64>>,
    /// Products of the slopes of each with themselves, their sums, and products across.
    slope_own: Vec<Option<DMatrix<f64>>>,
    slope_sum: Vec<Option<DVector<f64>>>,
    slope_across: BTreeMap<(usize, usize), DMatrix<f64>>,
}

impl<'a> Products<'a> {
    fn new(about: &'a About, groups: &'a [Known]) -> Self {
        let tangent = &about.tangent;
        let made: Vec<_> = (groups.par_iter())
            .map(|g| {
                let along = product(&tangent.columns, &g.columns);
                let absorbed = tangent.absorb(&along);
                let own = product(&g.columns, &g.columns) - product(&along, &absorbed);
                let score = g.columns.tr_mul(&tangent.residual) - absorbed.tr_mul(tangent.slope());
                (along, own, score)
            })
            .collect();
        let (mut along, mut own, mut score) = (Vec::new(), Vec::new(), Vec::new());
        for (a, o, s) in made {
            along.push(a);
            own.push(o);
            score.push(s);
        }
        let slope_own = |g: &Known| g.slopes.as_ref().map(|s| product(s, s));
        let slope_sum = |g: &Known| g.slopes.as_ref().map(|s| s.row_sum().transpose());
        Products {
            about,
            groups,
            along,
            own,
            across: BTreeMap::new(),
            score,
            slope_own: groups.iter().map(slope_own).collect(),
            slope_sum: groups.iter().map(slope_sum).collect(),
            slope_across: BTreeMap::new(),
        }
    }

    /// Works out the products of one group with all others.
    fn meet(&mut self, i: usize) {
        let tangent = &self.about.tangent;
        let absorbed = tangent.absorb(&self.along[i]);
        let (groups, along) = (self.groups, &self.along);
        let me = &groups[i];
        let made: Vec<_> = (0..groups.len())
            .into_par_iter()
            .filter(|&j| j != i)
            .map(|j| {
                let own = product(&me.columns, &groups[j].columns) - product(&absorbed, &along[j]);
                let slopes =
                    (me.slopes.as_ref().zip(groups[j].slopes.as_ref())).map(|(a, b)| product(a, b));
                (j, own, slopes)
            })
            .collect();
        for (j, own, slopes) in made {
            self.across.insert((i, j), own);
            if let Some(slopes) = slopes {
                self.slope_across.insert((i, j), slopes);
            }
        }
    }

    /// Products of two groups, of which one is a chosen one, where the noise has this variance.
    fn between(&self, i: usize, j: usize, noise: f64) -> DMatrix<f64> {
        let (product, slopes) = match () {
            () if i == j => (self.own[i].clone(), self.slope_own[i].clone()),
            () => match self.across.get(&(i, j)) {
                Some(known) => (known.clone(), self.slope_across.get(&(i, j)).cloned()),
                None => (
                    self.across[&(j, i)].transpose(),
                    self.slope_across.get(&(j, i)).map(DMatrix::transpose),
                ),
            },
        };
        match slopes {
            Some(slopes) => product + slopes * noise,
            None => product,
        }
    }

    /// Scaled products of chosen groups, and their products with the residual.
    ///
    /// What acts on the voltage changes how much of it a torque asks for, and the voltage is what was
    /// recorded: -2 ln L has -2 sum ln(1 + slope), here to second order. Without it a term that takes away
    /// what is made would leave a film that takes nothing nothing to explain.
    fn joined(&self, members: &[(usize, f64)], noise: f64) -> (DMatrix<f64>, DVector<f64>) {
        let size = members.iter().map(|m| self.score[m.0].len()).sum();
        let (mut g, mut b) = (DMatrix::zeros(size, size), DVector::zeros(size));
        let mut row = 0;
        for &(i, s) in members {
            let n = self.score[i].len();
            b.rows_mut(row, n).copy_from(&(s * &self.score[i]));
            if let Some(sum) = &self.slope_sum[i] {
                b.rows_mut(row, n).axpy(-s * noise, sum, 1.0);
            }
            let mut column = 0;
            for &(j, t) in members {
                let m = self.score[j].len();
                g.view_mut((row, column), (n, m))
                    .copy_from(&(s * t * self.between(i, j, noise)));
                column += m;
            }
            row += n;
        }
        (g, b)
    }

    /// -2 ln L and Q of chosen groups.
    fn judge(&self, members: &[(usize, f64)]) -> (f64, f64) {
        let about = self.about;
        let mut noise = about.noise_of(about.base);
        let mut out = (f64::INFINITY, about.base);
        // the noise is that of what is left
        for _ in 0..NOISE_ROUNDS {
            let (g, b) = self.joined(members, noise);
            let Some((log_det, c)) = log_det(g, noise) else {
                return out;
            };
            let q = (about.base - b.dot(&c.solve(&b))).max(1e-6 * about.base);
            let before = out.0;
            out = (about.count * (q / about.count).ln() + log_det, q);
            noise = about.noise_of(q);
            if (out.0 - before).abs() < 1.0 {
                break;
            }
        }
        out
    }

    /// Directions (columns, in unknowns of the chosen groups one after the other) that recordings see, and the
    /// means of their priors of standard deviation 1.
    fn directions(&self, members: &[(usize, f64)], noise: f64) -> (DMatrix<f64>, Vec<f64>) {
        let (g, b) = self.joined(members, noise);
        let (plain, without) = self.joined(members, 0.0);
        let eigen = SymmetricEigen::new(g.clone());
        let seen: Vec<usize> = (0..eigen.eigenvalues.len())
            .filter(|&i| eigen.eigenvalues[i] > VISIBLE * noise)
            .collect();
        let seen = eigen.eigenvectors.select_columns(&seen);
        // what the slopes ask for is part of the prior
        let size = seen.ncols();
        let precision = seen.tr_mul(&((g - plain) * &seen)) + DMatrix::identity(size, size) * noise;
        let pull = seen.tr_mul(&(without - b));
        let Some(root) = precision.cholesky() else {
            return (seen, vec![0.0; pull.len()]);
        };
        let lower = root.l();
        let back = |m: &DMatrix<f64>| lower.tr_solve_lower_triangular(m);
        let turned = back(&DMatrix::identity(lower.nrows(), lower.nrows()));
        let means = lower.solve_lower_triangular(&pull);
        let (Some(turned), Some(means)) = (turned, means) else {
            return (seen, vec![0.0; pull.len()]);
        };
        let mut out = seen * turned;
        let mut row = 0;
        for &(i, scale) in members {
            for _ in 0..self.score[i].len() {
                out.row_mut(row).scale_mut(scale);
                row += 1;
            }
        }
        (out, means.iter().copied().collect())
    }

    /// Mean squared length of a group's columns.
    fn unit(&self, i: usize) -> f64 {
        let g = &self.own[i];
        (g.trace() / g.nrows() as f64).max(f64::MIN_POSITIVE)
    }

    /// Groups joined one after the other.
    fn choose(&mut self, price: f64) -> Choice {
        let about = self.about;
        let plain = about.count * (about.base / about.count).ln();
        let mut best = Choice {
            members: Vec::new(),
            score: plain,
        };
        let mut left = about.base;
        while best.members.len() < GROUPS {
            let tried: Vec<(Choice, f64)> = (0..self.score.len())
                .into_par_iter()
                .filter(|i| best.members.iter().all(|m| m.0 != *i))
                .flat_map_iter(|i| {
                    let best = &best;
                    let this = &*self;
                    SCALES.iter().map(move |s| {
                        let mut members = best.members.clone();
                        members.push((i, (s / this.unit(i)).sqrt()));
                        let (score, q) = this.judge(&members);
                        let score = score + price * members.len() as f64;
                        (Choice { members, score }, q)
                    })
                })
                .collect();
            let next = tried
                .into_iter()
                .min_by(|a, b| a.0.score.total_cmp(&b.0.score));
            let Some((next, q)) = next else { break };
            let excess = (left - about.count).max(0.0);
            if next.score >= best.score || left - q < WORTH * excess {
                break;
            }
            left = q;
            self.meet(next.members[next.members.len() - 1].0);
            best = next;
            // scales of those that were there are told again beside the new one
            for at in 0..best.members.len() {
                let (i, _) = best.members[at];
                for s in SCALES {
                    let mut members = best.members.clone();
                    members[at].1 = (s / self.unit(i)).sqrt();
                    let score = self.judge(&members).0 + price * members.len() as f64;
                    if score < best.score {
                        best = Choice { members, score };
                    }
                }
            }
        }
        best.score -= plain;
        best
    }
}

/// ln det(1 + G/noise) and the factor of noise + G.
fn log_det(mut g: DMatrix<f64>, noise: f64) -> Option<(f64, Cholesky<f64, Dyn>)> {
    let size = g.nrows() as f64;
    for i in 0..g.nrows() {
        g[(i, i)] += noise;
    }
    let c = g.cholesky()?;
    let log = 2.0 * c.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
    Some((log - size * noise.ln(), c))
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

/// What each coefficient of chosen groups changes of the torque error at the kept samples, and the coefficients (rows) that the
/// groups' unknowns make.
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
            nonlinear: problem.nonlinear.clone(),
            linear,
            independent: problem.independent,
            begun: problem.begun.clone(),
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

/// Groups like this one whose shape differs by a little more or less.
fn neighbours(group: &Group, by: f64) -> Vec<Group> {
    let like = |change: &dyn Fn(&Form) -> Form| Group {
        forms: group.forms.iter().map(change).collect(),
        ..group.clone()
    };
    match &group.forms[0] {
        Form::Oscillator { .. } => [(by, 0.0), (-by, 0.0), (0.0, 20.0 * by), (0.0, -20.0 * by)]
            .into_iter()
            .map(|(faster, damped)| like(&|form| faster_swing(form, faster, damped)))
            .collect(),
        Form::Wave { .. } => [0.1 * by, -0.1 * by]
            .into_iter()
            .map(|by| like(&|form| faster_wave(form, by)))
            .collect(),
        Form::Ridge { .. } => (0..3)
            .flat_map(|axis| [(axis, 5.0 * by), (axis, -5.0 * by)])
            .map(|(axis, by)| like(&|form| turned(form, axis, by)))
            .collect(),
        _ => Vec::new(),
    }
}

/// Frequencies (Hz) and dampings that a swing may be given.
const SWING_HZ: (f64, f64) = (0.2, 15.0);
const SWING_DAMPING: (f64, f64) = (0.004, 1.5);

fn faster_swing(form: &Form, faster: f64, damped: f64) -> Form {
    match form {
        Form::Oscillator {
            frequency_hz,
            damping,
        } => Form::Oscillator {
            frequency_hz: (frequency_hz * faster.exp()).clamp(SWING_HZ.0, SWING_HZ.1),
            damping: (damping * damped.exp()).clamp(SWING_DAMPING.0, SWING_DAMPING.1),
        },
        other => other.clone(),
    }
}

fn faster_wave(form: &Form, faster: f64) -> Form {
    match form {
        Form::Wave { frequency_hz, by } => Form::Wave {
            frequency_hz: frequency_hz * faster.exp(),
            by: *by,
        },
        other => other.clone(),
    }
}

fn turned(form: &Form, axis: usize, by: f64) -> Form {
    match form {
        Form::Ridge { along, knots } => {
            let mut along = *along;
            along[axis] += by;
            let length = dot(along, along).sqrt();
            Form::Ridge {
                along: along.map(|x| x / length),
                knots: knots.clone(),
            }
        }
        other => other.clone(),
    }
}

/// The best of each form whose shape can be refined, refined alone: what is a little off in frequency or
/// direction must not lose to what is merely flexible.
fn sharpened<S: Subject>(problem: &Problem<S>, about: &About, list: &[Known]) -> Vec<Known> {
    let products = Products::new(about, list);
    let kind = |k: &Known| std::mem::discriminant(&k.group.forms[0]);
    let mut best: Vec<(f64, (usize, f64))> = Vec::new();
    for (i, known) in list.iter().enumerate() {
        if neighbours(&known.group, REFINE.0).is_empty() {
            continue;
        }
        let scaled = SCALES.map(|s| (i, (s / products.unit(i)).sqrt()));
        let own = scaled.map(|m| (products.judge(&[m]).0, m));
        let own = own.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let own = own.expect("scales");
        match best.iter_mut().find(|b| kind(&list[b.1.0]) == kind(known)) {
            Some(b) if own.0 < b.0 => *b = own,
            Some(_) => {}
            None => best.push(own),
        }
    }
    let refine = |b: (f64, (usize, f64))| refined(problem, about, list, &[b.1]).0;
    best.into_iter().flat_map(refine).collect()
}

/// Chosen groups with shapes that do better, found by steps that halve; their scales.
fn refined<S: Subject>(
    problem: &Problem<S>,
    about: &About,
    list: &[Known],
    members: &[(usize, f64)],
) -> (Vec<Known>, Vec<(usize, f64)>) {
    let mut own: Vec<Known> = members.iter().map(|m| list[m.0].clone()).collect();
    let scales: Vec<(usize, f64)> = members.iter().map(|m| m.1).enumerate().collect();
    let judge = |own: &[Known]| {
        let mut products = Products::new(about, own);
        (0..own.len()).for_each(|i| products.meet(i));
        products.judge(&scales).0
    };
    let mut score = judge(&own);
    for at in 0..own.len() {
        let mut by = REFINE.0;
        while by > REFINE.1 {
            let tried: Vec<(f64, Known)> = (neighbours(&own[at].group, by).into_par_iter())
                .filter_map(|group| {
                    let each = own[at].on.len() > 1;
                    let other = known(&problem.train, &group)
                        .into_iter()
                        .find(|k| (k.on.len() > 1) == each)?;
                    let mut with = own.clone();
                    with[at] = other.clone();
                    Some((judge(&with), other))
                })
                .collect();
            match tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
                Some((new, other)) if new < score => (score, own[at]) = (new, other),
                Some(_) => by *= 0.5,
                None => break,
            }
        }
    }
    (own, scales)
}

/// First and last step by which a shape is varied.
const REFINE: (f64, f64) = (0.04, 2e-3);

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
        choice = Products::new(about, list).choose(price);
        if choice.members.is_empty() {
            break;
        }
    }
    Ok(best)
}

/// What -2 ln L has of the voltage's own change: what acts on the voltage changes how much of it a torque asks
/// for. What makes more of it earns nothing by that.
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

/// Squares of each recording that a model fitted to all others leaves; clocks stay where all recordings put
/// them.
fn left_out<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> Result<Vec<f64>, Locked> {
    let recordings = problem.train_when.len();
    let (own, offsets) = (problem.nonlinear.len(), super::problem::BRANCHES + 1);
    let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
    let mut from = 0;
    let rows: Vec<_> = (0..recordings)
        .map(|r| {
            let count = S::CHAINS * problem.train.kept_times_s(r).len();
            from += count;
            (from - count, count)
        })
        .collect();
    (0..recordings)
        .into_par_iter()
        .map(|r| {
            let mut nonlinear = problem.nonlinear.clone();
            for (u, at) in nonlinear.iter_mut().zip(eta).skip(offsets) {
                *u = Unknown::fixed(*at);
            }
            let others = Problem {
                train: problem.train.without(r),
                holdout: None,
                train_when: problem.train_when.clone(),
                holdout_when: Vec::new(),
                nonlinear,
                linear: problem.linear.clone(),
                independent: problem.independent,
                begun: problem.begun.clone(),
            };
            let told = others.fit(&[], &eta[..own], beta, POLISH);
            let design = problem.train.design(&told.state.eta, &told.state.beta)?;
            let (first, count) = rows[r];
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
    let mut best: Option<(f64, f64, Sited<S>)> = None;
    for told in tried {
        let out = left_out(&told.joint.problem, &told.fitted)?;
        let each = out.iter().zip(&nothing).map(|(a, b)| (a / b).ln());
        let log = each.sum::<f64>() / out.len() as f64;
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

/// Logarithm of the factor by which less has to be left of recordings that are left out: what a term of the
/// wrong kind brings about by bending the film elsewhere.
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
