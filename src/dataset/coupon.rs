//! A film coupon: stretch and nominal stress on one clock, SI, with a mask, the noise of the stress, and a
//! grid in time.
//!
//! # What is done to the rows
//! *Stretch* is `1 + displacement/gauge` or as given; *nominal stress* is `force/(width thickness)` of the
//! unstretched section or as given. Nothing is smoothed, shifted or zeroed: the stress of the first rows
//! (preload, zero of the load cell) stays where it is and its size is noted. A row is masked, and a note says
//! so, where time does not come after every earlier row, where a value is missing, or where the stretch is
//! not positive. A row with a stretch but no stress still carries the history.
//!
//! A viscoelastic strip that is brought back is longer than before and hangs slack: it carries nothing, and
//! what the grips do is not what the film does. Such rows are masked, and the film's own stretch, which is
//! not measured there, goes straight in time from where it went slack to where it pulls again.
//!
//! # The grid
//! The film forgets on a logarithmic clock, so that the steps that a history needs grow with the time since
//! the rate last changed. Corners are the knots of the coarsest polygon that stays within a tolerance of the
//! measured stretch (Douglas and Peucker 1973, Cartographica 10:112); from each corner on the grid takes
//! [`GridChoice::steps`] steps of a quarter of the recorded step, then half as many of twice that, of four
//! times, and so on; no step changes ln lambda by more than [`GridChoice::largest_log_step`]. Corners closer
//! than a few rows are joined into one run of the recorded step. Between two rows the stretch is linear in
//! time. A 1800 s hold at 50 Hz is about 500 nodes instead of 90 000, and a T of any size between step and
//! duration sees about thirty steps in each doubling of time. A film that begins virgin but stretched starts
//! with a sixteenth of the recorded step. The grid carries the history only: the residual is that of every
//! row (see `residual::coupon`).
//!
//! # Noise
//! The standard deviation of the stress is that of its third differences over sqrt(20), by their median: high
//! frequencies only, robust against corners, never from a misfit, and never below what the written digits
//! resolve. Noise that the instrument has filtered comes out too small. Below [`FEW_ROWS`] rows third
//! differences see the curve itself, and the number is an upper bound; [`Coupon::noise_known`] says so.

use serde::{Deserialize, Serialize};

use super::noise::{difference, digit, of_differences};
use crate::film::InitialState;
pub use crate::recording::CouponMode;
use crate::recording::{FilmState, RawCoupon, RawElongation, RawLoad, Recording};

/// Rows below which the noise of the stress cannot be told from the curve.
pub const FEW_ROWS: usize = 64;
/// Corners closer than this many recorded steps are joined.
const JOIN_STEPS: f64 = 16.0;
/// The recorded step is divided by this after a corner: where T is near the step, the scheme's error is made
/// there.
const CORNER_SUBSTEPS: f64 = 4.0;
/// The recorded step is divided by this at the start of a virgin film that begins stretched.
const JUMP_SUBSTEPS: f64 = 16.0;
/// A virgin film that begins further than this from stretch 1 (as |ln lambda|) begins with a jump.
const JUMP: f64 = 1e-3;
/// A time step longer than this many ordinary ones is noted as a gap.
const GAP_STEPS: f64 = 10.0;

/// A tensile or relaxation test of bare film, as a calibration needs it.
#[derive(Debug, Clone, PartialEq)]
pub struct Coupon {
    /// Identity of the recording.
    pub id: String,
    /// How it was pulled.
    pub mode: CouponMode,
    /// State of the film at the first usable row.
    pub initial: InitialState,
    /// Time of each row, s; the row number where the file has no time.
    pub time_s: Vec<f64>,
    /// Whether the file has a time: without it relaxation times mean nothing.
    pub timed: bool,
    /// Stretch lambda_1 of each row; NaN where missing.
    pub stretch: Vec<f64>,
    /// Nominal stress of each row, Pa; NaN where missing.
    pub stress_pa: Vec<f64>,
    /// Rows that count: all three values, in the order of time.
    pub usable: Vec<bool>,
    /// Standard deviation of the stress noise, Pa.
    pub noise_pa: f64,
    /// Whether `noise_pa` is the noise, not only an upper bound.
    pub noise_known: bool,
    /// Ordinary distance of the rows, s (median).
    pub step_s: f64,
    /// The grid of the history.
    pub grid: Grid,
    /// Every choice that was made.
    pub plan: CouponPlan,
    /// What a reader should know, in words.
    pub notes: Vec<String>,
}

