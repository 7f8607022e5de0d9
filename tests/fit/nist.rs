//! The NIST yardstick: 27 problems of the Statistical Reference Datasets, each from its two starting points,
//! and rivals, bounds, failures.
//!
//! The models are those of the file headers, written once over dual numbers, so that the derivatives are
//! exact. See `datasets/nist1997_strd/README.md` for the data and the score.

use std::convert::Infallible;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use deacal::fit::levenberg_marquardt::{
    Differenced, Differences, LeastSquares, Matrix, NoCovariance, Options, Outcome, Resting,
    StopReason, minimise, minimise_watched,
};
use num_dual::{Dual64, DualNum};

/// One `.dat` file.
struct Strd {
    name: String,
    starts: [Vec<f64>; 2],
    certified: Vec<f64>,
    deviations: Vec<f64>,
    residual_sum: f64,
    y: Vec<f64>,
    x: Vec<Vec<f64>>,
}

/// Reads a `.dat` file: the header says on which lines the certified values and the data stand.
fn read(path: &Path) -> Strd {
    let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let lines: Vec<&str> = text.lines().collect();
    let numbers = |line: &str| -> Vec<f64> {
        line.split_whitespace()
            .map(|word| word.parse().unwrap_or_else(|e| panic!("{word}: {e}")))
            .collect()
    };
    // "               Data              (lines 61 to 74)"
    let range = |label: &str| -> std::ops::Range<usize> {
        let line = (lines.iter().take(12))
            .find(|l| l.contains(label))
            .unwrap_or_else(|| panic!("{}: no {label}", path.display()));
        let inside = &line[line.find('(').unwrap()..line.find(')').unwrap()];
        let ends: Vec<usize> = inside
            .split_whitespace()
            .filter_map(|w| w.parse().ok())
            .collect();
        ends[0] - 1..ends[1]
    };
    let (mut starts, mut certified, mut deviations) = ([vec![], vec![]], vec![], vec![]);
    for line in &lines[range("Starting Values")] {
        let values = numbers(line.split_once('=').unwrap().1);
        starts[0].push(values[0]);
        starts[1].push(values[1]);
        certified.push(values[2]);
        deviations.push(values[3]);
    }
    let residual_sum = lines
        .iter()
        .find_map(|l| l.strip_prefix("Residual Sum of Squares:"))
        .map(|w| w.trim().parse().unwrap())
        .unwrap();
    let (mut y, mut x) = (vec![], vec![]);
    for line in lines[range(" Data ")]
        .iter()
        .filter(|l| !l.trim().is_empty())
    {
        let row = numbers(line);
        y.push(row[0]);
        x.push(row[1..].to_vec());
    }
    Strd {
        name: path.file_stem().unwrap().to_string_lossy().into_owned(),
        starts,
        certified,
        deviations,
        residual_sum,
        y,
        x,
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets/nist1997_strd")
}

fn all() -> Vec<Strd> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "dat"))
        .collect();
    paths.sort();
    assert_eq!(paths.len(), 27);
    paths.iter().map(|path| read(path)).collect()
}

fn one(name: &str) -> Strd {
    read(&folder().join(format!("{name}.dat")))
}

