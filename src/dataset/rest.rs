//! The slow part of the noise at the end effector, told from what its marker does before a drive begins. A base
//! marker that stands still may have none: it is larger, seen from nearer, or no rigid body is built from it.
//!
//! What moves a robot at rest, a relaxing film, is a line over so short a time; the rest is noise. Its model
//! is that of [`Colour`]: white noise and a first-order autoregression of v times its variance. The
//! likelihood of both is the restricted one, with the line of each rest and the size of each axis's noise
//! taken out (Patterson and Thompson 1971), from the innovations of a Kalman filter. One colour holds for all
//! recordings of a capture.
//!
//! A marker wanders along all axes. What wanders more along one moves the robot in truth (a draught, a table):
//! that is said, and is no noise.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::colour::{BELIEVED, Colour, TIMES_S, variances};
use super::{Dataset, InitialState};

/// Shortest rest that tells anything, s of captured frames, and the longest that is needed, frames.
const SHORTEST_S: f64 = 0.35;
const LONGEST: usize = 2000;
/// Voltage over the largest of a recording up to which a drive has not begun: force goes with its square.
const BEGUN: f64 = 0.01;
/// What is left out of a rest at its end, s: clocks are not known better everywhere.
const MARGIN_S: f64 = 0.05;
/// Correlation times that are tried beside [`TIMES_S`], s: a rest shows how fast what is slower begins.
const SLOWER_S: [f64; 2] = [1.5, 2.2];
/// Frequencies between which robots are driven and a film's slow branches do not take wander up, Hz.
const BAND_HZ: [f64; 2] = [0.2, 1.5];
/// Rise of the log likelihood with a slow part of its own size on each axis from which axes differ: noise of
/// one size on all rises as far once in a hundred (chi-squared of two degrees of freedom, halved).
const DIFFERS: f64 = 4.6;

/// What a marker does before a drive begins.
struct Rest {
    /// Position along each axis, m; NaN where nothing was captured.
    along_m: [Vec<f64>; 3],
    step_s: f64,
    /// The colour that a marker that stands still tells of.
    known: Option<Colour>,
}

/// Tells recordings of one capture of the slow part of their noise, where rests before their drives show more
/// of one than is known, and writes it into their notes.
pub fn tell_wander(datasets: &mut [Dataset]) {
    let rests: Vec<Rest> = datasets.iter().filter_map(Rest::of).collect();
    let Some(found) = wander(&rests) else {
        return;
    };
    for d in datasets {
        d.notes.push(found.says());
        d.wander = Some(found);
        if let Wander::OfMarker(colour, _) = found {
            d.colour = Some(colour);
        }
    }
}

/// What wanders at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wander {
    /// The marker, with the size of its slow part, m.
    OfMarker(Colour, f64),
    /// The robot; the size along each axis, m.
    OfRobot([f64; 3]),
}

impl Wander {
    /// In words.
    pub fn says(&self) -> String {
        match self {
            Wander::OfMarker(colour, size_m) => format!(
                "the end effector's marker wanders by {:.3} mm over {:.0} ms before the drive begins: noise that is not white",
                1e3 * size_m,
                1e3 * colour.correlation_s
            ),
            Wander::OfRobot(sizes_m) => {
                let [x, y, z] = sizes_m.map(|s| format!("{:.3}", 1e3 * s));
                format!(
                    "the end effector wanders by {x}, {y} and {z} mm along x, y and z before the drive begins, which is no noise of a \
                     marker: something moves it (a draught, the table)"
                )
            }
        }
    }
}

