//! Whitened columns after the weights have been set anew: the same torques, on the scale of the new noise.

use super::problem::Problem;
use super::scan::{Group, Unit};
use super::subject::Subject;

/// The weights of every kept sample, before they are set anew.
pub(super) struct Before(Vec<[f64; 6]>);

/// From one whitening to another: lower triangles, a kept sample each.
pub(super) struct Change(Vec<[f64; 6]>, usize);

fn weights<S: Subject>(problem: &Problem<S>) -> Vec<[f64; 6]> {
    (0..problem.train_when.len())
        .flat_map(|number| problem.train.whitening(number))
        .collect()
}

impl Before {
    /// Remembers the weights as they are.
    pub fn new<S: Subject>(problem: &Problem<S>) -> Self {
        Before(weights(problem))
    }

    /// What the weights have become since.
    pub fn change<S: Subject>(&self, problem: &Problem<S>) -> Change {
        let triangles = self
            .0
            .iter()
            .zip(weights(problem))
            .map(|(old, new)| product(&new, &inverse(old)))
            .collect();
        Change(triangles, S::CHAINS)
    }
}

/// Inverse of a lower triangle: 11, 21, 22, 31, 32, 33.
fn inverse(w: &[f64; 6]) -> [f64; 6] {
    let (a, b, c) = (1.0 / w[0], 1.0 / w[2], 1.0 / w[5]);
    let l10 = -w[1] * a * b;
    let l21 = -w[4] * b * c;
    let l20 = -(w[3] * a + w[4] * l10) * c;
    [a, l10, b, l20, l21, c]
}

/// Product of two lower triangles.
fn product(w: &[f64; 6], l: &[f64; 6]) -> [f64; 6] {
    [
        w[0] * l[0],
        w[1] * l[0] + w[2] * l[1],
        w[2] * l[2],
        w[3] * l[0] + w[4] * l[1] + w[5] * l[3],
        w[4] * l[2] + w[5] * l[4],
        w[5] * l[5],
    ]
}

impl Change {
    fn apply(&self, column: &mut [f64]) {
        if self.1 == 1 {
            for (y, m) in column.iter_mut().zip(&self.0) {
                *y *= m[0];
            }
            return;
        }
        for (y, m) in column.chunks_exact_mut(3).zip(&self.0) {
            let (a, b, c) = (y[0], y[1], y[2]);
            y[0] = m[0] * a;
            y[1] = m[1] * a + m[2] * b;
            y[2] = m[3] * a + m[4] * b + m[5] * c;
        }
    }

    /// Puts all fingerprints on the new scale.
    pub fn of(&self, groups: &mut [Group], units: &mut [Unit]) {
        for g in groups {
            g.change(|column| self.apply(column));
        }
        for u in units {
            self.apply(&mut u.column);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back_is_the_same() {
        let w = [2.0, 0.3, 1.5, -0.4, 0.2, 0.7];
        let one = product(&w, &inverse(&w));
        for (i, x) in one.iter().enumerate() {
            let want = if [0, 2, 5].contains(&i) { 1.0 } else { 0.0 };
            assert!((x - want).abs() < 1e-14);
        }
    }
}
