//! A single coordinate as a subject: hinge bench, axis, film coupon; judged in its own unit over all samples.

use nalgebra::DMatrix;

use super::in_unit;
use super::learn::{self, Made};
use super::outcome::*;
use super::problem::Problem;
use super::single::doubt;
use super::subject::{At, Coordinate, Errors, Subject, Whereabouts, Words};
use crate::dataset::line::{Line, Measured, interpolate};
use crate::effects::line::{CATALOGUE, Kind};
use crate::effects::{Acting, Effect, When};
use crate::film::Locked;
use crate::fit::separable::{Prior, Unknown};
use crate::model::Parameters;
use crate::residual::line::{AxisTerm, LineResidual, Plain, Scales, plain, scales};
use crate::residual::{OFFSET_REACH_S, correlation_length};

/// Branches of a coupon's plain model.
pub const COUPON_BRANCHES: usize = 6;
/// Fewest samples at fitted angles that what was held out of a bench is judged by: they tell an error to a
/// sixth.
const FEWEST_HELD: usize = 20;
/// Fewest samples of which a quarter is left out where no recording is.
const FEWEST_FOR_BLOCKS: usize = 100;
/// What is known of a linear unknown of a coupon, over the largest stress: nothing but its order.
const MODULUS_SD: f64 = 3.0;

/// A recording of one coordinate, and when it was made.
#[derive(Debug, Clone, Copy)]
pub struct LineEntry<'a> {
    /// The recording.
    pub line: &'a Line,
    /// When it was made; no two recordings have the same number.
    pub when: When,
}

/// Diagnoses recordings of one coordinate, all of one kind. `watch` is told what is being done.
///
/// # Errors
/// [`Error`].
pub fn diagnose_lines(
    train: &[LineEntry],
    holdout: &[LineEntry],
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Error> {
    if train.is_empty() {
        return Err(Error::Nothing);
    }
    let lines: Vec<&Line> = train.iter().map(|e| e.line).collect();
    let scales = scales(&lines);
    let model = plain(&lines, COUPON_BRANCHES);
    fn residual<'a>(entries: &[LineEntry<'a>], model: &Plain, scales: Scales) -> LineResidual<'a> {
        let lines: Vec<&'a Line> = entries.iter().map(|e| e.line).collect();
        let when: Vec<When> = entries.iter().map(|e| e.when).collect();
        LineResidual::new(&lines, model.clone(), scales).with_effects(Vec::new(), Vec::new(), &when)
    }
    let mut own = residual(train, &model, scales);
    let mut remarks: Vec<String> = Vec::new();
    for e in train.iter().chain(holdout) {
        remarks.extend(e.line.notes.iter().map(|n| format!("{}: {n}.", e.line.id)));
    }
    if own.rows() < 4 * own.linear() {
        return Err(Error::NothingExcited(format!(
            "{} samples are too few for {} parameters: nothing can be judged; give longer recordings",
            own.rows(),
            own.linear()
        )));
    }
    let (nonlinear, linear) = line_unknowns(&own);
    super::enough(own.rows(), nonlinear.len() + linear.len())?;
    let mut held = (!holdout.is_empty()).then(|| residual(holdout, &model, scales));
    if let Some(held) = &held {
        super::enough_held_out(held.rows())?;
    }
    let mut held_out = holdout;
    if held.is_none() && own.rows() >= FEWEST_FOR_BLOCKS {
        let last = |i: usize, n: usize| 4 * i >= 3 * n;
        held = Some(own.only(|i, n, _| last(i, n)));
        own = own.only(|i, n, _| !last(i, n));
        held_out = train;
        remarks.push("No recording was held out: the last quarter of each was left out of fits and choices instead, with its history known. That is a weaker test than another recording.".into());
    } else if held.is_none() {
        remarks.push("No recording was held out, and these are too short to leave a part out: nothing tells how the model does on others.".into());
    }
    if matches!(model, Plain::Bench(_)) {
        held = held.and_then(|held| within(held, &own, &mut remarks));
    }
    let problem = Problem {
        holdout: held,
        train: own,
        train_when: train.iter().map(|e| e.when).collect(),
        holdout_when: held_out.iter().map(|e| e.when).collect(),
        assumed: None,
        nonlinear,
        linear,
        independent: super::judge::INDEPENDENT,
        begun: crate::residual::DepartureTorques::new(),
        weighed_at: None,
        smoothed_at: None,
        memory: request.memory.clone(),
        tally: request.tally.clone(),
    };
    doubt(problem, remarks, request, watch)
}

