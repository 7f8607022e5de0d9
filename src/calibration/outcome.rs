//! What a calibration found: plain data, for reports and files. Nothing here is computed again when it is
//! shown.

use std::borrow::Cow;

use crate::dataset::Plan;
use crate::model::Parameters;

/// A bound at which an estimate rests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtBound {
    /// The smallest value allowed.
    Lower,
    /// The largest value allowed.
    Upper,
}

/// Command above which errors in volts count, V: below, what the noise of the capture makes of a voltage
/// grows without bound.
pub const JUDGED_ABOVE_V: f64 = 1000.0;

/// How the error that a model leaves stands to the noise: decided here for all kinds of recordings and all
/// pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Standing {
    /// There is no error, or no noise to hold it against.
    CannotBeJudged,
    /// As good as the data.
    Fits,
    /// More than noise, less than what would be a wrong model.
    NearlyFits,
    /// Something is left out.
    DoesNotFit,
}

impl Standing {
    /// Error over noise below which a model fits, and nearly fits: noise that is read from a recording is
    /// known to a quarter or so.
    pub const RATIOS: [f64; 2] = [1.25, 2.0];

    /// Of an error over the noise.
    #[must_use]
    pub fn of(ratio: f64) -> Self {
        match ratio {
            r if !r.is_finite() => Standing::CannotBeJudged,
            r if r < Standing::RATIOS[0] => Standing::Fits,
            r if r < Standing::RATIOS[1] => Standing::NearlyFits,
            _ => Standing::DoesNotFit,
        }
    }
}

/// One estimated (or fixed) parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Name, as `--fix` takes it.
    pub name: String,
    /// What it is.
    pub meaning: String,
    /// Unit of all values here.
    pub unit: Cow<'static, str>,
    /// Value.
    pub value: f64,
    /// Standard error; NaN where it was fixed or rests on a bound.
    pub std_error: f64,
    /// 95 % interval; equal ends where it was fixed, the bounds where the data say nothing.
    pub ci95: [f64; 2],
    /// Whether it rests on a bound.
    pub at_bound: Option<AtBound>,
    /// Whether the data determine it (to a third of itself, torques to 0.2 mN m).
    pub identifiable: bool,
    /// Whether it was held.
    pub fixed: bool,
    /// How far to trust it, in words.
    pub says: String,
}

/// A combination of parameters that the recordings leave open.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakDirection {
    /// Relative standard deviation along it.
    pub relative_sd: f64,
    /// Parameters that take part and their share (-1 to 1), largest first.
    pub parts: Vec<(String, f64)>,
    /// In words.
    pub says: String,
}

/// Error of the predicted voltage of one chain in one recording.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ChainError {
    /// Root mean square over samples whose command exceeds 1 kV, V.
    pub rmse_v: f64,
    /// Largest magnitude among them, V.
    pub max_error_v: f64,
    /// Their number.
    pub samples: usize,
    /// Root mean square over all samples that count, V.
    pub rmse_all_v: f64,
    /// Number of all samples that count.
    pub samples_all: usize,
    /// What the noise of the capture alone makes of the prediction, above 1 kV, V rms.
    pub noise_floor_v: f64,
    /// Samples with phi^2 < 0: no voltage holds that pose.
    pub negative: usize,
}

/// Sums of errors of one chain, or of all.
#[derive(Default, Clone, Copy)]
pub(super) struct Sums {
    pub squares: f64,
    largest: f64,
    pub count: usize,
    all: f64,
    count_all: usize,
    pub floor: f64,
    negative: usize,
}

impl Sums {
    /// Adds a sample: its error, whether phi^2 < 0, and, where it is judged in volts, the square that noise
    /// makes of it.
    pub fn add(&mut self, error: f64, negative: bool, judged: Option<f64>) {
        self.all += error * error;
        self.count_all += 1;
        self.negative += usize::from(negative);
        if let Some(noise) = judged {
            self.squares += error * error;
            self.largest = self.largest.max(error.abs());
            self.floor += noise;
            self.count += 1;
        }
    }

    pub fn merge(&mut self, other: &Sums) {
        self.squares += other.squares;
        self.largest = self.largest.max(other.largest);
        self.count += other.count;
        self.all += other.all;
        self.count_all += other.count_all;
        self.floor += other.floor;
        self.negative += other.negative;
    }

    pub fn error(&self) -> ChainError {
        ChainError {
            rmse_v: root_mean(self.squares, self.count),
            max_error_v: self.largest,
            samples: self.count,
            rmse_all_v: root_mean(self.all, self.count_all),
            samples_all: self.count_all,
            noise_floor_v: root_mean(self.floor, self.count),
            negative: self.negative,
        }
    }
}

