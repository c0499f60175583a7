//! A rope's radius from its apparent width.
//!
//! A camera sees a stretch of rope as a strip whose points lie between −r and r of its middle. Across the strip, their
//! variance is r² / 3. Noise along the viewing rays does not change that.

use rayon::prelude::*;

use crate::checks::{check_finite, check_positive};
use crate::error::Result;
use crate::geometry::{Point, advance, cross, dot, normalized, sub};
use crate::index::Grid;
use crate::parallel;

const ELONGATION: f64 = 6.0; // ratio of a strip's variances at least; patches grow until they reach it
const GROWTH: f64 = 1.2; // growth factor of a patch from one trial to the next
const MIN_POINTS: usize = 24; // points of a strip at least
/// Largest distances of a patch's points from its seed, largest radii: first the near points, which cost less.
const REACHES: [f64; 2] = [0.5, 2.5];
/// Seeds that one task works on; fixed, so that results do not depend on the number of threads.
const SEEDS_PER_TASK: usize = 16;

/// The rope's radius as one patch shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ApparentRadius {
    /// Half the strip's width, metres.
    pub radius: f64,
    /// Side of the square, perpendicular to the viewing ray, that each point of the strip stands for, metres.
    pub footprint: f64,
}

/// Estimates the rope's radius at up to `seeds` points of one camera, spread over the cloud.
///
/// Around each seed a patch grows, projected along the viewing ray, until it is longer than wide. Half its width is √(3
/// λ), where λ is the smaller eigenvalue of its covariance. Patches that never become strips, and strips wider than
/// `largest`, give no radius. Strands side by side look like one wide strip, so callers take the most frequent value.
pub(crate) fn apparent_radii(
    points: &[Point],
    viewpoint: Point,
    largest: f64,
    seeds: usize,
) -> Result<Vec<ApparentRadius>> {
    check_finite("points", points)?;
    check_finite("viewpoint", &[viewpoint])?;
    check_positive("largest", largest)?;
    Ok(parallel::run(|| {
        let grids = REACHES.map(|reach| Grid::new(points, reach * largest));
        let step = points.len().div_ceil(seeds.max(1)).max(1);
        // the finer grid's order runs through the cloud cell by cell, so every k-th point spreads over it
        let chosen: Vec<Point> = (0..points.len()).step_by(step).map(|i| grids[0].point(i)).collect();
        let found: Vec<Vec<Option<ApparentRadius>>> = chosen
            .par_chunks(SEEDS_PER_TASK)
            .map(|seeds| seeds.iter().map(|&seed| find_strip(seed, viewpoint, &grids)).collect())
            .collect();
        found.into_iter().flatten().flatten().filter(|strip| strip.radius <= largest).collect()
    }))
}

/// Finds the strip around a seed.
fn find_strip(seed: Point, viewpoint: Point, grids: &[Grid]) -> Option<ApparentRadius> {
    parallel::go_on();
    let ray = normalized(sub(seed, viewpoint));
    let range = dot(sub(seed, viewpoint), ray);
    let least = (0..3).min_by(|&a, &b| ray[a].abs().total_cmp(&ray[b].abs()))?;
    let x = normalized(cross(ray, std::array::from_fn(|k| f64::from(k == least))));
    let y = cross(ray, x);
    for grid in grids {
        let mut near: Vec<(f64, [f64; 2])> = Vec::new();
        grid.visit_near(seed, f64::INFINITY, |_, p, squared| {
            let d = sub(p, viewpoint);
            let d = advance(d.map(|v| v * range / dot(d, ray)), -range, ray);
            near.push((squared, [dot(d, x), dot(d, y)]));
        });
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut sum, mut squares, mut next) = ([0.0; 2], [0.0; 3], 0.0);
        for (i, &(squared, [u, v])) in near.iter().enumerate() {
            if squared > next && i >= MIN_POINTS {
                let n = i as f64;
                let (a, b, c) = (
                    squares[0] / n - (sum[0] / n).powi(2),
                    squares[1] / n - sum[0] * sum[1] / (n * n),
                    squares[2] / n - (sum[1] / n).powi(2),
                );
                let (mean, half) = (0.5 * (a + c), (0.25 * (a - c).powi(2) + b * b).sqrt());
                let (small, large) = (mean - half, mean + half);
                if small > 0.0 && large > ELONGATION * small {
                    // sides of a rectangle with these variances
                    let area = 12.0 * (small * large).sqrt();
                    return Some(ApparentRadius {
                        radius: (3.0 * small).sqrt(),
                        footprint: (area / n).sqrt(),
                    });
                }
                next = squared * GROWTH * GROWTH;
            }
            sum = [sum[0] + u, sum[1] + v];
            squares = [squares[0] + u * u, squares[1] + u * v, squares[2] + v * v];
        }
    }
    None
}
