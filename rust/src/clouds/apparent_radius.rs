//! A rope's radius from how wide it looks to one camera.
//!
//! Seen from its camera, a stretch of rope is a strip whose points lie between −r and r of its middle. Across the
//! strip their variance is r² / 3, however large the noise along the viewing rays is.

use rayon::prelude::*;

use crate::checks::{check_finite, check_positive};
use crate::error::Result;
use crate::geometry::{Point, advance, cross, dot, normalized, sub};
use crate::index::Grid;
use crate::parallel;

/// Patches grow until they are a strip: the larger of their variances is this many times the smaller.
const ELONGATION: f64 = 6.0;
/// Growth of a patch from one look to the next.
const GROWTH: f64 = 1.2;
/// Fewest points of a strip.
const FEWEST: usize = 24;
/// How far from its seed the points of a patch may be, in largest radii: near ones first, as they are cheaper.
const REACHES: [f64; 2] = [0.5, 2.5];
/// Seeds worked on by one task; fixed, so that results do not depend on the number of threads.
const SEEDS_PER_TASK: usize = 16;

/// What a patch says of the rope around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ApparentRadius {
    /// Half the strip's width, metres.
    pub radius: f64,
    /// Side of the square that each point of the strip stands for, across the viewing ray, metres.
    pub footprint: f64,
}

/// Estimates the rope's radius at up to `seeds` points that one camera saw, spread over the cloud.
///
/// Around each seed a patch grows, projected along the viewing ray, until it is longer than wide; half its width is
/// √(3 λ), λ the smaller eigenvalue of its covariance. Seeds whose patches never become strips give no radius, nor do
/// strips wider than `largest`. Strands side by side look like one wide strip: take the most frequent value.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite or `largest` is not positive.
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
        // the finer grid's order runs through the cloud from cell to cell, so every k-th point spreads over it
        let chosen: Vec<Point> = (0..points.len()).step_by(step).map(|i| grids[0].point(i)).collect();
        let found: Vec<Vec<Option<ApparentRadius>>> = chosen
            .par_chunks(SEEDS_PER_TASK)
            .map(|seeds| seeds.iter().map(|&seed| strip(seed, viewpoint, &grids)).collect())
            .collect();
        found.into_iter().flatten().flatten().filter(|strip| strip.radius <= largest).collect()
    }))
}

/// The strip around a seed.
fn strip(seed: Point, viewpoint: Point, grids: &[Grid]) -> Option<ApparentRadius> {
    parallel::go_on();
    let ray = normalized(sub(seed, viewpoint));
    let range = dot(sub(seed, viewpoint), ray);
    let least = (0..3).min_by(|&a, &b| ray[a].abs().total_cmp(&ray[b].abs()))?;
    let x = normalized(cross(ray, std::array::from_fn(|k| f64::from(k == least))));
    let y = cross(ray, x);
    for grid in grids {
        let mut near: Vec<(f64, [f64; 2])> = Vec::new();
        grid.visit_near(seed, |_, p, squared| {
            let d = sub(p, viewpoint);
            let d = advance(d.map(|v| v * range / dot(d, ray)), -range, ray);
            near.push((squared, [dot(d, x), dot(d, y)]));
            true
        });
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (mut sum, mut squares, mut next) = ([0.0; 2], [0.0; 3], 0.0);
        for (i, &(squared, [u, v])) in near.iter().enumerate() {
            if squared > next && i >= FEWEST {
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