impl Rest {
    /// `None` where the drive begins too soon, or the film has not settled.
    fn of(dataset: &Dataset) -> Option<Rest> {
        if dataset.initial != InitialState::Relaxed {
            return None;
        }
        let channels = dataset.voltage.channels_v();
        let size = |i: usize| channels.iter().map(|c| c[i].abs()).fold(0.0, f64::max);
        let samples = dataset.voltage.time_s().len();
        let largest = (0..samples).map(size).fold(0.0, f64::max);
        let begun = (0..samples).find(|&i| size(i) > BEGUN * largest)?;
        let begun_s = dataset.voltage.time_s()[begun] - dataset.offset_s;
        let length_s = begun_s - MARGIN_S - dataset.start_s;
        let frames = (length_s / dataset.step_s).max(0.0) as usize;
        let frames = frames.min(dataset.samples()).min(LONGEST);
        let captured = (0..frames).filter(|&i| dataset.captured(i)).count();
        if captured as f64 * dataset.step_s < SHORTEST_S {
            return None;
        }
        let rest = &dataset.measured_m[..frames];
        Some(Rest {
            along_m: [0, 1, 2].map(|k| rest.iter().map(|p| p[k]).collect()),
            step_s: dataset.step_s,
            known: dataset.colour,
        })
    }
}

/// The slow part that rests show beyond the one that is known.
fn wander(rests: &[Rest]) -> Option<Wander> {
    let known = Fit::of(rests, |r| r.known)?;
    let all: Vec<Colour> = (TIMES_S.iter().chain(&SLOWER_S))
        .flat_map(|&correlation_s| {
            variances().map(move |variance| Colour {
                correlation_s,
                variance,
            })
        })
        .collect();
    let fits = all
        .into_par_iter()
        .filter_map(|c| Some((c, Fit::of(rests, |_| Some(c))?)));
    let fits: Vec<(Colour, Fit)> = fits.collect();
    let total = |f: &Fit| f.log_likelihood.iter().sum::<f64>();
    let (colour, best) = fits
        .iter()
        .max_by(|a, b| total(&a.1).total_cmp(&total(&b.1)))?;
    if total(best) < total(&known) + BELIEVED {
        return None;
    }
    // the same time, and a size of its own on each axis
    let of_axis = |k: usize| {
        let same = fits
            .iter()
            .filter(|f| f.0.correlation_s == colour.correlation_s);
        same.max_by(|a, b| a.1.log_likelihood[k].total_cmp(&b.1.log_likelihood[k]))
    };
    let each = [of_axis(0)?, of_axis(1)?, of_axis(2)?];
    let apart: f64 = (0..3).map(|k| each[k].1.log_likelihood[k]).sum();
    let size = |k: usize, (c, f): &(Colour, Fit)| c.variance * f.white_m2[k];
    if apart > total(best) + DIFFERS {
        return Some(Wander::OfRobot([0, 1, 2].map(|k| size(k, each[k]).sqrt())));
    }
    let mean = mean(
        fits.iter()
            .map(|f| ((total(&f.1) - total(best)).exp(), f.0)),
    );
    let size_m2 = (0..3).map(|k| size(k, &(mean, *best))).sum::<f64>() / 3.0;
    Some(Wander::OfMarker(mean, size_m2.sqrt()))
}

/// The colour whose density has, at both frequencies of [`BAND_HZ`], the mean over colours of these weights:
/// what is left open of a covariance adds to it. A density A/(1 + x f^2) has x = (A - B)/(B b^2 - A a^2) from its
/// values A and B at a and b.
fn mean(weighted: impl Iterator<Item = (f64, Colour)>) -> Colour {
    let (mut whole, mut at) = (0.0, [0.0; 2]);
    for (weight, c) in weighted {
        let turn = |hz: f64| 2.0 * PI * hz * c.correlation_s;
        let density = |hz: f64| 2.0 * c.variance * c.correlation_s / (1.0 + turn(hz).powi(2));
        whole += weight;
        at[0] += weight * density(BAND_HZ[0]);
        at[1] += weight * density(BAND_HZ[1]);
    }
    let [low2, high2] = BAND_HZ.map(|f| f * f);
    let x = (at[0] - at[1]) / (at[1] * high2 - at[0] * low2);
    let correlation_s = x.sqrt() / (2.0 * PI);
    Colour {
        correlation_s,
        variance: at[0] / whole * (1.0 + x * low2) / (2.0 * correlation_s),
    }
}

