//! Progress on standard error: one line that changes where somebody looks, now and then a line where it goes
//! to a file or a pipe.

use std::io::IsTerminal;
use std::ops::Deref;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::{Talk, plain};
use crate::jobs;

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

/// What is going on, shown or said while it is.
pub(super) struct Progress {
    bar: ProgressBar,
    told: Arc<jobs::Progress>,
    /// Closed when the work ends.
    speaks: Option<Sender<()>>,
}

impl Deref for Progress {
    type Target = jobs::Progress;

    fn deref(&self) -> &jobs::Progress {
        &self.told
    }
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
        let told = Arc::new(jobs::Progress::default());
        let speaks = (!talk.quiet).then(|| match seen {
            true => show(Arc::clone(&told), bar.clone()),
            false => speak(Arc::clone(&told)),
        });
        Progress { bar, told, speaks }
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
fn show(told: Arc<jobs::Progress>, bar: ProgressBar) -> Sender<()> {
    every(LOOK_EVERY, move || bar.set_message(plain(&told.line())))
}

/// A thread that says from time to time what the step is, until the sender is dropped.
fn speak(told: Arc<jobs::Progress>) -> Sender<()> {
    let begin = Instant::now();
    every(LINE_EVERY, move || {
        let line = plain(&told.line());
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
