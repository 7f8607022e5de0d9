//! How robots are built: parts that differ within their tolerances are no cause.
//!
//! Each tolerance is one column of the linearised residual, the change that one standard deviation of it
//! makes, and has a normal prior. So has the law of the film: rubber that relaxes linearly is no fault
//! either, and its branches differ from the model's by what no refit of these absorbs. Those that the rig
//! states are taken as stated. The others are defaults of good workshop practice, and how well this robot
//! was built is told from the recordings: all defaults are multiplied by one scale between 0 and 1, and
//! linear branches by another, those of largest marginal likelihood
//!
//! ```text
//! -2 ln L(scales) = r'r - g'D (I + D G D)^-1 D g + ln det(I + D G D),     D = scales times tolerances
//! ```
//!
//! where G and g are the products of the columns with each other and with the residual, the plain model's
//! tangent space projected out (MacKay 1992). A mechanism that is off bends the film of the plain fit, so the
//! columns are worked out again about the mechanism and the film that were found. The same likelihood decides
//! between parts that differ and the causes that the robot as drawn is given: one part that is far off, where
//! all others are as drawn, is a cause; many that are off a little are not. Parts, alone or beside a cause,
//! are believed where they are likelier by more than chance makes of a scan, unless they foretell what was
//! held out with more than three times the error. Where a name holds as drawn, parts beyond their tolerances
//! do not take its place; where none does, such parts are said and nothing is named.

use nalgebra::{DMatrix, DVector, SymmetricEigen};
use rayon::prelude::*;

use super::BASELINE;
use super::fits::or_nominal;
use super::outcome::Departed;
use super::problem::{Fitted, Problem, Tangent, value_unknowns};
use super::subject::Subject;
use super::words::in_unit;
use crate::effects::{
    Acting, AmplifierGain, AngleError, Effect, FrameTilt, LinearBranch, LinkLengthError,
    MarkerOffset, PayloadChange, Site, StretchExponent, ThicknessError, TimeOffset, by_id,
};
use crate::film::Locked;
use crate::fit::separable::{Prior, Unknown};
use crate::recording::Stated;
use crate::residual::{Departure, DepartureTorques};

/// Default tolerances, one standard deviation each. Films: two cut from one roll and pre-stretched by hand.
/// Links: 0.1 mm of 50 mm, printed or milled. Angles: 0.2 mm over a part of 60 mm. Gain: data sheets of
/// high-voltage amplifiers and their dividers. Marker: a glued sphere.
const FILM: f64 = 0.03;
const LINK: f64 = 0.002;
const ANGLE_DEG: f64 = 0.2;
const GAIN: f64 = 0.005;
const MASS: f64 = 0.01;
const TILT_DEG: f64 = 0.2;
const MARKER_MM: f64 = 0.1;
const CLOCK_MS: f64 = 1.0;

/// Another law of all films: one standard deviation of the exponent of stretch (2 in the model; rubbers have
/// 1.3 to 5, most of their stress less than 3), and the modulus that each linear branch may have over what
/// all springs of the model have together, as large as that of a branch of the model; their relaxation times,
/// and the powers of I - 3 in the elastic stress that they relax; the modulus at which all of them are told.
const EXPONENT: f64 = 0.5;
const BRANCH: f64 = 0.1;
const BRANCH_TIMES_S: [f64; 7] = [0.01, 0.05, 0.25, 1.25, 6.25, 31.0, 156.0];
const BRANCH_POWERS: [f64; 2] = [0.0, 1.0];
const LAW_PA: f64 = 1e5;

/// Links as `link_length_error` numbers them, with their keys in the rig.
const LINKS: [(&str, &str); 8] = [
    ("l_ch", "l_ch_mm"),
    ("l_end", "l_end_mm"),
    ("q", "q_mm"),
    ("n0", "n0_mm"),
    ("a", "a_mm"),
    ("b", "b_mm"),
    ("c", "c_mm"),
    ("d", "d_mm"),
];
/// Steps of the scale, each by this factor, from 1 down to the last.
const SCALE_STEP: f64 = 0.7;
const LEAST_SCALE: f64 = 0.003;
/// The same of linear branches.
const LAW_STEP: f64 = 0.5;
const LEAST_LAW: f64 = 0.05;
/// A direction in which one standard deviation changes the sum of squares by less is left out: its prior is
/// all that is known of it.
const VISIBLE: f64 = 0.25;
/// A departure may go as far as this many tolerances.
const FARTHEST: f64 = 1e3;

/// One tolerance.
#[derive(Clone)]
pub(super) struct Tolerance {
    /// What may be off.
    pub what: String,
    /// The tolerance, in `unit`.
    pub tolerance: f64,
    /// Its unit.
    pub unit: &'static str,
    /// What is known of it.
    pub known: Known,
    /// What it changes.
    pub departure: Departure,
}

impl Tolerance {
    /// The cause that it would be, at its size, where it is one of all recordings.
    fn acting(&self) -> Option<&Acting> {
        match &self.departure {
            Departure::Effect { acting, only: None } => Some(acting),
            _ => None,
        }
    }

    /// Whether it is of the kind of a cause: along another axis, perhaps, but of the same part.
    fn is_of(&self, cause: &Acting) -> bool {
        self.acting().is_some_and(|own| {
            let worded = !cause.effect.variants().is_empty();
            own.effect.id() == cause.effect.id()
                && own.on == cause.on
                && (!worded || own.values[0] == cause.values[0])
        })
    }
}

/// What is known of a tolerance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Known {
    /// The rig states it.
    Stated,
    /// A default of good practice, which counts by how well this robot was built.
    Default,
    /// No part, but the law of all films: the exponent of stretch may be another.
    Exponent,
    /// The same: a linear branch, which counts by how far films follow such a law.
    Branch,
}