/// The model of a file header at one sample; `b[0]` is its b1.
fn model<D: DualNum<Primitive = f64> + Copy>(name: &str, b: &[D], xs: &[f64]) -> D {
    let x = xs[0];
    let real = |value: f64| D::from(value);
    let pi = std::f64::consts::PI;
    match name {
        "Bennett5" => b[0] * (b[1] + x).powd(-b[2].recip()),
        "BoxBOD" | "Misra1a" => b[0] * (real(1.0) - (-b[1] * x).exp()),
        "Chwirut1" | "Chwirut2" => (-b[0] * x).exp() / (b[1] + b[2] * x),
        "DanWood" => b[0] * real(x).powd(b[1]),
        "ENSO" => {
            let year = 2.0 * pi * x / 12.0;
            let (first, second) = (b[3].recip() * (2.0 * pi * x), b[6].recip() * (2.0 * pi * x));
            b[0] + b[1] * year.cos()
                + b[2] * year.sin()
                + b[4] * first.cos()
                + b[5] * first.sin()
                + b[7] * second.cos()
                + b[8] * second.sin()
        }
        "Eckerle4" => b[0] / b[1] * (((-b[2] + x) / b[1]).powi(2) * -0.5).exp(),
        "Gauss1" | "Gauss2" | "Gauss3" => {
            b[0] * (-b[1] * x).exp()
                + b[2] * (-((-b[3] + x) / b[4]).powi(2)).exp()
                + b[5] * (-((-b[6] + x) / b[7]).powi(2)).exp()
        }
        "Hahn1" | "Thurber" => {
            (b[0] + b[1] * x + b[2] * (x * x) + b[3] * (x * x * x))
                / (real(1.0) + b[4] * x + b[5] * (x * x) + b[6] * (x * x * x))
        }
        "Kirby2" => (b[0] + b[1] * x + b[2] * (x * x)) / (real(1.0) + b[3] * x + b[4] * (x * x)),
        "Lanczos1" | "Lanczos2" | "Lanczos3" => {
            b[0] * (-b[1] * x).exp() + b[2] * (-b[3] * x).exp() + b[4] * (-b[5] * x).exp()
        }
        "MGH09" => b[0] * (b[1] * x + x * x) / (b[2] * x + b[3] + x * x),
        "MGH10" => b[0] * (b[1] / (b[2] + x)).exp(),
        "MGH17" => b[0] + b[1] * (-b[3] * x).exp() + b[2] * (-b[4] * x).exp(),
        "Misra1b" => b[0] * (real(1.0) - (b[1] * (x / 2.0) + 1.0).powi(-2)),
        "Misra1c" => b[0] * (real(1.0) - (b[1] * (2.0 * x) + 1.0).sqrt().recip()),
        "Misra1d" => b[0] * b[1] * x / (b[1] * x + 1.0),
        "Nelson" => b[0] - b[1] * x * (-b[2] * xs[1]).exp(),
        "Rat42" => b[0] / ((b[1] - b[2] * x).exp() + 1.0),
        "Rat43" => b[0] / ((b[1] - b[2] * x).exp() + 1.0).powd(b[3].recip()),
        "Roszman1" => b[0] - b[1] * x - (b[2] / (-b[3] + x)).atan() / pi,
        _ => panic!("no model for {name}"),
    }
}

impl Strd {
    /// What the model is fitted to: Nelson's header gives log y.
    fn target(&self, i: usize) -> f64 {
        if self.name == "Nelson" {
            self.y[i].ln()
        } else {
            self.y[i]
        }
    }
}

impl LeastSquares for Strd {
    type Error = Infallible;

    fn parameter_count(&self) -> usize {
        self.certified.len()
    }

    fn residual_count(&self) -> usize {
        self.y.len()
    }

    fn residuals(&self, p: &[f64], out: &mut [f64]) -> Result<(), Infallible> {
        for (i, r) in out.iter_mut().enumerate() {
            *r = model(&self.name, p, &self.x[i]) - self.target(i);
        }
        Ok(())
    }

    fn jacobian(&self, p: &[f64], out: &mut Matrix) -> Result<(), Infallible> {
        let mut b: Vec<Dual64> = p.iter().map(|&v| Dual64::from(v)).collect();
        for j in 0..p.len() {
            b[j].eps = 1.0;
            for i in 0..self.y.len() {
                out[(i, j)] = model(&self.name, &b, &self.x[i]).eps;
            }
            b[j].eps = 0.0;
        }
        Ok(())
    }
}

/// The worst log relative error, between 0 and 11 digits.
fn digits(found: &[f64], certified: &[f64]) -> f64 {
    (found.iter().zip(certified))
        .map(|(f, c)| {
            let error = ((f - c) / c).abs();
            if error.is_nan() {
                0.0
            } else {
                (-error.log10()).clamp(0.0, 11.0)
            }
        })
        .fold(11.0, f64::min)
}

fn fit(problem: &Strd, start: usize) -> Outcome {
    minimise(problem, &problem.starts[start], &Options::default()).unwrap()
}

