//! Where the excess lives: in the user's coordinates, with a p-value that holds for the whole search.

use statrs::distribution::{ContinuousCDF, Normal};

use super::outcome::Place;
use super::subject::{At, Coordinate, Whereabouts, Words};
use super::swing::swing;
use crate::effects::Acting;

/// One kept residual of one actuator.
#[derive(Clone, Copy)]
pub(super) struct Spot {
    /// Number of the recording.
    pub recording: usize,
    /// 0 to 2.
    pub actuator: usize,
    /// Standardised torque error before.
    pub error: f64,
    /// Its square.
    pub before: f64,
    /// The same after; 1 where nothing was added.
    pub after: f64,
    /// Where it lies.
    pub at: At,
}

/// Bins of equal count into which a coordinate is cut.
const BINS: usize = 16;

/// The best contiguous run of bins: how much more excess a run holds than its share, as a log-likelihood
/// ratio of two mean squares against one.
fn best_run(mean: &[f64], count: &[f64]) -> Option<(usize, usize, f64)> {
    let n: f64 = count.iter().sum();
    let all: f64 = mean.iter().zip(count).map(|(m, c)| m * c).sum::<f64>() / n;
    let mut best: Option<(usize, usize, f64)> = None;
    for a in 0..mean.len() {
        let (mut sum, mut c) = (0.0, 0.0);
        for b in a..mean.len() {
            sum += mean[b] * count[b];
            c += count[b];
            if c > 0.7 * n || c < 1.0 {
                continue;
            }
            let (inside, outside) = (sum / c, (all * n - sum) / (n - c));
            if inside <= outside || outside <= 0.0 {
                continue;
            }
            let ratio = 0.5 * (n * all.ln() - c * inside.ln() - (n - c) * outside.ln());
            if best.is_none_or(|x| ratio > x.2) {
                best = Some((a, b, ratio));
            }
        }
    }
    best
}

/// What the plain model leaves beyond another one.
struct Excess<'a> {
    spots: &'a [Spot],
    total: f64,
}

/// A place with how much more likely it is than none, in ln.
type Rated = (f64, Place);

