//! What counts as plain numbers: scalars, and arrays without a mask or a unit.

use numpy::PyUntypedArray;
use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyFloat, PyInt, PyList, PyTuple};

use super::called::text_of;

/// Lists in lists, deeper than any argument's.
const MAX_NESTING: usize = 4;

/// Refuses arrays with a mask or a unit, alone or in lists, and bools in lists: NumPy would take the numbers under the
/// mask, drop the unit, and take bools for 0 or 1. Other subclasses, such as matrices and memory maps, count as the plain numbers that they hold.
pub(super) fn refuse_masks_and_units(name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    refuse_nested(name, value, 0)
}

fn refuse_nested(name: &str, value: &Bound<'_, PyAny>, nesting: usize) -> PyResult<()> {
    let py = value.py();
    if value.is_instance_of::<PyUntypedArray>() {
        let exact = value.get_type().is(PyUntypedArray::type_object(py));
        if !exact && value.is_instance(&py.import("numpy.ma")?.getattr("MaskedArray")?)? {
            return Err(PyTypeError::new_err(format!(
                "{name}: expected an array without a mask; fill or drop masked values"
            )));
        }
        if !exact && (value.hasattr("unit")? || value.hasattr("units")?) {
            let kind = value.get_type().name()?;
            return Err(PyTypeError::new_err(format!(
                "{name}: expected plain numbers in SI units, got {kind}"
            )));
        }
    } else if nesting < MAX_NESTING && (value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>())
    {
        for entry in value.try_iter()? {
            let entry = entry?;
            if entry.is_instance_of::<PyFloat>() {
                continue;
            }
            if is_flag(&entry) {
                return Err(PyTypeError::new_err(format!(
                    "{name}: expected numbers, got True or False among them"
                )));
            }
            refuse_nested(name, &entry, nesting + 1)?;
        }
    }
    Ok(())
}

/// Returns whether a value is a bool of Python or NumPy, which NumPy takes for 0 or 1 in a list.
fn is_flag(value: &Bound<'_, PyAny>) -> bool {
    let kind = || value.getattr("dtype")?.getattr("kind")?.extract::<String>();
    value.is_instance_of::<PyBool>()
        || (!value.is_instance_of::<PyInt>() && kind().is_ok_and(|kind| kind == "b"))
}

/// Takes a number: of Python, a scalar of NumPy, or an array without a dimension.
pub(super) fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let refused = || PyTypeError::new_err(format!("{name}: expected a number, got {}", text_of(value)));
    let plain = value.is_instance_of::<PyFloat>() || value.is_instance_of::<PyInt>();
    if value.is_instance_of::<PyBool>() || !(plain || is_scalar(name, value, "fiu")?) {
        return Err(refused());
    }
    value.extract().map_err(|error: PyErr| match error.is_instance_of::<PyOverflowError>(value.py()) {
        true => {
            PyValueError::new_err(format!("{name}: expected a number of double precision, got a larger one"))
        }
        false => refused(),
    })
}

/// Takes a whole number that is not negative.
pub(super) fn count(name: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let refused = || PyTypeError::new_err(format!("{name}: expected a whole number, got {}", text_of(value)));
    if value.is_instance_of::<PyBool>() || !(value.is_instance_of::<PyInt>() || is_scalar(name, value, "iu")?)
    {
        return Err(refused());
    }
    let number: i64 = value.extract().map_err(|error: PyErr| {
        match error.is_instance_of::<PyOverflowError>(value.py()) {
            true => PyValueError::new_err(format!("{name}: expected a number >= 0 and below 2^63")),
            false => refused(),
        }
    })?;
    usize::try_from(number)
        .map_err(|_| PyValueError::new_err(format!("{name}: expected a number >= 0, got {number}")))
}

/// Returns whether a value is a scalar of NumPy, or an array without a dimension, of some kinds.
fn is_scalar(name: &str, value: &Bound<'_, PyAny>, kinds: &str) -> PyResult<bool> {
    let Ok(dtype) = value.getattr("dtype") else { return Ok(false) };
    refuse_masks_and_units(name, value)?;
    let kind = dtype.getattr("kind").and_then(|kind| kind.extract::<String>());
    let dimensions = value.getattr("ndim").and_then(|count| count.extract::<usize>());
    Ok(kind.is_ok_and(|kind| kinds.contains(&kind)) && dimensions.is_ok_and(|count| count == 0))
}
