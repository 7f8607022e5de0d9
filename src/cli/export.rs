//! `export`.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::{Failure, Talk, Unsaid, load};
use crate::recording::Rig;
use crate::report::controller::controller;
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
    /// Not the parameters as data but functions that evaluate f_ID (motion to voltages) and F_FP (motion and
    /// voltages to force) sample by sample, with the causes of the file
    #[arg(long, requires = "rig")]
    controller: bool,
    /// The robot's rig.toml, for --controller
    #[arg(long, requires = "controller")]
    rig: Option<PathBuf>,
    /// File to write (default: standard output)
    #[arg(short, long)]
    output: Option<PathBuf>,
}

/// What a MATLAB function is called where no file names it.
const NAME: &str = "deacal_controller";

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
    let text = match &a.rig {
        Some(rig) => {
            let path = a.output.as_deref().unwrap_or(Path::new(NAME));
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            let Rig::Robot(robot) = Rig::read(rig)? else {
                return Err(format!(
                    "{}: a controller is one of a robot, and this rig is of another kind: name the robot's rig.toml",
                    rig.display()
                )
                .into());
            };
            let robot = load::robot(&robot, Some(&file))?;
            let made = controller(&file, &robot, format, &name)?;
            for remark in &made.remarks {
                match a.output {
                    Some(_) => talk.say(remark),
                    None => eprintln!("deacal: {}", super::plain(remark)),
                }
            }
            made.text
        }
        None => export(&file, format),
    };
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