/// What a coupon is made of, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct CouponParts {
    /// Identity of the recording.
    pub id: String,
    /// How it was pulled.
    pub mode: CouponMode,
    /// State of the film at the first row.
    pub initial: InitialState,
    /// Time of each row, s; `None` where only the order of the rows is known.
    pub time_s: Option<Vec<f64>>,
    /// Stretch of each row; NaN where missing.
    pub stretch: Vec<f64>,
    /// Nominal stress of each row, Pa; NaN where missing.
    pub stress_pa: Vec<f64>,
}

/// How fine the grid is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GridChoice {
    /// Steps of a quarter of the recorded length after a corner; half as many at each doubling after that.
    pub steps: usize,
    /// Largest change of ln lambda in a step.
    pub largest_log_step: f64,
    /// Corners are found to this share of the range of the stretch.
    pub corner_tolerance: f64,
}

impl Default for GridChoice {
    fn default() -> Self {
        GridChoice {
            steps: 64,
            largest_log_step: 0.02,
            corner_tolerance: 2e-4,
        }
    }
}

/// Choices for one coupon, written beside its result.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CouponPlan {
    /// Identity of the recording.
    pub recording: String,
    /// How fine the grid is.
    pub grid: GridChoice,
    /// Corners that were found, s.
    pub corners_s: Vec<f64>,
    /// Nodes of the grid.
    pub nodes: usize,
    /// Rows that count.
    pub rows: usize,
    /// Rows that were masked.
    pub masked: usize,
    /// Noise of the stress found, Pa.
    pub noise_pa: f64,
}

/// Nodes of a stretch history, in runs of equal steps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    /// Time of each node, s.
    pub time_s: Vec<f64>,
    /// Stretch at each node.
    pub stretch: Vec<f64>,
    /// Stretch in the middle of the step that ends at each node (the first: at the node).
    pub mid_stretch: Vec<f64>,
    /// Runs: step in s and number of steps.
    pub runs: Vec<(f64, usize)>,
}

/// A recording that cannot become a coupon.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CouponError {
    /// The recording is of something else.
    #[error(
        "recording `{id}` has no [coupon]: a coupon calibration takes recordings of kind \"film-coupon\""
    )]
    NotACoupon {
        /// Recording.
        id: String,
    },
    /// Columns of different length.
    #[error(
        "coupon `{id}`: {time} times, {stretch} stretches and {stress} stresses: one of each a row is needed"
    )]
    Lengths {
        /// Recording.
        id: String,
        /// Number of times (of stretches where there is no time).
        time: usize,
        /// Number of stretches.
        stretch: usize,
        /// Number of stresses.
        stress: usize,
    },
    /// Too few rows that count.
    #[error(
        "coupon `{id}`: {usable} of {rows} rows have a later time, a positive stretch and a stress; {needed} are needed"
    )]
    TooShort {
        /// Recording.
        id: String,
        /// Rows that count.
        usable: usize,
        /// All rows.
        rows: usize,
        /// Rows that are needed.
        needed: usize,
    },
    /// A number whose powers are none.
    #[error(
        "coupon `{id}`: the {what} of row {} is {value:e}, and nothing beyond {largest:e} can be worked with: mend it, or empty the cell", row + 1
    )]
    Beyond {
        /// Recording.
        id: String,
        /// Which.
        what: &'static str,
        /// Which of its rows.
        row: usize,
        /// Its value.
        value: f64,
        /// The largest that there may be.
        largest: f64,
    },
    /// Stress or stretch that never changes.
    #[error("coupon `{id}`: the {what} is {value} in every row: nothing can be learned from it")]
    Flat {
        /// Recording.
        id: String,
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
    },
}

/// Largest magnitude in SI units: fourth powers of more, summed over a recording, need not be numbers.
pub(super) const LARGEST: f64 = 1e60;
/// Largest stretch: far beyond any elastomer, and any slip of percent or mm for m. The film's history of more
/// need not be numbers.
const LARGEST_STRETCH: f64 = 1e6;
/// Fewest rows of a coupon.
const FEWEST_ROWS: usize = 4;

impl CouponParts {
    /// The coupon of a recording in SI. Without `film_state` in its manifest the film counts as relaxed.
    ///
    /// # Errors
    /// [`CouponError::NotACoupon`].
    pub fn from_recording(recording: &Recording) -> Result<Self, CouponError> {
        let raw = recording
            .coupon
            .as_ref()
            .ok_or_else(|| CouponError::NotACoupon {
                id: recording.manifest.id.clone(),
            })?;
        let initial = match recording.manifest.film_state {
            Some(FilmState::Virgin) => InitialState::Virgin,
            Some(FilmState::Relaxed) | None => InitialState::Relaxed,
        };
        Ok(Self::from_raw(&recording.manifest.id, raw, initial))
    }

