//! The separable fit as an argmin `Solver`, so that a long run has argmin's observers and checkpoints. One
//! `next_iter` is one call of [`advance`], which the plain [`minimise`](super::separable::minimise) runs too,
//! on a [`State`] that is written down whole: both ways, and a run taken up again from a checkpoint, give the
//! same bits.

use argmin::core::{Error, IterState, KV, Problem, Solver, TerminationReason, TerminationStatus};
use serde::{Deserialize, Serialize};

use super::separable::{Ended, Options, State, Unknown, advance};
use crate::residual::SeparableResidual;

/// argmin's state: the parameters are eta.
pub type ArgminState = IterState<Vec<f64>, (), (), (), (), f64>;

/// The solver: what a separable fit is asked, and where it stands.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct VariableProjection {
    nonlinear: Vec<Unknown>,
    linear: Vec<Unknown>,
    options: Options,
    state: Option<State>,
}

impl VariableProjection {
    /// A fit of the given unknowns; argmin's `state.param(eta)` is where it starts.
    pub fn new(nonlinear: Vec<Unknown>, linear: Vec<Unknown>, options: Options) -> Self {
        VariableProjection {
            nonlinear,
            linear,
            options,
            state: None,
        }
    }

    /// Where the fit stands; `None` before it has begun.
    pub fn state(&self) -> Option<&State> {
        self.state.as_ref()
    }

    fn tell(&self, argmin: ArgminState) -> (ArgminState, Option<KV>) {
        let Some(state) = &self.state else {
            return (argmin, None);
        };
        let told = argmin::kv!(
            "evaluations" => state.evaluations as u64;
            "failed" => state.failed as u64;
            "accepted" => state.iterations as u64;
        );
        (argmin.param(state.eta.clone()).cost(state.cost), Some(told))
    }
}

impl<P: SeparableResidual> Solver<P, ArgminState> for VariableProjection {
    fn name(&self) -> &str {
        "variable projection"
    }

    fn init(
        &mut self,
        problem: &mut Problem<P>,
        mut argmin: ArgminState,
    ) -> Result<(ArgminState, Option<KV>), Error> {
        let eta = argmin
            .take_param()
            .ok_or_else(|| Error::msg("no start: give one with `state.param(...)`"))?;
        if eta.len() != self.nonlinear.len() {
            let (found, expected) = (eta.len(), self.nonlinear.len());
            return Err(Error::msg(format!(
                "a start of {found} numbers for {expected} nonlinear unknowns"
            )));
        }
        self.state = Some(State::at(&eta, &self.nonlinear, &self.linear));
        self.next_iter(problem, argmin)
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<P>,
        argmin: ArgminState,
    ) -> Result<(ArgminState, Option<KV>), Error> {
        let inner = problem
            .problem
            .as_ref()
            .ok_or_else(|| Error::msg("the problem was taken away"))?;
        let state = self
            .state
            .as_mut()
            .ok_or_else(|| Error::msg("the fit was not begun"))?;
        advance(inner, &self.nonlinear, &self.linear, &self.options, state);
        Ok(self.tell(argmin))
    }

