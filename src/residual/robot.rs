//! The residual of robot recordings: one fused pass a chain, and the noise that the capture puts into it.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use nalgebra::{DMatrix, DVector, Matrix3};
use pulp::Arch;
use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;
use rayon::prelude::*;

use super::gram::{PAD, STRIP, add_rows, filter_rows};
use super::{Decimation, Normal, SeparableResidual, Slope};
use crate::dataset::{Dataset, OffsetSource};
use crate::effects::learnt::Learnt;
use crate::effects::{Acting, Along, Effect, Site, When};
use crate::film::Locked;
use crate::film::kernel::{LANES, Pass, ROW, Shape, Way};
use crate::model::{ForearmTorque, Mechanics, Parameters, Robot, Track, Unreachable, others};

/// Where a clock offset is free: the residual's band over the half-power frequency of the smoothed motion.
/// Timing shows in fast motion; for the film alone the wider band only lets in what smoothing takes from the
/// motion.
const BAND_PER_CUTOFF: f64 = 1.6;
/// Samples of one kernel block.
const BLOCK: usize = 64;
/// Samples that are held before they move to the front.
const HELD: usize = 512;
/// Tracks that are drawn from the capture's uncertainty to see what it does to the residual.
const REPLICATES: usize = 12;
/// Tracks of a recording that are kept once they are drawn: a scan draws as many, round after round.
const TRACKS: usize = 24;
/// Frames of drawn tracks that are worked on at the same time at most, where more than one: what limits
/// memory on machines with many cores.
const FRAMES_AT_ONCE: usize = 400_000;
/// Reach of the average of the noise covariance on both sides of a kept sample, s.
const COVARIANCE_REACH_S: f64 = 0.6;
/// Kept samples to each side over which the size of the noise is averaged where it is followed from place to
/// place.
const NEAR: usize = 2;
/// Length of a block of the noise scores, s: long against the correlation of the residual's noise.
const SCORE_BLOCK_S: f64 = 4.0;
/// How far a free clock offset may wander from where it starts, s.
pub(crate) const OFFSET_REACH_S: f64 = 0.25;

/// Where the parameters stand in eta and beta.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Viscoelastic branches: eta holds ln T_1 .. ln T_n, 1/J, then the free offsets; beta n + 1 moduli, then
    /// nodes.
    pub branches: usize,
    /// Nodes of the forearm torque curve.
    pub nodes: usize,
    /// Directions in which the robot as built may depart from its drawing: beta holds their sizes after the
    /// nodes.
    pub departures: usize,
    /// Numbers of the recordings whose clock offset is free, in the order of their place in eta.
    pub free_offsets: Vec<usize>,
    /// Free values of effects (number of the effect, number of the value), in the order of their place in
    /// eta, after the offsets; eta holds them over their [`crate::effects::Quantity::spread`].
    pub free_values: Vec<(usize, usize)>,
}

impl Layout {
    /// Length of eta.
    pub fn nonlinear(&self) -> usize {
        self.branches + 1 + self.free_offsets.len() + self.free_values.len()
    }

    /// Place of the first free value of an effect in eta.
    pub fn first_value(&self) -> usize {
        self.branches + 1 + self.free_offsets.len()
    }

    /// Length of beta.
    pub fn linear(&self) -> usize {
        self.branches + 1 + self.nodes + self.departures
    }
}

/// A number for each chain and frame.
pub type Chains = [Vec<f64>; 3];
/// A number for each kept sample and chain.
type Triples = Vec<[f64; 3]>;

/// A way in which a robot as built may depart from its drawing, by as much as its tolerance.
#[derive(Debug, Clone)]
pub enum Departure {
    /// An effect with these values, in every recording or in one.
    Effect {
        /// The effect at the size of the tolerance.
        acting: Acting,
        /// Number of the only recording, or all.
        only: Option<usize>,
    },
    /// A spring of one actuator's film (0: the equilibrium spring, then the branches) is stiffer than the
    /// others' by this share.
    Spring {
        /// 0 to 2.
        chain: usize,
        /// Number of the spring.
        spring: usize,
        /// Share of its modulus.
        share: f64,
    },
}

/// Tells what an effect changes of a torque error at the torque that the model asks for, where it changes
/// what a voltage makes by a share. At the recorded one the error's noise would stand in the column: a film
/// that is thicker and softer, with a smaller load, shrinks all torques, and the error with them.
fn as_asked_for(acting: &Acting, error: &Chains, change: &mut Chains) {
    let share = acting.effect.share_of_made(&acting.values);
    for k in (0..3).filter(|&k| share != 0.0 && acting.on[k]) {
        for (c, e) in change[k].iter_mut().zip(&error[k]) {
            *c -= share * e;
        }
    }
}

/// Changes of the torque error that departures make, N m: for each recording, each departure (or direction of
/// several).
pub type DepartureTorques = Vec<Vec<Chains>>;

/// One recording, worked out as far as it does not depend on the parameters.
#[derive(Clone)]
struct Prepared<'a> {
    dataset: &'a Dataset,
    when: When,
    mechanics: Arc<Mechanics>,
    /// Ways of the films between the stretches of the dataset, where it has not all frames.
    ways: Arc<Vec<(usize, [Way; 3])>>,
    /// The track where it is not the dataset's own.
    other_track: Option<Arc<Track>>,
    decimation: Arc<Decimation>,
    centres: Arc<Vec<usize>>,
    /// phi_c^2, its change per second, and phi_c at the frames, at a fixed offset.
    command: Option<Arc<[Command; 3]>>,
    /// Filtered load of each kept sample and chain, N m.
    load: Arc<Triples>,
    /// Filtered forearm columns: kept sample, chain, node.
    forearm: Arc<Vec<f64>>,
    /// Filtered 1/2 C' phi^2 and its derivative with respect to the offset, at a fixed offset.
    maxwell: Option<Arc<(Triples, Triples)>>,
    /// Lower triangle of the inverse Cholesky factor of the noise covariance at each kept sample: 11, 21, 22,
    /// 31, 32, 33.
    whitening: Arc<Vec<[f64; 6]>>,
    /// Weight of a kept sample in a robust fit.
    robust: Arc<Vec<f64>>,
    /// Whitened residual changes of the replicates: replicate, kept sample, chain.
    errors: Arc<Vec<Vec<f64>>>,
    /// The first tracks that are drawn from what the capture leaves open, once they have been.
    tracks: Arc<[OnceLock<Track>; TRACKS]>,
    /// Mechanics of the drawn tracks, once they have been worked out, where they shall be kept.
    drawn: Arc<OnceLock<Vec<Option<Mechanics>>>>,
    /// The recording about given values of effects that move the mechanism or the motion.
    linear: Option<Arc<Linear>>,
    /// What capture and smoothing are known to make of the filtered residual of a right model, N m; empty
    /// where nothing is known.
    smoothed: Arc<Triples>,
    /// Torque of each direction of departure at the frames, N m, and filtered: kept sample, chain, direction.
    departed: Arc<(Vec<Chains>, Vec<f64>)>,
    /// Variance of the torque error of each frame and chain from the capture noise, (N m)^2, once it has been
    /// worked out.
    torque_variance: Arc<Vec<[f64; 3]>>,
}

/// A recording about given values of the effects that move the mechanism or the motion: exact there, linear
/// around.
struct Linear {
    mechanics: Mechanics,
    load: Triples,
    forearm: Vec<f64>,
    /// Place of a value in eta, its value here, and the change of the filtered residual per unit of it.
    values: Vec<(usize, f64, Triples)>,
}

/// What the film of a chain at the frames makes of torque on its lozenge, N m ([equilibrium spring,
/// branches]), and what its forearm does on its swing.
#[derive(Clone)]
struct OwnTorques {
    film: Arc<Vec<[f64; 2]>>,
    forearm: Arc<Vec<f64>>,
}

impl OwnTorques {
    fn new(mechanics: &Mechanics, k: usize, parameters: &Parameters) -> Result<Self, Locked> {
        let forearm = mechanics.forearm_torque_n_m(k, &parameters.forearm);
        Ok(OwnTorques {
            film: Arc::new(mechanics.film_torque_n_m(k, parameters)?),
            forearm: Arc::new(forearm),
        })
    }
}

/// Those of all chains.
struct ChainTorques([OwnTorques; 3]);

impl ChainTorques {
    fn new(mechanics: &Mechanics, parameters: &Parameters) -> Result<Self, Locked> {
        let of = |k: usize| OwnTorques::new(mechanics, k, parameters);
        Ok(ChainTorques([of(0)?, of(1)?, of(2)?]))
    }

    /// Those of `moved` from `known`, those of `mechanics`: a chain that goes the same way has the same
    /// torques, a forearm that swings alike the same of its own.
    fn beside(
        moved: &Mechanics,
        parameters: &Parameters,
        mechanics: &Mechanics,
        known: &Self,
    ) -> Result<Self, Locked> {
        let same = |k: usize| Arc::ptr_eq(&moved.chains[k].own, &mechanics.chains[k].own);
        let swings_alike =
            |k: usize| moved.chains[k].theta_fa_rad == mechanics.chains[k].theta_fa_rad;
        let of = |k: usize| match same(k) {
            true => Ok(known.0[k].clone()),
            false if swings_alike(k) => Ok(OwnTorques {
                film: Arc::new(moved.film_torque_n_m(k, parameters)?),
                ..known.0[k].clone()
            }),
            false => OwnTorques::new(moved, k, parameters),
        };
        Ok(ChainTorques([of(0)?, of(1)?, of(2)?]))
    }
}

/// The command of a chain at the frames: phi_c^2, its change per second, phi_c.
type Command = (Vec<f64>, Vec<f64>, Vec<f64>);

/// What the rows of a recording are made of at given values of the effects.
struct Condition<'p> {
    mechanics: Cow<'p, Mechanics>,
    load: Cow<'p, [[f64; 3]]>,
    forearm: Cow<'p, [f64]>,
    maxwell: Cow<'p, (Triples, Triples)>,
    /// Factors on the stress of [equilibrium spring, branches], where an effect changes them.
    factor: [Option<Vec<[f64; 2]>>; 3],
    /// Change of the filtered residual per unit of eta of each free value.
    values: Vec<Triples>,
}

/// The commands of a recording as a clock reads them: each chain's where it is first asked for.
struct Told<'p> {
    recording: &'p Prepared<'p>,
    offset_s: f64,
    /// [`clock`] of the effects.
    clock: (f64, f64),
    chains: [OnceLock<Cow<'p, Command>>; 3],
}

impl Told<'_> {
    fn chain(&self, chain: usize) -> &Command {
        let read = || self.recording.command(chain, self.offset_s, self.clock);
        self.chains[chain].get_or_init(read)
    }
}

/// What changes of a recording at the same parameters, offset and effects have in common: each where it is
/// first asked for.
struct Common<'p> {
    told: Told<'p>,
    /// Torques of the films, and the torque error with them.
    error: OnceLock<(ChainTorques, Chains)>,
    /// [`Prepared::made`] of each chain.
    made: [OnceLock<(Vec<f64>, Vec<f64>)>; 3],
    /// Torque of each effect on each chain.
    torques: Vec<[OnceLock<Vec<f64>>; 3]>,
    /// Torque of each film.
    film: [OnceLock<Vec<[f64; 2]>>; 3],
    /// What each film needs more because it cannot carry compression.
    slack: [OnceLock<Vec<f64>>; 3],
}

/// Rows of the kernel that a window may still need, chain by chain, beginning at sample `from`; they move to
/// the front when the room is used up.
struct Held {
    rows: Vec<Vec<f64>>,
    width: usize,
    room: usize,
    from: usize,
    count: usize,
}

impl Held {
    fn new(taps: usize, width: usize) -> Self {
        let room = taps + HELD;
        Held {
            rows: vec![vec![0.0; room * width]; 3],
            width,
            room,
            from: 0,
            count: 0,
        }
    }

    /// Moves what the window about the next kept sample needs to the front, where a block has no room.
    #[inline(always)]
    fn make_room(&mut self, centre: usize, half: usize) {
        if self.count + BLOCK > self.room {
            let keep_from = (centre - half).clamp(self.from, self.from + self.count);
            let drop = keep_from - self.from;
            for held in &mut self.rows {
                held.copy_within(drop * self.width..self.count * self.width, 0);
            }
            self.from = keep_from;
            self.count -= drop;
        }
    }

