//! Errors of fitted models in the quantity that is driven, and where they lie.

use nalgebra::DVector;

use super::locate::Spot;
use super::outcome::*;
use super::problem::{Fitted, Problem};
use super::subject::Subject;
use crate::effects::{Acting, When};

/// Torque error of the plain and the augmented model at every kept sample, in standard deviations of its own
/// noise.
pub(super) fn spots<S: Subject>(
    problem: &Problem<S>,
    before: &Fitted,
    after: &Fitted,
) -> Result<Vec<Spot>, Error> {
    let (a, b) = rayon::join(|| problem.left(before), || problem.left(after));
    let (a, b) = (a?, b?);
    let same = after.effects.is_empty();
    let mut out = Vec::with_capacity(a.len());
    let mut row = 0;
    for number in 0..problem.train_when.len() {
        let places = problem.train.at(number);
        for (at, w) in places.iter().zip(problem.train.whitening(number)) {
            let of = |e: &DVector<f64>| {
                let mut three = [0.0; 3];
                three[..S::CHAINS].copy_from_slice(&e.as_slice()[row..row + S::CHAINS]);
                unwhiten(&w, &three)
            };
            let (before, after) = (of(&a), of(&b));
            let squared = |e: f64| e * e;
            for k in 0..S::CHAINS {
                out.push(Spot {
                    recording: number,
                    actuator: k,
                    error: before[k],
                    before: squared(before[k]),
                    after: if same { 1.0 } else { squared(after[k]) },
                    at: at[k],
                });
            }
            row += S::CHAINS;
        }
    }
    Ok(out)
}

/// The torque errors over their own standard deviations, from whitened ones.
pub(super) fn unwhiten(w: &[f64; 6], e: &[f64]) -> [f64; 3] {
    // e = W r with W lower triangular; L = W^-1 has the covariance L L'.
    let l00 = 1.0 / w[0];
    let l11 = 1.0 / w[2];
    let l22 = 1.0 / w[5];
    let l10 = -w[1] * l00 * l11;
    let l21 = -w[4] * l11 * l22;
    let l20 = -(w[3] * l00 + w[4] * l10) * l22;
    let r = [
        l00 * e[0],
        l10 * e[0] + l11 * e[1],
        l20 * e[0] + l21 * e[1] + l22 * e[2],
    ];
    let v = [
        l00 * l00,
        l10 * l10 + l11 * l11,
        l20 * l20 + l21 * l21 + l22 * l22,
    ];
    [0, 1, 2].map(|k| r[k] / v[k].sqrt())
}

/// Errors before and after where models were fitted, and the traces that show them.
pub(super) fn train_gain<S: Subject>(
    problem: &Problem<S>,
    before: &Fitted,
    after: &Fitted,
) -> Result<(Gain, Vec<Traces>), Error> {
    let own = |f: &Fitted| f.state.eta[..problem.nonlinear.len()].to_vec();
    let (train, when) = (&problem.train, &problem.train_when);
    gain(train, when, before, after, None, own)
}

/// The same on recordings that are held out, where there are any.
pub(super) fn holdout_gain<S: Subject>(
    problem: &Problem<S>,
    holdout: Option<&S>,
    before: &Fitted,
    after: &Fitted,
) -> Result<Option<(Gain, Vec<Traces>)>, Error> {
    let when = &problem.holdout_when;
    let of = |h: &S| {
        let carried = |f: &Fitted| h.carried(&f.state.eta[..problem.nonlinear.len()]);
        gain(h, when, before, after, Some(&problem.train_when), carried)
    };
    holdout.map(of).transpose()
}

