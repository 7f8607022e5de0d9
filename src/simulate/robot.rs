//! Forward dynamics of the robot: the balance of section 4 of the model, integrated.
//!
//! ```text
//! (m + m_p)(u'' + g Z) + sum_k m_bc (q^2 theta_b_k'' - g q sin theta_b_k) d theta_b_k/du
//!   + sum_k T(theta_FA_k) d theta_FA_k/du - sum_k (tau_volt_k - tau_film_k) d theta_DEA_k/du = F
//! theta_b'' = d theta_b/du . u'' + u'^T (d^2 theta_b/du^2) u'
//! ```
//!
//! The left side is the residual of an implicit stage; its derivative with respect to u'' is exact but for
//! the third derivatives of the angles (in the term with u'^2 m_bc).

use super::Error;
use super::addition::{Action, Addition, Situation};
use super::branches::{Elimination, LANES, Pack, Response, Springs};
use super::integrator::{
    Control, Effort, Integrator, QUADRATURES, Rates, Scale, Side, Stage, State, System, Trouble,
};
use super::voltage::{Payload, Voltage};
use crate::film::{Film, InitialState};
use crate::kinematics::{ChainCurvature, ChainPose, FixedMechanism, Lozenge, Vec3, dot};
use crate::model::{ForearmTorque, Parameters, Robot, Track};
use crate::units::{GRAVITY_M_S2, VACUUM_PERMITTIVITY_F_M};

/// Largest condition number of G at which the actuators still hold a force in every direction (as in the
/// inverse dynamics).
const CONDITION_LIMIT: f64 = 1e3;
/// Ripple up to which the jumps of a held voltage are made smooth, of the tolerance.
const RIPPLE: f64 = 0.25;
/// Newton iterations of a stage.
const ITERATIONS: usize = 12;

/// The forearm's torque curve as one cubic an interval; the same curve as [`ForearmTorque`], with slope and
/// energy.
#[derive(Debug, Clone)]
struct Curve {
    nodes: Vec<f64>,
    /// T = c0 + c1 x + c2 x^2 + c3 x^3 with x from the left node.
    cubic: Vec<[f64; 4]>,
    /// Integral of T from the first node to each node.
    energy: Vec<f64>,
}

impl Curve {
    fn new(forearm: &ForearmTorque) -> Self {
        let nodes = forearm.nodes_rad().to_vec();
        let mut cubic = Vec::new();
        let mut energy = vec![0.0];
        for pair in nodes.windows(2) {
            let h = pair[1] - pair[0];
            let at = |f: f64| forearm.torque_n_m_at(pair[0] + f * h);
            let [y0, y1, y2, y3] = [at(0.0), at(1.0 / 3.0), at(2.0 / 3.0), at(1.0)];
            // The cubic through four equidistant values.
            let c1 = (-11.0 * y0 + 18.0 * y1 - 9.0 * y2 + 2.0 * y3) / 2.0;
            let c2 = (18.0 * y0 - 45.0 * y1 + 36.0 * y2 - 9.0 * y3) / 2.0;
            let c3 = (-9.0 * y0 + 27.0 * y1 - 27.0 * y2 + 9.0 * y3) / 2.0;
            cubic.push([y0, c1 / h, c2 / (h * h), c3 / (h * h * h)]);
            let area = h * (y0 + c1 / 2.0 + c2 / 3.0 + c3 / 4.0);
            energy.push(energy[energy.len() - 1] + area);
        }
        Curve {
            nodes,
            cubic,
            energy,
        }
    }

    /// T (N m), dT/d theta (N m/rad) and the integral of T from the first node (J).
    fn at(&self, theta: f64) -> [f64; 3] {
        let n = self.nodes.len();
        let inside = theta.clamp(self.nodes[0], self.nodes[n - 1]);
        let i = self.nodes.partition_point(|&x| x <= inside).clamp(1, n - 1) - 1;
        let [c0, c1, c2, c3] = self.cubic[i];
        let x = inside - self.nodes[i];
        let torque = c0 + x * (c1 + x * (c2 + x * c3));
        let slope = c1 + x * (2.0 * c2 + 3.0 * x * c3);
        let energy = self.energy[i] + x * (c0 + x * (c1 / 2.0 + x * (c2 / 3.0 + x * c3 / 4.0)));
        let beyond = theta - inside;
        [
            torque + slope * beyond,
            slope,
            energy + beyond * (torque + 0.5 * slope * beyond),
        ]
    }
}

/// Constants of one actuator.
#[derive(Debug, Clone, Copy)]
struct Actuator {
    /// (2 l_DEA/L1)^2, (2 l_DEA/L2)^2.
    stretch_squared: [f64; 2],
    /// n_f L1 L2 L3, m^3.
    volume: f64,
    /// C / sin^2 theta_DEA, F.
    capacitance: f64,
}

/// One actuator at an angle.
#[derive(Debug, Clone, Copy, Default)]
struct Angle {
    lambda_squared: [f64; 2],
    /// d ln lambda_i/d theta and its derivative.
    slope: [f64; 2],
    bend: [f64; 2],
    capacitance: f64,
    /// 1/2 dC/d theta and its derivative.
    half_slope: f64,
    half_bend: f64,
}

impl Actuator {
    fn new(lozenge: &Lozenge, eps_f_m: f64) -> Self {
        let k = [
            (2.0 * lozenge.side_m / lozenge.l1_m).powi(2),
            (2.0 * lozenge.side_m / lozenge.l2_m).powi(2),
        ];
        // C = n_f eps (L1 L2/L3)(lambda_1 lambda_2)^2, lambda_1 lambda_2 = sqrt(k1 k2) sin(theta)/2
        let area = lozenge.films * lozenge.l1_m * lozenge.l2_m;
        Actuator {
            stretch_squared: k,
            volume: lozenge.volume_m3(),
            capacitance: eps_f_m * area / lozenge.l3_m * k[0] * k[1] / 4.0,
        }
    }

    #[inline]
    fn at(&self, theta: f64) -> Angle {
        let (s, c) = (0.5 * theta).sin_cos();
        let (sin, cos) = (2.0 * s * c, c * c - s * s);
        Angle {
            lambda_squared: [
                self.stretch_squared[0] * s * s,
                self.stretch_squared[1] * c * c,
            ],
            slope: [0.5 * c / s, -0.5 * s / c],
            bend: [-0.25 / (s * s), -0.25 / (c * c)],
            capacitance: self.capacitance * sin * sin,
            half_slope: self.capacitance * sin * cos,
            half_bend: self.capacitance * (cos * cos - sin * sin),
        }
    }
}

