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
    let is_page = |f: &PathBuf| f.extension().is_some_and(|e| e == "md");
    files.extend(docs.map(|e| e.unwrap().path()).filter(is_page));
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

/// Commands of a page, from the word behind `deacal` on: lines of its blocks for a shell, and what stands
/// within the text as code.
fn commands(text: &str) -> Vec<String> {
    let lines = blocks(text, "sh").into_iter().flat_map(str::lines);
    let typed = lines.filter_map(|l| Some(l.split('#').next()?.split_once("deacal ")?.1));
    // without the blocks every other piece is code
    let outside = text.split("```").step_by(2);
    let code = outside.flat_map(|t| t.split('`').skip(1).step_by(2));
    let named = code.filter_map(|c| c.strip_prefix("deacal "));
    typed.chain(named).map(str::to_owned).collect()
}

#[test]
fn commands_are_known_with_their_options() {
    let is_option = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
    let cut = |text: &str| -> Vec<String> {
        let words = text.split(|c| !is_option(c)).filter(|w| !w.is_empty());
        words.map(str::to_owned).collect()
    };
    let mut helps = std::collections::BTreeMap::new();
    let (mut typed, mut checked) = (0, 0);
    let written = ["README.md", "CONTRIBUTING.md", "python/README.md"];
    let mut texts: Vec<_> = written.map(|f| root().join(f)).to_vec();
    texts.extend(pages().into_iter().map(|(file, _)| file));
    for file in texts {
        let text = std::fs::read_to_string(&file).unwrap();
        typed += blocks(&text, "sh").len();
        for command in commands(&text) {
            let words = cut(&command);
            let two = matches!(words[0].as_str(), "fit" | "predict");
            let names = words.iter().take(if two { 2 } else { 1 });
            // `deacal --help`, and `deacal fit --help` of all fits
            let own: Vec<String> = names.take_while(|w| !w.starts_with('-')).cloned().collect();
            let help = helps.entry(own.clone()).or_insert_with(|| {
                let help = common::run(|deacal| deacal.args(&own).arg("--help"));
                cut(&String::from_utf8(help).unwrap())
            });
            for option in words.iter().filter(|w| w.starts_with('-') && w.len() > 1) {
                let place = file.display();
                assert!(help.contains(option), "{place}: {option} in `{command}`");
            }
            checked += 1;
        }
    }
    assert!(typed > 12 && checked > 100, "{typed} {checked}");
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

/// What they print is held against what is stored by `python/notebooks/run`.
#[test]
fn notebooks_are_stored_with_what_they_show() {
    let folder = root().join("python/notebooks");
    let page = std::fs::read_to_string(root().join("docs/src/notebooks.md")).unwrap();
    let entries = std::fs::read_dir(&folder).unwrap();
    let mut count = 0;
    for file in entries.map(|e| e.unwrap().path()) {
        if file.extension().is_none_or(|e| e != "ipynb") {
            continue;
        }
        count += 1;
        let place = file.display();
        let name = file.file_name().unwrap().to_str().unwrap();
        assert!(page.contains(&format!("notebooks/{name})")), "{place}");
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.len() < 300_000, "{place}: {} bytes", text.len());
        let book: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(book["nbformat"], 4, "{place}");
        let (mut runs, mut drawings) = (0, 0);
        for cell in book["cells"].as_array().unwrap() {
            if cell["cell_type"] != "code" {
                continue;
            }
            runs += 1;
            assert_eq!(cell["execution_count"], runs, "{place}: {cell}");
            for output in cell["outputs"].as_array().unwrap() {
                assert_ne!(output["output_type"], "error", "{place}: {output}");
                assert_ne!(output["name"], "stderr", "{place}: {output}");
                drawings += usize::from(output["data"]["image/png"].is_string());
            }
        }
        assert!(runs >= 8 && drawings >= 2, "{place}: {runs} {drawings}");
    }
    assert_eq!(count, 4);
}

#[test]
fn the_readme_is_read_in_one_sitting() {
    let text = std::fs::read_to_string(root().join("README.md")).unwrap();
    assert!(text.lines().count() <= 150);
}

