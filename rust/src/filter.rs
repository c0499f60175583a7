//! Outlier filter: drop points with too few neighbours within a searching radius (section IV-A).

use crate::error::{Result, check_finite, check_positive};
use crate::index::{Grid, Neighborhood};
use crate::{Point, parallel};

/// Which points have at least `min_neighbors` other points within `radius`.
///
/// A point on the boundary counts; coincident points count each other. An empty cloud gives an empty mask.
///
/// # Errors
/// [`InvalidArgument`](crate::Error::InvalidArgument) if a coordinate is not finite or `radius` is not
/// positive.
pub fn radius_outlier_mask(points: &[Point], radius: f64, min_neighbors: usize) -> Result<Vec<bool>> {
    check(points, radius)?;
    // the point itself is found as well
    let wanted = min_neighbors.saturating_add(1);
    Ok(map(points, radius, |neighborhood| count(neighborhood, wanted) >= wanted))
}

/// How many other points lie within `radius` of each point.
///
/// # Errors
/// As [`radius_outlier_mask`].
pub fn count_neighbors(points: &[Point], radius: f64) -> Result<Vec<usize>> {
    check(points, radius)?;
    Ok(map(points, radius, |neighborhood| count(neighborhood, usize::MAX) - 1))
}

fn check(points: &[Point], radius: f64) -> Result<()> {
    check_finite("points", points)?;
    check_positive("radius", radius)
}

fn map<T: Send + Copy + Default>(
    points: &[Point],
    radius: f64,
    answer: impl Fn(&Neighborhood) -> T + Send + Sync,
) -> Vec<T> {
    parallel::run(|| Grid::new(points, radius).map(answer))
}

/// Points in a neighbourhood, the centre included; counting stops at `enough`.
#[inline]
fn count(neighborhood: &Neighborhood, enough: usize) -> usize {
    let mut count = 0;
    neighborhood.visit(|_, _, _| {
        count += 1;
        count < enough
    });
    count
}
