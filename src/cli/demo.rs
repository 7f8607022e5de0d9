//! `demo`: the main job on recordings that come with the program.

use std::path::{Path, PathBuf};

use super::fit::say_fit;
use super::progress::Progress;
use super::{Failure, Talk, load, series};
use crate::calibration::{
    CouponRequest, Outcome, Request, Stage, calibrate_coupons, calibrate_robot,
};
use crate::dataset::{Coupon, Dataset};
use crate::jobs::diagnose;
use crate::jobs::fit::{Fitted, of_robot};
use crate::model::Robot;
use crate::recording::{Kind, Recording};
use crate::report::answer::Answer;
use crate::report::html::{self, Run};
use crate::report::json::{FitJson, ModelValidation, ValidationJson, results_to_text};
use crate::report::output::OutputSet;
use crate::report::parameter_file::ParameterFile;
use crate::report::provenance::{FileSum, Provenance};
use crate::validation::validate;

/// The page that leads to all that the demo leaves.
const INDEX: &str = "index.html";

pub(super) fn run(output: &Path, talk: Talk) -> Result<(), Failure> {
    let here = Path::new("datasets");
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("datasets");
    let base = [here, &built]
        .into_iter()
        .find(|d| d.join("twin2026_delta").is_dir())
        .ok_or("the folder `datasets` that comes with the source is not here: run the demo from the project's folder")?;
    let mut demo = Demo {
        output,
        talk,
        progress: Progress::new(talk),
        runs: Vec::new(),
    };
    demo.coupon(base.join("miles2015_vhb4910"))?;

    let twin = base.join("twin2026_delta");
    let recordings = |demo: &Demo<'_>, names: &[&str]| {
        let folders: Vec<_> = names.iter().map(|n| twin.join(n)).collect();
        load::recordings(&folders, None, Kind::Robot, &demo.progress)
    };
    let mut all = recordings(&demo, &["symmetric", "single-1", "single-2", "single-3"])?;
    let robot = load::robot(load::rig(&all)?, None)?;
    let mut datasets = load::datasets(&all, None, &demo.progress)?;
    let joint = demo.fits(&robot, &all, &datasets)?;

    talk.say("\nHeld against a circle that was not fitted");
    let held = recordings(&demo, &["circle-3s"])?;
    let circle = load::datasets(&held, None, &demo.progress)?;
    let json = demo.validation(&robot, &circle[0], &joint, &held)?;

    talk.say("\nWas any physics left out? The circle is held out again");
    let named = all.len();
    all.extend(held);
    datasets.extend(circle);
    demo.diagnosis(&robot, &datasets, named, &all)?;
    demo.index()?;
    drop(demo);
    talk.result(&json);
    talk.say(&format!("\nAll reports: {}", output.join(INDEX).display()));
    Ok(())
}

/// Where the demo writes to, and what it says on the way.
struct Demo<'a> {
    output: &'a Path,
    talk: Talk,
    progress: Progress,
    runs: Vec<Run>,
}

