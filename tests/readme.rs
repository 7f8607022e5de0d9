//! The examples of the README are read by the program that it describes.

mod common;

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

/// Text of a page: tags taken out, entities as characters, digits without their narrow spaces.
fn text_of(page: &str) -> String {
    let mut out = String::new();
    let mut tag = false;
    for c in page.chars() {
        match c {
            '<' => tag = true,
            '>' => tag = false,
            '\u{202f}' => {}
            c if !tag => out.push(c),
            _ => {}
        }
    }
    let entities = [
        ("&#x2f;", "/"),
        ("&#x27;", "'"),
        ("&quot;", "\""),
        ("&lt;", "<"),
        ("&gt;", ">"),
        ("&amp;", "&"),
    ];
    entities
        .iter()
        .fold(out, |text, (from, to)| text.replace(from, to))
}

#[test]
fn pages_of_studies_say_what_the_program_says() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let studies: [(&str, &[&str], bool); 5] = [
        (
            "silverbox2013",
            &[
                "fits/silverbox2013/multisine",
                "--holdout",
                "fits/silverbox2013/arrow",
            ],
            false,
        ),
        ("miles2015_vhb4910", &["datasets/miles2015_vhb4910"], false),
        ("laminate_hinge_32_10", &["fits/laminate_hinge/32_10"], true),
        ("laminate_hinge_16_10", &["fits/laminate_hinge/16_10"], true),
        ("rack_pinion", &["fits/rack_pinion/a3"], true),
    ];
    for (name, arguments, beside) in studies {
        if beside && !root.join("../shared/datasets/real").is_dir() {
            eprintln!(
                "skipped: {name} needs recordings beside the project that are not part of it"
            );
            continue;
        }
        let out = tempfile::tempdir().unwrap();
        common::run(|deacal| {
            deacal
                .current_dir(root)
                .arg("diagnose")
                .args(arguments)
                .args(["-q", "-o"])
                .arg(out.path())
        });
        let json = std::fs::read_to_string(out.path().join("diagnosis.json")).unwrap();
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let says = json["says"].as_str().unwrap();
        let page = std::fs::read_to_string(root.join(format!("reports/{name}.html"))).unwrap();
        let text = text_of(&page);
        for sentence in says.split(". ") {
            let sentence = sentence.trim_end_matches('.');
            assert!(
                text.contains(sentence),
                "reports/{name}.html does not say `{sentence}`: make it anew with `deacal diagnose {} --rivals`",
                arguments.join(" ")
            );
        }
    }
}
