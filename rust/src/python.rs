//! The Python bindings: validate, release the GIL, call the core, map the error. No maths.

mod arguments;
mod curves;
mod tubes;
mod views;

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;

use arguments::{
    FloatArray, PointsArray, Rows, count, motion, number, points_array, require_same_length, viewpoints,
};

use crate::{Error, IcpOptions, Neighbors, Objective, RigidMotion, Stop, Viewpoints, parallel};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

create_exception!(strand, StrandError, PyException, "Base of the errors that strand raises of its own.");
create_exception!(strand, NotEnoughDataError, StrandError, "The data cannot support an answer.");

impl From<Error> for PyErr {
    fn from(error: Error) -> Self {
        match error {
            Error::InvalidArgument { .. } => PyValueError::new_err(error.to_string()),
            Error::NotEnoughData { .. } => NotEnoughDataError::new_err(error.to_string()),
        }
    }
}

/// Tell outliers: which points have enough neighbours within a searching radius (section IV-A).
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     A point cloud, metres, any frame.
/// radius : float
///     The searching radius, metres.
/// min_neighbors : int
///     How many other points must lie within `radius` (boundary included); coincident points count each
///     other.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or treat them as outliers that are no
///     one's neighbour.
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
fn radius_outlier_mask<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    min_neighbors: &Bound<'py, PyAny>,
    nonfinite: &str,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let array = FloatArray::new("points", points)?;
    let points = array.rows("points", "(N, 3)")?;
    let min_neighbors = count("min_neighbors", min_neighbors)?;
    let radius = number("radius", radius)?;
    let rows = Rows::new(nonfinite, &[points])?;
    let mask = py.detach(|| crate::radius_outlier_mask(&rows.select(points), radius, min_neighbors))?;
    Ok(PyArray1::from_vec(py, rows.scatter(mask, false)))
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
///     How many other points lie within `radius` (boundary included).
///
/// Raises
/// ------
/// TypeError
///     If `points` does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, or `radius` is not positive.
#[pyfunction]
#[pyo3(signature = (points, radius, *, nonfinite = "raise"))]
fn count_neighbors<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    nonfinite: &str,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let array = FloatArray::new("points", points)?;
    let points = array.rows("points", "(N, 3)")?;
    let radius = number("radius", radius)?;
    let rows = Rows::new(nonfinite, &[points])?;
    let counts = py.detach(|| crate::count_neighbors(&rows.select(points), radius))?;
    let counts = counts.into_iter().map(|count| count as i64).collect();
    Ok(PyArray1::from_vec(py, rows.scatter(counts, 0)))
}

/// Count the neighbours of the points of several clouds; see `count_neighbors`.
#[pyfunction]
fn count_neighbors_each<'py>(
    py: Python<'py>,
    clouds: Vec<Bound<'py, PyAny>>,
    radius: f64,
) -> PyResult<Vec<Bound<'py, PyArray1<i64>>>> {
    let clouds = FloatArray::all("clouds", &clouds)?;
    let clouds = clouds.iter().map(|cloud| cloud.rows("clouds", "(N, 3)")).collect::<PyResult<Vec<_>>>()?;
    let counts = py.detach(|| parallel::each(&clouds, |cloud| crate::count_neighbors(cloud, radius)))?;
    let array =
        |counts: Vec<usize>| PyArray1::from_vec(py, counts.into_iter().map(|count| count as i64).collect());
    Ok(counts.into_iter().map(array).collect())
}

/// Estimate the normals of several clouds from all points within a radius, towards a camera at the origin; see
/// `estimate_normals`.
#[pyfunction]
fn estimate_normals_each<'py>(
    py: Python<'py>,
    clouds: Vec<Bound<'py, PyAny>>,
    radius: f64,
) -> PyResult<Vec<PointsArray<'py>>> {
    let clouds = FloatArray::all("clouds", &clouds)?;
    let clouds = clouds.iter().map(|cloud| cloud.rows("clouds", "(N, 3)")).collect::<PyResult<Vec<_>>>()?;
    let (near, camera) = (Neighbors::Within(radius), Viewpoints::One([0.0; 3]));
    let found =
        py.detach(|| parallel::each(&clouds, |cloud| crate::estimate_normals(cloud, near, camera)))?;
    found.into_iter().map(|found| points_array(py, found.normals)).collect()
}

