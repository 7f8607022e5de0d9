//! `new`: files to fill in, for a recording of a kind. They are the examples of the page on files, which is
//! tested to be read.

use std::path::{Path, PathBuf};

use super::{Failure, Talk};
use crate::recording::Kind;
use crate::report::output::{Overwrite, write_atomic};

/// What to begin.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// What was recorded: robot, film-sample, film-coupon, hinge-bench, axis
    #[arg(value_name = "KIND", value_parser = parse_kind)]
    kind: Kind,
    /// Folder to begin it in
    #[arg(value_name = "DIR")]
    dir: PathBuf,
}

const KINDS: [Kind; 5] = [
    Kind::Robot,
    Kind::FilmSample,
    Kind::FilmCoupon,
    Kind::HingeBench,
    Kind::Axis,
];

fn parse_kind(text: &str) -> Result<Kind, String> {
    let names: Vec<&str> = KINDS.iter().map(|k| k.name()).collect();
    let found = KINDS.into_iter().find(|k| k.name() == text);
    found.ok_or_else(|| format!("expected one of {}", names.join(", ")))
}

/// The page whose examples these are.
const PAGE: &str = include_str!("../../docs/src/files.md");

/// The recording of a hanging sample, which the page describes in words.
const SAMPLE: &str = r#"[recording]
id = "sample-1"
kind = "film-sample"
rig = "../rig.toml"
payload_g = 0.0                # mass added to the one of the rig
film_state = "relaxed"         # "virgin" where the film was stretched just now

[motion]
file = "motion.csv"            # C3D, Vicon Nexus or Tracker CSV, OptiTrack CSV, Qualisys TSV, TRC, MCAP, or a table
end_effector = "mass"          # the marker on the mass

[voltage]
file = "voltage.csv"
time = "time_s"                # a column; or rate_hz = 1000.0
channels = ["phi_kV"]
unit = "kV"                    # or "V"

[sync]
offset_s = 0.0                 # voltage clock minus motion clock; "estimate" lets the fit find it
"#;

/// The example of the page that holds `mark`.
fn example(mark: &str) -> &'static str {
    let blocks = PAGE.split("```toml\n").skip(1);
    let texts = blocks.filter_map(|b| b.split("```").next());
    texts.into_iter().find(|t| t.contains(mark)).unwrap_or("")
}

/// The files of a kind: the rig, where there is one, and the recording.
fn files(kind: Kind) -> Vec<(&'static str, &'static str)> {
    let rig = "rig.toml";
    let recording = "01/recording.toml";
    match kind {
        Kind::Robot => vec![(rig, example("[delta]")), (recording, example("[sync]"))],
        Kind::FilmSample => vec![(rig, example("[sample]")), (recording, SAMPLE)],
        Kind::FilmCoupon => vec![(recording, example("[coupon]"))],
        Kind::HingeBench => vec![(recording, example("[bench]"))],
        Kind::Axis => vec![(recording, example("[axis]"))],
    }
}

/// What to do next with what was recorded.
fn next(kind: Kind) -> &'static str {
    match kind {
        Kind::Robot => "fit film",
        Kind::FilmSample => "fit sample",
        Kind::FilmCoupon => "fit coupon",
        Kind::HingeBench => "fit hinge",
        Kind::Axis => "fit axis",
    }
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let files = files(a.kind);
    let there = files.iter().map(|f| a.dir.join(f.0)).find(|p| p.exists());
    if let Some(path) = there {
        let path = path.display();
        return Err(format!("{path}: is there already; name another folder").into());
    }
    std::fs::create_dir_all(a.dir.join("01"))
        .map_err(|e| format!("{}: {e}; name a folder that can be made", a.dir.display()))?;
    let mut paths: Vec<PathBuf> = Vec::new();
    for (name, text) in files {
        let path = a.dir.join(name);
        write_atomic(&path, Overwrite::Own, begun(name, text))?;
        paths.push(path);
    }
    talk.result(
        &paths
            .iter()
            .map(|p| p.display().to_string())
            .collect::<Vec<_>>(),
    );
    talk.answer(&format!(
        "Files to fill in for a recording of kind \"{}\" are written",
        a.kind.name()
    ));
    paths
        .iter()
        .for_each(|p| talk.say(&format!("  {}", p.display())));
    let folder = a.dir.join("01");
    let folder = Path::new(&folder).display();
    talk.say(&format!(
        "Put the instruments' files into {folder}, write their names and columns into its recording.toml{}, then:",
        match paths.len() {
            1 => "",
            _ => ", and your sizes into rig.toml",
        }
    ));
    talk.say(&format!("  deacal import {folder}"));
    talk.say(&format!(
        "  deacal {} {folder} -o out/{}",
        next(a.kind),
        next(a.kind).replace(' ', "-")
    ));
    Ok(())
}

/// The text of a file, without the name that the page gives it.
fn begun(name: &str, text: &str) -> String {
    let lines = text.lines().filter(|l| !l.starts_with("# my-robot/"));
    let about = match name {
        "rig.toml" => "the robot or the frame: put in your own sizes",
        _ => "one recording: put in your own files and columns",
    };
    let mut out = format!("# {about}\n");
    lines.for_each(|l| {
        out.push_str(l);
        out.push('\n');
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{Manifest, Rig};

    #[test]
    fn what_is_begun_is_read() {
        for kind in KINDS {
            for (name, text) in files(kind) {
                let (path, text) = (Path::new(name), begun(name, text));
                if name == "rig.toml" {
                    Rig::parse(path, &text).unwrap();
                } else {
                    assert_eq!(Manifest::parse(path, &text).unwrap().kind, kind);
                }
            }
        }
    }
}
