//! Small symmetric banded systems, for smoothing splines and their fits.

/// The lower half of a symmetric matrix with W − 1 entries left of the diagonal.
#[derive(Debug, Clone)]
pub struct Band<const W: usize> {
    /// Row i holds columns i + 1 − W to i.
    rows: Vec<[f64; W]>,
}

/// L and D of A = L D Lᵀ, with the reciprocals of D on the diagonal.
pub struct Factored<const W: usize> {
    rows: Vec<[f64; W]>,
}

impl<const W: usize> Band<W> {
    pub fn zeros(n: usize) -> Self {
        Self { rows: vec![[0.0; W]; n] }
    }

    /// Adds to an entry, where `row` ≥ `column` > `row` − W.
    #[inline]
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        self.rows[row][column + W - 1 - row] += value;
    }

    /// Adds weight · d dᵀ on and below the diagonal, where d begins at row `first`.
    pub fn add_square(&mut self, first: usize, d: &[f64], weight: f64) {
        for a in 0..d.len() {
            for b in 0..=a {
                self.add(first + a, first + b, weight * d[a] * d[b]);
            }
        }
    }

    /// Factors the matrix with an added diagonal; the sum must be positive definite.
    pub fn factored(&self, diagonal: &[f64]) -> Factored<W> {
        let mut rows = self.rows.clone();
        for i in 0..rows.len() {
            let low = i.saturating_sub(W - 1);
            let (above, rest) = rows.split_at_mut(i);
            let row = &mut rest[0];
            let mut last = row[W - 1] + diagonal[i];
            for j in low..i {
                let mut sum = row[j + W - 1 - i];
                for k in low.max((j + 1).saturating_sub(W))..j {
                    sum -= row[k + W - 1 - i] * above[j][k + W - 1 - j];
                }
                row[j + W - 1 - i] = sum;
            }
            for j in low..i {
                let scaled = row[j + W - 1 - i] * above[j][W - 1];
                last -= scaled * row[j + W - 1 - i];
                row[j + W - 1 - i] = scaled;
            }
            row[W - 1] = 1.0 / last;
        }
        Factored { rows }
    }
}

impl<const W: usize> Factored<W> {
    /// Solves for K right-hand sides in place and together: each alone would wait for its own last entry.
    pub fn solve<const K: usize>(&self, x: &mut [[f64; K]]) {
        let n = x.len();
        // leading zeros of the right-hand side stay zero
        let start = x.iter().position(|row| row.iter().any(|&v| v != 0.0)).unwrap_or(n);
        for i in start..n {
            let mut value = x[i];
            for k in start.max((i + 1).saturating_sub(W))..i {
                let l = self.rows[i][k + W - 1 - i];
                for (value, before) in value.iter_mut().zip(&x[k]) {
                    *value -= l * before;
                }
            }
            x[i] = value;
        }
        for i in (0..n).rev() {
            let mut value = x[i].map(|v| v * self.rows[i][W - 1]);
            for k in i + 1..n.min(i + W) {
                let l = self.rows[k][i + W - 1 - k];
                for (value, after) in value.iter_mut().zip(&x[k]) {
                    *value -= l * after;
                }
            }
            x[i] = value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solution_satisfies_the_system() {
        for n in [1, 2, 3, 7, 20] {
            let mut band = Band::<4>::zeros(n);
            for i in 0..n.saturating_sub(3) {
                band.add_square(i, &[-1.0, 3.0, -3.0, 1.0], 2.0 + i as f64);
            }
            let diagonal: Vec<f64> = (0..n).map(|i| 0.5 + (i % 3) as f64).collect();
            let right: Vec<f64> = (0..n).map(|i| (i as f64 * 1.7).sin()).collect();
            let mut both: Vec<[f64; 2]> = right.iter().map(|&r| [r, 0.0]).collect();
            both[n - 1][1] = 1.0;
            band.factored(&diagonal).solve(&mut both);
            let x: Vec<f64> = both.iter().map(|row| row[0]).collect();
            // the inverse is symmetric
            let other: f64 = both.iter().zip(&right).map(|(row, r)| row[1] * r).sum();
            assert!((other - x[n - 1]).abs() < 1e-12);
            for i in 0..n {
                let entry = |i: usize, j: usize| match i.max(j) - i.min(j) {
                    d if d < 4 => band.rows[i.max(j)][3 - d],
                    _ => 0.0,
                };
                let left: f64 = (0..n).map(|j| entry(i, j) * x[j]).sum::<f64>() + diagonal[i] * x[i];
                assert!((left - right[i]).abs() < 1e-12, "{n}: {left} for {}", right[i]);
            }
        }
    }
}
