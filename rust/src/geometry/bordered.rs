//! Symmetric linear systems that are banded except for a few bordering unknowns.
//!
//! A spline's normal equations couple a control point with three on each side. Poses and radius are coupled with all
//! control points. The solver eliminates the band first and leaves a small dense system for the border. So the cost
//! grows linearly with the length of the rope.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::simd::{LANES, kernel};

/// Entries of a row up to its diagonal: three control points before it, and its own coordinates.
pub const WIDTH: usize = 12;
const ROWS_AT_ONCE: usize = 4; // rows that are factored together
/// Border unknowns up to which factors are made row by row, and solve steps; more are solved by iterations.
pub(super) const MAX_DIRECT: usize = 180;

/// The lower half of a symmetric matrix [[A, C], [Cᵀ, D]]: A is banded with n rows, D is dense with m rows.
#[derive(Debug, Clone)]
pub struct Bordered {
    /// Row i of A holds columns i + 1 − WIDTH to i.
    pub(super) band: Vec<[f64; WIDTH]>,
    /// C, row by row.
    pub(super) border: Vec<f64>,
    pub(super) corner: DMatrix<f64>,
}

/// A factored [`Bordered`].
pub struct Factor {
    /// L of A = L Lᵀ, with the reciprocals of its diagonal.
    band: Vec<[f64; WIDTH]>,
    /// W = L⁻¹ C, row by row.
    border: Vec<f64>,
    /// Cholesky factor of the Schur complement D − Wᵀ W.
    corner: Cholesky<f64, Dyn>,
}

impl Bordered {
    /// Makes a zero matrix with `n` banded and `m` bordering rows.
    pub fn zeros(n: usize, m: usize) -> Self {
        Self { band: vec![[0.0; WIDTH]; n], border: vec![0.0; n * m], corner: DMatrix::zeros(m, m) }
    }

    /// Adds to an entry of A, where `row` ≥ `column` > `row` − WIDTH.
    #[inline]
    pub fn add_band(&mut self, row: usize, column: usize, value: f64) {
        self.band[row][column + WIDTH - 1 - row] += value;
    }

    /// Adds to neighbouring entries of a row of C, starting at `column`.
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

    /// Factors the matrix by Cholesky; returns None if it is not positive definite.
    pub fn factor(mut self) -> Option<Factor> {
        let m = self.corner.nrows();
        if m > MAX_DIRECT {
            if !eliminate(&mut self.band, &mut self.border, None) {
                return None;
            }
            let rows = DMatrix::from_column_slice(m, self.band.len(), &self.border);
            self.corner.gemm(-1.0, &rows, &rows.transpose(), 1.0);
            return Some(Factor { band: self.band, border: self.border, corner: self.corner.cholesky()? });
        }
        // row by row, with room for whole registers
        let width = m.next_multiple_of(LANES);
        let mut taken = vec![0.0; m * width];
        if !eliminate(&mut self.band, &mut self.border, Some(&mut taken)) {
            return None;
        }
        for a in 0..m {
            for b in 0..=a {
                self.corner[(a, b)] -= taken[a * width + b];
            }
        }
        Some(Factor { band: self.band, border: self.border, corner: self.corner.cholesky()? })
    }
}

kernel! {
    /// Turns A into L and C into W, and adds the lower half of WᵀW to `product`, if asked; returns whether A is positive
    /// definite. Rows of `product` have room for whole registers, and their entries after the diagonal mean nothing.
    pub(super) fn eliminate<S>(
        _,
        band: &mut [[f64; WIDTH]],
        border: &mut [f64],
        product: Option<&mut [f64]>,
    ) -> bool {
        let mut product = product;
        let n = band.len();
        let together = n / ROWS_AT_ONCE * ROWS_AT_ONCE;
        for i in (0..together).step_by(ROWS_AT_ONCE) {
            if !factor_rows::<ROWS_AT_ONCE>(band, i) {
                return false;
            }
        }
        for i in together..n {
            if !factor_rows::<1>(band, i) {
                return false;
            }
        }
        let m = border.len() / n.max(1);
        let mut padded = [0.0; MAX_DIRECT.next_multiple_of(LANES)];
        for i in 0..if m > 0 { n } else { 0 } {
            let (done, rest) = border.split_at_mut(i * m);
            let edge = &mut rest[..m];
            for k in i.saturating_sub(WIDTH - 1)..i {
                let l = band[i][k + WIDTH - 1 - i];
                for (x, above) in edge.iter_mut().zip(&done[k * m..(k + 1) * m]) {
                    *x -= l * above;
                }
            }
            for x in edge.iter_mut() {
                *x *= band[i][WIDTH - 1];
            }
            let Some(product) = product.as_deref_mut() else { continue };
            padded[..m].copy_from_slice(edge);
            let (eights, width) = (padded.as_chunks::<LANES>().0, m.next_multiple_of(LANES));
            for (a, row) in product.chunks_exact_mut(width).enumerate() {
                let x = padded[a];
                let before = row[..(a + 1).next_multiple_of(LANES)].as_chunks_mut::<LANES>().0;
                for (sums, y) in before.iter_mut().zip(eights) {
                    for l in 0..LANES {
                        sums[l] += x * y[l];
                    }
                }
            }
        }
        true
    }
}