    /// The coupon of raw columns in SI.
    pub fn from_raw(id: &str, raw: &RawCoupon, initial: InitialState) -> Self {
        let si = |column: &crate::recording::RawColumn, over: f64| -> Vec<f64> {
            let factor = column.unit.map_or(1.0, |u| u.to_si) / over;
            column.values.iter().map(|v| v * factor).collect()
        };
        let stretch = match &raw.elongation {
            RawElongation::Displacement {
                displacement,
                gauge_mm,
            } => si(displacement, gauge_mm * 1e-3)
                .into_iter()
                .map(|strain| 1.0 + strain)
                .collect(),
            RawElongation::Stretch(stretch) => si(stretch, 1.0),
        };
        let stress_pa = match &raw.load {
            RawLoad::Force {
                force,
                width_mm,
                thickness_mm,
            } => si(force, width_mm * thickness_mm * 1e-6),
            RawLoad::NominalStress(stress) => si(stress, 1.0),
        };
        CouponParts {
            id: id.into(),
            mode: raw.mode,
            initial,
            time_s: raw.time_s.clone(),
            stretch,
            stress_pa,
        }
    }

    /// Columns of one length, and no number too large to work with.
    fn check(&self) -> Result<(), CouponError> {
        let (time_s, rows) = (self.time_s.as_deref(), self.stretch.len());
        let times = time_s.map_or(rows, <[f64]>::len);
        if times != rows || self.stress_pa.len() != rows {
            return Err(CouponError::Lengths {
                id: self.id.clone(),
                time: times,
                stretch: rows,
                stress: self.stress_pa.len(),
            });
        }
        for (what, values, largest) in [
            ("time", time_s.unwrap_or_default(), LARGEST),
            ("stretch", &self.stretch, LARGEST_STRETCH),
            ("stress", &self.stress_pa, LARGEST),
        ] {
            let beyond = |v: &f64| v.is_finite() && v.abs() > largest;
            if let Some(row) = values.iter().position(beyond) {
                return Err(CouponError::Beyond {
                    id: self.id.clone(),
                    what,
                    row,
                    value: values[row],
                    largest,
                });
            }
        }
        Ok(())
    }
}

impl Coupon {
    /// The coupon of a recording, on the default grid.
    ///
    /// # Errors
    /// [`CouponError`].
    pub fn from_recording(recording: &Recording) -> Result<Self, CouponError> {
        Self::new(
            CouponParts::from_recording(recording)?,
            &GridChoice::default(),
        )
    }

    /// Masks, measures the noise and lays the grid.
    ///
    /// # Errors
    /// [`CouponError`] when columns differ in length, fewer than four rows count, or nothing changes.
    pub fn new(parts: CouponParts, choice: &GridChoice) -> Result<Self, CouponError> {
        parts.check()?;
        let CouponParts {
            id,
            mode,
            initial,
            time_s,
            stretch,
            stress_pa,
        } = parts;
        let rows = stretch.len();
        let timed = time_s.is_some();
        let time_s = time_s.unwrap_or_else(|| (0..rows).map(|i| i as f64).collect());
        let mut notes = Vec::new();
        let (carries, mut usable) = mask(&time_s, &stretch, &stress_pa, &mut notes);
        let path: Vec<usize> = (0..rows).filter(|&i| carries[i]).collect();
        let mut counted: Vec<usize> = (0..rows).filter(|&i| usable[i]).collect();
        if counted.len() < FEWEST_ROWS {
            return Err(CouponError::TooShort {
                id,
                usable: counted.len(),
                rows,
                needed: FEWEST_ROWS,
            });
        }
        let path_t: Vec<f64> = path.iter().map(|&i| time_s[i]).collect();
        let mut path_x: Vec<f64> = path.iter().map(|&i| stretch[i]).collect();
        let stress: Vec<f64> = counted.iter().map(|&i| stress_pa[i]).collect();
        for (what, values) in [("stretch", &path_x), ("nominal stress", &stress)] {
            if range(values) <= 0.0 {
                let value = values[0];
                return Err(CouponError::Flat { id, what, value });
            }
        }
        let steps: Vec<f64> = path_t.windows(2).map(|w| w[1] - w[0]).collect();
        let step_s = median(&steps);
        if timed {
            note_gaps(&path_t, &path_x, step_s, &mut notes);
        } else {
            notes.push(
                "the file has no time: only the equilibrium spring can be fitted to it".into(),
            );
        }
        note_start(&stress, path_x[0], &mut notes);
        let noise_known = counted.len() >= FEW_ROWS;
        let noise_pa = noise(&counted, &time_s, &stress_pa, step_s);
        if !noise_known {
            notes.push(format!(
                "{} rows are too few to tell noise from the curve: the noise of {noise_pa:.3} Pa is an upper bound",
                counted.len()
            ));
        }
        let runs = slack(&counted, &stretch, &stress_pa, noise_pa);
        if noise_known && !runs.is_empty() {
            let measured = (&time_s[..], &stretch[..]);
            let own = leave_slack(&runs, &counted, measured, &mut usable, &mut notes);
            path_x = path.iter().map(|&i| own[i]).collect();
            counted.retain(|&i| usable[i]);
        }
        let jump = initial == InitialState::Virgin && path_x[0].ln().abs() > JUMP;
        let (grid, corners_s) = if timed {
            lay_grid(&path_t, &path_x, jump, choice)
        } else {
            // The order of the rows: every row a node.
            let runs = vec![(1.0, path_t.len() - 1)];
            (Grid::on(&path_t, &path_x, path_t.clone(), runs), Vec::new())
        };
        let plan = CouponPlan {
            recording: id.clone(),
            grid: *choice,
            corners_s,
            nodes: grid.time_s.len(),
            rows: counted.len(),
            masked: rows - counted.len(),
            noise_pa,
        };
        Ok(Coupon {
            id,
            mode,
            initial,
            time_s,
            timed,
            stretch,
            stress_pa,
            usable,
            noise_pa,
            noise_known,
            step_s,
            grid,
            plan,
            notes,
        })
    }

