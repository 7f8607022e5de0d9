//! What a job found, as its reader asks for it: one sentence, and the few quantities behind it. The terminal
//! and the first screen of a page begin with the same ones.

use super::effect_entries::{self, actuators};
use super::html::capital;
use super::html::number::{self, Quantity};
use crate::calibration::{
    CouponFit, CouponOutcome, Estimate, LineFit, LineOutcome, Outcome, SampleFit, SampleOutcome,
    Standing,
};
use crate::diagnosis::{Candidate, Diagnosis, RigKind, Value, Verdict};
use crate::effects::line::Kind;
use crate::effects::plain_name;
use crate::model::Robot;

/// Standard errors to each end of a 95 % interval.
const OF_95: f64 = 1.96;
/// Frames between those of which the working stretch is the mean.
const EVERY: usize = 10;
/// Forearm angles of which the torque is told, deg.
const TOLD_DEG: [f64; 2] = [10.0, -10.0];
/// A torque is open beyond this half of its interval, and beyond a third of itself, N m.
const OPEN_N_M: f64 = 4e-4;

/// A quantity that was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact {
    /// Its name.
    pub what: String,
    /// Value, interval and unit.
    pub size: Quantity,
    /// What it means.
    pub means: String,
}

/// The answer of a job.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Answer {
    /// In one sentence.
    pub says: String,
    /// The quantities behind it.
    pub facts: Vec<Fact>,
    /// What the recordings leave open.
    pub open: Vec<Open>,
}

/// Parameters that the recordings leave open, by what would determine them.
#[derive(Debug, Clone, PartialEq)]
pub struct Open {
    /// What to record, or to do instead.
    pub record: String,
    /// Names, as `--fix` takes them.
    pub names: Vec<String>,
    /// What they are, in words.
    pub what: String,
}

impl Answer {
    /// Of a fit to recordings of a robot, or of a model that is held against them.
    #[must_use]
    pub fn of_robot(outcome: &Outcome, robot: &Robot) -> Self {
        let known = Known::new(&outcome.estimates, None, &outcome.correlation);
        let mut parts = Vec::new();
        let mut facts = Vec::new();
        if let Some(film) = film(&known, working_stretch(outcome, robot)) {
            parts.push(film.says);
            facts.extend(film.facts);
        }
        if let Some(forearm) = forearm(&known, outcome) {
            parts.push(forearm.says);
            facts.extend(forearm.facts);
        }
        let t = &outcome.total;
        let volt = |v: f64| number::sized(v, "V", 2);
        parts.push(match Standing::of(t.rmse_v / t.noise_floor_v) {
            _ if t.samples == 0 => lower(&outcome.verdict),
            standing => against(
                standing,
                match outcome.job {
                    "validate" => "the voltages are predicted",
                    _ => "the voltages are met",
                },
                [&volt(t.rmse_v), &volt(t.noise_floor_v)],
                t.rmse_v / t.noise_floor_v,
            ),
        });
        let open = open(&outcome.estimates, Some(outcome.swing_range_deg), HELD);
        Answer::of(&parts, facts, open)
    }

    /// Of a fit to coupons.
    #[must_use]
    pub fn of_coupons(outcome: &CouponOutcome) -> Self {
        let misfit = (outcome.coupons.iter().any(CouponFit::exceeds_noise)
            && outcome.misfit_std_error.len() == outcome.estimates.len())
        .then_some(outcome.misfit_std_error.as_slice());
        let known = Known::new(&outcome.estimates, misfit, &outcome.correlation);
        let film = film(&known, None).unwrap_or_default();
        let total = outcome.total();
        let error = format!(
            "the stress is met to {} of its range",
            percent(outcome.nrmse_percent)
        );
        let fit = match outcome.standing() {
            Standing::CannotBeJudged => format!("{error}; its noise is not known"),
            Standing::Fits => format!("{error}, no more than its noise"),
            _ => format!(
                "{error}, {} times its noise: something is left out",
                number::significant(total.rmse_pa / total.noise_pa, 2)
            ),
        };
        let open = open(&outcome.estimates, None, "a stretch");
        Answer::of(&[film.says, fit], film.facts, open)
    }

