//! Hanging samples as one dense least-squares problem: one film for all recordings, and what may differ between them.

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::dataset::HangingDataset;
use crate::film::Film;
use crate::fit::levenberg_marquardt::{LeastSquares, Matrix};
use crate::model::HangingSample;
use crate::residual::{SampleKnob, SampleResidual, SampleRows, SampleTrouble};

/// What may differ between recordings of a sample: a cause of ageing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Cause {
    /// The electrode is an elastic layer on the active part: its modulus, Pa.
    ElectrodeStiffness,
    /// Wire and electrode feed the film through a resistance, ohm.
    SeriesResistance,
    /// Share of the active area (or of the permittivity: the two do the same) that is left.
    ActiveArea,
    /// All moduli of the film over those of the first level.
    FilmModulus,
    /// Mass on the free end over that stated.
    Load,
}

impl Cause {
    /// All of them.
    pub const ALL: [Cause; 5] = [
        Cause::ElectrodeStiffness,
        Cause::SeriesResistance,
        Cause::ActiveArea,
        Cause::FilmModulus,
        Cause::Load,
    ];

    /// The value that changes nothing.
    #[must_use]
    pub fn off(self) -> f64 {
        match self {
            Cause::ElectrodeStiffness | Cause::SeriesResistance => 0.0,
            Cause::ActiveArea | Cause::FilmModulus | Cause::Load => 1.0,
        }
    }

    /// A change that is worth a look: the search's unit of length.
    #[must_use]
    pub fn size(self) -> f64 {
        match self {
            Cause::ElectrodeStiffness => 5e4,
            Cause::SeriesResistance => 2e7,
            Cause::ActiveArea | Cause::FilmModulus | Cause::Load => 0.1,
        }
    }

    /// What the search allows.
    #[must_use]
    pub fn bounds(self) -> [f64; 2] {
        match self {
            Cause::ElectrodeStiffness => [-3e6, 3e7],
            Cause::SeriesResistance => [0.0, 1e12],
            Cause::ActiveArea | Cause::FilmModulus | Cause::Load => [0.02, 20.0],
        }
    }
}

/// One unknown of the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Slot {
    /// ln of the relaxation time of a branch, s.
    LogTime(usize),
    /// Modulus of a spring, Pa.
    Modulus(usize),
    /// Shift of x of a recording, m: its zero is a noisy mean.
    Shift(usize),
    /// Clock offset of a recording, s.
    Offset(usize),
    /// A cause, in the recordings of one level (by `levels`).
    Cause(Cause, usize),
}

/// A prior: middle and standard deviation of an unknown.
pub(super) type Prior = Option<(f64, f64)>;

/// Group of a recording for each cause, by [`Cause::ALL`]: what `Slot::Cause` refers to.
pub(super) type Levels = [usize; 5];

/// One recording in the problem.
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

    /// Derivative of the rows of a recording by a slot; `None` where it has none.
    fn column(&self, number: usize, slot: Slot, p: &[f64], rows: &SampleRows) -> Option<Vec<f64>> {
        let recording = &self.recordings[number];
        let knobs = self.knobs(number);
        let of = |knob| {
            let at = knobs.iter().position(|k| *k == knob)?;
            Some(&rows.columns[at])
        };
        let scaled = |column: &[f64], by: f64| column.iter().map(|v| v * by).collect::<Vec<f64>>();
        match slot {
            Slot::LogTime(n) => of(SampleKnob::LogTime(n)).cloned(),
            Slot::Modulus(n) => {
                let factor = self.setting(number, p).film_factor;
                of(SampleKnob::Modulus(n)).map(|c| scaled(c, factor))
            }
            Slot::Shift(r) => (r == number).then(|| rows.shift.clone()),
            Slot::Offset(r) => (r == number).then(|| rows.offset.clone()),
            Slot::Cause(cause, level) => {
                if self.levels[number][cause as usize] != level {
                    return None;
                }
                match cause {
                    Cause::ElectrodeStiffness => of(SampleKnob::ElectrodeModulus).cloned(),
                    Cause::SeriesResistance => of(SampleKnob::Resistance).cloned(),
                    Cause::ActiveArea => of(SampleKnob::ActiveFraction)
                        .map(|c| scaled(c, recording.sample.electrode.active_fraction)),
                    Cause::Load => {
                        of(SampleKnob::Mass).map(|c| scaled(c, recording.sample.mass_kg))
                    }
                    Cause::FilmModulus => {
                        let setting = self.setting(number, p);
                        let mut sum = vec![0.0; rows.residuals.len()];
                        for (n, mu) in setting.film.mu_pa.iter().enumerate() {
                            let column = of(SampleKnob::Modulus(n))?;
                            let own = mu / setting.film_factor;
                            for (s, c) in sum.iter_mut().zip(column) {
                                *s += own * c;
                            }
                        }
                        Some(sum)
                    }
                }
            }
        }
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

    /// J^T J of the data alone at `p`, without priors, and J^T r.
    pub fn gram(&self, p: &[f64]) -> Result<DMatrix<f64>, SampleTrouble> {
        let mut jacobian = Matrix::zeros(self.residual_count(), self.slots.len());
        self.jacobian(p, &mut jacobian)?;
        let (_, data) = self.places();
        let data = jacobian.rows(0, data);
        Ok(data.tr_mul(&data))
    }
}

impl LeastSquares for SampleProblem<'_> {
    type Error = SampleTrouble;

    fn parameter_count(&self) -> usize {
        self.slots.len()
    }

    fn residual_count(&self) -> usize {
        self.places().1 + self.priors.iter().flatten().count()
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
        Ok(())
    }

    fn jacobian(&self, p: &[f64], out: &mut Matrix) -> Result<(), Self::Error> {
        let rows = self.evaluate(p, true)?;
        out.fill(0.0);
        let (first, data) = self.places();
        for (number, rows) in rows.iter().enumerate() {
            for (j, slot) in self.slots.iter().enumerate() {
                if let Some(column) = self.column(number, *slot, p, rows) {
                    for (i, v) in column.iter().enumerate() {
                        out[(first[number] + i, j)] = *v;
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

/// The recordings of samples, on grids that are fine enough for `film`.
pub(super) fn hang<'a>(
    datasets: &[&'a HangingDataset],
    samples: &[HangingSample],
    film: &Film,
) -> Result<Vec<Hung<'a>>, SampleTrouble> {
    datasets
        .par_iter()
        .zip(samples)
        .map(|(dataset, sample)| {
            let (residual, _) = SampleResidual::settled(dataset, sample, film, dataset.noise_m)?;
            Ok(Hung {
                residual,
                sample: *sample,
                offset_s: dataset.offset_s,
            })
        })
        .collect()
}
