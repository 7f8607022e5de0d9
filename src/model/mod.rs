//! The virtual-work balance of the robot (Eqs 1 to 6, 12 to 14, 24, 25) and what follows from it: inverse dynamics
//! f_ID, force prediction F_FP, and a prediction as a sum of named contributions. The model never looks at a recorded
//! voltage where it predicts one.
//!
//! ```text
//! sum_k (tau_volt_k - tau_film_k) d theta_DEA_k/du - sum_k T(theta_FA_k) d theta_FA_k/du
//!   = (m + m_p)(u'' + g Z) + sum_k m_bc (q^2 theta_b_k'' - g q sin theta_b_k) d theta_b_k/du - F_ext
//! ```
//!
//! With G = [d theta_DEA_1/du, d theta_DEA_2/du, d theta_DEA_3/du] the balance splits into one scalar equation a chain: a torque
//! on the lozenge or the bicep stays in its own chain, a force enters through G^-1. This gives the same numbers as the
//! paper's projection on P_k (Eq 12), because P_k is orthogonal to the other two columns of G.

mod forearm;
mod mechanics;

pub use forearm::ForearmTorque;
pub use mechanics::{ChainTrack, Contribution, Mechanics, Track, Unreachable};

use crate::film::Film;
use crate::kinematics::{Lozenge, Mechanism};

/// What the user knows of a robot: geometry and masses, SI.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Links and four-bars.
    pub mechanism: Mechanism,
    /// Lozenge and unstretched film of each chain.
    pub lozenges: [Lozenge; 3],
    /// Relative permittivity of the film.
    pub eps_r: f64,
    /// m: end effector with forearms, kg.
    pub effector_kg: f64,
    /// m_bc: point mass at each bicep tip, kg.
    pub bicep_tip_kg: f64,
}

/// What a calibration finds: everything that a prediction needs beside the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The film.
    pub film: Film,
    /// Spring-back torque of the forearms.
    pub forearm: ForearmTorque,
}

mod sample;
pub use sample::HangingSample;