    /// Numbers of the rows that count.
    pub fn rows(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.usable.len()).filter(|&i| self.usable[i])
    }

    /// Range (largest minus smallest) of the measured nominal stress, Pa.
    pub fn stress_range_pa(&self) -> f64 {
        range(&self.rows().map(|i| self.stress_pa[i]).collect::<Vec<_>>())
    }

    /// Time from the first to the last node, s.
    pub fn duration_s(&self) -> f64 {
        self.grid.time_s[self.grid.time_s.len() - 1] - self.grid.time_s[0]
    }

    /// Stretches (lambda_1, lambda_2) of the mode at a stretch lambda_1. Uniaxial: lambda_1^(-1/2), whatever
    /// the moduli (see `residual::coupon`).
    pub fn stretches(&self, lambda: f64) -> [f64; 2] {
        match self.mode {
            CouponMode::Uniaxial => [lambda, 1.0 / lambda.sqrt()],
            CouponMode::Equibiaxial => [lambda, lambda],
            CouponMode::PureShear => [lambda, 1.0],
        }
    }
}

/// Which rows carry the history, and which of them count; notes on the others.
fn mask(
    time_s: &[f64],
    stretch: &[f64],
    stress_pa: &[f64],
    notes: &mut Vec<String>,
) -> (Vec<bool>, Vec<bool>) {
    let rows = stretch.len();
    let (mut carries, mut usable) = (vec![false; rows], vec![false; rows]);
    let mut latest = f64::NEG_INFINITY;
    let (mut back, mut missing, mut impossible) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..rows {
        if !time_s[i].is_finite() || !stretch[i].is_finite() {
            missing.push(i);
        } else if time_s[i] <= latest {
            back.push(i);
        } else if stretch[i] <= 0.0 {
            impossible.push(i);
        } else {
            latest = time_s[i];
            carries[i] = true;
            usable[i] = stress_pa[i].is_finite();
            if !usable[i] {
                missing.push(i);
            }
        }
    }
    let mut note = |list: &[usize], what: &str| {
        if let (Some(first), count) = (list.first(), list.len()) {
            let rows = if count == 1 { "row" } else { "rows" };
            notes.push(format!(
                "{count} {rows} masked (the first is data row {}): {what}",
                first + 1
            ));
        }
    };
    note(
        &back,
        "the time does not come after that of every earlier row",
    );
    note(&missing, "a value is missing");
    note(&impossible, "the stretch is not positive");
    (carries, usable)
}

fn note_gaps(time_s: &[f64], stretch: &[f64], step_s: f64, notes: &mut Vec<String>) {
    for i in 1..time_s.len() {
        let gap = time_s[i] - time_s[i - 1];
        if gap > GAP_STEPS * step_s {
            notes.push(format!(
                "gap of {gap:.3} s from {:.3} s on, over which the stretch goes from {:.4} to {:.4}: taken as linear in time",
                time_s[i - 1],
                stretch[i - 1],
                stretch[i]
            ));
        }
    }
}

/// Preload and zero of the load cell: said, not removed.
fn note_start(stress: &[f64], first_stretch: f64, notes: &mut Vec<String>) {
    let largest = stress.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
    let share = 100.0 * stress[0] / largest;
    if (first_stretch - 1.0).abs() < 1e-3 && share.abs() >= 0.1 {
        notes.push(format!(
            "the stress of the first row is {:.1} Pa ({share:.2} % of the largest) at stretch {first_stretch:.4}, where the model has none: kept as it is",
            stress[0]
        ));
    }
}

