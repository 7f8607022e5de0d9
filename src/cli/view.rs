//! `view`: a page on a local port, read-only: reports of a folder, and a recording to look at closely.

use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use serde::Serialize;
use tiny_http::{Header, Method, Request, Response, Server};

use super::progress::Progress;
use super::{Failure, Talk, load, stop};
use crate::jobs::view::{View, views};
use crate::report::html::view::{Link, Shown, view_figure, view_page};
use crate::report::parameter_file::ParameterFile;

/// What to look at.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A recording.toml, a folder that has one, or a folder of results: its pages, and the recordings that
    /// its parameters.toml was made of
    #[arg(value_name = "REC|DIR")]
    what: PathBuf,
    /// Parameters to hold against the recording: prediction, difference, and their causes to switch off one
    /// by one (of a folder: its parameters.toml)
    #[arg(long)]
    params: Option<PathBuf>,
    /// Rig to use instead of the recording's own
    #[arg(long)]
    rig: Option<PathBuf>,
    /// Port on 127.0.0.1 (default: a free one, which is said)
    #[arg(long, default_value_t = 0, hide_default_value = true)]
    port: u16,
}

/// Requests that are answered at a time: a prediction that takes long does not keep drawings from coming.
const WORKERS: usize = 4;
/// Folders below the given one in which pages are looked for.
const DEEP: usize = 4;
/// What a browser may do with a page: nothing that leaves this port.
const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; \
     img-src 'self' data:; connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'";

/// What is served.
struct Site {
    /// The folder of the pages, where there is one; nothing outside is.
    root: Option<PathBuf>,
    page: String,
    views: Vec<View>,
}

/// Where the page is, as `--json` gives it.
#[derive(Serialize)]
struct Where {
    url: String,
    recordings: Vec<String>,
    pages: Vec<String>,
}

/// What `--json` and a page need of the prediction.
#[derive(Serialize)]
struct Told {
    causes: Vec<String>,
    says: String,
}

pub(super) fn run(a: &Arguments, talk: Talk) -> Result<(), Failure> {
    let progress = Progress::new(talk);
    let is_recording = a.what.is_file() || a.what.join("recording.toml").is_file();
    let (root, links) = match is_recording {
        true => (None, Vec::new()),
        false => pages_of(&a.what)?,
    };
    let params = a.params.clone().or_else(|| {
        let own = a.what.join("parameters.toml");
        (!is_recording && own.is_file()).then_some(own)
    });
    let file = params.map(|p| load::parameters(&p)).transpose()?;
    let paths = match &file {
        _ if is_recording => vec![a.what.clone()],
        Some(file) => made_of(file),
        None => Vec::new(),
    };
    if paths.is_empty() && links.is_empty() {
        return Err(format!(
            "{}: no recording.toml, no page (.html) and no parameters.toml of recordings that are here: give a recording or a folder of results",
            a.what.display()
        )
        .into());
    }
    let recordings = load::opened(&paths, a.rig.as_ref(), &progress)?;
    let views = views(recordings, file.as_ref(), &progress)?;
    let shown: Vec<Shown> = views.iter().map(View::shown).collect();
    let first = views.first().map_or_else(String::new, |v| {
        view_figure(v.measured(), v.shown().span, &|_| true, v.title())
    });
    let name = a.what.canonicalize().ok();
    let name = name.as_deref().and_then(Path::file_name);
    let title = match shown.as_slice() {
        [only] => only.id.clone(),
        _ => name.map_or("deacal".into(), |n| n.to_string_lossy().into_owned()),
    };
    let site = Site {
        page: view_page(&title, &links, &shown, &first),
        root,
        views,
    };
    drop(progress);
    let server = Server::http(("127.0.0.1", a.port)).map_err(|e| {
        let port = a.port;
        format!("port {port} of 127.0.0.1 cannot be opened: {e}; leave --port out, or give another")
    })?;
    let host = server.server_addr().to_string();
    let url = format!("http://{host}/");
    stop::instead("the page is closed, nothing was written".into());
    talk.answer(&format!("Open {url} in a browser; Ctrl-C ends it."));
    talk.result(&Where {
        url,
        recordings: shown.iter().map(|s| s.id.clone()).collect(),
        pages: links.iter().map(|l| l.name.clone()).collect(),
    });
    std::thread::scope(|scope| {
        for _ in 0..WORKERS {
            scope.spawn(|| {
                server
                    .incoming_requests()
                    .for_each(|r| serve(r, &site, &host))
            });
        }
    });
    Ok(())
}