/// The first hour as it is typed, and then the pages that go on from it.
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
    let after = ["controller.md", "how-to.md", "library.md"].map(page);
    let text = page("first-hour.md") + &after.concat();
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
        let done = look(&dir.path().join("out/hour").join(job).join("report.html"));
        // all zero where there is no browser
        assert!(
            done == [0; 3] || done.iter().all(|n| *n > 2),
            "{job}: {done:?}"
        );
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
fn browse(page: &Path, what: &[&str]) -> Option<std::process::Output> {
    let address = format!("file://{}", page.display());
    let user = tempfile::tempdir().unwrap();
    let open = |mut browser: std::process::Command| {
        let browser = browser.arg("--virtual-time-budget=10000").args(what);
        browser.arg(&address).output().ok()
    };
    browsers(user.path()).find_map(open)
}

/// The browsers that there may be, with what they keep in `user`.
fn browsers(user: &Path) -> impl Iterator<Item = std::process::Command> {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    names.into_iter().map(move |name| {
        let mut browser = std::process::Command::new(name);
        browser
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--hide-scrollbars",
            ])
            .args(["--allow-file-access-from-files", "--enable-logging=stderr"])
            .arg("--window-size=1280,1000")
            .arg(format!("--user-data-dir={}", user.display()));
        browser
    })
}

#[test]
fn the_demo_is_printed_on_eight_pages() {
    if let Some(sheets) = printed(&root().join("reports/demo.html")) {
        assert!((1..=8).contains(&sheets), "{sheets}");
    }
}

/// Sheets of A4 that a page fills, where there is a browser: no heading and no caption of a table ends one.
fn printed(page: &Path) -> Option<usize> {
    let dir = tempfile::tempdir().unwrap();
    let pdf = dir.path().join("page.pdf");
    let print = format!("--print-to-pdf={}", pdf.display());
    browse(page, &[&print])?;
    let bytes = std::fs::read(&pdf).unwrap();
    let text: String = bytes.iter().map(|b| char::from(*b)).collect();
    let print = Print::read(&text);
    let orphans = print.orphans();
    assert!(orphans.is_empty(), "{}: {orphans:?}", page.display());
    assert!(
        print.pieces.len() > 20,
        "{}: nothing is tagged",
        page.display()
    );
    Some(text.matches("/Type /Page\n").count())
}

/// Pieces of text of a tagged PDF in the order of the page: what they stand in, and their sheet.
struct Print {
    pieces: Vec<(String, usize)>,
}

impl Print {
    /// From the tree of structure, which Chromium writes as plain text.
    fn read(pdf: &str) -> Print {
        let mut elements = std::collections::BTreeMap::new();
        for piece in pdf
            .split("\nendobj")
            .filter(|p| p.contains("/Type /StructElem"))
        {
            let Some((head, body)) = piece.rsplit_once(" 0 obj\n") else {
                continue;
            };
            let number = head.rsplit('\n').next().unwrap();
            elements.insert(number.trim().parse::<usize>().unwrap(), body);
        }
        let mut print = Print { pieces: Vec::new() };
        let roots: Vec<usize> = elements
            .iter()
            .filter(|(_, body)| Print::kind(body) == "Document")
            .map(|(number, _)| *number)
            .collect();
        for root in roots {
            print.walk(&elements, root, "");
        }
        print
    }

    fn kind(body: &str) -> &str {
        let rest = body.split_once("/S /").map_or("", |(_, rest)| rest);
        rest.split(|c: char| !c.is_alphanumeric()).next().unwrap()
    }

    /// The sheet that a piece of an element says it is on.
    fn sheet(text: &str) -> Option<usize> {
        let (_, rest) = text.split_once("/Pg ")?;
        rest.split(' ').next()?.parse().ok()
    }

