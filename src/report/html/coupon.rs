//! The report of a calibration on film coupons: nominal stress against stretch and time, and how far to trust
//! the film.

use minijinja::{Value, context};

use super::page::{self, Cell, Item, Note, Section, Summary, Table, safe};
use super::plot::{self, Axis, Band, Mark, Panel, Role, Series, Width};
use super::recordings::{curve, points};
use super::summary::{self, capital, item, note, tile};
use super::{Provenance, number, parameters, provenance, quality, starts};
use crate::calibration::{CouponFit, CouponOutcome};
use crate::dataset::CouponMode;
use crate::film::InitialState;
use crate::report::answer::Answer;

const COUPONS: &str = include_str!("coupons.html");
const ERRORS: &str = include_str!("coupon_errors.html");
const QUALITY: &str = include_str!("coupon_quality.html");
/// Up to so many rows the measured ones are drawn as dots.
const DOTS: usize = 100;
/// Corners that are listed one by one.
const LISTED: usize = 6;

/// The report of a calibration on coupons, or of a film held against them.
pub fn render_coupons(outcome: &CouponOutcome, made_of: &Provenance) -> String {
    let sections = [
        coupons(outcome),
        starts::of(
            &outcome.starts,
            "squared error per row, in units of the noise of the coupon that its noise limits most, each coupon weighed by its stress range",
            &(summary::end(outcome.converged, &outcome.reason)
                + &summary::failed(outcome.failed_evaluations, outcome.evaluations)),
        ),
        parameters::of(&parameters::Shown {
            estimates: &outcome.estimates,
            misfit: misfit(outcome).unwrap_or_default(),
            correlation: &outcome.correlation,
            weak_directions: &outcome.weak_directions,
            eps_r: f64::NAN,
        }),
        in_numbers(outcome),
        quality(outcome),
        Some(provenance::of(made_of)),
    ];
    let title = match outcome.job {
        "validate" => "Prediction against measurement",
        _ => "Calibration of the film on coupons",
    };
    let sections: Vec<Section> = sections.into_iter().flatten().collect();
    page::page(title, &first_screen(outcome, made_of), &sections)
}

/// Standard errors counting the misfit, where it exceeds the noise.
fn misfit(outcome: &CouponOutcome) -> Option<&[f64]> {
    let exceeds = outcome.coupons.iter().any(CouponFit::exceeds_noise);
    let all = outcome.misfit_std_error.len() == outcome.estimates.len();
    (exceeds && all && !outcome.estimates.is_empty()).then_some(&outcome.misfit_std_error)
}

fn first_screen(outcome: &CouponOutcome, made_of: &Provenance) -> Summary {
    let (status, word) = summary::standing(outcome.standing());
    let answer = Answer::of_coupons(outcome);
    let notes = [
        summary::ended(outcome.evaluations, outcome.converged, &outcome.reason),
        against_noise(outcome),
        worst(outcome),
        summary::open(&outcome.estimates, &answer),
        summary::remarks(&outcome.remarks),
    ];
    let mut tiles = summary::facts(&answer);
    tiles.extend(errors(outcome));
    let worst = outcome
        .coupons
        .iter()
        .max_by(|a, b| a.nrmse_percent.total_cmp(&b.nrmse_percent));
    Summary {
        of: provenance::head(made_of),
        status,
        word: word.into(),
        headline: number::words(&answer.says),
        picture: worst.map_or_else(String::new, over_stretch),
        tiles,
        notes: notes.into_iter().flatten().collect(),
    }
}

fn errors(outcome: &CouponOutcome) -> Vec<page::Tile> {
    let t = outcome.total();
    let error = number::significant(outcome.nrmse_percent, 3);
    vec![
        tile("Error over stress range", error, "%"),
        summary::sized("Error of stress, rms", t.rmse_pa, "Pa"),
        summary::sized("Noise alone makes", t.noise_pa, "Pa"),
    ]
}

/// Each coupon's own, where there are several.
fn against_noise(outcome: &CouponOutcome) -> Option<Note> {
    if outcome.coupons.len() < 2 {
        return None;
    }
    let line = |c: &CouponFit| item(format!("{}:", c.id), number::words(&c.verdict));
    let items: Vec<Item> = outcome.coupons.iter().map(line).collect();
    Some(note("Does each coupon fit?", "", items))
}

