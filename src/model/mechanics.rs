//! Everything of the balance that does not depend on the calibrated parameters, along one track: the stretch
//! history of each film, the Maxwell torque per squared voltage, the torques that weights and inertia ask
//! for, and the levers of the forearms.

use std::ops::Deref;
use std::sync::Arc;

use super::{ForearmTorque, Parameters, Robot};
use crate::dataset::Track;
use crate::film::Locked;
use crate::film::kernel::{History, LANES, Pass, ROW, Shape, Way};
use crate::kinematics::{ChainPose, OutOfReach, Vec3, dot};
use crate::units::{GRAVITY_M_S2, VACUUM_PERMITTIVITY_F_M};

/// A sample that the mechanism cannot follow, or at which the balance cannot be split into chains.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unreachable {
    /// No angles exist for this pose.
    #[error("{0}")]
    Pose(OutOfReach),
    /// G has (nearly) lost rank: the actuators hold no force in one direction and phi^2 has no meaning.
    #[error(
        "the actuators hold no force in one direction here: the levers d theta_DEA/du have condition number {condition:.3e} (limit {limit:.0e})"
    )]
    Singular {
        /// Condition number of G.
        condition: f64,
        /// What is still accepted.
        limit: f64,
    },
}

/// Largest condition number of G at which the balance is still split into chains.
const CONDITION_LIMIT: f64 = 1e3;

/// One named part of the torque on a lozenge that the Maxwell torque has to balance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contribution {
    /// The equilibrium spring of the film.
    FilmEquilibrium,
    /// The viscoelastic branches of the film.
    FilmBranches,
    /// Spring-back of the forearms.
    Forearm,
    /// Weight of the end effector.
    Weight,
    /// Weight of the payload.
    Payload,
    /// Inertia of end effector and payload.
    Inertia,
    /// Weight and inertia of the bicep tips.
    Bicep,
}

impl Contribution {
    /// All of them, in the order in which they are shown.
    pub const ALL: [Contribution; 7] = [
        Contribution::FilmEquilibrium,
        Contribution::FilmBranches,
        Contribution::Forearm,
        Contribution::Weight,
        Contribution::Payload,
        Contribution::Inertia,
        Contribution::Bicep,
    ];

    /// The name that a reader sees.
    pub fn name(self) -> &'static str {
        match self {
            Contribution::FilmEquilibrium => "film, equilibrium spring",
            Contribution::FilmBranches => "film, viscoelastic branches",
            Contribution::Forearm => "forearm spring-back",
            Contribution::Weight => "weight of the end effector",
            Contribution::Payload => "weight of the payload",
            Contribution::Inertia => "inertia of end effector and payload",
            Contribution::Bicep => "bicep tips, weight and inertia",
        }
    }
}

/// What one chain does along a track by itself, sample by sample.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainMotion {
    /// Stretch history of the film; its levers turn stress over modulus into torque on theta_DEA, m^3.
    pub history: History,
    /// 1/2 dC/d theta_DEA, N m/V^2.
    pub half_capacitance_slope: Vec<f64>,
    /// lambda_1 lambda_2.
    pub area_stretch: Vec<f64>,
    /// Lozenge angle, rad.
    pub theta_dea_rad: Vec<f64>,
    /// Forearm swing, rad.
    pub theta_fa_rad: Vec<f64>,
    /// theta_b with its first and second time derivative, rad, rad/s, rad/s^2.
    pub theta_b: Vec<[f64; 3]>,
    /// d theta_DEA/d theta_b.
    pub bicep_lever: Vec<f64>,
    /// Column of G: d theta_DEA/du, rad/m.
    pub lever: Vec<Vec3>,
    /// d theta_FA/du, rad/m.
    pub forearm_slope: Vec<Vec3>,
    /// Torque on the lozenge from the bicep's tip, N m.
    pub bicep_n_m: Vec<f64>,
}

impl ChainMotion {
    /// Chain `k` of a robot along a track; `None` where a pose is out of reach.
    fn followed(robot: &Robot, track: &Track, k: usize) -> Option<Self> {
        let mechanism = robot.mechanism.fixed();
        let mut growing = Growing::with_room(track.position_m.len());
        for (i, &u) in track.position_m.iter().enumerate() {
            let pose = mechanism.chain_pose(k, u).ok()?;
            let (v, a) = (track.velocity_m_s[i], track.acceleration_m_s2[i]);
            growing.push(robot, k, &pose, v, a, true);
        }
        Some(growing.done(track))
    }
}