    fn walk(
        &mut self,
        elements: &std::collections::BTreeMap<usize, &str>,
        number: usize,
        within: &str,
    ) {
        let body = elements[&number];
        let kind = match (Print::kind(body), within) {
            (own @ ("H1" | "H2" | "H3"), _) => own,
            // the words below a figure head nothing
            ("Caption", "Table") => "Caption",
            ("Table", _) => "Table",
            ("Figure" | "TR" | "Caption", _) => "",
            _ => within,
        };
        let Some((before, children)) = body.split_once("/K ") else {
            return;
        };
        let own = Print::sheet(before).or_else(|| Print::sheet(children.split(']').nth(1)?));
        let mut rest = children.trim_start_matches('[');
        while let Some(c) = rest.chars().next() {
            let (piece, after) = match c {
                '<' => rest.split_once(">>").unwrap(),
                '0'..='9' => {
                    let end = rest.find([' ', ']', '\n', '>']).unwrap_or(rest.len());
                    match rest[end..].strip_prefix(" 0 R") {
                        Some(after) => {
                            let child = rest[..end].parse().unwrap();
                            if elements.contains_key(&child) {
                                self.walk(elements, child, kind);
                            }
                            rest = after;
                            continue;
                        }
                        None => rest.split_at(end),
                    }
                }
                ' ' | '\n' => ("", &rest[1..]),
                _ => break,
            };
            if let Some(sheet) = Print::sheet(piece).or(own).filter(|_| !piece.is_empty()) {
                self.pieces.push((kind.to_owned(), sheet));
            }
            rest = after;
        }
    }

    /// Headings with nothing below them on their sheet.
    fn orphans(&self) -> Vec<String> {
        let heads = |p: &&[(String, usize)]| {
            ["H1", "H2", "H3", "Caption"].contains(&p[0].0.as_str())
                && p[0].0 != p[1].0
                && p[0].1 != p[1].1
        };
        let pairs = self.pieces.windows(2).filter(heads);
        pairs.map(|p| format!("{p:?}")).collect()
    }
}

#[test]
fn a_heading_at_the_foot_of_a_sheet_is_seen() {
    let piece = |kind: &str, sheet| (kind.to_owned(), sheet);
    let print = |pieces| Print { pieces }.orphans().len();
    assert_eq!(print(vec![piece("H2", 1), piece("", 2)]), 1);
    assert_eq!(print(vec![piece("H2", 1), piece("", 1), piece("", 2)]), 0);
    let text = "1 0 obj\n<</Type /StructElem\n/S /Document\n/K [2 0 R 3 0 R]>>\nendobj\n\
                2 0 obj\n<</Type /StructElem\n/S /H2\n/P 1 0 R\n/Pg 7 0 R\n/K 4>>\nendobj\n\
                3 0 obj\n<</Type /StructElem\n/S /P\n/P 1 0 R\n/K [<</Type /MCR\n/Pg 9 0 R\n/MCID 1>> \
                <</Type /MCR\n/Pg 9 0 R\n/MCID 2>>]>>\nendobj\n";
    let read = Print::read(text);
    assert_eq!(read.pieces, [piece("H2", 7), piece("", 9), piece("", 9)]);
    assert_eq!(read.orphans().len(), 1);
}

/// Opens a report where there is a browser, on a phone and on a desk, light and dark and printed: no wider
/// than the screen, no blank row, every text to be read, every axis with its unit, nothing is an error
/// (`scripts/look.js` has the bars); drawings zoom and tell values, and their curves hide. Returns the numbers
/// of drawings that were zoomed, of those that told a value of a curve, and of entries of legends.
fn look(page: &Path) -> [u64; 3] {
    let mut tried = [0; 3];
    let dir = tempfile::tempdir().unwrap();
    std::fs::copy(page, dir.path().join("report.html")).unwrap();
    let script = include_str!("scripts/look.js");
    let frame =
        format!("<!DOCTYPE html><body><pre id=\"told\"></pre><script>{script}</script></body>");
    std::fs::write(dir.path().join("frame.html"), frame).unwrap();
    // the first is dark, in Chromium's words
    for (scheme, dark) in [("0", true), ("1", false)] {
        let scheme = format!("--blink-settings=preferredColorScheme={scheme}");
        let Some(done) = browse(&dir.path().join("frame.html"), &["--dump-dom", &scheme]) else {
            eprintln!("skipped: no browser looks at {}", page.display());
            return tried;
        };
        let said = String::from_utf8_lossy(&done.stderr);
        let errors: Vec<&str> = said.lines().filter(|l| l.contains("CONSOLE")).collect();
        assert!(errors.is_empty(), "{}: {errors:?}", page.display());
        let dom = String::from_utf8_lossy(&done.stdout);
        let told = dom.split("<pre id=\"told\">").nth(1);
        let told = text_of(told.and_then(|t| t.split("</pre>").next()).unwrap_or(""));
        let told: serde_json::Value = serde_json::from_str(&told)
            .unwrap_or_else(|why| panic!("{}: {why}: {dom}", page.display()));
        for (width, seen) in told.as_object().unwrap() {
            let place = format!("{} at {width} px, dark: {dark}", page.display());
            let wide = seen["wide"].as_u64().unwrap();
            assert!(wide <= width.parse().unwrap(), "{place}: {wide} px wide");
            assert_eq!(seen["dark"], dark, "{place}");
            for fault in ["blank", "pale", "bare", "faults"] {
                let found = seen[fault].as_array().unwrap();
                assert!(found.is_empty(), "{place}: {fault}: {found:?}");
            }
            tried = ["zoomed", "curves", "hidden"].map(|what| seen[what].as_u64().unwrap());
        }
    }
    printed(page);
    tried
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
            '\u{a0}' if !tag => out.push(' '),
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

/// A page on a port of its own, and what it posts there.
fn served(page: String) -> (String, std::sync::mpsc::Receiver<String>) {
    let server = tiny_http::Server::http("127.0.0.1:0").unwrap();
    let address = format!("http://{}/", server.server_addr().to_ip().unwrap());
    let (tell, told) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        for mut asked in server.incoming_requests() {
            if *asked.method() == tiny_http::Method::Post {
                let mut text = String::new();
                let _ = asked.as_reader().read_to_string(&mut text);
                let _ = tell.send(text);
            }
            let html = "Content-Type: text/html".parse::<tiny_http::Header>();
            let page = tiny_http::Response::from_string(page.clone());
            let _ = asked.respond(page.with_header(html.unwrap()));
        }
    });
    (address, told)
}