    /// Of a fit to hanging samples.
    #[must_use]
    pub fn of_samples(outcome: &SampleOutcome) -> Self {
        let known = Known::new(&outcome.estimates, None, &outcome.correlation);
        let film = film(&known, None).unwrap_or_default();
        let worst = |f: fn(&SampleFit) -> f64| outcome.recordings.iter().map(f).fold(0.0, f64::max);
        let metre = |v: f64| number::sized(v, "m", 2);
        let fit = against(
            Standing::of(outcome.ratio()),
            "the length is met",
            [
                &metre(worst(|r| r.rmse_m)),
                &metre(worst(|r| r.noise_rmse_m)),
            ],
            outcome.ratio(),
        );
        let open = open(&outcome.estimates, None, HELD);
        Answer::of(&[film.says, fit], film.facts, open)
    }

    /// Of a fit to hinge benches or axes.
    #[must_use]
    pub fn of_lines(outcome: &LineOutcome) -> Self {
        let told = |e: &&Estimate| !e.fixed && e.identifiable && e.at_bound.is_none();
        let estimates = || outcome.estimates.iter().filter(told);
        let (says, facts) = match outcome.kind {
            Kind::Bench => {
                let angle = |e: &Estimate| angle_deg(&e.name).unwrap_or(0.0);
                let mut ends: Vec<&Estimate> = estimates().collect();
                ends.sort_by(|a, b| angle(b).total_cmp(&angle(a)));
                ends = match ends.as_slice() {
                    [first, .., last] => vec![first, last],
                    few => few.to_vec(),
                };
                let facts: Vec<Fact> = ends
                    .iter()
                    .map(|e| torque(angle(e), e.value, e.ci95, "of the hinge"))
                    .collect();
                let list: Vec<String> = ends
                    .iter()
                    .map(|e| format!("{} at {}", half_of(e), degrees(angle(e))))
                    .collect();
                let says = match list.is_empty() {
                    true => "No torque of the hinge is determined".into(),
                    false => format!("The hinge springs back with {}", list.join(" and ")),
                };
                (says, facts)
            }
            _ => {
                let facts = estimates()
                    .map(|e| Fact {
                        what: e.name.clone(),
                        size: Quantity::new(e.value, e.ci95, &e.unit),
                        means: e.meaning.clone(),
                    })
                    .collect();
                let of_a_cause = |e: &&Estimate| {
                    let mut all = outcome.causes.iter().flat_map(|c| &c.estimates);
                    all.any(|own| own.name == e.name)
                };
                let list: Vec<String> = estimates()
                    .filter(|e| !of_a_cause(e))
                    .map(|e| format!("{} {}", e.name, half_of(e)))
                    .collect();
                let causes = outcome.causes.iter();
                let causes: Vec<String> =
                    causes.map(|c| plain_name(c.acting.effect.id())).collect();
                let with = match causes.is_empty() {
                    true => String::new(),
                    false => format!(", with {}", number::list(&causes)),
                };
                (capital(&(list.join(", ") + &with)), facts)
            }
        };
        let (rmse, _, _, noise) = outcome.total();
        let what = outcome.driven;
        let verb = match outcome.estimates.is_empty() {
            true => "predicted",
            false => "met",
        };
        let fit = of_the(what, verb, outcome.standing(), [rmse, noise], &outcome.unit);
        Answer::of(&[says, fit], facts, open(&outcome.estimates, None, HELD))
    }

    /// Of a prediction of what drives a single coordinate, or of its motion.
    #[must_use]
    pub fn of_line(r: &LineFit, what: &str, unit: &str) -> Self {
        let fit = of_the(what, "predicted", r.standing(), [r.rmse, r.noise], unit);
        Answer::of(&[fit], Vec::new(), Vec::new())
    }

