//! The density of points.

use rayon::prelude::*;
use rustc_hash::FxHashSet;

use crate::checks::{check_finite, check_positive};
use crate::error::Result;
use crate::geometry::{Moments, Point, cell_of, eigen_symmetric, squared_distance, sub};
use crate::index::Grid;
use crate::parallel;

const SAMPLE: usize = 250; // points, evenly spaced in the input, of which the median is taken
const POINTS_PER_TASK: usize = 25; // points of the sample that one task works on

/// Returns the typical number of other points within `radius` of a point: the median over a sample, 0 without points.
pub(crate) fn typical_neighbors(points: &[Point], radius: f64) -> Result<usize> {
    check_finite("points", points)?;
    check_positive("radius", radius)?;
    let step = points.len().div_ceil(SAMPLE).max(1);
    let mut counts: Vec<usize> = parallel::run(|| {
        let grid = Grid::new(points, radius);
        let others = |position: usize| {
            parallel::go_on();
            let mut count = 0;
            grid.visit_around(position, |_, _, _| count += 1);
            count - 1
        };
        (0..points.len()).into_par_iter().step_by(step).with_min_len(POINTS_PER_TASK).map(others).collect()
    });
    let middle = counts.len() / 2;
    Ok(if counts.is_empty() { 0 } else { *counts.select_nth_unstable(middle).1 })
}

/// Counts the voxels of a lattice that hold points; `side` is the edge of a voxel.
pub(crate) fn occupied_voxels(points: &[&[Point]], side: f64) -> Result<usize> {
    check_positive("side", side)?;
    for points in points {
        check_finite("points", points)?;
    }
    let mut voxels = FxHashSet::default();
    let mut last = None;
    for &p in points.iter().copied().flatten() {
        let voxel = Some(cell_of(p, side));
        // neighbours in an image mostly share a voxel
        if voxel != last {
            voxels.extend(voxel);
            last = voxel;
        }
    }
    Ok(voxels.len())
}

/// Returns the variances along the principal axes of the points within `reach` of each place, ascending, m²; NaN where
/// there are fewer than `fewest` points.
pub(crate) fn variances_around(
    points: &[Point],
    places: &[Point],
    reach: f64,
    fewest: usize,
) -> Result<Vec<[f64; 3]>> {
    check_finite("points", points)?;
    check_finite("places", places)?;
    check_positive("reach", reach)?;
    Ok(parallel::map(places, |&place| {
        let mut around = Moments::default();
        for &p in points {
            if squared_distance(p, place) < reach * reach {
                around.add(sub(p, place));
            }
        }
        if around.count() < fewest {
            return [f64::NAN; 3];
        }
        // rounding may leave less than nothing
        eigen_symmetric(&around.covariance()).values.map(|variance| variance.max(0.0))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_points_has_as_many_neighbors_to_both_sides() {
        let points: Vec<Point> = (0..5000).map(|i| [f64::from(i) * 0.1, 0.0, 0.0]).collect();
        assert_eq!(typical_neighbors(&points, 1.05).unwrap(), 20);
        assert_eq!(typical_neighbors(&points[..1], 1.05).unwrap(), 0);
        assert_eq!(typical_neighbors(&[], 1.05).unwrap(), 0);
        assert!(typical_neighbors(&points, 0.0).is_err());
    }

    #[test]
    fn voxels_count_once() {
        let points: Vec<Point> = (-50..50).map(|i| [f64::from(i) * 0.1 + 0.05, 0.0, 7.0]).collect();
        assert_eq!(occupied_voxels(&[&points, &points[..7], &[]], 1.0).unwrap(), 10);
        assert_eq!(occupied_voxels(&[], 1.0).unwrap(), 0);
        assert!(occupied_voxels(&[&points], 0.0).is_err());
        assert!(occupied_voxels(&[&[[f64::NAN; 3]]], 1.0).is_err());
    }

    #[test]
    fn variances_are_those_along_principal_axes() {
        let line: Vec<Point> = (-50..=50).map(|i| [0.0, f64::from(i), 7.0]).collect();
        let found =
            variances_around(&line, &[[0.0, 0.0, 7.0], [0.0, 50.0, 7.0], [40.0; 3]], 10.5, 11).unwrap();
        for (got, want) in found.iter().zip([[0.0, 0.0, 110.0 / 3.0], [0.0, 0.0, 10.0]]) {
            assert!(got.iter().zip(want).all(|(got, want)| (got - want).abs() < 1e-9), "{found:?}");
        }
        assert!(found[2].iter().all(|x| x.is_nan()));
        let slanted: Vec<Point> = (0..40).map(|i| [0.3, 0.7, 0.2].map(|x| x * f64::from(i))).collect();
        let found = variances_around(&slanted, &[[0.0; 3]], 1e3, 3).unwrap();
        assert!(found[0].iter().all(|&variance| variance >= 0.0), "{found:?}");
        assert!(variances_around(&line, &[], 0.0, 1).is_err());
        assert!(variances_around(&line, &[[f64::NAN; 3]], 1.0, 1).is_err());
    }
}