/// Fewest rows of a slack strip, and the share of them in which it carries nothing.
const SLACK_ROWS: usize = 8;
const SLACK_SHARE: f64 = 0.95;
/// Up to so many standard deviations of the noise, or this share of the largest stress, by which the zero of
/// a load cell may be off, a film carries nothing.
const NOTHING: f64 = 3.0;
const ZERO_SHARE: f64 = 0.01;

/// Stretches of `counted` rows in which a film that was loaded before carries nothing, although in tension it
/// would carry twice what a zero may be off: from the first such row up to the one in which it pulls again. A
/// film that pushes back is none that has gone slack.
fn slack(
    counted: &[usize],
    stretch: &[f64],
    stress_pa: &[f64],
    noise_pa: f64,
) -> Vec<(usize, usize)> {
    let stress = |c: usize| stress_pa[counted[c]];
    let strain = |c: usize| stretch[counted[c]] - 1.0;
    let all = 0..counted.len();
    let farthest = all.clone().max_by(|&a, &b| strain(a).total_cmp(&strain(b)));
    let Some(secant_pa) = farthest.map(|f| stress(f) / strain(f)) else {
        return Vec::new();
    };
    let largest = all.clone().map(stress).fold(0.0, f64::max);
    let nothing_pa = (NOTHING * noise_pa).max(ZERO_SHARE * largest);
    let carries = |c: usize| stress(c) > nothing_pa;
    let begins = |c: usize| !carries(c) && secant_pa * strain(c) > 2.0 * nothing_pa;
    let pulls = |c: usize| carries(c) && (c + 1 == counted.len() || carries(c + 1));
    let mut out = Vec::new();
    let mut at = all.clone().find(|&c| stress(c) > 2.0 * nothing_pa);
    while let Some(from) = at.and_then(|at| (at..counted.len()).find(|&c| begins(c))) {
        let to = (from..counted.len())
            .find(|&c| pulls(c))
            .unwrap_or(counted.len());
        at = Some(to);
        let within = (from..to).filter(|&c| stress(c).abs() <= nothing_pa);
        let zero_pa = median(&within.clone().map(stress).collect::<Vec<_>>());
        let share = within.count() as f64 / (to - from) as f64;
        // the first and last of these rows may be of a film that still pulls a little
        let mut hangs = (from..to).filter(|&c| stress(c) <= zero_pa + NOTHING * noise_pa);
        let Some(first) = hangs.next() else { continue };
        let end = hangs.next_back().unwrap_or(first) + 1;
        if end - first >= SLACK_ROWS && share >= SLACK_SHARE {
            out.push((first, end));
        }
    }
    out
}

/// Takes the rows in which a strip is slack (or buckled) out of those that count, and gives the film a
/// stretch of its own there: it shortens without stress, straight in time from where it went slack to where
/// it pulls again, and is never shorter than the grips ask for. Where it never pulls again its stretch is of no
/// consequence, and stays that of the grips. That is said.
fn leave_slack(
    runs: &[(usize, usize)],
    counted: &[usize],
    (time_s, stretch): (&[f64], &[f64]),
    usable: &mut [bool],
    notes: &mut Vec<String>,
) -> Vec<f64> {
    let mut own = stretch.to_vec();
    let mut rows = 0;
    for &(first, end) in runs {
        let before = counted[first.saturating_sub(1)];
        if let Some(&after) = counted.get(end) {
            let (from, to) = (stretch[before], stretch[after]);
            let span_s = time_s[after] - time_s[before];
            for i in before + 1..after {
                let share = (time_s[i] - time_s[before]) / span_s;
                own[i] = stretch[i].max(from + share * (to - from));
            }
        }
        counted[first..end].iter().for_each(|&i| usable[i] = false);
        rows += end - first;
    }
    if let Some(&(first, _)) = runs.first() {
        notes.push(format!(
            "on the way back the film carries nothing in {rows} rows, from stretch {:.3} down: there the strip hangs slack or is buckled. These rows do not count; the film is taken to shorten from where it went slack to where it pulls again",
            stretch[counted[first]]
        ));
    }
    own
}