    /// Of a diagnosis.
    #[must_use]
    pub fn of_diagnosis(d: &Diagnosis) -> Self {
        let named: Vec<&Candidate> = d.candidates.iter().filter(|c| c.in_model).collect();
        let (gain, on) = match &d.holdout {
            Some(gain) => (gain, unseen(d)),
            None => (&d.train, "where it was fitted"),
        };
        let size = |v: f64| number::sized(v, &d.unit, 3);
        let noise = size(gain.noise_floor_v);
        let over = d.over;
        let falls = || {
            let [before, after, noise] = gain.told(d.over_all()).map(size);
            let over = d.told_over();
            format!("{on} the error falls from {before} to {after} rms{over}, noise makes {noise}")
        };
        let leaves = || {
            let before = size(gain.before_v);
            format!("the plain model leaves {before} rms{over} {on}, noise makes {noise}")
        };
        let says = match d.verdict {
            _ if d.beyond.is_some() => d.says.clone(),
            // noise that was read too low: a sentence of its own
            Verdict::Adequate
                if Standing::of(gain.before_v / gain.noise_floor_v) == Standing::DoesNotFit =>
            {
                d.says.clone()
            }
            Verdict::Adequate => {
                format!(
                    "Nothing is missing that these recordings could show: {}.",
                    leaves()
                )
            }
            Verdict::MissingPhysics => {
                let list: Vec<String> = named
                    .iter()
                    .map(|c| format!("{} (probability {})", cause(c), odds(c.probability)))
                    .collect();
                let rest = match &d.learnt {
                    Some(_) => "; what is left beside that was learnt; with both, ",
                    None => "; ",
                };
                format!(
                    "Physics is missing: {}{rest}{}.",
                    number::list(&list),
                    falls()
                )
            }
            Verdict::Unexplained if d.learnt.is_some() => {
                format!(
                    "No cause of the catalogue accounts for what is left; learnt from the recordings, {}.",
                    falls()
                )
            }
            Verdict::Unexplained => {
                format!(
                    "No cause of the catalogue accounts for what is left: {}.",
                    leaves()
                )
            }
        };
        let facts = named.iter().flat_map(|c| sizes(d, c)).collect();
        Answer {
            says,
            facts,
            open: Vec::new(),
        }
    }

    fn of(parts: &[String], facts: Vec<Fact>, open: Vec<Open>) -> Self {
        let parts = parts.iter().map(String::as_str).filter(|p| !p.is_empty());
        let says = parts.collect::<Vec<_>>().join("; ");
        Answer {
            says: capital(says.trim_end_matches('.')) + ".",
            facts,
            open,
        }
    }
}

/// What took no part in a diagnosis, where something did not.
fn unseen(d: &Diagnosis) -> &'static str {
    let fitted = |id: &str| d.traces.iter().any(|t| !t.held_out && t.id == id);
    match d.traces.iter().any(|t| t.held_out && fitted(&t.id)) {
        true => "on parts that were not fitted",
        false => "on unseen recordings",
    }
}

/// A cause by its name.
fn cause(c: &Candidate) -> String {
    plain_name(c.acting.effect.id())
}

/// A probability, without pretending to certainty.
#[must_use]
pub fn odds(p: f64) -> String {
    match p {
        p if !p.is_finite() => number::MISSING.into(),
        p if p > 0.99 => "above 99 %".into(),
        p => number::per_cent(p),
    }
}

/// `actuator 2`, `actuators 1 and 3`, `all actuators`.
#[must_use]
pub fn sits_in(list: &[usize]) -> String {
    match list {
        [a] => format!("actuator {a}"),
        [a, b] => format!("actuators {a} and {b}"),
        _ => "all actuators".into(),
    }
}

/// Names of the other causes of the groups that one is in: it could be mistaken for them.
#[must_use]
pub fn mistaken_for(d: &Diagnosis, id: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    for group in d.groups.iter().filter(|g| g.contains(&id)) {
        for other in group.iter().filter(|o| **o != id) {
            let name = plain_name(other);
            if !out.contains(&name) {
                out.push(name);
            }
        }
    }
    out
}

/// A value of a cause with its interval; a word where it stands for one.
#[must_use]
pub fn size(v: &Value) -> Quantity {
    match &v.word {
        Some(word) => Quantity {
            value: word.clone(),
            interval: String::new(),
            unit: String::new(),
        },
        None => Quantity::new(v.value, v.ci95, &v.unit),
    }
}

/// The values of a cause.
fn sizes(d: &Diagnosis, c: &Candidate) -> Vec<Fact> {
    let place = match d.rig {
        RigKind::Robot => format!("in {}", sits_in(&actuators(c.acting.on))),
        _ => String::new(),
    };
    let fact = |name: &str, v: &Value| Fact {
        what: format!("{}, {}", cause(c), name.replace('_', " ")),
        size: size(v),
        means: place.clone(),
    };
    let list = effect_entries::named(c);
    let each = list
        .iter()
        .flat_map(|n| n.values.iter().map(|v| fact(n.name, v)));
    each.collect()
}

