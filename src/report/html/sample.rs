//! The report of a calibration on hanging samples: x and voltage, measured and predicted, and how far to
//! trust the film.

use minijinja::{Value, context};

use super::errors::{Cycles, per_cycle};
use super::page::{self, Cell, Section, Summary, Table, safe};
use super::plot::{self, Axis, Mark, Panel, Role, Series, Width};
use super::recordings::curve;
use super::summary;
use super::{Provenance, number, parameters, provenance, reduce, starts};
use crate::calibration::{JUDGED_ABOVE_V, SampleFit, SampleOutcome, Standing};
use crate::report::answer::Answer;

const TEMPLATE: &str = include_str!("samples.html");
const ERRORS: &str = include_str!("coupon_errors.html");

/// The report of a calibration on hanging samples, or of a film held against them.
pub fn render_samples(outcome: &SampleOutcome, made_of: &Provenance) -> String {
    let sections = [
        recordings(outcome),
        starts::of(
            &outcome.starts,
            "squared (predicted minus captured x)/noise per row, priors included",
            &summary::end(outcome.converged, &outcome.reason),
        ),
        parameters::of(&parameters::Shown {
            estimates: &outcome.estimates,
            misfit: &[],
            correlation: &outcome.correlation,
            weak_directions: &outcome.weak_directions,
            eps_r: outcome.eps_r,
        }),
        errors(outcome),
        Some(provenance::of(made_of)),
    ];
    let title = match outcome.job {
        "validate" => "Prediction against measurement",
        _ => "Calibration of the film on hanging samples",
    };
    let sections: Vec<Section> = sections.into_iter().flatten().collect();
    page::page(title, &first_screen(outcome, made_of), &sections)
}

fn first_screen(outcome: &SampleOutcome, made_of: &Provenance) -> Summary {
    let worst = |f: fn(&SampleFit) -> f64| outcome.recordings.iter().map(f).fold(0.0, f64::max);
    let (status, word) = summary::standing(Standing::of(outcome.ratio()));
    let answer = Answer::of_samples(outcome);
    let mut tiles = summary::facts(&answer);
    tiles.extend([
        summary::sized("Error of length, rms", worst(|r| r.rmse_m), "m"),
        summary::sized("Noise alone makes", worst(|r| r.noise_rmse_m), "m"),
        summary::sized("Error above 1 kV, rms", outcome.total.rmse_v, "V"),
    ]);
    let notes = [
        summary::ended(outcome.evaluations, outcome.converged, &outcome.reason),
        summary::open(&outcome.estimates, &answer),
        summary::remarks(&outcome.remarks),
    ];
    Summary {
        of: provenance::head(made_of),
        status,
        word: word.into(),
        headline: number::words(&answer.says),
        picture: outcome
            .recordings
            .first()
            .map_or_else(String::new, over_time),
        tiles,
        notes: notes.into_iter().flatten().collect(),
    }
}

fn recordings(outcome: &SampleOutcome) -> Option<Section> {
    if outcome.recordings.is_empty() {
        return None;
    }
    let items: Vec<Value> = outcome
        .recordings
        .iter()
        .enumerate()
        .map(|(i, r)| {
            context! {
                anchor => format!("recording-{}", i + 1),
                id => r.id.clone(),
                lead => lead(r),
                time => safe(over_time(r)),
                loops => safe(loops(r)),
            }
        })
        .collect();
    let says = "x is counted downwards from rest. It is predicted from the voltage alone; the voltage is predicted from the smoothed x alone.";
    let context = context! { says => says, recordings => items };
    Some(Section::new(
        "recordings",
        "Recordings: measured and predicted",
        TEMPLATE,
        context,
    ))
}

fn lead(r: &SampleFit) -> String {
    let figure = |v: f64| number::significant(v, 3);
    format!(
        "Length at rest by the model {} mm; largest minus smallest x {} mm measured, {} mm predicted. Error of x {} \u{b5}m rms where the noise makes {} \u{b5}m; error of the voltage above 1 kV {} V rms where the noise makes {} V.",
        number::fixed(r.rest_length_m * 1e3, 2),
        number::fixed(r.stroke_m[0] * 1e3, 3),
        number::fixed(r.stroke_m[1] * 1e3, 3),
        figure(r.rmse_m * 1e6),
        figure(r.noise_rmse_m * 1e6),
        figure(r.error.rmse_v),
        figure(r.error.noise_floor_v),
    )
}

fn points(x: &[f64], y: impl Fn(usize) -> f64) -> Vec<[f64; 2]> {
    x.iter().enumerate().map(|(i, x)| [*x, y(i)]).collect()
}

