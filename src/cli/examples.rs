//! Two examples a command, below its `--help`.

use clap::Command;

/// A command and its examples.
const EXAMPLES: &[(&[&str], [&str; 2])] = &[
    (&["demo"], ["deacal demo", "deacal demo -o out/first-look"]),
    (
        &["new"],
        [
            "deacal new robot my-robot",
            "deacal new film-coupon my-film",
        ],
    ),
    (
        &["import"],
        [
            "deacal import motion.c3d voltage.csv --init",
            "deacal import my-robot/01 -o out/import",
        ],
    ),
    (
        &["fit", "film"],
        [
            "deacal fit film my-robot/01 -o out/film",
            "deacal fit film my-robot/01 --branches 3 --fix J=80",
        ],
    ),
    (
        &["fit", "forearm"],
        [
            "deacal fit forearm my-robot/02 my-robot/03 --params out/film/parameters.toml -o out/forearm",
            "deacal fit forearm my-robot/02 --params out/film/parameters.toml --fix torque_0deg=0",
        ],
    ),
    (
        &["fit", "robot"],
        [
            "deacal fit robot my-robot/01 my-robot/02 -o out/robot",
            "deacal fit robot my-robot/01 my-robot/02 --params out/forearm/parameters.toml --starts 20",
        ],
    ),
    (
        &["fit", "sample"],
        [
            "deacal fit sample my-film/01 -o out/sample",
            "deacal fit sample my-film/01 my-film/02 --params out/coupon/parameters.toml",
        ],
    ),
    (
        &["fit", "coupon"],
        [
            "deacal fit coupon my-film/01 -o out/coupon",
            "deacal fit coupon my-film/01 my-film/02 --branches 3",
        ],
    ),
    (
        &["fit", "hinge"],
        [
            "deacal fit hinge my-hinge/01 -o out/hinge",
            "deacal fit hinge my-hinge/01 my-hinge/02 --fix torque_0deg=0",
        ],
    ),
    (
        &["fit", "axis"],
        [
            "deacal fit axis my-axis/01 -o out/axis",
            "deacal fit axis my-axis/01 --objective motion --cause choose",
        ],
    ),
    (
        &["predict", "voltage"],
        [
            "deacal predict voltage my-robot/04 --params out/robot/parameters.toml",
            "deacal predict voltage my-robot/04 --params out/robot/parameters.toml -o voltage.mat",
        ],
    ),
    (
        &["predict", "force"],
        [
            "deacal predict force my-robot/04 --params out/robot/parameters.toml",
            "deacal predict force my-robot/04 --params out/robot/parameters.toml -o force.csv",
        ],
    ),
    (
        &["predict", "motion"],
        [
            "deacal predict motion my-robot/04 --params out/robot/parameters.toml",
            "deacal predict motion my-robot/04 --params out/robot/parameters.toml -o motion.csv",
        ],
    ),
    (
        &["simulate"],
        [
            "deacal simulate --rig my-robot/rig.toml --params out/robot/parameters.toml --drive sine:peak_V=5500,hz=0.3 -o out/twin",
            "deacal simulate --rig my-robot/rig.toml --params out/robot/parameters.toml --voltage voltage.csv -o out/twin",
        ],
    ),
    (
        &["validate"],
        [
            "deacal validate my-robot/04 --params out/robot/parameters.toml",
            "deacal validate my-robot/04 --params out/film/parameters.toml --params out/robot/parameters.toml",
        ],
    ),
    (
        &["diagnose"],
        [
            "deacal diagnose my-robot/01 my-robot/02 my-robot/03 --holdout my-robot/04 -o out/diagnose",
            "deacal diagnose my-axis/01 my-axis/02 --only joint_friction,x_backlash",
        ],
    ),
    (
        &["causes"],
        ["deacal causes", "deacal causes series_resistance"],
    ),
    (
        &["prove"],
        [
            "deacal prove --number 20 --seed 7 -o out/prove",
            "deacal prove --rigs line --kinds clean,single",
        ],
    ),
    (
        &["ageing"],
        [
            "deacal ageing day-1/a day-5/a day-20/a -o out/ageing",
            "deacal ageing batch-1/a batch-2/a --by batch",
        ],
    ),
    (
        &["batch"],
        [
            "deacal batch films/ -o out/films",
            "deacal batch plan.toml --diagnose --shard 3/12 -o out/films",
        ],
    ),
    (
        &["merge"],
        ["deacal merge out/films", "deacal merge out/prove --json"],
    ),
    (
        &["library"],
        ["deacal library", "deacal library twin2026_delta --json"],
    ),
    (
        &["man"],
        [
            "deacal man ~/.local/share/man/man1",
            "deacal man out/man1 --quiet",
        ],
    ),
    (
        &["view"],
        [
            "deacal view my-robot/04 --params out/robot/parameters.toml",
            "deacal view out/diagnose --port 8000",
        ],
    ),
    (
        &["export"],
        [
            "deacal export out/robot/parameters.toml --format m -o parameters.m",
            "deacal export out/robot/parameters.toml --format c --controller --rig my-robot/rig.toml -o robot.h",
        ],
    ),
    (
        &["completions"],
        [
            "deacal completions bash > ~/.local/share/bash-completion/completions/deacal",
            "deacal completions fish > ~/.config/fish/completions/deacal.fish",
        ],
    ),
];

/// The command line with its examples.
pub(super) fn with(mut command: Command) -> Command {
    for (path, examples) in EXAMPLES {
        let text = format!("Examples:\n  {}", examples.join("\n  "));
        command = match path {
            [name] => command.mut_subcommand(name, |c| c.after_help(text)),
            [outer, name] => {
                command.mut_subcommand(outer, |c| c.mut_subcommand(name, |c| c.after_help(text)))
            }
            _ => command,
        };
    }
    command
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;
    use crate::cli::Cli;

    #[test]
    fn every_command_has_examples_that_are_understood() {
        let mut there: Vec<Vec<String>> = Vec::new();
        for outer in Cli::command().get_subcommands() {
            let name = outer.get_name().to_owned();
            let inner: Vec<_> = outer.get_subcommands().map(|c| c.get_name()).collect();
            match inner.is_empty() {
                true => there.push(vec![name]),
                false => there.extend(inner.iter().map(|i| vec![name.clone(), (*i).to_owned()])),
            }
        }
        let mut told: Vec<Vec<String>> = Vec::new();
        for (path, examples) in EXAMPLES {
            told.push(path.iter().map(|p| (*p).to_owned()).collect());
            for example in examples {
                let typed = example.split(" > ").next().unwrap();
                assert!(typed[7..].starts_with(&path.join(" ")), "{example}");
                let parsed = with(Cli::command()).try_get_matches_from(typed.split(' '));
                assert!(parsed.is_ok(), "{example}: {}", parsed.unwrap_err());
            }
        }
        there.sort();
        told.sort();
        assert_eq!(there, told);
    }
}