    /// The next block of a chain, with what effects make of its stresses; gives its number of rows.
    #[inline(always)]
    fn produce(
        &mut self,
        k: usize,
        pass: &mut Pass<'_>,
        factor: Option<&[[f64; 2]]>,
    ) -> Result<usize, Locked> {
        let (at, width) = (self.count * self.width, self.width);
        let produced = pass.next_block(&mut self.rows[k][at..at + BLOCK * width])?;
        if let Some(factor) = factor {
            for (row, f) in self.rows[k][at..at + produced * width]
                .chunks_exact_mut(width)
                .zip(&factor[self.from + self.count..])
            {
                for (i, x) in row.iter_mut().enumerate() {
                    *x *= if i % LANES == 0 && i < ROW {
                        f[0]
                    } else {
                        f[1]
                    };
                }
            }
        }
        Ok(produced)
    }

    /// Where the windows about the next `centres` begin that are whole with the rows just produced.
    #[inline(always)]
    fn windows(&self, produced: usize, centres: &[usize], half: usize, first: &mut Vec<usize>) {
        let known = self.from + self.count + produced;
        first.clear();
        let whole = centres.iter().take_while(|&&centre| centre + half < known);
        first.extend(whole.map(|centre| centre - half - self.from));
    }
}

/// What rows of a recording are laid out from, and where its columns stand; those of the springs and nodes
/// come first.
struct Laying<'b> {
    r: &'b Prepared<'b>,
    condition: &'b Condition<'b>,
    reference: &'b [f64],
    springs: usize,
    departure_at: usize,
    t_at: usize,
    j_at: usize,
    offset_at: usize,
    last: usize,
    /// d ln J / d(1/J).
    per_reciprocal: f64,
}

impl Laying<'_> {
    /// The row of a chain at a kept sample, from the filtered columns of its film.
    #[inline(always)]
    fn row(&self, kept: usize, k: usize, film: &[f64], row: &mut [f64]) {
        let (c, reference, springs) = (self.condition, self.reference, self.springs);
        let (t_at, j_at, departure_at) = (self.t_at, self.j_at, self.departure_at);
        for (pack, film) in film.chunks_exact(ROW).enumerate() {
            let here = (springs - pack * LANES).min(LANES);
            let at = pack * LANES;
            row[at..at + here].copy_from_slice(&film[..here]);
            for (out, d) in row[j_at + at..j_at + at + here]
                .iter_mut()
                .zip(&film[2 * LANES..])
            {
                *out = self.per_reciprocal * d;
            }
            let skip = usize::from(pack == 0); // the equilibrium spring has no T
            row[t_at + at + skip - 1..t_at + at + here - 1]
                .copy_from_slice(&film[LANES + skip..LANES + here]);
        }
        let (nodes, departures) = (departure_at - springs, t_at - departure_at);
        let at = (3 * kept + k) * nodes;
        row[springs..departure_at].copy_from_slice(&c.forearm[at..at + nodes]);
        let at = (3 * kept + k) * departures;
        row[departure_at..t_at].copy_from_slice(&self.r.departed.1[at..at + departures]);
        let (maxwell, maxwell_slope) = &*c.maxwell;
        row[self.offset_at] = -maxwell_slope[kept][k];
        for (place, column) in c.values.iter().enumerate() {
            row[self.offset_at + 1 + place] = column[kept][k];
        }
        let needed: f64 = row[..t_at].iter().zip(reference).map(|(b, x)| b * x).sum();
        let known = self.r.smoothed.get(kept).map_or(0.0, |known| known[k]);
        row[self.last] = needed + c.load[kept][k] - maxwell[kept][k] - known;
    }

    /// Whitening mixes the three chains of a sample.
    #[inline(always)]
    fn whiten(&self, kept: usize, block: &mut [f64], width: usize) {
        let w = &self.r.whitening[kept];
        let scale = self.r.robust[kept];
        let (row0, rest) = block.split_at_mut(width);
        let (row1, row2) = rest.split_at_mut(width);
        for c in 0..=self.last {
            let (a, b, d) = (row0[c], row1[c], row2[c]);
            row0[c] = scale * w[0] * a;
            row1[c] = scale * (w[1] * a + w[2] * b);
            row2[c] = scale * (w[3] * a + w[4] * b + w[5] * d);
        }
    }
}

/// Residual of several robot recordings that share film and forearms.
#[derive(Clone)]
pub struct RobotResidual<'a> {
    robot: &'a Robot,
    recordings: Vec<Prepared<'a>>,
    effects: Vec<Acting>,
    /// What the mechanism and the reading of the motion are, as built, beside the drawing.
    base: Vec<Acting>,
    replicates: usize,
    /// Whether the size of the noise is followed from place to place.
    by_place: bool,
    layout: Layout,
    arch: Arch,
    forearm: ForearmTorque,
}

/// Predicted against commanded voltage of one recording.
#[derive(Debug, Clone)]
pub struct VoltageError {
    /// Predicted phi^2 at each frame and chain, V^2; NaN where out of reach.
    pub predicted_squared_v2: Vec<[f64; 3]>,
    /// Size of the voltage that the command makes on the film at each frame and chain, V: the film feels its
    /// square, so that a command's sign is no error.
    pub command_v: Vec<[f64; 3]>,
    /// Standard deviation of the predicted voltage from the noise of the capture, V (phi^2 < 0 counts as 0
    /// V).
    pub sd_v: Vec<[f64; 3]>,
    /// Frames that count: captured, not within 0.3 s of an end, in reach, with a known voltage.
    pub counts: Vec<bool>,
}

/// What the scores X'r are on average, at parameters and in their order.
#[derive(Debug, Clone)]
pub struct ExpectedScore {
    /// The average.
    pub mean: DVector<f64>,
    /// What draws of the capture's noise make of them beside.
    pub draws: Vec<DVector<f64>>,
    /// Whether the motions were simulated: without, only what noise in the columns makes is in the average.
    pub simulated: bool,
}

/// Step of the differences with respect to an effect's value, in its spread.
const VALUE_STEP: f64 = 1e-3;

/// Share by which voltages are made larger to see a slope.
const STEP: f64 = 1e-2;

/// Left out at both ends of a recording where errors in volts are counted, s.
const EDGE_S: f64 = 0.3;

/// phi of phi^2, with phi^2 < 0 as 0 V.
pub(crate) fn root_v(squared: f64) -> f64 {
    squared.max(0.0).sqrt()
}

impl Prepared<'_> {
    /// The balance along a track of the dataset's frames, with what lies between them in the films'
    /// histories: the smoothed motion, whatever the track, because noise there has faded where frames are
    /// compared again.
    fn through(&self, mut mechanics: Mechanics) -> Mechanics {
        mechanics.pass_over(&self.ways);
        mechanics
    }

    /// Why a mechanism that cannot follow a sample has no balance.
    fn lost(&self, sample: usize) -> Locked {
        Locked {
            spring: 0,
            invariant: f64::NAN,
            locking: f64::NAN,
            at_s: Some(self.dataset.time_s(sample)),
        }
    }

    /// A torque error (N m; chain, frame) at the kept samples: kept sample, chain.
    fn filtered(&self, error: &[Vec<f64>; 3]) -> Vec<f64> {
        let filtered = filtered(&self.decimation, &self.centres, error);
        filtered.into_iter().flatten().collect()
    }

    /// Torque errors at the kept samples over what noise makes of them.
    fn whiten(&self, errors: &mut [f64]) {
        for (e, w) in errors.chunks_exact_mut(3).zip(&*self.whitening) {
            let (a, b, d) = (e[0], e[1], e[2]);
            e[0] = w[0] * a;
            e[1] = w[1] * a + w[2] * b;
            e[2] = w[3] * a + w[4] * b + w[5] * d;
        }
    }

    /// The commands as effects on the clock read them.
    fn told(&self, offset_s: f64, effects: &[Acting]) -> Told<'_> {
        Told {
            recording: self,
            offset_s,
            clock: clock(effects),
            chains: Default::default(),
        }
    }

    fn common(&self, offset_s: f64, effects: &[Acting]) -> Common<'_> {
        Common {
            told: self.told(offset_s, effects),
            error: OnceLock::new(),
            made: Default::default(),
            torques: effects.iter().map(|_| Default::default()).collect(),
            film: Default::default(),
            slack: Default::default(),
        }
    }

    /// The command of a chain at the frames, read at shift + rate t.
    fn command(&self, chain: usize, offset_s: f64, (shift, rate): (f64, f64)) -> Cow<'_, Command> {
        let d = self.dataset;
        if let (true, Some(fixed)) = ((shift, rate) == (0.0, 1.0), &self.command) {
            return Cow::Borrowed(&fixed[chain]);
        }
        let step_s = d.step_s * rate;
        let mut out = Command::default();
        for (_, from_s, count) in d.runs() {
            let start_s = d.start_s + offset_s + shift + rate * (from_s - d.start_s);
            let (squared, change) = d.voltage.squared(chain, start_s, step_s, count);
            let volts = (0..count).map(|i| d.voltage.at(chain, start_s + step_s * i as f64));
            out.0.extend(squared);
            out.1.extend(change);
            out.2.extend(volts);
        }
        Cow::Owned(out)
    }

    /// Voltage that makes the Maxwell torque at the frames, V. The other actuators' commands are read only
    /// where an effect hears them.
    fn film_voltage(
        &self,
        mechanics: &Mechanics,
        chain: usize,
        told: &Told<'_>,
        effects: &[Acting],
    ) -> Vec<f64> {
        let heard = effects.iter().any(|a| a.effect.hears_others());
        let told = [0, 1, 2].map(|k| match heard || k == chain {
            true => &told.chain(k).2[..],
            false => &[],
        });
        mechanics.film_voltage_v(chain, self.when, effects, told)
    }

    /// Maxwell torque of a chain at the frames, N m, and, where that is an unknown, its change per second of
    /// clock offset: 1/2 C' times the command's square plus what the electrical effects change of it.
    fn made(
        &self,
        mechanics: &Mechanics,
        k: usize,
        told: &Told<'_>,
        effects: &[Acting],
    ) -> (Vec<f64>, Vec<f64>) {
        let command = told.chain(k);
        let electrical =
            |a: &Acting| matches!(a.effect.site(), Site::Electrical | Site::Film) && a.on[k];
        let plain = &mechanics.chains[k].half_capacitance_slope;
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).collect();
        let change = |half: &[f64]| match self.has_free_clock() {
            true => product(&command.1, half),
            false => Vec::new(),
        };
        if !effects.iter().any(electrical) {
            return (product(&command.0, plain), change(plain));
        }
        let film = self.film_voltage(mechanics, k, told, effects);
        let half = mechanics.half_capacitance_slope(k, self.when, effects);
        let made = (0..film.len())
            .map(|i| {
                let told = command.2[i];
                half[i] * (command.0[i] + (film[i] * film[i] - told * told))
            })
            .collect();
        (made, change(&half))
    }

    /// [`Prepared::maxwell_at`] of the recording as it is, at its own offset.
    fn fixed_maxwell(&self) -> (Triples, Triples) {
        let common = self.common(self.dataset.offset_s, &[]);
        self.maxwell_at(&self.mechanics, &[], &common)
    }

    /// Filtered Maxwell torque and its derivative with respect to the clock offset (0 where that is known).
    fn maxwell_at(
        &self,
        mechanics: &Mechanics,
        effects: &[Acting],
        common: &Common,
    ) -> (Triples, Triples) {
        let mut value = vec![[0.0; 3]; self.centres.len()];
        let mut slope = value.clone();
        let filter = |signal: &[f64], k: usize, out: &mut Triples| {
            let filtered = self.decimation.apply_all(&self.centres, signal);
            for (out, x) in out.iter_mut().zip(filtered) {
                out[k] = x;
            }
        };
        for k in 0..3 {
            let made = || self.made(mechanics, k, &common.told, effects);
            let (made, change) = common.made[k].get_or_init(made);
            filter(made, k, &mut value);
            if self.has_free_clock() {
                filter(change, k, &mut slope);
            }
        }
        (value, slope)
    }

    /// Whether the clock offset is an unknown.
    fn has_free_clock(&self) -> bool {
        self.dataset.offset_source == OffsetSource::Free
    }
}

/// Values of a series of each chain, filtered at `centres`.
fn filtered(decimation: &Decimation, centres: &[usize], series: &[Vec<f64>; 3]) -> Triples {
    let [a, b, c] = [0, 1, 2].map(|k| decimation.apply_all(centres, &series[k]));
    a.into_iter()
        .zip(b)
        .zip(c)
        .map(|((a, b), c)| [a, b, c])
        .collect()
}

