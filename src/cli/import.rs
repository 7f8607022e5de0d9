//! `import`: what is in a recording or a file.

use std::path::{Path, PathBuf};

use super::progress::Progress;
use super::{Failure, Talk, finding_line, load};
use crate::calibration::{Outcome, Request, Stage, calibrate_robot};
use crate::checks::{Grade, check};
use crate::dataset::{Dataset, OffsetSource};
use crate::model::Robot;
use crate::recording::{Kind, Level, ReadOptions, Recording, Rig, RobotRig, Survey, survey_file};
use crate::report::arrays::{ArrayFormat, Arrays};
use crate::report::html::number;
use crate::report::json::{
    AlignedJson, ChannelJson, FindingJson, ImportFile, ImportJson, ImportRecording, to_text,
};
use crate::report::output::{OutputSet, Overwrite, write_atomic};
use crate::report::provenance::Provenance;
use crate::report::{csv, mcap, survey, terminal};

/// What to import.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// recording.toml files, folders that have one, or bare files of any known format
    #[arg(required = true, value_name = "REC|FILE")]
    paths: Vec<PathBuf>,
    /// Folder for the results
    #[arg(short, long, default_value = "out/import")]
    output: PathBuf,
    /// Of bare files, write a recording.toml to start from, beside the first of them; none that is there is
    /// overwritten. The columns of a table without a header are called by number
    #[arg(long)]
    init: bool,
    /// Also leave the aligned recording as mat (MATLAB) or npz (NumPy)
    #[arg(long, value_name = "FORMAT", value_parser = ["mat", "npz"])]
    also: Vec<String>,
}

pub(super) fn run(a: &Arguments, command: &str, talk: Talk) -> Result<(), Failure> {
    if a.init {
        init_target(&a.paths)?;
    }
    let progress = Progress::new(talk);
    let mut set = OutputSet::new(&a.output, talk.overwrite())?;
    let mut provenance = Provenance::new(command);
    let (mut recordings, mut files) = (Vec::new(), Vec::new());
    let (mut lines, mut surveys) = (Vec::new(), Vec::new());
    for path in &a.paths {
        progress.reading(format!("reading {}", path.display()));
        if is_recording(path) {
            load::whole(path)?;
            let recording = Recording::open(path)?;
            provenance.add(&recording);
            let first = lines.len();
            let json = one(
                &recording,
                &a.also,
                &mut set,
                &provenance,
                &progress,
                &mut lines,
            )?;
            lines.insert(first, headline(&json));
            recordings.push(json);
        } else {
            // to start from, a table without a header will do: its columns have numbers
            let options = ReadOptions {
                columns: a.init.then(Vec::new),
                ..ReadOptions::default()
            };
            let survey = survey_file(path, None, &options)?;
            let says = survey::lines(path, &survey).into_iter().enumerate();
            lines.extend(says.map(|(i, line)| match i {
                // a path stays as it is
                0 => line,
                _ => number::words(&line),
            }));
            files.push(ImportFile::new(path, &survey));
            surveys.push((path, survey));
        }
    }
    let json = ImportJson {
        recordings,
        files,
        provenance,
    };
    set.write("import.json", to_text(&json))?;
    set.commit()?;
    if a.init {
        let target = init_target(&a.paths)?;
        init(&target, &surveys)?;
        lines.push(format!(
            "A start is written: {}; check its lines with a question mark",
            target.display()
        ));
    }
    drop(progress);
    talk.result(&json);
    if a.paths.len() > 1 {
        lines.insert(0, summary(&json, &surveys));
    }
    for (i, line) in lines.iter().enumerate() {
        match i {
            0 => talk.headline(line),
            _ => talk.say(line),
        }
    }
    talk.say(&format!("Written to {}", a.output.display()));
    Ok(())
}

/// Where a `recording.toml` to start from goes: beside the first bare file.
fn init_target(paths: &[PathBuf]) -> Result<PathBuf, Failure> {
    let Some(first) = paths.iter().find(|p| !is_recording(p)) else {
        return Err(
            "--init needs a bare file, not a recording: name the files that the instruments wrote"
                .into(),
        );
    };
    let target = first.with_file_name("recording.toml");
    if target.exists() {
        let path = target.display();
        return Err(format!(
            "{path}: is there already, and --init overwrites nothing; move it away first"
        )
        .into());
    }
    Ok(target)
}

/// Writes a `recording.toml` to start from.
fn init(target: &Path, surveys: &[(&PathBuf, Survey)]) -> Result<(), Failure> {
    let dir = target.parent().unwrap_or(Path::new(""));
    let files: Vec<(String, &Survey)> = surveys
        .iter()
        .map(|(path, survey)| {
            let inside = path.strip_prefix(dir).ok().map(Path::to_owned);
            let name =
                inside.unwrap_or_else(|| std::path::absolute(path).unwrap_or((*path).clone()));
            (name.display().to_string(), survey)
        })
        .collect();
    // a folder holds one recording; its files have the same names in each
    let folder = std::path::absolute(target).ok();
    let folder = folder
        .as_deref()
        .and_then(Path::parent)
        .and_then(Path::file_name);
    let id = folder.map_or("recording".into(), |name| name.to_string_lossy());
    Ok(write_atomic(
        target,
        Overwrite::Own,
        survey::manifest(&id, &files),
    )?)
}

