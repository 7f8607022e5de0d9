//! Whether the model suffices wherever no bicep is at the upper edge of its range, and rests against a stop
//! there.
//!
//! A stop is so stiff that angles within their tolerances do not tell the torque in it: parts that are told
//! beside it go far off, and no model with it leaves only noise. So the frames at the edge are left out, and
//! the whole doubt is asked again. Where nothing is amiss then, or another cause accounts for all, the torque
//! that the model misses at the edge is looked at on each actuator: against a stop it pushes, and changes
//! while the angle hardly does.

use super::POLISH;
use super::chain::{Case, Choice, Field};
use super::judge::{INDEPENDENT, Judged, NEVER_ADEQUATE, Odds};
use super::outcome::*;
use super::problem::{Fitted, Problem};
use super::robot::{open, with_datasets};
use super::tolerance::Built;
use super::verdict::ids;
use crate::dataset::Dataset;
use crate::effects::{Acting, Effect, EndStop};
use crate::fit::profile::TWO_SIDED_95;
use crate::fit::separable::Unknown;
use crate::model::Robot;
use crate::residual::RobotResidual;

/// Depths of the edge that are tried, rad: what a stop gives under the film's pull, and what tolerances make
/// of its angle over the workspace.
const EDGES_RAD: [f64; 2] = [0.006, 0.015];
/// Share of what the plain model leaves, with parts where it has some, up to which it leaves what is away from
/// the edge: of a stop that is to be found at the edge it must leave much less there.
const AWAY: f64 = 0.5;
/// Torque over its scatter elsewhere from which it is one of contact.
const TOUCHES: f64 = 4.0;
/// Samples that touch, at least, and share of them as many of which may pull as hard.
const FEWEST: usize = 20;
const PULLS: f64 = 0.05;
/// How many times stiffer than what holds the bicep elsewhere a stop is, at least.
const STIFFER: f64 = 5.0;
/// Stiffness of a stop from which recordings do not tell it from a rigid one, N m/rad.
const RIGID_N_M_RAD: f64 = 50.0;
/// Standard deviation of an angle within workshop tolerances, rad: 0.2 degrees.
const ANGLE_SD_RAD: f64 = 3.5e-3;
/// Odds of a stop that is found so. Beforehand a listed cause has 0.5/28, something unlisted 0.15 (`BASE_RATES`),
/// of which a twentieth would look the same: of 18 robots with something unlisted none did (Laplace's rule of
/// succession). All three stops that were found for development and on a fresh seed are there.
const SURE: f64 = 0.7;

/// A model with a stop, of a robot with parts that were told where nothing rests against it.
pub(super) struct Rests<'a> {
    problem: Problem<RobotResidual<'a>>,
    built: Option<Built>,
    plain: Fitted,
    named: Fitted,
    away: Away,
}

/// What a model without a stop makes of the recordings away from it: its mean square over the noise, and the
/// odds of its causes.
struct Away {
    mean_square: f64,
    odds: f64,
}

/// What is seen of a bicep in a kept sample: its angle, rad; the torque on it that a model misses and the one
/// that the voltage makes, N m.
type Sample = [f64; 3];

/// How a bicep touches: the angle at which it begins to, rad, and rad per N m beyond.
struct Touch {
    angle_rad: f64,
    gives_rad_n_m: f64,
}

/// Looks for a stop where nothing else explains the recordings.
///
/// # Errors
/// Those of a fit; a doubt without the edge that cannot be asked is none.
pub(super) fn rests<'a>(
    entries: [&[Entry<'a>]; 2],
    robot: &'a Robot,
    case: &Case<RobotResidual<'a>>,
    field: &Field,
    choice: &Choice,
) -> Result<Option<Rests<'a>>, Error> {
    let only = &case.request.only;
    let asked = only.is_empty() || only.iter().any(|o| o == EndStop.id());
    if choice.verdict != Verdict::Unexplained || !asked {
        return Ok(None);
    }
    (case.watch)("looking at the edge of the range");
    let top = top_rad(&case.problem.train);
    for edge_rad in EDGES_RAD {
        let away = without_edge(entries, robot, case, field, top, edge_rad);
        let Some((built, fitted, away)) = away else {
            continue;
        };
        let mut problem = open(robot, entries[0], entries[1], &mut Vec::new())?;
        problem.memory = case.problem.memory.clone();
        problem.tally = case.problem.tally.clone();
        let holdout = problem.holdout.take();
        if let Some(built) = &built {
            built.restore(&mut problem)?;
        }
        problem.weigh(&fitted)?;
        problem.take_up(holdout, built.as_ref())?;
        let Some(named) = with_stop(&problem, &fitted, edge_rad)? else {
            return Ok(None);
        };
        let state = &fitted.state;
        problem.begun = problem.train.begun(&state.eta, &state.beta)?;
        let plain = problem.fit_near(&fitted, &[], POLISH);
        return Ok(Some(Rests {
            problem,
            built,
            plain,
            named,
            away,
        }));
    }
    Ok(None)
}