    fn terminate(&mut self, _: &ArgminState) -> TerminationStatus {
        match self.state.as_ref().and_then(|s| s.ended) {
            None => TerminationStatus::NotTerminated,
            Some(ended) if ended.converged() => {
                TerminationStatus::Terminated(TerminationReason::SolverConverged)
            }
            Some(Ended::Stopped) => TerminationStatus::Terminated(TerminationReason::Interrupt),
            Some(other) => {
                TerminationStatus::Terminated(TerminationReason::SolverExit(other.words().into()))
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::ops::ControlFlow;

    use argmin::core::{Executor, State as _};
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::fit::separable::minimise;
    use crate::residual::{Normal, Slope};

    /// Two decaying exponentials with linear amplitudes, sampled with a wiggle.
    pub(in crate::fit) struct Decay;

    impl SeparableResidual for Decay {
        type Error = String;
        fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, String> {
            let rows = 60;
            let x = DMatrix::from_fn(rows, 5, |i, c| {
                let t = i as f64 * 0.1;
                let wave = |k: usize| (-t / eta[k].exp()).exp();
                let slope = |k: usize| wave(k) * t / eta[k].exp();
                let recorded = 2.0 * (-t / 0.3).exp() + (-t / 2.5).exp() + 0.01 * (7.0 * t).sin();
                match c {
                    0 | 1 => wave(c),
                    2 | 3 => slope(c - 2),
                    _ => reference[0] * wave(0) + reference[1] * wave(1) - recorded,
                }
            });
            let slopes = vec![
                Slope {
                    nonlinear: 0,
                    linear: Some(0),
                },
                Slope {
                    nonlinear: 1,
                    linear: Some(1),
                },
            ];
            Ok(Normal {
                gram: x.tr_mul(&x),
                slopes,
                reference: reference.to_vec(),
                rows,
            })
        }
    }

    pub(in crate::fit) fn unknowns() -> (Vec<Unknown>, Vec<Unknown>, Vec<f64>) {
        let nonlinear = vec![
            Unknown::free(-2.0, -6.0, 4.0),
            Unknown::free(2.0, -6.0, 4.0),
        ];
        let linear = vec![Unknown::free(0.5, 0.0, 100.0); 2];
        (nonlinear, linear, vec![-2.0, 2.0])
    }

    #[test]
    fn the_adapter_gives_the_bits_of_the_plain_function_also_after_a_checkpoint() {
        let (nonlinear, linear, start) = unknowns();
        let options = Options::default();
        let plain = minimise(&Decay, &nonlinear, &linear, &start, &options, |_| {
            ControlFlow::Continue(())
        });
        assert!(
            plain.ended.is_some_and(Ended::converged),
            "{:?}",
            plain.ended
        );
        let truth = DVector::from_vec(vec![0.3f64.ln(), 2.5f64.ln()]);
        assert!(
            (DVector::from_vec(plain.eta.clone()) - truth).amax() < 0.05,
            "{:?}",
            plain.eta
        );
        let solver = || VariableProjection::new(nonlinear.clone(), linear.clone(), options);
        let whole = Executor::new(Decay, solver())
            .configure(|s| s.param(start.clone()))
            .ctrlc(false)
            .run()
            .unwrap();
        assert_eq!(whole.solver.state().unwrap().eta, plain.eta);
        assert_eq!(whole.solver.state().unwrap().beta, plain.beta);
        // stopped after three iterations, taken up again
        let saved = crate::fit::argmin_adapter::tests::Saved::default();
        let begun = Executor::new(Decay, solver())
            .configure(|s| s.param(start.clone()).max_iters(3))
            .checkpointing(saved.clone())
            .ctrlc(false)
            .run()
            .unwrap();
        assert!(begun.solver.state().unwrap().ended.is_none());
        let mut resumed = begun.solver.clone();
        while resumed.state().unwrap().ended.is_none() {
            let mut problem = Problem::new(Decay);
            let state = ArgminState::new();
            resumed.next_iter(&mut problem, state).unwrap();
        }
        assert_eq!(resumed.state().unwrap().eta, plain.eta);
        let bytes = saved.0.lock().unwrap();
        assert!(bytes.is_some(), "a checkpoint was written");
    }

    #[test]
    fn a_start_of_the_wrong_length_is_an_error() {
        let (nonlinear, linear, _) = unknowns();
        let solver = VariableProjection::new(nonlinear, linear, Options::default());
        let error = Executor::new(Decay, solver)
            .configure(|s| s.param(vec![0.0; 3]))
            .ctrlc(false)
            .run()
            .err()
            .unwrap();
        assert!(error.to_string().contains("3 numbers for 2"), "{error}");
    }
}