/// What is asked for beside the robot and its drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Distance of the samples of the result, s.
    pub sample_step_s: f64,
    /// Time of the first sample, s; the motion starts there.
    pub start_s: f64,
    /// Length of the motion, s.
    pub duration_s: f64,
    /// Tolerance of one step for the position of the end effector, m; everything else is held to what moves
    /// it by as much.
    pub tolerance_m: f64,
    /// Longest step, s: nothing shorter than this in the drive is missed between two steps.
    pub longest_step_s: f64,
    /// Payload over time.
    pub payload: Payload,
    /// Where the motion starts.
    pub start: Start,
    /// Highest voltage that is allowed, V.
    pub voltage_limit_v: f64,
    /// Accounts for the energy to the accuracy of the integrator (costs half as much again).
    pub energy: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            sample_step_s: 0.01,
            start_s: 0.0,
            duration_s: 10.0,
            tolerance_m: 1e-8,
            longest_step_s: 0.05,
            payload: Payload::default(),
            start: Start::Rest,
            voltage_limit_v: f64::INFINITY,
            energy: false,
        }
    }
}

/// Where a motion starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// In static equilibrium under the first voltage and payload, every branch relaxed.
    Rest,
    /// Let go at a pose with a velocity, the films relaxed there or virgin.
    From {
        /// Position, m.
        position_m: Vec3,
        /// Velocity, m/s.
        velocity_m_s: Vec3,
        /// The films.
        films: InitialState,
    },
}

/// Where the energy went, J.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Energy {
    /// Electrical work done on the films, integral of phi dQ; a jump of the voltage counts as a quick ramp.
    pub electrical_j: f64,
    /// Of which Maxwell work on the lozenges, integral of 1/2 phi^2 dC.
    pub maxwell_j: f64,
    /// Rise of 1/2 C phi^2.
    pub electrostatic_j: f64,
    /// Rise of the energy of all springs of the films.
    pub elastic_j: f64,
    /// Rise of the energy of the forearms.
    pub forearm_j: f64,
    /// Rise of the potential energy.
    pub gravity_j: f64,
    /// Rise of the kinetic energy.
    pub kinetic_j: f64,
    /// Heat in the branches.
    pub heat_j: f64,
    /// Work of the additions.
    pub additions_j: f64,
    /// Energy that arrived with payload.
    pub payload_j: f64,
}

impl Energy {
    /// Enters what rose from `before` to `after` (as [`stored`] gives it), and the integrals.
    fn close(&mut self, before: [f64; 5], after: [f64; 5], quadratures: [f64; QUADRATURES]) {
        let rise = [0, 1, 2, 3, 4].map(|i| after[i] - before[i]);
        let [maxwell, heat, added] = quadratures;
        self.maxwell_j = maxwell;
        self.electrical_j = rise[0] + maxwell;
        self.electrostatic_j = rise[0];
        self.elastic_j = rise[1];
        self.forearm_j = rise[2];
        self.gravity_j = rise[3];
        self.kinetic_j = rise[4];
        self.heat_j = heat;
        self.additions_j = added;
    }

    /// What is not accounted for, J: zero but for the errors of the integration.
    pub fn imbalance_j(&self) -> f64 {
        self.electrical_j + self.additions_j + self.payload_j
            - self.electrostatic_j
            - self.elastic_j
            - self.forearm_j
            - self.gravity_j
            - self.kinetic_j
            - self.heat_j
    }
}

/// A simulated motion at equal distances in time.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Distance of the samples, s.
    pub step_s: f64,
    /// Position, m, world axes.
    pub position_m: Vec<Vec3>,
    /// Velocity, m/s.
    pub velocity_m_s: Vec<Vec3>,
    /// Acceleration, m/s^2, from the balance at the sample (just before a jump).
    pub acceleration_m_s2: Vec<Vec3>,
    /// Commanded voltages at the samples, V (just before a jump).
    pub phi_v: Vec<[f64; 3]>,
    /// Payload at the samples, kg (just before a step).
    pub payload_kg: Vec<f64>,
    /// State of the films at the first sample.
    pub initial: InitialState,
    /// Where the energy went; kept to the integrator's accuracy when [`Options::energy`] is set.
    pub energy: Energy,
    /// Steps taken.
    pub effort: Effort,
}

impl Motion {
    /// No sample yet, and room for as many as are wanted.
    fn with_room(options: &Options, samples: usize, initial: InitialState) -> Self {
        Motion {
            start_s: options.start_s,
            step_s: options.sample_step_s,
            position_m: Vec::with_capacity(samples),
            velocity_m_s: Vec::with_capacity(samples),
            acceleration_m_s2: Vec::with_capacity(samples),
            phi_v: Vec::with_capacity(samples),
            payload_kg: Vec::with_capacity(samples),
            initial,
            energy: Energy::default(),
            effort: Effort::default(),
        }
    }

    /// The same motion as the inverse dynamics read it.
    pub fn track(&self) -> Track {
        Track {
            step_s: self.step_s,
            position_m: self.position_m.clone(),
            velocity_m_s: self.velocity_m_s.clone(),
            acceleration_m_s2: self.acceleration_m_s2.clone(),
            payload_kg: self.payload_kg.clone(),
            initial: self.initial,
        }
    }
}

/// Films, mechanism and inputs together: the system that is integrated.
struct Plant<'a> {
    robot: &'a Robot,
    mechanism: FixedMechanism,
    actuators: [Actuator; 3],
    springs: Springs,
    packs: usize,
    curve: Curve,
    voltage: &'a dyn Voltage,
    payload: &'a Payload,
    additions: &'a [&'a dyn Addition],
    states: usize,
    scale: Scale,
    exact_power: bool,
    voltage_limit: f64,
    /// Sign of det G at the start.
    orientation: f64,
    elimination: Vec<Elimination>,
    scratch: Vec<Pack>,
    matrix: Vec<f64>,
    right: Vec<f64>,
    rates: [Vec<f64>; 2],
    /// Contraction of Newton's iteration seen last.
    contraction: f64,
}

/// The mechanism at a pose, with everything that the balance needs.
struct Pose {
    chains: [ChainPose; 3],
    curvature: [ChainCurvature; 3],
    angles: [Angle; 3],
}

/// Where Newton's iteration of a stage stands.
struct Iterate {
    pose: Pose,
    films: [Response; 3],
    situation: Situation,
    action: Action,
}

fn solve3(m: &[Vec3; 3], r: Vec3) -> Vec3 {
    let cross = |a: Vec3, b: Vec3| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let columns = [0, 1, 2].map(|j| [m[0][j], m[1][j], m[2][j]]);
    let yz = cross(columns[1], columns[2]);
    let determinant = dot(columns[0], yz);
    [
        dot(r, yz) / determinant,
        dot(columns[0], cross(r, columns[2])) / determinant,
        dot(columns[0], cross(columns[1], r)) / determinant,
    ]
}