impl Known {
    fn is_law(self) -> bool {
        matches!(self, Known::Exponent | Known::Branch)
    }
}

/// The tolerances of a robot with this end effector on so many recordings.
pub(super) fn of_robot(stated: &[Stated], effector_kg: f64, recordings: usize) -> Vec<Tolerance> {
    let find = |key: &str| stated.iter().find(|s| s.key == key);
    // tolerance in the key's unit, and whether it is stated
    let of = |key: &str, default: f64| find(key).map_or((default, false), |s| (s.tolerance, true));
    let share = |key: &str, default: f64| {
        find(key).map_or((default, false), |s| (s.tolerance / s.value, true))
    };
    let mut out = Vec::new();
    let mut add = |what: String,
                   (tolerance, stated): (f64, bool),
                   unit: &'static str,
                   departure: Departure| {
        if tolerance > 0.0 {
            let known = if stated {
                Known::Stated
            } else {
                Known::Default
            };
            out.push(Tolerance {
                what,
                tolerance,
                unit,
                known,
                departure,
            });
        }
    };
    let effect = |effect, values: Vec<f64>, on: [bool; 3]| Departure::Effect {
        acting: Acting { effect, values, on },
        only: None,
    };
    for k in 0..3 {
        let on = [0, 1, 2].map(|j| j == k);
        let of_actuator = |what: &str| format!("{what} of actuator {}", k + 1);
        let film = share("L3_mm", FILM);
        let thickness = effect(&ThicknessError, vec![1.0 + film.0], on);
        add(of_actuator("film thickness"), film, "1", thickness);
        let modulus = of("film_modulus", FILM);
        for spring in 0..=super::problem::BRANCHES {
            let name = match spring {
                0 => of_actuator("equilibrium modulus"),
                n => of_actuator(&format!("modulus of branch {n}")),
            };
            let departure = Departure::Spring {
                chain: k,
                spring,
                share: modulus.0,
            };
            add(name, modulus, "1", departure);
        }
        // the rig's key is the cause's id
        let gain = of(AmplifierGain.id(), GAIN);
        add(
            of_actuator("amplifier gain"),
            gain,
            "1",
            effect(&AmplifierGain, vec![gain.0, 0.0], on),
        );
        for (number, (name, key)) in LINKS.iter().enumerate() {
            let link = share(key, LINK);
            add(
                of_actuator(&format!("link {name}")),
                link,
                "1",
                effect(&LinkLengthError, vec![number as f64, link.0], on),
            );
        }
        let (omega, alpha) = (of("omega_deg", ANGLE_DEG), of("alpha_deg", 0.0));
        let input = (omega.0.hypot(alpha.0), omega.1 || alpha.1);
        let angles = [
            ("angle omega + alpha", input),
            ("angle dea_offset", of("dea_offset_deg", ANGLE_DEG)),
        ];
        for (number, (name, angle)) in angles.into_iter().enumerate() {
            let values = vec![number as f64, angle.0.to_radians()];
            add(
                of_actuator(name),
                angle,
                "deg",
                effect(&AngleError, values, on),
            );
        }
    }
    let all = [true; 3];
    let mass = share("m_g", MASS);
    add(
        "mass of the end effector".into(),
        mass,
        "1",
        effect(&PayloadChange, vec![mass.0 * effector_kg, -1e6, -1.0], all),
    );
    let tilt = of("frame_tilt_deg", TILT_DEG);
    let marker = of("marker_mm", MARKER_MM);
    for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let along = |size: f64| {
            let mut v = vec![0.0; 3];
            v[i] = size;
            v
        };
        add(
            format!("capture axes, rotation about {axis}"),
            tilt,
            "deg",
            effect(&FrameTilt, along(tilt.0.to_radians()), all),
        );
        add(
            format!("end-effector marker, {axis}"),
            marker,
            "mm",
            effect(&MarkerOffset, along(marker.0 * 1e-3), all),
        );
    }
    let clock = of("clock_ms", CLOCK_MS);
    for recording in 0..recordings {
        let departure = Departure::Effect {
            acting: Acting {
                effect: &TimeOffset,
                values: vec![clock.0 * 1e-3],
                on: all,
            },
            only: Some(recording),
        };
        let what = format!("clocks of recording {}", recording + 1);
        add(what, clock, "ms", departure);
    }
    out.extend(law());
    out
}

/// By what films may follow another law.
fn law() -> impl Iterator<Item = Tolerance> {
    let term = |known: Known, effect: &'static dyn Effect, values: Vec<f64>| Tolerance {
        what: "law of the film".into(),
        tolerance: LAW_PA,
        unit: "Pa",
        known,
        departure: Departure::Effect {
            acting: Acting {
                effect,
                values,
                on: [true; 3],
            },
            only: None,
        },
    };
    let branches = (BRANCH_POWERS.iter())
        .flat_map(|power| BRANCH_TIMES_S.map(|time_s| vec![LAW_PA, time_s, *power]));
    let branches = branches.map(move |values| term(Known::Branch, &LinearBranch, values));
    let exponent = term(Known::Exponent, &StretchExponent, vec![LAW_PA]);
    std::iter::once(exponent).chain(branches)
}

/// 0, and steps from 1 down to the least by a factor.
fn steps(factor: f64, least: f64) -> Vec<f64> {
    let down = |s: &f64| Some(s * factor).filter(|s| *s >= least);
    let list = std::iter::successors(Some(1.0), down);
    std::iter::once(0.0).chain(list).collect()
}

/// What tolerances that the rig does not state are multiplied by.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Scales {
    /// Those of parts.
    pub parts: f64,
    /// Whether the exponent of stretch is another.
    pub exponent: bool,
    /// That of linear branches.
    pub branches: f64,
}

