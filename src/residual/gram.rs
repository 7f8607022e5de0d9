//! Vector kernels of the residual pass: filtering rows, and adding blocks of rows to a Gram matrix. Chosen
//! for the machine's vectors when the program runs.

use pulp::{Arch, Simd, WithSimd};

/// Columns are padded to a multiple of this.
pub const PAD: usize = 8;

/// Columns that are filtered together: enough independent sums to hide the latency of an addition. Rows to be
/// filtered are padded to a multiple of this.
pub const STRIP: usize = 24;

/// Filters consecutive rows: `out[j]` = sum over taps of `weights[t]` * `rows[first[j] + t]`, row by row of
/// `width` numbers.
///
/// # Panics
/// When `width` is no multiple of [`STRIP`], as the width of the film kernel's rows is.
pub fn filter_rows(
    arch: Arch,
    weights: &[f64],
    rows: &[f64],
    width: usize,
    first: &[usize],
    out: &mut [f64],
) {
    assert!(width.is_multiple_of(STRIP));
    arch.dispatch(Filter {
        weights,
        rows,
        width,
        first,
        out,
    });
}

struct Filter<'a> {
    weights: &'a [f64],
    rows: &'a [f64],
    width: usize,
    first: &'a [usize],
    out: &'a mut [f64],
}

impl WithSimd for Filter<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.width;
        let taps = self.weights.len();
        let vectors = STRIP / S::F64_LANES;
        for (&first, out) in self.first.iter().zip(self.out.chunks_exact_mut(width)) {
            let window = &self.rows[first * width..(first + taps) * width];
            let mut column = 0;
            while column < width {
                // even and odd taps apart
                let mut even = [simd.splat_f64s(0.0); STRIP];
                let mut odd = even;
                let mut pairs = window.chunks_exact(2 * width);
                let mut weights = self.weights.chunks_exact(2);
                for (rows, w) in (&mut pairs).zip(&mut weights) {
                    let (w0, w1) = (simd.splat_f64s(w[0]), simd.splat_f64s(w[1]));
                    let (row0, _) = S::as_simd_f64s(&rows[column..column + STRIP]);
                    let (row1, _) = S::as_simd_f64s(&rows[width + column..width + column + STRIP]);
                    for v in 0..vectors {
                        even[v] = simd.mul_add_e_f64s(w0, row0[v], even[v]);
                        odd[v] = simd.mul_add_e_f64s(w1, row1[v], odd[v]);
                    }
                }
                for (row, w) in pairs
                    .remainder()
                    .chunks_exact(width)
                    .zip(weights.remainder())
                {
                    let w = simd.splat_f64s(*w);
                    let (row, _) = S::as_simd_f64s(&row[column..column + STRIP]);
                    for v in 0..vectors {
                        even[v] = simd.mul_add_e_f64s(w, row[v], even[v]);
                    }
                }
                let (out, _) = S::as_mut_simd_f64s(&mut out[column..column + STRIP]);
                for v in 0..vectors {
                    out[v] = simd.add_f64s(even[v], odd[v]);
                }
                column += STRIP;
            }
        }
    }
}

/// Adds `rows` (each `width` numbers, a multiple of 8) to the lower triangle (by blocks of 8) of the `width`
/// x `width` matrix `gram`.
///
/// # Panics
/// When `width` is no multiple of [`PAD`], or `gram` has another size.
pub fn add_rows(arch: Arch, rows: &[f64], width: usize, gram: &mut [f64]) {
    assert!(width.is_multiple_of(PAD) && gram.len() == width * width);
    arch.dispatch(AddRows { rows, width, gram });
}

struct AddRows<'a> {
    rows: &'a [f64],
    width: usize,
    gram: &'a mut [f64],
}

/// Rows of the matrix that are worked on together.
const TILE: usize = 4;

impl WithSimd for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let width = self.width;
        let vectors = PAD / S::F64_LANES;
        for i in (0..width).step_by(TILE) {
            for j in (0..=i).step_by(PAD) {
                let mut sum = [[simd.splat_f64s(0.0); PAD]; TILE];
                for row in self.rows.chunks_exact(width) {
                    let (b, _) = S::as_simd_f64s(&row[j..j + PAD]);
                    for k in 0..TILE {
                        let a = simd.splat_f64s(row[i + k]);
                        for v in 0..vectors {
                            sum[k][v] = simd.mul_add_e_f64s(a, b[v], sum[k][v]);
                        }
                    }
                }
                for k in 0..TILE {
                    let at = (i + k) * width + j;
                    let (g, _) = S::as_mut_simd_f64s(&mut self.gram[at..at + PAD]);
                    for v in 0..vectors {
                        g[v] = simd.add_f64s(g[v], sum[k][v]);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_and_filters_agree_with_plain_loops() {
        let width = 24;
        let rows: Vec<f64> = (0..width * 50)
            .map(|i| ((i * 7919) % 101) as f64 * 0.01 - 0.5)
            .collect();
        let mut gram = vec![0.0; width * width];
        add_rows(Arch::new(), &rows, width, &mut gram);
        for i in 0..width {
            for j in 0..=i {
                let want: f64 = rows.chunks(width).map(|r| r[i] * r[j]).sum();
                assert!((gram[i * width + j] - want).abs() < 1e-12);
            }
        }
        let weights = [0.25, 0.5, -0.1];
        let mut out = vec![0.0; 2 * width];
        filter_rows(Arch::new(), &weights, &rows, width, &[0, 7], &mut out);
        for (n, first) in [0, 7].into_iter().enumerate() {
            for c in 0..width {
                let want: f64 = (0..3)
                    .map(|t| weights[t] * rows[(first + t) * width + c])
                    .sum();
                assert!((out[n * width + c] - want).abs() < 1e-14);
            }
        }
    }
}