/// Smallest eigenvalue of the symmetric part of a 3 x 3 matrix (trigonometric solution of the cubic).
fn smallest_eigenvalue(m: &[Vec3; 3]) -> f64 {
    let s = |i: usize, j: usize| 0.5 * (m[i][j] + m[j][i]);
    let mean = (s(0, 0) + s(1, 1) + s(2, 2)) / 3.0;
    let off = s(0, 1).powi(2) + s(0, 2).powi(2) + s(1, 2).powi(2);
    let spread = (0..3).map(|i| (s(i, i) - mean).powi(2)).sum::<f64>() + 2.0 * off;
    let p = (spread / 6.0).sqrt();
    if p == 0.0 {
        return mean;
    }
    let b = |i: usize, j: usize| (s(i, j) - if i == j { mean } else { 0.0 }) / p;
    let det = b(0, 0) * (b(1, 1) * b(2, 2) - b(1, 2) * b(2, 1))
        - b(0, 1) * (b(1, 0) * b(2, 2) - b(1, 2) * b(2, 0))
        + b(0, 2) * (b(1, 0) * b(2, 1) - b(1, 1) * b(2, 0));
    let angle = (det / 2.0).clamp(-1.0, 1.0).acos() / 3.0;
    mean + 2.0 * p * (angle + 2.0 * std::f64::consts::PI / 3.0).cos()
}

/// det G and its condition number in the Frobenius norm.
fn rank(chains: &[ChainPose; 3]) -> (f64, f64) {
    let g = [0, 1, 2].map(|k| chains[k].dtheta_dea_du);
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
    let condition = norm(&g) * norm(&rows) / determinant.abs();
    (
        determinant,
        if condition.is_nan() {
            f64::INFINITY
        } else {
            condition
        },
    )
}

/// Solves `n` equations in place by elimination with row exchange; false when the matrix is singular.
fn eliminate(matrix: &mut [f64], right: &mut [f64]) -> bool {
    let n = right.len();
    for c in 0..n {
        let mut pivot = c;
        for r in c + 1..n {
            if matrix[r * n + c].abs() > matrix[pivot * n + c].abs() {
                pivot = r;
            }
        }
        let p = matrix[pivot * n + c];
        if p == 0.0 || !p.is_finite() {
            return false;
        }
        if pivot != c {
            for j in 0..n {
                matrix.swap(c * n + j, pivot * n + j);
            }
            right.swap(c, pivot);
        }
        for r in c + 1..n {
            let f = matrix[r * n + c] / p;
            if f != 0.0 {
                for j in c..n {
                    matrix[r * n + j] -= f * matrix[c * n + j];
                }
                right[r] -= f * right[c];
            }
        }
    }
    for c in (0..n).rev() {
        let mut value = right[c];
        for j in c + 1..n {
            value -= matrix[c * n + j] * right[j];
        }
        right[c] = value / matrix[c * n + c];
    }
    right.iter().all(|v| v.is_finite())
}

/// Residual of the balance and its derivatives.
struct Balance {
    residual: Vec3,
    mass: [Vec3; 3],
    stiffness: [Vec3; 3],
    damping: [Vec3; 3],
}

