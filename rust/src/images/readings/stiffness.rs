//! The part of a curve's normal equations that its steps do not change: bending, and nodes that are held.

use super::planar::Place;
use crate::geometry::band::Band;

/// Entries of a row up to its diagonal: three nodes before it, and its own coordinates.
const WIDTH: usize = 8;

/// Lower rows of the matrix of bending and its change: entries for each node and the three before it.
type Rows = Vec<[f64; 4]>;

/// The forces between the nodes of a curve in the image and on those that are held, lengths in image radii.
pub struct Stiffness {
    matrix: Band<WIDTH>,
    rows: Rows,
    /// The weight that holds each node where it started.
    holds: Vec<f64>,
}

impl Stiffness {
    /// Prepares nodes at distances `h` with weights of bending and of its change. `damping` limits each node's step.
    pub fn new(h: f64, weights: [f64; 2], holds: Vec<f64>, damping: f64) -> Self {
        let n = holds.len();
        let rows = make_rows(n, h, weights);
        let mut matrix = Band::zeros(2 * n);
        for i in 0..n {
            for c in 0..2 {
                for (back, &weight) in rows[i].iter().enumerate().take(i + 1) {
                    matrix.add(2 * i + c, 2 * (i - back) + c, weight);
                }
                matrix.add(2 * i + c, 2 * i + c, holds[i] + damping);
            }
        }
        Self { matrix, rows, holds }
    }

    /// Returns the equations of a step from nodes that started at `first`.
    pub fn equations(&self, nodes: &[Place], first: &[Place], radius_px: f64) -> Equations {
        let n = nodes.len();
        let mut right = vec![[0.0; 2]; n];
        for i in 0..n {
            for c in 0..2 {
                right[i][c] -= self.holds[i] * (nodes[i][c] - first[i][c]);
            }
            for (back, &weight) in self.rows[i].iter().enumerate().take(i + 1) {
                let j = i - back;
                for c in 0..2 {
                    right[i][c] -= weight * nodes[j][c];
                    if back > 0 {
                        right[j][c] -= weight * nodes[i][c];
                    }
                }
            }
        }
        let inverse = 1.0 / radius_px;
        Equations {
            matrix: self.matrix.clone(),
            right: right.into_iter().map(|r| r.map(|x| x * inverse)).collect(),
        }
    }
}

/// Normal equations of a step of a curve's nodes, image radii.
pub struct Equations {
    matrix: Band<WIDTH>,
    right: Vec<Place>,
}

impl Equations {
    /// Adds a residual of a node along a direction.
    #[inline]
    pub fn add(&mut self, node: usize, along: Place, residual: f64, weight: f64) {
        self.matrix.add(2 * node, 2 * node, weight * along[0] * along[0]);
        self.matrix.add(2 * node + 1, 2 * node + 1, weight * along[1] * along[1]);
        self.matrix.add(2 * node + 1, 2 * node, weight * along[0] * along[1]);
        for c in 0..2 {
            self.right[node][c] -= weight * along[c] * residual;
        }
    }

    /// Returns the step of each node, and the largest change of a coordinate; None without a solution.
    pub fn solve(self) -> Option<(Vec<Place>, f64)> {
        let factored = self.matrix.factored(|_| 0.0);
        if !factored.is_positive() {
            return None;
        }
        let mut step = self.right;
        factored.solve::<1>(step.as_flattened_mut().as_chunks_mut().0);
        let most = step.as_flattened().iter().fold(0.0f64, |most, s| most.max(s.abs()));
        Some((step, most))
    }
}

fn make_rows(n: usize, h: f64, weights: [f64; 2]) -> Rows {
    let mut rows = vec![[0.0; 4]; n];
    let mut add = |taps: &[f64], weight: f64| {
        for start in 0..(n + 1).saturating_sub(taps.len()) {
            for (i, a) in taps.iter().enumerate() {
                for (j, b) in taps.iter().enumerate().take(i + 1) {
                    rows[start + i][i - j] += weight * a * b;
                }
            }
        }
    };
    add(&[1.0, -2.0, 1.0], weights[0] / h.powi(3));
    add(&[-1.0, 3.0, -3.0, 1.0], weights[1] / h.powi(5));
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forces_are_those_of_the_energy() {
        let (radius_px, h, weights) = (4.0, 0.5, [3.0, 10.0]);
        let first: Vec<Place> = (0..9).map(|i| [2.0 * f64::from(i), f64::from(i * i % 5)]).collect();
        let holds: Vec<f64> = (0..9).map(|i| if i % 4 == 0 { 7.0 } else { 0.0 }).collect();
        let stiffness = Stiffness::new(h, weights, holds.clone(), 1e-3);
        // half of the energy of bending, its change and the holds, lengths in image radii
        let energy = |nodes: &[Place]| -> f64 {
            let sum = |taps: &[f64]| -> f64 {
                let bend = |w: &[Place], c: usize| w.iter().zip(taps).map(|(x, k)| x[c] * k).sum::<f64>();
                nodes.windows(taps.len()).map(|w| bend(w, 0).powi(2) + bend(w, 1).powi(2)).sum()
            };
            let bent = weights[0] / h.powi(3) * sum(&[1.0, -2.0, 1.0]);
            let changed = weights[1] / h.powi(5) * sum(&[-1.0, 3.0, -3.0, 1.0]);
            let away = |i: usize| (nodes[i][0] - first[i][0]).powi(2) + (nodes[i][1] - first[i][1]).powi(2);
            let held: f64 = (0..9).map(|i| holds[i] * away(i)).sum();
            0.5 * (bent + changed + held) / (radius_px * radius_px)
        };
        let nodes: Vec<Place> = first.iter().map(|x| [x[0] + 0.1 * x[1], 0.9 * x[1]]).collect();
        let found = stiffness.equations(&nodes, &first, radius_px);
        for (i, c) in (0..9).flat_map(|i| [(i, 0), (i, 1)]) {
            let moved = |by: f64| {
                let mut moved = nodes.clone();
                moved[i][c] += by * radius_px;
                energy(&moved)
            };
            let slope = (moved(1e-4) - moved(-1e-4)) / 2e-4;
            assert!((found.right[i][c] + slope).abs() < 1e-6 * slope.abs().max(1.0), "{i}, {c}: {slope}");
        }
        // of a quadratic energy, one step finds the least
        let (step, most) = found.solve().unwrap();
        let there: Vec<Place> =
            nodes.iter().zip(&step).map(|(x, s)| [0, 1].map(|c| x[c] + radius_px * s[c])).collect();
        assert!(most > 0.01 && energy(&there) < 0.01 * energy(&nodes));
        let rest = stiffness.equations(&there, &first, radius_px).right;
        assert!(rest.as_flattened().iter().all(|force| force.abs() < 1e-2));
    }
}
