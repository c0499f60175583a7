//! Symmetric systems that are banded but for a few bordering unknowns.
//!
//! A spline's normal equations couple a control point with three on each side; poses and radius are coupled with all of
//! them. Eliminating the band first leaves a small dense system for the border, so the cost grows with the length of
//! the rope and not with its square.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::simd::kernel;

/// Entries of a row left of and on the diagonal: three control points and its own coordinates.
pub const WIDTH: usize = 12;

/// The lower half of a symmetric matrix [[A, C], [Cᵀ, D]], A banded with n rows, D dense with m.
#[derive(Debug, Clone)]
pub struct Bordered {
    /// Row i of A: columns i + 1 − WIDTH to i.
    band: Vec<[f64; WIDTH]>,
    /// C, row by row.
    border: Vec<f64>,
    corner: DMatrix<f64>,
}

/// A factored [`Bordered`].
pub struct Factor {
    /// L of A = L Lᵀ, with the reciprocals of its diagonal.
    band: Vec<[f64; WIDTH]>,
    /// W = L⁻¹ C, row by row.
    border: Vec<f64>,
    /// Of the Schur complement D − Wᵀ W.
    corner: Cholesky<f64, Dyn>,
}

impl Bordered {
    /// A zero matrix with `n` banded and `m` bordering rows.
    pub fn zeros(n: usize, m: usize) -> Self {
        Self { band: vec![[0.0; WIDTH]; n], border: vec![0.0; n * m], corner: DMatrix::zeros(m, m) }
    }

    /// Adds to an entry of A; `row` ≥ `column` > `row` − WIDTH.
    #[inline]
    pub fn add_band(&mut self, row: usize, column: usize, value: f64) {
        self.band[row][column + WIDTH - 1 - row] += value;
    }

    /// Adds to neighbouring entries of a row of C, from a column on.
    #[inline]
    pub fn add_border(&mut self, row: usize, column: usize, values: &[f64]) {
        let start = row * self.corner.nrows() + column;
        for (entry, value) in self.border[start..start + values.len()].iter_mut().zip(values) {
            *entry += value;
        }
    }

    /// Adds to an entry of D on or below its diagonal.
    #[inline]
    pub fn add_corner(&mut self, row: usize, column: usize, value: f64) {
        self.corner[(row, column)] += value;
    }

    /// Cholesky factors; none if the matrix is not positive definite.
    pub fn factor(mut self) -> Option<Factor> {
        let m = self.corner.nrows();
        // row by row
        let mut taken = vec![0.0; m * m];
        if !eliminate(&mut self.band, &mut self.border, &mut taken) {
            return None;
        }
        for a in 0..m {
            for b in 0..=a {
                self.corner[(a, b)] -= taken[a * m + b];
            }
        }
        Some(Factor { band: self.band, border: self.border, corner: self.corner.cholesky()? })
    }
}

kernel! {
    /// Turns A into L, C into W and adds the lower half of WᵀW to `product`; says whether A is positive definite.
    fn eliminate<S>(_, band: &mut [[f64; WIDTH]], border: &mut [f64], product: &mut [f64]) -> bool {
        let m = border.len() / band.len().max(1);
        for i in 0..band.len() {
            let low = i.saturating_sub(WIDTH - 1);
            let (above, rest) = band.split_at_mut(i);
            let row = &mut rest[0];
            for j in low..i {
                let start = low.max(j.saturating_sub(WIDTH - 1));
                let mut sum = row[j + WIDTH - 1 - i];
                for k in start..j {
                    sum -= row[k + WIDTH - 1 - i] * above[j][k + WIDTH - 1 - j];
                }
                // the diagonal holds reciprocals
                row[j + WIDTH - 1 - i] = sum * above[j][WIDTH - 1];
            }
            let left: f64 = row[low + WIDTH - 1 - i..WIDTH - 1].iter().map(|l| l * l).sum();
            let square = row[WIDTH - 1] - left;
            if square <= 0.0 || !square.is_finite() {
                return false;
            }
            row[WIDTH - 1] = square.sqrt().recip();
            let (done, rest) = border.split_at_mut(i * m);
            let edge = &mut rest[..m];
            for k in low..i {
                let l = row[k + WIDTH - 1 - i];
                for (x, above) in edge.iter_mut().zip(&done[k * m..(k + 1) * m]) {
                    *x -= l * above;
                }
            }
            for x in edge.iter_mut() {
                *x *= row[WIDTH - 1];
            }
            for a in 0..m {
                let x = edge[a];
                for (sum, y) in product[a * m..=a * m + a].iter_mut().zip(&edge[..=a]) {
                    *sum += x * y;
                }
            }
        }
        true
    }
}