/// Products of all departures at a fitted model, everything projected out that a refit could absorb.
struct Spread<'a> {
    list: &'a [Tolerance],
    gram: DMatrix<f64>,
    score: DVector<f64>,
    /// Sum of squares with priors at the tangent's minimum, over the noise.
    base: f64,
    /// Modulus of all springs of the film together, over the one at which another law is told.
    film: f64,
}

impl<'a> Spread<'a> {
    /// `noise` is the variance of the noise over the one that the weights promise.
    fn new(
        list: &'a [Tolerance],
        rows: &DMatrix<f64>,
        tangent: &Tangent,
        cost: f64,
        noise: f64,
        mean: &DVector<f64>,
        film_pa: f64,
    ) -> Self {
        // the product of two matrices goes in blocks, that of a transposed one by columns
        let along = tangent.columns.transpose() * rows;
        let absorbed = tangent.absorb(&along);
        let hidden = absorbed.tr_mul(tangent.slope());
        let rest = tangent.slope().dot(&tangent.absorbed(tangent.slope()));
        let gram = (rows.transpose() * rows - along.transpose() * &absorbed) / noise;
        let score = (rows.tr_mul(&tangent.residual) - hidden) / noise;
        // what the mechanism has of them already lies beside the drawing, which is where the priors are
        // centred
        let back = &gram * mean;
        Spread {
            list,
            film: film_pa / LAW_PA,
            base: (cost - rest) / noise + 2.0 * mean.dot(&score) + mean.dot(&back),
            score: score + back,
            gram,
        }
    }

    fn sizes(&self, scales: Scales) -> DVector<f64> {
        let of = |t: &Tolerance| match t.known {
            Known::Stated => 1.0,
            Known::Default => scales.parts,
            Known::Exponent => f64::from(u8::from(scales.exponent)) * EXPONENT * self.film,
            Known::Branch => scales.branches * BRANCH * self.film,
        };
        DVector::from_iterator(self.list.len(), self.list.iter().map(of))
    }

    /// D G D.
    fn scaled(&self, scales: Scales) -> DMatrix<f64> {
        let d = self.sizes(scales);
        DMatrix::from_fn(d.len(), d.len(), |i, j| d[i] * self.gram[(i, j)] * d[j])
    }

    /// -2 ln L at these scales, but for a constant.
    fn at(&self, scales: Scales) -> f64 {
        let mut a = self.scaled(scales);
        for i in 0..a.nrows() {
            a[(i, i)] += 1.0;
        }
        let b = self.sizes(scales).component_mul(&self.score);
        let Some(c) = a.cholesky() else {
            return f64::INFINITY;
        };
        let log_det = 2.0 * c.l_dirty().diagonal().iter().map(|x| x.ln()).sum::<f64>();
        self.base - b.dot(&c.solve(&b)) + log_det
    }

    /// The scales of largest likelihood.
    fn best(&self) -> Scales {
        let parts: Vec<f64> = steps(SCALE_STEP, LEAST_SCALE);
        let has_law = self.list.iter().any(|t| t.known.is_law());
        let laws = match has_law {
            true => steps(LAW_STEP, LEAST_LAW),
            false => vec![0.0],
        };
        let mut all = Vec::new();
        for exponent in [false, has_law] {
            for &branches in &laws {
                all.extend(parts.iter().map(|&parts| Scales {
                    parts,
                    exponent,
                    branches,
                }));
            }
        }
        let told = all.into_par_iter().map(|s| (s, self.at(s)));
        let best = told.min_by(|a, b| a.1.total_cmp(&b.1));
        best.map_or(Scales::default(), |b| b.0)
    }

    /// Directions (columns, in tolerances) that the recordings can see at a scale, each with a normal prior
    /// of standard deviation 1; the priors' means, where those of the tolerances are `mean`; and the
    /// eigenvalues of these, and of all.
    fn directions(
        &self,
        scales: Scales,
        mean: &DVector<f64>,
    ) -> (DMatrix<f64>, Vec<f64>, [DVector<f64>; 2]) {
        let eigen = SymmetricEigen::new(self.scaled(scales));
        let seen: Vec<usize> = (0..self.list.len())
            .filter(|&i| eigen.eigenvalues[i] > VISIBLE)
            .collect();
        let d = self.sizes(scales);
        let combine = DMatrix::from_fn(d.len(), seen.len(), |i, j| {
            d[i] * eigen.eigenvectors[(i, seen[j])]
        });
        let own = |j: &usize| {
            let along = |i: usize| eigen.eigenvectors[(i, *j)] * mean[i] / d[i];
            (0..d.len()).filter(|&i| d[i] > 0.0).map(along).sum()
        };
        let means = seen.iter().map(own).collect();
        let of_seen = seen.iter().map(|&j| eigen.eigenvalues[j]);
        let strong = DVector::from_iterator(seen.len(), of_seen);
        (combine, means, [strong, eigen.eigenvalues])
    }
}

/// How a robot may depart from its drawing in a problem.
pub(super) struct Built {
    /// The tolerances.
    pub list: Vec<Tolerance>,
    /// The scales of those that the rig does not state.
    pub scales: Scales,
    /// -2 ln L there, as the linear theory has it.
    promised: f64,
    /// Eigenvalues of D G D.
    seen: DVector<f64>,
    /// Variance of the noise over the one that the weights promise, as it was told with.
    pub noise: f64,
    /// Variance of a score over the one that white noise would give it.
    colour: f64,
    /// Combinations of tolerances that are unknowns, and the means of their priors.
    combine: DMatrix<f64>,
    means: Vec<f64>,
    /// What one of each makes of the sum of squares, where noise is what the weights promise.
    strengths: DVector<f64>,
    train: DepartureTorques,
    /// The fit about which they were told.
    about: Fitted,
    /// What the mechanism has of the tolerances already, and what it does.
    base: DVector<f64>,
    acts: Vec<Acting>,
    /// Whether a place or an angle that was a part is a cause beside them.
    pub released: bool,
}

