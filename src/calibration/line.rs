//! The plain model of a single coordinate: a hinge's torque curve from a bench, and mass, damping, stiffness,
//! gain of an axis.
//!
//! All is linear (but a clock offset), so that there is one minimum and no start to choose. What a plain
//! model leaves out makes its residuals follow one another: standard errors count only as many residuals as
//! their correlation length allows, and the misfit where it exceeds the noise.

use std::ops::ControlFlow;

use nalgebra::DMatrix;

use super::{AtBound, Error, Estimate, Standing};
use crate::dataset::line::{Constant, Line, Measured};
use crate::effects::line::Kind;
use crate::effects::{Acting, When};
use crate::film::Film;
use crate::fit::separable::{Options, State, Unknown, minimise};
use crate::model::ForearmTorque;
use crate::recording::nearest;
use crate::residual::line::{AxisTerm, LineResidual, Plain, plain, scales};
use crate::residual::{OFFSET_REACH_S, correlation_length};

/// What a fit of one coordinate is asked to do.
#[derive(Debug, Clone, Default)]
pub struct LineRequest {
    /// Parameters held at a value.
    pub fix: Vec<(String, f64)>,
    /// Bounds.
    pub bound: Vec<(String, [f64; 2])>,
}

/// A cause that was fitted with the plain model of an axis.
#[derive(Debug, Clone)]
pub struct AxisCause {
    /// The cause, its values in the units of the recordings.
    pub acting: Acting,
    /// Its values with their errors, named `id.value`.
    pub estimates: Vec<Estimate>,
}

/// What a model makes of the motion of a recording, from the input alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Forward {
    /// Root mean square error over the samples after those that told where it began.
    pub rmse: f64,
    /// Largest magnitude of the error.
    pub max_error: f64,
    /// Samples that count.
    pub n_samples: usize,
    /// Range of what was measured.
    pub range: f64,
    /// Unit of them.
    pub unit: &'static str,
}

/// One recording against the model.
#[derive(Debug, Clone, PartialEq)]
pub struct LineFit {
    /// The motion that the model makes of the input, where a model was held against an axis that it can run
    /// forward.
    pub forward: Option<Forward>,
    /// Identity.
    pub id: String,
    /// Root mean square error: of the torque, or of the input.
    pub rmse: f64,
    /// Largest magnitude of the error.
    pub max_error: f64,
    /// Samples that count.
    pub n_samples: usize,
    /// What noise alone makes of the error.
    pub noise: f64,
    /// Time of each, s (or row numbers).
    pub time_s: Vec<f64>,
    /// Angle rad, or position.
    pub coordinate: Vec<f64>,
    /// Measured torque, or input.
    pub measured: Vec<f64>,
    /// What the model asks for.
    pub predicted: Vec<f64>,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// Everything that a fit of one coordinate found.
#[derive(Debug, Clone)]
pub struct LineOutcome {
    /// `hinge`, `axis` or `coupon`.
    pub job: &'static str,
    /// The same as a kind.
    pub kind: Kind,
    /// Does it fit, in one sentence.
    pub verdict: String,
    /// What the errors are errors of: the torque, the input, the stress, or the motion.
    pub driven: &'static str,
    /// Unit of the errors.
    pub unit: String,
    /// Causes that were fitted as well.
    pub causes: Vec<AxisCause>,
    /// Every parameter.
    pub estimates: Vec<Estimate>,
    /// The recordings.
    pub recordings: Vec<LineFit>,
    /// The torque curve of a hinge.
    pub curve: Option<ForearmTorque>,
    /// What a prediction needs beside the curve: see [`LineResidual::values`].
    pub values: Vec<(String, f64)>,
    /// Whether the fit converged, and why it stopped.
    pub converged: bool,
    /// See `converged`.
    pub reason: String,
    /// Evaluations.
    pub evaluations: usize,
    /// Weighted squares per residual; noise alone makes 1.
    pub weighted_mean_square: f64,
    /// Further sentences.
    pub remarks: Vec<String>,
}

impl LineOutcome {
    /// Root mean square error, largest error, samples and noise over all recordings.
    #[must_use]
    pub fn total(&self) -> (f64, f64, usize, f64) {
        let n: usize = self.recordings.iter().map(|r| r.n_samples).sum();
        let mean = |f: &dyn Fn(&LineFit) -> f64| {
            let sum: f64 = self
                .recordings
                .iter()
                .map(|r| r.n_samples as f64 * f(r).powi(2))
                .sum();
            (sum / n.max(1) as f64).sqrt()
        };
        let largest = self.recordings.iter().map(|r| r.max_error);
        (
            mean(&|r| r.rmse),
            largest.fold(0.0, f64::max),
            n,
            mean(&|r| r.noise),
        )
    }

