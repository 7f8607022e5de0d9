//! The Levenberg-Marquardt iteration as an argmin `Solver`, and argmin's Nelder-Mead for costs without
//! derivatives.
//!
//! Long runs want what argmin's `Executor` gives: observers that see every iteration, checkpoints on disk,
//! timeouts. One call of `next_iter` is one call of [`advance`], the code that
//! [`minimise`](super::levenberg_marquardt::minimise) runs too, on a [`State`] that is written down whole, so
//! that both ways, and a run taken up again from a checkpoint, give the same bits.
//!
//! ```
//! use argmin::core::{Executor, State as _};
//! use deacal::fit::argmin_adapter::{LevenbergMarquardt, Stoppable};
//! use deacal::fit::levenberg_marquardt::{Differenced, Differences, Options};
//!
//! let problem = Differenced {
//!     parameter_count: 2,
//!     residual_count: 2,
//!     residuals: |p: &[f64], out: &mut [f64]| -> Result<(), String> {
//!         out[0] = 10.0 * (p[1] - p[0] * p[0]);
//!         out[1] = 1.0 - p[0];
//!         Ok(())
//!     },
//!     differences: Differences::Ridders,
//!     bounds: vec![],
//! };
//! let problem = Stoppable::new(&problem);
//! let stop = problem.stop_flag(); // for a signal handler
//! let result = Executor::new(problem, LevenbergMarquardt::new(Options::default()))
//!     .configure(|state| state.param(vec![-1.2, 1.0]))
//!     .ctrlc(false)
//!     .run()
//!     .unwrap();
//! let outcome = result.solver.outcome(result.problem.problem.as_ref().unwrap()).unwrap();
//! assert!(outcome.reason.converged());
//! assert!((outcome.parameters[0] - 1.0).abs() < 1e-9);
//! # drop(stop);
//! ```
//!
//! argmin keeps the parameters of the lowest cost; the polish may place them better at a cost that is equal
//! but for rounding. Take the result from [`LevenbergMarquardt::outcome`].

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use argmin::core::{
    CostFunction, Error, Executor, IterState, KV, Problem, Solver, State as _, TerminationReason,
    TerminationStatus,
};
use argmin::solver::neldermead::NelderMead;
use serde::{Deserialize, Serialize};

use super::levenberg_marquardt::{
    LeastSquares, Misuse, Options, Outcome, State, StopReason, Workspace, advance, begin, finish,
};

/// A problem with a flag that stops the run after the iteration at hand. The flag is no part of a checkpoint.
#[derive(Clone)]
pub struct Stoppable<P> {
    /// The problem.
    pub problem: P,
    stop: Arc<AtomicBool>,
}

impl<P: LeastSquares> Stoppable<P> {
    /// A problem whose flag is down.
    pub fn new(problem: P) -> Self {
        Stoppable {
            problem,
            stop: Arc::new(AtomicBool::new(false)),
        }
    }

    /// The flag: storing `true` from any thread, an observer or a signal handler stops the run.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }
}

/// The iteration state that argmin carries beside ours: parameters and cost.
pub type ArgminState = IterState<Vec<f64>, (), (), (), (), f64>;

/// Levenberg-Marquardt for argmin's `Executor`. All that it holds is written into checkpoints, except the
/// memory of size m n.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LevenbergMarquardt {
    options: Options,
    state: Option<State>,
    #[serde(skip)]
    workspace: Workspace,
    #[serde(skip)]
    interrupted: bool,
}

impl LevenbergMarquardt {
    /// A solver that has not begun. The options are checked when it begins.
    pub fn new(options: Options) -> Self {
        LevenbergMarquardt {
            options,
            state: None,
            workspace: Workspace::default(),
            interrupted: false,
        }
    }

    /// Where the search stands; `None` before it begins.
    pub fn state(&self) -> Option<&State> {
        self.state.as_ref()
    }

    /// What the run gave; `None` if it never began. A run that argmin cut short (its own limit, a timeout,
    /// the flag) counts as [`StopReason::StoppedByUser`].
    pub fn outcome<P: LeastSquares>(&self, problem: &Stoppable<P>) -> Option<Outcome> {
        (self.state.as_ref()).map(|state| finish(&problem.problem, state))
    }
}

/// What an observer is told besides parameters and cost.
fn described(state: &State) -> KV {
    argmin::kv!(
        "gradient_norm" => state.gradient_norm();
        "relative_offset" => state.relative_offset();
        "damping" => state.damping();
        "radius" => state.radius();
        "evaluations" => state.evaluations() as u64;
        "failed_evaluations" => state.failed_evaluations() as u64;
    )
}