impl<'a> Plant<'a> {
    fn new(
        robot: &'a Robot,
        parameters: &Parameters,
        voltage: &'a dyn Voltage,
        options: &'a Options,
        additions: &'a [&'a dyn Addition],
    ) -> Self {
        let eps = robot.eps_r * VACUUM_PERMITTIVITY_F_M;
        let springs = Springs::new(&parameters.film);
        let packs = springs.packs();
        let states = additions.iter().map(|a| a.states()).sum::<usize>();
        let tolerance = options.tolerance_m;
        Plant {
            robot,
            mechanism: robot.mechanism.fixed(),
            actuators: [0, 1, 2].map(|k| Actuator::new(&robot.lozenges[k], eps)),
            packs,
            springs,
            curve: Curve::new(&parameters.forearm),
            voltage,
            payload: &options.payload,
            additions,
            states,
            // A velocity error moves the robot within about 1/100 s (its bounce is near 15 Hz); a stretch
            // changes by about 5 a metre of travel, w by twice that.
            scale: Scale {
                x: tolerance,
                v: 100.0 * tolerance,
                w: 10.0 * tolerance,
            },
            exact_power: options.energy,
            voltage_limit: options.voltage_limit_v,
            orientation: 0.0,
            elimination: vec![Elimination::ZERO; 3 * packs],
            scratch: vec![[[0.0; LANES]; 2]; 3 * packs],
            matrix: vec![0.0; (3 + states) * (3 + states)],
            right: vec![0.0; 3 + states],
            rates: [vec![0.0; states], vec![0.0; states]],
            contraction: 0.1,
        }
    }

    fn pose(&self, t_s: f64, u: Vec3) -> Result<Pose, Error> {
        let chains = self
            .mechanism
            .pose(u)
            .map_err(|place| Error::OutOfReach { at_s: t_s, place })?;
        Ok(Pose {
            curvature: [0, 1, 2].map(|k| self.robot.mechanism.chains[k].curvature(&chains[k])),
            angles: [0, 1, 2].map(|k| self.actuators[k].at(chains[k].theta_dea_rad)),
            chains,
        })
    }

    fn situation(
        &self,
        t_s: f64,
        u: Vec3,
        v: Vec3,
        pose: &Pose,
        films: &[Response; 3],
        command: [f64; 3],
    ) -> Situation {
        let c = &pose.chains;
        Situation {
            t_s,
            position_m: u,
            velocity_m_s: v,
            theta_dea_rad: [0, 1, 2].map(|k| c[k].theta_dea_rad),
            theta_dea_rate_rad_s: [0, 1, 2].map(|k| dot(c[k].dtheta_dea_du, v)),
            theta_b_rad: [0, 1, 2].map(|k| c[k].theta_b_rad),
            theta_b_rate_rad_s: [0, 1, 2].map(|k| dot(c[k].dtheta_b_du, v)),
            stretch: [0, 1, 2].map(|k| pose.angles[k].lambda_squared.map(f64::sqrt)),
            film_stress_pa: [0, 1, 2].map(|k| films[k].sigma),
            capacitance_f: [0, 1, 2].map(|k| pose.angles[k].capacitance),
            command_v: command,
        }
    }

    /// The same situation moved by a small displacement and change of velocity; levers and branches are kept.
    fn moved(
        &self,
        s: &Situation,
        pose: &Pose,
        films: &[Response; 3],
        dx: Vec3,
        dv: Vec3,
    ) -> Situation {
        let mut out = *s;
        for i in 0..3 {
            out.position_m[i] += dx[i];
            out.velocity_m_s[i] += dv[i];
        }
        for k in 0..3 {
            let c = &pose.chains[k];
            let turn = dot(c.dtheta_dea_du, dx);
            out.theta_dea_rad[k] += turn;
            let angle = &pose.angles[k];
            let increment = angle.slope.map(|g| g * turn);
            let [t11, t12, t21, t22] = films[k].tangent;
            for i in 0..2 {
                out.stretch[k][i] *= 1.0 + increment[i];
            }
            out.film_stress_pa[k][0] += t11 * increment[0] + t12 * increment[1];
            out.film_stress_pa[k][1] += t21 * increment[0] + t22 * increment[1];
            out.capacitance_f[k] += 2.0 * angle.half_slope * turn;
            out.theta_dea_rate_rad_s[k] += dot(c.dtheta_dea_du, dv);
            out.theta_b_rad[k] += dot(c.dtheta_b_du, dx);
            out.theta_b_rate_rad_s[k] += dot(c.dtheta_b_du, dv);
        }
        out
    }

    /// The additions' own states with the robot at rest in `situation`.
    fn start(&self, situation: &Situation, z: &mut [f64]) {
        let mut at = 0;
        for addition in self.additions {
            let n = addition.states();
            addition.start(situation, &mut z[at..at + n]);
            at += n;
        }
    }

    fn act(&self, situation: &Situation, z: &[f64], rates: &mut [f64]) -> Action {
        let mut action = Action {
            phi_v: situation.command_v,
            ..Action::default()
        };
        let mut at = 0;
        for addition in self.additions {
            let n = addition.states();
            addition.act(
                situation,
                &z[at..at + n],
                &mut action,
                &mut rates[at..at + n],
            );
            at += n;
        }
        action
    }

    /// Generalised force of an action: the additions' own part and the Maxwell torque of its voltage.
    fn force(&self, pose: &Pose, action: &Action) -> Vec3 {
        let mut out = action.force_n;
        for k in 0..3 {
            let phi = action.phi_v[k];
            let dea = action.torque_dea_n_m[k] + pose.angles[k].half_slope * phi * phi;
            let b = action.torque_b_n_m[k];
            let c = &pose.chains[k];
            for i in 0..3 {
                out[i] += dea * c.dtheta_dea_du[i] + b * c.dtheta_b_du[i];
            }
        }
        out
    }

    /// Residual of the balance and its derivatives for film responses and an action of the additions (whose
    /// own derivatives are not in it).
    fn balance(
        &self,
        pose: &Pose,
        v: Vec3,
        a: Vec3,
        payload_kg: f64,
        films: &[Response; 3],
        action: &Action,
    ) -> Balance {
        let mass = self.robot.effector_kg + payload_kg;
        let tip = self.robot.bicep_tip_kg;
        let mut out = Balance {
            residual: [
                mass * a[0] - action.force_n[0],
                mass * a[1] - action.force_n[1],
                mass * (a[2] + GRAVITY_M_S2) - action.force_n[2],
            ],
            mass: [[mass, 0.0, 0.0], [0.0, mass, 0.0], [0.0, 0.0, mass]],
            stiffness: [[0.0; 3]; 3],
            damping: [[0.0; 3]; 3],
        };
        for k in 0..3 {
            let (c, h, angle) = (&pose.chains[k], &pose.curvature[k], &pose.angles[k]);
            let (film, volume) = (&films[k], self.actuators[k].volume);
            let [g1, g2] = angle.slope;
            let tau = volume * (film.sigma[0] * g1 + film.sigma[1] * g2);
            let [t11, t12, t21, t22] = film.tangent;
            let tau_slope = volume
                * (film.sigma[0] * angle.bend[0]
                    + film.sigma[1] * angle.bend[1]
                    + g1 * (t11 * g1 + t12 * g2)
                    + g2 * (t21 * g1 + t22 * g2));
            let squared = action.phi_v[k] * action.phi_v[k];
            let net = angle.half_slope * squared - tau + action.torque_dea_n_m[k];
            let net_slope = angle.half_bend * squared - tau_slope;
            let q = self.robot.mechanism.chains[k].bicep_m;
            let (sin, cos) = c.theta_b_rad.sin_cos();
            let gb = c.dtheta_b_du;
            let hv = [
                dot(h.theta_b[0], v),
                dot(h.theta_b[1], v),
                dot(h.theta_b[2], v),
            ];
            let ha = [
                dot(h.theta_b[0], a),
                dot(h.theta_b[1], a),
                dot(h.theta_b[2], a),
            ];
            let acceleration = dot(gb, a) + dot(hv, v);
            let inertia = tip * q * q;
            let bicep =
                inertia * acceleration - tip * GRAVITY_M_S2 * q * sin - action.torque_b_n_m[k];
            let weight_slope = -tip * GRAVITY_M_S2 * q * cos;
            let [forearm, forearm_slope, _] = self.curve.at(c.theta_fa_rad);
            let (gd, gf) = (c.dtheta_dea_du, c.dtheta_fa_du);
            for i in 0..3 {
                out.residual[i] += bicep * gb[i] - net * gd[i] + forearm * gf[i];
                for j in 0..3 {
                    out.mass[i][j] += inertia * gb[i] * gb[j];
                    out.damping[i][j] += 2.0 * inertia * gb[i] * hv[j];
                    out.stiffness[i][j] += gb[i] * (inertia * ha[j] + weight_slope * gb[j])
                        + bicep * h.theta_b[i][j]
                        - net * h.theta_dea[i][j]
                        - net_slope * gd[i] * gd[j]
                        + forearm * h.theta_fa[i][j]
                        + forearm_slope * gf[i] * gf[j];
                }
            }
        }
        out
    }

    fn explicit(&mut self, t_s: f64, pose: &Pose, w: &[Pack]) -> Result<[Response; 3], Error> {
        let mut out = [Response::default(); 3];
        let n = self.packs;
        for k in 0..3 {
            let squared = pose.angles[k].lambda_squared;
            let own = &w[k * n..(k + 1) * n];
            out[k] = self
                .springs
                .explicit(squared, own, &mut self.scratch[k * n..(k + 1) * n]);
            if out[k].least.is_nan() || out[k].least <= 0.0 {
                return Err(self.locked(k, squared, own, t_s));
            }
        }
        Ok(out)
    }

    /// The state that a motion begins with.
    fn state(&self, pose: &Pose, x: Vec3, v: Vec3, films: InitialState) -> State<3> {
        let n = self.packs;
        let mut out = State {
            x,
            v,
            w: vec![[[1.0; LANES]; 2]; 3 * n],
            z: vec![0.0; self.states],
            y: Vec::new(),
        };
        for k in 0..3 {
            let own = &mut out.w[k * n..(k + 1) * n];
            match films {
                InitialState::Relaxed => self.springs.relaxed(pose.angles[k].lambda_squared, own),
                InitialState::Virgin => self.springs.virgin(own),
            }
        }
        out
    }

    /// Largest jump of phi^2 times the square of the time between jumps that moves the end effector by a
    /// ripple within the tolerance: a jump by d every h seconds lets it ripple by d h^2 sqrt(3)/216 of its
    /// force a phi^2 over its mass.
    fn largest_jump_v2_s2(&self, pose: &Pose, tolerance_m: f64) -> f64 {
        let lever = (0..3).map(|k| {
            let g = pose.chains[k].dtheta_dea_du;
            0.5 * self.actuators[k].capacitance * dot(g, g).sqrt()
        });
        let force_n_v2 = lever.fold(0.0, f64::max);
        let ripple_m = RIPPLE * tolerance_m;
        ripple_m * 216.0 / 3f64.sqrt() * self.robot.effector_kg / force_n_v2
    }

    /// Film responses of an implicit stage.
    fn implicit(
        &mut self,
        stage: &Stage<3>,
        pose: &Pose,
        state: &State<3>,
    ) -> Result<[Response; 3], Trouble<Error>> {
        let mut out = [Response::default(); 3];
        let n = self.packs;
        for k in 0..3 {
            let own = k * n..(k + 1) * n;
            let squared = pose.angles[k].lambda_squared;
            out[k] = self.springs.implicit(
                squared,
                stage.weight_s,
                &stage.star.w[own.clone()],
                &state.w[own.clone()],
                &mut self.elimination[own.clone()],
            );
            if out[k].least.is_nan() || out[k].least <= 0.0 {
                let locked = self.locked(k, squared, &state.w[own], stage.t_s);
                return Err(Trouble::Blocked(locked));
            }
        }
        Ok(out)
    }

    /// Residual of a stage's balance and its derivatives by the accelerations.
    fn lay_out_balance(&mut self, now: &Iterate, hg: f64, v: Vec3, a: Vec3, payload_kg: f64) {
        let b = self.balance(&now.pose, v, a, payload_kg, &now.films, &now.action);
        let size_of = 3 + self.states;
        for i in 0..3 {
            self.right[i] = -b.residual[i];
            for k in 0..3 {
                self.matrix[i * size_of + k] =
                    b.mass[i][k] + hg * (b.damping[i][k] + hg * b.stiffness[i][k]);
            }
        }
    }

    /// The additions' derivatives with respect to a (through x and v) and z by differences; `rates` holds
    /// their rates at the iterate, and has room for others.
    fn lay_out_additions(
        &mut self,
        now: &Iterate,
        stage: &Stage<3>,
        state: &mut State<3>,
        rates: &mut [Vec<f64>; 2],
    ) {
        let Iterate {
            pose,
            films,
            situation,
            action,
        } = now;
        let (nz, size_of, hg) = (self.states, 3 + self.states, stage.weight_s);
        let base = self.force(pose, action);
        for i in 0..nz {
            self.right[3 + i] = stage.star.z[i] + hg * rates[0][i] - state.z[i];
        }
        for c in 0..size_of {
            let (step, changed) = if c < 3 {
                let step = 1e-6 / hg;
                let mut e = [0.0; 3];
                e[c] = step;
                let dv = e.map(|e| hg * e);
                let moved = self.moved(situation, pose, films, dv.map(|v| hg * v), dv);
                (step, self.act(&moved, &state.z, &mut rates[1]))
            } else {
                let step = 1e-7 * self.z_scale(c - 3).max(state.z[c - 3].abs());
                let kept = state.z[c - 3];
                state.z[c - 3] = kept + step;
                let changed = self.act(situation, &state.z, &mut rates[1]);
                state.z[c - 3] = kept;
                (step, changed)
            };
            let force = self.force(pose, &changed);
            for i in 0..3 {
                let slope = (force[i] - base[i]) / step;
                if c < 3 {
                    self.matrix[i * size_of + c] -= slope;
                } else {
                    self.matrix[i * size_of + c] = -slope;
                }
            }
            for i in 0..nz {
                let unit = if c == 3 + i { 1.0 } else { 0.0 };
                let slope = (rates[1][i] - rates[0][i]) / step;
                self.matrix[(3 + i) * size_of + c] = unit - hg * slope;
            }
        }
    }

    /// Takes the solution on to accelerations, additions and branches; its size over the tolerances.
    fn correct(
        &mut self,
        pose: &Pose,
        hg: f64,
        state: &mut State<3>,
        a: &mut Vec3,
    ) -> Result<f64, Trouble<Error>> {
        let n = self.packs;
        let mut size = 0.0_f64;
        let mut dx = [0.0; 3];
        for i in 0..3 {
            let d = self.right[i];
            a[i] += d;
            dx[i] = hg * hg * d;
            size = size.max((dx[i] / self.scale.x).abs());
            size = size.max((hg * d / self.scale.v).abs());
        }
        for i in 0..self.states {
            let d = self.right[3 + i];
            state.z[i] += d;
            let unit = self.scale.w * self.z_scale(i).max(state.z[i].abs());
            size = size.max((d / unit).abs());
        }
        for k in 0..3 {
            let turn = dot(pose.chains[k].dtheta_dea_du, dx);
            let increment = pose.angles[k].slope.map(|g| g * turn);
            let own = k * n..(k + 1) * n;
            let moved =
                self.springs
                    .follow(increment, &mut state.w[own.clone()], &self.elimination[own]);
            if moved.is_nan() || moved > 0.5 {
                return Err(Trouble::Diverged);
            }
            size = size.max(moved / self.scale.w);
        }
        Ok(size)
    }

    fn locked(&self, k: usize, squared: [f64; 2], w: &[Pack], t_s: f64) -> Error {
        Error::Locked {
            chain: k + 1,
            place: self.springs.locked(squared, w, t_s),
        }
    }

    /// Powers of the quadratures.
    fn powers(
        &self,
        s: &Situation,
        pose: &Pose,
        films: &[Response; 3],
        action: &Action,
    ) -> [f64; QUADRATURES] {
        let mut out = [0.0, 0.0, dot(action.force_n, s.velocity_m_s)];
        for k in 0..3 {
            let phi = action.phi_v[k];
            out[0] += pose.angles[k].half_slope * phi * phi * s.theta_dea_rate_rad_s[k];
            out[1] += self.actuators[k].volume * films[k].dissipation;
            out[2] += action.torque_dea_n_m[k] * s.theta_dea_rate_rad_s[k]
                + action.torque_b_n_m[k] * s.theta_b_rate_rad_s[k];
        }
        out
    }

    fn command(&self, t_s: f64, side: Side) -> Result<[f64; 3], Error> {
        let phi = self.voltage.phi_v(t_s, side);
        for (k, &phi_v) in phi.iter().enumerate() {
            if phi_v.is_nan() || phi_v.abs() > self.voltage_limit {
                return Err(Error::VoltageLimit {
                    at_s: t_s,
                    chain: k + 1,
                    phi_v,
                    limit_v: self.voltage_limit,
                });
            }
        }
        Ok(phi)
    }
}

