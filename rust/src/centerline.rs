//! Axis points from surface points and normals (section IV-D, eq. 16–18).

use crate::error::{Result, check_finite, check_normals, check_positive, check_same_length};
use crate::index::Grid;
use crate::{Point, parallel};

/// Points of the string's axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Centerline {
    /// c̄, the averaged axis points, metres.
    pub points: Vec<Point>,
    /// Which input point each of them was computed at.
    pub indices: Vec<usize>,
}

/// Moves every surface point inwards by the string's radius, c_i = p_i − r n_i (eq. 16), and averages: where at
/// least `min_neighbors` points p_j lie within 2r of p_i (p_i itself is one), c̄_i is the mean of their c_j
/// (eq. 17–18).
///
/// Points whose normal is the zero vector take no part.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite, a normal is neither of
/// unit length nor zero, the lengths of the arrays differ, or `radius` is not positive.
pub fn centerline(
    points: &[Point],
    normals: &[Point],
    radius: f64,
    min_neighbors: usize,
) -> Result<Centerline> {
    check_finite("points", points)?;
    check_same_length("normals", normals.len(), "points", points.len())?;
    check_normals("normals", normals)?;
    check_positive("radius", radius)?;
    let indices: Vec<usize> = (0..points.len()).filter(|&i| normals[i] != [0.0; 3]).collect();
    let surface: Vec<Point> = indices.iter().map(|&i| points[i]).collect();
    let offsets: Vec<Point> = indices.iter().map(|&i| normals[i].map(|x| -radius * x)).collect();
    let means = parallel::run(|| {
        let grid = Grid::new(&surface, 2.0 * radius);
        let offsets = grid.gather(&offsets);
        grid.map(|neighborhood| {
            let center = neighborhood.center();
            let mut count = 0usize;
            let mut sum = [0.0; 3];
            neighborhood.visit(|j, q, _| {
                count += 1;
                for k in 0..3 {
                    sum[k] += (q[k] - center[k]) + offsets[j][k];
                }
                true
            });
            let mean: Point = std::array::from_fn(|k| center[k] + sum[k] / count as f64);
            (count >= min_neighbors).then_some(mean)
        })
    });
    let kept = means.iter().zip(&indices).filter_map(|(mean, &i)| mean.map(|mean| (mean, i)));
    let (points, indices) = kept.unzip();
    Ok(Centerline { points, indices })
}