/// The folder as it is on the disk, and the pages in it: what it leads to by name.
fn pages_of(dir: &Path) -> Result<(Option<PathBuf>, Vec<Link>), Failure> {
    let root = (dir.canonicalize()).map_err(|e| {
        let at = dir.display();
        format!("{at}: {e}: name a recording, or a folder of results")
    })?;
    let mut found = Vec::new();
    walk(&root, DEEP, &mut found);
    found.sort_by_key(|p| (p.components().count(), p.clone()));
    let link = |p: &PathBuf| {
        let below = p.strip_prefix(&root).unwrap_or(p);
        let names: Vec<String> = (below.components())
            .map(|c| c.as_os_str().to_string_lossy().into_owned())
            .collect();
        let name = match names.as_slice() {
            [folders @ .., last] if last == "report.html" && !folders.is_empty() => {
                folders.join("/")
            }
            all => all.join("/"),
        };
        let path = names.iter().map(|n| encoded(n)).collect::<Vec<_>>();
        Link {
            path: path.join("/"),
            name,
        }
    };
    let links = found.iter().map(link).collect();
    Ok((Some(root), links))
}

fn walk(dir: &Path, deep: usize, out: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(dir) else {
        return;
    };
    for path in entries.filter_map(|e| e.ok().map(|e| e.path())) {
        let hidden = |n: &std::ffi::OsStr| n.as_encoded_bytes().starts_with(b".");
        if path.file_name().is_none_or(hidden) {
            continue;
        }
        if path.extension().is_some_and(|e| e == "html") {
            out.push(path);
        } else if deep > 0 && path.is_dir() && !path.is_symlink() {
            walk(&path, deep - 1, out);
        }
    }
}

/// The recordings that parameters were made of, as far as they are where they were.
fn made_of(file: &ParameterFile) -> Vec<PathBuf> {
    let all = file.provenance.recordings.iter();
    let manifests = all.filter_map(|r| r.files.iter().find(|f| f.role == "manifest"));
    manifests
        .map(|f| PathBuf::from(&f.file))
        .filter(|p| p.is_file())
        .collect()
}

/// What is answered: type and bytes, or a status and why.
type Answer = Result<(&'static str, Vec<u8>), (u16, String)>;

fn serve(request: Request, site: &Site, host: &str) {
    let (status, kind, bytes) = match answer(&request, site, host) {
        Ok((kind, bytes)) => (200, kind, bytes),
        Err((status, why)) => (status, "text/plain; charset=utf-8", why.into_bytes()),
    };
    let fields = [
        ("Content-Type", kind),
        ("Content-Security-Policy", POLICY),
        ("X-Content-Type-Options", "nosniff"),
        ("Cross-Origin-Resource-Policy", "same-origin"),
        ("Referrer-Policy", "no-referrer"),
        ("Cache-Control", "no-store"),
    ];
    let mut response = Response::from_data(bytes).with_status_code(status);
    for header in fields.map(|(name, value)| Header::from_bytes(name, value)) {
        header.into_iter().for_each(|h| response.add_header(h));
    }
    // a browser that went away is nothing to tell
    let _ = request.respond(response);
}

/// Looks at a request: it has to ask, of this very port by its own name, for something that is here.
fn answer(request: &Request, site: &Site, host: &str) -> Answer {
    if !matches!(request.method(), Method::Get | Method::Head) {
        return Err((405, "this page is only read".into()));
    }
    // a page from elsewhere whose name was made to lead here has another host
    let asked = request.headers().iter().find(|h| h.field.equiv("Host"));
    let asked = asked.map_or("", |h| h.value.as_str());
    if asked != host && asked != host.replace("127.0.0.1", "localhost") {
        return Err((403, format!("ask for http://{host}/")));
    }
    let (path, query) = request.url().split_once('?').unwrap_or((request.url(), ""));
    match path {
        "/" => Ok(("text/html; charset=utf-8", site.page.clone().into_bytes())),
        "/figures" | "/prediction" | "/motion" => {
            let wrong = || (400, format!("{path} cannot be asked with `{query}`"));
            let asked = Asked::of(query, &site.views).ok_or_else(wrong)?;
            let said = match path {
                "/figures" => asked.figures(),
                "/prediction" => asked.prediction(),
                _ => asked.motion(),
            };
            said.map_err(|why| (422, why.to_string()))
        }
        _ => {
            let missing = || (404, format!("{path} is not here"));
            let below = path.strip_prefix("/files/").ok_or_else(missing)?;
            let file = within(site.root.as_deref(), below).ok_or_else(missing)?;
            let bytes = std::fs::read(&file).map_err(|why| (404, format!("{path}: {why}")))?;
            Ok((kind_of(&file), bytes))
        }
    }
}

/// The file of a folder that a path below it names; `None` for anything outside, and what is hidden.
fn within(root: Option<&Path>, below: &str) -> Option<PathBuf> {
    let below = PathBuf::from(decoded(below)?);
    let plain =
        |c: Component| matches!(c, Component::Normal(n) if !n.as_encoded_bytes().starts_with(b"."));
    if !below.components().all(plain) {
        return None;
    }
    // a link may lead out of the folder
    let file = root?.join(below).canonicalize().ok()?;
    (file.starts_with(root?) && file.is_file()).then_some(file)
}

fn kind_of(file: &Path) -> &'static str {
    let ending = file.extension().and_then(|e| e.to_str()).unwrap_or("");
    match ending {
        "html" => "text/html; charset=utf-8",
        "json" => "application/json",
        "png" => "image/png",
        "svg" => "image/svg+xml",
        "csv" | "toml" | "md" | "txt" | "m" | "py" | "h" | "c" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

/// A name as a part of an address.
fn encoded(name: &str) -> String {
    let mut out = String::new();
    for b in name.bytes() {
        match b {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' => {
                out.push(b.into())
            }
            _ => {
                let _ = write!(out, "%{b:02X}");
            }
        }
    }
    out
}

/// What a part of an address means; `None` where it means nothing.
fn decoded(text: &str) -> Option<String> {
    let mut out = Vec::new();
    let mut rest = text.bytes();
    while let Some(b) = rest.next() {
        out.push(match b {
            b'%' => {
                let digits = [rest.next()?, rest.next()?];
                u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?
            }
            b => b,
        });
    }
    String::from_utf8(out).ok().filter(|t| !t.contains('\0'))
}

/// What is asked of a recording.
struct Asked<'a> {
    view: &'a View,
    span: [f64; 2],
    /// Actuators that are not wanted have a 0 at their place.
    actuators: &'a str,
    /// Causes at work, as 1 and 0; `None`: nothing of a prediction.
    causes: Option<&'a str>,
}

