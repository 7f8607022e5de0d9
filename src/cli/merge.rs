//! `merge`: the parts of a campaign as one result, the same bytes as of one run.

use std::path::PathBuf;

use super::shard::Campaign;
use super::{Failure, Talk, batch, prove};
use crate::report::output::settle;

/// What to merge.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// Folder that the shards of `deacal batch` or `deacal prove` wrote to with -o
    #[arg(value_name = "DIR")]
    dir: PathBuf,
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    settle(&a.dir)?;
    let campaign = Campaign::read(&a.dir)?;
    match campaign.campaign.as_str() {
        "batch" => batch::merge(&a.dir, &campaign, talk),
        "prove" => prove::merge(&a.dir, &campaign, talk),
        other => Err(format!(
            "{}: a campaign of `{other}` is unknown to this version; merge with the one that made it",
            a.dir.display()
        )
        .into()),
    }
}

/// What to say of parts that are not there, of `of` parts.
pub(super) fn missing(names: &[String], of: usize, how: &str) -> Failure {
    let some = match names.len() {
        n if n > 20 => format!("{} and {} more", names[..20].join(", "), n - 20),
        _ => names.join(", "),
    };
    format!("{} of {of} parts are missing: {some}; {how}", names.len()).into()
}
