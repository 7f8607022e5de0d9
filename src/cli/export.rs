//! `export`.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::{Failure, Talk, Unsaid, load};
use crate::recording::Rig;
use crate::report::controller::controller;
use crate::report::export::{Format, export};
use crate::report::html::number;
use crate::report::output::write_atomic;
use crate::report::parameter_file::ParameterFile;
use crate::report::survey::count;

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
    /// File to write; left out, the text goes to standard output, and with --json it is in the result
    #[arg(short, long)]
    output: Option<PathBuf>,
}

/// For `--json`.
#[derive(Serialize)]
struct Exported {
    format: &'static str,
    file: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    text: Option<String>,
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
    let mut remarks = Vec::new();
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
            remarks = made.remarks;
            made.text
        }
        None => export(&file, format),
    };
    let mut exported = Exported {
        format: format.name(),
        file: None,
        text: None,
    };
    match &a.output {
        Some(path) => {
            write_atomic(path, talk.overwrite(), text)?;
            talk.answer(&what_is_in(&file));
            talk.say(&format!("Written to {}", path.display()));
            remarks.iter().for_each(|r| talk.say(r));
            exported.file = Some(path.display().to_string());
        }
        None if talk.json => exported.text = Some(text),
        None => {
            let says = remarks.iter().map(|r| super::plain(r));
            says.for_each(|r| eprintln!("deacal: {r}"));
            let mut out = std::io::stdout();
            out.write_all(text.as_bytes())
                .and_then(|()| out.flush())
                .map_err(Unsaid::failure)?;
        }
    }
    talk.result(&exported);
    Ok(())
}

/// What a parameter file holds, in one line.
fn what_is_in(file: &ParameterFile) -> String {
    let film = file.film.as_ref().map(|f| count(f.mu_pa.len(), "spring"));
    let forearm = file
        .forearm
        .as_ref()
        .map(|f| count(f.nodes_deg.len(), "angle"));
    let axis = Some(file.axis.len()).filter(|n| *n > 0);
    let parts: Vec<String> = [
        film.map(|n| format!("the film ({n})")),
        forearm.map(|n| format!("the forearms' torque ({n})")),
        axis.map(|n| count(n, "value") + " of an axis"),
        Some(count(file.effects.len(), "cause")),
    ]
    .into_iter()
    .flatten()
    .collect();
    format!("Exported: {}", number::list(&parts))
}
