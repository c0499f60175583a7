//! Bindings of registration. Sections and equations are those of *Shape Modeling of A String And Recognition Using
//! Distance Sensor*.

use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{Given, Points, Rows, count, motion, number, require_same_length, slices};
use super::arrays::array;
use super::released::released;
use crate::geometry::RigidMotion;
use crate::icp::{IcpOptions, Objective, Stop};

// the text signature of `icp` repeats these numbers
const _: () = assert!(IcpOptions::MAX_ITERATIONS == 30 && IcpOptions::TOLERANCE == 1e-6);

/// The Python names of the reasons why a registration ended.
const STOPS: [(Stop, &str); 4] = [
    (Stop::Tolerance, "tolerance"),
    (Stop::Iterations, "iterations"),
    (Stop::TooFewCorrespondences, "too few correspondences"),
    (Stop::Degenerate, "degenerate"),
];

/// The result of `strand.icp`.
#[pyclass(frozen, module = "strand")]
pub(super) struct IcpResult(crate::IcpResult);

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

    /// Arguments from which a pickle is restored.
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
        array(py, self.0.transformation.to_rows().as_flattened().to_vec(), [4, 4])
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

    /// int: number of updates of the pose.
    #[getter]
    fn iterations(&self) -> usize {
        self.0.iterations
    }

    /// bool: whether the tolerance was met.
    #[getter]
    fn converged(&self) -> bool {
        self.0.converged
    }

    /// str: why it ended: "tolerance", "iterations", "too few correspondences" or "degenerate".
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
/// It minimises f(R, t) = sum |R x_i + t - y_i|^2 over the pairs of source points x_i and their nearest target points
/// y_i. With normals of the target it minimises sum ((R x_i + t - y_i) . n_i)^2, linearised at the current pose.
///
/// Parameters
/// ----------
/// source : (N, 3) array_like of float
///     The cloud that is moved, metres.
/// target : (M, 3) array_like of float
///     The cloud that stays, metres.
/// max_correspondence_distance : float
///     Largest distance between the points of a pair, metres.
/// start : (4, 4) array_like of float, optional
///     Start: rigid motion from the source's frame to the target's; the identity by default.
/// target_normals : (M, 3) array_like of float, optional
///     Unit normals of the target: minimise point-to-plane distances.
/// max_iterations : int
///     Updates of the pose at most.
/// tolerance : float
///     The registration ends when an update changes the fitness by at most this, and the inlier RMSE by at most this
///     times `max_correspondence_distance`.
/// nonfinite : {"raise", "drop"}
///     What to do with rows that hold NaN or infinity: refuse them, or drop them.
///
/// Returns
/// -------
/// strand.IcpResult
///     If the data do not fix a pose (too few pairs, all on a line), it holds the last sound pose and says so in `stop`.
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
                    max_iterations = Given(None), tolerance = Given(None), nonfinite = "raise"),
       text_signature = "(source, target, max_correspondence_distance, *, start=None, target_normals=None, \
                         max_iterations=30, tolerance=1e-06, nonfinite='raise')")]
#[allow(clippy::too_many_arguments)]
pub(super) fn icp<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    max_correspondence_distance: &Bound<'py, PyAny>,
    start: Option<&Bound<'py, PyAny>>,
    target_normals: Option<&Bound<'py, PyAny>>,
    max_iterations: Given<'py>,
    tolerance: Given<'py>,
    nonfinite: &str,
) -> PyResult<IcpResult> {
    let (source, target) =
        (Points::new("source", source, "(N, 3)")?, Points::new("target", target, "(M, 3)")?);
    let normals = target_normals.map(|value| Points::new("target_normals", value, "(M, 3)")).transpose()?;
    if let Some(normals) = &normals {
        require_same_length("target_normals", normals.len(), target.len())?;
    }
    let options = IcpOptions {
        start: start.map_or(Ok(RigidMotion::identity()), |value| motion("start", value))?,
        max_correspondence_distance: number("max_correspondence_distance", max_correspondence_distance)?,
        max_iterations: max_iterations
            .or(IcpOptions::MAX_ITERATIONS, |value| count("max_iterations", value))?,
        tolerance: tolerance.or(IcpOptions::TOLERANCE, |value| number("tolerance", value))?,
    };
    let source_rows = Rows::new(nonfinite, &[&source])?;
    let target_rows = Rows::new(nonfinite, &[&target, normals.as_deref().unwrap_or(&target)])?;
    let result = released(py, move || {
        let normals = normals.as_ref().map(|normals| target_rows.select(normals));
        let objective = normals.as_deref().map_or(Objective::PointToPoint, Objective::PointToPlane);
        crate::icp(&source_rows.select(&source), &target_rows.select(&target), objective, &options)
    })??;
    Ok(IcpResult(result))
}

/// Register clouds one after the other, each to all before it; see `icp`.
///
/// Return the results for all clouds but the first.
#[pyfunction]
pub(super) fn register_in_turn(
    py: Python<'_>,
    clouds: Vec<Bound<'_, PyAny>>,
    max_correspondence_distance: f64,
    max_iterations: usize,
    tolerance: f64,
) -> PyResult<Vec<IcpResult>> {
    let clouds = Points::all("clouds", &clouds)?;
    let options =
        IcpOptions { max_correspondence_distance, max_iterations, tolerance, ..IcpOptions::default() };
    let found = released(py, move || crate::register_in_turn(&slices(&clouds), &options))??;
    Ok(found.into_iter().map(IcpResult).collect())
}