#[test]
fn all_54_runs_are_solved() {
    let (mut solved, mut runs) = (0, 0.0);
    let (mut parameters, mut deviations, mut sums) = (0.0, 0.0, 0.0);
    println!(
        "{:10} start  digits: parameters  deviations  sum   steps polish evaluations  offset   reason",
        "problem"
    );
    for problem in all() {
        for start in [0, 1] {
            let outcome = fit(&problem, start);
            let of_parameters = digits(&outcome.parameters, &problem.certified);
            let of_deviations = outcome
                .standard_errors_scaled_by_residual_variance()
                .map_or(0.0, |found| digits(&found, &problem.deviations));
            let of_sum = digits(
                &[outcome.residual_sum_of_squares()],
                &[problem.residual_sum],
            );
            println!(
                "{:10} {:5}  {:18.2}  {:10.2}  {:5.2} {:5} {:6} {:11}  {:.1e}  {}",
                problem.name,
                start + 1,
                of_parameters,
                of_deviations,
                of_sum,
                outcome.iterations,
                outcome.polish_steps,
                outcome.evaluations,
                outcome.relative_offset,
                outcome.reason
            );
            runs += 1.0;
            solved += usize::from(of_parameters >= 6.0);
            parameters += of_parameters;
            deviations += of_deviations;
            sums += of_sum;
        }
    }
    println!(
        "solved {solved} of {runs}; mean digits: parameters {:.3}, deviations {:.3}, residual sum {:.3}",
        parameters / runs,
        deviations / runs,
        sums / runs
    );
    assert_eq!(solved, 54);
    // scipy with column scaling, 1e-15 and exact derivatives: 9.31 and 9.07; Ceres 9.4
    assert!(parameters / runs >= 10.6);
    assert!(deviations / runs >= 10.3);
}

/// The same problems for the crate `levenberg-marquardt`, a port of MINPACK.
struct Rival<'a> {
    problem: &'a Strd,
    p: nalgebra::DVector<f64>,
}

impl levenberg_marquardt::LeastSquaresProblem<f64, nalgebra::Dyn, nalgebra::Dyn> for Rival<'_> {
    type ResidualStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::U1>;
    type JacobianStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::Dyn>;
    type ParameterStorage = nalgebra::VecStorage<f64, nalgebra::Dyn, nalgebra::U1>;

    fn set_params(&mut self, p: &nalgebra::DVector<f64>) {
        self.p.copy_from(p);
    }

    fn params(&self) -> nalgebra::DVector<f64> {
        self.p.clone()
    }

    fn residuals(&self) -> Option<nalgebra::DVector<f64>> {
        let mut out = nalgebra::DVector::zeros(self.problem.residual_count());
        LeastSquares::residuals(self.problem, self.p.as_slice(), out.as_mut_slice()).ok()?;
        Some(out)
    }

    fn jacobian(&self) -> Option<Matrix> {
        let mut out = Matrix::zeros(
            self.problem.residual_count(),
            self.problem.parameter_count(),
        );
        LeastSquares::jacobian(self.problem, self.p.as_slice(), &mut out).ok()?;
        Some(out)
    }
}

/// Two programs with nothing in common but the method meet in the same minimum, and ours is nowhere above.
#[test]
fn agrees_with_the_crate_levenberg_marquardt() {
    for name in [
        "Misra1a", "Chwirut2", "Gauss1", "Kirby2", "Thurber", "Rat43", "MGH09",
    ] {
        let problem = one(name);
        let rival = Rival {
            problem: &problem,
            p: nalgebra::DVector::from_column_slice(&problem.starts[1]),
        };
        let (rival, report) = levenberg_marquardt::LevenbergMarquardt::new().minimize(rival);
        assert!(report.termination.was_successful(), "{name}");
        let outcome = fit(&problem, 1);
        assert!(
            digits(&outcome.parameters, rival.p.as_slice()) >= 5.5,
            "{name}: {:?} {:?}",
            outcome.parameters,
            rival.p
        );
        assert!(
            outcome.cost <= report.objective_function * (1.0 + 1e-12),
            "{name}"
        );
    }
}

/// Ridders' and central differences in place of the exact derivatives.
#[test]
fn differences_reach_the_certified_digits() {
    for (differences, least) in [(Differences::Ridders, 9.0), (Differences::Central, 6.0)] {
        for name in ["Misra1a", "Gauss1", "Rat43", "Roszman1", "Eckerle4"] {
            let exact = one(name);
            let problem = Differenced {
                parameter_count: exact.parameter_count(),
                residual_count: exact.residual_count(),
                residuals: |p: &[f64], out: &mut [f64]| exact.residuals(p, out),
                differences,
                bounds: vec![],
            };
            let outcome = minimise(&problem, &exact.starts[1], &Options::default()).unwrap();
            let got = digits(&outcome.parameters, &exact.certified);
            assert!(got >= least, "{name} {differences:?}: {got}");
        }
    }
}