/// What one chain contributes, sample by sample: its own motion, and what the other two chains have a part
/// in.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainTrack {
    /// Its own motion, shared with balances in which only other chains differ.
    pub own: Arc<ChainMotion>,
    /// Torque on the lozenge from [weight, payload, inertia, bicep], N m.
    pub load_n_m: Vec<[f64; 4]>,
    /// Torque on this lozenge per forearm torque of chains 1 to 3: (G^-1 d theta_FA_j/du)_k.
    pub forearm_lever: Vec<[f64; 3]>,
    /// Torque on this lozenge per force on the end effector: (G^-1)_k, zero out of reach.
    pub force_lever: Vec<Vec3>,
}

impl Deref for ChainTrack {
    type Target = ChainMotion;

    fn deref(&self) -> &ChainMotion {
        &self.own
    }
}

impl ChainTrack {
    /// All loads together, N m, at a sample.
    pub fn load(&self, sample: usize) -> f64 {
        self.load_n_m[sample].iter().sum()
    }
}

/// The balance along one track, chain by chain.
#[derive(Debug, Clone, PartialEq)]
pub struct Mechanics {
    /// The motion, effects included.
    pub track: Arc<Track>,
    /// The three chains.
    pub chains: [ChainTrack; 3],
    /// Samples that cannot be followed, and why. Their stretches are bridged so that the histories go on.
    pub unreachable: Vec<(usize, Unreachable)>,
    /// Mechanism and lozenges of this track, effects included.
    pub robot: Robot,
    gravity_and_inertia_n: Vec<Vec3>,
}

/// [`ChainMotion`] as it is worked out.
#[derive(Default)]
struct Growing {
    stretch: Vec<[f64; 2]>,
    rate: Vec<[f64; 2]>,
    lever: Vec<[f64; 2]>,
    half_capacitance_slope: Vec<f64>,
    area_stretch: Vec<f64>,
    theta_dea_rad: Vec<f64>,
    theta_fa_rad: Vec<f64>,
    theta_b: Vec<[f64; 3]>,
    bicep_lever: Vec<f64>,
    angle_lever: Vec<Vec3>,
    forearm_slope: Vec<Vec3>,
    bicep_n_m: Vec<f64>,
}

impl Growing {
    fn with_room(n: usize) -> Self {
        Growing {
            stretch: Vec::with_capacity(n),
            rate: Vec::with_capacity(n),
            lever: Vec::with_capacity(n),
            half_capacitance_slope: Vec::with_capacity(n),
            area_stretch: Vec::with_capacity(n),
            theta_dea_rad: Vec::with_capacity(n),
            theta_fa_rad: Vec::with_capacity(n),
            theta_b: Vec::with_capacity(n),
            bicep_lever: Vec::with_capacity(n),
            angle_lever: Vec::with_capacity(n),
            forearm_slope: Vec::with_capacity(n),
            bicep_n_m: Vec::with_capacity(n),
        }
    }

    /// The next sample of chain `k`; the film stands where the pose was not reached.
    fn push(&mut self, robot: &Robot, k: usize, p: &ChainPose, v: Vec3, a: Vec3, reached: bool) {
        let lozenge = &robot.lozenges[k];
        let (stretch, slopes, capacitance) = lozenge.at(p.half_dea());
        let rate = match reached {
            true => dot(p.dtheta_dea_du, v),
            false => 0.0,
        };
        self.stretch.push(stretch);
        self.rate.push(slopes.map(|s| s * rate));
        self.lever.push(slopes.map(|s| s * lozenge.volume_m3()));
        let eps = robot.eps_r * VACUUM_PERMITTIVITY_F_M;
        self.half_capacitance_slope
            .push(eps * capacitance * (slopes[0] + slopes[1]));
        self.area_stretch.push(stretch[0] * stretch[1]);
        self.theta_dea_rad.push(p.theta_dea_rad);
        self.theta_fa_rad.push(p.theta_fa_rad);
        let chain = &robot.mechanism.chains[k];
        let (bicep_rate, acceleration) = chain.bicep_rates(p, v, a);
        self.theta_b.push([p.theta_b_rad, bicep_rate, acceleration]);
        self.bicep_lever.push(p.dtheta_dea_dtheta_b);
        self.angle_lever.push(p.dtheta_dea_du);
        self.forearm_slope.push(p.dtheta_fa_du);
        let q = chain.bicep_m;
        let bicep =
            robot.bicep_tip_kg * (q * q * acceleration - GRAVITY_M_S2 * q * p.sine_theta_b());
        self.bicep_n_m.push(bicep / p.dtheta_dea_dtheta_b);
    }