impl System<3> for Plant<'_> {
    type Error = Error;

    fn rates(
        &mut self,
        t_s: f64,
        side: Side,
        state: &State<3>,
        rates: &mut Rates<3>,
    ) -> Result<[f64; QUADRATURES], Trouble<Error>> {
        let pose = self.pose(t_s, state.x).map_err(Trouble::Blocked)?;
        let command = self.command(t_s, side).map_err(Trouble::Fatal)?;
        let films = self
            .explicit(t_s, &pose, &state.w)
            .map_err(Trouble::Blocked)?;
        rates.w.copy_from_slice(&self.scratch);
        let situation = self.situation(t_s, state.x, state.v, &pose, &films, command);
        let action = self.act(&situation, &state.z, &mut rates.z);
        let payload = self.payload.mass_kg(t_s, side);
        let b = self.balance(&pose, state.v, [0.0; 3], payload, &films, &action);
        rates.a = solve3(&b.mass, b.residual.map(|r| -r));
        Ok(self.powers(&situation, &pose, &films, &action))
    }

    fn stage(
        &mut self,
        stage: &Stage<3>,
        state: &mut State<3>,
        a: &mut Vec3,
    ) -> Result<[f64; QUADRATURES], Trouble<Error>> {
        let (t_s, hg) = (stage.t_s, stage.weight_s);
        let command = self.command(t_s, Side::Before).map_err(Trouble::Fatal)?;
        let payload = self.payload.mass_kg(t_s, Side::Before);
        let follow = |state: &mut State<3>, a: &Vec3| {
            for i in 0..3 {
                state.v[i] = stage.star.v[i] + hg * a[i];
                state.x[i] = stage.star.x[i] + hg * state.v[i];
            }
        };
        let mut last_size = f64::INFINITY;
        let mut done = false;
        for iteration in 0..ITERATIONS {
            follow(state, a);
            let pose = self.pose(t_s, state.x).map_err(Trouble::Blocked)?;
            let films = self.implicit(stage, &pose, state)?;
            let situation = self.situation(t_s, state.x, state.v, &pose, &films, command);
            let mut rates = std::mem::take(&mut self.rates);
            let action = self.act(&situation, &state.z, &mut rates[0]);
            let now = Iterate {
                pose,
                films,
                situation,
                action,
            };
            if done {
                self.rates = rates;
                return Ok(self.powers(&now.situation, &now.pose, &now.films, &now.action));
            }
            self.lay_out_balance(&now, hg, state.v, *a, payload);
            if !self.additions.is_empty() {
                self.lay_out_additions(&now, stage, state, &mut rates);
            }
            self.rates = rates;
            if !eliminate(&mut self.matrix, &mut self.right) {
                return Err(Trouble::Diverged);
            }
            let size = self.correct(&now.pose, hg, state, a)?;
            if iteration > 0 {
                self.contraction = (size / last_size).clamp(1e-4, 0.9);
                if size > 2.0 * last_size {
                    return Err(Trouble::Diverged);
                }
            }
            last_size = size;
            if size * self.contraction < stage.enough {
                follow(state, a);
                if !self.exact_power {
                    return Ok([0.0; QUADRATURES]);
                }
                done = true;
            }
        }
        Err(Trouble::Diverged)
    }

    fn accept(&mut self, t_s: f64, state: &State<3>) -> Result<(), Error> {
        let pose = self.pose(t_s, state.x)?;
        let (determinant, condition) = rank(&pose.chains);
        if determinant * self.orientation < 0.0 {
            return Err(Error::Flipped {
                at_s: t_s,
                position_m: state.x,
            });
        }
        if condition > CONDITION_LIMIT {
            return Err(Error::Singular {
                at_s: t_s,
                position_m: state.x,
                condition,
                limit: CONDITION_LIMIT,
            });
        }
        if self.additions.is_empty() {
            // Stiffness with the branches frozen: not even the glassy film holds this pose when it is
            // indefinite.
            let films = self.explicit(t_s, &pose, &state.w)?;
            let action = Action {
                phi_v: self.command(t_s, Side::Before)?,
                ..Action::default()
            };
            let b = self.balance(&pose, [0.0; 3], [0.0; 3], 0.0, &films, &action);
            let stiffness_n_m = smallest_eigenvalue(&b.stiffness);
            if stiffness_n_m.is_nan() || stiffness_n_m <= 0.0 {
                return Err(Error::SnapThrough {
                    at_s: t_s,
                    position_m: state.x,
                    stiffness_n_m,
                });
            }
        }
        Ok(())
    }

    fn next_break_s(&self, t_s: f64) -> f64 {
        let mut next = self
            .voltage
            .next_break_s(t_s)
            .min(self.payload.next_break_s(t_s));
        for addition in self.additions {
            next = next.min(addition.next_break_s(t_s));
        }
        next
    }

    fn z_scale(&self, i: usize) -> f64 {
        let mut at = i;
        for addition in self.additions {
            let n = addition.states();
            if at < n {
                return addition.scale(at);
            }
            at -= n;
        }
        1.0
    }

    fn stuck(&self, t_s: f64, state: &State<3>) -> Error {
        Error::Stuck {
            at_s: t_s,
            position_m: state.x,
        }
    }
}

