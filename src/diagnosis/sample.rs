//! Hanging samples as a subject: one x a sample, run forward from the voltage and judged in mm.

use nalgebra::DMatrix;

use super::chain::Case;
use super::explain::explain;
use super::outcome::*;
use super::problem::{BRANCHES, Problem, unknowns};
use super::subject::{At, Coordinate, Errors, Subject, Whereabouts, Words};
use super::{DRAWN, enough, enough_held_out};
use crate::dataset::{HangingDataset, OffsetSource};
use crate::effects::{Acting, Effect, HANGING, Seen, When};
use crate::film::{Film, Locked};
use crate::fit::memory::Memory;
use crate::fit::separable::Unknown;
use crate::model::{ForearmTorque, HangingSample, Parameters};
use crate::residual::{
    DepartureTorques, HangingResidual, Hung, OFFSET_REACH_S, SampleResidual, Steps,
};

/// Error of the steps over the noise of x, and the longest step, s: what lags and limits do to a voltage
/// happens within it.
const FINE: f64 = 0.1;
const LONGEST_STEP_S: f64 = 0.02;
/// Smallest modulus of the equilibrium spring, Pa: a softer film would not carry its mass.
const SOFTEST_PA: f64 = 1e4;
/// Least change of the voltage that says something, V.
const LEAST_V: f64 = 50.0;
const MM: f64 = 1e3;

/// A recording of a hanging sample, and when it was made.
#[derive(Debug, Clone, Copy)]
pub struct SampleEntry<'a> {
    /// The recording.
    pub dataset: &'a HangingDataset,
    /// The sample as its rig states it, with an ideal electrode.
    pub sample: &'a HangingSample,
    /// When it was made.
    pub when: When,
}

