//! Symmetric banded systems, eliminated from both ends.
//!
//! Each row of an elimination waits for the row before. The first rows and the last ones, in opposite order, do not wait
//! for each other: one register holds both. They meet at a few rows in the middle.

/// The lower half of a symmetric matrix with W − 1 entries left of the diagonal.
#[derive(Debug, Clone)]
pub struct Band<const W: usize> {
    /// Row i holds columns i + 1 − W to i.
    rows: Vec<[f64; W]>,
}

/// Numbers of a row from the first on and of one from the last on.
type Pair = [f64; 2];

/// A matrix as A = L D Lᵀ, whose rows from both ends come before those in the middle.
pub struct Factored<const W: usize> {
    /// L of the rows from both ends, with the reciprocals of D on the diagonal, then of the rows of the middle.
    pairs: Vec<[Pair; W]>,
    /// L and the reciprocals of D between the rows of the middle.
    middle: [[f64; W]; W],
    /// The number of rows in the middle.
    count: usize,
    /// Whether the entries of D are positive.
    positive: bool,
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

    /// Pairs the `ends` rows from both ends on; those in the middle and what is left of them come last.
    fn pair_ends(&self, ends: usize, diagonal: impl Fn(usize) -> f64) -> Vec<[Pair; W]> {
        let n = self.rows.len();
        let mut pairs = vec![[[0.0; 2]; W]; ends + W];
        for (i, row) in self.rows[..n - ends].iter().enumerate() {
            for (pair, &value) in pairs[i].iter_mut().zip(row) {
                pair[0] = value;
            }
            pairs[i][W - 1][0] += diagonal(i);
        }
        for (i, row) in self.rows[n - ends..].iter().rev().enumerate() {
            for (back, &value) in row.iter().rev().enumerate() {
                pairs[i + back][W - 1 - back][1] = value;
            }
            pairs[i][W - 1][1] += diagonal(n - 1 - i);
        }
        pairs
    }

    /// Factors the matrix with a number added to each entry of the diagonal.
    #[inline]
    pub fn factored(&self, diagonal: impl Fn(usize) -> f64) -> Factored<W> {
        let n = self.rows.len();
        let ends = n.saturating_sub(W - 1) / 2;
        let count = n - 2 * ends;
        let mut pairs = self.pair_ends(ends, diagonal);
        let mut positive = true;
        for i in 0..ends {
            let below: &mut [[Pair; W]; W] = pairs[i..].first_chunk_mut().expect("W rows follow each end's");
            let pivot = below[0][W - 1];
            positive &= pivot.into_iter().all(is_positive);
            let inverse = pivot.map(|x| 1.0 / x);
            below[0][W - 1] = inverse;
            let mut column = [[0.0; 2]; W];
            for r in 1..W {
                column[r] = below[r][W - 1 - r];
            }
            for r in 1..W {
                let l = [column[r][0] * inverse[0], column[r][1] * inverse[1]];
                below[r][W - 1 - r] = l;
                for c in 1..=r {
                    for k in 0..2 {
                        below[r][W - 1 - r + c][k] -= l[k] * column[c][k];
                    }
                }
            }
        }
        let mut middle = [[0.0; W]; W];
        for a in 0..W {
            for b in 0..=a {
                middle[a][b] = if a < count {
                    pairs[ends + a][W - 1 + b - a][0] + pairs[ends + count - 1 - b][W - 1 + b - a][1]
                } else {
                    f64::from(u8::from(a == b))
                };
            }
        }
        positive &= factor_dense(&mut middle);
        Factored { pairs, middle, count, positive }
    }
}

/// Factors a small matrix, given by its lower half, as L D Lᵀ, with the reciprocals of D on the diagonal. Returns whether
/// the entries of D are positive.
fn factor_dense<const W: usize>(rows: &mut [[f64; W]; W]) -> bool {
    let mut positive = true;
    for k in 0..W {
        positive &= is_positive(rows[k][k]);
        rows[k][k] = 1.0 / rows[k][k];
        let column: [f64; W] = std::array::from_fn(|r| rows[r][k]);
        for r in k + 1..W {
            rows[r][k] *= rows[k][k];
            for c in k + 1..=r {
                rows[r][c] -= rows[r][k] * column[c];
            }
        }
    }
    positive
}

fn is_positive(pivot: f64) -> bool {
    pivot > 0.0 && pivot.is_finite()
}

impl<const W: usize> Factored<W> {
    /// Returns whether the matrix was positive definite; solutions with another mean nothing.
    pub fn is_positive(&self) -> bool {
        self.positive
    }