/// The clock offset and skew that events or a shared channel told.
fn measured_offset(dataset: &Dataset) -> String {
    let Some(sync) = &dataset.plan.sync else {
        return String::new();
    };
    let error = |e: Option<f64>, scale: f64| match e {
        Some(e) => format!("standard error {:.3}", e * scale),
        None => "standard error unknown".to_owned(),
    };
    format!(
        "  clock offset {:.3} ms, {} ms; skew {:.2} ppm, {} ppm (from {})",
        dataset.offset_s * 1e3,
        error(sync.offset_std_error_s, 1e3),
        sync.skew_ppm,
        error(sync.skew_std_error_ppm, 1.0),
        sync.method
    )
}

fn is_recording(path: &Path) -> bool {
    path.is_dir()
        || path.file_name().is_some_and(|n| n == "recording.toml")
        || path.extension().is_some_and(|e| e == "toml")
}

/// One recording: aligned where it is a robot's, described in any case.
fn one(
    recording: &Recording,
    also: &[String],
    set: &mut OutputSet,
    provenance: &Provenance,
    progress: &Progress,
    lines: &mut Vec<String>,
) -> Result<ImportRecording, Failure> {
    let id = recording.manifest.id.clone();
    let findings = check(recording);
    lines.extend(findings.iter().map(|f| format!("  {}", finding_line(f))));
    lines.extend(
        recording
            .notes
            .iter()
            .filter(|n| n.level == Level::Warning)
            .map(|n| format!("  ! {}", n.text)),
    );
    let wrong = findings.iter().any(|f| f.grade == Grade::Wrong);
    let described = |dataset: Option<&Dataset>| ImportRecording {
        findings: FindingJson::of(&findings),
        ..ImportRecording::new(recording, dataset)
    };
    if recording.manifest.kind != Kind::Robot {
        let json = described(None);
        lines.extend(terminal::columns(&columns(&json)));
        return Ok(json);
    }
    progress.step(format!("smoothing and aligning {id}"));
    let mut dataset = match Dataset::from_recording(recording, None) {
        Ok(dataset) => dataset,
        // what was found says why
        Err(error) if wrong => {
            lines.push(format!("  ! not aligned: {error}"));
            return Ok(described(None));
        }
        Err(error) => return Err(error.into()),
    };
    // A free clock offset is found by fitting the film along with it.
    let mut fitted: Option<Outcome> = None;
    let mut error_s = None;
    if let (OffsetSource::Free, Some(Rig::Robot(rig)), false) =
        (dataset.offset_source, &recording.rig, wrong)
    {
        (dataset, error_s, fitted) = free_offset(recording, dataset, rig, progress, lines)?;
    }
    lines.extend(terminal::columns(&pictures(&dataset)));
    let noise = dataset
        .noise_m()
        .map(|s| format!("{:.3}", s * 1e3))
        .join(", ");
    lines.push(format!("  capture noise {noise} mm (x, y, z)"));
    lines.push(offset_line(&dataset, error_s));
    lines.extend(dataset.notes.iter().map(|note| format!("  ! {note}")));
    set.write_with(&format!("{id}.csv"), |out| {
        csv::aligned(out, &dataset, dataset.offset_s)
    })?;
    let prediction = fitted.as_ref().map(|f| &f.recordings[0]);
    set.write_with(&format!("{id}.mcap"), |out| {
        mcap::aligned(out, &dataset, prediction, provenance)
    })?;
    for name in also {
        if let Some(format) = ArrayFormat::of_extension(name) {
            set.write_with(&format!("{id}.{name}"), |mut out| {
                Arrays::of(&dataset, prediction).write(format, &mut out)
            })?;
        }
    }
    let mut json = described(Some(&dataset));
    json.aligned = Some(AlignedJson::new(&dataset, error_s));
    Ok(json)
}

/// The dataset with its clock offset found, the standard error of that, and the fit where it saw every frame.
fn free_offset(
    recording: &Recording,
    mut dataset: Dataset,
    rig: &RobotRig,
    progress: &Progress,
    lines: &mut Vec<String>,
) -> Result<(Dataset, Option<f64>, Option<Outcome>), Failure> {
    progress.step(format!(
        "estimating the clock offset of {}",
        recording.manifest.id
    ));
    let robot = Robot::from_rig(rig, None)?;
    let cut = load::cut(&dataset);
    let whole = cut.is_none();
    if let Some((stretches, said)) = cut {
        lines.push(format!(
            "  ! {said}; without a prediction for every frame none is written"
        ));
        // stretches and the whole of a long recording do not stay in memory side by side
        dataset = stretches;
    }
    let request = Request::new(Stage::Robot);
    progress.fit(request.starts);
    let outcome = calibrate_robot(&robot, &[&dataset], &request, &|s| progress.watch(s))?;
    if !whole {
        drop(dataset);
        dataset = Dataset::from_recording(recording, None)?;
    }
    let found = &outcome.recordings[0];
    dataset.offset_s = found.offset_s;
    let error_s = found.offset_std_error_s;
    Ok((dataset, error_s, whole.then_some(outcome)))
}