/// How effects on the clock read the command at t after the first frame: at shift + rate t.
fn clock(effects: &[Acting]) -> (f64, f64) {
    let read = |t: f64| {
        effects
            .iter()
            .filter(|a| a.effect.site() == Site::Clock)
            .fold(t, |t, a| a.effect.clock(&a.values, t))
    };
    let shift = read(0.0);
    (shift, read(1.0) - shift)
}

impl<'a> RobotResidual<'a> {
    /// Prepares `datasets` of `robot` for films with `branches` branches and a forearm curve on the nodes of
    /// `forearm`.
    ///
    /// Without noise weights every torque counts alike (in units of 1e-4 N m) until [`RobotResidual::weigh`]
    /// is called.
    ///
    /// # Errors
    /// The number of the recording and the first pose that the mechanism cannot take, when more than one
    /// frame in twenty of a recording is out of reach.
    pub fn new(
        robot: &'a Robot,
        datasets: &[&'a Dataset],
        branches: usize,
        forearm: &ForearmTorque,
    ) -> Result<Self, (usize, usize, Unreachable)> {
        let nodes = forearm.nodes_rad().len();
        let recordings = datasets
            .par_iter()
            .enumerate()
            .map(|(number, dataset)| {
                let mut mechanics =
                    Mechanics::new(robot, &dataset.track()).map_err(|(i, e)| (number, i, e))?;
                let ways = dataset
                    .between()
                    .iter()
                    .map(|b| {
                        Mechanics::ways(robot, dataset.step_s, &b.position_m, &b.velocity_m_s)
                            .map(|ways| (b.before, ways))
                            .map_err(|e| (number, b.before, e))
                    })
                    .collect::<Result<Vec<_>, _>>()?;
                mechanics.pass_over(&ways);
                let lost: Vec<&(usize, Unreachable)> = mechanics
                    .unreachable
                    .iter()
                    .filter(|(i, _)| dataset.usable[*i])
                    .collect();
                if lost.len() * 20 > dataset.samples() {
                    return Err((number, lost[0].0, lost[0].1));
                }
                let when = When {
                    recording: number,
                    series_s: 0.0,
                    start_s: dataset.start_s,
                };
                Ok(prepare(dataset, when, mechanics, ways, forearm))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let free_offsets = datasets
            .iter()
            .enumerate()
            .filter(|(_, d)| d.offset_source == OffsetSource::Free)
            .map(|(i, _)| i)
            .collect();
        Ok(RobotResidual {
            robot,
            recordings,
            layout: Layout {
                branches,
                nodes,
                departures: 0,
                free_offsets,
                free_values: Vec::new(),
            },
            effects: Vec::new(),
            base: Vec::new(),
            replicates: REPLICATES,
            by_place: false,
            arch: Arch::new(),
            forearm: forearm.clone(),
        })
    }

    /// The same recordings and weights with `effects` at work; `free` are those of their values that are
    /// unknowns. `series` says when each recording was made.
    pub fn with_effects(
        &self,
        effects: Vec<Acting>,
        free: Vec<(usize, usize)>,
        series: &[When],
    ) -> RobotResidual<'a> {
        let mut recordings = self.recordings.clone();
        for (r, when) in recordings.iter_mut().zip(series) {
            r.when = *when;
        }
        RobotResidual {
            robot: self.robot,
            recordings,
            layout: Layout {
                free_values: free,
                ..self.layout.clone()
            },
            effects,
            base: self.base.clone(),
            replicates: self.replicates,
            by_place: self.by_place,
            arch: self.arch,
            forearm: self.forearm.clone(),
        }
    }

    /// The effects at eta.
    pub fn effects(&self, eta: &[f64]) -> Vec<Acting> {
        let mut out = self.effects.clone();
        let first = self.layout.first_value();
        for (place, &(effect, value)) in self.layout.free_values.iter().enumerate() {
            let spread = out[effect].effect.parameters()[value].spread;
            out[effect].values[value] = eta[first + place] * spread;
        }
        out
    }

    /// The robot as drawn.
    pub fn robot(&self) -> &'a Robot {
        self.robot
    }

    /// Where the parameters stand.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The recordings.
    pub fn datasets(&self) -> impl Iterator<Item = &'a Dataset> + '_ {
        self.recordings.iter().map(|r| r.dataset)
    }

    /// A recording.
    pub fn dataset(&self, recording: usize) -> &'a Dataset {
        self.recordings[recording].dataset
    }

    /// When the recordings were made.
    pub fn series(&self) -> Vec<When> {
        self.recordings.iter().map(|r| r.when).collect()
    }

    /// The balance along a recording.
    pub fn mechanics(&self, recording: usize) -> &Mechanics {
        &self.recordings[recording].mechanics
    }

    /// Kept samples of all recordings, over all chains: the number of residuals.
    pub fn rows(&self) -> usize {
        self.recordings.iter().map(|r| 3 * r.centres.len()).sum()
    }

    /// Clock offset of a recording at eta, s.
    pub fn offset_s(&self, recording: usize, eta: &[f64]) -> f64 {
        match self
            .layout
            .free_offsets
            .iter()
            .position(|&r| r == recording)
        {
            Some(place) => eta[self.layout.branches + 1 + place],
            None => self.recordings[recording].dataset.offset_s,
        }
    }

    /// Film and forearm at eta, beta.
    pub fn parameters(&self, eta: &[f64], beta: &[f64]) -> Parameters {
        let n = self.layout.branches;
        Parameters {
            film: crate::film::Film {
                mu_pa: beta[..=n].to_vec(),
                relaxation_time_s: eta[..n].iter().map(|t| t.exp()).collect(),
                locking: 1.0 / eta[n],
            },
            forearm: self
                .forearm
                .with_torques(&beta[n + 1..n + 1 + self.layout.nodes]),
        }
    }

    /// Columns of a row: springs, nodes, departures, d/d ln T, d/d(1/J), d/d offset, d/d values, residual;
    /// padded.
    fn width(&self) -> usize {
        (self.last() + 1).next_multiple_of(PAD)
    }

    /// Column of the residual.
    fn last(&self) -> usize {
        let s = self.layout.branches + 1;
        self.layout.linear() + (s - 1) + s + 1 + self.layout.free_values.len()
    }

    /// Calls `each(first kept sample, rows)` with blocks of whitened rows of one recording; a kept sample has
    /// three rows.
    fn for_each_block(
        &self,
        recording: usize,
        eta: &[f64],
        reference: &[f64],
        mut each: impl FnMut(usize, &[f64]),
    ) -> Result<(), Locked> {
        let r = &self.recordings[recording];
        let condition = self.condition(recording, eta, reference)?;
        let n = self.layout.branches;
        let relaxation: Vec<f64> = eta[..n].iter().map(|t| t.exp()).collect();
        let shape = Shape {
            relaxation_time_s: &relaxation,
            locking: 1.0 / eta[n],
        };
        let film_width = ROW * shape.packs();
        let half = r.decimation.half;
        let mut passes: Vec<Pass> = (0..3)
            .map(|k| Pass::new(&condition.mechanics.chains[k].history, shape))
            .collect();
        let mut held = Held::new(2 * half + 1, film_width);
        let laying = self.laying(recording, eta, reference, &condition);
        let width = self.width();
        let mut filtered: Vec<Vec<f64>> = vec![Vec::new(); 3];
        let mut first = Vec::new();
        let mut rows = Vec::new();
        let mut next_kept = 0;
        while next_kept < r.centres.len() {
            held.make_room(r.centres[next_kept], half);
            // Chain by chain, so that the filter finds the rows where the kernel has just put them.
            let mut produced = 0;
            for k in 0..3 {
                produced = held.produce(k, &mut passes[k], condition.factor[k].as_deref())?;
                if k == 0 {
                    held.windows(produced, &r.centres[next_kept..], half, &mut first);
                }
                filtered[k].resize(first.len() * film_width, 0.0);
                filter_rows(
                    self.arch,
                    &r.decimation.weights,
                    &held.rows[k],
                    film_width,
                    &first,
                    &mut filtered[k],
                );
            }
            held.count += produced;
            if produced == 0 {
                break;
            }
            if first.is_empty() {
                continue;
            }
            rows.clear();
            rows.resize(3 * first.len() * width, 0.0);
            for j in 0..first.len() {
                let kept = next_kept + j;
                let block = &mut rows[3 * j * width..3 * (j + 1) * width];
                for k in 0..3 {
                    let film = &filtered[k][j * film_width..(j + 1) * film_width];
                    laying.row(kept, k, film, &mut block[k * width..(k + 1) * width]);
                }
                laying.whiten(kept, block, width);
            }
            each(next_kept, &rows);
            next_kept += first.len();
        }
        Ok(())
    }

