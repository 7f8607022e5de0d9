//! The program `deacal`: everything is in the library.

fn main() -> std::process::ExitCode {
    deacal::cli::run(std::env::args_os())
}