/// What was held out at angles that were fitted: of others a torque curve that is free foretells nothing.
/// `None` where hardly any is.
fn within<'a>(
    held: LineResidual<'a>,
    own: &LineResidual,
    remarks: &mut Vec<String>,
) -> Option<LineResidual<'a>> {
    let [low, high] = own.range();
    let told = held.only(|_, _, x| (low..=high).contains(&x));
    let (all, beyond) = (held.rows(), held.rows() - told.rows());
    if beyond == 0 {
        return Some(held);
    }
    let enough = told.rows() >= FEWEST_HELD;
    remarks.push(format!(
        "{beyond} of the {all} samples that were held out lie at angles beyond {} to {}, where nothing was fitted: a torque curve that is free foretells nothing there, and they {}.",
        in_unit(low, "rad"),
        in_unit(high, "rad"),
        if enough {
            "do not count"
        } else {
            "leave too few to judge by: nothing was held out"
        }
    ));
    enough.then_some(told)
}

/// Unknowns of the plain model of recordings of one coordinate.
fn line_unknowns(residual: &LineResidual) -> (Vec<Unknown>, Vec<Unknown>) {
    let scales = residual.scales();
    let mut nonlinear = Vec::new();
    let mut linear = Vec::new();
    let free = |start: f64| Unknown {
        start,
        lower: f64::NEG_INFINITY,
        upper: f64::INFINITY,
        prior: None,
    };
    match residual.plain() {
        Plain::Bench(curve) => {
            linear.extend(curve.nodes_rad().iter().map(|_| Unknown {
                // A node that no angle comes near is known to no better than the whole range.
                prior: Some(Prior {
                    mean: 0.0,
                    sd: 10.0 * scales.force,
                }),
                ..free(0.0)
            }));
        }
        Plain::Axis { terms, .. } => {
            linear.extend(terms.iter().map(|t| match t {
                AxisTerm::Mass | AxisTerm::Damping | AxisTerm::Stiffness => Unknown {
                    lower: 0.0,
                    ..free(0.0)
                },
                AxisTerm::Bias | AxisTerm::Gain => free(0.0),
            }));
        }
        Plain::Coupon { branches } => {
            let longest = residual
                .lines()
                .map(|l| l.time_s.last().unwrap_or(&1.0) - l.time_s.first().unwrap_or(&0.0))
                .fold(0.0, f64::max);
            let first = longest / 3000.0;
            for i in 0..*branches {
                let share = i as f64 / (*branches as f64 - 1.0).max(1.0);
                let time = first * 1500_f64.powf(share);
                nonlinear.push(Unknown {
                    start: time.ln(),
                    lower: (time / 30.0).ln(),
                    upper: (time * 30.0).ln(),
                    prior: Some(Prior {
                        mean: time.ln(),
                        sd: 0.7,
                    }),
                });
            }
            let reached = residual
                .lines()
                .map(|l| match &l.measured {
                    Measured::Coupon(c) => c
                        .grid
                        .stretch
                        .iter()
                        .map(|x| {
                            let [a, b] = c.stretches(*x).map(|v| v * v);
                            a + b + 1.0 / (a * b) - 3.0
                        })
                        .fold(0.0, f64::max),
                    _ => 0.0,
                })
                .fold(0.1, f64::max);
            nonlinear.push(Unknown {
                start: 0.2 / reached,
                lower: 1e-5_f64.min(0.01 / reached),
                upper: 0.98 / reached,
                prior: Some(Prior {
                    mean: 0.1 / reached,
                    sd: 0.5 / reached,
                }),
            });
            let prior = Prior {
                mean: 0.0,
                sd: MODULUS_SD * scales.force,
            };
            linear.extend((0..=*branches).map(|_| Unknown {
                start: 0.1 * scales.force,
                lower: 0.0,
                upper: f64::INFINITY,
                prior: Some(prior),
            }));
        }
    }
    for _ in residual.free_offsets() {
        nonlinear.push(Unknown::free(0.0, -OFFSET_REACH_S, OFFSET_REACH_S));
    }
    (nonlinear, linear)
}