    /// Solves for K right-hand sides in place.
    #[inline]
    pub fn solve<const K: usize>(&self, x: &mut [[f64; K]]) {
        let (n, count) = (x.len(), self.count);
        let ends = (n - count) / 2;
        let mut y = vec![[[0.0; 2]; K]; ends + W];
        for i in 0..ends {
            y[i] = std::array::from_fn(|k| [x[i][k], x[n - 1 - i][k]]);
        }
        for (y, x) in y[ends..].iter_mut().zip(&x[ends..ends + count]) {
            *y = x.map(|x| [x, 0.0]);
        }
        // zeros at both ends of the right-hand side stay zero
        let start =
            y[..ends].iter().position(|row| row.as_flattened().iter().any(|&v| v != 0.0)).unwrap_or(ends);
        for i in start..ends {
            let below: &[[Pair; W]; W] = self.pairs[i..].first_chunk().expect("W rows follow each end's");
            let values: &mut [[Pair; K]; W] = y[i..].first_chunk_mut().expect("W rows follow each end's");
            for r in 1..W {
                for k in 0..K {
                    for end in 0..2 {
                        values[r][k][end] -= below[r][W - 1 - r][end] * values[0][k][end];
                    }
                }
            }
        }
        let mut z = [[0.0; K]; W];
        for q in 0..count {
            z[q] = std::array::from_fn(|k| y[ends + q][k][0] + y[ends + count - 1 - q][k][1]);
        }
        for r in 1..W {
            for c in 0..r {
                for k in 0..K {
                    z[r][k] -= self.middle[r][c] * z[c][k];
                }
            }
        }
        for r in (0..W).rev() {
            z[r] = z[r].map(|z| z * self.middle[r][r]);
            for c in r + 1..W {
                for k in 0..K {
                    z[r][k] -= self.middle[c][r] * z[c][k];
                }
            }
        }
        for q in 0..count {
            y[ends + q] = std::array::from_fn(|k| [z[q][k], z[count - 1 - q][k]]);
            x[ends + q] = z[q];
        }
        for i in (0..ends).rev() {
            let below: &[[Pair; W]; W] = self.pairs[i..].first_chunk().expect("W rows follow each end's");
            let values: &mut [[Pair; K]; W] = y[i..].first_chunk_mut().expect("W rows follow each end's");
            for k in 0..K {
                for end in 0..2 {
                    let mut value = values[0][k][end] * below[0][W - 1][end];
                    // the last one found comes last
                    for r in (1..W).rev() {
                        value -= below[r][W - 1 - r][end] * values[r][k][end];
                    }
                    values[0][k][end] = value;
                }
            }
            x[i] = values[0].map(|pair| pair[0]);
            x[n - 1 - i] = values[0].map(|pair| pair[1]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn solutions_are_those_of_the_dense_system(
            n in 0usize..40,
            zeros in 0usize..12,
            strong in prop_oneof![Just(2.0), Just(0.25)],
            entries in prop::collection::vec(-0.5f64..0.5, 500),
        ) {
            solves_dense::<1, 1>(n, zeros, strong, &entries)?;
            solves_dense::<3, 4>(n, zeros, strong, &entries)?;
            solves_dense::<4, 3>(n, zeros, strong, &entries)?;
            solves_dense::<8, 1>(n, zeros, strong, &entries)?;
        }
    }

    /// Compares a matrix with a `strong` diagonal, definite or not, and right-hand sides with `zeros` zeros at both ends.
    fn solves_dense<const W: usize, const K: usize>(
        n: usize,
        zeros: usize,
        strong: f64,
        entries: &[f64],
    ) -> Result<(), TestCaseError> {
        let strong = strong * W as f64;
        let mut entries = entries.iter().copied().cycle();
        let mut next = || entries.next().unwrap();
        let (mut band, mut dense) = (Band::<W>::zeros(n), DMatrix::<f64>::zeros(n, n));
        for (i, j) in (0..n).flat_map(|i| ((i + 1).saturating_sub(W)..=i).map(move |j| (i, j))) {
            let value = next();
            band.add(i, j, value);
            dense[(i, j)] = value;
            dense[(j, i)] = value;
        }
        for i in 0..n {
            dense[(i, i)] += strong;
        }
        let factored = band.factored(|_| strong);
        prop_assert_eq!(factored.is_positive(), n == 0 || dense.clone().cholesky().is_some());
        if !factored.is_positive() {
            return Ok(());
        }
        let right: Vec<[f64; K]> = (0..n)
            .map(|i| if i < zeros || n - i <= zeros { [0.0; K] } else { std::array::from_fn(|_| next()) })
            .collect();
        let mut x = right.clone();
        factored.solve(&mut x);
        for k in 0..K {
            let column = |rows: &[[f64; K]]| DVector::from_iterator(n, rows.iter().map(|row| row[k]));
            let solution = column(&x);
            prop_assert!(
                n == 0 || (&dense * &solution - column(&right)).amax() < 1e-9 * (1.0 + solution.amax())
            );
        }
        Ok(())
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_is_told() {
        for (bad, value) in [(0, -1.0), (6, -1.0), (3, 0.0), (5, f64::NAN), (2, f64::INFINITY)] {
            let factored = Band::<3>::zeros(7).factored(|i| if i == bad { value } else { 1.0 });
            assert!(!factored.is_positive(), "{bad}");
        }
        assert!(Band::<3>::zeros(7).factored(|_| 1.0).is_positive());
    }
}