/// Standard deviation of white noise in the stress: third differences over consecutive equal steps, by their
/// median.
fn noise(counted: &[usize], time_s: &[f64], stress_pa: &[f64], step_s: f64) -> f64 {
    let equal = |w: &[usize]| {
        w.windows(2).all(|p| {
            let step = time_s[p[1]] - time_s[p[0]];
            (step - step_s).abs() <= 0.2 * step_s
        })
    };
    let differences = |all: bool| -> Vec<f64> {
        counted
            .windows(4)
            .filter(|w| all || equal(w))
            .map(|w| difference(&[0, 1, 2, 3].map(|k| stress_pa[w[k]])))
            .collect()
    };
    let mut third = differences(false);
    if third.len() < 8 {
        third = differences(true);
    }
    let stresses = || counted.iter().map(|&i| stress_pa[i]);
    let span =
        stresses().fold(f64::NEG_INFINITY, f64::max) - stresses().fold(f64::INFINITY, f64::min);
    of_differences(third, 3, digit(stresses())).max(1e-9 * span)
}

fn range(values: &[f64]) -> f64 {
    let (low, high) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(*v), b.max(*v))
        });
    high - low
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

impl Grid {
    /// Nodes at `time_s` on the polygon through the rows.
    fn on(rows_t: &[f64], rows_x: &[f64], time_s: Vec<f64>, runs: Vec<(f64, usize)>) -> Self {
        let mut row = 0;
        let mut at = |t: f64| {
            while row + 2 < rows_t.len() && rows_t[row + 1] <= t {
                row += 1;
            }
            let f = ((t - rows_t[row]) / (rows_t[row + 1] - rows_t[row])).clamp(0.0, 1.0);
            rows_x[row] + f * (rows_x[row + 1] - rows_x[row])
        };
        let mut stretch = Vec::with_capacity(time_s.len());
        let mut mid_stretch = Vec::with_capacity(time_s.len());
        let mut before = time_s[0];
        for &t in &time_s {
            mid_stretch.push(at(0.5 * (before + t)));
            stretch.push(at(t));
            before = t;
        }
        Grid {
            time_s,
            stretch,
            mid_stretch,
            runs,
        }
    }

    /// The step that a time falls in: number of the node at its beginning, and the fraction of the step.
    pub fn place(&self, t_s: f64) -> (usize, f64) {
        let last = self.time_s.len() - 1;
        let after = self.time_s.partition_point(|t| *t <= t_s).clamp(1, last);
        let (a, b) = (self.time_s[after - 1], self.time_s[after]);
        (after - 1, ((t_s - a) / (b - a)).clamp(0.0, 1.0))
    }
}

/// Rows that are corners of the coarsest polygon within `tolerance` of all rows (Douglas and Peucker), ends
/// included.
fn corners(t: &[f64], x: &[f64], tolerance: f64) -> Vec<usize> {
    let mut keep = vec![false; t.len()];
    (keep[0], keep[t.len() - 1]) = (true, true);
    let mut open = vec![(0, t.len() - 1)];
    while let Some((a, b)) = open.pop() {
        let slope = (x[b] - x[a]) / (t[b] - t[a]);
        let mut worst = (a, tolerance);
        for i in a + 1..b {
            let off = (x[i] - x[a] - slope * (t[i] - t[a])).abs();
            if off > worst.1 {
                worst = (i, off);
            }
        }
        if worst.0 > a {
            keep[worst.0] = true;
            open.extend([(a, worst.0), (worst.0, b)]);
        }
    }
    (0..t.len()).filter(|&i| keep[i]).collect()
}