/// The largest angle of each bicep, rad.
fn top_rad(residual: &RobotResidual) -> [f64; 3] {
    let mut top = [f64::NEG_INFINITY; 3];
    for (number, _) in residual.datasets().enumerate() {
        for (k, top) in top.iter_mut().enumerate() {
            let angles = &residual.mechanics(number).chains[k].theta_b;
            let kept = residual.kept(number).iter();
            *top = kept.map(|&c| angles[c][0]).fold(*top, f64::max);
        }
    }
    top
}

/// The doubt without the frames at the edge, from `top` down by `edge_rad`, where the plain model leaves much
/// less without them: parts and fit of a model that suffices there, or that has another cause and leaves only
/// noise. Recordings that are too short without them say nothing.
fn without_edge(
    [train, holdout]: [&[Entry]; 2],
    robot: &Robot,
    case: &Case<RobotResidual>,
    field: &Field,
    top: [f64; 3],
    edge_rad: f64,
) -> Option<(Option<Built>, Fitted, Away)> {
    let inside = |residual: &RobotResidual, entries: &[Entry]| -> Vec<Dataset> {
        let mut out: Vec<Dataset> = entries.iter().map(|e| e.dataset.clone()).collect();
        for (number, d) in out.iter_mut().enumerate() {
            let chains = &residual.mechanics(number).chains;
            for (i, usable) in d.usable.iter_mut().enumerate() {
                let at_edge = |k: usize| chains[k].theta_b[i][0] > top[k] - edge_rad;
                *usable = *usable && !(0..3).any(at_edge);
            }
        }
        out
    };
    let own = inside(&case.problem.train, train);
    let held = (case.problem.holdout.as_ref()).map_or_else(Vec::new, |h| inside(h, holdout));
    let mut remarks = Vec::new();
    let problem = open(
        robot,
        &with_datasets(train, &own),
        &with_datasets(holdout, &held),
        &mut remarks,
    );
    let request = Request {
        rivals: false,
        ..case.request.clone()
    };
    let mut inner = Case::new(problem.ok()?, remarks, &request, case.watch);
    let ground = inner.ground(None).ok()?;
    let mut cost = ground.plain.cost();
    if field.built.is_some() {
        let mut problem = inner.problem.copy();
        let noises = field.seen.chance.noises();
        let told = Built::fit(&mut problem, &ground.plain, noises, f64::INFINITY);
        cost = told.ok().flatten().map_or(cost, |t| t.1.cost());
    }
    if cost > AWAY * field.plain.mean_square * ground.plain.state.rows as f64 {
        return None;
    }
    let (field, choice) = inner.rounds_from(ground).ok()?;
    let (judged, odds) = match choice.verdict {
        Verdict::Adequate => (&field.plain, 1.0),
        Verdict::MissingPhysics => {
            let each = ids(&choice.best).map(|id| choice.odds.cause(id));
            (&choice.best, each.fold(1.0, f64::min))
        }
        Verdict::Unexplained => return None,
    };
    let (squares, rows) = inner.problem.held_out(&judged.fitted).unwrap_or((0.0, 1));
    let held_out = squares / rows as f64;
    let away = Away {
        mean_square: judged.mean_square,
        odds,
    };
    let left = away.mean_square.max(held_out);
    // what is adequate leaves noise, or errs by less than noise does
    let little = choice.verdict == Verdict::Adequate || left < NEVER_ADEQUATE;
    let within = field.beyond(judged).is_none() && little;
    let fitted = judged.fitted.clone();
    within.then_some((field.built, fitted, away))
}