    /// How the error stands to the noise.
    #[must_use]
    pub fn standing(&self) -> Standing {
        let (rmse, _, _, noise) = self.total();
        standing(rmse, noise)
    }
}

impl LineFit {
    /// How the error stands to the noise.
    #[must_use]
    pub fn standing(&self) -> Standing {
        standing(self.rmse, self.noise)
    }
}

fn standing(rmse: f64, noise: f64) -> Standing {
    match noise > SEEN * rmse {
        true => Standing::of(rmse / noise),
        false => Standing::CannotBeJudged,
    }
}

/// Share of the error below which noise is none: what rounding leaves of exact numbers.
const SEEN: f64 = 1e-12;
/// Heavier, stiffer or stronger than any laboratory axis: more likely a wrong unit.
const IMPLAUSIBLE: [(&str, f64, f64); 4] = [
    ("mass", 1e-7, 1e5),
    ("damping", 1e-12, 1e7),
    ("stiffness", 1e-9, 1e9),
    ("gain", 1e-9, 1e9),
];

/// Fits the plain model of hinge benches or axes, all of one rig.
///
/// # Errors
/// [`Error`] for unknown names, impossible values, and recordings that determine nothing.
pub fn calibrate_lines(lines: &[Line], request: &LineRequest) -> Result<LineOutcome, Error> {
    let mut lines = lines.to_vec();
    let bench = matches!(lines[0].measured, Measured::Torque(_));
    if !bench {
        hold(&mut lines, &request.fix)?;
    }
    let refs: Vec<&Line> = lines.iter().collect();
    let Plainly {
        residual,
        state,
        linear,
        names,
    } = plainly(&refs, request)?;
    let design = residual.design(&state.eta, &state.beta)?;
    let covariance = covariance(&design, state.eta.len(), &linear);
    let mut out = against(&residual, &state.eta, &state.beta)?;
    out.weighted_mean_square = mean_square(&design);
    say(&mut out, &residual, &state, &linear, &names, &covariance);
    Ok(out)
}

/// The plain model at its best on recordings.
pub(super) struct Plainly<'a> {
    pub(super) residual: LineResidual<'a>,
    pub(super) state: State,
    pub(super) linear: Vec<Unknown>,
    pub(super) names: Vec<String>,
}

/// What is thought of the parameters before a fit; `--fix` of a bench and `--bound`.
fn asked(
    names: &[String],
    plain: &Plain,
    request: &LineRequest,
    bench: bool,
) -> Result<Vec<Unknown>, Error> {
    let place = |name: &String| {
        let found = names.iter().position(|n| n == name);
        found.ok_or_else(|| Error::UnknownParameter {
            name: name.clone(),
            nearest: nearest(name, names).map(Into::into),
            known: names.join(", "),
        })
    };
    let physical = |name: &String| matches!(name.as_str(), "mass" | "damping" | "stiffness");
    let mut linear: Vec<Unknown> = names
        .iter()
        .map(|name| Unknown {
            start: 0.0,
            lower: if physical(name) {
                0.0
            } else {
                f64::NEG_INFINITY
            },
            upper: f64::INFINITY,
            prior: None,
        })
        .collect();
    if bench {
        for (name, value) in &request.fix {
            linear[place(name)?] = Unknown::fixed(*value);
        }
    }
    for (name, [low, high]) in &request.bound {
        let i = place(name)?;
        if matches!(
            plain,
            Plain::Axis {
                over_gain: true,
                ..
            }
        ) {
            return Err(Error::BadValue {
                name: name.clone(),
                what: "bounds need a known gain: what is found is each parameter over the gain"
                    .into(),
            });
        }
        (linear[i].lower, linear[i].upper) = (*low, *high);
    }
    Ok(linear)
}