    fn done(self, track: &Track) -> ChainMotion {
        let history = History::sampled(
            track.initial,
            track.step_s,
            &self.stretch,
            &self.rate,
            &self.lever,
        );
        ChainMotion {
            history,
            half_capacitance_slope: self.half_capacitance_slope,
            area_stretch: self.area_stretch,
            theta_dea_rad: self.theta_dea_rad,
            theta_fa_rad: self.theta_fa_rad,
            theta_b: self.theta_b,
            bicep_lever: self.bicep_lever,
            lever: self.angle_lever,
            forearm_slope: self.forearm_slope,
            bicep_n_m: self.bicep_n_m,
        }
    }
}

/// Inverse of the 3 x 3 matrix with the given columns (rows of the result belong to the columns), and its
/// condition number in the Frobenius norm.
fn invert(g: &[Vec3; 3]) -> ([Vec3; 3], f64) {
    let cross = |a: Vec3, b: Vec3| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let rows = [cross(g[1], g[2]), cross(g[2], g[0]), cross(g[0], g[1])];
    let determinant = dot(g[0], rows[0]);
    let norm = |m: &[Vec3; 3]| m.iter().map(|r| dot(*r, *r)).sum::<f64>().sqrt();
    let inverse = rows.map(|r| r.map(|v| v / determinant));
    let condition = norm(g) * norm(&inverse);
    (
        inverse,
        if condition.is_nan() {
            f64::INFINITY
        } else {
            condition
        },
    )
}

impl Mechanics {
    /// Works out the balance of `robot` along `track`.
    ///
    /// Samples out of reach are listed in [`Mechanics::unreachable`]; their angles are held from the last
    /// good sample (from the first good one at the beginning) and their loads are zero.
    ///
    /// # Errors
    /// The first unreachable sample, when no sample at all can be followed.
    pub fn new(robot: &Robot, track: &Track) -> Result<Self, (usize, Unreachable)> {
        Mechanics::of(robot.clone(), Arc::new(track.clone()))
    }

    /// The same.
    pub(super) fn of(robot: Robot, track: Arc<Track>) -> Result<Self, (usize, Unreachable)> {
        match [0, 1, 2].map(|k| ChainMotion::followed(&robot, &track, k).map(Arc::new)) {
            [Some(a), Some(b), Some(c)] => {
                Ok(Mechanics::joined(robot, track, [a, b, c], Vec::new()))
            }
            _ => Mechanics::bridged(robot, track),
        }
    }

    /// The same where some samples may be out of reach.
    fn bridged(robot: Robot, track: Arc<Track>) -> Result<Self, (usize, Unreachable)> {
        let n = track.position_m.len();
        let mut unreachable = Vec::new();
        let mechanism = robot.mechanism.fixed();
        // Until the first sample that can be followed, its pose is held.
        let reachable = track.position_m.iter().map(|&u| mechanism.pose(u));
        let mut last = match reachable.clone().find_map(Result::ok) {
            Some(pose) => pose,
            None => {
                let why = reachable.clone().find_map(Result::err);
                let singular = Unreachable::Singular {
                    condition: f64::INFINITY,
                    limit: CONDITION_LIMIT,
                };
                return Err((0, why.map_or(singular, Unreachable::Pose)));
            }
        };
        let mut growing = [(); 3].map(|()| Growing::with_room(n));
        for (i, pose) in reachable.enumerate() {
            let reached = pose.is_ok();
            last = pose.unwrap_or_else(|error| {
                unreachable.push((i, Unreachable::Pose(error)));
                last
            });
            let (v, a) = (track.velocity_m_s[i], track.acceleration_m_s2[i]);
            for (k, growing) in growing.iter_mut().enumerate() {
                growing.push(&robot, k, &last[k], v, a, reached);
            }
        }
        let own = growing.map(|g| Arc::new(g.done(&track)));
        Ok(Mechanics::joined(robot, track, own, unreachable))
    }

