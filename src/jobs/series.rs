//! The order of recordings in time, and what that means for causes that begin, drift or break.

use super::Failure;
use crate::calibration::LineModel;
use crate::dataset::Dataset;
use crate::dataset::line::Line;
use crate::effects::{Acting, When};
use crate::recording::Recording;
use crate::report::parameter_file::{ParameterFile, SeriesEntry};

/// From one beginning to the next where no manifest states them, s.
const BETWEEN_S: f64 = 120.0;
/// Shortest pause between two recordings, s.
const PAUSE_S: f64 = 20.0;
/// Numbers further apart than this are dates or the like: only their order counts.
const APART: usize = 50;

/// Leading number of the last part of an id: 2 of `rig-a/02-single`.
fn leading_number(id: &str) -> Option<usize> {
    let last = id.rsplit('/').next()?;
    let digits = last
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(last.len());
    last[..digits].parse().ok()
}

/// The part of an id before its last: what recordings of one series share.
fn family(id: &str) -> &str {
    id.rsplit_once('/').map_or("", |(family, _)| family)
}

/// A series: its recordings in the order in which they were given, and what had to be assumed.
pub struct Series {
    pub entries: Vec<SeriesEntry>,
    pub remarks: Vec<String>,
}

/// What is known beforehand of when a recording was made.
pub struct Occasion<'a> {
    /// Its id.
    pub id: &'a str,
    /// Its `start` on the clock of the laboratory, s since 1970.
    pub clock_s: Option<f64>,
    /// Its first sample on its own motion clock, s.
    pub start_s: f64,
    /// Its length, s.
    pub duration_s: f64,
}

fn occasions<'a>(recordings: &'a [Recording], datasets: &[Dataset]) -> Vec<Occasion<'a>> {
    let each = recordings.iter().zip(datasets);
    each.map(|(r, d)| Occasion {
        id: &r.manifest.id,
        clock_s: r.manifest.start.as_ref().map(|s| s.clock_s),
        start_s: d.start_s,
        duration_s: d.samples() as f64 * d.step_s,
    })
    .collect()
}

/// The same of recordings of one coordinate.
pub fn occasions_of_lines<'a>(recordings: &'a [Recording], lines: &[Line]) -> Vec<Occasion<'a>> {
    let each = recordings.iter().zip(lines);
    each.map(|(r, l)| Occasion {
        id: &r.manifest.id,
        clock_s: r.manifest.start.as_ref().map(|s| s.clock_s),
        start_s: l.time_s.first().copied().unwrap_or(0.0),
        duration_s: l.step_s * l.samples() as f64,
    })
    .collect()
}

/// Puts recordings in the order in which they were made. Numbers are the leading ones of the ids, otherwise
/// the order of the stated beginnings, otherwise that of the command line.
pub fn order(recordings: &[Recording], datasets: &[Dataset]) -> Result<Series, Failure> {
    order_of(&occasions(recordings, datasets))
}

/// The same from when each recording was made.
pub fn order_of(occasions: &[Occasion]) -> Result<Series, Failure> {
    let ids: Vec<&str> = occasions.iter().map(|o| o.id).collect();
    let starts: Option<Vec<f64>> = occasions.iter().map(|o| o.clock_s).collect();
    let durations: Vec<f64> = occasions.iter().map(|o| o.duration_s).collect();
    arrange(&ids, starts.as_deref(), &durations)
}

/// What is said where recordings do not state when they were made.
pub fn assumed() -> String {
    format!(
        "Not every recording states its `start`: they are taken to begin about {BETWEEN_S:.0} s apart, in the order of their numbers. Causes that drift over minutes depend on that."
    )
}