/// A static equilibrium with every branch relaxed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    /// Position of the end effector, m.
    pub position_m: Vec3,
    /// theta_DEA of the chains, rad.
    pub theta_dea_rad: [f64; 3],
    /// Smallest eigenvalue of the static stiffness with relaxed branches, N/m.
    pub stiffness_n_m: f64,
}

/// The static balance with relaxed branches: only the equilibrium springs carry.
struct Statics<'a> {
    plant: Plant<'a>,
    /// Time at which it rests, s.
    t_s: f64,
    states: Vec<f64>,
}

impl<'a> Statics<'a> {
    fn new(
        robot: &'a Robot,
        parameters: &Parameters,
        voltage: &'a dyn Voltage,
        options: &'a Options,
        additions: &'a [&'a dyn Addition],
    ) -> Self {
        let relaxed = Parameters {
            film: Film {
                mu_pa: parameters.film.mu_pa.first().copied().into_iter().collect(),
                relaxation_time_s: Vec::new(),
                locking: parameters.film.locking,
            },
            forearm: parameters.forearm.clone(),
        };
        let plant = Plant::new(robot, &relaxed, voltage, options, additions);
        let states = vec![0.0; plant.states];
        Statics {
            plant,
            t_s: options.start_s,
            states,
        }
    }

    /// Residual and stiffness at rest in `u`.
    fn at(
        &mut self,
        u: Vec3,
        phi: [f64; 3],
        payload_kg: f64,
    ) -> Result<(Vec3, [Vec3; 3], Pose), Error> {
        let t_s = self.t_s;
        let pose = self.plant.pose(t_s, u)?;
        let w = [[[1.0; LANES]; 2]; 3];
        let films = self.plant.explicit(t_s, &pose, &w)?;
        let situation = self.plant.situation(t_s, u, [0.0; 3], &pose, &films, phi);
        let mut rates = std::mem::take(&mut self.plant.rates);
        self.plant.start(&situation, &mut self.states);
        let action = self.plant.act(&situation, &self.states, &mut rates[0]);
        let b = self
            .plant
            .balance(&pose, [0.0; 3], [0.0; 3], payload_kg, &films, &action);
        let mut stiffness = b.stiffness;
        if !self.plant.additions.is_empty() {
            let base = self.plant.force(&pose, &action);
            for c in 0..3 {
                let mut dx = [0.0; 3];
                dx[c] = 1e-8;
                let moved = self.plant.moved(&situation, &pose, &films, dx, [0.0; 3]);
                // What lags has come to rest there, too.
                self.plant.start(&moved, &mut self.states);
                let changed = self.plant.act(&moved, &self.states, &mut rates[1]);
                let force = self.plant.force(&pose, &changed);
                for i in 0..3 {
                    stiffness[i][c] -= (force[i] - base[i]) / 1e-8;
                }
            }
        }
        self.plant.rates = rates;
        Ok((b.residual, stiffness, pose))
    }

    /// Newton from `u`.
    fn newton(
        &mut self,
        mut u: Vec3,
        phi: [f64; 3],
        payload_kg: f64,
    ) -> Result<Vec3, Option<Error>> {
        let mut last = f64::INFINITY;
        for _ in 0..40 {
            let (residual, stiffness, _) = self.at(u, phi, payload_kg).map_err(Some)?;
            let d = solve3(&stiffness, residual.map(|r| -r));
            let size = dot(d, d).sqrt();
            if size.is_nan() {
                return Err(None);
            }
            // Steps of at most 2 mm: the workspace is some centimetres wide.
            let factor = (2e-3 / size).min(1.0);
            for i in 0..3 {
                u[i] += factor * d[i];
            }
            // Quadratic convergence down to rounding.
            if size < 1e-13 || (size < 1e-11 && size >= 0.5 * last) {
                return Ok(u);
            }
            last = size;
        }
        Err(None)
    }
}

