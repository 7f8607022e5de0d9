//! Hanging samples as one dense least-squares problem: one film for all recordings, and what may differ
//! between them.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::aged::{Cause, Normal, Slot};
use super::outcome::Standing;
use crate::dataset::HangingDataset;
use crate::film::Film;
use crate::fit::levenberg_marquardt::{LeastSquares, Matrix};
use crate::model::HangingSample;
use crate::residual::{SampleKnob, SampleResidual, SampleRows, SampleTrouble, deviation};

/// Error of the steps over what is left of x, which is noise where the model fits; and over the motion for a
/// first look, which tells starts apart and whether the model fits.
const FINE: f64 = 0.01;
/// The same where the model does not fit: its numbers are off by more than this share of their errors.
const ROUGH: f64 = 0.05;

/// A prior: middle and standard deviation of an unknown.
pub(super) type Prior = Option<(f64, f64)>;

/// Group of a recording for each cause, by [`Cause::ALL`]: what `Slot::Cause` refers to.
pub(super) type Levels = [usize; 5];

/// One recording in the problem.
#[derive(Clone)]
pub(super) struct Hung<'a> {
    pub residual: SampleResidual<'a>,
    pub sample: HangingSample,
    /// Clock offset where it is not an unknown, s.
    pub offset_s: f64,
}

/// Dense least squares over several recordings.
pub(super) struct SampleProblem<'a> {
    pub recordings: &'a [Hung<'a>],
    /// The film where it is not free.
    pub film: Film,
    pub slots: Vec<Slot>,
    pub priors: Vec<Prior>,
    /// Of each recording.
    pub levels: Vec<Levels>,
    /// The positions at rest, where they count.
    pub rest: Option<Rest>,
}

/// Positions at rest of all recordings: how the samples were hung and how long they are.
#[derive(Clone)]
pub(super) struct Rest {
    /// Of each recording, m; their mean says nothing.
    pub seen_m: Vec<f64>,
    /// Standard deviation of one, m.
    pub sd_m: f64,
}

/// What a recording is run with.
pub(super) struct Setting {
    pub film: Film,
    pub sample: HangingSample,
    pub shift_m: f64,
    pub offset_s: f64,
    pub film_factor: f64,
}