    /// The same where a balance along this track is known, of a robot or of a reading of the motion that may
    /// differ: chains that move as they do there are shared with it, to the bit.
    ///
    /// # Errors
    /// Those of [`Mechanics::new`].
    pub(super) fn beside(
        robot: Robot,
        track: Arc<Track>,
        known: &Mechanics,
    ) -> Result<Self, (usize, Unreachable)> {
        let (theirs, their_track) = (&known.robot, &*known.track);
        let masses = |r: &Robot| (r.eps_r, r.effector_kg, r.bicep_tip_kg);
        let same_track = || {
            track.position_m == their_track.position_m
                && track.velocity_m_s == their_track.velocity_m_s
                && track.acceleration_m_s2 == their_track.acceleration_m_s2
        };
        let same_motion = masses(&robot) == masses(theirs)
            && known.unreachable.is_empty()
            && (Arc::ptr_eq(&track, &known.track) || same_track());
        let same = [0, 1, 2].map(|k| {
            same_motion
                && robot.mechanism.chains[k] == theirs.mechanism.chains[k]
                && robot.lozenges[k] == theirs.lozenges[k]
        });
        if same == [false; 3] {
            return Mechanics::of(robot, track);
        }
        let chain = |k: usize| match same[k] {
            true => Some(known.chains[k].own.clone()),
            false => ChainMotion::followed(&robot, &track, k).map(Arc::new),
        };
        match [chain(0), chain(1), chain(2)] {
            [Some(a), Some(b), Some(c)] => {
                Ok(Mechanics::joined(robot, track, [a, b, c], Vec::new()))
            }
            _ => Mechanics::bridged(robot, track),
        }
    }

    /// The balance of chains that move like this; `unreachable` are poses without angles.
    fn joined(
        robot: Robot,
        track: Arc<Track>,
        own: [Arc<ChainMotion>; 3],
        mut unreachable: Vec<(usize, Unreachable)>,
    ) -> Self {
        let n = track.position_m.len();
        let mut load: [Vec<[f64; 4]>; 3] = [(); 3].map(|()| Vec::with_capacity(n));
        let mut forearm_lever: [Vec<[f64; 3]>; 3] = [(); 3].map(|()| Vec::with_capacity(n));
        let mut force_lever: [Vec<Vec3>; 3] = [(); 3].map(|()| Vec::with_capacity(n));
        let mut gravity_and_inertia_n = Vec::with_capacity(n);
        let out_of_reach: Vec<usize> = unreachable.iter().map(|u| u.0).collect();
        let mut held = out_of_reach.iter().copied().peekable();
        for i in 0..n {
            let reached = held.next_if_eq(&i).is_none();
            let a = track.acceleration_m_s2[i];
            let (inverse, condition) = invert(&[0, 1, 2].map(|k| own[k].lever[i]));
            let usable = reached && condition < CONDITION_LIMIT;
            if reached && !usable {
                let limit = CONDITION_LIMIT;
                unreachable.push((i, Unreachable::Singular { condition, limit }));
            }
            let mass = robot.effector_kg + track.payload_kg[i];
            for k in 0..3 {
                force_lever[k].push(if usable { inverse[k] } else { [0.0; 3] });
                if usable {
                    load[k].push([
                        inverse[k][2] * robot.effector_kg * GRAVITY_M_S2,
                        inverse[k][2] * track.payload_kg[i] * GRAVITY_M_S2,
                        mass * dot(inverse[k], a),
                        own[k].bicep_n_m[i],
                    ]);
                    forearm_lever[k]
                        .push([0, 1, 2].map(|j| dot(inverse[k], own[j].forearm_slope[i])));
                } else {
                    load[k].push([0.0; 4]);
                    forearm_lever[k].push([0.0; 3]);
                }
            }
            gravity_and_inertia_n.push([mass * a[0], mass * a[1], mass * (a[2] + GRAVITY_M_S2)]);
        }
        unreachable.sort_by_key(|u| u.0);
        let mut k = 0;
        let chains = own.map(|own| {
            let chain = ChainTrack {
                own,
                load_n_m: std::mem::take(&mut load[k]),
                forearm_lever: std::mem::take(&mut forearm_lever[k]),
                force_lever: std::mem::take(&mut force_lever[k]),
            };
            k += 1;
            chain
        });
        Mechanics {
            track,
            chains,
            unreachable,
            robot,
            gravity_and_inertia_n,
        }
    }