/// A problem made of closures with derivatives, for the small cases below.
struct Small<R, J> {
    n: usize,
    m: usize,
    r: R,
    j: J,
}

impl<R, J> LeastSquares for Small<R, J>
where
    R: Fn(&[f64], &mut [f64]) -> Result<(), String>,
    J: Fn(&[f64], &mut Matrix),
{
    type Error = String;

    fn parameter_count(&self) -> usize {
        self.n
    }

    fn residual_count(&self) -> usize {
        self.m
    }

    fn residuals(&self, p: &[f64], out: &mut [f64]) -> Result<(), String> {
        (self.r)(p, out)
    }

    fn jacobian(&self, p: &[f64], out: &mut Matrix) -> Result<(), String> {
        (self.j)(p, out);
        Ok(())
    }
}

/// r = A p - b with correlated columns: its unbounded minimum is (2, -1), and with p_1 >= 0.5 it is p_0 = 7/5
/// by hand: A^T A = [[5, 2], [2, 1]], A^T b = (8, 3), 5 p_0 = 8 - 2 p_1.
fn line() -> impl LeastSquares<Error = String> {
    Small {
        n: 2,
        m: 2,
        r: |p: &[f64], out: &mut [f64]| {
            out[0] = p[0] - 2.0;
            out[1] = 2.0 * p[0] + p[1] - 3.0;
            Ok(())
        },
        j: |_: &[f64], out: &mut Matrix| {
            out[(0, 0)] = 1.0;
            out[(0, 1)] = 0.0;
            out[(1, 0)] = 2.0;
            out[(1, 1)] = 1.0;
        },
    }
}

fn bounded(bounds: &[[f64; 2]]) -> Options {
    Options {
        bounds: bounds.to_vec(),
        ..Options::default()
    }
}

const OPEN: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

#[test]
fn a_minimum_on_a_bound_is_found_and_said() {
    let free = minimise(&line(), &[5.0, 5.0], &Options::default()).unwrap();
    assert!((free.parameters[0] - 2.0).abs() < 1e-14 && (free.parameters[1] + 1.0).abs() < 1e-14);
    assert_eq!(free.resting, [Resting::Free, Resting::Free]);

    for start in [[5.0, 5.0], [-30.0, 0.5], [1.4, 0.5], [1e6, 1e3]] {
        let held = minimise(&line(), &start, &bounded(&[OPEN, [0.5, f64::INFINITY]])).unwrap();
        assert!(held.reason.converged(), "{}", held.reason);
        assert!((held.parameters[0] - 1.4).abs() < 1e-14, "{held:?}");
        assert_eq!(held.parameters[1], 0.5);
        assert_eq!(held.resting, [Resting::Free, Resting::Lower]);
        // of the free one alone: 1/5; of the one at rest nothing is known
        let covariance = held.covariance_unscaled().unwrap();
        assert!((covariance[(0, 0)] - 0.2).abs() < 1e-15);
        assert!(covariance[(1, 1)].is_nan() && covariance[(0, 1)].is_nan());
    }

    let fixed = minimise(&line(), &[3.0, -2.0], &bounded(&[[3.0, 3.0], OPEN])).unwrap();
    assert!(fixed.reason.converged());
    assert_eq!(fixed.parameters[0], 3.0);
    assert!((fixed.parameters[1] + 3.0).abs() < 1e-14);
    assert_eq!(fixed.resting, [Resting::Fixed, Resting::Free]);

    // every parameter in a corner
    let corner = minimise(&line(), &[0.0, 0.0], &bounded(&[[-1.0, 1.0], [-9.0, 0.5]])).unwrap();
    assert!(corner.reason.converged(), "{}", corner.reason);
    assert_eq!(corner.parameters, [1.0, 0.5]);
    assert_eq!(corner.resting, [Resting::Upper, Resting::Upper]);
}

/// With bounds that exclude the certified value, the fit agrees with one in which that parameter is held
/// there.
#[test]
fn a_nonlinear_minimum_on_a_bound_equals_the_fit_with_that_parameter_fixed() {
    let problem = one("Rat43");
    let mut bounds = vec![OPEN; 4];
    bounds[3] = [1.4, 10.0];
    let held = minimise(&problem, &[100.0, 10.0, 1.0, 1.5], &bounded(&bounds)).unwrap();
    bounds[3] = [1.4, 1.4];
    let fixed = minimise(&problem, &[700.0, 5.0, 0.75, 1.4], &bounded(&bounds)).unwrap();
    assert_eq!(held.resting[3], Resting::Lower);
    assert!(digits(&held.parameters, &fixed.parameters) >= 10.0);
    assert!(held.cost > fit(&problem, 0).cost);

    // bounds that do not bind change nothing about the minimum
    let wide = vec![[1e-3, 1e4]; 4];
    let inside = minimise(&problem, &problem.starts[0], &bounded(&wide)).unwrap();
    assert!(digits(&inside.parameters, &problem.certified) >= 10.0);
    assert!(inside.resting.iter().all(|r| *r == Resting::Free));
}