impl<'a> SampleProblem<'a> {
    pub fn new(
        recordings: &'a [Hung<'a>],
        film: Film,
        slots: Vec<Slot>,
        priors: Vec<Prior>,
        levels: Vec<Levels>,
    ) -> Self {
        debug_assert_eq!(slots.len(), priors.len());
        debug_assert_eq!(recordings.len(), levels.len());
        SampleProblem {
            recordings,
            film,
            slots,
            priors,
            levels,
            rest: None,
        }
    }

    /// Film, sample, shift and offset of a recording at parameters `p`.
    pub fn setting(&self, number: usize, p: &[f64]) -> Setting {
        let recording = &self.recordings[number];
        let mut film = self.film.clone();
        let mut sample = recording.sample;
        let (mut shift_m, mut offset_s, mut factor) = (0.0, recording.offset_s, 1.0);
        for (slot, &value) in self.slots.iter().zip(p) {
            match *slot {
                Slot::LogTime(n) => film.relaxation_time_s[n] = value.exp(),
                Slot::Modulus(n) => film.mu_pa[n] = value,
                Slot::Shift(r) if r == number => shift_m = value,
                Slot::Offset(r) if r == number => offset_s = value,
                Slot::Cause(cause, level) if self.levels[number][cause as usize] == level => {
                    match cause {
                        Cause::ElectrodeStiffness => sample.electrode.modulus_pa += value,
                        Cause::SeriesResistance => sample.electrode.resistance_ohm += value,
                        Cause::ActiveArea => sample.electrode.active_fraction *= value,
                        Cause::FilmModulus => factor = value,
                        Cause::Load => sample.mass_kg *= value,
                    }
                }
                _ => {}
            }
        }
        for mu in &mut film.mu_pa {
            *mu *= factor;
        }
        Setting {
            film,
            sample,
            shift_m,
            offset_s,
            film_factor: factor,
        }
    }

    fn knobs(&self, number: usize) -> Vec<SampleKnob> {
        let mut out = Vec::new();
        let mut add = |knob| {
            if !out.contains(&knob) {
                out.push(knob);
            }
        };
        for slot in &self.slots {
            match *slot {
                Slot::LogTime(n) => add(SampleKnob::LogTime(n)),
                Slot::Modulus(n) => add(SampleKnob::Modulus(n)),
                Slot::Cause(cause, level) if self.levels[number][cause as usize] == level => {
                    match cause {
                        Cause::ElectrodeStiffness => add(SampleKnob::ElectrodeModulus),
                        Cause::SeriesResistance => add(SampleKnob::Resistance),
                        Cause::ActiveArea => add(SampleKnob::ActiveFraction),
                        Cause::FilmModulus => {
                            (0..self.film.mu_pa.len()).for_each(|n| add(SampleKnob::Modulus(n)));
                        }
                        Cause::Load => add(SampleKnob::Mass),
                    }
                }
                _ => {}
            }
        }
        out
    }

    /// Rows of every recording at `p`, with derivatives where asked for.
    pub fn evaluate(&self, p: &[f64], derivatives: bool) -> Result<Vec<SampleRows>, SampleTrouble> {
        (0..self.recordings.len())
            .into_par_iter()
            .map(|number| {
                let setting = self.setting(number, p);
                let knobs = if derivatives {
                    self.knobs(number)
                } else {
                    Vec::new()
                };
                self.recordings[number].residual.rows_at(
                    &setting.sample,
                    &setting.film,
                    setting.shift_m,
                    setting.offset_s,
                    &knobs,
                )
            })
            .collect()
    }

    /// Half the sum of squares at `p`; `None` where the model cannot be run.
    pub fn cost(&self, p: &[f64]) -> Option<f64> {
        let mut rows = vec![0.0; self.residual_count()];
        self.residuals(p, &mut rows).ok()?;
        let cost = 0.5 * dot(&rows, &rows);
        cost.is_finite().then_some(cost)
    }

    /// The knobs of a recording that a slot turns, each with its derivative by the slot.
    fn chain(&self, number: usize, slot: Slot, p: &[f64]) -> Vec<(SampleKnob, f64)> {
        let sample = &self.recordings[number].sample;
        match slot {
            Slot::LogTime(n) => vec![(SampleKnob::LogTime(n), 1.0)],
            Slot::Modulus(n) => vec![(SampleKnob::Modulus(n), self.setting(number, p).film_factor)],
            Slot::Cause(cause, level) if self.levels[number][cause as usize] == level => {
                match cause {
                    Cause::ElectrodeStiffness => vec![(SampleKnob::ElectrodeModulus, 1.0)],
                    Cause::SeriesResistance => vec![(SampleKnob::Resistance, 1.0)],
                    Cause::ActiveArea => {
                        vec![(SampleKnob::ActiveFraction, sample.electrode.active_fraction)]
                    }
                    Cause::Load => vec![(SampleKnob::Mass, sample.mass_kg)],
                    Cause::FilmModulus => {
                        let s = self.setting(number, p);
                        let springs = s.film.mu_pa.iter().enumerate();
                        springs
                            .map(|(n, mu)| (SampleKnob::Modulus(n), mu / s.film_factor))
                            .collect()
                    }
                }
            }
            _ => Vec::new(),
        }
    }

    /// Derivatives of a recording by a slot: of its rows, and of its length at rest; `None` where it has
    /// none.
    fn column(
        &self,
        number: usize,
        slot: Slot,
        p: &[f64],
        knobs: &[SampleKnob],
        rows: &SampleRows,
    ) -> Option<(Vec<f64>, f64)> {
        match slot {
            Slot::Shift(r) => return (r == number).then(|| (rows.shift.clone(), 0.0)),
            Slot::Offset(r) => return (r == number).then(|| (rows.offset.clone(), 0.0)),
            _ => {}
        }
        let mut sum = vec![0.0; rows.residuals.len()];
        let mut rest = 0.0;
        let chain = self.chain(number, slot, p);
        for (knob, by) in &chain {
            let at = knobs.iter().position(|k| k == knob)?;
            for (s, c) in sum.iter_mut().zip(&rows.columns[at]) {
                *s += by * c;
            }
            rest += by * rows.run.rest_columns[at];
        }
        (!chain.is_empty()).then_some((sum, rest))
    }

    /// Columns of a recording by slot number.
    fn columns(&self, number: usize, p: &[f64], rows: &SampleRows) -> Vec<(usize, Vec<f64>, f64)> {
        let knobs = self.knobs(number);
        let slots = self.slots.iter().enumerate();
        slots
            .filter_map(|(j, slot)| {
                let (column, rest) = self.column(number, *slot, p, &knobs, rows)?;
                Some((j, column, rest))
            })
            .collect()
    }

    /// Length at rest less what was seen, m, less its mean over the recordings.
    fn rest_left(&self, rest: &Rest, rows: &[SampleRows]) -> Vec<f64> {
        let lengths = rows.iter().zip(&rest.seen_m);
        let left: Vec<f64> = lengths.map(|(r, s)| r.run.rest_length_m - s).collect();
        let mean = left.iter().sum::<f64>() / left.len() as f64;
        left.iter().map(|l| l - mean).collect()
    }

    /// First row of each recording, and the number of all rows without priors.
    fn places(&self) -> (Vec<usize>, usize) {
        let mut at = 0;
        let first = self
            .recordings
            .iter()
            .map(|r| {
                let here = at;
                at += r.residual.rows();
                here
            })
            .collect();
        (first, at)
    }

    /// J^T J of the data alone at `p`, without priors.
    pub fn gram(&self, p: &[f64]) -> Result<DMatrix<f64>, SampleTrouble> {
        let mut jacobian = Matrix::zeros(self.residual_count(), self.slots.len());
        self.jacobian(p, &mut jacobian)?;
        let (_, data) = self.places();
        let data = jacobian.rows(0, data);
        Ok(data.tr_mul(&data))
    }

    /// The problem linearised at `p`, apart from the positions at rest, whose weight stays open.
    pub fn normal(&self, p: &[f64], seen_m: &[f64]) -> Result<Normal, SampleTrouble> {
        let rows = self.evaluate(p, true)?;
        let n = self.slots.len();
        let rest = Rest {
            seen_m: seen_m.to_vec(),
            sd_m: 1.0,
        };
        let mut out = Normal {
            gram: DMatrix::zeros(n, n),
            gradient: DVector::zeros(n),
            square: 0.0,
            rest: DMatrix::zeros(rows.len(), n),
            rest_left: DVector::from_vec(self.rest_left(&rest, &rows)),
        };
        for (number, rows) in rows.iter().enumerate() {
            let own = self.columns(number, p, rows);
            out.square += dot(&rows.residuals, &rows.residuals);
            for (at, (i, a, slope)) in own.iter().enumerate() {
                out.gradient[*i] += dot(a, &rows.residuals);
                out.rest[(number, *i)] = *slope;
                for (j, b, _) in &own[..=at] {
                    let product = dot(a, b);
                    out.gram[(*i, *j)] += product;
                    if i != j {
                        out.gram[(*j, *i)] += product;
                    }
                }
            }
        }
        for mut column in out.rest.column_iter_mut() {
            let mean = column.mean();
            column.add_scalar_mut(-mean);
        }
        for (j, prior) in self.priors.iter().enumerate() {
            if let Some((middle, sd)) = prior {
                out.gram[(j, j)] += sd.powi(-2);
                out.gradient[j] += (p[j] - middle) / (sd * sd);
                out.square += ((p[j] - middle) / sd).powi(2);
            }
        }
        Ok(out)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

impl LeastSquares for SampleProblem<'_> {
    type Error = SampleTrouble;

    fn parameter_count(&self) -> usize {
        self.slots.len()
    }

    fn residual_count(&self) -> usize {
        let rest = self.rest.as_ref().map_or(0, |r| r.seen_m.len());
        self.places().1 + self.priors.iter().flatten().count() + rest
    }

    fn residuals(&self, p: &[f64], out: &mut [f64]) -> Result<(), Self::Error> {
        let rows = self.evaluate(p, false)?;
        let mut at = 0;
        for r in &rows {
            out[at..at + r.residuals.len()].copy_from_slice(&r.residuals);
            at += r.residuals.len();
        }
        for (prior, value) in self.priors.iter().zip(p) {
            if let Some((middle, sd)) = prior {
                out[at] = (value - middle) / sd;
                at += 1;
            }
        }
        if let Some(rest) = &self.rest {
            for left in self.rest_left(rest, &rows) {
                out[at] = left / rest.sd_m;
                at += 1;
            }
        }
        Ok(())
    }

    fn jacobian(&self, p: &[f64], out: &mut Matrix) -> Result<(), Self::Error> {
        let rows = self.evaluate(p, true)?;
        out.fill(0.0);
        let (first, data) = self.places();
        let last = self.residual_count();
        for (number, rows) in rows.iter().enumerate() {
            for (j, column, rest) in self.columns(number, p, rows) {
                for (i, v) in column.iter().enumerate() {
                    out[(first[number] + i, j)] = *v;
                }
                if let Some(r) = &self.rest {
                    let count = r.seen_m.len();
                    let begin = last - count;
                    for i in 0..count {
                        let own = f64::from(u8::from(i == number));
                        out[(begin + i, j)] += (own - 1.0 / count as f64) * rest / r.sd_m;
                    }
                }
            }
        }
        let mut at = data;
        for (j, prior) in self.priors.iter().enumerate() {
            if let Some((_, sd)) = prior {
                out[(at, j)] = 1.0 / sd;
                at += 1;
            }
        }
        Ok(())
    }
}