    /// Where the columns of a recording's rows stand at `eta`.
    fn laying<'b>(
        &'b self,
        recording: usize,
        eta: &[f64],
        reference: &'b [f64],
        condition: &'b Condition<'b>,
    ) -> Laying<'b> {
        let n = self.layout.branches;
        let springs = n + 1;
        let departure_at = springs + self.layout.nodes;
        let t_at = departure_at + self.layout.departures;
        let offset_at = t_at + n + springs;
        Laying {
            r: &self.recordings[recording],
            condition,
            reference,
            springs,
            departure_at,
            t_at,
            j_at: t_at + n,
            offset_at,
            last: self.last(),
            per_reciprocal: -1.0 / eta[n],
        }
    }

    /// Gram matrix of one recording, columns as in [`RobotResidual::width`].
    fn gram(&self, recording: usize, eta: &[f64], reference: &[f64]) -> Result<Vec<f64>, Locked> {
        let width = self.width();
        let mut gram = vec![0.0; width * width];
        self.for_each_block(recording, eta, reference, |_, rows| {
            add_rows(self.arch, rows, width, &mut gram);
        })?;
        Ok(gram)
    }

    fn slopes(&self) -> Vec<Slope> {
        let n = self.layout.branches;
        let relaxation = (0..n).map(|i| (i, Some(i + 1)));
        let locking = (0..=n).map(|i| (n, Some(i)));
        let own = (0..self.layout.free_offsets.len() + self.layout.free_values.len())
            .map(|i| (n + 1 + i, None));
        relaxation
            .chain(locking)
            .chain(own)
            .map(|(nonlinear, linear)| Slope { nonlinear, linear })
            .collect()
    }

    /// Column of a recording's rows for each column of the whole; `None` where it is zero.
    fn columns(&self, recording: usize) -> Vec<Option<usize>> {
        let s = self.layout.branches + 1;
        let own = self.layout.linear() + (s - 1) + s;
        let offsets = self
            .layout
            .free_offsets
            .iter()
            .map(|&r| (r == recording).then_some(own));
        (0..own)
            .map(Some)
            .chain(offsets)
            .chain((own + 1..=self.last()).map(Some))
            .collect()
    }

    /// Squared whitened residual of each kept sample at the parameters, over its three chains: what a robust
    /// loss looks at.
    fn squares(&self, recording: usize, eta: &[f64], beta: &[f64]) -> Result<Vec<f64>, Locked> {
        let width = self.width();
        let last = self.last();
        let mut out = vec![0.0; self.recordings[recording].centres.len()];
        self.for_each_block(recording, eta, beta, |first, rows| {
            for (i, row) in rows.chunks_exact(width).enumerate() {
                out[first + i / 3] += row[last] * row[last];
            }
        })?;
        Ok(out)
    }

    /// Sets Huber weights: a kept sample whose whitened residual (rms over its chains) exceeds `limit` counts
    /// as limit/residual.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn robustify(&mut self, eta: &[f64], beta: &[f64], limit: f64) -> Result<(), Locked> {
        for r in 0..self.recordings.len() {
            self.recordings[r].robust = Arc::new(vec![1.0; self.recordings[r].centres.len()]);
            let squares = self.squares(r, eta, beta)?;
            let robust = Arc::make_mut(&mut self.recordings[r].robust);
            for (weight, square) in robust.iter_mut().zip(squares) {
                let size = (square / 3.0).sqrt();
                if size > limit {
                    *weight = (limit / size).sqrt();
                }
            }
        }
        Ok(())
    }

    /// Torque error (needed minus made, N m) of each frame and chain of one recording along `mechanics`, with
    /// effects.
    fn torque_error(
        &self,
        recording: usize,
        mechanics: &Mechanics,
        parameters: &Parameters,
        told: &Told<'_>,
        effects: &[Acting],
    ) -> Result<[Vec<f64>; 3], Locked> {
        let film = ChainTorques::new(mechanics, parameters)?;
        self.error_with(recording, mechanics, &film, parameters, told, effects)
    }

    /// The same where the films' torques are known.
    fn error_with(
        &self,
        recording: usize,
        mechanics: &Mechanics,
        film: &ChainTorques,
        parameters: &Parameters,
        told: &Told<'_>,
        effects: &[Acting],
    ) -> Result<[Vec<f64>; 3], Locked> {
        let (needed, made) = self.sides(recording, mechanics, film, parameters, told, effects)?;
        let mut out = needed;
        for (out, made) in out.iter_mut().zip(&made) {
            for (o, m) in out.iter_mut().zip(made) {
                *o -= m;
            }
        }
        Ok(out)
    }

    /// Needed and made torque (N m) of each chain and frame of one recording along `mechanics`, with effects.
    fn sides(
        &self,
        recording: usize,
        mechanics: &Mechanics,
        own: &ChainTorques,
        parameters: &Parameters,
        told: &Told<'_>,
        effects: &[Acting],
    ) -> Result<(Chains, Chains), Locked> {
        let r = &self.recordings[recording];
        let mut needed: [Vec<f64>; 3] = Default::default();
        for (k, needed) in needed.iter_mut().enumerate() {
            let film = &own.0[k].film;
            *needed = match mechanics.stress_factor(k, r.when, effects, &parameters.film) {
                Some(factor) => film
                    .iter()
                    .zip(&factor)
                    .map(|(t, f)| t[0] * f[0] + t[1] * f[1])
                    .collect(),
                None => film.iter().map(|t| t[0] + t[1]).collect(),
            };
            let chain = &mechanics.chains[k];
            for (i, needed) in needed.iter_mut().enumerate() {
                *needed += chain.load(i);
            }
            self.add_effect_torque(r, mechanics, k, parameters, told, effects, needed)?;
        }
        let forearm = [0, 1, 2].map(|k| &own.0[k].forearm[..]);
        for (k, needed) in needed.iter_mut().enumerate() {
            mechanics.add_forearms(k, forearm, needed);
        }
        let made = [0, 1, 2].map(|k| r.made(mechanics, k, told, effects).0);
        Ok((needed, made))
    }

    /// What the effects ask for beside the plain model's torques.
    #[allow(clippy::too_many_arguments)]
    fn add_effect_torque(
        &self,
        r: &Prepared,
        mechanics: &Mechanics,
        k: usize,
        parameters: &Parameters,
        told: &Told<'_>,
        effects: &[Acting],
        needed: &mut [f64],
    ) -> Result<(), Locked> {
        if effects.iter().any(|a| a.effect.site() == Site::Balance) {
            let torque = mechanics.effect_torque_n_m(k, r.when, effects);
            for (n, t) in needed.iter_mut().zip(torque) {
                *n -= t;
            }
        }
        if effects.iter().any(|a| a.effect.needs_tension()) {
            let phi = r.film_voltage(mechanics, k, told, effects);
            let slack = mechanics.slack_torque_n_m(k, r.when, effects, parameters, &phi)?;
            for (n, t) in needed.iter_mut().zip(slack.into_iter().flatten()) {
                *n += t;
            }
        }
        Ok(())
    }

    /// Filtered values of a series of each chain at the kept samples of a recording.
    fn filtered(&self, recording: usize, series: &[Vec<f64>; 3]) -> Triples {
        let r = &self.recordings[recording];
        filtered(&r.decimation, &r.centres, series)
    }

    /// What the rows of a recording are made of at `eta`; derivatives with respect to free values at the
    /// linear parameters `beta`.
    fn condition(
        &self,
        recording: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Condition<'_>, Locked> {
        let r = &self.recordings[recording];
        let offset = self.offset_s(recording, eta);
        let maxwell = match &r.maxwell {
            Some(fixed) => Cow::Borrowed(&**fixed),
            None => Cow::Owned(r.maxwell_at(&r.mechanics, &[], &r.common(offset, &[]))),
        };
        if self.effects.is_empty() {
            return Ok(Condition {
                mechanics: Cow::Borrowed(&r.mechanics),
                load: Cow::Borrowed(&r.load),
                forearm: Cow::Borrowed(&r.forearm),
                maxwell,
                factor: [None, None, None],
                values: Vec::new(),
            });
        }
        let effects = self.effects(eta);
        let parameters = self.parameters(eta, beta);
        let has = |site: Site| effects.iter().any(|a| a.effect.site() == site);
        let linear = r.linear.as_deref().filter(|_| has(Site::Motion));
        let mechanics = match linear {
            Some(linear) => Cow::Borrowed(&linear.mechanics),
            None => self.mechanics_with(recording, &effects)?,
        };
        let moved = has(Site::Motion);
        let mut load = Cow::Borrowed(&r.load[..]);
        let mut forearm = Cow::Borrowed(&r.forearm[..]);
        match linear {
            Some(linear) => {
                load = Cow::Borrowed(&linear.load[..]);
                forearm = Cow::Borrowed(&linear.forearm[..]);
                for (place, here, column) in &linear.values {
                    let step = eta[*place] - here;
                    if step != 0.0 {
                        for (l, c) in load.to_mut().iter_mut().zip(column) {
                            for k in 0..3 {
                                l[k] += step * c[k];
                            }
                        }
                    }
                }
            }
            None if moved => {
                load = Cow::Owned(filtered_load(&mechanics, &r.decimation, &r.centres));
                let (curve, d) = (&self.forearm, &r.decimation);
                let columns = forearm_columns(&mechanics, curve, d, &r.centres, self.arch);
                forearm = Cow::Owned(columns);
            }
            None => {}
        }
        let common = r.common(offset, &effects);
        if has(Site::Balance) || effects.iter().any(|a| a.effect.needs_tension()) {
            let mut extra: [Vec<f64>; 3] = [(); 3].map(|()| vec![0.0; mechanics.samples()]);
            for (k, extra) in extra.iter_mut().enumerate() {
                self.add_effect_torque(
                    r,
                    &mechanics,
                    k,
                    &parameters,
                    &common.told,
                    &effects,
                    extra,
                )?;
            }
            let extra = self.filtered(recording, &extra);
            for (l, e) in load.to_mut().iter_mut().zip(extra) {
                for k in 0..3 {
                    l[k] += e[k];
                }
            }
        }
        let maxwell = if moved || has(Site::Electrical) || has(Site::Clock) || has(Site::Film) {
            Cow::Owned(r.maxwell_at(&mechanics, &effects, &common))
        } else {
            maxwell
        };
        let factor =
            [0, 1, 2].map(|k| mechanics.stress_factor(k, r.when, &effects, &parameters.film));
        let exact = |site: Site| linear.is_none() || site != Site::Motion;
        let own = (&*mechanics, &effects[..], &common);
        let mut values = self.value_columns(recording, eta, beta, own, exact)?;
        for (place, _, column) in linear.iter().flat_map(|l| &l.values) {
            values[place - self.layout.first_value()].clone_from(column);
        }
        Ok(Condition {
            mechanics,
            load,
            forearm,
            maxwell,
            factor,
            values,
        })
    }

    /// Works out the recordings at the values in `eta` of the effects that move the mechanism or the motion.
    /// Until this is called again the residual is linear in those values; evaluating it at other values costs
    /// no more than without them. With `anew` the changes per value are worked out as well, without it those
    /// of the last call go on (they change little): a secant step that costs one walk through the mechanism
    /// instead of one more a value.
    ///
    /// # Errors
    /// [`Locked`] when the mechanism cannot follow.
    pub fn linearise(&mut self, eta: &[f64], beta: &[f64], anew: bool) -> Result<(), Locked> {
        let effects = self.effects(eta);
        if effects.iter().all(|a| a.effect.site() != Site::Motion) {
            return Ok(());
        }
        let first = self.layout.first_value();
        for number in 0..self.recordings.len() {
            let mechanics = self.mechanics_with(number, &effects)?.into_owned();
            let r = &self.recordings[number];
            let values = match &r.linear {
                Some(old) if !anew => {
                    let here = |(place, _, column): &(usize, f64, Triples)| {
                        (*place, eta[*place], column.clone())
                    };
                    old.values.iter().map(here).collect()
                }
                _ => {
                    let motion = |site: Site| site == Site::Motion;
                    let common = r.common(self.offset_s(number, eta), &effects);
                    let own = (&mechanics, &effects[..], &common);
                    let columns = self.value_columns(number, eta, beta, own, motion)?;
                    self.layout
                        .free_values
                        .iter()
                        .enumerate()
                        .zip(columns)
                        .filter(|((_, (e, _)), _)| motion(effects[*e].effect.site()))
                        .map(|((place, _), column)| (first + place, eta[first + place], column))
                        .collect()
                }
            };
            let load = filtered_load(&mechanics, &r.decimation, &r.centres);
            let forearm = forearm_columns(
                &mechanics,
                &self.forearm,
                &r.decimation,
                &r.centres,
                self.arch,
            );
            self.recordings[number].linear = Some(Arc::new(Linear {
                mechanics,
                load,
                forearm,
                values,
            }));
        }
        Ok(())
    }

    /// The balance of a recording with those effects that change it.
    fn mechanics_with(
        &self,
        recording: usize,
        effects: &[Acting],
    ) -> Result<Cow<'_, Mechanics>, Locked> {
        let r = &self.recordings[recording];
        if effects.iter().all(|a| a.effect.site() != Site::Motion) {
            return Ok(Cow::Borrowed(&r.mechanics));
        }
        self.mechanics_anew(recording, effects).map(Cow::Owned)
    }

    /// The balance of a recording as built, with effects.
    fn mechanics_anew(&self, recording: usize, effects: &[Acting]) -> Result<Mechanics, Locked> {
        let r = &self.recordings[recording];
        if r.ways.is_empty() {
            let made = r.mechanics.with_more(effects, r.dataset.pivot_m);
            return made.map_err(|(sample, _)| r.lost(sample));
        }
        self.differing_by(recording, &[&self.base[..], effects].concat())
    }

    /// The balance of a recording of a robot that differs from its drawing by effects.
    fn differing_by(&self, recording: usize, effects: &[Acting]) -> Result<Mechanics, Locked> {
        let r = &self.recordings[recording];
        let track = match &r.other_track {
            Some(track) => Cow::Borrowed(&**track),
            None => Cow::Owned(r.dataset.track()),
        };
        let known = Some(&*r.mechanics).filter(|_| r.ways.is_empty());
        let pivot_m = r.dataset.pivot_m;
        let made = Mechanics::with_effects(self.robot, &track, effects, pivot_m, known);
        let made = made.map_err(|(sample, _)| r.lost(sample))?;
        Ok(r.through(made))
    }

    /// Takes the mechanism and the reading of the motion to be these effects beside the drawing, once and for
    /// all that follows.
    ///
    /// # Errors
    /// [`Locked`] when the mechanism cannot follow.
    pub fn rebuild(&mut self, base: Vec<Acting>) -> Result<(), Locked> {
        self.base = base;
        for number in 0..self.recordings.len() {
            let mechanics = self.differing_by(number, &self.base)?;
            let (arch, curve) = (self.arch, &self.forearm);
            let r = &mut self.recordings[number];
            r.load = Arc::new(filtered_load(&mechanics, &r.decimation, &r.centres));
            let columns = forearm_columns(&mechanics, curve, &r.decimation, &r.centres, arch);
            r.forearm = Arc::new(columns);
            r.mechanics = Arc::new(mechanics);
            if r.maxwell.is_some() {
                r.maxwell = Some(Arc::new(r.fixed_maxwell()));
            }
        }
        for r in &mut self.recordings {
            r.drawn = Arc::default(); // worked out when weights are next set
        }
        Ok(())
    }

    /// d(filtered residual)/d eta of every free value of an effect at a site that is `wanted`, by a forward
    /// difference of the side that the value changes; empty for the others.
    fn value_columns<'s>(
        &'s self,
        recording: usize,
        eta: &[f64],
        beta: &[f64],
        own @ (_, effects, _): (&Mechanics, &[Acting], &Common<'s>),
        wanted: impl Fn(Site) -> bool,
    ) -> Result<Vec<Triples>, Locked> {
        let parameters = self.parameters(eta, beta);
        self.layout
            .free_values
            .iter()
            .map(|&(effect, value)| {
                if !wanted(effects[effect].effect.site()) {
                    return Ok(Triples::new());
                }
                let q = &effects[effect].effect.parameters()[value];
                let mut other = effects.to_vec();
                let here = other[effect].values[value];
                let up = here + VALUE_STEP * q.spread;
                let step = if up > q.upper {
                    -VALUE_STEP
                } else {
                    VALUE_STEP
                };
                other[effect].values[value] = here + step * q.spread;
                let change = self.change(recording, &parameters, own, (&other, effect))?;
                let mut column = self.filtered(recording, &change);
                for c in column.iter_mut().flatten() {
                    *c /= step;
                }
                Ok(column)
            })
            .collect()
    }

    /// Change of the torque error of a recording (N m, chain, frame) when `effects` become `other`, which
    /// differ from them in the effect number `changed` only.
    fn change<'s>(
        &'s self,
        recording: usize,
        parameters: &Parameters,
        (mechanics, effects, common): (&Mechanics, &[Acting], &Common<'s>),
        (other, changed): (&[Acting], usize),
    ) -> Result<[Vec<f64>; 3], Locked> {
        let r = &self.recordings[recording];
        let mut out: [Vec<f64>; 3] = [(); 3].map(|()| vec![0.0; mechanics.samples()]);
        let acting = &other[changed];
        let made = |k: usize| {
            let made = || r.made(mechanics, k, &common.told, effects);
            common.made[k].get_or_init(made)
        };
        match acting.effect.site() {
            Site::Balance => {
                for k in (0..3).filter(|&k| acting.on[k]) {
                    let of = |all: &[Acting]| {
                        mechanics.effect_torque_n_m(k, r.when, &all[changed..=changed])
                    };
                    let a = of(other);
                    out[k] = match common.torques.get(changed) {
                        Some(own) => {
                            let b = own[k].get_or_init(|| of(effects));
                            a.iter().zip(b).map(|(a, b)| b - a).collect()
                        }
                        None => a.iter().map(|a| 0.0 - a).collect(),
                    };
                }
            }
            site @ (Site::Electrical | Site::Clock) => {
                let anew = r.told(common.told.offset_s, other);
                let told = match site {
                    Site::Clock => &anew,
                    _ => &common.told,
                };
                for k in (0..3).filter(|&k| acting.on[k]) {
                    let a = r.made(mechanics, k, told, other).0;
                    let b = &made(k).0;
                    out[k] = a.iter().zip(b).map(|(a, b)| b - a).collect();
                }
            }
            Site::Film => {
                for k in (0..3).filter(|&k| acting.on[k]) {
                    let slack = |with: &[Acting]| {
                        let phi = r.film_voltage(mechanics, k, &common.told, with);
                        mechanics.slack_torque_n_m(k, r.when, with, parameters, &phi)
                    };
                    if acting.effect.needs_tension() {
                        let a = slack(other)?.unwrap_or_default();
                        let b = match common.slack[k].get() {
                            Some(known) => known,
                            None => {
                                let b = slack(effects)?.unwrap_or_else(|| vec![0.0; a.len()]);
                                common.slack[k].get_or_init(|| b)
                            }
                        };
                        out[k] = a.iter().zip(b).map(|(a, b)| a - b).collect();
                    } else {
                        let film = match common.film[k].get() {
                            Some(known) => known,
                            None => {
                                let film = mechanics.film_torque_n_m(k, parameters)?;
                                common.film[k].get_or_init(|| film)
                            }
                        };
                        let one = || vec![[1.0; 2]; film.len()];
                        let factor = |with: &[Acting]| {
                            mechanics
                                .stress_factor(k, r.when, with, &parameters.film)
                                .unwrap_or_else(one)
                        };
                        let (a, b) = (factor(other), factor(effects));
                        out[k] = (0..film.len())
                            .map(|i| {
                                film[i][0] * (a[i][0] - b[i][0]) + film[i][1] * (a[i][1] - b[i][1])
                            })
                            .collect();
                        let a = r.made(mechanics, k, &common.told, other).0;
                        let b = &made(k).0;
                        for (o, (a, b)) in out[k].iter_mut().zip(a.iter().zip(b)) {
                            *o += b - a;
                        }
                    }
                }
            }
            Site::Motion => {
                let moved = self.mechanics_with(recording, other)?;
                let base = match common.error.get() {
                    Some(known) => known,
                    None => {
                        let film = ChainTorques::new(mechanics, parameters)?;
                        let error = self.error_with(
                            recording,
                            mechanics,
                            &film,
                            parameters,
                            &common.told,
                            effects,
                        )?;
                        common.error.get_or_init(|| (film, error))
                    }
                };
                let film = ChainTorques::beside(&moved, parameters, mechanics, &base.0)?;
                let a =
                    self.error_with(recording, &moved, &film, parameters, &common.told, other)?;
                let b = &base.1;
                for k in 0..3 {
                    out[k] = a[k].iter().zip(&b[k]).map(|(a, b)| a - b).collect();
                }
            }
        }
        Ok(out)
    }

    /// Whitened change of the residual of all recordings, row by row as in [`RobotResidual::design`], when
    /// `acting` joins the effects at the parameters. What changes the torque that a voltage makes by a share
    /// is told at the torque that the model asks for.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch, or the mechanism cannot follow.
    pub fn fingerprint(
        &self,
        eta: &[f64],
        beta: &[f64],
        acting: &Acting,
    ) -> Result<Vec<f64>, Locked> {
        let parameters = self.parameters(eta, beta);
        let effects = self.effects(eta);
        let mut other = effects.clone();
        other.push(acting.clone());
        let mut out = Vec::with_capacity(self.rows());
        for recording in 0..self.recordings.len() {
            let mechanics = self.mechanics_with(recording, &effects)?;
            let offset = self.offset_s(recording, eta);
            let common = self.recordings[recording].common(offset, &effects);
            let mut change = self.change(
                recording,
                &parameters,
                (&mechanics, &effects, &common),
                (&other, effects.len()),
            )?;
            if acting.effect.share_of_made(&acting.values) != 0.0 {
                let mut error =
                    self.torque_error(recording, &mechanics, &parameters, &common.told, &effects)?;
                self.depart(recording, beta, &mut error);
                as_asked_for(acting, &error, &mut change);
            }
            let filtered = self.filtered(recording, &change);
            let r = &self.recordings[recording];
            for (f, w) in filtered.iter().zip(&*r.whitening) {
                out.extend([
                    w[0] * f[0],
                    w[1] * f[0] + w[2] * f[1],
                    w[3] * f[0] + w[4] * f[1] + w[5] * f[2],
                ]);
            }
        }
        Ok(out)
    }

    /// What each of `list` changes of the torque error at the parameters, with the effects that are at work:
    /// recording by recording. What changes the torque that a voltage makes by a share is told at the torque
    /// that the model asks for.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch, or the mechanism cannot follow.
    pub fn departures(
        &self,
        eta: &[f64],
        beta: &[f64],
        list: &[Departure],
    ) -> Result<DepartureTorques, Locked> {
        let parameters = self.parameters(eta, beta);
        let effects = self.effects(eta);
        (0..self.recordings.len())
            .map(|recording| {
                let mechanics = self.mechanics_with(recording, &effects)?;
                let offset = self.offset_s(recording, eta);
                let none = || [(); 3].map(|()| vec![0.0; mechanics.samples()]);
                let common = self.recordings[recording].common(offset, &effects);
                let error =
                    self.torque_error(recording, &mechanics, &parameters, &common.told, &effects)?;
                let of = |k: usize| mechanics.spring_torques_n_m(k, &parameters);
                let springs = [of(0)?, of(1)?, of(2)?];
                let change = |departure: &Departure| {
                    let mut out = match departure {
                        Departure::Effect { only, .. } if only.is_some_and(|o| o != recording) => {
                            return Ok(none());
                        }
                        Departure::Effect { acting, .. } => {
                            let mut other = effects.clone();
                            other.push(acting.clone());
                            let own = (&*mechanics, &effects[..], &common);
                            let number = effects.len();
                            self.change(recording, &parameters, own, (&other, number))?
                        }
                        Departure::Spring {
                            chain,
                            spring,
                            share,
                        } => {
                            let mut out = none();
                            for (o, t) in out[*chain].iter_mut().zip(&springs[*chain]) {
                                *o = share * t[*spring];
                            }
                            out
                        }
                    };
                    if let Departure::Effect { acting, .. } = departure {
                        as_asked_for(acting, &error, &mut out);
                    }
                    for (i, _) in &mechanics.unreachable {
                        for chain in &mut out {
                            chain[*i] = 0.0;
                        }
                    }
                    Ok(out)
                };
                list.par_iter().map(change).collect()
            })
            .collect()
    }

    /// What it changes of the torque error that a recording begins elsewhere than where its smoothed first
    /// sample lies, by a standard deviation of that in each chain's angle. The film is taken to have relaxed
    /// there, so that the noise of one sample stays in the branches for as long as they remember. For each
    /// recording, three for each of all recordings.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn begun(&self, eta: &[f64], beta: &[f64]) -> Result<DepartureTorques, Locked> {
        let parameters = self.parameters(eta, beta);
        let all = self.recordings.len();
        let of = |number: usize, r: &Prepared| {
            let none = || [(); 3].map(|()| vec![0.0; r.mechanics.samples()]);
            let mut out: Vec<Chains> = (0..3 * all).map(|_| none()).collect();
            let mut other = (*r.mechanics).clone();
            for k in 0..3 {
                let (lozenge, lever) = (
                    &r.mechanics.robot.lozenges[k],
                    r.mechanics.chains[k].lever[0],
                );
                let sd = |axis: usize| r.dataset.axes[axis].position_sd[0] * lever[axis];
                let sd = sd(0).hypot(sd(1)).hypot(sd(2));
                let angle = r.mechanics.chains[k].theta_dea_rad[0] + sd;
                let rest = lozenge.stretches(angle).map(|l| (l * l).recip());
                let before = r.mechanics.film_torque_n_m(k, &parameters)?;
                Arc::make_mut(&mut other.chains[k].own).history.first.rest = rest;
                let after = other.film_torque_n_m(k, &parameters)?;
                let change = after.iter().zip(&before).map(|(a, b)| a[1] - b[1]);
                out[3 * number + k][k] = change.collect();
            }
            Ok(out)
        };
        (self.recordings.par_iter().enumerate())
            .map(|(number, r)| of(number, r))
            .collect()
    }

    /// The columns of [`RobotResidual::departures`] in whitened residuals, row by row as in
    /// [`RobotResidual::design`].
    pub fn departure_rows(&self, torques: &[Vec<Chains>]) -> DMatrix<f64> {
        let count = torques.first().map_or(0, Vec::len);
        let mut out = DMatrix::zeros(self.rows(), count);
        let mut from = 0;
        for (r, own) in self.recordings.iter().zip(torques) {
            for (j, torque) in own.iter().enumerate() {
                let mut rows = r.filtered(torque);
                r.whiten(&mut rows);
                out.view_mut((from, j), (rows.len(), 1))
                    .copy_from_slice(&rows);
            }
            from += 3 * r.centres.len();
        }
        out
    }

    /// Lets the robot depart along these combinations (columns) of departures: one linear unknown each, after
    /// the forearm's nodes. With none it is as drawn.
    pub fn allow(&mut self, torques: &[Vec<Chains>], combine: &DMatrix<f64>) {
        let directions = combine.ncols();
        self.layout.departures = directions;
        for (number, r) in self.recordings.iter_mut().enumerate() {
            if directions == 0 {
                r.departed = Arc::default();
                continue;
            }
            let own = &torques[number];
            let each: Vec<Chains> = (0..directions)
                .into_par_iter()
                .map(|d| {
                    [0, 1, 2].map(|k| {
                        let mut sum = vec![0.0; own.first().map_or(0, |o| o[k].len())];
                        for (j, torque) in own.iter().enumerate() {
                            let share = combine[(j, d)];
                            for (s, t) in sum.iter_mut().zip(&torque[k]) {
                                *s += share * t;
                            }
                        }
                        sum
                    })
                })
                .collect();
            let mut rows = vec![0.0; 3 * r.centres.len() * directions];
            for (d, torque) in each.iter().enumerate() {
                for (at, x) in r.filtered(torque).into_iter().enumerate() {
                    rows[at * directions + d] = x;
                }
            }
            r.departed = Arc::new((each, rows));
        }
    }

    /// Departures (N m at the frames, as [`RobotResidual::departures`] gives them) at the kept samples: for
    /// each recording one row a kept sample and chain, one column a departure.
    pub fn filtered_departures(&self, torques: &[Vec<Chains>]) -> Vec<DMatrix<f64>> {
        let each = |(r, torques): (&Prepared, &Vec<Chains>)| {
            let columns: Vec<DVector<f64>> = (torques.par_iter())
                .map(|t| DVector::from_vec(r.filtered(t)))
                .collect();
            match columns.is_empty() {
                true => DMatrix::zeros(3 * r.centres.len(), 0),
                false => DMatrix::from_columns(&columns),
            }
        };
        self.recordings.iter().zip(torques).map(each).collect()
    }

    /// Lets the robot depart along these combinations (columns) of [`RobotResidual::filtered_departures`]
    /// too, beside those that it may have already: linear unknowns of a fit, of which errors between the kept
    /// samples know nothing.
    pub fn allow_more(&mut self, filtered: &[DMatrix<f64>], combine: &DMatrix<f64>) {
        let before = self.layout.departures;
        let all = before + combine.ncols();
        self.layout.departures = all;
        for (r, filtered) in self.recordings.iter_mut().zip(filtered) {
            let more = filtered * combine;
            let mut rows = vec![0.0; more.nrows() * all];
            for (i, row) in rows.chunks_exact_mut(all.max(1)).enumerate() {
                row[..before].copy_from_slice(&r.departed.1[i * before..(i + 1) * before]);
                for (x, m) in row[before..].iter_mut().zip(more.row(i).iter()) {
                    *x = *m;
                }
            }
            r.departed = Arc::new((r.departed.0.clone(), rows));
        }
    }

    /// Adds what the departures of `beta` change of a torque error.
    fn depart(&self, recording: usize, beta: &[f64], error: &mut Chains) {
        let sizes = &beta[self.layout.linear() - self.layout.departures..];
        for (torque, size) in self.recordings[recording].departed.0.iter().zip(sizes) {
            for (chain, torque) in error.iter_mut().zip(torque) {
                for (e, t) in chain.iter_mut().zip(torque) {
                    *e += size * t;
                }
            }
        }
    }

    /// The fingerprint of `effect` with the values `v` on each actuator alone. Only for effects whose change
    /// stays in its own chain.
    ///
    /// # Errors
    /// Those of [`RobotResidual::fingerprint`].
    pub fn fingerprint_by_actuator(
        &self,
        eta: &[f64],
        beta: &[f64],
        effect: &'static dyn Effect,
        v: &[f64],
    ) -> Result<[Vec<f64>; 3], Locked> {
        let parameters = self.parameters(eta, beta);
        let effects = self.effects(eta);
        let mut other = effects.clone();
        other.push(Acting {
            effect,
            values: v.to_vec(),
            on: [true; 3],
        });
        let mut out = [(); 3].map(|()| Vec::with_capacity(self.rows()));
        for recording in 0..self.recordings.len() {
            let mechanics = self.mechanics_with(recording, &effects)?;
            let offset = self.offset_s(recording, eta);
            let common = self.recordings[recording].common(offset, &effects);
            let change = self.change(
                recording,
                &parameters,
                (&mechanics, &effects, &common),
                (&other, effects.len()),
            )?;
            let filtered = self.filtered(recording, &change);
            let r = &self.recordings[recording];
            for (f, w) in filtered.iter().zip(&*r.whitening) {
                out[0].extend([w[0] * f[0], w[1] * f[0], w[3] * f[0]]);
                out[1].extend([0.0, w[2] * f[1], w[4] * f[1]]);
                out[2].extend([0.0, 0.0, w[5] * f[2]]);
            }
        }
        Ok(out)
    }

    /// The whitened design at the parameters: one row a residual, recording by recording, kept sample by kept
    /// sample, three chains each; columns d r/d eta, B, and the residual last.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn design(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        let (nonlinear, linear) = (self.layout.nonlinear(), self.layout.linear());
        let mut out = DMatrix::zeros(self.rows(), nonlinear + linear + 1);
        let slopes = self.slopes();
        let width = self.width();
        let mut from = 0;
        for recording in 0..self.recordings.len() {
            let columns = self.columns(recording);
            self.for_each_block(recording, eta, beta, |first, rows| {
                for (i, row) in rows.chunks_exact(width).enumerate() {
                    let at = from + 3 * first + i;
                    for (s, slope) in slopes.iter().enumerate() {
                        if let Some(c) = columns[linear + s] {
                            out[(at, slope.nonlinear)] +=
                                slope.linear.map_or(1.0, |b| beta[b]) * row[c];
                        }
                    }
                    for b in 0..linear {
                        out[(at, nonlinear + b)] = row[b];
                    }
                    out[(at, nonlinear + linear)] = row[self.last()];
                }
            })?;
            from += 3 * self.recordings[recording].centres.len();
        }
        Ok(out)
    }

    /// Torque error (needed minus made, N m) of each kept sample and chain of a recording, filtered, not
    /// whitened.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn filtered_torque_error(
        &self,
        recording: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<[f64; 3]>, Locked> {
        let effects = self.effects(eta);
        let mechanics = self.mechanics_with(recording, &effects)?;
        let offset = self.offset_s(recording, eta);
        let parameters = self.parameters(eta, beta);
        let told = self.recordings[recording].told(offset, &effects);
        let mut error = self.torque_error(recording, &mechanics, &parameters, &told, &effects)?;
        self.depart(recording, beta, &mut error);
        Ok(self.filtered(recording, &error))
    }

    /// What each coefficient of a learnt term changes of the whitened residual on each actuator alone, to
    /// first order: rows as in [`RobotResidual::design`]. With them, where it acts on the voltage, by how
    /// much what it adds to the squared voltage grows with that square, were all voltages larger by the same
    /// share (0 where there is none).
    pub fn term_columns(&self, term: &Learnt) -> ([DMatrix<f64>; 3], Option<[DMatrix<f64>; 3]>) {
        let (rows, count) = (self.rows(), term.form.count());
        let mut columns = [(); 3].map(|()| DMatrix::zeros(rows, count));
        let mut slopes = term.electrical().then(|| columns.clone());
        let mut first = 0;
        for r in &self.recordings {
            let commands = [0, 1, 2].map(|k| r.told(r.dataset.offset_s, &[]).chain(k).2.clone());
            let larger = [0, 1, 2].map(|k| {
                let more = commands[k].iter().map(|v| v * (1.0 + STEP));
                more.collect::<Vec<f64>>()
            });
            for k in 0..3 {
                let added = |volts: &[Vec<f64>; 3]| {
                    let told = [0, 1, 2].map(|k| &volts[k][..]);
                    let along = Along {
                        others_v: others(k, told),
                        ..r.mechanics.along(k, r.when)
                    };
                    term.columns(&along, told[k])
                };
                let half = &r.mechanics.chains[k].half_capacitance_slope;
                let own = added(&commands);
                let more = slopes.is_some().then(|| added(&larger));
                for (j, column) in own.iter().enumerate() {
                    for (at, (&c, w)) in r.centres.iter().zip(&*r.whitening).enumerate() {
                        let made = |i: usize| match term.electrical() {
                            true => -half[i] * column[i],
                            false => -column[i],
                        };
                        let f = r.decimation.apply(c, made);
                        let row = first + 3 * at;
                        match k {
                            0 => {
                                columns[0][(row, j)] = w[0] * f;
                                columns[0][(row + 1, j)] = w[1] * f;
                                columns[0][(row + 2, j)] = w[3] * f;
                            }
                            1 => {
                                columns[1][(row + 1, j)] = w[2] * f;
                                columns[1][(row + 2, j)] = w[4] * f;
                            }
                            _ => columns[2][(row + 2, j)] = w[5] * f,
                        }
                        if let (Some(slopes), Some(more)) = (&mut slopes, &more) {
                            let told = commands[k][c];
                            let step = told * told * ((1.0 + STEP).powi(2) - 1.0);
                            if step > 1.0 {
                                slopes[k][(row + k, j)] = (more[j][c] - column[c]) / step;
                            }
                        }
                    }
                }
            }
            first += 3 * r.centres.len();
        }
        (columns, slopes)
    }

    /// Takes kept samples of a recording out of all sums: their residuals count nothing.
    pub fn mute(&mut self, recording: usize, kept: std::ops::Range<usize>) {
        Arc::make_mut(&mut self.recordings[recording].whitening)[kept].fill([0.0; 6]);
    }

    /// Middle frame of each kept sample of a recording.
    pub fn kept(&self, recording: usize) -> &[usize] {
        &self.recordings[recording].centres
    }

    /// Inverse Cholesky factor of the noise covariance at each kept sample of a recording, 1/(N m): 11, 21,
    /// 22, 31, 32, 33.
    pub fn whitening(&self, recording: usize) -> &[[f64; 6]] {
        &self.recordings[recording].whitening
    }

    /// Shows changes of the torque error (N m; replicate, chain, frame) when the motion is drawn from what
    /// the capture leaves open, as the draws of these numbers have it, in their order and several at a time.
    fn replicate_errors(
        &self,
        recording: usize,
        numbers: std::ops::Range<usize>,
        eta: &[f64],
        beta: &[f64],
        mut each: impl FnMut(&[Chains]),
    ) -> Result<(), Locked> {
        let r = &self.recordings[recording];
        let parameters = self.parameters(eta, beta);
        let offset = self.offset_s(recording, eta);
        let effects = self.effects(eta);
        // Kept tracks are read without effects on the motion, and so is then what they differ from.
        let kept = (self.by_place && numbers == (0..self.replicates)).then(|| {
            // one after the other: whoever waits here may hold what another thread waits for
            let all = || {
                numbers
                    .clone()
                    .map(|m| self.draw(recording, m, &[]))
                    .collect()
            };
            r.drawn.get_or_init(all)
        });
        let own = match kept {
            Some(_) => Cow::Borrowed(&*r.mechanics),
            None => self.mechanics_with(recording, &effects)?,
        };
        let told = self.recordings[recording].told(offset, &effects);
        let base = self.torque_error(recording, &own, &parameters, &told, &effects)?;
        let change = |mechanics: Option<&Mechanics>| {
            let Some(mechanics) = mechanics else {
                return Ok(base.clone().map(|v| vec![0.0; v.len()]));
            };
            let mut error =
                self.torque_error(recording, mechanics, &parameters, &told, &effects)?;
            for k in 0..3 {
                for (e, b) in error[k].iter_mut().zip(&base[k]) {
                    *e -= b;
                }
                for (i, _) in mechanics.unreachable.iter().chain(&own.unreachable) {
                    error[k][*i] = 0.0;
                }
            }
            Ok(error)
        };
        let at_once = at_once(r.dataset.samples());
        for from in numbers.clone().step_by(at_once) {
            let errors = (from..(from + at_once).min(numbers.end))
                .into_par_iter()
                .map(|m| match kept {
                    Some(drawn) => change(drawn[m].as_ref()),
                    None => change(self.draw(recording, m, &effects).as_ref()),
                })
                .collect::<Result<Vec<Chains>, _>>()?;
            each(&errors);
        }
        Ok(())
    }

    /// The balance along the track of this number that is drawn from what the capture leaves open.
    fn draw(&self, recording: usize, number: usize, effects: &[Acting]) -> Option<Mechanics> {
        let r = &self.recordings[recording];
        let fresh = || {
            let mut generator = ChaCha12Rng::seed_from_u64(0x0dea_ca11 + number as u64);
            generator.set_stream(recording as u64);
            r.dataset.drawn_track(&mut generator)
        };
        let track = match r.tracks.get(number) {
            Some(kept) => Cow::Borrowed(kept.get_or_init(fresh)),
            None => Cow::Owned(fresh()),
        };
        let all = [&self.base[..], effects].concat();
        let made = Mechanics::with_effects(self.robot, &track, &all, r.dataset.pivot_m, None);
        made.ok().map(|m| r.through(m))
    }

    /// Works with `count` drawn tracks and keeps their mechanics (without effects: what they change of the
    /// noise is of second order), so that setting the weights again is cheap. The size of the noise is then
    /// followed from place to place.
    pub fn keep_drawn(&mut self, count: usize) {
        self.by_place = true;
        self.replicates = count;
        for number in 0..self.recordings.len() {
            let drawn = (0..count)
                .into_par_iter()
                .map(|m| self.draw(number, m, &[]));
            self.recordings[number].drawn = Arc::new(OnceLock::from(drawn.collect::<Vec<_>>()));
        }
    }

    /// Sets the weights to what the noise of capture and voltage makes of the residual at these parameters
    /// (the noise gain depends on the film, so a fit calls this again where it ends). Returns the error of
    /// the predicted voltage that this noise alone makes, recording by recording.
    ///
    /// Replicate tracks are drawn from the smoother's posterior and go through kinematics, film history and
    /// filter; at each kept sample the 3 x 3 covariance is that of the replicates within 0.6 s.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn weigh(&mut self, eta: &[f64], beta: &[f64]) -> Result<(), Locked> {
        for number in 0..self.recordings.len() {
            let mut variance = Variance::default();
            let mut filtered: Vec<Vec<f64>> = Vec::with_capacity(self.replicates);
            self.replicate_errors(number, 0..self.replicates, eta, beta, |errors| {
                variance.add(errors);
                let r = &self.recordings[number];
                filtered.par_extend(errors.par_iter().map(|e| r.filtered(e)));
            })?;
            let offset = self.offset_s(number, eta);
            let r = &mut self.recordings[number];
            r.torque_variance = Arc::new(variance.mean());
            let kept = r.centres.len();
            let energy: f64 = r.decimation.weights.iter().map(|w| w * w).sum();
            let resolution = resolution_v(&r.dataset.voltage);
            let reach = (COVARIANCE_REACH_S / (r.dataset.step_s * r.decimation.every as f64))
                .round() as usize;
            let outer: Vec<Matrix3<f64>> = (0..kept)
                .map(|j| {
                    let mut sum = Matrix3::zeros();
                    for e in &filtered {
                        let e = nalgebra::Vector3::from_column_slice(&e[3 * j..3 * j + 3]);
                        sum += e * e.transpose();
                    }
                    sum / filtered.len() as f64
                })
                .collect();
            // Where many tracks are drawn only to set weights, the noise's size may change faster than its
            // shape: near a pose of little leverage, or near locking.
            let near: Vec<f64> = (0..kept)
                .map(|j| {
                    let window = &outer[j.saturating_sub(NEAR)..(j + NEAR + 1).min(kept)];
                    let mean = window.iter().map(Matrix3::trace).sum::<f64>();
                    mean / window.len() as f64 + f64::MIN_POSITIVE
                })
                .collect();
            let outer: Vec<Matrix3<f64>> = if self.by_place {
                outer.iter().zip(&near).map(|(o, n)| o / *n).collect()
            } else {
                outer
            };
            let mut largest = 0.0_f64;
            let mut whitening = Vec::with_capacity(kept);
            for (j, &centre) in r.centres.iter().enumerate() {
                let window = &outer[j.saturating_sub(reach)..(j + reach + 1).min(kept)];
                let mut covariance: Matrix3<f64> =
                    window.iter().sum::<Matrix3<f64>>() / window.len() as f64;
                if self.by_place {
                    covariance *= near[j];
                }
                for k in 0..3 {
                    let slope = r.mechanics.chains[k].half_capacitance_slope[centre];
                    let phi = r.dataset.command_v(k, centre, offset);
                    let quantum = 2.0 * slope * phi * resolution[k] / 12f64.sqrt();
                    covariance[(k, k)] += quantum * quantum * energy;
                }
                largest = largest.max(covariance.trace());
                // A still chain may have next to no noise: never below a millionth of the largest anywhere.
                for k in 0..3 {
                    covariance[(k, k)] += 1e-6 * largest + 1e-24;
                }
                let l = covariance.cholesky().map_or(Matrix3::identity(), |c| c.l());
                let inverse = l.try_inverse().unwrap_or(Matrix3::identity());
                whitening.push([
                    inverse[(0, 0)],
                    inverse[(1, 0)],
                    inverse[(1, 1)],
                    inverse[(2, 0)],
                    inverse[(2, 1)],
                    inverse[(2, 2)],
                ]);
            }
            r.whitening = Arc::new(whitening);
            let mut white = filtered;
            white.iter_mut().for_each(|errors| r.whiten(errors));
            r.errors = Arc::new(white);
        }
        Ok(())
    }

    /// What each drawn track makes of the whitened residual, row by row as in [`RobotResidual::design`],
    /// after [`RobotResidual::weigh`].
    pub fn noise_rows(&self) -> Vec<Vec<f64>> {
        (0..self.replicates)
            .map(|m| {
                let own = self.recordings.iter().filter_map(|r| r.errors.get(m));
                own.flatten().copied().collect()
            })
            .collect()
    }

    /// As [`RobotResidual::noise_rows`], for `count` further tracks, which the weights know nothing of.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn fresh_noise_rows(
        &self,
        count: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<Vec<Vec<f64>>, Locked> {
        let mut out = vec![Vec::new(); count];
        let numbers = self.replicates..self.replicates + count;
        for (number, r) in self.recordings.iter().enumerate() {
            let mut rows = out.iter_mut();
            self.replicate_errors(number, numbers.clone(), eta, beta, |errors| {
                for (e, rows) in errors.iter().zip(rows.by_ref()) {
                    let mut own = r.filtered(e);
                    r.whiten(&mut own);
                    rows.extend(own);
                }
            })?;
        }
        Ok(out)
    }

    /// Mean square of the whitened residual that the noise alone makes (1 when the weights are right), after
    /// [`RobotResidual::weigh`].
    pub fn noise_mean_square(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for e in self
            .recordings
            .iter()
            .flat_map(|r| r.errors.iter())
            .flatten()
        {
            sum += e * e;
            count += 1.0;
        }
        sum / f64::max(count, 1.0)
    }

    /// Covariance of the scores X'e, where X = [d r/d eta | B] at the parameters and e the noise of the
    /// residual: from the replicates, in blocks longer than the noise's memory. Together with the inverse of
    /// X'X it gives a covariance of the parameters that holds for correlated noise.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn score_covariance(&self, eta: &[f64], beta: &[f64]) -> Result<DMatrix<f64>, Locked> {
        let (nonlinear, linear) = (self.layout.nonlinear(), self.layout.linear());
        let size = nonlinear + linear;
        let slopes = self.slopes();
        let width = self.width();
        let mut covariance = DMatrix::zeros(size, size);
        for (number, r) in self.recordings.iter().enumerate() {
            let columns = self.columns(number);
            let per_block =
                (SCORE_BLOCK_S / (r.dataset.step_s * r.decimation.every as f64)).ceil() as usize;
            let blocks = r.centres.len().div_ceil(per_block);
            let mut scores = vec![DMatrix::<f64>::zeros(size, r.errors.len()); blocks];
            let mut x = vec![0.0; size];
            self.for_each_block(number, eta, beta, |first, rows| {
                for (i, row) in rows.chunks_exact(width).enumerate() {
                    let kept = first + i / 3;
                    x.fill(0.0);
                    for (s, slope) in slopes.iter().enumerate() {
                        if let Some(c) = columns[linear + s] {
                            x[slope.nonlinear] += slope.linear.map_or(1.0, |b| beta[b]) * row[c];
                        }
                    }
                    x[nonlinear..].copy_from_slice(&row[..linear]);
                    let scale = r.robust[kept];
                    for (m, errors) in r.errors.iter().enumerate() {
                        let e = scale * errors[3 * kept + i % 3];
                        let mut column = scores[kept / per_block].column_mut(m);
                        for (s, x) in column.iter_mut().zip(&x) {
                            *s += x * e;
                        }
                    }
                }
            })?;
            for block in &scores {
                covariance += block * block.transpose() / r.errors.len().max(1) as f64;
            }
        }
        Ok(covariance)
    }

    /// What the scores X'r, X = [d r/d eta | B], are on average were the model true; with H^-1 it says how
    /// far the estimates are off.
    ///
    /// With `motions`, those that the model makes of the voltages (m a frame): the mean where each is
    /// captured and smoothed as its recording was. It is zero but for what noise in the columns, smoothing
    /// and interpolation do. Without, or where such a track is out of reach: what noise alone adds, because
    /// columns and residual are made of the same noisy motion (errors in variables). Told from so many
    /// `pairs` of draws of the noise, once plus and once minus, in whose mean all cancels that is linear in
    /// it. `None` where it cannot be told.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn expected_score(
        &self,
        motions: Option<&[Vec<[f64; 3]>]>,
        eta: &[f64],
        beta: &[f64],
        pairs: usize,
    ) -> Result<Option<ExpectedScore>, Locked> {
        if let Some(motions) = motions {
            let retaken = |number: usize, dataset: &Dataset, generator: &mut ChaCha12Rng, times| {
                dataset.retaken_track(&motions[number], generator, times)
            };
            // a film that such a track would lock is told of as little
            if let Ok(Some(score)) = self.drawn_score(eta, beta, pairs, retaken) {
                return Ok(Some(score));
            }
        }
        let noisier = |_, dataset: &Dataset, generator: &mut ChaCha12Rng, times| {
            Some(dataset.noisier_track(generator, times))
        };
        let Some(score) = self.drawn_score(eta, beta, pairs, noisier)? else {
            return Ok(None);
        };
        Ok(Some(ExpectedScore {
            mean: score.mean - self.scores(eta, beta)?,
            simulated: false,
            ..score
        }))
    }

    /// X'r.
    fn scores(&self, eta: &[f64], beta: &[f64]) -> Result<DVector<f64>, Locked> {
        let size = eta.len() + beta.len();
        let gram = self.evaluate(eta, beta)?.at(eta.len(), beta);
        Ok(gram.column(size).rows(0, size).into_owned())
    }

    /// The scores of pairs of other tracks.
    fn drawn_score(
        &self,
        eta: &[f64],
        beta: &[f64],
        pairs: usize,
        track: impl Fn(usize, &Dataset, &mut ChaCha12Rng, f64) -> Option<Track> + Sync,
    ) -> Result<Option<ExpectedScore>, Locked> {
        let drawn = self.drawn(eta, beta, pairs, track, |other| other.scores(eta, beta))?;
        Ok(drawn.map(|drawn| ExpectedScore {
            mean: drawn.iter().sum::<DVector<f64>>() / drawn.len() as f64,
            draws: (drawn.chunks_exact(2))
                .map(|pair| (&pair[0] - &pair[1]) / 2.0)
                .collect(),
            simulated: true,
        }))
    }

    /// The whitened residual that is left on average where `motions`, which the model makes of the voltages
    /// (m a frame), are captured and smoothed as the recordings were: smoothing rounds what is sharp, and
    /// noise in the columns pulls. From as many `pairs` of draws as in [`RobotResidual::expected_score`];
    /// `None` where such a track is out of reach.
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn expected_residual(
        &self,
        motions: &[Vec<[f64; 3]>],
        eta: &[f64],
        beta: &[f64],
        pairs: usize,
    ) -> Result<Option<DVector<f64>>, Locked> {
        let retaken = |number: usize, dataset: &Dataset, generator: &mut ChaCha12Rng, times| {
            dataset.retaken_track(&motions[number], generator, times)
        };
        let mut whole = self.clone();
        whole.take_out(None);
        let drawn = whole.drawn(eta, beta, pairs, retaken, |other| {
            let design = other.design(eta, beta)?;
            Ok(design.column(design.ncols() - 1).into_owned())
        })?;
        Ok(drawn.map(|d| d.iter().sum::<DVector<f64>>() / d.len() as f64))
    }

    /// Takes what capture and smoothing make of a right model ([`RobotResidual::expected_residual`], under
    /// the present weights) out of all residuals from now on; nothing where it is `None`.
    pub fn take_out(&mut self, expected: Option<&DVector<f64>>) {
        let mut first = 0;
        for r in &mut self.recordings {
            let end = first + 3 * r.centres.len();
            r.smoothed = Arc::new(expected.map_or_else(Vec::new, |all| {
                let whitened = all.as_slice()[first..end].chunks_exact(3);
                (whitened.zip(&*r.whitening))
                    .map(|(e, w)| {
                        // W lower triangular
                        let a = e[0] / w[0];
                        let b = (e[1] - w[1] * a) / w[2];
                        [a, b, (e[2] - w[3] * a - w[4] * b) / w[5]]
                    })
                    .collect()
            }));
            first = end;
        }
    }

    /// What `of` says of this residual with other tracks, in pairs of draws of the noise.
    fn drawn<T: Send>(
        &self,
        eta: &[f64],
        beta: &[f64],
        pairs: usize,
        track: impl Fn(usize, &Dataset, &mut ChaCha12Rng, f64) -> Option<Track> + Sync,
        of: impl Fn(&Self) -> Result<T, Locked> + Sync,
    ) -> Result<Option<Vec<T>>, Locked> {
        let at_once = at_once(self.datasets().map(Dataset::samples).sum());
        let one = |m: usize| {
            let mut other = self.clone();
            other.base.clear(); // simulated robots are as drawn
            let times = if m.is_multiple_of(2) { 1.0 } else { -1.0 };
            for (number, r) in other.recordings.iter_mut().enumerate() {
                let mut generator = ChaCha12Rng::seed_from_u64(0x0dea_c011 + m as u64 / 2);
                generator.set_stream(number as u64);
                let Some(track) = track(number, r.dataset, &mut generator, times) else {
                    return Ok(None);
                };
                let Ok(mechanics) = Mechanics::new(self.robot, &track) else {
                    return Ok(None);
                };
                let mechanics = r.through(mechanics);
                let (curve, d) = (&self.forearm, &r.decimation);
                r.load = Arc::new(filtered_load(&mechanics, d, &r.centres));
                let columns = forearm_columns(&mechanics, curve, d, &r.centres, self.arch);
                r.forearm = Arc::new(columns);
                r.mechanics = Arc::new(mechanics);
                r.other_track = Some(Arc::new(track));
                if r.maxwell.is_some() {
                    r.maxwell = Some(Arc::new(r.fixed_maxwell()));
                }
            }
            other.linearise(eta, beta, true)?;
            of(&other).map(Some)
        };
        let mut out = Some(Vec::with_capacity(2 * pairs));
        for from in (0..2 * pairs).step_by(at_once) {
            let some = (from..(from + at_once).min(2 * pairs))
                .into_par_iter()
                .map(one)
                .collect::<Result<Option<Vec<T>>, Locked>>()?;
            match (&mut out, some) {
                (Some(all), Some(some)) => all.extend(some),
                _ => return Ok(None),
            }
        }
        Ok(out)
    }

    /// Predicted against commanded voltage at every frame of a recording, and what the capture noise does to
    /// it (as it was last worked out by [`RobotResidual::weigh`], or now where it was not).
    ///
    /// # Errors
    /// [`Locked`] when the film is past its locking stretch.
    pub fn voltage_error(
        &self,
        recording: usize,
        eta: &[f64],
        beta: &[f64],
    ) -> Result<VoltageError, Locked> {
        let r = &self.recordings[recording];
        let parameters = self.parameters(eta, beta);
        let offset = self.offset_s(recording, eta);
        let fresh;
        let torque_variance = if r.torque_variance.is_empty() {
            let mut variance = Variance::default();
            self.replicate_errors(recording, 0..self.replicates, eta, beta, |errors| {
                variance.add(errors);
            })?;
            fresh = variance.mean();
            &fresh
        } else {
            &*r.torque_variance
        };
        let effects = self.effects(eta);
        let mechanics = self.mechanics_with(recording, &effects)?;
        let told = r.told(offset, &effects);
        // One path with and without effects, so that an effect that is off changes no bit.
        let film = ChainTorques::new(&mechanics, &parameters)?;
        let (mut needed, _) =
            self.sides(recording, &mechanics, &film, &parameters, &told, &effects)?;
        self.depart(recording, beta, &mut needed);
        let half = [0, 1, 2].map(|k| mechanics.half_capacitance_slope(k, r.when, &effects));
        let film_v = [0, 1, 2].map(|k| r.film_voltage(&mechanics, k, &told, &effects));
        let mut predicted: Vec<[f64; 3]> = (0..mechanics.samples())
            .map(|i| [0, 1, 2].map(|k| needed[k][i] / half[k][i]))
            .collect();
        let n = r.dataset.samples();
        let edge = (EDGE_S / r.dataset.step_s).round() as usize;
        let mut reached = vec![true; n];
        for (i, _) in &mechanics.unreachable {
            reached[*i] = false;
            predicted[*i] = [f64::NAN; 3];
        }
        let mut out = VoltageError {
            predicted_squared_v2: predicted,
            command_v: Vec::with_capacity(n),
            sd_v: Vec::with_capacity(n),
            counts: (0..n)
                .map(|i| {
                    reached[i]
                        && r.dataset.captured(i)
                        && !r.dataset.film_unknown[i]
                        && i >= edge
                        && i + edge < n
                        && r.dataset.has_voltage(i, offset)
                })
                .collect(),
        };
        for i in 0..n {
            out.command_v.push([0, 1, 2].map(|k| film_v[k][i].abs()));
            out.sd_v.push([0, 1, 2].map(|k| {
                let slope = half[k][i];
                let squared = out.predicted_squared_v2[i][k];
                let spread = torque_variance[i][k].sqrt() / slope.abs();
                0.5 * (root_v(squared + spread) - root_v(squared - spread))
            }));
        }
        Ok(out)
    }
}

