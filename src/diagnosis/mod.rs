//! Doubts: is the plain model adequate; if not, where it fails, which physics was left out, and how much
//! better the model is with it. `chain` has the steps of a robot in order, `single` those of a single
//! coordinate (axis, hinge bench, film coupon). For a robot:
//!
//! 1. The plain model is fitted with all of its own parameters free, weighted by what the noise of the
//!    capture makes of the residual (`fits`).
//! 2. Every effect of the catalogue, on all actuators and on one, is scanned by its fingerprint with
//!    everything projected out that a refit could absorb (`scan`), and the scores are held against drawn
//!    noise (`chance`).
//! 3. The leading ones are fitted together with film and forearm, at the weights of the best of them, and
//!    judged: by what they fit, by what they foretell of blocks that were left out, at the plain model's
//!    noise and at their own (`judge`, `blocks`).
//! 4. Pairs are tried where the best single one leaves more than noise.
//! 5. Parts that differ within their tolerances are tried in the causes' place (`tolerance`, `parts`).
//! 6. The verdict: adequate, a named cause, or unexplained (`verdict`); where it lives (`locate`); what is
//!    learnt where no cause accounts for it (`learn`); what could not have been seen (`words`); all of it
//!    said (`explain`).
//!
//! Residuals are torques: linear in the squared voltage, without a special case near 0 V.

mod blocks;
mod chain;
mod chance;
mod contact;
mod errors;
mod experiment;
mod explain;
mod fits;
mod forms;
mod judge;
mod law;
mod learn;
mod likeness;
mod line;
mod locate;
mod moments;
mod outcome;
mod parts;
mod problem;
mod rewhiten;
mod rivals;
mod robot;
mod scan;
mod single;
mod sizes;
mod subject;
mod swing;
mod tolerance;
mod under_way;
mod verdict;
mod words;

pub use experiment::{STEP_S as NEXT_DRIVE_STEP_S, next_drive};
pub use likeness::{Likeness, alike_at};
pub use line::{COUPON_BRANCHES, LineEntry, diagnose_lines};
pub use outcome::*;
pub use robot::diagnose;
pub use words::in_unit;

use problem::Effort;

/// Tracks that are drawn to see what the capture's noise does.
const DRAWN: usize = 6;
/// Hypotheses that are fitted in full, and of one effect at most.
const FITTED: usize = 10;
const OF_ONE: usize = 2;
/// Causes at once in the model of a rival, at most.
const MOST: usize = 6;
/// Hypotheses of rare causes that are fitted.
const RARE: usize = 4;
/// Hypotheses that are fitted where no score comes near what noise makes, and what near is.
const FITTED_IF_QUIET: usize = 3;
const QUIET: f64 = 0.6;
/// Hypotheses that are fitted because their scores surprise most, beside those that promise most, where a
/// cause is weak.
const SURPRISING: usize = 4;
/// A first fit with an effect, which only has to rank it, and a polished one.
const FIRST: Effort = Effort {
    evaluations: 12,
    cost_tolerance: 1e-4,
    motion_rounds: 1,
    below: f64::INFINITY,
};
const POLISH: Effort = Effort {
    evaluations: 25,
    cost_tolerance: 1e-5,
    motion_rounds: 3,
    below: f64::INFINITY,
};
/// The plain model, which everything else is measured against.
const BASELINE: Effort = Effort {
    evaluations: 40,
    ..POLISH
};
/// Leading effects that are fitted again at the leader's weights.
const LEADING: usize = 6;
/// Mean square above which a partner of the best single effect is looked for.
const PAIR_ABOVE: f64 = 1.15;
/// Mean square of the plain model below which a cause is weak: slow noise, which the weights do not have,
/// matters beside it.
const WEAK_BELOW: f64 = 2.0;
/// Mean square of the plain model below which what capture and smoothing make of its own motion is taken out
/// before a scan is judged.
const SMOOTHED_BELOW: f64 = 4.0;
/// Share of the largest surprise that a weak cause's own must have.
const SURPRISES_TOO: f64 = 0.4;
/// Share of the odds of a named cause from which another is in its place, and which it has at least of any
/// other's.
const RIVALS: f64 = 0.1;
/// Largest odds of a cause that is not named.
const NOT_NAMED: f64 = 0.49;
/// Partners of a cause that are judged.
const PARTNERS: usize = 2;

/// How often nothing, a cause of the catalogue, and something else is left out, before anything was recorded.
const BASE_RATES: [f64; 3] = [0.35, 0.5, 0.15];

/// Whether so many independent samples can judge a model of so many free parameters: what a fit refuses, a
/// diagnosis refuses.
fn enough(samples: usize, free: usize) -> Result<(), Error> {
    if samples < 2 * free {
        return Err(Error::NothingExcited(format!(
            "the recordings give {samples} independent samples for {free} free parameters: nothing can be judged; record longer"
        )));
    }
    Ok(())
}

/// Whether so many samples of what was held out can judge anything.
fn enough_held_out(samples: usize) -> Result<(), Error> {
    if samples == 0 {
        return Err(Error::NothingExcited(
            "the held-out recordings give no sample that counts: hold out longer ones, or none"
                .into(),
        ));
    }
    Ok(())
}