/// Estimate surface normals from the plane through each point's neighbours (section IV-B, eq. 10-14).
///
/// n minimises sum (n . q_i - d)^2 with d = n . mean(q): the eigenvector of the neighbours' covariance with
/// the smallest eigenvalue, turned towards the camera that saw the point.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     A point cloud, metres, any frame.
/// k : int, optional
///     Fit to the k nearest points, the point itself included; at least 3. Give `k` or `radius`.
/// radius : float, optional
///     Fit to all points within this distance, metres.
/// viewpoint : (3,) or (N, 3) array_like of float
///     The camera's centre, or one for each point, metres, in the points' frame; the origin (points in the
///     camera frame) if not given.
/// variation : bool
///     Return the surface variation too.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or leave them out and give them no
///     normal.
///
/// Returns
/// -------
/// normals : (N, 3) ndarray
///     Outward unit normals; the zero vector where the neighbours do not span a plane (fewer than three,
///     all on a line, or in one place).
/// variation : (N,) ndarray
///     l0 / (l0 + l1 + l2) of the covariance's ascending eigenvalues, 0 on a plane; only if asked for.
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
fn estimate_normals<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    k: Option<&Bound<'py, PyAny>>,
    radius: Option<&Bound<'py, PyAny>>,
    viewpoint: Option<&Bound<'py, PyAny>>,
    variation: bool,
    nonfinite: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let array = FloatArray::new("points", points)?;
    let points = array.rows("points", "(N, 3)")?;
    let neighbors = match (k, radius) {
        (Some(k), None) => Neighbors::Nearest(count("k", k)?),
        (None, Some(radius)) => Neighbors::Within(number("radius", radius)?),
        _ => return Err(PyTypeError::new_err("expected exactly one of k and radius")),
    };
    let viewpoint = viewpoint.map(|value| FloatArray::new("viewpoint", value)).transpose()?;
    let (one, each) = match &viewpoint {
        Some(array) => viewpoints(array, points.len())?,
        None => ([0.0; 3], None),
    };
    let rows = Rows::new(nonfinite, &[points, each.unwrap_or(points)])?;
    let result = py.detach(|| {
        let each = each.map(|each| rows.select(each));
        let viewpoints = each.as_deref().map_or(Viewpoints::One(one), Viewpoints::Each);
        crate::estimate_normals(&rows.select(points), neighbors, viewpoints)
    })?;
    let normals = points_array(py, rows.scatter(result.normals, [0.0; 3]))?;
    if variation {
        let variation = PyArray1::from_vec(py, rows.scatter(result.variation, 0.0));
        Ok((normals, variation).into_pyobject(py)?.into_any())
    } else {
        Ok(normals.into_any())
    }
}

/// What Python calls the reasons for which iterations end.
const STOPS: [(Stop, &str); 4] = [
    (Stop::Tolerance, "tolerance"),
    (Stop::Iterations, "iterations"),
    (Stop::TooFewCorrespondences, "too few correspondences"),
    (Stop::Degenerate, "degenerate"),
];

/// The outcome of `strand.icp`.
#[pyclass(frozen, module = "strand")]
struct IcpResult(crate::IcpResult);

#[pymethods]
impl IcpResult {
    #[new]
    fn new(
        transformation: &Bound<'_, PyAny>,
        fitness: &Bound<'_, PyAny>,
        inlier_rmse: &Bound<'_, PyAny>,
        iterations: &Bound<'_, PyAny>,
        converged: bool,
        stop: &str,
    ) -> PyResult<Self> {
        Ok(Self(crate::IcpResult {
            transformation: motion("transformation", transformation)?,
            fitness: number("fitness", fitness)?,
            inlier_rmse: number("inlier_rmse", inlier_rmse)?,
            iterations: count("iterations", iterations)?,
            converged,
            stop: STOPS.iter().find(|(_, name)| *name == stop).map(|(reason, _)| *reason).ok_or_else(
                || {
                    let names = STOPS.map(|(_, name)| format!("\"{name}\"")).join(", ");
                    PyValueError::new_err(format!("stop: expected one of {names}, got \"{stop}\""))
                },
            )?,
        }))
    }

