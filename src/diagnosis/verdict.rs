//! Rules of the verdict on a robot: when a model is adequate, when a cause foretells, joins, leaves too much.

use super::blocks::BETTER;
use super::chance::Chance;
use super::judge::{Judged, NEVER_ADEQUATE, beside_smoothing};
use super::outcome::Error;
use super::problem::{Fitted, Problem};
use super::subject::Subject;
use super::tolerance;
use crate::effects::Acting;

/// Whether a plain fit leaves more than any noise does.
pub(super) fn never_adequate(plain: &Fitted, chance: &Chance) -> bool {
    let most = chance.scale.max(1.0) * NEVER_ADEQUATE.max(chance.most);
    plain.cost() >= most * plain.state.rows as f64
}

/// Whether a cause does better than the plain model on blocks that the fits left out, by as much as matters.
pub(super) fn foretells(plain: &Judged, judged: &Judged) -> bool {
    judged.foretold.mean_square() < plain.foretold.mean_square() - MATTERS
}

/// Mean square (noise makes 1) that a cause must take away to matter: a seventh of the noise as an error.
/// What smoothing and numerics leave of a right model is less, however long the recordings.
pub(super) const MATTERS: f64 = 0.02;

/// Share of what the plain model leaves of blocks that were left out, up to which another one foretells them.
const FORETOLD: f64 = 0.5;

/// The same of recordings that were held out: of 31 right names of robots for development, half of them of
/// another simulator, none left more than 0.08, a likeness of what was fitted 0.27.
const HELD_OUT: f64 = 0.2;

/// Whether what the best model leaves must be something that is in no entry, from the mean squares of the
/// plain and the best model.
pub(super) fn unexplained(plain: f64, best: f64) -> bool {
    let left = (best - 1.0).max(0.0);
    let share = left / (plain - 1.0).max(1e-9);
    (best > 4.0 && share > 0.03) || (best > 1.8 && share > 0.08) || (best > 1.6 && share > 0.6)
}

/// Mean square that a model with a part that is off (a link, a tilt, a marker) may leave: a part has no form
/// of which a large misfit could leave a share.
const PART_LEAVES: f64 = 4.0;

/// Whether what the best model leaves must be something that is in no entry.
pub(super) fn leaves_too_much<S: Subject>(
    problem: &Problem<S>,
    plain: &Judged,
    best: &Judged,
) -> Result<bool, Error> {
    let list = problem.train.tolerances();
    let is_part = |a: &Acting| tolerance::times(&list, a).is_some();
    let of_a_part = best.fitted.effects.iter().any(is_part);
    let too_much =
        |left: f64| unexplained(plain.mean_square, left) || (of_a_part && left > PART_LEAVES);
    if !too_much(best.mean_square) {
        return Ok(false);
    }
    // a model that is right but for smoothing foretells what its fit left out
    if best.foretold.mean_square() - 1.0 > FORETOLD * (plain.foretold.mean_square() - 1.0) {
        return Ok(true);
    }
    Ok(beside_smoothing(problem, best)?.is_none_or(too_much))
}

/// Whether a model leaves a good part of what the plain one leaves of recordings that were held out: what was
/// named is a likeness of the fitted ones then.
pub(super) fn fails_held_out(plain: &Judged, best: &Judged) -> bool {
    best.holdout > NEVER_ADEQUATE && best.holdout - 1.0 > HELD_OUT * (plain.holdout - 1.0)
}

/// Ids of the causes of a fit.
pub(super) fn ids(j: &Judged) -> impl Iterator<Item = &'static str> {
    j.fitted.effects.iter().map(|a| a.effect.id())
}

/// Whether a further cause stays: the excess must fall by a quarter. Where it is no larger than what a
/// textbook form that is wrong in detail leaves, it must nearly vanish, or fall [`in_detail`].
pub(super) fn joins(base: &Judged, next: &Judged, chance: f64, in_detail: bool) -> bool {
    let falls_by = |share: f64| next.excess() < (1.0 - share) * base.excess();
    let stays = match base.mean_square > FORM_LEAVES {
        true => falls_by(0.25),
        false => falls_by(0.75) || in_detail,
    };
    earns(base, next, chance) && stays
}

/// Whether a further cause foretells better by what matters, and in block after block.
pub(super) fn in_detail(base: &Judged, next: &Judged) -> bool {
    foretells(base, next) && next.foretold.beats(&base.foretold) > BETTER
}

/// Whether a model leaves so much more than another that it can be no form of it.
pub(super) fn leaves_far_more(j: &Judged, other: &Judged) -> bool {
    other.excess() < FAR_LESS * j.excess()
}

/// Share of what one cause leaves up to which another explains what it does not.
const FAR_LESS: f64 = 0.25;

/// Whether a further cause takes away more than chance does, and foretells no worse.
pub(super) fn earns(base: &Judged, next: &Judged, chance: f64) -> bool {
    base.fitted.cost() - next.fitted.cost() > 150.0_f64.max(chance)
        && next.foretold.mean_square() <= base.foretold.mean_square()
}

/// Mean square up to which what one cause leaves may be its form.
const FORM_LEAVES: f64 = 2.25;