/// Errors before and after, and the traces that show them; of what was held out, where there are fitted
/// recordings beside it.
fn gain<S: Subject>(
    residual: &S,
    when: &[When],
    before: &Fitted,
    after: &Fitted,
    fitted: Option<&[When]>,
    plain_eta: impl Fn(&Fitted) -> Vec<f64>,
) -> Result<(Gain, Vec<Traces>), Error> {
    let eta = [before, after].map(plain_eta);
    let models = [before, after].map(|f| {
        let with = residual.with_effects(f.effects.clone(), Vec::new(), when);
        with.told_through(&after.effects)
    });
    let fits = [before, after];
    let mut sums = [[0.0; 2]; 3]; // before, after, floor: of the basis, all
    let mut counts = [0.0; 2];
    let mut traces = Vec::new();
    for (number, place) in residual.whereabouts().into_iter().enumerate() {
        let [a, b] = [0, 1].map(|i| models[i].errors(number, &eta[i], &fits[i].state.beta));
        let (a, b) = (a?, b?);
        let n = a.time_s.len();
        // a part of a recording that is fitted has its history
        let known = |own: &[When]| own.iter().any(|w| w.recording == when[number].recording);
        let from_s = match fitted.is_some_and(|own| !known(own)) {
            true => told_from_s(residual, number, when[number], &fits),
            false => None,
        };
        let mut trace = Traces {
            id: place.id,
            held_out: fitted.is_some(),
            before_v: vec![[f64::NAN; 3]; n],
            after_v: vec![[f64::NAN; 3]; n],
            torque_before: models[0].kept_errors(number, &eta[0], &fits[0].state.beta)?,
            torque_after: models[1].kept_errors(number, &eta[1], &fits[1].state.beta)?,
            time_s: a.time_s,
            command_v: a.command,
            height_mm: a.height,
        };
        for i in 0..n {
            for k in 0..S::CHAINS {
                let tells = from_s.is_none_or(|from_s| trace.time_s[i] >= from_s);
                if !(a.counts[i] && b.counts[i] && tells) {
                    continue;
                }
                let e = [a.error[i][k], b.error[i][k]];
                trace.before_v[i][k] = e[0];
                trace.after_v[i][k] = e[1];
                let told = a.basis[i][k];
                let squares = [e[0] * e[0], e[1] * e[1], b.sd[i][k].powi(2)];
                for (sum, square) in sums.iter_mut().zip(squares) {
                    sum[1] += square;
                    if told {
                        sum[0] += square;
                    }
                }
                counts[1] += 1.0;
                counts[0] += f64::from(told);
            }
        }
        traces.push(trace);
    }
    let rms = |i: usize, j: usize| (sums[i][j] / counts[j]).sqrt();
    let finite = [0, 1, 2].iter().all(|&i| rms(i, 1).is_finite());
    if !finite {
        return Err(Error::NothingExcited(format!(
            "the errors of {} samples make no number ({}, {} and {} before, after and from noise): nothing can be judged; look for \
             numbers beyond all plausibility with `deacal import REC`, or give longer recordings",
            counts[1],
            rms(0, 1),
            rms(1, 1),
            rms(2, 1)
        )));
    }
    Ok((
        Gain {
            before_v: rms(0, 0),
            after_v: rms(1, 0),
            noise_floor_v: rms(2, 0),
            all_v: [rms(0, 1), rms(1, 1), rms(2, 1)],
        },
        traces,
    ))
}

/// Where the error of a recording that was held out is told from, s: from its middle where its first half said
/// what a memory held at its beginning; `None` where all of it tells.
fn told_from_s<S: Subject>(
    residual: &S,
    number: usize,
    when: When,
    fits: &[&Fitted],
) -> Option<f64> {
    let of = |a: &Acting| a.effect.under_way().contains(&when.recording);
    let any = fits.iter().any(|f| f.effects.iter().any(of));
    let times = residual.kept_times_s(number);
    times.get(times.len() / 2).copied().filter(|_| any)
}

/// Whether the error that a model leaves is more than noise makes, whose variance is known no better than by
/// a quarter.
pub(super) fn above_noise<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
) -> Result<bool, Error> {
    let told = train_gain(problem, fitted, fitted)?.0;
    let [before, noise] = match told.before_v.is_finite() {
        true => [told.before_v, told.noise_floor_v],
        false => [told.all_v[0], told.all_v[2]],
    };
    Ok(before.powi(2) > ABOVE_NOISE * noise.powi(2))
}

/// Square of an error over the noise's from which it is more than noise.
pub(super) const ABOVE_NOISE: f64 = 1.25;

/// Whether a model lowers another's error: by what matters on what was held out, where there is any, and
/// raises it neither there nor where both were fitted.
pub(super) fn lowers_error<S: Subject>(
    problem: &Problem<S>,
    before: &Fitted,
    after: &Fitted,
) -> Result<bool, Error> {
    let fitted = train_gain(problem, before, after)?.0;
    let held_out = holdout_gain(problem, problem.holdout.as_ref(), before, after)?;
    let judged = held_out.as_ref().map_or(&fitted, |(g, _)| g);
    Ok(judged.falls() && !judged.rises() && !fitted.rises())
}

/// Error that a model leaves beyond noise, as a root of the difference of squares, and what noise makes: where
/// it was fitted and on what was held out, over the samples that errors are told of and over all.
pub(super) fn beyond_noise<S: Subject>(
    problem: &Problem<S>,
    fitted: &Fitted,
) -> Result<Vec<[f64; 2]>, Error> {
    let held_out = holdout_gain(problem, problem.holdout.as_ref(), fitted, fitted)?;
    let gains = [Some(train_gain(problem, fitted, fitted)?), held_out];
    let each = gains.iter().flatten().flat_map(|(g, _)| g.left());
    let known = each.filter(|e| e.iter().all(|x| x.is_finite()));
    Ok(known.collect())
}

/// Error that a model takes away from another's, as a root of the difference of squares, and what noise
/// makes: on the held-out recordings, where there are any.
pub(super) fn taken_away<S: Subject>(
    problem: &Problem<S>,
    before: &Fitted,
    after: &Fitted,
) -> Result<[f64; 2], Error> {
    let gain = match holdout_gain(problem, problem.holdout.as_ref(), before, after)? {
        Some((gain, _)) => gain,
        None => train_gain(problem, before, after)?.0,
    };
    let squares = gain.before_v.powi(2) - gain.after_v.powi(2);
    Ok([squares.max(0.0).sqrt(), gain.noise_floor_v])
}