/// Fits the plain model by its balance: linear but for clock offsets.
pub(super) fn plainly<'a>(refs: &[&'a Line], request: &LineRequest) -> Result<Plainly<'a>, Error> {
    let bench = matches!(refs[0].measured, Measured::Torque(_));
    let scales = scales(refs);
    let mut residual = LineResidual::new(refs, plain(refs, 0), scales);
    let names = names(residual.plain());
    let mut linear = asked(&names, residual.plain(), request, bench)?;
    let offsets = residual.free_offsets().len();
    let nonlinear = vec![Unknown::free(0.0, -OFFSET_REACH_S, OFFSET_REACH_S); offsets];
    if residual.rows() < 2 * linear.len() {
        return Err(Error::NothingToFit(format!(
            "{} samples are too few for {} parameters",
            residual.rows(),
            linear.len()
        )));
    }
    let go = |_: &State| ControlFlow::Continue(());
    let options = Options::default();
    // a clock has many minima: from a comb of offsets
    let starts: Vec<f64> = if offsets > 0 {
        (-10..=10)
            .map(|i| f64::from(i) * OFFSET_REACH_S / 10.0)
            .collect()
    } else {
        vec![0.0]
    };
    let mut evaluations = 0;
    let mut best: Option<State> = None;
    for start in starts {
        let eta = vec![start; offsets];
        let state = minimise(&residual, &nonlinear, &linear, &eta, &options, go);
        evaluations += state.evaluations;
        if best.as_ref().is_none_or(|b| state.cost < b.cost) {
            best = Some(state);
        }
    }
    let first = best.ok_or_else(|| Error::NothingToFit("no start".into()))?;
    residual.weigh(&first.beta);
    for (u, b) in linear.iter_mut().zip(&first.beta) {
        u.start = *b;
    }
    let mut state = minimise(&residual, &nonlinear, &linear, &first.eta, &options, go);
    state.evaluations += evaluations;
    Ok(Plainly {
        residual,
        state,
        linear,
        names,
    })
}