fn arrange(ids: &[&str], starts: Option<&[f64]>, durations_s: &[f64]) -> Result<Series, Failure> {
    let mut remarks = Vec::new();
    let leading: Option<Vec<usize>> = ids.iter().map(|id| leading_number(id)).collect();
    let distinct = |n: &Vec<usize>| {
        let mut sorted = n.clone();
        sorted.sort_unstable();
        sorted.windows(2).all(|w| w[0] < w[1])
    };
    let numbers = match (leading.filter(distinct), starts) {
        (Some(numbers), _) => numbers,
        (None, Some(starts)) => {
            let rank = |s: &f64| 1 + starts.iter().filter(|other| *other < s).count();
            starts.iter().map(rank).collect()
        }
        (None, None) => {
            if ids.len() > 1 {
                remarks.push(
                    "Neither the ids nor `start` keys say in which order the recordings were made; the order of the command line was taken. Begin the last part of each id with a number, or state `start`.".into(),
                );
            }
            (1..=ids.len()).collect()
        }
    };
    let mut by_number: Vec<usize> = (0..ids.len()).collect();
    by_number.sort_by_key(|&i| numbers[i]);
    let mut begins_s = vec![0.0; ids.len()];
    for pair in by_number.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        begins_s[b] = begins_s[a]
            + match starts {
                Some(starts) if starts[b] <= starts[a] => {
                    return Err(format!(
                        "recording `{}` comes before `{}` by its number, and after it by its `start`: correct one of them",
                        ids[a], ids[b]
                    )
                    .into());
                }
                Some(starts) => starts[b] - starts[a],
                None => {
                    let apart = numbers[b] - numbers[a];
                    let steps = if apart > APART { 1 } else { apart };
                    (BETWEEN_S * steps as f64).max(durations_s[a] + PAUSE_S)
                }
            };
    }
    if starts.is_none() && ids.len() > 1 {
        remarks.push(assumed());
    }
    let mut families: Vec<&str> = ids.iter().map(|id| family(id)).collect();
    families.sort_unstable();
    families.dedup();
    if families.len() > 1 {
        remarks.push(format!(
            "The recordings are of several series by their ids ({}); they are taken as one.",
            families.join(", ")
        ));
    }
    let entries = (0..ids.len())
        .map(|i| SeriesEntry {
            id: ids[i].to_owned(),
            number: numbers[i],
            begins_s: begins_s[i],
            clock_s: starts.map(|s| s[i]),
        })
        .collect();
    Ok(Series { entries, remarks })
}

/// When a recording was made whose first sample is at `start_s` on its motion clock.
pub fn when(entry: &SeriesEntry, start_s: f64) -> When {
    When {
        recording: entry.number,
        series_s: entry.begins_s,
        start_s,
    }
}

/// The causes of a parameter file, and when each recording was made, as they see it.
pub struct AtWork {
    pub effects: Vec<Acting>,
    pub when: Vec<When>,
    pub remarks: Vec<String>,
}

/// The causes of `file` at work in `recordings`.
pub fn at_work(
    file: &ParameterFile,
    recordings: &[Recording],
    datasets: &[Dataset],
) -> Result<AtWork, Failure> {
    at_work_on(file, &occasions(recordings, datasets))
}

/// The causes of `file` at work on some occasions. A moment that is stated without its recording lies in the
/// first of them.
pub fn at_work_on(file: &ParameterFile, occasions: &[Occasion]) -> Result<AtWork, Failure> {
    if file.effects.is_empty() {
        return Ok(AtWork {
            effects: Vec::new(),
            when: vec![When::default(); occasions.len()],
            remarks: Vec::new(),
        });
    }
    let given = order_of(occasions)?;
    let number_of = |id: &str| {
        // Numbers begin at 1 here: 0 is a recording of another series, before everything.
        let known = file.series.iter().find(|e| e.id == id);
        let entry = known.or_else(|| given.entries.iter().find(|e| e.id == id));
        let number = entry.map(|e| e.number).or_else(|| leading_number(id));
        number.map(|n| n + 1)
    };
    let mut effects = file.acting(&number_of)?;
    let (when, remarks) = placed(file, &effects, occasions, &given);
    let first = when.iter().map(|w| w.recording).min();
    for (acting, entry) in effects.iter_mut().zip(&file.effects) {
        let quantities = acting.effect.parameters().iter();
        for (value, q) in acting.values.iter_mut().zip(quantities) {
            if q.name == "recording" && entry.moment_here() {
                *value = first.unwrap_or_default() as f64;
            }
        }
    }
    Ok(AtWork {
        effects,
        when,
        remarks,
    })
}

