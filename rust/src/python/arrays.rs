//! Arrays that Rust returns to Python. They raise if memory runs out; those of the numpy crate panic or use a null
//! pointer.

use std::any::Any;
use std::ffi::c_void;
use std::ops::Range;
use std::ptr::null_mut;
use std::sync::Arc;

use numpy::ndarray::{Dimension, IntoDimension};
use numpy::npyffi::{NPY_ARRAY_WRITEABLE, NpyTypes, PyArrayObject, get_type_object, npy_intp};
use numpy::{
    Element, PY_ARRAY_API, PyArray, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::intern;
use pyo3::prelude::*;

use crate::geometry::Point;

/// An (N, 3) array that is returned.
pub(super) type PointsArray<'py> = Bound<'py, PyArray2<f64>>;

/// Smaller arrays are copied into NumPy's memory, which costs less than keeping Rust's, bytes.
const COPIED: usize = 1 << 12;
/// Bases of an array that are followed at most; NumPy itself keeps only the first and the last.
const MAX_BASES: usize = 8;

/// Owns the memory of an array: a vector.
#[pyclass(frozen, module = "strand._core")]
struct Memory {
    values: Arc<dyn Any + Send + Sync>,
    /// Whether nobody can write to it. NumPy cannot make such an array writeable, because this class exports no buffer.
    constant: bool,
}

/// Numbers in C order that nobody can write to, shared with their array.
#[derive(Clone)]
pub(super) struct Constant<T> {
    memory: Arc<Vec<T>>,
    range: Range<usize>,
}

impl<T: Element + Copy + 'static> Constant<T> {
    /// Takes the numbers of an array that `constant` made, or of a part of one; None for other arrays.
    pub(super) fn of<D: Dimension>(array: &Bound<'_, PyArray<T, D>>) -> Option<Self> {
        if !array.is_c_contiguous() {
            return None;
        }
        // any base counts that owns the numbers' memory and that nobody can write to
        let base = intern!(array.py(), "base");
        let mut owner = array.getattr(base).ok()?;
        for _ in 0..MAX_BASES {
            if !owner.is_instance_of::<PyUntypedArray>() {
                break;
            }
            owner = owner.getattr(base).ok()?;
        }
        let memory = owner.cast::<Memory>().ok()?.get();
        let values = memory.constant.then(|| memory.values.clone().downcast::<Vec<T>>().ok())??;
        let away = array.data().addr().checked_sub(values.as_ptr().addr())?;
        let start = away / size_of::<T>();
        let range = start..start.checked_add(array.len())?;
        (away % size_of::<T>() == 0 && range.end <= values.len()).then_some(Self { memory: values, range })
    }

    pub(super) fn slice(&self) -> &[T] {
        &self.memory[self.range.clone()]
    }
}

/// Makes an array of a shape, row by row, from the vector's memory.
pub(super) fn array<T: Element + Copy + 'static, I: IntoDimension>(
    py: Python<'_>,
    values: Vec<T>,
    shape: I,
) -> PyResult<Bound<'_, PyArray<T, I::Dim>>> {
    made(py, values, shape, false)
}

/// Makes an array that nobody can write to, so that kernels need no copy of it.
pub(super) fn constant<T: Element + Copy + 'static, I: IntoDimension>(
    py: Python<'_>,
    values: Vec<T>,
    shape: I,
) -> PyResult<Bound<'_, PyArray<T, I::Dim>>> {
    made(py, values, shape, true)
}

fn made<T: Element + Copy + 'static, I: IntoDimension>(
    py: Python<'_>,
    values: Vec<T>,
    shape: I,
    constant: bool,
) -> PyResult<Bound<'_, PyArray<T, I::Dim>>> {
    let dimension = shape.into_dimension();
    let mut shape: Vec<npy_intp> = dimension.slice().iter().map(|&size| size as npy_intp).collect();
    if dimension.size_checked() != Some(values.len()) {
        return Err(PyValueError::new_err("an answer does not have the shape that it should"));
    }
    // NumPy can make its own memory writeable again
    let copied = !constant && size_of_val(&values[..]) < COPIED;
    let data = if copied { null_mut() } else { values.as_ptr().cast_mut().cast::<c_void>() };
    // with any flag, NumPy would order its own memory by columns
    let flags = if copied || constant { 0 } else { NPY_ARRAY_WRITEABLE };
    // SAFETY: the shape has the given number of dimensions. Without data, NumPy allocates its own; else the vector has as many
    // values as the shape, and its owner becomes the array's base below, before anyone else has the array
    let array = unsafe {
        PY_ARRAY_API.PyArray_NewFromDescr(
            py,
            get_type_object(py, NpyTypes::PyArray_Type),
            T::get_dtype(py).into_dtype_ptr(),
            shape.len() as _,
            shape.as_mut_ptr(),
            null_mut(),
            data,
            flags,
            null_mut(),
        )
    };
    // SAFETY: NumPy gave a new reference, or null with an error set
    let array = unsafe { Bound::from_owned_ptr_or_err(py, array) }?;
    let object = array.as_ptr().cast::<PyArrayObject>();
    if copied {
        // SAFETY: the array is new, of this type and as long as the vector
        unsafe { std::ptr::copy_nonoverlapping(values.as_ptr(), (*object).data.cast(), values.len()) };
    } else {
        let memory = Bound::new(py, Memory { values: Arc::new(values), constant })?;
        // SAFETY: both objects are alive; NumPy owns the reference from here on, even if the call fails
        let code = unsafe { PY_ARRAY_API.PyArray_SetBaseObject(py, object, memory.into_ptr()) };
        if code != 0 {
            return Err(PyErr::fetch(py));
        }
    }
    // SAFETY: it was made with this type and number of dimensions
    Ok(unsafe { array.cast_into_unchecked() })
}

/// Loads the parts of Python and NumPy that the first array needs; they would panic if missing.
pub(super) fn prepare(py: Python<'_>) -> PyResult<()> {
    py.import("numpy")?;
    array(py, vec![0u8; COPIED], [COPIED]).map(drop)
}

/// Makes an array of one dimension.
pub(super) fn list<T: Element + Copy + 'static>(
    py: Python<'_>,
    values: Vec<T>,
) -> PyResult<Bound<'_, PyArray1<T>>> {
    let count = values.len();
    array(py, values, [count])
}

/// Makes an array of one dimension that nobody can write to.
pub(super) fn constant_list<T: Element + Copy + 'static>(
    py: Python<'_>,
    values: Vec<T>,
) -> PyResult<Bound<'_, PyArray1<T>>> {
    let count = values.len();
    constant(py, values, [count])
}

/// Makes an (N, 3) array that nobody can write to.
pub(super) fn constant_points(py: Python<'_>, points: Vec<Point>) -> PyResult<PointsArray<'_>> {
    let rows = points.len();
    constant(py, points.into_flattened(), [rows, 3])
}

pub(super) fn points_array(py: Python<'_>, points: Vec<Point>) -> PyResult<PointsArray<'_>> {
    let rows = points.len();
    array(py, points.into_flattened(), [rows, 3])
}