impl<'a> Asked<'a> {
    fn of(query: &'a str, views: &'a [View]) -> Option<Self> {
        let value = |name: &str| {
            let mut parts = query.split('&').filter_map(|p| p.split_once('='));
            parts.find(|p| p.0 == name).map(|p| p.1)
        };
        let view = views.get(value("recording")?.parse::<usize>().ok()?)?;
        let whole = view.shown().span;
        let at = |name: &str, all: f64| value(name).map_or(Some(all), |t| t.parse().ok());
        let span =
            [at("from", whole[0])?, at("to", whole[1])?].map(|t| t.clamp(whole[0], whole[1]));
        (span[1] > span[0]).then_some(Asked {
            view,
            span,
            actuators: value("actuators").unwrap_or(""),
            causes: value("causes"),
        })
    }

    fn figures(&self) -> Result<(&'static str, Vec<u8>), Failure> {
        let wanted = |k: usize| self.actuators.as_bytes().get(k) != Some(&b'0');
        let title = self.view.title();
        let drawn = match self.causes {
            None => view_figure(self.view.measured(), self.span, &wanted, title),
            Some(causes) => {
                let with: Vec<bool> = causes.bytes().map(|b| b != b'0').collect();
                let found = self.view.predicted(&with)?;
                view_figure(&found.drawings, self.span, &wanted, title)
            }
        };
        Ok(("text/html; charset=utf-8", drawn.into_bytes()))
    }

    fn prediction(&self) -> Result<(&'static str, Vec<u8>), Failure> {
        let told = Told {
            says: self.view.predicted(&[])?.says.clone(),
            causes: self.view.causes(),
        };
        Ok(("application/json", serde_json::to_vec(&told)?))
    }

    fn motion(&self) -> Result<(&'static str, Vec<u8>), Failure> {
        let [from, to] = self.span;
        let found = self
            .view
            .motion(from, to)
            .ok_or("this recording is of no robot")?;
        Ok(("application/json", serde_json::to_vec(&found)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_outside_the_folder_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path().canonicalize().unwrap().join("in");
        std::fs::create_dir_all(root.join("a b")).unwrap();
        for file in ["in/a b/r\u{e9}.html", "in/.secret", "out.html"] {
            std::fs::write(dir.path().join(file), "x").unwrap();
        }
        let found = |path: &str| within(Some(&root), path).is_some();
        assert!(found("a%20b/r%C3%A9.html") && found("a b/r\u{e9}.html"));
        assert!(found(&format!("a%20b/{}", encoded("r\u{e9}.html"))));
        for path in [
            "../out.html",
            "%2e%2e/out.html",
            "a b/../../out.html",
            "/etc/passwd",
            "",
            "a b",
            ".",
            ".secret",
            "a%2",
            "%ff",
            "a b/r\u{e9}.html%00",
            "%2fetc%2fpasswd",
            "..%2fout.html",
        ] {
            assert!(!found(path), "{path}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(dir.path().join("out.html"), root.join("link.html"))
                .unwrap();
            assert!(!found("link.html"));
        }
        assert!(within(None, "a b").is_none());
    }
}
