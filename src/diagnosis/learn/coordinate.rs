//! What may be learnt on a single coordinate, and how: groups join one after the other while they foretell
//! blocks that the fit left out.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::super::blocks::{BETTER, Blocks, Foretold, RIDGES};
use super::super::problem::Fitted;
use super::columns::prior_root;
use super::{Group, Made, POLISH, Problem, Subject, Tangent, Taught};
use crate::effects::Acting;
use crate::effects::learnt::{Form, Learnt, Place, Variable, wider};
use crate::effects::line::Kind;
use crate::film::Locked;
use crate::residual::line::LineResidual;

/// Groups that join, at most.
const MOST: usize = 3;
/// The ridge at which groups are held against each other.
const FIRST: f64 = 1e-2;
/// Logarithm of the density of what was left out that a group adds at least, beside what the choice among
/// groups costs: odds of twenty to one.
const ADDS: f64 = 3.0;
/// Share of the squares of what groups make that making them costs; by as much they are made too small.
const SPARING: f64 = 1e-3;
/// What holds an unknown to an end of its range, over the squares of its column.
const HELD: f64 = 1e9;
/// Share of the mean square of what was left out, and of what was fitted, that may remain.
const HELPS: f64 = 0.9;

/// Groups of columns with their terms.
struct Listed {
    terms: Vec<&'static Learnt>,
    /// Whitened columns of unknowns that are alike.
    columns: DMatrix<f64>,
    /// From those unknowns to coefficients.
    root: DMatrix<f64>,
}

/// `count` knots from low to high.
fn knots([low, high]: [f64; 2], count: usize) -> Vec<f64> {
    let share = |i: usize| i as f64 / (count - 1) as f64;
    (0..count).map(|i| low + (high - low) * share(i)).collect()
}

/// Knots on both sides of 0 up to `most`, closer where rates are small.
fn about_zero(most: f64, count: usize) -> Vec<f64> {
    let even = knots([-1.0, 1.0], count);
    even.into_iter().map(|x| most * x * x.abs()).collect()
}

/// What recordings of one coordinate may have; of what has no clock no rate is known.
fn dictionary(residual: &LineResidual) -> Vec<Group> {
    let (mut excursion, mut speed, mut span_s, mut timed) = ([0.0; 2], 0.0_f64, 0.0_f64, true);
    for (number, line) in residual.lines().enumerate() {
        let (time_s, xi, rate) = residual.course(number);
        for x in xi {
            excursion = wider(excursion, [*x, *x]);
        }
        speed = rate.iter().fold(speed, |m, r| m.max(r.abs()));
        span_s = span_s.max(time_s[time_s.len() - 1] - time_s[0]);
        timed &= line.timed;
    }
    let spline = |of, knots: Vec<f64>, by| Form::Spline { of, knots, by };
    let along = |count, by| spline(Variable::Excursion, knots(excursion, count), by);
    let group = |forms: Vec<Form>, smooth| Group {
        place: Place::Coordinate,
        forms,
        smooth,
    };
    let largest = excursion[1].max(-excursion[0]);
    let mut out = vec![
        group(
            vec![Form::Presliding {
                of: Variable::Excursion,
                ranges: vec![0.005, 0.03, 0.2],
            }],
            false,
        ),
        group(vec![along(9, Some(Variable::Sliding))], true),
        group(vec![along(25, Some(Variable::Sliding))], true),
        group(
            vec![spline(
                Variable::LargestExcursion,
                knots([0.0, largest], 5),
                Some(Variable::Excursion),
            )],
            true,
        ),
    ];
    // a bench has a curve of the excursion already, but for what is finer than its nodes
    let counts: &[usize] = match residual.kind() {
        Kind::Bench => &[33, 97],
        _ => &[9, 33, 97],
    };
    out.extend(counts.iter().map(|n| group(vec![along(*n, None)], true)));
    if timed && speed > 0.0 {
        let rates = about_zero(speed, 13);
        out.push(group(
            vec![spline(Variable::ExcursionRate, rates, None)],
            true,
        ));
        out.push(group(vec![along(9, Some(Variable::ExcursionRate))], true));
        let of_time = |by| Form::Lag {
            of: Variable::Excursion,
            times_s: [0.002, 0.01, 0.05, 0.2]
                .map(|share| share * span_s)
                .to_vec(),
            by,
        };
        out.push(group(vec![of_time(None)], false));
    }
    if timed && residual.kind() == Kind::Axis {
        let masses = [
            Variable::ExcursionAcceleration,
            Variable::SquaredExcursionRate,
        ];
        let masses = masses.map(|by| along(7, Some(by)));
        out.push(group(masses.to_vec(), false));
    }
    out
}