    /// The ways of the three films while the effector moves from one sample to a later one: its positions and
    /// velocities (m, m/s) at both and at all `step_s` in between. A pose out of reach is held from the one
    /// before.
    ///
    /// # Errors
    /// Why, when no pose can be taken.
    ///
    /// # Panics
    /// With fewer than two samples.
    pub fn ways(
        robot: &Robot,
        step_s: f64,
        position_m: &[Vec3],
        velocity_m_s: &[Vec3],
    ) -> Result<[Way; 3], Unreachable> {
        let mechanism = robot.mechanism.fixed();
        let poses = || position_m.iter().map(|&u| mechanism.pose(u));
        let mut last = match poses().find_map(Result::ok) {
            Some(pose) => pose,
            None => {
                return Err(Unreachable::Pose(
                    poses().find_map(Result::err).expect("a pose"),
                ));
            }
        };
        let mut stretch: [Vec<[f64; 2]>; 3] = Default::default();
        let mut rate: [Vec<[f64; 2]>; 3] = Default::default();
        for (pose, v) in poses().zip(velocity_m_s) {
            let reached = pose.is_ok();
            last = pose.unwrap_or(last);
            for k in 0..3 {
                let p = &last[k];
                let (at, slopes, _) = robot.lozenges[k].at(p.half_dea());
                let theta_rate = if reached {
                    dot(p.dtheta_dea_du, *v)
                } else {
                    0.0
                };
                stretch[k].push(at);
                rate[k].push(slopes.map(|s| s * theta_rate));
            }
        }
        Ok([0, 1, 2].map(|k| Way::over(step_s, &stretch[k], &rate[k])))
    }

    /// Lets the films come to some samples over ways between (see [`Mechanics::ways`]), in rising order of
    /// the samples.
    pub fn pass_over(&mut self, ways: &[(usize, [Way; 3])]) {
        if ways.is_empty() {
            return;
        }
        for (k, chain) in self.chains.iter_mut().enumerate() {
            let own: Vec<(usize, Way)> = ways.iter().map(|(i, w)| (*i, w[k].clone())).collect();
            Arc::make_mut(&mut chain.own).history.pass_over(&own);
        }
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.track.position_m.len()
    }

    /// Torque of the film on the lozenge of chain `k` (0 to 2) at each sample, N m: [equilibrium spring, all
    /// branches].
    ///
    /// # Errors
    /// [`Locked`] when a spring reaches its locking stretch.
    pub fn film_torque_n_m(
        &self,
        k: usize,
        parameters: &Parameters,
    ) -> Result<Vec<[f64; 2]>, Locked> {
        let mut out = Vec::with_capacity(self.samples());
        self.for_each_spring(k, parameters, |springs| {
            out.push([springs[0], springs[1..].iter().sum()]);
        })?;
        Ok(out)
    }

    /// Torque of each spring of the film on the lozenge of chain `k` (0 to 2) at each sample, N m: the
    /// equilibrium spring first.
    ///
    /// # Errors
    /// [`Locked`] when a spring reaches its locking stretch.
    pub fn spring_torques_n_m(
        &self,
        k: usize,
        parameters: &Parameters,
    ) -> Result<Vec<Vec<f64>>, Locked> {
        let mut out = Vec::with_capacity(self.samples());
        self.for_each_spring(k, parameters, |springs| out.push(springs.to_vec()))?;
        Ok(out)
    }

    /// Shows the torques of the springs, sample by sample.
    fn for_each_spring(
        &self,
        k: usize,
        parameters: &Parameters,
        mut each: impl FnMut(&[f64]),
    ) -> Result<(), Locked> {
        let film = &parameters.film;
        let shape = Shape {
            relaxation_time_s: &film.relaxation_time_s,
            locking: film.locking,
        };
        let mut pass = Pass::of_stress(&self.chains[k].history, shape);
        let width = pass.row_width();
        let mut rows = vec![0.0; 128 * width];
        let mut springs = vec![0.0; film.mu_pa.len()];
        loop {
            let count = pass.next_block(&mut rows)?;
            if count == 0 {
                return Ok(());
            }
            for row in rows[..count * width].chunks(width) {
                for (n, (spring, mu)) in springs.iter_mut().zip(&film.mu_pa).enumerate() {
                    *spring = row[n / LANES * ROW + n % LANES] * mu;
                }
                each(&springs);
            }
        }
    }

    /// Torque of the forearm of chain `k` (0 to 2) on its swing at each sample, N m.
    pub fn forearm_torque_n_m(&self, k: usize, forearm: &ForearmTorque) -> Vec<f64> {
        let swing = self.chains[k].theta_fa_rad.iter();
        swing.map(|&s| forearm.torque_n_m_at(s)).collect()
    }

