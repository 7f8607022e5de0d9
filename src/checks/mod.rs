//! Wiring before physics: what is wrong with a recording, told before anything is fitted.
//!
//! A check looks at one recording as it was opened, in milliseconds: at numbers that no laboratory has, at
//! samples that are no measurement, at whether what moves is what was driven and when, in which direction,
//! and with which sign. It never fits the model; the most it does is a linear regression of a few columns. It
//! fires where the evidence for a mistake is larger than what the strongest left-out physics could make (the
//! limits stand with each check, and how they were come by), and it changes nothing.
//!
//! A new check is a file with `pub(super) fn check(view: &View, found: &mut Findings)` and a line in
//! `CHECKS`.

mod axis;
mod base;
mod bench;
mod clock;
mod coupon;
mod dead_channel;
mod exchanged;
mod film_sides;
mod frozen;
mod glance;
mod leap;
mod linear;
mod noise;
mod polarity;
mod rows_lost;
mod sample;
mod sentinel;
mod stated;
mod stated_parameters;
mod view;
mod wiring;

use rayon::prelude::*;

use crate::recording::Recording;
pub use stated_parameters::check_parameters;
use view::View;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Said; the job goes on.
    Doubtful,
    /// The recording, or a stated number, is not what it is taken for: a diagnosis names no physics.
    Wrong,
}

impl Grade {
    /// As files write it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Grade::Doubtful => "doubtful",
            Grade::Wrong => "wrong",
        }
    }
}

/// Something that is wrong with a recording, or looks so.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The kind of mistake: `chain_order`, `mirror`, `axes`, `unit`, `rate`, `clock`, `polarity`, `sentinel`,
    /// `leap`, `spikes`, `frozen`, `exchanged`, `dead_channel`, `rows_lost`, `sign`, `stated_value`, `base`,
    /// `noise`, `resolution`, `aliasing`, `mismatch`.
    pub check: &'static str,
    /// How bad it is.
    pub grade: Grade,
    /// Identity of the recording; empty for a parameter file.
    pub recording: String,
    /// What is seen, with the evidence.
    pub says: String,
    /// What to do.
    pub remedy: String,
    /// Probability of evidence as strong from a sound recording; NaN where it is a matter of plausibility and
    /// not of chance.
    pub p_value: f64,
}

impl Finding {
    /// Finding and remedy in one line: `says. Remedy.`
    #[must_use]
    pub fn line(&self) -> String {
        let mut remedy = self.remedy.chars();
        let first = remedy.next().map(|c| c.to_uppercase().to_string());
        format!(
            "{}. {}{}",
            self.says,
            first.unwrap_or_default(),
            remedy.as_str()
        )
    }
}

/// Findings as they are collected.
pub(crate) struct Findings {
    recording: String,
    list: Vec<Finding>,
}

impl Findings {
    fn add(&mut self, check: &'static str, grade: Grade, says: String, remedy: impl Into<String>) {
        self.add_with(check, grade, says, remedy, f64::NAN);
    }

    fn add_with(
        &mut self,
        check: &'static str,
        grade: Grade,
        says: String,
        remedy: impl Into<String>,
        p_value: f64,
    ) {
        self.list.push(Finding {
            check,
            grade,
            recording: self.recording.clone(),
            says,
            remedy: remedy.into(),
            p_value,
        });
    }

    /// Whether something wrong was found by one of these checks.
    fn wrong(&self, checks: &[&str]) -> bool {
        let among = |f: &Finding| f.grade == Grade::Wrong && checks.contains(&f.check);
        self.list.iter().any(among)
    }
}

type Check = fn(&View<'_>, &mut Findings);

/// The checks in the order in which they are made: numbers, samples, then who moves when. Later ones pass
/// over what earlier ones explain.
const CHECKS: &[Check] = &[
    stated::check,
    sentinel::check,
    frozen::check,
    exchanged::check,
    base::check,
    noise::check,
    rows_lost::check,
    polarity::check,
    dead_channel::check,
    clock::check,
    wiring::check,
    leap::check,
    sample::check,
    axis::check,
    bench::check,
    coupon::check,
    film_sides::check,
];

/// What is wrong with a recording, worst first.
#[must_use]
pub fn check(recording: &Recording) -> Vec<Finding> {
    let view = View::new(recording);
    let mut found = Findings {
        recording: recording.manifest.id.clone(),
        list: Vec::new(),
    };
    for check in CHECKS {
        check(&view, &mut found);
    }
    let mut list = found.list;
    list.sort_by_key(|f| std::cmp::Reverse(f.grade));
    list
}

/// What is wrong with recordings, one after the other.
#[must_use]
pub fn check_all(recordings: &[Recording]) -> Vec<Finding> {
    recordings.par_iter().flat_map_iter(check).collect()
}
