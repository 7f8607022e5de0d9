//! The command line: opens doors. `run` reads as the pipeline: arguments, files in, a job, files out.

mod ageing;
mod demo;
mod diagnose;
mod export;
mod fit;
mod import;
mod load;
mod predict;
mod progress;
mod prove;
mod series;
mod simulate;
mod validate;

use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, CommandFactory, Parser, Subcommand};

/// Anything that keeps a job from being done: one line that says what, where, and what to do.
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Calibrates dielectric-elastomer actuators from recordings of motion and voltage.
///
/// REC is a recording.toml, or a folder that has one. Results go to the folder given with -o; none is left half-written, and a failed
/// run overwrites nothing. Exit status: 0 done, 1 the job could not be done, 2 wrong usage.
#[derive(Parser)]
#[command(name = "deacal", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    talk: Talk,
}

/// How a command talks.
#[derive(Args, Clone, Copy)]
struct Talk {
    /// The result as JSON on standard output, nothing else there
    #[arg(long, global = true)]
    json: bool,
    /// No progress and no summary
    #[arg(long, short, global = true)]
    quiet: bool,
}

impl Talk {
    /// A line for the reader, unless the output is JSON or nothing is wanted.
    fn say(self, text: &str) {
        if !self.json && !self.quiet {
            // A reader that went away (a closed pipe) is no failure of the job.
            let _ = writeln!(std::io::stdout(), "{text}");
        }
    }

    /// A result as JSON, where that is wanted.
    fn result(self, value: &impl serde::Serialize) {
        if self.json {
            let _ = writeln!(std::io::stdout(), "{}", crate::report::json::to_text(value));
        }
    }
}

#[derive(Subcommand)]
enum Command {
    /// The main job on recordings that come with the program: import, film, forearm and joint fit, diagnosis, a film coupon, reports
    Demo {
        /// Folder for the results
        #[arg(short, long, default_value = "out/demo")]
        output: PathBuf,
    },
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
    /// Runs the diagnosis blind over cases with sealed answers, then opens them and scores
    Prove(prove::Arguments),
    /// Electrodes over days or batches: stroke, its loss, what moved, and whether two electrodes differ
    Ageing(ageing::Arguments),
    /// A parameter file for the controller: JSON, MATLAB, Python, C header
    Export(export::Arguments),
    /// Completions for a shell, on standard output
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// Runs the program on `arguments` (the program's name first).
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let cli = match Cli::try_parse_from(&arguments) {
        Ok(cli) => cli,
        Err(error) => {
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { 2 } else { 0 });
        }
    };
    let talk = cli.talk;
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
            diagnose::run(&arguments, &command, talk, crate::diagnosis::diagnose)
        }
        Command::Prove(arguments) => prove::run(&arguments, talk),
        Command::Ageing(arguments) => ageing::run(&arguments, &command, talk),
        Command::Export(arguments) => export::run(&arguments, talk),
        Command::Completions { shell } => {
            let mut out = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "deacal", &mut out);
            let _ = std::io::stdout().write_all(&out);
            Ok(())
        }
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        // A reader that has seen enough (`deacal ... | head`) is no failure.
        Err(failure) if closed_pipe(failure.as_ref()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("deacal: {failure}");
            ExitCode::from(1)
        }
    }
}

fn closed_pipe(failure: &(dyn std::error::Error + 'static)) -> bool {
    failure
        .downcast_ref::<std::io::Error>()
        .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}