/// The model of a single coordinate with the causes of `file` at work in `recordings`, and what is to be said
/// of when these were made.
pub fn line_model_on(
    file: &ParameterFile,
    recordings: &[Recording],
    lines: &[Line],
) -> Result<(LineModel, Vec<String>), Failure> {
    let mut model = file.line_model()?;
    let goes_on = |a: &Acting| a.effect.over_series(&a.values);
    if !model.effects.iter().any(goes_on) {
        return Ok((model, Vec::new()));
    }
    let occasions = occasions_of_lines(recordings, lines);
    let (when, remarks) = placed(file, &model.effects, &occasions, &order_of(&occasions)?);
    let ids = lines.iter().map(|l| l.id.clone());
    model.when = ids.zip(when).collect();
    Ok((model, remarks))
}

/// When recordings were made, in the series of `file` where they are of it, and what is to be said of those
/// that are not. `effects` are those of the file.
fn placed(
    file: &ParameterFile,
    effects: &[Acting],
    occasions: &[Occasion],
    given: &Series,
) -> (Vec<When>, Vec<String>) {
    let first = file.series.iter().min_by_key(|e| e.number);
    let home = first.map(|e| family(&e.id));
    let known = |id: &str| file.series.iter().find(|e| e.id == id);
    let here = (file.effects.iter())
        .find_map(|e| e.values.iter().find(|(n, _)| n == "recording"))
        .and_then(|(_, v)| v.as_str())
        .map(family);
    let mut remarks = Vec::new();
    let mut when = Vec::new();
    for (occasion, own) in occasions.iter().zip(&given.entries) {
        let (id, start) = (occasion.id, occasion.clock_s);
        let same = home.or(here).is_none_or(|h| h == family(id));
        let entry = match (known(id), first) {
            (Some(entry), _) => entry.clone(),
            (None, Some(first)) if same => SeriesEntry {
                begins_s: match (start, first.clock_s) {
                    (Some(start), Some(zero)) => start - zero,
                    _ => BETWEEN_S * own.number.saturating_sub(first.number) as f64,
                },
                ..own.clone()
            },
            _ => own.clone(),
        };
        let mut w = self::when(&entry, occasion.start_s);
        w.recording = if same { entry.number + 1 } else { 0 };
        if !same {
            w.series_s = 0.0;
            for (e, acting) in file.effects.iter().zip(effects) {
                if e.values.iter().any(|(n, _)| n == "recording") {
                    remarks.push(format!(
                        "{id}: {} happened in another series and is not applied here.",
                        e.id
                    ));
                } else if acting.effect.over_series(&acting.values) {
                    remarks.push(format!(
                        "{id}: {} is taken as at the beginning of a series.",
                        e.id
                    ));
                }
            }
        }
        when.push(w);
    }
    (when, remarks)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(ids: &[&str], starts: Option<&[f64]>) -> Result<Series, String> {
        arrange(ids, starts, &vec![60.0; ids.len()]).map_err(|e| e.to_string())
    }

    #[test]
    fn numbers_come_from_ids_and_times_from_starts() {
        let s = of(&["a/04-x", "a/01-y", "a/02-z"], None).unwrap();
        let numbers: Vec<usize> = s.entries.iter().map(|e| e.number).collect();
        let begins: Vec<f64> = s.entries.iter().map(|e| e.begins_s).collect();
        assert_eq!((numbers, begins), (vec![4, 1, 2], vec![360.0, 0.0, 120.0]));
        assert!(s.remarks[0].contains("120 s apart"));
        let s = of(&["b", "a"], Some(&[100.0, 40.0])).unwrap();
        assert_eq!((s.entries[0].number, s.entries[0].begins_s), (2, 60.0));
        assert!(s.remarks.is_empty());
        let s = of(&["20260302-a", "20260303-b"], None).unwrap();
        assert_eq!(s.entries[1].begins_s, 120.0);
        let s = of(&["b", "a"], None).unwrap();
        assert_eq!(s.entries[0].number, 1);
        assert!(s.remarks[0].contains("order of the command line"));
        let s = of(&["x/1", "y/2"], None).unwrap();
        assert!(s.remarks[1].contains("several series"));
    }

    #[test]
    fn a_number_against_a_start_is_refused() {
        let text = of(&["a/1", "a/2"], Some(&[50.0, 10.0])).err().unwrap();
        assert!(text.contains("a/1") && text.contains("start"));
    }
}
