//! Recordings of hanging samples with causes at work, as one residual: x predicted minus x captured, over the
//! capture's noise.
//!
//! The noise is in x alone and the voltage is known, so that the model is run forward (`residual::sample`):
//! nothing is smoothed, no acceleration is needed, and each row has variance one where the model is right. (The
//! voltage that a motion needs is not even linear in the moduli here: lambda_2 follows from them.) Where x is
//! zero is known from a few frames at rest only, so that the mean of each recording is taken out of all rows and
//! columns.
//!
//! Unknowns are  ln T_1.., 1/J, mu_0, mu_1.., free clock offsets, values of causes over their spreads. Moduli
//! and times have the exact derivatives of the scheme; 1/J and the values of causes those of a difference.

use std::sync::Arc;

use nalgebra::DMatrix;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use super::sample::{Acts, SampleKnob, SampleResidual, SampleRun, SampleTrouble, run_sample_with};
use super::{Normal, SeparableResidual, Slope};
use crate::effects::{Acting, Site, When};
use crate::film::{Film, Locked};
use crate::model::{HangingSample, SampleLoad};

/// Steps of the unknowns that are differenced: 1/J, and values over their spreads.
const STEP_LOCKING: f64 = 1e-4;
const STEP_VALUE: f64 = 1e-3;
/// Passes along a course, and along one that is only moved a little.
const PASSES: usize = 12;
const PASSES_BESIDE: usize = 2;

/// One recording.
#[derive(Debug, Clone)]
pub struct Hung<'a> {
    /// Its rows.
    pub residual: SampleResidual<'a>,
    /// The sample as stated.
    pub sample: HangingSample,
    /// Whether its clock offset is an unknown.
    pub free_offset: bool,
}

/// Recordings of hanging samples of one film, with causes at work.
#[derive(Debug, Clone)]
pub struct HangingResidual<'a> {
    recordings: Arc<[Hung<'a>]>,
    branches: usize,
    when: Vec<When>,
    effects: Vec<Acting>,
    free: Vec<(usize, usize)>,
}

/// A run of one recording with what causes make of it.
struct Ran {
    run: SampleRun,
    loads: Vec<SampleLoad>,
}

impl<'a> HangingResidual<'a> {
    /// Without causes, of a film with so many branches.
    #[must_use]
    pub fn new(recordings: Vec<Hung<'a>>, branches: usize, when: &[When]) -> Self {
        HangingResidual {
            recordings: recordings.into(),
            branches,
            when: when.to_vec(),
            effects: Vec::new(),
            free: Vec::new(),
        }
    }

    /// The same recordings with `effects` at work; `free` are those of their values that are unknowns.
    #[must_use]
    pub fn with_effects(
        &self,
        effects: Vec<Acting>,
        free: Vec<(usize, usize)>,
        when: &[When],
    ) -> Self {
        HangingResidual {
            recordings: Arc::clone(&self.recordings),
            branches: self.branches,
            when: when.to_vec(),
            effects,
            free,
        }
    }

    /// The recordings.
    pub fn recordings(&self) -> &[Hung<'a>] {
        &self.recordings
    }

    /// When they were made.
    pub fn when(&self) -> &[When] {
        &self.when
    }

    /// Rows of all recordings.
    pub fn rows(&self) -> usize {
        self.recordings.iter().map(|r| r.residual.rows()).sum()
    }

    /// Number of unknowns of the film.
    pub fn film_unknowns(&self) -> usize {
        2 * self.branches + 2
    }

    /// Clock offsets that the recordings with a free one begin with, s.
    pub fn free_offsets_s(&self) -> Vec<f64> {
        let free = self.recordings.iter().filter(|r| r.free_offset);
        free.map(|r| r.residual.dataset().offset_s).collect()
    }

    fn plain_unknowns(&self) -> usize {
        self.film_unknowns() + self.recordings.iter().filter(|r| r.free_offset).count()
    }

    /// The film at eta.
    pub fn film(&self, eta: &[f64]) -> Film {
        let n = self.branches;
        Film {
            relaxation_time_s: eta[..n].iter().map(|t| t.exp()).collect(),
            locking: 1.0 / eta[n],
            mu_pa: eta[n + 1..2 * n + 2].to_vec(),
        }
    }

    /// The causes at eta.
    pub fn effects(&self, eta: &[f64]) -> Vec<Acting> {
        let mut out = self.effects.clone();
        let own = self.free.iter().zip(&eta[self.plain_unknowns()..]);
        for (&(e, v), x) in own {
            out[e].values[v] = x * out[e].effect.parameters()[v].spread;
        }
        out
    }

    /// Place of a recording's clock offset among the unknowns, where it is one.
    fn offset_at(&self, number: usize) -> Option<usize> {
        let before = self.recordings[..number].iter();
        let place = self.film_unknowns() + before.filter(|r| r.free_offset).count();
        self.recordings[number].free_offset.then_some(place)
    }