/// What the script of a page posts when it is done, and what the browser said meanwhile, where there is one.
/// Time is that of the clock, as the page asks another program.
fn told_by(page: String, what: &[&str]) -> Option<(String, String)> {
    let user = tempfile::tempdir().unwrap();
    let said = user.path().join("said.txt");
    let (address, told) = served(page);
    let open = |mut browser: std::process::Command| {
        let browser = browser.args(what).arg(&address);
        let browser = browser.stdout(std::process::Stdio::null());
        let log = std::fs::File::create(&said).unwrap();
        browser.stderr(log).spawn().ok()
    };
    let mut browser = browsers(user.path()).find_map(open)?;
    let told = told.recv_timeout(std::time::Duration::from_secs(180));
    let _ = browser.kill();
    let _ = browser.wait();
    let said = String::from_utf8_lossy(&std::fs::read(&said).unwrap()).into_owned();
    let told = told.unwrap_or_else(|why| panic!("the page told nothing: {why}: {said}"));
    Some((told, said))
}

/// `deacal view` at work, until it is dropped.
struct Viewed {
    child: std::process::Child,
    url: String,
}

impl Viewed {
    fn of(arguments: &[&str]) -> Viewed {
        use std::io::BufRead as _;
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_deacal"))
            .current_dir(root())
            .arg("view")
            .args(arguments)
            .arg("--json")
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        let lines = std::io::BufReader::new(child.stdout.take().unwrap()).lines();
        let url = lines.map(|l| l.unwrap()).find(|l| l.contains("\"url\""));
        let url = url.unwrap().split('"').nth(3).unwrap().to_owned();
        Viewed { child, url }
    }

    /// Status and text of what is answered.
    fn ask(&self, method: &str, path: &str, host: &str) -> (u16, String) {
        use std::io::{Read as _, Write as _};
        let own = self.url.trim_start_matches("http://").trim_end_matches('/');
        let mut to = std::net::TcpStream::connect(own).unwrap();
        let host = if host.is_empty() { own } else { host };
        write!(
            to,
            "{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
        )
        .unwrap();
        let mut said = Vec::new();
        to.read_to_end(&mut said).unwrap();
        let said = String::from_utf8_lossy(&said).into_owned();
        (said[9..12].parse().unwrap(), said)
    }
}