/// The columns of all tolerances at a fitted model.
fn columns<S: Subject>(
    problem: &Problem<S>,
    plain: &Fitted,
    list: &[Tolerance],
) -> Result<DepartureTorques, Locked> {
    let own: Vec<Departure> = list.iter().map(|t| t.departure.clone()).collect();
    let state = &plain.state;
    problem
        .residual(plain)
        .departures(&state.eta, &state.beta, &own)
}

/// What the priors add to the sum of squares of a model that has no departures.
fn priors<S: Subject>(problem: &Problem<S>, fitted: &Fitted) -> f64 {
    let own = value_unknowns(&fitted.effects, &fitted.free);
    let nonlinear = problem.nonlinear.iter().chain(&own).zip(&fitted.state.eta);
    let linear = problem.linear.iter().zip(&fitted.state.beta);
    nonlinear.chain(linear).map(|(u, x)| u.penalty(*x)).sum()
}

/// A fit carried on in a problem that has changed.
fn refit<S: Subject>(problem: &Problem<S>, from: &Fitted) -> Fitted {
    problem.fit_near(from, &from.effects, BASELINE)
}

impl Built {
    /// What the tolerances of the rig make of a plain model, in whose problem none are allowed yet:
    /// the scale that explains most, and what the problem needs to have them in its tangent. `noise` is the
    /// variance of the noise over the one that the weights promise, and that of a score over what white noise
    /// would give it; `base` what the mechanism has of each tolerance of `list` already (none yet where it is
    /// `None`).
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    fn tell<S: Subject>(
        problem: &Problem<S>,
        plain: &Fitted,
        [noise, colour]: [f64; 2],
        list: Vec<Tolerance>,
        base: Option<(DVector<f64>, Vec<Acting>)>,
    ) -> Result<Built, Locked> {
        let (base, acts) = base.unwrap_or_else(|| (DVector::zeros(list.len()), Vec::new()));
        let tangent = Tangent::new(problem, plain)?;
        let train = columns(problem, plain, &list)?;
        let rows = problem.train.departure_rows(&train);
        let mean = -&base;
        let cost = tangent.residual.norm_squared() + priors(problem, plain);
        let film = problem
            .train
            .parameters(&plain.state.eta, &plain.state.beta);
        let film_pa: f64 = film.film.mu_pa.iter().sum();
        let spread = Spread::new(&list, &rows, &tangent, cost, noise, &mean, film_pa);
        let scales = spread.best();
        let (combine, means, [strong, mut seen]) = spread.directions(scales, &mean);
        // What parts may do costs the same whether a cause that does the like is beside them or not.
        if !plain.free.is_empty() {
            let mut held = plain.clone();
            held.free.clear();
            held.state.eta.truncate(problem.nonlinear.len());
            let film = Tangent::new(problem, &held)?;
            let whole = Spread::new(&list, &rows, &film, cost, noise, &mean, film_pa);
            seen = whole.scaled(scales).symmetric_eigenvalues();
        }
        Ok(Built {
            scales,
            promised: spread.at(scales),
            seen,
            noise,
            colour,
            combine,
            means,
            strengths: noise * strong,
            train,
            about: plain.clone(),
            base,
            acts,
            list,
            released: false,
        })
    }

    /// Lets the parts of a robot differ within their tolerances, and fits the model of `plain`, a fit
    /// without, with them. What the fit finds is taken for the mechanism, and told again about there. `None`
    /// where a rig has no tolerances or recordings see none of them, or where linear theory leaves more than
    /// `most` of -2 ln L.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch, or such a mechanism cannot follow.
    pub fn fit<S: Subject>(
        problem: &mut Problem<S>,
        plain: &Fitted,
        noise: [f64; 2],
        most: f64,
    ) -> Result<Option<(Built, Fitted)>, Locked> {
        let list = problem.train.tolerances();
        if list.is_empty() {
            return Ok(None);
        }
        let built = Built::tell(problem, plain, noise, list, None)?;
        if !built.worth(most) {
            return Ok(None);
        }
        built.enter(problem);
        let warm = refit(problem, plain);
        // a film that bent to a mechanism which was not so
        let fitted = or_nominal(problem, warm, &plain.effects, BASELINE);
        built.settled(problem, &fitted)
    }

    /// Parts told about the mechanism and the film of `fitted`, a fit with them, and again about those of the
    /// next, until they stay.
    ///
    /// # Errors
    /// As [`Built::fit`].
    pub fn settled<S: Subject>(
        &self,
        problem: &mut Problem<S>,
        fitted: &Fitted,
    ) -> Result<Option<(Built, Fitted)>, Locked> {
        let mut before = fitted.cost();
        let (mut built, mut fitted) = self.again(problem, fitted)?;
        for round in 2..ROUNDS[1] {
            if built.combine.ncols() == 0 {
                return Ok(None);
            }
            if round >= ROUNDS[0] && fitted.cost() > SETTLED * before {
                break;
            }
            before = fitted.cost();
            (built, fitted) = built.again(problem, &fitted)?;
        }
        Ok(Some((built, fitted)))
    }

