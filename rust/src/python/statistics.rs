//! Bindings of medians, scatter and steps of numbers, and of pairs of pixels.

use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{FloatArray, require_same_length, wrong_shape};
use super::arrays::{array, list};
use super::released::{guarded, released_if_many};
use crate::clouds::depth;
use crate::geometry::median::median;
use crate::geometry::{disc, linear};

const MAX_REACH: f64 = 2000.0; // pixels

/// Return the median of numbers: the mean of the middle two of an even number of them; NaN without numbers, and if one
/// is NaN.
#[pyfunction]
pub(super) fn find_median(values: &Bound<'_, PyAny>) -> PyResult<f64> {
    let values = FloatArray::of_numbers("values", values)?.into_values();
    if values.iter().any(|value| value.is_nan()) {
        return Ok(f64::NAN);
    }
    guarded(move || median(values).unwrap_or(f64::NAN))
}

/// Return the number of pairs of a disc's pixels at each distance in rows and columns: 0, 1, ..., -2, -1.
///
/// The disc has the pixels at most `reach` from its middle one.
#[pyfunction]
pub(super) fn count_disc_pairs(py: Python<'_>, reach: f64) -> PyResult<Bound<'_, PyArray2<f64>>> {
    if !(0.0..=MAX_REACH).contains(&reach) {
        return Err(PyValueError::new_err(format!("reach: expected 0 to {MAX_REACH} pixels, got {reach}")));
    }
    let effort = (8.0 * reach.powi(3)) as usize;
    let (pairs, size) = released_if_many(py, effort, move || disc::count_disc_pairs(reach))?;
    array(py, pairs, [size, size])
}

/// Return the `count` largest different numbers below another, and the `count` smallest of the others, ascending.
#[pyfunction]
pub(super) fn find_values_near<'py>(
    py: Python<'py>,
    values: &Bound<'py, PyAny>,
    at: f64,
    count: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let values = FloatArray::of_numbers("values", values)?;
    list(py, guarded(move || depth::find_values_near(values.slice(), at, count))?)
}

/// Return the robust standard deviation of (N,) values about a linear function of (N, 2) places. Differences are
/// multiplied by (N,) scales.
#[pyfunction]
pub(super) fn measure_linear_scatter(
    places: &Bound<'_, PyAny>,
    values: &Bound<'_, PyAny>,
    scales: &Bound<'_, PyAny>,
) -> PyResult<f64> {
    let [places, values, scales] = [("places", places), ("values", values), ("scales", scales)]
        .map(|(name, array)| FloatArray::of_numbers(name, array));
    let (places, values, scales) = (places?, values?, scales?);
    let &[rows, 2] = places.shape() else { return Err(wrong_shape("places", "(N, 2)", places.shape())) };
    require_same_length("values", values.slice().len(), rows)?;
    require_same_length("scales", scales.slice().len(), rows)?;
    guarded(move || {
        linear::measure_linear_scatter(places.slice().as_chunks().0, values.slice(), scales.slice())
    })
}
