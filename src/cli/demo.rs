//! `demo`: the main job on recordings that come with the program.

use std::path::Path;

use super::fit::{say_fit, write_fit};
use super::progress::Progress;
use super::{Failure, Talk, diagnose, load, series};
use crate::calibration::{CouponRequest, Request, Stage, calibrate_coupons, calibrate_robot};
use crate::dataset::Coupon;
use crate::recording::Kind;
use crate::report::answer::{self, Answer};
use crate::report::html;
use crate::report::json::{FitJson, ModelValidation, ValidationJson, results_to_text};
use crate::report::output::OutputSet;
use crate::report::parameter_file::ParameterFile;
use crate::report::provenance::{FileSum, Provenance};
use crate::validation::validate;

pub(super) fn run(output: &Path, talk: Talk) -> Result<(), Failure> {
    let here = Path::new("datasets");
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets");
    let base = [here, &built]
        .into_iter()
        .find(|d| d.join("twin2026_delta").is_dir())
        .ok_or("the folder `datasets` that comes with the source is not here: run the demo from the project's folder")?;
    let progress = Progress::new(talk);
    let watch = |state: &_| progress.watch(state);

    talk.say("A real film coupon: 3M VHB 4910, pulled to 5.4 times its length and back (Miles et al. 2015)");
    let recordings = load::recordings(
        &[base.join("miles2015_vhb4910")],
        None,
        Kind::FilmCoupon,
        &progress,
    )?;
    let coupon = Coupon::from_recording(&recordings[0])?;
    let request = CouponRequest::new(3);
    progress.fit(request.starts);
    let outcome = calibrate_coupons(&[&coupon], &request, &watch)?;
    let provenance = Provenance::of("deacal demo", &recordings);
    let mut set = OutputSet::new(output.join("coupon"), talk.overwrite())?;
    set.write("report.html", html::render_coupons(&outcome, &provenance))?;
    set.write(
        "fit.json",
        results_to_text(
            "fit.json",
            &FitJson::of_coupons(&outcome, provenance.clone()),
        )?,
    )?;
    set.write(
        "parameters.toml",
        ParameterFile::of_coupons(&outcome, provenance).to_toml()?,
    )?;
    set.commit()?;
    talk.tell(&format!("  {}", Answer::of_coupons(&outcome).says));

    let twin = base.join("twin2026_delta");
    let folders = |names: &[&str]| names.iter().map(|n| twin.join(n)).collect::<Vec<_>>();
    let all = load::recordings(
        &folders(&["symmetric", "single-1", "single-2", "single-3"]),
        None,
        Kind::Robot,
        &progress,
    )?;
    let robot = load::robot(load::rig(&all)?, None)?;
    let datasets = load::datasets(&all, None, &progress)?;
    let refs: Vec<_> = datasets.iter().collect();

    talk.say("\nThe film, from the symmetric drive");
    let request = Request::new(Stage::Film);
    progress.fit(request.starts);
    let film = calibrate_robot(&robot, &refs[..1], &request, &watch)?;
    let answer = Answer::of_robot(&film, &robot);
    talk.tell(&format!("  {}", answer.says));
    let provenance = Provenance::of("deacal demo", &all[..1]);
    write_fit(
        &output.join("film"),
        (&film, &answer),
        &FitJson::new(&film, provenance.clone()),
        provenance,
        &[],
        talk.overwrite(),
    )?
    .commit()?;

    talk.say("\nThe forearms, from one actuator at a time; their hinges are relaxed at 0 degrees");
    let relaxed = vec![("torque_0deg".to_owned(), 0.0)];
    let request = Request {
        start: Some(film.parameters.clone()),
        fix: relaxed.clone(),
        ..Request::new(Stage::Forearm)
    };
    progress.fit(request.starts);
    let forearm = calibrate_robot(&robot, &refs[1..], &request, &watch)?;
    let answer = Answer::of_robot(&forearm, &robot);
    talk.tell(&format!("  {}", answer.says));
    let provenance = Provenance::of("deacal demo", &all[1..]);
    write_fit(
        &output.join("forearm"),
        (&forearm, &answer),
        &FitJson::new(&forearm, provenance.clone()),
        provenance,
        &[],
        talk.overwrite(),
    )?
    .commit()?;

    talk.say("\nBoth, jointly from all four");
    let request = Request {
        start: Some(forearm.parameters.clone()),
        fix: relaxed,
        ..Request::new(Stage::Robot)
    };
    progress.fit(request.starts);
    let joint = calibrate_robot(&robot, &refs, &request, &watch)?;
    let provenance = Provenance::of("deacal demo", &all);
    let fit = FitJson::new(&joint, provenance.clone());
    let answer = Answer::of_robot(&joint, &robot);
    let found = (&joint, &answer);
    write_fit(output, found, &fit, provenance, &[], talk.overwrite())?.commit()?;
    say_fit(&answer, &fit, &answer::remarks(&joint), talk);

    talk.say("\nHeld against a circle that was not fitted");
    let held = load::recordings(&folders(&["circle-3s"]), None, Kind::Robot, &progress)?;
    let circle = load::datasets(&held, None, &progress)?;
    let validation = validate(&robot, &[&circle[0]], &joint.parameters, None, (&[], &[]))?;
    let answer = Answer::of_robot(&validation.outcome, &robot);
    talk.tell(&format!("  {}", answer.says));
    for line in html::validation_words(&validation) {
        talk.say(&format!("  {line}"));
    }
    let provenance = Provenance::of("deacal demo", &held);
    let parameters = output.join("parameters.toml");
    let sum = FileSum {
        role: "parameters".into(),
        sha256: crate::recording::sha256(&parameters)?,
        file: parameters.display().to_string(),
    };
    let json = ValidationJson::new(
        ModelValidation::new(&validation, sum),
        Vec::new(),
        None,
        provenance.clone(),
    );
    let mut set = OutputSet::new(output.join("validation"), talk.overwrite())?;
    set.write(
        "validation.json",
        results_to_text("validation.json", &json)?,
    )?;
    let models = [(parameters.display().to_string(), validation)];
    set.write(
        "report.html",
        html::render_validation(&models, &[answer], false, &provenance),
    )?;
    set.commit()?;

    talk.say("\nWas any physics left out? The circle is held out again");
    let (named, mut recordings, mut datasets) = (all.len(), all, datasets);
    recordings.extend(held);
    datasets.extend(circle);
    let series = series::order(&recordings, &datasets)?;
    let request = crate::diagnosis::Request::default();
    let search = crate::diagnosis::diagnose;
    let (diagnosis, series) = diagnose::judge(
        &robot, &datasets, named, series, &request, &progress, search,
    )?;
    let provenance = Provenance::of("deacal demo", &recordings);
    let folder = output.join("diagnosis");
    diagnose::write(
        &folder,
        &diagnosis,
        series,
        &[],
        provenance,
        talk.overwrite(),
    )?;
    talk.tell(&format!("  {}", Answer::of_diagnosis(&diagnosis).says));
    drop(progress);
    talk.result(&json);
    talk.say("");
    talk.report(output);
    Ok(())
}
