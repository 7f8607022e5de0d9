//! A release is where `cargo binstall` looks for it, and has everything in it.

use std::path::{Path, PathBuf};
use std::process::Command;

use deacal::recording::sha256;

const VERSION: &str = env!("CARGO_PKG_VERSION");

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The target triples of the workflow.
fn targets() -> Vec<String> {
    let text = std::fs::read_to_string(root().join(".github/workflows/release.yml")).unwrap();
    let archives = text.split("\n  wheel:\n").next().unwrap();
    let of = |line: &str| {
        let (_, rest) = line.split_once("{ target: ")?;
        Some(rest.split(',').next()?.to_owned())
    };
    archives.lines().filter_map(of).collect()
}

/// Where binstall looks for the archive of a target, below the release, and for the program in it.
fn looked_for(target: &str) -> (String, String) {
    let text = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let cargo: toml::Value = toml::from_str(&text).unwrap();
    let all = &cargo["package"]["metadata"]["binstall"];
    let own = all["overrides"].get(target).unwrap_or(all);
    let (suffix, ending) = match own["pkg-fmt"].as_str().unwrap() {
        "tgz" => (".tar.gz", ""),
        "zip" => (".zip", ".exe"),
        other => panic!("{other}"),
    };
    let filled = |key: &str| {
        let pairs = [
            ("name", "deacal"),
            ("version", VERSION),
            ("target", target),
            ("archive-suffix", suffix),
            ("bin", "deacal"),
            ("binary-ext", ending),
        ];
        let template = all[key].as_str().unwrap().to_owned();
        pairs.iter().fold(template, |text, (name, value)| {
            text.replace(&format!("{{ {name} }}"), value)
        })
    };
    let url = filled("pkg-url");
    let place = format!("{{ repo }}/releases/download/v{VERSION}/");
    let archive = url.strip_prefix(&place).unwrap_or_else(|| panic!("{url}"));
    (archive.to_owned(), filled("bin-dir"))
}

/// Packs the program for a target; the archive, or nothing where there is no Python.
fn packed(target: &str, program: &Path, out: &Path) -> Option<PathBuf> {
    let mut python = Command::new("python3");
    let script = root().join(".github/archive");
    python.arg(script).arg(program).arg(target).arg(out);
    let Ok(done) = python.output() else {
        eprintln!("skipped: no python3 here");
        return None;
    };
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{said}");
    Some(out.join(String::from_utf8(done.stdout).unwrap().trim()))
}

/// What a folder holds, below it.
fn below(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap();
    let each = entries.flat_map(|e| {
        let path = e.unwrap().path();
        match path.is_dir() {
            true => below(&path),
            false => vec![path],
        }
    });
    each.collect()
}

#[test]
fn archives_are_where_binstall_looks_and_have_everything() {
    let targets = targets();
    assert_eq!(targets.len(), 5, "{targets:?}");
    for part in [
        "x86_64-unknown-linux",
        "aarch64-unknown-linux",
        "x86_64-apple",
        "aarch64-apple",
        "windows",
    ] {
        assert!(targets.iter().any(|t| t.contains(part)), "{part}");
    }
    let dir = tempfile::tempdir().unwrap();
    for target in &targets {
        let (archive, program) = looked_for(target);
        // the program of this machine stands for that of each
        let own = dir.path().join(target);
        std::fs::create_dir(&own).unwrap();
        let built = own.join(Path::new(&program).file_name().unwrap());
        std::fs::copy(env!("CARGO_BIN_EXE_deacal"), &built).unwrap();
        let Some(found) = packed(target, &built, &own) else {
            return;
        };
        assert_eq!(found.file_name().unwrap().to_str().unwrap(), archive);
        let sum = std::fs::read_to_string(own.join(format!("{archive}.sha256"))).unwrap();
        assert_eq!(sum, format!("{}  {archive}\n", sha256(&found).unwrap()));
        let unpack = "import shutil, sys; shutil.unpack_archive(sys.argv[1], sys.argv[2])";
        let whole = own.join("unpacked");
        let done = Command::new("python3")
            .args(["-c", unpack])
            .args([&found, &whole])
            .status();
        assert!(done.unwrap().success());
        let folder = whole.join(program.split('/').next().unwrap());
        assert_eq!(std::fs::read_dir(&whole).unwrap().count(), 1, "one folder");
        assert_eq!(
            sha256(&whole.join(&program)).unwrap(),
            sha256(&built).unwrap()
        );
        for name in ["README.md", "CHANGELOG.md", "LICENSE-APACHE", "LICENSE-MIT"] {
            let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
            assert!(read(&folder) == read(root()), "{name}");
        }
        for name in ["deacal.bash", "_deacal", "deacal.fish", "_deacal.ps1"] {
            let text = std::fs::read_to_string(folder.join("completions").join(name)).unwrap();
            assert!(text.contains("diagnose"), "{name}");
        }
        let pages = below(&folder.join("man"));
        assert!(pages.len() > 25, "{}", pages.len());
        assert!(pages.contains(&folder.join("man/man1/deacal-fit-film.1")));
        assert!(
            pages
                .iter()
                .all(|p| p.extension().is_some_and(|e| e == "1")),
            "{pages:?}"
        );
        assert_eq!(below(&folder).len(), pages.len() + 4 + 4 + 1);
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let program = dir
            .path()
            .join(&targets[0])
            .join("unpacked")
            .join(looked_for(&targets[0]).1);
        assert_eq!(
            std::fs::metadata(&program).unwrap().permissions().mode() & 0o111,
            0o111
        );
    }
}
