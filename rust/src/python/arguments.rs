//! What Python hands in, checked and made into slices; what Rust hands back, made into arrays.

use std::borrow::Cow;

use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::{Point, RigidMotion};

/// An (N, 3) array that is handed back.
pub(super) type PointsArray<'py> = Bound<'py, PyArray2<f64>>;

/// A C-ordered float64 array made of an argument; borrowed where it already is one.
pub(super) struct FloatArray<'py>(pub(super) PyReadonlyArrayDyn<'py, f64>);

impl<'py> FloatArray<'py> {
    pub(super) fn new(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Self> {
        let py = value.py();
        if let Ok(array) = value.cast::<PyArrayDyn<f64>>()
            && array.is_c_contiguous()
            && array.data().is_aligned()
        {
            return Ok(Self(array.readonly()));
        }
        let numpy = py.import("numpy")?;
        let array = numpy.call_method1("asarray", (value,)).map_err(|error| named(py, name, error))?;
        let dtype = array.getattr("dtype")?;
        if dtype.getattr("kind")?.extract::<String>()? != "f" {
            return Err(PyTypeError::new_err(format!(
                "{name}: expected floating point numbers, got dtype {dtype}"
            )));
        }
        // C order and alignment, copied only where the array lacks either
        let array = numpy.call_method1("require", (array, "float64", "CA"))?;
        Ok(Self(array.extract()?))
    }

    /// Several arguments of one name.
    pub(super) fn all(name: &str, values: &[Bound<'py, PyAny>]) -> PyResult<Vec<Self>> {
        values.iter().map(|value| Self::new(name, value)).collect()
    }

    /// The array as rows of three; `shape` is what the error message asks for.
    pub(super) fn rows(&self, name: &str, shape: &str) -> PyResult<&[Point]> {
        match self.0.shape() {
            [_, 3] => Ok(self.slice()?.as_chunks().0),
            other => Err(wrong_shape(name, shape, other)),
        }
    }

    pub(super) fn slice(&self) -> PyResult<&[f64]> {
        // numpy.require made it so; as_slice alone would accept Fortran order too
        debug_assert!(self.0.is_c_contiguous());
        self.0.as_slice().map_err(|error| PyValueError::new_err(error.to_string()))
    }
}

pub(super) fn wrong_shape(name: &str, want: &str, got: &[usize]) -> PyErr {
    PyValueError::new_err(format!("{name}: expected shape {want}, got {got:?}"))
}

/// An error of NumPy about an argument's value, with the argument's name.
pub(super) fn named(py: Python<'_>, name: &str, error: PyErr) -> PyErr {
    if error.is_instance_of::<PyValueError>(py) {
        PyValueError::new_err(format!("{name}: {}", error.value(py)))
    } else {
        error
    }
}

/// A place or a vector.
pub(super) fn point(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Point> {
    let array = FloatArray::new(name, value)?;
    array.slice()?.try_into().map_err(|_| wrong_shape(name, "(3,)", array.0.shape()))
}

/// A real number.
pub(super) fn number(name: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    value.extract().map_err(|_| PyTypeError::new_err(format!("{name}: expected a number, got {value}")))
}

/// A whole number that is not negative.
pub(super) fn count(name: &str, value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let number: i64 = value
        .extract()
        .map_err(|_| PyTypeError::new_err(format!("{name}: expected a whole number, got {value}")))?;
    usize::try_from(number)
        .map_err(|_| PyValueError::new_err(format!("{name}: expected a number >= 0, got {number}")))
}

pub(super) fn motion(name: &str, value: &Bound<'_, PyAny>) -> PyResult<RigidMotion> {
    let array = FloatArray::new(name, value)?;
    if array.0.shape() != [4, 4] {
        return Err(wrong_shape(name, "(4, 4)", array.0.shape()));
    }
    let rows: [[f64; 4]; 4] = std::array::from_fn(|i| std::array::from_fn(|j| array.0.as_array()[[i, j]]));
    RigidMotion::from_rows(&rows)
        .map_err(|error| PyValueError::new_err(error.to_string().replacen("pose", name, 1)))
}

/// Which rows of the arguments a kernel sees.
pub(super) struct Rows {
    /// Indices of the kept rows; none if all are kept.
    pub(super) kept: Option<Vec<usize>>,
    total: usize,
}

impl Rows {
    /// Decides on rows with NaN or infinity in any of `arrays`, which are of one length: `"raise"` leaves them for
    /// the kernel to refuse, `"drop"` leaves them out.
    pub(super) fn new(nonfinite: &str, arrays: &[&[Point]]) -> PyResult<Self> {
        let total = arrays[0].len();
        let finite = |i: &usize| arrays.iter().all(|rows| rows[*i].iter().all(|x| x.is_finite()));
        let kept = match nonfinite {
            "raise" => None,
            "drop" => Some((0..total).filter(finite).collect()),
            other => {
                return Err(PyValueError::new_err(format!(
                    "nonfinite: expected \"raise\" or \"drop\", got \"{other}\""
                )));
            }
        };
        Ok(Self { kept, total })
    }

    pub(super) fn select<'a>(&self, rows: &'a [Point]) -> Cow<'a, [Point]> {
        match &self.kept {
            None => Cow::Borrowed(rows),
            Some(kept) => Cow::Owned(kept.iter().map(|&i| rows[i]).collect()),
        }
    }

    /// Values of the kept rows, with `fill` at the others.
    pub(super) fn scatter<T: Copy>(&self, values: Vec<T>, fill: T) -> Vec<T> {
        match &self.kept {
            None => values,
            Some(kept) => {
                let mut all = vec![fill; self.total];
                for (&i, value) in kept.iter().zip(values) {
                    all[i] = value;
                }
                all
            }
        }
    }

    /// Indices among the kept rows, as indices of the argument's rows.
    pub(super) fn original(&self, indices: Vec<usize>) -> Vec<i64> {
        match &self.kept {
            None => indices.into_iter().map(|i| i as i64).collect(),
            Some(kept) => indices.into_iter().map(|i| kept[i] as i64).collect(),
        }
    }
}

pub(super) fn require_same_length(name: &str, got: usize, want: usize) -> PyResult<()> {
    if got == want {
        Ok(())
    } else {
        Err(PyValueError::new_err(format!(
            "{name}: expected one row for each of the {want} points, got {got}"
        )))
    }
}

/// One camera's centre, or one for each of `count` points.
pub(super) fn viewpoints<'a>(array: &'a FloatArray, count: usize) -> PyResult<(Point, Option<&'a [Point]>)> {
    const SHAPE: &str = "(3,) or (N, 3)";
    if array.0.ndim() == 2 {
        let rows = array.rows("viewpoint", SHAPE)?;
        require_same_length("viewpoint", rows.len(), count)?;
        return Ok(([0.0; 3], Some(rows)));
    }
    let one = array.slice()?.try_into().ok().filter(|_| array.0.ndim() == 1);
    Ok((one.ok_or_else(|| wrong_shape("viewpoint", SHAPE, array.0.shape()))?, None))
}

pub(super) fn points_array(py: Python<'_>, points: Vec<Point>) -> PyResult<PointsArray<'_>> {
    let rows = points.len();
    PyArray1::from_vec(py, points.into_flattened()).reshape([rows, 3])
}