/// A model held against its recordings: errors, curve, values, and whether it fits, in one sentence.
fn against(residual: &LineResidual, eta: &[f64], beta: &[f64]) -> Result<LineOutcome, Error> {
    let factor = residual.gain();
    let scales = residual.scales();
    let recordings = residual
        .lines()
        .enumerate()
        .map(|(number, line)| {
            let (asked, measured) = residual.stated(number, eta, beta)?;
            let (time, xi, _) = residual.course(number);
            let kept = residual.kept(number);
            let errors: Vec<f64> = asked
                .iter()
                .zip(&measured)
                .map(|(a, m)| a - m)
                .filter(|e| e.is_finite())
                .collect();
            let n = errors.len();
            Ok(LineFit {
                forward: None,
                id: line.id.clone(),
                rmse: (errors.iter().map(|e| e * e).sum::<f64>() / n.max(1) as f64).sqrt(),
                max_error: errors.iter().fold(0.0, |m: f64, e| m.max(e.abs())),
                n_samples: n,
                noise: (residual.noise(number) / factor).abs(),
                time_s: kept.iter().map(|&c| time[c]).collect(),
                coordinate: kept
                    .iter()
                    .map(|&c| scales.rest + scales.coordinate * xi[c])
                    .collect(),
                measured,
                predicted: asked,
                notes: line.notes.clone(),
            })
        })
        .collect::<Result<Vec<_>, Error>>()?;
    let kind = residual.kind();
    let bench = kind == Kind::Bench;
    let mut out = LineOutcome {
        job: match kind {
            Kind::Bench => "hinge",
            Kind::Axis => "axis",
            Kind::Coupon => "coupon",
        },
        kind,
        verdict: String::new(),
        driven: match kind {
            Kind::Bench => "torque",
            Kind::Axis => "input",
            Kind::Coupon => "stress",
        },
        causes: Vec::new(),
        unit: residual.lines().next().map_or_else(String::new, Line::unit),
        estimates: Vec::new(),
        recordings,
        curve: bench.then(|| residual.curve(beta)),
        values: residual.values(eta, beta),
        converged: true,
        reason: String::new(),
        evaluations: 0,
        weighted_mean_square: f64::NAN,
        remarks: Vec::new(),
    };
    judge(&mut out)?;
    for r in &out.recordings {
        out.remarks
            .extend(r.notes.iter().map(|n| format!("{}: {n}.", r.id)));
    }
    Ok(out)
}

/// Whether a model fits its recordings, in one sentence.
pub(super) fn judge(out: &mut LineOutcome) -> Result<(), Error> {
    let (rmse, _, n, noise) = out.total();
    let what = out.driven;
    if !rmse.is_finite() || !noise.is_finite() {
        return Err(Error::NothingToFit(format!(
            "the error of the {what} comes out as {rmse:e} {} rms, and as {noise:e} from noise alone: nothing can be judged; check the \
             constants that the manifest states, and the units",
            out.unit
        )));
    }
    out.verdict = if out.standing() == Standing::CannotBeJudged {
        format!(
            "The error of the {what} is {rmse:.3e} {} rms over {n} samples; the recordings show no noise to hold it against.",
            out.unit
        )
    } else if out.standing() == Standing::Fits {
        format!(
            "The model fits: the error of the {what} is {rmse:.3e} {} rms over {n} samples, the noise {noise:.3e}.",
            out.unit
        )
    } else {
        format!(
            "The model leaves {:.1} times the noise: the error of the {what} is {rmse:.3e} {} rms over {n} samples, the noise {noise:.3e}; `deacal diagnose` looks for what it leaves out.",
            rmse / noise,
            out.unit
        )
    };
    Ok(())
}

/// Finished parameters of one coordinate, as a parameter file has them.
#[derive(Debug, Clone, Default)]
pub struct LineModel {
    /// As [`LineResidual::values`] gives them.
    pub values: Vec<(String, f64)>,
    /// The film of coupons.
    pub film: Option<Film>,
    /// The torque curve of a bench.
    pub curve: Option<ForearmTorque>,
    /// Causes of [`crate::effects::line::CATALOGUE`], their values in the units of the recordings.
    pub effects: Vec<Acting>,
    /// When recordings were made, by their ids; others stand at the beginning of a series.
    pub when: Vec<(String, When)>,
}

impl LineModel {
    /// The recordings at this model; `every` row kept, or only nearly independent ones.
    pub(super) fn at<'a>(
        &self,
        lines: &[&'a Line],
        every: bool,
    ) -> Result<(LineResidual<'a>, Vec<f64>, Vec<f64>), Error> {
        let (film, curve) = (self.film.as_ref(), self.curve.as_ref());
        let (residual, eta, beta) = LineResidual::given(lines, &self.values, film, curve, every)
            .map_err(|name| {
                Error::NothingToFit(format!(
                    "the parameter file has no {name}: name one that `deacal fit` or `deacal diagnose` wrote for such a rig"
                ))
            })?;
        let effects = self
            .effects
            .iter()
            .map(|a| {
                let quantities = a.effect.parameters().iter();
                let values = a.values.iter().zip(quantities);
                Acting {
                    values: values
                        .map(|(v, q)| v / residual.unit_of(q.unit).0)
                        .collect(),
                    ..a.clone()
                }
            })
            .collect();
        let mut series = residual.series();
        for (own, line) in series.iter_mut().zip(lines) {
            if let Some((_, when)) = self.when.iter().find(|w| w.0 == line.id) {
                *own = *when;
            }
        }
        Ok((
            residual.with_effects(effects, Vec::new(), &series),
            eta,
            beta,
        ))
    }
}