/// The clock offset, and where it is from.
fn offset_line(dataset: &Dataset, error_s: Option<f64>) -> String {
    match error_s {
        Some(e) => format!(
            "  clock offset {:.2} ms, standard error {:.2} ms (estimated with the film free)",
            dataset.offset_s * 1e3,
            e * 1e3
        ),
        None if dataset.plan.sync.is_some() => measured_offset(dataset),
        None if dataset.offset_source == OffsetSource::Free => {
            "  clock offset not estimated: first mend the recording".to_owned()
        }
        None => format!("  clock offset {:.2} ms (stated)", dataset.offset_s * 1e3),
    }
}

/// What a recording is, how long, how whole, and whether anything looks wrong, in one line.
fn headline(json: &ImportRecording) -> String {
    let length = match (&json.aligned, &json.motion, &json.table) {
        (Some(a), ..) => {
            let missing: usize = a.gaps.iter().map(|g| g.frames).sum();
            let whole = match missing {
                0 => "no frame missing".to_owned(),
                n => format!(
                    "{n} of {} frames missing in {}",
                    a.frames,
                    survey::count(a.gaps.len(), "gap")
                ),
            };
            let rate = a.rate_hz.unwrap_or(f64::NAN);
            let seconds = a.frames as f64 / rate;
            format!(
                "{seconds:.2} s at {} Hz, {whole}",
                number::significant(rate, 4)
            )
        }
        (_, Some(m), _) => format!("{} frames", m.frames),
        (_, _, Some(t)) => format!("{} rows", t.rows),
        _ => String::new(),
    };
    format!(
        "{}: {}, {length}; {}",
        json.id,
        json.kind,
        survey::looks(things(json))
    )
}

/// How many things in a recording look wrong.
fn things(json: &ImportRecording) -> usize {
    json.findings.len() + json.notes.iter().filter(|n| n.level == "warning").count()
}

/// Which of several recordings and files have to be looked at, in one line.
fn summary(json: &ImportJson, surveys: &[(&PathBuf, Survey)]) -> String {
    let recordings = json.recordings.iter().map(|r| (r.id.clone(), things(r)));
    let files = surveys
        .iter()
        .map(|(path, s)| (path.display().to_string(), survey::things(s)));
    let all: Vec<(String, usize)> = recordings.chain(files).collect();
    let odd: Vec<String> = all
        .iter()
        .filter(|(_, things)| *things > 0)
        .map(|(name, things)| format!("{name} ({things})"))
        .collect();
    let what = match (json.recordings.len(), surveys.len()) {
        (n, 0) => survey::count(n, "recording"),
        (0, n) => survey::count(n, "file"),
        (n, m) => format!(
            "{} and {}",
            survey::count(n, "recording"),
            survey::count(m, "file")
        ),
    };
    match odd.len() {
        0 => format!("{what}: nothing looks wrong"),
        _ => format!("{what}: look at {}", odd.join(", ")),
    }
}

/// Motion and voltages of a robot on one clock, one row each: name, range, curve.
fn pictures(d: &Dataset) -> Vec<[String; 3]> {
    let mut rows = Vec::new();
    let mut add = |name: String, values: &[f64], unit: &str| {
        let range = terminal::range(values.iter().copied(), unit);
        rows.push([name, range, terminal::curve(values, terminal::WIDTH)]);
    };
    for (k, axis) in ["x", "y", "z"].into_iter().enumerate().rev() {
        let values: Vec<f64> = d.measured_m.iter().map(|p| p[k]).collect();
        add(axis.to_owned(), &values, "m");
    }
    for k in 0..3 {
        let values: Vec<f64> = (0..d.samples())
            .map(|i| d.command_v(k, i, d.offset_s))
            .collect();
        add(format!("voltage {}", k + 1), &values, "V");
    }
    rows
}

/// The columns of other recordings, one row each: name, range, empty cells.
fn columns(json: &ImportRecording) -> Vec<[String; 3]> {
    let logs = [&json.table, &json.voltage, &json.monitor];
    let channels = logs.into_iter().flatten().flat_map(|log| &log.channels);
    let row = |c: &ChannelJson| {
        let range = c.range.map_or_else(String::new, |ends| {
            format!("{} {}", terminal::range(ends.into_iter(), ""), c.unit)
        });
        let missing = match c.missing {
            0 => String::new(),
            n => format!("{n} empty cells"),
        };
        [c.label.clone(), range, missing]
    };
    channels.map(row).collect()
}
