//! Stopping: Ctrl-C and SIGTERM (and SIGHUP, unless `nohup` or a shell has it ignored) end the program at
//! once, wherever it is.
//!
//! Results are put in place as a whole or not at all, so there is nothing that a job would have to end
//! itself: one thread waits for the signal, takes away what is not complete, says so and exits. Exit status:
//! 128 and the number of the signal.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, Once, PoisonError};
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};

use crate::report::output::abandon;

/// How often is looked for a signal.
const LOOK: Duration = Duration::from_millis(20);
/// How long the last sentence may take where nobody reads standard error.
const WORDS: Duration = Duration::from_millis(200);

/// What a job says when it is stopped, in place of "nothing was written".
static INSTEAD: Mutex<Option<String>> = Mutex::new(None);

/// What to say when the job is stopped from now on: what is kept, and how to go on.
pub(super) fn instead(text: String) {
    *INSTEAD.lock().unwrap_or_else(PoisonError::into_inner) = Some(text);
}

/// Begins to listen, once.
pub(super) fn listen() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let caught = Arc::new(AtomicUsize::new(0));
        let again = Arc::new(AtomicBool::new(false));
        for (signal, _) in signals() {
            if is_ignored(signal) {
                continue;
            }
            // A second signal ends the program even if the first one cannot. Where neither can be set, the
            // system's way of ending it leaves no file half-written either.
            let number = usize::try_from(signal).unwrap_or(0);
            let _ = signal_hook::flag::register_conditional_shutdown(
                signal,
                128 + signal,
                Arc::clone(&again),
            );
            let _ = signal_hook::flag::register_usize(signal, Arc::clone(&caught), number);
            let _ = signal_hook::flag::register(signal, Arc::clone(&again));
        }
        let wait = move || {
            loop {
                std::thread::sleep(LOOK);
                let number = caught.load(Ordering::SeqCst);
                if number != 0 {
                    leave(i32::try_from(number).unwrap_or(SIGTERM));
                }
            }
        };
        // Without a thread signals end the program as they do any other.
        let _ = std::thread::Builder::new().name("stop".into()).spawn(wait);
    });
}

/// The signals that stop, with their names.
fn signals() -> Vec<(i32, &'static str)> {
    let mut all = vec![(SIGINT, "Ctrl-C"), (SIGTERM, "SIGTERM")];
    #[cfg(unix)]
    all.push((signal_hook::consts::SIGHUP, "SIGHUP"));
    all
}

/// Whether whoever started the program has it ignore a signal (`nohup`; `&` in a script). Known on Linux;
/// elsewhere SIGHUP is left alone.
fn is_ignored(signal: i32) -> bool {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else {
        return signal != SIGINT && signal != SIGTERM;
    };
    let ignored = status.lines().find_map(|l| l.strip_prefix("SigIgn:"));
    let mask = ignored.and_then(|m| u64::from_str_radix(m.trim(), 16).ok());
    mask.is_some_and(|m| m >> (signal - 1) & 1 == 1)
}

/// Clears up, says so, and ends the program.
fn leave(signal: i32) -> ! {
    let placed = abandon();
    let (said, heard) = channel();
    let _ = std::thread::Builder::new().spawn(move || {
        super::progress::clear();
        eprintln!("{}", super::plain(&sentence(signal, &placed)));
        let _ = said.send(());
    });
    let _ = heard.recv_timeout(WORDS);
    std::process::exit(128 + signal)
}

/// What is said at the end.
fn sentence(signal: i32, placed: &[PathBuf]) -> String {
    let names = signals();
    let name = names.iter().find(|s| s.0 == signal).map_or("?", |s| s.1);
    let instead = INSTEAD.lock().unwrap_or_else(PoisonError::into_inner);
    match (instead.as_ref(), placed.last()) {
        (Some(instead), _) => format!("deacal: stopped by {name}; {instead}"),
        (None, None) => format!("deacal: stopped by {name}; nothing was written"),
        (None, Some(last)) => format!(
            "deacal: stopped by {name}; what was complete before stays (last: {})",
            last.display()
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_sentence_says_what_is_kept() {
        let text = sentence(SIGTERM, &[]);
        assert_eq!(text, "deacal: stopped by SIGTERM; nothing was written");
        let text = sentence(SIGINT, &[PathBuf::from("out/a"), PathBuf::from("out/b")]);
        assert!(text.contains("Ctrl-C") && text.contains("out/b"), "{text}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn ignored_signals_are_known() {
        // Rust's runtime ignores SIGPIPE.
        assert!(is_ignored(signal_hook::consts::SIGPIPE));
        assert!(!is_ignored(signal_hook::consts::SIGUSR1));
    }
}
