//! Bindings of how densely points lie, and how near others are.

use numpy::PyArray1;
use pyo3::prelude::*;

use super::arguments::{Points, slices};
use super::arrays::{PointsArray, list, points_array};
use super::released::{CHEAP, released, released_if_many};
use crate::clouds::{density, proximity};

/// The median number of other points within a radius of a point; 0 for no points.
#[pyfunction]
pub(super) fn typical_neighbors(py: Python<'_>, points: &Bound<'_, PyAny>, radius: f64) -> PyResult<usize> {
    let points = Points::new("points", points, "(N, 3)")?;
    Ok(released(py, move || density::typical_neighbors(&points, radius))??)
}

/// How many voxels of a side's length hold points of some clouds.
#[pyfunction]
pub(super) fn occupied_voxels(py: Python<'_>, points: Vec<Bound<'_, PyAny>>, side: f64) -> PyResult<usize> {
    let clouds = Points::all("points", &points)?;
    let count: usize = clouds.iter().map(|points| points.len()).sum();
    Ok(released_if_many(py, count / CHEAP, move || density::occupied_voxels(&slices(&clouds), side))??)
}

/// The squared distance of each of some points from the nearest of others; infinity where there are none.
#[pyfunction]
pub(super) fn squared_distances<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    others: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let others = Points::new("others", others, "(M, 3)")?;
    let count = points.len() + others.len();
    list(py, released_if_many(py, count, move || proximity::squared_distances(&points, &others))??)
}

/// (M, 3) Variances of the points within `reach` of each of some places along their principal axes, the least first, m^2; NaN
/// where there are fewer than `fewest`.
#[pyfunction]
pub(super) fn variances_around<'py>(
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