impl Excess<'_> {
    fn count(&self) -> f64 {
        self.spots.len() as f64
    }

    /// Shares of the excess and of the samples that lie inside.
    fn share(&self, inside: &dyn Fn(&Spot) -> bool) -> (f64, f64) {
        let (mut e, mut c) = (0.0, 0.0);
        for s in self.spots.iter().filter(|s| inside(s)) {
            e += s.before - s.after;
            c += 1.0;
        }
        ((e / self.total).clamp(0.0, 1.0), c / self.count())
    }

    /// By how much a variance of its own inside is likelier than one for all, in ln; 0 where it is no larger.
    fn ratio(&self, inside: &dyn Fn(&Spot) -> bool) -> f64 {
        let (mut m, mut c) = ([0.0; 2], [0.0; 2]);
        for s in self.spots {
            let i = usize::from(inside(s));
            m[i] += s.before;
            c[i] += 1.0;
        }
        if c[0] < 1.0 || c[1] < 1.0 || m[1] / c[1] <= m[0] / c[0] {
            return 0.0;
        }
        let n = self.count();
        let all = (m[0] + m[1]) / n;
        0.5 * (n * all.ln() - c[1] * (m[1] / c[1]).ln() - c[0] * (m[0] / c[0]).max(1e-12).ln())
    }

    /// The places that a named cause says of itself, which come first.
    fn own(&self, acting: &Acting, entries: &[Whereabouts]) -> Vec<Rated> {
        let places = own_places(acting, entries, self.spots).into_iter();
        let told = places.map(|(mut place, inside)| {
            let (excess, samples) = self.share(&*inside);
            (place.share_of_excess, place.share_of_samples) = (excess, samples);
            place.p_value = p_value(self.ratio(&*inside));
            (f64::INFINITY, place)
        });
        told.collect()
    }

    /// The range of a coordinate in which most lies; none where all is at one value.
    fn along(&self, coordinate: &Coordinate) -> Option<Rated> {
        let (spots, at, says) = (self.spots, coordinate.at, coordinate.says);
        let mut order: Vec<usize> = (0..spots.len()).collect();
        order.sort_by(|&a, &b| spots[a].at[at].total_cmp(&spots[b].at[at]));
        let edge = |i: usize| spots[order[(i * spots.len() / BINS).min(spots.len() - 1)]].at[at];
        let (mut mean, mut count) = (vec![0.0; BINS], vec![0.0; BINS]);
        for (i, &o) in order.iter().enumerate() {
            let b = i * BINS / spots.len();
            mean[b] += spots[o].before;
            count[b] += 1.0;
        }
        for (m, c) in mean.iter_mut().zip(&count) {
            *m /= f64::max(*c, 1.0);
        }
        let (a, b, ratio) = best_run(&mean, &count)?;
        // no -0
        let round = |x: f64| (x * coordinate.rounding).round() / coordinate.rounding + 0.0;
        let range = [round(edge(a)), round(edge(b + 1))];
        if range[0] >= range[1] {
            return None;
        }
        let (e, c) = self.share(&|s: &Spot| (range[0]..=range[1]).contains(&s.at[at]));
        let behind = match coordinate.unit.as_str() {
            "1" => String::new(),
            unit => format!(" {unit}"),
        };
        let place = Place {
            dimension: coordinate.dimension,
            called: says,
            range: Some(range),
            unit: coordinate.unit.clone(),
            value: None,
            recording: None,
            actuators: Vec::new(),
            share_of_excess: e,
            share_of_samples: c,
            p_value: p_value(ratio),
            says: format!(
                "{:.0} % of the excess lies at {} {says} of {} to {}{behind}, where {:.0} % of the samples are",
                100.0 * e,
                article(says),
                range[0],
                range[1],
                100.0 * c
            ),
        };
        Some((ratio, place))
    }

    /// The frequency of something that swings on its own, which tells more than where it is seen most.
    fn frequency(&self) -> Option<Rated> {
        let swing = swing(self.spots)?;
        let n = self.count();
        let mean = self.spots.iter().map(|s| s.before).sum::<f64>() / n;
        let inside = swing.share * mean / swing.band;
        let outside = (1.0 - swing.share) * mean / (1.0 - swing.band);
        let each = swing.band * inside.ln() + (1.0 - swing.band) * outside.ln();
        let ratio = 0.5 * n * (mean.ln() - each);
        let excess = (swing.share * mean - swing.band) / (mean - 1.0).max(1e-9);
        let [low, high] = swing.range_hz;
        let digits = (1.0 - (high - low).log10().floor()).clamp(0.0, 6.0) as usize;
        let place = Place {
            dimension: "frequency",
            called: "frequency",
            range: Some(swing.range_hz),
            unit: "Hz".into(),
            value: None,
            recording: None,
            actuators: Vec::new(),
            share_of_excess: excess.clamp(0.0, 1.0),
            share_of_samples: swing.band,
            p_value: p_value(ratio),
            says: format!(
                "{:.0} % of the excess lies at a frequency of {low:.digits$} to {high:.digits$} Hz, which is \
                 no multiple and no sum of those of the motion: something swings on its own",
                100.0 * excess.clamp(0.0, 1.0)
            ),
        };
        Some((f64::INFINITY, place))
    }

    /// A place that is a word, as `says` has it.
    fn word(
        &self,
        dimension: &'static str,
        [value, says]: [&str; 2],
        recording: Option<String>,
        actuators: Vec<usize>,
        inside: &dyn Fn(&Spot) -> bool,
    ) -> Rated {
        let ratio = self.ratio(inside);
        let (e, c) = self.share(inside);
        let place = Place {
            dimension,
            called: dimension,
            range: None,
            unit: String::new(),
            value: Some(value.into()),
            recording,
            actuators,
            share_of_excess: e,
            share_of_samples: c,
            p_value: p_value(ratio),
            says: format!(
                "{:.0} % of the excess lies {says}, {:.0} % of the samples",
                100.0 * e,
                100.0 * c
            ),
        };
        (ratio, place)
    }
}

/// Probability that noise finds a place as telling in so many tests. Neighbours are not independent: the
/// statistic counts one in so many.
fn p_value(ratio: f64) -> f64 {
    let (independent, tests) = (0.5, 120.0_f64);
    let z = (2.0 * (ratio * independent).max(0.0)).sqrt();
    (tests * 2.0 * (1.0 - Normal::standard().cdf(z))).clamp(1e-300, 1.0)
}

