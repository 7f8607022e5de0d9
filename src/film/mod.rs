//! The film: Gent springs, Bergstrom-Boyce branches, Maxwell stress. This room has never heard of the robot.
//!
//! Equations 4 and 18 to 23 of the paper, with the slips of its Eq 20 corrected (see `ARCHITECTURE.md`):
//!
//! ```text
//! A = (lambda_1/xi_1)^2,  B = (lambda_2/xi_2)^2,  C = 1/(A B),  D = 1 - (A + B + C - 3)/J
//! W   = - sum_n (mu_n J/2) ln D_n                              free energy density, J/m^3
//! s_1 = mu (A - C)/D,  s_2 = mu (B - C)/D                      Cauchy stress contributions, Pa
//! d ln(xi_1)/dt = (s_1 - s_2/2)/(3 eta),  eta_n = mu_n T_n     (and with 1, 2 exchanged)
//! ```
//!
//! mu cancels in the flow rule: the inelastic history depends on the relaxation times and J only, never on
//! the moduli.

pub mod kernel;
mod reference;

pub use reference::{ReferenceState, integrate_reference};

/// The film's own parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Film {
    /// Moduli of the n + 1 springs, Pa, the equilibrium spring first.
    pub mu_pa: Vec<f64>,
    /// Relaxation times of the n branches, s.
    pub relaxation_time_s: Vec<f64>,
    /// Locking constant J of the Gent springs, dimensionless.
    pub locking: f64,
}

/// State of the film at the first sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InitialState {
    /// Every branch relaxed: xi = lambda.
    Relaxed,
    /// Never stretched before: xi = 1.
    Virgin,
}

/// A state that the film cannot be in: a spring at or past its locking stretch (D <= 0, where the Gent stress
/// has no value), or a pose that the mechanism cannot reach.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "{}{}",
    match spring {
        0 => "the mechanism cannot reach the pose of the recording".to_owned(),
        _ => format!(
            "the film is at its locking stretch: spring {spring} needs A + B + C - 3 = {invariant:.4}, at or above J = {locking:.4}"
        ),
    },
    at_s.map(|t| format!(", at {t:.3} s")).unwrap_or_default()
)]
pub struct Locked {
    /// Spring number, 1 = equilibrium spring; 0 where no film can be, because the mechanism cannot reach the
    /// pose.
    pub spring: usize,
    /// A + B + C - 3 there.
    pub invariant: f64,
    /// The locking constant J.
    pub locking: f64,
    /// Time on the recording's clock where it happens, s, where known.
    pub at_s: Option<f64>,
}

/// Cauchy stress of a Gent spring over its modulus, (s_1, s_2)/mu, and D, for squared elastic stretches `a`,
/// `b` (Eq 23).
///
/// # Errors
/// A + B + C - 3 when it reaches `locking` (D <= 0).
pub fn gent_stress(a: f64, b: f64, locking: f64) -> Result<([f64; 2], f64), f64> {
    let c = 1.0 / (a * b);
    let invariant = a + b + c - 3.0;
    let d = 1.0 - invariant / locking;
    if d > 0.0 {
        Ok(([(a - c) / d, (b - c) / d], d))
    } else {
        Err(invariant)
    }
}

impl Film {
    /// Number of viscoelastic branches.
    pub fn branches(&self) -> usize {
        self.relaxation_time_s.len()
    }

    /// Cauchy stress (sigma_1, sigma_2), Pa, and free energy density, J/m^3, for stretches `lambda` and the
    /// inelastic stretches `xi` of the branches (rows of 2).
    ///
    /// # Errors
    /// [`Locked`] names the spring.
    pub fn stress_pa(&self, lambda: [f64; 2], xi: &[[f64; 2]]) -> Result<([f64; 2], f64), Locked> {
        let mut sigma = [0.0; 2];
        let mut energy = 0.0;
        for (n, &mu) in self.mu_pa.iter().enumerate() {
            let x = if n == 0 { [1.0, 1.0] } else { xi[n - 1] };
            let (a, b) = ((lambda[0] / x[0]).powi(2), (lambda[1] / x[1]).powi(2));
            let (s, d) = gent_stress(a, b, self.locking).map_err(|invariant| Locked {
                spring: n + 1,
                invariant,
                locking: self.locking,
                at_s: None,
            })?;
            sigma[0] += mu * s[0];
            sigma[1] += mu * s[1];
            energy -= 0.5 * mu * self.locking * d.ln();
        }
        Ok((sigma, energy))
    }
}
