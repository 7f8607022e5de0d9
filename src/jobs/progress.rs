//! How far a job is, for whoever looks: told by the job, read from another thread.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::diagnosis::Tally;
use crate::fit::memory::Stop;
use crate::fit::separable::State;

/// Searches of a fit after its starts: with weights set to the noise.
const LAST: usize = 2;
/// Time left is told after so much time, and so much of the work.
const TELLS: (Duration, f64) = (Duration::from_secs(1), 0.01);

/// How far a step is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Done {
    /// Nothing is under way.
    Untold,
    /// This share, of which `before` was there when it began.
    Share { now: f64, before: f64 },
    /// As far as the large file that is being read.
    File,
    /// As far as the tally says.
    Tally,
}

/// What is being done.
#[derive(Debug)]
struct Step {
    text: String,
    done: Done,
    tally: Tally,
    since: Instant,
}

impl Step {
    /// Share that is done, share that was when it began, and how long the rest took; where it can be told.
    fn told(&self) -> Option<(f64, f64, Duration)> {
        match self.done {
            Done::Untold => None,
            Done::Share { now, before } => Some((now, before, self.since.elapsed())),
            Done::Tally => self
                .tally
                .share()
                .filter(|now| *now < 1.0) // the step goes on beyond what is counted
                .map(|now| (now, 0.0, self.since.elapsed())),
            Done::File => crate::recording::share_read().map(|(now, took)| (now, 0.0, took)),
        }
    }
}

/// `, 40 % done, 12 s left`: where `before` of the work was there already, and the rest of it took `elapsed`.
fn told(now: f64, before: f64, elapsed: Duration) -> String {
    let mut out = format!(", {:.0} % done", 100.0 * now);
    let made = now - before;
    if elapsed >= TELLS.0 && made >= TELLS.1 && now < 1.0 {
        let left = elapsed.as_secs_f64() * (1.0 - now) / made;
        out += &match left {
            s if s < 100.0 => format!(", {:.0} s left", s.max(1.0)),
            s if s < 6000.0 => format!(", {:.0} min left", s / 60.0),
            s => format!(", {:.0} h left", s / 3600.0),
        };
    }
    out
}

/// What is going on.
#[derive(Debug)]
pub struct Progress {
    /// Evaluations and searches of the fit under way, and how many of these there will be.
    fit: [AtomicUsize; 3],
    /// Whether the job is one of many, whose own steps are not told.
    of_many: AtomicBool,
    step: Mutex<Step>,
    stop: Stop,
}

impl Default for Progress {
    fn default() -> Self {
        Progress {
            fit: Default::default(),
            of_many: AtomicBool::new(false),
            step: Mutex::new(Step {
                text: String::new(),
                done: Done::Untold,
                tally: Tally::default(),
                since: Instant::now(),
            }),
            stop: Stop::default(),
        }
    }
}

impl Progress {
    fn now(&self) -> MutexGuard<'_, Step> {
        self.step.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, text: String, done: Done) {
        self.stop.check();
        if self.of_many.load(Ordering::Relaxed) {
            return;
        }
        let mut step = self.now();
        step.tally.begin();
        (step.text, step.done, step.since) = (text, done, Instant::now());
    }

    /// In one line: what is being done, the share that is done, the time left. Empty before the first step.
    #[must_use]
    pub fn line(&self) -> String {
        let step = self.now();
        let far = step.told();
        step.text.clone() + &far.map_or_else(String::new, |(now, before, e)| told(now, before, e))
    }

    /// What is being done, and the share of it that is done, 0 to 1, where that can be told.
    #[must_use]
    pub fn share(&self) -> (String, Option<f64>) {
        let step = self.now();
        (step.text.clone(), step.told().map(|(now, ..)| now))
    }

    /// What ends the job before its time: whoever holds a copy can [`Stop::ask`].
    #[must_use]
    pub fn stop(&self) -> Stop {
        self.stop.clone()
    }

    /// Steps from now on are as far as a tally says, which begins anew with each.
    pub fn tallied(&self, tally: Tally) {
        self.now().tally = tally;
    }

    /// Says what comes now.
    pub fn step(&self, text: impl Into<String>) {
        self.set(text.into(), Done::Tally);
    }

    /// Says that files are read now.
    pub fn reading(&self, text: impl Into<String>) {
        self.set(text.into(), Done::File);
    }

    /// Says that `n` of `all` things are done, of which `before` were there already; from then on nothing
    /// else is told.
    pub fn counted(&self, text: String, n: usize, before: usize, all: usize) {
        self.of_many.store(true, Ordering::Relaxed);
        let share = |n: usize| n as f64 / all.max(1) as f64;
        let done = Done::Share {
            now: share(n),
            before: share(before),
        };
        let mut step = self.now();
        if !matches!(step.done, Done::Share { .. }) {
            step.since = Instant::now();
        }
        (step.text, step.done) = (text, done);
    }

    /// A fit from so many starts begins.
    pub fn fit(&self, starts: usize) {
        self.step("fitting");
        let counts = [0, 0, starts + LAST];
        for (to, count) in self.fit.iter().zip(counts) {
            to.store(count, Ordering::Relaxed);
        }
        self.fitting("fitting".into(), 0.0);
    }

    fn fitting(&self, text: String, now: f64) {
        if self.of_many.load(Ordering::Relaxed) {
            return;
        }
        let mut step = self.now();
        step.text = text;
        step.done = Done::Share { now, before: 0.0 };
    }

    /// For a fit: counts, shows the cost, and goes on.
    pub fn watch(&self, state: &State) -> ControlFlow<()> {
        let [evaluations, begun, all] = &self.fit;
        let count = evaluations.fetch_add(1, Ordering::Relaxed);
        if state.evaluations == 1 {
            begun.fetch_add(1, Ordering::Relaxed);
        }
        if count.is_multiple_of(5) {
            let [begun, all] = [begun, all].map(|n| n.load(Ordering::Relaxed));
            let cost = state.cost / state.rows.max(1) as f64;
            let text = format!("fitting: {count} evaluations, cost {cost:.4}");
            match all {
                0 => self.step(text),
                // what has begun last is not done
                _ => self.fitting(text, begun.saturating_sub(1).min(all) as f64 / all as f64),
            }
        }
        ControlFlow::Continue(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_told_once_it_can_be() {
        let second = Duration::from_secs;
        assert_eq!(told(0.4, 0.0, second(8)), ", 40 % done, 12 s left");
        assert_eq!(told(0.5, 0.4, second(60)), ", 50 % done, 5 min left");
        assert_eq!(told(0.1, 0.0, second(3000)), ", 10 % done, 8 h left");
        assert_eq!(told(0.4, 0.0, Duration::from_millis(500)), ", 40 % done");
        assert_eq!(told(0.4, 0.4, second(5)), ", 40 % done");
        assert_eq!(told(1.0, 0.0, second(5)), ", 100 % done");
    }

    #[test]
    fn a_job_that_was_asked_to_stop_ends_at_its_next_step() {
        let progress = Progress::default();
        progress.step("one");
        progress.stop().ask();
        let ended = std::panic::catch_unwind(|| progress.step("two")).unwrap_err();
        assert!(ended.is::<crate::fit::memory::Stopped>());
        assert_eq!(progress.share(), ("one".into(), None));
    }
}