/// `the voltages are met within 2.6 V rms, noise makes 2.8 V`.
fn against(standing: Standing, what: &str, [error, noise]: [&str; 2], ratio: f64) -> String {
    match standing {
        Standing::CannotBeJudged => {
            format!("{what} within {error} rms; there is no noise to hold it against")
        }
        Standing::Fits => format!("{what} within {error} rms, noise makes {noise}"),
        _ => format!(
            "{what} only within {error} rms, {} times what noise makes",
            number::significant(ratio, 2)
        ),
    }
}

/// The same of a single coordinate.
fn of_the(
    what: &str,
    verb: &str,
    standing: Standing,
    [rmse, noise]: [f64; 2],
    unit: &str,
) -> String {
    let size = |v: f64| number::sized(v, unit, 2);
    let what = format!("the {what} is {verb}");
    against(standing, &what, [&size(rmse), &size(noise)], rmse / noise)
}

/// The estimates with their standard errors and correlation.
struct Known<'a> {
    list: &'a [Estimate],
    errors: Vec<f64>,
    correlation: &'a (Vec<String>, Vec<Vec<f64>>),
}

impl<'a> Known<'a> {
    /// `errors`, where given, stand instead of the estimates' own.
    fn new(
        list: &'a [Estimate],
        errors: Option<&[f64]>,
        correlation: &'a (Vec<String>, Vec<Vec<f64>>),
    ) -> Self {
        let own = || list.iter().map(|e| e.std_error).collect();
        Known {
            errors: errors.map_or_else(own, <[f64]>::to_vec),
            list,
            correlation,
        }
    }

    fn place(&self, name: &str) -> Option<usize> {
        self.list.iter().position(|e| e.name == name)
    }

    /// The sum of estimates, each times a factor, with its 95 % interval. What rests on a bound or was held
    /// adds nothing to the interval.
    fn sum(&self, parts: &[(usize, f64)]) -> (f64, [f64; 2]) {
        let value: f64 = parts.iter().map(|&(i, w)| w * self.list[i].value).sum();
        let row = |i: usize| {
            self.correlation
                .0
                .iter()
                .position(|n| *n == self.list[i].name)
        };
        // J is searched as 1/J, and the correlations are those of the search
        let sign = |i: usize| if self.list[i].name == "J" { -1.0 } else { 1.0 };
        let loose: Vec<(usize, f64)> = parts
            .iter()
            .filter(|&&(i, _)| self.errors[i].is_finite() && !self.list[i].fixed)
            .map(|&(i, w)| (i, sign(i) * w * self.errors[i]))
            .collect();
        let mut variance = 0.0;
        for &(i, a) in &loose {
            for &(j, b) in &loose {
                let r = match (row(i), row(j)) {
                    _ if i == j => 1.0,
                    (Some(i), Some(j)) => self.correlation.1[i][j],
                    _ => 0.0,
                };
                variance += r * a * b;
            }
        }
        let half = OF_95 * variance.max(0.0).sqrt();
        (value, [value - half, value + half])
    }
}

/// What is told of the film, or of the forearms.
#[derive(Default)]
struct Part {
    says: String,
    facts: Vec<Fact>,
}