impl Drop for Viewed {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The twin's parameters with two causes, as a file.
fn with_causes(dir: &Path) -> String {
    let own = std::fs::read_to_string(root().join("fits/twin2026_delta/parameters.toml")).unwrap();
    let effects = "[[effect]]\nid = \"series_resistance\"\nactuators = [1, 2, 3]\nresistance = 1e7\n\n\
                   [[effect]]\nid = \"joint_friction\"\nactuators = [2]\ntorque = 1e-5\n\n[provenance]";
    let file = dir.join("parameters.toml");
    std::fs::write(&file, own.replace("[provenance]", effects)).unwrap();
    file.display().to_string()
}

#[test]
fn a_recording_is_looked_at_in_a_browser() {
    let dir = tempfile::tempdir().unwrap();
    let params = with_causes(dir.path());
    let twin = "datasets/twin2026_delta/single-1";
    for (arguments, causes, drawings, moves) in [
        (&[twin, "--params", &params][..], 2, 4, true),
        (
            &[
                "datasets/miles2015_vhb4910",
                "--params",
                "library:miles2015_vhb4910",
            ],
            0,
            2,
            false,
        ),
        (&["fits/silverbox2013/quiet"], 0, 2, false),
    ] {
        let viewed = Viewed::of(arguments);
        let script = include_str!("scripts/view.js");
        let frame = format!(
            "<!DOCTYPE html><body><script>const CAUSES = {causes}, URL_OF_PAGE = {:?};{script}</script></body>",
            viewed.url
        );
        // pages of one machine, which the test lets look into each other; both in sight, as what is not draws
        // no frames
        let what = [
            "--disable-web-security",
            "--disable-site-isolation-trials",
            "--window-size=1280,2000",
        ];
        let Some((told, said)) = told_by(frame, &what) else {
            eprintln!("skipped: no browser looks at {arguments:?}");
            return;
        };
        let errors: Vec<&str> = said.lines().filter(|l| l.contains("CONSOLE")).collect();
        assert!(errors.is_empty(), "{arguments:?}: {errors:?}");
        let told: serde_json::Value = serde_json::from_str(&told).unwrap();
        for width in ["390", "1280"] {
            let seen = &told[width];
            let place = format!("{arguments:?} at {width} px: {seen}");
            assert!(seen["fault"].is_null() && seen.is_object(), "{place}");
            assert_eq!(
                (&seen["drawings"], &seen["moves"]),
                (&drawings.into(), &moves.into()),
                "{place}"
            );
            assert!(seen["first"].as_u64().unwrap() > 0, "{place}");
            assert!(
                seen["wide"].as_u64().unwrap() <= width.parse().unwrap(),
                "{place}"
            );
            assert!(seen["requests"].as_u64().unwrap() > 1, "{place}");
            assert_eq!(seen["elsewhere"].as_array().unwrap().len(), 0, "{place}");
        }
    }
}

#[test]
fn a_view_is_read_from_this_machine_alone_and_stays_in_its_folder() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    std::fs::create_dir_all(out.join("sub folder")).unwrap();
    std::fs::write(dir.path().join("secret.html"), "secret").unwrap();
    std::fs::write(out.join("report.html"), "a report").unwrap();
    std::fs::write(out.join("sub folder/report.html"), "another").unwrap();
    with_causes(&out);
    let viewed = Viewed::of(&[out.to_str().unwrap()]);
    assert!(
        viewed.url.starts_with("http://127.0.0.1:"),
        "{}",
        viewed.url
    );
    let (status, page) = viewed.ask("GET", "/", "");
    assert_eq!(status, 200);
    // the recordings that the parameters were made of are there
    let page = page.replace("&#x2f;", "/");
    for part in [
        "/files/report.html",
        "/files/sub%20folder/report.html",
        "symmetric",
        "single-3",
    ] {
        assert!(page.contains(part), "{part}");
    }
    assert!(page.contains("default-src 'none'"));
    for (path, status) in [
        ("/files/report.html", 200),
        ("/files/sub%20folder/report.html", 200),
        ("/files/../secret.html", 404),
        ("/files/%2e%2e/secret.html", 404),
        ("/files/..%2fsecret.html", 404),
        ("/files//etc/passwd", 404),
        ("/files/sub%20folder", 404),
        ("/elsewhere", 404),
        ("/figures?recording=9", 400),
        ("/figures?recording=0&from=nan&to=nan", 400),
        ("/figures?recording=0&from=5&to=1", 400),
        ("/motion?recording=0&from=0&to=1", 200),
    ] {
        let (found, said) = viewed.ask("GET", path, "");
        assert_eq!(found, status, "{path}: {said}");
        assert!(
            !said.contains("secret.html is") || status == 404,
            "{path}: {said}"
        );
    }
    for method in ["POST", "PUT", "DELETE"] {
        assert_eq!(viewed.ask(method, "/", "").0, 405, "{method}");
    }
    assert_eq!(viewed.ask("GET", "/", "elsewhere.example").0, 403);
}