/// Diagnoses hanging samples of one film on the recordings `train`, judged also on `holdout`. `watch` is told
/// what is being done.
///
/// # Errors
/// [`Error`].
pub fn diagnose_samples(
    train: &[SampleEntry],
    holdout: &[SampleEntry],
    request: &Request,
    watch: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Error> {
    let Some(first) = train.first() else {
        return Err(Error::Nothing);
    };
    let mut remarks = Vec::new();
    let mut problem = open(train, holdout, &mut remarks)?;
    problem.memory = request.memory.clone();
    problem.tally = request.tally.clone();
    let mut case = Case::new(problem, remarks, request, watch);
    let (field, choice) = case.rounds()?;
    let mut diagnosis = explain(&mut case, field, choice)?;
    diagnosis.eps_r = first.sample.eps_r;
    Ok(diagnosis)
}

fn open<'a>(
    train: &[SampleEntry<'a>],
    holdout: &[SampleEntry<'a>],
    remarks: &mut Vec<String>,
) -> Result<Problem<HangingResidual<'a>>, Error> {
    for e in train.iter().chain(holdout) {
        let own = e.dataset.notes.iter();
        remarks.extend(own.map(|n| format!("{}: {n}.", e.dataset.id)));
    }
    let still = |e: &&SampleEntry| {
        let volts = &e.dataset.voltage.channels_v()[0];
        let first = volts.first().copied().unwrap_or(0.0);
        volts.iter().all(|v| (v - first).abs() < LEAST_V)
    };
    if train.iter().filter(still).count() == train.len() {
        return Err(Error::NothingExcited(format!(
            "no recording changes its voltage by more than {LEAST_V:.0} V: nothing moves, so nothing can be judged; record a sine, steps or a \
             multisine"
        )));
    }
    let (mut nonlinear, moduli) = unknowns(&[], 0, OFFSET_REACH_S);
    nonlinear.extend(moduli);
    nonlinear[BRANCHES + 1].lower = SOFTEST_PA;
    let film = {
        let start = |at: usize| nonlinear[at].start;
        Film {
            relaxation_time_s: (0..BRANCHES).map(|i| start(i).exp()).collect(),
            locking: 1.0 / start(BRANCHES),
            mu_pa: (BRANCHES + 1..2 * BRANCHES + 2).map(start).collect(),
        }
    };
    let residual = |entries: &[SampleEntry<'a>]| {
        let when: Vec<When> = entries.iter().map(|e| e.when).collect();
        let hung = entries.iter().map(|e| hang(e, &film));
        let hung = hung.collect::<Result<Vec<_>, _>>()?;
        Ok::<_, Error>(HangingResidual::new(hung, BRANCHES, &when))
    };
    let own = residual(train)?;
    let offsets = own.free_offsets_s();
    if !offsets.is_empty() {
        remarks.push("A clock offset is left to be estimated: it is free in every model, so a wrong clock cannot be named and a lag of the voltage is harder to see.".into());
    }
    let reach = |o: &f64| Unknown::free(*o, o - OFFSET_REACH_S, o + OFFSET_REACH_S);
    nonlinear.extend(offsets.iter().map(reach));
    if train.len() == 1 {
        remarks.push("One recording only: causes that need a series (drift, creep, changes between recordings) can hardly be judged.".into());
    }
    enough(own.rows(), nonlinear.len())?;
    let held = (!holdout.is_empty())
        .then(|| {
            let held = residual(holdout)?;
            enough_held_out(held.rows())?;
            Ok::<_, Error>(held)
        })
        .transpose()?;
    let when = |entries: &[SampleEntry]| entries.iter().map(|e| e.when).collect();
    Ok(Problem {
        train: own,
        holdout: held,
        train_when: when(train),
        holdout_when: when(holdout),
        nonlinear,
        linear: Vec::new(),
        independent: super::judge::INDEPENDENT,
        begun: DepartureTorques::new(),
        weighed_at: None,
        smoothed_at: None,
        memory: Memory::default(),
        tally: Tally::default(),
    })
}

/// A recording on a grid that is fine enough for an ordinary film.
fn hang<'a>(entry: &SampleEntry<'a>, film: &Film) -> Result<Hung<'a>, Error> {
    let (dataset, sample) = (entry.dataset, entry.sample);
    let error_m = FINE * dataset.noise_m;
    let settled = SampleResidual::settled(dataset, sample, film, error_m, 0.0);
    let (settled, _) = settled.map_err(|e| Error::Baseline(format!("{}: {e}", dataset.id)))?;
    let step_s = dataset.step_s;
    let longest = (LONGEST_STEP_S / step_s + 1e-9).floor().max(1.0) * step_s;
    let residual = match settled.step_s() > longest {
        true => {
            let bounce = Steps::of(sample, film, dataset.start_s, longest).bounce;
            SampleResidual::new(dataset, longest, bounce, dataset.noise_m)
        }
        false => settled,
    };
    Ok(Hung {
        residual,
        sample: *sample,
        free_offset: dataset.offset_source == OffsetSource::Free,
    })
}

/// The voltages that recordings show.
fn seen(residual: &HangingResidual) -> Seen {
    let mut seen = Seen {
        voltage_v: 0.0,
        rate_v_s: 0.0,
        theta_b_rad: [f64::NAN; 2],
        theta_dea_rad: [f64::NAN; 2],
    };
    for own in residual.recordings() {
        let command = own.residual.command_v(own.residual.dataset().offset_s);
        let step_s = own.residual.step_s();
        for pair in command.windows(2) {
            seen.voltage_v = seen.voltage_v.max(pair[1].abs());
            seen.rate_v_s = seen.rate_v_s.max((pair[1] - pair[0]).abs() / step_s);
        }
    }
    seen
}

/// What the recording shows at each of its rows: t s, voltage V, its rate V/s, x mm, its rate mm/s, the
/// largest x so far mm.
fn shown(own: &SampleResidual) -> Vec<[f64; 6]> {
    let d = own.dataset();
    let (times, x) = (own.times_s(), own.captured_m());
    let v = |t: f64| d.voltage.at(0, t + d.offset_s).abs();
    let mut largest = f64::NEG_INFINITY;
    (0..times.len())
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(times.len() - 1));
            let rate = (x[b] - x[a]) / (times[b] - times[a]).max(1e-9);
            largest = largest.max(x[i]);
            let t = times[i];
            [
                t,
                v(t),
                (v(t + 0.02) - v(t - 0.02)) / 0.04,
                MM * x[i],
                MM * rate,
                MM * largest,
            ]
        })
        .collect()
}