    /// Clock offset of a recording, s.
    pub fn offset_s(&self, number: usize, eta: &[f64]) -> f64 {
        let stated = || self.recordings[number].residual.dataset().offset_s;
        self.offset_at(number).map_or_else(stated, |at| eta[at])
    }

    fn acts<'b>(&self, number: usize, eta: &[f64], effects: &'b [Acting]) -> Acts<'b> {
        Acts {
            effects,
            when: self.when[number],
            offset_s: self.offset_s(number, eta),
            passes: PASSES,
        }
    }

    /// Moduli and times, in the order of the unknowns without 1/J.
    fn knobs(&self) -> Vec<SampleKnob> {
        let times = (0..self.branches).map(SampleKnob::LogTime);
        times
            .chain((0..=self.branches).map(SampleKnob::Modulus))
            .collect()
    }

    fn ran(
        &self,
        number: usize,
        film: &Film,
        acts: &Acts,
        near: Option<&SampleRun>,
        knobs: &[SampleKnob],
    ) -> Result<Ran, Locked> {
        let own = &self.recordings[number];
        let ran = own.residual.run_with(&own.sample, film, acts, near, knobs);
        let (run, loads) = ran.map_err(|e| locked(e, film))?;
        Ok(Ran { run, loads })
    }

    /// x of a recording on its grid, downwards, zero at rest, m.
    ///
    /// # Errors
    /// [`Locked`] where the film gives way or locks.
    pub fn x_m(&self, number: usize, eta: &[f64]) -> Result<Vec<f64>, Locked> {
        let effects = self.effects(eta);
        let acts = self.acts(number, eta, &effects);
        Ok(self.ran(number, &self.film(eta), &acts, None, &[])?.run.x_m)
    }

    /// Error of x at each row of a recording, x predicted minus captured less its mean, m.
    ///
    /// # Errors
    /// [`Locked`].
    pub fn errors_m(&self, number: usize, eta: &[f64]) -> Result<Vec<f64>, Locked> {
        let own = &self.recordings[number].residual;
        let mut rows = own.rows_of(&self.x_m(number, eta)?);
        let captured = own.captured_rows();
        rows.iter_mut().zip(&captured).for_each(|(r, c)| *r -= c);
        self.about_mean(number, &mut rows);
        let noise = own.row_noise_m();
        Ok(rows.iter().zip(noise).map(|(r, n)| r * n).collect())
    }

    /// Takes the part of whitened rows out that a shift of x makes.
    fn about_mean(&self, number: usize, rows: &mut [f64]) {
        let noise = self.recordings[number].residual.row_noise_m();
        let (mut product, mut square) = (0.0, 0.0);
        for (r, n) in rows.iter().zip(&noise) {
            product += r / n;
            square += 1.0 / (n * n);
        }
        let mean = product / square;
        for (r, n) in rows.iter_mut().zip(&noise) {
            *r -= mean / n;
        }
    }

    /// Columns of a recording: [d r/d eta, r], whitened, about their means.
    fn columns(&self, number: usize, eta: &[f64]) -> Result<Vec<Vec<f64>>, Locked> {
        let own = &self.recordings[number].residual;
        let (film, effects) = (self.film(eta), self.effects(eta));
        let acts = self.acts(number, eta, &effects);
        let knobs = self.knobs();
        let base = self.ran(number, &film, &acts, None, &knobs)?;
        let rows = own.rows_of(&base.run.x_m);
        let by = |x_m: &[f64], step: f64| -> Vec<f64> {
            let moved = own.rows_of(x_m);
            moved
                .iter()
                .zip(&rows)
                .map(|(m, r)| (m - r) / step)
                .collect()
        };
        let mut columns: Vec<Vec<f64>> = Vec::with_capacity(eta.len() + 1);
        let (times, moduli) = base.run.columns.split_at(self.branches);
        columns.extend(times.iter().map(|c| own.rows_of(c)));
        columns.push(by(
            &self.with_locking(number, &film, &acts, &base)?,
            STEP_LOCKING,
        ));
        columns.extend(moduli.iter().map(|c| own.rows_of(c)));
        let at = self.offset_at(number);
        columns.extend((self.film_unknowns()..self.plain_unknowns()).map(|place| {
            match at == Some(place) {
                true => own.rate_rows(&base.run.x_m),
                false => vec![0.0; rows.len()],
            }
        }));
        for &(e, v) in &self.free {
            let q = &effects[e].effect.parameters()[v];
            let mut moved = effects.clone();
            let value = &mut moved[e].values[v];
            let step = if *value + STEP_VALUE * q.spread > q.upper {
                -STEP_VALUE
            } else {
                STEP_VALUE
            };
            *value += step * q.spread;
            // what the voltage does is hardly changed by the stretches
            let voltage = effects[e].effect.site() == Site::Electrical;
            let acts = Acts {
                effects: &moved,
                passes: if voltage { 1 } else { PASSES_BESIDE },
                ..acts
            };
            let ran = self.ran(number, &film, &acts, Some(&base.run), &[])?;
            columns.push(by(&ran.run.x_m, step));
        }
        let captured = own.captured_rows();
        columns.push(rows.iter().zip(&captured).map(|(r, c)| r - c).collect());
        for column in &mut columns {
            self.about_mean(number, column);
        }
        Ok(columns)
    }

    /// x with a film that locks a little earlier.
    fn with_locking(
        &self,
        number: usize,
        film: &Film,
        acts: &Acts,
        base: &Ran,
    ) -> Result<Vec<f64>, Locked> {
        let own = &self.recordings[number];
        let film = Film {
            locking: 1.0 / (1.0 / film.locking + STEP_LOCKING),
            ..film.clone()
        };
        let command = own.residual.command_read_v(acts.offset_s, acts.effects);
        let steps = own.residual.steps();
        let run = run_sample_with(&own.sample, &film, &command, &steps, &base.loads, &[]);
        Ok(run.map_err(|e| locked(e, &film))?.x_m)
    }

    /// The whitened design: d r/d eta, residual.
    ///
    /// # Errors
    /// [`Locked`] where the film gives way or locks.
    pub fn design(&self, eta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        let parts = (0..self.recordings.len())
            .into_par_iter()
            .map(|number| self.columns(number, eta))
            .collect::<Result<Vec<_>, _>>()?;
        let width = eta.len() + 1;
        let mut out = DMatrix::zeros(self.rows(), width);
        let mut first = 0;
        for part in parts {
            let rows = part[0].len();
            for (j, column) in part.iter().enumerate() {
                out.view_mut((first, j), (rows, 1)).copy_from_slice(column);
            }
            first += rows;
        }
        Ok(out)
    }

    /// Whitened change of the residual when a cause joins.
    ///
    /// # Errors
    /// [`Locked`] where the film gives way or locks.
    pub fn fingerprint(&self, eta: &[f64], acting: &Acting) -> Result<Vec<f64>, Locked> {
        let (film, effects) = (self.film(eta), self.effects(eta));
        let mut with = effects.clone();
        with.push(acting.clone());
        let parts = (0..self.recordings.len())
            .into_par_iter()
            .map(|number| {
                let own = &self.recordings[number].residual;
                let acts = self.acts(number, eta, &effects);
                let base = self.ran(number, &film, &acts, None, &[])?.run;
                let acts = Acts {
                    passes: PASSES_BESIDE,
                    ..self.acts(number, eta, &with)
                };
                let moved = self.ran(number, &film, &acts, Some(&base), &[])?.run;
                let (mut rows, before) = (own.rows_of(&moved.x_m), own.rows_of(&base.x_m));
                rows.iter_mut().zip(&before).for_each(|(r, b)| *r -= b);
                self.about_mean(number, &mut rows);
                Ok(rows)
            })
            .collect::<Result<Vec<_>, Locked>>()?;
        Ok(parts.concat())
    }

    /// What drawn noise makes of the whitened residual, so many times.
    #[must_use]
    pub fn noise_rows(&self, draws: usize) -> Vec<Vec<f64>> {
        (0..draws)
            .map(|draw| {
                let mut generator = ChaCha12Rng::seed_from_u64(0x6861_6e67 + draw as u64);
                let mut out = Vec::with_capacity(self.rows());
                for (number, own) in self.recordings.iter().enumerate() {
                    let mut rows: Vec<f64> = (0..own.residual.rows())
                        .map(|_| StandardNormal.sample(&mut generator))
                        .collect();
                    self.about_mean(number, &mut rows);
                    out.extend(rows);
                }
                out
            })
            .collect()
    }
}

/// A sample that gives way is past what its film can carry.
fn locked(trouble: SampleTrouble, film: &Film) -> Locked {
    match trouble {
        SampleTrouble::Locked(locked) => locked,
        SampleTrouble::GivesWay { at_s } => Locked {
            spring: 1,
            invariant: film.locking,
            locking: film.locking,
            at_s: Some(at_s),
        },
    }
}

impl SeparableResidual for HangingResidual<'_> {
    type Error = Locked;

    fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, Locked> {
        let design = self.design(eta)?;
        Ok(Normal {
            gram: design.tr_mul(&design),
            slopes: (0..eta.len())
                .map(|nonlinear| Slope {
                    nonlinear,
                    linear: None,
                })
                .collect(),
            reference: reference.to_vec(),
            rows: design.nrows(),
        })
    }
}
