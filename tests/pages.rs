//! What README and `docs/` say is so: examples are read, commands are known and run, links lead somewhere,
//! and the pages of studies are those that the program makes. Reports are looked at in a browser, where there
//! is one.

mod common;

use std::path::{Path, PathBuf};

use deacal::recording::{Manifest, Rig};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// README and the pages of `docs/`, with their text.
fn pages() -> Vec<(PathBuf, String)> {
    let mut files = vec![root().join("README.md")];
    let docs = std::fs::read_dir(root().join("docs/src")).unwrap();
    files.extend(docs.map(|e| e.unwrap().path()));
    files.sort();
    let read = |f: PathBuf| {
        let text = std::fs::read_to_string(&f).unwrap();
        (f, text)
    };
    files.into_iter().map(read).collect()
}

/// The blocks of a page in a language.
fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    text.split(&format!("```{language}\n"))
        .skip(1)
        .map(|rest| rest.split("```").next().unwrap())
        .collect()
}

#[test]
fn examples_are_read() {
    let (mut manifests, mut rigs) = (Vec::new(), 0);
    for (file, text) in pages() {
        for example in blocks(&text, "toml") {
            if example.contains("[recording]") {
                let read = Manifest::parse(Path::new("recording.toml"), example);
                let kind = read.map(|m| m.kind.name());
                manifests.push(kind.unwrap_or_else(|e| panic!("{}: {e}", file.display())));
            } else {
                let read = Rig::parse(Path::new("rig.toml"), example);
                read.unwrap_or_else(|e| panic!("{}: {e}", file.display()));
                rigs += 1;
            }
        }
    }
    let kinds = ["robot", "film-coupon", "hinge-bench", "axis"];
    assert_eq!((manifests, rigs), (kinds.to_vec(), 2));
}

#[test]
fn commands_are_known_with_their_options() {
    let mut checked = 0;
    for (file, text) in pages() {
        let lines = blocks(&text, "sh").into_iter().flat_map(str::lines);
        for line in lines {
            let command = line.split('#').next().unwrap();
            let Some((_, after)) = command.split_once("deacal ") else {
                continue;
            };
            let words: Vec<&str> = after.split_whitespace().collect();
            let two = matches!(words[0], "fit" | "predict");
            let own = &words[..if two { 2 } else { 1 }];
            let help = common::run(|deacal| deacal.args(own).arg("--help"));
            let help = String::from_utf8(help).unwrap();
            for option in words.iter().filter(|w| w.starts_with('-')) {
                assert!(
                    help.contains(option),
                    "{}: {option} in `{line}`",
                    file.display()
                );
            }
            checked += 1;
        }
    }
    assert!(checked > 12, "{checked}");
}

#[test]
fn links_lead_somewhere() {
    for (file, text) in pages() {
        for link in text.split("](").skip(1) {
            let link = link.split(')').next().unwrap();
            let path = link.split('#').next().unwrap();
            if link.contains("://") || path.is_empty() {
                continue;
            }
            let there = file.parent().unwrap().join(path);
            assert!(there.exists(), "{}: {link}", file.display());
        }
    }
    let list = std::fs::read_to_string(root().join("docs/src/SUMMARY.md")).unwrap();
    for (file, _) in pages() {
        let name = file.file_name().unwrap().to_str().unwrap();
        let listed = list.contains(&format!("({name})"));
        assert!(
            listed || ["README.md", "SUMMARY.md"].contains(&name),
            "{name}"
        );
    }
}

#[test]
fn the_readme_is_read_in_one_sitting() {
    let text = std::fs::read_to_string(root().join("README.md")).unwrap();
    assert!(text.lines().count() <= 150);
}