    /// What a pickle makes it of again.
    #[allow(clippy::type_complexity)]
    fn __getnewargs__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, f64, f64, usize, bool, &'static str)> {
        let crate::IcpResult { fitness, inlier_rmse, iterations, converged, .. } = self.0;
        Ok((self.transformation(py)?, fitness, inlier_rmse, iterations, converged, self.stop()))
    }

    /// (4, 4) ndarray: the rigid motion from the source's frame to the target's.
    #[getter]
    fn transformation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, self.0.transformation.to_rows().as_flattened()).reshape([4, 4])
    }

    /// float: share of source points with a correspondence, in [0, 1].
    #[getter]
    fn fitness(&self) -> f64 {
        self.0.fitness
    }

    /// float: root mean square distance of the correspondences, metres; 0 if there are none.
    #[getter]
    fn inlier_rmse(&self) -> f64 {
        self.0.inlier_rmse
    }

    /// int: how often the pose was updated.
    #[getter]
    fn iterations(&self) -> usize {
        self.0.iterations
    }

    /// bool: whether the tolerance was met.
    #[getter]
    fn converged(&self) -> bool {
        self.0.converged
    }

    /// str: why the iterations ended: "tolerance", "iterations", "too few correspondences" or "degenerate".
    #[getter]
    fn stop(&self) -> &'static str {
        STOPS.iter().find(|(reason, _)| *reason == self.0.stop).map_or("", |(_, name)| name)
    }

    fn __repr__(&self) -> String {
        format!(
            "IcpResult(fitness={:.4}, inlier_rmse={:.3e}, iterations={}, converged={}, stop=\"{}\")",
            self.0.fitness,
            self.0.inlier_rmse,
            self.0.iterations,
            if self.0.converged { "True" } else { "False" },
            self.stop()
        )
    }
}

/// Register two clouds by iterated closest points (section IV-C, eq. 15).
///
/// Minimises f(R, t) = sum |R x_i + t - y_i|^2 over the pairs of source points x_i and their nearest target
/// points y_i, or, with normals of the target, sum ((R x_i + t - y_i) . n_i)^2, linearised about the current
/// pose.
///
/// Parameters
/// ----------
/// source : (N, 3) array_like of float
///     The cloud that is moved, metres.
/// target : (M, 3) array_like of float
///     The cloud that stays, metres.
/// max_correspondence_distance : float
///     Pairs farther apart than this do not count, metres.
/// start : (4, 4) array_like of float, optional
///     Rigid motion from the source's frame to the target's to start from; the identity if not given.
/// target_normals : (M, 3) array_like of float, optional
///     Unit normals of the target: minimise the distance point to plane.
/// max_iterations : int
///     Most updates of the pose.
/// tolerance : float
///     Ends when an update changes the fitness by no more than this, and the inlier RMSE by no more than this
///     times `max_correspondence_distance`.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or leave them out.
///
/// Returns
/// -------
/// strand.IcpResult
///     With transformation, fitness, inlier_rmse, iterations, converged and stop. Where the data do not fix a
///     pose (too few pairs, all on a line) it holds the last sound one and says so in `stop`.
///
/// Raises
/// ------
/// TypeError
///     If an array does not hold floating point numbers.
/// ValueError
///     If a shape is wrong, a coordinate is not finite, a normal is neither of unit length nor zero, `start`
///     is not a rigid motion, or a limit is out of range.
/// strand.NotEnoughDataError
///     If a cloud is empty.
#[pyfunction]
#[pyo3(signature = (source, target, max_correspondence_distance, *, start = None, target_normals = None,
                    max_iterations = None, tolerance = None, nonfinite = "raise"),
       text_signature = "(source, target, max_correspondence_distance, *, start=None, target_normals=None, \
                         max_iterations=30, tolerance=1e-06, nonfinite='raise')")]