fn worst(outcome: &CouponOutcome) -> Option<Note> {
    let first = outcome.worst.first()?;
    let stands_out = outcome.coupons.iter().any(CouponFit::exceeds_noise);
    if first.ratio.is_finite() && !stands_out {
        return None;
    }
    let lead = match stands_out {
        true => "The largest excess over the noise of the stress:",
        false => "The largest error; the noise of the stress is not known:",
    };
    let line = |w: &crate::calibration::CouponPlace| {
        let mut text = format!("{} Pa rms", number::significant(w.rmse_pa, 3));
        if w.ratio.is_finite() {
            text += &format!(", {} times the noise", number::significant(w.ratio, 3));
        }
        // As good as one sign throughout, not noise about zero.
        if w.mean_pa.abs() > 0.5 * w.rmse_pa {
            text += match w.mean_pa > 0.0 {
                true => ", predicted too high",
                false => ", predicted too low",
            };
        }
        if (stands_out || !w.ratio.is_finite()) && w.share >= 0.005 {
            let of = match w.ratio.is_finite() {
                true => "excess",
                false => "squared error",
            };
            text += &format!("; {} of the {of}", number::per_cent(w.share));
        }
        let place = match outcome.coupons.len() {
            1 => format!("{}:", capital(&w.place)),
            _ => format!("{}, {}:", w.coupon, w.place),
        };
        item(place, text)
    };
    let items = outcome.worst.iter().map(line).collect();
    Some(note(summary::WHERE, lead, items))
}

fn coupons(outcome: &CouponOutcome) -> Option<Section> {
    if outcome.coupons.is_empty() {
        return None;
    }
    let says = "Nominal stress is force over the unstretched section. The prediction follows from the measured stretch alone; every row counts.";
    let listed = outcome.coupons.iter().enumerate();
    let items: Vec<Value> = listed
        .map(|(i, c)| {
            context! {
                anchor => format!("coupon-{}", i + 1),
                id => c.id.clone(),
                lead => number::words(&c.verdict),
                stretch => safe(over_stretch(c)),
                time => safe(over_time(c)),
            }
        })
        .collect();
    let context = context! { says => says, coupons => items };
    let title = "Coupons: measured and predicted stress";
    Some(Section::new("coupons", title, COUPONS, context))
}

/// Factor to kPa and its name where the stress is large, else Pa.
fn stress_unit(largest_pa: f64) -> (f64, &'static str) {
    if largest_pa < 1e3 {
        (1.0, "Pa")
    } else {
        (1e-3, "kPa")
    }
}

fn error_pa(c: &CouponFit) -> Vec<f64> {
    let both = c.predicted_pa.iter().zip(&c.measured_pa);
    both.map(|(p, m)| p - m).collect()
}

/// Measured and predicted stress over `x`, kPa.
fn stresses(c: &CouponFit, x: &[f64]) -> Vec<Series> {
    let mark = if c.n_samples <= DOTS {
        Mark::Dots
    } else {
        Mark::Broad
    };
    vec![
        curve(
            "measured",
            Role::Base,
            mark,
            points(x, &c.measured_pa, 1e-3),
        ),
        curve(
            "predicted",
            Role::One,
            Mark::Line,
            points(x, &c.predicted_pa, 1e-3),
        ),
    ]
}

/// The range of a panel of errors, and its unit.
fn reach(c: &CouponFit) -> ([f64; 2], f64, &'static str) {
    let noise = if c.noise_known { 3.0 * c.noise_pa } else { 0.0 };
    let most = [c.max_error_pa, noise].into_iter();
    let most = most.filter(|v| v.is_finite()).fold(0.0, f64::max);
    let most = if most > 0.0 { 1.15 * most } else { 1.0 };
    let (factor, unit) = stress_unit(most);
    ([-most * factor, most * factor], factor, unit)
}

fn over_stretch(c: &CouponFit) -> String {
    let x = Axis::new("stretch");
    let series = stresses(c, &c.stretch);
    let ([low, high], factor, unit) = reach(c);
    let difference = curve(
        "difference",
        Role::Two,
        Mark::Line,
        points(&c.stretch, &error_pa(c), factor),
    );
    let [first, last] = plot::extent(c.stretch.iter().copied());
    // Without a band in this kind of drawing: its two edges.
    let noise = 2.0 * c.noise_pa * factor;
    let edge = |y: f64| {
        curve(
            "\u{b1}2 sd of the noise",
            Role::One,
            Mark::Dashed,
            vec![[first, y], [last, y]],
        )
    };
    let mut errors = vec![difference];
    if c.noise_known {
        errors.extend([edge(-noise), edge(noise)]);
    }
    let panel = |series: &[Series]| Panel {
        y: Axis::new(""),
        height: 0.0,
        shades: Vec::new(),
        bands: Vec::new(),
        series: series.to_vec(),
    };
    let key = plot::legend(&[panel(&series), panel(&errors)]);
    let drawings = [
        plot::loops(
            &format!("Nominal stress of {} against stretch", c.id),
            &x,
            &Axis::new("nominal stress, kPa"),
            series,
        ),
        plot::loops(
            &format!(
                "Predicted minus measured stress of {} against stretch",
                c.id
            ),
            &x,
            &Axis::over(format!("predicted minus measured, {unit}"), [low, high]),
            errors,
        ),
    ];
    let caption = "Nominal stress against stretch, and their difference. A loop of another width means another loss: branches are missing or their relaxation times are elsewhere. A difference that grows with the stretch means other springs.";
    plot::figure(&drawings, &key, caption)
}

