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
        // the W − 1 rows before, the last of them last; zeros stand for rows above the matrix
        let mut above = [[0.0; W]; W];
        for (row, diagonal) in rows.iter_mut().zip(diagonal) {
            let mut last = row[W - 1] + diagonal;
            for c in 0..W - 1 {
                for k in 0..c {
                    row[c] -= row[k] * above[c][k + W - 1 - c];
                }
            }
            for c in 0..W - 1 {
                let scaled = row[c] * above[c][W - 1];
                last -= scaled * row[c];
                row[c] = scaled;
            }
            row[W - 1] = 1.0 / last;
            above[W - 1] = *row;
            for c in 1..W {
                above[c - 1] = above[c];
            }
        }
        Factored { rows }
    }
}

impl<const W: usize> Factored<W> {
    /// Solves for K right-hand sides in place and together: each alone would wait for its own last entry.
    pub fn solve<const K: usize>(&self, x: &mut [[f64; K]]) {
        // leading zeros of the right-hand side stay zero
        let start = x.iter().position(|row| row.iter().any(|&v| v != 0.0)).unwrap_or(x.len());
        // the W − 1 rows before, the last of them last
        let mut before = [[0.0; K]; W];
        for (value, row) in x.iter_mut().zip(&self.rows).skip(start) {
            for c in 0..W - 1 {
                for k in 0..K {
                    value[k] -= row[c] * before[c][k];
                }
            }
            before[W - 1] = *value;
            for c in 1..W {
                before[c - 1] = before[c];
            }
        }
        // the W − 1 rows after, the next of them first, each with its row of L
        let mut after = [([0.0; W], [0.0; K]); W];
        for (value, row) in x.iter_mut().zip(&self.rows).rev() {
            *value = value.map(|v| v * row[W - 1]);
            for c in 0..W - 1 {
                let (row, value_after) = after[c];
                for k in 0..K {
                    value[k] -= row[W - 2 - c] * value_after[k];
                }
            }
            for c in (1..W).rev() {
                after[c] = after[c - 1];
            }
            after[0] = (*row, *value);
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
