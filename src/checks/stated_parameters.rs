//! Numbers of a parameter file that cannot be: MPa for Pa, a film that locks at once. (The file itself
//! refuses what is below zero.)

use super::stated::PERMITTIVITY;
use super::view::short;
use super::{Finding, Grade};
use crate::model::Parameters;

/// Moduli of springs that a film has, Pa, all of them together: gels from 1 kPa, rubbers to 100 MPa.
const MODULUS_PA: [f64; 2] = [500.0, 3e8];
/// Smallest J: (lambda_1^2 + ... - 3) at which a film locks; below, none could be stretched as it is for an
/// actuator.
const LOCKING: f64 = 0.1;

/// Largest torque of a forearm's hinges, N m: five orders above those of the robots that this is for.
const TORQUE_N_M: f64 = 100.0;

/// What cannot be about the numbers of film and forearm, and the film's permittivity; `name` is the file's.
#[must_use]
pub fn check_parameters(name: &str, parameters: &Parameters, eps_r: Option<f64>) -> Vec<Finding> {
    let film = &parameters.film;
    let mut out = Vec::new();
    let mut add = |says: String, remedy: &str| {
        out.push(Finding {
            check: "stated_value",
            grade: Grade::Wrong,
            recording: String::new(),
            says,
            remedy: remedy.into(),
            p_value: f64::NAN,
        });
    };
    let sum: f64 = film.mu_pa.iter().sum();
    if !(MODULUS_PA[0]..=MODULUS_PA[1]).contains(&sum) {
        add(
            format!(
                "{name}: the moduli mu_Pa add up to {} Pa, which no elastomer film has (1 kPa to 100 MPa)",
                short(sum)
            ),
            if sum < 1e3 {
                "state them in Pa and not in MPa"
            } else {
                "state them in Pa"
            },
        );
    }
    if let Some(eps_r) = eps_r.filter(|e| !(PERMITTIVITY[0]..=PERMITTIVITY[1]).contains(e)) {
        let [low, high] = PERMITTIVITY;
        add(
            format!(
                "{name}: eps_r = {} is no permittivity of a film relative to vacuum, {low} to {high}",
                short(eps_r)
            ),
            "state the relative permittivity, about 3 for silicone and 5 for acrylic",
        );
    }
    if film.locking < LOCKING {
        add(
            format!(
                "{name}: J = {} locks the film before it is stretched",
                film.locking
            ),
            "state the locking constant J of Gent's law, 1 to 1000",
        );
    }
    if let Some(torque) = parameters
        .forearm
        .torque_n_m()
        .iter()
        .find(|t| t.abs() > TORQUE_N_M)
    {
        add(
            format!(
                "{name}: {torque:e} N m is among torque_N_m, and no forearm's hinge has more than {TORQUE_N_M} N m"
            ),
            "state the spring-back torque in N m",
        );
    }
    for (i, t) in film.relaxation_time_s.iter().enumerate() {
        if *t <= 0.0 || *t > 1e9 {
            add(
                format!("{name}: relaxation time {} of T_s is {}", i + 1, short(*t)),
                "state them in s, above zero",
            );
        }
    }
    out
}