/// Stiffness of the film once it has relaxed, and what it loses on the way. `stretch` is the one at which it
/// works.
fn film(known: &Known, stretch: Option<[f64; 2]>) -> Option<Part> {
    let at = known.place("mu_1").filter(|&i| !known.list[i].fixed)?;
    let mu = &known.list[at];
    let locking = known.place("J").map(|i| (i, known.list[i].value));
    // Gent: mu/D with D = 1 - I/J, and its slope over J
    let stiffening = stretch.zip(locking).map(|([a, b], (i, j))| {
        let invariant = a * a + b * b + 1.0 / (a * b).powi(2) - 3.0;
        let d = 1.0 - invariant / j;
        (i, d, -mu.value * invariant / (j * d).powi(2))
    });
    let (parts, means) = match (stiffening, stretch) {
        (Some((i, d, slope)), Some([a, b])) if d > 0.0 => {
            let value = mu.value / d;
            let (_, [low, high]) = known.sum(&[(at, 1.0 / d), (i, slope)]);
            let half = (high - low) / 2.0;
            let means = format!(
                "shear stiffness once it has relaxed, at its working stretch of {} by {}",
                number::fixed(a, 2),
                number::fixed(b, 2)
            );
            ((value, [value - half, value + half]), means)
        }
        _ => {
            let means = "shear stiffness once it has relaxed (mu_1)".to_string();
            (known.sum(&[(at, 1.0)]), means)
        }
    };
    let (value, ends) = parts;
    let size = Quantity::new(value, ends, &mu.unit);
    let mut says = format!("the film: {}", half_interval(&size, value, ends));
    let mut facts = vec![Fact {
        what: "film, relaxed".into(),
        size,
        means,
    }];
    if let Some((span, size)) = relaxing(known) {
        says += &format!(" once relaxed, relaxing over {span}");
        facts.push(Fact {
            what: "film, relaxing".into(),
            size,
            means: format!("what it is stiffer at once, and loses over {span}"),
        });
    }
    Some(Part { says, facts })
}

/// The times over which a film is seen to relax, and what it loses by then: all branches between the fastest
/// and the slowest whose moduli the recordings tell from none.
fn relaxing(known: &Known) -> Option<(String, Quantity)> {
    let branch = |n: usize| {
        let place = known.place(&format!("T_{n}"))?;
        Some((place, known.place(&format!("mu_{}", n + 1))?))
    };
    let mut branches: Vec<(usize, usize)> = (1..).map_while(branch).collect();
    let time = |b: &(usize, usize)| known.list[b.0].value;
    branches.sort_by(|a, b| time(a).total_cmp(&time(b)));
    let seen = |b: &(usize, usize)| {
        let e = &known.list[b.1];
        e.at_bound.is_none() && e.value - OF_95 * known.errors[b.1] > 0.0
    };
    let first = branches.iter().position(seen)?;
    let last = branches.iter().rposition(seen)?;
    let between = &branches[first..=last];
    let moduli: Vec<(usize, f64)> = between.iter().map(|b| (b.1, 1.0)).collect();
    let (value, ends) = known.sum(&moduli);
    let [from, to] = [time(&between[0]), time(&between[between.len() - 1])];
    let second = |t: f64| number::sized(t, "s", 2);
    let span = match first == last {
        true => second(from),
        false => format!("{} to {}", second(from), second(to)),
    };
    Some((span, Quantity::new(value, ends, "Pa")))
}

/// The mean stretches of the film over the frames that count.
fn working_stretch(outcome: &Outcome, robot: &Robot) -> Option<[f64; 2]> {
    let mut sum = [0.0; 2];
    let mut n = 0.0;
    for r in &outcome.recordings {
        let counted = r.position_mm.iter().zip(&r.counts).step_by(EVERY);
        for (at, _) in counted.filter(|(_, counts)| **counts) {
            let Ok(chains) = robot.mechanism.pose(at.map(|v| v * 1e-3)) else {
                continue;
            };
            for (chain, lozenge) in chains.iter().zip(&robot.lozenges) {
                let [a, b] = lozenge.stretches(chain.theta_dea_rad);
                sum = [sum[0] + a, sum[1] + b];
                n += 1.0;
            }
        }
    }
    (n > 0.0).then(|| sum.map(|s| s / n))
}

