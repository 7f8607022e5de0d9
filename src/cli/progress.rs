//! Progress on standard error, and the wish to stop.

use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use super::Talk;
use crate::fit::separable::State;

static STOP: AtomicBool = AtomicBool::new(false);
static HANDLER: OnceLock<()> = OnceLock::new();

/// A line that says what is going on; it shows only when the work takes a while and somebody looks.
pub(super) struct Progress {
    bar: ProgressBar,
    evaluations: AtomicUsize,
}

impl Progress {
    /// Begins; Ctrl-C from now on asks the work to stop at its next step.
    pub(super) fn new(talk: Talk) -> Self {
        HANDLER.get_or_init(|| {
            // Where no handler can be set, Ctrl-C ends the program at once, which leaves no file half-written either.
            let _ = ctrlc::set_handler(|| {
                if STOP.swap(true, Ordering::Relaxed) {
                    std::process::exit(130); // asked twice
                }
            });
        });
        let bar = if talk.quiet {
            ProgressBar::hidden()
        } else {
            ProgressBar::new_spinner()
        };
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Progress {
            bar,
            evaluations: AtomicUsize::new(0),
        }
    }

    /// Says what comes now.
    pub(super) fn step(&self, text: impl Into<String>) {
        self.bar.set_message(text.into());
    }

    /// For a fit: counts, shows the cost, and says whether to go on.
    pub(super) fn watch(&self, state: &State) -> ControlFlow<()> {
        let count = self.evaluations.fetch_add(1, Ordering::Relaxed);
        if count.is_multiple_of(5) {
            self.bar.set_message(format!(
                "fitting: {count} evaluations, cost {:.4}",
                state.cost / state.rows.max(1) as f64
            ));
        }
        self.asked()
    }

    /// Whether to go on.
    pub(super) fn asked(&self) -> ControlFlow<()> {
        if STOP.load(Ordering::Relaxed) {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    /// For work that cannot be asked to stop: ends the program where a stop was asked for. Nothing is written before a job is done.
    pub(super) fn leave_if_stopped(&self) {
        if STOP.load(Ordering::Relaxed) {
            self.bar.finish_and_clear();
            eprintln!("deacal: stopped on request; nothing was written");
            std::process::exit(1);
        }
    }

    /// An error when a stop was asked for.
    pub(super) fn stopped(&self) -> Result<(), super::Failure> {
        if STOP.load(Ordering::Relaxed) {
            return Err("stopped on request; nothing was written".into());
        }
        Ok(())
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