fn over_time(c: &CouponFit) -> String {
    let (x, what) = if c.timed {
        (Axis::new("time, s"), "time")
    } else {
        (Axis::new("row"), "row")
    };
    let ([low, high], factor, unit) = reach(c);
    let noise = if c.noise_known {
        2.0 * c.noise_pa
    } else {
        f64::NAN
    };
    let band = |name: &str, half: f64, middle: Vec<[f64; 2]>| Band {
        name: name.into(),
        role: Role::One,
        rows: middle
            .iter()
            .map(|p| [p[0], p[1] - half, p[1] + half])
            .collect(),
    };
    let zero = points(&c.time_s, &vec![0.0; c.time_s.len()], 1.0);
    let bands = match c.noise_known {
        true => vec![band("\u{b1}2 sd of the noise", noise * factor, zero)],
        false => Vec::new(),
    };
    let panel = |title: String, height: f64, bands: Vec<Band>, series: Vec<Series>| Panel {
        y: Axis::new(title),
        height,
        shades: Vec::new(),
        bands,
        series,
    };
    let stretch = curve(
        "stretch",
        Role::Three,
        Mark::Line,
        points(&c.time_s, &c.stretch, 1.0),
    );
    let difference = curve(
        "difference",
        Role::Two,
        Mark::Line,
        points(&c.time_s, &error_pa(c), factor),
    );
    let mut panels = vec![
        panel(
            "nominal stress, kPa".into(),
            150.0,
            Vec::new(),
            stresses(c, &c.time_s),
        ),
        panel(
            format!("predicted minus measured, {unit}"),
            90.0,
            bands,
            vec![difference],
        ),
        panel("stretch".into(), 60.0, Vec::new(), vec![stretch]),
    ];
    panels[1].y.range = Some([low, high]);
    let label = format!(
        "Measured and predicted nominal stress of {} over {what}, their difference, and the stretch",
        c.id
    );
    let drawing = plot::line_plot(&label, &x, &panels, Width::Full);
    let caption = "Look for a difference that leaves the blue band for long: noise does not. Decay at constant stretch is where relaxation times show.";
    plot::figure(&[drawing], &plot::legend(&panels), caption)
}

fn in_numbers(outcome: &CouponOutcome) -> Option<Section> {
    if outcome.coupons.is_empty() {
        return None;
    }
    let mut head = vec![Cell::text("coupon")];
    let columns = [
        "rms, Pa",
        "of the stress range, %",
        "of the largest stress, %",
        "noise floor, Pa",
        "over noise",
        "largest, Pa",
        "rows",
        "correlated over, rows",
    ];
    head.extend(columns.map(Cell::number));
    let mut table = Table::new("Predicted minus measured nominal stress, by coupon.", head);
    let figure = |v: f64| Cell::number(number::significant(v, 3));
    for c in &outcome.coupons {
        let noise = number::significant(c.noise_pa, 3);
        let ratio = c.rmse_pa / c.noise_pa;
        table.row(vec![
            Cell::text(&c.id),
            figure(c.rmse_pa),
            figure(c.nrmse_percent),
            figure(c.nrmse_of_max_percent),
            Cell::number(match c.noise_known {
                true => noise,
                false => format!("below {noise}"),
            }),
            figure(if c.noise_known { ratio } else { f64::NAN }),
            figure(c.max_error_pa),
            Cell::number(number::count(c.n_samples)),
            Cell::number(number::significant(c.correlation_rows, 2)),
        ]);
    }
    let t = outcome.total();
    if outcome.coupons.len() > 1 {
        let total = vec![
            Cell::text("all"),
            figure(t.rmse_pa),
            figure(outcome.nrmse_percent),
            Cell::text(""),
            figure(t.noise_pa),
            figure(t.rmse_pa / t.noise_pa),
            figure(t.max_error_pa),
            Cell::number(number::count(t.n_samples)),
            Cell::text(""),
        ];
        table.row_of("total", total);
    }
    let says = "Every row that was not masked counts. The noise floor is the noise of the measured stress at high frequencies; where the error exceeds it, or stays alike over many rows, something is left out of the model. The error over the stress range is the root mean square over the coupons, and what the fit makes small.";
    let context = context! { says => says, table => table.html() };
    let title = "Errors of the nominal stress";
    Some(Section::new("errors", title, ERRORS, context))
}

