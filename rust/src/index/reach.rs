//! The distance between neighbours in a cloud.

use rayon::prelude::*;

use super::limits::{POINTS_PER_PART, SHORTEST};
use crate::geometry::{Point, squared_distance};
use crate::simd::kernel;

const SEEDS: usize = 16; // points at which the distance between neighbours is estimated
/// Fewest and most points of the part of the cloud, an eighth of it, in which neighbours are sought.
const PART: [usize; 2] = [1024, 4096];

/// Estimates how far a point's `k`-th neighbour is, the point itself being the first; above zero.
///
/// At a few seeds, it finds the distance to enough points of a part of the cloud. Then it counts how many of all points
/// lie within that distance, and scales the distance as for a surface.
pub fn reach_of(points: &[Point], k: usize) -> f64 {
    let every = |count: usize| {
        let step = points.len().div_ceil(count).max(1);
        points.iter().step_by(step).copied().collect::<Vec<Point>>()
    };
    let (seeds, part) = (every(SEEDS), every((points.len() / 8).clamp(PART[0], PART[1])));
    // in the part, this many points stand for k of all
    let few = (k * part.len()).div_ceil(points.len()).clamp(2.min(part.len()), part.len());
    let mut squares: Vec<f64> = seeds
        .par_iter()
        .map(|&seed| {
            let mut squares: Vec<f64> = part.iter().map(|&p| squared_distance(p, seed)).collect();
            *squares.select_nth_unstable_by(few - 1, f64::total_cmp).1
        })
        .collect();
    // a ball of many more than k points may hold more than one piece of surface, so the first round aims at 2 k
    let rounds = if part.len() < points.len() { 2 } else { 1 };
    for round in 1..=rounds {
        let counts =
            points.par_chunks(POINTS_PER_PART).map(|points| count_below(points, &seeds, &squares)).reduce(
                || vec![0; seeds.len()],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        let wanted = if round < rounds { 2 * k } else { k };
        for (square, count) in squares.iter_mut().zip(counts) {
            *square *= wanted as f64 / count as f64;
        }
    }
    squares.sort_unstable_by(f64::total_cmp);
    // if points coincide, any distance will do
    squares[squares.len() / 2].sqrt().max(SHORTEST)
}

kernel! {
    /// Counts the points within each seed's squared distance.
    fn count_below<S>(_, points: &[Point], seeds: &[Point], squares: &[f64]) -> Vec<u64> {
        let mut counts = vec![0; seeds.len()];
        for points in points.chunks(256) {
            let mut axes = [[f64::INFINITY; 256]; 3];
            for (i, p) in points.iter().enumerate() {
                for k in 0..3 {
                    axes[k][i] = p[k];
                }
            }
            let [x, y, z] = &axes;
            for ((count, seed), square) in counts.iter_mut().zip(seeds).zip(squares) {
                let mut sum = 0;
                for i in 0..256 {
                    let d = [x[i] - seed[0], y[i] - seed[1], z[i] - seed[2]];
                    sum += u64::from(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= *square);
                }
                *count += sum;
            }
        }
        counts
    }
}