impl SeparableResidual for RobotResidual<'_> {
    type Error = Locked;

    fn evaluate(&self, eta: &[f64], reference: &[f64]) -> Result<Normal, Locked> {
        let slopes = self.slopes();
        let linear = self.layout.linear();
        let size = linear + slopes.len() + 1;
        let width = self.width();
        let grams: Vec<Vec<f64>> = if self.recordings.len() == 1 {
            vec![self.gram(0, eta, reference)?]
        } else {
            (0..self.recordings.len())
                .into_par_iter()
                .map(|r| self.gram(r, eta, reference))
                .collect::<Result<_, _>>()?
        };
        let mut gram = DMatrix::zeros(size, size);
        for (number, own) in grams.iter().enumerate() {
            let columns = self.columns(number);
            for i in 0..size {
                for j in 0..=i {
                    if let (Some(a), Some(b)) = (columns[i], columns[j]) {
                        let value = own[a.max(b) * width + a.min(b)];
                        gram[(i, j)] += value;
                        if i != j {
                            gram[(j, i)] += value;
                        }
                    }
                }
            }
        }
        Ok(Normal {
            gram,
            slopes,
            reference: reference.to_vec(),
            rows: self.rows(),
        })
    }
}

/// Tracks of so many frames that are worked on at a time.
fn at_once(frames: usize) -> usize {
    (FRAMES_AT_ONCE / frames.max(1)).max(1)
}