#[test]
fn failed_evaluations_are_counted_and_survived() {
    // ln p fails at p <= 0, where the first full step leads
    let logarithm = |fails: fn(f64) -> Result<f64, String>| Small {
        n: 1,
        m: 1,
        r: move |p: &[f64], out: &mut [f64]| {
            out[0] = fails(p[0])?;
            Ok(())
        },
        j: |p: &[f64], out: &mut Matrix| out[(0, 0)] = 1.0 / p[0],
    };
    let far = Options {
        initial_radius: 100.0,
        ..Options::default()
    };
    let said: fn(f64) -> Result<f64, String> = |p| {
        if p > 0.0 {
            Ok(p.ln())
        } else {
            Err(format!("no logarithm of {p}"))
        }
    };
    let silent: fn(f64) -> Result<f64, String> = |p| Ok(p.ln());
    for (kind, words) in [(said, "no logarithm of -"), (silent, "residual 0 is NaN")] {
        let outcome = minimise(&logarithm(kind), &[10.0], &far).unwrap();
        assert!(outcome.reason.converged());
        assert!((outcome.parameters[0] - 1.0).abs() < 1e-15);
        assert!(outcome.failed_evaluations > 0);
        let failure = outcome.last_failure.unwrap();
        assert!(failure.message.starts_with(words), "{}", failure.message);
        assert!(failure.parameters[0] < 0.0);

        let never = minimise(&logarithm(kind), &[-1.0], &far).unwrap();
        assert_eq!(never.reason, StopReason::InitialPointFailed);
        assert_eq!(never.parameters, [-1.0]);
        assert_eq!(never.failed_evaluations, 1);
        assert_eq!(never.covariance_unscaled(), Err(NoCovariance::NoJacobian));
        assert!(never.scaled_singular_values().is_empty());
    }
}

/// No number that a model may give makes the solver panic or run on.
#[test]
fn strange_numbers_end_in_an_outcome() {
    let strange = [
        0.0,
        -0.0,
        1.0,
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN_POSITIVE,
        5e-324,
        1e160,
        1e-160,
        1e300,
    ];
    let quick = Options {
        iteration_limit: 50,
        ..Options::default()
    };
    let mut outcomes = 0;
    for a in strange {
        for b in strange {
            for scale in strange {
                let problem = Small {
                    n: 2,
                    m: 3,
                    r: |p: &[f64], out: &mut [f64]| {
                        out.copy_from_slice(&[scale * (p[0] - 1.0), a, b * p[1]]);
                        Ok(())
                    },
                    j: |p: &[f64], out: &mut Matrix| {
                        out.copy_from_slice(&[scale, a, b, p[0], b, a * scale]);
                    },
                };
                for options in [
                    quick.clone(),
                    Options {
                        bounds: vec![[-1e300, 1e300], [0.0, 3.0]],
                        ..quick.clone()
                    },
                ] {
                    let outcome = minimise(&problem, &[0.5, 2.0], &options).unwrap();
                    assert!(outcome.parameters.iter().all(|p| p.is_finite()));
                    let _ = outcome.covariance_scaled_by_residual_variance();
                    let _ = outcome.scaled_singular_values();
                    outcomes += 1;
                }
            }
        }
    }
    assert_eq!(outcomes, 2 * strange.len().pow(3));
}

