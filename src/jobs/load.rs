//! From paths to what a job works on.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{Failure, Progress};
use crate::checks::{Finding, check_all, check_parameters};
use crate::dataset::line::Line;
use crate::dataset::{Dataset, HangingDataset, Plan, StretchPlan, stretches, tell_wander};
use crate::model::{Electrode, HangingSample, Robot};
use crate::recording::{ColumnRef, Kind, OpenOptions, Recording, Rig, RobotRig, read_file};
use crate::report::library;
use crate::report::output::settle;
use crate::report::parameter_file::ParameterFile;
use crate::report::plan_file::read_plan;
use crate::report::provenance::Provenance;
use crate::simulate::{Hold, PlannedPath, Sampled};

/// Opens recordings, all of one kind.
pub(crate) fn recordings(
    paths: &[PathBuf],
    rig: Option<&PathBuf>,
    kind: Kind,
    progress: &Progress,
) -> Result<Vec<Recording>, Failure> {
    recordings_of(paths, rig, &[kind], progress)
}

/// Opens recordings, all of one kind, which is among `kinds`.
pub(crate) fn recordings_of(
    paths: &[PathBuf],
    rig: Option<&PathBuf>,
    kinds: &[Kind],
    progress: &Progress,
) -> Result<Vec<Recording>, Failure> {
    let all = opened(paths, rig, progress)?;
    of_one_kind(&all, kinds)?;
    Ok(all)
}

/// Opens recordings of any kind, with another rig than their own where one is given.
///
/// # Errors
/// A file cannot be read, with its place and what to do.
pub fn opened(
    paths: &[PathBuf],
    rig: Option<&PathBuf>,
    progress: &Progress,
) -> Result<Vec<Recording>, Failure> {
    progress.reading(format!("reading {} recording(s)", paths.len()));
    paths.iter().chain(rig).try_for_each(|p| whole(p))?;
    let options = OpenOptions { rig: rig.cloned() };
    let all = paths
        .par_iter()
        .map(|p| Recording::open_with(p, &options))
        .collect::<Result<_, _>>()?;
    Ok(all)
}

/// Which `deacal fit` is that of a kind of recording.
pub(crate) fn fit_of(kind: Kind) -> &'static str {
    match kind {
        Kind::Robot => "robot",
        Kind::FilmSample => "sample",
        Kind::FilmCoupon => "coupon",
        Kind::HingeBench => "hinge",
        Kind::Axis => "axis",
    }
}

/// Refuses recordings that are not of one kind among `kinds`, or of which two have one id.
///
/// # Errors
/// The first that is, and what to give instead.
pub fn of_one_kind(all: &[Recording], kinds: &[Kind]) -> Result<(), Failure> {
    for r in all {
        let kind = r.manifest.kind;
        if !kinds.contains(&kind) {
            let names: Vec<&str> = kinds.iter().map(|k| k.name()).collect();
            let (found, wanted) = (kind.name(), names.join("\" or \""));
            let path = r.path.display();
            return Err(format!(
                "{path}: recording `{}` is of kind \"{found}\", this command works on \"{wanted}\": `deacal fit {}` fits it",
                r.manifest.id,
                fit_of(kind)
            )
            .into());
        }
    }
    if let Some(other) = all.iter().find(|r| r.manifest.kind != all[0].manifest.kind) {
        return Err(format!(
            "recordings `{}` and `{}` are of kinds \"{}\" and \"{}\": give recordings of one kind at a time",
            all[0].manifest.id,
            other.manifest.id,
            all[0].manifest.kind.name(),
            other.manifest.kind.name()
        )
        .into());
    }
    for (i, r) in all.iter().enumerate() {
        if let Some(earlier) = all[..i].iter().find(|e| e.manifest.id == r.manifest.id) {
            if earlier.path == r.path {
                let path = r.path.display();
                return Err(format!("{path} is named twice: name each recording once").into());
            }
            return Err(format!(
                "{} and {} have the same id `{}`: give each recording its own",
                earlier.path.display(),
                r.path.display(),
                r.manifest.id
            )
            .into());
        }
    }
    Ok(())
}

/// What a job works on.
#[derive(Debug, Clone)]
pub struct Given {
    /// The recordings, none a copy of another one.
    pub recordings: Vec<Recording>,
    /// How many of them, from the first on, were not asked to be held out.
    pub named: usize,
    /// What to say of copies that were left out.
    pub copies: Vec<String>,
    /// What is wrong with the recordings, or looks so; see [`Given::look_over`].
    pub findings: Vec<Finding>,
    /// What a result of it is made of.
    pub provenance: Provenance,
}