/// Where the excess lives, most telling first.
pub(super) fn locate(
    spots: &[Spot],
    entries: &[Whereabouts],
    coordinates: &[Coordinate],
    chains: usize,
    words: &Words,
    named: &[Acting],
) -> Vec<Place> {
    let total = spots.iter().map(|s| s.before - s.after).sum::<f64>();
    let excess = Excess {
        spots,
        total: total.max(1e-9),
    };
    // On a single coordinate a cause's values are in units of the recordings, and its place is found as any
    // other.
    let several = chains > 1;
    // of a single coordinate without a clock the order of the samples is all that is known
    let timed = several || coordinates.iter().any(|c| c.dimension == "time");
    // a line in what a named cause accounts for is that cause's
    let alone = timed && named.is_empty();
    let named = named.iter().filter(|_| several);
    let mut found: Vec<Rated> = named.flat_map(|a| excess.own(a, entries)).collect();
    found.extend(coordinates.iter().filter_map(|c| excess.along(c)));
    found.extend(alone.then(|| excess.frequency()).flatten());
    for k in 0..if several { chains } else { 0 } {
        let (value, says) = ((k + 1).to_string(), format!("in actuator {}", k + 1));
        let inside = |s: &Spot| s.actuator == k;
        found.push(excess.word("actuator", [&value, &says], None, vec![k + 1], &inside));
    }
    for (value, sign) in [("rising", 1.0), ("falling", -1.0)] {
        let says = format!("where the {} is {value}", words.directed);
        let inside = |s: &Spot| s.at[1] * sign > words.moving;
        found.push(excess.word("direction", [value, &says], None, Vec::new(), &inside));
    }
    for (r, entry) in entries.iter().enumerate().filter(|_| entries.len() > 1) {
        let says = format!("in recording {}", entry.id);
        let id = Some(entry.id.clone());
        let inside = |s: &Spot| s.recording == r;
        found.push(excess.word("recording", [&entry.id, &says], id, Vec::new(), &inside));
    }
    found.retain(|f| f.0 > 0.0 && (f.0.is_infinite() || f.1.share_of_excess > SHOWN));
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(8);
    found.into_iter().map(|f| f.1).collect()
}

/// Share of the excess from which a place is worth a sentence.
const SHOWN: f64 = 0.02;

/// The article before a word.
fn article(word: &str) -> &'static str {
    if word.starts_with(['a', 'e', 'i', 'o', 'u']) {
        "an"
    } else {
        "a"
    }
}

type Inside = Box<dyn Fn(&Spot) -> bool>;