/// Holds finished parameters against recordings of one kind; nothing is fitted.
///
/// # Errors
/// [`Error`] where the model lacks what these recordings need, or a film locks.
pub fn validate_lines(lines: &[Line], model: &LineModel) -> Result<LineOutcome, Error> {
    let refs: Vec<&Line> = lines.iter().collect();
    let (residual, eta, beta) = model.at(&refs, false)?;
    let mut out = against(&residual, &eta, &beta)?;
    for (r, line) in out.recordings.iter_mut().zip(lines) {
        r.forward = super::motion::of_forward(line, model);
    }
    Ok(out)
}

/// What a model asks for at every sample of a recording: input of an axis (through the low-pass of its band),
/// torque of a bench, nominal stress of a coupon at the nodes of its grid, Pa. Measured and predicted are NaN
/// where a sample is left out. With the unit of both.
///
/// # Errors
/// As [`validate_lines`].
pub fn predict_line(line: &Line, model: &LineModel) -> Result<(LineFit, String), Error> {
    let (residual, eta, beta) = model.at(&[line], true)?;
    let mut out = against(&residual, &eta, &beta)?;
    let unit = std::mem::take(&mut out.unit);
    let mut fit = out.recordings.remove(0);
    let (time, xi, _) = residual.course(0);
    let scales = residual.scales();
    let shown = match residual.kind() {
        Kind::Axis => line.captured.clone(),
        Kind::Bench | Kind::Coupon => 0..time.len(),
    };
    let mut sides = vec![[f64::NAN; 2]; time.len()];
    for ((&c, m), p) in residual
        .kept(0)
        .iter()
        .zip(&fit.measured)
        .zip(&fit.predicted)
    {
        sides[c] = [*m, *p];
    }
    fit.time_s = time[shown.clone()].to_vec();
    fit.coordinate = xi[shown.clone()]
        .iter()
        .map(|x| scales.rest + scales.coordinate * x)
        .collect();
    fit.measured = sides[shown.clone()].iter().map(|s| s[0]).collect();
    fit.predicted = sides[shown].iter().map(|s| s[1]).collect();
    Ok((fit, unit))
}

/// `--fix` of an axis: what is held is known.
pub(super) fn hold(lines: &mut [Line], fix: &[(String, f64)]) -> Result<(), Error> {
    for (name, value) in fix {
        for line in lines.iter_mut() {
            let Measured::Axis(a) = &mut line.measured else {
                continue;
            };
            let known = Constant::Known(*value);
            match name.as_str() {
                "mass" | "inertia" => a.mass = known,
                "damping" => a.damping = known,
                "stiffness" => a.stiffness = known,
                "gain" => a.gain = known,
                "clock_offset" => a.offset_s = known,
                _ => {
                    let all =
                        ["mass", "damping", "stiffness", "gain", "clock_offset"].map(String::from);
                    return Err(Error::UnknownParameter {
                        name: name.clone(),
                        nearest: nearest(name, &all).map(Into::into),
                        known: all.join(", "),
                    });
                }
            }
        }
    }
    Ok(())
}

