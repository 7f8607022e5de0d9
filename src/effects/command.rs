//! From the voltage on the film back to the command: what an amplifier must be told so that the electrical
//! chain makes it.

use super::{Acting, Along};

/// Iterations of an effect with memory: phi_c <- phi_c + (phi - E(phi_c)), which never overshoots a low-pass.
const ROUNDS: usize = 60;
/// Bisections of an effect without memory.
const HALVINGS: usize = 48;
/// Largest command that is looked for, V.
const HIGHEST_V: f64 = 20_000.0;
/// What is left of a voltage where the command counts as found: V, and share of it.
const LEFT: (f64, f64) = (2.0, 2e-3);

/// The command at which `effects` (in the order in which they act) make `film_v`, V, sample by sample; NaN
/// where none does: above a ceiling, steeper than a limit. `film_v` is not negative.
pub fn command_for(effects: &[&Acting], along: &Along, film_v: &[f64]) -> Vec<f64> {
    let mut out = film_v.to_vec();
    for acting in effects.iter().rev() {
        let wanted: Vec<f64> = out
            .iter()
            .map(|v| if v.is_nan() { 0.0 } else { *v })
            .collect();
        let apply = |told: &[f64]| {
            let mut made = told.to_vec();
            acting.effect.voltage(&acting.values, along, &mut made);
            made
        };
        let told = if acting.effect.remembers() {
            // Where the sign of the command is lost, a negative one makes as much as its opposite: none is
            // looked for.
            let opposite: Vec<f64> = wanted.iter().map(|w| -w).collect();
            let signed = apply(&opposite).iter().any(|made| *made < 0.0);
            let lowest_v = if signed { -HIGHEST_V } else { 0.0 };
            let mut told = wanted.clone();
            for _ in 0..ROUNDS {
                let made = apply(&told);
                for ((t, w), m) in told.iter_mut().zip(&wanted).zip(made) {
                    *t = (*t + w - m).clamp(lowest_v, HIGHEST_V);
                }
            }
            told
        } else {
            let mut low = vec![0.0; wanted.len()];
            let mut high = vec![HIGHEST_V; wanted.len()];
            for _ in 0..HALVINGS {
                let middle: Vec<f64> = low.iter().zip(&high).map(|(a, b)| 0.5 * (a + b)).collect();
                for (i, made) in apply(&middle).into_iter().enumerate() {
                    let side = if made < wanted[i] {
                        &mut low
                    } else {
                        &mut high
                    };
                    side[i] = middle[i];
                }
            }
            high
        };
        let made = apply(&told);
        for (i, o) in out.iter_mut().enumerate() {
            let found = (made[i] - wanted[i]).abs() <= LEFT.0 + LEFT.1 * wanted[i];
            *o = if o.is_nan() || !found {
                f64::NAN
            } else {
                told[i]
            };
        }
    }
    out
}
