//! What searches have found so far, kept so that a run that was stopped can be taken up again.
//!
//! A search is a function of its residual, its unknowns, its start and its options, and its state is plain
//! data. Its key is the SHA-256 of all of that: for the residual stands the state after the first evaluation,
//! which holds the Gram matrix, and so every weight and every sample, and a tag that says what the columns
//! are of. So nobody has to number searches, whatever order threads take them in, and a search that begins
//! differently finds nothing. Taken up again it goes the same steps, to the bit.

use std::fmt;
use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ring::digest::{SHA256, digest};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::levenberg_marquardt as lm;
use super::separable::{Ended, Options, State, Unknown, advance};
use crate::residual::SeparableResidual;

/// Where bytes are kept by name: the last ones under a name count.
pub trait Keep: Send + Sync {
    /// What is kept under a name.
    fn get(&self, name: &str) -> Option<Vec<u8>>;
    /// Keeps bytes, with words for a reader of what they are of. Failing to is no failure of the search.
    fn put(&self, name: &str, says: String, bytes: Vec<u8>);
}

/// A search writes down where it stands after so much work.
const EVERY: Duration = Duration::from_secs(1);
/// Less work than this share of that is not worth writing down at its end.
const WORTH: u32 = 20;

/// Ends a run before its time, from another thread. A copy asks for the same run; by default nobody does.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

/// What a run that was asked to stop unwinds with, through whatever it was at, so that no room has to carry
/// an end that is neither a result nor an error: whoever asks catches it (`std::panic::catch_unwind`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stopped;

impl Stop {
    /// Asks the run to stop; it does at its next step or evaluation.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Unwinds with [`Stopped`] if the run was asked to stop. No message is printed.
    pub fn check(&self) {
        if self.0.load(Ordering::Relaxed) {
            resume_unwind(Box::new(Stopped));
        }
    }
}

/// The memory of a run, and what may stop it; by default it has none. It changes no result.
#[derive(Clone, Default)]
pub struct Memory {
    keep: Option<Arc<dyn Keep>>,
    every: Duration,
    stop: Stop,
}

impl fmt::Debug for Memory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kept = self.keep.is_some();
        f.write_str(if kept { "kept" } else { "none" })
    }
}

/// Two memories are alike: what is kept is no part of what is asked.
impl PartialEq for Memory {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// A piece under work: its name, and when it was last written down.
struct Piece<'a> {
    keep: &'a dyn Keep,
    name: String,
    since: Instant,
}

impl<'a> Piece<'a> {
    fn new(keep: &'a dyn Keep, key: &impl Serialize) -> Option<Self> {
        let bytes = postcard::to_allocvec(key).ok()?;
        let sum = digest(&SHA256, &bytes);
        Some(Piece {
            keep,
            name: sum.as_ref().iter().map(|b| format!("{b:02x}")).collect(),
            since: Instant::now(),
        })
    }

    fn get<T: DeserializeOwned>(&self) -> Option<T> {
        postcard::from_bytes(&self.keep.get(&self.name)?).ok()
    }

    /// Writes down where the work stands, if it is worth it.
    fn put(&mut self, after: Duration, says: impl FnOnce() -> String, piece: &impl Serialize) {
        if self.since.elapsed() < after {
            return;
        }
        if let Ok(bytes) = postcard::to_allocvec(piece) {
            self.keep.put(&self.name, says(), bytes);
        }
        self.since = Instant::now();
    }
}

impl Memory {
    /// A memory that keeps in `keep`.
    pub fn new(keep: Arc<dyn Keep>) -> Self {
        Memory {
            keep: Some(keep),
            every: EVERY,
            stop: Stop::default(),
        }
    }

    /// The same of a run that may be asked to stop: its searches look before each evaluation.
    #[must_use]
    pub fn until(self, stop: Stop) -> Self {
        Memory { stop, ..self }
    }