/// Noise of a colour, fitted to rests.
#[derive(Clone, Copy)]
struct Fit {
    /// Restricted log likelihood of each axis, but for a constant.
    log_likelihood: [f64; 3],
    /// Variance of the white part along each axis, m^2.
    white_m2: [f64; 3],
}

impl Fit {
    /// `None` without rests, or where a marker stands still to the digit.
    fn of(rests: &[Rest], colour: impl Fn(&Rest) -> Option<Colour>) -> Option<Fit> {
        let (mut squares, mut count, mut log_det) = ([0.0; 3], 0.0, 0.0);
        for rest in rests {
            let filter = Filter::new(rest, colour(rest));
            let [level, slope] = filter.line()?;
            log_det += filter.log_det + level.norm.ln() + slope.norm.ln();
            count += filter.seen.len() as f64 - 2.0;
            for (sum, values) in squares.iter_mut().zip(&rest.along_m) {
                let mut left = filter.innovations(|i| values[i]);
                level.take_out(&mut left);
                slope.take_out(&mut left);
                *sum += left.iter().map(|e| e * e).sum::<f64>();
            }
        }
        let white_m2 = squares.map(|s| s / count);
        let known = count > 0.0 && white_m2.iter().all(|w| *w > 0.0);
        known.then(|| Fit {
            log_likelihood: white_m2.map(|w| -0.5 * (log_det + count * w.ln())),
            white_m2,
        })
    }
}

/// A Kalman filter of white noise of variance 1 with a slow part: its gains hold for every axis.
struct Filter {
    /// Decay of the slow part over a frame.
    decay: f64,
    frames: usize,
    /// Frames that were captured, with the gain and the standard deviation of the innovation there.
    seen: Vec<(usize, f64, f64)>,
    /// Sum of the logarithms of the innovations' variances.
    log_det: f64,
}

/// A direction in the space of innovations.
struct Direction {
    unit: Vec<f64>,
    /// Square of its length before it was made a unit.
    norm: f64,
}

impl Direction {
    fn of(mut values: Vec<f64>) -> Option<Direction> {
        let norm: f64 = values.iter().map(|v| v * v).sum();
        values.iter_mut().for_each(|v| *v /= norm.sqrt());
        (norm > 0.0).then_some(Direction { unit: values, norm })
    }

    fn take_out(&self, values: &mut [f64]) {
        let along: f64 = self.unit.iter().zip(&*values).map(|(u, v)| u * v).sum();
        let own = values.iter_mut().zip(&self.unit);
        own.for_each(|(v, u)| *v -= along * u);
    }
}

impl Filter {
    fn new(rest: &Rest, colour: Option<Colour>) -> Filter {
        let (variance, decay) = colour.map_or((0.0, 0.0), |c| {
            (c.variance, (-rest.step_s / c.correlation_s).exp())
        });
        let fresh = (1.0 - decay * decay) * variance;
        let (mut slow, mut log_det, mut seen) = (variance, 0.0, Vec::new());
        for (i, x) in rest.along_m[0].iter().enumerate() {
            if !x.is_nan() {
                let innovation = slow + 1.0;
                log_det += innovation.ln();
                seen.push((i, slow / innovation, innovation.sqrt()));
                slow /= innovation;
            }
            slow = decay * decay * slow + fresh;
        }
        Filter {
            decay,
            frames: rest.along_m[0].len(),
            seen,
            log_det,
        }
    }

    /// Innovations of `values`, over their standard deviations.
    fn innovations(&self, values: impl Fn(usize) -> f64) -> Vec<f64> {
        let (mut slow, mut at) = (0.0, 0);
        let each = self.seen.iter().map(|&(i, gain, sd)| {
            slow *= self.decay.powi((i - at) as i32);
            at = i;
            let off = values(i) - slow;
            slow += gain * off;
            off / sd
        });
        each.collect()
    }

