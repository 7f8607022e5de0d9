//! Runs a job beside the interpreter: its lock is released, a callback is told how far the job is, and Ctrl-C
//! ends the call at once, wherever the job is. What ends: errors as exceptions.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use deacal::calibration;
use deacal::jobs::{Failure, Progress};
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBool;

create_exception!(
    deacal,
    DeacalError,
    PyException,
    "A job that could not be done: one line that says what, where, and what to do, in the program's words."
);

/// How often signals are looked for.
const LOOK: Duration = Duration::from_millis(50);
/// How often a callback is told how far a job is.
const TELL: Duration = Duration::from_millis(200);
/// How long a stopped job may take to end before the call ends without it.
const PATIENCE: Duration = Duration::from_millis(250);
/// Stack of a job, bytes: more than the program's own.
const STACK: usize = 16 << 20;

/// A failure as an exception: `ValueError` where an argument cannot be meant, else `DeacalError`.
pub fn raised(failure: &Failure) -> PyErr {
    use calibration::Error::{BadValue, UnknownParameter};
    let text = failure.to_string();
    match failure.downcast_ref::<calibration::Error>() {
        Some(UnknownParameter { .. } | BadValue { .. }) => PyValueError::new_err(text),
        _ => DeacalError::new_err(text),
    }
}

/// Whom a job tells how far it is.
struct Watcher<'py> {
    callback: Option<Bound<'py, PyAny>>,
    told: (String, Option<f64>),
    when: Instant,
}

impl<'py> Watcher<'py> {
    /// `None` and `True` show a line where somebody looks, `False` shows nothing, anything else is called.
    fn new(py: Python<'py>, progress: Option<Bound<'py, PyAny>>) -> PyResult<Self> {
        let shown = progress.as_ref().map(|p| p.cast::<PyBool>());
        let callback = match shown {
            Some(Ok(shown)) if !shown.is_true() => None,
            Some(Err(_)) => progress,
            _ => {
                let line = py.import("deacal._show")?.call_method0("line")?;
                Some(line).filter(|l| !l.is_none())
            }
        };
        if let Some(callback) = callback.as_ref().filter(|c| !c.is_callable()) {
            return Err(PyValueError::new_err(format!(
                "progress: expected a function of a text and a share, True or False, got {}",
                callback.repr()?
            )));
        }
        Ok(Watcher {
            callback,
            told: (String::new(), None),
            when: Instant::now(),
        })
    }

    /// Calls the callback, if there is news and it is time.
    fn tell(&mut self, progress: &Progress) -> PyResult<()> {
        if let Some(callback) = &self.callback
            && self.when.elapsed() >= TELL
        {
            let now = progress.share();
            if !now.0.is_empty() && now != self.told {
                callback.call1(now.clone())?;
                self.told = now;
            }
            self.when = Instant::now();
        }
        Ok(())
    }

    /// The job is over: its last step is told as done if any was told, and a callback that can be closed is.
    fn close(self, done: bool) -> PyResult<()> {
        let Some(callback) = self.callback else {
            return Ok(());
        };
        if done && !self.told.0.is_empty() {
            callback.call1((self.told.0, Some(1.0)))?;
        }
        match callback.hasattr("close")? {
            true => callback.call_method0("close").map(drop),
            false => Ok(()),
        }
    }
}

/// Runs a job on a thread of its own and waits for it. A job that is interrupted, by Ctrl-C or by an
/// exception of the callback, ends at its next evaluation; the call does not wait longer for that than
/// [`PATIENCE`].
///
/// # Errors
/// What keeps the job from being done, as [`raised`]; `KeyboardInterrupt`; what the callback raises.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<Bound<'_, PyAny>>,
    job: impl FnOnce(&Progress) -> Result<T, Failure> + Send + 'static,
) -> PyResult<T> {
    let mut watcher = Watcher::new(py, progress)?;
    let state = Arc::new(Progress::default());
    let (sender, receiver) = channel();
    let receiver = Mutex::new(receiver);
    let told = Arc::clone(&state);
    let work = move || {
        let ended = catch_unwind(AssertUnwindSafe(|| job(&told)));
        // nobody waits for a job that was abandoned
        let _ = sender.send(ended);
    };
    thread::Builder::new()
        .name("deacal".into())
        .stack_size(STACK)
        .spawn(work)?;
    let wait = |time: Duration| {
        let receiver = &receiver;
        py.detach(move || {
            let receiver = receiver.lock().unwrap_or_else(PoisonError::into_inner);
            receiver.recv_timeout(time)
        })
    };
    loop {
        match wait(LOOK) {
            Ok(Ok(Ok(result))) => {
                watcher.close(true)?;
                return Ok(result);
            }
            Ok(Ok(Err(failure))) => {
                watcher.close(false)?;
                return Err(raised(&failure));
            }
            Ok(Err(panic)) => {
                watcher.close(false)?;
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
                return Err(DeacalError::new_err(format!(
                    "a bug in deacal: {}; please report it with the recordings that show it",
                    text.unwrap_or("no word on what")
                )));
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(DeacalError::new_err("the job ended without a word"));
            }
            Err(RecvTimeoutError::Timeout) => {
                let stopped = py.check_signals().and_then(|()| watcher.tell(&state));
                if let Err(why) = stopped {
                    state.stop().ask();
                    let _ = wait(PATIENCE);
                    // the reason counts more than a bar that does not close
                    let _ = watcher.close(false);
                    return Err(why);
                }
            }
        }
    }
}
