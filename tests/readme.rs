//! The examples of the README are read by the program that it describes.

use std::path::Path;

use deacal::recording::{Kind, Manifest, Rig};

#[test]
fn recording_and_rig_of_the_readme_are_read() {
    let text = include_str!("../README.md");
    let examples: Vec<&str> = text
        .split("```toml\n")
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap())
        .collect();
    let [recording, rig] = examples[..] else {
        panic!("{} examples", examples.len());
    };
    let manifest = Manifest::parse(Path::new("recording.toml"), recording).unwrap();
    assert_eq!(manifest.kind, Kind::Robot);
    assert!(manifest.motion.is_some() && manifest.voltage.is_some());
    let rig = Rig::parse(Path::new("rig.toml"), rig).unwrap();
    assert!(matches!(rig, Rig::Robot(_)));
}
