//! Bindings of how densely points lie.

use pyo3::prelude::*;

use super::arguments::{FloatArray, rows_of};
use crate::density;

/// The median number of other points within a radius of a point; 0 for no points.
#[pyfunction]
pub(super) fn typical_neighbors(py: Python<'_>, points: &Bound<'_, PyAny>, radius: f64) -> PyResult<usize> {
    let points = FloatArray::new("points", points)?;
    let points = points.rows("points", "(N, 3)")?;
    Ok(py.detach(|| density::typical_neighbors(points, radius))?)
}

/// How many voxels of a side's length hold points of some clouds.
#[pyfunction]
pub(super) fn occupied_voxels(py: Python<'_>, points: Vec<Bound<'_, PyAny>>, side: f64) -> PyResult<usize> {
    let clouds = FloatArray::all("points", &points)?;
    let clouds = rows_of("points", &clouds)?;
    Ok(py.detach(|| density::occupied_voxels(&clouds, side))?)
}
