//! Bindings of axis points and chains. Sections, equations and figures are those of *Shape Modeling of A String And
//! Recognition Using Distance Sensor*.

use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyList;

use super::arguments::{Points, Rows, count, number, require_same_length};
use super::arrays::{PointsArray, list, points_array};
use super::released::released;
use crate::error::Error;

const CHAINS_BETWEEN_SIGNALS: usize = 1 << 14; // chains that are converted to arrays between two checks for signals

/// Compute axis points from surface points and normals (section IV-D, eq. 16-18).
///
/// Every surface point moves inwards by the rope's radius: c_i = p_i - r n_i. Where at least `min_neighbors` points
/// p_j, p_i included, lie within 2r of p_i, the axis point is the mean of their c_j.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     Surface points, metres, any frame.
/// normals : (N, 3) array_like of float
///     Their outward unit normals; points with the zero vector take no part.
/// radius : float
///     The rope's radius r, metres.
/// min_neighbors : int
///     N_lim.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or drop them.
///
/// Returns
/// -------
/// axis_points : (M, 3) ndarray
///     Averaged axis points, metres, in the order of the points they belong to.
/// indices : (M,) ndarray of int64
///     The index of the input point that each was computed at.
///
/// Raises
/// ------
/// TypeError
///     If an array does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, a normal is neither of unit length nor zero, or
///     `radius` is not positive.
#[pyfunction]
#[pyo3(signature = (points, normals, radius, min_neighbors, *, nonfinite = "raise"))]
pub(super) fn centerline<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    normals: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    min_neighbors: &Bound<'py, PyAny>,
    nonfinite: &str,
) -> PyResult<(PointsArray<'py>, Bound<'py, PyArray1<i64>>)> {
    let (points, normals) =
        (Points::new("points", points, "(N, 3)")?, Points::new("normals", normals, "(N, 3)")?);
    require_same_length("normals", normals.len(), points.len())?;
    let radius = number("radius", radius)?;
    let min_neighbors = count("min_neighbors", min_neighbors)?;
    let rows = Rows::new(nonfinite, &[&points, &normals])?;
    let (points, indices) = released(py, move || {
        let found = crate::centerline(&rows.select(&points), &rows.select(&normals), radius, min_neighbors)?;
        Ok::<_, Error>((found.points, rows.original(found.indices)))
    })??;
    Ok((points_array(py, points)?, list(py, indices)?))
}

/// Trace ordered chains through axis points (section V-A, fig. 9-10).
///
/// From a base point on, all points within `near` of the current node stop being targets, and the nearest target within
/// `far` becomes the next node. When none is left, the other side of the base grows in the same way. The remaining
/// targets form further chains.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     Axis points, metres, any frame.
/// near : float
///     r_n, the least distance between nodes, metres.
/// far : float
///     r_f > r_n, the reach to the next node, metres.
/// start : int, optional
///     The first base point. By default, and for later chains, it is the target farthest from the cloud's centroid.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or drop them.
///
/// Returns
/// -------
/// list of (K,) ndarray of int64
///     Indices of each chain's nodes from end to end; chains are in the order in which they were found. A point without a
///     target in reach forms a chain of one node.
///
/// Raises
/// ------
/// TypeError
///     If `points` does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, `near` is not positive, `far` is not above `near`, or
///     `start` is not the index of a point that takes part.
#[pyfunction]
#[pyo3(signature = (points, near, far, *, start = None, nonfinite = "raise"))]
pub(super) fn trace_chains<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    near: &Bound<'py, PyAny>,
    far: &Bound<'py, PyAny>,
    start: Option<&Bound<'py, PyAny>>,
    nonfinite: &str,
) -> PyResult<Bound<'py, PyList>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let (near, far) = (number("near", near)?, number("far", far)?);
    let rows = Rows::new(nonfinite, &[&points])?;
    let start = start.map(|value| count("start", value)).transpose()?;
    let start = match (start, &rows.kept) {
        (Some(start), Some(kept)) => Some(kept.binary_search(&start).map_err(|_| {
            PyValueError::new_err(format!("start: expected the index of a finite point, got {start}"))
        })?),
        (start, _) => start,
    };
    let chains = released(py, move || {
        let chains = crate::trace_chains(&rows.select(&points), near, far, start)?;
        Ok::<Vec<_>, Error>(chains.into_iter().map(|chain| rows.original(chain)).collect())
    })??;
    // there may be as many chains as points
    let found = PyList::empty(py);
    for (number, chain) in chains.into_iter().enumerate() {
        found.append(list(py, chain)?)?;
        if number % CHAINS_BETWEEN_SIGNALS == 0 {
            py.check_signals()?;
        }
    }
    Ok(found)
}
