//! The end of a rope that one view sees, as passed by the caller.

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::checks::{check_finite, check_positive, check_unit};
use crate::geometry::Point;
use crate::python::arguments::{count, number, point};
use crate::python::arrays::list;

/// The end of a rope as one view sees it.
///
/// Parameters
/// ----------
/// view : int
/// end : int
///     The number of the end; a view sees each end once.
/// place : (3,) array_like of float
///     Position in the world frame, placed by the reported pose, metres.
/// outward : (3,) array_like of float
///     Unit vector along the rope, out of it. Only this component of the position counts.
/// sd : float
///     Standard deviation of the position in that direction, metres.
///
/// Raises
/// ------
/// TypeError
///     If an argument is of the wrong kind.
/// ValueError
///     If a number is negative or not finite, `outward` is not of unit length, or `sd` is not positive.
#[pyclass(frozen, module = "strand._core")]
pub struct EndObservation {
    /// int: number of the view.
    #[pyo3(get)]
    pub(super) view: usize,
    pub(super) observation: crate::EndObservation,
}

#[pymethods]
impl EndObservation {
    #[new]
    fn new(
        view: &Bound<'_, PyAny>,
        end: &Bound<'_, PyAny>,
        place: &Bound<'_, PyAny>,
        outward: &Bound<'_, PyAny>,
        sd: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let observation = crate::EndObservation {
            end: count("end", end)?,
            place: point("place", place)?,
            outward: point("outward", outward)?,
            sd: number("sd", sd)?,
        };
        check_finite("place", &[observation.place])?;
        check_unit("outward", observation.outward)?;
        check_positive("sd", observation.sd)?;
        Ok(Self { view: count("view", view)?, observation })
    }

    /// int: number of the end.
    #[getter]
    fn end(&self) -> usize {
        self.observation.end
    }

    /// (3,) ndarray: position in the world frame, placed by the reported pose, metres.
    #[getter]
    fn place<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        list(py, self.observation.place.to_vec())
    }

    /// (3,) ndarray: unit vector along the rope, out of it.
    #[getter]
    fn outward<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        list(py, self.observation.outward.to_vec())
    }

    /// float: standard deviation of the place in that direction, metres.
    #[getter]
    fn sd(&self) -> f64 {
        self.observation.sd
    }

    /// Arguments from which a pickle is restored.
    fn __getnewargs__(&self) -> (usize, usize, Point, Point, f64) {
        let crate::EndObservation { end, place, outward, sd } = self.observation;
        (self.view, end, place, outward, sd)
    }

    fn __repr__(&self) -> String {
        let crate::EndObservation { end, place, outward, sd } = self.observation;
        format!(
            "EndObservation(view={}, end={end}, place={place:?}, outward={outward:?}, sd={sd:?})",
            self.view
        )
    }
}