#[allow(clippy::too_many_arguments)]
fn icp<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    max_correspondence_distance: &Bound<'py, PyAny>,
    start: Option<&Bound<'py, PyAny>>,
    target_normals: Option<&Bound<'py, PyAny>>,
    max_iterations: Option<&Bound<'py, PyAny>>,
    tolerance: Option<&Bound<'py, PyAny>>,
    nonfinite: &str,
) -> PyResult<IcpResult> {
    let (source, target) = (FloatArray::new("source", source)?, FloatArray::new("target", target)?);
    let (source, target) = (source.rows("source", "(N, 3)")?, target.rows("target", "(M, 3)")?);
    let normals = target_normals.map(|value| FloatArray::new("target_normals", value)).transpose()?;
    let normals = normals.as_ref().map(|array| array.rows("target_normals", "(M, 3)")).transpose()?;
    if let Some(normals) = normals {
        require_same_length("target_normals", normals.len(), target.len())?;
    }
    let options = IcpOptions {
        start: start.map_or(Ok(RigidMotion::identity()), |value| motion("start", value))?,
        max_correspondence_distance: number("max_correspondence_distance", max_correspondence_distance)?,
        max_iterations: max_iterations.map_or(Ok(30), |value| count("max_iterations", value))?,
        tolerance: tolerance.map_or(Ok(1e-6), |value| number("tolerance", value))?,
    };
    let source_rows = Rows::new(nonfinite, &[source])?;
    let target_rows = Rows::new(nonfinite, &[target, normals.unwrap_or(target)])?;
    let result = py.detach(|| {
        let normals = normals.map(|normals| target_rows.select(normals));
        let objective = normals.as_deref().map_or(Objective::PointToPoint, Objective::PointToPlane);
        crate::icp(&source_rows.select(source), &target_rows.select(target), objective, &options)
    })?;
    Ok(IcpResult(result))
}

/// Register clouds one after the other, each to all before it; see `icp`.
///
/// Gives the outcome for all but the first.
#[pyfunction]
fn register_in_turn(
    py: Python<'_>,
    clouds: Vec<Bound<'_, PyAny>>,
    max_correspondence_distance: f64,
    max_iterations: usize,
    tolerance: f64,
) -> PyResult<Vec<IcpResult>> {
    let clouds = FloatArray::all("clouds", &clouds)?;
    let clouds = clouds.iter().map(|cloud| cloud.rows("clouds", "(N, 3)")).collect::<PyResult<Vec<_>>>()?;
    let options =
        IcpOptions { start: RigidMotion::identity(), max_correspondence_distance, max_iterations, tolerance };
    Ok(py.detach(|| crate::register_in_turn(&clouds, &options))?.into_iter().map(IcpResult).collect())
}

/// Compute axis points from surface points and normals (section IV-D, eq. 16-18).
///
/// Every surface point moves inwards by the string's radius, c_i = p_i - r n_i; where at least
/// `min_neighbors` points p_j lie within 2r of p_i (p_i itself is one), the axis point is the mean of their c_j.
///
/// Parameters
/// ----------
/// points : (N, 3) array_like of float
///     Surface points, metres, any frame.
/// normals : (N, 3) array_like of float
///     Their outward unit normals; points with the zero vector take no part.
/// radius : float
///     The string's radius r, metres.
/// min_neighbors : int
///     N_lim.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or leave them out.
///
/// Returns
/// -------
/// axis_points : (M, 3) ndarray
///     Averaged axis points, metres, in the order of the points they belong to.
/// indices : (M,) ndarray of int64
///     Which input point each was computed at.
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
fn centerline<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    normals: &Bound<'py, PyAny>,
    radius: &Bound<'py, PyAny>,
    min_neighbors: &Bound<'py, PyAny>,
    nonfinite: &str,
) -> PyResult<(PointsArray<'py>, Bound<'py, PyArray1<i64>>)> {
    let (points, normals) = (FloatArray::new("points", points)?, FloatArray::new("normals", normals)?);
    let (points, normals) = (points.rows("points", "(N, 3)")?, normals.rows("normals", "(N, 3)")?);
    require_same_length("normals", normals.len(), points.len())?;
    let radius = number("radius", radius)?;
    let min_neighbors = count("min_neighbors", min_neighbors)?;
    let rows = Rows::new(nonfinite, &[points, normals])?;
    let result =
        py.detach(|| crate::centerline(&rows.select(points), &rows.select(normals), radius, min_neighbors))?;
    Ok((points_array(py, result.points)?, PyArray1::from_vec(py, rows.original(result.indices))))
}