    /// Torque that the forearms ask of each lozenge at each sample, N m.
    pub fn forearm_torques_n_m(&self, forearm: &ForearmTorque) -> Vec<[f64; 3]> {
        let torque = [0, 1, 2].map(|k| self.forearm_torque_n_m(k, forearm));
        let at = |i: usize| {
            let torque = [0, 1, 2].map(|j| torque[j][i]);
            [0, 1, 2].map(|k| dot(self.chains[k].forearm_lever[i], torque))
        };
        (0..self.samples()).map(at).collect()
    }

    /// Adds what forearms with these torques on their swings ([`Mechanics::forearm_torque_n_m`]) ask of the
    /// lozenge of chain `k`.
    pub fn add_forearms(&self, k: usize, torque_n_m: [&[f64]; 3], needed_n_m: &mut [f64]) {
        for (i, needed) in needed_n_m.iter_mut().enumerate() {
            let torque = torque_n_m.map(|torque| torque[i]);
            *needed += dot(self.chains[k].forearm_lever[i], torque);
        }
    }

    /// The Maxwell torque that each lozenge needs, split by cause: for each chain and sample the
    /// contributions in the order of [`Contribution::ALL`], N m. Their sum over 1/2 C' is phi^2.
    ///
    /// # Errors
    /// [`Locked`] when a spring reaches its locking stretch.
    pub fn needed_torque_n_m(&self, parameters: &Parameters) -> Result<[Vec<[f64; 7]>; 3], Locked> {
        let mut out: [Vec<[f64; 7]>; 3] = Default::default();
        for (k, out) in out.iter_mut().enumerate() {
            let film = self.film_torque_n_m(k, parameters)?;
            *out = film
                .iter()
                .enumerate()
                .map(|(i, film)| {
                    let [weight, payload, inertia, bicep] = self.chains[k].load_n_m[i];
                    [film[0], film[1], 0.0, weight, payload, inertia, bicep]
                })
                .collect();
        }
        for (i, forearm) in self
            .forearm_torques_n_m(&parameters.forearm)
            .iter()
            .enumerate()
        {
            for k in 0..3 {
                out[k][i][2] = forearm[k];
            }
        }
        Ok(out)
    }

    /// Inverse dynamics f_ID: phi_k^2 (V^2) at each sample. Negative where no voltage holds the pose; NaN at
    /// [`Mechanics::unreachable`] samples.
    ///
    /// # Errors
    /// [`Locked`] when a spring reaches its locking stretch.
    pub fn phi_squared_v2(&self, parameters: &Parameters) -> Result<Vec<[f64; 3]>, Locked> {
        let needed = self.needed_torque_n_m(parameters)?;
        let mut out: Vec<[f64; 3]> = (0..self.samples())
            .map(|i| {
                [0, 1, 2].map(|k| {
                    needed[k][i].iter().sum::<f64>() / self.chains[k].half_capacitance_slope[i]
                })
            })
            .collect();
        for (i, _) in &self.unreachable {
            out[*i] = [f64::NAN; 3];
        }
        Ok(out)
    }

    /// Force prediction F_FP: the force of the surroundings on the end effector (N, world axes) at each
    /// sample, from the squared voltages `phi_squared_v2` on the films. NaN where the pose is out of reach.
    ///
    /// # Errors
    /// [`Locked`] when a spring reaches its locking stretch.
    pub fn external_force_n(
        &self,
        parameters: &Parameters,
        phi_squared_v2: &[[f64; 3]],
    ) -> Result<Vec<Vec3>, Locked> {
        let film = [
            self.film_torque_n_m(0, parameters)?,
            self.film_torque_n_m(1, parameters)?,
            self.film_torque_n_m(2, parameters)?,
        ];
        let mut out = Vec::with_capacity(self.samples());
        for i in 0..self.samples() {
            let mut force = self.gravity_and_inertia_n[i];
            for k in 0..3 {
                let chain = &self.chains[k];
                let net = chain.half_capacitance_slope[i] * phi_squared_v2[i][k]
                    - film[k][i][0]
                    - film[k][i][1]
                    - chain.bicep_n_m[i];
                let forearm = parameters.forearm.torque_n_m_at(chain.theta_fa_rad[i]);
                for j in 0..3 {
                    force[j] += forearm * chain.forearm_slope[i][j] - net * chain.lever[i][j];
                }
            }
            out.push(force);
        }
        for (i, why) in &self.unreachable {
            if matches!(why, Unreachable::Pose(_)) {
                out[*i] = [f64::NAN; 3];
            }
        }
        Ok(out)
    }
}