/// The pose in which the robot stands under the voltages `phi_v` (V) and `payload_kg`, all branches relaxed:
/// on from the free robot by continuation in phi^2 and payload.
///
/// # Errors
/// [`Error::NoRest`] with the share of voltage and payload up to which there is a stable equilibrium.
pub fn rest(
    robot: &Robot,
    parameters: &Parameters,
    phi_v: [f64; 3],
    payload_kg: f64,
    additions: &[&dyn Addition],
) -> Result<Rest, Error> {
    rest_at(0.0, robot, parameters, phi_v, payload_kg, additions)
}

/// As [`rest`], at the time `start_s`: additions may depend on it.
fn rest_at(
    start_s: f64,
    robot: &Robot,
    parameters: &Parameters,
    phi_v: [f64; 3],
    payload_kg: f64,
    additions: &[&dyn Addition],
) -> Result<Rest, Error> {
    check_film(&parameters.film)?;
    let options = Options {
        start_s,
        ..Options::default()
    };
    let none = super::voltage::Smooth(|_| [0.0; 3]);
    let mut statics = Statics::new(robot, parameters, &none, &options, additions);
    let no_rest = |share: f64, position_m: Vec3, why: String| Error::NoRest {
        phi_v,
        payload_kg,
        share,
        position_m,
        why,
    };
    // The free robot: down the axis from the base, the stable root nearest to it below the highest bicep
    // pose; where the free robot has none (a film too stiff or too slack), the point of the least force.
    let length = robot.mechanism.chains[0].bicep_m + robot.mechanism.chains[0].forearm_m;
    let points = 400;
    let mut previous: Option<(f64, f64, f64)> = None;
    let mut start = None;
    for i in (1..points).rev() {
        let z = -length * i as f64 / points as f64;
        let Ok((residual, _, pose)) = statics.at([0.0, 0.0, z], [0.0; 3], 0.0) else {
            previous = None;
            continue;
        };
        let (determinant, _) = rank(&pose.chains);
        if let Some((z0, r0, d0)) = previous {
            // Stable: the force needed rises with z.
            if r0 < 0.0 && residual[2] >= 0.0 && d0 * determinant > 0.0 {
                let f = r0 / (r0 - residual[2]);
                let guess = [0.0, 0.0, z0 + f * (z - z0)];
                if let Ok(u) = statics.newton(guess, [0.0; 3], 0.0)
                    && let Ok((_, stiffness, _)) = statics.at(u, [0.0; 3], 0.0)
                    && smallest_eigenvalue(&stiffness) > 0.0
                {
                    start = Some(u);
                    break;
                }
            }
        }
        previous = Some((z, residual[2], determinant));
    }
    let Some(mut u) = start else {
        let why = "the free robot has no stable equilibrium on its axis".to_string();
        return Err(no_rest(0.0, [0.0; 3], why));
    };
    let (mut share, mut step) = (0.0, 1.0_f64);
    let mut why = String::from("the static stiffness is not positive: snap-through");
    while share < 1.0 {
        let next = (share + step).min(1.0);
        let phi = phi_v.map(|p| p * next.sqrt());
        let found = statics.newton(u, phi, payload_kg * next);
        let stable = match &found {
            Ok(candidate) => {
                let far = [0, 1, 2].map(|i| candidate[i] - u[i]);
                let (_, stiffness, pose) = statics.at(*candidate, phi, payload_kg * next)?;
                let (_, condition) = rank(&pose.chains);
                // A long way in one step may have gone round a fold.
                condition < CONDITION_LIMIT
                    && smallest_eigenvalue(&stiffness) > 0.0
                    && dot(far, far).sqrt() < 6e-3
            }
            Err(_) => false,
        };
        match found {
            Ok(candidate) if stable => {
                u = candidate;
                share = next;
                step *= 2.0;
            }
            other => {
                if let Err(Some(error)) = other {
                    why = error.to_string();
                }
                step *= 0.5;
                if step < 1e-4 {
                    return Err(no_rest(share, u, why));
                }
            }
        }
    }
    let (_, stiffness, pose) = statics.at(u, phi_v, payload_kg)?;
    Ok(Rest {
        position_m: u,
        theta_dea_rad: [0, 1, 2].map(|k| pose.chains[k].theta_dea_rad),
        stiffness_n_m: smallest_eigenvalue(&stiffness),
    })
}

/// Stored energies at one instant, J: electrostatic, elastic, forearm, gravity, kinetic.
fn stored(plant: &mut Plant, t_s: f64, state: &State<3>, side: Side) -> Result<[f64; 5], Error> {
    let pose = plant.pose(t_s, state.x)?;
    let command = plant.command(t_s, side)?;
    let films = plant.explicit(t_s, &pose, &state.w)?;
    let situation = plant.situation(t_s, state.x, state.v, &pose, &films, command);
    let mut rates = vec![0.0; plant.states];
    let action = plant.act(&situation, &state.z, &mut rates);
    let mass = plant.robot.effector_kg + plant.payload.mass_kg(t_s, side);
    let mut out = [0.0; 5];
    out[3] = mass * GRAVITY_M_S2 * state.x[2];
    out[4] = 0.5 * mass * dot(state.v, state.v);
    let n = plant.packs;
    for k in 0..3 {
        let (angle, c) = (&pose.angles[k], &pose.chains[k]);
        let q = plant.robot.mechanism.chains[k].bicep_m;
        let tip = plant.robot.bicep_tip_kg;
        out[0] += 0.5 * angle.capacitance * action.phi_v[k].powi(2);
        let w = &state.w[k * n..(k + 1) * n];
        out[1] += plant.actuators[k].volume * plant.springs.energy_j_m3(angle.lambda_squared, w);
        out[2] += plant.curve.at(c.theta_fa_rad)[2];
        out[3] += tip * GRAVITY_M_S2 * q * c.theta_b_rad.cos();
        out[4] += 0.5 * tip * (q * situation.theta_b_rate_rad_s[k]).powi(2);
    }
    Ok(out)
}