fn names(plain: &Plain) -> Vec<String> {
    match plain {
        Plain::Bench(curve) => curve
            .nodes_rad()
            .iter()
            .map(|n| format!("torque_{}deg", (n.to_degrees() * 1e6).round() / 1e6))
            .collect(),
        Plain::Axis { terms, .. } => terms
            .iter()
            .map(|t| {
                match t {
                    AxisTerm::Mass => "mass",
                    AxisTerm::Damping => "damping",
                    AxisTerm::Stiffness => "stiffness",
                    AxisTerm::Bias => "bias",
                    AxisTerm::Gain => "gain",
                }
                .to_owned()
            })
            .collect(),
        Plain::Coupon { .. } => Vec::new(),
    }
}

fn meaning(name: &str, turns: bool) -> (&'static str, &'static str) {
    match (name, turns) {
        ("mass", false) => ("mass that is moved", "kg"),
        ("mass", true) => ("moment of inertia", "kg m^2"),
        ("damping", false) => ("force per speed", "N s/m"),
        ("damping", true) => ("torque per angular speed", "N m s"),
        ("stiffness", false) => ("force per displacement", "N/m"),
        ("stiffness", true) => ("torque per angle", "N m"),
        ("bias", false) => ("force at rest, where position and input read zero", "N"),
        ("bias", true) => ("torque at rest, where position and input read zero", "N m"),
        ("gain", false) => ("force per unit of input", "N/unit"),
        ("gain", true) => ("torque per unit of input", "N m/unit"),
        ("clock_offset", _) => ("input clock minus motion clock", "s"),
        _ => ("spring-back torque at this angle", "N m"),
    }
}

/// Mean square of a whitened residual, the last column of a design.
fn mean_square(design: &DMatrix<f64>) -> f64 {
    let errors = design.column(design.ncols() - 1);
    errors.norm_squared() / errors.len() as f64
}

/// Covariance of eta and beta from a whitened design: what is left is wider than the noise and follows
/// itself.
fn covariance(design: &DMatrix<f64>, nonlinear: usize, linear: &[Unknown]) -> DMatrix<f64> {
    let width = design.ncols() - 1;
    let errors = design.column(width);
    let widen = mean_square(design).max(1.0) * correlation_length(errors.as_slice());
    let x = design.columns(0, width);
    let scale: Vec<f64> = (0..width)
        .map(|i| 1.0 / x.column(i).norm().max(f64::MIN_POSITIVE))
        .collect();
    let held = |i: usize| i >= nonlinear && linear[i - nonlinear].is_fixed();
    let gram = DMatrix::from_fn(width, width, |i, j| {
        let g = scale[i] * scale[j] * x.column(i).dot(&x.column(j));
        if i == j {
            g + 1e-12 + if held(i) { 1e12 } else { 0.0 }
        } else {
            g
        }
    });
    let inverse = gram.cholesky().map_or_else(
        || DMatrix::from_element(width, width, f64::NAN),
        |c| c.inverse(),
    );
    DMatrix::from_fn(width, width, |i, j| {
        widen * scale[i] * scale[j] * inverse[(i, j)]
    })
}

/// An estimate of a parameter of an axis, or of a bench, in words too.
fn estimate(
    name: &str,
    turns: bool,
    (value, std_error): (f64, f64),
    fixed: bool,
    at_bound: Option<AtBound>,
) -> Estimate {
    let (meaning, unit) = meaning(name, turns);
    let identifiable = fixed || (std_error.is_finite() && 3.0 * std_error < value.abs());
    let implausible = IMPLAUSIBLE.iter().find(|i| i.0 == name);
    let says = match implausible {
        Some((_, low, high))
            if !fixed && value != 0.0 && !(*low..=*high).contains(&value.abs()) =>
        {
            format!(
                "{value:.3e} {unit} is beyond all plausibility: look whether a column is in another unit, or two are swapped"
            )
        }
        _ if fixed => "held".to_owned(),
        _ if at_bound.is_some() => "rests on its bound".to_owned(),
        _ if identifiable => "determined".to_owned(),
        _ => "not told from zero by these recordings".to_owned(),
    };
    Estimate {
        name: name.to_owned(),
        meaning: meaning.to_owned(),
        unit: unit.into(),
        value,
        std_error: if fixed { f64::NAN } else { std_error },
        ci95: match fixed {
            true => [value; 2],
            false => [value - 1.96 * std_error, value + 1.96 * std_error],
        },
        at_bound,
        identifiable,
        fixed,
        says,
    }
}