/// Trace ordered chains through axis points (section V-A, fig. 9-10).
///
/// From a base point, all points within `near` stop being targets, the nearest target within `far` is the
/// next node, and so on until there is none; the other side of the base grows in the same way, and the
/// targets that remain give new chains.
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
///     The first base point. If not given, and for later chains, it is the target farthest from the cloud's
///     centroid.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or leave them out.
///
/// Returns
/// -------
/// list of (K,) ndarray of int64
///     Indices of each chain's nodes from end to end, in the order in which the chains were found. A point
///     with no target in reach makes a chain of one node.
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
fn trace_chains<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    near: &Bound<'py, PyAny>,
    far: &Bound<'py, PyAny>,
    start: Option<&Bound<'py, PyAny>>,
    nonfinite: &str,
) -> PyResult<Vec<Bound<'py, PyArray1<i64>>>> {
    let array = FloatArray::new("points", points)?;
    let points = array.rows("points", "(N, 3)")?;
    let (near, far) = (number("near", near)?, number("far", far)?);
    let rows = Rows::new(nonfinite, &[points])?;
    let start = start.map(|value| count("start", value)).transpose()?;
    let start = match (start, &rows.kept) {
        (Some(start), Some(kept)) => Some(kept.binary_search(&start).map_err(|_| {
            PyValueError::new_err(format!("start: expected the index of a finite point, got {start}"))
        })?),
        (start, _) => start,
    };
    let chains = py.detach(|| crate::trace_chains(&rows.select(points), near, far, start))?;
    Ok(chains.into_iter().map(|chain| PyArray1::from_vec(py, rows.original(chain))).collect())
}

/// Set how many threads the kernels use from now on.
///
/// Results do not depend on it.
///
/// Parameters
/// ----------
/// threads : int
///     The number of threads, at most 256; 0 for one for each core.
///
/// Raises
/// ------
/// ValueError
///     If `threads` is negative.
#[pyfunction]
fn set_num_threads(threads: &Bound<'_, PyAny>) -> PyResult<()> {
    crate::set_num_threads(count("threads", threads)?);
    Ok(())
}

/// Tell how many threads the kernels use.
///
/// Returns
/// -------
/// int
#[pyfunction]
fn num_threads() -> usize {
    crate::num_threads()
}

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("StrandError", py.get_type::<StrandError>())?;
    module.add("NotEnoughDataError", py.get_type::<NotEnoughDataError>())?;
    module.add_class::<IcpResult>()?;
    module.add_class::<views::Sight>()?;
    module.add_function(wrap_pyfunction!(views::unproject, module)?)?;
    module.add_function(wrap_pyfunction!(views::copy_depth, module)?)?;
    module.add_function(wrap_pyfunction!(views::crop, module)?)?;
    module.add_function(wrap_pyfunction!(views::crop_images, module)?)?;
    module.add_function(wrap_pyfunction!(curves::straighten, module)?)?;
    module.add_function(wrap_pyfunction!(views::hides, module)?)?;
    module.add_function(wrap_pyfunction!(views::usual_neighbors, module)?)?;
    module.add_function(wrap_pyfunction!(views::occupied_cubes, module)?)?;
    module.add_function(wrap_pyfunction!(curves::crowded, module)?)?;
    module.add_function(wrap_pyfunction!(radius_outlier_mask, module)?)?;
    module.add_function(wrap_pyfunction!(count_neighbors, module)?)?;
    module.add_function(wrap_pyfunction!(count_neighbors_each, module)?)?;
    module.add_function(wrap_pyfunction!(estimate_normals, module)?)?;
    module.add_function(wrap_pyfunction!(estimate_normals_each, module)?)?;
    module.add_function(wrap_pyfunction!(icp, module)?)?;
    module.add_function(wrap_pyfunction!(register_in_turn, module)?)?;
    module.add_function(wrap_pyfunction!(centerline, module)?)?;
    module.add_function(wrap_pyfunction!(trace_chains, module)?)?;
    module.add_function(wrap_pyfunction!(tubes::strip_radii, module)?)?;
    module.add_function(wrap_pyfunction!(tubes::trace_tubes, module)?)?;
    module.add_function(wrap_pyfunction!(tubes::fit_tubes, module)?)?;
    module.add_function(wrap_pyfunction!(curves::spline_through, module)?)?;
    module.add_function(wrap_pyfunction!(curves::spline_places, module)?)?;
    module.add_function(wrap_pyfunction!(curves::arc_lengths, module)?)?;
    module.add_function(wrap_pyfunction!(curves::string_parts, module)?)?;
    module.add_function(wrap_pyfunction!(curves::path_length, module)?)?;
    module.add_function(wrap_pyfunction!(curves::end_direction, module)?)?;
    module.add_function(wrap_pyfunction!(curves::bridge, module)?)?;
    module.add_function(wrap_pyfunction!(curves::bending, module)?)?;
    module.add_function(wrap_pyfunction!(curves::join_cost, module)?)?;
    module.add_function(wrap_pyfunction!(set_num_threads, module)?)?;
    module.add_function(wrap_pyfunction!(num_threads, module)?)
}
