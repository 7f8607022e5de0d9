//! `man`: a page of the manual for each command.

use std::path::PathBuf;

use clap::Command;

use super::{Failure, Talk};
use crate::report::output::OutputSet;

/// Where the pages go.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder for the pages (`man -M DIR/..` finds them in a folder called man1)
    #[arg(value_name = "DIR")]
    dir: PathBuf,
}

/// Writes the pages of `command` and of all below it.
pub(super) fn run(a: &Arguments, mut command: Command, talk: Talk) -> Result<(), Failure> {
    command.build();
    let mut pages = Vec::new();
    below(&command, &mut pages)?;
    let mut set = OutputSet::new(&a.dir, talk.overwrite())?;
    for (name, text) in &pages {
        set.write(name, text)?;
    }
    set.commit()?;
    let names: Vec<&String> = pages.iter().map(|p| &p.0).collect();
    talk.result(&names);
    talk.answer(&format!(
        "{} pages are in {}.",
        pages.len(),
        a.dir.display()
    ));
    Ok(())
}

fn below(command: &Command, out: &mut Vec<(String, Vec<u8>)>) -> Result<(), Failure> {
    let page = clap_mangen::Man::new(command.clone());
    let mut text = Vec::new();
    page.render(&mut text)?;
    out.push((page.get_filename(), text));
    let mut inner = command.get_subcommands().filter(|c| c.get_name() != "help");
    inner.try_for_each(|c| below(c, out))
}