    /// -2 ln L that linear theory promises of parts about a fit without.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn promise<S: Subject>(
        problem: &Problem<S>,
        plain: &Fitted,
        noise: [f64; 2],
    ) -> Result<f64, Locked> {
        let list = problem.train.tolerances();
        Ok(Built::tell(problem, plain, noise, list, None)?.promised)
    }

    /// Whether recordings see parts that could leave no more than `most` of -2 ln L.
    fn worth(&self, most: f64) -> bool {
        self.combine.ncols() > 0 && self.promised <= most
    }

    /// The parts told once more about the mechanism and the film of `fitted`, a fit with them. (A film that
    /// was refitted without those parts that are not in the mechanism would be bent by them again.) What is
    /// linear about one mechanism need not be so about the next, where a bicep rests against a stop: a step
    /// that leaves far more than it promised is made shorter.
    ///
    /// # Errors
    /// As [`Built::fit`].
    pub fn again<S: Subject>(
        &self,
        problem: &mut Problem<S>,
        fitted: &Fitted,
    ) -> Result<(Built, Fitted), Locked> {
        let mut out = self.step(problem, fitted, 1.0);
        for share in SHORTER {
            if let Ok(o) = &out
                && o.1.cost() <= MISSED * fitted.cost()
            {
                break;
            }
            let shorter = self.step(problem, fitted, share);
            let cost = |o: &Result<(Built, Fitted), Locked>| {
                o.as_ref().map_or(f64::INFINITY, |o| o.1.cost())
            };
            if cost(&shorter) < cost(&out) {
                out = shorter;
            } else if let Ok(o) = &out {
                o.0.restore(problem)?;
            }
        }
        out
    }

    /// The parts told about a mechanism that goes a share of the way to that of `fitted`.
    fn step<S: Subject>(
        &self,
        problem: &mut Problem<S>,
        fitted: &Fitted,
        share: f64,
    ) -> Result<(Built, Fitted), Locked> {
        let base = self.settle(problem, fitted, share)?;
        let mut about = fitted.clone();
        about.state.beta.truncate(problem.linear.len());
        let noise = self.noise_of(fitted);
        let list = self.list.clone();
        let mut built = Built::tell(problem, &about, noise, list, Some(base))?;
        built.released = self.released;
        built.enter(problem);
        let fitted = refit(problem, &about);
        Ok((built, fitted))
    }

    /// The noise that parts are told with about a fit, and its colour. What a fit leaves is the most that the
    /// noise can be; a misfit had looked like more, and more noise hides directions.
    fn noise_of(&self, fitted: &Fitted) -> [f64; 2] {
        let left = (fitted.cost() / fitted.state.rows as f64).max(1.0);
        [self.noise.min(self.colour * left), self.colour]
    }

    /// The parts told beside a place or an angle of theirs that is a cause now: it has no tolerance any more,
    /// and is fitted from where they had it. `None` where nothing is left of the others.
    ///
    /// # Errors
    /// As [`Built::fit`].
    pub fn released<S: Subject>(
        &self,
        problem: &mut Problem<S>,
        fitted: &Fitted,
        cause: &Acting,
    ) -> Result<Option<(Built, Fitted)>, Locked> {
        let found = self.found(fitted);
        let kept = (self.list.iter().zip(found.iter())).filter(|(t, _)| !t.is_of(cause));
        let (list, mut found): (Vec<Tolerance>, Vec<f64>) =
            kept.map(|(t, size)| (t.clone(), *size)).unzip();
        let acts = in_the_mechanism(&list, &mut found);
        Built::rebuild(problem, acts.clone())?;
        let effects = vec![cause.clone()];
        let free: Vec<(usize, usize)> = cause.free_values().into_iter().map(|v| (0, v)).collect();
        let mut about = fitted.clone();
        about.state.eta.truncate(problem.nonlinear.len());
        let own = value_unknowns(&effects, &free);
        about.state.eta.extend(own.iter().map(|u| u.start));
        about.state.beta.truncate(problem.linear.len());
        let about = Fitted {
            effects,
            free,
            ..about
        };
        let base = (DVector::from_vec(found), acts);
        let noise = self.noise_of(fitted);
        let mut built = Built::tell(problem, &about, noise, list, Some(base))?;
        built.released = true;
        built.enter(problem);
        let fitted = refit(problem, &about);
        built.settled(problem, &fitted)
    }

    /// Puts the tolerances into a problem.
    fn enter<S: Subject>(&self, problem: &mut Problem<S>) {
        problem.train.allow(&self.train, &self.combine);
        problem
            .linear
            .extend(self.means.iter().map(|&mean| Unknown {
                prior: Some(Prior { mean, sd: 1.0 }),
                ..Unknown::free(0.0, -FARTHEST, FARTHEST)
            }));
    }

    /// Takes all tolerances out of a problem, whose mechanism these effects make.
    fn rebuild<S: Subject>(problem: &mut Problem<S>, acts: Vec<Acting>) -> Result<(), Locked> {
        let none = DMatrix::zeros(0, 0);
        let as_drawn = problem.linear.len() - problem.train.allowed();
        problem.linear.truncate(as_drawn);
        problem.train.allow(&Vec::new(), &none);
        problem.train.rebuild(acts)
    }

    /// Makes the parts of a robot differ in recordings that were held out as they do in the fitted ones.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch, or the mechanism cannot follow.
    pub fn hold<S: Subject>(&self, problem: &Problem<S>, holdout: &mut S) -> Result<(), Locked> {
        holdout.rebuild(self.acts.clone())?;
        // what belongs to one recording belongs to none of those that were held out
        let own = |t: &Tolerance| match t.departure.clone() {
            Departure::Effect {
                acting,
                only: Some(_),
            } => Departure::Effect {
                acting,
                only: Some(usize::MAX),
            },
            other => other,
        };
        let own: Vec<Departure> = self.list.iter().map(own).collect();
        let plain = &self.about.state.eta[..problem.nonlinear.len()];
        let effects = self.about.effects.clone();
        let with = holdout.with_effects(effects, Vec::new(), &problem.holdout_when);
        let torques = with.departures(&holdout.carried(plain), &self.about.state.beta, &own)?;
        holdout.allow(&torques, &self.combine);
        Ok(())
    }

    /// Whether recordings that were held out can have parts that differ so: a pose that the mechanism cannot
    /// take there is one that the robot took.
    pub fn is_held<S: Subject>(&self, problem: &Problem<S>, holdout: &S) -> bool {
        let mut holdout = holdout.with_effects(Vec::new(), Vec::new(), &problem.holdout_when);
        holdout.rebuild(self.acts.clone()).is_ok()
    }

    /// Departures in tolerances that a fit makes, from the drawing. In directions that the recordings do not
    /// see they are as drawn, whatever the mechanism has.
    fn found(&self, fitted: &Fitted) -> DVector<f64> {
        let beta = &fitted.state.beta;
        let sizes = &beta[beta.len() - self.combine.ncols()..];
        let from_drawing = sizes.iter().zip(&self.means).map(|(c, m)| c - m);
        &self.combine * DVector::from_iterator(sizes.len(), from_drawing)
    }

    /// What the priors of the parts have of -2 ln L beside the sum of squares, were this the variance of the
    /// noise.
    pub fn spread(&self, noise: f64) -> f64 {
        let share = self.noise / noise;
        let each = self.seen.iter().map(|s| (share * s.max(0.0)).ln_1p());
        each.sum()
    }

    /// What more the departures of a fit cost of -2 ln L than the sum of squares over this variance of the
    /// noise has of them. A fit holds them against noise as the weights promise it, of variance 1: where the
    /// recordings say c, it leaves c^2 s/(1 + s), s a strength, and noise of variance n would leave
    /// c^2 s/(n + s).
    pub fn priors(&self, fitted: &Fitted, noise: f64) -> f64 {
        let beta = &fitted.state.beta;
        let sizes = &beta[beta.len() - self.combine.ncols()..];
        let each = sizes.iter().zip(&self.means).zip(self.strengths.iter());
        each.map(|((size, mean), s)| prior_beside(size - mean, *s, noise))
            .sum()
    }

    /// Takes the mechanism a share of the way to what a fit makes of it, and all that was allowed out of the
    /// problem. Gives the departures that the mechanism then has.
    fn settle<S: Subject>(
        &self,
        problem: &mut Problem<S>,
        fitted: &Fitted,
        share: f64,
    ) -> Result<(DVector<f64>, Vec<Acting>), Locked> {
        let mut found = &self.base + share * (self.found(fitted) - &self.base);
        let acts = in_the_mechanism(&self.list, found.as_mut_slice());
        Built::rebuild(problem, acts.clone())?;
        Ok((found, acts))
    }

    /// Makes a problem's parts differ as they do here.
    ///
    /// # Errors
    /// [`Locked`] when the mechanism cannot follow.
    pub fn restore<S: Subject>(&self, problem: &mut Problem<S>) -> Result<(), Locked> {
        Built::rebuild(problem, self.acts.clone())?;
        self.enter(problem);
        Ok(())
    }

    /// The part that a fit takes farthest from its drawing, where that is more than tolerances make.
    pub fn beyond(&self, fitted: &Fitted) -> Option<Departed> {
        self.largest(fitted).filter(|d| d.times() >= WITHIN)
    }

    /// The part that a fit takes farthest from its drawing.
    fn largest(&self, fitted: &Fitted) -> Option<Departed> {
        largest(&self.departed(fitted)).cloned()
    }

    /// How many times its tolerance the part is off that a fit takes farthest.
    pub fn farthest(&self, fitted: &Fitted) -> f64 {
        self.largest(fitted).map_or(0.0, |d| d.times())
    }

    /// How much less likely, in ln, normal parts are to be as far off as the farthest is than not to: 0 up to
    /// where the largest of so many lies.
    pub fn strange(&self, fitted: &Fitted) -> f64 {
        (0.5 * self.farthest(fitted).powi(2) - (self.departed(fitted).len() as f64).ln()).max(0.0)
    }

    /// Torque that linear branches make of a film in a fit, N m: root mean square over films and samples.
    fn branches_n_m(&self, found: &DVector<f64>) -> f64 {
        let all = 0..self.list.len();
        let branches: Vec<usize> = all
            .filter(|&i| self.list[i].known == Known::Branch)
            .collect();
        let (mut squares, mut count) = (0.0, 0);
        for torques in &self.train {
            for k in 0..3 {
                let samples = torques.first().map_or(0, |t| t[k].len());
                let at = |i: usize| -> f64 {
                    let each = |&b: &usize| found[b] * torques[b][k][i];
                    branches.iter().map(each).sum()
                };
                squares += (0..samples).map(|i| at(i).powi(2)).sum::<f64>();
                count += samples;
            }
        }
        (squares / count.max(1) as f64).sqrt()
    }

    /// What is said of what a fit makes of parts and of the film's law.
    pub fn remarks(&self, fitted: &Fitted) -> Vec<String> {
        let mut out: Vec<String> = remark(&self.departed(fitted)).into_iter().collect();
        let found = self.found(fitted);
        let mut law = Vec::new();
        let exponent = self.list.iter().position(|t| t.known == Known::Exponent);
        // over the modulus of the equilibrium spring it is the exponent's distance from 2
        let beyond = |at: usize| found[at] * LAW_PA / fitted.state.beta[0];
        if let Some(more) = exponent.map(beyond).filter(|m| m.abs() >= WORTH_SAYING) {
            law.push(format!(
                "its stress grows with stretch to the power of about {:.1}, where the model has 2",
                2.0 + more
            ));
        }
        if self.scales.branches > 0.0 {
            let torque = in_unit(1e3 * self.branches_n_m(&found), "mN m");
            law.push(format!(
                "it relaxes rather as a sum of linear branches ({torque} of torque, rms)"
            ));
        }
        if !law.is_empty() {
            out.push(format!(
                "The film may follow another law than the model's: {}. That is no cause, but stiff electrodes or hinges may hide in it; pull a strip of bare film to tell.",
                law.join("; ")
            ));
        }
        out
    }

    /// What a fit makes of each tolerance of a part.
    pub fn departed(&self, fitted: &Fitted) -> Vec<Departed> {
        self.list
            .iter()
            .zip(self.found(fitted).iter())
            .filter(|(t, _)| !t.known.is_law())
            .map(|(t, found)| Departed {
                what: t.what.clone(),
                found: found * t.tolerance,
                tolerance: t.tolerance,
                unit: t.unit,
                stated: t.known == Known::Stated,
            })
            .collect()
    }
}