/// What is seen of each bicep where a model without a stop is fitted.
fn seen(problem: &Problem<RobotResidual>, fitted: &Fitted) -> Result<[Vec<Sample>; 3], Error> {
    let residual = problem.residual(fitted);
    let (eta, beta) = (&fitted.state.eta, &fitted.state.beta);
    let mut seen: [Vec<Sample>; 3] = Default::default();
    for (number, d) in residual.datasets().enumerate() {
        let missed = residual.filtered_torque_error(number, eta, beta)?;
        let offset_s = residual.offset_s(number, eta);
        for (&c, missed) in residual.kept(number).iter().zip(missed) {
            for k in 0..3 {
                let chain = &residual.mechanics(number).chains[k];
                let command = d.command_v(k, c, offset_s);
                let driven = chain.half_capacitance_slope[c] * command * command;
                let lever = chain.bicep_lever[c];
                // what is missed pushes the bicep down where the model errs upwards
                seen[k].push([chain.theta_b[c][0], -missed[k] * lever, driven * lever]);
            }
        }
    }
    Ok(seen)
}

/// Covariances of some of what is seen: means, and products.
fn moments(samples: &[&Sample]) -> (Sample, [Sample; 3]) {
    let n = samples.len().max(1) as f64;
    let mean = [0, 1, 2].map(|i| samples.iter().map(|s| s[i]).sum::<f64>() / n);
    let of = |i: usize, j: usize| -> f64 {
        let each = samples.iter().map(|s| (s[i] - mean[i]) * (s[j] - mean[j]));
        each.sum::<f64>() / n
    };
    (mean, [0, 1, 2].map(|i| [0, 1, 2].map(|j| of(i, j))))
}

impl Touch {
    /// From what is seen of a bicep, of which angles beyond `from_rad` are at the edge. Nothing where what is
    /// missed there does not push, or gives as the bicep does elsewhere.
    fn of(seen: &[Sample], from_rad: f64) -> Option<Touch> {
        let (edge, free): (Vec<&Sample>, Vec<&Sample>) = seen.iter().partition(|s| s[0] > from_rad);
        let squares: f64 = free.iter().map(|s| s[1] * s[1]).sum();
        let least = TOUCHES * (squares / free.len() as f64).sqrt();
        let pulling = edge.iter().filter(|s| s[1] < -least).count();
        let mut touching = edge;
        touching.retain(|s| s[1] > least);
        if touching.len() < FEWEST || pulling as f64 > PULLS * touching.len() as f64 {
            return None;
        }
        let (mean, product) = moments(&touching);
        let gives_rad_n_m = product[0][1] / product[1][1];
        let (_, elsewhere) = moments(&free);
        let gives_elsewhere = (elsewhere[0][0] / elsewhere[2][2]).sqrt();
        (STIFFER * gives_rad_n_m < gives_elsewhere).then_some(Touch {
            angle_rad: mean[0] - gives_rad_n_m * mean[1],
            gives_rad_n_m,
        })
    }
}

/// The fit with a stop where biceps touch, the same for all of them or one each, where that is better: its
/// values alone are fitted, all else was told without it.
fn with_stop(
    problem: &Problem<RobotResidual>,
    fitted: &Fitted,
    edge_rad: f64,
) -> Result<Option<Fitted>, Error> {
    let (seen, top) = (seen(problem, fitted)?, top_rad(&problem.train));
    let touches = [0, 1, 2].map(|k| Touch::of(&seen[k], top[k] - edge_rad));
    let found: Vec<(usize, Touch)> = (touches.into_iter().enumerate())
        .filter_map(|(k, touch)| Some((k, touch?)))
        .collect();
    if found.is_empty() {
        return Ok(None);
    }
    let mut alone = problem.with(problem.train.clone());
    let state = &fitted.state;
    hold(&mut alone.nonlinear, &state.eta);
    hold(&mut alone.linear, &state.beta);
    let fit = |stops: Vec<Acting>| {
        alone.fit_near(fitted, &[&fitted.effects[..], &stops].concat(), POLISH)
    };
    let one = || fit(vec![stop(&found)]);
    let each = || fit(found.chunks(1).map(stop).collect());
    if found.len() == 1 {
        return Ok(Some(one()));
    }
    let (one, each) = rayon::join(one, each);
    // what Schwarz's criterion asks of more values
    let more = (each.free.len() - one.free.len()) as f64;
    let rows = INDEPENDENT * each.state.rows as f64;
    let better = INDEPENDENT * (one.cost() - each.cost()) > more * rows.ln();
    Ok(Some(if better { each } else { one }))
}

