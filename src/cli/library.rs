//! `library`: the parameter sets that come with the program.

use super::{Failure, Talk};
use crate::report::library::{self, Entry};
use crate::report::terminal;

/// Which sets.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Sets to tell all about (default: all of them, a line each)
    #[arg(value_name = "NAME")]
    names: Vec<String>,
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let all = library::entries();
    let find = |name: &String| library::find(name).map_err(Failure::from);
    let wanted: Vec<Entry> = match a.names.is_empty() {
        true => all,
        false => a.names.iter().map(find).collect::<Result<_, _>>()?,
    };
    talk.result(&wanted);
    if a.names.is_empty() {
        talk.answer(&format!(
            "{} parameter sets, each as `--params library:NAME`; `deacal library NAME` tells all about one",
            wanted.len()
        ));
        let row = |e: &Entry| [e.name.clone(), e.of.clone()];
        let rows: Vec<[String; 2]> = wanted.iter().map(row).collect();
        terminal::columns(&rows).iter().for_each(|l| talk.say(l));
        return Ok(());
    }
    for e in &wanted {
        talk.answer(&format!("{}: {}.", e.name, e.of));
        let lines = [
            ("made by", &e.made_by),
            ("from", &e.source),
            ("licence", &e.licence),
            ("holds for", &e.range),
            ("beyond", &e.beyond),
        ];
        for (what, says) in lines {
            talk.say(&format!("  {what}: {says}"));
        }
    }
    Ok(())
}
