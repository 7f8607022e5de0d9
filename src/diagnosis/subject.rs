//! What a diagnosis asks of recordings, whatever the rig: their residual with effects, where its rows lie,
//! and the words of the kind.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::RigKind;
use super::learn::{Group, Made};
use super::tolerance::Tolerance;
use crate::effects::learnt::Learnt;
use crate::effects::{Acting, Effect, When};
use crate::film::Locked;
use crate::model::Parameters;
use crate::residual::{Departure, DepartureTorques, ExpectedScore, SeparableResidual};

/// Where a kept residual lies: voltage (or input), its rate, time s, height, rate, largest stretch (or swing)
/// so far, angle (or position).
pub(super) type At = [f64; 7];

/// Columns of a learnt term on each actuator, and their slopes.
pub(super) type TermColumns = ([DMatrix<f64>; 3], Option<[DMatrix<f64>; 3]>);

/// A coordinate in which the excess is looked for.
#[derive(Clone)]
pub(super) struct Coordinate {
    pub dimension: &'static str,
    /// The same in a sentence.
    pub says: &'static str,
    pub unit: String,
    /// Its place in [`At`].
    pub at: usize,
    /// A range is rounded to one over this.
    pub rounding: f64,
}

/// A recording, as places name it.
pub(super) struct Whereabouts {
    pub id: String,
    pub when: When,
    /// First and last sample on its own clock, s.
    pub span_s: [f64; 2],
}

/// Error of the driven quantity at every sample of a recording: what the motion needs minus what the command
/// makes.
pub(super) struct Errors {
    pub time_s: Vec<f64>,
    pub command: Vec<[f64; 3]>,
    pub error: Vec<[f64; 3]>,
    /// Standard deviation that noise alone makes.
    pub sd: Vec<[f64; 3]>,
    pub counts: Vec<bool>,
    /// Whether the sample belongs to the basis of the error that is named first (above 1 kV for a robot).
    pub basis: Vec<[bool; 3]>,
    /// A coordinate to draw the error against.
    pub height: Vec<f64>,
}

/// Words of a kind of rig.
#[derive(Clone)]
pub(super) struct Words {
    /// Unit of the error.
    pub unit: String,
    /// Samples over which the error is taken, as files write it.
    pub basis: &'static str,
    /// The same in a sentence: " above 1 kV", or nothing.
    pub over: &'static str,
    /// What rises and falls, for places of one direction.
    pub directed: &'static str,
    /// Its rate, per second, above which it counts as rising or falling.
    pub moving: f64,
    /// What to record to see what could hide.
    pub rich: &'static str,
    /// What to record where nothing explains what is left.
    pub repeat: &'static str,
}

/// Recordings of one rig under its plain model, which effects can join.
pub(super) trait Subject: SeparableResidual<Error = Locked> + Sync + Send + Sized {
    /// Residuals of one kept sample: one for each actuator.
    const CHAINS: usize;