    /// [`super::separable::minimise`], from where it stood when it was stopped. `tag` says what the residual
    /// is of, as far as the values at its start do not.
    #[allow(clippy::too_many_arguments)]
    pub fn minimise<P: SeparableResidual>(
        &self,
        tag: &str,
        problem: &P,
        nonlinear: &[Unknown],
        linear: &[Unknown],
        eta: &[f64],
        options: &Options,
        mut watch: impl FnMut(&State) -> ControlFlow<()>,
    ) -> State {
        let mut state = State::at(eta, nonlinear, linear);
        let mut piece: Option<Piece> = None;
        let says = |s: &State| {
            let (n, cost) = (s.evaluations, s.cost / s.rows.max(1) as f64);
            let ended = s.ended.map_or("on its way", Ended::words);
            format!("{tag}: {n} evaluations, cost {cost:.4}, {ended}")
        };
        while state.ended.is_none() {
            self.stop.check();
            advance(problem, nonlinear, linear, options, &mut state);
            if let (Some(keep), None, 1) = (&self.keep, state.ended, state.evaluations) {
                piece = Piece::new(keep.as_ref(), &(tag, nonlinear, linear, options, &state));
                state = piece.as_ref().and_then(Piece::get).unwrap_or(state);
            }
            if state.ended.is_none() && watch(&state).is_break() {
                state.ended = Some(Ended::Stopped);
                return state;
            }
            if let (Some(piece), None) = (&mut piece, state.ended) {
                piece.put(self.every, || says(&state), &state);
            }
        }
        if let Some(piece) = &mut piece {
            piece.put(self.every / WORTH, || says(&state), &state);
        }
        state
    }