/// [`Built::priors`] of one direction of this strength, that a fit takes so far from its drawing.
fn prior_beside(size: f64, strength: f64, noise: f64) -> f64 {
    let told = size * (1.0 + strength) / strength;
    told * told * (strength / (noise + strength) - strength / (noise * (1.0 + strength)))
}

/// What departures of these sizes, in tolerances, do to the mechanism; the sizes of all others become 0.
fn in_the_mechanism(list: &[Tolerance], sizes: &mut [f64]) -> Vec<Acting> {
    let mut acts = Vec::new();
    for (t, size) in list.iter().zip(sizes) {
        match &t.departure {
            Departure::Effect { acting, .. } if acting.effect.site() == Site::Motion => {
                let mut own = acting.clone();
                for (v, q) in own.values.iter_mut().zip(acting.effect.parameters()) {
                    if q.size {
                        *v = q.off + *size * (*v - q.off);
                    }
                }
                acts.push(own);
            }
            _ => *size = 0.0,
        }
    }
    acts
}

/// Whether a cause scales all that voltages make as parts that differ do: films of another thickness, gains.
pub(super) fn scales_as_parts(id: &str) -> bool {
    [ThicknessError.id(), AmplifierGain.id()].contains(&id)
}

/// How many times its tolerance a cause is, where it is of the kind of one.
pub(super) fn times(list: &[Tolerance], acting: &Acting) -> Option<f64> {
    let q = acting.effect.parameters();
    let word = (!acting.effect.variants().is_empty()).then(|| acting.values[0]);
    let mut squares = 0.0;
    for t in list {
        let Departure::Effect { acting: own, .. } = &t.departure else {
            continue;
        };
        let same = own.effect.id() == acting.effect.id()
            && (0..3).all(|k| !own.on[k] || acting.on[k])
            && word.is_none_or(|w| own.values[0] == w);
        if !same || own.effect.id() == PayloadChange.id() {
            continue;
        }
        let by: f64 = (0..q.len())
            .filter(|&i| q[i].size && own.values[i] != q[i].off)
            .map(|i| ((acting.values[i] - q[i].off) / (own.values[i] - q[i].off)).powi(2))
            .sum();
        // the axes of a vector add up; actuators and recordings say the same again
        squares = match acting.effect.parameters().len() {
            3 => squares + by,
            _ => f64::max(squares, by),
        };
    }
    (squares > 0.0).then(|| squares.sqrt())
}