/// Torque of the forearms at ten degrees to each side, and per degree, within what the recordings cover.
fn forearm(known: &Known, outcome: &Outcome) -> Option<Part> {
    let free = |e: &Estimate| e.unit == "N m" && !e.fixed;
    if !known.list.iter().any(free) {
        return None;
    }
    let [low, high] = outcome.swing_range_deg;
    let told: Vec<(f64, f64, [f64; 2])> = TOLD_DEG
        .iter()
        .filter(|a| (low..=high).contains(*a))
        .filter_map(|a| {
            let row = |r: &&[f64; 3]| (r[0] - a).abs() < 0.26;
            let [_, torque, half] = *outcome.torque_band.iter().find(row)?;
            let ends = [torque - half, torque + half].map(|v| v * 1e-3);
            Some((*a, torque * 1e-3, ends))
        })
        .collect();
    let open = |&(_, value, [low, high]): &(f64, f64, [f64; 2])| {
        let half = (high - low) / 2.0;
        half > OPEN_N_M && half > value.abs() / 3.0
    };
    let mut facts: Vec<Fact> = told
        .iter()
        .map(|t| torque(t.0, t.1, t.2, "of a forearm"))
        .collect();
    let mut says = match told.iter().find(|t| !open(t)) {
        Some(&(angle, value, ends)) => {
            let size = Quantity::new(value, ends, "N m");
            let size = half_interval(&size, value, ends);
            format!("the forearms: {size} at {}", degrees(angle))
        }
        None => String::new(),
    };
    let node = |angle: f64| known.place(&format!("torque_{angle:.0}deg"));
    if let (Some(a), Some(b)) = (node(TOLD_DEG[0]), node(TOLD_DEG[1])) {
        let per_deg = 1.0 / (TOLD_DEG[0] - TOLD_DEG[1]);
        let (value, ends) = known.sum(&[(a, per_deg), (b, -per_deg)]);
        let size = Quantity::new(value, ends, "N m/deg");
        if says.is_empty() {
            says = format!(
                "the forearms: {}, level open",
                half_interval(&size, value, ends)
            );
        }
        facts.push(Fact {
            what: "torque per degree".into(),
            size,
            means: "between these angles".into(),
        });
    }
    if says.is_empty() {
        says = "the torque of the forearms is open".into();
    }
    Some(Part { says, facts })
}

fn torque(angle_deg: f64, value: f64, ends: [f64; 2], of: &str) -> Fact {
    Fact {
        what: format!("torque at {}", degrees(angle_deg)),
        size: Quantity::new(value, ends, "N m"),
        means: format!("spring-back {of}"),
    }
}

/// The angle of `torque_-10deg`.
fn angle_deg(name: &str) -> Option<f64> {
    name.strip_prefix("torque_")?
        .strip_suffix("deg")?
        .parse()
        .ok()
}

fn degrees(angle: f64) -> String {
    let digits = usize::from(angle.fract() != 0.0);
    format!("{}\u{b0}", number::fixed(angle, digits))
}

/// `1.11 MPa ± 2.9 %`: the value with half of its 95 % interval.
fn half_interval(size: &Quantity, value: f64, [low, high]: [f64; 2]) -> String {
    let share = 100.0 * (high - low) / 2.0 / value.abs();
    match share.is_finite() && share > 0.0 {
        true => format!("{} \u{b1} {}", size.with_unit(), percent(share)),
        false => size.with_unit(),
    }
}

fn half_of(e: &Estimate) -> String {
    half_interval(&Quantity::new(e.value, e.ci95, &e.unit), e.value, e.ci95)
}

fn percent(share: f64) -> String {
    format!("{} %", number::significant(share, 2))
}