    /// [`lm::minimise_watched`], from where it stood. `tag` says what the residual is of, as far as the
    /// values at its start do not.
    ///
    /// # Errors
    /// [`lm::Misuse`], when the call cannot be meant.
    pub fn least_squares<P: lm::LeastSquares + ?Sized>(
        &self,
        tag: &str,
        problem: &P,
        start: &[f64],
        options: &lm::Options,
        mut watch: impl FnMut(&lm::State) -> ControlFlow<()>,
    ) -> Result<lm::Outcome, lm::Misuse> {
        let mut watch = |state: &lm::State| {
            self.stop.check();
            watch(state)
        };
        let Some(keep) = &self.keep else {
            return lm::minimise_watched(problem, start, options, watch);
        };
        let mut workspace = lm::Workspace::default();
        let mut state = lm::begin(problem, start, options, &mut workspace)?;
        let mut piece = Piece::new(keep.as_ref(), &(tag, options, &state));
        state = piece.as_ref().and_then(Piece::get).unwrap_or(state);
        let says = |s: &lm::State| format!("{tag}: cost {:.6e}", s.cost());
        while state.stop().is_none() && watch(&state).is_continue() {
            lm::advance(problem, options, &mut state, &mut workspace);
            if let Some(piece) = &mut piece {
                let over = state.stop().is_some();
                let share = if over { WORTH } else { 1 };
                piece.put(self.every / share, || says(&state), &state);
            }
        }
        Ok(lm::finish(problem, &state))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::sync::Mutex;
    use std::sync::atomic::AtomicUsize;

    use super::*;
    use crate::fit::separable::minimise;
    use crate::fit::separable_adapter::tests::{Decay, unknowns};
    use crate::residual::Normal;

    #[derive(Default)]
    struct InMind(Mutex<HashMap<String, Vec<u8>>>);

    impl Keep for InMind {
        fn get(&self, name: &str) -> Option<Vec<u8>> {
            self.0.lock().unwrap().get(name).cloned()
        }
        fn put(&self, name: &str, _: String, bytes: Vec<u8>) {
            self.0.lock().unwrap().insert(name.to_owned(), bytes);
        }
    }

    /// Counts what it is asked.
    struct Counted(AtomicUsize);

    impl SeparableResidual for Counted {
        type Error = String;
        fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, String> {
            self.0.fetch_add(1, Ordering::Relaxed);
            Decay.evaluate(eta, reference)
        }
    }

    impl lm::LeastSquares for Counted {
        type Error = String;
        fn parameter_count(&self) -> usize {
            2
        }
        fn residual_count(&self) -> usize {
            2
        }
        fn residuals(&self, p: &[f64], out: &mut [f64]) -> Result<(), String> {
            self.0.fetch_add(1, Ordering::Relaxed);
            out[0] = 10.0 * (p[1] - p[0] * p[0]);
            out[1] = 1.0 - p[0];
            Ok(())
        }
        fn jacobian(&self, p: &[f64], out: &mut lm::Matrix) -> Result<(), String> {
            out[(0, 0)] = -20.0 * p[0];
            out[(0, 1)] = 10.0;
            out[(1, 0)] = -1.0;
            out[(1, 1)] = 0.0;
            Ok(())
        }
    }

    fn bits<T: Serialize>(state: &T) -> Vec<u8> {
        postcard::to_allocvec(state).unwrap()
    }

    fn always() -> Memory {
        Memory {
            keep: Some(Arc::new(InMind::default())),
            every: Duration::ZERO,
            ..Memory::default()
        }
    }

    #[test]
    fn a_stopped_search_goes_on_to_the_same_bits_with_one_evaluation_more() {
        let (nonlinear, linear, start) = unknowns();
        let options = Options::default();
        let search = |memory: &Memory, tag: &str, until: usize| {
            let counted = Counted(AtomicUsize::new(0));
            let watch = |s: &State| match s.evaluations {
                n if n >= until => ControlFlow::Break(()),
                _ => ControlFlow::Continue(()),
            };
            let state =
                memory.minimise(tag, &counted, &nonlinear, &linear, &start, &options, watch);
            (state, counted.0.into_inner())
        };
        let plain = minimise(&Decay, &nonlinear, &linear, &start, &options, |_| {
            ControlFlow::Continue(())
        });
        let all = plain.evaluations;
        assert!(all > 4, "{all}");
        let memory = always();
        search(&memory, "", 4);
        // what was stopped at 4 was written down at 3; the first evaluation is the key
        let (state, spent) = search(&memory, "", usize::MAX);
        assert_eq!((bits(&state), spent), (bits(&plain), 1 + all - 3));
        let (state, spent) = search(&memory, "", usize::MAX);
        assert_eq!((bits(&state), spent), (bits(&plain), 1));
        // another tag, and no memory: from the beginning
        let (state, spent) = search(&memory, "other", usize::MAX);
        assert_eq!((bits(&state), spent), (bits(&plain), all));
        let (state, spent) = search(&Memory::default(), "", usize::MAX);
        assert_eq!((bits(&state), spent), (bits(&plain), all));
    }

    #[test]
    fn a_run_that_is_asked_to_stop_evaluates_nothing_more() {
        let (nonlinear, linear, start) = unknowns();
        let counted = Counted(AtomicUsize::new(0));
        let stop = Stop::default();
        let memory = Memory::default().until(stop.clone());
        let search = || {
            let watch = |s: &State| {
                if s.evaluations == 3 {
                    stop.ask();
                }
                ControlFlow::Continue(())
            };
            let options = Options::default();
            memory.minimise("", &counted, &nonlinear, &linear, &start, &options, watch)
        };
        let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(search));
        assert!(ended.unwrap_err().is::<Stopped>());
        assert_eq!(counted.0.load(Ordering::Relaxed), 3);
    }

    #[test]
    fn a_stopped_least_squares_search_goes_on_to_the_same_bits() {
        let options = lm::Options::default();
        let search = |memory: &Memory, until: usize| {
            let counted = Counted(AtomicUsize::new(0));
            let mut seen = 0;
            let watch = |_: &lm::State| {
                seen += 1;
                match seen > until {
                    true => ControlFlow::Break(()),
                    false => ControlFlow::Continue(()),
                }
            };
            let ended = memory
                .least_squares("", &counted, &[-1.2, 1.0], &options, watch)
                .unwrap();
            (ended.parameters, ended.iterations, counted.0.into_inner())
        };
        let whole = search(&Memory::default(), usize::MAX);
        let memory = always();
        search(&memory, 7);
        let resumed = search(&memory, usize::MAX);
        assert_eq!((&resumed.0, resumed.1), (&whole.0, whole.1));
        assert!(resumed.2 < whole.2, "{} of {}", resumed.2, whole.2);
        assert!(search(&memory, usize::MAX).2 < resumed.2);
    }
}