/// The cause of the catalogue that a place or an angle which is off is: a marker, axes, a link. (The thickness
/// of a film scales all that a voltage makes, and stands in for other causes: of seven parts beyond their
/// tolerances on robots of another simulator four places and angles were what was off, three films were not.)
pub(super) fn cause_of(
    list: &[Tolerance],
    departed: &[Departed],
    part: &Departed,
) -> Option<Acting> {
    let own = list.iter().find(|t| t.what == part.what)?.acting()?;
    let is_place = own.effect.site() == Site::Motion && !own.effect.scales_made();
    if !is_place || by_id(own.effect.id()).is_none() {
        return None;
    }
    let quantities = own.effect.parameters();
    let mut out = own.clone();
    for (v, q) in out.values.iter_mut().zip(quantities).filter(|v| v.1.size) {
        *v = q.off;
    }
    for t in list.iter().filter(|t| t.is_of(own)) {
        let (Some(other), Some(d)) = (t.acting(), departed.iter().find(|d| d.what == t.what))
        else {
            continue;
        };
        for (i, q) in quantities.iter().enumerate().filter(|q| q.1.size) {
            out.values[i] += d.found / d.tolerance * (other.values[i] - q.off);
        }
    }
    Some(out)
}

/// Whether a cause is a departure within its tolerance.
pub(super) fn holds(list: &[Tolerance], acting: &Acting) -> bool {
    times(list, acting).is_some_and(|t| t < OF_ONE_PART)
}

/// The departure that is the most times its tolerance.
fn largest(departed: &[Departed]) -> Option<&Departed> {
    let by_size = |a: &&Departed, b: &&Departed| a.times().total_cmp(&b.times());
    departed.iter().max_by(by_size)
}

/// What is said of departures: the largest of them.
fn remark(departed: &[Departed]) -> Option<String> {
    let largest = largest(departed).filter(|d| d.times() >= WORTH_SAYING)?;
    let says = largest.says();
    Some(match largest.times() {
        within if within < WITHIN => format!(
            "Parts may differ from the drawing within their tolerances, and do; most of all {says}. Such differences are no cause."
        ),
        near if near < FAR => format!(
            "Parts differ from the drawing, most of all {says}, which is more than tolerances make. Measure it, and state what it is in rig.toml."
        ),
        _ => format!(
            "Parts take up what the model leaves out, most of all {says}: no workshop is off by as much, so it is something else."
        ),
    })
}