fn over_time(r: &SampleFit) -> String {
    let t = &r.time_s;
    let shades = vec![plot::Shade {
        name: "does not count".into(),
        role: Role::Skip,
        spans: reduce::spans(t, |i| !r.counts[i]),
    }];
    let panel = |title: &str, height: f64, series: Vec<Series>| Panel {
        y: Axis::new(title),
        height,
        shades: shades.clone(),
        bands: Vec::new(),
        series,
    };
    let needed = |i: usize| r.needed_squared_v2[i].max(0.0).sqrt() * 1e-3;
    let counted = |i: usize, v: f64| if r.counts[i] { v } else { f64::NAN };
    let panels = [
        panel(
            "x, mm",
            150.0,
            vec![
                curve(
                    "captured",
                    Role::Base,
                    Mark::Broad,
                    points(t, |i| r.captured_m[i] * 1e3),
                ),
                curve(
                    "predicted",
                    Role::One,
                    Mark::Line,
                    points(t, |i| r.predicted_m[i] * 1e3),
                ),
            ],
        ),
        panel(
            "predicted minus smoothed x, \u{b5}m",
            80.0,
            vec![curve(
                "difference",
                Role::Two,
                Mark::Line,
                points(t, |i| {
                    counted(i, (r.predicted_m[i] - r.smoothed_m[i]) * 1e6)
                }),
            )],
        ),
        panel(
            "voltage on the film, kV",
            120.0,
            vec![
                curve(
                    "made by the command",
                    Role::Base,
                    Mark::Broad,
                    points(t, |i| r.film_v[i].abs() * 1e-3),
                ),
                curve(
                    "needed by the motion",
                    Role::One,
                    Mark::Line,
                    points(t, |i| counted(i, needed(i))),
                ),
            ],
        ),
    ];
    let label = format!("Captured and predicted x of {}, and voltage", r.id);
    let drawing = plot::line_plot(&label, &Axis::new("time, s"), &panels, Width::Full);
    plot::figure(
        &[drawing],
        &plot::legend(&panels),
        "A difference that repeats with the drive is no noise.",
    )
}

fn loops(r: &SampleFit) -> String {
    let at = |x: &[f64]| -> Vec<[f64; 2]> {
        (0..r.time_s.len())
            .map(|i| match r.counts[i] {
                true => [r.command_v[i] * 1e-3, x[i] * 1e3],
                false => [f64::NAN; 2],
            })
            .collect()
    };
    let series = vec![
        curve(
            "smoothed capture",
            Role::Base,
            Mark::Broad,
            at(&r.smoothed_m),
        ),
        curve("predicted", Role::One, Mark::Line, at(&r.predicted_m)),
    ];
    let panel = Panel {
        y: Axis::new(""),
        height: 0.0,
        shades: Vec::new(),
        bands: Vec::new(),
        series: series.clone(),
    };
    let drawing = plot::loops(
        &format!("x of {} against the command", r.id),
        &Axis::new("command, kV"),
        &Axis::new("x, mm"),
        series,
    );
    plot::figure(
        &[drawing],
        &plot::legend(&[panel]),
        "A loop of another width means another loss: branches, or a resistance in series.",
    )
}

fn errors(outcome: &SampleOutcome) -> Option<Section> {
    let mut head = vec![Cell::text("recording")];
    let columns = [
        "x, \u{b5}m rms",
        "noise, \u{b5}m rms",
        "over noise",
        "largest, \u{b5}m",
        "above 1 kV, V rms",
        "noise floor, V rms",
        "largest, V",
        "samples above 1 kV",
        "all, V rms",
        "\u{3c6}\u{b2} < 0",
        "step, ms",
    ];
    head.extend(columns.map(Cell::number));
    let mut table = Table::new("Predicted minus measured, by recording.", head);
    let figure = |v: f64| Cell::number(number::significant(v, 3));
    for r in &outcome.recordings {
        table.row(vec![
            Cell::text(&r.id),
            figure(r.rmse_m * 1e6),
            figure(r.noise_rmse_m * 1e6),
            figure(r.rmse_m / r.noise_rmse_m),
            figure(r.max_error_m * 1e6),
            figure(r.error.rmse_v),
            figure(r.error.noise_floor_v),
            figure(r.error.max_error_v),
            Cell::number(number::count(r.error.samples)),
            figure(r.error.rmse_all_v),
            Cell::number(number::count(r.error.negative)),
            figure(r.step_s * 1e3),
        ]);
    }
    let says = "x: captured frames averaged over one step of the integration. Voltage, at the film: what the measured motion needs minus what the command makes there.";
    let each: Vec<Cycles> = outcome.recordings.iter().map(cycles).collect();
    let context =
        context! { says => says, table => table.html(), cycles => safe(per_cycle(&each)) };
    let template = format!("{ERRORS}{{{{ cycles }}}}\n");
    Some(Section::new("errors", "Errors", &template, context))
}

/// Errors of the voltage of a recording, to be judged cycle by cycle.
fn cycles(r: &SampleFit) -> Cycles<'_> {
    let judged = |i: &usize| r.counts[*i] && r.command_v[*i].abs() > JUDGED_ABOVE_V;
    let sample = |i: usize| {
        let error = r.needed_squared_v2[i].max(0.0).sqrt() - r.film_v[i].abs();
        [r.time_s[i], error, r.sd_v[i]]
    };
    Cycles {
        id: &r.id,
        time_s: &r.time_s,
        cycles_s: &r.cycles_s,
        samples: (0..r.time_s.len()).filter(judged).map(sample).collect(),
    }
}
