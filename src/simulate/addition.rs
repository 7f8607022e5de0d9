//! The hook through which something else acts on the robot: a torque on a lozenge or a bicep, a force on the
//! end effector, another voltage on the film, each possibly with states of its own.

use crate::kinematics::Vec3;

/// What an addition sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Situation {
    /// Time, s.
    pub t_s: f64,
    /// End effector, m.
    pub position_m: Vec3,
    /// Its velocity, m/s.
    pub velocity_m_s: Vec3,
    /// theta_DEA of the three chains, rad.
    pub theta_dea_rad: [f64; 3],
    /// theta_DEA', rad/s.
    pub theta_dea_rate_rad_s: [f64; 3],
    /// theta_b, rad.
    pub theta_b_rad: [f64; 3],
    /// theta_b', rad/s.
    pub theta_b_rate_rad_s: [f64; 3],
    /// lambda_1, lambda_2 of the films.
    pub stretch: [[f64; 2]; 3],
    /// Cauchy stress (sigma_1, sigma_2) that the springs of each film carry, Pa, without the Maxwell stress.
    pub film_stress_pa: [[f64; 2]; 3],
    /// Capacitance of each actuator, F.
    pub capacitance_f: [f64; 3],
    /// Voltage that the amplifier gives, V.
    pub command_v: [f64; 3],
}

/// What additions do; they act one after the other on the same values.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Action {
    /// Voltage on the film, V: begins as the command.
    pub phi_v: [f64; 3],
    /// Torque on theta_DEA, N m, positive where it opens the lozenge's angle.
    pub torque_dea_n_m: [f64; 3],
    /// Torque on theta_b, N m.
    pub torque_b_n_m: [f64; 3],
    /// Force on the end effector, N, world axes.
    pub force_n: Vec3,
}

/// Something else that acts on the robot. It must be a continuous function of what it sees (a dry friction is
/// regularised); it may be stiff. Its derivatives are taken by differences.
pub trait Addition {
    /// Number of its own states.
    fn states(&self) -> usize {
        0
    }
    /// Its states with the robot at rest in `situation`.
    fn start(&self, _situation: &Situation, _states: &mut [f64]) {}
    /// A typical size of its state `i`: the unit in which its error is measured.
    fn scale(&self, _i: usize) -> f64 {
        1.0
    }
    /// Adds its torques and forces to `action`, may change the voltage there, and writes the rates of its
    /// states.
    fn act(&self, situation: &Situation, states: &[f64], action: &mut Action, rates: &mut [f64]);
    /// The first time after `t_s` at which it jumps.
    fn next_break_s(&self, _t_s: f64) -> f64 {
        f64::INFINITY
    }
}