/// The grid of the module's description, and the corners, s.
fn lay_grid(t: &[f64], x: &[f64], jump: bool, choice: &GridChoice) -> (Grid, Vec<f64>) {
    let jitter = x.windows(4).map(difference).collect();
    let noise = of_differences(jitter, 3, 0.0);
    let tolerance = (choice.corner_tolerance * range(x)).max(4.0 * noise);
    let knots = corners(t, x, tolerance);
    // Ordinary step of the rows in an interval: of its first rows, which follow the corner.
    let step_of = |a: usize, b: usize| {
        let end = b.min(a + 64);
        median(
            &t[a..=end]
                .windows(2)
                .map(|w| w[1] - w[0])
                .collect::<Vec<_>>(),
        )
    };
    let log_limit = choice.largest_log_step.max(1e-6);
    let mut runs: Vec<(f64, usize)> = Vec::new();
    // Cuts a piece of time into equal steps no longer than `step` that change ln lambda by no more than the
    // limit.
    let cut = |length: f64, step: f64, log_change: f64| {
        let steps = (length / step - 1e-6).max(log_change / log_limit).ceil();
        let steps = (steps as usize).max(1);
        (length / steps as f64, steps)
    };
    let mut k = 0;
    while k + 1 < knots.len() {
        let (a, mut b) = (knots[k], knots[k + 1]);
        let step = step_of(a, b);
        let length = t[b] - t[a];
        let leap = jump && k == 0;
        let substeps = if leap { JUMP_SUBSTEPS } else { CORNER_SUBSTEPS };
        k += 1;
        if length < JOIN_STEPS * step && !leap {
            let mut steepest = (x[b] / x[a]).ln().abs() / length;
            while k + 1 < knots.len() {
                let next = knots[k + 1];
                let length = t[next] - t[b];
                if length >= JOIN_STEPS * step {
                    break;
                }
                steepest = steepest.max((x[next] / x[b]).ln().abs() / length);
                b = next;
                k += 1;
            }
            let length = t[b] - t[a];
            runs.push(cut(length, step, steepest * length));
            continue;
        }
        let slope = (x[b] - x[a]) / length;
        let stretch_at = |from_start: f64| x[a] + slope * from_start;
        let (mut done, mut step) = (0.0, step / substeps);
        let mut piece = choice.steps.max(2) as f64 * step;
        while done < length {
            // A remainder shorter than half a piece joins this one.
            let rest = length - done;
            let this = if rest < 1.5 * piece { rest } else { piece };
            let log_change = (stretch_at(done + this) / stretch_at(done)).ln().abs();
            runs.push(cut(this, step, log_change));
            done = if this == rest { length } else { done + this };
            step *= 2.0;
            piece = done;
        }
    }
    let mut time_s = vec![t[0]];
    let mut from = t[0];
    for &(step, steps) in &runs {
        time_s.extend((1..=steps).map(|i| from + step * i as f64));
        from = time_s[time_s.len() - 1];
    }
    // Rounding: the last node is the last row.
    let last = time_s.len() - 1;
    time_s[last] = t[t.len() - 1];
    let corners_s = knots.iter().map(|&i| t[i]).collect();
    (Grid::on(t, x, time_s, runs), corners_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(time_s: Vec<f64>, stretch: Vec<f64>, stress_pa: Vec<f64>) -> CouponParts {
        CouponParts {
            id: "c".into(),
            mode: CouponMode::Uniaxial,
            initial: InitialState::Virgin,
            time_s: Some(time_s),
            stretch,
            stress_pa,
        }
    }

    #[test]
    fn a_ramp_and_hold_needs_few_nodes_and_keeps_its_stretch() {
        let time: Vec<f64> = (0..90_000).map(|i| i as f64 * 0.02).collect();
        let stretch: Vec<f64> = time.iter().map(|t| 1.0 + (0.25 * t).min(1.0)).collect();
        let stress: Vec<f64> = stretch.iter().map(|x| 1e4 * (x - 1.0)).collect();
        let c = Coupon::new(
            parts(time.clone(), stretch.clone(), stress),
            &GridChoice::default(),
        )
        .unwrap();
        assert!(c.grid.time_s.len() < 700, "{}", c.grid.time_s.len());
        assert_eq!(c.plan.corners_s.len(), 3, "{:?}", c.plan.corners_s);
        assert_eq!(
            c.grid.runs.iter().map(|r| r.1).sum::<usize>() + 1,
            c.grid.time_s.len()
        );
        for (i, &t) in time.iter().enumerate().step_by(7) {
            let (k, f) = c.grid.place(t);
            let at = c.grid.stretch[k] + f * (c.grid.stretch[k + 1] - c.grid.stretch[k]);
            assert!((at - stretch[i]).abs() < 1e-9, "{t} {at} {}", stretch[i]);
        }
        let rate = |k: usize| (c.grid.stretch[k + 1] / c.grid.stretch[k]).ln().abs();
        assert!((0..c.grid.time_s.len() - 1).all(|k| rate(k) < 0.0201));
    }

    #[test]
    fn masked_rows_are_said() {
        let mut time: Vec<f64> = (0..100).map(|i| i as f64 * 0.1).collect();
        let stretch: Vec<f64> = time.iter().map(|t| 1.0 + 0.1 * t).collect();
        let mut stress: Vec<f64> = stretch.iter().map(|x| 1e4 * (x - 1.0) + 50.0).collect();
        time[40] = 1.0;
        time[41] = 1.1;
        stress[60] = f64::NAN;
        let c = Coupon::new(parts(time, stretch, stress), &GridChoice::default()).unwrap();
        assert_eq!(c.plan.masked, 3);
        assert!(c.notes[0].contains("2 rows masked (the first is data row 41)"));
        assert!(c.notes[1].contains("1 row masked (the first is data row 61)"));
        assert!(c.notes[2].contains("50.0 Pa"), "{:?}", c.notes);
    }

    #[test]
    fn noise_comes_from_high_frequencies() {
        let time: Vec<f64> = (0..4000).map(|i| i as f64 * 0.01).collect();
        let stretch: Vec<f64> = time.iter().map(|t| 1.0 + 0.05 * t).collect();
        let mut seed = 7_u64;
        let mut uniform = move || {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1);
            (seed >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        let stress: Vec<f64> = stretch
            .iter()
            .map(|x| 5e4 * (x - 1.0 / (x * x)) + 100.0 * (0..12).map(|_| uniform()).sum::<f64>())
            .collect();
        let c = Coupon::new(parts(time, stretch, stress), &GridChoice::default()).unwrap();
        assert!((c.noise_pa - 100.0).abs() < 5.0, "{}", c.noise_pa);
    }

    /// A strip (a spring and a Maxwell branch) that is pulled and brought back, its own stretch and its
    /// stress; one that hangs slack shortens without stress.
    fn pulled_and_back(hangs: bool) -> [Vec<f64>; 4] {
        let time: Vec<f64> = (0..3000).map(|i| i as f64 * 0.01).collect();
        let grips: Vec<f64> = time
            .iter()
            .map(|t| 1.0 + 0.25 * (1.0 - (0.7 * t).cos()))
            .collect();
        let (mut flown, mut own, mut stress) = (1.0_f64, Vec::new(), Vec::new());
        for l in &grips {
            let free = (flown + 1.0) / 2.0;
            let l = if hangs { l.max(free) } else { *l };
            flown += 0.01 * (l - flown);
            own.push(l);
            stress.push(5e4 * (2.0 * l - 1.0 - flown));
        }
        let mut seed = 11_u64;
        for s in &mut stress {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1);
            *s += 200.0 * ((seed >> 33) as f64 / (1u64 << 31) as f64 - 0.5);
        }
        [time, grips, own, stress]
    }

    #[test]
    fn a_strip_that_hangs_slack_has_a_stretch_of_its_own() {
        let [time, grips, own, stress] = pulled_and_back(true);
        let parts = parts(time.clone(), grips.clone(), stress.clone());
        let c = Coupon::new(parts, &GridChoice::default()).unwrap();
        assert!(
            c.notes.iter().any(|n| n.contains("hangs slack")),
            "{:?}",
            c.notes
        );
        let hangs = |i: usize| own[i] > grips[i] + 1e-9;
        let hanging = (0..time.len()).filter(|&i| hangs(i)).count();
        let counted = (0..time.len()).filter(|&i| hangs(i) && c.usable[i]).count();
        assert!(
            hanging > 300 && counted < hanging / 10,
            "{counted} of {hanging}"
        );
        // what is still in tension counts, but for what the noise hides
        let lost = (0..time.len())
            .filter(|&i| !hangs(i) && !c.usable[i])
            .count();
        assert!(lost < hanging / 4, "{lost} of {hanging}");
        for (t, own) in time.iter().zip(&own) {
            let (k, f) = c.grid.place(*t);
            let at = c.grid.stretch[k] + f * (c.grid.stretch[k + 1] - c.grid.stretch[k]);
            assert!((at - own).abs() < 0.02, "{t} s: {at} for {own}");
        }
    }

    #[test]
    fn a_strip_that_pushes_back_is_not_slack() {
        let [time, grips, _, stress] = pulled_and_back(false);
        let c = Coupon::new(parts(time, grips, stress), &GridChoice::default()).unwrap();
        assert_eq!(c.plan.masked, 0, "{:?}", c.notes);
    }

    #[test]
    fn what_cannot_be_a_coupon_says_why() {
        let grid = GridChoice::default();
        let short = Coupon::new(parts(vec![0.0], vec![1.0], vec![0.0]), &grid).unwrap_err();
        assert!(short.to_string().contains("1 of 1 rows"), "{short}");
        let time: Vec<f64> = (0..9).map(f64::from).collect();
        let flat = Coupon::new(parts(time.clone(), vec![1.5; 9], time.clone()), &grid).unwrap_err();
        assert!(flat.to_string().contains("stretch is 1.5"), "{flat}");
        let odd = Coupon::new(parts(time, vec![1.5; 3], vec![0.0; 9]), &grid).unwrap_err();
        assert!(matches!(odd, CouponError::Lengths { .. }));
        let time: Vec<f64> = (0..9).map(f64::from).collect();
        let mut far = time.iter().map(|t| 1.0 + t).collect::<Vec<_>>();
        far[3] = 1.8e19;
        let far = Coupon::new(parts(time.clone(), far, time), &grid).unwrap_err();
        assert!(
            far.to_string().contains("stretch of row 4 is 1.8e19"),
            "{far}"
        );
        assert!(Coupon::new(parts(vec![], vec![], vec![]), &grid).is_err());
    }
}