/// The recordings of samples, on grids that are fine enough for `film` where it leaves noise of x.
pub(super) fn hang<'a>(
    datasets: &[&'a HangingDataset],
    samples: &[HangingSample],
    film: &Film,
) -> Result<Vec<Hung<'a>>, SampleTrouble> {
    let errors: Vec<f64> = datasets.iter().map(|d| FINE * d.noise_m).collect();
    hang_within(datasets, samples, film, &errors, 0.0)
}

/// The recordings of samples, on grids whose steps move x of each by less than `errors_m`, or by less than
/// `share` of what `film` moves.
pub(super) fn hang_within<'a>(
    datasets: &[&'a HangingDataset],
    samples: &[HangingSample],
    film: &Film,
    errors_m: &[f64],
    share: f64,
) -> Result<Vec<Hung<'a>>, SampleTrouble> {
    (0..datasets.len())
        .into_par_iter()
        .map(|i| {
            let (dataset, sample) = (datasets[i], &samples[i]);
            let (residual, _) = SampleResidual::settled(dataset, sample, film, errors_m[i], share)?;
            Ok(Hung {
                residual,
                sample: *sample,
                offset_s: dataset.offset_s,
            })
        })
        .collect()
}

/// The recordings of samples on the grids of a first look: true to a share of the motion as captured, or of
/// that of `film` where it moves more than what was captured.
pub(super) fn hang_at_first<'a>(
    datasets: &[&'a HangingDataset],
    samples: &[HangingSample],
    film: &Film,
) -> Result<Vec<Hung<'a>>, SampleTrouble> {
    let errors: Vec<f64> = datasets
        .iter()
        .map(|d| FINE * d.noise_m.max(deviation(&d.x_m)))
        .collect();
    hang_within(datasets, samples, film, &errors, FINE)
}

