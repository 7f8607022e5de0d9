//! The command line: opens doors. `run` reads as the pipeline: arguments, files in, a job, files out.

mod ageing;
mod batch;
mod causes;
mod demo;
mod diagnose;
mod examples;
mod export;
mod fit;
mod import;
mod library;
mod man;
mod merge;
mod new;
mod predict;
mod progress;
mod prove;
mod resume;
mod shard;
mod simulate;
mod stop;
mod validate;
mod view;

use std::ffi::OsString;
use std::io::{self, IsTerminal as _, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;

use clap::{Args, CommandFactory, FromArgMatches as _, Parser, Subcommand};

use crate::checks::{Finding, Grade};
use crate::jobs::{Failure, load, series};
use crate::report::html::number;
use crate::report::output::Overwrite;

/// Calibrates dielectric-elastomer actuators from recordings of motion and voltage.
///
/// REC is a recording.toml, or a folder that has one. Results go to the folder given with -o; they are put
/// there all at once or not at all, and never onto a file that was read or that the program did not make
/// (unless --force). Exit status: 0 done, 1 the job could not be done, 2 wrong usage, 130 and 143 stopped by
/// Ctrl-C and SIGTERM.
#[derive(Parser)]
#[command(name = "deacal", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    talk: Talk,
}

/// How a command talks, and what it may overwrite.
#[derive(Args, Clone, Copy)]
struct Talk {
    /// The result as JSON on standard output, nothing else there
    #[arg(long, global = true)]
    json: bool,
    /// No progress and no summary
    #[arg(long, short, global = true)]
    quiet: bool,
    /// Overwrites files that the program did not make itself, or that it has just read; write-protected ones
    /// stay all the same
    #[arg(long, global = true)]
    force: bool,
}

/// Why standard output could not be written, the first time; said at the end of the job, whose files are
/// there all the same.
static UNSAID: OnceLock<io::Error> = OnceLock::new();

/// Standard output that could not be written.
#[derive(Debug, thiserror::Error)]
#[error(
    "standard output cannot be written: {0}; make room where it goes, or read the result from the files of -o"
)]
struct Unsaid(String);

impl Unsaid {
    /// As a failure of the job; a reader that went away stays what it is.
    fn failure(error: io::Error) -> Failure {
        if error.kind() == io::ErrorKind::BrokenPipe {
            return error.into();
        }
        Unsaid(error.to_string()).into()
    }
}

