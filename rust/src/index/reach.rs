//! How far from each other the points of a cloud are.

use rayon::prelude::*;

use super::{POINTS_PER_PART, SHORTEST};
use crate::geometry::{Point, squared_distance};
use crate::simd::kernel;

/// Points from which distances between neighbours are estimated.
const SEEDS: usize = 16;
/// The part of the cloud that neighbours are sought in is an eighth, but at least and at most so many points.
const PART: [usize; 2] = [1024, 4096];

/// About how far from a point its `k`-th neighbour is, the point itself the first; above zero.
///
/// From a few of the points: the distance that is nearly enough in a part of the cloud, and how many of all points lie
/// within it, a cloud taken for a surface.
pub fn reach_of(points: &[Point], k: usize) -> f64 {
    let every = |count: usize| {
        let step = points.len().div_ceil(count).max(1);
        points.iter().step_by(step).copied().collect::<Vec<Point>>()
    };
    let (seeds, part) = (every(SEEDS), every((points.len() / 8).clamp(PART[0], PART[1])));
    // k points of all are as many of a part
    let few = (k * part.len()).div_ceil(points.len()).clamp(2.min(part.len()), part.len());
    let mut squares: Vec<f64> = seeds
        .iter()
        .map(|&seed| {
            let mut squares: Vec<f64> = part.iter().map(|&p| squared_distance(p, seed)).collect();
            *squares.select_nth_unstable_by(few - 1, f64::total_cmp).1
        })
        .collect();
    // a ball that holds many more than k points may hold more than a piece of surface: then a smaller one
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
    // of coincident points any distance will do
    squares[squares.len() / 2].sqrt().max(SHORTEST)
}

kernel! {
    /// How many points lie within each seed's distance, squared.
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