impl Demo<'_> {
    /// What came out of a run that is in a folder of the results: said, set in, and kept for the page.
    fn tell(&mut self, folder: &str, what: &str, says: &str) {
        self.talk.tell(&format!("  {says}"));
        self.keep(folder, what, says);
    }

    /// Keeps a run for the page.
    fn keep(&mut self, folder: &str, what: &str, says: &str) {
        self.runs.push(Run {
            folder: folder.to_owned(),
            what: what.to_owned(),
            says: says.to_owned(),
        });
    }

    /// The page that leads to all runs.
    fn index(&self) -> Result<(), Failure> {
        let headline = "A film coupon was fitted, then a robot: its film, its forearms, and both together. That \
                        was held against a recording that was not fitted, and searched for physics left out.";
        let mut set = OutputSet::new(self.output, self.talk.overwrite())?;
        set.write(
            INDEX,
            html::render_index("What the demo left", headline, &self.runs),
        )?;
        set.commit()?;
        Ok(())
    }

    /// The film of a coupon.
    fn coupon(&mut self, folder: PathBuf) -> Result<(), Failure> {
        self.talk.say("A real film coupon: 3M VHB 4910, pulled to 5.4 times its length and back (Miles et al. 2015)");
        let recordings = load::recordings(&[folder], None, Kind::FilmCoupon, &self.progress)?;
        let coupon = Coupon::from_recording(&recordings[0])?;
        let request = CouponRequest::new(3);
        self.progress.fit(request.starts);
        let outcome = calibrate_coupons(&[&coupon], &request, &|s| self.progress.watch(s))?;
        let provenance = Provenance::of("deacal demo", &recordings);
        let mut set = OutputSet::new(self.output.join("coupon"), self.talk.overwrite())?;
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
        let says = Answer::of_coupons(&outcome).says;
        self.tell("coupon", "A film coupon", &says);
        Ok(())
    }

    /// Film, forearms, and both jointly, each from the one before.
    fn fits(
        &mut self,
        robot: &Robot,
        recordings: &[Recording],
        datasets: &[Dataset],
    ) -> Result<Outcome, Failure> {
        self.talk.say("\nThe film, from the symmetric drive");
        let request = Request::new(Stage::Film);
        let (film, answer) = self.fit(robot, &datasets[..1], &request)?;
        self.tell("film", "The robot's film", &answer.says);
        self.write(&self.output.join("film"), &film, answer, &recordings[..1])?;

        self.talk.say(
            "\nThe forearms, from one actuator at a time; their hinges are relaxed at 0 degrees",
        );
        let relaxed = vec![("torque_0deg".to_owned(), 0.0)];
        let request = Request {
            start: Some(film.parameters),
            fix: relaxed.clone(),
            ..Request::new(Stage::Forearm)
        };
        let (forearm, answer) = self.fit(robot, &datasets[1..], &request)?;
        self.tell("forearm", "Its forearms", &answer.says);
        let folder = self.output.join("forearm");
        self.write(&folder, &forearm, answer, &recordings[1..])?;

        self.talk.say("\nBoth, jointly from all four");
        let request = Request {
            start: Some(forearm.parameters),
            fix: relaxed,
            ..Request::new(Stage::Robot)
        };
        let (joint, answer) = self.fit(robot, datasets, &request)?;
        let fitted = self.write(self.output, &joint, answer, recordings)?;
        self.keep("", "Both jointly", &fitted.answer.says);
        say_fit(&fitted.answer, &fitted.fit, &fitted.remarks, self.talk);
        Ok(joint)
    }

    /// Fits the recordings and says what was found.
    fn fit(
        &self,
        robot: &Robot,
        datasets: &[Dataset],
        request: &Request,
    ) -> Result<(Outcome, Answer), Failure> {
        self.progress.fit(request.starts);
        let refs: Vec<_> = datasets.iter().collect();
        let outcome = calibrate_robot(robot, &refs, request, &|s| self.progress.watch(s))?;
        let answer = Answer::of_robot(&outcome, robot);
        Ok((outcome, answer))
    }

    /// Writes a fit to its folder.
    fn write(
        &self,
        folder: &Path,
        outcome: &Outcome,
        answer: Answer,
        recordings: &[Recording],
    ) -> Result<Fitted, Failure> {
        let provenance = Provenance::of("deacal demo", recordings);
        let fitted = of_robot(outcome, answer, provenance, &[])?;
        let set = fitted.files.stage(folder, self.talk.overwrite())?;
        set.commit()?;
        Ok(fitted)
    }

    /// The parameters held against a recording that was not fitted.
    fn validation(
        &mut self,
        robot: &Robot,
        dataset: &Dataset,
        joint: &Outcome,
        held: &[Recording],
    ) -> Result<ValidationJson, Failure> {
        let validation = validate(robot, &[dataset], &joint.parameters, None, (&[], &[]))?;
        let answer = Answer::of_robot(&validation.outcome, robot);
        self.tell("validation", "Held against a circle", &answer.says);
        for line in html::validation_words(&validation) {
            self.talk.say(&format!("  {line}"));
        }
        let provenance = Provenance::of("deacal demo", held);
        let parameters = self.output.join("parameters.toml");
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
        let mut set = OutputSet::new(self.output.join("validation"), self.talk.overwrite())?;
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
        Ok(json)
    }

    /// What the first `named` recordings leave out, judged on the others.
    fn diagnosis(
        &mut self,
        robot: &Robot,
        datasets: &[Dataset],
        named: usize,
        recordings: &[Recording],
    ) -> Result<(), Failure> {
        let series = series::order(recordings, datasets)?;
        let request = crate::diagnosis::Request::default();
        let search = crate::diagnosis::diagnose;
        let (diagnosis, series) = diagnose::judge(
            robot,
            datasets,
            named,
            series,
            &request,
            &self.progress,
            search,
        )?;
        let provenance = Provenance::of("deacal demo", recordings);
        let (_, files) = diagnose::files(&diagnosis, series, &[], provenance)?;
        let set = files.stage(&self.output.join("diagnosis"), self.talk.overwrite())?;
        set.commit()?;
        let says = Answer::of_diagnosis(&diagnosis).says;
        self.tell("diagnosis", "Whether physics was left out", &says);
        Ok(())
    }
}
