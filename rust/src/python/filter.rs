//! Bindings of the outlier filter. Sections are those of *Shape Modeling of A String And Recognition Using Distance
//! Sensor*.

use numpy::PyArray1;
use pyo3::prelude::*;

use super::arguments::{Points, Rows, count, number};
use super::arrays::list;
use super::released::{released, released_if_long};
use crate::error::Error;
use crate::parallel;

/// Return which points have enough neighbours within a searching radius (section IV-A).
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     A point cloud, metres, any frame.
/// radius : float
///     The searching radius, metres.
/// min_neighbors : int
///     Other points that must lie within `radius`, boundary included; coincident points count each other.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or treat them as outliers and as neighbours of no
///     point.
///
/// Returns
/// -------
/// (N,) ndarray of bool
///     True for the points to keep.
///
/// Raises
/// ------
/// TypeError
///     If `points` does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, `radius` is not positive, or `min_neighbors` is
///     negative.
#[pyfunction]
#[pyo3(signature = (points, radius, min_neighbors, *, nonfinite = "raise"))]
pub(super) fn radius_outlier_mask<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    min_neighbors: &Bound<'py, PyAny>,
    nonfinite: &str,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let min_neighbors = count("min_neighbors", min_neighbors)?;
    let radius = number("radius", radius)?;
    let rows = Rows::new(nonfinite, &[&points])?;
    let mask = released(py, move || {
        let mask = crate::radius_outlier_mask(&rows.select(&points), radius, min_neighbors)?;
        Ok::<_, Error>(rows.scatter(mask, false))
    })??;
    list(py, mask)
}

/// Count each point's neighbours within a radius.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     A point cloud, metres, any frame.
/// radius : float
///     The searching radius, metres.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or give them no neighbours.
///
/// Returns
/// -------
/// (N,) ndarray of int64
///     The number of other points within `radius`, boundary included.
///
/// Raises
/// ------
/// TypeError
///     If `points` does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, or `radius` is not positive.
#[pyfunction]
#[pyo3(signature = (points, radius, *, nonfinite = "raise"))]
pub(super) fn count_neighbors<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    nonfinite: &str,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let radius = number("radius", radius)?;
    let rows = Rows::new(nonfinite, &[&points])?;
    let counts = released_if_long(py, 50 * points.len(), move || {
        let counts = crate::count_neighbors(&rows.select(&points), radius)?;
        Ok::<_, Error>(rows.scatter(whole(counts), 0))
    })??;
    list(py, counts)
}

/// Count the neighbours of the points of several clouds; see `count_neighbors`.
#[pyfunction]
pub(super) fn count_neighbors_each<'py>(
    py: Python<'py>,
    clouds: Vec<Bound<'py, PyAny>>,
    radius: f64,
) -> PyResult<Vec<Bound<'py, PyArray1<i64>>>> {
    let clouds = Points::all("clouds", &clouds)?;
    let counts = released(py, move || {
        parallel::each(&clouds, |cloud| Ok(whole(crate::count_neighbors(cloud, radius)?)))
    })??;
    counts.into_iter().map(|counts| list(py, counts)).collect()
}

fn whole(counts: Vec<usize>) -> Vec<i64> {
    counts.into_iter().map(|count| count as i64).collect()
}
