//! Systems with many bordering unknowns, solved by iterations: the cost grows linearly with their number.
//!
//! Conjugate gradients solve the Schur complement S = D − WᵀW. Its diagonal blocks precondition it: unknowns of
//! different views are coupled by the curves alone.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::bordered::{Bordered, Factor, MAX_DIRECT, WIDTH, backward, eliminate, forward};

const TOLERANCE: f64 = 1e-8; // least residual, share of the first
const MAX_ITERATIONS: usize = 300; // iterations of a solution at most; it takes tens

/// A matrix that can be solved for right-hand sides.
pub enum Solver {
    Direct(Factor),
    Iterative(Schur),
}

/// A matrix whose band is eliminated and whose border is not.
pub struct Schur {
    band: Vec<[f64; WIDTH]>,
    /// (m, n), W.
    rows: DMatrix<f64>,
    corner: DMatrix<f64>,
    /// The first unknown of each diagonal block of S, and the block factored.
    blocks: Vec<(usize, Cholesky<f64, Dyn>)>,
}

impl Solver {
    /// Prepares a matrix; None if it is not positive definite. `blocks` holds the first border unknown of each group
    /// that is coupled most closely, such as the unknowns of a pose.
    pub fn new(matrix: Bordered, blocks: &[usize]) -> Option<Self> {
        if matrix.corner.nrows() <= MAX_DIRECT {
            return Some(Self::Direct(matrix.factor()?));
        }
        Some(Self::Iterative(Schur::new(matrix, blocks)?))
    }

    /// Solves for a right-hand side; returns the unknowns of the band and those of the border.
    pub fn solve(&self, band: &[f64], border: &[f64]) -> (Vec<f64>, Vec<f64>) {
        match self {
            Self::Direct(factor) => factor.solve(band, border),
            Self::Iterative(schur) => schur.solve(band, border),
        }
    }

    /// Returns some diagonal entries of the border's block of the inverse.
    pub fn border_variances(&self, columns: std::ops::Range<usize>) -> Vec<f64> {
        match self {
            Self::Direct(factor) => columns.map(|column| factor.border_variance(column)).collect(),
            Self::Iterative(schur) => columns.map(|column| schur.border_variance(column)).collect(),
        }
    }
}

impl Schur {
    /// Eliminates the band; None if the matrix is not positive definite.
    fn new(matrix: Bordered, blocks: &[usize]) -> Option<Self> {
        let Bordered { mut band, mut border, mut corner } = matrix;
        let m = corner.nrows();
        if !eliminate(&mut band, &mut border, None) {
            return None;
        }
        corner.fill_upper_triangle_with_lower_triangle();
        let rows = DMatrix::from_vec(m, band.len(), border);
        let ends = blocks.iter().skip(1).copied().chain([m]);
        let factored = blocks.iter().zip(ends).map(|(&first, end)| {
            let own = rows.rows(first, end - first);
            let block = corner.view((first, first), (end - first, end - first)) - own * own.transpose();
            Some((first, block.cholesky()?))
        });
        let blocks = factored.collect::<Option<Vec<_>>>()?;
        Some(Self { band, rows, corner, blocks })
    }

    fn solve(&self, band: &[f64], border: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut x = DVector::from_column_slice(band);
        forward(&self.band, x.as_mut_slice(), 0);
        let right = DVector::from_column_slice(border) - &self.rows * &x;
        let y = self.solve_border(&right);
        x -= self.rows.tr_mul(&y);
        backward(&self.band, x.as_mut_slice());
        (x.iter().copied().collect(), y.iter().copied().collect())
    }

    fn border_variance(&self, column: usize) -> f64 {
        let mut unit = DVector::zeros(self.corner.nrows());
        unit[column] = 1.0;
        self.solve_border(&unit)[column]
    }

    /// Solves S y = `right`.
    fn solve_border(&self, right: &DVector<f64>) -> DVector<f64> {
        let mut y = DVector::zeros(right.len());
        let mut residual = right.clone();
        let mut turned = self.precondition(&residual);
        let mut direction = turned.clone();
        let mut square = residual.dot(&turned);
        let least = TOLERANCE * TOLERANCE * square;
        for _ in 0..MAX_ITERATIONS {
            if square <= least || square.is_nan() {
                break;
            }
            let image = &self.corner * &direction - &self.rows * self.rows.tr_mul(&direction);
            let step = square / direction.dot(&image);
            if step <= 0.0 || !step.is_finite() {
                break;
            }
            y.axpy(step, &direction, 1.0);
            residual.axpy(-step, &image, 1.0);
            turned = self.precondition(&residual);
            let before = std::mem::replace(&mut square, residual.dot(&turned));
            direction = &turned + direction * (square / before);
        }
        y
    }

    /// Solves with the diagonal blocks of S alone.
    fn precondition(&self, right: &DVector<f64>) -> DVector<f64> {
        let mut found = right.clone();
        for (first, block) in &self.blocks {
            block.solve_mut(&mut found.rows_mut(*first, block.l_dirty().nrows()));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iterations_find_what_factors_find() {
        let (n, views) = (60, 40);
        let m = 6 * views;
        let mut matrix = Bordered::zeros(n, m);
        let wave = |a: usize, b: usize| ((a * 31 + b * 17) as f64 * 0.37).sin();
        // each row is a residual of a few unknowns of the band and of one view, as in fits
        for row in 0..20 * views {
            let (start, column) = (row * 7 % (n - WIDTH), 6 * (row % views));
            let band: Vec<f64> = (0..WIDTH).map(|i| wave(row, i)).collect();
            let edge: Vec<f64> = (0..6).map(|i| wave(i + 40, row)).collect();
            for i in 0..WIDTH {
                for j in 0..=i {
                    matrix.add_band(start + i, start + j, band[i] * band[j]);
                }
                matrix.add_border(start + i, column, &edge.iter().map(|e| e * band[i]).collect::<Vec<_>>());
            }
            for i in 0..6 {
                for j in 0..=i {
                    matrix.add_corner(column + i, column + j, edge[i] * edge[j]);
                }
            }
        }
        (0..n).for_each(|i| matrix.add_band(i, i, 0.5));
        (0..m).for_each(|i| matrix.add_corner(i, i, 0.5));
        let (band, border) =
            ((0..n).map(|i| wave(i, 3)).collect::<Vec<_>>(), (0..m).map(|i| wave(i, 5)).collect::<Vec<_>>());
        let factor = matrix.clone().factor().unwrap();
        let blocks: Vec<usize> = (0..views).map(|view| 6 * view).collect();
        let solver = Solver::new(matrix, &blocks).unwrap();
        assert!(matches!(solver, Solver::Iterative(_)));
        let (direct, found) = (factor.solve(&band, &border), solver.solve(&band, &border));
        for (a, b) in direct.0.iter().chain(&direct.1).zip(found.0.iter().chain(&found.1)) {
            assert!((a - b).abs() < 1e-6, "{a} {b}");
        }
        let variances = solver.border_variances(9..11);
        let inverse = factor.inverse().1;
        assert!((variances[1] / inverse[(10, 10)] - 1.0).abs() < 1e-6);
    }
}