fn borrowed<P>(problem: &Problem<Stoppable<P>>) -> Result<&Stoppable<P>, Error> {
    (problem.problem.as_ref()).ok_or_else(|| Error::msg("the executor has lost its problem"))
}

fn carried(state: &State, argmin: ArgminState) -> ArgminState {
    argmin.param(state.parameters().to_vec()).cost(state.cost())
}

impl<P: LeastSquares> Solver<Stoppable<P>, ArgminState> for LevenbergMarquardt {
    fn name(&self) -> &str {
        "Levenberg-Marquardt"
    }

    fn init(
        &mut self,
        problem: &mut Problem<Stoppable<P>>,
        mut argmin: ArgminState,
    ) -> Result<(ArgminState, Option<KV>), Error> {
        let start = (argmin.take_param())
            .ok_or_else(|| Error::msg("no start: give one with `state.param(...)`"))?;
        let inner = &borrowed(problem)?.problem;
        let state = begin(inner, &start, &self.options, &mut self.workspace)?;
        let told = described(&state);
        let argmin = carried(&state, argmin);
        self.state = Some(state);
        Ok((argmin, Some(told)))
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<Stoppable<P>>,
        argmin: ArgminState,
    ) -> Result<(ArgminState, Option<KV>), Error> {
        let stoppable = borrowed(problem)?;
        let state = (self.state.as_mut())
            .ok_or_else(|| Error::msg("the solver was not begun; was the checkpoint cut off?"))?;
        let expected = stoppable.problem.parameter_count();
        if !state.fits(expected, &self.options) {
            let found = state.parameters().len();
            return Err(Misuse::OtherProblem { expected, found }.into());
        }
        advance(
            &stoppable.problem,
            &self.options,
            state,
            &mut self.workspace,
        );
        // not a termination of the state: a checkpoint of it is to go on from here
        self.interrupted = stoppable.stop.load(Ordering::SeqCst);
        let counts = [
            ("residuals_count", state.evaluations()),
            ("jacobian_count", state.jacobian_evaluations()),
            ("failed_count", state.failed_evaluations()),
        ];
        for (name, count) in counts {
            problem.counts.insert(name, count as u64);
        }
        let told = described(state);
        Ok((carried(state, argmin), Some(told)))
    }

    fn terminate(&mut self, _argmin: &ArgminState) -> TerminationStatus {
        let reason = match self.state.as_ref().and_then(State::stop) {
            Some(reason) if reason.converged() => TerminationReason::SolverConverged,
            Some(StopReason::IterationLimit) => TerminationReason::MaxItersReached,
            Some(StopReason::StoppedByUser) => TerminationReason::Interrupt,
            Some(other) => TerminationReason::SolverExit(other.words().to_string()),
            None if self.interrupted => TerminationReason::Interrupt,
            None => return TerminationStatus::NotTerminated,
        };
        TerminationStatus::Terminated(reason)
    }
}

/// What [`nelder_mead`] found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Found {
    /// The best parameters, n, within the bounds.
    pub parameters: Vec<f64>,
    /// Their cost; infinite if no evaluation succeeded.
    pub cost: f64,
    /// Iterations of the simplex.
    pub iterations: u64,
    /// Whether the simplex shrank to nothing before the iterations ran out.
    pub converged: bool,
    /// Evaluations that failed or were not finite.
    pub failed_evaluations: usize,
}

/// The cost at the nearest point of the box; a failure costs infinity.
struct Boxed<'a, F> {
    cost: F,
    bounds: &'a [[f64; 2]],
    failed: std::cell::Cell<usize>,
}

fn into_box(p: &[f64], bounds: &[[f64; 2]]) -> Vec<f64> {
    (p.iter().zip(bounds))
        .map(|(v, [lower, upper])| v.max(*lower).min(*upper))
        .collect()
}

impl<E, F: Fn(&[f64]) -> Result<f64, E>> CostFunction for Boxed<'_, F> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, p: &Vec<f64>) -> Result<f64, Error> {
        match (self.cost)(&into_box(p, self.bounds)) {
            Ok(cost) if cost.is_finite() => Ok(cost),
            _ => {
                self.failed.set(self.failed.get() + 1);
                Ok(f64::INFINITY)
            }
        }
    }
}

