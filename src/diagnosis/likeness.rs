//! What recordings cannot tell apart, worked out at the truth: for a prover, who knows it. A diagnosis never
//! calls this.

use super::judge::alike_to;
use super::problem::Fitted;
use super::problem::{Problem, Tangent, value_unknowns};
use super::robot::open;
use super::scan::fingerprints;
use super::{Entry, Error};
use crate::effects::Acting;
use crate::fit::separable::State;
use crate::model::{Parameters, Robot};

/// How an effect stands out at the truth.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Likeness {
    /// Effects whose projected fingerprints cannot be told from its own, with the cosine (of the angle
    /// between its fingerprint and the span of theirs, everything projected out that a refit absorbs),
    /// largest first.
    pub alike: Vec<(&'static str, f64)>,
    /// Weighted mean square beyond noise that a refit without it would leave.
    pub excess: f64,
}

/// How `acting` stands out beside the other effects of a case, at the film and the forearm `parameters`, all
/// of them the true ones.
///
/// # Errors
/// [`Error`]; films and forearms of another layout than the plain model's are [`Error::Baseline`].
pub fn alike_at(
    robot: &Robot,
    entries: &[Entry],
    parameters: &Parameters,
    acting: &Acting,
    beside: &[Acting],
) -> Result<Likeness, Error> {
    let mut problem = open(robot, entries, &[], &mut Vec::new())?;
    let at = truth(&problem, parameters, beside)?;
    problem.weigh(&at)?;
    let tangent = Tangent::new(&problem, &at)?;
    let groups = fingerprints(&problem, &at, &|_| true);
    let column: nalgebra::DVector<f64> = problem
        .residual(&at)
        .fingerprint(&at.state.eta, &at.state.beta, acting)?
        .into();
    let along = tangent.columns.tr_mul(&column);
    let square = tangent.projected(column.norm_squared(), &along, &along);
    let id = acting.effect.id();
    Ok(Likeness {
        alike: alike_to(&tangent, &column, id, acting.on, &groups),
        excess: square / column.len().max(1) as f64,
    })
}

/// The model at the truth, with the effects `beside`.
fn truth<S: super::subject::Subject>(
    problem: &Problem<S>,
    parameters: &Parameters,
    beside: &[Acting],
) -> Result<Fitted, Error> {
    let mut at = problem.typical();
    let mut eta: Vec<f64> = parameters
        .film
        .relaxation_time_s
        .iter()
        .map(|t| t.ln())
        .collect();
    eta.push(1.0 / parameters.film.locking);
    eta.extend(at.state.eta.iter().skip(eta.len()));
    let mut beta = parameters.film.mu_pa.clone();
    beta.extend(parameters.forearm.torque_n_m());
    if eta.len() != at.state.eta.len() || beta.len() != at.state.beta.len() {
        return Err(Error::Baseline(
            "the film or the forearm of the truth has another number of parameters".into(),
        ));
    }
    at.effects = beside.to_vec();
    at.free = beside
        .iter()
        .enumerate()
        .flat_map(|(e, a)| a.free_values().into_iter().map(move |v| (e, v)))
        .collect();
    let values = value_unknowns(&at.effects, &at.free);
    eta.extend(values.iter().map(|u| u.start));
    let mut nonlinear = problem.nonlinear.clone();
    nonlinear.extend(values);
    at.state = State::at(&eta, &nonlinear, &problem.linear);
    at.state.beta = beta;
    Ok(at)
}