/// Mean square of the replicates at each frame and chain.
#[derive(Default)]
struct Variance {
    squares: Vec<[f64; 3]>,
    count: usize,
}

impl Variance {
    fn add(&mut self, errors: &[Chains]) {
        for e in errors {
            self.squares.resize(e[0].len(), [0.0; 3]);
            self.count += 1;
            for (i, sum) in self.squares.iter_mut().enumerate() {
                for k in 0..3 {
                    sum[k] += e[k][i] * e[k][i];
                }
            }
        }
    }

    fn mean(mut self) -> Vec<[f64; 3]> {
        for sum in &mut self.squares {
            *sum = sum.map(|s| s / self.count as f64);
        }
        self.squares
    }
}

/// Finest step between values of each channel, V: the resolution of the recorded voltage.
fn resolution_v(voltage: &crate::dataset::Voltage) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let mut values: Vec<f64> = voltage.channels_v()[k].iter().copied().step_by(7).collect();
        values.sort_by(f64::total_cmp);
        values
            .windows(2)
            .map(|w| w[1] - w[0])
            .filter(|d| *d > 1e-9)
            .fold(f64::INFINITY, f64::min)
            .min(100.0)
    })
}

/// Half-amplitude frequency of the residual's low-pass that a dataset asks for, Hz.
fn band_hz(dataset: &Dataset) -> f64 {
    let known = dataset.axes.iter().map(|a| a.choice.cutoff_hz);
    match dataset.offset_source {
        OffsetSource::Free => BAND_PER_CUTOFF * known.fold(0.0, f64::max),
        OffsetSource::Stated | OffsetSource::Measured => 0.0,
    }
}