/// Root of a mean of `n` squares; NaN of none.
pub(super) fn root_mean(sum: f64, n: usize) -> f64 {
    match n {
        0 => f64::NAN,
        n => (sum / n as f64).sqrt(),
    }
}

/// One recording against the model.
#[derive(Debug, Clone)]
pub struct RecordingOutcome {
    /// Identity.
    pub id: String,
    /// Errors of chains 1 to 3.
    pub chains: [ChainError; 3],
    /// Errors of all chains together.
    pub total: ChainError,
    /// Clock offset, s, and its standard error where it was estimated.
    pub offset_s: f64,
    /// Standard error of the offset; `None` where it was stated.
    pub offset_std_error_s: Option<f64>,
    /// Choices made for it.
    pub plan: Plan,
    /// Time of each frame, s.
    pub time_s: Vec<f64>,
    /// Smoothed position, mm.
    pub position_mm: Vec<[f64; 3]>,
    /// Commanded voltage, V.
    pub command_v: Vec<[f64; 3]>,
    /// Predicted voltage, V (phi^2 < 0 as 0 V; NaN where out of reach).
    pub predicted_v: Vec<[f64; 3]>,
    /// Predicted phi^2, V^2.
    pub predicted_squared_v2: Vec<[f64; 3]>,
    /// Its standard deviation from the capture noise, V.
    pub sd_v: Vec<[f64; 3]>,
    /// The amplifier's own measurement at each frame, V, where there is one.
    pub monitor_v: Option<Vec<[f64; 3]>>,
    /// Frames that count in the errors.
    pub counts: Vec<bool>,
    /// Frames in a gap of the capture.
    pub gap: Vec<bool>,
    /// Frames out of reach, and why.
    pub unreachable: Vec<(usize, String)>,
    /// Torque each lozenge needs, by cause (`Contribution::ALL`): root mean square over the recording, N m.
    pub contributions_n_m: Vec<(String, [f64; 3])>,
    /// Forearm swing of the three chains, deg.
    pub swing_deg: Vec<[f64; 3]>,
    /// Gaps: first frame index and length.
    pub gaps: Vec<(usize, usize)>,
    /// Where the cycles of the drive begin, and where the last one ends, s; empty where it does not repeat.
    pub cycles_s: Vec<f64>,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// One start of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct StartOutcome {
    /// Where it came from.
    pub origin: String,
    /// Cost that it reached (sum of squares per residual, with the weights of the first round).
    pub cost: f64,
    /// Evaluations that it took.
    pub evaluations: usize,
    /// Evaluations that failed.
    pub failed: usize,
    /// Why it ended.
    pub ended: String,
    /// Relaxation times, s, and J that it reached.
    pub reached: Vec<f64>,
}

/// Where the prediction errs most, against the noise.
#[derive(Debug, Clone, PartialEq)]
pub struct WorstPlace {
    /// The place, in words.
    pub place: String,
    /// Error there over what the noise makes there.
    pub ratio: f64,
    /// Root mean square error there, V.
    pub rmse_v: f64,
    /// Share of the whole excess over the noise.
    pub share: f64,
}

/// Everything that a calibration found.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// What was done: `film`, `forearm`, `robot` or `validate`.
    pub job: &'static str,
    /// Film and forearm.
    pub parameters: Parameters,
    /// Relative permittivity used.
    pub eps_r: f64,
    /// Every parameter, in order.
    pub estimates: Vec<Estimate>,
    /// Correlation of the free estimates (names, rows).
    pub correlation: (Vec<String>, Vec<Vec<f64>>),
    /// Combinations that the data leave open, worst first.
    pub weak_directions: Vec<WeakDirection>,
    /// The recordings.
    pub recordings: Vec<RecordingOutcome>,
    /// Errors over all recordings.
    pub total: ChainError,
    /// The starts, best first.
    pub starts: Vec<StartOutcome>,
    /// Whether the fit converged.
    pub converged: bool,
    /// Why it stopped.
    pub reason: String,
    /// Evaluations of all rounds, and how many failed.
    pub evaluations: usize,
    /// Failed evaluations.
    pub failed_evaluations: usize,
    /// Weighted residual per residual, and what the noise alone would make of it.
    pub weighted_mean_square: f64,
    /// The same of the noise alone.
    pub noise_mean_square: f64,
    /// Torque curve with its 95 % band on a fine grid: angle deg, torque mN m, half width mN m.
    pub torque_band: Vec<[f64; 3]>,
    /// Range of forearm swing that the recordings cover, deg.
    pub swing_range_deg: [f64; 2],
    /// Where the prediction errs most.
    pub worst: Vec<WorstPlace>,
    /// First sentence: does it fit?
    pub verdict: String,
    /// Further sentences a reader should see.
    pub remarks: Vec<String>,
}
