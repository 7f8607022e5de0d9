//! What was learnt: what it does along the recordings, what it is like, and the sentence that says so.

use nalgebra::DVector;

use super::super::judge::cosines;
use super::super::outcome::{LearntPhysics, LearntTerm};
use super::super::scan::Group;
use super::super::words::in_unit;
use super::{Fitted, Problem, Subject, Tangent, Taught};
use crate::effects::learnt::{self, Learnt, Place};
use crate::effects::{Acting, plain_name};
use crate::film::Locked;

/// Causes that a learnt term is said to be like, and the cosine from which on.
const LIKE: (usize, f64) = (3, 0.5);

/// What was learnt beside the causes of `named`, with what it does along the recordings and what it is like;
/// `gap_closed` is its gain on those that were held out.
///
/// # Errors
/// [`Locked`] when the film is past its locking stretch.
pub(in crate::diagnosis) fn physics<S: Subject>(
    problem: &Problem<S>,
    named: &Fitted,
    taught: &Taught,
    groups: &[Group],
    gap_closed: f64,
) -> Result<LearntPhysics, Locked> {
    let mut film = taught.fitted.clone();
    let learnt = film.effects.split_off(named.effects.len());
    film.free.clear();
    film.state.eta.truncate(problem.nonlinear.len());
    let tangent = match named.effects[..] {
        [] => Tangent::new(problem, &film)?,
        _ => Tangent::new(problem, named)?,
    };
    let mut column = DVector::zeros(tangent.residual.len());
    let (mut work, mut exchanged, mut terms) = (0.0, 0.0, Vec::new());
    for (acting, (covariance, inclusion)) in learnt.iter().zip(&taught.open) {
        let own = problem
            .train
            .fingerprint(&film.state.eta, &film.state.beta, acting)?;
        column += DVector::from_vec(own);
        let made = problem.train.made_by(acting);
        work += made.work;
        exchanged += made.exchanged;
        let Some(term) = acting.effect.learnt() else {
            continue;
        };
        terms.push(LearntTerm {
            acting: Acting {
                effect: Learnt::new(term.place, term.form.clone(), made.range),
                ..acting.clone()
            },
            covariance: covariance
                .row_iter()
                .map(|r| r.iter().copied().collect())
                .collect(),
            inclusion: *inclusion,
            largest: made.largest,
        });
    }
    let together = problem.train.work_of(&learnt);
    let [work, exchanged] = together.unwrap_or([work, exchanged]);
    let on = [0, 1, 2].map(|k| learnt.iter().any(|a| a.on[k]));
    let mut resembles = cosines(&tangent, &column, learnt::ID, on, groups);
    resembles.retain(|r| r.1 >= LIKE.1);
    resembles.truncate(LIKE.0);
    let mut out = LearntPhysics {
        place: taught.place,
        terms,
        net_work: if exchanged > 0.0 {
            work / exchanged
        } else {
            f64::NAN
        },
        resembles,
        gap_closed,
        beside: !named.effects.is_empty(),
        left_out: taught.left_out,
        says: String::new(),
    };
    out.says = says_of_learnt(&out);
    Ok(out)
}

fn says_of_learnt(l: &LearntPhysics) -> String {
    let mut of: Vec<&str> = Vec::new();
    for (name, _, _) in l.variables() {
        let name = match name {
            "effector x" | "effector y" | "effector z" => "effector position",
            other => other,
        };
        if !of.contains(&name) {
            of.push(name);
        }
    }
    let on = match l.on() {
        [true, true, true] => String::new(),
        on => {
            let own: Vec<String> = (1..=3)
                .filter(|k| on[k - 1])
                .map(|k| k.to_string())
                .collect();
            format!(" of actuator {}", own.join(" and "))
        }
    };
    let work = match l.net_work.is_finite() {
        false => "",
        true if l.takes_energy() => "; it takes energy",
        true if l.gives_energy() && l.beside => "; it gives back energy that the named causes take",
        true if l.gives_energy() => "; it gives energy, so something drives it",
        true => "; it does no net work",
    };
    let like = match l.resembles.first() {
        Some((id, cosine)) => format!(
            "; nearest in the catalogue: {} ({cosine:.2})",
            plain_name(id)
        ),
        None => String::new(),
    };
    let gap = match l.gap_closed {
        g if g.is_finite() => format!(
            "; on recordings that were not fitted it closes {:.0} % of the gap {}to the noise",
            100.0 * g,
            if l.beside {
                "from the named causes "
            } else {
                ""
            }
        ),
        _ => String::new(),
    };
    let of = match of.split_last() {
        Some((last, [])) => (*last).to_owned(),
        Some((last, others)) => format!("{} and {last}", others.join(", ")),
        None => "nothing".to_owned(),
    };
    let largest = l.terms.iter().map(|t| t.largest).fold(0.0, f64::max);
    let size = match l.place.unit() {
        unit @ ("N" | "N m") => {
            format!(" of up to {}", in_unit(1e3 * largest, &format!("m{unit}")))
        }
        _ if l.place == Place::Coordinate => {
            format!(" of up to {:.1} % of the largest", 100.0 * largest)
        }
        _ => String::new(),
    };
    format!(
        "{}{on}{size}, which depends on {of}{work}{like}{gap}.",
        l.place.says()
    )
}