    /// The effects that make sense here, and where a scan looks for each: values near off, one group a start.
    fn starts(&self) -> Vec<(&'static dyn Effect, Vec<Vec<f64>>)>;
    /// The effects that begin at a moment, which a search over all moments finds: their values are a size,
    /// the time and the number of the recording.
    fn moments(&self) -> Vec<&'static dyn Effect>;
    /// Its kind.
    fn rig(&self) -> RigKind;
    /// The words of the kind.
    fn words(&self) -> Words;
    /// The recordings.
    fn whereabouts(&self) -> Vec<Whereabouts>;
    /// Times of the kept samples of a recording, s.
    fn kept_times_s(&self, recording: usize) -> Vec<f64>;
    /// Coordinates in which the excess is looked for.
    fn coordinates(&self) -> Vec<Coordinate>;
    /// Where the kept samples of a recording lie, for each actuator.
    fn at(&self, recording: usize) -> Vec<[At; 3]>;
    /// Lower triangles of the whitening of the kept samples of a recording (row by row; with one chain the
    /// first counts alone).
    fn whitening(&self, recording: usize) -> Vec<[f64; 6]>;
    /// Physical variables for a law over what is left: names, and values at the kept samples for each
    /// actuator.
    fn features(&self, recording: usize) -> (Vec<&'static str>, Vec<Vec<[f64; 3]>>);
    /// The same recordings and weights with `effects` at work; `free` are those of their values that are
    /// unknowns.
    fn with_effects(
        &self,
        effects: Vec<Acting>,
        free: Vec<(usize, usize)>,
        series: &[When],
    ) -> Self;
    /// The same, with errors told through the lags among `effects`.
    fn told_through(self, _effects: &[Acting]) -> Self {
        self
    }
    /// The effects at eta.
    fn effects(&self, eta: &[f64]) -> Vec<Acting>;
    /// Works out what is linear in some values of effects until called again; with `anew` the slopes as well,
    /// where there are some.
    fn linearise(&mut self, eta: &[f64], beta: &[f64], anew: bool) -> Result<(), Locked>;
    /// Sets the weights to what noise makes of the residual at a model.
    fn weigh(&mut self, eta: &[f64], beta: &[f64]) -> Result<(), Locked>;
    /// The whitened design: d r/d eta, B, residual.
    fn design(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked>;
    /// Whitened change of the residual when an effect joins.
    fn fingerprint(&self, eta: &[f64], beta: &[f64], acting: &Acting) -> Result<Vec<f64>, Locked>;
    /// The same on each actuator alone.
    fn fingerprint_by_actuator(
        &self,
        eta: &[f64],
        beta: &[f64],
        effect: &'static dyn Effect,
        v: &[f64],
    ) -> Result<[Vec<f64>; 3], Locked>;
    /// What may be learnt here, where a model without terms leaves this residual; nothing where it is not
    /// known how.
    fn dictionary(&self, _residual: &DVector<f64>) -> Vec<Group> {
        Vec::new()
    }
    /// What each coefficient of a learnt term changes of the residual on each actuator alone; and, where it
    /// acts on the voltage, by how much what it adds to the squared voltage grows with that square.
    fn term_columns(&self, _term: &Learnt) -> TermColumns {
        unreachable!("there is no dictionary")
    }
    /// What a learnt term does along the recordings.
    fn made_by(&self, _acting: &Acting) -> Made {
        Made::default()
    }
    /// Net work of learnt terms together, and the sum of what is exchanged; `None` where those of each term
    /// add up.
    fn work_of(&self, _terms: &[Acting]) -> Option<[f64; 2]> {
        None
    }
    /// The same recordings, of which these kept samples of one count nothing.
    fn without(&self, _recording: usize, _kept: Range<usize>) -> Self {
        unreachable!("there is no dictionary")
    }
    /// What drawn noise makes of the whitened residual.
    fn noise_rows(&self) -> Vec<Vec<f64>>;
    /// As many further draws, which the weights know nothing of.
    fn fresh_noise_rows(
        &self,
        count: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<Vec<f64>>, Locked>;
    /// Covariance of the scores X'e under the noise.
    fn score_covariance(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked>;
    /// What the scores X'r at (eta, beta) are on average were the model true with the values `truth`, in
    /// their order; `None` where that is not known.
    fn expected_score(
        &self,
        _eta: &[f64],
        _beta: &[f64],
        _truth: &[f64],
    ) -> Result<Option<ExpectedScore>, Locked> {
        Ok(None)
    }
    /// The whitened residual that is left on average were the model true, by capture and smoothing; `None`
    /// where that is not known.
    fn expected_residual(&self, _eta: &[f64], _beta: &[f64]) -> Option<DVector<f64>> {
        None
    }
    /// Takes what is known to be left by capture and smoothing out of all residuals from now on.
    fn take_out(&mut self, _expected: Option<&DVector<f64>>) {}
    /// What may be off in the rig as it is built, and by how much.
    fn tolerances(&self) -> Vec<Tolerance> {
        Vec::new()
    }
    /// What each departure changes of the torque error, at a model with the effects at work.
    fn departures(
        &self,
        _eta: &[f64],
        _beta: &[f64],
        _list: &[Departure],
    ) -> Result<DepartureTorques, Locked> {
        Ok(DepartureTorques::new())
    }
    /// What a standard deviation of where each recording begins changes of the torque error: the branches
    /// remember it.
    fn begun(&self, _eta: &[f64], _beta: &[f64]) -> Result<DepartureTorques, Locked> {
        Ok(DepartureTorques::new())
    }
    /// The same as whitened columns.
    fn departure_rows(&self, _torques: &DepartureTorques) -> DMatrix<f64> {
        DMatrix::zeros(0, 0)
    }
    /// Lets the rig depart along combinations (columns) of tolerances: linear unknowns, the last of all.
    fn allow(&mut self, _torques: &DepartureTorques, _combine: &DMatrix<f64>) {}
    /// Departures at the kept samples, recording by recording: one column each.
    fn filtered_departures(&self, _torques: &DepartureTorques) -> Vec<DMatrix<f64>> {
        Vec::new()
    }
    /// Lets a fit depart along combinations of those, beside those that there may be.
    fn allow_more(&mut self, _filtered: &[DMatrix<f64>], _combine: &DMatrix<f64>) {}
    /// Takes the mechanism to be these effects beside its drawing.
    fn rebuild(&mut self, _base: Vec<Acting>) -> Result<(), Locked> {
        Ok(())
    }
    /// Number of such unknowns.
    fn allowed(&self) -> usize {
        0
    }
    /// The plain unknowns of these (held-out) recordings, from those of the fitted ones.
    fn carried(&self, plain: &[f64]) -> Vec<f64>;
    /// The plain model as physics.
    fn parameters(&self, eta: &[f64], beta: &[f64]) -> Parameters;
    /// Numbers of a model that is neither film nor forearm: name (with its unit), value.
    fn values(&self, _eta: &[f64], _beta: &[f64]) -> Vec<(String, f64)> {
        Vec::new()
    }
    /// Errors at every sample of a recording.
    fn errors(&self, recording: usize, eta: &[f64], beta: &[f64]) -> Result<Errors, Locked>;
    /// Errors at the kept samples of a recording: time, each actuator.
    fn kept_errors(
        &self,
        recording: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<[f64; 4]>, Locked>;
    /// A quantity of an effect in the units of these recordings: factor and unit.
    fn unit_of(&self, unit: &'static str) -> (f64, String) {
        (1.0, unit.into())
    }
    /// Share of the residuals that count as independent, from those of the best model.
    fn independent(&self, _residual: &[f64]) -> f64 {
        super::judge::INDEPENDENT
    }
}