/// Checks the numbers of a film.
pub(super) fn check_film(film: &Film) -> Result<(), Error> {
    let refuse = |text: String| Err(Error::Refused(text));
    if film.mu_pa.len() != 1 + film.relaxation_time_s.len() {
        let (m, t) = (film.mu_pa.len(), film.relaxation_time_s.len());
        return refuse(format!(
            "{m} moduli do not fit {t} relaxation times: one more is wanted"
        ));
    }
    if !film
        .relaxation_time_s
        .iter()
        .all(|t| *t > 0.0 && t.is_finite())
    {
        return refuse("relaxation times must be positive".into());
    }
    if film.locking.is_nan() || film.locking <= 0.0 {
        return refuse(format!(
            "the locking constant must be positive, got {}",
            film.locking
        ));
    }
    Ok(())
}

/// Checks the numbers that a simulation is asked for.
fn check(parameters: &Parameters, options: &Options) -> Result<usize, Error> {
    let refuse = |text: String| Err(Error::Refused(text));
    check_film(&parameters.film)?;
    let positive = [
        ("sample step", options.sample_step_s),
        ("tolerance", options.tolerance_m),
        ("longest step", options.longest_step_s),
    ];
    for (name, value) in positive {
        if !(value > 0.0 && value.is_finite()) {
            return refuse(format!("the {name} must be positive, got {value}"));
        }
    }
    if !(options.duration_s >= 0.0 && options.duration_s.is_finite() && options.start_s.is_finite())
    {
        return refuse(format!(
            "a motion of {} s from {} s",
            options.duration_s, options.start_s
        ));
    }
    let samples = (options.duration_s / options.sample_step_s + 1e-9).floor();
    if samples > 1e9 {
        return refuse(format!("{samples} samples are too many"));
    }
    Ok(1 + samples as usize)
}

/// Forward dynamics: the motion of `robot` under `voltage`, from rest unless the options say otherwise.
///
/// # Errors
/// [`Error`] says when and where the motion ends: out of reach, rank lost, snap-through, a locked film, a
/// voltage above the limit, no rest to start from, or no step short enough.
pub fn motion(
    robot: &Robot,
    parameters: &Parameters,
    voltage: &dyn Voltage,
    options: &Options,
    additions: &[&dyn Addition],
) -> Result<Motion, Error> {
    match motion_as_far(robot, parameters, voltage, options, additions)? {
        (motion, None) => Ok(motion),
        (_, Some(error)) => Err(error),
    }
}

/// As [`motion`], but a motion that ends early is given as far as it goes (without its energy), with what
/// ended it.
///
/// # Errors
/// [`Error`] when it does not begin.
pub fn motion_as_far(
    robot: &Robot,
    parameters: &Parameters,
    voltage: &dyn Voltage,
    options: &Options,
    additions: &[&dyn Addition],
) -> Result<(Motion, Option<Error>), Error> {
    let samples = check(parameters, options)?;
    let mut plant = Plant::new(robot, parameters, voltage, options, additions);
    let t0 = options.start_s;
    let phi = plant.command(t0, Side::After)?;
    let payload = options.payload.mass_kg(t0, Side::After);
    let (x, v, films) = match options.start {
        Start::Rest => {
            let rest = rest_at(t0, robot, parameters, phi, payload, additions)?;
            (rest.position_m, [0.0; 3], InitialState::Relaxed)
        }
        Start::From {
            position_m,
            velocity_m_s,
            films,
        } => (position_m, velocity_m_s, films),
    };
    let pose = plant.pose(t0, x)?;
    plant.orientation = rank(&pose.chains).0;
    let softened = match additions.is_empty() && !options.energy {
        true => voltage.softened(plant.largest_jump_v2_s2(&pose, options.tolerance_m)),
        false => None,
    };
    let driving: &dyn Voltage = softened.as_ref().map_or(voltage, |s| s);
    plant.voltage = driving;
    let mut state = plant.state(&pose, x, v, films);
    let films_now = plant.explicit(t0, &pose, &state.w)?;
    let situation = plant.situation(t0, x, v, &pose, &films_now, phi);
    plant.start(&situation, &mut state.z);
    let before = stored(&mut plant, t0, &state, Side::After)?;
    let control = Control {
        scale: plant.scale,
        longest_s: options.longest_step_s,
        shortest_s: 1e-9,
        first_s: 1e-4_f64.min(options.longest_step_s),
    };
    let mut here = state.clone();
    let mut rates = Rates {
        a: [0.0; 3],
        w: state.w.clone(),
        z: state.z.clone(),
        y: Vec::new(),
    };
    let mut out = Motion::with_room(options, samples, films);
    let end = t0 + (samples - 1) as f64 * options.sample_step_s;
    let mut integrator = Integrator::start(&mut plant, t0, state, control)?;
    for i in 0..samples {
        let t = t0 + i as f64 * options.sample_step_s;
        while integrator.time_s() < t {
            if let Err(error) = integrator.step(&mut plant, end) {
                out.effort = integrator.effort;
                return Ok((out, Some(error)));
            }
            let now = integrator.time_s();
            if now < end && plant.payload.next_break_s(integrator.last_start_s()) <= now {
                let jump = plant.payload.mass_kg(now, Side::After)
                    - plant.payload.mass_kg(now, Side::Before);
                let s = integrator.state();
                out.energy.payload_j += jump * (GRAVITY_M_S2 * s.x[2] + 0.5 * dot(s.v, s.v));
            }
        }
        let side = if i == 0 { Side::After } else { Side::Before };
        integrator.at(t, &mut here);
        // The acceleration is that of the voltage as it is.
        plant.voltage = voltage;
        let found = plant.rates(t, side, &here, &mut rates);
        plant.voltage = driving;
        match found {
            Ok(_) => {}
            Err(Trouble::Blocked(e) | Trouble::Fatal(e)) => return Err(e),
            Err(Trouble::Diverged) => return Err(plant.stuck(t, &here)),
        }
        out.position_m.push(here.x);
        out.velocity_m_s.push(here.v);
        out.acceleration_m_s2.push(rates.a);
        out.phi_v.push(voltage.phi_v(t, side));
        out.payload_kg.push(options.payload.mass_kg(t, side));
    }
    out.effort = integrator.effort;
    let after = stored(&mut plant, end, integrator.state(), Side::Before)?;
    out.energy.close(before, after, integrator.quadratures);
    Ok((out, None))
}