/// Lowers a cost that has no derivatives, within finite or open `bounds` (one `[lower, upper]` a parameter),
/// by the downhill simplex (Nelder, Mead 1965) of argmin. The first simplex is `start` and n points, each
/// moved by `size[j]` along one parameter, away from the nearer bound. `watch` sees every iteration number;
/// `Break` stops. A search or a polish, not a proof: it may stop short of a minimum.
///
/// # Errors
///
/// [`Misuse`], when the lists differ in length, the start is not within its bounds, or a size is 0 or not
/// finite.
pub fn nelder_mead<E>(
    cost: impl Fn(&[f64]) -> Result<f64, E>,
    start: &[f64],
    size: &[f64],
    bounds: &[[f64; 2]],
    iteration_limit: u64,
    watch: impl FnMut(u64) -> ControlFlow<()> + Send + 'static,
) -> Result<Found, Misuse> {
    let n = start.len();
    let options = Options {
        bounds: bounds.to_vec(),
        ..Options::default()
    };
    super::levenberg_marquardt::check(n, 1, start, &options)?;
    if size.len() != n {
        return Err(Misuse::Length {
            what: "size",
            expected: n,
            found: size.len(),
        });
    }
    if let Some(&value) = size.iter().find(|s| !(s.is_finite() && **s != 0.0)) {
        return Err(Misuse::OptionRange {
            name: "size",
            value,
            must: "finite and not 0",
        });
    }
    let open = vec![[f64::NEG_INFINITY, f64::INFINITY]; n];
    let bounds = if bounds.is_empty() { &open } else { bounds };
    let mut simplex = vec![start.to_vec()];
    for j in 0..n {
        let mut corner = start.to_vec();
        let [lower, upper] = bounds[j];
        let step = size[j].abs();
        corner[j] += if upper - start[j] >= start[j] - lower {
            step
        } else {
            -step
        };
        simplex.push(corner);
    }
    let stop = Arc::new(AtomicBool::new(false));
    let solver = Watched {
        simplex: NelderMead::new(simplex),
        stop: Arc::clone(&stop),
    };
    let boxed = Boxed {
        cost,
        bounds,
        failed: std::cell::Cell::new(0),
    };
    let result = Executor::new(boxed, solver)
        .configure(|state| state.max_iters(iteration_limit))
        .add_observer(
            Teller { watch, stop },
            argmin::core::observers::ObserverMode::Always,
        )
        .ctrlc(false)
        .timer(false)
        .run();
    // the cost never errs and the simplex has its n + 1 points
    let Ok(result) = result else {
        return Ok(Found {
            parameters: start.to_vec(),
            cost: f64::INFINITY,
            iterations: 0,
            converged: false,
            failed_evaluations: 0,
        });
    };
    let best = result.state.get_best_param().map_or(start, Vec::as_slice);
    Ok(Found {
        parameters: into_box(best, bounds),
        cost: result.state.get_best_cost(),
        iterations: result.state.get_iter(),
        converged: result.state.get_termination_reason()
            == Some(&TerminationReason::SolverConverged),
        failed_evaluations: (result.problem.problem.as_ref()).map_or(0, |p| p.failed.get()),
    })
}

/// The simplex, and the flag that ends it.
struct Watched {
    simplex: NelderMead<Vec<f64>, f64>,
    stop: Arc<AtomicBool>,
}

impl<O: CostFunction<Param = Vec<f64>, Output = f64>> Solver<O, ArgminState> for Watched {
    fn name(&self) -> &str {
        "Nelder-Mead"
    }

    fn init(
        &mut self,
        problem: &mut Problem<O>,
        state: ArgminState,
    ) -> Result<(ArgminState, Option<KV>), Error> {
        self.simplex.init(problem, state)
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<O>,
        state: ArgminState,
    ) -> Result<(ArgminState, Option<KV>), Error> {
        self.simplex.next_iter(problem, state)
    }

    fn terminate(&mut self, state: &ArgminState) -> TerminationStatus {
        if self.stop.load(Ordering::SeqCst) {
            return TerminationStatus::Terminated(TerminationReason::Interrupt);
        }
        Solver::<O, ArgminState>::terminate(&mut self.simplex, state)
    }
}

/// Passes the iteration number on, and the wish to stop back.
struct Teller<W> {
    watch: W,
    stop: Arc<AtomicBool>,
}

