//! Progress on standard error: one line that changes where somebody looks, now and then a line where it goes
//! to a file or a pipe.

use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::{Talk, plain};
use crate::diagnosis::Tally;
use crate::fit::separable::State;

/// How often a line goes to a file or a pipe; shorter runs say nothing there.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// How often what is shown is renewed.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// The bar that shows, for a stop to clear.
static SHOWN: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Takes the bar away, before the last words.
pub(super) fn clear() {
    if let Some(bar) = SHOWN.lock().unwrap_or_else(PoisonError::into_inner).take() {
        bar.finish_and_clear();
    }
}

/// Writes with the bar out of the way, so that none stays behind a line.
pub(super) fn aside(write: impl FnOnce()) {
    let bar = SHOWN.lock().unwrap_or_else(PoisonError::into_inner).clone();
    match bar {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

/// Searches of a fit after its starts: with weights set to the noise.
const LAST: usize = 2;
/// Time left is told after so much time, and so much of the work.
const TELLS: (Duration, f64) = (Duration::from_secs(1), 0.01);

/// How far a step is.
#[derive(Clone, Copy, PartialEq)]
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
struct Step {
    text: String,
    done: Done,
    tally: Tally,
    since: Instant,
}

impl Step {
    /// In one line: what, share done, time left.
    fn line(&self) -> String {
        let told = match self.done {
            Done::Untold => None,
            Done::Share { now, before } => Some(told(now, before, self.since.elapsed())),
            Done::Tally => self
                .tally
                .share()
                .filter(|now| *now < 1.0) // the step goes on beyond what is counted
                .map(|now| told(now, 0.0, self.since.elapsed())),
            Done::File => crate::recording::share_read().map(|(now, took)| told(now, 0.0, took)),
        };
        self.text.clone() + &told.unwrap_or_default()
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
pub(super) struct Progress {
    bar: ProgressBar,
    /// Evaluations and searches of the fit under way, and how many of these there will be.
    fit: [AtomicUsize; 3],
    /// Whether the job is one of many, whose own steps are not told.
    of_many: AtomicBool,
    step: Arc<Mutex<Step>>,
    /// Closed when the work ends.
    speaks: Option<Sender<()>>,
}

impl Progress {
    /// Begins.
    pub(super) fn new(talk: Talk) -> Self {
        let seen = std::io::stderr().is_terminal();
        let bar = if talk.quiet || !seen {
            ProgressBar::hidden()
        } else {
            ProgressBar::new_spinner()
        };
        // no colour, and no wider than the terminal
        if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {wide_msg}") {
            bar.set_style(style);
        }
        if seen && !talk.quiet {
            bar.enable_steady_tick(LOOK_EVERY);
            *SHOWN.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.clone());
        }
        let step = Arc::new(Mutex::new(Step {
            text: String::new(),
            done: Done::Untold,
            tally: Tally::default(),
            since: Instant::now(),
        }));
        let speaks = (!talk.quiet).then(|| match seen {
            true => show(Arc::clone(&step), bar.clone()),
            false => speak(Arc::clone(&step)),
        });
        Progress {
            bar,
            fit: Default::default(),
            of_many: AtomicBool::new(false),
            step,
            speaks,
        }
    }

    fn now(&self) -> MutexGuard<'_, Step> {
        self.step.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, text: &str, done: Done) {
        if self.of_many.load(Ordering::Relaxed) {
            return;
        }
        let mut step = self.now();
        step.tally.begin();
        (step.text, step.done, step.since) = (plain(text), done, Instant::now());
    }

    /// Steps from now on are as far as a tally says, which begins anew with each.
    pub(super) fn tallied(&self, tally: Tally) {
        self.now().tally = tally;
    }

    /// Says what comes now.
    pub(super) fn step(&self, text: impl Into<String>) {
        self.set(&text.into(), Done::Tally);
    }

    /// Says that files are read now.
    pub(super) fn reading(&self, text: impl Into<String>) {
        self.set(&text.into(), Done::File);
    }

    /// Says that `n` of `all` things are done, of which `before` were there already; from then on nothing
    /// else is told.
    pub(super) fn counted(&self, text: String, n: usize, before: usize, all: usize) {
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
        (step.text, step.done) = (plain(&text), done);
    }

    /// A fit from so many starts begins.
    pub(super) fn fit(&self, starts: usize) {
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
    pub(super) fn watch(&self, state: &State) -> ControlFlow<()> {
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

impl Drop for Progress {
    fn drop(&mut self) {
        self.speaks = None;
        // a bar that nobody sees does not take another one's place
        if !self.bar.is_hidden() {
            clear();
        }
        self.bar.finish_and_clear();
    }
}

/// A thread that shows the step on the bar, until the sender is dropped.
fn show(step: Arc<Mutex<Step>>, bar: ProgressBar) -> Sender<()> {
    every(LOOK_EVERY, move || {
        let line = step.lock().unwrap_or_else(PoisonError::into_inner).line();
        bar.set_message(line);
    })
}

/// A thread that says from time to time what the step is, until the sender is dropped.
fn speak(step: Arc<Mutex<Step>>) -> Sender<()> {
    let begin = Instant::now();
    every(LINE_EVERY, move || {
        let line = step.lock().unwrap_or_else(PoisonError::into_inner).line();
        eprintln!("deacal: {line} ({:.0} s)", begin.elapsed().as_secs_f64());
    })
}

fn every(time: Duration, mut tell: impl FnMut() + Send + 'static) -> Sender<()> {
    let (sender, receiver) = channel::<()>();
    let talk = move || {
        while receiver.recv_timeout(time) == Err(RecvTimeoutError::Timeout) {
            tell();
        }
    };
    // Without a thread nothing is said on the way.
    let _ = std::thread::Builder::new()
        .name("progress".into())
        .spawn(talk);
    sender
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
}