/// Factors rows i to i + R, when those above are factored. Row by row, each would wait for its own last entry.
#[inline(always)]
fn factor_rows<const R: usize>(band: &mut [[f64; WIDTH]], i: usize) -> bool {
    const { assert!(R <= WIDTH, "rows that are factored together lie within each other's band") };
    let (above, rest) = band.split_at_mut(i);
    let rows = &mut rest[..R];
    // by column: first the columns of the rows above, from i + 1 − WIDTH on, then the rows' own; zeros outside the band
    let (mut old, mut own) = ([[0.0; R]; WIDTH], [[0.0; R]; R]);
    for r in 0..R {
        for c in r..WIDTH - 1 {
            old[c][r] = rows[r][c - r];
        }
        for c in 0..=r {
            own[c][r] = rows[r][WIDTH - 1 + c - r];
        }
    }
    let mut squares = [0.0; R];
    let first = (WIDTH - 1).saturating_sub(i);
    // the diagonal holds reciprocals of L's
    let above = &above[i - (WIDTH - 1 - first)..];
    for c in first..WIDTH - 1 {
        let l = old[c].map(|x| x * above[c - first][WIDTH - 1]);
        old[c] = l;
        for d in c + 1..WIDTH - 1 {
            let factor = above[d - first][WIDTH - 1 + c - d];
            for r in 0..R {
                old[d][r] -= l[r] * factor;
            }
        }
        for s in 0..R {
            for r in s + 1..R {
                own[s][r] -= l[r] * l[s];
            }
        }
        for r in 0..R {
            squares[r] += l[r] * l[r];
        }
    }
    for s in 0..R {
        let square = own[s][s] - squares[s];
        if square <= 0.0 || !square.is_finite() {
            return false;
        }
        own[s][s] = square.sqrt().recip();
        for r in s + 1..R {
            own[s][r] *= own[s][s];
            for t in s + 1..r {
                own[t][r] -= own[s][r] * own[s][t];
            }
            squares[r] += own[s][r] * own[s][r];
        }
    }
    for r in 0..R {
        for c in r..WIDTH - 1 {
            rows[r][c - r] = old[c][r];
        }
        for c in 0..=r {
            rows[r][WIDTH - 1 + c - r] = own[c][r];
        }
    }
    true
}

/// Solves L x = x in place, when the entries of x before `start` are zero.
pub(super) fn forward(band: &[[f64; WIDTH]], x: &mut [f64], start: usize) {
    for k in start..x.len() {
        x[k] *= band[k][WIDTH - 1];
        let value = x[k];
        for i in k + 1..x.len().min(k + WIDTH) {
            x[i] -= band[i][k + WIDTH - 1 - i] * value;
        }
    }
}

/// Solves Lᵀ x = x in place.
pub(super) fn backward(band: &[[f64; WIDTH]], x: &mut [f64]) {
    for i in (0..x.len()).rev() {
        x[i] *= band[i][WIDTH - 1];
        let value = x[i];
        for k in i.saturating_sub(WIDTH - 1)..i {
            x[k] -= band[i][k + WIDTH - 1 - i] * value;
        }
    }
}

impl Factor {
    /// Solves for a right-hand side; returns the unknowns of the band and those of the border.
    pub fn solve(&self, band: &[f64], border: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (n, m) = (band.len(), border.len());
        let mut x = band.to_vec();
        // leading zeros of the right-hand side stay zero
        let start = x.iter().position(|&value| value != 0.0).unwrap_or(n);
        forward(&self.band, &mut x, start);
        let mut rest = DVector::from_column_slice(border);
        let rows = || self.border.chunks_exact(m.max(1));
        for (row, &x) in rows().zip(&x).skip(start) {
            for (rest, edge) in rest.as_mut_slice().iter_mut().zip(row) {
                *rest -= edge * x;
            }
        }
        let y = self.corner.solve(&rest);
        for (row, x) in rows().zip(&mut x) {
            for (edge, y) in row.iter().zip(y.as_slice()) {
                *x -= edge * y;
            }
        }
        backward(&self.band, &mut x);
        (x, y.iter().copied().collect())
    }

    /// Returns a diagonal entry of the border's block of the inverse.
    pub fn border_variance(&self, column: usize) -> f64 {
        let mut unit = DVector::zeros(self.corner.l_dirty().nrows());
        unit[column] = 1.0;
        self.corner.solve_mut(&mut unit);
        unit[column]
    }

    /// Returns the border's block of the inverse.
    fn border_inverse(&self) -> DMatrix<f64> {
        self.corner.inverse()
    }

    /// Returns the inverse: its entries inside the band, laid out as A is, and the border's block.
    ///
    /// Takahashi's recurrence inverts A without any entry outside the band. The border adds (A⁻¹C) S⁻¹ (A⁻¹C)ᵀ, where S
    /// is the Schur complement.
    pub fn inverse(&self) -> (Vec<[f64; WIDTH]>, DMatrix<f64>) {
        let m = self.corner.l_dirty().nrows();
        let mut inverse = vec![[0.0; WIDTH]; self.band.len()];
        let mut rows = self.border.clone();
        invert(&self.band, &mut inverse, &mut rows);
        let lower = self.corner.l();
        if m > MAX_DIRECT {
            let mut columns = DMatrix::from_column_slice(m, inverse.len(), &rows);
            lower.solve_lower_triangular_mut(&mut columns);
            rows.copy_from_slice(columns.as_slice());
        }
        for row in rows.chunks_exact_mut(m.max(1)).filter(|_| m <= MAX_DIRECT) {
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

/// Computes the entries of (LLᵀ)⁻¹ inside the band, and replaces W by L⁻ᵀW.
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
            solves_dense(n, m, seed)?;
        }
    }

    fn solves_dense(n: usize, m: usize, seed: u64) -> Result<(), TestCaseError> {
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
        Ok(())
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
