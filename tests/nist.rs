//! The NIST yardstick: 27 problems of the Statistical Reference Datasets, each from its two starting points, and rivals, bounds, failures.
//!
//! The models are those of the file headers, written once over dual numbers, so that the derivatives are exact.
//! See `datasets/nist1997_strd/README.md` for the data and the score.

use std::convert::Infallible;
use std::fs;
use std::path::{Path, PathBuf};

use deacal::fit::levenberg_marquardt::{
    Differenced, Differences, LeastSquares, Matrix, Options, Outcome, minimise,
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