/// A parameter that was found over the gain, of which the reciprocal is number `gain`: value and standard
/// error, from relative variances and their covariance.
fn times_gain(
    (beta, eta): (&[f64], usize),
    covariance: &DMatrix<f64>,
    i: usize,
    gain: Option<usize>,
) -> (f64, f64) {
    let at = eta + i;
    let variance = covariance[(at, at)];
    if gain == Some(i) {
        return (1.0 / beta[i], variance.sqrt() / beta[i].powi(2));
    }
    let (g, of_g) = gain.map_or((1.0, 0), |i| (beta[i], eta + i));
    let (a, b) = (1.0 / g, -beta[i] / (g * g));
    let v =
        a * a * variance + 2.0 * a * b * covariance[(at, of_g)] + b * b * covariance[(of_g, of_g)];
    (beta[i] / g, v.max(0.0).sqrt())
}

/// Puts what a fit found into an outcome: estimates of eta and beta with their covariance, and how it ended.
pub(super) fn say(
    out: &mut LineOutcome,
    residual: &LineResidual,
    state: &State,
    linear: &[Unknown],
    names: &[String],
    covariance: &DMatrix<f64>,
) {
    let (eta, beta) = (&state.eta, &state.beta);
    let turns = |l: &Line| matches!(&l.measured, Measured::Axis(a) if a.turns);
    let (over_gain, known, turns) = match (residual.plain(), residual.lines().next()) {
        (
            Plain::Axis {
                known, over_gain, ..
            },
            Some(line),
        ) => (*over_gain, Some(*known), turns(line)),
        _ => (false, None, false),
    };
    let gain = names.iter().position(|n| n == "gain");
    let mut estimates = Vec::new();
    for (i, (name, u)) in names.iter().zip(linear).enumerate() {
        let found = match over_gain {
            true => times_gain((beta, eta.len()), covariance, i, gain),
            false => {
                let at = eta.len() + i;
                (beta[i], covariance[(at, at)].sqrt())
            }
        };
        let at_bound = match beta[i] {
            _ if u.is_fixed() => None,
            b if b <= u.lower => Some(AtBound::Lower),
            b if b >= u.upper => Some(AtBound::Upper),
            _ => None,
        };
        estimates.push(estimate(name, turns, found, u.is_fixed(), at_bound));
    }
    let stated = ["gain", "mass", "damping", "stiffness"].into_iter();
    for (name, value) in stated.zip(known.into_iter().flatten()) {
        if !names.iter().any(|n| n == name) {
            estimates.push(estimate(name, turns, (value, f64::NAN), true, None));
        }
    }
    if !residual.free_offsets().is_empty() {
        let found = (eta[0], covariance[(0, 0)].sqrt());
        estimates.push(estimate("clock_offset", turns, found, false, None));
    }
    out.estimates = estimates;
    out.converged = state
        .ended
        .is_some_and(crate::fit::separable::Ended::converged);
    out.reason = state.ended.map_or("", |e| e.words()).to_owned();
    out.evaluations = state.evaluations;
    if let Plain::Axis {
        known,
        over_gain: false,
        ..
    } = residual.plain()
        && known[0] == 1.0
        && residual
            .lines()
            .any(|l| matches!(&l.measured, Measured::Axis(a) if a.gain == Constant::Free))
    {
        out.remarks.push("Nothing sets the scale of the force (no load, no known mass, damping or stiffness): the gain is taken as 1, and the others are per unit of input.".into());
    }
}