/// Departure, in tolerances or of an exponent, that is worth a word.
const WORTH_SAYING: f64 = 0.05;
/// Times that departures are told, each about the mechanism and the film of the last, at least and at most;
/// and the share of the cost before from which they are settled.
const ROUNDS: [usize; 2] = [3, 6];
const SETTLED: f64 = 0.95;
/// What a step leaves over what it promised, from which it is made shorter, and the shares of it that are
/// tried.
const MISSED: f64 = 4.0;
const SHORTER: [f64; 2] = [0.25, 0.06];
/// Departure, in tolerances, above which a part that was picked is not within them: of normal ones one in
/// 370.
const OF_ONE_PART: f64 = 3.0;
/// Departure, in tolerances, above which a part is not within them: of seventy normal ones the largest
/// exceeds it in one robot of 200.
const WITHIN: f64 = 4.0;
/// Departure, in tolerances, from which parts are not believed: no workshop is off by as much, but parts that
/// stand in for a cause go there, and so do parts that shrink all torques with one.
pub(super) const FAR: f64 = 10.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(list: &[Tolerance], score: Vec<f64>) -> Spread<'_> {
        let n = score.len();
        Spread {
            list,
            gram: DMatrix::identity(n, n) * 1e4,
            score: DVector::from_vec(score),
            base: 0.0,
            film: 1.0,
        }
    }

    #[test]
    fn the_scale_is_that_of_the_departures() {
        let list: Vec<Tolerance> = of_robot(&[], 6e-3, 3).into_iter().take(40).collect();
        // 40 directions seen to 1 % of a tolerance: all off by 0.2 of theirs, or none
        let off = spread(
            &list,
            (0..40)
                .map(|i| if i % 2 == 0 { 2e3 } else { -2e3 })
                .collect(),
        );
        let scale = off.best().parts;
        assert!((0.14..0.3).contains(&scale), "{scale}");
        assert_eq!(spread(&list, vec![0.0; 40]).best(), Scales::default());
    }

    #[test]
    fn what_is_stated_is_not_scaled() {
        let stated = [Stated {
            key: "q_mm",
            value: 50.0,
            tolerance: 0.5,
        }];
        let list = of_robot(&stated, 6e-3, 1);
        let own: Vec<&Tolerance> = list.iter().filter(|t| t.known == Known::Stated).collect();
        assert_eq!(own.len(), 3);
        assert!(own.iter().all(|t| (t.tolerance - 0.01).abs() < 1e-12));
        let spread = spread(&list, vec![0.0; list.len()]);
        let laws = list.iter().filter(|t| t.known.is_law()).count();
        let sum = 3.0
            + 0.1 * (list.len() - laws - 3) as f64
            + EXPONENT
            + 0.2 * BRANCH * (laws - 1) as f64;
        let scales = Scales {
            parts: 0.1,
            exponent: true,
            branches: 0.2,
        };
        assert!((spread.sizes(scales).sum() - sum).abs() < 1e-9);
    }

    /// What a fit makes of one direction at noise as promised, and what it costs where noise is more.
    #[test]
    fn priors_count_in_full_beside_more_noise() {
        let (strength, told, noise) = (40.0_f64, 3.0, 25.0);
        // least of s (c - told)^2 + c^2, and of s (c - told)^2/n + c^2
        let fitted = told * strength / (1.0 + strength);
        let left = strength * (fitted - told).powi(2) + fitted * fitted;
        let least = |c: f64| strength * (c - told).powi(2) / noise + c * c;
        let at = told * strength / (noise + strength);
        assert!(least(at) < least(at + 1e-3) && least(at) < least(at - 1e-3));
        let more = prior_beside(fitted, strength, noise);
        assert!((left / noise + more - least(at)).abs() < 1e-9);
        assert_eq!(prior_beside(fitted, strength, 1.0), 0.0);
    }

    #[test]
    fn a_place_that_is_off_is_a_cause_and_a_film_is_none() {
        let list = of_robot(&[], 6e-3, 2);
        let off = |what: &str, found: f64| {
            let t = list.iter().find(|t| t.what == what).unwrap();
            Departed {
                what: what.into(),
                found,
                tolerance: t.tolerance,
                unit: t.unit,
                stated: false,
            }
        };
        let marker = [
            off("end-effector marker, y", 0.7),
            off("end-effector marker, z", -0.1),
            off("link q of actuator 2", 0.011),
        ];
        let cause = cause_of(&list, &marker, &marker[0]).unwrap();
        assert_eq!(cause.effect.id(), "marker_offset");
        for (found, told_m) in cause.values.iter().zip([0.0, 0.7e-3, -0.1e-3]) {
            assert!((found - told_m).abs() < 1e-12);
        }
        let link = cause_of(&list, &marker, &marker[2]).unwrap();
        assert_eq!(link.on, [false, true, false]);
        assert!(link.values[0] == 2.0 && (link.values[1] - 0.011).abs() < 1e-12);
        let film = off("film thickness of actuator 1", 0.2);
        assert!(cause_of(&list, std::slice::from_ref(&film), &film).is_none());
    }

    #[test]
    fn a_cause_is_told_in_its_tolerances() {
        let list = of_robot(&[], 6e-3, 2);
        let acting = Acting {
            effect: by_id("link_length_error").unwrap(),
            values: vec![7.0, 0.016],
            on: [false, true, false],
        };
        assert!((times(&list, &acting).unwrap() - 8.0).abs() < 1e-9);
        let tilt = Acting {
            effect: by_id("frame_tilt").unwrap(),
            values: vec![0.3f64.to_radians(), 0.4f64.to_radians(), 0.0],
            on: [true; 3],
        };
        assert!((times(&list, &tilt).unwrap() - 2.5).abs() < 1e-9);
    }
}