impl Subject for LineResidual<'_> {
    const CHAINS: usize = 1;

    fn rig(&self) -> RigKind {
        match self.kind() {
            Kind::Bench => RigKind::Bench,
            Kind::Axis => RigKind::Axis,
            Kind::Coupon => RigKind::Coupon,
        }
    }

    fn starts(&self) -> Vec<(&'static dyn Effect, Vec<Vec<f64>>)> {
        let zero = vec![0.0; self.course(0).1.len()];
        let view = self.view(0, &zero);
        // one recording does not tell what goes along it from what goes along a series
        let of_one = self.lines().count() == 1;
        CATALOGUE
            .iter()
            .filter(|e| e.kinds().contains(&self.kind()))
            .flat_map(|e| {
                let effect: &'static dyn Effect = *e;
                e.near(&view).into_iter().map(move |v| (effect, v))
            })
            .filter(|(effect, values)| !(of_one && effect.over_series(&values[0])))
            .collect()
    }

    fn moments(&self) -> Vec<&'static dyn Effect> {
        Vec::new()
    }

    fn words(&self) -> Words {
        let (force, _, input) = self.symbols();
        let (unit, rich) = match self.kind() {
            Kind::Bench => (
                force,
                "To see what could hide here: loops of several amplitudes, a hold, and the first loop again at the end.",
            ),
            Kind::Axis => (
                input,
                "To see what could hide here: the same drive at several amplitudes and rates, holds, and a known load.",
            ),
            Kind::Coupon => (
                force,
                "To see what could hide here: several rates, relaxation at several stretches, and the first cycle again after a rest.",
            ),
        };
        Words {
            unit,
            basis: "all",
            over: "",
            directed: "coordinate",
            moving: 0.5,
            rich,
            repeat: "The same test again, then at another rate and another amplitude: what repeats with position, direction, rate or time says what it depends on.",
        }
    }

    fn whereabouts(&self) -> Vec<Whereabouts> {
        self.lines()
            .zip(self.series())
            .map(|(l, when)| Whereabouts {
                id: l.id.clone(),
                when,
                span_s: [
                    l.time_s.first().copied().unwrap_or(0.0),
                    l.time_s.last().copied().unwrap_or(0.0),
                ],
            })
            .collect()
    }

    fn kept_times_s(&self, recording: usize) -> Vec<f64> {
        let time = self.course(recording).0;
        self.kept(recording).iter().map(|&c| time[c]).collect()
    }

    fn coordinates(&self) -> Vec<Coordinate> {
        let (force, coordinate, input) = self.symbols();
        let scales = self.scales();
        let fine = |x: f64| 10f64.powi(3 - x.abs().log10().floor() as i32);
        let (drive, largest) = match self.kind() {
            Kind::Axis => (input, scales.input),
            _ => (force, scales.force),
        };
        let mut out = vec![
            Coordinate {
                dimension: "position",
                says: match self.kind() {
                    Kind::Coupon => "stretch",
                    Kind::Bench => "angle",
                    Kind::Axis => "position",
                },
                unit: coordinate.into(),
                at: 6,
                rounding: fine(scales.coordinate),
            },
            Coordinate {
                dimension: "largest_stretch",
                says: match self.kind() {
                    Kind::Coupon => "largest stretch so far",
                    _ => "largest excursion so far",
                },
                unit: coordinate.into(),
                at: 5,
                rounding: fine(scales.coordinate),
            },
            Coordinate {
                dimension: "voltage",
                says: match self.kind() {
                    Kind::Axis => "input",
                    Kind::Bench => "torque",
                    Kind::Coupon => "stress",
                },
                unit: drive,
                at: 0,
                rounding: fine(largest),
            },
        ];
        if self.lines().all(|l| l.timed) {
            out.push(Coordinate {
                dimension: "time",
                says: "time",
                unit: "s".into(),
                at: 2,
                rounding: 1e3,
            });
        }
        out
    }

    fn at(&self, recording: usize) -> Vec<[At; 3]> {
        let scales = self.scales();
        let line = self.lines().nth(recording).expect("its own recording");
        let (time, xi, rate) = self.course(recording);
        let mut largest = 0.0_f64;
        let so_far: Vec<f64> = xi
            .iter()
            .map(|x| {
                largest = largest.max(x.abs());
                scales.coordinate * largest
            })
            .collect();
        self.kept(recording)
            .iter()
            .enumerate()
            .map(|(row, &c)| {
                let position = scales.rest + scales.coordinate * xi[c];
                let v = scales.coordinate * rate[c];
                let drive = match &line.measured {
                    Measured::Axis(a) => interpolate(&a.input_time_s, &a.input, time[c]),
                    _ => self.measured(recording)[row],
                };
                // the order of the rows tells the direction where there is no time
                let going = if line.timed {
                    v
                } else {
                    xi[c] - xi[c.saturating_sub(1)]
                };
                [[
                    drive,
                    going.signum(),
                    time[c],
                    position,
                    v,
                    so_far[c],
                    position,
                ]; 3]
            })
            .collect()
    }

    fn whitening(&self, recording: usize) -> Vec<[f64; 6]> {
        self.weights(recording)
            .iter()
            .map(|w| [*w, 0.0, 1.0, 0.0, 0.0, 1.0])
            .collect()
    }

    fn features(&self, recording: usize) -> (Vec<&'static str>, Vec<Vec<[f64; 3]>>) {
        let (time, xi, rate) = self.course(recording);
        let kept = self.kept(recording);
        let mut largest = 0.0_f64;
        let so_far: Vec<f64> = xi
            .iter()
            .map(|x| {
                largest = largest.max(x.abs());
                largest
            })
            .collect();
        let speed = rate.iter().fold(1e-300_f64, |m, r| m.max(r.abs()));
        let direction = |i: usize| (xi[i] - xi[i.saturating_sub(1)]).signum();
        let mut names = Vec::new();
        let mut columns = Vec::new();
        let mut add = |name: &'static str, value: &dyn Fn(usize) -> f64| {
            names.push(name);
            columns.push(kept.iter().map(|&c| [value(c), 0.0, 0.0]).collect());
        };
        add("position", &|i| xi[i]);
        add("position squared", &|i| xi[i] * xi[i]);
        add("position cubed", &|i| xi[i].powi(3));
        add("rate", &|i| rate[i] / speed);
        add("rate times its size", &|i| {
            rate[i] * rate[i].abs() / speed.powi(2)
        });
        add("direction of motion", &direction);
        add("direction of motion times position", &|i| {
            direction(i) * xi[i]
        });
        add("largest position so far", &|i| so_far[i]);
        add("time", &|i| time[i]);
        (names, columns)
    }

    fn with_effects(
        &self,
        effects: Vec<Acting>,
        free: Vec<(usize, usize)>,
        series: &[When],
    ) -> Self {
        LineResidual::with_effects(self, effects, free, series)
    }

    fn told_through(self, effects: &[Acting]) -> Self {
        LineResidual::told_through(self, effects)
    }

    fn effects(&self, eta: &[f64]) -> Vec<Acting> {
        LineResidual::effects(self, eta)
    }

    fn linearise(&mut self, _: &[f64], _: &[f64], _: bool) -> Result<(), Locked> {
        Ok(())
    }

    fn weigh(&mut self, _: &[f64], beta: &[f64]) -> Result<(), Locked> {
        LineResidual::weigh(self, beta);
        Ok(())
    }

    fn design(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        LineResidual::design(self, eta, beta)
    }

    fn fingerprint(&self, eta: &[f64], beta: &[f64], acting: &Acting) -> Result<Vec<f64>, Locked> {
        LineResidual::fingerprint(self, eta, beta, acting)
    }

    fn fingerprint_by_actuator(
        &self,
        eta: &[f64],
        beta: &[f64],
        effect: &'static dyn Effect,
        v: &[f64],
    ) -> Result<[Vec<f64>; 3], Locked> {
        let acting = Acting {
            effect,
            values: v.to_vec(),
            on: [true; 3],
        };
        let whole = LineResidual::fingerprint(self, eta, beta, &acting)?;
        Ok([whole, Vec::new(), Vec::new()])
    }

    fn made_by(&self, acting: &Acting) -> Made {
        learn::made_along(self, acting)
    }
    fn work_of(&self, terms: &[Acting]) -> Option<[f64; 2]> {
        Some(learn::work_along(self, terms))
    }
    fn noise_rows(&self) -> Vec<Vec<f64>> {
        LineResidual::noise_rows(self, super::DRAWN)
    }

    fn fresh_noise_rows(
        &self,
        count: usize,
        _: &[f64],
        _: &[f64],
    ) -> Result<Vec<Vec<f64>>, Locked> {
        Ok(LineResidual::noise_rows(self, super::DRAWN + count).split_off(super::DRAWN))
    }

    fn score_covariance(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        let design = LineResidual::design(self, eta, beta)?;
        let x = design.columns(0, design.ncols() - 1);
        Ok(x.tr_mul(&x))
    }

    fn carried(&self, plain: &[f64]) -> Vec<f64> {
        let film = self.plain_unknowns() - self.free_offsets().len();
        let mut eta = plain[..film].to_vec();
        // a clock that is to be found is the fitted recordings' one: the instruments were the same
        let found = plain.get(film).copied().unwrap_or(0.0);
        eta.extend(self.free_offsets().iter().map(|_| found));
        eta
    }

    fn parameters(&self, eta: &[f64], beta: &[f64]) -> Parameters {
        Parameters {
            film: self.film(eta, beta),
            forearm: self.curve(beta),
        }
    }

    fn values(&self, eta: &[f64], beta: &[f64]) -> Vec<(String, f64)> {
        LineResidual::values(self, eta, beta)
    }

    fn errors(&self, recording: usize, eta: &[f64], beta: &[f64]) -> Result<Errors, Locked> {
        let (asked, measured) = self.stated(recording, eta, beta)?;
        let sd = (self.noise(recording) / self.gain()).abs();
        let scales = self.scales();
        let (time, xi, _) = self.course(recording);
        let kept = self.kept(recording);
        let three = |v: f64| [v, f64::NAN, f64::NAN];
        let error: Vec<f64> = asked.iter().zip(&measured).map(|(a, m)| a - m).collect();
        Ok(Errors {
            time_s: kept.iter().map(|&c| time[c]).collect(),
            counts: error.iter().map(|e| e.is_finite()).collect(),
            command: measured.into_iter().map(three).collect(),
            error: error.into_iter().map(three).collect(),
            sd: vec![three(sd); kept.len()],
            basis: vec![[true, false, false]; kept.len()],
            height: kept
                .iter()
                .map(|&c| scales.rest + scales.coordinate * xi[c])
                .collect(),
        })
    }

    fn kept_errors(
        &self,
        recording: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<[f64; 4]>, Locked> {
        let e = self.errors(recording, eta, beta)?;
        Ok(e.time_s
            .iter()
            .zip(&e.error)
            .map(|(t, e)| [*t, e[0], f64::NAN, f64::NAN])
            .collect())
    }

    fn unit_of(&self, unit: &'static str) -> (f64, String) {
        LineResidual::unit_of(self, unit)
    }

    fn independent(&self, residual: &[f64]) -> f64 {
        1.0 / correlation_length(residual)
    }
}