    /// Innovations of a level and of a slope.
    fn line(&self) -> Option<[Direction; 2]> {
        let level = Direction::of(self.innovations(|_| 1.0))?;
        let middle = 0.5 * self.frames as f64;
        let mut slope = self.innovations(|i| (i as f64 - middle) / middle);
        level.take_out(&mut slope);
        Some([level, Direction::of(slope)?])
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha12Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    /// Six rests of 0.7 s of a marker with white noise of 0.02 mm and a slow part of `sizes_m`, 0.3 s, on a slope.
    fn rests(sizes_m: [f64; 3], seed: u64) -> Vec<Rest> {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
        let decay: f64 = (-0.01_f64 / 0.3).exp();
        let mut rest = || Rest {
            along_m: sizes_m.map(|size| {
                let mut slow = normal();
                let at = |i: usize| {
                    slow = decay * slow + (1.0 - decay * decay).sqrt() * normal();
                    1.0 + 1e-6 * i as f64 + 2e-5 * normal() + size * slow
                };
                let mut along: Vec<f64> = (0..70).map(at).collect();
                along[20..23].fill(f64::NAN);
                along
            }),
            step_s: 0.01,
            known: None,
        };
        (0..6).map(|_| rest()).collect()
    }

    #[test]
    fn a_marker_that_wanders_is_told_from_white_noise() {
        let white = (0..20).filter(|&seed| wander(&rests([0.0; 3], seed)).is_none());
        assert!(white.count() >= 19);
        let sizes = (0..10).map(|seed| match wander(&rests([3e-5; 3], 50 + seed)) {
            Some(Wander::OfMarker(_, size_m)) => size_m,
            other => panic!("{other:?}"),
        });
        let mean = sizes.sum::<f64>() / 10.0;
        assert!((2e-5..4.5e-5).contains(&mean), "{mean}");
    }

    #[test]
    fn a_mean_of_one_colour_is_that_colour() {
        let own = Colour {
            correlation_s: 0.4,
            variance: 1.7,
        };
        let found = mean([(0.3, own), (0.2, own)].into_iter());
        assert!((found.correlation_s - 0.4).abs() < 1e-9 && (found.variance - 1.7).abs() < 1e-9);
    }

    #[test]
    fn what_wanders_along_one_axis_is_no_marker() {
        for seed in 0..5 {
            let found = wander(&rests([0.0, 0.0, 8e-5], 80 + seed));
            let Some(Wander::OfRobot([x, y, z])) = found else {
                panic!("{found:?}");
            };
            assert!(z > 2.0 * x.max(y));
        }
    }

    #[test]
    fn what_is_known_is_not_found_again() {
        let mut all = rests([3e-5; 3], 7);
        for r in &mut all {
            r.known = Some(Colour {
                correlation_s: 0.3,
                variance: 2.25,
            });
        }
        assert_eq!(wander(&all), None);
    }

    #[test]
    fn a_likelihood_is_that_of_the_covariance() {
        // -2 ln L of the innovations, without lines: ln det C + y'C^-1 y
        let rest = &rests([3e-5; 3], 3)[0];
        let colour = Colour {
            correlation_s: 0.3,
            variance: 2.25,
        };
        let filter = Filter::new(rest, Some(colour));
        let frames: Vec<usize> = filter.seen.iter().map(|s| s.0).collect();
        let values: Vec<f64> = frames.iter().map(|&i| rest.along_m[1][i] - 1.0).collect();
        let covariance = nalgebra::DMatrix::from_fn(frames.len(), frames.len(), |i, j| {
            let apart = 0.01 * frames[i].abs_diff(frames[j]) as f64;
            colour.variance * (-apart / 0.3).exp() + f64::from(u8::from(i == j))
        });
        let factor = covariance.cholesky().unwrap();
        let y = nalgebra::DVector::from_vec(values);
        let squares = y.dot(&factor.solve(&y));
        let own: f64 = (filter.innovations(|i| rest.along_m[1][i] - 1.0).iter())
            .map(|e| e * e)
            .sum();
        assert!((own / squares - 1.0).abs() < 1e-9);
        let log_det = 2.0 * factor.l().diagonal().iter().map(|l| l.ln()).sum::<f64>();
        assert!((filter.log_det - log_det).abs() < 1e-9);
    }
}