fn quality(outcome: &CouponOutcome) -> Option<Section> {
    if outcome.coupons.is_empty() {
        return None;
    }
    let item = |c: &CouponFit| context! { id => c.id.clone(), facts => facts(c) };
    let items: Vec<Value> = outcome.coupons.iter().map(item).collect();
    let context = context! { coupons => items };
    let title = "Quality of the data";
    Some(Section::new("quality", title, QUALITY, context))
}

fn facts(c: &CouponFit) -> Vec<String> {
    let mode = match c.mode {
        CouponMode::Uniaxial => "Uniaxial tension",
        CouponMode::Equibiaxial => "Equibiaxial tension",
        CouponMode::PureShear => "Pure shear",
    };
    let state = match c.initial {
        InitialState::Relaxed => "relaxed at the first row",
        InitialState::Virgin => "never stretched before the first row",
    };
    let [low, high] = plot::extent(c.stretch.iter().copied());
    let [from, to] = plot::extent(c.time_s.iter().copied());
    let time = match c.timed {
        true => format!(
            "{} to {} s",
            number::significant(from, 4),
            number::significant(to, 4)
        ),
        false => "no time".into(),
    };
    let corners = c.plan.corners_s.iter().take(LISTED);
    let mut corners: Vec<String> = corners.map(|t| number::significant(*t, 4)).collect();
    if c.plan.corners_s.len() > LISTED {
        corners.push(format!("{} more", c.plan.corners_s.len() - LISTED));
    }
    let nodes = quality::plural(c.plan.nodes, "node");
    let grid = match corners.is_empty() {
        true => format!("The history is carried on {nodes}."),
        false => format!(
            "The history is carried on {nodes}, fine after each of {}: {} s.",
            quality::plural(c.plan.corners_s.len(), "corner"),
            corners.join(", ")
        ),
    };
    let masked = match c.plan.masked {
        0 => "no row masked".to_string(),
        n => format!("{} masked", quality::plural(n, "row")),
    };
    let noise = number::significant(c.noise_pa, 3);
    let mut out = vec![
        format!("{mode}; the film was {state}."),
        format!(
            "{}, {masked}; {time}, stretch {} to {}.",
            quality::plural(c.plan.rows, "row"),
            number::fixed(low, 3),
            number::fixed(high, 3)
        ),
        match c.noise_known {
            true => format!("Noise of the stress at high frequencies: {noise} Pa."),
            false => format!("Noise of the stress: at most {noise} Pa."),
        },
        grid,
    ];
    let sentence = |n: &String| {
        let n = number::words(n);
        let dot = if n.ends_with('.') { "" } else { "." };
        capital(&n) + dot
    };
    out.extend(c.notes.iter().map(sentence));
    out
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::super::tests::{assert_balanced, assert_self_contained};
    use super::*;
    use crate::calibration::{CouponRequest, calibrate_coupons, validate_coupons};
    use crate::dataset::{Coupon, CouponParts, GridChoice};
    use crate::report::provenance::{FileSum, RecordingSum};

    const HOSTILE: &str = "run <b>7</b> & \"x\" 'y' {{ title }}";

    /// A neo-Hookean film, stretched and released, with noise and with an error that no film makes.
    fn coupon(id: &str, rows: usize, odd_pa: f64) -> Coupon {
        let share = |i: usize| i as f64 / (rows - 1) as f64;
        let stretch: Vec<f64> = (0..rows)
            .map(|i| 1.0 + 1.5 * (1.0 - (2.0 * share(i) - 1.0).abs()))
            .collect();
        let noise = |i: usize| ((i * 7919) % 97) as f64 - 48.0;
        let stress = |(i, l): (usize, &f64)| {
            let odd = odd_pa * (40.0 * share(i)).sin();
            2e4 * (l - 1.0 / (l * l)) + noise(i) + odd
        };
        let stress_pa = stretch.iter().enumerate().map(stress).collect();
        let parts = CouponParts {
            id: id.into(),
            mode: CouponMode::Uniaxial,
            initial: InitialState::Relaxed,
            time_s: Some((0..rows).map(|i| 0.1 * i as f64).collect()),
            stretch,
            stress_pa,
        };
        Coupon::new(parts, &GridChoice::default()).unwrap()
    }

    fn fit(coupons: &[&Coupon], branches: usize) -> CouponOutcome {
        let request = CouponRequest {
            starts: 3,
            ..CouponRequest::new(branches)
        };
        calibrate_coupons(coupons, &request, &|_| ControlFlow::Continue(())).unwrap()
    }

    fn provenance() -> Provenance {
        let mut out = Provenance::new("deacal fit coupon 'a<b>' && more");
        out.recordings.push(RecordingSum {
            id: HOSTILE.into(),
            files: vec![FileSum {
                role: "table".into(),
                file: "a&b/<i>table</i>.csv".into(),
                sha256: "00ff".repeat(16),
            }],
        });
        out
    }

    fn look(html: &str) {
        assert_self_contained(html);
        assert_balanced(html);
        assert!(!html.contains(" inf ") && !html.contains(">inf"));
        assert!(!html.contains("aria-label=\"\""));
        for (part, whole) in [("role=\"img\"", "<svg"), ("<figure", "<figcaption")] {
            assert_eq!(html.matches(part).count(), html.matches(whole).count());
        }
    }

    #[test]
    fn a_misfit_has_every_section_and_warns_of_its_intervals() {
        let all = [coupon(HOSTILE, 800, 3e3), coupon("second", 400, 0.0)];
        let outcome = fit(&all.each_ref(), 1);
        let html = render_coupons(&outcome, &provenance());
        look(&html);
        for anchor in [
            "summary",
            "coupons",
            "starts",
            "parameters",
            "errors",
            "quality",
            "provenance",
        ] {
            let number = html.matches(&format!("id=\"{anchor}\"")).count();
            assert_eq!(number, 1, "{anchor}");
        }
        for words in [
            "does not fit",
            "times the noise",
            "of the excess",
            "with misfit",
            "95 % by noise",
            "stretching from",
            "predicted minus measured, kPa",
            "3 starts reached the",
            "Uniaxial tension; the film was relaxed at the first row.",
            "800 rows, no row masked",
            "corners: 0,",
            &"00ff".repeat(16),
        ] {
            assert!(html.contains(words), "{words}");
        }
        assert!(!html.contains("<b>7") && !html.contains("a<b>") && !html.contains("<i>table"));
        assert!(html.contains("run &lt;b&gt;7") && html.contains("{{ title }}"));
    }

    #[test]
    fn a_fit_to_the_noise_needs_no_second_error() {
        let c = coupon("clean", 800, 0.0);
        let outcome = fit(&[&c], 0);
        let html = render_coupons(&outcome, &provenance());
        look(&html);
        assert!(html.contains(">fits<") && html.contains("no more than its noise"));
        assert!(!html.contains("with misfit") && !html.contains("Where does it err most?"));
    }

    #[test]
    fn few_rows_a_missing_clock_and_a_validation_are_said() {
        let few = coupon("few", 20, 0.0);
        let mut untimed = coupon("untimed", 200, 0.0);
        untimed.timed = false;
        untimed.plan.corners_s.clear();
        let outcome = fit(&[&few, &untimed], 0);
        let html = render_coupons(&outcome, &Provenance::default());
        look(&html);
        assert!(html.contains("Noise of the stress: at most") && html.contains("no time"));
        assert!(html.contains("k-base") && html.contains("class=\"dot k-base\""));
        let outcome = validate_coupons(&[&few], &outcome.film).unwrap();
        let html = render_coupons(&outcome, &Provenance::default());
        look(&html);
        assert!(html.contains("cannot be judged") && html.contains("Prediction against"));
        assert!(!html.contains("id=\"starts\"") && !html.contains("id=\"parameters\""));
    }

    #[test]
    fn missing_values_are_never_shown_as_such() {
        let c = coupon("odd", 300, 3e3);
        let mut outcome = fit(&[&c], 1);
        let bad = f64::NAN;
        for e in &mut outcome.estimates {
            (e.std_error, e.ci95) = (bad, [bad, f64::INFINITY]);
            e.says = format!("determined to {bad} %");
        }
        outcome.misfit_std_error.fill(f64::INFINITY);
        let c = &mut outcome.coupons[0];
        c.predicted_pa.fill(bad);
        (c.nrmse_of_max_percent, c.correlation_rows) = (bad, f64::INFINITY);
        c.notes.push(format!("error {bad} %"));
        outcome.worst[0].rmse_pa = bad;
        outcome.starts[0].cost = bad;
        look(&render_coupons(&outcome, &provenance()));
        outcome.coupons.clear();
        look(&render_coupons(&outcome, &provenance()));
    }
}