impl Given {
    /// Of recordings, the first `named` of which were not asked to be held out. `command` is what a result
    /// states of how it was made.
    #[must_use]
    pub fn new(all: Vec<Recording>, named: usize, command: &str) -> Self {
        let (recordings, named, copies) = distinct(all, named);
        Given {
            provenance: Provenance::of(command, &recordings),
            findings: Vec::new(),
            recordings,
            named,
            copies,
        }
    }

    /// The same with what is wrong with the recordings.
    #[must_use]
    pub fn look_over(mut self, progress: &Progress) -> Self {
        progress.step("looking at wiring, axes, units and clocks");
        self.findings = check_all(&self.recordings);
        self
    }
}

/// Recordings without copies of one another, and what to say of those that were left out. The same motion and
/// voltage under another id is no further evidence: fifty copies would make every interval seven times too
/// narrow. Of the first `named` recordings that many stay.
fn distinct(all: Vec<Recording>, named: usize) -> (Vec<Recording>, usize, Vec<String>) {
    let sums: Vec<String> = all.par_iter().map(Recording::content_sum).collect();
    let ids: Vec<String> = all.iter().map(|r| r.manifest.id.clone()).collect();
    let (mut kept, mut still_named, mut remarks) = (Vec::new(), 0, Vec::new());
    for (i, r) in all.into_iter().enumerate() {
        if let Some(first) = sums[..i].iter().position(|s| *s == sums[i]) {
            remarks.push(format!(
                "{} holds the very numbers of {}: a copy is no further evidence, and it was left out.",
                ids[i], ids[first]
            ));
        } else {
            still_named += usize::from(i < named);
            kept.push(r);
        }
    }
    (kept, still_named, remarks)
}

/// Ends what a run was putting in place in the folder of `path`, where it was cut off in the middle.
pub(crate) fn whole(path: &Path) -> Result<(), Failure> {
    let folder = if path.is_dir() {
        path
    } else {
        path.parent().unwrap_or(Path::new(""))
    };
    Ok(settle(folder)?)
}

/// Choices of an earlier run, of its `plan.toml` where one is given.
///
/// # Errors
/// The file cannot be read.
pub fn plans(path: Option<&PathBuf>) -> Result<Vec<Plan>, Failure> {
    Ok(path.map(|p| read_plan(p)).transpose()?.unwrap_or_default())
}

/// Smooths and aligns robot recordings, with the choices of a `plan.toml` where one is given.
pub(crate) fn datasets(
    recordings: &[Recording],
    plan: Option<&PathBuf>,
    progress: &Progress,
) -> Result<Vec<Dataset>, Failure> {
    aligned(recordings, &plans(plan)?, progress)
}

/// Smooths and aligns robot recordings, making the choices of `plans` again: one dataset each, in SI.
///
/// # Errors
/// A recording that cannot be aligned: no common time, units or axes that cannot be.
pub fn aligned(
    recordings: &[Recording],
    plans: &[Plan],
    progress: &Progress,
) -> Result<Vec<Dataset>, Failure> {
    progress.step("smoothing and aligning");
    let mut all = recordings
        .par_iter()
        .map(|r| Dataset::from_recording(r, plans.iter().find(|p| p.recording == r.manifest.id)))
        .collect::<Result<Vec<_>, _>>()?;
    tell_wander(&mut all);
    Ok(all)
}

/// Cuts the recordings that are longer than a fit holds into stretches, and says so.
pub(crate) fn cut_all(datasets: &mut [Dataset]) -> Vec<String> {
    let plans = stretches(&datasets.iter().collect::<Vec<_>>());
    let mut remarks = Vec::new();
    for (d, plan) in datasets.iter_mut().zip(plans) {
        if let Some(plan) = plan {
            let (cut, said) = cut_as(d, plan);
            remarks.push(format!("{}: {said}.", d.id));
            *d = cut;
        }
    }
    remarks
}

/// Of the stretches that a fit holds, one in so many tells a clock offset to far below a sample.
const OF_OFFSET: usize = 4;

/// A recording alone in stretches that tell its clock offset, where it is longer than a fit holds, and what
/// to say of it.
pub(crate) fn cut(dataset: &Dataset) -> Option<(Dataset, String)> {
    let plan = stretches(&[dataset]).remove(0)?;
    let count = plan.count.div_ceil(OF_OFFSET);
    Some(cut_as(dataset, StretchPlan { count, ..plan }))
}

fn cut_as(dataset: &Dataset, plan: StretchPlan) -> (Dataset, String) {
    let said = format!(
        "{:.2} h are more than a fit holds, so it compares {} stretches of {:.0} s, spread evenly over the recording; the film's history \
         runs through all of it",
        dataset.length_s() / 3600.0,
        plan.count,
        plan.length_s
    );
    (dataset.in_stretches(plan), said)
}

