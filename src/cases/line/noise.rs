//! Noise of instruments: white, a little coloured, rounded to a digit.

use super::super::dice::Dice;

/// Noise of one channel.
#[derive(Debug, Clone, Copy)]
pub struct Noise {
    /// Standard deviation.
    pub sd: f64,
    /// Correlation of neighbours.
    pub colour: f64,
    /// Smallest digit; 0: none.
    pub digit: f64,
}

impl Noise {
    /// Half of the channels are white, a quarter a little coloured, a quarter rounded.
    pub fn draw(dice: &mut Dice, sd: f64) -> Self {
        let (kind, colour, digit) = (dice.unit(), dice.range(0.1, 0.3), dice.range(0.8, 2.5));
        Noise {
            sd,
            colour: if (0.5..0.75).contains(&kind) {
                colour
            } else {
                0.0
            },
            digit: if kind >= 0.75 { sd * digit } else { 0.0 },
        }
    }

    /// What the instrument writes of `values`.
    pub fn read(&self, values: &[f64], dice: &mut Dice) -> Vec<f64> {
        let fresh = (1.0 - self.colour * self.colour).sqrt();
        let mut e = self.sd * dice.normal();
        values
            .iter()
            .map(|v| {
                let y = v + e;
                e = self.colour * e + fresh * self.sd * dice.normal();
                if self.digit > 0.0 {
                    (y / self.digit).round() * self.digit
                } else {
                    y
                }
            })
            .collect()
    }
}