/// Text for a terminal: what could steer it (escape sequences in an id or a topic) is shown, not sent.
fn plain(text: &str) -> String {
    let steers = |c: char| {
        (c.is_control() && c != '\n' && c != '\t')
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    if !text.contains(steers) {
        return text.to_owned();
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if steers(c) {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
    }
    out
}

impl Talk {
    /// A line for the reader, unless the output is JSON or nothing is wanted.
    fn say(self, text: &str) {
        if !self.json && !self.quiet {
            // terminals have one width of blank
            let text = plain(text).replace(['\u{202f}', '\u{2009}'], " ");
            print(&fitted(&text, width()));
        }
    }

    /// The answer of a job: what stands out where somebody looks.
    fn answer(self, sentence: &str) {
        self.headline(&number::words(sentence));
    }

    /// An answer that begins with a name or a path, which stays as it is.
    fn headline(self, text: &str) {
        if self.json || self.quiet || !coloured() {
            return self.say(text);
        }
        let text = plain(text).replace(['\u{202f}', '\u{2009}'], " ");
        print(&format!("\u{1b}[1m{}\u{1b}[0m", fitted(&text, width())));
    }

    /// A sentence that another part of the program wrote, in the reader's words.
    fn tell(self, sentence: &str) {
        self.say(&number::words(sentence));
    }

    /// Where the report is.
    fn report(self, folder: &Path) {
        self.say(&format!("Report: {}", folder.join("report.html").display()));
    }

    /// A result as JSON, where that is wanted.
    fn result(self, value: &impl serde::Serialize) {
        if self.json {
            print(&crate::report::json::to_text(value));
        }
    }

    /// What may be overwritten.
    fn overwrite(self) -> Overwrite {
        if self.force {
            Overwrite::Any
        } else {
            Overwrite::Own
        }
    }
}

/// Says what is wrong with recordings, before anything is fitted to them: the worst, so that the answer stays
/// within the first lines. Pages have them all.
fn say_findings(findings: &[Finding], talk: Talk) {
    const AT_MOST: usize = 3;
    let mut worst: Vec<&Finding> = findings.iter().collect();
    worst.sort_by_key(|f| std::cmp::Reverse(f.grade));
    for finding in worst.iter().take(AT_MOST) {
        talk.say(&finding_line(finding));
    }
    if let more @ 1.. = worst.len().saturating_sub(AT_MOST) {
        talk.say(&format!(
            "and {more} more: the report has them, and `deacal import`"
        ));
    }
}

/// A finding for a terminal.
fn finding_line(finding: &Finding) -> String {
    let grade = match finding.grade {
        Grade::Wrong => "! wrong:",
        Grade::Doubtful => "? doubtful:",
    };
    // what all recordings tell together is of none of them
    let of = match finding.recording.as_str() {
        "" => String::new(),
        id => format!("{id}: "),
    };
    format!("{grade} {of}{}", number::words(&finding.line()))
}

/// The folders in a folder that are not hidden, by name.
fn folders(dir: &Path) -> Result<Vec<PathBuf>, Failure> {
    let list = std::fs::read_dir(dir).map_err(|e| format!("{}: {e}", dir.display()))?;
    let mut out: Vec<PathBuf> = list.filter_map(|e| e.ok().map(|e| e.path())).collect();
    out.retain(|p| {
        let hidden = p
            .file_name()
            .is_some_and(|n| n.as_encoded_bytes().starts_with(b"."));
        p.is_dir() && !hidden
    });
    out.sort();
    Ok(out)
}

/// Columns of the terminal that standard output is; `None` where it is none.
fn width() -> Option<usize> {
    let (terminal_size::Width(width), _) = terminal_size::terminal_size_of(io::stdout())?;
    Some(usize::from(width)).filter(|w| *w >= 40)
}

/// Whether standard output takes bold letters: a terminal that is not dumb, where nobody asked for none
/// (no-color.org).
fn coloured() -> bool {
    let set = |name| std::env::var_os(name).is_some_and(|v: OsString| !v.is_empty());
    let dumb = std::env::var_os("TERM").is_none_or(|term| term == "dumb");
    io::stdout().is_terminal() && !dumb && !set("NO_COLOR")
}

/// Text whose lines break between words at `width`, never before a unit, with what follows further in.
fn fitted(text: &str, width: Option<usize>) -> String {
    let Some(width) = width else {
        return text.to_owned();
    };
    let mut out = String::with_capacity(text.len() + 16);
    let text = number::unbroken(text);
    for (i, line) in text.split('\n').enumerate() {
        if i > 0 {
            out.push('\n');
        }
        let indent = line.len() - line.trim_start_matches(' ').len();
        let mut at = 0;
        // a word goes with the blanks before it
        let mut rest = line;
        while !rest.is_empty() {
            let blanks = rest.len() - rest.trim_start_matches(' ').len();
            let end = rest[blanks..].find(' ').map_or(rest.len(), |e| blanks + e);
            let (word, after) = rest.split_at(end);
            rest = after;
            let long = word.chars().count();
            if at > indent && at + long > width {
                out.push('\n');
                out.extend(std::iter::repeat_n(' ', indent + 2));
                out.push_str(word.trim_start_matches(' '));
                at = indent + 2 + long - blanks;
            } else {
                out.push_str(word);
                at += long;
            }
        }
    }
    out.replace('\u{a0}', " ")
}

/// A line on standard output.
fn print(text: &str) {
    progress::aside(|| {
        let mut out = io::stdout();
        if let Err(error) = writeln!(out, "{text}").and_then(|()| out.flush()) {
            // the first one counts
            let _ = UNSAID.set(error);
        }
    });
}

#[derive(Subcommand)]
enum Command {
    /// The main job on recordings that come with the program: import, film, forearm and joint fit, diagnosis,
    /// a film coupon, reports
    Demo {
        /// Folder for the results
        #[arg(short, long, default_value = "out/demo")]
        output: PathBuf,
    },
    /// Begins a recording: rig and recording of a kind, to fill in
    New(new::Arguments),
    /// What is in a recording or a file: rate, gaps, labels, ranges, clock offset, and what looks wrong
    Import(import::Arguments),
    /// Fits parameters to recordings
    #[command(subcommand)]
    Fit(fit::Fit),
    /// Predicts from recordings and a parameter file
    #[command(subcommand)]
    Predict(predict::Predict),
    /// A recording as the instruments would have written it: known parameters, a drive, noise and a seed
    Simulate(Box<simulate::Arguments>),
    /// Holds parameter files against recordings: measured against predicted voltage, path, force and stroke
    Validate(validate::Arguments),
    /// Is the model adequate; if not, where, and which physics was left out
    Diagnose(diagnose::Arguments),
    /// The causes that a diagnosis knows: what each does, its typical size, and what brings it out
    Causes(causes::Arguments),
    /// Runs the diagnosis blind over cases with sealed answers, then opens them and scores
    Prove(prove::Arguments),
    /// Electrodes over days or batches: stroke, its loss, what moved, and whether two electrodes differ
    Ageing(ageing::Arguments),
    /// Many films or recording sets: fits (and diagnoses) each, and shows what they have in common: who
    /// stands out, what drifts, which batch differs
    Batch(batch::Arguments),
    /// The shards of a batch or a proof as one result, the same bytes as of one run
    Merge(merge::Arguments),
    /// The parameter sets that come with the program, for `--params library:NAME`: what each is of, where it
    /// comes from, its licence, and how far it goes
    Library(library::Arguments),
    /// A page on a local port, to look closely: a recording with what parameters make of it, the motion to
    /// play, and the reports of a folder
    View(view::Arguments),
    /// A parameter file for the controller: JSON, MATLAB, Python, C header; or functions that it calls
    Export(export::Arguments),
    /// Pages of the manual, one a command
    Man(man::Arguments),
    /// Completions for a shell, on standard output
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// Runs the program on `arguments` (the program's name first).
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let parsed = examples::with(Cli::command()).try_get_matches_from(&arguments);
    let cli = match parsed.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let talk = cli.talk;
    stop::listen();
    threads();
    let words: Vec<String> = arguments
        .iter()
        .skip(1)
        .map(|a| a.to_string_lossy().into_owned())
        .collect();
    let command = format!("deacal {}", words.join(" "));
    let done = match cli.command {
        Command::Demo { output } => demo::run(&output, talk),
        Command::Import(arguments) => import::run(&arguments, &command, talk),
        Command::Fit(fit) => fit::run(&fit, &command, talk),
        Command::Predict(predict) => predict::run(&predict, &command, talk),
        Command::Simulate(arguments) => simulate::run(&arguments, talk),
        Command::Validate(arguments) => validate::run(&arguments, &command, talk),
        Command::Diagnose(arguments) => {
            let search = crate::diagnosis::diagnose;
            diagnose::run(&arguments, &command, talk, search).map(drop)
        }
        Command::Causes(arguments) => causes::run(&arguments, talk),
        Command::New(arguments) => new::run(&arguments, talk),
        Command::Prove(arguments) => prove::run(&arguments, talk),
        Command::Ageing(arguments) => ageing::run(&arguments, &command, talk),
        Command::Batch(arguments) => batch::run(&arguments, talk),
        Command::Merge(arguments) => merge::run(&arguments, talk),
        Command::Library(arguments) => library::run(&arguments, talk),
        Command::Man(arguments) => man::run(&arguments, examples::with(Cli::command()), talk),
        Command::View(arguments) => view::run(&arguments, talk),
        Command::Export(arguments) => export::run(&arguments, talk),
        Command::Completions { shell } => {
            let mut out = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "deacal", &mut out);
            let mut to = io::stdout();
            to.write_all(&out)
                .and_then(|()| to.flush())
                .map_err(Unsaid::failure)
        }
    };
    let done = done.and_then(|()| match UNSAID.get() {
        Some(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Unsaid(error.to_string()).into())
        }
        _ => Ok(()),
    });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        // A reader that has seen enough (`deacal ... | head`) is no failure.
        Err(failure) if closed_pipe(failure.as_ref()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("deacal: {}", plain(&failure.to_string()));
            ExitCode::from(1)
        }
    }
}

/// As many threads as Slurm gives the task, where it says so and nobody else does.
fn threads() {
    let said = |name| {
        std::env::var(name)
            .ok()
            .and_then(|n| n.parse::<usize>().ok())
    };
    if let (None, Some(count)) = (said("RAYON_NUM_THREADS"), said("SLURM_CPUS_PER_TASK")) {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count);
        // they are there already where the library was used before
        let _ = pool.build_global();
    }
}

fn closed_pipe(failure: &(dyn std::error::Error + 'static)) -> bool {
    failure
        .downcast_ref::<std::io::Error>()
        .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::fitted;

    #[test]
    fn lines_break_between_words() {
        let text = "  a column  and its meaning\nshort\n";
        let told = "  a column\n    and its\n    meaning\nshort\n";
        assert_eq!(fitted(text, Some(12)), told);
        assert_eq!(fitted(text, None), text);
        assert_eq!(fitted("within 2.6 V rms", Some(11)), "within\n  2.6 V rms");
        assert_eq!(
            fitted("a-word-that-is-long b", Some(5)),
            "a-word-that-is-long\n  b"
        );
    }
}