/// The first hour as it is typed, and then the page that goes on from it.
#[cfg(unix)]
#[test]
fn the_first_hour_runs() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("datasets")).unwrap();
    let twin = "datasets/twin2026_delta";
    std::os::unix::fs::symlink(root().join(twin), dir.path().join(twin)).unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_deacal")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let page = |name: &str| std::fs::read_to_string(root().join("docs/src").join(name)).unwrap();
    let text = page("first-hour.md") + &page("controller.md");
    for block in blocks(&text, "sh") {
        let done = std::process::Command::new("sh")
            .args(["-e", "-c", block])
            .current_dir(dir.path())
            .env("PATH", &path)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{block}: {said}");
    }
    let left = [
        "film/report.html",
        "forearm/parameters.toml",
        "validate/validation.json",
        "diagnose/diagnosis.json",
        "parameters.m",
        "voltage.csv",
        "robot.h",
        "robot.m",
        "robot.py",
    ];
    for file in left {
        assert!(dir.path().join("out/hour").join(file).is_file(), "{file}");
    }
    let read = |file: &str| {
        let bytes = std::fs::read(dir.path().join("out/hour").join(file)).unwrap();
        serde_json::from_slice::<serde_json::Value>(&bytes).unwrap()
    };
    assert_eq!(read("diagnose/diagnosis.json")["verdict"], "adequate");
    for job in ["film", "forearm", "validate", "diagnose"] {
        look(&dir.path().join("out/hour").join(job).join("report.html"));
    }
}

#[test]
fn reports_are_whole_in_a_browser() {
    for entry in std::fs::read_dir(root().join("reports")).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|e| e == "html") {
            look(&file);
        }
    }
}

/// Opens a page in a browser, where there is one.
fn browse(page: &Path, what: &str) -> Option<std::process::Output> {
    let user = tempfile::tempdir().unwrap();
    let open = |browser: &&str| {
        std::process::Command::new(browser)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", what])
            .args(["--allow-file-access-from-files", "--enable-logging=stderr"])
            .args(["--virtual-time-budget=10000", "--window-size=1280,1000"])
            .arg(format!("--user-data-dir={}", user.path().display()))
            .arg(format!("file://{}", page.display()))
            .output()
            .ok()
    };
    let browsers = ["chromium", "chromium-browser", "google-chrome"];
    browsers.iter().find_map(open)
}

#[test]
fn the_demo_is_printed_on_eight_pages() {
    let dir = tempfile::tempdir().unwrap();
    let pdf = dir.path().join("demo.pdf");
    let print = format!("--print-to-pdf={}", pdf.display());
    if browse(&root().join("reports/demo.html"), &print).is_none() {
        eprintln!("skipped: no browser prints the demo");
        return;
    }
    let bytes = std::fs::read(&pdf).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    let sheets = text.matches("/Type /Page\n").count();
    assert!((1..=8).contains(&sheets), "{sheets}");
}

/// Width of a small phone, pixels of the style sheet.
const PHONE: u32 = 390;

/// Opens a report on a phone, where there is a browser: it is no wider than the screen and nothing is an
/// error.
fn look(page: &Path) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::copy(page, dir.path().join("report.html")).unwrap();
    let frame = format!(
        "<!DOCTYPE html><iframe id=\"of\" style=\"width:{PHONE}px;height:844px;border:0\"></iframe><script>\
         const of = document.getElementById('of');\
         of.onload = () => {{ document.title = 'wide ' + of.contentDocument.documentElement.scrollWidth; }};\
         of.src = 'report.html';</script>"
    );
    std::fs::write(dir.path().join("frame.html"), frame).unwrap();
    let Some(done) = browse(&dir.path().join("frame.html"), "--dump-dom") else {
        eprintln!("skipped: no browser looks at {}", page.display());
        return;
    };
    let dom = String::from_utf8_lossy(&done.stdout);
    let wide = dom
        .split("<title>wide ")
        .nth(1)
        .and_then(|t| t.split('<').next());
    let wide: u32 = wide
        .and_then(|w| w.parse().ok())
        .unwrap_or_else(|| panic!("{}: {dom}", page.display()));
    assert!(
        wide <= PHONE,
        "{}: {wide} pixels wide on a phone",
        page.display()
    );
    let said = String::from_utf8_lossy(&done.stderr);
    let errors: Vec<&str> = said.lines().filter(|l| l.contains("CONSOLE")).collect();
    assert!(errors.is_empty(), "{}: {errors:?}", page.display());
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
            '\u{2212}' if !tag => out.push('-'),
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
    let root = root();
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
