//! Progress on standard error: one line that changes where somebody looks, now and then a line where it goes
//! to a file or a pipe.

use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::{Talk, plain};
use crate::fit::separable::State;

/// How often a line goes to a file or a pipe; shorter runs say nothing there.
const LINE_EVERY: Duration = Duration::from_secs(10);

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

/// What is going on.
pub(super) struct Progress {
    bar: ProgressBar,
    evaluations: AtomicUsize,
    message: Arc<Mutex<String>>,
    /// Closed when the work ends.
    lines: Option<Sender<()>>,
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
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            bar.set_style(style);
        }
        if seen && !talk.quiet {
            bar.enable_steady_tick(Duration::from_millis(200));
            *SHOWN.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.clone());
        }
        let message = Arc::new(Mutex::new(String::new()));
        let lines = (!seen && !talk.quiet).then(|| speak(Arc::clone(&message)));
        Progress {
            bar,
            evaluations: AtomicUsize::new(0),
            message,
            lines,
        }
    }

    /// Says what comes now.
    pub(super) fn step(&self, text: impl Into<String>) {
        let text = plain(&text.into());
        if self.lines.is_some() {
            *self.message.lock().unwrap_or_else(PoisonError::into_inner) = text;
        } else {
            self.bar.set_message(text);
        }
    }

    /// For a fit: counts, shows the cost, and goes on.
    pub(super) fn watch(&self, state: &State) -> ControlFlow<()> {
        let count = self.evaluations.fetch_add(1, Ordering::Relaxed);
        if count.is_multiple_of(5) {
            self.step(format!(
                "fitting: {count} evaluations, cost {:.4}",
                state.cost / state.rows.max(1) as f64
            ));
        }
        ControlFlow::Continue(())
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.lines = None;
        // a bar that nobody sees does not take another one's place
        if !self.bar.is_hidden() {
            clear();
        }
        self.bar.finish_and_clear();
    }
}

/// A thread that says from time to time what the message is, until the sender is dropped.
fn speak(message: Arc<Mutex<String>>) -> Sender<()> {
    let (sender, receiver) = channel::<()>();
    let begin = Instant::now();
    let talk = move || {
        while receiver.recv_timeout(LINE_EVERY) == Err(RecvTimeoutError::Timeout) {
            let text = message
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .clone();
            eprintln!("deacal: {text} ({:.0} s)", begin.elapsed().as_secs_f64());
        }
    };
    // Without a thread nothing is said on the way.
    let _ = std::thread::Builder::new()
        .name("progress".into())
        .spawn(talk);
    sender
}