/// Recordings of a bench, an axis or coupons, in SI units with their noise.
pub(crate) fn lines(recordings: &[Recording], progress: &Progress) -> Result<Vec<Line>, Failure> {
    progress.step("measuring noise and bandwidth");
    let all = recordings
        .par_iter()
        .map(Line::from_recording)
        .collect::<Result<Vec<_>, _>>()?;
    Ok(all)
}

/// The rig that all recordings share.
pub(crate) fn rig(recordings: &[Recording]) -> Result<&RobotRig, Failure> {
    let mut found: Option<(&Recording, &RobotRig)> = None;
    for r in recordings {
        let Some(Rig::Robot(rig)) = &r.rig else {
            return Err(format!(
                "{}: recording `{}` has no robot rig",
                r.path.display(),
                r.manifest.id
            )
            .into());
        };
        match found {
            None => found = Some((r, rig)),
            Some((first, known)) if known != rig => {
                return Err(format!(
                    "recordings `{}` and `{}` are of different rigs (`{}` and `{}`): fit them apart, or give one with --rig",
                    first.manifest.id, r.manifest.id, known.id, rig.id
                )
                .into());
            }
            Some(_) => {}
        }
    }
    found
        .map(|f| f.1)
        .ok_or_else(|| "no recording was given".into())
}

/// The robot of a rig, with the permittivity of a parameter file where that has one.
pub(crate) fn robot(rig: &RobotRig, parameters: Option<&ParameterFile>) -> Result<Robot, Failure> {
    Ok(Robot::from_rig(
        rig,
        parameters.and_then(ParameterFile::eps_r),
    )?)
}

/// Hanging samples, aligned, with geometry and mass of each rig and the electrode of a parameter file where
/// there is one.
pub(crate) fn samples(
    recordings: &[Recording],
    parameters: Option<&ParameterFile>,
) -> Result<(Vec<HangingDataset>, Vec<HangingSample>), Failure> {
    let electrode = match parameters {
        Some(file) => file.electrode()?,
        None => Electrode::IDEAL,
    };
    let mut samples = Vec::new();
    let mut datasets = Vec::new();
    for r in recordings {
        let Some(Rig::FilmSample(rig)) = &r.rig else {
            return Err(format!(
                "{}: recording `{}` has no rig of kind \"film-sample\"",
                r.path.display(),
                r.manifest.id
            )
            .into());
        };
        let dataset = HangingDataset::from_recording(r)?;
        let eps_r = parameters.and_then(ParameterFile::eps_r);
        let sample = HangingSample::from_rig(rig, eps_r, dataset.payload_kg)?;
        samples.push(HangingSample {
            electrode,
            ..sample
        });
        datasets.push(dataset);
    }
    Ok((datasets, samples))
}

/// Reads a parameter file, or a parameter set that comes with the program (`library:NAME`).
///
/// # Errors
/// The file cannot be read, or holds numbers that cannot be; the library has no such set.
pub fn parameters(path: &Path) -> Result<ParameterFile, Failure> {
    if let Some(found) = library::text(path) {
        let (path, text) = found?;
        return parameters_of_text(&path, text);
    }
    whole(path)?;
    sound(path, ParameterFile::read(path)?)
}

/// The parameter file that `text` is of.
///
/// # Errors
/// As [`parameters`], under the name `path`.
pub fn parameters_of_text(path: &Path, text: &str) -> Result<ParameterFile, Failure> {
    sound(path, ParameterFile::parse(path, text)?)
}

fn sound(path: &Path, file: ParameterFile) -> Result<ParameterFile, Failure> {
    file.known_causes()?;
    if let Ok(parameters) = file.parameters()
        && let Some(wrong) =
            check_parameters(&path.display().to_string(), &parameters, file.eps_r()).first()
    {
        return Err(wrong.line().into());
    }
    Ok(file)
}

