//! Bindings of density, and of distances between points.

use numpy::PyArray1;
use pyo3::prelude::*;

use super::arguments::{Array, FloatArray, Points, require_same_length, slices, wrong_shape};
use super::arrays::{PointsArray, list, points_array};
use super::released::{CHEAP, released_if_long, released_if_many};
use crate::checks::check_positive;
use crate::clouds::{density, proximity};
use crate::geometry::polyline;

/// A number for each node.
type Counts<'py> = Bound<'py, PyArray1<i64>>;

/// Return the median number of other points within a radius of a point; 0 without points.
#[pyfunction]
pub(super) fn count_typical_neighbors(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    radius: f64,
) -> PyResult<usize> {
    let points = Points::new("points", points, "(N, 3)")?;
    let nanoseconds = 20 * points.len();
    Ok(released_if_long(py, nanoseconds, move || density::typical_neighbors(&points, radius))??)
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
    let nanoseconds = 40 * (points.len() + others.len());
    list(py, released_if_long(py, nanoseconds, move || proximity::squared_distances(&points, &others))??)
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
    let nanoseconds = 40 * (points.len() + others.len());
    let found = released_if_long(py, nanoseconds, move || proximity::nearest(&points, &others))??;
    list(py, found.into_iter().map(|number| number.map_or(-1, |number| number as i64)).collect())
}

/// Count the points that are nearest to each of some nodes, and the views that they come from.
///
/// Parameters
/// ----------
/// arc_lengths : (N,) array_like of float
///     Each point's place along the curve of the nodes, metres, view by view.
/// views : (N,) ndarray of int64
///     The points' views.
/// nodes : (M,) array_like of float
///     Arc lengths of the nodes, evenly spaced from 0, metres, M >= 2.
///
/// Returns
/// -------
/// points, views : (M,) ndarray of int64
#[pyfunction]
pub(super) fn count_seen<'py>(
    py: Python<'py>,
    arc_lengths: &Bound<'py, PyAny>,
    views: &Bound<'py, PyAny>,
    nodes: &Bound<'py, PyAny>,
) -> PyResult<(Counts<'py>, Counts<'py>)> {
    let arc_lengths = Array::<f64>::exactly("arc_lengths", arc_lengths, 1)?;
    let (views, nodes) = (Array::<i64>::exactly("views", views, 1)?, FloatArray::new("nodes", nodes)?);
    let &[start, next, ..] = nodes.slice() else {
        return Err(wrong_shape("nodes", "(M,), M >= 2", nodes.shape()));
    };
    let (spacing, number) = (next - start, nodes.slice().len());
    check_positive("nodes", spacing)?;
    let count = arc_lengths.slice().len();
    require_same_length("views", views.slice().len(), count)?;
    let [points, cameras] = released_if_many(py, count / CHEAP, move || {
        polyline::count_seen(arc_lengths.slice(), views.slice(), spacing, number)
    })?;
    Ok((list(py, points)?, list(py, cameras)?))
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
    let nanoseconds = 16 * points.len() + 200 * places.len();
    points_array(
        py,
        released_if_long(py, nanoseconds, move || {
            density::variances_around(&points, &places, reach, fewest)
        })??,
    )
}
