//! `export`.

use std::io::Write;
use std::path::PathBuf;

use super::{Failure, Talk, Unsaid, load};
use crate::report::export::{Format, export};
use crate::report::output::write_atomic;

/// What to export, and to what.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The parameter file
    #[arg(value_name = "PARAMETERS")]
    parameters: PathBuf,
    /// json, m (MATLAB), py (Python) or c (C header)
    #[arg(long, value_parser = ["json", "m", "py", "c"])]
    format: String,
    /// File to write (default: standard output)
    #[arg(short, long)]
    output: Option<PathBuf>,
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let file = load::parameters(&a.parameters)?;
    let format = Format::parse(&a.format).ok_or("unknown format")?;
    if let Some(path) = &a.output {
        load::ending(
            path,
            &format!("--format {}", format.name()),
            &[format.extension(), format.name()],
        )?;
    }
    let text = export(&file, format);
    match &a.output {
        Some(path) => {
            write_atomic(path, talk.overwrite(), text)?;
            talk.say(&format!("Written: {}", path.display()));
        }
        None => {
            let mut out = std::io::stdout();
            out.write_all(text.as_bytes())
                .and_then(|()| out.flush())
                .map_err(Unsaid::failure)?;
        }
    }
    Ok(())
}