/// A sentence with its first letter small, to stand inside another one.
fn lower(sentence: &str) -> String {
    let mut letters = sentence.chars();
    let first = letters.next().map(|c| c.to_lowercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// Relaxation times below this are shown by fast drives, those above by long holds, s.
const FAST_S: f64 = 1.0;
/// A hold shows a relaxation time that it is so many times as long as.
const HOLDS: f64 = 3.0;

/// What is held to show a slow relaxation, of all but coupons.
const HELD: &str = "a voltage";

/// What would determine the parameters that are free and open. `swing` is the range of the forearms, of a
/// robot; `held` is what a long hold holds.
fn open(list: &[Estimate], swing: Option<[f64; 2]>, held: &str) -> Vec<Open> {
    let value = |name: &str| list.iter().find(|e| e.name == name).map(|e| e.value);
    let is_open = |e: &&Estimate| !e.fixed && (!e.identifiable || e.at_bound.is_some());
    let slowest = list.iter().filter(is_open).filter(|e| e.unit == "s");
    let slowest = slowest.map(|e| e.value).fold(0.0, f64::max);
    let mut out: Vec<(String, Vec<&Estimate>)> = Vec::new();
    for e in list.iter().filter(is_open) {
        let branch = match e.name.split_once('_') {
            Some(("T", n)) => n.parse::<usize>().ok(),
            Some(("mu", n)) => n.parse::<usize>().ok().map(|n| n - 1),
            _ => None,
        };
        let time = branch.and_then(|n| value(&format!("T_{n}")));
        let modulus = branch.and_then(|n| value(&format!("mu_{}", n + 1)));
        let record = match (time, angle_deg(&e.name), swing) {
            _ if e.says.contains("misfit") => {
                "nothing more: the model leaves something out, and these stand in for it".into()
            }
            (Some(_), ..) if modulus == Some(0.0) => {
                "nothing: no branch is asked for there (--branches fits fewer)".into()
            }
            (Some(t), ..) if t < FAST_S => "steps, and faster drives".into(),
            (Some(_), ..) => format!(
                "{held} held for {} or longer",
                minutes(HOLDS * slowest.max(FAST_S))
            ),
            (_, Some(angle), Some([low, high])) if (low - 1.0..=high + 1.0).contains(&angle) => {
                "a hinge on a bench; or hold the level (--fix torque_0deg=0 where hinges are relaxed at 0\u{b0})".into()
            }
            (_, Some(_), Some([low, high])) if low <= high => format!(
                "larger swings: no forearm leaves {} to {}",
                degrees(low.round()),
                degrees(high.round())
            ),
            (_, Some(_), _) => "more rows at these angles, there and back".into(),
            _ if e.name == "J" => "larger strokes, or a coupon that is pulled far".into(),
            _ if e.name.starts_with("offset") => "steps of the voltage, which show the clocks".into(),
            _ => "larger and faster drives".into(),
        };
        match out.iter_mut().find(|o| o.0 == record) {
            Some(o) => o.1.push(e),
            None => out.push((record, vec![e])),
        }
    }
    let told = |(record, list): (String, Vec<&Estimate>)| Open {
        record,
        names: list.iter().map(|e| e.name.clone()).collect(),
        what: in_words(&list),
    };
    out.into_iter().map(told).collect()
}

/// Parameters by what they are: `relaxation time and modulus of branch 1`, `torque at -20° and 20°`.
fn in_words(list: &[&Estimate]) -> String {
    let (mut times, mut moduli, mut angles) = (Vec::new(), Vec::new(), Vec::new());
    let mut others = Vec::new();
    let number = |text: &str| text.parse::<usize>().ok();
    for e in list {
        match e.name.split_once('_').map(|(what, n)| (what, number(n))) {
            Some(("T", Some(n))) => times.push(n.to_string()),
            Some(("mu", Some(n))) if n > 1 => moduli.push((n - 1).to_string()),
            _ => match angle_deg(&e.name) {
                Some(angle) => angles.push(degrees(angle)),
                None if e.meaning.is_empty() => others.push(e.name.clone()),
                None => others.push(lower(&e.meaning)),
            },
        }
    }
    let branches = |list: &[String]| {
        let s = if list.len() > 1 { "es" } else { "" };
        format!("branch{s} {}", number::list(list))
    };
    let of = |one: &str, more: &str, list: &[String]| match list {
        [] => None,
        [_] => Some(format!("{one} of {}", branches(list))),
        _ => Some(format!("{more} of {}", branches(list))),
    };
    let mut parts = match times == moduli {
        true => vec![of(
            "relaxation time and modulus",
            "relaxation times and moduli",
            &times,
        )],
        false => vec![
            of("relaxation time", "relaxation times", &times),
            of("modulus", "moduli", &moduli),
        ],
    };
    parts.push((!angles.is_empty()).then(|| format!("torque at {}", number::list(&angles))));
    parts.extend(others.into_iter().map(Some));
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    // lists inside a list
    match parts.iter().any(|p| p.contains(" and ")) && parts.len() > 1 {
        true => parts.join("; "),
        false => number::list(&parts),
    }
}

fn minutes(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{} s", number::significant(s, 1)),
        s => format!("{} min", number::significant(s / 60.0, 1)),
    }
}

/// What of the remarks is said of each recording alike (poses that no voltage holds) said once, with what it
/// means.
#[must_use]
pub fn remarks(outcome: &Outcome) -> Vec<String> {
    const EACH: &str = "phi^2 < 0: no voltage holds that pose";
    let mut out: Vec<String> = outcome.remarks.clone();
    out.retain(|r| !r.contains(EACH));
    let negative = outcome.recordings.iter().filter(|r| r.total.negative > 0);
    let list: Vec<String> = negative
        .map(|r| {
            let (n, of) = (r.total.negative, r.total.samples_all);
            format!("{}: {} of {}", r.id, number::count(n), number::count(of))
        })
        .collect();
    if !list.is_empty() && out.len() < outcome.remarks.len() {
        out.push(format!(
            "phi^2 < 0 at some samples ({}): the film would have to be pushed there, which no voltage does; they count as 0 V. \
             Near 0 V the noise of the capture does that. Where the command is high, look at masses, payload and the torque curve.",
            list.join("; ")
        ));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(name: &str, unit: &'static str, value: f64, std_error: f64) -> Estimate {
        Estimate {
            name: name.into(),
            meaning: String::new(),
            unit: unit.into(),
            value,
            std_error,
            ci95: [value - OF_95 * std_error, value + OF_95 * std_error],
            at_bound: None,
            identifiable: std_error < value / 3.0,
            fixed: false,
            says: String::new(),
        }
    }

    #[test]
    fn a_sum_knows_what_its_parts_share() {
        let list = [
            estimate("mu_1", "Pa", 3.0, 1.0),
            estimate("mu_2", "Pa", 2.0, 1.0),
        ];
        let names = vec!["mu_1".to_string(), "mu_2".to_string()];
        let together = (names, vec![vec![1.0, -1.0], vec![-1.0, 1.0]]);
        let known = Known::new(&list, None, &together);
        assert_eq!(known.sum(&[(0, 1.0), (1, 1.0)]), (5.0, [5.0, 5.0]));
        let (value, [low, _]) = known.sum(&[(0, 1.0), (1, -1.0)]);
        assert_eq!((value, low), (1.0, 1.0 - 2.0 * OF_95));
    }

    #[test]
    fn a_film_relaxes_over_the_branches_that_are_seen() {
        let list = [
            estimate("T_1", "s", 0.01, 1.0),
            estimate("T_2", "s", 0.12, 0.01),
            estimate("T_3", "s", 2.0, 9.0),
            estimate("T_4", "s", 40.0, 1.0),
            estimate("mu_1", "Pa", 1.1e6, 1e4),
            estimate("mu_2", "Pa", 1e5, 1e5),
            estimate("mu_3", "Pa", 1e5, 1e4),
            estimate("mu_4", "Pa", 5e4, 1e5),
            estimate("mu_5", "Pa", 5e4, 1e3),
        ];
        let none = Default::default();
        let film = film(&Known::new(&list, None, &none), None).unwrap();
        assert_eq!(
            film.says,
            "the film: 1.100 MPa \u{b1} 1.8 % once relaxed, relaxing over 120 ms to 40 s"
        );
        assert_eq!(film.facts[1].size.value, "200");
        let record: Vec<(String, String)> = open(&list, None, HELD)
            .into_iter()
            .map(|o| (o.record, format!("{} ({})", o.what, o.names.join(", "))))
            .collect();
        let expected = [
            (
                "steps, and faster drives",
                "relaxation time and modulus of branch 1 (T_1, mu_2)",
            ),
            (
                "a voltage held for 6 s or longer",
                "relaxation time and modulus of branch 3 (T_3, mu_4)",
            ),
        ];
        assert_eq!(
            record,
            expected.map(|(a, b)| (a.to_string(), b.to_string()))
        );
    }

    #[test]
    fn open_parameters_are_said_in_words() {
        let list = ["T_4", "T_6", "mu_5", "J", "torque_-20deg", "torque_20deg"];
        let mut list: Vec<Estimate> = list.iter().map(|n| estimate(n, "", 1.0, 1.0)).collect();
        list[3].meaning = "Locking constant of the Gent springs".into();
        let words =
            |places: &[usize]| in_words(&places.iter().map(|&i| &list[i]).collect::<Vec<_>>());
        assert_eq!(
            words(&[0, 1, 2]),
            "relaxation times of branches 4 and 6; modulus of branch 4"
        );
        assert_eq!(
            words(&[0, 2, 3]),
            "relaxation time and modulus of branch 4; locking constant of the Gent springs"
        );
        assert_eq!(words(&[4, 5]), "torque at \u{2212}20\u{b0} and 20\u{b0}");
    }
}