fn listed(residual: &LineResidual, group: &Group) -> Option<Listed> {
    let term = |f: &Form| Learnt::new(group.place, f.clone(), Vec::new());
    let terms: Vec<&'static Learnt> = group.forms.iter().map(term).collect();
    let width = group.forms.iter().map(Form::count).sum();
    let mut raw = DMatrix::zeros(residual.rows(), width);
    let mut from = 0;
    for term in &terms {
        let count = term.form.count();
        raw.columns_mut(from, count)
            .copy_from(&residual.term_columns(term));
        from += count;
    }
    let lengths: Vec<f64> = raw.column_iter().map(|c| c.norm()).collect();
    if !raw.iter().all(|x| x.is_finite()) || lengths.iter().all(|l| *l < 1e-9) {
        return None;
    }
    let root = prior_root(group, &lengths);
    let columns = raw * &root;
    let mean = columns.norm() / (width as f64).sqrt();
    Some(Listed {
        terms,
        columns: columns / mean,
        root: root / mean,
    })
}

/// Chosen groups, each with its ridge.
type Chosen = Vec<(usize, f64)>;

/// The columns of chosen groups, and their ridges.
fn together(list: &[Listed], chosen: &Chosen) -> (DMatrix<f64>, DVector<f64>) {
    let width = chosen.iter().map(|c| list[c.0].columns.ncols()).sum();
    let rows = list[chosen[0].0].columns.nrows();
    let (mut columns, mut ridge) = (DMatrix::zeros(rows, width), DVector::zeros(width));
    let mut from = 0;
    for &(i, r) in chosen {
        let own = &list[i].columns;
        columns.columns_mut(from, own.ncols()).copy_from(own);
        ridge.rows_mut(from, own.ncols()).fill(r);
        from += own.ncols();
    }
    (columns, ridge)
}

/// What the model of a tangent with chosen groups foretells.
fn foretold(list: &[Listed], chosen: &Chosen, tangent: &Tangent, blocks: &Blocks) -> Foretold {
    let (columns, ridge) = together(list, chosen);
    // of columns of unlike lengths, each over its own
    let each = columns.column_iter().zip(ridge.iter());
    let own = each.map(|(c, r)| r / c.norm_squared().max(1e-12));
    let ridge = DVector::from_iterator(ridge.len(), own);
    blocks.foretell(tangent, Some((&columns, &ridge)))
}

/// The plain model and chosen groups together.
struct Solved {
    /// Inverse of the columns' products, ridges and priors included.
    inverse: DMatrix<f64>,
    /// Steps of the plain unknowns, and the groups' unknowns.
    step: DVector<f64>,
    /// What is left.
    left: DVector<f64>,
}

fn solved(list: &[Listed], chosen: &Chosen, tangent: &Tangent) -> Option<Solved> {
    let (columns, ridge) = together(list, chosen);
    let (own, more) = (tangent.columns.ncols(), columns.ncols());
    let mut all = DMatrix::zeros(columns.nrows(), own + more);
    all.columns_mut(0, own).copy_from(&tangent.columns);
    all.columns_mut(own, more).copy_from(&columns);
    let mut whole = all.tr_mul(&all);
    for (j, root) in tangent.prior_roots().iter().enumerate() {
        whole[(j, j)] += root * root + 1e-12;
    }
    for (j, r) in ridge.iter().enumerate() {
        whole[(own + j, own + j)] += r;
    }
    // what the model could make as well, it makes: its unknowns keep their meaning
    let mut corner = whole.view_mut((own, own), (more, more));
    corner += columns.tr_mul(&columns) * SPARING;
    // the plain unknowns are at their optimum
    let mut pull = all.tr_mul(&tangent.residual);
    pull.rows_mut(0, own).fill(0.0);
    // those that would leave their range end where it does: a damping that is negative is no fit's
    let mut ended = vec![false; own];
    let (inverse, step) = loop {
        let inverse = whole.clone().cholesky()?.inverse();
        let step = -(&inverse * &pull);
        let beyond = |j: usize| step[j].clamp(tangent.room()[j][0], tangent.room()[j][1]);
        let next = (0..tangent.room().len()).find(|&j| !ended[j] && beyond(j) != step[j]);
        let Some(j) = next else {
            break (inverse, step);
        };
        ended[j] = true;
        whole[(j, j)] += HELD;
        pull[j] -= HELD * beyond(j);
    };
    let left = &tangent.residual + &all * &step;
    Some(Solved {
        inverse,
        step,
        left,
    })
}