/// One stop where these biceps touch, as they do on average.
fn stop(found: &[(usize, Touch)]) -> Acting {
    let effect = &EndStop;
    let mean = |of: &dyn Fn(&Touch) -> f64| {
        found.iter().map(|(_, t)| of(t)).sum::<f64>() / found.len() as f64
    };
    let gives = mean(&|t| t.gives_rad_n_m).max(1.0 / RIGID_N_M_RAD);
    let mut values: Vec<f64> = effect.parameters().iter().map(|q| q.off).collect();
    values[..2].copy_from_slice(&[mean(&|t| t.angle_rad), 1.0 / gives]);
    let mut on = [false; 3];
    found.iter().for_each(|(k, _)| on[*k] = true);
    Acting { effect, values, on }
}

/// Holds unknowns where they are.
fn hold(unknowns: &mut [Unknown], at: &[f64]) {
    for (u, &x) in unknowns.iter_mut().zip(at) {
        *u = Unknown {
            start: x,
            lower: x,
            upper: x,
            prior: None,
        };
    }
}

impl<'a> Rests<'a> {
    /// What it makes of a case in the place of what was chosen.
    pub fn instead(self, case: &mut Case<RobotResidual<'a>>, field: Field) -> (Field, Choice) {
        case.problem = self.problem;
        let blocks = &field.seen.chance.blocks;
        let judged = |f: Fitted| Judged::new(&case.problem, blocks, f);
        let (plain, mut best) = (judged(self.plain), judged(self.named));
        // at the edge angles do not tell the torque: what counts is what is left away from it
        best.mean_square = self.away.mean_square;
        let both = SURE * self.away.odds;
        let odds = Odds::told(vec![
            (Vec::new(), 1.0 - SURE),
            (vec![EndStop.id()], SURE - both),
            (ids(&best).collect(), both),
        ]);
        let choice = Choice {
            partners: Vec::new(),
            by_chance: field.by_chance,
            pair: (best.fitted.effects.len() > 1).then(|| best.clone()),
            odds,
            best: best.clone(),
            verdict: Verdict::MissingPhysics,
            at_edge: true,
        };
        (field.of_one(self.built, plain, best), choice)
    }
}

/// Widens the interval of a stop's angle by what tolerances make of every angle.
pub(super) fn widen(candidates: &mut [Candidate]) {
    let stops = candidates
        .iter_mut()
        .filter(|c| c.acting.effect.id() == EndStop.id() && c.in_model);
    for angle in stops.flat_map(|c| c.values.first_mut()) {
        // f64::max takes the number where the other is none
        let own = angle.std_error.max(0.0);
        angle.std_error = own.hypot(ANGLE_SD_RAD);
        let by = TWO_SIDED_95 * angle.std_error;
        angle.ci95 = [angle.value - by, angle.value + by];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bicep that swings by 0.3 rad under 3 mN m, and at its top is pushed by up to 1 mN m against what
    /// gives so many rad/N m.
    fn bicep(gives_rad_n_m: f64, push_n_m: f64) -> Vec<Sample> {
        let noise = |i: usize, size: f64| size * (12.9898 * i as f64).sin();
        let free = (0..400).map(|i| {
            let share = i as f64 / 400.0;
            [4.2 - 0.3 * share, noise(i, 1e-5), 3e-3 * share]
        });
        let edge = (0..100).map(|i| {
            let push = push_n_m * i as f64 / 100.0;
            [4.21 + gives_rad_n_m * push, push + noise(i, 1e-5), 0.0]
        });
        free.chain(edge).collect()
    }

    #[test]
    fn a_stop_is_told_by_its_angle_and_what_it_gives() {
        let touch = Touch::of(&bicep(0.5, 1e-3), 4.205).unwrap();
        assert!((touch.angle_rad - 4.21).abs() < 1e-5, "{}", touch.angle_rad);
        assert!(
            (touch.gives_rad_n_m - 0.5).abs() < 0.01,
            "{}",
            touch.gives_rad_n_m
        );
    }

    #[test]
    fn what_pulls_gives_way_or_is_noise_is_no_stop() {
        let from = 4.205;
        assert!(Touch::of(&bicep(0.5, -1e-3), from).is_none());
        assert!(Touch::of(&bicep(50.0, 1e-3), from).is_none());
        assert!(Touch::of(&bicep(0.5, 2e-5), from).is_none());
    }
}