/// Frames of a period of the residual's low-pass that tell it as well as more do.
const FRAMES_A_PERIOD: f64 = 8.0;

/// Every how many-th frame of a dataset suffices for its residual, which lies below its low-pass.
pub fn frames_apart(dataset: &Dataset) -> usize {
    let least_hz = FRAMES_A_PERIOD * Decimation::cutoff_hz(dataset.step_s, band_hz(dataset));
    (1.0 / (least_hz * dataset.step_s)).max(1.0) as usize
}

fn prepare<'a>(
    dataset: &'a Dataset,
    when: When,
    mechanics: Mechanics,
    ways: Vec<(usize, [Way; 3])>,
    forearm: &ForearmTorque,
) -> Prepared<'a> {
    let free = dataset.offset_source == OffsetSource::Free;
    let band_hz = band_hz(dataset);
    let decimation = Decimation::new(dataset.step_s, band_hz, dataset.samples());
    let margin = if free { OFFSET_REACH_S } else { 0.0 };
    let mut usable = dataset.usable.clone();
    for (i, usable) in usable.iter_mut().enumerate() {
        let known = |shift: f64| dataset.has_voltage(i, dataset.offset_s + shift);
        *usable = *usable && !dataset.film_unknown[i] && known(margin) && known(-margin);
    }
    for (i, _) in &mechanics.unreachable {
        usable[*i] = false;
    }
    let centres = decimation.centres(&usable);
    let load = filtered_load(&mechanics, &decimation, &centres);
    let columns = forearm_columns(&mechanics, forearm, &decimation, &centres, Arch::new());
    let kept = centres.len();
    let mut prepared = Prepared {
        dataset,
        when,
        mechanics: Arc::new(mechanics),
        ways: Arc::new(ways),
        other_track: None,
        decimation: Arc::new(decimation),
        centres: Arc::new(centres),
        command: None,
        tracks: Arc::default(),
        drawn: Arc::default(),
        linear: None,
        load: Arc::new(load),
        forearm: Arc::new(columns),
        maxwell: None,
        whitening: Arc::new(vec![[1e4, 0.0, 1e4, 0.0, 0.0, 1e4]; kept]),
        robust: Arc::new(vec![1.0; kept]),
        errors: Arc::default(),
        smoothed: Arc::default(),
        departed: Arc::default(),
        torque_variance: Arc::default(),
    };
    if !free {
        let command = [0, 1, 2].map(|k| {
            prepared
                .command(k, dataset.offset_s, (0.0, 1.0))
                .into_owned()
        });
        prepared.command = Some(Arc::new(command));
        prepared.maxwell = Some(Arc::new(prepared.fixed_maxwell()));
    }
    prepared
}