impl Subject for HangingResidual<'_> {
    const CHAINS: usize = 1;

    fn rig(&self) -> RigKind {
        RigKind::Sample
    }

    fn starts(&self) -> Vec<(&'static dyn Effect, Vec<Vec<f64>>)> {
        let seen = seen(self);
        let of = |e: &&'static dyn Effect| {
            let effect: &'static dyn Effect = *e;
            let starts = effect.starts(&seen).into_iter();
            starts.map(move |v| (effect, v)).collect::<Vec<_>>()
        };
        HANGING.iter().flat_map(of).collect()
    }

    fn moments(&self) -> &'static [&'static str] {
        &["electrode_failure", "payload_change"]
    }

    fn words(&self) -> Words {
        Words {
            unit: "mm".into(),
            basis: "all",
            over: "",
            directed: "voltage",
            moving: 100.0,
            rich: "To see what could hide here: three rates, holds, a staircase of amplitudes with repeats, and another mass under the same voltages.",
            repeat: "The same drive again, then at another rate, another amplitude and with another mass: what repeats with voltage, length, direction or time says what it depends on.",
        }
    }

    fn whereabouts(&self) -> Vec<Whereabouts> {
        let of = |(own, when): (&Hung, &When)| {
            let d = own.residual.dataset();
            Whereabouts {
                id: d.id.clone(),
                when: *when,
                span_s: [d.start_s, d.time_s(d.samples() - 1)],
            }
        };
        self.recordings().iter().zip(self.when()).map(of).collect()
    }

    fn kept_times_s(&self, recording: usize) -> Vec<f64> {
        self.recordings()[recording].residual.times_s()
    }

    fn coordinates(&self) -> Vec<Coordinate> {
        [
            ("voltage", "voltage", "V", 0, 1.0),
            ("voltage_rate", "voltage rate", "V/s", 1, 1.0),
            ("position", "x", "mm", 3, 1000.0),
            ("largest_stretch", "largest x so far", "mm", 5, 1000.0),
            ("time", "time", "s", 2, 1000.0),
        ]
        .map(|(dimension, says, unit, at, rounding)| Coordinate {
            dimension,
            says,
            unit: unit.into(),
            at,
            rounding,
        })
        .into()
    }

    fn at(&self, recording: usize) -> Vec<[At; 3]> {
        let rows = shown(&self.recordings()[recording].residual).into_iter();
        rows.map(|[t, v, v_rate, x, rate, largest]| [[v, v_rate, t, x, rate, largest, x]; 3])
            .collect()
    }

    fn whitening(&self, recording: usize) -> Vec<[f64; 6]> {
        let noise = self.recordings()[recording].residual.row_noise_m();
        let of = |n: f64| [1.0 / n, 0.0, 1.0, 0.0, 0.0, 1.0];
        noise.into_iter().map(of).collect()
    }

    fn features(&self, recording: usize) -> (Vec<&'static str>, Vec<Vec<[f64; 3]>>) {
        let rows = shown(&self.recordings()[recording].residual);
        let series_s = self.when()[recording].series_s;
        let mut names = Vec::new();
        let mut columns = Vec::new();
        let mut add = |name: &'static str, value: &dyn Fn(&[f64; 6]) -> f64| {
            names.push(name);
            columns.push(rows.iter().map(|r| [value(r), 0.0, 0.0]).collect());
        };
        add("voltage", &|r| r[1] / MM);
        add("voltage squared", &|r| (r[1] / MM).powi(2));
        add("voltage to the fourth", &|r| (r[1] / MM).powi(4));
        add("voltage rate", &|r| r[2] / MM);
        add("voltage times its rate", &|r| r[1] * r[2] / (MM * MM));
        add("x", &|r| r[3]);
        add("x squared", &|r| r[3] * r[3]);
        add("x cubed", &|r| r[3].powi(3));
        add("rate of x", &|r| r[4]);
        add("direction of motion", &|r| r[4].signum());
        add("largest x so far", &|r| r[5]);
        add("time", &|r| r[0]);
        add("time in the series", &|r| series_s + r[0]);
        (names, columns)
    }

    fn with_effects(
        &self,
        effects: Vec<Acting>,
        free: Vec<(usize, usize)>,
        series: &[When],
    ) -> Self {
        HangingResidual::with_effects(self, effects, free, series)
    }

    fn effects(&self, eta: &[f64]) -> Vec<Acting> {
        HangingResidual::effects(self, eta)
    }

    fn linearise(&mut self, _: &[f64], _: &[f64], _: bool) -> Result<(), Locked> {
        Ok(())
    }

    /// The noise is in x, whatever the model.
    fn weigh(&mut self, _: &[f64], _: &[f64]) -> Result<(), Locked> {
        Ok(())
    }

    fn design(&self, eta: &[f64], _: &[f64]) -> Result<DMatrix<f64>, Locked> {
        HangingResidual::design(self, eta)
    }

    fn fingerprint(&self, eta: &[f64], _: &[f64], acting: &Acting) -> Result<Vec<f64>, Locked> {
        HangingResidual::fingerprint(self, eta, acting)
    }

    fn fingerprint_by_actuator(
        &self,
        eta: &[f64],
        _: &[f64],
        effect: &'static dyn Effect,
        v: &[f64],
    ) -> Result<[Vec<f64>; 3], Locked> {
        let acting = Acting {
            effect,
            values: v.to_vec(),
            on: [true; 3],
        };
        let whole = HangingResidual::fingerprint(self, eta, &acting)?;
        Ok([whole, Vec::new(), Vec::new()])
    }

    fn noise_rows(&self) -> Vec<Vec<f64>> {
        HangingResidual::noise_rows(self, DRAWN)
    }

    fn fresh_noise_rows(
        &self,
        count: usize,
        _: &[f64],
        _: &[f64],
    ) -> Result<Vec<Vec<f64>>, Locked> {
        Ok(HangingResidual::noise_rows(self, DRAWN + count).split_off(DRAWN))
    }

    fn score_covariance(&self, eta: &[f64], _: &[f64]) -> Result<DMatrix<f64>, Locked> {
        let design = HangingResidual::design(self, eta)?;
        let x = design.columns(0, design.ncols() - 1);
        Ok(x.tr_mul(&x))
    }

    fn carried(&self, plain: &[f64]) -> Vec<f64> {
        let mut eta = plain[..self.film_unknowns()].to_vec();
        eta.extend(self.free_offsets_s());
        eta
    }

    fn parameters(&self, eta: &[f64], _: &[f64]) -> Parameters {
        Parameters {
            film: self.film(eta),
            forearm: ForearmTorque::zero(),
        }
    }

    fn errors(&self, recording: usize, eta: &[f64], _: &[f64]) -> Result<Errors, Locked> {
        let own = &self.recordings()[recording].residual;
        let error = self.errors_m(recording, eta)?;
        let three = |v: f64| [MM * v, f64::NAN, f64::NAN];
        let x = own.captured_m();
        Ok(Errors {
            time_s: own.times_s(),
            counts: error.iter().map(|e| e.is_finite()).collect(),
            basis: vec![[true, false, false]; error.len()],
            error: error.into_iter().map(three).collect(),
            command: x.iter().map(|v| three(*v)).collect(),
            sd: own.row_noise_m().into_iter().map(three).collect(),
            height: x.iter().map(|v| MM * v).collect(),
        })
    }

    fn kept_errors(
        &self,
        recording: usize,
        eta: &[f64],
        _: &[f64],
    ) -> Result<Vec<[f64; 4]>, Locked> {
        let times = self.recordings()[recording].residual.times_s();
        let error = self.errors_m(recording, eta)?;
        let rows = times.into_iter().zip(error);
        Ok(rows.map(|(t, e)| [t, MM * e, f64::NAN, f64::NAN]).collect())
    }
}
