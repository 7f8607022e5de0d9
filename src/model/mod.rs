//! The virtual-work balance of the robot (Eqs 1 to 6, 12 to 14, 24, 25) and what follows from it: inverse
//! dynamics f_ID, force prediction F_FP, and a prediction as a sum of named contributions. The model never
//! looks at a recorded voltage where it predicts one.
//!
//! ```text
//! sum_k (tau_volt_k - tau_film_k) d theta_DEA_k/du - sum_k T(theta_FA_k) d theta_FA_k/du
//!   = (m + m_p)(u'' + g Z) + sum_k m_bc (q^2 theta_b_k'' - g q sin theta_b_k) d theta_b_k/du - F_ext
//! ```
//!
//! With G = [d theta_DEA_1/du, d theta_DEA_2/du, d theta_DEA_3/du] the balance splits into one scalar
//! equation a chain: a torque on the lozenge or the bicep stays in its own chain, a force enters through
//! G^-1. This gives the same numbers as the paper's projection on P_k (Eq 12), because P_k is orthogonal to
//! the other two columns of G.

mod augmented;
mod forearm;
mod mechanics;
mod sample;

pub use crate::dataset::Track;
pub use augmented::others;
pub use forearm::ForearmTorque;
pub use mechanics::{ChainTrack, Contribution, Mechanics, Unreachable};
pub use sample::{Electrode, HangingSample};

use crate::film::Film;
use crate::kinematics::{Chain, FourBar, Lozenge, Mechanism};
use crate::recording::{RobotRig, Stated};

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
    /// Tolerances that the rig states.
    pub tolerances: Vec<Stated>,
}

/// What a calibration finds: everything that a prediction needs beside the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The film.
    pub film: Film,
    /// Spring-back torque of the forearms.
    pub forearm: ForearmTorque,
}

impl Robot {
    /// The robot of a `rig.toml`. `eps_r`, where given (a parameter file's), wins over the rig's.
    ///
    /// # Errors
    /// A sentence when neither states the permittivity.
    pub fn from_rig(rig: &RobotRig, eps_r: Option<f64>) -> Result<Self, String> {
        let mm = 1e-3;
        let eps_r = eps_r.or(rig.film.eps_r).ok_or_else(|| {
            format!(
                "rig `{}` states no relative permittivity and no parameter file gives one: add eps_r under [film]",
                rig.id
            )
        })?;
        let lozenge = Lozenge {
            side_m: rig.actuator.l_dea_mm * mm,
            l1_m: rig.film.L1_mm * mm,
            l2_m: rig.film.L2_mm * mm,
            l3_m: rig.film.L3_mm * mm,
            films: f64::from(rig.actuator.films),
        };
        Ok(Robot {
            mechanism: Mechanism::symmetric(Chain {
                azimuth_rad: 0.0,
                base_radius_m: rig.delta.l_ch_mm * mm,
                effector_radius_m: rig.delta.l_end_mm * mm,
                bicep_m: rig.delta.q_mm * mm,
                forearm_m: rig.delta.n0_mm * mm,
                input_offset_rad: (rig.delta.omega_deg + rig.delta.alpha_deg).to_radians(),
                four_bar: FourBar {
                    a_m: rig.sam.a_mm * mm,
                    b_m: rig.sam.b_mm * mm,
                    c_m: rig.sam.c_mm * mm,
                    d_m: rig.sam.d_mm * mm,
                },
                dea_offset_rad: rig.actuator.dea_offset_deg.to_radians(),
            }),
            lozenges: [lozenge; 3],
            eps_r,
            effector_kg: rig.mass.m_g * 1e-3,
            bicep_tip_kg: rig.mass.m_bc_g * 1e-3,
            tolerances: rig.tolerances.clone(),
        })
    }
}
