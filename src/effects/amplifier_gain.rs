//! The amplifier's gain or offset is wrong:  phi = (1 + e) phi_c + offset. The offset fades out below 50 V:
//! an amplifier that is told zero gives zero.

use super::{Along, Effect, Exercise, Part, Quantity, Reach, Seen, Site, size};

pub struct AmplifierGain;

/// Command at which half of the offset is there, V.
const FADE_V: f64 = 50.0;

impl Effect for AmplifierGain {
    fn id(&self) -> &'static str {
        "amplifier_gain"
    }
    fn says(&self) -> &'static str {
        "the amplifier gives another voltage than it is told: its gain or its offset is off"
    }
    fn source(&self) -> &'static str {
        "definition of gain and offset error"
    }
    fn equation(&self) -> &'static str {
        "phi = (1 + gain_error) phi_c + offset sign(phi_c) (1 - e^(-(phi_c/50 V)^2))"
    }
    fn taken_for(&self) -> &'static [&'static str] {
        &["permittivity_stretch", "all moduli scaled together"]
    }
    fn part(&self, _: &[f64]) -> Part {
        Part::Amplifier
    }
    fn parameters(&self) -> &'static [Quantity] {
        const {
            &[
                size("gain_error", "1", -0.4, 0.4, 0.06),
                size("offset", "V", -400.0, 400.0, 60.0),
            ]
        }
    }
    fn site(&self) -> Site {
        Site::Electrical
    }
    fn reach(&self) -> Reach {
        Reach::AllOrOne
    }
    fn starts(&self, _: &Seen) -> Vec<Vec<Vec<f64>>> {
        vec![vec![vec![0.01, 0.0], vec![0.0, 10.0]]]
    }
    fn share_of_made(&self, v: &[f64]) -> f64 {
        2.0 * v[0]
    }
    fn scales_made(&self) -> bool {
        true
    }
    fn brought_out_by(&self) -> &'static str {
        "a known payload on and off under the same voltages, and the amplifier's own monitor output"
    }
    fn exercises(&self) -> &'static [Exercise] {
        &[Exercise::Staircase, Exercise::Corners]
    }
    fn voltage(&self, v: &[f64], _: &Along, phi_v: &mut [f64]) {
        for phi in phi_v {
            let fade = 1.0 - (-(*phi / FADE_V).powi(2)).exp();
            *phi += v[0] * *phi + v[1] * fade * phi.signum();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_the_gain_is_two_of_the_torque() {
        let v = [1e-4, 0.0];
        let share = AmplifierGain.share_of_made(&v);
        assert!(((1.0 + v[0]).powi(2) - 1.0 - share).abs() < 1e-7);
        let scales: Vec<_> = crate::effects::CATALOGUE
            .iter()
            .filter(|e| e.scales_made())
            .map(|e| e.id())
            .collect();
        assert!(scales.contains(&AmplifierGain.id()) && !scales.contains(&"slow_creep"));
        assert!(crate::effects::ThicknessError.scales_made());
    }
}