/// Filtered load of each kept sample and chain, N m.
fn filtered_load(mechanics: &Mechanics, decimation: &Decimation, centres: &[usize]) -> Triples {
    let load = [0, 1, 2].map(|k| {
        let chain = &mechanics.chains[k];
        (0..mechanics.samples())
            .map(|i| chain.load(i))
            .collect::<Vec<f64>>()
    });
    filtered(decimation, centres, &load)
}

/// Filtered forearm columns (kept sample, chain, node): lever of chain j on lozenge k times the spline's
/// basis at theta_FA_j.
fn forearm_columns(
    mechanics: &Mechanics,
    forearm: &ForearmTorque,
    decimation: &Decimation,
    centres: &[usize],
    arch: Arch,
) -> Vec<f64> {
    let nodes = forearm.nodes_rad().len();
    let width = (3 * nodes).next_multiple_of(STRIP);
    let n = mechanics.samples();
    let mut basis = vec![0.0; nodes];
    let mut rows = vec![0.0; n * width];
    for (i, row) in rows.chunks_exact_mut(width).enumerate() {
        for j in 0..3 {
            forearm.basis(mechanics.chains[j].theta_fa_rad[i], &mut basis);
            for k in 0..3 {
                let lever = mechanics.chains[k].forearm_lever[i][j];
                for (o, b) in row[k * nodes..(k + 1) * nodes].iter_mut().zip(&basis) {
                    *o += lever * b;
                }
            }
        }
    }
    let first: Vec<usize> = centres.iter().map(|c| c - decimation.half).collect();
    let mut filtered = vec![0.0; centres.len() * width];
    filter_rows(
        arch,
        &decimation.weights,
        &rows,
        width,
        &first,
        &mut filtered,
    );
    filtered
        .chunks_exact(width)
        .flat_map(|row| row[..3 * nodes].iter().copied())
        .collect()
}
