//! Depth along chains: a smoothing spline of noisy depths that keeps crossing strands apart and above the table.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::places::STEP;
use crate::geometry::band::Band;

/// Cost of bending along the viewing rays, for each ∫ z″² ds in radii, relative to depths of unit noise.
const STIFFNESS: f64 = 40.0;
const GAP: f64 = 20.0; // cost of a missing gap between strands, for each squared radius
const BELOW: f64 = 4.0; // cost of each squared radius below the table, for each radius of length
const HUBER: f64 = 1.5; // larger residuals count linearly, not squared, standard deviations
const MIN_NOISE: f64 = 0.2; // noise that divides residuals at least, radii

const BATCH: usize = 4; // gaps that are solved together
const FORGOTTEN: f64 = 6.0; // lengths over which a spline forgets by e, after which depths bear on nothing

/// Two stretches of rope, one in front of the other, kept apart by the mean distance between their samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// Samples in front and behind.
    pub pairs: Vec<[usize; 2]>,
    /// Distance along the rays that they need, radii.
    pub need: f64,
    /// Share of the cost of a whole crossing.
    pub share: f64,
}

impl Gap {
    /// Returns the distance between them, given the samples' depths.
    fn of(&self, x: impl Fn(usize) -> f64) -> f64 {
        let sum: f64 = self.pairs.iter().map(|&[front, back]| x(back) - x(front)).sum();
        sum / self.pairs.len() as f64
    }
}

/// Observations of the depths of samples along chains, radii.
#[derive(Debug, Clone)]
pub struct Profile {
    /// Observed depths; any finite number where there is none.
    pub observed: Vec<f64>,
    /// The largest depths above the table; infinite without a table.
    pub ceilings: Vec<f64>,
    pub chains: Vec<Range<usize>>,
    stiffness: Band<3>,
    /// Independent observations for each sample.
    density: f64,
}

impl Profile {
    /// Makes a profile; `correlation` is the length that counts as one observation, radii.
    pub fn new(observed: Vec<f64>, ceilings: Vec<f64>, chains: Vec<Range<usize>>, correlation: f64) -> Self {
        let stiffness = make_stiffness(&chains, observed.len());
        Self { observed, ceilings, chains, stiffness, density: STEP / correlation }
    }

    /// Returns the profile of some ranges of samples, each of one chain, as if these were all.
    pub fn cut(&self, ranges: &[Range<usize>]) -> Self {
        let cut = |values: &[f64]| ranges.iter().flat_map(|r| &values[r.clone()]).copied().collect();
        let mut chains: Vec<Range<usize>> = Vec::with_capacity(ranges.len());
        for range in ranges {
            let start = chains.last().map_or(0, |chain| chain.end);
            chains.push(start..start + range.len());
        }
        let observed: Vec<f64> = cut(&self.observed);
        let stiffness = make_stiffness(&chains, observed.len());
        Self { ceilings: cut(&self.ceilings), observed, chains, stiffness, density: self.density }
    }

    /// Returns how many samples on each side bear on the depth at a place, if all depths have `sigma` radii of noise.
    ///
    /// Far from all changes, a spline with w (x − z)² + s x″² has s x⁗ = −w x, and so falls by e over √2 (s / w)^¼.
    pub fn measure_reach(&self, sigma: f64) -> usize {
        let weight = self.density / (sigma * sigma);
        let stiffness = STIFFNESS / STEP.powi(3);
        (FORGOTTEN * std::f64::consts::SQRT_2 * (stiffness / weight).powf(0.25)).ceil() as usize
    }