/// Root mean square of what `rows` leave of x, m, and of what its noise makes.
fn left(hung: &Hung, rows: &SampleRows) -> [f64; 2] {
    let noise = hung.residual.row_noise_m();
    let n = noise.len().max(1) as f64;
    let off = rows.residuals.iter().zip(&noise).map(|(r, n)| r * n);
    [
        off.map(|e| e * e).sum::<f64>(),
        noise.iter().map(|n| n * n).sum(),
    ]
    .map(|sum| (sum / n).sqrt())
}

/// Whether `rows` leave no more of x than a model that fits does, or nearly fits.
pub(super) fn fits(hung: &Hung, rows: &SampleRows) -> bool {
    let [left, noise] = left(hung, rows);
    Standing::of(left / noise) != Standing::DoesNotFit
}

/// Most of what `rows` leave of x in a recording, m rms.
pub(super) fn most_left_m(recordings: &[Hung], rows: &[SampleRows]) -> f64 {
    let all = recordings.iter().zip(rows);
    all.map(|(h, r)| left(h, r)[0]).fold(0.0, f64::max)
}

/// Error that the steps of a recording may make where `rows` are what is left, over that of one that the
/// model fits.
pub(super) fn room_of(recordings: &[Hung], rows: &[SampleRows]) -> Vec<f64> {
    let of = |(hung, rows): (&Hung, &SampleRows)| {
        let share = if fits(hung, rows) { 1.0 } else { ROUGH / FINE };
        (share * left(hung, rows)[0] / hung.residual.dataset().noise_m).max(1.0)
    };
    recordings.iter().zip(rows).map(of).collect()
}

/// Errors of steps that leave `room`, m.
pub(super) fn errors_m(datasets: &[&HangingDataset], room: &[f64]) -> Vec<f64> {
    let all = datasets.iter().zip(room);
    all.map(|(d, room)| FINE * d.noise_m * room).collect()
}
