//! Surface normals by principal components (section IV-B, eq. 10–14).
//!
//! Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.

use crate::checks::{check_finite, check_positive, check_same_length};
use crate::error::Result;
use crate::geometry::{Moments, Point, dot, sub};
use crate::index::around::Around;
use crate::index::bounds::Bounds;
use crate::index::cells::Cells;
use crate::index::hierarchy::crowded::Crowded;
use crate::parallel;
use crate::parallel::Slots;
use crate::simd::{BATCH, kernel};
use mass::Mass;
pub use planes::Viewpoints;
use planes::{Answers, Covariances, plane};
use sums::Sums;

mod mass;
mod nearest;
mod planes;
mod sums;

const CELLS: f64 = 1.0; // width of a cell, radii

/// The points that a normal is fitted to. The point itself is one of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Neighbors {
    /// The k nearest points, k ≥ 3.
    Nearest(usize),
    /// All points within a radius, metres.
    Within(f64),
}

/// Normals, and how well each is determined.
#[derive(Debug, Clone, PartialEq)]
pub struct Normals {
    /// Outward unit normals; the zero vector where the neighbours do not span a plane.
    pub normals: Vec<Point>,
    /// Surface variation λ₀ / (λ₀ + λ₁ + λ₂) of the neighbourhood: 0 on a plane, 1/3 at most; 0 where there is no
    /// normal.
    pub variation: Vec<f64>,
}

/// Estimates surface normals by fitting planes to neighbourhoods.
///
/// The normal n minimises Σ (n·q_i − d)², d = n·q̄ (eq. 10–13): it is the eigenvector of the neighbours' covariance
/// with the smallest eigenvalue, turned towards the camera (eq. 14). A neighbourhood of fewer than three points, or of
/// points on a line or in one place, has no plane; its normal is the zero vector.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite, the radius is not positive, k < 3,
/// or there is not one viewpoint for each point; [`NotEnoughData`](crate::Error::NotEnoughData) if there are fewer than
/// k points.
pub fn estimate_normals(points: &[Point], neighbors: Neighbors, viewpoints: Viewpoints) -> Result<Normals> {
    check_finite("points", points)?;
    match viewpoints {
        Viewpoints::One(viewpoint) => check_finite("viewpoint", &[viewpoint])?,
        Viewpoints::Each(all) => {
            check_same_length("viewpoint", all.len(), "points", points.len())?;
            check_finite("viewpoint", all)?;
        }
    }
    let mut normals = vec![[0.0; 3]; points.len()];
    let mut variation = vec![0.0; points.len()];
    let answers =
        Answers { viewpoints, normals: Slots::new(&mut normals), variation: Slots::new(&mut variation) };
    match neighbors {
        Neighbors::Nearest(k) => nearest::fit(points, k, &answers)?,
        Neighbors::Within(radius) => {
            check_positive("radius", radius)?;
            parallel::run(|| fit_within(points, radius, &answers));
        }
    }
    Ok(Normals { normals, variation })
}

fn fit_within(points: &[Point], radius: f64, answers: &Answers) {
    let cells = Cells::new(points, radius / CELLS);
    let crowded = Crowded::default();
    cells.batches().for_each_task(|buffers: &mut (Around, Sums, Covariances), batches| {
        let (around, sums, covariances) = buffers;
        for batch in batches {
            let open = sum_within(&cells, radius, batch, around, sums);
            let Some(open) = open else {
                crowded.add(batch.iter().map(|&position| cells.input_index(position as usize)));
                continue;
            };
            for (l, &position) in batch.iter().enumerate() {
                let position = position as usize;
                let covariance = sums.covariance(l).filter(|_| !open[l]).unwrap_or_else(|| {
                    let center = cells.point(position);
                    let mut moments = Moments::default();
                    for i in around.positions() {
                        let d = sub(cells.point(i), center);
                        if dot(d, d) <= radius * radius {
                            moments.add(d);
                        }
                    }
                    moments.covariance()
                });
                covariances.add(position, covariance);
            }
        }
        covariances.fit(&cells, answers);
    });
    drop(cells);
    let fitted = |mass: Mass| plane(&mass.covariance());
    // SAFETY: every point has one answer
    let put = |i: usize, plane: &(Point, f64)| unsafe { answers.put(i, points[i], plane.0, plane.1) };
    crowded.answer(points, radius, |i| Mass::of(points[i]), fitted, put);
}

kernel! {
    /// Sums over the points within a radius of each point of a batch, and reports the points for which single precision
    /// does not decide. None where cells are crowded.
    fn sum_within<S>(
        simd,
        cells: &Cells,
        radius: f64,
        batch: &[u32],
        around: &mut Around,
        sums: &mut Sums,
    ) -> Option<[bool; BATCH]> {
        let places = cells.batch(batch);
        let frame = around.find(simd, cells, &Bounds::of(&places), radius)?;
        let (low, high) = frame.limits(radius);
        let possible = sums.measure(simd, around, &frame.narrow(simd, &places), high);
        let certain = sums.add(simd, cells, &frame, &places, &[low; BATCH]);
        Some(std::array::from_fn(|l| certain[l] != possible[l]))
    }
}