/// The places that a named cause states by its own values: its actuator, its moment, its threshold.
fn own_places(acting: &Acting, entries: &[Whereabouts], spots: &[Spot]) -> Vec<(Place, Inside)> {
    let mut out: Vec<(Place, Inside)> = Vec::new();
    let id = acting.effect.id();
    let value = |name: &str| acting.value(name);
    let on = acting.on;
    let blank = |dimension, range, unit: &str, says: String| Place {
        dimension,
        called: dimension,
        range,
        unit: unit.to_owned(),
        value: None,
        recording: None,
        actuators: if on == [true; 3] {
            Vec::new()
        } else {
            (0..3).filter(|&k| on[k]).map(|k| k + 1).collect()
        },
        share_of_excess: 0.0,
        share_of_samples: 0.0,
        p_value: 1.0,
        says,
    };
    if on != [true; 3] {
        let list: Vec<usize> = (0..3).filter(|&k| on[k]).map(|k| k + 1).collect();
        let mut p = blank(
            "actuator",
            None,
            "",
            format!("{id} sits in actuator {}", list[0]),
        );
        p.value = Some(list[0].to_string());
        out.push((p, Box::new(move |s| on[s.actuator])));
    }
    if let (Some(time), Some(number)) = (value("time"), value("recording")) {
        let at = entries
            .iter()
            .position(|e| e.when.recording as f64 == number);
        let (name, from, to) = at.map_or((String::new(), time, time), |i| {
            let e = &entries[i];
            (e.id.clone(), time.max(e.span_s[0]), e.span_s[1])
        });
        let later: Vec<bool> = entries
            .iter()
            .map(|e| e.when.recording as f64 > number)
            .collect();
        let mut p = blank(
            "time",
            Some([from, to]),
            "s",
            format!("from {from:.2} s of {name} on, and in all later recordings"),
        );
        p.recording = Some(name);
        out.push((
            p,
            Box::new(move |s| later[s.recording] || (Some(s.recording) == at && s.at[2] >= time)),
        ));
    }
    let highest = |at: usize| {
        spots
            .iter()
            .map(|s| s.at[at])
            .fold(f64::NEG_INFINITY, f64::max)
    };
    if let Some(c) = value("ceiling") {
        let top = highest(0).max(c);
        out.push((
            blank(
                "voltage",
                Some([c, top]),
                "V",
                format!("above the ceiling of {c:.0} V"),
            ),
            Box::new(move |s| s.at[0] >= c),
        ));
    }
    let quantities = acting.effect.parameters().iter();
    let mut volts = quantities
        .zip(&acting.values)
        .filter(|(q, _)| q.unit == "V");
    if let Some((_, &t)) = volts.find(|(q, _)| q.name == "threshold") {
        out.push((
            blank(
                "voltage",
                Some([0.0, t]),
                "V",
                format!("below the threshold of {t:.0} V"),
            ),
            Box::new(move |s| s.at[0] <= t),
        ));
    }
    if let Some(r) = value("rate_up") {
        let down = value("rate_down").unwrap_or(r);
        let least = r.min(down);
        out.push((
            blank(
                "voltage_rate",
                Some([least, highest(1).max(least)]),
                "V/s",
                format!("where the command changes by more than {least:.0} V/s"),
            ),
            Box::new(move |s| s.at[1] >= r || s.at[1] <= -down),
        ));
    }
    if let Some(stop) = value("theta_stop") {
        let degrees = stop.to_degrees();
        let heights = spots
            .iter()
            .filter(|s| s.at[6] >= degrees - 0.3)
            .map(|s| s.at[3]);
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |a, h| {
            (a.0.min(h), a.1.max(h))
        });
        if low.is_finite() {
            out.push((
                blank(
                    "height",
                    Some([low, high]),
                    "mm",
                    format!(
                        "at heights of {low:.1} to {high:.1} mm, where the bicep touches its stop"
                    ),
                ),
                Box::new(move |s| s.at[6] >= degrees),
            ));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(directed: &'static str, moving: f64) -> Words {
        Words {
            unit: String::new(),
            basis: "all",
            over: "",
            directed,
            moving,
            rich: "",
            repeat: "",
        }
    }

    fn spots(chains: usize) -> Vec<Spot> {
        (0..200)
            .map(|i| {
                let x = f64::from(i) / 200.0;
                Spot {
                    recording: 0,
                    actuator: i as usize % chains,
                    error: if x > 0.9 { 3.0 } else { 1.0 },
                    before: if x > 0.9 { 9.0 } else { 1.0 },
                    after: 1.0,
                    at: [4000.0 * x, 0.0, x, x, 0.0, x, x],
                }
            })
            .collect()
    }

    #[test]
    fn values_in_units_of_the_recordings_are_not_told_as_volts() {
        let saturation = Acting {
            effect: crate::effects::line::by_id("amplifier_saturation").unwrap(),
            values: vec![0.9, 0.02],
            on: [true; 3],
        };
        let coordinate = Coordinate {
            dimension: "voltage",
            says: "input",
            unit: "MV^2".into(),
            at: 0,
            rounding: 1.0,
        };
        let named = std::slice::from_ref(&saturation);
        let coordinates = std::slice::from_ref(&coordinate);
        let one = locate(
            &spots(1),
            &[],
            coordinates,
            1,
            &words("coordinate", 0.5),
            named,
        );
        assert!(!one.is_empty());
        assert!(one.iter().all(|p| p.unit == "MV^2"), "{one:?}");
        // of a robot the same entry has volts
        let robot = Acting {
            effect: crate::effects::by_id("amplifier_saturation").unwrap(),
            values: vec![3600.0],
            on: [true; 3],
        };
        let three = locate(&spots(3), &[], &[], 3, &words("voltage", 100.0), &[robot]);
        assert_eq!(three[0].range, Some([3600.0, 3980.0]));
        assert_eq!(three[0].unit, "V");
    }

    #[test]
    fn a_direction_is_told_of_what_is_driven() {
        let mut all = spots(1);
        for s in &mut all {
            s.at[1] = if s.before > 1.0 { 1.0 } else { -1.0 };
        }
        let found = locate(&all, &[], &[], 1, &words("coordinate", 0.5), &[]);
        let place = found.iter().find(|p| p.dimension == "direction").unwrap();
        assert_eq!(
            place.says,
            "100 % of the excess lies where the coordinate is rising, 10 % of the samples"
        );
    }
}