/// A table's rising time_s and its columns, each named by the first of its alternatives that is there. An
/// empty cell is an error.
fn table<const N: usize>(
    path: &Path,
    columns: [&[(&str, f64)]; N],
) -> Result<(Vec<f64>, Vec<[f64; N]>), Failure> {
    let capture = read_file(path)?;
    let wanted = format!(
        "a table with time_s, {}",
        columns.map(|c| c[0].0).join(", ")
    );
    let find = |names: &[(&str, f64)]| {
        let mut first = None;
        for (name, factor) in names {
            match capture.find_column(path, &ColumnRef::Name((*name).into())) {
                Ok(place) => return Ok((place, *factor)),
                Err(error) => first = first.or(Some(error)),
            }
        }
        let none = || Failure::from("no column is asked for");
        Err(first.map_or_else(none, |e| e.expected(&wanted).into()))
    };
    let time = find(&[("time_s", 1.0)])?.0;
    let mut places = [(time, 1.0); N];
    for (place, names) in places.iter_mut().zip(columns) {
        *place = find(names)?;
    }
    let section = &capture.sections[time.0];
    let times = section.columns[time.1].values.clone();
    let mut rows = Vec::with_capacity(times.len());
    for (i, t) in times.iter().enumerate() {
        let row = places.map(|((s, c), factor)| {
            let values = &capture.sections[s].columns[c].values;
            factor * values.get(i).copied().unwrap_or(f64::NAN)
        });
        if t.is_nan() || row.iter().any(|v| v.is_nan()) {
            return Err(format!(
                "{}:{}: the row has an empty cell: every row needs its time and {}",
                path.display(),
                section.lines.line(i),
                if N == 1 { "its value" } else { "three values" }
            )
            .into());
        }
        rows.push(row);
    }
    Ok((times, rows))
}

/// A planned path: CSV with time_s and x_mm, y_mm, z_mm (or x_m, y_m, z_m).
///
/// # Errors
/// The file cannot be read, a column is not there, a cell is empty, times do not rise.
pub fn path(file: &Path) -> Result<PlannedPath, Failure> {
    let columns: [&[(&str, f64)]; 3] = [
        &[("x_mm", 1e-3), ("x_m", 1.0)],
        &[("y_mm", 1e-3), ("y_m", 1.0)],
        &[("z_mm", 1e-3), ("z_m", 1.0)],
    ];
    let (time_s, position_m) = table(file, columns)?;
    PlannedPath::new(time_s, position_m).map_err(|e| format!("{}: {e}", file.display()).into())
}

/// A voltage table: CSV with time_s and phi1_kV, phi2_kV, phi3_kV (or phi1_V, ...), its first row as time 0.
pub(crate) fn voltage(file: &Path, hold: Hold) -> Result<Sampled, Failure> {
    let columns: [&[(&str, f64)]; 3] = [
        &[("phi1_kV", 1e3), ("phi1_V", 1.0)],
        &[("phi2_kV", 1e3), ("phi2_V", 1.0)],
        &[("phi3_kV", 1e3), ("phi3_V", 1.0)],
    ];
    let (time_s, phi_v) = table(file, columns)?;
    log(file, time_s, phi_v, hold)
}

/// A voltage table of a hanging sample: CSV with time_s and phi_kV or phi_V (a robot's first channel will
/// do), its first row as time 0.
pub(crate) fn sample_voltage(file: &Path, hold: Hold) -> Result<Sampled, Failure> {
    let names: &[(&str, f64)] = &[
        ("phi_kV", 1e3),
        ("phi_V", 1.0),
        ("phi1_kV", 1e3),
        ("phi1_V", 1.0),
    ];
    let (time_s, phi_v) = table(file, [names])?;
    log(
        file,
        time_s,
        phi_v.iter().map(|&[v]| [v; 3]).collect(),
        hold,
    )
}

fn log(
    file: &Path,
    time_s: Vec<f64>,
    phi_v: Vec<[f64; 3]>,
    hold: Hold,
) -> Result<Sampled, Failure> {
    let first = time_s.first().copied().unwrap_or(0.0);
    let time_s: Vec<f64> = time_s.iter().map(|t| t - first).collect();
    Sampled::from_log(&time_s, phi_v, hold).map_err(|e| format!("{}: {e}", file.display()).into())
}

/// Endings by which other programs open a file.
const ENDINGS: [&str; 20] = [
    "csv", "json", "m", "py", "c", "h", "mat", "npz", "npy", "mcap", "xlsx", "xls", "ods", "html",
    "pdf", "h5", "parquet", "c3d", "tdms", "toml",
];

/// Refuses a file to be written whose ending says that it is of another kind than those that `what` is
/// written as.
pub(crate) fn ending(path: &Path, what: &str, fits: &[&str]) -> Result<(), Failure> {
    let ending = path
        .extension()
        .map_or(String::new(), |e| e.to_string_lossy().to_ascii_lowercase());
    if fits.contains(&ending.as_str()) || !ENDINGS.contains(&ending.as_str()) {
        return Ok(());
    }
    let mut fits: Vec<String> = fits.iter().map(|e| format!(".{e}")).collect();
    fits.dedup();
    Err(format!(
        "{}: {what} is not written as .{ending}; name a file that ends in {}",
        path.display(),
        fits.join(" or ")
    )
    .into())
}