#[test]
fn misuse_is_an_error_and_says_where() {
    let said = |start: &[f64], options: &Options| {
        minimise(&line(), start, options).unwrap_err().to_string()
    };
    let plain = Options::default();
    assert_eq!(said(&[1.0], &plain), "start: 1 values for 2 parameters");
    assert_eq!(
        said(&[1.0, f64::NAN], &plain),
        "parameter 1 starts at NaN, which is not finite"
    );
    assert_eq!(
        said(&[1.0, 2.0], &bounded(&[OPEN])),
        "bounds: 1 values for 2 parameters"
    );
    assert_eq!(
        said(&[1.0, 2.0], &bounded(&[OPEN, [3.0, 4.0]])),
        "parameter 1 starts at 2, outside its bounds 3 to 4"
    );
    for wrong in [
        [2.0, 1.0],
        [f64::NAN, 1.0],
        [0.0, f64::NAN],
        [f64::INFINITY; 2],
    ] {
        assert!(
            said(&[1.0, 2.0], &bounded(&[wrong, OPEN])).starts_with("the bounds of parameter 0")
        );
    }
    let negative = Options {
        step_tolerance: -1.0,
        ..Options::default()
    };
    assert!(said(&[1.0, 2.0], &negative).contains("step_tolerance"));
    let radius = Options {
        initial_radius: f64::NAN,
        ..Options::default()
    };
    assert!(said(&[1.0, 2.0], &radius).contains("initial_radius"));
}

#[test]
fn limit_and_stop_are_outcomes_that_keep_what_was_found() {
    let problem = one("MGH17");
    let short = Options {
        iteration_limit: 5,
        ..Options::default()
    };
    let outcome = minimise(&problem, &problem.starts[0], &short).unwrap();
    assert_eq!(outcome.reason, StopReason::IterationLimit);
    assert!(!outcome.reason.converged());
    assert_eq!(outcome.iterations, 5);
    let mut shown = vec![];
    let stopped = minimise_watched(&problem, &problem.starts[0], &Options::default(), |state| {
        shown.push(state.cost());
        if shown.len() > 30 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    })
    .unwrap();
    assert_eq!(stopped.reason, StopReason::StoppedByUser);
    assert_eq!(stopped.iterations, 30);
    assert_eq!(stopped.cost, *shown.last().unwrap());
    assert!(stopped.cost < shown[0]);
    // the search never climbs
    assert!(shown.windows(2).all(|w| w[1] <= w[0]));
}

/// Two parameters of which only the sum is seen: one direction is open, and the covariance says which,
/// instead of a number.
#[test]
fn what_the_residuals_do_not_see_is_said() {
    let sum = Small {
        n: 2,
        m: 3,
        r: |p: &[f64], out: &mut [f64]| {
            for (i, r) in out.iter_mut().enumerate() {
                *r = (p[0] + p[1]) * (i as f64 + 1.0) - 4.0 * (i as f64) - 3.0;
            }
            Ok(())
        },
        j: |_: &[f64], out: &mut Matrix| {
            for i in 0..3 {
                out[(i, 0)] = i as f64 + 1.0;
                out[(i, 1)] = i as f64 + 1.0;
            }
        },
    };
    let outcome = minimise(&sum, &[1.0, 0.0], &Options::default()).unwrap();
    assert!(outcome.reason.converged());
    // sum (i+1)(4i+3) / sum (i+1)^2 = (3 + 14 + 33) / 14
    assert!((outcome.parameters[0] + outcome.parameters[1] - 50.0 / 14.0).abs() < 1e-13);
    let values = outcome.scaled_singular_values();
    assert!((values[0] - 2f64.sqrt()).abs() < 1e-14 && values[1] < 1e-14);
    assert!(matches!(
        outcome.covariance_unscaled(),
        Err(NoCovariance::RankDeficient {
            rank: 1,
            free: 2,
            ..
        })
    ));
    // two residuals for two parameters: the unscaled covariance exists, the scaled one cannot
    let exact = minimise(&line(), &[0.0, 0.0], &Options::default()).unwrap();
    assert!(exact.covariance_unscaled().is_ok());
    assert_eq!(
        exact.covariance_scaled_by_residual_variance(),
        Err(NoCovariance::NoFreedom {
            residuals: 2,
            free: 2
        })
    );
}

/// The default first radius is no lucky number: a tenth and ten times of it solve all 54 too.
#[test]
fn the_first_radius_is_not_tuned() {
    for initial_radius in [0.1, 0.3, 3.0, 10.0] {
        let options = Options {
            initial_radius,
            ..Options::default()
        };
        for problem in all() {
            for start in &problem.starts {
                let outcome = minimise(&problem, start, &options).unwrap();
                let got = digits(&outcome.parameters, &problem.certified);
                assert!(got >= 6.0, "{} {start:?}: {got}", problem.name);
                assert!(outcome.reason.converged(), "{}", problem.name);
            }
        }
    }
}