#[cfg(unix)]
#[test]
fn a_view_ends_as_every_command_does() {
    let mut viewed = Viewed::of(&["datasets/twin2026_delta/single-1"]);
    let id = viewed.child.id().to_string();
    let sent = std::process::Command::new("kill")
        .args(["-INT", &id])
        .status();
    assert!(sent.unwrap().success());
    assert_eq!(viewed.child.wait().unwrap().code(), Some(130));
    let empty = tempfile::tempdir().unwrap();
    let done = std::process::Command::new(env!("CARGO_BIN_EXE_deacal"))
        .args(["view", empty.path().to_str().unwrap()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(said.contains("no recording.toml"), "{said}");
}

#[test]
fn every_command_has_a_page_of_the_manual() {
    let dir = tempfile::tempdir().unwrap();
    let man = dir.path().join("man1");
    common::run(|deacal| deacal.args(["man", man.to_str().unwrap(), "-q"]));
    let read = |name: &str| {
        let file = man.join(format!("{name}.1"));
        std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
    };
    let names = |arguments: &[&str]| -> Vec<String> {
        let help = common::run(|deacal| deacal.args(arguments).arg("--help"));
        let help = String::from_utf8(help).unwrap();
        let list = help.split("Commands:\n").nth(1).unwrap_or("");
        let list = list.split("\n\nOptions:").next().unwrap_or("");
        let first = |l: &str| {
            l.strip_prefix("  ")
                .filter(|l| !l.starts_with(' '))
                .map(str::to_owned)
        };
        let words = list.lines().filter_map(first);
        let words = words.filter_map(|l| l.split(' ').next().map(str::to_owned));
        words.filter(|w| w != "help").collect()
    };
    assert!(read("deacal").contains("deacal\\-view(1)"));
    let mut count = 1;
    for outer in names(&[]) {
        let text = read(&format!("deacal-{outer}"));
        let inner = names(&[&outer]);
        assert!(!inner.is_empty() || text.contains("Examples:"), "{outer}");
        for name in &inner {
            assert!(
                read(&format!("deacal-{outer}-{name}")).contains("Examples:"),
                "{outer} {name}"
            );
        }
        count += 1 + inner.len();
    }
    assert!(count > 25, "{count}");
    assert_eq!(
        std::fs::read_dir(&man)
            .unwrap()
            .filter(|e| {
                let name = e.as_ref().unwrap().file_name();
                name.to_string_lossy().ends_with(".1")
            })
            .count(),
        count
    );
}

#[test]
fn parameter_sets_of_the_library_are_taken_where_a_file_is() {
    let twin = "datasets/twin2026_delta/single-1";
    let voltage = |params: &str| {
        common::run(|deacal| {
            deacal
                .current_dir(root())
                .args(["predict", "voltage", twin, "--params", params])
        })
    };
    let by_name = voltage("library:twin2026_delta");
    assert_eq!(by_name, voltage("fits/twin2026_delta/parameters.toml"));
    common::run(|deacal| deacal.args(["export", "library:silverbox2013", "--format", "json"]));
    let list = common::run(|deacal| deacal.args(["library", "--json"]));
    let list: serde_json::Value = serde_json::from_slice(&list).unwrap();
    let names: Vec<&str> = list
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["name"].as_str().unwrap())
        .collect();
    assert_eq!(
        names,
        ["miles2015_vhb4910", "silverbox2013", "twin2026_delta"]
    );
    for e in list.as_array().unwrap() {
        for key in ["of", "made_by", "source", "licence", "range", "beyond"] {
            assert!(e[key].as_str().is_some_and(|t| t.len() > 10), "{e}: {key}");
        }
    }
    let done = std::process::Command::new(env!("CARGO_BIN_EXE_deacal"))
        .args(["export", "library:twin", "--format", "json"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert_eq!(done.status.code(), Some(1), "{said}");
    assert!(names.iter().all(|n| said.contains(n)), "{said}");
}