impl Factor {
    /// Solves for a right-hand side: the unknowns of the band, and those of the border.
    pub fn solve(&self, band: &[f64], border: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (n, m) = (band.len(), border.len());
        let mut x = band.to_vec();
        // zeros before the first other entry stay zeros
        let start = x.iter().position(|&value| value != 0.0).unwrap_or(n);
        for i in start..n {
            for k in i.saturating_sub(WIDTH - 1)..i {
                x[i] -= self.band[i][k + WIDTH - 1 - i] * x[k];
            }
            x[i] *= self.band[i][WIDTH - 1];
        }
        let mut rest = DVector::from_column_slice(border);
        for i in start..n {
            for a in 0..m {
                rest[a] -= self.border[i * m + a] * x[i];
            }
        }
        let y = self.corner.solve(&rest);
        for i in 0..n {
            for a in 0..m {
                x[i] -= self.border[i * m + a] * y[a];
            }
        }
        for i in (0..n).rev() {
            x[i] *= self.band[i][WIDTH - 1];
            let value = x[i];
            for k in i.saturating_sub(WIDTH - 1)..i {
                x[k] -= self.band[i][k + WIDTH - 1 - i] * value;
            }
        }
        (x, y.iter().copied().collect())
    }

    /// The corner of the matrix' inverse.
    pub fn border_inverse(&self) -> DMatrix<f64> {
        self.corner.inverse()
    }

    /// The inverse of the matrix: the entries where A has its band, laid out as A is, and the corner.
    ///
    /// Of A alone by Takahashi's recurrence, which needs no entry outside the band; the border adds
    /// (A⁻¹C) S⁻¹ (A⁻¹C)ᵀ, S the Schur complement.
    pub fn inverse(&self) -> (Vec<[f64; WIDTH]>, DMatrix<f64>) {
        let m = self.corner.l_dirty().nrows();
        let mut inverse = vec![[0.0; WIDTH]; self.band.len()];
        let mut rows = self.border.clone();
        invert(&self.band, &mut inverse, &mut rows);
        let lower = self.corner.l();
        for row in rows.chunks_exact_mut(m.max(1)) {
            for a in 0..m {
                let known: f64 = (0..a).map(|b| lower[(a, b)] * row[b]).sum();
                row[a] = (row[a] - known) / lower[(a, a)];
            }
        }
        for (i, entries) in inverse.iter_mut().enumerate().filter(|_| m > 0) {
            for j in i.saturating_sub(WIDTH - 1)..=i {
                let (x, y) = (&rows[i * m..(i + 1) * m], &rows[j * m..(j + 1) * m]);
                entries[j + WIDTH - 1 - i] += x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>();
            }
        }
        (inverse, self.border_inverse())
    }
}

/// The entries of (LLᵀ)⁻¹ inside the band, and L⁻ᵀW in the place of W.
fn invert(band: &[[f64; WIDTH]], inverse: &mut [[f64; WIDTH]], rows: &mut [f64]) {
    let n = band.len();
    let m = rows.len() / n.max(1);
    for i in (0..n).rev() {
        let scale = band[i][WIDTH - 1];
        let end = n.min(i + WIDTH);
        for j in (i..end).rev() {
            let mut sum = if i == j { scale } else { 0.0 };
            for k in i + 1..end {
                let (late, early) = (k.max(j), k.min(j));
                sum -= band[k][i + WIDTH - 1 - k] * inverse[late][early + WIDTH - 1 - late];
            }
            inverse[j][i + WIDTH - 1 - j] = sum * scale;
        }
        let (first, later) = rows.split_at_mut((i + 1) * m);
        let row = &mut first[i * m..];
        for k in i + 1..end {
            let l = band[k][i + WIDTH - 1 - k];
            for (x, below) in row.iter_mut().zip(&later[(k - i - 1) * m..(k - i) * m]) {
                *x -= l * below;
            }
        }
        for x in row.iter_mut() {
            *x *= scale;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_solution_satisfies_the_dense_system(n in 1usize..60, m in 0usize..6, seed in 0u64..1000) {
            let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) + 1;
            let mut random = || {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
            };
            let mut matrix = Bordered::zeros(n, m);
            let mut dense = DMatrix::<f64>::zeros(n + m, n + m);
            for i in 0..n + m {
                for j in 0..=i {
                    let mut value = random();
                    if i == j {
                        value += 20.0;
                    }
                    if i >= n && j >= n {
                        matrix.add_corner(i - n, j - n, value);
                    } else if i >= n {
                        matrix.add_border(j, i - n, &[value]);
                    } else if i - j < WIDTH {
                        matrix.add_band(i, j, value);
                    } else {
                        continue;
                    }
                    dense[(i, j)] = value;
                    dense[(j, i)] = value;
                }
            }
            let right = DVector::from_fn(n + m, |_, _| random());
            let factor = matrix.factor().unwrap();
            let (x, y) = factor.solve(&right.as_slice()[..n], &right.as_slice()[n..]);
            let solution = DVector::from_iterator(n + m, x.into_iter().chain(y));
            prop_assert!((&dense * solution - right).amax() < 1e-12);
            let inverse = dense.try_inverse().unwrap();
            let (band, corner) = factor.inverse();
            for i in 0..n {
                for j in i.saturating_sub(WIDTH - 1)..=i {
                    prop_assert!((band[i][j + WIDTH - 1 - i] - inverse[(i, j)]).abs() < 1e-12);
                }
            }
            prop_assert!((corner - inverse.view((n, n), (m, m))).amax() < 1e-12 || m == 0);
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_has_no_factor() {
        let mut matrix = Bordered::zeros(3, 0);
        for i in 0..3 {
            matrix.add_band(i, i, if i == 1 { -1.0 } else { 1.0 });
        }
        assert!(matrix.factor().is_none());
    }
}
