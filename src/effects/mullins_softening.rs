//! Below the largest strain energy reached so far the film is softer (Ogden and Roxburgh 1999):  the stress
//! of the equilibrium spring is multiplied by 1 - r erf((W_max - W)/m), W its energy density, W_max the
//! largest in this recording.

use statrs::function::erf::erf;

use super::{Along, Effect, Exercise, Memory, Part, Quantity, Reach, Seen, Site, shape, size};
use crate::film::Film;

pub struct MullinsSoftening;

impl Effect for MullinsSoftening {
    fn id(&self) -> &'static str {
        "mullins_softening"
    }
    fn says(&self) -> &'static str {
        "the film is softer below the largest stretch that it has seen"
    }
    fn source(&self) -> &'static str {
        "Ogden and Roxburgh 1999, pseudo-elasticity"
    }
    fn equation(&self) -> &'static str {
        "stress of the equilibrium spring times 1 - softening erf((W_max - W)/energy_scale), W its \
         energy density"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["slow branches of the film", "temperature_drift"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Film
    }
    // Energies of the film between rest and full stroke are of the order of 1e5 J/m^3.
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("softening", "1", 0.0, 0.8, 0.15),
                shape("energy_scale", "J/m^3", 4e4, 3e2, 5e5, 5e4),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Film
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        [2e3, 1e4, 4e4, 1.5e5]
            .iter()
            .map(|&m| vec![vec![0.02, m]])
            .collect()
    }
    fn brought_out_by(&self) -> &'static str {
        "a staircase of amplitudes, each repeated"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Again, Exercise::Staircase]
    }
    fn memory(&self) -> Memory<'_> {
        Memory::LargestEnergy
    }
    fn stress(&self, v: &[f64], along: &Along, film: &Film, factor: &mut [[f64; 2]]) {
        if v[0] == 0.0 {
            return;
        }
        let mut largest = f64::NEG_INFINITY;
        for (i, f) in factor.iter_mut().enumerate() {
            let [a, b] = along
                .lozenge
                .stretches(along.theta_dea_rad[i])
                .map(|l| l * l);
            let d = 1.0 - (a + b + 1.0 / (a * b) - 3.0) / film.locking;
            let w = -0.5 * film.mu_pa[0] * film.locking * d.max(1e-9).ln();
            largest = largest.max(w);
            f[0] *= 1.0 - v[0] * erf((largest - w) / v[1]);
        }
    }
}
