//! Surface normals by principal components (section IV-B, eq. 10–14).

use std::num::NonZeroUsize;

use rayon::prelude::*;

use crate::error::{Error, Result, check_finite, check_positive, check_same_length};
use crate::geometry::{Moments, Symmetric3, dot, eigen_symmetric, sub};
use crate::index::{Grid, Tree};
use crate::{Point, parallel};

/// Which points a normal is fitted to. The point itself is one of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Neighbors {
    /// The k nearest points, k ≥ 3.
    Nearest(usize),
    /// All points within a radius, metres.
    Within(f64),
}

/// Where the cameras stood that saw the points; normals are turned towards them.
#[derive(Debug, Clone, Copy)]
pub enum Viewpoints<'a> {
    /// One camera saw all points.
    One(Point),
    /// A camera's centre for each point.
    Each(&'a [Point]),
}

/// Normals and how well they are determined.
#[derive(Debug, Clone, PartialEq)]
pub struct Normals {
    /// Outward unit normals; the zero vector where the neighbours do not span a plane.
    pub normals: Vec<Point>,
    /// Surface variation λ₀ / (λ₀ + λ₁ + λ₂) of the neighbourhood: 0 on a plane, up to 1/3; 0 where there
    /// is no normal.
    pub variation: Vec<f64>,
}

/// Least-squares plane normals: n minimises Σ (n·q_i − d)², d = n·q̄ (eq. 10–13), the eigenvector of
/// the neighbours' covariance with the smallest eigenvalue, turned to the camera (eq. 14).
///
/// A neighbourhood of fewer than three points, or of points on a line or in one place, has no plane: its
/// normal is the zero vector.
///
/// # Errors
/// [`InvalidArgument`](Error::InvalidArgument) if a coordinate is not finite, the radius is not positive,
/// k < 3, or the viewpoints are not one for each point; [`NotEnoughData`](Error::NotEnoughData) if there are
/// fewer than k points.
pub fn estimate_normals(points: &[Point], neighbors: Neighbors, viewpoints: Viewpoints) -> Result<Normals> {
    check_finite("points", points)?;
    match viewpoints {
        Viewpoints::One(viewpoint) => check_finite("viewpoint", &[viewpoint])?,
        Viewpoints::Each(all) => {
            check_same_length("viewpoint", all.len(), "points", points.len())?;
            check_finite("viewpoint", all)?;
        }
    }
    let planes = match neighbors {
        Neighbors::Nearest(k) => fit_nearest(points, k)?,
        Neighbors::Within(radius) => fit_within(points, radius)?,
    };
    let towards = |i: usize| match viewpoints {
        Viewpoints::One(viewpoint) => sub(viewpoint, points[i]),
        Viewpoints::Each(all) => sub(all[i], points[i]),
    };
    let normals = planes
        .iter()
        .enumerate()
        .map(
            |(i, plane)| {
                if dot(plane.normal, towards(i)) < 0.0 { plane.normal.map(|x| -x) } else { plane.normal }
            },
        )
        .collect();
    Ok(Normals { normals, variation: planes.iter().map(|plane| plane.variation).collect() })
}

#[derive(Clone, Copy, Default)]
struct Plane {
    normal: Point,
    variation: f64,
}

fn fit_nearest(points: &[Point], k: usize) -> Result<Vec<Plane>> {
    let count = NonZeroUsize::new(k)
        .filter(|k| k.get() >= 3)
        .ok_or_else(|| Error::invalid("k", format!("expected at least 3 neighbours, got {k}")))?;
    if points.is_empty() {
        return Ok(Vec::new());
    }
    if points.len() < k {
        return Err(Error::not_enough(
            "points",
            format!("{} points, fewer than the k = {k} neighbours asked for", points.len()),
        ));
    }
    Ok(parallel::run(|| {
        let tree = Tree::new(points);
        points
            .par_iter()
            .map(|&center| {
                let mut moments = Moments::default();
                for i in tree.nearest(center, count) {
                    moments.add(sub(points[i], center));
                }
                plane(&moments)
            })
            .collect()
    }))
}

fn fit_within(points: &[Point], radius: f64) -> Result<Vec<Plane>> {
    check_positive("radius", radius)?;
    Ok(parallel::run(|| {
        Grid::new(points, radius).map(|neighborhood| {
            let mut moments = Moments::default();
            let center = neighborhood.center();
            neighborhood.visit(|_, q, _| {
                moments.add(sub(q, center));
                true
            });
            plane(&moments)
        })
    }))
}

/// The plane through a neighbourhood, or none where it has fewer than two directions.
fn plane(moments: &Moments) -> Plane {
    let covariance: Symmetric3 = moments.covariance();
    let eigen = eigen_symmetric(&covariance);
    let [smallest, middle, largest] = eigen.values;
    // the second direction must stand out of what rounding leaves of a line
    if moments.count() < 3 || middle <= 1e-12 * largest {
        return Plane::default();
    }
    let variation = (smallest / (smallest + middle + largest)).max(0.0);
    Plane { normal: eigen.vectors[0], variation }
}