/// Learns what a model leaves on a single coordinate, the plain one or one with causes, whose values stay;
/// `independent` of the rows count. `None` where nothing foretells what was left out.
///
/// # Errors
/// [`Locked`] when a coupon's film is past its locking stretch.
pub(in crate::diagnosis) fn learn_along(
    problem: &Problem<LineResidual>,
    model: &Fitted,
    blocks: &Blocks,
    independent: f64,
) -> Result<Option<Taught>, Locked> {
    // causes stay as they are
    let mut held = model.clone();
    held.free.clear();
    held.state.eta.truncate(problem.nonlinear.len());
    let tangent = Tangent::new(problem, &held)?;
    let residual = problem.residual(&held);
    let list: Vec<Listed> = (dictionary(&residual).par_iter())
        .filter_map(|g| listed(&residual, g))
        .collect();
    let price = ADDS + (list.len().max(1) as f64).ln();
    let nothing = blocks.foretell(&tangent, None);
    let log = |f: &Foretold| f.log_density(independent);
    let best_of = |tried: Vec<Chosen>| {
        let told = tried.into_par_iter().map(|chosen| {
            let told = foretold(&list, &chosen, &tangent, blocks);
            (chosen, told)
        });
        told.max_by(|a, b| log(&a.1).total_cmp(&log(&b.1)))
    };
    // what a model with groups leaves is nearer to noise than what it leaves without: more rows count
    let counts = |left: &DVector<f64>| independent.max(residual.independent(left.as_slice()));
    let (mut chosen, mut reached) = (Chosen::new(), nothing.clone());
    while chosen.len() < MOST {
        let free = (0..list.len()).filter(|i| chosen.iter().all(|c| c.0 != *i));
        let with = |i: usize, ridge: f64| [&chosen[..], &[(i, ridge)]].concat();
        let Some((first, _)) = best_of(free.map(|i| with(i, FIRST)).collect()) else {
            break;
        };
        let next = first.last().map_or(0, |c| c.0);
        let Some((more, told)) = best_of(RIDGES.map(|r| with(next, r)).to_vec()) else {
            break;
        };
        let left = solved(&list, &more, &tangent).map(|s| s.left);
        let at = left.map_or(independent, |l| counts(&l));
        if told.log_density(at) < reached.log_density(at) + price {
            break;
        }
        (chosen, reached) = (more, told);
    }
    // what comes at a moment, or wanders, is not told better in block after block
    let helps = reached.mean_square() < HELPS * nothing.mean_square();
    if chosen.is_empty() || !helps || reached.beats(&nothing) < BETTER {
        return Ok(None);
    }
    let Some(Solved {
        inverse,
        step,
        left,
    }) = solved(&list, &chosen, &tangent)
    else {
        return Ok(None);
    };
    let own = tangent.columns.ncols();
    let more = step.len() - own;
    let square = left.norm_squared() / left.len() as f64;
    let open = inverse.view((own, own), (more, more)) * (square.max(1.0) / counts(&left));
    let (mut effects, mut told, mut from) = (Vec::new(), Vec::new(), 0);
    for (at, &(i, _)) in chosen.iter().enumerate() {
        let mut others = chosen.clone();
        others.remove(at);
        let without = match others.is_empty() {
            true => log(&nothing),
            false => log(&foretold(&list, &others, &tangent, blocks)),
        };
        let inclusion = 1.0 / (1.0 + (without - log(&reached)).clamp(-700.0, 700.0).exp());
        let Listed { terms, root, .. } = &list[i];
        let unknowns = step.rows(own + from, root.ncols());
        let covariance = open.view((from, from), (root.ncols(), root.ncols()));
        let mut row = 0;
        for term in terms {
            let count = term.form.count();
            let to = root.rows(row, count);
            effects.push(Acting {
                effect: *term,
                values: (to * unknowns).iter().copied().collect(),
                on: [true; 3],
            });
            told.push((to * covariance * to.transpose(), inclusion));
            row += count;
        }
        from += root.ncols();
    }
    let fitted = problem.fit_beside(model, &effects, POLISH);
    if fitted.state.data_cost > HELPS * model.state.data_cost {
        return Ok(None);
    }
    Ok(Some(Taught {
        fitted,
        place: Place::Coordinate,
        open: told,
        left_out: (reached.mean_square() / nothing.mean_square()).ln(),
    }))
}

/// What a term does along the recordings.
pub(in crate::diagnosis) fn made_along(residual: &LineResidual, acting: &Acting) -> Made {
    let mut out = Made::default();
    let Some(term) = acting.effect.learnt() else {
        return out;
    };
    out.range = vec![[f64::INFINITY, f64::NEG_INFINITY]; term.form.variables().len()];
    for number in 0..residual.lines().count() {
        let (_, xi, _) = residual.course(number);
        let at_rest = vec![0.0; xi.len()];
        let view = residual.view(number, &at_rest);
        for (all, own) in out.range.iter_mut().zip(term.ranges_along(&view)) {
            *all = wider(*all, own);
        }
        let made = term.made_along(&acting.values, &view);
        let kept = residual.kept(number).iter();
        out.largest = kept.map(|&i| made[i].abs()).fold(out.largest, f64::max);
    }
    out
}

/// Net work of terms together on what moves, and the sum of what is exchanged.
pub(in crate::diagnosis) fn work_along(residual: &LineResidual, terms: &[Acting]) -> [f64; 2] {
    let mut out = [0.0; 2];
    for number in 0..residual.lines().count() {
        let (_, xi, _) = residual.course(number);
        let at_rest = vec![0.0; xi.len()];
        let view = residual.view(number, &at_rest);
        let each: Vec<Vec<f64>> = (terms.iter())
            .filter_map(|a| Some(a.effect.learnt()?.made_along(&a.values, &view)))
            .collect();
        for &i in residual.kept(number).iter().filter(|i| **i > 0) {
            // what is asked of the drive is given away
            let asked: f64 = each.iter().map(|made| made[i]).sum();
            let power = -asked * (xi[i] - xi[i - 1]);
            out[0] += power;
            out[1] += power.abs();
        }
    }
    out
}
