//! Bindings of surface normals. Sections and equations are those of *Shape Modeling of A String And Recognition Using
//! Distance Sensor*.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use super::arguments::{Points, Rows, Viewpoint, count, number};
use super::arrays::{PointsArray, list, points_array};
use super::released::released;
use crate::error::Error;
use crate::normals::{Neighbors, Viewpoints};
use crate::parallel;

/// Estimate surface normals from the plane through each point's neighbours (section IV-B, eq. 10-14).
///
/// The normal n minimises sum (n . q_i - d)^2 with d = n . mean(q). It is the eigenvector of the neighbours' covariance
/// with the smallest eigenvalue, turned towards the camera that saw the point.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     A point cloud, metres, any frame.
/// k : int, optional
///     Fit to the k nearest points, the point itself included; at least 3. Give `k` or `radius`.
/// radius : float, optional
///     Fit to all points within this distance, metres.
/// viewpoint : (3,) or (N, 3) array_like of float, optional
///     The camera's centre, or one for each point, metres, in the points' frame; by default the origin, for points in the
///     camera frame.
/// variation : bool
///     Also return the surface variation.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or drop them and give them no normal.
///
/// Returns
/// -------
/// normals : (N, 3) ndarray
///     Outward unit normals; the zero vector where the neighbours do not span a plane (fewer than three, all on a line, or
///     in one place).
/// variation : (N,) ndarray
///     l0 / (l0 + l1 + l2) of the covariance's ascending eigenvalues, 0 on a plane; only with `variation=True`.
///
/// Raises
/// ------
/// TypeError
///     If an array does not hold floating point numbers, or not exactly one of `k` and `radius` is given.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, `k` < 3, or `radius` is not positive.
/// strand.NotEnoughDataError
///     If there are points, but fewer than `k`.
#[pyfunction]
#[pyo3(signature = (points, k = None, radius = None, viewpoint = None, *, variation = false, nonfinite = "raise"))]
pub(super) fn estimate_normals<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    k: Option<&Bound<'py, PyAny>>,
    radius: Option<&Bound<'py, PyAny>>,
    viewpoint: Option<&Bound<'py, PyAny>>,
    variation: bool,
    nonfinite: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let points = Points::new("points", points, "(N, 3)")?;
    let neighbors = match (k, radius) {
        (Some(k), None) => Neighbors::Nearest(count("k", k)?),
        (None, Some(radius)) => Neighbors::Within(number("radius", radius)?),
        _ => return Err(PyTypeError::new_err("expected exactly one of k and radius")),
    };
    let camera = Ok(Viewpoint::One([0.0; 3]));
    let viewpoint = viewpoint.map_or(camera, |value| Viewpoint::new(value, points.len()))?;
    let rows = Rows::new(nonfinite, &[&points, viewpoint.each().unwrap_or(&points)])?;
    let (normals, variations) = released(py, move || {
        let points = rows.select(&points);
        let found = viewpoint.of(&rows, |of| crate::estimate_normals(&points, neighbors, of))?;
        Ok::<_, Error>((rows.scatter(found.normals, [0.0; 3]), rows.scatter(found.variation, 0.0)))
    })??;
    let normals = points_array(py, normals)?;
    if variation {
        Ok((normals, list(py, variations)?).into_pyobject(py)?.into_any())
    } else {
        Ok(normals.into_any())
    }
}

/// Estimate the normals of several clouds from all points within a radius, towards a camera at the origin; see
/// `estimate_normals`.
#[pyfunction]
pub(super) fn estimate_normals_each<'py>(
    py: Python<'py>,
    clouds: Vec<Bound<'py, PyAny>>,
    radius: f64,
) -> PyResult<Vec<PointsArray<'py>>> {
    let clouds = Points::all("clouds", &clouds)?;
    let (near, camera) = (Neighbors::Within(radius), Viewpoints::One([0.0; 3]));
    let found =
        released(py, move || parallel::each(&clouds, |cloud| crate::estimate_normals(cloud, near, camera)))??;
    found.into_iter().map(|found| points_array(py, found.normals)).collect()
}