    /// Finds the depths of least cost, and that cost, in some rounds from `start`, if given. Weights of observations
    /// are at most 1; their noise is `sigma` radii.
    pub fn solve(
        &self,
        weights: &[f64],
        sigma: f64,
        gaps: &[Gap],
        start: &[f64],
        rounds: usize,
    ) -> (Vec<f64>, f64) {
        let n = self.observed.len();
        let unit = self.density / (sigma * sigma);
        let noise = sigma.max(MIN_NOISE);
        let (mut x, mut diagonal) = (start.to_vec(), vec![0.0; n]);
        for _ in 0..rounds {
            let begun = !x.is_empty();
            let mut right = vec![[0.0]; n];
            for i in 0..n {
                let mut weight = unit * weights[i];
                if begun {
                    weight /= ((x[i] - self.observed[i]).abs() / noise / HUBER).max(1.0);
                }
                diagonal[i] = weight + 1e-9;
                right[i][0] = weight * self.observed[i];
                if begun && x[i] > self.ceilings[i] {
                    diagonal[i] += BELOW * STEP;
                    right[i][0] += BELOW * STEP * self.ceilings[i];
                }
            }
            let factor = self.stiffness.factored(|i| diagonal[i]);
            factor.solve(&mut right);
            let active: Vec<&Gap> = gaps.iter().filter(|gap| begun && gap.of(|i| x[i]) < gap.need).collect();
            x = right.iter().map(|row| row[0]).collect();
            if active.is_empty() {
                continue;
            }
            // Woodbury: each gap that is too small is a row of its own
            let mut columns: Vec<Vec<[f64; BATCH]>> = Vec::new();
            for batch in active.chunks(BATCH) {
                let mut block = vec![[0.0; BATCH]; n];
                for (c, gap) in batch.iter().enumerate() {
                    let part = 1.0 / gap.pairs.len() as f64;
                    for &[front, back] in &gap.pairs {
                        block[back][c] += part;
                        block[front][c] -= part;
                    }
                }
                factor.solve(&mut block);
                columns.push(block);
            }
            let m = active.len();
            let mut small = DMatrix::from_fn(m, m, |a, b| active[a].of(|i| columns[b / BATCH][i][b % BATCH]));
            for a in 0..m {
                small[(a, a)] += 1.0 / (GAP * active[a].share);
            }
            let missing = DVector::from_fn(m, |a, _| active[a].need - active[a].of(|i| x[i]));
            let Some(push) = small.cholesky().map(|c| c.solve(&missing)) else { continue };
            for (block, push) in columns.iter().zip(push.as_slice().chunks(BATCH)) {
                for (x, row) in x.iter_mut().zip(block) {
                    *x += push.iter().zip(row).map(|(push, c)| push * c).sum::<f64>();
                }
            }
        }
        let cost = self.cost(&x, weights, unit, noise, gaps);
        (x, cost)
    }

    fn cost(&self, x: &[f64], weights: &[f64], unit: f64, noise: f64, gaps: &[Gap]) -> f64 {
        let mut cost = 0.0;
        for i in 0..x.len() {
            let residual = (x[i] - self.observed[i]).abs() / noise;
            let loss =
                if residual < HUBER { residual * residual } else { 2.0 * HUBER * residual - HUBER * HUBER };
            cost += unit * weights[i] * loss * noise * noise;
            cost += BELOW * STEP * (x[i] - self.ceilings[i]).max(0.0).powi(2);
        }
        for chain in &self.chains {
            let bends = x[chain.clone()].windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).powi(2));
            cost += STIFFNESS / STEP.powi(3) * bends.sum::<f64>();
        }
        let missing = gaps.iter().map(|gap| gap.share * (gap.need - gap.of(|i| x[i])).max(0.0).powi(2));
        cost + GAP * missing.sum::<f64>()
    }
}

/// Makes the matrix of the bending of chains, which hold `n` samples together.
fn make_stiffness(chains: &[Range<usize>], n: usize) -> Band<3> {
    let mut stiffness = Band::zeros(n);
    for chain in chains {
        for i in chain.start..chain.end.saturating_sub(2) {
            stiffness.add_square(i, &[1.0, -2.0, 1.0], STIFFNESS / STEP.powi(3));
        }
    }
    stiffness
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_strands_part_and_stay_above_the_table() {
        // both at depth 0 except for a gap of two radii in their middles
        let n = 101;
        let open = Profile::new(vec![0.0; 2 * n], vec![f64::INFINITY; 2 * n], vec![0..n, n..2 * n], 3.0);
        let gap = Gap { pairs: vec![[50, n + 50]], need: 1.8, share: 1.0 };
        let (x, cost) = open.solve(&vec![1.0; 2 * n], 0.5, std::slice::from_ref(&gap), &[], 4);
        assert!((x[n + 50] + x[50]).abs() < 1e-9 && x[n + 50] > 0.3, "{}", x[n + 50]);
        // the cost is least
        for (i, step) in [(50, 1e-3), (50, -1e-3), (n + 20, 1e-3)] {
            let mut other = x.clone();
            other[i] += step;
            let unit = STEP / 3.0 / 0.25;
            assert!(open.cost(&other, &vec![1.0; 2 * n], unit, 0.5, std::slice::from_ref(&gap)) > cost);
        }
        let table = Profile { ceilings: vec![0.1; 2 * n], ..open };
        let (y, more) = table.solve(&vec![1.0; 2 * n], 0.5, &[gap], &x, 8);
        assert!(more > cost && y[n + 50] < x[n + 50] && y[50] < x[50]);
    }
}