impl<W: FnMut(u64) -> ControlFlow<()>> argmin::core::observers::Observe<ArgminState> for Teller<W> {
    fn observe_iter(&mut self, state: &ArgminState, _kv: &KV) -> Result<(), Error> {
        if (self.watch)(state.get_iter()).is_break() {
            self.stop.store(true, Ordering::SeqCst);
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::fit::levenberg_marquardt::{Differenced, Differences, minimise};
    use argmin::core::checkpointing::{Checkpoint, CheckpointingFrequency};
    use argmin::core::observers::{Observe, ObserverMode};
    use std::sync::Mutex;

    type Residuals = fn(&[f64], &mut [f64]) -> Result<(), String>;

    /// An exponential through points that are not quite one.
    fn decay() -> Differenced<Residuals> {
        Differenced {
            parameter_count: 3,
            residual_count: 12,
            residuals: |p, out| {
                for (i, r) in out.iter_mut().enumerate() {
                    let t = i as f64;
                    let recorded = 3.0 * (-0.4 * t).exp() + 0.5 + 0.05 * (3.0 * t).sin();
                    *r = p[0] * (-p[1] * t).exp() + p[2] - recorded;
                }
                Ok(())
            },
            differences: Differences::Ridders,
            bounds: vec![],
        }
    }

    const START: [f64; 3] = [10.0, 3.0, -4.0];

    fn bits(outcome: &Outcome) -> Vec<u64> {
        (outcome.parameters.iter().chain([&outcome.cost]))
            .map(|v| v.to_bits())
            .collect()
    }

    /// A checkpoint of every iteration, in bytes as on a disk.
    #[derive(Clone, Default)]
    pub(in super::super) struct Saved(pub Arc<Mutex<Option<Vec<u8>>>>);

    impl<S, I> Checkpoint<S, I> for Saved
    where
        S: Serialize + serde::de::DeserializeOwned,
        I: Serialize + serde::de::DeserializeOwned,
    {
        fn save(&self, solver: &S, state: &I) -> Result<(), Error> {
            *self.0.lock().unwrap() = Some(postcard::to_allocvec(&(solver, state))?);
            Ok(())
        }

        fn load(&self) -> Result<Option<(S, I)>, Error> {
            let bytes = self.0.lock().unwrap();
            Ok(bytes.as_deref().map(postcard::from_bytes).transpose()?)
        }

        fn frequency(&self) -> CheckpointingFrequency {
            CheckpointingFrequency::Always
        }
    }

    #[derive(Clone, Default)]
    struct Seen(Arc<Mutex<Vec<(u64, f64)>>>, Option<(u64, Arc<AtomicBool>)>);

    impl Observe<ArgminState> for Seen {
        fn observe_iter(&mut self, state: &ArgminState, kv: &KV) -> Result<(), Error> {
            assert!(kv.get("radius").is_some());
            self.0
                .lock()
                .unwrap()
                .push((state.get_iter(), state.get_cost()));
            if let Some((last, flag)) = &self.1
                && state.get_iter() == *last
            {
                flag.store(true, Ordering::SeqCst);
            }
            Ok(())
        }
    }

    #[test]
    fn executor_and_plain_function_give_the_same_bits_and_an_observer_sees_each_iteration() {
        let problem = decay();
        let plain = minimise(&problem, &START, &Options::default()).unwrap();
        assert!(plain.reason.converged(), "{}", plain.reason);
        let seen = Seen::default();
        let solver = LevenbergMarquardt::new(Options::default());
        let result = Executor::new(Stoppable::new(problem), solver)
            .configure(|s| s.param(START.to_vec()))
            .add_observer(seen.clone(), ObserverMode::Always)
            .ctrlc(false)
            .run()
            .unwrap();
        let outcome = (result.solver)
            .outcome(result.problem.problem.as_ref().unwrap())
            .unwrap();
        assert_eq!(outcome, plain);
        assert_eq!(
            result.state.get_termination_reason(),
            Some(&TerminationReason::SolverConverged)
        );
        let seen = seen.0.lock().unwrap();
        let expected: Vec<u64> = (0..result.state.get_iter()).collect();
        assert_eq!(seen.iter().map(|s| s.0).collect::<Vec<_>>(), expected);
        assert!(seen.len() >= plain.iterations);
        assert_eq!(seen.last().unwrap().1.to_bits(), plain.cost.to_bits());
    }

    #[test]
    fn a_run_stopped_by_the_flag_and_taken_up_from_its_checkpoint_gives_the_same_bits() {
        let plain = minimise(&decay(), &START, &Options::default()).unwrap();
        let saved = Saved::default();
        let checkpoint = || saved.clone();

        let problem = Stoppable::new(decay());
        let seen = Seen(Arc::default(), Some((3, problem.stop_flag())));
        let first = Executor::new(problem, LevenbergMarquardt::new(Options::default()))
            .configure(|s| s.param(START.to_vec()))
            .add_observer(seen.clone(), ObserverMode::Always)
            .checkpointing(checkpoint())
            .ctrlc(false)
            .run()
            .unwrap();
        assert_eq!(
            first.state.get_termination_reason(),
            Some(&TerminationReason::Interrupt)
        );
        let stopped = (first.solver)
            .outcome(first.problem.problem.as_ref().unwrap())
            .unwrap();
        assert_eq!(stopped.reason, StopReason::StoppedByUser);
        // the flag went up while iteration 3 was shown, so iteration 4 is the last
        assert_eq!(seen.0.lock().unwrap().len(), 5);

        let second = Executor::new(
            Stoppable::new(decay()),
            LevenbergMarquardt::new(Options::default()),
        )
        .checkpointing(checkpoint())
        .ctrlc(false)
        .run()
        .unwrap();
        let resumed = (second.solver)
            .outcome(second.problem.problem.as_ref().unwrap())
            .unwrap();
        assert_eq!(bits(&resumed), bits(&plain));
        assert_eq!(resumed, plain);

        // and a finished run stays finished
        let third = Executor::new(
            Stoppable::new(decay()),
            LevenbergMarquardt::new(Options::default()),
        )
        .checkpointing(checkpoint())
        .ctrlc(false)
        .run()
        .unwrap();
        assert_eq!(third.state.get_iter(), second.state.get_iter());
    }

    #[test]
    fn misuse_and_a_failing_start_are_told_apart() {
        let solver = || LevenbergMarquardt::new(Options::default());
        let wrong = Executor::new(Stoppable::new(decay()), solver())
            .configure(|s| s.param(vec![1.0]))
            .ctrlc(false)
            .run();
        let error = wrong.err().unwrap();
        assert!(matches!(
            error.downcast_ref::<Misuse>(),
            Some(Misuse::Length {
                expected: 3,
                found: 1,
                ..
            })
        ));
        assert!(
            Executor::new(Stoppable::new(decay()), solver())
                .ctrlc(false)
                .run()
                .is_err()
        );
        let mut failing = decay();
        failing.residuals = |_, _| Err("the arm cannot reach".to_string());
        let result = Executor::new(Stoppable::new(failing), solver())
            .configure(|s| s.param(START.to_vec()))
            .ctrlc(false)
            .run()
            .unwrap();
        let outcome = (result.solver)
            .outcome(result.problem.problem.as_ref().unwrap())
            .unwrap();
        assert_eq!(outcome.reason, StopReason::InitialPointFailed);
        assert_eq!(
            outcome.last_failure.unwrap().message,
            "the arm cannot reach"
        );
    }

    #[test]
    fn nelder_mead_finds_minima_inside_and_on_the_bounds() {
        let bowl = |p: &[f64]| -> Result<f64, String> {
            if p[0] > 5.0 {
                return Err("too far".to_string());
            }
            Ok((p[0] - 1.0).powi(2) + 3.0 * (p[1] + 2.0).powi(2))
        };
        let go = |_| ControlFlow::Continue(());
        let free = nelder_mead(bowl, &[4.5, 3.0], &[1.0, 1.0], &[], 500, go).unwrap();
        assert!(free.converged);
        assert!((free.parameters[0] - 1.0).abs() < 1e-6, "{free:?}");
        assert!((free.parameters[1] + 2.0).abs() < 1e-6, "{free:?}");
        assert!(free.failed_evaluations > 0);
        let bounds = [[-10.0, 10.0], [-1.0, 4.0]];
        let held = nelder_mead(bowl, &[4.0, 3.0], &[1.0, 1.0], &bounds, 500, go).unwrap();
        assert!((held.parameters[0] - 1.0).abs() < 1e-6, "{held:?}");
        assert_eq!(held.parameters[1], -1.0);
        let stop = |i| {
            if i >= 4 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let cut = nelder_mead(bowl, &[4.0, 3.0], &[1.0, 1.0], &[], 500, stop).unwrap();
        assert!(!cut.converged && cut.iterations == 5, "{cut:?}");
        assert!(nelder_mead(bowl, &[4.0, 9.0], &[1.0, 1.0], &bounds, 500, go).is_err());
        assert!(nelder_mead(bowl, &[4.0, 3.0], &[1.0, 0.0], &bounds, 500, go).is_err());
    }
}
