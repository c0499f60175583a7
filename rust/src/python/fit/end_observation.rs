//! An end of a rope that one view sees, as Python hands it in.

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::checks::{check_finite, check_positive, check_unit};
use crate::geometry::Point;
use crate::python::arguments::{count, number, point};
use crate::python::arrays::list;

/// Where one view sees a rope end.
///
/// Parameters
/// ----------
/// view : int
/// end : int
///     Which end; a view sees an end once.
/// place : (3,) array_like of float
///     In the world frame as the reported pose places it, metres.
/// outward : (3,) array_like of float
///     Unit vector along the rope, out of it. The place counts in this direction only.
/// sd : float
///     Standard deviation of the place in that direction, metres.
///
/// Raises
/// ------
/// TypeError
///     If an argument is of the wrong kind.
/// ValueError
///     If a number is negative or not finite, `outward` is not of unit length, or `sd` is not positive.
#[pyclass(frozen, module = "strand._core")]
pub(in super::super) struct EndObservation {
    /// int: which view.
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

    /// int: which end.
    #[getter]
    fn end(&self) -> usize {
        self.observation.end
    }

    /// (3,) ndarray: in the world frame as the reported pose places it, metres.
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

    /// What a pickle makes it of again.
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
