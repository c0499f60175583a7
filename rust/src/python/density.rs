//! Bindings of density, and of distances between points.

use numpy::PyArray1;
use pyo3::prelude::*;

use super::arguments::{Points, slices};
use super::arrays::{PointsArray, list, points_array};
use super::released::{CHEAP, released, released_if_many};
use crate::clouds::{density, proximity};

/// Return the median number of other points within a radius of a point; 0 without points.
#[pyfunction]
pub(super) fn count_typical_neighbors(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    radius: f64,
) -> PyResult<usize> {
    let points = Points::new("points", points, "(N, 3)")?;
    Ok(released(py, move || density::typical_neighbors(&points, radius))??)
}

/// Count the voxels that hold points of some clouds; `side` is the edge of a voxel, metres.
#[pyfunction]
pub(super) fn count_voxels(py: Python<'_>, points: Vec<Bound<'_, PyAny>>, side: f64) -> PyResult<usize> {
    let clouds = Points::all("points", &points)?;
    let count: usize = clouds.iter().map(|points| points.len()).sum();
    Ok(released_if_many(py, count / CHEAP, move || density::occupied_voxels(&slices(&clouds), side))??)
}

/// Return the squared distance of each point to the nearest of others; infinity if there are none.
#[pyfunction]
pub(super) fn find_squared_distances<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    others: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let others = Points::new("others", others, "(M, 3)")?;
    let count = points.len() + others.len();
    list(py, released_if_many(py, count, move || proximity::squared_distances(&points, &others))??)
}

/// Return the number of the nearest of others to each point, the first among equals; -1 if there are none.
#[pyfunction]
pub(super) fn find_nearest<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    others: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let others = Points::new("others", others, "(M, 3)")?;
    let count = points.len() + others.len();
    let found = released_if_many(py, count, move || proximity::nearest(&points, &others))??;
    list(py, found.into_iter().map(|number| number.map_or(-1, |number| number as i64)).collect())
}

/// Return (M, 3) variances along the principal axes of the points within `reach` of each place, ascending, m^2; NaN
/// where there are fewer than `fewest` points.
#[pyfunction]
pub(super) fn measure_variances<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    places: &Bound<'py, PyAny>,
    reach: f64,
    fewest: usize,
) -> PyResult<PointsArray<'py>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let places = Points::new("places", places, "(M, 3)")?;
    points_array(py, released(py, move || density::variances_around(&points, &places, reach, fewest))??)
}
