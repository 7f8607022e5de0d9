//! What recordings cannot tell apart, worked out at the truth: for a prover, who knows it. A diagnosis never calls this.

use super::judge::alike_to;
use super::problem::Tangent;
use super::robot::open;
use super::scan::fingerprints;
use super::{Entry, Error};
use crate::effects::Acting;
use crate::model::{Parameters, Robot};

/// Effects whose projected fingerprints cannot be told from that of `acting` in these recordings, with the cosine (of the angle
/// between its fingerprint and the span of theirs, everything projected out that a refit absorbs), largest first; at the film
/// and the forearm `parameters`, which are the true ones.
///
/// # Errors
/// [`Error`]; films and forearms of another layout than the plain model's are [`Error::Baseline`].
pub fn alike_at(
    robot: &Robot,
    entries: &[Entry],
    parameters: &Parameters,
    acting: &Acting,
) -> Result<Vec<(&'static str, f64)>, Error> {
    let mut problem = open(robot, entries, &[], &mut Vec::new())?;
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
    beta.extend(&parameters.forearm.torque_n_m);
    if eta.len() != at.state.eta.len() || beta.len() != at.state.beta.len() {
        return Err(Error::Baseline(
            "the film or the forearm of the truth has another number of parameters".into(),
        ));
    }
    (at.state.eta, at.state.beta) = (eta, beta);
    problem.weigh(&at)?;
    let tangent = Tangent::new(&problem, &at)?;
    let groups = fingerprints(&problem, &at, &|_| true);
    let column = problem
        .residual(&at)
        .fingerprint(&at.state.eta, &at.state.beta, acting)?;
    let id = acting.effect.id();
    Ok(alike_to(&tangent, &column.into(), id, acting.on, &groups))
}
